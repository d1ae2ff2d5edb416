//! What a cell of a grid holds: the fused cost, a row for each source with the message that made it, a row for each part
//! with heights, and the rest.

use super::grid::Cells;
use super::layers::Layer;
use crate::tuning::in_force;
use egui::{RichText, Ui};
use ocu_ui::widgets::mono;
use ocu_ui::{format, tokens};
use rcs_msg::Stamp;
use rcs_runtime::source::{Frame, Topic};
use rcs_world::{Label, MapMessage, Source, Weights, weights_of};
use std::collections::BTreeSet;
use std::fmt::Display;

/// Widths of columns, characters.
const NAME: usize = 11;
const NUMBER: usize = 9;
const OF_SOURCE: usize = 8;

/// A cell of a grid at a moment.
pub(super) struct Content<'a> {
    pub(super) frame: &'a Frame,
    pub(super) cells: &'a Cells<'a>,
    pub(super) cell: [usize; 2],
    /// The weights with which the sources are fused, if it is a map that a process fuses.
    pub(super) weights: Option<Weights>,
    /// Whether these weights are being edited: the cell holds what was fused with those in force.
    pub(super) is_edited: bool,
}

/// The weights with which a layer was fused: those of the map itself, else those of the parameters of its process.
pub(super) fn weights(frame: &Frame, layer: &Layer<'_>) -> Option<Weights> {
    let topic = layer.topic.filter(|_| layer.is_map())?;
    if let Some(map) = topic.canonical()?.source::<MapMessage>() {
        return Some(map.options().weights.clone());
    }
    let process = frame.processes.iter().find(|process| *process.name == *topic.writer)?;
    weights_of(&in_force(frame, process)?)
}

/// A source, and the number of its message that changed the cell last.
pub(super) struct MadeBy {
    source: String,
    sequence: u64,
}

impl MadeBy {
    /// The topic of that message, which the process that writes the layer reads, and its number there.
    pub(super) fn message<'f>(&self, frame: &'f Frame, layer: &Layer<'_>) -> Option<(&'f Topic, u64)> {
        let writer = &layer.topic?.writer;
        let process = frame.processes.iter().find(|process| *process.name == **writer)?;
        let cost = format!("cost.{}", self.source);
        let states = |topic: &&Topic| {
            let message = topic.canonical();
            message.and_then(|message| Cells::new(message).ok()).is_some_and(|cells| cells.has(&cost))
        };
        let topic = process.inputs.iter().filter_map(|port| frame.topic(&port.buffer)).find(states)?;
        Some((topic, self.sequence))
    }
}

