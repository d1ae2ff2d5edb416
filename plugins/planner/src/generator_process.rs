//! The process `waypoint_generator`: reads the goal, commands the planner, and sends waypoints. Its port table is in the
//! crate's documentation.

mod bars;
mod given;
mod goals;
mod inputs;
mod led;
mod path_memory;
mod same_start;

use self::bars::in_local;
use self::given::{Given, Refused};
use self::goals::zones_of_files;
use self::inputs::points;
use self::path_memory::remembered_of;
use crate::barred::Barred;
use crate::children::Children;
use crate::goal::Goal;
use crate::goal_search::{GoalSearch, slowness};
use crate::grip::Gripped;
use crate::held::Held;
use crate::mission::Mission;
use crate::process::PlannerCommand;
use crate::proto::{
    ModeEvent, PlanPoint, PlanZone, PlannerGoal, Route, SlipMemory, UtmGoal, WaypointGeneratorParams,
};
use crate::shortcut::Way;
use crate::waypoints::spaced;
use crate::zones::{Polygon, Zones};
use crate::{route, slips};
use rcs_geom::{DVec2, Pose};
use rcs_msg::Stamp;
use rcs_msg::foxglove::{FrameTransforms, Grid, Odometry, PoseInFrame, PosesInFrame};
use rcs_msg::params::check_typed;
use rcs_msg::rcs;
use rcs_runtime::{Cycle, In, InputRole, Order, Out, PortBuilder, Process, ProcessDef, Role};
use rcs_sense::{FrameWatch, Localizer, Origin, pose_message, text_above};
use serde::{Deserialize, Serialize};

/// The planner of the near map is told another point of the far path when that is this far away, m.
const LOOKAHEAD_STEP_M: f64 = 1.0;
/// Greatest length of a path, m.
const MOST_PATH_M: f64 = 10_000.0;
rcs_runtime::commands! {
    /// Commands of [`WaypointGenerator`].
    pub enum WaypointGeneratorCommand {
        GoTo(UtmGoal) = "GO_TO": "Drive to this place instead of the goal of the file.",
        Save = "SAVE" once: "Write the slips now. The route is written near the goal alone, again and again.",
        Clear = "CLEAR" once: "Forget the remembered route and slips until the next start, and the way and slips of this run so far.",
    }
}

/// What the children are still to be told.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
struct ToTell {
    /// An `INIT` that this process has received.
    init: bool,
    /// The goal again, because of something other than its motion.
    goal: bool,
}

