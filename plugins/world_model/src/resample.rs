//! The cells of a cost map, gathered by the cells of the map that receives them.

use rcs_geom::{CellIndex, CellRect, DVec2, DVec3, ScrollGrid};
use rcs_msg::foxglove::Grid;
use rcs_world::{Evidence, Field, GridView, GridViewError, HeightStats, MAX_COST, NumericType, Source, Vote};

/// What one message says about one cell of the receiving map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sensed {
    /// The cell.
    pub cell: CellIndex,
    /// Its one vote.
    pub vote: Vote,
    /// The source's own confidence; for messages that state evidence.
    pub confidence: u8,
    /// Heights of ground and of obstacles.
    pub heights: [HeightStats; 2],
    /// Number of cells of the message with a cost that belong to it.
    pub count: u32,
}

/// A message by cells of the receiving map.
#[derive(Clone, Debug, PartialEq)]
pub struct Resampled {
    /// In the order of the cells, each once.
    pub cells: Vec<Sensed>,
    /// Whether the message states the evidence of its source, by the field `conf.<source>`.
    pub is_state: bool,
    /// Cells of the message with a cost that lie outside of the receiving map.
    pub outside: u64,
}

/// Reads the costs of a source from a cost map in the frame of `grid`.
///
/// A cell of the message belongs to the cell of the map in which its middle lies. Where a side of it is longer than
/// the map's cells, it belongs to all cells of the map whose middles lie in it, if there are any. Several cells of the
/// message in one cell of the map are one: the one with the highest cost counts, because what blocks a part of a cell
/// blocks the cell; of equal costs the one with the most backing, then the surest. Their heights are merged.
pub fn resampled<T: Clone>(
    message: &Grid,
    source: Source,
    grid: &ScrollGrid<T>,
) -> Result<Resampled, GridViewError> {
    let view = GridView::new(message)?;
    let byte = |name: &str| match view.field_of(&format!("{name}.{source}"), NumericType::Uint8) {
        Ok(field) => Ok(Some(field)),
        Err(GridViewError::Missing { .. }) => Ok(None),
        Err(error) => Err(error),
    };
    let costs = view.field_of(&format!("cost.{source}"), NumericType::Uint8)?;
    let (worth, confidence) = (byte("worth")?, byte("conf")?);
    let (backing, model) = (byte("backing")?, byte("model")?);
    let heights = ["ground", "obstacle"].map(|class| Heights::find(&view, class));
    let is_large = view.cell_size_m().max_element() > grid.cell_size_m() * (1.0 + 1e-9);
    let mut gathered = Gathered::new(grid);
    let mut outside = 0;
    let mut costs_by_row = Vec::new();
    costs.bytes_into(&mut costs_by_row);
    for (at, &cost) in costs_by_row.iter().enumerate() {
        if cost > MAX_COST {
            continue;
        }
        let [column, row] = [at % view.columns(), at / view.columns()];
        let number = |field: &Option<Field<'_>>, otherwise: u8| {
            field.as_ref().and_then(|field| field.get(column, row)).map_or(otherwise, |value| value as u8)
        };
        let sensed = Sensed {
            cell: CellIndex::new(0, 0),
            vote: Vote {
                cost,
                worth: number(&worth, u8::MAX),
                backing: number(&backing, 0),
                model: number(&model, 0),
            },
            confidence: number(&confidence, u8::MAX),
            heights: [0, 1]
                .map(|class| heights[class].as_ref().map(|h| h.get(column, row)).unwrap_or_default()),
            count: 1,
        };
        let mut is_outside = true;
        for_each_target(&view, [column, row], is_large, grid, |cell| {
            is_outside = false;
            gathered.add(Sensed { cell, ..sensed });
        });
        outside += u64::from(is_outside);
    }
    Ok(Resampled { cells: gathered.in_order(), is_state: confidence.is_some(), outside })
}

