//! The process `waypoint_follower`: reads waypoints, the map and the vehicle's pose, and drives. Its port table is in
//! the crate's documentation.

use crate::arcs::{self, Arc, Motion, Scene, Scored, Weights};
use crate::costs::CostGrid;
use crate::map_reader::MapReader;
use crate::proto::{ArcChoice, ScoredArc, WaypointFollowerParams, scored_arc};
use crate::settings::{check_costs, rules_of};
use crate::terrain::{Rules, Terrain};
use crate::waypoints::turning_point;
use rcs_geom::{DVec2, Pose};
use rcs_msg::Stamp;
use rcs_msg::foxglove::{Grid, PosesInFrame};
use rcs_msg::rcs::{Bumper, DriveCommand};
use rcs_runtime::{Cycle, In, Msg, NoCommands, Out, PortBuilder, Process, ProcessDef, Role};
use rcs_sense::{Extrinsics, Localizer, PosePorts, pose_message, pose_of};
use serde::{Deserialize, Serialize};

/// State: the waypoints, the poses of the last seconds, the last arc, and whether the vehicle backs up.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct WaypointFollower {
    localizer: Localizer,
    /// Local frame, m.
    waypoints: Vec<(f64, f64)>,
    path_at: Option<Stamp>,
    /// Curvature of the arc before, 1/m.
    before_per_m: f64,
    /// Where and when the bumper was hit.
    backs_up: Option<((f64, f64), Stamp)>,
    #[serde(skip)]
    memory: Memory,
}

/// What follows from the newest map: a copy begins with nothing, and makes it again.
#[derive(Debug, Default)]
struct Memory {
    reader: MapReader,
    terrain: Terrain,
    /// Costs, with the sequence of their map and their rules.
    costs: Option<(u64, Rules, CostGrid)>,
}

impl Clone for Memory {
    fn clone(&self) -> Self {
        Memory::default()
    }
}

/// Ports of [`WaypointFollower`].
#[derive(Debug)]
pub struct Ports {
    waypoints: In<PosesInFrame>,
    map: In<Grid>,
    bumper: In<Bumper>,
    poses: PosePorts,
    drive: Out<DriveCommand>,
    arc: Out<PosesInFrame>,
    arcs: Out<ArcChoice>,
}

impl Process for WaypointFollower {
    type Params = WaypointFollowerParams;
    type Ports = Ports;
    type Command = NoCommands;
    const DEF: ProcessDef = ProcessDef {
        plugin: "waypoint_follower",
        summary: "Drives along waypoints on the best of a list of arcs, and stands when it does not know enough",
        period_ms: 50.0,
        latency_ms: 0.0,
        reads_ground_truth: false,
    };

    fn ports(b: &mut PortBuilder) -> Ports {
        Ports {
            waypoints: b.input("waypoints", "waypoints of the path, local frame; none to stand"),
            map: b.input("map", "the world model's map: field cost, local frame"),
            bumper: b.optional_input("bumper", "switches of the bumper; after a hit the vehicle backs up"),
            poses: PosePorts::declare(b),
            drive: b.output("drive", "speed, m/s, and turn rate, rad/s").role(Role::Command).build(),
            arc: b.output("arc", "the arc that is driven, local frame").role(Role::Path).build(),
            arcs: b
                .output("arcs", "the arcs that were considered, with the terms of their scores")
                .role(Role::Stats)
                .build(),
        }
    }

    fn check(params: &WaypointFollowerParams) -> Result<(), String> {
        check_costs(params.costs.as_ref())
    }

    fn new(_params: &WaypointFollowerParams) -> Self {
        Self::default()
    }

    fn cycle(&mut self, ports: &Ports, params: &WaypointFollowerParams, cx: &mut Cycle<'_>) {
        let extrinsics = Extrinsics::new(params.pose.as_ref(), None);
        ports.poses.read(&mut self.localizer, extrinsics.frames, cx);
        self.take_waypoints(ports, extrinsics.frames.local, cx);
        let now = cx.now();
        let Some(path_at) = self.path_at else {
            send(ports, 0.0, 0.0, cx);
            return cx.exec("waits for waypoints");
        };
        let vehicle = match extrinsics.local_from_vehicle(&self.localizer, now) {
            Ok(vehicle) => vehicle,
            Err(error) => return stand(ports, format!("pose: {error}"), cx),
        };
        let too_old = |what: &str, at: Stamp, limit_s: f64| {
            let age_s = now.seconds_since(at);
            (age_s > limit_s).then(|| format!("{what} is {age_s:.1} s old, expected at most {limit_s} s"))
        };
        if let Some(why) = too_old("the path", path_at, params.path_timeout_s) {
            return stand(ports, why, cx);
        }
        if self.is_backing_up(ports, &vehicle, params, cx) {
            send(ports, -params.min_speed_mps, 0.0, cx);
            return cx.exec("backs up from what the bumper hit");
        }
        let position = vehicle.translation.truncate();
        let waypoints: Vec<DVec2> = self.waypoints.iter().copied().map(DVec2::from).collect();
        let range = [params.least_target_m, params.most_target_m.max(params.least_target_m)];
        let Some(target) = turning_point(&waypoints, position, params.turning_tolerance_m, range) else {
            send(ports, 0.0, 0.0, cx);
            return cx.exec("there is no path: stands");
        };
        let Some(map) = cx.latest(&ports.map) else {
            return stand(ports, "there is no map".to_owned(), cx);
        };
        if let Some(why) = too_old("the map", map.acq_time(), params.map_timeout_s) {
            return stand(ports, why, cx);
        }
        if let Err(error) = self.memory.take(&map, extrinsics.frames.local, params) {
            cx.fault(format!("map: {error}"));
            return stand(ports, format!("the map cannot be used: {error}"), cx);
        }
        self.drive(ports, params, &vehicle, target, cx);
    }

