//! Registers the map of an earlier run against what is sensed, before it is believed (Albus 2006a, 5).
//!
//! Both runs know their position to about a metre, so the remembered map lies up to a few metres beside the ground that
//! it shows. It is moved, by whole cells, to where its obstacles agree best with those that are sensed near the vehicle
//! and its track. Both runs know their heading to a few degrees, which tells only over the length of a track: a map that
//! is registered is turned by and by.
//! Of the obstacle cells that can be compared, these disagree: sensed ones on remembered ground, and remembered ones on
//! sensed ground. Edges may differ by a cell.

use crate::memory::{Rectangle, is_obstacle};
use rcs_geom::DVec2;
use rcs_world::UNKNOWN_COST;
use serde::{Deserialize, Serialize};

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
        seen
    }

    /// The same in another frame.
    #[must_use]
    pub fn placed(&self, to_frame: impl Fn(DVec2) -> DVec2) -> Seen {
        let placed = |places: &[DVec2]| places.iter().map(|&at| to_frame(at)).collect();
        Seen { obstacles: placed(&self.obstacles), ground: placed(&self.ground) }
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
        let class = |&[column, row]: &Cell| self.class([column - east, row - north]);
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

    /// The best fit if it is moved by whole cells, up to a distance east and north from a place, m. A metre of motion from
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
        let steps = (within_m / cell_size_m).floor() as i32;
        let shifts = (-steps..=steps).flat_map(|north| (-steps..=steps).map(move |east| [east, north]));
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

#[cfg(test)]
#[path = "register_tests.rs"]
mod tests;
