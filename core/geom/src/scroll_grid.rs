//! The scrolling grid: a square map around the vehicle whose cells keep their place in memory (Albus 2006a, 4).

use std::sync::Arc;

use glam::DVec2;
use serde::{Deserialize, Serialize};

/// A cell of the world, independent of any grid: floor(position / cell size), x east and y north.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct CellIndex {
    /// Cells east of the origin of the frame.
    pub x: i64,
    /// Cells north of the origin of the frame.
    pub y: i64,
}

impl CellIndex {
    /// Cell in column `x`, row `y` of the world.
    pub const fn new(x: i64, y: i64) -> CellIndex {
        CellIndex { x, y }
    }

    /// The cell at this offset, in cells east and north.
    #[must_use]
    pub const fn offset(self, dx: i64, dy: i64) -> CellIndex {
        CellIndex { x: self.x.saturating_add(dx), y: self.y.saturating_add(dy) }
    }
}

/// Why a grid cannot be made or restored.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum GridError {
    /// The grid has no cells, or more than memory should hold.
    #[error("grid has {side} cells a side, expected 1 to {MAX_SIDE}")]
    Side {
        /// Cells per side.
        side: usize,
    },
    /// The cell size is not a positive number.
    #[error("cell size is {cell_size_m} m, expected a finite number above 0")]
    CellSize {
        /// Metres.
        cell_size_m: f64,
    },
    /// The number of saved cells does not match the grid.
    #[error("saved grid of {side} cells a side holds {got} cells, expected {expected}")]
    Cells {
        /// Cells per side.
        side: usize,
        /// Number of cells found, including the padding of tiles.
        got: usize,
        /// Number of cells expected, including the padding of tiles.
        expected: usize,
    },
}

/// Greatest number of cells per side.
const MAX_SIDE: usize = 4096;
/// Cells per side of a tile. It is small enough that a column of the map touches few cells outside of it, and large
/// enough that sharing the tiles costs little.
pub const TILE: usize = 8;
/// Beyond this many cells from the origin an f64 no longer distinguishes neighbouring cells.
const LIMIT: i64 = 1 << 51;

/// A square grid of `side`×`side` cells, north-up, that scrolls over the world.
///
/// - The cell of a world position is floor(position / cell size), per axis: [`CellIndex`].
/// - The cell is stored at index mod `side`, per axis. When the grid moves by one cell, exactly `side` cells are
///   overwritten and the others keep their place.
/// - The window holds the cells from `centre - side / 2` on (rounded down), so that an odd side has a middle cell: with
///   201 cells the centre is cell (100, 100) counted from the south-west corner.
/// - Cells are stored in tiles that clones share (copy on write): a clone costs one reference count per tile, and the
///   first write to a shared tile copies that tile.
///
/// A write to a shared tile clones 64 `T`: keep `T` small and flat.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Saved<T>", bound(deserialize = "T: Deserialize<'de> + Clone"))]
pub struct ScrollGrid<T> {
    side: usize,
    cell_size_m: f64,
    centre: CellIndex,
    /// Follows from the centre, so that a cell is found without a division.
    #[serde(skip)]
    corner: Corner,
    fill: T,
    /// Tiles by rows; each tile holds its cells by rows; positions from `side` on are padding.
    tiles: Vec<Arc<[T]>>,
}

/// The south-west cell of the window.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Corner {
    cell: CellIndex,
    /// Column and row where it is stored: its index mod the side.
    stored: [usize; 2],
}

impl Corner {
    fn of(side: usize, centre: CellIndex) -> Corner {
        let half = (side / 2) as i64;
        let cell = centre.offset(-half, -half);
        let stored = [cell.x, cell.y].map(|index| index.rem_euclid(side as i64) as usize);
        Corner { cell, stored }
    }
}

/// A deserialised [`ScrollGrid`] before its numbers are checked.
#[derive(Deserialize)]
struct Saved<T> {
    side: usize,
    cell_size_m: f64,
    centre: CellIndex,
    fill: T,
    tiles: Vec<Vec<T>>,
}

