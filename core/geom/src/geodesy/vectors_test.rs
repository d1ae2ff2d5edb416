//! Comparison with GeographicLib's results (`geo-vectors` among the public datasets).

use glam::DVec3;

use super::*;

/// Rows of a CSV with comment lines and one header line.
fn rows(name: &str) -> Option<Vec<Vec<String>>> {
    let path = rcs_testkit::data_dir()?.join("geo-vectors").join(name);
    let text = std::fs::read_to_string(path).unwrap();
    let lines = text.lines().filter(|line| !line.starts_with('#')).skip(1);
    Some(lines.map(|line| line.split(',').map(str::to_owned).collect()).collect())
}

fn number(text: &str) -> f64 {
    text.parse().unwrap()
}

#[test]
fn utm_and_mgrs_agree_with_geographiclib_to_10_nanometres() {
    let Some(rows) = rows("utm_mgrs_wgs84.csv") else { return };
    assert_eq!(rows.len(), 200);
    let (mut worst_forward_m, mut worst_back_deg) = (0.0_f64, 0.0_f64);
    for row in rows {
        let place = Geodetic::new(number(&row[0]), number(&row[1]), 0.0).unwrap();
        let utm = Utm::from_geodetic(&place).unwrap();
        assert_eq!(
            (utm.zone.to_string(), if utm.north { "n" } else { "s" }),
            (row[2].clone(), &*row[3]),
            "{row:?}"
        );
        let (easting_m, northing_m) = (number(&row[4]), number(&row[5]));
        let error_m = libm::hypot(utm.easting_m - easting_m, utm.northing_m - northing_m);
        worst_forward_m = worst_forward_m.max(error_m);
        assert_eq!(utm.to_mgrs(5).unwrap(), row[6], "{row:?}");
        let back = Utm::new(utm.zone, utm.north, easting_m, northing_m).unwrap().to_geodetic();
        let off_deg = libm::remainder(back.longitude_deg - place.longitude_deg, 360.0).abs();
        worst_back_deg = worst_back_deg.max(off_deg).max((back.latitude_deg - place.latitude_deg).abs());
    }
    println!("utm: worst {worst_forward_m:e} m forward, {worst_back_deg:e} degrees back");
    assert!(worst_forward_m < 1e-8, "{worst_forward_m}");
    // Positions are given to 1e-12 degrees and coordinates to 1e-9 m, which is 1e-14 degrees of latitude.
    assert!(worst_back_deg < 2e-12, "{worst_back_deg}");
}

#[test]
fn east_north_up_agrees_with_geographiclib_to_a_micrometre() {
    let Some(rows) = rows("enu_local_cartesian.csv") else { return };
    let enu = Enu::new(Geodetic::new(42.375_812, -71.147_394_666_666_67, 7.3).unwrap());
    let (mut worst_forward_m, mut worst_back_m) = (0.0_f64, 0.0_f64);
    assert!(rows.len() >= 99);
    for row in rows {
        let place = Geodetic::new(number(&row[0]), number(&row[1]), number(&row[2])).unwrap();
        let expected = DVec3::new(number(&row[3]), number(&row[4]), number(&row[5]));
        worst_forward_m = worst_forward_m.max(enu.enu_from_geodetic(&place).distance(expected));
        let back = enu.geodetic_from_enu(expected);
        worst_back_m = worst_back_m.max(ecef_from_geodetic(&back).distance(ecef_from_geodetic(&place)));
    }
    println!("enu: worst {worst_forward_m:e} m forward, {worst_back_m:e} m back");
    assert!(worst_forward_m < 1e-6, "{worst_forward_m}");
    assert!(worst_back_m < 1e-6, "{worst_back_m}");
}
