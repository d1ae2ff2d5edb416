//! Shared by the tests of this crate: a random number generator, the vehicles, and worlds of one plane with posts.

#![allow(
    dead_code,
    unreachable_pub,
    clippy::unwrap_used,
    missing_docs,
    reason = "each test takes what it needs"
)]

pub mod bench;

use glam::{DVec2, DVec3};
use rand_core::RngCore;
use rcs_sim::spec::VehicleSpec;
use rcs_sim::terrain::{Patch, Terrain, Touch, UprightBox};

/// The vehicle file of the LAGR-like robot.
pub const LAGR: &str = include_str!("../../../../assets/vehicles/lagr.toml");
/// The vehicle file of the tractor.
pub const TRACTOR: &str = include_str!("../../../../assets/vehicles/tractor.toml");

pub fn lagr() -> VehicleSpec {
    VehicleSpec::from_toml(LAGR).unwrap()
}

pub fn tractor() -> VehicleSpec {
    VehicleSpec::from_toml(TRACTOR).unwrap()
}

/// A random number generator that hashes a counter (`SplitMix64`).
#[derive(Clone, Debug)]
pub struct Counter(pub u64);

impl RngCore for Counter {
    fn next_u32(&mut self) -> u32 {
        (self.next_u64() >> 32) as u32
    }
    fn next_u64(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }
    fn fill_bytes(&mut self, bytes: &mut [u8]) {
        for chunk in bytes.chunks_mut(8) {
            chunk.copy_from_slice(&self.next_u64().to_le_bytes()[..chunk.len()]);
        }
    }
}

/// A plane that may slope along x and y, with upright round posts. Post 0 is a person if `person` is set.
#[derive(Clone, Debug)]
pub struct Plane {
    pub slope_x: f64,
    pub slope_y: f64,
    pub traction: f64,
    pub rolling_resistance: f64,
    /// Centre and radius of each post, m.
    pub posts: Vec<(DVec2, f64)>,
    pub person: bool,
    /// Height of the ledge at x = `ledge_x_m`.
    pub ledge_m: f64,
    pub ledge_x_m: f64,
}

impl Default for Plane {
    fn default() -> Self {
        Plane {
            slope_x: 0.0,
            slope_y: 0.0,
            traction: 0.8,
            rolling_resistance: 0.03,
            posts: Vec::new(),
            person: false,
            ledge_m: 0.0,
            ledge_x_m: f64::INFINITY,
        }
    }
}

impl Terrain for Plane {
    fn patch(&self, at: DVec2) -> Patch {
        let ledge = if at.x >= self.ledge_x_m { self.ledge_m } else { 0.0 };
        Patch {
            height_m: at.x * self.slope_x + at.y * self.slope_y + ledge,
            traction: self.traction,
            rolling_resistance: self.rolling_resistance,
            slip_at_limit: 0.0,
            plant_drag: 0.0,
        }
    }

    fn touching(&self, body: &UprightBox) -> Vec<Touch> {
        let (sin, cos) = libm::sincos(body.yaw_rad);
        let (ahead, left) = (DVec2::new(cos, sin), DVec2::new(-sin, cos));
        let mut touches = Vec::new();
        for (thing, &(middle, radius)) in self.posts.iter().enumerate() {
            let offset = middle - body.centre;
            let local = DVec2::new(offset.dot(ahead), offset.dot(left));
            let nearest = local.clamp(-body.half, body.half);
            let gap = nearest - local;
            let (normal, depth_m) = if gap.length() > 1e-12 {
                (gap.normalize(), radius - gap.length())
            } else {
                // The centre of the post is inside: push out through the nearest side.
                let room = body.half - local.abs();
                let out = if room.x < room.y {
                    DVec2::new(-local.x.signum(), 0.0)
                } else {
                    DVec2::new(0.0, -local.y.signum())
                };
                (out, radius + room.min_element())
            };
            if depth_m > 0.0 {
                let point = body.centre + ahead * nearest.x + left * nearest.y;
                touches.push(Touch {
                    thing: thing as u32,
                    point: point.extend(body.z_m[0]),
                    normal: ahead * normal.x + left * normal.y,
                    depth_m,
                });
            }
        }
        touches
    }

    fn range_m(&self, _: DVec3, _: DVec3, _: f64) -> Option<f64> {
        None
    }

    fn trees_near(&self, _: DVec2, _: f64) -> usize {
        0
    }

    fn contains(&self, at: DVec2) -> bool {
        at.length() < 1000.0
    }

    fn kind(&self, thing: u32) -> &str {
        if self.person && thing == 0 { "person" } else { "post" }
    }
}
