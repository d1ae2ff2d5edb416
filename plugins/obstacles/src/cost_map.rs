//! The obstacle cost map: costs of the cells around the vehicle from the pixels of one range image (Albus 2006a,
//! 3.1.1).
//!
//! The cost of a cell is the percentage of `OBSTACLE` pixels among its pixels, with 0 to 100 % as 0 to 250, and 255
//! (unknown) with fewer pixels than the minimum. `GROUND` and `SHORT_OBSTACLE` count as free. `COVER` is not counted:
//! what the vehicle fits under says nothing about the ground, and a tree crown would lower the cost of its trunk. A
//! cell with the border of a negative obstacle has the highest cost, even where ground is seen in it, because the
//! ground ends there. A cell that must be an obstacle in more frames to be one is unknown (see `positive_frames`).
//!
//! What is said about a cell is worth as much as its pixels and the range noise let it be ([`worth()`]): the share of its
//! pixels in those that make it certain (at most 1), and the standard deviation of a range at the distance of the cell.
//! A border of a negative obstacle was found in several columns, and is worth a full vote.

use crate::columns::{Heights, Strip};
use glam::DVec3;
use rcs_geom::CellIndex;
use rcs_msg::Stamp;
use rcs_msg::foxglove::packed_element_field::NumericType;
use rcs_msg::foxglove::{Grid, PackedElementField};
use rcs_sense::{CELL_SIZE_M, GridFrame, cost_field, worth};
use rcs_world::{Label as Seen, MAX_COST, SIDE, Source, UNKNOWN_COST};
use std::collections::BTreeSet;

/// Sums over the pixels of one kind in one cell; heights relative to the sensor, m.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Sums {
    count: u32,
    sum: f64,
    sum_of_squares: f64,
    min: f32,
    max: f32,
}

impl Sums {
    const NONE: Sums =
        Sums { count: 0, sum: 0.0, sum_of_squares: 0.0, min: f32::INFINITY, max: f32::NEG_INFINITY };

    fn add(&mut self, heights: &Heights) {
        self.count += heights.count;
        self.sum += f64::from(heights.sum);
        self.sum_of_squares += f64::from(heights.sum_of_squares);
        self.min = self.min.min(heights.min);
        self.max = self.max.max(heights.max);
    }

    /// Mean, variance, minimum and maximum of the heights in the local frame, m and m². NaN without pixels.
    fn statistics(&self, sensor_z: f64) -> [f32; 4] {
        if self.count == 0 {
            return [f32::NAN; 4];
        }
        let count = f64::from(self.count);
        let mean = self.sum / count;
        let variance = (self.sum_of_squares / count - mean * mean).max(0.0);
        let local = |z: f32| (f64::from(z) + sensor_z) as f32;
        [(mean + sensor_z) as f32, variance as f32, local(self.min), local(self.max)]
    }
}

/// Sums over the pixels of one cell.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Cell {
    ground: Sums,
    obstacle: Sums,
    colour: [u64; 3],
    /// Whether a border of a negative obstacle lies in the cell.
    negative: bool,
    /// Whether it is an obstacle in too few frames to be one.
    unconfirmed: bool,
}

impl Cell {
    const NONE: Cell = Cell {
        ground: Sums::NONE,
        obstacle: Sums::NONE,
        colour: [0; 3],
        negative: false,
        unconfirmed: false,
    };

    fn cost(&self, min_pixels: u32) -> u8 {
        let count = self.ground.count + self.obstacle.count;
        match (self.negative, count < min_pixels || self.unconfirmed) {
            (true, _) => MAX_COST,
            (false, true) => UNKNOWN_COST,
            (false, false) => {
                (f64::from(MAX_COST) * f64::from(self.obstacle.count) / f64::from(count)).round() as u8
            }
        }
    }

    /// By how much its highest obstacle rises above its lowest pixel, m.
    fn rise_m(&self) -> f64 {
        f64::from(self.obstacle.max - self.obstacle.min.min(self.ground.min))
    }

    /// How much its cost counts, 0 to 255, in a cell at this distance (m) from the sensor.
    fn worth(&self, distance_m: f64, certainty: &Certainty) -> u8 {
        if self.negative {
            return u8::MAX;
        }
        let pixels = f64::from(self.ground.count + self.obstacle.count);
        let part = (pixels / f64::from(certainty.pixels.max(1))).min(1.0);
        worth(part, certainty.noise_per_m2 * distance_m * distance_m, CELL_SIZE_M)
    }

