//! What the drive view says of the vehicle and its course.

use super::{Shown, harness};
use crate::operator::Hand;
use crate::samples;
use egui::{Shape, Theme, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable as _;
use rcs_msg::foxglove::{Odometry, Pose, Vector3};
use rcs_msg::rcs::{CourseOutcome, CourseRun, EmergencyStop, Mission, PlanePoint, VehicleStatus};
use rcs_runtime::source::{Frame, Topic};
use std::sync::Arc;

fn drive(frame: Frame) -> Harness<'static, Shown> {
    let mut harness = harness(Shown::new("drive", frame), Vec2::new(900.0, 560.0), Theme::Dark);
    harness.run();
    harness
}

#[test]
fn the_drive_view_says_how_the_vehicle_and_the_course_stand() {
    let harness = drive(samples::driving());
    for text in ["FREE TO MOVE", "RUNNING", "meadow", "you"] {
        assert!(harness.query_by_label(text).is_some(), "{text}");
    }
    for text in ["0:42.3 of 4:00.0", "63.9 m", "expected at most 1.3", "Esc to keep it standing"] {
        assert!(harness.query_by_label_contains(text).is_some(), "{text}");
    }
}

#[test]
fn who_drives_is_told_beside_the_state_of_the_vehicle() {
    for width in [360.0, 900.0] {
        let shown = Shown::new("drive", samples::driving());
        let mut harness = harness(shown, Vec2::new(width, 560.0), Theme::Dark);
        harness.run();
        let (state, who) = (harness.get_by_label("FREE TO MOVE").rect(), harness.get_by_label("you").rect());
        assert!(who.left() > state.right(), "{width}: {state:?} {who:?}");
        assert!((who.center().y - state.center().y).abs() < 4.0, "{width}: {state:?} {who:?}");
    }
}

#[test]
fn a_speed_a_turn_rate_and_an_attitude_that_no_sensor_tells_are_dashes() {
    let mut frame = samples::driving();
    let status = VehicleStatus {
        speed_mps: f64::NAN,
        yaw_rate_radps: f64::NAN,
        roll_rad: f64::NAN,
        pitch_rad: f64::NAN,
        ..VehicleStatus::default()
    };
    let vehicle = samples::topic("/vehicle_interface/vehicle", 50.0, 0.02, status);
    let others = frame.topics.iter().filter(|topic| topic.name != vehicle.name).cloned();
    frame.topics = others.chain([vehicle.clone()]).collect();
    let harness = drive(frame);
    for text in ["– m/s", "– °/s"] {
        assert!(harness.query_by_label_contains(text).is_some(), "{text}");
    }
    assert_eq!(harness.query_all_by_label_contains("– °").count(), 3, "turn, roll and pitch");
}

#[test]
fn in_a_narrow_view_the_speed_keeps_its_unit() {
    // The motion below the controls, beside them with too little room for the usual columns, and with enough of it.
    for width in [220.0, 400.0, 480.0] {
        let shown = Shown::new("drive", samples::driving());
        let mut harness = harness(shown, Vec2::new(width, 900.0), Theme::Dark);
        harness.run();
        let whole = harness.output().shapes.iter().any(|painted| {
            let Shape::Text(text) = &painted.shape else { return false };
            let is_speed = text.galley.text().contains("0.94 m/s");
            let end = text.pos.x + text.galley.size().x;
            is_speed && !text.galley.elided && end <= painted.clip_rect.right()
        });
        assert!(whole, "{width}");
    }
}

/// A drive with another newest message of one of its topics.
fn driving_with(topic: Topic) -> Frame {
    let mut frame = samples::driving();
    let mut topics = frame.topics.to_vec();
    topics.retain(|other| other.name != topic.name);
    topics.push(topic);
    frame.topics = topics.into();
    frame
}

/// A topic with a role.
fn with_role(mut topic: Topic, role: &str) -> Topic {
    topic.metadata = Arc::new([("rcs.role".to_owned(), role.to_owned())].into());
    topic
}

/// Whether a text with this content is painted.
fn is_painted(harness: &Harness<'static, Shown>, content: &str) -> bool {
    let is_it = |shape: &Shape| matches!(shape, Shape::Text(text) if text.galley.text() == content);
    harness.output().shapes.iter().any(|painted| is_it(&painted.shape))
}

#[test]
fn a_stack_that_drives_on_after_the_goal_is_reached_still_looks_for_it() {
    let reached = |wanted_speed_mps: f64| {
        let run = CourseRun { outcome: CourseOutcome::CourseReached.into(), ..CourseRun::default() };
        let status = VehicleStatus { wanted_speed_mps, ..VehicleStatus::default() };
        let vehicle = samples::topic("/vehicle_interface/vehicle", 50.0, 0.02, status);
        let mut frame = driving_with(samples::topic("/vehicle/run", 5.0, 0.1, run));
        let mut topics = frame.topics.to_vec();
        topics.retain(|topic| topic.name != vehicle.name && &*topic.name != "/generator/driven");
        topics.push(vehicle);
        frame.topics = topics.into();
        drive(frame)
    };
    for (wanted_speed_mps, is_told) in [(0.5, true), (0.0, false)] {
        let harness = reached(wanted_speed_mps);
        assert!(harness.query_by_label("GOAL REACHED").is_some());
        let told = harness.query_by_label_contains("The stack still looks for it").is_some();
        assert_eq!(told, is_told, "{wanted_speed_mps} m/s");
    }
}

