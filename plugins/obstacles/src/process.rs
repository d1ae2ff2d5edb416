//! The process `obstacles`.

use crate::cloud::CloudColumns;
use crate::columns::{Footing, Placement, Strip};
use crate::cost_map::{CELL_SIZE_M, CostMap};
use crate::depth_image::{DepthError, DepthImage, Rays, label_image, scan_strip};
use crate::overlay_process::camera_of;
use crate::scan::{Label, ScanParams};
use glam::DVec3;
use rcs_geom::{CameraError, CellIndex, PinholeCamera, Pose};
use rcs_msg::foxglove::packed_element_field::NumericType;
use rcs_msg::foxglove::{CameraCalibration, CompressedImage, Grid, PackedElementField, PointCloud, RawImage};
use rcs_msg::rcs::{ObstacleStats, ObstaclesParams, PoseSource};
use rcs_msg::{PointsError, Stamp};
use rcs_runtime::{Cycle, In, Msg, Out, PortBuilder, PosePorts, Process, ProcessDef};
use rcs_world::{FrameNames, Localizer, LocalizerError, MAX_COST, OBSTACLE_COST, pose_message, pose_of};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// State: the last seconds of poses, and the camera.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Obstacles {
    localizer: Localizer,
    camera: Option<PinholeCamera>,
    /// Rays of `camera`, made when they are first needed.
    #[serde(skip)]
    rays: Option<Arc<Rays>>,
}

/// Ports of [`Obstacles`].
#[derive(Debug)]
pub struct Ports {
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
    #[error(
        "vehicle lies on its side: its up is {up_z:.2} of upright, expected at least {}",
        Footing::MIN_UPRIGHT
    )]
    OnItsSide { up_z: f64 },
    #[error("none of {points} points has a range")]
    Empty { points: u64 },
}

/// Where the sensor and the vehicle were when the range data were taken.
struct Scene {
    local_from_sensor: Pose,
    footing: Footing,
    placement: Placement,
    /// The vehicle's cell.
    centre: CellIndex,
}

impl Process for Obstacles {
    type Params = ObstaclesParams;
    type Ports = Ports;
    const DEF: ProcessDef = ProcessDef {
        plugin: "obstacles",
        summary: "Labels range images and scans column by column and maps the cost of obstacles",
        period_ms: 200.0,
        commands: &[],
        reads_truth: false,
    };

    fn ports(b: &mut PortBuilder) -> Ports {
        // Never read: it names the picture that the labels lie on.
        let _ = b.optional_input::<CompressedImage>("image", "colour image of the same camera");
        Ports {
            depth: b.optional_input("depth", "depth image along the optical axis: 16UC1, mono16 or 32FC1"),
            cloud: b.optional_input("cloud", "point cloud with x, y and z, m, in any order"),
            calibration: b.optional_input("calibration", "calibration of the depth image"),
            poses: PosePorts::declare(b),
            labels: b
                .output("labels", "label of each pixel of the depth image")
                .role("labels")
                .palette("obstacle_labels")
                .overlay_of("image")
                .build(),
            points: b
                .output("points", "points of the cloud with a label each, in the cloud's frame, m")
                .role("cloud")
                .palette("obstacle_labels")
                .build(),
            cost: b
                .output("cost", "cost of 201x201 cells of 0.2 m around the vehicle, local frame")
                .role("cost")
                .palette("cost")
                .build(),
            stats: b.output("stats", "pixels by label, cells, ranges in m").role("stats").build(),
        }
    }

    fn new(_params: &ObstaclesParams) -> Self {
        Self::default()
    }

    fn cycle(&mut self, ports: &Ports, params: &ObstaclesParams, cx: &mut Cycle<'_>) {
        ports.poses.read(&mut self.localizer, frames(params), cx);
        if let Some(calibration) = cx.read_newest(&ports.calibration) {
            self.read_calibration(&calibration, cx);
        }
        let mut seen = false;
        if let Some(image) = cx.read_newest(&ports.depth) {
            seen = true;
            if let Err(error) = self.scan_depth(&image, ports, params, cx) {
                cx.fault(format!("{error}; image skipped"));
            }
        }
        if let Some(cloud) = cx.read_newest(&ports.cloud) {
            seen = true;
            if let Err(error) = self.scan_cloud(&cloud, ports, params, cx) {
                cx.fault(format!("{error}; cloud skipped"));
            }
        }
        cx.exec(if seen { "labels range data" } else { "waits for range data" });
    }
}

