//! Driving around a goal that the vehicle has reached by its own estimate, which may be metres away from the truth.
//!
//! A course, a person or a beacon says that the goal is reached; while the program still runs, it is not. So the vehicle
//! drives around the place where it believes the goal to be, near it and then farther away, and then stands there.

use rcs_geom::DVec2;
use rcs_msg::Stamp;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// The circles: number of places, and radius in relation to the parameter. Where the goal counts as reached within a little
/// more than that distance, as on the bundled courses, they leave no gap between them.
const CIRCLES: [(u32, f64); 2] = [(6, 1.0), (12, 3.0)];
/// Number of places on all circles.
const PLACES: u32 = CIRCLES[0].0 + CIRCLES[1].0;
/// Longest time for driving to one of them, s: it may lie inside of an obstacle.
const LONGEST_S: f64 = 8.0;

/// How far the vehicle has come around its goal.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct AroundGoal {
    /// Direction of the first place from the goal, counter-clockwise from east, rad.
    from_rad: f64,
    /// The place that it drives to; [`PLACES`] for the goal again, where it stays.
    place: u32,
    /// Since when.
    since: Stamp,
}

impl AroundGoal {
    /// From its first arrival at the goal, with this heading, rad.
    pub fn begin(heading_rad: f64, now: Stamp) -> AroundGoal {
        AroundGoal { from_rad: heading_rad, place: 0, since: now }
    }

    /// Goes on to the next place if the vehicle has arrived at this one, or does not get there. Whether it does.
    pub fn go_on(&mut self, arrived: bool, now: Stamp) -> bool {
        let is_over = self.place == PLACES;
        let goes_on = !is_over && (arrived || now.seconds_since(self.since) > LONGEST_S);
        if goes_on {
            (self.place, self.since) = (self.place + 1, now);
        }
        goes_on
    }

    /// Where it drives to: a place around the goal, or the goal itself in the end; the first circle has this radius, m.
    pub fn target(&self, goal: DVec2, distance_m: f64) -> DVec2 {
        let mut at = self.place;
        for (places, radius) in CIRCLES {
            if at < places {
                let (sin, cos) = libm::sincos(self.from_rad + TAU * f64::from(at) / f64::from(places));
                return goal + DVec2::new(cos, sin) * distance_m * radius;
            }
            at -= places;
        }
        goal
    }

    /// What the status says of it.
    pub fn note(&self) -> String {
        match self.place {
            PLACES => "; it has driven around the goal".to_owned(),
            place => format!("; at the goal, drives around it: {} of {PLACES}", place + 1),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_visits_each_place_of_both_circles_and_ends_at_the_goal() {
        let goal = DVec2::new(5.0, 6.0);
        let mut around = AroundGoal::begin(0.0, Stamp(0));
        let mut places = vec![around.target(goal, 2.0)];
        let mut now = Stamp(0);
        loop {
            assert!(!around.go_on(false, now), "it has not arrived");
            // It does not get to the third one.
            let arrived = places.len() != 3;
            now = Stamp(now.0 + if arrived { 1_000_000_000 } else { 9_000_000_000 });
            if !around.go_on(arrived, now) {
                break;
            }
            places.push(around.target(goal, 2.0));
        }
        assert_eq!((places.len(), places[18]), (19, goal));
        assert!(places[0].distance(DVec2::new(7.0, 6.0)) < 1e-9);
        assert!(places[6].distance(DVec2::new(11.0, 6.0)) < 1e-9);
        for (circle, radius_m) in [(&places[..6], 2.0), (&places[6..18], 6.0)] {
            let step_m = circle[0].distance(circle[1]);
            for pair in circle.windows(2) {
                assert!((pair[0].distance(pair[1]) - step_m).abs() < 1e-9 && step_m < 3.2);
                assert!((pair[1].distance(goal) - radius_m).abs() < 1e-9);
            }
        }
        assert!(around.note().contains("has driven around"));
    }
}
