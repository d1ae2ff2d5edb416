//! The referee of a course: reads ground truth, and publishes only outputs that a robot may use, such as time and
//! distance.

use crate::vehicle::{STEP_S, Vehicle};
use glam::DVec2;
use rcs_msg::Stamp;
use rcs_msg::rcs::{CourseOutcome, CourseRun};
use serde::{Deserialize, Serialize};

/// Slip above this counts as slipping.
const SLIPPING: f64 = 0.3;
/// A bumper that is pressed again within this time after its release counts as the same hit, s.
const SAME_HIT_S: f64 = 0.5;

/// The goal of a course, and its time limit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Goal {
    /// Position, frame `global`, m.
    pub at: DVec2,
    /// Distance at which it is reached, m.
    pub radius_m: f64,
    /// Time after which the run has failed, s.
    pub time_limit_s: f64,
}

/// Results so far. They no longer change after the run has ended.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Referee {
    /// Number of the [`CourseOutcome`].
    outcome: i32,
    /// Time since the start, s.
    pub time_s: f64,
    /// Distance driven, m.
    pub distance_m: f64,
    /// Straight-line distance to the goal, m.
    pub remaining_m: f64,
    /// Number of contacts that were collisions.
    pub collisions: u32,
    /// Number of bumper hits.
    pub bumper_hits: u32,
    /// Time spent slipping, s.
    pub slip_s: f64,
    /// Time since the bumper was released, s.
    released_s: f64,
}

impl Referee {
    /// Results at the start of a run.
    pub fn new(start: DVec2, goal: Option<&Goal>) -> Referee {
        Referee {
            outcome: CourseOutcome::CourseRunning.into(),
            time_s: 0.0,
            distance_m: 0.0,
            remaining_m: goal.map_or(0.0, |goal| start.distance(goal.at)),
            collisions: 0,
            bumper_hits: 0,
            slip_s: 0.0,
            released_s: SAME_HIT_S,
        }
    }

    /// Outcome of the run.
    pub fn outcome(&self) -> CourseOutcome {
        CourseOutcome::try_from(self.outcome).unwrap_or(CourseOutcome::CourseRunning)
    }

    /// Adds one step of the vehicle; `in_world` tells whether it is still inside of the world.
    pub fn watch(&mut self, vehicle: &Vehicle, goal: Option<&Goal>, in_world: bool) {
        if self.outcome() != CourseOutcome::CourseRunning {
            return;
        }
        self.time_s += STEP_S;
        self.distance_m = vehicle.distance_m;
        let collided = vehicle.contacts.list().iter().filter(|contact| contact.collided);
        self.collisions += collided.count() as u32;
        if vehicle.contacts.pressed() == [false; 2] {
            self.released_s += STEP_S;
        } else {
            self.bumper_hits += u32::from(self.released_s >= SAME_HIT_S);
            self.released_s = 0.0;
        }
        if vehicle.slip[0].max(vehicle.slip[1]) > SLIPPING {
            self.slip_s += STEP_S;
        }
        if let Some(goal) = goal {
            self.remaining_m = vehicle.at().distance(goal.at);
        }
        let outcome = match goal {
            _ if vehicle.turned_over || !in_world => CourseOutcome::CourseLost,
            Some(goal) if self.remaining_m <= goal.radius_m => CourseOutcome::CourseReached,
            Some(goal) if self.time_s >= goal.time_limit_s => CourseOutcome::CourseTimeOut,
            _ => CourseOutcome::CourseRunning,
        };
        self.outcome = outcome.into();
    }

    /// The results as a message.
    pub fn message(&self, course: &str, goal: Option<&Goal>, time: Stamp) -> CourseRun {
        CourseRun {
            timestamp: Some(time.to_proto()),
            course: course.to_owned(),
            outcome: self.outcome,
            time_s: self.time_s,
            distance_m: self.distance_m,
            remaining_m: self.remaining_m,
            collisions: self.collisions,
            bumper_hits: self.bumper_hits,
            slip_s: self.slip_s,
            time_limit_s: goal.map_or(0.0, |goal| goal.time_limit_s),
        }
    }
}
