//! Cost maps of what is near: a small window of cells around the vehicle in the local frame.
//!
//! Cells are those of the world model: 0.2 m, counted from the frame's origin. A cell says free (0), obstacle (250) or
//! nothing (255). Where several readings of one message tell of a cell, the highest cost counts.

use rcs_geom::{CellIndex, DVec2};
use rcs_msg::foxglove::packed_element_field::NumericType;
use rcs_msg::foxglove::{Grid, PackedElementField, Pose, Quaternion, Vector2, Vector3};
use rcs_world::{MAX_COST, Source, UNKNOWN_COST};

/// Side of a cell, m.
pub const CELL_SIZE_M: f64 = 0.2;
/// Cells in a row of the window: 8 m, more than any of these sensors reaches.
const SIDE: usize = 41;
/// Distance between the places that are looked at along an edge, m: no cell is stepped over.
const STEP_M: f64 = CELL_SIZE_M / 4.0;

/// A window of costs.
#[derive(Clone, Debug, PartialEq)]
pub struct Costs {
    south_west: CellIndex,
    cells: Vec<u8>,
}

/// The cell of a place in the frame, m; the nearest there is where the numbers are too large.
fn cell_of(place: DVec2) -> CellIndex {
    let cell = (place / CELL_SIZE_M).floor();
    CellIndex::new(cell.x as i64, cell.y as i64)
}

impl Costs {
    /// Nothing known in the window around a place, m.
    pub fn around(place: DVec2) -> Costs {
        let half = (SIDE / 2) as i64;
        Costs { south_west: cell_of(place).offset(-half, -half), cells: vec![UNKNOWN_COST; SIDE * SIDE] }
    }

    /// Number of the cell of a place; `None` outside of the window.
    fn slot(&self, place: DVec2) -> Option<usize> {
        let cell = cell_of(place);
        // Places far off have numbers at the ends of what there is.
        let column = cell.x.saturating_sub(self.south_west.x);
        let row = cell.y.saturating_sub(self.south_west.y);
        let side = 0..SIDE as i64;
        (side.contains(&column) && side.contains(&row)).then(|| row as usize * SIDE + column as usize)
    }

    /// Says of the cell at a place that its cost is at least `cost`. Places outside of the window are left out.
    pub fn mark(&mut self, place: DVec2, cost: u8) {
        if let Some(slot) = self.slot(place) {
            let known = self.cells[slot];
            self.cells[slot] = if known == UNKNOWN_COST { cost } else { known.max(cost) };
        }
    }

    /// Marks the cells that a straight line touches.
    pub fn mark_line(&mut self, from: DVec2, to: DVec2, cost: u8) {
        let steps = (from.distance(to) / STEP_M).ceil().min(1e4);
        for step in 0..=steps as usize {
            let part = if steps > 0.0 { step as f64 / steps } else { 0.0 };
            self.mark(from.lerp(to, part), cost);
        }
    }

    /// Marks the cells whose middle lies in a rectangle: corner, and its two sides from there, m.
    pub fn mark_rectangle(&mut self, corner: DVec2, along: DVec2, across: DVec2, cost: u8) {
        let (length, width) = (along.length(), across.length());
        if length * width == 0.0 {
            return;
        }
        for row in 0..SIDE as i64 {
            for column in 0..SIDE as i64 {
                let cell = self.south_west.offset(column, row);
                let middle = DVec2::new(cell.x as f64 + 0.5, cell.y as f64 + 0.5) * CELL_SIZE_M;
                let place = middle - corner;
                let (x, y) = (place.dot(along) / length, place.dot(across) / width);
                if (0.0..=length).contains(&x) && (0.0..=width).contains(&y) {
                    self.mark(middle, cost);
                }
            }
        }
    }

    /// The cost at a place; `None` where nothing is known or outside of the window.
    pub fn at(&self, place: DVec2) -> Option<u8> {
        self.slot(place).map(|slot| self.cells[slot]).filter(|&cost| cost <= MAX_COST)
    }

