//! Reads the fields of a `foxglove.Grid` of any origin, or of one of our maps, in place; and fuses one again with other
//! weights.

use std::borrow::Cow;

use rcs_geom::{DVec2, DVec3, Pose};
use rcs_msg::AnyMessage;
use rcs_msg::foxglove::Grid;
pub use rcs_msg::foxglove::packed_element_field::NumericType;

use crate::columns::{Column, columns};
use crate::fusion::Fuser;
use crate::{Evidence, MapMessage, Source, SourceKind, Weights};

/// Why a grid cannot be read, or a field is not available.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GridViewError {
    /// The grid has no cells, or more than any map has.
    #[error("grid has {columns} columns and {rows} rows, expected 1 to {MAX_SIDE} each")]
    Size {
        /// Columns of the grid.
        columns: usize,
        /// Complete rows in its data.
        rows: usize,
    },
    /// A row is shorter than its cells.
    #[error(
        "row stride is {row_stride} bytes, expected at least {columns} columns of {cell_stride} bytes, and not 0"
    )]
    Stride {
        /// Bytes per row.
        row_stride: usize,
        /// Bytes per cell.
        cell_stride: usize,
        /// Columns of the grid.
        columns: usize,
    },
    /// The data do not end at the end of a row.
    #[error("grid data have {got} bytes, expected a multiple of the row stride {row_stride}")]
    Data {
        /// Length of the data, bytes.
        got: usize,
        /// Bytes per row.
        row_stride: usize,
    },
    /// The cell size is not a positive number.
    #[error("cell size is {x} m by {y} m, expected finite numbers above 0")]
    CellSize {
        /// Metres.
        x: f64,
        /// Metres.
        y: f64,
    },
    /// The pose of the corner is not a pose.
    #[error("pose of the grid's corner is wrong: {0}")]
    Pose(#[from] rcs_geom::PoseError),
    /// A field ends beyond the cell, or its type is not known.
    #[error(
        "field \"{name}\" at offset {offset} with type {kind} does not fit a cell of {cell_stride} bytes"
    )]
    Field {
        /// Name of the field.
        name: String,
        /// Offset of its end from the start of the cell, bytes.
        offset: usize,
        /// Number of its type.
        kind: i32,
        /// Size of a cell, bytes.
        cell_stride: usize,
    },
    /// There are more fields than any map has.
    #[error("grid has {got} fields, expected at most {MAX_FIELDS}")]
    Fields {
        /// Number of fields.
        got: usize,
    },
    /// Two fields have the same name.
    #[error("field \"{name}\" is there twice")]
    Twice {
        /// Name of the field.
        name: String,
    },
    /// The grid has no field of this name.
    #[error("grid has no field \"{name}\"")]
    Missing {
        /// Name of the field.
        name: String,
    },
    /// The field has another type.
    #[error("field \"{name}\" is {got}, expected {expected}")]
    Type {
        /// Name of the field.
        name: String,
        /// Its type.
        got: &'static str,
        /// The expected type.
        expected: &'static str,
    },
    /// The message is not a grid, or does not decode.
    #[error("message is a {got}, expected a foxglove.Grid that decodes")]
    Message {
        /// Name of its type.
        got: String,
    },
    /// There is no field `cost.<source>` to fuse.
    #[error("grid has no field cost.<source>")]
    NoSources,
}

/// Greatest accepted side, cells.
const MAX_SIDE: usize = 1 << 15;
/// Greatest accepted number of fields; names are compared with each other.
const MAX_FIELDS: usize = 1024;

/// A checked `foxglove.Grid`, in which every field of every cell lies within the data; or a [`MapMessage`], which has
/// the same fields and is read without a conversion.
///
/// Column c, row r is the cell whose corner nearest to the grid's origin is at `(c·cell_size.x, r·cell_size.y)` in the
/// frame of [`GridView::frame_from_grid`]. In our maps that is west to east and south to north.
#[derive(Clone, Debug)]
pub struct GridView<'a> {
    columns: usize,
    rows: usize,
    cell_size_m: DVec2,
    frame_id: &'a str,
    frame_from_grid: Pose,
    fields: Vec<(Cow<'a, str>, FieldLocation, NumericType)>,
    cells: Cells<'a>,
}

