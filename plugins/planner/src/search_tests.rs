//! The search against plain Dijkstra, on random maps and on shapes that are hard for A*.

use super::*;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Deterministic pseudo-random numbers: splitmix64.
struct Numbers(u64);

impl Numbers {
    fn below(&mut self, end: u64) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (z ^ (z >> 31)) % end
    }
}

/// The steps that are allowed from a cell, with their costs in parts.
fn steps_from(costs: &CostGrid, from: Place) -> impl Iterator<Item = (Place, u64)> + '_ {
    let free = |column, row| costs.get(Place::new(column, row)).is_some_and(|cost| cost != BLOCKED);
    STEPS.into_iter().filter_map(move |(dx, dy)| {
        let to = Place::new(from.column + dx, from.row + dy);
        let is_diagonal = dx != 0 && dy != 0;
        let passes = !is_diagonal || (free(to.column, from.row) && free(from.column, to.row));
        let length = if is_diagonal { DIAGONAL } else { STRAIGHT };
        let cost = costs.get(to).filter(|&cost| cost != BLOCKED && passes)?;
        Some((to, u64::from(length) * u64::from(cost)))
    })
}

/// Dijkstra with a heap: cost of the cheapest path, in parts.
fn reference_cost(costs: &CostGrid, start: Place, goal: Place, beyond: u64) -> Option<u64> {
    let columns = costs.columns();
    let index = |place: Place| place.row as usize * columns + place.column as usize;
    let mut best = vec![u64::MAX; columns * costs.rows()];
    // Cost and cell in one number, which orders them.
    let mut open = BinaryHeap::from([Reverse(index(start) as u64)]);
    best[index(start)] = 0;
    let mut exit: Option<u64> = None;
    while let Some(Reverse(entry)) = open.pop() {
        let (cost, at) = (entry >> 24, (entry & 0xff_ffff) as usize);
        if cost > best[at] {
            continue;
        }
        let here = Place::new((at % columns) as i32, (at / columns) as i32);
        if here == goal {
            return Some(cost);
        }
        let edges =
            [here.column, here.row, columns as i32 - 1 - here.column, costs.rows() as i32 - 1 - here.row];
        if !costs.contains(goal) && edges.contains(&0) {
            let total = cost + here.octile(goal) * beyond;
            exit = Some(exit.map_or(total, |other| other.min(total)));
        }
        for (to, step) in steps_from(costs, here) {
            let reached = cost + step;
            if reached < best[index(to)] {
                best[index(to)] = reached;
                open.push(Reverse(reached << 24 | index(to) as u64));
            }
        }
    }
    exit
}

/// Adds up the steps of a path, in parts; each must be allowed.
fn cost_of(costs: &CostGrid, cells: &[Place]) -> u64 {
    let step = |pair: &[Place]| steps_from(costs, pair[0]).find(|&(to, _)| to == pair[1]).expect("a step").1;
    cells.windows(2).map(step).sum()
}

fn check(search: &mut Search, costs: &CostGrid, start: Place, goal: Place, beyond: u8) {
    let mut path = Path::default();
    let result = search.path(costs, start, goal, beyond, &mut path);
    let blocked = costs.get(goal) == Some(BLOCKED) && start != goal;
    let expected = if blocked { None } else { reference_cost(costs, start, goal, u64::from(beyond)) };
    let left = |cells: &[Place]| match cells.last() {
        Some(last) if !costs.contains(goal) => last.octile(goal) * u64::from(beyond),
        _ => 0,
    };
    let found = result.is_ok().then(|| cost_of(costs, &path.cells) + left(&path.cells));
    assert_eq!(found, expected, "{result:?} from {start:?} to {goal:?}");
    if result.is_ok() {
        assert_eq!(path.cells.first(), Some(&start));
        assert!(!costs.contains(goal) || path.cells.last() == Some(&goal));
        let whole = found.unwrap_or(0) as f64 / f64::from(STRAIGHT);
        assert!((path.cost - whole).abs() <= 2e-6 * whole + 1e-9, "{} {whole}", path.cost);
    }
}

const SIDE: usize = 201;
const MIDDLE: Place = Place::new(100, 100);

/// 2500 maps of 201×201 cells: start in the middle, a goal on the border, or outside.
fn check_maps(seed: u64, cells: impl Fn(&mut Numbers) -> Vec<u8>) {
    let mut numbers = Numbers(seed);
    let mut search = Search::default();
    for _ in 0..2500 {
        let mut cells = cells(&mut numbers);
        cells[100 * SIDE + 100] = 1;
        let costs = CostGrid::new(SIDE, SIDE, cells).unwrap();
        let (side, along) = (numbers.below(5), numbers.below(SIDE as u64) as i32);
        let goal = match side {
            0 => Place::new(along, 0),
            1 => Place::new(along, 200),
            2 => Place::new(0, along),
            3 => Place::new(200, along),
            _ => Place::new(along * 5 - 400, 300),
        };
        check(&mut search, &costs, MIDDLE, goal, 1 + numbers.below(40) as u8);
    }
}

