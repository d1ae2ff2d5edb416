//! Path memory: what is left of a run's track after loops and excursions are cut, and its file.
//!
//! Albus 2006a, 5: after a run, "loops and excursions" are removed from the path, which is saved in global coordinates;
//! the planner of the next run weighs it with the map rather than following it blindly.
//!
//! A loop ends where the track comes near a place where it was before: from each point, the track continues at the last
//! later point that is near. A way into a dead end and out again, which may lie metres apart, is cut by the map
//! ([`crate::shortcut`]).

use crate::goal::Goal;
use crate::proto::{Route, RoutePoint};
use rcs_geom::{DVec2, Pose, Utm};
use rcs_msg::foxglove::{self, FrameTransforms};
use rcs_sense::pose_of;

/// Version of the file.
const FORMAT: u32 = 1;
/// Greatest number of points of a route.
const MOST_POINTS: usize = 20_000;
/// Greatest distance of what is remembered from the origin of the global frame, m: planners take coordinates up to 1000 km.
pub(crate) const MOST_M: f64 = 900_000.0;
/// How far ahead of the end of a route the goal is taken to be, m: a run ends where the vehicle comes near to the goal, with
/// the goal ahead of it.
const AHEAD_M: f64 = 0.75;
/// Distance before its end from which a route has its last direction, m.
const DIRECTION_M: f64 = 1.0;

/// Why a text is no route, or does not fit.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RouteError {
    /// The text is not the JSON of a route.
    #[error("{0}")]
    Text(String),
    /// The file has another version.
    #[error("format is {0}, expected {FORMAT}")]
    Format(u32),
    /// A number is not finite, or there are too few or too many points.
    #[error("{count} points, expected 2 to {MOST_POINTS} with finite coordinates")]
    Points {
        /// Number of points.
        count: usize,
    },
    /// The route is in another zone than the global frame.
    #[error("the route is in UTM zone {got}, expected zone {expected} of the global frame's origin")]
    Zone {
        /// Zone of the route.
        got: u32,
        /// Zone of the origin.
        expected: u8,
    },
    /// A point lies so far away that the planners cannot be told of it.
    #[error(
        "a point is at easting {easting_m:?} m and northing {northing_m:?} m, expected at most {MOST_M} m from the origin of the global frame"
    )]
    Far {
        /// Easting of the point, m.
        easting_m: f64,
        /// Northing of the point, m.
        northing_m: f64,
    },
    /// The route leads elsewhere.
    #[error("the route ends {distance_m:.1} m from the goal, expected at most {within_m} m")]
    Goal {
        /// Distance, m.
        distance_m: f64,
        /// Greatest accepted distance, m.
        within_m: f64,
    },
}

/// The points of a track without its loops and excursions. Points nearer than `near_m` count as the same place.
pub fn cut(track: &[DVec2], near_m: f64) -> Vec<DVec2> {
    let cells = Cells::of(track, near_m);
    let mut kept = Vec::new();
    let mut at = 0;
    while let Some(&point) = track.get(at) {
        kept.push(point);
        let back = cells.last_near(at);
        at = back.unwrap_or(at + 1);
        if back.is_some() && at + 1 < track.len() {
            // The point itself is near the one that is kept already.
            at += 1;
        }
    }
    kept
}

/// The points of a track by the cells in which they lie: all that are near a point lie in its cell or in one beside it.
struct Cells<'a> {
    track: &'a [DVec2],
    /// Distance within which points are near, m.
    near_m: f64,
    /// Cell and index of each point, sorted.
    sorted: Vec<([i64; 2], usize)>,
}

