//! Command ladder: the commands of a process and their echoes on a time axis, with latencies (Albus 2006a, 6.2).
//!
//! A command stands on the upper rail at the time it was sent. The line from it ends on the lower rail at the first
//! status that echoes its serial number. A command that was echoed late, or replaced before it was echoed, is marked.
//! The list below has the same commands; a click on one goes to its time.

use crate::process_state::status_limit_s;
use crate::toolbar;
use crate::view::{SavedState, View, ViewContext};
use egui::{Align, Color32, FontId, Pos2, Rect, Role, ScrollArea, Sense, Stroke, Ui, Vec2, WidgetInfo};
use ocu_ui::bar::{Bar, Fit};
use ocu_ui::{Tokens, format, icons, tokens, widgets};
use rcs_formula::FieldRef;
use rcs_msg::Stamp;
use rcs_msg::rcs::ProcessInfo;
use rcs_runtime::source::{Control, FieldPoint, FieldSeries, Frame, RunTag, Series};
use serde::{Deserialize, Serialize};
use std::ops::ControlFlow;

const ROW: f32 = 20.0;
/// Height of the ladder, and the distance of its rails from its edges.
const LADDER: f32 = 76.0;
const RAIL: f32 = 18.0;
/// The largest number of commands that are drawn; of more, the newest.
const MOST: usize = 400;
/// Part of the ladder before the time that is shown.
const BEFORE: f64 = 0.8;
/// Widths of the columns after the first, which has the rest of the room.
const COLUMNS: [(&str, f32); 4] = [("serial", 60.0), ("latency", 84.0), ("echo", 84.0), ("sent", 104.0)];

/// How much time the ladder shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
enum Span {
    #[default]
    Seconds10,
    Minute,
    All,
}

impl Span {
    const ALL: [(Self, &'static str); 3] =
        [(Self::Seconds10, "10 s"), (Self::Minute, "1 min"), (Self::All, "All")];

    /// The times at both ends.
    fn range(self, frame: &Frame) -> [Stamp; 2] {
        let seconds = match self {
            Self::Seconds10 => 10.0,
            Self::Minute => 60.0,
            Self::All => return [frame.info.start, frame.info.end.unwrap_or(frame.now)],
        };
        let before_ns = (BEFORE * seconds * 1e9) as u64;
        let from = frame.now.0.saturating_sub(before_ns).max(frame.info.start.0);
        [Stamp(from), Stamp(from + (seconds * 1e9) as u64)]
    }
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
struct Saved {
    span: Span,
}

/// The view.
#[derive(Default)]
pub(crate) struct Ladder {
    saved: Saved,
    /// The fields of the process that was shown last: serial and name of its commands, and the echo in its status.
    fields: Option<[FieldRef; 3]>,
}

/// What became of a command.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Fate {
    /// Echoed after this time, s.
    Echoed { at: Stamp, latency_s: f64, is_late: bool },
    /// It may still be echoed.
    Waits,
    /// The next command was sent before this one was echoed, and this one never was.
    Replaced,
    /// The time in which it should have been echoed is over.
    Lost,
}

/// A command that was sent.
#[derive(Clone, Debug, PartialEq)]
struct Sent {
    at: Stamp,
    serial: f64,
    fate: Fate,
}

/// The series of the shown process.
struct Shown<'a> {
    serials: &'a Series<FieldPoint>,
    names: &'a FieldSeries,
    echoes: &'a Series<FieldPoint>,
    limit_s: f64,
    /// The time up to which statuses are known.
    known_to: Stamp,
}

impl<'a> Shown<'a> {
    fn of(frame: &'a Frame, process: &ProcessInfo, fields: &[FieldRef; 3]) -> Option<Self> {
        let run = RunTag::Run(frame.runs.current());
        let [serials, names, echoes] = [0, 1, 2].map(|index| frame.field(&fields[index], run));
        let (serials, names, echoes) = (&serials?.points, names?, &echoes?.points);
        let known_to = frame.info.end.unwrap_or(frame.now).max(frame.now);
        Some(Self { serials, names, echoes, limit_s: status_limit_s(process), known_to })
    }

    /// A command by its index, if it is one: a message that repeats the serial number before it is none.
    fn sent(&self, index: usize) -> Option<Sent> {
        let point = self.serials.get(index)?;
        let before = index.checked_sub(1).and_then(|before| self.serials.get(before));
        if before.is_some_and(|before| before.value == point.value) {
            return None;
        }
        Some(Sent { at: point.stamp, serial: point.value, fate: self.fate(index, point) })
    }

