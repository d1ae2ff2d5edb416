//! Courses: start, goal and time limit of a run.
//!
//! ```toml
//! format = 1
//! name = "meadow"
//! description = "trees and bushes on a meadow"
//! world = "meadow"                # file of the world, by name or path
//! vehicle = "lagr"                # optional: the file of the vehicle
//! look = "dry_summer"             # optional: other colours and light for the world
//! time_limit_s = 240
//! goal_radius_m = 1.5
//! start = { zone = 18, easting = 309030.0, northing = 4335020.0, heading_deg = 90.0 }
//! goal = { easting = 309030.0, northing = 4335120.0 }
//! area = [[309000.0, 4335010.0], [309060.0, 4335010.0], [309030.0, 4335140.0]]          # optional
//! keep_out = [[[309020.0, 4335050.0], [309025.0, 4335050.0], [309020.0, 4335060.0]]]    # optional
//! ```
//!
//! The vehicle stays inside of `area`, else inside of the bounds of the world, and outside of the zones of `keep_out`.
//! Both are for its planning; the simulated world has no such borders. They are checked here, so that every stack
//! refuses the same courses.
//!
//! Positions are UTM coordinates in metres, in the zone and hemisphere of the world's origin. A zone may be given; it
//! must then equal the world's. Headings are degrees counter-clockwise from east. The origin of the world's frame
//! `global` is the world's origin, and its axes are easting and northing, so a position in it is a difference of UTM
//! coordinates.

use crate::read::{SceneError, Table};
use rcs_geom::{DVec2, Utm};
use std::ops::RangeInclusive;
use toml::de::DeValue;

/// The content of a course file.
#[derive(Clone, Debug, PartialEq)]
pub struct Course {
    /// Name in reports.
    pub name: String,
    /// One sentence.
    pub description: String,
    /// File of the world, by name or path.
    pub world: String,
    /// File of the vehicle, by name or path, if the course names one.
    pub vehicle: Option<String>,
    /// File of the look of the world, by name or path, if the course names one.
    pub look: Option<String>,
    /// Position of the vehicle at the start.
    pub start: UtmPosition,
    /// Heading of the vehicle at the start, radians counter-clockwise from east.
    pub start_heading_rad: f64,
    /// Position of the goal.
    pub goal: UtmPosition,
    /// Distance from the goal at which it counts as reached, m.
    pub goal_radius_m: f64,
    /// Time limit, s; the run fails when it passes.
    pub time_limit_s: f64,
}

/// A UTM position of a course.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UtmPosition {
    /// The zone in the file; `None` for the zone of the world.
    pub zone: Option<u8>,
    /// m.
    pub easting_m: f64,
    /// m.
    pub northing_m: f64,
}

/// A position is in another zone than the world.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("course is in zone {got}, expected the world's zone {expected}")]
pub struct WrongZone {
    /// Zone of the course.
    pub got: u8,
    /// Zone of the world.
    pub expected: u8,
}

impl UtmPosition {
    /// Position relative to the world's origin, east and north, m.
    pub fn in_world(&self, origin: &Utm) -> Result<DVec2, WrongZone> {
        match self.zone {
            Some(got) if got != origin.zone => Err(WrongZone { got, expected: origin.zone }),
            _ => Ok(origin.offset_to(self.easting_m, self.northing_m)),
        }
    }
}

const EASTING_M: RangeInclusive<f64> = 0.0..=1.0e6;
const NORTHING_M: RangeInclusive<f64> = 0.0..=1.0e7;

/// Greatest number of corners of a polygon, and of zones.
const MOST: usize = 1000;

