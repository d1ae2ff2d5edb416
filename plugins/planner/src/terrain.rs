//! What it costs to enter a cell: the terms that a planner's cost consists of.
//!
//! Albus 2006a, 5: the planner "takes a 201 x 201 enumerated terrain grid, classifies the grid, and translates it into a
//! grid of costs of the same size. In most cases the cost is simply looked up in a small table"; "costs are lowered for
//! cells directly in front of the vehicle and increased behind the vehicle". Albus 2006b, 3.5: "by lowering costs of
//! unknown obstacles near the vehicle, it does not hesitate to move".
//!
//! A cell's cost is the sum of six terms, limited to 1 to 250:
//!
//! | term | what |
//! | --- | --- |
//! | terrain | from the table, by the fused cost of the cell; another entry for unknown cells; the mean of the cells that the vehicle covers there |
//! | clearance | grows towards obstacles, from the desired clearance to the least one, with the cube of what lacks |
//! | heading | less ahead of the vehicle, more behind it; fades with the distance from it |
//! | memory | negative: along a way that an earlier run has driven; a share of terrain and clearance, because it was free and wide enough; fades with the distance |
//! | previous | negative: along the path that was planned before; a share of the terrain's cost; so that the vehicle does not waver between paths that cost nearly the same |
//! | relief | negative: near the vehicle an unknown cell is taken for clear, and what is blocked for passable at a high cost |
//!
//! In a place that is barred, terrain and clearance are dearer by a factor.
//!
//! A cell is blocked if the table blocks it, or if the vehicle standing there would touch such a cell. What the bumper
//! hit, and where the vehicle must not drive, is blocked without relief. The papers name no values; here they are
//! parameters.

use crate::barred::Barred;
use crate::borders::keep_side;
use crate::clearance::{Clearance, MAX_BOUND};
use crate::costs::{BLOCKED, CostGrid, CostGridError, MAX_COST};
use crate::ground::Ground;
use crate::place::Place;
use crate::sensed::{Sensed, around};
use crate::zones::Zones;
use rcs_geom::{DVec2, Pose};
use rcs_world::UNKNOWN_COST;

/// The rules of cost; see the parameters of the process.
#[derive(Clone, Debug, PartialEq)]
pub struct Rules {
    /// The table: the highest fused cost of each class of terrain, and its cost; [`BLOCKED`] for none. Ascending; fused
    /// costs above the last one are blocked.
    pub table: Vec<(u8, u8)>,
    /// Cost of unknown cells.
    pub unknown: u8,
    /// Cost of unknown cells near the vehicle, and near where it was.
    pub unknown_near: u8,
    /// Half the width of the vehicle, m.
    pub half_width_m: f64,
    /// Half the width of the vehicle and the least distance beside it, m.
    pub least_room_m: f64,
    /// The same for cells to which the vehicle has not come nearer than [`Rules::near_m`]: range noise thickens what is
    /// far away.
    pub far_room_m: f64,
    /// Distance from the vehicle, and from where it was, from which on the far room counts, m.
    pub near_m: f64,
    /// Clearance term where only the far room suffices.
    pub narrow: f64,
    /// Obstacles that have not been seen from nearer than this do not block, m: a few wrong ranges may be all that there
    /// is.
    pub sure_m: f64,
    /// Cost of a cell with such an obstacle.
    pub unsure: u8,
    /// Half the width and the desired distance beside it, m.
    pub wish_room_m: f64,
    /// Clearance term at the least room.
    pub clearance: f64,
    /// Share of the terrain's cost that it loses straight ahead of the vehicle, and gains behind it.
    pub heading: f64,
    /// Distance from the vehicle at which the heading no longer counts, m.
    pub heading_range_m: f64,
    /// Distance from the vehicle up to which there is relief, m.
    pub relief_range_m: f64,
    /// Share of the costs of terrain and clearance that a cell on a way that was driven before loses.
    pub route: f64,
    /// Distance from that way at which cells are no longer cheaper, m.
    pub route_range_m: f64,
    /// Cost of a cell that would be blocked without relief.
    pub relief_cost: u8,
    /// Factor by which terrain and clearance are dearer in barred places where the wheels slipped.
    pub slipped: f64,
    /// Share of the terrain's cost that a cell on the path that was planned before loses.
    pub previous: f64,
    /// Distance from that path at which cells are no longer cheaper, m.
    pub previous_range_m: f64,
}

