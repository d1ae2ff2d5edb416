//! The process `obstacles`: reads range data, and sends labels and the cost map. Its port table is in the crate's
//! documentation.

use crate::cloud::CloudColumns;
use crate::columns::{KnownGround, Strip, Survey};
use crate::cost_map::{Certainty, CostMap, Sure};
use crate::depth_image::{DepthError, DepthImage, Rays, label_image, scan_strip};
use crate::ground_map::GroundMap;
use crate::params::{border_rule, certainty, extrinsics, negative_params, scan_params};
use crate::proto::{ObstacleStats, ObstaclesParams};
use crate::results::{count, labelled_cloud, stats};
use crate::scan::Label;
use crate::sensor_pose::{SensorPose, SensorPoseError};
use crate::sightings::Sightings;
use glam::DVec3;
use rcs_geom::{CameraError, CellIndex, PinholeCamera, Pose};
use rcs_msg::classes::OBSTACLE_CLASSES;
use rcs_msg::foxglove::{CameraCalibration, Grid, PointCloud, RawImage};
use rcs_msg::image::raw_to_rgb8;
use rcs_msg::{PointsError, Stamp};
use rcs_runtime::{Cycle, In, Msg, NoCommands, Out, PortBuilder, Process, ProcessDef, Role};
use rcs_sense::{
    Axes, FrameWatch, InOrder, Localizer, LocalizerError, PosePorts, SensorTime, camera_of, pose_of,
    read_calibration,
};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::sync::Arc;

/// State: the poses of the last seconds, the camera, the ground map of the negative obstacles, in how many frames cells
/// were obstacles, and by which clocks and in which local frame.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Obstacles {
    localizer: Localizer,
    camera: Option<PinholeCamera>,
    ground: GroundMap,
    sightings: Sightings,
    /// Order of the depth images, and of the clouds.
    order: [InOrder; 2],
    frame_watch: FrameWatch,
    /// Rays of `camera`, computed on first use.
    #[serde(skip)]
    rays: Option<Arc<Rays>>,
}

/// Ports of [`Obstacles`].
#[derive(Debug)]
pub struct Ports {
    image: In<RawImage>,
    depth: In<RawImage>,
    cloud: In<PointCloud>,
    calibration: In<CameraCalibration>,
    poses: PosePorts,
    labels: Out<RawImage>,
    points: Out<PointCloud>,
    cost: Out<Grid>,
    stats: Out<ObstacleStats>,
}

