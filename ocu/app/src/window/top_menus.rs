//! The menus of the bar at the top: sources, courses, stacks, runs and layouts.

use super::commands::{Command, entry_of};
use super::open::recent_button;
use super::top_state::{Actions, State, TopBarAction};
use crate::bundled;
use crate::layout::Layout;
use crate::open::Request;
use crate::stacks;
use ocu_ui::bar::{self, Form};
use ocu_ui::icons;
use rcs_runtime::source::Frame;

/// Menu of what can be opened.
pub(super) fn open_menu(ui: &mut egui::Ui, form: Form, state: &State<'_>, actions: &mut Actions) {
    bar::menu(ui, form, icons::ICON_FOLDER_OPEN, "Open", |ui| {
        ui.set_min_width(280.0);
        let past = || state.current.past.clone();
        if ui.button("Recording or stack…").clicked() {
            actions.push(TopBarAction::Ask);
            ui.close();
        }
        if ui.button("Simulation").on_hover_text("A vehicle in a simulated world, to drive by hand").clicked()
        {
            actions.push(TopBarAction::Open(Request { past: past(), ..Request::simulation() }));
            ui.close();
        }
        for path in state.recent {
            if recent_button(ui, path).clicked() {
                let log = Some(path.clone());
                actions.push(TopBarAction::Open(Request { log, past: past(), ..Request::default() }));
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
    let name = current.stack.as_deref().unwrap_or("no stack");
    let name = std::path::Path::new(name).file_name().map_or(name.into(), |name| name.to_string_lossy());
    let button = bar::menu(ui, form, icons::ICON_ACCOUNT_TREE, &name, |ui| {
        ui.set_min_width(200.0);
        let mut choice =
            |ui: &mut egui::Ui, stack: Option<&str>, text: &str, missing: Option<&str>, help: &str| {
                let label = egui::Button::selectable(current.stack.as_deref() == stack, text);
                let response = ui.add_enabled(missing.is_none(), label).on_hover_text(help);
                let response = match missing {
                    Some(topic) => {
                        response.on_disabled_hover_text(format!("{help}\nThis recording has no {topic}."))
                    }
                    None => response,
                };
                if response.clicked() {
                    actions.push(TopBarAction::Open(Request {
                        stack: stack.map(str::to_owned),
                        remembered: None,
                        ..current.clone()
                    }));
                    ui.close();
                }
            };
        if current.log.is_some() {
            choice(ui, None, "no stack", None, "Show the recording as it is");
            ui.separator();
        }
        let alone = current.log.is_none();
        for (name, stack) in
            stacks::bundled().iter().filter(|(_, stack)| !alone || stack.topics().next().is_none())
        {
            let missing =
                stack.topics().find(|topic| frame.is_some_and(|frame| frame.topic(topic).is_none()));
            choice(ui, Some(name), name, missing, stack.description());
        }
    });
    button.on_hover_text(format!("The stack that runs: {name}"));
}

/// Course and seed of a simulation.
pub(super) fn course_menu(
    ui: &mut egui::Ui,
    form: Form,
    frame: &Frame,
    current: &Request,
    actions: &mut Actions,
) {
    let run = frame.topics_of_type("rcs.CourseRun").find_map(|topic| topic.get::<rcs_msg::rcs::CourseRun>());
    let running = current.course.as_deref().or(run.map(|run| run.course.as_str())).unwrap_or("course");
    let name =
        std::path::Path::new(running).file_stem().map_or(running.into(), |name| name.to_string_lossy());
    let text = format!("{name}, seed {}", current.seed);
    let response = bar::menu(ui, form, icons::ICON_FLAG, &text, |ui| {
        ui.set_min_width(200.0);
        for course in bundled::names("course") {
            if ui.selectable_label(course == running, course).clicked() {
                let course = Some(course.to_owned());
                actions.push(TopBarAction::Open(Request { course, remembered: None, ..current.clone() }));
                ui.close();
            }
        }
        ui.separator();
        let id = ui.scope_id().with("seed");
        let mut seed = ui.data(|data| data.get_temp(id)).unwrap_or(current.seed);
        ui.horizontal(|ui| {
            let label = ui.label("Seed");
            ui.add(egui::DragValue::new(&mut seed).speed(0.1)).labelled_by(label.id);
            if ui.button("Start with it").clicked() {
                actions.push(TopBarAction::Open(Request { seed, remembered: None, ..current.clone() }));
                ui.close();
            }
        });
        ui.data_mut(|data| data.insert_temp(id, seed));
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

/// Menu of the layouts: those that come with the program, the user's own, and what can be done with them.
pub(super) fn layout_menu(ui: &mut egui::Ui, form: Form, state: &State<'_>, actions: &mut Actions) {
    bar::menu(ui, form, icons::ICON_DASHBOARD, "Layout", |ui| {
        ui.set_min_width(200.0);
        let mut choice = |ui: &mut egui::Ui, name: &str| {
            if ui.selectable_label(name == state.layout_name, name).clicked() {
                actions.push(TopBarAction::Layout(name.to_owned()));
                ui.close();
            }
        };
        for name in bundled::names("layout") {
            choice(ui, name);
        }
        if !state.own_layouts.is_empty() {
            ui.separator();
            state.own_layouts.iter().for_each(|name| choice(ui, name));
        }
        ui.separator();
        let needed = [
            (Command::FittingLayout, state.frame.is_some()),
            (Command::ResetLayout, Layout::bundled(state.layout_name).is_some()),
            (Command::UndoLayout, true),
            (Command::RedoLayout, true),
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
        let id = ui.scope_id().with("layout name");
        let mut name: String = ui.data(|data| data.get_temp(id)).unwrap_or_default();
        ui.horizontal(|ui| {
            let edit =
                egui::TextEdit::singleline(&mut name).hint_text("a name of your own").desired_width(120.0);
            let edit = ui.add(edit);
            ui.ctx().accesskit_node_builder(edit.id, |node| node.set_label("Name of the layout"));
            let is_free = !name.trim().is_empty() && Layout::bundled(name.trim()).is_none();
            if ui.add_enabled(is_free, egui::Button::new("Keep as")).clicked() {
                actions.push(TopBarAction::SaveLayout(name.trim().to_owned()));
                name.clear();
                ui.close();
            }
        });
        ui.data_mut(|data| data.insert_temp(id, name));
    });
}
