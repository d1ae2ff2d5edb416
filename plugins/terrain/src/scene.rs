//! A test scene of two textures: flat ground, and an upright wall across it.

use crate::frame::{GROUND, LabelledFrame, OBSTACLE, Rays};
use crate::models::Terrain;
use crate::texture::PaddedGrey;
use glam::{DVec2, DVec3};
use rcs_geom::{PinholeCamera, Pose};

/// A camera 1 m above the vehicle's origin, pitched 12° down.
pub(crate) fn vehicle_from_camera() -> Pose {
    Pose::from_rpy(DVec3::new(0.0, 0.0, 1.0), 0.0, 12.0_f64.to_radians(), 0.0) * Pose::body_from_optical()
}

/// A camera of this size with a horizontal field of view of 60°.
pub(crate) fn camera(size: [u32; 2]) -> PinholeCamera {
    PinholeCamera::from_horizontal_fov(size, 60.0_f64.to_radians()).unwrap()
}

/// A pseudo-random number for a pixel.
pub(crate) fn noise(x: usize, y: usize, seed: u64) -> u64 {
    let mut state = (x as u64) << 32 ^ (y as u64) << 8 ^ seed.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    for _ in 0..3 {
        state = (state ^ state >> 31).wrapping_mul(0x7fb5_d329_728e_a185);
    }
    state ^ state >> 33
}

/// Fine green grass.
pub(crate) fn grass(x: usize, y: usize, seed: u64) -> [u8; 3] {
    let light = (noise(x, y, seed) % 40) as u8;
    [60 + light / 2, 100 + light, 40 + light / 3]
}

/// Brown planks with joints every eight pixels.
pub(crate) fn planks(x: usize, y: usize, seed: u64) -> [u8; 3] {
    let joint = if x.is_multiple_of(8) { 40 } else { 0 };
    let light = (noise(x, y, seed) % 8) as u8;
    [130 + light - joint, 90 + light - joint, 60 + light / 2 - joint]
}

/// A frame and the scene from which it was made.
pub(crate) struct Scene {
    pub(crate) size: [usize; 2],
    pub(crate) rgb: Vec<u8>,
    pub(crate) grey: PaddedGrey,
    pub(crate) labels: Vec<u8>,
    pub(crate) depth_m: Vec<f32>,
    pub(crate) rays: Rays,
    pub(crate) local_from_vehicle: Pose,
}

impl Scene {
    /// Ground of grass, and planks 2 m high `wall_m` ahead of the vehicle, `wall_half_m` wide to each side; the sky is
    /// pale and has no range.
    pub(crate) fn new(
        size: [u32; 2],
        local_from_vehicle: Pose,
        wall_m: f64,
        wall_half_m: f64,
        seed: u64,
    ) -> Scene {
        let camera = camera(size);
        let [width, height] = size.map(|side| side as usize);
        let mount = vehicle_from_camera();
        let (mut rgb, mut labels, mut depth_m) = (Vec::new(), Vec::new(), Vec::new());
        for y in 0..height {
            for x in 0..width {
                let optical = camera.unproject(DVec2::new(x as f64, y as f64)).unwrap();
                let ray = mount.rotate(optical);
                let to_wall = (wall_m - mount.translation.x) / ray.x;
                let on_wall = mount.translation + ray * to_wall;
                let is_wall = (0.0..2.0).contains(&on_wall.z) && on_wall.y.abs() < wall_half_m;
                let to_ground = -mount.translation.z / ray.z;
                let (color, label, depth) = if is_wall {
                    (planks(x, y, seed), OBSTACLE, to_wall)
                } else if to_ground > 0.0 {
                    (grass(x, y, seed), GROUND, to_ground)
                } else {
                    ([200, 215, 240], 0, f64::NAN)
                };
                rgb.extend(color);
                labels.push(label);
                depth_m.push(depth as f32);
            }
        }
        let grey = PaddedGrey::from_rgb(&rgb, width, height);
        let rays = Rays::new(&camera);
        Scene { size: [width, height], rgb, grey, labels, depth_m, rays, local_from_vehicle }
    }

    /// The frame as the learner reads it.
    pub(crate) fn frame(&self) -> LabelledFrame<'_> {
        LabelledFrame {
            rgb: &self.rgb,
            grey: &self.grey,
            labels: &self.labels,
            depth_m: &self.depth_m,
            rays: &self.rays,
            local_from_camera: self.local_from_vehicle * vehicle_from_camera(),
        }
    }
}

/// Terrain with this many points of one code.
pub(crate) fn terrain(code: u16, ground: u64, obstacle: u64) -> Terrain {
    let mut terrain = Terrain { ground, obstacle, ..Terrain::default() };
    (0..ground + obstacle).for_each(|_| terrain.histograms.add(code, 840));
    terrain
}
