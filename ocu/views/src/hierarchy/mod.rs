//! Hierarchy view: every process as a box below its supervisor, found from who writes whose command and status, with its
//! peers by data (Albus 2006a, 6.2, figure 15).
//!
//! The colour of a box and the word in it have the same meaning (`look.rs`). The line to the supervisor lights up red
//! after a command and white after a status, and fades. Data between peers are thin curves; those of the process under
//! the pointer are emphasized. Drag to move, scroll to zoom, double-click to fit; the menu of a box sends its commands.

mod faults;
mod layout;
mod look;

use crate::cached::Cached;
use crate::canvas::Viewport;
use crate::command;
use crate::edit;
use crate::toolbar;
use crate::view::{Hover, SavedState, View, ViewContext, Wish};
use egui::{Align, Color32, FontId, Painter, Pos2, Rect, Role, Sense, Shape, Stroke, Ui, Vec2, WidgetInfo};
use layout::{BOX, Places};
use look::{State, light, look};
use ocu_ui::bar::{self, Bar, Fit};
use ocu_ui::{Tokens, format, icons, short_name, tokens, widgets};
use rcs_msg::rcs::{Command, ProcessInfo, ProcessTiming, Status, Timing};
use rcs_runtime::source::{BufferInfo, Frame, Hierarchy as Found, Node, RunTag, SourceKind};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

const MARGIN: f32 = 16.0;
/// Range of the zoom; what fits is shown in its own size.
const ZOOM: [f64; 2] = [0.1, 2.0];
/// Below this zoom a box shows only its name and its state.
const READABLE: f32 = 0.5;
/// Height with room for both, points.
const TWO_LINES: f32 = 34.0;

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
struct Saved {
    /// Where it looks; `None` to fit everything.
    viewport: Option<Viewport>,
    /// Whether data between peers are drawn.
    peers: bool,
}

impl Default for Saved {
    fn default() -> Self {
        Self { viewport: None, peers: true }
    }
}

/// What the hierarchy is found from: the processes, and who writes which topic. It changes seldom.
struct Basis {
    processes: Arc<[ProcessInfo]>,
    topics: Vec<(Arc<str>, Arc<str>, RunTag)>,
}

impl Basis {
    fn of(frame: &Frame) -> Self {
        let topics = frame.topics.iter();
        let topics = topics.map(|topic| (Arc::clone(&topic.name), Arc::clone(&topic.writer), topic.run));
        Self { processes: Arc::clone(&frame.processes), topics: topics.collect() }
    }

    fn holds(&self, frame: &Frame) -> bool {
        let same = |known: &Arc<str>, other: &Arc<str>| Arc::ptr_eq(known, other) || known == other;
        // The list of processes is one for a whole run.
        Arc::ptr_eq(&self.processes, &frame.processes)
            && self.topics.len() == frame.topics.len()
            && self.topics.iter().zip(frame.topics.iter()).all(|((name, writer, run), topic)| {
                same(name, &topic.name) && same(writer, &topic.writer) && *run == topic.run
            })
    }
}

/// What a process has to do with the topics of a frame.
#[derive(Clone, Copy)]
struct Wires {
    /// The topics of its commands and its status, as indices.
    command: Option<usize>,
    status: Option<usize>,
    /// Whether its buffers and its supervisor are there.
    connected: bool,
}

/// The hierarchy with what it was found from.
struct Known {
    basis: Basis,
    found: Found,
    wires: Vec<Wires>,
    /// Where the boxes are, for a width of the room over its height.
    places: Cached<u32, Places>,
}

impl Known {
    fn of(frame: &Frame) -> Self {
        let buffers: Vec<BufferInfo> = frame.topics.iter().map(BufferInfo::of).collect();
        let found = Found::new(&frame.processes, &buffers, frame.info.kind != SourceKind::Log);
        let topic = |name: &str| {
            let named = frame.topics.iter().enumerate().filter(|(_, topic)| *topic.name == *name);
            named.max_by_key(|(_, topic)| topic.run).map(|(index, _)| index)
        };
        let wires = found.nodes.iter().map(|node| Wires {
            command: topic(&node.command),
            status: topic(&node.status),
            connected: is_connected(frame, &found, node),
        });
        let wires = wires.collect();
        Self { basis: Basis::of(frame), found, wires, places: Cached::default() }
    }
}

