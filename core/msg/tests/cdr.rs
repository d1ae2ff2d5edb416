//! ROS 2 CDR: conversions of hand-made messages, both byte orders, and damaged messages.

mod calibration;
mod diagnostics;
mod foxglove_msgs;
mod maps;
mod stereo;

use bytes::Bytes;
use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use rcs_msg::{
    AnyMessage, FieldScanner, MessageEncoding, Schema, Value, canonical, canonical_name, foxglove,
    header_frame, header_stamp, points, rcs,
};
use rcs_testkit::peak_bytes;
use std::sync::Arc;

/// Writes CDR.
struct Writer {
    bytes: Vec<u8>,
    big_endian: bool,
}

impl Writer {
    fn new(big_endian: bool) -> Self {
        Self { bytes: vec![0, u8::from(!big_endian), 0, 0], big_endian }
    }

    fn fixed<const N: usize>(&mut self, mut little: [u8; N]) -> &mut Self {
        while !(self.bytes.len() - 4).is_multiple_of(N) {
            self.bytes.push(0);
        }
        if self.big_endian {
            little.reverse();
        }
        self.bytes.extend(little);
        self
    }

    fn u32(&mut self, v: u32) -> &mut Self {
        self.fixed(v.to_le_bytes())
    }

    fn u8(&mut self, v: u8) -> &mut Self {
        self.fixed([v])
    }

    fn floats(&mut self, all: &[f64]) -> &mut Self {
        for v in all {
            self.fixed(v.to_le_bytes());
        }
        self
    }

    fn text(&mut self, text: &str) -> &mut Self {
        self.u32(text.len() as u32 + 1);
        self.bytes.extend(text.as_bytes());
        self.u8(0)
    }

    fn data(&mut self, data: &[u8]) -> &mut Self {
        self.u32(data.len() as u32);
        self.bytes.extend(data);
        self
    }

    fn header(&mut self) -> &mut Self {
        self.u32(5).u32(7).text("map")
    }

    fn done(&mut self) -> Bytes {
        std::mem::take(&mut self.bytes).into()
    }
}

fn schema(name: &str, definition: &str) -> Arc<Schema> {
    Arc::new(Schema::new(
        name,
        MessageEncoding::Cdr,
        "ros2msg",
        Bytes::copy_from_slice(definition.as_bytes()),
    ))
}

/// A schema whose definition cannot be read, so that conversions go by its name.
fn named(name: &str) -> Arc<Schema> {
    Arc::new(Schema::new(name, MessageEncoding::Cdr, "ros2idl", Bytes::new()))
}

fn convert(name: &str, bytes: &Bytes) -> AnyMessage {
    let schema = named(name);
    let message = canonical(&schema, bytes).expect("a conversion is known").expect("it converts");
    assert_eq!(canonical_name(&schema), Some(message.schema().name()));
    message
}

#[test]
fn an_image_shares_its_pixels_with_the_message() {
    let mut writer = Writer::new(false);
    let bytes = writer.header().u32(1).u32(2).text("16UC1").u8(0).u32(4).data(&[1, 2, 3, 4]).done();
    let message = convert("sensor_msgs/msg/Image", &bytes);
    let image = message.get::<foxglove::RawImage>().expect("it is an image");
    assert_eq!((image.width, image.height, image.step, image.encoding.as_str()), (2, 1, 4, "16UC1"));
    assert_eq!(image.data.as_ptr(), bytes[bytes.len() - 4..].as_ptr());
    assert_eq!(header_stamp(&message).map(|stamp| stamp.0), Some(5_000_000_007));
    assert_eq!(header_frame(&message).as_deref(), Some("map"));

    let mut writer = Writer::new(true);
    let bytes = writer.header().u32(1).u32(2).text("16UC1").u8(1).u32(4).data(&[1, 2, 3, 4]).done();
    let message = convert("sensor_msgs/msg/Image", &bytes);
    assert_eq!(message.get::<foxglove::RawImage>().expect("it is an image").data, [2, 1, 4, 3][..]);
}

