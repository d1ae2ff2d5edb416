//! Cost maps as messages to the world model: square, north-up windows of cells whose indices count from the frame's
//! origin.

use rcs_geom::{CellIndex, DVec2};
use rcs_msg::Stamp;
use rcs_msg::foxglove::packed_element_field::NumericType;
use rcs_msg::foxglove::{Grid, PackedElementField, Pose, Quaternion, Vector2, Vector3};
use rcs_world::{MAX_COST, UNKNOWN_COST};
use std::fmt::Display;

/// Name of the grid field that holds the costs of a source.
pub fn cost_field(source: impl Display) -> String {
    format!("cost.{source}")
}

/// Position and size of a window of cells.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GridFrame {
    /// The south-west corner cell, counted from the frame's origin.
    pub south_west: CellIndex,
    /// Cells per side.
    pub side: usize,
    /// Size of a cell, m.
    pub cell_size_m: f64,
}

impl GridFrame {
    /// A window whose middle cell contains a position (m).
    pub fn around(place: DVec2, side: usize, cell_size_m: f64) -> GridFrame {
        let half = (side / 2) as i64;
        let south_west = cell_of(place, cell_size_m).offset(-half, -half);
        GridFrame { south_west, side, cell_size_m }
    }

    /// Index of a cell in the window, by rows from the south-west; `None` outside of the window.
    pub fn slot(&self, cell: CellIndex) -> Option<usize> {
        // Cell indices of very distant positions saturate at the limits of i64.
        let column = cell.x.saturating_sub(self.south_west.x);
        let row = cell.y.saturating_sub(self.south_west.y);
        let side = 0..self.side as i64;
        (side.contains(&column) && side.contains(&row)).then(|| row as usize * self.side + column as usize)
    }

    /// Middle of a cell, given its column and row in the window, m.
    pub fn middle(&self, column: usize, row: usize) -> DVec2 {
        let CellIndex { x, y } = self.south_west.offset(column as i64, row as i64);
        DVec2::new(x as f64 + 0.5, y as f64 + 0.5) * self.cell_size_m
    }

    /// A message with these fields; the fields of a cell are contiguous, and `cell_stride` is the size of a cell in
    /// bytes.
    pub fn message(
        &self,
        frame_id: &str,
        time: Stamp,
        fields: Vec<PackedElementField>,
        cell_stride: usize,
        data: Vec<u8>,
    ) -> Grid {
        let CellIndex { x, y } = self.south_west;
        let corner = Vector3 { x: x as f64 * self.cell_size_m, y: y as f64 * self.cell_size_m, z: 0.0 };
        Grid {
            timestamp: Some(time.to_proto()),
            frame_id: frame_id.to_owned(),
            pose: Some(Pose {
                position: Some(corner),
                orientation: Some(Quaternion { w: 1.0, ..Quaternion::default() }),
            }),
            column_count: self.side as u32,
            cell_size: Some(Vector2 { x: self.cell_size_m, y: self.cell_size_m }),
            row_stride: (self.side * cell_stride) as u32,
            cell_stride: cell_stride as u32,
            fields,
            data: data.into(),
        }
    }

    /// A message with fields of one byte: their names, before `.<source>`, and the values of all cells by rows from the
    /// south-west, those of one cell together.
    pub fn message_of_bytes(
        &self,
        source: impl Display,
        names: &[&str],
        data: Vec<u8>,
        frame_id: &str,
        time: Stamp,
    ) -> Grid {
        let field = |(offset, name): (u32, &&str)| PackedElementField {
            name: format!("{name}.{source}"),
            offset,
            r#type: NumericType::Uint8.into(),
        };
        let fields = (0..).zip(names).map(field).collect();
        self.message(frame_id, time, fields, names.len(), data)
    }
}

/// The cell of a position (m) in the frame; saturates for positions too far away.
fn cell_of(place: DVec2, cell_size_m: f64) -> CellIndex {
    let cell = (place / cell_size_m).floor();
    CellIndex::new(cell.x as i64, cell.y as i64)
}

