//! At the goal: where it is believed to be, where an earlier run found it, and what leads there.

use super::{FILES, cycle, drive, free, global_at, path, polygon, start, status, story, transform};
use rcs_geom::{DVec2, Pose};
use rcs_msg::foxglove::{FrameTransform, FrameTransforms, PoseInFrame, PosesInFrame, Quaternion, Vector3};
use rcs_msg::rcs::{Mission, ProcessState};
use rcs_msg::{Stamp, rcs};
use rcs_sense::pose_message;
use rcs_testkit::bench::Bench;

/// A route of an earlier run, which ends 0.5 m west of the goal, heading east.
pub(super) const ROUTE: &str = r#"{
    "format": 1,
    "zone": 18,
    "points": [
        {"eastingM": 300002.0, "northingM": 4000003.0},
        {"eastingM": 300010.0, "northingM": 4000003.0},
        {"eastingM": 300011.5, "northingM": 4000003.0}
    ]
}"#;

#[test]
fn it_looks_for_a_goal_that_may_lie_elsewhere_and_then_stands_there() {
    let mut bench = start(&[FILES[0], FILES[1], ("generator.found_within_m", "1.2")]);
    cycle(&mut bench, 0.0, 0.0, free, 12);
    // 0.2 m before the goal.
    bench.write("/operator/global", global_at(11.8));
    cycle(&mut bench, 9.8, 0.0, free, 6);
    assert!(drive(&bench).0 > 0.1, "the first place lies ahead: {}", story(&bench));
    let (state, text) = status(&bench, "generator");
    assert!(state == ProcessState::Exec && text.contains("looks for it: place 1"), "{text}");
    // It does not get to the places: after 8 s each it goes on, and in the end it is told the goal again, where it is.
    let mut places = 0;
    while status(&bench, "generator").1.contains("looks for it") {
        places += 1;
        assert!(places < 40, "{}", story(&bench));
        cycle(&mut bench, 9.8, 0.0, free, 8 * 20 + 2);
    }
    assert!(places > 4, "{places}");
    cycle(&mut bench, 9.8, 0.0, free, 10);
    assert_eq!(drive(&bench), (0.0, 0.0));
    let (state, text) = status(&bench, "generator");
    assert!(state == ProcessState::Done && text.starts_with("at the goal"), "{text}");
}

#[test]
fn while_the_vehicle_is_held_or_driven_by_hand_the_search_gives_up_no_place() {
    let held = |stop_reason: &str| rcs::VehicleStatus {
        stopped: true,
        stop_reason: stop_reason.to_owned(),
        ..rcs::VehicleStatus::default()
    };
    for status_of_vehicle in [
        rcs::VehicleStatus { emergency_stopped: true, ..held("emergency stop: a person") },
        held("imu silent for 1.0 s, expected at most 0.5 s"),
        held("the speed limit is 0 m/s"),
        rcs::VehicleStatus { teleoperated: true, ..rcs::VehicleStatus::default() },
    ] {
        let mut bench = start(&[FILES[0], FILES[1], ("generator.found_within_m", "1.2")]);
        cycle(&mut bench, 0.0, 0.0, free, 12);
        bench.write("/operator/global", global_at(11.8));
        cycle(&mut bench, 9.8, 0.0, free, 6);
        bench.write("/operator/vehicle", status_of_vehicle.clone());
        cycle(&mut bench, 9.8, 0.0, free, 8 * 20 + 12);
        let (_, text) = status(&bench, "generator");
        assert!(text.contains("looks for it: place 1"), "{status_of_vehicle:?}: {text}");
        bench.write("/operator/vehicle", rcs::VehicleStatus::default());
        cycle(&mut bench, 9.8, 0.0, free, 8 * 20 + 2);
        let (_, text) = status(&bench, "generator");
        assert!(text.contains("looks for it: place 2"), "{status_of_vehicle:?}: {text}");
    }
}

