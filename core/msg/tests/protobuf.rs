//! Protobuf: the scanner agrees with the tree, trees encode to the original message, and damaged messages are errors.

mod support;

use bytes::Bytes;
use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use rcs_msg::{
    FieldScanner, MessageEncoding, Schema, Value, canonical, header_frame, header_stamp, registry,
};
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

/// Descriptor sets from Google's compiler, and a message that its library wrote.
const EDITIONS: [(&str, &[u8]); 2] = [
    ("2023", include_bytes!("editions/all_2023.binpb")),
    ("2024", include_bytes!("editions/all_2024.binpb")),
];
const READING: &[u8] = include_bytes!("editions/reading.bin");

#[test]
fn a_message_of_an_edition_decodes_as_the_library_wrote_it() {
    let expected = [
        (".stamp.seconds", 1_700_000_000.0),
        (".stamp.nanos", 5.0),
        (".count", 3.0),
        (".ranges_m[1]", 2.5),
        (".offsets[0]", -1.0),
        (".leg.length_m", 0.5),
        (".leg.ticks[1]", 8.0),
        (".legs[1].length_m", 2.25),
        (".costs.a", 2.5),
        (".serial", 99.0),
        (".open", 1.0),
        (".opens[1]", 0.0),
        (".data.@length", 2.0),
        (".closed", 2.0),
        (".closeds[1]", 2.0),
    ];
    for (edition, set) in EDITIONS {
        let data = Bytes::from_static(set);
        let schema = Arc::new(Schema::new("all.Reading", MessageEncoding::Protobuf, "protobuf", data));
        schema.decodable().unwrap_or_else(|error| panic!("{edition}: {error}"));
        let message = Bytes::from_static(READING);
        let value = schema.value(&message).unwrap_or_else(|error| panic!("{edition}: {error}"));
        for (path, number) in expected {
            let field = path.parse().expect(path);
            let got = value.get(&field).ok().and_then(|value| value.as_f64());
            assert_eq!(got, Some(number), "{edition}: {path} of {value:?}");
            if let Ok(scanner) = FieldScanner::new(&schema, &field) {
                assert_eq!(scanner.scan(&message), Ok(Some(number)), "{edition}: {path}");
            }
        }
        let at = |path: &str| value.get(&path.parse().expect(path)).expect(path).into_owned();
        assert_eq!(at(".frame_id").as_text(), Some("laser"), "{edition}");
        assert_eq!(at(".implicit.b").as_text(), Some("x"), "{edition}");
        // Without presence a field that was not written is zero; with it, the field is absent.
        assert_eq!(at(".implicit.a"), Value::Int(0), "{edition}");
        assert_eq!(at(".implicit.c"), Value::Bool(false), "{edition}: written, although it is the default");
        for absent in [".topic", ".other", ".x"] {
            assert_eq!(at(absent), Value::Null, "{edition}: {absent}");
        }
        assert_eq!(at(".needed"), Value::Bool(false), "{edition}");
        let again = schema.encode(&value).unwrap_or_else(|error| panic!("{edition}: {error}"));
        assert_eq!(schema.value(&again).expect("it reads"), value, "{edition}");
    }
}

#[test]
fn an_edition_that_is_not_known_is_refused_by_its_number() {
    let (_, set) = EDITIONS[1];
    // Field 14 of a file: the edition, as the number 1001.
    let at = set.windows(3).rposition(|bytes| bytes == [0x70, 0xe9, 0x07]).expect("it names its edition");
    let mut later = set.to_vec();
    later[at + 1..at + 3].copy_from_slice(&[0xea, 0x07]);
    let schema = Schema::new("all.Reading", MessageEncoding::Protobuf, "protobuf", later.into());
    let error = schema.decodable().expect_err("an edition of the future").to_string();
    assert!(error.contains("1002") && error.contains("expected 1000 (2023) or 1001 (2024)"), "{error}");
}