/// State: the goal, the frames, and what the planner was told.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct WaypointGenerator {
    frames: Localizer,
    /// The newest pose of the local frame in the global one.
    global_from_local: Option<(Pose, Stamp)>,
    /// A goal by command, UTM: zone, easting, northing.
    commanded: Option<(u8, f64, f64)>,
    /// The operator's mission, global frame, m.
    mission: Mission,
    /// The search for the goal of the file, since it arrived there.
    search: Option<GoalSearch>,
    /// Where the vehicle must not drive, global frame, m, as the planners were told, or as they would be if the goal were
    /// not forbidden.
    zones: Zones,
    /// Why the goal is not driven to.
    forbidden: Option<String>,
    /// The goal that the planners were told, local frame, m.
    told: Option<(f64, f64)>,
    /// The same in the global frame, m.
    told_global: (f64, f64),
    /// The newest pose of the local frame in the global one before it jumped.
    before_jump: Option<Pose>,
    to_tell: ToTell,
    /// Where the goal lay by the registration of the route when they were told, local frame, m.
    route_told: Option<(f64, f64)>,
    /// What the planner of the near map was told, local frame, m.
    near_told: Option<(f64, f64)>,
    /// Whether the planners were halted.
    is_halted: bool,
    /// Whether the follower was halted, because the vehicle stands: its modes would drive on without waypoints.
    is_standing: bool,
    /// Fingerprint of the parameters.
    obeyed: Option<u64>,
    /// Why the slips of the parameters were not used.
    refused_slips: Refused,
    /// Fingerprint of the route and the slips of the parameters that it was told to forget.
    forgotten: Option<u64>,
    /// The path of the planner of the far map, local frame, m; empty without one.
    far_path: Vec<(f64, f64)>,
    /// When it came.
    far_path_at: Option<Stamp>,
    /// Where the vehicle was, global frame, m.
    track: Vec<(f64, f64)>,
    /// The way of this run for the next one.
    way: Way,
    /// When the vehicle set out.
    began: Option<Stamp>,
    /// When the route was sent last.
    sent: Option<Stamp>,
    /// The goal to which that route leads, global frame, m.
    sent_goal: Option<(f64, f64)>,
    /// Why the route of the parameters was not used.
    refused_route: Refused,
    /// Places that the vehicle could not get over, global frame, m.
    barred: Vec<Barred>,
    /// When those of them where the wheels slipped were sent last.
    slips_sent: Option<Stamp>,
    /// When it was told to save them, until it has.
    asked: Option<Stamp>,
    /// Where the wheels slipped over some metres, global frame, m.
    slippery: Vec<(f64, f64)>,
    /// How far the wheels have gripped, as images tell it.
    gripped: Gripped,
    /// Heading in the global frame, rad.
    yaw_rad: f64,
    /// Standard deviation of the vehicle's position in the global frame, m; 0 if unknown.
    error_m: f64,
    /// Position in the global frame, m.
    position: Option<(f64, f64)>,
    frame_watch: FrameWatch,
    /// Since when the planner of the near map finds no way to where the far path leads.
    no_way: Option<Stamp>,
    /// Until when it plans to a point half as far along the far path, because it had made a detour.
    nearer_until: Option<Stamp>,
    #[serde(skip)]
    given: Given,
}

