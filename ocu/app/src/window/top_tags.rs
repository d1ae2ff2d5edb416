//! The state of the source in the bar at the top, in a few words each.

use super::commands::{Command, entry_of};
use super::operate::is_overdue;
use super::top_state::{Actions, State, TopBarAction};
use ocu_ui::bar::{self, Form};
use ocu_ui::{format, icons, tokens, widgets};
use ocu_views::operator;
use ocu_views::process_state::{NOT_RECORDED, silent_s};
use rcs_msg::Stamp;
use rcs_msg::rcs::ProcessState;
use rcs_runtime::VIEWER;
use rcs_runtime::source::{Event, Frame, SourceKind, Topic};

/// Who holds the authority after a command of the operator.
const OPERATOR: &str = "operator";
/// Most alarms that are listed.
const MOST_ALARMS: usize = 12;

/// The kind of the source in one word.
pub(super) fn kind(frame: &Frame) -> &'static str {
    match frame.info.kind {
        SourceKind::Log => "LOG",
        SourceKind::Replay => "REPLAY",
        SourceKind::Stack if frame.topics.iter().any(Topic::is_ground_truth) => "SIMULATION",
        SourceKind::Stack => "STACK",
    }
}

/// What is wrong with the recording.
pub(super) fn problems(ui: &mut egui::Ui, form: Form, frame: &Frame) {
    let problems = &frame.info.problems;
    let count = problems.len();
    let text = format!("{count} {}", if count == 1 { "problem" } else { "problems" });
    ui.visuals_mut().override_text_color = Some(tokens(ui).warning);
    bar::menu(ui, form, icons::ICON_WARNING, &text, |ui| {
        ui.set_max_width(480.0);
        egui::ScrollArea::vertical().max_height(320.0).show(ui, |ui| {
            for problem in problems {
                ui.add(egui::Label::new(problem).wrap());
            }
        });
    });
}

/// Says that the viewed moment is in the past; a click goes to the newest time. It looks like a tag.
pub(super) fn past(ui: &mut egui::Ui, form: Form, state: &State<'_>, frame: &Frame, actions: &mut Actions) {
    let response = widgets::tag_button(ui, "PAST", tokens(ui).warning);
    if response.clicked() {
        actions.push(TopBarAction::ToNewest);
        if form == Form::Listed {
            ui.close();
        }
    }
    // On a recording, the key leads to the end of that, up to which the run has to be computed.
    let key = match frame.info.end {
        Some(_) => String::new(),
        None => format!(" ({})", state.keymap.text(Command::ToEnd)),
    };
    let help = format!(
        "Go to the newest time{key}. This moment is in the past of the run: a command, a parameter or driving from here \
         begins another run, and this one is kept."
    );
    response.on_hover_text(help);
}

/// Who drives or commands: the operator, or the supervisors.
pub(super) fn authority(ui: &mut egui::Ui, form: Form, frame: &Frame) {
    let vehicle =
        operator::vehicle(frame).filter(|(topic, _)| !topic.pending && !is_overdue(topic, frame.now));
    let is_driven = vehicle.is_some_and(|(_, status)| status.teleoperated);
    let (short, text, color) = match commander(frame) {
        _ if is_driven => ("HAND", "BY HAND".to_owned(), tokens(ui).accent),
        Some((text, true)) => ("OP", text, tokens(ui).accent),
        Some((text, false)) => ("AUTO", text, tokens(ui).text),
        None => return,
    };
    let text = if form == Form::Short { short } else { &text };
    widgets::tag(ui, text, color).on_hover_text(
        "BY HAND: the operator drives the vehicle. Else, who has the authority to command the processes that have a \
         supervisor: their supervisors (AUTONOMOUS), or you (OPERATOR), after a command of yours to these processes.",
    );
}

