//! A plan: the cheapest path with the terms of its cost, and the cheapest path elsewhere with its terms.

use crate::costs::{BLOCKED, CostGrid, CostGridError, MAX_COST};
use crate::search::{NoPath, Path, Place, Search};
use crate::sensed::Sensed;
use crate::terrain::{Past, Rules, Terms, Terrain};
use rcs_geom::{DVec2, Pose};
use std::collections::BTreeSet;

/// What is planned.
#[derive(Clone, Copy, Debug)]
pub struct Task<'a> {
    /// The map.
    pub sensed: &'a Sensed,
    /// Pose of the vehicle in the map's frame.
    pub vehicle: &'a Pose,
    /// Position of the goal in the map's frame, m.
    pub goal: DVec2,
    /// If the goal's cell is blocked, the nearest free one within this distance is planned to, m.
    pub approach_m: f64,
    /// Whether the goal is a point of a longer path, which the vehicle passes.
    pub is_passed: bool,
    /// What the planner remembers.
    pub past: Past<'a>,
    /// How far the rejected path stays from the middle half of the chosen one, m.
    pub alternative_m: f64,
}

/// Why there is no plan.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NoPlan {
    /// The map cannot be used.
    #[error("map: {0}")]
    Map(#[from] CostGridError),
    /// The vehicle is not on the map.
    #[error("the vehicle at ({:.1}, {:.1}) m is not on the map", .0.x, .0.y)]
    OffTheMap(DVec2),
    /// The goal is too far away.
    #[error("the goal at ({:.0}, {:.0}) m is too far away to plan to", .0.x, .0.y)]
    TooFar(DVec2),
    /// All cells around the goal are blocked.
    #[error("the goal at ({:.1}, {:.1}) m is inside of an obstacle: no free cell within {within_m} m of it", goal.x, goal.y)]
    GoalBlocked {
        /// The goal, m.
        goal: DVec2,
        /// The radius within which a free cell would do, m.
        within_m: f64,
    },
    /// Obstacles are all around the vehicle, or around the goal.
    #[error("no way to the goal: {0}")]
    NoPath(NoPath),
    /// The area or the zones, as somebody has stated them, close every way.
    #[error(
        "no way to the goal inside of the area and around the zones, although there would be one without them"
    )]
    Forbidden,
}

/// A step of a path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// Centre of the cell entered, map's frame, m.
    pub at: DVec2,
    /// Cost from the start of the path.
    pub cost: f64,
    /// Terms of the step, times its length in cells.
    pub terms: Terms,
}

/// A path with the terms of its cost.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Candidate {
    /// From the cell of the vehicle, which costs nothing, to that of the goal or to the edge of the map.
    pub steps: Vec<Step>,
    /// Length, m.
    pub length_m: f64,
    /// Cost, including [`Candidate::beyond_cost`].
    pub cost: f64,
    /// Sum of the terms.
    pub terms: Terms,
    /// Estimated cost from the edge of the map to a goal outside of it.
    pub beyond_cost: f64,
}

/// The result.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Plan {
    /// The cheapest path.
    pub chosen: Candidate,
    /// The cheapest path that stays away from the middle half of the chosen one; `None` if there is no such path.
    pub rejected: Option<Candidate>,
    /// How far the path ends from the goal, because the goal's cell is blocked, m; 0 if it ends there or leaves the map.
    pub short_of_goal_m: f64,
    /// Number of cells that both searches took from their queues.
    pub expanded: u64,
}

/// The memory of a planner, which it uses again.
#[derive(Debug, Default)]
pub struct Planner {
    terrain: Terrain,
    search: Search,
    path: Path,
}

/// The cheapest way, whose cells are in [`Planner::path`].
struct Way {
    costs: CostGrid,
    start: Place,
    end: Place,
    /// See [`Plan::short_of_goal_m`].
    short_of_goal_m: f64,
}

/// Goals outside of the map are planned to in their direction, at most this many sides of the map away.
const FARTHEST_SIDES: f64 = 20.0;

