//! The draft of a mission: goals, and zones that the vehicle must not enter, which an operator draws on the map.
//!
//! Three things are kept apart: what is drawn, what was sent, and what the viewed moment says of that
//! ([`Draft::follow`]). Whether the draft is as sent, and which of its goals are left, follows from comparing them. So it
//! is right also after a look back, in another run, and where the sending was taken back.
//!
//! Positions are in the frame of the map, m. How near the pointer must be to something is a distance on the screen;
//! `m_per_point` is the length of a screen point on the map.

use super::outline::{SAME_M, corner, distance_m, is_first, is_in_or_near, is_same_outline};
use rcs_geom::{DVec3, Pose};
use rcs_msg::Stamp;
use rcs_msg::rcs::{Mission, PlanePoint, PlanePolygon};

/// Radius of the disc of a goal, screen points.
pub(super) const GOAL_RADIUS: f32 = 9.0;
/// Distance from a corner or from the border of a zone at which the pointer means it, screen points.
const NEAR: f64 = 10.0;
/// Number of changes that can be taken back.
const MOST_CHANGES: usize = 100;
/// For this time of the window, a mission that was sent is awaited in its buffer, s. After that it counts as lost.
const ON_ITS_WAY_S: f64 = 5.0;

/// What a click on the map adds to the draft.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) enum Adds {
    /// A goal.
    #[default]
    Goal,
    /// A corner of a zone.
    Zone,
}

/// A point of the draft that can be dragged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Handle {
    /// A goal, by its identity.
    Goal(u32),
    /// A corner of a closed zone: the index of the zone, and that of the corner.
    Corner(usize, usize),
    /// A corner of the zone that is being drawn, by its index.
    OpenCorner(usize),
}

/// The bounds of driving of a mission, on the map.
#[derive(Clone, Debug, Default)]
pub(super) struct Bounds {
    /// What the vehicle must not leave.
    pub(super) area: Option<Vec<[f64; 2]>>,
    /// What it must not enter.
    pub(super) keep_out: Vec<Vec<[f64; 2]>>,
}

/// A mission that is being drawn.
#[derive(Clone, Debug, Default)]
pub(crate) struct Draft {
    pub(super) adds: Adds,
    drawn: Drawn,
    /// The area that was sent before, which cannot be drawn and stays.
    area: Option<Vec<[f64; 2]>>,
    /// What was drawn before each change, the last one at the end.
    history: Vec<Drawn>,
    /// What was drawn before each change was taken back, the last one at the end.
    undone: Vec<Drawn>,
    /// The identity of the next goal that is added.
    next_id: u32,
    drag: Option<Drag>,
    sent: Sent,
    viewed: Viewed,
}

/// A goal. It keeps its identity when it is moved.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Goal {
    id: u32,
    at: [f64; 2],
}

/// What is drawn.
#[derive(Clone, Debug, Default, PartialEq)]
struct Drawn {
    /// The goals, also those that the vehicle has reached by now.
    goals: Vec<Goal>,
    /// Whether the mission states its goals: without any, the vehicle stands. Otherwise it keeps the goal that it has.
    states_goals: bool,
    keep_out: Vec<Vec<[f64; 2]>>,
    /// Corners of the zone that is being drawn.
    corners: Vec<[f64; 2]>,
}

/// A point that is being dragged.
#[derive(Clone, Copy, Debug)]
struct Drag {
    handle: Handle,
    /// Where the point was before.
    from: [f64; 2],
    /// Where the button was pressed.
    pressed: [f64; 2],
    /// Whether the point has been moved.
    has_moved: bool,
}

/// The mission that was sent last, or that was in force when the draft began.
#[derive(Clone, Debug, Default)]
struct Sent {
    /// The operator's newest message with it, by which a moment is known that has it; `None` if there was none.
    message: Option<Mission>,
    /// What was drawn.
    drawn: Drawn,
    /// Its goals, as the vehicle states them; `None` if it has none.
    goals: Option<SentGoals>,
    /// The greatest number of them that the vehicle had reached at a moment that was viewed.
    reached: usize,
    /// Time of the window when it was sent, s; `None` once it has come to its buffer, or counts as lost.
    on_its_way_s: Option<f64>,
}

