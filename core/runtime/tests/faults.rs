//! Faults on demand: each begins and ends as an event of the journal, is listed while it lasts, and is repeated.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod common;

use common::{PAIR, PLUGINS, newest, plan, seconds, stepped};
use rcs_log::Log;
use rcs_msg::rcs::fault::Kind;
use rcs_msg::{AnyMessage, foxglove, rcs};
use rcs_runtime::source::{Frame, Source, StackSource, Task, Topic, finish_idle};
use rcs_runtime::{
    ExternalEvent, Happened, Live, LiveOptions, PastOptions, RecordOptions, RecordedRun, Recording, Replay,
    RunOptions, Snapshot, Stepped,
};
use std::time::Duration;

/// A fault of a buffer if the name begins with `/`, else of a process.
fn fault(target: &str, kind: Kind) -> rcs::Override {
    let (buffer, process) = if target.starts_with('/') { (target, "") } else { ("", target) };
    rcs::Override {
        buffer: buffer.to_owned(),
        process: process.to_owned(),
        mode: rcs::r#override::Mode::Hold.into(),
        fault: Some(rcs::Fault { kind: kind.into(), ..Default::default() }),
        ..Default::default()
    }
}

fn with(target: &str, fault_of: rcs::Fault) -> rcs::Override {
    rcs::Override { fault: Some(fault_of), ..fault(target, fault_of.kind()) }
}

fn delayed(target: &str, kind: Kind, delay_ms: f64) -> rcs::Override {
    with(target, rcs::Fault { kind: kind.into(), delay_ms, ..Default::default() })
}

