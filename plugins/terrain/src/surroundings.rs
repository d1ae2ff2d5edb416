//! Cells that cannot be compared with models take the judgement of their surroundings, where experience backs it.
//!
//! Growth hides most of the ground in it from the cameras, and what lies close ahead of the vehicle is below the image.
//! Range sensors call such cells obstacles, and nothing of their appearance says otherwise. So a cell with too few
//! points to be compared is judged like the cells within [`RADIUS`] cells of it that resemble models: with the mean of
//! their costs and backings, half as sure. There must be [`LEAST`] of them, backed by half on average. A cell that looks
//! unlike all models keeps its own judgement, so that a thing that stands in growth stays what it is.
//!
//! The papers do not have this step; it assumes that neighbouring ground is alike where nothing distinguishes it, as the
//! terrain model of Wellington 2005 does.
//!
//! The sums over the surroundings are differences of running sums, so their cost does not depend on the radius.

use crate::judgement::{Judgement, SURE};

/// Distance, in cells along either axis, up to which the surroundings reach: 0.6 m.
pub const RADIUS: usize = 3;
/// Least number of cells around one that resemble models.
pub const LEAST: u32 = 4;

/// What a cell contributes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// It cannot be compared with models: it takes the judgement of its surroundings.
    Takes,
    /// It resembles a model: its judgement counts for those around it.
    Gives,
    /// Neither.
    Keeps,
}

/// Judges the cells that cannot be compared like their surroundings. Cells in row order, `side` per row.
pub fn spread(cells: &mut [Option<Judgement>], parts: &[Part], side: usize) {
    let sums = running_sums(cells, parts, side);
    let stride = side + 1;
    for (at, (cell, part)) in cells.iter_mut().zip(parts).enumerate() {
        if *part != Part::Takes {
            continue;
        }
        let span = |at: usize| (at.saturating_sub(RADIUS), (at + RADIUS + 1).min(side));
        let ((left, right), (low, high)) = (span(at % side), span(at / side));
        let sum = |i: usize| {
            let corner = |row: usize, column: usize| sums[row * stride + column][i];
            corner(high, right) + corner(low, left) - corner(low, right) - corner(high, left)
        };
        let [count, cost, backing] = [sum(0), sum(1), sum(2)];
        if count >= LEAST && 2 * backing >= 255 * count {
            let mean = |sum: u32| ((sum + count / 2) / count) as u8;
            *cell = Some(Judgement { cost: mean(cost), confidence: SURE / 2, backing: mean(backing) });
        }
    }
}

/// Number, costs and backings of the cells that give theirs, summed over all rows and columns before each corner.
fn running_sums(cells: &[Option<Judgement>], parts: &[Part], side: usize) -> Vec<[u32; 3]> {
    let stride = side + 1;
    let mut sums = vec![[0_u32; 3]; stride * (cells.len() / side + 1)];
    let rows = cells.chunks_exact(side).zip(parts.chunks_exact(side));
    for (row, (cells, parts)) in rows.enumerate() {
        let mut of_row = [0_u32; 3];
        for (column, (cell, part)) in cells.iter().zip(parts).enumerate() {
            if let (Some(cell), Part::Gives) = (cell, part) {
                let counted = [1, u32::from(cell.cost), u32::from(cell.backing)];
                of_row.iter_mut().zip(counted).for_each(|(sum, number)| *sum += number);
            }
            let above = sums[row * stride + column + 1];
            sums[(row + 1) * stride + column + 1] = [0, 1, 2].map(|i| above[i] + of_row[i]);
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const SIDE: usize = 11;

    fn judgement(cost: u8, backing: u8) -> Judgement {
        Judgement { cost, confidence: SURE, backing }
    }

    /// The rule, cell by cell.
    fn reference(cells: &[Option<Judgement>], parts: &[Part], at: usize) -> Option<Judgement> {
        let (x, y) = (at % SIDE, at / SIDE);
        let is_near =
            |other: usize| (other % SIDE).abs_diff(x) <= RADIUS && (other / SIDE).abs_diff(y) <= RADIUS;
        let around: Vec<Judgement> = (0..cells.len())
            .filter(|&other| is_near(other) && parts[other] == Part::Gives)
            .filter_map(|other| cells[other])
            .collect();
        let count = around.len() as f64;
        let mean = |of: fn(&Judgement) -> u8| around.iter().map(|c| f64::from(of(c))).sum::<f64>() / count;
        let (cost, backing) = (mean(|c| c.cost), mean(|c| c.backing));
        let is_backed = around.len() >= LEAST as usize && backing >= 127.5;
        let taken =
            Judgement { cost: (cost + 0.5) as u8, confidence: SURE / 2, backing: (backing + 0.5) as u8 };
        if parts[at] == Part::Takes && is_backed { Some(taken) } else { cells[at] }
    }

    proptest! {
        #[test]
        fn the_surroundings_equal_those_of_the_rule(
            cells in prop::collection::vec((0..4_u8, any::<u8>(), any::<u8>(), 0..3_u8), SIDE * SIDE)
        ) {
            let said: Vec<Option<Judgement>> =
                cells.iter().map(|&(known, cost, backing, _)| (known > 0).then(|| judgement(cost, backing))).collect();
            let parts: Vec<Part> =
                cells.iter().map(|cell| [Part::Takes, Part::Gives, Part::Keeps][usize::from(cell.3)]).collect();
            let mut spread_cells = said.clone();
            spread(&mut spread_cells, &parts, SIDE);
            for (at, cell) in spread_cells.iter().enumerate() {
                prop_assert_eq!(*cell, reference(&said, &parts, at), "cell {}", at);
            }
        }
    }

    #[test]
    fn a_thing_in_growth_stays_and_gaps_in_the_growth_are_filled() {
        let middle = SIDE * SIDE / 2;
        let mut cells = vec![Some(judgement(30, 255)); SIDE * SIDE];
        let mut parts = vec![Part::Gives; SIDE * SIDE];
        (cells[middle], parts[middle]) = (Some(judgement(250, 0)), Part::Keeps);
        (cells[middle + 1], parts[middle + 1]) = (None, Part::Takes);
        (cells[middle + 2], parts[middle + 2]) = (Some(judgement(250, 0)), Part::Takes);
        spread(&mut cells, &parts, SIDE);
        let filled = Some(Judgement { cost: 30, confidence: SURE / 2, backing: 255 });
        assert_eq!(cells[middle..middle + 3], [Some(judgement(250, 0)), filled, filled]);
    }

    #[test]
    fn what_experience_does_not_back_does_not_spread() {
        let mut cells = vec![Some(judgement(0, 100)); SIDE * SIDE];
        let mut parts = vec![Part::Gives; SIDE * SIDE];
        (cells[60], parts[60]) = (None, Part::Takes);
        spread(&mut cells, &parts, SIDE);
        assert_eq!(cells[60], None);
    }
}
