//! Parameters: every one is documented, defaults are accepted, bad values are refused.

use prost_reflect::{Kind, MessageDescriptor};
use rcs_msg::params::{ParamKind, ParamSpec, check, defaults, find, set_param, set_param_text, specs};
use rcs_msg::{MessageEncoding, Schema, Value, registry};

/// The shared parameter messages. Those of plugins are tested with the plugins.
fn parameter_messages() -> Vec<MessageDescriptor> {
    let names = ["rcs.ImageCheck", "rcs.Mount", "rcs.NoParams", "rcs.VehiclePose"];
    names.into_iter().map(|name| registry().descriptor(name).expect(name)).collect()
}

#[test]
fn every_parameter_has_unit_help_and_default_and_numbers_a_range() {
    for message in parameter_messages() {
        check_declared(&message);
        check(&defaults(&message)).expect("defaults are accepted");
    }
}

fn check_declared(message: &MessageDescriptor) {
    let specs = specs(message);
    assert_eq!(specs.len(), message.fields().len(), "{}: a field is no parameter", message.full_name());
    for spec in specs {
        let at = format!("{}.{}", message.full_name(), spec.name);
        let field = message.get_field_by_name(&spec.name).expect("it is a field");
        let has = |option: &str| {
            let option = field.parent_pool().get_extension_by_name(option).expect("it is an option");
            field.options().has_extension(&option)
        };
        assert!(spec.help.len() > 10, "{at} has no help");
        if let Kind::Message(nested) = field.kind() {
            check_declared(&nested);
            continue;
        }
        assert!(has("rcs.unit"), "{at} has no unit");
        let default = if field.kind() == Kind::String { "rcs.default_text" } else { "rcs.default" };
        assert!(has(default), "{at} has no default");
        if matches!(spec.kind, ParamKind::Number | ParamKind::Integer) {
            assert!(!spec.unit.is_empty(), "{at} is a number without a unit");
            let (min, max) =
                (spec.min.expect("a number has a least value"), spec.max.expect("and a largest"));
            let default = spec.default.as_f64().expect("a number has a number as default");
            assert!(min < max && (min..=max).contains(&default), "{at}: {default} is not in {min} to {max}");
        }
    }
}

const PROTO: &str = r#"syntax = "proto3"; package odd; import "rcs/options.proto";
    enum Mode { OFF = 0; FAST = 1; }
    message Params {
      double speed_mps = 2 [(rcs.unit) = "m/s", (rcs.min) = 0.1, (rcs.max) = 1.3, (rcs.default) = 0.5, (rcs.help) = "Speed."];
      float weight = 1 [(rcs.unit) = "1", (rcs.min) = 0, (rcs.max) = 0.1, (rcs.default) = 0.1];
      uint32 count = 3 [(rcs.unit) = "1", (rcs.min) = 1, (rcs.max) = 9, (rcs.default) = 3];
      bool on = 4 [(rcs.default) = 1];
      string name = 5 [(rcs.default_text) = "front"];
      Mode mode = 6 [(rcs.default) = 1];
    }"#;

const NESTED: &str = r#"syntax = "proto3"; package odd; import "rcs/options.proto";
    message Mount {
      double x_m = 1 [(rcs.unit) = "m", (rcs.min) = -10, (rcs.max) = 10, (rcs.default) = 1];
      double yaw_deg = 2 [(rcs.unit) = "deg", (rcs.min) = -180, (rcs.max) = 180, (rcs.default) = 0];
    }
    message Source {
      string name = 1 [(rcs.default_text) = "none"];
      double weight = 2 [(rcs.unit) = "1", (rcs.min) = 0, (rcs.max) = 1, (rcs.default) = 0.5];
      Mount mount = 3;
    }
    message Params {
      Mount mount = 1 [(rcs.help) = "Where it is.", (rcs.default_text) = "{\"yaw_deg\": 90}"];
      repeated Source sources = 2 [(rcs.max) = 3, (rcs.default_text) = "[{\"name\": \"range\"}]"];
      repeated double limits_m = 3 [(rcs.unit) = "m", (rcs.min) = 0, (rcs.max) = 5];
      map<string, double> others = 4;
    }"#;

fn odd() -> MessageDescriptor {
    compiled(PROTO)
}

fn nested() -> MessageDescriptor {
    compiled(NESTED)
}

