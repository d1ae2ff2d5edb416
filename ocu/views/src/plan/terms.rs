//! The terms of costs and scores, with their names and colours.

use egui::{Color32, Ui};
use ocu_ui::tokens;
use rcs_msg::rcs::{PlanCandidate, PlanTerms, ScoredArc};

/// Reads a term of a plan.
pub(super) type OfPlan = fn(&PlanTerms) -> f32;

/// The terms of a plan's cost.
pub(super) const PLAN_TERMS: [(&str, OfPlan); 6] = [
    ("terrain", |terms| terms.terrain),
    ("clearance", |terms| terms.clearance),
    ("heading", |terms| terms.heading),
    ("relief", |terms| terms.relief),
    ("memory", |terms| terms.memory),
    ("previous", |terms| terms.previous),
];

/// Reads a term of an arc's score.
pub(super) type OfArc = fn(&ScoredArc) -> f32;

/// The terms of an arc's score.
pub(super) const ARC_TERMS: [(&str, OfArc); 6] = [
    ("goal", |arc| arc.goal),
    ("heading", |arc| arc.heading),
    ("cost", |arc| arc.cost),
    ("turn", |arc| arc.turn),
    ("change", |arc| arc.change),
    ("short", |arc| arc.short),
];

/// A term of a whole path.
pub(super) fn in_plan(path: &PlanCandidate, of: OfPlan) -> f64 {
    path.terms.as_ref().map_or(0.0, |terms| f64::from(of(terms)))
}

/// Colour of a term.
pub(super) fn color(ui: &Ui, index: usize) -> Color32 {
    tokens(ui).series(index)
}
