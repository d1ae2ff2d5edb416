//! Path memory: the way of this run, cut by the map, is sent near the goal, and the route of the run before is given to the
//! planners.

use super::bars::in_local;
use super::{Ports, WaypointGenerator};
use crate::map_reader::MapReader;
use crate::proto::{PlanPoint, WaypointGeneratorParams};
use crate::{route, slips};
use rcs_geom::{DVec2, Pose};
use rcs_runtime::Cycle;

/// Time between two routes near the goal, s: at most a quarter of a metre.
const ROUTE_PERIOD_S: f64 = 0.2;

impl WaypointGenerator {
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

    /// The route of the parameters in the local frame, if it leads to the goal (global frame, m).
    pub(super) fn remembered(
        &mut self,
        params: &WaypointGeneratorParams,
        goal: DVec2,
        local_from_route: &Pose,
    ) -> Vec<PlanPoint> {
        self.refused_route = None;
        let Ok(origin) = self.given.origin(params) else { return Vec::new() };
        let Some(route) = self.given.route(params) else { return Vec::new() };
        match route::in_global(route, &origin.0, goal, params.route_goal_m) {
            Ok(points) => {
                let local = points.iter().map(|point| *local_from_route * point.extend(0.0));
                local.map(|at| PlanPoint { x_m: at.x, y_m: at.y }).collect()
            }
            Err(error) => {
                self.refused_route = Some(error.to_string());
                Vec::new()
            }
        }
    }

    /// Sends the route while the vehicle is near the goal (global frame, m): a run ends when the goal is reached, which this
    /// process may not live to see.
    pub(super) fn send_route(
        &mut self,
        ports: &Ports,
        params: &WaypointGeneratorParams,
        goal: DVec2,
        cx: &mut Cycle<'_>,
    ) {
        let now = cx.now();
        let (Some(began), Some(at)) = (self.began, self.position.map(DVec2::from)) else { return };
        let is_due = self.sent.is_none_or(|sent| now.seconds_since(sent) >= ROUTE_PERIOD_S);
        if !is_due || goal.distance(at) > params.route_goal_m {
            return;
        }
        let Ok(origin) = self.given.origin(params) else { return };
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
        self.sent = Some(now);
        cx.write(&ports.route, now, route::to_message(&way, route::length_m(&track), &origin.0, time_s));
    }
}
