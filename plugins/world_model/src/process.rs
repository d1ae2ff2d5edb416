//! The process `world_model`: reads cost maps and poses, and sends the map. Its port table is in the crate's
//! documentation.

use crate::algo::{VoteOrigin, take};
use crate::proto::{FusionWeights, WorldModelParams, WorldModelSourceStats, WorldModelStats};
use crate::resample::resampled;
use crate::sources::{Listed, check_sources};
use rcs_geom::Pose;
use rcs_msg::Stamp;
use rcs_msg::foxglove::{Grid, PoseInFrame};
use rcs_runtime::{Cycle, In, Msg, Out, PortBuilder, Process, ProcessDef, Role};
use rcs_sense::{ClockWatch, Extrinsics, FrameWatch, Localizer, PosePorts, pose_message};
use rcs_world::{GridViewError, Label, MAP_CODEC, Map, MapMessage, MapOptions, Source, Sources};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// State: the map, the poses of the last seconds, what each source has contributed, and when the map was last published
/// and faded.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct WorldModel {
    map: Map,
    /// The frame in which the map lies.
    local_frame: String,
    localizer: Localizer,
    /// Sources that have voted since the start or the last `CLEAR`.
    seen: Sources,
    contributions: Vec<Contribution>,
    /// Weights that were learned: source, weight, and that of the parameters from which it was learned.
    learned: Vec<(Source, f32, f32)>,
    published: Option<Stamp>,
    faded: Option<Stamp>,
    /// Acquisition time of the newest data that changed the map, by a clock that may have begun again.
    changed: Stamp,
    scrolled: u64,
    frame_watch: FrameWatch,
}

/// What a source has contributed since the start.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
struct Contribution {
    source: Source,
    votes: u64,
    /// Acquisition time of its newest data.
    newest: Stamp,
    clock: ClockWatch,
    /// The part of its fading that is less than one step of confidence.
    fading: f64,
}

/// The input of each source that comes with the program.
static NAMED_PORTS: [(Source, &str); 7] = [
    (Source::STEREO, "costs from range images: field cost.stereo, local frame"),
    (Source::COLOR, "costs of the colour models: field cost.color, local frame"),
    (Source::TERRAIN, "costs of terrain learned from range: field cost.terrain, local frame"),
    (Source::CLASSIFIER, "costs of the image classifier: field cost.classifier, local frame"),
    (Source::BUMPER, "cells that the bumper hit: field cost.bumper, local frame"),
    (Source::INFRARED, "costs of the infrared sensors: field cost.infrared, local frame"),
    (Source::SLIP, "cells on which the wheels slipped: field cost.slip, local frame"),
];

rcs_runtime::commands! {
    /// Commands of [`WorldModel`].
    pub enum WorldModelCommand {
        Clear = "CLEAR" once: "Forget the whole map.",
    }
}

/// Ports of [`WorldModel`].
#[derive(Debug)]
pub struct Ports {
    /// One input of cost maps per built-in source.
    named: Vec<(Source, In<Grid>)>,
    /// Cost maps of all other sources listed in the parameters.
    costs: In<Grid>,
    weights: In<FusionWeights>,
    poses: PosePorts,
    map: Out<Grid>,
    vehicle: Out<PoseInFrame>,
    stats: Out<WorldModelStats>,
}

impl Process for WorldModel {
    type Params = WorldModelParams;
    type Ports = Ports;
    type Command = WorldModelCommand;
    const DEF: ProcessDef = ProcessDef {
        plugin: "world_model",
        summary: "Fuses the costs of all sources into one scrolling map",
        period_ms: 50.0,
        latency_ms: 4.0,
        reads_ground_truth: false,
    };

    fn ports(b: &mut PortBuilder) -> Ports {
        let named =
            NAMED_PORTS.each_ref().map(|(source, help)| (*source, b.optional_input(source.name(), help)));
        let costs = b.optional_input(
            "costs",
            "costs of any sources: a field cost.<source> for each that the parameters list, local frame",
        );
        let weights = b.optional_input(
            "weights",
            "weights that a process has learned; one counts until that of the parameters is changed",
        );
        Ports {
            named: named.into(),
            costs,
            weights,
            poses: PosePorts::declare(b),
            map: b
                .output("map", "cells around the vehicle, local frame")
                .role(Role::Map)
                .palette("cost")
                .recorded_by(&MAP_CODEC)
                .build(),
            vehicle: b
                .output("vehicle", "pose of the vehicle in the local frame, with each map")
                .role(Role::Pose)
                .build(),
            stats: b
                .output("stats", "known and obstacle cells of the map, and the age of each source")
                .role(Role::Stats)
                .build(),
        }
    }

