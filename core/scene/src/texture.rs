//! Textures: packed texels with mip levels, and the seeded noise that fills them.

use crate::noise::{Dice, add_noise, hash2, unit};
use crate::surface::Material;

/// Texels as packed r, g, b, a (r in the low byte), with mip levels of half the size each.
pub(crate) struct Texture {
    levels: Vec<Level>,
}

struct Level {
    width: u32,
    height: u32,
    /// Texels of this level per texel of the first.
    scale: f32,
    texels: Vec<u32>,
}

/// Texels per side of a tile: a power of two, so that wrapping is a mask.
pub(crate) const TILE_TEXELS: usize = 512;
/// Side of one texel of a tile, m.
pub(crate) const TEXEL_M: f32 = 0.01;
/// In a tile of ratios this value means 1.
pub(crate) const ONE: f32 = 128.0;

/// Blends two packed texels: 0 is all `a`, 256 all `b`.
#[inline]
fn mix(a: u32, b: u32, part: u32) -> u32 {
    const EVEN: u32 = 0x00FF_00FF;
    let rest = 256 - part;
    let low = (((a & EVEN) * rest + (b & EVEN) * part) >> 8) & EVEN;
    let high = (((a >> 8) & EVEN) * rest + ((b >> 8) & EVEN) * part) & !EVEN;
    low | high
}

/// The channels as numbers.
#[inline]
pub(crate) fn channels(texel: u32) -> [f32; 4] {
    [(texel & 255) as f32, ((texel >> 8) & 255) as f32, ((texel >> 16) & 255) as f32, (texel >> 24) as f32]
}

pub(crate) fn packed(rgba: [f32; 4]) -> u32 {
    let [r, g, b, a] = rgba.map(|v| v.clamp(0.0, 255.0) as u32);
    r | g << 8 | b << 16 | a << 24
}

impl Texture {
    pub(crate) fn new(width: usize, texels: Vec<u32>) -> Texture {
        let height = texels.len() / width;
        let mut levels = vec![Level { width: width as u32, height: height as u32, scale: 1.0, texels }];
        while levels.last().is_some_and(|level| level.width > 1 || level.height > 1) {
            levels.extend(levels.last().map(Level::halved));
        }
        Texture { levels }
    }

    /// Bilinear in one level, at a position in texels of the first level; clamped to the border.
    #[inline]
    pub(crate) fn clamped(&self, level: usize, u: f32, v: f32) -> u32 {
        let level = &self.levels[level.min(self.levels.len() - 1)];
        let scale = level.scale;
        let place = |value: f32, side: u32| {
            let fixed = (((value + 0.5) * scale - 0.5) * 256.0).max(0.0) as u32;
            let cell = fixed >> 8;
            if cell + 1 < side { (cell, 1, fixed & 255) } else { (side - 1, 0, 0) }
        };
        let ((x, dx, fx), (y, dy, fy)) = (place(u, level.width), place(v, level.height));
        let (at, right) = ((y * level.width + x) as usize, dx as usize);
        let below = &level.texels[at..=at + right];
        let above = at + (dy * level.width) as usize;
        let above = &level.texels[above..=above + right];
        let low = mix(below[0], below[right], fx);
        let high = mix(above[0], above[right], fx);
        mix(low, high, fy)
    }

    /// Bilinear in one level of a repeating tile, at a position of at least 0 in texels of the first level.
    #[inline]
    pub(crate) fn wrapped(&self, level: usize, u: f32, v: f32) -> u32 {
        let level = &self.levels[level.min(self.levels.len() - 1)];
        let scale = 256.0 * level.scale;
        let (u, v) = ((u * scale) as i32 as u32, (v * scale) as i32 as u32);
        let mask = level.width - 1;
        let (x, y) = ((u >> 8) & mask, (v >> 8) & mask);
        let (right, down) = ((x + 1) & mask, (y + 1) & mask);
        let (low, high) = ((y * level.width) as usize, (down * level.width) as usize);
        let (left, right) = (x as usize, right as usize);
        let below = mix(level.texels[low + left], level.texels[low + right], u & 255);
        let above = mix(level.texels[high + left], level.texels[high + right], u & 255);
        mix(below, above, v & 255)
    }
}

impl Level {
    fn halved(&self) -> Level {
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let mut texels = Vec::with_capacity((width * height) as usize);
        for y in 0..height {
            let rows = [2 * y, (2 * y + 1).min(self.height - 1)].map(|y| (y * self.width) as usize);
            for x in 0..width {
                let columns = [2 * x, (2 * x + 1).min(self.width - 1)].map(|x| x as usize);
                let four =
                    [rows[0] + columns[0], rows[0] + columns[1], rows[1] + columns[0], rows[1] + columns[1]];
                texels.push(mean(four.map(|at| self.texels[at])));
            }
        }
        Level { width, height, scale: 0.5 * self.scale, texels }
    }
}

fn mean(four: [u32; 4]) -> u32 {
    const EVEN: u32 = 0x00FF_00FF;
    let low: u32 = four.iter().map(|texel| texel & EVEN).sum::<u32>() + 0x0002_0002;
    let high: u32 = four.iter().map(|texel| (texel >> 8) & EVEN).sum::<u32>() + 0x0002_0002;
    ((low >> 2) & EVEN) | (((high >> 2) & EVEN) << 8)
}