#[test]
fn while_a_mission_is_driven_its_next_goal_is_told_apart_from_that_of_the_course() {
    // The next goal of the mission is at (9, 4) in the frame `local`.
    let at = |frame_id: &str| {
        let position = Some(Vector3 { x: 9.0, y: 1.5, z: 0.0 });
        let pose = Some(Pose { position, orientation: None });
        let odometry = Odometry { frame_id: frame_id.to_owned(), pose, ..Odometry::default() };
        drive(driving_with(with_role(samples::topic("/localization/pose", 50.0, 0.01, odometry), "pose")))
    };
    let harness = at("local");
    assert!(is_painted(&harness, "Course goal") && !is_painted(&harness, "To the goal"));
    assert!(is_painted(&harness, "Next goal") && harness.query_by_label_contains("2.5 m").is_some());
    assert!(!is_painted(&at("global"), "Next goal"), "the position is not known in the frame of the mission");

    let goals = vec![PlanePoint { x_m: 1.0, y_m: 0.0 }];
    let mission = |goals| Mission { frame_id: "local".to_owned(), goals, ..Mission::default() };
    let stated = |mission: Mission| {
        drive(driving_with(with_role(samples::topic("/generator/driven", 0.1, 5.0, mission), "mission")))
    };
    assert!(stated(mission(goals)).query_by_label("0 of 1 goal reached").is_some());
    assert!(is_painted(&stated(mission(Vec::new())), "To the goal"));
}

/// The status of a vehicle that obeys an emergency stop, with its age.
fn obeyed(age_s: f64) -> Topic {
    let status = VehicleStatus { emergency_stopped: true, ..VehicleStatus::default() };
    samples::topic("/vehicle_interface/vehicle", 50.0, age_s, status)
}

#[test]
fn a_drag_of_one_slider_stays_its_own_although_a_note_above_it_comes_or_goes() {
    for [first, then] in
        [[samples::driving(), driving_with(obeyed(0.02))], [driving_with(obeyed(0.02)), samples::driving()]]
    {
        let mut harness = drive(first);
        let before = harness.state().selection.drive;
        let at = harness.get_by_label("Turn of a full push").rect();
        harness.drag_at(at.left_center() + Vec2::new(20.0, 0.0));
        harness.step();
        harness.state_mut().frame = then;
        harness.step();
        harness.hover_at(at.left_center() + Vec2::new(2.0, 0.0));
        harness.step();
        let after = harness.state().selection.drive;
        assert_eq!(after.speed_mps, before.speed_mps);
        assert_ne!(after.turn_radps, before.turn_radps);
    }
}

/// The drive view of a stopped vehicle tells this, and none of its buttons drives.
fn check_stopped(frame: Frame, can_release: bool, told: &str) {
    let mut shown = Shown::new("drive", frame);
    shown.selection.let_go_first = true;
    shown.selection.can_release = can_release;
    let mut harness = harness(shown, Vec2::new(900.0, 560.0), Theme::Dark);
    harness.run();
    for text in [
        "press Release",
        "not confirmed it.",
        "not confirmed its release",
        "from here",
        "Let go of the controls",
        "Hold W A S D",
    ] {
        assert_eq!(harness.query_by_label_contains(text).is_some(), text == told, "{text}");
    }
    let at = harness.get_by_label("Turn left").rect().center();
    harness.drag_at(at);
    harness.run();
    assert_eq!(harness.state().selection.hand, Hand::default());
}

#[test]
fn while_the_vehicle_obeys_an_emergency_stop_its_release_is_offered_and_no_button_drives() {
    check_stopped(driving_with(obeyed(0.02)), true, "press Release");
}

#[test]
fn an_emergency_stop_that_cannot_be_released_offers_no_release_and_no_button_drives() {
    let sent = |active: bool| {
        let stop = EmergencyStop { active, ..EmergencyStop::default() };
        samples::topic("/operator/emergency_stop", 0.0, 0.02, stop)
    };
    for unconfirmed in [sent(true), obeyed(3.0)] {
        check_stopped(driving_with(unconfirmed), false, "not confirmed it.");
    }
    let mut released = driving_with(obeyed(0.02));
    released.topics = released.topics.iter().cloned().chain([sent(false)]).collect();
    check_stopped(released, false, "not confirmed its release");
    let mut frame = driving_with(obeyed(0.02));
    let mut processes = frame.processes.to_vec();
    for process in &mut processes {
        process.inputs.retain(|input| input.role != "emergency_stop");
    }
    frame.processes = processes.into();
    check_stopped(frame, false, "from here");
}
