//! The events of a run as marks above the timeline's bar, one lane for each kind.

use super::scale::Scale;
use egui::{Color32, Rect, Ui};
use ocu_ui::{Tokens, format, tokens, widgets};
use rcs_msg::Stamp;
use rcs_runtime::source::{Event, EventKind, EventLevel, Events, Frame};

/// Height of a lane.
const LANE: f32 = 6.0;
/// Width of a mark, and of the steps in which marks are searched.
const STEP: f32 = 3.0;
/// Distance at which the pointer means a mark.
const NEAR: f32 = 6.0;

/// The kinds that have a lane: those that may occur in the messages of the source, so that the bar keeps its height when
/// the first one does. Lines of a log are too many to be marks.
pub(super) fn lanes(frame: &Frame) -> Vec<EventKind> {
    let may_occur = |kind: &EventKind| frame.topics.iter().any(|topic| kind.is_found_in(topic.type_name()));
    EventKind::ALL.into_iter().filter(|kind| *kind != EventKind::Log && may_occur(kind)).collect()
}

/// Height of these lanes.
pub(super) fn height(lanes: &[EventKind]) -> f32 {
    lanes.len() as f32 * LANE
}

/// Paints the lanes; returns the event under the pointer.
pub(super) fn paint(
    ui: &Ui,
    events: &Events,
    lanes: &[EventKind],
    rect: Rect,
    scale: &Scale,
) -> Option<Event> {
    let tokens = tokens(ui);
    let painter = ui.painter_at(rect);
    let pointer = ui.input(|input| input.pointer.hover_pos()).filter(|at| rect.contains(*at));
    let steps = (rect.width() / STEP).ceil().max(1.0) as usize;
    let times: Vec<Stamp> = (0..=steps).map(|step| scale.stamp(rect.left() + step as f32 * STEP)).collect();
    let mut meant: Option<(f32, Event)> = None;
    for (index, kind) in lanes.iter().copied().enumerate() {
        let top = rect.top() + index as f32 * LANE;
        let lane = Rect::from_x_y_ranges(rect.x_range(), top..=top + LANE);
        if index % 2 == 1 {
            painter.rect_filled(lane, 0.0, tokens.surface[2].gamma_multiply(0.4));
        }
        for event in events.between(kind, &times).into_iter().flatten() {
            let x = scale.x(event.stamp);
            let mark = Rect::from_center_size(egui::pos2(x, lane.center().y), egui::vec2(2.0, LANE - 1.0));
            painter.rect_filled(mark, 0.0, color(&event, tokens));
            if let Some(at) = pointer.filter(|at| lane.contains(*at)) {
                let distance = (at.x - x).abs();
                if distance <= NEAR && meant.as_ref().is_none_or(|(best, _)| distance < *best) {
                    meant = Some((distance, event));
                }
            }
        }
    }
    meant.map(|(_, event)| event)
}

/// What an event is, for the tooltip.
pub(super) fn describe(ui: &mut Ui, event: &Event, start: Stamp) {
    let tokens = tokens(ui);
    let time = format::elapsed(event.stamp.seconds_since(start));
    ui.label(widgets::mono(format!("{time}  {}", event.kind.name())).color(color(event, tokens)));
    ui.label(egui::RichText::new(format!("{}: {}", event.source, event.text)).color(tokens.text));
}

fn color(event: &Event, tokens: &Tokens) -> Color32 {
    match (event.kind, event.level) {
        (_, EventLevel::Error) => tokens.error,
        (EventKind::Error | EventKind::Bumper, _) => tokens.warning,
        (EventKind::Operator, _) => tokens.accent,
        (EventKind::Command, _) => tokens.series[3],
        (EventKind::Mode, _) => tokens.ok,
        (EventKind::Log, _) => tokens.weak,
    }
}
