//! Goals on a map: a flag, or an arrow at the edge of the canvas where the goal lies outside of it.
//!
//! Several topics may hold one goal: it gets one mark. Where several goals are marked, each says its topic.

use super::labels::Labels;
use super::layers::{self, Kind, Layer};
use crate::canvas::Viewport;
use crate::clip::is_place;
use egui::{FontId, Pos2, Rect, Shape, Stroke, Ui, Vec2};
use ocu_ui::{format, tokens};
use rcs_geom::Pose;
use rcs_msg::foxglove::PoseInFrame;
use rcs_runtime::source::Frame;

/// Distance up to which two goals may be one, m: what the positions of two frames differ by.
const SAME_GOAL_M: f64 = 5.0;
/// Distance on the canvas above which two such goals are seen apart, screen points.
const APART: f32 = 24.0;
/// Distance from the edge of the canvas within which a flag does not fit.
const EDGE: f32 = 4.0;

/// A goal.
pub(super) struct Goal<'a> {
    /// Name of its layer, which is that of its topic.
    name: &'a str,
    /// Its position in the map's frame, m.
    position_m: [f64; 2],
}

impl<'a> Goal<'a> {
    /// The goal of a message; `None` if its position is not plausible.
    fn new(name: &'a str, goal: &PoseInFrame, map_from_goal: &Pose) -> Option<Self> {
        let pose = crate::pose::from_message(goal.pose.as_ref()).ok()?;
        let p = *map_from_goal * pose.translation;
        is_place(&p.to_array()).then_some(Self { name, position_m: [p.x, p.y] })
    }

    /// What the mark says: the topic if it is one of several, and the distance if the vehicle is known.
    fn text(&self, is_one_of_several: bool, vehicle: Option<[f64; 3]>) -> String {
        let name = if is_one_of_several { self.name.trim_start_matches('/') } else { "goal" };
        let [east_m, north_m] = self.position_m;
        let distance = vehicle.map(|[x, y, _]| format::metres((east_m - x).hypot(north_m - y), 0));
        format!("{name} {}", distance.unwrap_or_default()).trim_end().to_owned()
    }
}

/// The goals among the layers that are shown.
pub(super) fn of<'a>(frame: &Frame, map: &str, shown: &[&'a Layer<'_>]) -> Vec<Goal<'a>> {
    let goals = shown.iter().filter_map(|layer| {
        let Kind::Goal(goal) = layer.kind else { return None };
        let map_from_goal = layers::map_from_layer(frame, map, layer).ok()?;
        Goal::new(&layer.name, goal, &map_from_goal)
    });
    goals.collect()
}

