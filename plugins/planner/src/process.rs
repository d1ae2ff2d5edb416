//! The process `planner`: reads the map and the vehicle's pose, and sends the path. Its port table is in the crate's
//! documentation.

use crate::barred::Barred;
use crate::map_reader::MapReader;
use crate::plan::{Candidate, NoPlan, Plan, Planner, Step, Task};
use crate::proto::{PlanPoint, PlannerGoal, PlannerParams};
use crate::settings::{check_costs, rules_of};
use crate::terrain::{Past, Rules, Terms};
use crate::zones::{Polygon, Zones};
use rcs_geom::{DVec2, Pose};
use rcs_msg::Stamp;
use rcs_msg::foxglove::{Grid, PosesInFrame};
use rcs_msg::rcs::{self, PlanState};
use rcs_runtime::{Cycle, In, Msg, Out, PortBuilder, Process, ProcessDef, Role};
use rcs_sense::{Extrinsics, FrameWatch, Localizer, PosePorts, pose_message, text_above};
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// Distance from the vehicle within which some of the map must be known, m.
const KNOWN_WITHIN_M: f64 = 3.0;
/// Distance from the end of a path beside a blocked goal, m, within which the vehicle stands after this time, s.
const BESIDE_M: f64 = 1.0;
const BESIDE_S: f64 = 4.0;
/// A point of a longer path counts as reached within this distance at most, m: the vehicle is to drive past it, and not
/// to stop metres before it, however large the goal is.
const PASSED_M: f64 = 0.3;
/// Distance between the points of the track, m, and their greatest number.
const TRACK_STEP_M: f64 = 1.0;
const MOST_TRACK: usize = 300;

rcs_runtime::commands! {
    /// Commands of [`AStarPlanner`].
    pub enum PlannerCommand {
        PlanTo(PlannerGoal) = "PLAN_TO": "Plan paths to this place from now on.",
    }
}

/// State: the goal, the poses of the last seconds, and what was planned last. The map is not part of it.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct AStarPlanner {
    localizer: Localizer,
    frame_watch: FrameWatch,
    /// Local frame, m.
    goal: Option<(f64, f64)>,
    /// Whether the goal is a point of a longer path.
    is_passed: bool,
    /// A way to the goal that an earlier run has driven, local frame, m.
    route: Vec<(f64, f64)>,
    /// Places that the vehicle could not get over, local frame, m.
    barred: Vec<Barred>,
    /// Where it must not drive, local frame, m.
    zones: Zones,
    /// The path that was planned last, local frame, m.
    previous: Vec<(f64, f64)>,
    /// Where the vehicle was, local frame, m.
    track: VecDeque<(f64, f64)>,
    /// Since when the vehicle has been near the end of a path beside a goal that is inside of an obstacle.
    beside: Option<Stamp>,
    /// Sequence of the map and goal of the last plan.
    planned: Option<(u64, (f64, f64))>,
    plans: u64,
    /// Why the last goal was not taken.
    refused: Option<String>,
    /// The result of the last plan: an error, or what the path is like.
    told: Told,
    #[serde(skip)]
    memory: Memory,
}

/// The state of planning, as the status tells it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
enum Told {
    #[default]
    Nothing,
    Path(String),
    NoPath(String),
}

/// Memory that every plan overwrites: a copy begins with none.
#[derive(Debug, Default)]
struct Memory {
    planner: Planner,
    reader: MapReader,
}

impl Clone for Memory {
    fn clone(&self) -> Self {
        Memory::default()
    }
}

/// Ports of [`AStarPlanner`].
#[derive(Debug)]
pub struct Ports {
    map: In<Grid>,
    poses: PosePorts,
    path: Out<PosesInFrame>,
    plan: Out<rcs::Plan>,
}

impl Process for AStarPlanner {
    type Params = PlannerParams;
    type Ports = Ports;
    type Command = PlannerCommand;
    const DEF: ProcessDef = ProcessDef {
        plugin: "planner",
        summary: "A* planner: the cheapest path over the map to a goal, and why it is that one",
        period_ms: 50.0,
        latency_ms: 4.0,
        reads_ground_truth: false,
    };

