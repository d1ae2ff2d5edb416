//! Where the vehicle may drive: an area that it does not leave, and zones that it does not enter.
//!
//! A goal file may have `area = [[easting, northing], …]` and `keep_out = [[[easting, northing], …], …]`, UTM, m, in the
//! zone of the goal. The operator's mission may have both, too.

use crate::goal::line_of_key;
use rcs_geom::{DVec2, Utm};
use serde::{Deserialize, Serialize};

/// Greatest number of corners of a polygon, and of zones.
const MOST: usize = 1000;

/// A closed polygon; the last corner is joined to the first.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Polygon(Vec<(f64, f64)>);

impl Polygon {
    /// A polygon with these corners, m.
    pub fn new(corners: impl IntoIterator<Item = DVec2>) -> Result<Polygon, String> {
        let corners: Vec<(f64, f64)> = corners.into_iter().map(|corner| (corner.x, corner.y)).collect();
        let count = corners.len();
        if !(3..=MOST).contains(&count) {
            return Err(format!("a polygon has {count} corners, expected 3 to {MOST}"));
        }
        match corners.iter().find(|(x, y)| !(x.is_finite() && y.is_finite())) {
            Some(corner) => Err(format!("a corner of a polygon is {corner:?}, expected finite numbers")),
            None => Ok(Polygon(corners)),
        }
    }

    /// The corners, m.
    pub fn corners(&self) -> impl Iterator<Item = DVec2> + Clone {
        self.0.iter().copied().map(DVec2::from)
    }

    /// Its edges.
    fn edges(&self) -> impl Iterator<Item = (DVec2, DVec2)> {
        self.corners().zip(self.corners().cycle().skip(1))
    }

    /// Whether a position lies inside, by counting crossings.
    pub fn contains(&self, at: DVec2) -> bool {
        is_inside(self.crossings(at.y), at.x)
    }

    /// Where its edges cross the line at this y, x, m.
    fn crossings(&self, y: f64) -> impl Iterator<Item = f64> {
        let edges = self.edges().filter(move |(a, b)| (a.y > y) != (b.y > y));
        edges.map(move |(a, b)| a.x + (y - a.y) / (b.y - a.y) * (b.x - a.x))
    }

    /// Distance of a position from the border, m.
    pub fn border_m(&self, at: DVec2) -> f64 {
        let distance_m = |(a, b): (DVec2, DVec2)| {
            let along = ((at - a).dot(b - a) / (b - a).length_squared().max(1e-12)).clamp(0.0, 1.0);
            at.distance(a + (b - a) * along)
        };
        self.edges().map(distance_m).fold(f64::INFINITY, f64::min)
    }

    /// The polygon with each corner moved by a function.
    #[must_use]
    pub fn moved(&self, by: impl Fn(DVec2) -> DVec2) -> Polygon {
        Polygon(self.corners().map(by).map(|corner| (corner.x, corner.y)).collect())
    }
}

/// An area and zones, m.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Zones {
    /// The vehicle does not leave it; `None` for no bounds.
    pub area: Option<Polygon>,
    /// Whether the area is where the world ends, and nobody has stated it.
    pub is_area_of_world: bool,
    /// The vehicle enters none of them.
    pub keep_out: Vec<Polygon>,
}

