//! A map that outlives its run: its file, and what it states to the world model (Albus 2006a, 5: the map and the path of
//! a run are saved for the next one).

use crate::proto::MapMemory;
use rcs_geom::{DVec2, Utm};
use rcs_msg::Stamp;
use rcs_msg::foxglove::Grid;
use rcs_sense::GridFrame;
use rcs_world::{
    GridView, GridViewError, MAX_COST, NumericType, OBSTACLE_COST, OBSTACLE_SEEN_FROM, Source, SourceKind,
    UNKNOWN_COST, Weighted, Weights, fuse_grid,
};
use serde::{Deserialize, Serialize};

/// Version of the file.
const FORMAT: u32 = 1;
/// Greatest number of cells of a remembered map.
const MOST_CELLS: usize = 4_000_000;
/// Bounds of UTM coordinates, m, as of [`Utm::new`]; eastings begin at 0.
const MOST_EASTING_M: f64 = 1_000_000.0;
const LEAST_NORTHING_M: f64 = -100_000.0;
const MOST_NORTHING_M: f64 = 10_100_000.0;

/// Why a text is no remembered map, or a map is not saved.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MemoryError {
    /// The text is not the JSON of a map.
    #[error("{0}")]
    Text(String),
    /// The file has another version.
    #[error("format is {0}, expected {FORMAT}")]
    Format(u32),
    /// The cells are not those of a rectangle.
    #[error(
        "{cells} cells in rows of {columns}, of {cell_size_m} m, expected full rows, at most {MOST_CELLS} cells, and a size"
    )]
    Cells {
        /// Number of cells.
        cells: usize,
        /// Cells per row.
        columns: u32,
        /// Size of a cell, m.
        cell_size_m: f64,
    },
    /// A cell has a cost that does not exist.
    #[error("cell {cell} has the cost {cost}, expected 0 to {MAX_COST}, or {UNKNOWN_COST} for unknown")]
    Cost {
        /// Index of the cell.
        cell: usize,
        /// Its cost.
        cost: u8,
    },
    /// The corner is nowhere in a UTM zone.
    #[error(
        "the corner is at easting {easting_m} m and northing {northing_m} m, expected 0 to {MOST_EASTING_M} m and {LEAST_NORTHING_M} to {MOST_NORTHING_M} m"
    )]
    Place {
        /// Easting of the corner, m.
        easting_m: f64,
        /// Northing of the corner, m.
        northing_m: f64,
    },
    /// The local frame has jumped in the global one, as after a jump of the position fixes.
    #[error("the local frame has jumped by {by_m:.1} m in the global one")]
    Jumped {
        /// How far, where the vehicle is, m.
        by_m: f64,
    },
    /// A rectangle has too many cells.
    #[error("the map would have {columns} by {rows} cells, expected at most {MOST_CELLS} in all")]
    Large {
        /// Cells per row.
        columns: usize,
        /// Number of rows.
        rows: usize,
    },
    /// It is not known yet where what this run saved before lies in its local frame.
    #[error("what was saved before the local frame began again stays until it is registered")]
    Unregistered,
    /// The map is in another zone than the global frame.
    #[error("the map is in UTM zone {got}, expected zone {expected} of the global frame's origin")]
    Zone {
        /// Zone of the map.
        got: u32,
        /// Zone of the origin.
        expected: u8,
    },
}

/// The map in a text; `None` for an empty one.
pub fn parse(text: &str) -> Result<Option<MapMemory>, MemoryError> {
    if text.trim().is_empty() {
        return Ok(None);
    }
    let map: MapMemory = rcs_msg::from_json(text).map_err(|error| MemoryError::Text(error.to_string()))?;
    check(&map)?;
    Ok(Some(map))
}

/// Refuses a map that is of another version, or that has numbers which no map has.
pub(crate) fn check(map: &MapMemory) -> Result<(), MemoryError> {
    if map.format != FORMAT {
        return Err(MemoryError::Format(map.format));
    }
    let (cells, columns, cell_size_m) = (map.costs.len(), map.columns, map.cell_size_m);
    let is_full = columns > 0 && cells > 0 && cells.is_multiple_of(columns as usize) && cells <= MOST_CELLS;
    if !(is_full && (0.01..=100.0).contains(&cell_size_m)) {
        return Err(MemoryError::Cells { cells, columns, cell_size_m });
    }
    let no_cost = |cost: u8| cost > MAX_COST && cost != UNKNOWN_COST;
    if let Some((cell, &cost)) = map.costs.iter().enumerate().find(|(_, cost)| no_cost(**cost)) {
        return Err(MemoryError::Cost { cell, cost });
    }
    let (easting_m, northing_m) = (map.easting_m, map.northing_m);
    let is_in_zone = (0.0..=MOST_EASTING_M).contains(&easting_m)
        && (LEAST_NORTHING_M..=MOST_NORTHING_M).contains(&northing_m);
    if !is_in_zone {
        return Err(MemoryError::Place { easting_m, northing_m });
    }
    Ok(())
}

