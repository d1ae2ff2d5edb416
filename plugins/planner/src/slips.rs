//! Slip memory: where the wheels of a run slipped, for the next one, and its file.
//!
//! How slippery ground is cannot be seen, so the next run would drive onto it as this one did. A place is remembered where
//! the vehicle was stopped by it: a mode that begins with slip barred it, or images or position fixes told that the wheels
//! turned on the spot. It is barred in the next run, too: at a price, so that it can be driven over where there is no
//! other way. It is forgotten by a run that has driven over it without slip.

use crate::barred::Barred;
use crate::proto::{SlipMemory, SlipPlace};
use crate::route::MOST_M;
use rcs_geom::{DVec2, Utm};

/// Version of the file.
const FORMAT: u32 = 1;
/// Greatest number of places, and greatest radius of one, m.
const MOST_PLACES: usize = 1000;
const LARGEST_M: f64 = 100.0;
/// Share of its radius within which a place was driven over.
const INNER: f64 = 0.5;

/// Why a text is no slip memory, or does not fit.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SlipsError {
    /// The text is not the JSON of a slip memory.
    #[error("{0}")]
    Text(String),
    /// The file has another version.
    #[error("format is {0}, expected {FORMAT}")]
    Format(u32),
    /// A number is not finite, or there are too many places.
    #[error(
        "{count} places, expected at most {MOST_PLACES} with finite coordinates and radii of up to {LARGEST_M} m"
    )]
    Places {
        /// Number of places.
        count: usize,
    },
    /// A place lies so far away that the planners cannot be told of it.
    #[error(
        "a place is at easting {easting_m:?} m and northing {northing_m:?} m, expected at most {MOST_M} m from the origin of the global frame"
    )]
    Far {
        /// Easting of the place, m.
        easting_m: f64,
        /// Northing of the place, m.
        northing_m: f64,
    },
    /// The places are in another zone than the global frame.
    #[error("the places are in UTM zone {got}, expected zone {expected} of the global frame's origin")]
    Zone {
        /// Zone of the places.
        got: u32,
        /// Zone of the origin.
        expected: u8,
    },
}

/// The slip memory in a text; `None` for an empty one.
pub fn parse(text: &str) -> Result<Option<SlipMemory>, SlipsError> {
    if text.trim().is_empty() {
        return Ok(None);
    }
    let slips: SlipMemory = rcs_msg::from_json(text).map_err(|error| SlipsError::Text(error.to_string()))?;
    if slips.format != FORMAT {
        return Err(SlipsError::Format(slips.format));
    }
    let count = slips.places.len();
    let is_good = |place: &SlipPlace| {
        let is_placed = place.easting_m.is_finite() && place.northing_m.is_finite();
        is_placed && (0.0..=LARGEST_M).contains(&place.radius_m)
    };
    if count > MOST_PLACES || !slips.places.iter().all(is_good) {
        return Err(SlipsError::Places { count });
    }
    Ok(Some(slips))
}

/// The message of places in the global frame with this origin; the oldest ones are left out where there are too many.
pub fn to_message(places: &[Barred], origin: &Utm) -> SlipMemory {
    let place = |place: &Barred| SlipPlace {
        easting_m: origin.easting_m + place.at.0,
        northing_m: origin.northing_m + place.at.1,
        radius_m: place.radius_m,
    };
    let newest = &places[places.len().saturating_sub(MOST_PLACES)..];
    SlipMemory { format: FORMAT, zone: u32::from(origin.zone), places: newest.iter().map(place).collect() }
}

/// The places in the global frame with this origin, as the run knew it that slipped.
pub fn in_global(slips: &SlipMemory, origin: &Utm) -> Result<Vec<Barred>, SlipsError> {
    if slips.zone != u32::from(origin.zone) {
        return Err(SlipsError::Zone { got: slips.zone, expected: origin.zone });
    }
    let global = |place: &SlipPlace| {
        let at = origin.offset_to(place.easting_m, place.northing_m).into();
        Barred { at, radius_m: place.radius_m, slipped: true, stood: None }
    };
    let places: Vec<Barred> = slips.places.iter().map(global).collect();
    let mut each = std::iter::zip(&slips.places, &places);
    match each.find(|(_, place)| DVec2::from(place.at).length() > MOST_M) {
        Some((place, _)) => Err(SlipsError::Far { easting_m: place.easting_m, northing_m: place.northing_m }),
        None => Ok(places),
    }
}

/// Distance from a place where wheels slipped over some metres within which a route has no points, m.
const BESIDE_M: f64 = 1.5;