    fn ports(b: &mut PortBuilder) -> Ports {
        Ports {
            map: b.input("map", "the world model's map: field cost, local frame"),
            poses: PosePorts::declare(b),
            path: b
                .output("path", "cells of the path from the vehicle to the goal or to the map's edge, local frame; none to stop")
                .role(Role::Path)
                .build(),
            plan: b
                .output("plan", "the path with the terms of its cost, and the cheapest path elsewhere with its")
                .role(Role::Stats)
                .build(),
        }
    }

    fn check(params: &PlannerParams) -> Result<(), String> {
        check_costs(params.costs.as_ref())
    }

    fn new(_params: &PlannerParams) -> Self {
        Self::default()
    }

    fn cycle(&mut self, ports: &Ports, params: &PlannerParams, cx: &mut Cycle<'_>) {
        let extrinsics = Extrinsics::new(params.pose.as_ref(), None);
        let has_clock_begun_again = ports.poses.read(&mut self.localizer, extrinsics.frames, cx);
        let vehicle = extrinsics.local_from_vehicle(&self.localizer, cx.now());
        let at = vehicle.as_ref().ok().map(|vehicle| vehicle.translation.truncate());
        let has_clock_begun_again = has_clock_begun_again && !extrinsics.fixed_pose;
        if let Some(why) = self.frame_watch.begins_again(has_clock_begun_again, at, cx.now()) {
            self.forget_driven(&why, cx);
        }
        let mut is_newly_refused = false;
        while let Some(command) = cx.next_command::<Self>() {
            let PlannerCommand::PlanTo(goal) = command;
            let to = DVec2::new(goal.x_m, goal.y_m);
            self.beside =
                self.beside.filter(|_| self.goal.is_some_and(|at| to.distance(at.into()) < BESIDE_M));
            self.goal = Some((goal.x_m, goal.y_m));
            self.is_passed = goal.is_passed;
            self.route = goal.route.iter().map(|point| (point.x_m, point.y_m)).collect();
            self.barred = goal.barred.iter().map(Barred::from).collect();
            match zones(&goal) {
                Ok(zones) => (self.zones, self.refused) = (zones, None),
                // What cannot be understood must not be driven through.
                Err(why) => {
                    self.goal = None;
                    self.refused = Some(format!("PLAN_TO: {why}"));
                }
            }
            is_newly_refused = self.refused.is_some();
            self.planned = None;
        }
        if let Some(why) = self.refused.clone() {
            if is_newly_refused {
                return self.stop(ports, params, why, cx);
            }
            return cx.error(why);
        }
        let Some(goal) = self.goal else {
            cx.exec("waits for a goal");
            return;
        };
        let now = cx.now();
        let Some(map) = cx.latest(&ports.map) else {
            cx.exec("waits for a map");
            return;
        };
        let vehicle = match vehicle {
            Ok(vehicle) => vehicle,
            Err(error) => {
                self.planned = None;
                return self.stop(ports, params, format!("pose: {error}"), cx);
            }
        };
        let age_s = now.seconds_since(map.acq_time_on_arrival());
        if age_s > params.map_timeout_s {
            let limit_s = params.map_timeout_s;
            let age_s = text_above(age_s, limit_s);
            self.planned = None;
            return self.stop(
                ports,
                params,
                format!("the map is {age_s} s old, expected at most {limit_s} s"),
                cx,
            );
        }
        let goal_m = vehicle.translation.truncate().distance(DVec2::from(goal));
        if goal_m <= self.goal_radius_m(params) {
            self.planned = None;
            self.send_none(ports, params, PlanState::PlanAtGoal, "the vehicle is at the goal", cx);
            cx.done("at the goal");
            return;
        }
        let key = (map.header().sequence, goal);
        if self.planned != Some(key) {
            self.planned = Some(key);
            self.plan(ports, params, &map, &vehicle, cx);
        }
        match &self.told {
            Told::Nothing => cx.exec("plans"),
            Told::Path(text) => cx.exec(text.clone()),
            Told::NoPath(text) => cx.error(text.clone()),
        }
    }

