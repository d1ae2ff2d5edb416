//! The dialogs that write to a file or read one: what views show, parameters, and learned models.

use super::dialog::{PathRow, Purpose, dialog};
use super::load_param::{LoadParam, Loaded};
use super::notices::{Matter, Notices};
use super::recording;
use super::save_file::SaveFile;
use super::save_params::{SaveParams, Saved, SavedStack};
use crate::assets::looks_like_path;
use crate::open::Request;
use crate::output::Files;
use crate::parts;
use ocu_views::TopicKey;
use rcs_msg::AnyMessage;
use rcs_runtime::source::{Control, Frame, SourceKind};
use std::path::{Path, PathBuf};

/// The dialogs, of which each may be open.
#[derive(Default)]
pub(super) struct FileDialogs {
    pub(super) save_params: Option<SaveParams>,
    pub(super) load_param: Option<LoadParam>,
    pub(super) save_file: SaveFile,
    choose_other: Option<PathRow>,
    /// The stack file to which parameters of the open source were saved last.
    pub(super) saved: SavedStack,
    /// The files of the recording with which the open source is compared; empty for none.
    pub(super) other: Vec<PathBuf>,
}

impl FileDialogs {
    /// Asks where to save parameters of a process.
    pub(super) fn save_params(
        &mut self,
        current: &Request,
        frame: &Frame,
        process: &str,
        params: &AnyMessage,
    ) {
        if self.saved.is_deleted() {
            self.saved = SavedStack::default();
        }
        self.save_params = Some(SaveParams::new(current, &self.saved, frame, process, params));
    }

    /// Asks where to save a message, as JSON.
    pub(super) fn save_message(&mut self, topic: &TopicKey, message: &AnyMessage) -> anyhow::Result<()> {
        let name = format!("{}.json", topic.name.trim_matches('/').replace('/', "_"));
        self.save_file.ask(&name, rcs_msg::to_json(message)?.into_bytes().into());
        Ok(())
    }

    /// Asks for a recording to compare with.
    pub(super) fn choose_other(&mut self) {
        let known = self.other.first().map(|path| path.display().to_string());
        self.choose_other = Some(PathRow::new(known.unwrap_or_default()));
    }

    /// Paints the dialog that asks for a recording to compare with.
    fn other_ui(&mut self, ctx: &egui::Context, controls: &mut Vec<Control>) {
        let Some(row) = &mut self.choose_other else { return };
        let mut chosen = None;
        let open = dialog(ctx, "Compare with a recording", |ui| {
            chosen = row.ui(ui, Purpose::Load, true, |path| {
                anyhow::ensure!(path.exists(), "there is no such file: {}", path.display());
                parts::of(path)
            });
        });
        if !open || chosen.is_some() {
            self.choose_other = None;
        }
        if let Some(files) = chosen {
            controls.push(Control::Against(files.clone()));
            self.other = files;
        }
    }

    /// Paints the open dialogs.
    pub(super) fn ui(
        &mut self,
        ctx: &egui::Context,
        current: &mut Request,
        frame: Option<&Frame>,
        controls: &mut Vec<Control>,
        notices: &mut Notices,
    ) {
        if let Some(path) = self.save_file.ui(ctx, || in_use(current, frame, true)) {
            notices.news(Matter::Run, format!("Saved: {}", path.display()));
        }
        self.other_ui(ctx, controls);
        // The stack that runs is the one file in use to which parameters may be saved.
        let saved = self.save_params.as_mut().map(|dialog| dialog.ui(ctx, || in_use(current, frame, false)));
        match saved {
            None | Some(Saved::Open) => {}
            Some(Saved::Cancelled) => self.save_params = None,
            Some(Saved::Written(path)) => {
                let running = frame.filter(|frame| frame.info.kind != SourceKind::Log);
                if let Some(dialog) = self.save_params.take() {
                    self.saved.add(&path, dialog);
                }
                let is_in_force = running.map(|frame| self.saved.is_in_force(frame));
                let whole = std::path::absolute(&path).unwrap_or_else(|_| path.clone());
                let mut text =
                    format!("Saved: {}. `ocu --stack {}` starts with it", whole.display(), path.display());
                text.push_str(match is_in_force {
                    Some(false) => "; what runs now changes only when you press Send.",
                    Some(true) | None => ".",
                });
                notices.news(Matter::Run, text);
                // From now on this is the stack that runs: it has the parameters in force.
                if is_in_force == Some(true) && current.stack.is_some() {
                    current.stack = Some(path.display().to_string());
                }
            }
        }
        match self.load_param.as_mut().and_then(|dialog| dialog.ui(ctx, frame)) {
            None => {}
            Some(Loaded::Cancelled) => self.load_param = None,
            Some(Loaded::Params { buffer, message }) => {
                self.load_param = None;
                controls.push(Control::Write { buffer, message });
            }
        }
    }
}

