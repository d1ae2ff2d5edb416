//! Decodes image and depth messages, for views and plugins.

use crate::any::AnyMessage;
use crate::foxglove::{CompressedImage, RawImage};
use crate::guard::guarded;
use ::image::{ColorType, DynamicImage, ImageReader, Limits};
use bytes::Bytes;
use std::io::Cursor;

/// Images with more pixels than this are refused: no camera makes them, but a damaged header may claim them.
const MAX_PIXELS: u64 = 1 << 27;
/// Greatest width and height of a compressed image.
const MAX_SIDE: u32 = 32_768;

/// An image: rows from the top, three bytes per pixel, no padding.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RgbImage {
    /// Pixels per row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `width * height * 3` bytes.
    pub data: Vec<u8>,
}

/// Why an image cannot be read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ImageError {
    /// The pixel format is not supported.
    #[error("got encoding {got:?}, expected one of {expected}")]
    Encoding {
        /// The encoding of the message.
        got: String,
        /// The supported encodings.
        expected: &'static str,
    },
    /// Width, height, step and length of the data contradict each other, or are out of bounds.
    #[error("{what}: got {got}, expected {expected}")]
    Size {
        /// Which quantity.
        what: &'static str,
        /// Its value.
        got: u64,
        /// The least accepted value (the greatest if `what` says so).
        expected: u64,
    },
    /// The compressed data do not decode.
    #[error("compressed image does not decode: {0}")]
    Compressed(String),
}

const ENCODINGS: &str = "rgb8, bgr8, rgba8, bgra8, mono8, 8UC1, 8UC3, mono16, 16UC1, 32FC1, bayer_rggb8, \
    bayer_bggr8, bayer_gbrg8, bayer_grbg8, uyvy, yuv422, yuyv, yuv422_yuy2";

/// The image of a raw or compressed image message; `None` for a message of another type.
pub fn to_rgb8(message: &AnyMessage) -> Option<Result<RgbImage, ImageError>> {
    if let Some(raw) = message.get::<RawImage>() {
        return Some(raw_to_rgb8(raw));
    }
    message.get::<CompressedImage>().map(compressed_to_rgb8)
}

/// Converts a raw image to RGB. Depth (16UC1, 32FC1) is stretched from black (nearest) to white (farthest); pixels
/// without a range are black.
pub fn raw_to_rgb8(image: &RawImage) -> Result<RgbImage, ImageError> {
    let format = Format::of(&image.encoding)
        .ok_or_else(|| ImageError::Encoding { got: image.encoding.clone(), expected: ENCODINGS })?;
    let rows = Rows::new(image, format.bytes())?;
    let mut data = Vec::with_capacity(rows.width * rows.height * 3);
    match format {
        Format::Rgb => rows.each().for_each(|row| data.extend_from_slice(row)),
        Format::Bgr => rows.pixels::<3>(|[b, g, r]| data.extend([r, g, b])),
        Format::Rgba => rows.pixels::<4>(|[r, g, b, _]| data.extend([r, g, b])),
        Format::Bgra => rows.pixels::<4>(|[b, g, r, _]| data.extend([r, g, b])),
        Format::Mono8 => rows.pixels::<1>(|[v]| data.extend([v; 3])),
        Format::Mono16 => rows.pixels::<2>(|[_, high]| data.extend([high; 3])),
        Format::Depth16 => stretch(rows.depth16(1.0), &mut data),
        Format::Depth32 => stretch(rows.depth32(), &mut data),
        Format::Uyvy => rows.pixels::<4>(|[u, y0, v, y1]| yuv_pair([y0, y1], u, v, &mut data)),
        Format::Yuyv => rows.pixels::<4>(|[y0, u, y1, v]| yuv_pair([y0, y1], u, v, &mut data)),
        Format::Bayer(red) => bayer(&rows, red, &mut data),
    }
    Ok(RgbImage { width: image.width, height: image.height, data })
}

/// Decodes a JPEG or PNG.
pub fn compressed_to_rgb8(image: &CompressedImage) -> Result<RgbImage, ImageError> {
    let decoded = decode(&image.data)?;
    if decoded.color() == ColorType::L16 {
        return raw_to_rgb8(&raw(image, decoded)?);
    }
    let (width, height) = (decoded.width(), decoded.height());
    Ok(RgbImage { width, height, data: decoded.into_rgb8().into_raw() })
}

/// A JPEG or PNG as a raw image: `mono8`, `16UC1` (16-bit grey, which is depth) or `rgb8`.
pub fn decompress(image: &CompressedImage) -> Result<RawImage, ImageError> {
    raw(image, decode(&image.data)?)
}

