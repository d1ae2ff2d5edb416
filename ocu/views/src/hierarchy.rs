//! Hierarchy view: every process as a box below its supervisor, from the process list and the status buffers.
//!
//! The colour of a box and the word in it have the same meaning. The line to the supervisor is highlighted in red for a
//! moment after a command, and brightened after a status.

use crate::view::{Hover, View, ViewContext};
use egui::{Align, Color32, FontId, Pos2, Rect, Role, ScrollArea, Sense, Stroke, Ui, Vec2, WidgetInfo};
use ocu_ui::{Tokens, format, icons, tokens, widgets};
use rcs_msg::rcs::{Command, ProcessInfo, ProcessState, ProcessTiming, Status, Timing};
use rcs_runtime::source::Frame;
use std::collections::BTreeMap;

const BOX: Vec2 = Vec2::new(200.0, 92.0);
const GAP: Vec2 = Vec2::new(20.0, 40.0);
const MARGIN: f32 = 16.0;
/// How long a line stays highlighted, in seconds of source time.
const MOMENT_S: f64 = 0.3;

/// The hierarchy view. It has no state.
#[derive(Default)]
pub(crate) struct Hierarchy;

/// Appearance of a box: its colour and its word.
#[derive(Clone, Debug, PartialEq)]
struct Look {
    fill: Color32,
    word: String,
}

fn look(process: &ProcessInfo, status: Option<&Status>, age_s: Option<f64>, connected: bool) -> Look {
    let rgb = Color32::from_rgb;
    let (fill, word) = match (connected, status, age_s) {
        (false, ..) => (rgb(150, 156, 160), "NOT CONNECTED".to_owned()),
        (_, Some(_), Some(age_s)) if age_s > limit_s(process) => {
            (rgb(236, 200, 66), format!("NO STATUS {}", format::age(age_s)))
        }
        (_, Some(status), _) => match status.state() {
            ProcessState::Uninitialized => (rgb(238, 160, 190), "UNINITIALIZED".to_owned()),
            ProcessState::Exec => (rgb(92, 184, 108), "EXEC".to_owned()),
            ProcessState::Done => (rgb(240, 242, 243), "DONE".to_owned()),
            ProcessState::Error => (rgb(226, 84, 76), "ERROR".to_owned()),
        },
        (_, None, _) => (rgb(238, 160, 190), "NOT RUNNING".to_owned()),
    };
    Look { fill, word }
}

/// The age from which a status is outdated: three periods, at least a second, and a margin.
fn limit_s(process: &ProcessInfo) -> f64 {
    (process.period_ns as f64 * 3e-9).max(1.2)
}

impl View for Hierarchy {
    fn title(&self, _frame: &Frame) -> String {
        "Hierarchy".to_owned()
    }

    fn ui(&mut self, ui: &mut Ui, cx: &mut ViewContext<'_>) {
        if cx.frame.processes.is_empty() {
            let hint = "Open a stack, or a log that a stack recorded; a plain log has none.";
            return widgets::empty(ui, icons::ICON_ACCOUNT_TREE, "No processes", hint);
        }
        let placed = place(&cx.frame.processes, ui.available_width() - 2.0 * MARGIN);
        let size = placed.iter().fold(Vec2::ZERO, |size, at| size.max(at.to_vec2() + BOX));
        ScrollArea::both().auto_shrink(false).show(ui, |ui| {
            let margin = Vec2::splat(MARGIN);
            let room = ui.available_size();
            let area = (size + 2.0 * margin).max(room);
            let (rect, _) = ui.allocate_exact_size(area, Sense::hover());
            let left = ((area.x - size.x) / 2.0).floor();
            let origin = rect.min + Vec2::new(left, margin.y);
            let boxes: Vec<_> =
                placed.iter().map(|at| Rect::from_min_size(origin + at.to_vec2(), BOX)).collect();
            lines(ui, cx.frame, &boxes);
            for (process, rect) in cx.frame.processes.iter().zip(&boxes) {
                process_box(ui, cx, process, *rect);
            }
        });
    }
}

