//! Every message of every recorded ROS 2 log can be read, and agrees with another implementation.

use rcs_msg::{
    AnyMessage, FieldScanner, MessageEncoding, Schema, Value, canonical, canonical_name, foxglove,
    header_stamp, image, points,
};
use re_ros_msg::deserialize::primitive_array::PrimitiveArray;
use re_ros_msg::deserialize::{MapResolver, Value as Theirs, decode_message};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Counts of what a log contains.
#[derive(Debug, Default, PartialEq, Eq)]
struct Counts {
    messages: usize,
    /// Messages that were read as a tree.
    decoded: usize,
    /// Messages that were converted to canonical ones.
    converted: usize,
    /// Types that were read.
    types: usize,
}

/// Reads a whole log; an error in a message whose schema has a reader fails the test.
fn read(path: &Path) -> Counts {
    let bytes = std::fs::read(path).expect("the log is there");
    let mut schemas: BTreeMap<u16, Arc<Schema>> = BTreeMap::new();
    let mut seen: BTreeMap<String, usize> = BTreeMap::new();
    let mut counts = Counts::default();
    for message in mcap::MessageStream::new(&bytes).expect("it is a log") {
        let message = message.expect("it is not damaged");
        counts.messages += 1;
        let channel = &message.channel;
        let schema = schemas.entry(channel.id).or_insert_with(|| {
            let (name, encoding, data) = channel.schema.as_ref().map_or_else(Default::default, |schema| {
                (schema.name.clone(), schema.encoding.clone(), schema.data.to_vec())
            });
            let layout = MessageEncoding::from_name(&channel.message_encoding);
            Arc::new(Schema::new(name, layout, encoding, data.into()))
        });
        if schema.decodable().is_err() {
            continue;
        }
        let data = bytes::Bytes::copy_from_slice(&message.data);
        let value = schema.value(&data).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        counts.decoded += 1;
        let count = seen.entry(schema.name().to_owned()).or_default();
        *count += 1;
        if *count <= 3 {
            same_as_reference(schema, &data, &value);
            paths_and_scanner_agree(schema, &data, &value);
        }
        if canonical_name(schema).is_some() {
            let message = canonical(schema, &data).expect("it has a name").expect("it converts");
            assert_eq!(header_stamp(&message), value.header_stamp(), "{}", schema.name());
            counts.converted += 1;
        }
    }
    counts.types = seen.len();
    counts
}

fn paths_and_scanner_agree(schema: &Arc<Schema>, data: &[u8], value: &Value) {
    for (path, leaf) in value.leaves().take(200) {
        assert_eq!(&*value.get(&path).expect("a leaf is there"), leaf, "{path}");
        let paths = match leaf.len() {
            Some(0) => vec![path.length()],
            Some(length) if leaf.as_text().is_none() => {
                vec![path.length(), path.index(length - 1), path.index(length)]
            }
            _ => vec![path],
        };
        for path in paths {
            let Ok(scanner) = FieldScanner::new(schema, &path) else {
                assert!(leaf.as_f64().is_none(), "{path} is a number");
                continue;
            };
            let expect = value.get(&path).ok().and_then(|value| value.as_f64());
            let got = scanner.scan(data).expect("the message reads");
            assert_eq!(got.map(f64::to_bits), expect.map(f64::to_bits), "{} {path}", schema.name());
        }
    }
}

/// Compares with `re_ros_msg`'s reading of the same message.
fn same_as_reference(schema: &Schema, data: &[u8], ours: &Value) {
    let text = std::str::from_utf8(schema.data()).expect("a definition is a text");
    if text.contains("\n---\n") {
        // `re_ros_msg` does not support service events.
        return;
    }
    let parsed = re_ros_msg::MessageSchema::parse(schema.name(), text).expect("the reference parses it");
    let resolver = MapResolver::new(parsed.dependencies.iter().map(|spec| (spec.name.clone(), spec)));
    assert_eq!(data[..2], [0, 1], "recorded messages are little-endian");
    let mut reader = re_cdr::CdrReader::<re_cdr::LittleEndian>::new(&data[4..]);
    match decode_message(&mut reader, &parsed.spec, &resolver) {
        Ok(theirs) => same(ours, &theirs, schema.name()),
        // `re_ros_msg` does not support wide texts.
        Err(error) => assert!(text.contains("wstring"), "{}: {error}", schema.name()),
    }
}

