use super::*;
use rcs_geom::DVec2;
use rcs_log::{LogWriter, WriteHeader, WriterOptions};
use rcs_world::{CELL_SIZE_M, Map, MapOptions, SIDE, Source, Sources, VoteRule, Weights};

/// A true map of 201×201 cells of 0.2 m whose corner is at (-20, -20), with blocked cells, and others of class 19.
pub(super) fn true_map(blocked: &[[usize; 2]], boulders: &[[usize; 2]]) -> Grid {
    use rcs_msg::foxglove::packed_element_field::NumericType;
    use rcs_msg::foxglove::{PackedElementField, Vector2, Vector3};
    let mut data = vec![0; SIDE * SIDE * 2];
    for (cells, class) in [(blocked, 0), (boulders, 19)] {
        for [x, y] in cells {
            let at = 2 * (y * SIDE + x);
            (data[at], data[at + 1]) = (class, 1);
        }
    }
    let field = |name: &str, offset| PackedElementField {
        name: name.to_owned(),
        offset,
        r#type: NumericType::Uint8.into(),
    };
    Grid {
        frame_id: "global".to_owned(),
        pose: Some(foxglove::Pose {
            position: Some(Vector3 { x: -20.0, y: -20.0, z: 0.0 }),
            orientation: None,
        }),
        column_count: SIDE as u32,
        cell_size: Some(Vector2 { x: CELL_SIZE_M, y: CELL_SIZE_M }),
        row_stride: 2 * SIDE as u32,
        cell_stride: 2,
        fields: vec![field("class", 0), field("blocked", 1)],
        data: data.into(),
        ..Grid::default()
    }
}

/// A map whose cells within 8 m are free by stereo but for the given places, at which they are obstacles.
fn map(obstacles: &[DVec2]) -> Grid {
    let mut map = Map::new(CELL_SIZE_M).unwrap();
    let full = VoteRule { rise: 255, fall: 255, max: 255, ..VoteRule::default() };
    for index in map.grid().bounds().iter() {
        let middle = map.grid().middle_of(index);
        if middle.length() > 8.0 {
            continue;
        }
        let hit = obstacles.iter().any(|place| (*place - middle).abs().max_element() < 0.1);
        map.vote(index, Source::STEREO, if hit { 250 } else { 0 }, 1, Stamp(1), full);
    }
    let sources: Sources = [Source::STEREO, Source::COLOR].into_iter().collect();
    map.to_grid("local", Stamp(1), &MapOptions { sources, heights: false, weights: Weights::default() })
}

/// One straight arc of 3 m, judged once at the origin.
fn judged(truth: Grid, grid: &Grid, yaw_rad: f64) -> Report {
    let settings = Settings { lengths_m: vec![3.0], arcs: 1, ..Settings::default() };
    let mut judge = Judge::new(&settings);
    judge.take_truth(truth).unwrap();
    judge.take_true_pose(Stamp(1), Pose::from_xy_yaw(0.0, 0.0, yaw_rad));
    judge.take_pose(Stamp(1), Pose::IDENTITY);
    judge.take_map(Stamp(1), &GridView::new(grid).unwrap()).unwrap();
    judge.report().unwrap()
}

/// The cell of the true map at a position, m.
pub(super) fn cell(x: f64, y: f64) -> [usize; 2] {
    [x, y].map(|v| ((v + 20.0) / CELL_SIZE_M).floor() as usize)
}

#[test]
fn arcs_are_free_or_blocked_by_what_lies_under_the_width_of_the_vehicle() {
    let check = |thing: Option<[f64; 2]>, seen: Option<[f64; 2]>, expected: [Option<f64>; 2]| {
        let cells: Vec<_> = thing.map(|[x, y]| cell(x, y)).into_iter().collect();
        let places: Vec<_> = seen.map(DVec2::from_array).into_iter().collect();
        let report = judged(true_map(&[], &cells), &map(&places), 0.0);
        let shares = report.shares(FUSED, 3.0).unwrap();
        let got = [shares.free_called_blocked_pct, shares.blocked_called_free_pct];
        assert_eq!(got, expected, "{thing:?} {seen:?}: {report}");
        assert_eq!(report.shares("stereo", 3.0), Some(shares), "the only source");
    };
    let (ahead, beside, beyond) = ([2.1, 0.1], [2.1, 0.9], [3.9, 0.1]);
    check(None, None, [Some(0.0), None]);
    check(None, Some(ahead), [Some(100.0), None]);
    check(None, Some(beside), [Some(0.0), None]);
    check(None, Some(beyond), [Some(0.0), None]);
    check(Some(ahead), None, [None, Some(100.0)]);
    check(Some(ahead), Some(ahead), [None, Some(0.0)]);
    check(Some(beyond), None, [Some(0.0), None]);
    // The thing grazes the arc within the tolerance: the arc is not counted.
    check(Some([2.1, 0.5]), None, [None, None]);
}

