//! The process `terrain_learner`: learns terrain models from labelled images.

use crate::appearance::{MatchWeights, RatioBins};
use crate::camera::{CameraPorts, Frame, LearnerCamera, extrinsics, learned_port};
use crate::experience::{TeacherPorts, Teachers};
use crate::frame::join;
use crate::judgement::Judgement;
use crate::map::{Learned, TerrainMap};
use crate::model_file::models_of_text;
use crate::models::{ModelRules, ModelSet};
use crate::proto::{TerrainCamera, TerrainCameras, TerrainLearnerParams, TerrainModels, TerrainStats};
use crate::sync::not_ahead;
use crate::unusable::Unusable;
use rcs_geom::CellIndex;
use rcs_msg::Stamp;
use rcs_msg::foxglove::{Grid, RawImage};
use rcs_msg::rcs::ModelToDelete;
use rcs_runtime::{Cycle, Out, PortBuilder, Process, ProcessDef, Role};
use rcs_sense::{
    Axes, CELL_SIZE_M, ClockWatch, FrameWatch, GridFrame, Localizer, PosePorts, SensorTime,
    fingerprint_of_texts, model_to_delete, text_above,
};
use rcs_world::{SIDE, Source, UNKNOWN_COST};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

rcs_runtime::commands! {
    /// Commands of [`TerrainLearner`].
    pub enum TerrainLearnerCommand {
        Clear = "CLEAR" once: "Forget the map and all models.",
        Delete(ModelToDelete) = "DELETE" once: "Delete a model, and forget the cells that are part of it.",
    }
}

/// State: poses, the last images of the cameras, what bumper and wheels said last, and one map with its models for each
/// learned set.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct TerrainLearner {
    localizer: Localizer,
    frame_watch: FrameWatch,
    cameras: [LearnerCamera; 2],
    /// One map where one camera learns or both share it; otherwise one per camera.
    maps: Vec<TerrainMap>,
    /// Time of the first labels of any camera.
    begun: Option<Stamp>,
    teachers: Teachers,
    /// When it last sent what it knows, and whether driving has taught it something since.
    sent: Option<Stamp>,
    unsent: bool,
    /// Fingerprint of the model files with which the maps began.
    loaded: u64,
    #[serde(skip)]
    ratios: Option<Arc<RatioBins>>,
}

/// Ports of [`TerrainLearner`].
#[derive(Debug)]
pub struct Ports {
    left: CameraPorts,
    right: CameraPorts,
    teachers: TeacherPorts,
    poses: PosePorts,
    cost: Out<Grid>,
    models: [Out<TerrainModels>; 2],
    learned: [Out<RawImage>; 2],
    stats: Out<TerrainStats>,
}

/// What driving teaches is sent after this time if no image comes before, s.
const SEND_AFTER_S: f64 = 0.2;

/// Each frame centres the maps on the vehicle. Where none comes, they follow it in steps of this length, m: a map that moved
/// to and fro would forget the cells at its border.
const FOLLOWS_M: f64 = 5.0;

/// What a frame of a camera taught.
struct Lesson {
    side: usize,
    time: Stamp,
    learned: Learned,
    /// Why nothing was learned.
    refusal: Option<&'static str>,
}

/// What is known of the cells of a map.
struct Known {
    south_west: CellIndex,
    /// By rows.
    cells: Vec<Option<Judgement>>,
    /// Number of cells with points or experience, and number of cells that are part of a model.
    counts: [u64; 2],
}

/// Names of the cameras.
const SIDES: [&str; 2] = ["left", "right"];

impl Process for TerrainLearner {
    type Params = TerrainLearnerParams;
    type Ports = Ports;
    type Command = TerrainLearnerCommand;
    const DEF: ProcessDef = ProcessDef {
        plugin: "terrain_learner",
        summary: "Learns the appearance of terrain from labelled range images and from driving over it",
        period_ms: 333.0,
        latency_ms: 8.0,
        reads_ground_truth: false,
    };

