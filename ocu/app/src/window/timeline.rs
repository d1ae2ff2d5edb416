//! The bottom of the window: where time stands, and how it goes on.

use super::keys::Action;
use crate::time::date_and_time;
use egui::{Align2, FontId, Rect, Role, Sense, Stroke, WidgetInfo};
use ocu_ui::{format, icons, tokens, widgets};
use ocu_views::Selection;
use rcs_msg::Stamp;
use rcs_runtime::source::{Control, Frame, Step};

/// Speeds that can be chosen.
const SPEEDS: [f64; 10] = [0.1, 0.25, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 60.0, f64::INFINITY];
/// Height of the bar that is dragged.
const BAR: f32 = 28.0;
const SECOND_NS: i64 = 1_000_000_000;

/// What one step is.
#[derive(Clone, Debug, PartialEq)]
enum Unit {
    /// A message of that topic, or of any.
    Message(Option<String>),
    /// A cycle of that process, or of any.
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

/// The timeline's own state.
pub(super) struct Timeline {
    unit: Unit,
    /// The last place that a drag asked for, so that a pointer that rests asks once.
    asked: Option<Stamp>,
    /// How far a source without an end has come.
    furthest: Stamp,
}

impl Default for Timeline {
    fn default() -> Self {
        Self { unit: Unit::Message(None), asked: None, furthest: Stamp(0) }
    }
}

impl Timeline {
    /// Another source is shown.
    pub(super) fn forget(&mut self) {
        (self.asked, self.furthest) = (None, Stamp(0));
    }

    /// What a key asks of the source.
    pub(super) fn key(&self, action: Action, frame: &Frame, selection: &Selection) -> Option<Control> {
        let playback = &frame.playback;
        Some(match action {
            Action::PlayPause if playback.playing => Control::Pause,
            Action::PlayPause => Control::Play,
            Action::Step { back } => Control::Step(self.unit.step(back)),
            Action::StepCycle { back } => {
                let process = match &self.unit {
                    Unit::Cycle(process) => process.clone(),
                    _ => selection.process.as_ref().map(ToString::to_string),
                };
                Control::Step(Step::Cycle { process, back })
            }
            Action::StepSecond { back } => {
                Control::Step(Step::Time { ns: if back { -SECOND_NS } else { SECOND_NS } })
            }
            Action::ToStart => Control::Seek(frame.info.start),
            Action::ToEnd => Control::Seek(frame.info.end.unwrap_or(self.furthest)),
            Action::Loop => Control::Loop(!playback.looping),
            Action::Open | Action::Help => return None,
        })
    }

    /// Shows the timeline.
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
            // A topic that was recorded and is made now has one name, and stands here once.
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

    /// The bar: click or drag to go there.
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
        // A source without an end has whole minutes ahead of it.
        let end = frame.info.end.unwrap_or_else(|| {
            let minutes = (self.furthest.seconds_since(frame.info.start) / 60.0).floor() as u64 + 1;
            frame.info.start.after_ns(minutes * 60_000_000_000)
        });
        let scale = Scale { rect: rect.shrink2(egui::vec2(8.0, 0.0)), start: frame.info.start, end };
        scale.paint_ticks(&painter, tokens);
        if frame.info.end.is_none() {
            scale.paint_unknown(&painter, tokens, rect, self.furthest);
        }
        let x = scale.x(frame.now);
        let done =
            Rect::from_min_max(egui::pos2(scale.rect.left(), rect.top()), egui::pos2(x, rect.top() + 4.0));
        painter.rect_filled(done, 0.0, tokens.selected);
        painter.vline(x, rect.y_range(), Stroke::new(2.0, tokens.accent));
        let head = [(-5.0, 0.0), (5.0, 0.0), (0.0, 6.0)].map(|(dx, dy)| egui::pos2(x + dx, rect.top() + dy));
        painter.add(egui::Shape::convex_polygon(head.to_vec(), tokens.accent, Stroke::NONE));

        let Some(pointer) = response.hover_pos().or_else(|| response.interact_pointer_pos()) else {
            self.asked = None;
            return;
        };
        let to = scale.stamp(pointer.x);
        // The last move and the release may come in one pass; where passes are slow, the whole drag may.
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

/// Time against the bar's width.
struct Scale {
    rect: Rect,
    start: Stamp,
    end: Stamp,
}

impl Scale {
    fn duration_s(&self) -> f64 {
        self.end.seconds_since(self.start).max(1e-9)
    }

    fn x(&self, stamp: Stamp) -> f32 {
        let fraction = (stamp.seconds_since(self.start) / self.duration_s()).clamp(0.0, 1.0);
        self.rect.left() + self.rect.width() * fraction as f32
    }

    fn stamp(&self, x: f32) -> Stamp {
        let fraction = ((x - self.rect.left()) / self.rect.width().max(1.0)).clamp(0.0, 1.0);
        self.start.after_ns((f64::from(fraction) * (self.end.0 - self.start.0) as f64).round() as u64)
    }