#[test]
fn an_arc_of_which_little_is_known_is_not_judged_and_a_source_alone_is_judged_on_the_same_arcs() {
    let empty = Map::new(CELL_SIZE_M).unwrap();
    let sources: Sources = [Source::STEREO].into_iter().collect();
    let options = MapOptions { sources, heights: false, weights: Weights::default() };
    let report = judged(true_map(&[], &[]), &empty.to_grid("local", Stamp(1), &options), 0.0);
    assert_eq!((report.arcs[0].free, report.arcs[0].unknown), (0, [1, 0]));
    assert_eq!(report.shares(FUSED, 3.0).unwrap().free_called_blocked_pct, None);
    // Colour has no vote: alone, it blocks nothing.
    let report = judged(true_map(&[], &[cell(2.1, 0.1)]), &map(&[DVec2::new(2.1, 0.1)]), 0.0);
    let missed = |layer: &str| report.shares(layer, 3.0).unwrap().blocked_called_free_pct;
    assert_eq!((missed(FUSED), missed("color")), (Some(0.0), Some(100.0)));
}

#[test]
fn the_true_map_is_read_with_the_true_pose() {
    // The vehicle truly heads north; its local frame says east.
    let truth = true_map(&[], &[cell(0.1, 2.1)]);
    let seen = judged(truth, &map(&[DVec2::new(2.1, 0.1)]), std::f64::consts::FRAC_PI_2);
    assert_eq!(seen.shares(FUSED, 3.0).unwrap().blocked_called_free_pct, Some(0.0), "{seen}");
}

#[test]
fn a_thing_is_late_if_it_was_in_the_way_from_far_and_blocked_only_when_near() {
    let thing = [2.7, 0.1];
    let truth = true_map(&[], &[cell(thing[0], thing[1])]);
    let settings = Settings { lengths_m: vec![3.0], arcs: 1, ..Settings::default() };
    let late = |first_seen_step: usize| {
        let mut judge = Judge::new(&settings);
        judge.take_truth(truth.clone()).unwrap();
        for step in 0..8 {
            let pose = Pose::from_xy_yaw(0.25 * step as f64, 0.0, 0.0);
            let time = Stamp(1 + step as u64 * 500_000_000);
            judge.take_true_pose(time, pose);
            judge.take_pose(time, pose);
            let seen: &[DVec2] = if step >= first_seen_step { &[DVec2::new(2.7, 0.1)] } else { &[] };
            judge.take_map(time, &GridView::new(&map(seen)).unwrap()).unwrap();
        }
        let report = judge.report().unwrap();
        assert_eq!((report.things.len(), report.things[0].kind.as_str()), (1, "boulder"));
        let block = report.things[0].first_blocks.iter().find(|block| block.layer == FUSED).unwrap().clone();
        let expected_m = 2.7 - settings.front_m - 0.25 * first_seen_step as f64;
        assert!((block.distance_m - expected_m).abs() < 0.11, "{block:?}");
        assert!((block.time_s - 0.5 * first_seen_step as f64).abs() < 1e-6);
        let text = report.to_string();
        assert_eq!(text.contains("LATE"), report.things[0].is_late(FUSED), "{text}");
        report.layers[0].late_things
    };
    assert_eq!([late(0), late(4)], [0, 1]);
}

