//! The menus of the bar at the top: sources, courses, stacks, runs and layouts.

use super::commands::{Command, entry_of};
use super::open::recent_button;
use super::top_state::{Actions, State, TopBarAction};
use crate::assets::looks_like_path;
use crate::bundled;
use crate::kept_layouts::is_bundled;
use crate::layout::Layout;
use crate::open::Request;
use crate::stacks;
use egui::{Role, WidgetInfo};
use ocu_ui::bar::{self, Form};
use ocu_ui::{icons, typing, widgets};
use rcs_msg::rcs::{CourseRun, RunInfo};
use rcs_runtime::StackFile;
use rcs_runtime::source::{Frame, SourceKind};
use std::borrow::Cow;

/// Menu of what can be opened.
pub(super) fn open_menu(ui: &mut egui::Ui, form: Form, state: &State<'_>, actions: &mut Actions) {
    bar::menu(ui, form, icons::ICON_FOLDER_OPEN, "Open", |ui| {
        ui.set_min_width(280.0);
        if ui.button("Recording or stack…").clicked() {
            actions.push(TopBarAction::Ask);
            ui.close();
        }
        let help = "A simulated robot before its course; Play sends it to the goal";
        if ui.button("Simulation").on_hover_text(help).clicked() {
            actions.push(TopBarAction::Run(Command::Simulation));
            ui.close();
        }
        for recent in state.recent {
            if recent_button(ui, recent).clicked() {
                let past = state.current.past.clone();
                actions.push(TopBarAction::Open(Request { past, ..recent.clone() }));
                ui.close();
            }
        }
    });
}

/// Menu of the runs, if there are several, and undo of the last write.
pub(super) fn runs_menu(ui: &mut egui::Ui, form: Form, frame: &Frame, actions: &mut Actions) {
    let (runs, current) = (&frame.runs.all, frame.runs.current());
    let button = bar::menu(ui, form, icons::ICON_CALL_SPLIT, &current.to_string(), |ui| {
        ui.set_min_width(220.0);
        for run in runs.iter() {
            let seconds = |at: rcs_msg::Stamp| ocu_ui::format::elapsed(at.seconds_since(frame.info.start));
            let text = match run.branched_from {
                Some((from, at)) => format!("{}: left {} at {}", run.id, from.run, seconds(at)),
                None => format!("{}, up to {}", run.id, seconds(run.end)),
            };
            if ui.selectable_label(run.id == current, text).clicked() {
                actions.push(TopBarAction::SwitchRun(run.id));
                ui.close();
            }
        }
        ui.separator();
        if ui.button("Take the last write back").clicked() {
            actions.push(TopBarAction::Undo);
            ui.close();
        }
    });
    button.on_hover_text(
        "The runs: a command after going back begins another one, and the one that it leaves is kept",
    );
}

/// Menu of the stacks that can run on the recording, or, without one, of those that need none.
pub(super) fn stack_menu(ui: &mut egui::Ui, form: Form, state: &State<'_>, actions: &mut Actions) {
    let (frame, current) = (state.frame, state.current);
    let running = stack_of(current, frame);
    let name = running.unwrap_or("no stack");
    let name = std::path::Path::new(name).file_name().map_or(name.into(), |name| name.to_string_lossy());
    let button = bar::menu(ui, form, icons::ICON_ACCOUNT_TREE, &name, |ui| {
        ui.set_min_width(200.0);
        let mut choice =
            |ui: &mut egui::Ui, stack: Option<&str>, text: &str, unfit: Option<String>, help: &str| {
                let label = egui::Button::selectable(running == stack, text);
                let response = ui.add_enabled(unfit.is_none(), label).on_hover_text(help);
                let response = match unfit {
                    Some(reason) => response.on_disabled_hover_text(format!("{help}\n{reason}")),
                    None => response,
                };
                if response.clicked() {
                    actions.push(TopBarAction::Open(with_stack(current, stack)));
                    ui.close();
                }
            };
        if current.log.is_some() {
            choice(ui, None, "no stack", None, "Show the recording as it is");
            ui.separator();
        }
        for (name, stack, unfit) in stacks_for(frame, current) {
            choice(ui, Some(name), name, unfit, stack.description());
        }
    });
    let seed = frame.and_then(identity).map_or(String::new(), |run| format!(", with seed {}", run.seed));
    button.on_hover_text(format!("The stack that runs: {name}{seed}"));
}

