//! Decodes images of any encoding to colours, values (such as depth) or labels.

use crate::clip::is_place;
use egui::{Color32, ColorImage};
use ocu_ui::palette::{self, Classes, MapPalette};
use rcs_msg::AnyMessage;
use rcs_msg::foxglove::{CompressedImage, RawImage};
use rcs_msg::image::{self, ImageError};
use std::ops::Range;

/// Number of pixels from which percentiles are taken.
const SAMPLE: usize = 20_000;
/// Number of grey levels of 16 bits.
const GREYS: u32 = 1 << 16;
/// Fewest grey levels from black to white.
const FEWEST_GREYS: u32 = 256;

/// The meaning of the pixels of an image.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Pixels {
    /// Colours.
    Color(Vec<Color32>),
    /// One number per pixel; NaN where unknown. `whole` marks whole numbers, whose unit is not given in the image.
    Values { values: Vec<f32>, whole: bool },
    /// One byte per pixel: a grey level, a label or a cost.
    Bytes(Vec<u8>),
    /// One grey level of 16 bits per pixel; the first level of `shown` is black, and the last one is white.
    Greys { values: Vec<u16>, shown: Range<u32> },
}

/// A decoded image.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct DecodedImage {
    /// Columns.
    pub(crate) width: usize,
    /// Rows.
    pub(crate) height: usize,
    /// The pixels, row by row.
    pub(crate) pixels: Pixels,
    /// Its encoding, for display.
    pub(crate) encoding: String,
}

/// How a byte or a value is converted to a colour.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Tint {
    /// Grey levels unchanged; values are ranges, from the least (yellow) to the greatest (dark blue).
    Plain,
    /// Values are disparities, from the least (dark blue) to the greatest (yellow), so that what is near has the colour
    /// of near ranges.
    Disparity,
    /// Labels of these classes; unknown is transparent.
    Labels(Classes),
    /// Costs 0 to 250; unknown is transparent.
    Cost(MapPalette),
}

/// Decodes a `foxglove.RawImage` or `foxglove.CompressedImage`; the error says why it cannot be decoded. `greys` are the
/// grey levels of 16 bits that the image before it showed, which are kept where they still fit.
pub(crate) fn decode(message: &AnyMessage, greys: Option<&Range<u32>>) -> Result<DecodedImage, String> {
    if let Some(raw) = message.get::<RawImage>() {
        return image(raw, raw.encoding.clone(), greys).map_err(|error| error.to_string());
    }
    let Some(compressed) = message.get::<CompressedImage>() else {
        return Err(format!("{} is no image", message.schema().name()));
    };
    let raw = image::decompress(compressed).map_err(|error| error.to_string())?;
    image(&raw, compressed.format.clone(), greys).map_err(|error| error.to_string())
}

fn image(
    raw: &RawImage,
    mut encoding: String,
    greys: Option<&Range<u32>>,
) -> Result<DecodedImage, ImageError> {
    let pixels = match raw.encoding.as_str() {
        "mono16" => {
            let (values, shown) = grey16(raw, greys)?;
            encoding = format!("{encoding}, black {}, white {}", shown.start, shown.end - 1);
            Pixels::Greys { values, shown }
        }
        "16UC1" | "32FC1" | "64FC1" => {
            Pixels::Values { values: image::depth_m(raw, 1.0)?, whole: raw.encoding == "16UC1" }
        }
        "mono8" | "8UC1" => Pixels::Bytes(image::raw_to_rgb8(raw)?.data.into_iter().step_by(3).collect()),
        _ => {
            let rgb = image::raw_to_rgb8(raw)?.data;
            Pixels::Color(rgb.as_chunks().0.iter().map(|&[r, g, b]| Color32::from_rgb(r, g, b)).collect())
        }
    };
    Ok(DecodedImage { width: raw.width as usize, height: raw.height as usize, pixels, encoding })
}