/// Who commands the processes that have a supervisor, in words, and whether the operator commands any of them. `None` where
/// nobody commands one. The viewer is no supervisor here: what it starts has nobody but the operator above it.
fn commander(frame: &Frame) -> Option<(String, bool)> {
    let owners: Vec<&str> = frame
        .processes
        .iter()
        .filter(|process| !["", VIEWER].contains(&process.supervisor.as_str()))
        .filter(|process| silent_s(frame, process).is_none())
        .filter_map(|process| frame.status(process))
        .map(|status| status.owner.as_str())
        .filter(|owner| !owner.is_empty())
        .collect();
    let by_hand = owners.iter().filter(|owner| **owner == OPERATOR).count();
    let text = match (by_hand, owners.len()) {
        (_, 0) => return None,
        (0, _) => "AUTONOMOUS".to_owned(),
        (count, all) if count == all => "OPERATOR".to_owned(),
        (1, _) => "OPERATOR: 1 PROCESS".to_owned(),
        (count, _) => format!("OPERATOR: {count} PROCESSES"),
    };
    Some((text, by_hand > 0))
}

/// The alarms that the user has not acknowledged.
pub(super) fn alarms(ui: &mut egui::Ui, form: Form, state: &State<'_>, frame: &Frame, actions: &mut Actions) {
    let Some(events) = frame.events() else { return };
    let mut errors = events.last_alarms(frame.now, MOST_ALARMS);
    errors.retain(|event| event.stamp > state.known_until);
    if errors.is_empty() {
        return;
    }
    let count = errors.len();
    let more = if count == MOST_ALARMS { "+" } else { "" };
    let text = format!("{count}{more} {}", if count == 1 { "alarm" } else { "alarms" });
    ui.visuals_mut().override_text_color = Some(tokens(ui).error);
    bar::menu(ui, form, icons::ICON_NOTIFICATIONS, &text, |ui| {
        ui.set_max_width(480.0);
        if let Some(action) = alarm_list(ui, &errors, frame.info.start) {
            actions.push(action);
            ui.close();
        }
        ui.separator();
        if let Some(entry) = entry_of(Command::Silence) {
            let button = egui::Button::selectable(false, entry.name);
            let button = button.shortcut_text(state.keymap.text(Command::Silence));
            if widgets::named(ui, entry.name, |ui| ui.add(button).clicked()) {
                actions.push(TopBarAction::Run(Command::Silence));
            }
        }
        if sound_choice(ui, state.alarm_sound.is_on()) {
            actions.push(TopBarAction::Run(Command::AlarmSound));
        }
        if state.alarm_sound.is_mute() {
            let text = "This computer has no player or no device for sounds.";
            ui.label(egui::RichText::new(text).small().color(tokens(ui).weak));
        }
    });
}

/// Whether alarms are heard, as a check mark; returns whether that is switched.
fn sound_choice(ui: &mut egui::Ui, is_on: bool) -> bool {
    let mut chosen = is_on;
    widgets::named(ui, "sound", |ui| ui.checkbox(&mut chosen, "Sound of alarms").changed())
}

/// The button that acknowledges, and the alarms, the latest first. The button is above them, where it does not move when
/// another one comes.
fn alarm_list(ui: &mut egui::Ui, errors: &[Event], start: Stamp) -> Option<TopBarAction> {
    let latest = errors.first()?.stamp;
    let mut action = None;
    let button = ui.button("Acknowledge all");
    // One that comes after the press has not been seen.
    let seen_until = widgets::as_pressed(&button, latest);
    if button.clicked() {
        action = Some(TopBarAction::Acknowledge(seen_until));
    }
    ui.separator();
    let mut names = widgets::RowNames::default();
    for event in errors {
        let time = format::elapsed(event.stamp.seconds_since(start));
        let line = format!("{time}  {}: {}", event.source, event.text);
        let name = (event.stamp, &event.source, &event.text);
        if names.named(ui, name, |ui| alarm_line(ui, &line)) {
            action = Some(TopBarAction::PauseAt(event.stamp));
        }
    }
    action
}

/// A line of the list of alarms; resting on it shows all of it. Returns whether it is clicked.
fn alarm_line(ui: &mut egui::Ui, line: &str) -> bool {
    let button = ui.add(egui::Button::new(line).truncate().frame(false));
    widgets::help_beside(button, line).clicked()
}

