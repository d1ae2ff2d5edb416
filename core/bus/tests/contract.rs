//! The contract of a buffer: one test per NML mode, and a simple reference model of a queue that must agree with it.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use proptest::prelude::*;
use rcs_bus::{
    Buffer, BufferSpec, Draft, Due, Mode, Overflow, Override, OverrideMode, OverrideValue, Release, Scalar,
    WriteError, WriterId,
};
use rcs_msg::{AnyMessage, Stamp, foxglove, rcs, schema_of};
use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Mutex};

fn buffer(mode: Mode) -> Arc<Buffer> {
    Buffer::new(BufferSpec {
        name: "/test".to_owned(),
        schema: Arc::clone(schema_of::<foxglove::Vector3>()),
        mode,
        metadata: BTreeMap::new(),
    })
}

fn queue(depth: usize, overflow: Overflow) -> Mode {
    Mode::Queue { depth, overflow }
}

fn draft(x: f64) -> Draft {
    let message = AnyMessage::new(foxglove::Vector3 { x, y: 0.0, z: 0.0 });
    Draft { log_time: Stamp(1), acq_time: Stamp(1), message }
}

fn x(sample: &rcs_bus::Sample) -> f64 {
    sample.message.get::<foxglove::Vector3>().unwrap().x
}

#[test]
fn a_latest_only_buffer_gives_each_reader_the_newest_once() {
    let buffer = buffer(Mode::Latest);
    let writer = buffer.writer(WriterId::RUNTIME);
    let (mut a, mut b) = (buffer.reader(), buffer.reader());
    assert!(a.read().is_none());
    for i in 1..=3 {
        assert_eq!(writer.write(draft(f64::from(i))).unwrap(), i as u64);
    }
    let mut fresh = Vec::new();
    assert_eq!(a.drain_into(&mut fresh), 2, "two were replaced before they were read");
    assert_eq!(fresh.iter().map(x).collect::<Vec<_>>(), [3.0]);
    assert!(a.read().is_none(), "read once");
    assert_eq!(x(&b.read().unwrap()), 3.0, "no reader takes from another");
    assert_eq!(x(&buffer.latest().unwrap()), 3.0, "the newest stays to be looked at");
}

#[test]
fn a_late_reader_sees_the_newest_message() {
    let buffer = buffer(queue(4, Overflow::DropOldest));
    let writer = buffer.writer(WriterId::RUNTIME);
    for i in 0..3 {
        writer.write(draft(f64::from(i))).unwrap();
    }
    let mut late = buffer.reader();
    assert_eq!(x(&late.read().unwrap()), 2.0);
    assert!(late.read().is_none());
}

#[test]
fn a_queue_that_drops_tells_how_many_a_reader_missed() {
    let buffer = buffer(queue(2, Overflow::DropOldest));
    let mut reader = buffer.reader();
    let writer = buffer.writer(WriterId::RUNTIME);
    for i in 0..5 {
        writer.write(draft(f64::from(i))).unwrap();
    }
    let mut fresh = Vec::new();
    assert_eq!(reader.drain_into(&mut fresh), 3);
    assert_eq!(fresh.iter().map(x).collect::<Vec<_>>(), [3.0, 4.0]);
}

#[test]
fn a_queue_that_grows_drops_nothing_before_its_slowest_reader_has_read_it() {
    let buffer = buffer(queue(2, Overflow::Grow));
    let (mut fast, mut slow) = (buffer.reader(), buffer.reader());
    let writer = buffer.writer(WriterId::OPERATOR);
    for i in 0..100 {
        writer.write(draft(f64::from(i))).unwrap();
        fast.read().unwrap();
    }
    let mut fresh = Vec::new();
    assert_eq!(slow.drain_into(&mut fresh), 0);
    assert!(fresh.iter().map(x).eq((0..100).map(f64::from)));
    writer.write(draft(100.0)).unwrap();
    assert_eq!(buffer.save().ring.len(), 1, "what all have read goes, but for what no one has read yet");
    assert_eq!(x(&slow.read().unwrap()), 100.0);
}

