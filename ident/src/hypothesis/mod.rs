//! A model with some causes added: which there may be, its optimum, and what a further one would gain.
//!
//! The ground on which [`crate::evidence`], [`crate::diagnose`] and [`crate::design`] stand: [`candidates`] lists causes and what of each is free,
//! [`state`] is a model with some of them at its optimum, [`score`] says what each would gain there by its derivatives alone, with
//! what is fitted anyway ([`nuisances`]) taken out; [`held_out`] are runs that nothing is fitted to.

pub(crate) mod candidates;
pub(crate) mod held_out;
pub(crate) mod nuisances;
pub(crate) mod score;
pub(crate) mod state;
