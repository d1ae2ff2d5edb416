//! Speed and turn rate of the follower: along an arc, and of the actions of modes that follow none.

use crate::arcs::{self, Arc, Motion, Scored, Weights};
use crate::costs::MAX_COST;
use crate::modes::Mode;
use crate::proto::WaypointFollowerParams;
use crate::settings::rules_of;
use rand_core::RngCore;
use rcs_geom::{DVec3, Pose};
use rcs_msg::Stamp;
use rcs_msg::rcs::{ScoredArc, VehicleStatus, scored_arc};
use rcs_sense::pose_message;

/// How fast the vehicle is driven: the parameters, changed by the mode.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Style {
    max_speed_mps: f64,
    min_speed_mps: f64,
    backward_speed_mps: f64,
    max_yaw_rate_radps: f64,
    /// Turn rate of the actions REVERSE and SHAKE.
    mode_yaw_rate_radps: f64,
    turns_on_the_spot: bool,
    braking_mps2: f64,
    stop_margin_m: f64,
    cost_slowdown: f64,
    /// Cost of the best class of terrain, as a share of the highest cost.
    clear_cost: f64,
}

impl Style {
    pub(crate) fn new(params: &WaypointFollowerParams, mode: Option<&Mode>) -> Style {
        let limit_mps = params.max_speed_mps;
        let max_speed_mps = mode.and_then(|mode| mode.max_speed_mps).unwrap_or(limit_mps).min(limit_mps);
        let min_speed_mps = mode.and_then(|mode| mode.min_speed_mps).unwrap_or(params.min_speed_mps);
        Style {
            max_speed_mps,
            min_speed_mps: min_speed_mps.min(max_speed_mps),
            backward_speed_mps: params.backward_speed_mps.min(max_speed_mps),
            max_yaw_rate_radps: params.max_yaw_rate_radps,
            mode_yaw_rate_radps: mode
                .map_or(0.0, |mode| mode.yaw_rate_radps.abs())
                .min(params.max_yaw_rate_radps),
            turns_on_the_spot: params.turns_on_the_spot,
            braking_mps2: params.braking_mps2,
            stop_margin_m: params.stop_margin_m,
            cost_slowdown: params.cost_slowdown,
            clear_cost: rules_of(params.costs.as_ref())
                .table
                .first()
                .map_or(0.0, |&(_, cost)| f64::from(cost) / f64::from(MAX_COST)),
        }
    }

    /// The same within the limits that the vehicle states: it refuses commands beyond them.
    pub(crate) fn within(self, vehicle: &VehicleStatus) -> Style {
        // 0 where the vehicle states no limit.
        let least = |limit: f64, stated: f64| if stated > 0.0 { limit.min(stated) } else { limit };
        let speed_mps = |limit_mps: f64| least(limit_mps, vehicle.max_speed_mps);
        let yaw_rate_radps = |limit_radps: f64| least(limit_radps, vehicle.max_yaw_rate_radps);
        Style {
            max_speed_mps: speed_mps(self.max_speed_mps),
            min_speed_mps: speed_mps(self.min_speed_mps),
            backward_speed_mps: speed_mps(self.backward_speed_mps),
            max_yaw_rate_radps: yaw_rate_radps(self.max_yaw_rate_radps),
            mode_yaw_rate_radps: yaw_rate_radps(self.mode_yaw_rate_radps),
            ..self
        }
    }

    /// Speed from which the vehicle can stop on a free way, m/s.
    fn stops_mps(&self, free_m: f64) -> f64 {
        libm::sqrt(2.0 * self.braking_mps2 * (free_m - self.stop_margin_m).max(0.0))
    }
}

/// Speed along an arc, m/s, and turn rate, rad/s.
pub(crate) fn speeds(chosen: &Scored, style: &Style) -> [f64; 2] {
    let Arc { motion, curvature_per_m } = chosen.arc;
    let (least, turn) = (style.min_speed_mps, style.max_yaw_rate_radps);
    match motion {
        Motion::TurnLeft => [0.0, turn],
        Motion::TurnRight => [0.0, -turn],
        Motion::Forward | Motion::Backward => {
            let (side, limit_mps) = match motion {
                Motion::Backward => (-1.0, style.backward_speed_mps),
                _ => (1.0, style.max_speed_mps),
            };
            let stops = style.stops_mps(chosen.free_m);
            let bends = turn / curvature_per_m.abs().max(1e-6);
            let dear = ((chosen.mean_cost - style.clear_cost) / (1.0 - style.clear_cost)).max(0.0);
            let slowed = limit_mps * (1.0 - style.cost_slowdown * dear);
            let speed_mps = side * slowed.min(stops).min(bends).max(least.min(bends).min(limit_mps));
            // The product can exceed the limit by a rounding step, and the vehicle refuses such a command.
            [speed_mps, (curvature_per_m * speed_mps).clamp(-turn, turn)]
        }
    }
}

