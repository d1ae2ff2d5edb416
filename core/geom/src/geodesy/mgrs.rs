//! The Military Grid Reference System: UTM as text, such as `19TCG2320493737`.

use super::utm::FALSE_NORTHING_M;
use super::{GeodesyError, Utm};

/// Latitude bands of 8° from 80° south; the last reaches to 84°.
const BANDS: &[u8; 20] = b"CDEFGHJKLMNPQRSTUVWX";
/// Columns of 100 km, in three sets by zone.
const COLUMNS: [&[u8; 8]; 3] = [b"STUVWXYZ", b"ABCDEFGH", b"JKLMNPQR"];
/// Rows of 100 km; even zones start five letters later.
const ROWS: &[u8; 20] = b"ABCDEFGHJKLMNPQRSTUV";

impl Utm {
    /// The MGRS square that contains the position: zone, band, 100 km square, then `digits` digits (0 to 5) each of
    /// easting and northing, truncated, not rounded; 5 digits are 1 m. Refuses positions outside of MGRS.
    pub fn to_mgrs(&self, digits: usize) -> Result<String, GeodesyError> {
        let refused = || GeodesyError::NotUtm {
            zone: self.zone,
            easting_m: self.easting_m,
            northing_m: self.northing_m,
        };
        let latitude_deg = self.to_geodetic().latitude_deg;
        if !(1..=60).contains(&self.zone)
            || !(100_000.0..900_000.0).contains(&self.easting_m)
            || !(0.0..=FALSE_NORTHING_M).contains(&self.northing_m)
            || !(-80.5..=84.5).contains(&latitude_deg)
        {
            return Err(refused());
        }
        let column = (self.easting_m / 100_000.0).floor() as usize - 1;
        // The hemisphere decides the band at the equator, where rounding could give either.
        let band = ((latitude_deg + 80.0) / 8.0).floor() as i64;
        let band = if self.north { band.clamp(10, 19) } else { band.clamp(0, 9) };
        // 10,000,000 m in the south is the equator itself, which belongs to the last row below it.
        let northing_m = self.northing_m.min(if self.north { f64::MAX } else { FALSE_NORTHING_M - 1e-6 });
        let row = (northing_m / 100_000.0).floor() as usize;
        let shift = if self.zone.is_multiple_of(2) { 5 } else { 0 };
        let letters = [
            BANDS.get(band as usize),
            COLUMNS[usize::from(self.zone % 3)].get(column),
            ROWS.get((row + shift) % 20),
        ];
        let [Some(&band), Some(&column), Some(&row)] = letters else { return Err(refused()) };
        let digits = digits.min(5);
        let unit = 10_u32.pow(5 - digits as u32);
        let part = |metres: f64| metres.rem_euclid(100_000.0).floor() as u32 / unit;
        let square = format!("{:02}{}{}{}", self.zone, char::from(band), char::from(column), char::from(row));
        if digits == 0 {
            return Ok(square);
        }
        let (east, north) = (part(self.easting_m), part(northing_m));
        Ok(format!("{square}{east:0digits$}{north:0digits$}"))
    }

