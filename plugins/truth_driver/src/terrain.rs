//! Cost of driving over each cell, from the true map.

use crate::distance;
use crate::search::{Field, Found, shortest};
use rcs_geom::DVec2;
use rcs_msg::foxglove::Grid;
use rcs_world::GridView;

/// Rules of cost; see the parameters of the process.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rules {
    /// Minimum clearance between the vehicle's centre and an obstacle, m.
    pub room_m: f64,
    /// Clearance from which on obstacles do not raise the cost, m.
    pub wish_room_m: f64,
    /// Additional cost per metre at a clearance of `room_m`.
    pub room_weight: f64,
    /// Steeper ground is blocked; rise per metre.
    pub max_slope: f64,
    /// Higher steps between neighbouring cells are blocked, m.
    pub max_step_m: f64,
    /// Additional cost per metre at a slope of `max_slope`.
    pub slope_weight: f64,
    /// Additional cost per metre on mud.
    pub slip_weight: f64,
    /// Additional cost per metre for vegetation 1 m high.
    pub vegetation_weight: f64,
}

/// Class codes from this one on are objects on the ground.
const FIRST_THING: u8 = 16;
/// Tree crowns: the vehicle drives under them.
const CROWN: u8 = 17;
/// Codes of slippery surfaces, and how slippery they are relative to mud.
const SLIPPERY: [(u8, f64); 2] = [(7, 1.0), (8, 0.3)];

/// The costs of a map.
#[derive(Clone, Debug)]
pub struct Terrain {
    columns: usize,
    rows: usize,
    cell_size_m: f64,
    south_west: DVec2,
    is_blocked: Vec<bool>,
    /// Cost per metre without regard to nearby obstacles.
    ground_cost: Vec<f32>,
    /// Distance to the nearest blocked cell, m.
    room_m: Vec<f32>,
}

/// A path to the goal.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Way {
    /// Centres of its cells, m in the map's frame, and the clearance there, m.
    pub points: Vec<(DVec2, f64)>,
    /// Total cost, m.
    pub cost_m: f64,
    /// Number of cells taken from the search queue.
    pub expanded: u64,
}

/// Why there is no path.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum NoWay {
    /// A position is outside of the map.
    #[error("{what} is at ({x:.1}, {y:.1}) m, expected a place on the map")]
    Outside {
        /// Which position.
        what: &'static str,
        /// x, m.
        x: f64,
        /// y, m.
        y: f64,
    },
    /// Start and goal are not connected.
    #[error("no way leads to the goal with {room_m:.2} m of room")]
    Blocked {
        /// Required clearance, m.
        room_m: f64,
    },
}

/// Around the vehicle, up to this distance, a path may have less than the minimum clearance, m: the vehicle already
/// stands there.
const ESCAPE_M: f64 = 1.5;
/// Cost per metre there.
const ESCAPE_COST: f32 = 20.0;

impl Terrain {
    /// Reads a map with the fields `height`, `vegetation` (m) and `class`, and `blocked` (0 or not) where it has one.
    pub fn new(grid: &Grid, rules: &Rules) -> Result<Terrain, String> {
        let view = GridView::new(grid).map_err(|error| error.to_string())?;
        let size = view.cell_size_m();
        let corner = view.frame_from_grid();
        if size.x != size.y || corner.rotation.w.abs() < 1.0 - 1e-9 {
            return Err(format!(
                "cells are {} m by {} m, expected square ones that are not turned",
                size.x, size.y
            ));
        }
        let read = |name: &str| -> Result<Vec<f64>, String> {
            Ok(view.field(name).map_err(|error| error.to_string())?.values().collect())
        };
        let (height, vegetation, class) = (read("height")?, read("vegetation")?, read("class")?);
        // Rigid vegetation is marked only in the field `blocked`.
        let blocked = read("blocked").unwrap_or_default();
        if let Some(at) = height.iter().zip(&vegetation).position(|(h, v)| !h.is_finite() || !v.is_finite()) {
            return Err(format!("height or vegetation of cell {at} is not finite"));
        }
        let (columns, rows) = (view.columns(), view.rows());
        let mut terrain = Terrain {
            columns,
            rows,
            cell_size_m: size.x,
            south_west: corner.translation.truncate(),
            is_blocked: vec![false; columns * rows],
            ground_cost: vec![1.0; columns * rows],
            room_m: Vec::new(),
        };
        for at in 0..columns * rows {
            let class = class[at] as u8;
            let (slope, step_m) = terrain.steepness(&height, at);
            let is_thing = class >= FIRST_THING && class != CROWN;
            let is_told = blocked.get(at).is_some_and(|&told| told != 0.0);
            terrain.is_blocked[at] =
                is_thing || is_told || slope > rules.max_slope || step_m > rules.max_step_m;
            let slip = SLIPPERY.iter().find(|(code, _)| *code == class).map_or(0.0, |&(_, slip)| slip);
            let steep = slope / rules.max_slope;
            let cost = 1.0
                + rules.slope_weight * steep * steep
                + rules.slip_weight * slip
                + rules.vegetation_weight * vegetation[at].max(0.0);
            terrain.ground_cost[at] = cost as f32;
        }
        let cells = distance::to_blocked(columns, &terrain.is_blocked);
        // A blocked cell is blocked up to its border.
        let room = |cells: f32| ((f64::from(cells) - 0.5) * terrain.cell_size_m).max(0.0) as f32;
        terrain.room_m = cells.into_iter().map(room).collect();
        Ok(terrain)
    }

