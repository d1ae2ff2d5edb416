//! The contents of the window: their state, and one pass over them.

use super::alarm_sound::AlarmSound;
use super::bookmarks::Bookmarks;
use super::density;
use super::document::Document;
use super::file_dialogs::FileDialogs;
use super::focus::show_focus;
use super::follow::Follow;
use super::frames::FramePolicy;
use super::keymap::Keymap;
use super::known_alarms::KnownAlarms;
use super::layout_store::LayoutStore;
use super::leaving::Leaving;
use super::notices::{Matter, Notices};
use super::open::Opener;
use super::operate::{Operating, StopState};
use super::palette::{KeyList, Palette};
use super::recording::Told;
use super::state_lane;
use super::sweeping::Sweeping;
use super::timeline::Timeline;
use super::tree::Workspace;
use crate::layout::Layout;
use crate::open::Request;
use ocu_ui::tokens;
use ocu_views::{Selection, View};
use rcs_runtime::RunId;
use rcs_runtime::source::{Compared, Control, Driver, Frame};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Repaint interval while the progress of a long operation is shown.
const LOOK_AGAIN: Duration = Duration::from_millis(150);

/// Initial state of a window.
#[derive(Debug, Default)]
pub struct Options {
    /// What to open; nothing if it is empty.
    pub request: Request,
    /// Layout to start with; by default one that suits the source, as the user last arranged it.
    pub layout: Option<Layout>,
    /// Folder for the arrangement and the list of recent recordings; `None` to store nothing.
    pub data_dir: Option<PathBuf>,
}

/// The source being shown.
pub(super) enum Shown {
    Nothing,
    /// A source that can be played.
    Live(Driver),
    /// One fixed time, for an image.
    Still(Arc<Frame>),
}

impl Shown {
    fn frame(&self) -> Option<Arc<Frame>> {
        match self {
            Self::Nothing => None,
            Self::Live(driver) => Some(driver.frame()),
            Self::Still(frame) => Some(Arc::clone(frame)),
        }
    }
}

/// Whether the user chose the layout, which then stays until another one suits the source.
#[derive(Debug, PartialEq)]
pub(super) enum Chosen {
    /// It was selected to suit the source.
    Nothing,
    /// Before anything was open.
    BeforeOpening,
    /// When the layout with this name suited the source.
    For(String),
}

/// The window's contents and their state.
pub struct Window {
    pub(super) ctx: egui::Context,
    pub(super) shown: Shown,
    /// The request of the open source.
    pub(super) current: Request,
    pub(super) workspace: Option<Workspace>,
    pub(super) buffers: Option<Box<dyn View>>,
    pub(super) buffers_open: bool,
    pub(super) selection: Selection,
    pub(super) timeline: Timeline,
    pub(super) operating: Operating,
    pub(super) opener: Opener,
    pub(super) notices: Notices,
    pub(super) keymap: Keymap,
    pub(super) key_list: KeyList,
    pub(super) palette: Palette,
    pub(super) dialogs: FileDialogs,
    pub(super) layout_store: LayoutStore,
    pub(super) document: Document,
    pub(super) chosen: Chosen,
    /// The runs that the source was last asked to show beside the viewed one.
    pub(super) watched: Vec<RunId>,
    /// The fields that the source was last asked to gather.
    pub(super) gathered: Vec<rcs_formula::FieldRef>,
    /// What the source was last asked to compare.
    pub(super) compared: Vec<[Compared; 2]>,
    /// Whether the source was last asked to show the moment in the other recording.
    pub(super) shows_other: bool,
    pub(super) frames: FramePolicy,
    /// Number of runs of the source that the user knows of.
    pub(super) known_runs: usize,
    /// The alarms that have been acknowledged.
    pub(super) known_alarms: KnownAlarms,
    pub(super) alarm_sound: AlarmSound,
    pub(super) marks: Bookmarks,
    /// The file of the recording, while it may grow.
    pub(super) follow: Option<Follow>,
    /// What was told about recordings.
    pub(super) told: Told,
    /// The question whether to leave a source.
    pub(super) leaving: Leaving,
    pub(super) sweeping: Sweeping,
    /// The title that the desktop was last told.
    title: String,
}

