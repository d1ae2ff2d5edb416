//! Models view: what was learned, one card per model with its histograms and numbers (Albus 2006a, figure 9).
//!
//! It shows every message of the role `models`: a list of models, whose lists of numbers are histograms, and whose
//! numbers are shown as they are named; one that is called a fraction is a bar. A list with as many elements as the
//! product of two numbers called `…_bins` has two axes, the first one outermost.
//!
//! A field of a model that is an image is its picture: part of the frame that it was learned from.
//!
//! A process begins with the models in a parameter with the name of their output, which holds a file. So models are
//! saved as that file, and loaded by setting the parameter. One model is deleted by a command of the process whose
//! parameters are an `rcs.ModelToDelete`.

mod cards;
mod patch;
mod read;

use crate::cached::SameMessage;
use crate::command::{self, refusal};
use crate::prepare::prepared;
use crate::toolbar::topic_choice;
use crate::tuning::in_force;
use crate::view::{Draws, SavedState, TopicKey, View, ViewContext, Wish, is_old};
use egui::{Id, RichText, ScrollArea, Ui};
use ocu_ui::bar::{self, Bar, Fit};
use ocu_ui::{format, icons, tokens, widgets};
use patch::Atlas;
use rcs_msg::params::{specs, with_params};
use rcs_msg::rcs::{CommandInfo, ModelToDelete, ProcessInfo};
use rcs_msg::{AnyMessage, schema_of};
use rcs_runtime::Role;
use rcs_runtime::source::{Control, Frame, Topic};
use read::Models as Read;
use serde::{Deserialize, Serialize};

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
struct Saved {
    /// The topic; the first with models where `None`.
    topic: Option<TopicKey>,
}

/// The view of learned models.
#[derive(Default)]
pub(crate) struct Models {
    saved: Saved,
    /// The message in which a model was chosen for deletion, and its number there.
    leaving: Option<(SameMessage, usize)>,
    /// Why the last change was refused.
    refused: Option<String>,
}

/// The models of a message, which another thread has read, and their pictures.
struct Content {
    message: SameMessage,
    models: Read,
    pictures: Option<Atlas>,
}

impl Content {
    fn of(message: AnyMessage) -> Result<Self, String> {
        let models = Read::of(&message)?;
        let pictures = Atlas::new(&models.patches());
        Ok(Self { message: SameMessage(message), models, pictures })
    }
}

/// What the toolbar asks for.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Asked {
    Save,
    Load,
    DeleteAll,
}

impl View for Models {
    fn title(&self, _frame: &Frame) -> String {
        "Models".to_owned()
    }

    fn accepts(&self, topic: &Topic) -> bool {
        topic.role() == Some(Role::Models)
    }

    fn draws(&self, frame: &Frame, topic: &Topic) -> Draws {
        let shown = self.shown(frame, &topics(frame));
        if shown.is_some_and(|shown| TopicKey::of(topic).is(shown)) { Draws::Now } else { Draws::Never }
    }

    fn drop_topic(&mut self, topic: &Topic) {
        self.saved.topic = Some(TopicKey::of(topic));
    }

    fn save(&self) -> SavedState {
        serde_json::to_value(&self.saved).unwrap_or_default()
    }

    fn load(&mut self, saved: &SavedState) -> Result<(), serde_json::Error> {
        self.saved = serde_json::from_value(saved.clone())?;
        Ok(())
    }

