//! The fused map that planners make costs from.

use crate::place::Place;
use rcs_geom::DVec2;
use rcs_world::UNKNOWN_COST;

/// The fused map that costs are made from.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sensed {
    /// Cells per row.
    pub columns: usize,
    /// Size of a cell, m.
    pub cell_size_m: f64,
    /// South-west corner in the map's frame, m.
    pub corner: DVec2,
    /// Fused costs by rows: 0 to 250, or 255 for unknown.
    pub fused: Vec<u8>,
    /// Whether the bumper hit something in the cell; empty if no cell was hit.
    pub bumped: Vec<bool>,
    /// Whether an earlier run, which has come near to the cell, knew an obstacle in it; empty if it knew none.
    pub remembered: Vec<bool>,
    /// Least distance from which an obstacle was seen in the cell, decimetres, 0 for never; empty if the map does not say
    /// it.
    pub seen_from_dm: Vec<u8>,
}

impl Sensed {
    /// The cell at a position, m; it may lie outside of the map. `None` for positions that are no numbers or too far
    /// away.
    pub fn place(&self, position: DVec2) -> Option<Place> {
        let cells = ((position - self.corner) / self.cell_size_m).floor();
        let near = |at: f64| at.abs() < f64::from(i32::MAX / 4);
        (near(cells.x) && near(cells.y)).then(|| Place::new(cells.x as i32, cells.y as i32))
    }

    /// The centre of a cell, m.
    pub fn centre(&self, place: Place) -> DVec2 {
        self.corner + (DVec2::new(f64::from(place.column), f64::from(place.row)) + 0.5) * self.cell_size_m
    }

    /// Share of the cells within a distance of a position that are on the map and known.
    pub fn known_share(&self, position: DVec2, within_m: f64) -> f64 {
        let Some(middle) = self.place(position) else { return 0.0 };
        let reach = (within_m / self.cell_size_m).min(1000.0) as i32;
        let rows = (self.fused.len() / self.columns.max(1)) as i32;
        let (mut all, mut known) = (0_u32, 0_u32);
        for row in middle.row - reach..=middle.row + reach {
            for column in middle.column - reach..=middle.column + reach {
                if (row - middle.row).pow(2) + (column - middle.column).pow(2) > reach * reach {
                    continue;
                }
                all += 1;
                let inside = (0..rows).contains(&row) && (0..self.columns as i32).contains(&column);
                known += u32::from(inside && self.fused[self.index(Place::new(column, row))] != UNKNOWN_COST);
            }
        }
        f64::from(known) / f64::from(all.max(1))
    }

    pub(crate) fn index(&self, place: Place) -> usize {
        place.row as usize * self.columns + place.column as usize
    }
}

/// Calls a function with each cell of the map whose centre lies within a distance of a position, and the distance, m.
pub(crate) fn around(sensed: &Sensed, position: DVec2, within_m: f64, mut visit: impl FnMut(Place, f64)) {
    let Some(middle) = sensed.place(position) else { return };
    let reach = (within_m / sensed.cell_size_m).ceil().min(1000.0) as i32;
    let rows = (sensed.fused.len() / sensed.columns.max(1)) as i32;
    let span = |at: i32, end: i32| (at - reach).max(0)..(at + reach + 1).min(end);
    for row in span(middle.row, rows) {
        for column in span(middle.column, sensed.columns as i32) {
            let place = Place::new(column, row);
            let distance_m = sensed.centre(place).distance(position);
            if distance_m <= within_m {
                visit(place, distance_m);
            }
        }
    }
}
