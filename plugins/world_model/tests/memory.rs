//! A world model and its map memory: cost maps and the map of an earlier run in, the fused map and the map to save out.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

#[path = "memory/kept.rs"]
mod kept;

use glam::DVec2;
use rcs_geom::{Pose, Utm};
use rcs_msg::foxglove::{FrameTransform, FrameTransforms, Grid, Odometry, Quaternion, Vector3};
use rcs_msg::{Stamp, rcs};
use rcs_runtime::{CommandSet, ProcessType};
use rcs_sense::{CostGrid, GridFrame, pose_message};
use rcs_testkit::bench::{Bench, Setup};
use rcs_world::GridView;
use rcs_world_model::memory::{Rectangle, parse};
use rcs_world_model::proto::{MapMemory, MapMemoryParams, WorldModelParams};
use rcs_world_model::{MapMemoryCommand, MapMemoryKeeper, WorldModel};

const STACK: &str = r#"
format = 1
name = "memory"

[[process]]
name = "wm"
plugin = "world_model"
supervisor = "viewer"
inputs = { stereo = "/operator/stereo", costs = "/memory/cost", odometry = "/operator/odometry" }

[process.params]
cell_size_m = 0.4
sources = [
    { name = "stereo" },
    { name = "memory", kind = "SOURCE_LEARNED", weight = 0.2, fade_per_s = 0.0 },
]

[[process]]
name = "memory"
plugin = "map_memory"
supervisor = "viewer"
inputs = { map = "/wm/map", odometry = "/operator/odometry", transforms = "/operator/transforms", plan = "/operator/plan" }

[process.params]
save_every_s = 1.0
"#;

/// The files that the stack names: the name of a map is its text.
struct Files;

impl rcs_runtime::Assets for Files {
    fn read(&self, kind: &str, name: &str, _beside: &str) -> Result<rcs_runtime::Asset, String> {
        let world = "[origin]\nzone = 18\neasting_m = 300000.0\nnorthing_m = 4000000.0\n";
        let text = if kind == "world" { world } else { name };
        Ok(rcs_runtime::Asset { file: "file".to_owned(), text: text.to_owned() })
    }
}

/// A bench whose local frame is the global one, moved by (2, 3) m.
fn start(memory: &str) -> Bench {
    let params = [("memory.memory", memory)];
    start_with(STACK, if memory.is_empty() { &[] } else { &params })
}

/// The same with a stack and parameters.
fn start_with(stack: &str, params: &[(&str, &str)]) -> Bench {
    let types = [ProcessType::of::<WorldModel>(), ProcessType::of::<MapMemoryKeeper>()];
    let params = [&[("memory.world", "w")][..], params].concat();
    let mut bench = Setup::new(stack, &types).params(&params).assets(&Files).bench();
    locate(&mut bench, Stamp(1), DVec2::new(2.0, 3.0));
    bench
}

/// States where the local frame lies in the global one, m.
fn locate(bench: &mut Bench, time: Stamp, at: DVec2) {
    let transform = FrameTransform {
        timestamp: Some(time.to_proto()),
        parent_frame_id: "global".to_owned(),
        child_frame_id: "local".to_owned(),
        translation: Some(Vector3 { x: at.x, y: at.y, z: 0.0 }),
        rotation: Some(Quaternion { w: 1.0, ..Quaternion::default() }),
    };
    bench.write("/operator/transforms", FrameTransforms { transforms: vec![transform] });
}

/// Where the registration says that the frame of the remembered map lies in the local frame, m.
fn registered(bench: &Bench) -> Option<DVec2> {
    let message: FrameTransforms = bench.latest("/memory/registration");
    message.transforms.first().and_then(|at| at.translation).map(|at| DVec2::new(at.x, at.y))
}

