//! A `foxglove.Grid` as cells: reading every number of a cell, and painting one of them.

use egui::{Color32, ColorImage};
use ocu_ui::palette::{self, MapPalette};
use rcs_geom::{DVec3, Pose};
use rcs_msg::Number;
use rcs_msg::foxglove::Grid;
use rcs_msg::foxglove::packed_element_field::NumericType;

/// The largest side of a grid that is painted.
const MOST_CELLS: usize = 8192;

/// One number that each cell has.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Field {
    /// Its name: `cost.stereo`.
    pub(super) name: String,
    offset: usize,
    number: Number,
}

/// A grid whose layout has been checked: reading its cells cannot fail.
#[derive(Clone, Debug)]
pub(super) struct Cells<'a> {
    data: &'a [u8],
    row_stride: usize,
    cell_stride: usize,
    /// Cells along x.
    pub(super) columns: usize,
    /// Cells along y.
    pub(super) rows: usize,
    /// Size of a cell along x and y, in metres.
    pub(super) cell_m: [f64; 2],
    /// The corner of cell (0, 0), and the directions of columns and rows, in the grid's frame.
    pub(super) frame_from_grid: Pose,
    /// The numbers of a cell.
    pub(super) fields: Vec<Field>,
}

impl<'a> Cells<'a> {
    /// Checks a grid; a sentence where its numbers do not fit each other.
    pub(super) fn new(grid: &'a Grid) -> Result<Self, String> {
        let (row_stride, cell_stride) = (grid.row_stride as usize, grid.cell_stride as usize);
        let columns = grid.column_count as usize;
        if columns == 0 || cell_stride == 0 || row_stride < columns.saturating_mul(cell_stride) {
            return Err(format!(
                "rows of {row_stride} bytes do not hold {columns} cells of {cell_stride} bytes"
            ));
        }
        let rows = grid.data.len() / row_stride;
        if rows == 0 || rows > MOST_CELLS || columns > MOST_CELLS {
            return Err(format!("a grid of {columns} × {rows} cells cannot be shown"));
        }
        let size = grid.cell_size.unwrap_or_default();
        if !(size.x > 0.0 && size.y > 0.0 && size.x.is_finite() && size.y.is_finite()) {
            return Err(format!("a cell of {} m × {} m has no size", size.x, size.y));
        }
        let fields = grid.fields.iter().filter_map(|field| {
            let number = number(field.r#type())?;
            let offset = field.offset as usize;
            (offset + number.size() <= cell_stride).then(|| Field {
                name: field.name.clone(),
                offset,
                number,
            })
        });
        let frame_from_grid = crate::pose::from_message(grid.pose.as_ref())?;
        let fields = fields.collect();
        let cell_m = [size.x, size.y];
        Ok(Self { data: &grid.data, row_stride, cell_stride, columns, rows, cell_m, frame_from_grid, fields })
    }

    /// A number of a cell; NaN outside of the grid.
    pub(super) fn read(&self, field: &Field, column: usize, row: usize) -> f64 {
        let start = row * self.row_stride + column * self.cell_stride + field.offset;
        let bytes = self.data.get(start..start + field.number.size());
        bytes
            .and_then(|bytes| field.number.read(bytes, false))
            .and_then(|value| value.as_f64())
            .unwrap_or(f64::NAN)
    }

    /// The cell that holds a point of the grid's frame.
    pub(super) fn cell_at(&self, p_frame: DVec3) -> Option<[usize; 2]> {
        let p = self.frame_from_grid.inverse() * p_frame;
        let (column, row) = (p.x / self.cell_m[0], p.y / self.cell_m[1]);
        let inside = column >= 0.0 && row >= 0.0 && column < self.columns as f64 && row < self.rows as f64;
        inside.then_some([column as usize, row as usize])
    }

    /// The four corners in the grid's frame: (0, 0), along x, across, along y.
    pub(super) fn corners(&self) -> [DVec3; 4] {
        let (x, y) = (self.columns as f64 * self.cell_m[0], self.rows as f64 * self.cell_m[1]);
        [DVec3::ZERO, DVec3::new(x, 0.0, 0.0), DVec3::new(x, y, 0.0), DVec3::new(0.0, y, 0.0)]
            .map(|p| self.frame_from_grid * p)
    }

    /// What can be painted: the fused cost where there are costs of sources, then every field.
    pub(super) fn choices(&self) -> Vec<Shade> {
        let fused = self.fields.iter().any(|field| field.name.starts_with("cost.")).then_some(Shade::Fused);
        fused.into_iter().chain(self.fields.iter().map(|field| Shade::Field(field.name.clone()))).collect()
    }

    /// What a saved name means here: the first choice where it names nothing.
    pub(super) fn shade(&self, name: Option<&str>) -> Option<Shade> {
        let choices = self.choices();
        let found = choices.iter().find(|choice| Some(choice.name()) == name);
        // A grid of many fields with one that is called cost: that is the one to look at.
        let cost = choices.iter().find(|choice| choice.name() == "cost");
        found.or(cost).or(choices.first()).cloned()
    }

    /// The 2 % and 98 % numbers of a field; `None` for costs and confidences, whose range is known.
    pub(super) fn range(&self, shade: &Shade) -> Option<[f64; 2]> {
        let Shade::Field(name) = shade else { return None };
        if is_cost(name) {
            return None;
        }
        let field = self.fields.iter().find(|field| field.name == *name)?;
        let every = (self.columns * self.rows / 20_000).max(1);
        let indices = (0..self.columns * self.rows).step_by(every);
        let mut values: Vec<f64> =
            indices.map(|i| self.read(field, i % self.columns, i / self.columns)).collect();
        values.retain(|value| value.is_finite());
        values.sort_by(f64::total_cmp);
        let at =
            |fraction: f64| values.get((values.len().saturating_sub(1) as f64 * fraction) as usize).copied();
        Some([at(0.02)?, at(0.98)?])
    }

    /// One pixel a cell, row 0 first.
    pub(super) fn paint(&self, shade: &Shade, palette: MapPalette, range: Option<[f64; 2]>) -> ColorImage {
        let mut pixels = Vec::with_capacity(self.columns * self.rows);
        match shade {
            Shade::Fused => {
                let fused = super::fused::Fused::new(self);
                let costs: [Color32; 256] = std::array::from_fn(|cost| palette.cost(cost as u8));
                for row in 0..self.rows {
                    pixels.extend(
                        (0..self.columns).map(|column| costs[usize::from(fused.cost(self, column, row))]),
                    );
                }
            }
            Shade::Field(name) => {
                let Some(field) = self.fields.iter().find(|field| field.name == *name) else {
                    return ColorImage::filled([self.columns, self.rows], Color32::TRANSPARENT);
                };
                let cost = is_cost(name);
                let [low, high] = range.unwrap_or([0.0, 255.0]);
                for row in 0..self.rows {
                    pixels.extend((0..self.columns).map(|column| match self.read(field, column, row) {
                        value if cost && (0.0..=250.0).contains(&value) => palette.cost(value as u8),
                        _ if cost => palette.unknown(),
                        value => palette::even((value - low) / (high - low).max(1e-9)),
                    }));
                }
            }
        }
        ColorImage::new([self.columns, self.rows], pixels)
    }
}

/// Which number of its cells a grid is painted by.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Shade {
    /// All sources' costs fused.
    Fused,
    /// One field.
    Field(String),
}