impl Planner {
    /// Plans.
    pub fn plan(&mut self, task: &Task<'_>, rules: &Rules) -> Result<Plan, NoPlan> {
        let way = self.way(task, rules);
        let is_closed = matches!(way, Err(NoPlan::NoPath(NoPath::NotConnected)));
        if is_closed && self.is_open_without_zones(task, rules) {
            return Err(NoPlan::Forbidden);
        }
        let Way { mut costs, start, end, short_of_goal_m } = way?;
        let mut plan = Plan {
            chosen: self.candidate(task, &costs, rules),
            rejected: None,
            short_of_goal_m,
            expanded: self.path.expanded,
        };
        avoid(&mut costs, &self.path.cells, task);
        if self.search.path(&costs, start, end, rules.unknown, &mut self.path).is_ok() {
            plan.rejected = Some(self.candidate(task, &costs, rules));
        }
        plan.expanded += self.path.expanded;
        Ok(plan)
    }

    /// Whether there is a way if the vehicle may drive wherever the world is.
    fn is_open_without_zones(&mut self, task: &Task<'_>, rules: &Rules) -> bool {
        let Some(zones) = task.past.zones else { return false };
        let world = zones.not_stated();
        let past = Past { zones: Some(&world), ..task.past };
        world != *zones && self.way(&Task { past, ..*task }, rules).is_ok()
    }

    /// The cheapest way to the goal, or to a free cell beside it.
    fn way(&mut self, task: &Task<'_>, rules: &Rules) -> Result<Way, NoPlan> {
        let Task { sensed, vehicle, goal, approach_m, .. } = *task;
        let position = vehicle.translation.truncate();
        let costs = self.terrain.costs(sensed, vehicle, &task.past, rules)?;
        let start = sensed.place(position).filter(|&place| costs.contains(place));
        let start = start.ok_or(NoPlan::OffTheMap(position))?;
        let side_m = sensed.cell_size_m * costs.columns().max(costs.rows()) as f64;
        let towards = (goal - position).clamp_length_max(FARTHEST_SIDES * side_m);
        let mut end = sensed.place(position + towards).ok_or(NoPlan::TooFar(goal))?;
        let mut short_of_goal_m = 0.0;
        let is_blocked = costs.get(end) == Some(BLOCKED);
        if is_blocked {
            let free = Terrain::nearest_free(sensed, &costs, goal, approach_m, |_| true);
            end = free.ok_or(NoPlan::GoalBlocked { goal, within_m: approach_m })?;
            short_of_goal_m = sensed.centre(end).distance(goal);
        }
        let found = self.search.path(&costs, start, end, rules.unknown, &mut self.path);
        let is_closed = found == Err(NoPath::NotConnected);
        let is_inside = is_closed && !task.is_passed && is_inside_obstacle(&costs, end, task);
        if is_inside || (is_closed && !task.is_passed && is_blocked) {
            let is_reached = |place: Place| self.search.has_reached(place);
            let free = Terrain::nearest_free(sensed, &costs, goal, approach_m, is_reached);
            end = free.ok_or(if is_inside {
                NoPlan::GoalBlocked { goal, within_m: approach_m }
            } else {
                NoPlan::NoPath(NoPath::NotConnected)
            })?;
            short_of_goal_m = sensed.centre(end).distance(goal);
            self.search.path(&costs, start, end, rules.unknown, &mut self.path).map_err(NoPlan::NoPath)?;
        } else {
            found.map_err(NoPlan::NoPath)?;
        }
        Ok(Way { costs, start, end, short_of_goal_m })
    }

    fn candidate(&self, task: &Task<'_>, costs: &CostGrid, rules: &Rules) -> Candidate {
        let Task { sensed, vehicle, .. } = *task;
        let mut candidate = Candidate::default();
        let mut before: Option<Place> = None;
        for &place in &self.path.cells {
            let at = sensed.centre(place);
            let mut step = Step { at, cost: candidate.cost, terms: Terms::default() };
            if let Some(before) = before {
                let cells = before.octile(place) as f64 / f64::from(crate::search::STRAIGHT);
                let terms = self.terrain.terms(sensed, place, vehicle, rules).unwrap_or_default();
                step.terms = Terms::default().plus(terms, cells as f32);
                step.cost += cells * f64::from(costs.get(place).unwrap_or(BLOCKED));
                candidate.length_m += cells * sensed.cell_size_m;
                candidate.terms = candidate.terms.plus(terms, cells as f32);
            }
            candidate.cost = step.cost;
            candidate.steps.push(step);
            before = Some(place);
        }
        candidate.beyond_cost = self.path.beyond;
        candidate.cost += candidate.beyond_cost;
        candidate
    }
}

