//! Protobuf: the scanner agrees with the tree, trees encode to the original message, and damaged messages are errors.

mod support;

use bytes::Bytes;
use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use rcs_msg::{FieldScanner, Schema, Value, canonical, header_frame, header_stamp, registry};
use std::sync::{Arc, LazyLock};
use support::{Entropy, message, odd_schemas, path};

static SCHEMAS: LazyLock<Vec<Arc<Schema>>> = LazyLock::new(|| {
    let names = [
        "foxglove.Grid",
        "foxglove.PointCloud",
        "foxglove.Odometry",
        "foxglove.LocationFix",
        "foxglove.CameraCalibration",
        "foxglove.SceneUpdate",
        "foxglove.FrameTransforms",
        "foxglove.ImageAnnotations",
        "rcs.CycleRecord",
        "rcs.ProcessInfo",
    ];
    let ours = names.map(|name| Arc::clone(registry().schema(name).expect(name)));
    odd_schemas().into_iter().chain(ours).collect()
});

/// A random schema and a random message of it.
fn random(bytes: &[u8]) -> (&'static Arc<Schema>, Bytes, Entropy<'_>) {
    let mut entropy = Entropy(bytes);
    let schema = &SCHEMAS[entropy.below(SCHEMAS.len())];
    let descriptor = schema.descriptor().expect("it is protobuf");
    let mut out = Vec::new();
    message(descriptor, 4, &mut entropy, &mut out);
    (schema, out.into(), entropy)
}

/// Whether two trees are equal. All NaN are equal, because conversions of NaN depend on the processor.
fn equal(a: &Value, b: &Value) -> bool {
    match (a, b) {
        (Value::Float(a), Value::Float(b)) => a == b || (a.is_nan() && b.is_nan()),
        (Value::Packed(a), Value::Packed(b)) => {
            a.len() == b.len() && a.iter().zip(b.iter()).all(|(a, b)| equal(&a.into(), &b.into()))
        }
        (Value::List(a), Value::List(b)) => a.len() == b.len() && a.iter().zip(b).all(|(a, b)| equal(a, b)),
        (Value::Message(a), Value::Message(b)) => {
            a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.0 == b.0 && equal(&a.1, &b.1))
        }
        (a, b) => a == b,
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, rng_seed: RngSeed::Fixed(1), failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn the_scanner_reads_what_the_tree_holds(bytes in prop::collection::vec(any::<u8>(), 0..600)) {
        let (schema, data, mut entropy) = random(&bytes);
        let value = schema.value(&data).expect("a random message reads");
        for _ in 0..8 {
            let path = path(schema.descriptor().expect("it is protobuf"), &mut entropy);
            // A random path may end at a message, or where a message contains itself.
            let Ok(scanner) = FieldScanner::new(schema, &path) else { continue };
            let expect = value.get(&path).ok().and_then(|value| value.as_f64());
            let got = scanner.scan(&data).expect("a random message scans");
            prop_assert_eq!(got.map(f64::to_bits), expect.map(f64::to_bits), "{} {}", schema.name(), path);
        }
    }

    #[test]
    fn a_tree_encodes_to_the_message_that_it_was(bytes in prop::collection::vec(any::<u8>(), 0..600)) {
        let (schema, data, _) = random(&bytes);
        let value = schema.value(&data).expect("a random message reads");
        let again = schema.value(&schema.encode(&value).expect("it encodes")).expect("it reads");
        prop_assert!(equal(&value, &again), "{value:?}\n{again:?}");
    }

    #[test]
    fn a_damaged_message_is_an_error_or_another_message(
        bytes in prop::collection::vec(any::<u8>(), 0..300),
        cut in any::<prop::sample::Index>(),
        flips in prop::collection::vec(any::<prop::sample::Index>(), 0..4),
    ) {
        let (schema, data, mut entropy) = random(&bytes);
        let mut data = data.to_vec();
        for flip in flips.iter().filter(|_| !data.is_empty()).collect::<Vec<_>>() {
            let bit = flip.index(data.len() * 8);
            data[bit / 8] ^= 1 << (bit % 8);
        }
        data.truncate(cut.index(data.len() + 1));
        let data = Bytes::from(data);
        if let Ok(value) = schema.value(&data) {
            value.leaves().for_each(drop);
        }
        if let Some(Ok(message)) = canonical(schema, &data) {
            let _ = (header_stamp(&message), header_frame(&message));
        }
        let path = path(schema.descriptor().expect("it is protobuf"), &mut entropy);
        if let Ok(scanner) = FieldScanner::new(schema, &path) {
            let _ = scanner.scan(&data);
        }
    }

    #[test]
    fn no_bytes_make_the_scanner_or_the_reader_panic(data in prop::collection::vec(any::<u8>(), 0..200)) {
        for schema in SCHEMAS.iter() {
            let data = Bytes::copy_from_slice(&data);
            let _ = schema.value(&data);
            let mut entropy = Entropy(&data);
            let path = path(schema.descriptor().expect("it is protobuf"), &mut entropy);
            if let Ok(scanner) = FieldScanner::new(schema, &path) {
                let _ = scanner.scan(&data);
            }
        }
    }
}

