//! Earth-centred coordinates and the local east-north-up frame.

use glam::{DMat3, DQuat, DVec3};
use serde::{Deserialize, Serialize};

use crate::Pose;

use super::{FLATTENING, Geodetic, SEMI_MAJOR_AXIS_M};

/// Square of the first eccentricity.
const E2: f64 = FLATTENING * (2.0 - FLATTENING);

/// Earth-centred, earth-fixed position, metres: x through the equator at Greenwich, z through the north pole.
pub fn ecef_from_geodetic(place: &Geodetic) -> DVec3 {
    let (sin_lat, cos_lat) = libm::sincos(place.latitude_deg.to_radians());
    let (sin_lon, cos_lon) = libm::sincos(place.wrapped_longitude_deg().to_radians());
    let n = SEMI_MAJOR_AXIS_M / libm::sqrt(1.0 - E2 * sin_lat * sin_lat);
    let equatorial = (n + place.altitude_m) * cos_lat;
    DVec3::new(equatorial * cos_lon, equatorial * sin_lon, (n * (1.0 - E2) + place.altitude_m) * sin_lat)
}

/// The inverse of [`ecef_from_geodetic`] for positions at most about 50 km below the ellipsoid: Bowring's formula as
/// the first guess, then fixed-point iteration on the latitude.
pub fn geodetic_from_ecef(p_ecef: DVec3) -> Geodetic {
    let equatorial = libm::hypot(p_ecef.x, p_ecef.y);
    let b = SEMI_MAJOR_AXIS_M * (1.0 - FLATTENING);
    // Start from the reduced latitude; each step of Bowring's method reduces the error by a factor of about e⁴.
    let mut reduced = libm::atan2(p_ecef.z, (1.0 - FLATTENING) * equatorial);
    let mut latitude = reduced;
    for _ in 0..5 {
        let (s, c) = libm::sincos(reduced);
        latitude = libm::atan2(
            p_ecef.z + E2 / (1.0 - E2) * b * s * s * s,
            equatorial - E2 * SEMI_MAJOR_AXIS_M * c * c * c,
        );
        let (s, c) = libm::sincos(latitude);
        reduced = libm::atan2((1.0 - FLATTENING) * s, c);
    }
    let (s, c) = libm::sincos(latitude);
    // Projected on the normal, which is well conditioned at the poles and at the equator.
    let altitude_m = equatorial * c + p_ecef.z * s - SEMI_MAJOR_AXIS_M * libm::sqrt(1.0 - E2 * s * s);
    Geodetic {
        latitude_deg: latitude.to_degrees(),
        longitude_deg: libm::atan2(p_ecef.y, p_ecef.x).to_degrees(),
        altitude_m,
    }
}

/// The local frame at a position: x east, y north, z up (along the normal of the ellipsoid), metres.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Enu {
    origin: Geodetic,
    origin_ecef: DVec3,
    /// Columns: east, north, up in earth-centred coordinates.
    axes_ecef: DMat3,
}

impl Enu {
    /// The frame whose origin is this position.
    pub fn new(origin: Geodetic) -> Enu {
        let (sin_lat, cos_lat) = libm::sincos(origin.latitude_deg.to_radians());
        let (sin_lon, cos_lon) = libm::sincos(origin.wrapped_longitude_deg().to_radians());
        let east = DVec3::new(-sin_lon, cos_lon, 0.0);
        let north = DVec3::new(-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat);
        let up = DVec3::new(cos_lat * cos_lon, cos_lat * sin_lon, sin_lat);
        let axes_ecef = DMat3::from_cols(east, north, up);
        Enu { origin, origin_ecef: ecef_from_geodetic(&origin), axes_ecef }
    }

    /// The position of the origin.
    pub fn origin(&self) -> Geodetic {
        self.origin
    }

    /// The pose of this frame in earth-centred coordinates.
    pub fn ecef_from_enu(&self) -> Pose {
        Pose::new(DQuat::from_mat3(&self.axes_ecef), self.origin_ecef)
    }

    /// A position as east, north, up, metres.
    pub fn enu_from_geodetic(&self, place: &Geodetic) -> DVec3 {
        self.axes_ecef.transpose() * (ecef_from_geodetic(place) - self.origin_ecef)
    }

    /// The position of the point east, north, up, metres.
    pub fn geodetic_from_enu(&self, p_enu: DVec3) -> Geodetic {
        geodetic_from_ecef(self.axes_ecef * p_enu + self.origin_ecef)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn two_local_frames_differ_by_a_rigid_transform() {
        let [a, b] = [(48.0, 8.0, 120.0), (48.1, 8.2, 400.0)].map(|(latitude, longitude, altitude)| {
            Enu::new(Geodetic::new(latitude, longitude, altitude).unwrap())
        });
        let place = Geodetic::new(48.05, 8.1, 0.0).unwrap();
        let a_from_b = a.ecef_from_enu().inverse() * b.ecef_from_enu();
        let difference = a_from_b * b.enu_from_geodetic(&place) - a.enu_from_geodetic(&place);
        assert!(difference.length() < 1e-6, "{difference}");
    }

    proptest! {
        #[test]
        fn ecef_round_trips_everywhere(lat in -90.0..=90.0_f64, lon in -180.0..180.0_f64, alt in -10_000.0..1e6_f64) {
            let place = Geodetic::new(lat, lon, alt).unwrap();
            let p = ecef_from_geodetic(&place);
            let back = geodetic_from_ecef(p);
            prop_assert!((back.altitude_m - alt).abs() < 1e-7);
            prop_assert!(ecef_from_geodetic(&back).distance(p) < 1e-7);
        }

        #[test]
        fn local_frame_round_trips(lat in -89.0..89.0_f64, lon in -180.0..180.0_f64,
                                   p in prop::array::uniform3(-50_000.0..50_000.0_f64)) {
            let enu = Enu::new(Geodetic::new(lat, lon, 100.0).unwrap());
            let p = DVec3::from_array(p);
            prop_assert!(enu.enu_from_geodetic(&enu.geodetic_from_enu(p)).distance(p) < 1e-7);
        }
    }

    #[test]
    fn poles_and_the_centre_of_the_earth_do_not_panic() {
        let pole = geodetic_from_ecef(DVec3::new(0.0, 0.0, 6_356_752.314_245));
        assert!((pole.latitude_deg - 90.0).abs() < 1e-9 && pole.altitude_m.abs() < 1e-6);
        let _ = geodetic_from_ecef(DVec3::ZERO);
        let _ = geodetic_from_ecef(DVec3::NAN);
    }
}
