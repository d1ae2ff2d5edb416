//! Missions on a map: what a vehicle obeys, and the draft of the operator, which is drawn with the pointer.

use super::draft::{Adds, Bounds, Draft, GOAL_RADIUS, Handle, place};
use super::labels::Labels;
use super::outline::is_same_outline;
use super::plan::At;
use super::{Map, layers};
use crate::canvas::Viewport;
use crate::clip;
use crate::operator::Inputs;
use crate::view::ViewContext;
use egui::{
    Align2, Color32, CursorIcon, FontId, Painter, PointerButton, Pos2, Rect, Response, RichText, Shape,
    Stroke, Ui, Vec2,
};
use ocu_ui::{Icon, Tokens, icons, legend, tokens};
use rcs_geom::Pose;
use rcs_msg::AnyMessage;
use rcs_msg::rcs::{Mission, PlanePolygon};
use rcs_runtime::Role;
use rcs_runtime::source::{Control, Frame, WGS84};
use std::time::Duration;

/// Distance between the lines of a hatching, screen points.
const HATCH: f32 = 9.0;
/// How goals are drawn, and how zones are.
const GOALS_HELP: &str = "Each click adds a goal; drag one to move it, right-click it to delete it";
const ZONES_HELP: &str = "Each click adds a corner, and a click on the first one closes the zone; \
    drag a corner to move it, right-click a zone to delete it";
/// What undo does, and how a change is done again.
const UNDO_HELP: &str = "Take the last change back (ctrl Z over the map; ctrl Y does it again)";
/// Radius of the ring of a goal that was reached, screen points.
const REACHED_RADIUS: f32 = 5.0;
/// Radius of the disc of a corner, screen points.
const CORNER_RADIUS: f32 = 3.0;

/// What is chosen in the menu of the map.
#[derive(Clone, Copy)]
enum Choice {
    /// Send the vehicle to the place where the menu was opened.
    Drive,
    /// Open a draft.
    Edit,
    /// Delete a goal of the draft, by its identity.
    DeleteGoal(u32),
    /// Delete a zone of the draft, by its index.
    DeleteZone(usize),
}

/// How a mission is painted.
#[derive(Clone, Copy, PartialEq)]
enum Look {
    /// The mission that a vehicle obeys.
    Obeyed,
    /// A draft.
    Draft,
    /// What is obeyed while a draft is open: weaker than the draft.
    BesideDraft,
}

/// Pose of the frame of a mission in that of the map at the viewed time: a mission holds until the next one, however old it
/// is. The error says that no transform connects them.
fn map_from_mission(frame: &Frame, map: &str, mission: &Mission) -> Result<Pose, String> {
    layers::map_from_frame(frame, map, &mission.frame_id, frame.transform_time(frame.now))
}

/// The operator's newest mission.
pub(super) fn newest<'a>(frame: &'a Frame, buffer: &str) -> Option<&'a Mission> {
    frame.topic(buffer)?.get()
}

/// The area and the zones that the operator has sent, on the map; the error says why they cannot be placed.
fn sent_bounds(frame: &Frame, map: &str, buffer: &str) -> Result<Bounds, String> {
    let Some(sent) = newest(frame, buffer) else { return Ok(Bounds::default()) };
    Ok(bounds_of(sent, map_from_mission(frame, map, sent)?))
}

/// Area and zones of a mission, on the map.
fn bounds_of(mission: &Mission, map_from_mission: Pose) -> Bounds {
    let outline =
        |zone: &PlanePolygon| -> Vec<[f64; 2]> { zone.points.iter().map(place(map_from_mission)).collect() };
    let keep_out = mission.keep_out.iter().map(outline).collect();
    Bounds { area: mission.area.as_ref().map(outline), keep_out }
}

/// The draft that begins with the goals that the vehicle has not reached, and with area and zones that the operator has
/// sent. What cannot be placed on the map must not be lost, and what is drawn must be of use: the error says why not.
pub(super) fn begin(frame: &Frame, map: &str, buffer: &str) -> Result<Draft, String> {
    sending_frame(frame, map)?;
    Ok(Draft::new(sent_bounds(frame, map, buffer)?, newest(frame, buffer), obeyed(frame, map)?))
}

/// Why no mission can be drawn on a map; `None` if one can be drawn.
pub(super) fn refusal(frame: &Frame, map: &str, buffer: &str) -> Option<String> {
    // The toolbar asks in every pass: no draft is made for it.
    sending_frame(frame, map).err().or_else(|| sent_bounds(frame, map, buffer).err())
}

