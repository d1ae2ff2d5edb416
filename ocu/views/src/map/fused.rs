//! The fused cost of a cell, by the world model's own rule, with all sources counting alike.

use super::grid::{Cells, Field};
use rcs_world::{Source, Weights, fuse};

/// The fields that hold each source's cost and confidence.
pub(super) struct Fused {
    sources: Vec<(Source, Field, Option<Field>)>,
    weights: Weights,
}

impl Fused {
    /// The sources of that grid.
    pub(super) fn new(cells: &Cells<'_>) -> Self {
        let field = |name: String| cells.fields.iter().find(|field| field.name == name).cloned();
        let sources = Source::ALL.into_iter().filter_map(|source| {
            Some((source, field(format!("cost.{source}"))?, field(format!("conf.{source}"))))
        });
        Self { sources: sources.collect(), weights: Weights::default() }
    }

    /// The fused cost of a cell, 255 where no source knows it. A source without confidences is believed.
    pub(super) fn cost(&self, cells: &Cells<'_>, column: usize, row: usize) -> u8 {
        let mut costs = [u8::MAX; Source::COUNT];
        let mut confidences = [0; Source::COUNT];
        for (source, cost, confidence) in &self.sources {
            costs[source.index()] = cells.read(cost, column, row) as u8;
            let believed = confidence.as_ref().map_or(255.0, |field| cells.read(field, column, row));
            confidences[source.index()] = believed as u8;
        }
        fuse(&costs, &confidences, &self.weights).cost
    }
}