fn same(ours: &Value, theirs: &Theirs, at: &str) {
    let number = |theirs: f64| {
        let ours = ours.as_f64().unwrap_or_else(|| panic!("{at}: {ours:?} is no number"));
        assert!(ours == theirs || (ours.is_nan() && theirs.is_nan()), "{at}: {ours} is not {theirs}");
    };
    let each = |theirs: Vec<Theirs>| {
        assert_eq!(ours.len(), Some(theirs.len()), "{at}");
        for (i, theirs) in theirs.iter().enumerate() {
            same(&ours.item(i).expect("it is in range"), theirs, &format!("{at}[{i}]"));
        }
    };
    match theirs {
        Theirs::Bool(v) => assert_eq!(*ours, Value::Bool(*v), "{at}"),
        Theirs::I8(v) => number(f64::from(*v)),
        Theirs::U8(v) => number(f64::from(*v)),
        Theirs::I16(v) => number(f64::from(*v)),
        Theirs::U16(v) => number(f64::from(*v)),
        Theirs::I32(v) => number(f64::from(*v)),
        Theirs::U32(v) => number(f64::from(*v)),
        Theirs::I64(v) => assert_eq!(*ours, Value::Int(*v), "{at}"),
        Theirs::U64(v) => assert_eq!(*ours, Value::Uint(*v), "{at}"),
        Theirs::F32(v) => number(f64::from(*v)),
        Theirs::F64(v) => number(*v),
        Theirs::String(v) => assert_eq!(ours.as_text(), Some(v.as_str()), "{at}"),
        Theirs::Array(list) | Theirs::Sequence(list) => each(list.clone()),
        Theirs::PrimitiveArray(array) | Theirs::PrimitiveSeq(array) => each(match array.clone() {
            PrimitiveArray::Bool(v) => v.into_iter().map(Theirs::Bool).collect(),
            PrimitiveArray::I8(v) => v.into_iter().map(Theirs::I8).collect(),
            PrimitiveArray::U8(v) => v.into_iter().map(Theirs::U8).collect(),
            PrimitiveArray::I16(v) => v.into_iter().map(Theirs::I16).collect(),
            PrimitiveArray::U16(v) => v.into_iter().map(Theirs::U16).collect(),
            PrimitiveArray::I32(v) => v.into_iter().map(Theirs::I32).collect(),
            PrimitiveArray::U32(v) => v.into_iter().map(Theirs::U32).collect(),
            PrimitiveArray::I64(v) => v.into_iter().map(Theirs::I64).collect(),
            PrimitiveArray::U64(v) => v.into_iter().map(Theirs::U64).collect(),
            PrimitiveArray::F32(v) => v.into_iter().map(Theirs::F32).collect(),
            PrimitiveArray::F64(v) => v.into_iter().map(Theirs::F64).collect(),
            PrimitiveArray::String(v) => v.into_iter().map(Theirs::String).collect(),
        }),
        Theirs::Message(fields) => {
            assert_eq!(ours.fields().len(), fields.len(), "{at}");
            for (name, theirs) in fields {
                same(ours.field(name).expect("both have it"), theirs, &format!("{at}.{name}"));
            }
        }
    }
}

fn logs(folder: &str) -> Option<Vec<PathBuf>> {
    fn visit(dir: &Path, out: &mut Vec<PathBuf>) {
        for entry in std::fs::read_dir(dir).expect("the folder is there") {
            let path = entry.expect("it can be listed").path();
            if path.is_dir() {
                visit(&path, out);
            } else if path.extension().is_some_and(|extension| extension == "mcap") {
                out.push(path);
            }
        }
    }
    let dir = rcs_testkit::data_dir()?.join(folder);
    let mut out = Vec::new();
    visit(&dir, &mut out);
    out.sort();
    Some(out)
}

fn check(log: &str, expect: &Counts) {
    let Some(dir) = rcs_testkit::data_dir() else { return };
    assert_eq!(read(&dir.join(log)), *expect, "{log}");
}

#[test]
fn every_message_of_the_husky_log_reads_and_converts() {
    let expect = Counts { messages: 16_806, decoded: 16_806, converted: 16_806, types: 3 };
    check("real-logs/husky_outdoor_ros2.mcap", &expect);
}

#[test]
fn every_message_of_the_road_log_reads_and_converts() {
    check(
        "real-logs/orfd_y0613_1242_ros2.mcap",
        &Counts { messages: 18, decoded: 18, converted: 18, types: 3 },
    );
}