/// The mission that a vehicle obeys, and the pose of its frame in that of the map; the error says why it cannot be placed. A
/// recorded mission counts where the run has none and it can be placed.
fn obeyed<'a>(frame: &'a Frame, map: &str) -> Result<Option<(&'a Mission, Pose)>, String> {
    // Those of the run come first.
    let topics = frame.topics_of_type("rcs.Mission").filter(|topic| topic.role() == Some(Role::Mission));
    for topic in topics {
        let Some(mission) = topic.get::<Mission>() else { continue };
        match map_from_mission(frame, map, mission) {
            Ok(pose) => return Ok(Some((mission, pose))),
            Err(why) if !topic.run.is_recorded() => return Err(format!("the mission that is obeyed: {why}")),
            Err(_) => {}
        }
    }
    Ok(None)
}

/// The bounds that the vehicle obeys also after a draft is sent, on the map: its area, unless the draft has one, and its zones
/// without those that the operator has sent, which the draft states. Empty where they cannot be placed.
fn standing_bounds(frame: &Frame, map: &str, buffer: &str) -> Bounds {
    let Ok(Some((mission, map_from_own))) = obeyed(frame, map) else { return Bounds::default() };
    let Ok(sent) = sent_bounds(frame, map, buffer) else { return Bounds::default() };
    let mut bounds = bounds_of(mission, map_from_own);
    bounds.keep_out.retain(|zone| !sent.keep_out.iter().any(|sent| is_same_outline(sent, zone)));
    bounds
}

/// The frame in which a mission is sent, and the pose of the map's frame in it: the frame in which the vehicle states its
/// own mission, or that of the map if it states none. The error says why nothing can be sent.
fn sending_frame(frame: &Frame, map: &str) -> Result<(String, Pose), String> {
    if map == WGS84 {
        let label = layers::frame_label(map);
        return Err(format!("the frame {label:?} exists on the map alone: choose another frame of the map"));
    }
    Ok(match obeyed(frame, map)? {
        Some((mission, map_from_own)) => (mission.frame_id.clone(), map_from_own.inverse()),
        None => (map.to_owned(), Pose::IDENTITY),
    })
}

impl Map {
    /// Says that the keys of undo and redo are for the mission that is drawn here, while the pointer is over the map.
    pub(super) fn offer_undo(&self, ui: &Ui, cx: &mut ViewContext<'_>, map: &str, canvas: Rect) {
        if self.draft.as_ref().is_some_and(Draft::can_undo_or_redo) && ui.rect_contains_pointer(canvas) {
            cx.selection.hovered.said().mission = Some(map.into());
        }
    }

    /// Drags a point of the draft with the primary button. Returns whether one is being dragged: meanwhile the pointer
    /// does not move the map.
    pub(super) fn drag_draft(&mut self, response: &Response, viewport: Viewport) -> bool {
        let Some(draft) = &mut self.draft else { return false };
        let on_map = |pos: Pos2| viewport.to_plane(response.rect, pos);
        if response.drag_started_by(PointerButton::Primary)
            && let Some(pressed) = response.ctx.input(|input| input.pointer.press_origin())
        {
            draft.grab(on_map(pressed), 1.0 / viewport.scale);
            self.drags = true;
        }
        // Another map may drag a point of the same draft.
        if !self.drags {
            return false;
        }
        // The pointer may also have moved in the pass in which the button is released.
        if let Some(pos) = response.interact_pointer_pos() {
            draft.drag_to(on_map(pos));
        }
        if !response.dragged() {
            draft.release();
            self.drags = false;
        }
        draft.dragged().is_some()
    }

    /// Clicks of the operator who draws, and the draft with them.
    pub(super) fn draw_mission(
        &mut self,
        ui: &Ui,
        cx: &ViewContext<'_>,
        map: &str,
        response: &Response,
        at: At,
        labels: &mut Labels,
    ) {
        let Some(draft) = &mut self.draft else { return };
        let Some(buffer) = Inputs::of(cx.frame).mission else { return };
        if let Ok(obeyed) = obeyed(cx.frame, map) {
            let now_s = ui.input(|input| input.time);
            draft.follow(newest(cx.frame, &buffer), obeyed.map(|(mission, _)| mission), now_s);
        }
        // A click beside the open menu closes the menu and adds nothing.
        let adds = response.clicked() && !response.context_menu_opened();
        if let Some(pos) = response.interact_pointer_pos().filter(|_| adds) {
            draft.click(at.viewport.to_plane(at.canvas, pos), 1.0 / at.viewport.scale);
        }
        paint_draft(ui, draft, map, response, at, labels);
    }

