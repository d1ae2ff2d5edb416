//! The process `map_memory`: a world model's map of an earlier run, registered against this one, and the map to save. Its
//! port table is in the crate's documentation.

mod jump;
mod output;
mod own;
mod track;

use self::own::Own;
use self::track::MOST_TRACK;
use crate::memory::{Rectangle, by_shape, parse};
use crate::proto::{MapMemory, MapMemoryParams};
use crate::register::{Fit, FromParams, Placed, Remembered, Seen, at, moved_m, turned};
use crate::saved::Kept;
use rcs_geom::{DVec2, Pose};
use rcs_msg::Stamp;
use rcs_msg::foxglove::{FrameTransforms, Grid, Odometry};
use rcs_msg::rcs::{Plan, PlanState};
use rcs_runtime::{Cycle, In, Msg, Out, PortBuilder, Process, ProcessDef, Role};
use rcs_sense::{FrameWatch, GridFrame, Localizer, Origin, fingerprint_of_texts};
use rcs_world::{GridView, fuse_grid};
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// Support that a metre of motion from where the position estimate puts the remembered map must gain.
const WORTH: f64 = 0.05;
/// A registered map lies in a wrong place where another one has had this much more support for this many messages in
/// turn: few things are in sight when it is registered first.
const CLEARLY: f64 = 0.15;
const IN_TURN: u32 = 4;
/// A map is believed that fits in the same place for as many messages in turn: few things are in sight when it is
/// registered first, and may lie on others by chance. Greatest distance of what is the same place, m.
const SAME_PLACE_M: f64 = 1.0;
/// A registered map is believed until its agreement falls below this share of the one that it needed.
const DOUBT: f64 = 0.7;
/// A remembered map that begins farther away than this, m, is that of another place: nothing of it is in sight.
const ELSEWHERE_M: f64 = 100.0;
/// Time without a way to the goal after which the remembered map is not believed any more, s.
const NO_WAY_S: f64 = 5.0;
/// A goal farther than this from the one before is another one, m: the estimate of the position moves one by less.
const ANOTHER_GOAL_M: f64 = 5.0;

/// State: the frames, the track, where the remembered map lies, and what was sent when.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct MapMemoryKeeper {
    frames: Localizer,
    /// Why the remembered map is not used until the next start, another map or another goal, if so.
    dropped: Option<String>,
    /// The goal to which it leaves no way, global frame, m, if that is the reason.
    closed_to: Option<DVec2>,
    /// Since when the plan has found no way with the remembered map.
    no_way: Option<Stamp>,
    /// Where the vehicle was, local frame, m.
    track: Vec<DVec2>,
    /// The newest points of the track, also those that it has no room for.
    recent: VecDeque<DVec2>,
    /// Follows the vehicle where it has not leapt to.
    frame_watch: FrameWatch,
    /// Follows it from where it leapt to in the cycle before.
    leapt: Option<FrameWatch>,
    /// Where the remembered map lies; `None` while it is not believed.
    placed: Option<Placed>,
    /// Where it lay when it was believed last; `None` once it is dropped.
    settled: Option<Placed>,
    /// Where it fits, and for how many messages in turn, until it is believed.
    proposed: Option<(Placed, u32)>,
    /// In how many messages that could be compared it has not fitted, until it is believed: from [`IN_TURN`] on it is
    /// rejected.
    misfits: u32,
    /// Where the local frame lay in the global one when the map of this run was saved last; `None` before.
    saved_in: Option<Pose>,
    /// What this run had saved when its local frame began again: it is remembered instead of the map of the parameters.
    own: Option<Own>,
    /// Number of messages in turn in which another place had clearly more support.
    elsewhere: u32,
    /// When the costs were sent last, and where the frame of the remembered map then was in the local one.
    sent: Option<(Stamp, Pose)>,
    /// When the map was saved last, or could not be.
    saved: Option<Stamp>,
    /// Whether it was told to save, and has not yet.
    asked: bool,
    /// Why the map could not be saved, if so.
    unsaved: Option<String>,
    /// When it was told to forget what this run has seen: maps that came before are not saved.
    cleared: Option<Stamp>,
    /// Whether the local frame has jumped in the global one since the map was saved.
    jump: jump::JumpWatch,
    kept: Kept,
    text: String,
    /// Fingerprint of the remembered map of the parameters, to which all of this belongs.
    used: Option<u64>,
    /// The remembered map: that of the parameters, or of this run (`own`).
    #[serde(skip)]
    remembered: FromParams,
}