/// Whether the cells of a message are smaller than those of a map.
pub fn is_finer<T: Clone>(view: &GridView<'_>, grid: &ScrollGrid<T>) -> bool {
    view.cell_size_m().max_element() < grid.cell_size_m() * (1.0 - 1e-9)
}

impl Sensed {
    /// The evidence that a message of this sequence states.
    pub fn stated(&self, sequence: u32) -> Evidence {
        let Vote { cost, backing, model, .. } = self.vote;
        Evidence { cost, confidence: self.confidence, against: 0, backing, model, sequence }
    }
}

/// Calls `take` with each cell of the map to which a cell of the message belongs.
fn for_each_target<T: Clone>(
    view: &GridView<'_>,
    [column, row]: [usize; 2],
    is_large: bool,
    grid: &ScrollGrid<T>,
    mut take: impl FnMut(CellIndex),
) {
    let size = view.cell_size_m();
    let place = |u: f64, v: f64| {
        let at = DVec2::new(column as f64 + u, row as f64 + v) * size;
        (view.frame_from_grid() * DVec3::new(at.x, at.y, 0.0)).truncate()
    };
    let middle = grid.cell_at(place(0.5, 0.5)).filter(|index| grid.contains(*index));
    if !is_large {
        middle.into_iter().for_each(take);
        return;
    }
    let corners = [place(0.0, 0.0), place(1.0, 0.0), place(0.0, 1.0), place(1.0, 1.0)];
    let low = corners.into_iter().fold(DVec2::INFINITY, DVec2::min);
    let high = corners.into_iter().fold(DVec2::NEG_INFINITY, DVec2::max);
    let (Some(low), Some(high)) = (grid.cell_at(low), grid.cell_at(high)) else { return };
    // A cell may be larger than the map.
    let CellRect { south_west, columns, rows } = grid.bounds();
    let (east, north) = (south_west.x + columns as i64 - 1, south_west.y + rows as i64 - 1);
    let low = CellIndex::new(low.x.max(south_west.x), low.y.max(south_west.y));
    let high = CellIndex::new(high.x.min(east), high.y.min(north));
    let grid_from_frame = view.frame_from_grid().inverse();
    let is_mine = |index: &CellIndex| {
        let middle = (grid_from_frame * grid.middle_of(*index).extend(0.0)).truncate() / size;
        middle.floor() == DVec2::new(column as f64, row as f64)
    };
    let cells = (low.y..=high.y).flat_map(|y| (low.x..=high.x).map(move |x| CellIndex::new(x, y)));
    let mut is_taken = false;
    for cell in cells.filter(is_mine) {
        is_taken = true;
        take(cell);
    }
    // One that is turned or narrow may lie between the middles.
    if let Some(middle) = middle.filter(|_| !is_taken) {
        take(middle);
    }
}

/// What was gathered so far, one entry per cell of the map.
struct Gathered {
    bounds: CellRect,
    cells: Vec<Sensed>,
    /// By the cells of the map in row order: one more than the place in `cells`, 0 where there is none.
    places: Vec<u32>,
}

impl Gathered {
    fn new<T: Clone>(grid: &ScrollGrid<T>) -> Self {
        let bounds = grid.bounds();
        Self { bounds, cells: Vec::new(), places: vec![0; bounds.columns * bounds.rows] }
    }

    /// Adds what a cell of the message says about a cell of the map, which must lie within its bounds.
    fn add(&mut self, sensed: Sensed) {
        let from = self.bounds.south_west;
        let [column, row] = [(sensed.cell.x - from.x) as usize, (sensed.cell.y - from.y) as usize];
        let place = &mut self.places[row * self.bounds.columns + column];
        if *place == 0 {
            self.cells.push(sensed);
            *place = self.cells.len() as u32;
            return;
        }
        let kept = &mut self.cells[*place as usize - 1];
        kept.count += 1;
        for (kept, next) in kept.heights.iter_mut().zip(&sensed.heights) {
            kept.merge(next);
        }
        let order = |sensed: &Sensed| {
            let Vote { cost, backing, worth, .. } = sensed.vote;
            (cost, backing, sensed.confidence, worth)
        };
        if order(&sensed) > order(kept) {
            *kept = Sensed { heights: kept.heights, count: kept.count, ..sensed };
        }
    }

