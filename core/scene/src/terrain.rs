//! Converts the terrain and paint of a world file to heights and surfaces on a lattice.

use rcs_geom::DVec2;

use crate::class::Surface;
use crate::noise::{add_noise, hash2, noise_at};
use crate::region::closest_on_path;
use crate::spec::WorldSpec;

/// Distance between the samples of the lattice, m.
pub(crate) const CELL_M: f64 = 0.1;
/// Cells per side of a tile.
pub(crate) const TILE: usize = 8;
/// Cells per side of a block, which is 8 by 8 tiles.
pub(crate) const BLOCK: usize = 64;
/// Width of the margin in which a world falls to height 0, the height of the plain outside, m.
const BORDER_M: f64 = 6.0;

/// Samples of the ground, the first at the lower left corner of the bounds.
///
/// The lattice is padded to complete blocks; beyond the bounds it has flat ground of height 0.
pub(crate) struct Lattice {
    /// Cells along x and y, multiples of [`BLOCK`].
    pub(crate) cells: [usize; 2],
    /// Samples per row: one more than cells.
    pub(crate) width: usize,
    /// Heights of the samples, m.
    pub(crate) z: Vec<f32>,
    /// Codes of the surfaces at the samples.
    pub(crate) surface: Vec<u8>,
}

fn smooth(t: f64) -> f64 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

impl Lattice {
    pub(crate) fn build(spec: &WorldSpec) -> Lattice {
        let [low, high] = spec.bounds_m;
        let size = high - low;
        let cells = [size.x, size.y].map(|side| ((side / CELL_M).ceil() as usize).div_ceil(BLOCK) * BLOCK);
        let width = cells[0] + 1;
        let mut lattice = Lattice {
            cells,
            width,
            z: vec![0.0; width * (cells[1] + 1)],
            surface: vec![spec.base as u8; width * (cells[1] + 1)],
        };
        for (number, undulation) in spec.undulations.iter().enumerate() {
            let seed = hash2(number as i32, 0x7E44, spec.seed);
            let wavelength = (undulation.wavelength_m / CELL_M) as f32;
            add_noise(&mut lattice.z, width, wavelength, undulation.amplitude_m as f32, seed);
        }
        lattice.shape(spec);
        lattice.lower_borders(size);
        lattice.paint(spec);
        lattice
    }

    /// Changes the heights within a rectangle, m: `change(position, height)`.
    fn each(&mut self, low: DVec2, extent: [DVec2; 2], mut change: impl FnMut(DVec2, &mut f32)) {
        let index = |value: f64, most: usize| ((value / CELL_M).max(0.0) as usize).min(most);
        let [from, to] = extent.map(|corner| corner - low);
        let rows = index(from.y, self.cells[1])..=index(to.y + CELL_M, self.cells[1]);
        let columns = index(from.x, self.cells[0])..=index(to.x + CELL_M, self.cells[0]);
        for row in rows {
            for column in columns.clone() {
                let at = low + DVec2::new(column as f64, row as f64) * CELL_M;
                change(at, &mut self.z[row * self.width + column]);
            }
        }
    }

    fn shape(&mut self, spec: &WorldSpec) {
        let low = spec.bounds_m[0];
        for hill in &spec.hills {
            let reach = DVec2::splat(hill.radius_m[0].max(hill.radius_m[1]));
            let axis = DVec2::new(libm::cos(hill.yaw_rad), libm::sin(hill.yaw_rad));
            self.each(low, [hill.centre - reach, hill.centre + reach], |at, z| {
                let offset = at - hill.centre;
                let [u, v] = [axis.dot(offset) / hill.radius_m[0], axis.perp_dot(offset) / hill.radius_m[1]];
                let inside = (1.0 - u * u - v * v).max(0.0);
                *z += (hill.height_m * inside * inside) as f32;
            });
        }
        for slope in &spec.slopes {
            let along = slope.to - slope.from;
            let scale = 1.0 / along.length_squared();
            self.each(low, spec.bounds_m, |at, z| {
                *z += (slope.rise_m * smooth((at - slope.from).dot(along) * scale)) as f32;
            });
        }
        for ledge in &spec.ledges {
            let reach = ledge.fade_m + ledge.run_m;
            self.each(low, around(&ledge.path, reach), |at, z| {
                let closest = closest_on_path(&ledge.path, at);
                let step = (closest.side_m / ledge.run_m + 0.5).clamp(0.0, 1.0);
                let left = 1.0 - smooth(closest.distance_m / ledge.fade_m);
                *z += (ledge.height_m * step * left) as f32;
            });
        }
        for ditch in &spec.ditches {
            self.each(low, around(&ditch.path, ditch.half_width_m), |at, z| {
                let inside = ditch.half_width_m - closest_on_path(&ditch.path, at).distance_m;
                *z -= (ditch.depth_m * (inside / ditch.bank_m).clamp(0.0, 1.0)) as f32;
            });
        }
    }

