//! Geometry: moving a map with the vehicle, by overwriting one row of cells and by copying all cells.

use criterion::{Criterion, criterion_group, criterion_main};
use rcs_geom::{CellIndex, ScrollGrid};

/// Cells per side of the world model's map, and the size of one of its cells in bytes.
const SIDE: usize = 201;
type Cell = [u8; 24];

fn scroll(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("geom/scroll/201x201");
    group.bench_function("one_cell/ring", |bench| {
        let mut grid = ScrollGrid::new(SIDE, 0.2, Cell::default()).expect("a grid of that size");
        let mut x = 0;
        bench.iter(|| {
            x += 1;
            grid.recentre(CellIndex::new(x, 0)).len()
        });
    });
    group.bench_function("one_cell/ring_with_snapshot", |bench| {
        // A clone shares every tile until it is written, so this is the cost of a snapshot before each move.
        let mut grid = ScrollGrid::new(SIDE, 0.2, Cell::default()).expect("a grid of that size");
        let mut x = 0;
        bench.iter(|| {
            x += 1;
            let snapshot = grid.clone();
            let exposed = grid.recentre(CellIndex::new(x, 0)).len();
            (snapshot, exposed)
        });
    });
    group.bench_function("one_cell/copy_all", |bench| {
        let mut cells = vec![Cell::default(); SIDE * SIDE];
        bench.iter(|| {
            for row in cells.chunks_exact_mut(SIDE) {
                row.copy_within(1.., 0);
                row[SIDE - 1] = Cell::default();
            }
            cells[SIDE * SIDE / 2][0]
        });
    });
    group.finish();
}

criterion_group!(benches, scroll);
criterion_main!(benches);
