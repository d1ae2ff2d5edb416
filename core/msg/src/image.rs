//! Decodes image and depth messages, for views and plugins.

mod compressed;
mod rvl;

use crate::any::AnyMessage;
use crate::foxglove::{CompressedImage, RawImage};
pub use compressed::{compressed_to_rgb8, decompress};

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
    /// The data are part of a stream of video.
    #[error("got format {0:?}, which is video; only single images are decoded")]
    Video(String),
}

const ENCODINGS: &str = "rgb8, bgr8, rgba8, bgra8, rgb16, bgr16, rgba16, bgra16, mono8, 8UC1, 8UC3, 8UC4, mono16, \
    16UC1, 32FC1, 64FC1, 32SC1, bayer_rggb8, bayer_bggr8, bayer_gbrg8, bayer_grbg8, bayer_rggb16, bayer_bggr16, \
    bayer_gbrg16, bayer_grbg16, uyvy, yuv422, yuyv, yuv422_yuy2, nv12, nv21";

/// The image of a raw or compressed image message; `None` for a message of another type.
pub fn to_rgb8(message: &AnyMessage) -> Option<Result<RgbImage, ImageError>> {
    if let Some(raw) = message.get::<RawImage>() {
        return Some(raw_to_rgb8(raw));
    }
    message.get::<CompressedImage>().map(compressed_to_rgb8)
}

/// Converts a raw image to RGB. Of channels with 16 bits the high byte is taken. Depth (16UC1, 32FC1, 64FC1) is
/// stretched from black (nearest) to white (farthest), and pixels without a range are black. Whole numbers of 32 bits
/// (32SC1) are stretched, too.
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
        Format::Rgb16 => rows.pixels::<6>(|[_, r, _, g, _, b]| data.extend([r, g, b])),
        Format::Bgr16 => rows.pixels::<6>(|[_, b, _, g, _, r]| data.extend([r, g, b])),
        Format::Rgba16 => rows.pixels::<8>(|[_, r, _, g, _, b, ..]| data.extend([r, g, b])),
        Format::Bgra16 => rows.pixels::<8>(|[_, b, _, g, _, r, ..]| data.extend([r, g, b])),
        Format::Mono8 => rows.pixels::<1>(|[v]| data.extend([v; 3])),
        Format::Mono16 => rows.pixels::<2>(|[_, high]| data.extend([high; 3])),
        Format::Depth16 => stretch(rows.depth16(1.0), &mut data),
        Format::Depth32 => stretch(rows.depth32(), &mut data),
        Format::Depth64 => stretch(rows.depth64(), &mut data),
        Format::Int32 => stretch(rows.values(|bytes| i32::from_le_bytes(bytes) as f32), &mut data),
        Format::Uyvy => yuv422(&rows, [1, 3], [0, 2], &mut data),
        Format::Yuyv => yuv422(&rows, [0, 2], [1, 3], &mut data),
        Format::Nv12 => nv(&rows, [0, 1], &mut data)?,
        Format::Nv21 => nv(&rows, [1, 0], &mut data)?,
        Format::Bayer(red) => bayer(&rows, red, &mut data),
        Format::Bayer16(red) => {
            let (width, height) = (rows.width, rows.height);
            let high = rows.values(|[_, high]| high);
            bayer(&Rows { data: &high, width, height, step: width, row: width }, red, &mut data);
        }
    }
    Ok(RgbImage { width: image.width, height: image.height, data })
}

