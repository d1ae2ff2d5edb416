//! A frame whose camera is calibrated and placed, for the tests of what is projected into images.

use super::{driving, topic, with_metadata};
use rcs_geom::{DVec3, Pose, TransformTree};
use rcs_msg::foxglove::{CameraCalibration, RawImage};
use rcs_msg::rcs::{ExampleKind, PlanePoint, PlanePolygon, TrainingExample};
use rcs_runtime::source::{Frame, Topic};
use std::sync::Arc;

/// Place of the camera in the frame `local`, m: it looks east, and down by 0.3 rad.
pub(crate) const CAMERA_M: [f64; 3] = [-4.5, -1.0, 1.2];

/// A running stack whose camera sees the map, the planned path and an example that the operator has drawn.
pub(crate) fn camera_in_space() -> Frame {
    let mut frame = driving();
    let mut topics: Vec<Topic> = frame.topics.to_vec();
    for shown in topics.iter_mut().filter(|shown| &*shown.name == "/camera/image") {
        let image = shown.get::<RawImage>().cloned().unwrap_or_default();
        let image = RawImage { frame_id: "camera".into(), ..image };
        *shown = with_metadata(topic("/camera/image", 5.0, 0.1, image), "camera", &[("rcs.role", "image")]);
    }
    // A field of view of 90°, in twice the size of the image.
    let calibration = CameraCalibration {
        frame_id: "camera".into(),
        width: 192,
        height: 128,
        distortion_model: "plumb_bob".into(),
        d: vec![0.0; 5],
        k: vec![96.0, 0.0, 95.5, 0.0, 96.0, 63.5, 0.0, 0.0, 1.0],
        ..CameraCalibration::default()
    };
    topics.push(topic("/camera/calibration", 1.0, 0.1, calibration));
    let point = |x_m, y_m| PlanePoint { x_m, y_m };
    let outline = vec![point(0.0, 0.5), point(1.5, 0.5), point(1.5, 1.8), point(0.0, 1.8)];
    let example = TrainingExample {
        frame_id: "local".into(),
        kind: ExampleKind::ExampleObstacle.into(),
        outline: Some(PlanePolygon { points: outline }),
        ..TrainingExample::default()
    };
    topics.push(topic("/operator/training", 0.0, 3.0, example));
    topics.sort_by(|a, b| a.name.cmp(&b.name));
    let mut tree = TransformTree::new();
    let mast = Pose::from_rpy(DVec3::from_array(CAMERA_M), 0.0, 0.3, 0.0);
    tree.set_static("local", "camera", mast * Pose::body_from_optical()).unwrap();
    (frame.topics, frame.transforms) = (topics.into(), Arc::new(tree));
    frame
}
