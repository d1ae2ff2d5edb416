//! The interface of a view, and what it receives.

use crate::edit::draft::Draft as FieldsDraft;
use crate::map::draft::Draft as MissionDraft;
use crate::map::example::Example;
use crate::operator::{DriveSettings, Hand};
use crate::sweep::{SweepRequest, SweepState};
use crate::tuning::draft::Draft as ParamsDraft;
use egui::Ui;
use ocu_ui::{stale, tokens};
use rcs_formula::FieldRef;
use rcs_msg::{AnyMessage, FieldPath, Stamp};
use rcs_runtime::RunId;
use rcs_runtime::source::{Compared, Control, Frame, RunTag, Topic};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Arc, Weak};

/// Which run is meant, where several contain a topic of the same name.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RunChoice {
    /// The run being shown.
    #[default]
    Shown,
    /// The recording.
    Recorded,
    /// The run with this number.
    Run(u32),
}

impl RunChoice {
    /// The run, if it is not the one being shown.
    pub fn id(self) -> Option<RunId> {
        match self {
            Self::Run(run) => Some(RunId(run)),
            Self::Shown | Self::Recorded => None,
        }
    }

    /// What topics and series of the run are marked with in a frame.
    pub(crate) fn tag(self, frame: &Frame) -> RunTag {
        match self {
            Self::Shown => RunTag::Run(frame.runs.current()),
            Self::Recorded => RunTag::Recorded,
            Self::Run(run) => RunTag::Run(RunId(run)),
        }
    }

    /// Name in lists.
    pub fn name(self) -> String {
        match self {
            Self::Shown => "the viewed run".to_owned(),
            Self::Recorded => "the recording".to_owned(),
            Self::Run(run) => RunId(run).to_string(),
        }
    }
}

/// The run of a frame that is shown beside the viewed run; `None` for the viewed run.
pub(crate) fn run_beside(frame: &Frame) -> Option<RunId> {
    frame.is_beside.then(|| frame.runs.current())
}

/// Identifies a topic in layouts, in selections and while dragging.
#[derive(Clone, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(from = "StoredKey")]
pub struct TopicKey {
    /// Name of the buffer: `/wm1/map`.
    pub name: String,
    /// The run.
    pub run: RunChoice,
}

/// A key as stored in layouts: older versions have `recorded` instead of `run`.
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
    /// The key of a topic; for a computed topic, in whichever run is shown.
    pub fn of(topic: &Topic) -> Self {
        let run = if topic.run.is_recorded() { RunChoice::Recorded } else { RunChoice::Shown };
        Self { name: topic.name.to_string(), run }
    }

    /// The topic with this name in the run being shown.
    pub fn shown(name: impl Into<String>) -> Self {
        Self { name: name.into(), run: RunChoice::Shown }
    }

    /// Finds the topic in a frame; in another run where it does not exist in the one that is meant.
    pub fn find<'a>(&self, frame: &'a Frame) -> Option<&'a Topic> {
        frame.topic_of(&self.name, self.run.tag(frame)).or_else(|| frame.topic(&self.name))
    }

    /// Whether the key identifies exactly this topic.
    pub fn is(&self, topic: &Topic) -> bool {
        let same_run = match (self.run, topic.run) {
            (RunChoice::Recorded, run) => run.is_recorded(),
            (RunChoice::Shown, run) => !run.is_recorded(),
            (RunChoice::Run(number), run) => run == RunTag::Run(RunId(number)),
        };
        *self.name == *topic.name && same_run
    }
}

/// Identifies a field of a topic while dragging.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FieldKey {
    /// The topic.
    pub topic: TopicKey,
    /// Path of the field.
    pub path: FieldPath,
}

/// Whether the newest message of a topic is outdated: the one rule of all views.
pub(crate) fn is_old(topic: &Topic, now: Stamp) -> bool {
    topic.age_s(now).is_some_and(|age_s| stale::is_stale(age_s, rate_hz(topic)))
}

/// Whether the run has computed a message of the topic with this name.
pub(crate) fn is_computed(frame: &Frame, name: &str) -> bool {
    let mut named = frame.topics.iter().filter(|topic| *topic.name == *name);
    named.any(|topic| !topic.run.is_recorded() && topic.latest.is_some())
}

/// Whether a topic was recorded, and the run has computed a message of the same name: views show that of the run first.
pub(crate) fn is_twin(frame: &Frame, topic: &Topic) -> bool {
    topic.run.is_recorded() && is_computed(frame, &topic.name)
}

/// Last known rate of a topic; 0 where unknown, as for a single message.
pub(crate) fn rate_hz(topic: &Topic) -> f64 {
    topic.hz.unwrap_or(0.0)
}

