//! The contents of the window.

use super::keys::{self, Action};
use super::layout_store::LayoutStore;
use super::notices::Notices;
use super::open::{self, Invited, Opener, Outcome};
use super::operate::Operating;
use super::timeline::Timeline;
use super::top_bar::{self, TopBarAction};
use super::tree::{Workspace, view_menu};
use crate::layout::Layout;
use crate::open::Request;
use crate::say;
use ocu_ui::{icons, tokens, widgets};
use ocu_views::{Selection, View, ViewContext};
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
    help_open: bool,
    layout_store: LayoutStore,
    /// Whether the user chose the layout; otherwise it is selected to suit the source.
    is_layout_chosen: bool,
}

impl Window {
    /// A window that starts to open the source in `options`. `ocu_ui::install` must have been called on the context.
    pub fn new(ctx: &egui::Context, options: Options) -> Self {
        let Options { request, layout, data_dir } = options;
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
            help_open: false,
            layout_store: LayoutStore::new(data_dir.as_ref().map(|dir| dir.join("layouts"))),
            is_layout_chosen: false,
        };
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
        self.shown = Shown::Live(driver);
        self.current = request;
        self.timeline.forget();
        self.operating.forget();
        // The speeds of manual driving are kept.
        self.selection = Selection { drive: self.selection.drive, ..Selection::default() };
    }

    /// Stores the arrangement for the next start.
    pub fn keep_layout(&mut self) {
        if let Some(workspace) = &self.workspace {
            self.layout_store.keep(&workspace.layout(self.buffers_open), &mut self.notices);
        }
    }

    /// Paints the window.
    pub fn ui(&mut self, ui: &mut egui::Ui) {
        self.take_opened();
        self.take_dropped(ui);
        let frame = self.shown.frame();
        let mut controls = Vec::new();
        self.take_keys(ui, frame.as_deref(), &mut controls);
        self.selection.hovered = None;
        let live = frame.as_deref().filter(|_| matches!(self.shown, Shown::Live(_)));
        self.selection.hand =
            live.map(|frame| self.operating.take_keys(ui, frame, &mut controls)).unwrap_or_default();

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
        self.help_ui(ui);

        if let (Shown::Live(driver), Some(frame)) = (&self.shown, &frame) {
            self.operating.finish(ui, frame, &self.selection, &mut controls);
            // Repaint while the source works, or may have started to, to show the progress.
            if !controls.is_empty() || driver.busy().is_some() {
                self.ctx.request_repaint_after(LOOK_AGAIN);
            }
            for control in controls {
                driver.send(control);
            }
        }
        if self.layout_store.is_due() {
            self.keep_layout();
        }
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
            stop: frame.map(|frame| self.operating.stop_state(frame)).unwrap_or_default(),
        };
        top_bar::ui(ui, &state)
    }

    fn source_ui(&mut self, ui: &mut egui::Ui, frame: &Frame, bar: egui::Frame, controls: &mut Vec<Control>) {
        let bottom = egui::Panel::bottom("timeline").frame(bar).resizable(false);
        bottom.show(ui, |ui| self.timeline.ui(ui, frame, controls));
        let mut cx = ViewContext { frame, controls, selection: &mut self.selection };
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

    fn help_ui(&mut self, ui: &egui::Ui) {
        egui::Window::new("Keys")
            .open(&mut self.help_open)
            .collapsible(false)
            .resizable(false)
            .anchor(egui::Align2::CENTER_CENTER, egui::Vec2::ZERO)
            .show(ui.ctx(), keys::list);
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

    fn take_keys(&mut self, ui: &egui::Ui, frame: Option<&Frame>, controls: &mut Vec<Control>) {
        for action in keys::pressed(ui) {
            match (action, frame) {
                (Action::Open, _) => self.opener.ask(),
                (Action::Help, _) => self.help_open = !self.help_open,
                // While time runs, the arrow keys drive.
                (action, Some(frame)) if action.is_arrow() && Operating::drives(frame) => {}
                (action, Some(frame)) => controls.extend(self.timeline.key(action, frame, &self.selection)),
                (_, None) => {}
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
            TopBarAction::Help => self.help_open = !self.help_open,
            TopBarAction::AddView(view_type) => {
                self.workspace.get_or_insert_with(|| Workspace::new(&Layout::empty())).add(view_type);
            }
            TopBarAction::Layout(name) => match Layout::named(&name) {
                Ok(layout) => self.choose(&layout),
                Err(error) => self.notices.error(say(&error)),
            },
            TopBarAction::FittingLayout => {
                self.is_layout_chosen = false;
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
        self.keep_layout();
        self.is_layout_chosen = true;
        self.arrange(layout);
    }

    /// Applies the layout that suits the source, as the user last arranged it.
    fn arrange_for(&mut self, frame: &Frame) {
        let fitting = Layout::for_content(frame);
        let stays =
            self.workspace.as_ref().is_some_and(|now| self.is_layout_chosen || now.name() == fitting.name);
        if !stays {
            self.keep_layout();
            let kept = self.layout_store.load(&fitting.name, &mut self.notices);
            self.arrange(&kept.unwrap_or(fitting));
        }
    }

    fn arrange(&mut self, layout: &Layout) {
        self.buffers_open = layout.buffers;
        self.workspace = Some(Workspace::new(layout));
    }
}
