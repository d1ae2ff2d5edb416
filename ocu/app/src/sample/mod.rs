//! `ocu sample`: a small recording that the program makes itself, so that there is something to open on the first day.
//!
//! A vehicle drives along a dirt track between trees, bushes, boulders and bales. Written are a colour camera, its
//! depth and calibration, odometry (which drifts), GPS (which is noisy) and inertial measurements. The same bytes on
//! every run.

mod drive;
mod scene;

use anyhow::Context as _;
use drive::{Noise, STEP_S, State};
use glam::{DMat3, DQuat, DVec3};
use image::ExtendedColorType;
use image::codecs::jpeg::JpegEncoder;
use rcs_log::{ChannelId, LogWriter, WriteHeader, WriterOptions};
use rcs_msg::{AnyMessage, Payload, Stamp, foxglove, rcs};
use scene::{CENTRE_PX, FOCAL_PX, HEIGHT, MOUNT_M, MOUNT_PITCH_RAD, Scene, WIDTH};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

/// Start of the recording: 2026-01-01 00:00:00 UTC.
const START: Stamp = Stamp(1_767_225_600_000_000_000);
/// Where the drive begins on Earth.
const ORIGIN_DEG: [f64; 2] = [39.1395, -77.2180];
const SEED: u64 = 4;
/// Steps of [`STEP_S`] between two messages.
const CAMERA_EVERY: usize = 20;
const ODOMETRY_EVERY: usize = 5;
const IMU_EVERY: usize = 2;
const GPS_EVERY: usize = 100;

/// Writes the recording to `path`; `duration_s` of it (20 by default).
pub fn write(path: &Path, duration_s: f64) -> anyhow::Result<()> {
    // Chunks are closed by size alone: a clock would make the bytes depend on the machine's speed.
    let options = WriterOptions { clock: Arc::new(|| Duration::ZERO), ..WriterOptions::default() };
    let mut out = Recording { writer: LogWriter::create(path, options)?, channels: BTreeMap::new() };
    let states = drive::states(duration_s);
    let scene = Scene::beside(&states, SEED);
    let mut noise = Noise::new(SEED);
    let mut drift = Drift::default();

    out.put("/tf_static", "transforms", 0.0, mount())?;
    for (index, state) in states.iter().enumerate() {
        let time_s = state.time_s;
        drift.advance(state, &mut noise);
        if index % IMU_EVERY == 0 {
            out.put("/imu", "imu", time_s, imu(state, &mut noise))?;
        }
        if index % ODOMETRY_EVERY == 0 {
            out.put("/odometry", "pose", time_s, odometry(state, &drift))?;
        }
        if index % GPS_EVERY == 0 {
            out.put("/gps/fix", "fix", time_s, fix(state, &mut noise))?;
        }
        if index % CAMERA_EVERY == 0 {
            let picture = scene.picture(state);
            out.put("/camera/calibration", "calibration", time_s, calibration(time_s))?;
            out.put("/camera/image", "image", time_s, colour(time_s, &picture.rgb)?)?;
            out.put("/camera/depth", "depth", time_s, depth(time_s, &picture.depth_mm))?;
        }
    }
    out.writer.finish().context("cannot finish the recording")
}

struct Recording {
    writer: LogWriter,
    channels: BTreeMap<&'static str, (ChannelId, u32)>,
}

impl Recording {
    fn put<T: Payload>(
        &mut self,
        topic: &'static str,
        role: &str,
        time_s: f64,
        value: T,
    ) -> anyhow::Result<()> {
        let message = AnyMessage::new(value);
        if !self.channels.contains_key(topic) {
            let metadata = BTreeMap::from([("rcs.role".to_owned(), role.to_owned())]);
            let id = self.writer.add_channel(topic, &message.schema(), &metadata)?;
            self.channels.insert(topic, (id, 0));
        }
        let Some((channel, sequence)) = self.channels.get_mut(topic) else { return Ok(()) };
        *sequence += 1;
        let stamp = stamp(time_s);
        let header = WriteHeader { sequence: *sequence, log_time: stamp, publish_time: stamp };
        Ok(self.writer.write(*channel, header, &message.bytes())?)
    }
}

fn stamp(time_s: f64) -> Stamp {
    START.after_ns((time_s * 1e9).round() as u64)
}

/// What wheel odometry gets wrong: distance and direction drift apart from the truth.
#[derive(Default)]
struct Drift {
    position_m: DVec3,
    yaw_rad: f64,
}

impl Drift {
    fn advance(&mut self, state: &State, noise: &mut Noise) {
        let moving = if state.speed_mps > 0.0 { 1.0 } else { 0.0 };
        self.yaw_rad += moving * (0.000_05 + noise.normal(0.000_2));
        let yaw = state.yaw_rad + self.yaw_rad;
        let measured = state.speed_mps * 1.015;
        self.position_m += DVec3::new(libm::cos(yaw), libm::sin(yaw), 0.0) * measured * STEP_S;
    }
}

fn vector(v: DVec3) -> foxglove::Vector3 {
    foxglove::Vector3 { x: v.x, y: v.y, z: v.z }
}

fn quaternion(q: DQuat) -> foxglove::Quaternion {
    foxglove::Quaternion { x: q.x, y: q.y, z: q.z, w: q.w }
}