/// Distance that the action REVERSE drives straight back on the vehicle's own track where no arc is free, m.
pub(crate) const OWN_TRACK_M: f64 = 0.6;

/// The action REVERSE: on the straight arc backward, or a bent one if that is not free. On the straight one it turns to a side
/// that alternates with the number of the mode, no more than a bent arc to that side that is free, too. If no arc is free,
/// straight back as slowly as it touches things, where the vehicle's own track is free; else it stands.
pub(crate) fn reversed(
    scored: &[Scored],
    style: &Style,
    number: u32,
    is_own_track_free: impl FnOnce() -> bool,
) -> (Option<usize>, [f64; 2]) {
    let is_free_back = |scored: &Scored| scored.arc.motion == Motion::Backward && scored.open;
    let Some(at) = scored.iter().position(is_free_back) else {
        let speed_mps = if is_own_track_free() { -style.max_speed_mps.min(TOUCH_MPS) } else { 0.0 };
        return (None, [speed_mps, 0.0]);
    };
    let side = if number.is_multiple_of(2) { 1.0 } else { -1.0 };
    let back_mps = |free_m: f64| -style.backward_speed_mps.min(style.stops_mps(free_m));
    let speed_mps = back_mps(scored[at].free_m);
    let bend = scored[at].arc.curvature_per_m;
    if bend != 0.0 {
        let turn = style.max_yaw_rate_radps;
        let speed_mps = speed_mps.max(-turn / bend.abs());
        return (Some(at), [speed_mps, (bend * speed_mps).clamp(-turn, turn)]);
    }
    // A turn leads the tail aside, between the straight arc and a bent one: both have to be free.
    let wanted_radps = side * style.mode_yaw_rate_radps;
    let turn_radps = |scored: &Scored| scored.arc.curvature_per_m * speed_mps;
    let off = |at: usize| (turn_radps(&scored[at]) - wanted_radps).abs();
    let bent = (0..scored.len())
        .filter(|&at| is_free_back(&scored[at]) && turn_radps(&scored[at]) * wanted_radps > 0.0)
        .min_by(|&a, &b| off(a).total_cmp(&off(b)));
    let Some(bent) = bent else { return (Some(at), [speed_mps, 0.0]) };
    let speed_mps = back_mps(scored[at].free_m.min(scored[bent].free_m));
    let most_radps = (scored[bent].arc.curvature_per_m * speed_mps).abs();
    (Some(bent), [speed_mps, wanted_radps.clamp(-most_radps, most_radps)])
}

/// Duration of driving backward at the beginning of the action SHAKE, s: on a slope the vehicle slides down to where its
/// wheels grip.
const SHAKE_BACKWARD_S: f64 = 2.5;

/// On ground that is steeper than this, rad, a vehicle that shakes itself free turns until one of its ends points downhill
/// within this angle, rad, and drives down.
const STEEP_RAD: f64 = 0.1;
const DOWNHILL_RAD: f64 = 0.7;

/// The action SHAKE: backward, then at random speeds and turn rates for half a second each. On a slope it is
/// downhill instead, because a slope takes most of the grip of a vehicle that stands across it. That is so in two of four
/// modes, by their `number`, also where every second one has a different action.
pub(crate) fn shaken(
    shakes: &mut Option<([f64; 2], Stamp)>,
    style: &Style,
    vehicle: &Pose,
    (number, since_s): (u32, f64),
    now: Stamp,
    rng: &mut impl RngCore,
) -> [f64; 2] {
    if since_s < SHAKE_BACKWARD_S {
        return [-style.max_speed_mps, 0.0];
    }
    if let Some(order) = downhill(vehicle, style).filter(|_| (number / 2).is_multiple_of(2)) {
        return order;
    }
    if let Some((order, since)) = shakes
        && now.seconds_since(*since) < 0.5
    {
        return *order;
    }
    let mut drawn = || f64::from(rng.next_u32()) / f64::from(u32::MAX) * 2.0 - 1.0;
    let order = [drawn() * style.max_speed_mps, drawn() * style.mode_yaw_rate_radps];
    *shakes = Some((order, now));
    order
}