/// The bundled stacks that can run on the recording, or, without one, those that need none, each with why it cannot be
/// chosen.
fn stacks_for(
    frame: Option<&Frame>,
    current: &Request,
) -> impl Iterator<Item = (&'static str, &'static StackFile, Option<String>)> {
    let alone = current.log.is_none();
    let stacks = stacks::bundled().iter();
    stacks.filter(move |(_, stack)| !alone || stack.topics().next().is_none()).map(move |(name, stack)| {
        (*name, stack, frame.filter(|_| !alone).and_then(|frame| unfit(stack, frame)))
    })
}

/// The request for what is open with another stack; without one, for the recording as it is.
fn with_stack(current: &Request, stack: Option<&str>) -> Request {
    Request { stack: stack.map(str::to_owned), remembered: None, ..current.clone() }
}

/// The request for the open simulation on another course.
fn with_course(current: &Request, course: &str) -> Request {
    Request { course: Some(course.to_owned()), remembered: None, ..current.clone() }
}

/// What the menus of stacks and courses offer, by names for the palette. Where nothing is open, a course opens the
/// simulation on it.
pub(super) fn named_sources(frame: Option<&Frame>, current: &Request) -> Vec<(String, Request)> {
    let mut named = Vec::new();
    if current.log.is_some() {
        named.push(("Stack: no stack".to_owned(), with_stack(current, None)));
    }
    for (name, _, _) in stacks_for(frame, current).filter(|(_, _, unfit)| unfit.is_none()) {
        named.push((format!("Stack: {name}"), with_stack(current, Some(name))));
    }
    let simulated = match frame {
        Some(frame) if frame.info.kind == SourceKind::Stack && current.stack.is_some() => current.clone(),
        Some(_) => return named,
        None => Request { past: current.past.clone(), ..Request::simulation() },
    };
    let courses = bundled::names("course").into_iter();
    named.extend(courses.map(|course| (format!("Course: {course}"), with_course(&simulated, course))));
    named
}

/// Why a stack cannot be chosen on the open recording; `None` if it can. One that reads nothing of a recording can be
/// chosen on that of its own run, which it repeats.
fn unfit(stack: &StackFile, frame: &Frame) -> Option<String> {
    if let Some(topic) = missing(stack, frame) {
        return Some(format!("This recording has no {topic}."));
    }
    let mut runs = frame.topics_of_type("rcs.RunInfo").filter_map(|topic| topic.get::<RunInfo>());
    let reads = stack.topics().next().is_some() || runs.any(|run| run.stack == stack.name());
    (!reads).then(|| "It reads nothing of this recording.".to_owned())
}

/// The first topic that a stack reads and the open recording does not have.
fn missing<'a>(stack: &'a StackFile, frame: &Frame) -> Option<&'a str> {
    let known = &frame.info.log_topics;
    stack.topics().find(|topic| !known.contains(*topic))
}

/// Course and seed of a simulation.
pub(super) fn course_menu(
    ui: &mut egui::Ui,
    form: Form,
    frame: &Frame,
    current: &Request,
    actions: &mut Actions,
) {
    let running = course_of(current, frame).unwrap_or("course");
    let of_run = seed_of(current, frame);
    let text = format!("{}, seed {of_run}", stem(running));
    let response = bar::menu(ui, form, icons::ICON_FLAG, &text, |ui| {
        ui.set_min_width(200.0);
        for course in bundled::names("course") {
            if ui.selectable_label(course == running, course).clicked() {
                actions.push(TopBarAction::Open(with_course(current, course)));
                ui.close();
            }
        }
        ui.separator();
        let id = ui.scope_id().with("seed");
        // A seed that was typed counts only for the run that was shown then.
        let typed: Option<(u64, u64)> = ui.data(|data| data.get_temp(id));
        let mut seed = typed.filter(|(shown, _)| *shown == of_run).map_or(of_run, |(_, seed)| seed);
        ui.horizontal(|ui| {
            let label = ui.label("Seed");
            ui.add(egui::DragValue::new(&mut seed).speed(0.1)).labelled_by(label.id);
            if ui.button("Start with it").clicked() {
                let seed = Some(seed);
                actions.push(TopBarAction::Open(Request { seed, remembered: None, ..current.clone() }));
                ui.close();
            }
        });
        ui.data_mut(|data| data.insert_temp(id, (of_run, seed)));
        ui.separator();
        for command in [Command::NextRun, Command::SaveRemembered] {
            let Some(entry) = entry_of(command) else { continue };
            if ui.button(entry.name).clicked() {
                actions.push(TopBarAction::Run(command));
                ui.close();
            }
        }
    });
    response
        .on_hover_text("The course, and the seed of all that is random: the same seed gives the same run");
}

