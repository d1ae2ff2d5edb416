//! Editing the fields of a buffer as its operator: written at once as one message, in the next message of its process,
//! or held until released.
//!
//! Changes that were not sent belong to their buffer: they are shown with its fields only, and come back with them, in
//! every view and after a change of the layout ([`crate::view::Drafts`]).
//!
//! What cannot be is refused before it is sent, with the reason; the runtime checks type and range again, and its refusal
//! is shown as the source's error.

pub(crate) mod draft;
pub(crate) mod text;

use crate::view::ViewContext;
use draft::{Draft, Sent};
use egui::{RichText, TextEdit, Ui};
use ocu_ui::{icons, tokens, typing, widgets};
use rcs_msg::rcs::r#override::Mode;
use rcs_msg::rcs::{Fault, Override, OverrideInForce, OverrideList};
use rcs_msg::{AnyMessage, FieldPath, Value};
use rcs_runtime::source::{Control, Frame, Topic};
use std::collections::BTreeMap;
use std::sync::Arc;
use text::{number_of, text_of};

/// How the changes take effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum How {
    /// At once: the newest message with the changed fields is written, once.
    Now,
    /// In the next message that its process writes.
    Next,
    /// In every message, until released.
    Hold,
}

/// Why a topic cannot be edited; `None` if it can.
pub(crate) fn refusal(frame: &Frame, topic: &Topic) -> Option<&'static str> {
    if topic.run.is_recorded() {
        return Some("This was read from a recording, which cannot be written to.");
    }
    crate::command::refusal(frame)
}

/// The overrides in force, and those that wait: those of the run, or of a recording without a run.
pub(crate) fn overrides(frame: &Frame) -> &[OverrideInForce] {
    // The topic of a run comes first. It has no message until something is held.
    let topic = frame.topics_of_type("rcs.OverrideList").next();
    let list = topic.and_then(|topic| topic.get::<OverrideList>());
    list.map_or(&[], |list| &list.active)
}

/// The request that releases an override by its number, or all of them.
pub fn release(frame: &Frame, id: Option<u64>) -> Option<Control> {
    let all = id.is_none();
    request(frame, Override { mode: Mode::Release.into(), id: id.unwrap_or(0), all, ..Override::default() })
}

/// Something that the operator holds.
pub struct Held {
    /// The buffer with the path, or the process.
    pub target: String,
    /// The value, or what goes wrong.
    pub what: String,
    /// Whether it is a fault on demand.
    pub is_fault: bool,
    /// The number by which it is released.
    pub id: u64,
}

/// What the operator holds.
pub fn held(frame: &Frame) -> Vec<Held> {
    let of = |held: &OverrideInForce| {
        let is_fault = !held.fault.is_empty();
        let (target, what) = if is_fault {
            (format!("{}{}", held.process, held.buffer), held.fault.clone())
        } else {
            (format!("{}{}", held.buffer, held.path), held.value.clone())
        };
        Held { target, what, is_fault, id: held.id }
    };
    overrides(frame).iter().map(of).collect()
}

/// The request of a fault of a process.
pub(crate) fn fault(frame: &Frame, process: &str, fault: Fault) -> Option<Control> {
    let change = Override {
        mode: Mode::Hold.into(),
        process: process.to_owned(),
        fault: Some(fault),
        ..Override::default()
    };
    request(frame, change)
}

/// A write of a request for an override, into the buffer of that type.
fn request(frame: &Frame, request: Override) -> Option<Control> {
    let topic = frame.topics_of_type("rcs.Override").find(|topic| !topic.run.is_recorded())?;
    let request = Override { timestamp: Some(frame.now.to_proto()), ..request };
    Some(Control::Write { buffer: topic.name.to_string(), message: AnyMessage::new(request) })
}