impl Window {
    /// A window that starts to open the source in `options`. `ocu_ui::install` must have been called on the context.
    pub fn new(ctx: &egui::Context, options: Options) -> Self {
        let Options { request, layout, data_dir } = options;
        // Only the commands zoom, by the keys that the user gives them.
        ctx.options_mut(|options| options.zoom_with_keyboard = false);
        let (keymap, wrong_keys) = Keymap::load(data_dir.as_ref().map(|dir| dir.join("keys.ron")));
        let mut window = Self {
            ctx: ctx.clone(),
            shown: Shown::Nothing,
            current: Request::default(),
            workspace: None,
            buffers: ocu_views::view_type("buffers").map(|buffers| (buffers.make)()),
            buffers_open: true,
            selection: Selection::default(),
            timeline: Timeline::default(),
            operating: Operating::default(),
            opener: Opener::new(ctx, data_dir.as_deref()),
            notices: Notices::default(),
            keymap,
            key_list: KeyList::default(),
            palette: Palette::default(),
            dialogs: FileDialogs::default(),
            sweeping: Sweeping::new(data_dir.as_deref()),
            layout_store: LayoutStore::new(data_dir.as_deref().map(crate::kept_layouts::folder)),
            document: Document::default(),
            chosen: Chosen::Nothing,
            watched: Vec::new(),
            gathered: Vec::new(),
            compared: Vec::new(),
            shows_other: true,
            frames: FramePolicy::default(),
            known_runs: 0,
            known_alarms: KnownAlarms::default(),
            leaving: Leaving::default(),
            alarm_sound: AlarmSound::default(),
            marks: Bookmarks::default(),
            follow: None,
            told: Told::default(),
            title: String::new(),
        };
        if let Some(error) = wrong_keys {
            window.notices.error(Matter::Layout, error);
        }
        if let Some(layout) = layout {
            window.choose(&layout);
        }
        if request != Request::default() {
            window.opener.open(request);
        }
        window
    }

    /// A window that shows one fixed time and cannot play, for `ocu render`.
    pub fn still(ctx: &egui::Context, request: &Request, frame: Arc<Frame>, layout: &Layout) -> Self {
        let mut window = Self::new(ctx, Options { layout: Some(layout.clone()), ..Options::default() });
        window.shown = Shown::Still(frame);
        window.current = request.clone();
        window
    }

    /// Says that the processor draws, so that fewer frames leave it to the stack.
    pub fn draws_in_software(&mut self) {
        self.frames = FramePolicy::software();
    }

    /// The state of the source at the time being shown.
    pub fn frame(&self) -> Option<Arc<Frame>> {
        self.shown.frame()
    }

    /// Stores the arrangement for the next start, and waits until that is done.
    pub fn keep_layout(&mut self) {
        self.record_layout();
        self.layout_store.finish();
    }

    /// Records the arrangement after an action of the user, for undo and for the next start.
    pub(super) fn record_layout(&mut self) {
        let Some(workspace) = &self.workspace else { return };
        let layout = workspace.layout(self.buffers_open);
        if self.document.record(&layout) {
            self.layout_store.keep(&layout);
        }
    }

    /// Paints the window.
    pub fn ui(&mut self, ui: &mut egui::Ui) {
        self.take_opened();
        self.follow();
        let mut controls = Vec::new();
        self.take_dropped(ui, &mut controls);
        let frame = self.shown.frame();
        let live = frame.as_deref().filter(|_| matches!(self.shown, Shown::Live(_)));
        let stop = live.map(|frame| self.operating.stop_state(frame)).unwrap_or_default();
        let stops = stop != StopState::None;
        let acted = self.take_keys(ui.ctx(), stops, frame.as_deref(), &mut controls);
        self.tell_title(frame.as_deref());
        let chosen = (self.selection.topic.clone(), self.selection.process.clone());
        self.sweeping.look(&self.current, frame.as_deref());
        self.selection.sweep = self.sweeping.state(&self.current);
        self.selection.let_go_first = self.operating.is_blocked();
        self.selection.can_release = stop.can_be_released();
        let hand = live.map(|frame| self.operating.take_keys(ui, frame, &self.keymap));
        self.selection.hand = hand.unwrap_or_default();

        let fill = tokens(ui).panel();
        let bar = egui::Frame::new().fill(fill).inner_margin(egui::Margin::symmetric(8, 4));
        let top = egui::Panel::top("top").frame(bar).resizable(false);
        let actions = top.show(ui, |ui| self.top(ui, frame.as_deref())).inner;
        for action in actions {
            self.perform(action, frame.as_deref(), &mut controls);
        }
        if let Some(frame) = live {
            self.tell_branch(frame, stop);
            self.told.tell(frame, &mut self.notices);
        }
        let middle = match &frame {
            Some(frame) => self.source_ui(ui, frame, bar, &mut controls),
            None => self.empty_ui(ui),
        };
        let source_error = frame.as_ref().and_then(|frame| frame.playback.error.clone());
        self.notices.ui(ui, middle, source_error.as_deref());
        self.open_dialog_ui(ui, &mut controls);
        self.key_list_ui(ui);
        self.leaving_ui(ui, &mut controls);
        let frame_now = frame.as_deref();
        self.dialogs.ui(ui.ctx(), &mut self.current, frame_now, &mut controls, &mut self.notices);
        self.palette_ui(ui, frame.as_deref(), &mut controls);
        show_focus(ui.ctx(), stops);
        let turned = [self.selection.hovered.turn(), self.selection.preview.turn()].contains(&true);
        if turned || chosen != (self.selection.topic.clone(), self.selection.process.clone()) {
            self.frames.again(ui.ctx());
        }

        if let (Shown::Live(driver), Some(frame)) = (&self.shown, &frame) {
            self.operating.finish(ui, frame, &self.selection, &mut controls);
            let runs = self.workspace.as_ref().map(Workspace::runs).unwrap_or_default();
            if runs != self.watched {
                controls.push(Control::Watch(runs.clone()));
                self.watched = runs;
            }
            let mut fields = self.workspace.as_ref().map(Workspace::fields).unwrap_or_default();
            let selected = self.selection.process.as_deref();
            let state = selected.and_then(|process| state_lane::field(frame, process));
            let times = self.selection.topic.as_ref().and_then(|topic| density::field(frame, topic));
            for field in state.into_iter().chain(times) {
                if !fields.contains(&field) {
                    fields.push(field);
                }
            }
            if fields != self.gathered {
                controls.push(Control::Gather(fields.clone()));
                self.gathered = fields;
            }
            let compared = self.workspace.as_ref().map(Workspace::compares).unwrap_or_default();
            if compared != self.compared {
                controls.push(Control::Compare(compared.clone()));
                self.compared = compared;
            }
            let shows_other = self.workspace.as_ref().is_some_and(Workspace::shows_other);
            if shows_other != self.shows_other {
                controls.push(Control::ShowOther(shows_other));
                self.shows_other = shows_other;
            }
            // Repaint while the source works, or may have started to, to show the progress.
            if !controls.is_empty() || driver.busy().is_some() {
                self.ctx.request_repaint_after(LOOK_AGAIN);
            }
            driver.show_every(self.frames.every(Instant::now(), &frame.playback));
            ocu_views::prepare::draw_within(&self.ctx, self.frames.within(&frame.playback));
            driver.reserve(ocu_views::prepare::picture_bytes(&self.ctx));
            for control in controls {
                driver.send(control);
            }
        }
        if acted || may_have_changed(ui) {
            self.record_layout();
        }
        if let Some(failure) = self.marks.take_failure() {
            self.notices.error(Matter::Open, failure);
        }
        self.layout_store.report(&mut self.notices);
    }