/// What a cycle has read.
struct Now<'a> {
    map: &'a GridView<'a>,
    /// Position in the local frame, m.
    vehicle: DVec2,
    global_from_local: &'a Pose,
    /// How far the local frame has jumped in the global one, m, if it has.
    jumped_m: Option<f64>,
}

impl Now<'_> {
    /// A position of the local frame in the global one, m.
    fn to_global(&self, at: DVec2) -> DVec2 {
        (*self.global_from_local * at.extend(0.0)).truncate()
    }

    /// The cells of what is stated: as many as the map has, around the vehicle.
    fn frame(&self) -> GridFrame {
        GridFrame::around(self.vehicle, self.map.columns(), self.map.cell_size_m().x)
    }
}

/// Where the remembered map lies by the newest map.
struct Found {
    placed: Option<Placed>,
    /// How far that is from where the position estimate puts it, m: east and north.
    away: DVec2,
    /// Number of obstacle cells that are compared there.
    compared: usize,
}

rcs_runtime::commands! {
    /// Commands of [`MapMemoryKeeper`].
    pub enum MapMemoryCommand {
        Save = "SAVE" once: "Write the map to save now.",
        Clear = "CLEAR" once: "Forget the remembered map until the next start, and what this run has seen so far.",
    }
}

/// Ports of [`MapMemoryKeeper`].
#[derive(Debug)]
pub struct Ports {
    map: In<Grid>,
    odometry: In<Odometry>,
    transforms: In<FrameTransforms>,
    plan: In<Plan>,
    cost: Out<Grid>,
    memory: Out<MapMemory>,
    registration: Out<FrameTransforms>,
}

impl Process for MapMemoryKeeper {
    type Params = MapMemoryParams;
    type Ports = Ports;
    type Command = MapMemoryCommand;
    const DEF: ProcessDef = ProcessDef {
        plugin: "map_memory",
        summary: "Registers the map of an earlier run, states it to the world model, and saves the map of this one",
        period_ms: 500.0,
        latency_ms: 10.0,
        reads_ground_truth: false,
    };

    fn ports(b: &mut PortBuilder) -> Ports {
        Ports {
            map: b.input("map", "the map to remember, with the evidence of each source, local frame"),
            odometry: b.input("odometry", "pose of the vehicle in the local frame"),
            transforms: b.input("transforms", "the local frame in the global frame"),
            plan: b.optional_input(
                "plan",
                "the plan on that map: one without a way to the goal drops the remembered map",
            ),
            cost: b
                .output(
                    "cost",
                    "the remembered map where it fits: fields cost.memory, conf.memory and backing.memory, local frame",
                )
                .role(Role::Map)
                .palette("cost")
                .build(),
            memory: b.output("memory", "the map to save, global frame").role(Role::Stats).build(),
            registration: b
                .output(
                    "registration",
                    "the frame of the remembered map in the local frame; none while it does not fit",
                )
                .role(Role::Transforms)
                .build(),
        }
    }

    fn check(params: &MapMemoryParams) -> Result<(), String> {
        if !params.world.is_empty() {
            Origin::from_toml(&params.world).map_err(|error| format!("world: {error}"))?;
        }
        parse(&params.memory).map_err(|error| format!("memory: {error}"))?;
        Ok(())
    }

