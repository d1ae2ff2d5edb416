//! Tests of events.

use super::*;
use rcs_msg::rcs::r#override::Mode;

fn status(state: rcs::ProcessState, text: &str, faults: u64) -> AnyMessage {
    AnyMessage::new(rcs::Status {
        process: "planner".into(),
        command: "RUN".into(),
        state: state.into(),
        state_text: text.into(),
        faults,
        ..rcs::Status::default()
    })
}

/// Takes the next message of a run.
fn take(watch: &mut EventWatch, topic: &Arc<str>, time: Stamp, message: &AnyMessage) {
    watch.take(topic, Written { time, messages: watch.messages + 1 }, message);
}

fn texts(events: &Events) -> Vec<String> {
    let mut texts = Vec::new();
    events.each_from(0, |_, event| texts.push(format!("{} {}", event.kind.name(), event.text)));
    texts
}

#[test]
fn only_changes_of_a_state_are_events_and_numbers_in_its_text_are_none() {
    let mut watch = EventWatch::default();
    let topic: Arc<str> = "/planner/status".into();
    let exec = rcs::ProcessState::Exec;
    let messages = [
        status(exec, "12.5 m to go", 0),
        status(exec, "12.1 m to go", 0),
        status(exec, "no path", 1),
        status(exec, "11.9 m to go", 1),
        status(exec, "no path", 2),
        status(exec, "no path", 3),
        status(rcs::ProcessState::Error, "", 3),
    ];
    for (second, message) in (0_u64..).zip(&messages) {
        take(&mut watch, &topic, Stamp(second * 1_000_000_000), message);
    }
    let events = watch.read(RunTag::FIRST);
    assert_eq!(
        texts(&events),
        [
            "modes EXEC · RUN · 12.5 m to go",
            "modes EXEC · RUN · no path",
            "errors 1 input not used: ",
            "errors 2 inputs not used: ",
            "errors ERROR · RUN",
        ]
    );
    let fork = watch.fork(Written { time: Stamp(3_000_000_000), messages: 4 }).read(RunTag::FIRST);
    assert_eq!(fork.len(), 3);
    assert!(!fork.same(&events));
}

#[test]
fn a_part_in_the_diagnostics_is_an_event_when_its_level_changes_and_not_when_it_repeats() {
    let mut watch = EventWatch::default();
    let topic: Arc<str> = "/diagnostics".into();
    let part = |name: &str, level: Level, message: &str| rcs::Diagnostic {
        level: level.into(),
        name: name.into(),
        message: message.into(),
        hardware_id: if name == "lidar" { "HDL-32E".into() } else { String::new() },
    };
    let heard = [
        vec![part("lidar", Level::Ok, "10.0 Hz"), part("disk", Level::Warn, "91 % full")],
        vec![part("lidar", Level::Ok, "9.9 Hz"), part("disk", Level::Warn, "92 % full")],
        vec![part("lidar", Level::Error, "no packets")],
        vec![part("lidar", Level::Error, "no packets"), part("disk", Level::Stale, "")],
        vec![part("lidar", Level::Ok, "10.0 Hz")],
    ];
    for (second, parts) in (0_u64..).zip(heard) {
        let message = AnyMessage::new(rcs::Diagnostics { parts, ..rcs::Diagnostics::default() });
        take(&mut watch, &topic, Stamp(second * 1_000_000_000), &message);
    }
    let mut found = Vec::new();
    let events = watch.read(RunTag::FIRST);
    events.each_from(0, |_, event| found.push((event.level, format!("{}: {}", event.source, event.text))));
    let wanted = [
        (EventLevel::Warning, "disk: WARN · 91 % full"),
        (EventLevel::Error, "lidar: ERROR · no packets · HDL-32E"),
        (EventLevel::Warning, "disk: STALE"),
        (EventLevel::Info, "lidar: OK · 10.0 Hz · HDL-32E"),
    ];
    assert_eq!(found, wanted.map(|(level, text)| (level, text.to_owned())));
    // A run that branches before the error tells it again.
    let mut branch = watch.fork(Written { time: Stamp(1_000_000_000), messages: 2 });
    let parts = vec![part("disk", Level::Warn, "92 % full"), part("lidar", Level::Error, "no packets")];
    let message = AnyMessage::new(rcs::Diagnostics { parts, ..rcs::Diagnostics::default() });
    take(&mut branch, &topic, Stamp(2_000_000_000), &message);
    assert_eq!(branch.read(RunTag::FIRST).len(), 2);
}