/// The camera on the vehicle, as an optical frame (z forward, x right, y down).
fn mount() -> foxglove::FrameTransforms {
    let (sin, cos) = (libm::sin(MOUNT_PITCH_RAD), libm::cos(MOUNT_PITCH_RAD));
    let vehicle_from_camera =
        DMat3::from_cols(DVec3::new(0.0, -1.0, 0.0), DVec3::new(-sin, 0.0, -cos), DVec3::new(cos, 0.0, -sin));
    foxglove::FrameTransforms {
        transforms: vec![foxglove::FrameTransform {
            timestamp: Some(START.to_proto()),
            parent_frame_id: "vehicle".to_owned(),
            child_frame_id: "camera".to_owned(),
            translation: Some(vector(MOUNT_M)),
            rotation: Some(quaternion(DQuat::from_mat3(&vehicle_from_camera))),
        }],
    }
}

fn odometry(state: &State, drift: &Drift) -> foxglove::Odometry {
    let local_from_vehicle =
        DQuat::from_rotation_z(state.yaw_rad + drift.yaw_rad) * DQuat::from_rotation_y(state.pitch_rad);
    foxglove::Odometry {
        timestamp: Some(stamp(state.time_s).to_proto()),
        frame_id: "local".to_owned(),
        body_frame_id: "vehicle".to_owned(),
        pose: Some(foxglove::Pose {
            position: Some(vector(drift.position_m)),
            orientation: Some(quaternion(local_from_vehicle)),
        }),
        linear_velocity: Some(vector(DVec3::X * state.speed_mps)),
        angular_velocity: Some(vector(DVec3::Z * state.yaw_rate_radps)),
        ..foxglove::Odometry::default()
    }
}

fn fix(state: &State, noise: &mut Noise) -> foxglove::LocationFix {
    const SIGMA_M: f64 = 0.35;
    let [latitude_deg, longitude_deg] = ORIGIN_DEG;
    let east_m = state.position_m.x + noise.normal(SIGMA_M);
    let north_m = state.position_m.y + noise.normal(SIGMA_M);
    // Over some tens of metres a sphere of the mean radius is as good as the ellipsoid.
    let metre_deg = 360.0 / (std::f64::consts::TAU * 6_371_008.8);
    foxglove::LocationFix {
        timestamp: Some(stamp(state.time_s).to_proto()),
        frame_id: "gps".to_owned(),
        latitude: latitude_deg + north_m * metre_deg,
        longitude: longitude_deg + east_m * metre_deg / libm::cos(latitude_deg.to_radians()),
        altitude: 120.0 + noise.normal(2.0 * SIGMA_M),
        position_covariance: DMat3::from_diagonal(DVec3::new(1.0, 1.0, 4.0) * SIGMA_M * SIGMA_M)
            .to_cols_array()
            .to_vec(),
        position_covariance_type: foxglove::location_fix::PositionCovarianceType::DiagonalKnown.into(),
        ..foxglove::LocationFix::default()
    }
}

fn imu(state: &State, noise: &mut Noise) -> rcs::Imu {
    let mut noisy =
        |v: DVec3, sigma: f64| v + DVec3::new(noise.normal(sigma), noise.normal(sigma), noise.normal(sigma));
    let turning = state.speed_mps * state.yaw_rate_radps;
    let acceleration = noisy(DVec3::new(state.acceleration_mps2, turning, 9.81), 0.08);
    let rate = noisy(DVec3::new(0.0, 0.0, state.yaw_rate_radps), 0.004);
    rcs::Imu {
        timestamp: Some(stamp(state.time_s).to_proto()),
        frame_id: "vehicle".to_owned(),
        angular_velocity: Some(vector(rate)),
        linear_acceleration: Some(vector(acceleration)),
        ..rcs::Imu::default()
    }
}

fn calibration(time_s: f64) -> foxglove::CameraCalibration {
    let [cx, cy] = CENTRE_PX;
    foxglove::CameraCalibration {
        timestamp: Some(stamp(time_s).to_proto()),
        frame_id: "camera".to_owned(),
        width: WIDTH as u32,
        height: HEIGHT as u32,
        distortion_model: String::new(),
        d: Vec::new(),
        k: vec![FOCAL_PX, 0.0, cx, 0.0, FOCAL_PX, cy, 0.0, 0.0, 1.0],
        r: vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        p: vec![FOCAL_PX, 0.0, cx, 0.0, 0.0, FOCAL_PX, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
    }
}

fn colour(time_s: f64, rgb: &[u8]) -> anyhow::Result<foxglove::CompressedImage> {
    let mut jpeg = Vec::new();
    JpegEncoder::new_with_quality(&mut jpeg, 80)
        .encode(rgb, WIDTH as u32, HEIGHT as u32, ExtendedColorType::Rgb8)
        .context("cannot compress the picture")?;
    Ok(foxglove::CompressedImage {
        timestamp: Some(stamp(time_s).to_proto()),
        frame_id: "camera".to_owned(),
        data: jpeg.into(),
        format: "jpeg".to_owned(),
    })
}

fn depth(time_s: f64, depth_mm: &[u16]) -> foxglove::RawImage {
    foxglove::RawImage {
        timestamp: Some(stamp(time_s).to_proto()),
        frame_id: "camera".to_owned(),
        width: WIDTH as u32,
        height: HEIGHT as u32,
        encoding: "16UC1".to_owned(),
        step: WIDTH as u32 * 2,
        data: depth_mm.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>().into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recording_is_small_and_the_same_on_every_run() {
        let dir = tempfile::tempdir().unwrap();
        let (a, b) = (dir.path().join("a.mcap"), dir.path().join("b.mcap"));
        write(&a, 2.0).unwrap();
        write(&b, 2.0).unwrap();
        let bytes = std::fs::read(&a).unwrap();
        assert!(bytes.len() < 600_000, "{} bytes for 2 s", bytes.len());
        assert!(bytes == std::fs::read(&b).unwrap(), "the two recordings differ");
    }
}
