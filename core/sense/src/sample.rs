//! Sample pictures: what a learned model looked like where it was learned, for the person who judges the model.

use rcs_msg::foxglove::RawImage;
use rcs_msg::{AnyMessage, Stamp};
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Columns and rows of a sample picture, pixels: small, because each message of models carries one of each model.
pub const SAMPLE_PX: usize = 16;
/// Greatest number of columns and of rows of a picture that is read from a message or a file.
const MOST_PX: u32 = 64;

/// A colour image in row order.
#[derive(Clone, Copy, Debug)]
pub struct Rgb<'a> {
    /// Three bytes per pixel.
    pub data: &'a [u8],
    /// Bytes from the beginning of a row to that of the next one.
    pub step: usize,
    /// Columns and rows, pixels.
    pub size: [usize; 2],
    /// Optical frame of the camera.
    pub frame_id: &'a str,
    /// Acquisition time.
    pub time: Stamp,
}

/// A small `rgb8` picture with the camera's frame and the acquisition time of the image that it was taken from. As part
/// of a state its pixels are shared with the messages that carry it.
#[derive(Clone, Debug, PartialEq)]
pub struct Sample(RawImage);

impl Eq for Sample {}

/// Why a picture is refused.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "sample is {encoding:?} of {width}x{height} with {got} bytes, expected rgb8 of at most {MOST_PX}x{MOST_PX} in rows without gaps"
)]
pub struct SampleError {
    encoding: String,
    width: u32,
    height: u32,
    got: usize,
}

impl Sample {
    /// The square around a pixel (column, row), `side` pixels wide; moved into the image where it would extend beyond
    /// its border, and reduced to [`SAMPLE_PX`] pixels where it is larger. `None` if the image has no pixels.
    pub fn around(image: &Rgb<'_>, [column, row]: [usize; 2], side: usize) -> Option<Sample> {
        let [width, height] = image.size;
        let complete = |height: usize| image.data.len() >= (height - 1) * image.step + 3 * width;
        if width == 0 || height == 0 || image.step < 3 * width || !complete(height) {
            return None;
        }
        let side = side.clamp(1, width.min(height));
        let px = side.min(SAMPLE_PX);
        let begin = |middle: usize, length: usize| middle.saturating_sub(side / 2).min(length - side);
        let (left, top) = (begin(column, width), begin(row, height));
        let mut data = Vec::with_capacity(3 * px * px);
        for y in 0..px {
            for x in 0..px {
                let at = (top + y * side / px) * image.step + 3 * (left + x * side / px);
                data.extend_from_slice(&image.data[at..at + 3]);
            }
        }
        Some(Sample(RawImage {
            timestamp: Some(image.time.to_proto()),
            frame_id: image.frame_id.to_owned(),
            width: px as u32,
            height: px as u32,
            encoding: "rgb8".to_owned(),
            step: 3 * px as u32,
            data: data.into(),
        }))
    }

    /// The picture of a message, checked.
    pub fn of(message: &RawImage) -> Result<Sample, SampleError> {
        let RawImage { width, height, step, .. } = *message;
        let sides = 1..=MOST_PX;
        let fits = message.encoding == "rgb8"
            && sides.contains(&width)
            && sides.contains(&height)
            && step == 3 * width
            && message.data.len() == (step * height) as usize;
        fits.then(|| Sample(message.clone())).ok_or_else(|| SampleError {
            encoding: message.encoding.clone(),
            width,
            height,
            got: message.data.len(),
        })
    }

    /// The picture as a message; it shares the pixels.
    pub fn message(&self) -> RawImage {
        self.0.clone()
    }
}

impl Serialize for Sample {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_bytes(&AnyMessage::new(self.0.clone()).bytes())
    }
}

impl<'de> Deserialize<'de> for Sample {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let bytes = Vec::<u8>::deserialize(deserializer)?;
        let message = AnyMessage::decode::<RawImage>(bytes.into()).map_err(D::Error::custom)?;
        message.to::<RawImage>().map(Sample).ok_or_else(|| D::Error::custom("not an image"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An image whose pixels are their column and row.
    fn image(data: &mut Vec<u8>, [width, height]: [usize; 2]) -> Rgb<'_> {
        *data = (0..height).flat_map(|y| (0..width).flat_map(move |x| [x as u8, y as u8, 7])).collect();
        Rgb { data, step: 3 * width, size: [width, height], frame_id: "camera", time: Stamp(5_000_000_007) }
    }

    #[test]
    fn a_sample_is_the_square_around_a_pixel_inside_of_the_image_and_at_most_as_large_as_a_sample() {
        let check = |at: [usize; 2], side: usize, corner: [u8; 2], last: [u8; 2], px: usize| {
            let mut data = Vec::new();
            let message = Sample::around(&image(&mut data, [60, 40]), at, side).unwrap().message();
            assert_eq!([message.width, message.height, message.step], [px, px, 3 * px].map(|n| n as u32));
            assert_eq!(message.data[..2], corner, "{at:?}, {side}");
            assert_eq!(message.data[message.data.len() - 3..][..2], last, "{at:?}, {side}");
        };
        check([30, 20], 8, [26, 16], [33, 23], 8);
        check([1, 39], 8, [0, 32], [7, 39], 8);
        check([30, 20], 32, [14, 4], [44, 34], SAMPLE_PX);
        check([30, 20], 500, [10, 0], [47, 37], SAMPLE_PX);
        let mut data = Vec::new();
        assert_eq!(Sample::around(&image(&mut data, [0, 4]), [0, 0], 8), None);
    }

    #[test]
    fn a_sample_comes_back_from_its_message_and_from_a_saved_state_and_a_damaged_one_is_refused() {
        let mut data = Vec::new();
        let sample = Sample::around(&image(&mut data, [60, 40]), [30, 20], 12).unwrap();
        let message = sample.message();
        assert_eq!(message.timestamp.as_ref().and_then(Stamp::from_proto), Some(Stamp(5_000_000_007)));
        assert_eq!(Sample::of(&message), Ok(sample));
        let check = |change: fn(&mut RawImage)| {
            let mut damaged = message.clone();
            change(&mut damaged);
            assert!(Sample::of(&damaged).unwrap_err().to_string().contains("expected rgb8 of at most 64x64"));
        };
        check(|m| m.height = 13);
        check(|m| m.width = 0);
        check(|m| m.encoding = "mono8".to_owned());
        check(|m| (m.width, m.height, m.step) = (65, 1, 195));
    }
}
