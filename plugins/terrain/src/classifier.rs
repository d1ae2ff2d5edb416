//! The process `classifier`: classifies windows of an image by terrain models.
//!
//! | port | direction | type | what |
//! | --- | --- | --- | --- |
//! | `image` | in | `foxglove.RawImage` | colour image |
//! | `calibration` | in | `foxglove.CameraCalibration` | calibration of the image |
//! | `models` | in, optional | `rcs.TerrainModels` | terrain models; the newest replace earlier ones |
//! | `depth` | in, optional | `foxglove.RawImage` | depth of the image's pixels along the optical axis, m, from stereo |
//! | `odometry` | in, optional | `foxglove.Odometry` | pose of the vehicle in the local frame |
//! | `pose` | in, optional | `foxglove.PoseInFrame` | pose of the vehicle, or of the frame that `pose.stream_frame` names, in the local frame |
//! | `transforms` | in, optional | `foxglove.FrameTransforms` | transforms between frames at their times |
//! | `static_transforms` | in, optional | `foxglove.FrameTransforms` | transforms that hold at all times |
//! | `classes` | out | `foxglove.RawImage` | class of each pixel: 0 not known, 1 traversable, 2 not |
//! | `cost` | out | `foxglove.Grid` | 201x201 cells of 0.2 m: field cost.classifier, local frame |
//! | `stats` | out | `rcs.ClassifierStats` | windows by class, cells with a cost |
//!
//! Period 200 ms (5 Hz, Albus 2006b, 3.4). No commands besides those of the runtime. State: the poses of the last
//! seconds, images that wait for their depth, the models.
//!
//! [`crate::classify`] compares windows with models, [`crate::place`] projects them onto the map. With `region =
//! CLASSIFIER_BEYOND_STEREO` an image waits for the depth of its time, and is classified beyond the end of good stereo;
//! when no depth has arrived for a while, whole images are classified. Windows higher above the horizon than
//! `above_horizon_deg` are never classified. Unusable data are a fault and are skipped, as in the learner, and so are
//! images of a camera that is rolled by more than 45°; without models nothing is sent.
//!
//! Both cost maps are in the local frame; each world model resamples them to its own cells.

use crate::appearance::{MatchWeights, RatioBins};
use crate::classify::{Class, Matcher, WindowGrid, classify_row, end_of_stereo, overlay};
use crate::model_file::{ModelsError, matching_of, models_of_text};
use crate::models::ModelSet;
use crate::place::{Placed, View, Windows, place, region};
use crate::proto::{ClassifierParams, ClassifierRegion, ClassifierStats, TerrainModels};
use crate::sync::{Recent, not_ahead};
use crate::texture::PaddedGrey;
use crate::unusable::{Unusable, depths};
use rcs_geom::PinholeCamera;
use rcs_msg::Stamp;
use rcs_msg::classes::TRAVERSABLE_CLASSES;
use rcs_msg::foxglove::{CameraCalibration, Grid, RawImage};
use rcs_runtime::{Cycle, In, NoCommands, Out, PortBuilder, Process, ProcessDef, Role};
use rcs_sense::{
    Axes, Extrinsics, ImageCheck, Localizer, PosePorts, SensorTime, camera_of, fingerprint_of_texts,
    read_calibration, upright, upright_columns,
};
use rcs_world::Source;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// State: poses, the camera, images that wait for their depth, and the models.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Classifier {
    localizer: Localizer,
    camera: Option<PinholeCamera>,
    images: Recent,
    /// The newest depth image only.
    depths: Recent,
    models: Option<Models>,
    /// Fingerprint of the model file of the parameters that was read last.
    loaded: u64,
    check: ImageCheck,
    /// Times of the first image, and of the last processed one.
    first: Option<Stamp>,
    done: Option<Stamp>,
    #[serde(skip)]
    ratios: Option<Arc<RatioBins>>,
}

/// The models, and how they are matched.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Models {
    set: ModelSet,
    span_octaves: f64,
    weights: MatchWeights,
}

