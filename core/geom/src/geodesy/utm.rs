//! Universal Transverse Mercator: Krüger's series to the sixth order in the third flattening.
//!
//! Coefficients and method: Karney, "Transverse Mercator with an accuracy of a few nanometers" (2011), equations 7 to
//! 36; the series is good to 5 nm in a UTM zone.

use glam::DVec2;
use serde::{Deserialize, Serialize};

use super::{FLATTENING, GeodesyError, Geodetic, SEMI_MAJOR_AXIS_M};

/// Scale on the central meridian.
const K0: f64 = 0.9996;
const FALSE_EASTING_M: f64 = 500_000.0;
/// False northing of the southern hemisphere, which makes northings positive, metres.
pub(super) const FALSE_NORTHING_M: f64 = 10_000_000.0;
/// Third flattening.
const N: f64 = FLATTENING / (2.0 - FLATTENING);

/// A position in a UTM zone, without its height.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Utm {
    /// 1 to 60.
    pub zone: u8,
    /// Whether northings count from the equator (true) or from 10,000 km south of it.
    pub north: bool,
    /// Metres; 500,000 on the zone's central meridian.
    pub easting_m: f64,
    /// Metres.
    pub northing_m: f64,
}

impl Utm {
    /// A position by its coordinates in a zone. Refuses coordinates far outside of the zone, where the projection is
    /// not used.
    pub fn new(zone: u8, north: bool, easting_m: f64, northing_m: f64) -> Result<Utm, GeodesyError> {
        let inside =
            (0.0..=1_000_000.0).contains(&easting_m) && (-100_000.0..=10_100_000.0).contains(&northing_m);
        if !(1..=60).contains(&zone) || !inside {
            return Err(GeodesyError::NotUtm { zone, easting_m, northing_m });
        }
        Ok(Utm { zone, north, easting_m, northing_m })
    }

    /// The same position. Refuses latitudes outside of −80° to 84°, which [`Utm::new`] accepts.
    pub fn within_latitudes(self) -> Result<Utm, GeodesyError> {
        check_latitude(self.to_geodetic().latitude_deg).map(|()| self)
    }

    /// The position in its own zone and hemisphere, with the exceptions for Norway and Svalbard.
    /// Refuses latitudes outside of −80° to 84°.
    pub fn from_geodetic(place: &Geodetic) -> Result<Utm, GeodesyError> {
        let zone = standard_zone(place.latitude_deg, place.wrapped_longitude_deg());
        // As in GeographicLib, −0 is in the southern hemisphere.
        Utm::from_geodetic_in_zone(place, zone, !place.latitude_deg.is_sign_negative())
    }

    /// The position in the coordinates of a given zone and hemisphere, so that a map across a zone border stays in one
    /// coordinate system. Accurate to a millimetre up to about 20° from the central meridian of the zone.
    pub fn from_geodetic_in_zone(place: &Geodetic, zone: u8, north: bool) -> Result<Utm, GeodesyError> {
        let latitude_deg = place.latitude_deg;
        check_latitude(latitude_deg)?;
        let longitude_deg = libm::remainder(place.longitude_deg - central_meridian_deg(zone), 360.0);
        if !(1..=60).contains(&zone) || longitude_deg.abs() > 40.0 {
            return Err(GeodesyError::NotUtm { zone, easting_m: f64::NAN, northing_m: f64::NAN });
        }
        let (x, y) = project(latitude_deg.to_radians(), longitude_deg.to_radians());
        let false_northing = if north { 0.0 } else { FALSE_NORTHING_M };
        Ok(Utm { zone, north, easting_m: x + FALSE_EASTING_M, northing_m: y + false_northing })
    }

    /// Where coordinates of the same zone and hemisphere lie from here: east and north, m.
    pub fn offset_to(&self, easting_m: f64, northing_m: f64) -> DVec2 {
        DVec2::new(easting_m - self.easting_m, northing_m - self.northing_m)
    }

    /// The geodetic position, at height 0.
    pub fn to_geodetic(&self) -> Geodetic {
        let false_northing = if self.north { 0.0 } else { FALSE_NORTHING_M };
        let (latitude, longitude) =
            unproject(self.easting_m - FALSE_EASTING_M, self.northing_m - false_northing);
        let place = Geodetic {
            latitude_deg: latitude.to_degrees(),
            longitude_deg: longitude.to_degrees() + central_meridian_deg(self.zone),
            altitude_m: 0.0,
        };
        Geodetic { longitude_deg: place.wrapped_longitude_deg(), ..place }
    }
}

