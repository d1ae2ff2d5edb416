//! The bar at the top of the window: the open source, its state, and actions.

use super::commands::{Command, entry_of};
use super::keymap::Keymap;
use super::open::recent_button;
use super::operate::StopState;
use super::tree::view_menu;
use crate::bundled;
use crate::layout::Layout;
use crate::open::Request;
use crate::stacks;
use ocu_ui::{icons, tokens, widgets};
use ocu_views::ViewType;
use rcs_msg::rcs::ProcessState;
use rcs_runtime::RunId;
use rcs_runtime::source::{Frame, SourceKind};
use std::path::PathBuf;

/// What the bar shows.
pub(super) struct State<'a> {
    pub(super) frame: Option<&'a Frame>,
    /// Progress of a long operation, 0 to 1.
    pub(super) busy: Option<f64>,
    pub(super) current: &'a Request,
    pub(super) opening: Option<String>,
    pub(super) recent: &'a [PathBuf],
    pub(super) buffers_open: bool,
    pub(super) layout_name: &'a str,
    /// The user's layouts that are none of the bundled ones.
    pub(super) own_layouts: &'a [String],
    pub(super) keymap: &'a Keymap,
    pub(super) stop: StopState,
    /// Whether a control of manual driving is deflected.
    pub(super) pushed: bool,
}

/// An action requested by the user.
pub(super) enum TopBarAction {
    Ask,
    Open(Request),
    /// Restart the source.
    Restart,
    /// Set or release the emergency stop.
    EmergencyStop(bool),
    Cancel,
    /// Show another run of the stack.
    SwitchRun(RunId),
    /// Undo the last write.
    Undo,
    ToggleBuffers,
    ToggleTheme,
    Help,
    AddView(&'static ViewType),
    Layout(String),
    /// Keep the arrangement under this name.
    SaveLayout(String),
    FittingLayout,
    Palette,
    /// Carry out a command of the table.
    Run(Command),
}

/// Paints the bar.
pub(super) fn ui(ui: &mut egui::Ui, state: &State<'_>) -> Vec<TopBarAction> {
    let mut actions = Vec::new();
    ui.horizontal(|ui| {
        // The right side is laid out first, so that it keeps its place and a long title is truncated.
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            right(ui, state, &mut actions);
            ui.with_layout(egui::Layout::left_to_right(egui::Align::Center), |ui| {
                left(ui, state, &mut actions);
            });
        });
    });
    actions
}

fn right(ui: &mut egui::Ui, state: &State<'_>, actions: &mut Vec<TopBarAction>) {
    if let Some(active) = super::stop_button::ui(ui, state.stop, state.pushed) {
        actions.push(TopBarAction::EmergencyStop(active));
    }
    let (icon, name) = if ui.visuals().dark_mode {
        (icons::ICON_LIGHT_MODE, "Light colours")
    } else {
        (icons::ICON_DARK_MODE, "Dark colours")
    };
    if widgets::icon_button(ui, icon, name).clicked() {
        actions.push(TopBarAction::ToggleTheme);
    }
    if widgets::icon_button(ui, icons::ICON_KEYBOARD, "List the keys").clicked() {
        actions.push(TopBarAction::Help);
    }
    let text = format!("Find a command ({})", state.keymap.text(Command::Palette));
    if widgets::icon_button(ui, icons::ICON_SEARCH, &text).clicked() {
        actions.push(TopBarAction::Palette);
    }
    let toggle = widgets::icon_button_of(ui, icons::ICON_VIEW_SIDEBAR, "Buffers", state.buffers_open, true);
    if toggle.clicked() {
        actions.push(TopBarAction::ToggleBuffers);
    }
    layout_menu(ui, state, actions);
    ui.menu_button(format!("{}  View", icons::ICON_ADD.codepoint), |ui| {
        if let Some(view_type) = view_menu(ui) {
            actions.push(TopBarAction::AddView(view_type));
        }
    });
}

