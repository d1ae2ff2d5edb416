//! Details view: the four panes of the diagnostics tool (Albus 2006a, figure 16). Processes, the commands of the chosen
//! one, the parameters of the chosen command with units and ranges, and below them the last command that was sent and
//! the fields of the process's buffers, live.
//!
//! The last parameters of each command are kept. With *send on each change* a command goes out whenever a control is let
//! go.

use crate::command;
use crate::fields::{Fields, Saved as SavedFields};
use crate::process_state::{NOT_RECORDED, silent_s, state_name};
use crate::tuning::{ParamRow, ParamRows};
use crate::view::{CommandDraft, SavedState, TopicKey, View, ViewContext};
use egui::{Align, FontId, RichText, Role, ScrollArea, Sense, Ui, UiBuilder, Vec2, WidgetInfo};
use ocu_ui::{format, icons, tokens, widgets};
use rcs_msg::params::{defaults, specs, with_params};
use rcs_msg::rcs::{Command, CommandInfo, ProcessInfo};
use rcs_msg::{AnyMessage, registry};
use rcs_runtime::source::{Frame, Topic};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::Arc;

const ROW: f32 = 20.0;
const GAP: f32 = 1.0;

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
struct Saved {
    /// The chosen command of each process.
    commands: BTreeMap<String, String>,
    /// Whether a command goes out whenever one of its parameters was changed.
    on_each_change: bool,
    /// The buffer of the process whose fields are shown; its status where none is named.
    buffers: BTreeMap<String, String>,
    /// What is unfolded of these fields, and the array that is shown, as in the view *Fields*.
    fields: SavedFields,
}

/// The details view.
#[derive(Default)]
pub(crate) struct Details {
    saved: Saved,
    refused: Option<String>,
    fields: Fields,
}

impl View for Details {
    fn title(&self, _frame: &Frame) -> String {
        "Details".to_owned()
    }

    fn fields(&self) -> Vec<rcs_formula::FieldRef> {
        self.fields.fields()
    }

    fn sends_commands(&self) -> bool {
        true
    }

    fn choose_command(&mut self, process: &str, command: &str) {
        self.saved.commands.insert(process.to_owned(), command.to_owned());
    }

    fn save(&self) -> SavedState {
        let saved = Saved { fields: self.fields.saved.clone(), ..self.saved.clone() };
        serde_json::to_value(saved).unwrap_or_default()
    }

    fn load(&mut self, saved: &SavedState) -> Result<(), serde_json::Error> {
        self.saved = serde_json::from_value(saved.clone())?;
        self.fields.saved = std::mem::take(&mut self.saved.fields);
        Ok(())
    }

    fn ui(&mut self, ui: &mut Ui, cx: &mut ViewContext<'_>) {
        let frame = cx.frame;
        let named = cx.selection.process.as_deref();
        let chosen = frame.processes.iter().find(|process| Some(process.name.as_str()) == named);
        let Some(process) = chosen.or_else(|| frame.processes.first()) else {
            let hint = "Open a stack, or a recording that a stack made; this one describes no process.";
            return widgets::empty(ui, icons::ICON_LIST_ALT, "No processes", hint);
        };
        let area = ui.available_rect_before_wrap();
        ui.allocate_rect(area, Sense::hover());
        let line = egui::Stroke::new(1.0, tokens(ui).line);
        let middle = area.top() + (0.42 * area.height()).round();
        let (top, bottom) = area.split_top_bottom_at_y(middle);
        let columns = [0.26, 0.22, 0.52];
        let mut left = top.left();
        let mut panes = Vec::new();
        for share in columns {
            let right = (left + share * top.width()).round();
            panes.push(egui::Rect::from_x_y_ranges(left..=right - GAP, top.y_range()));
            left = right;
        }
        for pane in &panes[1..] {
            ui.painter().vline(pane.left() - 0.5, top.y_range(), line);
        }
        ui.painter().hline(area.x_range(), middle, line);
        let mut pane = |rect: egui::Rect, id: &str, add: &mut dyn FnMut(&mut Ui)| {
            let mut child =
                ui.new_child(UiBuilder::new().max_rect(rect.shrink2(Vec2::new(0.0, 1.0))).id_salt(id));
            child.set_clip_rect(rect.intersect(ui.clip_rect()));
            add(&mut child);
        };
        let command = self.chosen_command(process).cloned();
        pane(panes[0], "processes", &mut |ui| processes(ui, cx, process));
        pane(panes[1], "commands", &mut |ui| self.commands(ui, process, command.as_ref()));
        pane(panes[2], "parameters", &mut |ui| self.parameters(ui, cx, process, command.as_ref()));
        let (left, right) = bottom.split_left_right_at_fraction(0.3);
        pane(left, "last", &mut |ui| last_command(ui, frame, process));
        ui_line(ui, right, line);
        let mut child =
            ui.new_child(UiBuilder::new().max_rect(right.shrink2(Vec2::new(1.0, 1.0))).id_salt("fields"));
        child.set_clip_rect(right.intersect(ui.clip_rect()));
        self.buffer(&mut child, cx, process);
    }
}

