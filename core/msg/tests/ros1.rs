//! Messages of ROS 1: hand-made ones of several types, damaged ones, and a recorded drive.

use bytes::Bytes;
use rcs_msg::rcs::diagnostic::Level;
use rcs_msg::{
    AnyMessage, FieldScanner, MessageEncoding, Schema, Value, canonical, canonical_name, foxglove,
    grid_decoder, header_frame, header_stamp, points, rcs,
};
use std::sync::Arc;

const HEADER: &str = "\n===\nMSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n";

/// Writes ROS 1's serialization.
#[derive(Default)]
struct Writer(Vec<u8>);

impl Writer {
    fn bytes(&mut self, bytes: &[u8]) -> &mut Self {
        self.0.extend(bytes);
        self
    }

    fn u32(&mut self, v: u32) -> &mut Self {
        self.bytes(&v.to_le_bytes())
    }

    fn floats(&mut self, all: &[f64]) -> &mut Self {
        for v in all {
            self.0.extend(v.to_le_bytes());
        }
        self
    }

    /// The length, and what follows: a text, or bytes.
    fn text(&mut self, text: impl AsRef<[u8]>) -> &mut Self {
        self.u32(text.as_ref().len() as u32).bytes(text.as_ref())
    }

    /// Of 5.000000007 s in the frame `map`.
    fn header(&mut self) -> &mut Self {
        self.u32(99).u32(5).u32(7).text("map")
    }

    fn done(&mut self) -> Bytes {
        std::mem::take(&mut self.0).into()
    }
}

fn schema(name: &str, definition: &str) -> Arc<Schema> {
    let data = Bytes::copy_from_slice(definition.as_bytes());
    Arc::new(Schema::new(name, MessageEncoding::from_name("ros1"), "ros1msg", data))
}

fn convert(name: &str, definition: &str, bytes: &Bytes) -> AnyMessage {
    let schema = schema(name, definition);
    let message = canonical(&schema, bytes).expect("a conversion is known").expect("it converts");
    assert_eq!(canonical_name(&schema), Some(message.schema().name()));
    message
}

#[test]
fn a_tree_of_ros_1_has_its_times_its_signed_bytes_and_its_empty_messages() {
    let definition = format!(
        "Header header\nbyte level\nchar letter\nduration each\nNone nothing\nstring[] names\ntime[2] times{HEADER}===\n\
         MSG: a/None\n# Nothing.\n"
    );
    let schema = schema("a/Demo", &definition);
    let mut writer = Writer::default();
    writer.header().bytes(&[0xff, 0xff]).bytes(&(-2i32).to_le_bytes()).bytes(&5i32.to_le_bytes());
    // A zero at the end belongs to a text of ROS 1.
    writer.u32(2).text("x").text("y\0").u32(1).u32(2).u32(3).u32(4);
    let bytes = writer.done();
    let value = schema.value(&bytes).expect("it decodes");
    assert_eq!(value.header_stamp().map(|stamp| stamp.0), Some(5_000_000_007));
    assert_eq!(value.header_frame(), Some("map"));
    assert_eq!(value.field("nothing").map(Value::fields), Some(&[][..]));
    for (path, expect) in [
        (".header.seq", 99.0),
        (".level", -1.0),
        (".letter", 255.0),
        (".each.secs", -2.0),
        (".names.@length", 2.0),
        (".names[1].@length", 2.0),
        (".times[1].nsecs", 4.0),
    ] {
        let path = path.parse().expect("it is a path");
        let got = value.get(&path).ok().and_then(|value| value.as_f64());
        assert_eq!(got, Some(expect), "{path}");
        let scanner = FieldScanner::new(&schema, &path).expect("it is a number");
        assert!(scanner.is_direct());
        assert_eq!(scanner.scan(&bytes).expect("it reads"), Some(expect), "{path}");
    }
    for end in 0..bytes.len() {
        let error = schema.value(&bytes.slice(..end)).expect_err("a part is missing").to_string();
        assert!(error.contains("more at byte"), "{error}");
    }
}