impl<T: Clone> TryFrom<Saved<T>> for ScrollGrid<T> {
    type Error = GridError;

    fn try_from(saved: Saved<T>) -> Result<Self, GridError> {
        let Saved { side, cell_size_m, centre, fill, tiles } = saved;
        check(side, cell_size_m)?;
        let expected = side.div_ceil(TILE).pow(2) * TILE * TILE;
        let got = tiles.iter().map(Vec::len).sum();
        if got != expected || tiles.iter().any(|tile| tile.len() != TILE * TILE) {
            return Err(GridError::Cells { side, got, expected });
        }
        let tiles = tiles.into_iter().map(Arc::from).collect();
        let centre = bounded(centre);
        Ok(ScrollGrid { side, cell_size_m, centre, corner: Corner::of(side, centre), fill, tiles })
    }
}

impl<T: Clone> ScrollGrid<T> {
    /// A grid in which every cell is `fill`, centred on cell (0, 0). `side` is in cells, `cell_size_m` in metres.
    pub fn new(side: usize, cell_size_m: f64, fill: T) -> Result<ScrollGrid<T>, GridError> {
        check(side, cell_size_m)?;
        let tile: Arc<[T]> = vec![fill.clone(); TILE * TILE].into();
        let tiles = vec![tile; side.div_ceil(TILE).pow(2)];
        let centre = CellIndex::default();
        Ok(ScrollGrid { side, cell_size_m, centre, corner: Corner::of(side, centre), fill, tiles })
    }

    /// Cells per side.
    pub fn side(&self) -> usize {
        self.side
    }

    /// Size of a cell, metres.
    pub fn cell_size_m(&self) -> f64 {
        self.cell_size_m
    }

    /// The cell in the middle of the window.
    pub fn centre(&self) -> CellIndex {
        self.centre
    }

    /// The cells of the window.
    pub fn bounds(&self) -> CellRect {
        CellRect { south_west: self.corner.cell, columns: self.side, rows: self.side }
    }

    /// World position of the south-west corner of the window (the corner of its corner cell, not the middle), metres.
    pub fn origin(&self) -> DVec2 {
        let CellIndex { x, y } = self.corner.cell;
        DVec2::new(x as f64, y as f64) * self.cell_size_m
    }

    /// The cell of a world position (metres), inside or outside of the window. `None` for a position that is not finite
    /// or too far from the origin to distinguish cells.
    pub fn cell_at(&self, p_world: DVec2) -> Option<CellIndex> {
        let cells = p_world / self.cell_size_m;
        Some(CellIndex::new(floor(cells.x)?, floor(cells.y)?))
    }

    /// World position of the middle of a cell, metres.
    pub fn middle_of(&self, cell: CellIndex) -> DVec2 {
        DVec2::new(cell.x as f64 + 0.5, cell.y as f64 + 0.5) * self.cell_size_m
    }

    /// Whether the cell lies in the window.
    pub fn contains(&self, cell: CellIndex) -> bool {
        self.stored(cell).is_some()
    }

    /// A cell, or `None` outside of the window.
    pub fn get(&self, cell: CellIndex) -> Option<&T> {
        let (tile, at) = self.place(cell)?;
        self.tiles.get(tile)?.get(at)
    }

    /// A cell to write, or `None` outside of the window. The call copies the tile if a clone shares it.
    pub fn get_mut(&mut self, cell: CellIndex) -> Option<&mut T> {
        let (tile, at) = self.place(cell)?;
        Arc::make_mut(self.tiles.get_mut(tile)?).get_mut(at)
    }

    /// The cell at a world position (metres).
    pub fn at(&self, p_world: DVec2) -> Option<&T> {
        self.get(self.cell_at(p_world)?)
    }

    /// Moves the window so that `centre` is its middle cell, fills the newly exposed cells with `fill`, and returns
    /// them.
    pub fn recentre(&mut self, centre: CellIndex) -> Exposed {
        let fill = self.fill.clone();
        self.recentre_with(centre, |_| fill.clone())
    }

