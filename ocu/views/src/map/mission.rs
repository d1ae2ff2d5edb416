//! Missions on a map: what a vehicle obeys, and a draft of the operator: goals, and zones that it must not enter.

use super::labels::Labels;
use super::layers::Kind;
use super::plan::At;
use super::{Map, layers};
use crate::clip;
use crate::operator::Inputs;
use crate::view::ViewContext;
use egui::{Align2, Color32, FontId, Painter, Pos2, Rect, Response, RichText, Shape, Stroke, Ui, Vec2};
use ocu_ui::{Tokens, icons, legend, tokens};
use rcs_geom::{DVec3, Pose};
use rcs_msg::AnyMessage;
use rcs_msg::rcs::{Mission, PlanePoint, PlanePolygon};
use rcs_runtime::source::{Control, Frame};

/// Distance from the first corner at which a click closes a zone, screen points.
const NEAR: f32 = 10.0;
/// Distance between the lines of a hatching, screen points.
const HATCH: f32 = 9.0;
/// Distance within which two goals are the same one, m.
const SAME_GOAL_M: f64 = 0.01;

/// What a click on the map adds to the draft.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) enum Adds {
    /// A goal.
    #[default]
    Goal,
    /// A corner of a zone.
    Zone,
}

/// A mission that has not been sent, in the frame of the map.
#[derive(Clone, Debug, Default)]
pub(super) struct Draft {
    pub(super) adds: Adds,
    goals: Vec<[f64; 2]>,
    /// The goals with which the draft began, or which were sent last: the vehicle keeps its goals while these are the
    /// same.
    begun: Vec<[f64; 2]>,
    /// The mission to which those goals belong; `None` while the vehicle states none.
    stated: Option<Stated>,
    /// Whether the goals replace those of the vehicle even if they are the same.
    states_goals: bool,
    keep_out: Vec<Vec<[f64; 2]>>,
    /// Corners of the zone that is being drawn.
    corners: Vec<[f64; 2]>,
    /// Whether anything was changed since the draft began or was sent.
    changed: bool,
}

/// The goals of a mission in its own frame, and how many of them have been reached.
#[derive(Clone, Debug)]
struct Stated {
    frame_id: String,
    goals: Vec<[f64; 2]>,
    reached: usize,
}

impl Stated {
    fn of(mission: &Mission) -> Self {
        let goals = mission.goals.iter().map(|goal| [goal.x_m, goal.y_m]).collect();
        Self { frame_id: mission.frame_id.clone(), goals, reached: mission.reached as usize }
    }

    /// Whether a mission has the same goals.
    fn is_of(&self, mission: &Mission) -> bool {
        let is_same = |(a, b): (&[f64; 2], &PlanePoint)| (a[0] - b.x_m).hypot(a[1] - b.y_m) <= SAME_GOAL_M;
        self.frame_id == mission.frame_id
            && self.goals.len() == mission.goals.len()
            && self.goals.iter().zip(&mission.goals).all(is_same)
    }
}

/// Adds a corner to a polygon that is being drawn. Returns the polygon if the corner closes it: if it is the first one
/// again, within a distance.
pub(super) fn corner(corners: &mut Vec<[f64; 2]>, at: [f64; 2], reach_m: f64) -> Option<Vec<[f64; 2]>> {
    let closes = corners.first().is_some_and(|first| (first[0] - at[0]).hypot(first[1] - at[1]) <= reach_m);
    if !closes {
        corners.push(at);
    }
    (closes && corners.len() >= 3).then(|| std::mem::take(corners))
}

impl Draft {
    /// The draft that begins with the goals that the vehicle has not reached, and the zones that the operator has sent.
    /// Zones that cannot be placed on the map must not be lost: the error says why.
    fn of(frame: &Frame, map: &str, buffer: &str) -> Result<Self, String> {
        let mut draft = Self { keep_out: sent_zones(frame, map, buffer)?, ..Self::default() };
        if let Some((mission, map_from_mission)) = obeyed(frame, map) {
            let left = mission.goals.iter().skip(mission.reached as usize);
            draft.goals = left.map(place(map_from_mission)).collect();
            draft.begun.clone_from(&draft.goals);
            draft.stated = Some(Stated::of(mission));
        }
        Ok(draft)
    }