    fn halt(&mut self, ports: &Ports, params: &PlannerParams, cx: &mut Cycle<'_>) {
        if cx.is_new_command() {
            self.goal = None;
            self.beside = None;
            self.refused = None;
            self.planned = None;
            self.send_none(ports, params, PlanState::PlanNone, "halted", cx);
        }
        cx.done("halted");
    }
}

impl AStarPlanner {
    /// The distance at which what is planned to counts as reached, m.
    fn goal_radius_m(&self, params: &PlannerParams) -> f64 {
        if self.is_passed { params.goal_radius_m.min(PASSED_M) } else { params.goal_radius_m }
    }

    /// What was planned and driven lies elsewhere now. The goal stays: who knows where it is tells it again.
    fn forget_driven(&mut self, why: &str, cx: &mut Cycle<'_>) {
        self.previous.clear();
        self.track.clear();
        (self.beside, self.planned) = (None, None);
        cx.fault(format!("{why}; the path and the track before are forgotten"));
    }

    fn plan(
        &mut self,
        ports: &Ports,
        params: &PlannerParams,
        map: &Msg<Grid>,
        vehicle: &Pose,
        cx: &mut Cycle<'_>,
    ) {
        let local = Extrinsics::new(params.pose.as_ref(), None).frames.local;
        if let Err(error) = self.memory.reader.read(map, local) {
            cx.fault(format!("map: {error}"));
            return self.stop(ports, params, format!("the map cannot be used: {error}"), cx);
        }
        let known = self.memory.reader.sensed.known_share(vehicle.translation.truncate(), KNOWN_WITHIN_M);
        if known < params.least_known {
            let (known, least) = (known * 100.0, params.least_known * 100.0);
            let why = format!(
                "{known:.1} % of the map within {KNOWN_WITHIN_M} m is known, expected at least {least:.1} %"
            );
            return self.stop(ports, params, why, cx);
        }
        let goal = DVec2::from(self.goal.unwrap_or_default());
        self.take_position(vehicle);
        let route: Vec<DVec2> = self.route.iter().copied().map(DVec2::from).collect();
        let previous: Vec<DVec2> = self.previous.drain(..).map(DVec2::from).collect();
        let track: Vec<DVec2> = self.track.iter().copied().map(DVec2::from).collect();
        let task = Task {
            sensed: &self.memory.reader.sensed,
            vehicle,
            goal,
            approach_m: params.approach_m.max(self.goal_radius_m(params)),
            is_passed: self.is_passed,
            past: Past {
                route: &route,
                previous: &previous,
                track: &track,
                barred: &self.barred,
                zones: Some(&self.zones),
            },
            alternative_m: params.alternative_m,
        };
        self.plans += 1;
        let plan = self.memory.planner.plan(&task, &rules(params));
        let stands = self.stands_beside(plan.as_ref().ok(), vehicle, params, cx.now());
        match plan {
            Ok(_) if stands => {
                let left_m = vehicle.translation.truncate().distance(goal);
                let why = format!("the goal is inside of an obstacle: stands {left_m:.1} m beside it");
                self.stop_for(ports, params, PlanState::PlanGoalBlocked, why, cx);
            }
            Ok(plan) => self.send(ports, params, goal, &plan, cx),
            Err(error @ NoPlan::GoalBlocked { .. }) => {
                self.stop_for(ports, params, PlanState::PlanGoalBlocked, error.to_string(), cx);
            }
            Err(error @ NoPlan::NoPath(_)) => {
                self.stop_for(ports, params, PlanState::PlanNoWay, error.to_string(), cx);
            }
            Err(error @ NoPlan::Forbidden) => {
                self.stop_for(ports, params, PlanState::PlanForbidden, error.to_string(), cx);
            }
            Err(error @ (NoPlan::Map(_) | NoPlan::OffTheMap(_))) => {
                cx.fault(error.to_string());
                self.stop(ports, params, error.to_string(), cx);
            }
            Err(error) => self.stop(ports, params, error.to_string(), cx),
        }
    }