    /// The time under the pointer, beside a line.
    fn paint_pointer(&self, painter: &egui::Painter, tokens: &ocu_ui::Tokens, x: f32, to: Stamp) {
        painter.vline(x, self.rect.y_range(), Stroke::new(1.0, tokens.weak));
        let text = format::elapsed(to.seconds_since(self.start));
        let galley = painter.layout_no_wrap(text, FontId::monospace(11.0), tokens.strong);
        let room = x + galley.size().x + 12.0 < self.rect.right();
        let left = if room { x + 4.0 } else { x - galley.size().x - 4.0 };
        let at = egui::pos2(left, self.rect.center().y - galley.size().y / 2.0);
        painter.rect_filled(Rect::from_min_size(at, galley.size()).expand(2.0), 2.0, tokens.surface[3]);
        painter.galley(at, galley, tokens.strong);
    }

    /// What has not happened yet.
    fn paint_unknown(&self, painter: &egui::Painter, tokens: &ocu_ui::Tokens, bar: Rect, from: Stamp) {
        let rest = Rect::from_min_max(egui::pos2(self.x(from), bar.top()), bar.right_bottom());
        painter.rect_filled(rest, 0.0, tokens.surface[2].gamma_multiply(0.6));
    }

    fn paint_ticks(&self, painter: &egui::Painter, tokens: &ocu_ui::Tokens) {
        let step_s = tick_step_s(self.duration_s(), self.rect.width() / 96.0);
        let count = (self.duration_s() / step_s).floor() as u64;
        for index in 0..=count {
            let time_s = index as f64 * step_s;
            let x = self.x(self.start.after_ns((time_s * 1e9) as u64));
            let bottom = self.rect.bottom();
            painter.vline(x, (bottom - 6.0)..=bottom, Stroke::new(1.0, tokens.line));
            let room = x + 56.0 < self.rect.right();
            if room {
                let at = egui::pos2(x + 4.0, bottom);
                painter.text(
                    at,
                    Align2::LEFT_BOTTOM,
                    tick_text(time_s, step_s),
                    FontId::monospace(10.0),
                    tokens.weak,
                );
            }
        }
    }
}

/// A round step that gives at most `most` ticks.
fn tick_step_s(duration_s: f64, most: f32) -> f64 {
    const STEPS_S: [f64; 19] = [
        0.001, 0.01, 0.1, 0.5, 1.0, 2.0, 5.0, 10.0, 15.0, 30.0, 60.0, 120.0, 300.0, 600.0, 900.0, 1800.0,
        3600.0, 21_600.0, 86_400.0,
    ];
    let least = duration_s / f64::from(most.max(1.0));
    STEPS_S
        .into_iter()
        .find(|&step_s| step_s >= least)
        .unwrap_or_else(|| (least / 86_400.0).ceil() * 86_400.0)
}

/// Minutes and seconds, hours where there are some, and as many decimals as the steps need.
fn tick_text(time_s: f64, step_s: f64) -> String {
    let whole = time_s.floor() as u64;
    let decimals = if step_s < 0.01 {
        3
    } else if step_s < 0.1 {
        2
    } else {
        usize::from(step_s < 1.0)
    };
    let width = if decimals == 0 { 2 } else { decimals + 3 };
    let seconds = time_s - (whole / 60 * 60) as f64;
    let minutes = format!("{:02}:{seconds:0width$.decimals$}", whole / 60 % 60);
    if whole >= 3600 { format!("{}:{minutes}", whole / 3600) } else { minutes }
}

/// The moment, since the start and absolute.
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

/// How playing goes: its measured speed, and how far it is behind the clock where it is.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_never_too_many() {
        for duration_s in [0.0005, 0.02, 1.0, 19.0, 61.0, 4000.0, 1e5, 1e7] {
            let step_s = tick_step_s(duration_s, 10.0);
            assert!(duration_s / step_s <= 10.0 + 1e-9, "{duration_s}: {step_s}");
        }
        assert_eq!(tick_step_s(20.0, 12.0), 2.0);
        assert_eq!(tick_text(62.0, 2.0), "01:02");
        assert_eq!(tick_text(3725.5, 0.5), "1:02:05.5");
    }

    #[test]
    fn the_bar_maps_both_ways() {
        let rect = Rect::from_min_size(egui::pos2(10.0, 0.0), egui::vec2(200.0, 20.0));
        let scale = Scale { rect, start: Stamp(1_000), end: Stamp(2_001_000) };
        assert_eq!(scale.stamp(-5.0), Stamp(1_000));
        assert_eq!(scale.stamp(500.0), Stamp(2_001_000));
        let middle = scale.stamp(110.0);
        assert_eq!(middle, Stamp(1_001_000));
        assert!((scale.x(middle) - 110.0).abs() < 0.01);
    }
}