    fn ports(b: &mut PortBuilder) -> Ports {
        Ports {
            left: CameraPorts::left(b),
            right: CameraPorts::right(b),
            teachers: TeacherPorts::declare(b),
            poses: PosePorts::declare(b),
            cost: b
                .output(
                    "cost",
                    "all known cells of 201x201 of 0.2 m: fields cost.terrain, conf.terrain and backing.terrain, local frame",
                )
                .role(Role::Cost)
                .palette("cost")
                .build(),
            models: [
                b.output("models", "models of the left camera, or of both").role(Role::Models).build(),
                b.output("models_right", "models of the right camera, where it has its own")
                    .role(Role::Models)
                    .build(),
            ],
            learned: [
                learned_port(b, "learned_left", "left_image"),
                learned_port(b, "learned_right", "right_image"),
            ],
            stats: b.output("stats", "points, cells and models after each frame").role(Role::Stats).build(),
        }
    }

    fn check(params: &TerrainLearnerParams) -> Result<(), String> {
        for (name, text) in [("models", &params.models), ("models_right", &params.models_right)] {
            let models = models_of_text(text).map_err(|error| format!("{name}: {error}"))?;
            let expected = params.ratio_span_octaves;
            let got = models.map(|models| models.ratio_span_octaves);
            // JSON may change the last bit of a number.
            if let Some(got) = got.filter(|got| (got - expected).abs() > 1e-9) {
                return Err(format!(
                    "{name}: bins span {got} octaves, expected ratio_span_octaves, {expected}"
                ));
            }
        }
        Ok(())
    }

    fn new(params: &TerrainLearnerParams) -> Self {
        Self {
            localizer: Localizer::default(),
            frame_watch: FrameWatch::default(),
            cameras: Default::default(),
            maps: maps(params),
            begun: None,
            teachers: Teachers::default(),
            sent: None,
            unsent: false,
            loaded: files(params),
            ratios: None,
        }
    }

    fn cycle(&mut self, ports: &Ports, params: &TerrainLearnerParams, cx: &mut Cycle<'_>) {
        let extrinsics = extrinsics(params);
        let has_clock_begun_again = ports.poses.read(&mut self.localizer, extrinsics.frames, cx);
        let mut changed = false;
        while let Some(command) = cx.next_command::<Self>() {
            match command {
                TerrainLearnerCommand::Clear => {
                    self.renew_maps(vec![map_with(ModelSet::default()); self.maps.len()]);
                    changed = true;
                }
                TerrainLearnerCommand::Delete(model) => {
                    self.delete(&model).unwrap_or_else(|error| cx.fault(format!("DELETE: {error}")));
                    changed = true;
                }
            }
        }
        // Parameters may change during a run.
        if self.loaded != files(params) {
            self.renew_maps(maps(params));
            self.loaded = files(params);
            changed = true;
        }
        changed |= self.follow(has_clock_begun_again && !extrinsics.fixed_pose, params, cx);
        let rules = rules(params);
        let mut lessons = Vec::new();
        for side in 0..if params.cameras() == TerrainCameras::TerrainLeft { 1 } else { 2 } {
            let camera_ports = [&ports.left, &ports.right][side];
            let Some(labels) = self.cameras[side].read(camera_ports, SIDES[side], params, cx) else {
                continue;
            };
            let time = labels.time;
            if labels.begins_again {
                // The times of the old clock are no measure of what is late.
                self.begun = None;
                let other = &mut self.cameras[1 - side].newest;
                *other = other.filter(|&other| !ClockWatch::is_far_behind(other, time));
            }
            self.begun = not_ahead(self.begun, time, cx.now()).or(Some(time));
            match self.cameras[side].frame(time, &labels.image, params) {
                Ok(frame) => match self.learn(side, &frame, params, &rules, ports, cx) {
                    Ok(lesson) => lessons.push(lesson),
                    Err(error) => cx.fault(format!("{} camera: {error}; frame skipped", SIDES[side])),
                },
                Err(error) => cx.fault(format!("{} camera: {error}; frame skipped", SIDES[side])),
            }
        }
        self.report_late_camera(params, cx);
        let [driven, told] =
            self.teachers.teach(&mut self.maps, &self.localizer, &ports.teachers, params, &rules, cx);
        self.unsent |= driven;
        let now = cx.now();
        let is_late = self.sent.is_none_or(|sent| now.seconds_since(sent) >= SEND_AFTER_S);
        if !lessons.is_empty() || told || changed || (self.unsent && is_late) {
            let known = |map: &TerrainMap| {
                let (south_west, cells) = map.judgements(&rules);
                Known { south_west, cells, counts: map.counts() }
            };
            let known: Vec<Known> = self.maps.iter().map(known).collect();
            for lesson in &lessons {
                self.send_stats(lesson, &known, ports, cx);
            }
            let newest = lessons.iter().map(|lesson| lesson.time).max();
            self.send(newest.unwrap_or(now), params, &rules, &known, ports, cx);
            (self.sent, self.unsent) = (Some(now), false);
        }
        cx.exec(match lessons.last() {
            Some(lesson) => lesson.refusal.unwrap_or("learns from labelled range"),
            None => "waits for labels",
        });
    }
}