    fn check(params: &WorldModelParams) -> Result<(), String> {
        check_sources(params)
    }

    fn new(params: &WorldModelParams) -> Self {
        Self {
            map: empty(params),
            local_frame: extrinsics(params).frames.local.to_owned(),
            localizer: Localizer::default(),
            seen: Sources::default(),
            contributions: Vec::new(),
            learned: Vec::new(),
            published: None,
            faded: None,
            changed: Stamp(0),
            scrolled: 0,
            frame_watch: FrameWatch::default(),
        }
    }

    /// What was learned stays: the process that learned it sends it again only when it changes.
    fn renew(&self, params: &WorldModelParams) -> Self {
        Self { learned: self.learned.clone(), ..Self::new(params) }
    }

    fn cycle(&mut self, ports: &Ports, params: &WorldModelParams, cx: &mut Cycle<'_>) {
        let has_clock_begun_again = ports.poses.read(&mut self.localizer, extrinsics(params).frames, cx);
        while let Some(command) = cx.next_command::<Self>() {
            match command {
                WorldModelCommand::Clear => self.forget(),
            }
        }
        let shape = (self.map.side(), self.map.grid().cell_size_m());
        let local = extrinsics(params).frames.local;
        if shape != (params.cells_per_side as usize, params.cell_size_m) || self.local_frame != local {
            self.map = empty(params);
            local.clone_into(&mut self.local_frame);
            self.seen = Sources::default();
        }
        let vehicle = self.scroll(has_clock_begun_again, params, cx);
        self.take_weights(ports, cx);
        let listed = Listed::of(params).with_learned(&self.learned);
        self.forget_unlisted(&listed);
        for (source, port) in &ports.named {
            while let Some(grid) = cx.read(port) {
                if let Err(fault) = self.vote(&[*source], &grid, &listed, params, cx) {
                    cx.fault(format!("{source}: {fault}; cost map skipped"));
                }
            }
        }
        while let Some(grid) = cx.read(&ports.costs) {
            let voted = sources_of(&grid, &listed)
                .and_then(|sources| self.vote(&sources, &grid, &listed, params, cx));
            if let Err(fault) = voted {
                cx.fault(format!("costs: {fault}; cost map skipped"));
            }
        }
        self.fade(params, &listed, cx.now());
        let is_blind = listed.weights.is_blind();
        if self.is_due(params, cx.now()) {
            self.publish(ports, params, listed, vehicle, cx);
        }
        cx.exec(match (vehicle.is_some(), self.seen.is_empty()) {
            _ if is_blind => "the weights of all sources that look ahead are 0: nothing is known",
            (true, false) => "fuses costs",
            (true, true) => "waits for costs",
            (false, _) => "waits for the vehicle's pose",
        });
    }
}

/// A map without evidence.
#[expect(clippy::expect_used, reason = "any cell size that the parameter allows is a grid")]
fn empty(params: &WorldModelParams) -> Map {
    Map::with_side(params.cells_per_side as usize, params.cell_size_m).expect("side and cell size are valid")
}

impl WorldModel {
    fn forget(&mut self) {
        self.map.clear();
        self.seen = Sources::default();
    }

    /// Centres the map on the vehicle; without a pose it stays in place. Where the local frame has begun again, what was
    /// known is elsewhere now, and is forgotten.
    fn scroll(
        &mut self,
        has_clock_begun_again: bool,
        params: &WorldModelParams,
        cx: &mut Cycle<'_>,
    ) -> Option<Pose> {
        let extrinsics = extrinsics(params);
        // An unknown pose is not a fault here: there is none before the first message.
        let pose = extrinsics.local_from_vehicle(&self.localizer, cx.now()).ok();
        let at = pose.map(|pose| pose.translation.truncate());
        let has_clock_begun_again = has_clock_begun_again && !extrinsics.fixed_pose;
        if let Some(why) = self.frame_watch.begins_again(has_clock_begun_again, at, cx.now()) {
            self.forget();
            cx.fault(format!("{why}; the map is cleared"));
        }
        let exposed = self.map.recentre(at?)?;
        self.scrolled += exposed.len() as u64;
        pose
    }

    fn take_weights(&mut self, ports: &Ports, cx: &mut Cycle<'_>) {
        let Some(message) = cx.read_newest(&ports.weights) else { return };
        let learned = message.weights.iter().map(|entry| {
            let source = Source::new(&entry.source).map_err(|error| error.to_string())?;
            if !(0.0..=1.0).contains(&entry.weight) {
                return Err(format!("weight of {source} is {}, expected 0 to 1", entry.weight));
            }
            Ok((source, entry.weight as f32, entry.given as f32))
        });
        match learned.collect() {
            Ok(learned) => self.learned = learned,
            Err(why) => cx.fault(format!("weights: {why}; skipped")),
        }
    }