/// Top left corner of the box of each process: below its supervisor, which is centred above its children. Processes on
/// a single level wrap into several rows where `room` is insufficient.
fn place(processes: &[ProcessInfo], room: f32) -> Vec<Pos2> {
    let index: BTreeMap<&str, usize> =
        processes.iter().enumerate().map(|(i, p)| (p.name.as_str(), i)).collect();
    let mut children = vec![Vec::new(); processes.len()];
    let mut roots = Vec::new();
    for (i, process) in processes.iter().enumerate() {
        match index.get(process.supervisor.as_str()) {
            Some(&supervisor) if supervisor != i && !above(processes, &index, i, supervisor) => {
                children[supervisor].push(i);
            }
            _ => roots.push(i),
        }
    }
    let mut at = vec![Pos2::ZERO; processes.len()];
    if roots.len() == processes.len() {
        let columns = ((room + GAP.x) / (BOX.x + GAP.x)).max(1.0) as usize;
        let step = BOX + Vec2::splat(GAP.x);
        return (0..roots.len())
            .map(|i| (Vec2::new((i % columns) as f32, (i / columns) as f32) * step).to_pos2())
            .collect();
    }
    let mut right = 0.0;
    for root in roots {
        place_tree(root, 0, &children, &mut at, &mut right);
    }
    at
}

/// Whether `process` is among the supervisors of `of`. A damaged process list may contain a cycle.
fn above(processes: &[ProcessInfo], index: &BTreeMap<&str, usize>, process: usize, of: usize) -> bool {
    let mut at = of;
    for _ in 0..processes.len() {
        if at == process {
            return true;
        }
        match index.get(processes[at].supervisor.as_str()) {
            Some(&next) => at = next,
            None => return false,
        }
    }
    true
}

fn place_tree(node: usize, depth: usize, children: &[Vec<usize>], at: &mut [Pos2], right: &mut f32) {
    let y = depth as f32 * (BOX.y + GAP.y);
    for &child in &children[node] {
        place_tree(child, depth + 1, children, at, right);
    }
    let x = if let [first, .., last] | [first @ last] = children[node][..] {
        f32::midpoint(at[first].x, at[last].x)
    } else {
        *right += BOX.x + GAP.x;
        *right - BOX.x - GAP.x
    };
    at[node] = Pos2::new(x, y);
}

fn lines(ui: &Ui, frame: &Frame, boxes: &[Rect]) {
    let tokens = tokens(ui);
    for (process, rect) in frame.processes.iter().zip(boxes) {
        let Some(supervisor) = frame.processes.iter().position(|other| other.name == process.supervisor)
        else {
            continue;
        };
        let moment = |buffer: &str| {
            let age_s = frame.topic(buffer).and_then(|topic| topic.age_s(frame.now));
            age_s.is_some_and(|age_s| (0.0..MOMENT_S).contains(&age_s))
        };
        let stroke = if moment(&process.command_buffer) {
            Stroke::new(2.0, tokens.error)
        } else if moment(&process.status_buffer) {
            Stroke::new(1.5, tokens.strong)
        } else {
            Stroke::new(1.5, tokens.unknown)
        };
        let (top, bottom) = (boxes[supervisor].center_bottom(), rect.center_top());
        let middle = f32::midpoint(top.y, bottom.y);
        let corners = vec![top, Pos2::new(top.x, middle), Pos2::new(bottom.x, middle), bottom];
        ui.painter().add(egui::Shape::line(corners, stroke));
    }
}

