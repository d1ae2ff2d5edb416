//! Which of a preset list of arcs the vehicle drives: the choice of the waypoint follower.
//!
//! Albus 2006a, 5: "The waypoint follower searches a preset list of possible paths starting at the current position and
//! chooses the one that gets the best score. The score represents a compromise between getting close to the turning
//! point, staying far away from obstacles and higher cost areas, and keeping the speed up by avoiding turns."
//!
//! An arc has a constant curvature, forward or backward, or is a turn on the spot. It is followed over the grid of costs
//! until its length, or until the vehicle's middle or its nose gets into a blocked cell; in a tight bend, in which it swings
//! out by more than a quarter of a cell, its tail, too. Backward, it is followed until the tail does; in a bend, until a cell
//! beside the tail is blocked, or, where the bend is tight, the nose gets into a blocked cell. Along a turn on the spot tail
//! and nose swing until the vehicle faces the target. A nose 0 m ahead of the origin of the frame is the vehicle's middle.
//! The score of an arc is a sum of terms, and the lowest one wins:
//!
//! | term | what |
//! | --- | --- |
//! | goal | metres by which its end is not nearer to the target than the start could get; backward motion gains none |
//! | heading | angle at its end between the vehicle's heading and the direction of the target |
//! | cost | mean cost of the cells under it, as a share of the highest one |
//! | turn | curvature, 1/m, and a fixed amount for a turn on the spot or backward motion |
//! | change | difference of its curvature from that of the arc before; a fixed amount for a turn on the spot to the other side |
//! | short | share of it that is not free |
//!
//! The papers give neither the list nor the weights; here they are parameters.

use crate::costs::{BLOCKED, CostGrid, MAX_COST};
use crate::sensed::Sensed;
use rcs_geom::{DVec2, Pose, wrap_angle};
use rcs_world::OBSTACLE_COST;
use std::f64::consts::TAU;

/// How the vehicle moves along an arc.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Motion {
    /// Ahead.
    Forward,
    /// Back.
    Backward,
    /// A turn to the left.
    TurnLeft,
    /// A turn to the right.
    TurnRight,
}

/// An arc of the list.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arc {
    /// How the vehicle moves.
    pub motion: Motion,
    /// Positive to the left of the motion ahead, 1/m; 0 for a turn on the spot.
    pub curvature_per_m: f64,
}

/// The rules of the choice; see the parameters of the process.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rules {
    /// Length of an arc, m.
    pub length_m: f64,
    /// Greatest curvature, 1/m, and number of arcs on each side.
    pub max_curvature_per_m: f64,
    /// Number of arcs on each side of the straight one.
    pub per_side: u32,
    /// Arcs with a shorter free part are not driven, m.
    pub least_free_m: f64,
    /// Distance from the vehicle up to which blocked cells can be left, if the vehicle stands in one, m.
    pub escape_m: f64,
    /// How far behind the origin of its frame the vehicle's tail is, which swings when it turns on the spot or drives
    /// through a tight bend, and goes ahead when it drives back, m.
    pub tail_m: f64,
    /// How far ahead of the origin of its frame the vehicle's nose is, m.
    pub nose_m: f64,
    /// Whether the vehicle can turn on the spot.
    pub turns_on_the_spot: bool,
    /// Weights of the terms.
    pub weights: Weights,
}

/// Weights of the terms of a score.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Weights {
    /// Per metre not gained.
    pub goal: f64,
    /// Per radian.
    pub heading: f64,
    /// For the highest cost.
    pub cost: f64,
    /// Per curvature, 1/m.
    pub turn: f64,
    /// For a turn on the spot, and for backward motion.
    pub not_forward: f64,
    /// Per difference of curvature, 1/m.
    pub change: f64,
    /// For an arc without any free part.
    pub short: f64,
}

/// An arc with its score.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scored {
    /// The arc.
    pub arc: Arc,
    /// Length that is free, m; for a turn on the spot 0.
    pub free_m: f64,
    /// Mean cost under it, 0 to 1.
    pub mean_cost: f64,
    /// The terms with their weights: goal, heading, cost, turn, change, short.
    pub terms: [f64; 6],
    /// Whether it may be driven.
    pub open: bool,
}

impl Scored {
    /// Sum of the terms.
    pub fn total(&self) -> f64 {
        self.terms.iter().sum()
    }
}