    fn ui(&mut self, ui: &mut Ui, cx: &mut ViewContext<'_>) {
        let topics = topics(cx.frame);
        let Some(topic) = self.shown(cx.frame, &topics) else {
            let hint = "A process that learns would fill it: run the stack learning or lagr, or open a recording \
                        of one.";
            return widgets::empty(ui, icons::ICON_MODEL_TRAINING, "No models here", hint);
        };
        let place = Place::of(cx.frame, topic);
        let asked = self.toolbar(ui, cx.frame, topic, &topics, place.as_ref());
        let Some(sample) = &topic.latest else {
            let hint = "Models are sent once something has been learned.";
            return widgets::empty(ui, icons::ICON_MODEL_TRAINING, "Nothing has been learned yet", hint);
        };
        let message = sample.message.clone();
        let (slot, key) = (Id::unique(("models", &*topic.name, topic.run)), SameMessage(message.clone()));
        let content = prepared(ui.ctx(), slot, key, move || Content::of(message));
        let content = match content.as_deref() {
            Some(Ok(content)) => content,
            Some(Err(error)) => {
                return widgets::empty(ui, icons::ICON_ERROR, "These models cannot be read", error);
            }
            // They are being read.
            None => return,
        };
        heading(ui, cx.frame, topic, &content.models, self.refused.as_deref());
        ScrollArea::vertical().auto_shrink(false).show(ui, |ui| {
            let deletes = Deletes::of(cx.frame, topic);
            let refused = deletes.as_ref().err().map(String::as_str);
            let leaving = self.leaving.as_ref().filter(|(of, _)| *of == content.message);
            let shown = cards::Shown {
                now: cx.frame.now,
                models: &content.models,
                pictures: content.pictures.as_ref(),
                refused,
                leaving: leaving.map(|(_, index)| *index),
            };
            let deleted = cards::show(ui, &shown);
            if let (Some(index), Ok(deletes)) = (deleted, deletes) {
                deletes.send(cx, index, content.models.name_of(index));
                self.leaving = Some((content.message.clone(), index));
            }
        });
        match asked {
            Some(Asked::Save) => {
                let (topic, message) = (TopicKey::of(topic), sample.message.clone());
                cx.wishes.push(Wish::SaveMessage { topic, message });
            }
            Some(Asked::Load) => {
                if let Ok(place) = place {
                    let (process, field) = (place.process.name.as_str().into(), place.field);
                    cx.wishes.push(Wish::LoadParam { process, field });
                }
            }
            Some(Asked::DeleteAll) => self.refused = place.and_then(|place| place.write(cx, "")).err(),
            None => {}
        }
    }
}

/// The topics with models.
fn topics(frame: &Frame) -> Vec<&Topic> {
    frame.topics.iter().filter(|topic| topic.role() == Some(Role::Models)).collect()
}

impl Models {
    /// The topic that is shown: the chosen one, else the first one with models.
    fn shown<'a>(&self, frame: &'a Frame, topics: &[&'a Topic]) -> Option<&'a Topic> {
        let chosen = self.saved.topic.as_ref().and_then(|key| key.find(frame));
        let with_models = || topics.iter().copied().find(|topic| topic.latest.is_some());
        chosen.or_else(with_models).or_else(|| topics.first().copied())
    }

    fn toolbar(
        &mut self,
        ui: &mut Ui,
        frame: &Frame,
        shown: &Topic,
        topics: &[&Topic],
        place: Result<&Place<'_>, &String>,
    ) -> Option<Asked> {
        /// What the items change.
        struct Toolbar<'a> {
            saved: &'a mut Saved,
            asked: Option<Asked>,
        }
        let why = place.err().map(String::as_str);
        let mut bar: Bar<'_, Toolbar<'_>> = Bar::new("toolbar");
        bar.left("topic", Fit::Leaves(60), |ui, form, cx| {
            if let Some(key) = topic_choice(ui, form, frame, "Models to show", Some(shown), topics) {
                cx.saved.topic = Some(key);
            }
        });
        let items = [
            ("delete", 10, icons::ICON_DELETE_SWEEP, "Delete all that was learned", Asked::DeleteAll),
            ("load", 20, icons::ICON_FILE_OPEN, "Load models from a file", Asked::Load),
            ("save", 30, icons::ICON_SAVE, "Save the models to a file", Asked::Save),
        ];
        for (name, worth, icon, text, what) in items {
            bar.right(name, Fit::Leaves(worth), move |ui, form, cx: &mut Toolbar<'_>| {
                let can = if what == Asked::Save { shown.latest.is_some() } else { why.is_none() };
                let button = bar::tool_of(ui, form, icon, text, false, can);
                if button.on_disabled_hover_text(why.unwrap_or("There is nothing to save yet.")).clicked() {
                    cx.asked = Some(what);
                }
            });
        }
        let mut cx = Toolbar { saved: &mut self.saved, asked: None };
        crate::toolbar::show(ui, bar, &mut cx);
        cx.asked
    }
}

