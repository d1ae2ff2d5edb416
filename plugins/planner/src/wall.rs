//! Walls that probably go on where nothing is known.
//!
//! Hedges, fences and the edges of thickets are longer than what a camera sees of them. A planner that takes everything
//! unknown for free expects each of them to end just beyond what has been seen, and so follows the longest one to its end,
//! however far it leads away from the goal. What has been seen over a length without an end is as likely to go on for
//! as long again as to end before that (Gott 1993), so unknown cells in line with a wall are dearer, the more the nearer
//! they are to its end.

use crate::costs::MAX_COST;

/// Length from which on a row of obstacles is a wall, and the greatest length by which one is continued, m.
const LEAST_M: f64 = 2.0;
const LONGEST_M: f64 = 10.0;
/// Directions in which a wall may run.
const DIRECTIONS: usize = 16;
/// A wall may have gaps of as many cells.
const GAP_CELLS: usize = 2;

/// How walls are continued.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Continued {
    /// Length of the continuation as a share of what was seen of the wall.
    pub(crate) share: f64,
    /// Cost of the first cell of it; it falls with the distance.
    pub(crate) cost: u8,
    /// Cost to which it falls.
    pub(crate) unknown: u8,
}

/// The costs of unknown cells in line with walls, and the memory for them.
#[derive(Clone, Debug, Default)]
pub(crate) struct Walls {
    /// By cells; 0 for no wall. Empty if walls are not continued.
    costs: Vec<u8>,
}

/// What is known of the cells of a map, by rows.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Known<'a> {
    pub(crate) columns: usize,
    pub(crate) cell_size_m: f64,
    pub(crate) is_obstacle: &'a [bool],
    pub(crate) is_unknown: &'a [bool],
}

impl Known<'_> {
    fn index(&self, [column, row]: [i32; 2]) -> Option<usize> {
        let (column, row) = (usize::try_from(column).ok()?, usize::try_from(row).ok()?);
        let is_inside = column < self.columns && row < self.is_unknown.len() / self.columns;
        is_inside.then(|| row * self.columns + column)
    }

    fn is_unknown(&self, cell: [i32; 2]) -> bool {
        self.index(cell).is_some_and(|at| self.is_unknown[at])
    }

    fn is_obstacle(&self, cell: [i32; 2]) -> bool {
        self.index(cell).is_some_and(|at| self.is_obstacle[at])
    }
}

/// A line of cells from one of them in a direction.
#[derive(Clone, Copy, Debug)]
struct Line {
    from: [f64; 2],
    /// Of length 1, cells.
    along: [f64; 2],
}

impl Line {
    /// The cell at a distance along the line, and `beside` cells to its left.
    fn cell(&self, at: f64, beside: f64) -> [i32; 2] {
        let [x, y] = self.along;
        [
            libm::floor(self.from[0] + x * at - y * beside + 0.5) as i32,
            libm::floor(self.from[1] + y * at + x * beside + 0.5) as i32,
        ]
    }

    /// Whether there is an obstacle on the line or beside it.
    fn meets_obstacle(&self, known: &Known<'_>, at: f64) -> bool {
        [0.0, 1.0, -1.0].iter().any(|&beside| known.is_obstacle(self.cell(at, beside)))
    }

    /// Whether the wall's end in this direction has not been seen: what comes after it is unknown.
    fn is_open(&self, known: &Known<'_>) -> bool {
        known.is_unknown(self.cell(1.5, 0.0))
            && (!self.meets_obstacle(known, 1.5) || known.is_unknown(self.cell(2.5, 0.0)))
    }

    /// Length of the wall behind the start of the line, cells; at most `longest`.
    fn seen(&self, known: &Known<'_>, longest: usize) -> usize {
        let (mut length, mut gap) = (0, 0);
        for at in 1..=longest {
            if self.meets_obstacle(known, -(at as f64)) {
                (length, gap) = (at, 0);
            } else {
                gap += 1;
                if gap > GAP_CELLS {
                    break;
                }
            }
        }
        length
    }
}

impl Walls {
    /// Forgets all walls.
    pub(crate) fn clear(&mut self) {
        self.costs.clear();
    }

    /// Finds the walls of a map, and what unknown cells in line with them cost.
    pub(crate) fn find(&mut self, known: &Known<'_>, continued: &Continued) {
        self.costs.clear();
        self.costs.resize(known.is_unknown.len(), 0);
        let longest = (LONGEST_M / continued.share.max(0.2) / known.cell_size_m) as usize;
        let directions: Vec<[f64; 2]> = (0..DIRECTIONS)
            .map(|direction| direction as f64 * std::f64::consts::TAU / DIRECTIONS as f64)
            .map(|angle| [libm::cos(angle), libm::sin(angle)])
            .collect();
        for (at, _) in known.is_obstacle.iter().enumerate().filter(|(_, is_obstacle)| **is_obstacle) {
            let from = [(at % known.columns) as f64, (at / known.columns) as f64];
            for &along in &directions {
                let line = Line { from, along };
                if !line.is_open(known) {
                    continue;
                }
                let seen_m = line.seen(known, longest) as f64 * known.cell_size_m;
                if seen_m >= LEAST_M {
                    let length_m = (continued.share * seen_m).min(LONGEST_M);
                    self.lay(known, &line, length_m / known.cell_size_m, continued);
                }
            }
        }
    }

