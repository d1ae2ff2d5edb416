//! The modes of the table for the LAGR robot: when each begins and ends, and how the vehicle is driven meanwhile.

use super::{FILES, cycle, cycle_at, drive, free, ring, start, status, story};
use rcs_geom::{DVec2, Pose};
use rcs_msg::foxglove::PosesInFrame;
use rcs_msg::rcs;
use rcs_msg::rcs::{ArcChoice, PlanState, ProcessState};
use rcs_planner::WaypointFollower;
use rcs_planner::proto::{ModeEvent, TerrainCosts, WaypointFollowerParams};
use rcs_runtime::Process;
use rcs_testkit::bench::Bench;

pub(crate) fn mode(bench: &Bench) -> (String, String) {
    let event: Option<ModeEvent> = bench.newest("/follower/modes");
    event.map_or_else(Default::default, |event| (event.to, event.reason))
}

#[test]
fn after_a_bumper_hit_it_backs_up_and_goes_on() {
    let mut bench = start(&FILES);
    cycle(&mut bench, 0.0, 0.0, free, 12);
    bench.write("/operator/bumper", rcs::Bumper { left: true, ..rcs::Bumper::default() });
    cycle(&mut bench, 0.0, 0.0, free, 2);
    assert!(drive(&bench).0 < 0.0, "{}", story(&bench));
    bench.write("/operator/bumper", rcs::Bumper::default());
    cycle(&mut bench, -0.6, 0.0, free, 2);
    assert!(drive(&bench).0 > 0.5, "{}", story(&bench));
}

#[test]
fn a_bumper_that_was_hit_while_it_stood_without_a_pose_and_is_still_pressed_counts() {
    let mut bench = start(&FILES);
    cycle(&mut bench, 0.0, 0.0, free, 12);
    bench.cycles(50, 30);
    bench.write("/operator/bumper", rcs::Bumper { left: true, ..rcs::Bumper::default() });
    bench.cycles(50, 2);
    assert_eq!((mode(&bench).0.as_str(), drive(&bench)), ("", (0.0, 0.0)), "{}", story(&bench));
    cycle(&mut bench, 0.0, 0.0, free, 12);
    assert_eq!(mode(&bench).0, "REVERSE_FROM_BUMPER", "{}", story(&bench));
}

#[test]
fn without_a_way_it_is_aggressive_for_a_while_and_says_why() {
    let mut bench = start(&FILES);
    cycle(&mut bench, 0.0, 0.0, ring, 60);
    assert_eq!(drive(&bench), (0.0, 0.0), "{}", story(&bench));
    let (state, text) = status(&bench, "planner");
    assert!(state == ProcessState::Error && text.starts_with("no way to the goal"), "{text}");
    cycle(&mut bench, 0.0, 0.0, ring, 40);
    assert!(drive(&bench).0 > 0.2, "{}", story(&bench));
    let (name, reason) = mode(&bench);
    assert!(name == "AGGRESSIVE" && reason.starts_with("blocked_s is 4.0"), "{name}: {reason}");
    cycle(&mut bench, 3.2, 0.0, ring, 2);
    let (name, reason) = mode(&bench);
    assert!(name.is_empty() && reason.starts_with("moved_m is 3.2"), "{name}: {reason}");
}

#[test]
fn without_a_way_on_the_larger_map_it_is_aggressive_until_there_is_one_although_the_near_map_is_free() {
    let mut bench = start(&FILES);
    let far_plan = |bench: &mut Bench, state: PlanState| {
        bench.write("/operator/far_plan", rcs::Plan { state: state.into(), ..rcs::Plan::default() });
    };
    // It drives on at 0.2 m/s, so that it is not stuck.
    let mut x_m = 0.0;
    let mut go_on = |bench: &mut Bench, count: usize| {
        for _ in 0..count {
            x_m += 0.01;
            cycle(bench, x_m, 0.0, free, 1);
        }
    };
    go_on(&mut bench, 12);
    far_plan(&mut bench, PlanState::PlanForbidden);
    go_on(&mut bench, 240);
    assert_eq!(mode(&bench).0, "", "zones close it: {}", story(&bench));
    far_plan(&mut bench, PlanState::PlanNoWay);
    go_on(&mut bench, 220);
    assert_eq!(mode(&bench).0, "", "of a planner that is silent since: {}", story(&bench));
    for _ in 0..3 {
        far_plan(&mut bench, PlanState::PlanNoWay);
        go_on(&mut bench, 64);
    }
    assert_eq!(mode(&bench).0, "", "for less than 10 s: {}", story(&bench));
    far_plan(&mut bench, PlanState::PlanNoWay);
    go_on(&mut bench, 20);
    let (name, reason) = mode(&bench);
    assert!(name == "AGGRESSIVE_FAR" && reason.starts_with("far_blocked_s is 10.0"), "{name}: {reason}");
    assert!((0.1..=0.3).contains(&drive(&bench).0), "{}", story(&bench));
    far_plan(&mut bench, PlanState::PlanPath);
    go_on(&mut bench, 4);
    let (name, reason) = mode(&bench);
    assert!(name.is_empty() && reason.starts_with("far_blocked_s is 0.0"), "{name}: {reason}");
    assert!(drive(&bench).0 > 0.5, "{}", story(&bench));
}