/// An L of walls whose corner is at (3, -3) m, and a wall 9 m ahead of the origin; ground elsewhere.
fn ground_truth(at: DVec2) -> u8 {
    let from_corner = at - DVec2::new(3.0, -3.0);
    let on = |along: f64, across: f64| (0.0..5.0).contains(&along) && (0.0..0.8).contains(&across);
    let is_wall = on(from_corner.x, from_corner.y) || on(from_corner.y, from_corner.x);
    if is_wall || (at.x - 9.0).abs() < 0.5 { 250 } else { 0 }
}

/// Cycles in which the ground within a distance of the vehicle is sensed, m.
fn look(bench: &mut Bench, vehicle: DVec2, within_m: f64, truth: impl Fn(DVec2) -> u8, count: usize) {
    for _ in 0..count {
        let pose = Some(pose_message(&Pose::from_translation(vehicle.extend(0.0))));
        bench.write(
            "/operator/odometry",
            Odometry { frame_id: "local".to_owned(), pose, ..Odometry::default() },
        );
        let mut costs = CostGrid::new(GridFrame::around(vehicle, 61, 0.4));
        let frame = *costs.frame();
        for slot in 0..frame.side * frame.side {
            let at = frame.middle(slot % frame.side, slot / frame.side);
            if at.distance(vehicle) < within_m {
                costs.costs_mut()[slot] = truth(at);
            }
        }
        let now = Stamp(bench.now_ms * 1_000_000 + 1);
        bench.write("/operator/stereo", costs.into_message("stereo", "local", now));
        bench.cycles(50, 2);
    }
}

/// Drives from place to place, m, in steps, and senses hardly anything on the way.
fn go(bench: &mut Bench, from: DVec2, to: DVec2) {
    for step in 1..10 {
        look(bench, from.lerp(to, f64::from(step) / 10.0), 0.2, |_| 0, 4);
    }
}

fn text(bench: &Bench) -> String {
    bench.latest::<rcs::Status>("/memory/status").state_text
}

/// Fused cost of the world model at a place, m; 255 for unknown.
fn cost_at(bench: &Bench, at: DVec2) -> u8 {
    let grid: Grid = bench.latest("/wm/map");
    Rectangle::of_grid(&GridView::new(&grid).unwrap()).unwrap().at(at)
}

/// The map that a first run saves, as the text of its file.
fn first_run() -> String {
    let mut bench = start("");
    look(&mut bench, DVec2::ZERO, 12.0, ground_truth, 40);
    assert_eq!(text(&bench), "nothing is remembered; saves the map");
    file_of(bench.latest("/memory/memory"))
}

/// The text of the file of a map.
fn file_of(map: MapMemory) -> String {
    rcs_msg::to_json(&rcs_msg::AnyMessage::new(map)).unwrap()
}

/// The file of a map that is changed.
fn changed(file: &str, change: fn(&mut MapMemory)) -> String {
    let mut map = parse(file).unwrap().unwrap();
    change(&mut map);
    file_of(map)
}

/// Sets the remembered map while the process runs.
fn give(bench: &mut Bench, memory: &str) {
    let params: MapMemoryParams = bench.latest("/memory/params");
    bench.write("/memory/params", MapMemoryParams { memory: memory.to_owned(), ..params });
}

fn say(bench: &mut Bench, process: &str, command: &impl CommandSet) {
    let encoded = command.encode();
    let (parameters_schema, parameters) = encoded.parameters;
    let (name, parameters) = (encoded.name.to_owned(), parameters.into());
    let serial = 100 + bench.now_ms;
    let command = rcs::Command { serial, name, parameters_schema, parameters, timestamp: None };
    bench.write(&format!("/{process}/command"), command);
}

/// A command of the runtime.
fn order(bench: &mut Bench, process: &str, name: &str) {
    let command = rcs::Command { serial: 100 + bench.now_ms, name: name.to_owned(), ..Default::default() };
    bench.write(&format!("/{process}/command"), command);
}