    /// Makes the unknown cells on a line dearer, up to a distance in cells or to ground that is known.
    fn lay(&mut self, known: &Known<'_>, line: &Line, length: f64, continued: &Continued) {
        let (dear, unknown) = (f64::from(continued.cost), f64::from(continued.unknown));
        for at in 1..=length as usize {
            let Some(cell) = known.index(line.cell(at as f64, 0.0)) else { return };
            if known.is_unknown[cell] {
                let cost = unknown + (dear - unknown).max(0.0) * (1.0 - at as f64 / length);
                self.costs[cell] = self.costs[cell].max(cost.clamp(1.0, f64::from(MAX_COST)) as u8);
            } else if at > 2 && !known.is_obstacle[cell] {
                return;
            }
        }
    }

    /// What an unknown cell costs in which a wall probably goes on; `None` for others.
    pub(crate) fn cost(&self, at: usize) -> Option<u8> {
        self.costs.get(at).copied().filter(|&cost| cost > 0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const COLUMNS: usize = 60;
    const CONTINUED: Continued = Continued { share: 0.5, cost: 200, unknown: 18 };

    /// A map of 60 by 21 cells of 0.4 m: known to column 29, with a wall in row 10 from one column up to another.
    fn costs(wall: std::ops::RangeInclusive<usize>, known: usize, continued: &Continued) -> Walls {
        let cells = (0..COLUMNS * 21).map(|at| (at % COLUMNS, at / COLUMNS));
        let is_obstacle: Vec<bool> =
            cells.clone().map(|(column, row)| row == 10 && wall.contains(&column)).collect();
        let is_unknown: Vec<bool> =
            cells.map(|(column, row)| column > known && !(row == 10 && wall.contains(&column))).collect();
        let mut walls = Walls::default();
        let known =
            Known { columns: COLUMNS, cell_size_m: 0.4, is_obstacle: &is_obstacle, is_unknown: &is_unknown };
        walls.find(&known, continued);
        walls
    }

    #[test]
    fn a_wall_goes_on_for_half_of_what_was_seen_of_it_and_ever_less_surely() {
        // 8 m of it were seen, so it goes on for 4 m.
        let walls = costs(9..=29, 29, &CONTINUED);
        let along: Vec<u8> = (30..42).map(|column| walls.cost(10 * COLUMNS + column).unwrap_or(0)).collect();
        assert!(along.windows(2).all(|pair| pair[0] > pair[1] || pair == [0, 0]), "{along:?}");
        assert!(along[0] > 160 && along[8] > 18 && along[11] == 0, "{along:?}");
        assert_eq!(walls.cost(3 * COLUMNS + 30), None, "beside the wall");
        assert_eq!(walls.cost(10 * COLUMNS + 20), None, "the wall itself");
    }

    #[test]
    fn short_rows_of_obstacles_and_walls_with_an_end_that_was_seen_do_not_go_on() {
        let is_none = |walls: &Walls| (0..COLUMNS * 21).all(|at| walls.cost(at).is_none());
        assert!(is_none(&costs(26..=29, 29, &CONTINUED)), "1.6 m");
        assert!(is_none(&costs(9..=25, 29, &CONTINUED)), "its end was seen");
        let all_known = costs(9..=29, COLUMNS, &CONTINUED);
        assert!(is_none(&all_known), "nothing is unknown");
    }

    #[test]
    fn gaps_of_two_cells_do_not_end_a_wall_and_no_wall_goes_on_for_more_than_ten_metres() {
        let continued = Continued { share: 5.0, ..CONTINUED };
        let walls = costs(9..=29, 29, &continued);
        let last = (30..COLUMNS).filter(|column| walls.cost(10 * COLUMNS + column).is_some()).max();
        assert_eq!(last, Some(29 + 25), "10 m");
        let mut walls = Walls::default();
        let is_obstacle: Vec<bool> = (0..COLUMNS).map(|at| at <= 29 && at % 3 == 2).collect();
        let is_unknown: Vec<bool> = (0..COLUMNS).map(|at| at > 29).collect();
        let known =
            |is_obstacle| Known { columns: COLUMNS, cell_size_m: 0.4, is_obstacle, is_unknown: &is_unknown };
        walls.find(&known(&is_obstacle), &CONTINUED);
        assert!(walls.cost(33).is_some());
        let wider: Vec<bool> = (0..COLUMNS).map(|at| at <= 29 && at % 6 == 5).collect();
        walls.find(&known(&wider), &CONTINUED);
        assert_eq!(walls.cost(33), None, "single posts");
    }
}
