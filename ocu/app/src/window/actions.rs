//! What the window does on request: commands, actions of the bar at the top, files that are opened or dropped.

use super::body::{Chosen, Shown, Window};
use super::commands::Command;
use super::dialog::note_closing_key;
use super::focus::cancel;
use super::leaving::{Lost, Next};
use super::notices::Matter;
use super::open::{Outcome, Picked};
use super::operate::StopState;
use super::recording;
use super::top_menus::seed_of;
use super::top_state::TopBarAction;
use super::tree::Workspace;
use crate::layout::Layout;
use crate::layout_fit::{fitting, with_images_of};
use crate::open::{FileKind, Request};
use crate::remembered::Remembered;
use crate::say;
use anyhow::Context as _;
use egui::{ViewportCommand, gui_zoom};
use ocu_views::edit::{self, Held};
use rcs_runtime::source::{Control, Frame, SourceKind};
use std::path::Path;

impl Window {
    /// Shows a source that has been opened since the last pass.
    pub(super) fn take_opened(&mut self) {
        match self.opener.poll() {
            Some(Outcome::Opened(request, source)) => {
                self.notices.mended(Matter::Open);
                self.notices.mended(Matter::Run);
                self.show_source(request, source);
            }
            Some(Outcome::Failed(text)) => self.notices.error(Matter::Open, text),
            None => {}
        }
    }

    /// Opens a file that was dropped on the window.
    pub(super) fn take_dropped(&mut self, ui: &egui::Ui, controls: &mut Vec<Control>) {
        let files = ui.input_mut(|input| std::mem::take(&mut input.raw.dropped_files));
        if let [first, rest @ ..] = files.as_slice() {
            if !rest.is_empty() {
                let text = format!("{} files were dropped; one can be opened at a time", files.len());
                self.notices.error(Matter::Open, text);
            }
            self.open_path(first.path(), controls);
        }
    }

    /// Paints the dialog that asks what to open, and opens what was chosen in it.
    pub(super) fn open_dialog_ui(&mut self, ui: &egui::Ui, controls: &mut Vec<Control>) {
        match self.opener.ui(ui) {
            Some(Picked::Path(path)) => self.open_path(&path, controls),
            Some(Picked::Recent(recent)) => {
                let past = self.current.past.clone();
                self.open_asking(Request { past, ..recent }, controls);
            }
            None => {}
        }
    }

    /// Opens a recording, a stack, a layout, or what a run remembers.
    pub(super) fn open_path(&mut self, path: &Path, controls: &mut Vec<Control>) {
        match FileKind::of(path) {
            FileKind::Remembered => self.open_remembered(path, controls),
            FileKind::Layout => match Layout::load(path) {
                Ok(layout) => self.choose(&layout),
                Err(error) => self.not_opened(Matter::Layout, path, say(&error)),
            },
            FileKind::Stack | FileKind::Recording => {
                self.open_asking(Request::dropped(path, &self.current), controls);
            }
        }
    }

    /// Says why a file cannot be opened: in the dialog, if its path was chosen there.
    fn not_opened(&mut self, matter: Matter, path: &Path, reason: String) {
        if let Some(reason) = self.opener.ask_again(path, reason) {
            self.notices.error(matter, reason);
        }
    }

    /// Starts the stack again with what an earlier run remembers, a file.
    fn open_remembered(&mut self, path: &Path, controls: &mut Vec<Control>) {
        match self.takes_remembered().and_then(|()| Remembered::load(path)) {
            Ok(remembered) => {
                let request = self.current.remembering(remembered, self.current.seed);
                self.open_asking(request, controls);
            }
            Err(error) => self.not_opened(Matter::Open, path, say(&error)),
        }
    }

    /// Starts the open stack again, with another seed and with what this run remembers.
    fn begin_next_run(&mut self, frame: Option<&Frame>, controls: &mut Vec<Control>) {
        if let Err(error) = self.takes_remembered() {
            return self.notices.error(Matter::Open, say(&error));
        }
        if let Some(remembered) = self.remembered(frame) {
            let seed = frame.map(|frame| seed_of(&self.current, frame).wrapping_add(1));
            self.open_asking(self.current.remembering(remembered, seed), controls);
        }
    }

    /// Refuses where no stack is open.
    fn takes_remembered(&self) -> anyhow::Result<()> {
        let text = "no stack is open that could begin with what a run remembers; expected one";
        self.current.stack.as_ref().map(|_| ()).context(text)
    }