/// The files that the open source reads and writes.
fn in_use(current: &Request, frame: Option<&Frame>, with_stack: bool) -> Files {
    let mut files = Files::new(true);
    if let Some(log) = &current.log {
        files.reads_log("the log", log);
    }
    current.parts.iter().for_each(|part| files.reads("the log", part));
    if let Some(recording) = frame.and_then(recording::running) {
        files.reads("the recording that is being written", &recording.path);
    }
    let stack = current.stack.as_deref().filter(|_| with_stack);
    for (what, name) in [("the stack", stack), ("the course", current.course.as_deref())] {
        name.into_iter()
            .filter(|name| looks_like_path(name))
            .for_each(|name| files.reads(what, Path::new(name)));
    }
    files
}

#[cfg(test)]
mod tests {
    use super::*;
    use egui::Key;
    use egui_kittest::Harness;
    use egui_kittest::kittest::{NodeT as _, Queryable as _};
    use rcs_msg::params::with_params;
    use rcs_runtime::source::{Source, Task};

    type State = (FileDialogs, Request, Notices);

    /// A stack that runs since 0.1 s, and how it was asked for.
    fn running() -> (Request, Box<dyn Source>) {
        let (stack, course) = (Some("truth_driver".to_owned()), Some("meadow".to_owned()));
        let request = Request { stack, course, ..Request::default() };
        let mut source = crate::stacks::open(&request).unwrap();
        let begun = source.info().start.after_ns(100_000_000);
        source.seek(begun, &Task::default()).unwrap();
        (request, source)
    }

    /// The buffer of the parameters of a process, and those in force with another value of one of them.
    fn changed(frame: &Frame, process: &str, name: &str, value: &str) -> (String, AnyMessage) {
        let info = frame.processes.iter().find(|info| info.name == process).unwrap();
        let in_force = frame.topic(&info.params_buffer).unwrap().canonical().unwrap();
        (info.params_buffer.clone(), with_params(in_force, [(name, value)]).unwrap())
    }

    /// What the dialogs are after the parameters of a process were saved to a file.
    fn save(state: State, frame: &Frame, process: &str, params: &AnyMessage, file: &Path) -> State {
        let mut harness = Harness::new_ui_state(
            |ui, (dialogs, request, notices): &mut State| {
                dialogs.ui(ui.ctx(), request, Some(frame), &mut Vec::new(), notices);
            },
            state,
        );
        ocu_ui::install(&harness.ctx);
        let (dialogs, request, _) = harness.state_mut();
        dialogs.save_params(request, frame, process, params);
        dialogs.save_params.as_mut().unwrap().file = PathRow::new(file.display().to_string());
        harness.run();
        harness.get_by_label(if file.exists() { "Replace" } else { "Save" }).click();
        harness.run();
        assert!(file.exists() && harness.state().0.save_params.is_none());
        std::mem::take(harness.state_mut())
    }

