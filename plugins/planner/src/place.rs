//! Cells of a grid, and distances between them.

/// Length of a straight step, in parts of a cell.
pub const STRAIGHT: u32 = 408;
/// Length of a diagonal step in the same parts: 577 / 408 = 1.414216.
pub const DIAGONAL: u32 = 577;

/// A position in a grid: column (x) and row (y); may lie outside of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Place {
    /// Column, increasing along x.
    pub column: i32,
    /// Row, increasing along y.
    pub row: i32,
}

impl Place {
    /// The place in a column and a row.
    pub const fn new(column: i32, row: i32) -> Place {
        Place { column, row }
    }

    /// Length of the shortest eight-connected path to another place, in parts of a cell.
    pub fn octile(self, other: Place) -> u64 {
        let (dx, dy) = (self.column.abs_diff(other.column), self.row.abs_diff(other.row));
        let (long, short) = (u64::from(dx.max(dy)), u64::from(dx.min(dy)));
        long * u64::from(STRAIGHT) + short * u64::from(DIAGONAL - STRAIGHT)
    }
}
