//! The ground truth of a world in cells of 0.2 m, for evaluation and for drivers that may know it.

use crate::class::Class;
use crate::drive::TRUTH_CELL_M;
use crate::world::World;
use rcs_geom::DVec2;

/// Ground truth of one cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TruthCell {
    /// Class of the thing that covers the middle of the cell, else of its surface.
    pub class: Class,
    /// Height of the soil, m.
    pub ground_height_m: f64,
    /// Height of the vegetation, or of the thing that covers it, above the soil, m.
    pub cover_height_m: f64,
    /// Whether the cell is covered by a solid thing, foliage, a steep face (of a ditch or a ledge) or vegetation that
    /// does not give way.
    pub blocked: bool,
}

impl World {
    /// Columns and rows of the ground truth; the first cell is at the lower left corner of the bounds.
    pub fn truth_size(&self) -> [usize; 2] {
        self.inner.drive.size
    }

    /// Ground truth of a cell. `None` outside of the bounds.
    pub fn truth_cell(&self, column: usize, row: usize) -> Option<TruthCell> {
        let drive = &self.inner.drive;
        if column >= drive.size[0] || row >= drive.size[1] {
            return None;
        }
        let index = row * drive.size[0] + column;
        let at = self.bounds_m()[0] + (DVec2::new(column as f64, row as f64) + 0.5) * TRUTH_CELL_M;
        let ground = self.ground(at);
        let thing =
            drive.thing[index].checked_sub(1).and_then(|number| self.things().get(usize::from(number)));
        Some(TruthCell {
            class: thing.map_or(ground.surface.class(), |thing| thing.kind.class()),
            ground_height_m: ground.height_m,
            cover_height_m: thing.map_or(ground.vegetation_height_m, |thing| thing.height_m),
            blocked: drive.distance_m[index] == 0.0,
        })
    }

    /// Distance from the cell at a position to the nearest blocked cell, m; 0 in a blocked cell and outside of the
    /// bounds. It is measured between cell centres, so it differs from the distance between outlines by at most 0.15 m.
    pub fn clearance_m(&self, xy: DVec2) -> f64 {
        let drive = &self.inner.drive;
        let [low, high] = self.bounds_m();
        if !(xy.cmpge(low).all() && xy.cmplt(high).all()) {
            return 0.0;
        }
        let cell = (xy - low) / TRUTH_CELL_M;
        let column = (cell.x as usize).min(drive.size[0] - 1);
        let row = (cell.y as usize).min(drive.size[1] - 1);
        f64::from(drive.distance_m[row * drive.size[0] + column])
    }

    /// Whether anything blocked is closer to a position than `clearance_m`.
    pub fn blocked(&self, xy: DVec2, clearance_m: f64) -> bool {
        let clearance = self.clearance_m(xy);
        clearance == 0.0 || clearance < clearance_m
    }
}