fn compiled(text: &str) -> MessageDescriptor {
    let dir = tempfile::tempdir().expect("a folder can be made");
    std::fs::write(dir.path().join("odd.proto"), text).expect("it can be written");
    let proto = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("proto");
    let mut compiler = protox::Compiler::new([dir.path(), &proto]).expect("the folders are there");
    compiler.include_imports(true).open_file("odd.proto").expect("it compiles");
    let set = compiler.encode_file_descriptor_set();
    // The descriptor comes from data, as in a log, not from the registry.
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
        ("name", "left camera", Value::Text("left camera".into())),
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

fn text_of(message: &prost_reflect::DynamicMessage) -> String {
    serde_json::to_string(message).expect("it is JSON")
}

#[test]
fn a_message_within_and_a_list_of_messages_have_their_defaults_and_specs() {
    let descriptor = nested();
    let specs = specs(&descriptor);
    let kinds: Vec<_> = specs.iter().map(|spec| (spec.name.as_str(), spec.kind)).collect();
    assert_eq!(
        kinds,
        [("mount", ParamKind::Group), ("sources", ParamKind::List), ("limits_m", ParamKind::List)]
    );
    let names = |spec: &ParamSpec| spec.fields.iter().map(|field| field.name.clone()).collect::<Vec<_>>();
    assert_eq!(names(&specs[0]), ["x_m", "yaw_deg"]);
    assert_eq!(names(&specs[1]), ["name", "weight", "mount"]);
    assert_eq!(specs[2].fields[0].max, Some(5.0));
    let message = defaults(&descriptor);
    check(&message).expect("defaults are accepted");
    assert_eq!(
        text_of(&message),
        r#"{"mount":{"xM":1.0,"yawDeg":90.0},"sources":[{"name":"range","weight":0.5,"mount":{"xM":1.0}}]}"#
    );
    for (path, unit) in [("mount.x_m", "m"), ("sources[0].weight", "1"), ("sources[7].mount.yaw_deg", "deg")]
    {
        assert_eq!(find(&descriptor, path).expect(path).unit, unit);
    }
}

#[test]
fn a_field_of_a_group_has_the_default_that_the_group_gives_it() {
    let descriptor = nested();
    for (path, default) in [("mount.yaw_deg", 90.0), ("mount.x_m", 1.0), ("sources[0].mount.yaw_deg", 0.0)] {
        assert_eq!(find(&descriptor, path).expect(path).default, Value::Float(default), "{path}");
    }
}

#[test]
fn what_lies_within_is_set_by_its_path_and_keeps_what_is_not_named() {
    let mut message = defaults(&nested());
    for (path, text) in [
        ("mount.x_m", "2"),
        ("sources", r#"[{"name": "a"}, {"weight": 0.25, "mount": {"x_m": -1}}]"#),
        ("sources[0].mount.yaw_deg", "7"),
        ("limits_m", "[1, 2.5]"),
    ] {
        set_param_text(&mut message, path, text).expect(path);
    }
    let mount = Value::Message(vec![("yaw_deg".to_owned(), Value::Int(3))]);
    set_param(&mut message, "mount", &mount).expect("a group takes what is named");
    check(&message).expect("what was set is accepted");
    assert_eq!(
        text_of(&message),
        r#"{"mount":{"xM":2.0,"yawDeg":3.0},"sources":[{"name":"a","weight":0.5,"mount":{"xM":1.0,"yawDeg":7.0}},{"name":"none","weight":0.25,"mount":{"xM":-1.0}}],"limitsM":[1.0,2.5]}"#
    );
}

#[test]
fn what_is_wrong_within_is_said_with_its_path_and_changes_nothing() {
    let unchanged = defaults(&nested());
    for (path, text, expect) in [
        ("mount.x_m", "11", "parameter mount.x_m: got 11, expected a number from -10 to 10 m"),
        ("mount.z_m", "1", "no parameter \"z_m\" in odd.Mount, expected one of x_m, yaw_deg"),
        ("mount", "3", "parameter mount: got 3, expected a table of x_m, yaw_deg"),
        ("mount", "{\"x_m\": 99}", "parameter mount.x_m: got 99, expected a number from -10 to 10 m"),
        ("sources[0].weight", "NaN", "parameter sources[0].weight: got NaN, expected a number from 0 to 1"),
        (
            "sources[1].weight",
            "1",
            "parameter sources[1]: got element 1 of 1, expected a list of at most 3 tables of name, weight, mount",
        ),
        (
            "sources",
            "[{}, {}, {}, {}]",
            "parameter sources: got 4 elements, expected a list of at most 3 tables of name, weight, mount",
        ),
        (
            "sources",
            "[{\"mount\": {\"yaw_deg\": 200}}]",
            "parameter sources[0].mount.yaw_deg: got 200, expected a number from -180 to 180 deg",
        ),
        ("limits_m", "[1, 6]", "parameter limits_m[1]: got 6, expected a number from 0 to 5 m"),
        ("others", "{}", "no parameter \"others\" in odd.Params, expected one of mount, sources, limits_m"),
    ] {
        let mut message = unchanged.clone();
        let error = set_param_text(&mut message, path, text).expect_err(text);
        assert_eq!(error.to_string(), expect);
        assert_eq!(message, unchanged);
    }
}

#[test]
fn a_message_that_comes_without_its_group_is_refused() {
    let mut message = defaults(&nested());
    message.clear_field_by_name("mount");
    let error = check(&message).expect_err("the mount is missing").to_string();
    assert_eq!(error, "parameter mount: got nothing, expected a table of x_m, yaw_deg");
    let mut message = defaults(&nested());
    let mut sources = message.get_field_by_name("sources").expect("it is a field").into_owned();
    if let prost_reflect::Value::List(items) = &mut sources {
        let source = items[0].as_message_mut().expect("a source is a message");
        source.set_field_by_name("weight", prost_reflect::Value::F64(2.0));
    }
    message.set_field_by_name("sources", sources);
    let error = check(&message).expect_err("the weight is out of range").to_string();
    assert_eq!(error, "parameter sources[0].weight: got 2, expected a number from 0 to 1");
}