#[test]
fn save_saves_at_once_also_while_no_new_map_comes() {
    let mut bench = start("");
    look(&mut bench, DVec2::ZERO, 12.0, ground_truth, 40);
    bench.write("/wm/command", rcs::Command { serial: 99, name: "HALT".to_owned(), ..Default::default() });
    bench.cycles(50, 60);
    let before = bench.sent("/memory/memory");
    bench.cycles(50, 60);
    assert_eq!(bench.sent("/memory/memory"), before, "there is nothing new to save");
    say(&mut bench, "memory", &MapMemoryCommand::Save);
    bench.cycles(50, 60);
    assert_eq!(bench.sent("/memory/memory"), before + 1);
}

#[test]
fn what_was_seen_before_clear_is_not_saved() {
    let mut bench = start("");
    look(&mut bench, DVec2::ZERO, 4.0, ground_truth, 40);
    let saved: MapMemory = bench.latest("/memory/memory");
    assert!(saved.columns > 10);
    let here = DVec2::new(60.0, 0.0);
    for process in ["wm", "memory"] {
        say(&mut bench, process, &MapMemoryCommand::Clear);
    }
    look(&mut bench, here, 0.5, |_| 0, 20);
    let saved: MapMemory = bench.latest("/memory/memory");
    assert!((1..5).contains(&saved.columns), "{} columns", saved.columns);
    // A vehicle that stands, and a map from before that may be unread then.
    for count in 40..45 {
        let mut bench = start("");
        look(&mut bench, DVec2::ZERO, 4.0, ground_truth, count);
        for process in ["wm", "memory"] {
            say(&mut bench, process, &MapMemoryCommand::Clear);
        }
        look(&mut bench, DVec2::ZERO, 0.5, |_| 0, 20);
        let saved: MapMemory = bench.latest("/memory/memory");
        assert!((1..5).contains(&saved.columns), "{} columns after {count}", saved.columns);
    }
}

#[test]
fn what_was_near_is_saved_in_global_coordinates() {
    let saved = parse(&first_run()).unwrap().unwrap();
    let origin = Utm::new(18, true, 300_000.0, 4_000_000.0).unwrap();
    let map = Rectangle::of_memory(&saved, &origin).unwrap();
    let at = |x: f64, y: f64| map.at(DVec2::new(x, y) + DVec2::new(2.0, 3.0));
    assert_eq!((at(3.4, 0.1), at(1.0, 1.0)), (250, 0));
    assert_eq!(at(9.1, 0.1), 255, "farther than near_m");
}

#[test]
fn a_remembered_map_is_registered_before_it_is_believed_and_what_is_sensed_outvotes_it() {
    // This run believes to be 1.2 m farther east and 0.8 m farther south than the first one did.
    let moved = DVec2::new(1.2, -0.8);
    let mut bench = start(&first_run());
    let away = DVec2::new(-30.0, 0.0);
    look(&mut bench, away, 4.0, |_| 0, 20);
    assert!(text(&bench).starts_with("waits: 0 obstacle cells can be compared"), "{}", text(&bench));
    assert_eq!(cost_at(&bench, DVec2::new(3.4, 0.1) + moved), 255);
    // The upright wall of the L is gone.
    let now = |at: DVec2| {
        let at = at - moved;
        if (2.9..3.9).contains(&at.x) && at.y > -1.0 { 0 } else { ground_truth(at) }
    };
    look(&mut bench, DVec2::new(4.0, -1.5) + moved, 2.5, now, 40);
    assert!(text(&bench).starts_with("remembers: moved by 1."), "{}", text(&bench));
    let placed = registered(&bench).unwrap();
    assert!(placed.distance(moved - DVec2::new(2.0, 3.0)) < 0.6, "{placed}");
    assert_eq!(cost_at(&bench, DVec2::new(7.4, -2.8) + moved), 250, "remembered, and not sensed");
    assert!(cost_at(&bench, DVec2::new(3.4, 0.1) + moved) < 125, "sensed ground");
    say(&mut bench, "memory", &MapMemoryCommand::Clear);
    bench.cycles(50, 60);
    assert_eq!(text(&bench), "the remembered map is cleared");
    assert_eq!(cost_at(&bench, DVec2::new(7.4, -2.8) + moved), 255);
    assert_eq!(registered(&bench), None);
}