impl Zones {
    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.area.is_none() && self.keep_out.is_empty()
    }

    /// What is left of them without those that somebody has stated: the area in which the world lies, or nothing.
    #[must_use]
    pub fn not_stated(&self) -> Zones {
        let area = self.area.clone().filter(|_| self.is_area_of_world);
        Zones { is_area_of_world: area.is_some(), area, keep_out: Vec::new() }
    }

    /// Whether a position is outside of the area or inside of a zone.
    pub fn forbid(&self, at: DVec2) -> bool {
        self.forbid_along(at.y)(at.x)
    }

    /// [`Zones::forbid`] for each x on the line at this y, with less computation for many of them.
    pub fn forbid_along(&self, y: f64) -> impl Fn(f64) -> bool {
        let crossings = |polygon: &Polygon| polygon.crossings(y).collect::<Vec<f64>>();
        let area = self.area.as_ref().map(crossings);
        let keep_out: Vec<_> = self.keep_out.iter().map(crossings).filter(|xs| !xs.is_empty()).collect();
        let is_in = |crossings: &Vec<f64>, x: f64| is_inside(crossings.iter().copied(), x);
        move |x| {
            area.as_ref().is_some_and(|area| !is_in(area, x)) || keep_out.iter().any(|zone| is_in(zone, x))
        }
    }

    /// How far a position is from where it would be allowed, m; 0 where it is.
    pub fn trespass_m(&self, at: DVec2) -> f64 {
        let outside = self.area.iter().filter(|area| !area.contains(at));
        let inside = self.keep_out.iter().filter(|zone| zone.contains(at));
        outside.chain(inside).map(|polygon| polygon.border_m(at)).fold(0.0, f64::max)
    }

    /// Whether the border of a zone lies between two positions.
    pub fn separate(&self, a: DVec2, b: DVec2) -> bool {
        self.keep_out.iter().any(|zone| zone.edges().any(|edge| do_cross((a, b), edge)))
    }

    /// Calls a function with points along the borders of the zones, at most a step from each other, m, within
    /// a rectangle from its lowest to its highest corner.
    pub fn along_borders(&self, [low, high]: [DVec2; 2], step_m: f64, mut visit: impl FnMut(DVec2)) {
        for zone in &self.keep_out {
            for (a, b) in zone.edges() {
                let along = b - a;
                let (mut from, mut to) = (0.0_f64, 1.0_f64);
                // An edge parallel to an axis is there everywhere or nowhere: the quotients are infinite.
                for (start, by, low, high) in [(a.x, along.x, low.x, high.x), (a.y, along.y, low.y, high.y)] {
                    let (first, last) = ((low - start) / by, (high - start) / by);
                    from = from.max(first.min(last));
                    to = to.min(first.max(last));
                }
                if from > to {
                    continue;
                }
                let (first, last) = (a + along * from, a + along * to);
                let steps = (first.distance(last) / step_m).ceil().max(1.0) as u32;
                for step in 0..=steps {
                    visit(first.lerp(last, f64::from(step) / f64::from(steps)));
                }
            }
        }
    }

    /// Zones with each corner moved by a function.
    #[must_use]
    pub fn moved(&self, by: impl Fn(DVec2) -> DVec2) -> Zones {
        Zones {
            area: self.area.as_ref().map(|area| area.moved(&by)),
            is_area_of_world: self.is_area_of_world,
            keep_out: self.keep_out.iter().map(|zone| zone.moved(&by)).collect(),
        }
    }

    /// The zones of a goal file in the global frame with this origin, m; without an area there, the bounds of the world
    /// file less a margin. An error says in which file, and the line of the goal file.
    pub fn from_toml(goal: &str, world: &str, origin: &Utm, margin_m: f64) -> Result<Zones, String> {
        let parse = |text: &str| toml::from_str::<toml::Table>(text).map_err(|error| error.to_string());
        let file = parse(goal).map_err(|error| format!("goal: {error}"))?;
        let in_goal =
            |key: &str, error: String| format!("goal: line {}, {key}: {error}", line_of_key(goal, key));
        let in_global = |place: DVec2| place - DVec2::new(origin.easting_m, origin.northing_m);
        let polygon = |key: &str, value: &toml::Value| {
            let polygon = corners(value).and_then(|corners| Polygon::new(corners.into_iter().map(in_global)));
            polygon.map_err(|error| in_goal(key, error))
        };
        let area = file.get("area").map(|value| polygon("area", value)).transpose()?;
        let keep_out = match file.get("keep_out") {
            None => Vec::new(),
            Some(toml::Value::Array(zones)) if zones.len() <= MOST => {
                let zones = zones.iter().map(|zone| polygon("keep_out", zone));
                zones.collect::<Result<_, _>>()?
            }
            Some(_) => {
                return Err(in_goal("keep_out", format!("expected a list of at most {MOST} polygons")));
            }
        };
        let bounds = || parse(world).and_then(|world| bounds(&world, margin_m));
        if area.is_some() {
            return Ok(Zones { area, keep_out, ..Zones::default() });
        }
        let area = bounds().map_err(|error| format!("world: {error}"))?;
        Ok(Zones { is_area_of_world: area.is_some(), area, keep_out })
    }
}

/// Whether a position on a line lies inside of a polygon whose edges cross the line there.
fn is_inside(crossings: impl Iterator<Item = f64>, x: f64) -> bool {
    crossings.filter(|&at| x < at).count() % 2 == 1
}

