//! Occupancy grids.

use super::{Conversion, Source, Unusable};
use crate::any::AnyMessage;
use crate::foxglove::packed_element_field::NumericType;
use crate::foxglove::{Grid, PackedElementField, Vector2};

pub(super) const OCCUPANCY_GRID: Conversion = Conversion {
    from: "nav_msgs/OccupancyGrid",
    signature: "iIsiIfIIddddddd[]c",
    to: "foxglove.Grid",
    convert: occupancy_grid,
};

/// One field, `cost`: probabilities 0 to 100 become costs 0 to 250; any other value (-1) becomes 255, unknown. In both
/// formats rows run along x from the origin of the grid, and the next row lies in +y.
fn occupancy_grid(source: &mut Source<'_>) -> Result<AnyMessage, Unusable> {
    let header = source.header()?;
    // The time at which the map was loaded.
    let (_, _) = (source.cursor.i32()?, source.cursor.u32()?);
    let resolution = f64::from(source.cursor.f32()?);
    let (width, height) = (source.cursor.u32()?, source.cursor.u32()?);
    let origin = source.pose()?;
    let cells = source.shared()?;
    let (got, expected) = (cells.len() as u64, u64::from(width) * u64::from(height));
    if got != expected {
        return Err(Unusable::Content { what: "cells of the grid", got, expected });
    }
    let cost = |cell: &u8| if *cell <= 100 { (u16::from(*cell) * 5 / 2) as u8 } else { u8::MAX };
    Ok(AnyMessage::new(Grid {
        timestamp: header.timestamp,
        frame_id: header.frame_id,
        pose: Some(origin),
        column_count: width,
        cell_size: Some(Vector2 { x: resolution, y: resolution }),
        row_stride: width,
        cell_stride: 1,
        fields: vec![PackedElementField {
            name: "cost".to_owned(),
            offset: 0,
            r#type: NumericType::Uint8.into(),
        }],
        data: cells.iter().map(cost).collect(),
    }))
}