#[test]
fn under_a_speed_limit_the_search_takes_its_time_for_each_place() {
    let mut bench = start(&[FILES[0], FILES[1], ("generator.found_within_m", "1.2")]);
    let limited = rcs::VehicleStatus { max_speed_mps: 0.2, ..rcs::VehicleStatus::default() };
    bench.write("/operator/vehicle", limited);
    cycle(&mut bench, 0.0, 0.0, free, 12);
    bench.write("/operator/global", global_at(11.8));
    // A fifth of the usual speed: five times 8 s.
    for (cycles, place) in [(6 + 8 * 20 + 12, 1), (32 * 20, 2)] {
        cycle(&mut bench, 9.8, 0.0, free, cycles);
        let (_, text) = status(&bench, "generator");
        assert!(text.contains(&format!("looks for it: place {place}")), "{text}, expected place {place}");
    }
}

#[test]
fn a_zone_where_the_search_drives_to_sends_it_elsewhere() {
    let mut bench = start(&[FILES[0], FILES[1], ("generator.found_within_m", "1.2")]);
    cycle(&mut bench, 0.0, 0.0, free, 12);
    bench.write("/operator/global", global_at(11.8));
    cycle(&mut bench, 9.8, 0.0, free, 6);
    assert!(drive(&bench).0 > 0.1, "the first place lies ahead: {}", story(&bench));
    let zone = polygon(&[(10.4, -9.0), (19.0, -9.0), (19.0, 9.0), (10.4, 9.0)]);
    let (frame_id, keep_out) = ("local".to_owned(), vec![zone]);
    let mission = Mission { frame_id, keep_out, keeps_goals: true, ..Mission::default() };
    bench.write("/operator/mission", mission);
    cycle(&mut bench, 9.8, 0.0, free, 12);
    let (_, text) = status(&bench, "generator");
    assert!(text.contains("looks for it"), "{text}; {}", story(&bench));
    assert_eq!(bench.latest::<Mission>("/generator/driven").keep_out.len(), 1, "{}", story(&bench));
}

#[test]
fn a_goal_that_lies_just_beyond_the_point_to_which_a_far_planner_has_led_is_driven_to() {
    let mut bench = start(&[FILES[0], FILES[1], ("generator.found_within_m", "1.2")]);
    lead(&mut bench, 10.0);
    // 5 m along the far path lie 0.4 m before the goal, which is 10 m east in the local frame.
    bench.write("/operator/global", global_at(6.6));
    cycle(&mut bench, 4.6, 0.0, free, 12);
    let led = bench.latest::<PosesInFrame>("/planner/path").poses.last().unwrap().position.unwrap();
    assert!((led.x - 9.6).abs() < 0.15, "{led:?}");
    bench.write("/operator/global", global_at(11.7));
    cycle(&mut bench, 9.7, 0.0, free, 12);
    let (state, text) = status(&bench, "generator");
    assert!(state == ProcessState::Exec && text.contains("looks for it"), "{text}; {}", story(&bench));
    assert!(drive(&bench).0 > 0.1, "{}", story(&bench));
}

#[test]
fn however_far_from_the_goal_the_vehicle_may_stop_it_drives_on_where_a_far_planner_leads() {
    let mut bench = start(&[FILES[0], FILES[1], ("planner.goal_radius_m", "6")]);
    bench.write("/operator/global", global_at(2.0));
    lead(&mut bench, 10.0);
    cycle(&mut bench, 0.0, 0.0, free, 12);
    assert!((path(&bench).last().unwrap().x - 5.0).abs() < 0.3, "{}", story(&bench));
    assert!(drive(&bench).0 > 0.5, "{}", story(&bench));
    bench.write("/operator/global", global_at(7.5));
    cycle(&mut bench, 5.5, 0.0, free, 6);
    assert_eq!(status(&bench, "generator"), (ProcessState::Done, "at the goal".to_owned()));
}

/// A far planner leads from the start straight to a place east of it, m.
pub(super) fn lead(bench: &mut Bench, to_m: f64) {
    let count = (to_m / 0.2).round() as u32;
    let pose = |at: u32| pose_message(&Pose::from_xy_yaw(f64::from(at) * 0.2, 0.0, 0.0));
    let poses = (0..=count).map(pose).collect();
    let path = PosesInFrame { frame_id: "local".to_owned(), poses, ..PosesInFrame::default() };
    bench.write("/operator/far_path", path);
}