#[test]
fn maps_are_messages_in_the_order_of_their_keys() {
    let schema = SCHEMAS.iter().find(|schema| schema.name() == "odd.New").expect("it is there");
    let mut value = schema.value(&Bytes::new()).expect("no bytes are a message");
    let leaf = Value::Message(vec![("v".into(), Value::Float(2.5))]);
    let map = Value::Message(vec![("b".into(), leaf.clone()), ("a".into(), leaf)]);
    value.set(&".map".parse().expect("a path"), map).expect("it can be set");
    let data = schema.encode(&value).expect("it encodes");
    let value = schema.value(&data).expect("it reads");
    let keys: Vec<_> =
        value.field("map").expect("it is there").fields().iter().map(|(key, _)| key.as_str()).collect();
    assert_eq!(keys, ["a", "b"]);
    let scanner = FieldScanner::new(schema, &".map.b.v".parse().expect("a path")).expect("it is a number");
    assert_eq!(scanner.scan(&data), Ok(Some(2.5)));
}

#[test]
fn a_value_that_a_field_cannot_hold_is_refused_with_its_path() {
    let schema = registry().schema("foxglove.Grid").expect("it is there");
    let cases = [
        (
            ".column_count",
            Value::Int(-1),
            "got an integer, expected an integer from 0, of 32 bits: .column_count",
        ),
        (".frame_id", Value::Float(1.0), "got a number, expected a text: .frame_id"),
        (
            ".cell_size.q",
            Value::Float(1.0),
            "got \"q\", expected a field of foxglove.Vector2: x, y: .cell_size.q",
        ),
        (".fields", Value::Bool(true), "got a boolean, expected a list: .fields"),
    ];
    for (path, bad, expect) in cases {
        let mut value = Value::Null;
        value.set(&path.parse().expect("a path"), bad).expect("anything can be set where nothing is");
        assert_eq!(schema.encode(&value).expect_err(path).to_string(), expect);
    }
}

#[test]
fn a_path_that_cannot_be_plotted_is_refused() {
    let schema = registry().schema("foxglove.PointCloud").expect("it is there");
    for (path, expect) in [
        (".pose.position.w", "no field \"w\" in foxglove.Vector3, expected one of x, y, z: .pose.position.w"),
        (".pose", "got a message, expected a number: .pose"),
        (".fields", "got a list, expected an index or `@length`: .fields"),
        (".frame_id", "got a text, expected a number: .frame_id"),
        (".data[1].x", "got a byte, expected the end of the path: .data[1].x"),
        ("", "got a message, expected the name of a field: "),
    ] {
        let error = FieldScanner::new(schema, &path.parse().expect(path)).expect_err(path);
        assert_eq!(error.to_string(), expect);
    }
}
