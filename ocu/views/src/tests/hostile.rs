//! Every view with implausible numbers in every field: no panic, and a bounded amount of drawing.

use super::{Shown, harness};
use crate::samples;
use crate::views::all;
use egui::{Theme, Vec2};
use rcs_bus::Sample;
use rcs_msg::{AnyMessage, Number, Packed, Value};
use rcs_runtime::source::{Frame, Topic, Track};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// From the smallest to the largest, and non-finite values.
const VALUES: [f64; 10] =
    [0.0, 1e-30, -1.0, 4.3e6, 1e18, f32::MAX as f64, -(f32::MAX as f64), f64::MAX, f64::NAN, f64::INFINITY];
/// Maximum number of vertices per frame, at 16 bytes or more each.
const MOST_VERTICES: usize = 400_000;
/// Maximum time of a frame, as the best of a few.
const FRAME: Duration = Duration::from_millis(50);

/// Replaces all numbers of a tree, or only the one with index `only`; counts them in `seen`.
fn put(value: &mut Value, number: f64, only: Option<usize>, seen: &mut usize) {
    let mut is_next = || {
        *seen += 1;
        only.is_none_or(|only| only + 1 == *seen)
    };
    match value {
        Value::Float(v) if is_next() => *v = number,
        Value::Int(v) if is_next() => *v = number as i32 as i64,
        Value::Uint(v) if is_next() => *v = number as u32 as u64,
        Value::Packed(packed) if is_next() => {
            let count = packed.len();
            *packed = if packed.number() == Number::F32 {
                let bytes: Vec<u8> = (0..count).flat_map(|_| (number as f32).to_le_bytes()).collect();
                Packed::new(Number::F32, false, bytes.into())
            } else {
                let bytes: Vec<u8> = (0..count).flat_map(|_| number.to_le_bytes()).collect();
                Packed::new(Number::F64, false, bytes.into())
            };
        }
        Value::Message(fields) => fields.iter_mut().for_each(|(_, value)| put(value, number, only, seen)),
        Value::List(list) => list.iter_mut().for_each(|value| put(value, number, only, seen)),
        _ => {}
    }
}

/// The topic with the number in its message (unchanged where it cannot represent it), and the number of possible
/// positions.
fn changed(topic: &Topic, number: f64, only: Option<usize>) -> (Topic, usize) {
    let mut seen = 0;
    let mut topic = topic.clone();
    let Some(sample) = topic.latest.clone() else { return (topic, 0) };
    let Ok(mut value) = sample.message.value() else { return (topic, 0) };
    put(&mut value, number, only, &mut seen);
    let schema = sample.message.schema();
    if let Ok(bytes) = schema.encode(&value) {
        topic = topic.with_latest(Sample { message: AnyMessage::encoded(schema, bytes), ..sample });
    }
    (topic, seen)
}

fn with_topic(frame: &Frame, index: usize, topic: Topic) -> Frame {
    let mut topics = frame.topics.to_vec();
    topics[index] = topic;
    Frame { topics: topics.into(), ..frame.clone() }
}

/// Shows a view of the frame, and checks the number of vertices and the time.
fn check(kind: &str, frame: &Frame, what: &str) {
    let shown = Shown::new(kind, frame.clone());
    let mut harness = harness(shown, Vec2::new(640.0, 420.0), Theme::Dark);
    harness.run_steps(3);
    let shapes = harness.output().shapes.clone();
    let vertices: usize = harness
        .ctx
        .tessellate(shapes, 1.0)
        .iter()
        .map(|clipped| match &clipped.primitive {
            egui::epaint::Primitive::Mesh(mesh) => mesh.vertices.len(),
            egui::epaint::Primitive::Callback(_) => 0,
        })
        .sum();
    assert!(vertices < MOST_VERTICES, "{kind}, {what}: {vertices} vertices");
    let mut best = Duration::MAX;
    for _ in 0..10 {
        let began = Instant::now();
        harness.step();
        best = best.min(began.elapsed());
        if best < FRAME {
            return;
        }
    }
    panic!("{kind}, {what}: a frame takes {best:?}");
}

#[test]
fn every_view_stands_any_number_in_all_fields_at_once() {
    for frame in [samples::full(), samples::driving()] {
        for number in VALUES {
            let topics: Vec<Topic> =
                frame.topics.iter().map(|topic| changed(topic, number, None).0).collect();
            let frame = Frame { topics: topics.into(), ..frame.clone() };
            for view_type in all() {
                check(view_type.kind, &frame, &format!("{number:e} in every field"));
            }
        }
    }
}

#[test]
fn the_map_and_the_camera_stand_any_number_in_each_field_alone() {
    for frame in [samples::full(), samples::driving()] {
        for (index, topic) in frame.topics.iter().enumerate() {
            // Messages with thousands of numbers are tested with all replaced at once, and with the first ones.
            let (_, count) = changed(topic, 0.0, None);
            for field in 0..count.min(24) {
                for number in [1e-30, f64::from(f32::MAX), f64::NAN] {
                    let (topic, _) = changed(topic, number, Some(field));
                    let name = topic.name.to_string();
                    let frame = with_topic(&frame, index, topic);
                    for kind in ["map", "camera"] {
                        check(kind, &frame, &format!("{number:e} in field {field} of {name}"));
                    }
                }
            }
        }
    }
}

#[test]
fn every_view_stands_clouds_and_tracks_with_places_that_cannot_be() {
    for number in VALUES {
        let mut frame = samples::full();
        let far = number as f32;
        let points: Vec<[f32; 3]> = (0..1000)
            .map(|i| if i % 3 == 0 { [far, 1.0, -far] } else { [1.0, i as f32 * 0.01, far] })
            .collect();
        let cloud = samples::topic("/lidar/points", 10.0, 0.1, samples::cloud(&points));
        let index = frame.topics.iter().position(|topic| &*topic.name == "/lidar/points").unwrap();
        frame = with_topic(&frame, index, cloud);
        let mut tracks = (*frame.tracks).clone();
        for track in tracks.values_mut() {
            let points = track.points.iter().enumerate();
            let points = points.map(|(i, p)| if i % 7 == 3 { [number, p[1], number, number] } else { *p });
            *track = Arc::new(Track { points: points.collect(), ..(**track).clone() });
        }
        frame.tracks = Arc::new(tracks);
        for view_type in all() {
            check(view_type.kind, &frame, &format!("places at {number:e}"));
        }
    }
}