#[test]
fn between_walls_it_is_slow_and_looks_closer_and_on_a_steep_slope_it_does_not_stop() {
    let mut bench = start(&FILES);
    let walls = |at: DVec2| if at.y.abs() > 0.6 { 250 } else { 0 };
    cycle(&mut bench, 0.0, 0.0, walls, 20);
    let (name, reason) = mode(&bench);
    assert!(name == "NARROW_CORRIDOR" && reason.starts_with("room_m is 0."), "{name}: {reason}");
    let arcs = |bench: &Bench| bench.latest::<ArcChoice>("/follower/arcs").arcs.len();
    let (speed_mps, closer) = (drive(&bench).0, arcs(&bench));
    assert!(speed_mps > 0.2 && speed_mps <= 0.9, "{speed_mps}; {}", story(&bench));
    // 12° up: it keeps at least 0.6 m/s, and the mode ends where the ground is level again.
    let uphill = Pose::from_rpy(rcs_geom::DVec3::ZERO, 0.0, -12_f64.to_radians(), 0.0);
    cycle_at(&mut bench, &uphill, walls, 20);
    let (name, reason) = mode(&bench);
    assert!(name == "HILL_CLIMB" && reason.starts_with("climb_deg is 12.0"), "{name}: {reason}");
    assert!(drive(&bench).0 >= 0.6, "{}", story(&bench));
    cycle(&mut bench, 0.0, 0.0, free, 30);
    assert_eq!(mode(&bench).0, "", "{}", story(&bench));
    assert!(drive(&bench).0 > 0.9 && arcs(&bench) < closer, "{closer} {}", story(&bench));
}

#[test]
fn when_its_wheels_slip_it_reverses_and_shakes_itself_free() {
    let mut bench = start(&FILES);
    cycle(&mut bench, 0.0, 0.0, free, 12);
    for _ in 0..36 {
        bench.write("/operator/slip", rcs::SlipReport { slip: 0.9, ..rcs::SlipReport::default() });
        cycle(&mut bench, 0.0, 0.0, free, 1);
    }
    assert!(drive(&bench).0 < -0.3, "{}", story(&bench));
    assert_eq!(mode(&bench).0, "SPINNING");
    let mut drives = Vec::new();
    for _ in 0..5 {
        cycle(&mut bench, 0.0, 0.0, free, 10);
        drives.push(drive(&bench));
    }
    drives.dedup();
    assert!(drives.len() >= 3, "{drives:?}");
}

/// Stands here with this slip for some cycles.
fn slips_at(bench: &mut Bench, pose: &Pose, slip: f64, count: usize) {
    for _ in 0..count {
        bench.write("/operator/slip", rcs::SlipReport { slip, ..rcs::SlipReport::default() });
        cycle_at(bench, pose, free, 1);
    }
}