impl Content<'_> {
    fn value(&self, name: &str) -> Option<f64> {
        self.cells.read(name, self.cell)
    }

    /// The layer and the cell; `may_be_kept` says how to keep what is shown.
    pub(super) fn title(&self, ui: &mut Ui, layer: &str, may_be_kept: bool) {
        let [column, row] = self.cell;
        let keeps = if may_be_kept { "   click: keep" } else { "" };
        weak(ui, format!("{layer}  cell {column}, {row}{keeps}"));
    }

    /// The fused cost, if there is one, and by which source; returns the fields that it tells.
    pub(super) fn fused(&self, ui: &mut Ui) -> &'static [&'static str] {
        let Some(fused) = self.value("cost") else { return &[] };
        let confidence = self.value("confidence").map(|conf| format!("  conf {conf:3}")).unwrap_or_default();
        let place = self.value("source").unwrap_or(f64::NAN);
        let source = if place >= 0.0 { self.sources().nth(place as usize) } else { None };
        let by = source.map(|source| format!(" by {source}")).unwrap_or_default();
        let label = match self.value("label") {
            Some(label) if label == f64::from(Label::Ground as u8) => "  ground",
            Some(label) if label == f64::from(Label::Obstacle as u8) => "  obstacle",
            _ => "",
        };
        let cost = if fused > 250.0 { "unknown".to_owned() } else { format!("cost {fused:3}") };
        let name = fused_name(self.is_edited);
        ui.label(mono(format!("{name:<NAME$}{cost}{confidence}{label}{by}")));
        &["cost", "confidence", "source", "label"]
    }

    /// One line: the fused cost, or the first numbers.
    pub(super) fn brief(&self, ui: &mut Ui) {
        if self.fused(ui).is_empty() {
            let names = self.cells.names().take(3);
            let one = |name: &str| format!("{name} {}", self.value(name).map(short).unwrap_or_default());
            ui.label(mono(names.map(one).collect::<Vec<_>>().join("  ")));
        }
    }

    fn sources(&self) -> impl Iterator<Item = &str> {
        self.cells.names().filter_map(|name| name.strip_prefix("cost."))
    }

    /// Everything that the cell holds. What finds no room in `most_lines` is counted; what each source says, and by which
    /// message, always has room. Where sources can be clicked, returns the one that was.
    pub(super) fn show(&self, ui: &mut Ui, most_lines: usize, clickable: bool) -> Option<MadeBy> {
        let mut told: BTreeSet<String> = self.fused(ui).iter().map(|name| (*name).to_owned()).collect();
        let clicked = self.source_rows(ui, clickable, &mut told);
        self.change(ui, &mut told);
        // Position, title, fused cost, the heading of the sources and the time of the change take seven lines.
        let mut room = most_lines.saturating_sub(7 + self.sources().count());
        self.part_rows(ui, &mut room, &mut told);
        self.rest(ui, room, &told);
        clicked
    }

    /// A row for each source, with all fields that are named after sources: `cost.stereo`, `conf.stereo`, and its weight.
    fn source_rows(&self, ui: &mut Ui, clickable: bool, told: &mut BTreeSet<String>) -> Option<MadeBy> {
        let sources: Vec<&str> = self.sources().collect();
        let mut columns: Vec<&str> = Vec::new();
        for name in self.cells.names() {
            if let Some((column, source)) = name.split_once('.')
                && sources.contains(&source)
            {
                told.insert(name.to_owned());
                if !columns.contains(&column) && column != "seq" {
                    columns.push(column);
                }
            }
        }
        if sources.is_empty() {
            return None;
        }
        let weight = |source: &str| Some(self.weights.as_ref()?.get(Source::new(source).ok()?).weight);
        let last = self.weights.is_some().then_some("weight");
        let heading = in_columns(columns.iter().copied().chain(last), OF_SOURCE);
        ui.label(mono(format!("{:<NAME$}{heading}    frame", "")).color(tokens(ui).weak));
        let mut clicked = None;
        for source in sources {
            let number = |column: &str| match self.value(&format!("{column}.{source}")) {
                Some(cost) if column == "cost" && cost > 250.0 => "unknown".to_owned(),
                Some(0.0) if column == "model" => "none".to_owned(),
                Some(value) => short(value),
                None => String::new(),
            };
            let last = last.map(|_| weight(source).map(|weight| short(weight.into())).unwrap_or_default());
            let numbers = in_columns(columns.iter().map(|column| number(column)).chain(last), OF_SOURCE);
            let sequence = self.value(&format!("seq.{source}"));
            ui.horizontal(|ui| {
                ui.spacing_mut().item_spacing.x = 0.0;
                ui.label(mono(format!("{source:<NAME$}{numbers}  ")));
                match sequence.filter(|sequence| *sequence > 0.0) {
                    Some(sequence) if clickable => {
                        let help = format!("Go back to message {sequence} of {source}, which made this cell");
                        let link = ui.link(mono(format!("{sequence:7}")));
                        link.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Link, true, &help));
                        if link.on_hover_text(&help).clicked() {
                            let sequence = sequence as u64;
                            clicked = Some(MadeBy { source: source.to_owned(), sequence });
                        }
                    }
                    Some(sequence) => {
                        ui.label(mono(format!("{sequence:7}")));
                    }
                    None => {
                        let text = if sequence.is_some() { "  never" } else { "" };
                        ui.label(mono(text).color(tokens(ui).weak));
                    }
                }
            });
        }
        clicked
    }

    /// When the cell changed.
    fn change(&self, ui: &mut Ui, told: &mut BTreeSet<String>) {
        let [seconds, nanos] = ["updated_s", "updated_ns"].map(|name| self.value(name));
        let Some((seconds, nanos)) = seconds.zip(nanos) else { return };
        told.extend(["updated_s", "updated_ns"].map(str::to_owned));
        let changed = Stamp(seconds as u64 * 1_000_000_000 + nanos as u64);
        let text = if changed.0 == 0 {
            "never".to_owned()
        } else {
            let age = format::age(self.frame.now.seconds_since(changed));
            format!("{age} ago, at {}", format::clock(changed.0))
        };
        ui.label(mono(format!("{:<NAME$}{text}", "changed")));
    }

    /// A row for each part with several fields: `ground.mean`, `ground.count`.
    fn part_rows(&self, ui: &mut Ui, room: &mut usize, told: &mut BTreeSet<String>) {
        let pairs = || {
            let names = self.cells.names().filter(|name| !told.contains(*name));
            names.filter_map(|name| name.split_once('.'))
        };
        let (mut parts, mut columns): (Vec<&str>, Vec<&str>) = Default::default();
        for (part, column) in pairs() {
            if pairs().filter(|(other, _)| *other == part).count() < 2 {
                continue;
            }
            if !parts.contains(&part) {
                parts.push(part);
            }
            if !columns.contains(&column) {
                columns.push(column);
            }
        }
        if parts.is_empty() || *room < 1 + parts.len() {
            return;
        }
        *room -= 1 + parts.len();
        let heading = in_columns(columns.iter(), NUMBER);
        ui.label(mono(format!("{:<NAME$}{heading}", "")).color(tokens(ui).weak));
        for part in parts {
            let number = |column: &&str| {
                let name = format!("{part}.{column}");
                let text = self.value(&name).map(short).unwrap_or_default();
                told.insert(name);
                text
            };
            let numbers = in_columns(columns.iter().map(number), NUMBER);
            ui.label(mono(format!("{part:<NAME$}{numbers}")));
        }
    }

    /// The other fields, two on a line.
    fn rest(&self, ui: &mut Ui, room: usize, told: &BTreeSet<String>) {
        let rest: Vec<_> = self.cells.names().filter(|name| !told.contains(*name)).collect();
        let (listed, hidden) = rest.split_at(rest.len().min(2 * room));
        let width = listed.iter().map(|name| name.len()).max().unwrap_or(0).max(NAME - 1);
        for pair in listed.chunks(2) {
            let one = |name: &&str| {
                let number = self.value(name).map(short).unwrap_or_default();
                format!("{name:<width$} {number:<NUMBER$}")
            };
            let text = pair.iter().map(one).collect::<Vec<_>>().join(" ");
            ui.label(mono(text.trim_end()));
        }
        if !hidden.is_empty() {
            weak(ui, format!("{} numbers more in a larger map", hidden.len()));
        }
    }
}

