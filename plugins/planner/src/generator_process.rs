//! The process `waypoint_generator`: reads the goal, commands the planner, and sends waypoints. Its port table is in the
//! crate's documentation.

use crate::goal::Goal;
use crate::process::PlannerCommand;
use crate::proto::{PlanPoint, PlannerGoal, Route, UtmGoal, WaypointGeneratorParams};
use crate::route;
use crate::waypoints::spaced;
use rcs_geom::{DVec2, DVec3, Pose};
use rcs_msg::Stamp;
use rcs_msg::foxglove::{FrameTransforms, Odometry, PoseInFrame, PosesInFrame};
use rcs_runtime::{
    Child, ChildReport, ChildState, Cycle, In, NoCommands, Order, Out, PortBuilder, Process, ProcessDef, Role,
};
use rcs_sense::{Localizer, Origin, pose_message, pose_of};
use serde::{Deserialize, Serialize};

/// Distance between the points of the track, m, and their greatest number.
const TRACK_STEP_M: f64 = 0.5;
const MOST_TRACK: usize = 20_000;

rcs_runtime::commands! {
    /// Commands of [`WaypointGenerator`].
    pub enum WaypointGeneratorCommand {
        GoTo(UtmGoal) = "GO_TO": "Drive to this place instead of the goal of the file.",
    }
}

/// State: the goal, the frames, and what the planner was told.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct WaypointGenerator {
    frames: Localizer,
    /// The newest pose of the local frame in the global one.
    global_from_local: Option<(Pose, Stamp)>,
    /// A goal by command, UTM: zone, easting, northing.
    commanded: Option<(u8, f64, f64)>,
    /// What the planner was told, local frame, m.
    told: Option<(f64, f64)>,
    /// Where the vehicle was, global frame, m.
    track: Vec<(f64, f64)>,
    /// When the vehicle set out.
    began: Option<Stamp>,
    /// When the route was sent last.
    sent: Option<Stamp>,
    /// Why the route of the parameters was not used.
    refused_route: Option<String>,
    /// Standard deviation of the vehicle's position in the global frame, m; 0 if unknown.
    error_m: f64,
}

/// Ports of [`WaypointGenerator`].
#[derive(Debug)]
pub struct Ports {
    path: In<PosesInFrame>,
    transforms: In<FrameTransforms>,
    global: In<Odometry>,
    waypoints: Out<PosesInFrame>,
    goal: Out<PoseInFrame>,
    route: Out<Route>,
    planner: Child<PlannerCommand>,
    follower: Child<NoCommands>,
}

impl Process for WaypointGenerator {
    type Params = WaypointGeneratorParams;
    type Ports = Ports;
    type Command = WaypointGeneratorCommand;
    const DEF: ProcessDef = ProcessDef {
        plugin: "waypoint_generator",
        summary: "Reads the goal in UTM, has the planner plan to it, and makes waypoints of the path",
        period_ms: 50.0,
        latency_ms: 0.0,
        reads_ground_truth: false,
    };

    fn ports(b: &mut PortBuilder) -> Ports {
        Ports {
            path: b.input("path", "the planner's path, local frame"),
            transforms: b.input("transforms", "the local frame in the global frame"),
            global: b.optional_input("global", "pose of the vehicle in the global frame, for its covariance"),
            waypoints: b
                .output("waypoints", "waypoints along the path, local frame; none to stand")
                .role(Role::Path)
                .build(),
            goal: b.output("goal", "the goal in the local frame").role(Role::Goal).build(),
            route: b
                .output(
                    "route",
                    "path memory: the way to the goal without loops and excursions, UTM; near the goal",
                )
                .role(Role::Stats)
                .build(),
            planner: b.optional_child("planner", "what plans the path"),
            follower: b.optional_child("follower", "what drives along the waypoints"),
        }
    }

    fn check(params: &WaypointGeneratorParams) -> Result<(), String> {
        if !params.world.is_empty() {
            Origin::from_toml(&params.world).map_err(|error| format!("world: {error}"))?;
        }
        if !params.goal.is_empty() {
            Goal::from_toml(&params.goal).map_err(|error| format!("goal: {error}"))?;
        }
        route::parse(&params.route).map_err(|error| format!("route: {error}"))?;
        Ok(())
    }

