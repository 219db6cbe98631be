//! How good news is.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// How good the news is, from good to bad; decides the colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum Tone {
    /// As hoped.
    Good,
    /// Usable, with a reserve that the text names.
    Caution,
    /// Did not work.
    Bad,
}

impl Tone {
    /// Class in the style sheet.
    pub(super) fn class(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Caution => "caution",
            Self::Bad => "bad",
        }
    }
}
