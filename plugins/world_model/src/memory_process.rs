//! The process `map_memory`: a world model's map of an earlier run, registered against this one, and the map to save. Its
//! port table is in the crate's documentation.

use crate::memory::{Rectangle, parse, statement};
use crate::proto::{MapMemory, MapMemoryParams};
use crate::register::{Fit, Remembered, Seen};
use rcs_geom::{DVec2, Pose};
use rcs_msg::Stamp;
use rcs_msg::foxglove::{FrameTransform, FrameTransforms, Grid, Odometry, Quaternion, Vector3};
use rcs_msg::rcs::{Plan, PlanState};
use rcs_runtime::{Cycle, In, Msg, Out, PortBuilder, Process, ProcessDef, Role};
use rcs_sense::{GridFrame, Localizer, Origin, pose_of};
use rcs_world::{GridView, Source, SourceKind, UNKNOWN_COST, Weighted, Weights, fuse_grid};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Frame of the remembered map: the global frame as the run that saved it knew it.
const FRAME: &str = "remembered";
/// Confidence of what is remembered: that of a sensor which is sure of ground.
const CONFIDENCE: u8 = 80;
/// Distance between the points of the track, m, and their greatest number.
const TRACK_STEP_M: f64 = 2.0;
const MOST_TRACK: usize = 5000;
/// Support that a metre of motion must gain: from where the position estimate puts the remembered map, and once it is
/// registered, when it is moved by up to this far at a time, m, because the local frame drifts slowly.
const WORTH: f64 = 0.05;
const FOLLOW_WORTH: f64 = 0.1;
const FOLLOW_M: f64 = 0.4;
/// A registered map lies in a wrong place where another one has had this much more support for this many messages in
/// turn: few things are in sight when it is registered first.
const CLEARLY: f64 = 0.15;
const IN_TURN: u32 = 4;
/// A registered map is believed until its agreement falls below this share of the one that it needed.
const DOUBT: f64 = 0.7;
/// Time without a way to the goal after which the remembered map is not believed any more, s.
const NO_WAY_S: f64 = 5.0;
/// Time after which the costs are sent again, s: the world model may have been cleared.
const RESEND_S: f64 = 5.0;

/// State: the frames, the track, where the remembered map lies, and what was sent when.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct MapMemoryKeeper {
    frames: Localizer,
    /// Why the remembered map is not used until the next start, if so.
    dropped: Option<String>,
    /// Since when the plan has found no way with the remembered map.
    no_way: Option<Stamp>,
    /// Where the vehicle was, local frame, m.
    track: Vec<DVec2>,
    /// Where the remembered map lies; `None` while it is not believed.
    placed: Option<Placed>,
    /// Number of messages in turn in which another place had clearly more support.
    elsewhere: u32,
    /// When the costs were sent last, and where a point of the remembered map then was, m.
    sent: Option<(Stamp, DVec2)>,
    saved: Option<Stamp>,
    /// What was saved last, global frame: the map of the world model forgets what it has left behind.
    kept: Option<Arc<Rectangle>>,
    text: String,
    #[serde(skip)]
    remembered: FromParams,
}

/// Where the remembered map lies in the local frame, which drifts far less than the estimate of the global one jumps: the
/// frames when it was registered, and how it fits since.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Placed {
    global_from_local: Pose,
    fit: Fit,
}

impl Placed {
    /// A position of the local frame in the frame of the remembered map, m.
    fn to_remembered(self, at: DVec2) -> DVec2 {
        (self.global_from_local * at.extend(0.0)).truncate() - self.fit.moved
    }

    /// The frame of the remembered map in the local one.
    fn local_from_remembered(self) -> Pose {
        self.global_from_local.inverse() * Pose::from_translation(self.fit.moved.extend(0.0))
    }
}

/// What a cycle has read.
struct Now<'a> {
    map: &'a Msg<Grid>,
    /// Position in the local frame, m.
    vehicle: DVec2,
    global_from_local: &'a Pose,
}