fn check_latitude(latitude_deg: f64) -> Result<(), GeodesyError> {
    let is_inside = (-80.0..=84.0).contains(&latitude_deg);
    if is_inside { Ok(()) } else { Err(GeodesyError::OutsideUtm { latitude_deg }) }
}

/// The zone of a position (degrees), longitude in [−180, 180).
fn standard_zone(latitude_deg: f64, longitude_deg: f64) -> u8 {
    let (latitude, longitude) = (latitude_deg.floor() as i32, longitude_deg.floor() as i32);
    let zone = match longitude {
        // South-west Norway and Svalbard have wider zones than the grid.
        3..6 if (56..64).contains(&latitude) => 32,
        0..42 if (72..84).contains(&latitude) || latitude_deg == 84.0 => match longitude {
            0..9 => 31,
            9..21 => 33,
            21..33 => 35,
            _ => 37,
        },
        _ => (longitude + 180) / 6 + 1,
    };
    zone.clamp(1, 60) as u8
}

fn central_meridian_deg(zone: u8) -> f64 {
    6.0 * f64::from(zone) - 183.0
}

/// Rectifying radius: radius of the sphere whose meridian is as long as the ellipsoid's, metres (Karney's A, equation
/// 14).
fn rectifying_radius_m() -> f64 {
    let n2 = N * N;
    SEMI_MAJOR_AXIS_M / (1.0 + N) * (1.0 + n2 * (1.0 / 4.0 + n2 * (1.0 / 64.0 + n2 / 256.0)))
}

/// Karney's α (equation 35): from the conformal sphere to the projection.
const ALPHA: [[f64; 6]; 6] = [
    [1.0 / 2.0, -2.0 / 3.0, 5.0 / 16.0, 41.0 / 180.0, -127.0 / 288.0, 7891.0 / 37800.0],
    [0.0, 13.0 / 48.0, -3.0 / 5.0, 557.0 / 1440.0, 281.0 / 630.0, -1_983_433.0 / 1_935_360.0],
    [0.0, 0.0, 61.0 / 240.0, -103.0 / 140.0, 15061.0 / 26880.0, 167_603.0 / 181_440.0],
    [0.0, 0.0, 0.0, 49561.0 / 161_280.0, -179.0 / 168.0, 6_601_661.0 / 7_257_600.0],
    [0.0, 0.0, 0.0, 0.0, 34729.0 / 80640.0, -3_418_889.0 / 1_995_840.0],
    [0.0, 0.0, 0.0, 0.0, 0.0, 212_378_941.0 / 319_334_400.0],
];

/// Karney's β (equation 36): from the projection to the conformal sphere.
const BETA: [[f64; 6]; 6] = [
    [1.0 / 2.0, -2.0 / 3.0, 37.0 / 96.0, -1.0 / 360.0, -81.0 / 512.0, 96199.0 / 604_800.0],
    [0.0, 1.0 / 48.0, 1.0 / 15.0, -437.0 / 1440.0, 46.0 / 105.0, -1_118_711.0 / 3_870_720.0],
    [0.0, 0.0, 17.0 / 480.0, -37.0 / 840.0, -209.0 / 4480.0, 5569.0 / 90720.0],
    [0.0, 0.0, 0.0, 4397.0 / 161_280.0, -11.0 / 504.0, -830_251.0 / 7_257_600.0],
    [0.0, 0.0, 0.0, 0.0, 4583.0 / 161_280.0, -108_847.0 / 3_991_680.0],
    [0.0, 0.0, 0.0, 0.0, 0.0, 20_648_693.0 / 638_668_800.0],
];

/// Σ cⱼ sin(2j(ξ + iη)) as real and imaginary part, where cⱼ are polynomials in n.
fn series(table: &[[f64; 6]; 6], xi: f64, eta: f64) -> (f64, f64) {
    let mut sum = (0.0, 0.0);
    for (j, row) in (1..).zip(table) {
        let coefficient = row.iter().rev().fold(0.0, |sum, &c| (sum + c) * N);
        let (sin, cos) = libm::sincos(2.0 * f64::from(j) * xi);
        let (sinh, cosh) = (libm::sinh(2.0 * f64::from(j) * eta), libm::cosh(2.0 * f64::from(j) * eta));
        sum.0 += coefficient * sin * cosh;
        sum.1 += coefficient * cos * sinh;
    }
    sum
}

/// Tangent of the conformal latitude from the tangent of the geodetic one (equations 7 to 9).
fn conformal_tan(tau: f64) -> f64 {
    let e = eccentricity();
    let length = libm::hypot(1.0, tau);
    let sigma = libm::sinh(e * libm::atanh(e * tau / length));
    tau * libm::hypot(1.0, sigma) - sigma * length
}