/// The hierarchy view.
#[derive(Default)]
pub(crate) struct Hierarchy {
    saved: Saved,
    known: Option<Known>,
}

/// What is needed to paint the boxes.
struct Scene<'a> {
    found: &'a Found,
    /// The names of all processes, from which a shortened one is told.
    names: Vec<&'a str>,
    wires: &'a [Wires],
    places: &'a Places,
    /// What is held by the operator, with the faults.
    held: &'a [rcs_msg::rcs::OverrideInForce],
    /// The boxes on the screen.
    boxes: Vec<Rect>,
    zoom: f32,
    painter: Painter,
}

impl View for Hierarchy {
    fn title(&self, _frame: &Frame) -> String {
        "Hierarchy".to_owned()
    }

    fn save(&self) -> SavedState {
        serde_json::to_value(&self.saved).unwrap_or_default()
    }

    fn load(&mut self, saved: &SavedState) -> Result<(), serde_json::Error> {
        self.saved = serde_json::from_value(saved.clone())?;
        self.saved.viewport = self.saved.viewport.filter(Viewport::is_valid);
        Ok(())
    }

    fn ui(&mut self, ui: &mut Ui, cx: &mut ViewContext<'_>) {
        let frame = cx.frame;
        let Self { saved, known } = self;
        let current = known.take().filter(|known| known.basis.holds(frame));
        let Known { found, wires, places, .. } = known.insert(current.unwrap_or_else(|| Known::of(frame)));
        if found.nodes.is_empty() {
            let hint = "Open a stack, or a recording that says who wrote its messages; this one does not.";
            return widgets::empty(ui, icons::ICON_ACCOUNT_TREE, "No processes", hint);
        }
        let mut bar: Bar<'_, Saved> = Bar::new("toolbar");
        bar.left("fit", Fit::Leaves(9), |ui, form, saved| {
            if bar::tool(ui, form, icons::ICON_FIT_SCREEN, "Fit everything").clicked() {
                saved.viewport = None;
            }
        });
        bar.left("peers", Fit::Leaves(8), |ui, form, saved| {
            bar::tool_toggle(ui, form, icons::ICON_SYNC_ALT, "Data between peers", &mut saved.peers);
        });
        toolbar::show(ui, bar, saved);
        let rect = ui.available_rect_before_wrap();
        let response = ui.allocate_rect(rect, Sense::click_and_drag());
        response.widget_info(|| WidgetInfo::labeled(Role::Pane, true, "Hierarchy of processes"));
        let shape = rect.width() / rect.height().max(1.0);
        let places = &*places.get(shape.to_bits(), || layout::place(&found.nodes, shape));
        let mut viewport = saved.viewport.unwrap_or_else(|| fitted(places, rect));
        if response.double_clicked() {
            saved.viewport = None;
        } else if viewport.interact(ui, &response, ZOOM, true) {
            saved.viewport = Some(viewport);
        }
        let at = |corner: Pos2| viewport.to_screen(rect, [f64::from(corner.x), f64::from(corner.y)]);
        let boxes = places.boxes.iter().map(|place| Rect::from_min_max(at(place.min), at(place.max)));
        let painter = ui.painter().with_clip_rect(rect.intersect(ui.clip_rect()));
        let (zoom, held) = (viewport.scale as f32, edit::overrides(frame));
        let names = found.nodes.iter().map(|node| &*node.name).collect();
        let scene = Scene { found, names, wires, places, held, boxes: boxes.collect(), zoom, painter };
        lines(cx, &scene, &at, tokens(ui));
        if saved.peers {
            peers(cx, &scene, tokens(ui));
        }
        for index in 0..found.nodes.len() {
            process_box(ui, cx, &scene, rect, index);
        }
    }
}

