//! Calibrations of cameras.

use super::{Writer, convert};
use rcs_msg::foxglove::CameraCalibration;

/// The calibration of a full image of 640 × 480 pixels with the matrices K, R and P. `sent` says which image is sent: binning
/// along x and y, then x, y, height and width of its region.
fn calibration(matrices: &[f64], sent: [u32; 6]) -> CameraCalibration {
    let mut writer = Writer::new(false);
    writer.header().u32(480).u32(640).text("plumb_bob").u32(5).floats(&[0.1, 0.2, 0.3, 0.4, 0.5]);
    writer.floats(matrices);
    for number in sent {
        writer.u32(number);
    }
    let message = convert("sensor_msgs/msg/CameraInfo", &writer.u8(0).done());
    message.get::<CameraCalibration>().expect("it is a calibration").clone()
}

#[test]
fn a_calibration_of_the_full_image_keeps_its_matrices() {
    let matrices: Vec<f64> = (0..30).map(f64::from).collect();
    for sent in [[0; 6], [1, 1, 0, 0, 480, 640]] {
        let calibration = calibration(&matrices, sent);
        assert_eq!((calibration.width, calibration.height, calibration.d.len()), (640, 480, 5));
        assert_eq!([calibration.k, calibration.r, calibration.p].concat(), matrices);
    }
}

#[test]
fn a_region_and_a_binned_image_show_a_point_where_the_full_image_does() {
    let k = [200.0, 0.0, 319.5, 0.0, 210.0, 239.5, 0.0, 0.0, 1.0];
    let p = [180.0, 0.0, 300.0, -9.0, 0.0, 190.0, 250.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let matrices = [&k[..], &[0.0; 9], &p].concat();
    // Columns and rows of a point in the raw image without distortion, and in the rectified one.
    let pixels = |calibration: &CameraCalibration| {
        let (k, p) = (&calibration.k, &calibration.p);
        let [x, y, z] = [1.0, 0.5, 2.0];
        [k[0] * x / z + k[2], k[4] * y / z + k[5], (p[0] * x + p[3]) / z + p[2], (p[5] * y + p[7]) / z + p[6]]
    };
    let full = pixels(&calibration(&matrices, [0; 6]));
    for (sent, size, offset, binning) in [
        ([1, 1, 80, 60, 150, 200], (200, 150), [80.0, 60.0], [1.0, 1.0]),
        ([0, 0, 80, 60, 0, 0], (560, 420), [80.0, 60.0], [1.0, 1.0]),
        ([2, 4, 0, 0, 0, 0], (320, 120), [0.0, 0.0], [2.0, 4.0]),
        ([2, 4, 80, 60, 150, 200], (100, 37), [80.0, 60.0], [2.0, 4.0]),
    ] {
        let calibration = calibration(&matrices, sent);
        assert_eq!((calibration.width, calibration.height), size);
        for (index, (got, full)) in pixels(&calibration).into_iter().zip(full).enumerate() {
            // A binned pixel covers several whole ones.
            let expected = (full - offset[index % 2] + 0.5) / binning[index % 2] - 0.5;
            assert!((got - expected).abs() < 1e-9, "{sent:?}: {got}, expected {expected}");
        }
    }
}