#[test]
fn a_branch_begins_with_what_was_known_where_it_leaves_its_parent() {
    let second = |second: u64| Stamp(second * 1_000_000_000);
    let [planner, bumper, stop]: [Arc<str>; 3] = ["/planner/status", "/bumper", "/stop"].map(Into::into);
    let driving = |faults| status(rcs::ProcessState::Exec, "3 m to go", faults);
    let pressed = |left| AnyMessage::new(rcs::Bumper { left, ..rcs::Bumper::default() });
    let stopped = |active| AnyMessage::new(rcs::EmergencyStop { active, ..rcs::EmergencyStop::default() });
    let mut parent = EventWatch::default();
    take(&mut parent, &stop, second(0), &stopped(false));
    for at in 0..=60 {
        take(&mut parent, &planner, second(at), &driving(if at < 40 { 1 } else { at }));
        take(&mut parent, &bumper, second(at), &pressed(at >= 30));
    }
    take(&mut parent, &stop, second(60), &stopped(true));
    // One of the stop, and two for each second up to that of the branch.
    let mut branch = parent.fork(Written { time: second(20), messages: 1 + 2 * 21 });
    let shared = branch.read(RunTag::FIRST).len();
    // Nothing has changed since.
    take(&mut branch, &planner, second(21), &driving(1));
    take(&mut branch, &bumper, second(21), &pressed(false));
    take(&mut branch, &stop, second(21), &stopped(false));
    assert_eq!(branch.read(RunTag::FIRST).len(), shared);
    take(&mut branch, &planner, second(22), &driving(2));
    take(&mut branch, &bumper, second(22), &pressed(true));
    take(&mut branch, &stop, second(22), &stopped(true));
    let found = texts(&branch.read(RunTag::FIRST));
    let wanted = ["errors 2 inputs not used: ", "bumper bumper hit, left", "operator emergency stop"];
    assert_eq!(found[shared..], wanted);
}

#[test]
fn a_branch_has_no_act_that_was_undone_and_the_next_one_is_an_event_again() {
    let now = Stamp(5_000_000_000);
    let [commands, stop, journal]: [Arc<str>; 3] =
        ["/planner/command", "/stop", "/runtime/journal"].map(Into::into);
    let command = |serial, name: &str| {
        AnyMessage::new(rcs::Command { serial, name: name.into(), ..rcs::Command::default() })
    };
    let stopped = AnyMessage::new(rcs::EmergencyStop { active: true, ..rcs::EmergencyStop::default() });
    let drive = AnyMessage::new(rcs::JournalEvent {
        writer: acts::OPERATOR.into(),
        schema: "rcs.DriveCommand".into(),
        ..rcs::JournalEvent::default()
    });
    let mut parent = EventWatch::default();
    take(&mut parent, &commands, now, &command(1, "INIT"));
    // What follows is undone: all of it was written at the time of the branch.
    take(&mut parent, &commands, now, &command(2, "RUN"));
    take(&mut parent, &stop, now, &stopped);
    take(&mut parent, &journal, now, &drive);
    let mut branch = parent.fork(Written { time: now, messages: 1 });
    assert_eq!(texts(&branch.read(RunTag::FIRST)), ["commands INIT (1)"]);
    take(&mut branch, &commands, now, &command(2, "HALT"));
    take(&mut branch, &stop, now, &stopped);
    take(&mut branch, &journal, now, &drive);
    let wanted =
        ["commands INIT (1)", "commands HALT (2)", "operator emergency stop", "operator drives by hand"];
    assert_eq!(texts(&branch.read(RunTag::FIRST)), wanted);
    assert_eq!(parent.read(RunTag::FIRST).len(), 4);
    // A branch of the branch.
    let next = branch.fork(Written { time: now, messages: 2 });
    assert_eq!(texts(&next.read(RunTag::FIRST)), wanted[..2]);
}

#[test]
fn an_alarm_is_found_behind_any_number_of_warnings() {
    let event = |second: u64, level| Event {
        stamp: Stamp(second * 1_000_000_000),
        kind: EventKind::Error,
        level,
        source: "planner".into(),
        text: "".into(),
    };
    let warnings = (2..14).map(|second| event(second, EventLevel::Warning));
    let events = Events::of(RunTag::FIRST, [event(1, EventLevel::Error)].into_iter().chain(warnings));
    let found = |until: u64| events.last_alarms(Stamp(until * 1_000_000_000), 12);
    assert_eq!(found(13), [event(1, EventLevel::Error)]);
    assert!(found(0).is_empty());
}

