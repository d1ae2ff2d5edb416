//! Scenes with known ground truth for the tests: a sloping plane and boxes, seen by a depth camera on a vehicle.

use crate::columns::{GroundPlane, Placement, Strip, Survey};
use crate::depth_image::{DepthImage, Rays, label_image, scan_strip};
use crate::scan::{Label, ScanParams};
use glam::{DMat3, DVec2, DVec3};
use rcs_geom::{PinholeCamera, Pose};
use rcs_sense::CELL_SIZE_M;

/// What a pixel shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Truth {
    Sky,
    /// The plane, with the distance ahead of the vehicle.
    Ground,
    /// A box, by its index and the height of the point above the plane, m.
    Box {
        number: usize,
        height_m: f64,
    },
    /// A wall or the bottom of a ditch, with the depth below the plane, m.
    Ditch {
        depth_m: f64,
    },
}

/// A plane through the vehicle's origin that rises ahead, and boxes on it: corners in x and y, and heights above the
/// plane.
#[derive(Clone, Debug, Default)]
pub(crate) struct Scene {
    pub(crate) slope_rad: f64,
    pub(crate) boxes: Vec<[DVec3; 2]>,
    /// Holes in the plane: corners in x and y, and the height of the bottom relative to the plane.
    pub(crate) ditches: Vec<[DVec3; 2]>,
}

pub(crate) struct View {
    pub(crate) camera: PinholeCamera,
    pub(crate) rays: Rays,
    pub(crate) depth: Vec<u8>,
    pub(crate) truth: Vec<Truth>,
    pub(crate) turn: DMat3,
    pub(crate) ground_plane: GroundPlane,
    pub(crate) placement: Placement,
    pub(crate) is_upside_down: bool,
}

pub(crate) const WIDTH: usize = 160;
pub(crate) const HEIGHT: usize = 160;
const CAMERA_HEIGHT_M: f64 = 1.2;

impl Scene {
    pub(crate) fn flat() -> Scene {
        Scene::default()
    }

    pub(crate) fn sloping(slope_rad: f64) -> Scene {
        Scene { slope_rad, ..Scene::default() }
    }

    /// Adds a hole with vertical walls.
    pub(crate) fn with_ditch(mut self, low: [f64; 2], high: [f64; 2], depth_m: f64) -> Scene {
        self.ditches.push([DVec3::new(low[0], low[1], -depth_m), DVec3::new(high[0], high[1], 0.0)]);
        self
    }

    pub(crate) fn with_box(mut self, low: [f64; 3], high: [f64; 3]) -> Scene {
        self.boxes.push([DVec3::from_array(low), DVec3::from_array(high)]);
        self
    }

    /// The view of a camera 1.2 m above the vehicle's origin, pitched 10° down.
    pub(crate) fn look(&self) -> View {
        let camera = PinholeCamera::from_horizontal_fov([WIDTH as u32, HEIGHT as u32], 1.1).unwrap();
        let local_from_vehicle = Pose::from_rpy(DVec3::ZERO, 0.0, -self.slope_rad, 0.0);
        let mount = Pose::from_rpy(DVec3::new(0.0, 0.0, CAMERA_HEIGHT_M), 0.0, 10_f64.to_radians(), 0.0);
        let local_from_optical = local_from_vehicle * mount * Pose::body_from_optical();
        let turn = local_from_optical.rotation_matrix();
        let sensor = local_from_optical.translation;
        let (mut depth, mut truth) = (Vec::new(), Vec::new());
        for row in 0..HEIGHT {
            for column in 0..WIDTH {
                let ray = turn * camera.unproject(DVec2::new(column as f64, row as f64)).unwrap();
                let (distance, what) = self.cast(sensor, ray);
                depth.extend_from_slice(&(if distance < 1e3 { distance as f32 } else { 0.0 }).to_le_bytes());
                truth.push(what);
            }
        }
        let up = local_from_vehicle.rotate(DVec3::Z);
        View {
            rays: Rays::new(&camera),
            camera,
            depth,
            truth,
            turn,
            ground_plane: GroundPlane { below_origin: -sensor, up, wheels_m: 0.5 },
            placement: Placement { sensor, cell_size_m: CELL_SIZE_M },
            is_upside_down: false,
        }
    }

    /// Distance in lengths of the ray, and what the ray meets.
    fn cast(&self, from: DVec3, ray: DVec3) -> (f64, Truth) {
        // Sheared, so that the plane is z = 0 and heights are above the plane.
        let tangent = libm::tan(self.slope_rad);
        let shear = |v: DVec3| DVec3::new(v.x, v.y, v.z - tangent * v.x);
        let (from, ray) = (shear(from), shear(ray));
        let mut best = (f64::INFINITY, Truth::Sky);
        if ray.z < 0.0 {
            best = (-from.z / ray.z, Truth::Ground);
            let crossed = from + ray * best.0;
            let is_in = |[low, high]: &&[DVec3; 2]| {
                (low.x..high.x).contains(&crossed.x) && (low.y..high.y).contains(&crossed.y)
            };
            if let Some([low, high]) = self.ditches.iter().find(is_in) {
                // From inside a box, the ray meets the nearest of the far faces.
                let (a, b) = ((*low - from) / ray, (*high - from) / ray);
                let leave = a.max(b).min_element();
                best = (leave, Truth::Ditch { depth_m: -(from.z + leave * ray.z) });
            }
        }
        for (number, [low, high]) in self.boxes.iter().enumerate() {
            let (a, b) = ((*low - from) / ray, (*high - from) / ray);
            let (enter, leave) = (a.min(b).max_element(), a.max(b).min_element());
            if enter <= leave && enter > 0.0 && enter < best.0 {
                best = (enter, Truth::Box { number, height_m: from.z + enter * ray.z });
            }
        }
        best
    }
}

impl View {
    pub(crate) fn image(&self) -> DepthImage<'_> {
        let size = [self.camera.width as usize, self.camera.height as usize];
        let image = DepthImage::new(size, size[0] * 4, "32FC1", 1.0, &self.depth).unwrap();
        DepthImage { is_upside_down: self.is_upside_down, ..image }
    }

    /// The same view by a camera that is mounted upside down.
    pub(crate) fn upside_down(self) -> View {
        let depth = self.depth.as_chunks::<4>().0.iter().rev().flatten().copied().collect();
        let truth = self.truth.iter().rev().copied().collect();
        let turn = self.turn * DMat3::from_diagonal(DVec3::new(-1.0, -1.0, 1.0));
        View { depth, truth, turn, is_upside_down: true, ..self }
    }

    pub(crate) fn strips(&self, params: &ScanParams) -> Vec<Strip> {
        self.strips_of(&self.survey(*params), &[])
    }

    pub(crate) fn survey(&self, scan: ScanParams) -> Survey<'static> {
        let (ground_plane, placement) = (self.ground_plane, self.placement);
        Survey { ground_plane, placement, scan, negative: None, known: None }
    }

    pub(crate) fn strips_of(&self, survey: &Survey<'_>, rgb: &[u8]) -> Vec<Strip> {
        let image = self.image();
        let strip = |i| scan_strip(&image, rgb, &self.rays, i, self.turn, survey);
        (0..self.rays.strips()).map(strip).collect()
    }

    /// Ground truth and label of every pixel.
    pub(crate) fn labels(&self, params: &ScanParams) -> Vec<(Truth, Label)> {
        let labels = label_image(&self.strips(params), &self.image());
        let label = |&number: &u8| Label::ALL[number as usize];
        self.truth.iter().copied().zip(labels.iter().map(label)).collect()
    }
}
