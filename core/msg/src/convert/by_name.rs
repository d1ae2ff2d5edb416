//! Foxglove's messages as JSON and as messages of ROS (package `foxglove_msgs`): the fields of its protobuf schemas by
//! their names, with choices as numbers. Fields that the schema does not have are left out.
//!
//! | | JSON | ROS 2 | ROS 1 |
//! | --- | --- | --- | --- |
//! | times and durations | `sec`, `nsec` | `sec`, `nanosec` | `secs`, `nsecs` |
//! | bytes | base64 | `uint8[]` | `uint8[]` |
//! | matrices of a calibration | `K` | `k` | `K` |
//!
//! Protobuf's own JSON is read, too: times as texts, choices and numbers that JSON lacks by their names, and names of
//! fields in camel case.

use crate::any::AnyMessage;
use crate::path::FieldPath;
use crate::reader::protobuf::dynamic;
use crate::registry::{Known, registry};
use crate::value::Value;
use base64::Engine as _;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use prost::Message as _;
use prost_reflect::{FieldDescriptor, Kind, MessageDescriptor};
use prost_types::Timestamp;

/// Base64 with or without padding.
static BASE64: GeneralPurpose = GeneralPurpose::new(
    &base64::alphabet::STANDARD,
    GeneralPurposeConfig::new().with_decode_padding_mode(DecodePaddingMode::Indifferent),
);

/// A message of a generated type from the tree of a message of JSON or ROS.
pub(super) fn typed(known: &Known, tree: Value) -> Result<AnyMessage, String> {
    let descriptor = registry().descriptor(known.name).ok_or("it has no descriptor")?;
    let tree = message(&descriptor, tree)?;
    let message = dynamic(&descriptor, &tree, &FieldPath::root()).map_err(|error| error.to_string())?;
    (known.decode)(message.encode_to_vec().into()).map_err(|error| error.to_string())
}

/// A tree of JSON or ROS as one of protobuf. What does not fit is left as it is: [`dynamic`] refuses it with its path.
fn message(descriptor: &MessageDescriptor, value: Value) -> Result<Value, String> {
    let is_stamp = descriptor.full_name() == "google.protobuf.Timestamp";
    let is_time = is_stamp || descriptor.full_name() == "google.protobuf.Duration";
    let fields = match value {
        Value::Message(fields) => fields,
        Value::Text(text) if is_stamp => {
            let time: Timestamp = text.parse().map_err(|_| format!("{text:?} is no time"))?;
            vec![
                ("seconds".to_owned(), Value::Int(time.seconds)),
                ("nanos".to_owned(), Value::Int(time.nanos.into())),
            ]
        }
        other => return Ok(other),
    };
    let mut out = Vec::with_capacity(fields.len());
    for (name, value) in fields {
        let name = match name.as_str() {
            "sec" | "secs" if is_time => "seconds",
            "nsec" | "nsecs" | "nanosec" if is_time => "nanos",
            name => name,
        };
        let field = descriptor.get_field_by_name(name).or_else(|| descriptor.get_field_by_json_name(name));
        // ROS 2 has no capital letters in names.
        let field =
            field.or_else(|| descriptor.fields().find(|field| field.name().eq_ignore_ascii_case(name)));
        if let Some(field) = field {
            out.push((field.name().to_owned(), content(&field, value)?));
        }
    }
    Ok(Value::Message(out))
}

/// The value of a field.
fn content(field: &FieldDescriptor, value: Value) -> Result<Value, String> {
    match value {
        Value::List(items) if field.is_list() => {
            let items: Result<Vec<Value>, String> = items.into_iter().map(|item| part(field, item)).collect();
            items.map(Value::List)
        }
        value if field.is_list() || field.is_map() => Ok(value),
        value => part(field, value),
    }
}

/// One value of a field.
fn part(field: &FieldDescriptor, value: Value) -> Result<Value, String> {
    Ok(match (field.kind(), value) {
        (Kind::Message(descriptor), value) => message(&descriptor, value)?,
        (Kind::Bytes, Value::Text(text)) => {
            let bytes = BASE64.decode(text).map_err(|error| format!("{}: {error}", field.name()))?;
            Value::Bytes(bytes.into())
        }
        // JSON has no NaN: JavaScript writes null, protobuf the name.
        (Kind::Float | Kind::Double, Value::Null) => Value::Float(f64::NAN),
        (Kind::Float | Kind::Double, Value::Text(text)) => named_number(text),
        (_, value) => value,
    })
}

fn named_number(text: String) -> Value {
    let number = match text.as_str() {
        "NaN" => f64::NAN,
        "Infinity" => f64::INFINITY,
        "-Infinity" => f64::NEG_INFINITY,
        _ => return Value::Text(text),
    };
    Value::Float(number)
}

#[cfg(test)]
mod tests {
    use crate::definition::MessageEncoding;
    use crate::foxglove::{CompressedImage, FrameTransform, Log, PointCloud, PoseInFrame, RawImage, log};
    use crate::schema::Schema;
    use crate::{AnyMessage, Payload, canonical, canonical_name, header_frame, header_stamp, points};
    use bytes::Bytes;
    use std::sync::Arc;

    fn schema(name: &str) -> Schema {
        Schema::new(name, MessageEncoding::Json, "jsonschema", Bytes::from_static(b"{}"))
    }

