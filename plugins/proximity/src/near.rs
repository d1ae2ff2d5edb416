//! Costs of the cells around the vehicle from bumper and infrared sensors.

use crate::costs::{around_within, mark_line, mark_rectangle};
use rcs_geom::{DVec2, DVec3, Pose};
use rcs_sense::CostGrid;
use rcs_world::MAX_COST;

/// Greatest reach of a map of infrared readings, m: what they say beyond it is left out.
const MOST_REACH_M: f64 = 40.0;

/// Dimensions of the bumper and the body in the vehicle frame, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Body {
    /// x of the bumper's face.
    pub bumper_x_m: f64,
    /// Width of the bumper, symmetric about the x axis.
    pub bumper_width_m: f64,
    /// Depth of the area in front of the bumper that a hit marks.
    pub bumper_depth_m: f64,
    /// x of the rear end.
    pub rear_x_m: f64,
    /// Width of the ground under the vehicle that is known to be free.
    pub width_m: f64,
}

impl Body {
    /// Unknown cells around the vehicle, as far as the bumper, what a hit marks ahead of it, and the rear end.
    fn around(&self, map_from_vehicle: &Pose) -> CostGrid {
        let front_m = self.bumper_x_m.abs() + self.bumper_depth_m;
        let half_width_m = 0.5 * self.bumper_width_m.max(self.width_m);
        let reach_m = libm::hypot(front_m.max(self.rear_x_m.abs()), half_width_m);
        around_within(map_from_vehicle.translation.truncate(), reach_m)
    }
}

/// One checked infrared reading, in the frame of the map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Pose of the sensor, which measures along its x axis.
    pub map_from_sensor: Pose,
    /// Distance to what it measures, m; `None` where nothing is in range.
    pub range_m: Option<f64>,
    /// Maximum range, m.
    pub max_range_m: f64,
    /// Full angle of the cone, rad.
    pub cone_rad: f64,
}

impl Ray {
    /// Distance from the sensor up to which the ground is free, m.
    fn free_m(&self, rules: &RayRules) -> f64 {
        (self.range_m.unwrap_or(self.max_range_m) * rules.free_fraction).min(MOST_REACH_M)
    }

    /// Distance from a position up to which it says something, m.
    fn reach_m(&self, from: DVec2, rules: &RayRules) -> f64 {
        let seen_m = self.range_m.map_or(0.0, |range_m| range_m + rules.noise_m);
        self.map_from_sensor.translation.truncate().distance(from) + self.free_m(rules).max(seen_m)
    }
}

/// How infrared readings become costs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayRules {
    /// Cost of a measured obstacle, 0–250.
    pub cost: u8,
    /// Share of the measured range that is marked free.
    pub free_fraction: f64,
    /// Obstacle cells extend this far before and behind the measured range, m.
    pub noise_m: f64,
}

/// Cost of ground on which the wheels slip over some metres: a planner goes around it where there is another way.
pub const SLIPPERY_COST: u8 = 100;

/// Marks the ground under a vehicle whose wheels slipped there over some metres.
pub fn slippery_costs(map_from_vehicle: &Pose, body: &Body) -> CostGrid {
    let mut costs = body.around(map_from_vehicle);
    mark_body(&mut costs, map_from_vehicle, body, SLIPPERY_COST);
    costs
}

fn mark_body(costs: &mut CostGrid, map_from_vehicle: &Pose, body: &Body, cost: u8) {
    let place = |x: f64, y: f64| (*map_from_vehicle * DVec3::new(x, y, 0.0)).truncate();
    let half = body.width_m / 2.0;
    let corner = place(body.rear_x_m, -half);
    let along = place(body.bumper_x_m, -half) - corner;
    let across = place(body.rear_x_m, half) - corner;
    mark_rectangle(costs, corner, along, across, cost);
}