impl Course {
    /// Parses a course file. Missing, unknown and out-of-range keys are refused with line and key.
    pub fn from_toml(text: &str) -> Result<Course, SceneError> {
        let mut table = Table::open(text)?;
        table.need_format(1.0)?;
        let name = table.need_text("name")?;
        let description = table.text("description")?.unwrap_or_default();
        let world = named(&mut table, "world")?.ok_or_else(|| {
            table.error("world", "is missing, expected the name of a world or the path of its file")
        })?;
        let vehicle = named(&mut table, "vehicle")?;
        let look = named(&mut table, "look")?;
        let goal_radius_m = table.number_or("goal_radius_m", 1.5, 0.1..=100.0)?;
        let time_limit_s = table.need_number("time_limit_s", 1.0..=36_000.0)?;
        let (start, heading_deg) = place(&mut table, "start", true)?;
        let (goal, _) = place(&mut table, "goal", false)?;
        if let Some(area) = table.take("area") {
            check_polygon(&table, "area", area.get_ref())?;
        }
        if let Some(zones) = table.take("keep_out") {
            let list = zones.get_ref().as_array().filter(|list| list.len() <= MOST);
            let expected = || table.error("keep_out", format!("expected a list of at most {MOST} polygons"));
            let list = list.ok_or_else(expected)?;
            list.iter().try_for_each(|zone| check_polygon(&table, "keep_out", zone.get_ref()))?;
        }
        table.finish()?;
        let start_heading_rad = heading_deg.to_radians();
        Ok(Course {
            name,
            description,
            world,
            vehicle,
            look,
            start,
            start_heading_rad,
            goal,
            goal_radius_m,
            time_limit_s,
        })
    }

    /// The line of a key in the text of a course, from 1; 1 if there is no such key.
    pub fn line_of(text: &str, key: &str) -> usize {
        Table::open(text).map_or(1, |table| table.error(key, "").line)
    }
}

/// Refuses a value that is no polygon: 3 to [`MOST`] corners [easting, northing], UTM, m.
fn check_polygon(table: &Table<'_>, key: &str, value: &DeValue<'_>) -> Result<(), SceneError> {
    let expected = || table.error(key, "expected [[easting, northing], …]");
    let corners = value.as_array().ok_or_else(expected)?;
    for corner in corners {
        let Some([easting, northing]) = corner.get_ref().as_array().map(|pair| &**pair) else {
            return Err(expected());
        };
        table.number_in(key, easting.get_ref(), &EASTING_M)?;
        table.number_in(key, northing.get_ref(), &NORTHING_M)?;
    }
    let count = corners.len();
    if (3..=MOST).contains(&count) {
        return Ok(());
    }
    Err(table.error(key, format!("a polygon has {count} corners, expected 3 to {MOST}")))
}

/// The name of a file; an empty one is refused.
fn named(table: &mut Table<'_>, key: &'static str) -> Result<Option<String>, SceneError> {
    match table.text(key)? {
        Some(name) if name.trim().is_empty() => {
            Err(table.error(key, "is empty, expected a name or the path of a file"))
        }
        name => Ok(name),
    }
}

/// A position, and the heading there in degrees (0 if the position has none).
fn place(
    table: &mut Table<'_>,
    key: &'static str,
    has_heading: bool,
) -> Result<(UtmPosition, f64), SceneError> {
    let Some(mut entry) = table.table(key)? else {
        let heading = if has_heading { ", heading_deg" } else { "" };
        return Err(table.error(key, format!("is missing, expected {{ easting, northing{heading} }}")));
    };
    let zone = entry.integer("zone", 1..=60)?.map(|zone| zone as u8);
    let easting_m = entry.need_number("easting", EASTING_M)?;
    let northing_m = entry.need_number("northing", NORTHING_M)?;
    let heading_deg = if has_heading { entry.need_number("heading_deg", -360.0..=360.0)? } else { 0.0 };
    entry.finish()?;
    Ok((UtmPosition { zone, easting_m, northing_m }, heading_deg))
}

#[cfg(test)]
mod tests {
    use super::*;

    const SOUND: &str = r#"format = 1
name = "meadow"
description = "trees and bushes"
world = "meadow"
vehicle = "lagr"
time_limit_s = 240
goal_radius_m = 2.0

[start]
zone = 18
easting = 309030.5
northing = 4335020
heading_deg = 90

[goal]
easting = 309030.0
northing = 4335120.0
"#;

    /// Changes one line of a valid file and returns the error.
    fn check(from: &str, to: &str, refusal: &str) {
        let text = SOUND.replace(from, to);
        assert_ne!(text, SOUND, "nothing was changed");
        let error = Course::from_toml(&text).unwrap_err().to_string();
        assert!(error.contains(refusal), "got {error:?}, expected {refusal:?}");
    }

