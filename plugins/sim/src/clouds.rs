//! Passing clouds: the share of the sun's light that reaches the ground, over time.
//!
//! A cloud covers the whole view of a camera, because clouds are hundreds of metres wide. The share follows from the
//! time and the vehicle file alone, so that all cameras see the same clouds.

use crate::exposure::scrambled;
use crate::spec::CloudsSpec;
use rcs_msg::Stamp;

/// Width of the transition between sun and cloud, as a fraction of the range of the noise.
const EDGE: f64 = 0.15;

/// Share of the sun's light at a time, from `least_sunlight` under a cloud to 1 under a clear sky.
pub fn sunlight(clouds: &CloudsSpec, time: Stamp) -> f64 {
    // Noise with two random values per period, joined smoothly; a cloud is where it is among its `cover` highest.
    let at = 2.0 * time.0 as f64 / (clouds.period_s * 1e9);
    let node = at as u64;
    let part = smooth(at - node as f64);
    let value = random(clouds.seed, node) * (1.0 - part) + random(clouds.seed, node + 1) * part;
    let cloud = smooth(((value - 1.0 + clouds.cover) / EDGE + 0.5).clamp(0.0, 1.0));
    1.0 - (1.0 - clouds.least_sunlight) * cloud
}

fn smooth(part: f64) -> f64 {
    part * part * (3.0 - 2.0 * part)
}

/// A random number from 0 to 1.
fn random(seed: u32, node: u64) -> f64 {
    let bits = scrambled(node.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ u64::from(seed));
    (bits >> 11) as f64 / (1_u64 << 53) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    const CLOUDS: CloudsSpec = CloudsSpec { cover: 0.5, period_s: 40.0, least_sunlight: 0.3, seed: 3 };

    fn hour(clouds: &CloudsSpec) -> Vec<f64> {
        (0..36_000).map(|tenth| sunlight(clouds, Stamp(tenth * 100_000_000))).collect()
    }

    #[test]
    fn the_light_stays_within_its_limits_and_changes_slowly() {
        let light = hour(&CLOUDS);
        assert!(light.iter().all(|light| (0.3..=1.0).contains(light)));
        let steepest = light.windows(2).map(|pair| (pair[1] - pair[0]).abs()).fold(0.0, f64::max);
        assert!(steepest > 0.001 && steepest < 0.15, "{steepest} in a tenth of a second");
        let (bright, dark) = (|light: &&f64| **light > 0.95, |light: &&f64| **light < 0.35);
        assert!(light.iter().filter(bright).count() > 9_000 && light.iter().filter(dark).count() > 9_000);
    }

    #[test]
    fn cover_is_about_the_share_of_time_under_clouds() {
        for (cover, range) in [(0.2, 0.05..0.25), (0.5, 0.4..0.6), (0.8, 0.75..0.95)] {
            let light = hour(&CloudsSpec { cover, ..CLOUDS });
            let share = light.iter().filter(|light| **light < 0.65).count() as f64 / light.len() as f64;
            assert!(range.contains(&share), "cover {cover}: {share}");
        }
    }
}