    /// Whether the vehicle stands beside a goal that is inside of an obstacle: at the end of the path, or near it for some
    /// seconds, because it cannot get closer.
    fn stands_beside(
        &mut self,
        plan: Option<&Plan>,
        vehicle: &Pose,
        params: &PlannerParams,
        now: Stamp,
    ) -> bool {
        let position = vehicle.translation.truncate();
        let radius_m = self.goal_radius_m(params);
        let beside = plan.filter(|plan| plan.short_of_goal_m > radius_m);
        let end = beside.and_then(|plan| plan.chosen.steps.last());
        let end_m = end.map_or(f64::INFINITY, |step| step.at.distance(position));
        if end_m > BESIDE_M {
            self.beside = None;
            return false;
        }
        let since = *self.beside.get_or_insert(now);
        end_m <= radius_m || now.seconds_since(since) >= BESIDE_S
    }

    /// Adds the vehicle's position to the track.
    fn take_position(&mut self, vehicle: &Pose) {
        let at = vehicle.translation.truncate();
        if self.track.back().is_none_or(|&last| at.distance(DVec2::from(last)) >= TRACK_STEP_M) {
            self.track.push_back((at.x, at.y));
        }
        if self.track.len() > MOST_TRACK {
            self.track.pop_front();
        }
    }

    fn send(&mut self, ports: &Ports, params: &PlannerParams, goal: DVec2, plan: &Plan, cx: &mut Cycle<'_>) {
        let now = cx.now();
        let local = Extrinsics::new(params.pose.as_ref(), None).frames.local;
        let reason = plan.reason();
        let chosen = &plan.chosen;
        self.previous = chosen.steps.iter().map(|step| (step.at.x, step.at.y)).collect();
        let mut points: Vec<DVec2> = chosen.steps.iter().map(|step| step.at).collect();
        // On coarse cells, the goal may not be reached in the middle of its cell.
        let sensed = &self.memory.reader.sensed;
        let radius_m = self.goal_radius_m(params);
        let ends_beside = points
            .last()
            .is_some_and(|&end| sensed.place(end) == sensed.place(goal) && end.distance(goal) > radius_m);
        if ends_beside {
            points.push(goal);
        }
        let path = PosesInFrame {
            timestamp: Some(now.to_proto()),
            frame_id: local.to_owned(),
            poses: along(&points).map(|pose| pose_message(&pose)).collect(),
        };
        cx.write(&ports.path, now, path);
        let message = rcs::Plan {
            timestamp: Some(now.to_proto()),
            frame_id: local.to_owned(),
            goal_x_m: goal.x,
            goal_y_m: goal.y,
            chosen: Some(candidate(chosen)),
            rejected: plan.rejected.as_ref().map(candidate),
            reason: reason.clone(),
            expanded: plan.expanded,
            plans: self.plans,
            state: PlanState::PlanPath.into(),
        };
        cx.write(&ports.plan, now, message);
        let beside = plan.short_of_goal_m;
        let blocked = if beside > 0.0 {
            format!("the goal is blocked, plans to {beside:.1} m beside it; ")
        } else {
            String::new()
        };
        self.told = Told::Path(format!("{blocked}path of {:.1} m; {reason}", chosen.length_m));
    }

    /// No path may be driven, and why.
    fn stop(&mut self, ports: &Ports, params: &PlannerParams, why: String, cx: &mut Cycle<'_>) {
        self.stop_for(ports, params, PlanState::PlanUnusable, why, cx);
    }

    fn stop_for(
        &mut self,
        ports: &Ports,
        params: &PlannerParams,
        state: PlanState,
        why: String,
        cx: &mut Cycle<'_>,
    ) {
        self.send_none(ports, params, state, &why, cx);
        cx.error(why.clone());
        self.told = Told::NoPath(why);
    }

