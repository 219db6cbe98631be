//! A model with some causes added: which there may be, its optimum, and what a further one would gain.
//!
//! The ground on which [`crate::diagnose`] and [`crate::design`] stand: [`candidates`] lists causes and what of each is free,
//! [`state`] is a model with some of them at its optimum, [`score`] says what each would gain there by its derivatives alone, with
//! what is fitted anyway ([`nuisances`]) taken out; `following` says where a cause in a drive begins; [`held_out`] are runs that nothing is fitted to.

pub(crate) mod candidates;
mod following;
pub(crate) mod held_out;
pub(crate) mod nuisances;
pub(crate) mod score;
pub(crate) mod state;
