//! Where the wheels slipped is barred in the next run, too.

use super::goal::register;
use super::{
    FILES, cycle, drive, drive_ahead, free, global_at, path, place_local_frame, start, status, story,
};
use rcs_geom::{DVec2, Pose, Utm};
use rcs_msg::rcs::ProcessState;
use rcs_msg::{Stamp, rcs};
use rcs_planner::proto::{Route, SlipMemory};
use rcs_planner::slips;
use rcs_sense::pose_message;
use rcs_testkit::bench::Bench;

/// The places that are sent, in the global frame, m.
pub(super) fn sent(bench: &Bench) -> Option<Vec<(f64, f64)>> {
    let message = bench.newest::<SlipMemory>("/generator/slips")?;
    let origin = Utm::new(18, true, 300_000.0, 4_000_000.0).unwrap();
    Some(slips::in_global(&message, &origin).unwrap().iter().map(|place| place.at).collect())
}

pub(super) fn nearest_m(bench: &Bench, to: DVec2) -> f64 {
    path(bench).iter().map(|at| at.distance(to)).fold(f64::INFINITY, f64::min)
}

/// What a run remembers whose wheels turned on the spot at 5 m, as the text of a file.
pub(super) fn first_run() -> String {
    let mut bench = start(&FILES);
    drive_ahead(&mut bench, 9.0);
    assert_eq!(sent(&bench), None);
    bench.write("/operator/global", global_at(5.0));
    place_local_frame(&mut bench, -4.0);
    cycle(&mut bench, 9.0, 0.0, free, 26);
    assert_eq!(sent(&bench), Some(vec![(8.5, 3.0)]));
    let message = bench.latest::<SlipMemory>("/generator/slips");
    rcs_msg::to_json(&rcs_msg::AnyMessage::new(message)).unwrap()
}

#[test]
fn the_next_run_goes_around_where_the_wheels_slipped_and_hands_it_on() {
    let slips = first_run();
    let mut bench = start(&[FILES[0], FILES[1], ("generator.slips", &slips)]);
    bench.write("/operator/global", global_at(2.0));
    cycle(&mut bench, 0.0, 0.0, free, 12);
    let place = DVec2::new(6.5, 0.0);
    assert!(nearest_m(&bench, place) > 2.5 && path(&bench).len() > 20, "{}", nearest_m(&bench, place));
    assert_eq!(sent(&bench), Some(vec![(8.5, 3.0)]));
    // The remembered map is registered 6 m farther north: the straight way is free.
    register(&mut bench, Some(DVec2::new(-2.0, 3.0)));
    cycle(&mut bench, 0.0, 0.0, free, 26);
    assert!(nearest_m(&bench, place) < 0.5, "{}", nearest_m(&bench, place));
    assert_eq!(sent(&bench), Some(vec![(8.5, 9.0)]));
}

#[test]
fn slips_of_another_zone_do_not_keep_those_of_this_run_from_being_sent() {
    let slips = first_run().replace("18", "17");
    let mut bench = start(&[FILES[0], FILES[1], FILES[2], ("generator.slips", &slips)]);
    drive_ahead(&mut bench, 9.0);
    bench.write("/operator/global", global_at(5.0));
    place_local_frame(&mut bench, -4.0);
    cycle(&mut bench, 9.0, 0.0, free, 26);
    assert_eq!(sent(&bench), Some(vec![(8.5, 3.0)]));
    let (count, fault) = bench.faults("generator");
    assert!(count == 1 && fault.contains("UTM zone 17"), "{count}: {fault}");
}

#[test]
fn a_place_that_is_driven_over_without_slip_is_forgotten() {
    let slips = first_run();
    for (slip, expected) in [(0.05, vec![]), (0.5, vec![(8.5, 3.0)])] {
        let mut bench = start(&[FILES[0], FILES[1], ("generator.slips", &slips)]);
        for x in 0..=6 {
            let report = way_slip(&bench, slip, f64::from(x));
            bench.write("/operator/way_slip", report);
            bench.write("/operator/global", global_at(f64::from(x) + 2.0));
            cycle(&mut bench, f64::from(x), 0.0, free, 2);
        }
        cycle(&mut bench, 6.0, 0.0, free, 26);
        assert_eq!(sent(&bench), Some(expected), "{slip}");
    }
}