/// Every canonical message of a log; `None` without the recordings.
fn converted(log: &str) -> Option<Vec<AnyMessage>> {
    let dir = rcs_testkit::data_dir()?;
    let bytes = std::fs::read(dir.join(log)).expect("the log is there");
    let messages = mcap::MessageStream::new(&bytes).expect("it is a log").map(|message| {
        let message = message.expect("it is not damaged");
        let schema = message.channel.schema.as_ref().expect("it has a schema");
        let schema =
            Schema::new(&schema.name, MessageEncoding::Cdr, &schema.encoding, schema.data.to_vec().into());
        canonical(&schema, &bytes::Bytes::copy_from_slice(&message.data))
            .expect("it is known")
            .expect("it converts")
    });
    Some(messages.collect())
}

#[test]
fn the_road_log_gives_pictures_and_dense_depth() {
    let Some(messages) = converted("real-logs/orfd_y0613_1242_ros2.mcap") else { return };
    let (mut pictures, mut depths) = (0, 0);
    for message in messages {
        if let Some(image) = message.get::<foxglove::CompressedImage>() {
            let rgb = image::compressed_to_rgb8(image).expect("it decodes");
            assert_eq!((rgb.width, rgb.height, rgb.data.len()), (1280, 720, 1280 * 720 * 3));
            pictures += 1;
        }
        if let Some(depth) = message.get::<foxglove::RawImage>() {
            let depth = image::depth_m(depth, 1.0 / 256.0).expect("it is depth");
            let valid = depth.iter().filter(|d| d.is_finite()).count();
            assert!(valid * 4 > depth.len(), "{valid} of {} pixels have a range", depth.len());
            assert!(depth.iter().all(|d| d.is_nan() || (0.0..256.0).contains(d)));
            depths += 1;
        }
    }
    assert!(pictures > 0 && depths > 0, "{pictures} pictures, {depths} images of depths");
}

#[test]
fn the_forest_log_gives_a_cloud_of_131_072_points() {
    let Some(messages) = converted("real-logs/monoforce_tradr_ros2.mcap") else { return };
    let clouds: Vec<_> = messages.iter().filter_map(AnyMessage::get::<foxglove::PointCloud>).collect();
    assert_eq!(clouds.len(), 1);
    for cloud in clouds {
        let points = points(cloud).expect("it is valid");
        assert_eq!(points.len(), 131_072);
        assert!(points.iter().filter(|point| point.position.is_finite()).count() > 50_000);
    }
}

#[test]
fn every_message_of_the_forest_log_reads_and_converts() {
    check(
        "real-logs/monoforce_tradr_ros2.mcap",
        &Counts { messages: 65, decoded: 65, converted: 65, types: 5 },
    );
}

#[test]
fn every_message_of_all_94_types_reads() {
    let Some(dir) = rcs_testkit::data_dir() else { return };
    let counts = read(&dir.join("ros2-typed-mcap/test_bag_mcap.mcap"));
    assert_eq!((counts.types, counts.messages, counts.decoded), (94, 188, 188));
}

#[test]
fn every_bag_reads_but_the_one_with_the_wrong_serialization() {
    let Some(logs) = logs("rosbag2-mcap") else { return };
    assert_eq!(logs.len(), 20);
    for log in logs {
        let counts = read(&log);
        if log.to_string_lossy().contains("wrong_rmw_test") {
            assert_eq!(counts.decoded, 0, "{}", log.display());
        } else {
            assert_eq!(counts.messages, counts.decoded, "{}", log.display());
        }
    }
}

#[test]
fn the_bag_with_the_wrong_serialization_says_why_it_is_not_shown() {
    let Some(logs) = logs("rosbag2-mcap") else { return };
    let log = logs.iter().find(|log| log.to_string_lossy().contains("wrong_rmw_test")).expect("it is there");
    let bytes = std::fs::read(log).expect("the log is there");
    let summary = mcap::Summary::read(&bytes).expect("it is a log").expect("it has a summary");
    assert!(!summary.channels.is_empty());
    let channels: BTreeMap<_, _> = summary.channels.into_iter().collect();
    for channel in channels.values() {
        let schema = channel.schema.as_ref().expect("it has a schema");
        let encoding = MessageEncoding::from_name(&channel.message_encoding);
        let schema = Schema::new(&schema.name, encoding, &schema.encoding, schema.data.to_vec().into());
        let error = schema.decodable().expect_err("its serialization is unknown").to_string();
        assert!(error.contains("expected protobuf, cdr, ros1 or json"), "{error}");
    }
}
