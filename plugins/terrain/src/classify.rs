//! Classification of image windows by the best matching terrain model (Albus 2006a, 3.3).
//!
//! The windows tile the image; those at the right and lower edges may be smaller. The histograms and contrast of a
//! window are compared with each model, as for a cell in learning. If the best model is near enough, the window gets
//! its obstacle fraction; otherwise the window is unclassified.

use crate::appearance::{Histograms, MatchWeights, PixelCodes, RatioBins, Signature};
use crate::models::{Model, ModelSet};
use crate::texture::PaddedGrey;
use rcs_world::MAX_COST;

/// The division of an image into windows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WindowGrid {
    /// Width and height of the image, pixels.
    pub size: [usize; 2],
    /// Side of a window, pixels.
    pub window_px: usize,
}

impl WindowGrid {
    /// Windows with a side of at least one pixel.
    pub fn new(size: [usize; 2], window_px: usize) -> WindowGrid {
        WindowGrid { size, window_px: window_px.max(1) }
    }

    /// Windows per row.
    pub fn columns(&self) -> usize {
        self.size[0].div_ceil(self.window_px)
    }

    /// Rows of windows.
    pub fn rows(&self) -> usize {
        self.size[1].div_ceil(self.window_px)
    }

    /// First column of a window's pixels, and one past the last.
    pub fn x(&self, column: usize) -> [usize; 2] {
        [column * self.window_px, ((column + 1) * self.window_px).min(self.size[0])]
    }

    /// First row of a window's pixels, and one past the last.
    pub fn y(&self, row: usize) -> [usize; 2] {
        [row * self.window_px, ((row + 1) * self.window_px).min(self.size[1])]
    }
}

/// Class of a window.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Class {
    /// Outside of the region to classify.
    #[default]
    Skipped,
    /// No model is near enough.
    Unclassified,
    /// Traversable.
    Traversable(Match),
    /// Not traversable.
    NotTraversable(Match),
}

/// The model that a window is like.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Match {
    /// Its cost, 0 to 250.
    pub cost: u8,
    /// Its number from 1 in the message of models.
    pub model: u8,
}

impl Class {
    /// Pixel value in the overlay: 0 unknown, 1 traversable, 2 not traversable.
    pub fn pixel(self) -> u8 {
        match self {
            Class::Skipped | Class::Unclassified => 0,
            Class::Traversable(_) => 1,
            Class::NotTraversable(_) => 2,
        }
    }
}

/// The models with which windows are compared.
#[derive(Clone, Debug, PartialEq)]
pub struct Matcher {
    signatures: Vec<Signature>,
    /// Cost and number of each model.
    matches: Vec<Match>,
    weights: MatchWeights,
    /// Maximum distance of a match.
    max_distance: f32,
    /// Costs from this one on are not traversable.
    obstacle_cost: u8,
}

impl Matcher {
    /// Uses the models that have at least `min_points` points. `obstacle_fraction` (0 to 1) is the least one that is
    /// not traversable; `weights` must be normalised.
    pub fn new(
        set: &ModelSet,
        weights: MatchWeights,
        max_distance: f32,
        min_points: u64,
        obstacle_fraction: f64,
    ) -> Matcher {
        let used = |(_, model): &(usize, &Model)| model.terrain.histograms.points() >= min_points;
        let cost = |fraction: f64| (f64::from(MAX_COST) * fraction).round() as u8;
        let (mut signatures, mut matches) = (Vec::new(), Vec::new());
        for (number, model) in set.models.iter().enumerate().filter(used) {
            // Always true: a model comes from a cell with points.
            if let Some(fraction) = model.obstacle_fraction() {
                signatures.push(weights.signature(&model.terrain.histograms));
                let model = u8::try_from(number + 1).unwrap_or(0);
                matches.push(Match { cost: cost(fraction), model });
            }
        }
        let obstacle_cost = cost(obstacle_fraction.clamp(0.0, 1.0));
        Matcher { signatures, matches, weights, max_distance, obstacle_cost }
    }

    /// Number of models.
    pub fn models(&self) -> usize {
        self.matches.len()
    }

    /// Class of an appearance.
    pub fn class(&self, histograms: &Histograms) -> Class {
        match self.weights.signature(histograms).best(&self.signatures) {
            Some((best, distance)) if distance <= self.max_distance => {
                let like = self.matches[best];
                if like.cost >= self.obstacle_cost {
                    Class::NotTraversable(like)
                } else {
                    Class::Traversable(like)
                }
            }
            _ => Class::Unclassified,
        }
    }
}

/// Classifies one row of windows, where `wanted` is true.
///
/// # Panics
/// If the image does not have the grid's size, or `wanted` does not have one entry per window of the row.
pub fn classify_row(
    rgb: &[u8],
    grey: &PaddedGrey,
    ratios: &RatioBins,
    grid: &WindowGrid,
    row: usize,
    wanted: &[bool],
    matcher: &Matcher,
) -> Vec<Class> {
    assert_eq!(wanted.len(), grid.columns(), "windows of a row");
    if !wanted.contains(&true) {
        return vec![Class::Skipped; wanted.len()];
    }
    let [top, bottom] = grid.y(row);
    let codes = PixelCodes::of_rows(rgb, grey, top..bottom, ratios);
    let width = grid.size[0];
    let class = |(column, &is_wanted): (usize, &bool)| {
        if !is_wanted {
            return Class::Skipped;
        }
        let [left, right] = grid.x(column);
        let mut histograms = Histograms::default();
        for row in 0..bottom - top {
            let pixels = row * width + left..row * width + right;
            for (&code, &contrast) in codes.codes[pixels.clone()].iter().zip(&codes.contrasts[pixels]) {
                histograms.add(code, contrast);
            }
        }
        matcher.class(&histograms)
    };
    wanted.iter().enumerate().map(class).collect()
}

/// For each column of windows, the first row of windows, from the top, that is covered by good stereo; the rows below
/// are covered, too. A window is covered if at least half of its pixels have a depth of at most `good_m`.
///
/// # Panics
/// If the depths do not have the grid's size.
pub fn end_of_stereo(depth_m: &[f32], grid: &WindowGrid, good_m: f32) -> Vec<usize> {
    let width = grid.size[0];
    assert_eq!(depth_m.len(), width * grid.size[1], "depths of the image");
    let is_good = |column: usize, row: usize| {
        let ([left, right], [top, bottom]) = (grid.x(column), grid.y(row));
        let good = |y: usize| {
            let depths = &depth_m[y * width + left..y * width + right];
            depths.iter().filter(|&&depth| depth > 0.0 && depth <= good_m).count()
        };
        2 * (top..bottom).map(good).sum::<usize>() >= (right - left) * (bottom - top)
    };
    let end = |column: usize| (0..grid.rows()).find(|&row| is_good(column, row)).unwrap_or(grid.rows());
    (0..grid.columns()).map(end).collect()
}

/// The classes as an image, one byte per pixel.
pub fn overlay(classes: &[Class], grid: &WindowGrid) -> Vec<u8> {
    let [width, height] = grid.size;
    let mut image = Vec::with_capacity(width * height);
    for y in 0..height {
        let row = &classes[y / grid.window_px * grid.columns()..][..grid.columns()];
        for (column, class) in row.iter().enumerate() {
            let [left, right] = grid.x(column);
            image.resize(image.len() + right - left, class.pixel());
        }
    }
    image
}
