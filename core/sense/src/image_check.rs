//! Checks whether an image is usable: it is no depth, decodes, has the size of its calibration, is exposed, and differs from
//! the previous one.
//!
//! A pixel counts as black or saturated by its grey level (BT.601 luma). An image is refused if too few of its pixels
//! are neither; the default limit is low, because half of an image may be an overexposed sky or deep shade. An image
//! with the same bytes as the previous one means that the camera is frozen, because every sensor has noise.

use rcs_msg::foxglove::RawImage;
use rcs_msg::image::{ImageError, raw_to_rgb8};
use rcs_msg::rcs;
use serde::{Deserialize, Serialize};

/// Why an image is refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ImageFault {
    /// It does not decode.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// It has the encoding of depth. Decoding would stretch its grey levels, each image by itself.
    #[error("encoding {got:?} is depth, expected that of a camera, such as rgb8, mono8 or mono16")]
    Depth {
        /// Encoding of the image.
        got: String,
    },
    /// Its size differs from that of its calibration, or of the other image of the pair.
    #[error("{what} has {got:?} pixels, {of} is for {expected:?}")]
    Size {
        /// Which image.
        what: &'static str,
        /// Width and height.
        got: [u32; 2],
        /// What it is compared with.
        of: &'static str,
        /// Width and height of that.
        expected: [u32; 2],
    },
    /// The camera is covered, or the image too dark or too bright.
    #[error(
        "image is {black_pct} % black and {saturated_pct} % saturated, expected at least {min_usable_pct} % that is neither"
    )]
    Exposure {
        /// Share of black pixels, %.
        black_pct: u32,
        /// Share of saturated pixels, %.
        saturated_pct: u32,
        /// Least accepted share of pixels that are neither, %.
        min_usable_pct: u32,
    },
    /// The camera is frozen: the bytes repeat although the time advances.
    #[error("image equals the one before: the camera is frozen")]
    Frozen,
}

/// Checks consecutive images of one camera.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ImageCheck {
    /// Fingerprint of the previous image.
    last: Option<u64>,
}

impl ImageCheck {
    /// Checks an image and returns its colours: red, green and blue by rows, without padding. `size` is that of its
    /// calibration if it is known. If `rules` are absent, the defaults apply.
    pub fn check(
        &mut self,
        image: &RawImage,
        size: Option<[u32; 2]>,
        rules: Option<&rcs::ImageCheck>,
    ) -> Result<Vec<u8>, ImageFault> {
        let rules = rules.copied().unwrap_or_else(rcs_msg::params::default);
        let print = mix(fingerprint(&image.data), u64::from(image.width) << 32 | u64::from(image.height));
        let is_frozen = self.last.replace(print) == Some(print);
        if let Some(expected) = size {
            check_size("image", image, "its calibration", expected)?;
        }
        if matches!(image.encoding.as_str(), "16UC1" | "32FC1" | "64FC1") {
            return Err(ImageFault::Depth { got: image.encoding.clone() });
        }
        let rgb = raw_to_rgb8(image)?.data;
        check_exposure(&rgb, &rules)?;
        if is_frozen && rules.frozen { Err(ImageFault::Frozen) } else { Ok(rgb) }
    }
}

/// Width and height of an image, pixels.
pub fn size_of(image: &RawImage) -> [u32; 2] {
    [image.width, image.height]
}

/// Checks that an image has the expected size.
pub fn check_size(
    what: &'static str,
    image: &RawImage,
    of: &'static str,
    expected: [u32; 2],
) -> Result<(), ImageFault> {
    let got = size_of(image);
    if got == expected { Ok(()) } else { Err(ImageFault::Size { what, got, of, expected }) }
}

/// The grey level of a pixel: BT.601 luma, coefficients in 1/256.
pub fn luma([r, g, b]: [u8; 3]) -> u8 {
    let sum = 77 * u32::from(r) + 150 * u32::from(g) + 29 * u32::from(b);
    ((sum + 128) >> 8) as u8
}

