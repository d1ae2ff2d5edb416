//! Where the route of the run before lies, if that run began where this one did.
//!
//! The position estimates of two runs differ by about 2 m, most of all in the first seconds; a vehicle that is put back to
//! where it started stands within some decimetres of it. What is known so of the route becomes worse with the distance
//! from the start, because the headings of the two runs differ, too.

use super::WaypointGenerator;
use crate::proto::WaypointGeneratorParams;
use crate::route;
use rcs_geom::{DVec2, Pose};

/// Standard deviation of the difference between the headings of two runs, rad (2°), and of that between their position
/// estimates, m.
const HEADING_RAD: f64 = 0.035;
const ESTIMATES_M: f64 = 2.0;

/// How much the position estimates count at this distance from the common start, m, 0 to 1: the weighted mean with the
/// least variance.
fn share_of_estimates(from_start_m: f64) -> f64 {
    let by_heading_m = HEADING_RAD * from_start_m;
    let variance = by_heading_m * by_heading_m;
    variance / (variance + ESTIMATES_M * ESTIMATES_M)
}

impl WaypointGenerator {
    /// Whether the wheels have slipped in this run, so that its start may lie elsewhere in the local frame.
    pub(super) fn has_slipped(&self) -> bool {
        !self.slippery.is_empty() || self.barred.iter().any(|place| place.slipped)
    }

    /// The global frame of the run that drove the route in the local frame of this one, if both began at the same place.
    pub(super) fn placed_by_start(&mut self, params: &WaypointGeneratorParams) -> Option<Pose> {
        let (global_from_local, _) = self.global_from_local?;
        let (began, at) = self.way.start().map(|start| start.local).zip(self.position)?;
        if params.same_start_m <= 0.0 || self.has_slipped() {
            return None;
        }
        let origin = self.given.origin(params).ok()?;
        let before = route::start(self.route_before(params)?, &origin.0)?;
        let local_from_global = global_from_local.inverse();
        let shift = began.extend(0.0) - local_from_global * before.extend(0.0);
        if shift.truncate().length() > params.same_start_m {
            return None;
        }
        let from_start_m = (local_from_global * DVec2::from(at).extend(0.0)).truncate().distance(began);
        let shift = shift * (1.0 - share_of_estimates(from_start_m));
        Some(Pose::from_translation(shift) * local_from_global)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shortcut::WayPoint;
    use rcs_msg::Stamp;

    #[test]
    fn the_start_counts_alone_at_first_and_half_where_the_headings_make_as_much_difference_as_the_estimates()
    {
        assert_eq!(share_of_estimates(0.0), 0.0);
        assert!((share_of_estimates(ESTIMATES_M / HEADING_RAD) - 0.5).abs() < 1e-9);
        assert!(share_of_estimates(1000.0) > 0.99);
    }

    /// Where the route of a run that began 3 m north of the origin of the global frame begins in the local frame, for a run
    /// that has begun at (0, 0) of it, and is now this far east. Its estimate puts (0, 0) 2 m east of the origin.
    fn route_begins(same_start_m: f64, from_start_m: f64, slippery: &[(f64, f64)]) -> Option<DVec2> {
        let route = r#"{"format": 1, "zone": 18, "points": [
            {"eastingM": 300000.0, "northingM": 4000003.0}, {"eastingM": 300050.0, "northingM": 4000003.0}]}"#;
        let params = WaypointGeneratorParams {
            world: "[origin]\nzone = 18\neasting_m = 300000.0\nnorthing_m = 4000000.0\n".to_owned(),
            route: route.to_owned(),
            same_start_m,
            ..WaypointGeneratorParams::default()
        };
        let global_from_local = Pose::from_xy_yaw(2.0, 0.0, 0.0);
        let mut generator = WaypointGenerator {
            global_from_local: Some((global_from_local, Stamp(0))),
            position: Some((2.0 + from_start_m, 0.0)),
            slippery: slippery.to_vec(),
            ..WaypointGenerator::default()
        };
        generator.way.add(WayPoint { local: DVec2::ZERO, global: DVec2::new(9.0, 9.0) });
        let local_from_route = generator.placed_by_start(&params)?;
        Some((local_from_route * DVec2::new(0.0, 3.0).extend(0.0)).truncate())
    }

    #[test]
    fn the_route_begins_where_this_run_began_if_that_may_be_the_same_place() {
        assert_eq!(route_begins(5.0, 0.0, &[]), Some(DVec2::ZERO));
        // Halfway between the start and what the estimate says.
        let halfway = route_begins(5.0, ESTIMATES_M / HEADING_RAD, &[]).unwrap();
        assert!(halfway.distance(DVec2::new(-1.0, 1.5)) < 1e-9, "{halfway}");
        assert_eq!(route_begins(3.0, 0.0, &[]), None, "3.6 m away by the estimate");
        assert_eq!(route_begins(0.0, 0.0, &[]), None, "not asked for");
        assert_eq!(route_begins(5.0, 0.0, &[(4.0, 0.0)]), None, "the wheels have slipped since");
    }
}