fn eccentricity() -> f64 {
    libm::sqrt(FLATTENING * (2.0 - FLATTENING))
}

/// Easting and northing (metres) from latitude and from longitude relative to the central meridian (radians).
fn project(latitude: f64, longitude: f64) -> (f64, f64) {
    let tau = conformal_tan(libm::tan(latitude));
    let (sin_lon, cos_lon) = libm::sincos(longitude);
    let xi = libm::atan2(tau, cos_lon);
    let eta = libm::asinh(sin_lon / libm::hypot(tau, cos_lon));
    let (d_xi, d_eta) = series(&ALPHA, xi, eta);
    let scale = K0 * rectifying_radius_m();
    (scale * (eta + d_eta), scale * (xi + d_xi))
}

/// The inverse of [`project`].
fn unproject(x: f64, y: f64) -> (f64, f64) {
    let scale = K0 * rectifying_radius_m();
    let (xi, eta) = (y / scale, x / scale);
    let (d_xi, d_eta) = series(&BETA, xi, eta);
    let (xi, eta) = (xi - d_xi, eta - d_eta);
    let (sin_xi, cos_xi) = libm::sincos(xi);
    let sinh_eta = libm::sinh(eta);
    let longitude = libm::atan2(sinh_eta, cos_xi);
    let target = sin_xi / libm::hypot(sinh_eta, cos_xi);
    // Newton's method (equations 19 to 21); two steps converge to the last bit.
    let e2 = FLATTENING * (2.0 - FLATTENING);
    let mut tau = target / (1.0 - e2);
    for _ in 0..5 {
        let at = conformal_tan(tau);
        let step = (target - at) / libm::hypot(1.0, at) * (1.0 + (1.0 - e2) * tau * tau)
            / ((1.0 - e2) * libm::hypot(1.0, tau));
        tau += step;
        if step.abs() <= 1e-14 * tau.abs().max(1.0) {
            break;
        }
    }
    (libm::atan(tau), longitude)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn places_come_back(lat in -80.0..=84.0_f64, lon in -720.0..720.0_f64) {
            let place = Geodetic::new(lat, lon, 0.0).unwrap();
            let back = Utm::from_geodetic(&place).unwrap().to_geodetic();
            prop_assert!((back.latitude_deg - lat).abs() < 1e-12 * 10.0);
            let off = libm::remainder(back.longitude_deg - lon, 360.0);
            prop_assert!(off.abs() < 1e-11, "{off}");
        }

        #[test]
        fn neighbouring_zones_agree_on_a_place_at_their_border(lat in -79.0..83.0_f64, zone in 1..60_u8) {
            let place = Geodetic::new(lat, f64::from(zone) * 6.0 - 180.0, 0.0).unwrap();
            for zone in [zone, zone + 1] {
                let back = Utm::from_geodetic_in_zone(&place, zone, true).unwrap().to_geodetic();
                prop_assert!((back.latitude_deg - lat).abs() < 1e-11);
            }
        }

        #[test]
        fn no_coordinates_panic(zone: u8, north: bool, x: f64, y: f64) {
            let _ = Utm { zone, north, easting_m: x, northing_m: y }.to_geodetic();
            let _ = Utm::new(zone, north, x, y);
            let place = Geodetic { latitude_deg: x, longitude_deg: y, altitude_m: 0.0 };
            let _ = Utm::from_geodetic(&place);
        }
    }

    #[test]
    fn what_is_outside_is_refused() {
        let place = Geodetic::new(85.0, 0.0, 0.0).unwrap();
        assert_eq!(Utm::from_geodetic(&place), Err(GeodesyError::OutsideUtm { latitude_deg: 85.0 }));
        assert!(Utm::new(0, true, 500_000.0, 0.0).is_err());
        assert!(Utm::new(61, true, 500_000.0, 0.0).is_err());
        assert!(Utm::new(31, true, f64::NAN, 0.0).is_err());
        for (north, northing_m, is_inside) in [
            (true, 9.3e6, true),
            (true, 9.4e6, false),
            (true, 0.0, true),
            (false, 1.2e6, true),
            (false, 1.0e6, false),
            (false, 0.0, false),
        ] {
            let place = Utm::new(31, north, 500_000.0, northing_m).unwrap().within_latitudes();
            assert_eq!(place.is_ok(), is_inside, "{north} {northing_m}: {place:?}");
        }
    }
}
