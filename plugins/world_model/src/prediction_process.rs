//! The process `prediction`: what a camera is expected to see of the world model. Its port table is in the crate's
//! documentation.

use crate::prediction::{Sight, obstacles, path};
use crate::proto::PredictionParams;
use glam::DVec2;
use rcs_geom::{CameraError, PinholeCamera};
use rcs_msg::Stamp;
use rcs_msg::foxglove::points_annotation::Type;
use rcs_msg::foxglove::{
    CameraCalibration, Color, Grid, ImageAnnotations, Point2, PointsAnnotation, PosesInFrame, RawImage,
};
use rcs_runtime::{Cycle, In, Msg, NoCommands, Out, PortBuilder, Process, ProcessDef, Role};
use rcs_sense::{
    Axes, Extrinsics, Localizer, LocalizerError, PosePorts, SensorTime, camera_of, read_calibration,
};
use rcs_world::{GridView, GridViewError};
use serde::{Deserialize, Serialize};

/// State: the poses of the last seconds, and the camera.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Prediction {
    localizer: Localizer,
    camera: Option<PinholeCamera>,
}

/// Ports of [`Prediction`].
#[derive(Debug)]
pub struct Ports {
    image: In<RawImage>,
    calibration: In<CameraCalibration>,
    map: In<Grid>,
    path: In<PosesInFrame>,
    poses: PosePorts,
    predicted: Out<ImageAnnotations>,
}

/// Why nothing is predicted for an image.
#[derive(Debug, thiserror::Error)]
enum Unusable {
    #[error("image without a calibration")]
    NoCalibration,
    #[error(transparent)]
    Pose(#[from] LocalizerError),
    #[error("map: {0}")]
    Map(#[from] GridViewError),
    #[error("{what} is in the frame {got:?}, expected {expected:?}")]
    Frame { what: &'static str, got: String, expected: String },
}

impl Process for Prediction {
    type Params = PredictionParams;
    type Ports = Ports;
    type Command = NoCommands;
    const DEF: ProcessDef = ProcessDef {
        plugin: "prediction",
        summary: "Projects obstacles of the world model and a planned path into the image of a camera",
        period_ms: 50.0,
        latency_ms: 2.0,
        reads_ground_truth: false,
    };

    fn ports(b: &mut PortBuilder) -> Ports {
        Ports {
            image: b.input("image", "image of the camera: only its time and frame are read"),
            calibration: b.input("calibration", "calibration of the image"),
            map: b.optional_input("map", "world model: its obstacles are predicted, local frame"),
            path: b.optional_input("path", "planned path, local frame"),
            poses: PosePorts::declare(b),
            predicted: b
                .output("predicted", "obstacles from foot to top, and the path, pixels of the image")
                .role(Role::Prediction)
                .overlay_of("image")
                .build(),
        }
    }

    fn new(_params: &PredictionParams) -> Self {
        Self::default()
    }

    fn cycle(&mut self, ports: &Ports, params: &PredictionParams, cx: &mut Cycle<'_>) {
        ports.poses.read(&mut self.localizer, extrinsics(params).frames, cx);
        if let Some(calibration) =
            read_calibration(&ports.calibration, self.camera.is_some(), params.rectified, cx)
        {
            let camera: Result<_, CameraError> = camera_of(&calibration, params.rectified);
            self.camera = camera.map_err(|error| cx.fault(format!("calibration: {error}"))).ok();
        }
        let Some(image) = cx.read_newest(&ports.image) else {
            return cx.exec("waits for an image");
        };
        match self.predict(&image, ports, params, cx) {
            Ok(count) => cx.exec(format!("predicts {count} obstacle cells in view")),
            Err(error) => cx.fault(format!("{error}; nothing is predicted")),
        }
    }
}

impl Prediction {
    /// Sends what the camera is expected to see at the time of an image; returns the number of cells with an obstacle.
    fn predict(
        &self,
        image: &Msg<RawImage>,
        ports: &Ports,
        params: &PredictionParams,
        cx: &mut Cycle<'_>,
    ) -> Result<usize, Unusable> {
        let (time, extrinsics) = (image.acq_time(), extrinsics(params));
        let taken = SensorTime::of(image);
        let sight = Sight {
            camera: self.camera.as_ref().ok_or(Unusable::NoCalibration)?,
            vehicle_from_camera: &extrinsics.vehicle_from_sensor(
                &self.localizer,
                &image.frame_id,
                Axes::Optical,
                taken,
            )?,
            local_from_vehicle: &extrinsics.local_from_vehicle(&self.localizer, taken)?,
            below_m: params.wheels_below_m,
            range_m: params.range_m,
        };
        // Clocks may be ahead: image, map and path count as no newer than their arrival.
        let is_recent = |of: Stamp| taken.on_arrival().seconds_since(of).abs() <= params.map_max_age_s;
        let in_local = |what: &'static str, frame: &str| {
            let expected = extrinsics.frames.local;
            let fault = || Unusable::Frame { what, got: frame.to_owned(), expected: expected.to_owned() };
            if frame == expected { Ok(()) } else { Err(fault()) }
        };
        let map = cx.latest(&ports.map).filter(|map| is_recent(map.acq_time_on_arrival()));
        let map = map.as_ref().map(|map| GridView::of(map.message())).transpose()?;
        let mut standing = Vec::new();
        if let Some(map) = &map {
            in_local("map", map.frame_id())?;
            standing = obstacles(map, &sight)?;
        }
        let mut parts = Vec::new();
        let planned = cx.latest(&ports.path).filter(|planned| is_recent(planned.acq_time_on_arrival()));
        if let Some(planned) = planned {
            in_local("path", &planned.frame_id)?;
            let places: Vec<DVec2> = planned
                .poses
                .iter()
                .filter_map(|pose| pose.position.as_ref())
                .map(|at| DVec2::new(at.x, at.y))
                .collect();
            parts = path(&places, map.as_ref(), &sight);
        }
        let count = standing.len();
        let red = Color { r: 0.95, g: 0.25, b: 0.2, a: 1.0 };
        let blue = Color { r: 0.25, g: 0.6, b: 1.0, a: 1.0 };
        let of_obstacles = lines(Type::LineList, standing.into_iter().flatten(), red, time);
        let of_path = parts.into_iter().map(|part| lines(Type::LineStrip, part.into_iter(), blue, time));
        let points = of_path.chain([of_obstacles]).filter(|lines| !lines.points.is_empty()).collect();
        let timestamp = Some(time.to_proto());
        let predicted = ImageAnnotations { timestamp, points, ..ImageAnnotations::default() };
        cx.write(&ports.predicted, time, predicted);
        Ok(count)
    }
}

/// Lines of a colour in the coordinates of the message, whose origin is the corner of the first pixel.
fn lines(kind: Type, pixels: impl Iterator<Item = DVec2>, color: Color, time: Stamp) -> PointsAnnotation {
    PointsAnnotation {
        timestamp: Some(time.to_proto()),
        r#type: kind.into(),
        points: pixels.map(|pixel| Point2 { x: pixel.x + 0.5, y: pixel.y + 0.5 }).collect(),
        outline_color: Some(color),
        thickness: 2.0,
        ..PointsAnnotation::default()
    }
}

fn extrinsics(params: &PredictionParams) -> Extrinsics<'_> {
    Extrinsics::new(params.pose.as_ref(), params.mount.as_ref())
}