#[test]
fn until_the_remembered_map_is_believed_or_rejected_it_is_saved_as_it_was() {
    let first = first_run();
    let remembered = parse(&first).unwrap().unwrap();
    let saved = |bench: &Bench| bench.latest::<MapMemory>("/memory/memory");
    let mut bench = start(&first);
    look(&mut bench, DVec2::new(-30.0, 0.0), 4.0, |_| 0, 20);
    assert!(text(&bench).starts_with("waits: 0 obstacle cells can be compared"), "{}", text(&bench));
    assert_eq!(saved(&bench), remembered);
    // Once it is believed, what this run has seen before is added.
    let here = DVec2::new(4.0, -1.5);
    go(&mut bench, DVec2::new(-30.0, 0.0), here);
    assert_eq!(bench.faults("memory"), (0, String::new()));
    look(&mut bench, here, 2.5, ground_truth, 60);
    assert!(text(&bench).starts_with("remembers: "), "{}", text(&bench));
    assert!(saved(&bench).columns > remembered.columns + 50, "{} columns", saved(&bench).columns);
    // A map that does not fit gives way to that of this run.
    let mut bench = start(&first);
    let posts = |at: DVec2| if (at / 1.6).floor().element_sum() as i64 % 2 == 0 { 250 } else { 0 };
    look(&mut bench, DVec2::ZERO, 8.0, posts, 60);
    assert!(text(&bench).starts_with("the remembered map does not fit: "), "{}", text(&bench));
    let of_this_run = saved(&bench);
    assert_ne!(of_this_run, remembered);
    // It stays rejected where there is nothing to compare.
    let away = DVec2::new(-40.0, 0.0);
    go(&mut bench, DVec2::ZERO, away);
    look(&mut bench, away, 4.0, |_| 0, 40);
    assert!(saved(&bench).columns > of_this_run.columns, "{} columns", saved(&bench).columns);
    // One that is cleared does not come back.
    let mut bench = start(&first);
    look(&mut bench, DVec2::new(-30.0, 0.0), 4.0, |_| 0, 20);
    say(&mut bench, "memory", &MapMemoryCommand::Clear);
    look(&mut bench, DVec2::new(-30.0, 0.0), 4.0, |_| 0, 20);
    assert!(saved(&bench).columns < remembered.columns, "{} columns", saved(&bench).columns);
}

#[test]
fn a_registered_map_stays_in_the_local_frame_while_the_position_estimate_changes() {
    let mut bench = start(&first_run());
    look(&mut bench, DVec2::ZERO, 8.0, ground_truth, 40);
    let before = registered(&bench).unwrap();
    // Fixes move the estimate by 2 m east, where there is nothing to compare.
    let now = Stamp(bench.now_ms * 1_000_000 + 1);
    locate(&mut bench, now, DVec2::new(4.0, 3.0));
    // Less than 10 m/s: it drives, and the local frame does not begin again.
    for x_m in [-5.0, -10.0, -15.0] {
        look(&mut bench, DVec2::new(x_m, 0.0), 0.2, ground_truth, 8);
    }
    look(&mut bench, DVec2::new(-20.0, 0.0), 4.0, |_| 0, 20);
    assert_eq!(registered(&bench), Some(before));
    assert!(text(&bench).starts_with("remembers: moved by 2.0 m"), "{}", text(&bench));
    assert_eq!(cost_at(&bench, DVec2::new(7.4, -2.8)), 250);
    // 5 m are more than the errors of two fixes.
    let now = Stamp(bench.now_ms * 1_000_000 + 1);
    locate(&mut bench, now, DVec2::new(7.0, 3.0));
    look(&mut bench, DVec2::new(-20.0, 0.0), 4.0, |_| 0, 20);
    assert_eq!(registered(&bench), None);
}

