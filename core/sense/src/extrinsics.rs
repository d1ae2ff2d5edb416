//! Poses of vehicle and sensor at a time, as the parameters of a process define them.

use crate::localizer::{FrameNames, Localizer, LocalizerError};
use crate::sensor_time::SensorTime;
use rcs_geom::{CameraError, DVec3, Distortion, PinholeCamera, Pose};
use rcs_msg::Stamp;
use rcs_msg::foxglove::CameraCalibration;
use rcs_msg::rcs::{Mount, PoseSource, VehiclePose};
use rcs_runtime::{Cycle, In, Msg};
use std::sync::LazyLock;

/// If the z component of the vehicle's up axis is below this, the vehicle lies on its side, and its sensors tell
/// nothing about the ground.
pub const MIN_UPRIGHT: f64 = 0.5;

/// The vehicle lies on its side.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("vehicle lies on its side: its up is {up_z:.2} of upright, expected at least {MIN_UPRIGHT}")]
pub struct OnItsSide {
    /// z component of the vehicle's up axis in the local frame.
    pub up_z: f64,
}

/// Greatest roll of a camera about its view up to which the columns of its image count as upright, degrees.
pub const MAX_ROLL_DEG: f64 = 45.0;
/// A camera that looks up or down more steeply than this has no roll, degrees.
const STEEPEST_VIEW_DEG: f64 = 84.0;

/// The camera is mounted on its side or upside down.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("camera is rolled by {roll_deg:.0}°, expected at most {MAX_ROLL_DEG}° either way")]
pub struct Rolled {
    /// Roll about the view, degrees; positive where the right side is lower.
    pub roll_deg: f64,
}

/// Axes of the frame of a sensor's data.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axes {
    /// x right, y down, z along the view: cameras.
    Optical,
    /// x forward, y left, z up: scanners.
    Body,
}

/// How a process finds the poses of its vehicle and sensor, from its parameters.
#[derive(Clone, Copy, Debug)]
pub struct Extrinsics<'a> {
    /// Names of the frames.
    pub frames: FrameNames<'a>,
    /// Whether the vehicle stands level at the origin of the local frame.
    pub fixed_pose: bool,
    /// Greatest accepted age of a pose, s.
    pub max_age_s: f64,
    /// Pose of the sensor on the vehicle, body axes, if the parameters give it.
    pub vehicle_from_mount: Option<Pose>,
}

impl<'a> Extrinsics<'a> {
    /// From the parameters of a process. A plan sets every group; defaults apply to a group that is absent.
    pub fn new(pose: Option<&'a VehiclePose>, mount: Option<&Mount>) -> Extrinsics<'a> {
        static DEFAULT: LazyLock<VehiclePose> = LazyLock::new(rcs_msg::params::default);
        let pose = pose.unwrap_or(&DEFAULT);
        Extrinsics {
            frames: FrameNames {
                local: &pose.local_frame,
                vehicle: &pose.vehicle_frame,
                pose: &pose.stream_frame,
            },
            fixed_pose: pose.source() == PoseSource::PoseFixed,
            max_age_s: pose.max_age_s,
            vehicle_from_mount: mount.filter(|mount| mount.fixed).map(|mount| {
                Pose::from_rpy(
                    DVec3::new(mount.x_m, mount.y_m, mount.height_m),
                    mount.roll_deg.to_radians(),
                    mount.pitch_deg.to_radians(),
                    mount.yaw_deg.to_radians(),
                )
            }),
        }
    }

    /// The same for another sensor, to which the mount parameters do not apply.
    #[must_use]
    pub fn without_mount(self) -> Extrinsics<'a> {
        Extrinsics { vehicle_from_mount: None, ..self }
    }

    /// Pose of the vehicle in the local frame at a time.
    pub fn local_from_vehicle(
        &self,
        localizer: &Localizer,
        time: impl Into<SensorTime>,
    ) -> Result<Pose, LocalizerError> {
        if self.fixed_pose {
            return Ok(Pose::IDENTITY);
        }
        localizer.local_from_vehicle(self.frames, time, self.max_age_s)
    }

    /// Pose of the frame of a sensor's data on the vehicle at a time. Refuses data in body axes whose frame is named as
    /// an optical one, where the parameters give the mount: it would turn them by 90°.
    pub fn vehicle_from_sensor(
        &self,
        localizer: &Localizer,
        frame_id: &str,
        axes: Axes,
        time: impl Into<SensorTime>,
    ) -> Result<Pose, LocalizerError> {
        match (self.vehicle_from_mount, axes) {
            (Some(mount), Axes::Optical) => Ok(mount * Pose::body_from_optical()),
            (Some(_), Axes::Body) if frame_id.ends_with("optical") || frame_id.ends_with("optical_frame") => {
                Err(LocalizerError::OpticalFrame { frame: frame_id.to_owned() })
            }
            (Some(mount), Axes::Body) => Ok(mount),
            (None, _) => localizer.lookup(self.frames.vehicle, frame_id, time, self.max_age_s),
        }
    }