impl TerrainLearner {
    /// Begins with other maps where the ones before were.
    fn renew_maps(&mut self, maps: Vec<TerrainMap>) {
        let middle = self.maps.first().map(TerrainMap::middle);
        self.maps = maps;
        if let Some(middle) = middle {
            self.maps.iter_mut().for_each(|map| map.recentre(middle));
        }
    }

    /// Centres maps on the vehicle from whose middle it is far: see [`FOLLOWS_M`]. Where the local frame has begun again, the
    /// cells lie elsewhere now, and are forgotten. Returns whether they are.
    fn follow(
        &mut self,
        has_clock_begun_again: bool,
        params: &TerrainLearnerParams,
        cx: &mut Cycle<'_>,
    ) -> bool {
        // Without a pose they stay; frames report it.
        let pose = extrinsics(params).local_from_vehicle(&self.localizer, cx.now()).ok();
        let place = pose.map(|pose| pose.translation.truncate());
        let begins_again = self.frame_watch.begins_again(has_clock_begun_again, place, cx.now());
        if let Some(why) = &begins_again {
            self.maps.iter_mut().for_each(TerrainMap::forget_cells);
            self.teachers.forget_places();
            cx.fault(format!("{why}; the cells are forgotten, the models stay"));
        }
        if let Some(place) = place {
            for map in self.maps.iter_mut().filter(|map| map.middle().distance(place) > FOLLOWS_M) {
                map.recentre(place);
            }
        }
        begins_again.is_some()
    }

    /// Learns from a frame.
    fn learn(
        &mut self,
        side: usize,
        frame: &Frame,
        params: &TerrainLearnerParams,
        rules: &ModelRules,
        ports: &Ports,
        cx: &mut Cycle<'_>,
    ) -> Result<Lesson, Unusable> {
        let (extrinsics, time) = (extrinsics(params), frame.time);
        // The labels of the frame have just come.
        let taken = SensorTime { acquired: time, arrived: cx.now() };
        let local_from_vehicle = extrinsics.local_from_vehicle(&self.localizer, taken)?;
        // The mount in the parameters is that of the left camera.
        let camera = if side == 0 { extrinsics } else { extrinsics.without_mount() };
        let vehicle_from_camera =
            camera.vehicle_from_sensor(&self.localizer, &frame.image.frame_id, Axes::Optical, taken)?;
        let ratios = self.ratios(params);
        let set = side.min(self.maps.len() - 1);
        let refusal = self.refusal(taken, params);
        self.maps.iter_mut().for_each(|map| map.recentre(local_from_vehicle.translation.truncate()));
        let map = &mut self.maps[set];
        let mut learned = Learned::default();
        if refusal.is_none() {
            let local_from_camera = local_from_vehicle * vehicle_from_camera;
            let window = map.window();
            let strips = frame.gather(local_from_camera, &window, params.max_range_m as f32, &ratios, cx);
            let points = join(&strips, SIDE);
            learned = map.learn(&points, rules);
            let (numbers, cells): (Vec<usize>, Vec<u32>) = map.without_sample(&points).into_iter().unzip();
            if !cells.is_empty() {
                let samples = frame.samples(&strips, &local_from_camera, &window, &cells);
                for (number, sample) in numbers.into_iter().zip(samples) {
                    map.models.models[number].sample = sample;
                }
            }
            cx.write(&ports.learned[side], time, frame.used(&strips));
        }
        Ok(Lesson { side, time, learned, refusal })
    }