impl Rules {
    /// Rules without terms: no terrain has a cost, the vehicle has no width, and all obstacles block.
    pub(crate) fn plain() -> Rules {
        Rules {
            table: Vec::new(),
            unknown: 1,
            unknown_near: 1,
            half_width_m: 0.0,
            least_room_m: 0.0,
            far_room_m: 0.0,
            near_m: f64::INFINITY,
            narrow: 0.0,
            sure_m: f64::INFINITY,
            unsure: MAX_COST,
            wish_room_m: 0.0,
            clearance: 0.0,
            heading: 0.0,
            heading_range_m: 0.0,
            relief_range_m: 0.0,
            route: 0.0,
            route_range_m: 0.0,
            relief_cost: MAX_COST,
            slipped: 1.0,
            previous: 0.0,
            previous_range_m: 0.0,
        }
    }
}

/// What a planner remembers; positions in the map's frame, m.
#[derive(Clone, Copy, Debug, Default)]
pub struct Past<'a> {
    /// A way that an earlier run has driven.
    pub route: &'a [DVec2],
    /// The path that was planned before.
    pub previous: &'a [DVec2],
    /// Where the vehicle was.
    pub track: &'a [DVec2],
    /// Places that it could not get over, map's frame.
    pub barred: &'a [Barred],
    /// Where it must not drive, map's frame; `None` for nowhere.
    pub zones: Option<&'a Zones>,
}

/// The terms of the cost of a cell.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Terms {
    /// From the table.
    pub terrain: f32,
    /// Nearness of obstacles.
    pub clearance: f32,
    /// Ahead of the vehicle or behind it.
    pub heading: f32,
    /// Relief near the vehicle.
    pub relief: f32,
    /// Along a way that an earlier run has driven.
    pub memory: f32,
    /// Along the path that was planned before.
    pub previous: f32,
}

impl Terms {
    /// Their sum.
    pub fn total(&self) -> f32 {
        self.terrain + self.clearance + self.heading + self.relief + self.memory + self.previous
    }

    /// The same terms for a step of a length, added to others.
    #[must_use]
    pub fn plus(self, other: Terms, length: f32) -> Terms {
        Terms {
            terrain: self.terrain + other.terrain * length,
            clearance: self.clearance + other.clearance * length,
            heading: self.heading + other.heading * length,
            relief: self.relief + other.relief * length,
            memory: self.memory + other.memory * length,
            previous: self.previous + other.previous * length,
        }
    }
}

/// Why a cell cannot be entered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Obstruction {
    /// There is an obstacle in it.
    Obstacle,
    /// The vehicle does not fit between the obstacles beside it.
    TooNarrow,
}

/// The costs of a map around a vehicle, and the memory for them.
#[derive(Clone, Debug, Default)]
pub struct Terrain {
    is_obstacle: Vec<bool>,
    room: Clearance,
    /// Clearance term by squared distance to the nearest obstacle, cells²; `None` where the vehicle does not fit.
    by_room: Vec<Option<f32>>,
    /// The same far from the vehicle.
    by_far_room: Vec<Option<f32>>,
    /// Clearance term at the least room.
    least_clearance: f32,
    /// Cost by fused cost, from the table; `None` where blocked.
    by_cost: Vec<Option<u8>>,
    /// What the ground costs that the vehicle covers: where its centre is on a firm path, its wheels may be in the mud.
    ground: Ground,
    squared: Vec<u16>,
    /// Nearness of the way that an earlier run has driven: 1 on it, 0 out of its range; empty without one.
    by_route: Vec<f32>,
    /// The same of the path that was planned before.
    by_previous: Vec<f32>,
    /// Whether the vehicle fits between the cell and its neighbours, although not in its middle; empty if it never does.
    fits_beside: Vec<bool>,
    /// Whether the vehicle is or was near the cell; empty if that makes no difference.
    was_near: Vec<bool>,
    /// Whether an obstacle in the cell is certain, because it was seen from near; empty if all are.
    is_sure: Vec<bool>,
    /// Whether the vehicle must not drive in the cell, whatever is in it; empty if it may in all.
    forbidden: Vec<bool>,
    /// Factor by which terrain and clearance are dearer because the cell belongs to a place that is barred; empty if none
    /// does.
    barred: Vec<f32>,
}

