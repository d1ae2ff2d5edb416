//! What "stands" means: nothing drives on, until the reason is gone; and changes while it drives take effect.

use super::modes::mode;
use super::{
    FILES, GOAL, cycle, drive, free, global_at, path, place_local_frame, point, polygon, ring, start, status,
    story,
};
use rcs_geom::DVec2;
use rcs_msg::foxglove::Odometry;
use rcs_msg::rcs::{Mission, Plan, PlanState, ProcessState};
use rcs_planner::proto::WaypointGeneratorParams;
use rcs_testkit::bench::Bench;

/// The generator reports this as an error, and the vehicle stands, for ten seconds.
fn assert_stands(bench: &mut Bench, cost: impl Fn(DVec2) -> u8 + Copy, why: &str) {
    for _ in 0..20 {
        cycle(bench, 0.0, 0.0, cost, 10);
        assert_eq!(drive(bench), (0.0, 0.0), "{}; mode {:?}", story(bench), mode(bench));
        let (state, text) = status(bench, "generator");
        assert!(state == ProcessState::Error && text.contains(why), "{text}");
    }
}

fn mission(goals: &[(f64, f64)]) -> Mission {
    let goals = goals.iter().map(|&(x_m, y_m)| point(x_m, y_m)).collect();
    Mission { frame_id: "local".to_owned(), goals, ..Mission::default() }
}

fn with_zone(corners: &[(f64, f64)]) -> Mission {
    Mission { keep_out: vec![polygon(corners)], keeps_goals: true, ..mission(&[]) }
}

#[test]
fn no_mode_drives_on_where_the_generator_stands() {
    // No way, for which there is a mode after 4 s, and no position.
    let mut bench = start(&FILES);
    cycle(&mut bench, 0.0, 0.0, ring, 40);
    let unknown = Odometry { pose_covariance: vec![25.0; 36], ..global_at(2.0) };
    bench.write("/operator/global", unknown);
    assert_stands(&mut bench, ring, "the position is known to 5.0 m");
    bench.write("/operator/global", global_at(2.0));
    cycle(&mut bench, 0.0, 0.0, free, 12);
    assert!(drive(&bench).0 > 0.5, "{}", story(&bench));
    // A mode that has begun, and a mission without goals.
    cycle(&mut bench, 0.0, 0.0, ring, 120);
    assert!(drive(&bench).0 > 0.2 && mode(&bench).0 == "AGGRESSIVE", "{}", story(&bench));
    bench.write("/operator/mission", mission(&[]));
    cycle(&mut bench, 0.0, 0.0, ring, 4);
    assert_stands(&mut bench, ring, "the mission has no goals");
    bench.write("/operator/mission", mission(&[(8.0, 0.0)]));
    cycle(&mut bench, 0.0, 0.0, free, 12);
    assert!(drive(&bench).0 > 0.5, "{}", story(&bench));
}

#[test]
fn where_zones_close_the_way_it_stands_and_no_mode_drives_through_them() {
    let mut bench = start(&FILES);
    cycle(&mut bench, 0.0, 0.0, free, 12);
    bench.write("/operator/mission", with_zone(&[(4.0, -30.0), (6.0, -30.0), (6.0, 30.0), (4.0, 30.0)]));
    cycle(&mut bench, 0.0, 0.0, free, 4);
    assert_stands(&mut bench, free, "no way to the goal inside of the area and around the zones");
    assert_eq!(bench.latest::<Plan>("/planner/plan").state(), PlanState::PlanForbidden);
    assert_eq!((status(&bench, "planner").0, mode(&bench).0.as_str()), (ProcessState::Error, ""));
    bench.write("/operator/mission", with_zone(&[(4.0, -1.0), (6.0, -1.0), (6.0, 1.0), (4.0, 1.0)]));
    cycle(&mut bench, 0.0, 0.0, free, 12);
    assert!(drive(&bench).0 > 0.2 && path(&bench).len() > 20, "{}", story(&bench));
}