/// A corridor along x, 3.2 m wide, with a niche each 6 m.
fn corridor(at: DVec2) -> u8 {
    let across_m = at.y.abs() - if at.x.rem_euclid(6.0) < 1.6 { 0.8 } else { 0.0 };
    if (1.6..2.4).contains(&across_m) { 250 } else { 0 }
}

/// Drives along x in a world that is turned in the local frame, rad.
fn drive(bench: &mut Bench, from_m: i32, to_m: i32, turned_rad: f64) {
    for half_metres in 2 * from_m..2 * to_m {
        let vehicle = DVec2::from_angle(turned_rad) * (f64::from(half_metres) / 2.0);
        look(bench, vehicle, 5.0, |at| corridor(DVec2::from_angle(-turned_rad).rotate(at)), 2);
    }
}

#[test]
fn a_map_is_turned_by_which_the_headings_of_both_runs_differ() {
    let mut bench = start("");
    drive(&mut bench, -20, 30, 0.0);
    let saved = file_of(bench.latest("/memory/memory"));
    for turned_rad in [0.0_f64, 0.05, -0.05] {
        let mut bench = start(&saved);
        drive(&mut bench, -20, 8, turned_rad);
        assert!(text(&bench).starts_with("remembers: "), "{}", text(&bench));
        let message: FrameTransforms = bench.latest("/memory/registration");
        // The angle is small.
        let yaw_rad = 2.0 * message.transforms[0].rotation.unwrap().z;
        // A cell at half of the length that is compared.
        assert!((yaw_rad - turned_rad).abs() < 0.4 / 20.0, "{yaw_rad} for {turned_rad}");
        // 14 m ahead, where nothing is sensed yet, the corridor is where it is.
        let ahead = |y: f64| DVec2::from_angle(turned_rad).rotate(DVec2::new(22.2, y));
        let free = [-0.4, 0.0, 0.4].map(|y| cost_at(&bench, ahead(y)));
        let walls =
            [-1.0, 1.0].map(|side| [1.3, 1.7, 2.1, 2.5, 2.9].map(|y| cost_at(&bench, ahead(side * y))));
        assert!(free.iter().all(|&cost| cost < 125), "{free:?} for {turned_rad}");
        assert!(walls.iter().all(|wall| wall.iter().any(|&cost| cost > 190)), "{walls:?} for {turned_rad}");
    }
}

#[test]
fn a_remembered_map_that_leaves_no_way_is_dropped() {
    let mut bench = start(&first_run());
    let here = DVec2::new(4.0, -1.5);
    let plan = |state: rcs::PlanState| rcs::Plan { state: state.into(), ..rcs::Plan::default() };
    look(&mut bench, here, 2.5, ground_truth, 40);
    let behind = DVec2::new(7.4, -2.8);
    assert_eq!(cost_at(&bench, behind), 250);
    // One that finds a way in between is no reason.
    for state in [rcs::PlanState::PlanNoWay, rcs::PlanState::PlanPath] {
        bench.write("/operator/plan", plan(state));
        look(&mut bench, here, 2.5, ground_truth, 40);
        assert!(text(&bench).starts_with("remembers: "), "{}", text(&bench));
    }
    bench.write("/operator/plan", plan(rcs::PlanState::PlanNoWay));
    look(&mut bench, here, 2.5, ground_truth, 80);
    assert_eq!(text(&bench), "the remembered map leaves no way to the goal: not used");
    assert_eq!((cost_at(&bench, behind), registered(&bench)), (255, None));
}

#[test]
fn a_map_of_another_place_is_rejected_with_the_reason() {
    let mut bench = start(&first_run());
    let posts = |at: DVec2| if (at / 1.6).floor().element_sum() as i64 % 2 == 0 { 250 } else { 0 };
    look(&mut bench, DVec2::ZERO, 8.0, posts, 40);
    assert!(text(&bench).starts_with("the remembered map does not fit: "), "{}", text(&bench));
    assert!(bench.newest::<Grid>("/memory/cost").is_none(), "nothing is stated");
}

