//! Path memory: the way of this run, cut by the map, is sent near the goal, and the route of the run before is given to the
//! planners.

use super::bars::in_local;
use super::{Ports, WaypointGenerator};
use crate::map_reader::MapReader;
use crate::proto::{PlanPoint, Route, WaypointGeneratorParams};
use crate::shortcut::Way;
use crate::{route, slips};
use rcs_geom::{DVec2, Pose};
use rcs_runtime::Cycle;
use rcs_sense::{Origin, fingerprint_of_texts};

/// Time between two routes near the goal, s: at most a quarter of a metre.
const ROUTE_PERIOD_S: f64 = 0.2;
/// Distance from a goal, by the position estimate, at which its route replaces one that leads elsewhere, m, also before the
/// vehicle has arrived: a course counts its goal as reached within 1.5 m, and the estimate is off by 1.3 m.
const REACHED_M: f64 = 3.0;

/// Fingerprint of the route and the slips that the parameters give.
pub(super) fn remembered_of(params: &WaypointGeneratorParams) -> u64 {
    fingerprint_of_texts(&[&params.route, &params.slips])
}

impl WaypointGenerator {
    /// Forgets the route and the slips of the parameters, until the next start or until those give others, and the way and
    /// the slips of this run. Sends empty ones: the next run would be handed those that were sent before.
    pub(super) fn forget(&mut self, ports: &Ports, params: &WaypointGeneratorParams, cx: &mut Cycle<'_>) {
        self.forgotten = Some(remembered_of(params));
        let now = cx.now();
        (self.way, self.sent_goal) = (Way::default(), None);
        // Of the track, its last point is needed on: it says where the vehicle is.
        self.track.drain(..self.track.len().saturating_sub(1));
        self.began = self.began.and(Some(now));
        self.slippery.clear();
        self.barred.retain(|place| !place.slipped);
        // The planners are told without them.
        self.to_tell.goal = true;
        let Ok(origin) = self.given.origin(params) else { return };
        self.slips_sent = Some(now);
        cx.write(&ports.slips, now, slips::to_message(&[], &origin.0));
        cx.write(&ports.route, now, route::to_message(&[], 0.0, &origin.0, 0.0));
    }

    /// The route of an earlier run; `None` without one, and after it was told to forget it.
    pub(super) fn route_before(&mut self, params: &WaypointGeneratorParams) -> Option<&Route> {
        if self.forgotten.is_some() { None } else { self.given.route(params) }
    }

    /// Cuts the way by the map, each time that the vehicle has driven some metres.
    pub(super) fn cut_way(&mut self, ports: &Ports, params: &WaypointGeneratorParams, cx: &mut Cycle<'_>) {
        let Some((global_from_local, _)) = self.global_from_local.filter(|_| self.way.is_due()) else {
            return;
        };
        let Some(map) = cx.latest(&ports.map) else { return };
        let mut reader = MapReader::default();
        if let Err(why) = reader.read(&map, &params.local_frame) {
            return cx.fault(format!("map: {why}; the route is not cut"));
        }
        let barred = in_local(self.barred.iter(), &global_from_local);
        let to_global = |at: DVec2| (global_from_local * at.extend(0.0)).truncate();
        self.way.cut(&reader.sensed, &barred, to_global);
    }

    /// The route of the earlier run in the local frame; the error says why it does not lead to the goal (global frame, m).
    pub(super) fn remembered(
        &mut self,
        params: &WaypointGeneratorParams,
        goal: DVec2,
        local_from_route: &Pose,
    ) -> Result<Vec<PlanPoint>, String> {
        let Ok(origin) = self.given.origin(params) else { return Ok(Vec::new()) };
        let Some(route) = self.route_before(params) else { return Ok(Vec::new()) };
        let points = route::in_global(route, &origin.0, goal, params.route_goal_m);
        let points = points.map_err(|error| error.to_string())?;
        let local = points.iter().map(|point| *local_from_route * point.extend(0.0));
        Ok(local.map(|at| PlanPoint { x_m: at.x, y_m: at.y }).collect())
    }

    /// Whether the route that is remembered, of this run or else of the earlier one, leads elsewhere than to the goal
    /// (global frame, m).
    fn remembers_another(&mut self, params: &WaypointGeneratorParams, origin: &Origin, goal: DVec2) -> bool {
        let within_m = params.route_goal_m;
        if let Some(sent) = self.sent_goal {
            return goal.distance(DVec2::from(sent)) > within_m;
        }
        let before = self.route_before(params);
        before.is_some_and(|route| route::in_global(route, &origin.0, goal, within_m).is_err())
    }

    /// Sends the route while the vehicle is near the goal (global frame, m): a run ends when the goal is reached, which this
    /// process may not live to see. What is remembered is one route: one to another goal than was stated stays until this
    /// goal is reached. `arrived`: whether the planner has arrived there, as its `goal_radius_m` says.
    pub(super) fn send_route(
        &mut self,
        ports: &Ports,
        params: &WaypointGeneratorParams,
        stated: DVec2,
        goal: DVec2,
        arrived: bool,
        cx: &mut Cycle<'_>,
    ) {
        let now = cx.now();
        let (Some(began), Some(at)) = (self.began, self.position.map(DVec2::from)) else { return };
        let is_due = self.sent.is_none_or(|sent| now.seconds_since(sent) >= ROUTE_PERIOD_S);
        if !is_due || goal.distance(at) > params.route_goal_m {
            return;
        }
        let Ok(origin) = self.given.origin(params) else { return };
        let is_reached = arrived || stated.distance(at) <= REACHED_M;
        if !is_reached && self.remembers_another(params, &origin, stated) {
            return;
        }
        let track: Vec<DVec2> = self.track.iter().copied().map(DVec2::from).collect();
        let Some((global_from_local, _)) = self.global_from_local else { return };
        let has_slipped = self.has_slipped();
        let mut way = self.way.in_global(has_slipped, |at| (global_from_local * at.extend(0.0)).truncate());
        way.push(at);
        let mut way = route::cut(&way, params.same_place_m);
        slips::leave_out(&mut way, &self.slippery);
        if way.len() < 2 {
            return;
        }
        let time_s = now.seconds_since(began);
        (self.sent, self.sent_goal) = (Some(now), Some((stated.x, stated.y)));
        cx.write(&ports.route, now, route::to_message(&way, route::length_m(&track), &origin.0, time_s));
    }
}