/// Costs of the cells of a rectangle of a frame.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Rectangle {
    /// South-west corner, m.
    pub corner: DVec2,
    /// Size of a cell, m.
    pub cell_size_m: f64,
    /// Cells per row.
    pub columns: usize,
    /// By rows from the south: 0 to 250, 255 for unknown.
    pub costs: Vec<u8>,
}

impl Rectangle {
    /// A rectangle of unknown cells that contains all positions within a distance of these, m. Its corner is a multiple of
    /// the size of a cell, so that the cells of all runs are the same. Without positions it has no cells; one that would
    /// have too many cells is an error.
    pub fn around(places: &[DVec2], within_m: f64, cell_size_m: f64) -> Result<Rectangle, MemoryError> {
        let Some(&first) = places.first() else {
            return Ok(Rectangle { cell_size_m, ..Rectangle::default() });
        };
        let low = places.iter().fold(first, |low, &place| low.min(place)) - within_m;
        let high = places.iter().fold(first, |high, &place| high.max(place)) + within_m;
        let corner = (low / cell_size_m).floor() * cell_size_m;
        let cells = ((high - corner) / cell_size_m).ceil();
        let (columns, rows) = (cells.x as usize, cells.y as usize);
        let count = columns.checked_mul(rows).filter(|&count| count <= MOST_CELLS);
        let costs = vec![UNKNOWN_COST; count.ok_or(MemoryError::Large { columns, rows })?];
        Ok(Rectangle { corner, cell_size_m, columns, costs })
    }

    /// The remembered map in the global frame with this origin.
    pub fn of_memory(map: &MapMemory, origin: &Utm) -> Result<Rectangle, MemoryError> {
        if map.zone != u32::from(origin.zone) {
            return Err(MemoryError::Zone { got: map.zone, expected: origin.zone });
        }
        let corner = origin.offset_to(map.easting_m, map.northing_m);
        let (cell_size_m, columns) = (map.cell_size_m, map.columns as usize);
        Ok(Rectangle { corner, cell_size_m, columns, costs: map.costs.to_vec() })
    }

    /// The fused costs of a world model's map, in its frame.
    pub fn of_grid(view: &GridView<'_>) -> Result<Rectangle, GridViewError> {
        let mut costs = Vec::new();
        view.field_of("cost", NumericType::Uint8)?.bytes_into(&mut costs);
        Ok(Rectangle::with(view, costs))
    }

    /// What was sensed from near: the fused costs without what the source `memory` says, and without the obstacles that
    /// have not been seen from nearer than a distance, m. Where something is remembered, those of shape and touch must say it, too:
    /// what they have not sensed is unknown, and an obstacle is one by both.
    pub fn sensed_from_near(view: &GridView<'_>, within_m: f64) -> Result<Rectangle, GridViewError> {
        let mut map = Rectangle::of_grid(view)?;
        if let Ok(field) = view.field_of(&format!("conf.{}", Source::MEMORY), NumericType::Uint8) {
            let (mut remembered, mut sensed) = (Vec::new(), Vec::new());
            field.bytes_into(&mut remembered);
            fuse_grid(view, &by_shape(view), &mut sensed)?;
            for ((cost, confidence), sensed) in map.costs.iter_mut().zip(remembered).zip(sensed) {
                let both = if sensed == UNKNOWN_COST { sensed } else { sensed.min(*cost) };
                *cost = if confidence > 0 { both } else { *cost };
            }
        }
        map.forget_far(view, within_m);
        Ok(map)
    }

    /// Makes the obstacles unknown that a world model's map has not seen from nearer than a distance, m. A map that does
    /// not say from where they were seen is taken as a whole.
    pub fn forget_far(&mut self, view: &GridView<'_>, within_m: f64) {
        let Ok(field) = view.field_of(OBSTACLE_SEEN_FROM, NumericType::Uint8) else { return };
        let mut seen_from_dm = Vec::new();
        field.bytes_into(&mut seen_from_dm);
        // 255 stands for all greater distances.
        let within_dm = (within_m * 10.0).min(254.0) as u8;
        for (cost, from_dm) in self.costs.iter_mut().zip(seen_from_dm) {
            if is_obstacle(*cost) && !(1..=within_dm).contains(&from_dm) {
                *cost = UNKNOWN_COST;
            }
        }
    }

