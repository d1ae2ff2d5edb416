//! Conversion of a depth image to columns of points.

use crate::columns::{Strip, Survey};
use crate::scan::{Label, ScanPoint};
use glam::{DMat3, DVec2, Vec3};
use rcs_geom::PinholeCamera;

/// Number of columns that are processed together: a cache line of a 16-bit image holds 32 pixels.
pub const STRIP_COLUMNS: usize = 32;

/// How the pixels of a depth image are stored, little-endian. Depth is along the optical axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DepthFormat {
    /// 16-bit unsigned integers, 0 for no depth.
    U16 {
        /// Metres per unit.
        scale_m: f32,
    },
    /// 32-bit floats in metres; 0, NaN and infinity for no depth.
    F32,
}

impl DepthFormat {
    fn bytes(self) -> usize {
        match self {
            DepthFormat::U16 { .. } => 2,
            DepthFormat::F32 => 4,
        }
    }
}

/// A depth image whose size has been checked: `data` holds `height` rows of `step` bytes.
#[derive(Clone, Copy, Debug)]
pub struct DepthImage<'a> {
    /// Pixels.
    pub width: usize,
    /// Pixels.
    pub height: usize,
    /// Bytes between the starts of consecutive rows.
    pub step: usize,
    /// How pixels are stored.
    pub format: DepthFormat,
    /// The pixels.
    pub data: &'a [u8],
    /// Whether the camera was upside down: the first row has the lowest rays instead of the last one.
    pub is_upside_down: bool,
}

/// Why an image cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum DepthError {
    /// The encoding is not one of a depth image.
    #[error("encoding {got:?} is no depth: expected 16UC1, mono16 or 32FC1")]
    Encoding {
        /// The encoding in the message.
        got: String,
    },
    /// Rows overlap, or bytes are missing.
    #[error("image of {width}x{height} pixels with step {step} has {got} bytes, expected {expected}")]
    Bytes {
        /// Pixels.
        width: usize,
        /// Pixels.
        height: usize,
        /// Bytes between the starts of consecutive rows.
        step: usize,
        /// Number of bytes given.
        got: usize,
        /// Number of bytes expected.
        expected: usize,
    },
    /// The calibration is for an image of another size.
    #[error("image has {got:?} pixels, its calibration is for {expected:?}")]
    Size {
        /// Width and height of the image.
        got: [usize; 2],
        /// Width and height of the calibration.
        expected: [usize; 2],
    },
}

impl<'a> DepthImage<'a> {
    /// Checks size and encoding. The camera counts as upright.
    pub fn new(
        [width, height]: [usize; 2],
        step: usize,
        encoding: &str,
        scale_m: f32,
        data: &'a [u8],
    ) -> Result<Self, DepthError> {
        let format = match encoding {
            "16UC1" | "mono16" => DepthFormat::U16 { scale_m },
            "32FC1" => DepthFormat::F32,
            other => return Err(DepthError::Encoding { got: other.to_owned() }),
        };
        let row = width * format.bytes();
        let expected = step.max(row).saturating_mul(height.saturating_sub(1)).saturating_add(row);
        if width == 0 || height == 0 || step < row || data.len() < expected {
            return Err(DepthError::Bytes { width, height, step, got: data.len(), expected });
        }
        Ok(Self { width, height, step, format, data, is_upside_down: false })
    }

    /// Number of a row, counted from the lowest ray, for its number in the image, or the other way round.
    fn flip(&self, row: usize) -> usize {
        if self.is_upside_down { row } else { self.height - 1 - row }
    }

    /// Reads the depths of consecutive pixels of one row, m.
    fn depths(&self, row: usize, first: usize, depths: &mut [f32]) {
        let start = row * self.step + first * self.format.bytes();
        let bytes = &self.data[start..start + depths.len() * self.format.bytes()];
        match self.format {
            DepthFormat::U16 { scale_m } => {
                for (depth, pixel) in depths.iter_mut().zip(bytes.as_chunks::<2>().0) {
                    *depth = f32::from(u16::from_le_bytes(*pixel)) * scale_m;
                }
            }
            DepthFormat::F32 => {
                for (depth, pixel) in depths.iter_mut().zip(bytes.as_chunks::<4>().0) {
                    *depth = f32::from_le_bytes(*pixel);
                }
            }
        }
    }
}

