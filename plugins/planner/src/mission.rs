//! The operator's mission: goals that are driven to one after the other, an area, and zones.

use crate::zones::{Polygon, Zones};
use rcs_geom::{DVec2, Pose};
use rcs_msg::{Stamp, rcs};
use serde::{Deserialize, Serialize};

/// Greatest number of goals, and of zones.
const MOST: usize = 1000;

/// A mission, global frame, m.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Mission {
    /// The goals; without one, the vehicle stands. `None` for the goal of the file, or of the command `GO_TO`.
    pub goals: Option<Vec<(f64, f64)>>,
    /// Number of goals that have been reached.
    pub reached: usize,
    /// Where the vehicle must not drive.
    pub zones: Zones,
}

impl Mission {
    /// The mission of a message.
    pub fn of(message: &rcs::Mission, global_from_message: &Pose) -> Result<Mission, String> {
        let count = message.goals.len().max(message.keep_out.len());
        if count > MOST {
            return Err(format!("{count} goals or zones, expected at most {MOST}"));
        }
        let point =
            |at: &rcs::PlanePoint| (*global_from_message * DVec2::new(at.x_m, at.y_m).extend(0.0)).truncate();
        let polygon = |polygon: &rcs::PlanePolygon| Polygon::new(polygon.points.iter().map(point));
        let goals: Vec<(f64, f64)> = message.goals.iter().map(point).map(|goal| (goal.x, goal.y)).collect();
        if let Some(goal) = goals.iter().find(|(x, y)| !(x.is_finite() && y.is_finite())) {
            return Err(format!("a goal is at {goal:?}, expected finite numbers"));
        }
        let area =
            message.area.as_ref().map(polygon).transpose().map_err(|error| format!("area: {error}"))?;
        let keep_out = message.keep_out.iter().map(polygon).collect::<Result<_, _>>();
        let keep_out = keep_out.map_err(|error| format!("keep_out: {error}"))?;
        let goals = (!message.keeps_goals).then_some(goals);
        Ok(Mission { goals, reached: 0, zones: Zones { area, keep_out, ..Zones::default() } })
    }

    /// The message of the mission.
    pub fn to_message(&self, now: Stamp, frame_id: &str) -> rcs::Mission {
        let point = |at: DVec2| rcs::PlanePoint { x_m: at.x, y_m: at.y };
        let polygon =
            |polygon: &Polygon| rcs::PlanePolygon { points: polygon.corners().map(point).collect() };
        rcs::Mission {
            timestamp: Some(now.to_proto()),
            frame_id: frame_id.to_owned(),
            goals: self.goals.iter().flatten().copied().map(DVec2::from).map(point).collect(),
            area: self.zones.area.as_ref().map(polygon),
            keep_out: self.zones.keep_out.iter().map(polygon).collect(),
            reached: self.reached as u32,
            keeps_goals: false,
        }
    }

    /// Takes a mission of the operator; its goals only if it has some to say.
    pub fn take(&mut self, other: Mission) {
        if other.goals.is_some() {
            (self.goals, self.reached) = (other.goals, 0);
        }
        self.zones = other.zones;
    }

    /// The goal that is driven to: the last one when all have been reached. `None` if there are none.
    pub fn goal(&self) -> Option<DVec2> {
        let goals = self.goals.as_ref()?;
        goals.get(self.reached).or(goals.last()).copied().map(DVec2::from)
    }

    /// The goal that is driven to, in words: with its number where there are several.
    pub fn goal_name(&self) -> String {
        match &self.goals {
            Some(goals) if goals.len() > 1 => format!("goal {}", (self.reached + 1).min(goals.len())),
            _ => "the goal".to_owned(),
        }
    }

    /// Counts the goal as reached. Whether that changes anything.
    pub fn arrive(&mut self) -> bool {
        let is_on_the_way = self.goals.as_ref().is_some_and(|goals| self.reached < goals.len());
        self.reached += usize::from(is_on_the_way);
        is_on_the_way
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn goals_follow_each_other_in_the_global_frame() {
        let point = |x_m, y_m| rcs::PlanePoint { x_m, y_m };
        let triangle = rcs::PlanePolygon { points: vec![point(0.0, 0.0), point(1.0, 0.0), point(0.0, 1.0)] };
        let mut message = rcs::Mission {
            frame_id: "local".to_owned(),
            goals: vec![point(1.0, 0.0), point(5.0, 0.0)],
            keep_out: vec![triangle],
            ..Default::default()
        };
        let global_from_local = Pose::from_xy_yaw(10.0, 20.0, std::f64::consts::FRAC_PI_2);
        let mut mission = Mission::of(&message, &global_from_local).unwrap();
        let near = |mission: &Mission, x, y| mission.goal().unwrap().distance(DVec2::new(x, y)) < 1e-9;
        assert!(near(&mission, 10.0, 21.0) && mission.zones.forbid(DVec2::new(9.8, 20.2)));
        assert!(mission.arrive() && near(&mission, 10.0, 25.0));
        assert!(mission.arrive() && !mission.arrive() && near(&mission, 10.0, 25.0), "stays at the last one");
        let again = mission.to_message(Stamp(0), "global");
        assert_eq!((again.reached, again.goals.len(), again.keep_out[0].points.len()), (2, 2, 3));
        message.keeps_goals = true;
        mission.take(Mission::of(&message, &Pose::IDENTITY).unwrap());
        assert!(near(&mission, 10.0, 25.0) && mission.zones.forbid(DVec2::new(0.2, 0.2)), "only the zones");
        mission.take(Mission { goals: Some(Vec::new()), ..Mission::default() });
        assert_eq!((mission.goal(), mission.arrive()), (None, false), "stands");
        message.goals.push(point(f64::NAN, 0.0));
        assert!(Mission::of(&message, &global_from_local).unwrap_err().contains("a goal is at"));
        message.goals.clear();
        message.keep_out[0].points.truncate(2);
        let error = Mission::of(&message, &global_from_local).unwrap_err();
        assert!(error.starts_with("keep_out: a polygon has 2 corners"), "{error}");
    }
}
