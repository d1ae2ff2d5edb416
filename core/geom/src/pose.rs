//! Rigid transforms.

use std::f64::consts::PI;
use std::ops::Mul;

use glam::{DMat3, DQuat, DVec3, EulerRot};
use serde::{Deserialize, Serialize};

/// Why numbers do not describe a pose.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum PoseError {
    /// A component is NaN or infinite.
    #[error("pose is not finite: got translation {translation:?} and rotation {rotation_xyzw:?}")]
    NotFinite {
        /// Metres.
        translation: [f64; 3],
        /// Components x, y, z, w.
        rotation_xyzw: [f64; 4],
    },
    /// The length of the quaternion is too far from 1.
    #[error("rotation has norm {norm}, expected about 1")]
    NotARotation {
        /// Length of the quaternion.
        norm: f64,
    },
}

/// A rigid transform: the pose of frame B in frame A, written `a_from_b`.
///
/// `a_from_b * p_b` is the point in A; `a_from_b * b_from_c` is `a_from_c`.
/// The rotation is a unit quaternion. The default is the identity.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Pose {
    /// Rotates directions of B into A.
    pub rotation: DQuat,
    /// Position of B's origin in A, metres.
    pub translation: DVec3,
}

impl Pose {
    /// The identity: both frames coincide.
    pub const IDENTITY: Pose = Pose { rotation: DQuat::IDENTITY, translation: DVec3::ZERO };

    /// `rotation` must be a unit quaternion. Use [`Pose::from_parts`] for numbers from outside of the program.
    pub const fn new(rotation: DQuat, translation: DVec3) -> Pose {
        Pose { rotation, translation }
    }

    /// A translation, metres.
    pub const fn from_translation(translation: DVec3) -> Pose {
        Pose { rotation: DQuat::IDENTITY, translation }
    }

    /// A rotation about z, counter-clockwise from x, radians.
    pub fn from_yaw(yaw_rad: f64) -> Pose {
        Pose { rotation: DQuat::from_rotation_z(yaw_rad), translation: DVec3::ZERO }
    }

    /// A planar pose: metres and radians.
    pub fn from_xy_yaw(x_m: f64, y_m: f64, yaw_rad: f64) -> Pose {
        Pose { rotation: DQuat::from_rotation_z(yaw_rad), translation: DVec3::new(x_m, y_m, 0.0) }
    }

    /// Roll about x, then pitch about y, then yaw about z, all about the fixed axes (`Rz·Ry·Rx`), radians.
    /// Positive pitch lowers the front of a vehicle with x forward and z up.
    pub fn from_rpy(translation: DVec3, roll_rad: f64, pitch_rad: f64, yaw_rad: f64) -> Pose {
        Pose { rotation: DQuat::from_euler(EulerRot::ZYX, yaw_rad, pitch_rad, roll_rad), translation }
    }

    /// A pose from the numbers of a message: metres, and the quaternion x, y, z, w, which is normalised here. Refuses
    /// numbers that are not finite and a quaternion whose length differs from 1 by more than 10 %.
    pub fn from_parts(translation: [f64; 3], rotation_xyzw: [f64; 4]) -> Result<Pose, PoseError> {
        let rotation = DQuat::from_array(rotation_xyzw);
        if !translation.iter().chain(&rotation_xyzw).all(|v| v.is_finite()) {
            return Err(PoseError::NotFinite { translation, rotation_xyzw });
        }
        let norm = rotation.length();
        if !(0.9..=1.1).contains(&norm) {
            return Err(PoseError::NotARotation { norm });
        }
        Ok(Pose { rotation: rotation.normalize(), translation: DVec3::from_array(translation) })
    }

    /// `body_from_optical` of a camera that looks along the body's x axis: rotates optical axes (x right, y down, z
    /// forward) into body axes (x forward, y left, z up).
    pub fn body_from_optical() -> Pose {
        Pose { rotation: DQuat::from_xyzw(-0.5, 0.5, -0.5, 0.5), translation: DVec3::ZERO }
    }

    /// The inverse: `b_from_a`.
    #[must_use]
    pub fn inverse(&self) -> Pose {
        let rotation = self.rotation.conjugate();
        Pose { rotation, translation: -(rotation * self.translation) }
    }

    /// Rotates a direction of B into A, without the translation.
    #[inline]
    pub fn rotate(&self, vector: DVec3) -> DVec3 {
        self.rotation * vector
    }

    /// The rotation as a matrix whose columns are B's axes in A.
    pub fn rotation_matrix(&self) -> DMat3 {
        DMat3::from_quat(self.rotation)
    }

    /// Yaw: angle of B's x axis in A's x-y plane, in (−π, π], radians.
    pub fn yaw(&self) -> f64 {
        let forward = self.rotation * DVec3::X;
        libm::atan2(forward.y, forward.x)
    }

    /// Roll, pitch and yaw, the arguments of [`Pose::from_rpy`], radians.
    pub fn rpy(&self) -> [f64; 3] {
        let (yaw, pitch, roll) = self.rotation.to_euler(EulerRot::ZYX);
        [roll, pitch, yaw]
    }

    /// Interpolates between `self` (0) and `end` (1): the position on a straight line, the rotation on the shortest arc
    /// at a constant rate. Fractions outside of 0 to 1 extrapolate.
    #[must_use]
    pub fn interpolate(&self, end: &Pose, fraction: f64) -> Pose {
        Pose {
            rotation: self.rotation.slerp(end.rotation, fraction).normalize(),
            translation: self.translation + (end.translation - self.translation) * fraction,
        }
    }