    /// Mean red, green, blue, and 255 for opaque; all 0 without coloured pixels.
    fn colour(&self) -> [u8; 4] {
        let count = u64::from(self.ground.count + self.obstacle.count);
        if self.colour == [0; 3] || count == 0 {
            return [0; 4];
        }
        let [r, g, b] = self.colour.map(|sum| ((sum + count / 2) / count) as u8);
        [r, g, b, u8::MAX]
    }
}

/// What makes the cost of a cell certain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Certainty {
    /// Fewer pixels give a cell no cost.
    pub min_pixels: u32,
    /// From this number of pixels on, a cell is as certain as its range noise allows.
    pub pixels: u32,
    /// Standard deviation of a range, divided by the square of the range, 1/m; 0 for sensors without that noise.
    pub noise_per_m2: f64,
}

/// Which obstacles count, and of which one frame is sure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Sure {
    /// Fewer pixels make no obstacle.
    pub(crate) pixels: u32,
    /// Sure ones are within this distance, m.
    pub(crate) within_m: f64,
    /// They rise by as much within their cell, m.
    pub(crate) rise_m: f64,
}

/// Sums over all cells for one range image.
#[derive(Clone, Debug)]
pub struct CostMap {
    frame: GridFrame,
    sensor: DVec3,
    certainty: Certainty,
    cells: Vec<Cell>,
}

impl CostMap {
    /// Adds up the results of the strips in their order. `centre` is the vehicle's cell, `sensor` the position of the
    /// sensor in the local frame (m), `negative` the cells with borders of negative obstacles. The window around the
    /// vehicle has what the sensor sees up to `max_range_m` (m), and at most 201×201 cells; cells outside of it are ignored.
    pub fn new(
        strips: &[Strip],
        negative: &BTreeSet<CellIndex>,
        centre: CellIndex,
        sensor: DVec3,
        max_range_m: f64,
        certainty: Certainty,
    ) -> CostMap {
        let frame = window(centre, sensor, max_range_m);
        let mut cells = vec![Cell::NONE; frame.side * frame.side];
        for vote in strips.iter().flat_map(|strip| &strip.votes) {
            if let Some(at) = frame.slot(CellIndex::new(vote.cell[0].into(), vote.cell[1].into())) {
                let cell = &mut cells[at];
                cell.ground.add(&vote.ground);
                cell.obstacle.add(&vote.obstacle);
                for (sum, value) in cell.colour.iter_mut().zip(vote.colour) {
                    *sum += u64::from(value);
                }
            }
        }
        for cell in negative {
            if let Some(at) = frame.slot(*cell) {
                cells[at].negative = true;
            }
        }
        let certainty = Certainty { min_pixels: certainty.min_pixels.max(1), ..certainty };
        CostMap { frame, sensor, certainty, cells }
    }

    /// Makes the cells unknown whose pixels say that they are obstacles, and which are too few, or none according to
    /// `is_confirmed`. It gets the other known cells, what their pixels say, and whether that is sure: near, and much higher
    /// than the lowest pixel. Borders of negative obstacles are confirmed otherwise.
    pub(crate) fn confirm(
        &mut self,
        sure: &Sure,
        mut is_confirmed: impl FnMut(CellIndex, Seen, bool) -> bool,
    ) {
        let side = self.frame.side;
        for (at, cell) in self.cells.iter_mut().enumerate() {
            let seen = Seen::of_cost(cell.cost(self.certainty.min_pixels));
            if cell.negative || seen == Seen::Unknown {
                continue;
            }
            let (column, row) = (at % side, at / side);
            let index = self.frame.south_west.offset(column as i64, row as i64);
            if seen == Seen::Ground {
                is_confirmed(index, seen, false);
                continue;
            }
            let distance_m = (self.frame.middle(column, row) - self.sensor.truncate()).length();
            cell.unconfirmed = cell.ground.count + cell.obstacle.count < sure.pixels
                || !is_confirmed(index, seen, distance_m <= sure.within_m && cell.rise_m() >= sure.rise_m);
        }
    }

    /// Whether the map has a cell, and it is no obstacle. What lies outside of the window keeps its label: no frame is
    /// counted there.
    pub(crate) fn doubts(&self, [x, y]: [i32; 2]) -> bool {
        let at = self.frame.slot(CellIndex::new(x.into(), y.into()));
        let cost = |at: usize| self.cells[at].cost(self.certainty.min_pixels);
        at.is_some_and(|at| Seen::of_cost(cost(at)) != Seen::Obstacle)
    }

