//! The draft of a mission: goals, and zones that the vehicle must not enter, which an operator draws on the map.
//!
//! Positions are in the frame of the map, m. How near the pointer must be to something is a distance on the screen;
//! `m_per_point` is the length of a screen point on the map.

use rcs_geom::{DVec3, Pose};
use rcs_msg::rcs::{Mission, PlanePoint, PlanePolygon};

/// Radius of the disc of a goal, screen points.
pub(super) const GOAL_RADIUS: f32 = 9.0;
/// Distance from a corner or from the border of a zone at which the pointer means it, screen points.
const NEAR: f64 = 10.0;
/// Distance within which two goals are the same one, and two corners, m.
const SAME_M: f64 = 0.01;
/// Number of changes that can be taken back.
const MOST_CHANGES: usize = 100;

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

/// A mission that has not been sent.
#[derive(Clone, Debug, Default)]
pub(crate) struct Draft {
    pub(super) adds: Adds,
    drawn: Drawn,
    /// The area that was sent before, which cannot be drawn and stays.
    area: Option<Vec<[f64; 2]>>,
    /// What was drawn before each change, the last one at the end.
    history: Vec<Drawn>,
    /// The identity of the next goal that is added.
    next_id: u32,
    drag: Option<Drag>,
    /// The goals with which the draft began, or which were sent last: the vehicle keeps its goals while these are the
    /// same.
    begun: Vec<Goal>,
    /// The mission to which those goals belong; `None` while the vehicle states none.
    stated: Option<Stated>,
    /// Whether the goals replace those of the vehicle even if they are the same.
    states_goals: bool,
    /// Whether anything was changed since the draft began or was sent, or another mission has replaced it.
    pub(super) changed: bool,
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
    goals: Vec<Goal>,
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

/// The goals of a mission in its own frame, and how many of them have been reached.
#[derive(Clone, Debug)]
struct Stated {
    frame_id: String,
    goals: Vec<[f64; 2]>,
    reached: usize,
}

impl Stated {
    fn of(mission: &Mission) -> Self {
        let goals = mission.goals.iter().map(|goal| [goal.x_m, goal.y_m]).collect();
        Self { frame_id: mission.frame_id.clone(), goals, reached: mission.reached as usize }
    }

    /// Whether a mission has the same goals.
    fn is_of(&self, mission: &Mission) -> bool {
        let is_same = |(a, b): (&[f64; 2], &PlanePoint)| distance_m(*a, [b.x_m, b.y_m]) <= SAME_M;
        self.frame_id == mission.frame_id
            && self.goals.len() == mission.goals.len()
            && self.goals.iter().zip(&mission.goals).all(is_same)
    }
}

/// Adds a corner to a polygon that is being drawn. Returns the polygon if the corner closes it: if it is the first one
/// again, within a distance.
pub(super) fn corner(corners: &mut Vec<[f64; 2]>, at: [f64; 2], reach_m: f64) -> Option<Vec<[f64; 2]>> {
    let closes = is_first(corners, at, reach_m);
    if !closes {
        corners.push(at);
    }
    (closes && corners.len() >= 3).then(|| std::mem::take(corners))
}

/// Places a point of a frame on the map.
pub(super) fn place(map_from_frame: Pose) -> impl Fn(&PlanePoint) -> [f64; 2] {
    move |at| {
        let p = map_from_frame * DVec3::new(at.x_m, at.y_m, 0.0);
        [p.x, p.y]
    }
}

impl Draft {
    /// The draft that begins with the bounds that were sent before, and with the goals that are left of the mission that the
    /// vehicle obeys.
    pub(super) fn new(sent: Bounds, obeyed: Option<(&Mission, Pose)>) -> Self {
        let Bounds { area, keep_out } = sent;
        let mut draft = Self { drawn: Drawn { keep_out, ..Drawn::default() }, area, ..Self::default() };
        if let Some((mission, map_from_mission)) = obeyed {
            let left = mission.goals.iter().skip(mission.reached as usize).map(place(map_from_mission));
            draft.drawn.goals = left.zip(0..).map(|(at, id)| Goal { id, at }).collect();
            draft.next_id = draft.drawn.goals.len() as u32;
            draft.begun.clone_from(&draft.drawn.goals);
            draft.stated = Some(Stated::of(mission));
        }
        draft
    }

    /// The draft with this goal in place of all others; the vehicle drives to it even if its goals are the same.
    pub(super) fn with_only_goal(mut self, at: [f64; 2]) -> Self {
        self.drawn.goals = vec![Goal { id: self.next_id, at }];
        self.states_goals = true;
        self
    }