impl Now<'_> {
    /// A position of the local frame in the global one, m.
    fn to_global(&self, at: DVec2) -> DVec2 {
        (*self.global_from_local * at.extend(0.0)).truncate()
    }
}

/// The map of the parameters, which is read once.
#[derive(Clone, Debug, Default)]
struct FromParams {
    text: Option<(String, String)>,
    map: Option<Result<Arc<Remembered>, String>>,
}

rcs_runtime::commands! {
    /// Commands of [`MapMemoryKeeper`].
    pub enum MapMemoryCommand {
        Save = "SAVE": "Write the map to save now.",
        Clear = "CLEAR": "Forget the remembered map until the next start.",
    }
}

/// Ports of [`MapMemoryKeeper`].
#[derive(Debug)]
pub struct Ports {
    map: In<Grid>,
    odometry: In<Odometry>,
    transforms: In<FrameTransforms>,
    plan: In<Plan>,
    cost: Out<Grid>,
    memory: Out<MapMemory>,
    registration: Out<FrameTransforms>,
}

impl Process for MapMemoryKeeper {
    type Params = MapMemoryParams;
    type Ports = Ports;
    type Command = MapMemoryCommand;
    const DEF: ProcessDef = ProcessDef {
        plugin: "map_memory",
        summary: "Registers the map of an earlier run, states it to the world model, and saves the map of this one",
        period_ms: 500.0,
        latency_ms: 10.0,
        reads_ground_truth: false,
    };

    fn ports(b: &mut PortBuilder) -> Ports {
        Ports {
            map: b.input("map", "the map to remember, with the evidence of each source, local frame"),
            odometry: b.input("odometry", "pose of the vehicle in the local frame"),
            transforms: b.input("transforms", "the local frame in the global frame"),
            plan: b.optional_input(
                "plan",
                "the plan on that map: one without a way to the goal drops the remembered map",
            ),
            cost: b
                .output(
                    "cost",
                    "the remembered map where it fits: fields cost.memory, conf.memory and backing.memory, local frame",
                )
                .role(Role::Map)
                .palette("cost")
                .build(),
            memory: b.output("memory", "the map to save, global frame").role(Role::Stats).build(),
            registration: b
                .output(
                    "registration",
                    "the frame of the remembered map in the local frame; none while it does not fit",
                )
                .role(Role::Transforms)
                .build(),
        }
    }

    fn check(params: &MapMemoryParams) -> Result<(), String> {
        if !params.world.is_empty() {
            Origin::from_toml(&params.world).map_err(|error| format!("world: {error}"))?;
        }
        parse(&params.memory).map_err(|error| format!("memory: {error}"))?;
        Ok(())
    }

    fn new(_params: &MapMemoryParams) -> Self {
        Self::default()
    }