    /// Costs in row order from the south-west corner.
    pub fn costs(&self) -> impl Iterator<Item = u8> + '_ {
        self.cells.iter().map(|cell| cell.cost(self.certainty.min_pixels))
    }

    /// Converts to a message. Its fields are named as in the world model's maps. For `ground` and `obstacle`: `.mean`
    /// (m), `.variance` (m²), `.min` and `.max` (m) of the heights in the local frame (f32, NaN without pixels) and
    /// `.count` (u32, number of pixels). Then `cost.stereo` and `worth.stereo` (u8), and the mean `red`, `green` and
    /// `blue` with `alpha` 255, or four zeros without colours (u8).
    pub fn to_grid(&self, frame_id: &str, time: Stamp) -> Grid {
        let mut data = Vec::with_capacity(self.cells.len() * CELL_STRIDE);
        // Most cells have no pixels, and all of these have the same bytes.
        let mut none = Vec::new();
        self.put(&Cell::NONE, 0.0, &mut none);
        for (at, cell) in self.cells.iter().enumerate() {
            if *cell == Cell::NONE {
                data.extend_from_slice(&none);
                continue;
            }
            let middle = self.frame.middle(at % self.frame.side, at / self.frame.side);
            self.put(cell, (middle - self.sensor.truncate()).length(), &mut data);
        }
        self.frame.message(frame_id, time, fields(), CELL_STRIDE, data)
    }

    /// Adds the bytes of a cell at this distance (m) from the sensor.
    fn put(&self, cell: &Cell, distance_m: f64, data: &mut Vec<u8>) {
        for sums in [&cell.ground, &cell.obstacle] {
            for value in sums.statistics(self.sensor.z) {
                data.extend_from_slice(&value.to_le_bytes());
            }
            data.extend_from_slice(&sums.count.to_le_bytes());
        }
        let worth = cell.worth(distance_m, &self.certainty);
        data.extend_from_slice(&[cell.cost(self.certainty.min_pixels), worth, 0, 0]);
        data.extend_from_slice(&cell.colour());
    }
}

/// The window around the vehicle's cell that has all cells within a range of the sensor, m; at most 201×201 cells.
fn window(centre: CellIndex, sensor: DVec3, max_range_m: f64) -> GridFrame {
    let around = |half: i64| GridFrame {
        south_west: centre.offset(-half, -half),
        side: 2 * half as usize + 1,
        cell_size_m: CELL_SIZE_M,
    };
    let offset_m = (around(0).middle(0, 0) - sensor.truncate()).length();
    let reach = ((max_range_m + offset_m) / CELL_SIZE_M).ceil();
    around((reach as i64 + 1).min((SIDE / 2) as i64))
}

/// Bytes per cell.
const CELL_STRIDE: usize = 48;

fn fields() -> Vec<PackedElementField> {
    let numbers = ["mean", "variance", "min", "max", "count"];
    let heights = ["ground", "obstacle"].into_iter().flat_map(|class| {
        numbers.into_iter().map(move |number| {
            let kind = if number == "count" { NumericType::Uint32 } else { NumericType::Float32 };
            (format!("{class}.{number}"), kind)
        })
    });
    let all = heights.chain([(cost_field(Source::STEREO), NumericType::Uint8)]);
    let field = |(i, (name, kind)): (usize, (String, NumericType))| PackedElementField {
        name,
        offset: 4 * i as u32,
        r#type: kind.into(),
    };
    let worth = PackedElementField {
        name: format!("worth.{}", Source::STEREO),
        offset: WORTH_OFFSET,
        r#type: NumericType::Uint8.into(),
    };
    let colours = (COLOUR_OFFSET..).zip(["red", "green", "blue", "alpha"]).map(|(offset, name)| {
        PackedElementField { name: name.to_owned(), offset, r#type: NumericType::Uint8.into() }
    });
    all.enumerate().map(field).chain([worth]).chain(colours).collect()
}

/// Offset of the worth in a cell, after the cost.
const WORTH_OFFSET: u32 = COLOUR_OFFSET - 3;
/// Offset of the colour in a cell.
const COLOUR_OFFSET: u32 = CELL_STRIDE as u32 - 4;
