//! What the generator hands from run to run: what is kept of it, and what is forgotten.

use super::goal::{found_before, register};
use super::slips::{first_run, nearest_m, sent};
use super::{
    FILES, cycle, drive, drive_ahead, free, global_at, path, place_local_frame, point, start, status, story,
};
use rcs_geom::DVec2;
use rcs_msg::rcs;
use rcs_planner::WaypointGeneratorCommand;
use rcs_planner::proto::{Route, UtmGoal, WaypointGeneratorParams};
use rcs_runtime::CommandSet;
use rcs_testkit::bench::Bench;

/// Sends the generator a command of its own.
fn say(bench: &mut Bench, command: &WaypointGeneratorCommand) {
    let encoded = command.encode();
    let (parameters_schema, parameters) = encoded.parameters;
    let (name, parameters) = (encoded.name.to_owned(), parameters.into());
    let serial = 100 + bench.now_ms;
    let command = rcs::Command { serial, name, parameters_schema, parameters, timestamp: None };
    bench.write("/generator/command", command);
}

/// Sends the vehicle to a place 3 m north of the origin.
fn go_to(bench: &mut Bench, easting_m: f64) {
    let goal = UtmGoal { zone: 18, easting_m, northing_m: 4_000_003.0 };
    say(bench, &WaypointGeneratorCommand::GoTo(goal));
}

/// Sends the generator `INIT`, and then `RUN`.
fn begin_again(bench: &mut Bench, x_m: f64) {
    for name in ["INIT", "RUN"] {
        let serial = 100 + bench.now_ms;
        let command = rcs::Command { serial, name: name.to_owned(), ..rcs::Command::default() };
        bench.write("/generator/command", command);
        cycle(bench, x_m, 0.0, free, 4);
    }
}

/// Drives straight ahead from place to place of the local frame, m.
fn drive_on(bench: &mut Bench, from_m: f64, to_m: f64) {
    for half_metres in 0..=(2.0 * (to_m - from_m)) as u32 {
        let x_m = from_m + f64::from(half_metres) / 2.0;
        bench.write("/operator/global", global_at(x_m + 2.0));
        cycle(bench, x_m, 0.0, free, 5);
    }
}

/// Where the route that was sent last begins and ends, east of the origin of the global frame, m; `None` without one.
fn ends_m(bench: &Bench) -> Option<(f64, f64)> {
    let route = bench.newest::<Route>("/generator/route")?;
    let east_m = |at: usize| route.points[at].easting_m - 300_000.0;
    Some((east_m(0), east_m(route.points.len() - 1)))
}

#[test]
fn a_route_to_another_goal_stays_until_this_goal_is_reached() {
    // The remembered route leads to the goal of the file, 12 m east of the origin.
    let mut bench = start(&[FILES[0], FILES[1], ("generator.route", "r")]);
    go_to(&mut bench, 300_018.0);
    drive_on(&mut bench, 0.0, 12.5);
    assert_eq!(ends_m(&bench), None, "3.5 m before the goal: {}", story(&bench));
    drive_on(&mut bench, 13.0, 15.5);
    let reached = ends_m(&bench).unwrap();
    assert!(reached.0 < 3.0 && (reached.1 - 17.5).abs() < 0.1, "{reached:?}");
    // The goal that was reached last counts, and not one that the vehicle only came near to.
    go_to(&mut bench, 300_024.0);
    drive_on(&mut bench, 15.5, 18.5);
    assert_eq!(ends_m(&bench), Some(reached), "3.5 m before the goal: {}", story(&bench));

    // A route to the same goal is replaced from near on, as one is where nothing is remembered.
    for files in [&[FILES[0], FILES[1], ("generator.route", "r")][..], &FILES[..2]] {
        let mut bench = start(files);
        drive_on(&mut bench, 0.0, 6.5);
        assert!(ends_m(&bench).is_some_and(|(_, end_m)| end_m > 8.0), "3.5 m before the goal");
    }
}