    fn new(_params: &WaypointGeneratorParams) -> Self {
        Self::default()
    }

    fn init(&mut self, ports: &Ports, _params: &WaypointGeneratorParams, cx: &mut Cycle<'_>) {
        pass_on(ports, &Order::Init, &Order::Init, cx);
        await_both(ports, "initialized", cx);
    }

    fn cycle(&mut self, ports: &Ports, params: &WaypointGeneratorParams, cx: &mut Cycle<'_>) {
        if pass_on(ports, &Order::Run, &Order::Run, cx) {
            self.told = None;
        }
        while let Some(command) = cx.next_command::<Self>() {
            let WaypointGeneratorCommand::GoTo(goal) = command;
            self.commanded = Some((goal.zone as u8, goal.easting_m, goal.northing_m));
            self.told = None;
        }
        self.take_transforms(ports, params, cx);
        if let Some(odometry) = cx.read_newest(&ports.global) {
            self.error_m = position_error_m(&odometry);
            self.take_position(&odometry, cx);
        }
        send_waypoints(ports, params, cx);
        let goal = match self.goal(params) {
            Ok(goal) => goal,
            Err(why) => {
                // The planner must not go on planning to another goal.
                if self.told.take().is_some() {
                    cx.send(&ports.planner, Order::Halt);
                }
                send_none(ports, params, cx);
                return cx.error(why);
            }
        };
        let Some((global_from_local, at)) = self.global_from_local else {
            return cx.exec("waits for the local frame in the global frame");
        };
        let local = global_from_local.inverse() * goal.extend(0.0);
        let local = DVec2::new(local.x, local.y);
        if let Some(why) = self.doubt(local, params) {
            send_none(ports, params, cx);
            return cx.error(why);
        }
        let moved = self.told.is_none_or(|told| local.distance(DVec2::from(told)) > params.resend_m);
        if moved {
            let route = self.remembered(params, goal, &global_from_local);
            if let Some(why) = &self.refused_route {
                cx.fault(format!("route: {why}; not used"));
            }
            let order = PlannerCommand::PlanTo(PlannerGoal { x_m: local.x, y_m: local.y, route });
            cx.send(&ports.planner, order);
            self.told = Some((local.x, local.y));
            let now = cx.now();
            let pose = Some(pose_message(&Pose::from_translation(DVec3::new(local.x, local.y, 0.0))));
            let frame_id = params.local_frame.clone();
            cx.write(&ports.goal, now, PoseInFrame { timestamp: Some(now.to_proto()), frame_id, pose });
        }
        let age_s = cx.now().seconds_since(at);
        self.send_route(ports, params, goal, cx);
        tell(ports, (age_s > params.transform_timeout_s).then_some(age_s), cx);
    }

    fn halt(&mut self, ports: &Ports, params: &WaypointGeneratorParams, cx: &mut Cycle<'_>) {
        pass_on(ports, &Order::Halt, &Order::Halt, cx);
        if cx.is_new_command() {
            self.told = None;
            send_none(ports, params, cx);
        }
        await_both(ports, "halted", cx);
    }
}

impl WaypointGenerator {
    /// The newest transform is used until there is another one: the frames drift slowly.
    fn take_transforms(&mut self, ports: &Ports, params: &WaypointGeneratorParams, cx: &mut Cycle<'_>) {
        let mut at = self.global_from_local.map(|(_, at)| at);
        while let Some(message) = cx.read(&ports.transforms) {
            match self.frames.add_transforms(&message, false) {
                Ok(()) => at = Some(message.acq_time()),
                Err(error) => cx.fault(format!("transforms: {error}; skipped")),
            }
        }
        let (global, local) = (&params.global_frame, &params.local_frame);
        if let Ok(pose) = self.frames.lookup(global, local, cx.now(), f64::INFINITY) {
            self.global_from_local = Some((pose, at.unwrap_or(cx.now())));
        }
    }

