//! Hashes of positions, and smooth noise made from them.
//!
//! Nothing here has state: the same seed and position give the same number on every machine.

/// Hash of a position on a lattice.
#[inline]
pub(crate) fn hash2(x: i32, y: i32, seed: u32) -> u32 {
    let mut h = (x as u32).wrapping_mul(0x9E37_79B1) ^ (y as u32).wrapping_mul(0x85EB_CA77) ^ seed;
    h ^= h >> 15;
    h = h.wrapping_mul(0x2C1B_3C6D);
    h ^= h >> 12;
    h = h.wrapping_mul(0x297A_2D39);
    h ^ (h >> 15)
}

/// Hash of a position on a lattice in three dimensions.
#[inline]
pub(crate) fn hash3(x: i32, y: i32, z: i32, seed: u32) -> u32 {
    hash2(x, y, seed ^ (z as u32).wrapping_mul(0xC2B2_AE3D))
}

/// In [0, 1).
#[inline]
pub(crate) fn unit(h: u32) -> f32 {
    (h >> 8) as f32 * (1.0 / 16_777_216.0)
}

/// In [−1, 1).
pub(crate) fn signed(h: u32) -> f32 {
    2.0 * unit(h) - 1.0
}

/// Pseudo-random numbers drawn in sequence from a seed.
pub(crate) struct Dice {
    seed: u32,
    drawn: i32,
}

impl Dice {
    pub(crate) fn new(seed: u32) -> Dice {
        Dice { seed, drawn: 0 }
    }

    /// In [0, 1).
    pub(crate) fn unit(&mut self) -> f32 {
        self.drawn += 1;
        unit(hash2(self.drawn, 0x51, self.seed))
    }

    /// In [least, largest).
    pub(crate) fn between(&mut self, [least, largest]: [f64; 2]) -> f64 {
        least + (largest - least) * f64::from(self.unit())
    }
}

fn fade(t: f32) -> f32 {
    t * t * t * (t * (t * 6.0 - 15.0) + 10.0)
}

/// Adds value noise of one wavelength to a grid with `width` numbers per row; twice differentiable.
///
/// `wavelength` is in cells; the noise is within ± `amplitude`.
pub(crate) fn add_noise(grid: &mut [f32], width: usize, wavelength: f32, amplitude: f32, seed: u32) {
    // Lattices of different seeds have different nodes.
    let shift = [unit(hash2(1, 2, seed)), unit(hash2(3, 4, seed))];
    let columns: Vec<(usize, f32)> = (0..width)
        .map(|x| {
            let at = x as f32 / wavelength + shift[0];
            (at as usize, fade(at - (at as usize) as f32))
        })
        .collect();
    let nodes = columns.last().map_or(0, |last| last.0 + 2);
    let mut row_nodes = vec![0.0; nodes];
    for (y, row) in grid.chunks_exact_mut(width).enumerate() {
        let at = y as f32 / wavelength + shift[1];
        let (iy, fy) = (at as i32, fade(at - (at as i32) as f32));
        for (ix, node) in row_nodes.iter_mut().enumerate() {
            let low = signed(hash2(ix as i32, iy, seed));
            let high = signed(hash2(ix as i32, iy + 1, seed));
            *node = amplitude * (low + (high - low) * fy);
        }
        for (value, &(ix, fx)) in row.iter_mut().zip(&columns) {
            let (low, high) = (row_nodes[ix], row_nodes[ix + 1]);
            *value += low + (high - low) * fx;
        }
    }
}

/// Value noise at one position, within ±1; `at` in wavelengths.
pub(crate) fn noise_at(x: f64, y: f64, seed: u32) -> f64 {
    let (ix, iy) = (x.floor(), y.floor());
    let (fx, fy) = (f64::from(fade((x - ix) as f32)), f64::from(fade((y - iy) as f32)));
    let node = |dx: i32, dy: i32| f64::from(signed(hash2(ix as i32 + dx, iy as i32 + dy, seed)));
    let low = node(0, 0) + (node(1, 0) - node(0, 0)) * fx;
    let high = node(0, 1) + (node(1, 1) - node(0, 1)) * fx;
    low + (high - low) * fy
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hashes_are_spread_evenly() {
        let mut bins = [0_u32; 16];
        for x in 0..64 {
            for y in 0..64 {
                bins[(hash2(x, y, 9) >> 28) as usize] += 1;
            }
        }
        assert!(bins.iter().all(|&count| (180..340).contains(&count)), "{bins:?}");
    }

    #[test]
    fn noise_is_within_its_amplitude_and_smooth() {
        let mut grid = vec![0.0; 200 * 50];
        add_noise(&mut grid, 200, 10.0, 0.5, 3);
        assert!(grid.iter().all(|v| v.abs() <= 0.5));
        let step = grid.windows(2).take(199).map(|w| (w[1] - w[0]).abs()).fold(0.0, f32::max);
        // The greatest slope of a fade is 15/8 of the step between nodes, which is at most twice the amplitude.
        assert!(step <= 15.0 / 8.0 / 10.0 && step > 0.0, "{step}");
    }
}