/// Range of each pixel in metres, rows from the top. Integers (16UC1, mono16) are multiples of `scale_m`, which is
/// 0.001 for ROS's millimetres; floats (32FC1) are metres.
/// Pixels without a range (0, NaN, infinite, negative) are NaN.
pub fn depth_m(image: &RawImage, scale_m: f32) -> Result<Vec<f32>, ImageError> {
    match Format::of(&image.encoding) {
        Some(Format::Mono16 | Format::Depth16) => Ok(Rows::new(image, 2)?.depth16(scale_m)),
        Some(Format::Depth32) => Ok(Rows::new(image, 4)?.depth32()),
        _ => Err(ImageError::Encoding { got: image.encoding.clone(), expected: "16UC1, mono16, 32FC1" }),
    }
}

fn decode(data: &Bytes) -> Result<DynamicImage, ImageError> {
    let failed = |error: String| ImageError::Compressed(error);
    let mut limits = Limits::default();
    limits.max_image_width = Some(MAX_SIDE);
    limits.max_image_height = Some(MAX_SIDE);
    limits.max_alloc = Some(MAX_PIXELS * 8);
    // The format is detected from the data, because format names in messages vary.
    let mut reader = ImageReader::new(Cursor::new(data))
        .with_guessed_format()
        .map_err(|error| failed(error.to_string()))?;
    reader.limits(limits);
    guarded(|| reader.decode().map_err(|error| error.to_string())).and_then(|image| image).map_err(failed)
}

fn raw(source: &CompressedImage, image: DynamicImage) -> Result<RawImage, ImageError> {
    let (width, height) = (image.width(), image.height());
    let (encoding, channels, data): (_, u32, Vec<u8>) = match image {
        DynamicImage::ImageLuma8(grey) => ("mono8", 1, grey.into_raw()),
        DynamicImage::ImageLuma16(grey) => ("16UC1", 2, grey.iter().flat_map(|v| v.to_le_bytes()).collect()),
        other => ("rgb8", 3, other.into_rgb8().into_raw()),
    };
    let step = width.checked_mul(channels).ok_or(ImageError::Size {
        what: "width, at most",
        got: width.into(),
        expected: MAX_SIDE.into(),
    })?;
    Ok(RawImage {
        timestamp: source.timestamp,
        frame_id: source.frame_id.clone(),
        width,
        height,
        encoding: encoding.to_owned(),
        step,
        data: data.into(),
    })
}

/// Memory layout of pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    Rgb,
    Bgr,
    Rgba,
    Bgra,
    Mono8,
    Mono16,
    Depth16,
    Depth32,
    Uyvy,
    Yuyv,
    /// Column and row of the red pixel in each 2×2 block; the blue pixel is diagonally opposite.
    Bayer([usize; 2]),
}

impl Format {
    fn of(encoding: &str) -> Option<Self> {
        Some(match encoding {
            "rgb8" => Self::Rgb,
            // OpenCV's channel order, which ROS assumes for types without a name.
            "bgr8" | "8UC3" => Self::Bgr,
            "rgba8" => Self::Rgba,
            "bgra8" => Self::Bgra,
            "mono8" | "8UC1" => Self::Mono8,
            "mono16" => Self::Mono16,
            "16UC1" => Self::Depth16,
            "32FC1" => Self::Depth32,
            "uyvy" | "yuv422" => Self::Uyvy,
            "yuyv" | "yuv422_yuy2" => Self::Yuyv,
            "bayer_rggb8" => Self::Bayer([0, 0]),
            "bayer_grbg8" => Self::Bayer([1, 0]),
            "bayer_gbrg8" => Self::Bayer([0, 1]),
            "bayer_bggr8" => Self::Bayer([1, 1]),
            _ => return None,
        })
    }

    /// Bytes per pixel.
    fn bytes(self) -> usize {
        match self {
            Self::Rgb | Self::Bgr => 3,
            Self::Rgba | Self::Bgra | Self::Depth32 => 4,
            Self::Mono16 | Self::Depth16 | Self::Uyvy | Self::Yuyv => 2,
            Self::Mono8 | Self::Bayer(_) => 1,
        }
    }
}

/// The rows of a raw image whose sizes have been checked.
struct Rows<'a> {
    data: &'a [u8],
    width: usize,
    height: usize,
    step: usize,
    /// Bytes of a row, without padding.
    row: usize,
}

