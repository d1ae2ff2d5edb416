//! The bar at the top of the window: the open source, its state, and actions.

use super::commands::Command;
use super::follow::Growth;
use super::held;
use super::operate::StopState;
use super::recording;
use super::top_menus::{course_label, course_menu, layout_menu, open_menu, runs_menu, stack_menu};
use super::top_state::{Actions, State, TopBarAction};
use super::top_tags::{alarms, authority, kind, opening, past, problems, run_state};
use super::tree::view_menu;
use ocu_ui::bar::{self, Bar, Fit};
use ocu_ui::{icons, tokens, widgets};
use rcs_runtime::source::SourceKind;

/// Paints the bar.
pub(super) fn ui(ui: &mut egui::Ui, state: &State<'_>) -> Vec<TopBarAction> {
    let mut actions = Vec::new();
    let mut bar = Bar::new("top");
    left(&mut bar, state);
    right(&mut bar, state);
    bar.show(ui, 24.0, &mut actions);
    actions
}

/// What the source is and does. Tags with a short form become short before the menus at the right lose their names.
fn left<'a>(bar: &mut Bar<'a, Actions>, state: &'a State<'a>) {
    bar.left("open", Fit::Leaves(90), |ui, form, actions| open_menu(ui, form, state, actions));
    if state.current.log.is_some() || state.current.stack.is_some() {
        bar.left("stack", Fit::Leaves(60), |ui, form, actions| stack_menu(ui, form, state, actions));
    }
    if let Some(title) = &state.opening {
        bar.left("opening", Fit::Leaves(100), move |ui, form, _| opening(ui, form, title));
    }
    let Some(frame) = state.frame else { return };
    let is_stack = frame.info.kind == SourceKind::Stack;
    if is_stack && state.current.stack.is_none() {
        bar.left("course", Fit::Leaves(70), |ui, form, _| course_label(ui, form, frame, state.current));
    } else if is_stack {
        bar.left("course", Fit::Leaves(70), |ui, form, actions| {
            course_menu(ui, form, frame, state.current, actions);
        });
        bar.left("restart", Fit::Leaves(50), |ui, form, actions| {
            let name = "Start again from the beginning";
            if bar::tool(ui, form, icons::ICON_RESTART_ALT, name).clicked() {
                actions.push(TopBarAction::Restart);
            }
        });
    }
    if frame.runs.all.iter().any(|run| run.writes > 0) {
        bar.left("runs", Fit::Leaves(80), |ui, form, actions| runs_menu(ui, form, frame, actions));
    }
    bar.left("kind", Fit::Leaves(75), |ui, _, _| drop(widgets::tag(ui, kind(frame), tokens(ui).accent)));
    if state.growth != Growth::None {
        bar.left("grows", Fit::Leaves(74), |ui, _, _| {
            let grows = state.growth == Growth::Grows;
            let (word, color) =
                if grows { ("GROWING", tokens(ui).ok) } else { ("NO NEW DATA", tokens(ui).warning) };
            let help = if grows {
                "The recording is still being written. At its end, the view follows it."
            } else {
                "The recording has no end, and has not grown for more than 10 s: what its end shows may be old. The \
                 view goes on when it grows again."
            };
            widgets::tag(ui, word, color).on_hover_text(help);
        });
    }
    if !frame.info.problems.is_empty() {
        bar.left("problems", Fit::Leaves(95), |ui, form, _| problems(ui, form, frame));
    }
    if held::is_any(frame) {
        bar.left("held", Fit::Stays, |ui, form, actions| held::menu(ui, form, frame, actions));
    }
    if !frame.processes.is_empty() {
        bar.left("processes", Fit::Shortens(110), |ui, form, _| run_state(ui, form, frame));
    }
    if frame.info.kind != SourceKind::Log {
        bar.left("record", Fit::Shortens(112), |ui, form, actions| {
            recording::ui(ui, form, state, frame, actions);
        });
    }
    if frame.info.kind != SourceKind::Log && !frame.runs.is_at_end && !frame.runs.all.is_empty() {
        bar.left("past", Fit::Leaves(105), |ui, form, actions| past(ui, form, state, frame, actions));
    }
    bar.left("authority", Fit::Shortens(85), |ui, form, _| authority(ui, form, frame));
    bar.left("alarms", Fit::Leaves(115), |ui, form, actions| alarms(ui, form, state, frame, actions));
    bar.left("title", Fit::Stretches(64.0), |ui, _, _| {
        let title = egui::RichText::new(state.current.shown_title(&frame.info)).color(tokens(ui).strong);
        ui.add(egui::Label::new(title).truncate()).on_hover_text(&frame.info.detail);
    });
}

/// What can be arranged, and the emergency stop at the very end.
fn right<'a>(bar: &mut Bar<'a, Actions>, state: &'a State<'a>) {
    bar.right("view", Fit::Leaves(40), |ui, form, actions| {
        bar::menu(ui, form, icons::ICON_ADD, "View", |ui| {
            if let Some(view_type) = view_menu(ui) {
                actions.push(TopBarAction::AddView(view_type));
            }
        });
    });
    bar.right("layout", Fit::Leaves(45), |ui, form, actions| layout_menu(ui, form, state, actions));
    bar.right("buffers", Fit::Leaves(35), |ui, form, actions| {
        let name = "Buffers";
        if bar::tool_of(ui, form, icons::ICON_VIEW_SIDEBAR, name, state.buffers_open, true).clicked() {
            actions.push(TopBarAction::ToggleBuffers);
        }
    });
    bar.right("find", Fit::Leaves(30), |ui, form, actions| {
        let text = format!("Find a command ({})", state.keymap.text(Command::Palette));
        if bar::tool(ui, form, icons::ICON_SEARCH, &text).clicked() {
            actions.push(TopBarAction::Palette);
        }
    });
    bar.right("keys", Fit::Leaves(15), |ui, form, actions| {
        if bar::tool(ui, form, icons::ICON_KEYBOARD, "List the keys").clicked() {
            actions.push(TopBarAction::Help);
        }
    });
    bar.right("theme", Fit::Leaves(10), |ui, form, actions| {
        let (icon, name) = if ui.visuals().dark_mode {
            (icons::ICON_LIGHT_MODE, "Light colours")
        } else {
            (icons::ICON_DARK_MODE, "Dark colours")
        };
        if bar::tool(ui, form, icon, name).clicked() {
            actions.push(TopBarAction::ToggleTheme);
        }
    });
    if state.stop != StopState::None {
        bar.right("stop", Fit::Stays, |ui, form, actions| {
            if let Some(active) = super::stop_button::ui(ui, form, state.stop, state.pushed) {
                actions.push(TopBarAction::EmergencyStop(active));
            }
        });
    }
}
