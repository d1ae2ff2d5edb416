//! Foxglove's messages in the encoding of ROS 2: the package `foxglove_msgs`.

use super::{HEADER, POSE, Writer, named, returns, schema};
use bytes::Bytes;
use rcs_msg::foxglove::line_primitive::Type;
use rcs_msg::foxglove::{CameraCalibration, CompressedImage, Point3, SceneUpdate};
use rcs_msg::{AnyMessage, canonical, canonical_name, header_frame, header_stamp};

fn read(name: &str, definition: &str, bytes: &Bytes) -> AnyMessage {
    let schema = schema(name, &format!("{definition}{HEADER}{POSE}"));
    let message = canonical(&schema, bytes).expect("a conversion is known").expect("it converts");
    assert_eq!(canonical_name(&schema), Some(message.schema().name()));
    message
}

#[test]
fn entities_of_a_scene_keep_their_times_choices_and_poses() {
    let definition = "foxglove_msgs/SceneEntity[] entities\n===\nMSG: foxglove_msgs/SceneEntity\n\
        builtin_interfaces/Time timestamp\nstring frame_id\nbuiltin_interfaces/Duration lifetime\n\
        foxglove_msgs/LinePrimitive[] lines\nstring message_id\n===\nMSG: builtin_interfaces/Duration\n\
        int32 sec\nuint32 nanosec\n===\nMSG: foxglove_msgs/LinePrimitive\nuint8 LINE_STRIP=0\n\
        uint8 LINE_LIST=2\nuint8 type\ngeometry_msgs/Pose pose\nfloat64 thickness\n\
        geometry_msgs/Point[] points";
    let mut writer = Writer::new(false);
    writer.u32(1).header().u32(3).u32(4).u32(1).u8(2).floats(&[1.0, 2.0, 3.0, 0.0, 0.0, 0.6, 0.8, 0.5]);
    let bytes = writer.u32(1).floats(&[7.0, 8.0, 9.0]).text("an identity").done();
    let message = read("foxglove_msgs/msg/SceneUpdate", definition, &bytes);
    let update = message.get::<SceneUpdate>().expect("it is an update");
    let entity = &update.entities[0];
    assert_eq!(entity.timestamp.map(|time| (time.seconds, time.nanos)), Some((5, 7)));
    assert_eq!(entity.lifetime.map(|time| (time.seconds, time.nanos)), Some((3, 4)));
    assert_eq!(entity.frame_id, "map");
    let line = &entity.lines[0];
    assert_eq!((line.r#type, line.thickness), (i32::from(Type::LineList), 0.5));
    assert_eq!(line.pose.and_then(|pose| pose.orientation).map(|q| (q.z, q.w)), Some((0.6, 0.8)));
    assert_eq!(line.points, [Point3 { x: 7.0, y: 8.0, z: 9.0 }]);
}

#[test]
fn the_matrices_of_a_calibration_have_small_letters() {
    let definition = "builtin_interfaces/Time timestamp\nstring frame_id\nuint32 width\nuint32 height\n\
        string distortion_model\nfloat64[] d\nfloat64[9] k\nfloat64[9] r\nfloat64[12] p";
    let numbers: Vec<f64> = (0..30).map(f64::from).collect();
    let mut writer = Writer::new(true);
    writer.header().u32(640).u32(480).text("plumb_bob").u32(2).floats(&[0.1, 0.2]).floats(&numbers);
    let message = read("foxglove_msgs/msg/CameraCalibration", definition, &writer.done());
    assert_eq!(header_stamp(&message).map(|stamp| stamp.0), Some(5_000_000_007));
    assert_eq!(header_frame(&message).as_deref(), Some("map"));
    let calibration = message.get::<CameraCalibration>().expect("it is a calibration");
    assert_eq!((calibration.width, calibration.height, calibration.d.len()), (640, 480, 2));
    assert_eq!((calibration.k[8], calibration.r[0], calibration.p[11]), (8.0, 9.0, 29.0));
}

#[test]
fn a_compressed_image_keeps_its_bytes_and_a_cloud_its_fields() {
    let definition = "builtin_interfaces/Time timestamp\nstring frame_id\nuint8[] data\nstring format";
    let bytes = Writer::new(true).header().data(&[0xff, 0xd8, 0xff]).text("jpeg").done();
    let message = read("foxglove_msgs/msg/CompressedImage", definition, &bytes);
    let image = message.get::<CompressedImage>().expect("it is an image");
    assert_eq!((&image.data[..], image.format.as_str()), (&[0xff, 0xd8, 0xff][..], "jpeg"));

    let definition = "builtin_interfaces/Time timestamp\nstring frame_id\ngeometry_msgs/Pose pose\n\
        uint32 point_stride\nfoxglove_msgs/PackedElementField[] fields\nuint8[] data\n===\n\
        MSG: foxglove_msgs/PackedElementField\nuint8 UINT16=3\nuint8 FLOAT32=7\nstring name\n\
        uint32 offset\nuint8 type";
    let mut writer = Writer::new(false);
    writer.header().floats(&[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]).u32(14).u32(4);
    for (name, offset, number) in [("x", 0, 7), ("y", 4, 7), ("z", 8, 7), ("intensity", 12, 3)] {
        writer.text(name).u32(offset).u8(number);
    }
    let point: Vec<u8> = [1.0_f32, 2.0, 3.0].iter().flat_map(|v| v.to_le_bytes()).chain([9, 1]).collect();
    let message = read("foxglove_msgs/msg/PointCloud", definition, &writer.data(&point).done());
    assert_eq!(returns(&message), [([1000.0, 2000.0, 3000.0], Some(265.0))]);
}

#[test]
fn a_scan_becomes_a_cloud_and_a_definition_that_cannot_be_read_becomes_nothing() {
    let definition = "builtin_interfaces/Time timestamp\nstring frame_id\ngeometry_msgs/Pose pose\n\
        float64 start_angle\nfloat64 end_angle\nfloat64[] ranges\nfloat64[] intensities";
    let mut writer = Writer::new(false);
    writer.header().floats(&[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, std::f64::consts::PI]);
    let bytes = writer.u32(2).floats(&[1.0, f64::NAN]).u32(0).done();
    let message = read("foxglove_msgs/msg/LaserScan", definition, &bytes);
    assert_eq!(returns(&message), [([1000.0, 0.0, 0.0], None)]);
    assert!(canonical(&named("foxglove_msgs/msg/LaserScan"), &bytes).is_none());
}
