//! `label_overlay` on the bench: how the points come into the camera.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use rcs_msg::foxglove::packed_element_field::NumericType;
use rcs_msg::foxglove::{
    CameraCalibration, Odometry, PackedElementField, PointCloud, Pose, PoseInFrame, Quaternion, RawImage,
    Vector3,
};
use rcs_obstacles::LabelOverlay;
use rcs_runtime::ProcessType;
use rcs_testkit::bench::{Bench, Setup};

const STACK: &str = "format = 1\nname = \"overlay\"\n[[process]]\nname = \"overlay\"\nplugin = \"label_overlay\"\n\
    supervisor = \"viewer\"\nperiod_ms = 100\n\
    inputs = { points = \"/operator/points\", calibration = \"/operator/calibration\", odometry = \"/operator/odometry\", pose = \"/operator/pose\" }\n\
    [process.params]\nmount = { fixed = true, height_m = 0.0 }\npoint_radius_px = 0\n";

const LABEL: u8 = 2;

fn bench(params: &[(&str, &str)]) -> Bench {
    let plugins = [ProcessType::of::<LabelOverlay>()];
    let mut bench = Setup::new(STACK, &plugins).params(params).bench();
    bench.write(
        "/operator/calibration",
        CameraCalibration {
            frame_id: "camera".to_owned(),
            width: 41,
            height: 31,
            k: vec![40.0, 0.0, 20.0, 0.0, 40.0, 15.0, 0.0, 0.0, 1.0],
            ..CameraCalibration::default()
        },
    );
    bench
}

/// One labelled point at (12, 3, 0) of a frame.
fn cloud(frame: &str) -> PointCloud {
    let field = |name: &str, offset, kind: NumericType| PackedElementField {
        name: name.to_owned(),
        offset,
        r#type: kind.into(),
    };
    let data: Vec<u8> = [12.0_f32, 3.0, 0.0].iter().flat_map(|v| v.to_le_bytes()).chain([LABEL]).collect();
    PointCloud {
        frame_id: frame.to_owned(),
        point_stride: 13,
        fields: vec![
            field("x", 0, NumericType::Float32),
            field("y", 4, NumericType::Float32),
            field("z", 8, NumericType::Float32),
            field("label", 12, NumericType::Uint8),
        ],
        data: data.into(),
        ..PointCloud::default()
    }
}

/// At (2, 3, 0), looking along x: the point is 10 m ahead.
fn vehicle() -> Pose {
    Pose {
        position: Some(Vector3 { x: 2.0, y: 3.0, z: 0.0 }),
        orientation: Some(Quaternion { w: 1.0, ..Quaternion::default() }),
    }
}

fn assert_in_the_middle(bench: &Bench) {
    assert_eq!(bench.faults("overlay"), (0, String::new()));
    let labels: RawImage = bench.latest("/overlay/labels");
    let painted: Vec<_> = (0..labels.data.len()).filter(|&at| labels.data[at] == LABEL).collect();
    assert_eq!(painted, [15 * 41 + 20]);
}

#[test]
fn points_in_the_local_frame_come_into_the_camera_by_odometry() {
    let mut bench = bench(&[]);
    let frame_id = "local".to_owned();
    bench.write("/operator/odometry", Odometry { frame_id, pose: Some(vehicle()), ..Odometry::default() });
    bench.write("/operator/points", cloud("local"));
    bench.cycles(100, 3);
    assert_in_the_middle(&bench);
}

#[test]
fn points_in_the_local_frame_come_into_the_camera_by_a_pose_stream() {
    let mut bench = bench(&[]);
    let frame_id = "local".to_owned();
    bench.write("/operator/pose", PoseInFrame { frame_id, pose: Some(vehicle()), ..PoseInFrame::default() });
    bench.write("/operator/points", cloud("local"));
    bench.cycles(100, 3);
    assert_in_the_middle(&bench);
}

#[test]
fn points_on_the_vehicle_need_its_mount_alone() {
    let mut bench = bench(&[("overlay.pose.vehicle_frame", "base")]);
    bench.write(
        "/operator/points",
        PointCloud {
            pose: Some(Pose {
                position: Some(Vector3 { x: -2.0, y: -3.0, z: 0.0 }),
                orientation: Some(Quaternion { w: 1.0, ..Quaternion::default() }),
            }),
            ..cloud("base")
        },
    );
    bench.cycles(100, 3);
    assert_in_the_middle(&bench);
}

#[test]
fn points_of_a_frame_that_nothing_connects_are_a_fault() {
    let mut bench = bench(&[]);
    bench.write("/operator/points", cloud("lidar"));
    bench.cycles(100, 3);
    let (faults, last) = bench.faults("overlay");
    assert!(faults == 1 && last.contains("is unknown"), "{faults} {last}");
    assert_eq!(bench.sent("/overlay/labels"), 0);
}
