//! Foreign data apart from complete logs: schemas of each encoding, payloads for every conversion, and hand-written
//! files.

use super::{edited, messages, split};
use bytes::Bytes;
use rcs_msg::{AnyMessage, MessageEncoding, Schema, canonical, foxglove, image, points};
use std::sync::LazyLock;

/// A schema is parsed or refused, and so is a message of it.
///
/// # Panics
/// If a reader panics outside of its guard.
pub fn schema(input: &[u8]) {
    let (choice, rest) = split(input);
    let (how, rest) = split(rest);
    // A zero byte separates the edits of the schema from the message.
    let at = rest.iter().position(|&byte| byte == 0).unwrap_or(rest.len());
    let (edits, message) = rest.split_at(at);
    let (name, encoding, base) = &SCHEMAS[usize::from(choice) % SCHEMAS.len()];
    let data = if how % 4 == 0 { edits.to_vec() } else { edited(base, edits) };
    let (message_encoding, schema_encoding) = match *encoding {
        "ros2msg" => (MessageEncoding::Cdr, "ros2msg"),
        "ros1msg" => (MessageEncoding::Ros1, "ros1msg"),
        "jsonschema" => (MessageEncoding::Json, "jsonschema"),
        _ => (MessageEncoding::Protobuf, "protobuf"),
    };
    let schema = Schema::new(*name, message_encoding, schema_encoding, Bytes::from(data));
    let message = Bytes::copy_from_slice(message);
    match schema.decodable() {
        Ok(()) => drop(schema.value(&message)),
        Err(error) => assert!(!error.to_string().is_empty(), "a refusal without words"),
    }
    let _ = canonical(&schema, &message);
}

/// A message of a known type is converted or refused; its pixels and its points are read or refused.
///
/// # Panics
/// If a conversion panics outside of its guard, or returns points that the message does not contain.
pub fn payload(input: &[u8]) {
    let (choice, rest) = split(input);
    let (how, rest) = split(rest);
    let payloads = &*PAYLOADS;
    let base = &payloads[usize::from(choice) % payloads.len()];
    let bytes = if how % 4 == 0 { rest.to_vec() } else { edited(&base.bytes(), rest) };
    let bytes = Bytes::from(bytes);
    let Some(Ok(message)) = canonical(&base.schema(), &bytes) else { return };
    if let Some(raw) = message.get::<foxglove::RawImage>() {
        let _ = image::raw_to_rgb8(raw);
        let _ = image::depth_m(raw, 0.001);
    }
    if let Some(compressed) = message.get::<foxglove::CompressedImage>() {
        let _ = image::decompress(compressed);
    }
    if let Some(cloud) = message.get::<foxglove::PointCloud>()
        && let Ok(points) = points(cloud)
    {
        let count = points.iter().count();
        assert!(count <= cloud.data.len() + 1, "{count} points in {} bytes", cloud.data.len());
    }
    let _ = rcs_msg::header_stamp(&message);
    let _ = rcs_msg::header_frame(&message);
    let _ = rcs_msg::to_json(&message);
}

/// A world, a course or a vehicle is parsed, or refused with an error text and a line of the file. A small world is also
/// computed.
///
/// # Panics
/// If that does not hold.
pub fn scene_file(input: &[u8]) {
    let (choice, rest) = split(input);
    let base = [WORLD, COURSE, VEHICLE, SMALL_WORLD][usize::from(choice) % 4];
    let text = if choice >= 128 { rest.to_vec() } else { edited(base.as_bytes(), rest) };
    let text = String::from_utf8_lossy(&text);
    let scene = |error: rcs_scene::SceneError| (error.line, error.to_string());
    let error = match choice % 4 {
        1 => rcs_scene::Course::from_toml(&text).err().map(scene),
        2 => rcs_sim::spec::VehicleSpec::from_toml(&text).err().map(|error| (error.line, error.reason)),
        _ => match rcs_scene::World::check(&text) {
            // Computing a large world takes a second.
            Ok((_, [low, high])) if (high - low).max_element() <= 20.0 => {
                rcs_scene::World::from_toml(&text).err().map(scene)
            }
            checked => checked.err().map(scene),
        },
    };
    let Some((line, words)) = error else { return };
    assert!(choice >= 128 || !rest.is_empty(), "a base file has an error: {words}");
    assert!(!words.is_empty(), "a refusal without words");
    let lines = text.split('\n').count();
    assert!((1..=lines).contains(&line), "line {line} of {lines}: {words}");
}

const WORLD: &str = include_str!("../../assets/worlds/meadow.toml");
const COURSE: &str = include_str!("../../assets/courses/meadow.toml");
const VEHICLE: &str = include_str!("../../assets/vehicles/lagr.toml");

/// A world of 12 m with something of every kind.
const SMALL_WORLD: &str = r#"name = "small"
seed = 3
bounds_m = [[0, 0], [12, 12]]
base = "short_grass"

[origin]
zone = 18
north = true
easting_m = 308200.0
northing_m = 4333600.0

[sun]
azimuth_deg = 215
elevation_deg = 48

