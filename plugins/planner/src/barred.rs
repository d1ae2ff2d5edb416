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
    /// Where the vehicle stood when it barred it, if this run has.
    pub stood: Option<(f64, f64)>,
}

impl From<&BarredPlace> for Barred {
    fn from(place: &BarredPlace) -> Barred {
        Barred { at: (place.x_m, place.y_m), radius_m: place.radius_m, slipped: place.slipped, stood: None }
    }
}

impl From<Barred> for BarredPlace {
    fn from(barred: Barred) -> BarredPlace {
        let Barred { at: (x_m, y_m), radius_m, slipped, stood: _ } = barred;
        BarredPlace { x_m, y_m, radius_m, slipped }
    }
}

/// Least distance from the origin of the vehicle to the border of a place that is barred ahead of it, m: so the vehicle
/// stands beside the place and not in it.
const BEFORE_M: f64 = 0.5;
/// Least distance from the front end of the vehicle to that border, m.
const BEFORE_FRONT_M: f64 = 0.26;
/// Greatest distance between two estimates of one place, m: twice the noise of position fixes.
const SAME_PLACE_M: f64 = 2.5;
/// Greatest length of a track that the wheels measured on the spot, m.
const LONGEST_M: f64 = 40.0;
/// Points of a track that lie farther apart than this, m, were not driven: the position fixes have jumped.
const LONGEST_STEP_M: f64 = 5.0;

impl Barred {
    /// The place ahead of a vehicle on which its wheels slip. `front_m`: how far ahead of its origin its front end is.
    pub fn ahead(vehicle: &Pose, front_m: f64, radius_m: f64) -> Barred {
        let before_m = BEFORE_M.max(front_m + BEFORE_FRONT_M);
        let ahead = vehicle.rotate(rcs_geom::DVec3::X).truncate().normalize_or_zero();
        let at = vehicle.translation.truncate() + ahead * (before_m + radius_m);
        Barred { at: (at.x, at.y), radius_m, slipped: true, stood: None }
    }
}

/// Growth of a place that is barred beside an earlier one.
const GROWTH: f64 = 1.5;
/// Radius up to which a place grows, m.
const LARGEST_M: f64 = 9.0;
/// Places that are this near to each other are one obstacle, m: the vehicle tried to get past the first one there.
const BESIDE_M: f64 = 1.0;
/// A vehicle that has moved less than this still stands in the same spot, m: wheels that go on slipping there do not tell
/// how far the slippery ground reaches.
const SAME_SPOT_M: f64 = 2.0;

/// Whether the vehicle, here in m, stands where it stood when it barred a place because its wheels slipped.
fn is_same_spot(place: &Barred, vehicle: DVec2) -> bool {
    place.slipped && place.stood.is_some_and(|stood| vehicle.distance(DVec2::from(stood)) < SAME_SPOT_M)
}

/// A place to bar, given the vehicle's position, m, and the places that are barred. Beside one of those, of the same kind,
/// it is larger than that one, on the same side of the vehicle: ground on which the wheels slip again, elsewhere, reaches
/// farther than was thought.
pub fn grown(place: Barred, vehicle: DVec2, before: &[Barred]) -> Barred {
    let at = DVec2::from(place.at);
    let is_beside = |other: &&Barred| {
        let away_m = at.distance(DVec2::from(other.at));
        let is_near = away_m <= place.radius_m + other.radius_m + BESIDE_M;
        other.slipped == place.slipped && is_near && !is_same_spot(other, vehicle)
    };
    let largest_m = before.iter().filter(is_beside).map(|other| other.radius_m * GROWTH).fold(0.0, f64::max);
    let radius_m = largest_m.min(LARGEST_M).max(place.radius_m);
    let away = (at - vehicle).normalize_or_zero();
    let at = at + away * (radius_m - place.radius_m);
    Barred { at: (at.x, at.y), radius_m, stood: Some(vehicle.into()), ..place }
}

/// Whether barring a place changes nothing, given the vehicle's position, m: it lies within one of its kind that has grown
/// as large as places grow, or that was barred from the same spot.
pub fn is_covered(place: &Barred, vehicle: DVec2, before: &[Barred]) -> bool {
    let at = DVec2::from(place.at);
    let covers = |other: &Barred| {
        let is_final = other.radius_m >= LARGEST_M || is_same_spot(other, vehicle);
        other.slipped == place.slipped && is_final && at.distance(DVec2::from(other.at)) <= other.radius_m
    };
    before.iter().any(covers)
}