impl<'a> Cells<'a> {
    fn of(track: &'a [DVec2], near_m: f64) -> Cells<'a> {
        let mut cells = Cells { track, near_m, sorted: Vec::new() };
        cells.sorted = (0..track.len()).map(|at| (cells.cell(at), at)).collect();
        cells.sorted.sort_unstable();
        cells
    }

    /// The cell of a point. Cells are a little larger than the distance, so that rounding puts no near point two cells away.
    fn cell(&self, at: usize) -> [i64; 2] {
        let cell = self.track[at] / (1.01 * self.near_m);
        [cell.x.floor() as i64, cell.y.floor() as i64]
    }

    /// Index of the last point of the track that is near a point, and comes after it.
    fn last_near(&self, at: usize) -> Option<usize> {
        let [x, y] = self.cell(at);
        let around = (-1..=1).flat_map(|column| (-1..=1).map(move |row| [column, row]));
        let cells = around.map(|[column, row]| [x.saturating_add(column), y.saturating_add(row)]);
        cells.filter_map(|cell| self.last_near_in(cell, at)).max()
    }

    /// The same of the points in a cell.
    fn last_near_in(&self, cell: [i64; 2], at: usize) -> Option<usize> {
        let from = self.sorted.partition_point(|&entry| entry <= (cell, at));
        let to = self.sorted.partition_point(|&(other, _)| other <= cell);
        let is_near = |&index: &usize| self.track[index].distance(self.track[at]) < self.near_m;
        self.sorted[from..to].iter().rev().map(|&(_, index)| index).find(is_near)
    }
}

/// Length of a track, m.
pub fn length_m(track: &[DVec2]) -> f64 {
    track.windows(2).map(|pair| pair[0].distance(pair[1])).sum()
}

/// The global frame of the run that drove the route in the local frame of this one, as the remembered map was registered;
/// `None` while it is not, or in another frame.
pub fn registered(message: &FrameTransforms, local_frame: &str) -> Option<Pose> {
    let transform =
        message.transforms.first().filter(|transform| transform.parent_frame_id == local_frame)?;
    let pose = foxglove::Pose { position: transform.translation, orientation: transform.rotation };
    pose_of(Some(&pose), local_frame).ok()
}

/// Where the run began that drove the route, in the global frame with this origin as that run knew it, m.
pub fn start(route: &Route, origin: &Utm) -> Option<DVec2> {
    let point = route.points.first().filter(|_| route.zone == u32::from(origin.zone))?;
    Some(origin.offset_to(point.easting_m, point.northing_m))
}

/// Where the goal of a run that drove this route was, in the frame of the points, m; `None` for a route without a length.
pub fn finish(points: &[DVec2]) -> Option<DVec2> {
    let &end = points.last()?;
    let before = points.iter().rev().find(|point| point.distance(end) >= DIRECTION_M).or(points.first())?;
    Some(end + (end - *before).try_normalize()? * AHEAD_M)
}

/// The route of a way in the global frame with this origin, which is left of `driven_m`. One that has too many points is
/// thinned evenly, with both ends.
pub fn to_message(way: &[DVec2], driven_m: f64, origin: &Utm, time_s: f64) -> Route {
    let point =
        |at: &DVec2| RoutePoint { easting_m: origin.easting_m + at.x, northing_m: origin.northing_m + at.y };
    Route {
        format: FORMAT,
        zone: u32::from(origin.zone),
        points: thinned(way).map(point).collect(),
        length_m: length_m(way),
        cut_m: driven_m - length_m(way),
        time_s,
    }
}

/// At most [`MOST_POINTS`] points of a way.
fn thinned(way: &[DVec2]) -> impl Iterator<Item = &DVec2> {
    let every = way.len().div_ceil(MOST_POINTS - 1).max(1);
    let end = way.last().filter(|_| !way.len().saturating_sub(1).is_multiple_of(every));
    way.iter().step_by(every).chain(end)
}

/// The route in a text; `None` for an empty one, and for one without points, as of a run that was told to forget it.
pub fn parse(text: &str) -> Result<Option<Route>, RouteError> {
    if text.trim().is_empty() {
        return Ok(None);
    }
    let route: Route = rcs_msg::from_json(text).map_err(|error| RouteError::Text(error.to_string()))?;
    if route.format != FORMAT {
        return Err(RouteError::Format(route.format));
    }
    let count = route.points.len();
    if count == 0 {
        return Ok(None);
    }
    let finite = route.points.iter().all(|point| point.easting_m.is_finite() && point.northing_m.is_finite());
    if !finite || !(2..=MOST_POINTS).contains(&count) {
        return Err(RouteError::Points { count });
    }
    Ok(Some(route))
}

/// The points of a route in the global frame, m, if it leads to the goal.
pub fn in_global(route: &Route, origin: &Utm, goal: DVec2, within_m: f64) -> Result<Vec<DVec2>, RouteError> {
    if route.zone != u32::from(origin.zone) {
        return Err(RouteError::Zone { got: route.zone, expected: origin.zone });
    }
    let global = |point: &RoutePoint| {
        let goal = Goal { zone: None, easting_m: point.easting_m, northing_m: point.northing_m };
        goal.in_global(origin).unwrap_or(DVec2::ZERO)
    };
    let points: Vec<DVec2> = route.points.iter().map(global).collect();
    let far = std::iter::zip(&route.points, &points).find(|(_, at)| at.length() > MOST_M);
    if let Some((point, _)) = far {
        return Err(RouteError::Far { easting_m: point.easting_m, northing_m: point.northing_m });
    }
    let distance_m = points.last().map_or(f64::INFINITY, |end| end.distance(goal));
    if distance_m > within_m {
        return Err(RouteError::Goal { distance_m, within_m });
    }
    Ok(points)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn line(from: (f64, f64), to: (f64, f64)) -> Vec<DVec2> {
        let (from, to) = (DVec2::from(from), DVec2::from(to));
        let count = (from.distance(to) / 0.5).round() as u32;
        (0..count).map(|at| from.lerp(to, f64::from(at) / f64::from(count))).collect()
    }

    #[test]
    fn excursions_and_loops_are_cut_and_what_leads_on_stays() {
        // Ahead, 10 m into a dead end and back, ahead, a loop, and on.
        let mut track = line((0.0, 0.0), (10.0, 0.0));
        track.extend(line((10.0, 0.0), (10.0, 10.0)));
        track.extend(line((10.2, 10.0), (10.2, 0.0)));
        track.extend(line((10.2, 0.0), (20.0, 0.0)));
        for step in 0..40 {
            let angle = f64::from(step) / 40.0 * std::f64::consts::TAU;
            track.push(DVec2::new(20.0 + 3.0 * libm::sin(angle), 3.0 - 3.0 * libm::cos(angle)));
        }
        track.extend(line((20.0, 0.0), (30.0, 0.0)));
        let kept = cut(&track, 1.0);
        assert!((length_m(&kept) - 29.5).abs() < 1.0, "{} of {}", length_m(&kept), length_m(&track));
        assert!(kept.iter().all(|point| point.y < 1.1), "{kept:?}");
        assert_eq!((kept[0], kept.last()), (track[0], track.last()));
        let straight = line((0.0, 0.0), (10.0, 0.0));
        assert!((length_m(&cut(&straight, 0.4)) - length_m(&straight)).abs() < 1e-9);
    }

    /// [`cut`] by a search through all points.
    fn reference_cut(track: &[DVec2], near_m: f64) -> Vec<DVec2> {
        let mut kept = Vec::new();
        let mut at = 0;
        while let Some(&point) = track.get(at) {
            kept.push(point);
            let back = track[at + 1..].iter().rposition(|later| later.distance(point) < near_m);
            at = back.map_or(at + 1, |back| at + 1 + back);
            if back.is_some() && at + 1 < track.len() {
                at += 1;
            }
        }
        kept
    }

    proptest! {
        #[test]
        fn a_track_is_cut_as_by_a_search_through_all_its_points(
            steps in prop::collection::vec(prop::array::uniform2(-8..=8_i32), 0..300),
            step_m in prop::sample::select(vec![0.0, 0.05, 0.25, 0.4]),
            start_m in prop::sample::select(vec![0.0, -412_345.6]),
            near_m in prop::sample::select(vec![0.3, 0.5, 1.0, 2.0]),
        ) {
            let mut at = DVec2::splat(start_m);
            let track: Vec<DVec2> = steps.iter().map(|&[east, north]| {
                at += step_m * DVec2::new(f64::from(east), f64::from(north));
                at
            }).collect();
            prop_assert_eq!(cut(&track, near_m), reference_cut(&track, near_m));
        }
    }

    #[test]
    fn rounds_are_cut_as_by_a_search_through_all_their_points() {
        let round = |step: u32| {
            let angle = 0.05 * f64::from(step);
            DVec2::new(12.0 * libm::cos(angle), 8.0 * libm::sin(1.5 * angle))
        };
        let track: Vec<DVec2> = (0..2000).map(round).collect();
        for near_m in [0.0, 0.2, 1.0, 30.0] {
            assert_eq!(cut(&track, near_m), reference_cut(&track, near_m), "{near_m} m");
        }
    }

    #[test]
    fn a_route_is_read_again_and_refused_where_it_does_not_fit() {
        let origin = Utm::new(18, true, 308_660.0, 4_333_755.0).unwrap();
        let track = line((0.0, 0.0), (10.0, 0.0));
        let route = to_message(&track, length_m(&track), &origin, 12.0);
        let text = rcs_msg::to_json(&rcs_msg::AnyMessage::new(route.clone())).unwrap();
        assert_eq!(parse(&text), Ok(Some(route.clone())));
        assert_eq!(parse(" "), Ok(None));
        let read = in_global(&route, &origin, DVec2::new(10.0, 0.0), 3.0).unwrap();
        assert!(read[0].distance(DVec2::ZERO) < 1e-6 && read.len() == track.len());
        let told = |result: Result<Vec<DVec2>, RouteError>| result.unwrap_err().to_string();
        let elsewhere = in_global(&route, &origin, DVec2::new(40.0, 0.0), 3.0);
        assert!(told(elsewhere).starts_with("the route ends 30."));
        // A point without coordinates, and one whose distance is no number of metres.
        for (point, expected) in [
            (RoutePoint::default(), "a point is at easting 0.0 m and northing 0.0 m, expected at most"),
            (RoutePoint { easting_m: 1e300, ..route.points[1] }, "a point is at easting 1e300 m and"),
        ] {
            let mut far = route.clone();
            far.points[1] = point;
            let far = told(in_global(&far, &origin, DVec2::new(10.0, 0.0), 3.0));
            assert!(far.starts_with(expected), "{far}");
        }
        let zone = in_global(&Route { zone: 17, ..route.clone() }, &origin, DVec2::ZERO, 3.0);
        assert!(told(zone).starts_with("the route is in UTM zone 17"));
        for (route, expected) in [
            (Route { format: 2, ..route.clone() }, "format is 2"),
            (Route { points: route.points[..1].to_vec(), ..route }, "1 points"),
        ] {
            let text = rcs_msg::to_json(&rcs_msg::AnyMessage::new(route)).unwrap();
            assert!(parse(&text).unwrap_err().to_string().starts_with(expected), "{text}");
        }
        assert!(matches!(parse("{"), Err(RouteError::Text(_))));
        let forgotten = to_message(&[], 0.0, &origin, 0.0);
        assert_eq!((forgotten.points.len(), forgotten.length_m, forgotten.cut_m), (0, 0.0, 0.0));
        let text = rcs_msg::to_json(&rcs_msg::AnyMessage::new(forgotten)).unwrap();
        assert_eq!(parse(&text), Ok(None));
    }

    #[test]
    fn a_way_of_too_many_points_is_thinned_to_a_route_that_can_be_read() {
        let origin = Utm::new(18, true, 300_000.0, 4_000_000.0).unwrap();
        for count in [2, MOST_POINTS - 1, MOST_POINTS, MOST_POINTS + 1, 2 * MOST_POINTS, 50_001] {
            let way: Vec<DVec2> = (0..count).map(|at| DVec2::new(0.5 * at as f64, 0.0)).collect();
            let route = to_message(&way, 0.0, &origin, 1.0);
            let (read, kept) = (route.points.len(), count.min(MOST_POINTS / 2));
            assert!((kept..=MOST_POINTS).contains(&read), "{read} of {count}");
            let end_m = route.points[read - 1].easting_m - origin.easting_m;
            assert!((end_m - 0.5 * (count - 1) as f64).abs() < 1e-6, "{count}");
            let text = rcs_msg::to_json(&rcs_msg::AnyMessage::new(route)).unwrap();
            assert!(parse(&text).is_ok(), "{count}");
        }
    }

    #[test]
    fn the_goal_was_ahead_of_where_a_route_ends() {
        let mut track = line((0.0, 0.0), (10.0, 0.0));
        // Its last metre leads to the left.
        track.extend(line((10.0, 0.0), (10.0, 2.0)));
        let end = *track.last().unwrap();
        let goal = finish(&track).unwrap();
        assert!(goal.distance(end + DVec2::new(0.0, AHEAD_M)) < 1e-9, "{goal}");
        assert_eq!(finish(&track[..1]), None);
        assert_eq!(finish(&[]), None);
    }

    #[test]
    fn a_registration_places_the_route_and_one_that_is_withdrawn_or_in_another_frame_does_not() {
        let transform = foxglove::FrameTransform {
            parent_frame_id: "local".to_owned(),
            child_frame_id: "remembered".to_owned(),
            translation: Some(foxglove::Vector3 { x: 1.0, y: -2.0, z: 0.0 }),
            rotation: Some(foxglove::Quaternion { w: 1.0, ..foxglove::Quaternion::default() }),
            ..foxglove::FrameTransform::default()
        };
        let message = FrameTransforms { transforms: vec![transform] };
        let placed = registered(&message, "local").unwrap();
        assert_eq!(placed * DVec2::new(10.0, 10.0).extend(0.0), DVec2::new(11.0, 8.0).extend(0.0));
        assert_eq!(registered(&message, "map"), None);
        assert_eq!(registered(&FrameTransforms::default(), "local"), None);
    }
}