/// What the action SHAKE does, m/s and rad/s, for an order of [`shaken`] and the speed that [`careful`] leaves of it: where the
/// way downhill is not free, the vehicle turns on the spot, if it can, until another one is, and does not go back uphill, where
/// its wheels spin.
pub(crate) fn turned_away(
    vehicle: &Pose,
    style: &Style,
    order: [f64; 2],
    careful_mps: f64,
    number: u32,
) -> [f64; 2] {
    if style.turns_on_the_spot && downhill(vehicle, style) == Some(order) && careful_mps * order[0] < 0.0 {
        let side = if (number / 4).is_multiple_of(2) { 1.0 } else { -1.0 };
        [0.0, side * style.mode_yaw_rate_radps]
    } else {
        [careful_mps, order[1]]
    }
}

/// Turns the nearer end of the vehicle downhill, if it can turn on the spot, then drives there, m/s and rad/s; `None` on ground
/// that is not steep.
fn downhill(vehicle: &Pose, style: &Style) -> Option<[f64; 2]> {
    let down = vehicle.rotation.conjugate() * DVec3::NEG_Z;
    if libm::hypot(down.x, down.y) < STEEP_RAD {
        return None;
    }
    let direction = if down.x < 0.0 { -1.0 } else { 1.0 };
    let off_rad = libm::atan2(down.y * direction, down.x * direction);
    let turns = style.turns_on_the_spot && off_rad.abs() > DOWNHILL_RAD;
    let turn = if turns { off_rad.signum() * style.mode_yaw_rate_radps } else { 0.0 };
    Some(if turn == 0.0 { [direction * style.max_speed_mps, 0.0] } else { [0.0, turn] })
}

/// Speed at which the bumper of a vehicle that shakes itself free touches what is known to be in its way, m/s: slower than
/// what counts as a collision.
const TOUCH_MPS: f64 = 0.25;
/// Least free way behind a vehicle that shakes itself free, m: on a slope it slides on, and its back has no bumper.
const ROOM_BEHIND_M: f64 = 0.9;

/// The speed of the action SHAKE, m/s, for an order of speed and turn rate: where the arc nearest to it is not free, the
/// vehicle moves in the other direction; where that is not free either, slowly ahead, because it may have to move all the
/// same.
pub(crate) fn careful(scored: &[Scored], style: &Style, [speed_mps, yaw_rate_radps]: [f64; 2]) -> f64 {
    let limited = |speed_mps: f64| {
        let (motion, least_m) =
            if speed_mps < 0.0 { (Motion::Backward, ROOM_BEHIND_M) } else { (Motion::Forward, 0.0) };
        let off = |scored: &&Scored| (scored.arc.curvature_per_m * speed_mps - yaw_rate_radps).abs();
        let arcs = scored.iter().filter(|scored| scored.arc.motion == motion);
        let nearest = arcs.min_by(|a, b| off(a).total_cmp(&off(b)));
        let free = nearest.filter(|scored| scored.open && scored.free_m >= least_m)?;
        Some(speed_mps.signum() * speed_mps.abs().min(style.stops_mps(free.free_m)))
    };
    let touching_mps = || speed_mps.abs().min(TOUCH_MPS);
    limited(speed_mps).or_else(|| limited(-speed_mps)).unwrap_or_else(touching_mps)
}

/// Poses along an arc, every 0.2 m.
pub(crate) fn poses_along(chosen: &Scored, vehicle: &Pose) -> Vec<rcs_msg::foxglove::Pose> {
    let start = (vehicle.translation.truncate(), vehicle.yaw());
    let steps = (chosen.free_m / 0.2) as u32;
    let distances = (0..=steps).map(|step| f64::from(step) * 0.2);
    let poses = distances.map(|along| arcs::pose_at(start, chosen.arc, along));
    poses.map(|(at, yaw)| pose_message(&Pose::from_xy_yaw(at.x, at.y, yaw))).collect()
}