#[test]
fn a_queue_that_refuses_waits_for_its_slowest_reader() {
    let buffer = buffer(queue(2, Overflow::Refuse));
    let mut fast = buffer.reader();
    let mut slow = buffer.reader();
    let writer = buffer.writer(WriterId::RUNTIME);
    writer.write(draft(0.0)).unwrap();
    writer.write(draft(1.0)).unwrap();
    fast.read().unwrap();
    fast.read().unwrap();
    assert!(matches!(writer.write(draft(2.0)), Err(WriteError::Full { depth: 2, .. })));
    assert_eq!(x(&slow.read().unwrap()), 0.0);
    writer.write(draft(2.0)).unwrap();
    writer.write(draft(3.0)).unwrap_err();
    drop(slow);
    writer.write(draft(3.0)).unwrap();
    writer.write(draft(4.0)).unwrap_err();
    assert_eq!(x(&fast.read().unwrap()), 2.0);
    writer.write(draft(4.0)).unwrap();
}

#[test]
fn a_message_of_another_type_is_refused_with_both_names() {
    let buffer = buffer(Mode::Latest);
    let message = AnyMessage::new(rcs::Command::default());
    let error = buffer
        .writer(WriterId::OPERATOR)
        .write(Draft { log_time: Stamp(0), acq_time: Stamp(0), message })
        .unwrap_err();
    assert_eq!(error.to_string(), "a rcs.Command was written to /test, which holds foxglove.Vector3");
}

#[test]
fn readers_share_the_writers_allocation() {
    let buffer = buffer(Mode::Latest);
    let (mut a, mut b) = (buffer.reader(), buffer.reader());
    let draft = draft(1.0);
    let written = draft.message.clone();
    buffer.writer(WriterId::RUNTIME).write(draft).unwrap();
    assert!(a.read().unwrap().message.same(&written));
    assert!(b.read().unwrap().message.same(&written));
}

#[test]
fn a_tap_sees_every_message_in_order() {
    let buffer = buffer(Mode::Latest);
    let seen = Arc::new(Mutex::new(Vec::new()));
    let theirs = Arc::clone(&seen);
    buffer.tap(Box::new(move |sample| theirs.lock().unwrap().push(sample.header.sequence)));
    let writers: Vec<_> = (0..4).map(|_| buffer.writer(WriterId::RUNTIME)).collect();
    std::thread::scope(|scope| {
        for writer in writers {
            scope.spawn(move || (0..250).for_each(|_| _ = writer.write(draft(0.0)).unwrap()));
        }
    });
    assert_eq!(*seen.lock().unwrap(), (1..=1000).collect::<Vec<u64>>());
}

/// An override of `.y`, or of another field.
fn hold(id: u64, mode: OverrideMode, path: &str, value: f64) -> Override {
    Override {
        id,
        owner: "tester".into(),
        mode,
        value: OverrideValue::Field(path.parse().unwrap(), Scalar::Float(value)),
        since: Stamp(0),
        until: None,
        due: None,
    }
}

/// Writes x and returns the resulting x and y.
fn written(buffer: &Arc<Buffer>, x: f64, at: u64) -> (f64, f64) {
    let draft = Draft { log_time: Stamp(at), ..draft(x) };
    buffer.writer(WriterId::RUNTIME).write(draft).unwrap();
    let sample = buffer.latest().unwrap();
    let vector = sample.message.get::<foxglove::Vector3>().unwrap();
    (vector.x, vector.y)
}

#[test]
fn an_override_replaces_a_field_until_it_is_released() {
    let buffer = buffer(Mode::Latest);
    buffer.set_override(hold(1, OverrideMode::Hold, ".y", 5.0));
    assert_eq!(written(&buffer, 1.0, 1), (1.0, 5.0));
    buffer.set_override(hold(2, OverrideMode::Hold, ".y", 6.0));
    assert_eq!(written(&buffer, 2.0, 1), (2.0, 6.0));
    assert_eq!(buffer.release_overrides(&Release::Path(".y".parse().unwrap())), 1);
    assert_eq!(written(&buffer, 3.0, 1), (3.0, 0.0));
    buffer.set_override(hold(3, OverrideMode::Once, ".y", 7.0));
    assert_eq!(written(&buffer, 4.0, 1), (4.0, 7.0));
    assert_eq!(written(&buffer, 5.0, 1), (5.0, 0.0));
    buffer.set_override(hold(4, OverrideMode::Hold, ".x", 1.0));
    buffer.set_override(hold(5, OverrideMode::Hold, ".y", 2.0));
    assert_eq!(buffer.release_overrides(&Release::Id(4)), 1);
    assert_eq!(written(&buffer, 6.0, 1), (6.0, 2.0));
    assert_eq!(buffer.release_overrides(&Release::All), 1);
    assert_eq!(written(&buffer, 7.0, 1), (7.0, 0.0));
}