/// A position in a frame.
#[derive(Clone, Debug)]
pub struct HoverPoint {
    /// Coordinate frame of the position.
    pub frame_id: String,
    /// x, y, z, m; z is NaN where unknown.
    pub position_m: [f64; 3],
}

/// Unknown coordinates are equal: a pointer that rests asks for no repaint.
impl PartialEq for HoverPoint {
    fn eq(&self, other: &Self) -> bool {
        let bits = |point: &Self| point.position_m.map(f64::to_bits);
        self.frame_id == other.frame_id && bits(self) == bits(other)
    }
}

/// What is under the pointer, as one view says it; the other views mark what they show of it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Hover {
    /// The topic.
    pub topic: Option<TopicKey>,
    /// The process.
    pub process: Option<Arc<str>>,
    /// Path of a field of the topic.
    pub field: Option<Arc<str>>,
    /// Column and row of a cell of the topic.
    pub cell: Option<[usize; 2]>,
    /// Position in an image of the topic, pixels from its left upper corner.
    pub pixel: Option<[f64; 2]>,
    /// A position in space.
    pub point: Option<HoverPoint>,
    /// A time of the source.
    pub time: Option<Stamp>,
}

/// What is hovered, in two phases: all views read what was said in the last pass, and say what holds in this one. So
/// links work between all views, whichever is painted first.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Hovers {
    last: Hover,
    next: Hover,
}

impl Hovers {
    /// What was hovered in the last pass.
    pub fn get(&self) -> &Hover {
        &self.last
    }

    /// Says what is hovered now.
    pub fn set(&mut self, hover: Hover) {
        self.next = hover;
    }

    /// What has been said in this pass.
    pub fn said(&mut self) -> &mut Hover {
        &mut self.next
    }

    /// Ends a pass; returns whether views have to be painted again.
    pub fn turn(&mut self) -> bool {
        let changed = self.next != self.last;
        self.last = std::mem::take(&mut self.next);
        changed
    }
}

/// The user's selection, shared by all views.
#[derive(Clone, Debug, Default)]
pub struct Selection {
    /// The topic clicked last.
    pub topic: Option<TopicKey>,
    /// The process clicked last.
    pub process: Option<Arc<str>>,
    /// What is under the pointer; the window ends each pass with [`Hovers::turn`].
    pub hovered: Hovers,
    /// Parameters that are being edited; views show their effect before they are sent. The window ends each pass with
    /// [`Previews::turn`].
    pub preview: Previews,
    /// What was not sent.
    pub drafts: Drafts,
    /// Deflection of the drive controls; the window sets it from the keys before each pass, and sends the command after
    /// it.
    pub hand: Hand,
    /// Whether the drive controls act only after they have been let go; the window sets it.
    pub let_go_first: bool,
    /// Whether the bar at the top has the button that releases an emergency stop; the window sets it.
    pub can_release: bool,
    /// Speeds of manual driving.
    pub drive: DriveSettings,
    /// The serial of the last command that a view sent to each process.
    pub serials: BTreeMap<String, u64>,
    /// The sweep that runs, or ran last; the window sets it.
    pub sweep: Arc<SweepState>,
}

/// Work that was not sent. It outlives the views in which it is done, so that another layout loses none of it, and views of
/// the same thing share it.
#[derive(Clone, Debug, Default)]
pub struct Drafts {
    /// Edited parameters, by process, and by the run where a view shows another one than the viewed one: other parameters
    /// are in force there.
    pub(crate) params: BTreeMap<(String, Option<RunId>), ParamsDraft>,
    /// Missions that are being drawn, by the frame of the map.
    pub(crate) missions: BTreeMap<String, MissionDraft>,
    /// Examples for learning that are being drawn, by the frame of the map.
    pub(crate) examples: BTreeMap<String, Example>,
    /// Edited fields, by topic, and by the run as above.
    pub(crate) fields: BTreeMap<(TopicKey, Option<RunId>), FieldsDraft>,
    /// Parameters of commands, by process and command.
    pub(crate) commands: BTreeMap<(String, String), CommandDraft>,
    /// A condition that is being written.
    pub(crate) condition: String,
}

/// Parameters of a command.
#[derive(Clone, Debug)]
pub(crate) struct CommandDraft {
    /// The complete parameters.
    pub(crate) params: AnyMessage,
    /// Those that were sent last. A control that is let go with them sends nothing.
    pub(crate) sent: Option<AnyMessage>,
}

