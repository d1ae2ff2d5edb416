//! Cheapest path over a grid: A* with eight neighbours.
//!
//! A step costs its length times the mean cost of its two cells. A diagonal step requires both cells beside it to be
//! free. Ties are broken by cell number, so every machine finds the same path.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// The grid to search: cost per metre of every cell, in row order; infinite where blocked.
#[derive(Clone, Copy, Debug)]
pub struct Field<'a> {
    /// Cells per row.
    pub columns: usize,
    /// Size of a cell, m.
    pub cell_size_m: f64,
    /// At least 1, or infinite.
    pub cost: &'a [f32],
}

/// A path, and the effort of finding it.
#[derive(Clone, Debug, PartialEq)]
pub struct Found {
    /// Cell numbers from start to goal.
    pub cells: Vec<usize>,
    /// Total cost, m.
    pub cost_m: f64,
    /// Number of cells taken from the queue.
    pub expanded: u64,
}

#[derive(Clone, Copy, PartialEq)]
struct Open {
    estimate: f64,
    cell: usize,
}

impl Eq for Open {}

impl Ord for Open {
    /// Reversed, because `BinaryHeap` returns the greatest element first.
    fn cmp(&self, other: &Self) -> Ordering {
        other.estimate.total_cmp(&self.estimate).then(other.cell.cmp(&self.cell))
    }
}

impl PartialOrd for Open {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

/// Steps to the neighbours: columns, rows, length in cells.
const STEPS: [(i64, i64, f64); 8] = [
    (1, 0, 1.0),
    (0, 1, 1.0),
    (-1, 0, 1.0),
    (0, -1, 1.0),
    (1, 1, std::f64::consts::SQRT_2),
    (-1, 1, std::f64::consts::SQRT_2),
    (-1, -1, std::f64::consts::SQRT_2),
    (1, -1, std::f64::consts::SQRT_2),
];

impl Field<'_> {
    fn neighbour(&self, cell: usize, dc: i64, dr: i64) -> Option<usize> {
        let column = (cell % self.columns) as i64 + dc;
        let row = (cell / self.columns) as i64 + dr;
        let inside = (0..self.columns as i64).contains(&column) && row >= 0;
        let at = row * self.columns as i64 + column;
        (inside && (at as usize) < self.cost.len()).then_some(at as usize)
    }

    /// Cost of a step; `None` where it is not allowed.
    fn step_cost(&self, from: usize, (dc, dr, length): (i64, i64, f64)) -> Option<(usize, f64)> {
        let to = self.neighbour(from, dc, dr).filter(|&to| self.cost[to].is_finite())?;
        if dc != 0 && dr != 0 {
            let beside = [self.neighbour(from, dc, 0), self.neighbour(from, 0, dr)];
            if beside.iter().any(|cell| cell.is_none_or(|cell| !self.cost[cell].is_finite())) {
                return None;
            }
        }
        let mean = f64::midpoint(f64::from(self.cost[from]), f64::from(self.cost[to]));
        Some((to, length * self.cell_size_m * mean))
    }

    /// Length of the shortest path over free cells of cost 1, m: a lower bound (admissible heuristic).
    fn at_least_m(&self, from: usize, to: usize) -> f64 {
        let columns = (from % self.columns).abs_diff(to % self.columns) as f64;
        let rows = (from / self.columns).abs_diff(to / self.columns) as f64;
        let (long, short) = (columns.max(rows), columns.min(rows));
        (long + (std::f64::consts::SQRT_2 - 1.0) * short) * self.cell_size_m
    }
}