fn end(target: &str, kind: Kind) -> rcs::Override {
    rcs::Override { mode: rcs::r#override::Mode::Release.into(), ..fault(target, kind) }
}

fn event(change: rcs::Override) -> ExternalEvent {
    ExternalEvent::operator("/runtime/override", AnyMessage::new(change))
}

fn set(run: &mut Stepped, change: rcs::Override) {
    run.take(event(change)).unwrap();
}

fn hashing() -> RunOptions {
    RunOptions { hash: true, seed: 7, ..RunOptions::default() }
}

fn running() -> Stepped {
    let mut run = stepped(PAIR, hashing());
    run.begin().unwrap();
    run.run_until(seconds(0.1)).unwrap();
    run
}

/// Number of messages in a buffer, and count and log time in ms of the newest one of the counter.
fn counted(run: &Stepped) -> (u64, f64, f64) {
    let sample = run.bus().get("/counter/count").unwrap().latest().unwrap();
    let count: foxglove::Vector3 = sample.message.to().unwrap();
    (sample.header.sequence, count.x, sample.header.log_time.0 as f64 * 1e-6)
}

fn listed(run: &Stepped) -> Vec<String> {
    let list: rcs::OverrideList = newest(run, "/runtime/overrides");
    list.active.iter().map(|active| format!("{}{} {}", active.process, active.buffer, active.fault)).collect()
}

// The counter runs every 10 ms, and its output becomes visible 3 ms later.

#[test]
fn a_stopped_process_does_not_run_until_it_is_released() {
    let mut run = running();
    set(&mut run, fault("counter", Kind::Stopped));
    assert_eq!(listed(&run), ["counter stopped"]);
    run.run_until(seconds(0.5)).unwrap();
    // The cycle of 0.1 s had begun.
    assert_eq!(counted(&run), (11, 11.0, 103.0));
    assert_eq!(newest::<rcs::Status>(&run, "/counter/status").cycle, 11);
    set(&mut run, end("counter", Kind::Stopped));
    assert!(listed(&run).is_empty());
    run.run_until(seconds(0.6)).unwrap();
    assert_eq!(counted(&run).1, 11.0 + 9.0);
    let status: rcs::Status = newest(&run, "/adder/status");
    assert_eq!(status.cycle, 25, "no other process is stopped");
}

#[test]
fn a_slowed_process_is_later_and_skips_the_cycles_in_which_it_still_computes() {
    let mut run = running();
    set(&mut run, delayed("counter", Kind::Slowed, 24.0));
    assert_eq!(listed(&run), ["counter slowed by 24 ms"]);
    // The next cycle begins at 0.11 s and takes 27 ms; the one after it begins at 0.14 s.
    run.run_until(seconds(0.136)).unwrap();
    assert_eq!(counted(&run).1, 11.0);
    run.run_until(seconds(0.166)).unwrap();
    assert_eq!(counted(&run), (12, 12.0, 137.0));
    run.run_until(seconds(0.167)).unwrap();
    assert_eq!(counted(&run), (13, 13.0, 167.0));
}

#[test]
fn a_frozen_process_repeats_its_last_message_and_its_status_goes_on() {
    let mut run = running();
    set(&mut run, fault("counter", Kind::Frozen));
    run.run_until(seconds(0.2)).unwrap();
    // The output of the cycle of 0.1 s was not published yet.
    assert_eq!(counted(&run), (20, 10.0, 193.0));
    assert_eq!(newest::<rcs::Status>(&run, "/counter/status").cycle, 20);
    set(&mut run, end("counter", Kind::Frozen));
    run.run_until(seconds(0.21)).unwrap();
    assert_eq!(counted(&run).1, 21.0);
}

#[test]
fn numbers_become_nan_in_one_field_or_in_all() {
    let mut run = running();
    set(&mut run, rcs::Override { path: ".z".to_owned(), ..fault("/counter/count", Kind::Nan) });
    assert_eq!(listed(&run), ["/counter/count NaN in .z"]);
    run.run_until(seconds(0.2)).unwrap();
    let count: foxglove::Vector3 = newest(&run, "/counter/count");
    assert!(count.z.is_nan() && count.x == 20.0, "{count:?}");
    set(&mut run, fault("counter", Kind::Nan));
    run.run_until(seconds(0.3)).unwrap();
    let count: foxglove::Vector3 = newest(&run, "/counter/count");
    assert!(count.x.is_nan() && count.y.is_nan() && count.z.is_nan(), "{count:?}");
    assert_eq!(newest::<rcs::Status>(&run, "/counter/status").cycle, 30);
    let list: rcs::OverrideList = newest(&run, "/runtime/overrides");
    assert_eq!((list.active.len(), list.dropped), (2, 0));
}

#[test]
fn every_third_message_is_dropped_or_a_share_of_them_by_the_seed() {
    let dropped = |every: u32, probability: f64, seed: u64| {
        let mut run = running();
        let loss = rcs::Fault { kind: Kind::Dropped.into(), every, probability, seed, ..Default::default() };
        set(&mut run, with("/counter/count", loss));
        run.run_until(seconds(3.1)).unwrap();
        // Without the fault there would be 310.
        (310 - counted(&run).0, run.summary().hash.unwrap())
    };
    assert_eq!(dropped(3, 0.0, 0).0, 100);
    assert_eq!(dropped(0, 0.0, 0).0, 300, "all");
    let (count, hash) = dropped(0, 0.2, 1);
    // 300 × 0.2, within four standard deviations.
    assert!((33..=87).contains(&count), "{count}");
    assert_eq!(dropped(0, 0.2, 1), (count, hash.clone()));
    assert_ne!(dropped(0, 0.2, 2).1, hash);
}

#[test]
fn late_messages_arrive_later_and_the_process_keeps_its_period() {
    let mut run = running();
    set(&mut run, delayed("/counter/count", Kind::Late, 40.0));
    run.run_until(seconds(0.142)).unwrap();
    assert_eq!(counted(&run).1, 10.0);
    assert_eq!(newest::<rcs::Status>(&run, "/counter/status").cycle, 14);
    run.run_until(seconds(0.2)).unwrap();
    assert_eq!(counted(&run), (16, 16.0, 193.0));
    let acq = run.bus().get("/counter/count").unwrap().latest().unwrap().header.acq_time;
    assert_eq!(acq, seconds(0.15), "acquired when it was");
}

#[test]
fn messages_of_the_operator_pass() {
    let mut run = running();
    set(&mut run, fault("/counter/command", Kind::Dropped));
    let halt = rcs::Command { serial: 99, name: "HALT".to_owned(), ..Default::default() };
    run.take(ExternalEvent::operator("/counter/command", AnyMessage::new(halt))).unwrap();
    run.run_until(seconds(0.2)).unwrap();
    assert_eq!(newest::<rcs::Status>(&run, "/counter/status").command, "HALT");
}

#[test]
fn a_fault_that_makes_no_sense_is_refused_with_the_reason() {
    let mut run = running();
    let mut check = |change: rcs::Override, expected: &str| {
        let error = run.take(event(change)).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    };
    check(fault("nobody", Kind::Stopped), "no process nobody");
    check(fault("/nobody", Kind::Frozen), "no buffer /nobody");
    check(fault("/counter/count", Kind::Stopped), "not a buffer");
    check(fault("", Kind::Frozen), "names no process and no buffer");
    check(fault("counter", Kind::None), "no kind");
    check(fault("counter", Kind::Slowed), "delay");
    check(delayed("counter", Kind::Slowed, f64::NAN), "delay");
    check(delayed("/counter/params", Kind::Late, 1.0), "no process writes it");
    check(fault("/runtime/journal", Kind::Dropped), "written by the runtime");
    check(rcs::Override { path: ".w".to_owned(), ..fault("counter", Kind::Nan) }, "fault of counter.w: ");
    for path in ["w", ".w"] {
        check(
            rcs::Override { path: path.to_owned(), ..fault("/counter/count", Kind::Nan) },
            "the fault of /counter/count.w: it has no floating-point number that could be NaN; \
             expected a field of foxglove.Vector3 that is or holds one",
        );
    }
    let both = rcs::Override { process: "counter".to_owned(), ..fault("/counter/count", Kind::Frozen) };
    check(both, "the fault of counter and /counter/count: it names a process and a buffer; expected one");
    check(rcs::Override { path: ".x".to_owned(), ..fault("counter", Kind::Frozen) }, "has no field");
    let once = rcs::r#override::Mode::Once.into();
    check(rcs::Override { mode: once, ..fault("counter", Kind::Frozen) }, "HOLD");
    let loss = rcs::Fault { kind: Kind::Dropped.into(), probability: 1.5, ..Default::default() };
    check(with("counter", loss), "expected 0 to 1");
    run.run_until(seconds(0.2)).unwrap();
    assert_eq!(counted(&run).1, 20.0);
}

/// Every kind of fault begins and ends.
fn acts() -> Vec<(f64, rcs::Override)> {
    let some = rcs::Fault { kind: Kind::Dropped.into(), probability: 0.3, ..Default::default() };
    vec![
        (0.1, with("/counter/count", some)),
        (0.2, fault("adder", Kind::Stopped)),
        (0.3, end("adder", Kind::Stopped)),
        (0.4, delayed("counter", Kind::Slowed, 24.0)),
        (0.5, delayed("counter", Kind::Late, 60.0)),
        (0.7, end("counter", Kind::Slowed)),
        (0.8, rcs::Override { expires_s: 0.1, ..fault("counter", Kind::Frozen) }),
        (1.0, end("counter", Kind::Late)),
        (1.1, rcs::Override { path: ".z".to_owned(), ..fault("/counter/count", Kind::Nan) }),
        (1.2, end("/counter/count", Kind::Nan)),
        (1.3, end("/counter/count", Kind::Dropped)),
    ]
}

fn act(run: &mut Stepped) {
    for (at, change) in acts() {
        run.run_until(seconds(at)).unwrap();
        set(run, change);
    }
    run.run_until(seconds(1.5)).unwrap();
}

#[test]
fn a_recorded_run_with_faults_is_replayed_bit_equal() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("faults.mcap");
    let mut run = stepped(PAIR, hashing());
    let options = RecordOptions { lossless: true, build: "test".to_owned(), ..RecordOptions::default() };
    let recording = Recording::start(&path, run.plan(), run.buffers(), &options).unwrap();
    run.begin().unwrap();
    act(&mut run);
    recording.finish_at(run.now()).unwrap();
    let hash = run.summary().hash.unwrap();

    let recorded = RecordedRun::read(&Log::open(&path).unwrap(), PLUGINS).unwrap();
    assert_eq!(recorded.journal().len(), acts().len(), "every begin and every end");
    let plan = recorded.plan(PLUGINS).unwrap();
    let again = recorded.stepped(&plan, None, hashing()).unwrap();
    let mut replay = Replay::new(recorded, again).unwrap();
    replay.run_until(seconds(1.5)).unwrap();
    assert!(replay.first().is_none(), "{:?}", replay.first());
    assert_eq!(replay.run().summary().hash.unwrap(), hash);
}