#[test]
fn without_fixes_it_stands_as_soon_as_its_position_is_not_known_well_enough() {
    // As `localization` without fixes: transforms go on, and the deviation of the position grows for 30 s.
    let mut bench = start(&FILES[..2]);
    let known_to = |deviation_m: f64| {
        let mut covariance = vec![0.0; 36];
        (covariance[0], covariance[7]) = (deviation_m * deviation_m, deviation_m * deviation_m);
        Odometry { pose_covariance: covariance, ..global_at(2.0) }
    };
    cycle(&mut bench, 0.0, 0.0, free, 12);
    for step in 0..60 {
        let deviation_m = 1.05 + 0.1 * f64::from(step);
        place_local_frame(&mut bench, 2.0);
        bench.write("/operator/global", known_to(deviation_m));
        cycle(&mut bench, 0.0, 0.0, free, 10);
        let (state, text) = status(&bench, "generator");
        if deviation_m < 4.0 {
            assert!(drive(&bench).0 > 0.5 && state == ProcessState::Exec, "{deviation_m}: {}", story(&bench));
            assert!(!text.contains("the goal stays"), "{text}");
        } else {
            assert_eq!(drive(&bench), (0.0, 0.0), "{deviation_m}: {}", story(&bench));
            let is_told = text.starts_with("the position is known to ") && text.contains("at most 4 m");
            assert!(state == ProcessState::Error && is_told, "{text}");
        }
    }
    bench.write("/operator/global", known_to(1.0));
    cycle(&mut bench, 0.0, 0.0, free, 12);
    assert!(drive(&bench).0 > 0.5, "there is a fix again: {}", story(&bench));
}

#[test]
fn what_the_planners_cannot_be_told_stops_it() {
    let mut bench = start(&FILES);
    cycle(&mut bench, 0.0, 0.0, free, 12);
    assert!(drive(&bench).0 > 0.5, "{}", story(&bench));
    bench.write("/operator/mission", with_zone(&[(4.0, -1.0), (4.0, 1.0), (2e6, -1e6)]));
    cycle(&mut bench, 0.0, 0.0, free, 4);
    assert_stands(&mut bench, free, "the planners cannot be told");
    bench.write("/operator/mission", with_zone(&[(4.0, -1.0), (4.0, 1.0), (5.0, 0.0)]));
    cycle(&mut bench, 0.0, 0.0, free, 12);
    assert!(drive(&bench).0 > 0.2, "{}", story(&bench));
}

#[test]
fn a_jump_of_the_goal_is_not_forgotten_with_a_refused_mission_or_a_barred_place() {
    let mut bench = start(&FILES);
    cycle(&mut bench, 0.0, 0.0, free, 12);
    place_local_frame(&mut bench, -18.0);
    cycle(&mut bench, 0.0, 0.0, free, 4);
    bench.write("/operator/mission", with_zone(&[(4.0, -1.0), (4.0, 1.0)]));
    assert_stands(&mut bench, free, "the goal has jumped by 20.0 m");
    assert_eq!(bench.faults("generator").0, 1);
    let mut bench = start(&[FILES[0], FILES[1], ("generator.no_way_bars_m", "1.2")]);
    bench.write("/operator/global", global_at(2.0));
    super::goal::lead(&mut bench, 10.0);
    cycle(&mut bench, 0.0, 0.0, ring, 12);
    place_local_frame(&mut bench, -18.0);
    cycle(&mut bench, 0.0, 0.0, ring, 4);
    assert_stands(&mut bench, ring, "the goal has jumped by 20.0 m");
}

