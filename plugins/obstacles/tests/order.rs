//! `obstacles` on the bench: range data that come twice or late.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use rcs_msg::foxglove::packed_element_field::NumericType;
use rcs_msg::foxglove::{PackedElementField, PointCloud};
use rcs_msg::{AnyMessage, Stamp};
use rcs_obstacles::Obstacles;
use rcs_runtime::{ExternalEvent, ProcessType};
use rcs_testkit::bench::{Bench, Setup};

const STACK: &str = r#"
format = 1
name = "obstacles"

[[process]]
name = "obstacles"
plugin = "obstacles"
supervisor = "viewer"
period_ms = 50.0
inputs = { cloud = "/operator/cloud" }

[process.params]
pose = { source = "POSE_FIXED" }
mount = { fixed = true, height_m = 1.0 }
"#;

/// Flat ground 2 to 10 m ahead of a sensor 1 m above it.
fn cloud() -> PointCloud {
    let places = (20..100).flat_map(|x| (-20..20).map(move |y| [x as f32 * 0.1, y as f32 * 0.1, -1.0]));
    let data: Vec<u8> = places.flatten().flat_map(f32::to_le_bytes).collect();
    let fields = ["x", "y", "z"].iter().zip([0, 4, 8]).map(|(name, offset)| PackedElementField {
        name: (*name).to_owned(),
        offset,
        r#type: NumericType::Float32.into(),
    });
    PointCloud {
        frame_id: "lidar".to_owned(),
        point_stride: 12,
        fields: fields.collect(),
        data: data.into(),
        ..PointCloud::default()
    }
}

/// Gives a cloud of a time, and says how many cost maps have been sent since the start, and how many faults.
fn give(bench: &mut Bench, time_ms: u64) -> (u64, u64) {
    let message = AnyMessage::new(cloud());
    bench
        .session
        .write(ExternalEvent::sensed("/operator/cloud", Stamp(time_ms * 1_000_000), message))
        .unwrap();
    bench.cycles(50, 2);
    (bench.sent("/obstacles/cost"), bench.faults("obstacles").0)
}

#[test]
fn a_cloud_that_comes_twice_or_late_is_a_fault_and_one_from_the_future_does_not_make_the_next_late() {
    let mut bench = Setup::new(STACK, &[ProcessType::of::<Obstacles>()]).bench();
    bench.advance(1_000);
    assert_eq!(give(&mut bench, 900), (1, 0));
    assert_eq!(give(&mut bench, 900), (1, 1), "it comes twice");
    assert_eq!(give(&mut bench, 850), (1, 2), "it comes late");
    assert!(bench.faults("obstacles").1.contains("0.050 s older than the one before"));
    assert_eq!(give(&mut bench, 950), (2, 2));
    assert_eq!(give(&mut bench, 3_600_000), (3, 2));
    assert_eq!(give(&mut bench, 1_000), (4, 2));
}
