//! The process `map_memory`: a world model's map of an earlier run, registered against this one, and the map to save. Its
//! port table is in the crate's documentation.

use crate::memory::{Rectangle, by_shape, parse, statement};
use crate::proto::{MapMemory, MapMemoryParams};
use crate::register::{Fit, Remembered, Seen};
use crate::saved::Kept;
use rcs_geom::{DVec2, Pose};
use rcs_msg::Stamp;
use rcs_msg::foxglove::{FrameTransform, FrameTransforms, Grid, Odometry, Quaternion, Vector3};
use rcs_msg::rcs::{Plan, PlanState};
use rcs_runtime::{Cycle, In, Msg, Out, PortBuilder, Process, ProcessDef, Role};
use rcs_sense::{GridFrame, Localizer, Origin, pose_of};
use rcs_world::{GridView, Source, UNKNOWN_COST, fuse_grid};
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
/// Length of the track along which what is sensed is compared, in points: so far the local frame is one frame, and a map
/// that is turned differs at one of its ends.
const COMPARED_TRACK: usize = 20;
/// Angle by which a registered map is turned at a time, rad, support that a radian must gain, and greatest angle from
/// where the estimate of the heading puts it, rad.
const TURN_RAD: f64 = 0.5 * std::f64::consts::PI / 180.0;
const TURN_WORTH: f64 = 1.7;
/// Distance from the vehicle at which a turn counts as a motion, m.
const LEVER_M: f64 = 20.0;
const MOST_TURN_RAD: f64 = 8.0 * std::f64::consts::PI / 180.0;
/// A registered map lies in a wrong place where another one has had this much more support for this many messages in
/// turn: few things are in sight when it is registered first.
const CLEARLY: f64 = 0.15;
const IN_TURN: u32 = 4;
/// A map is believed that fits in the same place for as many messages in turn: few things are in sight when it is
/// registered first, and may lie on others by chance. Greatest distance of what is the same place, m.
const SAME_PLACE_M: f64 = 1.0;
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
    /// Where it lay when it was believed last; `None` once it is dropped.
    settled: Option<Placed>,
    /// Where it fits, and for how many messages in turn, until it is believed.
    proposed: Option<(Placed, u32)>,
    /// Number of messages in turn in which another place had clearly more support.
    elsewhere: u32,
    /// When the costs were sent last, and where the frame of the remembered map then was in the local one.
    sent: Option<(Stamp, Pose)>,
    saved: Option<Stamp>,
    /// Whether it was told to save, and has not yet.
    asked: bool,
    kept: Kept,
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

    /// The angle from the estimate of the local frame in the global one to that with which it lies here, rad.
    fn turned_rad(self, estimated: &Pose) -> f64 {
        (estimated.inverse() * self.global_from_local).yaw()
    }

    /// The best place near this one: moved by up to a cell, and turned by up to a step about the middle of what is
    /// compared, which a turn does not move.
    fn followed(
        self,
        remembered: &Remembered,
        seen_in_local: &Seen,
        middle: DVec2,
        estimated: &Pose,
        least: usize,
    ) -> Placed {
        let from = self.fit.moved;
        let worth = |&(turn_rad, placed): &(f64, Placed)| {
            let fit = placed.fit;
            fit.support - FOLLOW_WORTH * fit.moved.distance(from) - TURN_WORTH * f64::abs(turn_rad)
        };
        let turns = [0.0, TURN_RAD, -TURN_RAD].into_iter();
        let places = turns.filter_map(|turn_rad| {
            let global_from_local = turned(&self.global_from_local, middle, turn_rad);
            let seen = seen_in_local.placed(|place| at(&global_from_local, place));
            let fit = remembered.register(&seen, from, FOLLOW_M, FOLLOW_WORTH, least)?;
            let placed = Placed { global_from_local, fit };
            let is_allowed = turn_rad == 0.0 || placed.turned_rad(estimated).abs() <= MOST_TURN_RAD;
            is_allowed.then_some((turn_rad, placed))
        });
        let best = places.reduce(|best, other| if worth(&other) > worth(&best) { other } else { best });
        best.map_or(self, |(_, placed)| placed)
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
        while let Some(command) = cx.next_command::<Self>() {
            match command {
                MapMemoryCommand::Save => self.asked = true,
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
        // Asked to save, it takes the last map, also of a world model that is halted.
        let last = if self.asked { cx.latest(&ports.map) } else { None };
        let Some(map) = cx.read_newest(&ports.map).or(last) else {
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
        if std::mem::take(&mut self.asked)
            || self.saved.is_none_or(|saved| now.seconds_since(saved) >= params.save_every_s)
        {
            match self.save(params, &seen) {
                Ok(Some(saved)) => {
                    self.saved = Some(now);
                    cx.write(&ports.memory, now, saved.to_memory(&origin.0));
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
                self.settled = None;
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
        fuse_grid(&view, &by_shape(&view), &mut costs).map_err(|error| error.to_string())?;
        let mut sensed = Rectangle::with(&view, costs);
        sensed.forget_far(&view, params.near_m);
        // A map that did not fit any more is turned as it was when it did.
        let turned_before =
            |placed: Placed| turned(now.global_from_local, vehicle, placed.turned_rad(now.global_from_local));
        let start = self.placed.map(|placed| placed.global_from_local);
        let start = start.or(self.settled.map(turned_before)).unwrap_or(*now.global_from_local);
        // How far what is moved so lies from where the position estimate says, m: east and north.
        let away = |moved: DVec2| now.to_global(vehicle) - at(&start, vehicle) + moved;
        let compared = [&self.track[self.track.len().saturating_sub(COMPARED_TRACK)..], &[vehicle]].concat();
        let seen_in_local = Seen::of(&sensed, &compared, params.near_m);
        let seen = seen_in_local.placed(|place| at(&start, place));
        let least = params.least_cells as usize;
        let found = match self.placed {
            // Where little can be compared, what was found stays.
            Some(placed) => {
                let middle = compared.iter().sum::<DVec2>() / compared.len() as f64;
                let here = placed.followed(&remembered, &seen_in_local, middle, now.global_from_local, least);
                // The fit where the position estimate puts the map is not moved.
                let estimated = -away(DVec2::ZERO);
                let there = remembered
                    .register(&seen, estimated, params.search_m, WORTH, least)
                    .filter(|there| there.support > here.fit.support + CLEARLY)
                    .filter(|there| there.agreement >= params.least_agreement);
                self.elsewhere = if there.is_some() { self.elsewhere + 1 } else { 0 };
                let there = there.filter(|_| self.elsewhere >= IN_TURN);
                Some(there.map_or(here, |fit| Placed { fit, ..placed }))
            }
            None => remembered
                .register(&seen, -away(DVec2::ZERO), params.search_m, WORTH, least)
                .map(|fit| Placed { global_from_local: start, fit }),
        };
        let found = found.filter(|found| away(found.fit.moved).abs().max_element() <= params.search_m);
        let needed = params.least_agreement * if self.placed.is_some() { DOUBT } else { 1.0 };
        let fitting = found.filter(|found| found.fit.agreement >= needed);
        let in_turn = self.in_turn(fitting, vehicle);
        self.text = match found {
            Some(placed) if fitting.is_some() && in_turn < IN_TURN => {
                let share = 100.0 * placed.fit.agreement;
                format!(
                    "the remembered map may fit: {share:.0} % agree, {in_turn} of {IN_TURN} times in turn"
                )
            }
            Some(placed) if fitting.is_some() => {
                let Fit { moved, agreement, compared, .. } = placed.fit;
                (self.placed, self.settled) = (Some(placed), Some(placed));
                let (share, moved_m) = (100.0 * agreement, away(moved).length());
                format!("remembers: moved by {moved_m:.1} m, {share:.0} % of {compared} obstacle cells agree")
            }
            Some(Placed { fit, .. }) => {
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
        let frame_now = placed.local_from_remembered();
        let is_due = self.sent.is_none_or(|(sent, before)| {
            let by_m = moved_m(&frame_now, &before, vehicle);
            cx.now().seconds_since(sent) >= RESEND_S || by_m > 0.5 * remembered.map.cell_size_m
        });
        if is_due {
            let frame = GridFrame::around(vehicle, view.columns(), sensed.cell_size_m);
            let middles =
                (0..frame.side * frame.side).map(|slot| frame.middle(slot % frame.side, slot / frame.side));
            let costs: Vec<u8> =
                middles.map(|middle| remembered.map.at(placed.to_remembered(middle))).collect();
            self.send(ports, params, &frame, &costs, frame_now, cx);
        }
        Ok(())
    }

    /// For how many messages in turn the remembered map has fitted in the same place.
    fn in_turn(&mut self, fitting: Option<Placed>, vehicle: DVec2) -> u32 {
        if self.placed.is_some() {
            return IN_TURN;
        }
        let is_same = |placed: &Placed, before: &Placed| {
            let moved = [placed, before].map(|placed| placed.local_from_remembered());
            moved_m(&moved[0], &moved[1], vehicle) <= SAME_PLACE_M
        };
        self.proposed = fitting.map(|placed| match &self.proposed {
            Some((before, times)) if is_same(&placed, before) => (placed, times + 1),
            _ => (placed, 1),
        });
        self.proposed.map_or(0, |(_, times)| times)
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
            let frame = GridFrame::around(now.vehicle, now.map.column_count as usize, cell_size_m);
            let unknown = vec![UNKNOWN_COST; frame.side * frame.side];
            self.send(ports, params, &frame, &unknown, Pose::IDENTITY, cx);
            self.sent = None;
        }
    }

    fn send(
        &mut self,
        ports: &Ports,
        params: &MapMemoryParams,
        frame: &GridFrame,
        costs: &[u8],
        local_from_remembered: Pose,
        cx: &mut Cycle<'_>,
    ) {
        let now = cx.now();
        self.sent = Some((now, local_from_remembered));
        let message = statement(frame, costs, CONFIDENCE, Source::MEMORY, &params.local_frame, now);
        cx.write(&ports.cost, now, message);
    }

    /// The map to save: what the vehicle has come near to, the newest last, and what it remembers.
    fn save(&mut self, params: &MapMemoryParams, now: &Now<'_>) -> Result<Option<Rectangle>, String> {
        let view = GridView::of(now.map.message()).map_err(|error| error.to_string())?;
        // What was near, but behind a wall, was only seen from far.
        let sensed = Rectangle::sensed_from_near(&view, params.near_m).map_err(|error| error.to_string())?;
        self.kept.take(&sensed, &self.track, params.near_m);
        let old = self.remembered.map.as_ref().and_then(|map| map.as_ref().ok());
        let old = old.zip(self.settled).map(|(old, placed)| (&old.map, placed.local_from_remembered()));
        Ok(self.kept.saved(old, now.global_from_local))
    }
}

/// A position of the local frame in the global one, m.
fn at(global_from_local: &Pose, place: DVec2) -> DVec2 {
    (*global_from_local * place.extend(0.0)).truncate()
}

/// How far a frame is moved from where it was before, m: the greatest distance between both near a position.
fn moved_m(frame: &Pose, before: &Pose, near: DVec2) -> f64 {
    let corners = [DVec2::X, DVec2::Y, DVec2::NEG_X, DVec2::NEG_Y].map(|side| near + LEVER_M * side);
    let moved = corners.map(|corner| at(frame, at(&before.inverse(), corner)).distance(corner));
    moved.into_iter().fold(0.0, f64::max)
}

/// The local frame in the global one, turned about a position of the local frame, m.
fn turned(global_from_local: &Pose, about: DVec2, angle_rad: f64) -> Pose {
    let centre = at(global_from_local, about);
    let back = Pose::from_translation((-centre).extend(0.0));
    Pose::from_xy_yaw(centre.x, centre.y, angle_rad) * back * *global_from_local
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