/// Name of the fused cost in a cell: while weights are edited, the map shows another one than the cell holds.
fn fused_name(is_edited: bool) -> &'static str {
    if is_edited { "fused, in force  " } else { "fused" }
}

/// Texts in columns of this width.
fn in_columns<T: Display>(texts: impl Iterator<Item = T>, width: usize) -> String {
    texts.map(|text| format!("{text:>width$}")).collect::<Vec<_>>().concat()
}

fn weak(ui: &mut Ui, text: String) {
    let color = tokens(ui).weak;
    ui.label(RichText::new(text).small().color(color));
}

/// A number in a few characters; a dash where it is unknown.
fn short(value: f64) -> String {
    if value.is_nan() {
        return "–".to_owned();
    }
    if value != 0.0 && value.abs() < 1e-3 {
        return format!("{value:.0e}");
    }
    format::number((value * 1e3).round() / 1e3)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_fit_into_their_columns() {
        for (value, text) in [
            (f64::NAN, "–"),
            (0.0, "0"),
            (8.3733e-4, "8e-4"),
            (-0.17676, "-0.177"),
            (250.0, "250"),
            (26.0, "26"),
        ] {
            assert_eq!(short(value), text);
        }
        assert!(short(-123.456_789).len() < NUMBER);
    }

    #[test]
    fn the_cost_in_force_is_named_while_weights_are_edited() {
        assert_eq!(fused_name(false), "fused");
        assert!(fused_name(true).starts_with("fused, in force"));
    }
}
