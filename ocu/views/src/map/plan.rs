//! Painting of what a planner and a follower considered: the chosen and the best rejected path, and the arcs with their
//! scores.

use super::labels::Labels;
use super::layers::{Kind, Layer};
use crate::canvas::Viewport;
use crate::clip;
use crate::view::{Hover, TopicKey};
use egui::{Color32, Painter, Pos2, Rect, Shape, Stroke, Vec2};
use ocu_ui::{Tokens, palette};
use rcs_geom::{DVec3, Pose};
use rcs_msg::rcs::scored_arc::Motion;
use rcs_msg::rcs::{ArcChoice, Plan, PlanCandidate, ScoredArc};

/// Distance between the points of an arc, m, and the most points.
const STEP_M: f64 = 0.1;
const MOST_POINTS: f64 = 200.0;
/// Distance from an arc at which the pointer means it, screen points.
const NEAR: f32 = 5.0;

/// Where a layer is painted.
#[derive(Clone, Copy)]
pub(super) struct At {
    pub(super) map_from_layer: Pose,
    pub(super) viewport: Viewport,
    pub(super) canvas: Rect,
}

impl At {
    pub(super) fn line(&self, points: impl Iterator<Item = [f64; 2]>) -> Vec<Vec<Pos2>> {
        let on_map = points.map(|[x, y]| {
            let p = self.map_from_layer * DVec3::new(x, y, 0.0);
            [p.x, p.y]
        });
        clip::line(on_map, self.viewport, self.canvas)
    }

    pub(super) fn screen(&self, [x, y]: [f64; 2]) -> Pos2 {
        let p = self.map_from_layer * DVec3::new(x, y, 0.0);
        self.viewport.to_screen(self.canvas, [p.x, p.y])
    }
}

/// Places along the chosen path of a plan, in its own frame.
pub(super) fn chosen_places(plan: &Plan) -> Vec<DVec3> {
    let steps = plan.chosen.iter().flat_map(|path| &path.steps);
    steps.map(|step| DVec3::new(step.x_m.into(), step.y_m.into(), 0.0)).collect()
}

/// Paints both paths of a plan: the chosen one solid, the rejected one dashed, with what it would cost more. `color` is
/// that of the chosen one.
pub(super) fn paths(
    painter: &Painter,
    plan: &Plan,
    at: At,
    tokens: &Tokens,
    color: Color32,
    is_old: bool,
    labels: &mut Labels,
) {
    let warning = if is_old { tokens.stale } else { tokens.warning };
    let points = |path: &PlanCandidate| -> Vec<[f64; 2]> {
        path.steps.iter().map(|step| [f64::from(step.x_m), f64::from(step.y_m)]).collect()
    };
    let halo = Stroke::new(4.0, tokens.canvas().gamma_multiply(0.8));
    if let Some(rejected) = &plan.rejected {
        let points = points(rejected);
        let parts = at.line(points.iter().copied());
        painter.extend(parts.iter().map(|part| Shape::line(part.clone(), halo)));
        painter.extend(clip::dashed(&parts, Stroke::new(1.5, warning), warning));
        let more = plan.chosen.as_ref().map(|chosen| rejected.cost - chosen.cost);
        if let (Some(middle), Some(more)) = (points.get(points.len() / 2), more.filter(|v| v.is_finite())) {
            labels.add(at.screen(*middle), format!("rejected, cost {more:+.0}"), warning);
        }
    }
    if let Some(chosen) = &plan.chosen {
        let parts = at.line(points(chosen).into_iter());
        painter.extend(parts.iter().map(|part| Shape::line(part.clone(), halo)));
        painter.extend(parts.into_iter().map(|part| Shape::line(part, Stroke::new(2.0, color))));
    }
}

/// Points along an arc, from the vehicle to the end of its free part; none for a turn on the spot.
fn points(choice: &ArcChoice, arc: &ScoredArc) -> Vec<[f64; 2]> {
    let start = choice.start.as_ref().and_then(|start| crate::pose::from_message(Some(start)).ok());
    let Some(start) = start else { return Vec::new() };
    let sign = match arc.motion() {
        Motion::Forward => 1.0,
        Motion::Backward => -1.0,
        Motion::TurnLeft | Motion::TurnRight => return Vec::new(),
    };
    let (free_m, bend) = (f64::from(arc.free_m), f64::from(arc.curvature_per_m));
    if !(free_m.is_finite() && free_m > 0.0 && bend.is_finite()) {
        return Vec::new();
    }
    let steps = (free_m / STEP_M).ceil().min(MOST_POINTS);
    (0..=steps as u32)
        .map(|step| {
            let along = sign * free_m * f64::from(step) / steps;
            let turned = bend * along / 2.0;
            // The chord has the direction of the middle of the arc.
            let chord = if turned.abs() < 1e-6 { along } else { along * turned.sin() / turned };
            let p = start * DVec3::new(turned.cos() * chord, turned.sin() * chord, 0.0);
            [p.x, p.y]
        })
        .collect()
}