    /// The middle of the square that an MGRS text names. Blanks between the parts and lower-case letters are accepted.
    pub fn from_mgrs(text: &str) -> Result<Utm, GeodesyError> {
        let refused = |reason| GeodesyError::NotMgrs { text: text.to_owned(), reason };
        let letters: Vec<u8> =
            text.bytes().filter(|b| !b.is_ascii_whitespace()).map(|b| b.to_ascii_uppercase()).collect();
        let zone_digits = letters.iter().take_while(|b| b.is_ascii_digit()).count();
        if !(1..=2).contains(&zone_digits) {
            return Err(refused("expected a zone of one or two digits"));
        }
        let number = |digits: &[u8]| digits.iter().fold(0_u32, |sum, b| 10 * sum + u32::from(b - b'0'));
        let zone = number(&letters[..zone_digits]) as u8;
        if !(1..=60).contains(&zone) {
            return Err(refused("expected a zone from 1 to 60"));
        }
        let [band, column, row, digits @ ..] = &letters[zone_digits..] else {
            return Err(refused("expected a band and two letters after the zone"));
        };
        let place = |letter: &u8, set: &[u8]| set.iter().position(|l| l == letter);
        let band = place(band, BANDS).ok_or_else(|| refused("unknown latitude band"))?;
        let column = place(column, COLUMNS[usize::from(zone % 3)])
            .ok_or_else(|| refused("column letter is not of this zone"))?;
        let row = place(row, ROWS).ok_or_else(|| refused("unknown row letter"))?;
        if digits.len() % 2 == 1 || digits.len() > 10 || !digits.iter().all(u8::is_ascii_digit) {
            return Err(refused("expected an even number of digits, at most 10"));
        }
        let (east, north) = digits.split_at(digits.len() / 2);
        let unit = f64::from(10_u32.pow(5 - east.len() as u32));
        let offset = |digits: &[u8]| (f64::from(number(digits)) + 0.5) * unit;
        let easting_m = (column + 1) as f64 * 100_000.0 + offset(east);
        // Row letters repeat every 2000 km: take the repetition whose square touches the band.
        let shift = if zone.is_multiple_of(2) { 5 } else { 0 };
        let row = (row + 20 - shift) % 20;
        let (south_deg, north_deg) =
            (8.0 * band as f64 - 80.0, if band == 19 { 84.0 } else { 8.0 * band as f64 - 72.0 });
        let touches_band = |utm: &Utm| {
            // A square lies on one side of the central meridian, where parallels rise or fall monotonically, so the
            // corners suffice.
            let half = 0.5 * unit;
            let corner_deg = |dx: f64, dy: f64| {
                let corner = Utm { easting_m: utm.easting_m + dx, northing_m: utm.northing_m + dy, ..*utm };
                corner.to_geodetic().latitude_deg
            };
            let corners =
                [(-half, -half), (half, -half), (-half, half), (half, half)].map(|(x, y)| corner_deg(x, y));
            let lowest = corners.into_iter().fold(f64::MAX, f64::min);
            let highest = corners.into_iter().fold(f64::MIN, f64::max);
            lowest <= north_deg && highest >= south_deg
        };
        let candidates = (0..6).map(|repeat| Utm {
            zone,
            north: band >= 10,
            easting_m,
            northing_m: (row + 20 * repeat) as f64 * 100_000.0 + offset(north),
        });
        candidates
            .filter(|utm| utm.northing_m < FALSE_NORTHING_M)
            .find(touches_band)
            .ok_or_else(|| refused("square does not lie in this latitude band"))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::Geodetic;
    use super::*;

    proptest! {
        #[test]
        fn text_names_a_square_that_holds_the_place(lat in -79.9..83.9_f64, lon in -180.0..180.0_f64, digits in 0..=5_usize) {
            let utm = Utm::from_geodetic(&Geodetic::new(lat, lon, 0.0).unwrap()).unwrap();
            let text = utm.to_mgrs(digits).unwrap();
            let back = Utm::from_mgrs(&text).unwrap();
            let half = 0.5 * f64::from(10_u32.pow(5 - digits as u32)) + 1e-5;
            prop_assert_eq!((back.zone, back.north), (utm.zone, utm.north));
            prop_assert!((back.easting_m - utm.easting_m).abs() <= half, "{} {:?} {:?}", text, utm, back);
            prop_assert!((back.northing_m - utm.northing_m).abs() <= half, "{} {:?} {:?}", text, utm, back);
        }

        #[test]
        fn no_text_panics(text in "[0-9]{0,3}[A-Za-z]{0,4}[0-9 ]{0,12}|.*") {
            let _ = Utm::from_mgrs(&text);
        }

        #[test]
        fn no_coordinates_panic(zone: u8, north: bool, x: f64, y: f64, digits: usize) {
            let _ = Utm { zone, north, easting_m: x, northing_m: y }.to_mgrs(digits);
        }
    }

    #[test]
    fn text_that_names_no_square_is_refused_with_the_reason() {
        let reason = |text| match Utm::from_mgrs(text) {
            Err(GeodesyError::NotMgrs { reason, .. }) => reason,
            other => panic!("{other:?}"),
        };
        assert!(reason("").contains("zone"));
        assert!(reason("61TCG").contains("1 to 60"));
        assert!(reason("19ICG").contains("band"));
        assert!(reason("19TZG").contains("column"));
        assert!(reason("19TCW").contains("row"));
        assert!(reason("19TCG123").contains("even"));
        assert!(reason("19TCA").contains("does not lie"));
        assert!(Utm::from_mgrs("19t cg 23204 93737").is_ok());
    }
}
