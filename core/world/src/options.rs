//! Options of a map's message.

use crate::{Source, SourceKind, Sources, Weights};

/// What the message of a map contains.
#[derive(Clone, Debug, PartialEq)]
pub struct MapOptions {
    /// The sources of the stack.
    pub sources: Sources,
    /// Whether it contains heights, which take 41 bytes per cell.
    pub heights: bool,
    /// Weights of the fused fields.
    pub weights: Weights,
}

impl MapOptions {
    /// Whether the message says by which model a source judged: of sources that learn.
    pub(crate) fn has_models(&self, source: Source) -> bool {
        self.weights.get(source).kind == SourceKind::Learned
    }
}