    /// Tells the desktop what is open, when that changes.
    fn tell_title(&mut self, frame: Option<&Frame>) {
        let title = frame.map(|frame| format!("{} – OCU", self.current.shown_title(&frame.info)));
        if let Some(title) = title.filter(|title| *title != self.title) {
            self.title.clone_from(&title);
            self.ctx.send_viewport_cmd(egui::ViewportCommand::Title(title));
        }
    }

    /// Says that another run has begun.
    fn tell_branch(&mut self, frame: &Frame, stop: StopState) {
        let known = std::mem::replace(&mut self.known_runs, frame.runs.all.len());
        if let Some(text) = branch_text(frame, known, stop) {
            self.notices.news(Matter::Run, text);
        }
    }
}

/// Where the newest run begins, if there are more of them than were known.
fn branch_text(frame: &Frame, known: usize, stop: StopState) -> Option<String> {
    let run = frame.runs.all.get(known.max(1)..)?.last()?;
    let (from, at) = run.branched_from?;
    let at = ocu_ui::format::elapsed(at.seconds_since(frame.info.start));
    // The stop that the vehicle obeys, and not one that was just sent.
    let stopped = if stop.can_be_released() { "; the emergency stop is in force there" } else { "" };
    Some(format!(
        "{} begins at {at}{stopped}. What {} did after that is kept: choose a run above, or right-click the tab of a \
         view to show both side by side.",
        run.id, from.run
    ))
}

/// Whether the user did something in this pass that may have changed the arrangement.
fn may_have_changed(ui: &egui::Ui) -> bool {
    ui.input(|input| {
        let acts = |event: &egui::Event| {
            matches!(
                event,
                egui::Event::Key { .. }
                    | egui::Event::Text(_)
                    | egui::Event::MouseWheel { .. }
                    | egui::Event::PointerButton { pressed: false, .. }
                    | egui::Event::AccessKitActionRequest(_)
            )
        };
        input.events.iter().any(acts)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcs_msg::Stamp;
    use rcs_runtime::source::{Runs, SourceInfo};
    use rcs_runtime::{Moment, RunSummary};

    #[test]
    fn the_beginning_of_a_run_says_that_an_emergency_stop_is_in_force_there() {
        let from = Moment { run: RunId(0), event: 100, write: 0 };
        let runs = [None, Some((from, Stamp(2_000_000_000)))].into_iter().zip(0..);
        let runs = runs.map(|(branched_from, id)| RunSummary {
            id: RunId(id),
            branched_from,
            end: Stamp(3_000_000_000),
            events: 200,
            writes: 1,
        });
        let runs = Runs { all: runs.collect(), ..Runs::default() };
        let frame = Frame { runs, ..Frame::empty(Arc::new(SourceInfo::default()), Stamp(2_000_000_000)) };
        let asked = StopState::Asked { active: true, late: false, waits: true };
        for (stop, is_told) in [
            (StopState::Stopped { has_speed: true }, true),
            (StopState::Braking { late: false }, true),
            (StopState::Clear, false),
            (asked, false),
        ] {
            let text = branch_text(&frame, 1, stop).unwrap();
            assert!(text.starts_with("run 1 begins at 00:00:02.000"), "{text}");
            assert_eq!(text.contains("the emergency stop is in force there"), is_told, "{stop:?}: {text}");
        }
        assert_eq!(branch_text(&frame, 2, StopState::Clear), None);
    }
}
