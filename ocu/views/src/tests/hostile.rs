//! Every view with implausible numbers in every field: no panic, and a bounded amount of drawing.

use super::{Shown, harness};
use crate::samples;
use crate::views::all;
use egui::{Theme, Vec2};
use egui_kittest::Harness;
use rcs_bus::Sample;
use rcs_msg::foxglove::RawImage;
use rcs_msg::{AnyMessage, Number, Packed, Value};
use rcs_runtime::source::{Frame, Topic, Track};
use std::collections::BTreeMap;
use std::process::Command;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

/// From the smallest to the largest, and non-finite values.
const VALUES: [f64; 10] =
    [0.0, 1e-30, -1.0, 4.3e6, 1e18, f32::MAX as f64, -(f32::MAX as f64), f64::MAX, f64::NAN, f64::INFINITY];
/// Maximum number of vertices per frame, at 16 bytes or more each.
const MOST_VERTICES: usize = 400_000;
/// Maximum time of a frame, as the best of a few.
const FRAME: Duration = Duration::from_millis(50);

/// Values for each field alone: one that vanishes, one that overflows as a square, and what is no number.
const VALUES_ALONE: [f64; 4] = [1e-30, f32::MAX as f64, f64::NEG_INFINITY, f64::NAN];
/// Maximum memory of a process that shows one view with all of these values.
const MOST_BYTES: u64 = 300 << 20;

/// Visits all numbers of a tree, with their paths without indices. Bytes are one number: pixels, cells, points.
fn numbers(value: &mut Value, path: &str, visit: &mut impl FnMut(&str, &mut Value)) {
    match value {
        Value::Message(fields) => {
            for (name, value) in fields {
                numbers(value, &format!("{path}.{name}"), visit);
            }
        }
        Value::List(list) => list.iter_mut().for_each(|value| numbers(value, &format!("{path}[]"), visit)),
        Value::Null | Value::Bool(_) | Value::Text(_) => {}
        number => visit(path, number),
    }
}

/// Replaces a number by another of its kind.
fn replace(value: &mut Value, number: f64) {
    let repeated =
        |bytes: &[u8], count: usize| bytes.iter().copied().cycle().take(count).collect::<Vec<u8>>();
    match value {
        Value::Float(v) => *v = number,
        Value::Int(v) => *v = number as i32 as i64,
        Value::Uint(v) => *v = number as u32 as u64,
        Value::Enum { number: v, .. } => *v = number as i32,
        Value::Bytes(bytes) => *bytes = repeated(&(number as f32).to_le_bytes(), bytes.len()).into(),
        Value::Packed(packed) => {
            let kind = packed.number();
            let data = match kind {
                Number::F32 => repeated(&(number as f32).to_le_bytes(), packed.len() * 4),
                _ => repeated(&number.to_le_bytes(), packed.len() * 8),
            };
            *packed = Packed::new(if kind == Number::F32 { kind } else { Number::F64 }, false, data.into());
        }
        _ => {}
    }
}

/// The topic with `number` in place of all numbers of its message, or of the one with this index; `None` if it has no
/// message, or one that cannot be written.
fn changed(topic: &Topic, number: f64, only: Option<usize>) -> Option<Topic> {
    let sample = topic.latest.clone()?;
    let mut value = sample.message.value().ok()?;
    let mut index = 0;
    numbers(&mut value, "", &mut |_, value| {
        if only.is_none_or(|only| only == index) {
            replace(value, number);
        }
        index += 1;
    });
    let schema = sample.message.schema();
    let bytes = schema.encode(&value).ok()?;
    Some(topic.clone().with_latest(Sample { message: AnyMessage::encoded(schema, bytes), ..sample }))
}

