//! Labelled columns, and what they say of the cells of a map.
//!
//! Columns do not depend on each other, so they are worked on in strips, in any order and on any number of threads; what
//! a strip found is added up in the order of the strips.

use crate::scan::{ColumnScan, Label, ScanParams, ScanPoint, Start};
use glam::DVec3;

/// The plane on which the wheels stand, relative to the sensor, axes of the local frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Footing {
    /// A point of the plane below the vehicle's origin, m.
    pub below_origin: DVec3,
    /// Upward normal of the plane.
    pub up: DVec3,
    /// Horizontal distance from the vehicle's origin at which the ground is known, m.
    pub wheels_m: f64,
}

impl Footing {
    /// Least vertical part of the normal: a vehicle that lies on its side says nothing of the ground.
    pub const MIN_UPRIGHT: f64 = 0.5;

    /// Known ground from which a column starts that goes out along the horizontal unit vector `(ux, uy)`.
    pub fn start(&self, ux: f64, uy: f64) -> Start {
        let slope = -(self.up.x * ux + self.up.y * uy) / self.up.z;
        let rho = ((self.below_origin.x + self.wheels_m * ux) * ux
            + (self.below_origin.y + self.wheels_m * uy) * uy)
            .max(0.0);
        // Height of the plane at that distance from the sensor.
        let (dx, dy) = (rho * ux - self.below_origin.x, rho * uy - self.below_origin.y);
        let z = self.below_origin.z - (self.up.x * dx + self.up.y * dy) / self.up.z;
        Start { rho: rho as f32, z: z as f32, slope: slope as f32 }
    }
}

/// Count and heights of one kind of pixels. Heights are relative to the sensor, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Heights {
    /// Pixels.
    pub count: u32,
    /// Sum of heights.
    pub sum: f32,
    /// Sum of squared heights.
    pub sum_of_squares: f32,
    /// Lowest; +∞ where there is none.
    pub min: f32,
    /// Highest; −∞ where there is none.
    pub max: f32,
}

impl Default for Heights {
    fn default() -> Self {
        Self { count: 0, sum: 0.0, sum_of_squares: 0.0, min: f32::INFINITY, max: f32::NEG_INFINITY }
    }
}

impl Heights {
    /// Adds one pixel.
    pub fn add(&mut self, z: f32) {
        self.count += 1;
        self.sum += z;
        self.sum_of_squares += z * z;
        if z < self.min {
            self.min = z;
        }
        if z > self.max {
            self.max = z;
        }
    }
}

/// What some neighbouring pixels of one column say of one cell.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CellVote {
    /// Cell: floor(place / cell size), x and y.
    pub cell: [i32; 2],
    /// `GROUND` and `SHORT_OBSTACLE` pixels: the vehicle can drive there.
    pub ground: Heights,
    /// `OBSTACLE` pixels.
    pub obstacle: Heights,
}

/// Where points lie in the map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// The sensor in the local frame, m.
    pub sensor: DVec3,
    /// Side of a cell, m.
    pub cell_size_m: f64,
}

impl Placement {
    /// The cell of a point relative to the sensor, m.
    fn cell_of(&self, x: f32, y: f32) -> [i32; 2] {
        let index = |place: f64| (place / self.cell_size_m).floor() as i32;
        [index(self.sensor.x + f64::from(x)), index(self.sensor.y + f64::from(y))]
    }

    /// South-west and north-east corner of a cell, relative to the sensor, m.
    fn edges_of(&self, [x, y]: [i32; 2]) -> ([f32; 2], [f32; 2]) {
        let edge = |index: i32, sensor: f64| (f64::from(index) * self.cell_size_m - sensor) as f32;
        let (sx, sy) = (self.sensor.x, self.sensor.y);
        ([edge(x, sx), edge(y, sy)], [edge(x + 1, sx), edge(y + 1, sy)])
    }
}

/// What was found in some columns.
#[derive(Clone, Debug)]
pub struct Strip {
    /// Labels in the order in which the points were given.
    pub labels: Vec<Label>,
    /// What the points say of cells; a cell may come more than once.
    pub votes: Vec<CellVote>,
    /// Points by label.
    pub counts: [u64; 6],
    /// Nearest and farthest range with a label from [`Label::Ground`] to [`Label::Cover`], m.
    pub range_m: [f32; 2],
    scanner: ColumnScan,
}

impl Strip {
    /// Nothing yet; room for so many points.
    pub fn with_capacity(points: usize) -> Strip {
        Strip {
            labels: Vec::with_capacity(points),
            votes: Vec::new(),
            counts: [0; 6],
            range_m: [f32::INFINITY, 0.0],
            scanner: ColumnScan::default(),
        }
    }

    /// Labels one more column, given from the lowest ray to the highest, and lets its points vote.
    pub fn add_column(
        &mut self,
        points: &[ScanPoint],
        footing: &Footing,
        placement: &Placement,
        params: &ScanParams,
    ) {
        let first = self.labels.len();
        self.labels.resize(first + points.len(), Label::Invalid);
        let labels = &mut self.labels[first..];
        // The nearest ground tells the direction in which the wheels' ground is looked for.
        let Some(ahead) =
            points.iter().find(|p| p.range >= params.min_range_m && p.rho > 0.0 && p.rho.is_finite())
        else {
            self.counts[Label::Invalid as usize] += points.len() as u64;
            return;
        };
        let rho = f64::from(ahead.rho);
        let start = footing.start(f64::from(ahead.x) / rho, f64::from(ahead.y) / rho);
        self.scanner.scan(points, start, params, labels);

        let mut vote = CellVote::default();
        let mut open = false;
        // Edges of the vote's cell, relative to the sensor: most points lie in the cell of the point before.
        let (mut low, mut high) = ([0.0_f32; 2], [0.0_f32; 2]);
        for (point, &label) in points.iter().zip(labels.iter()) {
            self.counts[label as usize] += 1;
            if matches!(label, Label::Invalid | Label::TooFar) {
                continue;
            }
            if point.range < self.range_m[0] {
                self.range_m[0] = point.range;
            }
            if point.range > self.range_m[1] {
                self.range_m[1] = point.range;
            }
            if label == Label::Cover {
                continue;
            }
            let inside = point.x >= low[0] && point.x < high[0] && point.y >= low[1] && point.y < high[1];
            if !(open && inside) {
                if open {
                    self.votes.push(vote);
                }
                let cell = placement.cell_of(point.x, point.y);
                (low, high) = placement.edges_of(cell);
                vote = CellVote { cell, ..CellVote::default() };
                open = true;
            }
            if label == Label::Obstacle { vote.obstacle.add(point.z) } else { vote.ground.add(point.z) }
        }
        if open {
            self.votes.push(vote);
        }
    }
}
