//! Distance of every cell to the nearest blocked cell, up to a bound.
//!
//! The exact Euclidean distance transform in two passes: along each row the distance in cells to the nearest blocked one,
//! then along each column the least sum of squares over the rows within the bound. With a bound of R cells the cost is
//! that of 2 R + 1 comparisons per cell.

/// Reusable memory.
#[derive(Clone, Debug, Default)]
pub struct Clearance {
    /// Distance along the row, cells.
    along_row: Vec<u16>,
    /// Squared distance, cells².
    squared: Vec<u16>,
}

/// Greatest bound, cells, so that squares fit into 16 bits.
pub const MAX_BOUND: usize = 180;

impl Clearance {
    /// Squared distances between the centres of each cell and of the nearest blocked one, cells²; `(bound + 1)²` where
    /// it is farther away than `bound` cells (at most [`MAX_BOUND`]).
    pub fn squared(&mut self, columns: usize, is_blocked: &[bool], bound: usize) -> &[u16] {
        let bound = bound.min(MAX_BOUND);
        let far = bound as u16 + 1;
        self.along_row.clear();
        self.along_row.resize(is_blocked.len(), far);
        for (row, out) in is_blocked.chunks_exact(columns).zip(self.along_row.chunks_exact_mut(columns)) {
            let mut since = far;
            for (&blocked, out) in row.iter().zip(out.iter_mut()) {
                since = if blocked { 0 } else { (since + 1).min(far) };
                *out = since;
            }
            since = far;
            for (&blocked, out) in row.iter().zip(out.iter_mut()).rev() {
                since = if blocked { 0 } else { (since + 1).min(far) };
                *out = since.min(*out);
            }
        }
        self.along_row.iter_mut().for_each(|distance| *distance *= *distance);
        let rows = is_blocked.len() / columns.max(1);
        self.squared.clear();
        self.squared.resize(is_blocked.len(), far * far);
        for (row, out) in self.squared.chunks_exact_mut(columns).enumerate() {
            for other in row.saturating_sub(bound)..(row + bound + 1).min(rows) {
                let rise = row.abs_diff(other) as u16;
                let along = &self.along_row[other * columns..][..columns];
                for (out, &along) in out.iter_mut().zip(along) {
                    *out = (*out).min(along.saturating_add(rise * rise));
                }
            }
        }
        &self.squared
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn reference_squared(columns: usize, is_blocked: &[bool], bound: usize) -> Vec<u16> {
        let place = |at: usize| ((at % columns) as i64, (at / columns) as i64);
        let nearest = |at: usize| {
            let (column, row) = place(at);
            let blocked = (0..is_blocked.len()).filter(|&other| is_blocked[other]).map(place);
            blocked.map(|(c, r)| ((c - column).pow(2) + (r - row).pow(2)) as u64).min()
        };
        let far = (bound as u64 + 1).pow(2);
        (0..is_blocked.len()).map(|at| nearest(at).map_or(far, |squared| squared.min(far)) as u16).collect()
    }

    proptest! {
        #[test]
        fn it_equals_the_plain_search(
            columns in 1..20_usize,
            bound in 0..9_usize,
            cells in prop::collection::vec(0..12_u8, 1..300),
        ) {
            let rows = cells.len().div_ceil(columns);
            let mut is_blocked: Vec<bool> = cells.iter().map(|&cell| cell == 0).collect();
            is_blocked.resize(rows * columns, false);
            let expected = reference_squared(columns, &is_blocked, bound);
            let mut clearance = Clearance::default();
            prop_assert_eq!(clearance.squared(columns, &is_blocked, bound), &expected);
        }
    }
}