#[test]
fn compressed_formats_become_one_word_but_for_grey_of_16_bits_and_depth_becomes_a_png() {
    for (format, data, expect, kept) in [
        ("rgb8; jpeg compressed bgr8", vec![1; 20], "jpeg", 20),
        ("png", vec![1; 20], "png", 20),
        ("mono8; png compressed", vec![1; 20], "png", 20),
        ("mono16; png compressed", vec![1; 20], "mono16; png compressed", 20),
        ("16UC1; compressedDepth png", vec![1; 20], "png", 8),
        ("32FC1; compressedDepth png", vec![1; 20], "32FC1; compressedDepth png", 20),
    ] {
        let bytes = Writer::new(false).header().text(format).data(&data).done();
        let message = convert("sensor_msgs/msg/CompressedImage", &bytes);
        let image = message.get::<foxglove::CompressedImage>().expect("it is an image");
        assert_eq!((image.format.as_str(), image.data.len()), (expect, kept));
    }
}

fn cloud(big_endian: bool, height: u32, row_step: u32, data: &[u8]) -> Bytes {
    let mut writer = Writer::new(big_endian);
    writer.header().u32(height).u32(1).u32(3);
    for (at, name) in ["x", "y", "z"].iter().enumerate() {
        writer.text(name).u32(4 * at as u32).u8(7).u32(1);
    }
    writer.u8(u8::from(big_endian)).u32(12).u32(row_step).data(data).u8(1).done()
}

#[test]
fn a_cloud_shares_its_points_unless_rows_are_padded_or_numbers_big_endian() {
    let little: Vec<u8> = [1.0f32, 2.0, 3.0].iter().flat_map(|v| v.to_le_bytes()).collect();
    let big: Vec<u8> = [1.0f32, 2.0, 3.0].iter().flat_map(|v| v.to_be_bytes()).collect();
    let mut padded = little.clone();
    padded.extend([9; 4]);
    padded.extend(&little);
    for (bytes, count) in
        [(cloud(false, 1, 12, &little), 1), (cloud(true, 1, 12, &big), 1), (cloud(false, 2, 16, &padded), 2)]
    {
        let message = convert("sensor_msgs/msg/PointCloud2", &bytes);
        let cloud = message.get::<foxglove::PointCloud>().expect("it is a cloud");
        let positions: Vec<_> =
            points(cloud).expect("it is valid").iter().map(|p| p.position.to_array()).collect();
        assert_eq!(positions, vec![[1.0, 2.0, 3.0]; count]);
    }
    // A step of 0 is that of rows without padding.
    let message = convert("sensor_msgs/msg/PointCloud2", &cloud(false, 2, 0, &little.repeat(2)));
    assert_eq!(message.get::<foxglove::PointCloud>().expect("it is a cloud").data, little.repeat(2));
    let bytes = cloud(false, 1, 12, &little);
    let message = convert("sensor_msgs/msg/PointCloud2", &bytes);
    let data = &message.get::<foxglove::PointCloud>().expect("it is a cloud").data;
    assert!(bytes.as_ptr_range().contains(&data.as_ptr()));
    let short = cloud(false, 2, 12, &little);
    let error = canonical(&named("sensor_msgs/msg/PointCloud2"), &short).expect("it is known");
    let error = error.expect_err("a row is missing").to_string();
    assert!(error.contains("got 12, expected 24"), "{error}");
}

#[test]
fn a_default_cloud_is_empty_and_one_without_the_size_of_its_points_says_so() {
    let mut writer = Writer::new(false);
    let bytes = writer.header().u32(0).u32(0).u32(0).u8(0).u32(0).u32(0).data(&[]).u8(0).done();
    let message = convert("sensor_msgs/msg/PointCloud2", &bytes);
    let cloud = message.get::<foxglove::PointCloud>().expect("it is a cloud");
    assert!(points(cloud).expect("it is valid").is_empty());

    writer = Writer::new(false);
    writer.header().u32(1).u32(2).u32(1).text("x").u32(0).u8(7).u32(1);
    let bytes = writer.u8(0).u32(0).u32(0).data(&[0; 8]).u8(1).done();
    let message = convert("sensor_msgs/msg/PointCloud2", &bytes);
    let cloud = message.get::<foxglove::PointCloud>().expect("it is a cloud");
    let error = points(cloud).expect_err("nobody knows where its points lie").to_string();
    assert_eq!(error, "point cloud: size of a point is 0 bytes, expected at least 4");
}