impl Models {
    fn of(message: &TerrainModels) -> Result<Models, ModelsError> {
        let (span_octaves, weights) = matching_of(message)?;
        Ok(Models { set: ModelSet::from_message(message)?, span_octaves, weights })
    }
}

/// The models of the parameters; a text that [`Process::check`] refuses never gets here.
fn models_of_file(params: &ClassifierParams) -> Option<Models> {
    let message = models_of_text(&params.models).ok().flatten()?;
    Models::of(&message).ok()
}

/// Fingerprint of the model file of the parameters.
fn file(params: &ClassifierParams) -> u64 {
    fingerprint_of_texts(&[&params.models])
}

/// Ports of [`Classifier`].
#[derive(Debug)]
pub struct Ports {
    image: In<RawImage>,
    calibration: In<CameraCalibration>,
    models: In<TerrainModels>,
    depth: In<RawImage>,
    poses: PosePorts,
    classes: Out<RawImage>,
    cost: Out<Grid>,
    stats: Out<ClassifierStats>,
}

/// Work of a cycle.
enum Task {
    /// Classify the image of this time, with or without the newest depth.
    Classify(Stamp, bool),
    Wait(&'static str),
}

impl Process for Classifier {
    type Params = ClassifierParams;
    type Ports = Ports;
    type Command = NoCommands;
    const DEF: ProcessDef = ProcessDef {
        plugin: "classifier",
        summary: "Classifies windows of an image by terrain models, and maps their cost on flat ground",
        period_ms: 200.0,
        latency_ms: 4.0,
        reads_ground_truth: false,
    };

    fn ports(b: &mut PortBuilder) -> Ports {
        Ports {
            image: b.input("image", "colour image"),
            calibration: b.input("calibration", "calibration of the image"),
            models: b.optional_input("models", "terrain models; the newest replace earlier ones"),
            depth: b.optional_input(
                "depth",
                "depth of the image's pixels along the optical axis, m, from stereo",
            ),
            poses: PosePorts::declare(b),
            classes: b
                .output("classes", "class of each pixel: 0 not known, 1 traversable, 2 not")
                .role(Role::Labels)
                .palette("classes")
                .classes(&TRAVERSABLE_CLASSES)
                .overlay_of("image")
                .build(),
            cost: b
                .output("cost", "201x201 cells of 0.2 m: field cost.classifier, local frame")
                .role(Role::Cost)
                .palette("cost")
                .build(),
            stats: b.output("stats", "windows by class, cells with a cost").role(Role::Stats).build(),
        }
    }

    fn check(params: &ClassifierParams) -> Result<(), String> {
        models_of_text(&params.models).map(drop).map_err(|error| format!("models: {error}"))
    }

    fn new(params: &ClassifierParams) -> Self {
        Self {
            localizer: Localizer::default(),
            camera: None,
            images: Recent::default(),
            depths: Recent::default(),
            models: models_of_file(params),
            loaded: file(params),
            check: ImageCheck::default(),
            first: None,
            done: None,
            ratios: None,
        }
    }

    fn cycle(&mut self, ports: &Ports, params: &ClassifierParams, cx: &mut Cycle<'_>) {
        ports.poses.read(&mut self.localizer, extrinsics(params).frames, cx);
        if self.loaded != file(params) {
            self.models = models_of_file(params);
            self.loaded = file(params);
        }
        self.read_camera_and_models(ports, params, cx);
        let is_new_depth = self.read_images(ports, cx);
        match self.task(is_new_depth, params, cx) {
            Task::Wait(text) => cx.exec(text),
            Task::Classify(time, with_depth) => {
                self.done = Some(time);
                let result = self.classify(time, with_depth, ports, params, cx);
                self.images.forget_before(time.after_ns(1));
                if let Err(error) = result {
                    cx.fault(format!("{error}; image skipped"));
                }
                cx.exec(if with_depth { "classifies beyond stereo" } else { "classifies whole images" });
            }
        }
    }
}

impl Classifier {
    fn read_camera_and_models(&mut self, ports: &Ports, params: &ClassifierParams, cx: &mut Cycle<'_>) {
        if let Some(calibration) =
            read_calibration(&ports.calibration, self.camera.is_some(), params.rectified, cx)
        {
            let camera = camera_of(&calibration, params.rectified);
            self.camera = camera.map_err(|error| cx.fault(Unusable::from(error).to_string())).ok();
        }
        if let Some(message) = cx.read_newest(&ports.models) {
            match Models::of(&message) {
                Ok(models) => self.models = Some(models),
                Err(error) => cx.fault(format!("models: {error}; skipped")),
            }
        }
    }

