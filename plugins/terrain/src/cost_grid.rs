//! Costs of the cells around the vehicle as a message to the world model.

use rcs_geom::CellIndex;
use rcs_msg::Stamp;
use rcs_msg::foxglove::packed_element_field::NumericType;
use rcs_msg::foxglove::{Grid, PackedElementField, Pose, Quaternion, Vector2, Vector3};
use rcs_world::{SIDE, Source};

/// A grid of 201×201 cells with the one field `cost.<source>` (u8, 0–250, 255 unknown), by rows from the south-west.
/// `south_west` is the corner cell, counted from the frame's origin.
pub fn message(
    source: Source,
    frame_id: &str,
    time: Stamp,
    south_west: CellIndex,
    cell_size_m: f64,
    costs: Vec<u8>,
) -> Grid {
    let CellIndex { x, y } = south_west;
    let corner = Vector3 { x: x as f64 * cell_size_m, y: y as f64 * cell_size_m, z: 0.0 };
    Grid {
        timestamp: Some(time.to_proto()),
        frame_id: frame_id.to_owned(),
        pose: Some(Pose {
            position: Some(corner),
            orientation: Some(Quaternion { w: 1.0, ..Quaternion::default() }),
        }),
        column_count: SIDE as u32,
        cell_size: Some(Vector2 { x: cell_size_m, y: cell_size_m }),
        row_stride: SIDE as u32,
        cell_stride: 1,
        fields: vec![PackedElementField {
            name: format!("cost.{source}"),
            offset: 0,
            r#type: NumericType::Uint8.into(),
        }],
        data: costs.into(),
    }
}