    /// Costs of a world model's map, in its frame.
    pub fn with(view: &GridView<'_>, costs: Vec<u8>) -> Rectangle {
        let corner = view.frame_from_grid().translation.truncate();
        Rectangle { corner, cell_size_m: view.cell_size_m().x, columns: view.columns(), costs }
    }

    /// The message of a map in the global frame with this origin.
    pub fn to_memory(&self, origin: &Utm) -> MapMemory {
        MapMemory {
            format: FORMAT,
            zone: u32::from(origin.zone),
            easting_m: origin.easting_m + self.corner.x,
            northing_m: origin.northing_m + self.corner.y,
            cell_size_m: self.cell_size_m,
            columns: self.columns as u32,
            costs: self.costs.clone().into(),
        }
    }

    /// The cost at a position, m; unknown outside.
    pub fn at(&self, place: DVec2) -> u8 {
        let cell = ((place - self.corner) / self.cell_size_m).floor();
        if !(cell.x >= 0.0 && cell.y >= 0.0 && cell.x < self.columns as f64) {
            return UNKNOWN_COST;
        }
        let index = cell.y as usize * self.columns + cell.x as usize;
        self.costs.get(index).copied().unwrap_or(UNKNOWN_COST)
    }

    /// The highest cost in a square around a position, m: a thin obstacle may lie beside the middle of a cell that is
    /// larger than those of this map. A square that is no larger than a cell has the cost at the position. Unknown
    /// where nothing in it is known.
    pub fn most(&self, place: DVec2, size_m: f64) -> u8 {
        if size_m <= self.cell_size_m * (1.0 + 1e-9) {
            return self.at(place);
        }
        // A cell that the square touches at its border does not belong to it.
        let inside = 1e-6;
        let rows = self.costs.len() / self.columns.max(1);
        let side = |half_m: f64| (place + half_m - self.corner) / self.cell_size_m;
        let low = (side(-0.5 * size_m) + inside).floor().max(DVec2::ZERO);
        let high = (side(0.5 * size_m) - inside).ceil().min(DVec2::new(self.columns as f64, rows as f64));
        let (west, east) = (low.x as usize, high.x as usize);
        let row = |row: usize| self.costs.get(row * self.columns + west..row * self.columns + east);
        let costs = (low.y as usize..high.y as usize).filter_map(row).flatten();
        costs.copied().filter(|&cost| cost <= MAX_COST).max().unwrap_or(UNKNOWN_COST)
    }

    /// The four corners, m.
    pub fn corners(&self) -> [DVec2; 4] {
        let rows = self.costs.len() / self.columns.max(1);
        let size = DVec2::new(self.columns as f64, rows as f64) * self.cell_size_m;
        [DVec2::ZERO, DVec2::new(size.x, 0.0), DVec2::new(0.0, size.y), size].map(|at| self.corner + at)
    }

    /// How far a position lies from the rectangle, m; 0 in it.
    pub fn distance_m(&self, place: DVec2) -> f64 {
        let [low, _, _, high] = self.corners();
        place.distance(place.max(low).min(high))
    }

    /// Cuts off the rows and columns at the borders in which nothing is known.
    pub fn trim(&mut self) {
        let columns = self.columns.max(1);
        let known = || (0..self.costs.len()).filter(|&index| self.costs[index] != UNKNOWN_COST);
        let range =
            |cells: &dyn Fn(usize) -> usize| Some((known().map(cells).min()?, known().map(cells).max()?));
        let (by_row, by_column) = (range(&|index| index / columns), range(&|index| index % columns));
        let Some(((first_row, last_row), (first_column, last_column))) = by_row.zip(by_column) else {
            return;
        };
        let rows = self.costs.chunks(columns).take(last_row + 1).skip(first_row);
        let costs = rows.flat_map(|row| row[first_column..=last_column].iter().copied()).collect();
        self.corner += DVec2::new(first_column as f64, first_row as f64) * self.cell_size_m;
        (self.columns, self.costs) = (last_column + 1 - first_column, costs);
    }

