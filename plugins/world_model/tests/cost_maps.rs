//! A world model with cost maps of several sources: which it takes, which it refuses, and what it forgets.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use glam::DVec2;
use rcs_msg::foxglove::{Grid, Odometry};
use rcs_msg::{AnyMessage, Payload, Stamp, rcs};
use rcs_runtime::{ExternalEvent, ProcessType};
use rcs_testkit::bench::{Bench, Setup};
use rcs_world::{GridView, HeightStats, Map, MapOptions, NumericType, Source, VoteRule, Weights};
use rcs_world_model::WorldModel;
use rcs_world_model::proto::{FusionWeight, FusionWeights, WorldModelParams, WorldModelStats};

const STACK: &str = r#"
format = 1
name = "cost_maps"

[[process]]
name = "wm1"
plugin = "world_model"
supervisor = "viewer"
inputs = { stereo = "/operator/stereo", costs = "/operator/costs", weights = "/operator/weights" }

[process.params]
publish_hz = 20.0
sources = [
    { name = "stereo" },
    { name = "radar", kind = "SOURCE_LEARNED", weight = 0.5 },
]
"#;

const AT: DVec2 = DVec2::new(2.1, 0.1);
const HOUR_MS: u64 = 3_600_000;

/// A bench whose vehicle stands at the origin.
fn standing(params: &[(&str, &str)]) -> Bench {
    let params: Vec<_> = [("wm1.pose.source", "POSE_FIXED")].iter().chain(params).copied().collect();
    Setup::new(STACK, &[ProcessType::of::<WorldModel>()]).params(&params).bench()
}

/// A cost map of these sources, with three heights of ground, of one cell.
fn cost_map(costs: &[(&str, u8)]) -> Grid {
    let mut map = Map::new(0.2).unwrap();
    let cell = map.grid().cell_at(AT).unwrap();
    let mut heights = HeightStats::default();
    (0..3).for_each(|_| heights.add(0.1));
    for &(source, cost) in costs {
        map.vote(cell, Source::new(source).unwrap(), cost, 1, Stamp(1), VoteRule::default());
    }
    let none = HeightStats::default();
    map.cell_mut(cell).unwrap().observe_heights(&heights, &none, 0.2, Stamp(1), VoteRule::default());
    let options = MapOptions { sources: map.sources(), heights: true, weights: Weights::default() };
    let mut grid = map.to_grid("local", Stamp(1), &options);
    // Votes, not a statement.
    let is_sensed = |name: &str| ["cost.", "ground."].iter().any(|begin| name.starts_with(begin));
    grid.fields.retain(|field| is_sensed(&field.name));
    grid
}

/// Writes a message of a time.
fn write_at<T: Payload>(bench: &mut Bench, buffer: &str, time_ms: u64, message: T) {
    let time = Stamp(time_ms * 1_000_000);
    bench.session.write(ExternalEvent::sensed(buffer, time, AnyMessage::new(message))).unwrap();
}

/// Sends a command to the world model.
fn order(bench: &mut Bench, serial: u64, name: &str) {
    bench.write("/wm1/command", rcs::Command { serial, name: name.to_owned(), ..Default::default() });
}

/// The number of a field of the map at [`AT`]; `None` if the map has no such field.
fn number(bench: &Bench, field: &str) -> Option<f64> {
    let grid: Grid = bench.latest("/wm1/map");
    let view = GridView::new(&grid).unwrap();
    let cell = ((AT - view.frame_from_grid().translation.truncate()) / view.cell_size_m()).floor();
    let field = view.field(field).ok()?;
    Some(field.get(cell.x as usize, cell.y as usize).unwrap())
}

/// Acquisition time of the map, ms.
fn map_time_ms(bench: &Bench) -> u64 {
    let map = bench.session.run().bus().get("/wm1/map").unwrap().latest().unwrap();
    map.header.acq_time.0 / 1_000_000
}

#[test]
fn a_cost_map_from_the_future_does_not_make_the_map_look_new_for_ever() {
    let mut bench = standing(&[]);
    bench.cycles(50, 4);
    let ahead_ms = bench.now_ms + HOUR_MS;
    write_at(&mut bench, "/operator/stereo", ahead_ms, cost_map(&[("stereo", 250)]));
    bench.cycles(50, 4);
    let time_ms = map_time_ms(&bench);
    assert!((150..=bench.now_ms).contains(&time_ms), "when it came: {time_ms}");
    bench.cycles(50, 4);
    assert_eq!(map_time_ms(&bench), time_ms);
    bench.cycles(50, 40);
    let age_s = bench.latest::<WorldModelStats>("/wm1/stats").source[0].age_s;
    assert!((2.0..2.6).contains(&age_s), "{age_s}");
}

