//! One eye's image as it came: decoded, and judged before it is matched.

use rcs_msg::foxglove::RawImage;
use rcs_msg::image::{ImageError, raw_to_rgb8};
use serde::{Deserialize, Serialize};

/// An image that can be matched.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Picture {
    pub(crate) frame_id: String,
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// Red, green, blue by rows, without gaps.
    pub(crate) rgb: Vec<u8>,
}

/// What makes an image unusable, whatever its content.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Exposure {
    /// Grey levels up to this are black.
    pub(crate) black: u8,
    /// Grey levels from this on are saturated.
    pub(crate) saturated: u8,
    /// Share of the pixels that must be neither, percent.
    pub(crate) min_usable_pct: u32,
}

/// Why an image is refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub(crate) enum PictureError {
    #[error(transparent)]
    Image(#[from] ImageError),
    #[error(
        "{black_pct} % of it are black and {saturated_pct} % saturated, expected at least {min_usable_pct} % that are neither"
    )]
    Exposure { black_pct: u32, saturated_pct: u32, min_usable_pct: u32 },
}

impl Picture {
    /// Decodes a message and looks at its exposure.
    pub(crate) fn new(message: &RawImage, exposure: Exposure) -> Result<Picture, PictureError> {
        let image = raw_to_rgb8(message)?;
        let picture = Picture {
            frame_id: message.frame_id.clone(),
            width: image.width as usize,
            height: image.height as usize,
            rgb: image.data,
        };
        let (mut black, mut saturated) = (0_usize, 0_usize);
        for grey in picture.levels() {
            black += usize::from(grey <= exposure.black);
            saturated += usize::from(grey >= exposure.saturated);
        }
        let pixels = (picture.width * picture.height).max(1);
        let pct = |count: usize| (100 * count / pixels) as u32;
        // Levels may be set so that one is both.
        let usable_pct = pct(pixels.saturating_sub(black + saturated));
        if usable_pct < exposure.min_usable_pct {
            let (black_pct, saturated_pct) = (pct(black), pct(saturated));
            let min_usable_pct = exposure.min_usable_pct;
            return Err(PictureError::Exposure { black_pct, saturated_pct, min_usable_pct });
        }
        Ok(picture)
    }

    /// Grey levels by rows.
    pub(crate) fn grey(&self) -> Vec<u8> {
        self.levels().collect()
    }

    /// The brightness of colours as television weighs them, in 1/256.
    fn levels(&self) -> impl Iterator<Item = u8> + '_ {
        self.rgb.as_chunks::<3>().0.iter().map(|&[r, g, b]| {
            let sum = 77 * u32::from(r) + 150 * u32::from(g) + 29 * u32::from(b);
            ((sum + 128) >> 8) as u8
        })
    }
}

/// A number that two images share only if their pixels are the same, but for one case in 2⁶⁴.
pub(crate) fn fingerprint(message: &RawImage) -> u64 {
    let mix = |hash: u64, word: u64| {
        let product = (hash ^ word).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        product ^ (product >> 29)
    };
    let (words, rest) = message.data.as_chunks::<8>();
    let size = (u64::from(message.width) << 32) | u64::from(message.height);
    let hash = words.iter().fold(mix(0, size), |hash, word| mix(hash, u64::from_le_bytes(*word)));
    rest.iter().fold(hash, |hash, &byte| mix(hash, u64::from(byte)))
}

#[cfg(test)]
mod tests {
    use super::*;

    const EXPOSURE: Exposure = Exposure { black: 4, saturated: 251, min_usable_pct: 20 };

    fn grey(levels: &[u8]) -> RawImage {
        RawImage {
            width: levels.len() as u32,
            height: 1,
            step: levels.len() as u32,
            encoding: "mono8".to_owned(),
            data: levels.to_vec().into(),
            ..RawImage::default()
        }
    }

    #[test]
    fn grey_of_a_grey_image_is_the_image() {
        let levels: Vec<u8> = (0..=255).collect();
        assert_eq!(Picture::new(&grey(&levels), EXPOSURE).unwrap().grey(), levels);
    }

    #[test]
    fn black_and_saturated_images_are_refused_with_their_shares() {
        let check = |levels: &[u8], expected: &str| {
            let error = Picture::new(&grey(levels), EXPOSURE).unwrap_err().to_string();
            assert!(error.starts_with(expected), "got {error:?}, expected {expected:?}");
        };
        check(&[0; 100], "100 % of it are black and 0 % saturated");
        check(&[255; 100], "0 % of it are black and 100 % saturated");
        let half: Vec<u8> = (0..100)
            .map(|i| {
                if i < 60 {
                    4
                } else if i < 90 {
                    251
                } else {
                    100
                }
            })
            .collect();
        check(&half, "60 % of it are black and 30 % saturated, expected at least 20 %");
        let enough: Vec<u8> = (0..100).map(|i| if i < 80 { 0 } else { 100 }).collect();
        Picture::new(&grey(&enough), EXPOSURE).unwrap();
    }

    #[test]
    fn one_bit_anywhere_changes_the_fingerprint() {
        let levels = [7_u8; 21];
        let same = fingerprint(&grey(&levels));
        assert_eq!(same, fingerprint(&grey(&levels)));
        for i in 0..levels.len() {
            let mut other = levels;
            other[i] ^= 0x80;
            assert_ne!(same, fingerprint(&grey(&other)), "byte {i}");
        }
        assert_ne!(same, fingerprint(&RawImage { width: 7, height: 3, ..grey(&levels) }));
    }
}