    fn cycle(&mut self, ports: &Ports, params: &MapMemoryParams, cx: &mut Cycle<'_>) {
        let mut is_asked = false;
        while let Some(command) = cx.next_command::<Self>() {
            match command {
                MapMemoryCommand::Save => is_asked = true,
                MapMemoryCommand::Clear => self.dropped = Some("the remembered map is cleared".to_owned()),
            }
        }
        while let Some(message) = cx.read(&ports.transforms) {
            if let Err(error) = self.frames.add_transforms(&message, false) {
                cx.fault(format!("transforms: {error}; skipped"));
            }
        }
        let vehicle = cx.latest(&ports.odometry);
        let vehicle = vehicle.and_then(|odometry| pose_of(odometry.pose.as_ref(), &odometry.frame_id).ok());
        let Some(vehicle) = vehicle.map(|pose| pose.translation.truncate()) else {
            return cx.exec("waits for the pose of the vehicle");
        };
        self.take_position(vehicle);
        let (global, local) = (&params.global_frame, &params.local_frame);
        let Ok(global_from_local) = self.frames.lookup(global, local, cx.now(), f64::INFINITY) else {
            return cx.exec("waits for the local frame in the global frame");
        };
        let Ok(origin) = Origin::from_toml(&params.world) else {
            return cx.error("world: expected a file with the [origin] of the global frame");
        };
        let Some(map) = cx.read_newest(&ports.map) else {
            return self.tell(cx);
        };
        let is_closed = cx.latest(&ports.plan).is_some_and(|plan| plan.state() == PlanState::PlanNoWay);
        self.look_for_a_way(is_closed, cx.now());
        let seen = Now { map: &map, vehicle, global_from_local: &global_from_local };
        if let Err(error) = self.remember(ports, params, &origin, &seen, cx) {
            cx.fault(format!("map: {error}; skipped"));
        }
        let now = cx.now();
        cx.write(&ports.registration, now, self.registration(params, now));
        if is_asked || self.saved.is_none_or(|saved| now.seconds_since(saved) >= params.save_every_s) {
            match self.to_save(params, &seen) {
                Ok(Some(saved)) => {
                    self.saved = Some(now);
                    cx.write(&ports.memory, now, saved.to_memory(&origin.0));
                    self.kept = Some(Arc::new(saved));
                }
                Ok(None) => {}
                Err(error) => cx.fault(format!("map: {error}; not saved")),
            }
        }
        self.tell(cx);
    }
}

impl MapMemoryKeeper {
    fn tell(&self, cx: &mut Cycle<'_>) {
        cx.exec(
            if self.text.is_empty() { "nothing is remembered; saves the map" } else { &*self.text }
                .to_owned(),
        );
    }

    fn take_position(&mut self, vehicle: DVec2) {
        let step_m = self.track.last().map_or(f64::INFINITY, |last| last.distance(vehicle));
        if step_m >= TRACK_STEP_M && self.track.len() < MOST_TRACK {
            self.track.push(vehicle);
        }
    }

    /// Drops a remembered map with which there is no way to the goal: there was one to remember.
    fn look_for_a_way(&mut self, is_closed: bool, now: Stamp) {
        if !is_closed || self.placed.is_none() {
            self.no_way = None;
        } else if now.seconds_since(*self.no_way.get_or_insert(now)) >= NO_WAY_S {
            self.dropped = Some("the remembered map leaves no way to the goal: not used".to_owned());
        }
    }

