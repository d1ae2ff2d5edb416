//! The process `label_overlay`: the labels of a cloud on the image of a camera.
//!
//! | port | direction | type | what |
//! | --- | --- | --- | --- |
//! | `image` | in, optional | `foxglove.RawImage` | colour image of the camera |
//! | `points` | in | `foxglove.PointCloud` | points with the field `label`, m |
//! | `calibration` | in | `foxglove.CameraCalibration` | calibration of the camera |
//! | `odometry` | in, optional | `foxglove.Odometry` | pose of the vehicle in the local frame |
//! | `pose` | in, optional | `foxglove.PoseInFrame` | pose of the vehicle, or of the frame that `pose.stream_frame` names, in the local frame |
//! | `transforms` | in, optional | `foxglove.FrameTransforms` | transforms between frames at their times |
//! | `static_transforms` | in, optional | `foxglove.FrameTransforms` | transforms that hold at all times |
//! | `labels` | out | `foxglove.RawImage` | label of each pixel that a point falls on |
//!
//! Transforms that connect the points with the camera are enough. Otherwise the way leads over the vehicle: points in the
//! local frame by the vehicle's pose (odometry, a pose stream, or fixed), the camera by its mount or by transforms.

use crate::overlay::paint;
use crate::proto::LabelOverlayParams;
use glam::DVec3;
use rcs_geom::{CameraError, PinholeCamera, Pose};
use rcs_msg::PointsError;
use rcs_msg::classes::OBSTACLE_CLASSES;
use rcs_msg::foxglove::packed_element_field::NumericType;
use rcs_msg::foxglove::{CameraCalibration, PointCloud, RawImage};
use rcs_runtime::{Cycle, In, Msg, NoCommands, Out, PortBuilder, Process, ProcessDef, Role};
use rcs_sense::{
    Axes, Extrinsics, Localizer, LocalizerError, PosePorts, SensorTime, camera_of, pose_of, read_calibration,
};
use serde::{Deserialize, Serialize};

/// State: transforms and the camera.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct LabelOverlay {
    localizer: Localizer,
    camera: Option<(String, PinholeCamera)>,
}

/// Ports of [`LabelOverlay`].
#[derive(Debug)]
pub struct Ports {
    points: In<PointCloud>,
    calibration: In<CameraCalibration>,
    poses: PosePorts,
    labels: Out<RawImage>,
}

/// Why points were skipped.
#[derive(Debug, thiserror::Error)]
enum Unusable {
    #[error("no calibration")]
    NoCalibration,
    #[error("calibration: {0}")]
    Calibration(#[from] CameraError),
    #[error("points have no field \"label\" of type uint8")]
    NoLabel,
    #[error(transparent)]
    Points(#[from] PointsError),
    #[error(transparent)]
    Pose(#[from] LocalizerError),
}

impl Process for LabelOverlay {
    type Params = LabelOverlayParams;
    type Ports = Ports;
    type Command = NoCommands;
    const DEF: ProcessDef = ProcessDef {
        plugin: "label_overlay",
        summary: "Projects the labels of a point cloud into the image of a camera",
        period_ms: 200.0,
        latency_ms: 12.0,
        reads_ground_truth: false,
    };

    fn ports(b: &mut PortBuilder) -> Ports {
        // Not read: the port names the image on which the labels are drawn.
        let _ = b.optional_input::<RawImage>("image", "colour image of the camera");
        Ports {
            points: b.input("points", "points with the field `label`, m"),
            calibration: b.input("calibration", "calibration of the camera"),
            poses: PosePorts::declare(b),
            labels: b
                .output("labels", "label of each pixel that a point falls on")
                .role(Role::Labels)
                .palette("obstacle_labels")
                .classes(&OBSTACLE_CLASSES)
                .overlay_of("image")
                .build(),
        }
    }

    fn new(_params: &LabelOverlayParams) -> Self {
        Self::default()
    }

    fn cycle(&mut self, ports: &Ports, params: &LabelOverlayParams, cx: &mut Cycle<'_>) {
        let extrinsics = Extrinsics::new(params.pose.as_ref(), params.mount.as_ref());
        ports.poses.read(&mut self.localizer, extrinsics.frames, cx);
        if let Some(calibration) =
            read_calibration(&ports.calibration, self.camera.is_some(), params.rectified, cx)
        {
            self.camera = match camera_of(&calibration, params.rectified) {
                Ok(camera) => Some((calibration.frame_id.clone(), camera)),
                Err(error) => {
                    cx.fault(Unusable::from(error).to_string());
                    None
                }
            };
        }
        let Some(points) = cx.read_newest(&ports.points) else {
            cx.exec("waits for points");
            return;
        };
        cx.exec("paints labels");
        match self.paint(&points, params, extrinsics) {
            Ok(labels) => cx.write(&ports.labels, points.acq_time(), labels),
            Err(error) => cx.fault(format!("{error}; points skipped")),
        }
    }
}

impl LabelOverlay {
    fn paint(
        &self,
        message: &Msg<PointCloud>,
        params: &LabelOverlayParams,
        extrinsics: Extrinsics<'_>,
    ) -> Result<RawImage, Unusable> {
        let (frame_id, camera) = self.camera.as_ref().ok_or(Unusable::NoCalibration)?;
        let offset = label_offset(message).ok_or(Unusable::NoLabel)?;
        let cloud = rcs_msg::points(message)?;
        let time = message.acq_time();
        let taken = SensorTime::of(message);
        let optical_from_frame = self.optical_from_frame(extrinsics, frame_id, &message.frame_id, taken)?;
        let optical_from_points = match &message.pose {
            Some(pose) => optical_from_frame * pose_of(Some(pose), &message.frame_id)?,
            None => optical_from_frame,
        };
        let labels = message.data.chunks_exact(message.point_stride as usize).map(|point| point[offset]);
        let points = cloud.iter().zip(labels).map(|(point, label)| {
            let p_optical: DVec3 = optical_from_points * point.position;
            (p_optical, label)
        });
        let data = paint(camera, points, params.point_radius_px, params.max_range_m);
        Ok(RawImage {
            timestamp: Some(time.to_proto()),
            frame_id: frame_id.clone(),
            width: camera.width,
            height: camera.height,
            encoding: "mono8".to_owned(),
            step: camera.width,
            data: data.into(),
        })
    }

    /// The frame of the points in that of the camera.
    fn optical_from_frame(
        &self,
        extrinsics: Extrinsics<'_>,
        camera: &str,
        points: &str,
        time: SensorTime,
    ) -> Result<Pose, LocalizerError> {
        let direct = self.localizer.lookup(camera, points, time, extrinsics.max_age_s);
        if let (None, Ok(pose)) = (extrinsics.vehicle_from_mount, direct) {
            return Ok(pose);
        }
        let vehicle_from_points = if points == extrinsics.frames.local {
            extrinsics.local_from_vehicle(&self.localizer, time)?.inverse()
        } else {
            self.localizer.lookup(extrinsics.frames.vehicle, points, time, extrinsics.max_age_s)?
        };
        let vehicle_from_optical =
            extrinsics.vehicle_from_sensor(&self.localizer, camera, Axes::Optical, time)?;
        Ok(vehicle_from_optical.inverse() * vehicle_from_points)
    }
}

/// Offset of the label within a point.
fn label_offset(cloud: &PointCloud) -> Option<usize> {
    let field =
        cloud.fields.iter().find(|field| field.name == "label" && field.r#type() == NumericType::Uint8)?;
    (field.offset < cloud.point_stride).then_some(field.offset as usize)
}