/// A scan from `first_rad` on, with ranges from 0.5 m to `farthest_m`.
fn scan(big_endian: bool, angles_rad: [f32; 2], farthest_m: f32, lists: [&[f32]; 2]) -> Bytes {
    let mut writer = Writer::new(big_endian);
    writer.header();
    let [first_rad, step_rad] = angles_rad;
    for number in [first_rad, 0.0, step_rad, 0.0, 0.0, 0.5, farthest_m] {
        writer.fixed(number.to_le_bytes());
    }
    for list in lists {
        writer.u32(list.len() as u32);
        for number in list {
            writer.fixed(number.to_le_bytes());
        }
    }
    writer.done()
}

/// Positions in whole millimetres, and intensities.
fn returns(message: &AnyMessage) -> Vec<([f64; 3], Option<f32>)> {
    let cloud = message.get::<foxglove::PointCloud>().expect("it is a cloud");
    let points = points(cloud).expect("it is valid");
    points.iter().map(|p| (p.position.to_array().map(|m| (m * 1e3).round()), p.intensity)).collect()
}

#[test]
fn a_scan_becomes_the_points_of_its_returns() {
    // A scanner that turns clockwise, from the left to ahead and on.
    let turn = std::f32::consts::FRAC_PI_2;
    let ranges = [2.0, 3.0, f32::NAN, f32::INFINITY, 0.4, 11.0];
    for big_endian in [false, true] {
        let bytes = scan(big_endian, [turn, -turn], 10.0, [&ranges, &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]]);
        let message = convert("sensor_msgs/msg/LaserScan", &bytes);
        let expect = [([0.0, 2000.0, 0.0], Some(1.0)), ([3000.0, 0.0, 0.0], Some(2.0))];
        assert_eq!(returns(&message), expect);
        assert_eq!(header_stamp(&message).map(|stamp| stamp.0), Some(5_000_000_007));
        assert_eq!(header_frame(&message).as_deref(), Some("map"));
    }
    // Without intensities, and with limits that are not set.
    let bytes = scan(false, [0.0, turn], 0.0, [&[0.25, 0.0, 11.0], &[]]);
    let expect = [([250.0, 0.0, 0.0], None), ([-11_000.0, 0.0, 0.0], None)];
    assert_eq!(returns(&convert("sensor_msgs/msg/LaserScan", &bytes)), expect);
    let empty = convert("sensor_msgs/msg/LaserScan", &scan(false, [0.0, turn], 10.0, [&[], &[]]));
    assert!(returns(&empty).is_empty());
}

#[test]
fn a_scan_of_foxglove_in_a_log_becomes_a_cloud_and_one_of_a_stack_stays() {
    let scan = foxglove::LaserScan {
        frame_id: "laser".to_owned(),
        end_angle: std::f64::consts::PI,
        ranges: vec![1.0, 2.0, f64::NAN],
        ..foxglove::LaserScan::default()
    };
    let message = AnyMessage::new(scan);
    let own = message.schema();
    let stays = canonical(&own, &message.bytes()).expect("it is known").expect("it decodes");
    assert!(stays.holds::<foxglove::LaserScan>());
    assert_eq!(canonical_name(&own), Some("foxglove.LaserScan"));
    let logged = Schema::new(own.name(), MessageEncoding::Protobuf, "protobuf", own.data().clone());
    let cloud = canonical(&logged, &message.bytes()).expect("it is known").expect("it converts");
    assert_eq!(canonical_name(&logged), Some("foxglove.PointCloud"));
    assert_eq!(returns(&cloud), [([1000.0, 0.0, 0.0], None), ([0.0, 2000.0, 0.0], None)]);
    assert_eq!(header_frame(&cloud).as_deref(), Some("laser"));
}

#[test]
fn an_imu_without_orientation_has_none() {
    let mut writer = Writer::new(false);
    writer.header().floats(&[0.0, 0.0, 0.0, 1.0]).floats(&[-1.0]).floats(&[0.0; 8]);
    let bytes =
        writer.floats(&[1.0, 2.0, 3.0]).floats(&[0.5; 9]).floats(&[4.0, 5.0, 6.0]).floats(&[0.0; 9]).done();
    let message = convert("sensor_msgs/msg/Imu", &bytes);
    let imu = message.get::<rcs::Imu>().expect("it is an IMU");
    assert_eq!((imu.orientation, imu.orientation_covariance.len()), (None, 0));
    assert_eq!(imu.angular_velocity, Some(foxglove::Vector3 { x: 1.0, y: 2.0, z: 3.0 }));
    assert_eq!(imu.linear_acceleration, Some(foxglove::Vector3 { x: 4.0, y: 5.0, z: 6.0 }));
    assert_eq!(imu.angular_velocity_covariance, [0.5; 9]);
}

