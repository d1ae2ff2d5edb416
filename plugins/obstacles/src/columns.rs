//! Labelled columns, and their votes for the cells of a map.
//!
//! Columns are independent of each other, so they are processed in strips, in any order and on any number of threads;
//! the results of the strips are added in a fixed order.

use crate::ground_map::{GROUND_CELL_M, GroundMap, GroundVote};
use crate::negative::{Hole, HoleScan, NegativeParams};
use crate::scan::{ColumnScan, Label, ScanParams, ScanPoint, Start};
use glam::DVec3;
use rcs_geom::CellIndex;

/// The plane under the wheels, relative to the sensor, in axes of the local frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GroundPlane {
    /// A point of the plane below the vehicle's origin, m.
    pub below_origin: DVec3,
    /// Upward normal of the plane.
    pub up: DVec3,
    /// Horizontal distance from the vehicle's origin at which the ground is known, m.
    pub wheels_m: f64,
}

impl GroundPlane {
    /// The point of known ground from which a column along the horizontal unit vector `(ux, uy)` starts.
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

/// Number and heights of pixels of one kind. Heights are relative to the sensor, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Heights {
    /// Number of pixels.
    pub count: u32,
    /// Sum of heights.
    pub sum: f32,
    /// Sum of squared heights.
    pub sum_of_squares: f32,
    /// Lowest; +∞ without pixels.
    pub min: f32,
    /// Highest; −∞ without pixels.
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

/// The vote of consecutive pixels of one column for one cell.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CellVote {
    /// Cell: floor(position / cell size), x and y.
    pub cell: [i32; 2],
    /// `GROUND` and `SHORT_OBSTACLE` pixels, over which the vehicle can drive.
    pub ground: Heights,
    /// `OBSTACLE` pixels.
    pub obstacle: Heights,
    /// Sums of red, green and blue over all of these pixels; 0 for columns without colours.
    pub colour: [u32; 3],
}

/// A pixel, and the cell of a map in which it lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PlacedPixel {
    /// Index of its label in [`Strip::labels`].
    pub label: usize,
    /// Its cell.
    pub cell: [i32; 2],
}

/// The ground map before the current frame.
#[derive(Clone, Copy, Debug)]
pub struct KnownGround<'a> {
    /// The map.
    pub map: &'a GroundMap,
    /// Cells last seen before this time are ignored, ns.
    pub since_ns: u64,
    /// Cells seen after this time are ignored: their clock has begun again, ns.
    pub until_ns: u64,
}

/// Geometry of a frame, and the rules for its columns.
#[derive(Clone, Debug)]
pub struct Survey<'a> {
    /// The plane under the wheels.
    pub ground_plane: GroundPlane,
    /// Position of the sensor in the map.
    pub placement: Placement,
    /// Parameters of the scan for positive obstacles.
    pub scan: ScanParams,
    /// Parameters of the scan for negative obstacles; `None` to skip it.
    pub negative: Option<NegativeParams>,
    /// Ground seen in earlier frames.
    pub known: Option<KnownGround<'a>>,
}

impl Survey<'_> {
    /// Known ground along the horizontal unit vector `(ux, uy)`, nearer than a distance: distances and heights relative
    /// to the sensor, m.
    fn known_before(&self, rho: f32, from: f32, [ux, uy]: [f32; 2]) -> impl Iterator<Item = (f32, f32)> {
        let sensor = self.placement.sensor;
        let steps = if self.known.is_some() { KNOWN_STEPS } else { 0 };
        (1..=steps).rev().map(move |k| rho - k as f32 * GROUND_CELL_M as f32).filter_map(move |rho| {
            let KnownGround { map, since_ns, until_ns } = self.known.filter(|_| rho >= from)?;
            let index = |sensor: f64, u: f32| ((sensor + f64::from(u * rho)) / GROUND_CELL_M).floor() as i64;
            let cell = map.get(CellIndex::new(index(sensor.x, ux), index(sensor.y, uy)))?;
            let is_known = cell.pixels >= KNOWN_PIXELS && (since_ns..=until_ns).contains(&cell.seen_ns);
            is_known.then_some((rho, (f64::from(cell.height_m) - sensor.z) as f32))
        })
    }
}