    /// The menu of the map, and the panel of the draft.
    pub(super) fn command_mission(
        &mut self,
        ui: &mut Ui,
        cx: &mut ViewContext<'_>,
        map: &str,
        response: &Response,
        at: At,
        vehicle: Option<[f64; 3]>,
    ) {
        let Some(buffer) = Inputs::of(cx.frame).mission else { return };
        let awaits = self.awaits_mission(&cx.selection.drafts);
        if awaits {
            // What is lost is awaited for some seconds only, also where nothing else repaints.
            ui.ctx().request_repaint_after(Duration::from_secs(1));
        }
        if response.secondary_clicked() {
            let pressed = response.interact_pointer_pos();
            self.menu_at = pressed.map(|pos| at.viewport.to_plane(at.canvas, pos));
        }
        let mut choice = None;
        response.context_menu(|ui| {
            // Until a mission has come to its buffer, its zones are not known to what is sent after it.
            let on_its_way = awaits.then(|| "the mission that was sent is on its way".to_owned());
            let refused = on_its_way.or_else(|| refusal(cx.frame, map, &buffer));
            choice = self.mission_menu(ui, refused.as_deref(), 1.0 / at.viewport.scale);
        });
        if let Some(choice) = choice {
            self.take_choice(cx, map, &buffer, choice);
        }
        if self.draft.is_some() {
            self.mission_plate(ui, cx, map, &buffer, at, vehicle.map(|[x, y, _]| [x, y]));
        }
    }

    /// Does what was chosen in the menu of the map.
    fn take_choice(&mut self, cx: &mut ViewContext<'_>, map: &str, buffer: &str, choice: Choice) {
        match (choice, self.menu_at) {
            (Choice::Drive, Some(goal)) => {
                // What is drawn and was not sent is no part of it, and stays.
                let begun = begin(cx.frame, map, buffer);
                if let (Ok(target), Ok(sent)) = (sending_frame(cx.frame, map), begun) {
                    send(cx, buffer, &target, &sent.with_only_goal(goal));
                    self.draft.iter_mut().for_each(Draft::forget_sending);
                }
            }
            (Choice::Drive, None) => {}
            (Choice::Edit, _) => self.open_draft(begin(cx.frame, map, buffer).ok()),
            (Choice::DeleteGoal(id), _) => {
                if let Some(draft) = &mut self.draft {
                    draft.delete_goal(id);
                }
            }
            (Choice::DeleteZone(zone), _) => {
                if let Some(draft) = &mut self.draft {
                    draft.delete_zone(zone);
                }
            }
        }
    }

    /// The menu of the map; returns what was chosen. `refused` says why no mission can be drawn.
    fn mission_menu(&self, ui: &mut Ui, refused: Option<&str>, m_per_point: f64) -> Option<Choice> {
        let drive = menu_item(ui, icons::ICON_FLAG, "Drive here", refused);
        let drive = drive.on_hover_text("Replaces the goals; keep-out zones stay as they were sent");
        let mut choice = drive.clicked().then_some(Choice::Drive);
        if self.draft.is_none() {
            let edit = menu_item(ui, icons::ICON_EDIT, "Edit the mission", refused);
            if edit.on_hover_text("Begins with what was sent").clicked() {
                choice = Some(Choice::Edit);
            }
        }
        // What is there now: a goal may have been reached since the menu was opened.
        if let (Some(draft), Some(at)) = (&self.draft, self.menu_at) {
            if let Some((id, number)) = draft.goal_at(at, m_per_point)
                && menu_item(ui, icons::ICON_DELETE, &format!("Delete goal {number}"), None).clicked()
            {
                choice = Some(Choice::DeleteGoal(id));
            }
            if let Some(zone) = draft.zone_at(at, m_per_point)
                && menu_item(ui, icons::ICON_DELETE, "Delete this keep-out zone", None).clicked()
            {
                choice = Some(Choice::DeleteZone(zone));
            }
        }
        if choice.is_some() {
            ui.close();
        }
        choice
    }