    /// Adds a position to the track.
    fn take_position(&mut self, odometry: &Odometry, cx: &mut Cycle<'_>) {
        let Ok(pose) = pose_of(odometry.pose.as_ref(), &odometry.frame_id) else { return };
        let at = pose.translation.truncate();
        let step_m = self.track.last().map_or(f64::INFINITY, |&last| at.distance(DVec2::from(last)));
        if step_m >= TRACK_STEP_M && self.track.len() < MOST_TRACK {
            self.began.get_or_insert(cx.now());
            self.track.push((at.x, at.y));
        }
    }

    /// The route of the parameters in the local frame, if it leads to the goal (global frame, m).
    fn remembered(
        &mut self,
        params: &WaypointGeneratorParams,
        goal: DVec2,
        global_from_local: &Pose,
    ) -> Vec<PlanPoint> {
        self.refused_route = None;
        let Ok(Some(route)) = route::parse(&params.route) else { return Vec::new() };
        let Ok(origin) = Origin::from_toml(&params.world) else { return Vec::new() };
        match route::in_global(&route, &origin.0, goal, params.route_goal_m) {
            Ok(points) => {
                let local_from_global = global_from_local.inverse();
                let local = points.iter().map(|point| local_from_global * point.extend(0.0));
                local.map(|at| PlanPoint { x_m: at.x, y_m: at.y }).collect()
            }
            Err(error) => {
                self.refused_route = Some(error.to_string());
                Vec::new()
            }
        }
    }

    /// Sends the route once a second while the vehicle is near the goal (global frame, m): a run ends when the goal is
    /// reached, which this process may not live to see.
    fn send_route(
        &mut self,
        ports: &Ports,
        params: &WaypointGeneratorParams,
        goal: DVec2,
        cx: &mut Cycle<'_>,
    ) {
        let now = cx.now();
        let (Some(began), Some(&at)) = (self.began, self.track.last()) else { return };
        let is_due = self.sent.is_none_or(|sent| now.seconds_since(sent) >= 1.0);
        if !is_due || goal.distance(DVec2::from(at)) > params.route_goal_m {
            return;
        }
        let Ok(origin) = Origin::from_toml(&params.world) else { return };
        let track: Vec<DVec2> = self.track.iter().copied().map(DVec2::from).collect();
        let time_s = now.seconds_since(began);
        self.sent = Some(now);
        cx.write(&ports.route, now, route::to_message(&track, params.same_place_m, &origin.0, time_s));
    }

    /// Why the vehicle should not drive to where the goal now is in the local frame, m.
    fn doubt(&self, local: DVec2, params: &WaypointGeneratorParams) -> Option<String> {
        let by_m = self.told.map_or(0.0, |told| local.distance(DVec2::from(told)));
        if by_m > params.jump_m {
            return Some(format!(
                "the goal has jumped by {by_m:.1} m in the local frame: stands until it is back, RUN or GO_TO"
            ));
        }
        let (error_m, limit_m) = (self.error_m, params.max_error_m);
        (error_m > limit_m)
            .then(|| format!("the position is known to {error_m:.1} m, expected at most {limit_m} m: stands"))
    }

    /// The goal in the global frame, m.
    fn goal(&self, params: &WaypointGeneratorParams) -> Result<DVec2, String> {
        let goal = match self.commanded {
            Some((zone, easting_m, northing_m)) => Goal { zone: Some(zone), easting_m, northing_m },
            None if params.goal.is_empty() => {
                return Err("there is no goal: expected a goal file, or GO_TO".to_owned());
            }
            None => Goal::from_toml(&params.goal).map_err(|error| format!("goal: {error}"))?,
        };
        if params.world.is_empty() {
            return Err("world: expected a file with the [origin] of the global frame".to_owned());
        }
        let origin = Origin::from_toml(&params.world).map_err(|error| format!("world: {error}"))?;
        goal.in_global(&origin.0).map_err(|error| error.to_string())
    }
}

/// Standard deviation of a position, m: the greater one of east and north. 0 without a covariance.
fn position_error_m(odometry: &Odometry) -> f64 {
    let variance = |at: usize| odometry.pose_covariance.get(at).copied().filter(|value| value.is_finite());
    let greatest = variance(0).unwrap_or(0.0).max(variance(7).unwrap_or(0.0));
    greatest.max(0.0).sqrt()
}