    /// Moves the window and takes the value of each newly exposed cell from `remembered`.
    pub fn recentre_with(
        &mut self,
        centre: CellIndex,
        mut remembered: impl FnMut(CellIndex) -> T,
    ) -> Exposed {
        let before = self.bounds();
        self.set_centre(centre);
        let exposed = Exposed::between(&before, &self.bounds());
        self.write_rect(&exposed.columns, &mut remembered);
        self.write_rect(&exposed.rows, &mut remembered);
        exposed
    }

    /// Writes cells of the window tile by tile, so that each tile is looked up and unshared once.
    fn write_rect(&mut self, rect: &CellRect, value: &mut impl FnMut(CellIndex) -> T) {
        let mut row = 0;
        while row < rect.rows {
            let mut column = 0;
            let mut height = 1;
            while column < rect.columns {
                let first = rect.south_west.offset(column as i64, row as i64);
                let Some([px, py]) = self.stored(first) else { return };
                height = self.run(py, rect.rows - row);
                let width = self.run(px, rect.columns - column);
                let number = self.tile_number(px, py);
                let Some(tile) = self.tiles.get_mut(number) else { return };
                let cells = Arc::make_mut(tile);
                for dy in 0..height {
                    let start = (py % TILE + dy) * TILE + px % TILE;
                    for (dx, cell) in cells[start..start + width].iter_mut().enumerate() {
                        *cell = value(first.offset(dx as i64, dy as i64));
                    }
                }
                column += width;
            }
            row += height;
        }
    }

    /// How many of at most `wanted` columns (or rows) from this one on are stored one after another in its tile.
    fn run(&self, stored: usize, wanted: usize) -> usize {
        (TILE - stored % TILE).min(self.side - stored).min(wanted)
    }

    /// Sets all cells to `fill`; the window does not move.
    pub fn clear(&mut self) {
        let tile: Arc<[T]> = vec![self.fill.clone(); TILE * TILE].into();
        self.tiles.fill(tile);
    }

    /// All cells by rows: the southernmost row first, west to east in each. Row r, column c of this order is the cell
    /// `bounds().south_west.offset(c, r)`.
    pub fn iter(&self) -> impl Iterator<Item = (CellIndex, &T)> {
        self.bounds().iter().filter_map(|cell| Some((cell, self.get(cell)?)))
    }

    /// Calls `visit` with all cells in the order of [`ScrollGrid::iter`], in runs of neighbours of one row: the
    /// position of the first cell in that order, its index, and the cells. Much faster than cell by cell.
    pub fn for_each_run(&self, mut visit: impl FnMut(usize, CellIndex, &[T])) {
        let Corner { cell: corner, stored: [first_px, first_py] } = self.corner;
        for row in 0..self.side {
            let py = self.wrapped(first_py + row);
            let (mut px, mut column) = (first_px, 0);
            while column < self.side {
                let run = self.run(px, self.side - column);
                let at = py % TILE * TILE + px % TILE;
                let tile = self.tiles.get(self.tile_number(px, py));
                let Some(cells) = tile.and_then(|cells| cells.get(at..at + run)) else { return };
                visit(row * self.side + column, corner.offset(column as i64, row as i64), cells);
                column += run;
                px = self.wrapped(px + run);
            }
        }
    }

    /// Cells of a row from `cell` on, at most `count` and at most those that are contiguous in memory. The length
    /// equals that of the run of [`ScrollGrid::for_each_run`] in any grid of this shape and window. Empty outside of
    /// the window.
    pub fn run_from(&self, cell: CellIndex, count: usize) -> &[T] {
        let Some([px, py]) = self.stored(cell) else { return &[] };
        let at = py % TILE * TILE + px % TILE;
        let run = at..at + self.run(px, count);
        self.tiles.get(self.tile_number(px, py)).and_then(|cells| cells.get(run)).unwrap_or(&[])
    }

    /// A grid with the same shape and window, in which every cell is `fill`.
    pub fn like<U: Clone>(&self, fill: U) -> ScrollGrid<U> {
        let tile: Arc<[U]> = vec![fill.clone(); TILE * TILE].into();
        let tiles = vec![tile; self.tiles.len()];
        let &Self { side, cell_size_m, centre, corner, .. } = self;
        ScrollGrid { side, cell_size_m, centre, corner, fill, tiles }
    }

