//! The timeline at the bottom of the window: the current time, and playback controls.

use super::commands::Command;
use super::scale::Scale;
use crate::time::date_and_time;
use egui::{Rect, Role, Sense, Stroke, WidgetInfo};
use ocu_ui::{format, icons, tokens, widgets};
use ocu_views::Selection;
use rcs_msg::Stamp;
use rcs_runtime::source::{Control, Frame, Step};

/// Selectable playback speeds.
const SPEEDS: [f64; 10] = [0.1, 0.25, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 60.0, f64::INFINITY];
/// Height of the bar.
const BAR: f32 = 28.0;
const SECOND_NS: i64 = 1_000_000_000;

/// Unit of a step.
#[derive(Clone, Debug, PartialEq)]
enum Unit {
    /// A message of this topic, or of any.
    Message(Option<String>),
    /// A cycle of this process, or of any.
    Cycle(Option<String>),
    /// A time in milliseconds.
    Time(i64),
}

impl Unit {
    fn step(&self, back: bool) -> Step {
        match self {
            Self::Message(topic) => Step::Message { topic: topic.clone(), back },
            Self::Cycle(process) => Step::Cycle { process: process.clone(), back },
            Self::Time(ms) => Step::Time { ns: ms * 1_000_000 * if back { -1 } else { 1 } },
        }
    }

    fn text(&self) -> String {
        match self {
            Self::Message(None) => "any message".to_owned(),
            Self::Message(Some(topic)) => topic.clone(),
            Self::Cycle(None) => "any cycle".to_owned(),
            Self::Cycle(Some(process)) => format!("cycle of {process}"),
            Self::Time(ms) if ms % 1000 == 0 => format!("{} s", ms / 1000),
            Self::Time(ms) => format!("{ms} ms"),
        }
    }
}

/// State of the timeline.
pub(super) struct Timeline {
    unit: Unit,
    /// The last time requested by dragging, so that a resting pointer sends one request.
    asked: Option<Stamp>,
    /// The latest time reached by a source without an end.
    furthest: Stamp,
}

impl Default for Timeline {
    fn default() -> Self {
        Self { unit: Unit::Message(None), asked: None, furthest: Stamp(0) }
    }
}

impl Timeline {
    /// Resets the state for another source.
    pub(super) fn forget(&mut self) {
        (self.asked, self.furthest) = (None, Stamp(0));
    }

    /// The control for a command about time; `None` for other commands.
    pub(super) fn command(&self, command: Command, frame: &Frame, selection: &Selection) -> Option<Control> {
        let playback = &frame.playback;
        Some(match command {
            Command::PlayPause if playback.playing => Control::Pause,
            Command::PlayPause => Control::Play,
            Command::Step { back } => Control::Step(self.unit.step(back)),
            Command::StepCycle { back } => {
                let process = match &self.unit {
                    Unit::Cycle(process) => process.clone(),
                    _ => selection.process.as_ref().map(ToString::to_string),
                };
                Control::Step(Step::Cycle { process, back })
            }
            Command::StepSecond { back } => {
                Control::Step(Step::Time { ns: if back { -SECOND_NS } else { SECOND_NS } })
            }
            Command::ToStart => Control::Seek(frame.info.start),
            Command::ToEnd => Control::Seek(frame.info.end.unwrap_or(self.furthest)),
            Command::Loop => Control::Loop(!playback.looping),
            _ => return None,
        })
    }