/// Checks that enough pixels of an image are neither black nor saturated.
pub fn check_exposure(rgb: &[u8], rules: &rcs::ImageCheck) -> Result<(), ImageFault> {
    let level = |level: u32| level.min(255) as u8;
    let (darkest, brightest) = (level(rules.black_level), level(rules.saturated_level));
    let pixels = rgb.as_chunks::<3>().0;
    // The compiler vectorises byte sums over short runs.
    let (mut black, mut saturated) = (0_u64, 0_u64);
    for run in pixels.chunks(128) {
        let (mut dark, mut bright) = (0_u8, 0_u8);
        for &pixel in run {
            let grey = luma(pixel);
            // A checked sum would not be vectorised; a run is too short for it to wrap.
            dark = dark.wrapping_add(u8::from(grey <= darkest));
            bright = bright.wrapping_add(u8::from(grey >= brightest));
        }
        black += u64::from(dark);
        saturated += u64::from(bright);
    }
    let count = pixels.len().max(1) as u64;
    let pct = |part: u64| (100 * part / count) as u32;
    // The levels may overlap, so that a pixel counts as both.
    let usable_pct = pct((pixels.len() as u64).saturating_sub(black + saturated));
    if usable_pct < rules.min_usable_pct {
        return Err(ImageFault::Exposure {
            black_pct: pct(black),
            saturated_pct: pct(saturated),
            min_usable_pct: rules.min_usable_pct,
        });
    }
    Ok(())
}

const PRIME: u64 = 0x9e37_79b9_7f4a_7c15;

/// A 64-bit hash: equal for equal bytes, and different for different bytes except by chance.
pub fn fingerprint(data: &[u8]) -> u64 {
    // Four lanes, so that the multiplications overlap.
    let mut lanes = [1_u64, 2, 3, 4];
    let (blocks, rest) = data.as_chunks::<32>();
    for block in blocks {
        for (lane, word) in lanes.iter_mut().zip(block.as_chunks::<8>().0) {
            *lane = mix(*lane, u64::from_le_bytes(*word));
        }
    }
    let hash = lanes.into_iter().fold(data.len() as u64, mix);
    rest.iter().fold(hash, |hash, &byte| mix(hash, u64::from(byte)))
}

/// The same of several texts, in their order: of the files of a process, so that its state need not contain them.
pub fn fingerprint_of_texts(texts: &[&String]) -> u64 {
    texts.iter().fold(0, |hash, text| fingerprint(text.as_bytes()) ^ hash.rotate_left(21))
}