    /// The panel of the draft. `vehicle` is the place of the vehicle.
    fn mission_plate(
        &mut self,
        ui: &mut Ui,
        cx: &mut ViewContext<'_>,
        map: &str,
        buffer: &str,
        at: At,
        vehicle: Option<[f64; 2]>,
    ) {
        let Some(draft) = &mut self.draft else { return };
        let tokens = tokens(ui);
        let target = sending_frame(cx.frame, map);
        let standing = standing_bounds(cx.frame, map, buffer);
        let now_s = ui.input(|input| input.time);
        let mut closes = false;
        // Below the scale bar.
        let below = Rect::from_min_max(at.canvas.min + Vec2::new(0.0, 40.0), at.canvas.max);
        legend::solid_plate(ui, below, Align2::CENTER_TOP, |ui| {
            ui.spacing_mut().item_spacing.y = 4.0;
            ui.horizontal_wrapped(|ui| {
                ui.selectable_value(&mut draft.adds, Adds::Goal, "Goals").on_hover_text(GOALS_HELP);
                ui.selectable_value(&mut draft.adds, Adds::Zone, "Keep-out zones").on_hover_text(ZONES_HELP);
                ui.separator();
                let undo = ui.button(icons::ICON_UNDO.rich_text());
                if undo.on_hover_text(UNDO_HELP).clicked() {
                    draft.undo();
                }
                let clear = ui.button(icons::ICON_DELETE.rich_text());
                let help = "Delete all goals and zones; without goals the vehicle stands";
                if clear.on_hover_text(help).clicked() {
                    draft.clear();
                }
                ui.separator();
                let open = !draft.corners().is_empty();
                let send_it = format!("{}  Send", icons::ICON_SEND.codepoint);
                let can = !draft.is_as_sent() && !open && target.is_ok();
                let why = target.as_ref().err().map_or(why_not(draft), String::as_str);
                let button = ui.add_enabled(can, egui::Button::new(send_it)).on_disabled_hover_text(why);
                if let (true, Ok(target)) = (button.clicked(), &target) {
                    let sent = send(cx, buffer, target, draft);
                    draft.sent(&sent, now_s);
                }
                let help = "Without sending; what was changed is there again when the mission is opened";
                closes = ui.button("Close").on_hover_text(help).clicked();
            });
            let is_open = !draft.corners().is_empty();
            let text = match draft.without_goals() {
                _ if is_open => "click on the first corner to close the zone".to_owned(),
                Some(does) => format!("{}, {does}", draft.status()),
                None => draft.status().to_owned(),
            };
            let color = if is_open || !draft.is_as_sent() { tokens.warning } else { tokens.weak };
            let mut line = |text: String, color: Color32| {
                ui.add(egui::Label::new(RichText::new(text).small().color(color)).wrap());
            };
            line(format!("{}: {text}", draft.summary()), color);
            for warning in draft.warnings(&standing, vehicle) {
                line(warning, tokens.warning);
            }
        });
        if closes {
            self.close_draft();
        }
    }
}

/// An entry of the menu of the map; disabled where there is a reason against it.
fn menu_item(ui: &mut Ui, icon: Icon, text: &str, refused: Option<&str>) -> Response {
    let button = egui::Button::new(format!("{}  {text}", icon.codepoint));
    ui.add_enabled(refused.is_none(), button).on_disabled_hover_text(refused.unwrap_or_default())
}

fn why_not(draft: &Draft) -> &'static str {
    if draft.corners().is_empty() { "Nothing has changed" } else { "The zone is not closed" }
}

/// Sends a mission in a frame, given with the pose of the map's frame in it ([`sending_frame`]). It replaces those of all other
/// drafts; `draft` is not among the shared ones during the pass ([`Map::take_draft`]). Returns what was sent.
fn send(
    cx: &mut ViewContext<'_>,
    buffer: &str,
    (frame_id, frame_from_map): &(String, Pose),
    draft: &Draft,
) -> Mission {
    let timestamp = Some(cx.frame.now.to_proto());
    let mission = Mission { timestamp, ..draft.message(frame_id, frame_from_map) };
    let message = AnyMessage::new(mission.clone());
    cx.controls.push(Control::Write { buffer: buffer.to_owned(), message });
    cx.selection.drafts.all_missions_mut().for_each(Draft::forget_sending);
    mission
}

