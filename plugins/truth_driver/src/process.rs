//! The process `truth_driver`: reads ground truth, plans a path, and sends drive commands. Its port table is in the
//! crate's documentation.

use crate::proto::{TruthDriverParams, TruthDriverStats};
use crate::pursuit::{Steering, Style, length, progress, steer};
use crate::terrain::{Rules, Terrain, Way};
use rcs_geom::{DVec2, DVec3, Pose};
use rcs_msg::Stamp;
use rcs_msg::foxglove::{Grid, Odometry, PoseInFrame, PosesInFrame};
use rcs_msg::rcs::DriveCommand;
use rcs_runtime::{Cycle, In, NoCommands, Out, PortBuilder, Process, ProcessDef, Role};
use rcs_sense::{pose_message, pose_of};
use serde::{Deserialize, Serialize};

/// Frame of the ground truth.
const GLOBAL: &str = "global";
/// Period with which path and statistics are sent again, ns.
const REPORT_NS: u64 = 500_000_000;

/// State: pose, goal, path, and the position along the path. The map is not part of the state: it is read again for
/// each search.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct TruthDriver {
    pose: Option<(Pose, Stamp)>,
    goal: Option<DVec3>,
    path: Vec<(DVec2, f64)>,
    at: usize,
    /// Digest of the map on which the path was searched.
    map: Option<u64>,
    plan: Plan,
    plans: u64,
    expanded: u64,
    cost_m: f64,
    last_reason: String,
    reported: Option<Stamp>,
}

/// State of planning.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
enum Plan {
    /// A path must be searched, and why.
    #[default]
    Missing,
    Wanted(String),
    Good,
    /// There is no path from a place, m, and why.
    Impossible(DVec2, String),
}

/// Ports of [`TruthDriver`].
#[derive(Debug)]
pub struct Ports {
    pose: In<Odometry>,
    map: In<Grid>,
    goal: In<PoseInFrame>,
    drive: Out<DriveCommand>,
    path: Out<PosesInFrame>,
    stats: Out<TruthDriverStats>,
}

impl Process for TruthDriver {
    type Params = TruthDriverParams;
    type Ports = Ports;
    type Command = NoCommands;
    const DEF: ProcessDef = ProcessDef {
        plugin: "truth_driver",
        summary: "Drives the simulated vehicle to its goal on the cheapest path of the true map: a reference for other drivers",
        period_ms: 50.0,
        latency_ms: 0.0,
        reads_ground_truth: true,
    };

    fn ports(b: &mut PortBuilder) -> Ports {
        Ports {
            pose: b.input("ground_truth_pose", "true pose of the vehicle, frame global"),
            map: b.input(
                "ground_truth_map",
                "fields height and vegetation (m) and class of the whole world, frame global",
            ),
            goal: b.input("goal", "the goal, frame global"),
            drive: b.output("drive", "speed, m/s, and turn rate, rad/s").role(Role::Command).build(),
            path: b
                .output("path", "cells of the path from where it was planned to the goal, frame global")
                .role(Role::Path)
                .build(),
            stats: b.output("stats", "planning and path following").role(Role::Stats).build(),
        }
    }

    fn new(_params: &TruthDriverParams) -> Self {
        Self::default()
    }

    fn cycle(&mut self, ports: &Ports, params: &TruthDriverParams, cx: &mut Cycle<'_>) {
        self.take_pose(ports, cx);
        self.take_goal(ports, cx);
        self.take_map(ports, cx);
        let now = cx.now();
        let fresh = |at: Stamp| now.seconds_since(at) <= params.truth_timeout_s;
        let (Some(pose), Some(goal), Some(_)) =
            (self.pose.filter(|&(_, at)| fresh(at)).map(|(pose, _)| pose), self.goal, self.map)
        else {
            cx.exec("waits for a true pose, map and goal");
            return;
        };
        let place = pose.translation.truncate();
        if place.distance(goal.truncate()) < params.goal_radius_m {
            send_drive(ports, Steering::default(), cx);
            cx.done("at the goal");
            return;
        }
        let off_path_m = self.follow(place, params);
        if !matches!(self.plan, Plan::Good | Plan::Impossible(..)) {
            self.search(ports, place, goal.truncate(), params, cx);
        }
        if let Plan::Impossible(_, reason) = &self.plan {
            cx.error(reason.clone());
            return;
        }
        let steering = steer(&self.path, self.at, place, pose.yaw(), &style(params));
        send_drive(ports, steering, cx);
        self.report(ports, off_path_m, cx);
        cx.exec("follows its path");
    }
}