    /// Mean speed (m/s) and turn rate (rad/s) over the `window_s` before a time; `None` if poses do not reach back that
    /// far.
    pub fn motion(
        &self,
        localizer: &Localizer,
        time: impl Into<SensorTime>,
        window_s: f64,
    ) -> Option<[f64; 2]> {
        let time = localizer.time_of_pose(self.frames, time.into());
        let before = Stamp(time.0.checked_sub((window_s * 1e9) as u64)?);
        let now = self.local_from_vehicle(localizer, time).ok()?;
        let then = self.local_from_vehicle(localizer, before).ok()?;
        let moved = now.translation.distance(then.translation);
        let turned = rcs_geom::wrap_angle(now.yaw() - then.yaw()).abs();
        Some([moved / window_s, turned / window_s])
    }
}

/// The up axis of the vehicle in the local frame; an error if the vehicle lies on its side.
pub fn upright(local_from_vehicle: &Pose) -> Result<DVec3, OnItsSide> {
    let up = local_from_vehicle.rotate(DVec3::Z);
    if up.z < MIN_UPRIGHT { Err(OnItsSide { up_z: up.z }) } else { Ok(up) }
}

/// Roll of a camera about its view, degrees, from the pose of its optical frame on the vehicle: 0 for an upright camera
/// and for one that looks straight up or down, positive where its right side is lower, ±180 upside down.
pub fn camera_roll_deg(vehicle_from_camera: &Pose) -> f64 {
    let vehicle_from_mount = *vehicle_from_camera * Pose::body_from_optical().inverse();
    let [roll_deg, pitch_deg, _] = vehicle_from_mount.rpy().map(f64::to_degrees);
    if pitch_deg.abs() > STEEPEST_VIEW_DEG { 0.0 } else { roll_deg }
}

/// An error unless the columns of a camera's image are upright, with the lowest rays in the last row.
pub fn upright_columns(vehicle_from_camera: &Pose) -> Result<(), Rolled> {
    let roll_deg = camera_roll_deg(vehicle_from_camera);
    if roll_deg.abs() > MAX_ROLL_DEG { Err(Rolled { roll_deg }) } else { Ok(()) }
}

/// The camera of a calibration message: that of the raw images (K and D), or, if `rectified`, that of the images which
/// were rectified by it (P, without distortion). ROS sends one calibration for both.
pub fn camera_of(calibration: &CameraCalibration, rectified: bool) -> Result<PinholeCamera, CameraError> {
    let size = [calibration.width, calibration.height];
    if !rectified {
        let (model, d) = (&calibration.distortion_model, &calibration.d);
        return PinholeCamera::from_calibration(size, &calibration.k, model, d);
    }
    let &[fx, _, cx, _, _, fy, cy, _, _, _, _, _] = calibration.p.as_slice() else {
        let got = calibration.p.len();
        return Err(CameraError::MatrixSize { what: "projection matrix", got, expected: 12 });
    };
    PinholeCamera::new(size, [fx, fy], [cx, cy], Distortion::None)
}