/// The cheapest path; `None` where there is none. Cells are numbered in row order.
pub fn shortest(field: &Field<'_>, start: usize, goal: usize) -> Option<Found> {
    let count = field.cost.len();
    if start >= count || goal >= count || !field.cost[goal].is_finite() {
        return None;
    }
    let mut best = vec![f64::INFINITY; count];
    let mut from = vec![u32::MAX; count];
    let mut open = BinaryHeap::new();
    best[start] = 0.0;
    open.push(Open { estimate: field.at_least_m(start, goal), cell: start });
    let mut expanded = 0;
    while let Some(Open { estimate, cell }) = open.pop() {
        if cell == goal {
            let cells = trace(&from, start, goal);
            return Some(Found { cells, cost_m: best[goal], expanded });
        }
        // A stale entry: the cell was queued again with a lower cost and has been expanded since.
        if estimate > best[cell] + field.at_least_m(cell, goal) {
            continue;
        }
        expanded += 1;
        for step in STEPS {
            let Some((to, cost)) = field.step_cost(cell, step) else { continue };
            let reached = best[cell] + cost;
            if reached < best[to] {
                best[to] = reached;
                from[to] = cell as u32;
                open.push(Open { estimate: reached + field.at_least_m(to, goal), cell: to });
            }
        }
    }
    None
}

fn trace(from: &[u32], start: usize, goal: usize) -> Vec<usize> {
    let mut cells = vec![goal];
    let mut cell = goal;
    while cell != start {
        cell = from[cell] as usize;
        cells.push(cell);
    }
    cells.reverse();
    cells
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Relaxes all steps until nothing changes (Bellman-Ford).
    fn reference_cost(field: &Field<'_>, start: usize, goal: usize) -> Option<f64> {
        let mut best = vec![f64::INFINITY; field.cost.len()];
        best[start] = 0.0;
        loop {
            let mut changed = false;
            for cell in 0..field.cost.len() {
                for step in STEPS {
                    if let Some((to, cost)) = field.step_cost(cell, step)
                        && best[cell] + cost < best[to] - 1e-12
                    {
                        best[to] = best[cell] + cost;
                        changed = true;
                    }
                }
            }
            if !changed {
                let found = best[goal].is_finite() && field.cost[goal].is_finite();
                return found.then_some(best[goal]);
            }
        }
    }

    proptest! {
        #[test]
        fn it_costs_what_the_plain_search_finds(
            columns in 2..14_usize,
            cells in prop::collection::vec(0..12_u8, 30..150),
            start: prop::sample::Index,
            goal: prop::sample::Index,
        ) {
            let count = cells.len() / columns * columns;
            let mut cost: Vec<f32> = cells[..count]
                .iter()
                .map(|&cell| if cell < 3 { f32::INFINITY } else { 1.0 + f32::from(cell - 3) * 0.7 })
                .collect();
            let (start, goal) = (start.index(count), goal.index(count));
            cost[start] = 1.0;
            let field = Field { columns, cell_size_m: 0.2, cost: &cost };
            let found = shortest(&field, start, goal);
            let reference = reference_cost(&field, start, goal);
            prop_assert_eq!(found.is_some(), reference.is_some());
            if let (Some(found), Some(reference)) = (found, reference) {
                prop_assert!((found.cost_m - reference).abs() < 1e-9);
                prop_assert_eq!((found.cells[0], *found.cells.last().unwrap()), (start, goal));
                let mut sum = 0.0;
                for pair in found.cells.windows(2) {
                    let step = STEPS.into_iter().filter_map(|step| field.step_cost(pair[0], step));
                    sum += step.filter(|&(to, _)| to == pair[1]).map(|(_, cost)| cost).next().unwrap();
                }
                prop_assert!((sum - found.cost_m).abs() < 1e-9, "its cells are neighbours that cost as much");
            }
        }
    }

    #[test]
    fn no_path_cuts_a_corner() {
        let x = f32::INFINITY;
        let cost = [1.0, x, 1.0, 1.0, 1.0, 1.0];
        let found = shortest(&Field { columns: 3, cell_size_m: 1.0, cost: &cost }, 0, 2).unwrap();
        assert_eq!(found.cells, [0, 3, 4, 5, 2]);
    }
}