fn process_box(ui: &mut Ui, cx: &mut ViewContext<'_>, process: &ProcessInfo, rect: Rect) {
    let tokens = tokens(ui);
    let frame = cx.frame;
    let status = frame.status(process);
    let age_s = frame.topic(&process.status_buffer).and_then(|topic| topic.age_s(frame.now));
    let supervised = process.supervisor.is_empty()
        || process.supervisor == rcs_runtime::VIEWER
        || frame.processes.iter().any(|other| other.name == process.supervisor);
    let look = look(process, status, age_s, supervised);
    let chosen = cx.selection.process.as_deref() == Some(process.name.as_str());
    let response = ui.interact(rect, ui.scope_id().with(("process", &process.name)), Sense::click());
    let name = format!("Process {}: {}", process.name, look.word);
    response.widget_info(|| WidgetInfo::selected(Role::Button, true, chosen, &name));
    if response.clicked() {
        cx.selection.process = Some(process.name.as_str().into());
    }
    if response.hovered() {
        let process = Some(process.name.as_str().into());
        cx.selection.hovered.set(Hover { process, ..Hover::default() });
    }
    let is_meant = cx.selection.hovered.get().process.as_deref() == Some(process.name.as_str());
    let edge = match (chosen, response.hovered() || is_meant) {
        (true, _) => Stroke::new(2.0, tokens.accent),
        (_, true) => Stroke::new(1.0, tokens.text),
        _ => Stroke::new(1.0, tokens.line),
    };
    ui.painter().rect(rect, 3.0, tokens.surface[2], edge, egui::StrokeKind::Inside);
    let head = Rect::from_min_size(rect.min, Vec2::new(rect.width(), 24.0)).shrink(edge.width);
    ui.painter().rect_filled(head, egui::CornerRadius { nw: 2, ne: 2, sw: 0, se: 0 }, look.fill);
    let ink = Color32::from_rgb(16, 20, 22);
    let word_font = FontId::proportional(11.0);
    let word_width = ui.painter().layout_no_wrap(look.word.clone(), word_font.clone(), ink).size().x;
    let (left, right) = (head.left() + 8.0, head.right() - 8.0);
    let title = Rect::from_x_y_ranges(left..=right - word_width - 8.0, head.y_range());
    widgets::cell(ui, title, Align::Min, &process.name, FontId::proportional(13.0), ink);
    let word = Rect::from_x_y_ranges(left..=right, head.y_range());
    widgets::cell(ui, word, Align::Max, &look.word, word_font, ink);
    body(ui, tokens, rect, frame, process, status);
    response.on_hover_ui(|ui| details(ui, frame, process, status));
}

fn body(ui: &Ui, tokens: &Tokens, rect: Rect, frame: &Frame, process: &ProcessInfo, status: Option<&Status>) {
    let line = |i: usize| {
        let top = rect.top() + 28.0 + 20.0 * i as f32;
        Rect::from_min_max(Pos2::new(rect.left() + 8.0, top), Pos2::new(rect.right() - 8.0, top + 20.0))
    };
    let small = FontId::proportional(12.0);
    let mono = FontId::monospace(11.5);
    let Some(status) = status else {
        widgets::cell(ui, line(0), Align::Min, &process.summary, small, tokens.weak);
        return;
    };
    let sent = frame.topic(&process.command_buffer).and_then(|topic| topic.get::<Command>());
    let command = if status.command.is_empty() { "no command" } else { &status.command };
    widgets::cell(ui, line(0), Align::Min, command, FontId::proportional(13.0), tokens.strong);
    let (serial, waiting) = match sent {
        Some(sent) => {
            (format!("serial {} echo {}", sent.serial, status.echo_serial), sent.serial != status.echo_serial)
        }
        None => (format!("echo {}", status.echo_serial), false),
    };
    let color = if waiting { tokens.warning } else { tokens.weak };
    widgets::cell(ui, line(0), Align::Max, &serial, mono.clone(), color);
    widgets::cell(ui, line(1), Align::Min, &status.state_text, small, tokens.text);
    widgets::cell(ui, line(2), Align::Min, &format!("cycle {}", status.cycle), mono.clone(), tokens.weak);
    if status.faults > 0 {
        let text = format!("{} faults", status.faults);
        widgets::cell(ui, line(2), Align::Max, &text, mono, tokens.warning);
    }
}

fn details(ui: &mut Ui, frame: &Frame, process: &ProcessInfo, status: Option<&Status>) {
    let tokens = tokens(ui);
    ui.label(egui::RichText::new(&process.name).color(tokens.strong));
    ui.label(&process.summary);
    let mut line = |name: &str, value: &str| {
        if !value.is_empty() {
            widgets::name_value(ui, 72.0, name, egui::RichText::new(value));
        }
    };
    line("plugin", &process.plugin);
    line("supervisor", &process.supervisor);
    line("period", &format!("{} ms", format::number(process.period_ns as f64 * 1e-6)));
    if let Some(status) = status {
        line("state", &status.state_text);
        line("set at", &status.source_line);
        line("last fault", &status.last_fault);
    }
    let ports = |ports: &[rcs_msg::rcs::PortInfo]| {
        ports.iter().map(|port| port.buffer.as_str()).collect::<Vec<_>>().join("  ")
    };
    line("reads", &ports(&process.inputs));
    line("writes", &ports(&process.outputs));
    let timings = frame.topics_of_type("rcs.Timing").find_map(|topic| topic.get::<Timing>());
    let timing = timings.and_then(|all| all.processes.iter().find(|timing| timing.process == process.name));
    for (name, value) in timing.map(measured).unwrap_or_default() {
        line(name, &value);
    }
}