/// What fixes tell of the wheels over the last metres, in the middle of which the vehicle was here, local frame, m.
fn way_slip(bench: &Bench, slip: f64, x_m: f64) -> rcs::WaySlip {
    let now = Some(Stamp(bench.now_ms * 1_000_000 + 1).to_proto());
    let middle = Some(pose_message(&Pose::from_xy_yaw(x_m, 0.0, 0.0)));
    rcs::WaySlip { timestamp: now, since: now, slip, middle, ..rcs::WaySlip::default() }
}

#[test]
fn fixes_that_jump_back_along_the_track_stop_it_where_images_have_seen_it_move() {
    let mut bench = start(&FILES);
    for x in 0..=9 {
        let x_m = f64::from(x);
        let report = rcs::WaySlip { rolled_m: 1.0, moved_m: 0.95, ..way_slip(&bench, 0.05, x_m) };
        bench.write("/operator/way_slip", report);
        bench.write("/operator/global", global_at(x_m + 2.0));
        cycle(&mut bench, x_m, 0.0, free, 2);
    }
    bench.write("/operator/global", global_at(5.0));
    place_local_frame(&mut bench, -4.0);
    cycle(&mut bench, 9.0, 0.0, free, 6);
    assert_eq!(drive(&bench), (0.0, 0.0));
    let (state, text) = status(&bench, "generator");
    assert!(state == ProcessState::Error && text.starts_with("the goal has jumped by 6.0 m"), "{text}");
    assert_eq!(sent(&bench), None, "nothing slipped");
}

#[test]
fn fixes_that_jump_back_after_the_operator_has_accepted_their_jump_stop_it_and_nothing_has_slipped() {
    let mut bench = start(&FILES);
    drive_ahead(&mut bench, 4.0);
    let jump = |bench: &mut Bench, by_m: f64| {
        bench.write("/operator/global", global_at(6.0 + by_m));
        place_local_frame(bench, 2.0 + by_m);
        cycle(bench, 4.0, 0.0, free, 6);
        assert_eq!(drive(bench), (0.0, 0.0));
        let (state, text) = status(bench, "generator");
        assert!(state == ProcessState::Error && text.starts_with("the goal has jumped by 12.0 m"), "{text}");
    };
    jump(&mut bench, 12.0);
    let run = rcs::Command { serial: 100, name: "RUN".to_owned(), ..rcs::Command::default() };
    bench.write("/generator/command", run);
    cycle(&mut bench, 4.0, 0.0, free, 12);
    assert_eq!(status(&bench, "generator").0, ProcessState::Exec, "{}", story(&bench));
    jump(&mut bench, 0.0);
    assert_eq!(sent(&bench), None, "nothing slipped");
}

#[test]
fn wheels_that_turn_on_the_spot_by_the_fixes_are_shaken_free_and_those_in_flat_mud_drive_on() {
    for (slip, is_stuck) in [(0.95, true), (0.5, false)] {
        let mut bench = start(&FILES);
        for _ in 0..40 {
            let report = way_slip(&bench, slip, 0.0);
            bench.write("/operator/way_slip", report);
            bench.write("/operator/global", global_at(2.0));
            cycle(&mut bench, 0.0, 0.0, free, 1);
        }
        cycle(&mut bench, 0.0, 0.0, free, 26);
        assert_eq!(sent(&bench).is_some_and(|places| !places.is_empty()), is_stuck, "{slip}");
    }
}

#[test]
fn the_route_for_the_next_run_leaves_out_where_the_wheels_slipped() {
    let mut bench = start(&FILES);
    for half_metres in 0..=20 {
        let x_m = f64::from(half_metres) / 2.0;
        if (4.0..=6.0).contains(&x_m) {
            let report = way_slip(&bench, 0.5, x_m);
            bench.write("/operator/way_slip", report);
        }
        bench.write("/operator/global", global_at(x_m + 2.0));
        cycle(&mut bench, x_m, 0.0, free, 5);
    }
    let route = bench.latest::<Route>("/generator/route");
    let at: Vec<f64> = route.points.iter().map(|point| point.easting_m - 300_000.0).collect();
    let between = |from: f64, to: f64| at.iter().filter(|x| (from..to).contains(*x)).count();
    assert!(between(2.0, 4.6) >= 2 && between(9.4, 12.5) >= 2, "{at:?}");
    assert_eq!(between(5.0, 9.0), 0, "{at:?}");
}
