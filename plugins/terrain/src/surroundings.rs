//! Cells that cannot be compared with models take the judgement of their surroundings, where experience backs it.
//!
//! Growth hides most of the ground in it from the cameras, and what lies close ahead of the vehicle is below the image.
//! Range sensors call such cells obstacles, and nothing of their appearance says otherwise. So a cell with too few
//! points to be compared is judged like the cells within [`RADIUS`] cells of it that resemble models: with the mean of
//! their costs and backings, half as sure. There must be [`LEAST`] of them, backed by half on average.
//!
//! Growth looks like many models, and each of them takes some metres of driving until it is backed; and in one of a hundred
//! cells of it a stem close to the camera looks like none. A vehicle that goes around each of them does not get on. So where
//! driving has contradicted range for most of the surroundings, a cell that is no higher than what was driven over is growth,
//! too, if its model is one of ground that driving has contradicted in part, or if it is one of at most [`STRAYS`] others
//! there. What is higher or larger, as a post, a trunk or a stone, stays what it is.
//!
//! The papers do not have these steps; they assume that neighbouring ground is alike where nothing distinguishes it, as the
//! terrain model of Wellington 2005 does.
//!
//! The sums over the surroundings are differences of running sums, so their cost does not depend on the radius.

use crate::judgement::{Judgement, SURE};
use rcs_world::OBSTACLE_COST;

/// Distance, in cells along either axis, up to which the surroundings reach: 0.6 m.
pub const RADIUS: usize = 3;
/// Least number of cells around one that resemble models.
pub const LEAST: u32 = 4;
/// Greatest number of cells in the surroundings, of 49, that do not look like what was driven over and are growth all the
/// same.
pub const STRAYS: u32 = 4;

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

/// What a cell is to its surroundings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Role {
    /// What it contributes.
    pub part: Part,
    /// How far driving has contradicted range for its model, 0 to 255; 0 without one.
    pub driven: u8,
    /// Whether it is no higher than what was driven over.
    pub is_low: bool,
}

impl Role {
    /// Whether a judgement is one of ground that driving has contradicted at least in part.
    fn is_driven(self, judgement: Judgement) -> bool {
        self.driven > 0 && judgement.cost < OBSTACLE_COST
    }
}

/// Number, costs, backings and [`Role::driven`] of the cells that resemble models, and number of those that were compared
/// and do not look like what was driven over.
type Sums = [u32; 5];

/// Judges cells by their surroundings. Cells in row order, `side` per row.
pub fn spread(cells: &mut [Option<Judgement>], roles: &[Role], side: usize) {
    let sums = running_sums(cells, roles, side);
    let stride = side + 1;
    for (at, (cell, &role)) in cells.iter_mut().zip(roles).enumerate() {
        let keeps = |own: &Judgement| own.backing == u8::MAX || !role.is_low;
        if role.part != Part::Takes && cell.as_ref().is_none_or(keeps) {
            continue;
        }
        let span = |at: usize| (at.saturating_sub(RADIUS), (at + RADIUS + 1).min(side));
        let ((left, right), (low, high)) = (span(at % side), span(at / side));
        let sum = |i: usize| {
            let corner = |row: usize, column: usize| sums[row * stride + column][i];
            corner(high, right) + corner(low, left) - corner(low, right) - corner(high, left)
        };
        let count = sum(0);
        if count < LEAST {
            continue;
        }
        let [cost, backing, driven, strays] = [1, 2, 3, 4].map(sum);
        let mean = |sum: u32| ((sum + count / 2) / count) as u8;
        match cell {
            Some(own) if role.part != Part::Takes => {
                let was_bumped = own.backing > 0 && own.cost >= OBSTACLE_COST;
                if 2 * driven >= 255 * count && !was_bumped && (role.is_driven(*own) || strays <= STRAYS) {
                    *own = Judgement { cost: own.cost.min(mean(cost)), backing: u8::MAX, ..*own };
                }
            }
            _ if 2 * backing >= 255 * count => {
                *cell = Some(Judgement {
                    cost: mean(cost),
                    confidence: SURE / 2,
                    backing: mean(backing),
                    model: 0,
                });
            }
            _ => {}
        }
    }
}