/// The value that a text means in place of an old one.
fn parsed(old: &Value, text: &str) -> Result<Value, String> {
    let trimmed = text.trim();
    let fail = |expected: &str| Err(format!("got {text:?}, expected {expected}"));
    match old {
        Value::Bool(_) => match trimmed {
            "true" | "1" => Ok(Value::Bool(true)),
            "false" | "0" => Ok(Value::Bool(false)),
            _ => fail("true or false"),
        },
        Value::Int(_) => trimmed.parse().map(Value::Int).or_else(|_| fail("a whole number")),
        Value::Uint(_) => trimmed.parse().map(Value::Uint).or_else(|_| fail("a whole number of at least 0")),
        Value::Float(_) => match number_of(text) {
            Some(number) if number.is_finite() => Ok(Value::Float(number)),
            _ => fail("a number such as 1.5"),
        },
        Value::Text(_) => Ok(Value::Text(text.to_owned())),
        Value::Enum { .. } => Ok(match trimmed.parse() {
            Ok(number) => Value::Int(number),
            Err(_) => Value::Text(trimmed.to_owned()),
        }),
        other => Err(format!("{} cannot be edited as a whole; edit one of its parts", other.kind())),
    }
}

/// A value as JSON, as an override states it.
fn json(value: &Value) -> String {
    match value {
        Value::Bool(on) => on.to_string(),
        Value::Int(number) => number.to_string(),
        Value::Uint(number) => number.to_string(),
        Value::Float(number) => serde_json::Value::from(*number).to_string(),
        Value::Text(text) => serde_json::Value::from(text.as_str()).to_string(),
        _ => "null".to_owned(),
    }
}

/// What the changes of a topic's fields write, and how it is taken back.
fn controls(
    frame: &Frame,
    topic: &Topic,
    fields: &BTreeMap<String, String>,
    how: How,
) -> Result<(Vec<Control>, Sent), String> {
    if let Some(refused) = refusal(frame, topic) {
        return Err(refused.to_owned());
    }
    let sample = topic.latest.as_ref().ok_or("there is no message yet")?;
    let mut value = sample.message.value().map_err(|error| error.to_string())?;
    let mut changes = Vec::new();
    for (path, text) in fields {
        let at: FieldPath = path.parse().map_err(|error| format!("{error}"))?;
        let old = value.get(&at).map_err(|error| error.to_string())?.into_owned();
        changes.push((at, parsed(&old, text).map_err(|error| format!("{path}: {error}"))?));
    }
    let buffer = topic.name.to_string();
    if how == How::Now {
        for (at, new) in changes {
            value.set(&at, new).map_err(|error| error.to_string())?;
        }
        let schema = sample.message.schema();
        let bytes = schema.encode(&value).map_err(|error| error.to_string())?;
        let encoded = AnyMessage::encoded(Arc::clone(&schema), bytes.clone());
        let message = match rcs_msg::canonical(&schema, &bytes) {
            Some(made) => made.map_err(|error| error.to_string())?,
            None => encoded,
        };
        let sent = Sent::Message {
            buffer: buffer.clone(),
            written: message.clone(),
            before: sample.message.clone(),
        };
        return Ok((vec![Control::Write { buffer, message }], sent));
    }
    let mode = if how == How::Hold { Mode::Hold } else { Mode::Once };
    let requests = changes.iter().map(|(at, new)| {
        let over = Override {
            buffer: buffer.clone(),
            mode: mode.into(),
            path: at.to_string(),
            value_json: json(new),
            ..Override::default()
        };
        request(frame, over).ok_or_else(|| "this source takes no overrides".to_owned())
    });
    let requests: Vec<Control> = requests.collect::<Result<_, String>>()?;
    let paths = changes.iter().map(|(at, _)| at.to_string()).collect();
    Ok((requests, Sent::Held { buffer, paths }))
}

impl Draft {
    /// Begins to edit a field; one that is being edited keeps its text. Returns its path; `None` for a value that cannot
    /// be edited as a whole.
    pub(crate) fn begin(&mut self, path: &FieldPath, value: &Value) -> Option<String> {
        let text = text_of(value)?;
        let path = path.to_string();
        self.refused = None;
        self.fields.entry(path.clone()).or_insert(text);
        Some(path)
    }