impl<'a> Rows<'a> {
    fn new(image: &'a RawImage, bytes: usize) -> Result<Self, ImageError> {
        let (width, height, step) = (u64::from(image.width), u64::from(image.height), u64::from(image.step));
        let size = |what, got, expected| Err(ImageError::Size { what, got, expected });
        if width * height == 0 {
            return size("pixels", 0, 1);
        }
        if width * height > MAX_PIXELS {
            return size("pixels, at most", width * height, MAX_PIXELS);
        }
        let row = width * bytes as u64;
        if step < row {
            return size("bytes per row", step, row);
        }
        let whole = step * (height - 1) + row;
        let got = image.data.len() as u64;
        if got < whole {
            return size("bytes of the image", got, whole);
        }
        Ok(Self {
            data: &image.data,
            width: width as usize,
            height: height as usize,
            step: step as usize,
            row: row as usize,
        })
    }

    fn row(&self, v: usize) -> &'a [u8] {
        &self.data[v * self.step..][..self.row]
    }

    fn each(&self) -> impl Iterator<Item = &'a [u8]> + '_ {
        (0..self.height).map(|v| self.row(v))
    }

    /// Calls the function with each group of `N` bytes, row by row.
    fn pixels<const N: usize>(&self, mut each: impl FnMut([u8; N])) {
        for row in self.each() {
            for pixel in row.as_chunks::<N>().0 {
                each(*pixel);
            }
        }
    }

    fn depth16(&self, scale: f32) -> Vec<f32> {
        let mut depth = Vec::with_capacity(self.width * self.height);
        self.pixels(|bytes| {
            let value = u16::from_le_bytes(bytes);
            depth.push(if value == 0 { f32::NAN } else { f32::from(value) * scale });
        });
        depth
    }

    fn depth32(&self) -> Vec<f32> {
        let mut depth = Vec::with_capacity(self.width * self.height);
        self.pixels(|bytes| {
            let value = f32::from_le_bytes(bytes);
            depth.push(if value > 0.0 && value.is_finite() { value } else { f32::NAN });
        });
        depth
    }
}

fn stretch(depth: Vec<f32>, out: &mut Vec<u8>) {
    let (near, far) = depth.iter().fold((f32::MAX, f32::MIN), |(near, far), d| (near.min(*d), far.max(*d)));
    let span = (far - near).max(f32::MIN_POSITIVE);
    // The cast takes NaN to 0. The nearest range gets a greater value, so that the two differ.
    out.extend(depth.into_iter().flat_map(|d| [(1.0 + 254.0 * ((d - near) / span)) as u8; 3]));
}

/// Two pixels with common chrominance: BT.601, video range (16 to 235).
fn yuv_pair(luma: [u8; 2], u: u8, v: u8, out: &mut Vec<u8>) {
    let (u, v) = (i32::from(u) - 128, i32::from(v) - 128);
    for y in luma {
        let y = 298 * (i32::from(y) - 16).max(0);
        let channel = |value: i32| ((value + 128) >> 8).clamp(0, 255) as u8;
        out.extend([channel(y + 409 * v), channel(y - 100 * u - 208 * v), channel(y + 516 * u)]);
    }
}

