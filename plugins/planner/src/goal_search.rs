//! The search for a goal that the vehicle has reached by its own estimate, which may be metres away from the truth.
//!
//! A course, a person or a beacon says that the goal is reached. While nobody does, it lies farther away than a known
//! distance from each place where the vehicle was. So the vehicle keeps a probability for each place around its estimate,
//! takes away what it has passed, and drives to where it gains most of what is left for its time (Bayesian search). Once
//! no place gains anything that counts, it stands at its estimate.

use crate::zones::Zones;
use rcs_geom::{DVec2, wrap_angle};
use rcs_msg::Stamp;
use rcs_msg::rcs::VehicleStatus;
use serde::{Deserialize, Serialize};

/// Error of the estimate: standard deviations along each axis, m, and the share of each. Along an axis it is 0.93 m
/// in most drives (1.3 m in the plane, docs/autonomy.md), and more after wheels have slipped.
const ERRORS: [(f64, f64); 2] = [(0.95, 0.8), (2.0, 0.2)];
/// The probability is kept for cells of this size, m, this many to each side of the estimate.
const CELL_M: f64 = 0.3;
const CELLS: i32 = 16;
/// Usual speed, m/s, and turn rate, rad/s, by which the time to a place is estimated, and a fixed part of it, s.
const SPEED_MPS: f64 = 1.0;
const TURN_RADPS: f64 = 1.0;
const FIXED_S: f64 = 1.0;
/// Longest time for driving to a place at the usual pace, s: it may lie inside of an obstacle.
const LONGEST_S: f64 = 8.0;
/// A place is left for the next one when less than this share is left of what it was chosen for.
const USED_UP: f64 = 0.4;
/// The search ends when no place to which it may drive gains as much probability as this.
const LEAST: f64 = 0.002;
/// Number of the newest points of the track that count: the estimate drifts against older ones.
const NEWEST: usize = 100;

/// How many times as long as usual a vehicle with this status takes, by its limits of speed and turn rate: at least 1.
pub fn slowness(vehicle: Option<&VehicleStatus>) -> f64 {
    // A limit is 0 where the vehicle states none.
    let times = |usual: f64, stated: f64| if stated > 0.0 { usual / stated } else { 1.0 };
    vehicle.map_or(1.0, |vehicle| {
        let driving = times(SPEED_MPS, vehicle.max_speed_mps);
        driving.max(times(TURN_RADPS, vehicle.max_yaw_rate_radps)).max(1.0)
    })
}

/// What the search goes by, global frame, m.
#[derive(Clone, Copy, Debug)]
pub struct Scene<'a> {
    /// Where the goal is believed to be.
    pub goal: DVec2,
    /// Where the vehicle is, and its heading, rad.
    pub vehicle: (DVec2, f64),
    /// Where it was.
    pub track: &'a [(f64, f64)],
    /// Distance at which the goal counts as reached, m.
    pub within_m: f64,
    /// Where the vehicle must not drive.
    pub zones: &'a Zones,
    /// How many times as long as usual it takes; see [`slowness`].
    pub slowness: f64,
}

/// The state of a search.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct GoalSearch {
    /// Where it drives to, global frame, m, since when, and the probability of finding the goal there; `None` once it is
    /// over.
    target: Option<((f64, f64), Stamp, f64)>,
    /// The greatest slowness since then.
    slowness: f64,
    /// Where it did not get to in time, m.
    given_up: Vec<(f64, f64)>,
    /// Number of places that it has driven to.
    places: u32,
}

impl GoalSearch {
    /// From the first arrival at the goal on.
    pub fn begin(scene: &Scene<'_>, now: Stamp) -> GoalSearch {
        let mut search = GoalSearch::default();
        search.choose(&search.left(scene), scene, now);
        search
    }