    /// Says what a frame taught, and what is known now.
    fn send_stats(&self, lesson: &Lesson, known: &[Known], ports: &Ports, cx: &mut Cycle<'_>) {
        let &Lesson { side, time, learned, refusal } = lesson;
        let set = side.min(self.maps.len() - 1);
        let (map, known) = (&self.maps[set], &known[set]);
        let [cells, cells_with_model] = known.counts;
        let [driven, bumped, marked] = map.experienced();
        let stats = TerrainStats {
            timestamp: Some(time.to_proto()),
            camera: [TerrainCamera::Left, TerrainCamera::Right][side].into(),
            learned: refusal.is_none(),
            ground: learned.ground,
            obstacle: learned.obstacle,
            cells,
            cells_with_model,
            models: map.models.models.len() as u64,
            left_out: learned.left_out,
            sent: known.cells.iter().flatten().count() as u64,
            driven,
            bumped,
            marked,
        };
        cx.write(&ports.stats, time, stats);
    }

    /// Deletes a model of an output.
    fn delete(&mut self, model: &ModelToDelete) -> Result<(), String> {
        let set = usize::from(model.output == "models_right");
        let known = ["models", "models_right"].contains(&model.output.as_str());
        let map = self.maps.get_mut(set).filter(|_| known);
        let map = map.ok_or_else(|| format!("there are no models of {:?}", model.output))?;
        let names: Vec<&str> = map.models.models.iter().map(|model| model.name.as_str()).collect();
        let number = model_to_delete(&names, model)?;
        map.delete(number);
        Ok(())
    }

    /// Why nothing is learned at this time (Albus 2006a, 3.2, step 1).
    fn refusal(&self, taken: SensorTime, params: &TerrainLearnerParams) -> Option<&'static str> {
        if params.learn_while_standing {
            return None;
        }
        match extrinsics(params).motion(&self.localizer, taken, params.motion_window_s) {
            Some([_, turn]) if turn > params.max_turn_rate_dps.to_radians() => {
                Some("does not learn: the vehicle turns")
            }
            Some([speed, _]) if speed >= params.min_speed_mps => None,
            _ => Some("does not learn: the vehicle stands"),
        }
    }

    /// Sends what is known of all cells, and all models.
    fn send(
        &self,
        time: Stamp,
        params: &TerrainLearnerParams,
        rules: &ModelRules,
        known: &[Known],
        ports: &Ports,
        cx: &mut Cycle<'_>,
    ) {
        let cameras = match params.cameras() {
            TerrainCameras::TerrainLeft => [TerrainCamera::Left; 2],
            TerrainCameras::TerrainCombined => [TerrainCamera::Both; 2],
            TerrainCameras::TerrainSeparate => [TerrainCamera::Left, TerrainCamera::Right],
        };
        for (set, map) in self.maps.iter().enumerate() {
            let mut models = map.models.to_message(cameras[set], params.ratio_span_octaves, &rules.weights);
            models.timestamp = Some(time.to_proto());
            cx.write(&ports.models[set], time, models);
        }
        cx.write(&ports.cost, time, statement(known, extrinsics(params).frames.local, time));
    }

    /// Reports a camera that has fallen behind the other one, once until it has caught up.
    fn report_late_camera(&mut self, params: &TerrainLearnerParams, cx: &mut Cycle<'_>) {
        let Some(begun) = self.begun.filter(|_| params.cameras() != TerrainCameras::TerrainLeft) else {
            return;
        };
        let times = [0, 1].map(|side| self.cameras[side].newest.unwrap_or(begun));
        for side in 0..2 {
            let behind_s = times[1 - side].seconds_since(times[side]);
            let is_late = behind_s > params.camera_timeout_s;
            if is_late && !self.cameras[side].is_late {
                let (name, other) = (SIDES[side], SIDES[1 - side]);
                let limit_s = params.camera_timeout_s;
                let behind_s = text_above(behind_s, limit_s);
                cx.fault(format!(
                    "{name} camera is {behind_s} s behind the {other} one, expected at most {limit_s} s"
                ));
            }
            self.cameras[side].is_late = is_late;
        }
    }

    fn ratios(&mut self, params: &TerrainLearnerParams) -> Arc<RatioBins> {
        let span = params.ratio_span_octaves;
        match &self.ratios {
            Some(ratios) if ratios.span_octaves() == span => ratios.clone(),
            _ => self.ratios.insert(Arc::new(RatioBins::new(span))).clone(),
        }
    }
}