    /// What this run and those before it remember; says so if that is nothing, or not known yet.
    fn remembered(&mut self, frame: Option<&Frame>) -> Option<Remembered> {
        let mut remembered = self.current.remembered.as_deref().cloned().unwrap_or_default();
        match frame.map(Remembered::of_frame)? {
            Ok(later) => remembered.add(later),
            Err(error) => {
                self.notices.error(Matter::Run, say(&error));
                return None;
            }
        }
        if remembered.is_empty() {
            let text = "this run remembers nothing yet; expected a map, a route, slippery places or models";
            self.notices.error(Matter::Run, text);
        }
        Some(remembered).filter(|remembered| !remembered.is_empty())
    }

    /// Carries out the commands of the keys that were pressed; returns whether there was any.
    pub(super) fn take_keys(
        &mut self,
        ctx: &egui::Context,
        stops: bool,
        frame: Option<&Frame>,
        controls: &mut Vec<Control>,
    ) -> bool {
        self.keymap.mark_repeats(ctx);
        self.key_list.take_key(ctx, &mut self.keymap);
        note_closing_key(ctx, self.keymap.text(Command::Cancel));
        let commands = self.keymap.pressed(ctx, stops);
        for &command in &commands {
            // What is drawn under the pointer goes before the layout.
            let is_done = match command {
                Command::UndoLayout => self.selection.undo_under_pointer(),
                Command::RedoLayout => self.selection.redo_under_pointer(),
                _ => false,
            };
            if !is_done {
                self.run(command, frame, controls);
            }
        }
        !commands.is_empty()
    }

    /// Carries out a command.
    pub(super) fn run(&mut self, command: Command, frame: Option<&Frame>, controls: &mut Vec<Control>) {
        match command {
            Command::EmergencyStop => {
                if let Some(frame) = frame {
                    self.emergency_stop(frame, true, controls);
                }
            }
            Command::Bookmark => {
                if let Some(frame) = frame {
                    self.marks.toggle(frame.now);
                }
            }
            Command::Cancel => cancel(&self.ctx),
            Command::Open => self.opener.ask(),
            Command::Simulation => {
                let past = self.current.past.clone();
                self.open_asking(Request { past, ..Request::simulation() }, controls);
            }
            Command::Keys => self.key_list.toggle(),
            Command::Palette => self.palette.toggle(),
            Command::Restart => self.perform(TopBarAction::Restart, frame, controls),
            Command::NextRun => self.begin_next_run(frame, controls),
            Command::SaveRemembered => {
                let saved = self.remembered(frame).map(|remembered| remembered.to_text());
                match saved {
                    None => {}
                    Some(Ok(text)) => self.dialogs.save_file.ask("remembered.json", text.into_bytes().into()),
                    Some(Err(error)) => self.notices.error(Matter::Run, say(&error)),
                }
            }
            Command::TakeBack => controls.push(Control::Undo),
            Command::Silence => {
                if let Some(frame) = frame {
                    self.alarm_sound.silence(frame);
                }
            }
            Command::AlarmSound => self.alarm_sound.switch(),
            Command::Record => {
                if let Some(frame) = frame.filter(|frame| frame.info.kind != SourceKind::Log) {
                    controls.push(match recording::running(frame) {
                        Some(_) => Control::StopRecording,
                        None => recording::start(recording::default_path(frame)),
                    });
                }
            }
            Command::Buffers => self.buffers_open = !self.buffers_open,
            Command::Theme => self.perform(TopBarAction::ToggleTheme, frame, controls),
            Command::Larger => gui_zoom::zoom_in(&self.ctx),
            Command::Smaller => gui_zoom::zoom_out(&self.ctx),
            Command::UsualSize => self.ctx.set_zoom_factor(1.0),
            Command::FittingLayout => self.perform(TopBarAction::FittingLayout, frame, controls),
            Command::ResetLayout => {
                let name = self.workspace.as_ref().map(|workspace| workspace.name().to_owned());
                let made = frame.map(fitting).filter(|layout| Some(&layout.name) == name.as_ref());
                match name.as_deref().and_then(Layout::bundled).or(made.map(Ok)) {
                    Some(Ok(layout)) => self.arrange(&layout),
                    Some(Err(error)) => self.notices.error(Matter::Layout, error.to_string()),
                    None => {
                        let text = "this layout is your own; expected one that comes with OCU";
                        self.notices.error(Matter::Layout, text);
                    }
                }
            }
            Command::UndoLayout => {
                let step = self.document.undo();
                self.go_to_step(step);
            }
            Command::RedoLayout => {
                let step = self.document.redo();
                self.go_to_step(step);
            }
            Command::PlayPause
            | Command::Step { .. }
            | Command::StepCycle { .. }
            | Command::StepSecond { .. }
            | Command::NextEvent { .. }
            | Command::ToStart
            | Command::ToEnd
            | Command::Loop => {
                let control = frame.and_then(|frame| self.timeline.command(command, frame, &self.selection));
                if control.is_some() && matches!(command, Command::NextEvent { .. }) {
                    controls.push(Control::Pause);
                }
                controls.extend(control);
            }
        }
    }