    fn fate(&self, index: usize, sent: FieldPoint) -> Fate {
        if let Some(at) = self.echo(sent) {
            let latency_s = at.seconds_since(sent.stamp);
            return Fate::Echoed { at, latency_s, is_late: latency_s > self.limit_s };
        }
        let waited_s = self.known_to.seconds_since(sent.stamp);
        match self.serials.get(index + 1) {
            Some(next)
                if next.value != sent.value && next.stamp.seconds_since(sent.stamp) <= self.limit_s =>
            {
                Fate::Replaced
            }
            _ if waited_s <= self.limit_s => Fate::Waits,
            _ => Fate::Lost,
        }
    }

    /// The time of the first status that echoes a command.
    fn echo(&self, sent: FieldPoint) -> Option<Stamp> {
        let first = self.echoes.count_before(sent.stamp);
        let mut found = None;
        self.echoes.walk(
            first..self.echoes.len(),
            |part| sent.value < part.summary.min || sent.value > part.summary.max,
            |part| {
                if part.is_record() && part.first.value == sent.value {
                    found = Some(part.first.stamp);
                    return ControlFlow::Break(());
                }
                ControlFlow::Continue(())
            },
        );
        found
    }

    /// Name of the command that was sent at a time.
    fn name(&self, at: Stamp) -> &str {
        let index = self.names.points.count_until(at).checked_sub(1);
        let key = index.and_then(|index| self.names.points.get(index)).map(|point| point.value as i64);
        key.and_then(|key| self.names.names.get(&key)).map_or("?", |name| name)
    }
}

impl View for Ladder {
    fn title(&self, _frame: &Frame) -> String {
        "Commands".to_owned()
    }

    fn fields(&self) -> Vec<FieldRef> {
        self.fields.iter().flatten().cloned().collect()
    }

    fn save(&self) -> SavedState {
        serde_json::to_value(&self.saved).unwrap_or_default()
    }

    fn load(&mut self, saved: &SavedState) -> Result<(), serde_json::Error> {
        self.saved = serde_json::from_value(saved.clone())?;
        Ok(())
    }

