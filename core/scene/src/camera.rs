//! The rays of a camera's pixels, computed once, and bundles of them.

use std::ops::Range;

use rcs_geom::{DVec2, PinholeCamera};

use crate::shape::{Vec3, unit_length};

/// Pixels per side of a bundle.
pub(crate) const BUNDLE: usize = 8;
/// Bundles per side of a group.
pub(crate) const GROUP: usize = 4;

/// A cone that contains some rays.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cone {
    /// Unit vector.
    pub(crate) axis: Vec3,
    /// Greatest distance between the end of the axis and that of a ray, both unit vectors.
    pub(crate) spread: f32,
}

/// The ray of every pixel of a camera with its lens distortion, in the optical frame.
#[derive(Clone, Debug)]
pub struct CameraRays {
    width: usize,
    height: usize,
    /// Unit vectors; all zero where the lens has no ray.
    rays: Vec<Vec3>,
    /// Angle that a pixel subtends, rad.
    pub(crate) pixel_rad: f32,
    bundles: Vec<Cone>,
    groups: Vec<Cone>,
}

impl CameraRays {
    /// Computes all rays of a camera.
    pub fn new(camera: &PinholeCamera) -> CameraRays {
        let (width, height) = (camera.width as usize, camera.height as usize);
        let ray = |at: usize| {
            let pixel = DVec2::new((at % width) as f64, (at / width) as f64);
            camera.unproject(pixel).map_or([0.0; 3], |ray| {
                let ray = ray.normalize();
                [ray.x as f32, ray.y as f32, ray.z as f32]
            })
        };
        let rays: Vec<Vec3> = (0..width * height).map(ray).collect();
        let pixel_rad = (1.0 / camera.fx.min(camera.fy)) as f32;
        let mut made = CameraRays { width, height, rays, pixel_rad, bundles: Vec::new(), groups: Vec::new() };
        made.bundles = made.cones(BUNDLE);
        made.groups = made.cones(BUNDLE * GROUP);
        made
    }

    /// Pixels.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Pixels.
    pub fn height(&self) -> usize {
        self.height
    }

    /// The ray of a pixel in the optical frame, a unit vector. `None` outside of the image and where the lens has no
    /// ray.
    pub fn ray(&self, column: usize, row: usize) -> Option<[f32; 3]> {
        if column >= self.width || row >= self.height {
            return None;
        }
        Some(self.at(column, row)).filter(|ray| ray[2] > 0.0)
    }

    #[inline]
    pub(crate) fn at(&self, column: usize, row: usize) -> Vec3 {
        self.rays[row * self.width + column]
    }

    /// The rays of some pixels of a row.
    #[inline]
    pub(crate) fn row(&self, row: usize, columns: &Range<usize>) -> &[Vec3] {
        &self.rays[row * self.width + columns.start..row * self.width + columns.end]
    }

    pub(crate) fn bundles_across(&self) -> usize {
        self.width.div_ceil(BUNDLE)
    }

    pub(crate) fn bundle(&self, column: usize, row: usize) -> &Cone {
        &self.bundles[row * self.bundles_across() + column]
    }

    /// The group of a bundle.
    pub(crate) fn group(&self, column: usize, row: usize) -> &Cone {
        &self.groups[row / GROUP * self.width.div_ceil(BUNDLE * GROUP) + column / GROUP]
    }

    pub(crate) fn columns_of(&self, bundle: usize) -> Range<usize> {
        bundle * BUNDLE..((bundle + 1) * BUNDLE).min(self.width)
    }

    fn cones(&self, side: usize) -> Vec<Cone> {
        let squares = (0..self.height.div_ceil(side))
            .flat_map(|row| (0..self.width.div_ceil(side)).map(move |column| [column * side, row * side]));
        squares.map(|[column, row]| self.cone(column, row, side)).collect()
    }

    fn cone(&self, column: usize, row: usize, side: usize) -> Cone {
        let mut sum = [0.0_f32; 3];
        let rays = || {
            let rows = row..(row + side).min(self.height);
            rows.flat_map(move |row| {
                (column..(column + side).min(self.width)).map(move |column| self.at(column, row))
            })
        };
        for ray in rays() {
            sum = [sum[0] + ray[0], sum[1] + ray[1], sum[2] + ray[2]];
        }
        let axis = unit_length(sum);
        let distance2 = |ray: Vec3| (0..3).map(|at| (ray[at] - axis[at]) * (ray[at] - axis[at])).sum::<f32>();
        let spread2 = rays().filter(|ray| ray[2] > 0.0).map(distance2).fold(0.0, f32::max);
        Cone { axis, spread: spread2.sqrt() * 1.001 + 1e-6 }
    }
}
