//! Where the waypoint generator sends the vehicle: the goal of the file, of a command, or of the operator's mission, and
//! where it must not drive.

use super::{Ports, WaypointGenerator};
use crate::goal::Goal;
use crate::goal_search::{GoalSearch, Scene};
use crate::mission::Mission;
use crate::proto::{UtmGoal, WaypointGeneratorParams};
use crate::route;
use crate::zones::Zones;
use rcs_geom::{DVec2, Pose};
use rcs_msg::Stamp;
use rcs_runtime::{ChildReport, ChildState, Cycle};
use rcs_sense::Origin;

/// Where an earlier run found the goal is not believed farther than this from where the position estimate puts it, m: the
/// remembered map may lie in a wrong place.
const FOUND_WITHIN_M: f64 = 3.0;
/// What that place counts beside the estimate of this run. Their errors are independent and about as large: the run before
/// ended somewhere on the border of the goal, up to 1.5 m from its middle, and the estimate is off by 1.3 m.
const FOUND_SHARE: f64 = 0.55;
/// The search for the goal begins this near to where it is believed to be, m: the vehicle need not stop there first.
const SEARCH_FROM_M: f64 = 0.8;
/// It ends when the vehicle is farther away than this, as after it was driven by hand, m.
const SEARCH_TO_M: f64 = 10.0;

impl WaypointGenerator {
    /// Reads the operator's missions, each of which may state goals, zones or both, and goes on to the next goal. Whether the
    /// vehicle has arrived where it was told to drive; not where another goal of the mission is stated from now on.
    pub(super) fn take_mission(
        &mut self,
        ports: &Ports,
        params: &WaypointGeneratorParams,
        cx: &mut Cycle<'_>,
    ) -> bool {
        // Until the local frame is known, the messages wait.
        while let Some((global_from_local, _)) = self.global_from_local
            && let Some(message) = cx.read(&ports.mission)
        {
            let mission = match message.frame_id.as_str() {
                frame if frame == params.global_frame => Mission::of(&message, &Pose::IDENTITY),
                frame if frame == params.local_frame => Mission::of(&message, &global_from_local),
                frame => {
                    let expected = (&params.global_frame, &params.local_frame);
                    Err(format!("frame is {frame:?}, expected one of {expected:?}"))
                }
            };
            match mission {
                Ok(mission) => self.obey_mission(mission),
                Err(why) => cx.fault(format!("mission: {why}; not taken")),
            }
        }
        // A planner that the operator has halted is done, too.
        let is_there = |child: ChildReport| child.state == ChildState::Done && child.obeys_another.is_none();
        let arrived = cx.child(&ports.children.planner).is_some_and(is_there);
        let arrived = arrived && !self.is_led() && self.obeyed_goal().is_some();
        if let Some(reached) = self.mission.goal().filter(|_| arrived)
            && self.mission.arrive()
        {
            // Once the next goal is stated, the route to this one is not sent any more.
            self.send_route(ports, params, reached, reached, arrived, cx);
            self.told = None;
            self.send_driven(ports, params, cx);
            return false;
        }
        arrived
    }

    /// Drives to a goal of the operator's from this cycle on, and to none of the mission's.
    pub(super) fn go_to(&mut self, goal: &UtmGoal) {
        self.commanded = Some((goal.zone as u8, goal.easting_m, goal.northing_m));
        self.mission.goals = None;
        self.search = None;
        self.told = None;
        self.forbidden = None;
    }

    /// The planners are told the mission in this cycle. Another goal ends a hold after a jump of the local frame; zones alone
    /// do not.
    fn obey_mission(&mut self, mission: Mission) {
        if mission.goals.is_some() {
            self.told = None;
        }
        self.to_tell.goal = true;
        self.search = None;
        // It is judged anew in this cycle.
        self.forbidden = None;
        self.mission.take(mission);
    }

