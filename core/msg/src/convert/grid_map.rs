//! Maps of the package `grid_map`: layers of numbers over the same cells.
//!
//! Each layer is a matrix, whose rows count along -x and whose columns count along -y, from the corner of the map with the
//! greatest x and y. A map that moves with its robot does not copy its cells: the matrix is a circular buffer in both
//! directions, and the start indices say which row and column lie at that corner.
//!
//! | | |
//! | --- | --- |
//! | length of a side along x | rows × resolution, m |
//! | centre of the cell `[row, column]`, counted from the start indices | centre + length / 2 - (`[row, column]` + 0.5) × resolution |
//! | dimensions of an array | `column_index`, then `row_index`: rows are adjacent in memory; or the reverse |
//!
//! The rules are those of `getPositionFromIndex` in `grid_map_core`. `grid_map` itself ignores the orientation of the map,
//! and always writes the identity.

use super::{Conversion, Source, Unusable, expect};
use crate::any::AnyMessage;
use crate::foxglove::packed_element_field::NumericType;
use crate::foxglove::{Grid, PackedElementField, Pose, Vector2, Vector3};
use crate::packed::Number;
use glam::{DQuat, DVec3};

pub(super) const GRID_MAP: Conversion = Conversion {
    from: "grid_map_msgs/GridMap",
    signature: "iIsdddddddddd[]s[]s[]([](sII)I[]f)HH",
    to: "foxglove.Grid",
    convert: grid_map,
};

/// Greatest number of layers; a `foxglove.Grid` with more fields is not drawn.
const MAX_LAYERS: usize = 1024;
/// Greatest number of rows and of columns; a larger `foxglove.Grid` is not drawn.
const MAX_SIDE: f64 = 32_768.0;
/// Bytes of a number.
const NUMBER: usize = 4;
/// Least bytes of a text, of a dimension of an array, and of an array.
const TEXT_SIZE: usize = 4;
const DIMENSION_SIZE: usize = 12;
const ARRAY_SIZE: usize = 12;

/// One field of 32-bit floats for each layer. Numbers that are not finite become NaN, unknown. A map without layers
/// becomes a grid without cells.
fn grid_map(source: &mut Source<'_>) -> Result<AnyMessage, Unusable> {
    let header = source.header()?;
    let resolution = source.cursor.f64()?;
    if !(resolution.is_finite() && resolution > 0.0) {
        let (what, expected) = ("resolution of the grid map", "a finite number above 0");
        return Err(Unusable::Number { what, got: resolution, expected });
    }
    let rows = side("rows of the grid map", source.cursor.f64()? / resolution)?;
    let columns = side("columns of the grid map", source.cursor.f64()? / resolution)?;
    let center = source.pose()?;
    let names = texts(source)?;
    // `grid_map` calls a cell invalid if one of these layers has no number there. Here each layer stands for itself.
    let _basic_layers = texts(source)?;
    let count = source.cursor.length(ARRAY_SIZE)?;
    expect("arrays of the grid map", count as u64, names.len() as u64)?;
    let layers = (0..count).map(|_| layer(source, [rows, columns])).collect::<Result<Vec<_>, Unusable>>()?;
    let first_row = start("start index of the rows", source.cursor.u16()?, rows)?;
    let first_column = start("start index of the columns", source.cursor.u16()?, columns)?;

    let data = cells(&layers, [rows, columns], [first_row, first_column]);
    let stride = layers.len() * NUMBER;
    let half_m = DVec3::new(rows as f64, columns as f64, 0.0) * (resolution / 2.0);
    let fields = names.into_iter().enumerate().map(|(index, name)| PackedElementField {
        name,
        offset: (index * NUMBER) as u32,
        r#type: NumericType::Float32.into(),
    });
    Ok(AnyMessage::new(Grid {
        timestamp: header.timestamp,
        frame_id: header.frame_id,
        pose: Some(corner(center, half_m)),
        column_count: if data.is_empty() { 0 } else { rows as u32 },
        cell_size: Some(Vector2 { x: resolution, y: resolution }),
        row_stride: (rows * stride) as u32,
        cell_stride: stride as u32,
        fields: fields.collect(),
        data: data.into(),
    }))
}

/// A number of rows or columns.
fn side(what: &'static str, cells: f64) -> Result<usize, Unusable> {
    let cells = cells.round();
    if (0.0..=MAX_SIDE).contains(&cells) {
        Ok(cells as usize)
    } else {
        Err(Unusable::Number { what, got: cells, expected: "0 to 32768" })
    }
}