    /// Forgets sources that the parameters list no longer: they would count like range sensors, and never fade.
    fn forget_unlisted(&mut self, listed: &Listed) {
        let is_listed = |source: Source| listed.rule(source).is_some();
        if !self.seen.iter().all(is_listed) {
            self.seen = self.seen.iter().filter(|&source| is_listed(source)).collect();
            self.map.keep_sources(is_listed);
        }
    }

    /// Takes a cost map of one or several sources. One that is refused changes nothing.
    fn vote(
        &mut self,
        sources: &[Source],
        grid: &Msg<Grid>,
        listed: &Listed,
        params: &WorldModelParams,
        cx: &mut Cycle<'_>,
    ) -> Result<(), String> {
        let time = grid.acq_time_on_arrival();
        let origin = |&source: &Source| {
            Some(VoteOrigin {
                source,
                kind: listed.weights.get(source).kind,
                sequence: grid.header().sequence as u32,
                time,
                rule: listed.rule(source)?,
                least_backing: listed.least_backing(source),
                height_tolerance_m: params.height_tolerance_m as f32,
            })
        };
        let Some(origins) = sources.iter().map(origin).collect::<Option<Vec<VoteOrigin>>>() else {
            return Err("it is none of the sources that the parameters list".to_owned());
        };
        let local = extrinsics(params).frames.local;
        if grid.frame_id != local {
            return Err(format!("frame is {:?}, expected {local:?}", grid.frame_id));
        }
        let begun_again = self.begun_again(sources, time)?;
        // Of several sources, a later one may be refused.
        let mut copy = (params.clear_each_frame || origins.len() > 1).then(|| self.map.clone());
        let map = copy.as_mut().unwrap_or(&mut self.map);
        if params.clear_each_frame {
            map.clear();
        }
        let votes = take_all(map, grid, &origins).map_err(|error| error.to_string())?;
        if let Some(map) = copy {
            self.map = map;
        }
        self.changed = self.changed.max(time);
        for (origin, votes) in std::iter::zip(&origins, votes) {
            self.seen.insert(origin.source);
            let contribution = self.contribution(origin.source);
            contribution.votes += votes;
            contribution.newest = contribution.newest.max(time);
        }
        for source in begun_again {
            self.contribution(source).newest = time;
            self.changed = time;
            self.map.limit_updated(source, time);
            cx.fault(format!("{source}: its clock has begun again; the map stays"));
        }
        Ok(())
    }

    /// The sources of a cost map whose clock has begun again with it ([`ClockWatch`]). An error if it may be late instead.
    fn begun_again(&mut self, sources: &[Source], time: Stamp) -> Result<Vec<Source>, String> {
        let (mut begun_again, mut late_s) = (Vec::new(), None);
        for contribution in self.contributions.iter_mut().filter(|entry| sources.contains(&entry.source)) {
            let newest = contribution.newest;
            if contribution.clock.begins_again(Some(newest), time) {
                begun_again.push(contribution.source);
            } else if ClockWatch::is_far_behind(newest, time) {
                late_s = Some(newest.seconds_since(time));
            }
        }
        match late_s {
            Some(late_s) => Err(format!("it is {late_s:.1} s older than the one before")),
            None => Ok(begun_again),
        }
    }

    fn contribution(&mut self, source: Source) -> &mut Contribution {
        let place = self.contributions.iter().position(|entry| entry.source == source);
        let place = place.unwrap_or_else(|| {
            let clock = ClockWatch::default();
            self.contributions.push(Contribution { source, votes: 0, newest: Stamp(0), clock, fading: 0.0 });
            self.contributions.len() - 1
        });
        &mut self.contributions[place]
    }

    /// Lets the evidence of each source fade, once per period.
    fn fade(&mut self, params: &WorldModelParams, listed: &Listed, now: Stamp) {
        let last = *self.faded.get_or_insert(now);
        let elapsed_s = now.seconds_since(last);
        if elapsed_s < params.fade_period_s.max(0.1) {
            return;
        }
        self.faded = Some(now);
        for contribution in &mut self.contributions {
            // More than all of it, as after a pause, would fade again what is seen next.
            let fading = contribution.fading + listed.fade_per_s(contribution.source) * elapsed_s;
            contribution.fading = fading.clamp(0.0, 255.0);
            let amount = contribution.fading as u8;
            contribution.fading -= f64::from(amount);
            self.map.fade(contribution.source, amount);
        }
    }

    fn is_due(&self, params: &WorldModelParams, now: Stamp) -> bool {
        let period_ns = (1e9 / params.publish_hz.max(0.1)) as u64;
        self.published.is_none_or(|last| now >= last.after_ns(period_ns))
    }