/// The ray of every pixel of a camera, with z = 1 in the optical frame; computed once per calibration.
#[derive(Clone, Debug, PartialEq)]
pub struct Rays {
    /// Pixels.
    pub width: usize,
    /// Pixels.
    pub height: usize,
    /// x and y in row order; NaN where the lens model has no ray.
    xy: Vec<[f32; 2]>,
}

impl Rays {
    /// Computes the rays of a camera.
    pub fn new(camera: &PinholeCamera) -> Rays {
        let (width, height) = (camera.width as usize, camera.height as usize);
        let ray = |row: usize, column: usize| {
            let ray = camera.unproject(DVec2::new(column as f64, row as f64));
            ray.map_or([f32::NAN; 2], |ray| [ray.x as f32, ray.y as f32])
        };
        let xy = (0..height).flat_map(|row| (0..width).map(move |column| ray(row, column))).collect();
        Rays { width, height, xy }
    }

    /// Number of strips of an image.
    pub fn strips(&self) -> usize {
        self.width.div_ceil(STRIP_COLUMNS)
    }
}

/// Labels one strip of columns. `rgb` is a colour image of the same size, three bytes per pixel, or empty;
/// `local_from_optical` rotates the optical frame into the axes of the local frame. Labels are ordered column by
/// column, each from the lowest ray to the highest.
///
/// # Panics
/// If the sizes of image, colours and rays differ.
pub fn scan_strip(
    image: &DepthImage<'_>,
    rgb: &[u8],
    rays: &Rays,
    strip: usize,
    local_from_optical: DMat3,
    survey: &Survey<'_>,
) -> Strip {
    assert_eq!([image.width, image.height], [rays.width, rays.height], "image and rays must fit");
    let rgb = rgb.as_chunks::<3>().0;
    assert!(rgb.is_empty() || rgb.len() == image.width * image.height, "image and colours must fit");
    let columns = strip * STRIP_COLUMNS..((strip + 1) * STRIP_COLUMNS).min(image.width);
    let height = image.height;
    let turn = local_from_optical.as_mat3();
    let mut points = vec![ScanPoint::NONE; columns.len() * height];
    let mut depths = [0.0_f32; STRIP_COLUMNS];
    let depths = &mut depths[..columns.len()];
    for row in 0..height {
        let from_bottom = image.flip(row);
        image.depths(row, columns.start, depths);
        let rays = &rays.xy[row * rays.width + columns.start..row * rays.width + columns.end];
        for (i, (&depth, &[x, y])) in depths.iter().zip(rays).enumerate() {
            // Both comparisons are false for NaN, which marks a missing depth or ray.
            if depth > 0.0 && depth < f32::INFINITY && x > f32::NEG_INFINITY {
                let p = turn * Vec3::new(x * depth, y * depth, depth);
                points[i * height + from_bottom] = ScanPoint::at(p.x, p.y, p.z);
            }
        }
    }
    let mut result = Strip::with_capacity(points.len());
    let mut colours = vec![[0; 3]; if rgb.is_empty() { 0 } else { height }];
    for (u, column) in columns.zip(points.chunks_exact(height)) {
        for (from_bottom, colour) in colours.iter_mut().enumerate() {
            *colour = rgb[image.flip(from_bottom) * image.width + u];
        }
        result.add_column(column, &colours, survey);
    }
    result
}

/// The label image from all strips of a depth image, one byte per pixel in row order.
pub fn label_image(strips: &[Strip], depth: &DepthImage<'_>) -> Vec<u8> {
    let (width, height) = (depth.width, depth.height);
    let mut image = vec![Label::Invalid as u8; width * height];
    for (index, strip) in strips.iter().enumerate() {
        let first = index * STRIP_COLUMNS;
        let count = strip.labels.len() / height;
        for row in 0..height {
            let from_bottom = depth.flip(row);
            let out = &mut image[row * width + first..row * width + first + count];
            for (i, pixel) in out.iter_mut().enumerate() {
                *pixel = strip.labels[i * height + from_bottom] as u8;
            }
        }
    }
    image
}
