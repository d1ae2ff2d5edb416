//! Depth compressed by RVL (Wilson 2017), as in images of ROS's `compressed_depth_image_transport`: width and height
//! (`uint32`), then the depths by rows.

use super::{MAX_PIXELS, MAX_SIDE};
use ::image::{ImageBuffer, Luma};

/// Decodes an image; pixels without depth are 0. The error says what is wrong with the data.
pub(super) fn decode(data: &[u8]) -> Result<ImageBuffer<Luma<u16>, Vec<u16>>, String> {
    let Some((&[w0, w1, w2, w3, h0, h1, h2, h3], coded)) = data.split_first_chunk::<8>() else {
        return Err(format!("its {} bytes are no RVL, which begins with width and height", data.len()));
    };
    let (width, height) = (u32::from_le_bytes([w0, w1, w2, w3]), u32::from_le_bytes([h0, h1, h2, h3]));
    let count = u64::from(width) * u64::from(height);
    if count == 0 || count > MAX_PIXELS {
        return Err(format!("it has {width}×{height} pixels, expected 1 to {MAX_PIXELS}"));
    }
    if width.max(height) > MAX_SIDE {
        return Err(format!("it has {width}×{height} pixels, expected at most {MAX_SIDE} a side"));
    }
    let count = count as usize;
    let mut depths: Vec<u16> = Vec::new();
    let mut numbers = Numbers { words: coded.chunks(4), word: 0, nibbles: 0 };
    let mut last = 0_u16;
    // Runs in turn of pixels without depth, of which the length is stored, and of pixels with depth, of which the length
    // and the differences are stored.
    while depths.len() < count {
        let have = depths.len();
        let cut = || format!("its data end after {have} of {count} pixels");
        let empty = numbers.next().ok_or_else(cut)? as usize;
        let full = numbers.next().ok_or_else(cut)? as usize;
        if empty.saturating_add(full) > count - have {
            return Err(format!("{empty} and {full} pixels follow {have} of {count}"));
        }
        depths.resize(have + empty, 0);
        for _ in 0..full {
            let number = numbers.next().ok_or_else(cut)?;
            // The lowest bit is the sign: 0, 1, 2, 3, 4 are 0, −1, 1, −2, 2.
            let difference = (number >> 1) ^ (number & 1).wrapping_neg();
            last = last.wrapping_add(difference as u16);
            depths.push(last);
        }
    }
    ImageBuffer::from_raw(width, height, depths).ok_or_else(|| "its size is too large".to_owned())
}

/// Numbers of three bits per nibble, the lowest bits first. The top bit of a nibble says that the number goes on. The
/// nibbles are read from the top of little-endian words of 32 bits.
struct Numbers<'a> {
    words: std::slice::Chunks<'a, u8>,
    word: u32,
    /// Nibbles of `word` that have not been read.
    nibbles: u32,
}

impl Numbers<'_> {
    /// `None` at the end of the data.
    fn next(&mut self) -> Option<u32> {
        let mut number = 0;
        for shift in (0..u32::BITS).step_by(3) {
            if self.nibbles == 0 {
                self.word = u32::from_le_bytes(self.words.next()?.try_into().ok()?);
                self.nibbles = 8;
            }
            let nibble = self.word >> 28;
            self.word <<= 4;
            self.nibbles -= 1;
            number |= (nibble & 7) << shift;
            if nibble & 8 == 0 {
                break;
            }
        }
        Some(number)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The encoder of the paper, without its packing into words: one number per element.
    fn numbers(depths: &[u16]) -> Vec<u32> {
        let (mut out, mut rest, mut last) = (Vec::new(), depths, 0_u16);
        while !rest.is_empty() {
            let empty = rest.iter().take_while(|depth| **depth == 0).count();
            let full = rest[empty..].iter().take_while(|depth| **depth != 0).count();
            out.extend([empty as u32, full as u32]);
            for depth in &rest[empty..empty + full] {
                let difference = i32::from(depth.wrapping_sub(last) as i16);
                out.push(((difference << 1) ^ (difference >> 31)) as u32);
                last = *depth;
            }
            rest = &rest[empty + full..];
        }
        out
    }

    fn encode(width: u32, height: u32, depths: &[u16]) -> Vec<u8> {
        let mut nibbles = Vec::new();
        for mut number in numbers(depths) {
            while number > 7 {
                nibbles.push(8 | number & 7);
                number >>= 3;
            }
            nibbles.push(number);
        }
        nibbles.resize(nibbles.len().next_multiple_of(8), 0);
        let words = nibbles.chunks(8).map(|word| word.iter().fold(0, |all, nibble| all << 4 | nibble));
        [width, height].into_iter().chain(words).flat_map(u32::to_le_bytes).collect()
    }

    proptest! {
        #[test]
        fn what_is_encoded_is_decoded(
            depths in prop::collection::vec(prop_oneof![Just(0_u16), 1..6000_u16, any::<u16>()], 24),
            cut in 0_usize..8,
        ) {
            let data = encode(6, 4, &depths);
            prop_assert_eq!(decode(&data).expect("it decodes").into_raw(), depths);
            let cut = &data[..data.len() - 1 - cut];
            prop_assert!(decode(cut).is_err());
        }

        #[test]
        fn any_bytes_are_decoded_or_refused(data in prop::collection::vec(any::<u8>(), 0..64)) {
            let small = [3_u32, 2].into_iter().flat_map(u32::to_le_bytes).chain(data.iter().copied());
            let _ = decode(&small.collect::<Vec<u8>>());
            let _ = decode(&data);
        }
    }

    #[test]
    fn the_error_says_what_is_wrong() {
        assert_eq!(
            decode(&[1; 7]).unwrap_err(),
            "its 7 bytes are no RVL, which begins with width and height"
        );
        let size = |width: u32, height: u32| [width, height].into_iter().flat_map(u32::to_le_bytes);
        let none: Vec<u8> = size(0, 3).collect();
        assert_eq!(decode(&none).unwrap_err(), "it has 0×3 pixels, expected 1 to 134217728");
        let wide: Vec<u8> = size(32_769, 1).collect();
        assert_eq!(decode(&wide).unwrap_err(), "it has 32769×1 pixels, expected at most 32768 a side");
        let empty: Vec<u8> = size(2, 3).collect();
        assert_eq!(decode(&empty).unwrap_err(), "its data end after 0 of 6 pixels");
        let long: Vec<u8> = size(2, 3).chain(0x7700_0000_u32.to_le_bytes()).collect();
        assert_eq!(decode(&long).unwrap_err(), "7 and 7 pixels follow 0 of 6");
    }
}