    /// Paints the timeline.
    pub(super) fn ui(&mut self, ui: &mut egui::Ui, frame: &Frame, controls: &mut Vec<Control>) {
        ui.horizontal(|ui| {
            self.transport(ui, frame, controls);
            ui.separator();
            clock(ui, frame);
            ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                state(ui, frame);
            });
        });
        self.bar(ui, frame, controls);
    }

    fn transport(&mut self, ui: &mut egui::Ui, frame: &Frame, controls: &mut Vec<Control>) {
        let playback = &frame.playback;
        let back = self.unit.step(true);
        if widgets::icon_button(ui, icons::ICON_SKIP_PREVIOUS, "Step back").clicked() {
            controls.push(Control::Step(back));
        }
        let (icon, name, control) = if playback.playing {
            (icons::ICON_PAUSE, "Pause", Control::Pause)
        } else {
            (icons::ICON_PLAY_ARROW, "Play", Control::Play)
        };
        if widgets::icon_button_of(ui, icon, name, playback.playing, true).clicked() {
            controls.push(control);
        }
        if widgets::icon_button(ui, icons::ICON_SKIP_NEXT, "Step forward").clicked() {
            controls.push(Control::Step(self.unit.step(false)));
        }
        self.unit_menu(ui, frame);

        let mut looping = playback.looping;
        if widgets::icon_toggle(ui, icons::ICON_REPEAT, "Start again at the end", &mut looping).clicked() {
            controls.push(Control::Loop(looping));
        }
        let mut speed = playback.speed;
        let text = |speed: f64| {
            if speed.is_infinite() { "max".to_owned() } else { format!("× {}", format::number(speed)) }
        };
        let shown = text(speed);
        let combo =
            egui::ComboBox::from_id_salt("speed").selected_text(shown).width(56.0).show_ui(ui, |ui| {
                for choice in SPEEDS {
                    ui.selectable_value(&mut speed, choice, text(choice));
                }
            });
        combo.response.widget_info(|| WidgetInfo::labeled(Role::ComboBox, true, "Speed"));
        combo.response.on_hover_text("Speed: seconds of the source a second; max is as fast as it goes");
        if speed != playback.speed {
            controls.push(Control::Speed(speed));
        }
    }

    fn unit_menu(&mut self, ui: &mut egui::Ui, frame: &Frame) {
        let shown = self.unit.text();
        let combo = egui::ComboBox::from_id_salt("step unit").selected_text(shown).width(128.0).truncate();
        let combo = combo.show_ui(ui, |ui| {
            let mut choice = |ui: &mut egui::Ui, unit: Unit| {
                let text = unit.text();
                ui.selectable_value(&mut self.unit, unit, text);
            };
            choice(ui, Unit::Message(None));
            if !frame.processes.is_empty() {
                choice(ui, Unit::Cycle(None));
                for process in frame.processes.iter() {
                    choice(ui, Unit::Cycle(Some(process.name.clone())));
                }
            }
            for ms in [100, 1000, 10_000] {
                choice(ui, Unit::Time(ms));
            }
            ui.separator();
            ui.label(egui::RichText::new("A message of").small().color(tokens(ui).weak));
            let mut last = "";
            // A topic that is both recorded and computed is listed once.
            for topic in frame.topics.iter().filter(|topic| topic.messages > 0) {
                if *topic.name != *last {
                    choice(ui, Unit::Message(Some(topic.name.to_string())));
                }
                last = &topic.name;
            }
        });
        combo.response.widget_info(|| WidgetInfo::labeled(Role::ComboBox, true, "What a step is"));
        combo.response.on_hover_text("What a step is (arrow keys; with shift, a cycle)");
    }

    /// The bar: click or drag to go to a time.
    fn bar(&mut self, ui: &mut egui::Ui, frame: &Frame, controls: &mut Vec<Control>) {
        let tokens = tokens(ui);
        let size = egui::vec2(ui.available_width(), BAR);
        let (rect, response) = ui.allocate_exact_size(size, Sense::click_and_drag());
        response.widget_info(|| {
            let mut info = WidgetInfo::labeled(Role::Slider, true, "Time");
            info.value = Some(frame.time_s());
            info
        });
        let painter = ui.painter_at(rect);
        painter.rect_filled(rect, 2.0, tokens.canvas());
        self.furthest = self.furthest.max(frame.now);
        // For a source without an end, the bar ends at a whole minute ahead.
        let end = frame.info.end.unwrap_or_else(|| {
            let minutes = (self.furthest.seconds_since(frame.info.start) / 60.0).floor() as u64 + 1;
            frame.info.start.after_ns(minutes * 60_000_000_000)
        });
        let inner = rect.shrink2(egui::vec2(8.0, 0.0));
        let scale = Scale::new(inner, frame.info.start, end, &frame.info.gaps);
        scale.paint_ticks(&painter, tokens);
        scale.paint_gaps(&painter, tokens, rect);
        if frame.info.end.is_none() {
            scale.paint_unknown(&painter, tokens, rect, self.furthest);
        }
        let x = scale.x(frame.now);
        let done = Rect::from_min_max(egui::pos2(scale.left(), rect.top()), egui::pos2(x, rect.top() + 4.0));
        painter.rect_filled(done, 0.0, tokens.selected);
        painter.vline(x, rect.y_range(), Stroke::new(2.0, tokens.accent));
        let head = [(-5.0, 0.0), (5.0, 0.0), (0.0, 6.0)].map(|(dx, dy)| egui::pos2(x + dx, rect.top() + dy));
        painter.add(egui::Shape::convex_polygon(head.to_vec(), tokens.accent, Stroke::NONE));

        let Some(pointer) = response.hover_pos().or_else(|| response.interact_pointer_pos()) else {
            self.asked = None;
            return;
        };
        let to = scale.stamp(pointer.x);
        // The last move and the release may fall into one pass, and with slow passes so may the whole drag.
        let is_drag = response.dragged() || response.drag_stopped() || pressed_and_released_in(ui, rect);
        if response.clicked() || is_drag {
            if self.asked != Some(to) {
                controls.push(Control::Seek(to));
                self.asked = Some(to);
            }
        } else {
            self.asked = None;
        }
        scale.paint_pointer(&painter, tokens, pointer.x, to);
    }
}

