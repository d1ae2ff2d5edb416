//! The process `color_models`: reads images, runs the colour models, and sends costs and models. Its port table is
//! in the crate's documentation.

use crate::cost_map::CameraPlacement;
use crate::engine::{Engine, Samples};
use crate::file::to_message;
use crate::gate::{Odometer, SampleView, obstacle_in_sample};
use crate::hidden::Screens;
use crate::image::{Image, ImageSizeError};
use crate::output::{annotation, learning, permission, send_costs, text_of};
use crate::ports::Ports;
use crate::proto::{ColorLearning, ColorModelsParams, ColorStats};
use crate::region::{first_background, rays, spans};
use crate::settings::{extrinsics, files, initial_engine, initial_models, rectangle, settings};
use glam::DVec3;
use rcs_geom::{PinholeCamera, Pose};
use rcs_msg::Stamp;
use rcs_msg::foxglove::{CameraCalibration, Grid, RawImage};
use rcs_msg::rcs::ModelToDelete;
use rcs_runtime::{Cycle, Msg, PortBuilder, Process, ProcessDef, Role};
use rcs_sense::{
    Axes, ImageCheck, ImageFault, InOrder, Localizer, LocalizerError, OnItsSide, PosePorts, Rolled,
    SensorTime, camera_of, model_to_delete, read_calibration, upright, upright_columns,
};
use rcs_world::GridView;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// While images arrive, models are sent at least this often, s.
const MODELS_PERIOD_S: f64 = 1.0;

rcs_runtime::commands! {
    /// Commands of [`ColorModelLearner`].
    pub enum ColorModelsCommand {
        Clear = "CLEAR" once: "Forget what was learned; begin with the model files again.",
        Delete(ModelToDelete) = "DELETE" once: "Delete a model, learned or from a file.",
        LearnOn = "LEARN_ON": "Learn, where nothing else forbids it.",
        LearnOff = "LEARN_OFF": "Keep all models as they are.",
    }
}

/// State: models and fused probabilities, the poses of the last seconds, the camera.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ColorModelLearner {
    engine: Engine,
    localizer: Localizer,
    odometer: Odometer,
    camera: Option<PinholeCamera>,
    /// Rays of `camera`, computed on first use.
    #[serde(skip)]
    rays: Option<Arc<Vec<DVec3>>>,
    check: ImageCheck,
    order: InOrder,
    /// Sample budget to which the models are scaled.
    samples: u32,
    /// Fingerprint of the model files with which the engine started.
    loaded: u64,
    learns: bool,
    models_sent: Option<Stamp>,
}

