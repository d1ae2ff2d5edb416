//! Compressed images: JPEG, PNG, GIF, BMP, WebP, TIFF and PNM, and depth as ROS's `compressed_depth_image_transport`
//! writes it.

use super::{ImageError, MAX_PIXELS, MAX_SIDE, RgbImage, raw_to_rgb8, rvl};
use crate::foxglove::{CompressedImage, RawImage};
use crate::guard::guarded;
use ::image::{ColorType, DynamicImage, ImageFormat, ImageReader, Limits};
use bytes::Bytes;
use std::io::Cursor;

/// Part of the name of a format whose data are a PNG, or RVL, behind a header.
const DEPTH: &str = "compressedDepth";
/// Size of that header, bytes: the format (`int32`) and the parameters A and B of quantised depth (`float32`).
const DEPTH_HEADER: usize = 12;
/// Parts of the names of video formats.
const VIDEO: [&str; 7] = ["h264", "h265", "hevc", "avc1", "vp8", "vp9", "av1"];

/// Decodes a compressed image; depth is converted as in [`raw_to_rgb8`].
pub fn compressed_to_rgb8(image: &CompressedImage) -> Result<RgbImage, ImageError> {
    if is_quantised(image) {
        return raw_to_rgb8(&quantised(image)?);
    }
    let decoded = decode(image)?;
    if decoded.color() == ColorType::L16 {
        return raw_to_rgb8(&raw(image, decoded)?);
    }
    let (width, height) = (decoded.width(), decoded.height());
    Ok(RgbImage { width, height, data: decoded.into_rgb8().into_raw() })
}

/// A compressed image as a raw image: `mono8`, `mono16` (16-bit grey, where the format begins so), `16UC1` (other 16-bit
/// grey, which is depth), `32FC1` (quantised depth) or `rgb8`.
pub fn decompress(image: &CompressedImage) -> Result<RawImage, ImageError> {
    if is_quantised(image) { quantised(image) } else { raw(image, decode(image)?) }
}

/// Whether the image contains depth in metres that was quantised to 16 bits.
fn is_quantised(image: &CompressedImage) -> bool {
    image.format.starts_with("32FC1") && image.format.contains(DEPTH)
}

/// Quantised depth: a value v stands for A / (v − B) metres, and 0 for no range.
fn quantised(image: &CompressedImage) -> Result<RawImage, ImageError> {
    let Some((header, _)) = image.data.split_first_chunk::<DEPTH_HEADER>() else {
        return Err(ImageError::Size {
            what: "bytes of the compressed depth",
            got: image.data.len() as u64,
            expected: DEPTH_HEADER as u64,
        });
    };
    let [_, _, _, _, a0, a1, a2, a3, b0, b1, b2, b3] = *header;
    let (a, b) = (f32::from_le_bytes([a0, a1, a2, a3]), f32::from_le_bytes([b0, b1, b2, b3]));
    let decoded = decode(image)?;
    let color = decoded.color();
    let DynamicImage::ImageLuma16(values) = decoded else {
        let text = format!("its depth is an image of kind {color:?}, expected grey of 16 bits");
        return Err(ImageError::Compressed(text));
    };
    let metres = |value: u16| if value == 0 { f32::NAN } else { a / (f32::from(value) - b) };
    let data: Vec<u8> = values.iter().flat_map(|value| metres(*value).to_le_bytes()).collect();
    Ok(RawImage {
        timestamp: image.timestamp,
        frame_id: image.frame_id.clone(),
        width: values.width(),
        height: values.height(),
        encoding: "32FC1".to_owned(),
        // The side has been checked.
        step: 4 * values.width(),
        data: data.into(),
    })
}

fn decode(image: &CompressedImage) -> Result<DynamicImage, ImageError> {
    let format = &image.format;
    let lower = format.to_ascii_lowercase();
    if VIDEO.iter().any(|video| lower.contains(video)) {
        return Err(ImageError::Video(format.clone()));
    }
    let failed = |error: String| ImageError::Compressed(error);
    let mut data: Bytes = image.data.clone();
    if format.contains(DEPTH) && data.len() >= DEPTH_HEADER {
        data = data.slice(DEPTH_HEADER..);
        if lower.contains("rvl") {
            return rvl::decode(&data).map(DynamicImage::ImageLuma16).map_err(failed);
        }
    }
    let mut limits = Limits::default();
    limits.max_image_width = Some(MAX_SIDE);
    limits.max_image_height = Some(MAX_SIDE);
    limits.max_alloc = Some(MAX_PIXELS * 8);
    // The format is detected from the data, because format names in messages vary.
    let mut reader = ImageReader::new(Cursor::new(&data))
        .with_guessed_format()
        .map_err(|error| failed(error.to_string()))?;
    if reader.format().is_none() {
        let text = format!(
            "its data are no JPEG, PNG, GIF, BMP, WebP, TIFF or PNM; the message states format {format:?}"
        );
        return Err(failed(text));
    }
    // The decoder would fill what is missing with grey.
    if reader.format() == Some(ImageFormat::Jpeg) && !reaches_end(&data) {
        let text = format!("its JPEG of {} bytes has no end marker: it is cut off", data.len());
        return Err(failed(text));
    }
    reader.limits(limits);
    guarded(|| reader.decode().map_err(|error| error.to_string())).and_then(|image| image).map_err(failed)
}