#[test]
fn a_map_that_begins_far_away_is_waited_for_and_the_status_says_how_far() {
    let (first, here) = (first_run(), DVec2::new(4.0, -1.5));
    let mut bench = start(&changed(&first, |map| map.easting_m += 190_000.0));
    look(&mut bench, here, 2.5, ground_truth, 20);
    let saves = "drives without it, and saves it as it was";
    assert_eq!(text(&bench), format!("the remembered map begins 190.0 km from here: {saves}"));
    give(&mut bench, &changed(&first, |map| map.easting_m += 300.0));
    look(&mut bench, here, 2.5, ground_truth, 20);
    assert_eq!(text(&bench), format!("the remembered map begins 288 m from here: {saves}"));
    // The position estimate comes to it.
    let now = Stamp(bench.now_ms * 1_000_000 + 1);
    locate(&mut bench, now, DVec2::new(302.0, 3.0));
    look(&mut bench, here, 2.5, ground_truth, 40);
    assert!(text(&bench).starts_with("remembers: "), "{}", text(&bench));
}

#[test]
fn another_map_in_the_parameters_inherits_nothing_of_the_one_before() {
    let (first, here, behind) = (first_run(), DVec2::new(4.0, -1.5), DVec2::new(7.4, -2.8));
    for (memory, expected) in [
        (String::new(), "nothing is remembered; saves the map"),
        (changed(&first, |map| map.zone = 17), "memory: the map is in UTM zone 17, expected zone 18"),
        (changed(&first, |map| map.easting_m += 100.0), "waits: 0 obstacle cells can be compared"),
    ] {
        let mut bench = start(&first);
        look(&mut bench, here, 2.5, ground_truth, 40);
        // The same map once more is no other one.
        give(&mut bench, &first);
        look(&mut bench, here, 2.5, ground_truth, 10);
        assert!(text(&bench).starts_with("remembers: "), "{}", text(&bench));
        assert_eq!(cost_at(&bench, behind), 250);
        give(&mut bench, &memory);
        look(&mut bench, here, 2.5, ground_truth, 20);
        assert!(text(&bench).starts_with(expected), "{}", text(&bench));
        assert_eq!((cost_at(&bench, behind), registered(&bench)), (255, None));
    }
    // What is cleared is the map before.
    let mut bench = start(&first);
    look(&mut bench, here, 2.5, ground_truth, 10);
    say(&mut bench, "memory", &MapMemoryCommand::Clear);
    look(&mut bench, here, 2.5, ground_truth, 10);
    assert_eq!(text(&bench), "the remembered map is cleared");
    give(&mut bench, &changed(&first, |map| map.easting_m += 0.4));
    look(&mut bench, here, 2.5, ground_truth, 40);
    assert!(text(&bench).starts_with("remembers: "), "{}", text(&bench));
}

#[test]
fn what_was_stated_before_init_is_taken_back() {
    let (first, here, behind) = (first_run(), DVec2::new(4.0, -1.5), DVec2::new(7.4, -2.8));
    for (memory, expected) in [
        (String::new(), "nothing is remembered; saves the map"),
        (changed(&first, |map| map.easting_m += 100.0), "waits: 0 obstacle cells can be compared"),
    ] {
        let mut bench = start(&first);
        look(&mut bench, here, 2.5, ground_truth, 40);
        assert_eq!(cost_at(&bench, behind), 250);
        order(&mut bench, "memory", "INIT");
        give(&mut bench, &memory);
        look(&mut bench, here, 2.5, ground_truth, 6);
        order(&mut bench, "memory", "RUN");
        // The local frame is not sent again.
        look(&mut bench, here, 2.5, ground_truth, 20);
        assert!(text(&bench).starts_with(expected), "{}", text(&bench));
        assert_eq!((cost_at(&bench, behind), registered(&bench)), (255, None));
    }
}

