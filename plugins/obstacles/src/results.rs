//! Output messages of one frame of range data.

use crate::columns::Strip;
use crate::cost_map::CostMap;
use crate::proto::ObstacleStats;
use crate::scan::Label;
use rcs_geom::Pose;
use rcs_msg::Stamp;
use rcs_msg::foxglove::packed_element_field::NumericType;
use rcs_msg::foxglove::{PackedElementField, PointCloud};
use rcs_sense::pose_message;
use rcs_world::{MAX_COST, OBSTACLE_COST};

/// Number of pixels with a label over all strips.
pub(crate) fn count(strips: &[Strip], label: Label) -> u64 {
    strips.iter().map(|strip| strip.counts[label as usize]).sum()
}

/// Counts of one frame except those of negative obstacles; `without_range` is the number of points in no strip.
pub(crate) fn stats(strips: &[Strip], without_range: u64, map: &CostMap, time: Stamp) -> ObstacleStats {
    let used = |range: &&Strip| range.range_m[1] > 0.0;
    let nearest = strips.iter().filter(used).map(|strip| strip.range_m[0]).fold(f32::INFINITY, f32::min);
    let farthest = strips.iter().filter(used).map(|strip| strip.range_m[1]).fold(0.0, f32::max);
    ObstacleStats {
        timestamp: Some(time.to_proto()),
        invalid: count(strips, Label::Invalid) + without_range,
        ground: count(strips, Label::Ground),
        obstacle: count(strips, Label::Obstacle),
        short_obstacle: count(strips, Label::ShortObstacle),
        cover: count(strips, Label::Cover),
        too_far: count(strips, Label::TooFar),
        min_range_m: if farthest > 0.0 { f64::from(nearest) } else { 0.0 },
        max_range_m: f64::from(farthest),
        cells: map.costs().filter(|&cost| cost <= MAX_COST).count() as u64,
        obstacle_cells: map.costs().filter(|cost| (OBSTACLE_COST..=MAX_COST).contains(cost)).count() as u64,
        ..ObstacleStats::default()
    }
}

/// The labelled points: `x`, `y`, `z` (f32, m) and `label` (u8), 16 bytes per point.
pub(crate) fn labelled_cloud(
    message: &PointCloud,
    cloud: &rcs_msg::Points<'_>,
    origin: &Pose,
    labels: &[Label],
) -> PointCloud {
    let mut data = Vec::with_capacity(labels.len() * 16);
    for (point, &label) in cloud.iter().zip(labels) {
        if label != Label::Invalid {
            for value in point.position.to_array() {
                data.extend_from_slice(&(value as f32).to_le_bytes());
            }
            data.extend_from_slice(&[label as u8, 0, 0, 0]);
        }
    }
    let field = |name: &str, offset: u32, r#type: NumericType| PackedElementField {
        name: name.to_owned(),
        offset,
        r#type: r#type.into(),
    };
    PointCloud {
        timestamp: message.timestamp,
        frame_id: message.frame_id.clone(),
        pose: Some(pose_message(origin)),
        point_stride: 16,
        fields: vec![
            field("x", 0, NumericType::Float32),
            field("y", 4, NumericType::Float32),
            field("z", 8, NumericType::Float32),
            field("label", 12, NumericType::Uint8),
        ],
        data: data.into(),
    }
}