/// Whether the last point of a track is where the track was before, although the wheels have turned since: the index of
/// that point, and the way that they have measured since, m. Points in the global frame, m. Fixes that have jumped since
/// then have jumped back: that tells nothing of the wheels.
pub fn turned_on_the_spot(track: &[DVec2]) -> Option<(usize, f64)> {
    let (&now, before) = track.split_last()?;
    let at = before.iter().rposition(|point| point.distance(now) <= SAME_PLACE_M)?;
    let since = &before[at..];
    let have_jumped = since.windows(2).any(|pair| pair[0].distance(pair[1]) > LONGEST_STEP_M);
    let rolled_m = crate::route::length_m(since);
    let is_on_the_spot = rolled_m > SAME_PLACE_M && rolled_m <= LONGEST_M && !have_jumped;
    is_on_the_spot.then_some((at, rolled_m))
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
        let and_back = [42.0, 43.0, 31.0].map(|x_m| DVec2::new(x_m, 0.0)).to_vec();
        let jumped = [straight(31), and_back].concat();
        assert_eq!(turned_on_the_spot(&jumped), None, "the fixes jumped ahead, and back");
        assert_eq!(turned_on_the_spot(&[]), None);
    }

    #[test]
    fn a_place_is_barred_ahead_of_the_vehicle_which_stands_beside_it() {
        let vehicle = Pose::from_xy_yaw(1.0, 2.0, std::f64::consts::FRAC_PI_2);
        for (front_m, y_m) in [(0.0, 5.5), (0.24, 5.5), (3.1, 8.36)] {
            let barred = Barred::ahead(&vehicle, front_m, 3.0);
            let at = DVec2::from(barred.at);
            assert!(at.distance(DVec2::new(1.0, y_m)) < 1e-9 && barred.radius_m == 3.0, "{front_m}: {at}");
        }
    }

    #[test]
    fn a_place_beside_an_earlier_one_is_larger_and_the_vehicle_stays_outside_of_it() {
        let place = |x: f64, y: f64, radius_m: f64| Barred {
            at: (x, y),
            radius_m,
            slipped: true,
            stood: Some((-3.0, 0.0)),
        };
        let vehicle = DVec2::ZERO;
        let extent = |barred: Barred| (barred.at, barred.radius_m);
        let first = place(2.5, 0.0, 2.0);
        assert_eq!(grown(first, vehicle, &[]), Barred { stood: Some((0.0, 0.0)), ..first });
        assert_eq!(extent(grown(first, vehicle, &[place(2.5, 8.0, 2.0)])), extent(first), "another place");
        let other_kind = Barred { slipped: false, ..place(2.5, 3.0, 2.0) };
        assert_eq!(extent(grown(first, vehicle, &[other_kind])), extent(first), "nothing slipped there");
        let second = grown(first, vehicle, &[place(2.5, 3.0, 2.0)]);
        assert_eq!(extent(second), ((3.5, 0.0), 3.0));
        // That of an earlier run, too.
        let of_before = Barred { stood: None, ..place(2.5, 3.0, 2.0) };
        assert_eq!(grown(first, vehicle, &[of_before]), second);
        let mut places = vec![place(2.5, 3.0, 2.0)];
        for _ in 0..20 {
            let last = grown(first, vehicle, &places);
            places.push(Barred { stood: Some((-3.0, 0.0)), ..last });
        }
        let last = places[places.len() - 1];
        assert_eq!(last.radius_m, LARGEST_M);
        assert!((DVec2::from(last.at).length() - LARGEST_M - BEFORE_M).abs() < 1e-9);
        assert!(is_covered(&first, vehicle, &places) && !is_covered(&first, vehicle, &places[..1]));
        assert!(!is_covered(&other_kind, vehicle, &places));
        assert!(!is_covered(&place(-1.0, 0.0, 2.0), vehicle, &places));
    }

    #[test]
    fn wheels_that_go_on_slipping_in_one_spot_do_not_enlarge_the_place() {
        let vehicle = DVec2::ZERO;
        let place = |x: f64, y: f64| Barred { at: (x, y), radius_m: 2.0, slipped: true, stood: None };
        let before = [grown(place(2.5, 0.0), vehicle, &[])];
        let moved = DVec2::new(-0.9, 0.3);
        assert!(is_covered(&place(1.6, 0.3), moved, &before), "it is barred already");
        assert!(!is_covered(&place(-0.9, 2.8), moved, &before), "beside it the vehicle slips, too");
        assert_eq!(grown(place(-0.9, 2.8), moved, &before).radius_m, 2.0);
        let elsewhere = DVec2::new(0.0, 2.5);
        assert!(!is_covered(&place(2.5, 1.0), elsewhere, &before));
        assert_eq!(grown(place(2.5, 1.0), elsewhere, &before).radius_m, 3.0);
    }
}
