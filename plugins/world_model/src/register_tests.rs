//! Maps with an L of obstacles on ground.

use super::*;
use crate::memory::tests::map;

fn seen(map: &Rectangle) -> Seen {
    Seen::of(map, &[DVec2::ZERO], 8.0)
}

#[test]
fn a_map_that_lies_beside_the_ground_is_moved_onto_it() {
    let sensed = map(DVec2::new(1.2, -0.8));
    for moved in [DVec2::ZERO, DVec2::new(1.6, -2.0), DVec2::new(-2.8, 1.2)] {
        let remembered = map(DVec2::new(1.2, -0.8) - moved);
        let fit =
            Remembered::new(remembered.clone()).register(&seen(&sensed), DVec2::ZERO, 4.0, 0.02, 30).unwrap();
        // Edges may differ by a cell.
        assert!((fit.moved - moved).abs().max_element() <= 0.41, "{fit:?} for {moved}");
        assert!(fit.agreement > 0.9, "{fit:?}");
    }
}

#[test]
fn a_map_of_small_cells_is_moved_by_several_at_a_time() {
    let wall = |corner: DVec2| {
        let mut map = Rectangle::around(&[DVec2::ZERO], 8.0, 0.02).unwrap();
        for index in 0..map.costs.len() {
            let from_corner = map.centre(index) - corner;
            let is_wall = from_corner.min_element() >= 0.0 && from_corner.min_element() < 1.0;
            map.costs[index] = if is_wall { 250 } else { 0 };
        }
        map
    };
    let moved = DVec2::new(0.8, -0.4);
    let seen = seen(&wall(DVec2::ZERO));
    assert!(seen.obstacles.len() <= MOST_COMPARED && seen.ground.len() <= MOST_COMPARED);
    let fit = Remembered::new(wall(-moved)).register(&seen, DVec2::ZERO, 2.0, 0.02, 30).unwrap();
    assert!(fit.moved.abs_diff_eq(moved, 1e-9) && fit.agreement > 0.99, "{fit:?}");
}

#[test]
fn a_registered_map_of_cells_that_are_larger_than_it_is_moved_at_a_time_is_moved_by_one() {
    let wall = |corner: DVec2| {
        let mut map = Rectangle::around(&[DVec2::ZERO], 10.0, 0.5).unwrap();
        for index in 0..map.costs.len() {
            let from_corner = map.centre(index) - corner;
            map.costs[index] = if (0.0..1.0).contains(&from_corner.min_element()) { 250 } else { 0 };
        }
        map
    };
    let moved = DVec2::new(0.5, 0.0);
    let (seen, remembered) = (seen(&wall(DVec2::ZERO)), Remembered::new(wall(-moved)));
    let placed = Placed { global_from_local: Pose::IDENTITY, fit: Fit::default() };
    let placed = placed.followed(&remembered, &seen, DVec2::ZERO, &Pose::IDENTITY, 30);
    assert!(placed.fit.moved.abs_diff_eq(moved, 1e-9), "{:?}", placed.fit);
}

#[test]
fn of_two_parallel_walls_one_does_not_lie_on_the_other() {
    // A corridor 2.4 m wide that is remembered only as far as its walls.
    let corridor = |south: f64| {
        let mut map = map(DVec2::splat(100.0));
        for index in 0..map.costs.len() {
            let across = map.centre(index).y - south;
            let is_wall = (0.0..0.8).contains(&across) || (3.2..4.0).contains(&across);
            map.costs[index] = match () {
                () if is_wall => 250,
                () if (0.0..4.0).contains(&across) => 0,
                () => UNKNOWN_COST,
            };
        }
        map
    };
    let (sensed, remembered) = (corridor(-2.0), corridor(-0.8));
    let seen = seen(&sensed);
    // The north wall of one on the south wall of the other contradicts nothing.
    let aliased = Remembered::new(remembered.clone()).compare(&seen, DVec2::new(0.0, -4.4));
    assert!(aliased.agreement > 0.99 && aliased.support < 0.51, "{aliased:?}");
    let fit =
        Remembered::new(remembered.clone()).register(&seen, DVec2::new(0.0, -3.6), 4.0, 0.05, 30).unwrap();
    assert!(fit.moved.abs_diff_eq(DVec2::new(0.0, -1.2), 0.41) && fit.support > 0.9, "{fit:?}");
}

