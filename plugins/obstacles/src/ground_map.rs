//! The ground map for negative obstacles: cells of 0.1 m that scroll with the vehicle and accumulate the projected
//! ground pixels and the borders found in columns (Albus 2006a, 3.1.1).
//!
//! A hole in a single column may be noise. A border counts when enough columns, of this frame and of earlier ones, have
//! found a border in the same cell, and when such cells adjoin over the minimum length. Each frame that sees ground in
//! a cell and no border removes one vote for a border. The errors of stereo in neighbouring columns are alike, and near
//! the edge of an image they are large where a calibration is a little off; so one frame can be kept from having enough
//! votes by itself.

use rcs_geom::{CellIndex, GridError, ScrollGrid};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// Size of a cell, m: half of a cell of the cost map.
pub const GROUND_CELL_M: f64 = 0.1;
/// Cells per side: 20 m, as far as ranges are precise enough for holes.
pub const GROUND_SIDE: usize = 201;

/// Knowledge about 0.1 m × 0.1 m of ground.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct GroundCell {
    /// Mean height of its ground pixels in the local frame, m; recent pixels have more weight.
    pub height_m: f32,
    /// Number of ground pixels, up to a maximum.
    pub pixels: u16,
    /// Number of columns that found a border here, minus later votes against it.
    pub borders: u16,
    /// When it was last seen, ns; 0 for never.
    pub seen_ns: u64,
}

/// The vote of consecutive pixels of one column for one cell of the ground map.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GroundVote {
    /// Cell of [`GROUND_CELL_M`]: floor(position / cell size), x and y.
    pub cell: [i32; 2],
    /// Number of ground pixels.
    pub pixels: u32,
    /// Sum of their heights relative to the sensor, m.
    pub height_sum: f32,
    /// Number of hole borders.
    pub borders: u32,
}

/// Maximum weight of a mean relative to new pixels.
const MAX_WEIGHT: u32 = 400;

/// The ground map.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct GroundMap {
    grid: ScrollGrid<GroundCell>,
}

/// When borders count.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BorderRule {
    /// Time for which cells are remembered, ns.
    pub memory_ns: u64,
    /// Minimum number of columns that found a border in a cell.
    pub min_votes: u32,
    /// Minimum number of frames that these votes come from.
    pub min_frames: u32,
    /// Minimum length of adjoining border cells, m.
    pub min_length_m: f64,
}

impl GroundMap {
    /// An empty map.
    pub fn new() -> Result<GroundMap, GridError> {
        Ok(GroundMap { grid: ScrollGrid::new(GROUND_SIDE, GROUND_CELL_M, GroundCell::default())? })
    }

    /// The cell at an index; `None` outside of the window.
    pub fn get(&self, cell: CellIndex) -> Option<&GroundCell> {
        self.grid.get(cell)
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        self.grid.clear();
    }

    /// Moves the window around the vehicle.
    pub fn recentre(&mut self, centre: CellIndex) {
        self.grid.recentre(centre);
    }

    /// Adds one frame, taken at `time_ns`; heights of votes are relative to a sensor at height `sensor_z` (m). Returns
    /// the cells in which this frame found a border that counts.
    pub fn add<'a>(
        &mut self,
        votes: impl IntoIterator<Item = &'a GroundVote>,
        sensor_z: f64,
        time_ns: u64,
        rule: &BorderRule,
    ) -> BTreeSet<CellIndex> {
        let bounds = self.grid.bounds();
        let mut frame = vec![Sums::default(); GROUND_SIDE * GROUND_SIDE];
        for vote in votes {
            let cell = CellIndex::new(vote.cell[0].into(), vote.cell[1].into());
            if bounds.contains(cell) {
                let (column, row) = (cell.x - bounds.south_west.x, cell.y - bounds.south_west.y);
                let sums = &mut frame[row as usize * GROUND_SIDE + column as usize];
                sums.pixels += vote.pixels;
                sums.height += f64::from(vote.height_sum);
                sums.borders += vote.borders;
            }
        }
        let mut seen = BTreeSet::new();
        for (at, sums) in frame.iter().enumerate().filter(|(_, sums)| sums.pixels + sums.borders > 0) {
            let index = bounds.south_west.offset((at % GROUND_SIDE) as i64, (at / GROUND_SIDE) as i64);
            let Some(cell) = self.grid.get_mut(index) else { continue };
            cell.take(sums, sensor_z, time_ns, rule);
            if sums.borders > 0 && u32::from(cell.borders) >= rule.min_votes {
                seen.insert(index);
            }
        }
        self.long_enough(&seen, time_ns, rule)
    }

    /// Keeps the cells that belong to a border of at least the minimum length.
    fn long_enough(
        &self,
        seen: &BTreeSet<CellIndex>,
        time_ns: u64,
        rule: &BorderRule,
    ) -> BTreeSet<CellIndex> {
        let is_border = |index: CellIndex| {
            self.grid.get(index).is_some_and(|cell| {
                u32::from(cell.borders) >= rule.min_votes && !cell.is_forgotten(time_ns, rule)
            })
        };
        let mut kept = BTreeSet::new();
        let mut visited = BTreeSet::new();
        for &start in seen {
            if !visited.insert(start) {
                continue;
            }
            let mut patch = vec![start];
            let (mut low, mut high) = (start, start);
            let mut next = 0;
            while let Some(&cell) = patch.get(next) {
                next += 1;
                (low.x, low.y) = (low.x.min(cell.x), low.y.min(cell.y));
                (high.x, high.y) = (high.x.max(cell.x), high.y.max(cell.y));
                for (dx, dy) in (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dx, dy))) {
                    let neighbour = cell.offset(dx, dy);
                    if is_border(neighbour) && visited.insert(neighbour) {
                        patch.push(neighbour);
                    }
                }
            }
            let cells = (high.x - low.x).max(high.y - low.y) + 1;
            if cells as f64 * GROUND_CELL_M >= rule.min_length_m {
                kept.extend(patch.into_iter().filter(|cell| seen.contains(cell)));
            }
        }
        kept
    }
}

/// Votes of one frame for one cell.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    pixels: u32,
    height: f64,
    borders: u32,
}

impl GroundCell {
    /// Whether it was seen too long before a time, or as long after it: then its clock has begun again.
    fn is_forgotten(&self, time_ns: u64, rule: &BorderRule) -> bool {
        time_ns.abs_diff(self.seen_ns) > rule.memory_ns
    }

    fn take(&mut self, sums: &Sums, sensor_z: f64, time_ns: u64, rule: &BorderRule) {
        if self.is_forgotten(time_ns, rule) {
            *self = GroundCell::default();
        }
        self.seen_ns = self.seen_ns.max(time_ns);
        if sums.pixels > 0 {
            let (old, new) = (f64::from(self.pixels), f64::from(sums.pixels));
            let sum = f64::from(self.height_m) * old + sums.height + sensor_z * new;
            self.height_m = (sum / (old + new)) as f32;
            self.pixels = (u32::from(self.pixels) + sums.pixels).min(MAX_WEIGHT) as u16;
        }
        self.borders = if sums.borders > 0 {
            let most = rule.min_votes.div_ceil(rule.min_frames.max(1));
            let votes = if rule.min_frames > 1 { sums.borders.min(most) } else { sums.borders };
            (u32::from(self.borders) + votes).min(u16::MAX.into()) as u16
        } else {
            self.borders.saturating_sub(1)
        };
    }
}