/// Whether the pointer was pressed in `rect` and released since the last pass.
fn pressed_and_released_in(ui: &egui::Ui, rect: Rect) -> bool {
    let is_button = |event: &egui::Event, down: bool| match event {
        egui::Event::PointerButton { pos, button: egui::PointerButton::Primary, pressed, .. } => {
            *pressed == down && (!down || rect.contains(*pos))
        }
        _ => false,
    };
    ui.input(|input| {
        let press = input.events.iter().position(|event| is_button(event, true));
        press.is_some_and(|press| input.events[press..].iter().any(|event| is_button(event, false)))
    })
}

/// The current time, since the start and absolute.
fn clock(ui: &mut egui::Ui, frame: &Frame) {
    let tokens = tokens(ui);
    let now =
        egui::RichText::new(format::elapsed(frame.time_s())).monospace().size(16.0).color(tokens.strong);
    ui.label(now).on_hover_text("Time since the start");
    if let Some(end) = frame.info.end {
        let length = format::elapsed(end.seconds_since(frame.info.start));
        ui.label(egui::RichText::new(format!("/ {length}")).monospace().color(tokens.weak));
    }
    ui.separator();
    let absolute = egui::RichText::new(date_and_time(frame.now)).monospace().color(tokens.weak);
    ui.label(absolute).on_hover_text(format!("{} ns", frame.now.0));
}

/// State of playback: its measured speed, and how far it lags behind the clock.
fn state(ui: &mut egui::Ui, frame: &Frame) {
    let tokens = tokens(ui);
    let playback = &frame.playback;
    if !playback.playing {
        return;
    }
    let slow = playback.achieved.is_some_and(|achieved| achieved < 0.95 * playback.speed)
        && playback.speed.is_finite();
    if let Some(achieved) = playback.achieved {
        let color = if slow { tokens.warning } else { tokens.weak };
        let text = widgets::mono(format!("{achieved:6.2} × real time")).color(color);
        ui.label(text).on_hover_text("Seconds of the source a second, over the last half second");
    }
    if playback.lag_s > 0.25 {
        let text = format!("{} behind the clock", format::age(playback.lag_s));
        let color = if slow { tokens.warning } else { tokens.weak };
        widgets::tag(ui, &text, color).on_hover_text(
            "What could not be done in time since playing began. It is not caught up with: time goes on at the speed \
             that was asked for.",
        );
    }
}