#[test]
fn a_thing_that_is_met_from_near_is_late_only_if_it_is_approached_once_more_and_not_known() {
    let settings = Settings { lengths_m: vec![3.0], arcs: 1, ..Settings::default() };
    // At each position, m: whether the map shows the thing at 2.7 m.
    let late = |drive: &[(f64, bool)]| {
        let mut judge = Judge::new(&settings);
        judge.take_truth(true_map(&[], &[cell(2.7, 0.1)])).unwrap();
        for (step, &(x_m, shows)) in drive.iter().enumerate() {
            let (pose, time) = (Pose::from_xy_yaw(x_m, 0.0, 0.0), Stamp(1 + step as u64 * 500_000_000));
            judge.take_true_pose(time, pose);
            judge.take_pose(time, pose);
            let seen: &[DVec2] = if shows { &[DVec2::new(2.7, 0.1)] } else { &[] };
            judge.take_map(time, &GridView::new(&map(seen)).unwrap()).unwrap();
        }
        judge.report().unwrap().layers[0].late_things
    };
    // From 1 m before it back to 2.5 m before it: it was never far before it was near.
    assert_eq!(late(&[(1.5, true), (0.75, true), (0.0, true)]), 0);
    assert_eq!(late(&[(1.5, false), (0.75, false), (0.0, false)]), 0);
    // Then to it once more: what it blocked at 2 m or more counts, though it first blocked at 1 m.
    assert_eq!(late(&[(1.5, true), (0.0, true), (1.5, true)]), 0);
    assert_eq!(late(&[(1.5, true), (0.0, false), (1.5, true)]), 1);
    // What it blocks at 2 m or more after that is too late.
    assert_eq!(late(&[(0.0, false), (1.5, true), (0.0, true)]), 1);
}

/// Drives towards a thing to 2.61 m before it, with a map that shows it in these steps of 0.25 m. It is on the arc from
/// the fourth step on (5.11 m) and sighted from the sixth one (4.61 m).
fn approached(shows: std::ops::Range<usize>) -> Report {
    let settings = Settings { lengths_m: vec![5.0], arcs: 1, ..Settings::default() };
    let mut judge = Judge::new(&settings);
    judge.take_truth(true_map(&[], &[cell(6.1, 0.1)])).unwrap();
    for step in 0..14 {
        let (pose, time) =
            (Pose::from_xy_yaw(0.25 * step as f64, 0.0, 0.0), Stamp(1 + step as u64 * 500_000_000));
        judge.take_true_pose(time, pose);
        judge.take_pose(time, pose);
        let seen: &[DVec2] = if shows.contains(&step) { &[DVec2::new(6.1, 0.1)] } else { &[] };
        judge.take_map(time, &GridView::new(&map(seen)).unwrap()).unwrap();
    }
    judge.report().unwrap()
}

#[test]
fn a_thing_that_the_vehicle_keeps_away_from_is_judged_at_each_pose_from_which_it_was_in_view() {
    let check = |shows, blocking: [u64; 3], steady_from_m: Option<f64>| {
        let report = approached(shows);
        let of_layer =
            |layer: &str| report.things[0].sightings.iter().find(|seen| seen.layer == layer).unwrap().clone();
        let seen = of_layer(FUSED);
        assert_eq!((seen.poses, seen.blocking), ([2, 4, 3], blocking), "{report}");
        let near = match (seen.steady_from_m, steady_from_m) {
            (Some(got_m), Some(expected_m)) => (got_m - expected_m).abs() < 1e-6,
            (got_m, expected_m) => got_m == expected_m,
        };
        assert!(near, "{seen:?}");
        let layer = &report.layers[0];
        for (place, band) in layer.bands.iter().enumerate() {
            let (poses, blocking) = (seen.poses[place], blocking[place]);
            let counts = (band.things, band.steady_things, band.poses);
            assert_eq!(counts, (1, u64::from(poses == blocking), poses), "{band:?}");
            assert_eq!(band.blocking_pct, Some(100.0 * blocking as f64 / poses as f64));
        }
        assert_eq!((layer.late_things, layer.missed_things), (0, u64::from(steady_from_m.is_none())));
        assert_eq!(report.to_string().contains("MISSED"), steady_from_m.is_none(), "{report}");
        // Colour has no vote.
        assert_eq!((of_layer("color").poses, of_layer("color").blocking), ([2, 4, 3], [0; 3]));
    };
    check(0..14, [2, 4, 3], Some(4.61));
    check(7..14, [2, 4, 1], Some(4.11));
    check(7..13, [1, 4, 1], None);
    check(20..21, [0; 3], None);
}