/// Why range data were skipped.
#[derive(Debug, thiserror::Error)]
enum Unusable {
    #[error("depth image without a calibration")]
    NoCalibration,
    #[error("calibration: {0}")]
    Calibration(#[from] CameraError),
    #[error(transparent)]
    Depth(#[from] DepthError),
    #[error(transparent)]
    Points(#[from] PointsError),
    #[error(transparent)]
    Pose(#[from] LocalizerError),
    #[error(transparent)]
    SensorPose(#[from] SensorPoseError),
    #[error("{age_s:.3} s older than the one before, expected a newer one")]
    Late { age_s: f64 },
    #[error("none of {points} points has a range")]
    Empty { points: u64 },
}

/// Colours are taken from an image of at most this time difference from the ranges, s.
const SAME_TIME_S: f64 = 0.05;

impl Process for Obstacles {
    type Params = ObstaclesParams;
    type Ports = Ports;
    type Command = NoCommands;
    const DEF: ProcessDef = ProcessDef {
        plugin: "obstacles",
        summary: "Labels obstacles in range images and point clouds by column scan, and maps their cost",
        period_ms: 200.0,
        latency_ms: 10.0,
        reads_ground_truth: false,
    };

    fn ports(b: &mut PortBuilder) -> Ports {
        Ports {
            image: b.optional_input("image", "colour image of the same camera, pixel for pixel"),
            depth: b.optional_input("depth", "depth image along the optical axis: 16UC1, mono16 or 32FC1"),
            cloud: b.optional_input("cloud", "point cloud with x, y and z, m, in any order"),
            calibration: b.optional_input("calibration", "calibration of the depth image"),
            poses: PosePorts::declare(b),
            labels: b
                .output("labels", "label of each pixel of the depth image")
                .role(Role::Labels)
                .palette("obstacle_labels")
                .classes(&OBSTACLE_CLASSES)
                .overlay_of("image")
                .build(),
            points: b
                .output("points", "points of the cloud with a label each, in the cloud's frame, m")
                .role(Role::Cloud)
                .palette("obstacle_labels")
                .classes(&OBSTACLE_CLASSES)
                .build(),
            cost: b
                .output("cost", "cost of cells of 0.2 m around the vehicle within the greatest range, at most 201x201, local frame")
                .role(Role::Cost)
                .palette("cost")
                .build(),
            stats: b.output("stats", "pixels by label, cells, ranges in m").role(Role::Stats).build(),
        }
    }

    #[expect(clippy::expect_used, reason = "201 cells of 0.1 m are a grid")]
    fn new(_params: &ObstaclesParams) -> Self {
        Self {
            localizer: Localizer::default(),
            camera: None,
            ground: GroundMap::new().expect("the size of the ground map is valid"),
            sightings: Sightings::new().expect("the size of the cost map is valid"),
            order: Default::default(),
            frame_watch: FrameWatch::default(),
            rays: None,
        }
    }

    fn cycle(&mut self, ports: &Ports, params: &ObstaclesParams, cx: &mut Cycle<'_>) {
        let has_clock_begun_again = ports.poses.read(&mut self.localizer, extrinsics(params).frames, cx);
        self.watch_frame(has_clock_begun_again, params, cx);
        if let Some(calibration) =
            read_calibration(&ports.calibration, self.camera.is_some(), params.rectified, cx)
        {
            self.read_calibration(&calibration, params, cx);
        }
        let mut seen = false;
        if let Some(image) = cx.read_newest(&ports.depth) {
            seen = true;
            let scanned = self
                .take_time(0, image.acq_time(), cx)
                .and_then(|()| self.scan_depth(&image, ports, params, cx));
            if let Err(error) = scanned {
                cx.fault(format!("{error}; image skipped"));
            }
        }
        if let Some(cloud) = cx.read_newest(&ports.cloud) {
            seen = true;
            let scanned = self
                .take_time(1, cloud.acq_time(), cx)
                .and_then(|()| self.scan_cloud(&cloud, ports, params, cx));
            if let Err(error) = scanned {
                cx.fault(format!("{error}; cloud skipped"));
            }
        }
        cx.exec(if seen { "labels range data" } else { "waits for range data" });
    }
}

impl Obstacles {
    /// Forgets what was seen where the local frame has begun again: it lies elsewhere now.
    fn watch_frame(&mut self, has_clock_begun_again: bool, params: &ObstaclesParams, cx: &mut Cycle<'_>) {
        let extrinsics = extrinsics(params);
        let pose = extrinsics.local_from_vehicle(&self.localizer, cx.now()).ok();
        let at = pose.map(|pose| pose.translation.truncate());
        let has_clock_begun_again = has_clock_begun_again && !extrinsics.fixed_pose;
        if let Some(why) = self.frame_watch.begins_again(has_clock_begun_again, at, cx.now()) {
            self.forget(&why, cx);
        }
    }

    /// Takes the time of a depth image (0) or a cloud (1). What was seen by a clock that has begun again is forgotten.
    fn take_time(&mut self, input: usize, time: Stamp, cx: &mut Cycle<'_>) -> Result<(), Unusable> {
        let begins_again =
            self.order[input].take(time, cx.now()).map_err(|age_s| Unusable::Late { age_s })?;
        if begins_again {
            let what = ["depth images", "clouds"][input];
            self.forget(&format!("the clock of the {what} has begun again"), cx);
        }
        Ok(())
    }

    fn forget(&mut self, why: &str, cx: &mut Cycle<'_>) {
        self.ground.clear();
        self.sightings.clear();
        cx.fault(format!("{why}; ground and obstacles seen before are forgotten"));
    }

    fn read_calibration(
        &mut self,
        calibration: &CameraCalibration,
        params: &ObstaclesParams,
        cx: &mut Cycle<'_>,
    ) {
        let camera = camera_of(calibration, params.rectified);
        let camera = camera.map_err(|error| cx.fault(Unusable::from(error).to_string())).ok();
        if camera != self.camera {
            self.camera = camera;
            self.rays = None;
        }
    }

    fn scan_depth(
        &mut self,
        message: &Msg<RawImage>,
        ports: &Ports,
        params: &ObstaclesParams,
        cx: &mut Cycle<'_>,
    ) -> Result<(), Unusable> {
        let size = [message.width as usize, message.height as usize];
        let scale_m = params.depth_scale_m as f32;
        let image = DepthImage::new(size, message.step as usize, &message.encoding, scale_m, &message.data)?;
        let camera = self.camera.as_ref().ok_or(Unusable::NoCalibration)?;
        let expected = [camera.width as usize, camera.height as usize];
        if size != expected {
            return Err(DepthError::Size { got: size, expected }.into());
        }
        let rays = self.rays.get_or_insert_with(|| Arc::new(Rays::new(camera))).clone();
        let time = message.acq_time();
        let sensor_pose = SensorPose::find(
            &self.localizer,
            &message.frame_id,
            Axes::Optical,
            &Pose::IDENTITY,
            SensorTime::of(message),
            params,
        )?;
        let image = DepthImage { is_upside_down: sensor_pose.is_upside_down, ..image };
        let rgb = colours(message, ports, cx);
        let turn = sensor_pose.local_from_sensor.rotation_matrix();
        let survey = self.survey(&sensor_pose, time, params, true);
        let mut strips =
            cx.pool().map(rays.strips(), |strip| scan_strip(&image, &rgb, &rays, strip, turn, &survey));
        let certainty = certainty(params, self.camera.as_ref());
        let written = self.write_results(&mut strips, 0, &sensor_pose, time, certainty, ports, params, cx);
        // Also without any range: who reads the labels knows by them that this process works.
        let labels = RawImage {
            timestamp: Some(time.to_proto()),
            frame_id: message.frame_id.clone(),
            width: message.width,
            height: message.height,
            encoding: "mono8".to_owned(),
            step: message.width,
            data: label_image(&strips, &image).into(),
        };
        cx.write(&ports.labels, time, labels);
        written
    }

    fn scan_cloud(
        &mut self,
        message: &Msg<PointCloud>,
        ports: &Ports,
        params: &ObstaclesParams,
        cx: &mut Cycle<'_>,
    ) -> Result<(), Unusable> {
        let cloud = rcs_msg::points(message)?;
        let origin = match &message.pose {
            Some(pose) => pose_of(Some(pose), &message.frame_id)?,
            None => Pose::IDENTITY,
        };
        let time = message.acq_time();
        let taken = SensorTime::of(message);
        let sensor_pose =
            SensorPose::find(&self.localizer, &message.frame_id, Axes::Body, &origin, taken, params)?;
        let turn = sensor_pose.local_from_sensor.rotation_matrix();
        let points: Vec<Option<[f32; 3]>> = cloud
            .iter()
            .map(|point| {
                let p = turn * point.position;
                // Many sensors report the origin for a ray without a return.
                let has_range = p.is_finite() && point.position != DVec3::ZERO;
                has_range.then_some([p.x as f32, p.y as f32, p.z as f32])
            })
            .collect();
        let survey = self.survey(&sensor_pose, time, params, false);
        let azimuth_step_rad = (params.azimuth_step_deg as f32).to_radians();
        let columns = CloudColumns::new(&points, azimuth_step_rad, survey.scan.min_range_m);
        let mut strips = cx.pool().map(columns.strips(), |strip| columns.scan_strip(strip, &survey));
        let without_range = points.iter().filter(|point| point.is_none()).count() as u64;
        // The noise of stereo is that of depth images, which may come beside clouds.
        let certainty = certainty(params, None);
        self.write_results(&mut strips, without_range, &sensor_pose, time, certainty, ports, params, cx)?;
        let labels = columns.labels(&strips, points.len());
        cx.write(&ports.points, time, labelled_cloud(message, &cloud, &origin, &labels));
        Ok(())
    }

    fn survey(
        &self,
        sensor_pose: &SensorPose,
        time: Stamp,
        params: &ObstaclesParams,
        is_image: bool,
    ) -> Survey<'_> {
        let memory_ns = border_rule(params).memory_ns;
        let (since_ns, until_ns) = (time.0.saturating_sub(memory_ns), time.0.saturating_add(memory_ns));
        Survey {
            ground_plane: sensor_pose.ground_plane,
            placement: sensor_pose.placement,
            scan: scan_params(params, self.camera.as_ref().filter(|_| is_image)),
            negative: negative_params(params),
            known: Some(KnownGround { map: &self.ground, since_ns, until_ns }),
        }
    }

    /// Adds the frame to the ground map and marks the borders that count. Returns the number of their pixels, and their
    /// cells of the cost map.
    fn mark_negative(
        &mut self,
        strips: &mut [Strip],
        sensor_pose: &SensorPose,
        time: Stamp,
        params: &ObstaclesParams,
    ) -> (u64, BTreeSet<CellIndex>) {
        if !params.negative_obstacles {
            return (0, BTreeSet::new());
        }
        self.ground.recentre(sensor_pose.ground_centre);
        let votes = strips.iter().flat_map(|strip| &strip.ground);
        let borders = self.ground.add(votes, sensor_pose.placement.sensor.z, time.0, &border_rule(params));
        let is_border = |[x, y]: [i32; 2]| borders.contains(&CellIndex::new(x.into(), y.into()));
        let pixels = strips.iter_mut().map(|strip| strip.mark_borders(is_border)).sum();
        // A cell of the cost map is two cells of the ground map wide.
        let cells = borders.iter().map(|cell| CellIndex::new(cell.x.div_euclid(2), cell.y.div_euclid(2)));
        (pixels, cells.collect())
    }

    /// Makes the obstacle cells unknown that too few frames have seen, and their pixels too far to tell.
    fn confirm(
        &mut self,
        map: &mut CostMap,
        strips: &mut [Strip],
        centre: CellIndex,
        params: &ObstaclesParams,
    ) {
        if params.positive_frames <= 1 {
            return;
        }
        let frames = u8::try_from(params.positive_frames).unwrap_or(u8::MAX);
        let (within_m, rise_m) = (params.sure_range_m, params.sure_rise_m);
        let sure = Sure { pixels: params.positive_pixels, within_m, rise_m };
        self.sightings.recentre(centre);
        map.confirm(&sure, |cell, seen, is_sure| self.sightings.confirms(cell, seen, is_sure, frames));
        for strip in strips {
            strip.doubt(|cell| map.doubts(cell));
        }
    }

    /// Sends the cost map and the counts, unless no point had a range.
    #[expect(clippy::too_many_arguments, reason = "one frame, and where it goes")]
    fn write_results(
        &mut self,
        strips: &mut [Strip],
        without_range: u64,
        sensor_pose: &SensorPose,
        time: Stamp,
        certainty: Certainty,
        ports: &Ports,
        params: &ObstaclesParams,
        cx: &mut Cycle<'_>,
    ) -> Result<(), Unusable> {
        let points = Label::ALL.into_iter().map(|label| count(strips, label)).sum::<u64>() + without_range;
        if count(strips, Label::Invalid) + without_range == points {
            return Err(Unusable::Empty { points });
        }
        let (negative, negative_cells) = self.mark_negative(strips, sensor_pose, time, params);
        let sensor = sensor_pose.placement.sensor;
        let mut map =
            CostMap::new(strips, &negative_cells, sensor_pose.centre, sensor, params.max_range_m, certainty);
        self.confirm(&mut map, strips, sensor_pose.centre, params);
        let stats = ObstacleStats {
            negative,
            negative_cells: negative_cells.len() as u64,
            ..stats(strips, without_range, &map, time)
        };
        cx.write(&ports.cost, time, map.to_grid(extrinsics(params).frames.local, time));
        cx.write(&ports.stats, time, stats);
        Ok(())
    }
}

/// Colours of the pixels of a depth image; empty where there are none.
fn colours(depth: &Msg<RawImage>, ports: &Ports, cx: &mut Cycle<'_>) -> Vec<u8> {
    let is_same_time =
        |image: &Msg<RawImage>| image.acq_time().seconds_since(depth.acq_time()).abs() <= SAME_TIME_S;
    let Some(image) = cx.latest(&ports.image).filter(is_same_time) else { return Vec::new() };
    if (image.width, image.height) != (depth.width, depth.height) {
        let (got, expected) = ([image.width, image.height], [depth.width, depth.height]);
        cx.fault(format!("colour image has {got:?} pixels, expected {expected:?}; colours left out"));
        return Vec::new();
    }
    match raw_to_rgb8(&image) {
        Ok(rgb) => rgb.data,
        Err(error) => {
            cx.fault(format!("colour image: {error}; colours left out"));
            Vec::new()
        }
    }
}
