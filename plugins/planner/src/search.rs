//! The cheapest path over a grid of costs: A* with eight neighbours.
//!
//! **Cost.** Entering a cell costs its cost times the length of the step in cells: 1, or √2 for a diagonal one. The
//! cell of the start is not entered. A diagonal step needs both cells beside it to be free.
//!
//! **Exactness.** Lengths are whole numbers, [`STRAIGHT`] and [`DIAGONAL`], whose ratio is √2 to 1.1 parts in a million;
//! so costs are exact, and the same on every machine. The path is the cheapest one in these numbers.
//!
//! **Method** (Albus 2006a, 5, \[32\]). A label-correcting A* with a queue of buckets: a cell that is reached more cheaply
//! after it has left the queue is queued again. The estimate is the octile distance times the lowest cost of the grid,
//! which is consistent; so the cells of the queue span few buckets, and the search ends when it has emptied the bucket in
//! which the goal's cost lies. Which of its eight neighbours a cell improves is computed without branches, because the
//! processor cannot predict them.
//!
//! **Ties.** Of equally cheap paths, the one is returned that, seen from its end, keeps its direction as long as
//! possible, and turns by the smallest angle otherwise. This does not depend on the order of the search.
//!
//! Memory is allocated when a larger grid is searched than before, and then reused.

pub use crate::place::{DIAGONAL, Place, STRAIGHT};

use crate::costs::{BLOCKED, CostGrid, MAX_COST};
use crate::queue::Queue;

/// Why there is no path.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoPath {
    /// The start lies outside of the grid.
    #[error("start is at column {}, row {}, expected a cell of the grid", .0.column, .0.row)]
    StartOutside(Place),
    /// The goal's cell is blocked.
    #[error("the goal is inside of an obstacle")]
    GoalBlocked,
    /// Start and goal are not connected.
    #[error("no free way leads to the goal")]
    NotConnected,
    /// The costs add up to more than the search can count.
    #[error("the grid is too large: costs exceed the range of 32 bits")]
    TooDear,
}

/// A path.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Path {
    /// Cells from the start to the goal, or, for a goal outside of the grid, to the cell in which it leaves the grid.
    pub cells: Vec<Place>,
    /// Its cost: cells entered, times their cost and the length of the step in cells; plus [`Path::beyond`].
    pub cost: f64,
    /// Estimated cost from the edge of the grid to a goal outside of it.
    pub beyond: f64,
    /// Number of cells taken from the queue.
    pub expanded: u64,
}

/// The reusable memory of a search.
#[derive(Clone, Debug, Default)]
pub struct Search {
    /// Cells per row with the border of one blocked cell on each side.
    stride: usize,
    /// Costs, with the border.
    cost: Vec<u8>,
    /// For each cell, which of the eight steps from it are allowed.
    allowed: Vec<u8>,
    /// Cost from the start, in parts; [`UNREACHED`] where not known.
    reached: Vec<u32>,
    queue: Queue,
}

const UNREACHED: u32 = u32::MAX;

/// The eight directions: counter-clockwise, 0 along x. Odd ones are diagonal.
const STEPS: [(i32, i32); 8] = [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1)];
const fn length(direction: usize) -> u32 {
    if direction.is_multiple_of(2) { STRAIGHT } else { DIAGONAL }
}

/// Where a search ends, and how far that is at least.
#[derive(Clone, Copy)]
struct Target {
    goal: Place,
    /// The cell of the goal; `None` if it lies outside of the grid.
    cell: Option<usize>,
    columns: i32,
    rows: i32,
    /// Lowest cost of a cell.
    least: u32,
    /// Cost of the cells outside of the grid.
    beyond: u32,
    /// Greatest cost from which no sum exceeds 32 bits.
    limit: u32,
}

impl Target {
    /// A lower bound of the cost to the goal.
    #[inline]
    fn estimate(&self, column: i32, row: i32) -> u32 {
        self.octile(column, row) * self.least
    }

    /// Cost from a cell to the goal if all cells on the way lie outside of the grid.
    fn outside(&self, column: i32, row: i32) -> u32 {
        self.octile(column, row) * self.beyond
    }

    #[inline]
    fn octile(&self, column: i32, row: i32) -> u32 {
        let (dx, dy) = (column.abs_diff(self.goal.column), row.abs_diff(self.goal.row));
        STRAIGHT * (dx + dy) - (2 * STRAIGHT - DIAGONAL) * dx.min(dy)
    }

    fn is_on_edge(&self, column: i32, row: i32) -> bool {
        column == 0 || row == 0 || column == self.columns - 1 || row == self.rows - 1
    }

