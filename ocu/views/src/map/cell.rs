//! What a cell of a grid holds: the fused cost, with what the weights of a preview give above it, a row for each source
//! with the message that made it, a row for each part with heights, and the rest.

use super::grid::Cells;
use super::layers::Layer;
use crate::tuning::in_force;
use egui::{RichText, Ui};
use ocu_ui::widgets::mono;
use ocu_ui::{format, tokens};
use rcs_msg::Stamp;
use rcs_runtime::source::{Frame, Topic};
use rcs_world::{Evidence, Fused, Label, MapMessage, Source, Weights, fuse, weights_of};
use std::collections::BTreeSet;
use std::fmt::Display;

/// Widths of columns, characters; that of the frame is with the gap before it.
const NAME: usize = 11;
const NUMBER: usize = 9;
const OF_SOURCE: usize = 8;
const FRAME: usize = 9;
/// The greatest cost.
const MOST_COST: f64 = rcs_world::MAX_COST as f64;
/// The fields of the fused cost, and those of the time at which the cell changed.
const FUSED: [&str; 4] = ["cost", "confidence", "source", "label"];
const CHANGED: [&str; 2] = ["updated_s", "updated_ns"];

/// A cell of a grid at a moment.
pub(super) struct Content<'a> {
    pub(super) frame: &'a Frame,
    pub(super) cells: &'a Cells<'a>,
    pub(super) cell: [usize; 2],
    /// The weights with which the sources are fused, if it is a map that a process fuses.
    pub(super) weights: Option<Weights>,
    /// Whether these weights are a preview: the cell holds what was fused with others.
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

/// What finds room on the map.
#[derive(Clone, Copy, Debug)]
pub(super) struct Room {
    /// Characters of the monospaced font in a line; at least one.
    pub(super) chars: usize,
    /// Lines that fit into the map.
    pub(super) lines: usize,
    /// Those of them that anything but the costs of sources may use.
    pub(super) usual: usize,
}

impl Room {
    /// Lines that a text takes.
    fn lines_of(&self, text: &str) -> usize {
        text.chars().count().div_ceil(self.chars.max(1)).max(1)
    }

    pub(super) fn take(&mut self, lines: usize) {
        self.lines = self.lines.saturating_sub(lines);
        self.usual = self.usual.saturating_sub(lines);
    }

    /// Writes a text in the monospaced font.
    pub(super) fn write(&mut self, ui: &mut Ui, text: &str) {
        self.take(self.lines_of(text));
        ui.label(mono(text));
    }

    fn write_weak(&mut self, ui: &mut Ui, text: &str) {
        self.take(self.lines_of(text));
        ui.label(RichText::new(text).small().color(tokens(ui).weak));
    }
}

/// The fields that were written, and the number of those that found no room beside others.
#[derive(Default)]
struct Told {
    names: BTreeSet<String>,
    hidden: usize,
}

impl Told {
    fn add<'n>(&mut self, names: impl IntoIterator<Item = &'n str>) {
        self.names.extend(names.into_iter().map(str::to_owned));
    }
}

