//! Waypoints along a planned path, and the turning point that is driven to.
//!
//! Albus 2006a, 5: waypoints are "spaced approximately 0.6 m apart"; as the goal of a short plan "the first major turning
//! point is selected".

use rcs_geom::DVec2;

/// Points along a path at a distance from each other, m, with its ends.
pub fn spaced(path: &[DVec2], distance_m: f64) -> Vec<DVec2> {
    let mut points: Vec<DVec2> = path.first().copied().into_iter().collect();
    let mut since_m = 0.0;
    for pair in path.windows(2) {
        let length_m = pair[0].distance(pair[1]);
        let mut along_m = distance_m - since_m;
        while along_m < length_m {
            points.push(pair[0].lerp(pair[1], along_m / length_m));
            along_m += distance_m;
        }
        since_m = length_m - (along_m - distance_m);
    }
    match (points.last(), path.last()) {
        (Some(last), Some(end)) if last != end => points.push(*end),
        _ => {}
    }
    points
}

/// Index of the waypoint that is nearest to a position; `None` without waypoints.
pub fn nearest(waypoints: &[DVec2], position: DVec2) -> Option<usize> {
    let distances = waypoints.iter().map(|at| at.distance_squared(position)).enumerate();
    distances.reduce(|best, other| if other.1 < best.1 { other } else { best }).map(|(at, _)| at)
}

/// The first major turning point from a position: the last waypoint before one that cannot be reached straight without
/// leaving the path by more than `tolerance_m`. It is at least the first waypoint that is `least_m` away, and no farther
/// away than `most_m`. `None` without waypoints.
pub fn turning_point(
    waypoints: &[DVec2],
    position: DVec2,
    tolerance_m: f64,
    [least_m, most_m]: [f64; 2],
) -> Option<DVec2> {
    let first = nearest(waypoints, position)?;
    let ahead = &waypoints[first..];
    let mut found = None;
    for (at, &point) in ahead.iter().enumerate() {
        let away_m = point.distance(position);
        let strays = ahead[..at].iter().any(|&between| off_segment(between, position, point) > tolerance_m);
        if found.is_some() && (strays || away_m > most_m) {
            break;
        }
        if away_m >= least_m || at + 1 == ahead.len() {
            found = Some(point);
        }
    }
    found
}

/// Distance of a point from a segment, m.
fn off_segment(point: DVec2, from: DVec2, to: DVec2) -> f64 {
    let along = to - from;
    let share = (point - from).dot(along) / along.length_squared().max(1e-12);
    point.distance(from + along * share.clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    const CORNER: [DVec2; 3] = [DVec2::ZERO, DVec2::new(4.0, 0.0), DVec2::new(4.0, 3.0)];

    #[test]
    fn waypoints_are_spaced_along_the_path_and_end_with_it() {
        let points = spaced(&CORNER, 0.6);
        assert_eq!((points[0], *points.last().unwrap()), (DVec2::ZERO, CORNER[2]));
        assert_eq!(points.len(), 13, "11 of 0.6 m on 7 m, the start and the end");
        assert!((points[1].x - 0.6).abs() < 1e-12 && (points[7].y - 0.2).abs() < 1e-12, "{points:?}");
        assert!(spaced(&[], 0.6).is_empty());
        assert_eq!(spaced(&CORNER[..1], 0.6), [DVec2::ZERO]);
    }

    #[test]
    fn the_turning_point_is_where_the_path_turns() {
        let points = spaced(&CORNER, 0.6);
        let target = |x, y, range| turning_point(&points, DVec2::new(x, y), 0.3, range).unwrap();
        let corner = target(0.3, 0.0, [0.8, 9.0]);
        assert!((corner.x - 4.0).abs() < 0.6 && corner.y < 0.9, "{corner}");
        assert!(target(0.0, 0.0, [0.8, 2.0]).x <= 2.0);
        assert_eq!(target(4.0, 2.9, [0.8, 9.0]), CORNER[2], "near the end");
        assert!(target(3.6, 0.0, [0.8, 9.0]).y > 0.5, "the corner itself is too near");
        assert_eq!(turning_point(&[], DVec2::ZERO, 0.3, [0.8, 9.0]), None);
    }

    #[test]
    fn a_straight_path_is_followed_as_far_as_allowed() {
        let points = spaced(&[DVec2::ZERO, DVec2::new(20.0, 0.0)], 0.6);
        let target = turning_point(&points, DVec2::new(0.0, 0.2), 0.3, [0.8, 5.0]).unwrap();
        assert!((4.4..=5.0).contains(&target.x), "{target}");
    }
}
