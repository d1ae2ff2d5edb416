//! Local binary patterns and their contrast (Albus 2006a, 3.2; Ojala 1996, weights of Ojala 2002).
//!
//! Each of the eight neighbours of a pixel that is not darker than the pixel sets its bit. Bits are numbered clockwise
//! from the top left neighbour, so that the patch 6 5 2 / 7 6 1 / 9 8 7 has the code 1 + 16 + 32 + 64 + 128 = 241. The
//! contrast is the mean of the neighbours whose bit is set minus the mean of the others: 7.4 − 8/3 = 4.7333 in this
//! example, and 0 where all bits are equal. Outside of the image the nearest pixel is used.
//!
//! Contrasts are whole numbers of 1/840 grey level: 840 is a multiple of 1 to 8, so nothing is rounded, and sums do not
//! depend on their order.

/// Contrast units per grey level.
pub const CONTRAST_UNIT: u32 = 840;

/// 840 / n, which converts a sum of n grey levels to a mean in 1/840; 0 for n = 0.
const MEAN_OF: [u32; 9] = [0, 840, 420, 280, 210, 168, 140, 120, 105];

/// Neighbours in the order of their bits: column and row offsets plus one.
const NEIGHBOURS: [[usize; 2]; 8] = [[0, 0], [1, 0], [2, 0], [2, 1], [2, 2], [1, 2], [0, 2], [0, 1]];

/// A grey image with a border of one pixel on each side that repeats the nearest pixel.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PaddedGrey {
    width: usize,
    height: usize,
    /// `height + 2` rows of `width + 2`.
    data: Vec<u8>,
}

impl PaddedGrey {
    /// Intensity of an image of three bytes per pixel, in row order: (77 R + 150 G + 29 B) / 256.
    ///
    /// # Panics
    /// If `rgb` does not contain `width * height` pixels.
    pub fn from_rgb(rgb: &[u8], width: usize, height: usize) -> PaddedGrey {
        assert_eq!(rgb.len(), width * height * 3, "bytes of an image of {width}x{height} pixels");
        let stride = width + 2;
        let mut data = vec![0; stride * (height + 2)];
        if width == 0 || height == 0 {
            return PaddedGrey { width, height, data };
        }
        let rows = data[stride..].chunks_exact_mut(stride);
        for (row, pixels) in rows.zip(rgb.chunks_exact(width * 3)) {
            for (grey, pixel) in row[1..=width].iter_mut().zip(pixels.as_chunks::<3>().0) {
                *grey = intensity(*pixel);
            }
            row[0] = row[1];
            row[width + 1] = row[width];
        }
        data.copy_within(stride..2 * stride, 0);
        data.copy_within(height * stride..(height + 1) * stride, (height + 1) * stride);
        PaddedGrey { width, height, data }
    }

    /// Pixels per row, without the border.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows, without the border.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Intensities of a row, without the border.
    pub fn row(&self, row: usize) -> &[u8] {
        &self.padded_row(row + 1)[1..=self.width]
    }

    fn padded_row(&self, row: usize) -> &[u8] {
        let stride = self.width + 2;
        &self.data[row * stride..(row + 1) * stride]
    }

    /// Codes and contrasts of the pixels of a row.
    pub fn patterns(&self, row: usize, patterns: &mut Patterns) {
        patterns.clear(self.width);
        let rows = [0, 1, 2].map(|above| self.padded_row(row + above));
        let centre = &rows[1][1..=self.width];
        for (bit, [dx, dy]) in NEIGHBOURS.into_iter().enumerate() {
            patterns.compare(bit, &rows[dy][dx..dx + self.width], centre);
        }
        patterns.finish();
    }
}

/// Patterns of the pixels of one row; the value is reused for the next row.
#[derive(Clone, Debug, Default)]
pub struct Patterns {
    /// Code of each pixel.
    pub codes: Vec<u8>,
    /// Contrast of each pixel, in 1/840 grey level.
    pub contrasts: Vec<u32>,
    /// Number of neighbours that are not darker.
    counts: Vec<u8>,
    /// Their sum, and the sum of all eight.
    lit: Vec<u16>,
    all: Vec<u16>,
}