/// Grey levels of a `mono16` image, and those that are shown from black to white: from the 1st to the 99th percentile,
/// and not too few, so that the noise of an even image stays faint. The ends are rounded outwards to an eighth of that
/// range, a power of two: the brightness does not change while images use all levels that the camera has.
///
/// The levels that were shown before (`last`) stay while the percentiles lie within half such a step of them, and while
/// they are neither fewer than half of the range nor more than twice as many: so nothing flickers where a percentile
/// wavers about a step. After a jump in time, an image may thus be shown with the levels of where the jump began.
fn grey16(raw: &RawImage, last: Option<&Range<u32>>) -> Result<(Vec<u16>, Range<u32>), ImageError> {
    // A value of 0 is read as NaN, which the cast takes to 0.
    let values: Vec<u16> = image::depth_m(raw, 1.0)?.into_iter().map(|value| value as u16).collect();
    let stride = (values.len() / SAMPLE).max(1);
    let mut sample: Vec<u16> = values.iter().step_by(stride).copied().collect();
    sample.sort_unstable();
    let beyond = sample.len() / 100;
    let at = |index: usize| sample.get(index).map_or(0, |value| u32::from(*value));
    let (low, high) = (at(beyond), at(sample.len().saturating_sub(beyond + 1)));
    let levels = high + 1 - low;
    let range = levels.max(FEWEST_GREYS);
    let low = low.saturating_sub((range - levels) / 2);
    let end = (low + range).min(GREYS);
    let step = (range / 8).next_power_of_two();
    let fits = |last: &&Range<u32>| {
        let is_near = low + step / 2 >= last.start && end <= last.end + step / 2;
        is_near && (range / 2..=2 * range).contains(&(last.end - last.start))
    };
    let rounded = low / step * step..end.next_multiple_of(step);
    Ok((values, last.filter(fits).cloned().unwrap_or(rounded)))
}

impl DecodedImage {
    /// The grey levels of 16 bits that are shown from black to white; `None` of other images.
    pub(crate) fn grey_range(&self) -> Option<Range<u32>> {
        let Pixels::Greys { shown, .. } = &self.pixels else { return None };
        Some(shown.clone())
    }

    /// The 2nd and 98th percentile of the values, used as the colour range. `None` without values.
    pub(crate) fn value_range(&self) -> Option<[f32; 2]> {
        let Pixels::Values { values, .. } = &self.pixels else { return None };
        let stride = (values.len() / SAMPLE).max(1);
        let mut sample: Vec<f32> =
            values.iter().step_by(stride).copied().filter(|v| is_place(&[f64::from(*v)])).collect();
        sample.sort_by(f32::total_cmp);
        let at = |fraction: f32| {
            sample.get(((sample.len().saturating_sub(1)) as f32 * fraction) as usize).copied()
        };
        Some([at(0.02)?, at(0.98)?])
    }

    /// Number of finite values that cannot be: some scanners report the largest number for a missing return.
    pub(crate) fn implausible(&self) -> usize {
        let Pixels::Values { values, .. } = &self.pixels else { return 0 };
        values.iter().filter(|v| v.is_finite() && !is_place(&[f64::from(**v)])).count()
    }

    /// Paints a texture of at most `most` pixels per side; `range` is the colour range of values.
    pub(crate) fn paint(&self, tint: &Tint, range: [f32; 2], most: usize) -> ColorImage {
        let every = self.width.max(self.height).div_ceil(most.max(1)).max(1);
        let (width, height) = (self.width.div_ceil(every), self.height.div_ceil(every));
        let bytes: [Color32; 256] = std::array::from_fn(|i| byte_color(i as u8, tint));
        let span = f64::from(range[1] - range[0]).max(1e-9);
        let scale: fn(f64) -> Color32 =
            if matches!(tint, Tint::Disparity) { palette::even } else { palette::range };
        let color = |i: usize| match &self.pixels {
            Pixels::Color(colors) => colors[i],
            Pixels::Bytes(values) => bytes[usize::from(values[i])],
            Pixels::Greys { values, shown } => {
                let level = u32::from(values[i]).saturating_sub(shown.start);
                Color32::from_gray((level * 256 / (shown.end - shown.start)).min(255) as u8)
            }
            Pixels::Values { values, .. } if values[i].is_nan() => Color32::TRANSPARENT,
            Pixels::Values { values, .. } => scale(f64::from(values[i] - range[0]) / span),
        };
        let mut pixels = Vec::with_capacity(width * height);
        for y in 0..height {
            let row = y * every * self.width;
            pixels.extend((0..width).map(|x| color(row + x * every)));
        }
        ColorImage::new([width, height], pixels)
    }

