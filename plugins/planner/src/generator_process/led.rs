//! Where the planner of the near map is led by the path of the far one.

use super::{Ports, WaypointGenerator};
use crate::proto::WaypointGeneratorParams;
use rcs_geom::{DVec2, Pose};
use rcs_msg::Stamp;
use rcs_runtime::Cycle;

/// A path on the near map that is longer than the lookahead by this factor is a detour, and time for which the planner then
/// plans to a point half as far, s.
const DETOUR: f64 = 1.5;
const NEARER_S: f64 = 3.0;

impl WaypointGenerator {
    /// Whether the planner of the near map plans to a point of the far path: it may arrive there.
    pub(super) fn is_led(&self) -> bool {
        self.near_told != self.obeyed_goal()
    }

    /// What the planner of the near map plans to, local frame, m: the goal, or, if that is farther along the far path than
    /// the lookahead, the point of that path there.
    pub(super) fn near_goal(&self, goal: DVec2, global_from_local: &Pose, lookahead_m: f64) -> DVec2 {
        self.along_far_path(global_from_local, lookahead_m).unwrap_or(goal)
    }

    /// The point of the far path this far along it from the vehicle, local frame, m; `None` if the path ends before.
    pub(super) fn along_far_path(&self, global_from_local: &Pose, distance_m: f64) -> Option<DVec2> {
        let position =
            (global_from_local.inverse() * DVec2::from(*self.track.last()?).extend(0.0)).truncate();
        let far: Vec<DVec2> = self.far_path.iter().copied().map(DVec2::from).collect();
        let away_m = |at: usize| far[at].distance(position);
        let nearest = (0..far.len()).min_by(|&a, &b| away_m(a).total_cmp(&away_m(b)))?;
        let mut along_m = away_m(nearest);
        for pair in far[nearest..].windows(2) {
            along_m += pair[0].distance(pair[1]);
            if along_m >= distance_m {
                return Some(pair[1]);
            }
        }
        None
    }

    /// What the status says while there is a far path, and no track by which the vehicle's place on it is known.
    pub(super) fn unused_far_path(&self) -> &'static str {
        if self.far_path.is_empty() || !self.track.is_empty() {
            return "";
        }
        "; the far path is not used: no pose of the vehicle has come at the input global"
    }

    /// How far along the far path the planner of the near map plans, m.
    pub(super) fn lookahead_m(&self, params: &WaypointGeneratorParams) -> f64 {
        if self.nearer_until.is_some() { params.lookahead_m / 2.0 } else { params.lookahead_m }
    }

    /// Where the planner of the near map makes a detour to the point of the far path that it is led to, it is led to a
    /// nearer one: it does not know what lies beyond its map, and goes around a narrow way through what nobody has seen,
    /// although the far planner has weighed both.
    pub(super) fn look_for_a_detour(
        &mut self,
        ports: &Ports,
        params: &WaypointGeneratorParams,
        cx: &mut Cycle<'_>,
    ) {
        let now = cx.now();
        if self.nearer_until.is_some() {
            self.nearer_until = self.nearer_until.filter(|until| now < *until);
            return;
        }
        let Some(led) = self.near_told.filter(|_| self.is_led()) else { return };
        let plan = cx.latest(&ports.plan).filter(|plan| (plan.goal_x_m, plan.goal_y_m) == led);
        let length_m = plan.and_then(|plan| Some(plan.chosen.as_ref()?.length_m)).unwrap_or(0.0);
        if length_m > DETOUR * params.lookahead_m {
            self.nearer_until = Some(Stamp(now.0 + (NEARER_S * 1e9) as u64));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_near_planner_plans_to_a_point_of_the_far_path_or_to_the_goal() {
        let goal = DVec2::new(50.0, 0.0);
        let mut generator = WaypointGenerator { track: vec![(0.0, 0.0)], ..WaypointGenerator::default() };
        let near = |generator: &WaypointGenerator, goal| generator.near_goal(goal, &Pose::IDENTITY, 8.0);
        assert_eq!(near(&generator, goal), goal, "without a far path");
        // Back, to the left, and on.
        let corner = (0..=5).map(|step| (-f64::from(step), 0.0));
        generator.far_path = corner.chain((1..=20).map(|step| (-5.0, f64::from(step)))).collect();
        assert_eq!(near(&generator, goal), DVec2::new(-5.0, 3.0));
        generator.track.push((-5.0, 2.0));
        assert_eq!(near(&generator, goal), DVec2::new(-5.0, 10.0), "from the nearest point on");
        generator.track.push((-5.0, 15.0));
        assert_eq!(near(&generator, goal), goal, "the far path ends before");
        assert_eq!(generator.unused_far_path(), "");
        generator.track.clear();
        assert_eq!(near(&generator, goal), goal, "it is not known where the vehicle is on it");
        assert!(generator.unused_far_path().contains("the input global"));
    }
}
