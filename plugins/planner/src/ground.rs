//! What the ground costs that a vehicle covers: the mean of the cells around it.

/// Means of the costs of cells over squares of cells.
#[derive(Clone, Debug, Default)]
pub(crate) struct Ground {
    /// By cells: the cost and [`ONE`]; 0 for a cell that is blocked.
    cells: Vec<u32>,
    /// By columns: their sum over the rows of a square; 0 for the columns beside the map that squares reach.
    sums: Vec<u32>,
    means: Vec<Option<f32>>,
}

/// Counts a cell in the upper bits of a sum, above its costs: enough for squares of 63 cells on a side.
const ONE: u32 = 1 << 20;

/// Greatest reach, cells.
const MAX_REACH: usize = 31;

impl Ground {
    /// Takes the costs of cells, by rows, `None` for cells that are blocked, and finds their means over squares of
    /// `2 reach + 1` cells on a side. Cells that are blocked or outside of the map do not count.
    pub(crate) fn lay(&mut self, columns: usize, costs: impl Iterator<Item = Option<u8>>, reach: usize) {
        let (columns, reach) = (columns.max(1), reach.min(MAX_REACH));
        self.cells.clear();
        self.cells.extend(costs.map(|cost| cost.map_or(0, |cost| ONE + u32::from(cost))));
        self.means.clear();
        self.sums.clear();
        self.sums.resize(columns + 2 * reach + 1, 0);
        let rows: Vec<&[u32]> = self.cells.chunks_exact(columns).collect();
        let add =
            |sums: &mut [u32], row: &[u32]| sums.iter_mut().zip(row).for_each(|(sum, cell)| *sum += cell);
        let subtract =
            |sums: &mut [u32], row: &[u32]| sums.iter_mut().zip(row).for_each(|(sum, cell)| *sum -= cell);
        let first = reach + 1;
        rows.iter().take(reach).for_each(|row| add(&mut self.sums[first..], row));
        for (at, cells) in rows.iter().enumerate() {
            if let Some(next) = rows.get(at + reach) {
                add(&mut self.sums[first..], next);
            }
            if let Some(last) = at.checked_sub(reach + 1) {
                subtract(&mut self.sums[first..], rows[last]);
            }
            let mut sum: u32 = self.sums[..=2 * reach].iter().sum();
            let (leaves, enters) = (&self.sums, &self.sums[2 * reach + 1..]);
            self.means.extend(cells.iter().zip(leaves).zip(enters).map(|((cell, left), right)| {
                sum = sum + right - left;
                (*cell > 0).then(|| (sum % ONE) as f32 / (sum / ONE) as f32)
            }));
        }
    }

    /// The mean around a cell; `None` if the cell is blocked, or there is none.
    pub(crate) fn mean(&self, at: usize) -> Option<f32> {
        self.means.get(at).copied().flatten()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The mean of the cells of a square that are not blocked, counted one by one.
    fn plain(columns: usize, costs: &[Option<u8>], reach: usize, at: usize) -> Option<f32> {
        costs[at]?;
        let (row, column) = (at / columns, at % columns);
        let inside = |other: &usize| {
            (other / columns).abs_diff(row) <= reach && (other % columns).abs_diff(column) <= reach
        };
        let known: Vec<f32> =
            (0..costs.len()).filter(inside).filter_map(|other| costs[other]).map(f32::from).collect();
        Some(known.iter().sum::<f32>() / known.len() as f32)
    }

    #[test]
    fn means_are_those_of_the_cells_counted_one_by_one() {
        let mut ground = Ground::default();
        for (columns, rows, reach) in [(7, 5, 1), (7, 5, 2), (3, 9, 4), (1, 1, 2), (6, 6, 0), (70, 70, 31)] {
            let cost = |at: usize| (at * 37 % 11 > 1).then_some((at * 91 % 250) as u8);
            let costs: Vec<_> = (0..columns * rows).map(cost).collect();
            ground.lay(columns, costs.iter().copied(), reach);
            for at in 0..costs.len() {
                assert_eq!(
                    ground.mean(at),
                    plain(columns, &costs, reach, at),
                    "{columns}x{rows}, {reach}, {at}"
                );
            }
        }
    }

    #[test]
    fn an_empty_map_has_no_means() {
        let mut ground = Ground::default();
        ground.lay(0, [].into_iter(), 2);
        assert!(ground.means.is_empty());
    }
}
