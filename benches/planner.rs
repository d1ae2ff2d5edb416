//! The path search on 201×201 cells from the middle to the border, beside the A* of the crate `pathfinding` on the same
//! maps: costs of 1 to 250 with 0 to 40 % blocked, combs, and cups.

use std::hint::black_box;
use std::time::Instant;

use criterion::{Criterion, criterion_group, criterion_main};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{RngCore, SeedableRng};
use rcs_planner::costs::{BLOCKED, CostGrid};
use rcs_planner::search::{Path, Place, Search};

const SIDE: usize = 201;
const MIDDLE: Place = Place::new(100, 100);
/// Maps of each kind.
const MAPS: usize = 40;

struct Numbers(ChaCha8Rng);

impl Numbers {
    fn below(&mut self, end: u64) -> u64 {
        self.0.next_u64() % end
    }
}

type Maps = Vec<(CostGrid, Place)>;

/// Maps whose goal is on the border and not blocked.
fn maps(seed: u64, mut cells: impl FnMut(&mut Numbers) -> Vec<u8>) -> Maps {
    let mut numbers = Numbers(ChaCha8Rng::seed_from_u64(seed));
    let map = |_| {
        let mut cells = cells(&mut numbers);
        let along = numbers.below(SIDE as u64) as i32;
        let goal =
            [Place::new(along, 0), Place::new(along, 200), Place::new(0, along), Place::new(200, along)]
                [numbers.below(4) as usize];
        for place in [MIDDLE, goal] {
            cells[place.row as usize * SIDE + place.column as usize] = 1;
        }
        (CostGrid::new(SIDE, SIDE, cells).expect("a grid of that size"), goal)
    };
    (0..MAPS).map(map).collect()
}

fn random(blocked: u64) -> impl FnMut(&mut Numbers) -> Vec<u8> {
    move |numbers| {
        let mut cell = || if numbers.below(100) < blocked { BLOCKED } else { 1 + numbers.below(250) as u8 };
        (0..SIDE * SIDE).map(|_| cell()).collect()
    }
}

/// Walls from top and bottom in turn, so that the way winds through the whole map.
fn comb(numbers: &mut Numbers) -> Vec<u8> {
    let (gap, cost) = (2 + numbers.below(9) as usize, 1 + numbers.below(250) as u8);
    let mut cells = vec![cost; SIDE * SIDE];
    for (wall, column) in (gap..SIDE).step_by(gap).enumerate() {
        let open = if wall % 2 == 0 { 0 } else { SIDE - 1 };
        (0..SIDE).filter(|&row| row != open).for_each(|row| cells[row * SIDE + column] = BLOCKED);
    }
    cells
}

/// A cup around the middle that is open on one side, on ground of two costs.
fn cup(numbers: &mut Numbers) -> Vec<u8> {
    let cost = 1 + numbers.below(250);
    let mut cells: Vec<u8> = (0..SIDE * SIDE).map(|_| (cost / (1 + numbers.below(2))).max(1) as u8).collect();
    let (near, far) = (5 + numbers.below(90) as usize, 105 + numbers.below(90) as usize);
    let open = numbers.below(4) as usize;
    for at in near..=far {
        let walls = [near * SIDE + at, far * SIDE + at, at * SIDE + near, at * SIDE + far];
        (0..4).filter(|&wall| wall != open).for_each(|wall| cells[walls[wall]] = BLOCKED);
    }
    cells
}

/// The same search with the peer: cost in thousandths of a cell, no diagonal step past a blocked corner.
fn with_peer(costs: &CostGrid, goal: Place) -> Option<u64> {
    let cost = |column: i32, row: i32| {
        costs.get(Place::new(column, row)).filter(|&cost| cost != BLOCKED).map(u64::from)
    };
    let least = u64::from(costs.least());
    let steps = |&(column, row): &(i32, i32)| {
        let around = [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1)];
        around.into_iter().filter_map(move |(x, y)| {
            let passes =
                x == 0 || y == 0 || (cost(column + x, row).is_some() && cost(column, row + y).is_some());
            let length = if x != 0 && y != 0 { 1414 } else { 1000 };
            let to = cost(column + x, row + y).filter(|_| passes)?;
            Some(((column + x, row + y), length * to))
        })
    };
    let left = |&(column, row): &(i32, i32)| {
        let (x, y) = (u64::from(column.abs_diff(goal.column)), u64::from(row.abs_diff(goal.row)));
        (1000 * x.max(y) + 414 * x.min(y)) * least
    };
    let end = (goal.column, goal.row);
    let found = pathfinding::prelude::astar(&(MIDDLE.column, MIDDLE.row), steps, left, |at| *at == end);
    found.map(|(_, cost)| cost)
}

fn search(criterion: &mut Criterion) {
    let kinds: [(&str, Maps); 5] = [
        ("free", maps(1, random(0))),
        ("blocked_20", maps(2, random(20))),
        ("blocked_40", maps(3, random(40))),
        ("combs", maps(4, comb)),
        ("cups", maps(5, cup)),
    ];
    let mut group = criterion.benchmark_group("planner/search/201x201");
    group.sample_size(20);
    let (mut search, mut path) = (Search::default(), Path::default());
    let mut worst_ms = [0.0_f64; 2];
    for (kind, maps) in &kinds {
        for (map, goal) in maps {
            let ours = search.path(map, MIDDLE, *goal, 1, &mut path).is_ok().then_some(path.cost);
            let peer = with_peer(map, *goal).map(|cost| cost as f64 / 1000.0);
            match (ours, peer) {
                // The peer rounds the diagonal to 1.414.
                (Some(ours), Some(peer)) => assert!((ours / peer - 1.0).abs() < 5e-3, "{ours} {peer}"),
                (ours, peer) => assert_eq!(ours.is_some(), peer.is_some(), "{kind}"),
            }
            // The shortest of five, so that other work on the machine does not count.
            let shortest_ms = |run: &mut dyn FnMut()| {
                let once = |_| {
                    let begin = Instant::now();
                    run();
                    begin.elapsed().as_secs_f64() * 1e3
                };
                (0..5).map(once).fold(f64::INFINITY, f64::min)
            };
            let ours_ms = shortest_ms(&mut || {
                let _ = black_box(search.path(map, MIDDLE, *goal, 1, &mut path));
            });
            let peer_ms = shortest_ms(&mut || {
                black_box(with_peer(map, *goal));
            });
            worst_ms = [worst_ms[0].max(ours_ms), worst_ms[1].max(peer_ms)];
        }
        let mut each = maps.iter().cycle();
        group.bench_function(format!("{kind}/ours"), |bench| {
            bench.iter(|| {
                let (map, goal) = each.next().expect("a cycle does not end");
                search.path(map, MIDDLE, *goal, 1, &mut path).is_ok()
            });
        });
        group.bench_function(format!("{kind}/pathfinding"), |bench| {
            bench.iter(|| {
                let (map, goal) = each.next().expect("a cycle does not end");
                with_peer(map, *goal)
            });
        });
    }
    group.finish();
    println!(
        "longest of {} maps: ours {:.2} ms, pathfinding {:.2} ms",
        MAPS * kinds.len(),
        worst_ms[0],
        worst_ms[1]
    );
}

criterion_group!(benches, search);
criterion_main!(benches);