    fn new(costs: &CostGrid, goal: Place, beyond: u8, cell: Option<usize>) -> Result<Target, NoPath> {
        let (columns, rows) = (costs.columns() as i32, costs.rows() as i32);
        let beyond = u32::from(beyond.clamp(1, MAX_COST));
        let least = u32::from(costs.least());
        let least = if cell.is_some() { least } else { least.min(beyond) };
        let corners = [(0, 0), (columns - 1, 0), (0, rows - 1), (columns - 1, rows - 1)];
        let farthest = corners.map(|(column, row)| Place::new(column, row).octile(goal));
        let farthest = farthest.into_iter().max().unwrap_or(0);
        let ahead = farthest * u64::from(if cell.is_some() { least } else { beyond });
        let margin = ahead + 2 * u64::from(MAX_COST) * u64::from(DIAGONAL);
        let limit = u64::from(u32::MAX).checked_sub(margin).ok_or(NoPath::TooDear)? as u32;
        Ok(Target { goal, cell, columns, rows, least, beyond, limit })
    }
}

fn cell_at(stride: usize, column: i32, row: i32) -> usize {
    (row + 1) as usize * stride + (column + 1) as usize
}

/// Which of its eight neighbours a cell reaches at a lower cost than is known, one bit for each direction. Blocked ones
/// are not told apart.
#[inline]
fn improved(cost: &[u8], reached: &[u32], stride: usize, cell: usize) -> u8 {
    // A cell that is in the queue is never one of the border, so that it has all eight neighbours.
    let costs = |from: usize| cost[from..].first_chunk::<3>().copied().unwrap_or([0; 3]);
    let known = |from: usize| reached[from..].first_chunk::<3>().copied().unwrap_or([0; 3]);
    let (south, west, north) = (cell - stride - 1, cell - 1, cell + stride - 1);
    let ([sw, s, se], [w, _, e], [nw, n, ne]) = (costs(south), costs(west), costs(north));
    let [known_sw, known_s, known_se] = known(south);
    let [known_w, here, known_e] = known(west);
    let [known_nw, known_n, known_ne] = known(north);
    let straight = |cost: u8, known: u32| u8::from(here + u32::from(cost) * STRAIGHT < known);
    let diagonal = |cost: u8, known: u32| u8::from(here + u32::from(cost) * DIAGONAL < known);
    straight(e, known_e)
        | diagonal(ne, known_ne) << 1
        | straight(n, known_n) << 2
        | diagonal(nw, known_nw) << 3
        | straight(w, known_w) << 4
        | diagonal(sw, known_sw) << 5
        | straight(s, known_s) << 6
        | diagonal(se, known_se) << 7
}

impl Search {
    /// The cheapest path from a cell, which may be blocked, to a goal. The goal may lie outside of the grid: then the
    /// path ends in the cell of the grid's edge from which the goal costs least if every cell outside costs `beyond`
    /// (1 to 250).
    pub fn path(
        &mut self,
        costs: &CostGrid,
        start: Place,
        goal: Place,
        beyond: u8,
        path: &mut Path,
    ) -> Result<(), NoPath> {
        path.cells.clear();
        (path.cost, path.beyond, path.expanded) = (0.0, 0.0, 0);
        if !costs.contains(start) {
            return Err(NoPath::StartOutside(start));
        }
        if costs.get(goal) == Some(BLOCKED) && goal != start {
            return Err(NoPath::GoalBlocked);
        }
        self.prepare(costs);
        let inside = costs.contains(goal);
        let target = Target::new(costs, goal, beyond, inside.then(|| self.cell(goal)))?;
        let end = self.run(start, &target, &mut path.expanded)?;
        self.trace(start, end, path);
        let left = if inside { 0 } else { path.cells.last().map_or(0, |last| last.octile(goal)) };
        path.beyond = left as f64 * f64::from(target.beyond) / f64::from(STRAIGHT);
        path.cost = self.cost_of(path) + path.beyond;
        Ok(())
    }

    /// Whether the last search, which found no path, reached a cell: all that are connected with its start were.
    pub fn has_reached(&self, place: Place) -> bool {
        self.reached.get(self.cell(place)).is_some_and(|&cost| cost != UNREACHED)
    }

    /// Copies the costs, and finds which steps are allowed.
    fn prepare(&mut self, costs: &CostGrid) {
        let (columns, rows) = (costs.columns(), costs.rows());
        let stride = columns + 2;
        let count = stride * (rows + 2);
        if self.stride != stride || self.cost.len() != count {
            self.stride = stride;
            self.cost.clear();
            self.cost.resize(count, BLOCKED);
            self.allowed.clear();
            self.allowed.resize(count, 0);
            self.reached.resize(count, UNREACHED);
        }
        for (row, cells) in costs.cells().chunks_exact(columns).enumerate() {
            self.cost[(row + 1) * stride + 1..][..columns].copy_from_slice(cells);
        }
        self.reached.fill(UNREACHED);
        // A step raises the estimate by its cost and by as much as it may lead away from the goal.
        self.queue.clear(count / 4, 2 * u32::from(costs.most()) * DIAGONAL);
        for row in 1..=rows {
            let start = row * stride + 1;
            let around = |offset: usize| &self.cost[start + offset - stride - 1..][..columns];
            let (s, n) = (around(1), around(2 * stride + 1));
            let (w, e) = (around(stride), around(stride + 2));
            let (sw, se) = (around(0), around(2));
            let (nw, ne) = (around(2 * stride), around(2 * stride + 2));
            let allowed = &mut self.allowed[start..][..columns];
            for at in 0..columns {
                let free = |cells: &[u8]| u8::from(cells[at] != BLOCKED);
                let (east, north, west, south) = (free(e), free(n), free(w), free(s));
                allowed[at] = east
                    | (free(ne) & north & east) << 1
                    | north << 2
                    | (free(nw) & north & west) << 3
                    | west << 4
                    | (free(sw) & south & west) << 5
                    | south << 6
                    | (free(se) & south & east) << 7;
            }
        }
    }