impl Obstacles {
    fn read_calibration(&mut self, calibration: &CameraCalibration, cx: &mut Cycle<'_>) {
        let camera = camera_of(calibration);
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
        let scene = self.scene(&message.frame_id, true, &Pose::IDENTITY, message.acq_time(), params)?;
        let turn = scene.local_from_sensor.rotation_matrix();
        let limits = scan_params(params);
        let strips = cx.pool().map(rays.strips(), |strip| {
            scan_strip(&image, &rays, strip, turn, &scene.footing, &scene.placement, &limits)
        });
        let time = message.acq_time();
        write_results(&strips, 0, &scene, time, ports, params, cx)?;
        let labels = RawImage {
            timestamp: Some(time.to_proto()),
            frame_id: message.frame_id.clone(),
            width: message.width,
            height: message.height,
            encoding: "mono8".to_owned(),
            step: message.width,
            data: label_image(&strips, size[0], size[1]).into(),
        };
        cx.write(&ports.labels, time, labels);
        Ok(())
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
        let scene = self.scene(&message.frame_id, false, &origin, message.acq_time(), params)?;
        let turn = scene.local_from_sensor.rotation_matrix();
        let points: Vec<Option<[f32; 3]>> = cloud
            .iter()
            .map(|point| {
                let p = turn * point.position;
                // Many sensors write the origin where they saw nothing.
                let has_range = p.is_finite() && point.position != DVec3::ZERO;
                has_range.then_some([p.x as f32, p.y as f32, p.z as f32])
            })
            .collect();
        let columns = CloudColumns::new(&points, (params.azimuth_step_deg as f32).to_radians());
        let limits = scan_params(params);
        let strips = cx.pool().map(columns.strips(), |strip| {
            columns.scan_strip(strip, &scene.footing, &scene.placement, &limits)
        });
        let time = message.acq_time();
        let without_range = points.iter().filter(|point| point.is_none()).count() as u64;
        write_results(&strips, without_range, &scene, time, ports, params, cx)?;
        let labels = columns.labels(&strips, points.len());
        cx.write(&ports.points, time, labelled_cloud(message, &cloud, &origin, &labels));
        Ok(())
    }

    /// Where sensor and vehicle were. `origin` is the place of the data's coordinates in their frame.
    fn scene(
        &self,
        frame_id: &str,
        optical: bool,
        origin: &Pose,
        time: Stamp,
        params: &ObstaclesParams,
    ) -> Result<Scene, Unusable> {
        let local_from_vehicle = match params.pose_source() {
            PoseSource::PoseFixed => Pose::IDENTITY,
            PoseSource::PoseMessages => {
                self.localizer.local_from_vehicle(frames(params), time, params.pose_max_age_s)?
            }
        };
        let vehicle_from_frame = if params.mount_fixed {
            let mount = Pose::from_rpy(
                DVec3::new(params.mount_x_m, params.mount_y_m, params.mount_height_m),
                params.mount_roll_deg.to_radians(),
                params.mount_pitch_deg.to_radians(),
                params.mount_yaw_deg.to_radians(),
            );
            if optical { mount * Pose::body_from_optical() } else { mount }
        } else {
            self.localizer.lookup(&params.vehicle_frame, frame_id, time, params.pose_max_age_s)?
        };
        let local_from_sensor = local_from_vehicle * vehicle_from_frame * *origin;
        let up = local_from_vehicle.rotate(DVec3::Z);
        if up.z < Footing::MIN_UPRIGHT {
            return Err(Unusable::OnItsSide { up_z: up.z });
        }
        let sensor = local_from_sensor.translation;
        let below_origin = local_from_vehicle.translation - up * params.wheels_below_m - sensor;
        let cell = (local_from_vehicle.translation / CELL_SIZE_M).floor();
        Ok(Scene {
            local_from_sensor,
            footing: Footing { below_origin, up, wheels_m: params.wheels_x_m },
            placement: Placement { sensor, cell_size_m: CELL_SIZE_M },
            centre: CellIndex::new(cell.x as i64, cell.y as i64),
        })
    }
}