/// Whether a cell that is not blocked lies inside of an obstacle of which only the outside is seen: all cells that are
/// connected with it lie within the approach to the goal, none at the edge of the map, and most are unknown. A clearing
/// that is seen is none.
fn is_inside_obstacle(costs: &CostGrid, from: Place, task: &Task<'_>) -> bool {
    let sensed = task.sensed;
    let is_inside = |place: Place| {
        let at_edge = place.column == 0
            || place.row == 0
            || place.column + 1 == costs.columns() as i32
            || place.row + 1 == costs.rows() as i32;
        !at_edge && sensed.centre(place).distance(task.goal) <= task.approach_m
    };
    if !costs.contains(from) {
        return false;
    }
    let mut seen = BTreeSet::from([(from.column, from.row)]);
    let (mut left, mut known) = (vec![from], 0);
    while let Some(place) = left.pop() {
        if !is_inside(place) {
            return false;
        }
        known += usize::from(sensed.fused[sensed.index(place)] <= MAX_COST);
        for (dx, dy) in [(1, 0), (-1, 0), (0, 1), (0, -1)] {
            let next = Place::new(place.column + dx, place.row + dy);
            let is_free = costs.get(next).is_some_and(|cost| cost != BLOCKED);
            if is_free && seen.insert((next.column, next.row)) {
                left.push(next);
            }
        }
    }
    2 * known < seen.len()
}

/// Blocks the surroundings of the middle half of a path.
fn avoid(costs: &mut CostGrid, cells: &[Place], task: &Task<'_>) {
    let count = cells.len();
    // On a short path the surroundings shrink with it, or start and goal would lie within them.
    let radius = (task.alternative_m / task.sensed.cell_size_m).min(count as f64 / 5.0);
    let reach = radius as i32;
    for middle in &cells[count / 4..count - count / 4] {
        for dr in -reach..=reach {
            for dc in -reach..=reach {
                if f64::from(dr * dr + dc * dc) <= radius * radius {
                    costs.block(Place::new(middle.column + dc, middle.row + dr));
                }
            }
        }
    }
}

