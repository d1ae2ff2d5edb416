//! The process `sim_cameras`: images of a simulated stereo pair or a single camera.
//!
//! | port | direction | type | what |
//! | --- | --- | --- | --- |
//! | `ground_truth_state` | in | `rcs.GroundTruthState` | true pose of the vehicle in the frame global |
//! | `image` | in, optional | `foxglove.RawImage` | the images of its own left camera, on which ground truth is drawn |
//! | `left` | out | `foxglove.RawImage` | image of the left or only camera: rgb8, or mono8 of a thermal camera |
//! | `right` | out | `foxglove.RawImage` | image of the right camera, rgb8 |
//! | `left_calibration` | out | `foxglove.CameraCalibration` | raw lens of the left camera, and its rectified one |
//! | `right_calibration` | out | `foxglove.CameraCalibration` | the same of the right camera; P says the baseline |
//! | `ground_truth_depth` | out | `foxglove.RawImage` | depth of the left camera's pixels along the optical axis, m, 32FC1 |
//! | `ground_truth_labels` | out | `foxglove.RawImage` | obstacle label of the left camera's pixels, mono8 |
//! | `ground_truth_class` | out | `foxglove.RawImage` | class of the left camera's pixels, mono8 |
//!
//! Period 50 ms; images at the rate of the vehicle file, with the time of the pose from which they were taken. The
//! cameras of a pair are parallel, so R is the identity. A vehicle file can turn and shift the cameras from what their
//! calibration says, and stamp images wrongly; ground truth is always that of the image as it was taken. State: the time
//! of the last pose, the exposure, and how the cameras are turned. The world and the rays of the pixels are not part of
//! the state: after a snapshot they are computed again from the parameters.
//!
//! Cost: one ray per pixel. The strips of rows are fixed and noise is a hash of the pixel, so the result is the same
//! bit for bit with any number of threads.

use crate::camera_condition::{Condition, stamped};
use crate::clouds::sunlight;
use crate::exposure::{Exposure, Sensor, encoding_of, thermal};
use crate::proto::SimCamerasParams;
use crate::scene::{Texts, check_world, read_look, read_vehicle, read_world};
use crate::sensors::{is_due, limit};
use crate::spec::{CameraKind, CameraSpec, VehicleSpec};
use rcs_geom::{Distortion, PinholeCamera, Pose};
use rcs_msg::Stamp;
use rcs_msg::classes::OBSTACLE_CLASSES;
use rcs_msg::foxglove::{CameraCalibration, RawImage};
use rcs_msg::rcs::GroundTruthState;
use rcs_runtime::{Cycle, In, NoCommands, Out, Pool, PortBuilder, Process, ProcessDef, Role, Text};
use rcs_scene::{CameraRays, ViewRows, World, render_rows};
use rcs_sense::pose_of;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Rows per strip: a multiple of the renderer's ray bundles, and small enough to occupy several threads.
const STRIP_ROWS: usize = 48;

/// State: the time of the last pose, and the condition of the cameras.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct SimCameras {
    last: Option<Stamp>,
    condition: Option<Condition>,
    #[serde(skip)]
    cameras: Option<Arc<CameraSet>>,
}

/// Ports of [`SimCameras`].
#[derive(Debug)]
pub struct Ports {
    ground_truth_state: In<GroundTruthState>,
    images: [Out<RawImage>; 2],
    calibrations: [Out<CameraCalibration>; 2],
    ground_truth_depth: Out<RawImage>,
    ground_truth_labels: Out<RawImage>,
    ground_truth_class: Out<RawImage>,
}

/// The parsed parameters, and everything derived from them alone.
#[derive(Debug)]
struct CameraSet {
    texts: Texts,
    params: SimCamerasParams,
    spec: CameraSpec,
    lens: PinholeCamera,
    rate_hz: f64,
    world: Arc<World>,
    /// Rays of all cameras, unless the right one has its own.
    rays: CameraRays,
    right_rays: Option<CameraRays>,
    vehicle: VehicleSpec,
    sensor: Sensor,
}

/// Images of all cameras being rendered, row by row.
#[derive(Debug, Default)]
struct View {
    pixels: Vec<u8>,
    depth_m: Vec<f32>,
    class: Vec<u8>,
    label: Vec<u8>,
}

/// Some rows of a view.
struct Strip<'a> {
    side: usize,
    first_row: usize,
    out: ViewRows<'a>,
}