/// Why an image was skipped.
#[derive(Debug, thiserror::Error)]
enum Unusable {
    #[error("image without a calibration")]
    NoCalibration,
    #[error("image is {late_s:.3} s older than the one before")]
    Late { late_s: f64 },
    #[error(transparent)]
    Image(#[from] ImageFault),
    #[error(transparent)]
    Size(#[from] ImageSizeError),
    #[error(transparent)]
    Pose(#[from] LocalizerError),
    #[error(transparent)]
    OnItsSide(#[from] OnItsSide),
    #[error(transparent)]
    Rolled(#[from] Rolled),
}

impl Process for ColorModelLearner {
    type Params = ColorModelsParams;
    type Ports = Ports;
    type Command = ColorModelsCommand;
    const DEF: ProcessDef = ProcessDef {
        plugin: "color_models",
        summary: "Learns colour models of ground and background, and maps the cost of what the camera sees",
        period_ms: 200.0,
        latency_ms: 2.0,
        reads_ground_truth: false,
    };

    fn ports(b: &mut PortBuilder) -> Ports {
        Ports {
            image: b.input("image", "colour image, distorted as the calibration says or rectified"),
            calibration: b.input("calibration", "calibration of the image"),
            poses: PosePorts::declare(b),
            map: b.optional_input(
                "map",
                "world model, local frame: obstacles in the ground sample prevent learning, and hide known obstacles behind them",
            ),
            probability: b
                .output("probability", "cost 250(1 - P) of the 128x96 image, 255 unclassified")
                .role(Role::Cost)
                .palette("cost")
                .overlay_of("image")
                .build(),
            sample: b
                .output("sample", "outline of the ground sample, pixels of the image")
                .role(Role::Annotations)
                .overlay_of("image")
                .build(),
            cost: b
                .output("cost", "cost of 201x201 cells of 0.2 m around the vehicle, and its backing by known obstacles, local frame")
                .role(Role::Cost)
                .palette("cost")
                .build(),
            models: b
                .output("models", "the models, once a second and after each new one")
                .role(Role::Models)
                .build(),
            stats: b.output("stats", "pixels by class, models, learning").role(Role::Stats).build(),
        }
    }

    fn check(params: &ColorModelsParams) -> Result<(), String> {
        initial_models(params).map(|_| ())
    }

    fn new(params: &ColorModelsParams) -> Self {
        Self {
            engine: initial_engine(params),
            localizer: Localizer::default(),
            odometer: Odometer::default(),
            camera: None,
            rays: None,
            check: ImageCheck::default(),
            order: InOrder::default(),
            samples: params.samples,
            loaded: files(params),
            learns: true,
            models_sent: None,
        }
    }

    fn cycle(&mut self, ports: &Ports, params: &ColorModelsParams, cx: &mut Cycle<'_>) {
        while let Some(command) = cx.next_command::<Self>() {
            match command {
                ColorModelsCommand::Clear => {
                    self.engine = initial_engine(params);
                    self.send_models(cx.now(), ports, cx);
                }
                ColorModelsCommand::Delete(model) => match self.delete(&model) {
                    Ok(()) => self.send_models(cx.now(), ports, cx),
                    Err(error) => cx.fault(format!("DELETE: {error}")),
                },
                ColorModelsCommand::LearnOn => self.learns = true,
                ColorModelsCommand::LearnOff => self.learns = false,
            }
        }
        if self.samples != params.samples {
            self.engine.models.rescale(params.samples);
            self.samples = params.samples;
        }
        if self.loaded != files(params) {
            self.engine = initial_engine(params);
            self.loaded = files(params);
            self.send_models(cx.now(), ports, cx);
        }
        ports.poses.read(&mut self.localizer, extrinsics(params).frames, cx);
        if let Some(calibration) =
            read_calibration(&ports.calibration, self.camera.is_some(), params.rectified, cx)
        {
            self.read_calibration(&calibration, params, cx);
        }
        let Some(image) = cx.read_newest(&ports.image) else {
            return cx.exec("waits for an image");
        };
        match self.see(&image, ports, params, cx) {
            Ok(ColorLearning::ColorNoSample) if self.engine.models.ground.is_empty() => {
                cx.exec("waits for ground in view");
            }
            Ok(learning) => cx.exec(text_of(learning)),
            Err(error) => {
                cx.fault(format!("{error}; image skipped"));
                cx.exec("waits for an image that it can use");
            }
        }
    }
}

impl ColorModelLearner {
    fn read_calibration(
        &mut self,
        calibration: &CameraCalibration,
        params: &ColorModelsParams,
        cx: &mut Cycle<'_>,
    ) {
        let camera = camera_of(calibration, params.rectified);
        let camera = camera.map_err(|error| cx.fault(format!("calibration: {error}"))).ok();
        if camera != self.camera {
            self.camera = camera;
            self.rays = None;
        }
    }

    fn see(
        &mut self,
        image: &Msg<RawImage>,
        ports: &Ports,
        params: &ColorModelsParams,
        cx: &mut Cycle<'_>,
    ) -> Result<ColorLearning, Unusable> {
        let time = image.acq_time();
        if self.order.take(time, cx.now()).map_err(|late_s| Unusable::Late { late_s })? {
            cx.fault("the clock of the images has begun again");
        }
        let camera = self.camera.clone().ok_or(Unusable::NoCalibration)?;
        let size = [camera.width, camera.height];
        let rgb = self.check.check(image, Some(size), params.image_check.as_ref())?;
        let size = size.map(|side| side as usize);
        let pixels = Image::new(size, 3 * size[0], &rgb)?;
        let taken = SensorTime::of(image);
        let local_from_vehicle = self.vehicle(taken, params)?;
        let vehicle_from_camera =
            extrinsics(params).vehicle_from_sensor(&self.localizer, &image.frame_id, Axes::Optical, taken)?;
        upright_columns(&vehicle_from_camera)?;
        let rays = self.rays.get_or_insert_with(|| Arc::new(rays(&camera))).clone();

        let rectangle = rectangle(params);
        let outline = rectangle.outline(&camera, &vehicle_from_camera);
        let spans = spans(&outline, size);
        let view = SampleView {
            camera: &camera,
            vehicle_from_camera: &vehicle_from_camera,
            local_from_vehicle: &local_from_vehicle,
            rectangle: &rectangle,
            spans: &spans,
        };
        let off = self.off(&view, taken, ports, params, cx);
        let samples = Samples {
            ground: &spans,
            frame_id: &image.frame_id,
            first_background: &first_background(
                &rays,
                &vehicle_from_camera,
                size[1],
                params.below_horizon_px,
            ),
            permission: permission(off),
        };
        let seen = self.engine.see(&pixels, &samples, time, &settings(params), cx.rng());
        let learning = learning(&seen, off, params);
        let place = CameraPlacement {
            camera: &camera,
            rays: &rays,
            vehicle_from_camera: &vehicle_from_camera,
            local_from_vehicle: &local_from_vehicle,
            below_m: params.wheels_below_m,
            tilt_noise_rad: params.tilt_noise_deg.to_radians(),
        };
        cx.write(&ports.sample, time, annotation(&outline, time));
        let map = recent_map(taken, ports, params, cx);
        let map = map.as_ref().and_then(|map| view_of(map, params).ok());
        let screens = map.as_ref().and_then(Screens::of);
        let cells = send_costs(&seen, &place, screens.as_ref(), image, ports, params, cx);
        let left_ns = self.engine.models.learning_left_ns().unwrap_or(0);
        let stats = ColorStats {
            timestamp: Some(time.to_proto()),
            ground_models: self.engine.models.ground.len() as u32,
            learning: learning.into(),
            difference: f64::from(seen.difference),
            sample_pixels: seen.sample_pixels,
            ground: seen.counts.ground,
            background: seen.counts.background,
            unclassified: seen.counts.unclassified,
            cells: cells[0],
            obstacle_cells: cells[1],
            learning_left_s: left_ns as f64 * 1e-9,
        };
        cx.write(&ports.stats, time, stats);
        let due = self.models_sent.is_none_or(|sent| time.seconds_since(sent).abs() >= MODELS_PERIOD_S);
        if due || learning == ColorLearning::ColorAdded {
            self.send_models(time, ports, cx);
        }
        Ok(learning)
    }

    fn send_models(&mut self, time: Stamp, ports: &Ports, cx: &mut Cycle<'_>) {
        cx.write(&ports.models, time, to_message(&self.engine.models, time));
        // A time from the future would stop the sending until then.
        self.models_sent = Some(time.min(cx.now()));
    }

    /// Deletes a model.
    fn delete(&mut self, model: &ModelToDelete) -> Result<(), String> {
        if model.output != "models" {
            return Err(format!("there are no models of {:?}", model.output));
        }
        let number = model_to_delete(&self.engine.models.names(), model)?;
        self.engine.models.delete(number);
        Ok(())
    }

    fn vehicle(&self, taken: SensorTime, params: &ColorModelsParams) -> Result<Pose, Unusable> {
        let pose = extrinsics(params).local_from_vehicle(&self.localizer, taken)?;
        upright(&pose)?;
        Ok(pose)
    }

    /// Why ground is not learned from this image; `None` where it is. With a fixed pose the motion is unknown and not
    /// checked.
    fn off(
        &mut self,
        view: &SampleView<'_>,
        taken: SensorTime,
        ports: &Ports,
        params: &ColorModelsParams,
        cx: &mut Cycle<'_>,
    ) -> Option<ColorLearning> {
        let motion = self.odometer.take(taken.acquired, view.local_from_vehicle);
        if !self.learns {
            return Some(ColorLearning::ColorOffCommand);
        }
        match obstacle_ahead(view, taken, ports, params, cx) {
            Ok(false) => {}
            Ok(true) => return Some(ColorLearning::ColorOffObstacle),
            Err(fault) => {
                cx.fault(format!("{fault}; nothing is learned"));
                return Some(ColorLearning::ColorOffObstacle);
            }
        }
        if extrinsics(params).fixed_pose {
            return None;
        }
        // Without motion from poses the vehicle is taken to stand: it has not begun to move.
        let Some(motion) = motion else { return Some(ColorLearning::ColorOffStanding) };
        if motion.turn_rate_radps > params.max_turn_rate_dps.to_radians() {
            Some(ColorLearning::ColorOffTurning)
        } else if motion.speed_mps < params.min_speed_mps {
            Some(ColorLearning::ColorOffStanding)
        } else {
            None
        }
    }
}

/// Whether a sufficiently recent map has an obstacle in the sample.
fn obstacle_ahead(
    view: &SampleView<'_>,
    taken: SensorTime,
    ports: &Ports,
    params: &ColorModelsParams,
    cx: &mut Cycle<'_>,
) -> Result<bool, String> {
    let Some(map) = recent_map(taken, ports, params, cx) else { return Ok(false) };
    Ok(obstacle_in_sample(&view_of(&map, params)?, view))
}

/// The newest map, unless it is too old for an image. Both count as no newer than their arrival, because clocks may be ahead.
fn recent_map(
    taken: SensorTime,
    ports: &Ports,
    params: &ColorModelsParams,
    cx: &mut Cycle<'_>,
) -> Option<Msg<Grid>> {
    let time = taken.on_arrival();
    let apart_s = |map: &Msg<Grid>| time.seconds_since(map.acq_time_on_arrival()).abs();
    cx.latest(&ports.map).filter(|map| apart_s(map) <= params.map_max_age_s)
}

/// A map in the local frame.
fn view_of<'a>(map: &'a Msg<Grid>, params: &ColorModelsParams) -> Result<GridView<'a>, String> {
    let grid = GridView::of(map.message()).map_err(|error| format!("map: {error}"))?;
    let local = extrinsics(params).frames.local;
    if grid.frame_id() != local {
        return Err(format!("map's frame is {:?}, expected {local:?}", grid.frame_id()));
    }
    Ok(grid)
}
