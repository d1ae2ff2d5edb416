//! Lens distortion: OpenCV's models on the normalised image plane (x right, y down, z = 1).

use glam::DVec2;
use serde::{Deserialize, Serialize};

use crate::camera_error::CameraError;

/// Lens distortion. It maps normalised coordinates x/z, y/z (dimensionless); the parameters are in the order of ROS and
/// Foxglove.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub enum Distortion {
    /// No distortion.
    #[default]
    None,
    /// `plumb_bob`: k1, k2, p1, p2, k3.
    PlumbBob([f64; 5]),
    /// `rational_polynomial`: k1, k2, p1, p2, k3, k4, k5, k6.
    RationalPolynomial([f64; 8]),
    /// `equidistant`, `fisheye`, `kannala_brandt`: k1, k2, k3, k4.
    Fisheye([f64; 4]),
}

/// Greatest radius on the normalised plane (84.3° off the axis). Rays farther out cannot be used with z = 1.
const RADIUS_LIMIT: f64 = 10.0;

impl Distortion {
    /// The distortion of a calibration message. A model without parameters is [`Distortion::None`], and so is a
    /// polynomial model with only zeros. `plumb_bob` may omit k3. Parameters beyond those of the model must be zero.
    pub fn from_model(model: &str, d: &[f64]) -> Result<Distortion, CameraError> {
        if let Some(value) = d.iter().find(|v| !v.is_finite()) {
            return Err(CameraError::NotFinite { what: "distortion", value: *value });
        }
        let wrong =
            |expected| CameraError::ParameterCount { model: model.to_owned(), got: d.len(), expected };
        match model {
            "" | "none" if d.iter().all(|&v| v == 0.0) => Ok(Distortion::None),
            "plumb_bob" | "rational_polynomial" if d.iter().all(|&v| v == 0.0) => Ok(Distortion::None),
            "plumb_bob" => Ok(Distortion::PlumbBob(padded(d, 4).ok_or_else(|| wrong(5))?)),
            "rational_polynomial" => {
                Ok(Distortion::RationalPolynomial(padded(d, 8).ok_or_else(|| wrong(8))?))
            }
            // A fisheye model with only zeros still distorts: the radius is proportional to the angle.
            "equidistant" | "fisheye" | "kannala_brandt" => {
                Ok(Distortion::Fisheye(padded(d, 4).ok_or_else(|| wrong(4))?))
            }
            _ => Err(CameraError::UnknownModel { model: model.to_owned() }),
        }
    }

    /// Maps an undistorted point to its distorted position. Valid within [`Distortion::valid_radius`].
    pub fn distort(&self, p: DVec2) -> DVec2 {
        let r2 = p.length_squared();
        match *self {
            Distortion::None => p,
            Distortion::PlumbBob([_, _, p1, p2, _]) | Distortion::RationalPolynomial([_, _, p1, p2, ..]) => {
                let radial = self.radial(r2).0;
                DVec2::new(
                    p.x * radial + 2.0 * p1 * p.x * p.y + p2 * (r2 + 2.0 * p.x * p.x),
                    p.y * radial + p1 * (r2 + 2.0 * p.y * p.y) + 2.0 * p2 * p.x * p.y,
                )
            }
            Distortion::Fisheye(_) => {
                let r = libm::sqrt(r2);
                // The limit of the ratio at the axis is 1.
                if r < 1e-12 { p } else { p * (self.fisheye_radius(libm::atan(r)).0 / r) }
            }
        }
    }

    /// Maps a distorted point to the undistorted one: the inverse of [`Distortion::distort`] within `valid_radius`, by
    /// Newton's method. `None` where there is no solution.
    pub fn undistort(&self, distorted: DVec2, valid_radius: f64) -> Option<DVec2> {
        let straight = match self {
            Distortion::None => distorted,
            Distortion::PlumbBob(_) | Distortion::RationalPolynomial(_) => {
                self.undistort_polynomial(distorted, valid_radius)?
            }
            Distortion::Fisheye(_) => self.undistort_fisheye(distorted, valid_radius)?,
        };
        (straight.length() <= valid_radius).then_some(straight)
    }

    /// Radius on the normalised plane up to which the distorted radius increases with the undistorted one. Beyond it
    /// the polynomial decreases, and points outside of the field of view would project into the image.
    pub fn valid_radius(&self) -> f64 {
        const STEPS: u32 = 2000;
        let grows = |r: f64| match self {
            Distortion::None => true,
            Distortion::PlumbBob(_) | Distortion::RationalPolynomial(_) => {
                let (radial, slope) = self.radial(r * r);
                radial > 0.0 && radial + 2.0 * r * r * slope > 0.0
            }
            Distortion::Fisheye(_) => self.fisheye_radius(libm::atan(r)).1 > 0.0,
        };
        let step = RADIUS_LIMIT / f64::from(STEPS);
        let turn = (1..=STEPS).map(|i| f64::from(i) * step).find(|&r| !grows(r));
        turn.map_or(RADIUS_LIMIT, |r| r - step)
    }