/// Menu of the layouts: those that come with the program, the user's own, and what can be done with them.
fn layout_menu(ui: &mut egui::Ui, state: &State<'_>, actions: &mut Vec<TopBarAction>) {
    let config = egui::containers::menu::MenuConfig::new()
        .close_behavior(egui::PopupCloseBehavior::CloseOnClickOutside);
    let text = format!("{}  Layout", icons::ICON_DASHBOARD.codepoint);
    egui::containers::menu::MenuButton::new(text).config(config).ui(ui, |ui| {
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

/// Course and seed of a simulation, and a button to restart it.
fn course_menu(ui: &mut egui::Ui, frame: &Frame, current: &Request, actions: &mut Vec<TopBarAction>) {
    if frame.info.kind != SourceKind::Stack {
        return;
    }
    let run = frame.topics_of_type("rcs.CourseRun").find_map(|topic| topic.get::<rcs_msg::rcs::CourseRun>());
    let running = current.course.as_deref().or(run.map(|run| run.course.as_str())).unwrap_or("course");
    let name =
        std::path::Path::new(running).file_stem().map_or(running.into(), |name| name.to_string_lossy());
    let config = egui::containers::menu::MenuConfig::new()
        .close_behavior(egui::PopupCloseBehavior::CloseOnClickOutside);
    let text = format!("{}  {name}", icons::ICON_FLAG.codepoint);
    let (response, _) = egui::containers::menu::MenuButton::new(text).config(config).ui(ui, |ui| {
        ui.set_min_width(200.0);
        for course in bundled::names("course") {
            if ui.selectable_label(course == running, course).clicked() {
                actions
                    .push(TopBarAction::Open(Request { course: Some(course.to_owned()), ..current.clone() }));
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
                actions.push(TopBarAction::Open(Request { seed, ..current.clone() }));
                ui.close();
            }
        });
        ui.data_mut(|data| data.insert_temp(id, seed));
    });
    response
        .on_hover_text("The course, and the seed of all that is random: the same seed gives the same run");
    if widgets::icon_button(ui, icons::ICON_RESTART_ALT, "Start again from the beginning").clicked() {
        actions.push(TopBarAction::Restart);
    }
}

fn left(ui: &mut egui::Ui, state: &State<'_>, actions: &mut Vec<TopBarAction>) {
    ui.menu_button(format!("{}  Open", icons::ICON_FOLDER_OPEN.codepoint), |ui| {
        ui.set_min_width(280.0);
        if ui.button("Recording or stack…").clicked() {
            actions.push(TopBarAction::Ask);
            ui.close();
        }
        if ui.button("Simulation").on_hover_text("A vehicle in a simulated world, to drive by hand").clicked()
        {
            let past = state.current.past.clone();
            actions.push(TopBarAction::Open(Request { past, ..Request::simulation() }));
            ui.close();
        }
        for path in state.recent {
            if recent_button(ui, path).clicked() {
                let past = state.current.past.clone();
                actions.push(TopBarAction::Open(Request {
                    log: Some(path.clone()),
                    past,
                    ..Request::default()
                }));
                ui.close();
            }
        }
    });
    if state.current.log.is_some() || state.current.stack.is_some() {
        stack_menu(ui, state.frame, state.current, actions);
    }
    if let Some(frame) = state.frame {
        course_menu(ui, frame, state.current, actions);
        runs_menu(ui, frame, actions);
        source(ui, frame, state.busy, actions);
    }
    if let Some(title) = &state.opening {
        ui.label(icons::ICON_HOURGLASS_TOP.rich_text().size(14.0).color(tokens(ui).weak));
        ui.add(
            egui::Label::new(egui::RichText::new(format!("opening {title}")).color(tokens(ui).weak))
                .truncate(),
        );
    }
}

/// Menu of the runs, if there are several, and undo of the last write.
fn runs_menu(ui: &mut egui::Ui, frame: &Frame, actions: &mut Vec<TopBarAction>) {
    let (runs, current) = (&frame.runs.all, frame.runs.current());
    if runs.iter().all(|run| run.writes == 0) {
        return;
    }
    let text = format!("{}  {current}", icons::ICON_CALL_SPLIT.codepoint);
    let button = ui.menu_button(text, |ui| {
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
    button.response.on_hover_text(
        "The runs: a command after going back begins another one, and the one that it leaves is kept",
    );
}

/// Menu of the stacks that can run on the recording, or, without one, of those that need none.
fn stack_menu(ui: &mut egui::Ui, frame: Option<&Frame>, current: &Request, actions: &mut Vec<TopBarAction>) {
    let name = current.stack.as_deref().unwrap_or("no stack");
    let name = std::path::Path::new(name).file_name().map_or(name.into(), |name| name.to_string_lossy());
    let button = ui.menu_button(format!("{}  {name}", icons::ICON_ACCOUNT_TREE.codepoint), |ui| {
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
    button.response.on_hover_text("The stack that runs");
}

fn source(ui: &mut egui::Ui, frame: &Frame, busy: Option<f64>, actions: &mut Vec<TopBarAction>) {
    let tokens = tokens(ui);
    let info = &frame.info;
    let kind = match info.kind {
        SourceKind::Log => "LOG",
        SourceKind::Replay => "REPLAY",
        SourceKind::Stack if frame.topics.iter().any(rcs_runtime::source::Topic::is_ground_truth) => {
            "SIMULATION"
        }
        SourceKind::Stack => "STACK",
    };
    widgets::tag(ui, kind, tokens.accent);
    if !info.problems.is_empty() {
        let count = info.problems.len();
        let text = format!("{count} {}", if count == 1 { "problem" } else { "problems" });
        let text =
            egui::RichText::new(format!("{}  {text}", icons::ICON_WARNING.codepoint)).color(tokens.warning);
        ui.menu_button(text, |ui| {
            ui.set_max_width(480.0);
            egui::ScrollArea::vertical().max_height(320.0).show(ui, |ui| {
                for problem in &info.problems {
                    ui.add(egui::Label::new(problem).wrap());
                }
            });
        });
    }
    run_state(ui, frame);
    // While time runs the source is always busy, and the timeline shows its state.
    if let Some(fraction) = busy.filter(|_| !frame.playback.playing) {
        let bar = egui::ProgressBar::new(fraction as f32).desired_width(120.0).desired_height(14.0);
        ui.add(bar.text(egui::RichText::new(format!("{:.0} %", fraction * 100.0)).small()));
        if widgets::icon_button(ui, icons::ICON_CANCEL, "Stop this work").clicked() {
            actions.push(TopBarAction::Cancel);
        }
    }
    let title = egui::Label::new(egui::RichText::new(&info.title).color(tokens.strong)).truncate();
    ui.add(title).on_hover_text(&info.detail);
}

/// The state of the processes in one word.
fn run_state(ui: &mut egui::Ui, frame: &Frame) {
    if frame.processes.is_empty() {
        return;
    }
    let tokens = tokens(ui);
    let states: Vec<Option<ProcessState>> = frame
        .processes
        .iter()
        .map(|process| frame.status(process).map(rcs_msg::rcs::Status::state))
        .collect();
    let count = |state: ProcessState| states.iter().filter(|&&known| known == Some(state)).count();
    let all = states.len();
    let (errors, done) = (count(ProcessState::Error), count(ProcessState::Done));
    let (text, color) = if errors > 0 {
        (format!("{errors} of {all} ERROR"), tokens.error)
    } else if states.iter().any(Option::is_none) {
        ("NOT STARTED".to_owned(), tokens.unknown)
    } else if done == all {
        ("DONE".to_owned(), tokens.text)
    } else {
        (format!("{} of {all} EXEC", count(ProcessState::Exec)), tokens.ok)
    };
    let names: Vec<String> = frame
        .processes
        .iter()
        .zip(&states)
        .map(|(process, state)| {
            format!("{}: {}", process.name, state.map_or("no status yet", |state| state.as_str_name()))
        })
        .collect();
    widgets::tag(ui, &text, color).on_hover_text(names.join("\n"));
}