#[test]
fn a_map_has_the_time_of_its_newest_data_also_after_the_clock_of_a_source_has_begun_again() {
    let mut bench = standing(&[]);
    bench.cycles(50, 240);
    let mut time_with = |buffer: &str, source: &str, time_ms: u64| {
        write_at(&mut bench, buffer, time_ms, cost_map(&[(source, 250)]));
        bench.cycles(50, 4);
        map_time_ms(&bench)
    };
    assert_eq!(time_with("/operator/stereo", "stereo", 11_500), 11_500);
    assert_eq!(time_with("/operator/stereo", "stereo", 11_000), 11_500, "it is late");
    assert_eq!(time_with("/operator/costs", "radar", 1_000), 11_500, "the clock of another source is behind");
    assert_eq!(time_with("/operator/stereo", "stereo", 1_200), 11_500, "it may be late");
    assert_eq!(time_with("/operator/stereo", "stereo", 1_400), 1_400);
    let said = ["cost.stereo", "updated_s"].map(|field| number(&bench, field));
    assert_eq!(said, [Some(250.0), Some(1.0)], "the map stays, and is not newer than its newest data");
    let why = "stereo: its clock has begun again; the map stays";
    assert_eq!(bench.faults("wm1"), (2, why.to_owned()));
    let stats = bench.latest::<WorldModelStats>("/wm1/stats");
    assert!((10.0..13.0).contains(&stats.source[0].age_s), "{}", stats.source[0].age_s);
}

#[test]
fn all_sources_of_a_cost_map_vote_where_each_cost_map_clears_the_one_before() {
    let mut bench = standing(&[("wm1.clear_each_frame", "true")]);
    for _ in 0..3 {
        bench.write("/operator/costs", cost_map(&[("stereo", 0), ("radar", 250)]));
        bench.cycles(50, 4);
        let said = ["cost.stereo", "conf.stereo", "cost.radar", "conf.radar"];
        assert_eq!(said.map(|field| number(&bench, field)), [0.0, 20.0, 250.0, 20.0].map(Some));
    }
    assert_eq!(bench.faults("wm1"), (0, String::new()));
}

#[test]
fn a_cost_map_with_one_source_that_is_wrong_is_refused_as_a_whole() {
    for clears in ["false", "true"] {
        let mut bench = standing(&[("wm1.clear_each_frame", clears)]);
        bench.write("/operator/costs", cost_map(&[("stereo", 250)]));
        bench.cycles(50, 4);
        let mut wrong = cost_map(&[("stereo", 0), ("radar", 250)]);
        let radar = wrong.fields.iter_mut().find(|field| field.name == "cost.radar").unwrap();
        radar.r#type = NumericType::Int8.into();
        bench.write("/operator/costs", wrong);
        bench.cycles(50, 4);
        let (count, last) = bench.faults("wm1");
        assert!(count == 1 && last.starts_with("costs: field \"cost.radar\" is "), "{count}: {last}");
        let said = ["cost.stereo", "conf.stereo", "ground.count"].map(|field| number(&bench, field));
        assert_eq!(said, [250.0, 20.0, 3.0].map(Some));
    }
}

#[test]
fn heights_of_a_cost_map_count_once_whatever_the_number_of_its_sources() {
    let mut bench = standing(&[]);
    bench.write("/operator/costs", cost_map(&[("stereo", 0)]));
    bench.cycles(50, 4);
    assert_eq!(number(&bench, "ground.count"), Some(3.0));
    bench.write("/operator/costs", cost_map(&[("stereo", 0), ("radar", 0)]));
    bench.cycles(50, 4);
    assert_eq!(number(&bench, "ground.count"), Some(6.0));
    // The cell is unknown to the first source.
    let mut message = cost_map(&[("stereo", 0), ("radar", 0)]);
    let stereo = message.fields.iter().find(|field| field.name == "cost.stereo").unwrap().offset as usize;
    let cells = message.data.chunks(message.cell_stride as usize);
    let data: Vec<u8> =
        cells.flat_map(|cell| [&cell[..stereo], &[255], &cell[stereo + 1..]].concat()).collect();
    message.data = data.into();
    bench.write("/operator/costs", message);
    bench.cycles(50, 4);
    assert_eq!((number(&bench, "ground.count"), number(&bench, "conf.stereo")), (Some(9.0), Some(40.0)));
}