    /// Goes on to another place if the vehicle has arrived at this one, does not get there, must not drive there any more,
    /// or has passed most of what it was chosen for. Whether it does.
    pub fn go_on(&mut self, scene: &Scene<'_>, arrived: bool, now: Stamp) -> bool {
        let Some((target, since, worth)) = self.target else { return false };
        self.slowness = self.slowness.max(scene.slowness);
        let is_late = now.seconds_since(since) > LONGEST_S * self.slowness;
        if is_late {
            self.given_up.push(target);
        }
        let left = self.left(scene);
        let at = DVec2::from(target);
        let is_forbidden = scene.zones.forbid(at);
        let goes_on =
            arrived || is_late || is_forbidden || near(&left, at, at, scene.within_m) < USED_UP * worth;
        if goes_on {
            self.choose(&left, scene, now);
        }
        goes_on
    }

    /// The vehicle may not drive: its time for driving to a place begins when it may.
    pub fn wait(&mut self, now: Stamp) {
        if let Some((_, since, _)) = &mut self.target {
            *since = now;
        }
    }

    /// Where it drives to, global frame, m; `None` for the estimate, where it stays.
    pub fn target(&self) -> Option<DVec2> {
        self.target.map(|(target, _, _)| DVec2::from(target))
    }

    /// What the status says of it.
    pub fn note(&self) -> String {
        match self.target {
            Some(_) => format!("; at the goal by its estimate, looks for it: place {}", self.places),
            None => "; it has looked for the goal".to_owned(),
        }
    }

    /// Chooses the place with the greatest probability on the way to it for its time.
    fn choose(&mut self, left: &[(DVec2, f64)], scene: &Scene<'_>, now: Stamp) {
        let (from, yaw) = scene.vehicle;
        let gain = |to: DVec2| near(left, from, to, scene.within_m);
        let time_s = |to: DVec2| {
            let way = to - from;
            let turn_rad = wrap_angle(libm::atan2(way.y, way.x) - yaw).abs();
            FIXED_S + way.length() / SPEED_MPS + turn_rad / TURN_RADPS
        };
        let allowed = cells(scene.goal).step_by(2).filter(|&to| !scene.zones.forbid(to));
        let gains = allowed.map(|to| (to, gain(to))).filter(|&(_, gain)| gain > LEAST);
        let rated = gains.map(|(to, gain)| (to, gain / time_s(to)));
        let best = rated.reduce(|best, other| if other.1 > best.1 { other } else { best });
        self.slowness = scene.slowness;
        self.target = best.map(|(to, _)| {
            self.places += 1;
            ((to.x, to.y), now, near(left, to, to, scene.within_m))
        });
    }

    /// The probability of each cell that the vehicle has not passed.
    fn left(&self, scene: &Scene<'_>) -> Vec<(DVec2, f64)> {
        let newest = &scene.track[scene.track.len().saturating_sub(NEWEST)..];
        let reach_m = f64::from(CELLS) * CELL_M * std::f64::consts::SQRT_2 + scene.within_m;
        let here = [(scene.vehicle.0.x, scene.vehicle.0.y)];
        let passed = newest.iter().chain(&here).chain(&self.given_up).copied().map(DVec2::from);
        let passed: Vec<DVec2> = passed.filter(|at| at.distance(scene.goal) < reach_m).collect();
        let is_left = |at: DVec2| passed.iter().all(|passed| passed.distance(at) > scene.within_m);
        let cells = cells(scene.goal).filter(|&at| is_left(at));
        cells.map(|at| (at, probability(at.distance_squared(scene.goal)))).collect()
    }
}

/// The middles of the cells around a place, m.
fn cells(middle: DVec2) -> impl Iterator<Item = DVec2> {
    let axis = -CELLS..=CELLS;
    let of_row =
        move |row: i32| axis.clone().map(move |column| DVec2::new(f64::from(column), f64::from(row)));
    (-CELLS..=CELLS).flat_map(of_row).map(move |cell| middle + cell * CELL_M)
}