fn mix(hash: u64, word: u64) -> u64 {
    let product = (hash ^ word).wrapping_mul(PRIME);
    product ^ (product >> 29)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

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

    fn verdict(levels: &[u8]) -> Result<Vec<u8>, ImageFault> {
        ImageCheck::default().check(&grey(levels), None, None)
    }

    /// An image of 100 pixels with this many black and saturated ones.
    fn mixed(black: usize, saturated: usize) -> Vec<u8> {
        let mut levels = vec![4_u8; black];
        levels.resize(black + saturated, 251);
        levels.resize(100, 120);
        levels
    }

    #[test]
    fn luma_of_a_grey_pixel_is_its_level() {
        assert!((0..=255).all(|level| luma([level; 3]) == level));
    }

    #[test]
    fn an_image_is_refused_where_too_little_of_it_is_exposed() {
        for (black, saturated) in [(0, 0), (90, 0), (0, 90), (45, 45), (60, 0)] {
            verdict(&mixed(black, saturated)).unwrap_or_else(|error| panic!("{black} {saturated}: {error}"));
        }
        for (black, saturated) in [(91, 0), (0, 91), (46, 45), (100, 0), (0, 100)] {
            let error = verdict(&mixed(black, saturated)).unwrap_err();
            assert_eq!(
                error.to_string(),
                format!(
                    "image is {black} % black and {saturated} % saturated, expected at least 10 % that is neither"
                )
            );
        }
    }

    #[test]
    fn one_colour_at_its_end_is_a_colour() {
        let rules: rcs::ImageCheck = rcs_msg::params::default();
        for pixel in [[255, 0, 0], [0, 255, 0], [255, 255, 0], [60, 0, 0]] {
            assert_eq!(check_exposure(&pixel.repeat(500), &rules), Ok(()), "{pixel:?}");
        }
    }

    /// [`check_exposure`] with one count over all pixels.
    fn reference_exposure(pixels: &[[u8; 3]], rules: &rcs::ImageCheck) -> Result<(), ImageFault> {
        let greys = || pixels.iter().map(|&pixel| u32::from(luma(pixel)));
        let black = greys().filter(|&grey| grey <= rules.black_level).count();
        let saturated = greys().filter(|&grey| grey >= rules.saturated_level).count();
        let pct = |part: usize| (100 * part / pixels.len().max(1)) as u32;
        if pct(pixels.len().saturating_sub(black + saturated)) >= rules.min_usable_pct {
            return Ok(());
        }
        Err(ImageFault::Exposure {
            black_pct: pct(black),
            saturated_pct: pct(saturated),
            min_usable_pct: rules.min_usable_pct,
        })
    }

    /// Images of 0 to 1000 pixels: any colours, only a few, or all pixels black or white.
    fn pixels() -> impl Strategy<Value = Vec<[u8; 3]>> {
        let colour = prop_oneof![any::<[u8; 3]>(), Just([0_u8; 3]), Just([255_u8; 3])];
        prop_oneof![
            prop::collection::vec(any::<[u8; 3]>(), 0..=1000),
            prop::collection::vec(colour, 0..=1000),
            (0..=1000_usize).prop_map(|count| vec![[0_u8; 3]; count]),
            (0..=1000_usize).prop_map(|count| vec![[255_u8; 3]; count]),
        ]
    }

    proptest! {
        #[test]
        fn runs_of_pixels_are_counted_like_single_ones(
            pixels in pixels(),
            black_level in 0..=255_u32,
            saturated_level in 0..=255_u32,
            min_usable_pct in 0..=100_u32,
        ) {
            let levels = rcs::ImageCheck { black_level, saturated_level, ..rcs_msg::params::default() };
            for min_usable_pct in [min_usable_pct, 100] {
                let rules = rcs::ImageCheck { min_usable_pct, ..levels };
                prop_assert_eq!(
                    check_exposure(pixels.as_flattened(), &rules),
                    reference_exposure(&pixels, &rules)
                );
            }
        }
    }

    #[test]
    fn the_same_image_again_is_frozen_and_another_is_not() {
        let mut check = ImageCheck::default();
        let rules: rcs::ImageCheck = rcs_msg::params::default();
        let allowed = rcs::ImageCheck { frozen: false, ..rules };
        assert!(check.check(&grey(&[7; 64]), None, Some(&rules)).is_ok());
        assert_eq!(check.check(&grey(&[7; 64]), None, Some(&rules)), Err(ImageFault::Frozen));
        assert!(check.check(&grey(&[7; 64]), None, Some(&allowed)).is_ok());
        assert!(check.check(&grey(&[8; 64]), None, Some(&rules)).is_ok());
        let turned = RawImage { width: 8, height: 8, step: 8, ..grey(&[8; 64]) };
        assert!(check.check(&turned, None, Some(&rules)).is_ok());
    }

    #[test]
    fn an_image_of_another_size_is_refused() {
        let error = ImageCheck::default().check(&grey(&[7; 64]), Some([8, 8]), None).unwrap_err();
        assert_eq!(error.to_string(), "image has [64, 1] pixels, its calibration is for [8, 8]");
    }

    #[test]
    fn one_changed_byte_changes_the_fingerprint() {
        let image: Vec<u8> = (0..1000_u32).map(|i| (i * 7 % 251) as u8).collect();
        let whole = fingerprint(&image);
        assert_eq!(whole, fingerprint(&image.clone()));
        for at in 0..image.len() {
            let mut other = image.clone();
            other[at] ^= 1;
            assert_ne!(fingerprint(&other), whole, "byte {at}");
        }
        assert_ne!(fingerprint(&image[..999]), whole);
    }
}
