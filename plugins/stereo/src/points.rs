//! Coloured points with their pixels.

use crate::StereoCamera;
use glam::{DVec3, Vec3};
use std::sync::Arc;

/// A pixel with a range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Column and row in the rectified left image.
    pub pixel: [u16; 2],
    /// Position in the left camera's rectified optical frame (x right, y down, z forward), m.
    pub position_m: Vec3,
    /// Red, green and blue of the pixel.
    pub colour: [u8; 3],
}

impl StereoCamera {
    /// The points of a disparity image in the order of its pixels. `rgb` is the rectified left image, three bytes per
    /// pixel. Pixels without range, and pixels beyond the end of either slice, are left out.
    pub fn points<'a>(&'a self, disparity: &'a [u16], rgb: &'a [u8]) -> impl Iterator<Item = Point> + 'a {
        let camera = self.left().camera();
        let [width, height] = [camera.width, camera.height].map(|side| side as usize);
        // Divided once for each column and row.
        let slopes_x: Arc<[f64]> = (0..width).map(|u| (u as f64 - camera.cx) / camera.fx).collect();
        let rows = disparity.chunks(width).zip(rgb.as_chunks::<3>().0.chunks(width)).take(height);
        rows.enumerate().flat_map(move |(v, (disparity, colours))| {
            let slope_y = (v as f64 - camera.cy) / camera.fy;
            let slopes_x = Arc::clone(&slopes_x);
            let pixels = disparity.iter().zip(colours).enumerate();
            pixels.filter_map(move |(u, (&d, &colour))| {
                let depth = self.depth_m(d)?;
                let position_m = DVec3::new(slopes_x[u] * depth, slope_y * depth, depth).as_vec3();
                Some(Point { pixel: [u as u16, v as u16], position_m, colour })
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use crate::{CameraInfo, NO_DISPARITY, STEPS_PER_PIXEL, StereoCamera};
    use glam::DVec3;
    use rcs_geom::{Distortion, PinholeCamera};

    #[test]
    fn a_point_projects_onto_its_pixel_in_both_cameras() {
        let raw = PinholeCamera::new([64, 48], [100.0, 90.0], [30.0, 20.0], Distortion::None).unwrap();
        let r = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        let p = |tx| [100.0, 0.0, 30.0, tx, 0.0, 90.0, 20.0, 0.0, 0.0, 0.0, 1.0, 0.0];
        let left = CameraInfo { raw: &raw, r: &r, p: &p(0.0) };
        let camera = StereoCamera::new(left, CameraInfo { raw: &raw, r: &r, p: &p(-12.0) }).unwrap();
        let mut disparity = vec![NO_DISPARITY; 64 * 48];
        disparity[7 * 64 + 50] = 9 * STEPS_PER_PIXEL + 4;
        let rgb: Vec<u8> = (0..64 * 48 * 3).map(|i| i as u8).collect();
        let points: Vec<_> = camera.points(&disparity, &rgb).collect();
        assert_eq!(points.len(), 1);
        let point = points[0];
        let at = (7 * 64 + 50) * 3;
        assert_eq!((point.pixel, &point.colour[..]), ([50, 7], &rgb[at..at + 3]));
        let position = point.position_m.as_dvec3();
        let seen = |position: DVec3| raw.project(position).unwrap();
        assert!(seen(position).distance(glam::DVec2::new(50.0, 7.0)) < 1e-4);
        let from_right = position - DVec3::new(camera.baseline_m(), 0.0, 0.0);
        assert!(seen(from_right).distance(glam::DVec2::new(50.0 - 9.25, 7.0)) < 1e-4);
    }
}
