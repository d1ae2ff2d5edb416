//! Timing view: the cycles of every process against its period: computing, waiting and overruns apart.
//!
//! The bar of a process is its period. The filled part is the mean time of computing, the line behind it the longest
//! cycle, and the hatched part the mean time of waiting (waking late, and for the lock), which only live runs have.

use crate::view::{Hover, View, ViewContext, is_old};
use egui::{Align, Color32, FontId, Rect, Role, ScrollArea, Sense, Stroke, Ui, Vec2, WidgetInfo};
use ocu_ui::{format, icons, stale, tokens, widgets};
use rcs_msg::rcs::{ProcessInfo, ProcessTiming, Timing as TimingMessage};
use rcs_runtime::source::{Frame, Topic};

const ROW: f32 = 22.0;
/// Columns of numbers, with their widths; the first ones are left out where there is no room.
const COLUMNS: [(&str, f32); 6] = [
    ("waits", 64.0),
    ("missed", 52.0),
    ("longest", 64.0),
    ("overruns", 60.0),
    ("busy", 48.0),
    ("mean", 64.0),
];
const NAME: f32 = 116.0;
const BAR: f32 = 96.0;

/// The timing view. It has no state.
#[derive(Default)]
pub(crate) struct Timing;

impl View for Timing {
    fn title(&self, _frame: &Frame) -> String {
        "Timing".to_owned()
    }

    fn ui(&mut self, ui: &mut Ui, cx: &mut ViewContext<'_>) {
        let found = cx.frame.topics_of_type("rcs.Timing").find_map(|topic| Some((topic, topic.get()?)));
        let Some((topic, timing)): Option<(&Topic, &TimingMessage)> = found else {
            let hint = "The times of a stack's processes would fill it: let a stack run.";
            return widgets::empty(ui, icons::ICON_TIMER, "No times have been measured", hint);
        };
        summary(ui, cx.frame, topic, timing);
        let columns = Columns::of(ui.available_width());
        columns.header(ui);
        ui.spacing_mut().item_spacing.y = 0.0;
        let rows = &timing.processes;
        ScrollArea::vertical().auto_shrink(false).show_rows(ui, ROW, rows.len(), |ui, range| {
            for measured in &rows[range] {
                let info = cx.frame.processes.iter().find(|info| info.name == measured.process);
                row(ui, cx, measured, info, &columns);
            }
        });
    }
}

/// What holds for the whole stack.
fn summary(ui: &mut Ui, frame: &Frame, topic: &Topic, timing: &TimingMessage) {
    let tokens = tokens(ui);
    let busy: f64 = timing
        .processes
        .iter()
        .filter_map(|measured| {
            let info = frame.processes.iter().find(|info| info.name == measured.process)?;
            Some(measured.mean_us * 1e3 / info.period_ns.max(1) as f64)
        })
        .sum();
    let age = topic.age_s(frame.now).unwrap_or(0.0);
    egui::Frame::new().inner_margin(egui::Margin::symmetric(8, 4)).show(ui, |ui| {
        ui.horizontal_wrapped(|ui| {
            ui.label(widgets::mono(format!("{busy:5.2}")).color(tokens.strong));
            ui.label(egui::RichText::new("cores busy in simulated time").small().color(tokens.weak));
            if timing.lag_s.abs() > 0.05 {
                let text = format!("{} behind its clock", format::age(timing.lag_s));
                widgets::tag(ui, &text, tokens.warning);
            }
            if is_old(topic, frame.now) {
                widgets::tag(ui, &format!("old: {}", format::age(age)), tokens.stale);
            }
        });
    });
}

/// The columns that have room.
struct Columns {
    shown: Vec<usize>,
}

impl Columns {
    fn of(width: f32) -> Self {
        let mut room = width - NAME - BAR - 32.0;
        let mut shown = Vec::new();
        for index in (0..COLUMNS.len()).rev() {
            room -= COLUMNS[index].1 + 8.0;
            if room >= 0.0 {
                shown.insert(0, index);
            }
        }
        Self { shown }
    }

    /// Places of the name, of the bar and of the columns.
    fn places(&self, rect: Rect) -> (Rect, Rect, Vec<(usize, Rect)>) {
        let mut right = rect.right() - 8.0;
        let mut cells = Vec::new();
        for &index in self.shown.iter().rev() {
            let width = COLUMNS[index].1;
            cells.push((index, Rect::from_x_y_ranges(right - width..=right, rect.y_range())));
            right -= width + 8.0;
        }
        let left = rect.left() + 8.0;
        let name = Rect::from_x_y_ranges(left..=left + NAME, rect.y_range());
        let bar = Rect::from_x_y_ranges(name.right() + 8.0..=right.max(name.right() + 16.0), rect.y_range());
        (name, bar, cells)
    }

    fn header(&self, ui: &mut Ui) {
        let (rect, _) = ui.allocate_exact_size(Vec2::new(ui.available_width(), ROW), Sense::hover());
        let (name, bar, cells) = self.places(rect);
        let (font, weak) = (FontId::proportional(11.0), tokens(ui).weak);
        widgets::cell(ui, name, Align::Min, "process", font.clone(), weak);
        widgets::cell(ui, bar, Align::Min, "cycle against its period", font.clone(), weak);
        for (index, cell) in cells {
            widgets::cell(ui, cell, Align::Max, COLUMNS[index].0, font.clone(), weak);
        }
    }
}

