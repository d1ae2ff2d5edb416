//! Sweep view: runs the open stack for values of a parameter and for several seeds in the background, and shows what
//! became of each run. A click opens one.
//!
//! The window runs the sweep ([`Wish::Sweep`]), as `ocu sweep` does, and gives its state by the selection.

mod state;
mod table;

use crate::tuning::in_force;
use crate::view::{SavedState, View, ViewContext, Wish};
use egui::{Align, Button, ComboBox, DragValue, Layout, RichText, Role, TextEdit, Ui, Vec2, WidgetInfo};
use ocu_ui::{format, icons, tokens, widgets};
use rcs_msg::params::{ParamKind, ParamSpec, specs};
use rcs_msg::{Value, rcs};
use rcs_runtime::source::Frame;
use serde::{Deserialize, Serialize};

pub use state::{SweepRequest, SweepRow, SweepState};

/// Most seeds of a sweep in the window.
const MOST_SEEDS: u32 = 1000;
/// Room of the word *Fault* with its field: they are in one line.
const FAULT: Vec2 = Vec2::new(180.0, 20.0);

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
struct Saved {
    /// The process and the field whose values are swept; empty for seeds alone.
    process: String,
    field: String,
    /// Its values, as `V1,V2,…` or `FROM..TO:COUNT`.
    values: String,
    /// A fault on demand in every run; empty for none.
    fault: String,
    seed: u64,
    runs: u32,
    /// When runs are stopped, s; 0 for their own end.
    until_s: f64,
}

impl Default for Saved {
    fn default() -> Self {
        let none = String::new();
        let (process, field, values, fault) = (none.clone(), none.clone(), none.clone(), none);
        Self { process, field, values, fault, seed: 0, runs: 5, until_s: 0.0 }
    }
}

impl Saved {
    fn request(&self) -> SweepRequest {
        let param = (!self.process.is_empty() && !self.field.is_empty())
            .then(|| format!("{}.{}={}", self.process, self.field, self.values.trim()));
        let fault = self.fault.trim();
        SweepRequest {
            params: param.into_iter().collect(),
            faults: (!fault.is_empty()).then(|| fault.to_owned()).into_iter().collect(),
            seed: self.seed,
            runs: self.runs,
            until_s: (self.until_s > 0.0).then_some(self.until_s),
        }
    }
}

/// The sweep view.
#[derive(Default)]
pub(crate) struct Sweep {
    saved: Saved,
}

impl View for Sweep {
    fn title(&self, _frame: &Frame) -> String {
        "Sweep".to_owned()
    }

    fn save(&self) -> SavedState {
        serde_json::to_value(&self.saved).unwrap_or_default()
    }

    fn load(&mut self, saved: &SavedState) -> Result<(), serde_json::Error> {
        let mut saved: Saved = serde_json::from_value(saved.clone())?;
        saved.runs = saved.runs.clamp(1, MOST_SEEDS);
        saved.until_s = if saved.until_s.is_finite() { saved.until_s.clamp(0.0, 1e6) } else { 0.0 };
        self.saved = saved;
        Ok(())
    }

    fn ui(&mut self, ui: &mut Ui, cx: &mut ViewContext<'_>) {
        let state = cx.selection.sweep.clone();
        if state.what.is_empty() && state.rows.is_empty() {
            let hint = "Open a stack, in a simulation or on a recording: it can be run for values of its parameters and \
                        for several seeds.";
            return widgets::empty(ui, icons::ICON_GRID_ON, "Nothing to sweep", hint);
        }
        egui::Frame::new().inner_margin(egui::Margin::symmetric(8, 6)).show(ui, |ui| {
            ui.set_width(ui.available_width());
            self.form(ui, cx, &state);
        });
        if let Some(problem) = &state.problem {
            let text = RichText::new(problem).color(tokens(ui).error);
            let place = egui::Frame::new().inner_margin(egui::Margin::symmetric(8, 0));
            place.show(ui, |ui| ui.add(egui::Label::new(text).wrap()));
        }
        table::ui(ui, cx, &state);
    }
}

