//! Weights of a process that fuses costs, in the view of tuning: which are a preview of its map.

use super::{Shown, harness};
use crate::samples::{self, NOW};
use crate::view::PreviewStage;
use egui::{Theme, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable as _;
use rcs_bus::{Header, Sample, WriterId};
use rcs_msg::prost::encoding::{WireType, encode_key, encode_varint};
use rcs_msg::rcs::{PortInfo, SpeedLimit};
use rcs_msg::{AnyMessage, Bundle, Known, Schema, Stamp, registry, schema_of};
use rcs_runtime::source::{RunTag, Topic};
use rcs_world::{LEARNED_WEIGHTS, Map, MapMessage, MapOptions, Source, Weights, weights_of};
use std::collections::BTreeMap;
use std::sync::{Arc, LazyLock};

const PARAMS: &str = "/vehicle_interface/params";

/// A part of a protobuf message: a text, or a message of these parts.
fn part(field: u32, parts: &[Vec<u8>]) -> Vec<u8> {
    let (mut encoded, content) = (Vec::new(), parts.concat());
    encode_key(field, WireType::LengthDelimited, &mut encoded);
    encode_varint(content.len() as u64, &mut encoded);
    encoded.extend(content);
    encoded
}

fn text(field: u32, text: &str) -> Vec<u8> {
    part(field, &[text.as_bytes().to_vec()])
}

/// A part of a protobuf message: a whole number.
fn whole(field: u32, number: u64) -> Vec<u8> {
    let mut encoded = Vec::new();
    encode_key(field, WireType::Varint, &mut encoded);
    encode_varint(number, &mut encoded);
    encoded
}

/// A part of a protobuf message: a floating-point number. One that is 0 is left out of a message.
fn floating(field: u32, number: f64) -> Vec<u8> {
    let mut encoded = Vec::new();
    if number != 0.0 {
        encode_key(field, WireType::SixtyFourBit, &mut encoded);
        encoded.extend(number.to_le_bytes());
    }
    encoded
}

const FUSED_PARAMS: &str = "test.FusedParams";

/// Encoded descriptors of parameters with a list of sources, and of learned weights. Views know no message of a plugin.
fn descriptors() -> Vec<u8> {
    // Of a field: number, name, type, and options.
    let field = |number: u64, name: &str, kind: u64, options: Vec<u8>| {
        part(2, &[text(1, name), whole(3, number), whole(4, 1), whole(5, kind), options])
    };
    let role = |role: &str| part(8, &[text(50_009, role)]);
    let source = [
        text(1, "FusedSource"),
        field(1, "name", 9, role("source")),
        field(2, "weight", 1, role("source_weight")),
        field(3, "kind", 13, role("source_kind")),
    ];
    let list = [text(1, "sources"), whole(3, 1), whole(4, 3), whole(5, 11), text(6, ".test.FusedSource")];
    let file = [
        text(1, "test/fused.proto"),
        text(2, "test"),
        text(3, "rcs/options.proto"),
        part(4, &source),
        part(4, &[text(1, "FusedParams"), part(2, &list)]),
        text(12, "proto3"),
    ];
    let weight = [
        text(1, "FusionWeight"),
        field(1, "source", 9, Vec::new()),
        field(2, "weight", 1, Vec::new()),
        field(3, "given", 1, Vec::new()),
    ];
    let list = [text(1, "weights"), whole(3, 2), whole(4, 3), whole(5, 11), text(6, ".rcs.FusionWeight")];
    let learned = [
        text(1, "test/learned.proto"),
        text(2, "rcs"),
        part(4, &weight),
        part(4, &[text(1, "FusionWeights"), part(2, &list)]),
        text(12, "proto3"),
    ];
    // The options are defined beside any message that has some.
    [schema_of::<SpeedLimit>().data().to_vec(), part(1, &file), part(1, &learned)].concat()
}

static KNOWN: [Known; 2] = [
    Known {
        name: FUSED_PARAMS,
        decode: |bytes| Ok(AnyMessage::encoded(schema(FUSED_PARAMS), bytes)),
        timestamp: |_| None,
        frame_id: |_| None,
    },
    Known {
        name: LEARNED_WEIGHTS,
        decode: |bytes| Ok(AnyMessage::encoded(schema(LEARNED_WEIGHTS), bytes)),
        timestamp: |_| None,
        frame_id: |_| None,
    },
];

fn schema(name: &str) -> Arc<Schema> {
    static BUNDLE: LazyLock<Bundle> = LazyLock::new(|| Bundle::new(descriptors().leak(), &KNOWN));
    registry().add(&BUNDLE).unwrap();
    Arc::clone(registry().schema(name).unwrap())
}

/// Parameters with this weight of stereo.
fn params(weight: f64) -> AnyMessage {
    let source = part(1, &[text(1, "stereo"), floating(2, weight)]);
    AnyMessage::encoded(schema(FUSED_PARAMS), source.into())
}

fn sample(log_time: Stamp, message: AnyMessage) -> Sample {
    let header = Header { sequence: 1, log_time, acq_time: log_time, writer: WriterId::RUNTIME };
    Sample { header, message }
}

/// Parameters with this weight of stereo are in force since a tenth of a second.
fn in_force(weight: f64) -> Topic {
    let topic = Topic::new(PARAMS, RunTag::FIRST, schema(FUSED_PARAMS));
    topic.with_latest(sample(NOW.before_ns(100_000_000), params(weight)))
}

/// The process has received this weight of stereo, learned from the given one of its parameters.
fn learn(shown: &mut Shown, weight: f64, given: f64) {
    let schema = schema(LEARNED_WEIGHTS);
    let entry = part(2, &[text(1, "stereo"), floating(2, weight), floating(3, given)]);
    let message = AnyMessage::encoded(Arc::clone(&schema), entry.into());
    let mut processes = shown.frame.processes.to_vec();
    let (buffer, name) = ("/learner/weights".to_owned(), schema.name().to_owned());
    processes[0].inputs.push(PortInfo { buffer, schema: name, ..PortInfo::default() });
    shown.frame.processes = processes.into();
    let topic = Topic::new("/learner/weights", RunTag::FIRST, schema);
    put(shown, &[topic.with_latest(sample(NOW.before_ns(1_000_000_000), message))]);
}

/// A map of this age of the process, fused with this weight of stereo.
fn map(weight: f32, age_ms: u64) -> Topic {
    let time = NOW.before_ns(age_ms * 1_000_000);
    let map = Map::new(0.2).unwrap();
    let weights = Weights::default().with(Source::STEREO, weight);
    let options = MapOptions { sources: map.sources(), heights: false, weights };
    let message = MapMessage::new(map, "local", time, options).into_message();
    let mut topic = Topic::new("/map", RunTag::FIRST, message.schema()).with_latest(sample(time, message));
    topic.writer = "vehicle_interface".into();
    topic.metadata = Arc::new(BTreeMap::from([("rcs.role".to_owned(), "map".to_owned())]));
    topic
}

/// These topics take the places of those with their names.
fn put(shown: &mut Shown, topics: &[Topic]) {
    let is_other = |topic: &&Topic| topics.iter().all(|put| put.name != topic.name);
    shown.frame.topics = shown.frame.topics.iter().filter(is_other).chain(topics).cloned().collect();
}

/// A view of a process whose only source has a weight of 1, and that has made a map with it.
fn shown() -> Harness<'static, Shown> {
    let mut shown = Shown::new("tuning", samples::driving());
    put(&mut shown, &[in_force(1.0), map(1.0, 50)]);
    let mut harness = harness(shown, Vec2::new(900.0, 560.0), Theme::Dark);
    harness.run();
    harness
}