impl Terrain {
    /// The grid of costs for a vehicle at a pose.
    pub fn costs(
        &mut self,
        sensed: &Sensed,
        vehicle: &Pose,
        past: &Past<'_>,
        rules: &Rules,
    ) -> Result<CostGrid, CostGridError> {
        self.by_cost.clear();
        self.by_cost.extend((0..=255).map(|fused| looked_up(fused, rules)));
        self.is_sure.clear();
        if rules.sure_m.is_finite() {
            // That the vehicle was near tells nothing: there may have been a wall between.
            let sure_dm = (rules.sure_m * 10.0).min(254.0) as u8;
            self.is_sure.extend(sensed.seen_from_dm.iter().map(|&from_dm| (1..=sure_dm).contains(&from_dm)));
            for (is_sure, _) in self.is_sure.iter_mut().zip(&sensed.remembered).filter(|(_, known)| **known) {
                *is_sure = true;
            }
        }
        self.is_obstacle.clear();
        self.is_obstacle.extend(sensed.fused.iter().map(|&cost| self.by_cost[usize::from(cost)].is_none()));
        for (obstacle, _) in self.is_obstacle.iter_mut().zip(&self.is_sure).filter(|(_, is_sure)| !**is_sure)
        {
            *obstacle = false;
        }
        for (obstacle, _) in self.is_obstacle.iter_mut().zip(&sensed.bumped).filter(|(_, bumped)| **bumped) {
            *obstacle = true;
        }
        let reach = (rules.half_width_m / sensed.cell_size_m + 0.5) as usize;
        let ground = sensed.fused.iter().map(|&cost| self.by_cost[usize::from(cost)]);
        self.ground.lay(sensed.columns, ground, reach);
        self.forbid(sensed, vehicle, past, rules);
        self.bar(sensed, past, rules);
        let bound = (rules.wish_room_m / sensed.cell_size_m).ceil().clamp(1.0, MAX_BOUND as f64) as usize;
        let by_room = |least_room_m: f64| {
            move |squared: usize| {
                // An obstacle reaches to the border of its cell.
                let room_m = (libm::sqrt(squared as f64) - 0.5) * sensed.cell_size_m;
                let lacks = (rules.wish_room_m - room_m) / (rules.wish_room_m - rules.least_room_m).max(1e-9);
                let lacks = lacks.clamp(0.0, 1.0);
                (room_m >= least_room_m || squared > bound * bound)
                    .then_some((rules.clearance * lacks * lacks * lacks) as f32)
            }
        };
        let squares = 0..=(bound + 1) * (bound + 1);
        self.by_room.clear();
        self.by_room.extend(squares.clone().map(by_room(rules.least_room_m)));
        self.by_far_room.clear();
        let narrow = rules.narrow as f32;
        let by_far_room = by_room(rules.far_room_m.min(rules.least_room_m));
        self.by_far_room
            .extend(squares.map(|squared| by_far_room(squared).map(|clearance| clearance + narrow)));
        self.squared.clear();
        self.squared.extend_from_slice(self.room.squared(sensed.columns, &self.is_obstacle, bound));
        nearness(sensed, past.route, rules.route, rules.route_range_m, &mut self.by_route);
        nearness(sensed, past.previous, rules.previous, rules.previous_range_m, &mut self.by_previous);
        self.mark_near(sensed, vehicle, past.track, rules);
        self.find_fits(sensed.columns, sensed.cell_size_m, rules);
        let mut cells: Vec<u8> = sensed
            .fused
            .iter()
            .zip(&self.squared)
            .enumerate()
            .map(|(at, (&fused, &squared))| {
                let room = self.room_of(at, squared);
                let terms = self.terrain_of(at, fused, rules).zip(room);
                terms.map_or(BLOCKED, |(terrain, clearance)| {
                    let [memory, previous] = self.remembered(at, terrain, clearance, rules);
                    limited(terrain + clearance + memory + previous)
                })
            })
            .collect();
        self.near_the_vehicle(sensed, vehicle, rules, &mut cells);
        CostGrid::new(sensed.columns, cells.len() / sensed.columns.max(1), cells)
    }