#[test]
fn odometry_and_fixes_keep_their_numbers() {
    let mut writer = Writer::new(true);
    writer.header().text("base").floats(&[1.0, 2.0, 3.0, 0.0, 0.0, 0.6, 0.8]).floats(&[0.1; 36]);
    let bytes = writer.floats(&[4.0, 5.0, 6.0, 7.0, 8.0, 9.0]).floats(&[0.2; 36]).done();
    let message = convert("nav_msgs/msg/Odometry", &bytes);
    let odometry = message.get::<foxglove::Odometry>().expect("it is odometry");
    assert_eq!((odometry.frame_id.as_str(), odometry.body_frame_id.as_str()), ("map", "base"));
    assert_eq!(odometry.pose.and_then(|pose| pose.orientation).map(|q| (q.z, q.w)), Some((0.6, 0.8)));
    assert_eq!(odometry.angular_velocity.map(|v| v.z), Some(9.0));
    assert_eq!((odometry.pose_covariance[35], odometry.velocity_covariance[35]), (0.1, 0.2));

    let mut writer = Writer::new(false);
    writer.header().u8(0xff).fixed(3u16.to_le_bytes()).floats(&[48.0, 9.0, 300.0]).floats(&[1.0; 9]);
    let message = convert("sensor_msgs/msg/NavSatFix", &writer.u8(2).done());
    let fix = message.get::<foxglove::LocationFix>().expect("it is a fix");
    assert_eq!((fix.latitude, fix.longitude, fix.altitude), (48.0, 9.0, 300.0));
    assert_eq!(fix.position_covariance_type(), foxglove::location_fix::PositionCovarianceType::DiagonalKnown);
    assert_eq!((fix.metadata[0].key.as_str(), fix.metadata[0].value.as_str()), ("status", "-1"));
}

#[test]
fn poses_paths_and_transforms_keep_their_frames() {
    let pose = [1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0];
    let message = convert("geometry_msgs/msg/PoseStamped", &Writer::new(false).header().floats(&pose).done());
    let stamped = message.get::<foxglove::PoseInFrame>().expect("it is a pose");
    assert_eq!(stamped.pose.and_then(|pose| pose.position).map(|p| p.y), Some(2.0));

    let mut writer = Writer::new(false);
    let bytes = writer.header().u32(2).header().floats(&pose).header().floats(&pose).done();
    let message = convert("nav_msgs/msg/Path", &bytes);
    assert_eq!(message.get::<foxglove::PosesInFrame>().expect("it is a path").poses.len(), 2);

    let mut writer = Writer::new(false);
    let bytes = writer.u32(5).u32(7).text("").u32(2).header().floats(&pose).header().floats(&pose).done();
    let message = convert("nav_msgs/msg/Path", &bytes);
    assert_eq!(header_frame(&message).as_deref(), Some("map"), "the frame is that of the first pose");

    let bytes = Writer::new(false).header().u32(2).floats(&pose).floats(&pose).done();
    let message = convert("geometry_msgs/msg/PoseArray", &bytes);
    let poses = message.get::<foxglove::PosesInFrame>().expect("they are poses");
    assert_eq!((poses.frame_id.as_str(), poses.poses.len()), ("map", 2));

    let bytes = Writer::new(false).header().floats(&pose).floats(&[0.1; 36]).done();
    let message = convert("geometry_msgs/msg/PoseWithCovarianceStamped", &bytes);
    let odometry = message.get::<foxglove::Odometry>().expect("it is odometry");
    assert_eq!((odometry.frame_id.as_str(), odometry.body_frame_id.as_str()), ("map", ""));
    assert_eq!(odometry.pose.and_then(|pose| pose.position).map(|p| p.z), Some(3.0));
    assert_eq!((odometry.pose_covariance.len(), odometry.linear_velocity), (36, None));

    let bytes = Writer::new(false).u32(1).header().text("base").floats(&pose).done();
    let message = convert("tf2_msgs/msg/TFMessage", &bytes);
    let transform = &message.get::<foxglove::FrameTransforms>().expect("it is transforms").transforms[0];
    assert_eq!((transform.parent_frame_id.as_str(), transform.child_frame_id.as_str()), ("map", "base"));
    assert_eq!(header_stamp(&message).map(|stamp| stamp.0), Some(5_000_000_007));
}

