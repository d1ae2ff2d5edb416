//! What the localization sends: both estimates, the local frame in the global one, and the slip of the wheels.

use super::{Localization, Ports};
use crate::planar::Planar;
use crate::proto::LocalizationParams;
use crate::way_slip::Slipped;
use glam::DQuat;
use rcs_geom::{Pose, wrap_angle};
use rcs_msg::Stamp;
use rcs_msg::foxglove::{FrameTransform, FrameTransforms, Odometry, Quaternion, Vector3};
use rcs_msg::rcs;
use rcs_runtime::Cycle;
use rcs_sense::pose_message;

/// Time between two global estimates that are sent, ns.
const GLOBAL_PERIOD_NS: u64 = 100_000_000;
/// Stated variance of roll and pitch: that of the filter on rough ground, rad².
const TILT_VARIANCE: f64 = 0.0012;
/// Child frame of the global estimate. The frame `vehicle` itself is a child of the local frame.
const GLOBAL_BODY: &str = "vehicle_global";

impl Localization {
    pub(super) fn publish(
        &mut self,
        time: Stamp,
        ports: &Ports,
        params: &LocalizationParams,
        cx: &mut Cycle<'_>,
    ) {
        let (Some(attitude), Some(local)) = (&self.attitude, &self.local) else { return };
        let velocity = Some(Vector3 { x: self.speed_mps, y: 0.0, z: 0.0 });
        let w = attitude.turn_radps;
        let turning = Some(Vector3 { x: w.x, y: w.y, z: w.z });
        let odometry = |frame: &str, body: &str, pose: &Pose, covariance: Vec<f64>| Odometry {
            timestamp: Some(time.to_proto()),
            frame_id: frame.to_owned(),
            body_frame_id: body.to_owned(),
            pose: Some(pose_message(pose)),
            linear_velocity: velocity,
            angular_velocity: turning,
            pose_covariance: covariance,
            ..Odometry::default()
        };
        let local_from_vehicle = Pose::new(attitude.level_from_vehicle, local.at.extend(self.height_m));
        let height_variance = local.covariance.x_axis.x;
        let message = odometry(
            &params.local_frame,
            &params.vehicle_frame,
            &local_from_vehicle,
            covariance_of(local, height_variance),
        );
        cx.write(&ports.local, time, message);
        let due = self.sent_global.is_none_or(|sent| time >= sent.after_ns(GLOBAL_PERIOD_NS));
        let (Some(global), true) = (self.global.planar(), due) else { return };
        self.sent_global = Some(time);
        // Both estimates share roll and pitch, so the transform between their frames rotates about the vertical only.
        let turn = wrap_angle(global.yaw_rad - attitude.yaw_rad());
        let [lift_m, lift_variance] = self.global.lift();
        let rotation = DQuat::from_rotation_z(turn);
        let height_m = self.height_m + lift_m;
        let shift = global.at.extend(height_m) - rotation * local_from_vehicle.translation;
        let global_from_local = Pose::new(rotation, shift);
        let message = odometry(
            &params.global_frame,
            GLOBAL_BODY,
            &(global_from_local * local_from_vehicle),
            covariance_of(global, lift_variance),
        );
        cx.write(&ports.global, time, message);
        let q = global_from_local.rotation;
        let transform = FrameTransform {
            timestamp: Some(time.to_proto()),
            parent_frame_id: params.global_frame.clone(),
            child_frame_id: params.local_frame.clone(),
            translation: Some(Vector3 { x: shift.x, y: shift.y, z: shift.z }),
            rotation: Some(Quaternion { x: q.x, y: q.y, z: q.z, w: q.w }),
        };
        cx.write(&ports.transforms, time, FrameTransforms { transforms: vec![transform] });
    }
}

pub(super) fn way_slip(slipped: &Slipped, time: Stamp) -> rcs::WaySlip {
    rcs::WaySlip {
        timestamp: Some(time.to_proto()),
        since: Some(slipped.since.to_proto()),
        rolled_m: slipped.rolled_m,
        moved_m: slipped.moved_m,
        slip: slipped.slip(),
        middle: Some(pose_message(&slipped.middle)),
    }
}

/// Row-major 6×6 covariance of x, y, z, roll, pitch, yaw: m² and rad².
fn covariance_of(planar: &Planar, height_variance: f64) -> Vec<f64> {
    let mut covariance = vec![0.0; 36];
    let places = [0, 1, 5];
    for (row, &to_row) in places.iter().enumerate() {
        for (column, &to_column) in places.iter().enumerate() {
            covariance[6 * to_row + to_column] = planar.covariance.col(column)[row];
        }
    }
    covariance[14] = height_variance;
    covariance[21] = TILT_VARIANCE;
    covariance[28] = TILT_VARIANCE;
    covariance
}
