use proptest::prelude::*;
use rcs_msg::foxglove::Vector2;

use super::*;
use crate::SIDE;
use crate::{GridView, SourceKind, Sources, UNKNOWN_COST, Vote, VoteRule, Weights, fuse_grid};

fn options(sources: Sources) -> MapOptions {
    let weights = Weights::default().with(Source::TERRAIN, 0.3).with(Source::COLOR, 2.0);
    MapOptions { sources, heights: true, weights }
}

/// A map with votes of all sources at various places, and heights.
fn voted(seed: u64, votes: usize, vehicle: DVec2) -> Map {
    let mut state = seed;
    let mut random = move |n: u64| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) % n
    };
    let mut map = Map::new(0.2).unwrap();
    map.recentre(vehicle).unwrap();
    let south_west = map.grid().bounds().south_west;
    for sequence in 0..votes as u32 {
        let index = south_west.offset(random(SIDE as u64) as i64, random(SIDE as u64) as i64);
        let source = Source::BUNDLED[random(6) as usize];
        let time = Stamp(1_700_000_000_123_456_789 + u64::from(sequence) * 7_777_777);
        let is_learned = Weights::default().get(source).kind == SourceKind::Learned;
        let model = if is_learned { random(256) as u8 } else { 0 };
        let vote = Vote { model, ..Vote::from(random(251) as u8) };
        assert!(map.vote(index, source, vote, sequence, time, VoteRule::default()));
        let mut ground = HeightStats::default();
        (0..random(4)).for_each(|_| ground.add(random(1000) as f32 * 0.001));
        let cell = map.cell_mut(index).unwrap();
        cell.observe_heights(&ground, &HeightStats::default(), 0.1, time, VoteRule::default());
    }
    map
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]
    #[test]
    fn a_map_comes_back_from_its_grid(seed: u64, x in -1e5..1e5_f64, y in -1e5..1e5_f64) {
        let mut map = voted(seed, 3000, DVec2::new(x, y));
        // A message has rounded heights.
        for index in map.grid().bounds().iter() {
            let cell = map.cell_mut(index).unwrap();
            (cell.ground, cell.obstacle) = (cell.ground.rounded(), cell.obstacle.rounded());
        }
        let grid = map.to_grid("local", Stamp(5), &options(Sources::bundled()));
        let back = Map::from_grid(&grid).unwrap();
        prop_assert_eq!(back.grid().bounds(), map.grid().bounds());
        prop_assert_eq!(back, map);
    }

    #[test]
    fn fusing_the_grid_anew_equals_fusing_the_cells(seed: u64, stereo in 0.0..3.0_f32, infrared in 0.0..3.0_f32) {
        let map = voted(seed, 60_000, DVec2::ZERO);
        let grid = map.to_grid("local", Stamp(5), &options(Sources::bundled()));
        let weights = Weights::default().with(Source::STEREO, stereo).with(Source::INFRARED, infrared);
        let mut costs = Vec::new();
        fuse_grid(&GridView::new(&grid).unwrap(), &weights, &mut costs).unwrap();
        let cells = map.grid().bounds().iter();
        let expected: Vec<u8> = cells.map(|cell| map.fused(cell, &weights).cost).collect();
        prop_assert_eq!(costs, expected);
    }

    #[test]
    fn scrolling_the_map_keeps_what_stays_in_view(seed: u64, dx in -3.0..3.0_f64, dy in -3.0..3.0_f64) {
        let mut map = voted(seed, 20_000, DVec2::ZERO);
        let before = map.clone();
        let exposed = map.recentre(DVec2::new(dx, dy)).unwrap();
        let fresh: std::collections::BTreeSet<_> = exposed.iter().collect();
        for (index, cell) in map.grid().iter() {
            let is_fresh = fresh.contains(&index);
            let expected = if is_fresh { Cell::default() } else { *before.grid().get(index).unwrap() };
            prop_assert_eq!(*cell, expected);
            for source in Source::BUNDLED {
                let said = if is_fresh { Evidence::NONE } else { before.evidence(source, index) };
                prop_assert_eq!(map.evidence(source, index), said);
            }
        }
    }
}

