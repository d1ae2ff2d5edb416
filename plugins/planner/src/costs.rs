//! The grid of costs that the search reads.

use crate::place::Place;

/// The highest cost of a cell that can be entered.
pub const MAX_COST: u8 = 250;
/// The cost of a cell that cannot be entered.
pub const BLOCKED: u8 = 255;

/// Costs of entering the cells of a grid, 1 to [`MAX_COST`] or [`BLOCKED`], by rows.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CostGrid {
    columns: usize,
    rows: usize,
    cells: Vec<u8>,
}

/// A grid that cannot be searched.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CostGridError {
    /// Its size.
    #[error(
        "grid is {columns}x{rows} with {cells} cells, expected 1 to {MAX_SIDE} columns and rows, and a cell for each"
    )]
    Size {
        /// Cells per row.
        columns: usize,
        /// Number of rows.
        rows: usize,
        /// Number of cells given.
        cells: usize,
    },
    /// A cost.
    #[error("cost of column {column}, row {row} is {cost}, expected 1 to 250, or 255 for blocked")]
    Cost {
        /// Column of the cell.
        column: usize,
        /// Row of the cell.
        row: usize,
        /// Its cost.
        cost: u8,
    },
}

/// Greatest number of columns and of rows.
pub const MAX_SIDE: usize = 1 << 14;

impl CostGrid {
    /// A grid of these costs, by rows.
    pub fn new(columns: usize, rows: usize, cells: Vec<u8>) -> Result<CostGrid, CostGridError> {
        let sides = 1..=MAX_SIDE;
        if !sides.contains(&columns) || !sides.contains(&rows) || cells.len() != columns * rows {
            return Err(CostGridError::Size { columns, rows, cells: cells.len() });
        }
        let valid = |&cost: &u8| (1..=MAX_COST).contains(&cost) || cost == BLOCKED;
        match cells.iter().position(|cost| !valid(cost)) {
            Some(at) => Err(CostGridError::Cost { column: at % columns, row: at / columns, cost: cells[at] }),
            None => Ok(CostGrid { columns, rows, cells }),
        }
    }

    /// Cells per row.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// The costs, by rows.
    pub fn cells(&self) -> &[u8] {
        &self.cells
    }

    /// Whether the place is a cell of the grid.
    pub fn contains(&self, place: Place) -> bool {
        let within = |at: i32, end: usize| at >= 0 && (at as usize) < end;
        within(place.column, self.columns) && within(place.row, self.rows)
    }

    /// The cost of a cell; `None` outside of the grid.
    pub fn get(&self, place: Place) -> Option<u8> {
        self.contains(place).then(|| self.cells[place.row as usize * self.columns + place.column as usize])
    }

    /// Blocks a cell; one outside of the grid is ignored.
    pub fn block(&mut self, place: Place) {
        if self.contains(place) {
            self.cells[place.row as usize * self.columns + place.column as usize] = BLOCKED;
        }
    }

    /// The highest cost; that of blocked cells does not count. 1 if all are blocked.
    pub fn most(&self) -> u8 {
        let cost = |&cell: &u8| if cell == BLOCKED { 1 } else { cell };
        self.cells.iter().map(cost).fold(1, u8::max)
    }

    /// The lowest cost; that of blocked cells does not count. 1 if all are blocked.
    pub fn least(&self) -> u8 {
        match self.cells.iter().copied().fold(BLOCKED, u8::min) {
            BLOCKED => 1,
            least => least,
        }
    }
}
