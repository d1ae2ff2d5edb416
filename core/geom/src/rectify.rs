//! Rectification: resamples an image as an undistorted camera with rectified orientation would have taken it.

use glam::{DMat3, DVec2, DVec3};

use crate::{CameraError, Distortion, PinholeCamera};

/// For each pixel of the rectified image, its position in the raw image. It is computed once per calibration; applying
/// it is one pass over the image.
///
/// ```
/// use rcs_geom::{PinholeCamera, Rectification};
/// let k = [420.0, 0.0, 319.5, 0.0, 420.0, 239.5, 0.0, 0.0, 1.0];
/// let raw = PinholeCamera::from_calibration([640, 480], &k, "plumb_bob", &[-0.3, 0.1, 0.0, 0.0, 0.0])?;
/// let r = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
/// let p = [420.0, 0.0, 319.5, -50.4, 0.0, 420.0, 239.5, 0.0, 0.0, 0.0, 1.0, 0.0];
/// let rectification = Rectification::new(&raw, &r, &p)?;
/// assert!((rectification.baseline_m() - 0.12).abs() < 1e-12);
/// let rectified = rectification.remap(&vec![0; 640 * 480], 1)?;
/// # Ok::<(), rcs_geom::CameraError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Rectification {
    camera: PinholeCamera,
    baseline_m: f64,
    raw_size: [u32; 2],
    /// By rows: u, v in the raw image, pixels; a position far outside of the image where the raw camera sees nothing.
    source: Vec<[f32; 2]>,
    /// The same, prepared for the interpolation.
    taps: Vec<Tap>,
}

/// The four pixels between which a position lies.
#[derive(Clone, Copy, Debug)]
struct Tap {
    /// Number of the upper left one, by rows; [`AT_BORDER`] if not all four lie in the image.
    first: u32,
    /// Position to the right of and below the upper left one, 0 to 1.
    part: [f32; 2],
}

const AT_BORDER: u32 = u32::MAX;

/// A position outside of every image.
const NOWHERE: [f32; 2] = [-1e6, -1e6];

impl Rectification {
    /// From the raw camera (matrix K and distortion D), R (3×3 by rows, rotates raw optical axes into rectified ones)
    /// and P (3×4 by rows, the rectified camera), as in a calibration message. The rectified image has the size of the
    /// raw one.
    pub fn new(raw: &PinholeCamera, r: &[f64], p: &[f64]) -> Result<Rectification, CameraError> {
        let Ok(r) = <[f64; 9]>::try_from(r) else {
            return Err(CameraError::MatrixSize { what: "rectification matrix", got: r.len(), expected: 9 });
        };
        let &[fx, _, cx, tx, _, fy, cy, _, _, _, _, _] = p else {
            return Err(CameraError::MatrixSize { what: "projection matrix", got: p.len(), expected: 12 });
        };
        if let Some(&value) = r.iter().chain(p).find(|v| !v.is_finite()) {
            return Err(CameraError::NotFinite { what: "rectification or projection matrix", value });
        }
        let size = [raw.width, raw.height];
        let camera = PinholeCamera::new(size, [fx, fy], [cx, cy], Distortion::None)?;
        // The rows of R are the columns of its inverse, and glam stores matrices by columns.
        let raw_from_rectified = DMat3::from_cols_array(&r);
        let source_of = |u: u32, v: u32| {
            let ray = DVec3::new((f64::from(u) - cx) / fx, (f64::from(v) - cy) / fy, 1.0);
            raw.project(raw_from_rectified * ray).map_or(NOWHERE, |p| p.as_vec2().to_array())
        };
        let source =
            (0..raw.height).flat_map(|v| (0..raw.width).map(move |u| (u, v))).map(|(u, v)| source_of(u, v));
        let source: Vec<[f32; 2]> = source.collect();
        let taps = source.iter().map(|&position| Tap::at(position, size)).collect();
        Ok(Rectification { source, taps, camera, baseline_m: -tx / fx, raw_size: size })
    }

    /// The rectified camera: P's matrix, no distortion.
    pub fn camera(&self) -> &PinholeCamera {
        &self.camera
    }

    /// Distance from the first camera's centre to this camera's, metres, positive to the right: 0 for the left camera
    /// of a pair.
    pub fn baseline_m(&self) -> f64 {
        self.baseline_m
    }