    /// Sends a path without poses, so that nobody follows the one before.
    fn send_none(
        &self,
        ports: &Ports,
        params: &PlannerParams,
        state: PlanState,
        why: &str,
        cx: &mut Cycle<'_>,
    ) {
        let now = cx.now();
        let frame_id = Extrinsics::new(params.pose.as_ref(), None).frames.local.to_owned();
        let timestamp = Some(now.to_proto());
        cx.write(&ports.path, now, PosesInFrame { timestamp, frame_id: frame_id.clone(), poses: Vec::new() });
        let (goal_x_m, goal_y_m) = self.goal.unwrap_or_default();
        let plans = self.plans;
        let plan = rcs::Plan {
            timestamp,
            frame_id,
            goal_x_m,
            goal_y_m,
            reason: why.to_owned(),
            plans,
            state: state.into(),
            ..Default::default()
        };
        cx.write(&ports.plan, now, plan);
    }
}

/// The points of a path as poses that look along it.
fn along(points: &[DVec2]) -> impl Iterator<Item = Pose> {
    (0..points.len()).map(|at| {
        let (from, to) = if at + 1 < points.len() { (at, at + 1) } else { (at.saturating_sub(1), at) };
        let direction = points[to] - points[from];
        let yaw_rad = if direction == DVec2::ZERO { 0.0 } else { libm::atan2(direction.y, direction.x) };
        Pose::from_xy_yaw(points[at].x, points[at].y, yaw_rad)
    })
}

fn candidate(candidate: &Candidate) -> rcs::PlanCandidate {
    let step = |step: &Step| rcs::PlanStep {
        x_m: step.at.x as f32,
        y_m: step.at.y as f32,
        cost: step.cost as f32,
        terms: Some(terms(&step.terms)),
    };
    rcs::PlanCandidate {
        steps: candidate.steps.iter().map(step).collect(),
        length_m: candidate.length_m,
        cost: candidate.cost,
        terms: Some(terms(&candidate.terms)),
        beyond_cost: candidate.beyond_cost,
    }
}

fn terms(terms: &Terms) -> rcs::PlanTerms {
    let Terms { terrain, clearance, heading, relief, memory, previous } = *terms;
    rcs::PlanTerms { terrain, clearance, heading, relief, memory, previous }
}

/// The zones of a goal.
fn zones(goal: &PlannerGoal) -> Result<Zones, String> {
    let polygon =
        |corners: &[PlanPoint]| Polygon::new(corners.iter().map(|corner| DVec2::new(corner.x_m, corner.y_m)));
    let area = (!goal.area.is_empty()).then(|| polygon(&goal.area)).transpose();
    let keep_out = goal.keep_out.iter().map(|zone| polygon(&zone.corners)).collect::<Result<_, _>>();
    Ok(Zones {
        area: area.map_err(|error| format!("area: {error}"))?,
        is_area_of_world: goal.is_area_of_world,
        keep_out: keep_out.map_err(|error| format!("keep_out: {error}"))?,
    })
}

fn rules(params: &PlannerParams) -> Rules {
    Rules {
        far_room_m: params.far_room_m,
        near_m: params.near_m,
        narrow: f64::from(params.narrow_cost),
        sure_m: if params.sure_m > 0.0 { params.sure_m } else { f64::INFINITY },
        unsure: params.unsure_cost as u8,
        unknown_near: params.unknown_near_cost as u8,
        heading: params.heading_preference,
        heading_range_m: params.heading_range_m,
        relief_range_m: params.relief_range_m,
        relief_cost: params.relief_cost as u8,
        slipped: params.slipped_factor,
        route: params.route_preference,
        route_range_m: params.route_range_m,
        previous: params.previous_preference,
        previous_range_m: params.previous_range_m,
        ..rules_of(params.costs.as_ref())
    }
}
