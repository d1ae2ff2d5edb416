//! Registers the map of an earlier run against what is sensed, before it is believed (Albus 2006a, 5).
//!
//! Both runs know their position to about a metre, so the remembered map lies up to a few metres beside the ground that
//! it shows. It is moved, by whole cells, to where its obstacles agree best with those that are sensed near the vehicle
//! and its track. Both runs know their heading to a few degrees, which tells only over the length of a track: a map that
//! is registered is turned by and by.
//! Of the obstacle cells that can be compared, these disagree: sensed ones on remembered ground, and remembered ones on
//! sensed ground. Edges may differ by a cell.

use crate::memory::{MemoryError, Rectangle, is_obstacle, parse};
use crate::proto::MapMemoryParams;
use rcs_geom::{DVec2, Pose};
use rcs_sense::Origin;
use rcs_world::UNKNOWN_COST;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Support that a metre of motion must gain once a map is registered, when it is moved by up to this far at a time, m, or a
/// cell where cells are larger, because the local frame drifts slowly.
const FOLLOW_WORTH: f64 = 0.1;
const FOLLOW_M: f64 = 0.4;
/// Angle by which a registered map is turned at a time, rad, support that a radian must gain, and greatest angle from
/// where the estimate of the heading puts it, rad.
const TURN_RAD: f64 = 0.5 * std::f64::consts::PI / 180.0;
const TURN_WORTH: f64 = 1.7;
const MOST_TURN_RAD: f64 = 8.0 * std::f64::consts::PI / 180.0;
/// Distance from the vehicle at which a turn counts as a motion, m.
const LEVER_M: f64 = 20.0;

/// Cells of each kind that are compared at most, evenly chosen, and number of steps by which a map is moved at most in each
/// direction, which are at least this long, m: cells of a centimetre would take minutes.
const MOST_COMPARED: usize = 40_000;
const MOST_STEPS: f64 = 50.0;
const LEAST_STEP_M: f64 = 0.2;

/// What is sensed near the vehicle and its track: positions, m.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Seen {
    obstacles: Vec<DVec2>,
    /// Those that do not lie beside an obstacle.
    ground: Vec<DVec2>,
}

impl Seen {
    /// The cells of a map within a distance of places, m, in the frame of the map.
    pub fn of(map: &Rectangle, places: &[DVec2], within_m: f64) -> Seen {
        let mut is_near = vec![false; map.costs.len()];
        for &place in places {
            map.near(place, within_m).into_iter().for_each(|index| is_near[index] = true);
        }
        let mut seen = Seen::default();
        let known = map.costs.iter().zip(is_near).enumerate();
        for (index, (&cost, _)) in known.filter(|(_, (cost, near))| *near && **cost != UNKNOWN_COST) {
            let centre = map.centre(index);
            if is_obstacle(cost) {
                seen.obstacles.push(centre);
            } else if !map.is_beside_obstacle(centre) {
                seen.ground.push(centre);
            }
        }
        thin(&mut seen.obstacles);
        thin(&mut seen.ground);
        seen
    }

    /// The same in another frame.
    #[must_use]
    pub fn placed(&self, to_frame: impl Fn(DVec2) -> DVec2) -> Seen {
        let placed = |places: &[DVec2]| places.iter().map(|&at| to_frame(at)).collect();
        Seen { obstacles: placed(&self.obstacles), ground: placed(&self.ground) }
    }
}

/// Leaves so many places that they can be compared.
fn thin(places: &mut Vec<DVec2>) {
    let every = places.len().div_ceil(MOST_COMPARED);
    if every > 1 {
        *places = places.iter().copied().step_by(every).collect();
    }
}

/// How a remembered map agrees with what is sensed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Fit {
    /// By how much the remembered map is moved, m.
    pub moved: DVec2,
    /// Share of the compared obstacle cells that agree.
    pub agreement: f64,
    /// Number of obstacle cells that were compared.
    pub compared: usize,
    /// Cells that agree less those that differ, as a share of the sensed obstacle cells; one that lies beside a remembered
    /// obstacle counts half. What lies where nothing is remembered supports nothing: of two parallel walls, one that lies
    /// on the other agrees, and supports half.
    pub support: f64,
}

/// A remembered map, prepared for comparing.
#[derive(Clone, Debug, PartialEq)]
pub struct Remembered {
    /// The map.
    pub map: Rectangle,
    classes: Vec<Class>,
}

/// What a sensed cell is compared with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Class {
    Unknown,
    /// Known, and no obstacle in or beside the cell.
    Ground,
    /// No obstacle, but one in a cell beside it; the cell itself may be unknown.
    Beside,
    Obstacle,
}

/// Column and row, from the south-west corner of a map; they may lie outside.
type Cell = [i32; 2];