    /// Slope, rise per metre, over the neighbours two cells away, and the greatest step to a neighbour, m.
    fn steepness(&self, height: &[f64], at: usize) -> (f64, f64) {
        let (column, row) = (at % self.columns, at / self.columns);
        let (west, east) = (column.saturating_sub(2), (column + 2).min(self.columns - 1));
        let (south, north) = (row.saturating_sub(2), (row + 2).min(self.rows - 1));
        let z = |column: usize, row: usize| height[row * self.columns + column];
        let rise = |from: f64, to: f64, cells: usize| (to - from) / (cells.max(1) as f64 * self.cell_size_m);
        let dx = rise(z(west, row), z(east, row), east - west);
        let dy = rise(z(column, south), z(column, north), north - south);
        let beside = [
            z(column.saturating_sub(1), row),
            z((column + 1).min(self.columns - 1), row),
            z(column, row.saturating_sub(1)),
            z(column, (row + 1).min(self.rows - 1)),
        ];
        let here = z(column, row);
        let step_m = beside.into_iter().map(|z| (z - here).abs()).fold(0.0, f64::max);
        ((dx * dx + dy * dy).sqrt(), step_m)
    }

    fn cell_at(&self, place: DVec2) -> Option<usize> {
        let cells = ((place - self.south_west) / self.cell_size_m).floor();
        let inside =
            cells.x >= 0.0 && cells.y >= 0.0 && cells.x < self.columns as f64 && cells.y < self.rows as f64;
        inside.then(|| cells.y as usize * self.columns + cells.x as usize)
    }

    fn middle_of(&self, cell: usize) -> DVec2 {
        let (column, row) = (cell % self.columns, cell / self.columns);
        self.south_west + DVec2::new(column as f64 + 0.5, row as f64 + 0.5) * self.cell_size_m
    }

    /// The cheapest path from `start` to `goal`.
    pub fn way(&self, start: DVec2, goal: DVec2, rules: &Rules) -> Result<Way, NoWay> {
        let outside = |what, place: DVec2| NoWay::Outside { what, x: place.x, y: place.y };
        let start_cell = self.cell_at(start).ok_or(outside("start", start))?;
        let goal_cell = self.cell_at(goal).ok_or(outside("goal", goal))?;
        let mut cost: Vec<f32> = (0..self.room_m.len()).map(|at| self.cost_of(at, start, rules)).collect();
        cost[start_cell] = cost[start_cell].min(ESCAPE_COST);
        let field = Field { columns: self.columns, cell_size_m: self.cell_size_m, cost: &cost };
        let found = shortest(&field, start_cell, goal_cell);
        let Some(Found { cells, cost_m, expanded }) = found else {
            return Err(NoWay::Blocked { room_m: rules.room_m });
        };
        let points = cells.iter().map(|&cell| (self.middle_of(cell), f64::from(self.room_m[cell])));
        Ok(Way { points: points.collect(), cost_m, expanded })
    }

    fn cost_of(&self, at: usize, start: DVec2, rules: &Rules) -> f32 {
        let room = f64::from(self.room_m[at]);
        if room < rules.room_m {
            let escapes = !self.is_blocked[at] && self.middle_of(at).distance(start) < ESCAPE_M;
            return if escapes { ESCAPE_COST } else { f32::INFINITY };
        }
        let lacking = ((rules.wish_room_m - room) / (rules.wish_room_m - rules.room_m).max(1e-9)).max(0.0);
        self.ground_cost[at] + (rules.room_weight * lacking * lacking) as f32
    }
}

#[cfg(test)]
#[path = "terrain_tests.rs"]
mod tests;