#[test]
fn each_type_in_which_events_are_found_has_a_kind_and_the_other_way_round() {
    for name in EVENT_TYPES {
        assert!(EventKind::ALL.iter().any(|kind| kind.is_found_in(name)), "{name}");
    }
    let found = |kind: &EventKind| EVENT_TYPES.iter().any(|name| kind.is_found_in(name));
    assert!(EventKind::ALL.iter().all(found));
    assert!(!EventKind::ALL.iter().any(|kind| kind.is_found_in("foxglove.Grid")));
}

#[test]
fn an_operator_who_drives_is_one_event_until_a_pause() {
    let mut watch = EventWatch::default();
    let journal: Arc<str> = "/runtime/journal".into();
    for tenth in [0, 1, 2, 3, 40, 41] {
        let event = rcs::JournalEvent {
            writer: acts::OPERATOR.into(),
            buffer: "/operator/drive".into(),
            schema: "rcs.DriveCommand".into(),
            ..rcs::JournalEvent::default()
        };
        take(&mut watch, &journal, Stamp(tenth * 100_000_000), &AnyMessage::new(event));
    }
    assert_eq!(watch.read(RunTag::FIRST).len(), 2);
}

/// The journal's event of a message that the operator writes.
fn written(buffer: &str, message: &AnyMessage) -> AnyMessage {
    AnyMessage::new(rcs::JournalEvent {
        writer: acts::OPERATOR.into(),
        buffer: buffer.into(),
        schema: message.schema().name().to_owned(),
        message: message.bytes(),
        ..rcs::JournalEvent::default()
    })
}

fn limit(max_speed_mps: f64) -> AnyMessage {
    AnyMessage::new(rcs::SpeedLimit { max_speed_mps })
}

/// What a run says at its start: a vehicle with an input for teleoperation, and the parameters with which it begins.
fn describe(watch: &mut EventWatch) {
    let run = rcs::RunInfo {
        params: vec![rcs::InitialParams {
            process: "vehicle".into(),
            params: limit(0.5).bytes(),
            ..rcs::InitialParams::default()
        }],
        ..rcs::RunInfo::default()
    };
    let teleop = rcs::PortInfo {
        buffer: "/operator/teleop".into(),
        role: crate::role::InputRole::Teleoperation.name().into(),
        ..rcs::PortInfo::default()
    };
    let process = rcs::ProcessInfo {
        name: "vehicle".into(),
        params_buffer: "/vehicle/params".into(),
        inputs: vec![teleop],
        ..rcs::ProcessInfo::default()
    };
    take(watch, &"/runtime/run".into(), Stamp(0), &AnyMessage::new(run));
    take(watch, &"/runtime/processes".into(), Stamp(0), &AnyMessage::new(process));
}

#[test]
fn only_a_message_for_the_input_of_teleoperation_drives_by_hand_and_edits_are_told_beside_it() {
    let mut watch = EventWatch::default();
    describe(&mut watch);
    let drive = |speed_mps: f64| {
        let timestamp = Some(Stamp(7_000_000_001).to_proto());
        AnyMessage::new(rcs::DriveCommand { timestamp, speed_mps, ..rcs::DriveCommand::default() })
    };
    let journal: Arc<str> = "/runtime/journal".into();
    for (tenth, buffer, speed_mps) in [
        (10, "/driver/drive", 100_000.0),
        (11, "/operator/teleop", 0.5),
        (12, "/operator/teleop", 0.6),
        (13, "/driver/drive", 2.5),
    ] {
        take(&mut watch, &journal, Stamp(tenth * 100_000_000), &written(buffer, &drive(speed_mps)));
    }
    // A message with many values is told by its type.
    let pose = AnyMessage::new(foxglove::Quaternion { x: 1.0, ..foxglove::Quaternion::default() });
    take(&mut watch, &journal, Stamp(2_000_000_000), &written("/pose", &pose));
    let wanted = [
        "operator writes heading_rad = 0, speed_mps = 100000",
        "operator drives by hand",
        "operator writes heading_rad = 0, speed_mps = 2.5",
        "operator writes Quaternion",
    ];
    assert_eq!(texts(&watch.read(RunTag::FIRST)), wanted);
}