/// Number of cells of the ground map that a column looks back, and the number of ground pixels that make a cell known.
const KNOWN_STEPS: usize = 10;
const KNOWN_PIXELS: u16 = 5;

/// Conversion of points to cells of a map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Position of the sensor in the local frame, m.
    pub sensor: DVec3,
    /// Size of a cell, m.
    pub cell_size_m: f64,
}

impl Placement {
    /// The same sensor, with another cell size.
    fn with_cells(self, cell_size_m: f64) -> Placement {
        Placement { cell_size_m, ..self }
    }

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

/// Results of a strip of columns.
#[derive(Clone, Debug)]
pub struct Strip {
    /// Labels in the order of the points.
    pub labels: Vec<Label>,
    /// Votes of the points for cells; a cell may occur several times.
    pub votes: Vec<CellVote>,
    /// Number of points by label.
    pub counts: [u64; 6],
    /// Nearest and farthest range with a label from [`Label::Ground`] to [`Label::Cover`], m.
    pub range_m: [f32; 2],
    /// Votes of the ground pixels for the ground map, and borders of holes; empty where holes are not searched.
    pub ground: Vec<GroundVote>,
    /// Pixels at the borders of negative obstacles ("holes"), with cells of the ground map.
    pub borders: Vec<PlacedPixel>,
    /// Pixels of positive obstacles, with cells of the votes.
    pub obstacles: Vec<PlacedPixel>,
    scanner: ColumnScan,
    hole_scanner: HoleScan,
    holes: Vec<Hole>,
}

impl Strip {
    /// An empty strip with capacity for this many points.
    pub fn with_capacity(points: usize) -> Strip {
        Strip {
            labels: Vec::with_capacity(points),
            votes: Vec::new(),
            counts: [0; 6],
            range_m: [f32::INFINITY, 0.0],
            ground: Vec::new(),
            borders: Vec::new(),
            obstacles: Vec::new(),
            scanner: ColumnScan::default(),
            hole_scanner: HoleScan::default(),
            holes: Vec::new(),
        }
    }

    /// Labels one more column, given from the lowest ray to the highest, and adds the votes of its points. `colours`
    /// has one entry per point, or is empty.
    pub fn add_column(&mut self, points: &[ScanPoint], colours: &[[u8; 3]], survey: &Survey<'_>) {
        let first = self.labels.len();
        self.labels.resize(first + points.len(), Label::Invalid);
        let labels = &mut self.labels[first..];
        // The direction of the column, which determines the ground under the wheels, is that of the nearest ground
        // point.
        let is_start =
            |p: &&ScanPoint| p.range >= survey.scan.min_range_m && p.rho > 0.0 && p.rho.is_finite();
        let Some(ahead) = points.iter().find(is_start) else {
            self.counts[Label::Invalid as usize] += points.len() as u64;
            return;
        };
        let rho = f64::from(ahead.rho);
        let start = survey.ground_plane.start(f64::from(ahead.x) / rho, f64::from(ahead.y) / rho);
        self.scanner.scan(points, start, &survey.scan, labels);
        if let Some(negative) = &survey.negative {
            self.find_holes(
                points,
                first,
                [ahead.x / ahead.rho, ahead.y / ahead.rho],
                start,
                negative,
                survey,
            );
        }
        self.vote(points, colours, first, &survey.placement);
    }

    /// Adds points whose labels are known, and their votes for cells.
    pub(crate) fn add_labelled(&mut self, points: &[ScanPoint], labels: &[Label], placement: &Placement) {
        let first = self.labels.len();
        self.labels.extend_from_slice(labels);
        self.vote(points, &[], first, placement);
    }

