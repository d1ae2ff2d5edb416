//! Inertial sensors, satellite positions and odometry.

use super::{Conversion, Source, Unusable};
use crate::any::AnyMessage;
use crate::foxglove::{KeyValuePair, LocationFix, Odometry};
use crate::rcs;

pub(super) const IMU: Conversion = Conversion {
    from: "sensor_msgs/Imu",
    signature: "iIsdddd[9]dddd[9]dddd[9]d",
    to: "rcs.Imu",
    convert: imu,
};

pub(super) const NAV_SAT_FIX: Conversion = Conversion {
    from: "sensor_msgs/NavSatFix",
    signature: "iIscHddd[9]dB",
    to: "foxglove.LocationFix",
    convert: nav_sat_fix,
};

pub(super) const ODOMETRY: Conversion = Conversion {
    from: "nav_msgs/Odometry",
    signature: "iIssddddddd[36]ddddddd[36]d",
    to: "foxglove.Odometry",
    convert: odometry,
};

/// In ROS 2 a covariance that starts with -1 marks a quantity that is not measured.
fn imu(source: &mut Source<'_>) -> Result<AnyMessage, Unusable> {
    fn measured<T>(value: T, covariance: Vec<f64>) -> (Option<T>, Vec<f64>) {
        if covariance.first() == Some(&-1.0) { (None, Vec::new()) } else { (Some(value), covariance) }
    }
    let header = source.header()?;
    let (orientation, orientation_covariance) = measured(source.quaternion()?, source.floats(9)?);
    let (angular_velocity, angular_velocity_covariance) = measured(source.vector()?, source.floats(9)?);
    let (linear_acceleration, linear_acceleration_covariance) = measured(source.vector()?, source.floats(9)?);
    Ok(AnyMessage::new(rcs::Imu {
        timestamp: header.timestamp,
        frame_id: header.frame_id,
        orientation,
        angular_velocity,
        linear_acceleration,
        orientation_covariance,
        angular_velocity_covariance,
        linear_acceleration_covariance,
    }))
}

/// The receiver's status (-1: no fix, 0: fix, 1 and 2: augmented fix) goes into the metadata as `status`.
fn nav_sat_fix(source: &mut Source<'_>) -> Result<AnyMessage, Unusable> {
    let header = source.header()?;
    let (status, service) = (source.cursor.i8()?, source.cursor.u16()?);
    let (latitude, longitude, altitude) = (source.cursor.f64()?, source.cursor.f64()?, source.cursor.f64()?);
    let position_covariance = source.floats(9)?;
    // ROS 2 and Foxglove number the covariance types alike.
    let position_covariance_type = source.cursor.u8()?.into();
    let pair = |key: &str, value: String| KeyValuePair { key: key.to_owned(), value };
    Ok(AnyMessage::new(LocationFix {
        timestamp: header.timestamp,
        frame_id: header.frame_id,
        latitude,
        longitude,
        altitude,
        position_covariance,
        position_covariance_type,
        metadata: vec![pair("status", status.to_string()), pair("service", service.to_string())],
        ..LocationFix::default()
    }))
}

fn odometry(source: &mut Source<'_>) -> Result<AnyMessage, Unusable> {
    let header = source.header()?;
    Ok(AnyMessage::new(Odometry {
        timestamp: header.timestamp,
        frame_id: header.frame_id,
        body_frame_id: source.cursor.string()?,
        pose: Some(source.pose()?),
        pose_covariance: source.floats(36)?,
        linear_velocity: Some(source.vector()?),
        angular_velocity: Some(source.vector()?),
        velocity_covariance: source.floats(36)?,
        metadata: Vec::new(),
    }))
}
