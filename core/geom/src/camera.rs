//! Pinhole cameras.

use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

use crate::Distortion;
use crate::camera_error::CameraError;

/// A camera that maps rays of its optical frame (x right, y down, z forward) to pixels.
///
/// Pixel (0, 0) is the **centre** of the top left pixel, u right and v down, as in OpenCV and ROS.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PinholeCamera {
    /// Pixels.
    pub width: u32,
    /// Pixels.
    pub height: u32,
    /// Focal length along u, pixels.
    pub fx: f64,
    /// Focal length along v, pixels.
    pub fy: f64,
    /// Principal point, pixels.
    pub cx: f64,
    /// Principal point, pixels.
    pub cy: f64,
    /// Lens distortion.
    pub distortion: Distortion,
    /// [`Distortion::valid_radius`] of the lens, cached because it is slow to compute.
    valid_radius: f64,
}

/// Greatest accepted width or height, pixels.
const MAX_SIDE: u32 = 1 << 15;
/// Greatest accepted number of pixels: memory for rays and labels is taken by it.
const MAX_PIXELS: u64 = 1 << 27;

impl PinholeCamera {
    /// A camera from its parameters, pixels.
    pub fn new(
        [width, height]: [u32; 2],
        [fx, fy]: [f64; 2],
        [cx, cy]: [f64; 2],
        distortion: Distortion,
    ) -> Result<PinholeCamera, CameraError> {
        let pixels = u64::from(width) * u64::from(height);
        if width == 0 || height == 0 || width > MAX_SIDE || height > MAX_SIDE || pixels > MAX_PIXELS {
            return Err(CameraError::Size { width, height });
        }
        for value in [fx, fy, cx, cy] {
            if !value.is_finite() {
                return Err(CameraError::NotFinite { what: "camera matrix", value });
            }
        }
        if fx <= 0.0 || fy <= 0.0 {
            return Err(CameraError::Uncalibrated { fx, fy });
        }
        let valid_radius = distortion.valid_radius();
        Ok(PinholeCamera { width, height, fx, fy, cx, cy, distortion, valid_radius })
    }

    /// A camera from a calibration message: size in pixels, the 3×3 camera matrix by rows, the name of the distortion
    /// model and its parameters. Skew is ignored, because neither ROS nor Foxglove calibrations support it.
    pub fn from_calibration(
        size: [u32; 2],
        k: &[f64],
        model: &str,
        d: &[f64],
    ) -> Result<PinholeCamera, CameraError> {
        let &[fx, _, cx, _, fy, cy, _, _, _] = k else {
            return Err(CameraError::MatrixSize { what: "camera matrix", got: k.len(), expected: 9 });
        };
        PinholeCamera::new(size, [fx, fy], [cx, cy], Distortion::from_model(model, d)?)
    }

    /// A camera without distortion whose principal point is the image centre. `horizontal_fov_rad` is measured from the
    /// left edge of the image to its right edge.
    pub fn from_horizontal_fov(
        size: [u32; 2],
        horizontal_fov_rad: f64,
    ) -> Result<PinholeCamera, CameraError> {
        let [width, height] = size.map(f64::from);
        let f = 0.5 * width / libm::tan(0.5 * horizontal_fov_rad);
        PinholeCamera::new(size, [f, f], [0.5 * (width - 1.0), 0.5 * (height - 1.0)], Distortion::None)
    }

    /// The same camera for images of another size in pixels; the field of view stays the same.
    pub fn resized(&self, [width, height]: [u32; 2]) -> Result<PinholeCamera, CameraError> {
        let sx = f64::from(width) / f64::from(self.width);
        let sy = f64::from(height) / f64::from(self.height);
        // The outer edges of the image stay in place, not the centres of the outermost pixels.
        let centre = [(self.cx + 0.5) * sx - 0.5, (self.cy + 0.5) * sy - 0.5];
        PinholeCamera::new([width, height], [self.fx * sx, self.fy * sy], centre, self.distortion)
    }

    /// Projects a point in the optical frame (metres) to a pixel. `None` for a point behind the camera or outside of
    /// the range in which the lens model is valid. The pixel may lie outside of the image: see
    /// [`PinholeCamera::contains`].
    #[inline]
    pub fn project(&self, p_optical: DVec3) -> Option<DVec2> {
        if !p_optical.is_finite() || p_optical.z <= 1e-9 {
            return None;
        }
        let normalised = p_optical.truncate() / p_optical.z;
        (normalised.length() <= self.valid_radius).then(|| self.pixel_of(self.distortion.distort(normalised)))
    }