impl Content<'_> {
    fn value(&self, name: &str) -> Option<f64> {
        self.cells.read(name, self.cell)
    }

    /// The fused cost, or the number that stands for an unknown one. Costs are bytes; a field of another type with such a
    /// name is a number like others.
    fn fused_cost(&self) -> Option<f64> {
        self.value("cost").filter(|_| self.cells.is_byte("cost"))
    }

    fn sources(&self) -> impl Iterator<Item = &str> {
        let costs = self.cells.names().filter(|name| self.cells.is_byte(name));
        costs.filter_map(|name| name.strip_prefix("cost."))
    }

    /// Whether a source has a cost or a confidence for the cell.
    fn knows(&self, source: &str) -> bool {
        self.value(&format!("cost.{source}")).is_some_and(is_cost)
            || self.value(&format!("conf.{source}")).is_some_and(|confidence| confidence > 0.0)
    }

    /// Whether the grid is one of costs, and has none for the cell.
    pub(super) fn is_unknown(&self) -> bool {
        let fused = self.fused_cost();
        let is_of_costs = fused.is_some() || self.sources().next().is_some();
        is_of_costs && !fused.is_some_and(is_cost) && !self.sources().any(|source| self.knows(source))
    }

    /// The layer and the cell; `may_be_kept` says how to keep what is shown.
    pub(super) fn title(&self, ui: &mut Ui, room: &mut Room, layer: &str, may_be_kept: bool) {
        let [column, row] = self.cell;
        let keeps = if may_be_kept { "   click: keep" } else { "" };
        room.write_weak(ui, &format!("{layer}  cell {column}, {row}{keeps}"));
    }

    /// What the sources of the cell give with the weights of a preview, by the rule by which the map is painted; `None`
    /// without one, or if the map cannot be fused.
    fn preview(&self) -> Option<Fused> {
        let weights = self.weights.as_ref().filter(|_| self.is_edited)?;
        let byte = |field: &str, source: Source| {
            let name = format!("{field}.{source}");
            self.value(&name).filter(|_| self.cells.is_byte(&name)).map(|value| value as u8)
        };
        let sources = self.sources().filter_map(|name| Source::new(name).ok());
        let said = sources.map(|source| {
            let (cost, confidence) = (byte("cost", source)?, byte("conf", source)?);
            let backing = byte("backing", source).unwrap_or(0);
            Some((source, Evidence { cost, confidence, backing, ..Evidence::NONE }))
        });
        let said: Vec<(Source, Evidence)> = said.collect::<Option<_>>()?;
        (!said.is_empty()).then(|| fuse(&said, weights))
    }

    /// The fused cost, if there is one, and by which source, below what the weights of a preview give; returns the
    /// fields that it tells.
    fn fused(&self, ui: &mut Ui, room: &mut Room) -> &'static [&'static str] {
        if let Some(fused) = self.preview().filter(|_| room.lines > 1) {
            let [cost, confidence, label] = [fused.cost, fused.confidence, fused.label as u8].map(f64::from);
            let source = fused.source.as_ref().map(Source::name);
            room.write(ui, &fused_line("preview", cost, Some(confidence), Some(label), source));
        }
        let Some(cost) = self.fused_cost() else { return &[] };
        let place = self.value("source").unwrap_or(f64::NAN);
        let source = if place >= 0.0 { self.sources().nth(place as usize) } else { None };
        room.write(ui, &fused_line("fused", cost, self.value("confidence"), self.value("label"), source));
        &FUSED
    }

    /// One line: the fused cost, or the first numbers.
    pub(super) fn brief(&self, ui: &mut Ui, room: &mut Room) {
        if self.fused(ui, room).is_empty() {
            let names = self.cells.names().take(3);
            let one = |name: &str| format!("{name} {}", self.value(name).map(short).unwrap_or_default());
            room.write(ui, &names.map(one).collect::<Vec<_>>().join("  "));
        }
    }

    /// Everything that the cell holds; of a cell that no source knows, what else is known of it. What finds no room is
    /// counted; what each source says, and by which message, comes first. Where sources can be clicked, returns the one
    /// that was.
    pub(super) fn show(&self, ui: &mut Ui, room: &mut Room, clickable: bool) -> Option<MadeBy> {
        let (mut told, mut clicked) = (Told::default(), None);
        let is_unknown = self.is_unknown();
        if is_unknown {
            room.write(ui, "unknown");
            let sources: Vec<&str> = self.sources().collect();
            self.columns(&sources, &mut told);
            told.add(FUSED.into_iter().chain(CHANGED));
        } else {
            told.add(self.fused(ui, room).iter().copied());
            clicked = self.source_rows(ui, room, clickable, &mut told);
            self.change(ui, room, &mut told);
        }
        self.part_rows(ui, room, &mut told);
        if is_unknown {
            let is_empty = |name: &&str| self.value(name).is_none_or(says_nothing);
            told.add(self.cells.names().filter(is_empty));
        }
        self.rest(ui, room, &told);
        clicked
    }

    /// The names of the numbers that sources have, without that of their message; all their fields are told.
    fn columns(&self, sources: &[&str], told: &mut Told) -> Vec<&str> {
        let mut columns: Vec<&str> = Vec::new();
        for name in self.cells.names() {
            if let Some((column, source)) = name.split_once('.')
                && sources.contains(&source)
            {
                told.add([name]);
                if !columns.contains(&column) && column != "seq" {
                    columns.push(column);
                }
            }
        }
        columns
    }

    /// A row for each source that knows the cell, with the fields that are named after sources: `cost.stereo`,
    /// `conf.stereo`, and its weight. On a narrow map the last columns are left out.
    fn source_rows(&self, ui: &mut Ui, room: &mut Room, clickable: bool, told: &mut Told) -> Option<MadeBy> {
        let sources: Vec<&str> = self.sources().collect();
        let mut columns = self.columns(&sources, told);
        let known: Vec<&str> = sources.into_iter().filter(|source| self.knows(source)).collect();
        // The heading, and the count of what finds no room, take a line each.
        let (shown, others) = known.split_at(known.len().min(room.lines.saturating_sub(2)));
        let count = columns.len();
        let has_frame = room.chars >= NAME + OF_SOURCE + FRAME;
        let fit = room.chars.saturating_sub(NAME + if has_frame { FRAME } else { 0 }) / OF_SOURCE;
        let has_weight = self.weights.is_some() && fit >= 2;
        columns.truncate(fit.saturating_sub(usize::from(has_weight)).max(1));
        told.hidden += others.len() * count + shown.len() * (count - columns.len());
        if shown.is_empty() {
            return None;
        }
        room.take(1 + shown.len());
        let heading = in_columns(columns.iter().copied().chain(has_weight.then_some("weight")), OF_SOURCE);
        let (frame, gap) = if has_frame { ("    frame", "  ") } else { ("", "") };
        ui.label(mono(format!("{:<NAME$}{heading}{frame}", "")).color(tokens(ui).weak));
        let mut clicked = None;
        for source in shown {
            let numbers = columns.iter().map(|column| self.number(column, source));
            let numbers = in_columns(numbers.chain(has_weight.then(|| self.weight(source))), OF_SOURCE);
            ui.horizontal(|ui| {
                ui.spacing_mut().item_spacing.x = 0.0;
                ui.label(mono(format!("{source:<NAME$}{numbers}{gap}")));
                if has_frame && let Some(sequence) = self.made_by(ui, source, clickable) {
                    clicked = Some(MadeBy { source: (*source).to_owned(), sequence });
                }
            });
        }
        clicked
    }

    /// A number of a source.
    fn number(&self, column: &str, source: &str) -> String {
        match self.value(&format!("{column}.{source}")) {
            Some(cost) if column == "cost" && cost > MOST_COST => "unknown".to_owned(),
            Some(0.0) if column == "model" => "none".to_owned(),
            Some(value) => short(value),
            None => String::new(),
        }
    }

    fn weight(&self, source: &str) -> String {
        let weight = |weights: &Weights| Some(weights.get(Source::new(source).ok()?).weight);
        self.weights.as_ref().and_then(weight).map(|weight| short(weight.into())).unwrap_or_default()
    }

    /// The number of the message of a source that changed the cell last; returned if it was clicked.
    fn made_by(&self, ui: &mut Ui, source: &str, clickable: bool) -> Option<u64> {
        let sequence = self.value(&format!("seq.{source}"));
        match sequence.filter(|sequence| *sequence > 0.0) {
            Some(sequence) if clickable => {
                let help = format!("Go back to message {sequence} of {source}, which made this cell");
                let link = ui.link(mono(format!("{sequence:7}")));
                link.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Link, true, &help));
                return link.on_hover_text(&help).clicked().then_some(sequence as u64);
            }
            Some(sequence) => {
                ui.label(mono(format!("{sequence:7}")));
            }
            None => {
                let text = if sequence.is_some() { "  never" } else { "" };
                ui.label(mono(text).color(tokens(ui).weak));
            }
        }
        None
    }

    /// When the cell changed.
    fn change(&self, ui: &mut Ui, room: &mut Room, told: &mut Told) {
        let [seconds, nanos] = CHANGED.map(|name| self.value(name));
        let Some((seconds, nanos)) = seconds.zip(nanos).filter(|_| room.lines > 0) else { return };
        told.add(CHANGED);
        let changed = Stamp(seconds as u64 * 1_000_000_000 + nanos as u64);
        let text = if changed.0 == 0 {
            "never".to_owned()
        } else {
            let age = format::age(self.frame.now.seconds_since(changed));
            format!("{age} ago, at {}", format::clock(changed.0))
        };
        room.write(ui, &format!("{:<NAME$}{text}", "changed"));
    }

    /// A row for each part with several fields, of which one says something: `ground.mean`, `ground.count`.
    fn part_rows(&self, ui: &mut Ui, room: &mut Room, told: &mut Told) {
        let (mut parts, columns) = self.parts(told);
        parts.retain(|part| {
            let is_said = !self.says_nothing_of(part);
            if !is_said {
                let is_of_part = |name: &&str| name.split_once('.').is_some_and(|(other, _)| other == *part);
                told.add(self.cells.names().filter(is_of_part));
            }
            is_said
        });
        // The count of what finds no room takes a line.
        let most = room.lines.saturating_sub(1).min(room.usual);
        if parts.is_empty() || most < 1 + parts.len() {
            return;
        }
        room.take(1 + parts.len());
        let fit = (room.chars.saturating_sub(NAME) / NUMBER).clamp(1, columns.len().max(1));
        let columns = &columns[..fit.min(columns.len())];
        let heading = in_columns(columns.iter(), NUMBER);
        ui.label(mono(format!("{:<NAME$}{heading}", "")).color(tokens(ui).weak));
        for part in parts {
            let number = |column: &&str| {
                let name = format!("{part}.{column}");
                told.add([name.as_str()]);
                self.value(&name).map(short).unwrap_or_default()
            };
            let numbers = in_columns(columns.iter().map(number), NUMBER);
            ui.label(mono(format!("{part:<NAME$}{numbers}")));
        }
    }

    /// The parts with several fields that were not told, and the names of these fields.
    fn parts(&self, told: &Told) -> (Vec<&str>, Vec<&str>) {
        let pairs = || {
            let names = self.cells.names().filter(|name| !told.names.contains(*name));
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
        (parts, columns)
    }

    /// Whether no field of a part says anything.
    fn says_nothing_of(&self, part: &str) -> bool {
        let is_of_part = |name: &&str| name.split_once('.').is_some_and(|(other, _)| other == part);
        let mut names = self.cells.names().filter(is_of_part);
        names.all(|name| self.value(name).is_none_or(says_nothing))
    }

    /// The other fields, two on a line where they fit.
    fn rest(&self, ui: &mut Ui, room: &mut Room, told: &Told) {
        let rest: Vec<_> = self.cells.names().filter(|name| !told.names.contains(*name)).collect();
        let width = rest.iter().map(|name| name.len()).max().unwrap_or(0).max(NAME - 1);
        let on_a_line = if room.chars > 2 * (width + 1 + NUMBER) { 2 } else { 1 };
        let lines = room.lines.saturating_sub(1).min(room.usual);
        let (listed, hidden) = rest.split_at(rest.len().min(on_a_line * lines));
        for names in listed.chunks(on_a_line) {
            let one = |name: &&str| {
                let number = self.value(name).map(short).unwrap_or_default();
                format!("{name:<width$} {number:<NUMBER$}")
            };
            room.write(ui, names.iter().map(one).collect::<Vec<_>>().join(" ").trim_end());
        }
        let hidden = hidden.len() + told.hidden;
        if hidden > 0 && room.lines > 0 {
            let numbers = if hidden == 1 { "number" } else { "numbers" };
            room.write_weak(ui, &format!("{hidden} {numbers} more in a larger map"));
        }
    }
}