/// Whether two segments cross each other.
fn do_cross((a, b): (DVec2, DVec2), (c, d): (DVec2, DVec2)) -> bool {
    let is_left = |from: DVec2, to: DVec2, at: DVec2| (to - from).perp_dot(at - from) > 0.0;
    is_left(c, d, a) != is_left(c, d, b) && is_left(a, b, c) != is_left(a, b, d)
}

/// The area within the bounds of a world file less a margin, m; `None` if it states none.
fn bounds(world: &toml::Table, margin_m: f64) -> Result<Option<Polygon>, String> {
    let Some(value) = world.get("bounds_m") else { return Ok(None) };
    let corners = points(value).filter(|corners| corners.iter().all(|corner| corner.is_finite()));
    let Some([low, high]) = corners.as_deref() else {
        return Err(format!("bounds_m is {value}, expected [[x, y], [x, y]], the lowest and the highest, m"));
    };
    let (low, high) = (*low + margin_m, *high - margin_m);
    if low.x >= high.x || low.y >= high.y {
        return Err(format!("bounds_m is {value}, which leaves nothing within a margin of {margin_m} m"));
    }
    let corners = [low, DVec2::new(high.x, low.y), high, DVec2::new(low.x, high.y)];
    Polygon::new(corners).map(Some)
}

/// The corners of a polygon of a goal file, UTM, m. An error says them as they are in the file.
fn corners(value: &toml::Value) -> Result<Vec<DVec2>, String> {
    let corners = points(value).ok_or("expected [[easting, northing], …]")?;
    match corners.iter().find(|corner| !corner.is_finite()) {
        Some(corner) => Err(format!("a corner of a polygon is {corner}, expected finite numbers")),
        None => Ok(corners),
    }
}