/// Costs up to a bound, with 0 to 40 % blocked.
fn random(numbers: &mut Numbers, dearest: u64) -> Vec<u8> {
    let blocked = numbers.below(41);
    let mut cell = || {
        if numbers.below(100) < blocked { BLOCKED } else { 1 + numbers.below(dearest) as u8 }
    };
    (0..SIDE * SIDE).map(|_| cell()).collect()
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

/// A cup around the middle that opens away from the goal or towards it, on ground of two costs.
fn cup(numbers: &mut Numbers) -> Vec<u8> {
    let cost = 1 + numbers.below(250);
    let mut cells: Vec<u8> = (0..SIDE * SIDE).map(|_| (cost / (1 + numbers.below(2))).max(1) as u8).collect();
    let (near, far) = (5 + numbers.below(90) as usize, 105 + numbers.below(90) as usize);
    let open = numbers.below(4);
    for at in near..=far {
        let walls = [near * SIDE + at, far * SIDE + at, at * SIDE + near, at * SIDE + far];
        (0..4).filter(|&wall| wall != open as usize).for_each(|wall| cells[walls[wall]] = BLOCKED);
    }
    cells
}

#[test]
fn it_costs_what_dijkstra_finds_on_2500_maps_of_random_costs() {
    check_maps(1, |numbers| random(numbers, 250));
}

#[test]
fn it_costs_what_dijkstra_finds_on_2500_maps_of_few_costs() {
    check_maps(2, |numbers| {
        let dearest = 1 + numbers.below(4);
        random(numbers, dearest)
    });
}

#[test]
fn it_costs_what_dijkstra_finds_on_2500_combs() {
    check_maps(3, comb);
}

#[test]
fn it_costs_what_dijkstra_finds_on_2500_cups() {
    check_maps(4, cup);
}

#[test]
fn a_small_grid_after_a_large_one_and_of_any_shape() {
    let mut numbers = Numbers(5);
    let mut search = Search::default();
    for _ in 0..3000 {
        let (columns, rows) = (1 + numbers.below(20) as usize, 1 + numbers.below(20) as usize);
        let mut cell = || if numbers.below(4) == 0 { BLOCKED } else { 1 + numbers.below(6) as u8 };
        let cells = (0..columns * rows).map(|_| cell()).collect();
        let costs = CostGrid::new(columns, rows, cells).unwrap();
        let start = Place::new(numbers.below(columns as u64) as i32, numbers.below(rows as u64) as i32);
        let goal = Place::new(numbers.below(24) as i32 - 2, numbers.below(24) as i32 - 2);
        check(&mut search, &costs, start, goal, 3);
    }
}

#[test]
fn no_path_cuts_a_corner() {
    let costs = CostGrid::new(3, 2, vec![1, BLOCKED, 1, 1, 1, 1]).unwrap();
    let mut path = Path::default();
    Search::default().path(&costs, Place::new(0, 0), Place::new(2, 0), 1, &mut path).unwrap();
    let cells = [(0, 0), (0, 1), (1, 1), (2, 1), (2, 0)];
    assert_eq!(path.cells, cells.map(|(column, row)| Place::new(column, row)));
    assert_eq!(path.cost, 4.0);
}

#[test]
fn of_equally_cheap_paths_one_with_few_turns_is_returned() {
    let costs = CostGrid::new(30, 20, vec![7; 600]).unwrap();
    let mut path = Path::default();
    Search::default().path(&costs, Place::new(1, 1), Place::new(25, 11), 1, &mut path).unwrap();
    let step = |pair: &[Place]| (pair[1].column - pair[0].column, pair[1].row - pair[0].row);
    let steps: Vec<_> = path.cells.windows(2).map(step).collect();
    assert_eq!(steps.windows(2).filter(|pair| pair[0] != pair[1]).count(), 1, "{steps:?}");
}

#[test]
fn a_start_inside_of_an_obstacle_leaves_it_and_a_goal_inside_of_one_is_told() {
    let costs = CostGrid::new(4, 1, vec![BLOCKED, 2, 2, BLOCKED]).unwrap();
    let (mut search, mut path) = (Search::default(), Path::default());
    search.path(&costs, Place::new(0, 0), Place::new(2, 0), 1, &mut path).unwrap();
    assert_eq!((path.cells.len(), path.cost), (3, 4.0));
    let mut ends = |start, goal| search.path(&costs, start, goal, 1, &mut path);
    assert_eq!(ends(Place::new(1, 0), Place::new(3, 0)), Err(NoPath::GoalBlocked));
    assert_eq!(ends(Place::new(9, 0), Place::new(2, 0)), Err(NoPath::StartOutside(Place::new(9, 0))));
    assert_eq!(ends(Place::new(2, 0), Place::new(2, 0)), Ok(()));
    assert_eq!(ends(Place::new(2, 0), Place::new(i32::MAX, 0)), Err(NoPath::TooDear));
}

#[test]
fn a_second_search_of_the_same_size_allocates_nothing() {
    let mut numbers = Numbers(6);
    let (mut search, mut path) = (Search::default(), Path::default());
    let mut memory = |cells: Vec<u8>| {
        let costs = CostGrid::new(SIDE, SIDE, cells).unwrap();
        let _ = search.path(&costs, MIDDLE, Place::new(200, 3), 1, &mut path);
        (search.cost.as_ptr(), search.reached.as_ptr(), search.allowed.as_ptr(), search.queue.capacity())
    };
    let first = memory(random(&mut numbers, 250));
    for _ in 0..20 {
        assert_eq!(memory(random(&mut numbers, 250)), first);
    }
}
