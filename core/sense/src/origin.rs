//! The origin of the global frame, and conversion of geodetic positions to that frame.

use rcs_geom::{DVec3, GeodesyError, Geodetic, Utm};
use serde::{Deserialize, Serialize};

/// Origin of the frame `global`: a position in UTM. The axes of the frame are easting and northing; its height 0 is the
/// ellipsoid.
///
/// A position in the frame is a difference of UTM coordinates. Relative to true east and north, its axes are rotated by
/// the meridian convergence of the zone and scaled by 0.9996 to 1.001. Maps, courses and goals use the same grid, so
/// this affects nothing else.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Origin(pub Utm);

impl Origin {
    /// Parses the table `[origin]` of a world file: `zone`, `north` (default true), `easting_m` and `northing_m`. The
    /// rest of the file belongs to the simulation and is ignored.
    pub fn from_toml(text: &str) -> Result<Origin, String> {
        let file: toml::Table = toml::from_str(text).map_err(|error: toml::de::Error| {
            let start = error.span().map_or(0, |span| span.start);
            let line = 1 + text.bytes().take(start).filter(|&byte| byte == b'\n').count();
            format!("line {line}, {}", error.message().trim())
        })?;
        let table = file.get("origin").and_then(toml::Value::as_table);
        let table = table.ok_or("origin is missing, expected a table with zone, easting_m and northing_m")?;
        let number = |key: &str| {
            let value = table.get(key);
            let number = value.and_then(|value| value.as_float().or(value.as_integer().map(|n| n as f64)));
            number.ok_or_else(|| format!("origin.{key} is {value:?}, expected a number"))
        };
        let zone = table.get("zone").and_then(toml::Value::as_integer);
        let zone = zone.and_then(|zone| u8::try_from(zone).ok());
        let zone = zone.ok_or_else(|| format!("origin.zone is {:?}, expected 1 to 60", table.get("zone")))?;
        let north = table.get("north").and_then(toml::Value::as_bool).unwrap_or(true);
        let place = Utm::new(zone, north, number("easting_m")?, number("northing_m")?);
        place.and_then(Utm::within_latitudes).map(Origin).map_err(|error| format!("origin: {error}"))
    }

    /// Origin at the position of a fix.
    pub fn at(place: &Geodetic) -> Result<Origin, GeodesyError> {
        Utm::from_geodetic(place).map(Origin)
    }

    /// Position relative to the origin: east, north, up, m.
    pub fn global_from_geodetic(&self, place: &Geodetic) -> Result<DVec3, GeodesyError> {
        let utm = Utm::from_geodetic_in_zone(place, self.0.zone, self.0.north)?;
        Ok(self.0.offset_to(utm.easting_m, utm.northing_m).extend(place.altitude_m))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_world_file_gives_the_origin_and_places_are_differences_of_its_grid() {
        let text = "name = 'w'\n[origin]\nzone = 18\neasting_m = 309000.0\nnorthing_m = 4335000\n";
        let origin = Origin::from_toml(text).unwrap();
        let place = Utm::new(18, true, 309_030.0, 4_335_120.0).unwrap().to_geodetic();
        let p = origin.global_from_geodetic(&Geodetic { altitude_m: 3.0, ..place }).unwrap();
        assert!(p.abs_diff_eq(DVec3::new(30.0, 120.0, 3.0), 1e-6), "{p}");
    }

    #[test]
    fn a_file_without_a_sound_origin_is_refused_with_the_key() {
        for (text, expected) in [
            ("a = ", "line 1, "),
            ("a = 1\nb = ", "line 2, "),
            ("a = 1", "origin is missing"),
            ("[origin]\nzone = 18\neasting_m = 'x'\nnorthing_m = 1.0", "origin.easting_m is"),
            ("[origin]\nzone = 300\neasting_m = 1.0\nnorthing_m = 1.0", "origin.zone is"),
            ("[origin]\nzone = 61\neasting_m = 300000.0\nnorthing_m = 1.0", "origin: "),
            ("[origin]\nzone = 18\neasting_m = 300000.0\nnorthing_m = 9.4e6", "origin: latitude 84."),
        ] {
            let error = Origin::from_toml(text).unwrap_err();
            assert!(error.contains(expected), "{text:?}: {error}");
        }
    }
}
