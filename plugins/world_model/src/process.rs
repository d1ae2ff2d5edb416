//! The process `world_model`.

use crate::algo::{Ballot, take};
use crate::proto::{WorldModelParams, WorldModelStats};
use rcs_geom::Pose;
use rcs_msg::Stamp;
use rcs_msg::foxglove::{Grid, PoseInFrame};
use rcs_runtime::{CommandDef, Cycle, In, Msg, Out, PortBuilder, Process, ProcessDef};
use rcs_sense::{Localizer, PosePorts, Site, pose_message};
use rcs_world::{Label, MAP_CODEC, Map, MapMessage, MapOptions, Source, Sources, VoteRule, Weights};
use serde::{Deserialize, Serialize};

/// Side of a cell of WM1, m.
pub const CELL_SIZE_M: f64 = 0.2;

/// State: the map, the last seconds of poses, and when it was last published.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct WorldModel {
    map: Map,
    localizer: Localizer,
    /// Sources that have voted since the start or the last `CLEAR`.
    seen: Sources,
    published: Option<Stamp>,
    /// Acquisition time of what the map was last changed by.
    changed: Stamp,
    votes: u64,
    scrolled: u64,
}

/// Ports of [`WorldModel`].
#[derive(Debug)]
pub struct Ports {
    /// One input of cost maps for each source.
    costs: Vec<(Source, In<Grid>)>,
    poses: PosePorts,
    map: Out<Grid>,
    vehicle: Out<PoseInFrame>,
    stats: Out<WorldModelStats>,
}

impl Process for WorldModel {
    type Params = WorldModelParams;
    type Ports = Ports;
    const DEF: ProcessDef = ProcessDef {
        plugin: "world_model",
        summary: "WM1: fuses the costs that the sources see into one scrolling map",
        period_ms: 50.0,
        latency_ms: 4.0,
        commands: &[CommandDef { name: "CLEAR", help: "Forget the whole map.", parameters: "" }],
        reads_truth: false,
    };

    fn ports(b: &mut PortBuilder) -> Ports {
        let help = |source: Source| match source {
            Source::Stereo => "costs from range images: field cost.stereo, local frame",
            Source::Color => "costs of the colour models: field cost.color, local frame",
            Source::Terrain => "costs of terrain learned from range: field cost.terrain, local frame",
            Source::Classifier => "costs of the image classifier: field cost.classifier, local frame",
            Source::Bumper => "cells that the bumper hit: field cost.bumper, local frame",
            Source::Infrared => "costs of the infrared sensors: field cost.infrared, local frame",
        };
        let costs = Source::ALL.map(|source| (source, b.optional_input(source.name(), help(source))));
        Ports {
            costs: costs.into(),
            poses: PosePorts::declare(b),
            map: b
                .output("map", "201x201 cells of 0.2 m around the vehicle, local frame")
                .role("map")
                .palette("cost")
                .recorded_by(&MAP_CODEC)
                .build(),
            vehicle: b
                .output("vehicle", "pose of the vehicle in the local frame, with each map")
                .role("pose")
                .build(),
            stats: b.output("stats", "known and obstacle cells of the map").role("stats").build(),
        }
    }

    #[expect(clippy::expect_used, reason = "201 cells of 0.2 m are a grid")]
    fn new(_params: &WorldModelParams) -> Self {
        Self {
            map: Map::new(CELL_SIZE_M).expect("the size of WM1 is valid"),
            localizer: Localizer::default(),
            seen: Sources::default(),
            published: None,
            changed: Stamp(0),
            votes: 0,
            scrolled: 0,
        }
    }

    fn cycle(&mut self, ports: &Ports, params: &WorldModelParams, cx: &mut Cycle<'_>) {
        ports.poses.read(&mut self.localizer, site(params).frames, cx);
        if cx.command().is_some_and(|command| command.name == "CLEAR") {
            self.map.clear();
            self.seen = Sources::default();
        }
        let vehicle = self.scroll(params, cx.now());
        for (source, port) in &ports.costs {
            while let Some(grid) = cx.read(port) {
                if let Err(fault) = self.vote(*source, &grid, params) {
                    cx.fault(format!("{source}: {fault}; cost map skipped"));
                }
            }
        }
        if self.is_due(params, cx.now()) {
            self.publish(ports, params, vehicle, cx);
        }
        cx.exec(match (vehicle.is_some(), self.seen.is_empty()) {
            (true, false) => "fuses costs",
            (true, true) => "waits for costs",
            (false, _) => "waits for the vehicle's pose",
        });
    }
}

