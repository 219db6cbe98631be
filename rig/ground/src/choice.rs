//! A choice among a few, by the names that people type.

/// An enum whose values people choose by name.
pub trait Choice: Copy + PartialEq + Send + Sync + 'static {
    /// Each value with its name and a description.
    const ALL: &'static [(Self, &'static str, &'static str)];

    /// The value's name.
    fn typed(self) -> &'static str {
        Self::ALL.iter().find(|(value, ..)| *value == self).map_or("", |(_, name, _)| name)
    }

    /// The value of that name.
    fn of_name(name: &str) -> Option<Self> {
        Self::ALL.iter().find(|(_, known, _)| *known == name).map(|(value, ..)| *value)
    }
}