    /// Finds the holes of a column whose labels start at `first`, and adds its votes for the ground map.
    fn find_holes(
        &mut self,
        points: &[ScanPoint],
        first: usize,
        direction: [f32; 2],
        start: Start,
        params: &NegativeParams,
        survey: &Survey<'_>,
    ) {
        let labels = &self.labels[first..];
        self.holes.clear();
        let nearest = points.iter().zip(labels).find(|(_, label)| **label == Label::Ground);
        let nearest = nearest.map_or(start.rho, |(point, _)| point.rho);
        let known = survey.known_before(nearest, start.rho, direction);
        self.hole_scanner.scan(points, labels, known, params, &mut self.holes);
        let placement = survey.placement.with_cells(GROUND_CELL_M);
        for i in self.holes.iter().flat_map(|hole| [Some(hole.near), hole.far]).flatten() {
            let cell = placement.cell_of(points[i].x, points[i].y);
            self.borders.push(PlacedPixel { label: first + i, cell });
            self.ground.push(GroundVote { cell, borders: 1, ..GroundVote::default() });
        }
        let mut vote = GroundVote::default();
        let (mut low, mut high) = ([0.0_f32; 2], [0.0_f32; 2]);
        for (point, &label) in points.iter().zip(labels) {
            if !matches!(label, Label::Ground | Label::ShortObstacle) || point.range > params.max_range_m {
                continue;
            }
            let inside = point.x >= low[0] && point.x < high[0] && point.y >= low[1] && point.y < high[1];
            if !(vote.pixels > 0 && inside) {
                if vote.pixels > 0 {
                    self.ground.push(vote);
                }
                let cell = placement.cell_of(point.x, point.y);
                (low, high) = placement.edges_of(cell);
                vote = GroundVote { cell, ..GroundVote::default() };
            }
            vote.pixels += 1;
            vote.height_sum += point.z;
        }
        if vote.pixels > 0 {
            self.ground.push(vote);
        }
    }

    /// Counts the labels from `first` on, and adds the votes of their points for cells.
    fn vote(&mut self, points: &[ScanPoint], colours: &[[u8; 3]], first: usize, placement: &Placement) {
        let mut vote = CellVote::default();
        let mut open = false;
        // Edges of the current cell, relative to the sensor: most points lie in the same cell as the point before.
        let (mut low, mut high) = ([0.0_f32; 2], [0.0_f32; 2]);
        for (i, (point, &label)) in points.iter().zip(&self.labels[first..]).enumerate() {
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
            if label == Label::Obstacle {
                self.obstacles.push(PlacedPixel { label: first + i, cell: vote.cell });
                vote.obstacle.add(point.z);
            } else {
                vote.ground.add(point.z);
            }
            if let Some(colour) = colours.get(i) {
                for (sum, &value) in vote.colour.iter_mut().zip(colour) {
                    *sum += u32::from(value);
                }
            }
        }
        if open {
            self.votes.push(vote);
        }
    }

    /// Changes the label of the pixels of positive obstacles whose cell satisfies `is_doubted` to too far to tell.
    pub fn doubt(&mut self, is_doubted: impl Fn([i32; 2]) -> bool) {
        for pixel in self.obstacles.iter().filter(|pixel| is_doubted(pixel.cell)) {
            self.counts[Label::Obstacle as usize] -= 1;
            self.counts[Label::TooFar as usize] += 1;
            self.labels[pixel.label] = Label::TooFar;
        }
    }

    /// Changes the label of border pixels whose cell satisfies `counts` to obstacle; returns how many there are.
    pub fn mark_borders(&mut self, counts: impl Fn([i32; 2]) -> bool) -> u64 {
        let mut marked = 0;
        for border in self.borders.iter().filter(|border| counts(border.cell)) {
            let label = &mut self.labels[border.label];
            // The far border of one hole may be the near border of the next one.
            if *label != Label::Obstacle {
                self.counts[*label as usize] -= 1;
                self.counts[Label::Obstacle as usize] += 1;
                *label = Label::Obstacle;
                marked += 1;
            }
        }
        marked
    }
}
