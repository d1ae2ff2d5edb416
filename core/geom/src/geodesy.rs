//! Positions on the WGS84 ellipsoid.
//!
//! - [`Geodetic`]: latitude, longitude, height.
//! - [`Utm`]: the transverse Mercator projection by zones, and its MGRS text.
//! - [`Enu`]: the local east-north-up frame at a position.
//!
//! This code is our own because the available crates take their transcendental functions from the system and panic on
//! some inputs.

mod enu;
mod mgrs;
mod utm;

use serde::{Deserialize, Serialize};

pub use enu::{Enu, ecef_from_geodetic, geodetic_from_ecef};
pub use utm::Utm;

/// Semi-major axis of WGS84, metres.
pub const SEMI_MAJOR_AXIS_M: f64 = 6_378_137.0;
/// Flattening of WGS84.
pub const FLATTENING: f64 = 1.0 / 298.257_223_563;

/// Why numbers or a text do not give a position, or why a position has no such coordinates.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GeodesyError {
    /// Latitude outside of −90° to 90°, or a number that is not finite.
    #[error("latitude {latitude_deg}, longitude {longitude_deg}, altitude {altitude_m} m is not a place")]
    NotAPlace {
        /// Degrees.
        latitude_deg: f64,
        /// Degrees.
        longitude_deg: f64,
        /// Metres.
        altitude_m: f64,
    },
    /// Latitude outside of the range of UTM, which is −80° to 84°.
    #[error("latitude {latitude_deg} is outside of UTM, expected -80 to 84")]
    OutsideUtm {
        /// Degrees.
        latitude_deg: f64,
    },
    /// A zone number outside of 1 to 60, or coordinates outside of the zone.
    #[error("zone {zone}, easting {easting_m} m, northing {northing_m} m is not in UTM")]
    NotUtm {
        /// 1 to 60.
        zone: u8,
        /// Metres.
        easting_m: f64,
        /// Metres.
        northing_m: f64,
    },
    /// The text is not an MGRS reference.
    #[error("\"{text}\" is not an mgrs reference: {reason}")]
    NotMgrs {
        /// The text.
        text: String,
        /// What is wrong with it.
        reason: &'static str,
    },
}

/// A position: WGS84 latitude and longitude in degrees, height above the ellipsoid in metres.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Geodetic {
    /// North positive, −90 to 90.
    pub latitude_deg: f64,
    /// East positive. Longitudes that differ by a multiple of 360 are the same position.
    pub longitude_deg: f64,
    /// Height above the ellipsoid (not above sea level), metres.
    pub altitude_m: f64,
}

impl Geodetic {
    /// Refuses numbers that are not finite and latitudes outside of −90° to 90°.
    pub fn new(latitude_deg: f64, longitude_deg: f64, altitude_m: f64) -> Result<Geodetic, GeodesyError> {
        let finite = longitude_deg.is_finite() && altitude_m.is_finite();
        if !finite || !(-90.0..=90.0).contains(&latitude_deg) {
            return Err(GeodesyError::NotAPlace { latitude_deg, longitude_deg, altitude_m });
        }
        Ok(Geodetic { latitude_deg, longitude_deg, altitude_m })
    }

    /// Longitude wrapped to [−180, 180), degrees.
    pub fn wrapped_longitude_deg(&self) -> f64 {
        let wrapped = libm::remainder(self.longitude_deg, 360.0);
        if wrapped >= 180.0 { wrapped - 360.0 } else { wrapped }
    }
}

#[cfg(test)]
#[path = "geodesy/vectors_test.rs"]
mod vectors_test;