    fn init(&mut self, ports: &Ports, _params: &WaypointFollowerParams, cx: &mut Cycle<'_>) {
        send(ports, 0.0, 0.0, cx);
        cx.done("initialized");
    }

    fn halt(&mut self, ports: &Ports, _params: &WaypointFollowerParams, cx: &mut Cycle<'_>) {
        self.path_at = None;
        self.backs_up = None;
        send(ports, 0.0, 0.0, cx);
        cx.done("halted");
    }
}

impl WaypointFollower {
    fn take_waypoints(&mut self, ports: &Ports, local: &str, cx: &mut Cycle<'_>) {
        let Some(path) = cx.read_newest(&ports.waypoints) else { return };
        if path.frame_id != local {
            return cx.fault(format!("waypoints: frame is {:?}, expected {local:?}; skipped", path.frame_id));
        }
        let poses: Result<Vec<Pose>, _> =
            path.poses.iter().map(|pose| pose_of(Some(pose), &path.frame_id)).collect();
        match poses {
            Ok(poses) => {
                self.waypoints = poses.iter().map(|pose| (pose.translation.x, pose.translation.y)).collect();
                self.path_at = Some(path.acq_time());
            }
            Err(error) => cx.fault(format!("waypoints: {error}; skipped")),
        }
    }

    /// Whether the vehicle is on its way back from something that the bumper hit.
    fn is_backing_up(
        &mut self,
        ports: &Ports,
        vehicle: &Pose,
        params: &WaypointFollowerParams,
        cx: &mut Cycle<'_>,
    ) -> bool {
        let (now, position) = (cx.now(), vehicle.translation.truncate());
        let mut pressed = false;
        while let Some(bumper) = cx.read(&ports.bumper) {
            pressed |= bumper.left || bumper.right;
        }
        if pressed && params.reverse_m > 0.0 && self.backs_up.is_none() {
            self.backs_up = Some(((position.x, position.y), now));
        }
        if let Some((hit, since)) = self.backs_up {
            let away_m = position.distance(DVec2::from(hit));
            if away_m >= params.reverse_m || now.seconds_since(since) >= params.reverse_s {
                self.backs_up = None;
            }
        }
        self.backs_up.is_some()
    }

    fn drive(
        &mut self,
        ports: &Ports,
        params: &WaypointFollowerParams,
        vehicle: &Pose,
        target: DVec2,
        cx: &mut Cycle<'_>,
    ) {
        let Some((.., costs)) = &self.memory.costs else { return };
        let rules = rules(params);
        let before_per_m = self.before_per_m;
        let scene = Scene { sensed: &self.memory.reader.sensed, costs, vehicle, target, before_per_m };
        let scored: Vec<Scored> =
            arcs::list(&rules).into_iter().map(|arc| scene.score(arc, &rules)).collect();
        let best = arcs::best(&scored);
        let (speed_mps, yaw_rate_radps) = best.map_or((0.0, 0.0), |at| speeds(&scored[at], params));
        send(ports, speed_mps, yaw_rate_radps, cx);
        let now = cx.now();
        let frame_id = Extrinsics::new(params.pose.as_ref(), None).frames.local.to_owned();
        let timestamp = Some(now.to_proto());
        let poses = best.map(|at| along(&scored[at], vehicle)).unwrap_or_default();
        cx.write(&ports.arc, now, PosesInFrame { timestamp, frame_id: frame_id.clone(), poses });
        let choice = ArcChoice {
            timestamp,
            frame_id,
            target_x_m: target.x,
            target_y_m: target.y,
            arcs: scored.iter().map(message).collect(),
            chosen: best.map(|at| at as u32),
            speed_mps,
            yaw_rate_radps,
        };
        cx.write(&ports.arcs, now, choice);
        self.before_per_m = match best.map(|at| scored[at].arc) {
            Some(Arc { motion: Motion::Forward, curvature_per_m }) => curvature_per_m,
            _ => 0.0,
        };
        match best.map(|at| scored[at].arc.motion) {
            Some(Motion::Forward) => cx.exec("drives"),
            Some(Motion::Backward) => cx.exec("drives back"),
            Some(Motion::TurnLeft | Motion::TurnRight) => cx.exec("turns on the spot"),
            None => cx.exec("no arc is free: stands"),
        }
    }
}

