//! The goal of a run, in UTM coordinates.
//!
//! A goal file is TOML with a table `goal`: `goal = { zone = 18, easting = 308760.0, northing = 4333755.0 }`. A course
//! file has one, too; everything else in the file is ignored. Without a zone, it is that of the global frame's origin.

use rcs_geom::{DVec2, Utm};

/// A position in UTM coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Goal {
    /// Zone; `None` for that of the global frame's origin.
    pub zone: Option<u8>,
    /// m.
    pub easting_m: f64,
    /// m.
    pub northing_m: f64,
}

/// Why a goal is none.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GoalError {
    /// The text is not TOML.
    #[error("line {line}, {message}")]
    Toml {
        /// Line of the error, from 1.
        line: usize,
        /// What is wrong.
        message: String,
    },
    /// A key is missing or has another type or range.
    #[error("line {line}, key \"{key}\": {message}")]
    Key {
        /// Line of the table, from 1.
        line: usize,
        /// The key.
        key: &'static str,
        /// What was found and expected.
        message: String,
    },
    /// The goal is in another zone than the global frame.
    #[error("the goal is in UTM zone {got}, expected zone {expected} of the global frame's origin")]
    Zone {
        /// Zone of the goal.
        got: u8,
        /// Zone of the origin.
        expected: u8,
    },
}

impl Goal {
    /// Parses a goal file.
    pub fn from_toml(text: &str) -> Result<Goal, GoalError> {
        let file: toml::Table = toml::from_str(text).map_err(|error: toml::de::Error| {
            let start = error.span().map_or(0, |span| span.start);
            GoalError::Toml { line: line_of(text, start), message: error.message().trim().to_owned() }
        })?;
        let line = line_of_key(text, "goal");
        let error = |key, message: String| GoalError::Key { line, key, message };
        let Some(table) = file.get("goal").and_then(toml::Value::as_table) else {
            return Err(error("goal", "expected a table with zone, easting and northing".to_owned()));
        };
        let number = |key, most: f64| {
            let value = table.get(key);
            let number = value.and_then(|value| value.as_float().or(value.as_integer().map(|n| n as f64)));
            let got = value.map_or("nothing".to_owned(), toml::Value::to_string);
            let within = number.filter(|number| (0.0..=most).contains(number));
            within.ok_or_else(|| error(key, format!("got {got}, expected metres from 0 to {most}")))
        };
        let zone = table.get("zone").map(|zone| {
            let number = zone.as_integer().and_then(|zone| u8::try_from(zone).ok());
            let valid = number.filter(|zone| (1..=60).contains(zone));
            valid.ok_or_else(|| error("goal.zone", format!("got {zone}, expected 1 to 60")))
        });
        Ok(Goal {
            zone: zone.transpose()?,
            easting_m: number("easting", 1e6)?,
            northing_m: number("northing", 1e7)?,
        })
    }

    /// Position in the global frame with this origin, m.
    pub fn in_global(&self, origin: &Utm) -> Result<DVec2, GoalError> {
        match self.zone {
            Some(got) if got != origin.zone => Err(GoalError::Zone { got, expected: origin.zone }),
            _ => Ok(origin.offset_to(self.easting_m, self.northing_m)),
        }
    }
}

/// The line of a goal file in which a key begins, from 1; 1 if there is none.
pub(crate) fn line_of_key(text: &str, key: &str) -> usize {
    text.lines().position(|line| begins(line, key)).map_or(1, |line| line + 1)
}

/// Whether a key begins in a line: `[goal]`, `goal = {` or `goal.easting =`. Other keys may begin with that word, too.
fn begins(line: &str, key: &str) -> bool {
    let line = line.trim_start();
    let rest = line.strip_prefix('[').unwrap_or(line).trim_start();
    rest.strip_prefix(key).is_some_and(|rest| rest.trim_start().starts_with(['=', '.', ']']))
}

fn line_of(text: &str, at: usize) -> usize {
    1 + text.bytes().take(at).filter(|&byte| byte == b'\n').count()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_goal_file_and_a_course_give_the_goal() {
        let expected = Goal { zone: Some(18), easting_m: 308_760.0, northing_m: 4_333_755.5 };
        let file = "goal = { zone = 18, easting = 308760, northing = 4333755.5 }\n";
        assert_eq!(Goal::from_toml(file), Ok(expected));
        let course = "format = 1\nname = 'c'\n[goal]\nzone = 18\neasting = 308760.0\nnorthing = 4333755.5\n";
        assert_eq!(Goal::from_toml(course), Ok(expected));
    }

    #[test]
    fn a_goal_is_relative_to_the_origin_and_must_be_in_its_zone() {
        let origin = Utm::new(18, true, 308_660.0, 4_333_755.0).unwrap();
        let goal = Goal { zone: Some(18), easting_m: 308_760.0, northing_m: 4_333_745.0 };
        assert_eq!(goal.in_global(&origin), Ok(DVec2::new(100.0, -10.0)));
        let elsewhere = Goal { zone: Some(17), ..goal }.in_global(&origin).unwrap_err();
        assert_eq!(
            elsewhere.to_string(),
            "the goal is in UTM zone 17, expected zone 18 of the global frame's origin"
        );
    }

    #[test]
    fn files_that_are_no_goals_are_refused_with_line_and_key() {
        for (text, expected) in [
            ("a = 1\ngoal = [", "line 2, "),
            ("", "line 1, key \"goal\": expected a table"),
            ("\n[goal]\neasting = 1.0\n", "line 2, key \"northing\": got nothing"),
            (
                "[goal]\neasting = -1.0\nnorthing = 1.0\n",
                "line 1, key \"easting\": got -1.0, expected metres",
            ),
            ("[goal]\neasting = 'x'\nnorthing = 1.0\n", "line 1, key \"easting\": got \"x\""),
            ("[goal]\nzone = 61\neasting = 1.0\nnorthing = 1.0\n", "line 1, key \"goal.zone\": got 61"),
            ("[goal]\neasting = nan\nnorthing = 1.0\n", "line 1, key \"easting\": got nan"),
            ("goal_radius_m = 3\ngoal = { northing = 1.0 }\n", "line 2, key \"easting\": got nothing"),
            ("goal_radius_m = 3\ngoal.northing = 1.0\n", "line 2, key \"easting\": got nothing"),
        ] {
            let error = Goal::from_toml(text).unwrap_err().to_string();
            assert!(error.starts_with(expected), "{text:?}: {error}");
        }
    }
}