/// Distance between the places of an arc that are looked up, m.
const SAMPLE_M: f64 = 0.1;
/// Angle by which a turn on the spot is looked ahead, rad: at least this much must be free.
const TURN_RAD: f64 = 0.8;
/// Angle between the headings of a turn that are looked up, rad.
const TURN_SAMPLE_RAD: f64 = 0.2;
/// A vehicle that faces its target as nearly as this does not turn on the spot, rad: where the way ahead is blocked, it
/// would turn past the target and all around.
const FACING_RAD: f64 = 0.15;

/// The list, in the order in which ties are broken.
pub fn list(rules: &Rules) -> Vec<Arc> {
    let forward = |curvature_per_m| Arc { motion: Motion::Forward, curvature_per_m };
    let mut arcs = vec![forward(0.0)];
    for at in 1..=rules.per_side {
        // Denser near the straight one, where a small difference matters far ahead.
        let share = f64::from(at) / f64::from(rules.per_side);
        let curvature = rules.max_curvature_per_m * share * f64::midpoint(share, 1.0);
        arcs.extend([forward(curvature), forward(-curvature)]);
    }
    let turn = |motion| Arc { motion, curvature_per_m: 0.0 };
    if rules.turns_on_the_spot {
        arcs.extend([turn(Motion::TurnLeft), turn(Motion::TurnRight)]);
    }
    arcs.push(turn(Motion::Backward));
    for side in [1.0, -1.0] {
        arcs.push(Arc { motion: Motion::Backward, curvature_per_m: side * 0.5 * rules.max_curvature_per_m });
    }
    arcs
}

/// Pose after a distance along an arc, m; for a turn on the spot after an angle, rad.
pub fn pose_at(start: (DVec2, f64), arc: Arc, along: f64) -> (DVec2, f64) {
    let (position, yaw) = start;
    let (distance, turned) = match arc.motion {
        Motion::Forward => (along, arc.curvature_per_m * along),
        Motion::Backward => (-along, -arc.curvature_per_m * along),
        Motion::TurnLeft => return (position, wrap_angle(yaw + along)),
        Motion::TurnRight => return (position, wrap_angle(yaw - along)),
    };
    // The chord has the direction of the middle of the arc.
    let half = turned / 2.0;
    let chord = if half.abs() < 1e-6 { distance } else { distance * libm::sin(half) / half };
    let direction = yaw + half;
    let moved = DVec2::new(libm::cos(direction), libm::sin(direction)) * chord;
    (position + moved, wrap_angle(yaw + turned))
}

/// What the arcs are scored on.
#[derive(Clone, Copy, Debug)]
pub struct Scene<'a> {
    /// The map, for its geometry.
    pub sensed: &'a Sensed,
    /// Costs for the vehicle's width.
    pub costs: &'a CostGrid,
    /// Pose of the vehicle, map's frame.
    pub vehicle: &'a Pose,
    /// The turning point, map's frame, m.
    pub target: DVec2,
    /// Curvature of the arc before, 1/m.
    pub before_per_m: f64,
    /// The turn on the spot before, if the vehicle was turning.
    pub turning: Option<Motion>,
}

