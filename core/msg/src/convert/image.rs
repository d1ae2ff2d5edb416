//! Images, images of disparities, and calibrations.

use super::{Conversion, Source, Unusable};
use crate::any::AnyMessage;
use crate::foxglove::{CameraCalibration, CompressedImage, RawImage};
use bytes::Bytes;

pub(super) const IMAGE: Conversion = Conversion {
    from: "sensor_msgs/Image",
    signature: "iIsIIsBI[]B",
    to: "foxglove.RawImage",
    convert: image,
};

pub(super) const DISPARITY_IMAGE: Conversion = Conversion {
    from: "stereo_msgs/DisparityImage",
    signature: "iIsiIsIIsBI[]BffIIIIbfff",
    to: "foxglove.RawImage",
    convert: disparity_image,
};

pub(super) const COMPRESSED_IMAGE: Conversion = Conversion {
    from: "sensor_msgs/CompressedImage",
    signature: "iIss[]B",
    to: "foxglove.CompressedImage",
    convert: compressed_image,
};

pub(super) const CAMERA_INFO: Conversion = Conversion {
    from: "sensor_msgs/CameraInfo",
    signature: "iIsIIs[]d[9]d[9]d[12]dIIIIIIb",
    to: "foxglove.CameraCalibration",
    convert: camera_info,
};

fn image(source: &mut Source<'_>) -> Result<AnyMessage, Unusable> {
    raw_image(source).map(AnyMessage::new)
}

fn raw_image(source: &mut Source<'_>) -> Result<RawImage, Unusable> {
    let header = source.header()?;
    let (height, width) = (source.cursor.u32()?, source.cursor.u32()?);
    let encoding = source.cursor.string()?;
    let big_endian = source.cursor.u8()? != 0;
    let step = source.cursor.u32()?;
    let mut data = source.shared()?;
    // Foxglove requires little-endian pixels.
    if big_endian {
        data = match encoding.as_str() {
            "mono16" => swapped(&data, 2),
            e if e.starts_with("16") || e.ends_with("16") => swapped(&data, 2),
            e if e.starts_with("32") => swapped(&data, 4),
            e if e.starts_with("64") => swapped(&data, 8),
            _ => data,
        };
    }
    Ok(RawImage {
        timestamp: header.timestamp,
        frame_id: header.frame_id,
        width,
        height,
        encoding,
        step,
        data,
    })
}

/// Disparities below the least one that was searched for are invalid: they become NaN. The geometry of the cameras and
/// the window of valid pixels are left out.
fn disparity_image(source: &mut Source<'_>) -> Result<AnyMessage, Unusable> {
    let header = source.header()?;
    let mut image = raw_image(source)?;
    image.timestamp = header.timestamp;
    if !header.frame_id.is_empty() {
        image.frame_id = header.frame_id;
    }
    let (_focal_px, _baseline_m) = (source.cursor.f32()?, source.cursor.f32()?);
    for _ in 0..4 {
        source.cursor.u32()?;
    }
    let _is_rectified = source.cursor.u8()?;
    let least_px = source.cursor.f32()?;
    let (_greatest_px, _step_px) = (source.cursor.f32()?, source.cursor.f32()?);
    // Whoever draws disparities takes those up to 0 as invalid.
    if least_px > 0.0 && image.encoding == "32FC1" {
        let mut data = image.data.to_vec();
        for disparity in data.as_chunks_mut::<4>().0 {
            if f32::from_le_bytes(*disparity) < least_px {
                *disparity = f32::NAN.to_le_bytes();
            }
        }
        image.data = data.into();
    }
    Ok(AnyMessage::new(image))
}

fn swapped(data: &Bytes, size: usize) -> Bytes {
    let mut data = data.to_vec();
    data.chunks_exact_mut(size).for_each(<[u8]>::reverse);
    data.into()
}