/// Marks the ground under the vehicle as free if it drives there without slipping, and the cells at pressed switches as
/// obstacles.
pub fn bumper_costs(map_from_vehicle: &Pose, body: &Body, left: bool, right: bool, drives: bool) -> CostGrid {
    let place = |x: f64, y: f64| (*map_from_vehicle * DVec3::new(x, y, 0.0)).truncate();
    let mut costs = body.around(map_from_vehicle);
    if drives {
        mark_body(&mut costs, map_from_vehicle, body, 0);
    }
    let reach = body.bumper_width_m / 2.0;
    for (is_pressed, from_m, to_m) in [(left, 0.0, reach), (right, -reach, 0.0)] {
        if !is_pressed {
            continue;
        }
        // The hit is somewhere on the switch's half: mark the whole half, to the depth uncertainty.
        let lines = (body.bumper_depth_m / 0.05).ceil().clamp(1.0, 100.0) as u32;
        for line in 0..=lines {
            let x = body.bumper_x_m + body.bumper_depth_m * f64::from(line) / f64::from(lines);
            mark_line(&mut costs, place(x, from_m), place(x, to_m), MAX_COST);
        }
    }
    costs
}

/// Marks the cells along each cone as free up to the measured range, and those at that range as obstacles, in a window
/// around a position, m, that has room for all of them within 40 m.
pub fn infrared_costs(around: DVec2, rays: &[Ray], rules: &RayRules) -> CostGrid {
    let reach_m = rays.iter().map(|ray| ray.reach_m(around, rules)).fold(0.0, f64::max);
    let mut costs = around_within(around, reach_m.min(MOST_REACH_M));
    for ray in rays {
        let at = |range: f64, angle: f64| {
            let (sin, cos) = libm::sincos(angle);
            (ray.map_from_sensor * DVec3::new(range * cos, range * sin, 0.0)).truncate()
        };
        let half = ray.cone_rad / 2.0;
        let free_m = ray.free_m(rules);
        // Rays half a cell apart at maximum range skip no cell.
        let spread = (ray.cone_rad * ray.max_range_m / 0.1).ceil().clamp(2.0, 200.0) as u32;
        for side in 0..=spread {
            let angle = -half + ray.cone_rad * f64::from(side) / f64::from(spread);
            mark_line(&mut costs, at(0.0, angle), at(free_m, angle), 0);
            if let Some(range_m) = ray.range_m {
                let near = (range_m - rules.noise_m).max(0.0);
                mark_line(&mut costs, at(near, angle), at(range_m + rules.noise_m, angle), rules.cost);
            }
        }
    }
    costs
}

#[cfg(test)]
mod tests {
    use super::*;

    const BODY: Body =
        Body { bumper_x_m: 0.24, bumper_width_m: 0.66, bumper_depth_m: 0.2, rear_x_m: -0.72, width_m: 0.6 };
    const RULES: RayRules = RayRules { cost: 250, free_fraction: 0.9, noise_m: 0.05 };

    #[test]
    fn a_hit_marks_the_cells_at_the_pressed_half_of_the_bumper() {
        // The vehicle faces north at (10, 20).
        let pose = Pose::from_xy_yaw(10.0, 20.0, std::f64::consts::FRAC_PI_2);
        let left = bumper_costs(&pose, &BODY, true, false, true);
        assert_eq!(left.at(DVec2::new(9.85, 20.3)), Some(250), "left of the middle is west");
        assert_eq!(left.at(DVec2::new(10.25, 20.5)), None);
        assert_eq!(left.at(DVec2::new(10.0, 19.7)), Some(0), "under the vehicle");
        let right = bumper_costs(&pose, &BODY, false, true, true);
        assert_eq!((right.at(DVec2::new(10.15, 20.3)), right.at(DVec2::new(9.75, 20.5))), (Some(250), None));
        let both = bumper_costs(&pose, &BODY, true, true, true);
        assert!(both.at(DVec2::new(9.85, 20.3)).is_some() && both.at(DVec2::new(10.15, 20.3)).is_some());
    }

    #[test]
    fn a_hit_of_a_bumper_far_ahead_is_marked_and_the_ground_under_a_long_vehicle_is_free() {
        let body = Body { bumper_x_m: 10.0, rear_x_m: -6.0, ..BODY };
        for tenth in 0..63 {
            let pose = Pose::from_xy_yaw(-3.3, 4.7, f64::from(tenth) * 0.1);
            let at = |x_m: f64, y_m: f64| (pose * DVec3::new(x_m, y_m, 0.0)).truncate();
            let costs = bumper_costs(&pose, &body, true, false, true);
            assert!(costs.count_from(250) > 2, "{}", costs.count_from(250));
            assert_eq!((costs.at(at(9.0, 0.0)), costs.at(at(-5.7, 0.0))), (Some(0), Some(0)));
        }
        let of = |body: &Body| body.around(&Pose::IDENTITY).frame().side;
        assert_eq!((of(&BODY), of(&body)), (41, 107));
    }