#[test]
fn a_source_that_the_parameters_list_no_longer_is_forgotten() {
    let mut bench = standing(&[]);
    let params: WorldModelParams = bench.latest("/wm1/params");
    bench.write("/operator/costs", cost_map(&[("stereo", 0), ("radar", 250)]));
    bench.cycles(50, 4);
    assert_eq!(number(&bench, "cost"), Some(83.0), "(20 · 0 + 0.5 · 20 · 250) / (20 + 0.5 · 20)");
    let mut renamed = params.clone();
    renamed.sources[1].name = "sonar".to_owned();
    bench.write("/wm1/params", renamed);
    bench.cycles(50, 4);
    assert_eq!((number(&bench, "cost"), number(&bench, "cost.radar")), (Some(0.0), None));
    assert_eq!(number(&bench, "conf.stereo"), Some(20.0), "of the others all is known");
    bench.write("/wm1/params", params);
    bench.cycles(50, 4);
    assert_eq!((number(&bench, "cost"), number(&bench, "cost.radar")), (Some(0.0), None));
}

#[test]
fn a_long_pause_empties_the_map_once_and_what_is_seen_later_stays() {
    let stack = STACK.replace("{ name = \"stereo\" }", "{ name = \"stereo\", fade_per_s = 5.0 }");
    let params = [("wm1.pose.source", "POSE_FIXED"), ("wm1.fade_period_s", "0.1")];
    let mut bench = Setup::new(&stack, &[ProcessType::of::<WorldModel>()]).params(&params).bench();
    bench.write("/operator/stereo", cost_map(&[("stereo", 250)]));
    bench.cycles(50, 4);
    assert_eq!(number(&bench, "cost"), Some(250.0));
    order(&mut bench, 10, "HALT");
    bench.cycles(50, 4000);
    order(&mut bench, 11, "RUN");
    bench.cycles(50, 1);
    bench.write("/operator/stereo", cost_map(&[("stereo", 250)]));
    bench.cycles(50, 8);
    let confidence = number(&bench, "conf.stereo").unwrap();
    assert!((15.0..=20.0).contains(&confidence), "of one vote: {confidence}");
}

#[test]
fn a_map_that_is_emptied_is_sent_also_without_a_pose() {
    let see = |bench: &mut Bench| {
        bench.write("/operator/stereo", cost_map(&[("stereo", 250)]));
        bench.cycles(50, 4);
        assert_eq!(number(bench, "cost"), Some(250.0));
    };
    let mut bench = Setup::new(STACK, &[ProcessType::of::<WorldModel>()]).bench();
    bench.cycles(50, 4);
    assert_eq!(bench.sent("/wm1/map"), 0, "there is nothing to send yet");
    see(&mut bench);
    order(&mut bench, 10, "CLEAR");
    bench.cycles(50, 4);
    assert_eq!(number(&bench, "cost"), Some(255.0));
    // What lay in one frame does not lie in another one.
    let changes: [fn(&mut WorldModelParams); 2] = [
        |params| params.cells_per_side = 101,
        |params| params.pose.get_or_insert_default().local_frame = "map".to_owned(),
    ];
    for change in changes {
        see(&mut bench);
        let mut params: WorldModelParams = bench.latest("/wm1/params");
        change(&mut params);
        bench.write("/wm1/params", params);
        bench.cycles(50, 4);
        assert_eq!(number(&bench, "cost"), Some(255.0));
    }
    assert_eq!(bench.latest::<Grid>("/wm1/map").frame_id, "map");
}

/// A bench whose vehicle is where odometry says.
fn placed() -> Bench {
    let stack = STACK.replace("inputs = {", "inputs = { odometry = \"/operator/odometry\",");
    Setup::new(&stack, &[ProcessType::of::<WorldModel>()]).bench()
}