    /// Leaves out the goals that the vehicle has reached since the draft began or was sent. `mission` is the one that the
    /// vehicle obeys.
    pub(super) fn follow(&mut self, mission: &Mission) {
        let Some(stated) = self.stated.as_mut().filter(|stated| stated.is_of(mission)) else { return };
        let more = (mission.reached as usize).saturating_sub(stated.reached);
        stated.reached += more;
        let count = more.min(self.begun.len());
        let reached: Vec<Goal> = self.begun.drain(..count).collect();
        for goal in reached {
            self.leave_out(goal);
        }
    }

    /// Leaves out a goal that was reached, so that taking changes back does not bring it back either. If the operator has
    /// moved the goal elsewhere, it stays there.
    fn leave_out(&mut self, reached: Goal) {
        let is_elsewhere = self.drawn.goals.iter().any(|goal| goal.id == reached.id && *goal != reached);
        let is_left_out = |goal: &Goal| goal.id == reached.id && (!is_elsewhere || *goal == reached);
        for drawn in self.history.iter_mut().chain(std::iter::once(&mut self.drawn)) {
            drawn.goals.retain(|goal| !is_left_out(goal));
        }
    }

    /// The draft was sent as this mission.
    pub(super) fn sent(&mut self, mission: &Mission) {
        (self.changed, self.states_goals) = (false, false);
        if !mission.keeps_goals {
            self.begun.clone_from(&self.drawn.goals);
            self.stated = Some(Stated::of(mission));
        }
    }

    /// Another mission was sent, or the run with this one has ended: the draft is not as sent, and its goals are stated.
    pub(crate) fn replaced(&mut self) {
        (self.changed, self.states_goals) = (true, true);
    }

    /// Whether the vehicle keeps the goals that it has: the draft does not change them.
    fn keeps_goals(&self) -> bool {
        !self.states_goals && self.drawn.goals == self.begun
    }