/// Reads a port of calibrations, of raw or `rectified` images: the newest unread one. A process without a camera
/// (`has_camera` is false) also gets the newest one that has been read before, if it is one of a camera: after `INIT` the
/// process has lost what it had read, and many drivers send the calibration only once.
pub fn read_calibration(
    port: &In<CameraCalibration>,
    has_camera: bool,
    rectified: bool,
    cx: &mut Cycle<'_>,
) -> Option<Msg<CameraCalibration>> {
    let unread = cx.read_newest(port);
    if has_camera || unread.is_some() {
        return unread;
    }
    cx.latest(port).filter(|calibration| camera_of(calibration, rectified).is_ok())
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcs_geom::DVec2;

    #[test]
    fn a_fixed_mount_needs_no_transform_and_another_sensor_does() {
        let pose = VehiclePose { source: PoseSource::PoseFixed.into(), ..rcs_msg::params::default() };
        let mount = Mount { fixed: true, x_m: 0.5, ..rcs_msg::params::default() };
        let extrinsics = Extrinsics::new(Some(&pose), Some(&mount));
        let localizer = Localizer::default();
        assert_eq!(extrinsics.local_from_vehicle(&localizer, Stamp(7)), Ok(Pose::IDENTITY));
        let camera = extrinsics.vehicle_from_sensor(&localizer, "camera", Axes::Optical, Stamp(7)).unwrap();
        assert_eq!(camera.translation, DVec3::new(0.5, 0.0, 1.0));
        assert!((camera.rotate(DVec3::Z) - DVec3::X).length() < 1e-12);
        let scanner = extrinsics.vehicle_from_sensor(&localizer, "scanner", Axes::Body, Stamp(7)).unwrap();
        assert!((scanner.rotate(DVec3::X) - DVec3::X).length() < 1e-12);
        let other =
            extrinsics.without_mount().vehicle_from_sensor(&localizer, "camera", Axes::Optical, Stamp(7));
        assert!(matches!(other, Err(LocalizerError::Transform(_))), "{other:?}");
    }

    #[test]
    fn data_of_an_optical_frame_in_body_axes_are_refused_with_a_mount_and_placed_by_transforms() {
        let mount = Mount { fixed: true, ..rcs_msg::params::default() };
        let (with_mount, without) = (Extrinsics::new(None, Some(&mount)), Extrinsics::new(None, None));
        let localizer = Localizer::default();
        let find = |extrinsics: Extrinsics<'_>, frame_id: &str, axes: Axes| {
            extrinsics.vehicle_from_sensor(&localizer, frame_id, axes, Stamp(7))
        };
        let refused = find(with_mount, "camera_depth_optical_frame", Axes::Body).unwrap_err();
        assert!(refused.to_string().contains("\"camera_depth_optical_frame\""), "{refused}");
        assert!(find(with_mount, "camera_depth_optical_frame", Axes::Optical).is_ok());
        assert!(find(with_mount, "camera_link", Axes::Body).is_ok());
        let unknown = find(without, "camera_depth_optical_frame", Axes::Body);
        assert!(matches!(unknown, Err(LocalizerError::Transform(_))), "{unknown:?}");
    }

    #[test]
    fn rectified_images_have_the_rays_of_the_projection_matrix() {
        let calibration = CameraCalibration {
            width: 320,
            height: 240,
            distortion_model: "plumb_bob".to_owned(),
            d: vec![-0.3, 0.1, 0.0, 0.0, 0.0],
            k: vec![200.0, 0.0, 159.5, 0.0, 200.0, 119.5, 0.0, 0.0, 1.0],
            p: vec![180.0, 0.0, 150.0, -9.0, 0.0, 190.0, 110.0, 0.0, 0.0, 0.0, 1.0, 0.0],
            ..CameraCalibration::default()
        };
        let camera = camera_of(&calibration, true).unwrap();
        for [column, row] in [[0.0, 0.0], [150.0, 110.0], [319.0, 239.0]] {
            let ray = camera.unproject(DVec2::new(column, row)).unwrap();
            let expected = DVec3::new((column - 150.0) / 180.0, (row - 110.0) / 190.0, 1.0);
            assert!(ray.abs_diff_eq(expected, 1e-12), "{ray} at {column}, {row}");
        }
        let raw = camera_of(&calibration, false).unwrap();
        assert_eq!((raw.fx, raw.distortion == Distortion::None), (200.0, false));
        let without = camera_of(&CameraCalibration { p: Vec::new(), ..calibration }, true).unwrap_err();
        assert_eq!(without.to_string(), "projection matrix has 0 entries, expected 12");
    }

    #[test]
    fn a_camera_on_its_side_or_upside_down_is_told() {
        let camera = |roll_deg: f64, pitch_deg: f64, yaw_deg: f64| {
            let [roll, pitch, yaw] = [roll_deg, pitch_deg, yaw_deg].map(f64::to_radians);
            Pose::from_rpy(DVec3::Z, roll, pitch, yaw) * Pose::body_from_optical()
        };
        for roll_deg in [-170.0, -90.0, -46.0, -44.0, 0.0, 44.0, 46.0, 90.0, 170.0_f64] {
            let camera = camera(roll_deg, 20.0, 130.0);
            assert!((camera_roll_deg(&camera) - roll_deg).abs() < 1e-9, "{roll_deg}");
            assert_eq!(upright_columns(&camera).is_ok(), roll_deg.abs() < 45.0, "{roll_deg}");
        }
        assert!(camera_roll_deg(&camera(180.0, 20.0, 0.0)).abs() > 179.9);
        assert!(upright_columns(&camera(0.0, 90.0, 30.0)).is_ok(), "it looks straight down");
        let on_its_side = upright_columns(&camera(90.0, 0.0, 0.0)).unwrap_err();
        assert_eq!(on_its_side.to_string(), "camera is rolled by 90°, expected at most 45° either way");
    }

    #[test]
    fn a_group_that_is_absent_has_its_defaults() {
        let extrinsics = Extrinsics::new(None, None);
        assert_eq!(extrinsics.frames, FrameNames { local: "local", vehicle: "vehicle", pose: "" });
        assert_eq!((extrinsics.fixed_pose, extrinsics.max_age_s), (false, 0.5));
    }

    #[test]
    fn a_vehicle_on_its_side_is_told() {
        let rolled = |roll_rad| upright(&Pose::from_rpy(DVec3::ZERO, roll_rad, 0.0, 0.0));
        assert!(rolled(1.0).is_ok());
        assert!(rolled(1.1).is_err());
    }
}