    /// Whether a position lies in the rectangle, m.
    pub fn holds(&self, place: DVec2) -> bool {
        let rows = self.costs.len() / self.columns.max(1);
        let cell = (place - self.corner) / self.cell_size_m;
        cell.min_element() >= 0.0 && cell.x < self.columns as f64 && cell.y < rows as f64
    }

    /// Calls a function with the centre, m, and the cost of each cell within a distance of a position, m.
    pub fn around_each(&mut self, place: DVec2, within_m: f64, mut visit: impl FnMut(DVec2, &mut u8)) {
        for index in self.near(place, within_m) {
            visit(self.centre(index), &mut self.costs[index]);
        }
    }

    /// The indices of the cells within a distance of a position, m.
    pub fn near(&self, place: DVec2, within_m: f64) -> Vec<usize> {
        let rows = self.costs.len() / self.columns.max(1);
        let cell = |at: f64, count: usize| (at / self.cell_size_m).floor().clamp(0.0, count as f64) as usize;
        let (low, high) = (place - within_m - self.corner, place + within_m - self.corner);
        let rows = cell(low.y, rows)..(cell(high.y, rows) + 1).min(rows);
        let columns = cell(low.x, self.columns)..(cell(high.x, self.columns) + 1).min(self.columns);
        let cells = rows.flat_map(|row| columns.clone().map(move |column| row * self.columns + column));
        cells.filter(|&index| self.centre(index).distance(place) <= within_m).collect()
    }

    /// The centre of a cell, by its index, m.
    pub fn centre(&self, index: usize) -> DVec2 {
        let columns = self.columns.max(1);
        let (column, row) = (index % columns, index / columns);
        self.corner + (DVec2::new(column as f64, row as f64) + 0.5) * self.cell_size_m
    }

    /// Whether the cell at a position or one beside it is an obstacle.
    pub(crate) fn is_beside_obstacle(&self, place: DVec2) -> bool {
        let around = [-1.0, 0.0, 1.0];
        let beside = around.iter().flat_map(|&x| around.iter().map(move |&y| DVec2::new(x, y)));
        beside.into_iter().any(|step| is_obstacle(self.at(place + step * self.cell_size_m)))
    }
}

/// The sources of a map with which a remembered one is compared: those of shape and touch. Those of colour and texture and
/// any other that judges by appearance ([`GridView::is_learned`]), the infrared sensors and the remembered map itself have no
/// weight. A source that is not listed is a range sensor of weight 1, as for the world model ([`Weights`]).
pub fn by_shape(view: &GridView<'_>) -> Weights {
    let weighted = |source, weight, kind| Weighted { source, weight, kind };
    let sources = view.sources();
    let learned = sources.iter().filter(|&source| view.is_learned(source));
    let without_weight = [Source::COLOR, Source::CLASSIFIER, Source::INFRARED, Source::MEMORY];
    [
        weighted(Source::STEREO, 1.0, SourceKind::Range),
        weighted(Source::TERRAIN, 0.5, SourceKind::Learned),
        weighted(Source::BUMPER, 1.0, SourceKind::Override),
        weighted(Source::SLIP, 1.0, SourceKind::Override),
    ]
    .into_iter()
    // Terrain, which has a weight, is listed before: of several entries for one source the first counts.
    .chain(without_weight.into_iter().chain(learned).map(|source| weighted(source, 0.0, SourceKind::Learned)))
    .collect()
}

/// Whether a cost is that of an obstacle.
pub(crate) fn is_obstacle(cost: u8) -> bool {
    (OBSTACLE_COST..=MAX_COST).contains(&cost)
}

/// How far experience backs remembered ground: half. What was sensed a few times from far does not close a way that was
/// seen from near before; what is sensed well does.
const GROUND_BACKING: u8 = 128;

/// The statement of a world model's source, from costs in its frame.
pub fn statement(
    frame: &GridFrame,
    costs: &[u8],
    confidence: u8,
    source: Source,
    frame_id: &str,
    time: Stamp,
) -> Grid {
    let known = |cost: u8| if cost == UNKNOWN_COST { 0 } else { confidence };
    let backing = |cost: u8| if cost < OBSTACLE_COST { GROUND_BACKING } else { 0 };
    let data = costs.iter().flat_map(|&cost| [cost, known(cost), backing(cost)]).collect();
    frame.message_of_bytes(source, &["cost", "conf", "backing"], data, frame_id, time)
}

#[cfg(test)]
#[path = "memory_tests.rs"]
pub(crate) mod tests;
