//! Parameters: every one is documented, defaults are accepted, bad values are not.

use prost_reflect::{Kind, MessageDescriptor};
use rcs_msg::params::{ParamKind, check, defaults, set_param, set_param_text, specs};
use rcs_msg::{MessageEncoding, Schema, Value, registry};

/// Every parameter message of ours.
fn parameter_messages() -> Vec<MessageDescriptor> {
    let ours = registry().pool().all_messages().filter(|message| message.package_name() == "rcs");
    ours.filter(|message| message.name().ends_with("Params")).collect()
}

#[test]
fn every_parameter_has_unit_help_and_default_and_numbers_a_range() {
    for message in parameter_messages() {
        let specs = specs(&message);
        assert_eq!(specs.len(), message.fields().len(), "{}: a field is no parameter", message.full_name());
        for spec in specs {
            let at = format!("{}.{}", message.full_name(), spec.name);
            let field = message.get_field_by_name(&spec.name).expect("it is a field");
            let has = |option: &str| {
                let option = registry().pool().get_extension_by_name(option).expect("it is an option");
                field.options().has_extension(&option)
            };
            assert!(has("rcs.unit"), "{at} has no unit");
            assert!(spec.help.len() > 10, "{at} has no help");
            let default = if field.kind() == Kind::String { "rcs.default_text" } else { "rcs.default" };
            assert!(has(default), "{at} has no default");
            if matches!(spec.kind, ParamKind::Number | ParamKind::Integer) {
                assert!(!spec.unit.is_empty(), "{at} is a number without a unit");
                let (min, max) =
                    (spec.min.expect("a number has a least value"), spec.max.expect("and a largest"));
                let default = spec.default.as_f64().expect("a number has a number as default");
                assert!(
                    min < max && (min..=max).contains(&default),
                    "{at}: {default} is not in {min} to {max}"
                );
            }
        }
        check(&defaults(&message)).expect("defaults are accepted");
    }
}

const PROTO: &str = r#"syntax = "proto3"; package odd; import "rcs/options.proto";
    enum Mode { OFF = 0; FAST = 1; }
    message Params {
      double speed_mps = 2 [(rcs.unit) = "m/s", (rcs.min) = 0.1, (rcs.max) = 1.3, (rcs.default) = 0.5, (rcs.help) = "Speed."];
      float weight = 1 [(rcs.unit) = "1", (rcs.min) = 0, (rcs.max) = 0.1, (rcs.default) = 0.1, (rcs.fusion_source) = "stereo"];
      uint32 count = 3 [(rcs.unit) = "1", (rcs.min) = 1, (rcs.max) = 9, (rcs.default) = 3];
      bool on = 4 [(rcs.default) = 1];
      string name = 5 [(rcs.default_text) = "front"];
      Mode mode = 6 [(rcs.default) = 1];
    }"#;

fn odd() -> MessageDescriptor {
    let dir = tempfile::tempdir().expect("a folder can be made");
    std::fs::write(dir.path().join("odd.proto"), PROTO).expect("it can be written");
    let proto = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("proto");
    let mut compiler = protox::Compiler::new([dir.path(), &proto]).expect("the folders are there");
    compiler.include_imports(true).open_file("odd.proto").expect("it compiles");
    let set = compiler.encode_file_descriptor_set();
    // As from a log: not from the registry.
    let schema = Schema::new("odd.Params", MessageEncoding::Protobuf, "protobuf", set.into());
    schema.descriptor().expect("it is protobuf").clone()
}