/// Marks goals, with their distance from the vehicle if that is known.
pub(super) fn paint(
    ui: &Ui,
    goals: &[Goal<'_>],
    vehicle: Option<[f64; 3]>,
    viewport: Viewport,
    canvas: Rect,
    labels: &mut Labels,
) {
    let marked = distinct(goals, viewport, canvas);
    let are_several = marked.len() > 1;
    for (goal, at) in marked {
        if is_inside(canvas, at) {
            flag(ui, canvas, at, labels);
            if are_several {
                labels.add(at, goal.text(true, None), tokens(ui).strong);
            }
        } else {
            arrow(ui, canvas, at, goal.text(are_several, vehicle), labels);
        }
    }
}

fn is_inside(canvas: Rect, at: Pos2) -> bool {
    canvas.shrink(EDGE).contains(at)
}

/// The goals that are marked, and where they are on the screen: of those that nobody could tell apart the first one.
fn distinct<'g, 'a>(goals: &'g [Goal<'a>], viewport: Viewport, canvas: Rect) -> Vec<(&'g Goal<'a>, Pos2)> {
    let mut marked: Vec<(&Goal<'_>, Pos2)> = Vec::new();
    for goal in goals {
        let at = viewport.to_screen(canvas, goal.position_m);
        let is_same = |(other, other_at): &(&Goal<'_>, Pos2)| {
            let [a, b] = [goal.position_m, other.position_m];
            let are_outside = !is_inside(canvas, at) && !is_inside(canvas, *other_at);
            (a[0] - b[0]).hypot(a[1] - b[1]) <= SAME_GOAL_M
                && (are_outside || at.distance(*other_at) <= APART)
        };
        if !marked.iter().any(is_same) {
            marked.push((goal, at));
        }
    }
    marked
}

/// A flag at a goal on the canvas.
fn flag(ui: &Ui, canvas: Rect, at: Pos2, labels: &mut Labels) {
    let (tokens, painter) = (tokens(ui), ui.painter_at(canvas));
    let (ink, edge) = (tokens.strong, Stroke::new(3.0, tokens.canvas()));
    let top = at - Vec2::new(0.0, 18.0);
    painter.line_segment([at, top], edge);
    painter.line_segment([at, top], Stroke::new(1.5, ink));
    let flag = vec![top, top + Vec2::new(11.0, 4.0), top + Vec2::new(0.0, 8.0)];
    painter.add(Shape::convex_polygon(flag, tokens.ok, Stroke::new(1.0, tokens.canvas())));
    painter.circle(at, 3.0, ink, Stroke::new(1.0, tokens.canvas()));
    labels.keep_free(Rect::from_min_max(top - Vec2::new(3.0, 2.0), at + Vec2::new(13.0, 4.0)));
}

/// An arrow at the edge of the canvas, towards a goal outside of it.
fn arrow(ui: &Ui, canvas: Rect, at: Pos2, text: String, labels: &mut Labels) {
    let (tokens, painter) = (tokens(ui), ui.painter_at(canvas));
    let inside = canvas.shrink(18.0);
    let (center, way) = (canvas.center(), (at - canvas.center()).normalized());
    // To the edge along the line from the centre.
    let reach = |way: f32, room: f32| if way.abs() < 1e-6 { f32::INFINITY } else { room / way.abs() };
    let length = reach(way.x, inside.width() / 2.0).min(reach(way.y, inside.height() / 2.0));
    let tip = center + way * length;
    let left = way.rot90() * 5.0;
    let head = vec![tip + way * 7.0, tip + left - way * 3.0, tip - left - way * 3.0];
    painter.add(Shape::convex_polygon(head, tokens.ok, Stroke::new(1.0, tokens.canvas())));
    labels.keep_free(Rect::from_center_size(tip, Vec2::splat(14.0)));
    labels.add_towards(tip, -way, text, FontId::proportional(11.0), tokens.strong);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::Map;
    use crate::map::robot::Robot;
    use crate::samples;
    use rcs_msg::foxglove;
    use rcs_runtime::source::{RunTag, Track};
    use std::sync::Arc;

    /// The texts of the marks of goals on a map of 20 m by 20 m around a vehicle.
    fn marks(goals: &[(&'static str, [f64; 2])]) -> Vec<String> {
        let canvas = Rect::from_min_size(Pos2::ZERO, Vec2::splat(400.0));
        let viewport = Viewport::fit([-10.0; 2], [10.0; 2], canvas, 0.0, true);
        let goals: Vec<Goal<'_>> =
            goals.iter().map(|&(name, position_m)| Goal { name, position_m }).collect();
        let marked = distinct(&goals, viewport, canvas);
        let are_several = marked.len() > 1;
        marked.iter().map(|(goal, _)| goal.text(are_several, Some([0.0; 3]))).collect()
    }

    #[test]
    fn goals_at_nearly_one_place_get_one_mark() {
        assert_eq!(marks(&[("/vehicle/goal", [67.0, 0.0]), ("/planner/goal", [68.0, 1.0])]), ["goal 67 m"]);
        assert_eq!(marks(&[("/vehicle/goal", [5.0, 0.0]), ("/planner/goal", [5.5, 0.0])]), ["goal 5 m"]);
    }

    #[test]
    fn goals_that_are_seen_apart_say_their_topic() {
        let far = marks(&[("/vehicle/goal", [67.0, 0.0]), ("/planner/goal", [0.0, 40.0])]);
        assert_eq!(far, ["vehicle/goal 67 m", "planner/goal 40 m"]);
        let near = marks(&[("/vehicle/goal", [5.0, 0.0]), ("/planner/goal", [8.0, 0.0])]);
        assert_eq!(near, ["vehicle/goal 5 m", "planner/goal 8 m"], "60 points apart");
    }

    #[test]
    fn the_distance_of_a_goal_is_that_from_the_vehicle_of_the_run() {
        let vehicle_at = |x: f64| {
            let position = Some(foxglove::Vector3 { x, y: 0.0, z: 0.0 });
            let orientation = Some(foxglove::Quaternion { w: 1.0, ..Default::default() });
            let pose = Some(foxglove::Pose { position, orientation });
            let pose = PoseInFrame { frame_id: "local".into(), pose, ..PoseInFrame::default() };
            samples::topic("/localization/local", 50.0, 0.01, pose)
        };
        let mut recorded = vehicle_at(10.0);
        recorded.run = RunTag::Recorded;
        let mut frame = samples::driving();
        let goal = frame.topic("/vehicle/goal").unwrap().clone();
        let track = frame.track("/localization/local", RunTag::FIRST).unwrap().clone();
        frame.topics = Arc::new([recorded, vehicle_at(2.0), goal]);
        frame.tracks = Arc::new([Track { run: RunTag::Recorded, ..track.clone() }, track]);
        let (mut map, layers) = (Map::default(), layers::layers(&frame));
        map.tracks.update(&frame, "local", &layers, true);
        let shown: Vec<&Layer<'_>> = layers.iter().collect();
        let (_, vehicle) = Robot::beside(&frame, "local", &map.places(&frame, &shown));
        assert_eq!(vehicle.map(|[x, y, _]| [x, y]), Some([2.0, 0.0]));
        // The goal is at (60, 25).
        let goals = of(&frame, "local", &shown);
        assert_eq!(goals.first().map(|goal| goal.text(false, vehicle)).as_deref(), Some("goal 63 m"));
    }

    #[test]
    fn a_goal_without_a_vehicle_has_no_distance() {
        assert_eq!(Goal { name: "/goal", position_m: [1.0, 2.0] }.text(false, None), "goal");
    }
}
