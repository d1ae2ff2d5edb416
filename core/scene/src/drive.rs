//! Ground truth of where a vehicle can drive, in cells of 0.2 m.

use rcs_geom::DVec2;

use crate::class::Surface;
use crate::spec::WorldSpec;
use crate::terrain::{CELL_M, Lattice};
use crate::thing::Thing;

/// Size of a ground truth cell, m.
pub const TRUTH_CELL_M: f64 = 0.2;
/// Samples of the lattice per side of a ground truth cell.
const SAMPLES: usize = 2;
/// Greatest slope that a vehicle can climb, as a tangent over a ground truth cell: 35°.
const STEEP: f64 = 0.7;

/// The blocked cells, and the distance to them.
pub(crate) struct DriveMap {
    pub(crate) size: [usize; 2],
    /// Index of the thing in a cell plus 1; 0 for none.
    pub(crate) thing: Vec<u16>,
    /// Distance from the middle of a cell to that of the nearest blocked cell, m.
    pub(crate) distance_m: Vec<f32>,
}

impl DriveMap {
    pub(crate) fn build(spec: &WorldSpec, lattice: &Lattice, things: &[Thing]) -> DriveMap {
        let low = spec.bounds_m[0];
        let extent = spec.bounds_m[1] - low;
        let size = [extent.x, extent.y].map(|side| (side / TRUTH_CELL_M).ceil() as usize);
        let mut map = DriveMap { size, thing: vec![0; size[0] * size[1]], distance_m: Vec::new() };
        let mut blocked = vec![false; size[0] * size[1]];
        for row in 0..size[1] {
            for column in 0..size[0] {
                let first = [column * SAMPLES, row * SAMPLES];
                let surface =
                    Surface::from_code(lattice.surface[(first[1] + 1) * lattice.width + first[0] + 1]);
                let material = &spec.materials[surface as usize - 1];
                blocked[row * size[0] + column] = !material.passable || is_steep(lattice, first);
            }
        }
        for thing in things {
            let reach = thing.radius_m + TRUTH_CELL_M;
            let middle = thing.position.truncate() - low;
            let index = |value: f64, most: usize| ((value / TRUTH_CELL_M).max(0.0) as usize).min(most);
            for row in index(middle.y - reach, size[1])..index(middle.y + reach + TRUTH_CELL_M, size[1]) {
                for column in
                    index(middle.x - reach, size[0])..index(middle.x + reach + TRUTH_CELL_M, size[0])
                {
                    let at = low + (DVec2::new(column as f64, row as f64) + 0.5) * TRUTH_CELL_M;
                    // A cell counts as covered when a thing covers at least half of it.
                    if thing.outline_distance_m(at) < 0.5 * TRUTH_CELL_M {
                        map.thing[row * size[0] + column] = thing.number as u16 + 1;
                        blocked[row * size[0] + column] = true;
                    }
                }
            }
        }
        map.distance_m = distances(&blocked, size[0]);
        map
    }
}

/// Whether the soil rises too steeply across a cell, along either axis or diagonally.
fn is_steep(lattice: &Lattice, [column, row]: [usize; 2]) -> bool {
    let z = |u: usize, v: usize| f64::from(lattice.z[(row + v) * lattice.width + column + u]);
    let along = (z(SAMPLES, 0) - z(0, 0)).abs().max((z(SAMPLES, SAMPLES) - z(0, SAMPLES)).abs());
    let across = (z(0, SAMPLES) - z(0, 0)).abs().max((z(SAMPLES, SAMPLES) - z(SAMPLES, 0)).abs());
    DVec2::new(along, across).length() > STEEP * SAMPLES as f64 * CELL_M
}

/// Distance of each cell from the nearest blocked one, m: the exact Euclidean distance transform in two passes
/// (Felzenszwalb and Huttenlocher, "Distance transforms of sampled functions", 2012).
fn distances(blocked: &[bool], width: usize) -> Vec<f32> {
    const FAR: f64 = 1e9;
    let height = blocked.len() / width;
    let mut squared: Vec<f64> = blocked.iter().map(|&blocked| if blocked { 0.0 } else { FAR }).collect();
    let mut line = vec![0.0; width.max(height)];
    let mut envelope = Envelope::default();
    for column in 0..width {
        for row in 0..height {
            line[row] = squared[row * width + column];
        }
        envelope.lower(&mut line[..height]);
        for row in 0..height {
            squared[row * width + column] = line[row];
        }
    }
    for row in squared.chunks_exact_mut(width) {
        envelope.lower(row);
    }
    squared.iter().map(|&cells2| (cells2.sqrt() * TRUTH_CELL_M).min(1e3) as f32).collect()
}

/// The lower envelope of parabolas along a line of values.
#[derive(Default)]
struct Envelope {
    /// Vertices of the parabolas of the envelope, and the position from which each of them is the lowest.
    feet: Vec<(usize, f64)>,
    values: Vec<f64>,
}

impl Envelope {
    fn lower(&mut self, line: &mut [f64]) {
        self.values.clear();
        self.values.extend_from_slice(line);
        self.feet.clear();
        for (foot, value) in self.values.iter().enumerate() {
            let mut from = f64::NEG_INFINITY;
            while let Some(&(last, last_from)) = self.feet.last() {
                let (q, p) = (foot as f64, last as f64);
                from = ((value + q * q) - (self.values[last] + p * p)) / (2.0 * (q - p));
                if from > last_from {
                    break;
                }
                self.feet.pop();
                from = f64::NEG_INFINITY;
            }
            self.feet.push((foot, from));
        }
        let mut at = 0;
        for (place, value) in line.iter_mut().enumerate() {
            while at + 1 < self.feet.len() && self.feet[at + 1].1 < place as f64 {
                at += 1;
            }
            let foot = self.feet[at].0;
            let away = place as f64 - foot as f64;
            *value = self.values[foot] + away * away;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::noise::hash2;

    #[test]
    fn distances_equal_brute_force() {
        let (width, height) = (31, 23);
        let blocked: Vec<bool> = (0..width * height).map(|at| hash2(at, 5, 77).is_multiple_of(41)).collect();
        let fast = distances(&blocked, width as usize);
        for y in 0..height {
            for x in 0..width {
                let squared = (0..width * height).filter(|&at| blocked[at as usize]).map(|at| {
                    let (dx, dy) = (at % width - x, at / width - y);
                    dx * dx + dy * dy
                });
                let expected = f64::from(squared.min().unwrap()).sqrt() * TRUTH_CELL_M;
                assert!((f64::from(fast[(y * width + x) as usize]) - expected).abs() < 1e-6);
            }
        }
    }
}