    #[test]
    fn the_stack_that_runs_is_called_by_the_saved_file_only_where_it_has_what_was_saved() {
        let dir = tempfile::tempdir().unwrap();
        let (request, mut source) = running();
        let frame = source.frame();
        let (buffer, params) = changed(&frame, "truth_driver", "vehicle_width_m", "0.9");
        let stack_after = |frame: &Frame, file: &Path| {
            let state = (FileDialogs::default(), request.clone(), Notices::default());
            save(state, frame, "truth_driver", &params, file).1.stack
        };
        let [unsent, sent] = ["unsent.toml", "sent.toml"].map(|name| dir.path().join(name));
        assert_eq!(stack_after(&frame, &unsent).as_deref(), Some("truth_driver"));
        source.write(&buffer, params.clone()).unwrap();
        assert_eq!(stack_after(&source.frame(), &sent), Some(sent.display().to_string()));
    }

    #[test]
    fn a_file_keeps_what_was_saved_to_it_before_and_is_the_stack_that_runs_once_all_is_in_force() {
        let dir = tempfile::tempdir().unwrap();
        let (request, mut source) = running();
        let frame = source.frame();
        let (_, driver) = changed(&frame, "truth_driver", "vehicle_width_m", "0.9");
        let (buffer, localization) = changed(&frame, "localization", "rolling_slip", "0.03");
        let file = dir.path().join("mine.toml");
        let state = (FileDialogs::default(), request, Notices::default());
        let state = save(state, &frame, "truth_driver", &driver, &file);
        source.write(&buffer, localization.clone()).unwrap();
        let state = save(state, &source.frame(), "localization", &localization, &file);
        let text = std::fs::read_to_string(&file).unwrap();
        for line in ["vehicle_width_m = 0.9", "rolling_slip = 0.03"] {
            assert!(text.lines().any(|known| known == line), "{line}: {text}");
        }
        assert_eq!(state.1.stack.as_deref(), Some("truth_driver"), "what was saved first was not sent");
    }

    #[test]
    fn enter_replaces_no_file_and_the_open_log_and_stack_are_never_written() {
        let dir = tempfile::tempdir().unwrap();
        let [log, stack, other, part] =
            ["a.mcap", "b.toml", "c.json", "e.mcap"].map(|name| dir.path().join(name));
        for path in [&log, &stack, &other, &part] {
            std::fs::write(path, "old").unwrap();
        }
        let path_of = |path: &Path| path.display().to_string();
        let request = Request {
            log: Some(log.clone()),
            parts: vec![part],
            stack: Some(path_of(&stack)),
            ..Request::default()
        };
        let written = |name: &str, by_button: bool| {
            let state = (FileDialogs::default(), request.clone(), Notices::default());
            let mut harness = Harness::new_ui_state(
                |ui, (dialogs, request, notices): &mut (FileDialogs, Request, Notices)| {
                    dialogs.ui(ui.ctx(), request, None, &mut Vec::new(), notices);
                },
                state,
            );
            ocu_ui::install(&harness.ctx);
            let name = path_of(&dir.path().join(name));
            harness.state_mut().0.save_file.ask(&name, b"new".as_slice().into());
            harness.run();
            if by_button {
                harness.get_by_label("Replace").click();
            } else {
                harness.key_press(Key::Enter);
            }
            harness.run();
            harness.query_by_label_contains("the file is").and_then(|label| label.accesskit_node().value())
        };
        let text = |path: &Path| std::fs::read_to_string(path).unwrap();

        assert_eq!(written("c.json", false), None);
        assert_eq!(text(&other), "old", "Enter replaces no file");
        assert_eq!(written("c.json", true), None);
        assert_eq!(text(&other), "new");
        assert_eq!(written("d.json", false), None);
        assert_eq!(text(&dir.path().join("d.json")), "new", "Enter writes a new file");
        let in_use =
            [("a.mcap", "the log"), ("e.mcap", "the log"), ("b.toml", "the stack"), ("./a.mcap", "the log")];
        for (path, what) in in_use {
            let error = written(path, true).expect("it is refused");
            assert!(error.contains(what), "{error}");
        }
        assert_eq!((text(&log), text(&stack)), ("old".to_owned(), "old".to_owned()));
    }
}