impl TruthDriver {
    fn take_pose(&mut self, ports: &Ports, cx: &mut Cycle<'_>) {
        let Some(odometry) = cx.read_newest(&ports.pose) else { return };
        match pose_of(odometry.pose.as_ref(), &odometry.frame_id) {
            Ok(pose) if odometry.frame_id == GLOBAL => self.pose = Some((pose, odometry.acq_time())),
            Ok(_) => cx.fault(elsewhere("ground_truth_pose", &odometry.frame_id)),
            Err(error) => cx.fault(format!("ground_truth_pose: {error}; skipped")),
        }
    }

    fn take_goal(&mut self, ports: &Ports, cx: &mut Cycle<'_>) {
        let Some(message) = cx.read_newest(&ports.goal) else { return };
        match pose_of(message.pose.as_ref(), &message.frame_id) {
            Ok(goal) if message.frame_id == GLOBAL => {
                if self.goal != Some(goal.translation) {
                    self.goal = Some(goal.translation);
                    self.plan = Plan::Wanted("the goal has changed".to_owned());
                }
            }
            Ok(_) => cx.fault(elsewhere("goal", &message.frame_id)),
            Err(error) => cx.fault(format!("goal: {error}; skipped")),
        }
    }

    fn take_map(&mut self, ports: &Ports, cx: &mut Cycle<'_>) {
        let Some(grid) = cx.read_newest(&ports.map) else { return };
        if grid.frame_id != GLOBAL {
            cx.fault(elsewhere("ground_truth_map", &grid.frame_id));
            return;
        }
        let digest = digest(&grid.data);
        if self.map != Some(digest) {
            self.map = Some(digest);
            self.plan = Plan::Wanted("the map has changed".to_owned());
        }
    }

    /// Advances along the path and requests a new one if the vehicle has left it, or has moved since there was none.
    /// Returns the distance from the path, m.
    fn follow(&mut self, place: DVec2, params: &TruthDriverParams) -> f64 {
        if let Plan::Impossible(from, _) = self.plan
            && from.distance(place) > params.stray_m
        {
            self.plan = Plan::Wanted("the vehicle is elsewhere than where no way was found".to_owned());
        }
        if self.path.is_empty() {
            return 0.0;
        }
        let (at, off_path_m) = progress(&self.path, self.at, place);
        self.at = at;
        if self.plan == Plan::Good && off_path_m > params.stray_m {
            self.plan = Plan::Wanted(format!("the vehicle is {off_path_m:.1} m off its path"));
        }
        off_path_m
    }

    fn search(
        &mut self,
        ports: &Ports,
        place: DVec2,
        goal: DVec2,
        params: &TruthDriverParams,
        cx: &mut Cycle<'_>,
    ) {
        let Some(grid) = cx.latest(&ports.map) else { return };
        let rules = rules(params);
        let terrain = match Terrain::new(&grid, &rules) {
            Ok(terrain) => terrain,
            Err(error) => {
                cx.fault(format!("ground_truth_map: {error}"));
                self.plan = Plan::Impossible(place, format!("the map cannot be used: {error}"));
                return;
            }
        };
        self.plans += 1;
        if let Plan::Wanted(reason) = &self.plan {
            self.last_reason.clone_from(reason);
        }
        match terrain.way(place, goal, &rules) {
            Ok(Way { points, cost_m, expanded }) => {
                (self.path, self.at, self.cost_m, self.expanded) = (points, 0, cost_m, expanded);
                self.plan = Plan::Good;
                self.reported = None;
            }
            Err(error) => {
                self.path.clear();
                self.plan = Plan::Impossible(place, error.to_string());
            }
        }
    }