    /// The entries in the order of the cells.
    fn in_order(self) -> Vec<Sensed> {
        // They are in this order where the cells of the message are those of the map.
        if self.cells.is_sorted_by_key(|sensed| (sensed.cell.y, sensed.cell.x)) {
            return self.cells;
        }
        let mut cells = Vec::with_capacity(self.cells.len());
        let places = self.places.iter().filter(|&&place| place > 0);
        cells.extend(places.map(|&place| self.cells[place as usize - 1]));
        cells
    }
}

/// Fields with the heights of one class.
struct Heights<'a> {
    count: Field<'a>,
    mean: Field<'a>,
    variance: Field<'a>,
    min: Field<'a>,
    max: Field<'a>,
}

impl<'a> Heights<'a> {
    /// `None` if the grid lacks one of them.
    fn find(view: &'a GridView<'a>, class: &str) -> Option<Heights<'a>> {
        let field = |number: &str| view.field(&format!("{class}.{number}")).ok();
        Some(Heights {
            count: field("count")?,
            mean: field("mean")?,
            variance: field("variance")?,
            min: field("min")?,
            max: field("max")?,
        })
    }

    /// Heights of a cell; the default if a number is not finite.
    fn get(&self, column: usize, row: usize) -> HeightStats {
        let number = |field: &Field<'_>| field.get(column, row).unwrap_or(f64::NAN);
        let (count, mean, variance) = (number(&self.count), number(&self.mean), number(&self.variance));
        let (min, max) = (number(&self.min), number(&self.max));
        let finite = [count, mean, variance, min, max].iter().all(|value| value.is_finite());
        if !finite || count < 1.0 || variance < 0.0 {
            return HeightStats::default();
        }
        HeightStats {
            count: count as u32,
            mean: mean as f32,
            variance: variance as f32,
            min: min as f32,
            max: max as f32,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcs_msg::Stamp;
    use rcs_sense::GridFrame;
    use rcs_world::{Map, MapOptions, Sources, UNKNOWN_COST, VoteRule, Weights};

    const FULL: VoteRule = VoteRule { rise: 255, fall: 255, obstacle_fall: 255, max: 255, ground_max: 255 };

    /// A cost map with cells of this size around the origin, with these costs.
    fn message(cell_size_m: f64, costs: &[([f64; 2], u8)]) -> Grid {
        let mut map = Map::new(cell_size_m).unwrap();
        for &(place, cost) in costs {
            let index = map.grid().cell_at(DVec2::from_array(place)).unwrap();
            map.vote(index, Source::STEREO, cost, 1, Stamp(1), FULL);
        }
        let sources: Sources = [Source::STEREO].into_iter().collect();
        let options = MapOptions { sources, heights: false, weights: Weights::default() };
        let mut grid = map.to_grid("local", Stamp(1), &options);
        // A cost map of a sensor has no confidence.
        grid.fields.retain(|field| field.name.starts_with("cost"));
        grid
    }

    fn received(cell_size_m: f64, message: &Grid) -> Vec<([i64; 2], u8)> {
        let map = Map::new(cell_size_m).unwrap();
        let resampled = resampled(message, Source::STEREO, map.grid()).unwrap();
        resampled.cells.iter().map(|sensed| ([sensed.cell.x, sensed.cell.y], sensed.vote.cost)).collect()
    }

    #[test]
    fn nine_small_cells_are_one_vote_for_the_large_cell_around_them() {
        let small = message(0.2, &[([0.1, 0.1], 0), ([0.3, 0.1], 240), ([0.5, 0.5], 10), ([0.7, 0.1], 20)]);
        assert_eq!(received(0.6, &small), [([0, 0], 240), ([1, 0], 20)]);
        assert_eq!(received(0.2, &small).len(), 4);
    }

    #[test]
    fn of_equal_costs_the_one_that_experience_backs_most_counts_then_the_surest() {
        let frame = GridFrame { south_west: CellIndex::new(0, 0), side: 2, cell_size_m: 0.2 };
        let counted = |names: &[&str], cells: [[u8; 3]; 4]| {
            let data = cells.as_flattened().to_vec();
            let message = frame.message_of_bytes(Source::STEREO, names, data, "local", Stamp(1));
            let map = Map::new(0.4).unwrap();
            resampled(&message, Source::STEREO, map.grid()).unwrap().cells[0]
        };
        let votes = [[250, 0, 210], [250, 200, 200], [0, 255, 255], [UNKNOWN_COST, 255, 255]];
        let vote = counted(&["cost", "backing", "worth"], votes).vote;
        assert_eq!((vote.cost, vote.backing, vote.worth), (250, 200, 200));
        let states = [[0, 10, 0], [0, 100, 255], [0, 200, 0], [0, 50, 255]];
        let stated = counted(&["cost", "conf", "backing"], states);
        assert_eq!((stated.vote.backing, stated.confidence), (255, 100));
    }

    #[test]
    fn a_large_cell_is_a_vote_for_each_small_cell_in_it() {
        let cells = received(0.2, &message(0.6, &[([-0.1, 0.1], 90)]));
        let expected: Vec<_> = (0..3).flat_map(|y| (-3..0).map(move |x| ([x, y], 90))).collect();
        assert_eq!(cells, expected);
    }

    #[test]
    fn a_cell_that_is_larger_than_the_map_is_a_vote_for_the_part_of_the_map_in_it() {
        for cell_size_m in [100.0, 100_000.0] {
            let cells = received(0.2, &message(cell_size_m, &[([1.0, 1.0], 90)]));
            let expected: Vec<_> = (0..=100).flat_map(|y| (0..=100).map(move |x| ([x, y], 90))).collect();
            assert_eq!(cells, expected, "{cell_size_m} m");
        }
    }

    #[test]
    fn a_narrow_cell_is_a_vote_for_each_small_cell_in_it_and_at_least_for_that_at_its_middle() {
        use rcs_msg::foxglove::{Pose, Quaternion, Vector3};
        let mut narrow = message(0.4, &[([0.2, 0.2], 90), ([0.6, 0.2], 240)]);
        // These cells begin at x = 0.04 m and 0.14 m, and y = 0.05 m.
        narrow.cell_size.as_mut().unwrap().x = 0.1;
        narrow.pose = Some(Pose {
            position: Some(Vector3 { x: -9.96, y: -39.95, z: 0.0 }),
            orientation: Some(Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 }),
        });
        assert_eq!(received(0.2, &narrow), [([0, 0], 90), ([0, 1], 240)]);
    }

    #[test]
    fn a_turned_cost_map_lands_on_the_same_ground() {
        use rcs_msg::foxglove::{Pose, Quaternion, Vector3};
        let mut turned = message(0.2, &[([2.1, 0.1], 250)]);
        // Turned by 90 degrees about the frame's origin: its corner goes from (x, y) to (-y, x).
        let corner = turned.pose.unwrap().position.unwrap();
        let half = std::f64::consts::FRAC_1_SQRT_2;
        turned.pose = Some(Pose {
            position: Some(Vector3 { x: -corner.y, y: corner.x, z: 0.0 }),
            orientation: Some(Quaternion { x: 0.0, y: 0.0, z: half, w: half }),
        });
        assert_eq!(received(0.2, &turned), [([-1, 10], 250)]);
    }
}
