//! Path following: steers for a point some way ahead, and slows down where the path bends or is narrow.

use rcs_geom::{DVec2, wrap_angle};

/// Parameters of path following; see the parameters of the process.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Style {
    /// Distance to the target point on the path, m.
    pub lookahead_m: f64,
    /// Speed on a straight path with enough clearance, m/s.
    pub max_speed_mps: f64,
    /// Speed in a tight bend and at the least clearance, m/s.
    pub min_speed_mps: f64,
    /// Turn rate per radian of heading error, 1/s.
    pub yaw_gain_per_s: f64,
    /// Maximum turn rate, rad/s.
    pub max_yaw_rate_radps: f64,
    /// Clearance at which the lowest speed is driven, m.
    pub room_m: f64,
    /// Clearance from which on the full speed is driven, m.
    pub wish_room_m: f64,
}

/// Command for the current cycle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Steering {
    /// m/s.
    pub speed_mps: f64,
    /// rad/s, counter-clockwise.
    pub yaw_rate_radps: f64,
}

/// The vehicle turns on the spot towards directions that differ by more than this from its heading, rad.
const TURN_FIRST_RAD: f64 = 1.0;
/// A bend of this angle reduces the speed to the minimum, rad.
const SHARP_RAD: f64 = 0.7;
/// Bends and narrow places this far ahead reduce the speed, m.
const FORESIGHT_M: f64 = 2.0;
/// How far ahead of the last one the nearest point of the path is searched, m, so that a path that passes itself is not
/// cut short.
const PROGRESS_M: f64 = 3.0;

/// The nearest point of the path at or shortly after `from`, and its distance, m.
pub fn progress(path: &[(DVec2, f64)], from: usize, place: DVec2) -> (usize, f64) {
    let first = from.min(path.len().saturating_sub(1));
    let mut best = (first, f64::INFINITY);
    let mut along_m = 0.0;
    for at in first..path.len() {
        if at > first {
            along_m += path[at].0.distance(path[at - 1].0);
        }
        if along_m > PROGRESS_M {
            break;
        }
        let distance = path[at].0.distance(place);
        if distance < best.1 {
            best = (at, distance);
        }
    }
    best
}

/// Length of the path from a point to the end, m.
pub fn length(path: &[(DVec2, f64)], from: usize) -> f64 {
    path.iter().skip(from).zip(path.iter().skip(from + 1)).map(|(a, b)| a.0.distance(b.0)).sum()
}

/// From the point `from` on, the first point of the path that is at least `distance_m` from `place`; else the last one.
fn ahead(path: &[(DVec2, f64)], from: usize, place: DVec2, distance_m: f64) -> Option<DVec2> {
    let found = path.iter().skip(from).find(|(point, _)| point.distance(place) >= distance_m);
    found.or(path.last()).map(|&(point, _)| point)
}

/// Command for a vehicle at `place` with heading `yaw_rad` (rad) whose nearest point of the path is `at`.
pub fn steer(path: &[(DVec2, f64)], at: usize, place: DVec2, yaw_rad: f64, style: &Style) -> Steering {
    let error_to = |distance_m: f64| {
        let target = ahead(path, at, place, distance_m)? - place;
        Some(wrap_angle(libm::atan2(target.y, target.x) - yaw_rad))
    };
    let Some(error) = error_to(style.lookahead_m) else { return Steering::default() };
    let limit = style.max_yaw_rate_radps;
    let yaw_rate_radps = (style.yaw_gain_per_s * error).clamp(-limit, limit);
    if error.abs() > TURN_FIRST_RAD {
        return Steering { speed_mps: 0.0, yaw_rate_radps };
    }
    let bend = error_to(style.lookahead_m + FORESIGHT_M).map_or(error, |later| wrap_angle(later - error));
    let sharpness = (error.abs().max(bend.abs()) / SHARP_RAD).min(1.0);
    let near = path.iter().skip(at).take_while(|(point, _)| point.distance(place) <= FORESIGHT_M);
    let room = near.map(|&(_, room)| room).fold(f64::INFINITY, f64::min);
    let span = (style.wish_room_m - style.room_m).max(1e-9);
    let narrowness = ((style.wish_room_m - room) / span).clamp(0.0, 1.0);
    let slower = sharpness.max(narrowness);
    let speed_mps = style.max_speed_mps + (style.min_speed_mps - style.max_speed_mps) * slower;
    Steering { speed_mps, yaw_rate_radps }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STYLE: Style = Style {
        lookahead_m: 1.2,
        max_speed_mps: 1.2,
        min_speed_mps: 0.4,
        yaw_gain_per_s: 2.0,
        max_yaw_rate_radps: 1.0,
        room_m: 0.65,
        wish_room_m: 1.85,
    };

    /// A path east along y = 0 to x = 10, then north, with the same clearance everywhere.
    fn corner(room_m: f64) -> Vec<(DVec2, f64)> {
        let east = (0..=50).map(|i| DVec2::new(f64::from(i) * 0.2, 0.0));
        let north = (1..=50).map(|i| DVec2::new(10.0, f64::from(i) * 0.2));
        east.chain(north).map(|point| (point, room_m)).collect()
    }

    #[test]
    fn it_drives_fast_on_a_straight_free_way_and_slowly_on_a_narrow_one() {
        let free = steer(&corner(5.0), 0, DVec2::ZERO, 0.0, &STYLE);
        assert_eq!(free, Steering { speed_mps: 1.2, yaw_rate_radps: 0.0 });
        let narrow = steer(&corner(0.65), 0, DVec2::ZERO, 0.0, &STYLE);
        assert!((narrow.speed_mps - 0.4).abs() < 1e-12);
    }

    #[test]
    fn it_turns_to_the_path_and_slows_before_a_bend() {
        let path = corner(5.0);
        let beside = steer(&path, 10, DVec2::new(2.0, -0.5), 0.0, &STYLE);
        assert!(beside.yaw_rate_radps > 0.5 && beside.speed_mps < 1.2, "{beside:?}");
        let before = steer(&path, 43, DVec2::new(8.6, 0.0), 0.0, &STYLE);
        assert!(before.speed_mps < 0.8, "{before:?}");
        let backward = steer(&path, 0, DVec2::ZERO, 3.0, &STYLE);
        assert_eq!(backward, Steering { speed_mps: 0.0, yaw_rate_radps: -1.0 });
    }

    #[test]
    fn progress_goes_on_along_the_path_and_does_not_jump() {
        let path = corner(5.0);
        assert_eq!(progress(&path, 0, DVec2::new(1.02, 0.3)).0, 5);
        let there_and_back: Vec<_> = path.iter().chain(path.iter().rev()).copied().collect();
        let (at, distance) = progress(&there_and_back, 3, DVec2::new(0.6, 0.1));
        assert_eq!(at, 3);
        assert!((distance - 0.1).abs() < 1e-12);
        assert!((length(&path, 50) - 10.0).abs() < 1e-9);
    }
}