    /// Requests an emergency stop, or its release. A stop also releases what the operator holds and the faults on
    /// demand, which could replace or delay what the vehicle is commanded.
    fn emergency_stop(&mut self, frame: &Frame, active: bool, controls: &mut Vec<Control>) {
        self.operating.emergency_stop(frame, active, controls);
        let can_stop = self.operating.stop_state(frame) != StopState::None;
        let held = edit::held(frame);
        if !active || !can_stop || held.is_empty() {
            return;
        }
        let text_of = |held: &Held| {
            let is = if held.is_fault { ":" } else { " =" };
            format!("{}{is} {}", held.target, held.what)
        };
        let listed = held.iter().map(text_of).collect::<Vec<_>>().join(", ");
        if let Some(release) = edit::release(frame, None) {
            controls.push(release);
            self.notices.news(Matter::Held, format!("the emergency stop releases what is held: {listed}"));
        } else {
            let text = "the emergency stop cannot release what is held, which may keep the vehicle moving";
            self.notices.error(Matter::Held, format!("{text}: {listed}"));
        }
    }

    pub(super) fn perform(
        &mut self,
        action: TopBarAction,
        frame: Option<&Frame>,
        controls: &mut Vec<Control>,
    ) {
        match action {
            TopBarAction::Ask => self.opener.ask(),
            TopBarAction::Open(request) => self.open_asking(request, controls),
            TopBarAction::Restart => self.open_asking(self.current.clone(), controls),
            TopBarAction::EmergencyStop(active) => {
                if let Some(frame) = frame {
                    self.emergency_stop(frame, active, controls);
                }
            }
            TopBarAction::Record(path) => controls.push(recording::start(path)),
            TopBarAction::StopRecording => controls.push(Control::StopRecording),
            TopBarAction::PauseAt(time) => controls.extend(Control::pause_at(time)),
            TopBarAction::ToNewest => {
                controls.extend(frame.map(|frame| Control::Seek(self.timeline.newest(frame))));
            }
            TopBarAction::Acknowledge(until) => {
                if let Some(frame) = frame {
                    self.known_alarms.know(&frame.runs, until);
                }
            }
            TopBarAction::SwitchRun(run) => controls.push(Control::SwitchRun(run)),
            TopBarAction::Undo => controls.push(Control::Undo),
            TopBarAction::Release(id) => {
                controls.extend(frame.and_then(|frame| edit::release(frame, id)));
            }
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
                let kept = self.layout_store.load(&name);
                let damage = kept.as_ref().err().map(say);
                match kept.ok().flatten().map(Ok).or_else(|| Layout::bundled(&name)) {
                    Some(Ok(layout)) => self.choose(&layout),
                    Some(Err(error)) => self.notices.error(Matter::Layout, error.to_string()),
                    None if damage.is_none() => {
                        self.notices
                            .error(Matter::Layout, format!("the layout {name:?} is not there any more"));
                    }
                    None => {}
                }
                // Choosing a layout removes what was said before.
                if let Some(damage) = damage {
                    self.notices.error(Matter::Layout, damage);
                }
            }
            TopBarAction::DeleteLayout(name) => match self.layout_store.delete(&name) {
                Ok(file) => {
                    let text = format!("the layout {name} is deleted; its file is kept: {}", file.display());
                    self.notices.news(Matter::Layout, text);
                }
                Err(error) => self.notices.error(Matter::Layout, say(&error)),
            },
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

    /// Opens a source in place of this one; asks before where something would be lost, unless a file of it is not there.
    pub(super) fn open_asking(&mut self, request: Request, controls: &mut Vec<Control>) {
        let lost = self.lost();
        if lost.is_some()
            && let Some(missing) = request.missing()
        {
            let text = format!("there is no such file: {}", missing.display());
            return self.not_opened(Matter::Open, missing, text);
        }
        match lost {
            Some(lost) => self.leaving.ask(Next::open(request, &self.current), lost),
            None => self.leave_for(request, controls),
        }
    }

    /// Called before each pass, and also while the window is hidden: sounds alarms, and where something would be lost,
    /// asks before the window closes.
    pub fn logic(&mut self, ctx: &egui::Context) {
        if let Shown::Live(driver) = &self.shown {
            let frame = driver.frame();
            self.alarm_sound.sound(ctx, &frame, self.known_alarms.until(&frame.runs));
        }
        if !ctx.input(|input| input.viewport().close_requested()) {
            return;
        }
        let lost = self.lost();
        if self.leaving.keeps_open(lost) {
            ctx.send_viewport_cmd(ViewportCommand::CancelClose);
            // In a hidden window nobody would see the question.
            if ctx.input(|input| input.viewport().minimized) == Some(true) {
                ctx.send_viewport_cmd(ViewportCommand::Minimized(false));
            }
            ctx.send_viewport_cmd(ViewportCommand::Focus);
        }
    }

    pub(super) fn leaving_ui(&mut self, ui: &egui::Ui, controls: &mut Vec<Control>) {
        match self.leaving.ui(ui.ctx()) {
            Some(Next::Open(request, _)) => self.leave_for(request, controls),
            Some(Next::Close) => ui.ctx().send_viewport_cmd(ViewportCommand::Close),
            None => {}
        }
    }

    /// What would be lost if the open source were left.
    fn lost(&self) -> Option<Lost> {
        self.frame().and_then(|frame| Lost::with(&frame))
    }

    /// Opens a source in place of this one.
    fn leave_for(&mut self, request: Request, controls: &mut Vec<Control>) {
        controls.extend(self.make_room());
        self.opener.open(request);
    }

    /// Pauses a running stack, which would slow down opening the next source.
    pub(super) fn make_room(&self) -> Option<Control> {
        let is_stack = self.frame().is_some_and(|frame| frame.info.kind == SourceKind::Stack);
        is_stack.then_some(Control::Pause)
    }

    /// Applies a layout chosen by the user.
    pub(super) fn choose(&mut self, layout: &Layout) {
        self.notices.mended(Matter::Layout);
        self.record_layout();
        self.chosen = match self.frame() {
            Some(frame) => Chosen::For(fitting(&frame).name),
            None => Chosen::BeforeOpening,
        };
        self.arrange(layout);
    }

    /// Applies the layout that suits the source, as the user last arranged it, with the images of this source. One that
    /// the user chose stays as it is for sources of the same kind.
    pub(super) fn arrange_for(&mut self, frame: &Frame) {
        let fitting = fitting(frame);
        if self.chosen == Chosen::BeforeOpening {
            self.chosen = Chosen::For(fitting.name.clone());
        }
        let is_chosen = matches!(&self.chosen, Chosen::For(suited) if *suited == fitting.name);
        let open = self.workspace.as_ref().map(|now| now.layout(self.buffers_open));
        match open {
            Some(_) if is_chosen => {}
            Some(open) if open.name == fitting.name => {
                let left = self.document.left_as(open.clone());
                let adapted = with_images_of(left.clone(), frame);
                if adapted != open {
                    self.record_layout();
                    self.adapt(left, &adapted);
                }
            }
            _ => {
                self.chosen = Chosen::Nothing;
                self.record_layout();
                let kept = self.layout_store.load(&fitting.name).unwrap_or_else(|error| {
                    self.notices.error(Matter::Layout, say(&error));
                    None
                });
                let kept = kept.unwrap_or(fitting);
                let adapted = with_images_of(kept.clone(), frame);
                if adapted == kept {
                    self.arrange(&kept);
                } else {
                    self.adapt(kept, &adapted);
                }
            }
        }
    }

    /// Goes to an arrangement that was adapted to the source from how the user left it, which stays kept as it is.
    fn adapt(&mut self, left: Layout, adapted: &Layout) {
        self.show_arrangement(adapted);
        if let Some(workspace) = &self.workspace {
            self.document.adapt(left, workspace.layout(self.buffers_open));
        }
    }

    /// Goes to a step of the history, if there is one, and keeps it for the next start: it is no new step.
    fn go_to_step(&mut self, step: Option<Layout>) {
        let Some(layout) = step else { return };
        self.show_arrangement(&layout);
        if let Some(workspace) = &self.workspace {
            self.document.arrive(workspace.layout(self.buffers_open));
        }
        self.layout_store.keep(&layout);
    }

    /// Goes to an arrangement; views that are in both stay.
    pub(super) fn arrange(&mut self, layout: &Layout) {
        self.show_arrangement(layout);
        self.record_layout();
    }

    fn show_arrangement(&mut self, layout: &Layout) {
        self.buffers_open = layout.buffers;
        match &mut self.workspace {
            Some(workspace) => workspace.apply(layout),
            None => self.workspace = Some(Workspace::new(layout)),
        }
    }
}
