//! The fuzz targets without the fuzzer, so that `ocu-tests` can run them on random inputs.
//!
//! An input is either used as it is, or as a list of edits of a valid file: most random bytes are refused early, and
//! edited files get further. Besides panics, each target checks properties of the result.
//!
//! `app.rs` is a module of the target `app_file` alone, because it needs the crates of the window.

pub mod foreign;
pub mod recorded;

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Arc, LazyLock};

use bytes::Bytes;
use rcs_log::{CursorOptions, Log, LogWriter, WriteHeader, WriterOptions};
use rcs_msg::{
    AnyMessage, FieldPath, FieldScanner, MessageEncoding, Schema, Stamp, Value, canonical, foxglove, rcs,
};
use rcs_runtime::{Plan, StackFile};
use rcs_testkit::logs::SharedSink;

/// A log opens or is refused. Messages are in order and can be found again by their position.
///
/// # Panics
/// If a property does not hold.
pub fn log_reader(input: &[u8]) {
    let (choice, rest) = split(input);
    let bytes = match choice % 4 {
        0 => rest.to_vec(),
        1 => edited(&LOGS[0], rest),
        2 => edited(&LOGS[1], rest),
        _ => cut(&LOGS[usize::from(choice / 4 % 2)], rest),
    };
    let bytes = Bytes::from(bytes);
    for log in [Log::from_bytes(bytes.clone()), Log::from_bytes_by_scan(bytes)].into_iter().flatten() {
        let messages: Vec<_> = log.cursor(CursorOptions::default()).flatten().collect();
        assert!(messages.windows(2).all(|pair| pair[0].place < pair[1].place), "messages are not in order");

        let mut first_half = log.cursor(CursorOptions::default());
        let taken = first_half.by_ref().flatten().take(messages.len() / 2).count();
        let others: Vec<_> = log.cursor_at(first_half.position()).flatten().collect();
        assert_eq!(others, messages[taken..], "a cursor does not go on where it stood");

        if let Some(last) = messages.last() {
            let latest = log.latest_at(last.log_time, None).expect("a log in memory can be read");
            assert!(
                latest.iter().flatten().any(|message| message.place == last.place),
                "the last message is not the latest"
            );
            let before = log.previous_message(last.place, None).expect("a log in memory can be read");
            assert_eq!(
                before.as_ref(),
                messages.iter().rev().nth(1),
                "the message before the last is another one"
            );
        }
        for attachment in log.attachments() {
            // A damaged attachment is an error that the caller shows; here it only must not panic.
            let _ = log.read_attachment(attachment);
        }
        for topic in &log.info().topics {
            let _ = topic.schema.decodable();
        }
    }
}

/// The scanner agrees with the tree if the message decodes.
///
/// # Panics
/// If they differ.
pub fn field_scanner(input: &[u8]) {
    let (choice, rest) = split(input);
    let (how, rest) = split(rest);
    let target = &PROTOBUF[usize::from(choice) % PROTOBUF.len()];
    let message = if how % 2 == 0 { rest.to_vec() } else { edited(&target.message, rest) };
    check_scanner(&target.schema, &target.paths, &Bytes::from(message));
}

/// A definition is parsed or refused, a message of ROS 2 or ROS 1 decodes or is refused, and the scanner agrees with the
/// tree.
///
/// # Panics
/// If they differ.
pub fn cdr(input: &[u8]) {
    let (choice, rest) = split(input);
    let (how, rest) = split(rest);
    let (name, definition, paths) = ROS[usize::from(choice) % ROS.len()];
    let (definition, message) = if how % 2 == 0 {
        (definition.to_owned(), rest.to_vec())
    } else {
        // A zero byte separates the edits of the definition from the message.
        let at = rest.iter().position(|&byte| byte == 0).unwrap_or(rest.len());
        let edited = edited(definition.as_bytes(), &rest[..at]);
        (String::from_utf8_lossy(&edited).into_owned(), rest[at..].to_vec())
    };
    let (encoding, language) =
        if how & 2 == 0 { (MessageEncoding::Cdr, "ros2msg") } else { (MessageEncoding::Ros1, "ros1msg") };
    let schema = Arc::new(Schema::new(name, encoding, language, Bytes::from(definition)));
    let paths: Vec<FieldPath> = paths.iter().filter_map(|path| path.parse().ok()).collect();
    check_scanner(&schema, &paths, &Bytes::from(message));
}

