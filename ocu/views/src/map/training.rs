//! Examples for processes that learn: a person draws around something on the map and says what it is.

use super::example::Example;
use super::grid::frame_of;
use super::mission::{hatch, paint_corners};
use super::plan::At;
use super::{Map, layers};
use crate::operator::Inputs;
use crate::view::ViewContext;
use egui::{Align2, Pos2, Rect, Response, RichText, Shape, Stroke, Ui, Vec2};
use ocu_ui::{icons, legend, tokens};
use rcs_msg::AnyMessage;
use rcs_runtime::Role;
use rcs_runtime::source::{Control, Frame};

/// Distance from the first corner at which a click closes the outline, screen points.
const NEAR: f32 = 10.0;

/// The frame in which the processes that read examples state what they learn; that of the map while they state nothing.
fn learned_in<'a>(frame: &'a Frame, map: &'a str, buffer: &str) -> &'a str {
    let reads =
        |process: &&rcs_msg::rcs::ProcessInfo| process.inputs.iter().any(|input| input.buffer == buffer);
    let outputs = frame.processes.iter().filter(reads).flat_map(|process| &process.outputs);
    let mut costs = outputs
        .filter_map(|output| frame.topic(&output.buffer))
        .filter(|topic| topic.role() == Some(Role::Cost));
    costs.find_map(|topic| frame_of(topic.canonical()?)).unwrap_or(map)
}

impl Map {
    /// Takes the example that the maps of the source share in this frame for the pass. While something is measured here,
    /// clicks are not for it.
    pub(super) fn take_example(&mut self, cx: &mut ViewContext<'_>, map: &str) {
        let is_drawn = Inputs::of(cx.frame).training.is_some() && !self.measuring;
        self.example = if is_drawn { cx.selection.drafts.examples.remove(map) } else { None };
    }

    /// Ends what [`Self::take_example`] began. One that was not taken stays.
    pub(super) fn give_example_back(&mut self, cx: &mut ViewContext<'_>, map: &str) {
        if let Some(example) = self.example.take() {
            cx.selection.drafts.examples.entry(map.to_owned()).or_insert(example);
        } else if self.draft.is_some() {
            // A mission that is being drawn discards it, also where it was not taken.
            cx.selection.drafts.examples.remove(map);
        }
    }

    /// Opens an example, or throws it away.
    pub(super) fn toggle_example(&mut self) {
        self.example = if self.example.is_some() { None } else { Some(Example::default()) };
        self.measuring = false;
    }

    /// Clicks of the person who draws an example.
    pub(super) fn draw_example(
        &mut self,
        ui: &mut Ui,
        cx: &mut ViewContext<'_>,
        map: &str,
        response: &Response,
        at: At,
    ) {
        let Some(buffer) = Inputs::of(cx.frame).training else { return };
        let Some(example) = &mut self.example else { return };
        if let Some(pos) = response.interact_pointer_pos().filter(|_| response.clicked()) {
            example.click(at.viewport.to_plane(at.canvas, pos), f64::from(NEAR) / at.viewport.scale);
        }
        let (tokens, painter) = (tokens(ui), ui.painter_at(at.canvas));
        let color = if example.is_ground { tokens.ok } else { tokens.warning };
        let outline: Vec<Pos2> = example.outline.iter().map(|corner| at.screen(*corner)).collect();
        hatch(&painter, &outline, color.gamma_multiply(0.6));
        painter.add(Shape::closed_line(outline, Stroke::new(2.0, color)));
        paint_corners(&painter, &example.corners, at, tokens);
        self.example_plate(ui, cx, map, &buffer, at);
    }

    /// The panel of the example.
    fn example_plate(&mut self, ui: &mut Ui, cx: &mut ViewContext<'_>, map: &str, buffer: &str, at: At) {
        let Some(example) = &mut self.example else { return };
        let tokens = tokens(ui);
        let target = learned_in(cx.frame, map, buffer);
        let now = cx.frame.transform_time(cx.frame.now);
        let target_from_map = layers::map_from_frame(cx.frame, target, map, now);
        let (mut send, mut close) = (false, false);
        // Below the scale bar.
        let below = Rect::from_min_max(at.canvas.min + Vec2::new(0.0, 40.0), at.canvas.max);
        legend::solid_plate(ui, below, Align2::CENTER_TOP, |ui| {
            ui.spacing_mut().item_spacing.y = 4.0;
            ui.horizontal_wrapped(|ui| {
                ui.selectable_value(&mut example.is_ground, false, "Obstacle")
                    .on_hover_text("The vehicle must not drive over what looks like this");
                ui.selectable_value(&mut example.is_ground, true, "Ground")
                    .on_hover_text("The vehicle can drive over what looks like this");
                ui.separator();
                if ui.button(icons::ICON_UNDO.rich_text()).on_hover_text("Take the last click back").clicked()
                {
                    example.undo();
                }
                let text = format!("{}  Teach", icons::ICON_SCHOOL.codepoint);
                let can = !example.outline.is_empty() && target_from_map.is_ok();
                let why = match &target_from_map {
                    Err(reason) => reason,
                    Ok(_) => "Draw the outline first",
                };
                let button = ui.add_enabled(can, egui::Button::new(text));
                send = button.on_disabled_hover_text(why).clicked();
                close = ui.button("Close").on_hover_text("Stop drawing").clicked();
            });
            let (text, color) = match (example.outline.len(), example.corners.len(), example.sent) {
                (1.., ..) => ("not sent".to_owned(), tokens.warning),
                (_, 1.., _) => ("click on the first corner to close the outline".to_owned(), tokens.warning),
                (_, _, 0) => ("click around something; each click adds a corner".to_owned(), tokens.weak),
                (_, _, 1) => ("1 example sent".to_owned(), tokens.weak),
                (_, _, sent) => (format!("{sent} examples sent"), tokens.weak),
            };
            ui.add(egui::Label::new(RichText::new(text).small().color(color)).wrap());
        });
        if let (true, Ok(target_from_map)) = (send, &target_from_map) {
            let message = AnyMessage::new(example.message(cx.frame, target, target_from_map));
            cx.controls.push(Control::Write { buffer: buffer.to_owned(), message });
            *example = Example { is_ground: example.is_ground, sent: example.sent + 1, ..Example::default() };
        }
        if close {
            self.example = None;
        }
    }
}