    /// Registers the remembered map, and states what it says to the world model.
    fn remember(
        &mut self,
        ports: &Ports,
        params: &MapMemoryParams,
        origin: &Origin,
        now: &Now<'_>,
        cx: &mut Cycle<'_>,
    ) -> Result<(), String> {
        let Some(remembered) = self.remembered.of(params, origin).filter(|_| self.dropped.is_none()) else {
            if let Some(why) = &self.dropped {
                self.text.clone_from(why);
                self.withdraw(ports, params, now, cx);
            }
            return Ok(());
        };
        let remembered = match remembered {
            Ok(remembered) => remembered,
            Err(why) => {
                self.text = format!("{why}: not used");
                return Ok(());
            }
        };
        let vehicle = now.vehicle;
        let view = GridView::of(now.map.message()).map_err(|error| error.to_string())?;
        let mut costs = Vec::new();
        fuse_grid(&view, &sensed_by(), &mut costs).map_err(|error| error.to_string())?;
        let sensed = Rectangle::with(&view, costs);
        let global_from_local = self.placed.map_or(*now.global_from_local, |placed| placed.global_from_local);
        let to_global = |at: DVec2| (global_from_local * at.extend(0.0)).truncate();
        // How far what is moved so lies from where the position estimate says, m: east and north.
        let away = |moved: DVec2| now.to_global(vehicle) - to_global(vehicle) + moved;
        let seen = Seen::of(&sensed, vehicle, params.near_m, to_global);
        let least = params.least_cells as usize;
        let found = match self.placed {
            // Where little can be compared, what was found stays.
            Some(Placed { fit, .. }) => {
                let here =
                    remembered.register(&seen, fit.moved, FOLLOW_M, FOLLOW_WORTH, least).unwrap_or(fit);
                // The fit where the position estimate puts the map is not moved.
                let estimated = -away(DVec2::ZERO);
                let there = remembered
                    .register(&seen, estimated, params.search_m, WORTH, least)
                    .filter(|there| there.support > here.support + CLEARLY)
                    .filter(|there| there.agreement >= params.least_agreement);
                self.elsewhere = if there.is_some() { self.elsewhere + 1 } else { 0 };
                there.filter(|_| self.elsewhere >= IN_TURN).or(Some(here))
            }
            None => remembered.register(&seen, DVec2::ZERO, params.search_m, WORTH, least),
        };
        let found = found.filter(|found| away(found.moved).abs().max_element() <= params.search_m);
        let needed = params.least_agreement * if self.placed.is_some() { DOUBT } else { 1.0 };
        self.text = match found {
            Some(fit) if fit.agreement >= needed => {
                let Fit { moved, agreement, compared, .. } = fit;
                self.placed = Some(Placed { global_from_local, fit });
                let (share, moved_m) = (100.0 * agreement, away(moved).length());
                format!("remembers: moved by {moved_m:.1} m, {share:.0} % of {compared} obstacle cells agree")
            }
            Some(fit) => {
                self.placed = None;
                let (got, needed) = (100.0 * fit.agreement, 100.0 * needed);
                let compared = fit.compared;
                format!(
                    "the remembered map does not fit: {got:.0} % of {compared} obstacle cells agree, expected {needed:.0} %"
                )
            }
            None => {
                self.placed = None;
                let compared = remembered.compare(&seen, DVec2::ZERO).compared;
                format!(
                    "waits: {compared} obstacle cells can be compared with the remembered map, expected {least}"
                )
            }
        };
        let Some(placed) = self.placed else {
            self.withdraw(ports, params, now, cx);
            return Ok(());
        };
        let at = placed.local_from_remembered().translation.truncate();
        let is_due = self.sent.is_none_or(|(sent, before)| {
            cx.now().seconds_since(sent) >= RESEND_S || before.distance(at) > 0.5 * remembered.map.cell_size_m
        });
        if is_due {
            let frame = GridFrame::around(vehicle, view.columns(), sensed.cell_size_m);
            let middles =
                (0..frame.side * frame.side).map(|slot| frame.middle(slot % frame.side, slot / frame.side));
            let costs: Vec<u8> =
                middles.map(|middle| remembered.map.at(placed.to_remembered(middle))).collect();
            self.send(ports, params, &frame, &costs, at, cx);
        }
        Ok(())
    }

    /// The frame of the remembered map in the local one; no transform while it is not believed.
    fn registration(&self, params: &MapMemoryParams, now: Stamp) -> FrameTransforms {
        let transform = |placed: Placed| {
            let Pose { translation: shift, rotation: q } = placed.local_from_remembered();
            FrameTransform {
                timestamp: Some(now.to_proto()),
                parent_frame_id: params.local_frame.clone(),
                child_frame_id: FRAME.to_owned(),
                translation: Some(Vector3 { x: shift.x, y: shift.y, z: shift.z }),
                rotation: Some(Quaternion { x: q.x, y: q.y, z: q.z, w: q.w }),
            }
        };
        FrameTransforms { transforms: self.placed.map(transform).into_iter().collect() }
    }

    /// Takes back what was stated.
    fn withdraw(&mut self, ports: &Ports, params: &MapMemoryParams, now: &Now<'_>, cx: &mut Cycle<'_>) {
        self.placed = None;
        let size_m = now.map.cell_size.map(|size| size.x).filter(|_| self.sent.is_some());
        if let Some(cell_size_m) = size_m {
            let frame = GridFrame::around(now.vehicle, 1, cell_size_m);
            self.send(ports, params, &frame, &[UNKNOWN_COST], DVec2::ZERO, cx);
            self.sent = None;
        }
    }