impl Memory {
    /// Makes the costs of a map, if they are not those of the last one.
    fn take(&mut self, map: &Msg<Grid>, local: &str, params: &WaypointFollowerParams) -> Result<(), String> {
        let (sequence, rules) = (map.header().sequence, rules_of(params.costs.as_ref()));
        if self.costs.as_ref().is_some_and(|(known, by, _)| (*known, by) == (sequence, &rules)) {
            return Ok(());
        }
        self.costs = None;
        self.reader.read(map, local)?;
        // Without heading and relief, costs do not depend on the vehicle's pose.
        let costs = self.terrain.costs(&self.reader.sensed, &Pose::IDENTITY, &rules);
        self.costs = Some((sequence, rules, costs.map_err(|error| error.to_string())?));
        Ok(())
    }
}

/// Speed along an arc, m/s, and turn rate, rad/s.
fn speeds(chosen: &Scored, params: &WaypointFollowerParams) -> (f64, f64) {
    let Arc { motion, curvature_per_m } = chosen.arc;
    let (least, turn) = (params.min_speed_mps.min(params.max_speed_mps), params.max_yaw_rate_radps);
    match motion {
        Motion::TurnLeft => (0.0, turn),
        Motion::TurnRight => (0.0, -turn),
        Motion::Backward => (-least, curvature_per_m * -least),
        Motion::Forward => {
            let braking_m = (chosen.free_m - params.stop_margin_m).max(0.0);
            let stops = libm::sqrt(2.0 * params.braking_mps2 * braking_m);
            let bends = turn / curvature_per_m.abs().max(1e-6);
            let slowed = params.max_speed_mps * (1.0 - params.cost_slowdown * chosen.mean_cost);
            let speed_mps = slowed.min(stops).min(bends).max(least.min(bends));
            (speed_mps, curvature_per_m * speed_mps)
        }
    }
}

fn send(ports: &Ports, speed_mps: f64, yaw_rate_radps: f64, cx: &mut Cycle<'_>) {
    let now = cx.now();
    let timestamp = Some(now.to_proto());
    let yaw_rate_radps = Some(yaw_rate_radps);
    cx.write(&ports.drive, now, DriveCommand { timestamp, heading_rad: 0.0, speed_mps, yaw_rate_radps });
}

/// Stops the vehicle, and says why.
fn stand(ports: &Ports, why: String, cx: &mut Cycle<'_>) {
    send(ports, 0.0, 0.0, cx);
    cx.error(why);
}

/// Poses along an arc, every 0.2 m.
fn along(chosen: &Scored, vehicle: &Pose) -> Vec<rcs_msg::foxglove::Pose> {
    let start = (vehicle.translation.truncate(), vehicle.yaw());
    let steps = (chosen.free_m / 0.2) as u32;
    let distances = (0..=steps).map(|step| f64::from(step) * 0.2);
    let poses = distances.map(|along| arcs::pose_at(start, chosen.arc, along));
    poses.map(|(at, yaw)| pose_message(&Pose::from_xy_yaw(at.x, at.y, yaw))).collect()
}

fn message(scored: &Scored) -> ScoredArc {
    let motion = match scored.arc.motion {
        Motion::Forward => scored_arc::Motion::Forward,
        Motion::Backward => scored_arc::Motion::Backward,
        Motion::TurnLeft => scored_arc::Motion::TurnLeft,
        Motion::TurnRight => scored_arc::Motion::TurnRight,
    };
    let [goal, heading, cost, turn, change, short] = scored.terms.map(|term| term as f32);
    ScoredArc {
        motion: motion.into(),
        curvature_per_m: scored.arc.curvature_per_m as f32,
        free_m: scored.free_m as f32,
        goal,
        heading,
        cost,
        turn,
        change,
        short,
        total: scored.total() as f32,
        open: scored.open,
    }
}

fn rules(params: &WaypointFollowerParams) -> arcs::Rules {
    arcs::Rules {
        length_m: params.arc_length_m,
        max_curvature_per_m: params.max_curvature_per_m,
        per_side: params.arcs_per_side,
        least_free_m: params.least_free_m,
        escape_m: params.escape_m,
        tail_m: params.tail_m,
        weights: Weights {
            goal: params.weight_goal,
            heading: params.weight_heading,
            cost: params.weight_cost,
            turn: params.weight_turn,
            not_forward: params.weight_not_forward,
            change: params.weight_change,
            short: params.weight_short,
        },
    }
}