    /// Reads images and depths; returns whether a new depth has arrived.
    fn read_images(&mut self, ports: &Ports, cx: &mut Cycle<'_>) -> bool {
        let mut is_new_depth = false;
        for (port, recent, what) in
            [(&ports.image, &mut self.images, "image"), (&ports.depth, &mut self.depths, "depth")]
        {
            recent.miss(cx.missed(port));
            while let Some(message) = cx.read(port) {
                let (got, now) = (message.acq_time(), cx.now());
                recent.forget_ahead(got, now);
                if what == "image" {
                    self.first = not_ahead(self.first, got, now);
                    self.done = not_ahead(self.done, got, now);
                }
                // A processed image is no longer kept, but images older than it are still refused.
                let mut newest = recent.newest().max(if what == "image" { self.done } else { None });
                if recent.begins_again(newest, got) {
                    newest = None;
                    if what == "image" {
                        (self.first, self.done) = (None, None);
                    }
                    cx.fault(format!("the clock of the {what}s has begun again"));
                }
                if let Some(newest) = newest.filter(|&newest| newest >= got) {
                    cx.fault(format!("{}; skipped", Unusable::Late { what, got, newest }));
                } else if recent.add(got, (*message).clone()).is_ok() && what == "depth" {
                    recent.forget_before(got);
                    is_new_depth = true;
                }
            }
        }
        self.first = self.first.or(self.images.times().next());
        is_new_depth
    }

    /// Selects the image to classify: the one of the newest depth, or, without stereo, the newest one.
    fn task(&self, is_new_depth: bool, params: &ClassifierParams, cx: &mut Cycle<'_>) -> Task {
        let (Some(newest), Some(first)) = (self.images.newest(), self.first) else {
            return Task::Wait("waits for images");
        };
        if self.models.as_ref().is_none_or(|models| models.set.models.is_empty()) {
            return Task::Wait("waits for models");
        }
        if params.region() == ClassifierRegion::ClassifierWhole {
            return Task::Classify(newest, false);
        }
        let depth = self.depths.newest();
        // A depth that is as far ahead of the images is from the future, and not of any of them.
        if newest.seconds_since(depth.unwrap_or(first)).abs() > params.stereo_timeout_s {
            return Task::Classify(newest, false);
        }
        let Some(time) = depth else { return Task::Wait("waits for depth") };
        match self.images.at(time, params.sync_tolerance_s) {
            Some((time, _)) => Task::Classify(time, true),
            None if is_new_depth && self.done.is_none_or(|done| done < time) => {
                let nearest = self.images.times().map(|other| other.0.abs_diff(time.0)).min();
                let apart_s = nearest.map(|ns| ns as f64 * 1e-9);
                let missed = self.images.missed();
                let error = Unusable::Apart { what: "image", of: "depth", apart_s, missed };
                cx.fault(format!("{error}; depth skipped"));
                Task::Wait("waits for depth")
            }
            None => Task::Wait("waits for depth"),
        }
    }

