//! Images that say nothing: unexposed, or the same as the last one.

/// A pixel whose brightest colour is below this is black.
const BLACK: u8 = 8;
/// A pixel whose darkest colour is above this is saturated.
const SATURATED: u8 = 250;

/// Why an image is not used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ImageFault {
    /// Too dark, or the lens is covered.
    #[error("image is black: {black_pct:.1} % of its pixels, expected at most {max_pct} %")]
    Black {
        /// Share of black pixels.
        black_pct: f64,
        /// Largest share that is accepted.
        max_pct: f64,
    },
    /// Too bright.
    #[error("image is saturated: {saturated_pct:.1} % of its pixels, expected at most {max_pct} %")]
    Saturated {
        /// Share of saturated pixels.
        saturated_pct: f64,
        /// Largest share that is accepted.
        max_pct: f64,
    },
    /// The camera stands still although its clock goes on.
    #[error("camera is frozen: image equals the one before")]
    Frozen,
}

/// Checks the exposure of an image of three bytes a pixel.
pub fn check_exposure(rgb: &[u8], max_pct: f64) -> Result<(), ImageFault> {
    let pixels = rgb.as_chunks::<3>().0;
    // Sums of bytes in short runs are what the compiler makes vectors of.
    let (mut black, mut saturated) = (0_u64, 0_u64);
    for run in pixels.chunks(128) {
        let (mut dark, mut bright) = (0_u8, 0_u8);
        for [r, g, b] in run {
            dark += u8::from((*r).max(*g).max(*b) < BLACK);
            bright += u8::from((*r).min(*g).min(*b) > SATURATED);
        }
        black += u64::from(dark);
        saturated += u64::from(bright);
    }
    let percent = |count: u64| 100.0 * count as f64 / pixels.len().max(1) as f64;
    let (black_pct, saturated_pct) = (percent(black), percent(saturated));
    if black_pct > max_pct {
        return Err(ImageFault::Black { black_pct, max_pct });
    }
    if saturated_pct > max_pct {
        return Err(ImageFault::Saturated { saturated_pct, max_pct });
    }
    Ok(())
}

/// A number that two images share only when they are equal, but for chance (64 bits).
pub fn fingerprint(data: &[u8]) -> u64 {
    // FNV-1a over words instead of bytes, in four lanes so that multiplications overlap.
    const PRIME: u64 = 0x0000_0100_0000_01b3;
    let mut lanes = [0xcbf2_9ce4_8422_2325_u64, 1, 2, 3];
    let (blocks, rest) = data.as_chunks::<32>();
    for block in blocks {
        for (lane, word) in lanes.iter_mut().zip(block.as_chunks::<8>().0) {
            let mixed = (*lane ^ u64::from_le_bytes(*word)).wrapping_mul(PRIME);
            *lane = mixed ^ mixed >> 29;
        }
    }
    let mut hash = data.len() as u64;
    let words = lanes.iter().flat_map(|lane| lane.to_le_bytes());
    for byte in words.chain(rest.iter().copied()) {
        hash = (hash ^ u64::from(byte)).wrapping_mul(PRIME);
    }
    hash
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn black_and_saturated_images_are_told_from_dark_and_bright_ones() {
        let image = |black: usize, white: usize| {
            let mut rgb = vec![3_u8; black * 3];
            rgb.extend(vec![255_u8; white * 3]);
            rgb.resize(300 * 3, 120);
            check_exposure(&rgb, 90.0)
        };
        assert_eq!(image(0, 0), Ok(()));
        assert_eq!(image(270, 30), Ok(()));
        assert!(matches!(image(271, 0), Err(ImageFault::Black { .. })));
        assert!(matches!(image(0, 271), Err(ImageFault::Saturated { .. })));
        // One colour at its end is a colour.
        assert_eq!(check_exposure(&[255, 0, 0].repeat(500), 90.0), Ok(()));
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