#[test]
fn a_run_continues_from_a_snapshot_inside_of_every_fault() {
    let mut whole = stepped(PAIR, hashing());
    whole.begin().unwrap();
    act(&mut whole);
    let hash = whole.summary().hash.unwrap();
    for at in [0.15, 0.25, 0.45, 0.55, 0.63, 0.85, 0.95, 1.05, 1.15, 1.25] {
        let mut run = stepped(PAIR, hashing());
        run.begin().unwrap();
        let (before, after): (Vec<_>, Vec<_>) = acts().into_iter().partition(|(time, _)| *time < at);
        for (time, change) in before {
            run.run_until(seconds(time)).unwrap();
            set(&mut run, change);
        }
        run.run_until(seconds(at)).unwrap();
        let bytes = run.snapshot().to_bytes().unwrap();
        // Forward, back in memory, and on from disk.
        run.run_until(seconds(1.5)).unwrap();
        let mut again = stepped(PAIR, hashing());
        again.restore(&Snapshot::from_bytes(&bytes).unwrap()).unwrap();
        for (time, change) in after {
            again.run_until(seconds(time)).unwrap();
            set(&mut again, change);
        }
        again.run_until(seconds(1.5)).unwrap();
        assert_eq!(again.summary().hash.as_ref(), Some(&hash), "at {at} s");
    }
}

