//! Why a `[fit]` table was refused.

/// Why a `[fit]` table does not go with the model, or with itself.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ParameterError {
    /// No parameter of that name or kind.
    #[error("`{table}` names `{name}`, which the model does not have{hint}")]
    Unknown {
        /// The key of the `[fit]` table.
        table: &'static str,
        /// The name as written.
        name: String,
        /// Suggestion of the nearest known name, or empty.
        hint: String,
    },
    /// What is asked for is excluded again.
    #[error("`fixed` names everything that `parameters` asks for; to fit nothing, write `parameters = []`")]
    AllFixed,
    /// Two wishes that exclude each other.
    #[error("`{name}` stands under both `{first}` and `{second}`; remove it from one of them")]
    Contradiction {
        /// Name of the parameter.
        name: String,
        /// One of the two keys.
        first: &'static str,
        /// The other key.
        second: &'static str,
    },
    /// A group names a parameter that is not fitted.
    #[error("`{key}` names `{name}`, which is not fitted; add it to `parameters` or leave it out")]
    JoinedButNotFitted {
        /// `tie` or `proportional`.
        key: &'static str,
        /// Name of the parameter.
        name: String,
    },
    /// A parameter stands in two groups.
    #[error("`{name}` stands in more than one group of `tie` or `proportional`; join these into one")]
    JoinedTwice {
        /// Name of the parameter.
        name: String,
    },
    /// Parameters of a group are not of one kind.
    #[error("`{key}` joins `{first}` and `{second}`, which are not of one kind; join like with like")]
    JoinedUnlike {
        /// `tie` or `proportional`.
        key: &'static str,
        /// Name of one parameter.
        first: String,
        /// Name of the other.
        second: String,
    },
    /// The model has no ratio to keep.
    #[error(
        "`proportional` keeps the ratios that the model has, and there `{name}` is 0 or has another sign than `{first}`; give it a value in \
         the model, or `tie` them"
    )]
    NoRatio {
        /// The first parameter of the group.
        first: String,
        /// Name of the parameter.
        name: String,
    },
    /// Bounds the wrong way round, or shut.
    #[error("bounds of `{name}` are [{lower}, {upper}]; the lower one must be less than the upper one")]
    Bounds {
        /// The key of `[fit.bounds]`.
        name: String,
        /// Lower bound.
        lower: f64,
        /// Upper bound.
        upper: f64,
    },
    /// A bound that physics excludes.
    #[error("bounds of `{name}` reach down to {lower}; a {kind} is never below 0")]
    Negative {
        /// Name of the parameter.
        name: String,
        /// Its kind.
        kind: String,
        /// Lower bound.
        lower: f64,
    },
    /// A prior outside the bounds.
    #[error("prior of `{name}` has mean {mean}, outside its bounds [{lower}, {upper}]; widen the bounds")]
    Prior {
        /// Name of the parameter.
        name: String,
        /// Mean of the prior.
        mean: f64,
        /// Lower bound.
        lower: f64,
        /// Upper bound.
        upper: f64,
    },
}

impl ParameterError {
    /// The name at fault, mostly as the `[fit]` table spells it.
    pub(crate) fn name(&self) -> &str {
        match self {
            Self::Unknown { name, .. }
            | Self::Contradiction { name, .. }
            | Self::JoinedButNotFitted { name, .. }
            | Self::JoinedTwice { name }
            | Self::JoinedUnlike { first: name, .. }
            | Self::NoRatio { name, .. }
            | Self::Bounds { name, .. }
            | Self::Negative { name, .. }
            | Self::Prior { name, .. } => name,
            Self::AllFixed => "fixed",
        }
    }
}
