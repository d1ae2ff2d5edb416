//! What stands in the cells of a world model, for a camera that is expected to see it: the world model predicts what is
//! sensed (Albus 2006a, 4).

use crate::extrinsics::MIN_UPRIGHT;
use rcs_geom::{DVec2, DVec3, Pose};
use rcs_world::{Field, GridView, Label, MAX_COST};
use std::ops::Range;

/// Heights of what stands in the cells of a map.
pub struct Standing<'a> {
    ground: Option<Field<'a>>,
    top: Option<Field<'a>>,
    frame_from_grid: Pose,
    cell_size_m: DVec2,
    /// Columns and rows.
    cells: [usize; 2],
}

impl<'a> Standing<'a> {
    /// Of a map in which `ground.mean` and `obstacle.max` are the heights; it may lack them.
    pub fn of(map: &'a GridView<'a>) -> Standing<'a> {
        Standing {
            ground: map.field("ground.mean").ok(),
            top: map.field("obstacle.max").ok(),
            frame_from_grid: map.frame_from_grid(),
            cell_size_m: map.cell_size_m(),
            cells: [map.columns(), map.rows()],
        }
    }

    /// Columns and rows of the cells up to a distance east, west, north and south of a place, m in the frame of the map.
    pub fn around(&self, place: DVec3, distance_m: f64) -> [Range<usize>; 2] {
        let at = self.frame_from_grid.inverse() * place;
        let range = |at: f64, size: f64, cells: usize| {
            let end = |v: f64| (v / size).clamp(0.0, cells as f64) as usize;
            end((at - distance_m).floor())..end((at + distance_m).ceil())
        };
        [range(at.x, self.cell_size_m.x, self.cells[0]), range(at.y, self.cell_size_m.y, self.cells[1])]
    }

    /// Middle of a cell, m in the frame of the map.
    pub fn middle(&self, column: usize, row: usize) -> DVec2 {
        let middle = DVec2::new(column as f64 + 0.5, row as f64 + 0.5) * self.cell_size_m;
        (self.frame_from_grid * DVec3::new(middle.x, middle.y, 0.0)).truncate()
    }

    /// Height of the ground in a cell, m; `None` where the map has none.
    pub fn ground_m(&self, column: usize, row: usize) -> Option<f64> {
        finite(self.ground.as_ref(), column, row)
    }

    /// Height of the ground at a place in the frame of the map, m; `None` where the map has none.
    pub fn ground_at_m(&self, place: DVec2) -> Option<f64> {
        let at = (self.frame_from_grid.inverse() * place.extend(0.0)).truncate() / self.cell_size_m;
        (at.x >= 0.0 && at.y >= 0.0).then(|| self.ground_m(at.x as usize, at.y as usize)).flatten()
    }

    /// Heights of the foot and of the top of what stands in a cell, m: from the ground, which is at `level_m` where the
    /// map does not say its height, up to the highest point of an obstacle.
    pub fn ends_m(&self, column: usize, row: usize, level_m: f64) -> [f64; 2] {
        let foot = self.ground_m(column, row).unwrap_or(level_m);
        [foot, finite(self.top.as_ref(), column, row).unwrap_or(foot).max(foot)]
    }
}

fn finite(field: Option<&Field<'_>>, column: usize, row: usize) -> Option<f64> {
    field.and_then(|field| field.get(column, row)).filter(|z| z.is_finite())
}

/// Whether a field of costs has an obstacle in a cell.
pub fn is_obstacle(costs: &Field<'_>, column: usize, row: usize) -> bool {
    let cost = costs.get(column, row).filter(|&cost| cost <= f64::from(MAX_COST));
    cost.is_some_and(|cost| Label::of_cost(cost as u8) == Label::Obstacle)
}

/// Returns a function that gives the height of the vehicle's ground plane, which lies `below_m` below the origin of its
/// frame, at a position of the local frame, m; `None` where the vehicle lies on its side.
pub fn plane_height(local_from_vehicle: &Pose, below_m: f64) -> impl Fn(DVec2) -> Option<f64> + use<> {
    let up = local_from_vehicle.rotate(DVec3::Z);
    let origin = local_from_vehicle.translation - up * below_m;
    move |place| {
        let offset = place - origin.truncate();
        (up.z > MIN_UPRIGHT).then(|| origin.z - (offset.x * up.x + offset.y * up.y) / up.z)
    }
}