#[test]
fn an_override_that_does_not_fit_is_dropped_and_the_message_passes() {
    let buffer = buffer(Mode::Latest);
    buffer.set_override(hold(1, OverrideMode::Hold, ".nothing", 1.0));
    buffer.set_override(hold(2, OverrideMode::Hold, ".y", 2.0));
    assert_eq!(written(&buffer, 1.0, 1), (1.0, 2.0), "the other one still applies");
    let tended = buffer.update_overrides(Stamp(1), |_| false);
    assert!(tended.changed);
    let [(failed, reason)] = tended.failed.as_slice() else { panic!("{:?}", tended.failed) };
    assert!(failed.id == 1 && reason.contains("nothing"), "{reason}");
    assert_eq!(tended.active.iter().map(|active| active.id).collect::<Vec<_>>(), [2]);
    let again = buffer.update_overrides(Stamp(1), |_| false);
    assert!(!again.changed && again.failed.is_empty(), "it is told once");
}

#[test]
fn an_override_ends_at_its_time_and_begins_at_its_cycle() {
    let buffer = buffer(Mode::Latest);
    buffer.set_override(Override { until: Some(Stamp(10)), ..hold(1, OverrideMode::Hold, ".y", 1.0) });
    assert_eq!(written(&buffer, 0.0, 9).1, 1.0);
    assert_eq!(written(&buffer, 0.0, 10).1, 0.0);
    assert!(buffer.update_overrides(Stamp(10), |_| false).active.is_empty());
    let due = Some(Due { process: "p".to_owned(), cycle: 3 });
    buffer.set_override(Override { due, ..hold(2, OverrideMode::Hold, ".y", 2.0) });
    let at_cycle = |cycle: u64| buffer.update_overrides(Stamp(11), |due| due.cycle <= cycle);
    at_cycle(2);
    assert_eq!(written(&buffer, 0.0, 12).1, 0.0);
    assert!(at_cycle(3).changed);
    assert_eq!(written(&buffer, 0.0, 13).1, 2.0);
}

#[test]
fn an_override_of_a_saved_buffer_is_the_same_from_bytes() {
    let whole = AnyMessage::new(foxglove::Vector3 { x: 9.0, ..Default::default() });
    let value = OverrideValue::Message(whole);
    for change in
        [hold(1, OverrideMode::Hold, ".y", 5.0), Override { value, ..hold(2, OverrideMode::Hold, ".y", 0.0) }]
    {
        let bytes = serde_json::to_vec(&change).unwrap();
        let read: Override = serde_json::from_slice(&bytes).unwrap();
        assert_eq!((read.id, read.path(), &*read.owner), (change.id, change.path(), "tester"));
        let (one, other) = (buffer(Mode::Latest), buffer(Mode::Latest));
        one.set_override(change);
        other.set_override(read);
        assert_eq!(written(&one, 1.0, 1), written(&other, 1.0, 1));
    }
}

/// An operation of a test on a queue.
#[derive(Clone, Debug)]
enum Act {
    Write,
    Read(usize),
    SaveAndRestore,
}

fn overflow() -> impl Strategy<Value = Overflow> {
    prop_oneof![Just(Overflow::DropOldest), Just(Overflow::Refuse), Just(Overflow::Grow)]
}

fn acts() -> impl Strategy<Value = Vec<Act>> {
    let act = prop_oneof![
        3 => Just(Act::Write),
        3 => (0..3_usize).prop_map(Act::Read),
        1 => Just(Act::SaveAndRestore),
    ];
    prop::collection::vec(act, 0..200)
}

#[test]
fn what_every_reader_has_read_is_not_kept_but_for_the_newest() {
    let buffer = buffer(queue(8, Overflow::DropOldest));
    let writer = buffer.writer(WriterId::RUNTIME);
    for i in 0..3 {
        writer.write(draft(f64::from(i))).unwrap();
    }
    assert_eq!(buffer.save().ring.len(), 1, "no one reads it");
    let (mut fast, mut slow) = (buffer.reader(), buffer.reader());
    for i in 3..7 {
        writer.write(draft(f64::from(i))).unwrap();
        while fast.read().is_some() {}
    }
    assert_eq!(buffer.save().ring.len(), 5, "the slow reader has still to read them");
    for i in 2..7 {
        assert_eq!(x(&slow.read().unwrap()), f64::from(i));
    }
    assert_eq!(buffer.save().ring.len(), 1);
    assert_eq!(x(&buffer.reader().read().unwrap()), 6.0, "a reader that joins sees the newest");
}