#[test]
fn a_map_that_the_next_run_would_refuse_is_reported_and_saved_once_it_can_be() {
    let mut bench = start_with(STACK, &[("memory.save_every_s", "3600")]);
    locate(&mut bench, Stamp(2), DVec2::new(-400_000.0, 3.0));
    look(&mut bench, DVec2::ZERO, 4.0, |_| 0, 20);
    say(&mut bench, "memory", &MapMemoryCommand::Save);
    look(&mut bench, DVec2::ZERO, 4.0, |_| 0, 20);
    let expected = "nothing is remembered; the map is not saved: the corner is at easting -10000";
    assert!(text(&bench).starts_with(expected), "{}", text(&bench));
    assert_eq!(bench.sent("/memory/memory"), 0);
    let now = Stamp(bench.now_ms * 1_000_000 + 1);
    locate(&mut bench, now, DVec2::new(2.0, 3.0));
    look(&mut bench, DVec2::ZERO, 4.0, |_| 0, 20);
    assert_eq!(text(&bench), "nothing is remembered; saves the map");
    assert_eq!(bench.sent("/memory/memory"), 1, "it was told to save");
}

#[test]
fn a_map_that_is_too_large_to_save_is_reported_and_saved_once_it_can_be() {
    let mut bench = start_with(STACK, &[("memory.save_every_s", "3600")]);
    look(&mut bench, DVec2::ZERO, 4.0, |_| 0, 20);
    // It has time to drive there.
    bench.cycles(50, 3000);
    let far = DVec2::splat(1000.0);
    look(&mut bench, far, 4.0, |_| 0, 20);
    assert_eq!(bench.sent("/memory/memory"), 1);
    say(&mut bench, "memory", &MapMemoryCommand::Save);
    look(&mut bench, far, 4.0, |_| 0, 20);
    let expected = "nothing is remembered; the map is not saved: the map would have 25";
    assert!(text(&bench).starts_with(expected), "{}", text(&bench));
    assert_eq!(bench.sent("/memory/memory"), 1, "the old map is not sent again");
    // With larger cells there are fewer of them.
    let params: WorldModelParams = bench.latest("/wm/params");
    bench.write("/wm/params", WorldModelParams { cell_size_m: 1.0, ..params });
    look(&mut bench, far, 4.0, |_| 0, 20);
    assert_eq!(text(&bench), "nothing is remembered; saves the map");
    assert_eq!(bench.sent("/memory/memory"), 2, "it was told to save");
    assert_eq!(bench.faults("memory"), (0, String::new()));
}

#[test]
fn one_pose_far_away_does_not_keep_the_map_from_being_saved() {
    let mut bench = start_with(STACK, &[("memory.save_every_s", "3600")]);
    look(&mut bench, DVec2::ZERO, 4.0, |_| 0, 20);
    look(&mut bench, DVec2::splat(1e5), 4.0, |_| 0, 1);
    look(&mut bench, DVec2::X, 4.0, |_| 0, 20);
    say(&mut bench, "memory", &MapMemoryCommand::Save);
    look(&mut bench, DVec2::X, 4.0, |_| 0, 20);
    assert_eq!(text(&bench), "nothing is remembered; saves the map");
    assert_eq!(bench.sent("/memory/memory"), 2);
}

