//! The contents of the window.

use super::commands::{Command, Needs};
use super::document::Document;
use super::focus::{cancel, show_focus};
use super::keymap::Keymap;
use super::layout_store::LayoutStore;
use super::notices::Notices;
use super::open::{self, Invited, Opener, Outcome};
use super::operate::{Operating, StopState};
use super::palette::{Choice, KeyList, Palette};
use super::save_params::{SaveParams, Saved};
use super::timeline::Timeline;
use super::top_bar::{self, TopBarAction};
use super::tree::{Workspace, view_menu};
use crate::bundled;
use crate::layout::Layout;
use crate::open::Request;
use crate::say;
use ocu_ui::{icons, tokens, widgets};
use ocu_views::{Selection, View, ViewContext, Wish};
use rcs_runtime::RunId;
use rcs_runtime::source::{Control, Driver, Frame, Source, SourceKind};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

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
enum Shown {
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
enum Chosen {
    /// It was selected to suit the source.
    Nothing,
    /// Before anything was open.
    BeforeOpening,
    /// When the layout with this name suited the source.
    For(String),
}

/// The window's contents and their state.
pub struct Window {
    ctx: egui::Context,
    shown: Shown,
    /// The request of the open source.
    current: Request,
    workspace: Option<Workspace>,
    buffers: Option<Box<dyn View>>,
    buffers_open: bool,
    selection: Selection,
    timeline: Timeline,
    operating: Operating,
    opener: Opener,
    notices: Notices,
    keymap: Keymap,
    key_list: KeyList,
    palette: Palette,
    save_params: Option<SaveParams>,
    layout_store: LayoutStore,
    document: Document,
    chosen: Chosen,
    /// The runs that the source was last asked to show beside the viewed one.
    watched: Vec<RunId>,
}

impl Window {
    /// A window that starts to open the source in `options`. `ocu_ui::install` must have been called on the context.
    pub fn new(ctx: &egui::Context, options: Options) -> Self {
        let Options { request, layout, data_dir } = options;
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
            save_params: None,
            layout_store: LayoutStore::new(data_dir.as_ref().map(|dir| dir.join("layouts"))),
            document: Document::default(),
            chosen: Chosen::Nothing,
            watched: Vec::new(),
        };
        if let Some(error) = wrong_keys {
            window.notices.error(error);
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

    /// The state of the source at the time being shown.
    pub fn frame(&self) -> Option<Arc<Frame>> {
        self.shown.frame()
    }

    /// Shows an open source in place of the previous one.
    fn show_source(&mut self, request: Request, source: Box<dyn Source>) {
        let ctx = self.ctx.clone();
        let driver = match Driver::spawn(source, move || ctx.request_repaint()) {
            Ok(driver) => driver,
            Err(error) => {
                return self.notices.error(format!("no thread to play {}: {error}", request.title()));
            }
        };
        self.arrange_for(&driver.frame());
        let title = format!("{} – OCU", driver.frame().info.title);
        self.ctx.send_viewport_cmd(egui::ViewportCommand::Title(title));
        if driver.frame().info.kind == SourceKind::Stack {
            // A stack has nothing to show until it runs.
            driver.send(Control::Play);
        }
        if let Shown::Live(old) = std::mem::replace(&mut self.shown, Shown::Live(driver)) {
            old.close();
        }
        self.watched.clear();
        self.current = request;
        self.timeline.forget();
        self.operating.forget();
        // The speeds of manual driving are kept.
        self.selection = Selection { drive: self.selection.drive, ..Selection::default() };
    }

    /// Stores the arrangement for the next start, and waits until that is done.
    pub fn keep_layout(&mut self) {
        self.record_layout();
        self.layout_store.finish();
    }

    /// Records the arrangement after an action of the user, for undo and for the next start.
    fn record_layout(&mut self) {
        let Some(workspace) = &self.workspace else { return };
        let layout = workspace.layout(self.buffers_open);
        if self.document.record(&layout) {
            self.layout_store.keep(&layout);
        }
    }

    /// Paints the window.
    pub fn ui(&mut self, ui: &mut egui::Ui) {
        self.take_opened();
        self.take_dropped(ui);
        let frame = self.shown.frame();
        let mut controls = Vec::new();
        let live = frame.as_deref().filter(|_| matches!(self.shown, Shown::Live(_)));
        let stops = live.is_some_and(|frame| self.operating.stop_state(frame) != StopState::None);
        let acted = self.take_keys(ui.ctx(), stops, frame.as_deref(), &mut controls);
        self.selection.hovered = None;
        self.selection.let_go_first = self.operating.is_blocked();
        self.selection.hand = live.map(|frame| self.operating.take_keys(ui, frame)).unwrap_or_default();

        let fill = tokens(ui).panel();
        let bar = egui::Frame::new().fill(fill).inner_margin(egui::Margin::symmetric(8, 4));
        let top = egui::Panel::top("top").frame(bar).resizable(false);
        let actions = top.show(ui, |ui| self.top(ui, frame.as_deref())).inner;
        for action in actions {
            self.perform(action, frame.as_deref(), &mut controls);
        }
        let source_error = frame.as_ref().and_then(|frame| frame.playback.error.clone());
        if !self.notices.is_empty(source_error.as_deref()) {
            let top = egui::Panel::top("notices").frame(bar).resizable(false);
            top.show(ui, |ui| self.notices.ui(ui, source_error.as_deref()));
        }
        match &frame {
            Some(frame) => self.source_ui(ui, frame, bar, &mut controls),
            None => self.empty_ui(ui),
        }
        if let Some(path) = self.opener.ui(ui) {
            self.open_path(&path);
        }
        self.key_list_ui(ui);
        match self.save_params.as_mut().map(|dialog| dialog.ui(ui.ctx())) {
            None | Some(Saved::Open) => {}
            Some(Saved::Cancelled) => self.save_params = None,
            Some(Saved::Written(path)) => {
                self.save_params = None;
                // From now on this is the stack that runs: it has these parameters.
                self.current.stack = Some(path.display().to_string());
            }
        }
        self.palette_ui(ui, frame.as_deref(), &mut controls);
        show_focus(ui.ctx(), stops);

        if let (Shown::Live(driver), Some(frame)) = (&self.shown, &frame) {
            self.operating.finish(ui, frame, &self.selection, &mut controls);
            let runs = self.workspace.as_ref().map(Workspace::runs).unwrap_or_default();
            if runs != self.watched {
                controls.push(Control::Watch(runs.clone()));
                self.watched = runs;
            }
            // Repaint while the source works, or may have started to, to show the progress.
            if !controls.is_empty() || driver.busy().is_some() {
                self.ctx.request_repaint_after(LOOK_AGAIN);
            }
            for control in controls {
                driver.send(control);
            }
        }
        if acted || may_have_changed(ui) {
            self.record_layout();
        }
        self.layout_store.report(&mut self.notices);
    }

    fn top(&self, ui: &mut egui::Ui, frame: Option<&Frame>) -> Vec<TopBarAction> {
        let layout_name = self.workspace.as_ref().map_or("", Workspace::name);
        let state = top_bar::State {
            frame,
            busy: if let Shown::Live(driver) = &self.shown { driver.busy() } else { None },
            current: &self.current,
            opening: self.opener.opening(),
            recent: self.opener.recent(),
            buffers_open: self.buffers_open,
            layout_name,
            own_layouts: self.layout_store.own_names(),
            keymap: &self.keymap,
            stop: frame.map(|frame| self.operating.stop_state(frame)).unwrap_or_default(),
            pushed: self.operating.is_pushed(),
        };
        top_bar::ui(ui, &state)
    }

    fn source_ui(&mut self, ui: &mut egui::Ui, frame: &Frame, bar: egui::Frame, controls: &mut Vec<Control>) {
        let bottom = egui::Panel::bottom("timeline").frame(bar).resizable(false);
        bottom.show(ui, |ui| self.timeline.ui(ui, frame, controls));
        let mut wishes = Vec::new();
        let mut cx = ViewContext { frame, controls, selection: &mut self.selection, wishes: &mut wishes };
        if let Some(buffers) = self.buffers.as_mut().filter(|_| self.buffers_open) {
            let panel = egui::Frame::new().fill(tokens(ui).panel());
            let left =
                egui::Panel::left("buffers").frame(panel).default_size(300.0).size_range(180.0..=600.0);
            left.show(ui, |ui| {
                ui.push_id("buffers", |ui| ocu_views::show(buffers.as_mut(), ui, &mut cx));
            });
        }
        let middle = egui::Frame::new().fill(tokens(ui).canvas());
        egui::CentralPanel::default().frame(middle).show(ui, |ui| match &mut self.workspace {
            Some(workspace) if !workspace.is_empty() => workspace.ui(ui, &mut cx),
            _ => {
                widgets::empty(
                    ui,
                    icons::ICON_DASHBOARD,
                    "No view is open",
                    "Add one, or choose a layout above.",
                );
                ui.vertical_centered(|ui| {
                    let chosen = ui.menu_button("Add a view", view_menu).inner.flatten();
                    if let Some(view_type) = chosen {
                        self.workspace.get_or_insert_with(|| Workspace::new(&Layout::empty())).add(view_type);
                    }
                });
            }
        });
        for Wish::SaveParams { process, params } in wishes {
            self.save_params = Some(SaveParams::new(&self.current, &process, &params));
        }
    }

    fn empty_ui(&mut self, ui: &mut egui::Ui) {
        let middle = egui::Frame::new().fill(tokens(ui).canvas());
        let invited =
            egui::CentralPanel::default().frame(middle).show(ui, |ui| match self.opener.opening() {
                Some(title) => {
                    open::waiting(ui, &title);
                    None
                }
                None => open::invitation(ui, self.opener.recent()),
            });
        match invited.inner {
            Some(Invited::Ask) => self.opener.ask(),
            Some(Invited::Open(request)) => self.opener.open(request),
            None => {}
        }
    }

    fn key_list_ui(&mut self, ui: &egui::Ui) {
        if self.key_list.is_open() {
            self.key_list.ui(ui.ctx(), &mut self.keymap);
        }
    }

    fn palette_ui(&mut self, ui: &egui::Ui, frame: Option<&Frame>, controls: &mut Vec<Control>) {
        if !self.palette.is_open() {
            return;
        }
        let layouts = bundled::names("layout").into_iter().map(str::to_owned);
        let layouts: Vec<String> = layouts.chain(self.layout_store.own_names().iter().cloned()).collect();
        let state = frame.map(|frame| (frame.info.kind, self.operating.stop_state(frame)));
        let can = |needs| match needs {
            Needs::Nothing => true,
            Needs::Source => state.is_some(),
            Needs::Stack => state.is_some_and(|(kind, _)| kind != SourceKind::Log),
            Needs::Vehicle => state.is_some_and(|(_, stop)| stop != StopState::None),
        };
        match self.palette.ui(ui.ctx(), &self.keymap, &layouts, can) {
            Some(Choice::Command(command)) => self.run(command, frame, controls),
            Some(Choice::View(view_type)) => self.perform(TopBarAction::AddView(view_type), frame, controls),
            Some(Choice::Layout(name)) => self.perform(TopBarAction::Layout(name), frame, controls),
            None => return,
        }
        self.record_layout();
    }

    /// Shows a source that has been opened since the last pass.
    fn take_opened(&mut self) {
        match self.opener.poll() {
            Some(Outcome::Opened(request, source)) => self.show_source(request, source),
            Some(Outcome::Failed(text)) => self.notices.error(text),
            None => {}
        }
    }

    fn take_dropped(&mut self, ui: &egui::Ui) {
        let files = ui.input_mut(|input| std::mem::take(&mut input.raw.dropped_files));
        if let [first, rest @ ..] = files.as_slice() {
            if !rest.is_empty() {
                self.notices
                    .error(format!("{} files were dropped; one can be opened at a time", files.len()));
            }
            self.open_path(first.path());
        }
    }

    /// Opens a recording, a stack or a layout.
    fn open_path(&mut self, path: &Path) {
        if path.extension().is_none_or(|extension| !extension.eq_ignore_ascii_case("ron")) {
            return self.opener.open(Request::dropped(path, &self.current));
        }
        match Layout::load(path) {
            Ok(layout) => self.choose(&layout),
            Err(error) => self.notices.error(say(&error)),
        }
    }

    /// Carries out the commands of the keys that were pressed; returns whether there was any.
    fn take_keys(
        &mut self,
        ctx: &egui::Context,
        stops: bool,
        frame: Option<&Frame>,
        controls: &mut Vec<Control>,
    ) -> bool {
        self.key_list.take_key(ctx, &mut self.keymap);
        let commands = self.keymap.pressed(ctx, stops);
        for &command in &commands {
            self.run(command, frame, controls);
        }
        !commands.is_empty()
    }

    /// Carries out a command.
    fn run(&mut self, command: Command, frame: Option<&Frame>, controls: &mut Vec<Control>) {
        match command {
            Command::EmergencyStop => {
                if let Some(frame) = frame {
                    self.operating.emergency_stop(frame, true, controls);
                }
            }
            Command::Cancel => cancel(&self.ctx),
            Command::Open => self.opener.ask(),
            Command::Keys => self.key_list.toggle(),
            Command::Palette => self.palette.toggle(),
            Command::Restart => self.perform(TopBarAction::Restart, frame, controls),
            Command::TakeBack => controls.push(Control::Undo),
            Command::Buffers => self.buffers_open = !self.buffers_open,
            Command::Theme => self.perform(TopBarAction::ToggleTheme, frame, controls),
            Command::FittingLayout => self.perform(TopBarAction::FittingLayout, frame, controls),
            Command::ResetLayout => {
                let name = self.workspace.as_ref().map(|workspace| workspace.name().to_owned());
                match name.as_deref().and_then(Layout::bundled) {
                    Some(Ok(layout)) => self.arrange(&layout),
                    Some(Err(error)) => self.notices.error(error.to_string()),
                    None => self.notices.error("this layout is your own; expected one that comes with OCU"),
                }
            }
            Command::UndoLayout => {
                if let Some(layout) = self.document.undo() {
                    self.arrange(&layout);
                }
            }
            Command::RedoLayout => {
                if let Some(layout) = self.document.redo() {
                    self.arrange(&layout);
                }
            }
            Command::PlayPause
            | Command::Step { .. }
            | Command::StepCycle { .. }
            | Command::StepSecond { .. }
            | Command::ToStart
            | Command::ToEnd
            | Command::Loop => {
                controls
                    .extend(frame.and_then(|frame| self.timeline.command(command, frame, &self.selection)));
            }
        }
    }

    fn perform(&mut self, action: TopBarAction, frame: Option<&Frame>, controls: &mut Vec<Control>) {
        match action {
            TopBarAction::Ask => self.opener.ask(),
            TopBarAction::Open(request) => {
                controls.extend(self.make_room());
                self.opener.open(request);
            }
            TopBarAction::Restart => {
                controls.extend(self.make_room());
                self.opener.open(self.current.clone());
            }
            TopBarAction::EmergencyStop(active) => {
                if let Some(frame) = frame {
                    self.operating.emergency_stop(frame, active, controls);
                }
            }
            TopBarAction::Cancel => controls.push(Control::Cancel),
            TopBarAction::SwitchRun(run) => controls.push(Control::SwitchRun(run)),
            TopBarAction::Undo => controls.push(Control::Undo),
            TopBarAction::ToggleBuffers => self.buffers_open = !self.buffers_open,
            TopBarAction::ToggleTheme => {
                let dark = self.ctx.theme() == egui::Theme::Dark;
                self.ctx.set_theme(if dark { egui::Theme::Light } else { egui::Theme::Dark });
                // This pass was laid out with the old colours.
                self.ctx.request_repaint();
            }
            TopBarAction::Help => self.key_list.toggle(),
            TopBarAction::Palette => self.palette.toggle(),
            TopBarAction::Run(command) => self.run(command, frame, controls),
            TopBarAction::AddView(view_type) => {
                self.workspace.get_or_insert_with(|| Workspace::new(&Layout::empty())).add(view_type);
            }
            TopBarAction::Layout(name) => {
                // As the user last arranged it; how it comes is a command of its own.
                let kept = self.layout_store.load(&name, &mut self.notices);
                match kept.map_or_else(|| Layout::named(&name), Ok) {
                    Ok(layout) => self.choose(&layout),
                    Err(error) => self.notices.error(say(&error)),
                }
            }
            TopBarAction::SaveLayout(name) => {
                if let Some(workspace) = &mut self.workspace {
                    workspace.rename(name);
                }
                self.record_layout();
            }
            TopBarAction::FittingLayout => {
                self.chosen = Chosen::Nothing;
                if let Some(frame) = frame {
                    self.arrange_for(frame);
                }
            }
        }
    }

    /// Pauses a running stack, which would slow down opening the next source.
    fn make_room(&self) -> Option<Control> {
        let is_stack = self.frame().is_some_and(|frame| frame.info.kind == SourceKind::Stack);
        is_stack.then_some(Control::Pause)
    }

    /// Applies a layout chosen by the user.
    fn choose(&mut self, layout: &Layout) {
        self.record_layout();
        self.chosen = match self.frame() {
            Some(frame) => Chosen::For(Layout::for_content(&frame).name),
            None => Chosen::BeforeOpening,
        };
        self.arrange(layout);
    }

    /// Applies the layout that suits the source, as the user last arranged it. One that the user chose stays for
    /// sources of the same kind.
    fn arrange_for(&mut self, frame: &Frame) {
        let fitting = Layout::for_content(frame);
        if self.chosen == Chosen::BeforeOpening {
            self.chosen = Chosen::For(fitting.name.clone());
        }
        let is_chosen = matches!(&self.chosen, Chosen::For(suited) if *suited == fitting.name);
        let stays = self.workspace.as_ref().is_some_and(|now| is_chosen || now.name() == fitting.name);
        if !stays {
            self.chosen = Chosen::Nothing;
            self.record_layout();
            let kept = self.layout_store.load(&fitting.name, &mut self.notices);
            self.arrange(&kept.unwrap_or(fitting));
        }
    }

    /// Goes to an arrangement; views that are in both stay.
    fn arrange(&mut self, layout: &Layout) {
        self.buffers_open = layout.buffers;
        match &mut self.workspace {
            Some(workspace) => workspace.apply(layout),
            None => self.workspace = Some(Workspace::new(layout)),
        }
        self.record_layout();
    }
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