#[test]
fn a_goal_that_counts_as_reached_from_more_than_3_m_away_is_reached_for_the_route_too() {
    let files = [FILES[0], FILES[1], ("generator.route", "r"), ("planner.goal_radius_m", "4")];
    let arrive = |bench: &mut Bench, from_m: f64| {
        drive_on(bench, from_m, from_m + 0.5);
        cycle(bench, from_m + 0.5, 0.0, free, 6);
    };
    let mut bench = start(&files);
    go_to(&mut bench, 300_017.0);
    drive_on(&mut bench, 0.0, 10.5);
    assert_eq!(ends_m(&bench), None, "4.5 m before the goal: {}", story(&bench));
    arrive(&mut bench, 11.0);
    assert!(ends_m(&bench).is_some_and(|(_, end_m)| end_m < 14.0), "{}", story(&bench));

    // The same place, and another one, as goals of a mission: the route to each stays until the next one is reached.
    let mut bench = start(&files);
    let goals = vec![point(15.0, 0.0), point(20.5, 0.0)];
    let frame_id = "local".to_owned();
    bench.write("/operator/mission", rcs::Mission { frame_id, goals, ..rcs::Mission::default() });
    drive_on(&mut bench, 0.0, 10.5);
    assert_eq!(ends_m(&bench), None, "4.5 m before the goal: {}", story(&bench));
    arrive(&mut bench, 11.0);
    let first = ends_m(&bench);
    assert!(first.is_some_and(|(_, end_m)| end_m < 14.0), "{}", story(&bench));
    drive_on(&mut bench, 12.0, 16.0);
    assert_eq!(ends_m(&bench), first, "4.5 m before the second goal: {}", story(&bench));
    arrive(&mut bench, 16.5);
    assert!(ends_m(&bench).is_some_and(|(_, end_m)| end_m > 18.0), "{}", story(&bench));
}

#[test]
fn clear_forgets_the_slips_of_the_run_before_and_those_of_this_one() {
    let slips = first_run();
    let mut bench = start(&[FILES[0], FILES[1], ("generator.slips", &slips)]);
    bench.write("/operator/global", global_at(2.0));
    cycle(&mut bench, 0.0, 0.0, free, 12);
    let place = DVec2::new(6.5, 0.0);
    assert!(nearest_m(&bench, place) > 2.5, "{}", nearest_m(&bench, place));
    say(&mut bench, &WaypointGeneratorCommand::Clear);
    cycle(&mut bench, 0.0, 0.0, free, 26);
    assert!(nearest_m(&bench, place) < 0.5, "{}", nearest_m(&bench, place));
    assert_eq!(sent(&bench), Some(Vec::new()), "the next run is handed none");
    // Others of the parameters are used.
    let params: WaypointGeneratorParams = bench.latest("/generator/params");
    bench.write("/generator/params", WaypointGeneratorParams { slips: format!("{slips} "), ..params });
    cycle(&mut bench, 0.0, 0.0, free, 26);
    assert_eq!(sent(&bench), Some(vec![(8.5, 3.0)]));

    let mut bench = start(&FILES);
    drive_ahead(&mut bench, 9.0);
    bench.write("/operator/global", global_at(5.0));
    place_local_frame(&mut bench, -4.0);
    cycle(&mut bench, 9.0, 0.0, free, 26);
    assert_eq!(sent(&bench), Some(vec![(8.5, 3.0)]));
    say(&mut bench, &WaypointGeneratorCommand::Clear);
    cycle(&mut bench, 9.0, 0.0, free, 26);
    assert_eq!(sent(&bench), Some(Vec::new()));
}