    /// Radial factor at r² and its derivative with respect to r².
    fn radial(&self, r2: f64) -> (f64, f64) {
        let cubic =
            |a: f64, b: f64, c: f64| (1.0 + r2 * (a + r2 * (b + r2 * c)), a + r2 * (2.0 * b + 3.0 * r2 * c));
        match *self {
            Distortion::PlumbBob([k1, k2, _, _, k3]) => cubic(k1, k2, k3),
            Distortion::RationalPolynomial([k1, k2, _, _, k3, k4, k5, k6]) => {
                let ((num, num_slope), (den, den_slope)) = (cubic(k1, k2, k3), cubic(k4, k5, k6));
                (num / den, (num_slope * den - num * den_slope) / (den * den))
            }
            Distortion::None | Distortion::Fisheye(_) => (1.0, 0.0),
        }
    }

    /// Distorted radius at an angle off the axis (radians), and its derivative with respect to the angle.
    fn fisheye_radius(&self, theta: f64) -> (f64, f64) {
        let Distortion::Fisheye([k1, k2, k3, k4]) = *self else { return (theta, 1.0) };
        let t2 = theta * theta;
        (
            theta * (1.0 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4)))),
            1.0 + t2 * (3.0 * k1 + t2 * (5.0 * k2 + t2 * (7.0 * k3 + t2 * 9.0 * k4))),
        )
    }

    fn undistort_polynomial(&self, distorted: DVec2, valid_radius: f64) -> Option<DVec2> {
        let (Distortion::PlumbBob([_, _, p1, p2, _]) | Distortion::RationalPolynomial([_, _, p1, p2, ..])) =
            *self
        else {
            return Some(distorted);
        };
        let target = distorted.length();
        if !target.is_finite() {
            return None;
        }
        // The radial part alone gives a first guess on the correct side of extrema and poles; the tangential part is
        // small.
        let radius_at = |r: f64| {
            let (radial, slope) = self.radial(r * r);
            (r * radial, radial + 2.0 * r * r * slope)
        };
        let radius = invert_growing(target, valid_radius, radius_at).unwrap_or(valid_radius);
        let mut p = if target < 1e-12 { distorted } else { distorted * (radius / target) };
        let mut error = self.distort(p) - distorted;
        for _ in 0..40 {
            if error.length_squared() < 1e-26 {
                return Some(p);
            }
            let (radial, slope) = self.radial(p.length_squared());
            let cross = 2.0 * (p.x * p.y * slope + p1 * p.x + p2 * p.y);
            let dx_dx = radial + 2.0 * p.x * p.x * slope + 2.0 * p1 * p.y + 6.0 * p2 * p.x;
            let dy_dy = radial + 2.0 * p.y * p.y * slope + 6.0 * p1 * p.y + 2.0 * p2 * p.x;
            let det = dx_dx * dy_dy - cross * cross;
            if det.abs() < 1e-12 {
                return None;
            }
            let step = DVec2::new(
                (dy_dy * error.x - cross * error.y) / det,
                (dx_dx * error.y - cross * error.x) / det,
            );
            // Halving the step keeps the iteration from passing an extremum of the polynomial of a strong lens.
            let mut fraction = 1.0;
            loop {
                let candidate = p - step * fraction;
                let candidate_error = self.distort(candidate) - distorted;
                if candidate_error.length_squared() < error.length_squared() {
                    (p, error) = (candidate, candidate_error);
                    break;
                }
                fraction *= 0.5;
                if fraction < 1e-4 {
                    return (error.length_squared() < 1e-18).then_some(p);
                }
            }
        }
        (error.length_squared() < 1e-18).then_some(p)
    }

    fn undistort_fisheye(&self, distorted: DVec2, valid_radius: f64) -> Option<DVec2> {
        let target = distorted.length();
        if target < 1e-12 {
            return Some(distorted);
        }
        let theta = invert_growing(target, libm::atan(valid_radius), |theta| self.fisheye_radius(theta))?;
        Some(distorted * (libm::tan(theta) / target))
    }
}

/// Where in `0..=high` a function that increases from 0 reaches `target`: Newton's method, safeguarded by bisection.
/// The function returns its value and its slope. `None` if the function does not reach `target`, or if `target` is NaN.
fn invert_growing(target: f64, high: f64, function: impl Fn(f64) -> (f64, f64)) -> Option<f64> {
    if function(high).0.partial_cmp(&target).is_none_or(std::cmp::Ordering::is_lt) {
        return None;
    }
    let (mut low, mut high) = (0.0, high);
    let mut at = target.min(high);
    for _ in 0..60 {
        let (value, slope) = function(at);
        if value < target {
            low = at;
        } else {
            high = at;
        }
        let newton = at - (value - target) / slope;
        let next = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
        let change = (next - at).abs();
        at = next;
        if change < 1e-15 {
            break;
        }
    }
    Some(at)
}