#[test]
fn occupancy_becomes_cost_and_minus_one_unknown() {
    let mut writer = Writer::new(false);
    writer.header().u32(0).u32(0).fixed(0.5f32.to_le_bytes()).u32(3).u32(1);
    let bytes = writer.floats(&[1.0, 2.0, 0.0, 0.0, 0.0, 0.0, 1.0]).data(&[0, 100, 0xff]).done();
    let message = convert("nav_msgs/msg/OccupancyGrid", &bytes);
    let grid = message.get::<foxglove::Grid>().expect("it is a grid");
    assert_eq!(grid.data, [0, 250, 255][..]);
    assert_eq!((grid.column_count, grid.row_stride, grid.cell_stride), (3, 3, 1));
    assert_eq!(grid.cell_size, Some(foxglove::Vector2 { x: 0.5, y: 0.5 }));
    assert_eq!(grid.fields[0].name, "cost");
}

#[test]
fn lines_of_a_log_keep_their_levels() {
    use foxglove::log::Level;
    for (number, expect) in [
        (0, Level::Unknown),
        (10, Level::Debug),
        (20, Level::Info),
        (30, Level::Warning),
        (40, Level::Error),
        (50, Level::Fatal),
    ] {
        let mut writer = Writer::new(false);
        writer.u32(5).u32(7).u8(number).text("planner").text("no path");
        let bytes = writer.text("a.cpp").text("run").u32(12).done();
        let message = convert("rcl_interfaces/msg/Log", &bytes);
        let log = message.get::<foxglove::Log>().expect("it is a line");
        assert_eq!(log.level(), expect);
        assert_eq!((log.name.as_str(), log.message.as_str()), ("planner", "no path"));
        assert_eq!((log.file.as_str(), log.line), ("a.cpp", 12));
        assert_eq!(header_stamp(&message).map(|stamp| stamp.0), Some(5_000_000_007));
    }
}

/// Definition of a header, as it is appended to that of a message.
const HEADER: &str = "\n===\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n===\n\
    MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n";
/// Definition of a pose.
const POSE: &str = "===\nMSG: geometry_msgs/Pose\nPoint position\nQuaternion orientation\n===\n\
    MSG: geometry_msgs/Point\nfloat64 x\nfloat64 y\nfloat64 z\n===\n\
    MSG: geometry_msgs/Quaternion\nfloat64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1\n";

#[test]
fn definitions_of_ros_2_are_those_that_the_conversions_expect() {
    let scan = "std_msgs/Header header\nfloat32 angle_min\nfloat32 angle_max\nfloat32 angle_increment\n\
        float32 time_increment\nfloat32 scan_time\nfloat32 range_min\nfloat32 range_max\nfloat32[] ranges\n\
        float32[] intensities";
    let log = "byte DEBUG=10\nbyte FATAL=50\nbuiltin_interfaces/Time stamp\nuint8 level\nstring name\nstring msg\n\
        string file\nstring function\nuint32 line";
    let stamped = "===\nMSG: geometry_msgs/PoseWithCovariance\nPose pose\nfloat64[36] covariance\n";
    for (name, text, expect) in [
        ("sensor_msgs/msg/LaserScan", format!("{scan}{HEADER}"), "foxglove.PointCloud"),
        ("rcl_interfaces/msg/Log", format!("{log}{HEADER}"), "foxglove.Log"),
        (
            "geometry_msgs/msg/PoseArray",
            format!("std_msgs/Header header\nPose[] poses{HEADER}{POSE}"),
            "foxglove.PosesInFrame",
        ),
        (
            "geometry_msgs/msg/PoseWithCovarianceStamped",
            format!("std_msgs/Header header\nPoseWithCovariance pose{HEADER}{stamped}{POSE}"),
            "foxglove.Odometry",
        ),
    ] {
        assert_eq!(canonical_name(&schema(name, &text)), Some(expect), "{name}");
    }
    // As it is stored, too, a line of a log has the time of its own stamp.
    let mut writer = Writer::new(false);
    writer.u32(5).u32(7).u8(20).text("a").text("b").text("c").text("d");
    let line = AnyMessage::encoded(
        schema("rcl_interfaces/msg/Log", &format!("{log}{HEADER}")),
        writer.u32(1).done(),
    );
    assert_eq!(header_stamp(&line).map(|stamp| stamp.0), Some(5_000_000_007));
}