/// The probability that the goal lies in a cell at this squared distance from the estimate, m².
fn probability(squared_m2: f64) -> f64 {
    let of = |(deviation_m, share): (f64, f64)| {
        let variance = deviation_m * deviation_m;
        share * libm::exp(-0.5 * squared_m2 / variance) / (std::f64::consts::TAU * variance)
    };
    CELL_M * CELL_M * ERRORS.map(of).iter().sum::<f64>()
}

/// The probability within a distance of the straight way between two places.
fn near(left: &[(DVec2, f64)], from: DVec2, to: DVec2, within_m: f64) -> f64 {
    let way = to - from;
    let squared = way.length_squared().max(1e-9);
    let away_m = |at: DVec2| {
        let along = ((at - from).dot(way) / squared).clamp(0.0, 1.0);
        at.distance(from + way * along)
    };
    left.iter().filter(|(at, _)| away_m(*at) < within_m).map(|(_, probability)| probability).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::zones::Polygon;

    const WITHIN_M: f64 = 1.2;
    static EVERYWHERE: Zones = Zones { area: None, is_area_of_world: false, keep_out: Vec::new() };

    fn scene(vehicle: (DVec2, f64), track: &[(f64, f64)]) -> Scene<'_> {
        Scene { goal: DVec2::ZERO, vehicle, track, within_m: WITHIN_M, zones: &EVERYWHERE, slowness: 1.0 }
    }

    /// Drives from 8 m west to the estimate at the origin, and on until it is within reach of the goal, without obstacles:
    /// the way from the estimate on, m, or `None` if the search ends before.
    fn found_after_m(goal: DVec2) -> Option<f64> {
        let (mut at, mut yaw, step_m) = (DVec2::new(-8.0, 0.0), 0.0, 0.25_f64);
        let mut track = Vec::new();
        let mut search: Option<GoalSearch> = None;
        let mut way_m = 0.0;
        for tick in 0..800 {
            if at.distance(goal) < 1.5 {
                return Some(way_m);
            }
            track.push((at.x, at.y));
            let scene = scene((at, yaw), &track);
            let now = Stamp(tick * 250_000_000);
            match &mut search {
                None if at.length() < 0.3 => search = Some(GoalSearch::begin(&scene, now)),
                None => {}
                Some(search) => {
                    let arrived = search.target()?.distance(at) < 0.3;
                    search.go_on(&scene, arrived, now);
                }
            }
            let target = match &search {
                Some(search) => search.target()?,
                None => DVec2::ZERO,
            };
            let way = target - at;
            yaw = libm::atan2(way.y, way.x);
            at += way.normalize_or_zero() * step_m.min(way.length());
            way_m += if search.is_some() { step_m } else { 0.0 };
        }
        panic!("it goes on for ever: {search:?}");
    }

    #[test]
    fn it_finds_a_goal_anywhere_around_the_estimate_and_a_near_one_soon() {
        let mut ways_m = Vec::new();
        for ring in 1..=4 {
            for side in 0..16 {
                let angle = std::f64::consts::TAU * f64::from(side) / 16.0;
                let goal = DVec2::from_angle(angle) * f64::from(ring);
                let way_m = found_after_m(goal).unwrap_or_else(|| panic!("not found: {goal}"));
                if ring <= 2 {
                    ways_m.push(way_m);
                }
            }
        }
        let mean_m = ways_m.iter().sum::<f64>() / ways_m.len() as f64;
        assert!(mean_m < 3.0, "{mean_m} {ways_m:?}");
    }

    #[test]
    fn it_first_drives_on_and_never_back_over_its_own_track() {
        let track: Vec<_> = (0..=16).map(|at| (f64::from(at) * 0.5 - 8.0, 0.0)).collect();
        let scene = scene((DVec2::ZERO, 0.0), &track);
        let search = GoalSearch::begin(&scene, Stamp(0));
        let first = search.target().unwrap();
        assert!(first.x > 0.5 && first.y.abs() < first.x, "{first}");
        assert!(search.note().contains("place 1"));
    }

    #[test]
    fn it_does_not_look_where_it_must_not_drive() {
        let corners = [(0.4, -9.0), (9.0, -9.0), (9.0, 9.0), (0.4, 9.0)].map(|(x, y)| DVec2::new(x, y));
        let zones = Zones { keep_out: vec![Polygon::new(corners).unwrap()], ..Zones::default() };
        let ahead = Scene { zones: &zones, ..scene((DVec2::ZERO, 0.0), &[(0.0, 0.0)]) };
        let first = GoalSearch::begin(&ahead, Stamp(0)).target().unwrap();
        assert!(first.x <= 0.4, "{first}");

        let track = [(0.0, 0.0)];
        let mut search = GoalSearch::begin(&scene((DVec2::ZERO, 0.0), &track), Stamp(0));
        assert!(search.target().unwrap().x > 0.4, "{search:?}");
        assert!(search.go_on(&ahead, false, Stamp(0)), "a zone that is added counts at once");
        assert!(search.target().unwrap().x <= 0.4, "{search:?}");
    }

    #[test]
    fn while_the_vehicle_may_not_drive_no_place_is_given_up() {
        let track = [(0.0, 0.0)];
        let scene = scene((DVec2::ZERO, 0.0), &track);
        let mut search = GoalSearch::begin(&scene, Stamp(0));
        let first = search.target();
        let at = |second: u64| Stamp(second * 1_000_000_000);
        for second in 1..60 {
            search.wait(at(second));
            assert!(!search.go_on(&scene, false, at(second)), "after {second} s");
        }
        assert!(!search.go_on(&scene, false, at(67)) && search.target() == first);
        assert!(search.go_on(&scene, false, at(68)) && search.target() != first);
    }

    #[test]
    fn a_vehicle_that_may_only_drive_slowly_has_as_much_more_time_for_each_place() {
        let track = [(0.0, 0.0)];
        let usual = scene((DVec2::ZERO, 0.0), &track);
        let stated = |max_speed_mps: f64, max_yaw_rate_radps: f64| {
            let vehicle = VehicleStatus { max_speed_mps, max_yaw_rate_radps, ..VehicleStatus::default() };
            Scene { slowness: slowness(Some(&vehicle)), ..usual }
        };
        for faster in [stated(1.3, 1.2), stated(0.0, 0.0)] {
            assert_eq!(faster.slowness, 1.0);
        }
        let at = |second: u64| Stamp(second * 1_000_000_000);
        for (slow, longest_s) in [(stated(0.2, 1.2), 40), (stated(1.3, 0.25), 32)] {
            let mut search = GoalSearch::begin(&slow, Stamp(0));
            let first = search.target();
            for second in 1..=longest_s {
                // Also where the limit is lifted on the way.
                let now = if second > 20 { &usual } else { &slow };
                assert!(!search.go_on(now, false, at(second)), "after {second} s");
            }
            assert!(search.go_on(&usual, false, at(longest_s + 1)) && search.target() != first);
            assert!(!search.go_on(&usual, false, at(longest_s + 9)));
            assert!(search.go_on(&usual, false, at(longest_s + 10)), "it has the usual time for the next");
        }
    }

    #[test]
    fn what_it_does_not_get_to_is_given_up_and_the_search_ends() {
        let track = [(0.0, 0.0)];
        let scene = scene((DVec2::ZERO, 0.0), &track);
        let mut search = GoalSearch::begin(&scene, Stamp(0));
        let mut seen = Vec::new();
        for second in 1..400 {
            let before = search.target();
            let goes_on = search.go_on(&scene, false, Stamp(second * 1_000_000_000));
            assert_eq!(goes_on, search.target() != before, "after {second} s");
            let Some(target) = search.target() else { break };
            if goes_on {
                assert!(seen.iter().all(|seen: &DVec2| seen.distance(target) > 0.3), "{target} {seen:?}");
                seen.push(target);
            }
        }
        assert_eq!(search.target(), None, "{seen:?}");
        assert!(search.note().contains("has looked"), "{seen:?}");
        assert!(!search.go_on(&scene, true, Stamp(u64::MAX / 2)));
    }
}
