//! Poses of vehicle and sensor at a time, as the parameters of a process define them.

use crate::localizer::{FrameNames, Localizer, LocalizerError};
use crate::sensor_time::SensorTime;
use rcs_geom::{CameraError, DVec3, PinholeCamera, Pose};
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

    /// Pose of the frame of a sensor's data on the vehicle at a time.
    pub fn vehicle_from_sensor(
        &self,
        localizer: &Localizer,
        frame_id: &str,
        axes: Axes,
        time: impl Into<SensorTime>,
    ) -> Result<Pose, LocalizerError> {
        match (self.vehicle_from_mount, axes) {
            (Some(mount), Axes::Optical) => Ok(mount * Pose::body_from_optical()),
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

/// The camera of a calibration message.
pub fn camera_of(calibration: &CameraCalibration) -> Result<PinholeCamera, CameraError> {
    PinholeCamera::from_calibration(
        [calibration.width, calibration.height],
        &calibration.k,
        &calibration.distortion_model,
        &calibration.d,
    )
}

/// Reads a port of calibrations: the newest unread one. A process without a camera (`has_camera` is false) also gets the
/// newest one that has been read before, if it is one of a camera: after `INIT` the process has lost what it had read, and
/// many drivers send the calibration only once.
pub fn read_calibration(
    port: &In<CameraCalibration>,
    has_camera: bool,
    cx: &mut Cycle<'_>,
) -> Option<Msg<CameraCalibration>> {
    let unread = cx.read_newest(port);
    if has_camera || unread.is_some() {
        return unread;
    }
    cx.latest(port).filter(|calibration| camera_of(calibration).is_ok())
}

#[cfg(test)]
mod tests {
    use super::*;

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