/// Course and seed of a recorded run that is computed again. It has them from its recording, so there is no choice.
pub(super) fn course_label(ui: &mut egui::Ui, form: Form, frame: &Frame, current: &Request) {
    let seed = format!("seed {}", seed_of(current, frame));
    let text = match course_of(current, frame) {
        Some(course) => format!("{}, {seed}", stem(course)),
        None => seed,
    };
    let icon = icons::ICON_FLAG.codepoint;
    let response = ui.label(if form == Form::Short { icon.to_owned() } else { format!("{icon}  {text}") });
    response.widget_info(|| WidgetInfo::labeled(Role::Label, true, &text));
    response
        .on_hover_text(format!("{text}: the recorded run is computed again with its course and its seed"));
}

/// The stack of the viewed run: the one that was asked for, else that of a recorded run which is computed again. `None`
/// for a recording.
fn stack_of<'a>(current: &'a Request, frame: Option<&'a Frame>) -> Option<&'a str> {
    current.stack.as_deref().or_else(|| Some(identity(frame?)?.stack.as_str()))
}

/// The course of the viewed run, as the run itself says, because another one can be set as a parameter; until it says
/// so, the one that was asked for. A course from a file is called by its file: copies of a course all have the name that
/// is written in them.
pub(super) fn course_of<'a>(current: &'a Request, frame: &'a Frame) -> Option<&'a str> {
    let asked = current.course.as_deref();
    let run = frame.topics_of_type("rcs.CourseRun").find_map(|topic| topic.get::<CourseRun>());
    let told = run.map(|run| run.course.as_str()).filter(|course| !course.is_empty());
    asked.filter(|course| looks_like_path(course)).or(told).or(asked)
}

/// The seed of the viewed run.
pub(super) fn seed_of(current: &Request, frame: &Frame) -> u64 {
    identity(frame).map_or(current.seed.unwrap_or(0), |run| run.seed)
}

/// What the viewed run says about itself; `None` for a recording. What it reads can be the recording of another run.
fn identity(frame: &Frame) -> Option<&RunInfo> {
    frame.topics_of_type("rcs.RunInfo").find(|topic| !topic.run.is_recorded())?.get()
}

/// The name of a file without its ending.
fn stem(path: &str) -> Cow<'_, str> {
    std::path::Path::new(path).file_stem().map_or(path.into(), |name| name.to_string_lossy())
}

/// Menu of the layouts: those that come with the program, the user's own, and what can be done with them.
pub(super) fn layout_menu(ui: &mut egui::Ui, form: Form, state: &State<'_>, actions: &mut Actions) {
    bar::menu(ui, form, icons::ICON_DASHBOARD, "Layout", |ui| {
        ui.set_min_width(200.0);
        for name in bundled::names("layout") {
            layout_choice(ui, name, state, actions);
        }
        if !state.layouts.own_names().is_empty() {
            ui.separator();
        }
        for name in state.layouts.own_names() {
            ui.horizontal(|ui| {
                layout_choice(ui, name, state, actions);
                let help = format!("Delete the layout {name}");
                // The open one would be kept again at the next change.
                if name != state.layout_name && widgets::icon_button(ui, icons::ICON_DELETE, &help).clicked()
                {
                    actions.push(TopBarAction::DeleteLayout(name.clone()));
                    ui.close();
                }
            });
        }
        ui.separator();
        let needed = [
            (Command::FittingLayout, state.frame.is_some()),
            (Command::ResetLayout, Layout::bundled(state.layout_name).is_some()),
            (Command::UndoLayout, state.document.can_undo()),
            (Command::RedoLayout, state.document.can_redo()),
        ];
        for (command, can) in needed {
            let Some(entry) = entry_of(command) else { continue };
            let button = egui::Button::new(entry.name).shortcut_text(state.keymap.text(command));
            if ui.add_enabled(can, button).clicked() {
                actions.push(TopBarAction::Run(command));
                ui.close();
            }
        }
        ui.separator();
        keep_layout(ui, state, actions);
    });
}

