//! The colours of known obstacles in other light, and with the ground seen through them, as through a fence of mesh.
//!
//! Farther away than about 2 m the strings of a mesh are thinner than a pixel of the reduced image, so each pixel is a
//! blend of the obstacle's colour and of what is behind it: red = a·l·red₁ + (1 − a)·red₂, where a is the share of the
//! pixel that the obstacle covers, and l its light: a side in the shade is darker than the pictures of which the a priori
//! model was made. Those pictures cannot show all of these blends, which depend on the ground of the day.

use crate::histogram::{BINS, CELLS, Histogram, bin};

/// Number of shares between the least one and 1 for which colours are blended.
const SHARES: usize = 8;
/// Light on the obstacle, as a part of that in the pictures of the model: sun, haze, shade.
pub const ANY_LIGHT: [f32; 3] = [1.0, 0.7, 0.4];
/// The light of these pictures alone.
pub const FULL_LIGHT: [f32; 1] = [1.0];
/// Bins with less than this part of a histogram are left out: they say little and cost time.
const LEAST_PART: f32 = 0.001;

/// Distribution of the colours of pixels of which an obstacle covers a share, and ground the rest: each share from the
/// least one to 1 is as frequent as the others, and so is each light on the obstacle. Both histograms must have the same sum, which the
/// result has, too.
pub fn blended(obstacle: &Histogram, ground: &Histogram, least_cover: f64, lights: &[f32]) -> Vec<f32> {
    let (front, behind) = (colours(obstacle), colours(ground));
    let mut blend = vec![0.0_f32; CELLS];
    for step in 0..SHARES {
        let share = (least_cover + (1.0 - least_cover) * step as f64 / (SHARES - 1) as f64) as f32;
        for &light in lights {
            for &([red, green], front) in &front {
                for &([red_behind, green_behind], behind) in &behind {
                    let mix = |a: f32, b: f32| (share * light * a + (1.0 - share) * b) as u8;
                    blend[bin(mix(red, red_behind), mix(green, green_behind))] += front * behind;
                }
            }
        }
    }
    let sum: f32 = blend.iter().sum();
    if sum > 0.0 {
        let factor = obstacle.sum() / sum;
        for count in &mut blend {
            *count *= factor;
        }
    }
    blend
}

/// Red and green in the middle of each bin that is not left out, and its count.
fn colours(histogram: &Histogram) -> Vec<([f32; 2], f32)> {
    let least = LEAST_PART * histogram.sum();
    let middle = |bin: usize| (bin as f32 + 0.5) * 256.0 / BINS as f32;
    let bins = histogram.counts().iter().enumerate().filter(|&(_, &count)| count > 0.0 && count >= least);
    bins.map(|(at, &count)| ([middle(at / BINS), middle(at % BINS)], count)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plain(red: u8, green: u8) -> Histogram {
        let mut histogram = Histogram::default();
        (0..1000).for_each(|_| histogram.add(red, green));
        histogram
    }

    #[test]
    fn blends_lie_between_the_ground_and_the_obstacle_in_light_or_shade_and_keep_the_sum() {
        let blend = blended(&plain(230, 90), &plain(80, 120), 0.25, &ANY_LIGHT);
        assert!((blend.iter().sum::<f32>() - 1000.0).abs() < 0.1);
        // A quarter of the obstacle in the sun; all of it, in the sun and in the shade; the ground alone.
        for (red, green, is_blend) in [(117, 112, true), (230, 90, true), (92, 36, true), (80, 120, false)] {
            assert_eq!(blend[bin(red, green)] > 10.0, is_blend, "{red}, {green}");
        }
    }

    #[test]
    fn nothing_is_seen_through_an_obstacle_that_covers_its_pixels() {
        let blend = blended(&plain(230, 90), &plain(80, 120), 1.0, &ANY_LIGHT);
        let seen: Vec<usize> = (0..CELLS).filter(|&at| blend[at] > 0.0).collect();
        let own = |light: f32| bin((light * 230.0) as u8, (light * 90.0) as u8);
        assert!(seen.len() == ANY_LIGHT.len() && seen.contains(&own(1.0)), "{seen:?}");
    }

    #[test]
    fn without_a_ground_there_is_no_blend() {
        let blend = blended(&plain(230, 90), &Histogram::default(), 0.25, &ANY_LIGHT);
        assert!(blend.iter().all(|count| *count == 0.0));
    }
}
