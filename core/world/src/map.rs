//! The map around the vehicle.

use rcs_geom::{CellIndex, DVec2, Exposed, GridError, ScrollGrid};
use rcs_msg::Stamp;
use serde::{Deserialize, Serialize};

use crate::{Cell, Fused, Source, VoteRule, Weights};

/// Cells a side, so that the vehicle is in cell (100, 100).
pub const SIDE: usize = 201;
/// Side of a cell of WM1, and of the cost maps that it takes, m.
pub const CELL_SIZE_M: f64 = 0.2;
/// Side of a cell of WM2, m.
pub const WIDE_CELL_SIZE_M: f64 = 0.6;

/// A world-model map: 201×201 cells, north-up, the vehicle in the middle one. WM1 has cells of 0.2 m (about 40 m across),
/// WM2 of 0.6 m (about 120 m).
///
/// Clones share what neither has written since.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Map {
    pub(crate) grid: ScrollGrid<Cell>,
}

impl Map {
    /// A map where nothing is known, around the frame's origin.
    pub fn new(cell_size_m: f64) -> Result<Map, GridError> {
        Ok(Map { grid: ScrollGrid::new(SIDE, cell_size_m, Cell::default())? })
    }

    /// The cells.
    pub fn grid(&self) -> &ScrollGrid<Cell> {
        &self.grid
    }

    /// The cells, to write.
    pub fn grid_mut(&mut self) -> &mut ScrollGrid<Cell> {
        &mut self.grid
    }

    /// Scrolls so that the vehicle (metres in the map's frame) is in the middle cell; cells that come into view are unknown.
    /// `None`, and nothing moves, for a position that is not finite.
    pub fn recentre(&mut self, p_vehicle: DVec2) -> Option<Exposed> {
        let centre = self.grid.cell_at(p_vehicle)?;
        Some(self.grid.recentre(centre))
    }

    /// Takes a vote of a source for a cell, see [`Cell::vote`]; false when the cell lies outside of the map.
    pub fn vote(
        &mut self,
        index: CellIndex,
        source: Source,
        cost: u8,
        sequence: u32,
        time: Stamp,
        rule: VoteRule,
    ) -> bool {
        self.grid.get_mut(index).map(|cell| cell.vote(source, cost, sequence, time, rule)).is_some()
    }

    /// What the sources say of a cell together; unknown outside of the map.
    pub fn fused(&self, index: CellIndex, weights: &Weights) -> Fused {
        self.grid.get(index).map_or(Fused::UNKNOWN, |cell| cell.fused(weights))
    }

    /// Forgets everything; the map stays where it is.
    pub fn clear(&mut self) {
        self.grid.clear();
    }
}