#[test]
fn a_jump_of_the_goal_is_not_forgotten_with_an_accepted_zone() {
    let mut bench = start(&FILES);
    cycle(&mut bench, 0.0, 0.0, free, 12);
    place_local_frame(&mut bench, -18.0);
    cycle(&mut bench, 0.0, 0.0, free, 4);
    bench.write("/operator/mission", with_zone(&[(-9.0, -1.0), (-7.0, -1.0), (-7.0, 1.0), (-9.0, 1.0)]));
    cycle(&mut bench, 0.0, 0.0, free, 4);
    assert_stands(&mut bench, free, "the goal has jumped by 20.0 m");
    assert_eq!(bench.faults("generator").0, 0);
    place_local_frame(&mut bench, 2.0);
    cycle(&mut bench, 0.0, 0.0, free, 12);
    assert!(drive(&bench).0 > 0.5, "{}", story(&bench));
    assert_eq!(bench.latest::<Mission>("/generator/driven").keep_out.len(), 1);
}

#[test]
fn another_goal_or_zone_of_the_parameters_takes_effect_at_once() {
    let mut bench = start(&FILES);
    let give = |bench: &mut Bench, goal: &str| {
        let params: WaypointGeneratorParams = bench.latest("/generator/params");
        bench.write("/generator/params", WaypointGeneratorParams { goal: goal.to_owned(), ..params });
        cycle(bench, 0.0, 0.0, free, 12);
    };
    cycle(&mut bench, 0.0, 0.0, free, 12);
    // 10 m farther north than before.
    give(&mut bench, &GOAL.replace("4000003", "4000013"));
    assert!(path(&bench).last().unwrap().distance(DVec2::new(10.0, 10.0)) < 0.3, "{}", story(&bench));
    let through = |bench: &Bench| path(bench).iter().any(|at| at.distance(DVec2::new(5.0, 0.0)) < 1.0);
    give(&mut bench, GOAL);
    assert!(through(&bench), "{}", story(&bench));
    let zone = "keep_out = [[[300006, 4000002], [300008, 4000002], [300008, 4000004], [300006, 4000004]]]";
    give(&mut bench, &format!("{zone}\n{GOAL}"));
    assert!(!through(&bench) && path(&bench).len() > 20, "{}", story(&bench));
}

#[test]
fn a_search_for_the_goal_ends_when_the_vehicle_is_driven_away() {
    let mut bench = start(&[FILES[0], FILES[1], ("generator.found_within_m", "1.2")]);
    bench.write("/operator/global", global_at(11.8));
    cycle(&mut bench, 9.8, 0.0, free, 12);
    assert!(status(&bench, "generator").1.contains("looks for it: place 1"), "{}", story(&bench));
    bench.write("/operator/global", global_at(-10.0));
    cycle(&mut bench, -12.0, 0.0, free, 200);
    assert!(!status(&bench, "generator").1.contains("looks for it"), "{}", story(&bench));
    assert!(path(&bench).last().unwrap().distance(DVec2::new(10.0, 0.0)) < 0.3, "{}", story(&bench));
    bench.write("/operator/global", global_at(11.8));
    cycle(&mut bench, 9.8, 0.0, free, 12);
    assert!(status(&bench, "generator").1.contains("looks for it: place 1"), "{}", story(&bench));
}

#[test]
fn a_camera_whose_clock_is_ahead_and_that_stops_is_noticed_in_time() {
    let mut bench = start(&FILES);
    cycle(&mut bench, 0.0, 0.0, free, 12);
    let ahead = rcs_msg::Stamp((bench.now_ms + 10_000) * 1_000_000);
    let image = rcs_msg::AnyMessage::new(rcs_msg::foxglove::RawImage::default());
    bench.session.write(rcs_runtime::ExternalEvent::sensed("/operator/left", ahead, image)).unwrap();
    let pose = rcs_geom::Pose::IDENTITY;
    super::sense(&mut bench, &["sensed", "right"], &pose, free, 10);
    assert!(drive(&bench).0 > 0.5, "{}", story(&bench));
    super::sense(&mut bench, &["sensed", "right"], &pose, free, 20);
    assert_eq!(drive(&bench), (0.0, 0.0), "{}", story(&bench));
    let (_, text) = status(&bench, "follower");
    assert!(text.starts_with("what comes from the left side is "), "{text}");
}