/// The viewport that shows everything, in its own size where it fits.
fn fitted(places: &Places, rect: Rect) -> Viewport {
    let size = [f64::from(places.size.x), f64::from(places.size.y)];
    let mut viewport = Viewport::fit([0.0; 2], size, rect, MARGIN, false);
    viewport.scale = viewport.scale.min(1.0);
    // What is lower than the room stands at its top.
    let free = f64::from(rect.height() - 2.0 * MARGIN) / viewport.scale - size[1];
    viewport.center[1] += free.max(0.0) / 2.0;
    viewport
}

/// The process that is meant: under the pointer in any view, else the chosen one.
fn meant(cx: &ViewContext<'_>) -> Option<Arc<str>> {
    cx.selection.hovered.get().process.clone().or_else(|| cx.selection.process.clone())
}

fn age_s(frame: &Frame, topic: Option<usize>) -> Option<f64> {
    frame.topics.get(topic?)?.age_s(frame.now)
}

/// The lines between supervisors and subordinates.
fn lines(cx: &ViewContext<'_>, scene: &Scene<'_>, at: &dyn Fn(Pos2) -> Pos2, tokens: &Tokens) {
    let mut drawn: Vec<(Vec<Pos2>, Stroke)> = Vec::new();
    for (index, node) in scene.found.nodes.iter().enumerate() {
        let Some(above) = node.supervisor else { continue };
        let wires = scene.wires[index];
        let ages = (age_s(cx.frame, wires.command), age_s(cx.frame, wires.status));
        let stroke = light(tokens, ages.0, ages.1);
        let places = scene.places;
        let corners = layout::line(places.boxes[above], places.boxes[index], places.in_block[index]);
        drawn.push((corners.into_iter().map(at).collect(), stroke));
    }
    // Lines share parts: a light is above a dark one.
    drawn.sort_by(|a, b| a.1.width.total_cmp(&b.1.width));
    for (corners, stroke) in drawn {
        scene.painter.add(Shape::line(corners, stroke));
    }
}

/// Data between peers: from the right side of the writer to the left side of the reader.
fn peers(cx: &ViewContext<'_>, scene: &Scene<'_>, tokens: &Tokens) {
    let meant = meant(cx);
    let is_meant = |index: usize| meant.as_ref().is_some_and(|meant| *meant == scene.found.nodes[index].name);
    for peer in &scene.found.peers {
        let (from, to) = (scene.boxes[peer.from], scene.boxes[peer.to]);
        let (a, b) = if from.center().x <= to.center().x {
            (from.right_center(), to.left_center())
        } else {
            (from.left_center(), to.right_center())
        };
        let bend = Vec2::new(0.0, 0.35 * scene.zoom * BOX.y);
        let emphasized = is_meant(peer.from) || is_meant(peer.to);
        let stroke = if emphasized {
            Stroke::new(1.5, tokens.accent)
        } else {
            Stroke::new(1.0, tokens.accent.gamma_multiply(0.28))
        };
        let points = [a, a + bend, b + bend, b];
        let curve =
            egui::epaint::CubicBezierShape::from_points_stroke(points, false, Color32::TRANSPARENT, stroke);
        scene.painter.add(curve);
        if emphasized {
            scene.painter.circle_filled(b, 3.0, tokens.accent);
        }
    }
}

/// Whether the buffers and the supervisor of a process are there.
fn is_connected(frame: &Frame, found: &Found, node: &Node) -> bool {
    let Some(process) = node.process.map(|index| &frame.processes[index]) else { return true };
    let supervised = process.supervisor.is_empty()
        || process.supervisor == rcs_runtime::VIEWER
        || found.index_of(&process.supervisor).is_some();
    supervised && node.unwritten.is_empty()
}

