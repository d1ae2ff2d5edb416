//! One labelled frame: assigns points to cells (Albus 2006a, 3.2, steps 2 and 3).
//!
//! A pixel is used if it is labelled `GROUND` or `OBSTACLE`, has a depth within the learning range, and lies within the
//! map, at any height.

use crate::appearance::{BINS, HISTOGRAMS, Histograms, PixelCodes, RatioBins};
use crate::models::{Heights, Terrain};
use crate::texture::PaddedGrey;
use glam::{DMat3, DVec2, DVec3};
use rcs_geom::{PinholeCamera, Pose};
use rcs_sense::ObstacleLabel;

/// Number of rows that are processed together.
pub const STRIP_ROWS: usize = 32;
/// Label of ground in label images.
pub const GROUND: u8 = ObstacleLabel::Ground.code();
/// Label of obstacles in label images.
pub const OBSTACLE: u8 = ObstacleLabel::Obstacle.code();

/// The ray of every pixel of a camera, with z = 1 in the optical frame; computed once per calibration.
#[derive(Clone, Debug, PartialEq)]
pub struct Rays {
    width: usize,
    height: usize,
    /// x and y in row order; NaN where the lens model has no ray.
    xy: Vec<[f64; 2]>,
}

impl Rays {
    /// Computes the rays of a camera.
    pub fn new(camera: &PinholeCamera) -> Rays {
        let (width, height) = (camera.width as usize, camera.height as usize);
        let ray = |row: usize, column: usize| {
            let ray = camera.unproject(DVec2::new(column as f64, row as f64));
            ray.map_or([f64::NAN; 2], |ray| [ray.x, ray.y])
        };
        let xy = (0..height).flat_map(|row| (0..width).map(move |column| ray(row, column))).collect();
        Rays { width, height, xy }
    }

    /// Width and height of the camera's images, pixels.
    pub fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }
}

/// A frame of one camera; all images have the rays' size.
#[derive(Clone, Copy, Debug)]
pub struct LabelledFrame<'a> {
    /// Colours, three bytes per pixel in row order.
    pub rgb: &'a [u8],
    /// The same image in grey.
    pub grey: &'a PaddedGrey,
    /// Labels, one byte per pixel.
    pub labels: &'a [u8],
    /// Depth along the optical axis, m; not finite or not positive where unknown.
    pub depth_m: &'a [f32],
    /// Rays of the camera.
    pub rays: &'a Rays,
    /// Pose of the camera in the local frame.
    pub local_from_camera: Pose,
}

/// The cells to which points are assigned: a square window of the local frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Window {
    /// South-west corner, local frame, m.
    pub corner_m: DVec2,
    /// Size of a cell, m.
    pub cell_size_m: f64,
    /// Cells per side.
    pub side: usize,
}

/// Points of some rows, by cell.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Gathered {
    /// Cells in the order of their first point: index in row order from the south-west corner, and the sums of its
    /// points.
    pub cells: Vec<(u32, Terrain)>,
    /// 1 where a pixel was used as ground, 2 as obstacle, 0 elsewhere; in row order.
    pub used: Vec<u8>,
}

/// Number of strips of an image.
pub fn strips(height: usize) -> usize {
    height.div_ceil(STRIP_ROWS)
}

/// Assigns the points of one strip of rows to cells.
///
/// # Panics
/// If the images of the frame do not have the size of the rays.
pub fn gather(
    frame: &LabelledFrame<'_>,
    strip: usize,
    window: &Window,
    max_range_m: f32,
    ratios: &RatioBins,
) -> Gathered {
    let [width, height] = frame.rays.size();
    let rows = strip * STRIP_ROWS..((strip + 1) * STRIP_ROWS).min(height);
    let pixels = rows.start * width..rows.end * width;
    let (labels, depths) = (&frame.labels[pixels.clone()], &frame.depth_m[pixels.clone()]);
    let rays = &frame.rays.xy[pixels];
    let is_used =
        |label: u8, depth: f32| (label == GROUND || label == OBSTACLE) && depth > 0.0 && depth <= max_range_m;
    let mut used: Vec<u8> =
        labels.iter().zip(depths).map(|(&label, &depth)| label * u8::from(is_used(label, depth))).collect();
    // Sky and distant areas fill whole strips, whose patterns are not needed.
    if used.iter().all(|&label| label == 0) {
        return Gathered { cells: Vec::new(), used };
    }
    let codes = PixelCodes::of_rows(frame.rgb, frame.grey, rows, ratios);
    let grid = CellGrid::new(&frame.local_from_camera, window);
    let mut sums = Sums::new(window.side);
    let (mut places, mut heights_mm) = (vec![NOWHERE; width], vec![0; width]);
    for (row, used) in used.chunks_exact_mut(width).enumerate() {
        let pixels = row * width..(row + 1) * width;
        grid.places(&rays[pixels.clone()], &depths[pixels.clone()], &mut places);
        grid.heights(&rays[pixels.clone()], &depths[pixels.clone()], &mut heights_mm);
        let codes = codes.codes[pixels.clone()].iter().zip(&codes.contrasts[pixels]);
        let places = places.iter().zip(&heights_mm);
        for ((used, (&place, &height_mm)), (&code, &contrast)) in used.iter_mut().zip(places).zip(codes) {
            if *used == 0 {
                continue;
            }
            if place == NOWHERE {
                *used = 0;
            } else {
                sums.add(place, height_mm, *used, code, contrast);
            }
        }
    }
    Gathered { cells: sums.finish(), used }
}