    /// Leaves out the goals that the vehicle has reached since the draft began or was sent. `mission` is the one that the
    /// vehicle obeys.
    fn follow(&mut self, mission: &Mission) {
        let Some(stated) = self.stated.as_mut().filter(|stated| stated.is_of(mission)) else { return };
        let more = (mission.reached as usize).saturating_sub(stated.reached);
        stated.reached += more;
        let count = more.min(self.begun.len());
        let reached: Vec<_> = self.begun.drain(..count).collect();
        let same = self.goals.iter().zip(&reached).take_while(|(goal, reached)| goal == reached).count();
        self.goals.drain(..same);
    }

    /// The draft was sent as this mission.
    fn sent(&mut self, mission: &Mission) {
        self.changed = false;
        if !mission.keeps_goals {
            self.begun.clone_from(&self.goals);
            self.stated = Some(Stated::of(mission));
        }
    }

    /// Whether the vehicle keeps the goals that it has: the draft does not change them.
    fn keeps_goals(&self) -> bool {
        !self.states_goals && self.goals == self.begun
    }

    fn click(&mut self, at: [f64; 2], reach_m: f64) {
        self.changed = true;
        if self.adds == Adds::Goal {
            return self.goals.push(at);
        }
        self.keep_out.extend(corner(&mut self.corners, at, reach_m));
    }

    /// Takes the last thing back; whether there was one.
    fn undo(&mut self) -> bool {
        let zones = self.adds == Adds::Zone;
        let a_goal = !zones && self.corners.is_empty() && self.goals.pop().is_some();
        let done = a_goal || self.corners.pop().is_some() || (zones && self.keep_out.pop().is_some());
        self.changed |= done;
        done
    }

    /// Deletes all goals and zones.
    fn clear(&mut self) {
        self.goals.clear();
        self.keep_out.clear();
        self.corners.clear();
        self.changed = true;
    }

    fn message(&self, frame_id: &str, frame_from_map: &Pose) -> Mission {
        let point = |at: &[f64; 2]| {
            let p = *frame_from_map * DVec3::new(at[0], at[1], 0.0);
            PlanePoint { x_m: p.x, y_m: p.y }
        };
        let zone = |corners: &Vec<[f64; 2]>| PlanePolygon { points: corners.iter().map(point).collect() };
        Mission {
            timestamp: None,
            frame_id: frame_id.to_owned(),
            goals: self.goals.iter().map(point).collect(),
            area: None,
            keep_out: self.keep_out.iter().map(zone).collect(),
            reached: 0,
            keeps_goals: self.keeps_goals(),
        }
    }

    fn summary(&self) -> String {
        let count = |count: usize, what: &str| format!("{count} {what}{}", if count == 1 { "" } else { "s" });
        format!("{}, {}", count(self.goals.len(), "goal"), count(self.keep_out.len(), "keep-out zone"))
    }
}

/// Places a point of a frame on the map.
fn place(map_from_frame: Pose) -> impl Fn(&PlanePoint) -> [f64; 2] {
    move |at| {
        let p = map_from_frame * DVec3::new(at.x_m, at.y_m, 0.0);
        [p.x, p.y]
    }
}

/// The zones that the operator has sent, on the map; the error says why they cannot be placed.
fn sent_zones(frame: &Frame, map: &str, buffer: &str) -> Result<Vec<Vec<[f64; 2]>>, String> {
    let Some(sent) = frame.topic(buffer).and_then(|topic| topic.get::<Mission>()) else {
        return Ok(Vec::new());
    };
    let map_from_sent = layers::map_from_frame(frame, map, &sent.frame_id, frame.now)?;
    let zone = |zone: &PlanePolygon| zone.points.iter().map(place(map_from_sent)).collect();
    Ok(sent.keep_out.iter().map(zone).collect())
}

/// Why no mission can be drawn on a map; `None` if one can be drawn.
pub(super) fn refusal(frame: &Frame, map: &str, buffer: &str) -> Option<String> {
    sent_zones(frame, map, buffer).err()
}

/// The mission that a vehicle obeys, and its pose in the frame of the map. A recorded mission counts where the run has
/// none.
fn obeyed<'a>(frame: &'a Frame, map: &str) -> Option<(&'a Mission, Pose)> {
    let mut layers = layers::layers(frame);
    layers.sort_by_key(layers::Layer::is_recorded);
    layers.iter().find_map(|layer| match layer.kind {
        Kind::Mission(mission) => Some((mission, layers::map_from_layer(frame, map, layer).ok()?)),
        _ => None,
    })
}

impl Map {
    /// Opens a draft, unless what was sent cannot be placed on the map, or throws it away.
    pub(super) fn toggle_draft(&mut self, frame: &Frame, map: &str, buffer: &str) {
        self.draft = match self.draft {
            Some(_) => None,
            None => Draft::of(frame, map, buffer).ok(),
        };
        self.measuring = false;
        self.example = None;
    }

