//! Places that the waypoint generator bars for the rest of the run: the vehicle could not get over them, or does not get
//! there. Where the wheels slipped, they are barred in the next run, too.

use super::{Ports, WaypointGenerator};
use crate::barred::{Barred, grown, is_covered, turned_on_the_spot};
use crate::proto::{BarredPlace, WaypointGeneratorParams};
use crate::slips;
use rcs_geom::{DVec2, DVec3, Pose};
use rcs_msg::rcs::PlanState;
use rcs_runtime::Cycle;
use rcs_sense::{is_slippery, pose_of};

/// Time after which it is believed that there is no way on the near map to where the far path leads, s.
const NO_WAY_S: f64 = 1.0;
/// Time between two messages with the places where wheels slipped, s.
const SLIPS_PERIOD_S: f64 = 1.0;
/// Distance between two places where the wheels slipped over some metres, m.
const SLIPPERY_STEP_M: f64 = 0.5;

impl WaypointGenerator {
    /// Bars a place of the far path to which the planner of the near map finds no way, or which lies inside
    /// of an obstacle: the near map shows better what is there, and the far planner looks for another way.
    pub(super) fn look_for_a_way(
        &mut self,
        ports: &Ports,
        params: &WaypointGeneratorParams,
        cx: &mut Cycle<'_>,
    ) {
        let led = self.near_told.filter(|_| !self.is_standing && self.near_told != self.told);
        let plan = cx.latest(&ports.plan);
        // Also where obstacles that the far map does not show leave only a way through a zone.
        let closed = [PlanState::PlanNoWay, PlanState::PlanForbidden];
        let is_closed = plan.as_ref().is_some_and(|plan| closed.contains(&plan.state()));
        let is_blocked = plan.is_some_and(|plan| {
            plan.state() == PlanState::PlanGoalBlocked && Some((plan.goal_x_m, plan.goal_y_m)) == led
        });
        let Some(led) = led.filter(|_| (is_closed || is_blocked) && params.no_way_bars_m > 0.0) else {
            self.no_way = None;
            return;
        };
        let now = cx.now();
        if now.seconds_since(*self.no_way.get_or_insert(now)) < NO_WAY_S {
            return;
        }
        self.no_way = None;
        let Some((global_from_local, _)) = self.global_from_local else { return };
        let half_way = || self.along_far_path(&global_from_local, params.lookahead_m / 2.0);
        let at = if is_blocked { Some(DVec2::from(led)) } else { half_way() };
        let Some(at) = at else { return };
        let goal_m = self.told.map_or(f64::INFINITY, |goal| at.distance(DVec2::from(goal)));
        if goal_m > params.no_way_bars_m + 1.0 {
            let place = BarredPlace { x_m: at.x, y_m: at.y, radius_m: params.no_way_bars_m, slipped: false };
            self.take_barred(Some(&place));
        }
    }

    /// Notes where the wheels slipped over some metres, and how far they have gripped.
    pub(super) fn take_way_slip(
        &mut self,
        ports: &Ports,
        params: &WaypointGeneratorParams,
        cx: &mut Cycle<'_>,
    ) {
        while let Some(report) = cx.read(&ports.way_slip) {
            match pose_of(report.middle.as_ref(), &params.local_frame) {
                Ok(middle) => {
                    self.gripped.take(&report, middle.translation.truncate());
                    if !is_slippery(&report) {
                        continue;
                    }
                    let Some((global_from_local, _)) = self.global_from_local else { continue };
                    let at = (global_from_local * middle.translation).truncate();
                    let is_new = |last: &(f64, f64)| at.distance(DVec2::from(*last)) >= SLIPPERY_STEP_M;
                    if self.slippery.last().is_none_or(is_new) {
                        self.slippery.push((at.x, at.y));
                    }
                }
                Err(error) => cx.fault(format!("way_slip: {error}; skipped")),
            }
        }
    }

    /// Bars a place, local frame.
    pub(super) fn take_barred(&mut self, place: Option<&BarredPlace>) {
        let Some((place, (global_from_local, _))) = place.zip(self.global_from_local) else { return };
        let at = global_from_local * DVec3::new(place.x_m, place.y_m, 0.0);
        let vehicle = self.track.last().map_or(at.truncate(), |&last| DVec2::from(last));
        let place = Barred { at: (at.x, at.y), ..Barred::from(place) };
        if self.bar(place, vehicle) {
            // The planners are told with the goal.
            self.to_tell.goal = true;
        }
    }