/// A line about a fused cost: the cost, how sure it is, its class ([`Label`]), and the source with the most evidence.
fn fused_line(
    name: &str,
    cost: f64,
    confidence: Option<f64>,
    label: Option<f64>,
    source: Option<&str>,
) -> String {
    let cost = if cost > MOST_COST { "unknown".to_owned() } else { format!("cost {:>3}", short(cost)) };
    let confidence = confidence.map(|conf| format!("  conf {conf:3}")).unwrap_or_default();
    let label = match label {
        Some(label) if label == f64::from(Label::Ground as u8) => "  ground",
        Some(label) if label == f64::from(Label::Obstacle as u8) => "  obstacle",
        _ => "",
    };
    let by = source.map(|source| format!(" by {source}")).unwrap_or_default();
    format!("{name:<NAME$}{cost}{confidence}{label}{by}")
}

/// Texts in columns of this width.
fn in_columns<T: Display>(texts: impl Iterator<Item = T>, width: usize) -> String {
    texts.map(|text| format!("{text:>width$}")).collect::<Vec<_>>().concat()
}

/// Whether a number is a cost; a greater one stands for an unknown cost.
fn is_cost(value: f64) -> bool {
    (0.0..=MOST_COST).contains(&value)
}

/// Whether a number is the same as none.
fn says_nothing(value: f64) -> bool {
    value.is_nan() || value == 0.0
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
    use crate::samples;
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;
    use rcs_msg::AnyMessage;
    use rcs_msg::foxglove::packed_element_field::NumericType;
    use rcs_msg::foxglove::{Grid, PackedElementField};

    #[test]
    fn a_field_of_another_type_with_the_name_of_a_cost_is_a_number_like_others() {
        let fields = ["cost", "cost.stereo"].into_iter().zip([0, 4]).map(|(name, offset)| {
            let name = name.to_owned();
            PackedElementField { name, offset, r#type: NumericType::Float32.into() }
        });
        let data =
            [300.0_f32, 900.0].iter().flat_map(|number| number.to_le_bytes()).collect::<Vec<u8>>().into();
        let (fields, column_count, row_stride, cell_stride) = (fields.collect(), 1, 8, 8);
        let floats = Grid { fields, data, column_count, row_stride, cell_stride, ..samples::grid(1, 1) };
        let frame = samples::empty();
        for (grid, is_unknown, has_cost) in
            [(floats, false, false), (samples::costmap(1, &[255]), true, true)]
        {
            let grid = AnyMessage::new(grid);
            let cells = Cells::new(&grid).unwrap();
            let content =
                Content { frame: &frame, cells: &cells, cell: [0, 0], weights: None, is_edited: false };
            assert_eq!((content.is_unknown(), content.fused_cost().is_some()), (is_unknown, has_cost));
            assert_eq!(content.sources().count(), 0);
        }
    }

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
    fn what_the_weights_of_a_preview_give_is_said_above_what_was_fused() {
        let mut map = rcs_world::Map::new(0.2).unwrap();
        let cell = map.grid().centre();
        for (source, cost) in [(Source::STEREO, 233), (Source::TERRAIN, 223)] {
            map.vote(cell, source, cost, 1, Stamp(1), rcs_world::VoteRule::default());
        }
        let (sources, weights) = (map.sources(), Weights::default());
        let options = rcs_world::MapOptions { sources, heights: false, weights: weights.clone() };
        let message = MapMessage::new(map, "local", samples::NOW, options).into_message();
        let mut harness = Harness::builder().with_context_setup(ocu_ui::install).build_ui(move |ui| {
            let (frame, cells) = (samples::empty(), Cells::new(&message).unwrap());
            let edited = Some(weights.clone().with(Source::STEREO, 0.0));
            let cell = [100, 100];
            let content = Content { frame: &frame, cells: &cells, cell, weights: edited, is_edited: true };
            content.show(ui, &mut Room { chars: 80, lines: 30, usual: 30 }, false);
        });
        harness.run();
        let preview = harness.get_by_label("preview    cost 223  conf  16  obstacle by terrain").rect();
        let fused = harness.get_by_label("fused      cost 233  conf  18  obstacle by stereo").rect();
        assert!(preview.bottom() <= fused.top(), "{preview} {fused}");
        // Weights that were sent are in force, and the map was fused before.
        assert!(harness.query_by_label_contains("in force").is_none());
    }
}