/// Model rules from the parameters.
fn rules(params: &TerrainLearnerParams) -> ModelRules {
    let histograms = [
        params.weight_red_green,
        params.weight_red_blue,
        params.weight_green_blue,
        params.weight_intensity,
        params.weight_texture,
    ];
    let weights = MatchWeights {
        histograms: histograms.map(|weight| weight as f32),
        contrast: params.weight_contrast as f32,
    };
    ModelRules {
        min_points: u64::from(params.min_points),
        min_purity: params.min_purity_pct / 100.0,
        merge_distance: params.merge_distance as f32,
        max_models: params.max_models as usize,
        near_m: params.near_range_m,
        weights: weights.normalised(),
    }
}

/// Fingerprint of what the maps of the parameters are made of. Counts of other bins of ratios cannot be compared.
fn files(params: &TerrainLearnerParams) -> u64 {
    let cameras = params.cameras();
    let is_separate = cameras == TerrainCameras::TerrainSeparate;
    let settings = format!("{is_separate} {}", params.ratio_span_octaves);
    // The left camera alone has no use for the models of the right one.
    let none = String::new();
    let models_right = if cameras == TerrainCameras::TerrainLeft { &none } else { &params.models_right };
    fingerprint_of_texts(&[&params.models, models_right, &settings])
}

/// Maps with the models of the parameters; texts refused by [`Process::check`] are left out.
fn maps(params: &TerrainLearnerParams) -> Vec<TerrainMap> {
    let set = |text: &str| -> ModelSet {
        let message = models_of_text(text).ok().flatten();
        let mut set = message.and_then(|message| ModelSet::from_message(&message).ok()).unwrap_or_default();
        set.name_all();
        set
    };
    let (left, right) = (set(&params.models), set(&params.models_right));
    let sets = match params.cameras() {
        TerrainCameras::TerrainLeft => vec![left],
        TerrainCameras::TerrainSeparate => vec![left, right],
        TerrainCameras::TerrainCombined => {
            let mut both = left;
            both.take_all(&right, &rules(params));
            vec![both]
        }
    };
    sets.into_iter().map(map_with).collect()
}

/// A statement of everything that is known, for the world model. Of several maps, which have the same window, the one
/// that is surer of a cell counts; of equal ones, the higher cost.
fn statement(maps: &[Known], local: &str, time: Stamp) -> Grid {
    let mut data = [UNKNOWN_COST, 0, 0, 0].repeat(SIDE * SIDE);
    let south_west = maps.first().map_or(CellIndex::new(0, 0), |map| map.south_west);
    for map in maps.iter().filter(|map| map.south_west == south_west) {
        for (cell, judgement) in data.chunks_exact_mut(4).zip(&map.cells) {
            let Some(Judgement { cost, confidence, backing, model }) = *judgement else { continue };
            if (confidence, cost) > (cell[1], if cell[1] == 0 { 0 } else { cell[0] }) {
                cell.copy_from_slice(&[cost, confidence, backing, model]);
            }
        }
    }
    let names = ["cost", "conf", "backing", "model"];
    let frame = GridFrame { south_west, side: SIDE, cell_size_m: CELL_SIZE_M };
    frame.message_of_bytes(Source::TERRAIN, &names, data, local, time)
}

#[expect(clippy::expect_used, reason = "201 cells of 0.2 m are a grid")]
fn map_with(models: ModelSet) -> TerrainMap {
    TerrainMap::new(models).expect("the size of the map is valid")
}
