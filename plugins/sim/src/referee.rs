//! How a run of a course stands: the referee sees the ground truth, and what it says is no secret.

use crate::vehicle::{STEP_S, Vehicle};
use glam::DVec2;
use rcs_msg::Stamp;
use rcs_msg::rcs::{CourseOutcome, CourseRun};
use serde::{Deserialize, Serialize};

/// Slip above which time counts as slipping.
const SLIPPING: f64 = 0.3;
/// A bumper that is pressed again this soon after it was let go is the same hit, s.
const SAME_HIT_S: f64 = 0.5;

/// Where to go, and in what time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Goal {
    /// Frame `global`, m.
    pub at: DVec2,
    /// Nearer than this, it has been reached, m.
    pub radius_m: f64,
    /// After this the run has failed, s.
    pub time_limit_s: f64,
}

/// The count so far. It stands still once the run has ended.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Referee {
    /// [`CourseOutcome`] as its number.
    outcome: i32,
    /// Since the start, s.
    pub time_s: f64,
    /// Driven, m.
    pub distance_m: f64,
    /// To the goal in a straight line, m.
    pub remaining_m: f64,
    /// Contacts that were collisions.
    pub collisions: u32,
    /// Times that the bumper was pressed.
    pub bumper_hits: u32,
    /// Time with slip, s.
    pub slip_s: f64,
    /// Time since the bumper was let go, s.
    released_s: f64,
}

impl Referee {
    /// Nothing has happened yet; the vehicle stands at its start.
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

    /// How the run stands.
    pub fn outcome(&self) -> CourseOutcome {
        CourseOutcome::try_from(self.outcome).unwrap_or(CourseOutcome::CourseRunning)
    }

    /// Counts a step of the vehicle; `in_world` says whether it is still there.
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

    /// The count as a message.
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
