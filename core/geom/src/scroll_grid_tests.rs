use std::collections::BTreeMap;

use proptest::prelude::*;

use super::*;

/// Reference: a map of the written cells, which forgets a cell when it leaves the window.
struct ReferenceGrid {
    side: i64,
    centre: CellIndex,
    cells: BTreeMap<(i64, i64), u32>,
}

impl ReferenceGrid {
    fn holds(&self, cell: CellIndex) -> bool {
        let low = (self.centre.x - self.side / 2, self.centre.y - self.side / 2);
        (low.0..low.0 + self.side).contains(&cell.x) && (low.1..low.1 + self.side).contains(&cell.y)
    }

    fn recentre(&mut self, centre: CellIndex) {
        self.centre = centre;
        let kept: Vec<_> =
            self.cells.keys().copied().filter(|&(x, y)| self.holds(CellIndex::new(x, y))).collect();
        self.cells = kept.into_iter().filter_map(|key| Some((key, *self.cells.get(&key)?))).collect();
    }

    fn get(&self, cell: CellIndex) -> Option<u32> {
        self.holds(cell).then(|| self.cells.get(&(cell.x, cell.y)).copied().unwrap_or(0))
    }
}

#[derive(Clone, Debug)]
enum Step {
    Write(i64, i64, u32),
    Recentre(i64, i64),
    Snapshot,
}

fn step() -> impl Strategy<Value = Step> {
    prop_oneof![
        4 => (-30..30_i64, -30..30_i64, 1..u32::MAX).prop_map(|(x, y, v)| Step::Write(x, y, v)),
        2 => (-3..=3_i64, -3..=3_i64).prop_map(|(x, y)| Step::Recentre(x, y)),
        1 => (-60..=60_i64, -60..=60_i64).prop_map(|(x, y)| Step::Recentre(x, y)),
        1 => Just(Step::Snapshot),
    ]
}

/// All cells of the grid in memory order, tile after tile.
fn memory(grid: &ScrollGrid<u32>) -> Vec<u32> {
    grid.tiles.iter().flat_map(|tile| tile.iter().copied()).collect()
}

fn numbered(side: usize) -> ScrollGrid<u32> {
    let mut grid = ScrollGrid::new(side, 0.2, 0).unwrap();
    for (i, cell) in grid.bounds().iter().enumerate() {
        *grid.get_mut(cell).unwrap() = i as u32 + 1;
    }
    grid
}

