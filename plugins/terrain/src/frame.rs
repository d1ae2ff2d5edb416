//! One labelled frame: which points go into which cells (A 3.2, steps 2 and 3).
//!
//! A pixel counts where it is labelled `GROUND` or `OBSTACLE`, has a depth within the range that is learned from, and
//! lies within the map; its height does not matter.

use crate::appearance::{PixelCodes, RatioBins};
use crate::models::Terrain;
use crate::texture::PaddedGrey;
use glam::{DMat3, DVec2, DVec3};
use rcs_geom::{PinholeCamera, Pose};

/// Rows that are worked on together.
pub const STRIP_ROWS: usize = 32;
/// Label of ground in label images.
pub const GROUND: u8 = 1;
/// Label of obstacles in label images.
pub const OBSTACLE: u8 = 2;

/// The ray of every pixel of a camera, with z = 1 in the optical frame: made once for a calibration.
#[derive(Clone, Debug, PartialEq)]
pub struct Rays {
    width: usize,
    height: usize,
    /// x and y by rows; NaN where the lens has no ray.
    xy: Vec<[f64; 2]>,
}

impl Rays {
    /// Rays of a camera.
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

/// A frame of one eye; all images have the rays' size.
#[derive(Clone, Copy, Debug)]
pub struct LabelledFrame<'a> {
    /// Colours, three bytes a pixel by rows.
    pub rgb: &'a [u8],
    /// The same, grey.
    pub grey: &'a PaddedGrey,
    /// One label a pixel.
    pub labels: &'a [u8],
    /// Depth along the optical axis, m; not finite or not above 0 where there is none.
    pub depth_m: &'a [f32],
    /// Rays of its camera.
    pub rays: &'a Rays,
    /// Where the camera was.
    pub local_from_camera: Pose,
}

/// The cells that points are sorted into: a square window of the local frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Window {
    /// South-west corner, local frame, m.
    pub corner_m: DVec2,
    /// Side of a cell, m.
    pub cell_size_m: f64,
    /// Cells a side.
    pub side: usize,
}

/// What the points of some rows say of the cells.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Gathered {
    /// Cells in the order in which they were first met: place by rows from the south-west corner, and its points.
    pub cells: Vec<(u32, Terrain)>,
    /// 1 where a pixel was used as ground, 2 as an obstacle, 0 elsewhere; by rows.
    pub used: Vec<u8>,
}

/// Strips of rows of an image.
pub fn strips(height: usize) -> usize {
    height.div_ceil(STRIP_ROWS)
}

/// Sorts the points of one strip of rows.
///
/// # Panics
/// Where the images of the frame do not have the rays' size.
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
    let mut gathered = Gathered { cells: Vec::new(), used: vec![0; labels.len()] };
    // Sky and what is far fill whole strips: their patterns are not needed.
    if !labels.iter().zip(depths).any(|(&label, &depth)| is_used(label, depth)) {
        return gathered;
    }
    let codes = PixelCodes::of_rows(frame.rgb, frame.grey, rows, ratios);
    let grid = CellGrid::new(frame, window);
    let mut slots = vec![u32::MAX; window.side * window.side];
    for (i, ((&label, &depth), ray)) in labels.iter().zip(depths).zip(rays).enumerate() {
        if !is_used(label, depth) {
            continue;
        }
        let Some(place) = grid.place(ray, depth) else { continue };
        if slots[place] == u32::MAX {
            slots[place] = gathered.cells.len() as u32;
            gathered.cells.push((place as u32, Terrain::default()));
        }
        let terrain = &mut gathered.cells[slots[place] as usize].1;
        terrain.histograms.add(codes.codes[i], codes.contrasts[i]);
        terrain.ground += u64::from(label == GROUND);
        terrain.obstacle += u64::from(label == OBSTACLE);
        gathered.used[i] = label;
    }
    gathered
}

/// Cells of all strips, by place.
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
    // Cells by place, not by strip: what is learned does not depend on where the strips are cut.
    cells.sort_unstable_by_key(|(place, _)| *place);
    cells
}

/// From a ray and a depth to a cell: rows of the camera's turn and its place, in cells from the corner.
struct CellGrid {
    x: [f64; 3],
    y: [f64; 3],
    camera: [f64; 2],
    side: usize,
}

impl CellGrid {
    fn new(frame: &LabelledFrame<'_>, window: &Window) -> CellGrid {
        let scale = 1.0 / window.cell_size_m;
        let turn: DMat3 = frame.local_from_camera.rotation_matrix();
        let row = |axis: DVec3| (turn.transpose() * axis * scale).to_array();
        let camera = (frame.local_from_camera.translation.truncate() - window.corner_m) * scale;
        CellGrid { x: row(DVec3::X), y: row(DVec3::Y), camera: camera.to_array(), side: window.side }
    }

    #[inline]
    fn place(&self, &[x, y]: &[f64; 2], depth_m: f32) -> Option<usize> {
        let depth = f64::from(depth_m);
        let along = |row: &[f64; 3], camera: f64| (row[0] * x + row[1] * y + row[2]) * depth + camera;
        let (column, row) = (along(&self.x, self.camera[0]), along(&self.y, self.camera[1]));
        let limit = self.side as f64;
        // NaN, of a pixel without a ray, is on neither side.
        let inside = (0.0..limit).contains(&column) && (0.0..limit).contains(&row);
        inside.then(|| row as usize * self.side + column as usize)
    }
}

#[cfg(test)]
#[path = "frame_tests.rs"]
mod tests;
