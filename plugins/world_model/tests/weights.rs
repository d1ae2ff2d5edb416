//! A world model and the process that adjusts its weights: cost maps in, weights and the fused map out.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use glam::DVec2;
use rcs_geom::Pose;
use rcs_msg::foxglove::{Grid, Odometry};
use rcs_msg::{Stamp, rcs};
use rcs_runtime::ProcessType;
use rcs_sense::pose_message;
use rcs_testkit::bench::{Bench, Setup};
use rcs_world::{Map, MapOptions, Source, VoteRule, Weights};
use rcs_world_model::proto::{
    FusionWeights, WeightLearnerParams, WorldModelParams, WorldModelSourceKind, WorldModelStats,
};
use rcs_world_model::{WeightLearner, WorldModel};

const STACK: &str = r#"
format = 1
name = "weights"

[[process]]
name = "wm1"
plugin = "world_model"
supervisor = "viewer"
inputs = { stereo = "/operator/stereo", terrain = "/operator/terrain", bumper = "/operator/bumper", weights = "/learner/weights", odometry = "/operator/odometry" }

[process.params]
publish_hz = 2.0
sources = [
    { name = "stereo" },
    { name = "terrain", kind = "SOURCE_LEARNED", weight = 0.4 },
    { name = "bumper", kind = "SOURCE_OVERRIDE", fade_per_s = 0.0 },
]

[[process]]
name = "learner"
plugin = "weight_learner"
supervisor = "viewer"
inputs = { map = "/wm1/map", params = "/wm1/params" }
"#;

fn bench() -> Bench {
    Setup::new(STACK, &[ProcessType::of::<WorldModel>(), ProcessType::of::<WeightLearner>()]).bench()
}

/// Costs of a source at positions, m; a state if the source is learned terrain.
fn costs(source: Source, vehicle_m: f64, costs: &[(DVec2, u8)], time: Stamp) -> Grid {
    let mut map = Map::new(0.2).unwrap();
    map.recentre(DVec2::new(vehicle_m, 0.0));
    for &(at, cost) in costs {
        map.vote(
            map.grid().cell_at(at).unwrap(),
            source,
            cost,
            1,
            time,
            VoteRule { rise: 80, ..VoteRule::default() },
        );
    }
    let options =
        MapOptions { sources: [source].into_iter().collect(), heights: false, weights: Weights::default() };
    let mut grid = map.to_grid("local", time, &options);
    if source != Source::TERRAIN {
        // Votes, not a statement.
        grid.fields.retain(|field| field.name.starts_with("cost"));
    }
    grid
}

/// Drives for some seconds at 0.8 m/s beside a row of obstacles, which stereo is sure of from near. Terrain calls the
/// free row blocked and the obstacles free.
fn drive(bench: &mut Bench, seconds: std::ops::Range<u32>) {
    drive_with(bench, seconds, false);
}

/// The same, where terrain may be right.
fn drive_with(bench: &mut Bench, seconds: std::ops::Range<u32>, is_right: bool) {
    for second in seconds {
        let vehicle_m = 0.8 * f64::from(second);
        let time = Stamp(bench.now_ms * 1_000_000 + 1);
        let row = |from: i32, to: i32, y_m: f64, cost: u8| -> Vec<(DVec2, u8)> {
            let at = |step: i32| DVec2::new(vehicle_m + 0.1 + 0.2 * f64::from(step), y_m);
            (from..to).map(|step| (at(step), cost)).collect()
        };
        let pose = Some(pose_message(&Pose::from_xy_yaw(vehicle_m, 0.0, 0.0)));
        let odometry = Odometry {
            timestamp: Some(time.to_proto()),
            frame_id: "local".to_owned(),
            pose,
            ..Odometry::default()
        };
        bench.write("/operator/odometry", odometry);
        let both = [row(0, 30, 0.1, 0), row(0, 30, 2.1, 250)].concat();
        bench.write("/operator/stereo", costs(Source::STEREO, vehicle_m, &both, time));
        let wrong = [row(0, 30, 0.1, 250), row(0, 30, 2.1, 0)].concat();
        let terrain = if is_right { &both } else { &wrong };
        bench.write("/operator/terrain", costs(Source::TERRAIN, vehicle_m, terrain, time));
        let behind = row(-6, -1, 0.1, 0);
        bench.write("/operator/bumper", costs(Source::BUMPER, vehicle_m, &behind, time));
        for _ in 0..8 {
            // Stereo sees what is near again and again.
            let near = [row(0, 8, 0.1, 0), row(0, 8, 2.1, 250)].concat();
            bench.write("/operator/stereo", costs(Source::STEREO, vehicle_m, &near, time));
            bench.cycles(125, 1);
        }
    }
}

