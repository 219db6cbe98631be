//! Why MJCF text was refused.

/// Why MJCF text was refused.
#[derive(Debug, thiserror::Error)]
pub enum MjcfError {
    /// The text is not well-formed XML.
    #[error("model is not well-formed XML")]
    Xml(#[from] roxmltree::Error),
    /// An element that is not supported.
    #[error("line {line}: element <{element}> is not supported here and would change the motion; remove it")]
    Element {
        /// Line in the text.
        line: u32,
        /// Name of the XML element.
        element: String,
    },
    /// An attribute that is not supported, or not with this value.
    #[error("line {line}: <{element}> attribute {attribute}=\"{value}\" is not supported; {instead}")]
    Attribute {
        /// Line in the text.
        line: u32,
        /// Name of the XML element.
        element: String,
        /// Name of the attribute.
        attribute: String,
        /// Value of the attribute.
        value: String,
        /// What to do.
        instead: String,
    },
    /// A value of the wrong form or out of range.
    #[error("line {line}: <{element}> attribute {attribute}=\"{value}\" must be {wanted}")]
    Value {
        /// Line in the text.
        line: u32,
        /// Name of the XML element.
        element: String,
        /// Name of the attribute.
        attribute: String,
        /// Value of the attribute.
        value: String,
        /// What it must be.
        wanted: String,
    },
    /// An attribute that must be there.
    #[error("line {line}: <{element}> needs the attribute {attribute}")]
    Missing {
        /// Line in the text.
        line: u32,
        /// Name of the XML element.
        element: String,
        /// Name of the attribute.
        attribute: String,
    },
    /// A name used twice.
    #[error("line {line}: <{element}> name \"{name}\" is taken by an earlier one")]
    Duplicate {
        /// Line in the text.
        line: u32,
        /// Name of the XML element.
        element: String,
        /// The name that is referred to.
        name: String,
    },
    /// Elements that do not fit together.
    #[error("line {line}: <{element}> \"{name}\" {problem}")]
    Inconsistent {
        /// Line in the text.
        line: u32,
        /// Name of the XML element.
        element: String,
        /// Its name.
        name: String,
        /// What is wrong and what to do.
        problem: String,
    },
}