#[test]
fn transforms_have_the_time_and_frame_of_their_headers() {
    let definition = format!(
        "geometry_msgs/TransformStamped[] transforms\n===\nMSG: geometry_msgs/TransformStamped\nHeader header\n\
         string child_frame_id\nTransform transform{HEADER}===\nMSG: geometry_msgs/Transform\nVector3 translation\n\
         Quaternion rotation\n===\nMSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n===\n\
         MSG: geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w\n"
    );
    let bytes = Writer::default()
        .u32(1)
        .header()
        .text("odd name")
        .floats(&[1.0, 2.0, 3.0, 0.0, 0.0, 0.6, 0.8])
        .done();
    for name in ["tf2_msgs/TFMessage", "tf/tfMessage"] {
        let message = convert(name, &definition, &bytes);
        assert_eq!(header_stamp(&message).map(|stamp| stamp.0), Some(5_000_000_007));
        let transform =
            &message.get::<foxglove::FrameTransforms>().expect("they are transforms").transforms[0];
        assert_eq!((&*transform.parent_frame_id, &*transform.child_frame_id), ("map", "odd name"));
        let rotation = transform.rotation.expect("it has one");
        assert_eq!((rotation.z, rotation.w), (0.6, 0.8));
    }
}

#[test]
fn a_cloud_shares_its_points_with_the_message() {
    let definition = format!(
        "Header header\nuint32 height\nuint32 width\nPointField[] fields\nbool is_bigendian\nuint32 point_step\n\
         uint32 row_step\nuint8[] data\nbool is_dense{HEADER}===\nMSG: sensor_msgs/PointField\nuint8 FLOAT32 = 7\n\
         string name\nuint32 offset\nuint8 datatype\nuint32 count\n"
    );
    let mut writer = Writer::default();
    writer.header().u32(1).u32(2).u32(3);
    for (offset, name) in [(0, "x"), (4, "y"), (8, "z")] {
        writer.text(name).u32(offset).bytes(&[7]).u32(1);
    }
    let numbers: Vec<u8> = [1.0f32, 2.0, 3.0, 4.0, 5.0, 6.0].iter().flat_map(|v| v.to_le_bytes()).collect();
    let bytes = writer.bytes(&[0]).u32(12).u32(24).text(&numbers).bytes(&[1]).done();
    let message = convert("sensor_msgs/PointCloud2", &definition, &bytes);
    assert_eq!(header_frame(&message).as_deref(), Some("map"));
    let cloud = message.get::<foxglove::PointCloud>().expect("it is a cloud");
    assert_eq!(cloud.data.as_ptr(), bytes[bytes.len() - 25..].as_ptr());
    let positions: Vec<_> = points(cloud).expect("it is valid").iter().map(|point| point.position).collect();
    assert_eq!((positions[0].x, positions[1].z), (1.0, 6.0));
}

#[test]
fn levels_of_log_lines_are_those_of_ros_1() {
    use foxglove::log::Level;
    let definition = format!(
        "byte DEBUG=1\nHeader header\nbyte level\nstring name\nstring msg\nstring file\nstring function\nuint32 line\n\
         string[] topics{HEADER}"
    );
    for (number, level) in
        [(1, Level::Debug), (2, Level::Info), (4, Level::Warning), (8, Level::Error), (16, Level::Fatal)]
    {
        let mut writer = Writer::default();
        writer.header().bytes(&[number]).text("/node").text("words").text("a.cpp").text("main");
        let bytes = writer.u32(7).u32(1).text("/rosout").done();
        let message = convert("rosgraph_msgs/Log", &definition, &bytes);
        let line = message.get::<foxglove::Log>().expect("it is a line");
        assert_eq!((line.level(), &*line.name, &*line.message, line.line), (level, "/node", "words", 7));
    }
}

#[test]
fn a_grid_has_the_cells_and_the_time_of_its_updates() {
    let grids = format!(
        "Header header\nMapMetaData info\nint8[] data{HEADER}===\nMSG: nav_msgs/MapMetaData\ntime map_load_time\n\
         float32 resolution\nuint32 width\nuint32 height\ngeometry_msgs/Pose origin\n===\n\
         MSG: geometry_msgs/Pose\nPoint position\nQuaternion orientation\n===\nMSG: geometry_msgs/Point\nfloat64 x\n\
         float64 y\nfloat64 z\n===\nMSG: geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w\n"
    );
    let updates =
        format!("Header header\nint32 x\nint32 y\nuint32 width\nuint32 height\nint8[] data{HEADER}");
    let (grids, updates) =
        (schema("nav_msgs/OccupancyGrid", &grids), schema("map_msgs/OccupancyGridUpdate", &updates));
    let mut decoder = grid_decoder(&grids, &updates).expect("they belong together");
    let mut writer = Writer::default();
    writer.header().u32(0).u32(0).bytes(&0.5f32.to_le_bytes()).u32(2).u32(2);
    let bytes = writer.floats(&[1.0, 2.0, 0.0, 0.0, 0.0, 0.0, 1.0]).text([0_u8; 4]).done();
    decoder.take_whole(1, &AnyMessage::encoded(Arc::clone(&grids), bytes));
    let update =
        writer.u32(1).u32(9).u32(3).text("map").u32(1).u32(0).u32(1).u32(2).text([100_u8, 0xff]).done();
    decoder.take_delta(1, &update).expect("it fits");
    let whole = decoder.message().expect("a grid is there").bytes();
    let message = canonical(&grids, &whole).expect("a conversion is known").expect("it converts");
    let grid = message.get::<foxglove::Grid>().expect("it is a grid");
    assert_eq!(grid.data, [0, 250, 0, 255][..]);
    assert_eq!(header_stamp(&message).map(|stamp| stamp.0), Some(9_000_000_003));
}

