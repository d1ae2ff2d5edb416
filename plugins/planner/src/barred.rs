//! Places that the vehicle could not get over, and how it is known that it stood there while its wheels turned.
//!
//! Wheels that turn on mud move the local frame along with the vehicle, and the position fixes notice it later: the
//! vehicle is back where it was before. Such a place is barred for the rest of the run: the planner goes around it wherever there is another way.

use crate::proto::BarredPlace;
use rcs_geom::{DVec2, Pose};
use serde::{Deserialize, Serialize};

/// A place that is barred: a disc, frame of its list, m.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Barred {
    /// Centre.
    pub at: (f64, f64),
    /// Radius.
    pub radius_m: f64,
    /// Whether the wheels slipped there.
    pub slipped: bool,
}

impl From<&BarredPlace> for Barred {
    fn from(place: &BarredPlace) -> Barred {
        Barred { at: (place.x_m, place.y_m), radius_m: place.radius_m, slipped: place.slipped }
    }
}

impl From<Barred> for BarredPlace {
    fn from(barred: Barred) -> BarredPlace {
        let Barred { at: (x_m, y_m), radius_m, slipped } = barred;
        BarredPlace { x_m, y_m, radius_m, slipped }
    }
}

/// Distance from the origin of the vehicle to the border of a place that is barred ahead of it, m: so the vehicle stands
/// beside the place and not in it.
const BEFORE_M: f64 = 0.5;
/// Greatest distance between two estimates of one place, m: twice the noise of position fixes.
const SAME_PLACE_M: f64 = 2.5;
/// Greatest length of a track that the wheels measured on the spot, m.
const LONGEST_M: f64 = 40.0;

impl Barred {
    /// The place ahead of a vehicle on which its wheels slip.
    pub fn ahead(vehicle: &Pose, radius_m: f64) -> Barred {
        let ahead = vehicle.rotate(rcs_geom::DVec3::X).truncate().normalize_or_zero();
        let at = vehicle.translation.truncate() + ahead * (BEFORE_M + radius_m);
        Barred { at: (at.x, at.y), radius_m, slipped: true }
    }
}

/// Growth of a place that is barred beside an earlier one.
const GROWTH: f64 = 1.5;
/// Radius up to which a place grows, m.
const LARGEST_M: f64 = 9.0;
/// Places that are this near to each other are one obstacle, m: the vehicle tried to get past the first one there.
const BESIDE_M: f64 = 1.0;

/// A place to bar, given the vehicle's position, m, and the places that are barred. Beside one of those, of the same kind,
/// it is larger than that one, on the same side of the vehicle: ground on which the wheels slip again reaches farther than
/// was thought.
pub fn grown(place: Barred, vehicle: DVec2, before: &[Barred]) -> Barred {
    let at = DVec2::from(place.at);
    let is_beside = |other: &&Barred| {
        let away_m = at.distance(DVec2::from(other.at));
        other.slipped == place.slipped && away_m <= place.radius_m + other.radius_m + BESIDE_M
    };
    let largest_m = before.iter().filter(is_beside).map(|other| other.radius_m * GROWTH).fold(0.0, f64::max);
    let radius_m = largest_m.min(LARGEST_M).max(place.radius_m);
    let away = (at - vehicle).normalize_or_zero();
    let at = at + away * (radius_m - place.radius_m);
    Barred { at: (at.x, at.y), radius_m, ..place }
}

/// Whether a place lies within one of its kind that has grown as large as places grow: barring it changes
/// nothing.
pub fn is_covered(place: &Barred, before: &[Barred]) -> bool {
    let at = DVec2::from(place.at);
    let covers = |other: &Barred| {
        let is_largest = other.slipped == place.slipped && other.radius_m >= LARGEST_M;
        is_largest && at.distance(DVec2::from(other.at)) <= other.radius_m
    };
    before.iter().any(covers)
}

/// Whether the last point of a track is where the track was before, although the wheels have turned since: the index of
/// that point, and the way that they have measured since, m. Points in the global frame, m.
pub fn turned_on_the_spot(track: &[DVec2]) -> Option<(usize, f64)> {
    let (&now, before) = track.split_last()?;
    let at = before.iter().rposition(|point| point.distance(now) <= SAME_PLACE_M)?;
    let rolled_m = crate::route::length_m(&before[at..]);
    (rolled_m > SAME_PLACE_M && rolled_m <= LONGEST_M).then_some((at, rolled_m))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn straight(to_m: u32) -> Vec<DVec2> {
        (0..to_m).map(|x| DVec2::new(f64::from(x), 0.0)).collect()
    }

    #[test]
    fn a_fix_that_puts_the_vehicle_back_on_its_track_tells_that_its_wheels_turned() {
        let fixed = |x_m: f64, y_m: f64| [straight(31), vec![DVec2::new(x_m, y_m)]].concat();
        let (at, rolled_m) = turned_on_the_spot(&fixed(19.0, 1.0)).unwrap();
        assert!((19..=21).contains(&at) && rolled_m == (30 - at) as f64, "{at}, {rolled_m} m");
        assert_eq!(turned_on_the_spot(&fixed(19.0, 8.0)), None, "beside the track");
        assert_eq!(turned_on_the_spot(&fixed(50.0, 0.0)), None, "ahead");
        assert_eq!(turned_on_the_spot(&fixed(29.0, 0.0)), None, "within the noise");
        let far = [straight(100), vec![DVec2::ZERO]].concat();
        assert_eq!(turned_on_the_spot(&far), None, "too long ago");
        assert_eq!(turned_on_the_spot(&[]), None);
    }

    #[test]
    fn a_place_is_barred_ahead_of_the_vehicle_which_stands_beside_it() {
        let barred = Barred::ahead(&Pose::from_xy_yaw(1.0, 2.0, std::f64::consts::FRAC_PI_2), 3.0);
        let at = DVec2::from(barred.at);
        assert!(at.distance(DVec2::new(1.0, 5.5)) < 1e-9 && barred.radius_m == 3.0, "{at}");
    }

    #[test]
    fn a_place_beside_an_earlier_one_is_larger_and_the_vehicle_stays_outside_of_it() {
        let place = |x: f64, y: f64, radius_m: f64| Barred { at: (x, y), radius_m, slipped: true };
        let vehicle = DVec2::ZERO;
        let first = place(2.5, 0.0, 2.0);
        assert_eq!(grown(first, vehicle, &[]), first);
        assert_eq!(grown(first, vehicle, &[place(2.5, 8.0, 2.0)]), first, "another place");
        let other_kind = Barred { slipped: false, ..place(2.5, 3.0, 2.0) };
        assert_eq!(grown(first, vehicle, &[other_kind]), first, "nothing slipped there");
        let second = grown(first, vehicle, &[place(2.5, 3.0, 2.0)]);
        assert_eq!(second, place(3.5, 0.0, 3.0));
        let mut places = vec![place(2.5, 3.0, 2.0)];
        for _ in 0..20 {
            places.push(grown(first, vehicle, &places));
        }
        let last = places[places.len() - 1];
        assert_eq!(last.radius_m, LARGEST_M);
        assert!((DVec2::from(last.at).length() - LARGEST_M - BEFORE_M).abs() < 1e-9);
        assert!(is_covered(&first, &places) && !is_covered(&first, &places[..1]));
        assert!(!is_covered(&other_kind, &places) && !is_covered(&place(-1.0, 0.0, 2.0), &places));
    }
}
