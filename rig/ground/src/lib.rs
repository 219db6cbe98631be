//! What every other crate of the rig uses.
//!
//! * [`strict`], [`names`], [`error_chain`], [`reasons`]: configs that refuse what they do not know, the name that may have been meant, an
//!   error with its causes, reasons grouped;
//! * [`spreadsheet`]: tables as people have them;
//! * [`statistics`], [`levenberg_marquardt`]: medians and spreads, least squares;
//! * [`random_effects`]: one number measured many times, whether it is the same, and what it follows;
//! * [`clock`], [`urgency`]: ticks and stamps on one clock, scheduling priorities;
//! * [`claim`], [`in_place`], [`hold`]: exclusive use by one process, files that a full disk cannot refuse, the hold that every stop leaves;
//! * [`choice`], [`shell`]: values chosen by name, commands to be typed.

#![cfg_attr(test, allow(clippy::disallowed_methods, reason = "tests make their files"))]

pub mod choice;
pub mod claim;
pub mod clock;
pub mod error_chain;
pub mod hold;
pub mod in_place;
pub mod levenberg_marquardt;
pub mod names;
pub mod random_effects;
pub mod reasons;
pub mod shell;
pub mod spreadsheet;
pub mod statistics;
pub mod strict;
pub mod urgency;