/// Bilinear demosaicing: each channel is the mean of the pixels of its colour in the 3×3 neighbourhood.
fn bayer(rows: &Rows<'_>, red: [usize; 2], out: &mut Vec<u8>) {
    let channel = |u: usize, v: usize| match ((u ^ red[0]) & 1, (v ^ red[1]) & 1) {
        (0, 0) => 0,
        (1, 1) => 2,
        _ => 1,
    };
    for v in 0..rows.height {
        for u in 0..rows.width {
            let own = channel(u, v);
            let (mut sum, mut count) = ([0u16; 3], [0u16; 3]);
            for y in v.saturating_sub(1)..(v + 2).min(rows.height) {
                let row = rows.row(y);
                let left = u.saturating_sub(1);
                for (x, value) in (left..).zip(&row[left..(u + 2).min(rows.width)]) {
                    let c = channel(x, y);
                    // The channel that the pixel itself measures is taken as it is.
                    if c != own || (x, y) == (u, v) {
                        sum[c] += u16::from(*value);
                        count[c] += 1;
                    }
                }
            }
            out.extend([0, 1, 2].map(|c| (sum[c] / count[c].max(1)) as u8));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn raw_image(encoding: &str, width: u32, height: u32, step: u32, data: &[u8]) -> RawImage {
        let data = Bytes::copy_from_slice(data);
        RawImage { width, height, encoding: encoding.into(), step, data, ..RawImage::default() }
    }

    fn check(encoding: &str, width: u32, step: u32, data: &[u8], expect: &[u8]) {
        let image = raw_image(encoding, width, 1, step, data);
        assert_eq!(raw_to_rgb8(&image).expect(encoding).data, expect, "{encoding}");
    }

    #[test]
    fn each_encoding_gives_red_green_blue() {
        check("rgb8", 1, 4, &[1, 2, 3, 99], &[1, 2, 3]);
        check("bgr8", 1, 3, &[3, 2, 1], &[1, 2, 3]);
        check("rgba8", 1, 4, &[1, 2, 3, 4], &[1, 2, 3]);
        check("bgra8", 1, 4, &[3, 2, 1, 4], &[1, 2, 3]);
        check("mono8", 2, 2, &[7, 9], &[7, 7, 7, 9, 9, 9]);
        check("mono16", 1, 2, &[0x34, 0x12], &[0x12; 3]);
        check("16UC1", 3, 6, &[0, 0, 100, 0, 200, 0], &[0, 0, 0, 1, 1, 1, 255, 255, 255]);
        check("uyvy", 2, 4, &[128, 16, 128, 235], &[0, 0, 0, 255, 255, 255]);
        check("yuyv", 2, 4, &[81, 90, 81, 240], &[255, 0, 0, 255, 0, 0]);
    }

    #[test]
    fn rows_may_be_padded_and_the_last_may_end_early() {
        let image = raw_image("mono8", 2, 2, 3, &[1, 2, 0, 3, 4]);
        assert_eq!(raw_to_rgb8(&image).expect("it fits").data, [1, 1, 1, 2, 2, 2, 3, 3, 3, 4, 4, 4]);
    }

    #[test]
    fn a_flat_bayer_image_is_flat_in_each_channel() {
        for (encoding, red) in
            [("bayer_rggb8", 0), ("bayer_grbg8", 1), ("bayer_gbrg8", 2), ("bayer_bggr8", 3)]
        {
            let colour = |u: usize, v: usize| match (u % 2 == red % 2, v % 2 == red / 2) {
                (true, true) => 200,
                (false, false) => 50,
                _ => 100,
            };
            let data: Vec<u8> = (0..24).map(|i| colour(i % 6, i / 6)).collect();
            let rgb = raw_to_rgb8(&raw_image(encoding, 6, 4, 6, &data)).expect(encoding);
            assert!(rgb.data.chunks(3).all(|pixel| pixel == [200, 100, 50]), "{encoding}: {:?}", rgb.data);
        }
    }

    #[test]
    fn sizes_that_do_not_agree_are_refused() {
        let cases = [
            (raw_image("rgb8", 2, 2, 5, &[0; 20]), "bytes per row: got 5, expected 6"),
            (raw_image("rgb8", 2, 2, 6, &[0; 11]), "bytes of the image: got 11, expected 12"),
            (raw_image("rgb8", 0, 2, 0, &[]), "pixels: got 0, expected 1"),
            (raw_image("rgb8", u32::MAX, u32::MAX, u32::MAX, &[]), "pixels, at most: got"),
            (raw_image("h264", 1, 1, 1, &[0]), "got encoding \"h264\", expected one of rgb8"),
        ];
        for (image, expect) in cases {
            let error = raw_to_rgb8(&image).expect_err(expect).to_string();
            assert!(error.starts_with(expect), "{error}");
        }
    }

    #[test]
    fn pixels_without_a_range_are_nan() {
        let image = raw_image("16UC1", 2, 1, 4, &[0, 0, 0, 2]);
        let depth = depth_m(&image, 1.0 / 256.0).expect("it is depth");
        assert!(depth[0].is_nan() && depth[1] == 2.0);
        let numbers = [1.5, f32::NAN, f32::INFINITY, -1.0];
        let bytes: Vec<u8> = numbers.iter().flat_map(|v| v.to_le_bytes()).collect();
        let depth = depth_m(&raw_image("32FC1", 4, 1, 16, &bytes), 0.001).expect("it is depth");
        assert!(depth[0] == 1.5 && depth[1..].iter().all(|d| d.is_nan()));
    }

    #[test]
    fn a_png_of_16_bits_is_depth_and_of_8_a_image() {
        let grey = ::image::ImageBuffer::<::image::Luma<u16>, _>::from_raw(2, 1, vec![256u16, 512])
            .expect("it fits");
        let mut png = Cursor::new(Vec::new());
        grey.write_to(&mut png, ::image::ImageFormat::Png).expect("it encodes");
        let image = CompressedImage { data: png.into_inner().into(), ..CompressedImage::default() };
        let raw = decompress(&image).expect("it decodes");
        assert_eq!(depth_m(&raw, 1.0 / 256.0).expect("it is depth"), [1.0, 2.0]);
        assert_eq!(compressed_to_rgb8(&image).expect("it decodes").data, [1, 1, 1, 255, 255, 255]);
        let broken = CompressedImage { data: image.data.slice(..20), ..CompressedImage::default() };
        compressed_to_rgb8(&broken).expect_err("it is cut off");
    }
}