fn ui_line(ui: &Ui, right: egui::Rect, line: egui::Stroke) {
    ui.painter().vline(right.left(), right.y_range(), line);
}

/// The title of a pane.
fn title(ui: &mut Ui, text: &str) {
    ui.horizontal(|ui| {
        ui.add_space(8.0);
        ui.label(RichText::new(text).small().color(tokens(ui).weak));
    });
}

/// A row of a list.
fn row(ui: &mut Ui, chosen: bool, name: &str, note: &str) -> egui::Response {
    let tokens = tokens(ui);
    let (rect, response) = ui.allocate_exact_size(Vec2::new(ui.available_width(), ROW), Sense::click());
    response.widget_info(|| WidgetInfo::selected(Role::Button, true, chosen, name));
    if chosen {
        ui.painter().rect_filled(rect, 0.0, tokens.selected);
    } else if response.hovered() {
        ui.painter().rect_filled(rect, 0.0, tokens.surface[2]);
    }
    let inner = rect.shrink2(Vec2::new(8.0, 0.0));
    let small = FontId::proportional(11.0);
    let note_width = ui.painter().layout_no_wrap(note.to_owned(), small.clone(), tokens.weak).size().x;
    let left = inner.with_max_x(inner.right() - note_width - 6.0);
    widgets::cell(ui, left, Align::Min, name, FontId::proportional(13.0), tokens.text);
    widgets::cell(ui, inner, Align::Max, note, small, tokens.weak);
    response
}

fn processes(ui: &mut Ui, cx: &mut ViewContext<'_>, chosen: &ProcessInfo) {
    title(ui, "Processes");
    ui.spacing_mut().item_spacing.y = 0.0;
    let absent = if cx.frame.is_before_recording() { NOT_RECORDED } else { "–" };
    ScrollArea::vertical().id_salt("processes").auto_shrink(false).show(ui, |ui| {
        for process in cx.frame.processes.iter() {
            let state = cx.frame.status(process).map_or(absent, |status| state_name(status.state()));
            let old = silent_s(cx.frame, process).map(|age_s| format!("NO STATUS {}", format::age(age_s)));
            if row(ui, process.name == chosen.name, &process.name, old.as_deref().unwrap_or(state))
                .on_hover_text(&process.summary)
                .clicked()
            {
                cx.selection.process = Some(process.name.as_str().into());
            }
        }
    });
}

fn last_command(ui: &mut Ui, frame: &Frame, process: &ProcessInfo) {
    title(ui, "Last command");
    let Some(topic) = frame.topic(&process.command_buffer) else { return };
    let Some(command) = topic.get::<Command>() else {
        ui.horizontal(|ui| {
            ui.add_space(8.0);
            ui.label(RichText::new("none was sent").color(tokens(ui).weak));
        });
        return;
    };
    let parameters = registry()
        .schema(&command.parameters_schema)
        .map(|schema| AnyMessage::encoded(Arc::clone(schema), command.parameters.clone()));
    let status = frame.status(process);
    ScrollArea::vertical().id_salt("last").auto_shrink(false).show(ui, |ui| {
        let line = |ui: &mut Ui, name: &str, value: String| {
            ui.horizontal(|ui| {
                ui.add_space(8.0);
                widgets::name_value(ui, 64.0, name, widgets::mono(value));
            });
        };
        line(ui, "name", command.name.clone());
        if let Some(Ok(value)) = parameters.map(|message| message.value()) {
            for (path, value) in value.leaves() {
                if let Some(text) = crate::edit::text::text_of(value) {
                    sent_parameter(ui, path.to_string().trim_start_matches('.'), text);
                }
            }
        }
        line(ui, "serial", command.serial.to_string());
        if let Some(status) = status {
            line(ui, "echo", status.echo_serial.to_string());
            line(ui, "commander", status.commander.clone());
            line(ui, "authority", status.owner.clone());
            if let Some(refused) = &status.refused {
                line(ui, "refused", format!("{} {}: {}", refused.serial, refused.command, refused.reason));
            }
        }
        line(ui, "age", topic.age_s(frame.now).map(format::age).unwrap_or_default());
    });
}

/// A parameter of a command that was sent. Its value goes into the next line where it does not fit beside the name.
fn sent_parameter(ui: &mut Ui, name: &str, value: String) {
    ui.horizontal_wrapped(|ui| {
        ui.add_space(8.0);
        ui.label(RichText::new(name).size(12.0).color(tokens(ui).weak));
        ui.label(widgets::mono(value));
    });
}