    fn publish(
        &mut self,
        ports: &Ports,
        params: &WorldModelParams,
        listed: Listed,
        vehicle: Option<Pose>,
        cx: &mut Cycle<'_>,
    ) {
        // A map that was sent before, and is emptied now, is sent empty.
        if self.seen.is_empty() && vehicle.is_none() && self.published.is_none() {
            return;
        }
        let now = cx.now();
        self.published = Some(now);
        let contribution = |source: Source| self.contributions.iter().find(|entry| entry.source == source);
        let source_stats = |entry: &Contribution| WorldModelSourceStats {
            name: entry.source.to_string(),
            votes: entry.votes,
            age_s: now.seconds_since(entry.newest),
        };
        let stats_by_source =
            listed.weights.iter().filter_map(|entry| contribution(entry.source)).map(source_stats).collect();
        let weights = listed.weights;
        // Sources that have voted, in the order of the list. The first source is always included, so that the fields of
        // a stack's only source exist from the start.
        let order = weights.iter().map(|entry| entry.source);
        let first = order.clone().next();
        let sources = order.filter(|&source| Some(source) == first || self.seen.contains(source));
        let sources: Sources = sources.chain(self.seen.iter()).collect();
        let options = MapOptions { sources, heights: true, weights };
        let acq_time = if self.changed == Stamp(0) { now } else { self.changed };
        let map =
            MapMessage::new(self.map.clone(), extrinsics(params).frames.local, now, options).with_costs();
        let (mut known, mut obstacle) = (0, 0);
        map.each_cost(|cost| match Label::of_cost(cost) {
            Label::Unknown => {}
            Label::Ground => known += 1,
            Label::Obstacle => {
                known += 1;
                obstacle += 1;
            }
        });
        cx.write_deferred(&ports.map, acq_time, map);
        if let Some(pose) = vehicle {
            let vehicle = PoseInFrame {
                timestamp: Some(now.to_proto()),
                frame_id: extrinsics(params).frames.local.to_owned(),
                pose: Some(pose_message(&pose)),
            };
            cx.write(&ports.vehicle, now, vehicle);
        }
        let stats = WorldModelStats {
            timestamp: Some(now.to_proto()),
            known,
            obstacle,
            votes: self.contributions.iter().map(|entry| entry.votes).sum(),
            scrolled: self.scrolled,
            source: stats_by_source,
        };
        cx.write(&ports.stats, acq_time, stats);
    }
}

/// The listed sources of which a cost map has a field.
fn sources_of(grid: &Grid, listed: &Listed) -> Result<Vec<Source>, String> {
    let has_field = |source: Source| {
        let name = format!("cost.{source}");
        grid.fields.iter().any(|field| field.name == name)
    };
    let known = listed.weights.iter().map(|entry| entry.source);
    let sources: Vec<Source> = known.clone().filter(|&source| has_field(source)).collect();
    if sources.is_empty() {
        let known: Vec<_> = known.map(|source| source.to_string()).collect();
        return Err(format!("expected a field cost.<source> of {}", known.join(", ")));
    }
    Ok(sources)
}

/// Takes a cost map for each of its sources, and its heights once. Returns the number of votes of each.
fn take_all(map: &mut Map, grid: &Grid, origins: &[VoteOrigin]) -> Result<Vec<u64>, GridViewError> {
    if let [origin] = origins {
        return Ok(vec![take(map, grid, origin)?.votes]);
    }
    take_heights(map, grid, origins)?;
    let is_height = |name: &str| name.starts_with("ground.") || name.starts_with("obstacle.");
    let mut costs = grid.clone();
    costs.fields.retain(|field| !is_height(&field.name));
    origins.iter().map(|origin| take(map, &costs, origin).map(|taken| taken.votes)).collect()
}

/// Takes the heights of each cell once, with the first source that says something of it.
fn take_heights(map: &mut Map, grid: &Grid, origins: &[VoteOrigin]) -> Result<(), GridViewError> {
    let mut taken = BTreeSet::new();
    for origin in origins {
        let cells = resampled(grid, origin.source, map.grid())?.cells;
        for sensed in cells.iter().filter(|sensed| sensed.vote.backing >= origin.least_backing) {
            let [ground, obstacle] = &sensed.heights;
            if (ground.count > 0 || obstacle.count > 0)
                && taken.insert(sensed.cell)
                && let Some(cell) = map.cell_mut(sensed.cell)
            {
                cell.observe_heights(ground, obstacle, origin.height_tolerance_m, origin.time, origin.rule);
            }
        }
    }
    Ok(())
}

fn extrinsics(params: &WorldModelParams) -> Extrinsics<'_> {
    Extrinsics::new(params.pose.as_ref(), None)
}
