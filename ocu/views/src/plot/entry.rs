//! The line in which a formula is written, with what it can be completed to.

use egui::{RichText, Sense, TextEdit, Ui, Vec2, WidgetInfo};
use ocu_ui::{tokens, typing, widgets};
use rcs_formula::{FieldRef, Formula, functions};
use rcs_msg::{FieldPath, Value};
use rcs_runtime::source::{Frame, Topic};
use serde::{Deserialize, Serialize};

/// Number of completions that are listed.
const MOST: usize = 10;
/// Fields that are looked at to complete a path.
const MOST_LEAVES: usize = 5000;

/// The line, while it is open.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub(super) struct Entry {
    text: String,
    /// The curve that is changed, by graph and index; `None` for a new one.
    pub(super) of: Option<(usize, usize)>,
    /// The formula of that curve when the line was opened.
    pub(super) was: String,
    /// Whether it takes the focus. A layout that brings the line back leaves the focus where it is.
    #[serde(skip)]
    fresh: bool,
}

/// What became of the line.
pub(super) enum Entered {
    Open,
    Closed,
    Formula(String),
}

/// A completion: what is shown, and the whole text with it.
struct Completion {
    label: String,
    note: String,
    text: String,
}

impl Entry {
    /// A line that begins with a text, for a new curve, or for one that exists.
    pub(super) fn new(text: String, of: Option<(usize, usize)>) -> Self {
        let was = if of.is_some() { text.clone() } else { String::new() };
        Self { text, of, was, fresh: true }
    }

    /// Paints the line and its completions.
    pub(super) fn ui(&mut self, ui: &mut Ui, frame: &Frame) -> Entered {
        let mut entered = Entered::Open;
        let frame_margin = egui::Margin::symmetric(8, 4);
        egui::Frame::new().inner_margin(frame_margin).fill(tokens(ui).surface[3]).show(ui, |ui| {
            let id = ui.scope_id().with("formula");
            let completions = completions(frame, &self.text);
            // Tab takes the first completion; it leaves the field for the next widget where there is none.
            let tab = |input: &mut egui::InputState| input.consume_key(egui::Modifiers::NONE, egui::Key::Tab);
            let completes = ui.memory(|memory| memory.has_focus(id)) && !completions.is_empty();
            let mut taken = (completes && ui.input_mut(tab)).then(|| completions[0].text.clone());
            let parsed = self.text.parse::<Formula>();
            ui.horizontal(|ui| {
                let verb = if self.of.is_some() { "Change" } else { "Add" };
                let edit = TextEdit::singleline(&mut self.text)
                    .font(egui::TextStyle::Monospace)
                    .hint_text("/buffer.field, or a formula such as smooth(/buffer.field, 0.5)")
                    .desired_width((ui.available_width() - 128.0).max(80.0))
                    .id(id)
                    .lock_focus(completes);
                let response = ui.add(edit);
                ui.ctx().accesskit_node_builder(response.id, |node| node.set_label("Formula"));
                if std::mem::take(&mut self.fresh) {
                    response.request_focus();
                }
                let done = typing::entered(&response);
                if (ui.add_enabled(parsed.is_ok(), egui::Button::new(verb)).clicked() || done)
                    && parsed.is_ok()
                {
                    entered = Entered::Formula(self.text.trim().to_owned());
                }
                if ui.button("Cancel").clicked() || ui.input(|input| input.key_pressed(egui::Key::Escape)) {
                    entered = Entered::Closed;
                }
            });
            if let Err(error) = parsed
                && !self.text.trim().is_empty()
            {
                ui.label(RichText::new(error.to_string()).small().color(tokens(ui).weak));
            }
            let mut names = widgets::RowNames::default();
            for completion in &completions {
                // Values change what is found, and a problem above moves it.
                if names.named(ui, &completion.text, |ui| row(ui, completion).clicked()) {
                    taken = Some(completion.text.clone());
                }
            }
            if let Some(text) = taken {
                self.text = text;
                self.fresh = true;
                widgets::cursor_to_end(ui.ctx(), id, &self.text);
            }
        });
        entered
    }
}

fn row(ui: &mut Ui, completion: &Completion) -> egui::Response {
    let tokens = tokens(ui);
    let (rect, response) = ui.allocate_exact_size(Vec2::new(ui.available_width(), 18.0), Sense::click());
    response.widget_info(|| {
        WidgetInfo::labeled(egui::Role::Button, true, format!("Complete to {}", completion.label))
    });
    if response.hovered() {
        ui.painter().rect_filled(rect, 0.0, tokens.surface[2]);
    }
    let (left, right) = rect.split_left_right_at_fraction(0.6);
    let mono = egui::FontId::monospace(12.0);
    widgets::cell(ui, left, egui::Align::Min, &completion.label, mono, tokens.text);
    widgets::cell(
        ui,
        right,
        egui::Align::Min,
        &completion.note,
        egui::FontId::proportional(11.0),
        tokens.weak,
    );
    response
}

/// The name of a buffer as a formula contains it, up to the dot before a field.
pub(super) fn begun(topic: &str) -> String {
    format!("{}.", FieldRef { topic: topic.to_owned(), path: FieldPath::root() })
}