    /// Clicks of the operator who draws, and the menu of the map.
    pub(super) fn draw_mission(
        &mut self,
        ui: &mut Ui,
        cx: &mut ViewContext<'_>,
        map: &str,
        response: &Response,
        at: At,
        labels: &mut Labels,
    ) {
        let Some(buffer) = Inputs::of(cx.frame).mission else {
            self.draft = None;
            return;
        };
        let on_map = |pos: Pos2| at.viewport.to_plane(at.canvas, pos);
        if let Some(draft) = &mut self.draft {
            if let Some((mission, _)) = obeyed(cx.frame, map) {
                draft.follow(mission);
            }
            if let Some(pos) = response.interact_pointer_pos().filter(|_| response.clicked()) {
                draft.click(on_map(pos), f64::from(NEAR) / at.viewport.scale);
            }
            let message = draft.message(map, &Pose::IDENTITY);
            paint(&ui.painter_at(at.canvas), &message, at, tokens(ui), true, labels);
            paint_corners(&ui.painter_at(at.canvas), &draft.corners, at, tokens(ui));
        }
        if response.secondary_clicked() {
            self.menu_at = response.interact_pointer_pos().map(on_map);
        }
        let mut drive_to = None;
        let mut edit = false;
        response.context_menu(|ui| {
            let known = self.draft.clone().map_or_else(|| Draft::of(cx.frame, map, &buffer), Ok);
            let drive = format!("{}  Drive here", icons::ICON_FLAG.codepoint);
            let (can, why) = (known.is_ok(), known.as_ref().err().cloned().unwrap_or_default());
            let button = ui.add_enabled(can, egui::Button::new(drive));
            let button = button.on_hover_text("Replaces the goals; keep-out zones stay");
            if button.on_disabled_hover_text(&why).clicked() {
                drive_to = self.menu_at.zip(known.ok());
                ui.close();
            }
            let text = format!("{}  Edit the mission", icons::ICON_EDIT.codepoint);
            if self.draft.is_none() {
                let button = ui.add_enabled(can, egui::Button::new(text));
                if button.on_disabled_hover_text(&why).clicked() {
                    edit = true;
                    ui.close();
                }
            }
        });
        if edit {
            self.toggle_draft(cx.frame, map, &buffer);
        }
        if let Some((goal, known)) = drive_to {
            self.draft = None;
            send(cx, map, &buffer, &Draft { goals: vec![goal], states_goals: true, ..known });
        }
        if self.draft.is_some() {
            self.mission_plate(ui, cx, map, &buffer, at);
        }
    }

    /// The panel of the draft.
    fn mission_plate(&mut self, ui: &mut Ui, cx: &mut ViewContext<'_>, map: &str, buffer: &str, at: At) {
        let Some(draft) = &mut self.draft else { return };
        let tokens = tokens(ui);
        let mut discard = false;
        // Below the scale bar.
        let below = Rect::from_min_max(at.canvas.min + Vec2::new(0.0, 40.0), at.canvas.max);
        legend::solid_plate(ui, below, Align2::CENTER_TOP, |ui| {
            ui.spacing_mut().item_spacing.y = 4.0;
            ui.horizontal(|ui| {
                ui.selectable_value(&mut draft.adds, Adds::Goal, "Goals")
                    .on_hover_text("Each click adds a goal; the vehicle drives to them in this order");
                ui.selectable_value(&mut draft.adds, Adds::Zone, "Keep-out zones")
                    .on_hover_text("Each click adds a corner; a click on the first one closes the zone");
                ui.separator();
                if ui.button(icons::ICON_UNDO.rich_text()).on_hover_text("Take the last click back").clicked()
                {
                    draft.undo();
                }
                if ui
                    .button(icons::ICON_DELETE.rich_text())
                    .on_hover_text("Delete all goals and zones")
                    .clicked()
                {
                    draft.clear();
                }
                ui.separator();
                let open = !draft.corners.is_empty();
                let send_it = format!("{}  Send", icons::ICON_SEND.codepoint);
                let button = ui.add_enabled(draft.changed && !open, egui::Button::new(send_it));
                if button.on_disabled_hover_text(why_not(draft)).clicked() {
                    let sent = send(cx, map, buffer, draft);
                    draft.sent(&sent);
                }
                discard = ui.button("Close").on_hover_text("Without sending").clicked();
            });
            let (text, color) = match (draft.changed, draft.corners.len()) {
                (_, 1..) => ("click on the first corner to close the zone", tokens.warning),
                (true, 0) => ("not sent", tokens.warning),
                (false, 0) => ("as sent", tokens.weak),
            };
            ui.label(RichText::new(format!("{}: {text}", draft.summary())).small().color(color));
        });
        if discard {
            self.draft = None;
        }
    }
}