/// Says where the global frame of the earlier run lies in the local frame, m; `None` while the map is not registered.
pub(super) fn register(bench: &mut Bench, moved: Option<DVec2>) {
    let transform = |at: DVec2| FrameTransform {
        parent_frame_id: "local".to_owned(),
        child_frame_id: "remembered".to_owned(),
        translation: Some(Vector3 { x: at.x, y: at.y, z: 0.0 }),
        rotation: Some(Quaternion { w: 1.0, ..Quaternion::default() }),
        ..FrameTransform::default()
    };
    bench.write(
        "/operator/registration",
        FrameTransforms { transforms: moved.map(transform).into_iter().collect() },
    );
}

/// The parameters of a run that is handed a route, and told that the goal is reached within this distance, m.
pub(super) fn found_before(found_within_m: &str) -> [(&str, &str); 4] {
    [FILES[0], FILES[1], ("generator.route", "r"), ("generator.found_within_m", found_within_m)]
}

#[test]
fn the_goal_lies_where_the_run_before_found_it_while_its_map_is_registered() {
    let mut bench = start(&found_before("1.2"));
    let target = |bench: &Bench| {
        let waypoints: PosesInFrame = bench.latest("/generator/waypoints");
        let last = waypoints.poses.last().unwrap().position.unwrap();
        DVec2::new(last.x, last.y)
    };
    cycle(&mut bench, 0.0, 0.0, free, 12);
    assert!(target(&bench).distance(DVec2::new(10.0, 0.0)) < 0.3, "{}", target(&bench));
    // That run's position estimate was 1.5 m farther south than that of this one: the goal is taken to be between both.
    register(&mut bench, Some(DVec2::new(-2.0, -1.5)));
    cycle(&mut bench, 0.0, 0.0, free, 12);
    assert!(target(&bench).distance(DVec2::new(10.14, 0.83)) < 0.3, "{}", target(&bench));
    register(&mut bench, None);
    cycle(&mut bench, 0.0, 0.0, free, 12);
    assert!(target(&bench).distance(DVec2::new(10.0, 0.0)) < 0.3, "{}", target(&bench));
    // 3.5 m beside the goal, what was found there is not believed.
    register(&mut bench, Some(DVec2::new(-2.0, 0.5)));
    cycle(&mut bench, 0.0, 0.0, free, 12);
    assert!(target(&bench).distance(DVec2::new(10.0, 0.0)) < 0.3, "{}", target(&bench));
}

#[test]
fn a_goal_that_nobody_says_to_be_reached_stays_where_it_was_stated() {
    // By its registered map, the run before found the goal 1 m east of where it is stated.
    let ends = |found_within_m: &str| {
        let mut bench = start(&found_before(found_within_m));
        register(&mut bench, Some(DVec2::new(-1.25, -3.0)));
        cycle(&mut bench, 0.0, 0.0, free, 12);
        let goal: PoseInFrame = bench.latest("/generator/goal");
        goal.pose.unwrap().position.unwrap().x
    };
    assert!((ends("0") - 10.0).abs() < 1e-6, "{}", ends("0"));
    assert!((ends("1.2") - 10.55).abs() < 1e-6, "{}", ends("1.2"));
}

#[test]
fn where_the_run_before_found_the_goal_is_not_driven_to_if_that_is_in_a_zone() {
    let mut bench = start(&found_before("1.2"));
    register(&mut bench, Some(DVec2::new(-2.0, -1.5)));
    let zone = polygon(&[(7.0, 0.65), (13.0, 0.65), (13.0, 3.0), (7.0, 3.0)]);
    let (frame_id, keep_out) = ("local".to_owned(), vec![zone]);
    let mission = Mission { frame_id, keep_out, keeps_goals: true, ..Mission::default() };
    bench.write("/operator/mission", mission);
    cycle(&mut bench, 0.0, 0.0, free, 12);
    assert!(drive(&bench).0 > 0.2, "{}", story(&bench));
    let end = *path(&bench).last().unwrap();
    assert!(end.distance(DVec2::new(10.0, 0.0)) < 0.3, "{end}");
}