/// The detail of a surface: colour as a ratio to the mean colour of the surface, where [`ONE`] means 1.
///
/// Blades, chips, pebbles and leaves are strokes at random positions, each with a colour between the two of the
/// material.
pub(crate) fn detail(material: &Material, seed: u32) -> Texture {
    let side = TILE_TEXELS as i32;
    let mean = material.mean_colour();
    let specks = &material.specks;
    let colour = |part: f32, brightness: f32| {
        let [a, b] = &material.colours;
        let ratio = [0, 1, 2].map(|c| (a[c] + (b[c] - a[c]) * part) / mean[c] * brightness * ONE);
        packed([ratio[0], ratio[1], ratio[2], 0.0])
    };
    let mut texels: Vec<u32> = (0..side * side)
        .map(|at| {
            let h = hash2(at % side, at / side, seed);
            colour(unit(h), 1.0 - specks.contrast * (0.3 + 0.5 * unit(h.wrapping_mul(0x9E37_79B1))))
        })
        .collect();
    let tile_m2 = (TILE_TEXELS as f32 * TEXEL_M) * (TILE_TEXELS as f32 * TEXEL_M);
    let mut dice = Dice::new(seed ^ 0x5BEC);
    for _ in 0..(specks.per_m2 * tile_m2) as u32 {
        let at = [dice.unit(), dice.unit()].map(|v| v * side as f32);
        // A random direction without a sine: a random point of a square, normalised.
        let way = [2.0 * dice.unit() - 1.0, 2.0 * dice.unit() - 1.0];
        let length = (way[0] * way[0] + way[1] * way[1]).sqrt().max(0.05);
        let way = way.map(|v| v / length);
        let [shortest, longest] = specks.length_m;
        let long = (shortest + (longest - shortest) * dice.unit()) / TEXEL_M;
        let wide = (specks.width_m / TEXEL_M).max(1.0);
        let texel = colour(dice.unit(), 1.0 + specks.contrast * (2.0 * dice.unit() - 1.0));
        for step in 0..long.max(1.0) as i32 {
            for across in 0..wide as i32 {
                let (along, across) = (step as f32, across as f32);
                let x = (at[0] + way[0] * along - way[1] * across) as i32 & (side - 1);
                let y = (at[1] + way[1] * along + way[0] * across) as i32 & (side - 1);
                texels[(y * side + x) as usize] = texel;
            }
        }
    }
    balance(&mut texels);
    Texture::new(TILE_TEXELS, texels)
}

/// Scales each channel so that its mean is [`ONE`].
fn balance(texels: &mut [u32]) {
    let mut sums = [0.0_f64; 3];
    for texel in texels.iter() {
        let [r, g, b, _] = channels(*texel);
        sums = [sums[0] + f64::from(r), sums[1] + f64::from(g), sums[2] + f64::from(b)];
    }
    let scale = sums.map(|sum| ONE / (sum / texels.len() as f64).max(1.0) as f32);
    for texel in texels {
        let [r, g, b, _] = channels(*texel);
        *texel = packed([r * scale[0], g * scale[1], b * scale[2], 0.0]);
    }
}

/// Grey noise at all scales for things and the sky, with mean 128 in every channel.
pub(crate) fn rough(seed: u32) -> Texture {
    let side = 256;
    let mut grid = vec![0.0; side * side];
    for (octave, amplitude) in [(32.0, 26.0), (12.0, 24.0), (5.0, 24.0), (2.0, 30.0)] {
        add_noise(&mut grid, side, octave, amplitude, seed ^ octave as u32);
    }
    let texel = |(at, value): (usize, &f32)| {
        let grain = 40.0 * (unit(hash2(at as i32, 0x6A, seed)) - 0.5);
        packed([128.0 + value + grain; 4])
    };
    Texture::new(side, grid.iter().enumerate().map(texel).collect())
}

/// The level whose texels have about the size of a footprint; both sizes are squared, in the same unit.
#[inline]
pub(crate) fn level_of(footprint2: f32, texel2: f32) -> usize {
    let ratio = footprint2 / texel2;
    // Half of the binary exponent is the integer part of the logarithm of the ratio of sizes.
    let exponent = (ratio.to_bits() >> 23) as i32 - 127;
    (exponent.max(0) >> 1) as usize
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::class::Surface;

    #[test]
    fn mixing_is_linear_in_every_channel() {
        let (a, b) = (packed([10.0, 200.0, 0.0, 255.0]), packed([110.0, 100.0, 255.0, 1.0]));
        assert_eq!((mix(a, b, 0), mix(a, b, 256)), (a, b));
        assert_eq!(channels(mix(a, b, 128)), [60.0, 150.0, 127.0, 128.0]);
        assert_eq!(mean([a, a, b, b]), packed([60.0, 150.0, 128.0, 128.0]));
    }

    #[test]
    fn levels_follow_the_footprint() {
        assert_eq!([0.5_f32, 1.0, 1.9, 2.0, 4.1, 8.0].map(|f| level_of(f * f, 1.0)), [0, 0, 0, 1, 2, 3]);
    }

    #[test]
    fn details_keep_the_mean_colour_and_vary_at_every_level_that_is_near() {
        for surface in Surface::ALL {
            let texture = detail(&Material::default_of(surface), 5);
            let last = texture.levels.last().unwrap().texels[0];
            for channel in channels(last).into_iter().take(3) {
                assert!((channel - ONE).abs() < 6.0, "{surface:?} {channel}");
            }
            for level in &texture.levels[..4] {
                let values: Vec<f32> = level.texels.iter().map(|texel| channels(*texel)[1]).collect();
                let mean = values.iter().sum::<f32>() / values.len() as f32;
                let spread =
                    values.iter().map(|v| (v - mean) * (v - mean)).sum::<f32>() / values.len() as f32;
                assert!(spread.sqrt() > 1.0, "{surface:?} {spread}");
            }
        }
    }
}