impl Shade {
    /// Name in lists and layouts.
    pub(super) fn name(&self) -> &str {
        match self {
            Self::Fused => "fused cost",
            Self::Field(name) => name,
        }
    }

    /// Whether the colours are those of costs.
    pub(super) fn is_cost(&self) -> bool {
        matches!(self, Self::Fused) || is_cost(self.name())
    }
}

fn is_cost(name: &str) -> bool {
    name == "cost" || name.starts_with("cost.")
}

fn number(kind: NumericType) -> Option<Number> {
    Some(match kind {
        NumericType::Uint8 => Number::U8,
        NumericType::Int8 => Number::I8,
        NumericType::Uint16 => Number::U16,
        NumericType::Int16 => Number::I16,
        NumericType::Uint32 => Number::U32,
        NumericType::Int32 => Number::I32,
        NumericType::Float32 => Number::F32,
        NumericType::Float64 => Number::F64,
        NumericType::Unknown => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples;

    #[test]
    fn a_cell_is_found_by_its_place_and_gives_every_number() {
        let grid = samples::grid(4, 3);
        let cells = Cells::new(&grid).unwrap();
        let corner = cells.corners()[0];
        let cell = cells.cell_at(corner + DVec3::new(0.5, 0.3, 0.0)).unwrap();
        assert_eq!(cell, [2, 1]);
        let values: Vec<_> = cells.fields.iter().map(|field| cells.read(field, cell[0], cell[1])).collect();
        assert_eq!(values, [f64::from(samples::cost(2, 1)), 200.0, 7.0]);
        assert_eq!(cells.cell_at(corner + DVec3::new(-0.1, 0.0, 0.0)), None);
        assert_eq!(cells.cell_at(corner + DVec3::new(0.81, 0.0, 0.0)), None);
    }

    #[test]
    fn a_grid_whose_numbers_do_not_fit_is_refused() {
        let good = samples::grid(4, 3);
        for (bad, what) in [
            (Grid { row_stride: 3, ..good.clone() }, "rows of 3 bytes"),
            (Grid { cell_stride: 0, ..good.clone() }, "do not hold"),
            (Grid { cell_size: None, ..good.clone() }, "has no size"),
            (Grid { data: Vec::new().into(), ..good.clone() }, "cannot be shown"),
        ] {
            assert!(Cells::new(&bad).unwrap_err().contains(what), "{what}");
        }
    }

    #[test]
    fn costs_are_painted_in_the_palettes_colours_and_row_0_comes_first() {
        let grid = samples::grid(4, 3);
        let cells = Cells::new(&grid).unwrap();
        let image = cells.paint(&Shade::Field("cost.stereo".into()), MapPalette::Papers, None);
        assert_eq!(image.size, [4, 3]);
        for (i, pixel) in image.pixels.iter().enumerate() {
            assert_eq!(*pixel, MapPalette::Papers.cost(samples::cost(i % 4, i / 4)));
        }
    }

    #[test]
    fn a_layout_that_names_another_grids_field_falls_back_to_the_first_choice() {
        let grid = samples::grid(4, 3);
        let cells = Cells::new(&grid).unwrap();
        assert_eq!(cells.shade(Some("height")), Some(Shade::Fused));
        assert_eq!(cells.shade(Some("conf.stereo")), Some(Shade::Field("conf.stereo".into())));
    }
}