/// Merges the cells of all strips, sorted by index.
pub fn join(strips: &[Gathered], side: usize) -> Vec<(u32, Terrain)> {
    let mut slots = vec![u32::MAX; side * side];
    let mut cells: Vec<(u32, Terrain)> = Vec::with_capacity(strips.iter().map(|s| s.cells.len()).sum());
    for (place, terrain) in strips.iter().flat_map(|strip| &strip.cells) {
        let slot = &mut slots[*place as usize];
        if *slot == u32::MAX {
            *slot = cells.len() as u32;
            cells.push((*place, *terrain));
        } else {
            cells[*slot as usize].1.merge(terrain);
        }
    }
    // Sorted by index rather than by strip, so that the result does not depend on the strip boundaries.
    cells.sort_unstable_by_key(|(place, _)| *place);
    cells
}

/// Where the used pixels of a cell are in the image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Spot {
    /// Mean column and row.
    pub middle: [usize; 2],
    /// Columns or rows that they extend over, whichever are more.
    pub side: usize,
}

/// Finds the used pixels of some cells, which are given by their indices; `None` for a cell without any. `strips` are
/// the results of [`gather`] for the whole frame. Cost: as [`gather`] without its histograms.
pub fn spots(
    rays: &Rays,
    depth_m: &[f32],
    local_from_camera: &Pose,
    window: &Window,
    strips: &[Gathered],
    cells: &[u32],
) -> Vec<Option<Spot>> {
    #[derive(Clone, Copy)]
    struct Extent {
        sum: [usize; 2],
        pixels: usize,
        low: [usize; 2],
        high: [usize; 2],
    }
    let width = rays.width;
    let grid = CellGrid::new(local_from_camera, window);
    let mut slots = vec![u32::MAX; window.side * window.side];
    for (slot, cell) in (0..).zip(cells) {
        if let Some(place) = slots.get_mut(*cell as usize) {
            *place = slot;
        }
    }
    let mut extents =
        vec![Extent { sum: [0; 2], pixels: 0, low: [usize::MAX; 2], high: [0; 2] }; cells.len()];
    let mut places = vec![NOWHERE; width];
    let used = strips.iter().flat_map(|strip| strip.used.chunks_exact(width.max(1)));
    for (row, used) in used.enumerate() {
        if used.iter().all(|&label| label == 0) {
            continue;
        }
        let pixels = row * width..(row + 1) * width;
        grid.places(&rays.xy[pixels.clone()], &depth_m[pixels], &mut places);
        for (column, (_, &place)) in used.iter().zip(&places).enumerate().filter(|(_, (used, _))| **used != 0)
        {
            let slot = slots.get(place as usize).copied().unwrap_or(u32::MAX);
            let Some(found) = extents.get_mut(slot as usize) else { continue };
            found.pixels += 1;
            for (axis, at) in [column, row].into_iter().enumerate() {
                found.sum[axis] += at;
                found.low[axis] = found.low[axis].min(at);
                found.high[axis] = found.high[axis].max(at);
            }
        }
    }
    let spot = |found: &Extent| {
        let side = |axis: usize| found.high[axis] + 1 - found.low[axis];
        (found.pixels > 0)
            .then(|| Spot { middle: found.sum.map(|sum| sum / found.pixels), side: side(0).max(side(1)) })
    };
    extents.iter().map(spot).collect()
}

/// Converts a ray and a depth to a cell and a height: rows of the camera's rotation and its position, in cells from the
/// corner, and in mm.
struct CellGrid {
    x: [f64; 3],
    y: [f64; 3],
    z: [f64; 3],
    camera: [f64; 3],
    side: usize,
}

impl CellGrid {
    fn new(local_from_camera: &Pose, window: &Window) -> CellGrid {
        let scale = 1.0 / window.cell_size_m;
        let turn: DMat3 = local_from_camera.rotation_matrix();
        let row = |axis: DVec3, scale: f64| (turn.transpose() * axis * scale).to_array();
        let camera = (local_from_camera.translation.truncate() - window.corner_m) * scale;
        CellGrid {
            x: row(DVec3::X, scale),
            y: row(DVec3::Y, scale),
            z: row(DVec3::Z, MM),
            camera: camera.extend(local_from_camera.translation.z * MM).to_array(),
            side: window.side,
        }
    }