/// Number and age of the models, and why the last change was refused.
fn heading(ui: &mut Ui, frame: &Frame, topic: &Topic, read: &Read, refused: Option<&str>) {
    let tokens = tokens(ui);
    let margin = egui::Margin { left: 8, right: 8, top: 4, bottom: 0 };
    egui::Frame::new().inner_margin(margin).show(ui, |ui| {
        ui.horizontal_wrapped(|ui| {
            let count = read.models.len();
            let text = format!("{count} {}", if count == 1 { "model" } else { "models" });
            ui.label(RichText::new(text).color(tokens.strong));
            let age = format::age(topic.age_s(frame.now).unwrap_or(0.0));
            if is_old(topic, frame.now) {
                widgets::tag(ui, &format!("old: {age}"), tokens.stale);
            } else {
                ui.label(RichText::new(format!("age {age}")).small().color(tokens.weak));
            }
            if !topic.writer.is_empty() {
                ui.label(RichText::new(format!("learned by {}", topic.writer)).small().color(tokens.weak));
            }
        });
        if let Some(refused) = refused {
            ui.add(egui::Label::new(RichText::new(refused).color(tokens.error)).wrap());
        }
    });
}

/// The process that writes a topic, and the name of its output; an error says why nothing can be sent to it.
fn writer<'a>(frame: &'a Frame, topic: &Topic) -> Result<(&'a ProcessInfo, &'a str), String> {
    if let Some(why) = refusal(frame) {
        return Err(why.to_owned());
    }
    let outputs = frame.processes.iter().flat_map(|info| info.outputs.iter().map(move |port| (info, port)));
    let found = outputs.into_iter().find(|(_, port)| port.buffer == *topic.name);
    let (process, port) = found.ok_or("No process writes these models.")?;
    Ok((process, &port.name))
}

/// How one model of a topic is deleted.
struct Deletes<'a> {
    process: &'a ProcessInfo,
    output: &'a str,
    command: &'a CommandInfo,
}

impl<'a> Deletes<'a> {
    /// An error says why none can be deleted.
    fn of(frame: &'a Frame, topic: &Topic) -> Result<Self, String> {
        let (process, output) = writer(frame, topic)?;
        let schema = schema_of::<ModelToDelete>().name();
        let command = process.commands.iter().find(|command| command.parameters_schema == schema);
        let command =
            command.ok_or_else(|| format!("{} has no command that deletes a model.", process.name))?;
        Ok(Self { process, output, command })
    }

    fn send(&self, cx: &mut ViewContext<'_>, index: usize, name: &str) {
        let number = u32::try_from(index).unwrap_or(u32::MAX);
        let message =
            AnyMessage::new(ModelToDelete { output: self.output.to_owned(), number, name: name.to_owned() });
        command::send(cx, self.process, &self.command.name, Some(&message));
    }
}

/// Where the models of a topic are kept: a parameter of the process that writes them.
struct Place<'a> {
    process: &'a ProcessInfo,
    field: String,
    in_force: AnyMessage,
}

impl<'a> Place<'a> {
    /// An error says why they cannot be changed.
    fn of(frame: &'a Frame, topic: &Topic) -> Result<Self, String> {
        let (process, output) = writer(frame, topic)?;
        let in_force = in_force(frame, process).ok_or("The parameters of the process are not known yet.")?;
        let known = in_force.schema().descriptor().map(specs).unwrap_or_default();
        let is_kept = known.iter().any(|spec| spec.file.is_some() && spec.name == output);
        let field = output.to_owned();
        is_kept
            .then_some(Self { process, field, in_force })
            .ok_or_else(|| format!("{} has no parameter {:?} that holds models.", process.name, output))
    }

    /// Sets the parameter.
    fn write(&self, cx: &mut ViewContext<'_>, text: &str) -> Result<(), String> {
        let changed = [(self.field.as_str(), text)];
        let message = with_params(&self.in_force, changed).map_err(|error| error.to_string())?;
        cx.controls.push(Control::Write { buffer: self.process.params_buffer.clone(), message });
        Ok(())
    }
}

#[cfg(test)]
mod tests;