/// Says that the vehicle was this far east at a time, m.
fn place_at(bench: &mut Bench, time_ms: u64, x_m: f64) {
    let pose = Some(rcs_msg::foxglove::Pose {
        position: Some(rcs_msg::foxglove::Vector3 { x: x_m, ..Default::default() }),
        orientation: Some(rcs_msg::foxglove::Quaternion { w: 1.0, ..Default::default() }),
    });
    let odometry = Odometry { frame_id: "local".to_owned(), pose, ..Odometry::default() };
    write_at(bench, "/operator/odometry", time_ms, odometry);
    bench.cycles(50, 4);
}

#[test]
fn poses_whose_clock_begins_again_clear_the_map() {
    let mut bench = placed();
    bench.cycles(50, 240);
    place_at(&mut bench, 12_000, 0.0);
    bench.write("/operator/stereo", cost_map(&[("stereo", 250)]));
    // Of the new clock, the first two count as late.
    for (time_ms, cost) in [(12_200, 250.0), (1_000, 250.0), (1_200, 250.0), (1_400, 255.0)] {
        place_at(&mut bench, time_ms, 0.0);
        assert_eq!(number(&bench, "cost"), Some(cost), "{time_ms}");
    }
    let why = "the clock of the poses has begun again; the map is cleared";
    assert_eq!(bench.faults("wm1"), (1, why.to_owned()));
    bench.write("/operator/stereo", cost_map(&[("stereo", 250)]));
    place_at(&mut bench, 1_600, 0.0);
    assert_eq!(number(&bench, "cost"), Some(250.0), "it goes on");
}

#[test]
fn a_local_frame_that_begins_again_clears_the_map() {
    let mut bench = placed();
    let place = |bench: &mut Bench, x_m: f64| {
        let time_ms = bench.now_ms;
        place_at(bench, time_ms, x_m);
    };
    place(&mut bench, 0.0);
    bench.write("/operator/stereo", cost_map(&[("stereo", 250)]));
    for x_m in [0.0, 2.0, 4.0, 8.0] {
        place(&mut bench, x_m);
        assert_eq!(number(&bench, "cost"), Some(250.0), "driven to {x_m} m");
    }
    assert_eq!(bench.faults("wm1"), (0, String::new()));
    place(&mut bench, 0.0);
    assert_eq!(number(&bench, "cost"), Some(255.0));
    let why = "the pose in the local frame leapt by 8.0 m; the map is cleared";
    assert_eq!(bench.faults("wm1"), (1, why.to_owned()));
}

#[test]
fn learned_weights_count_until_the_parameters_change_and_wrong_ones_are_refused() {
    let mut bench = standing(&[]);
    bench.write("/operator/costs", cost_map(&[("stereo", 0), ("radar", 250)]));
    let cost = |bench: &mut Bench, weights: Option<[f64; 2]>| {
        if let Some([weight, given]) = weights {
            let weights = vec![FusionWeight { source: "radar".to_owned(), weight, given }];
            bench.write("/operator/weights", FusionWeights { weights, ..FusionWeights::default() });
        }
        bench.cycles(50, 4);
        number(bench, "cost").unwrap()
    };
    assert_eq!(cost(&mut bench, None), 83.0);
    assert_eq!(cost(&mut bench, Some([0.25, 0.5])), 50.0);
    assert_eq!(bench.faults("wm1"), (0, String::new()));
    assert_eq!(cost(&mut bench, Some([-1.0, 0.5])), 50.0, "those before go on");
    let why = "weights: weight of radar is -1, expected 0 to 1; skipped";
    assert_eq!(bench.faults("wm1"), (1, why.to_owned()));
    assert_eq!(cost(&mut bench, Some([0.25, 0.4])), 83.0, "learned from other parameters");
    assert_eq!(cost(&mut bench, Some([0.25, 0.5])), 50.0);
    order(&mut bench, 10, "INIT");
    bench.cycles(50, 4);
    order(&mut bench, 11, "RUN");
    bench.write("/operator/costs", cost_map(&[("stereo", 0), ("radar", 250)]));
    assert_eq!(cost(&mut bench, None), 50.0, "INIT empties the map, and the weights go on");
    let mut params: WorldModelParams = bench.latest("/wm1/params");
    params.sources[1].weight = 1.0;
    bench.write("/wm1/params", params);
    assert_eq!(cost(&mut bench, None), 125.0);
}