impl Details {
    fn chosen_command<'a>(&self, process: &'a ProcessInfo) -> Option<&'a CommandInfo> {
        let name = self.saved.commands.get(&process.name);
        let named = process.commands.iter().find(|info| Some(&info.name) == name);
        named.or_else(|| process.commands.first())
    }

    fn commands(&mut self, ui: &mut Ui, process: &ProcessInfo, chosen: Option<&CommandInfo>) {
        title(ui, "Commands");
        ui.spacing_mut().item_spacing.y = 0.0;
        ScrollArea::vertical().id_salt("commands").auto_shrink(false).show(ui, |ui| {
            for info in &process.commands {
                let is_chosen = chosen.is_some_and(|chosen| chosen.name == info.name);
                let response = row(ui, is_chosen, &info.name, "");
                if widgets::help_beside(response, &info.help).clicked() {
                    self.saved.commands.insert(process.name.clone(), info.name.clone());
                }
            }
        });
    }

    fn parameters(
        &mut self,
        ui: &mut Ui,
        cx: &mut ViewContext<'_>,
        process: &ProcessInfo,
        command: Option<&CommandInfo>,
    ) {
        let Some(command) = command else { return title(ui, "It has no commands") };
        title(ui, &format!("Parameters of {}", command.name));
        let key = (process.name.clone(), command.name.clone());
        let schema = registry().schema(&command.parameters_schema);
        let made = schema.and_then(|schema| {
            let message = defaults(schema.descriptor()?);
            let bytes = rcs_msg::prost::Message::encode_to_vec(&message);
            Some(AnyMessage::encoded(Arc::clone(schema), bytes.into()))
        });
        let refused = command::refusal(cx.frame);
        let mut send = false;
        ui.horizontal_wrapped(|ui| {
            ui.add_space(8.0);
            let button = egui::Button::new(format!("{}  Send {}", icons::ICON_SEND.codepoint, command.name));
            let response = ui.add_enabled(refused.is_none(), button);
            send |= response.on_disabled_hover_text(refused.unwrap_or_default()).clicked();
            if made.is_some() {
                ui.checkbox(&mut self.saved.on_each_change, "send on each change");
            }
        });
        if let Some(refused) = &self.refused {
            ui.label(RichText::new(refused).small().color(tokens(ui).error));
        }
        let Some(made) = made else {
            ui.horizontal(|ui| {
                ui.add_space(8.0);
                ui.label(RichText::new(&command.help).color(tokens(ui).weak));
            });
            if send {
                command::send(cx, process, &command.name, None);
            }
            return;
        };
        let drafts = &mut cx.selection.drafts.commands;
        let is_of_command = |draft: &CommandDraft| draft.params.schema().name() == made.schema().name();
        let draft = drafts.remove(&key).filter(is_of_command);
        let draft = draft.unwrap_or_else(|| CommandDraft { params: made.clone(), sent: None });
        let CommandDraft { mut params, mut sent } = draft;
        let before = sent.as_ref().unwrap_or(&made).bytes();
        let value = params.value().unwrap_or(rcs_msg::Value::Null);
        let now = made.value().unwrap_or(rcs_msg::Value::Null);
        let list = params.schema().descriptor().map(specs).unwrap_or_default();
        let (mut edits, mut let_go) = (Vec::new(), false);
        ScrollArea::vertical().id_salt("parameters").auto_shrink(false).show(ui, |ui| {
            let mut rows = ParamRows {
                search: "",
                now: &now,
                given: None,
                counting: None,
                is_replaced: false,
                edits: &mut edits,
                let_go: &mut let_go,
            };
            for spec in &list {
                rows.ui(ui, &ParamRow { spec, path: spec.name.clone(), value: value.field(&spec.name) }, 0);
            }
        });
        for (path, text) in edits {
            match with_params(&params, [(path.as_str(), text.as_str())]) {
                Ok(changed) => (params, self.refused) = (changed, None),
                Err(error) => self.refused = Some(error.to_string()),
            }
        }
        // A control that was let go unchanged sends nothing.
        let is_other = before != params.bytes();
        send |= let_go && is_other && self.saved.on_each_change && refused.is_none();
        if send {
            command::send(cx, process, &command.name, Some(&params));
            sent = Some(params.clone());
        }
        cx.selection.drafts.commands.insert(key, CommandDraft { params, sent });
    }

    /// The fields of one of the process's buffers.
    fn buffer(&mut self, ui: &mut Ui, cx: &mut ViewContext<'_>, process: &ProcessInfo) {
        let ports = process.inputs.iter().chain(&process.outputs).map(|port| port.buffer.as_str());
        let own = [&process.status_buffer, &process.command_buffer, &process.params_buffer];
        let mut names: Vec<&str> = own.into_iter().map(String::as_str).chain(ports).collect();
        names.retain(|name| !name.is_empty());
        let named = self.saved.buffers.get(&process.name).map(String::as_str);
        let shown = named.filter(|named| names.contains(named)).unwrap_or(&process.status_buffer).to_owned();
        ui.horizontal(|ui| {
            ui.add_space(8.0);
            let combo = egui::ComboBox::from_id_salt("buffer").selected_text(&shown).width(220.0).truncate();
            let combo = combo.show_ui(ui, |ui| {
                for name in names {
                    if ui.selectable_label(name == shown, name).clicked() {
                        self.saved.buffers.insert(process.name.clone(), name.to_owned());
                    }
                }
            });
            combo.response.widget_info(|| WidgetInfo::labeled(Role::ComboBox, true, "Buffer of the process"));
        });
        let key = TopicKey::shown(shown);
        let topic: Option<&Topic> = key.find(cx.frame);
        self.fields.message_ui(ui, cx, topic);
    }
}