    fn new(_params: &MapMemoryParams) -> Self {
        Self::default()
    }

    /// What was stated to the world model is taken back or replaced. What this run has seen is kept: the local frame goes on,
    /// and one that begins anew is seen by its leap.
    fn renew(&self, params: &MapMemoryParams) -> Self {
        Self {
            sent: self.sent,
            saved_in: self.saved_in,
            own: self.own.clone(),
            track: self.track.clone(),
            recent: self.recent.clone(),
            frame_watch: self.frame_watch,
            leapt: self.leapt,
            cleared: self.cleared,
            jump: self.jump,
            kept: self.kept.clone(),
            used: self.used,
            ..Self::new(params)
        }
    }

    fn cycle(&mut self, ports: &Ports, params: &MapMemoryParams, cx: &mut Cycle<'_>) {
        self.take_params(params);
        while let Some(command) = cx.next_command::<Self>() {
            match command {
                MapMemoryCommand::Save => self.asked = true,
                MapMemoryCommand::Clear => self.clear(cx.now()),
            }
        }
        while let Some(message) = cx.read(&ports.transforms) {
            if let Err(error) = self.frames.add_transforms(&message, message.acq_time(), cx.now()) {
                cx.fault(format!("transforms: {error}; skipped"));
            }
        }
        let Some(vehicle) = self.read_positions(ports, params, cx) else {
            return cx.exec("waits for the pose of the vehicle");
        };
        self.extend_track(vehicle);
        let (global, local) = (&params.global_frame, &params.local_frame);
        let mut placed = self.frames.lookup(global, local, cx.now(), f64::INFINITY);
        // After `INIT` no frame is known, and the local one may be sent only once. Of several messages, only the newest can
        // be read again. What is refused in it has been reported before.
        if placed.is_err()
            && let Some(message) = cx.latest(&ports.transforms)
        {
            let _ = self.frames.add_transforms(&message, message.acq_time(), cx.now());
            placed = self.frames.lookup(global, local, cx.now(), f64::INFINITY);
        }
        let Ok(global_from_local) = placed else {
            return cx.exec("waits for the local frame in the global frame");
        };
        let Ok(origin) = Origin::from_toml(&params.world) else {
            return cx.error("world: expected a file with the [origin] of the global frame");
        };
        let jumped_m = self.jump.jumped_m(&global_from_local, vehicle, params.jump_m, cx.now());
        let cleared = self.cleared;
        let is_kept = |map: &Msg<Grid>| cleared.is_none_or(|cleared| map.header().log_time > cleared);
        // Asked to save, it takes the last map, also of a world model that is halted.
        let last = if self.asked { cx.latest(&ports.map).filter(is_kept) } else { None };
        let newest = cx.read_newest(&ports.map).filter(is_kept);
        // What was registered with a map is not counted again with the same one.
        let is_new = newest.is_some();
        let Some(map) = newest.or(last) else {
            return self.tell(cx);
        };
        let view = match view_of(&map, params) {
            Ok(view) => view,
            Err(error) => {
                if is_new {
                    cx.fault(format!("map: {error}; skipped"));
                }
                return self.tell(cx);
            }
        };
        let seen = Now { map: &view, vehicle, global_from_local: &global_from_local, jumped_m };
        if is_new {
            self.look_for_a_way(cx.latest(&ports.plan).as_deref(), &seen, cx.now());
            if let Err(error) = self.remember(ports, params, &seen, cx) {
                cx.fault(format!("map: {error}; skipped"));
            }
            let now = cx.now();
            cx.write(&ports.registration, now, self.registration(params, now));
        }
        self.save(ports, params, &origin, &seen, cx);
        self.tell(cx);
    }
}

impl MapMemoryKeeper {
    fn tell(&self, cx: &mut Cycle<'_>) {
        cx.exec(self.told());
    }