    /// How many cells have at least this cost.
    pub fn count_from(&self, cost: u8) -> usize {
        self.cells.iter().filter(|&&cell| cell <= MAX_COST && cell >= cost).count()
    }

    /// As a message with the field `cost.<source>` (u8, 0–250, 255 unknown).
    pub fn to_grid(&self, source: Source, frame_id: &str, timestamp: prost_types::Timestamp) -> Grid {
        let CellIndex { x, y } = self.south_west;
        let corner = Vector3 { x: x as f64 * CELL_SIZE_M, y: y as f64 * CELL_SIZE_M, z: 0.0 };
        let field = PackedElementField {
            name: format!("cost.{source}"),
            offset: 0,
            r#type: NumericType::Uint8.into(),
        };
        Grid {
            timestamp: Some(timestamp),
            frame_id: frame_id.to_owned(),
            pose: Some(Pose {
                position: Some(corner),
                orientation: Some(Quaternion { w: 1.0, ..Quaternion::default() }),
            }),
            column_count: SIDE as u32,
            cell_size: Some(Vector2 { x: CELL_SIZE_M, y: CELL_SIZE_M }),
            row_stride: SIDE as u32,
            cell_stride: 1,
            fields: vec![field],
            data: self.cells.clone().into(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use rcs_world::GridView;

    proptest! {
        #[test]
        fn a_line_marks_every_cell_that_it_crosses_the_middle_of(
            from in prop::array::uniform2(-3.5..3.5_f64),
            to in prop::array::uniform2(-3.5..3.5_f64),
        ) {
            let (from, to) = (DVec2::from_array(from), DVec2::from_array(to));
            let mut costs = Costs::around(DVec2::ZERO);
            costs.mark_line(from, to, 250);
            for i in 0..=1000 {
                let place = from.lerp(to, f64::from(i) / 1000.0);
                let inside_of_cell = (place / CELL_SIZE_M - (place / CELL_SIZE_M).floor() - 0.5).abs();
                // Corners of cells that the line barely touches may be left out.
                if inside_of_cell.max_element() < 0.3 {
                    prop_assert_eq!(costs.at(place), Some(250));
                }
            }
        }
    }

    #[test]
    fn the_highest_cost_of_a_cell_counts_in_any_order() {
        for costs_in_order in [[0, 250], [250, 0]] {
            let mut costs = Costs::around(DVec2::new(100.0, -50.0));
            for cost in costs_in_order {
                costs.mark(DVec2::new(100.1, -50.1), cost);
            }
            assert_eq!(costs.at(DVec2::new(100.1, -50.1)), Some(250));
            assert_eq!(costs.at(DVec2::new(100.3, -50.1)), None);
        }
    }

    #[test]
    fn what_lies_outside_of_the_window_is_left_out() {
        let mut costs = Costs::around(DVec2::ZERO);
        let before = costs.clone();
        costs.mark(DVec2::new(5.0, 0.0), 250);
        costs.mark(DVec2::new(f64::INFINITY, f64::NEG_INFINITY), 250);
        assert_eq!(costs, before);
    }

    #[test]
    fn the_message_has_its_cells_where_they_were_marked() {
        let mut costs = Costs::around(DVec2::new(-7.33, 12.01));
        costs.mark(DVec2::new(-6.5, 12.5), 250);
        let grid = costs.to_grid(Source::Bumper, "local", prost_types::Timestamp::default());
        let view = GridView::new(&grid).unwrap();
        let field = view.field("cost.bumper").unwrap();
        let corner = view.frame_from_grid().translation.truncate();
        let cell = ((DVec2::new(-6.5, 12.5) - corner) / CELL_SIZE_M).floor();
        assert_eq!(field.get(cell.x as usize, cell.y as usize), Some(250.0));
        assert_eq!(field.values().filter(|&cost| cost <= 250.0).count(), 1);
    }
}