/// An arc with its score as a message.
pub(crate) fn message(scored: &Scored) -> ScoredArc {
    let motion = match scored.arc.motion {
        Motion::Forward => scored_arc::Motion::Forward,
        Motion::Backward => scored_arc::Motion::Backward,
        Motion::TurnLeft => scored_arc::Motion::TurnLeft,
        Motion::TurnRight => scored_arc::Motion::TurnRight,
    };
    let [goal, heading, cost, turn, change, short] = scored.terms.map(|term| term as f32);
    ScoredArc {
        motion: motion.into(),
        curvature_per_m: scored.arc.curvature_per_m as f32,
        free_m: scored.free_m as f32,
        goal,
        heading,
        cost,
        turn,
        change,
        short,
        total: scored.total() as f32,
        open: scored.open,
    }
}

/// The rules of the choice of an arc: the parameters, changed by the mode.
pub(crate) fn arc_rules(params: &WaypointFollowerParams, mode: Option<&Mode>) -> arcs::Rules {
    // It is kept free around the places of tail and nose that are looked up.
    let half_width_m = rules_of(params.costs.as_ref()).half_width_m;
    arcs::Rules {
        length_m: params.arc_length_m,
        max_curvature_per_m: params.max_curvature_per_m,
        per_side: mode.and_then(|mode| mode.arcs_per_side).unwrap_or(params.arcs_per_side),
        least_free_m: mode.and_then(|mode| mode.least_free_m).unwrap_or(params.least_free_m),
        escape_m: params.escape_m,
        tail_m: (params.rear_m - params.tail_margin_m.min(half_width_m)).max(0.0),
        nose_m: (params.front_m - half_width_m).max(0.0),
        turns_on_the_spot: params.turns_on_the_spot,
        weights: Weights {
            goal: params.weight_goal,
            heading: params.weight_heading,
            cost: params.weight_cost,
            turn: params.weight_turn,
            not_forward: params.weight_not_forward,
            change: params.weight_change,
            short: params.weight_short,
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::proto::{TerrainClass, TerrainCosts};
    use rand_chacha::ChaCha8Rng;
    use rand_core::SeedableRng;

    fn speeds_of(motion: Motion, curvature_per_m: f64, free_m: f64) -> [f64; 2] {
        speeds_over(motion, curvature_per_m, free_m, 0.0)
    }

    fn speeds_over(motion: Motion, curvature_per_m: f64, free_m: f64, mean_cost: f64) -> [f64; 2] {
        let params = WaypointFollowerParams {
            max_speed_mps: 1.1,
            min_speed_mps: 0.25,
            backward_speed_mps: 0.5,
            max_yaw_rate_radps: 0.9,
            braking_mps2: 0.5,
            stop_margin_m: 0.3,
            cost_slowdown: 0.6,
            costs: Some(TerrainCosts {
                table: vec![TerrainClass { up_to: 25, cost: 10 }, TerrainClass { up_to: 100, cost: 35 }],
                ..TerrainCosts::default()
            }),
            ..WaypointFollowerParams::default()
        };
        let arc = Arc { motion, curvature_per_m };
        let chosen = Scored { arc, free_m, mean_cost, terms: [0.0; 6], open: true };
        speeds(&chosen, &Style::new(&params, None))
    }

    #[test]
    fn tail_and_nose_are_looked_up_within_half_the_width_of_the_vehicle_of_its_ends() {
        let ends_m = |rear_m: f64, front_m: f64, vehicle_width_m: f64| {
            let defaults: WaypointFollowerParams = rcs_msg::params::default();
            let costs = Some(TerrainCosts { vehicle_width_m, ..TerrainCosts::default() });
            let rules = arc_rules(&WaypointFollowerParams { rear_m, front_m, costs, ..defaults }, None);
            [rules.tail_m, rules.nose_m]
        };
        assert_eq!(ends_m(0.72, 0.24, 0.66), [0.5, 0.0], "exactly: the bundled vehicle");
        assert_eq!(ends_m(0.1, 0.1, 0.66), [0.0; 2]);
        for ([rear_m, front_m, width_m], [tail_m, nose_m]) in
            [([0.9, 3.1, 2.0], [0.68, 2.1]), ([0.25, 0.25, 0.35], [0.075; 2])]
        {
            let found_m = ends_m(rear_m, front_m, width_m);
            let is_near = (found_m[0] - tail_m).abs() < 1e-9 && (found_m[1] - nose_m).abs() < 1e-9;
            assert!(is_near, "{found_m:?}, expected {tail_m} and {nose_m}");
        }
    }

    #[test]
    fn ahead_and_back_the_vehicle_can_stop_on_what_is_free() {
        assert_eq!(speeds_of(Motion::Forward, 0.0, 3.0), [1.1, 0.0]);
        assert_eq!(speeds_of(Motion::Backward, 0.0, 1.0), [-0.5, -0.0]);
        assert_eq!(speeds_of(Motion::Backward, 0.8, 1.0), [-0.5, -0.4]);
        // 0.1 m to brake with 0.5 m/s²; then as slowly as it drives at all.
        for (motion, side) in [(Motion::Forward, 1.0), (Motion::Backward, -1.0)] {
            let [speed_mps, _] = speeds_of(motion, 0.0, 0.4);
            assert!((speed_mps - side * libm::sqrt(0.1)).abs() < 1e-9, "{motion:?}: {speed_mps}");
            assert_eq!(speeds_of(motion, 0.0, 0.2)[0], side * 0.25, "{motion:?}");
        }
    }

    #[test]
    fn the_action_reverse_backs_no_faster_than_the_vehicle_may_and_can_stop() {
        let params = WaypointFollowerParams {
            max_speed_mps: 1.1,
            backward_speed_mps: 0.5,
            max_yaw_rate_radps: 1.2,
            braking_mps2: 0.5,
            stop_margin_m: 0.3,
            ..WaypointFollowerParams::default()
        };
        let speed_mps = |free_m: f64| {
            let arc = Arc { motion: Motion::Backward, curvature_per_m: 0.8 };
            let scored = Scored { arc, free_m, mean_cost: 0.0, terms: [0.0; 6], open: true };
            reversed(&[scored], &Style::new(&params, None), 0, || false).1[0]
        };
        assert_eq!(speed_mps(1.0), -0.5);
        assert!((speed_mps(0.4) + libm::sqrt(0.1)).abs() < 1e-9, "{}", speed_mps(0.4));
    }

    #[test]
    fn a_bend_back_is_driven_within_the_limits_that_the_vehicle_states() {
        let params = WaypointFollowerParams {
            max_speed_mps: 1.1,
            backward_speed_mps: 0.5,
            max_yaw_rate_radps: 1.2,
            braking_mps2: 0.5,
            ..WaypointFollowerParams::default()
        };
        let style = Style::new(&params, None);
        let back = |max_speed_mps: f64, max_yaw_rate_radps: f64| {
            let vehicle = VehicleStatus { max_speed_mps, max_yaw_rate_radps, ..VehicleStatus::default() };
            let arc = Arc { motion: Motion::Backward, curvature_per_m: 0.8 };
            let scored = Scored { arc, free_m: 1.0, mean_cost: 0.0, terms: [0.0; 6], open: true };
            reversed(&[scored], &style.within(&vehicle), 0, || false).1
        };
        assert_eq!(back(0.4, 0.2), [-0.25, -0.2]);
        assert_eq!(back(0.25, 1.2), [-0.25, -0.2]);
        assert_eq!(back(1.1, 1.2), [-0.5, -0.4]);
        assert_eq!(style.within(&VehicleStatus::default()), style, "it states no limits");
    }

    #[test]
    fn the_action_reverse_turns_only_where_an_arc_to_that_side_is_free() {
        let params = WaypointFollowerParams {
            max_speed_mps: 1.1,
            backward_speed_mps: 0.3,
            max_yaw_rate_radps: 1.2,
            braking_mps2: 0.5,
            stop_margin_m: 0.3,
            ..WaypointFollowerParams::default()
        };
        let style =
            |yaw_rate_radps| Style { mode_yaw_rate_radps: yaw_rate_radps, ..Style::new(&params, None) };
        // Free lengths straight back, and in bends of positive and of negative curvature.
        let order = |[straight_m, positive_m, negative_m]: [f64; 3], yaw_rate_radps: f64, number: u32| {
            let arc = |curvature_per_m, free_m: f64| {
                let arc = Arc { motion: Motion::Backward, curvature_per_m };
                Scored { arc, free_m, mean_cost: 0.0, terms: [0.0; 6], open: free_m >= 0.6 }
            };
            let arcs = [arc(0.0, straight_m), arc(1.0, positive_m), arc(-1.0, negative_m)];
            reversed(&arcs, &style(yaw_rate_radps), number, || false)
        };
        // Back with a turn to the left is on an arc of negative curvature.
        assert_eq!(order([1.0, 1.0, 1.0], 0.2, 0), (Some(2), [-0.3, 0.2]));
        assert_eq!(order([1.0, 1.0, 1.0], 0.2, 1), (Some(1), [-0.3, -0.2]));
        assert_eq!(order([1.0, 1.0, 0.5], 0.2, 0), (Some(0), [-0.3, 0.0]), "something is beside its tail");
        assert_eq!(order([1.0, 0.5, 1.0], 0.2, 1), (Some(0), [-0.3, 0.0]));
        assert_eq!(order([1.0, 0.5, 1.0], 0.2, 0), (Some(2), [-0.3, 0.2]));
        assert_eq!(order([1.0, 1.0, 1.0], 0.4, 0), (Some(2), [-0.3, 0.3]), "no more than the arc");
        assert_eq!(order([1.0, 1.0, 1.0], 0.0, 0), (Some(0), [-0.3, 0.0]));
        assert_eq!(order([0.5, 1.0, 0.5], 0.2, 0), (Some(1), [-0.3, -0.3]), "only a bend is free");
    }

    #[test]
    fn a_turn_rate_is_never_beyond_its_limit_not_even_by_rounding() {
        for hundredths in 82..300 {
            for motion in [Motion::Forward, Motion::Backward] {
                let [_, yaw_rate] = speeds_of(motion, f64::from(hundredths) * 0.01, 3.0);
                assert!(yaw_rate.abs() <= 0.9, "{motion:?}: {yaw_rate}");
            }
        }
    }

    #[test]
    fn a_mode_that_does_not_stop_drives_back_no_faster_than_the_vehicle_may() {
        let params = WaypointFollowerParams {
            max_speed_mps: 1.1,
            backward_speed_mps: 0.5,
            max_yaw_rate_radps: 0.9,
            braking_mps2: 0.5,
            ..WaypointFollowerParams::default()
        };
        let style = Style { min_speed_mps: 0.6, ..Style::new(&params, None) };
        let speed_mps = |motion| {
            let arc = Arc { motion, curvature_per_m: 0.0 };
            speeds(&Scored { arc, free_m: 0.1, mean_cost: 0.0, terms: [0.0; 6], open: true }, &style)[0]
        };
        assert_eq!([speed_mps(Motion::Forward), speed_mps(Motion::Backward)], [0.6, -0.5]);
    }

    #[test]
    fn on_a_slope_a_vehicle_turns_its_nearer_end_downhill_and_drives_there_in_two_of_four_modes() {
        let mut style = Style::new(&WaypointFollowerParams::default(), None);
        (style.max_speed_mps, style.mode_yaw_rate_radps) = (0.6, 0.5);
        style.turns_on_the_spot = true;
        let order = |[roll, pitch]: [f64; 2], number: u32, since_s: f64| {
            let vehicle = Pose::from_rpy(DVec3::ZERO, roll, pitch, 1.0);
            let mut rng = ChaCha8Rng::seed_from_u64(1);
            shaken(&mut None, &style, &vehicle, (number, since_s), Stamp(0), &mut rng)
        };
        for (tilt, expected) in [
            // The front, the back, the left side and the right side are low; the last two lie a little to one end.
            ([0.0, 0.2], [0.6, 0.0]),
            ([0.0, -0.2], [-0.6, 0.0]),
            ([-0.2, 0.01], [0.0, 0.5]),
            ([0.2, 0.01], [0.0, -0.5]),
            ([-0.2, -0.01], [0.0, -0.5]),
        ] {
            assert_eq!(order(tilt, 1, 3.0), expected, "{tilt:?}");
            assert_eq!(order(tilt, 1, 1.0), [-0.6, 0.0], "it begins backward");
            assert_ne!(order(tilt, 2, 3.0), expected, "it moves at random");
            assert_eq!([order(tilt, 4, 3.0), order(tilt, 5, 3.0)], [expected; 2]);
        }
        // Its back is low, and something stands behind it: it does not go ahead instead.
        let away = |pitch: f64, careful_mps: f64, number: u32| {
            let vehicle = Pose::from_rpy(DVec3::ZERO, 0.0, pitch, 1.0);
            turned_away(&vehicle, &style, [-0.6, 0.0], careful_mps, number)
        };
        assert_eq!([away(-0.2, 0.6, 1), away(-0.2, 0.6, 5)], [[0.0, 0.5], [0.0, -0.5]]);
        assert_eq!([away(-0.2, -0.4, 1), away(0.0, 0.6, 1)], [[-0.4, 0.0], [0.6, 0.0]]);
        let [speed_mps, turn] = order([0.02, 0.02], 1, 3.0);
        assert!(speed_mps.abs() < 0.6 && turn.abs() < 0.5, "flat ground: at random");
    }

    #[test]
    fn a_vehicle_that_steers_does_not_stand_on_a_slope_to_turn_on_the_spot() {
        let mut style = Style::new(&WaypointFollowerParams::default(), None);
        (style.max_speed_mps, style.mode_yaw_rate_radps) = (0.6, 0.5);
        let low_left = Pose::from_rpy(DVec3::ZERO, -0.2, 0.01, 1.0);
        assert_eq!(downhill(&low_left, &style), Some([0.6, 0.0]));
        let low_back = Pose::from_rpy(DVec3::ZERO, 0.0, -0.2, 1.0);
        assert_eq!(turned_away(&low_back, &style, [-0.6, 0.0], 0.6, 1), [0.6, 0.0]);
    }

    #[test]
    fn a_vehicle_that_shakes_itself_free_moves_where_it_is_free_and_touches_with_its_bumper_alone() {
        let style = Style::new(
            &WaypointFollowerParams {
                max_speed_mps: 1.0,
                braking_mps2: 0.5,
                stop_margin_m: 0.3,
                ..WaypointFollowerParams::default()
            },
            None,
        );
        let arc = |motion, curvature_per_m, free_m: f64| {
            let arc = Arc { motion, curvature_per_m };
            Scored { arc, free_m, mean_cost: 0.0, terms: [0.0; 6], open: free_m >= 0.6 }
        };
        // Free lengths ahead, straight back, and back in a bend.
        let speed = |[ahead_m, back_m, bent_m]: [f64; 3], order: [f64; 2]| {
            let arcs = [
                arc(Motion::Forward, 0.0, ahead_m),
                arc(Motion::Backward, 0.0, back_m),
                arc(Motion::Backward, 1.0, bent_m),
            ];
            careful(&arcs, &style, order)
        };
        assert_eq!(speed([3.0, 1.0, 0.0], [-0.5, 0.0]), -0.5);
        assert_eq!(speed([3.0, 0.7, 1.0], [-0.5, 0.0]), 0.5, "a bend that is free is not what it drives");
        assert_eq!(speed([3.0, 0.0, 1.0], [-0.5, -0.5]), -0.5);
        assert_eq!(speed([0.0, 1.0, 0.0], [0.6, 0.0]), -0.6);
        assert_eq!(speed([0.0, 0.7, 0.0], [-0.5, 0.0]), TOUCH_MPS, "nothing is free: its back has no bumper");
        assert_eq!(speed([0.0, 0.7, 0.0], [-0.1, 0.0]), 0.1);
        let short = speed([0.6, 0.0, 0.0], [1.0, 0.0]);
        assert!((short - libm::sqrt(0.3)).abs() < 1e-9, "it can stop: {short}");
    }

    #[test]
    fn clear_ground_does_not_slow_it_and_ground_of_the_highest_cost_does_by_its_share() {
        let over = |mean_cost| speeds_over(Motion::Forward, 0.0, 3.0, mean_cost)[0];
        assert_eq!([over(0.0), over(0.04)], [1.1; 2], "the best class costs 10 of 250");
        assert!((over(0.52) - 1.1 * 0.7).abs() < 1e-9, "half way to the highest cost: {}", over(0.52));
        assert!((over(1.0) - 1.1 * 0.4).abs() < 1e-9, "{}", over(1.0));
    }
}