#[test]
fn parameters_are_told_by_what_they_change_also_in_a_branch() {
    let mut watch = EventWatch::default();
    describe(&mut watch);
    let journal: Arc<str> = "/runtime/journal".into();
    let send = |watch: &mut EventWatch, second: u64, max_speed_mps: f64| {
        let event = written("/vehicle/params", &limit(max_speed_mps));
        take(watch, &journal, Stamp(second * 1_000_000_000), &event);
    };
    send(&mut watch, 1, 2.0);
    let mut branch = watch.fork(Written { time: Stamp(1_500_000_000), messages: watch.messages });
    send(&mut watch, 2, 3.0);
    send(&mut watch, 3, 3.0);
    let first = "operator changes max_speed_mps from 0.5 to 2";
    let wanted =
        [first, "operator changes max_speed_mps from 2 to 3", "operator writes SpeedLimit without a change"];
    assert_eq!(texts(&watch.read(RunTag::FIRST)), wanted);
    send(&mut branch, 4, 1.0);
    let wanted = [first, "operator changes max_speed_mps from 2 to 1"];
    assert_eq!(texts(&branch.read(RunTag::FIRST)), wanted);
}

#[test]
fn of_many_changed_parameters_the_first_are_told_and_how_many_follow() {
    let mut watch = EventWatch::default();
    let params = |value: f64| {
        let point = foxglove::Vector3 { x: value, y: value, z: value };
        let turn = foxglove::Quaternion { x: value, y: value, z: value, w: 1.0 };
        AnyMessage::new(foxglove::Pose { position: Some(point), orientation: Some(turn) })
    };
    let process = rcs::ProcessInfo { params_buffer: "/a/params".into(), ..rcs::ProcessInfo::default() };
    take(&mut watch, &"/runtime/processes".into(), Stamp(0), &AnyMessage::new(process));
    let journal: Arc<str> = "/runtime/journal".into();
    for (second, value) in [(1, 0.0), (2, 1.5)] {
        take(&mut watch, &journal, Stamp(second * 1_000_000_000), &written("/a/params", &params(value)));
    }
    let told = ["x", "y", "z"].map(|axis| format!("position.{axis} from 0 to 1.5")).join(", ");
    let wanted = ["operator writes Pose".to_owned(), format!("operator changes {told} and 3 more")];
    assert_eq!(texts(&watch.read(RunTag::FIRST)), wanted);
}

#[test]
fn an_override_is_told_with_its_field_and_value() {
    let told = |mode: Mode, path: &str, id| {
        acts::overridden(&rcs::Override {
            buffer: "/imu".to_owned(),
            path: path.to_owned(),
            mode: mode.into(),
            value_json: "5".to_owned(),
            id,
            ..rcs::Override::default()
        })
    };
    assert_eq!(told(Mode::Hold, ".x", 0), "holds /imu.x = 5");
    assert_eq!(told(Mode::Once, "", 0), "writes /imu = a whole message into the next message");
    assert_eq!(told(Mode::Release, ".x", 0), "releases /imu.x");
    assert_eq!(told(Mode::Release, "", 3), "releases override 3");
}

#[test]
fn events_are_found_by_time_by_kind_and_between_times() {
    let event = |second: u64, kind| Event {
        stamp: Stamp(second * 1_000_000_000),
        kind,
        level: EventLevel::Info,
        source: "a".into(),
        text: format!("{second}").into(),
    };
    let kinds = [EventKind::Mode, EventKind::Error];
    let events = Events::of(RunTag::FIRST, (0..100).map(|i| event(i, kinds[(i % 2) as usize])));
    assert_eq!(events.counts()[EventKind::Mode as usize], 50);
    assert_eq!(events.count_until(Stamp(9_500_000_000)), 10);
    let next = |at: u64, back| {
        events
            .beside(Stamp(at * 1_000_000_000), back, &[EventKind::Error])
            .map(|event| event.text.to_string())
    };
    assert_eq!((next(3, false).as_deref(), next(3, true).as_deref()), (Some("5"), Some("1")));
    assert_eq!((next(99, false), next(0, true)), (None, None));
    let times: Vec<Stamp> = (0..=10).map(|i| Stamp(i * 10_000_000_000)).collect();
    let at_the_start = events.between(EventKind::Mode, &times[..2]);
    assert_eq!(at_the_start[0].as_ref().map(|event| event.stamp), Some(Stamp(0)));
    let found = events.between(EventKind::Error, &times);
    let first: Vec<_> =
        found.iter().map(|event| event.as_ref().map(|event| event.text.to_string())).collect();
    let reference: Vec<_> = (0..10).map(|i| Some(format!("{}", i * 10 + 1))).collect();
    assert_eq!(first, reference);
}
