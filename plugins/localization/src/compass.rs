//! The heading that the inertial sensor states by its orientation.

use crate::proto::LocalizationParams;
use rcs_msg::foxglove::{Pose, Vector3};
use rcs_msg::rcs::Imu;
use rcs_sense::pose_of;

/// Heading at the start and its variance, rad and rad²: from the sensor, if it states one, else this one, `unstated_rad`.
pub(crate) fn start_heading(
    imu: &Imu,
    compass_rad: Option<f64>,
    unstated_rad: f64,
    params: &LocalizationParams,
) -> (f64, f64) {
    let deviation = params.start_heading_noise_deg.to_radians();
    let Some(heading_rad) = compass_rad else { return (unstated_rad, deviation * deviation) };
    let stated = imu.orientation_covariance.get(8).copied().filter(|v| v.is_finite() && *v > 0.0);
    (heading_rad, stated.unwrap_or(deviation * deviation))
}

/// Heading that the sensor states, counter-clockwise from east, rad.
pub(crate) fn compass_rad(imu: &Imu) -> Result<Option<f64>, String> {
    if imu.orientation.is_none() {
        return Ok(None);
    }
    let pose = Pose { position: Some(Vector3::default()), orientation: imu.orientation };
    let pose = pose_of(Some(&pose), "imu").map_err(|error| error.to_string())?;
    Ok(Some(pose.yaw()))
}
