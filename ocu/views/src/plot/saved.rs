//! What a layout stores of a plot.

use super::entry::Entry;
use crate::view::RunChoice;
use serde::{Deserialize, Serialize};

/// A plot: graphs below each other on one time axis.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub(super) struct Saved {
    pub(super) graphs: Vec<Graph>,
    /// The visible part of the time axis.
    pub(super) span: Span,
    /// Whether the statistics are shown.
    pub(super) statistics: bool,
    /// A formula that is being written.
    pub(super) entry: Option<Entry>,
}

/// The visible part of the time axis, in seconds since the start of the source.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Span {
    /// Everything that is known.
    #[default]
    All,
    /// The last seconds before the viewed time.
    Last(f64),
    /// From a time to a time.
    Fixed(f64, f64),
}

impl Span {
    /// Whether it can be shown: a stored one may have been changed by hand.
    pub(super) fn is_valid(self) -> bool {
        match self {
            Self::All => true,
            Self::Last(s) => s.is_finite() && s > 0.0,
            Self::Fixed(from, to) => from.is_finite() && to.is_finite() && from < to,
        }
    }
}

/// Curves with common axes.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub(super) struct Graph {
    pub(super) curves: Vec<Curve>,
    /// The formula of the horizontal axis; `None` for time (or for the index of an array).
    pub(super) against: Option<String>,
    /// Fixed range of the horizontal axis, if it is not time.
    pub(super) across: Option<(f64, f64)>,
    /// Fixed ranges of the left and the right axis; `None` to fit the visible values.
    pub(super) ranges: [Option<(f64, f64)>; 2],
}

/// A curve.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub(super) struct Curve {
    /// The formula: a field, or functions of fields.
    pub(super) formula: String,
    /// The run that it is of.
    pub(super) run: RunChoice,
    /// Whether its axis is the right one.
    pub(super) right: bool,
}

impl Curve {
    pub(super) fn new(formula: impl Into<String>) -> Self {
        Self { formula: formula.into(), ..Self::default() }
    }
}

impl Saved {
    /// The curve that the open line changes, by graph and index: the one with the formula that it had then, also where
    /// curves before it came or went. `None` for a new one, and if it is gone.
    pub(super) fn edited(&self) -> Option<(usize, usize)> {
        let entry = self.entry.as_ref()?;
        let is_it = |&(graph, curve): &(usize, usize)| {
            let curve = self.graphs.get(graph).and_then(|graph| graph.curves.get(curve));
            curve.is_some_and(|curve| curve.formula == entry.was)
        };
        let graphs = self.graphs.iter().enumerate();
        let all = graphs.flat_map(|(graph, of)| (0..of.curves.len()).map(move |curve| (graph, curve)));
        std::iter::once(entry.of?).chain(all).find(is_it)
    }
}