/// Paints a draft, and marks the point of it that is dragged, or that can be dragged from under the pointer.
fn paint_draft(ui: &Ui, draft: &Draft, map: &str, response: &Response, at: At, labels: &mut Labels) {
    let (painter, tokens) = (ui.painter_at(at.canvas), tokens(ui));
    paint(&painter, &draft.message(map, &Pose::IDENTITY), at, tokens, Look::Draft);
    paint_corners(&painter, draft.corners(), at, tokens);
    for (number, goal) in draft.numbers() {
        let colors = [tokens.warning, tokens.canvas()];
        paint_goal(&painter, at.screen(goal), number, colors, tokens, labels);
    }
    // A pointer that moves the map points at nothing.
    let pointer = response.hover_pos().filter(|_| !response.dragged());
    let pointer = pointer.map(|pos| at.viewport.to_plane(at.canvas, pos));
    let under = pointer.and_then(|pointer| draft.handle_at(pointer, 1.0 / at.viewport.scale));
    let dragged = draft.dragged();
    let Some(handle) = dragged.or(under) else { return };
    let Some(place) = draft.place(handle) else { return };
    let radius = match handle {
        Handle::Goal(_) => GOAL_RADIUS,
        Handle::Corner(..) | Handle::OpenCorner(_) => CORNER_RADIUS + 2.0,
    };
    painter.circle_stroke(at.screen(place), radius, Stroke::new(2.5, tokens.strong));
    let icon = if dragged.is_some() { CursorIcon::Grabbing } else { CursorIcon::Grab };
    ui.ctx().set_cursor_icon(icon);
}

/// Paints area and zones of the mission that a vehicle obeys. While a draft is open, those that are not in the draft,
/// and weaker.
pub(super) fn paint_obeyed(
    painter: &Painter,
    mission: &Mission,
    draft: Option<&Draft>,
    at: At,
    tokens: &Tokens,
) {
    match draft {
        Some(draft) => {
            let beside = draft.not_drawn(mission, at.map_from_layer);
            paint(painter, &beside, at, tokens, Look::BesideDraft);
        }
        None => paint(painter, mission, at, tokens, Look::Obeyed),
    }
}

/// Paints the goals of the mission that a vehicle obeys, those reached as grey rings.
pub(super) fn paint_goals(
    painter: &Painter,
    mission: &Mission,
    at: At,
    tokens: &Tokens,
    labels: &mut Labels,
) {
    for (index, goal) in mission.goals.iter().enumerate() {
        let (center, number) = (at.screen([goal.x_m, goal.y_m]), index + 1);
        if index < mission.reached as usize {
            paint_reached(painter, center, number, tokens, labels);
        } else {
            paint_goal(painter, center, number, [tokens.ok, tokens.canvas()], tokens, labels);
        }
    }
}

/// Paints the ring of a goal that was reached, with its number beside it: the vehicle often stands there.
fn paint_reached(painter: &Painter, center: Pos2, number: usize, tokens: &Tokens, labels: &mut Labels) {
    labels.keep_free(Rect::from_center_size(center, Vec2::splat(2.0 * REACHED_RADIUS)));
    for (width, color) in [(4.0_f32, tokens.canvas()), (2.0, tokens.weak)] {
        painter.circle_stroke(center, REACHED_RADIUS, Stroke::new(width, color));
    }
    labels.add(center, number.to_string(), tokens.text);
}

/// Paints the disc of a goal with its number; where the mark of a vehicle covers it, the number is beside it.
fn paint_goal(
    painter: &Painter,
    center: Pos2,
    number: usize,
    [fill, ink]: [Color32; 2],
    tokens: &Tokens,
    labels: &mut Labels,
) {
    labels.keep_free(Rect::from_center_size(center, Vec2::splat(2.0 * GOAL_RADIUS)));
    painter.circle(center, GOAL_RADIUS, fill, Stroke::new(1.0, tokens.canvas()));
    let number = number.to_string();
    if labels.is_covered(center, GOAL_RADIUS) {
        labels.add(center, number, fill);
    } else {
        painter.text(center, Align2::CENTER_CENTER, number, FontId::proportional(11.0), ink);
    }
}

/// Paints the area of a mission dashed, and its zones hatched. The corners of the zones of a draft are discs.
fn paint(painter: &Painter, mission: &Mission, at: At, tokens: &Tokens, look: Look) {
    let is_draft = look == Look::Draft;
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
    let red = match look {
        Look::Obeyed => tokens.error,
        Look::Draft => tokens.warning,
        Look::BesideDraft => tokens.error.gamma_multiply(0.5),
    };
    for zone in &mission.keep_out {
        hatch(painter, &screen(zone), red.gamma_multiply(0.6));
        let halo = Stroke::new(4.0, tokens.canvas().gamma_multiply(0.8));
        painter.extend(around(zone).into_iter().map(|part| Shape::line(part, halo)));
        painter.extend(around(zone).into_iter().map(|part| Shape::line(part, Stroke::new(1.5, red))));
        for corner in screen(zone).into_iter().filter(|_| is_draft) {
            painter.circle(corner, CORNER_RADIUS, red, Stroke::new(1.0, tokens.canvas()));
        }
    }
}