/// Paints the arcs: the better its score, the brighter an arc; those that may not be driven end where they are blocked.
/// Old ones are without colours.
pub(super) fn arcs(
    painter: &Painter,
    choice: &ArcChoice,
    at: At,
    tokens: &Tokens,
    meant: Option<usize>,
    is_old: bool,
) {
    let open = || choice.arcs.iter().filter(|arc| arc.open && arc.total.is_finite()).map(|arc| arc.total);
    let (best, worst) = (open().fold(f32::MAX, f32::min), open().fold(f32::MIN, f32::max));
    let paint = |index: usize, stroke: Stroke| {
        let points = points(choice, &choice.arcs[index]);
        let parts = at.line(points.iter().copied());
        painter.extend(parts.into_iter().map(|part| Shape::line(part, stroke)));
        points.last().map(|end| at.screen(*end))
    };
    let chosen = choice.chosen.map(|index| index as usize).filter(|index| *index < choice.arcs.len());
    // It was meant in the pass before, of which the message may have had more arcs.
    let meant = meant.filter(|index| *index < choice.arcs.len());
    for (index, arc) in choice.arcs.iter().enumerate() {
        if Some(index) == chosen || Some(index) == meant {
            continue;
        }
        if arc.open {
            let part = f64::from((worst - arc.total) / (worst - best).max(1e-6)).clamp(0.0, 1.0);
            paint(index, Stroke::new(1.0, if is_old { tokens.stale } else { palette::even(part) }));
        } else if let Some(end) = paint(index, Stroke::new(1.0, tokens.unknown)) {
            painter.circle_filled(end, 2.0, tokens.error);
        }
    }
    if let Some(index) = chosen {
        paint(index, Stroke::new(4.5, tokens.canvas()));
        paint(index, Stroke::new(2.5, if is_old { tokens.stale } else { tokens.strong }));
    }
    if let Some(index) = meant {
        paint(index, Stroke::new(4.0, tokens.canvas()));
        paint(index, Stroke::new(2.5, tokens.accent));
    }
    // Without a target, as where a mode backs up, there is no number; in some recordings it is the origin.
    let target = [choice.target_x_m, choice.target_y_m];
    let has_target = target.iter().all(|v| v.is_finite()) && target != [0.0; 2];
    if has_target && !choice.arcs.is_empty() {
        let (center, arm) = (at.screen(target), 5.0);
        let ink = if is_old { tokens.stale } else { tokens.strong };
        for way in [Vec2::new(arm, arm), Vec2::new(arm, -arm)] {
            painter.line_segment([center - way, center + way], Stroke::new(3.5, tokens.canvas()));
            painter.line_segment([center - way, center + way], Stroke::new(1.5, ink));
        }
    }
}

/// The arc under the pointer of a map, as a field of its topic.
pub(super) fn pointed(layer: &Layer<'_>, pointer: Pos2, at: At) -> Option<Hover> {
    let Kind::Arcs(choice) = layer.kind else { return None };
    let away = |index: usize| -> f32 {
        let points = points(choice, &choice.arcs[index]);
        // All arcs begin at the vehicle, where the pointer would mean all of them.
        let far = points.into_iter().skip(3).map(|point| at.screen(point).distance(pointer));
        far.fold(f32::INFINITY, f32::min)
    };
    let nearest = (0..choice.arcs.len()).map(|index| (index, away(index))).min_by(|a, b| a.1.total_cmp(&b.1));
    let (index, _) = nearest.filter(|(_, away)| *away <= NEAR)?;
    Some(Hover {
        topic: Some(TopicKey::of(layer.topic?)),
        field: Some(format!(".arcs[{index}]").into()),
        ..Hover::default()
    })
}

/// The arc of a layer that a view points at.
pub(super) fn meant(layer: &Layer<'_>, hover: &Hover) -> Option<usize> {
    let topic = layer.topic.filter(|topic| hover.topic.as_ref().is_some_and(|key| key.is(topic)));
    let index = hover.field.as_deref()?.strip_prefix(".arcs[")?.strip_suffix(']')?;
    topic.and(index.parse().ok())
}