#[test]
fn clear_forgets_the_route_of_the_run_before_and_the_way_of_this_one() {
    let mut bench = start(&found_before("1.2"));
    // The goal is taken to be where that run found it.
    register(&mut bench, Some(DVec2::new(-2.0, -1.5)));
    cycle(&mut bench, 0.0, 0.0, free, 12);
    let found = DVec2::new(10.14, 0.83);
    assert!(path(&bench).last().unwrap().distance(found) < 0.3, "{}", story(&bench));
    drive_on(&mut bench, 0.0, 6.5);
    assert!(ends_m(&bench).is_some_and(|(begin_m, _)| begin_m < 3.0), "{:?}", ends_m(&bench));
    say(&mut bench, &WaypointGeneratorCommand::Clear);
    cycle(&mut bench, 6.5, 0.0, free, 12);
    assert!(path(&bench).last().unwrap().distance(DVec2::new(10.0, 0.0)) < 0.3, "{}", story(&bench));
    assert_eq!(bench.latest::<Route>("/generator/route").points.len(), 0, "the next run is handed none");
    drive_on(&mut bench, 7.0, 9.5);
    assert!(ends_m(&bench).is_some_and(|(begin_m, _)| begin_m > 8.0), "{:?}", ends_m(&bench));
    let Route { cut_m, time_s, .. } = bench.latest("/generator/route");
    assert!(cut_m < 1.0 && time_s < 3.0, "what was forgotten is not cut: {cut_m} m, {time_s} s");
}

#[test]
fn save_sends_the_slips_at_once() {
    let slips = first_run();
    let mut bench = start(&[FILES[0], FILES[1], ("generator.slips", &slips)]);
    let count = |bench: &Bench| bench.sent("/generator/slips");
    for _ in 0..24 {
        let before = count(&bench);
        cycle(&mut bench, 0.0, 0.0, free, 1);
        if count(&bench) > before {
            break;
        }
    }
    let before = count(&bench);
    assert!(before > 0, "{}", story(&bench));
    cycle(&mut bench, 0.0, 0.0, free, 4);
    assert_eq!(count(&bench), before, "they are sent each second");
    say(&mut bench, &WaypointGeneratorCommand::Save);
    cycle(&mut bench, 0.0, 0.0, free, 4);
    assert_eq!(count(&bench), before + 1);
}

#[test]
fn save_and_clear_let_no_vehicle_drive_on_that_stands_and_stop_none() {
    for command in [WaypointGeneratorCommand::Save, WaypointGeneratorCommand::Clear] {
        let mut bench = start(&FILES);
        cycle(&mut bench, 0.0, 0.0, free, 12);
        say(&mut bench, &command);
        for _ in 0..12 {
            cycle(&mut bench, 0.0, 0.0, free, 1);
            assert!(drive(&bench).0 > 0.5, "{command:?}: {}", story(&bench));
        }
        place_local_frame(&mut bench, -18.0);
        cycle(&mut bench, 0.0, 0.0, free, 3);
        say(&mut bench, &command);
        cycle(&mut bench, 0.0, 0.0, free, 12);
        assert_eq!(drive(&bench), (0.0, 0.0), "{command:?}: {}", story(&bench));
        assert!(status(&bench, "generator").1.starts_with("the goal has jumped by 20.0 m"), "{command:?}");
    }
}

#[test]
fn the_way_of_a_run_and_where_its_wheels_slipped_outlive_init() {
    let mut bench = start(&FILES);
    drive_ahead(&mut bench, 9.0);
    bench.write("/operator/global", global_at(5.0));
    place_local_frame(&mut bench, -4.0);
    cycle(&mut bench, 9.0, 0.0, free, 26);
    begin_again(&mut bench, 9.0);
    let before = bench.sent("/generator/slips");
    cycle(&mut bench, 9.0, 0.0, free, 26);
    assert!(bench.sent("/generator/slips") > before, "{}", story(&bench));
    assert_eq!(sent(&bench), Some(vec![(8.5, 3.0)]));

    let mut bench = start(&FILES[..2]);
    drive_on(&mut bench, 0.0, 4.0);
    begin_again(&mut bench, 4.0);
    drive_on(&mut bench, 4.5, 8.0);
    let ends_m = ends_m(&bench).unwrap();
    assert!(ends_m.0 < 3.0 && (ends_m.1 - 10.0).abs() < 0.1, "{ends_m:?}");
}