#[test]
fn a_slip_of_a_half_is_driven_on_with_and_more_is_shaken_off_once_and_not_again_for_twelve_seconds() {
    let mut bench = start(&FILES);
    cycle(&mut bench, 0.0, 0.0, free, 12);
    slips_at(&mut bench, &Pose::IDENTITY, 0.5, 30);
    assert_eq!(mode(&bench).0, "", "it gets on: {}", story(&bench));
    let slip_at = |bench: &mut Bench, pose: &Pose, count: usize| slips_at(bench, pose, 0.65, count);
    slip_at(&mut bench, &Pose::IDENTITY, 15);
    assert_eq!(mode(&bench).0, "", "for less than 0.8 s: {}", story(&bench));
    slip_at(&mut bench, &Pose::IDENTITY, 5);
    let event: ModeEvent = bench.latest("/follower/modes");
    assert!(event.to == "SLIPPING" && event.reason.starts_with("slip is 0.65"), "{event:?}");
    assert!(event.barred.is_some_and(|barred| barred.slipped && barred.radius_m == 2.0), "{event:?}");
    assert!(drive(&bench).0 < -0.3, "{}", story(&bench));
    // It has moved by more than a metre. Then it gets on with the same slip, beside the place that is barred.
    let beside = |y_m: f64| Pose::from_xy_yaw(-1.1, y_m, std::f64::consts::FRAC_PI_2);
    slip_at(&mut bench, &beside(0.0), 1);
    let (name, reason) = mode(&bench);
    assert!(name.is_empty() && reason.starts_with("moved_m is 1.1"), "{name}: {reason}");
    for step in 0..235 {
        slip_at(&mut bench, &beside(0.01 * f64::from(step)), 1);
    }
    assert_eq!((mode(&bench).0.as_str(), bench.sent("/follower/modes")), ("", 2), "{}", story(&bench));
    slip_at(&mut bench, &beside(2.4), 10);
    let (name, reason) = mode(&bench);
    assert!(name == "SLIPPING" && bench.sent("/follower/modes") == 3, "{name}: {reason}");
}

#[test]
fn where_the_wheels_slip_the_place_that_is_barred_lies_ahead_of_the_front_end() {
    for (front_m, x_m) in [("0.24", 2.5), ("3", 5.26)] {
        let mut bench = start(&[FILES[0], FILES[1], FILES[2], ("follower.front_m", front_m)]);
        cycle(&mut bench, 0.0, 0.0, free, 12);
        slips_at(&mut bench, &Pose::IDENTITY, 0.65, 20);
        let event: ModeEvent = bench.latest("/follower/modes");
        assert!(event.barred.is_some_and(|barred| (barred.x_m - x_m).abs() < 1e-9), "{front_m}: {event:?}");
    }
}

#[test]
fn a_vehicle_that_is_told_to_drive_and_does_not_move_shakes_itself_free() {
    let mut bench = start(&FILES);
    cycle(&mut bench, 0.0, 0.0, free, 55);
    assert_eq!(mode(&bench).0, "", "for less than 3 s: {}", story(&bench));
    assert!(drive(&bench).0 > 0.5, "{}", story(&bench));
    cycle(&mut bench, 0.0, 0.0, free, 20);
    let event: ModeEvent = bench.latest("/follower/modes");
    assert!(event.to == "STUCK" && event.reason.starts_with("stuck_s is 3.0"), "{event:?}");
    assert_eq!(event.barred, None, "{event:?}");
    assert!(drive(&bench).0 < -0.3, "{}", story(&bench));
    cycle(&mut bench, -0.7, 0.0, free, 2);
    let event: ModeEvent = bench.latest("/follower/modes");
    assert!(event.from == "STUCK" && event.reason.starts_with("moved_m is 0.7"), "{event:?}");
    assert!(drive(&bench).0 > 0.5, "{}", story(&bench));
}

#[test]
fn slip_while_it_backs_bars_nothing_ahead() {
    let mut bench = start(&FILES);
    cycle(&mut bench, 0.0, 0.0, free, 75);
    assert!(mode(&bench).0 == "STUCK" && drive(&bench).0 < -0.3, "{}", story(&bench));
    slips_at(&mut bench, &Pose::IDENTITY, 0.65, 20);
    let event: ModeEvent = bench.latest("/follower/modes");
    assert!(event.to == "SLIPPING" && event.barred.is_none(), "{event:?}");
}

