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
use rcs_msg::{AnyMessage, Stamp};
use rcs_runtime::RunId;
use rcs_runtime::source::{Compared, Control, Frame, Topic};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

pub use crate::keys::{FieldKey, RunChoice, TopicKey};
pub use crate::links::{Hover, HoverPoint, Hovers, Preview, PreviewStage, Previews};

/// The run of a frame that is shown beside the viewed run; `None` for the viewed run.
pub(crate) fn run_beside(frame: &Frame) -> Option<RunId> {
    frame.is_beside.then(|| frame.runs.current())
}

/// Whether the newest message of a topic is outdated: the one rule of all views.
pub(crate) fn is_old(topic: &Topic, now: Stamp) -> bool {
    topic.age_s(now).is_some_and(|age_s| stale::is_stale(age_s, topic.due_hz().unwrap_or(0.0)))
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

impl Selection {
    /// Takes back the last change of the mission that is being drawn on the map under the pointer; whether there was one.
    pub fn undo_under_pointer(&mut self) -> bool {
        let Some(map) = self.hovered.get().mission.as_deref() else { return false };
        self.drafts.missions.get_mut(map).is_some_and(MissionDraft::undo)
    }

    /// Does the change again that was taken back last, as [`Self::undo_under_pointer`]; whether there was one.
    pub fn redo_under_pointer(&mut self) -> bool {
        let Some(map) = self.hovered.get().mission.as_deref() else { return false };
        self.drafts.missions.get_mut(map).is_some_and(MissionDraft::redo)
    }
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
    /// The one that was closed last, if it had changes that were not sent or is on its way, by the frame of the map.
    pub(crate) closed_missions: BTreeMap<String, MissionDraft>,
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
        self.all_missions_mut().for_each(MissionDraft::forget_sending);
        self.examples.values_mut().for_each(Example::forget_sent);
        self.fields.values_mut().for_each(FieldsDraft::forget_sent);
        self
    }

    /// The missions that are being drawn, and those that were closed.
    pub(crate) fn all_missions_mut(&mut self) -> impl Iterator<Item = &mut MissionDraft> {
        self.missions.values_mut().chain(self.closed_missions.values_mut())
    }
}

/// What a view draws of a topic, the most first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Draws {
    /// It draws the topic.
    Now,
    /// It draws the topic beside the others once it is dropped on the view.
    OnceDropped,
    /// It cannot draw the topic, or only in place of what it draws.
    Never,
}

/// Where a topic is to be shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ShowIn {
    /// In a view that lists the fields of what is selected.
    Fields,
    /// In the view that draws it, else in a new one.
    View,
    /// In a new view that draws it.
    NewView,
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
        /// Where.
        place: ShowIn,
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

    /// Whether it draws this topic, or would.
    fn draws(&self, _frame: &Frame, _topic: &Topic) -> Draws {
        Draws::Never
    }

    /// Whether it shows whatever topic is selected.
    fn shows_selection(&self) -> bool {
        false
    }

    /// Called when an accepted topic is dropped on the view.
    fn drop_topic(&mut self, _topic: &Topic) {}

    /// Called on a new view that is opened for an accepted topic.
    fn open_for(&mut self, _frame: &Frame, topic: &Topic) {
        self.drop_topic(topic);
    }

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

    /// Whether it shows the moment in the other recording with which it compares.
    fn shows_other(&self) -> bool {
        false
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