#[test]
fn a_definition_that_means_something_else_is_refused() {
    let schema = schema("nav_msgs/msg/Path", "float64 length");
    let error = canonical(&schema, &Bytes::new()).expect("it is known").expect_err("it is another message");
    assert_eq!(error.to_string(), "nav_msgs/msg/Path is laid out as d, expected iIs[](iIsddddddd)");
    assert_eq!(canonical_name(&schema), None);
}

#[test]
fn what_has_no_reader_says_why() {
    let no_reader = [
        (
            Schema::new("a.A", MessageEncoding::from_name("flatbuffer"), "flatbuffer", Bytes::new()),
            "expected protobuf, cdr, ros1 or json",
        ),
        (
            Schema::new("a/A", MessageEncoding::Cdr, "ros2idl", Bytes::new()),
            "its definition is in \"ros2idl\"",
        ),
        (
            Schema::new("", MessageEncoding::from_name(""), "", Bytes::new()),
            "no reader for a message without a schema (encoding not stated): expected protobuf",
        ),
        (
            Schema::new("a/A", MessageEncoding::Cdr, "", Bytes::new()),
            "no reader for a/A (cdr): its definition was not recorded",
        ),
        (Schema::new("a.A", MessageEncoding::Protobuf, "protobuf", Bytes::new()), "does not define it"),
        (
            Schema::new("a.A", MessageEncoding::Protobuf, "protobuf", Bytes::from_static(&[1])),
            "does not decode",
        ),
        (Schema::new("a/A", MessageEncoding::Cdr, "ros2msg", Bytes::from_static(b"b/B x")), "got \"b/B\""),
    ];
    for (schema, expect) in no_reader {
        let error = schema.decodable().expect_err(expect).to_string();
        assert!(error.contains(expect), "{error}");
        assert_eq!(schema.value(&Bytes::new()).expect_err(expect).to_string(), error);
    }
}

#[test]
fn a_message_with_content_is_not_read_by_a_definition_without_fields() {
    let schema = schema("a/msg/Thing", "");
    for empty in [vec![0, 1, 0, 0, 0], vec![0, 1, 0, 0, 0, 0, 0, 0]] {
        schema.value(&empty.into()).expect("it is empty, perhaps with padding");
    }
    let bytes = Writer::new(false).floats(&[1.0]).done();
    let error = schema.value(&bytes).expect_err("its definition was not recorded").to_string();
    let reason = "got 12 bytes, expected at most 8: its definition has no fields";
    assert_eq!(error, format!("a/msg/Thing does not decode: {reason}"));
}

const DEFINITION: &str = "bool a\nint8[] b\nstring c\nPart[] parts\nfloat64[3] d\nwstring e\nuint8[] data\n\
    string[] names\nPart[2] pair\n===\nMSG: a/Part\nuint16 p\nfloat32[] q\nstring r\n";

fn sample(big_endian: bool) -> Bytes {
    let mut writer = Writer::new(big_endian);
    let part = |writer: &mut Writer, p: u16| {
        writer
            .fixed(p.to_le_bytes())
            .u32(2)
            .fixed(1.5f32.to_le_bytes())
            .fixed(2.5f32.to_le_bytes())
            .text("r");
    };
    writer.u8(1).data(&[1, 0xfe]).text("hello").u32(2);
    part(&mut writer, 7);
    part(&mut writer, 8);
    writer.floats(&[0.1, 0.2, 0.3]).u32(2).u32(u32::from(b'h')).u32(u32::from(b'i')).data(&[9, 8, 7]);
    writer.u32(2).text("x").text("yz");
    part(&mut writer, 1);
    part(&mut writer, 2);
    writer.done()
}

#[test]
fn the_tree_and_the_scanner_read_both_byte_orders() {
    let schema = schema("a/msg/Demo", DEFINITION);
    let data = [sample(false), sample(true)];
    for (path, expect) in [
        (".a", Some(1.0)),
        (".b[1]", Some(-2.0)),
        (".c.@length", Some(5.0)),
        (".parts.@length", Some(2.0)),
        (".parts[1].p", Some(8.0)),
        (".parts[1].q[1]", Some(2.5)),
        (".parts[2].p", None),
        (".d[2]", Some(0.3)),
        (".d[3]", None),
        (".data[1]", Some(8.0)),
        (".data.@length", Some(3.0)),
        (".names[1].@length", Some(2.0)),
        (".pair[1].p", Some(2.0)),
        (".pair.@length", Some(2.0)),
    ] {
        let path = path.parse().expect("a path");
        let scanner = FieldScanner::new(&schema, &path).expect("it is a number");
        for data in &data {
            let value = schema.value(data).expect("it reads");
            assert_eq!(value.get(&path).ok().and_then(|value| value.as_f64()), expect, "{path}");
            assert_eq!(scanner.scan(data), Ok(expect), "{path}");
        }
    }
    assert_eq!(schema.value(&data[0]).expect("it reads").field("e"), Some(&Value::Text("hi".into())));
}