/// The parameters, padded with zeros; `None` if there are fewer than `least`, or if one beyond the model's own is not
/// zero.
fn padded<const N: usize>(d: &[f64], least: usize) -> Option<[f64; N]> {
    if d.len() < least || d.iter().skip(N).any(|&v| v != 0.0) {
        return None;
    }
    let mut parameters = [0.0; N];
    for (parameter, &value) in parameters.iter_mut().zip(d) {
        *parameter = value;
    }
    Some(parameters)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn lens() -> impl Strategy<Value = Distortion> {
        let k = -0.4..0.4_f64;
        let p = -0.005..0.005_f64;
        prop_oneof![
            (k.clone(), -0.2..0.2_f64, p.clone(), p.clone(), -0.05..0.05_f64)
                .prop_map(|(k1, k2, p1, p2, k3)| Distortion::PlumbBob([k1, k2, p1, p2, k3])),
            (k.clone(), k.clone(), p.clone(), p, k.clone(), k.clone(), k.clone()).prop_map(
                |(k1, k2, p1, p2, k4, k5, k3)| Distortion::RationalPolynomial([
                    k1,
                    k2,
                    p1,
                    p2,
                    0.1 * k3,
                    k4,
                    0.5 * k5,
                    0.1 * k3
                ])
            ),
            prop::array::uniform4(-0.03..0.03_f64).prop_map(Distortion::Fisheye),
        ]
    }

    proptest! {
        #[test]
        fn undistort_undoes_distort_well_within_the_valid_radius(lens in lens(), x in -1.0..1.0_f64, y in -1.0..1.0_f64) {
            let valid = lens.valid_radius();
            // Tangential terms move the extremum a little, so the test stays away from it.
            let p = DVec2::new(x, y) * (0.8 * valid.min(1.2));
            prop_assume!(p.length() < 0.85 * valid);
            let back = lens.undistort(lens.distort(p), valid);
            prop_assert!(back.is_some_and(|q| q.abs_diff_eq(p, 1e-9)), "{lens:?} {p} {back:?} {valid}");
        }

        #[test]
        fn undistort_never_panics_and_what_it_gives_lands_where_asked(lens in lens(), x in -50.0..50.0_f64, y in -50.0..50.0_f64) {
            let target = DVec2::new(x, y);
            if let Some(p) = lens.undistort(target, lens.valid_radius()) {
                prop_assert!(lens.distort(p).abs_diff_eq(target, 1e-7));
            }
        }
    }

    #[test]
    fn plumb_bob_matches_values_worked_by_hand() {
        let lens = Distortion::PlumbBob([-0.2, 0.1, 0.001, -0.002, 0.05]);
        // x 0.5, y 0.25: r² 0.3125; radial 1 − 0.0625 + 0.009765625 + 0.00152587890625 = 0.94879150390625.
        let expected = DVec2::new(
            0.5 * 0.948_791_503_906_25 + 2.0 * 0.001 * 0.125 - 0.002 * 0.8125,
            0.25 * 0.948_791_503_906_25 + 0.001 * 0.4375 + 2.0 * -0.002 * 0.125,
        );
        assert!(lens.distort(DVec2::new(0.5, 0.25)).abs_diff_eq(expected, 1e-15));
    }

    #[test]
    fn fisheye_without_parameters_keeps_angles() {
        let lens = Distortion::from_model("equidistant", &[0.0; 4]).unwrap();
        let p = lens.distort(DVec2::new(1.0, 0.0));
        assert!((p.x - std::f64::consts::FRAC_PI_4).abs() < 1e-15 && p.y == 0.0);
    }

    #[test]
    fn models_are_told_by_name_and_number_of_parameters() {
        assert_eq!(Distortion::from_model("plumb_bob", &[]), Ok(Distortion::None));
        assert_eq!(Distortion::from_model("plumb_bob", &[0.0; 5]), Ok(Distortion::None));
        let four = Distortion::from_model("plumb_bob", &[0.1, 0.2, 0.3, 0.4]);
        assert_eq!(four, Ok(Distortion::PlumbBob([0.1, 0.2, 0.3, 0.4, 0.0])));
        assert!(Distortion::from_model("plumb_bob", &[0.1]).is_err());
        assert!(Distortion::from_model("rational_polynomial", &[0.1; 9]).is_err());
        assert!(Distortion::from_model("fisheye62", &[0.1; 6]).is_err());
        assert!(Distortion::from_model("", &[0.1]).is_err());
        assert!(Distortion::from_model("plumb_bob", &[f64::NAN; 5]).is_err());
    }
}
