//! Infrared range sensors: distance to the nearest object in a cone.

use super::normal;
use crate::spec::InfraredSpec;
use crate::terrain::Terrain;
use glam::DVec3;
use rand_core::RngCore;
use rcs_geom::Pose;

/// Number of rays on the cone's surface, besides the one along its axis.
const RIM_RAYS: usize = 4;

/// A reading of one sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InfraredReading {
    /// Distance, m; the maximum range where nothing is seen.
    pub range_m: f64,
    /// Whether an object is in range.
    pub seen: bool,
}

/// Measures with one sensor of a vehicle at `global_from_vehicle`.
pub fn measure_infrared(
    spec: &InfraredSpec,
    terrain: &impl Terrain,
    global_from_vehicle: &Pose,
    noise: bool,
    rng: &mut impl RngCore,
) -> InfraredReading {
    let global_from_sensor = *global_from_vehicle * spec.mount.vehicle_from_sensor();
    let drawn = if noise { spec.noise_m * normal(rng) } else { 0.0 };
    let [near, far] = spec.range_m;
    let (sin, cos) = libm::sincos(0.5 * spec.cone_rad);
    let rim = (0..RIM_RAYS).map(|ray| {
        let (up, side) = libm::sincos(std::f64::consts::TAU * ray as f64 / RIM_RAYS as f64);
        DVec3::new(cos, sin * side, sin * up)
    });
    let nearest = std::iter::once(DVec3::X)
        .chain(rim)
        .filter_map(|ray| {
            terrain.range_m(global_from_sensor.translation, global_from_sensor.rotate(ray), far)
        })
        .reduce(f64::min);
    match nearest {
        Some(range_m) => InfraredReading { range_m: (range_m + drawn).clamp(near, far), seen: true },
        None => InfraredReading { range_m: far, seen: false },
    }
}