proptest! {
    #[test]
    fn any_history_equals_the_reference_grid(side in 1..30_usize, steps in prop::collection::vec(step(), 1..60)) {
        let mut grid = ScrollGrid::new(side, 0.5, 0_u32).unwrap();
        let mut reference = ReferenceGrid { side: side as i64, centre: CellIndex::default(), cells: BTreeMap::new() };
        let mut snapshots = Vec::new();
        for step in steps {
            match step {
                Step::Write(x, y, value) => {
                    let cell = CellIndex::new(grid.centre().x + x, grid.centre().y + y);
                    if let Some(slot) = grid.get_mut(cell) { *slot = value; }
                    if reference.holds(cell) { reference.cells.insert((cell.x, cell.y), value); }
                }
                Step::Recentre(x, y) => {
                    let centre = grid.centre().offset(x, y);
                    grid.recentre(centre);
                    reference.recentre(centre);
                }
                Step::Snapshot => snapshots.push((grid.clone(), grid.linearise())),
            }
            for y in -35..35 {
                for x in -35..35 {
                    let cell = reference.centre.offset(x, y);
                    prop_assert_eq!(grid.get(cell).copied(), reference.get(cell));
                }
            }
        }
        for (snapshot, cells) in snapshots {
            prop_assert_eq!(snapshot.linearise(), cells, "a snapshot changed");
        }
    }

    #[test]
    fn a_one_cell_move_touches_exactly_n_cells_and_leaves_the_bytes_of_the_rest(
        side in 1..60_usize, start in (-1000..1000_i64, -1000..1000_i64), direction in 0..4_usize,
    ) {
        let mut grid = ScrollGrid::new(side, 0.2, 0_u32).unwrap();
        grid.recentre(CellIndex::new(start.0, start.1));
        for (i, cell) in grid.bounds().iter().enumerate() {
            *grid.get_mut(cell).unwrap() = i as u32 + 1;
        }
        let before = memory(&grid);
        let (dx, dy) = [(1, 0), (-1, 0), (0, 1), (0, -1)][direction];
        let exposed = grid.recentre(grid.centre().offset(dx, dy));
        prop_assert_eq!(exposed.len(), side);
        let changed = before.iter().zip(memory(&grid)).filter(|(a, b)| **a != *b).count();
        prop_assert_eq!(changed, side);
        prop_assert!(exposed.iter().all(|cell| grid.get(cell) == Some(&0)));
    }

    #[test]
    fn exposed_cells_are_those_of_the_new_window_that_the_old_one_lacks(
        side in 1..20_usize, dx in -50..50_i64, dy in -50..50_i64,
    ) {
        let mut grid = ScrollGrid::new(side, 1.0, 0_u8).unwrap();
        let before = grid.bounds();
        let exposed = grid.recentre(CellIndex::new(dx, dy));
        let mut cells: Vec<_> = exposed.iter().collect();
        cells.sort_unstable();
        let mut expected: Vec<_> = grid.bounds().iter().filter(|&cell| !before.contains(cell)).collect();
        expected.sort_unstable();
        prop_assert_eq!(cells, expected);
    }

    #[test]
    fn linear_order_is_south_to_north_and_west_to_east(side in 1..40_usize, x in -500..500_i64, y in -500..500_i64) {
        let mut grid = numbered(side);
        grid.recentre(CellIndex::new(x, y));
        for (i, cell) in grid.bounds().iter().enumerate() {
            *grid.get_mut(cell).unwrap() = i as u32;
        }
        let expected: Vec<u32> = (0..(side * side) as u32).collect();
        prop_assert_eq!(grid.linearise(), expected);
        prop_assert!(grid.iter().enumerate().all(|(i, (_, &value))| value == i as u32));
    }

    #[test]
    fn a_world_position_is_in_the_cell_that_floor_gives(x in -1e6..1e6_f64, y in -1e6..1e6_f64, size in 0.05..5.0_f64) {
        let grid = ScrollGrid::new(9, size, 0_u8).unwrap();
        let cell = grid.cell_at(DVec2::new(x, y)).unwrap();
        prop_assert_eq!(cell, CellIndex::new((x / size).floor() as i64, (y / size).floor() as i64));
        prop_assert_eq!(grid.cell_at(grid.middle_of(cell)), Some(cell));
    }

    #[test]
    fn saved_and_restored_grids_are_equal_and_go_on_equal(side in 1..20_usize, x in -40..40_i64, y in -40..40_i64) {
        let mut grid = numbered(side);
        let bytes = postcard::to_stdvec(&grid).unwrap();
        let mut restored: ScrollGrid<u32> = postcard::from_bytes(&bytes).unwrap();
        prop_assert_eq!(&restored, &grid);
        grid.recentre(CellIndex::new(x, y));
        restored.recentre(CellIndex::new(x, y));
        prop_assert_eq!(restored, grid);
    }
}

#[test]
fn a_snapshot_shares_all_tiles_that_are_not_written() {
    let mut grid = numbered(201);
    let snapshot = grid.clone();
    *grid.get_mut(CellIndex::new(3, 4)).unwrap() = 0;
    let unshared = grid.tiles.iter().zip(&snapshot.tiles).filter(|(a, b)| !Arc::ptr_eq(a, b)).count();
    assert_eq!(unshared, 1);
}

#[test]
fn the_middle_of_201_cells_is_cell_100_100() {
    let mut grid = ScrollGrid::new(201, 0.2, 0_u8).unwrap();
    grid.recentre(CellIndex::new(7, -9));
    assert_eq!(grid.bounds().south_west.offset(100, 100), CellIndex::new(7, -9));
    assert!(grid.origin().abs_diff_eq(DVec2::new(-93.0 * 0.2, -109.0 * 0.2), 1e-12));
}