#[test]
fn a_map_of_another_place_does_not_fit_and_open_ground_tells_nothing() {
    let sensed = map(DVec2::new(1.2, -0.8));
    // Posts in rows, as many obstacle cells as the walls.
    let mut posts = map(DVec2::splat(100.0));
    for index in 0..posts.costs.len() {
        let (row, column) = (index / posts.columns, index % posts.columns);
        posts.costs[index] = if row % 6 == 0 && column % 6 == 0 { 250 } else { 0 };
    }
    let fit = Remembered::new(posts.clone()).register(&seen(&sensed), DVec2::ZERO, 4.0, 0.02, 30).unwrap();
    assert!(fit.agreement < 0.5, "{fit:?}");
    let open = map(DVec2::splat(100.0));
    assert_eq!(Remembered::new(open.clone()).register(&seen(&open), DVec2::ZERO, 4.0, 0.02, 30), None);
}

/// [`Remembered::compare`] by a loop over all pairs of cells.
fn plainly(remembered: &Rectangle, sensed: &Rectangle, moved: DVec2) -> (usize, usize) {
    let near = |map: &Rectangle, at: DVec2| {
        (0..map.costs.len()).any(|index| {
            map.costs[index] == 250 && (map.centre(index) - at).abs().max_element() < 1.5 * map.cell_size_m
        })
    };
    let (mut agree, mut differ) = (0, 0);
    for index in 0..sensed.costs.len() {
        let at = sensed.centre(index);
        let known = remembered.at(at - moved);
        if at.length() > 8.0 {
            continue;
        }
        if sensed.costs[index] != 250 {
            differ += usize::from(!near(sensed, at) && known == 250);
        } else if near(remembered, at - moved) {
            agree += 1;
        } else {
            differ += usize::from(known != UNKNOWN_COST);
        }
    }
    (agree, differ)
}

#[test]
fn agreement_is_counted_as_a_plain_loop_counts_it() {
    let (sensed, mut remembered) = (map(DVec2::new(1.2, -0.8)), map(DVec2::new(0.4, 0.4)));
    // The south-west is unknown.
    for index in 0..remembered.costs.len() {
        if remembered.centre(index).max_element() < -1.0 {
            remembered.costs[index] = UNKNOWN_COST;
        }
    }
    let (seen, prepared) = (seen(&sensed), Remembered::new(remembered.clone()));
    let mut best = Fit::default();
    for shift in [[0, 0], [1, -1], [2, -3], [-3, 2], [3, 3]] {
        let moved = DVec2::from(shift.map(f64::from)) * 0.4;
        let (agree, differ) = plainly(&remembered, &sensed, moved);
        let fit = prepared.compare(&seen, moved);
        assert_eq!((fit.compared, fit.agreement), (agree + differ, agree as f64 / (agree + differ) as f64));
        // The walls lie on each other at one of them.
        assert!(agree > 5 && (differ > 5) == (shift != [2, -3]), "{agree} {differ} at {shift:?}");
        best = if fit.support > best.support { fit } else { best };
    }
    // Of all shifts, the best one is found, as it is by comparing at each.
    let found = prepared.register(&seen, DVec2::ZERO, 1.3, 0.0, 30).unwrap();
    assert!(found.support >= best.support && found == prepared.compare(&seen, found.moved), "{found:?}");
}

#[test]
fn a_map_that_lies_farther_away_than_cells_can_be_counted_is_not_compared() {
    let sensed = map(DVec2::new(1.2, -0.8));
    for corner in [DVec2::splat(1e10), DVec2::splat(-1e10), DVec2::new(-1e10, 1e10)] {
        let remembered = Remembered::new(Rectangle { corner, ..sensed.clone() });
        assert_eq!(remembered.register(&seen(&sensed), DVec2::ZERO, 4.0, 0.02, 30), None, "{corner}");
        assert_eq!(remembered.compare(&seen(&sensed), DVec2::ZERO).compared, 0, "{corner}");
    }
}