    /// A copy of all cells in the order of [`ScrollGrid::iter`].
    pub fn linearise(&self) -> Vec<T> {
        let mut cells = Vec::with_capacity(self.side * self.side);
        self.for_each_run(|_, _, run| cells.extend_from_slice(run));
        cells
    }

    /// Numbers of the tiles that are not shared with `other`, ascending. Every tile that differs is among them. Clones
    /// share tiles that neither has written since, so that this compares one address per tile. Returns all tiles if the
    /// grids differ in their number of tiles.
    pub fn tiles_written_since<'a>(&'a self, other: &'a ScrollGrid<T>) -> impl Iterator<Item = usize> + 'a {
        let comparable = self.tiles.len() == other.tiles.len();
        (0..self.tiles.len())
            .filter(move |&tile| !comparable || !Arc::ptr_eq(&self.tiles[tile], &other.tiles[tile]))
    }

    /// About how much memory the cells take, bytes: a tile that several grids share counts in equal parts for each.
    pub fn share_of_memory(&self) -> usize {
        let share = |tile: &Arc<[T]>| size_of_val::<[T]>(tile) / Arc::strong_count(tile);
        self.tiles.len() * size_of::<Arc<[T]>>() + self.tiles.iter().map(share).sum::<usize>()
    }

    /// Number of tiles.
    pub fn tile_count(&self) -> usize {
        self.tiles.len()
    }

    /// Cells of a tile by rows as stored, [`TILE`] rows of [`TILE`]; empty if there is no such tile.
    pub fn tile(&self, tile: usize) -> &[T] {
        self.tiles.get(tile).map_or(&[], |cells| cells)
    }

    /// The cell that is stored at a place of a tile; `None` if there is no such place, or it is padding.
    pub fn cell_in(&self, tile: usize, at: usize) -> Option<CellIndex> {
        let tiles_a_side = self.side.div_ceil(TILE);
        let (x, y) = (tile % tiles_a_side * TILE + at % TILE, tile / tiles_a_side * TILE + at / TILE);
        if x >= self.side || y >= self.side || at >= TILE * TILE {
            return None;
        }
        let Corner { cell, stored } = self.corner;
        let behind = |at: usize, first: usize| if at < first { at + self.side - first } else { at - first };
        Some(cell.offset(behind(x, stored[0]) as i64, behind(y, stored[1]) as i64))
    }

    /// Cells of a tile, to write; empty if there is no such tile. The call copies the tile if a clone shares it.
    pub fn tile_mut(&mut self, tile: usize) -> &mut [T] {
        self.tiles.get_mut(tile).map_or(&mut [], |cells| Arc::make_mut(cells))
    }

    /// Moves the window without filling the newly exposed cells: for a copy whose tiles are then written like the
    /// original's.
    pub fn set_centre(&mut self, centre: CellIndex) {
        self.centre = bounded(centre);
        self.corner = Corner::of(self.side, self.centre);
    }

    /// Tile of a cell and index within it.
    fn place(&self, cell: CellIndex) -> Option<(usize, usize)> {
        let [px, py] = self.stored(cell)?;
        Some((self.tile_number(px, py), py % TILE * TILE + px % TILE))
    }

    /// Column and row where a cell is stored, `None` outside of the window.
    fn stored(&self, cell: CellIndex) -> Option<[usize; 2]> {
        let Corner { cell: corner, stored: [first_px, first_py] } = self.corner;
        // The corner is far from the limits of its type, so that only cells of the window have such a difference.
        let [column, row] = [cell.x.wrapping_sub(corner.x), cell.y.wrapping_sub(corner.y)];
        let within = |offset: i64| (offset as u64) < self.side as u64;
        (within(column) && within(row))
            .then(|| [self.wrapped(first_px + column as usize), self.wrapped(first_py + row as usize)])
    }

    /// The column or row of this number, less the side if it is not below that.
    fn wrapped(&self, number: usize) -> usize {
        if number < self.side { number } else { number - self.side }
    }