    /// The position in the raw image of a pixel of the rectified one; `None` outside of either image.
    pub fn source_of(&self, u: u32, v: u32) -> Option<DVec2> {
        if u >= self.camera.width || v >= self.camera.height {
            return None;
        }
        let [x, y] = *self.source.get(v as usize * self.camera.width as usize + u as usize)?;
        let p = DVec2::new(f64::from(x), f64::from(y));
        let inside = p.x > -1.0
            && p.y > -1.0
            && p.x < f64::from(self.raw_size[0])
            && p.y < f64::from(self.raw_size[1]);
        inside.then_some(p)
    }

    /// Rectifies an image of 8-bit samples, interleaved by pixel (1 channel grey, 3 channels RGB), rows without
    /// padding. Bilinear interpolation, rounded; black outside of the raw image.
    pub fn remap(&self, raw: &[u8], channels: usize) -> Result<Vec<u8>, CameraError> {
        let mut rectified = Vec::new();
        self.remap_into(raw, channels, &mut rectified)?;
        Ok(rectified)
    }

    /// [`Rectification::remap`] into an existing buffer.
    pub fn remap_into(
        &self,
        raw: &[u8],
        channels: usize,
        rectified: &mut Vec<u8>,
    ) -> Result<(), CameraError> {
        let [width, height] = self.raw_size;
        let expected = (width as usize * height as usize).saturating_mul(channels);
        if raw.len() != expected || channels == 0 {
            return Err(CameraError::ImageSize { got: raw.len(), expected, width, height, channels });
        }
        rectified.clear();
        rectified.resize(self.source.len() * channels, 0);
        // A constant number of channels lets the compiler unroll the inner loop.
        match channels {
            1 => self.fill(raw, 1, rectified),
            3 => self.fill(raw, 3, rectified),
            4 => self.fill(raw, 4, rectified),
            _ => self.fill(raw, channels, rectified),
        }
        Ok(())
    }

    #[inline(always)]
    #[allow(clippy::inline_always, reason = "specialised by the constant number of channels")]
    fn fill(&self, raw: &[u8], channels: usize, rectified: &mut [u8]) {
        let [width, height] = self.raw_size.map(|side| side as i32);
        let stride = width as usize * channels;
        let pixels = rectified.chunks_exact_mut(channels).zip(&self.taps).zip(&self.source);
        for ((pixel, &Tap { first, part: [fu, fv] }), position) in pixels {
            if first != AT_BORDER {
                let at = first as usize * channels;
                let (top, bottom) =
                    (&raw[at..at + 2 * channels], &raw[at + stride..at + stride + 2 * channels]);
                for (c, value) in pixel.iter_mut().enumerate() {
                    *value = blend(top[c], top[c + channels], bottom[c], bottom[c + channels], fu, fv);
                }
                continue;
            }
            let [u0, v0] = position.map(floor);
            if u0 >= -1 && v0 >= -1 && u0 < width && v0 < height {
                let tap = |x: i32, y: i32, c: usize| {
                    if x < 0 || y < 0 || x >= width || y >= height {
                        return 0;
                    }
                    raw[y as usize * stride + x as usize * channels + c]
                };
                for (c, value) in pixel.iter_mut().enumerate() {
                    let (a, b) = (tap(u0, v0, c), tap(u0 + 1, v0, c));
                    *value = blend(a, b, tap(u0, v0 + 1, c), tap(u0 + 1, v0 + 1, c), fu, fv);
                }
            }
        }
    }
}

impl Tap {
    fn at([u, v]: [f32; 2], [width, height]: [u32; 2]) -> Tap {
        let (u0, v0) = (floor(u), floor(v));
        let is_inside = u0 >= 0 && v0 >= 0 && u0 + 1 < width as i32 && v0 + 1 < height as i32;
        let first = if is_inside { v0 as u32 * width + u0 as u32 } else { AT_BORDER };
        Tap { first, part: [u - u0 as f32, v - v0 as f32] }
    }
}

/// Like `f32::floor`, without a call of the library on processors that lack the instruction.
#[inline]
fn floor(value: f32) -> i32 {
    let towards_zero = value as i32;
    towards_zero - i32::from(towards_zero as f32 > value)
}