    /// The ray through a pixel in the optical frame, scaled to z = 1: multiply it by a depth to get a point. `None`
    /// where the lens model has no ray.
    pub fn unproject(&self, pixel: DVec2) -> Option<DVec3> {
        let distorted = DVec2::new((pixel.x - self.cx) / self.fx, (pixel.y - self.cy) / self.fy);
        Some(self.distortion.undistort(distorted, self.valid_radius)?.extend(1.0))
    }

    /// The pixel at which a camera with the same matrix and no distortion sees what this camera sees at `pixel`.
    pub fn undistort(&self, pixel: DVec2) -> Option<DVec2> {
        Some(self.pixel_of(self.unproject(pixel)?.truncate()))
    }

    /// The inverse of [`PinholeCamera::undistort`].
    pub fn distort(&self, straight_pixel: DVec2) -> Option<DVec2> {
        let x = (straight_pixel.x - self.cx) / self.fx;
        let y = (straight_pixel.y - self.cy) / self.fy;
        self.project(DVec3::new(x, y, 1.0))
    }

    /// Whether a pixel position lies within the image.
    pub fn contains(&self, pixel: DVec2) -> bool {
        let on = |v: f64, side: u32| v >= -0.5 && v < f64::from(side) - 0.5;
        on(pixel.x, self.width) && on(pixel.y, self.height)
    }

    fn pixel_of(&self, normalised: DVec2) -> DVec2 {
        DVec2::new(self.fx * normalised.x + self.cx, self.fy * normalised.y + self.cy)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn wide() -> PinholeCamera {
        let d = [-0.31, 0.12, 0.0006, -0.0003, -0.02];
        PinholeCamera::from_calibration(
            [640, 480],
            &[420.0, 0.0, 318.5, 0.0, 421.0, 243.0, 0.0, 0.0, 1.0],
            "plumb_bob",
            &d,
        )
        .unwrap()
    }

    proptest! {
        #[test]
        fn every_pixel_of_the_image_comes_back_through_its_ray(u in 0.0..639.0_f64, v in 0.0..479.0_f64, depth in 0.1..100.0_f64) {
            let camera = wide();
            let pixel = DVec2::new(u, v);
            let ray = camera.unproject(pixel).unwrap();
            prop_assert!(camera.project(ray * depth).unwrap().abs_diff_eq(pixel, 1e-6));
            let straight = camera.undistort(pixel).unwrap();
            prop_assert!(camera.distort(straight).unwrap().abs_diff_eq(pixel, 1e-6));
        }

        #[test]
        fn resizing_scales_pixels(x in -0.5..0.5_f64, y in -0.5..0.5_f64) {
            let (full, half) = (wide(), wide().resized([320, 240]).unwrap());
            let p = DVec3::new(x, y, 1.0);
            let (a, b) = (full.project(p).unwrap(), half.project(p).unwrap());
            prop_assert!(((a + 0.5) * 0.5 - 0.5).abs_diff_eq(b, 1e-9));
        }
    }

    #[test]
    fn points_behind_or_far_outside_are_not_folded_into_the_image() {
        let camera = wide();
        assert_eq!(camera.project(DVec3::new(0.0, 0.0, -1.0)), None);
        assert_eq!(camera.project(DVec3::new(0.0, 0.0, 0.0)), None);
        assert_eq!(camera.project(DVec3::new(f64::NAN, 0.0, 1.0)), None);
        // The radial polynomial decreases here: without the limit this point, 75° off the axis, might project into the
        // image.
        assert!(camera.project(DVec3::new(3.7, 0.0, 1.0)).is_none_or(|pixel| !camera.contains(pixel)));
    }

    #[test]
    fn field_of_view_reaches_from_edge_to_edge() {
        let camera = PinholeCamera::from_horizontal_fov([640, 480], std::f64::consts::FRAC_PI_2).unwrap();
        assert!(
            camera.project(DVec3::new(1.0, 0.0, 1.0)).unwrap().abs_diff_eq(DVec2::new(639.5, 239.5), 1e-9)
        );
    }

    #[test]
    fn calibrations_that_cannot_be_are_refused() {
        let camera = |k: &[f64]| PinholeCamera::from_calibration([640, 480], k, "", &[]);
        assert!(matches!(camera(&[0.0; 9]), Err(CameraError::Uncalibrated { .. })));
        assert!(matches!(camera(&[1.0; 4]), Err(CameraError::MatrixSize { got: 4, .. })));
        assert!(matches!(camera(&[f64::NAN; 9]), Err(CameraError::NotFinite { .. })));
        assert!(matches!(
            PinholeCamera::from_horizontal_fov([0, 480], 1.0),
            Err(CameraError::Size { width: 0, .. })
        ));
    }
}