/// Ports of [`WaypointGenerator`].
#[derive(Debug)]
pub struct Ports {
    path: In<PosesInFrame>,
    far_path: In<PosesInFrame>,
    transforms: In<FrameTransforms>,
    global: In<Odometry>,
    way_slip: In<rcs::WaySlip>,
    map: In<Grid>,
    registration: In<FrameTransforms>,
    modes: In<ModeEvent>,
    plan: In<rcs::Plan>,
    vehicle: In<rcs::VehicleStatus>,
    mission: In<rcs::Mission>,
    waypoints: Out<PosesInFrame>,
    goal: Out<PoseInFrame>,
    route: Out<Route>,
    slips: Out<SlipMemory>,
    driven: Out<rcs::Mission>,
    children: Children,
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
            far_path: b.optional_input(
                "far_path",
                "path of the planner of a larger map, local frame; used only with `global`",
            ),
            transforms: b.input("transforms", "the local frame in the global frame"),
            global: b.optional_input(
                "global",
                "pose of the vehicle in the global frame: its covariance, its track, and its place on `far_path`",
            ),
            way_slip: b.optional_input(
                "way_slip",
                "slip over the last metres: the route for the next run leaves out where the wheels slipped",
            ),
            map: b.optional_input("map", "a world model's map, local frame, by which the route is cut"),
            registration: b.optional_input(
                "registration",
                "the global frame of the remembered route in the local frame",
            ),
            modes: b.optional_input("modes", "changes of mode of the follower, for places that are barred"),
            plan: b.optional_input(
                "plan",
                "the planner's plan: whether there is a way to where the far path leads",
            ),
            vehicle: b.optional_input(
                "vehicle",
                "state of the vehicle; while it is held or driven by hand, the search for the goal waits",
            ),
            mission: b.operator_input(InputRole::Mission, "mission", "goals, area and zones of the operator"),
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
            slips: b
                .output("slips", "slip memory: places where the wheels slipped, UTM")
                .role(Role::Stats)
                .build(),
            driven: b
                .output("driven", "the goals, the area and the zones that are obeyed, global frame")
                .role(Role::Mission)
                .build(),
            children: Children::declare(b),
        }
    }

    fn check(params: &WaypointGeneratorParams) -> Result<(), String> {
        if !params.world.is_empty() {
            Origin::from_toml(&params.world).map_err(|error| format!("world: {error}"))?;
        }
        if !params.goal.is_empty() {
            Goal::from_toml(&params.goal).map_err(|error| format!("goal: {error}"))?;
        }
        if let Ok(origin) = Origin::from_toml(&params.world) {
            zones_of_files(params, &origin)?;
        }
        route::parse(&params.route).map_err(|error| format!("route: {error}"))?;
        slips::parse(&params.slips).map_err(|error| format!("slips: {error}"))?;
        Ok(())
    }

    fn new(_params: &WaypointGeneratorParams) -> Self {
        Self::default()
    }

    /// Where the operator has sent the vehicle is kept, with the goals that it has reached, and so is what this run hands to
    /// the next one: its way, and where its wheels slipped. Both are kept in the global frame, because the local one may
    /// begin anew.
    fn renew(&self, _params: &WaypointGeneratorParams) -> Self {
        let mut renewed = Self {
            to_tell: ToTell { init: true, goal: false },
            commanded: self.commanded,
            mission: self.mission.clone(),
            sent: self.sent,
            sent_goal: self.sent_goal,
            barred: self.barred.iter().filter(|place| place.slipped).copied().collect(),
            slips_sent: self.slips_sent,
            slippery: self.slippery.clone(),
            gripped: self.gripped.clone(),
            ..Self::default()
        };
        // Before it has driven, the way begins where the vehicle stands then.
        if self.track.len() > 1 {
            (renewed.track, renewed.way) = (self.track.clone(), self.way.clone());
            renewed.way.leave_frame();
            renewed.began = self.began;
        }
        renewed
    }

    fn init(&mut self, ports: &Ports, _params: &WaypointGeneratorParams, cx: &mut Cycle<'_>) {
        self.catch_up(ports, cx);
        ports.children.pass_on(&Order::Init, &Order::Init, false, cx);
        ports.children.await_all("initialized", cx);
    }

    fn cycle(&mut self, ports: &Ports, params: &WaypointGeneratorParams, cx: &mut Cycle<'_>) {
        self.catch_up(ports, cx);
        let own = std::iter::from_fn(|| cx.next_command::<Self>());
        let commands: Vec<WaypointGeneratorCommand> = own.collect();
        // What it remembers changes nothing for its children, and lets no vehicle drive on that stands.
        let is_ordered = cx.is_new_run() || commands.iter().any(WaypointGeneratorCommand::is_goal);
        if is_ordered {
            self.is_standing = false;
        }
        let to_follower = if self.is_standing { Order::Halt } else { Order::Run };
        if ports.children.pass_on(&Order::Run, &to_follower, is_ordered, cx) {
            self.told = None;
            self.search = None;
            self.is_halted = false;
        }
        let obeyed = self.given.fingerprint(params);
        if self.obeyed.replace(obeyed).is_some_and(|before| before != obeyed) {
            self.to_tell.goal = true;
            self.search = None;
            // It is judged anew in this cycle, and so is the goal of a command.
            self.forbidden = None;
            self.forgotten = self.forgotten.filter(|forgotten| *forgotten == remembered_of(params));
        }
        for command in commands {
            match command {
                WaypointGeneratorCommand::GoTo(goal) => self.go_to(&goal),
                WaypointGeneratorCommand::Save => self.asked = Some(cx.now()),
                WaypointGeneratorCommand::Clear => self.forget(ports, params, cx),
            }
        }
        self.take_transforms(ports, params, cx);
        let arrived = self.take_mission(ports, params, cx);
        self.take_global(ports, params, cx);
        self.take_way_slip(ports, params, cx);
        self.cut_way(ports, params, cx);
        self.take_far_path(ports, params, cx);
        while let Some(event) = cx.read(&ports.modes) {
            self.take_barred(event.barred.as_ref());
        }
        self.look_for_a_way(ports, params, cx);
        self.look_for_a_detour(ports, params, cx);
        send_waypoints(ports, params, cx);
        let stated = match self.goal(params) {
            Ok(goal) => goal,
            Err(why) => {
                self.forbid(ports, params, why.clone(), cx);
                return self.stand(ports, params, why, cx);
            }
        };
        let registration = cx.latest(&ports.registration);
        let local_from_route =
            registration.and_then(|message| route::registered(&message, &params.local_frame));
        let goal = self.found_before(params, stated, local_from_route.as_ref()).unwrap_or(stated);
        let local_from_route = local_from_route.or_else(|| self.placed_by_start(params));
        // Under a speed limit it may, however slowly; one of 0 holds the vehicle.
        let vehicle = cx.latest(&ports.vehicle);
        let held = Held::of(vehicle.as_deref(), 0.0);
        let may_drive = !self.is_standing && held == Held::Not && ports.children.may_drive(cx);
        let slowness = slowness(vehicle.as_deref());
        let goal = self.look_for_goal(params, goal, arrived, may_drive, slowness, cx.now());
        let Some((global_from_local, at)) = self.global_from_local else {
            return cx.exec("warning: the position in the global frame is not known yet, the vehicle stands");
        };
        let local = global_from_local.inverse() * goal.extend(0.0);
        let local = DVec2::new(local.x, local.y);
        let global_from_route = local_from_route.map_or(Pose::IDENTITY, |pose| global_from_local * pose);
        self.send_slips(ports, params, &global_from_route, cx);
        self.see_slide(&global_from_local, params);
        if self.jumped_m(&global_from_local) <= params.jump_m {
            self.before_jump = Some(global_from_local);
        }
        if let Some(why) = self.doubt(&global_from_local, params) {
            return self.stand(ports, params, why, cx);
        }
        self.command(ports, params, &Target { stated, goal, local, local_from_route }, cx);
        if let Some(why) = self.forbidden.clone() {
            return self.stand(ports, params, why, cx);
        }
        if std::mem::take(&mut self.is_standing) {
            ports.children.order_follower(Order::Run, cx);
        }
        self.send_route(ports, params, stated, goal, arrived, cx);
        let age_s = cx.now().seconds_since(at);
        let mut note = self.search.as_ref().map_or(String::new(), GoalSearch::note);
        note.push_str(self.unused_far_path());
        if age_s > params.transform_timeout_s {
            let old = "; the local frame in the global one is";
            note = format!("{note}{old} {age_s:.1} s old, and the goal stays where it was");
        }
        ports.children.tell(self.is_led(), &note, cx);
    }

    fn halt(&mut self, ports: &Ports, params: &WaypointGeneratorParams, cx: &mut Cycle<'_>) {
        self.catch_up(ports, cx);
        ports.children.pass_on(&Order::Halt, &Order::Halt, cx.is_new_command(), cx);
        if cx.is_new_command() {
            self.told = None;
            send_none(ports, params, cx);
        }
        ports.children.await_all("halted", cx);
    }
}

