//! Position of classified windows: ground lies on the plane of the vehicle's pose, and obstacles stand upright on it
//! (Albus 2006a, 3.3).
//!
//! - The plane is that under the wheels, parallel to x and y of the vehicle frame. A cell of the map whose centre
//!   projects into a traversable window gets the cost of that window; cells hidden behind an upright obstacle get none.
//! - An obstacle window stands where the nearest ground below it in its column of windows ends: at the upper edge of
//!   the next traversable window below, at the upper edge of the region covered by stereo, or at the lower edge of the
//!   image. Its cost is assigned to the cells along the width of the window at that place, and overrides that of a
//!   traversable window.

use crate::classify::{Class, Match, WindowGrid};
use glam::{DVec2, DVec3};
use rcs_geom::{CellIndex, PinholeCamera, Pose};
use rcs_sense::{CELL_SIZE_M, GridFrame};
use rcs_world::{SIDE, UNKNOWN_COST};

/// Poses of camera and vehicle.
#[derive(Clone, Debug)]
pub struct View<'a> {
    /// The camera.
    pub camera: &'a PinholeCamera,
    /// Pose of its optical frame on the vehicle.
    pub vehicle_from_camera: Pose,
    /// Pose of the vehicle in the local frame.
    pub local_from_vehicle: Pose,
    /// Distance of the plane below the origin of the vehicle frame, m.
    pub wheels_below_m: f64,
}

/// Classified windows.
#[derive(Clone, Copy, Debug)]
pub struct Windows<'a> {
    /// The division of the image.
    pub grid: &'a WindowGrid,
    /// Classes in row order.
    pub classes: &'a [Class],
    /// For each column of windows, the first row covered by stereo; `None` without stereo.
    pub stereo_end: Option<&'a [usize]>,
}

/// A cost map around the vehicle.
#[derive(Clone, Debug, PartialEq)]
pub struct Placed {
    /// Index of the south-west corner cell.
    pub south_west: CellIndex,
    /// Costs in row order, 255 unknown.
    pub costs: Vec<u8>,
    /// The numbers of the models that say so, from 1; 0 for none.
    pub models: Vec<u8>,
}

impl View<'_> {
    /// Sine of the elevation of a pixel's ray above the vehicle's plane; `None` where the lens model has no ray.
    pub fn sine_above_horizon(&self, pixel: DVec2) -> Option<f64> {
        let ray = self.vehicle_from_camera.rotate(self.camera.unproject(pixel)?);
        Some(ray.z / ray.length())
    }

    /// The point of the plane that a pixel shows, vehicle frame, m; `None` at and above the horizon, and for a camera
    /// that is not above the plane.
    pub fn on_plane(&self, pixel: DVec2) -> Option<DVec3> {
        let ray = self.vehicle_from_camera.rotate(self.camera.unproject(pixel)?);
        let origin = self.vehicle_from_camera.translation;
        let along = -self.camera_above_plane_m() / ray.z;
        (ray.z < 0.0 && along.is_finite() && along > 0.0).then(|| origin + ray * along)
    }

    fn camera_above_plane_m(&self) -> f64 {
        self.vehicle_from_camera.translation.z + self.wheels_below_m
    }
}

/// Which windows are classified, in row order: those lower than `sine_limit` above the horizon, and above the rows that
/// `stereo_end` marks as covered by stereo.
pub fn region(
    view: &View<'_>,
    grid: &WindowGrid,
    sine_limit: f64,
    stereo_end: Option<&[usize]>,
) -> Vec<bool> {
    let (columns, rows) = (grid.columns(), grid.rows());
    let mut wanted = Vec::with_capacity(columns * rows);
    for row in 0..rows {
        for column in 0..columns {
            let is_stereos = stereo_end.is_some_and(|end| row >= end[column]);
            let sine = view.sine_above_horizon(middle(grid, column, row));
            wanted.push(!is_stereos && sine.is_some_and(|sine| sine <= sine_limit));
        }
    }
    wanted
}

fn middle(grid: &WindowGrid, column: usize, row: usize) -> DVec2 {
    let between = |[from, to]: [usize; 2]| (from + to) as f64 / 2.0 - 0.5;
    DVec2::new(between(grid.x(column)), between(grid.y(row)))
}

/// Projects classified windows onto a map of 201×201 cells around the vehicle, up to `max_range_m` (m) from its origin.
pub fn place(view: &View<'_>, windows: &Windows<'_>, max_range_m: f64) -> Placed {
    let vehicle = view.local_from_vehicle.translation.truncate();
    let south_west = GridFrame::around(vehicle, SIDE, CELL_SIZE_M).south_west;
    let cells = SIDE * SIDE;
    let mut placed = Placed { south_west, costs: vec![UNKNOWN_COST; cells], models: vec![0; cells] };
    placed.put_ground(view, windows, max_range_m);
    for column in 0..windows.grid.columns() {
        placed.stand_obstacles(view, windows, column, max_range_m);
    }
    placed
}