#[test]
fn a_correction_of_the_heading_is_no_jump_however_far_the_goal_moves() {
    let mut bench = start(&FILES);
    bench.write("/operator/global", global_at(2.0));
    cycle(&mut bench, 0.0, 0.0, free, 12);
    // About the vehicle: the goal, 10 m away, moves by 5.9 m.
    let turned = 0.6;
    let (w, z) = (libm::cos(turned / 2.0), libm::sin(turned / 2.0));
    let now = Some(Stamp(bench.now_ms * 1_000_000 + 1).to_proto());
    let rotation = Some(Quaternion { w, z, ..Quaternion::default() });
    let placed = transform("global", "local", DVec2::new(2.0, 3.0));
    let transform = FrameTransform { timestamp: now, rotation, ..placed };
    bench.write("/operator/transforms", FrameTransforms { transforms: vec![transform] });
    cycle(&mut bench, 0.0, 0.0, free, 12);
    assert_ne!(drive(&bench), (0.0, 0.0), "{}", story(&bench));
    let goal = DVec2::new(10.0 * libm::cos(turned), -10.0 * libm::sin(turned));
    assert!(path(&bench).last().unwrap().distance(goal) < 0.3, "{}", story(&bench));
}

#[test]
fn a_far_path_without_the_vehicles_position_on_it_is_told_to_be_of_no_use() {
    let mut bench = start(&FILES[..2]);
    lead(&mut bench, 10.0);
    cycle(&mut bench, 0.0, 0.0, free, 12);
    assert!(status(&bench, "generator").1.contains("no pose of the vehicle has come at the input global"));
    assert!(path(&bench).last().unwrap().distance(DVec2::new(10.0, 0.0)) < 0.3, "{}", story(&bench));
}

#[test]
fn a_far_planner_that_sends_nothing_any_more_leads_nowhere() {
    let mut bench = start(&FILES[..2]);
    bench.write("/operator/global", global_at(2.0));
    lead(&mut bench, 9.0);
    cycle(&mut bench, 0.0, 0.0, free, 12);
    assert!((path(&bench).last().unwrap().x - 5.0).abs() < 0.3, "{}", story(&bench));
    cycle(&mut bench, 0.0, 0.0, free, 100);
    assert!((path(&bench).last().unwrap().x - 10.0).abs() < 0.3, "{}", story(&bench));
}

#[test]
fn where_the_near_planner_goes_around_a_narrow_way_of_the_far_path_it_is_led_to_a_nearer_place() {
    // The end of the path, and its greatest distance from the far path, which leads along x between walls 1 m apart.
    let led = |walls: u8, cycles: usize| {
        let corridor = |at: DVec2| match at.y.abs() {
            beside_m if !(2.0..6.0).contains(&at.x) || beside_m > 1.5 => 0,
            beside_m if beside_m > 0.5 => walls,
            _ => 0,
        };
        let mut bench = start(&FILES[..2]);
        bench.write("/operator/global", global_at(2.0));
        lead(&mut bench, 9.0);
        cycle(&mut bench, 0.0, 0.0, corridor, cycles);
        let path = path(&bench);
        (path.last().unwrap().x, path.iter().map(|at| at.y.abs()).fold(0.0, f64::max))
    };
    let (to_m, beside_m) = led(0, 12);
    assert!((to_m - 5.0).abs() < 0.3 && beside_m < 0.3, "{to_m} {beside_m}");
    let (to_m, beside_m) = led(250, 12);
    assert!((to_m - 2.7).abs() < 0.3 && beside_m < 0.3, "a narrow way: {to_m} {beside_m}");
    // After 3 s it tries again, and at once goes back to the nearer place.
    let (to_m, beside_m) = led(250, 80);
    assert!((to_m - 2.7).abs() < 0.3 && beside_m < 0.3, "{to_m} {beside_m}");
}
