//! The parts of the window: the bar at the top, the timeline, the buffers, the views and what they ask for, the list of
//! keys and the palette.

use super::body::{Shown, Window};
use super::commands::Needs;
use super::follow::Follow;
use super::load_param::LoadParam;
use super::notices::Matter;
use super::open::{self, Invited};
use super::operate::StopState;
use super::palette::Choice;
use super::top_bar;
use super::top_menus::named_sources;
use super::top_state::{self, TopBarAction};
use super::tree::{Workspace, view_menu};
use crate::bundled;
use crate::layout::Layout;
use crate::open::Request;
use ocu_ui::{icons, tokens, widgets};
use ocu_views::{ViewContext, Wish};
use rcs_runtime::source::{Control, Frame, SourceKind};

impl Window {
    pub(super) fn top(&self, ui: &mut egui::Ui, frame: Option<&Frame>) -> Vec<TopBarAction> {
        let layout_name = self.workspace.as_ref().map_or("", Workspace::name);
        let state = top_state::State {
            frame,
            current: &self.current,
            opening: self.opener.opening(),
            recent: self.opener.recent(),
            buffers_open: self.buffers_open,
            layout_name,
            layouts: &self.layout_store,
            document: &self.document,
            keymap: &self.keymap,
            stop: frame.map(|frame| self.operating.stop_state(frame)).unwrap_or_default(),
            pushed: self.operating.is_pushed(),
            known_until: frame.map(|frame| self.known_alarms.until(&frame.runs)).unwrap_or_default(),
            alarm_sound: &self.alarm_sound,
            growth: self.follow.as_ref().map(Follow::growth).unwrap_or_default(),
        };
        top_bar::ui(ui, &state)
    }

    /// The timeline, the buffers and the views; returns the region of the views.
    pub(super) fn source_ui(
        &mut self,
        ui: &mut egui::Ui,
        frame: &Frame,
        bar: egui::Frame,
        controls: &mut Vec<Control>,
    ) -> egui::Rect {
        let bottom = egui::Panel::bottom("timeline").frame(bar).resizable(false);
        let busy = if let Shown::Live(driver) = &self.shown { driver.busy() } else { None };
        bottom.show(ui, |ui| {
            let Self { timeline, selection, marks, .. } = self;
            timeline.ui(ui, frame, selection, busy, marks, controls);
        });
        if self.timeline.take_clock_click() {
            self.palette.toggle();
        }
        let mut wishes = Vec::new();
        let mut cx = ViewContext { frame, controls, selection: &mut self.selection, wishes: &mut wishes };
        if let Some(buffers) = self.buffers.as_mut().filter(|_| self.buffers_open) {
            let panel = egui::Frame::new().fill(tokens(ui).panel());
            // In a narrow window it takes at most half of the room.
            let most = (0.5 * ui.available_width()).clamp(96.0, 600.0);
            let left = egui::Panel::left("buffers")
                .frame(panel)
                .default_size(300.0_f32.min(most))
                .size_range(most.min(180.0)..=most);
            left.show(ui, |ui| {
                ui.push_id("buffers", |ui| ocu_views::show(buffers.as_mut(), ui, &mut cx));
            });
        }
        let middle = egui::Frame::new().fill(tokens(ui).canvas());
        let middle = egui::CentralPanel::default().frame(middle).show(ui, |ui| match &mut self.workspace {
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
        for wish in wishes {
            match wish {
                Wish::SaveParams { process, params } => {
                    self.dialogs.save_params(&self.current, frame, &process, &params);
                }
                Wish::SaveMessage { topic, message } => {
                    if let Err(error) = self.dialogs.save_message(&topic, &message) {
                        self.notices.error(Matter::Run, error.to_string());
                    }
                }
                Wish::LoadParam { process, field } => {
                    self.dialogs.load_param = Some(LoadParam::new(process, field));
                }
                Wish::Show { topic, place } => {
                    let workspace = self.workspace.get_or_insert_with(|| Workspace::new(&Layout::empty()));
                    workspace.show_topic(frame, &topic, place);
                    ui.ctx().request_repaint();
                }
                Wish::Command { process, command } => {
                    let workspace = self.workspace.get_or_insert_with(|| Workspace::new(&Layout::empty()));
                    workspace.choose_command(&process, &command);
                    ui.ctx().request_repaint();
                }
                Wish::Plot(field) => {
                    let workspace = self.workspace.get_or_insert_with(|| Workspace::new(&Layout::empty()));
                    workspace.plot(&field);
                    ui.ctx().request_repaint();
                }
                Wish::ChooseOther => self.dialogs.choose_other(),
                Wish::Sweep(request) => self.sweeping.start(ui.ctx(), &request),
                Wish::CancelSweep => self.sweeping.cancel(),
                Wish::OpenRun { path, title } => {
                    let past = self.current.past.clone();
                    let run = Some(Box::new(self.sweeping.swept(title)));
                    let request = Request { log: Some(path), past, run, ..Request::default() };
                    self.open_asking(request, controls);
                }
                Wish::SaveFile { name, content } => self.dialogs.save_file.ask(&name, content),
                Wish::SavePicture { name, area } => self.dialogs.save_file.ask_picture(ui.ctx(), &name, area),
            }
        }
        middle.response.rect
    }

    pub(super) fn empty_ui(&mut self, ui: &mut egui::Ui) -> egui::Rect {
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
        invited.response.rect
    }

    pub(super) fn key_list_ui(&mut self, ui: &egui::Ui) {
        if self.key_list.is_open() {
            self.key_list.ui(ui.ctx(), &mut self.keymap);
        }
    }

    pub(super) fn palette_ui(&mut self, ui: &egui::Ui, frame: Option<&Frame>, controls: &mut Vec<Control>) {
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
        let source = frame.map(|frame| {
            let end = frame.info.end.unwrap_or_else(|| self.timeline.newest(frame));
            (&*frame.info, end)
        });
        let sources = named_sources(frame, &self.current);
        match self.palette.ui(ui.ctx(), &self.keymap, &layouts, &sources, source, can) {
            Some(Choice::Command(command)) => self.run(command, frame, controls),
            Some(Choice::View(view_type)) => self.perform(TopBarAction::AddView(view_type), frame, controls),
            Some(Choice::Layout(name)) => self.perform(TopBarAction::Layout(name), frame, controls),
            Some(Choice::Open(request)) => self.open_asking(request, controls),
            Some(Choice::Time(at)) => controls.extend(Control::pause_at(at)),
            None => return,
        }
        self.record_layout();
    }
}
