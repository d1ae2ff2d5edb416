//! The origin of the global frame, and places of the earth in it.

use glam::DVec3;
use rcs_geom::{GeodesyError, Geodetic, Utm};
use serde::{Deserialize, Serialize};

/// Origin of the frame `global`: its (0, 0) is a place in UTM, its axes are easting and northing, its height 0 is the
/// ellipsoid's.
///
/// A place in it is a difference of UTM coordinates. Against true east and north these axes are turned by the zone's
/// convergence and scaled by 0.9996 to 1.001; maps, courses and goals use the same grid, so nothing else sees that.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Origin(pub Utm);

impl Origin {
    /// From the text of a world file: its table `[origin]` with `zone`, `north` (true where it is absent), `easting_m`
    /// and `northing_m`. The rest of the file is the simulation's own and is not looked at.
    pub fn from_toml(text: &str) -> Result<Origin, String> {
        let file: toml::Table = toml::from_str(text).map_err(|error| error.to_string())?;
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
        place.map(Origin).map_err(|error| format!("origin: {error}"))
    }

    /// The place of a fix.
    pub fn at(place: &Geodetic) -> Result<Origin, GeodesyError> {
        Utm::from_geodetic(place).map(Origin)
    }

    /// East, north and up of the origin, m.
    pub fn global_from_geodetic(&self, place: &Geodetic) -> Result<DVec3, GeodesyError> {
        let utm = Utm::from_geodetic_in_zone(place, self.0.zone, self.0.north)?;
        Ok(DVec3::new(utm.easting_m - self.0.easting_m, utm.northing_m - self.0.northing_m, place.altitude_m))
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
            ("a = ", "line 1"),
            ("a = 1", "origin is missing"),
            ("[origin]\nzone = 18\neasting_m = 'x'\nnorthing_m = 1.0", "origin.easting_m is"),
            ("[origin]\nzone = 300\neasting_m = 1.0\nnorthing_m = 1.0", "origin.zone is"),
            ("[origin]\nzone = 61\neasting_m = 300000.0\nnorthing_m = 1.0", "origin: "),
        ] {
            let error = Origin::from_toml(text).unwrap_err();
            assert!(error.contains(expected), "{text:?}: {error}");
        }
    }
}