#[test]
fn a_mode_that_another_table_halt_or_init_ends_is_told_to_have_ended() {
    let mut bench = start(&FILES);
    let back_up = |bench: &mut Bench| {
        cycle(bench, 0.0, 0.0, free, 12);
        bench.write("/operator/bumper", rcs::Bumper { left: true, ..rcs::Bumper::default() });
        cycle(bench, 0.0, 0.0, free, 2);
        assert_eq!(mode(bench).0, "REVERSE_FROM_BUMPER", "{}", story(bench));
        bench.write("/operator/bumper", rcs::Bumper::default());
    };
    let assert_ended = |bench: &Bench, reason: &str, sent: u64| {
        let event: ModeEvent = bench.latest("/follower/modes");
        assert_eq!((event.from.as_str(), event.to.as_str()), ("REVERSE_FROM_BUMPER", ""), "{event:?}");
        assert_eq!((event.reason.as_str(), bench.sent("/follower/modes")), (reason, sent));
    };
    back_up(&mut bench);
    let params: WaypointFollowerParams = bench.latest("/follower/params");
    let without = WaypointFollowerParams { modes: String::new(), ..params.clone() };
    bench.write("/follower/params", without);
    cycle(&mut bench, 0.0, 0.0, free, 2);
    assert_ended(&bench, "another table of modes", 2);
    assert!(drive(&bench).0 > 0.5, "{}", story(&bench));
    bench.write("/follower/params", params);
    back_up(&mut bench);
    let tell = |bench: &mut Bench, serial: u64, name: &str| {
        let command = rcs::Command { serial, name: name.to_owned(), ..rcs::Command::default() };
        bench.write("/follower/command", command);
        cycle(bench, 0.0, 0.0, free, 4);
    };
    tell(&mut bench, 100, "HALT");
    assert_ended(&bench, "halted", 4);
    tell(&mut bench, 101, "RUN");
    back_up(&mut bench);
    tell(&mut bench, 102, "INIT");
    assert_ended(&bench, "initialized", 6);
    tell(&mut bench, 103, "RUN");
    back_up(&mut bench);
    for (serial, name) in [(104, "INIT"), (105, "RUN")] {
        let command = rcs::Command { serial, name: name.to_owned(), ..rcs::Command::default() };
        bench.write("/follower/command", command);
    }
    cycle(&mut bench, 0.0, 0.0, free, 1);
    assert_ended(&bench, "initialized", 8);
}

#[test]
fn it_leaves_slip_ahead_where_something_is_behind_and_slowly_ahead_where_nothing_is_free() {
    let slip = |costs: &dyn Fn(DVec2) -> u8| {
        let mut bench = start(&FILES);
        for _ in 0..48 {
            bench.write("/operator/slip", rcs::SlipReport { slip: 0.9, ..rcs::SlipReport::default() });
            cycle(&mut bench, 0.0, 0.0, costs, 1);
        }
        assert_eq!(mode(&bench).0, "SPINNING");
        (drive(&bench).0, story(&bench))
    };
    let bush = |at: DVec2| if (-1.4..-0.6).contains(&at.x) && at.y.abs() < 0.6 { 250 } else { 0 };
    let (ahead_mps, told) = slip(&bush);
    assert!(ahead_mps > 0.3, "{told}");
    let ring = |at: DVec2| if (0.7..1.4).contains(&at.length()) { 250 } else { 0 };
    let (touching_mps, told) = slip(&ring);
    assert!((0.1..=0.25).contains(&touching_mps), "{told}");
}

#[test]
fn it_reverses_on_its_own_track_where_growth_leaves_no_other_way_back() {
    let back_mps = |lane_m: f64| {
        let mut bench = start(&FILES);
        // What it has driven over is free, as wide as its body; growth stands on both sides and ahead.
        let growth = |at: DVec2| if at.x > 0.6 || at.y.abs() > lane_m { 250 } else { 0 };
        cycle(&mut bench, 0.0, 0.0, growth, 12);
        bench.write("/operator/bumper", rcs::Bumper { left: true, ..rcs::Bumper::default() });
        cycle(&mut bench, 0.0, 0.0, growth, 2);
        assert_eq!(mode(&bench).0, "REVERSE_FROM_BUMPER", "{}", story(&bench));
        drive(&bench).0
    };
    assert!((-0.25..-0.1).contains(&back_mps(0.4)), "{}", back_mps(0.4));
    assert_eq!(back_mps(0.1), 0.0, "it stands where something is behind it");
}

#[test]
fn without_a_path_no_target_is_sent_while_it_stands_and_while_it_backs_up() {
    let mut bench = start(&FILES);
    let target = |bench: &Bench| {
        let choice: ArcChoice = bench.latest("/follower/arcs");
        [choice.target_x_m, choice.target_y_m]
    };
    cycle(&mut bench, 0.0, 0.0, ring, 20);
    assert!(target(&bench).iter().all(|v| v.is_nan()), "{:?}; {}", target(&bench), story(&bench));
    bench.write("/operator/bumper", rcs::Bumper { left: true, ..rcs::Bumper::default() });
    cycle(&mut bench, 0.0, 0.0, ring, 2);
    assert_eq!(mode(&bench).0, "REVERSE_FROM_BUMPER", "{}", story(&bench));
    assert!(target(&bench).iter().all(|v| v.is_nan()), "{:?}; {}", target(&bench), story(&bench));
}