fn why_not(draft: &Draft) -> &'static str {
    if draft.corners.is_empty() { "Nothing has changed" } else { "The zone is not closed" }
}

/// Sends a mission in the frame in which the vehicle states its own, if it states one. Returns what was sent.
fn send(cx: &mut ViewContext<'_>, map: &str, buffer: &str, draft: &Draft) -> Mission {
    let own =
        obeyed(cx.frame, map).map(|(mission, map_from_own)| (&*mission.frame_id, map_from_own.inverse()));
    let (frame_id, frame_from_map) = own.unwrap_or((map, Pose::IDENTITY));
    let timestamp = Some(cx.frame.now.to_proto());
    let mission = Mission { timestamp, ..draft.message(frame_id, &frame_from_map) };
    let message = AnyMessage::new(mission.clone());
    cx.controls.push(Control::Write { buffer: buffer.to_owned(), message });
    mission
}

/// Paints a mission: the area dashed, the zones hatched, the goals with their numbers, those reached weak.
pub(super) fn paint(
    painter: &Painter,
    mission: &Mission,
    at: At,
    tokens: &Tokens,
    is_draft: bool,
    labels: &mut Labels,
) {
    let screen = |zone: &PlanePolygon| -> Vec<Pos2> {
        zone.points.iter().map(|point| at.screen([point.x_m, point.y_m])).collect()
    };
    let around = |zone: &PlanePolygon| -> Vec<Vec<Pos2>> {
        at.line(zone.points.iter().chain(zone.points.first()).map(|point| [point.x_m, point.y_m]))
    };
    if let Some(area) = &mission.area {
        let stroke = Stroke::new(1.5, tokens.weak);
        painter.extend(clip::dashed(&around(area), stroke, tokens.weak));
    }
    let red = if is_draft { tokens.warning } else { tokens.error };
    for zone in &mission.keep_out {
        hatch(painter, &screen(zone), red.gamma_multiply(0.6));
        let halo = Stroke::new(4.0, tokens.canvas().gamma_multiply(0.8));
        painter.extend(around(zone).into_iter().map(|part| Shape::line(part, halo)));
        painter.extend(around(zone).into_iter().map(|part| Shape::line(part, Stroke::new(1.5, red))));
    }
    for (index, goal) in mission.goals.iter().enumerate() {
        let center = at.screen([goal.x_m, goal.y_m]);
        let (fill, ink) = match (is_draft, index < mission.reached as usize) {
            (true, _) => (tokens.warning, tokens.canvas()),
            (false, true) => (tokens.surface[3], tokens.weak),
            (false, false) => (tokens.ok, tokens.canvas()),
        };
        labels.keep_free(Rect::from_center_size(center, Vec2::splat(18.0)));
        painter.circle(center, 9.0, fill, Stroke::new(1.0, tokens.canvas()));
        let number = (index + 1).to_string();
        painter.text(center, Align2::CENTER_CENTER, number, FontId::proportional(11.0), ink);
    }
}

/// The corners of a zone that is not closed.
pub(super) fn paint_corners(painter: &Painter, corners: &[[f64; 2]], at: At, tokens: &Tokens) {
    let points: Vec<Pos2> = corners.iter().map(|corner| at.viewport.to_screen(at.canvas, *corner)).collect();
    painter.add(Shape::line(points.clone(), Stroke::new(1.5, tokens.warning)));
    for (index, point) in points.into_iter().enumerate() {
        let radius = if index == 0 { 5.0 } else { 3.0 };
        painter.circle(point, radius, tokens.warning, Stroke::new(1.0, tokens.canvas()));
    }
}