    /// Marks the cells in which the vehicle must not drive, and those that the border of a zone crosses: a
    /// zone may be thinner than a cell. A vehicle that has come into one can leave it to the nearest cell
    /// that is allowed; one that stands beside it cannot enter it, but keeps no distance there, so that it can turn.
    fn forbid(&mut self, sensed: &Sensed, vehicle: &Pose, past: &Past<'_>, rules: &Rules) {
        self.forbidden.clear();
        let Some(zones) = past.zones.filter(|zones| !zones.is_empty()) else { return };
        let position = vehicle.translation.truncate();
        // How far it is to where the vehicle would be allowed; the nearest border may lead into another zone.
        let mut trespasses = zones.forbid(position);
        let mut trespass_m = if trespasses { f64::INFINITY } else { 0.0 };
        let columns = sensed.columns.max(1);
        let rows = sensed.fused.len() / columns;
        for row in 0..rows {
            let centre = |column: usize| sensed.centre(Place::new(column as i32, row as i32));
            let is_forbidden = zones.forbid_along(centre(0).y);
            for at in (0..columns).map(centre) {
                let is_forbidden = is_forbidden(at.x);
                if !is_forbidden && trespasses {
                    trespass_m = trespass_m.min(at.distance(position));
                }
                self.forbidden.push(is_forbidden);
            }
        }
        let side_m = DVec2::new(columns as f64, rows as f64) * sensed.cell_size_m;
        let map = [sensed.corner, sensed.corner + side_m];
        zones.along_borders(map, sensed.cell_size_m / 2.0, |at| {
            let inside = |place: &Place| {
                (0..columns as i32).contains(&place.column) && (0..rows as i32).contains(&place.row)
            };
            if let Some(place) = sensed.place(at).filter(inside) {
                self.forbidden[sensed.index(place)] = true;
            }
        });
        let distance_m = |index: usize| {
            let place = Place::new((index % columns) as i32, (index / columns) as i32);
            sensed.centre(place).distance(position)
        };
        if !trespasses && !keep_side(&mut self.forbidden, sensed, zones, position) {
            // In a corner all cells beside that of the vehicle can be forbidden: it leaves as from the inside of a zone.
            trespasses = true;
            let allowed = self.forbidden.iter().enumerate().filter(|(_, is)| !**is);
            trespass_m = allowed.map(|(index, _)| distance_m(index)).fold(f64::INFINITY, f64::min);
        }
        let near_m = trespass_m + rules.least_room_m + sensed.cell_size_m;
        let cells = self.forbidden.iter_mut().zip(&mut self.is_obstacle).enumerate();
        for (index, (is_forbidden, is_obstacle)) in cells.filter(|(_, (is, _))| **is) {
            let is_near = distance_m(index) <= near_m;
            *is_obstacle |= !is_near;
            *is_forbidden = !(is_near && trespasses);
        }
    }

    /// Marks the cells from which the vehicle reaches into a place that is barred. They are dear but not blocked, because
    /// such a place may be on the only way. Where the wheels slipped the place is a guess of how far the slippery ground
    /// reaches, so what the map knows counts there as elsewhere, times a factor: a firm path through mud that the place
    /// covers is cheaper than the mud, and close to an obstacle it is not.
    fn bar(&mut self, sensed: &Sensed, past: &Past<'_>, rules: &Rules) {
        self.barred.clear();
        for place in past.barred {
            self.barred.resize(sensed.fused.len(), 1.0);
            let factor = if place.slipped { rules.slipped as f32 } else { f32::from(MAX_COST) };
            around(sensed, DVec2::from(place.at), place.radius_m + rules.least_room_m, |place, _| {
                let cell = &mut self.barred[sensed.index(place)];
                *cell = cell.max(factor);
            });
        }
    }

    /// A term of a cell, dearer where that belongs to a place that is barred.
    fn barred(&self, at: usize, term: f32) -> f32 {
        self.barred.get(at).map_or(term, |factor| (term * factor).min(f32::from(MAX_COST)))
    }

    /// The clearance term of a cell by its squared distance from the nearest obstacle; `None` where the vehicle does not
    /// fit.
    fn room_of(&self, at: usize, squared: u16) -> Option<f32> {
        let fits_beside = self.fits_beside.get(at).is_some_and(|&fits| fits);
        let near = self.by_room[usize::from(squared)].or_else(|| fits_beside.then_some(self.least_clearance));
        // Far cells differ only where the vehicle would not fit.
        if near.is_some() || self.was_near.get(at).is_none_or(|&was_near| was_near) {
            return near.map(|clearance| self.barred(at, clearance));
        }
        self.by_far_room[usize::from(squared)].map(|clearance| self.barred(at, clearance))
    }