/// Names of layers.
fn texts(source: &mut Source<'_>) -> Result<Vec<String>, Unusable> {
    let count = source.cursor.length(TEXT_SIZE)?;
    if count > MAX_LAYERS {
        let (got, most) = (count as u64, MAX_LAYERS as u64);
        return Err(Unusable::Above { what: "layers of the grid map", got, most });
    }
    (0..count).map(|_| Ok(source.cursor.string()?)).collect()
}

/// A start index of the circular buffer.
fn start(what: &'static str, index: u16, count: usize) -> Result<usize, Unusable> {
    let (index, most) = (usize::from(index), count.saturating_sub(1));
    if index <= most {
        Ok(index)
    } else {
        Err(Unusable::Above { what, got: index as u64, most: most as u64 })
    }
}

/// A layer: its numbers in the layout of the message.
struct Layer<'a> {
    numbers: &'a [u8],
    big_endian: bool,
    /// From a row to the next one, and from a column to the next one, numbers.
    row_step: usize,
    column_step: usize,
}

/// Reads a `std_msgs/Float32MultiArray`. `grid_map` takes every array whose first dimension is not labelled `row_index`
/// for one by columns; so do we.
fn layer<'a>(source: &mut Source<'a>, [rows, columns]: [usize; 2]) -> Result<Layer<'a>, Unusable> {
    let dimensions = source.cursor.length(DIMENSION_SIZE)?;
    expect("dimensions of a layer", dimensions as u64, 2)?;
    let (outer_label, outer) = dimension(source)?;
    let (_, inner) = dimension(source)?;
    let is_by_rows = outer_label == b"row_index";
    let [got_rows, got_columns] = if is_by_rows { [outer, inner] } else { [inner, outer] };
    expect("rows of a layer", got_rows, rows as u64)?;
    expect("columns of a layer", got_columns, columns as u64)?;
    let padding = source.cursor.u32()?;
    let count = source.cursor.length(NUMBER)?;
    let cells = rows as u64 * columns as u64;
    expect("numbers of a layer", count as u64, u64::from(padding) + cells)?;
    let numbers = source.cursor.numbers(Number::F32, count)?;
    let [row_step, column_step] = if is_by_rows { [columns, 1] } else { [1, rows] };
    Ok(Layer {
        numbers: numbers.get(padding as usize * NUMBER..).unwrap_or_default(),
        big_endian: source.cursor.big_endian(),
        row_step,
        column_step,
    })
}

/// The label and the size of a dimension.
fn dimension<'a>(source: &mut Source<'a>) -> Result<(&'a [u8], u64), Unusable> {
    let (label, size, _stride) = (source.cursor.text()?, source.cursor.u32()?, source.cursor.u32()?);
    Ok((label, size.into()))
}

impl Layer<'_> {
    /// The number in a row and a column of the matrix; NaN if it is not finite.
    fn number(&self, row: usize, column: usize) -> f32 {
        let at = (row * self.row_step + column * self.column_step) * NUMBER;
        let bytes = self.numbers.get(at..).and_then(|rest| rest.first_chunk::<NUMBER>()).copied();
        let read = if self.big_endian { f32::from_be_bytes } else { f32::from_le_bytes };
        bytes.map(read).filter(|number| number.is_finite()).unwrap_or(f32::NAN)
    }
}

/// The cells in the order of a `foxglove.Grid`: along +x from the corner with the least x and y, the next row in +y.
fn cells(
    layers: &[Layer<'_>],
    [rows, columns]: [usize; 2],
    [first_row, first_column]: [usize; 2],
) -> Vec<u8> {
    let mut data = Vec::with_capacity(rows * columns * layers.len() * NUMBER);
    if layers.is_empty() {
        return data;
    }
    for column in (0..columns).rev().map(|column| (first_column + column) % columns) {
        for row in (0..rows).rev().map(|row| (first_row + row) % rows) {
            for layer in layers {
                data.extend(layer.number(row, column).to_le_bytes());
            }
        }
    }
    data
}

/// Pose of the corner with the least x and y, from that of the centre; `half_m` leads from the corner to the centre.
fn corner(center: Pose, half_m: DVec3) -> Pose {
    let q = center.orientation.unwrap_or_default();
    let frame_from_map = match [q.x, q.y, q.z, q.w] {
        // An orientation that was never set.
        [0.0, 0.0, 0.0, 0.0] => DQuat::IDENTITY,
        rotation => DQuat::from_array(rotation).normalize(),
    };
    let p = center.position.unwrap_or_default();
    let p = DVec3::new(p.x, p.y, p.z) - frame_from_map * half_m;
    Pose { position: Some(Vector3 { x: p.x, y: p.y, z: p.z }), ..center }
}
