//! The goals of the operator's missions, and what does not make them forgotten.

use super::{FILES, cycle, drive, free, go_to, path, point, polygon, start, status, story};
use rcs_geom::DVec2;
use rcs_msg::rcs;
use rcs_msg::rcs::Mission;
use rcs_testkit::bench::Bench;

#[test]
fn the_goals_of_a_mission_are_driven_to_one_after_the_other() {
    let mut bench = start(&FILES[..2]);
    let mission = |goals| Mission { frame_id: "local".to_owned(), goals, ..Mission::default() };
    bench.write("/operator/mission", mission(vec![point(4.0, 0.0), point(8.0, 4.0)]));
    cycle(&mut bench, 0.0, 0.0, free, 12);
    let obeyed = |bench: &Bench| bench.latest::<Mission>("/generator/driven");
    assert!(path(&bench).last().unwrap().distance(DVec2::new(4.0, 0.0)) < 0.2, "{}", story(&bench));
    assert_eq!((obeyed(&bench).reached, obeyed(&bench).goals[0].x_m), (0, 6.0), "in the global frame");
    cycle(&mut bench, 3.9, 0.0, free, 20);
    assert!(path(&bench).last().unwrap().distance(DVec2::new(8.0, 4.0)) < 0.2, "{}", story(&bench));
    assert_eq!(obeyed(&bench).reached, 1);
    bench.write("/operator/mission", mission(Vec::new()));
    cycle(&mut bench, 3.9, 0.0, free, 6);
    assert_eq!((drive(&bench), path(&bench).len()), ((0.0, 0.0), 0));
    assert_eq!(status(&bench, "generator").1, "the mission has no goals: stands");
    bench.write("/operator/mission", Mission { frame_id: "elsewhere".to_owned(), ..Mission::default() });
    cycle(&mut bench, 3.9, 0.0, free, 2);
    let faults: rcs::Status = bench.latest("/generator/status");
    assert!(faults.last_fault.contains("mission: frame is \"elsewhere\""), "{faults:?}");
}

#[test]
fn goals_are_not_lost_behind_zones_that_come_with_them() {
    let mut bench = start(&FILES[..2]);
    let goals = vec![point(8.0, 4.0)];
    let frame_id = "local".to_owned();
    bench.write("/operator/mission", Mission { frame_id, goals, ..Mission::default() });
    // Before the next cycle, as while the time of the run stands.
    bench.write("/operator/mission", zone_behind());
    cycle(&mut bench, 0.0, 0.0, free, 12);
    assert!(path(&bench).last().unwrap().distance(DVec2::new(8.0, 4.0)) < 0.2, "{}", story(&bench));
    assert_eq!(bench.latest::<Mission>("/generator/driven").keep_out.len(), 1);
}

#[test]
fn the_goals_of_a_mission_and_those_that_are_reached_outlive_init() {
    let mut bench = start(&FILES[..2]);
    let goals = vec![point(4.0, 0.0), point(8.0, 4.0)];
    let frame_id = "local".to_owned();
    bench.write("/operator/mission", Mission { frame_id, goals, ..Mission::default() });
    cycle(&mut bench, 0.0, 0.0, free, 12);
    cycle(&mut bench, 3.9, 0.0, free, 20);
    bench.write("/operator/mission", zone_behind());
    cycle(&mut bench, 3.9, 0.0, free, 4);
    for (serial, name) in [(100, "INIT"), (101, "RUN")] {
        let command = rcs::Command { serial, name: name.to_owned(), ..rcs::Command::default() };
        bench.write("/generator/command", command);
        cycle(&mut bench, 3.9, 0.0, free, 4);
    }
    // The local frame was placed before, and is not again.
    cycle(&mut bench, 3.9, 0.0, free, 12);
    assert!(path(&bench).last().unwrap().distance(DVec2::new(8.0, 4.0)) < 0.2, "{}", story(&bench));
    let obeyed: Mission = bench.latest("/generator/driven");
    assert_eq!((obeyed.reached, obeyed.goals.len(), obeyed.keep_out.len()), (1, 2, 1));
}

#[test]
fn a_mission_with_a_forbidden_goal_is_stated_and_the_status_names_the_goal_and_what_forbids_it() {
    let mut bench = start(&FILES[..2]);
    let frame_id = || "local".to_owned();
    let zone = polygon(&[(3.0, -1.0), (5.0, -1.0), (5.0, 1.0), (3.0, 1.0)]);
    let goals = vec![point(4.0, 0.0), point(8.0, 4.0)];
    let mission = Mission { frame_id: frame_id(), goals, keep_out: vec![zone], ..Mission::default() };
    bench.write("/operator/mission", mission);
    cycle(&mut bench, 0.0, 0.0, free, 12);
    let stated: Mission = bench.latest("/generator/driven");
    assert_eq!((stated.goals.len(), stated.keep_out.len()), (2, 1));
    assert_eq!(status(&bench, "generator").1, "goal 1 lies 1.0 m inside of a keep-out zone: stands");

    let area = Some(polygon(&[(-2.0, -2.0), (2.0, -2.0), (2.0, 2.0), (-2.0, 2.0)]));
    let goals = vec![point(5.0, 0.0)];
    bench.write("/operator/mission", Mission { frame_id: frame_id(), goals, area, ..Mission::default() });
    cycle(&mut bench, 0.0, 0.0, free, 12);
    let stated: Mission = bench.latest("/generator/driven");
    assert_eq!((stated.goals.len(), stated.keep_out.len(), stated.area.is_some()), (1, 0, true));
    assert_eq!(status(&bench, "generator").1, "the goal lies 3.0 m outside of the area: stands");

    // The same place, as the goal of a command.
    go_to(&mut bench, 300_007.0);
    cycle(&mut bench, 0.0, 0.0, free, 12);
    let stated: Mission = bench.latest("/generator/driven");
    assert_eq!((stated.goals.len(), stated.area.is_some()), (0, true));
    assert_eq!(status(&bench, "generator").1, "the goal lies 3.0 m outside of the area: stands");
}

#[test]
fn a_mission_without_goals_is_stated_with_its_zones_once() {
    let mut bench = start(&FILES[..2]);
    let goals = vec![point(8.0, 4.0)];
    let frame_id = "local".to_owned();
    bench.write("/operator/mission", Mission { frame_id, goals, ..Mission::default() });
    cycle(&mut bench, 0.0, 0.0, free, 12);
    let before = bench.sent("/generator/driven");
    bench.write("/operator/mission", Mission { keeps_goals: false, ..zone_behind() });
    cycle(&mut bench, 0.0, 0.0, free, 12);
    let stated: Mission = bench.latest("/generator/driven");
    assert_eq!((stated.goals.len(), stated.keep_out.len()), (0, 1), "{}", story(&bench));
    assert_eq!(bench.sent("/generator/driven"), before + 1);
    assert_eq!(status(&bench, "generator").1, "the mission has no goals: stands");
}

/// A mission with a zone alone, behind the vehicle.
fn zone_behind() -> Mission {
    let keep_out = vec![polygon(&[(-9.0, -1.0), (-7.0, -1.0), (-7.0, 1.0), (-9.0, 1.0)])];
    Mission { frame_id: "local".to_owned(), keep_out, keeps_goals: true, ..Mission::default() }
}