    /// Marks the cells of each block of two by two cells without an obstacle, where cells are so coarse that the vehicle
    /// fits there: from the middle of the block it is one cell to the nearest obstacle, and from the middle of a cell half
    /// of one.
    fn find_fits(&mut self, columns: usize, cell_size_m: f64, rules: &Rules) {
        self.fits_beside.clear();
        self.least_clearance = rules.clearance as f32;
        if rules.least_room_m > cell_size_m || columns < 2 {
            return;
        }
        self.fits_beside.resize(self.is_obstacle.len(), false);
        for at in 0..self.is_obstacle.len().saturating_sub(columns + 1) {
            let block = [at, at + 1, at + columns, at + columns + 1];
            if at % columns + 1 < columns && block.iter().all(|&at| !self.is_obstacle[at]) {
                for at in block {
                    self.fits_beside[at] = true;
                }
            }
        }
    }

    /// Whether the vehicle must not drive in a cell, whatever is in it.
    fn is_forbidden(&self, at: usize) -> bool {
        self.forbidden.get(at).is_some_and(|&forbidden| forbidden)
    }

    /// The terrain term of a cell with this fused cost; `None` if it is blocked.
    fn terrain_of(&self, at: usize, fused: u8, rules: &Rules) -> Option<f32> {
        if self.is_forbidden(at) {
            return None;
        }
        let unsure =
            || self.is_sure.get(at).is_some_and(|&is_sure| !is_sure).then_some(f32::from(rules.unsure));
        let terrain = self.ground.mean(at).or_else(unsure);
        let is_hidden = fused == UNKNOWN_COST && self.was_near.get(at).is_some_and(|&was_near| was_near);
        let terrain = if is_hidden { terrain.map(|_| f32::from(rules.unknown_near)) } else { terrain };
        terrain.map(|terrain| self.barred(at, terrain))
    }

    /// Marks the cells near the vehicle, and near where it was.
    fn mark_near(&mut self, sensed: &Sensed, vehicle: &Pose, track: &[DVec2], rules: &Rules) {
        self.was_near.clear();
        let is_same = rules.far_room_m >= rules.least_room_m && rules.unknown_near == rules.unknown;
        if is_same || !rules.near_m.is_finite() {
            return;
        }
        mark(sensed, vehicle, track, rules.near_m, &mut self.was_near);
    }

    /// The memory term and the previous path's term of a cell with these terms of terrain and clearance. What was driven
    /// is known to be wide enough; what was planned is not.
    fn remembered(&self, at: usize, terrain: f32, clearance: f32, rules: &Rules) -> [f32; 2] {
        let less = |nearness: &[f32], cost: f32, share: f64| {
            nearness.get(at).map_or(0.0, |near| -(cost * share as f32 * near))
        };
        let memory = less(&self.by_route, terrain + clearance, rules.route);
        [memory, less(&self.by_previous, terrain, rules.previous)]
    }

    /// Costs of the cells that have a heading term or relief.
    fn near_the_vehicle(&self, sensed: &Sensed, vehicle: &Pose, rules: &Rules, cells: &mut [u8]) {
        let range_m = rules.heading_range_m.max(rules.relief_range_m);
        around(sensed, vehicle.translation.truncate(), range_m, |place, _| {
            cells[sensed.index(place)] = match self.terms(sensed, place, vehicle, rules) {
                Ok(terms) => limited(terms.total()),
                Err(_) => BLOCKED,
            };
        });
    }

    /// The terms of a cell of the map for which the costs were made last.
    pub fn terms(
        &self,
        sensed: &Sensed,
        place: Place,
        vehicle: &Pose,
        rules: &Rules,
    ) -> Result<Terms, Obstruction> {
        let index = sensed.index(place);
        let fused = sensed.fused[index];
        let from_vehicle = sensed.centre(place) - vehicle.translation.truncate();
        let distance_m = from_vehicle.length();
        let relieved = distance_m <= rules.relief_range_m;
        let bumped = sensed.bumped.get(index).is_some_and(|&bumped| bumped);
        let terrain = self.terrain_of(index, fused, rules).filter(|_| !bumped);
        let clearance = self.room_of(index, self.squared[index]);
        let (terrain, clearance) = match (terrain, clearance) {
            (Some(terrain), Some(clearance)) => (terrain, clearance),
            (None, _) if bumped || !relieved || self.is_forbidden(index) => {
                return Err(Obstruction::Obstacle);
            }
            (Some(_), None) if !relieved => return Err(Obstruction::TooNarrow),
            _ => {
                let full = f32::from(MAX_COST);
                return Ok(Terms {
                    terrain: full,
                    relief: f32::from(rules.relief_cost) - full,
                    ..Terms::default()
                });
            }
        };
        let clear = self.by_cost[0].map_or(terrain, f32::from);
        let relief = if relieved && fused == UNKNOWN_COST { (clear - terrain).min(0.0) } else { 0.0 };
        let [memory, previous] = self.remembered(index, terrain + relief, clearance, rules);
        Ok(Terms {
            terrain,
            clearance,
            heading: heading(terrain + relief, from_vehicle, vehicle, rules),
            relief,
            memory,
            previous,
        })
    }

