//! The process `waypoint_follower`: reads waypoints, the map and the vehicle's pose, and drives. Its port table is in
//! the crate's documentation.

use crate::arcs::{self, Arc, Motion, Scene, Scored};
use crate::barred::Barred;
use crate::follower_costs::Costs;
use crate::held::Held;
use crate::modes::{Action, Bars, Mode, Modes, Obstacles, Table, Towards, Transition};
use crate::motion::{
    OWN_TRACK_M, Style, arc_rules, careful, message, poses_along, reversed, shaken, speeds, turned_away,
};
use crate::proto::{BarredPlace, ModeEvent, WaypointFollowerParams};
use crate::settings::{FAR_TIMEOUT_S, check_costs, rules_of};
use crate::signals::{Closed, Watch};
use crate::waypoints::turning_point;
use rcs_geom::{DVec2, DVec3, Pose};
use rcs_msg::foxglove::{Grid, PoseInFrame, PosesInFrame, RawImage};
use rcs_msg::rcs::{ArcChoice, Bumper, DriveCommand, Plan, PlanState, SlipReport, VehicleStatus, WaySlip};
use rcs_msg::{Payload, Stamp};
use rcs_runtime::{Cycle, In, NoCommands, Out, PortBuilder, Process, ProcessDef, Role};
use rcs_sense::{Extrinsics, Localizer, PosePorts, pose_message, pose_of, text_above};
use serde::{Deserialize, Serialize};

/// State: the waypoints, the goal, the poses of the last seconds, the last arc, and the active mode.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct WaypointFollower {
    localizer: Localizer,
    /// Local frame, m.
    waypoints: Vec<(f64, f64)>,
    path_at: Option<Stamp>,
    /// Local frame, m.
    goal: Option<(f64, f64)>,
    /// Whether the planner has found no way to the goal.
    no_way: bool,
    /// When the planner of a larger map said last that there is none; `None` if it has found one since.
    no_far_way: Option<Stamp>,
    /// Curvature of the arc before, 1/m.
    before_per_m: f64,
    /// Whether the vehicle turned on the spot, to the left (1) or right (-1).
    turning: i8,
    modes: Modes,
    /// Whether the active mode is one of before `INIT`.
    is_renewed: bool,
    watch: Watch,
    /// What SHAKE does, m/s and rad/s, and since when.
    shakes: Option<([f64; 2], Stamp)>,
    #[serde(skip)]
    memory: Memory,
}