impl Remembered {
    /// Prepares a map.
    pub fn new(map: Rectangle) -> Remembered {
        let columns = map.columns.max(1) as i32;
        let rows = map.costs.len() as i32 / columns;
        let mut classes: Vec<Class> = map
            .costs
            .iter()
            .map(|&cost| if cost == UNKNOWN_COST { Class::Unknown } else { Class::Ground })
            .collect();
        for (at, _) in map.costs.iter().enumerate().filter(|(_, cost)| is_obstacle(**cost)) {
            let (column, row) = (at as i32 % columns, at as i32 / columns);
            for row in (row - 1).max(0)..=(row + 1).min(rows - 1) {
                for column in (column - 1).max(0)..=(column + 1).min(columns - 1) {
                    let class = &mut classes[(row * columns + column) as usize];
                    if *class != Class::Obstacle {
                        *class = Class::Beside;
                    }
                }
            }
            classes[at] = Class::Obstacle;
        }
        Remembered { map, classes }
    }

    /// The cells of positions, m.
    fn cells(&self, places: &[DVec2], moved: DVec2) -> Vec<Cell> {
        let cell = |&place: &DVec2| {
            let cell = ((place - moved - self.map.corner) / self.map.cell_size_m).floor();
            [cell.x as i32, cell.y as i32]
        };
        places.iter().map(cell).collect()
    }

    fn class(&self, [column, row]: Cell) -> Class {
        if column < 0 || row < 0 || column as usize >= self.map.columns {
            return Class::Unknown;
        }
        self.classes.get(row as usize * self.map.columns + column as usize).copied().unwrap_or(Class::Unknown)
    }

    /// How it agrees if it is moved, m.
    pub fn compare(&self, seen: &Seen, moved: DVec2) -> Fit {
        let (obstacles, ground) = (self.cells(&seen.obstacles, moved), self.cells(&seen.ground, moved));
        self.compare_cells(&obstacles, &ground, [0, 0], moved)
    }

    /// The same by cells, which the map is moved by a number of cells against.
    fn compare_cells(
        &self,
        obstacles: &[Cell],
        ground: &[Cell],
        [east, north]: [i32; 2],
        moved: DVec2,
    ) -> Fit {
        // Cells of very distant positions are the first and the last of their type.
        let class =
            |&[column, row]: &Cell| self.class([column.saturating_sub(east), row.saturating_sub(north)]);
        let (mut agree, mut beside, mut differ) = (0_usize, 0_usize, 0_usize);
        for cell in obstacles {
            match class(cell) {
                Class::Obstacle => agree += 1,
                Class::Beside => (agree, beside) = (agree + 1, beside + 1),
                Class::Ground => differ += 1,
                Class::Unknown => {}
            }
        }
        differ += ground.iter().filter(|cell| class(cell) == Class::Obstacle).count();
        let compared = agree + differ;
        Fit {
            moved,
            agreement: agree as f64 / compared.max(1) as f64,
            compared,
            support: (agree as f64 - 0.5 * beside as f64 - differ as f64) / obstacles.len().max(1) as f64,
        }
    }

    /// The best fit if it is moved by whole cells (several where they are small), up to a distance east and north from a place, m. A metre of motion from
    /// there must gain this much support; of fits that are as good, the one that moves it least counts. `None` if fewer
    /// cells than `least` can be compared.
    pub fn register(
        &self,
        seen: &Seen,
        from: DVec2,
        within_m: f64,
        worth_of_metre: f64,
        least: usize,
    ) -> Option<Fit> {
        let cell_size_m = self.map.cell_size_m;
        let cells = (LEAST_STEP_M.max(within_m / MOST_STEPS) / cell_size_m * (1.0 - 1e-9)).ceil().max(1.0);
        let steps = (within_m / (cell_size_m * cells)).floor() as i32;
        let steps = move || (-steps..=steps).map(move |step| step * cells as i32);
        let shifts = steps().flat_map(|north| steps().map(move |east| [east, north]));
        let worth = |fit: &Fit| fit.support - worth_of_metre * fit.moved.distance(from);
        let (obstacles, ground) = (self.cells(&seen.obstacles, from), self.cells(&seen.ground, from));
        let fit = |[east, north]: [i32; 2]| {
            let moved = from + DVec2::new(east.into(), north.into()) * cell_size_m;
            self.compare_cells(&obstacles, &ground, [east, north], moved)
        };
        shifts
            .map(fit)
            .filter(|fit| fit.compared >= least)
            .reduce(|best, fit| if worth(&fit) > worth(&best) { fit } else { best })
    }
}

/// Where the remembered map lies in the local frame, which drifts far less than the estimate of the global one jumps: the
/// frames when it was registered, and how it fits since.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Placed {
    pub(crate) global_from_local: Pose,
    pub(crate) fit: Fit,
}