/// A stack file gives a plan, or an error that names one of its lines.
///
/// # Panics
/// If the error names no line of the file.
pub fn stack_file(input: &[u8]) {
    let (choice, rest) = split(input);
    let text = if choice % 2 == 0 { rest.to_vec() } else { edited(STACK.as_bytes(), rest) };
    let text = String::from_utf8_lossy(&text);
    let lines = text.split('\n').count();
    let plan =
        StackFile::parse("stack.toml", &text).and_then(|file| Plan::new(file, rcs_plugins::all(), &[]));
    if let Err(error) = plan {
        assert!((1..=lines).contains(&error.line), "line {} of {lines}: {error}", error.line);
        assert!(!error.message.is_empty(), "an error without words");
    }
}

/// The first byte, 0 if there is none, and the others.
pub fn split(input: &[u8]) -> (u8, &[u8]) {
    input.split_first().map_or((0, input), |(first, rest)| (*first, rest))
}

/// Applies the changes in `edits` to `base`: four bytes each, position (two), kind and value.
pub fn edited(base: &[u8], edits: &[u8]) -> Vec<u8> {
    let mut bytes = base.to_vec();
    for edit in edits.chunks_exact(4) {
        let at = usize::from(u16::from_le_bytes([edit[0], edit[1]])) % (bytes.len() + 1);
        let value = edit[3];
        match edit[2] % 8 {
            0..=3 if at < bytes.len() => bytes[at] = value,
            4 if at < bytes.len() => bytes[at] ^= 1 << (value % 8),
            5 => bytes.insert(at, value),
            6 => drop(bytes.drain(at..(at + usize::from(value)).min(bytes.len()))),
            7 => bytes.truncate(at),
            _ => {}
        }
    }
    bytes
}

/// `base` truncated at a position that the first two bytes of `input` give.
fn cut(base: &[u8], input: &[u8]) -> Vec<u8> {
    let at = input.iter().take(2).fold(0, |at, &byte| at << 8 | usize::from(byte));
    base[..at.min(base.len())].to_vec()
}