/// The newest message of every topic and the number of messages.
fn content(frame: &Frame) -> Vec<(String, u64, Option<Vec<u8>>)> {
    let of = |topic: &Topic| {
        let bytes = topic.latest.as_ref().map(|sample| sample.message.bytes().to_vec());
        (topic.name.to_string(), topic.messages, bytes)
    };
    frame.topics.iter().filter(|topic| !topic.name.contains("timing")).map(of).collect()
}

#[test]
fn going_back_and_forward_through_faults_shows_the_same_and_computes_the_same_again() {
    let folder = tempfile::tempdir().unwrap();
    // Nothing of the past is kept but a few snapshots, so that it is computed again.
    let past = PastOptions { memory_bytes: 1, disk_bytes: 0, folder: folder.path().to_owned() };
    let mut source = StackSource::new(plan(PAIR).unwrap(), None, RunOptions { past, ..hashing() }).unwrap();
    let task = Task::default();
    let mut seen = Vec::new();
    let mut acts = acts().into_iter().map(|(at, change)| (at * 10.0, change)).peekable();
    for at in (1..=75).map(|at| f64::from(at) * 0.2) {
        source.seek(seconds(at), &task).unwrap();
        seen.push((at, content(&source.frame())));
        while let Some((_, change)) = acts.next_if(|(time, _)| *time <= at + 1e-6) {
            source.write("/runtime/override", AnyMessage::new(change)).unwrap();
        }
    }
    let same = |source: &mut StackSource, (at, before): &(f64, Vec<_>)| {
        source.seek(seconds(*at), &task).unwrap();
        finish_idle(source);
        let now = content(&source.frame());
        let names = |content: &[(String, u64, Option<Vec<u8>>)]| -> Vec<String> {
            content.iter().map(|topic| topic.0.clone()).collect()
        };
        assert_eq!(names(&now), names(before), "at {at} s");
        // The operator wrote at that time, after it was first seen.
        for (now, before) in now.iter().zip(before).filter(|(now, _)| !now.0.starts_with("/runtime")) {
            assert_eq!(now, before, "at {at} s");
        }
    };
    for moment in seen.iter().rev().step_by(3) {
        same(&mut source, moment);
    }
    for moment in seen.iter().step_by(7) {
        same(&mut source, moment);
    }
}

#[test]
fn the_cycle_of_a_stopped_process_is_an_event_but_not_a_step() {
    let mut run = running();
    set(&mut run, fault("counter", Kind::Stopped));
    let mut happened = Vec::new();
    while run.next_time().unwrap().unwrap() <= seconds(0.13) {
        happened.push(run.advance().unwrap().unwrap());
    }
    let of_counter =
        |what: &&Happened| matches!(what, Happened::Fault | Happened::Started(0) | Happened::Cycle(0));
    let of_counter: Vec<_> = happened.iter().filter(of_counter).collect();
    // At 0.103 s its last cycle ends.
    assert_eq!(of_counter, [&Happened::Cycle(0), &Happened::Fault, &Happened::Fault, &Happened::Fault]);
}

#[test]
fn a_live_run_stops_and_slows_a_process_and_refuses_late_messages() {
    let live = Live::start(plan(PAIR).unwrap(), &LiveOptions::default()).unwrap();
    let cycle = || {
        let status = live.bus().get("/counter/status").unwrap().latest();
        status.and_then(|sample| sample.message.get::<rcs::Status>().map(|status| status.cycle)).unwrap_or(0)
    };
    let wait = |until: &dyn Fn() -> bool| {
        let clock = std::time::Instant::now();
        while !until() {
            assert!(clock.elapsed() < Duration::from_secs(20), "it never came");
            std::thread::yield_now();
        }
    };
    wait(&|| cycle() >= 3);
    let refused = live.take(event(delayed("counter", Kind::Late, 5.0))).unwrap_err().to_string();
    assert!(refused.contains("live run"), "{refused}");
    live.take(event(fault("counter", Kind::Stopped))).unwrap();
    // A cycle that had begun may end.
    let adder = || live.bus().get("/adder/status").unwrap().newest();
    let from = adder();
    wait(&|| adder() >= from + 4);
    let stopped = cycle();
    let from = adder();
    wait(&|| adder() >= from + 8);
    assert_eq!(cycle(), stopped);
    live.take(event(end("counter", Kind::Stopped))).unwrap();
    live.take(event(delayed("counter", Kind::Slowed, 30.0))).unwrap();
    wait(&|| cycle() >= stopped + 3);
    live.stop();
}