/// Sends an order to both children when this process has got it, and to one that the operator gives back. Returns
/// whether the planner was sent one.
fn pass_on(
    ports: &Ports,
    to_planner: &Order<PlannerCommand>,
    to_follower: &Order<NoCommands>,
    cx: &mut Cycle<'_>,
) -> bool {
    let again = |report: Option<ChildReport>| {
        report.is_some_and(|report| report.is_ours && report.obeys_another.is_some())
    };
    let planner = cx.is_new_command() || again(cx.child(&ports.planner));
    if planner {
        cx.send(&ports.planner, to_planner.clone());
    }
    if cx.is_new_command() || again(cx.child(&ports.follower)) {
        cx.send(&ports.follower, to_follower.clone());
    }
    planner
}

fn reports(ports: &Ports, cx: &Cycle<'_>) -> [Option<ChildReport>; 2] {
    [cx.child(&ports.planner), cx.child(&ports.follower)]
}

/// `DONE` when both children are.
fn await_both(ports: &Ports, done: &'static str, cx: &mut Cycle<'_>) {
    let reports = reports(ports, cx);
    let mut reports = reports.iter().flatten().filter(|report| report.obeys_another.is_none());
    if let Some(failed) = reports.clone().find_map(failure) {
        return cx.error(failed);
    }
    match reports.find(|report| report.state != ChildState::Done) {
        Some(waited) => cx.exec(format!("waits for {}", waited.name)),
        None => cx.done(done),
    }
}

/// The state of this process while it runs: that of its children.
fn tell(ports: &Ports, stale_s: Option<f64>, cx: &mut Cycle<'_>) {
    let [planner, follower] = reports(ports, cx);
    let failed = [&planner, &follower].into_iter().flatten().find_map(failure);
    let stale = stale_s.map_or(String::new(), |age_s| {
        format!("; the local frame in the global one is {age_s:.1} s old, and the goal stays where it was")
    });
    match (failed, planner) {
        (Some(why), _) => cx.error(format!("{why}{stale}")),
        (None, Some(planner)) if planner.state == ChildState::Done => cx.done("at the goal"),
        (None, Some(planner)) => cx.exec(format!("{}{stale}", planner.text)),
        (None, None) => cx.error("there is no planner"),
    }
}

fn failure(report: &ChildReport) -> Option<String> {
    let word = match report.state {
        ChildState::Error => "is in ERROR",
        ChildState::Silent => "is silent",
        ChildState::Uninitialized | ChildState::Exec | ChildState::Done => return None,
    };
    Some(format!("{} {word}: {}", report.name, report.text))
}

/// Waypoints of the newest path, as soon as it arrives.
fn send_waypoints(ports: &Ports, params: &WaypointGeneratorParams, cx: &mut Cycle<'_>) {
    let Some(path) = cx.read_newest(&ports.path) else { return };
    let poses: Result<Vec<Pose>, _> =
        path.poses.iter().map(|pose| pose_of(Some(pose), &path.frame_id)).collect();
    let points: Vec<DVec2> = match poses {
        Ok(poses) if path.frame_id == params.local_frame => {
            poses.iter().map(|pose| pose.translation.truncate()).collect()
        }
        Ok(_) => {
            let expected = &params.local_frame;
            return cx.fault(format!("path: frame is {:?}, expected {expected:?}; skipped", path.frame_id));
        }
        Err(error) => return cx.fault(format!("path: {error}; skipped")),
    };
    let waypoints = spaced(&points, params.spacing_m);
    let pose = |&at: &DVec2| pose_message(&Pose::from_xy_yaw(at.x, at.y, 0.0));
    let message = PosesInFrame {
        timestamp: path.timestamp,
        frame_id: path.frame_id.clone(),
        poses: waypoints.iter().map(pose).collect(),
    };
    cx.write(&ports.waypoints, path.acq_time(), message);
}

/// No waypoints, so that the vehicle stands.
fn send_none(ports: &Ports, params: &WaypointGeneratorParams, cx: &mut Cycle<'_>) {
    let now = cx.now();
    let (timestamp, frame_id) = (Some(now.to_proto()), params.local_frame.clone());
    cx.write(&ports.waypoints, now, PosesInFrame { timestamp, frame_id, poses: Vec::new() });
}