/// Where the numbers are stored.
#[derive(Clone, Debug)]
enum Cells<'a> {
    Bytes { row_stride: usize, cell_stride: usize, data: &'a [u8] },
    Map(&'a MapMessage),
}

/// Position of a field within a cell.
#[derive(Clone, Copy, Debug)]
enum FieldLocation {
    Offset(usize),
    Column(Column),
}

impl<'a> GridView<'a> {
    /// Checks sizes, strides, offsets, types and lengths.
    pub fn new(grid: &'a Grid) -> Result<GridView<'a>, GridViewError> {
        let columns = grid.column_count as usize;
        let (row_stride, cell_stride) = (grid.row_stride as usize, grid.cell_stride as usize);
        // Sizes have 32 bits, so that their products fit into 64 bits.
        if cell_stride == 0 || row_stride == 0 || columns as u64 * cell_stride as u64 > row_stride as u64 {
            return Err(GridViewError::Stride { row_stride, cell_stride, columns });
        }
        let data: &[u8] = &grid.data;
        if !data.len().is_multiple_of(row_stride) {
            return Err(GridViewError::Data { got: data.len(), row_stride });
        }
        let rows = data.len() / row_stride;
        if !(1..=MAX_SIDE).contains(&columns) || !(1..=MAX_SIDE).contains(&rows) {
            return Err(GridViewError::Size { columns, rows });
        }
        let size = grid.cell_size.unwrap_or_default();
        let usable = |v: f64| v.is_finite() && v > 0.0;
        if !usable(size.x) || !usable(size.y) {
            return Err(GridViewError::CellSize { x: size.x, y: size.y });
        }
        if grid.fields.len() > MAX_FIELDS {
            return Err(GridViewError::Fields { got: grid.fields.len() });
        }
        let mut fields: Vec<(Cow<'_, str>, FieldLocation, NumericType)> =
            Vec::with_capacity(grid.fields.len());
        for field in &grid.fields {
            let (name, offset) = (field.name.as_str(), field.offset as usize);
            let kind = NumericType::try_from(field.r#type).unwrap_or(NumericType::Unknown);
            if kind == NumericType::Unknown || offset.saturating_add(bytes_of(kind)) > cell_stride {
                let (name, kind) = (name.to_owned(), field.r#type);
                return Err(GridViewError::Field { name, offset, kind, cell_stride });
            }
            if fields.iter().any(|(other, ..)| other == name) {
                return Err(GridViewError::Twice { name: name.to_owned() });
            }
            fields.push((name.into(), FieldLocation::Offset(offset), kind));
        }
        let frame_from_grid = corner(grid)?;
        let cell_size_m = DVec2::new(size.x, size.y);
        let cells = Cells::Bytes { row_stride, cell_stride, data };
        let frame_id = grid.frame_id.as_str();
        Ok(GridView { columns, rows, cell_size_m, frame_id, frame_from_grid, fields, cells })
    }

    /// A view of one of our maps, with the fields that its message would have; no message is made.
    pub fn of_map(message: &'a MapMessage) -> GridView<'a> {
        let (map, options) = (message.map(), message.options());
        let corner = map.grid().origin();
        let fields = columns(options).into_iter();
        GridView {
            columns: map.side(),
            rows: map.side(),
            cell_size_m: DVec2::splat(map.grid().cell_size_m()),
            frame_id: message.frame_id(),
            frame_from_grid: Pose { translation: DVec3::new(corner.x, corner.y, 0.0), ..Pose::IDENTITY },
            fields: fields
                .map(|(name, kind, column)| (name.into(), FieldLocation::Column(column), kind))
                .collect(),
            cells: Cells::Map(message),
        }
    }

    /// A view of a message: of the map itself if it is one of ours, else of the `foxglove.Grid`.
    pub fn of(message: &'a AnyMessage) -> Result<GridView<'a>, GridViewError> {
        if let Some(map) = message.source::<MapMessage>() {
            return Ok(GridView::of_map(map));
        }
        match message.get::<Grid>() {
            Some(grid) => GridView::new(grid),
            None => Err(GridViewError::Message { got: message.schema().name().to_owned() }),
        }
    }

    /// Cells along x.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Cells along y.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Size of a cell along x and y, m.
    pub fn cell_size_m(&self) -> DVec2 {
        self.cell_size_m
    }

    /// The frame of the message.
    pub fn frame_id(&self) -> &'a str {
        self.frame_id
    }

    /// Pose of the grid's corner in the frame of the message.
    pub fn frame_from_grid(&self) -> Pose {
        self.frame_from_grid
    }

    /// Middle of the grid in the frame of the message, m.
    pub fn middle(&self) -> DVec2 {
        let size_m = DVec2::new(self.columns as f64, self.rows as f64) * self.cell_size_m;
        (self.frame_from_grid * (0.5 * size_m).extend(0.0)).truncate()
    }

    /// Names of the fields, in the order of the message.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.fields.iter().map(|(name, ..)| &**name)
    }

    /// A field by name.
    pub fn field(&self, name: &str) -> Result<Field<'_>, GridViewError> {
        let found = self.fields.iter().find(|(other, ..)| other == name);
        let &(_, place, kind) = found.ok_or_else(|| GridViewError::Missing { name: name.to_owned() })?;
        Ok(Field { grid: self, place, kind })
    }

    /// A field by name, which must have this type.
    pub fn field_of(&self, name: &str, kind: NumericType) -> Result<Field<'_>, GridViewError> {
        let field = self.field(name)?;
        if field.kind != kind {
            let (got, expected) = (field.kind.as_str_name(), kind.as_str_name());
            return Err(GridViewError::Type { name: name.to_owned(), got, expected });
        }
        Ok(field)
    }

    /// The sources whose costs the grid holds, in the order of its fields.
    pub fn sources(&self) -> crate::Sources {
        let names = self.names().filter_map(|name| name.strip_prefix("cost."));
        names.filter_map(|name| name.parse::<Source>().ok()).collect()
    }

    /// Whether a source judges by appearance: the grid says by which model, or a source of this name does so by default
    /// ([`Weights::default`]). Any other source senses shape or distance, touches, or tells slip or what an earlier run knew.
    pub fn is_learned(&self, source: Source) -> bool {
        let has_model = self.names().any(|name| name.strip_prefix("model.") == Some(source.name()));
        has_model || Weights::default().get(source).kind == SourceKind::Learned
    }

    /// The bytes of all cells: by rows, each cell with its stride; empty if the view is of a map.
    fn bytes(&self) -> impl Iterator<Item = &'a [u8]> {
        let columns = self.columns;
        let (row_stride, cell_stride, data) = match self.cells {
            Cells::Bytes { row_stride, cell_stride, data } => (row_stride, cell_stride, data),
            Cells::Map(_) => (1, 1, [].as_slice()),
        };
        data.chunks_exact(row_stride).flat_map(move |row| row.chunks_exact(cell_stride).take(columns))
    }
}

/// One field of a [`GridView`].
#[derive(Clone, Copy, Debug)]
pub struct Field<'a> {
    grid: &'a GridView<'a>,
    place: FieldLocation,
    kind: NumericType,
}

impl Field<'_> {
    /// Its type in the message.
    pub fn kind(&self) -> NumericType {
        self.kind
    }

    /// The number in a cell; `None` outside of the grid.
    pub fn get(&self, column: usize, row: usize) -> Option<f64> {
        if column >= self.grid.columns || row >= self.grid.rows {
            return None;
        }
        match (&self.grid.cells, self.place) {
            (&Cells::Bytes { row_stride, cell_stride, data }, FieldLocation::Offset(offset)) => {
                self.read(data.get(row * row_stride + column * cell_stride + offset..)?)
            }
            (Cells::Map(message), FieldLocation::Column(number)) => {
                let cell = message.map().grid().bounds().south_west.offset(column as i64, row as i64);
                number.at(message, cell)
            }
            _ => None,
        }
    }

    /// The numbers of all cells by rows.
    pub fn values(&self) -> impl Iterator<Item = f64> {
        let numbers: Vec<f64> = match (&self.grid.cells, self.place) {
            // The view has checked the bounds, so that the bytes are always there.
            (Cells::Bytes { .. }, FieldLocation::Offset(offset)) => {
                let number = |cell: &[u8]| cell.get(offset..).and_then(|b| self.read(b)).unwrap_or(f64::NAN);
                self.grid.bytes().map(number).collect()
            }
            (Cells::Map(message), FieldLocation::Column(number)) => {
                let mut numbers = Vec::with_capacity(self.grid.columns * self.grid.rows);
                number.each(message, |value| numbers.push(value));
                numbers
            }
            _ => Vec::new(),
        };
        numbers.into_iter()
    }

    /// The numbers of a `UINT8` field of all cells by rows, into an existing buffer. Does nothing for fields of other
    /// types.
    pub fn bytes_into(&self, bytes: &mut Vec<u8>) {
        bytes.clear();
        if self.kind != NumericType::Uint8 {
            return;
        }
        bytes.reserve(self.grid.columns * self.grid.rows);
        match (&self.grid.cells, self.place) {
            (&Cells::Bytes { row_stride, cell_stride, data }, FieldLocation::Offset(offset)) => {
                bytes.resize(self.grid.columns * self.grid.rows, 0);
                let rows = data.chunks_exact(row_stride).zip(bytes.chunks_exact_mut(self.grid.columns));
                for (row, bytes) in rows {
                    for (byte, cell) in bytes.iter_mut().zip(row.chunks_exact(cell_stride)) {
                        *byte = cell[offset];
                    }
                }
            }
            (Cells::Map(message), FieldLocation::Column(Column::FusedCost)) => {
                message.each_cost(|cost| bytes.push(cost));
            }
            (Cells::Map(message), FieldLocation::Column(number)) => {
                number.each(message, |value| bytes.push(value as u8));
            }
            _ => {}
        }
    }

    fn read(&self, bytes: &[u8]) -> Option<f64> {
        Some(match self.kind {
            NumericType::Unknown => return None,
            NumericType::Uint8 => f64::from(*bytes.first()?),
            NumericType::Int8 => f64::from(i8::from_le_bytes(*bytes.first_chunk()?)),
            NumericType::Uint16 => f64::from(u16::from_le_bytes(*bytes.first_chunk()?)),
            NumericType::Int16 => f64::from(i16::from_le_bytes(*bytes.first_chunk()?)),
            NumericType::Uint32 => f64::from(u32::from_le_bytes(*bytes.first_chunk()?)),
            NumericType::Int32 => f64::from(i32::from_le_bytes(*bytes.first_chunk()?)),
            NumericType::Float32 => f64::from(f32::from_le_bytes(*bytes.first_chunk()?)),
            NumericType::Float64 => f64::from_le_bytes(*bytes.first_chunk()?),
        })
    }
}