#[test]
fn the_vehicle_is_in_column_100_of_row_100_and_rows_go_north() {
    let mut map = Map::new(0.2).unwrap();
    let vehicle = DVec2::new(12.3, -45.6);
    map.recentre(vehicle).unwrap();
    let here = map.grid().cell_at(vehicle).unwrap();
    let rule = VoteRule::default();
    map.vote(here, Source::STEREO, 10, 1, Stamp(1), rule);
    map.vote(here.offset(1, 0), Source::STEREO, 20, 2, Stamp(1), rule);
    map.vote(here.offset(0, 1), Source::STEREO, 30, 3, Stamp(1), rule);
    let grid = map.to_grid("local", Stamp(9), &options(Sources::bundled()));
    let view = GridView::new(&grid).unwrap();
    let cost = view.field("cost").unwrap();
    let at = |column, row| cost.get(column, row).unwrap();
    assert_eq!([at(100, 100), at(101, 100), at(100, 101), at(99, 99)], [10.0, 20.0, 30.0, 255.0]);
    assert_eq!(view.field("seq.stereo").unwrap().get(100, 101), Some(3.0));
    // By the message's own rule, the corner of cell (100, 100) is that of the cell that contains the vehicle.
    let corner = view.frame_from_grid().translation.truncate() + DVec2::splat(100.0 * 0.2);
    let inside = vehicle - corner;
    assert!(inside.min_element() >= -1e-9 && inside.max_element() < 0.2 + 1e-9, "{inside}");
}

#[test]
fn the_least_distance_from_which_an_obstacle_was_seen_is_kept() {
    let mut map = Map::new(0.2).unwrap();
    let post = map.grid().cell_at(DVec2::new(10.1, 0.1)).unwrap();
    let seen = |map: &mut Map, vehicle_m: f64, cost: u8| {
        map.recentre(DVec2::new(vehicle_m, 0.1)).unwrap();
        assert!(map.vote(post, Source::STEREO, cost, 1, Stamp(1), VoteRule::default()));
        let grid = map.to_grid("local", Stamp(1), &options(Sources::bundled()));
        let back = Map::from_grid(&grid).unwrap();
        back.grid().get(post).unwrap().obstacle_seen_from_dm
    };
    assert_eq!(seen(&mut map, 7.1, 10), 0, "a vote for ground");
    assert_eq!(seen(&mut map, 4.1, 250), 60);
    assert_eq!(seen(&mut map, 7.1, 250), 30);
    assert_eq!(seen(&mut map, 1.1, 250), 30);
    assert_eq!(seen(&mut map, 10.1, 250), 1);
}

#[test]
fn only_sources_of_the_stack_are_written() {
    let sources: Sources = [Source::STEREO, Source::BUMPER].into_iter().collect();
    let map = Map::new(0.6).unwrap();
    let names = |heights| {
        let grid = map.to_grid("global", Stamp(0), &MapOptions { heights, ..options(sources.clone()) });
        GridView::new(&grid).unwrap();
        (grid.fields.into_iter().map(|f| f.name).collect::<Vec<_>>().join(" "), grid.cell_stride)
    };
    let (plain, stride) = names(false);
    assert_eq!(
        plain,
        "updated_s updated_ns seq.stereo seq.bumper cost confidence label source obstacle_seen_from_dm \
         cost.stereo conf.stereo against.stereo backing.stereo cost.bumper conf.bumper against.bumper backing.bumper"
    );
    assert_eq!(stride, 32);
    assert!(
        names(true)
            .0
            .contains("ground.mean ground.variance ground.min ground.max ground.count obstacle.mean")
    );
}

