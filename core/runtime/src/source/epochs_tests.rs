//! Tests of recordings whose clock begins again.

use super::*;
use crate::source::tracks::tests::{S, T0, UPRIGHT, pose, transform};
use foxglove::Odometry;

/// Log time, topic, message.
type Sent = (u64, &'static str, AnyMessage);

fn odometry(stamp_ns: u64, x: f64) -> AnyMessage {
    AnyMessage::new(Odometry {
        timestamp: Some(Stamp(stamp_ns).to_proto()),
        frame_id: "odom".into(),
        body_frame_id: "base".into(),
        pose: Some(pose(x, UPRIGHT)),
        ..Odometry::default()
    })
}

/// A simulation of 20 s, and another one 25 s later that begins at x = 100. Odometry comes a little before the transform.
fn restarted() -> Vec<Sent> {
    let mut all = vec![(T0, "/tf_static", transform("base", "laser", 0, 0.5))];
    for (run, i) in [0, 1].into_iter().flat_map(|run| (0..20).map(move |i| (run, i))) {
        let (log_ns, stamp_ns, x) = (T0 + (25 * run + i) * S, i * S, (100 * run + i) as f64);
        all.push((log_ns - 1000, "/odom", odometry(stamp_ns, x)));
        all.push((log_ns, "/tf", transform("odom", "base", stamp_ns, x)));
    }
    all
}

fn epochs(mut messages: Vec<Sent>) -> Epochs {
    messages.sort_by_key(|(log_ns, ..)| *log_ns);
    let mut epochs = Epochs::new(Stamp(T0));
    for (log_ns, topic, message) in messages {
        epochs.add(&topic.into(), Stamp(log_ns), &message, topic == "/tf_static");
    }
    epochs.share();
    epochs
}

/// Where a frame is in another one at so many seconds of the log, rounded to millimetres; `None` if it is not connected.
fn x_at(epochs: &Epochs, target: &str, source: &str, log_s: u64) -> Option<f64> {
    let log_time = Stamp(T0 + log_s * S);
    let stamp = epochs.clock(log_time).at(log_time);
    let pose = epochs.tree(log_time).lookup_nearest(target, source, stamp.0).ok()?;
    Some((pose.translation.x * 1e3).round() / 1e3)
}

#[test]
fn a_moment_has_the_transforms_and_tracks_of_its_own_run_of_the_clock() {
    let epochs = epochs(restarted());
    for (log_s, x) in [(10, 10.0), (35, 110.0), (10, 10.0), (24, 19.0), (25, 101.0), (50, 119.0), (0, 1.0)] {
        assert_eq!(x_at(&epochs, "odom", "base", log_s), Some(x), "{log_s} s");
        assert_eq!(x_at(&epochs, "base", "laser", log_s), Some(0.5), "static: {log_s} s");
        let tracks: Vec<Track> = epochs.tracks(RunTag::Recorded, Stamp(T0 + log_s * S)).collect();
        let points = &tracks[0].points;
        let ends = [points.get(0).unwrap(), points.last().unwrap()].map(|point| point.position_m[0]);
        let expected = if log_s < 25 { [0.0, 19.0] } else { [100.0, 119.0] };
        assert_eq!((tracks.len(), points.len(), ends), (1, 20, expected), "{log_s} s");
    }
    // A message of the run before is placed where the run begins, not by its stamp.
    let clock = epochs.clock(Stamp(T0 + 40 * S));
    assert!(
        clock.covers(Stamp(15 * S), Stamp(T0 + 40 * S)) && !clock.covers(Stamp(15 * S), Stamp(T0 + 15 * S))
    );
    assert_eq!(clock.at(Stamp(T0 + 15 * S)), Stamp(0));
    let doubt = "the clock of the transforms goes back by 18.0 s at 25.0 s (base on /tf): \
        transforms and tracks before and after it are kept apart";
    assert_eq!(epochs.doubts(), [doubt]);
}

#[test]
fn stamps_out_of_order_and_clocks_that_move_no_frame_begin_nothing() {
    let disordered = (0..60).map(|i| if i % 3 == 0 { (i, i + 4) } else { (i, i) });
    let mut messages: Vec<Sent> = disordered
        .map(|(i, stamp_s)| (T0 + i * S, "/tf", transform("odom", "base", 100 * S + stamp_s * S, 0.0)))
        .collect();
    messages.extend((0..60).map(|i| (T0 + i * S + 1, "/odom", odometry((1 + i % 20) * S, 0.0))));
    messages.extend(
        (0..60).map(|i| (T0 + i * S + 2, "/tf_static", transform("base", "laser", (1 + i % 20) * S, 0.5))),
    );
    let epochs = epochs(messages);
    assert!(epochs.past.is_empty() && epochs.doubts().is_empty(), "{:?}", epochs.doubts());
}

#[test]
fn two_clocks_on_one_topic_do_not_begin_again_and_again() {
    let stamp_s = |i: u64| if i.is_multiple_of(10) { 1000 + i } else { 1 + i };
    let messages = (0..100).map(|i| (T0 + i * S, "/tf", transform("odom", "base", stamp_s(i) * S, 0.0)));
    assert_eq!(epochs(messages.collect()).past.len(), 1);
}

#[test]
fn what_still_comes_of_the_run_before_is_forgotten() {
    let mut messages = restarted();
    for (run, i) in [0, 1].into_iter().flat_map(|run| (0..40).map(move |i| (run, i))) {
        let log_ns = T0 + 25 * run * S + i * S / 2 + 500;
        // It hears of the new time a second late.
        let stamp_ns = if run == 1 && i < 4 { 25 * S + i * S / 2 } else { i * S / 2 };
        messages.push((log_ns, "/joints", transform("base", "arm", stamp_ns, run as f64)));
    }
    let epochs = epochs(messages);
    assert_eq!(epochs.past.len(), 1, "the arm begins no run of its own");
    let tree = epochs.tree(Stamp(T0 + 40 * S));
    assert_eq!(tree.newest("base", "arm").unwrap(), Some(19 * S + S / 2));
}

#[test]
fn a_transform_that_was_sent_once_holds_in_every_run_of_the_clock_and_one_that_moves_only_in_its_own() {
    let mut messages = restarted();
    messages.push((T0 + 3 * S, "/tf", transform("map", "odom", 3 * S, 1000.0)));
    messages.push((T0 + 30 * S, "/tf", transform("base", "camera", 5 * S, 2.0)));
    messages.extend((1..20).map(|i| (T0 + i * S, "/tf", transform("base", "arm", i * S, i as f64))));
    let epochs = epochs(messages);
    let seen = |log_s| {
        [("map", "base"), ("base", "camera"), ("base", "arm")]
            .map(|(target, source)| x_at(&epochs, target, source, log_s))
    };
    assert_eq!(seen(10), [Some(1010.0), Some(2.0), Some(10.0)]);
    assert_eq!(seen(35), [Some(1110.0), Some(2.0), None]);
}

#[test]
fn a_frame_that_comes_later_in_a_run_of_the_clock_begins_no_other_one() {
    let mut messages = restarted();
    for (run, i) in [0, 1].into_iter().flat_map(|run| (10..20).map(move |i| (run, i))) {
        messages.push((T0 + (25 * run + i) * S, "/tf", transform("map", "odom", i * S, 1000.0)));
    }
    // It is sent rarely, and hears of the new time late.
    messages.push((T0 + 26 * S + 500, "/joints", transform("base", "arm", 26 * S, 1.0)));
    messages.push((T0 + 33 * S + 500, "/joints", transform("base", "arm", 8 * S, 1.0)));
    assert_eq!(epochs(messages).past.len(), 1);
}

#[test]
fn stamps_that_are_too_far_ahead_begin_nothing_and_hide_no_new_run() {
    let mut messages = restarted();
    messages.push((T0 + 5 * S + S / 2, "/tf", transform("odom", "base", 3600 * S, 0.0)));
    let ahead_once = epochs(messages);
    assert_eq!((ahead_once.past.len(), ahead_once.doubts().len()), (1, 1));
    assert!(ahead_once.doubts()[0].contains("at 25.0 s"), "{:?}", ahead_once.doubts());
    // A node without simulated time is started later than one that has it.
    let tf = |log_ns: u64, stamp_ns: u64| (log_ns, "/tf", transform("odom", "base", stamp_ns, 0.0));
    let simulated = (0..100).map(|i| tf(T0 + i * S, (1 + i) * S));
    let of_wall = (50..100).map(|i| T0 + i * S + S / 2).map(|ns| tf(ns, ns));
    assert!(epochs(simulated.chain(of_wall).collect()).past.is_empty());
}

#[test]
fn a_transform_that_was_sent_once_does_not_hold_after_a_run_that_moves_its_frame() {
    let mut messages = Vec::new();
    for (run, i) in (0..3).flat_map(|run| (1..20).map(move |i| (run, i))) {
        let log_ns = T0 + (25 * run + i) * S;
        messages.push((log_ns, "/tf", transform("odom", "base", i * S, 0.0)));
        if run == 1 || (run == 0 && i == 3) {
            messages.push((log_ns, "/tf", transform("base", "arm", i * S, i as f64)));
        }
    }
    let epochs = epochs(messages);
    let arm = [10, 35, 60].map(|log_s| x_at(&epochs, "base", "arm", log_s));
    assert_eq!((epochs.past.len(), arm), (2, [Some(3.0), Some(10.0), None]));
}