#[test]
fn messages_of_foxglove_are_read_by_the_names_of_their_fields() {
    let definition = "time timestamp\nstring frame_id\nfloat64[] D\nfloat64[9] K";
    let mut writer = Writer::default();
    let bytes = writer.u32(5).u32(7).text("map").u32(1).floats(&[0.5]).floats(&[2.0; 9]).done();
    let message = convert("foxglove_msgs/CameraCalibration", definition, &bytes);
    assert_eq!(header_stamp(&message).map(|stamp| stamp.0), Some(5_000_000_007));
    assert_eq!(header_frame(&message).as_deref(), Some("map"));
    let calibration = message.get::<foxglove::CameraCalibration>().expect("it is a calibration");
    assert_eq!((calibration.d.as_slice(), calibration.k.as_slice()), (&[0.5][..], &[2.0; 9][..]));
}

#[test]
fn a_name_without_a_readable_definition_is_not_converted() {
    assert!(canonical(&schema("nav_msgs/Path", "Other x"), &Bytes::new()).is_none());
    let error = canonical(&schema("nav_msgs/Path", "float64 length"), &Bytes::new())
        .expect("it is known")
        .expect_err("it is another message");
    assert_eq!(error.to_string(), "nav_msgs/Path is laid out as d, expected iIs[](iIsddddddd)");
}

#[test]
fn a_time_of_too_many_nanoseconds_is_refused() {
    let definition = format!("Header header\nstring format\nuint8[] data{HEADER}");
    let schema = schema("sensor_msgs/CompressedImage", &definition);
    let bytes = Writer::default().u32(1).u32(5).u32(1_000_000_000).text("map").text("png").text("").done();
    let error = canonical(&schema, &bytes).expect("it is known").expect_err("it has no time").to_string();
    assert!(error.contains("nanoseconds of a time: got 1000000000"), "{error}");
}

#[test]
fn every_message_of_the_recorded_drive_reads() {
    let Some(dir) = rcs_testkit::data_dir() else { return };
    let bytes = std::fs::read(dir.join("mcap-crate-drive/uncompressed.mcap")).expect("the log is there");
    let (mut transforms, mut states, mut warnings) = (0, 0, 0);
    for message in mcap::MessageStream::new(&bytes).expect("it is a log") {
        let message = message.expect("it is not damaged");
        let of = message.channel.schema.as_ref().expect("it has a schema");
        let schema = Schema::new(
            &of.name,
            MessageEncoding::from_name(&message.channel.message_encoding),
            &of.encoding,
            of.data.to_vec().into(),
        );
        let data = Bytes::copy_from_slice(&message.data);
        let value = schema.value(&data).expect("it decodes");
        let stamp_s = value.header_stamp().map_or(0.0, |stamp| stamp.0 as f64 * 1e-9);
        let log_s = message.log_time as f64 * 1e-9;
        assert!((log_s - stamp_s).abs() < 10.0, "stamp {stamp_s}, log time {log_s}");
        let message = canonical(&schema, &data).expect("a conversion is known").expect("it converts");
        if let Some(all) = message.get::<foxglove::FrameTransforms>() {
            for rotation in all.transforms.iter().filter_map(|one| one.rotation) {
                let squares = [rotation.x, rotation.y, rotation.z, rotation.w].map(|v| v * v);
                assert!((squares.iter().sum::<f64>() - 1.0).abs() < 1e-3, "{rotation:?}");
            }
            transforms += 1;
        } else {
            let diagnostics = message.get::<rcs::Diagnostics>().expect("they are diagnostics");
            assert_eq!(Some(diagnostics.parts.len()), value.field("status").and_then(Value::len));
            warnings += diagnostics.parts.iter().filter(|part| part.level() == Level::Warn).count();
            states += 1;
        }
    }
    assert_eq!((transforms, states, warnings), (774, 52, 3));
}