impl Placed {
    /// A position of the local frame in the frame of the remembered map, m.
    pub(crate) fn to_remembered(self, at: DVec2) -> DVec2 {
        (self.global_from_local * at.extend(0.0)).truncate() - self.fit.moved
    }

    /// The frame of the remembered map in the local one.
    pub(crate) fn local_from_remembered(self) -> Pose {
        self.global_from_local.inverse() * Pose::from_translation(self.fit.moved.extend(0.0))
    }

    /// The angle from the estimate of the local frame in the global one to that with which it lies here, rad.
    pub(crate) fn turned_rad(self, estimated: &Pose) -> f64 {
        (estimated.inverse() * self.global_from_local).yaw()
    }

    /// The best place near this one: moved by up to a cell, and turned by up to a step about the middle of what is
    /// compared, which a turn does not move.
    pub(crate) fn followed(
        self,
        remembered: &Remembered,
        seen_in_local: &Seen,
        middle: DVec2,
        estimated: &Pose,
        least: usize,
    ) -> Placed {
        let from = self.fit.moved;
        let within_m = FOLLOW_M.max(remembered.map.cell_size_m);
        let worth = |&(turn_rad, placed): &(f64, Placed)| {
            let fit = placed.fit;
            fit.support - FOLLOW_WORTH * fit.moved.distance(from) - TURN_WORTH * f64::abs(turn_rad)
        };
        let turns = [0.0, TURN_RAD, -TURN_RAD].into_iter();
        let places = turns.filter_map(|turn_rad| {
            let global_from_local = turned(&self.global_from_local, middle, turn_rad);
            let seen = seen_in_local.placed(|place| at(&global_from_local, place));
            let fit = remembered.register(&seen, from, within_m, FOLLOW_WORTH, least)?;
            let placed = Placed { global_from_local, fit };
            // One that lies farther from the estimate is turned back.
            let most_rad = MOST_TURN_RAD.max(self.turned_rad(estimated).abs());
            let is_allowed = turn_rad == 0.0 || placed.turned_rad(estimated).abs() <= most_rad;
            is_allowed.then_some((turn_rad, placed))
        });
        let best = places.reduce(|best, other| if worth(&other) > worth(&best) { other } else { best });
        best.map_or(self, |(_, placed)| placed)
    }
}

/// A position of the local frame in the global one, m.
pub(crate) fn at(global_from_local: &Pose, place: DVec2) -> DVec2 {
    (*global_from_local * place.extend(0.0)).truncate()
}

/// How far a frame is moved from where it was before, m: the greatest distance between both near a position.
pub(crate) fn moved_m(frame: &Pose, before: &Pose, near: DVec2) -> f64 {
    let corners = [DVec2::X, DVec2::Y, DVec2::NEG_X, DVec2::NEG_Y].map(|side| near + LEVER_M * side);
    let moved = corners.map(|corner| at(frame, at(&before.inverse(), corner)).distance(corner));
    moved.into_iter().fold(0.0, f64::max)
}

/// The local frame in the global one, turned about a position of the local frame, m.
pub(crate) fn turned(global_from_local: &Pose, about: DVec2, angle_rad: f64) -> Pose {
    let centre = at(global_from_local, about);
    let back = Pose::from_translation((-centre).extend(0.0));
    Pose::from_xy_yaw(centre.x, centre.y, angle_rad) * back * *global_from_local
}

/// The map of the parameters, which is read once.
#[derive(Clone, Debug, Default)]
pub(crate) struct FromParams {
    /// The texts of the map and of the world.
    texts: Option<(String, String)>,
    /// The map in the global frame; `None` if there is none.
    pub(crate) map: Option<Result<Arc<Remembered>, String>>,
}

impl FromParams {
    /// Whether these parameters were read.
    pub(crate) fn is_of(&self, params: &MapMemoryParams) -> bool {
        let is_same = |(memory, world): &(String, String)| *memory == params.memory && *world == params.world;
        self.texts.as_ref().is_some_and(is_same)
    }

    /// Reads the map of the parameters.
    pub(crate) fn read(params: &MapMemoryParams) -> FromParams {
        let read = |origin: Origin| -> Result<Option<Arc<Remembered>>, MemoryError> {
            let map = parse(&params.memory)?.map(|map| Rectangle::of_memory(&map, &origin.0)).transpose()?;
            Ok(map.map(|map| Arc::new(Remembered::new(map))))
        };
        // Without an origin, the process waits for other parameters.
        let map = Origin::from_toml(&params.world).ok().map(read);
        let map = map.and_then(|map| map.map_err(|error| format!("memory: {error}")).transpose());
        FromParams { texts: Some((params.memory.clone(), params.world.clone())), map }
    }
}

#[cfg(test)]
#[path = "register_tests.rs"]
mod tests;