/// The weight of stereo of the preview, the one before it, and what became of it.
fn previewed(harness: &Harness<'_, Shown>) -> Option<(f32, f32, PreviewStage)> {
    let preview = harness.state().selection.preview.get()?;
    let weight = |params: &AnyMessage| weights_of(params).unwrap().get(Source::STEREO).weight;
    Some((weight(&preview.params), weight(&preview.before), preview.stage))
}

#[test]
fn weights_that_were_sent_stay_a_preview_until_a_map_is_made_with_them() {
    let mut harness = shown();
    let take = |harness: &mut Harness<'_, Shown>, weight: f64| {
        put(harness.state_mut(), &[in_force(weight), map(1.0, 200)]);
        harness.run();
    };
    harness.get_by_label("Default of sources[0].weight: 0").click();
    harness.run();
    assert_eq!(previewed(&harness), Some((0.0, 1.0, PreviewStage::Edited)));
    harness.get_by_label_contains("Send 1").click();
    harness.run();
    take(&mut harness, 0.0);
    assert_eq!(previewed(&harness), Some((0.0, 1.0, PreviewStage::InForce)));
    // What was sent while time stands is taken back.
    harness.get_by_label_contains("Undo").click();
    harness.run();
    assert_eq!(previewed(&harness), Some((1.0, 1.0, PreviewStage::OnItsWay)));
    take(&mut harness, 1.0);
    assert_eq!(previewed(&harness), Some((1.0, 1.0, PreviewStage::InForce)));
    put(harness.state_mut(), &[map(1.0, 50)]);
    harness.run();
    assert_eq!(previewed(&harness), None);
}

#[test]
fn weights_that_others_have_sent_are_a_preview_until_a_map_is_made_with_them() {
    let mut harness = shown();
    assert_eq!(previewed(&harness), None);
    put(harness.state_mut(), &[in_force(0.25), map(1.0, 200)]);
    harness.run();
    assert_eq!(previewed(&harness), Some((0.25, 1.0, PreviewStage::InForce)));
    put(harness.state_mut(), &[map(0.25, 50)]);
    harness.run();
    assert_eq!(previewed(&harness), None);
}

#[test]
fn weights_that_were_sent_are_on_their_way_until_they_count_as_lost() {
    let mut harness = shown();
    harness.get_by_label("Default of sources[0].weight: 0").click();
    harness.run();
    harness.get_by_label_contains("Send 1").click();
    harness.run();
    assert_eq!(previewed(&harness), Some((0.0, 1.0, PreviewStage::OnItsWay)));
    // Passes are a quarter of a second apart.
    harness.run_steps(24);
    assert_eq!(previewed(&harness), Some((0.0, 1.0, PreviewStage::Edited)));
}

#[test]
fn a_learned_weight_counts_in_a_preview_of_what_others_have_sent_until_they_send_another_one() {
    let mut harness = shown();
    learn(harness.state_mut(), 0.5, 1.0);
    // Others have sent the same weight, with another parameter.
    put(harness.state_mut(), &[in_force(1.0), map(0.5, 200)]);
    harness.run();
    assert_eq!(previewed(&harness), None);
    put(harness.state_mut(), &[in_force(0.25)]);
    harness.run();
    assert_eq!(previewed(&harness), Some((0.25, 0.5, PreviewStage::InForce)));
}