    /// What the status says: how the remembered map lies, and what of this run is not saved.
    fn told(&self) -> String {
        let unsaved = match &self.unsaved {
            Some(why) => format!("; the map is not saved: {why}"),
            None if self.track.len() >= MOST_TRACK => {
                format!(
                    "; new ground is not saved: the track has {MOST_TRACK} points, the most that it can have"
                )
            }
            None => String::new(),
        };
        match (self.text.is_empty(), unsaved.is_empty()) {
            (true, true) => "nothing is remembered; saves the map".to_owned(),
            (true, false) => format!("nothing is remembered{unsaved}"),
            (false, _) => format!("{}{unsaved}", self.text),
        }
    }

    /// Reads the remembered map of the parameters. What is known of another one than before does not hold for it; what was
    /// stated of that one is withdrawn with the next map.
    fn take_params(&mut self, params: &MapMemoryParams) {
        if self.remembered.is_of(params) {
            return;
        }
        self.remembered = FromParams::read(params);
        let used = fingerprint_of_texts(&[&params.memory, &params.world]);
        if self.used.replace(used).is_some_and(|before| before != used) {
            self.place(None);
            self.closed_to = None;
            (self.settled, self.proposed, self.misfits, self.elsewhere) = (None, None, 0, 0);
            (self.dropped, self.no_way, self.own) = (None, None, None);
            self.text.clear();
        }
        self.take_own();
    }

    /// Believes that the remembered map lies here, or that it lies nowhere. What was counted before does not count for the
    /// next change.
    fn place(&mut self, placed: Option<Placed>) {
        if placed.is_some() != self.placed.is_some() {
            (self.proposed, self.elsewhere) = (None, 0);
        }
        if placed.is_some() {
            (self.settled, self.misfits) = (placed, 0);
        }
        self.placed = placed;
    }

    /// Forgets the remembered map and what would be saved; the next map is saved at once, without it.
    fn clear(&mut self, now: Stamp) {
        self.closed_to = None;
        self.cleared = Some(now);
        self.dropped = Some("the remembered map is cleared".to_owned());
        (self.kept, self.leapt, self.saved) = (Kept::default(), None, None);
        (self.settled, self.own) = (None, None);
        // Nothing was saved of which one could tell that the local frame has jumped since.
        self.jump = jump::JumpWatch::default();
        self.track.clear();
        self.recent.clear();
    }

    /// Drops a remembered map with which there is no way to the goal: there was one to remember. With another goal, it is used
    /// again.
    fn look_for_a_way(&mut self, plan: Option<&Plan>, seen: &Now<'_>, now: Stamp) {
        let is_closed = plan.is_some_and(|plan| plan.state() == PlanState::PlanNoWay);
        // Other plans may have none.
        let with_goal = plan.filter(|plan| is_closed || plan.state() == PlanState::PlanPath);
        let goal = with_goal.map(|plan| seen.to_global(DVec2::new(plan.goal_x_m, plan.goal_y_m)));
        // A jump of the local frame moves the same goal.
        if seen.jumped_m.is_none()
            && self.closed_to.zip(goal).is_some_and(|(closed, goal)| closed.distance(goal) > ANOTHER_GOAL_M)
        {
            self.use_again();
        }
        if !is_closed || self.placed.is_none() {
            self.no_way = None;
        } else if now.seconds_since(*self.no_way.get_or_insert(now)) >= NO_WAY_S {
            self.dropped = Some("the remembered map leaves no way to the goal: not used".to_owned());
            self.closed_to = goal;
        }
    }

    /// Uses a remembered map again that was dropped because it left no way to a goal.
    fn use_again(&mut self) {
        if self.closed_to.take().is_some() {
            self.dropped = None;
        }
    }

