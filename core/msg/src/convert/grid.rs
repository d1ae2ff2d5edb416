//! Occupancy grids and costmaps. In these messages, as in `foxglove.Grid`, rows run along x from the origin of the grid,
//! and the next row lies in +y.

use super::{Conversion, Header, Source, Unusable, expect};
use crate::any::AnyMessage;
use crate::foxglove::packed_element_field::NumericType;
use crate::foxglove::{Grid, PackedElementField, Pose, Vector2};
use bytes::Bytes;

pub(super) const OCCUPANCY_GRID: Conversion = Conversion {
    from: "nav_msgs/OccupancyGrid",
    signature: "iIsiIfIIddddddd[]c",
    to: "foxglove.Grid",
    convert: occupancy_grid,
};

pub(super) const COSTMAP: Conversion = Conversion {
    from: "nav2_msgs/Costmap",
    signature: "iIsiIiIsfIIddddddd[]B",
    to: "foxglove.Grid",
    convert: costmap,
};

/// A `nav_msgs/OccupancyGrid`.
pub(super) struct Occupancy {
    pub(super) header: Header,
    resolution_m: f64,
    pub(super) width: u32,
    pub(super) height: u32,
    origin: Pose,
    /// One byte each, row by row; shared with the message.
    pub(super) cells: Bytes,
}

impl Occupancy {
    pub(super) fn read(source: &mut Source<'_>) -> Result<Self, Unusable> {
        let header = source.header()?;
        // The time at which the map was loaded.
        let (_, _) = (source.cursor.i32()?, source.cursor.u32()?);
        let resolution_m = f64::from(source.cursor.f32()?);
        let (width, height) = (source.cursor.u32()?, source.cursor.u32()?);
        let origin = source.pose()?;
        let cells = source.shared()?;
        check_cells(cells.len(), width, height)?;
        Ok(Self { header, resolution_m, width, height, origin, cells })
    }
}

/// One field, `cost`: probabilities 0 to 100 become costs 0 to 250; any other value (-1) becomes 255, unknown.
fn occupancy_grid(source: &mut Source<'_>) -> Result<AnyMessage, Unusable> {
    let Occupancy { header, resolution_m, width, origin, cells, .. } = Occupancy::read(source)?;
    let cost = |cell: &u8| if *cell <= 100 { (u16::from(*cell) * 5 / 2) as u8 } else { u8::MAX };
    Ok(AnyMessage::new(Grid {
        timestamp: header.timestamp,
        frame_id: header.frame_id,
        pose: Some(origin),
        column_count: width,
        cell_size: Some(Vector2 { x: resolution_m, y: resolution_m }),
        row_stride: width,
        cell_stride: 1,
        fields: vec![byte("cost", 0)],
        data: cells.iter().map(cost).collect(),
    }))
}

/// Two fields. `cost`: 0 (free) to 254 (lethal) become costs 0 to 250, and 255 (no information) stays 255, unknown.
/// `costmap`: the value of the message, which is exact.
fn costmap(source: &mut Source<'_>) -> Result<AnyMessage, Unusable> {
    let header = source.header()?;
    // The times at which the map was loaded and updated, and the name of the layer.
    let (_, _) = (source.cursor.i32()?, source.cursor.u32()?);
    let (_, _) = (source.cursor.i32()?, source.cursor.u32()?);
    let _layer = source.cursor.text()?;
    let resolution = f64::from(source.cursor.f32()?);
    let (width, height) = (source.cursor.u32()?, source.cursor.u32()?);
    // The corner of cell (0, 0): Nav2 writes the centre of the cell less half a cell.
    let origin = source.pose()?;
    let cells = source.cursor.bytes()?;
    check_cells(cells.len(), width, height)?;
    let cost =
        |cell: u8| if cell == u8::MAX { cell } else { ((u16::from(cell) * 250 + 254 / 2) / 254) as u8 };
    let mut data = Vec::with_capacity(2 * cells.len());
    for cell in cells {
        data.extend([cost(*cell), *cell]);
    }
    Ok(AnyMessage::new(Grid {
        timestamp: header.timestamp,
        frame_id: header.frame_id,
        pose: Some(origin),
        column_count: width,
        cell_size: Some(Vector2 { x: resolution, y: resolution }),
        row_stride: width.saturating_mul(2),
        cell_stride: 2,
        fields: vec![byte("cost", 0), byte("costmap", 1)],
        data: data.into(),
    }))
}

fn check_cells(got: usize, width: u32, height: u32) -> Result<(), Unusable> {
    expect("cells of the grid", got as u64, u64::from(width) * u64::from(height))
}

/// A field of one byte at an offset in the cell.
fn byte(name: &str, offset: u32) -> PackedElementField {
    PackedElementField { name: name.to_owned(), offset, r#type: NumericType::Uint8.into() }
}