impl Process for SimCameras {
    type Params = SimCamerasParams;
    type Ports = Ports;
    type Command = NoCommands;
    const DEF: ProcessDef = ProcessDef {
        plugin: "sim_cameras",
        summary: "Simulates a stereo pair or a camera of the vehicle, and the ground truth of each pixel",
        period_ms: 50.0,
        latency_ms: 40.0,
        reads_ground_truth: true,
    };

    fn ports(b: &mut PortBuilder) -> Ports {
        let ground_truth_state =
            b.input("ground_truth_state", "true pose of the vehicle in the frame global");
        // Not read: the port names the image on which the ground truth is drawn.
        let _ = b.optional_input::<RawImage>(
            "image",
            "the images of its own left camera, on which ground truth is drawn",
        );
        let image = |b: &mut PortBuilder, name, help| b.output(name, help).role(Role::Image).build();
        let calibration =
            |b: &mut PortBuilder, name, help| b.output(name, help).role(Role::Calibration).build();
        Ports {
            ground_truth_state,
            images: [
                image(b, "left", "image of the left or only camera: rgb8, or mono8 of a thermal camera"),
                image(b, "right", "image of the right camera, rgb8"),
            ],
            calibrations: [
                calibration(b, "left_calibration", "raw lens of the left camera, and its rectified one"),
                calibration(b, "right_calibration", "the same of the right camera; P says the baseline"),
            ],
            ground_truth_depth: b
                .output(
                    "ground_truth_depth",
                    "depth of the left camera's pixels along the optical axis, m, 32FC1",
                )
                .role(Role::Depth)
                .truth()
                .build(),
            ground_truth_labels: b
                .output("ground_truth_labels", "obstacle label of the left camera's pixels, mono8")
                .role(Role::Labels)
                .palette("obstacle_labels")
                .classes(&OBSTACLE_CLASSES)
                .overlay_of("left")
                .truth()
                .build(),
            ground_truth_class: b
                .output("ground_truth_class", "class of the left camera's pixels, mono8")
                .role(Role::Labels)
                .palette("surfaces")
                .overlay_of("left")
                .truth()
                .build(),
        }
    }

    fn check(params: &SimCamerasParams) -> Result<(), String> {
        CameraSet::camera(params)?;
        read_look(&params.look)?;
        check_world(&params.world).map(|_| ())
    }

    fn new(_params: &SimCamerasParams) -> Self {
        Self::default()
    }

    fn cycle(&mut self, ports: &Ports, params: &SimCamerasParams, cx: &mut Cycle<'_>) {
        let cameras = match self.cameras(params) {
            Ok(cameras) => cameras,
            Err(error) => {
                cx.error(error);
                return;
            }
        };
        let Some(state) = cx.read_newest(&ports.ground_truth_state) else {
            cx.exec(cameras.status("waits for the vehicle's pose", cx.period_s()));
            return;
        };
        let time = state.acq_time();
        let due = self.last.is_none_or(|last| is_due(last.0, time.0, cameras.rate_hz));
        self.last = Some(time);
        cx.exec(cameras.status("takes images", cx.period_s()));
        if !due {
            return;
        }
        match pose_of(state.pose.as_ref(), "vehicle") {
            Ok(global_from_vehicle) => {
                let condition = self.condition.get_or_insert_with(|| Condition::new(&cameras.spec, cx.rng()));
                cameras.take(&global_from_vehicle, condition, time, ports, params, cx);
            }
            Err(error) => cx.fault(format!("{error}; image skipped")),
        }
    }
}

impl SimCameras {
    fn cameras(&mut self, params: &SimCamerasParams) -> Result<Arc<CameraSet>, String> {
        if let Some(cameras) = self.cameras.as_ref().filter(|cameras| cameras.is_of(params)) {
            return Ok(Arc::clone(cameras));
        }
        let cameras = Arc::new(CameraSet::new(params)?);
        self.cameras = Some(Arc::clone(&cameras));
        Ok(cameras)
    }
}