    fn report(&mut self, ports: &Ports, off_path_m: f64, cx: &mut Cycle<'_>) {
        let now = cx.now();
        if self.reported.is_some_and(|last| now < last.after_ns(REPORT_NS)) {
            return;
        }
        self.reported = Some(now);
        let pose = |&(point, _): &(DVec2, f64)| pose_message(&Pose::from_translation(point.extend(0.0)));
        let path = PosesInFrame {
            timestamp: Some(now.to_proto()),
            frame_id: GLOBAL.to_owned(),
            poses: self.path.iter().map(pose).collect(),
        };
        cx.write(&ports.path, now, path);
        let stats = crate::proto::TruthDriverStats {
            timestamp: Some(now.to_proto()),
            plans: self.plans,
            last_reason: self.last_reason.clone(),
            expanded: self.expanded,
            length_m: length(&self.path, self.at),
            cost_m: self.cost_m,
            off_path_m,
            clearance_m: self.path.get(self.at).map_or(0.0, |&(_, room)| room),
        };
        cx.write(&ports.stats, now, stats);
    }
}

fn send_drive(ports: &Ports, steering: Steering, cx: &mut Cycle<'_>) {
    let now = cx.now();
    // Commands a turn rate, because the heading of a command is in the local frame, whose relation to ground truth is
    // unknown.
    let command = DriveCommand {
        timestamp: Some(now.to_proto()),
        heading_rad: 0.0,
        speed_mps: steering.speed_mps,
        yaw_rate_radps: Some(steering.yaw_rate_radps),
    };
    cx.write(&ports.drive, now, command);
}

fn elsewhere(port: &str, frame: &str) -> String {
    format!("{port}: frame is {frame:?}, expected {GLOBAL:?}; skipped")
}

/// Digest of a map's bytes (FNV over words of 8 bytes), which tells whether a repeated map has changed.
fn digest(bytes: &[u8]) -> u64 {
    let (words, rest) = bytes.as_chunks::<8>();
    let start = 0xcbf2_9ce4_8422_2325_u64 ^ bytes.len() as u64;
    let mixed = |hash: u64, word: u64| (hash ^ word).wrapping_mul(0x0000_0100_0000_01b3).rotate_left(23);
    let hash = words.iter().fold(start, |hash, word| mixed(hash, u64::from_le_bytes(*word)));
    rest.iter().fold(hash, |hash, &byte| mixed(hash, u64::from(byte)))
}

fn rules(params: &TruthDriverParams) -> Rules {
    let half_m = params.vehicle_width_m / 2.0;
    Rules {
        room_m: half_m + params.clearance_m,
        wish_room_m: half_m + params.wish_clearance_m.max(params.clearance_m),
        room_weight: params.clearance_weight,
        max_slope: libm::tan(params.max_slope_deg.to_radians()),
        max_step_m: params.max_step_m,
        slope_weight: params.slope_weight,
        slip_weight: params.slip_weight,
        vegetation_weight: params.vegetation_weight,
    }
}

fn style(params: &TruthDriverParams) -> Style {
    let half_m = params.vehicle_width_m / 2.0;
    let stated_mps = Some(params.vehicle_speed_mps).filter(|&speed_mps| speed_mps > 0.0);
    let max_speed_mps = params.max_speed_mps.min(stated_mps.unwrap_or(f64::INFINITY));
    Style {
        lookahead_m: params.lookahead_m,
        max_speed_mps,
        min_speed_mps: params.min_speed_mps.min(max_speed_mps),
        yaw_gain_per_s: params.yaw_gain_per_s,
        max_yaw_rate_radps: params.max_yaw_rate_radps,
        room_m: half_m + params.clearance_m,
        wish_room_m: half_m + params.wish_clearance_m.max(params.clearance_m),
    }
}
