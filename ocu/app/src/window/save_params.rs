//! Saving parameters to the stack file: the difference is shown first, and written when the user says so.

use super::dialog::{PathRow, Purpose, dialog, save};
use super::top_menus::course_of;
use crate::open::Request;
use crate::output::Files;
use crate::{bundled, say, stack_edit, stacks};
use anyhow::Context as _;
use egui::{RichText, ScrollArea};
use ocu_ui::{tokens, widgets};
use rcs_msg::AnyMessage;
use rcs_runtime::source::Frame;
use similar::{ChangeTag, TextDiff};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The dialog, while it is open.
pub(super) struct SaveParams {
    process: String,
    params: AnyMessage,
    /// The file, which the user may change.
    pub(super) file: PathRow,
    /// What would change, or why it cannot be written.
    edit: Result<Edit, String>,
}

/// A change of a stack file.
struct Edit {
    /// The file.
    file: String,
    /// The course on which the stack runs; `None` for its own.
    course: Option<String>,
    /// Its text before.
    old: String,
    /// Its text after.
    new: String,
    /// Names of the parameters in force that hold a file, which is no part of the stack file.
    unwritten: Vec<String>,
}

/// The stack file to which parameters of the open source were saved last.
#[derive(Default)]
pub(super) struct SavedStack {
    /// The file; `None` before anything is saved.
    file: Option<String>,
    /// The parameters that were saved, by process.
    params: BTreeMap<String, AnyMessage>,
}

/// What became of the dialog.
pub(super) enum Saved {
    Open,
    Cancelled,
    Written(PathBuf),
}

impl SaveParams {
    /// Prepares to write parameters into the file that was saved last, else into the stack that runs, or ran in the
    /// recording.
    pub(super) fn new(
        current: &Request,
        saved: &SavedStack,
        frame: &Frame,
        process: &str,
        params: &AnyMessage,
    ) -> Self {
        let edit = prepare(current, saved, frame, process, params).map_err(|error| say(&error));
        let file = edit.as_ref().map(|edit| edit.file.clone()).unwrap_or_default();
        Self { process: process.to_owned(), params: params.clone(), file: PathRow::new(file), edit }
    }

    /// Paints the dialog; no file of `in_use` is written, and none from which the stack would not start.
    pub(super) fn ui(&mut self, ctx: &egui::Context, in_use: impl FnOnce() -> Files) -> Saved {
        let mut written = None;
        let open = dialog(ctx, &format!("Save the parameters of {}", self.process), |ui| {
            let edit = match &self.edit {
                Ok(edit) => edit,
                Err(error) => {
                    ui.add(egui::Label::new(RichText::new(error).color(tokens(ui).error)).wrap());
                    return;
                }
            };
            difference(ui, edit);
            ui.add_space(4.0);
            written = self.file.ui(ui, Purpose::Save, edit.old != edit.new, |path| {
                stack_edit::check_path(path, &edit.file, &edit.new, edit.course.as_deref())?;
                save(path, edit.new.as_bytes(), in_use())?;
                Ok(path.to_owned())
            });
        });
        match written {
            Some(path) => Saved::Written(path),
            None if open => Saved::Open,
            None => Saved::Cancelled,
        }
    }
}

impl SavedStack {
    /// What the dialog has written to a file.
    pub(super) fn add(&mut self, file: &Path, dialog: SaveParams) {
        self.file = Some(file.display().to_string());
        self.params.insert(dialog.process, dialog.params);
    }

    /// Whether the file was deleted since.
    pub(super) fn is_deleted(&self) -> bool {
        self.file.as_ref().is_some_and(|file| !Path::new(file).exists())
    }

    /// Whether all processes have the parameters that were saved.
    pub(super) fn is_in_force(&self, frame: &Frame) -> bool {
        self.params.iter().all(|(process, params)| {
            let info = frame.processes.iter().find(|info| info.name == *process);
            let now = info.and_then(|info| frame.topic(&info.params_buffer)?.canonical()?.value().ok());
            now.is_some() && now == params.value().ok()
        })
    }
}