    fn send(
        &mut self,
        ports: &Ports,
        params: &MapMemoryParams,
        frame: &GridFrame,
        costs: &[u8],
        at: DVec2,
        cx: &mut Cycle<'_>,
    ) {
        let now = cx.now();
        self.sent = Some((now, at));
        let message = statement(frame, costs, CONFIDENCE, Source::MEMORY, &params.local_frame, now);
        cx.write(&ports.cost, now, message);
    }

    /// The map to save: what the vehicle has come near to, the newest last, and what it remembers.
    fn to_save(&self, params: &MapMemoryParams, now: &Now<'_>) -> Result<Option<Rectangle>, String> {
        let view = GridView::of(now.map.message()).map_err(|error| error.to_string())?;
        // What was near, but behind a wall, was only seen from far.
        let fused =
            Rectangle::of_grid_seen_within(&view, params.near_m).map_err(|error| error.to_string())?;
        let remembered =
            self.placed.and_then(|placed| Some((&self.remembered.map.as_ref()?.as_ref().ok()?.map, placed)));
        let mut places: Vec<DVec2> = self.track.iter().map(|&at| now.to_global(at)).collect();
        if let Some((old, placed)) = remembered {
            let rows = old.costs.len() / old.columns.max(1);
            let far = old.corner + DVec2::new(old.columns as f64, rows as f64) * old.cell_size_m;
            let local = |corner: DVec2| (placed.local_from_remembered() * corner.extend(0.0)).truncate();
            places.extend(
                [old.corner + params.near_m, far - params.near_m].map(|corner| now.to_global(local(corner))),
            );
        }
        let Some(mut saved) = Rectangle::around(&places, params.near_m, fused.cell_size_m) else {
            return Ok(None);
        };
        // What lies outside of the map now was kept when it was inside.
        let local_from_global = now.global_from_local.inverse();
        for index in 0..saved.costs.len() {
            let centre = saved.centre(index);
            let kept = self.kept.as_ref().map_or(UNKNOWN_COST, |kept| kept.at(centre));
            let local = || (local_from_global * centre.extend(0.0)).truncate();
            let old =
                || remembered.map_or(UNKNOWN_COST, |(old, placed)| old.at(placed.to_remembered(local())));
            saved.costs[index] = if kept == UNKNOWN_COST { old() } else { kept };
        }
        for &at in self.track.iter().filter(|&&at| fused.holds(at)) {
            saved.around_each(now.to_global(at), params.near_m, |centre, cost| {
                let sensed = fused.at((local_from_global * centre.extend(0.0)).truncate());
                if sensed != UNKNOWN_COST {
                    *cost = sensed;
                }
            });
        }
        Ok(Some(saved))
    }
}

impl FromParams {
    /// The map of the parameters in the global frame; `None` if they have none.
    fn of(&mut self, params: &MapMemoryParams, origin: &Origin) -> Option<Result<Arc<Remembered>, String>> {
        let is_read = |(memory, world): &(String, String)| *memory == params.memory && *world == params.world;
        if !self.text.as_ref().is_some_and(is_read) {
            let map = parse(&params.memory).map_err(|error| error.to_string());
            self.map = map.transpose().map(|map| {
                let map = map
                    .and_then(|map| Rectangle::of_memory(&map, &origin.0).map_err(|error| error.to_string()));
                map.map(|map| Arc::new(Remembered::new(map))).map_err(|error| format!("memory: {error}"))
            });
            self.text = Some((params.memory.clone(), params.world.clone()));
        }
        self.map.clone()
    }
}

/// The sources with which a remembered map is compared: those of shape and touch.
fn sensed_by() -> Weights {
    let weighted = |source, weight, kind| Weighted { source, weight, kind };
    [
        weighted(Source::STEREO, 1.0, SourceKind::Range),
        weighted(Source::TERRAIN, 0.5, SourceKind::Learned),
        weighted(Source::BUMPER, 1.0, SourceKind::Override),
    ]
    .into_iter()
    .collect()
}