/// What follows from the newest map and from the parameters: a copy begins with nothing, and makes it again.
#[derive(Debug, Default)]
struct Memory {
    costs: Costs,
    /// The table of modes, with its text.
    table: Option<(String, Table)>,
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
    sensed: In<Grid>,
    /// Images of the cameras on the left and on the right.
    images: [In<RawImage>; 2],
    goal: In<PoseInFrame>,
    plan: In<Plan>,
    far_plan: In<Plan>,
    bumper: In<Bumper>,
    slip: In<SlipReport>,
    way_slip: In<WaySlip>,
    vehicle: In<VehicleStatus>,
    poses: PosePorts,
    drive: Out<DriveCommand>,
    arc: Out<PosesInFrame>,
    arcs: Out<ArcChoice>,
    modes: Out<ModeEvent>,
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
            sensed: b.optional_input(
                "sensed",
                "costs from the sensors that must not stop: it stands without recent ones",
            ),
            images: [
                b.optional_input(
                    "left_images",
                    "images, ranges or labels of the left side: it stands without recent ones",
                ),
                b.optional_input("right_images", "the same of the right side"),
            ],
            goal: b.optional_input("goal", "the goal, local frame: for modes that drive straight to it"),
            plan: b.optional_input("plan", "the plan: for modes that begin when there is no way"),
            far_plan: b.optional_input("far_plan", "the plan on a larger map, for such modes, too"),
            bumper: b.optional_input("bumper", "switches of the bumper, for modes"),
            slip: b.optional_input("slip", "slip of the wheels and load of the motors, for modes"),
            way_slip: b.optional_input("way_slip", "slip over the last metres, for modes"),
            vehicle: b
                .optional_input("vehicle", "state of the vehicle; held or driven by hand, it is not stuck"),
            poses: PosePorts::declare(b),
            drive: b.output("drive", "speed, m/s, and turn rate, rad/s").role(Role::Command).build(),
            arc: b.output("arc", "the arc that is driven, local frame").role(Role::Path).build(),
            arcs: b
                .output("arcs", "the arcs that were considered, with the terms of their scores")
                .role(Role::Stats)
                .build(),
            modes: b.output("modes", "each change of mode, with its reason").role(Role::Stats).build(),
        }
    }

    fn check(params: &WaypointFollowerParams) -> Result<(), String> {
        check_costs(params.costs.as_ref())?;
        if params.weight_goal == 0.0 && params.weight_heading == 0.0 {
            return Err(
                "weight_goal and weight_heading: both are 0, so that no arc leads anywhere".to_owned()
            );
        }
        let costs = params.costs.as_ref();
        let most_m = costs.map_or(0.0, |costs| costs.wish_clearance_m.max(costs.clearance_m));
        table_of(&params.modes)?.check_room(most_m).map_err(|error| format!("modes: {error}"))
    }

    fn new(_params: &WaypointFollowerParams) -> Self {
        Self::default()
    }

    /// The active mode is kept until the next cycle, which says that it has ended.
    fn renew(&self, _params: &WaypointFollowerParams) -> Self {
        Self { modes: self.modes.clone(), is_renewed: true, ..Self::default() }
    }

    fn cycle(&mut self, ports: &Ports, params: &WaypointFollowerParams, cx: &mut Cycle<'_>) {
        // `RUN` may follow before there was a cycle of `INIT`.
        self.end_mode_of_before(ports, params, cx);
        let extrinsics = Extrinsics::new(params.pose.as_ref(), None);
        let local = extrinsics.frames.local;
        ports.poses.read(&mut self.localizer, extrinsics.frames, cx);
        self.take_waypoints(ports, local, cx);
        let pressed = self.take_signals(ports, local, cx);
        let held = Held::of(cx.latest(&ports.vehicle).as_deref(), params.min_speed_mps);
        if held.ends_modes() && self.modes.active().is_some() {
            let why =
                if held == Held::ByHand { "the operator drives by hand" } else { "the vehicle is held" };
            self.end_mode(why, ports, params, cx);
        }
        let now = cx.now();
        let Some(path_at) = self.path_at else {
            send(ports, 0.0, 0.0, cx);
            return cx.exec("waits for waypoints");
        };
        let vehicle = match extrinsics.local_from_vehicle(&self.localizer, now) {
            Ok(vehicle) => vehicle,
            Err(error) => return self.stand(ports, format!("pose: {error}"), cx),
        };
        let too_old = |what: &str, at: Stamp, limit_s: f64| {
            let age_s = now.seconds_since(at);
            (age_s > limit_s).then(|| {
                format!("{what} is {} s old, expected at most {limit_s} s", text_above(age_s, limit_s))
            })
        };
        if let Some(why) = too_old("the path", path_at, params.path_timeout_s) {
            return self.stand(ports, why, cx);
        }
        let Some(map) = cx.latest(&ports.map) else {
            return self.stand(ports, "there is no map".to_owned(), cx);
        };
        if let Some(why) = too_old("the map", map.acq_time_on_arrival(), params.map_timeout_s) {
            return self.stand(ports, why, cx);
        }
        // Cameras before a hedge may see nothing that has a cost; if they send nothing, they are broken.
        let [left, right] = &ports.images;
        let senses = [
            ("sensed", "what is sensed", newest(&ports.sensed, cx)),
            ("left_images", "what comes from the left side", newest(left, cx)),
            ("right_images", "what comes from the right side", newest(right, cx)),
        ];
        for (input, what, newest) in senses {
            let why = match newest {
                Newest::NotWired => None,
                Newest::NothingYet => Some(format!("nothing has come at the input {input}")),
                Newest::At(at) => too_old(what, at, params.sense_timeout_s),
            };
            if let Some(why) = why {
                return self.stand(ports, why, cx);
            }
        }
        if let Err(error) = self.memory.costs.take(&map, local, params.costs.as_ref()) {
            cx.fault(format!("map: {error}"));
            return self.stand(ports, format!("the map cannot be used: {error}"), cx);
        }
        let mode =
            if held.ends_modes() { None } else { self.choose_mode(ports, params, &vehicle, pressed, cx) };
        self.act(ports, params, &vehicle, mode.as_ref(), held, cx);
    }

    fn init(&mut self, ports: &Ports, params: &WaypointFollowerParams, cx: &mut Cycle<'_>) {
        self.end_mode_of_before(ports, params, cx);
        send(ports, 0.0, 0.0, cx);
        cx.done("initialized");
    }

    fn halt(&mut self, ports: &Ports, params: &WaypointFollowerParams, cx: &mut Cycle<'_>) {
        self.path_at = None;
        self.goal = None;
        (self.no_way, self.no_far_way) = (false, None);
        self.end_mode_of_before(ports, params, cx);
        self.end_mode("halted", ports, params, cx);
        self.watch = Watch::default();
        send(ports, 0.0, 0.0, cx);
        cx.done("halted");
    }
}