/// A list of pairs of numbers.
fn points(value: &toml::Value) -> Option<Vec<DVec2>> {
    let number = |value: &toml::Value| value.as_float().or(value.as_integer().map(|n| n as f64));
    let point = |value: &toml::Value| match value.as_array()?.as_slice() {
        [x, y] => Some(DVec2::new(number(x)?, number(y)?)),
        _ => None,
    };
    value.as_array()?.iter().map(point).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(low: f64, high: f64) -> Polygon {
        let corners = [(low, low), (high, low), (high, high), (low, high)];
        Polygon::new(corners.map(DVec2::from)).unwrap()
    }

    #[test]
    fn inside_and_distance_from_the_border() {
        let zone = square(0.0, 10.0);
        assert!(zone.contains(DVec2::new(5.0, 9.9)) && !zone.contains(DVec2::new(5.0, 10.1)));
        assert!((zone.border_m(DVec2::new(5.0, 8.0)) - 2.0).abs() < 1e-9);
        assert!((zone.border_m(DVec2::new(13.0, 14.0)) - 5.0).abs() < 1e-9);
        // Not convex: a notch from the right.
        let corners =
            [(0.0, 0.0), (10.0, 0.0), (10.0, 4.0), (5.0, 5.0), (10.0, 6.0), (10.0, 10.0), (0.0, 10.0)];
        let notched = Polygon::new(corners.map(DVec2::from)).unwrap();
        assert!(!notched.contains(DVec2::new(8.0, 5.0)) && notched.contains(DVec2::new(4.0, 5.0)));
    }

    #[test]
    fn outside_of_the_area_and_inside_of_a_zone_are_forbidden() {
        let zones =
            Zones { area: Some(square(-20.0, 20.0)), keep_out: vec![square(0.0, 10.0)], ..Zones::default() };
        for (at, trespass_m) in [((-5.0, -5.0), 0.0), ((5.0, 8.0), 2.0), ((23.0, 0.0), 3.0)] {
            let at = DVec2::from(at);
            assert!((zones.trespass_m(at) - trespass_m).abs() < 1e-9, "{at}");
            assert_eq!(zones.forbid(at), trespass_m > 0.0, "{at}");
        }
        for (x, y) in (-50..50).flat_map(|x| (-50..50).map(move |y| (f64::from(x) * 0.5, f64::from(y) * 0.5)))
        {
            let at = DVec2::new(x, y);
            let [area, zone] = [zones.area.as_ref().unwrap(), &zones.keep_out[0]];
            assert_eq!(zones.forbid_along(y)(x), !area.contains(at) || zone.contains(at), "{at}");
        }
    }

    #[test]
    fn a_border_separates_what_lies_on_its_two_sides_as_far_as_it_goes() {
        let zones =
            Zones { area: Some(square(-20.0, 20.0)), keep_out: vec![square(0.0, 10.0)], ..Zones::default() };
        let separate = |a: (f64, f64), b: (f64, f64)| zones.separate(DVec2::from(a), DVec2::from(b));
        assert!(separate((-1.0, 5.0), (1.0, 5.0)), "into the zone");
        assert!(separate((-1.0, 5.0), (11.0, 5.0)), "through the zone");
        assert!(!separate((-1.0, 5.0), (-0.5, 9.0)), "along the zone");
        assert!(!separate((-1.0, 11.0), (11.0, 10.5)), "past its corner");
        assert!(!separate((-30.0, 0.0), (-10.0, 0.0)), "the border of the area");
    }

    #[test]
    fn points_along_the_borders_lie_close_together_and_within_the_rectangle() {
        let zones =
            Zones { area: Some(square(-5.0, 5.0)), keep_out: vec![square(0.0, 1e6)], ..Zones::default() };
        let mut points = Vec::new();
        zones.along_borders([DVec2::splat(-2.0), DVec2::splat(3.0)], 0.1, |at| points.push(at));
        let on_border =
            |at: &DVec2| at.x.min(at.y).abs() < 1e-9 && (-1e-9..3.0 + 1e-9).contains(&at.x.max(at.y));
        assert!(points.iter().all(on_border), "{points:?}");
        assert!((60..=64).contains(&points.len()), "{}", points.len());
    }

    #[test]
    fn a_goal_file_names_zones_and_the_world_bounds_the_area_else() {
        let origin = Utm::new(18, true, 1000.0, 2000.0).unwrap();
        let world = "bounds_m = [[0, 0], [130, 90.0]]";
        let zones = |goal| Zones::from_toml(goal, world, &origin, 1.0);
        let bounded = zones("goal = { easting = 1.0, northing = 1.0 }").unwrap();
        assert_eq!(bounded.not_stated(), bounded);
        let corners: Vec<DVec2> = bounded.area.unwrap().corners().collect();
        assert_eq!((corners[0], corners[2]), (DVec2::ONE, DVec2::new(129.0, 89.0)));
        let named = "area = [[1000, 2000], [1010, 2000], [1000, 2010]]\nkeep_out = [[[1001, 2001], [1002, 2001], [1001, 2002]]]";
        let named = zones(named).unwrap();
        assert_eq!(named.not_stated(), Zones::default());
        assert!(named.area.unwrap().contains(DVec2::new(2.0, 2.0)) && named.keep_out.len() == 1);
        assert_eq!(Zones::from_toml("", "", &origin, 1.0), Ok(Zones::default()));
        for (goal, expected) in [
            ("area = 3", "goal: line 1, area: expected [["),
            ("area = [[1, 2], [3, 4]]", "goal: line 1, area: a polygon has 2 corners"),
            (
                "area = [[1, 2], [nan, 4333600], [5, 6]]",
                "goal: line 1, area: a corner of a polygon is [NaN, 4333600], expected finite",
            ),
            ("keep_out = [[1, 2]]", "goal: line 1, keep_out: expected [["),
            ("keep_out = 'x'", "goal: line 1, keep_out: expected a list"),
            ("name = 'a'\n\narea = [[1, 2]]", "goal: line 3, area: a polygon has 1 corners"),
        ] {
            let error = zones(goal).unwrap_err();
            assert!(error.starts_with(expected), "{goal}: {error}");
        }
        // Bounds that cannot be read are not none.
        for bounds in ["'x'", "[[0, 0], [1, 2], [3, 4]]", "[[0, 0], [nan, 90]]"] {
            let error = Zones::from_toml("", &format!("bounds_m = {bounds}"), &origin, 1.0).unwrap_err();
            assert!(error.starts_with("world: bounds_m is ") && error.contains("expected [["), "{error}");
        }
        let error = Zones::from_toml("", world, &origin, 50.0).unwrap_err();
        assert!(error.ends_with("which leaves nothing within a margin of 50 m"), "{error}");
    }
}