    #[test]
    fn a_vehicle_whose_wheels_slip_does_not_know_what_is_under_it() {
        let pose = Pose::from_xy_yaw(10.0, 20.0, 0.3);
        let slips = bumper_costs(&pose, &BODY, true, false, false);
        assert_eq!(slips.count_from(0), slips.count_from(250));
        assert!(slips.count_from(250) > 0, "a hit is still a hit");
    }

    #[test]
    fn ground_on_which_the_wheels_slipped_is_dear_under_the_vehicle_alone() {
        let costs = slippery_costs(&Pose::from_xy_yaw(10.0, 20.0, std::f64::consts::FRAC_PI_2), &BODY);
        assert_eq!(costs.at(DVec2::new(10.1, 19.7)), Some(SLIPPERY_COST));
        assert_eq!((costs.at(DVec2::new(10.1, 20.5)), costs.at(DVec2::new(10.7, 19.7))), (None, None));
        assert_eq!(costs.count_from(0), costs.count_from(SLIPPERY_COST));
    }

    #[test]
    fn without_a_hit_the_ground_under_the_vehicle_is_free_and_nothing_else_is_told() {
        for tenth in 0..63 {
            let pose = Pose::from_xy_yaw(-3.3, 4.7, f64::from(tenth) * 0.1);
            let costs = bumper_costs(&pose, &BODY, false, false, true);
            assert_eq!(costs.count_from(1), 0);
            // 0.96 m by 0.6 m are 14.4 cells; the number of centres inside depends on the angle.
            assert!((10..=20).contains(&costs.count_from(0)), "{}", costs.count_from(0));
        }
    }

    fn ray(range_m: Option<f64>) -> Ray {
        let map_from_sensor = Pose::from_xy_yaw(0.1, 0.1, 0.0);
        Ray { map_from_sensor, range_m, max_range_m: 1.5, cone_rad: 0.2 }
    }

    #[test]
    fn a_cone_is_free_before_what_it_sees_and_unknown_behind() {
        let costs = infrared_costs(DVec2::ZERO, &[ray(Some(1.0))], &RULES);
        assert_eq!(costs.at(DVec2::new(0.5, 0.1)), Some(0));
        assert_eq!(costs.at(DVec2::new(1.1, 0.1)), Some(250));
        assert_eq!(costs.at(DVec2::new(1.5, 0.1)), None);
        assert_eq!(costs.at(DVec2::new(0.5, 0.5)), None);
    }

    #[test]
    fn a_cone_that_sees_nothing_is_free_and_an_obstacle_of_one_beats_free_of_another() {
        let free = infrared_costs(DVec2::ZERO, &[ray(None)], &RULES);
        assert_eq!(free.count_from(1), 0);
        assert_eq!(free.at(DVec2::new(1.3, 0.1)), Some(0));
        assert_eq!(free.at(DVec2::new(1.7, 0.1)), None);
        let both = infrared_costs(DVec2::ZERO, &[ray(Some(1.0)), ray(None)], &RULES);
        assert_eq!(both.at(DVec2::new(1.1, 0.1)), Some(250));
    }

    #[test]
    fn the_map_reaches_as_far_as_the_sensors_see_up_to_40_m() {
        let costs_of = |max_range_m: f64, range_m: Option<f64>| {
            infrared_costs(DVec2::ZERO, &[ray(None), Ray { max_range_m, ..ray(range_m) }], &RULES)
        };
        let seen = costs_of(8.0, Some(6.0));
        assert_eq!((seen.at(DVec2::new(6.1, 0.1)), seen.at(DVec2::new(5.0, 0.1))), (Some(250), Some(0)));
        let far = costs_of(1e9, None);
        assert_eq!(far.at(DVec2::new(39.9, 0.1)), Some(0));
        assert_eq!((costs_of(1.5, Some(1.5)).frame().side, far.frame().side), (41, 403));
    }
}