impl Patterns {
    fn clear(&mut self, width: usize) {
        for bytes in [&mut self.codes, &mut self.counts] {
            bytes.clear();
            bytes.resize(width, 0);
        }
        for sums in [&mut self.lit, &mut self.all] {
            sums.clear();
            sums.resize(width, 0);
        }
        self.contrasts.resize(width, 0);
    }

    /// Adds one neighbour of every pixel. Two plain loops without branches or checks, each over numbers of one width,
    /// which the compiler vectorizes. Eight neighbours fit in eight and eleven bits, so nothing overflows.
    fn compare(&mut self, bit: usize, neighbours: &[u8], centres: &[u8]) {
        let pairs = || neighbours.iter().zip(centres);
        for ((code, count), (&neighbour, &centre)) in self.codes.iter_mut().zip(&mut self.counts).zip(pairs())
        {
            let is_lit = u8::from(neighbour >= centre);
            *code |= is_lit << bit;
            *count = count.wrapping_add(is_lit);
        }
        for ((lit, all), (&neighbour, &centre)) in self.lit.iter_mut().zip(&mut self.all).zip(pairs()) {
            *lit = lit.wrapping_add(u16::from(if neighbour >= centre { neighbour } else { 0 }));
            *all = all.wrapping_add(u16::from(neighbour));
        }
    }

    /// Mean of the neighbours whose bit is set minus the mean of the others; 0 where all bits are equal.
    fn finish(&mut self) {
        let sums = self.lit.iter().zip(&self.all);
        for (contrast, (&count, (&lit, &all))) in self.contrasts.iter_mut().zip(self.counts.iter().zip(sums))
        {
            let (count, lit, all) = (usize::from(count).min(8), u32::from(lit), u32::from(all));
            let is_mixed = u32::from(count > 0 && count < 8);
            let dark = all.wrapping_sub(lit);
            *contrast = (lit * MEAN_OF[count]).wrapping_sub(dark * MEAN_OF[8 - count]) * is_mixed;
        }
    }
}

