//! Calibration of a stereo pair: rectification, and conversion of disparity to range.

use crate::{NO_DISPARITY, STEPS_PER_PIXEL};
use rcs_geom::{CameraError, PinholeCamera, Rectification};

/// Calibration of one camera of a pair, as in a calibration message.
#[derive(Clone, Copy, Debug)]
pub struct CameraInfo<'a> {
    /// The raw camera.
    pub raw: &'a PinholeCamera,
    /// Rectification matrix R, 3×3 by rows.
    pub r: &'a [f64],
    /// Projection matrix P, 3×4 by rows; the right one holds the baseline.
    pub p: &'a [f64],
}

/// Why two calibrations do not form a pair.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CalibrationError {
    /// One of them is invalid.
    #[error("calibration of the {camera} camera: {error}")]
    Camera {
        /// Left or right.
        camera: &'static str,
        /// What is wrong.
        error: CameraError,
    },
    /// R is not a rotation.
    #[error(
        "rectification matrix of the {camera} camera is not a rotation: off by {off}, expected at most {max}"
    )]
    Rotation {
        /// Left or right.
        camera: &'static str,
        /// Largest difference of R·Rᵀ to the identity; infinite for a reflection.
        off: f64,
        /// Largest that is taken for rounding.
        max: f64,
    },
    /// The rectified images are not coplanar with aligned rows.
    #[error("{what} of the rectified cameras differ: {left} and {right}")]
    Differ {
        /// Which number.
        what: &'static str,
        /// Left camera's, pixels.
        left: f64,
        /// Right camera's, pixels.
        right: f64,
    },
    /// The right camera does not stand to the right of the left one.
    #[error("baseline is {got} m, expected more than 0: are left and right exchanged")]
    Baseline {
        /// Metres.
        got: f64,
    },
}

/// Largest difference of R·Rᵀ from the identity that is accepted as rounding.
const ROTATION_TOLERANCE: f64 = 1e-3;

/// A calibrated pair.
#[derive(Clone, Debug)]
pub struct StereoCamera {
    left: Rectification,
    right: Rectification,
    baseline_m: f64,
    /// How far the right camera's principal point lies to the right of the left one's, pixels.
    offset_px: f64,
}

impl StereoCamera {
    /// Builds the pair from both calibrations; P contains the baseline.
    pub fn new(left: CameraInfo<'_>, right: CameraInfo<'_>) -> Result<StereoCamera, CalibrationError> {
        let (left, right) = (rectification("left", left)?, rectification("right", right)?);
        let (a, b) = (left.camera(), right.camera());
        let same = [
            ("width", f64::from(a.width), f64::from(b.width)),
            ("height", f64::from(a.height), f64::from(b.height)),
            ("focal length", a.fx, b.fx),
            ("vertical focal length", a.fy, b.fy),
            ("vertical principal point", a.cy, b.cy),
        ];
        for (what, left, right) in same {
            if (left - right).abs() > 1e-6 * left.abs().max(1.0) {
                return Err(CalibrationError::Differ { what, left, right });
            }
        }
        let baseline_m = right.baseline_m() - left.baseline_m();
        if baseline_m <= 0.0 {
            return Err(CalibrationError::Baseline { got: baseline_m });
        }
        let offset_px = b.cx - a.cx;
        Ok(StereoCamera { left, right, baseline_m, offset_px })
    }

    /// Rectification of the left camera.
    pub fn left(&self) -> &Rectification {
        &self.left
    }

    /// Rectification of the right camera.
    pub fn right(&self) -> &Rectification {
        &self.right
    }

    /// Distance between the cameras, m.
    pub fn baseline_m(&self) -> f64 {
        self.baseline_m
    }

    /// Range along the left camera's optical axis, m, of a disparity in 1/16 pixel. `None` without a disparity, or for
    /// a point at infinity or beyond.
    pub fn depth_m(&self, disparity: u16) -> Option<f64> {
        let shift = f64::from(disparity) / f64::from(STEPS_PER_PIXEL) + self.offset_px;
        (disparity != NO_DISPARITY && shift > 0.0).then(|| self.left.camera().fx * self.baseline_m / shift)
    }
}

