//! The rates of topics that a recording shows at a moment.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod common;

use common::{seconds, write_log};
use rcs_log::{Log, LogWriter, WriteHeader, WriterOptions};
use rcs_msg::{Schema, Stamp, foxglove, rcs, schema_of};
use rcs_runtime::source::{LogSource, RunTag, Source, Task, Topic};
use rcs_testkit::logs::SharedSink;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// A recording of a topic with 20 Hz for ten seconds and then 1 Hz, and of another one that stops then.
fn slower_and_silent() -> (LogSource, tempfile::TempDir) {
    let often = (0..200).map(|i| f64::from(i) * 0.05);
    let seldom = (10..60).map(f64::from);
    let slower = often.clone().chain(seldom).map(|time| (time, "/slower", 0.0));
    let mut messages: Vec<_> = slower.chain(often.map(|time| (time, "/silent", 0.0))).collect();
    messages.sort_by(|a, b| a.0.total_cmp(&b.0));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.mcap");
    write_log(&path, &messages);
    (LogSource::open(&path).unwrap(), folder)
}

/// The rate that a topic shows at a time.
fn rate_hz(source: &mut LogSource, at_s: f64, topic: &str) -> f64 {
    source.seek(seconds(at_s), &Task::default()).unwrap();
    source.frame().topic(topic).unwrap().hz.unwrap()
}

#[test]
fn after_a_jump_a_topic_shows_the_rate_of_the_seconds_before_not_the_mean_of_the_log() {
    let (mut source, _folder) = slower_and_silent();
    let mut rate = |at_s: f64, topic: &str| rate_hz(&mut source, at_s, topic);
    assert!((rate(40.0, "/slower") - 1.0).abs() < 0.01);
    assert!((rate(6.0, "/slower") - 20.0).abs() < 0.5);
    assert!((rate(50.0, "/slower") - 1.0).abs() < 0.01);
    assert!((rate(55.0, "/silent") - 20.0).abs() < 0.5, "the rate of its last seconds");
}

/// The rates at a time after a jump from the end, and after reading on from the start in steps of a second.
fn rates_both_ways(path: &Path, at_s: u32, topic: &str) -> [f64; 2] {
    let [mut jumps, mut reads_on] = [(); 2].map(|()| LogSource::open(path).unwrap());
    jumps.seek(Stamp::MAX, &Task::default()).unwrap();
    for second in 0..at_s {
        reads_on.seek(seconds(f64::from(second)), &Task::default()).unwrap();
    }
    [&mut jumps, &mut reads_on].map(|source| rate_hz(source, f64::from(at_s), topic))
}

#[test]
fn a_topic_that_falls_silent_early_in_a_long_recording_keeps_its_rate() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.mcap");
    let scans = (0..50).map(|i| (f64::from(i) * 0.1, "/scan", 0.0));
    // Two publishers at the start, of what holds for all of the recording.
    let maps = [(0.0, "/map", 0.0), (0.5, "/map", 0.0)];
    // Two messages later on.
    let goals = [(3.0, "/goal", 0.0), (3.5, "/goal", 0.0)];
    let mut messages: Vec<_> = scans.chain(maps).chain(goals).collect();
    messages.extend((0..600).map(|i| (f64::from(i), "/clock", 0.0)));
    messages.sort_by(|a, b| a.0.total_cmp(&b.0));
    write_log(&path, &messages);
    for at_s in [8, 20, 35, 500] {
        let [jumped, on] = rates_both_ways(&path, at_s, "/scan");
        assert!((jumped - 10.0).abs() < 0.01, "at {at_s} s: {jumped} Hz");
        assert_eq!(jumped, on, "at {at_s} s");
    }
    let [jumped, on] = rates_both_ways(&path, 20, "/map");
    assert!((jumped - 2.0).abs() < 1e-9 && jumped == on, "{jumped} and {on} Hz");
    // Their age is judged by a lower rate, and what was sent in the first second alone does not become old.
    let mut source = LogSource::open(&path).unwrap();
    source.seek(seconds(20.0), &Task::default()).unwrap();
    let due_hz = |topic: &str| source.frame().topic(topic).unwrap().due_hz().unwrap();
    let [map_hz, goal_hz] = ["/map", "/goal"].map(due_hz);
    assert_eq!(map_hz, 0.0);
    assert!((goal_hz - 2.0 / 599.0).abs() < 1e-9, "{goal_hz}");
}

#[test]
fn of_what_stays_in_force_no_message_is_due() {
    let due_hz = |schema: &Arc<Schema>, writer: &str| {
        let mut topic = Topic::new("/a", RunTag::FIRST, Arc::clone(schema));
        (topic.hz, topic.writer) = (Some(0.5), writer.into());
        topic.due_hz()
    };
    for (schema, writer) in [
        (schema_of::<rcs::RunInfo>(), "runtime"),
        (schema_of::<rcs::ProcessInfo>(), "runtime"),
        (schema_of::<rcs::JournalEvent>(), "runtime"),
        (schema_of::<rcs::Command>(), "planner"),
        (schema_of::<rcs::EmergencyStop>(), ""),
        // Parameters of a process.
        (schema_of::<rcs::SpeedLimit>(), "operator"),
    ] {
        assert_eq!(due_hz(schema, writer), None, "{}", schema.name());
    }
    assert_eq!(due_hz(schema_of::<rcs::Status>(), "planner"), Some(0.5));
    assert_eq!(due_hz(schema_of::<rcs::DriveCommand>(), ""), Some(0.5), "an old one is not obeyed");
}

