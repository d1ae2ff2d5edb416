//! What every view is, and what it gets.

use crate::operator::{DriveSettings, Hand};
use egui::Ui;
use ocu_ui::tokens;
use rcs_runtime::RunId;
use rcs_runtime::source::{Control, Frame, RunTag, Topic};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Which run's topic is meant where several have one of that name.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RunChoice {
    /// The run that is looked at.
    #[default]
    Shown,
    /// The recording.
    Recorded,
    /// That run, by its number.
    Run(u32),
}

/// Names a topic of a frame: stored in layouts, dragged from the buffer list, selected.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(from = "StoredKey")]
pub struct TopicKey {
    /// Name of the buffer: `/wm1/map`.
    pub name: String,
    /// The run that is meant.
    pub run: RunChoice,
}

/// A key as layouts hold it: older ones say `recorded` where newer ones say `run`.
#[derive(Deserialize)]
struct StoredKey {
    name: String,
    #[serde(default)]
    run: Option<RunChoice>,
    #[serde(default)]
    recorded: bool,
}

impl From<StoredKey> for TopicKey {
    fn from(stored: StoredKey) -> Self {
        let old = if stored.recorded { RunChoice::Recorded } else { RunChoice::Shown };
        Self { name: stored.name, run: stored.run.unwrap_or(old) }
    }
}

impl TopicKey {
    /// The key of that topic; of what runs, whichever run is looked at.
    pub fn of(topic: &Topic) -> Self {
        let run = if topic.run.is_recorded() { RunChoice::Recorded } else { RunChoice::Shown };
        Self { name: topic.name.to_string(), run }
    }

    /// The topic of that name in the run that is looked at.
    pub fn shown(name: impl Into<String>) -> Self {
        Self { name: name.into(), run: RunChoice::Shown }
    }

    /// The topic in a frame; the other run's where there is none of the run that is meant.
    pub fn find<'a>(&self, frame: &'a Frame) -> Option<&'a Topic> {
        let run = match self.run {
            RunChoice::Shown => RunTag::Run(frame.runs.current()),
            RunChoice::Recorded => RunTag::Recorded,
            RunChoice::Run(number) => RunTag::Run(RunId(number)),
        };
        frame.topic_of(&self.name, run).or_else(|| frame.topic(&self.name))
    }

    /// Whether it names this very topic.
    pub fn is(&self, topic: &Topic) -> bool {
        let same_run = match (self.run, topic.run) {
            (RunChoice::Recorded, run) => run.is_recorded(),
            (RunChoice::Shown, run) => !run.is_recorded(),
            (RunChoice::Run(number), run) => run == RunTag::Run(RunId(number)),
        };
        *self.name == *topic.name && same_run
    }
}

/// Rate of a topic when it last spoke, 0 where it is not known: a message that came once has none.
pub(crate) fn rate_hz(topic: &Topic) -> f64 {
    topic.hz.unwrap_or(0.0)
}

/// A place that the pointer is on, in one view, so that the others can light it.
#[derive(Clone, Debug, PartialEq)]
pub struct HoverPoint {
    /// Coordinate frame of the position.
    pub frame_id: String,
    /// x, y, z in metres; z is NaN where it is not known.
    pub position_m: [f64; 3],
}

/// What a person has chosen, shared by all views.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Selection {
    /// The topic that was clicked last.
    pub topic: Option<TopicKey>,
    /// The process that was clicked last.
    pub process: Option<Arc<str>>,
    /// The place under the pointer; the window clears it before each pass.
    pub hovered: Option<HoverPoint>,
    /// Where a person pushes; the window sets it to what the keys say before each pass, and drives by it after.
    pub hand: Hand,
    /// How fast a push drives.
    pub drive: DriveSettings,
}

/// All that a view gets.
pub struct ViewContext<'a> {
    /// The moment that is shown.
    pub frame: &'a Frame,
    /// What the view asks the source for; the window sends it after the pass.
    pub controls: &'a mut Vec<Control>,
    /// What is chosen; any view may change it.
    pub selection: &'a mut Selection,
}

/// The part of a view that a layout keeps. What can be made anew (textures, decoded images) is not in it.
pub type SavedState = serde_json::Value;

/// One panel of the window.
pub trait View {
    /// Title of its tab.
    fn title(&self, frame: &Frame) -> String;

    /// Paints itself into all of `ui`.
    fn ui(&mut self, ui: &mut Ui, cx: &mut ViewContext<'_>);

    /// Whether this topic can be dropped on it.
    fn accepts(&self, _topic: &Topic) -> bool {
        false
    }

    /// A topic was dropped on it that it accepts.
    fn drop_topic(&mut self, _topic: &Topic) {}

    /// What a layout keeps.
    fn save(&self) -> SavedState {
        SavedState::Null
    }

    /// Takes what [`View::save`] gave, perhaps in an older version of the program: fields that are missing keep
    /// their defaults. Fails, and leaves the view as it was, where the value does not fit.
    fn load(&mut self, _saved: &SavedState) -> Result<(), serde_json::Error> {
        Ok(())
    }
}

/// An entry of the list of views.
#[derive(Clone, Copy)]
pub struct ViewType {
    /// Name in layouts; never changes.
    pub kind: &'static str,
    /// Name for a person.
    pub name: &'static str,
    /// Its icon.
    pub icon: ocu_ui::Icon,
    /// One sentence that says what it shows.
    pub summary: &'static str,
    /// Makes one in its default state.
    pub make: fn() -> Box<dyn View>,
}

/// Shows a view in all of `ui`, and lets topics be dropped on it.
pub fn show(view: &mut dyn View, ui: &mut Ui, cx: &mut ViewContext<'_>) {
    let rect = ui.available_rect_before_wrap();
    view.ui(ui, cx);
    let Some(key) = egui::DragAndDrop::payload::<TopicKey>(ui.ctx()) else { return };
    let over = ui.rect_contains_pointer(rect);
    let Some(topic) = key.find(cx.frame).filter(|topic| over && view.accepts(topic)) else { return };
    let stroke = egui::Stroke::new(2.0, tokens(ui).accent);
    ui.painter().rect_stroke(rect, 0.0, stroke, egui::StrokeKind::Inside);
    if ui.input(|input| input.pointer.any_released()) {
        view.drop_topic(topic);
        egui::DragAndDrop::clear_payload(ui.ctx());
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a test may fail")]
mod tests {
    use super::*;

    #[test]
    fn keys_of_older_layouts_open_and_newer_ones_keep_their_run() {
        let read = |text: &str| serde_json::from_str::<TopicKey>(text).unwrap();
        assert_eq!(read(r#"{"name":"/a"}"#), TopicKey::shown("/a"));
        assert_eq!(read(r#"{"name":"/a","recorded":false}"#), TopicKey::shown("/a"));
        assert_eq!(read(r#"{"name":"/a","recorded":true}"#).run, RunChoice::Recorded);
        for run in [RunChoice::Shown, RunChoice::Recorded, RunChoice::Run(3)] {
            let key = TopicKey { name: "/a".into(), run };
            assert_eq!(read(&serde_json::to_string(&key).unwrap()), key);
        }
    }
}