/// The corners of a zone that is not closed.
pub(super) fn paint_corners(painter: &Painter, corners: &[[f64; 2]], at: At, tokens: &Tokens) {
    let points: Vec<Pos2> = corners.iter().map(|corner| at.viewport.to_screen(at.canvas, *corner)).collect();
    painter.add(Shape::line(points.clone(), Stroke::new(1.5, tokens.warning)));
    for (index, point) in points.into_iter().enumerate() {
        let radius = if index == 0 { 5.0 } else { CORNER_RADIUS };
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
    use crate::samples;
    use rcs_geom::TransformTree;
    use rcs_msg::rcs::PlanePoint;
    use rcs_runtime::source::RunTag;
    use std::sync::Arc;

    /// A vehicle that stated its mission 5 s ago, in a frame, and whose frame `local` has moved by 10 m in the frame `global`
    /// since.
    fn stated_in(frame_id: &str, run: RunTag) -> Frame {
        let mission = Mission { frame_id: frame_id.to_owned(), ..Mission::default() };
        let mut topic = samples::topic("/generator/driven", 0.1, 5.0, mission);
        topic.metadata = Arc::new([("rcs.role".to_owned(), "mission".to_owned())].into());
        topic.run = run;
        let mut tree = TransformTree::new();
        for (age_ns, x) in [(5_000_000_000, 0.0), (0, 10.0)] {
            let at = samples::NOW.before_ns(age_ns);
            tree.insert("global", "local", at.0, Pose::from_xy_yaw(x, 0.0, 0.0)).unwrap();
        }
        Frame { topics: Arc::new([topic]), transforms: Arc::new(tree), ..samples::empty() }
    }

    #[test]
    fn a_mission_is_sent_and_painted_by_the_transform_of_the_viewed_time() {
        let frame = stated_in("global", RunTag::FIRST);
        let (target, target_from_map) = sending_frame(&frame, "local").unwrap();
        assert_eq!(target, "global");
        assert!((target_from_map.translation.x - 10.0).abs() < 1e-9, "{target_from_map:?}");
        let layers = layers::layers(&frame);
        let map_from_layer = layers::map_from_layer(&frame, "local", &layers[0]).unwrap();
        assert!((map_from_layer.translation.x + 10.0).abs() < 1e-9, "{map_from_layer:?}");
    }

    #[test]
    fn nothing_is_sent_where_the_mission_that_is_obeyed_cannot_be_placed_and_on_a_geodetic_map() {
        let target = |frame: &Frame, map: &str| sending_frame(frame, map).map(|(frame_id, _)| frame_id);
        let local = Ok("local".to_owned());
        assert_eq!(target(&samples::empty(), "local"), local);
        assert_eq!(target(&stated_in("elsewhere", RunTag::Recorded), "local"), local);
        let error = target(&stated_in("elsewhere", RunTag::FIRST), "local").unwrap_err();
        assert!(error.contains("frame \"elsewhere\" is not connected to \"local\""), "{error}");
        for frame in [samples::empty(), stated_in("global", RunTag::FIRST)] {
            assert!(target(&frame, WGS84).unwrap_err().contains("choose another frame"));
            assert!(refusal(&frame, WGS84, "/operator/mission").is_some());
        }
    }

    #[test]
    fn zones_of_a_course_stand_after_sending_and_those_that_the_operator_has_sent_do_not() {
        let zone = |x_m: f64| {
            let corners = [[x_m, 0.0], [x_m + 1.0, 0.0], [x_m, 1.0]];
            PlanePolygon { points: corners.map(|[x_m, y_m]| PlanePoint { x_m, y_m }).to_vec() }
        };
        let mission = |keep_out| Mission { frame_id: "local".to_owned(), keep_out, ..Mission::default() };
        let mut obeyed = samples::topic("/generator/driven", 0.1, 5.0, mission(vec![zone(0.0), zone(5.0)]));
        obeyed.metadata = Arc::new([("rcs.role".to_owned(), "mission".to_owned())].into());
        let sent = samples::topic("/operator/mission", 0.0, 5.0, mission(vec![zone(5.0)]));
        let frame = Frame { topics: Arc::new([obeyed, sent]), ..samples::empty() };
        let standing = standing_bounds(&frame, "local", "/operator/mission");
        assert_eq!(standing.keep_out, [vec![[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]]);
    }
}