#[test]
fn options_are_read_from_any_descriptor_in_the_order_of_declaration() {
    let specs = specs(&odd());
    let names: Vec<_> = specs.iter().map(|spec| spec.name.as_str()).collect();
    assert_eq!(names, ["speed_mps", "weight", "count", "on", "name", "mode"]);
    let speed = &specs[0];
    assert_eq!(
        (speed.unit.as_str(), speed.min, speed.max, speed.help.as_str()),
        ("m/s", Some(0.1), Some(1.3), "Speed.")
    );
    assert_eq!(specs[1].fusion_source.as_deref(), Some("stereo"));
    assert_eq!(specs[5].choices, [(0, "OFF".to_owned()), (1, "FAST".to_owned())]);
    let defaults: Vec<_> = specs.into_iter().map(|spec| spec.default).collect();
    let fast = Value::Enum { number: 1, name: "FAST".into() };
    let expect = [
        Value::Float(0.5),
        Value::Float(0.1),
        Value::Int(3),
        Value::Bool(true),
        Value::Text("front".into()),
        fast,
    ];
    assert_eq!(defaults, expect);
}

#[test]
fn what_is_accepted_is_set() {
    let mut message = defaults(&odd());
    check(&message).expect("defaults are accepted");
    for (name, text, expect) in [
        ("speed_mps", "1.3", Value::Float(1.3)),
        ("weight", "0.1", Value::Float(f64::from(0.1f32))),
        ("count", "9", Value::Uint(9)),
        ("on", "false", Value::Bool(false)),
        ("name", "left eye", Value::Text("left eye".into())),
        ("mode", "OFF", Value::Enum { number: 0, name: "OFF".into() }),
    ] {
        set_param_text(&mut message, name, text).expect(name);
        let got = message.get_field_by_name(name).expect("it is a field").into_owned();
        let value = match got {
            prost_reflect::Value::F64(v) => Value::Float(v),
            prost_reflect::Value::F32(v) => Value::Float(v.into()),
            prost_reflect::Value::U32(v) => Value::Uint(v.into()),
            prost_reflect::Value::Bool(v) => Value::Bool(v),
            prost_reflect::Value::String(v) => Value::Text(v),
            prost_reflect::Value::EnumNumber(0) => Value::Enum { number: 0, name: "OFF".into() },
            other => panic!("{other:?}"),
        };
        assert_eq!(value, expect, "{name}");
    }
    check(&message).expect("what was set is accepted");
}

#[test]
fn what_is_not_accepted_says_what_would_be_and_changes_nothing() {
    let unchanged = defaults(&odd());
    for (name, text, expect) in [
        ("speed_mps", "NaN", "parameter speed_mps: got NaN, expected a number from 0.1 to 1.3 m/s"),
        ("speed_mps", "1.31", "parameter speed_mps: got 1.31, expected a number from 0.1 to 1.3 m/s"),
        ("speed_mps", "fast", "parameter speed_mps: got \"fast\", expected a number from 0.1 to 1.3 m/s"),
        ("weight", "inf", "parameter weight: got inf, expected a number from 0 to 0.1"),
        ("count", "-1", "parameter count: got -1, expected a whole number from 1 to 9"),
        ("count", "2.5", "parameter count: got \"2.5\", expected a whole number from 1 to 9"),
        ("on", "1", "parameter on: got \"1\", expected true or false"),
        ("mode", "SLOW", "parameter mode: got \"SLOW\", expected one of OFF, FAST"),
        ("mode", "2", "parameter mode: got 2, expected one of OFF, FAST"),
        (
            "speed",
            "1",
            "no parameter \"speed\" in odd.Params, expected one of speed_mps, weight, count, on, name, mode",
        ),
    ] {
        let mut message = unchanged.clone();
        let error = set_param_text(&mut message, name, text).expect_err(text);
        assert_eq!(error.to_string(), expect);
        assert_eq!(message, unchanged);
    }
    let mut message = unchanged.clone();
    let error =
        set_param(&mut message, "speed_mps", &Value::Text("1".into())).expect_err("a text is no number");
    assert_eq!(error.to_string(), "parameter speed_mps: got \"1\", expected a number from 0.1 to 1.3 m/s");
    message.set_field_by_name("speed_mps", prost_reflect::Value::F64(f64::NAN));
    check(&message).expect_err("NaN is not accepted in a whole message");
}