fn check_scanner(schema: &Arc<Schema>, paths: &[FieldPath], message: &Bytes) {
    let tree = schema.value(message);
    let _ = canonical(schema, message);
    for path in paths {
        let Ok(scanner) = FieldScanner::new(schema, path) else { continue };
        let scanned = scanner.scan(message);
        // The scanner skips what it does not need, so it may return a number where the tree returns an error.
        if let Ok(tree) = &tree {
            let expected = tree.get(path).ok().and_then(|value: std::borrow::Cow<'_, Value>| value.as_f64());
            let scanned =
                scanned.unwrap_or_else(|error| panic!("{path}: the tree decodes, the scanner: {error}"));
            assert_eq!(
                scanned.map(f64::to_bits),
                expected.map(f64::to_bits),
                "{path}: {scanned:?}, {expected:?}"
            );
        }
    }
}

/// A schema of this repository, with paths into it and a message that has their fields.
struct Target {
    schema: Arc<Schema>,
    paths: Vec<FieldPath>,
    message: Bytes,
}

static PROTOBUF: LazyLock<Vec<Target>> = LazyLock::new(|| {
    let target = |message: AnyMessage| {
        let (schema, message) = (message.schema(), message.bytes());
        let tree = schema.value(&message).expect("a message of ours decodes");
        let mut paths: Vec<FieldPath> = tree.leaves().map(|(path, _)| path).collect();
        paths.extend(PATHS.iter().map(|path| path.parse::<FieldPath>().expect("the path is well formed")));
        Target { schema, paths, message }
    };
    messages().into_iter().map(target).collect()
});

/// Each path is valid in one of the messages below, and refused in the others.
const PATHS: [&str; 8] = [
    ".timestamp.seconds",
    ".pose.position.x",
    ".pose.orientation.w",
    ".fields.@length",
    ".fields[1].offset",
    ".data.@length",
    ".data[3]",
    ".transforms[0].translation.y",
];

/// Messages with nested, repeated, packed and absent fields.
fn messages() -> [AnyMessage; 4] {
    let vector = |x| foxglove::Vector3 { x, y: 2.5, z: -3.0 };
    let pose =
        foxglove::Pose { position: Some(vector(1.5)), orientation: Some(foxglove::Quaternion::default()) };
    let field =
        |name: &str, offset| foxglove::PackedElementField { name: name.to_owned(), offset, r#type: 1 };
    let transform = |child: &str| foxglove::FrameTransform {
        parent_frame_id: "map".to_owned(),
        child_frame_id: child.to_owned(),
        translation: Some(vector(0.5)),
        ..foxglove::FrameTransform::default()
    };
    [
        AnyMessage::new(foxglove::PoseInFrame {
            frame_id: "map".to_owned(),
            pose: Some(pose),
            ..foxglove::PoseInFrame::default()
        }),
        AnyMessage::new(foxglove::Grid {
            frame_id: "map".to_owned(),
            column_count: 2,
            fields: vec![field("a", 0), field("b", 1)],
            data: Bytes::from_static(&[1, 2, 3, 4]),
            ..foxglove::Grid::default()
        }),
        AnyMessage::new(foxglove::FrameTransforms { transforms: vec![transform("a"), transform("b")] }),
        AnyMessage::new(rcs::Imu { orientation_covariance: vec![1.0, 2.0, 3.0], ..rcs::Imu::default() }),
    ]
}

/// ROS 2 definitions with every kind of field, each with paths; also read as definitions of ROS 1.
const ROS: [(&str, &str, &[&str]); 5] = [
    (
        "sensor_msgs/msg/PointCloud2",
        concat!(
            "std_msgs/Header header\nuint32 height\nuint32 width\nPointField[] fields\nbool is_bigendian\n",
            "uint32 point_step\nuint32 row_step\nuint8[] data\nbool is_dense\n",
            "================================================================================\n",
            "MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n",
            "================================================================================\n",
            "MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n",
            "================================================================================\n",
            "MSG: sensor_msgs/PointField\nuint8 INT8=1\nuint8 FLOAT32 = 7\nstring name\nuint32 offset\nuint8 datatype\n",
            "uint32 count\n"
        ),
        &[
            ".header.stamp.sec",
            ".fields.@length",
            ".fields[1].offset",
            ".data[7]",
            ".data.@length",
            ".is_dense",
        ],
    ),
    (
        "sensor_msgs/msg/Image",
        concat!(
            "std_msgs/Header header\nuint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\nuint32 step\n",
            "uint8[] data\n================================================================================\n",
            "MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n",
            "================================================================================\n",
            "MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
        ),
        &[".height", ".step", ".encoding.@length", ".data.@length"],
    ),
    (
        "tf2_msgs/msg/TFMessage",
        concat!(
            "geometry_msgs/TransformStamped[] transforms\n",
            "================================================================================\n",
            "MSG: geometry_msgs/TransformStamped\nstd_msgs/Header header\nstring child_frame_id\nTransform transform\n",
            "================================================================================\n",
            "MSG: geometry_msgs/Transform\nVector3 translation\nQuaternion rotation\n",
            "================================================================================\n",
            "MSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n",
            "================================================================================\n",
            "MSG: geometry_msgs/Quaternion\nfloat64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1\n",
            "================================================================================\n",
            "MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n",
            "================================================================================\n",
            "MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
        ),
        &[
            ".transforms[0].transform.translation.x",
            ".transforms[2].transform.rotation.w",
            ".transforms.@length",
        ],
    ),
    (
        "x/msg/All",
        concat!(
            "int8 KIND=3\nbool a\nint8 b\nuint8 c\nint16 d\nuint16 e\nint32 f\nuint32 g\nint64 h\nuint64 i\nfloat32 j\n",
            "float64 k\nstring<=8 l\nfloat64[3] m\nfloat32[] n\nstring[<=4] o\nInner[2] p\nInner[] q\nbyte r\nchar s\n",
            "================================================================================\n",
            "MSG: x/Inner\nfloat64 x\nstring name \"none\"\nint16[] xs\n"
        ),
        &[
            ".a",
            ".i",
            ".k",
            ".m[2]",
            ".n[1]",
            ".o.@length",
            ".p[1].x",
            ".q[0].xs[1]",
            ".q[1].name.@length",
            ".s",
        ],
    ),
    ("x/msg/Empty", "", &[".structure_needs_at_least_one_member"]),
];

/// A stack that uses every feature of stack files.
const STACK: &str = r#"format = 1
name = "all"
description = "Something of everything."

[[input]]
buffer = "/camera/depth"
topic = "/depth"

[[input]]
buffer = "/odometry"
topic = "/odom"
type = "foxglove.Odometry"
static = true

[[process]]
name = "obstacles"
plugin = "obstacles"
supervisor = "viewer"
host = "local"
period_ms = 50
latency_ms = 5.5
inputs = { depth = "/camera/depth" }
outputs = { labels = "/labels" }
params = { depth_scale_m = 0.001 }

[[process]]
name = "robot"
plugin = "supervisor"
supervisor = "viewer"

[[process]]
name = "wm1"
plugin = "world_model"
supervisor = "robot"
period_ms = 100
as = "auxiliary"

[buffers."/labels"]
queue = 8
overflow = "drop_oldest"
record = true
record_hz = 5.0
"#;

/// A valid log, without and with compression, small enough that two bytes can address every position.
static LOGS: LazyLock<[Vec<u8>; 2]> = LazyLock::new(|| [log(false), log(true)]);

fn log(compress: bool) -> Vec<u8> {
    let sink = SharedSink::default();
    let options = WriterOptions {
        compress,
        chunk_bytes: 400,
        clock: Arc::new(Default::default),
        ..WriterOptions::default()
    };
    let write = || -> Result<(), rcs_log::LogError> {
        let mut writer = LogWriter::with_sink(Box::new(sink.clone()), PathBuf::new(), options)?;
        let json = Schema::new("note", MessageEncoding::Json, "jsonschema", Bytes::from_static(b"{}"));
        let metadata = BTreeMap::from([("rcs.role".to_owned(), "path".to_owned())]);
        let channels =
            [writer.add_channel("/a", &json, &metadata)?, writer.add_channel("/b", &json, &BTreeMap::new())?];
        for sequence in 0..24 {
            // Times are not monotonic, because messages of a chunk need not be in order.
            let time = Stamp(u64::from(sequence / 3 * 10 + 5 - sequence % 3));
            let header = WriteHeader { sequence, log_time: time, publish_time: time };
            writer.write(
                channels[sequence as usize % 2],
                header,
                br#"{"x": 1.5, "name": "a note of some length"}"#,
            )?;
        }
        writer.attach("stack.toml", "text/plain", Stamp(3), b"format = 1")?;
        writer.finish()
    };
    write().expect("memory takes every write");
    let bytes = sink.snapshot();
    assert!(bytes.len() < 1 << 16, "{} bytes: two bytes do not reach every place", bytes.len());
    bytes
}