/// Range of each pixel in metres, rows from the top. Integers (16UC1, mono16) are multiples of `scale_m`, which is
/// 0.001 for ROS's millimetres; floats (32FC1, 64FC1) are metres.
/// Pixels without a range (0, NaN, infinite, negative) are NaN.
pub fn depth_m(image: &RawImage, scale_m: f32) -> Result<Vec<f32>, ImageError> {
    match Format::of(&image.encoding) {
        Some(Format::Mono16 | Format::Depth16) => Ok(Rows::new(image, 2)?.depth16(scale_m)),
        Some(Format::Depth32) => Ok(Rows::new(image, 4)?.depth32()),
        Some(Format::Depth64) => Ok(Rows::new(image, 8)?.depth64()),
        _ => {
            Err(ImageError::Encoding { got: image.encoding.clone(), expected: "16UC1, mono16, 32FC1, 64FC1" })
        }
    }
}

/// Memory layout of pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    Rgb,
    Bgr,
    Rgba,
    Bgra,
    Rgb16,
    Bgr16,
    Rgba16,
    Bgra16,
    Mono8,
    Mono16,
    Depth16,
    Depth32,
    Depth64,
    Int32,
    Uyvy,
    Yuyv,
    Nv12,
    Nv21,
    /// Column and row of the red pixel in each 2×2 block; the blue pixel is diagonally opposite.
    Bayer([usize; 2]),
    /// The same with two bytes per pixel.
    Bayer16([usize; 2]),
}

impl Format {
    fn of(encoding: &str) -> Option<Self> {
        Some(match encoding {
            "rgb8" => Self::Rgb,
            // OpenCV's channel order, which ROS assumes for types without a name.
            "bgr8" | "8UC3" => Self::Bgr,
            "rgba8" => Self::Rgba,
            "bgra8" | "8UC4" => Self::Bgra,
            "rgb16" => Self::Rgb16,
            "bgr16" | "16UC3" => Self::Bgr16,
            "rgba16" => Self::Rgba16,
            "bgra16" | "16UC4" => Self::Bgra16,
            "mono8" | "8UC1" => Self::Mono8,
            "mono16" => Self::Mono16,
            "16UC1" => Self::Depth16,
            "32FC1" => Self::Depth32,
            "64FC1" => Self::Depth64,
            "32SC1" => Self::Int32,
            "uyvy" | "yuv422" => Self::Uyvy,
            "yuyv" | "yuv422_yuy2" => Self::Yuyv,
            "nv12" => Self::Nv12,
            "nv21" => Self::Nv21,
            "bayer_rggb8" => Self::Bayer([0, 0]),
            "bayer_grbg8" => Self::Bayer([1, 0]),
            "bayer_gbrg8" => Self::Bayer([0, 1]),
            "bayer_bggr8" => Self::Bayer([1, 1]),
            "bayer_rggb16" => Self::Bayer16([0, 0]),
            "bayer_grbg16" => Self::Bayer16([1, 0]),
            "bayer_gbrg16" => Self::Bayer16([0, 1]),
            "bayer_bggr16" => Self::Bayer16([1, 1]),
            _ => return None,
        })
    }