#[test]
fn where_the_path_leads_and_the_vehicle_does_not_get_is_barred() {
    let mut bench = start(&FILES);
    for step in 0..170 {
        // It moves to and fro.
        cycle(&mut bench, if (step / 20) % 2 == 0 { 0.0 } else { 0.3 }, 0.0, free, 1);
    }
    let event: ModeEvent = bench.latest("/follower/modes");
    assert!(event.to == "NO_PROGRESS" && event.reason.starts_with("stayed_s is 8.0"), "{event:?}");
    let barred = event.barred.unwrap();
    assert!(barred.radius_m == 0.6 && (1.0..=4.5).contains(&barred.x_m), "{barred:?}");
    let path: PosesInFrame = bench.latest("/planner/path");
    let enters = path.poses.iter().any(|pose| {
        let at = pose.position.unwrap();
        DVec2::new(at.x, at.y).distance(DVec2::new(barred.x_m, barred.y_m)) < 0.6
    });
    assert!(!enters && path.poses.len() > 20, "{barred:?}; {}", story(&bench));
}

#[test]
fn a_bound_of_the_room_that_is_not_below_the_desired_clearance_is_refused() {
    let check = |wish_clearance_m: f64| {
        let params: WaypointFollowerParams = rcs_msg::params::default();
        let costs = Some(TerrainCosts { wish_clearance_m, ..params.costs.clone().unwrap() });
        let modes = include_str!("../../../../assets/modes/lagr.toml").to_owned();
        WaypointFollower::check(&WaypointFollowerParams { modes, costs, ..params })
    };
    assert_eq!(check(0.5), Ok(()));
    let refused = check(0.36).unwrap_err();
    let expected = "modes: mode \"NARROW_CORRIDOR\": room_m: the bound is 0.36 m, expected less than";
    assert!(refused.starts_with(expected), "{refused}");
}

#[test]
fn where_there_is_a_path_and_no_free_arc_it_backs_out_and_looks_for_another_way() {
    // Things close around the vehicle, which the planner takes for passable there.
    let [world, goal, modes] = FILES;
    let mut bench = start(&[world, goal, modes, ("planner.relief_range_m", "1.2")]);
    let close = |at: DVec2| if (0.6..0.8).contains(&at.length()) { 250 } else { 0 };
    cycle(&mut bench, 0.0, 0.0, close, 48);
    let plan: rcs::Plan = bench.latest("/planner/plan");
    assert_ne!(plan.state(), PlanState::PlanNoWay, "{}", story(&bench));
    let event: ModeEvent = bench.latest("/follower/modes");
    assert!(event.to == "NO_ARC" && event.reason.starts_with("no_arc_s is 2.0"), "{event:?}");
    assert!(event.barred.is_some_and(|barred| barred.radius_m == 0.6), "{event:?}");
    // It stands, because nothing behind it is free either; ground behind it that is free is driven over.
    assert_eq!(drive(&bench).0, 0.0, "{}", story(&bench));
    let ahead = |at: DVec2| if at.x > -0.3 { close(at) } else { 0 };
    cycle(&mut bench, 0.0, 0.0, ahead, 2);
    assert!(drive(&bench).0 < -0.2, "{}", story(&bench));
    cycle(&mut bench, -0.9, 0.0, ahead, 2);
    let event: ModeEvent = bench.latest("/follower/modes");
    assert!(event.from == "NO_ARC" && event.reason.starts_with("moved_m is 0.9"), "{event:?}");
}