/// Writes the cost map and the counts, unless nothing had a range.
fn write_results(
    strips: &[Strip],
    without_range: u64,
    scene: &Scene,
    time: Stamp,
    ports: &Ports,
    params: &ObstaclesParams,
    cx: &mut Cycle<'_>,
) -> Result<(), Unusable> {
    let count = |label: Label| strips.iter().map(|strip| strip.counts[label as usize]).sum::<u64>();
    let points = Label::ALL.into_iter().map(count).sum::<u64>() + without_range;
    let invalid = count(Label::Invalid) + without_range;
    if invalid == points {
        return Err(Unusable::Empty { points });
    }
    let map = CostMap::new(strips, scene.centre, scene.placement.sensor.z, params.min_pixels);
    let used = |range: &&Strip| range.range_m[1] > 0.0;
    let nearest = strips.iter().filter(used).map(|strip| strip.range_m[0]).fold(f32::INFINITY, f32::min);
    let farthest = strips.iter().filter(used).map(|strip| strip.range_m[1]).fold(0.0, f32::max);
    let stats = ObstacleStats {
        timestamp: Some(time.to_proto()),
        invalid,
        ground: count(Label::Ground),
        obstacle: count(Label::Obstacle),
        short_obstacle: count(Label::ShortObstacle),
        negative: 0,
        negative_cells: 0,
        cover: count(Label::Cover),
        too_far: count(Label::TooFar),
        min_range_m: if farthest > 0.0 { f64::from(nearest) } else { 0.0 },
        max_range_m: f64::from(farthest),
        cells: map.costs().filter(|&cost| cost <= MAX_COST).count() as u64,
        obstacle_cells: map.costs().filter(|cost| (OBSTACLE_COST..=MAX_COST).contains(cost)).count() as u64,
    };
    cx.write(&ports.cost, time, map.to_grid(&params.local_frame, time.to_proto()));
    cx.write(&ports.stats, time, stats);
    Ok(())
}

/// The points that have a label, with it: `x`, `y`, `z` (f32, m) and `label` (u8), 16 bytes a point.
fn labelled_cloud(
    message: &PointCloud,
    cloud: &rcs_msg::Points<'_>,
    origin: &Pose,
    labels: &[Label],
) -> PointCloud {
    let mut data = Vec::with_capacity(labels.len() * 16);
    for (point, &label) in cloud.iter().zip(labels) {
        if label != Label::Invalid {
            for value in point.position.to_array() {
                data.extend_from_slice(&(value as f32).to_le_bytes());
            }
            data.extend_from_slice(&[label as u8, 0, 0, 0]);
        }
    }
    let field = |name: &str, offset: u32, r#type: NumericType| PackedElementField {
        name: name.to_owned(),
        offset,
        r#type: r#type.into(),
    };
    PointCloud {
        timestamp: message.timestamp,
        frame_id: message.frame_id.clone(),
        pose: Some(pose_message(origin)),
        point_stride: 16,
        fields: vec![
            field("x", 0, NumericType::Float32),
            field("y", 4, NumericType::Float32),
            field("z", 8, NumericType::Float32),
            field("label", 12, NumericType::Uint8),
        ],
        data: data.into(),
    }
}

fn frames(params: &ObstaclesParams) -> FrameNames<'_> {
    FrameNames { local: &params.local_frame, vehicle: &params.vehicle_frame, pose: &params.pose_frame }
}

fn scan_params(params: &ObstaclesParams) -> ScanParams {
    let tangent = |degrees: f64| libm::tan(degrees.to_radians()) as f32;
    ScanParams {
        min_range_m: params.min_range_m as f32,
        max_range_m: params.max_range_m as f32,
        slope_limit: tangent(params.slope_limit_deg),
        regain_slope: tangent(params.regain_slope_deg),
        min_rise_m: params.min_rise_m as f32,
        rise_noise: params.rise_noise_per_m as f32,
        short_height_m: params.short_height_m as f32,
        clearance_m: params.clearance_m as f32,
        gap_m: params.gap_m as f32,
        surface_span_m: params.surface_span_m as f32,
        wheels_tolerance_m: params.wheels_tolerance_m as f32,
    }
}