#[test]
fn restoring_after_readers_have_joined_and_gone_keeps_those_that_are_there() {
    let buffer = buffer(queue(4, Overflow::DropOldest));
    let writer = buffer.writer(WriterId::RUNTIME);
    let gone = buffer.reader();
    writer.write(draft(1.0)).unwrap();
    let state = buffer.save();
    drop(gone);
    let mut readers = [buffer.reader(), buffer.reader(), buffer.reader()];
    writer.write(draft(2.0)).unwrap();
    buffer.restore(&state);
    for reader in &mut readers {
        assert_eq!(reader.read().map(|sample| x(&sample)), Some(1.0));
        assert!(reader.read().is_none());
    }
    drop(readers);
    let mut late = buffer.reader();
    writer.write(draft(3.0)).unwrap();
    assert_eq!((x(&late.read().unwrap()), x(&late.read().unwrap())), (1.0, 3.0));
}

#[test]
fn a_tap_that_sees_once_sees_nothing_of_a_past_that_is_run_again() {
    let buffer = buffer(Mode::Latest);
    let writer = buffer.writer(WriterId::RUNTIME);
    let seen: Arc<Mutex<Vec<f64>>> = Arc::default();
    let theirs = Arc::clone(&seen);
    buffer.tap_once(Box::new(move |sample| theirs.lock().unwrap().push(x(sample))));
    writer.write(draft(1.0)).unwrap();
    let state = buffer.save();
    writer.write(draft(2.0)).unwrap();
    buffer.restore(&state);
    writer.write(draft(2.0)).unwrap();
    writer.write(draft(3.0)).unwrap();
    assert_eq!(*seen.lock().unwrap(), [1.0, 2.0, 3.0]);
    buffer.restore(&state);
    buffer.begin_anew();
    writer.write(draft(4.0)).unwrap();
    assert_eq!(*seen.lock().unwrap(), [1.0, 2.0, 3.0, 4.0], "another run is new");
}

proptest! {
    /// Reference: a queue equals one list per reader, truncated to the depth; saving and restoring changes nothing.
    #[test]
    fn a_queue_is_a_list_for_each_reader(depth in 1..5_usize, overflow in overflow(), acts in acts()) {
        let buffer = buffer(queue(depth, overflow));
        let writer = buffer.writer(WriterId::RUNTIME);
        let mut readers = [buffer.reader(), buffer.reader(), buffer.reader()];
        let mut reference_kept: VecDeque<u64> = VecDeque::new();
        let mut reference_unread: [VecDeque<u64>; 3] = Default::default();
        let mut next = 1;
        for act in acts {
            match act {
                Act::Write => {
                    let oldest = reference_kept.front().copied().filter(|_| reference_kept.len() >= depth);
                    let full = oldest.is_some_and(|oldest| reference_unread.iter().any(|list| list.contains(&oldest)));
                    let written = writer.write(draft(next as f64));
                    prop_assert_eq!(written.is_err(), overflow == Overflow::Refuse && full);
                    if overflow == Overflow::Grow {
                        let is_read = |n: u64| !reference_unread.iter().any(|list| list.contains(&n));
                        while reference_kept.len() >= depth && is_read(reference_kept[0]) {
                            reference_kept.pop_front();
                        }
                    }
                    if written.is_ok() {
                        if let Some(oldest) = oldest && overflow != Overflow::Grow {
                            reference_kept.pop_front();
                            for list in &mut reference_unread {
                                list.retain(|&n| n != oldest);
                            }
                        }
                        reference_kept.push_back(next);
                        for list in &mut reference_unread {
                            list.push_back(next);
                        }
                        next += 1;
                    }
                }
                Act::Read(i) => {
                    let got = readers[i].read().map(|sample| sample.header.sequence);
                    prop_assert_eq!(got, reference_unread[i].pop_front());
                }
                Act::SaveAndRestore => {
                    let state = buffer.save();
                    writer.write(draft(0.0)).ok();
                    readers[0].read();
                    buffer.restore(&state);
                }
            }
        }
    }
}