impl Sweep {
    /// What is to be run, and the buttons.
    fn form(&mut self, ui: &mut Ui, cx: &mut ViewContext<'_>, state: &SweepState) {
        let Self { saved } = self;
        ui.horizontal_wrapped(|ui| {
            ui.label(RichText::new("Parameter").small().color(tokens(ui).weak));
            parameter(ui, cx.frame, saved);
            let has_field = !saved.field.is_empty();
            let hint = "0.1..0.5:5 or 1,2,3";
            let values = TextEdit::singleline(&mut saved.values).hint_text(hint).desired_width(120.0);
            let values = ui.add_enabled(has_field, values.font(egui::TextStyle::Monospace));
            named(ui, &values, "Values of the parameter");
            values.on_hover_text("FROM..TO:COUNT, or values separated by commas");
        });
        ui.horizontal_wrapped(|ui| {
            ui.label(RichText::new("Seeds").small().color(tokens(ui).weak));
            let runs = ui.add(DragValue::new(&mut saved.runs).range(1..=MOST_SEEDS).suffix(" runs"));
            named(ui, &runs, "Number of seeds");
            let seed = ui.add(DragValue::new(&mut saved.seed).prefix("from "));
            named(ui, &seed, "First seed");
            ui.label(RichText::new("Until").small().color(tokens(ui).weak));
            let until = DragValue::new(&mut saved.until_s).range(0.0..=1e6).custom_formatter(|s, _| {
                if s > 0.0 { format!("{} s", format::number(s)) } else { "the end".to_owned() }
            });
            let until = ui.add(until);
            named(ui, &until, "When a run is stopped");
            until.on_hover_text("0: when the course is decided, or the recording ends");
            // In one line with its field.
            ui.allocate_ui_with_layout(FAULT, Layout::left_to_right(Align::Center), |ui| {
                ui.label(RichText::new("Fault").small().color(tokens(ui).weak));
                let fault = TextEdit::singleline(&mut saved.fault).hint_text("none").desired_width(140.0);
                let fault = ui.add(fault.font(egui::TextStyle::Monospace));
                named(ui, &fault, "Fault on demand in every run");
                fault.on_hover_text("Like wm1:frozen@10..12; ocu run --help lists the kinds");
            });
        });
        ui.horizontal(|ui| {
            if state.is_running {
                // A sweep may end while the mouse is pressed, and the same press must not begin another one.
                let cancel = format!("{}  Cancel", icons::ICON_CLOSE.codepoint);
                if widgets::named(ui, "cancel", |ui| ui.button(cancel).clicked()) {
                    cx.wishes.push(Wish::CancelSweep);
                }
                let (part, text) = match (state.rows.len(), state.total) {
                    (_, 0) => (0.0, "checking".to_owned()),
                    (ended, total) => (ended as f32 / total as f32, format!("{ended} of {total} runs")),
                };
                let width = (ui.available_width() * 0.5).clamp(80.0, 320.0);
                ui.add(egui::ProgressBar::new(part).desired_width(width).text(text));
                line(ui, &state.ran);
            } else {
                let start = Button::new(format!("{}  Run", icons::ICON_PLAY_ARROW.codepoint));
                let start = widgets::named(ui, "run", |ui| ui.add_enabled(!state.what.is_empty(), start));
                let help = "Run every combination in the background; the window goes on";
                if start.on_hover_text(help).clicked() {
                    cx.wishes.push(Wish::Sweep(saved.request()));
                }
                line(ui, &state.what);
            }
        });
        if !state.is_running && !state.rows.is_empty() {
            line(ui, &said(state));
        }
    }
}

fn line(ui: &mut Ui, text: &str) {
    ui.add(egui::Label::new(RichText::new(text).color(tokens(ui).weak)).truncate());
}

/// What became of the runs, in a line.
fn said(state: &SweepState) -> String {
    let judged = state.rows.iter().filter_map(|row| row.reached).count();
    let reached = state.rows.iter().filter(|row| row.reached == Some(true)).count();
    let rows = state.rows.len();
    let text = if judged == 0 {
        format!("{rows} runs of {}", state.ran)
    } else {
        format!("{reached} of {rows} runs of {} reached the goal", state.ran)
    };
    if rows < state.total { format!("{text}; cancelled after {rows} of {}", state.total) } else { text }
}