/// Sums over all rows and columns before each corner.
fn running_sums(cells: &[Option<Judgement>], roles: &[Role], side: usize) -> Vec<Sums> {
    let stride = side + 1;
    let mut sums = vec![Sums::default(); stride * (cells.len() / side + 1)];
    let rows = cells.chunks_exact(side).zip(roles.chunks_exact(side));
    for (row, (cells, roles)) in rows.enumerate() {
        let mut of_row = Sums::default();
        for (column, (cell, role)) in cells.iter().zip(roles).enumerate() {
            if let Some(cell) = cell {
                let gives = u32::from(role.part == Part::Gives);
                let is_stray = role.part != Part::Takes && !role.is_driven(*cell);
                let [cost, backing, driven] = [cell.cost, cell.backing, role.driven].map(u32::from);
                let counted = [gives, gives * cost, gives * backing, gives * driven, u32::from(is_stray)];
                of_row.iter_mut().zip(counted).for_each(|(sum, number)| *sum += number);
            }
            let above = sums[row * stride + column + 1];
            sums[(row + 1) * stride + column + 1] = [0, 1, 2, 3, 4].map(|i| above[i] + of_row[i]);
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
        Judgement { cost, confidence: SURE, backing, model: 0 }
    }

    fn role(part: Part, driven: u8) -> Role {
        Role { part, driven, is_low: true }
    }

    /// The rule, cell by cell.
    fn reference(cells: &[Option<Judgement>], roles: &[Role], at: usize) -> Option<Judgement> {
        let (x, y) = (at % SIDE, at / SIDE);
        let is_near =
            |other: usize| (other % SIDE).abs_diff(x) <= RADIUS && (other / SIDE).abs_diff(y) <= RADIUS;
        let near: Vec<(Judgement, Role)> = (0..cells.len())
            .filter(|&other| is_near(other))
            .filter_map(|other| Some((cells[other]?, roles[other])))
            .collect();
        let gives: Vec<_> = near.iter().filter(|(_, role)| role.part == Part::Gives).collect();
        let mean = |of: fn(&(Judgement, Role)) -> u8| {
            gives.iter().map(|cell| f64::from(of(cell))).sum::<f64>() / gives.len() as f64
        };
        let (cost, backing) = (mean(|(c, _)| c.cost), mean(|(c, _)| c.backing));
        let driven = mean(|(_, role)| role.driven);
        let looks_driven = |own: Judgement, role: Role| role.driven > 0 && own.cost < OBSTACLE_COST;
        let strays =
            near.iter().filter(|&&(own, role)| role.part != Part::Takes && !looks_driven(own, role)).count();
        let role = roles[at];
        if gives.len() < LEAST as usize {
            return cells[at];
        }
        match (role.part, cells[at]) {
            (Part::Takes, _) if backing >= 127.5 => Some(Judgement {
                cost: (cost + 0.5) as u8,
                confidence: SURE / 2,
                backing: (backing + 0.5) as u8,
                model: 0,
            }),
            (Part::Gives | Part::Keeps, Some(own))
                if driven >= 127.5
                    && role.is_low
                    && own.backing < 255
                    && (own.backing == 0 || own.cost < OBSTACLE_COST)
                    && (looks_driven(own, role) || strays <= STRAYS as usize) =>
            {
                Some(Judgement { cost: own.cost.min((cost + 0.5) as u8), backing: 255, ..own })
            }
            (_, own) => own,
        }
    }

    proptest! {
        #[test]
        fn the_surroundings_equal_those_of_the_rule(
            cells in prop::collection::vec(
                (0..9_u8, any::<u8>(), any::<u8>(), 0..6_usize, any::<u8>(), any::<bool>()),
                SIDE * SIDE,
            ),
            most_driven in 0..=255_u8,
        ) {
            let said: Vec<Option<Judgement>> = cells
                .iter()
                .map(|&(known, cost, backing, ..)| (known > 0).then(|| judgement(cost, backing)))
                .collect();
            let parts = [Part::Takes, Part::Gives, Part::Gives, Part::Gives, Part::Gives, Part::Keeps];
            let roles: Vec<Role> = cells
                .iter()
                .map(|&(.., part, driven, is_low)| Role { part: parts[part], driven: driven.max(most_driven), is_low })
                .collect();
            let mut spread_cells = said.clone();
            spread(&mut spread_cells, &roles, SIDE);
            for (at, cell) in spread_cells.iter().enumerate() {
                prop_assert_eq!(*cell, reference(&said, &roles, at), "cell {}", at);
            }
        }
    }

    #[test]
    fn a_thing_in_growth_stays_and_gaps_in_the_growth_are_filled() {
        let middle = SIDE * SIDE / 2;
        let mut cells = vec![Some(judgement(30, 255)); SIDE * SIDE];
        let mut roles = vec![role(Part::Gives, 255); SIDE * SIDE];
        (cells[middle], roles[middle]) = (Some(judgement(250, 0)), role(Part::Keeps, 0));
        roles[middle].is_low = false;
        (cells[middle + 1], roles[middle + 1]) = (None, role(Part::Takes, 0));
        (cells[middle + 2], roles[middle + 2]) = (Some(judgement(250, 0)), role(Part::Takes, 0));
        spread(&mut cells, &roles, SIDE);
        let filled = Some(Judgement { cost: 30, confidence: SURE / 2, backing: 255, model: 0 });
        assert_eq!(cells[middle..middle + 3], [Some(judgement(250, 0)), filled, filled]);
    }

    #[test]
    fn a_stray_stem_in_growth_is_growth_and_a_stone_or_what_was_bumped_into_is_not() {
        let middle = SIDE * SIDE / 2;
        let spread_with = |own: Judgement, size: usize| {
            let mut cells = vec![Some(judgement(30, 255)); SIDE * SIDE];
            let mut roles = vec![role(Part::Gives, 255); SIDE * SIDE];
            for at in middle - size / 2..middle + size.div_ceil(2) {
                (cells[at], roles[at]) = (Some(own), role(Part::Keeps, 0));
            }
            spread(&mut cells, &roles, SIDE);
            cells[middle].unwrap()
        };
        let stem = judgement(200, 0);
        let Judgement { cost, backing, .. } = spread_with(stem, 2);
        assert!(cost < 60 && backing == 255, "{cost} {backing}");
        assert_eq!(spread_with(stem, 5), stem, "a stone");
        assert_eq!(spread_with(judgement(200, 100), 1), judgement(200, 100), "bumped into");
        // Beside a way over ground, nothing was driven over that range had called an obstacle.
        let mut cells = vec![Some(judgement(0, 255)); SIDE * SIDE];
        let mut roles = vec![role(Part::Gives, 0); SIDE * SIDE];
        (cells[middle], roles[middle]) = (Some(stem), role(Part::Keeps, 0));
        spread(&mut cells, &roles, SIDE);
        assert_eq!(cells[middle], Some(stem));
    }

    #[test]
    fn what_experience_does_not_back_does_not_spread() {
        let mut cells = vec![Some(judgement(0, 100)); SIDE * SIDE];
        let mut roles = vec![role(Part::Gives, 0); SIDE * SIDE];
        (cells[60], roles[60]) = (None, role(Part::Takes, 0));
        spread(&mut cells, &roles, SIDE);
        assert_eq!(cells[60], None);
    }
}