/// Leaves out of a route, global frame, m, what was driven with slip: the planners of the next run shall not be drawn there.
/// Where it begins and ends is kept.
pub fn leave_out(route: &mut Vec<DVec2>, slippery: &[(f64, f64)]) {
    let last = route.len().saturating_sub(1);
    let mut index = 0..;
    let is_end = |index: usize| index == 0 || index == last;
    route.retain(|&at| index.next().is_some_and(is_end) || !has_slipped(at, slippery));
}

/// Whether the wheels slipped over some metres where a point of a track lies, m.
fn has_slipped(at: DVec2, slippery: &[(f64, f64)]) -> bool {
    slippery.iter().any(|&place| at.distance(DVec2::from(place)) < BESIDE_M)
}

/// Whether a track leads over a place where the wheels did not slip, all in one frame, m.
pub fn was_driven_over(place: &Barred, track: &[(f64, f64)], slippery: &[(f64, f64)]) -> bool {
    let at = DVec2::from(place.at);
    let is_inside = |driven: &DVec2| driven.distance(at) < INNER * place.radius_m;
    track.iter().copied().map(DVec2::from).filter(is_inside).any(|driven| !has_slipped(driven, slippery))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn origin() -> Utm {
        Utm::new(18, true, 308_660.0, 4_333_755.0).unwrap()
    }

    fn place(at: (f64, f64), radius_m: f64) -> Barred {
        Barred { at, radius_m, slipped: true, stood: None }
    }

    fn places() -> [Barred; 2] {
        [place((12.5, -3.0), 2.0), place((14.0, 1.0), 4.5)]
    }

    #[test]
    fn a_route_has_no_points_where_the_wheels_slipped_but_both_ends() {
        let mut route: Vec<DVec2> = (0..=20).map(|x| DVec2::new(f64::from(x), 0.0)).collect();
        leave_out(&mut route, &[(0.0, 0.0), (10.0, 1.0), (11.0, 1.0), (20.0, 0.0)]);
        let kept: Vec<f64> = route.iter().map(|at| at.x).collect();
        assert_eq!(kept, [0, 2, 3, 4, 5, 6, 7, 8, 13, 14, 15, 16, 17, 18, 20].map(f64::from));
    }

    #[test]
    fn places_are_read_again_and_a_file_that_does_not_fit_is_refused() {
        let slips = to_message(&places(), &origin());
        let text = |slips: SlipMemory| rcs_msg::to_json(&rcs_msg::AnyMessage::new(slips)).unwrap();
        assert_eq!(parse(&text(slips.clone())), Ok(Some(slips.clone())));
        assert_eq!(parse(" "), Ok(None));
        assert_eq!(in_global(&slips, &origin()).unwrap(), places());
        let zone = in_global(&SlipMemory { zone: 17, ..slips.clone() }, &origin()).unwrap_err();
        assert!(zone.to_string().starts_with("the places are in UTM zone 17, expected zone 18"), "{zone}");
        let far = SlipPlace { easting_m: 1e300, ..slips.places[0] };
        let far = in_global(&SlipMemory { places: vec![far], ..slips.clone() }, &origin()).unwrap_err();
        assert!(far.to_string().starts_with("a place is at easting 1e300 m and northing 43337"), "{far}");
        let large = SlipPlace { radius_m: 1e6, ..slips.places[0] };
        for (slips, expected) in [
            (SlipMemory { format: 2, ..slips.clone() }, "format is 2"),
            (SlipMemory { places: vec![large], ..slips.clone() }, "1 places, expected at most 1000"),
            (SlipMemory { places: vec![slips.places[0]; 1001], ..slips }, "1001 places"),
        ] {
            let error = parse(&text(slips)).unwrap_err().to_string();
            assert!(error.starts_with(expected), "{error}");
        }
        assert!(matches!(parse("{"), Err(SlipsError::Text(_))));
    }

    #[test]
    fn the_newest_places_are_kept() {
        let many: Vec<Barred> = (0..1500).map(|x| place((f64::from(x), 0.0), 1.0)).collect();
        let slips = to_message(&many, &origin());
        assert_eq!(in_global(&slips, &origin()).unwrap(), many[500..]);
    }

    #[test]
    fn a_track_past_a_place_or_over_it_with_slip_does_not_clear_it() {
        let track = |y: f64| -> Vec<(f64, f64)> { (0..40).map(|x| (f64::from(x) / 2.0, y)).collect() };
        let [place, _] = places();
        assert!(was_driven_over(&place, &track(-2.5), &[]));
        assert!(
            !was_driven_over(&place, &track(-1.5), &[]),
            "at its border, as the vehicle stands when it slips"
        );
        let slippery = [(11.5, -2.5), (12.5, -2.5), (13.5, -2.5)];
        assert!(!was_driven_over(&place, &track(-2.5), &slippery), "crossed with slip");
        assert!(was_driven_over(&place, &track(-2.5), &[(5.0, -2.5)]), "the wheels slipped elsewhere");
    }
}