    /// Index of a pixel, if it lies in the image.
    pub(crate) fn index(&self, x: f64, y: f64) -> Option<usize> {
        let inside = x >= 0.0 && y >= 0.0 && x < self.width as f64 && y < self.height as f64;
        inside.then(|| y as usize * self.width + x as usize)
    }
}

fn byte_color(value: u8, tint: &Tint) -> Color32 {
    match tint {
        Tint::Plain | Tint::Disparity => Color32::from_gray(value),
        Tint::Labels(classes) => classes.color(value),
        Tint::Cost(_) if value > 250 => Color32::TRANSPARENT,
        Tint::Cost(palette) => palette.cost(value),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn raw(encoding: &str, width: u32, height: u32, step: u32, data: &[u8]) -> RawImage {
        RawImage {
            encoding: encoding.into(),
            width,
            height,
            step,
            data: data.to_vec().into(),
            ..Default::default()
        }
    }

    fn decoded(encoding: &str, width: u32, height: u32, data: &[u8]) -> Result<DecodedImage, String> {
        decode(&AnyMessage::new(raw(encoding, width, height, data.len() as u32 / height.max(1), data)), None)
    }

    #[test]
    fn colours_depths_and_bytes_are_told_apart() {
        let red = Color32::from_rgb(255, 0, 0);
        assert_eq!(decoded("rgb8", 1, 1, &[255, 0, 0]).unwrap().pixels, Pixels::Color(vec![red]));
        assert_eq!(decoded("mono8", 1, 2, &[7, 9]).unwrap().pixels, Pixels::Bytes(vec![7, 9]));
        let depth = decoded("16UC1", 2, 1, &[0, 1, 2, 1]).unwrap();
        assert_eq!(depth.pixels, Pixels::Values { values: vec![256.0, 258.0], whole: true });
        assert_eq!(depth.value_range(), Some([256.0, 256.0]));
        assert_eq!(depth.implausible(), 0);
    }

    /// The grey levels with which an image of one row and 16 bits is painted, and what is said of it.
    fn painted16(values: &[u16]) -> (Vec<u8>, String) {
        let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        let image = decoded("mono16", values.len() as u32, 1, &bytes).unwrap();
        assert!(matches!(&image.pixels, Pixels::Greys { values: read, .. } if *read == values));
        let painted = image.paint(&Tint::Plain, [0.0, 1.0], values.len());
        (painted.pixels.iter().map(Color32::r).collect(), image.encoding)
    }

    #[test]
    fn the_grey_levels_of_16_bits_use_the_bits_that_the_camera_has() {
        let shown = |values: [u16; 3]| painted16(&values);
        assert_eq!(shown([0, 2048, 4095]), (vec![0, 128, 255], "mono16, black 0, white 4095".to_owned()));
        // With all bits, the upper byte is shown.
        assert_eq!(shown([255, 256, 65535]).0, [0, 1, 255]);
        // A dark image stays dark.
        assert_eq!(shown([0, 1, 9]).0, [0, 1, 9]);
    }

    #[test]
    fn the_grey_levels_of_a_narrow_range_are_spread_from_black_to_white_and_do_not_flicker() {
        let between = |low: u16, high: u16| -> Vec<u16> { (low..=high).step_by(10).collect() };
        let (painted, said) = painted16(&between(7000, 9000));
        assert!(painted[0] < 20 && painted[painted.len() - 1] > 230, "{painted:?}");
        assert_eq!(said, "mono16, black 6912, white 9215");
        // The next image differs a little, and a single hot pixel and a dead one say nothing of the others.
        let mut next = between(7030, 8970);
        next.extend([0, 65535]);
        let (painted, said_of_next) = painted16(&next);
        assert_eq!(said_of_next, said);
        assert_eq!(painted[painted.len() - 2..], [0, 255]);
        // An even image is grey, and its noise is faint.
        let (painted, _) = painted16(&between(7000, 7040));
        assert!(painted.iter().all(|grey| (64..192).contains(grey)), "{painted:?}");
    }

    #[test]
    fn grey_levels_stay_while_percentiles_waver_and_follow_larger_changes() {
        let shown = |values: &[u16], last: Option<&Range<u32>>| {
            let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
            let raw = raw("mono16", values.len() as u32, 1, bytes.len() as u32, &bytes);
            decode(&AnyMessage::new(raw), last).unwrap().grey_range().unwrap()
        };
        let between = |low: u16, high: u16| -> Vec<u16> { (low..=high).step_by(10).collect() };
        // The 1st percentiles are 7170 and 7166, and a step is at 7168.
        let (above, below) = (between(7160, 9000), between(7156, 9000));
        let first = shown(&above, None);
        assert_eq!([first.start, shown(&below, None).start], [7168, 6912]);
        assert_eq!(shown(&below, Some(&first)), first);
        for other in [between(20_000, 22_000), between(7500, 8000), between(7160, 20_000)] {
            assert_eq!(shown(&other, Some(&first)), shown(&other, None));
        }
        // No level is beyond the last one of 16 bits.
        assert_eq!(shown(&[65_535; 200], None).end, 65_536);
    }

    #[test]
    fn what_is_near_has_one_colour_in_ranges_and_in_disparities() {
        let bytes: Vec<u8> = [3.0_f32, 46.0].iter().flat_map(|value| value.to_le_bytes()).collect();
        let image = decoded("32FC1", 2, 1, &bytes).unwrap();
        let painted = |tint: Tint| image.paint(&tint, [3.0, 46.0], 64).pixels;
        let [near, far] = [0.0, 1.0].map(palette::range);
        assert_eq!(painted(Tint::Plain), [near, far]);
        assert_eq!(painted(Tint::Disparity), [far, near]);
    }

    #[test]
    fn values_that_cannot_be_are_counted_and_do_not_widen_the_range() {
        let values = [1.0, f32::MAX, -f32::MAX, f32::NAN, f32::INFINITY, 1e9, 3.0, 2.0];
        let bytes: Vec<u8> = values.iter().flat_map(|v: &f32| v.to_le_bytes()).collect();
        let image = decoded("32FC1", 8, 1, &bytes).unwrap();
        // The negative one is no depth, and thus as invalid as NaN.
        assert_eq!(image.implausible(), 2);
        let [low, high] = image.value_range().unwrap();
        assert!(1.0 <= low && high <= 3.0, "{low} {high}");
    }

    #[test]
    fn what_cannot_be_shown_says_why() {
        assert!(decoded("h264", 1, 1, &[0]).unwrap_err().contains("h264"));
        assert!(decoded("rgb8", 4, 1, &[0; 3]).is_err());
        let broken =
            CompressedImage { format: "jpeg".into(), data: vec![1, 2, 3].into(), ..Default::default() };
        assert!(decode(&AnyMessage::new(broken), None).is_err());
        let vector = AnyMessage::new(rcs_msg::foxglove::Vector2::default());
        assert!(decode(&vector, None).unwrap_err().contains("no image"));
    }

    #[test]
    fn an_image_larger_than_a_texture_is_thinned() {
        let image = decoded("mono8", 5, 4, &[0; 20]).unwrap();
        assert_eq!(image.paint(&Tint::Plain, [0.0, 1.0], 2).size, [2, 2]);
    }

    #[test]
    fn unknown_pixels_are_transparent_and_known_ones_have_the_colour_of_their_label() {
        let image = decoded("mono8", 3, 1, &[0, 2, 77]).unwrap();
        let red = Color32::from_rgb(229, 57, 53);
        let label = palette::Label { value: 2, name: "obstacle".to_owned(), color: red };
        let image = image.paint(&Tint::Labels([label].into_iter().collect()), [0.0, 1.0], 64);
        assert_eq!(image.pixels, [Color32::TRANSPARENT, red, Color32::TRANSPARENT]);
    }
}