/// Fuses the cells of a received grid with these weights, by rows, into an existing buffer: one cost per byte, 255
/// unknown. The sources are those with fields `cost.<source>` and `conf.<source>`, both `UINT8`; a field
/// `backing.<source>` may follow. The rule is [`crate::fuse`].
pub fn fuse_grid(view: &GridView<'_>, weights: &Weights, costs: &mut Vec<u8>) -> Result<(), GridViewError> {
    costs.clear();
    costs.reserve(view.columns * view.rows);
    if let Cells::Map(message) = view.cells {
        message.map().for_each_fused(weights, |_, fused| costs.push(fused.cost));
        return Ok(());
    }
    let mut places = Vec::new();
    let sources = view.sources();
    for source in sources.iter() {
        let offset =
            |field: Field<'_>| if let FieldLocation::Offset(offset) = field.place { offset } else { 0 };
        let cost_at = view.field_of(&format!("cost.{source}"), NumericType::Uint8).map(offset)?;
        let confidence_at = view.field_of(&format!("conf.{source}"), NumericType::Uint8).map(offset)?;
        let backing_at = view.field_of(&format!("backing.{source}"), NumericType::Uint8).map(offset).ok();
        places.push((cost_at, confidence_at, backing_at));
    }
    if places.is_empty() {
        return Err(GridViewError::NoSources);
    }
    let layers = weights.placed(sources.iter());
    let fuser = Fuser::new(&layers);
    costs.extend(view.bytes().map(|cell| {
        let said = |place: usize| {
            let (cost_at, confidence_at, backing_at) = places[place];
            let backing = backing_at.map_or(0, |at| cell[at]);
            Evidence { cost: cell[cost_at], confidence: cell[confidence_at], backing, ..Evidence::NONE }
        };
        fuser.fuse(said).cost
    }));
    Ok(())
}

/// Pose of the grid's corner; parts that the message omits are those of the identity.
fn corner(grid: &Grid) -> Result<Pose, GridViewError> {
    let pose = grid.pose.unwrap_or_default();
    let p = pose.position.unwrap_or_default();
    let rotation = match pose.orientation {
        Some(q) if [q.x, q.y, q.z, q.w] != [0.0; 4] => [q.x, q.y, q.z, q.w],
        _ => [0.0, 0.0, 0.0, 1.0],
    };
    Ok(Pose::from_parts([p.x, p.y, p.z], rotation)?)
}

const fn bytes_of(kind: NumericType) -> usize {
    match kind {
        NumericType::Unknown => 0,
        NumericType::Uint8 | NumericType::Int8 => 1,
        NumericType::Uint16 | NumericType::Int16 => 2,
        NumericType::Uint32 | NumericType::Int32 | NumericType::Float32 => 4,
        NumericType::Float64 => 8,
    }
}

#[cfg(test)]
#[path = "grid_view_tests.rs"]
mod tests;