fn rectification(
    camera: &'static str,
    CameraInfo { raw, r, p }: CameraInfo<'_>,
) -> Result<Rectification, CalibrationError> {
    let rectification =
        Rectification::new(raw, r, p).map_err(|error| CalibrationError::Camera { camera, error })?;
    let rows = [0, 3, 6].map(|k| glam::DVec3::from_slice(&r[k..k + 3]));
    let mut off = 0.0_f64;
    for (i, a) in rows.iter().enumerate() {
        for (k, b) in rows.iter().enumerate() {
            off = off.max((a.dot(*b) - f64::from(u8::from(i == k))).abs());
        }
    }
    if rows[0].cross(rows[1]).dot(rows[2]) <= 0.0 {
        off = f64::INFINITY;
    }
    if off > ROTATION_TOLERANCE {
        return Err(CalibrationError::Rotation { camera, off, max: ROTATION_TOLERANCE });
    }
    Ok(rectification)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcs_geom::Distortion;

    const R: [f64; 9] = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];

    fn raw(width: u32) -> PinholeCamera {
        PinholeCamera::new([width, 48], [100.0, 100.0], [31.5, 23.5], Distortion::None).unwrap()
    }

    fn p(cx: f64, baseline_m: f64) -> [f64; 12] {
        [100.0, 0.0, cx, -100.0 * baseline_m, 0.0, 100.0, 23.5, 0.0, 0.0, 0.0, 1.0, 0.0]
    }

    fn pair(left: (&[f64], [f64; 12]), right: (&[f64], [f64; 12])) -> Result<StereoCamera, CalibrationError> {
        let raw = raw(64);
        StereoCamera::new(
            CameraInfo { raw: &raw, r: left.0, p: &left.1 },
            CameraInfo { raw: &raw, r: right.0, p: &right.1 },
        )
    }

    #[test]
    fn range_follows_from_disparity_baseline_and_the_offset_of_the_principal_points() {
        let camera = pair((&R, p(31.5, 0.0)), (&R, p(33.5, 0.2))).unwrap();
        // 8 px and an offset of 2 px: 100 px · 0.2 m / 10 px.
        assert!((camera.depth_m(8 * STEPS_PER_PIXEL).unwrap() - 2.0).abs() < 1e-12);
        assert_eq!(camera.depth_m(NO_DISPARITY), None);
        let straight = pair((&R, p(31.5, 0.0)), (&R, p(31.5, 0.2))).unwrap();
        assert_eq!(straight.depth_m(0), None);
    }

    #[test]
    fn calibrations_of_no_pair_are_refused_with_what_is_wrong() {
        let check = |left, right, expected: &str| {
            let error = pair(left, right).unwrap_err().to_string();
            assert!(error.contains(expected), "got \"{error}\", expected \"{expected}\"");
        };
        let (l, r) = (p(31.5, 0.0), p(31.5, 0.2));
        let sheared = [1.0, 0.1, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        let mirrored = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, -1.0];
        check((&R, l), (&sheared, r), "right camera is not a rotation");
        check((&mirrored, l), (&R, r), "left camera is not a rotation: off by inf");
        check((&R, r), (&R, l), "baseline is -0.2 m");
        check((&R, l), (&R[..4], r), "right camera: rectification matrix has 4 entries");
        let mut other = r;
        other[0] = 90.0;
        check((&R, l), (&R, other), "focal length of the rectified cameras differ: 100 and 90");
        let (narrow, wide) = (raw(64), raw(65));
        let error = StereoCamera::new(
            CameraInfo { raw: &narrow, r: &R, p: &l },
            CameraInfo { raw: &wide, r: &R, p: &r },
        );
        assert!(matches!(error, Err(CalibrationError::Differ { what: "width", .. })));
    }
}