/// The goals of a mission that was sent: in its own frame, by which they are known again, and as they were drawn.
#[derive(Clone, Debug)]
struct SentGoals {
    frame_id: String,
    places: Vec<[f64; 2]>,
    drawn: Vec<Goal>,
}

/// What the viewed moment says of the mission that was sent.
#[derive(Clone, Copy, Debug, Default)]
struct Viewed {
    /// Whether it is the operator's newest one, or on its way.
    is_newest: bool,
    /// Whether it has goals, and the vehicle states them.
    is_obeyed: bool,
    /// Number of its goals that the vehicle has reached.
    reached: usize,
}

impl SentGoals {
    /// The goals of a mission, which are drawn like this; `None` if it has none.
    fn of(mission: &Mission, drawn: Vec<Goal>) -> Option<Self> {
        let places = mission.goals.iter().map(|goal| [goal.x_m, goal.y_m]).collect();
        (!drawn.is_empty()).then(|| Self { frame_id: mission.frame_id.clone(), places, drawn })
    }

    /// Whether a mission has the same goals.
    fn are_of(&self, mission: &Mission) -> bool {
        let is_same = |(a, b): (&[f64; 2], &PlanePoint)| distance_m(*a, [b.x_m, b.y_m]) <= SAME_M;
        self.frame_id == mission.frame_id
            && self.places.len() == mission.goals.len()
            && self.places.iter().zip(&mission.goals).all(is_same)
    }
}

/// Whether a mission of the operator is later than another one.
fn is_after(newest: Option<&Mission>, other: Option<&Mission>) -> bool {
    let time = |mission: &Mission| mission.timestamp.as_ref().and_then(Stamp::from_proto);
    newest.is_some_and(|newest| other.is_none_or(|other| time(newest) > time(other)))
}

/// Places a point of a frame on the map.
pub(super) fn place(map_from_frame: Pose) -> impl Fn(&PlanePoint) -> [f64; 2] {
    move |at| {
        let p = map_from_frame * DVec3::new(at.x_m, at.y_m, 0.0);
        [p.x, p.y]
    }
}

impl Draft {
    /// The draft that begins with the bounds that were sent before, and with the goals of the mission that the vehicle obeys.
    /// `newest` is the operator's newest mission.
    pub(super) fn new(sent: Bounds, newest: Option<&Mission>, obeyed: Option<(&Mission, Pose)>) -> Self {
        let Bounds { area, keep_out } = sent;
        let stands = newest.is_some_and(|mission| !mission.keeps_goals && mission.goals.is_empty());
        let mut drawn = Drawn { states_goals: stands, keep_out, ..Drawn::default() };
        let mut goals = None;
        if let Some((mission, map_from_mission)) = obeyed {
            let places = mission.goals.iter().map(place(map_from_mission));
            drawn.goals = places.zip(0..).map(|(at, id)| Goal { id, at }).collect();
            drawn.states_goals |= !drawn.goals.is_empty();
            goals = SentGoals::of(mission, drawn.goals.clone());
        }
        let next_id = drawn.goals.len() as u32;
        let sent = Sent { message: newest.cloned(), drawn: drawn.clone(), goals, ..Sent::default() };
        let mut draft = Self { drawn, area, next_id, sent, ..Self::default() };
        draft.follow(newest, obeyed.map(|(mission, _)| mission), 0.0);
        draft
    }

    /// The draft with this goal in place of all others; the vehicle drives to it even if its goals are the same.
    pub(super) fn with_only_goal(mut self, at: [f64; 2]) -> Self {
        self.drawn.goals = vec![Goal { id: self.next_id, at }];
        self.drawn.states_goals = true;
        self
    }

    /// Takes over what the viewed moment has: the operator's newest mission, and the one that the vehicle obeys. `now_s` is
    /// the time of the window.
    pub(super) fn follow(&mut self, newest: Option<&Mission>, obeyed: Option<&Mission>, now_s: f64) {
        self.follow_sending(newest, now_s);
        let goals = self.sent.goals.as_ref();
        let obeyed = obeyed.filter(|mission| goals.is_some_and(|goals| goals.are_of(mission)));
        self.viewed.is_obeyed = obeyed.is_some();
        self.viewed.reached = match obeyed {
            Some(mission) => mission.reached as usize,
            // What was reached before another mission took its place stays reached.
            None if is_after(newest, self.sent.message.as_ref()) => self.sent.reached,
            None => 0,
        };
        self.sent.reached = self.sent.reached.max(self.viewed.reached);
    }