/// A window of costs: 0 (free) to 250 (obstacle), 255 unknown.
#[derive(Clone, Debug, PartialEq)]
pub struct CostGrid {
    frame: GridFrame,
    /// By rows from the south-west.
    costs: Vec<u8>,
}

impl CostGrid {
    /// A window in which every cost is unknown.
    pub fn new(frame: GridFrame) -> CostGrid {
        CostGrid { frame, costs: vec![UNKNOWN_COST; frame.side * frame.side] }
    }

    /// A window with these costs, by rows from the south-west; `None` if their number differs from that of the cells.
    pub fn of(frame: GridFrame, costs: Vec<u8>) -> Option<CostGrid> {
        (costs.len() == frame.side * frame.side).then_some(CostGrid { frame, costs })
    }

    /// Position and size of the window.
    pub fn frame(&self) -> &GridFrame {
        &self.frame
    }

    /// Costs by rows from the south-west.
    pub fn costs(&self) -> &[u8] {
        &self.costs
    }

    /// Costs by rows from the south-west, to write.
    pub fn costs_mut(&mut self) -> &mut [u8] {
        &mut self.costs
    }

    /// Index of the cell at a position (m); `None` outside of the window.
    pub fn slot(&self, place: DVec2) -> Option<usize> {
        self.frame.slot(cell_of(place, self.frame.cell_size_m))
    }

    /// Raises the cost of the cell at a position (m) to at least `cost`. Positions outside of the window are ignored.
    pub fn mark(&mut self, place: DVec2, cost: u8) {
        if let Some(slot) = self.slot(place) {
            let known = self.costs[slot];
            self.costs[slot] = if known == UNKNOWN_COST { cost } else { known.max(cost) };
        }
    }

    /// The cost at a position (m); `None` if it is unknown or outside of the window.
    pub fn at(&self, place: DVec2) -> Option<u8> {
        self.slot(place).map(|slot| self.costs[slot]).filter(|&cost| cost <= MAX_COST)
    }

    /// Number of cells with at least this cost.
    pub fn count_from(&self, cost: u8) -> usize {
        self.costs.iter().filter(|&&known| known <= MAX_COST && known >= cost).count()
    }

    /// Converts to a message with the one field `cost.<source>` (u8, 0 to 250, 255 unknown).
    pub fn into_message(self, source: impl Display, frame_id: &str, time: Stamp) -> Grid {
        self.frame.message_of_bytes(source, &["cost"], self.costs, frame_id, time)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcs_world::{CELL_SIZE_M, GridView};

    #[test]
    fn the_message_has_its_cells_where_they_were_marked() {
        let place = DVec2::new(-6.5, 12.5);
        let mut costs = CostGrid::new(GridFrame::around(DVec2::new(-7.33, 12.01), 41, CELL_SIZE_M));
        costs.mark(place, 250);
        costs.mark(place, 0);
        costs.mark(DVec2::new(f64::INFINITY, f64::NEG_INFINITY), 250);
        assert_eq!((costs.at(place), costs.count_from(0)), (Some(250), 1));
        let grid = costs.into_message("bumper", "local", Stamp(5));
        let view = GridView::new(&grid).unwrap();
        let field = view.field("cost.bumper").unwrap();
        let corner = view.frame_from_grid().translation.truncate();
        let cell = ((place - corner) / CELL_SIZE_M).floor();
        assert_eq!(field.get(cell.x as usize, cell.y as usize), Some(250.0));
        assert_eq!(field.values().filter(|&cost| cost <= 250.0).count(), 1);
    }

    #[test]
    fn the_vehicle_is_in_the_middle_cell() {
        let frame = GridFrame::around(DVec2::new(-0.1, 0.1), 201, CELL_SIZE_M);
        assert_eq!(frame.slot(CellIndex::new(-1, 0)), Some(100 * 201 + 100));
        assert!((frame.middle(100, 100) - DVec2::new(-0.1, 0.1)).length() < 1e-12);
        assert_eq!(CostGrid::of(frame, vec![0; 5]), None);
    }
}