fn process_box(ui: &mut Ui, cx: &mut ViewContext<'_>, scene: &Scene<'_>, area: Rect, index: usize) {
    let (node, rect, zoom) = (&scene.found.nodes[index], scene.boxes[index], scene.zoom);
    if !rect.intersects(area) {
        return;
    }
    let tokens = tokens(ui);
    let frame = cx.frame;
    let process = node.process.map(|index| &frame.processes[index]);
    let wires = scene.wires[index];
    let status: Option<&Status> = wires.status.and_then(|topic| frame.topics.get(topic)?.get());
    let look = look(State {
        process,
        status,
        age_s: age_s(frame, wires.status),
        connected: wires.connected,
        is_before_recording: frame.is_before_recording(),
    });
    let chosen = cx.selection.process.as_ref() == Some(&node.name);
    let response =
        ui.interact(rect.intersect(area), ui.scope_id().with(("process", &node.name)), Sense::click());
    let name = format!("Process {}: {}", node.name, look.word);
    response.widget_info(|| WidgetInfo::selected(Role::Button, true, chosen, &name));
    if response.clicked() {
        cx.selection.process = Some(Arc::clone(&node.name));
    }
    if response.hovered() {
        cx.selection.hovered.set(Hover { process: Some(Arc::clone(&node.name)), ..Hover::default() });
    }
    let is_meant = cx.selection.hovered.get().process.as_ref() == Some(&node.name);
    let edge = match (chosen, response.hovered() || is_meant) {
        (true, _) => Stroke::new(2.0, tokens.accent),
        (_, true) => Stroke::new(1.0, tokens.text),
        _ => Stroke::new(1.0, tokens.line),
    };
    let painter = &scene.painter;
    painter.rect(rect, 3.0 * zoom, tokens.surface[2], edge, egui::StrokeKind::Inside);
    let ink = Color32::from_rgb(16, 20, 22);
    let name = |place: Rect, align: Align, font: FontId| {
        short_name::cell(painter, place, align, &node.name, &scene.names, &font, ink);
    };
    if zoom < READABLE {
        painter.rect_filled(rect.shrink(1.0), 2.0, look.fill);
        let inner = rect.shrink2(Vec2::new(4.0, 0.0));
        let font = FontId::proportional((30.0 * zoom).clamp(6.0, 13.0));
        if rect.height() < TWO_LINES {
            name(inner, Align::Center, font);
        } else {
            let (upper, lower) = inner.split_top_bottom_at_fraction(0.55);
            name(upper, Align::Center, font);
            widgets::cell_by(painter, lower, Align::Center, &look.word, FontId::proportional(10.0), ink);
        }
    } else {
        let head = Rect::from_min_size(rect.min, Vec2::new(rect.width(), 24.0 * zoom)).shrink(edge.width);
        painter.rect_filled(head, egui::CornerRadius { nw: 2, ne: 2, sw: 0, se: 0 }, look.fill);
        let word_font = FontId::proportional(11.0 * zoom);
        let inner = head.shrink2(Vec2::new(8.0 * zoom, 0.0));
        let word_width = widgets::cell_by(painter, inner, Align::Max, &look.word, word_font, ink);
        let title = inner.with_max_x(inner.right() - word_width - 8.0 * zoom);
        name(title, Align::Min, FontId::proportional(13.0 * zoom));
        body(tokens, frame, scene, index, status);
    }
    if let Some(process) = process {
        response.context_menu(|ui| commands(ui, cx, process));
        response.on_hover_ui(|ui| details(ui, frame, process, status, node));
    }
}