    /// Whether all numbers are finite.
    pub fn is_finite(&self) -> bool {
        self.rotation.is_finite() && self.translation.is_finite()
    }
}

impl Default for Pose {
    fn default() -> Self {
        Pose::IDENTITY
    }
}

impl Mul for Pose {
    type Output = Pose;

    fn mul(self, b_from_c: Pose) -> Pose {
        Pose {
            // Normalising keeps rounding errors from accumulating over long chains of poses.
            rotation: (self.rotation * b_from_c.rotation).normalize(),
            translation: self * b_from_c.translation,
        }
    }
}

impl Mul<DVec3> for Pose {
    type Output = DVec3;

    #[inline]
    fn mul(self, p_b: DVec3) -> DVec3 {
        self.rotation * p_b + self.translation
    }
}

/// The same angle in (−π, π], radians. NaN and infinity give NaN.
pub fn wrap_angle(angle_rad: f64) -> f64 {
    let wrapped = libm::remainder(angle_rad, 2.0 * PI);
    if wrapped <= -PI { wrapped + 2.0 * PI } else { wrapped }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn pose() -> impl Strategy<Value = Pose> {
        (
            prop::array::uniform3(-100.0..100.0_f64),
            -PI..PI,
            -1.5..1.5_f64, // avoids gimbal lock
            -PI..PI,
        )
            .prop_map(|(t, r, p, y)| Pose::from_rpy(DVec3::from_array(t), r, p, y))
    }

    fn near(a: Pose, b: Pose, tolerance: f64) -> bool {
        a.translation.abs_diff_eq(b.translation, tolerance)
            && a.rotation_matrix().abs_diff_eq(b.rotation_matrix(), tolerance)
    }

    proptest! {
        #[test]
        fn inverse_undoes(a_from_b in pose()) {
            prop_assert!(near(a_from_b * a_from_b.inverse(), Pose::IDENTITY, 1e-12));
        }

        #[test]
        fn composition_equals_homogeneous_matrices(a_from_b in pose(), b_from_c in pose(),
                                                   p in prop::array::uniform3(-50.0..50.0_f64)) {
            let p_c = DVec3::from_array(p);
            let p_b = b_from_c.rotation_matrix() * p_c + b_from_c.translation;
            let p_a = a_from_b.rotation_matrix() * p_b + a_from_b.translation;
            prop_assert!(((a_from_b * b_from_c) * p_c).abs_diff_eq(p_a, 1e-10));
        }

        #[test]
        fn roll_pitch_yaw_round_trip(a_from_b in pose()) {
            let [roll, pitch, yaw] = a_from_b.rpy();
            prop_assert!(near(Pose::from_rpy(a_from_b.translation, roll, pitch, yaw), a_from_b, 1e-9));
            prop_assert!((wrap_angle(a_from_b.yaw() - yaw)).abs() < 1e-9);
        }

        #[test]
        fn interpolation_starts_ends_and_turns_evenly(yaw in -3.0..3.0_f64, turn in -3.0..3.0_f64, s in 0.0..=1.0_f64) {
            let (a, b) = (Pose::from_xy_yaw(1.0, 2.0, yaw), Pose::from_xy_yaw(5.0, -2.0, yaw + turn));
            prop_assert!(near(a.interpolate(&b, 0.0), a, 1e-12));
            prop_assert!(near(a.interpolate(&b, 1.0), b, 1e-12));
            prop_assert!(near(a.interpolate(&b, s), Pose::from_xy_yaw(1.0 + 4.0 * s, 2.0 - 4.0 * s, yaw + turn * s), 1e-9));
        }

        #[test]
        fn wrapped_angles_are_the_same_direction(angle in -1e4..1e4_f64) {
            let wrapped = wrap_angle(angle);
            prop_assert!(wrapped > -PI && wrapped <= PI);
            prop_assert!((libm::sin(wrapped) - libm::sin(angle)).abs() < 1e-9);
            prop_assert!((libm::cos(wrapped) - libm::cos(angle)).abs() < 1e-9);
        }
    }

    #[test]
    fn optical_axes_become_body_axes() {
        let body_from_optical = Pose::body_from_optical();
        assert!((body_from_optical * DVec3::Z).abs_diff_eq(DVec3::X, 1e-15));
        assert!((body_from_optical * DVec3::X).abs_diff_eq(-DVec3::Y, 1e-15));
        assert!((body_from_optical * DVec3::Y).abs_diff_eq(-DVec3::Z, 1e-15));
    }

    #[test]
    fn positive_pitch_lowers_the_nose() {
        assert!((Pose::from_rpy(DVec3::ZERO, 0.0, 0.1, 0.0) * DVec3::X).z < 0.0);
    }

    #[test]
    fn numbers_that_are_no_pose_are_refused() {
        assert!(Pose::from_parts([0.0; 3], [0.0; 4]).is_err());
        assert!(Pose::from_parts([f64::NAN, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]).is_err());
        assert!(Pose::from_parts([0.0; 3], [0.0, 0.0, 0.0, f64::INFINITY]).is_err());
        let pose = Pose::from_parts([1.0, 2.0, 3.0], [0.0, 0.0, 0.0, 1.01]).unwrap();
        assert!((pose.rotation.length() - 1.0).abs() < 1e-15);
    }
}