    /// Distance from a position to the border of the nearest obstacle, m, on the map for which the costs were made last;
    /// at most the desired room. The desired room outside of the map.
    pub fn room_m(&self, sensed: &Sensed, position: DVec2, rules: &Rules) -> f64 {
        let rows = self.squared.len() / sensed.columns.max(1);
        let inside = |place: &Place| {
            (0..sensed.columns as i32).contains(&place.column) && (0..rows as i32).contains(&place.row)
        };
        let place = sensed.place(position).filter(inside);
        place.map_or(rules.wish_room_m, |place| {
            let squared = f64::from(self.squared[sensed.index(place)]);
            ((libm::sqrt(squared) - 0.5) * sensed.cell_size_m).clamp(0.0, rules.wish_room_m)
        })
    }

    /// The nearest cell within a distance of a position, m, that is not blocked and that `would_do`; ties go to the first
    /// by rows.
    pub fn nearest_free(
        sensed: &Sensed,
        costs: &CostGrid,
        position: DVec2,
        within_m: f64,
        would_do: impl Fn(Place) -> bool,
    ) -> Option<Place> {
        let middle = sensed.place(position)?;
        let reach = (within_m / sensed.cell_size_m).ceil().min(1000.0) as i32;
        let around = -reach..=reach;
        let places = around
            .clone()
            .flat_map(|dr| around.clone().map(move |dc| Place::new(middle.column + dc, middle.row + dr)));
        let free = places.filter(|&place| costs.get(place).is_some_and(|cost| cost != BLOCKED));
        let distances = free.map(|place| (sensed.centre(place).distance(position), place));
        let near = distances
            .filter(|&(distance_m, place)| (distance_m <= within_m || place == middle) && would_do(place));
        near.reduce(|best, other| if other.0 < best.0 { other } else { best }).map(|(_, place)| place)
    }
}

/// Marks the cells within a distance of a vehicle and its track, m.
fn mark(sensed: &Sensed, vehicle: &Pose, track: &[DVec2], within_m: f64, marked: &mut Vec<bool>) {
    marked.clear();
    marked.resize(sensed.fused.len(), false);
    for &at in track.iter().chain([&vehicle.translation.truncate()]) {
        around(sensed, at, within_m, |place, _| marked[sensed.index(place)] = true);
    }
}

/// How near the cells are to points: 1 at one, 0 out of range. Empty if that makes no difference.
fn nearness(sensed: &Sensed, points: &[DVec2], share: f64, range_m: f64, near: &mut Vec<f32>) {
    near.clear();
    if points.is_empty() || share <= 0.0 || range_m <= 0.0 {
        return;
    }
    near.resize(sensed.fused.len(), 0.0);
    for &at in points {
        around(sensed, at, range_m, |place, distance_m| {
            let cell = &mut near[sensed.index(place)];
            *cell = cell.max((1.0 - distance_m / range_m) as f32);
        });
    }
}

fn looked_up(fused: u8, rules: &Rules) -> Option<u8> {
    let row = rules.table.iter().find(|&&(up_to, _)| fused <= up_to);
    let cost = if fused > MAX_COST { Some(rules.unknown) } else { row.map(|&(_, cost)| cost) };
    cost.filter(|&cost| cost != BLOCKED)
}

/// The heading term of a cell with this terrain term.
fn heading(terrain: f32, from_vehicle: DVec2, vehicle: &Pose, rules: &Rules) -> f32 {
    let distance_m = from_vehicle.length();
    if distance_m < 1e-9 || distance_m >= rules.heading_range_m {
        return 0.0;
    }
    let ahead = vehicle.rotate(rcs_geom::DVec3::X).truncate();
    let along = from_vehicle.dot(ahead) / (distance_m * ahead.length().max(1e-9));
    let fades = 1.0 - distance_m / rules.heading_range_m;
    -(f64::from(terrain) * rules.heading * along * fades) as f32
}

fn limited(cost: f32) -> u8 {
    (cost + 0.5).clamp(1.0, f32::from(MAX_COST)) as u8
}

#[cfg(test)]
#[path = "terrain_tests.rs"]
mod tests;