impl CameraSet {
    /// The camera named by the parameters, its lens, and the vehicle that carries it.
    fn camera(params: &SimCamerasParams) -> Result<(CameraSpec, PinholeCamera, VehicleSpec), String> {
        let vehicle = read_vehicle(&params.vehicle)?;
        let Some(spec) = vehicle.camera(&params.pair) else {
            let names: Vec<&str> = vehicle.cameras.iter().map(|camera| camera.name.as_str()).collect();
            return Err(format!(
                "pair is {:?}, expected a camera of the vehicle: {}",
                params.pair,
                names.join(", ")
            ));
        };
        Ok((spec.clone(), lens_of(spec, params)?, vehicle))
    }

    fn new(params: &SimCamerasParams) -> Result<CameraSet, String> {
        let (spec, lens, vehicle) = CameraSet::camera(params)?;
        let world = read_world(&params.world, &params.look)?;
        let size = [lens.width as usize, lens.height as usize];
        Ok(CameraSet {
            texts: Texts::of(&[&params.world, &params.vehicle, &params.look]),
            params: SimCamerasParams {
                world: String::new(),
                vehicle: String::new(),
                look: String::new(),
                ..params.clone()
            },
            rate_hz: if params.rate_hz > 0.0 { params.rate_hz } else { spec.rate_hz },
            rays: CameraRays::new(&lens),
            right_rays: lowered(&spec, &lens)?.map(|lens| CameraRays::new(&lens)),
            vehicle,
            sensor: Sensor::new(&spec, size),
            spec,
            lens,
            world,
        })
    }

    fn is_of(&self, params: &SimCamerasParams) -> bool {
        let own = &self.params;
        let same = own.pair == params.pair
            && own.width_px == params.width_px
            && own.rate_hz == params.rate_hz
            && own.distortion == params.distortion;
        same && self.texts.are(&[&params.world, &params.vehicle, &params.look])
    }

    /// What the process does, and whether fewer images than asked for are possible with its period.
    fn status(&self, doing: &'static str, period_s: f64) -> Text {
        match limit(self.rate_hz, period_s, self.vehicle.rates.ground_truth_hz) {
            Some(limit) => format!("{doing}: {limit}").into(),
            None => doing.into(),
        }
    }

    /// Renders and sends the images of all cameras.
    fn take(
        &self,
        global_from_vehicle: &Pose,
        condition: &mut Condition,
        time: Stamp,
        ports: &Ports,
        params: &SimCamerasParams,
        cx: &mut Cycle<'_>,
    ) {
        let exposures = condition.exposures(&self.spec, cx.rng());
        let sunlight = self.vehicle.clouds.map_or(1.0, |clouds| sunlight(&clouds, time) as f32);
        let poses = [0, 1].map(|side| {
            *global_from_vehicle * self.spec.vehicle_from_camera(side) * condition.camera_from_turned(side)
        });
        let views = self.draw(&poses, sunlight, params.noise.then_some(&exposures), cx.pool());
        if params.noise {
            condition.control(&self.spec, &views[0].pixels, time);
        }
        let time = stamped(&self.spec, time, cx.rng());
        let (channels, encoding) = encoding_of(self.spec.kind);
        let [width, height] = [self.lens.width, self.lens.height];
        let image = |side: usize, encoding: &str, bytes: u32, data: Vec<u8>| RawImage {
            timestamp: Some(time.to_proto()),
            frame_id: self.spec.frame(side),
            width,
            height,
            encoding: encoding.to_owned(),
            step: width * bytes,
            data: data.into(),
        };
        for (side, view) in views.into_iter().enumerate() {
            cx.write(&ports.calibrations[side], time, self.calibration(side, time));
            cx.write(&ports.images[side], time, image(side, encoding, channels as u32, view.pixels));
            if side == 0 && params.ground_truth {
                let mut depth = Vec::with_capacity(4 * view.depth_m.len());
                view.depth_m.iter().for_each(|depth_m| depth.extend_from_slice(&depth_m.to_le_bytes()));
                cx.write(&ports.ground_truth_depth, time, image(side, "32FC1", 4, depth));
                cx.write(&ports.ground_truth_labels, time, image(side, "mono8", 1, view.label));
                cx.write(&ports.ground_truth_class, time, image(side, "mono8", 1, view.class));
            }
        }
    }