/// Diagonal lines inside of a polygon, which need not be convex.
pub(super) fn hatch(painter: &Painter, corners: &[Pos2], color: Color32) {
    let clip = painter.clip_rect();
    // Along a line x + y = s; where it crosses an edge, it enters or leaves.
    let sum = |at: &Pos2| at.x + at.y;
    let low = corners.iter().map(sum).fold(f32::INFINITY, f32::min).max(clip.left() + clip.top());
    let high = corners.iter().map(sum).fold(f32::NEG_INFINITY, f32::max).min(clip.right() + clip.bottom());
    if corners.len() < 3 || !(low.is_finite() && high.is_finite()) {
        return;
    }
    let mut s = (low / HATCH).ceil() * HATCH;
    while s < high {
        let edges = corners.iter().zip(corners.iter().cycle().skip(1));
        let mut crossings: Vec<f32> = edges
            .filter(|(a, b)| (sum(a) > s) != (sum(b) > s))
            .map(|(a, b)| a.x + (b.x - a.x) * (s - sum(a)) / (sum(b) - sum(a)))
            .collect();
        crossings.sort_by(f32::total_cmp);
        for pair in crossings.chunks_exact(2) {
            let ends = [pair[0], pair[1]].map(|x| Pos2::new(x, s - x));
            painter.line_segment(ends, Stroke::new(1.0, color));
        }
        s += HATCH;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clicks_add_goals_and_corners_and_the_first_corner_closes_the_zone() {
        let mut draft = Draft::default();
        draft.click([1.0, 2.0], 0.5);
        draft.adds = Adds::Zone;
        for corner in [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [9.0, 9.0]] {
            draft.click(corner, 0.5);
        }
        assert!(draft.undo());
        draft.click([0.2, 0.2], 0.5);
        assert_eq!((draft.summary().as_str(), draft.corners.len()), ("1 goal, 1 keep-out zone", 0));
        let pose = Pose::from_xy_yaw(10.0, 0.0, 0.0);
        let message = draft.message("global", &pose);
        assert_eq!((message.goals[0].x_m, message.keep_out[0].points.len()), (11.0, 3));
        assert!(draft.undo() && !draft.undo(), "goals stay while zones are drawn");
    }

    /// A draft of what a vehicle has left of a mission.
    fn draft_of(mission: &Mission) -> Draft {
        let left = mission.goals.iter().skip(mission.reached as usize);
        let goals: Vec<_> = left.map(place(Pose::IDENTITY)).collect();
        Draft { begun: goals.clone(), goals, stated: Some(Stated::of(mission)), ..Draft::default() }
    }

    fn mission(goals: &[[f64; 2]], reached: u32) -> Mission {
        let goals = goals.iter().map(|&[x_m, y_m]| PlanePoint { x_m, y_m }).collect();
        Mission { frame_id: "local".to_owned(), goals, reached, ..Mission::default() }
    }

    fn sent(draft: &mut Draft) -> Mission {
        let sent = draft.message("local", &Pose::IDENTITY);
        draft.sent(&sent);
        sent
    }

    #[test]
    fn goals_that_are_as_they_were_leave_the_vehicle_its_own() {
        let mut none = Draft::default();
        none.click([1.0, 2.0], 0.5);
        assert!(!none.keeps_goals() && none.undo() && none.keeps_goals(), "a goal was taken back");
        none.clear();
        assert!(sent(&mut none).keeps_goals, "there was nothing to delete");
        let mut draft = draft_of(&mission(&[[1.0, 0.0]], 0));
        draft.clear();
        assert!(!sent(&mut draft).keeps_goals, "the goal was deleted");
        draft.click([4.0, 4.0], 0.5);
        assert!(!sent(&mut draft).keeps_goals && sent(&mut draft).keeps_goals);
        draft.states_goals = true;
        assert!(!sent(&mut draft).keeps_goals);
    }

    #[test]
    fn a_goal_that_was_reached_is_not_sent_again() {
        let (a, b, c) = ([1.0, 0.0], [2.0, 0.0], [3.0, 0.0]);
        let old = mission(&[[8.0, 8.0], [9.0, 9.0]], 0);
        let mut draft = draft_of(&old);
        draft.clear();
        draft.click(a, 0.5);
        draft.click(b, 0.5);
        sent(&mut draft);
        draft.follow(&Mission { reached: 1, ..old });
        assert_eq!(draft.goals, [a, b], "a goal of the mission before was reached");
        draft.follow(&mission(&[[1.001, 0.0], b], 1));
        assert!(draft.goals == [b] && draft.keeps_goals());
        draft.follow(&mission(&[a, b], 1));
        draft.click(c, 0.5);
        assert_eq!(draft.goals, [b, c], "it is left out once");
        assert_eq!(sent(&mut draft).goals.len(), 2);
        // What the operator has drawn in place of the goals stays.
        draft.clear();
        draft.click(c, 0.5);
        draft.follow(&mission(&[b, c], 1));
        assert_eq!((draft.goals.as_slice(), draft.begun.as_slice()), (&[c][..], &[c][..]));
    }
}