    /// Paints the changes, and what can be done with them. `fresh` is the path of the field that takes the keyboard.
    pub(crate) fn ui(&mut self, ui: &mut Ui, cx: &mut ViewContext<'_>, topic: &Topic, fresh: Option<&str>) {
        let frame = cx.frame;
        let margin = egui::Margin::symmetric(8, 4);
        egui::Frame::new().inner_margin(margin).fill(tokens(ui).surface[3]).show(ui, |ui| {
            ui.set_width(ui.available_width());
            let mut dropped = None;
            let (mut entered, mut is_changed) = (false, false);
            for (path, text) in &mut self.fields {
                ui.horizontal(|ui| {
                    let label = ui.label(widgets::mono(path.as_str()).color(tokens(ui).strong));
                    // An id of the field, so that undo in the text is not that of another field.
                    let edit = TextEdit::singleline(text)
                        .id_salt(("edit", &*topic.name, topic.run, path.as_str()))
                        .desired_width((ui.available_width() - 32.0).max(48.0));
                    let response = ui.add(edit.font(egui::TextStyle::Monospace)).labelled_by(label.id);
                    ui.ctx().accesskit_node_builder(response.id, |node| {
                        node.set_label(format!("New value of {path}"));
                    });
                    if fresh == Some(path.as_str()) {
                        response.request_focus();
                    }
                    is_changed |= response.changed();
                    entered |= typing::entered(&response);
                    if widgets::icon_button(ui, icons::ICON_CLOSE, &format!("Leave {path} as it is"))
                        .clicked()
                    {
                        dropped = Some(path.clone());
                    }
                });
            }
            if is_changed || dropped.is_some() {
                // It was about another text.
                self.refused = None;
            }
            if let Some(path) = dropped {
                self.fields.remove(&path);
            }
            let mut how = entered.then_some(How::Now);
            ui.horizontal_wrapped(|ui| {
                let can = !self.fields.is_empty();
                for (name, help, what) in [
                    ("Write now", "Write the newest message with these values, once", How::Now),
                    ("In the next message", "Replace them in the next message of its process", How::Next),
                    ("Hold", "Replace them in every message until released", How::Hold),
                ] {
                    if ui.add_enabled(can, egui::Button::new(name)).on_hover_text(help).clicked() {
                        how = Some(what);
                    }
                }
                let undo = egui::Button::new(format!("{}  Undo", icons::ICON_UNDO.codepoint));
                let help = "Write what the last edit replaced, or release what it holds";
                if ui.add_enabled(!self.sent.is_empty(), undo).on_hover_text(help).clicked() {
                    self.undo(cx);
                }
            });
            if let Some(how) = how {
                match controls(frame, topic, &self.fields, how) {
                    Ok((controls, sent)) => {
                        cx.controls.extend(controls);
                        self.sent(sent);
                    }
                    Err(refused) => self.refused = Some(refused),
                }
            }
            if let Some(refused) = &self.refused {
                let mut is_read = false;
                ui.horizontal(|ui| {
                    is_read = widgets::icon_button(ui, icons::ICON_CLOSE, "Dismiss").clicked();
                    ui.add(egui::Label::new(RichText::new(refused).small().color(tokens(ui).error)).wrap());
                });
                if is_read {
                    self.refused = None;
                }
            } else if !frame.runs.is_at_end && !self.fields.is_empty() {
                let text = "This moment is in the past: an edit begins another run, and this one is kept.";
                ui.label(RichText::new(text).small().color(tokens(ui).warning));
            }
        });
    }