    /// Bars a place, given the vehicle's position, both in the global frame, m; `false` if that changes nothing.
    fn bar(&mut self, place: Barred, vehicle: DVec2) -> bool {
        let is_new = !is_covered(&place, vehicle, &self.barred);
        if is_new {
            self.barred.push(grown(place, vehicle, &self.barred));
        }
        is_new
    }

    /// Takes a jump of the local frame that follows from wheels that turned on the spot for what it is. Where
    /// images say that the wheels have gripped, the fixes have jumped.
    pub(super) fn see_slide(&mut self, global_from_local: &Pose, params: &WaypointGeneratorParams) {
        if self.jumped_m(global_from_local) <= params.jump_m {
            return;
        }
        let track: Vec<DVec2> = self.track.iter().copied().map(DVec2::from).collect();
        let Some((at, rolled_m)) = turned_on_the_spot(&track) else { return };
        if self.gripped.covers(rolled_m) {
            return;
        }
        // What the wheels measured was no way.
        self.track.truncate(at + 1);
        self.track.push((track[track.len() - 1].x, track[track.len() - 1].y));
        self.way.back_to(track[at]);
        if let Some(&at) = self.track.last() {
            self.bar_ahead(DVec2::from(at), params);
        }
    }

    /// Bars the place ahead of a position in the global frame, m: the wheels turned there, and the vehicle did not move.
    pub(super) fn bar_ahead(&mut self, at: DVec2, params: &WaypointGeneratorParams) {
        self.told = None;
        if params.slide_bars_m > 0.0 {
            let vehicle = Pose::from_xy_yaw(at.x, at.y, self.yaw_rad);
            let place = Barred::ahead(&vehicle, params.front_m, params.slide_bars_m);
            self.bar(place, at);
        }
    }

    /// The places where the wheels of the run before slipped, global frame, as its frame is placed now, without those that
    /// this run has driven over.
    pub(super) fn slips_before(
        &mut self,
        params: &WaypointGeneratorParams,
        global_from_route: &Pose,
    ) -> Result<Vec<Barred>, String> {
        if self.forgotten.is_some() {
            return Ok(Vec::new());
        }
        let Ok(origin) = self.given.origin(params) else { return Ok(Vec::new()) };
        let Some(before) = self.given.slips(params) else { return Ok(Vec::new()) };
        let mut places = slips::in_global(before, &origin.0).map_err(|error| error.to_string())?;
        for place in &mut places {
            let at = *global_from_route * DVec2::from(place.at).extend(0.0);
            place.at = (at.x, at.y);
        }
        places.retain(|place| !slips::was_driven_over(place, &self.track, &self.slippery));
        Ok(places)
    }

    /// Sends where the wheels slipped in this run and in the one before, for the next one.
    pub(super) fn send_slips(
        &mut self,
        ports: &Ports,
        params: &WaypointGeneratorParams,
        global_from_route: &Pose,
        cx: &mut Cycle<'_>,
    ) {
        let now = cx.now();
        let is_recent = self.slips_sent.is_some_and(|sent| now.seconds_since(sent) < SLIPS_PERIOD_S);
        if is_recent && self.asked.is_none() {
            return;
        }
        let Ok(origin) = self.given.origin(params) else { return };
        let before = self.slips_before(params, global_from_route);
        let mut places = self.refused_slips.or_none("slips", before, cx);
        places.extend(self.barred.iter().filter(|place| place.slipped));
        if self.asked.take().is_some() || !places.is_empty() || self.slips_sent.is_some() {
            self.slips_sent = Some(now);
            cx.write(&ports.slips, now, slips::to_message(&places, &origin.0));
        }
    }
}

/// Barred places of the global frame in the local one.
pub(super) fn in_local<'a>(
    places: impl Iterator<Item = &'a Barred>,
    global_from_local: &Pose,
) -> Vec<BarredPlace> {
    let local_from_global = global_from_local.inverse();
    let place = |barred: &Barred| {
        let at = local_from_global * DVec2::from(barred.at).extend(0.0);
        Barred { at: (at.x, at.y), ..*barred }.into()
    };
    places.map(place).collect()
}