#[cfg(test)]
mod tests {
    use super::*;
    use egui::Theme;
    use rcs_msg::foxglove;

    /// The shapes and the colours of lines that are painted for a choice of arcs.
    fn painted(choice: &ArcChoice, meant: Option<usize>, is_old: bool) -> String {
        let canvas = Rect::from_min_size(Pos2::ZERO, Vec2::splat(200.0));
        let viewport = Viewport::fit([-5.0; 2], [5.0; 2], canvas, 0.0, true);
        let at = At { map_from_layer: Pose::IDENTITY, viewport, canvas };
        let ctx = egui::Context::default();
        let output = ctx.run_ui(egui::RawInput::default(), |ui| {
            arcs(&ui.painter_at(canvas), choice, at, ocu_ui::tokens_of(Theme::Dark), meant, is_old);
        });
        let shapes = format!("{:?}", output.shapes);
        output.drop_without_applying_deltas();
        shapes
    }

    #[test]
    fn an_arc_that_the_choice_does_not_have_is_not_marked_and_an_old_choice_looks_old() {
        let position = Some(foxglove::Vector3 { x: 0.0, y: 0.0, z: 0.0 });
        let start = Some(foxglove::Pose { position, orientation: None });
        let arc = |curvature_per_m: f32| ScoredArc {
            motion: Motion::Forward.into(),
            curvature_per_m,
            free_m: 2.0,
            open: true,
            ..ScoredArc::default()
        };
        let choice =
            ArcChoice { start, arcs: vec![arc(0.0), arc(0.3)], chosen: Some(9), ..Default::default() };
        let plain = painted(&choice, None, false);
        assert_eq!(painted(&choice, Some(7), false), plain);
        assert_ne!(painted(&choice, Some(1), false), plain);
        assert_ne!(painted(&choice, None, true), plain);
    }

    #[test]
    fn a_target_is_shown_with_a_chosen_arc_and_without_and_an_old_one_looks_old() {
        let nothing = painted(&ArcChoice::default(), None, false);
        // Its arc has no length, so only a target could be painted.
        let arcs = vec![ScoredArc::default()];
        let back = ArcChoice { arcs, chosen: Some(0), ..ArcChoice::default() };
        assert_eq!(painted(&back, None, false), nothing, "a target at the origin");
        let ahead = ArcChoice { target_x_m: 2.0, ..back };
        let cross = painted(&ahead, None, false);
        assert_ne!(cross, nothing);
        assert_ne!(painted(&ahead, None, true), cross);
        let blocked = ArcChoice { chosen: None, ..ahead };
        assert_eq!(painted(&blocked, None, false), cross, "no arc is free");
        let unknown = ArcChoice { target_y_m: f64::NAN, ..blocked.clone() };
        let without_arcs = ArcChoice { arcs: Vec::new(), ..blocked };
        for choice in [unknown, without_arcs] {
            assert_eq!(painted(&choice, None, false), nothing, "{choice:?}");
        }
    }

    #[test]
    fn an_arc_begins_at_the_vehicle_and_keeps_its_curvature_and_its_length() {
        let position = Some(foxglove::Vector3 { x: 3.0, y: 1.0, z: 0.0 });
        let start = Some(foxglove::Pose { position, orientation: None });
        let choice = ArcChoice { start, ..ArcChoice::default() };
        for (curvature_per_m, motion) in [(0.5, Motion::Forward), (-0.5, Motion::Backward)] {
            let arc =
                ScoredArc { motion: motion.into(), curvature_per_m, free_m: 2.0, ..ScoredArc::default() };
            let points = points(&choice, &arc);
            assert_eq!(points[0], [3.0, 1.0]);
            // Circle of 2 m radius, whose centre is beside the vehicle.
            let center = [3.0, 1.0 + 1.0 / f64::from(curvature_per_m)];
            for point in &points {
                let radius = (point[0] - center[0]).hypot(point[1] - center[1]);
                assert!((radius - 2.0).abs() < 1e-6, "{radius}");
            }
            let length: f64 =
                points.windows(2).map(|ends| (ends[1][0] - ends[0][0]).hypot(ends[1][1] - ends[0][1])).sum();
            assert!((length - 2.0).abs() < 1e-3, "{length}");
            assert_eq!(points[5][0] > 3.0, motion == Motion::Forward);
        }
        assert!(points(&ArcChoice::default(), &ScoredArc { free_m: 2.0, ..ScoredArc::default() }).is_empty());
    }
}