/// What would change in the file that was saved last, else in that of the stack that runs, or ran in the recording.
fn prepare(
    current: &Request,
    saved: &SavedStack,
    frame: &Frame,
    process: &str,
    params: &AnyMessage,
) -> anyhow::Result<Edit> {
    let (mut file, mut old, course) = match &current.stack {
        Some(spec) => {
            let (file, old) = stacks::text_of(spec)?;
            (file, old, current.course.as_deref())
        }
        None => recorded_stack(current, frame, process)?,
    };
    // What was saved before stays in the file, also where it is not in force.
    if let Some(saved) = &saved.file {
        (file, old) = stacks::text_of(saved)?;
    }
    let new = stack_edit::with_params(&file, &old, course, process, params)?;
    let unwritten = stack_edit::unwritten(&file, &old, course, process, params)?;
    Ok(Edit { file, course: course.map(str::to_owned), old, new, unwritten })
}

/// The stack of a recorded run: a file of its name, its text with all of its parts, and the course if that is a bundled
/// one, else `None` for the stack's own.
fn recorded_stack<'a>(
    current: &'a Request,
    frame: &'a Frame,
    process: &str,
) -> anyhow::Result<(String, String, Option<&'a str>)> {
    let info = frame.processes.iter().find(|info| info.name == process);
    let run = info.and_then(|info| frame.run_info(frame.topic(&info.params_buffer)?.run));
    let run = run.context("the recording does not say which stack ran, so there is no file to write to")?;
    let course = course_of(current, frame).filter(|course| bundled::file("course", course).is_some());
    Ok((format!("{}.toml", run.stack), run.stack_text.clone(), course))
}