    fn tile_number(&self, px: usize, py: usize) -> usize {
        py / TILE * self.side.div_ceil(TILE) + px / TILE
    }
}

/// Rounds down; `None` beyond [`LIMIT`], and for what is no number. The instruction for it is not on every processor.
fn floor(value: f64) -> Option<i64> {
    let towards_zero = value as i64;
    let floor = towards_zero.saturating_sub(i64::from(towards_zero as f64 > value));
    (!value.is_nan() && floor.unsigned_abs() <= LIMIT as u64).then_some(floor)
}

fn check(side: usize, cell_size_m: f64) -> Result<(), GridError> {
    if side == 0 || side > MAX_SIDE {
        return Err(GridError::Side { side });
    }
    if !(cell_size_m.is_finite() && cell_size_m > 0.0) {
        return Err(GridError::CellSize { cell_size_m });
    }
    Ok(())
}

fn bounded(cell: CellIndex) -> CellIndex {
    CellIndex { x: cell.x.clamp(-LIMIT, LIMIT), y: cell.y.clamp(-LIMIT, LIMIT) }
}

/// A rectangle of cells.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CellRect {
    /// The cell with the least x and y.
    pub south_west: CellIndex,
    /// Cells from west to east.
    pub columns: usize,
    /// Cells from south to north.
    pub rows: usize,
}

impl CellRect {
    /// Whether the rectangle contains the cell.
    pub fn contains(&self, cell: CellIndex) -> bool {
        let within = |v: i64, from: i64, count: usize| {
            v.checked_sub(from).is_some_and(|offset| (0..count as i64).contains(&offset))
        };
        within(cell.x, self.south_west.x, self.columns) && within(cell.y, self.south_west.y, self.rows)
    }

    /// Number of cells.
    pub fn len(&self) -> usize {
        self.columns * self.rows
    }

    /// Whether the rectangle is empty.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The cells by rows from the south, west to east.
    pub fn iter(&self) -> impl Iterator<Item = CellIndex> + use<> {
        let CellRect { south_west, columns, rows } = *self;
        (0..rows as i64).flat_map(move |y| (0..columns as i64).map(move |x| south_west.offset(x, y)))
    }
}

/// The cells that a move of the window newly exposes: at most a strip of columns and a strip of rows, without overlap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Exposed {
    /// Whole columns, over all rows of the new window.
    pub columns: CellRect,
    /// Rows, over the remaining columns.
    pub rows: CellRect,
}

impl Exposed {
    fn between(before: &CellRect, after: &CellRect) -> Exposed {
        let side = after.columns as i64;
        let (a, b) = (before.south_west, after.south_west);
        // Start and length of the new part of one axis, and of the part that is kept.
        let split = |from: i64, to: i64| {
            let moved = (to - from).clamp(-side, side);
            let fresh = moved.unsigned_abs() as usize;
            let (fresh_start, kept_start) =
                if moved >= 0 { (to + side - moved, to) } else { (to, to - moved) };
            (fresh_start, fresh, kept_start, side as usize - fresh)
        };
        let (x_fresh, x_count, x_kept, x_kept_count) = split(a.x, b.x);
        let (y_fresh, y_count, _, _) = split(a.y, b.y);
        Exposed {
            columns: CellRect {
                south_west: CellIndex::new(x_fresh, b.y),
                columns: x_count,
                rows: if x_count == 0 { 0 } else { after.rows },
            },
            rows: CellRect {
                south_west: CellIndex::new(x_kept, y_fresh),
                columns: if y_count == 0 { 0 } else { x_kept_count },
                rows: y_count,
            },
        }
    }

    /// Number of cells.
    pub fn len(&self) -> usize {
        self.columns.len() + self.rows.len()
    }

    /// Whether the window did not move.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// All cells, each once.
    pub fn iter(&self) -> impl Iterator<Item = CellIndex> + use<> {
        self.columns.iter().chain(self.rows.iter())
    }
}

#[cfg(test)]
#[path = "scroll_grid_tests.rs"]
mod tests;
