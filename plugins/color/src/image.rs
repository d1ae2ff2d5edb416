//! The colour image, and its reduction to 128×96 by averaging (Albus 2006a, 3.1.2).

use rcs_msg::Stamp;
use rcs_sense::Rgb;

/// Columns of the reduced image.
pub const WIDTH: usize = 128;
/// Rows of the reduced image.
pub const HEIGHT: usize = 96;
/// Pixels of the reduced image.
pub const PIXELS: usize = WIDTH * HEIGHT;

/// An image with red, green and blue bytes, in row order.
#[derive(Clone, Copy, Debug)]
pub struct Image<'a> {
    size: [usize; 2],
    step: usize,
    data: &'a [u8],
}

/// Why an image cannot be used.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum ImageSizeError {
    /// Width, height and number of bytes do not agree.
    #[error("image of {width}x{height} pixels has {got} bytes, expected {expected}")]
    Size {
        /// Pixels.
        width: usize,
        /// Pixels.
        height: usize,
        /// Number of bytes given.
        got: usize,
        /// Number of bytes expected.
        expected: usize,
    },
}

impl<'a> Image<'a> {
    /// An image of rows of `3 * width` bytes that begin `step` bytes apart.
    pub fn new(
        [width, height]: [usize; 2],
        step: usize,
        data: &'a [u8],
    ) -> Result<Image<'a>, ImageSizeError> {
        let expected = if height == 0 { 0 } else { step * (height - 1) + 3 * width };
        if width == 0 || height == 0 || step < 3 * width || data.len() < expected {
            return Err(ImageSizeError::Size { width, height, got: data.len(), expected });
        }
        Ok(Image { size: [width, height], step, data })
    }

    /// Number of columns and rows.
    pub fn size(&self) -> [usize; 2] {
        self.size
    }

    /// Bytes of a row.
    pub fn row(&self, row: usize) -> &'a [u8] {
        &self.data[row * self.step..][..3 * self.size[0]]
    }

    /// The image as samples are taken from it, with the camera's optical frame and its acquisition time.
    pub fn rgb(&self, frame_id: &'a str, time: Stamp) -> Rgb<'a> {
        Rgb { data: self.data, step: self.step, size: self.size, frame_id, time }
    }

    /// Red, green and blue.
    pub fn pixel(&self, column: usize, row: usize) -> [u8; 3] {
        let at = row * self.step + 3 * column;
        [self.data[at], self.data[at + 1], self.data[at + 2]]
    }
}

/// First pixel and one past the last pixel of each of `parts` equal parts of a side of `length` pixels; each part has
/// at least 1 pixel.
///
/// A side that is shorter than `parts` assigns each of its pixels to several parts.
pub fn edges(length: usize, parts: usize) -> Vec<[usize; 2]> {
    (0..parts)
        .map(|i| {
            let start = i * length / parts;
            [start, ((i + 1) * length / parts).max(start + 1)]
        })
        .collect()
}

/// Mean red and green of each pixel of the 128×96 image, rounded; 0.3 ms for 640×480.
pub fn reduce(image: &Image<'_>) -> Vec<[u8; 2]> {
    let [width, height] = image.size();
    let columns = edges(width, WIDTH);
    let mut reduced = Vec::with_capacity(PIXELS);
    for [top, bottom] in edges(height, HEIGHT) {
        let mut sums = [[0_u32; 2]; WIDTH];
        for row in top..bottom {
            let row = image.row(row).as_chunks::<3>().0;
            for (sum, &[start, end]) in sums.iter_mut().zip(&columns) {
                for &[red, green, _] in &row[start..end] {
                    sum[0] += u32::from(red);
                    sum[1] += u32::from(green);
                }
            }
        }
        reduced.extend(sums.iter().zip(&columns).map(|(sum, [start, end])| {
            let count = ((end - start) * (bottom - top)) as u32;
            sum.map(|sum| ((sum + count / 2) / count) as u8)
        }));
    }
    reduced
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Reference implementation: the mean over the pixels whose index times 128 / width (96 / height) falls on a
    /// reduced pixel.
    fn reference_reduce(image: &Image<'_>) -> Vec<[u8; 2]> {
        let [width, height] = image.size();
        let mut reduced = Vec::new();
        for y in 0..96 {
            for x in 0..128 {
                let (mut sums, mut count) = ([0.0; 2], 0.0);
                for v in (y * height / 96)..((y + 1) * height / 96).max(y * height / 96 + 1) {
                    for u in (x * width / 128)..((x + 1) * width / 128).max(x * width / 128 + 1) {
                        let [r, g, _] = image.pixel(u, v);
                        sums[0] += f64::from(r);
                        sums[1] += f64::from(g);
                        count += 1.0;
                    }
                }
                reduced.push(sums.map(|sum| (sum / count + 0.5).floor() as u8));
            }
        }
        reduced
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn reducing_equals_the_mean_of_each_block(width in 1..300_usize, height in 1..220_usize, pad in 0..9_usize, seed: u64) {
            let step = 3 * width + pad;
            let mut state = seed | 1;
            let data: Vec<u8> = (0..step * height).map(|_| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                (state >> 56) as u8
            }).collect();
            let image = Image::new([width, height], step, &data).unwrap();
            prop_assert_eq!(reduce(&image), reference_reduce(&image));
        }
    }

    #[test]
    fn sizes_that_do_not_agree_are_refused() {
        assert!(Image::new([4, 2], 12, &[0; 24]).is_ok());
        assert!(Image::new([4, 2], 13, &[0; 25]).is_ok(), "the last row may end early");
        for (size, step, bytes) in [([4, 2], 12, 23), ([4, 2], 11, 24), ([0, 2], 12, 24), ([4, 0], 12, 24)] {
            assert!(Image::new(size, step, &vec![0; bytes]).is_err());
        }
    }
}