    fn ui(&mut self, ui: &mut Ui, cx: &mut ViewContext<'_>) {
        let frame = cx.frame;
        let has_commands = |info: &&ProcessInfo| frame.topic(&info.command_buffer).is_some();
        let selected = cx.selection.process.as_deref();
        let process =
            frame.processes.iter().filter(has_commands).find(|info| selected == Some(info.name.as_str()));
        let Some(process) = process else {
            self.fields = None;
            let hint = "Select a process that is sent commands, in the hierarchy for example.";
            return widgets::empty(ui, icons::ICON_SWAP_VERT, "No process is selected", hint);
        };
        let fields = fields_of(process);
        self.fields.clone_from(&fields);
        self.toolbar(ui, process);
        let Some(shown) = fields.as_ref().and_then(|fields| Shown::of(frame, process, fields)) else {
            return widgets::empty(
                ui,
                icons::ICON_SWAP_VERT,
                "Reading…",
                "The commands of the run are read.",
            );
        };
        ladder(ui, cx, &shown, self.saved.span.range(frame));
        list(ui, cx, &shown);
    }
}

impl Ladder {
    fn toolbar(&mut self, ui: &mut Ui, process: &ProcessInfo) {
        let name = process.name.clone();
        let mut bar: Bar<'_, Saved> = Bar::new("toolbar");
        bar.left("process", Fit::Leaves(9), move |ui, _, _| {
            ui.label(egui::RichText::new(&name).color(tokens(ui).strong));
        });
        bar.right("span", Fit::Leaves(8), |ui, _, saved| {
            for (span, name) in Span::ALL {
                ui.selectable_value(&mut saved.span, span, name);
            }
        });
        toolbar::show(ui, bar, &mut self.saved);
    }
}

fn fields_of(process: &ProcessInfo) -> Option<[FieldRef; 3]> {
    let field =
        |topic: &str, path: &str| Some(FieldRef { topic: topic.to_owned(), path: path.parse().ok()? });
    let command = &process.command_buffer;
    Some([field(command, "serial")?, field(command, "name")?, field(&process.status_buffer, "echo_serial")?])
}

fn color(fate: Fate, tokens: &Tokens) -> Color32 {
    match fate {
        Fate::Echoed { is_late: false, .. } => tokens.ok,
        Fate::Echoed { .. } | Fate::Replaced => tokens.warning,
        Fate::Waits => tokens.accent,
        Fate::Lost => tokens.error,
    }
}

/// Commands on the upper rail, echoes on the lower one.
fn ladder(ui: &mut Ui, cx: &mut ViewContext<'_>, shown: &Shown<'_>, [from, to]: [Stamp; 2]) {
    let tokens = tokens(ui);
    let (rect, response) = ui.allocate_exact_size(Vec2::new(ui.available_width(), LADDER), Sense::click());
    response.widget_info(|| WidgetInfo::labeled(Role::Image, true, "Commands and their echoes over time"));
    let painter = ui.painter_at(rect);
    painter.rect_filled(rect, 0.0, tokens.canvas());
    let inner = rect.shrink2(Vec2::new(56.0, RAIL));
    let span_s = to.seconds_since(from).max(1e-9);
    let x =
        |at: Stamp| inner.left() + inner.width() * (at.seconds_since(from) / span_s).clamp(-0.1, 1.1) as f32;
    for (y, name) in [(inner.top(), "sent"), (inner.bottom(), "echoed")] {
        painter.hline(rect.left() + 52.0..=rect.right(), y, Stroke::new(1.0, tokens.line));
        let place = Rect::from_center_size(Pos2::new(rect.left() + 28.0, y), Vec2::new(48.0, 16.0));
        widgets::cell(ui, place, Align::Max, name, FontId::proportional(11.0), tokens.weak);
    }
    let last = shown.serials.count_until(to);
    // A command from before the range may be echoed in it.
    let first = shown.serials.count_until(from).saturating_sub(1).max(last.saturating_sub(MOST));
    let mut free_from = f32::NEG_INFINITY;
    for sent in (first..last).filter_map(|index| shown.sent(index)) {
        let color = color(sent.fate, tokens);
        let top = Pos2::new(x(sent.at), inner.top());
        match sent.fate {
            Fate::Echoed { at, .. } => {
                let bottom = Pos2::new(x(at), inner.bottom());
                painter.line_segment([top, bottom], Stroke::new(1.5, color));
                painter.circle_filled(bottom, 2.5, color);
            }
            Fate::Waits | Fate::Replaced | Fate::Lost => {
                let end = top + Vec2::new(0.0, 0.5 * inner.height());
                painter.line_segment([top, end], Stroke::new(1.5, color));
                let icon =
                    if sent.fate == Fate::Waits { icons::ICON_HOURGLASS_EMPTY } else { icons::ICON_CLOSE };
                widgets::icon_at(&painter, end, icon, 12.0, color);
            }
        }
        painter.circle_filled(top, 2.5, color);
        // Names stand above the rail where there is room for them.
        if top.x >= free_from && rect.contains(top) {
            let name = shown.name(sent.at).to_owned();
            let galley = painter.layout_no_wrap(name, FontId::proportional(11.0), tokens.text);
            free_from = top.x + galley.size().x + 8.0;
            painter.galley(Pos2::new(top.x, top.y - galley.size().y - 2.0), galley, tokens.text);
        }
    }
    painter.vline(x(cx.frame.now), rect.y_range(), Stroke::new(1.0, tokens.accent));
    if let Some(at) = response.interact_pointer_pos().filter(|_| response.clicked()) {
        // As on the timeline and in plots, a click on an axis of time goes on playing from there.
        let part = f64::from((at.x - inner.left()) / inner.width().max(1.0)).clamp(0.0, 1.0);
        cx.controls.push(Control::Seek(from.after_ns((part * span_s * 1e9) as u64)));
    }
}

/// All commands, the newest first.
fn list(ui: &mut Ui, cx: &mut ViewContext<'_>, shown: &Shown<'_>) {
    let tokens = tokens(ui);
    header(ui);
    ui.spacing_mut().item_spacing.y = 0.0;
    let count = shown.serials.len();
    ScrollArea::vertical().auto_shrink(false).show_rows(ui, ROW, count, |ui, range| {
        let mut names = widgets::RowNames::default();
        for index in range.map(|row| count - 1 - row) {
            let size = Vec2::new(ui.available_width(), ROW);
            let Some(point) = shown.serials.get(index) else {
                ui.allocate_space(size);
                continue;
            };
            // The next command moves all rows.
            let name = (point.stamp, point.value.to_bits());
            let (rect, response) = names.named(ui, name, |ui| ui.allocate_exact_size(size, Sense::click()));
            let name = shown.name(point.stamp);
            let sent = shown.sent(index);
            let echo = match sent.as_ref().map(|sent| sent.fate) {
                None => "repeated".to_owned(),
                Some(Fate::Echoed { is_late: false, .. }) => "in time".to_owned(),
                Some(Fate::Echoed { .. }) => "late".to_owned(),
                Some(Fate::Waits) => "waits".to_owned(),
                Some(Fate::Replaced) => "replaced".to_owned(),
                Some(Fate::Lost) => "lost".to_owned(),
            };
            response.widget_info(|| {
                WidgetInfo::labeled(Role::Button, true, format!("Command {name} {}: {echo}", point.value))
            });
            if response.hovered() {
                ui.painter().rect_filled(rect, 0.0, tokens.surface[2]);
            }
            if response.clicked() {
                cx.controls.extend(Control::pause_at(point.stamp));
            }
            let ink = if point.stamp > cx.frame.now { tokens.weak } else { tokens.text };
            let latency = match sent.as_ref().map(|sent| sent.fate) {
                Some(Fate::Echoed { latency_s, .. }) => format!("{:.1} ms", latency_s * 1e3),
                _ => "–".to_owned(),
            };
            let of_fate = sent.map_or(tokens.weak, |sent| color(sent.fate, tokens));
            let cells = [
                (name.to_owned(), ink),
                (format!("{}", point.value), ink),
                (latency, ink),
                (echo, of_fate),
                (format::elapsed(point.stamp.seconds_since(cx.frame.info.start)), ink),
            ];
            for (index, (place, (text, color))) in places(rect).into_iter().zip(cells).enumerate() {
                let align = if index == 0 { Align::Min } else { Align::Max };
                let font = if index == 0 { FontId::proportional(13.0) } else { FontId::monospace(11.5) };
                widgets::cell(ui, place, align, &text, font, color);
            }
        }
    });
}

fn header(ui: &mut Ui) {
    let (rect, _) = ui.allocate_exact_size(Vec2::new(ui.available_width(), ROW), Sense::hover());
    let names = std::iter::once("command").chain(COLUMNS.map(|(name, _)| name));
    for (index, (place, name)) in places(rect).into_iter().zip(names).enumerate() {
        let align = if index == 0 { Align::Min } else { Align::Max };
        widgets::cell(ui, place, align, name, FontId::proportional(11.0), tokens(ui).weak);
    }
}

/// Places of the cells of a row: the first has the room that the others leave.
fn places(rect: Rect) -> Vec<Rect> {
    let rect = rect.shrink2(Vec2::new(8.0, 0.0));
    let mut right = rect.right();
    let mut places = Vec::new();
    for (_, width) in COLUMNS.iter().rev() {
        places.push(Rect::from_x_y_ranges(right - width..=right, rect.y_range()));
        right -= width + 6.0;
    }
    places.push(Rect::from_x_y_ranges(rect.left()..=right.max(rect.left() + 1.0), rect.y_range()));
    places.reverse();
    places
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples;
    use crate::view::Selection;
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;
    use rcs_formula::Points;
    use rcs_runtime::source::series_of;
    use std::cell::RefCell;
    use std::collections::BTreeMap;
    use std::sync::Arc;

    fn at(ms: u64) -> Stamp {
        Stamp(ms * 1_000_000)
    }

    fn series(points: &[(u64, f64)]) -> Series<FieldPoint> {
        let (stamps, values): (Vec<_>, Vec<_>) = points.iter().map(|&(ms, value)| (at(ms), value)).unzip();
        series_of(&Points::new(stamps, values))
    }

    #[test]
    fn every_fate_of_a_command_is_told_apart() {
        // Statuses every 10 ms up to 10 s; the process obeys 1 at once, 2 after a second, never 3, 4 or 6.
        let echo = |ms: u64| match ms {
            0..110 => 0.0,
            110..2000 => 1.0,
            2000..5010 => 2.0,
            _ => 5.0,
        };
        let echoes: Vec<(u64, f64)> = (0..1000).map(|i| (i * 10, echo(i * 10))).collect();
        let sent = [(100, 1.0), (1000, 2.0), (1500, 2.0), (3000, 3.0), (5000, 4.0), (5005, 5.0), (9995, 6.0)];
        let (serials, echoes) = (series(&sent), series(&echoes));
        let names = FieldSeries {
            field: FieldRef { topic: "/a/command".into(), path: "name".parse().unwrap() },
            run: RunTag::Recorded,
            points: series(&[(100, 0.0), (1000, 1.0)]),
            names: Arc::new(BTreeMap::from([(0, "RUN".into()), (1, "PLAN_TO".into())])),
            states: Arc::default(),
            reading: None,
            problem: None,
        };
        let shown =
            Shown { serials: &serials, names: &names, echoes: &echoes, limit_s: 0.13, known_to: at(10_000) };
        let fate = |index: usize| shown.sent(index).map(|sent| sent.fate);
        let echoed =
            |ms: u64, latency_s: f64, is_late: bool| Some(Fate::Echoed { at: at(ms), latency_s, is_late });
        assert_eq!(fate(0), echoed(110, 0.01, false));
        assert_eq!(fate(1), echoed(2000, 1.0, true));
        assert_eq!(fate(2), None, "it repeats the one before");
        assert_eq!(fate(3), Some(Fate::Lost));
        assert_eq!(fate(4), Some(Fate::Replaced));
        assert_eq!(fate(5), echoed(5010, 0.005, false));
        assert_eq!(fate(6), Some(Fate::Waits));
        assert_eq!((shown.name(at(500)), shown.name(at(3000)), shown.name(at(0))), ("RUN", "PLAN_TO", "?"));
    }

    #[test]
    fn an_echo_is_found_in_a_long_series_as_by_looking_at_every_status() {
        let points: Vec<(u64, f64)> = (0..20_000).map(|i| (i, (i / 777) as f64)).collect();
        let echoes = series(&points);
        let serials = series(&[(0, 0.0)]);
        let names = FieldSeries {
            field: FieldRef { topic: "/a".into(), path: "name".parse().unwrap() },
            run: RunTag::Recorded,
            points: series(&[]),
            names: Arc::default(),
            states: Arc::default(),
            reading: None,
            problem: None,
        };
        let shown =
            Shown { serials: &serials, names: &names, echoes: &echoes, limit_s: 1.0, known_to: at(20_000) };
        for (ms, value) in [(0, 0.0), (5, 3.0), (4000, 5.0), (4000, 3.0), (19_999, 25.0), (3, 99.0)] {
            let plain =
                points.iter().find(|point| point.0 >= ms && point.1 == value).map(|point| at(point.0));
            assert_eq!(shown.echo(FieldPoint { stamp: at(ms), value }), plain, "{value} from {ms}");
        }
    }

    #[test]
    fn a_press_on_a_command_goes_to_no_other_one_although_the_next_one_is_sent_before_the_release() {
        let frame = samples::empty();
        let first = [(1000, 1.0), (2000, 2.0)];
        let names = FieldSeries {
            field: FieldRef { topic: "/a".into(), path: "name".parse().unwrap() },
            run: RunTag::FIRST,
            points: series(&[]),
            names: Arc::default(),
            states: Arc::default(),
            reading: None,
            problem: None,
        };
        let echoes = series(&[]);
        let next = [(1000, 1.0), (2000, 2.0), (3000, 3.0)];
        for then in [&first[..], &next[..]] {
            let (sent, asked) = (RefCell::new(series(&first)), RefCell::new(Vec::<Control>::new()));
            let mut harness = Harness::builder()
                .with_size(Vec2::new(600.0, 200.0))
                .with_context_setup(ocu_ui::install)
                .build_ui(|ui| {
                    let serials = sent.borrow();
                    let shown = Shown {
                        serials: &serials,
                        names: &names,
                        echoes: &echoes,
                        limit_s: 1.0,
                        known_to: at(10_000),
                    };
                    let (mut selection, mut wishes) = (Selection::default(), Vec::new());
                    let mut controls = asked.borrow_mut();
                    let mut cx = ViewContext {
                        frame: &frame,
                        controls: &mut controls,
                        selection: &mut selection,
                        wishes: &mut wishes,
                    };
                    list(ui, &mut cx, &shown);
                });
            harness.run();
            let place = harness.get_by_label_contains("Command ? 2").rect().center();
            harness.drag_at(place);
            harness.step();
            *sent.borrow_mut() = series(then);
            harness.step();
            harness.drop_at(place);
            harness.step();
            drop(harness);
            let to = asked.into_inner().into_iter().find_map(|control| match control {
                Control::Seek(to) => Some(to),
                _ => None,
            });
            assert_eq!(to, Some(at(2000)), "{} commands", then.len());
        }
    }
}
