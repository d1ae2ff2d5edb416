//! The world model's map: votes of a cost map of 201×201 cells, fused costs with new weights, the map as a message, and
//! moving the map by one cell.

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use rcs_geom::DVec2;
use rcs_msg::Stamp;
use rcs_sense::{CELL_SIZE_M, CostGrid, GridFrame};
use rcs_world::{Map, MapOptions, Source, SourceKind, Sources, VoteRule, Weights};
use rcs_world_model::algo::{VoteOrigin, take};

/// Labelled points of a frame.
const POINTS: usize = 100_000;

fn rule(source: Source, sequence: u32) -> VoteOrigin {
    let time = Stamp(u64::from(sequence));
    VoteOrigin {
        source,
        kind: SourceKind::Range,
        sequence,
        time,
        rule: VoteRule::default(),
        least_backing: 0,
        height_tolerance_m: 0.2,
    }
}

/// Points of a frame in a fan of 90° ahead, as many per area as a camera has: position, m, and cost.
fn points() -> Vec<(DVec2, u8)> {
    let columns = 400;
    let point = |at: usize| {
        let (column, row) = (at % columns, at / columns);
        let angle_rad = (column as f64 / columns as f64 - 0.5) * std::f64::consts::FRAC_PI_2;
        let range_m = 400.0 / (40.0 + row as f64);
        let at = DVec2::new(range_m * angle_rad.cos(), range_m * angle_rad.sin());
        (at, if (at.x * 1.3).sin() > 0.8 { 250 } else { 10 })
    };
    (0..POINTS).map(point).collect()
}

fn update(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("world/201x201");
    let points = points();
    // A map that all sources know.
    let frame = GridFrame::around(DVec2::ZERO, 201, CELL_SIZE_M);
    let mut known = Map::new(CELL_SIZE_M).expect("a map of that size");
    known.recentre(DVec2::ZERO);
    for source in Source::BUNDLED {
        let costs = (0..201 * 201).map(|slot| (slot * 7 % 251) as u8).collect();
        let grid = CostGrid::of(frame, costs).expect("as many costs as cells");
        let grid = grid.into_message(source, "local", Stamp(1));
        take(&mut known, &grid, &rule(source, 1)).expect("a cost map of the source");
    }
    group.bench_function("a_frame_of_100000_points", |bench| {
        bench.iter_batched_ref(
            || known.clone(),
            |map| {
                let mut costs = CostGrid::new(frame);
                points.iter().for_each(|&(at, cost)| costs.mark(at, cost));
                let grid = costs.into_message(Source::STEREO, "local", Stamp(2));
                take(map, &grid, &rule(Source::STEREO, 2)).expect("a cost map of the source").votes
            },
            BatchSize::SmallInput,
        );
    });
    group.bench_function("new_weights", |bench| {
        let mut fused = Vec::with_capacity(201 * 201);
        let mut weight = 0.0;
        bench.iter(|| {
            weight = (weight + 0.01) % 1.0;
            let weights = Weights::default().with(Source::STEREO, weight);
            fused.clear();
            known.for_each_fused(&weights, |_, cell| fused.push(cell.cost));
            fused.len()
        });
    });
    // As most maps are: the vehicle has seen a part of them, with heights.
    let options = MapOptions { sources: Sources::bundled(), heights: true, weights: Weights::default() };
    let mut seen = Map::new(CELL_SIZE_M).expect("a map of that size");
    seen.recentre(DVec2::ZERO);
    let mut costs = CostGrid::new(frame);
    points.iter().for_each(|&(at, cost)| costs.mark(at, cost));
    let grid = costs.into_message(Source::STEREO, "local", Stamp(1));
    take(&mut seen, &grid, &rule(Source::STEREO, 1)).expect("a cost map of the source");
    for (name, map) in [("all_known", &known), ("one_frame_seen", &seen)] {
        group.bench_function(format!("message/{name}"), |bench| {
            bench.iter(|| map.to_grid("local", Stamp(3), &options).data.len());
        });
    }
    // A clone that shares all tiles with `known` moves, so each tile that it writes is copied.
    group.bench_function("move_by_one_cell/snapshot_held", |bench| {
        let east = DVec2::new(1.5, 0.5) * CELL_SIZE_M;
        bench.iter_batched_ref(
            || known.clone(),
            |map| map.recentre(east).expect("a finite position").len(),
            BatchSize::LargeInput,
        );
    });
    let mut alone = known;
    let mut column = 0_i32;
    group.bench_function("move_by_one_cell/alone", |bench| {
        bench.iter(|| {
            column += 1;
            let place = DVec2::new(f64::from(column) + 0.5, 0.5) * CELL_SIZE_M;
            alone.recentre(place).expect("a finite position").len()
        });
    });
    group.finish();
}

criterion_group!(benches, update);
criterion_main!(benches);
