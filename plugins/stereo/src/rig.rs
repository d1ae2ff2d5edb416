//! Processing of a calibrated pair: rectification and disparities of two images.

use crate::image::ColourImage;
use crate::pairing::Side;
use crate::{CalibrationError, CameraInfo, Matcher, NO_DISPARITY, Settings, StereoCamera, StereoError};
use rcs_geom::{CameraError, PinholeCamera, Rectification};
use rcs_msg::foxglove::CameraCalibration;
use rcs_runtime::Pool;
use serde::{Deserialize, Serialize};

/// The calibration of one camera, with the checks that concern one camera alone.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct ImageCalibration {
    pub(crate) frame_id: String,
    raw: PinholeCamera,
    r: Vec<f64>,
    p: Vec<f64>,
}

impl ImageCalibration {
    pub(crate) fn new(message: &CameraCalibration) -> Result<ImageCalibration, CameraError> {
        let size = [message.width, message.height];
        Ok(ImageCalibration {
            frame_id: message.frame_id.clone(),
            raw: PinholeCamera::from_calibration(size, &message.k, &message.distortion_model, &message.d)?,
            r: message.r.clone(),
            p: message.p.clone(),
        })
    }

    fn camera(&self) -> CameraInfo<'_> {
        CameraInfo { raw: &self.raw, r: &self.r, p: &self.p }
    }
}

/// A calibrated pair.
#[derive(Clone, Debug)]
pub(crate) struct Rig {
    pub(crate) camera: StereoCamera,
    /// Which pixels of each rectified image are covered by its raw image.
    shown: [Shown; 2],
}