/// ROS 2 has long names for formats (`rgb8; jpeg compressed bgr8`), Foxglove one word. A 16-bit depth image (`16UC1;
/// compressedDepth png`) is a PNG behind 12 bytes of settings. Quantised 32-bit depth needs them: it keeps them and its
/// format, by which `image::decompress` reads it. So does grey of 16 bits in a PNG (`mono16; png compressed`), which would
/// else be taken for depth.
fn compressed_image(source: &mut Source<'_>) -> Result<AnyMessage, Unusable> {
    const DEPTH_SETTINGS: usize = 12;
    let header = source.header()?;
    let mut format = source.cursor.string()?;
    let mut data = source.shared()?;
    let is_grey16 = format.starts_with("mono16") && format.contains("png");
    if format.contains("compressedDepth") {
        if format.starts_with("16UC1") && !format.contains("rvl") && data.len() >= DEPTH_SETTINGS {
            data = data.slice(DEPTH_SETTINGS..);
            "png".clone_into(&mut format);
        }
    } else if let Some(word) =
        ["jpeg", "png", "webp", "avif"].into_iter().find(|word| !is_grey16 && format.contains(word))
    {
        word.clone_into(&mut format);
    } else if format.contains("jpg") {
        "jpeg".clone_into(&mut format);
    }
    Ok(AnyMessage::new(CompressedImage {
        timestamp: header.timestamp,
        frame_id: header.frame_id,
        data,
        format,
    }))
}

/// ROS states the calibration of the full image, and which region of it is sent with which binning. Foxglove's calibration has
/// neither, so it becomes that of the image that is sent.
fn camera_info(source: &mut Source<'_>) -> Result<AnyMessage, Unusable> {
    let header = source.header()?;
    let (height, width) = (source.cursor.u32()?, source.cursor.u32()?);
    let distortion_model = source.cursor.string()?;
    let coefficients = source.cursor.length(8)?;
    let mut calibration = CameraCalibration {
        timestamp: header.timestamp,
        frame_id: header.frame_id,
        width,
        height,
        distortion_model,
        d: source.floats(coefficients)?,
        k: source.floats(9)?,
        r: source.floats(9)?,
        p: source.floats(12)?,
    };
    let binning = [source.cursor.u32()?, source.cursor.u32()?];
    let offset_px = [source.cursor.u32()?, source.cursor.u32()?];
    let (height, width) = (source.cursor.u32()?, source.cursor.u32()?);
    cut(&mut calibration, offset_px, [width, height]);
    bin(&mut calibration, binning);
    Ok(AnyMessage::new(calibration))
}

/// Makes a calibration that of a region of its image, given by the region's left upper corner and size in pixels. A side of 0
/// reaches to the edge of the image.
fn cut(calibration: &mut CameraCalibration, offset_px: [u32; 2], size_px: [u32; 2]) {
    let sides = [&mut calibration.width, &mut calibration.height];
    for ((side, offset), size) in sides.into_iter().zip(offset_px).zip(size_px) {
        *side = if size == 0 { side.saturating_sub(offset) } else { size };
    }
    let [x, y] = offset_px.map(f64::from);
    calibration.k[2] -= x;
    calibration.k[5] -= y;
    calibration.p[2] -= x;
    calibration.p[6] -= y;
}

/// Makes a calibration that of an image each pixel of which is made of so many columns and rows of pixels; 0 means 1. The
/// outer edges of the image stay in place, not the centres of the outermost pixels.
fn bin(calibration: &mut CameraCalibration, binning: [u32; 2]) {
    for (axis, count) in binning.into_iter().enumerate().filter(|(_, count)| *count > 1) {
        let side = if axis == 0 { &mut calibration.width } else { &mut calibration.height };
        *side /= count;
        let scale = 1.0 / f64::from(count);
        for row in [&mut calibration.k[3 * axis..][..3], &mut calibration.p[4 * axis..][..4]] {
            for number in row.iter_mut() {
                *number *= scale;
            }
            row[2] += 0.5 * scale - 0.5;
        }
    }
}