#[test]
fn remembered_cells_fill_the_border() {
    let mut grid = numbered(5);
    let exposed = grid.recentre_with(CellIndex::new(1, 0), |cell| 1000 + cell.y as u32 % 7);
    assert_eq!(exposed.len(), 5);
    assert_eq!(grid.get(CellIndex::new(3, 2)), Some(&1002));
    assert_eq!(grid.get(CellIndex::new(2, 2)), Some(&25));
}

#[test]
fn positions_and_windows_far_out_neither_panic_nor_alias() {
    let mut grid = ScrollGrid::new(201, 0.2, 0_u8).unwrap();
    assert_eq!(grid.cell_at(DVec2::new(f64::NAN, 0.0)), None);
    assert_eq!(grid.cell_at(DVec2::new(f64::INFINITY, 0.0)), None);
    assert_eq!(grid.cell_at(DVec2::new(0.0, -1e300)), None);
    assert_eq!(grid.get(CellIndex::new(i64::MIN, i64::MAX)), None);
    assert_eq!(grid.recentre(CellIndex::new(i64::MAX, i64::MIN)).len(), 201 * 201);
    assert_eq!(grid.recentre(CellIndex::new(i64::MIN, 0)).len(), 201 * 201);
}

#[test]
fn sizes_that_cannot_be_are_refused_also_when_restoring() {
    assert_eq!(ScrollGrid::new(0, 0.2, 0).unwrap_err(), GridError::Side { side: 0 });
    assert!(ScrollGrid::new(5, f64::NAN, 0).is_err());
    assert!(ScrollGrid::new(5, -0.2, 0).is_err());
    let mut bytes = postcard::to_stdvec(&ScrollGrid::new(5, 0.2, 0_u8).unwrap()).unwrap();
    bytes[0] = 201;
    bytes.insert(1, 1);
    assert!(postcard::from_bytes::<ScrollGrid<u8>>(&bytes).is_err());
}

/// Prints the time in `cargo test --release -- --nocapture`; asserts only its order of magnitude, because builds
/// differ.
#[test]
fn a_one_cell_scroll_of_201_cells_takes_microseconds() {
    let mut grid = ScrollGrid::new(201, 0.2, [0_u8; 128]).unwrap();
    for cell in grid.bounds().iter() {
        grid.get_mut(cell).unwrap()[0] = 1;
    }
    // The least of ten rounds, because other work may interrupt some of them.
    let rounds = (0..10).map(|round| {
        let start = std::time::Instant::now();
        for i in round * 100..(round + 1) * 100 {
            grid.recentre(CellIndex::new(i, i / 2));
        }
        start.elapsed() / 150
    });
    let each = rounds.min().unwrap();
    println!("one-cell scroll of 201x201 cells of 128 bytes: {each:?}");
    assert!(each < std::time::Duration::from_millis(2));
}

#[test]
fn every_cell_is_stored_at_one_place_and_places_beyond_the_side_hold_none() {
    let check = |side: usize, centre: CellIndex| {
        let mut grid = ScrollGrid::new(side, 0.2, CellIndex::default()).unwrap();
        grid.recentre_with(centre, |cell| cell);
        grid.bounds().iter().for_each(|cell| *grid.get_mut(cell).unwrap() = cell);
        let places = (0..grid.tile_count()).flat_map(|tile| (0..TILE * TILE).map(move |at| (tile, at)));
        let mut stored: Vec<_> = places
            .filter_map(|(tile, at)| {
                let cell = grid.cell_in(tile, at)?;
                assert_eq!(grid.tile(tile)[at], cell, "place {at} of tile {tile}");
                Some(cell)
            })
            .collect();
        stored.sort_unstable();
        let mut cells: Vec<_> = grid.bounds().iter().collect();
        cells.sort_unstable();
        assert_eq!(stored, cells);
        assert_eq!(grid.cell_in(grid.tile_count(), 0), None);
        assert_eq!(grid.cell_in(0, TILE * TILE), None);
    };
    check(1, CellIndex::new(0, 0));
    check(8, CellIndex::new(5, -3));
    check(21, CellIndex::new(-100, 7));
    check(24, CellIndex::new(1000, -1001));
}