    /// Registers the remembered map, and states what it says to the world model.
    fn remember(
        &mut self,
        ports: &Ports,
        params: &MapMemoryParams,
        now: &Now<'_>,
        cx: &mut Cycle<'_>,
    ) -> Result<(), String> {
        let remembered = match self.remembered.map.clone().filter(|_| self.dropped.is_none()) {
            Some(Ok(remembered)) => remembered,
            unusable => {
                if let Some(why) = &self.dropped {
                    self.text.clone_from(why);
                    // One that leaves no way to this goal may leave one to the next: it is saved.
                    self.settled = self.settled.filter(|_| self.closed_to.is_some());
                } else if let Some(Err(why)) = unusable {
                    self.text = format!("{why}: not used");
                }
                self.withdraw(ports, params, now, cx);
                return Ok(());
            }
        };
        let Found { placed, away, compared } = self.find(params, &remembered, now)?;
        let is_far = away.abs().max_element() > params.search_m;
        let found = placed.filter(|_| !is_far);
        let needed = params.least_agreement * if self.placed.is_some() { DOUBT } else { 1.0 };
        let fitting = found.filter(|found| found.fit.agreement >= needed);
        let in_turn = self.in_turn(fitting, now.vehicle);
        if fitting.is_none() && placed.is_some() {
            self.misfits = self.misfits.saturating_add(1);
        }
        self.text = match found {
            Some(placed) if fitting.is_some() && in_turn < IN_TURN => {
                let share = 100.0 * placed.fit.agreement;
                format!(
                    "the remembered map may fit: {share:.0} % agree, {in_turn} of {IN_TURN} times in turn"
                )
            }
            Some(placed) if fitting.is_some() => {
                let Fit { agreement, compared, .. } = placed.fit;
                self.place(Some(placed));
                let (share, moved_m) = (100.0 * agreement, away.length());
                format!("remembers: moved by {moved_m:.1} m, {share:.0} % of {compared} obstacle cells agree")
            }
            Some(Placed { fit, .. }) => {
                self.place(None);
                let (got, needed) = (100.0 * fit.agreement, 100.0 * needed);
                let compared = fit.compared;
                format!(
                    "the remembered map does not fit: {got:.0} % of {compared} obstacle cells agree, expected {needed:.0} %"
                )
            }
            None if is_far => {
                self.place(None);
                let search_m = params.search_m;
                format!(
                    "the remembered map lies more than {search_m} m from where the position estimate puts it: not used"
                )
            }
            None => {
                self.place(None);
                let away_m = remembered.map.distance_m(now.to_global(now.vehicle));
                waits(compared, params.least_cells, away_m)
            }
        };
        match self.placed {
            Some(placed) => self.state_costs(ports, params, placed, &remembered, now, cx),
            None => self.withdraw(ports, params, now, cx),
        }
        Ok(())
    }

    /// Looks where the remembered map lies: near where it lay, or around where the position estimate puts it.
    fn find(
        &mut self,
        params: &MapMemoryParams,
        remembered: &Remembered,
        now: &Now<'_>,
    ) -> Result<Found, String> {
        let (vehicle, view) = (now.vehicle, now.map);
        let mut costs = Vec::new();
        fuse_grid(view, &by_shape(view), &mut costs).map_err(|error| error.to_string())?;
        let mut sensed = Rectangle::with(view, costs);
        sensed.forget_far(view, params.near_m);
        // A map that did not fit any more is turned as it was when it did.
        let turned_before =
            |placed: Placed| turned(now.global_from_local, vehicle, placed.turned_rad(now.global_from_local));
        let start = self.placed.map(|placed| placed.global_from_local);
        let start = start.or(self.settled.map(turned_before)).unwrap_or(*now.global_from_local);
        // How far what is moved so lies from where the position estimate says, m: east and north.
        let away = |moved: DVec2| now.to_global(vehicle) - at(&start, vehicle) + moved;
        let compared = self.compared(vehicle);
        let seen_in_local = Seen::of(&sensed, &compared, params.near_m);
        let seen = seen_in_local.placed(|place| at(&start, place));
        let least = params.least_cells as usize;
        let placed = match self.placed {
            // Where little can be compared, what was found stays.
            Some(placed) => {
                let middle = compared.iter().sum::<DVec2>() / compared.len() as f64;
                let here = placed.followed(remembered, &seen_in_local, middle, now.global_from_local, least);
                // The fit where the position estimate puts the map is not moved.
                let estimated = -away(DVec2::ZERO);
                let there = remembered
                    .register(&seen, estimated, params.search_m, WORTH, least)
                    .filter(|there| there.support > here.fit.support + CLEARLY)
                    .filter(|there| there.agreement >= params.least_agreement);
                self.elsewhere = if there.is_some() { self.elsewhere + 1 } else { 0 };
                let there = there.filter(|_| self.elsewhere >= IN_TURN);
                if there.is_some() {
                    self.elsewhere = 0;
                }
                Some(there.map_or(here, |fit| Placed { fit, ..placed }))
            }
            None => remembered
                .register(&seen, -away(DVec2::ZERO), params.search_m, WORTH, least)
                .map(|fit| Placed { global_from_local: start, fit }),
        };
        let away = placed.map_or(DVec2::ZERO, |placed| away(placed.fit.moved));
        let compared = placed
            .map_or_else(|| remembered.compare(&seen, DVec2::ZERO).compared, |placed| placed.fit.compared);
        Ok(Found { placed, away, compared })
    }