/// The time of the newest message of an input.
enum Newest {
    NotWired,
    NothingYet,
    At(Stamp),
}

fn newest<T: Payload>(port: &In<T>, cx: &Cycle<'_>) -> Newest {
    match cx.latest(port) {
        Some(message) => Newest::At(message.acq_time_on_arrival()),
        None if cx.is_wired(port) => Newest::NothingYet,
        None => Newest::NotWired,
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
                self.path_at = Some(path.acq_time_on_arrival());
            }
            Err(error) => cx.fault(format!("waypoints: {error}; skipped")),
        }
    }

    /// Reads what modes depend on; returns whether the bumper is pressed, or was since the cycle before.
    fn take_signals(&mut self, ports: &Ports, local: &str, cx: &mut Cycle<'_>) -> bool {
        let mut goal = cx.read_newest(&ports.goal);
        if goal.is_none() && self.goal.is_none() {
            // What was told before HALT or INIT of this process alone is not told again.
            goal = cx.latest(&ports.goal);
        }
        if let Some(goal) = goal {
            let pose = pose_of(goal.pose.as_ref(), &goal.frame_id).ok().filter(|_| goal.frame_id == local);
            self.goal = pose.map(|pose| (pose.translation.x, pose.translation.y));
        }
        if let Some(plan) = cx.read_newest(&ports.plan) {
            self.no_way = plan.state() == PlanState::PlanNoWay;
        }
        if let Some(plan) = cx.read_newest(&ports.far_plan) {
            self.no_far_way = (plan.state() == PlanState::PlanNoWay).then(|| cx.now());
        }
        if let Some(report) = cx.read_newest(&ports.slip) {
            self.watch.take_slip(&report, report.acq_time());
        }
        if let Some(report) = cx.read_newest(&ports.way_slip) {
            self.watch.take_way_slip(&report, report.acq_time());
        }
        let mut pressed = cx.latest(&ports.bumper).is_some_and(|bumper| bumper.left || bumper.right);
        while let Some(bumper) = cx.read(&ports.bumper) {
            pressed |= bumper.left || bumper.right;
        }
        pressed
    }

    /// The mode from now on; `None` for none.
    fn choose_mode(
        &mut self,
        ports: &Ports,
        params: &WaypointFollowerParams,
        vehicle: &Pose,
        pressed: bool,
        cx: &mut Cycle<'_>,
    ) -> Option<Mode> {
        if self.memory.table.as_ref().is_none_or(|(text, _)| *text != params.modes) {
            if self.memory.table.is_some() {
                // What is remembered of the modes is by their places in the table.
                self.end_mode("another table of modes", ports, params, cx);
            }
            let table = table_of(&params.modes).unwrap_or_default();
            self.memory.table = Some((params.modes.clone(), table));
        }
        let (_, table) = self.memory.table.as_ref()?;
        let (now, position) = (cx.now(), vehicle.translation.truncate());
        let began = self.modes.active().map(|(_, began)| began);
        let room_m = self.memory.costs.room_m(position);
        let signals = self.watch.signals(vehicle, pressed, room_m, began, now);
        if let Some(Transition { from, to, reason }) = self.modes.step(table, &signals, now) {
            self.watch.begin(position, now);
            self.shakes = None;
            let timestamp = Some(now.to_proto());
            let began = self.modes.active().and_then(|(at, _)| table.modes.get(at));
            let barred = began.and_then(|mode| self.barred(params, vehicle, mode));
            let begun = self.modes.begun();
            let event = ModeEvent { timestamp, from, to, reason, begun, barred };
            cx.write(&ports.modes, now, event);
        }
        let (at, _) = self.modes.active()?;
        table.modes.get(at).cloned()
    }

    /// Ends the mode that was active before `INIT`.
    fn end_mode_of_before(&mut self, ports: &Ports, params: &WaypointFollowerParams, cx: &mut Cycle<'_>) {
        if std::mem::take(&mut self.is_renewed) {
            self.end_mode("initialized", ports, params, cx);
        }
    }

    /// Ends the active mode, if there is one, for a reason that is not in the table. Forgets what is
    /// remembered of the modes.
    fn end_mode(&mut self, reason: &str, ports: &Ports, params: &WaypointFollowerParams, cx: &mut Cycle<'_>) {
        if let Some((at, _)) = self.modes.active() {
            let name = |table: &Table| table.modes.get(at).map(|mode| mode.name.clone());
            let from = match &self.memory.table {
                Some((_, table)) => name(table),
                // A state that was restored has no table yet.
                None => table_of(&params.modes).ok().as_ref().and_then(name),
            };
            let now = cx.now();
            let event = ModeEvent {
                timestamp: Some(now.to_proto()),
                from: from.unwrap_or_default(),
                reason: reason.to_owned(),
                begun: self.modes.begun(),
                ..ModeEvent::default()
            };
            cx.write(&ports.modes, now, event);
        }
        self.modes.clear();
    }

    /// The point of the path that the vehicle drives to.
    fn turning_point(&self, params: &WaypointFollowerParams, position: DVec2) -> Option<DVec2> {
        let waypoints: Vec<DVec2> = self.waypoints.iter().copied().map(DVec2::from).collect();
        let range = [params.least_target_m, params.most_target_m.max(params.least_target_m)];
        turning_point(&waypoints, position, params.turning_tolerance_m, range)
    }

    /// The place that a mode bars when it begins; never the goal, nor what lies ahead of a vehicle that drives back.
    fn barred(&self, params: &WaypointFollowerParams, vehicle: &Pose, mode: &Mode) -> Option<BarredPlace> {
        if mode.bars_m <= 0.0 || (mode.bars == Bars::Ahead && self.watch.backs()) {
            return None;
        }
        let at = match mode.bars {
            Bars::Target => self.turning_point(params, vehicle.translation.truncate())?,
            Bars::Ahead => DVec2::from(Barred::ahead(vehicle, params.front_m, mode.bars_m).at),
        };
        let goal_m = self.goal.map_or(f64::INFINITY, |goal| at.distance(DVec2::from(goal)));
        (goal_m > mode.bars_m + 1.0).then_some(BarredPlace {
            x_m: at.x,
            y_m: at.y,
            radius_m: mode.bars_m,
            slipped: mode.is_of_slip(),
        })
    }

    /// Drives as the mode says.
    fn act(
        &mut self,
        ports: &Ports,
        params: &WaypointFollowerParams,
        vehicle: &Pose,
        mode: Option<&Mode>,
        held: Held,
        cx: &mut Cycle<'_>,
    ) {
        let position = vehicle.translation.truncate();
        let turning = self.turning_point(params, position);
        let goal = self.goal.map(DVec2::from);
        let target = match mode.map(|mode| mode.towards) {
            Some(Towards::Goal) => goal.or(turning),
            _ => turning,
        };
        let style = Style::new(params, mode);
        let style = cx.latest(&ports.vehicle).map_or(style, |vehicle| style.within(&vehicle));
        let obstacles = mode.map_or(Obstacles::Map, |mode| mode.obstacles);
        self.memory.costs.prepare(obstacles);
        let Some(costs) = self.memory.costs.of(obstacles) else { return };
        let before_per_m = self.before_per_m;
        // The actions REVERSE and SHAKE need no target; arcs are scored all the same, for a target ahead.
        let ahead = vehicle.rotate(DVec3::X).truncate() * params.arc_length_m;
        let scene = Scene {
            sensed: self.memory.costs.sensed(),
            costs,
            vehicle,
            target: target.unwrap_or(position + ahead),
            before_per_m,
            turning: match self.turning {
                1 => Some(Motion::TurnLeft),
                -1 => Some(Motion::TurnRight),
                _ => None,
            },
        };
        let rules = arc_rules(params, mode);
        let scored: Vec<Scored> =
            arcs::list(&rules).into_iter().map(|arc| scene.score(arc, &rules)).collect();
        let (chosen, [speed_mps, yaw_rate_radps]) = match mode.map(|mode| mode.action) {
            None | Some(Action::Follow) => {
                let best = target.and_then(|_| arcs::best(&scored));
                (best, best.map_or([0.0; 2], |at| speeds(&scored[at], &style)))
            }
            Some(Action::Reverse) => {
                let half_width_m = rules_of(params.costs.as_ref()).half_width_m;
                let is_own_track_free = || scene.is_own_track_free(OWN_TRACK_M, half_width_m, &rules);
                reversed(&scored, &style, self.modes.begun(), is_own_track_free)
            }
            Some(Action::Shake) => {
                let now = cx.now();
                let began = self.modes.active().map_or(now, |(_, began)| began);
                let number = self.modes.begun();
                let begun = (number, now.seconds_since(began));
                let order = shaken(&mut self.shakes, &style, vehicle, begun, now, cx.rng());
                let careful_mps = careful(&scored, &style, order);
                (None, turned_away(vehicle, &style, order, careful_mps, number))
            }
        };
        let follows = obstacles == Obstacles::Map && mode.is_none_or(|mode| mode.action == Action::Follow);
        let no_arc = follows && target.is_some() && chosen.is_none();
        let is_free = held == Held::Not;
        let is_recent = |at: Stamp| cx.now().seconds_since(at) <= FAR_TIMEOUT_S;
        let closed =
            Closed { way: self.no_way, far_way: self.no_far_way.is_some_and(is_recent), arcs: no_arc };
        self.watch.take_closed(if is_free { closed } else { Closed::default() }, cx.now());
        let order = if is_free { [speed_mps, yaw_rate_radps] } else { [0.0; 2] };
        self.watch.take_order(order, position, cx.now());
        send(ports, speed_mps, yaw_rate_radps, cx);
        self.before_per_m = match chosen.map(|at| scored[at].arc) {
            Some(Arc { motion: Motion::Forward, curvature_per_m }) => curvature_per_m,
            _ => 0.0,
        };
        self.turning = match chosen.map(|at| scored[at].arc.motion) {
            Some(Motion::TurnLeft) => 1,
            Some(Motion::TurnRight) => -1,
            Some(Motion::Forward) => 0,
            Some(Motion::Backward) | None => self.turning,
        };
        publish(ports, params, vehicle, target, (&scored, chosen), [speed_mps, yaw_rate_radps], mode, cx);
        cx.exec(told(mode, target, chosen.map(|at| scored[at].arc.motion)));
    }

    /// Stops the vehicle, and says why.
    fn stand(&mut self, ports: &Ports, why: String, cx: &mut Cycle<'_>) {
        send(ports, 0.0, 0.0, cx);
        self.watch.take_order([0.0; 2], DVec2::ZERO, cx.now());
        self.watch.take_closed(Closed::default(), cx.now());
        cx.error(why);
    }
}