#[test]
fn the_distance_from_which_on_a_thing_blocks_equals_the_simple_definition_on_random_sightings() {
    let reference = |seen: &[(f64, bool)]| {
        let is_steady = |from_m: f64| seen.iter().all(|&(distance_m, blocks)| blocks || distance_m > from_m);
        seen.iter().map(|&(distance_m, _)| distance_m).filter(|&from_m| is_steady(from_m)).reduce(f64::max)
    };
    let mut state = 7_u64;
    let mut random = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as f64 / (1_u64 << 31) as f64
    };
    let (mut steady, mut missed) = (0, 0);
    for _ in 0..500 {
        let count = 1 + (20.0 * random()) as usize;
        let seen: Vec<_> = (0..count).map(|_| (2.0 + 3.0 * random(), random() < 0.9)).collect();
        let counted = ThingSightings::new(FUSED, &seen);
        assert_eq!(counted.steady_from_m, reference(&seen), "{seen:?}");
        let mut expected = [[0; 3]; 2];
        for &(distance_m, blocks) in &seen {
            let band = distance_m as usize - 2;
            expected[0][band] += 1;
            expected[1][band] += u64::from(blocks);
        }
        assert_eq!([counted.poses, counted.blocking], expected, "{seen:?}");
        *(if counted.steady_from_m.is_some() { &mut steady } else { &mut missed }) += 1;
    }
    assert!(steady > 20 && missed > 20, "{steady} {missed}");
}

#[test]
fn without_truth_the_error_says_what_is_missing() {
    let judge = Judge::new(&Settings::default());
    assert!(judge.report().unwrap_err().to_string().contains("expected a true map"));
}

/// A recording with the truth, a pose, and topics of maps with as many messages each.
fn recorded(path: &std::path::Path, maps: &[(&str, u32)]) -> Log {
    let mut writer = LogWriter::create(path, WriterOptions::default()).unwrap();
    let mut add = |name: &str, role: &str, truth: &str, message: &AnyMessage, count: u32| {
        let metadata = [("rcs.role", role), ("rcs.ground_truth", truth)];
        let metadata: BTreeMap<String, String> =
            metadata.map(|(key, value)| (key.to_owned(), value.to_owned())).into();
        let channel = writer.add_channel(name, &message.schema(), &metadata).unwrap();
        for sequence in 0..count {
            let header = WriteHeader { sequence, log_time: Stamp(1), publish_time: Stamp(1) };
            writer.write(channel, header, &message.bytes()).unwrap();
        }
    };
    let grid = AnyMessage::new(map(&[]));
    let pose = AnyMessage::new(PoseInFrame::default());
    add("/truth/map", "map", "true", &grid, 1);
    add("/truth/pose", "pose", "true", &pose, 1);
    add("/pose", "pose", "false", &pose, 1);
    for &(name, count) in maps {
        add(name, "map", "false", &grid, count);
    }
    writer.finish().unwrap();
    Log::open(path).unwrap()
}

#[test]
fn a_topic_without_messages_is_no_candidate_and_one_of_another_type_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let log = recorded(&folder.path().join("one.mcap"), &[("/wm1/map", 1), ("/map_memory/cost", 0)]);
    let frame = |log: &Log, job: &Job| {
        Topics::find(job, log).map(|topics| topics.frame).map_err(|error| error.to_string())
    };
    assert_eq!(frame(&log, &Job::default()), Ok("local".to_owned()));
    let refused = |job: Job| frame(&log, &job).unwrap_err();
    let named = |name: &str| Some(name.to_owned());
    assert_eq!(
        refused(Job { map: named("/pose"), ..Job::default() }),
        "--map: /pose holds \"foxglove.PoseInFrame\", expected foxglove.Grid"
    );
    assert_eq!(
        refused(Job { pose: named("/wm1/map"), ..Job::default() }),
        "--pose: /wm1/map holds \"foxglove.Grid\", expected foxglove.Odometry or foxglove.PoseInFrame"
    );
    assert_eq!(refused(Job { true_map: named("/x"), ..Job::default() }), "the recording has no topic /x");
    assert_eq!(
        refused(Job { true_map: named("/wm1/map"), ..Job::default() }),
        "got /wm1/map as the true map and as the map, expected two topics"
    );
    assert_eq!(
        refused(Job { true_pose: named("/pose"), ..Job::default() }),
        "got /pose as the true pose and as the pose of the vehicle, expected two topics"
    );
    let empty = refused(Job { map: named("/map_memory/cost"), ..Job::default() });
    assert_eq!(empty, "/map_memory/cost has no messages, expected maps");
    let log = recorded(&folder.path().join("two.mcap"), &[("/wm1/map", 1), ("/wm2/map", 2)]);
    let several = frame(&log, &Job::default());
    assert_eq!(several, Err("expected --map with one of /wm1/map, /wm2/map".to_owned()));
}
