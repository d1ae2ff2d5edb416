//! What a graph draws: its curves with their values, and where it is.

use super::axis::GraphKind;
use super::paint::Clock;
use super::saved::Graph;
use super::{color_of, run_label};
use crate::series::{Shelf, Shown, array};
use egui::{Color32, Rect, Ui};
use rcs_formula::Over;
use rcs_runtime::source::Frame;

/// What a curve draws.
pub(super) struct DrawnCurve {
    pub(super) label: String,
    pub(super) color: Color32,
    pub(super) right: bool,
    pub(super) shown: Shown,
}

/// What a graph draws.
pub(super) struct Drawn {
    pub(super) kind: GraphKind,
    pub(super) curves: Vec<DrawnCurve>,
    /// The horizontal axis of [`GraphKind::Against`].
    pub(super) against: Option<(String, Shown)>,
}

impl Drawn {
    pub(super) fn new(ui: &Ui, frame: &Frame, shelf: &mut Shelf, graph: &Graph, color: &mut usize) -> Self {
        let mut curves = Vec::new();
        // What the values of each curve are over.
        let mut over = Vec::new();
        for curve in &graph.curves {
            let (ctx, run) = (ui.ctx(), curve.run);
            let mut shown = shelf.shown(ctx, frame, &curve.formula, run);
            let mut of = match shown.over {
                Over::Time => GraphKind::Time,
                Over::Frequency => GraphKind::Frequency,
            };
            if shown.points.is_empty()
                && let Ok(formula) = shelf.formula(&curve.formula)
                && let Some(found) = formula.as_field().and_then(|field| array(ctx, frame, field, run))
            {
                match found {
                    Ok(found) => (shown, of) = (found, GraphKind::Index),
                    // It may be no array, so that it does not displace curves over time.
                    Err(problem) if shown.problem.is_some() => shown.problem = Some(problem.into()),
                    Err(_) => {}
                }
            }
            over.push(of);
            let label = format!("{}{}", curve.formula, run_label(curve.run));
            curves.push(DrawnCurve { label, color: color_of(ui, *color), right: curve.right, shown });
            *color += 1;
        }
        let kind = if graph.against.is_some() {
            GraphKind::Against
        } else if over.contains(&GraphKind::Index) {
            GraphKind::Index
        } else if !over.is_empty() && over.iter().all(|of| *of == GraphKind::Frequency) {
            GraphKind::Frequency
        } else {
            GraphKind::Time
        };
        let fits = |of: GraphKind| of == kind || (of, kind) == (GraphKind::Time, GraphKind::Against);
        for (curve, of) in curves.iter_mut().zip(over).filter(|(_, of)| !fits(*of)) {
            let problem = match of {
                GraphKind::Frequency => "a spectrum is over frequency; give it a graph of its own",
                GraphKind::Index => "an array is over its index; give it a graph of its own",
                // Why it has no values is said already.
                _ if curve.shown.points.is_empty() => continue,
                _ => "it is over time, and the array beside it over its index; give it a graph of its own",
            };
            curve.shown = Shown { problem: Some(problem.into()), ..Shown::default() };
        }
        let run = graph.curves.first().map(|curve| curve.run).unwrap_or_default();
        let against =
            graph.against.as_ref().map(|text| (text.clone(), shelf.shown(ui.ctx(), frame, text, run)));
        Self { kind, curves, against }
    }

    pub(super) fn has_right_axis(&self) -> bool {
        self.curves.iter().any(|curve| curve.right && !curve.shown.are_states())
    }
}

/// Where a graph is.
pub(super) struct Place {
    pub(super) index: usize,
    pub(super) plot: Rect,
    /// Whether the horizontal axis has marks.
    pub(super) labelled: bool,
    /// The visible time, in seconds.
    pub(super) time: (f64, f64),
    pub(super) clock: Clock,
}