    fn classify(
        &mut self,
        time: Stamp,
        with_depth: bool,
        ports: &Ports,
        params: &ClassifierParams,
        cx: &mut Cycle<'_>,
    ) -> Result<(), Unusable> {
        let Some((_, image)) = self.images.at(time, 0.0) else { return Ok(()) };
        let image = image.clone();
        let camera = self.camera.as_ref().ok_or(Unusable::NoCalibration)?;
        let pixels = [camera.width, camera.height];
        let rgb = self.check.check(&image, Some(pixels), params.image_check.as_ref())?;
        let size = pixels.map(|side| side as usize);
        let grid = WindowGrid::new(size, params.window_px as usize);
        let stereo_end = match self.depths.newest().and_then(|time| self.depths.at(time, 0.0)) {
            Some((_, depth)) if with_depth => {
                let depths = depths(depth, pixels, params.depth_scale_m)?;
                Some(end_of_stereo(&depths, &grid, params.good_stereo_m as f32))
            }
            _ => None,
        };
        let extrinsics = extrinsics(params);
        // The image, or its depth, has just come.
        let taken = SensorTime { acquired: time, arrived: cx.now() };
        let local_from_vehicle = extrinsics.local_from_vehicle(&self.localizer, taken)?;
        upright(&local_from_vehicle)?;
        let view = View {
            camera,
            local_from_vehicle,
            vehicle_from_camera: extrinsics.vehicle_from_sensor(
                &self.localizer,
                &image.frame_id,
                Axes::Optical,
                taken,
            )?,
            wheels_below_m: params.wheels_below_m,
        };
        upright_columns(&view.vehicle_from_camera)?;
        let Some(models) = &self.models else { return Ok(()) };
        let ratios = match &self.ratios {
            Some(ratios) if ratios.span_octaves() == models.span_octaves => ratios.clone(),
            _ => self.ratios.insert(Arc::new(RatioBins::new(models.span_octaves))).clone(),
        };
        let matcher = matcher(models, params);
        let sine_limit = libm::sin(params.above_horizon_deg.to_radians());
        let stereo_end = stereo_end.as_deref();
        let wanted = region(&view, &grid, sine_limit, stereo_end);
        let grey = PaddedGrey::from_rgb(&rgb, size[0], size[1]);
        let columns = grid.columns();
        let rows = cx.pool().map(grid.rows(), |row| {
            let wanted = &wanted[row * columns..(row + 1) * columns];
            classify_row(&rgb, &grey, &ratios, &grid, row, wanted, &matcher)
        });
        let classes = rows.concat();
        let windows = Windows { grid: &grid, classes: &classes, stereo_end };
        let placed = place(&view, &windows, params.max_range_m);
        cx.write(&ports.stats, time, stats(time, &classes, &matcher, stereo_end.is_some(), &placed));
        let overlay = RawImage {
            timestamp: Some(time.to_proto()),
            encoding: "mono8".to_owned(),
            step: image.width,
            data: overlay(&classes, &grid).into(),
            ..image
        };
        cx.write(&ports.classes, time, overlay);
        cx.write(&ports.cost, time, message_of(&placed, extrinsics.frames.local, time));
        Ok(())
    }
}

/// The costs, and the models that say so, as a message.
fn message_of(placed: &Placed, frame_id: &str, time: Stamp) -> Grid {
    let cells = placed.costs.iter().zip(&placed.models);
    let data = cells.flat_map(|(&cost, &model)| [cost, model]).collect();
    placed.frame().message_of_bytes(Source::CLASSIFIER, &["cost", "model"], data, frame_id, time)
}

/// How the poses of vehicle and camera are found.
fn extrinsics(params: &ClassifierParams) -> Extrinsics<'_> {
    Extrinsics::new(params.pose.as_ref(), params.mount.as_ref())
}

fn matcher(models: &Models, params: &ClassifierParams) -> Matcher {
    Matcher::new(
        &models.set,
        models.weights,
        params.max_distance as f32,
        u64::from(params.min_model_points),
        params.obstacle_pct / 100.0,
    )
}

fn stats(
    time: Stamp,
    classes: &[Class],
    matcher: &Matcher,
    with_stereo: bool,
    placed: &Placed,
) -> ClassifierStats {
    let count = |is: fn(&Class) -> bool| classes.iter().filter(|class| is(class)).count() as u64;
    ClassifierStats {
        timestamp: Some(time.to_proto()),
        traversable: count(|class| matches!(class, Class::Traversable(_))),
        not_traversable: count(|class| matches!(class, Class::NotTraversable(_))),
        unclassified: count(|class| *class == Class::Unclassified),
        skipped: count(|class| *class == Class::Skipped),
        models: matcher.models() as u64,
        with_stereo,
        cells: placed.cells(),
    }
}