impl Plan {
    /// One sentence: why this path and not the other one.
    pub fn reason(&self) -> String {
        let Some(rejected) = &self.rejected else {
            return "there is no other way".to_owned();
        };
        let (ours, theirs) = (&self.chosen, rejected);
        let differences = [
            ("terrain", theirs.terms.terrain - ours.terms.terrain),
            ("clearance", theirs.terms.clearance - ours.terms.clearance),
            ("heading", theirs.terms.heading - ours.terms.heading),
            ("relief", theirs.terms.relief - ours.terms.relief),
            ("memory", theirs.terms.memory - ours.terms.memory),
            ("previous path", theirs.terms.previous - ours.terms.previous),
            ("beyond the map", (theirs.beyond_cost - ours.beyond_cost) as f32),
        ];
        let told = differences.iter().filter(|(_, by)| by.abs() >= 0.5);
        let told: Vec<String> = told.map(|(name, by)| format!("{name} {by:+.0}")).collect();
        let more = theirs.cost - ours.cost;
        if told.is_empty() {
            "the other way costs the same".to_owned()
        } else {
            format!("the other way costs {more:.0} more: {}", told.join(", "))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::zones::{Polygon, Zones};

    fn rules() -> Rules {
        Rules {
            table: vec![(124, 10)],
            unknown: 20,
            unknown_near: 20,
            half_width_m: 0.35,
            least_room_m: 0.4,
            far_room_m: 0.4,
            wish_room_m: 1.0,
            clearance: 40.0,
            ..Rules::plain()
        }
    }

    /// 101×101 free cells of 0.2 m around (0, 0), with a wall at x = 3 m between two values of y.
    fn with_wall(from_m: f64, to_m: f64) -> Sensed {
        let mut sensed = Sensed {
            columns: 101,
            cell_size_m: 0.2,
            corner: DVec2::splat(-10.1),
            fused: vec![0; 101 * 101],
            bumped: Vec::new(),
            remembered: Vec::new(),
            seen_from_dm: Vec::new(),
        };
        for at in 0..sensed.fused.len() {
            let centre = sensed.centre(Place::new((at % 101) as i32, (at / 101) as i32));
            if (centre.x - 3.0).abs() < 0.05 && (from_m..to_m).contains(&centre.y) {
                sensed.fused[at] = 250;
            }
        }
        sensed
    }

    fn plan(sensed: &Sensed, goal: DVec2) -> Result<Plan, NoPlan> {
        plan_with(sensed, goal, Past::default())
    }

    fn plan_with(sensed: &Sensed, goal: DVec2, past: Past<'_>) -> Result<Plan, NoPlan> {
        let vehicle = Pose::from_xy_yaw(0.05, 0.05, 0.0);
        let task = Task {
            sensed,
            vehicle: &vehicle,
            goal,
            approach_m: 0.5,
            is_passed: false,
            past,
            alternative_m: 1.5,
        };
        Planner::default().plan(&task, &rules())
    }

    #[test]
    fn it_passes_the_near_end_of_a_wall_and_tells_what_the_other_end_would_cost() {
        let plan = plan(&with_wall(-5.0, 2.0), DVec2::new(6.0, 0.0)).unwrap();
        let passes =
            |path: &Candidate| path.steps.iter().find(|step| (step.at.x - 3.0).abs() < 0.05).unwrap().at.y;
        assert!(passes(&plan.chosen) > 2.0);
        let rejected = plan.rejected.as_ref().unwrap();
        assert!(
            passes(rejected) < -5.0 || passes(rejected) > passes(&plan.chosen) + 1.0,
            "{}",
            passes(rejected)
        );
        assert!(rejected.cost > plan.chosen.cost);
        assert!(
            plan.reason().starts_with("the other way costs ") && plan.reason().contains("terrain +"),
            "{}",
            plan.reason()
        );
        let total = plan.chosen.terms.total();
        assert!(
            (f64::from(total) - plan.chosen.cost).abs() < 0.02 * plan.chosen.cost,
            "{total} {}",
            plan.chosen.cost
        );
        let sum: f32 = plan.chosen.steps.iter().map(|step| step.terms.total()).sum();
        assert!((sum - total).abs() < 0.1);
    }

    #[test]
    fn a_goal_outside_of_the_map_is_planned_to_over_the_edge_that_suits() {
        let plan = plan(&with_wall(-9.0, 9.0), DVec2::new(60.0, 0.0)).unwrap();
        let last = plan.chosen.steps.last().unwrap().at;
        assert!(last.x > 9.9, "{last}");
        let expected = (DVec2::new(60.0, 0.0) - last).length() / 0.2 * 20.0;
        assert!((plan.chosen.beyond_cost / expected - 1.0).abs() < 0.1, "{}", plan.chosen.beyond_cost);
    }

    #[test]
    fn a_blocked_goal_is_told_and_a_free_cell_beside_it_is_planned_to() {
        let wall = with_wall(-5.0, 2.0);
        let beside = plan(&wall, DVec2::new(3.4, 0.0)).unwrap();
        assert!(beside.short_of_goal_m > 0.05 && beside.short_of_goal_m < 0.5);
        let error = plan(&wall, DVec2::new(3.0, 0.0)).unwrap_err();
        assert!(error.to_string().contains("inside of an obstacle"), "{error}");
    }

    /// A ring of obstacles, 1.5 to 2 m around (6, 0) m, with cells of this fused cost inside.
    fn ring(inside: u8) -> Sensed {
        let mut sensed = with_wall(20.0, 20.0);
        for at in 0..sensed.fused.len() {
            let centre = sensed.centre(Place::new((at % 101) as i32, (at / 101) as i32));
            let away_m = centre.distance(DVec2::new(6.0, 0.0));
            sensed.fused[at] = if away_m < 1.5 { inside } else { 0 };
            sensed.fused[at] = if (1.5..2.0).contains(&away_m) { 250 } else { sensed.fused[at] };
        }
        sensed
    }

    /// A plan from the origin to a goal, or to a cell within a distance of it, m.
    fn plan_near(sensed: &Sensed, goal: DVec2, approach_m: f64, is_passed: bool) -> Result<Plan, NoPlan> {
        let vehicle = Pose::from_xy_yaw(0.05, 0.05, 0.0);
        let past = Past::default();
        let task = Task { sensed, vehicle: &vehicle, goal, approach_m, is_passed, past, alternative_m: 1.5 };
        Planner::default().plan(&task, &rules())
    }

    #[test]
    fn a_goal_in_the_hedge_around_a_clearing_is_planned_to_from_outside_where_that_can_be_reached() {
        let closed = Err(NoPlan::NoPath(NoPath::NotConnected));
        // 1.6 m from the middle: free cells inside of the ring are nearer than those outside of it.
        let goal = DVec2::new(4.4, 0.0);
        let plan = |approach_m: f64, is_passed: bool| plan_near(&ring(0), goal, approach_m, is_passed);
        let beside = plan(4.0, false).unwrap();
        assert!((0.7..1.5).contains(&beside.short_of_goal_m), "{}", beside.short_of_goal_m);
        let end = beside.chosen.steps.last().unwrap().at;
        assert!(end.distance(DVec2::new(6.0, 0.0)) > 2.0, "{end}");
        assert_eq!(plan(0.75, false), closed, "free cells near to the goal, but none that can be reached");
        assert_eq!(plan(4.0, true), closed, "a point of a path that leads through the hedge");
    }

    #[test]
    fn a_goal_inside_of_an_obstacle_that_is_seen_from_outside_is_told_and_one_in_a_clearing_has_no_way() {
        let plan = |sensed: &Sensed, is_passed: bool| plan_near(sensed, DVec2::new(6.0, 0.0), 4.0, is_passed);
        let closed = Err(NoPlan::NoPath(NoPath::NotConnected));
        let unknown = ring(255);
        let beside = plan(&unknown, false).unwrap();
        assert!((2.0..3.0).contains(&beside.short_of_goal_m), "{}", beside.short_of_goal_m);
        assert_eq!(plan(&unknown, true), closed, "a point of a path that leads through an obstacle");
        assert_eq!(plan(&ring(0), false), closed, "a clearing");
    }

    #[test]
    fn zones_that_close_the_way_are_told_from_obstacles_that_do() {
        let corners = [(4.0, -20.0), (5.0, -20.0), (5.0, 20.0), (4.0, 20.0)];
        let zone = Polygon::new(corners.map(DVec2::from)).unwrap();
        let zones = Zones { keep_out: vec![zone], ..Zones::default() };
        let past = Past { zones: Some(&zones), ..Past::default() };
        let to = |sensed: &Sensed, x_m: f64| plan_with(sensed, DVec2::new(x_m, 0.0), past);
        let free = with_wall(20.0, 20.0);
        assert_eq!(to(&free, 8.0), Err(NoPlan::Forbidden));
        assert!(to(&free, 2.0).is_ok(), "before the zone");
        let closed = with_wall(-20.0, 20.0);
        assert_eq!(to(&closed, 8.0), Err(NoPlan::NoPath(NoPath::NotConnected)));
    }

    #[test]
    fn obstacles_from_one_end_of_the_world_to_the_other_close_the_way_and_an_area_that_is_stated_does() {
        let corners = [(-9.0, -3.0), (9.0, -3.0), (9.0, 3.0), (-9.0, 3.0)];
        let area = Some(Polygon::new(corners.map(DVec2::from)).unwrap());
        let wall = with_wall(-4.0, 4.0);
        let to_goal = |is_area_of_world: bool| {
            let zones = Zones { area: area.clone(), is_area_of_world, ..Zones::default() };
            plan_with(&wall, DVec2::new(6.0, 0.0), Past { zones: Some(&zones), ..Past::default() })
        };
        assert_eq!(to_goal(true), Err(NoPlan::NoPath(NoPath::NotConnected)));
        assert_eq!(to_goal(false), Err(NoPlan::Forbidden));
    }

    #[test]
    fn no_way_and_places_off_the_map_are_told() {
        let closed = with_wall(-20.0, 20.0);
        assert_eq!(plan(&closed, DVec2::new(6.0, 0.0)), Err(NoPlan::NoPath(NoPath::NotConnected)));
        let mut elsewhere = closed;
        elsewhere.corner = DVec2::splat(50.0);
        assert!(matches!(plan(&elsewhere, DVec2::ZERO), Err(NoPlan::OffTheMap(_))));
    }
}
