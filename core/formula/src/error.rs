//! Why a formula cannot be used.

/// Why a text is not a formula, or a formula has no value.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FormulaError {
    /// The text cannot be read.
    #[error("formula, column {column}: {problem}: {text:?}")]
    Syntax {
        /// Column of the problem, from 1.
        column: usize,
        /// What was found and what was expected.
        problem: String,
        /// The whole text.
        text: String,
    },
    /// The operands do not fit their operator.
    #[error("{0}")]
    Operands(String),
}