    #[test]
    fn a_sound_file_is_read() {
        let zones = "area = [[1, 2], [3, 4], [5, 6]]\nkeep_out = []\n";
        assert_eq!(Course::from_toml(&format!("{zones}{SOUND}")), Course::from_toml(SOUND));
        let course = Course::from_toml(SOUND).unwrap();
        assert_eq!((course.name.as_str(), course.vehicle.as_deref()), ("meadow", Some("lagr")));
        assert_eq!((course.time_limit_s, course.goal_radius_m), (240.0, 2.0));
        assert!((course.start_heading_rad - std::f64::consts::FRAC_PI_2).abs() < 1e-15);
        let origin = Utm::new(18, true, 309_000.0, 4_335_000.0).unwrap();
        assert_eq!(course.start.in_world(&origin), Ok(DVec2::new(30.5, 20.0)));
        assert_eq!(course.goal.in_world(&origin), Ok(DVec2::new(30.0, 120.0)));
    }

    #[test]
    fn a_place_in_another_zone_than_the_world_is_refused() {
        let course = Course::from_toml(SOUND).unwrap();
        let origin = Utm::new(17, true, 309_000.0, 4_335_000.0).unwrap();
        let error = course.start.in_world(&origin).unwrap_err();
        assert_eq!(error.to_string(), "course is in zone 18, expected the world's zone 17");
        assert!(course.goal.in_world(&origin).is_ok(), "a place without a zone is in the world's");
    }

    #[test]
    fn mistakes_are_refused_with_their_line_and_key() {
        check("format = 1", "format = 2", "line 1, key \"format\": got 2, expected 1");
        check("world = \"meadow\"", "world = \"\"", "line 4, key \"world\": is empty");
        check("world = \"meadow\"\n", "", "key \"world\": is missing");
        check("vehicle = \"lagr\"", "look = \" \"", "line 5, key \"look\": is empty");
        check("time_limit_s = 240", "time_limit_s = 0", "line 6, key \"time_limit_s\": got 0");
        check("time_limit_s = 240", "time_limit_s = nan", "line 6, key \"time_limit_s\"");
        check("goal_radius_m = 2.0", "goal_radius = 2.0", "line 7, key \"goal_radius\": is unknown");
        check("zone = 18", "zone = 18.5", "line 10, key \"start.zone\"");
        check("easting = 309030.5", "easting = \"309030\"", "line 11, key \"start.easting\"");
        check("heading_deg = 90\n", "", "line 9, key \"start.heading_deg\": is missing");
        check("northing = 4335120.0", "northing = -1.0", "line 17, key \"goal.northing\": got -1");
        check("[goal]", "[finish]", "key \"goal\": is missing");
        check("name = \"meadow\"", "name = \"meadow", "line 2");
        // Not all digits of a great number.
        check("time_limit_s = 240", "time_limit_s = 1e300", "got 1e300, expected");
    }

    #[test]
    fn an_area_and_zones_are_refused_with_their_line_by_whoever_reads_the_course() {
        let line = "goal_radius_m = 2.0";
        for (zones, refusal) in [
            ("area = []", "key \"area\": a polygon has 0 corners, expected 3 to 1000"),
            ("area = [[1, 2], [3, 4]]", "key \"area\": a polygon has 2 corners"),
            ("area = [[1, 2], [nan, 4333600], [5, 6]]", "key \"area\": got NaN, expected a number"),
            ("area = [[1, 2], [3, -1], [5, 6]]", "key \"area\": got -1, expected a number"),
            ("area = 3", "key \"area\": expected [["),
            ("keep_out = [[1, 2], [3, 4], [5, 6]]", "key \"keep_out\": expected [["),
            ("keep_out = [[[1, 2], [3, 4]]]", "key \"keep_out\": a polygon has 2 corners"),
            ("keep_out = 'x'", "key \"keep_out\": expected a list"),
        ] {
            check(line, zones, &format!("line 7, {refusal}"));
        }
    }

    #[test]
    fn the_line_of_a_key_is_found_in_both_ways_to_write_a_table() {
        assert_eq!(Course::line_of(SOUND, "goal"), 15);
        assert_eq!(Course::line_of("goal_radius_m = 1\ngoal = { easting = 1.0 }\n", "goal"), 2);
        assert_eq!(Course::line_of(SOUND, "absent"), 1);
    }
}