    /// Cell indices of consecutive pixels; [`NOWHERE`] outside of the window. Without branches, so that the compiler
    /// vectorizes it.
    fn places(&self, rays: &[[f64; 2]], depths_m: &[f32], places: &mut [u32]) {
        let limit = self.side as f64;
        for ((place, &[x, y]), &depth_m) in places.iter_mut().zip(rays).zip(depths_m) {
            let depth = f64::from(depth_m);
            let along = |row: &[f64; 3], camera: f64| (row[0] * x + row[1] * y + row[2]) * depth + camera;
            let (column, row) = (along(&self.x, self.camera[0]), along(&self.y, self.camera[1]));
            // NaN, for a pixel without a ray, fails all comparisons.
            let inside = column >= 0.0 && column < limit && row >= 0.0 && row < limit;
            // Wraps outside of the window: the index of a distant point does not fit in 32 bits, and is not used.
            let at = (row as i32).wrapping_mul(self.side as i32).wrapping_add(column as i32);
            *place = if inside { at as u32 } else { NOWHERE };
        }
    }

    /// Heights of consecutive pixels in the local frame, mm; those without a place have none that means anything.
    fn heights(&self, rays: &[[f64; 2]], depths_m: &[f32], heights_mm: &mut [i32]) {
        for ((height_mm, &[x, y]), &depth_m) in heights_mm.iter_mut().zip(rays).zip(depths_m) {
            let along = self.z[0] * x + self.z[1] * y + self.z[2];
            *height_mm = (along * f64::from(depth_m) + self.camera[2]) as i32;
        }
    }
}

/// Millimetres per metre.
const MM: f64 = 1000.0;

/// Cell index of a pixel outside of the window.
const NOWHERE: u32 = u32::MAX;

/// Sums of the cells of one strip. Counts of one strip fit in 32 bits, and the small table stays in the cache.
struct Sums {
    /// Index of a cell's sum, by cell index.
    slots: Vec<u32>,
    places: Vec<u32>,
    cells: Vec<Sum>,
}

#[derive(Clone, Copy)]
struct Sum {
    bins: [[u32; BINS]; HISTOGRAMS],
    ground: u32,
    obstacle: u32,
    contrast: u64,
    lowest_mm: i32,
    /// Below all heights without an obstacle.
    obstacle_top_mm: i32,
}

impl Sum {
    const NONE: Sum = Sum {
        bins: [[0; BINS]; HISTOGRAMS],
        ground: 0,
        obstacle: 0,
        contrast: 0,
        lowest_mm: i32::MAX,
        obstacle_top_mm: i32::MIN,
    };
}

impl Sums {
    fn new(side: usize) -> Sums {
        Sums { slots: vec![NOWHERE; side * side], places: Vec::new(), cells: Vec::new() }
    }

    #[inline]
    fn add(&mut self, place: u32, height_mm: i32, label: u8, code: u16, contrast: u32) {
        let slot = &mut self.slots[place as usize];
        if *slot == NOWHERE {
            *slot = self.cells.len() as u32;
            self.places.push(place);
            self.cells.push(Sum::NONE);
        }
        let sum = &mut self.cells[*slot as usize];
        for (i, histogram) in sum.bins.iter_mut().enumerate() {
            histogram[usize::from(code >> (3 * i) & 7)] += 1;
        }
        sum.contrast += u64::from(contrast);
        sum.ground += u32::from(label == GROUND);
        sum.obstacle += u32::from(label == OBSTACLE);
        sum.lowest_mm = sum.lowest_mm.min(height_mm);
        sum.obstacle_top_mm = sum.obstacle_top_mm.max(if label == OBSTACLE { height_mm } else { i32::MIN });
    }

    fn finish(self) -> Vec<(u32, Terrain)> {
        let terrain = |sum: &Sum| Terrain {
            histograms: Histograms {
                bins: sum.bins.map(|histogram| histogram.map(u64::from)),
                contrast_sum: sum.contrast,
            },
            ground: u64::from(sum.ground),
            obstacle: u64::from(sum.obstacle),
            heights: Heights {
                lowest_mm: Some(sum.lowest_mm),
                obstacle_top_mm: (sum.obstacle > 0).then_some(sum.obstacle_top_mm),
            },
            ..Terrain::default()
        };
        self.places.into_iter().zip(self.cells.iter().map(terrain)).collect()
    }
}

#[cfg(test)]
#[path = "frame_tests.rs"]
mod tests;