/// The topics of a frame with `number` in place of all numbers of their messages. Those without a message, or with one
/// that is not protobuf, stay as they are.
fn all_changed(frame: &Frame, number: f64) -> Frame {
    let topics = frame.topics.iter().map(|topic| {
        let is_protobuf = topic.latest.is_some() && topic.schema.descriptor().is_some();
        let changed = changed(topic, number, None);
        assert_eq!(changed.is_some(), is_protobuf, "{} with {number:e} in every field", topic.name);
        changed.unwrap_or_else(|| topic.clone())
    });
    let topics: Vec<Topic> = topics.collect();
    Frame { topics: topics.into(), ..frame.clone() }
}

/// Indices of the numbers of a topic's message: the first and the last with each path, so that every field is among
/// them, and both ends of every list.
fn fields(topic: &Topic) -> Vec<(String, usize)> {
    let Some(Ok(mut value)) = topic.latest.as_ref().map(|sample| sample.message.value()) else {
        return Vec::new();
    };
    let mut places: BTreeMap<String, (usize, usize)> = BTreeMap::new();
    let mut index = 0;
    numbers(&mut value, "", &mut |path, _| {
        places.entry(path.to_owned()).or_insert((index, index)).1 = index;
        index += 1;
    });
    let both = |(path, (first, last)): (String, (usize, usize))| {
        let last = (last != first).then(|| (path.clone(), last));
        std::iter::once((path, first)).chain(last)
    };
    places.into_iter().flat_map(both).collect()
}

fn with_topic(frame: &Frame, index: usize, topic: Topic) -> Frame {
    let mut topics = frame.topics.to_vec();
    topics[index] = topic;
    Frame { topics: topics.into(), ..frame.clone() }
}

/// A view that is shown.
fn shown(kind: &str, frame: &Frame) -> Harness<'static, Shown> {
    let mut harness = harness(Shown::new(kind, frame.clone()), Vec2::new(640.0, 420.0), Theme::Dark);
    harness.step();
    harness
}

/// Shows another frame, and checks the number of vertices and the time.
fn check(kind: &str, harness: &mut Harness<'static, Shown>, frame: &Frame, what: &str) {
    harness.state_mut().frame = frame.clone();
    harness.run_steps(2);
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

/// The texts that a view paints.
fn texts(harness: &Harness<'static, Shown>) -> Vec<String> {
    fn of(shape: &egui::Shape, found: &mut Vec<String>) {
        match shape {
            egui::Shape::Vec(shapes) => shapes.iter().for_each(|shape| of(shape, found)),
            egui::Shape::Text(text) => found.push(text.galley.text().to_owned()),
            _ => {}
        }
    }
    let mut found = Vec::new();
    harness.output().shapes.iter().for_each(|clipped| of(&clipped.shape, &mut found));
    found
}

#[test]
fn every_view_stands_any_number_in_all_fields_at_once() {
    for frame in [samples::full(), samples::driving()] {
        for view_type in all() {
            let mut harness = shown(view_type.kind, &frame);
            for number in VALUES {
                let what = format!("{number:e} in every field");
                check(view_type.kind, &mut harness, &all_changed(&frame, number), &what);
            }
        }
    }
}

/// The name of the view that a process of its own shows.
const VIEW: &str = "OCU_TEST_VIEW";

#[test]
#[ignore = "run for each view by the next test"]
fn one_view_stands_any_number_in_each_field_alone() {
    let Ok(kind) = std::env::var(VIEW) else { return };
    for frame in [samples::full(), samples::driving()] {
        let mut harness = shown(&kind, &frame);
        for (index, topic) in frame.topics.iter().enumerate() {
            // The view of fields shows the selected topic.
            harness.state_mut().selection.topic = Some(crate::TopicKey::of(topic));
            for (field, number) in
                fields(topic).iter().flat_map(|field| VALUES_ALONE.map(|number| (field, number)))
            {
                let what = format!("{number:e} in {} of {}", field.0, topic.name);
                let topic = changed(topic, number, Some(field.1)).unwrap_or_else(|| panic!("{what}"));
                check(&kind, &mut harness, &with_topic(&frame, index, topic), &what);
            }
        }
    }
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).unwrap_or_default();
    let peak = peak.split_whitespace().next().and_then(|kb| kb.parse::<u64>().ok()).unwrap_or(0) * 1024;
    eprintln!("{kind}: {} MB at most", peak >> 20);
    assert!(peak < MOST_BYTES, "{kind}: {peak} bytes");
}