    fn lower_borders(&mut self, size: DVec2) {
        let share = |at: usize, side: f64| {
            let along = at as f64 * CELL_M;
            smooth(along.min(side - along) / BORDER_M) as f32
        };
        let columns: Vec<f32> = (0..self.width).map(|column| share(column, size.x)).collect();
        for (row, heights) in self.z.chunks_exact_mut(self.width).enumerate() {
            let across = share(row, size.y);
            for (z, along) in heights.iter_mut().zip(&columns) {
                *z *= along * across;
            }
        }
    }

    /// Paints the regions in order, one over the other. Tiles that lie completely inside or outside of a region are
    /// decided as a whole.
    fn paint(&mut self, spec: &WorldSpec) {
        let low = spec.bounds_m[0];
        let half_diagonal = CELL_M * TILE as f64 * std::f64::consts::FRAC_1_SQRT_2;
        for (number, paint) in spec.paints.iter().enumerate() {
            let seed = hash2(number as i32, 0x9A17, spec.seed);
            let [from, to] = paint.region.extent().map(|corner| corner - low);
            let tile_m = CELL_M * TILE as f64;
            let index = |value: f64, most: usize| ((value / tile_m).max(0.0) as usize).min(most);
            let most = self.cells.map(|cells| cells / TILE);
            for row in index(from.y - paint.edge_m, most[1])..=index(to.y + paint.edge_m, most[1]) {
                for column in index(from.x - paint.edge_m, most[0])..=index(to.x + paint.edge_m, most[0]) {
                    let middle = low + (DVec2::new(column as f64, row as f64) + 0.5) * tile_m;
                    let distance = paint.region.distance_m(middle);
                    if distance > half_diagonal + paint.edge_m {
                        continue;
                    }
                    let whole = distance < -half_diagonal - paint.edge_m;
                    self.paint_tile(
                        [column, row],
                        paint.surface,
                        |at| whole || paint.region.distance_m(at) < wander(at, seed) * paint.edge_m,
                        low,
                    );
                }
            }
        }
    }

    fn paint_tile(
        &mut self,
        tile: [usize; 2],
        surface: Surface,
        painted: impl Fn(DVec2) -> bool,
        low: DVec2,
    ) {
        let [columns, rows] = [0, 1].map(|axis| {
            let first = tile[axis] * TILE;
            first..(first + TILE).min(self.cells[axis] + 1)
        });
        for row in rows {
            for column in columns.clone() {
                let at = low + DVec2::new(column as f64, row as f64) * CELL_M;
                if painted(at) {
                    self.surface[row * self.width + column] = surface as u8;
                }
            }
        }
    }

    /// The cell at a position (in cells from the first sample), and the position within it.
    pub(crate) fn cell(&self, u: f64, v: f64) -> ([usize; 2], [f64; 2]) {
        let place = |value: f64, cells: usize| {
            let value = value.clamp(0.0, cells as f64);
            let cell = (value as usize).min(cells - 1);
            (cell, value - cell as f64)
        };
        let ((i, fu), (j, fv)) = (place(u, self.cells[0]), place(v, self.cells[1]));
        ([i, j], [fu, fv])
    }

    /// Height, and its slope along x and y, at a position in cells from the first sample: bilinear between samples, m.
    pub(crate) fn height(&self, u: f64, v: f64) -> (f64, [f64; 2]) {
        let ([i, j], [fu, fv]) = self.cell(u, v);
        let at = j * self.width + i;
        let z = |at: usize| f64::from(self.z[at]);
        let (a, b, c, d) = (z(at), z(at + 1), z(at + self.width), z(at + self.width + 1));
        let twist = a - b - c + d;
        let height = a + fu * (b - a) + fv * (c - a + fu * twist);
        (height, [(b - a + fv * twist) / CELL_M, (c - a + fu * twist) / CELL_M])
    }

    /// The surface at a position in cells: that of the closest sample.
    pub(crate) fn surface(&self, u: f64, v: f64) -> Surface {
        let ([i, j], [fu, fv]) = self.cell(u, v);
        let at = (j + usize::from(fv >= 0.5)) * self.width + i + usize::from(fu >= 0.5);
        Surface::from_code(self.surface[at])
    }
}

/// Displacement of a painted border, as a fraction of its greatest displacement.
fn wander(at: DVec2, seed: u32) -> f64 {
    0.6 * noise_at(at.x / 0.9, at.y / 0.9, seed) + 0.4 * noise_at(at.x / 0.27, at.y / 0.27, seed ^ 0x55)
}

fn around(path: &[DVec2], reach: f64) -> [DVec2; 2] {
    let low = path.iter().copied().fold(DVec2::splat(f64::INFINITY), DVec2::min);
    let high = path.iter().copied().fold(DVec2::splat(f64::NEG_INFINITY), DVec2::max);
    [low - reach, high + reach]
}