fn row(
    ui: &mut Ui,
    cx: &mut ViewContext<'_>,
    measured: &ProcessTiming,
    info: Option<&ProcessInfo>,
    columns: &Columns,
) {
    let tokens = tokens(ui);
    let period_us = info.map_or(f64::NAN, |info| info.period_ns as f64 / 1e3);
    let busy = measured.mean_us / period_us;
    let waits_us = measured.wake_late_mean_us + measured.lock_wait_mean_us;
    let (rect, response) = ui.allocate_exact_size(Vec2::new(ui.available_width(), ROW), Sense::click());
    let chosen = cx.selection.process.as_deref() == Some(measured.process.as_str());
    response.widget_info(|| {
        let name = format!("{}: {} of {}", measured.process, time(measured.mean_us), time(period_us));
        WidgetInfo::selected(Role::Button, true, chosen, name)
    });
    let is_meant = cx.selection.hovered.get().process.as_deref() == Some(measured.process.as_str());
    if chosen {
        ui.painter().rect_filled(rect, 0.0, tokens.selected);
    } else if response.hovered() || is_meant {
        ui.painter().rect_filled(rect, 0.0, tokens.surface[2]);
    }
    if response.hovered() {
        let process = Some(measured.process.as_str().into());
        cx.selection.hovered.set(Hover { process, ..Hover::default() });
    }
    if response.clicked() {
        cx.selection.process = Some(measured.process.as_str().into());
    }
    let (name, bar, cells) = columns.places(rect);
    widgets::cell(ui, name, Align::Min, &measured.process, FontId::proportional(13.0), tokens.text);
    let over = measured.overruns > 0;
    let color = if over { tokens.warning } else { tokens.ok };
    paint_bar(
        ui,
        bar.shrink2(Vec2::new(0.0, 5.0)),
        [busy, waits_us / period_us, measured.max_us / period_us],
        color,
    );
    for (index, cell) in cells {
        let (text, ink) = match COLUMNS[index].0 {
            "waits" if waits_us == 0.0 => ("–".to_owned(), tokens.weak),
            "waits" => (time(waits_us), tokens.text),
            "missed" => count(measured.missed, tokens.weak, tokens.warning),
            "longest" => (time(measured.max_us), tokens.text),
            "overruns" => count(measured.overruns, tokens.weak, tokens.warning),
            "busy" if busy.is_nan() => ("–".to_owned(), tokens.weak),
            "busy" => (format!("{:3.0} %", busy * 100.0), tokens.text),
            _ => (time(measured.mean_us), tokens.text),
        };
        widgets::cell(ui, cell, Align::Max, &text, FontId::monospace(11.5), ink);
    }
    response.on_hover_ui(|ui| details(ui, measured, period_us));
}

/// The period as a bar: computing, waiting, and the longest cycle as shares of it. Longer ones reach its end.
fn paint_bar(ui: &Ui, bar: Rect, [busy, waits, longest]: [f64; 3], color: Color32) {
    let tokens = tokens(ui);
    let painter = ui.painter_at(bar);
    painter.rect_filled(bar, 1.0, tokens.surface[2]);
    let x = |part: f64| {
        bar.left() + bar.width() * if part.is_finite() { part.clamp(0.0, 1.0) as f32 } else { 0.0 }
    };
    let computing = Rect::from_x_y_ranges(bar.left()..=x(busy), bar.y_range());
    painter.rect_filled(computing, 1.0, color);
    if waits > 0.0 {
        let waiting = Rect::from_x_y_ranges(x(busy)..=x(busy + waits), bar.y_range());
        stale::hatch(&painter, waiting, tokens.weak);
    }
    painter.vline(x(longest).min(bar.right() - 1.0), bar.y_range(), Stroke::new(2.0, color));
    if longest > 1.0 {
        let at = bar.right_center() - Vec2::new(8.0, 0.0);
        widgets::icon_at(&painter, at, icons::ICON_KEYBOARD_DOUBLE_ARROW_RIGHT, 12.0, tokens.strong);
    }
}

fn details(ui: &mut Ui, measured: &ProcessTiming, period_us: f64) {
    ui.label(egui::RichText::new(&measured.process).color(tokens(ui).strong));
    let lines = [
        ("period", time(period_us)),
        ("cycles", format::count(measured.cycles)),
        ("computing", format!("mean {}, longest {}", time(measured.mean_us), time(measured.max_us))),
        (
            "waking",
            format!("mean {}, longest {}", time(measured.wake_late_mean_us), time(measured.wake_late_max_us)),
        ),
        (
            "lock",
            format!("mean {}, longest {}", time(measured.lock_wait_mean_us), time(measured.lock_wait_max_us)),
        ),
        ("overruns", format!("{}, {} cycles missed", measured.overruns, measured.missed)),
    ];
    for (name, value) in lines {
        widgets::name_value(ui, 72.0, name, widgets::mono(value));
    }
}

fn count(value: u64, usual: Color32, alarm: Color32) -> (String, Color32) {
    (format::count(value), if value > 0 { alarm } else { usual })
}

/// A time in µs, ms or s with constant width.
fn time(us: f64) -> String {
    match us {
        us if !us.is_finite() => "–".to_owned(),
        us if us < 999.5 => format!("{us:.0} µs"),
        us if us < 99_950.0 => format!("{:.1} ms", us / 1e3),
        us if us < 999_500.0 => format!("{:.0} ms", us / 1e3),
        us => format!("{:.2} s", us / 1e6),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_have_a_unit_and_three_digits() {
        let times = [0.0, 12.4, 999.6, 12_340.0, 250_000.0, 2_500_000.0, f64::NAN].map(time);
        assert_eq!(times, ["0 µs", "12 µs", "1.0 ms", "12.3 ms", "250 ms", "2.50 s", "–"]);
    }

    #[test]
    fn columns_leave_from_the_left_where_there_is_no_room() {
        assert_eq!(Columns::of(900.0).shown.len(), COLUMNS.len());
        assert_eq!(Columns::of(340.0).shown, [COLUMNS.len() - 1]);
        assert!(Columns::of(180.0).shown.is_empty());
    }
}