impl WorldModel {
    /// Brings the map around the vehicle; it stays where it is while the pose is not known.
    fn scroll(&mut self, params: &WorldModelParams, now: Stamp) -> Option<Pose> {
        // A pose that is not known yet is no fault: before the first message there is none.
        let pose = site(params).local_from_vehicle(&self.localizer, now).ok()?;
        let exposed = self.map.recentre(pose.translation.truncate())?;
        self.scrolled += exposed.len() as u64;
        Some(pose)
    }

    fn vote(&mut self, source: Source, grid: &Msg<Grid>, params: &WorldModelParams) -> Result<(), String> {
        if grid.frame_id != site(params).frames.local {
            return Err(format!("frame is {:?}, expected {:?}", grid.frame_id, site(params).frames.local));
        }
        let rule = VoteRule { rise: params.gain_up.min(255) as u8, fall: params.gain_down.min(255) as u8 };
        let ballot = Ballot {
            source,
            sequence: grid.header().sequence as u32,
            time: grid.acq_time(),
            rule,
            height_tolerance_m: params.height_tolerance_m as f32,
        };
        let mut map = self.map.clone();
        if params.clear_each_frame {
            map.clear();
        }
        let taken = take(&mut map, grid, &ballot).map_err(|error| error.to_string())?;
        self.map = map;
        self.seen.insert(source);
        self.changed = self.changed.max(ballot.time);
        self.votes += taken.votes;
        Ok(())
    }

    fn is_due(&self, params: &WorldModelParams, now: Stamp) -> bool {
        let period_ns = (1e9 / params.publish_hz.max(0.1)) as u64;
        self.published.is_none_or(|last| now >= last.after_ns(period_ns))
    }

    fn publish(
        &mut self,
        ports: &Ports,
        params: &WorldModelParams,
        vehicle: Option<Pose>,
        cx: &mut Cycle<'_>,
    ) {
        if self.seen.is_empty() && vehicle.is_none() {
            return;
        }
        let now = cx.now();
        self.published = Some(now);
        // The stack's only source is in the map from the start, so that its fields do not come later.
        let sources = self.seen.iter().chain([Source::Stereo]).collect();
        let weights = weights(params);
        let options = MapOptions { sources, heights: true, weights };
        let acq_time = if self.changed == Stamp(0) { now } else { self.changed };
        let frame_id = site(params).frames.local.into();
        let map = MapMessage { map: self.map.clone(), frame_id, time: now, options };
        cx.write_deferred(&ports.map, acq_time, map);
        if let Some(pose) = vehicle {
            let vehicle = PoseInFrame {
                timestamp: Some(now.to_proto()),
                frame_id: site(params).frames.local.to_owned(),
                pose: Some(pose_message(&pose)),
            };
            cx.write(&ports.vehicle, now, vehicle);
        }
        let (mut known, mut obstacle) = (0, 0);
        self.map.grid().for_each_run(|_, _, cells| {
            for cell in cells {
                match cell.fused(&weights).label {
                    Label::Unknown => {}
                    Label::Ground => known += 1,
                    Label::Obstacle => {
                        known += 1;
                        obstacle += 1;
                    }
                }
            }
        });
        let stats = WorldModelStats {
            timestamp: Some(now.to_proto()),
            known,
            obstacle,
            votes: self.votes,
            scrolled: self.scrolled,
        };
        cx.write(&ports.stats, acq_time, stats);
    }
}

fn weights(params: &WorldModelParams) -> Weights {
    Weights {
        stereo: params.weight_stereo as f32,
        color: params.weight_color as f32,
        terrain: params.weight_terrain as f32,
        classifier: params.weight_classifier as f32,
        infrared: params.weight_infrared as f32,
    }
}

fn site(params: &WorldModelParams) -> Site<'_> {
    Site::new(params.pose.as_ref(), None)
}
