//! How good news is.

/// How good the news is; decides the colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Tone {
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