/// The line that keeps the arrangement under a name of the user's own.
fn keep_layout(ui: &mut egui::Ui, state: &State<'_>, actions: &mut Actions) {
    let id = ui.scope_id().with("layout name");
    let mut text: String = ui.data(|data| data.get_temp(id)).unwrap_or_default();
    ui.horizontal(|ui| {
        let edit = egui::TextEdit::singleline(&mut text).hint_text("a name of your own").desired_width(120.0);
        let edit = ui.add(edit);
        let entered = typing::entered(&edit);
        ui.ctx().accesskit_node_builder(edit.id, |node| node.set_label("Name of the layout"));
        let name = text.trim();
        let refused = if name.is_empty() {
            Some("Type a name first.".to_owned())
        } else if is_bundled(name) {
            Some(format!("{name} is a layout that comes with OCU: type another name."))
        } else {
            None
        };
        let replaced = state.layouts.replaced_by(name);
        let verb = if replaced.is_some() { "Replace" } else { "Keep as" };
        let mut keep = ui.add_enabled(refused.is_none(), egui::Button::new(verb));
        if let Some(replaced) = replaced {
            keep = keep.on_hover_text(format!("Replaces your layout {replaced}"));
        }
        // As in other dialogs, Enter replaces nothing.
        let is_kept = keep.clicked() || (entered && refused.is_none() && replaced.is_none());
        if let Some(refused) = refused {
            keep.on_disabled_hover_text(refused);
        }
        if is_kept {
            actions.push(TopBarAction::SaveLayout(name.to_owned()));
            text.clear();
            ui.close();
        }
    });
    ui.data_mut(|data| data.insert_temp(id, text));
}

