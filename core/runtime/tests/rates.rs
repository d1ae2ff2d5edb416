//! The rates of topics that a recording shows at a moment.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod common;

use common::{seconds, write_log};
use rcs_runtime::source::{LogSource, Source, Task};

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
    let mean = 200.0 / 59.0;
    assert!((rate(55.0, "/silent") - mean).abs() < 0.5, "nothing came lately: the mean");
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