    /// Takes over whether the operator's newest mission is the one that was sent; returns whether that was on its way and has
    /// come to its buffer. `now_s` is the time of the window.
    pub(super) fn follow_sending(&mut self, newest: Option<&Mission>, now_s: f64) -> bool {
        let is_newest = newest == self.sent.message.as_ref();
        let is_lost = |sent_s: f64| now_s > sent_s + ON_ITS_WAY_S;
        let has_come = is_newest && self.is_on_its_way();
        if is_newest || self.sent.on_its_way_s.is_some_and(is_lost) {
            self.sent.on_its_way_s = None;
        }
        self.viewed.is_newest = is_newest || self.is_on_its_way();
        has_come
    }

    /// Whether the mission was sent and has not come to its buffer yet.
    pub(super) fn is_on_its_way(&self) -> bool {
        self.sent.on_its_way_s.is_some()
    }

    /// The draft was sent as this mission, at this time of the window.
    pub(super) fn sent(&mut self, mission: &Mission, now_s: f64) {
        if !mission.keeps_goals {
            // What was reached of the mission before is no part of this one.
            let reached = self.reached().to_vec();
            let before = self.history.iter_mut().chain(&mut self.undone);
            for drawn in before.chain(std::iter::once(&mut self.drawn)) {
                drawn.goals.retain(|goal| !reached.contains(goal));
            }
            self.sent.goals = SentGoals::of(mission, self.drawn.goals.clone());
            (self.sent.reached, self.viewed.reached) = (0, 0);
        }
        self.sent.message = Some(mission.clone());
        self.sent.drawn.clone_from(&self.drawn);
        self.sent.on_its_way_s = Some(now_s);
        self.viewed.is_newest = true;
    }

    /// The mission is no longer awaited in its buffer: another one was sent after it, or its run has ended.
    pub(crate) fn forget_sending(&mut self) {
        self.sent.on_its_way_s = None;
    }

    /// Whether what is drawn is what the viewed moment has: nothing is left to send.
    pub(super) fn is_as_sent(&self) -> bool {
        let Sent { message, drawn, goals, .. } = &self.sent;
        // Goals that no message of the operator has stated are known from the vehicle alone.
        let has_goals = message.is_some() || goals.is_none() || self.viewed.is_obeyed;
        self.viewed.is_newest && has_goals && self.is_same(&self.drawn, drawn)
    }

