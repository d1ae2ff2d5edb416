//! The true map: which cells are blocked, and by which thing.

use crate::EvalError;
use rcs_geom::{CellIndex, DVec2, DVec3};
use rcs_msg::foxglove::Grid;
use rcs_scene::Class;
use rcs_world::GridView;

/// Longer things are cut: a part holds the cells at most this far from its first one along either axis, m, so that each
/// part of a fence is met by itself.
const PART_M: f64 = 1.5;

/// One thing that blocks: adjoining blocked cells of one class, cut where they are long.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Thing {
    /// Name of its class.
    pub(crate) kind: String,
    /// Middle of its cells in the frame of the map, m.
    pub(crate) at: DVec2,
    cells: u32,
}

/// The true map.
#[derive(Clone, Debug)]
pub(crate) struct Truth {
    pub(crate) grid: Grid,
    /// Number of the thing in each cell, by rows; `None` in cells that do not block.
    pub(crate) thing: Vec<Option<u32>>,
    pub(crate) things: Vec<Thing>,
    /// Height of the soil in each cell, by rows, m.
    pub(crate) ground_m: Vec<f64>,
    /// Height of the top of what stands there, by rows, m.
    pub(crate) top_m: Vec<f64>,
}

impl Truth {
    /// Whether a grid has the field of a true map.
    pub(crate) fn is_one(grid: &Grid) -> bool {
        grid.fields.iter().any(|field| field.name == "blocked")
    }

    /// The true map of a grid with the field `blocked`; the field `class` names its things. Without the fields `height`
    /// and `vegetation`, the ground is level, and what blocks is 1 m high.
    pub(crate) fn new(grid: Grid) -> Result<Truth, EvalError> {
        let refused = |error: rcs_world::GridViewError| EvalError::nothing(format!("true map: {error}"));
        let view = GridView::new(&grid).map_err(refused)?;
        let blocked: Vec<bool> =
            view.field("blocked").map_err(refused)?.values().map(|value| value > 0.0).collect();
        let class: Vec<u8> = match view.field("class") {
            Ok(field) => field.values().map(|value| value as u8).collect(),
            Err(_) => vec![0; blocked.len()],
        };
        let heights_m = |name: &str| view.field(name).ok().map(|field| field.values().collect::<Vec<f64>>());
        let ground_m = heights_m("height").unwrap_or_else(|| vec![0.0; blocked.len()]);
        let cover_m = heights_m("vegetation")
            .unwrap_or_else(|| blocked.iter().map(|&blocked| f64::from(u8::from(blocked))).collect());
        let top_m = ground_m.iter().zip(&cover_m).map(|(ground_m, cover_m)| ground_m + cover_m).collect();
        let (thing, things) = things(&view, &blocked, &class);
        Ok(Truth { grid, thing, things, ground_m, top_m })
    }
}

/// Numbers the things: adjoining cells of one class, cut by squares where they are longer than one.
fn things(view: &GridView<'_>, blocked: &[bool], class: &[u8]) -> (Vec<Option<u32>>, Vec<Thing>) {
    let (columns, rows) = (view.columns() as i64, view.rows() as i64);
    let size = view.cell_size_m();
    let slot = |cell: CellIndex| {
        let inside = (0..columns).contains(&cell.x) && (0..rows).contains(&cell.y);
        inside.then_some((cell.y * columns + cell.x) as usize)
    };
    let mut numbers = vec![None; blocked.len()];
    let mut found: Vec<Thing> = Vec::new();
    for start in 0..blocked.len() {
        if !blocked[start] || numbers[start].is_some() {
            continue;
        }
        let first = CellIndex::new(start as i64 % columns, start as i64 / columns);
        let is_in_part = |cell: CellIndex| {
            let offset = DVec2::new((cell.x - first.x) as f64, (cell.y - first.y) as f64) * size;
            offset.abs().max_element() <= PART_M
        };
        let number = found.len() as u32;
        numbers[start] = Some(number);
        let (mut patch, mut next, mut sum) = (vec![first], 0, DVec2::ZERO);
        while let Some(&cell) = patch.get(next) {
            next += 1;
            sum += DVec2::new(cell.x as f64 + 0.5, cell.y as f64 + 0.5) * size;
            for (dx, dy) in (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dx, dy))) {
                let neighbour = cell.offset(dx, dy);
                let Some(at) = slot(neighbour) else { continue };
                let same = blocked[at] && class[at] == class[start] && is_in_part(neighbour);
                if same && numbers[at].is_none() {
                    numbers[at] = Some(number);
                    patch.push(neighbour);
                }
            }
        }
        let middle = sum / patch.len() as f64;
        let at = (view.frame_from_grid() * DVec3::new(middle.x, middle.y, 0.0)).truncate();
        found.push(Thing { kind: kind(class[start]), at, cells: patch.len() as u32 });
    }
    (numbers, found)
}

/// Name of a class; that of a surface stands for a steep face or growth that does not give way.
fn kind(class: u8) -> String {
    match Class::from_code(class) {
        Some(class) if class.is_surface() => format!("ground of {}", class.name()),
        Some(class) => class.name().to_owned(),
        None => format!("class {class}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::obstacles::tests::true_map;

    #[test]
    fn adjoining_cells_are_one_thing_and_a_long_one_is_cut() {
        let grid = true_map(&[[1, 1], [2, 2], [7, 1]], &[]);
        let truth = Truth::new(grid).unwrap();
        let cells: Vec<u32> = truth.things.iter().map(|thing| thing.cells).collect();
        assert_eq!(cells, [2, 1]);
        let middle = truth.things[0].at;
        assert!((middle - DVec2::new(0.4 - 20.0, 0.4 - 20.0)).length() < 1e-9, "{middle}");
        let fence: Vec<[usize; 2]> = (0..60).map(|x| [x + 20, 50]).collect();
        let truth = Truth::new(true_map(&fence, &[])).unwrap();
        assert!((5..=8).contains(&truth.things.len()), "{:?}", truth.things);
        assert_eq!(truth.things.iter().map(|thing| thing.cells).sum::<u32>(), 60);
    }
}
