//! The spectrum of a series: the amplitude of each frequency.
//!
//! The finite points are sampled at equal steps (linearly between them, so that evenly spaced points stay as they are),
//! their mean is removed, and a Hann window is applied. Zeros are added up to a power of two, which samples the same
//! spectrum more densely. The amplitude of a sine wave of amplitude 1 is 1 (Harris 1978: division by the sum of the
//! window).

use crate::points::{Over, Points};
use rcs_msg::Stamp;
use std::f64::consts::TAU;

/// Most samples; a longer series is sampled at this many.
const MOST: usize = 1 << 20;

/// The one-sided amplitude spectrum, over frequency: 1 Hz is a second. Empty for fewer than four finite points.
pub(crate) fn spectrum(points: &Points) -> Points {
    let (step_s, mut samples) = even_samples(points);
    let count = samples.len();
    if count < 4 {
        return Points { over: Over::Frequency, ..Points::default() };
    }
    let mean = samples.iter().sum::<f64>() / count as f64;
    let mut weights = 0.0;
    for (i, sample) in samples.iter_mut().enumerate() {
        // Periodic: the window of the diagnostics of spectra, not that of filters.
        let weight = 0.5 - 0.5 * libm::cos(TAU * i as f64 / count as f64);
        *sample = (*sample - mean) * weight;
        weights += weight;
    }
    let length = count.next_power_of_two();
    samples.resize(length, 0.0);
    let (real, imaginary) = transform(samples);
    let amplitude = |k: usize| {
        let both_sides = if k == 0 || 2 * k == length { 1.0 } else { 2.0 };
        both_sides * libm::hypot(real[k], imaginary[k]) / weights
    };
    let hertz = 1.0 / (length as f64 * step_s);
    let stamps: Vec<Stamp> =
        (0..=length / 2).map(|k| Stamp((k as f64 * hertz * 1e9).round() as u64)).collect();
    let values: Vec<f64> = (0..=length / 2).map(amplitude).collect();
    Points { over: Over::Frequency, ..Points::new(stamps, values) }
}

/// The finite points at equal steps between the first and the last one, and the step in seconds.
fn even_samples(points: &Points) -> (f64, Vec<f64>) {
    let finite = points.stamps.iter().zip(points.values.iter()).filter(|(_, value)| value.is_finite());
    let mut known: Vec<(Stamp, f64)> = Vec::new();
    for (&stamp, &value) in finite {
        // Of several values at one time the last counts.
        if known.last().is_some_and(|(last, _)| *last == stamp) {
            known.pop();
        }
        known.push((stamp, value));
    }
    let (Some(&(first, _)), Some(&(last, _))) = (known.first(), known.last()) else {
        return (1.0, Vec::new());
    };
    let count = known.len().min(MOST);
    if count < 2 {
        return (1.0, Vec::new());
    }
    let step_ns = (last.0 - first.0) as f64 / (count - 1) as f64;
    let mut after = 1;
    let at = |i: usize| {
        let at_ns = i as f64 * step_ns;
        while after + 1 < known.len() && ((known[after].0.0 - first.0) as f64) < at_ns {
            after += 1;
        }
        let [(from, a), (to, b)] = [known[after - 1], known[after]];
        let share = (at_ns - (from.0 - first.0) as f64) / (to.0 - from.0) as f64;
        a + (b - a) * share.clamp(0.0, 1.0)
    };
    (step_ns * 1e-9, (0..count).map(at).collect())
}

/// The discrete Fourier transform of real samples, whose number is a power of two (Cooley 1965).
fn transform(samples: Vec<f64>) -> (Vec<f64>, Vec<f64>) {
    let length = samples.len();
    let bits = length.trailing_zeros();
    let (mut real, mut imaginary) = (samples, vec![0.0; length]);
    for i in 0..length {
        let j = if bits == 0 { 0 } else { i.reverse_bits() >> (usize::BITS - bits) };
        if i < j {
            real.swap(i, j);
        }
    }
    let turns: Vec<(f64, f64)> = (0..length / 2)
        .map(|k| libm::sincos(-TAU * k as f64 / length as f64))
        .map(|(sine, cosine)| (cosine, sine))
        .collect();
    let mut half = 1;
    while half < length {
        let every = length / (2 * half);
        for start in (0..length).step_by(2 * half) {
            for k in 0..half {
                let (cosine, sine) = turns[k * every];
                let (a, b) = (start + k, start + k + half);
                let (x, y) = (real[b] * cosine - imaginary[b] * sine, real[b] * sine + imaginary[b] * cosine);
                (real[b], imaginary[b]) = (real[a] - x, imaginary[a] - y);
                (real[a], imaginary[a]) = (real[a] + x, imaginary[a] + y);
            }
        }
        half *= 2;
    }
    (real, imaginary)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sine_wave_has_its_amplitude_at_its_frequency() {
        let wave = |i: usize| 3.0 + 2.0 * (TAU * 5.0 * i as f64 / 128.0).sin();
        let points: Vec<(f64, f64)> = (0..1280).map(|i| (i as f64 / 128.0, wave(i))).collect();
        let spectrum = spectrum(&Points::from_seconds(&points));
        let (at, most) = spectrum
            .values
            .iter()
            .enumerate()
            .fold((0, 0.0), |best, (i, &value)| if value > best.1 { (i, value) } else { best });
        assert!((spectrum.stamps[at].0 as f64 * 1e-9 - 5.0).abs() < 0.1, "{}", spectrum.stamps[at].0);
        assert!((most - 2.0).abs() < 0.02, "{most}");
        assert!(spectrum.values[0] < 1e-3, "the mean is removed");
    }
}