/// Where the word at the end of a text begins. Between braces any character belongs to it.
fn begin_of_word(text: &str) -> usize {
    let (mut begin, mut in_braces) = (0, false);
    for (at, c) in text.char_indices() {
        match c {
            '}' => in_braces = false,
            _ if in_braces => {}
            '{' => {
                in_braces = true;
                // A path in braces follows its name in braces.
                if !text[..at].ends_with('}') {
                    begin = at;
                }
            }
            _ if " (,+-*%<>=!&|".contains(c) => begin = at + 1,
            _ => {}
        }
    }
    begin
}

/// What the end of a text can become: a buffer, one of its fields, or a function.
fn completions(frame: &Frame, text: &str) -> Vec<Completion> {
    let (before, word) = text.split_at(begin_of_word(text));
    let whole = |end: String| format!("{before}{end}");
    if !word.starts_with(['/', '{']) {
        let is_meant = |name: &str| !word.is_empty() && name.starts_with(word);
        let named = functions().iter().filter(|function| is_meant(function.name));
        let named = named.map(|function| Completion {
            label: function.call.to_owned(),
            note: function.summary.to_owned(),
            text: whole(format!("{}(", function.name)),
        });
        return named.take(MOST).collect();
    }
    // The path after the name of a topic, if the word begins with that.
    let path_in = |topic: &Topic| {
        let braced = format!("{{{}}}", topic.name);
        let rest = word.strip_prefix(&*topic.name).or_else(|| word.strip_prefix(&braced))?;
        (rest.is_empty() || rest.starts_with(['.', '['])).then(|| rest.to_owned())
    };
    let topic = frame.topics.iter().filter(|topic| path_in(topic).is_some());
    if let Some(topic) = topic.max_by_key(|topic| topic.name.len()) {
        let rest = path_in(topic).unwrap_or_default();
        let value = topic.latest.as_ref().and_then(|sample| sample.message.value().ok());
        let Some(value) = value else { return Vec::new() };
        let leaves =
            value.leaves().take(MOST_LEAVES).filter(|(_, value)| !matches!(value, Value::Message(_)));
        let meant = leaves.filter(|(path, _)| {
            let path = path.to_string();
            path != rest && path.to_lowercase().contains(rest.trim_start_matches('.').to_lowercase().as_str())
        });
        return meant
            .take(MOST)
            .map(|(path, value)| {
                let field = FieldRef { topic: topic.name.to_string(), path: path.clone() };
                Completion { label: path.to_string(), note: note(value), text: whole(field.to_string()) }
            })
            .collect();
    }
    let searched = word.trim_start_matches('{').to_lowercase();
    let named = frame.topics.iter().filter(|topic| topic.name.to_lowercase().contains(&searched));
    named
        .map(|topic| Completion {
            label: topic.name.to_string(),
            note: topic.schema.name().to_owned(),
            text: whole(begun(&topic.name)),
        })
        .take(MOST)
        .collect()
}

/// What a value is now.
fn note(value: &Value) -> String {
    match value {
        Value::Text(text) => format!("{:?}", text.chars().take(40).collect::<String>()),
        Value::Enum { name, .. } => name.clone(),
        Value::Bool(value) => value.to_string(),
        other => match (other.as_f64(), other.len()) {
            (Some(number), _) => ocu_ui::format::number(number),
            (None, Some(length)) => format!("{} of {length}", other.kind()),
            (None, None) => other.kind().to_owned(),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples;

    fn completed(frame: &Frame, text: &str) -> Vec<String> {
        completions(frame, text).into_iter().map(|completion| completion.text).collect()
    }

    fn labels(text: &str) -> Vec<String> {
        completed(&samples::full(), text)
    }

    #[test]
    fn a_word_is_completed_to_a_buffer_then_to_a_field() {
        assert_eq!(labels("smooth(/planner/st"), ["smooth(/planner/status."]);
        assert!(labels("/planner/status.").contains(&"/planner/status.cycle".to_owned()));
        assert_eq!(labels("/planner/status.cyc"), ["/planner/status.cycle"]);
        assert_eq!(labels("2 * der"), ["2 * derivative("]);
        assert!(labels("").is_empty());
    }

    #[test]
    fn a_buffer_with_other_characters_in_its_name_is_completed_in_braces() {
        let mut frame = samples::full();
        let mut odd = frame.topic("/planner/status").unwrap().clone();
        odd.name = "/odd-name, front".into();
        frame.topics = frame.topics.iter().cloned().chain([odd]).collect();
        for text in ["2 * /odd", "2 * {/odd", "2 * {/odd-name, f"] {
            assert_eq!(completed(&frame, text), ["2 * {/odd-name, front}."]);
        }
        let formulas = completed(&frame, "2 * {/odd-name, front}.cyc");
        let field = FieldRef { topic: "/odd-name, front".to_owned(), path: "cycle".parse().unwrap() };
        assert_eq!(formulas.len(), 1);
        assert_eq!(formulas[0].parse::<Formula>().unwrap().fields(), [field]);
        // A word after it is completed as any other.
        let both = completed(&frame, "{/odd-name, front}.cycle - /planner/status.cyc");
        assert_eq!(both, ["{/odd-name, front}.cycle - /planner/status.cycle"]);
        assert_eq!((begun("/odd-name"), begun("/a")), ("{/odd-name}.".into(), "/a.".into()));
    }
}