/// Measured times of a process, one per line; wake-up and waiting times exist only in live runs.
fn measured(timing: &ProcessTiming) -> Vec<(&'static str, String)> {
    let ms = |us: f64| format!("{} ms", format::number((us * 0.1).round() * 0.01));
    let mut lines = vec![("computes", format!("mean {}, max {}", ms(timing.mean_us), ms(timing.max_us)))];
    if timing.start_late_p99_us > 0.0 {
        let late = (ms(timing.wake_late_p99_us), ms(timing.wake_late_max_us));
        lines.push(("wakes late", format!("99 % {}, max {}", late.0, late.1)));
        let lock = (ms(timing.lock_wait_p99_us), ms(timing.lock_wait_max_us));
        lines.push(("waits", format!("99 % {}, max {}", lock.0, lock.1)));
    }
    if timing.overruns > 0 {
        let missed =
            if timing.missed > 0 { format!(", {} cycles missed", timing.missed) } else { String::new() };
        lines.push(("overruns", format!("{}{missed}", timing.overruns)));
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    fn process(name: &str, supervisor: &str) -> ProcessInfo {
        ProcessInfo {
            name: name.into(),
            supervisor: supervisor.into(),
            period_ns: 100_000_000,
            ..ProcessInfo::default()
        }
    }

    #[test]
    fn waking_and_waiting_are_told_where_they_were_measured() {
        let stepped = ProcessTiming { mean_us: 1234.0, max_us: 20_000.0, ..ProcessTiming::default() };
        assert_eq!(measured(&stepped), [("computes", "mean 1.23 ms, max 20 ms".to_owned())]);
        let live = ProcessTiming {
            wake_late_p99_us: 60.0,
            wake_late_max_us: 1000.0,
            start_late_p99_us: 80.0,
            overruns: 2,
            missed: 3,
            ..stepped
        };
        let lines: Vec<_> =
            measured(&live).into_iter().map(|(name, value)| format!("{name}: {value}")).collect();
        assert_eq!(lines[1], "wakes late: 99 % 0.06 ms, max 1 ms");
        assert_eq!(lines[2..], ["waits: 99 % 0 ms, max 0 ms", "overruns: 2, 3 cycles missed"]);
    }

    #[test]
    fn a_supervisor_stands_over_the_middle_of_its_subordinates() {
        let at = place(
            &[process("a", "sup"), process("sup", ""), process("b", "sup"), process("alone", "nobody")],
            300.0,
        );
        assert_eq!(at[1].x, f32::midpoint(at[0].x, at[2].x));
        assert!(at[1].y < at[0].y && at[0].y == at[2].y);
        assert!(at[3].x >= at[2].x + BOX.x);
    }

    #[test]
    fn processes_that_supervise_each_other_are_all_placed() {
        let at = place(&[process("a", "b"), process("b", "a"), process("self", "self")], 300.0);
        assert_eq!(at.len(), 3);
        assert!(at.iter().all(|at| at.is_finite()));
    }

    #[test]
    fn processes_of_one_level_go_on_in_the_next_row() {
        let at = place(&["a", "b", "c"].map(|name| process(name, "viewer")), 450.0);
        assert_eq!((at[0].y, at[1].y, at[2].x), (0.0, 0.0, 0.0));
        assert!(at[1].x >= BOX.x && at[2].y >= BOX.y);
    }

    #[test]
    fn every_state_has_a_word_of_its_own() {
        let process = process("p", "");
        let of = |state: ProcessState| {
            let status = Status { state: state.into(), ..Status::default() };
            look(&process, Some(&status), Some(0.1), true).word
        };
        let mut words =
            [ProcessState::Uninitialized, ProcessState::Exec, ProcessState::Done, ProcessState::Error]
                .map(of)
                .to_vec();
        words.push(look(&process, None, None, true).word);
        words.push(look(&process, None, None, false).word);
        let old = Status { state: ProcessState::Exec.into(), ..Status::default() };
        words.push(look(&process, Some(&old), Some(2.0), true).word);
        assert_eq!(words.last().unwrap(), "NO STATUS 2.0 s");
        words.sort();
        words.dedup();
        assert_eq!(words.len(), 7);
    }
}