/// The source that is being opened.
pub(super) fn opening(ui: &mut egui::Ui, form: Form, title: &str) {
    let weak = tokens(ui).weak;
    let icon = icons::ICON_HOURGLASS_TOP.rich_text().size(14.0).color(weak);
    let text = format!("opening {title}");
    if form == Form::Short {
        ui.label(icon).on_hover_text(text);
    } else {
        ui.label(icon);
        ui.label(egui::RichText::new(text).color(weak));
    }
}

/// The state of the processes in one word, or two where some have failed and others post no status any more.
pub(super) fn run_state(ui: &mut egui::Ui, form: Form, frame: &Frame) {
    let tokens = tokens(ui);
    let states: Vec<Option<ProcessState>> = frame
        .processes
        .iter()
        .map(|process| frame.status(process).map(rcs_msg::rcs::Status::state))
        .collect();
    let silent: Vec<Option<f64>> = frame.processes.iter().map(|process| silent_s(frame, process)).collect();
    let count = |state: ProcessState| states.iter().filter(|&&known| known == Some(state)).count();
    let all = states.len();
    let (errors, done) = (count(ProcessState::Error), count(ProcessState::Done));
    // One that said that it has failed before it fell silent counts as failed only.
    let with_ages = states.iter().zip(&silent);
    let silent_count =
        with_ages.filter(|(state, age_s)| age_s.is_some() && **state != Some(ProcessState::Error)).count();
    let (text, color) = if errors > 0 && silent_count > 0 {
        (format!("{errors} of {all} ERROR, {silent_count} NO STATUS"), tokens.error)
    } else if errors > 0 {
        (format!("{errors} of {all} ERROR"), tokens.error)
    } else if silent_count > 0 {
        (format!("{silent_count} of {all} NO STATUS"), tokens.warning)
    } else if states.iter().any(Option::is_none) {
        let word = if frame.is_before_recording() { NOT_RECORDED } else { "NOT STARTED" };
        (word.to_owned(), tokens.unknown)
    } else if done == all {
        ("DONE".to_owned(), tokens.text)
    } else {
        (format!("{} of {all} EXEC", count(ProcessState::Exec)), tokens.ok)
    };
    let text = match form {
        Form::Short => {
            text.replace(" of ", "/").replace("NOT STARTED", "OFF").replace(NOT_RECORDED, "NO DATA")
        }
        Form::Full | Form::Listed => text,
    };
    let absent = if frame.is_before_recording() { "not recorded yet" } else { "no status yet" };
    let names: Vec<String> = frame
        .processes
        .iter()
        .zip(states.iter().zip(&silent))
        .map(|(process, (state, silent))| {
            let state = state.map_or(absent, |state| state.as_str_name());
            let old = silent.map(|age_s| format!(", no status for {}", format::age(age_s)));
            format!("{}: {state}{}", process.name, old.unwrap_or_default())
        })
        .collect();
    widgets::tag(ui, &text, color).on_hover_text(names.join("\n"));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::open::Request;
    use egui::accesskit::Toggled;
    use egui_kittest::Harness;
    use egui_kittest::kittest::{NodeT as _, Queryable as _};
    use rcs_bus::{Header, Sample, WriterId};
    use rcs_msg::rcs::{self, ProcessInfo, Status};
    use rcs_msg::{AnyMessage, schema_of};
    use rcs_runtime::source::{EventKind, EventLevel, RunTag, Source, SourceInfo, Task};
    use std::cell::{Cell, RefCell};
    use std::sync::Arc;

    fn shown<'a>(add: impl FnMut(&mut egui::Ui) + 'a) -> Harness<'a> {
        let size = egui::Vec2::new(300.0, 200.0);
        let mut harness =
            Harness::builder().with_size(size).with_context_setup(ocu_ui::install).build_ui(add);
        harness.run();
        harness
    }

    /// Processes with their states and the ages of their statuses, s.
    fn frame(statuses: &[(&str, ProcessState, u64)]) -> Frame {
        let now = Stamp(60_000_000_000);
        let topic = |&(name, state, age_s): &(&str, ProcessState, u64)| {
            let log_time = now.before_ns(age_s * 1_000_000_000);
            let header = Header { sequence: 1, log_time, acq_time: log_time, writer: WriterId::RUNTIME };
            let status = Status { state: state.into(), ..Status::default() };
            Topic::new(name, RunTag::FIRST, Arc::clone(schema_of::<Status>()))
                .with_latest(Sample { header, message: AnyMessage::new(status) })
        };
        let process = |&(name, ..): &(&str, ProcessState, u64)| ProcessInfo {
            name: name.to_owned(),
            status_buffer: name.to_owned(),
            ..ProcessInfo::default()
        };
        let (topics, processes) =
            (statuses.iter().map(topic).collect(), statuses.iter().map(process).collect());
        Frame { topics, processes, ..Frame::empty(Arc::default(), now) }
    }

    #[test]
    fn a_process_without_status_is_counted_beside_one_that_has_failed() {
        let (error, exec) = (("failed", ProcessState::Error, 0), ("works", ProcessState::Exec, 0));
        let silent = ("silent", ProcessState::Exec, 30);
        let failed_and_silent = ("gone", ProcessState::Error, 30);
        for (statuses, text) in [
            (vec![error, silent, exec], "1 of 3 ERROR, 1 NO STATUS"),
            (vec![error, exec], "1 of 2 ERROR"),
            (vec![failed_and_silent, exec], "1 of 2 ERROR"),
            (vec![failed_and_silent, silent, exec], "1 of 3 ERROR, 1 NO STATUS"),
            (vec![silent, exec], "1 of 2 NO STATUS"),
        ] {
            let frame = frame(&statuses);
            let harness = shown(|ui| run_state(ui, Form::Full, &frame));
            assert!(harness.query_by_label(text).is_some(), "{text}");
        }
    }

    #[test]
    fn processes_are_not_said_not_to_have_started_before_their_recording_begins() {
        let mut frame = frame(&[("works", ProcessState::Exec, 0)]);
        frame.topics = Arc::new([]);
        for (complete_from, text) in [
            (None, "NOT STARTED"),
            (Some(frame.now.after_ns(1)), NOT_RECORDED),
            (Some(frame.now), "NOT STARTED"),
        ] {
            frame.info = Arc::new(SourceInfo { complete_from, ..SourceInfo::default() });
            let harness = shown(|ui| run_state(ui, Form::Full, &frame));
            assert!(harness.query_by_label(text).is_some(), "{text}");
        }
    }

    #[test]
    fn a_long_alarm_is_shown_in_full_under_the_pointer() {
        let line = format!("00:00:01.000  planner: no way {}is free", "to the goal ".repeat(20));
        let mut harness = shown(|ui| {
            alarm_line(ui, &line);
        });
        let button = harness.get_by_label(&line).rect();
        assert!(button.width() <= 300.0, "{button:?}");
        harness.hover_at(button.center());
        harness.run_steps(8);
        assert_eq!(harness.query_all_by_label(&line).count(), 2, "the line, and its help");
    }

    #[test]
    fn the_menu_of_alarms_has_a_check_mark_where_they_are_heard() {
        let is_on = Cell::new(true);
        let mut harness = shown(|ui| is_on.set(is_on.get() != sound_choice(ui, is_on.get())));
        let mark = |harness: &Harness<'_>| harness.get_by_label("Sound of alarms").accesskit_node().toggled();
        assert_eq!(mark(&harness), Some(Toggled::True));
        harness.get_by_label("Sound of alarms").click();
        harness.run();
        assert_eq!(mark(&harness), Some(Toggled::False));
    }

    /// Presses what has a label in a list of alarms at these seconds, then shows another list, and releases.
    fn pressed(first: &[u64], label: &str, then: &[u64]) -> Option<TopBarAction> {
        let of = |at_s: &[u64]| -> Vec<Event> {
            let alarm = |&at_s: &u64| Event {
                stamp: Stamp(at_s * 1_000_000_000),
                kind: EventKind::Error,
                level: EventLevel::Error,
                source: "planner".into(),
                text: format!("fault {at_s}").into(),
            };
            at_s.iter().map(alarm).collect()
        };
        let (alarms, asked) = (RefCell::new(of(first)), RefCell::new(None));
        let mut harness = shown(|ui| {
            if let Some(action) = alarm_list(ui, &alarms.borrow(), Stamp(0)) {
                *asked.borrow_mut() = Some(action);
            }
        });
        let at = harness.get_by_label_contains(label).rect().center();
        harness.drag_at(at);
        harness.step();
        *alarms.borrow_mut() = of(then);
        harness.step();
        harness.drop_at(at);
        harness.step();
        drop(harness);
        asked.into_inner()
    }

    #[test]
    fn a_press_acknowledges_the_alarms_that_were_shown_and_not_one_that_comes_before_the_release() {
        for then in [&[3, 2][..], &[9, 3, 2]] {
            let Some(TopBarAction::Acknowledge(until)) = pressed(&[3, 2], "Acknowledge all", then) else {
                panic!("nothing is acknowledged")
            };
            assert_eq!(until, Stamp(3_000_000_000), "{then:?}");
        }
    }

    #[test]
    fn a_press_on_an_alarm_goes_to_no_other_one_that_takes_its_place() {
        for then in [&[3][..], &[9, 3, 2]] {
            let Some(TopBarAction::PauseAt(at)) = pressed(&[3, 2], "fault 3", then) else {
                panic!("nowhere")
            };
            assert_eq!(at, Stamp(3_000_000_000), "{then:?}");
        }
        assert!(pressed(&[3, 2], "fault 3", &[9, 2]).is_none());
    }

    #[test]
    fn a_stack_is_autonomous_until_the_operator_commands_one_of_its_processes() {
        let request = Request { stack: Some("truth_driver".to_owned()), ..Request::default() };
        let mut source = crate::stacks::open(&request).unwrap();
        let start = source.info().start;
        source.seek(start.after_ns(1_000_000_000), &Task::default()).unwrap();
        let frame = source.frame();
        assert_eq!(commander(&frame), Some(("AUTONOMOUS".to_owned(), false)));

        let localization = frame.processes.iter().find(|process| process.name == "localization").unwrap();
        let take = rcs::Command { serial: 1, name: "TAKE".to_owned(), ..Default::default() };
        source.write(&localization.command_buffer, AnyMessage::new(take)).unwrap();
        source.seek(start.after_ns(1_500_000_000), &Task::default()).unwrap();
        assert_eq!(commander(&source.frame()), Some(("OPERATOR: 1 PROCESS".to_owned(), true)));
    }

    #[test]
    fn a_vehicle_that_the_operator_drives_is_driven_by_hand() {
        let request = Request { stack: Some("simulation".to_owned()), ..Request::default() };
        let mut source = crate::stacks::open(&request).unwrap();
        let start = source.info().start;
        let tag_at = |source: &mut dyn Source, ns: u64| {
            source.seek(start.after_ns(ns), &Task::default()).unwrap();
            let frame = source.frame();
            let harness = shown(|ui| authority(ui, Form::Full, &frame));
            ["BY HAND", "AUTONOMOUS"].map(|text| harness.query_by_label(text).is_some())
        };
        assert_eq!(tag_at(&mut *source, 1_000_000_000), [false, true]);
        let command = rcs::DriveCommand { speed_mps: 0.5, ..rcs::DriveCommand::default() };
        source.write("/operator/teleop", AnyMessage::new(command)).unwrap();
        assert_eq!(tag_at(&mut *source, 1_100_000_000), [true, false]);
        assert_eq!(tag_at(&mut *source, 2_000_000_000), [false, true], "the operator has let go");
    }
}