#[expect(clippy::too_many_arguments, reason = "all that a message about one cycle consists of")]
fn publish(
    ports: &Ports,
    params: &WaypointFollowerParams,
    vehicle: &Pose,
    target: Option<DVec2>,
    (scored, chosen): (&[Scored], Option<usize>),
    [speed_mps, yaw_rate_radps]: [f64; 2],
    mode: Option<&Mode>,
    cx: &mut Cycle<'_>,
) {
    let now = cx.now();
    let frame_id = Extrinsics::new(params.pose.as_ref(), None).frames.local.to_owned();
    let timestamp = Some(now.to_proto());
    let poses = chosen.map(|at| poses_along(&scored[at], vehicle)).unwrap_or_default();
    cx.write(&ports.arc, now, PosesInFrame { timestamp, frame_id: frame_id.clone(), poses });
    let choice = ArcChoice {
        timestamp,
        frame_id,
        target_x_m: target.map_or(f64::NAN, |target| target.x),
        target_y_m: target.map_or(f64::NAN, |target| target.y),
        arcs: scored.iter().map(message).collect(),
        chosen: chosen.map(|at| at as u32),
        speed_mps,
        yaw_rate_radps,
        mode: mode.map_or(String::new(), |mode| mode.name.clone()),
        start: Some(pose_message(vehicle)),
    };
    cx.write(&ports.arcs, now, choice);
}