impl Drafts {
    /// The drafts where the same source begins again: the new run has none of what was sent to the one before.
    /// Parameters of commands stay as they are: a control that is let go unchanged sends nothing in the new run, either.
    #[must_use]
    pub fn after_restart(mut self) -> Self {
        self.params.values_mut().for_each(ParamsDraft::forget_sent);
        self.missions.values_mut().for_each(MissionDraft::replaced);
        self.examples.values_mut().for_each(Example::forget_sent);
        self.fields.values_mut().for_each(FieldsDraft::forget_sent);
        self
    }
}

/// Parameters that count in no map yet: they are being edited, or were sent after the newest map was made.
#[derive(Clone, Debug)]
pub struct Preview {
    /// The process to which they belong.
    pub process: Arc<str>,
    /// The run of its parameters; maps of other runs are not previewed.
    pub run: RunTag,
    /// The complete parameters.
    pub params: AnyMessage,
    /// The complete parameters with which the newest map was made.
    pub before: AnyMessage,
    /// Whether they were sent, and nothing was edited since.
    pub is_sent: bool,
}

impl PartialEq for Preview {
    fn eq(&self, other: &Self) -> bool {
        (&self.process, self.run, self.is_sent) == (&other.process, other.run, other.is_sent)
            && self.params.same(&other.params)
            && self.before.same(&other.before)
    }
}

/// A preview, and the view that stated it.
#[derive(Clone, Debug)]
struct Stated {
    preview: Preview,
    by: Weak<()>,
}

/// What is being edited, in two phases as [`Hovers`]. A preview stays while its view exists, also hidden, until the view
/// ends it or another one states its own.
#[derive(Clone, Debug, Default)]
pub struct Previews {
    last: Option<Stated>,
    next: Option<Stated>,
    is_ended: bool,
}

impl PartialEq for Previews {
    fn eq(&self, other: &Self) -> bool {
        self.get() == other.get()
    }
}

impl Previews {
    /// What was being edited in the last pass.
    pub fn get(&self) -> Option<&Preview> {
        self.last.as_ref().map(|stated| &stated.preview)
    }

    /// A view states what is edited in it. `by` belongs to the view alone, and is dropped with it.
    pub fn set(&mut self, by: &Arc<()>, preview: Preview) {
        self.next = Some(Stated { preview, by: Arc::downgrade(by) });
    }

    /// A view states that it edits nothing of a process, or nothing at all. The previews of other views stay.
    pub fn end(&mut self, by: &Arc<()>, process: Option<&str>) {
        let ends = |stated: &Stated| {
            let is_own = stated.by.ptr_eq(&Arc::downgrade(by));
            is_own && process.is_none_or(|process| *stated.preview.process == *process)
        };
        self.is_ended |= self.last.as_ref().is_some_and(ends);
    }

    /// Ends a pass; returns whether views have to be painted again.
    pub fn turn(&mut self) -> bool {
        let is_ended = std::mem::take(&mut self.is_ended);
        let last = self.last.take();
        let stays = |stated: &&Stated| !is_ended && stated.by.strong_count() > 0;
        self.last = self.next.take().or_else(|| last.as_ref().filter(stays).cloned());
        self.get() != last.as_ref().map(|stated| &stated.preview)
    }
}

/// What a view asks of the window, beyond requests to the source.
#[derive(Clone, Debug)]
pub enum Wish {
    /// Write these parameters of a process into the stack file, after showing the difference.
    SaveParams {
        /// The process.
        process: Arc<str>,
        /// Its complete parameters.
        params: AnyMessage,
    },
    /// Save a message to a file, as JSON.
    SaveMessage {
        /// Its topic, for the name of the file.
        topic: TopicKey,
        /// The message.
        message: AnyMessage,
    },
    /// Set a parameter to the text of a file.
    LoadParam {
        /// The process.
        process: Arc<str>,
        /// Path of the parameter.
        field: String,
    },
    /// Show a topic.
    Show {
        /// The topic.
        topic: TopicKey,
        /// Whether it is drawn in a new view; otherwise its fields are listed.
        drawn: bool,
    },
    /// Prepare a command with parameters: in the view that is open, else in a new one.
    Command {
        /// The process to which it is to be sent.
        process: Arc<str>,
        /// Its name.
        command: String,
    },
    /// Plot a field: in the plot that is open, else in a new one.
    Plot(FieldKey),
    /// Choose another recording to compare with.
    ChooseOther,
    /// Run a sweep of the open stack in the background.
    Sweep(SweepRequest),
    /// End the sweep that runs.
    CancelSweep,
    /// Open the recording of a run of a sweep in place of what is open.
    OpenRun {
        /// The recording.
        path: PathBuf,
        /// What tells the run from the others: `wm1.cell_m=0.2, seed 3`.
        title: String,
    },
    /// Write a file, after asking where.
    SaveFile {
        /// Its proposed name.
        name: String,
        /// Its content.
        content: Arc<[u8]>,
    },
    /// Write a part of the window as a PNG image, after asking where.
    SavePicture {
        /// The proposed name of the file.
        name: String,
        /// The part.
        area: egui::Rect,
    },
}