/// A layout in the menu, which a click opens.
fn layout_choice(ui: &mut egui::Ui, name: &str, state: &State<'_>, actions: &mut Actions) {
    if ui.selectable_label(name == state.layout_name, name).clicked() {
        actions.push(TopBarAction::Layout(name.to_owned()));
        ui.close();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcs_runtime::RecordOptions;
    use rcs_runtime::source::Task;
    use std::path::Path;
    use std::sync::Arc;

    /// A stack that reads a recorded topic under another name.
    const RENAMES: &str = r#"
format = 1
name = "renames"
description = "Reads odometry under another name."

[[input]]
buffer = "/odometry"
topic = "/localization/local"

[[process]]
name = "vehicle_interface"
plugin = "vehicle_interface"
supervisor = "viewer"
inputs = { teleop = "/operator/teleop", emergency_stop = "/operator/emergency_stop", local = "/odometry" }
"#;

    #[test]
    fn a_stack_can_be_chosen_if_the_recording_has_its_topics_whatever_the_open_stack_makes_of_them() {
        let dir = tempfile::tempdir().unwrap();
        let (log, stack) = (dir.path().join("drive.mcap"), dir.path().join("renames.toml"));
        crate::sample::write(&log, 0.5, false).unwrap();
        std::fs::write(&stack, RENAMES).unwrap();
        let stack = Some(stack.display().to_string());
        let request = Request { log: Some(log), stack, ..Request::default() };
        let frame = stacks::open(&request).unwrap().frame();
        assert!(frame.topic("/localization/local").is_none() && frame.topic("/odometry").is_some());
        assert_eq!(unfit(&stacks::named("sample").unwrap(), &frame), None);
        let computed = "/vehicle_interface/wheels";
        assert!(frame.topic(computed).is_some());
        let reads = StackFile::parse("b.toml", &RENAMES.replace("/localization/local", computed)).unwrap();
        assert_eq!(missing(&reads, &frame), Some(computed));
    }

    #[test]
    fn a_stack_that_reads_nothing_of_a_recording_can_be_chosen_on_that_of_its_own_run_only() {
        let dir = tempfile::tempdir().unwrap();
        let (log, run) = (dir.path().join("drive.mcap"), dir.path().join("run.mcap"));
        crate::sample::write(&log, 0.5, false).unwrap();
        let request = Request { stack: Some("truth_driver".to_owned()), ..Request::default() };
        let mut source = stacks::open(&request).unwrap();
        source.record(&run, &RecordOptions { lossless: true, ..RecordOptions::default() }).unwrap();
        let end = source.info().start.after_ns(500_000_000);
        source.seek(end, &Task::default()).unwrap();
        drop(source);
        let reason = |log: &Path, stack: &str| {
            let request = Request { log: Some(log.to_owned()), ..Request::default() };
            let frame = stacks::open(&request).unwrap().frame();
            unfit(&stacks::named(stack).unwrap(), &frame)
        };
        let nothing = Some("It reads nothing of this recording.".to_owned());
        assert_eq!((reason(&log, "truth_driver"), reason(&log, "sample")), (nothing.clone(), None));
        assert_eq!((reason(&run, "truth_driver"), reason(&run, "simulation")), (None, nothing));
    }

    #[test]
    fn the_palette_offers_the_stacks_and_courses_of_the_menus() {
        let request = |frame: Option<&Frame>, current: &Request, name: &str| {
            let named = named_sources(frame, current);
            named.into_iter().find(|(known, _)| known == name).map(|(_, request)| request)
        };
        // Where nothing is open.
        let (nothing, driver) = (Request::default(), Some("truth_driver".to_owned()));
        let alone = request(None, &nothing, "Stack: truth_driver");
        assert_eq!(alone, Some(Request { stack: driver.clone(), ..Request::default() }));
        let hill = Some(Request { course: Some("hill".to_owned()), ..Request::simulation() });
        assert_eq!(request(None, &nothing, "Course: hill"), hill);
        assert_eq!(request(None, &nothing, "Stack: sample"), None, "it needs a recording");

        // On a recording, and in a simulation.
        let dir = tempfile::tempdir().unwrap();
        let log = dir.path().join("drive.mcap");
        crate::sample::write(&log, 0.5, false).unwrap();
        let recording = Request { log: Some(log), ..Request::default() };
        let frame = stacks::open(&recording).unwrap().frame();
        let sample = Request { stack: Some("sample".to_owned()), ..recording.clone() };
        assert_eq!(request(Some(&frame), &recording, "Stack: sample"), Some(sample));
        for name in ["Stack: truth_driver", "Course: hill"] {
            assert_eq!(request(Some(&frame), &recording, name), None, "{name}");
        }
        let running = Request { stack: driver, seed: Some(7), ..Request::default() };
        let frame = stacks::open(&running).unwrap().frame();
        let hill = Request { course: Some("hill".to_owned()), ..running.clone() };
        assert_eq!(request(Some(&frame), &running, "Course: hill"), Some(hill));
    }

    #[test]
    fn stack_course_and_seed_are_those_of_the_viewed_run() {
        let (stack, course) = (Some("truth_driver".to_owned()), Some("meadow".to_owned()));
        let request = Request { stack, course, seed: Some(7), ..Request::default() };
        let mut source = stacks::open(&request).unwrap();
        let second = source.info().start.after_ns(1_000_000_000);
        source.seek(second, &Task::default()).unwrap();
        let frame = source.frame();

        // The request for a run of a sweep names nothing but its recording.
        let swept = Request { log: Some("run.mcap".into()), ..Request::default() };
        assert_eq!(stack_of(&swept, Some(&frame)), Some("truth_driver"));
        assert_eq!(course_of(&swept, &frame), Some("meadow"));
        assert_eq!(seed_of(&swept, &frame), 7);
        let asked = |course: &str| Request { course: Some(course.to_owned()), ..request.clone() };
        assert_eq!(course_of(&asked("hill"), &frame), Some("meadow"), "the run knows better");
        let mine = asked("/tmp/mine.toml");
        let name = course_of(&mine, &frame).map(stem);
        assert_eq!(name.as_deref(), Some("mine"), "a copy has the old name in it");

        // Before the run has said anything, the request counts.
        let empty = Frame::empty(Arc::clone(&frame.info), frame.now);
        assert_eq!(stack_of(&request, Some(&empty)), Some("truth_driver"));
        assert_eq!((course_of(&request, &empty), seed_of(&request, &empty)), (Some("meadow"), 7));
        assert_eq!((stack_of(&swept, Some(&empty)), course_of(&swept, &empty)), (None, None));
    }
}