/// The fused cost at a position of the local frame, m.
fn fused(bench: &Bench, at: DVec2) -> u8 {
    let grid: Grid = bench.latest("/wm1/map");
    let (corner, size) = (grid.pose.unwrap().position.unwrap(), grid.cell_size.unwrap());
    let place = |at: f64, from: f64, size: f64| ((at - from) / size) as usize;
    let (column, row) = (place(at.x, corner.x, size.x), place(at.y, corner.y, size.y));
    let field = grid.fields.iter().find(|field| field.name == "cost").unwrap();
    let cell = row * grid.row_stride as usize + column * grid.cell_stride as usize;
    grid.data[cell + field.offset as usize]
}

fn text(bench: &Bench) -> String {
    bench.latest::<rcs::Status>("/learner/status").state_text
}

fn weight(message: &FusionWeights, source: &str) -> f64 {
    message.weights.iter().find(|entry| entry.source == source).unwrap().weight
}

#[test]
fn the_weight_of_a_source_that_is_wrong_falls_within_its_bound_and_the_reason_is_told() {
    let mut bench = bench();
    drive(&mut bench, 0..3);
    let first: FusionWeights = bench.latest("/learner/weights");
    assert_eq!((weight(&first, "terrain") as f32, first.reason.as_str()), (0.4, "weights of the parameters"));
    // 1.1 m ahead of the vehicle, where stereo calls the ground free and terrain calls it blocked.
    let ahead = |second: u32| DVec2::new(0.8 * f64::from(second) + 1.1, 0.1);
    let before = fused(&bench, ahead(2));
    drive(&mut bench, 3..60);
    assert_eq!(bench.faults("learner"), (0, String::new()));
    let learned: FusionWeights = bench.latest("/learner/weights");
    assert_eq!(weight(&learned, "stereo"), 1.0, "the reference");
    assert!((weight(&learned, "terrain") - 0.1).abs() < 1e-6, "a quarter, the bound: {learned:?}");
    assert!(learned.reason.starts_with("terrain 0.4 to 0.1: "), "{}", learned.reason);
    assert!(
        learned.loss_after < learned.loss_before && learned.driven > 0 && learned.seen > 0,
        "{learned:?}"
    );
    let status: rcs::Status = bench.latest("/learner/status");
    assert!(!status.state_text.is_empty());
    // The world model uses it.
    let after = fused(&bench, ahead(59));
    assert!(0 < after && after < before && before < 250, "from {before} to {after}");
    assert_eq!(bench.faults("wm1"), (0, String::new()));
}

#[test]
fn told_not_to_adjust_it_says_what_would_be_better_and_the_weights_stay() {
    let params = [("learner.adjusts", "false")];
    let types = [ProcessType::of::<WorldModel>(), ProcessType::of::<WeightLearner>()];
    let mut bench = Setup::new(STACK, &types).params(&params).bench();
    drive(&mut bench, 0..60);
    let advice: FusionWeights = bench.latest("/learner/weights");
    assert_eq!(weight(&advice, "terrain") as f32, 0.4, "{advice:?}");
    assert!(advice.reason.starts_with("better would be terrain 0.4 to 0.1: "), "{}", advice.reason);
    // Later fits find the same: the status goes on saying so, and it is not sent again.
    let sent = bench.sent("/learner/weights");
    drive(&mut bench, 60..90);
    assert!(text(&bench).starts_with("better would be terrain 0.4 to 0.1: "), "{}", text(&bench));
    assert_eq!(bench.sent("/learner/weights"), sent);
    let mut params: WeightLearnerParams = bench.latest("/learner/params");
    params.adjusts = true;
    bench.write("/learner/params", params);
    bench.cycles(125, 16);
    let learned: FusionWeights = bench.latest("/learner/weights");
    assert!((weight(&learned, "terrain") - 0.1).abs() < 1e-6, "{learned:?}");
    assert_eq!(learned.reason, "adjusts as told");
}