    /// How the draft compares with what was sent, in words.
    pub(super) fn status(&self) -> &'static str {
        match (self.is_as_sent(), &self.sent) {
            (false, _) => "not sent",
            (true, Sent { message: None, goals: None, .. }) => "nothing sent",
            (true, _) => "as sent",
        }
    }

    /// What the vehicle does by a draft without goals, in words; `None` if the draft has some, or all were reached.
    pub(super) fn without_goals(&self) -> Option<&'static str> {
        let keeps = "the vehicle keeps its goal";
        let does = if self.keeps_goals() { keeps } else { "without goals the vehicle stands" };
        self.drawn.goals.is_empty().then_some(does)
    }

    /// Whether the vehicle keeps the goals that it has: the draft states none, or those that the vehicle was told last. That
    /// it stands is told each time: from a message that keeps the goals, nobody could read it.
    fn keeps_goals(&self) -> bool {
        let is_in_force = self.viewed.is_newest || self.viewed.is_obeyed;
        match &self.sent.goals {
            Some(sent) if is_in_force => self.goals().eq(sent.drawn.iter().skip(self.viewed.reached)),
            None if is_in_force && self.sent.drawn.states_goals => false,
            _ => !self.drawn.states_goals,
        }
    }

    /// The goals of the mission that the vehicle has reached at the viewed moment.
    fn reached(&self) -> &[Goal] {
        let goals = self.sent.goals.as_ref().map(|sent| sent.drawn.as_slice()).unwrap_or_default();
        &goals[..self.viewed.reached.min(goals.len())]
    }

    /// The goals of a drawing that are left at the viewed moment. One that was moved from where it was reached is left.
    fn left<'a>(&'a self, drawn: &'a Drawn) -> impl DoubleEndedIterator<Item = &'a Goal> {
        let reached = self.reached();
        drawn.goals.iter().filter(move |goal| !reached.contains(goal))
    }

    /// The goals that are drawn and left.
    fn goals(&self) -> impl DoubleEndedIterator<Item = &Goal> {
        self.left(&self.drawn)
    }

    /// The goals that are drawn and left, with their numbers. Those that were reached are counted, as the vehicle counts
    /// them: a goal keeps its number when another one is reached.
    fn numbered(&self) -> impl DoubleEndedIterator<Item = (usize, &Goal)> {
        let reached = self.reached();
        let all = self.drawn.goals.iter().enumerate().map(|(index, goal)| (index + 1, goal));
        all.filter(move |(_, goal)| !reached.contains(goal))
    }

    /// The numbers and the places of the goals that are drawn and left.
    pub(super) fn numbers(&self) -> impl Iterator<Item = (usize, [f64; 2])> {
        self.numbered().map(|(number, goal)| (number, goal.at))
    }

    /// Whether two drawings are the same at the viewed moment.
    fn is_same(&self, a: &Drawn, b: &Drawn) -> bool {
        self.left(a).eq(self.left(b))
            && a.states_goals == b.states_goals
            && a.keep_out == b.keep_out
            && a.corners == b.corners
    }

    /// Adds a goal or a corner of a zone. A click on a goal adds nothing, unless it closes the zone. One on the first corner
    /// closes a zone also while clicks add goals.
    pub(super) fn click(&mut self, at: [f64; 2], m_per_point: f64) {
        let (id, reach_m) = (self.next_id, NEAR * m_per_point);
        let is_on_first = is_first(&self.drawn.corners, at, reach_m);
        let is_of_zone = self.adds == Adds::Zone || (is_on_first && self.drawn.corners.len() >= 3);
        if !(is_of_zone && is_on_first) && self.goal_at(at, m_per_point).is_some() {
            return;
        }
        self.next_id += 1;
        self.change(|drawn| {
            if is_of_zone {
                drawn.keep_out.extend(corner(&mut drawn.corners, at, reach_m));
            } else {
                drawn.goals.push(Goal { id, at });
                drawn.states_goals = true;
            }
        });
    }

    /// Begins to drag the point at a place, if there is one.
    pub(super) fn grab(&mut self, at: [f64; 2], m_per_point: f64) {
        let drag = |handle| {
            let from = self.place(handle)?;
            Some(Drag { handle, from, pressed: at, has_moved: false })
        };
        self.drag = self.handle_at(at, m_per_point).and_then(drag);
    }

    /// Moves the point that is being dragged by as much as the pointer, which is at this place.
    pub(super) fn drag_to(&mut self, at: [f64; 2]) {
        let Some(drag) = self.drag else { return };
        let to = [0, 1].map(|axis| drag.from[axis] + (at[axis] - drag.pressed[axis]));
        // A goal that is being dragged may have been reached.
        if self.place(drag.handle).is_none_or(|place| place == to) {
            return;
        }
        if !drag.has_moved {
            self.remember(self.drawn.clone());
            self.drag = Some(Drag { has_moved: true, ..drag });
        }
        if let Some(place) = self.drawn.place_mut(drag.handle) {
            *place = to;
        }
    }

    /// Ends dragging.
    pub(super) fn release(&mut self) {
        self.drag = None;
    }

    /// The point that is being dragged.
    pub(super) fn dragged(&self) -> Option<Handle> {
        self.drag.map(|drag| drag.handle)
    }

    /// Deletes a goal, by its identity.
    pub(super) fn delete_goal(&mut self, id: u32) {
        self.change(|drawn| drawn.goals.retain(|goal| goal.id != id));
    }

    /// Deletes a closed zone, by its index.
    pub(super) fn delete_zone(&mut self, zone: usize) {
        self.change(|drawn| {
            if zone < drawn.keep_out.len() {
                drawn.keep_out.remove(zone);
            }
        });
    }

    /// Deletes all goals and zones: the vehicle is to stand.
    pub(super) fn clear(&mut self) {
        self.change(|drawn| *drawn = Drawn { states_goals: true, ..Drawn::default() });
    }

    /// Takes the last change back; whether there was one.
    pub(crate) fn undo(&mut self) -> bool {
        self.drag = None;
        let Some(last) = self.last_change() else { return false };
        let before = self.history.swap_remove(last);
        self.undone.push(std::mem::replace(&mut self.drawn, before));
        self.history.truncate(last);
        true
    }

    /// Does again the change that was taken back last; whether there was one.
    pub(crate) fn redo(&mut self) -> bool {
        self.drag = None;
        let Some(next) = self.next_change() else { return false };
        let after = self.undone.swap_remove(next);
        self.undone.truncate(next);
        self.history.push(std::mem::replace(&mut self.drawn, after));
        true
    }

    /// Whether there is a change to take back, or one to do again.
    pub(super) fn can_undo_or_redo(&self) -> bool {
        self.last_change().is_some() || self.next_change().is_some()
    }

    /// Index in the history of what was drawn before the last change. A change of what was reached since is none.
    fn last_change(&self) -> Option<usize> {
        self.history.iter().rposition(|before| !self.is_same(before, &self.drawn))
    }

    /// Index in what was undone of what was drawn before the last change was taken back.
    fn next_change(&self) -> Option<usize> {
        self.undone.iter().rposition(|after| !self.is_same(after, &self.drawn))
    }

    fn change(&mut self, edit: impl FnOnce(&mut Drawn)) {
        let before = self.drawn.clone();
        edit(&mut self.drawn);
        if self.drawn != before {
            self.remember(before);
            self.drag = None;
        }
    }

    /// Keeps what was drawn before a change. What was undone before it is not done again.
    fn remember(&mut self, before: Drawn) {
        self.undone.clear();
        if self.history.len() >= MOST_CHANGES {
            self.history.remove(0);
        }
        self.history.push(before);
    }

    /// The corners of the zone that is being drawn.
    pub(super) fn corners(&self) -> &[[f64; 2]] {
        &self.drawn.corners
    }

    /// Where a point of the draft is.
    pub(super) fn place(&self, handle: Handle) -> Option<[f64; 2]> {
        self.handles().find(|(other, _)| *other == handle).map(|(_, at)| at)
    }

    /// The points that can be dragged and their places, in the order in which they are painted.
    fn handles(&self) -> impl DoubleEndedIterator<Item = (Handle, [f64; 2])> {
        let corners = self.drawn.keep_out.iter().enumerate().flat_map(|(zone, corners)| {
            corners.iter().enumerate().map(move |(index, at)| (Handle::Corner(zone, index), *at))
        });
        let goals = self.goals().map(|goal| (Handle::Goal(goal.id), goal.at));
        let open = self.drawn.corners.iter().enumerate();
        let open = open.map(|(index, at)| (Handle::OpenCorner(index), *at));
        corners.chain(goals).chain(open)
    }

    /// The point of the draft that is nearest to a place and near enough to be dragged from there.
    pub(super) fn handle_at(&self, at: [f64; 2], m_per_point: f64) -> Option<Handle> {
        // Of two at one place, the upper one.
        let away = self.handles().rev().map(|(handle, place)| (handle, distance_m(place, at)));
        let near = away.filter(|(handle, away_m)| *away_m <= handle.reach() * m_per_point);
        near.min_by(|(_, a), (_, b)| a.total_cmp(b)).map(|(handle, _)| handle)
    }

    /// The goal on whose disc a place lies: its identity, and its number on the map.
    pub(super) fn goal_at(&self, at: [f64; 2], m_per_point: f64) -> Option<(u32, usize)> {
        let reach_m = f64::from(GOAL_RADIUS) * m_per_point;
        let away = self.numbered().rev();
        let away = away.map(|(number, goal)| (goal.id, number, distance_m(goal.at, at)));
        let near = away.filter(|(_, _, away_m)| *away_m <= reach_m);
        near.min_by(|(_, _, a), (_, _, b)| a.total_cmp(b)).map(|(id, number, _)| (id, number))
    }

    /// The index of the closed zone in which a place lies, or near whose border.
    pub(super) fn zone_at(&self, at: [f64; 2], m_per_point: f64) -> Option<usize> {
        self.drawn.keep_out.iter().rposition(|zone| is_in_or_near(zone, at, NEAR * m_per_point))
    }

    /// The message that states the draft in a frame.
    pub(super) fn message(&self, frame_id: &str, frame_from_map: &Pose) -> Mission {
        let point = |at: &[f64; 2]| {
            let p = *frame_from_map * DVec3::new(at[0], at[1], 0.0);
            PlanePoint { x_m: p.x, y_m: p.y }
        };
        let zone = |corners: &Vec<[f64; 2]>| PlanePolygon { points: corners.iter().map(point).collect() };
        Mission {
            timestamp: None,
            frame_id: frame_id.to_owned(),
            goals: self.goals().map(|goal| point(&goal.at)).collect(),
            area: self.area.as_ref().map(zone),
            keep_out: self.drawn.keep_out.iter().map(zone).collect(),
            reached: 0,
            keeps_goals: self.keeps_goals(),
        }
    }

    /// The bounds of the mission that the vehicle obeys, in its frame, without those that the draft has, too. They hold until
    /// the draft is sent, and those that do not come from the operator also afterwards.
    pub(super) fn not_drawn(&self, obeyed: &Mission, map_from_obeyed: Pose) -> Mission {
        let is_drawn = |zone: &PlanePolygon| {
            let corners: Vec<[f64; 2]> = zone.points.iter().map(place(map_from_obeyed)).collect();
            self.drawn.keep_out.iter().any(|drawn| is_same_outline(drawn, &corners))
        };
        // An area that is sent takes the place of any other one.
        let area = if self.area.is_some() { None } else { obeyed.area.clone() };
        let keep_out = obeyed.keep_out.iter().filter(|zone| !is_drawn(zone)).cloned().collect();
        Mission { frame_id: obeyed.frame_id.clone(), area, keep_out, ..Mission::default() }
    }

    /// Why the vehicle would not drive to one of the goals; `None` if nothing is known against them. `standing` has the bounds
    /// that hold also after the draft is sent; an area of the draft takes the place of theirs.
    fn goal_warning(&self, standing: &Bounds) -> Option<String> {
        let area = self.area.as_ref().or(standing.area.as_ref());
        self.numbered().find_map(|(number, goal)| {
            let mut zones = self.drawn.keep_out.iter().chain(&standing.keep_out);
            if zones.any(|zone| is_in_or_near(zone, goal.at, 0.0)) {
                return Some(format!("goal {number} lies in a keep-out zone"));
            }
            let is_outside = area.is_some_and(|area| !is_in_or_near(area, goal.at, 0.0));
            is_outside.then(|| format!("goal {number} lies outside of the area"))
        })
    }

    /// What speaks against sending the draft: a goal, or the vehicle, which is at this place, is where it must not be.
    pub(super) fn warnings(
        &self,
        standing: &Bounds,
        vehicle: Option<[f64; 2]>,
    ) -> impl Iterator<Item = String> {
        let is_in = |at| self.drawn.keep_out.iter().any(|zone| is_in_or_near(zone, at, 0.0));
        let encloses = vehicle.is_some_and(is_in).then(|| "the vehicle stands in a keep-out zone".to_owned());
        self.goal_warning(standing).into_iter().chain(encloses)
    }

    /// How much the draft has of each kind.
    pub(super) fn summary(&self) -> String {
        let count = |count: usize, what: &str| format!("{count} {what}{}", if count == 1 { "" } else { "s" });
        let (goals, zones) = (self.goals().count(), self.drawn.keep_out.len());
        format!("{}, {}", count(goals, "goal"), count(zones, "keep-out zone"))
    }
}

impl Handle {
    /// Distance within which it can be dragged, screen points.
    fn reach(self) -> f64 {
        match self {
            Self::Goal(_) => f64::from(GOAL_RADIUS),
            Self::Corner(..) | Self::OpenCorner(_) => NEAR,
        }
    }
}

impl Drawn {
    fn place_mut(&mut self, handle: Handle) -> Option<&mut [f64; 2]> {
        match handle {
            Handle::Goal(id) => self.goals.iter_mut().find(|goal| goal.id == id).map(|goal| &mut goal.at),
            Handle::Corner(zone, index) => self.keep_out.get_mut(zone)?.get_mut(index),
            Handle::OpenCorner(index) => self.corners.get_mut(index),
        }
    }
}

#[cfg(test)]
#[path = "draft_tests.rs"]
mod tests;