    fn undo(&mut self, cx: &mut ViewContext<'_>) {
        self.refused = None;
        match self.sent.pop() {
            Some(Sent::Message { buffer, written, before }) => {
                // What the process has published since is newer than the message that was replaced.
                let newest = cx.frame.topic(&buffer).and_then(|topic| topic.latest.as_ref());
                let is_written =
                    |message: &AnyMessage| message.same(&written) || message.bytes() == written.bytes();
                if newest.is_some_and(|sample| is_written(&sample.message)) {
                    cx.controls.push(Control::Write { buffer, message: before });
                } else {
                    self.refused = Some(format!("{buffer} was replaced since the edit: nothing to undo"));
                }
            }
            Some(Sent::Held { buffer, paths }) => {
                for path in paths {
                    let is_it = |held: &&OverrideInForce| {
                        held.buffer == buffer && held.path == path && held.fault.is_empty()
                    };
                    let id = overrides(cx.frame).iter().find(is_it).map(|held| held.id);
                    // One that was used up, or has been released, is gone.
                    cx.controls.extend(id.and_then(|id| release(cx.frame, Some(id))));
                }
            }
            None => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples;
    use rcs_msg::rcs::Status;
    use rcs_runtime::source::{RunTag, SourceKind};

    fn frame() -> Frame {
        let mut frame = samples::full();
        let mut info = (*frame.info).clone();
        info.kind = SourceKind::Stack;
        frame.info = Arc::new(info);
        let overrides = samples::topic("/runtime/override", 0.0, 1.0, Override::default());
        frame.topics = frame.topics.iter().cloned().chain([overrides]).collect();
        frame
    }

    fn check(fields: &[(&str, &str)], how: How) -> Result<Vec<Control>, String> {
        let frame = frame();
        let fields = fields.iter().map(|(path, text)| ((*path).to_owned(), (*text).to_owned())).collect();
        let topic = frame.topic("/planner/status").unwrap();
        controls(&frame, topic, &fields, how).map(|(controls, _)| controls)
    }

    #[test]
    fn several_fields_are_one_write_and_the_others_stay() {
        let fields = [(".cycle", "7"), (".state_text", "by hand"), (".state", "PROCESS_STATE_DONE")];
        let controls = check(&fields[..2], How::Now).unwrap();
        let [Control::Write { buffer, message }] = controls.as_slice() else { panic!("{controls:?}") };
        let status = message.to::<Status>().unwrap();
        assert_eq!(
            (buffer.as_str(), status.cycle, status.state_text.as_str()),
            ("/planner/status", 7, "by hand")
        );
        assert_eq!(status.command, "GOTO", "a field that was not edited");
    }

    #[test]
    fn a_held_field_is_a_request_with_its_value_as_json() {
        for (how, mode) in [(How::Hold, Mode::Hold), (How::Next, Mode::Once)] {
            let controls = check(&[(".state_text", "a \"b\"")], how).unwrap();
            let [Control::Write { buffer, message }] = controls.as_slice() else { panic!("{controls:?}") };
            let request = message.to::<Override>().unwrap();
            assert_eq!(buffer, "/runtime/override");
            assert_eq!((request.mode(), request.buffer.as_str()), (mode, "/planner/status"));
            assert_eq!(
                (request.path.as_str(), request.value_json.as_str()),
                (".state_text", "\"a \\\"b\\\"\"")
            );
        }
    }

    #[test]
    fn an_edit_is_undone_only_while_its_message_is_the_newest_one() {
        let before = frame();
        let topic = before.topic("/planner/status").unwrap();
        let fields = BTreeMap::from([(".cycle".to_owned(), "7".to_owned())]);
        let (written, sent) = controls(&before, topic, &fields, How::Now).unwrap();
        let [Control::Write { message, .. }] = written.as_slice() else { panic!("{written:?}") };
        let stored = AnyMessage::encoded(message.schema(), message.bytes());
        let later = AnyMessage::new(Status { cycle: 8, ..message.to::<Status>().unwrap() });
        for (newest, is_undone) in [(message.clone(), true), (stored, true), (later, false)] {
            let sample = topic.latest.clone().unwrap();
            let newest = topic.clone().with_latest(rcs_bus::Sample { message: newest, ..sample });
            let others = before.topics.iter().filter(|other| other.name != topic.name).cloned();
            let topics = others.chain([newest]).collect();
            let frame = Frame { topics, ..before.clone() };
            let mut changes = Draft { sent: vec![sent.clone()], ..Draft::default() };
            let (mut controls, mut wishes) = (Vec::new(), Vec::new());
            let mut selection = crate::view::Selection::default();
            changes.undo(&mut ViewContext {
                frame: &frame,
                controls: &mut controls,
                selection: &mut selection,
                wishes: &mut wishes,
            });
            let back = controls.first().map(|control| match control {
                Control::Write { message, .. } => message.to::<Status>().unwrap().cycle,
                other => panic!("{other:?}"),
            });
            assert_eq!(back, is_undone.then_some(321));
            let refused = changes.refused.as_deref().is_some_and(|text| text.contains("replaced since"));
            assert_eq!(refused, !is_undone);
        }
    }

    #[test]
    fn what_was_held_in_a_recording_is_not_in_force_in_the_run_on_it() {
        let fault = OverrideInForce { fault: "stopped".to_owned(), ..OverrideInForce::default() };
        let list = OverrideList { active: vec![fault], ..OverrideList::default() };
        let mut recorded = samples::topic("/runtime/overrides", 0.0, 1.0, list);
        recorded.run = RunTag::Recorded;
        let of_run = Topic::new("/runtime/overrides", RunTag::FIRST, Arc::clone(&recorded.schema));
        let of = |topics: &[&Topic]| Frame { topics: topics.iter().copied().cloned().collect(), ..frame() };
        assert!(held(&of(&[&recorded, &of_run])).is_empty());
        assert_eq!(held(&of(&[&recorded])).len(), 1, "a recording alone shows what was held");
    }

    #[test]
    fn a_wrong_value_is_refused_with_the_reason() {
        for (path, text, part) in [
            (".cycle", "-1", "expected a whole number of at least 0"),
            (".cycle", "1.5", "expected a whole number"),
            (".cycle", "", "expected a whole number"),
            (".timestamp", "now", "cannot be edited as a whole"),
            (".absent", "1", "no field \"absent\""),
        ] {
            let error = check(&[(path, text)], How::Now).unwrap_err();
            assert!(error.contains(part), "{path} = {text}: {error}");
        }
        let recorded = samples::full();
        let refused = refusal(&recorded, recorded.topic("/planner/status").unwrap());
        assert!(refused.unwrap().contains("cannot be written to"));
    }

    #[test]
    fn an_edit_without_authority_is_refused_before_it_is_sent() {
        let beside = Frame { is_beside: true, ..frame() };
        let mut info = (*frame().info).clone();
        info.kind = SourceKind::Log;
        let recording = Frame { info: Arc::new(info), ..frame() };
        for (frame, part) in [(&beside, "shown beside"), (&recording, "cannot be written to")] {
            let topic = frame.topic("/planner/status").unwrap();
            for how in [How::Now, How::Next, How::Hold] {
                let fields = BTreeMap::from([(".cycle".to_owned(), "7".to_owned())]);
                let refused = controls(frame, topic, &fields, how).map(|_| ()).unwrap_err();
                assert!(refused.contains(part), "{how:?}: {refused}");
            }
        }
    }

    #[test]
    fn numbers_are_refused_that_the_type_cannot_hold() {
        for (old, text, fits) in [
            (Value::Float(1.0), "2.5e3", true),
            (Value::Float(1.0), "NaN", false),
            (Value::Float(1.0), "inf", false),
            (Value::Bool(true), "false", true),
            (Value::Bool(true), "yes", false),
            (Value::Int(1), "-3", true),
            (Value::Int(1), "99999999999999999999", false),
        ] {
            assert_eq!(parsed(&old, text).is_ok(), fits, "{old:?} {text}");
        }
    }

    #[test]
    fn a_number_is_taken_with_a_decimal_comma_and_a_refusal_shows_one() {
        let number = |text: &str| parsed(&Value::Float(0.0), text);
        assert_eq!(number("1,5"), Ok(Value::Float(1.5)));
        assert_eq!(number(" \u{2212}0.25 "), Ok(Value::Float(-0.25)));
        for text in ["fast", "", "1,234.5", "inf"] {
            assert_eq!(number(text), Err(format!("got {text:?}, expected a number such as 1.5")));
        }
    }
}
