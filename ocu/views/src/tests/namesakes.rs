//! How topics of the same name are told apart.

use super::{Shown, harness};
use crate::samples;
use crate::toolbar::topic_label;
use egui::{Theme, Vec2};
use egui_kittest::kittest::Queryable as _;
use rcs_msg::{MessageEncoding, Schema};
use rcs_runtime::source::{Frame, RunTag, Topic};
use std::sync::Arc;

fn topic(run: RunTag, schema: &str) -> Topic {
    let schema = Schema::new(schema, MessageEncoding::Cdr, "ros2msg", Vec::new().into());
    Topic::new("/value", run, Arc::new(schema))
}

fn labels(topics: &[Topic]) -> Vec<String> {
    let frame = Frame { topics: topics.into(), ..samples::empty() };
    frame.topics.iter().map(|topic| topic_label(&frame, topic)).collect()
}

#[test]
fn a_name_has_the_run_only_beside_a_computed_topic_and_the_type_beside_one_of_another_type() {
    let [a, b] = ["one/msg/A", "one/msg/B"].map(|schema| topic(RunTag::Recorded, schema));
    assert_eq!(labels(std::slice::from_ref(&a)), ["/value"]);
    assert_eq!(labels(&[a.clone(), b.clone()]), ["/value (one/A)", "/value (one/B)"]);
    assert_eq!(labels(&[a, topic(RunTag::FIRST, "one/msg/A")]), ["/value (recorded)", "/value"]);
}

#[test]
fn rows_of_buffers_with_one_name_have_their_types() {
    let topics = ["one/msg/A", "one/msg/B"].map(|schema| topic(RunTag::Recorded, schema));
    let frame = Frame { topics: topics.into(), ..samples::empty() };
    let mut harness = harness(Shown::new("buffers", frame), Vec2::new(300.0, 200.0), Theme::Dark);
    harness.run();
    for name in ["/value (one/A)", "/value (one/B)"] {
        assert!(harness.query_by_label(name).is_some(), "{name}");
    }
}