#[test]
fn while_the_vehicle_is_held_it_is_not_stuck_and_an_emergency_stop_ends_a_mode() {
    let mut bench = start(&FILES);
    let hold = |bench: &mut Bench, reason: &str, emergency_stopped: bool| {
        let (stopped, stop_reason) = (!reason.is_empty(), reason.to_owned());
        let status = rcs::VehicleStatus { stopped, stop_reason, emergency_stopped, ..Default::default() };
        bench.write("/operator/vehicle", status);
    };
    hold(&mut bench, "imu silent for 1.0 s, expected at most 0.5 s", false);
    cycle(&mut bench, 0.0, 0.0, free, 200);
    assert_eq!(mode(&bench).0, "", "{}", story(&bench));
    // So is one that may drive no faster than this.
    bench.write("/operator/vehicle", rcs::VehicleStatus { max_speed_mps: 0.1, ..Default::default() });
    cycle(&mut bench, 0.0, 0.0, free, 200);
    assert_eq!(mode(&bench).0, "", "{}", story(&bench));
    hold(&mut bench, "", false);
    cycle(&mut bench, 0.0, 0.0, free, 80);
    assert_eq!(mode(&bench).0, "STUCK", "{}", story(&bench));
    hold(&mut bench, "emergency stop: a person", true);
    cycle(&mut bench, 0.0, 0.0, free, 200);
    let event: ModeEvent = bench.latest("/follower/modes");
    assert_eq!((event.from.as_str(), event.reason.as_str()), ("STUCK", "the vehicle is held"));
    assert_eq!(bench.sent("/follower/modes"), 2, "{event:?}");
    // A bumper that holds the vehicle is what a mode begins with.
    hold(&mut bench, "bumper is pressed", false);
    bench.write("/operator/bumper", rcs::Bumper { left: true, ..rcs::Bumper::default() });
    cycle(&mut bench, 0.0, 0.0, free, 2);
    assert_eq!(mode(&bench).0, "REVERSE_FROM_BUMPER", "{}", story(&bench));
}

#[test]
fn a_vehicle_that_stands_because_a_command_was_refused_is_not_stuck() {
    let mut bench = start(&FILES);
    let stop_reason = rcs_sense::stop_reason::REFUSED.to_owned();
    let refuses = rcs::VehicleStatus { stopped: true, stop_reason, ..Default::default() };
    bench.write("/operator/vehicle", refuses);
    cycle(&mut bench, 0.0, 0.0, free, 200);
    assert_eq!(bench.sent("/follower/modes"), 0, "{:?}; {}", mode(&bench), story(&bench));
}

#[test]
fn it_commands_no_more_than_the_limits_that_the_vehicle_states() {
    let mut bench = start(&FILES);
    let limits = rcs::VehicleStatus { max_speed_mps: 0.8, max_yaw_rate_radps: 0.3, ..Default::default() };
    bench.write("/operator/vehicle", limits);
    cycle(&mut bench, 0.0, 0.0, free, 12);
    assert!((0.5..=0.8).contains(&drive(&bench).0), "{}", story(&bench));
    // The goal lies behind it.
    cycle(&mut bench, 0.0, 3.0, free, 6);
    assert!((0.1..=0.3).contains(&drive(&bench).1.abs()), "{}", story(&bench));
}

#[test]
fn while_the_operator_drives_by_hand_it_is_not_stuck_and_goes_on_afterwards() {
    let mut bench = start(&FILES);
    let teleoperate = |bench: &mut Bench, teleoperated: bool| {
        bench.write("/operator/vehicle", rcs::VehicleStatus { teleoperated, ..Default::default() });
    };
    cycle(&mut bench, 0.0, 0.0, free, 12);
    teleoperate(&mut bench, true);
    cycle(&mut bench, 0.0, 0.0, free, 200);
    slips_at(&mut bench, &Pose::IDENTITY, 0.9, 30);
    assert_eq!(bench.sent("/follower/modes"), 0, "{}", story(&bench));
    teleoperate(&mut bench, false);
    cycle(&mut bench, 0.0, 0.0, free, 12);
    assert_eq!(bench.sent("/follower/modes"), 0, "{}", story(&bench));
    assert!(drive(&bench).0 > 0.5, "{}", story(&bench));
}

#[test]
fn after_halt_and_run_of_the_follower_alone_it_still_knows_the_goal() {
    let mut bench = start(&FILES);
    cycle(&mut bench, 0.0, 0.0, free, 12);
    for (serial, name) in [(100, "HALT"), (101, "RUN")] {
        let command = rcs::Command { serial, name: name.to_owned(), ..rcs::Command::default() };
        bench.write("/follower/command", command);
        cycle(&mut bench, 0.0, 0.0, ring, 4);
    }
    cycle(&mut bench, 0.0, 0.0, ring, 100);
    assert_eq!(mode(&bench).0, "AGGRESSIVE", "{}", story(&bench));
    let choice: ArcChoice = bench.latest("/follower/arcs");
    assert!((choice.target_x_m - 10.0).abs() < 0.3 && drive(&bench).0 > 0.2, "{}", story(&bench));
}