#[test]
fn every_view_stands_any_number_in_each_field_alone_within_its_memory() {
    let program = std::env::current_exe().expect("the program of the tests");
    let shown = |kind: &str| {
        let test = "tests::hostile::one_view_stands_any_number_in_each_field_alone";
        let arguments = ["--ignored", "--exact", "--nocapture", test];
        let output = Command::new(&program).args(arguments).env(VIEW, kind).output().expect("it runs");
        let errors = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{kind}: {errors}");
        assert!(errors.contains(&format!("{kind}: ")), "{kind} was not shown: {errors}");
    };
    // Two at a time, because each of them uses one processor.
    let next = AtomicUsize::new(0);
    let work = || {
        while let Some(view_type) = all().get(next.fetch_add(1, Ordering::Relaxed)) {
            shown(view_type.kind);
        }
    };
    std::thread::scope(|scope| {
        let other = scope.spawn(work);
        work();
        other.join().expect("no view failed");
    });
}

#[test]
fn values_that_cannot_be_have_a_badge_on_the_map_and_on_the_camera() {
    let full = samples::full();
    let at = |frame: &Frame, name: &str| frame.topics.iter().position(|topic| &*topic.name == name).unwrap();
    let said = |kind: &str, frame: &Frame| {
        let mut harness = shown(kind, frame);
        harness.run_steps(2);
        texts(&harness).into_iter().find(|text| text.contains("that cannot be"))
    };
    for (kind, frame) in [("map", &full), ("camera", &full), ("camera", &samples::driving())] {
        assert_eq!(said(kind, frame), None, "{kind}, without such values");
    }
    let cloud = samples::topic("/lidar/points", 10.0, 0.1, samples::cloud(&[[1.0; 3], [f32::MAX, 0.0, 0.0]]));
    let text = said("map", &with_topic(&full, at(&full, "/lidar/points"), cloud)).expect("a badge");
    assert!(text.ends_with("places that cannot be: 1 of /lidar/points"), "{text}");

    let ranges: Vec<u8> = [2.0, f32::MAX, 3.0, f32::NAN].iter().flat_map(|v: &f32| v.to_le_bytes()).collect();
    let ranges = RawImage {
        width: 2,
        height: 2,
        encoding: "32FC1".into(),
        step: 8,
        data: ranges.into(),
        ..RawImage::default()
    };
    let only = Frame { topics: [samples::topic("/depth", 5.0, 0.1, ranges)].into(), ..samples::empty() };
    let text = said("camera", &only).expect("a badge");
    assert!(text.ends_with("values that cannot be: 1 of /depth"), "{text}");

    let driving = samples::driving();
    let shapes = at(&driving, "/color/shapes");
    let (_, field) =
        fields(&driving.topics[shapes]).into_iter().find(|it| it.0 == ".points[].points[].x").unwrap();
    let far = changed(&driving.topics[shapes], 1e30, Some(field)).unwrap();
    let text = said("camera", &with_topic(&driving, shapes, far)).expect("a badge");
    assert!(text.ends_with("values that cannot be: 1 of /color/shapes"), "{text}");
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
        let tracks = frame.tracks.iter().map(|track| {
            let mut points = Vec::new();
            track.points.each(0..track.points.len(), |point| points.push(*point));
            for point in points.iter_mut().skip(3).step_by(7) {
                (point.position_m, point.yaw_rad) = ([number, point.position_m[1], number], number);
            }
            Track { points: points.into_iter().collect(), ..track.clone() }
        });
        frame.tracks = tracks.collect();
        for view_type in all() {
            let mut harness = shown(view_type.kind, &frame);
            check(view_type.kind, &mut harness, &frame, &format!("places at {number:e}"));
        }
    }
}