fn named(ui: &Ui, response: &egui::Response, name: &str) {
    ui.ctx().accesskit_node_builder(response.id, |node| node.set_label(name));
}

/// The choice of process and field. A new field begins with its range, or with the value in force.
fn parameter(ui: &mut Ui, frame: &Frame, saved: &mut Saved) {
    let infos: Vec<&rcs::ProcessInfo> =
        frame.processes.iter().filter(|info| in_force(frame, info).is_some()).collect();
    let shown = if saved.process.is_empty() { "none" } else { &saved.process };
    let combo = ComboBox::from_id_salt("process").selected_text(shown).width(110.0).truncate();
    let combo = combo.show_ui(ui, |ui| {
        let mut chosen = None;
        if ui.selectable_label(saved.process.is_empty(), "none: seeds alone").clicked() {
            chosen = Some(String::new());
        }
        for info in &infos {
            if ui.selectable_label(saved.process == info.name, &info.name).clicked() {
                chosen = Some(info.name.clone());
            }
        }
        if let Some(process) = chosen.filter(|process| *process != saved.process) {
            (saved.process, saved.field, saved.values) = (process, String::new(), String::new());
        }
    });
    combo.response.widget_info(|| WidgetInfo::labeled(Role::ComboBox, true, "Process of the parameter"));
    let info = infos.iter().find(|info| info.name == saved.process);
    let Some(params) = info.and_then(|info| in_force(frame, info)) else { return };
    let (Some(specs), Ok(value)) = (params.schema().descriptor().map(specs), params.value()) else { return };
    let shown = if saved.field.is_empty() { "choose a field" } else { &saved.field };
    let combo = ComboBox::from_id_salt("field").selected_text(shown).width(170.0).truncate();
    let combo = combo.show_ui(ui, |ui| {
        for (path, spec) in fields(&specs, &value) {
            let entry = ui.selectable_label(saved.field == path, &path);
            let response = widgets::help_beside(entry, &spec.help);
            if response.clicked() && saved.field != path {
                saved.values = usual(spec, &value, &path);
                saved.field = path;
            }
        }
    });
    combo.response.widget_info(|| WidgetInfo::labeled(Role::ComboBox, true, "Field of the parameter"));
}

/// The fields with a plain value, by their paths.
fn fields<'a>(specs: &'a [ParamSpec], value: &Value) -> Vec<(String, &'a ParamSpec)> {
    let mut found = Vec::new();
    for (path, leaf) in value.leaves() {
        let path = path.to_string().trim_start_matches('.').to_owned();
        let is_plain = !matches!(leaf, Value::Bytes(_) | Value::Packed(_) | Value::Null);
        if let Some(spec) = spec_of(specs, &path).filter(|spec| is_plain && spec.file.is_none()) {
            found.push((path, spec));
        }
    }
    found
}

/// The description of a field.
fn spec_of<'a>(mut specs: &'a [ParamSpec], path: &str) -> Option<&'a ParamSpec> {
    let mut found = None;
    for part in path.split('.') {
        let name = part.split('[').next().unwrap_or(part);
        let spec = specs.iter().find(|spec| spec.name == name)?;
        specs = &spec.fields;
        found = Some(spec);
    }
    found
}

/// The values with which a field begins.
fn usual(spec: &ParamSpec, value: &Value, path: &str) -> String {
    let now = format!(".{path}").parse().ok().and_then(|path| value.get(&path).ok()?.as_f64());
    match (spec.kind, spec.min, spec.max, now) {
        (ParamKind::Number, Some(min), Some(max), Some(now)) => {
            // Around the value in force, within the range.
            let (from, to) = (min.max(now * 0.5), max.min(now * 1.5));
            let (from, to) = if to > from { (from, to) } else { (min, max) };
            format!("{}..{}:5", format::number(from), format::number(to))
        }
        (.., Some(now)) => format::number(now),
        _ => String::new(),
    }
}