impl WaypointGeneratorCommand {
    /// Whether it states where to drive.
    fn is_goal(&self) -> bool {
        matches!(self, WaypointGeneratorCommand::GoTo(_))
    }
}

impl WaypointGenerator {
    /// Sends the children the `INIT` after which another command may have come within the same period.
    fn catch_up(&mut self, ports: &Ports, cx: &mut Cycle<'_>) {
        if std::mem::take(&mut self.to_tell.init) {
            ports.children.pass_on(&Order::Init, &Order::Init, true, cx);
        }
    }

    /// Tells the planners the goal when it has moved in the local frame, and that of the near map what lies ahead.
    fn command(
        &mut self,
        ports: &Ports,
        params: &WaypointGeneratorParams,
        target: &Target,
        cx: &mut Cycle<'_>,
    ) {
        let Some((global_from_local, _)) = self.global_from_local else { return };
        let Target { stated, goal, local, local_from_route } = *target;
        let moved_m = |told: Option<(f64, f64)>, to: DVec2| {
            told.map_or(f64::INFINITY, |told| to.distance(DVec2::from(told)))
        };
        let local_from_route = local_from_route.unwrap_or_else(|| global_from_local.inverse());
        // Where the route of the run before ends, if it ends at the goal.
        let route_end = (local_from_route * stated.extend(0.0)).truncate();
        let told = self.obeyed_goal();
        let goal_moved =
            moved_m(told, local) > params.resend_m || moved_m(self.route_told, route_end) > params.resend_m;
        // Small motions of the goal are not told.
        let local = told.filter(|_| !goal_moved).map_or(local, DVec2::from);
        let near = self.near_goal(local, &global_from_local, self.lookahead_m(params));
        let is_led_no_more = near == local && self.is_led();
        if !goal_moved && !is_led_no_more && moved_m(self.near_told, near) < LOOKAHEAD_STEP_M {
            return;
        }
        let zones = match self.allowed(params, goal) {
            Ok(zones) => zones,
            Err(why) => return self.forbid(ports, params, why, cx),
        };
        if self.is_halted {
            // The next cycle tells them the goal.
            ports.children.run_planners(cx);
            self.is_halted = false;
            self.forbidden = None;
            return;
        }
        let route = self.remembered(params, stated, &local_from_route);
        let route = self.refused_route.or_none("route", route, cx);
        let slips = self.slips_before(params, &(global_from_local * local_from_route)).unwrap_or_default();
        let barred = in_local(self.barred.iter().chain(&slips), &global_from_local);
        let local_from_global = global_from_local.inverse();
        let obeyed = zones.moved(|at| (local_from_global * at.extend(0.0)).truncate());
        let area = obeyed.area.as_ref().map(corners).unwrap_or_default();
        let keep_out = obeyed.keep_out.iter().map(|zone| PlanZone { corners: corners(zone) }).collect();
        let to = |at: DVec2, order: &PlannerGoal| PlannerGoal { x_m: at.x, y_m: at.y, ..order.clone() };
        let is_area_of_world = obeyed.is_area_of_world;
        let order = PlannerGoal { route, barred, area, is_area_of_world, keep_out, ..PlannerGoal::default() };
        let order = to(local, &order);
        // The planners would refuse it, and go on to the goal before.
        if let Err(error) = check_typed(&order) {
            let why = format!("the planners cannot be told: {error}: stands");
            return self.forbid(ports, params, why, cx);
        }
        (self.zones, self.forbidden) = (zones, None);
        let order =
            |at: DVec2| PlannerCommand::PlanTo(PlannerGoal { is_passed: at != local, ..to(at, &order) });
        cx.send(&ports.children.planner, order(near));
        self.near_told = Some((near.x, near.y));
        if goal_moved {
            cx.send(&ports.children.far_planner, order(local));
            self.told = Some((local.x, local.y));
            let global = (global_from_local * local.extend(0.0)).truncate();
            (self.told_global, self.to_tell.goal) = (global.into(), false);
            self.route_told = Some((route_end.x, route_end.y));
            let now = cx.now();
            let pose = Some(pose_message(&Pose::from_translation(local.extend(0.0))));
            let frame_id = params.local_frame.clone();
            cx.write(&ports.goal, now, PoseInFrame { timestamp: Some(now.to_proto()), frame_id, pose });
            self.send_driven(ports, params, cx);
        }
    }

