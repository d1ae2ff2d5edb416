//! Sensor model of a camera: exposure, vignetting and noise of an image.
//!
//! Noise is a hash of the frame's key and the pixel, so that a strip of an image does not depend on which thread
//! computes it.

use crate::spec::{CameraKind, CameraSpec, ExposureControl};
use rcs_scene::Class;

/// Exposure of one camera in one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exposure {
    /// Exposure gain, 1 = correct.
    pub gain: f64,
    /// Key of the noise, different for each camera and frame.
    pub key: u64,
}

/// Sensor model of a camera.
#[derive(Clone, Debug)]
pub struct Sensor {
    size: [usize; 2],
    vignette: f32,
    /// Standard deviation of the noise by grey level.
    deviation: [f32; 256],
}

/// Mean and standard deviation of the sum of three uniform 7-bit numbers.
const SUM_MEAN: f32 = 190.5;
const SUM_DEVIATION: f32 = 63.998;

/// Mixes a key and a counter.
fn mixed(key: u64, counter: u64) -> u64 {
    scrambled(key.wrapping_add(counter.wrapping_mul(0x9e37_79b9_7f4a_7c15)))
}

/// The output function of `SplitMix64`.
pub(crate) fn scrambled(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// Approximately normal random numbers with deviation 1 for the three channels of a pixel, each the sum of three
/// uniform numbers.
fn channels(key: u64, pixel: u64) -> [f32; 3] {
    let bits = mixed(key, pixel);
    [0, 21, 42].map(|shift| {
        let part = bits >> shift;
        let sum = (part & 127) + (part >> 7 & 127) + (part >> 14 & 127);
        (sum as f32 - SUM_MEAN) / SUM_DEVIATION
    })
}

impl Sensor {
    /// The sensor of a camera for images of this size, pixels.
    pub fn new(spec: &CameraSpec, size: [usize; 2]) -> Sensor {
        let (dark, white) = (spec.dark_noise as f32, spec.shot_noise as f32);
        let deviation = |level: usize| dark + (white - dark) * (level as f32 / 255.0).sqrt();
        Sensor { size, vignette: spec.vignette as f32, deviation: std::array::from_fn(deviation) }
    }

    /// Exposes rows in place, starting with `first_row`; `CHANNELS` bytes per pixel, 1 or 3.
    pub fn expose<const CHANNELS: usize>(&self, exposure: &Exposure, first_row: usize, pixels: &mut [u8]) {
        let [width, height] = self.size.map(|side| side as f32);
        let middle = [0.5 * (width - 1.0), 0.5 * (height - 1.0)];
        let corner2 = middle[0] * middle[0] + middle[1] * middle[1];
        let (gain, lost) = (exposure.gain as f32, exposure.gain as f32 * self.vignette / corner2);
        for (row, line) in pixels.chunks_exact_mut(self.size[0] * CHANNELS).enumerate() {
            let row = first_row + row;
            let down = row as f32 - middle[1];
            let gain = gain - lost * down * down;
            let first = (row * self.size[0]) as u64;
            let mut right = -middle[0];
            for (pixel, counter) in line.as_chunks_mut::<CHANNELS>().0.iter_mut().zip(first..) {
                let gain = gain - lost * right * right;
                right += 1.0;
                let noise = channels(exposure.key, counter);
                for (value, noise) in pixel.iter_mut().zip(noise) {
                    // The conversion to a byte saturates.
                    let light = f32::from(*value) * gain;
                    *value = (light + noise * self.deviation[usize::from(light as u8)] + 0.5) as u8;
                }
            }
        }
    }
}

impl ExposureControl {
    /// The exposure gain of the next frame, from that of a frame, its pixels, and the time between them, s.
    pub fn next_gain(&self, gain: f64, pixels: &[u8], elapsed_s: f64) -> f64 {
        let sum: u64 = pixels.iter().map(|&level| u64::from(level)).sum();
        let mean = (sum as f64 / pixels.len().max(1) as f64).max(1.0);
        let part = 1.0 - libm::exp(-elapsed_s / self.response_s.max(1e-3));
        (gain * libm::pow(self.target / mean, part)).clamp(1.0 / self.max_gain, self.max_gain)
    }
}

/// Grey level in a thermal image: living and sunlit objects are warm, plants cool, the sky is cold; the brightness
/// of a surface adds texture.
pub fn thermal(class: u8, rgb: [u8; 3]) -> u8 {
    let warmth: i32 = match Class::from_code(class) {
        None | Some(Class::Sky) => 10,
        Some(Class::Person) => 225,
        Some(Class::TallGrass | Class::TallWeeds | Class::Thicket | Class::Crown | Class::Bush) => 85,
        Some(Class::ShortGrass | Class::Trunk) => 100,
        Some(Class::Mud | Class::LeafLitter) => 110,
        Some(Class::Dirt | Class::Mulch | Class::WhiteLime) => 140,
        Some(_) => 125,
    };
    let light = (i32::from(rgb[0]) + i32::from(rgb[1]) + i32::from(rgb[2])) / 3;
    (warmth + (light - 110) / 8).clamp(0, 255) as u8
}

/// Bytes per pixel of a camera's images, and their encoding.
pub fn encoding_of(kind: CameraKind) -> (usize, &'static str) {
    match kind {
        CameraKind::Stereo | CameraKind::Color => (3, "rgb8"),
        CameraKind::Infrared => (1, "mono8"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spec::VehicleSpec;
    use proptest::prelude::*;

    fn camera() -> CameraSpec {
        let text = include_str!("../../../assets/vehicles/lagr.toml");
        VehicleSpec::from_toml(text).unwrap().camera("front_left").unwrap().clone()
    }

    fn exposed(spec: &CameraSpec, level: u8, key: u64) -> Vec<f64> {
        let mut pixels = vec![level; 64 * 48 * 3];
        let sensor = Sensor::new(spec, [64, 48]);
        sensor.expose::<3>(&Exposure { gain: 1.0, key }, 0, &mut pixels);
        pixels.into_iter().map(f64::from).collect()
    }

    #[test]
    fn noise_has_the_deviation_of_the_vehicle_file() {
        let spec = CameraSpec { vignette: 0.0, ..camera() };
        for (level, expected) in
            [(20_u8, 0.8 + 1.2 * (20.0_f64 / 255.0).sqrt()), (180, 0.8 + 1.2 * (180.0_f64 / 255.0).sqrt())]
        {
            let pixels = exposed(&spec, level, 9);
            let mean = pixels.iter().sum::<f64>() / pixels.len() as f64;
            let variance = pixels.iter().map(|p| (p - mean) * (p - mean)).sum::<f64>() / pixels.len() as f64;
            assert!((mean - f64::from(level)).abs() < 0.1, "{mean}");
            // Rounding to whole levels adds a variance of 1/12.
            let got = (variance - 1.0 / 12.0).sqrt();
            assert!((got / expected - 1.0).abs() < 0.05, "level {level}: got {got}, expected {expected}");
        }
    }

    /// [`Sensor::expose`] of one value of a pixel, by its column, row and channel.
    fn reference_exposed(
        spec: &CameraSpec,
        size: [usize; 2],
        exposure: &Exposure,
        [column, row, channel]: [usize; 3],
        value: u8,
    ) -> u8 {
        let middle = size.map(|side| 0.5 * (side as f32 - 1.0));
        let [right, down] = [column as f32 - middle[0], row as f32 - middle[1]];
        let corner2 = middle[0] * middle[0] + middle[1] * middle[1];
        let gain = exposure.gain as f32;
        let lost = gain * spec.vignette as f32 / corner2;
        let light = f32::from(value) * (gain - lost * down * down - lost * right * right);
        let [dark, white] = [spec.dark_noise as f32, spec.shot_noise as f32];
        let level = f32::from(light.clamp(0.0, 255.0) as u8);
        let deviation = dark + (white - dark) * (level / 255.0).sqrt();
        let noise = channels(exposure.key, (row * size[0] + column) as u64)[channel];
        (light + noise * deviation + 0.5).clamp(0.0, 255.0) as u8
    }

    fn check_expose<const CHANNELS: usize>(
        spec: &CameraSpec,
        size: [usize; 2],
        exposure: &Exposure,
        first_row: usize,
        values: &[u8],
    ) {
        let mut got = values.to_vec();
        Sensor::new(spec, size).expose::<CHANNELS>(exposure, first_row, &mut got);
        let expected = values.iter().enumerate().map(|(index, &value)| {
            let pixel = index / CHANNELS;
            let place = [pixel % size[0], first_row + pixel / size[0], index % CHANNELS];
            reference_exposed(spec, size, exposure, place, value)
        });
        assert_eq!(got, expected.collect::<Vec<u8>>(), "{CHANNELS} channels, {size:?} from row {first_row}");
    }

    proptest! {
        #[test]
        fn rows_are_exposed_like_single_values(
            (width, height) in (2..40_usize, 2..40_usize),
            first in any::<prop::sample::Index>(),
            gain in 0.05..8.0_f64,
            vignette in 0.0..1.0_f64,
            (dark_noise, shot_noise) in (0.0..20.0_f64, 0.0..20.0_f64),
            key in any::<u64>(),
            values in prop::collection::vec(any::<u8>(), 40 * 40 * 3),
        ) {
            let spec = CameraSpec { dark_noise, shot_noise, vignette, ..camera() };
            let first_row = first.index(height);
            let count = width * (height - first_row);
            let exposure = Exposure { gain, key };
            check_expose::<1>(&spec, [width, height], &exposure, first_row, &values[..count]);
            check_expose::<3>(&spec, [width, height], &exposure, first_row, &values[..count * 3]);
        }
    }

    #[test]
    fn strips_are_the_parts_of_the_whole_and_frames_differ() {
        let spec = camera();
        let sensor = Sensor::new(&spec, [64, 48]);
        let exposure = Exposure { gain: 1.1, key: 3 };
        let mut whole = vec![100; 64 * 48 * 3];
        sensor.expose::<3>(&exposure, 0, &mut whole);
        let mut strips = vec![100; 64 * 48 * 3];
        for (strip, rows) in strips.chunks_mut(64 * 3 * 7).enumerate() {
            sensor.expose::<3>(&exposure, strip * 7, rows);
        }
        assert_eq!(whole, strips);
        assert_ne!(exposed(&spec, 100, 1), exposed(&spec, 100, 2));
    }

    #[test]
    fn exposure_control_brings_the_mean_to_its_target_and_has_limits() {
        let control = ExposureControl { target: 120.0, response_s: 0.5, max_gain: 3.0 };
        let settled = |light: f64| {
            let mut gain = 1.0;
            for _ in 0..40 {
                let level = (light * gain).min(255.0) as u8;
                gain = control.next_gain(gain, &[level; 30], 0.2);
            }
            gain
        };
        for light in [60.0, 120.0, 200.0] {
            assert!((settled(light) * light / 120.0 - 1.0).abs() < 0.02, "{light}: {}", settled(light));
        }
        assert_eq!((settled(10.0), settled(1.0)), (3.0, 3.0));
        // After one time constant 1 − 1/e of the logarithm of the error is gone.
        let gain = control.next_gain(1.0, &[60; 30], 0.5);
        assert!((libm::log2(gain) - (1.0 - libm::exp(-1.0))).abs() < 1e-12, "{gain}");
    }

    #[test]
    fn corners_lose_as_much_light_as_the_vehicle_file_says() {
        let spec = CameraSpec { vignette: 0.2, dark_noise: 0.0, shot_noise: 0.0, ..camera() };
        let pixels = exposed(&spec, 200, 0);
        assert_eq!(pixels[0], 160.0);
        assert_eq!(pixels[(24 * 64 + 32) * 3], 200.0);
    }
}