[[undulation]]
wavelength_m = 11
amplitude_m = 0.12

[[ditch]]
path = [[2, 2], [4, 3]]
width_m = 0.4
depth_m = 0.4

[[paint]]
surface = "dirt"
circle = [6, 6, 1.4]
edge_m = 0.8

[[thing]]
kind = "log"
at = [8, 4.2]
yaw_deg = 75
length_m = 1.0
radius_m = 0.17

[[line]]
kind = "hedge"
path = [[1, 9], [4, 10], [9, 9]]
height_m = [1.4, 1.8]
width_m = 0.9

[[clear]]
circle = [10, 5, 1]

[[scatter]]
kind = "bush"
count = 2
spacing_m = 2
polygon = [[1, 1], [11, 1], [11, 11], [1, 11]]
radius_m = [0.4, 0.6]
height_m = [0.6, 0.7]
"#;

/// Name, encoding and data of valid schemas.
static SCHEMAS: LazyLock<Vec<(&str, &str, Vec<u8>)>> = LazyLock::new(|| {
    let ours = |name: &'static str| {
        let schema = rcs_msg::registry().schema(name).expect("a schema of ours");
        (name, "protobuf", schema.data().to_vec())
    };
    vec![
        ours("foxglove.PointCloud"),
        ours("foxglove.Pose"),
        ("e.M", "protobuf", EDITIONS.to_vec()),
        ("std_msgs/msg/Header", "ros2msg", b"builtin_interfaces/Time stamp\nstring frame_id\n".to_vec()),
        (
            "p/msg/A",
            "ros2msg",
            b"float64[<=4] a\np/B[2] b\n====\nMSG: p/B\nstring<=9 t \"x\"\nint8 C=3\n".to_vec(),
        ),
        (
            "std_msgs/Header",
            "ros1msg",
            b"uint32 seq\ntime stamp\nstring frame_id\nNone none\n====\nMSG: std_msgs/None\n".to_vec(),
        ),
        ("note", "jsonschema", b"{\"type\":\"object\"}".to_vec()),
    ]
});

/// `edition = "2023"; package e; message M { int32 a = 1; repeated int32 b = 2; }` with an implicit `a`.
const EDITIONS: &[u8] = &[
    0x0a, 0x3b, 0x0a, 0x07, b'e', b'.', b'p', b'r', b'o', b't', b'o', 0x12, 0x01, b'e', 0x22, 0x1e, 0x0a,
    0x01, b'M', 0x12, 0x0f, 0x0a, 0x01, b'a', 0x18, 0x01, 0x20, 0x01, 0x28, 0x05, 0x42, 0x05, 0xaa, 0x01,
    0x02, 0x08, 0x02, 0x12, 0x08, 0x0a, 0x01, b'b', 0x18, 0x02, 0x20, 0x03, 0x28, 0x05, 0x62, 0x08, b'e',
    b'd', b'i', b't', b'i', b'o', b'n', b's', 0x70, 0xe8, 0x07,
];

/// Messages of every type with pixels or points, and those of the other targets.
static PAYLOADS: LazyLock<Vec<AnyMessage>> = LazyLock::new(|| {
    let field =
        |name: &str, offset| foxglove::PackedElementField { name: name.to_owned(), offset, r#type: 7 };
    let image = |encoding: &str, step: u32| {
        AnyMessage::new(foxglove::RawImage {
            width: 4,
            height: 3,
            encoding: encoding.to_owned(),
            step,
            data: vec![7; step as usize * 3].into(),
            ..Default::default()
        })
    };
    let cloud = foxglove::PointCloud {
        point_stride: 12,
        fields: vec![field("x", 0), field("y", 4), field("z", 8)],
        data: vec![1; 48].into(),
        ..Default::default()
    };
    let compressed =
        foxglove::CompressedImage { data: PNG.into(), format: "png".into(), ..Default::default() };
    let mut payloads: Vec<AnyMessage> = messages().into();
    payloads.extend(
        [("rgb8", 12), ("16UC1", 8), ("32FC1", 16), ("bayer_rggb8", 4), ("mono8", 4)]
            .map(|it| image(it.0, it.1)),
    );
    payloads.push(AnyMessage::new(cloud));
    payloads.push(AnyMessage::new(compressed));
    payloads
});

/// A grey pixel.
const PNG: &[u8] = &[
    0x89, b'P', b'N', b'G', 0x0d, 0x0a, 0x1a, 0x0a, 0, 0, 0, 0x0d, b'I', b'H', b'D', b'R', 0, 0, 0, 1, 0, 0,
    0, 1, 8, 0, 0, 0, 0, 0x3a, 0x7e, 0x9b, 0x55, 0, 0, 0, 0x0a, b'I', b'D', b'A', b'T', 0x78, 0x9c, 0x63,
    0x60, 0, 0, 0, 2, 0, 1, 0x48, 0xaf, 0xa4, 0x71, 0, 0, 0, 0, b'I', b'E', b'N', b'D', 0xae, 0x42, 0x60,
    0x82,
];