    /// The planners must not go on planning to another goal.
    fn halt_planners(&mut self, ports: &Ports, cx: &mut Cycle<'_>) {
        if self.near_told.take().is_some() {
            ports.children.halt_planners(cx);
            self.is_halted = true;
        }
        self.told = None;
    }

    /// The goal is not driven to, or there is none. What is obeyed is stated all the same, once for each goal and reason.
    fn forbid(&mut self, ports: &Ports, params: &WaypointGeneratorParams, why: String, cx: &mut Cycle<'_>) {
        self.halt_planners(ports, cx);
        if self.forbidden.as_ref() == Some(&why) {
            return;
        }
        self.forbidden = Some(why);
        if let Ok(zones) = self.zones_to_obey(params) {
            self.zones = zones;
        }
        self.send_driven(ports, params, cx);
    }

    /// The vehicle stands, and nothing below drives on.
    fn stand(&mut self, ports: &Ports, params: &WaypointGeneratorParams, why: String, cx: &mut Cycle<'_>) {
        if !std::mem::replace(&mut self.is_standing, true) {
            ports.children.order_follower(Order::Halt, cx);
            // It forgets the goal.
            self.to_tell.goal = true;
        }
        send_none(ports, params, cx);
        cx.error(why);
    }

    /// The goal that the planners were told, local frame, m; `None` if they are to be told anew.
    fn obeyed_goal(&self) -> Option<(f64, f64)> {
        self.told.filter(|_| !self.to_tell.goal)
    }

