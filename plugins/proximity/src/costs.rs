//! Lines and rectangles in a cost map of the vehicle's immediate surroundings: a small window of the world model's
//! cells.
//!
//! A cell is free (0), obstacle (250) or unknown (255). Where several readings of one message affect a cell, the
//! highest cost is kept.

use rcs_geom::DVec2;
use rcs_sense::{CELL_SIZE_M, CostGrid, GridFrame};

/// Cells per row of the window, at least: 8 m, more than what a small vehicle covers.
const SIDE: usize = 41;
/// Distance between sampled points along an edge, m; small enough to skip no cell.
const STEP_M: f64 = CELL_SIZE_M / 4.0;

/// An unknown window around a position, m, so large that it covers what lies within this distance of it, m.
pub fn around_within(place: DVec2, reach_m: f64) -> CostGrid {
    let cells = (reach_m / CELL_SIZE_M).ceil().max(0.0) as usize + 1;
    CostGrid::new(GridFrame::around(place, SIDE.max(2 * cells + 1), CELL_SIZE_M))
}

/// Marks the cells that a straight line touches.
pub fn mark_line(costs: &mut CostGrid, from: DVec2, to: DVec2, cost: u8) {
    let steps = (from.distance(to) / STEP_M).ceil().min(1e4);
    for step in 0..=steps as usize {
        let part = if steps > 0.0 { step as f64 / steps } else { 0.0 };
        costs.mark(from.lerp(to, part), cost);
    }
}

/// Marks the cells whose centres lie in a rectangle, given by a corner and its two sides from there, m.
pub fn mark_rectangle(costs: &mut CostGrid, corner: DVec2, along: DVec2, across: DVec2, cost: u8) {
    let (length, width) = (along.length(), across.length());
    if length * width == 0.0 {
        return;
    }
    let frame = *costs.frame();
    for row in 0..frame.side {
        for column in 0..frame.side {
            let middle = frame.middle(column, row);
            let place = middle - corner;
            let (x, y) = (place.dot(along) / length, place.dot(across) / width);
            if (0.0..=length).contains(&x) && (0.0..=width).contains(&y) {
                costs.mark(middle, cost);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_line_marks_every_cell_that_it_crosses_the_middle_of(
            from in prop::array::uniform2(-3.5..3.5_f64),
            to in prop::array::uniform2(-3.5..3.5_f64),
        ) {
            let (from, to) = (DVec2::from_array(from), DVec2::from_array(to));
            let mut costs = around_within(DVec2::ZERO, 4.0);
            mark_line(&mut costs, from, to, 250);
            for i in 0..=1000 {
                let place = from.lerp(to, f64::from(i) / 1000.0);
                let inside_of_cell = (place / CELL_SIZE_M - (place / CELL_SIZE_M).floor() - 0.5).abs();
                // Cells that the line touches only at a corner may be left out.
                if inside_of_cell.max_element() < 0.3 {
                    prop_assert_eq!(costs.at(place), Some(250));
                }
            }
        }
    }

    #[test]
    fn the_highest_cost_of_a_cell_counts_in_any_order() {
        for costs_in_order in [[0, 250], [250, 0]] {
            let mut costs = around_within(DVec2::new(100.0, -50.0), 1.0);
            for cost in costs_in_order {
                costs.mark(DVec2::new(100.1, -50.1), cost);
            }
            assert_eq!(costs.at(DVec2::new(100.1, -50.1)), Some(250));
            assert_eq!(costs.at(DVec2::new(100.3, -50.1)), None);
        }
    }

    #[test]
    fn what_lies_outside_of_the_window_is_left_out() {
        let mut costs = around_within(DVec2::ZERO, 1.0);
        let before = costs.clone();
        costs.mark(DVec2::new(5.0, 0.0), 250);
        costs.mark(DVec2::new(f64::INFINITY, f64::NEG_INFINITY), 250);
        assert_eq!(costs, before);
    }
}