impl Placed {
    /// Number of cells with a cost.
    pub fn cells(&self) -> u64 {
        self.costs.iter().filter(|&&cost| cost != UNKNOWN_COST).count() as u64
    }

    /// Its cells.
    pub fn frame(&self) -> GridFrame {
        GridFrame { south_west: self.south_west, side: SIDE, cell_size_m: CELL_SIZE_M }
    }

    fn put_ground(&mut self, view: &View<'_>, windows: &Windows<'_>, max_range_m: f64) {
        let (grid, classes) = (windows.grid, windows.classes);
        let is_ground = |class: &Class| matches!(class, Class::Traversable(_));
        if !classes.iter().any(is_ground) || view.camera_above_plane_m() <= 0.0 {
            return;
        }
        let up = view.local_from_vehicle.rotate(DVec3::Z);
        let vehicle = view.local_from_vehicle.translation;
        let local_from_camera = view.local_from_vehicle * view.vehicle_from_camera;
        let camera_from_local = local_from_camera.rotation_matrix().transpose();
        let rows = self.costs.chunks_exact_mut(SIDE).zip(self.models.chunks_exact_mut(SIDE));
        for (row, (costs, models)) in rows.enumerate() {
            let y = (self.south_west.y as f64 + row as f64 + 0.5) * CELL_SIZE_M - vehicle.y;
            for (column, (cost, model)) in costs.iter_mut().zip(models).enumerate() {
                let x = (self.south_west.x as f64 + column as f64 + 0.5) * CELL_SIZE_M - vehicle.x;
                let offset = DVec3::new(x, y, -(up.x * x + up.y * y + view.wheels_below_m) / up.z);
                if offset.length_squared() > max_range_m * max_range_m {
                    continue;
                }
                let seen = camera_from_local * (offset + vehicle - local_from_camera.translation);
                // Nearly half of the map is behind the camera.
                if seen.z <= 0.0 {
                    continue;
                }
                let pixel = view.camera.project(seen).filter(|&pixel| view.camera.contains(pixel));
                let Some(pixel) = pixel else { continue };
                let [u, v] = [pixel.x + 0.5, pixel.y + 0.5].map(|at| at as usize / grid.window_px);
                if let Some(&Class::Traversable(of_window)) = classes.get(v * grid.columns() + u) {
                    (*cost, *model) = (of_window.cost, of_window.model);
                }
            }
        }
    }

    fn stand_obstacles(&mut self, view: &View<'_>, windows: &Windows<'_>, column: usize, max_range_m: f64) {
        let grid = windows.grid;
        let mut foot_row = windows.stereo_end.map_or(grid.rows(), |end| end[column]);
        let [left, right] = grid.x(column);
        for row in (0..foot_row).rev() {
            match windows.classes[row * grid.columns() + column] {
                Class::Skipped | Class::Unclassified => {}
                Class::Traversable(_) => foot_row = row,
                Class::NotTraversable(like) => {
                    let v = (foot_row * grid.window_px).min(grid.size[1]) as f64 - 0.5;
                    let ends = [left, right].map(|u| view.on_plane(DVec2::new(u as f64 - 0.5, v)));
                    let [Some(from), Some(to)] = ends else { continue };
                    if from.length().max(to.length()) <= max_range_m {
                        self.stand(view, from, to, like);
                    }
                }
            }
        }
    }

    /// Assigns what a window is like to the cells along a line of the plane, vehicle frame.
    fn stand(&mut self, view: &View<'_>, from: DVec3, to: DVec3, like: Match) {
        let steps = (2.0 * from.distance(to) / CELL_SIZE_M).ceil().clamp(1.0, 1000.0) as usize;
        for step in 0..=steps {
            let place = view.local_from_vehicle * from.lerp(to, step as f64 / steps as f64);
            let cell = (place / CELL_SIZE_M).floor();
            let (x, y) = (cell.x as i64 - self.south_west.x, cell.y as i64 - self.south_west.y);
            let side = 0..SIDE as i64;
            if side.contains(&x) && side.contains(&y) {
                let slot = y as usize * SIDE + x as usize;
                if self.costs[slot] == UNKNOWN_COST || like.cost >= self.costs[slot] {
                    (self.costs[slot], self.models[slot]) = (like.cost, like.model);
                }
            }
        }
    }
}

#[cfg(test)]
#[path = "place_tests.rs"]
mod tests;
