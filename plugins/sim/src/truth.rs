//! Ground-truth messages: the whole world in cells, its objects, and the state of the vehicle.

use crate::contact::Contact;
use crate::scene::Scenery;
use crate::terrain::Terrain;
use crate::vehicle::Vehicle;
use bytes::Bytes;
use rcs_msg::Stamp;
use rcs_msg::foxglove::packed_element_field::NumericType;
use rcs_msg::foxglove::{Grid, PackedElementField, Point3, Pose, Quaternion, Vector2, Vector3};
use rcs_msg::rcs::{GroundTruthContact, GroundTruthObject, GroundTruthObjects, GroundTruthState};
use rcs_runtime::Pool;
use rcs_scene::TRUTH_CELL_M;
use rcs_sense::pose_message;

/// Bytes per cell: height (f32), cover (f32), class (u8), blocked (u8), and two bytes of padding.
const CELL_BYTES: usize = 12;

/// The cells of the whole world in the layout of a grid message: row 0 is the southernmost.
pub(crate) fn map_cells(scenery: &Scenery, pool: &Pool) -> Bytes {
    let world = &scenery.world;
    let [columns, rows] = world.truth_size();
    let mut data = vec![0; columns * rows * CELL_BYTES];
    pool.for_each_chunk_mut(&mut data, columns.max(1) * CELL_BYTES, |row, cells| {
        for (column, cell) in cells.chunks_exact_mut(CELL_BYTES).enumerate() {
            let Some(truth) = world.truth_cell(column, row) else { continue };
            cell[0..4].copy_from_slice(&(truth.ground_height_m as f32).to_le_bytes());
            cell[4..8].copy_from_slice(&(truth.cover_height_m as f32).to_le_bytes());
            cell[8] = truth.class.code();
            cell[9] = u8::from(truth.blocked);
        }
    });
    data.into()
}

/// The map message with these cells.
pub(crate) fn map_message(scenery: &Scenery, cells: &Bytes, time: Stamp) -> Grid {
    let low = scenery.world.bounds_m()[0];
    let [columns, _] = scenery.world.truth_size();
    let field = |name: &str, offset: u32, kind: NumericType| PackedElementField {
        name: name.to_owned(),
        offset,
        r#type: kind.into(),
    };
    Grid {
        timestamp: Some(time.to_proto()),
        frame_id: "global".to_owned(),
        pose: Some(Pose {
            position: Some(Vector3 { x: low.x, y: low.y, z: 0.0 }),
            orientation: Some(Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 }),
        }),
        column_count: columns as u32,
        cell_size: Some(Vector2 { x: TRUTH_CELL_M, y: TRUTH_CELL_M }),
        row_stride: (columns * CELL_BYTES) as u32,
        cell_stride: CELL_BYTES as u32,
        fields: vec![
            field("height", 0, NumericType::Float32),
            field("vegetation", 4, NumericType::Float32),
            field("class", 8, NumericType::Uint8),
            field("blocked", 9, NumericType::Uint8),
        ],
        data: cells.clone(),
    }
}

/// All objects of the world.
pub(crate) fn things_message(scenery: &Scenery, time: Stamp) -> GroundTruthObjects {
    let thing = |thing: &rcs_scene::Thing| GroundTruthObject {
        number: thing.number,
        kind: thing.kind.name().to_owned(),
        position: Some(Point3 { x: thing.position.x, y: thing.position.y, z: thing.position.z }),
        radius_m: thing.radius_m,
        height_m: thing.height_m,
    };
    GroundTruthObjects {
        timestamp: Some(time.to_proto()),
        things: scenery.world.things().iter().map(thing).collect(),
    }
}

/// The state of the vehicle.
pub(crate) fn state_message(
    vehicle: &Vehicle,
    terrain: &impl Terrain,
    remaining_m: f64,
    time: Stamp,
) -> GroundTruthState {
    let contact = |contact: &Contact| GroundTruthContact {
        thing: contact.thing,
        kind: terrain.kind(contact.thing).to_owned(),
        point: Some(Point3 { x: contact.point.x, y: contact.point.y, z: contact.point.z }),
        speed_mps: contact.speed_mps,
        on_bumper: contact.on_bumper,
        collision: contact.collision,
    };
    GroundTruthState {
        timestamp: Some(time.to_proto()),
        pose: Some(pose_message(&vehicle.pose)),
        speed_mps: vehicle.motion.speed_mps,
        yaw_rate_radps: vehicle.motion.yaw_rate_radps,
        left_slip: vehicle.slip[0],
        right_slip: vehicle.slip[1],
        contacts: vehicle
            .contacts
            .list()
            .iter()
            .filter(|contact| contact.is_present())
            .map(contact)
            .collect(),
        distance_m: vehicle.distance_m,
        remaining_m,
    }
}