    /// Adds a goal or a corner of a zone. A click on a goal adds nothing, unless it closes the zone.
    pub(super) fn click(&mut self, at: [f64; 2], m_per_point: f64) {
        let (adds, id, reach_m) = (self.adds, self.next_id, NEAR * m_per_point);
        let closes = adds == Adds::Zone && is_first(&self.drawn.corners, at, reach_m);
        if !closes && self.goal_at(at, m_per_point).is_some() {
            return;
        }
        self.next_id += 1;
        self.change(|drawn| match adds {
            Adds::Goal => drawn.goals.push(Goal { id, at }),
            Adds::Zone => drawn.keep_out.extend(corner(&mut drawn.corners, at, reach_m)),
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

    /// Deletes all goals and zones.
    pub(super) fn clear(&mut self) {
        self.change(|drawn| *drawn = Drawn::default());
    }

    /// Takes the last change back; whether there was one.
    pub(super) fn undo(&mut self) -> bool {
        self.drag = None;
        while let Some(before) = self.history.pop() {
            // If what was changed has been reached since, nothing is left to take back.
            if before != self.drawn {
                self.drawn = before;
                self.changed = true;
                return true;
            }
        }
        false
    }

    fn change(&mut self, edit: impl FnOnce(&mut Drawn)) {
        let before = self.drawn.clone();
        edit(&mut self.drawn);
        if self.drawn != before {
            self.remember(before);
            self.drag = None;
        }
    }

    /// Keeps what was drawn before a change.
    fn remember(&mut self, before: Drawn) {
        if self.history.len() >= MOST_CHANGES {
            self.history.remove(0);
        }
        self.history.push(before);
        self.changed = true;
    }

    /// The corners of the zone that is being drawn.
    pub(super) fn corners(&self) -> &[[f64; 2]] {
        &self.drawn.corners
    }

    /// Where a point of the draft is.
    pub(super) fn place(&self, handle: Handle) -> Option<[f64; 2]> {
        self.drawn.handles().find(|(other, _)| *other == handle).map(|(_, at)| at)
    }

    /// The point of the draft that is nearest to a place and near enough to be dragged from there.
    pub(super) fn handle_at(&self, at: [f64; 2], m_per_point: f64) -> Option<Handle> {
        // Of two at one place, the upper one.
        let away = self.drawn.handles().rev().map(|(handle, place)| (handle, distance_m(place, at)));
        let near = away.filter(|(handle, away_m)| *away_m <= handle.reach() * m_per_point);
        near.min_by(|(_, a), (_, b)| a.total_cmp(b)).map(|(handle, _)| handle)
    }

    /// The goal on whose disc a place lies: its identity, and its number on the map.
    pub(super) fn goal_at(&self, at: [f64; 2], m_per_point: f64) -> Option<(u32, usize)> {
        let reach_m = f64::from(GOAL_RADIUS) * m_per_point;
        let away = self.drawn.goals.iter().enumerate().rev();
        let away = away.map(|(index, goal)| (goal.id, index + 1, distance_m(goal.at, at)));
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
            goals: self.drawn.goals.iter().map(|goal| point(&goal.at)).collect(),
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
    pub(super) fn goal_warning(&self, standing: &Bounds) -> Option<String> {
        let area = self.area.as_ref().or(standing.area.as_ref());
        self.drawn.goals.iter().zip(1..).find_map(|(goal, number)| {
            let mut zones = self.drawn.keep_out.iter().chain(&standing.keep_out);
            if zones.any(|zone| is_in_or_near(zone, goal.at, 0.0)) {
                return Some(format!("goal {number} lies in a keep-out zone"));
            }
            let is_outside = area.is_some_and(|area| !is_in_or_near(area, goal.at, 0.0));
            is_outside.then(|| format!("goal {number} lies outside of the area"))
        })
    }

    /// How much the draft has of each kind.
    pub(super) fn summary(&self) -> String {
        let count = |count: usize, what: &str| format!("{count} {what}{}", if count == 1 { "" } else { "s" });
        let (goals, zones) = (self.drawn.goals.len(), self.drawn.keep_out.len());
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
    /// The points that can be dragged and their places, in the order in which they are painted.
    fn handles(&self) -> impl DoubleEndedIterator<Item = (Handle, [f64; 2])> {
        let corners = self.keep_out.iter().enumerate().flat_map(|(zone, corners)| {
            corners.iter().enumerate().map(move |(index, at)| (Handle::Corner(zone, index), *at))
        });
        let goals = self.goals.iter().map(|goal| (Handle::Goal(goal.id), goal.at));
        let open = self.corners.iter().enumerate().map(|(index, at)| (Handle::OpenCorner(index), *at));
        corners.chain(goals).chain(open)
    }

    fn place_mut(&mut self, handle: Handle) -> Option<&mut [f64; 2]> {
        match handle {
            Handle::Goal(id) => self.goals.iter_mut().find(|goal| goal.id == id).map(|goal| &mut goal.at),
            Handle::Corner(zone, index) => self.keep_out.get_mut(zone)?.get_mut(index),
            Handle::OpenCorner(index) => self.corners.get_mut(index),
        }
    }
}

fn distance_m(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// Whether two polygons have the same corners in the same order.
pub(super) fn is_same_outline(a: &[[f64; 2]], b: &[[f64; 2]]) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| distance_m(*a, *b) <= SAME_M)
}

/// Whether a place is the first corner of a polygon, within a distance.
fn is_first(corners: &[[f64; 2]], at: [f64; 2], reach_m: f64) -> bool {
    corners.first().is_some_and(|first| distance_m(*first, at) <= reach_m)
}

/// Whether a place lies inside of a polygon, or within a distance of its border.
fn is_in_or_near(corners: &[[f64; 2]], at: [f64; 2], reach_m: f64) -> bool {
    let [x, y] = at;
    let mut is_inside = false;
    for (a, b) in corners.iter().zip(corners.iter().cycle().skip(1)) {
        if distance_to_edge_m(*a, *b, at) <= reach_m {
            return true;
        }
        // A ray along the x axis crosses the border an odd number of times if it begins inside.
        let crosses = (a[1] > y) != (b[1] > y);
        is_inside ^= crosses && x < a[0] + (b[0] - a[0]) * (y - a[1]) / (b[1] - a[1]);
    }
    is_inside
}

/// Distance of a place from the line between two corners.
fn distance_to_edge_m(a: [f64; 2], b: [f64; 2], at: [f64; 2]) -> f64 {
    let [dx, dy] = [b[0] - a[0], b[1] - a[1]];
    let squared = dx * dx + dy * dy;
    let along = (at[0] - a[0]) * dx + (at[1] - a[1]) * dy;
    let part = if squared > 0.0 { (along / squared).clamp(0.0, 1.0) } else { 0.0 };
    distance_m([a[0] + part * dx, a[1] + part * dy], at)
}

#[cfg(test)]
#[path = "draft_tests.rs"]
mod tests;