/// Why a pair has no ranges.
#[derive(Debug, thiserror::Error)]
pub(crate) enum Unusable {
    #[error("no usable calibration of the {camera} camera")]
    NoCalibration { camera: &'static str },
    #[error("{0}")]
    Calibration(#[from] CalibrationError),
    #[error("{camera} image has {got:?} pixels, its calibration is for {expected:?}")]
    Size { camera: &'static str, got: [usize; 2], expected: [usize; 2] },
    #[error("{0}")]
    Camera(#[from] CameraError),
    #[error("{0}")]
    Stereo(#[from] StereoError),
}

/// A rectified pair.
#[derive(Clone, Debug)]
pub(crate) struct Rectified {
    /// The left image: red, green, blue.
    pub(crate) left_rgb: Vec<u8>,
    grey: [Vec<u8>; 2],
}

impl Rig {
    pub(crate) fn new(left: &ImageCalibration, right: &ImageCalibration) -> Result<Rig, CalibrationError> {
        let camera = StereoCamera::new(left.camera(), right.camera())?;
        let shown = [camera.left(), camera.right()].map(Shown::new);
        Ok(Rig { camera, shown })
    }

    /// Width and height of all images, pixels.
    pub(crate) fn size(&self) -> [usize; 2] {
        let camera = self.camera.left().camera();
        [camera.width as usize, camera.height as usize]
    }

    /// Rectifies the images of both cameras, each on its own thread.
    pub(crate) fn rectify(&self, pair: [&ColourImage; 2], pool: &Pool) -> Result<Rectified, Unusable> {
        for (side, image) in Side::BOTH.into_iter().zip(pair) {
            let (got, expected) = ([image.width, image.height], self.size());
            if got != expected {
                return Err(Unusable::Size { camera: side.name(), got, expected });
            }
        }
        let both = [self.camera.left(), self.camera.right()];
        // The left camera's colours are a third job.
        let work = |i: usize| match i {
            0 | 1 => both[i].remap(&pair[i].grey(), 1),
            _ => both[0].remap(&pair[0].rgb, 3),
        };
        let mut done = pool.map(3, work).into_iter();
        let mut next = || done.next().unwrap_or(Ok(Vec::new()));
        let grey = [next()?, next()?];
        Ok(Rectified { left_rgb: next()?, grey })
    }

    /// Disparities of the rectified left image, 1/16 pixel, without false matches at the edges of either raw image.
    pub(crate) fn disparities(
        &self,
        rectified: &Rectified,
        settings: Settings,
        bench: &mut Bench,
        pool: &Pool,
    ) -> Result<Vec<u16>, Unusable> {
        let mut disparity = Vec::new();
        let [left, right] = &rectified.grey;
        bench.with_matcher(self.size(), settings, |matcher| {
            matcher.compute_in_strips(left, right, &mut disparity, pool.threads(), |strips| {
                let mut strips: Vec<_> = strips.into_iter().map(Some).collect();
                pool.for_each_chunk_mut(&mut strips, 1, |_, strip| {
                    strip.iter_mut().filter_map(Option::take).for_each(crate::Strip::run);
                });
            })
        })?;
        self.take_out_edges(&mut disparity, settings.block / 2 + FILTER_RADIUS);
        Ok(disparity)
    }

    /// Removes matches across the edge of a raw image: the black area beside it is not texture.
    fn take_out_edges(&self, disparity: &mut [u16], radius: usize) {
        let [left, right] = &self.shown;
        if left.everywhere && right.everywhere {
            return;
        }
        let [width, height] = self.size();
        for (v, row) in disparity.chunks_exact_mut(width).enumerate().take(height) {
            for (u, d) in row.iter_mut().enumerate() {
                let back = u.saturating_sub(usize::from(*d / crate::STEPS_PER_PIXEL));
                if *d != NO_DISPARITY && !(left.around(u, v, radius) && right.around(back, v, radius)) {
                    *d = NO_DISPARITY;
                }
            }
        }
    }
}

/// Radius of the prefilter, pixels.
const FILTER_RADIUS: usize = 3;

/// Which pixels of a rectified image are covered by its raw image.
#[derive(Clone, Debug)]
struct Shown {
    width: usize,
    height: usize,
    everywhere: bool,
    /// Integral image of the pixels that are not covered, with one more row and column than the image.
    missing: Vec<u32>,
}

impl Shown {
    fn new(rectification: &Rectification) -> Shown {
        let camera = rectification.camera();
        let (width, height) = (camera.width as usize, camera.height as usize);
        let (last_u, last_v) = ((width - 1) as f64, (height - 1) as f64);
        let is_missing = |u: usize, v: usize| {
            let source = rectification.source_of(u as u32, v as u32);
            // Rounding may put the source of an outermost pixel slightly outside of the raw image.
            let within = |x: f64, last: f64| x >= -1e-3 && x <= last + 1e-3;
            !source.is_some_and(|p| within(p.x, last_u) && within(p.y, last_v))
        };
        let stride = width + 1;
        let mut missing = vec![0_u32; stride * (height + 1)];
        for v in 0..height {
            let mut row = 0;
            for u in 0..width {
                row += u32::from(is_missing(u, v));
                missing[(v + 1) * stride + u + 1] = missing[v * stride + u + 1] + row;
            }
        }
        let everywhere = missing.last() == Some(&0);
        Shown { width, height, everywhere, missing }
    }

    /// Whether all pixels within a radius are covered; pixels beyond the image are ignored.
    fn around(&self, u: usize, v: usize, radius: usize) -> bool {
        if self.everywhere {
            return true;
        }
        let (u0, v0) = (u.saturating_sub(radius), v.saturating_sub(radius));
        let (u1, v1) = ((u + radius + 1).min(self.width), (v + radius + 1).min(self.height));
        let at = |u: usize, v: usize| self.missing[v * (self.width + 1) + u];
        at(u1, v1) + at(u0, v0) == at(u0, v1) + at(u1, v0)
    }
}

/// Working memory of the matcher. It is not state: a result depends on its pair alone, so a clone starts empty.
#[derive(Debug, Default)]
pub(crate) struct Bench(Option<Box<Fitted>>);

impl Clone for Bench {
    fn clone(&self) -> Self {
        Bench(None)
    }
}

#[derive(Debug)]
struct Fitted {
    size: [usize; 2],
    settings: Settings,
    matcher: Matcher,
}

impl Bench {
    fn with_matcher<R>(
        &mut self,
        size: [usize; 2],
        settings: Settings,
        work: impl FnOnce(&mut Matcher) -> Result<R, StereoError>,
    ) -> Result<R, StereoError> {
        let kept = self.0.take().filter(|fitted| (fitted.size, fitted.settings) == (size, settings));
        let fitted = match kept {
            Some(fitted) => fitted,
            None => Box::new(Fitted { size, settings, matcher: Matcher::new(size, settings)? }),
        };
        work(&mut self.0.insert(fitted).matcher)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const K: [f64; 9] = [60.0, 0.0, 31.5, 0.0, 60.0, 23.5, 0.0, 0.0, 1.0];
    const R: [f64; 9] = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];

    fn shown(d: &[f64], f: f64) -> (Shown, Rectification) {
        let raw = PinholeCamera::from_calibration([64, 48], &K, "plumb_bob", d).unwrap();
        let p = [f, 0.0, 31.5, 0.0, 0.0, f, 23.5, 0.0, 0.0, 0.0, 1.0, 0.0];
        let rectification = Rectification::new(&raw, &R, &p).unwrap();
        (Shown::new(&rectification), rectification)
    }

    #[test]
    fn a_straight_camera_is_shown_everywhere() {
        let (shown, _) = shown(&[0.0; 5], 60.0);
        assert!(shown.everywhere && shown.around(0, 0, 9) && shown.around(63, 47, 9));
    }

    #[test]
    fn around_equals_looking_at_every_pixel() {
        // Zoomed out, so that the raw image's edge lies within the rectified image.
        let (shown, rectification) = shown(&[-0.2, 0.05, 0.0, 0.0, 0.0], 45.0);
        assert!(!shown.everywhere);
        let seen = |u: i64, v: i64| {
            let inside = (0..64).contains(&u) && (0..48).contains(&v);
            !inside
                || rectification
                    .source_of(u as u32, v as u32)
                    .is_some_and(|p| p.x >= -1e-3 && p.y >= -1e-3 && p.x <= 63.0 + 1e-3 && p.y <= 47.0 + 1e-3)
        };
        let mut counts = [0; 2];
        for v in 0..48_i64 {
            for u in 0..64_i64 {
                let expected = (-2..=2).all(|dv| (-2..=2).all(|du| seen(u + du, v + dv)));
                assert_eq!(shown.around(u as usize, v as usize, 2), expected, "{u} {v}");
                counts[usize::from(expected)] += 1;
            }
        }
        assert!(counts[0] > 300 && counts[1] > 300, "{counts:?}");
    }
}