#[test]
fn a_short_topic_has_one_rate_at_its_start_and_its_end_whatever_the_chunks() {
    for chunk_bytes in [1000, 1 << 20] {
        let sink = SharedSink::default();
        let options = WriterOptions { chunk_bytes, ..WriterOptions::default() };
        let mut writer = LogWriter::with_sink(Box::new(sink.clone()), "memory".into(), options).unwrap();
        let schema = schema_of::<foxglove::Vector3>();
        let image = writer.add_channel("/image", schema, &BTreeMap::new()).unwrap();
        for (sequence, at_s) in (0..).zip([0.0, 0.1, 0.2, 0.3, 0.6, 0.895]) {
            let log_time = seconds(at_s);
            let header = WriteHeader { sequence, log_time, publish_time: log_time };
            writer.write(image, header, &[b' '; 2000]).unwrap();
        }
        writer.finish().unwrap();
        let log = Log::from_bytes(sink.snapshot().into()).unwrap();
        let mut source = LogSource::new(&log).unwrap();
        for at_s in [0.0, 0.895] {
            source.seek(Stamp::MAX, &Task::default()).unwrap();
            let hz = rate_hz(&mut source, at_s, "/image");
            assert!((hz - 5.0 / 0.895).abs() < 1e-6, "at {at_s} s: {hz} Hz");
        }
    }
}

#[test]
fn the_last_messages_of_a_topic_are_found_behind_many_large_ones_of_another() {
    let sink = SharedSink::default();
    // Images fill a chunk each.
    let options = WriterOptions { chunk_bytes: 1000, ..WriterOptions::default() };
    let mut writer = LogWriter::with_sink(Box::new(sink.clone()), "memory".into(), options).unwrap();
    let [scan, image] = ["/scan", "/image"]
        .map(|topic| writer.add_channel(topic, schema_of::<foxglove::Vector3>(), &BTreeMap::new()).unwrap());
    for index in 0..1000_u32 {
        let log_time = seconds(f64::from(index) * 0.01);
        let header = WriteHeader { sequence: index, log_time, publish_time: log_time };
        writer.write(image, header, &[b' '; 2000]).unwrap();
        if index % 10 == 0 && index < 500 {
            writer.write(scan, header, &[]).unwrap();
        }
    }
    writer.finish().unwrap();
    let log = Log::from_bytes(sink.snapshot().into()).unwrap();
    let [mut jumps, mut reads_on] = [(); 2].map(|()| LogSource::new(&log).unwrap());
    for tenth in 0..90_u32 {
        let at_s = f64::from(tenth) * 0.1 + 0.35;
        jumps.seek(Stamp::MAX, &Task::default()).unwrap();
        let [jumped, on] = [&mut jumps, &mut reads_on].map(|source| rate_hz(source, at_s, "/scan"));
        assert!((jumped - 10.0).abs() < 0.01, "at {at_s} s: {jumped} Hz");
        assert_eq!(jumped, on, "at {at_s} s");
    }
}

#[test]
fn topics_with_a_single_message_in_chunks_of_their_own_have_no_rate_after_a_jump() {
    let sink = SharedSink::default();
    let options = WriterOptions { chunk_bytes: 1000, ..WriterOptions::default() };
    let mut writer = LogWriter::with_sink(Box::new(sink.clone()), "memory".into(), options).unwrap();
    for index in 0..200_u32 {
        let (topic, schema) = (format!("/latched/{index}"), schema_of::<foxglove::Vector3>());
        let channel = writer.add_channel(&topic, schema, &BTreeMap::new()).unwrap();
        let log_time = seconds(f64::from(index) * 0.1);
        let header = WriteHeader { sequence: index, log_time, publish_time: log_time };
        writer.write(channel, header, &[b' '; 2000]).unwrap();
    }
    writer.finish().unwrap();
    let mut source = LogSource::new(&Log::from_bytes(sink.snapshot().into()).unwrap()).unwrap();
    source.seek(Stamp::MAX, &Task::default()).unwrap();
    let frame = source.frame();
    assert_eq!(frame.topics.len(), 200);
    assert!(frame.topics.iter().all(|topic| topic.latest.is_some() && topic.hz.is_none()));
}

#[test]
fn a_moment_has_the_same_rates_after_reading_on_to_it_as_after_a_jump() {
    let (mut reads_on, _folder) = slower_and_silent();
    let (mut jumps, _folder) = slower_and_silent();
    for at_s in (0..26).map(|step| f64::from(step) * 0.6) {
        for topic in ["/slower", "/silent"] {
            jumps.seek(seconds(59.0), &Task::default()).unwrap();
            let [on, jumped] = [&mut reads_on, &mut jumps].map(|source| rate_hz(source, at_s, topic));
            assert!((on - jumped).abs() < 1e-9, "{topic} at {at_s} s: {on} and {jumped} Hz");
        }
    }
}