    /// Renders the views of all cameras, strip by strip.
    fn draw(
        &self,
        poses: &[Pose; 2],
        sunlight: f32,
        exposures: Option<&[Exposure; 2]>,
        pool: &Pool,
    ) -> Vec<View> {
        let (width, height) = (self.rays.width(), self.rays.height());
        let pixels = width * height;
        let mut views: Vec<View> = (0..self.spec.cameras())
            .map(|_| View {
                pixels: vec![0; 3 * pixels],
                depth_m: vec![f32::NAN; pixels],
                class: vec![0; pixels],
                label: vec![0; pixels],
            })
            .collect();
        let strip = STRIP_ROWS * width;
        let mut strips: Vec<Strip<'_>> = Vec::new();
        for (side, view) in views.iter_mut().enumerate() {
            let parts = view
                .pixels
                .chunks_mut(3 * strip)
                .zip(view.depth_m.chunks_mut(strip))
                .zip(view.class.chunks_mut(strip))
                .zip(view.label.chunks_mut(strip));
            strips.extend(parts.enumerate().map(|(index, (((rgb, depth_m), class), label))| Strip {
                side,
                first_row: index * STRIP_ROWS,
                out: ViewRows { rgb, depth_m, class, label },
            }));
        }
        pool.for_each_chunk_mut(&mut strips, 1, |_, strips| {
            for strip in strips {
                let rows = strip.first_row..(strip.first_row + STRIP_ROWS).min(height);
                let rays = self.right_rays.as_ref().filter(|_| strip.side == 1).unwrap_or(&self.rays);
                render_rows(&self.world, rays, &poses[strip.side], sunlight, rows, &mut strip.out);
                if self.spec.kind != CameraKind::Infrared
                    && let Some(exposures) = exposures
                {
                    self.sensor.expose::<3>(&exposures[strip.side], strip.first_row, strip.out.rgb);
                }
            }
        });
        drop(strips);
        if self.spec.kind == CameraKind::Infrared {
            for view in &mut views {
                let colours = view.pixels.chunks_exact(3).map(|rgb| [rgb[0], rgb[1], rgb[2]]);
                let mut grey: Vec<u8> =
                    colours.zip(&view.class).map(|(rgb, &class)| thermal(class, rgb)).collect();
                if let Some([only, _]) = exposures {
                    self.sensor.expose::<1>(only, 0, &mut grey);
                }
                view.pixels = grey;
            }
        }
        views
    }

    /// The calibration as it would be made for real cameras: the raw lens, and the rectified parallel cameras.
    fn calibration(&self, side: usize, time: Stamp) -> CameraCalibration {
        let PinholeCamera { fx, fy, cx, cy, .. } = self.lens;
        let shift = if side == 0 { 0.0 } else { -fx * self.spec.baseline_m };
        let d = match self.lens.distortion {
            Distortion::PlumbBob(d) => d.to_vec(),
            _ => vec![0.0; 5],
        };
        CameraCalibration {
            timestamp: Some(time.to_proto()),
            frame_id: self.spec.frame(side),
            width: self.lens.width,
            height: self.lens.height,
            distortion_model: "plumb_bob".to_owned(),
            d,
            k: vec![fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
            r: vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
            p: vec![fx, 0.0, cx, shift, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
        }
    }
}

/// The lens with the size and distortion of the parameters.
fn lens_of(spec: &CameraSpec, params: &SimCamerasParams) -> Result<PinholeCamera, String> {
    let mut lens = spec.lens.clone();
    if params.width_px > 0 {
        let height_px = (params.width_px * lens.height + lens.width / 2) / lens.width;
        let size = [params.width_px, height_px.max(1)];
        lens = lens.resized(size).map_err(|error| format!("width_px: {error}"))?;
    }
    if !params.distortion {
        let size = [lens.width, lens.height];
        lens = PinholeCamera::new(size, [lens.fx, lens.fy], [lens.cx, lens.cy], Distortion::None)
            .map_err(|error| format!("distortion: {error}"))?;
    }
    Ok(lens)
}

/// The lens of the right camera, if its image is lower than its calibration says.
fn lowered(spec: &CameraSpec, lens: &PinholeCamera) -> Result<Option<PinholeCamera>, String> {
    if spec.vertical_offset_px == 0.0 {
        return Ok(None);
    }
    let offset_px = spec.vertical_offset_px * f64::from(lens.height) / f64::from(spec.lens.height);
    let size = [lens.width, lens.height];
    PinholeCamera::new(size, [lens.fx, lens.fy], [lens.cx, lens.cy + offset_px], lens.distortion)
        .map(Some)
        .map_err(|error| format!("vertical_offset_px: {error}"))
}