    /// How far the local frame has jumped where the vehicle is, m: at a goal far away, a small correction of the heading
    /// would be metres. Without the vehicle's position, it is measured at the goal; 0 while no goal is told.
    fn jumped_m(&self, global_from_local: &Pose) -> f64 {
        let Some(before) = self.before_jump.filter(|_| self.told.is_some()) else { return 0.0 };
        let at = DVec2::from(self.position.unwrap_or(self.told_global)).extend(0.0);
        let in_local = |global_from_local: &Pose| (global_from_local.inverse() * at).truncate();
        in_local(global_from_local).distance(in_local(&before))
    }

    /// Why the vehicle should not drive on.
    fn doubt(&self, global_from_local: &Pose, params: &WaypointGeneratorParams) -> Option<String> {
        let by_m = self.jumped_m(global_from_local);
        if by_m > params.jump_m {
            return Some(format!(
                "the goal has jumped by {by_m:.1} m in the local frame: stands until it is back, RUN or another goal"
            ));
        }
        let (error_m, limit_m) = (self.error_m, params.max_error_m);
        if error_m.is_infinite() {
            return Some(
                "the variance of the position is negative, infinite or no number: stands".to_owned(),
            );
        }
        (error_m > limit_m).then(|| {
            let error_m = text_above(error_m, limit_m);
            format!("the position is known to {error_m} m, expected at most {limit_m} m: stands")
        })
    }
}

/// Where the vehicle drives to, m.
struct Target {
    /// The goal that was stated, global frame.
    stated: DVec2,
    /// The same, or a place beside it where the goal may be, global frame.
    goal: DVec2,
    /// The same in the local frame.
    local: DVec2,
    /// The global frame of the run that drove the route, as the remembered map is registered or as that run began where
    /// this one did; `None` for the estimate of this run.
    local_from_route: Option<Pose>,
}

fn corners(polygon: &Polygon) -> Vec<PlanPoint> {
    polygon.corners().map(|corner| PlanPoint { x_m: corner.x, y_m: corner.y }).collect()
}

/// Waypoints of the newest path, as soon as it arrives.
fn send_waypoints(ports: &Ports, params: &WaypointGeneratorParams, cx: &mut Cycle<'_>) {
    let Some(path) = cx.read_newest(&ports.path) else { return };
    let points = match points(&path, &params.local_frame) {
        Ok(points) => points,
        Err(why) => return cx.fault(format!("path: {why}; skipped")),
    };
    let length_m = route::length_m(&points);
    if length_m > MOST_PATH_M {
        return cx
            .fault(format!("path: it is {length_m:.0} m long, expected at most {MOST_PATH_M} m; skipped"));
    }
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