/// Intensity of a pixel.
pub fn intensity([r, g, b]: [u8; 3]) -> u8 {
    ((77 * u32::from(r) + 150 * u32::from(g) + 29 * u32::from(b)) >> 8) as u8
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Reference by definition: code, and contrast in grey levels.
    fn reference_pattern(patch: [[u8; 3]; 3]) -> (u8, f64) {
        let centre = patch[1][1];
        let around = [[0, 0], [0, 1], [0, 2], [1, 2], [2, 2], [2, 1], [2, 0], [1, 0]];
        let (mut code, mut lit, mut dark) = (0, Vec::new(), Vec::new());
        for (bit, [row, column]) in around.into_iter().enumerate() {
            let value: u8 = patch[row][column];
            if value >= centre {
                code += 1 << bit;
                lit.push(f64::from(value));
            } else {
                dark.push(f64::from(value));
            }
        }
        if lit.is_empty() || dark.is_empty() {
            return (code, 0.0);
        }
        let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
        (code, mean(&lit) - mean(&dark))
    }

    fn grey_image(values: &[u8], width: usize) -> PaddedGrey {
        let rgb: Vec<u8> = values.iter().flat_map(|&v| [v; 3]).collect();
        PaddedGrey::from_rgb(&rgb, width, values.len() / width)
    }

    fn patterns(image: &PaddedGrey) -> (Vec<u8>, Vec<u32>) {
        let (mut codes, mut contrasts) = (Vec::new(), Vec::new());
        for row in 0..image.height() {
            let mut patterns = Patterns::default();
            image.patterns(row, &mut patterns);
            codes.extend(patterns.codes);
            contrasts.extend(patterns.contrasts);
        }
        (codes, contrasts)
    }

    #[test]
    fn ojalas_patch_has_code_241_and_contrast_4_7333() {
        let (codes, contrasts) = patterns(&grey_image(&[6, 5, 2, 7, 6, 1, 9, 8, 7], 3));
        assert_eq!(codes[4], 241);
        // 7.4 - 8/3 in 1/840.
        assert_eq!(contrasts[4], 3976);
    }

    proptest! {
        #[test]
        fn patterns_are_those_of_the_definition(width in 1..40_usize, height in 1..12_usize, seed in any::<u64>(), few in any::<bool>()) {
            let mut state = seed | 1;
            let values: Vec<u8> = (0..width * height)
                .map(|_| {
                    state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                    let value = (state >> 56) as u8;
                    // Few different values produce equal neighbours.
                    if few { value & 3 } else { value }
                })
                .collect();
            let image = grey_image(&values, width);
            let (codes, contrasts) = patterns(&image);
            let at = |x: i64, y: i64| {
                values[y.clamp(0, height as i64 - 1) as usize * width + x.clamp(0, width as i64 - 1) as usize]
            };
            for y in 0..height as i64 {
                for x in 0..width as i64 {
                    let patch = [-1, 0, 1].map(|dy| [-1, 0, 1].map(|dx| at(x + dx, y + dy)));
                    let (code, contrast) = reference_pattern(patch);
                    let i = y as usize * width + x as usize;
                    prop_assert_eq!(codes[i], code);
                    prop_assert!((f64::from(contrasts[i]) / 840.0 - contrast).abs() < 1e-9);
                }
            }
        }
    }

    /// scikit-image numbers bits counter-clockwise from the right neighbour and interpolates the diagonals; the four
    /// horizontal and vertical neighbours are the same pixels in both.
    #[test]
    #[expect(clippy::disallowed_methods, reason = "a test reads its reference")]
    fn straight_neighbours_agree_with_scikit_image() {
        let Some(data) = rcs_testkit::data_dir() else { return };
        let text = std::fs::read_to_string(data.join("texture-lbp/lbp_reference.json")).unwrap();
        let numbers = |key: &str| -> Vec<u8> {
            let from = &text[text.find(&format!("\"{key}\"")).unwrap()..];
            let from = &from[from.find('[').unwrap()..];
            let end = from.find("]\n]").or_else(|| from.find("]]")).unwrap();
            let numbers = from[..end].split(|c: char| !c.is_ascii_digit());
            numbers.filter(|number| !number.is_empty()).map(|number| number.parse().unwrap()).collect()
        };
        let (image, theirs) = (numbers("image6x6"), numbers("default"));
        assert_eq!((image.len(), theirs.len()), (36, 36));
        let (codes, _) = patterns(&grey_image(&image, 6));
        for y in 1..5 {
            for x in 1..5 {
                let i = y * 6 + x;
                // Ours: above 1, right 3, below 5, left 7. Theirs: right 0, above 2, left 4, below 6.
                for (ours, bit) in [(3, 0), (1, 2), (7, 4), (5, 6)] {
                    assert_eq!(codes[i] >> ours & 1, theirs[i] >> bit & 1, "pixel {x}, {y}, bit {bit}");
                }
            }
        }
    }

    #[test]
    fn the_texture_of_grass_fills_all_bins() {
        let Some(data) = rcs_testkit::data_dir() else { return };
        let grass = image::open(data.join("texture-lbp/grass.png")).unwrap().to_luma8();
        let (codes, contrasts) = patterns(&grey_image(grass.as_raw(), grass.width() as usize));
        let mut bins = [0_usize; 8];
        for code in &codes {
            bins[usize::from(code >> 5)] += 1;
        }
        let least = *bins.iter().min().unwrap() as f64 / codes.len() as f64;
        assert!(least > 0.02, "{bins:?}");
        let mean = contrasts.iter().map(|&c| f64::from(c)).sum::<f64>() / 840.0 / contrasts.len() as f64;
        assert!((10.0..60.0).contains(&mean), "mean contrast is {mean}");
    }
}