#[test]
fn better_weights_that_a_later_fit_refutes_do_not_count_once_it_adjusts() {
    let params = [("learner.adjusts", "false"), ("learner.judgements", "1200")];
    let types = [ProcessType::of::<WorldModel>(), ProcessType::of::<WeightLearner>()];
    let mut bench = Setup::new(STACK, &types).params(&params).bench();
    drive(&mut bench, 0..60);
    let advice: FusionWeights = bench.latest("/learner/weights");
    assert!(advice.reason.starts_with("better would be terrain 0.4 to 0.1: "), "{}", advice.reason);
    // Then terrain says what stereo says, until nothing else is left of the newest judgements.
    drive_with(&mut bench, 60..120, true);
    assert!(text(&bench).starts_with("no better weights for "), "{}", text(&bench));
    let mut params: WeightLearnerParams = bench.latest("/learner/params");
    params.adjusts = true;
    bench.write("/learner/params", params);
    bench.cycles(125, 16);
    let weights: FusionWeights = bench.latest("/learner/weights");
    assert_eq!(weight(&weights, "terrain") as f32, 0.4, "{weights:?}");
}

#[test]
fn after_reset_and_with_other_parameters_the_status_says_nothing_of_before() {
    let mut bench = bench();
    drive(&mut bench, 0..42);
    assert!(text(&bench).contains(" judgements"), "{}", text(&bench));
    bench.write(
        "/learner/command",
        rcs::Command { serial: 99, name: "RESET".to_owned(), ..Default::default() },
    );
    drive(&mut bench, 42..44);
    assert_eq!(text(&bench), "collects experience");
    drive(&mut bench, 44..64);
    assert_ne!(text(&bench), "collects experience");
    let mut params: WorldModelParams = bench.latest("/wm1/params");
    params.sources[1].weight = 0.5;
    bench.write("/wm1/params", params);
    drive(&mut bench, 64..66);
    assert_eq!(text(&bench), "collects experience");
}

#[test]
fn with_all_weights_at_zero_nothing_is_known_and_the_status_says_so() {
    let mut bench = bench();
    drive(&mut bench, 0..3);
    let known = |bench: &Bench| bench.latest::<WorldModelStats>("/wm1/stats").known;
    assert!(known(&bench) > 50);
    let params: WorldModelParams = bench.latest("/wm1/params");
    let at_zero = |mut params: WorldModelParams, kinds: &[WorldModelSourceKind]| {
        for source in params.sources.iter_mut().filter(|source| kinds.contains(&source.kind())) {
            source.weight = 0.0;
        }
        params
    };
    let distant = [WorldModelSourceKind::SourceRange, WorldModelSourceKind::SourceLearned];
    // The vehicle has driven on, and what is behind it is known from touch.
    for kinds in [&distant[..], &[distant[0], distant[1], WorldModelSourceKind::SourceOverride]] {
        bench.write("/wm1/params", at_zero(params.clone(), kinds));
        drive(&mut bench, 3..4);
        assert_eq!(known(&bench), 0);
        let status: rcs::Status = bench.latest("/wm1/status");
        assert_eq!(status.state_text, "the weights of all sources that look ahead are 0: nothing is known");
    }
    bench.write("/wm1/params", params);
    drive(&mut bench, 4..5);
    assert!(known(&bench) > 50, "it comes back");
}