#[test]
fn lengths_that_the_message_cannot_hold_reserve_nothing() {
    let before = peak_bytes();
    for definition in
        ["uint8[] x", "float64[] x", "string[] x", "string x", "wstring x", "P[] x\n===\nMSG: a/P\nuint8 y"]
    {
        let schema = schema("a/msg/A", definition);
        let bytes = Bytes::from_static(&[0, 1, 0, 0, 0xff, 0xff, 0xff, 0xff, 1, 2, 3, 4]);
        schema.value(&bytes).expect_err("it is too long");
    }
    for name in ["Image", "PointCloud2", "CameraInfo", "CompressedImage", "LaserScan"] {
        let bytes = Bytes::from(vec![0xff; 64]);
        canonical(&named(&format!("sensor_msgs/msg/{name}")), &bytes)
            .expect("it is known")
            .expect_err("it is too long");
    }
    for xcdr2 in [[0, 6], [0, 7], [0, 3]] {
        let error =
            schema("a/msg/A", "uint8 x").value(&Bytes::copy_from_slice(&[xcdr2[0], xcdr2[1], 0, 0, 1]));
        assert!(error.expect_err("it is another encoding").to_string().contains("plain CDR"));
    }
    if let Some((before, after)) = before.zip(peak_bytes()) {
        assert!(after - before < 64 << 20, "memory grew from {before} to {after} bytes");
    }
}

#[test]
fn a_message_that_rosbag2_has_compressed_by_itself_says_so() {
    let frame = Bytes::from_static(&[0x28, 0xb5, 0x2f, 0xfd, 0x20, 5, 0x29, 0, 0, 0, 1, 0, 0, 7]);
    let error = schema("a/msg/A", "uint8 x").value(&frame).expect_err("it is compressed").to_string();
    assert!(error.contains("compression mode `message`") && error.contains("`ros2 bag convert`"), "{error}");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 1000, rng_seed: RngSeed::Fixed(1), failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_damaged_message_is_an_error_or_another_message(
        big_endian in any::<bool>(),
        cut in any::<prop::sample::Index>(),
        flips in prop::collection::vec(any::<prop::sample::Index>(), 0..6),
    ) {
        let schema = schema("a/msg/Demo", DEFINITION);
        let mut data = sample(big_endian).to_vec();
        for flip in flips {
            let bit = flip.index(data.len() * 8);
            data[bit / 8] ^= 1 << (bit % 8);
        }
        data.truncate(cut.index(data.len() + 1));
        let data = Bytes::from(data);
        if let Ok(value) = schema.value(&data) {
            value.leaves().for_each(drop);
        }
        for path in [".parts[1].q[1]", ".pair[1].p", ".names[1].@length"] {
            let _ = FieldScanner::new(&schema, &path.parse().expect("a path")).expect("it is a number").scan(&data);
        }
        for name in [
            "sensor_msgs/Image", "sensor_msgs/PointCloud2", "sensor_msgs/LaserScan", "nav_msgs/Path",
            "nav_msgs/OccupancyGrid", "geometry_msgs/PoseArray", "rcl_interfaces/Log", "nav2_msgs/Costmap",
            "grid_map_msgs/GridMap", "geometry_msgs/PolygonStamped", "diagnostic_msgs/DiagnosticArray",
            "stereo_msgs/DisparityImage",
        ] {
            let _ = canonical(&named(name), &data);
        }
    }

    #[test]
    fn no_text_makes_the_definition_reader_panic(text in "([a-z/\\[\\]<=0-9 \"#\n]|uint8|string|MSG: |===\n|float64|\\[\\]){0,60}") {
        let schema = schema("a/msg/A", &text);
        let _ = schema.value(&Bytes::from_static(&[0, 1, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0, 0, 0, 0, 0]));
    }
}