/// The input and output of a view in one pass.
pub struct ViewContext<'a> {
    /// The state of the source at the time being shown.
    pub frame: &'a Frame,
    /// Requests to the source; the window sends them after the pass.
    pub controls: &'a mut Vec<Control>,
    /// The selection; any view may change it.
    pub selection: &'a mut Selection,
    /// What the window is asked for; it is carried out after the pass.
    pub wishes: &'a mut Vec<Wish>,
}

/// The part of a view's state that a layout stores. Caches (textures, decoded images) are not included.
pub type SavedState = serde_json::Value;

/// One panel of the window.
pub trait View {
    /// Title of the tab.
    fn title(&self, frame: &Frame) -> String;

    /// Paints the view into the whole area of `ui`.
    fn ui(&mut self, ui: &mut Ui, cx: &mut ViewContext<'_>);

    /// Called in every pass before views are painted, also while the view is hidden behind another one.
    fn watch(&mut self, _ctx: &egui::Context, _cx: &mut ViewContext<'_>) {}

    /// Whether this topic can be dropped on the view.
    fn accepts(&self, _topic: &Topic) -> bool {
        false
    }

    /// Whether it shows whatever topic is selected.
    fn shows_selection(&self) -> bool {
        false
    }

    /// Called when an accepted topic is dropped on the view.
    fn drop_topic(&mut self, _topic: &Topic) {}

    /// The fields whose values over time it needs; the window asks the source for those of all views.
    fn fields(&self) -> Vec<FieldRef> {
        Vec::new()
    }

    /// The runs that it shows beside the viewed one.
    fn runs(&self) -> Vec<RunId> {
        Vec::new()
    }

    /// What it compares.
    fn compares(&self) -> Option<[Compared; 2]> {
        None
    }

    /// Whether fields can be dropped on the view.
    fn accepts_fields(&self) -> bool {
        false
    }

    /// Called when a field is dropped on the view, at this point of the screen.
    fn drop_field(&mut self, _field: &FieldKey, _at: egui::Pos2) {}

    /// Whether commands with parameters can be sent from the view.
    fn sends_commands(&self) -> bool {
        false
    }

    /// Called when this command of this process is to be prepared in the view.
    fn choose_command(&mut self, _process: &str, _command: &str) {}

    /// Returns the state to store in a layout.
    fn save(&self) -> SavedState {
        SavedState::Null
    }

    /// Restores what [`View::save`] returned, possibly in an older version of the program: missing fields keep their
    /// defaults. Returns an error, and leaves the view unchanged, if the value does not fit.
    fn load(&mut self, _saved: &SavedState) -> Result<(), serde_json::Error> {
        Ok(())
    }
}

/// An entry of the list of views.
#[derive(Clone, Copy, Debug)]
pub struct ViewType {
    /// Name in layouts; it must never change.
    pub kind: &'static str,
    /// Displayed name.
    pub name: &'static str,
    /// Its icon.
    pub icon: ocu_ui::Icon,
    /// One sentence that describes what it shows.
    pub summary: &'static str,
    /// Creates a view in its default state.
    pub make: fn() -> Box<dyn View>,
}

/// Paints a view into the whole area of `ui`, and handles dropped topics.
pub fn show(view: &mut dyn View, ui: &mut Ui, cx: &mut ViewContext<'_>) {
    let rect = ui.available_rect_before_wrap();
    view.ui(ui, cx);
    take_field(view, ui, rect);
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

/// Handles a dropped field.
fn take_field(view: &mut dyn View, ui: &Ui, rect: egui::Rect) {
    let Some(field) = egui::DragAndDrop::payload::<FieldKey>(ui.ctx()) else { return };
    if !ui.rect_contains_pointer(rect) || !view.accepts_fields() {
        return;
    }
    let stroke = egui::Stroke::new(2.0, tokens(ui).accent);
    ui.painter().rect_stroke(rect, 0.0, stroke, egui::StrokeKind::Inside);
    let at = ui.input(|input| input.pointer.interact_pos()).unwrap_or(rect.center());
    if ui.input(|input| input.pointer.any_released()) {
        view.drop_field(&field, at);
        egui::DragAndDrop::clear_payload(ui.ctx());
    }
}

#[cfg(test)]
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