/// One line about this cycle, for the status.
fn told(mode: Option<&Mode>, target: Option<DVec2>, motion: Option<Motion>) -> String {
    let does = match (target, motion) {
        (_, Some(Motion::Forward)) => "drives",
        (_, Some(Motion::Backward)) => "drives back",
        (_, Some(Motion::TurnLeft | Motion::TurnRight)) => "turns on the spot",
        (_, None) if mode.is_some_and(|mode| mode.action == Action::Shake) => "moves to get free",
        (None, None) => "there is no path: stands",
        (Some(_), None) => "no arc is free: stands",
    };
    mode.map_or(does.to_owned(), |mode| format!("{}: {does}", mode.name))
}

/// The table of a file; an empty one without a file.
fn table_of(text: &str) -> Result<Table, String> {
    if text.is_empty() {
        return Ok(Table::default());
    }
    Table::parse(text).map_err(|error| format!("modes: {error}"))
}

fn send(ports: &Ports, speed_mps: f64, yaw_rate_radps: f64, cx: &mut Cycle<'_>) {
    let now = cx.now();
    let timestamp = Some(now.to_proto());
    let yaw_rate_radps = Some(yaw_rate_radps);
    cx.write(&ports.drive, now, DriveCommand { timestamp, heading_rad: 0.0, speed_mps, yaw_rate_radps });
}