/// The commands of a process; one with parameters is prepared in the details view, from where it is sent.
fn commands(ui: &mut Ui, cx: &mut ViewContext<'_>, process: &ProcessInfo) {
    ui.label(egui::RichText::new(format!("Send to {}", process.name)).small().color(tokens(ui).weak));
    let refused = command::refusal(cx.frame);
    for info in &process.commands {
        let with_parameters = !info.parameters_schema.is_empty();
        let label = if with_parameters { format!("{}…", info.name) } else { info.name.clone() };
        let response = ui.add_enabled(refused.is_none(), egui::Button::new(label));
        let response = response.on_hover_text(&info.help).on_disabled_hover_text(refused.unwrap_or_default());
        if !response.clicked() {
            continue;
        }
        cx.selection.process = Some(process.name.as_str().into());
        if with_parameters {
            cx.wishes
                .push(Wish::Command { process: process.name.as_str().into(), command: info.name.clone() });
        } else {
            command::send(cx, process, &info.name, None);
        }
        ui.close();
    }
    if process.commands.is_empty() {
        ui.label("It has no commands.");
    }
    ui.separator();
    faults::menu(ui, cx, process, refused);
}

fn body(tokens: &Tokens, frame: &Frame, scene: &Scene<'_>, index: usize, status: Option<&Status>) {
    let Scene { painter, zoom, .. } = scene;
    let (node, rect, zoom) = (&scene.found.nodes[index], scene.boxes[index], *zoom);
    let line = |i: usize| {
        let top = rect.top() + zoom * (28.0 + 20.0 * i as f32);
        let (left, right) = (rect.left() + 8.0 * zoom, rect.right() - 8.0 * zoom);
        Rect::from_min_max(Pos2::new(left, top), Pos2::new(right, top + 20.0 * zoom))
    };
    let small = FontId::proportional(12.0 * zoom);
    let mono = FontId::monospace(11.5 * zoom);
    if let Some(absent) = node.unwritten.first() {
        widgets::cell_by(
            painter,
            line(0),
            Align::Min,
            "nobody writes its input",
            small.clone(),
            tokens.warning,
        );
        widgets::cell_by(painter, line(1), Align::Min, absent, small, tokens.warning);
        return;
    }
    let Some(status) = status else {
        let process = node.process.map(|index| &frame.processes[index]);
        let summary = process.map_or("publishes, says nothing of itself", |process| process.summary.as_str());
        widgets::cell_by(painter, line(0), Align::Min, summary, small, tokens.weak);
        return;
    };
    let sent = scene.wires[index].command.and_then(|topic| frame.topics.get(topic)?.get::<Command>());
    let command = if status.command.is_empty() { "no command" } else { &status.command };
    let (serial, waiting) = match sent {
        Some(sent) => {
            (format!("serial {} echo {}", sent.serial, status.echo_serial), sent.serial != status.echo_serial)
        }
        None => (format!("echo {}", status.echo_serial), false),
    };
    let color = if waiting { tokens.warning } else { tokens.weak };
    let serial_width = widgets::cell_by(painter, line(0), Align::Max, &serial, mono.clone(), color);
    let name = line(0).with_max_x(line(0).right() - serial_width - 6.0 * zoom);
    widgets::cell_by(painter, name, Align::Min, command, FontId::proportional(13.0 * zoom), tokens.strong);
    widgets::cell_by(painter, line(1), Align::Min, &status.state_text, small, tokens.text);
    widgets::cell_by(
        painter,
        line(2),
        Align::Min,
        &format!("cycle {}", status.cycle),
        mono.clone(),
        tokens.weak,
    );
    if let Some(fault) = faults::text(scene.held, &node.name) {
        widgets::cell_by(painter, line(2), Align::Max, &fault, mono, tokens.warning);
    } else if status.faults > 0 {
        let faults = format!("{} fault{}", status.faults, if status.faults == 1 { "" } else { "s" });
        widgets::cell_by(painter, line(2), Align::Max, &faults, mono, tokens.warning);
    }
}

fn details(ui: &mut Ui, frame: &Frame, process: &ProcessInfo, status: Option<&Status>, node: &Node) {
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
    line("missing", &node.unwritten.join("  "));
    line("period", &format!("{} ms", format::number(process.period_ns as f64 * 1e-6)));
    if let Some(status) = status {
        line("state", &status.state_text);
        line("set at", &status.source_line);
        line("last fault", &status.last_fault);
    }
    line("on demand", &faults::text(edit::overrides(frame), &node.name).unwrap_or_default());
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
}