#[test]
fn where_the_local_frame_begins_again_what_was_saved_stays_until_it_is_registered_anew() {
    let origin = Utm::new(18, true, 300_000.0, 4_000_000.0).unwrap();
    for memory in [String::new(), first_run()] {
        let mut bench = start(&memory);
        look(&mut bench, DVec2::ZERO, 12.0, ground_truth, 60);
        let before: MapMemory = bench.latest("/memory/memory");
        // The vehicle stands where it was.
        let (here, now) = (DVec2::new(60.0, 0.0), Stamp(bench.now_ms * 1_000_000 + 1));
        locate(&mut bench, now, DVec2::new(2.0, 3.0) - here);
        look(&mut bench, here, 0.5, |_| 0, 30);
        let fault = "the pose in the local frame leapt by 60.0 m; what was saved before is registered anew";
        assert_eq!(bench.faults("memory"), (1, fault.to_owned()));
        let waits = "waits: 0 obstacle cells can be compared with the remembered map, expected 40";
        let stays = "what was saved before the local frame began again stays until it is registered";
        assert_eq!(text(&bench), format!("{waits}; the map is not saved: {stays}"));
        assert_eq!((registered(&bench), bench.latest::<MapMemory>("/memory/memory")), (None, before));
        look(&mut bench, here + DVec2::new(4.0, -1.5), 2.5, |at| ground_truth(at - here), 60);
        let text = text(&bench);
        assert!(text.starts_with("remembers: moved by 0.") && !text.contains("not saved"), "{text}");
        assert_eq!(cost_at(&bench, here + DVec2::new(7.4, -2.8)), 250, "remembered, and not sensed");
        let saved: MapMemory = bench.latest("/memory/memory");
        let saved = Rectangle::of_memory(&saved, &origin).unwrap();
        assert_eq!(saved.at(DVec2::new(-4.0, 0.0) + DVec2::new(2.0, 3.0)), 0, "seen before alone");
        // A route lies in the frame of the map that was given, and in no other.
        let is_placed = registered(&bench).map(|at| at.distance(here - DVec2::new(2.0, 3.0)) < 0.6);
        assert_eq!(is_placed, (!memory.is_empty()).then_some(true));
    }
}

#[test]
fn a_map_that_was_lost_must_fit_for_as_many_messages_in_turn_again() {
    let mut bench = start(&first_run());
    look(&mut bench, DVec2::ZERO, 8.0, ground_truth, 40);
    assert!(text(&bench).starts_with("remembers: "), "{}", text(&bench));
    // Fixes move the estimate too far for one message.
    for (at, expected, end) in [
        (DVec2::new(7.0, 3.0), "the remembered map lies more than 4 m from", ": not used"),
        (DVec2::new(2.0, 3.0), "the remembered map may fit: ", "1 of 4 times in turn"),
    ] {
        let now = Stamp(bench.now_ms * 1_000_000 + 1);
        locate(&mut bench, now, at);
        let before = bench.sent("/memory/registration");
        for _ in 0..20 {
            if bench.sent("/memory/registration") == before {
                look(&mut bench, DVec2::ZERO, 8.0, ground_truth, 1);
            }
        }
        let text = text(&bench);
        assert!(text.starts_with(expected) && text.ends_with(end), "{text}");
        assert_eq!(registered(&bench), None, "{text}");
    }
    look(&mut bench, DVec2::ZERO, 8.0, ground_truth, 40);
    assert!(text(&bench).starts_with("remembers: "), "{}", text(&bench));
}

#[test]
fn a_map_and_a_pose_in_another_frame_are_faults_and_are_skipped() {
    let mut bench = start_with(&STACK.replace("map = \"/wm/map\"", "map = \"/operator/map\""), &[]);
    look(&mut bench, DVec2::ZERO, 8.0, ground_truth, 20);
    let map: Grid = bench.latest("/wm/map");
    for (frame, saved) in [("map", 0), ("local", 1)] {
        bench.write("/operator/map", Grid { frame_id: frame.to_owned(), ..map.clone() });
        bench.cycles(50, 30);
        assert_eq!(bench.sent("/memory/memory"), saved, "{frame}");
        let fault = "map: frame is \"map\", expected \"local\"; skipped";
        assert_eq!(bench.faults("memory"), (1, fault.to_owned()));
    }
    let pose = Some(pose_message(&Pose::IDENTITY));
    bench.write("/operator/odometry", Odometry { frame_id: "map".to_owned(), pose, ..Odometry::default() });
    bench.cycles(50, 30);
    let fault = "odometry: frame is \"map\", expected \"local\"; skipped";
    assert_eq!(bench.faults("memory"), (2, fault.to_owned()));
    assert_eq!(text(&bench), "waits for the pose of the vehicle");
    look(&mut bench, DVec2::ZERO, 8.0, ground_truth, 10);
    assert_eq!(text(&bench), "nothing is remembered; saves the map");
}