#[inline]
fn blend(a: u8, b: u8, c: u8, d: u8, fu: f32, fv: f32) -> u8 {
    let [a, b, c, d] = [a, b, c, d].map(f32::from);
    let (top, bottom) = (a + (b - a) * fu, c + (d - c) * fu);
    (top + (bottom - top) * fv + 0.5) as u8
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::Pose;

    const K: [f64; 9] = [60.0, 0.0, 31.0, 0.0, 61.0, 23.0, 0.0, 0.0, 1.0];
    const P: [f64; 12] = [60.0, 0.0, 31.0, 0.0, 0.0, 61.0, 23.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    const STRAIGHT: [f64; 9] = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];

    fn camera(d: &[f64]) -> PinholeCamera {
        PinholeCamera::from_calibration([64, 48], &K, "plumb_bob", d).unwrap()
    }

    /// Bilinear interpolation in f64, directly from the definition, black outside.
    fn reference_remap(map: &Rectification, raw: &[u8], channels: usize) -> Vec<f64> {
        let tap = |x: f64, y: f64, c: usize| {
            let inside = x >= 0.0 && y >= 0.0 && x < 64.0 && y < 48.0;
            if inside { f64::from(raw[(y as usize * 64 + x as usize) * channels + c]) } else { 0.0 }
        };
        let mut out = Vec::new();
        for v in 0..48 {
            for u in 0..64 {
                let p = map.source_of(u, v);
                for c in 0..channels {
                    out.push(p.map_or(0.0, |p| {
                        let (p0, f) = (p.floor(), p - p.floor());
                        tap(p0.x, p0.y, c) * (1.0 - f.x) * (1.0 - f.y)
                            + tap(p0.x + 1.0, p0.y, c) * f.x * (1.0 - f.y)
                            + tap(p0.x, p0.y + 1.0, c) * (1.0 - f.x) * f.y
                            + tap(p0.x + 1.0, p0.y + 1.0, c) * f.x * f.y
                    }));
                }
            }
        }
        out
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]
        #[test]
        fn remap_equals_the_reference(k1 in -0.4..0.2_f64, yaw in -0.2..0.2_f64, channels in 1..=4_usize, seed: u64) {
            let mut state = seed | 1;
            let raw: Vec<u8> = (0..64 * 48 * channels).map(|_| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (state >> 56) as u8
            }).collect();
            let r = Pose::from_yaw(yaw).rotation_matrix().transpose().to_cols_array();
            let map = Rectification::new(&camera(&[k1, 0.05, 0.001, 0.002, 0.0]), &r, &P).unwrap();
            let (ours, reference) = (map.remap(&raw, channels).unwrap(), reference_remap(&map, &raw, channels));
            prop_assert_eq!(ours.len(), reference.len());
            for (a, b) in ours.iter().zip(&reference) {
                prop_assert!((f64::from(*a) - b).abs() <= 0.501, "{a} {b}");
            }
        }

        #[test]
        fn a_point_lands_where_the_map_says(x in -0.3..0.3_f64, y in -0.3..0.3_f64, tilt in -0.1..0.1_f64) {
            let raw = camera(&[-0.2, 0.05, 0.0, 0.0, 0.0]);
            let rectified_from_raw = Pose::from_rpy(DVec3::ZERO, tilt, 0.05, 0.0).rotation_matrix();
            let map = Rectification::new(&raw, &rectified_from_raw.transpose().to_cols_array(), &P).unwrap();
            let p_raw = DVec3::new(x, y, 1.0);
            let pixel = map.camera().project(rectified_from_raw * p_raw).unwrap().round();
            prop_assume!(map.camera().contains(pixel));
            // The ray of the rounded pixel, through both cameras.
            let ray = rectified_from_raw.transpose() * map.camera().unproject(pixel).unwrap();
            let expected = raw.project(ray).unwrap();
            prop_assume!(raw.contains(expected));
            prop_assert!(map.source_of(pixel.x as u32, pixel.y as u32).unwrap().abs_diff_eq(expected, 1e-4));
        }
    }

    #[test]
    fn a_straight_camera_changes_nothing() {
        let raw: Vec<u8> = (0..64 * 48 * 3).map(|i| (i * 7 % 251) as u8).collect();
        let map = Rectification::new(&camera(&[]), &STRAIGHT, &P).unwrap();
        assert_eq!(map.remap(&raw, 3).unwrap(), raw);
    }

    #[test]
    fn wrong_sizes_are_refused() {
        let map = Rectification::new(&camera(&[]), &STRAIGHT, &P).unwrap();
        assert!(matches!(map.remap(&[0; 5], 1), Err(CameraError::ImageSize { got: 5, expected: 3072, .. })));
        assert!(map.remap(&[], 0).is_err());
        assert!(Rectification::new(&camera(&[]), &STRAIGHT[..3], &P).is_err());
        assert!(Rectification::new(&camera(&[]), &STRAIGHT, &P[..9]).is_err());
        assert!(Rectification::new(&camera(&[]), &STRAIGHT, &[0.0; 12]).is_err());
        assert!(Rectification::new(&camera(&[]), &[f64::NAN; 9], &P).is_err());
    }
}