    /// Bytes per pixel of a row; the colours of NV12 and NV21 are in rows of their own.
    fn bytes(self) -> usize {
        match self {
            Self::Rgba16 | Self::Bgra16 | Self::Depth64 => 8,
            Self::Rgb16 | Self::Bgr16 => 6,
            Self::Rgba | Self::Bgra | Self::Depth32 | Self::Int32 => 4,
            Self::Rgb | Self::Bgr => 3,
            Self::Mono16 | Self::Depth16 | Self::Uyvy | Self::Yuyv | Self::Bayer16(_) => 2,
            Self::Mono8 | Self::Nv12 | Self::Nv21 | Self::Bayer(_) => 1,
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

    /// A number of each group of `N` bytes, row by row.
    fn values<const N: usize, T>(&self, number: impl Fn([u8; N]) -> T) -> Vec<T> {
        let mut values = Vec::with_capacity(self.width * self.height);
        for row in self.each() {
            values.extend(row.as_chunks::<N>().0.iter().map(|bytes| number(*bytes)));
        }
        values
    }

    /// Ranges that are multiples of `scale`.
    fn depth16(&self, scale: f32) -> Vec<f32> {
        self.values(|bytes| range(f32::from(u16::from_le_bytes(bytes)) * scale))
    }

    fn depth32(&self) -> Vec<f32> {
        self.values(|bytes| range(f32::from_le_bytes(bytes)))
    }

    fn depth64(&self) -> Vec<f32> {
        self.values(|bytes| range(f64::from_le_bytes(bytes) as f32))
    }
}

/// The value, or NaN where it is no range.
fn range(value: f32) -> f32 {
    if value > 0.0 && value.is_finite() { value } else { f32::NAN }
}

fn stretch(depth: Vec<f32>, out: &mut Vec<u8>) {
    let (near, far) = depth.iter().fold((f32::MAX, f32::MIN), |(near, far), d| (near.min(*d), far.max(*d)));
    let span = (far - near).max(f32::MIN_POSITIVE);
    // The cast takes NaN to 0. The nearest range gets a greater value, so that the two differ.
    out.extend(depth.into_iter().flat_map(|d| [(1.0 + 254.0 * ((d - near) / span)) as u8; 3]));
}

/// Pixels with common chrominance: BT.601, video range (16 to 235).
fn yuv_pixels(luma: &[u8], u: u8, v: u8, out: &mut Vec<u8>) {
    let (u, v) = (i32::from(u) - 128, i32::from(v) - 128);
    for y in luma {
        let y = 298 * (i32::from(*y) - 16).max(0);
        let channel = |value: i32| ((value + 128) >> 8).clamp(0, 255) as u8;
        out.extend([channel(y + 409 * v), channel(y - 100 * u - 208 * v), channel(y + 516 * u)]);
    }
}

/// Rows of pairs of pixels: the luminance of both, and their common U and V, in the given places of four bytes. In a row
/// of an odd number of pixels the last one has no V; that of the pair before it counts.
fn yuv422(rows: &Rows<'_>, luma: [usize; 2], [u, v]: [usize; 2], out: &mut Vec<u8>) {
    for row in rows.each() {
        let (pairs, last) = row.as_chunks::<4>();
        for pair in pairs {
            yuv_pixels(&luma.map(|place| pair[place]), pair[u], pair[v], out);
        }
        if !last.is_empty() {
            let v = pairs.last().map_or(128, |pair| pair[v]);
            yuv_pixels(&[last[luma[0]]], last[u], v, out);
        }
    }
}

/// Rows of luminance, then half as many of chrominance: a pair of bytes for each 2×2 pixels, in which U and V have the
/// given places.
fn nv(rows: &Rows<'_>, [u, v]: [usize; 2], out: &mut Vec<u8>) -> Result<(), ImageError> {
    let size = |what, got: usize, expected: usize| {
        Err(ImageError::Size { what, got: got as u64, expected: expected as u64 })
    };
    let row = rows.width.next_multiple_of(2);
    if rows.step < row {
        return size("bytes per row", rows.step, row);
    }
    let start = rows.step * rows.height;
    let whole = start + rows.step * (rows.height.div_ceil(2) - 1) + row;
    if rows.data.len() < whole {
        return size("bytes of the image", rows.data.len(), whole);
    }
    for (y, luma) in rows.each().enumerate() {
        let pairs = &rows.data[start + y / 2 * rows.step..][..row];
        for (luma, pair) in luma.chunks(2).zip(pairs.as_chunks::<2>().0) {
            yuv_pixels(luma, pair[u], pair[v], out);
        }
    }
    Ok(())
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
    use bytes::Bytes;

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
        check("8UC4", 1, 4, &[3, 2, 1, 4], &[1, 2, 3]);
        check("rgb16", 1, 6, &[9, 1, 9, 2, 9, 3], &[1, 2, 3]);
        check("bgr16", 1, 6, &[9, 3, 9, 2, 9, 1], &[1, 2, 3]);
        check("rgba16", 1, 8, &[9, 1, 9, 2, 9, 3, 9, 4], &[1, 2, 3]);
        check("bgra16", 1, 8, &[9, 3, 9, 2, 9, 1, 9, 4], &[1, 2, 3]);
        check("mono8", 2, 2, &[7, 9], &[7, 7, 7, 9, 9, 9]);
        check("mono16", 1, 2, &[0x34, 0x12], &[0x12; 3]);
        check("16UC1", 3, 6, &[0, 0, 100, 0, 200, 0], &[0, 0, 0, 1, 1, 1, 255, 255, 255]);
        check("32SC1", 2, 8, &[0xff, 0xff, 0xff, 0xff, 1, 0, 0, 0], &[1, 1, 1, 255, 255, 255]);
        check("uyvy", 2, 4, &[128, 16, 128, 235], &[0, 0, 0, 255, 255, 255]);
        check("yuyv", 2, 4, &[81, 90, 81, 240], &[255, 0, 0, 255, 0, 0]);
    }

    #[test]
    fn the_last_pixel_of_an_odd_yuv_row_takes_the_colour_that_it_lacks_from_the_pair_before() {
        let row = [81, 90, 81, 240, 81, 90];
        let image = raw_image("yuyv", 3, 2, 6, &[row, row].concat());
        assert_eq!(raw_to_rgb8(&image).expect("yuyv").data, [255u8, 0, 0].repeat(6));
        check("uyvy", 3, 6, &[90, 81, 240, 81, 90, 81], &[255u8, 0, 0].repeat(3));
        // There is no pair before it.
        check("yuyv", 1, 2, &[235, 128], &[255; 3]);
        check("uyvy", 1, 2, &[128, 16], &[0; 3]);
    }

    #[test]
    fn rows_may_be_padded_and_the_last_may_end_early() {
        let image = raw_image("mono8", 2, 2, 3, &[1, 2, 0, 3, 4]);
        assert_eq!(raw_to_rgb8(&image).expect("it fits").data, [1, 1, 1, 2, 2, 2, 3, 3, 3, 4, 4, 4]);
    }

    #[test]
    fn nv12_and_nv21_have_one_pair_of_colours_for_four_pixels() {
        // 3×2 pixels in rows of 4 bytes; the second pair of colours is that of the last column.
        let luma = [81, 81, 16, 0, 81, 81, 235, 0];
        let expect: Vec<u8> =
            [[255, 0, 0, 255, 0, 0, 0, 0, 0], [255, 0, 0, 255, 0, 0, 255, 255, 255]].concat();
        for (encoding, colours) in [("nv12", [90, 240, 128, 128]), ("nv21", [240, 90, 128, 128])] {
            let data = [&luma[..], &colours].concat();
            let image = raw_image(encoding, 3, 2, 4, &data);
            assert_eq!(raw_to_rgb8(&image).expect(encoding).data, expect, "{encoding}");
            let error = raw_to_rgb8(&raw_image(encoding, 3, 2, 4, &data[..11])).expect_err("it is cut off");
            assert_eq!(error.to_string(), "bytes of the image: got 11, expected 12");
            raw_to_rgb8(&raw_image(encoding, 3, 2, 3, &data)).expect_err("a pair does not fit its row");
        }
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
            let wide = encoding.replace('8', "16");
            let data: Vec<u8> = data.into_iter().flat_map(|high| [7, high]).collect();
            assert_eq!(raw_to_rgb8(&raw_image(&wide, 6, 4, 12, &data)).expect(encoding), rgb, "{wide}");
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
        let bytes: Vec<u8> = numbers.iter().flat_map(|v| f64::from(*v).to_le_bytes()).collect();
        let depth = depth_m(&raw_image("64FC1", 4, 1, 32, &bytes), 0.001).expect("it is depth");
        assert!(depth[0] == 1.5 && depth[1..].iter().all(|d| d.is_nan()));
    }
}