#[test]
fn the_surest_source_is_told_by_its_place_among_the_fields_of_the_message() {
    let radar = Source::new("radar").unwrap();
    let mut map = Map::new(0.2).unwrap();
    let cell = map.grid().centre();
    for (source, votes) in [(Source::STEREO, 1), (radar, 3), (Source::INFRARED, 2)] {
        for sequence in 1..=votes {
            assert!(map.vote(cell, source, 30, sequence, Stamp(1), VoteRule::default()));
        }
    }
    let sources = [Source::STEREO, Source::INFRARED, radar].into_iter().collect();
    let grid = map.to_grid("local", Stamp(1), &options(sources));
    let view = GridView::new(&grid).unwrap();
    assert_eq!(view.field("source").unwrap().get(100, 100), Some(2.0));
    assert_eq!(view.sources().iter().nth(2), Some(radar));
    assert_eq!(Map::from_grid(&grid).unwrap(), map);
}

#[test]
fn an_empty_map_is_unknown_everywhere() {
    let grid = Map::new(0.2).unwrap().to_grid("local", Stamp(0), &options(Sources::bundled()));
    let view = GridView::new(&grid).unwrap();
    for name in ["cost", "cost.stereo", "cost.infrared"] {
        assert!(view.field(name).unwrap().values().all(|cost| cost == f64::from(UNKNOWN_COST)), "{name}");
    }
    assert!(view.field("conf.color").unwrap().values().all(|confidence| confidence == 0.0));
    assert!(view.field("ground.mean").unwrap().values().all(f64::is_nan));
}

#[test]
fn grids_that_are_no_map_of_ours_are_refused() {
    let map = Map::new(0.2).unwrap();
    let check = |change: fn(&mut Grid), expected: &str| {
        let mut grid = map.to_grid("local", Stamp(0), &options(Sources::bundled()));
        change(&mut grid);
        let error = Map::from_grid(&grid).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    };
    check(|g| g.data = g.data.slice(..g.row_stride as usize * 200), "201 columns and 200 rows");
    check(|g| g.cell_size = Some(Vector2 { x: 0.2, y: 0.3 }), "0.2 m by 0.3 m, expected square");
    check(|g| g.cell_size = Some(Vector2 { x: 0.33, y: 0.33 }), "corner is at (-20");
    check(|g| g.data = g.data.slice(..100), "multiple of the row stride");
    let turned = |g: &mut Grid| {
        let orientation = Some(Quaternion { x: 0.0, y: 0.0, z: 0.6, w: 0.8 });
        g.pose = g.pose.map(|pose| foxglove::Pose { orientation, ..pose });
    };
    check(turned, "untilted");
    check(|g| g.fields[4].r#type = NumericType::Float32.into(), "is FLOAT32, expected UINT32");
}

/// Prints what it measures; asserts only the order of magnitude, because builds and machines differ.
#[test]
fn a_received_map_is_fused_anew_in_about_a_millisecond() {
    let map = voted(7, 200_000, DVec2::ZERO);
    let grid = map.to_grid("local", Stamp(0), &options(Sources::bundled()));
    let stereo = map.to_grid("local", Stamp(0), &options([Source::STEREO].into_iter().collect()));
    let (weights, mut costs) = (Weights::default().with(Source::STEREO, 0.7), Vec::new());
    let time = |name: &str, mut work: Box<dyn FnMut() + '_>| {
        let fastest = (0..100).map(|_| {
            let start = std::time::Instant::now();
            work();
            start.elapsed()
        });
        let each = fastest.min().unwrap();
        println!("{name}: {each:?}");
        each
    };
    let fuse = time(
        "view and fuse 201x201 of six sources",
        Box::new(|| {
            fuse_grid(&GridView::new(&grid).unwrap(), &weights, &mut costs).unwrap();
        }),
    );
    time(
        "view and fuse 201x201 of stereo alone",
        Box::new(|| {
            fuse_grid(&GridView::new(&stereo).unwrap(), &weights, &mut Vec::new()).unwrap();
        }),
    );
    time(
        "write the map",
        Box::new(|| {
            map.to_grid("local", Stamp(0), &options(Sources::bundled()));
        }),
    );
    assert!(fuse < std::time::Duration::from_millis(50));
}