/// The changed lines with three lines around them, marked by sign and colour; and what is not written.
fn difference(ui: &mut egui::Ui, edit: &Edit) {
    let Edit { old, new, unwritten, .. } = edit;
    let tokens = tokens(ui);
    if !unwritten.is_empty() {
        let text = format!("Not written, because it is a file: {}", unwritten.join(", "));
        ui.add(egui::Label::new(text).wrap());
    }
    if old == new {
        if unwritten.is_empty() {
            ui.label("The stack file says the same already.");
        }
        return;
    }
    let diff = TextDiff::from_lines(old, new);
    ScrollArea::vertical().max_height(320.0).show(ui, |ui| {
        ui.spacing_mut().item_spacing.y = 0.0;
        for group in diff.grouped_ops(3) {
            for change in group.iter().flat_map(|op| diff.iter_changes(op)) {
                let (sign, color) = match change.tag() {
                    ChangeTag::Delete => ('−', tokens.error),
                    ChangeTag::Insert => ('+', tokens.ok),
                    ChangeTag::Equal => (' ', tokens.weak),
                };
                let text = format!("{sign} {}", change.value().trim_end());
                ui.add(egui::Label::new(widgets::mono(text).color(color)).extend());
            }
            ui.add_space(6.0);
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;
    use rcs_msg::Stamp;
    use rcs_msg::params::with_params;
    use rcs_runtime::source::Task;
    use rcs_runtime::{RecordOptions, RecordWhat};
    use std::sync::Arc;

    fn no_frame() -> Frame {
        Frame::empty(Arc::default(), Stamp(0))
    }

    /// A dialog in a window of its own.
    fn shown(dialog: SaveParams) -> Harness<'static, Option<SaveParams>> {
        let mut harness = Harness::new_ui_state(
            |ui, dialog: &mut Option<SaveParams>| {
                if let Some(dialog) = dialog {
                    dialog.ui(ui.ctx(), || Files::new(true));
                }
            },
            None,
        );
        ocu_ui::install(&harness.ctx);
        *harness.state_mut() = Some(dialog);
        harness.run();
        harness
    }

    #[test]
    fn a_file_in_force_is_said_not_to_be_written() {
        let plan = stacks::plan("lagr", None, &[]).unwrap();
        let process = plan.processes.iter().find(|process| &*process.name == "waypoint_generator").unwrap();
        let request = Request { stack: Some("lagr".to_owned()), ..Request::default() };
        let says = |params: &AnyMessage, text: &str| {
            let (none, frame) = (SavedStack::default(), no_frame());
            let harness = shown(SaveParams::new(&request, &none, &frame, "waypoint_generator", params));
            harness.query_by_label(text).is_some()
        };
        let loaded = with_params(&process.params, [("route", "blake3:0123")]).unwrap();
        let (unwritten, same) =
            ("Not written, because it is a file: route", "The stack file says the same already.");
        assert!(says(&loaded, unwritten) && !says(&loaded, same));
        assert!(says(&process.params, same) && !says(&process.params, unwritten));
    }

    #[test]
    fn parameters_of_a_recorded_run_are_saved_to_a_file_of_its_stack() {
        let dir = tempfile::tempdir().unwrap();
        let log = dir.path().join("run.mcap");
        let (stack, course) = (Some("truth_driver".to_owned()), Some("meadow".to_owned()));
        let mut source = stacks::open(&Request { stack, course, ..Request::default() }).unwrap();
        let what = RecordWhat::Journal;
        source.record(&log, &RecordOptions { lossless: true, what, ..RecordOptions::default() }).unwrap();
        let end = source.info().start.after_ns(300_000_000);
        source.seek(end, &Task::default()).unwrap();
        drop(source);

        let request = Request { log: Some(log), ..Request::default() };
        let frame = stacks::open(&request).unwrap().frame();
        let info = frame.processes.iter().find(|info| info.name == "truth_driver").unwrap();
        let in_force = frame.topic(&info.params_buffer).unwrap().canonical().unwrap();
        let params = with_params(in_force, [("vehicle_width_m", "0.9")]).unwrap();
        let dialog = SaveParams::new(&request, &SavedStack::default(), &frame, "truth_driver", &params);
        assert_eq!(dialog.edit.as_ref().map(|edit| edit.file.as_str()), Ok("truth_driver.toml"));
        assert!(shown(dialog).query_by_label("+ vehicle_width_m = 0.9").is_some());
    }

    #[test]
    fn a_stack_is_not_written_to_where_it_would_not_start() {
        let dir = tempfile::tempdir().unwrap();
        let path = |name: &str| dir.path().join(name).display().to_string();
        let [mine, part, elsewhere, beside] =
            ["mine.toml", "base.toml", "other/mine.toml", "again.toml"].map(path);
        std::fs::create_dir(path("other")).unwrap();
        let base = "format = 1\nname = \"base\"\n\n[[process]]\nname = \"vehicle_interface\"\n\
                    plugin = \"vehicle_interface\"\nsupervisor = \"viewer\"\n\
                    inputs = { teleop = \"/operator/teleop\" }\n";
        std::fs::write(&part, base).unwrap();
        let text = "format = 1\nname = \"mine\"\n\n[[include]]\npart = \"./base.toml\"\n";
        std::fs::write(&mine, text).unwrap();
        let plan = stacks::plan(&mine, None, &[]).unwrap();
        let params = with_params(&plan.processes[0].params, [("max_speed_mps", "0.9")]).unwrap();
        let request = Request { stack: Some(mine), ..Request::default() };
        let pressed = |path: &str| {
            let (none, frame) = (SavedStack::default(), no_frame());
            let mut dialog = SaveParams::new(&request, &none, &frame, "vehicle_interface", &params);
            dialog.file = PathRow::new(path);
            let mut harness = shown(dialog);
            harness.get_by_label(if Path::new(path).exists() { "Replace" } else { "Save" }).click();
            harness.run();
            harness
        };
        let says = |path: &str, text: &str| pressed(path).query_by_label_contains(text).is_some();

        assert!(says(&elsewhere, "the stack would not start from there"));
        let other = base.replace("supervisor", "class = \"realtime\"\nsupervisor");
        std::fs::write(path("other/base.toml"), other).unwrap();
        assert!(says(&elsewhere, "by relative paths differ there"));
        assert!(says(&part, "the file is a part of the stack"));
        assert!(says("lagr", "a bundled stack has this name"));
        assert!(!Path::new(&elsewhere).exists() && !Path::new("lagr").exists());
        assert_eq!(std::fs::read_to_string(&part).unwrap(), base);

        pressed(&beside);
        let written = stacks::plan(&beside, None, &[]).unwrap();
        assert_eq!(written.processes[0].params.value().unwrap(), params.value().unwrap());
    }
}