/// Whether a JPEG has the marker of its end, after which any bytes may follow. The segments before the first scan are skipped:
/// a preview in one of them has an end marker of its own.
fn reaches_end(jpeg: &[u8]) -> bool {
    // After the marker of the start.
    let mut rest = jpeg.get(2..).unwrap_or_default();
    while let [0xFF, marker, after @ ..] = rest {
        rest = match *marker {
            // A fill byte.
            0xFF => &rest[1..],
            // In the data of a scan, 0xFF is the first byte of a marker only where no 0 follows.
            0xDA => return after.windows(2).rev().any(|pair| pair == [0xFF, 0xD9]),
            _ => {
                let Some(([high, low], _)) = after.split_first_chunk::<2>() else { return false };
                after.get(usize::from(u16::from_be_bytes([*high, *low]))..).unwrap_or_default()
            }
        };
    }
    // Where the data end, they were cut off. Other bytes begin no segment: the decoder says what is wrong with them.
    !matches!(rest, [] | [0xFF])
}

fn raw(source: &CompressedImage, image: DynamicImage) -> Result<RawImage, ImageError> {
    let (width, height) = (image.width(), image.height());
    let (encoding, channels, data): (_, u32, Vec<u8>) = match image {
        DynamicImage::ImageLuma8(grey) => ("mono8", 1, grey.into_raw()),
        DynamicImage::ImageLuma16(grey) => {
            let encoding = if source.format.starts_with("mono16") { "mono16" } else { "16UC1" };
            (encoding, 2, grey.iter().flat_map(|v| v.to_le_bytes()).collect())
        }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::depth_m;

    /// A PNG of two pixels of 16 bits.
    fn png(values: [u16; 2]) -> Vec<u8> {
        let grey = ::image::ImageBuffer::<::image::Luma<u16>, _>::from_raw(2, 1, values.to_vec());
        let mut png = Cursor::new(Vec::new());
        grey.expect("it fits").write_to(&mut png, ::image::ImageFormat::Png).expect("it encodes");
        png.into_inner()
    }

    fn image(format: &str, data: Vec<u8>) -> CompressedImage {
        CompressedImage { data: data.into(), format: format.to_owned(), ..CompressedImage::default() }
    }

    #[test]
    fn a_png_of_16_bits_is_depth_and_of_8_a_image() {
        let image = image("", png([256, 512]));
        let raw = decompress(&image).expect("it decodes");
        assert_eq!(depth_m(&raw, 1.0 / 256.0).expect("it is depth"), [1.0, 2.0]);
        assert_eq!(compressed_to_rgb8(&image).expect("it decodes").data, [1, 1, 1, 255, 255, 255]);
        let broken = CompressedImage { data: image.data.slice(..20), ..CompressedImage::default() };
        compressed_to_rgb8(&broken).expect_err("it is cut off");
    }

    #[test]
    fn a_png_of_16_bits_that_is_stated_to_be_grey_is_not_stretched_as_depth_is() {
        let image = image("mono16; png compressed mono16", png([0x0700, 0x1234]));
        let raw = decompress(&image).expect("it decodes");
        assert_eq!((raw.encoding.as_str(), &raw.data[..]), ("mono16", &[0, 7, 0x34, 0x12][..]));
        let rgb = compressed_to_rgb8(&image).expect("it decodes");
        assert_eq!(rgb.data, [7, 7, 7, 0x12, 0x12, 0x12]);
    }

    #[test]
    fn a_jpeg_that_is_cut_off_is_refused_with_its_length_and_one_with_bytes_after_its_end_decodes() {
        let pixel = |x: u32, y: u32| ::image::Rgb([(x * y) as u8, (x ^ y) as u8, (7 * x + 13 * y) as u8]);
        let mut jpeg = Cursor::new(Vec::new());
        ::image::RgbImage::from_fn(128, 128, pixel)
            .write_to(&mut jpeg, ::image::ImageFormat::Jpeg)
            .expect("it encodes");
        // A segment for a preview, with the markers of its start and end.
        let preview = [0xFF, 0xE1, 0, 6, 0xFF, 0xD8, 0xFF, 0xD9];
        let (start, others) = jpeg.get_ref().split_at(2);
        let jpeg = [start, &preview, others].concat();
        let whole = compressed_to_rgb8(&image("jpeg", jpeg.clone())).expect("it decodes");
        for after in [vec![0; 100], vec![0xFF; 3], b"made by a camera".to_vec()] {
            let longer = image("jpeg", [jpeg.clone(), after].concat());
            assert_eq!(compressed_to_rgb8(&longer), Ok(whole.clone()));
        }
        for length in [20, 100, jpeg.len() * 3 / 10, jpeg.len() - 2, jpeg.len() - 1] {
            let cut = image("jpeg", jpeg[..length].to_vec());
            let error = decompress(&cut).expect_err("it is cut off").to_string();
            let expected = format!("its JPEG of {length} bytes has no end marker: it is cut off");
            assert_eq!(error, format!("compressed image does not decode: {expected}"));
        }
    }

    #[test]
    fn quantised_depth_is_in_metres() {
        let mut data = 0_i32.to_le_bytes().to_vec();
        data.extend([1000.0_f32, 200.0].into_iter().flat_map(f32::to_le_bytes));
        data.extend(png([0, 700]));
        let image = image("32FC1; compressedDepth png", data);
        let raw = decompress(&image).expect("it decodes");
        assert_eq!((raw.encoding.as_str(), raw.step), ("32FC1", 8));
        let depth = depth_m(&raw, 1.0).expect("it is depth");
        assert!(depth[0].is_nan() && depth[1] == 2.0, "{depth:?}");
        assert_eq!(compressed_to_rgb8(&image).expect("it decodes").data, [0, 0, 0, 1, 1, 1]);
        let broken = CompressedImage { data: image.data.slice(..11), ..image };
        let error = decompress(&broken).expect_err("its header is cut off").to_string();
        assert_eq!(error, "bytes of the compressed depth: got 11, expected 12");
    }

    #[test]
    fn whole_depth_behind_its_header_is_in_steps() {
        let data = [vec![0; 12], png([256, 512])].concat();
        let raw = decompress(&image("16UC1; compressedDepth", data)).expect("it decodes");
        assert_eq!(depth_m(&raw, 1.0 / 256.0).expect("it is depth"), [1.0, 2.0]);
    }

    #[test]
    fn what_is_no_image_is_refused_with_its_format() {
        for (format, expect) in [
            ("h264", "got format \"h264\", which is video"),
            ("H265", "got format \"H265\", which is video"),
            (
                "avif",
                "compressed image does not decode: its data are no JPEG, PNG, GIF, BMP, WebP, TIFF or PNM",
            ),
            ("16UC1; compressedDepth rvl", "compressed image does not decode: it has 0×0 pixels"),
        ] {
            let error = decompress(&image(format, vec![0; 60])).expect_err(format).to_string();
            assert!(error.starts_with(expect), "{error}");
        }
    }

    #[test]
    fn each_format_without_loss_decodes() {
        use ::image::ImageFormat::{Bmp, Png, Pnm, Tiff, WebP};
        let pixel = ::image::RgbImage::from_pixel(1, 1, ::image::Rgb([1, 2, 3]));
        for format in [Bmp, Png, Pnm, Tiff, WebP] {
            let mut data = Cursor::new(Vec::new());
            pixel.write_to(&mut data, format).expect("it encodes");
            let decoded = compressed_to_rgb8(&image("", data.into_inner())).expect("it decodes");
            assert_eq!(decoded.data, [1, 2, 3], "{format:?}");
        }
    }

    #[test]
    fn depth_in_rvl_is_read_like_that_in_png() {
        let settings = [1000.0_f32, 200.0].into_iter().flat_map(f32::to_le_bytes);
        let header: Vec<u8> = 0_i32.to_le_bytes().into_iter().chain(settings).collect();
        // Two pixels, none of which is empty: the numbers 0 and 2, then the differences 700 and 0, which are 1400 and 0.
        let mut rvl: Vec<u8> = [2_u32, 1].into_iter().flat_map(u32::to_le_bytes).collect();
        rvl.extend(0x028F_D200_u32.to_le_bytes());
        let data = [header, rvl].concat();
        let quantised = decompress(&image("32FC1; compressedDepth rvl", data.clone())).expect("it decodes");
        assert_eq!(depth_m(&quantised, 1.0).expect("it is depth"), [2.0, 2.0]);
        let whole = decompress(&image("16UC1; compressedDepth rvl", data)).expect("it decodes");
        assert_eq!((whole.encoding.as_str(), depth_m(&whole, 0.5)), ("16UC1", Ok(vec![350.0, 350.0])));
    }
}