    /// For how many messages in turn the remembered map has fitted in the same place.
    fn in_turn(&mut self, fitting: Option<Placed>, vehicle: DVec2) -> u32 {
        if self.placed.is_some() {
            return IN_TURN;
        }
        let is_same = |placed: &Placed, before: &Placed| {
            let moved = [placed, before].map(|placed| placed.local_from_remembered());
            moved_m(&moved[0], &moved[1], vehicle) <= SAME_PLACE_M
        };
        self.proposed = fitting.map(|placed| match &self.proposed {
            Some((before, times)) if is_same(&placed, before) => (placed, times + 1),
            _ => (placed, 1),
        });
        self.proposed.map_or(0, |(_, times)| times)
    }
}

/// What is waited for before a remembered map that begins this far away, m, can be registered.
fn waits(compared: usize, least: u32, away_m: f64) -> String {
    if away_m <= ELSEWHERE_M {
        return format!(
            "waits: {compared} obstacle cells can be compared with the remembered map, expected {least}"
        );
    }
    let away = if away_m < 1000.0 { format!("{away_m:.0} m") } else { format!("{:.1} km", away_m / 1000.0) };
    format!("the remembered map begins {away} from here: drives without it, and saves it as it was")
}

/// A map in the local frame.
fn view_of<'a>(map: &'a Msg<Grid>, params: &MapMemoryParams) -> Result<GridView<'a>, String> {
    let view = GridView::of(map.message()).map_err(|error| error.to_string())?;
    let local = params.local_frame.as_str();
    if view.frame_id() != local {
        return Err(format!("frame is {:?}, expected {local:?}", view.frame_id()));
    }
    Ok(view)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_counted_before_does_not_count_when_the_map_is_placed_and_when_it_is_lost() {
        let placed = Placed { global_from_local: Pose::IDENTITY, fit: Fit::default() };
        let mut keeper = MapMemoryKeeper { proposed: Some((placed, IN_TURN)), ..Default::default() };
        keeper.place(Some(placed));
        assert_eq!((keeper.placed, keeper.settled, keeper.proposed), (Some(placed), Some(placed), None));
        keeper.elsewhere = IN_TURN - 1;
        keeper.place(Some(placed));
        assert_eq!(keeper.elsewhere, IN_TURN - 1, "it is not placed anew with each message");
        keeper.place(None);
        assert_eq!((keeper.placed, keeper.settled, keeper.elsewhere), (None, Some(placed), 0));
        for times in 1..=IN_TURN {
            assert_eq!(keeper.in_turn(Some(placed), DVec2::ZERO), times);
        }
    }
}
