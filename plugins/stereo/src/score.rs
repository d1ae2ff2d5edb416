//! Quality of a disparity image, compared with ground truth.
//!
//! Figures are over **pixels seen by both cameras**: pixels with ground truth at x ≥ the number of disparities for
//! which no other pixel of the row, with a disparity larger by more than 1, maps to the same column of the right image.

use crate::{NO_DISPARITY, STEPS_PER_PIXEL, StereoError};

/// Figures of one disparity image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Score {
    /// Pixels seen by both cameras.
    pub pixels: usize,
    /// Share of pixels that are more than 2 pixels off among those with a disparity, percent; `None` if none has one.
    pub bad2_valid_pct: Option<f64>,
    /// Share of pixels that are more than 2 pixels off or have no disparity, percent.
    pub bad2_dense_pct: f64,
    /// Share of pixels with a disparity, percent.
    pub density_pct: f64,
    /// Root mean square error over pixels with a disparity that are at most 2 pixels off, pixels; `None` if there are
    /// none.
    pub rms_px: Option<f64>,
}

/// Which pixels are seen by both cameras. `truth` is the left image's true disparity in pixels; values that are not
/// finite or not positive are unknown.
pub fn seen_by_both(truth: &[f32], width: usize, disparities: usize) -> Vec<bool> {
    let mut seen = vec![false; truth.len()];
    if width == 0 {
        return seen;
    }
    let mut nearest = vec![f32::NEG_INFINITY; width];
    for (truth, seen) in truth.chunks_exact(width).zip(seen.chunks_exact_mut(width)) {
        let right_column = |x: usize| {
            let d = truth[x];
            let column = (x as f32 - d).round();
            (d.is_finite() && d > 0.0 && column >= 0.0).then_some(column as usize)
        };
        nearest.fill(f32::NEG_INFINITY);
        for (x, &d) in truth.iter().enumerate() {
            if let Some(column) = right_column(x) {
                nearest[column] = nearest[column].max(d);
            }
        }
        for x in disparities.min(width)..width {
            seen[x] = right_column(x).is_some_and(|column| nearest[column] <= truth[x] + 1.0);
        }
    }
    seen
}

/// Compares disparities, 1/16 pixel, with the ground truth, pixels.
pub fn score(
    disparity: &[u16],
    truth: &[f32],
    width: usize,
    disparities: usize,
) -> Result<Score, StereoError> {
    if disparity.len() != truth.len() {
        return Err(StereoError::TruthSize { got: truth.len(), expected: disparity.len() });
    }
    let (mut pixels, mut valid, mut bad, mut squares) = (0_usize, 0_usize, 0_usize, 0.0_f64);
    for ((&d, &truth), _) in
        disparity.iter().zip(truth).zip(seen_by_both(truth, width, disparities)).filter(|(_, seen)| *seen)
    {
        pixels += 1;
        if d != NO_DISPARITY {
            valid += 1;
            let error = f64::from(d) / f64::from(STEPS_PER_PIXEL) - f64::from(truth);
            if error.abs() > 2.0 {
                bad += 1;
            } else {
                squares += error * error;
            }
        }
    }
    let pct = |part: usize, whole: usize| 100.0 * part as f64 / whole.max(1) as f64;
    Ok(Score {
        pixels,
        bad2_valid_pct: (valid > 0).then(|| pct(bad, valid)),
        bad2_dense_pct: pct(bad + pixels - valid, pixels),
        density_pct: pct(valid, pixels),
        rms_px: (valid > bad).then(|| (squares / (valid - bad) as f64).sqrt()),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_behind_a_nearer_one_are_not_seen_by_both_cameras() {
        let unknown = f32::INFINITY;
        // Column 8 with disparity 6 and column 5 with 3 both map to column 2; 7 and 8 differ by less than 1.
        let truth = [1.0, 1.0, 1.0, 1.0, 1.0, 3.0, unknown, 5.2, 6.0, 0.0, f32::NAN, 12.0];
        let seen = seen_by_both(&truth, 12, 4);
        let columns: Vec<usize> = (0..12).filter(|&x| seen[x]).collect();
        // 4 is not hidden by anything; 11 lies outside of the right image.
        assert_eq!(columns, [4, 7, 8]);
        assert_eq!(seen_by_both(&truth, 12, 9).iter().filter(|seen| **seen).count(), 0);
        assert_eq!(seen_by_both(&[], 0, 4), Vec::<bool>::new());
    }

    #[test]
    fn errors_are_counted_over_pixels_seen_by_both() {
        let truth = [9.0, 1.0, 1.0, 1.0, 1.0];
        let found = [0, 16, 16 * 4, NO_DISPARITY, 24];
        let score = score(&found, &truth, 5, 1).unwrap();
        assert_eq!((score.pixels, score.density_pct, score.bad2_dense_pct), (4, 75.0, 50.0));
        assert!((score.bad2_valid_pct.unwrap() - 100.0 / 3.0).abs() < 1e-12);
        assert!((score.rms_px.unwrap() - 0.125_f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn figures_over_no_pixels_are_none_instead_of_perfect() {
        let truth = [9.0, 1.0, 1.0];
        let found = |disparity: u16| score(&[0, disparity, disparity], &truth, 3, 1).unwrap();
        let without = found(NO_DISPARITY);
        assert_eq!((without.pixels, without.density_pct, without.bad2_dense_pct), (2, 0.0, 100.0));
        assert_eq!((without.bad2_valid_pct, without.rms_px), (None, None));
        let wrong = found(16 * 4);
        assert_eq!((wrong.bad2_valid_pct, wrong.rms_px), (Some(100.0), None));
    }

    #[test]
    fn a_truth_of_another_size_is_refused() {
        let error = score(&[0; 4], &[0.0; 5], 2, 1).unwrap_err();
        assert_eq!(error.to_string(), "ground truth has 5 pixels, expected 4");
    }
}
