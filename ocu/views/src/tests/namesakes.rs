//! How topics of the same name, and things with names that are alike, are told apart.

use super::{Shown, harness};
use crate::samples;
use crate::toolbar::topic_label;
use egui::{Shape, Theme, Vec2};
use egui_kittest::Harness;
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

/// The painted texts with this part, none of which is cut off, sorted.
fn texts(harness: &Harness<'_, Shown>, part: &str) -> Vec<String> {
    let text = |shape: &Shape| match shape {
        Shape::Text(text) if text.galley.text().contains(part) => {
            assert!(!text.galley.elided, "{}", text.galley.text());
            Some(text.galley.text().to_owned())
        }
        _ => None,
    };
    let mut texts: Vec<String> =
        harness.output().shapes.iter().filter_map(|clipped| text(&clipped.shape)).collect();
    texts.sort();
    texts
}

#[test]
fn rows_of_buffers_whose_names_have_a_long_common_end_differ() {
    let schema = Arc::new(Schema::new("one/msg/A", MessageEncoding::Cdr, "ros2msg", Vec::new().into()));
    let topic = |name: &str| {
        let name = format!("/test/geometry_msgs/{name}_with_covariance_stamped");
        Topic::new(&name, RunTag::Recorded, Arc::clone(&schema))
    };
    let frame = Frame { topics: ["accel", "pose", "twist"].map(topic).into(), ..samples::empty() };
    let mut harness = harness(Shown::new("buffers", frame), Vec2::new(260.0, 300.0), Theme::Dark);
    harness.run();
    let mut shown = texts(&harness, "amped");
    assert!(shown.iter().all(|text| text.contains('…')), "{shown:?}");
    shown.dedup();
    assert_eq!(shown.len(), 3, "{shown:?}");
}

#[test]
fn small_boxes_of_the_hierarchy_whose_names_have_a_long_common_beginning_differ() {
    let mut frame = samples::forty();
    let mut processes = frame.processes.to_vec();
    processes[38].name = "waypoint_generator".to_owned();
    processes[39].name = "waypoint_follower".to_owned();
    frame.processes = processes.into();
    let mut harness = harness(Shown::new("hierarchy", frame), Vec2::new(500.0, 300.0), Theme::Dark);
    harness.run();
    let mut shown = texts(&harness, "wa");
    assert!(shown.iter().all(|text| text.contains('…')), "{shown:?}");
    shown.dedup();
    assert_eq!(shown.len(), 2, "{shown:?}");
}