impl Scene<'_> {
    /// Scores an arc.
    pub fn score(&self, arc: Arc, rules: &Rules) -> Scored {
        let start = (self.vehicle.translation.truncate(), self.vehicle.yaw());
        let away_m = start.0.distance(self.target);
        let on_the_spot = matches!(arc.motion, Motion::TurnLeft | Motion::TurnRight);
        let length_m = match arc.motion {
            Motion::Forward => rules.length_m.min(away_m.max(2.0 * SAMPLE_M)),
            Motion::Backward => (rules.length_m / 3.0).max(SAMPLE_M),
            Motion::TurnLeft | Motion::TurnRight => 0.0,
        };
        let (free_m, mean_cost) = if on_the_spot {
            self.turned(start, arc, rules)
        } else {
            self.followed(start, arc, length_m, rules)
        };
        let end = pose_at(start, arc, if on_the_spot { self.turns_by(start, arc) } else { free_m });
        let towards = self.target - end.0;
        let off_rad = if towards.length() < SAMPLE_M {
            0.0
        } else {
            wrap_angle(libm::atan2(towards.y, towards.x) - end.1).abs()
        };
        let gained_m = away_m - towards.length();
        // The vehicle sees nothing behind it: driving back is a way out, and no way to the target.
        let gained_m = if arc.motion == Motion::Backward { gained_m.min(0.0) } else { gained_m };
        let weights = &rules.weights;
        let bend = arc.curvature_per_m.abs();
        let fixed = if arc.motion == Motion::Forward { 0.0 } else { weights.not_forward };
        let signed = if arc.motion == Motion::Forward { arc.curvature_per_m } else { 0.0 };
        // A vehicle that turns now to one side and now to the other never gets around.
        let turns_back = on_the_spot && self.turning.is_some_and(|turning| turning != arc.motion);
        let faces = self.off(start).abs() < FACING_RAD;
        let open =
            if on_the_spot { free_m > 0.0 && !faces } else { free_m >= rules.least_free_m.min(length_m) };
        let lacks = if on_the_spot { 1.0 - free_m } else { 1.0 - free_m / length_m };
        let terms = [
            weights.goal * (rules.length_m.min(away_m) - gained_m),
            weights.heading * off_rad,
            weights.cost * mean_cost,
            weights.turn * bend + fixed,
            weights.change * (signed - self.before_per_m).abs()
                + if turns_back { weights.not_forward } else { 0.0 },
            weights.short * lacks,
        ];
        Scored { arc, free_m: if on_the_spot { 0.0 } else { free_m }, mean_cost, terms, open }
    }

    /// Whether the vehicle can drive straight back this far, m, over ground that it has driven over, although what stands close
    /// beside it on both sides leaves no free arc, as in growth: no cell under its body there is an obstacle.
    pub fn is_own_track_free(&self, back_m: f64, half_width_m: f64, rules: &Rules) -> bool {
        let (position, yaw) = (self.vehicle.translation.truncate(), self.vehicle.yaw());
        let ahead = DVec2::new(libm::cos(yaw), libm::sin(yaw));
        // A cell whose middle lies beside the body was not driven over.
        let half_width_m = (half_width_m - 0.5 * self.sensed.cell_size_m).max(0.0);
        let steps = |length_m: f64| (length_m / SAMPLE_M).ceil() as u32;
        let is_free = |at: DVec2| {
            let cell = self.sensed.place(at).filter(|&place| self.costs.get(place).is_some());
            cell.is_some_and(|place| self.sensed.fused[self.sensed.index(place)] < OBSTACLE_COST)
        };
        let mut behind =
            (0..=steps(rules.tail_m + back_m)).map(|step| position - ahead * (f64::from(step) * SAMPLE_M));
        behind.all(|middle| {
            (0..=steps(2.0 * half_width_m)).all(|step| {
                let across_m = (f64::from(step) * SAMPLE_M - half_width_m).min(half_width_m);
                is_free(middle + ahead.perp() * across_m)
            })
        })
    }

    /// Angle by which a turn on the spot turns: to the target, but no farther than is looked ahead.
    fn turns_by(&self, start: (DVec2, f64), arc: Arc) -> f64 {
        self.wanted(start, arc).clamp(0.0, TURN_RAD)
    }

    /// Angle of a turn on the spot to the target, rad; negative if the other side is nearer.
    fn wanted(&self, start: (DVec2, f64), arc: Arc) -> f64 {
        let off = self.off(start);
        if arc.motion == Motion::TurnLeft { off } else { -off }
    }

    /// Direction of the target from a pose, to the left of its heading, rad.
    fn off(&self, (position, yaw): (DVec2, f64)) -> f64 {
        let towards = self.target - position;
        wrap_angle(libm::atan2(towards.y, towards.x) - yaw)
    }

    /// Free length and mean cost of an arc.
    fn followed(&self, start: (DVec2, f64), arc: Arc, length_m: f64, rules: &Rules) -> (f64, f64) {
        let samples = (length_m / SAMPLE_M).ceil().max(1.0) as u32;
        let mut sum = 0.0;
        // What goes ahead: the nose and the middle behind it; backward, the tail.
        let cost_ahead = |pose: (DVec2, f64)| match arc.motion {
            Motion::Backward => self.cost(tail(pose, rules)),
            _ => self.cost(pose.0).max(self.cost(nose(pose, rules))),
        };
        // Whether a cell that is not blocked has been reached; a blocked cell can be left, but not entered.
        let mut is_out = cost_ahead(start) != BLOCKED;
        // In a tight bend ahead the tail swings out to the other side. It may follow the middle out of what that stands in.
        let is_tight = arc.motion == Motion::Forward
            && swing_m(arc.curvature_per_m, rules.tail_m) > 0.25 * self.sensed.cell_size_m;
        let follows = !is_tight || !is_out;
        // A bend back leads the tail over ground that was not driven over and is not seen: a cell beside it is kept free,
        // for an obstacle can be a cell larger than in the map.
        let leads = arc.motion == Motion::Backward && arc.curvature_per_m != 0.0;
        // In a tight one the nose swings out to the other side.
        let nose_swings =
            leads && swing_m(arc.curvature_per_m, rules.nose_m) > 0.25 * self.sensed.cell_size_m;
        let swings_in = |pose| {
            if leads {
                self.is_beside_tail(pose, rules) || (nose_swings && self.cost(nose(pose, rules)) == BLOCKED)
            } else {
                !follows && self.cost(tail(pose, rules)) == BLOCKED
            }
        };
        let mut tail_is_out = !swings_in(start);
        for sample in 1..=samples {
            let along_m = length_m.min(f64::from(sample) * SAMPLE_M);
            let pose = pose_at(start, arc, along_m);
            let cost = cost_ahead(pose);
            let (is_blocked, swings_in) = (cost == BLOCKED, swings_in(pose));
            if (is_blocked && (is_out || along_m > rules.escape_m)) || (swings_in && tail_is_out) {
                let before = if is_out { f64::from(sample - 1) } else { 0.0 };
                return (before * SAMPLE_M, if before > 0.0 { sum / before } else { 1.0 });
            }
            is_out |= !is_blocked;
            tail_is_out |= !swings_in;
            sum += f64::from(cost.min(MAX_COST)) / f64::from(MAX_COST);
        }
        if is_out { (length_m, sum / f64::from(samples)) } else { (0.0, 1.0) }
    }

    /// Whether the tail would be blocked a cell to one of its sides.
    fn is_beside_tail(&self, pose: (DVec2, f64), rules: &Rules) -> bool {
        let aside = DVec2::new(-libm::sin(pose.1), libm::cos(pose.1)) * self.sensed.cell_size_m;
        let middle = tail(pose, rules);
        [middle + aside, middle - aside].into_iter().any(|side| self.cost(side) == BLOCKED)
    }

    /// Share of a turn to the target by which tail and nose can swing, 0 if that is not even what is looked ahead; and the
    /// mean cost under them.
    fn turned(&self, start: (DVec2, f64), arc: Arc, rules: &Rules) -> (f64, f64) {
        let wanted = self.wanted(start, arc);
        let whole = if wanted < 0.0 { wanted + TAU } else { wanted }.max(TURN_RAD);
        let samples = (whole / TURN_SAMPLE_RAD).round() as u32;
        let least = (TURN_RAD / TURN_SAMPLE_RAD).round() as u32;
        let mut sum = 0.0;
        for sample in 1..=samples {
            let angle = TURN_SAMPLE_RAD * f64::from(sample);
            let pose = pose_at(start, arc, angle);
            let cost = self.cost(tail(pose, rules));
            // A nose at the middle does not swing.
            let cost = if rules.nose_m > 0.0 { cost.max(self.cost(nose(pose, rules))) } else { cost };
            if cost == BLOCKED {
                let before = sample - 1;
                let share = f64::from(before) / f64::from(samples);
                return if before < least { (0.0, 1.0) } else { (share, sum / f64::from(before)) };
            }
            sum += f64::from(cost) / f64::from(MAX_COST);
        }
        (1.0, sum / f64::from(samples))
    }

    /// Cost at a position; blocked outside of the map.
    fn cost(&self, position: DVec2) -> u8 {
        self.sensed.place(position).and_then(|place| self.costs.get(place)).unwrap_or(BLOCKED)
    }
}

/// The middle of the tail of a vehicle in a pose.
fn tail((position, yaw): (DVec2, f64), rules: &Rules) -> DVec2 {
    position - DVec2::new(libm::cos(yaw), libm::sin(yaw)) * rules.tail_m
}

/// The middle of the nose of a vehicle in a pose.
fn nose((position, yaw): (DVec2, f64), rules: &Rules) -> DVec2 {
    position + DVec2::new(libm::cos(yaw), libm::sin(yaw)) * rules.nose_m
}

/// By how much an end of the vehicle, this far from its middle, swings out of the circle on which the middle drives, m.
fn swing_m(curvature_per_m: f64, end_m: f64) -> f64 {
    let radius_m = 1.0 / curvature_per_m.abs().max(1e-6);
    libm::hypot(radius_m, end_m) - radius_m
}

/// The arc with the lowest score among those that may be driven; the first of several.
pub fn best(scored: &[Scored]) -> Option<usize> {
    let open = scored.iter().enumerate().filter(|(_, scored)| scored.open);
    let found = open.reduce(|best, other| if other.1.total() < best.1.total() { other } else { best });
    found.map(|(at, _)| at)
}

#[cfg(test)]
#[path = "arcs_tests.rs"]
mod tests;