    /// Searches for the goal of the file, believed to be here (global frame, m), from the first arrival there on, given
    /// whether the vehicle has arrived where it was told to drive, whether it may drive, and how fast. Where it drives
    /// to.
    pub(super) fn look_for_goal(
        &mut self,
        params: &WaypointGeneratorParams,
        goal: DVec2,
        arrived: bool,
        may_drive: bool,
        slowness: f64,
        now: Stamp,
    ) -> DVec2 {
        let within_m = params.found_within_m;
        let is_told = within_m > 0.0 && self.mission.goals.is_none() && self.commanded.is_none();
        let is_near = |at: &DVec2| self.search.is_none() || at.distance(goal) <= SEARCH_TO_M;
        let Some(at) = self.position.map(DVec2::from).filter(|at| is_told && is_near(at)) else {
            self.search = None;
            return goal;
        };
        let begins = arrived || at.distance(goal) < SEARCH_FROM_M;
        if self.search.is_none() && !begins {
            return goal;
        }
        // Those that are obeyed from this cycle on. Where they cannot be read, the planners are told nothing.
        let Ok(zones) = self.zones_to_obey(params) else { return goal };
        let (vehicle, track, zones) = ((at, self.yaw_rad), &self.track, &zones);
        let scene = Scene { goal, vehicle, track, within_m, zones, slowness };
        let has_changed = if let Some(search) = &mut self.search {
            if !may_drive {
                search.wait(now);
            }
            search.go_on(&scene, arrived, now)
        } else {
            self.search = Some(GoalSearch::begin(&scene, now));
            true
        };
        if has_changed {
            self.to_tell.goal = true;
        }
        self.search.as_ref().and_then(GoalSearch::target).unwrap_or(goal)
    }

    /// Says what is driven and obeyed.
    pub(super) fn send_driven(&self, ports: &Ports, params: &WaypointGeneratorParams, cx: &mut Cycle<'_>) {
        let mission = Mission { zones: self.zones.clone(), ..self.mission.clone() };
        let now = cx.now();
        cx.write(&ports.driven, now, mission.to_message(now, &params.global_frame));
    }

    /// The zones of the files and of the operator, global frame, m.
    pub(super) fn zones_to_obey(&mut self, params: &WaypointGeneratorParams) -> Result<Zones, String> {
        let mut zones = self.given.zones(params)?;
        zones.keep_out.extend(self.mission.zones.keep_out.iter().cloned());
        if let Some(area) = &self.mission.zones.area {
            (zones.area, zones.is_area_of_world) = (Some(area.clone()), false);
        }
        Ok(zones)
    }

    /// The zones of the files and of the operator, global frame, m, unless the goal (global frame, m) lies in one.
    pub(super) fn allowed(&mut self, params: &WaypointGeneratorParams, goal: DVec2) -> Result<Zones, String> {
        let zones = self.zones_to_obey(params)?;
        if zones.forbid(goal) {
            let by_m = zones.trespass_m(goal);
            let is_outside = zones.area.as_ref().is_some_and(|area| !area.contains(goal));
            let place = if is_outside { "outside of the area" } else { "inside of a keep-out zone" };
            let name = self.mission.goal_name();
            return Err(format!("{name} lies {by_m:.1} m {place}: stands"));
        }
        Ok(zones)
    }

    /// Where the goal of the file (global frame, m) is, by where the run before found it, as the remembered map is
    /// registered, and by the position estimate of this run. Only where somebody says that the goal is reached: else
    /// each run would end a little farther away from it.
    pub(super) fn found_before(
        &mut self,
        params: &WaypointGeneratorParams,
        goal: DVec2,
        local_from_route: Option<&Pose>,
    ) -> Option<DVec2> {
        let is_told = params.found_within_m > 0.0;
        if !is_told || self.mission.goals.is_some() || self.commanded.is_some() {
            return None;
        }
        let (local_from_route, (global_from_local, _)) = local_from_route.zip(self.global_from_local)?;
        let origin = self.given.origin(params).ok()?;
        let points =
            route::in_global(self.route_before(params)?, &origin.0, goal, params.route_goal_m).ok()?;
        let finish = global_from_local * (*local_from_route * route::finish(&points)?.extend(0.0));
        let finish = finish.truncate();
        let place = goal.lerp(finish, FOUND_SHARE);
        // That run may have come closer to a zone or to the border of the area than this one may.
        let is_believed = finish.distance(goal) <= FOUND_WITHIN_M && self.allowed(params, place).is_ok();
        is_believed.then_some(place)
    }

    /// The goal in the global frame, m.
    pub(super) fn goal(&mut self, params: &WaypointGeneratorParams) -> Result<DVec2, String> {
        if self.mission.goals.is_some() {
            return self.mission.goal().ok_or_else(|| "the mission has no goals: stands".to_owned());
        }
        let goal = match self.commanded {
            Some((zone, easting_m, northing_m)) => Goal { zone: Some(zone), easting_m, northing_m },
            None => self.given.goal(params)?,
        };
        goal.in_global(&self.given.origin(params)?.0).map_err(|error| error.to_string())
    }
}

/// The zones of goal file and world file, global frame, m.
pub(super) fn zones_of_files(params: &WaypointGeneratorParams, origin: &Origin) -> Result<Zones, String> {
    Zones::from_toml(&params.goal, &params.world, &origin.0, params.area_margin_m)
}