    fn read<T: Payload>(text: &str) -> AnyMessage {
        let name = T::full_name();
        let bytes = Bytes::copy_from_slice(text.as_bytes());
        assert_eq!(canonical_name(&schema(&name)), Some(name.as_str()));
        let message = canonical(&schema(&name), &bytes).expect("it is known").expect("it decodes");
        assert!(message.holds::<T>());
        message
    }

    #[test]
    fn a_message_of_foxglove_is_read_from_its_json() {
        let message = read::<PoseInFrame>(
            r#"{"timestamp": {"sec": 5, "nsec": 7}, "frame_id": "map", "later": [{"a": null}],
                "pose": {"position": {"x": 1, "y": 2.5, "z": 0}, "orientation": null}}"#,
        );
        assert_eq!(header_stamp(&message).map(|stamp| stamp.0), Some(5_000_000_007));
        assert_eq!(header_frame(&message).as_deref(), Some("map"));
        let text = Bytes::from_static(br#"{"timestamp": {"sec": 5, "nsec": 7}}"#);
        let stored = AnyMessage::encoded(Arc::new(schema("foxglove.PoseInFrame")), text);
        assert_eq!(header_stamp(&stored), header_stamp(&message), "as it is stored, too");
        let pose = message.get::<PoseInFrame>().and_then(|stamped| stamped.pose).expect("it has a pose");
        assert_eq!(pose.position.map(|p| (p.x, p.y)), Some((1.0, 2.5)));
        assert_eq!(pose.orientation, None);

        let message = read::<FrameTransform>(
            r#"{"timestamp": {"sec": 5, "nsec": 0}, "parent_frame_id": "map", "child_frame_id": "base",
                "translation": {"x": 1, "y": 0, "z": 0}, "rotation": {"x": 0, "y": 0, "z": 0, "w": 1}}"#,
        );
        let transform = message.get::<FrameTransform>().expect("it is a transform");
        assert_eq!((transform.child_frame_id.as_str(), transform.rotation.map(|q| q.w)), ("base", Some(1.0)));
    }

    #[test]
    fn bytes_are_base64_and_choices_are_numbers() {
        for (text, expect) in [("/9j/4A==", [0xff, 0xd8, 0xff, 0xe0]), ("AQIDBA", [1, 2, 3, 4])] {
            let message = read::<CompressedImage>(&format!(r#"{{"data": "{text}", "format": "jpeg"}}"#));
            let image = message.get::<CompressedImage>().expect("it is an image");
            assert_eq!((&image.data[..], image.format.as_str()), (&expect[..], "jpeg"));
        }
        // The point (1, 2, 3).
        let message = read::<PointCloud>(
            r#"{"point_stride": 12, "data": "AACAPwAAAEAAAEBA", "fields": [{"name": "x", "offset": 0, "type": 7},
                {"name": "y", "offset": 4, "type": 7}, {"name": "z", "offset": 8, "type": 7}]}"#,
        );
        let cloud = message.get::<PointCloud>().expect("it is a cloud");
        let places: Vec<_> =
            points(cloud).expect("it is valid").iter().map(|p| p.position.to_array()).collect();
        assert_eq!(places, [[1.0, 2.0, 3.0]]);
        let message = read::<Log>(r#"{"level": 4, "message": "no path", "line": 12}"#);
        let line = message.get::<Log>().expect("it is a line");
        assert_eq!((line.level(), line.line), (log::Level::Error, 12));
    }

    #[test]
    fn protobufs_own_json_is_read_too() {
        let message = read::<Log>(r#"{"timestamp": "1970-01-01T00:00:05Z", "level": "FATAL"}"#);
        assert_eq!(header_stamp(&message).map(|stamp| stamp.0), Some(5_000_000_000));
        assert_eq!(message.get::<Log>().map(Log::level), Some(log::Level::Fatal));
        let message = read::<RawImage>(r#"{"frameId": "camera", "width": 2.0}"#);
        assert_eq!(
            message.get::<RawImage>().map(|image| (&*image.frame_id, image.width)),
            Some(("camera", 2))
        );
    }

    #[test]
    fn a_scan_becomes_a_cloud_and_null_is_no_return() {
        let scan = schema("foxglove.LaserScan");
        assert_eq!(canonical_name(&scan), Some("foxglove.PointCloud"));
        let text = Bytes::from_static(br#"{"start_angle": 0, "end_angle": 1, "ranges": [1, null, "NaN"]}"#);
        let message = canonical(&scan, &text).expect("it is known").expect("it converts");
        let cloud = message.get::<PointCloud>().expect("it is a cloud");
        assert_eq!(points(cloud).expect("it is valid").len(), 1);
    }

    #[test]
    fn what_does_not_fit_is_refused_with_its_place() {
        for (text, expect) in [
            (r#"{"width": "two"}"#, "got a text, expected an integer from 0, of 32 bits: .width"),
            (r#"{"width": -1}"#, "expected an integer from 0, of 32 bits: .width"),
            (r#"{"data": "*"}"#, "data: Invalid"),
            (r#"{"timestamp": "now"}"#, "\"now\" is no time"),
            ("[]", "got a list, expected a message"),
            ("{", "EOF"),
        ] {
            let text = Bytes::from_static(text.as_bytes());
            let error = canonical(&schema("foxglove.RawImage"), &text).expect("it is known");
            let error = error.expect_err(expect).to_string();
            assert!(
                error.starts_with("foxglove.RawImage does not decode: ") && error.contains(expect),
                "{error}"
            );
        }
        assert_eq!(canonical_name(&schema("rcs.Status")), None, "only Foxglove's messages have a JSON form");
    }
}