    fn cell(&self, place: Place) -> usize {
        cell_at(self.stride, place.column, place.row)
    }

    /// Searches from the start until the cheapest way to the target is known; the cell in which it ends.
    fn run(&mut self, start: Place, target: &Target, expanded: &mut u64) -> Result<usize, NoPath> {
        let first = self.cell(start);
        let Self { stride, cost, allowed, reached, queue } = self;
        let (stride, cost, allowed, reached) = (*stride, &**cost, &**allowed, &mut **reached);
        let offsets = STEPS.map(|(dx, dy)| dy as isize * stride as isize + dx as isize);
        reached[first] = 0;
        let mut bucket = queue.bucket_of(target.estimate(start.column, start.row));
        queue.push(target.estimate(start.column, start.row), start.column as u16, start.row as u16, 0);
        // The cheapest way out of the grid so far: its cost and its last cell.
        let mut exit = (UNREACHED, first);
        while let Some(next) = queue.next_bucket(bucket) {
            bucket = next;
            let found = target.cell.map_or(exit.0, |cell| reached[cell]);
            if found != UNREACHED && queue.bucket_of(found) < bucket {
                break;
            }
            while let Some(entry) = queue.pop(bucket) {
                let (column, row) = (i32::from(entry.column), i32::from(entry.row));
                let cell = cell_at(stride, column, row);
                if reached[cell] != entry.reached {
                    continue;
                }
                if entry.reached > target.limit {
                    return Err(NoPath::TooDear);
                }
                *expanded += 1;
                if target.cell.is_none() && target.is_on_edge(column, row) {
                    exit = exit.min((entry.reached + target.outside(column, row), cell));
                }
                let mut steps = improved(cost, reached, stride, cell) & allowed[cell];
                while steps != 0 {
                    let direction = steps.trailing_zeros() as usize;
                    steps &= steps - 1;
                    let to = cell.wrapping_add_signed(offsets[direction]);
                    let cost = entry.reached + u32::from(cost[to]) * length(direction);
                    reached[to] = cost;
                    let (dx, dy) = STEPS[direction];
                    let (column, row) = (column + dx, row + dy);
                    queue.push(cost + target.estimate(column, row), column as u16, row as u16, cost);
                }
            }
        }
        let (cost, end) = target.cell.map_or(exit, |cell| (reached[cell], cell));
        if cost == UNREACHED { Err(NoPath::NotConnected) } else { Ok(end) }
    }

    /// Follows a cheapest path back from its end.
    fn trace(&self, start: Place, end: usize, path: &mut Path) {
        let offsets = STEPS.map(|(dx, dy)| dy as isize * self.stride as isize + dx as isize);
        let first = self.cell(start);
        let (mut cell, mut direction) = (end, 0);
        let place =
            |cell: usize| Place::new((cell % self.stride) as i32 - 1, (cell / self.stride) as i32 - 1);
        path.cells.push(place(cell));
        while cell != first {
            let from = |direction: usize| cell.wrapping_add_signed(-offsets[direction]);
            let is_cheapest = |direction: usize| {
                let before = from(direction);
                self.allowed[before] >> direction & 1 == 1
                    && self.reached[before] != UNREACHED
                    && self.reached[before] + u32::from(self.cost[cell]) * length(direction)
                        == self.reached[cell]
            };
            let turns = [0, 1, 7, 2, 6, 3, 5, 4].map(|turn| (direction + turn) % 8);
            let Some(found) = turns.into_iter().find(|&direction| is_cheapest(direction)) else { return };
            direction = found;
            cell = from(direction);
            path.cells.push(place(cell));
        }
        path.cells.reverse();
    }

    fn cost_of(&self, path: &Path) -> f64 {
        let step = |pair: &[Place]| {
            let cost = f64::from(self.cost[self.cell(pair[1])]);
            let diagonal = pair[0].column != pair[1].column && pair[0].row != pair[1].row;
            if diagonal { cost * std::f64::consts::SQRT_2 } else { cost }
        };
        path.cells.windows(2).map(step).sum()
    }
}

#[cfg(test)]
#[path = "search_tests.rs"]
mod tests;
