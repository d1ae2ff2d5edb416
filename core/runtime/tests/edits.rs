//! Overrides: they are checked when they are set and listed while they last, and a message always passes.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod common;

use common::{PAIR, PLUGINS, newest, seconds, stepped};
use rcs_bus::WriterId;
use rcs_log::Log;
use rcs_msg::{AnyMessage, foxglove, rcs};
use rcs_runtime::{
    ExternalEvent, RecordOptions, RecordedRun, Recording, Replay, RunOptions, Snapshot, Stepped,
};

fn running() -> Stepped {
    let mut run = stepped(PAIR, RunOptions::default());
    run.begin().unwrap();
    run.run_until(seconds(0.1)).unwrap();
    run
}

fn hold(path: &str, value: &str) -> rcs::Override {
    rcs::Override {
        buffer: "/counter/count".to_owned(),
        mode: rcs::r#override::Mode::Hold.into(),
        path: path.to_owned(),
        value_json: value.to_owned(),
        ..Default::default()
    }
}

fn release() -> rcs::Override {
    rcs::Override { mode: rcs::r#override::Mode::Release.into(), ..Default::default() }
}

fn set(run: &mut Stepped, change: rcs::Override) -> Result<(), String> {
    let event = ExternalEvent::operator("/runtime/override", AnyMessage::new(change));
    run.take(event).map(|_| ()).map_err(|error| error.to_string())
}

fn z(run: &Stepped) -> f64 {
    newest::<foxglove::Vector3>(run, "/counter/count").z
}

fn listed(run: &Stepped) -> Vec<(u64, String)> {
    let list: rcs::OverrideList = newest(run, "/runtime/overrides");
    list.active.iter().map(|active| (active.id, format!("{}{}", active.buffer, active.path))).collect()
}

#[test]
fn an_edit_that_does_not_fit_is_refused_by_name_and_changes_nothing() {
    let mut run = running();
    let mut check = |change: rcs::Override, expected: &[&str]| {
        let error = set(&mut run, change).unwrap_err();
        assert!(expected.iter().all(|part| error.contains(part)), "{error}");
    };
    check(rcs::Override { buffer: "/nobody".to_owned(), ..hold(".z", "1") }, &["/nobody"]);
    check(rcs::Override { buffer: "/runtime/run".to_owned(), ..hold(".seed", "1") }, &["/runtime/run"]);
    check(hold(".w", "1"), &["/counter/count.w", "no field w", "x, y, z"]);
    check(hold(".z", "\"fast\""), &["parameter z", "fast"]);
    check(hold(".z", "[1]"), &["[1]", "expected a number"]);
    check(hold(".z", "1e999"), &["1e999"]);
    check(hold(".z.x", "1"), &["plain value"]);
    check(hold("..", "1"), &["field path"]);
    let params =
        |path: &str, value: &str| rcs::Override { buffer: "/counter/params".to_owned(), ..hold(path, value) };
    check(params(".publish_hz", "1000"), &["publish_hz", "0.1 to 100"]);
    check(rcs::Override { expires_s: f64::NAN, ..hold(".z", "1") }, &["expires"]);
    check(
        rcs::Override { due_process: "nobody".to_owned(), due_cycle: 3, ..hold(".z", "1") },
        &["no process nobody"],
    );
    check(rcs::Override { id: 77, ..release() }, &["77"]);
    check(release(), &["names nothing"]);
    let whole = rcs::Override { message: vec![0xff].into(), ..hold("", "") };
    check(whole, &["does not decode as foxglove.Vector3"]);
    run.run_until(seconds(0.2)).unwrap();
    assert_eq!(z(&run), 5.0);
    assert_eq!(run.bus().get("/runtime/overrides").unwrap().newest(), 0);
}

#[test]
fn an_edit_is_listed_with_its_owner_until_it_is_released_by_its_number() {
    let mut run = running();
    set(&mut run, rcs::Override { owner: "anna".to_owned(), ..hold(".z", "42") }).unwrap();
    set(&mut run, hold(".y", "1.5")).unwrap();
    run.run_until(seconds(0.2)).unwrap();
    assert_eq!(z(&run), 42.0);
    assert_eq!(listed(&run), [(1, "/counter/count.z".to_owned()), (2, "/counter/count.y".to_owned())]);
    let list: rcs::OverrideList = newest(&run, "/runtime/overrides");
    assert_eq!((list.active[0].owner.as_str(), list.active[0].value.as_str()), ("anna", "42"));
    assert_eq!(list.active[1].owner, "operator");
    set(&mut run, rcs::Override { id: 1, ..release() }).unwrap();
    run.run_until(seconds(0.3)).unwrap();
    assert_eq!(z(&run), 5.0);
    assert_eq!(listed(&run), [(2, "/counter/count.y".to_owned())]);
    set(&mut run, rcs::Override { all: true, ..release() }).unwrap();
    assert_eq!(listed(&run), []);
}

#[test]
fn an_edit_expires_and_an_edit_waits_for_its_cycle() {
    let mut run = running();
    set(&mut run, rcs::Override { expires_s: 0.1, ..hold(".z", "42") }).unwrap();
    run.run_until(seconds(0.19)).unwrap();
    assert_eq!(z(&run), 42.0);
    run.run_until(seconds(0.25)).unwrap();
    assert_eq!((z(&run), listed(&run).len()), (5.0, 0));
    // Cycle 31 of the counter starts at 0.3 s; its output becomes visible 3 ms later.
    let once = rcs::Override {
        mode: rcs::r#override::Mode::Once.into(),
        due_process: "counter".to_owned(),
        due_cycle: 31,
        ..hold(".z", "43")
    };
    set(&mut run, once).unwrap();
    run.run_until(seconds(0.295)).unwrap();
    assert_eq!((z(&run), listed(&run).len()), (5.0, 1));
    run.run_until(seconds(0.303)).unwrap();
    let count: foxglove::Vector3 = newest(&run, "/counter/count");
    assert_eq!((count.x, count.z), (31.0, 43.0));
    run.run_until(seconds(0.313)).unwrap();
    assert_eq!((z(&run), listed(&run).len()), (5.0, 0));
}

#[test]
fn an_edit_survives_in_a_snapshot_on_disk() {
    let hashing = || RunOptions { hash: true, ..RunOptions::default() };
    let mut whole = stepped(PAIR, hashing());
    whole.begin().unwrap();
    whole.run_until(seconds(0.1)).unwrap();
    set(&mut whole, rcs::Override { expires_s: 0.5, ..hold(".z", "42") }).unwrap();
    let due = rcs::Override { due_process: "counter".to_owned(), due_cycle: 31, ..hold(".y", "1.5") };
    set(&mut whole, due).unwrap();
    whole.run_until(seconds(0.2)).unwrap();
    let bytes = whole.snapshot().to_bytes().unwrap();
    whole.run_until(seconds(1.0)).unwrap();
    let mut again = stepped(PAIR, hashing());
    again.restore(&Snapshot::from_bytes(&bytes).unwrap()).unwrap();
    again.run_until(seconds(1.0)).unwrap();
    assert_eq!(again.summary().hash, whole.summary().hash);
    assert_eq!(listed(&again), [(2, "/counter/count.y".to_owned())]);
}

#[test]
fn an_edit_that_fits_the_type_but_not_the_message_is_dropped_and_told_as_the_operators() {
    let mut run = running();
    let change = rcs::Override {
        buffer: "/counter/command".to_owned(),
        owner: "anna".to_owned(),
        ..hold(".parameters[3]", "7")
    };
    set(&mut run, change).unwrap();
    assert_eq!(listed(&run).len(), 1);
    let faults = newest::<rcs::Status>(&run, "/counter/status").faults;
    let halt = rcs::Command { serial: 99, name: "HALT".to_owned(), ..Default::default() };
    run.take(ExternalEvent::operator("/counter/command", AnyMessage::new(halt))).unwrap();
    run.run_until(seconds(0.2)).unwrap();
    let status: rcs::Status = newest(&run, "/counter/status");
    assert_eq!((status.command.as_str(), status.faults), ("HALT", faults), "the message passed");
    let told: foxglove::Log = newest(&run, "/runtime/log");
    assert_eq!(told.name, "operator");
    for part in ["/counter/command.parameters[3]", "anna", "dropped"] {
        assert!(told.message.contains(part), "{}", told.message);
    }
    let list: rcs::OverrideList = newest(&run, "/runtime/overrides");
    assert_eq!((list.active.len(), list.dropped, list.last_dropped), (0, 1, told.message));
}

#[test]
fn the_later_one_of_two_holders_of_a_field_replaces_the_other_and_is_listed_alone() {
    let mut run = running();
    let by = |owner: &str, value: &str| rcs::Override { owner: owner.to_owned(), ..hold(".z", value) };
    set(&mut run, by("anna", "42")).unwrap();
    set(&mut run, by("bert", "7")).unwrap();
    run.run_until(seconds(0.2)).unwrap();
    assert_eq!(z(&run), 7.0);
    let list: rcs::OverrideList = newest(&run, "/runtime/overrides");
    let owners: Vec<&str> = list.active.iter().map(|active| active.owner.as_str()).collect();
    assert_eq!(owners, ["bert"]);
    let id = list.active[0].id;
    set(&mut run, rcs::Override { id, ..release() }).unwrap();
    run.run_until(seconds(0.3)).unwrap();
    assert_eq!((z(&run), listed(&run).len()), (5.0, 0));
}

/// The writer and the count of the newest message of the counter.
fn newest_count(run: &Stepped) -> (WriterId, f64) {
    let sample = run.bus().get("/counter/count").unwrap().latest().unwrap();
    (sample.header.writer, sample.message.to::<foxglove::Vector3>().unwrap().x)
}

fn write(run: &mut Stepped, x: f64) {
    let count = foxglove::Vector3 { x, ..Default::default() };
    run.take(ExternalEvent::operator("/counter/count", AnyMessage::new(count))).unwrap();
}

#[test]
fn a_process_that_ignores_an_edit_of_its_output_goes_on_and_readers_see_whose_it_is() {
    let mut run = running();
    let before = newest_count(&run);
    write(&mut run, 500.0);
    assert_eq!(newest_count(&run), (WriterId::OPERATOR, 500.0));
    // The adder reads it at 0.1 s like any message; the counter's own state is what it was.
    run.run_until(seconds(0.2)).unwrap();
    assert_eq!(newest_count(&run), (before.0, 20.0));
    let sum: foxglove::Vector3 = newest(&run, "/adder/sum");
    let mut plain = running();
    plain.run_until(seconds(0.2)).unwrap();
    let without: foxglove::Vector3 = newest(&plain, "/adder/sum");
    assert_eq!((sum.y - without.y, listed_or_none(&run)), (1.0, 0), "one message more, and nothing is held");
}

fn listed_or_none(run: &Stepped) -> u64 {
    run.bus().get("/runtime/overrides").unwrap().newest()
}

#[test]
fn two_writers_at_once_are_both_kept_in_their_order_and_what_is_held_replaces_both() {
    let mut run = running();
    // The output of the counter's cycle of 0.1 s becomes visible at 0.103 s, when the operator writes, too.
    run.run_until(seconds(0.103)).unwrap();
    let process = newest_count(&run);
    let before = run.bus().get("/counter/count").unwrap().newest();
    write(&mut run, 501.0);
    write(&mut run, 502.0);
    assert_eq!(run.bus().get("/counter/count").unwrap().newest(), before + 2);
    assert_eq!(newest_count(&run), (WriterId::OPERATOR, 502.0));
    set(&mut run, hold(".x", "7")).unwrap();
    write(&mut run, 503.0);
    assert_eq!(newest_count(&run), (WriterId::OPERATOR, 7.0));
    run.run_until(seconds(0.2)).unwrap();
    assert_eq!(newest_count(&run), (process.0, 7.0));
}

#[test]
fn a_process_that_ignores_a_held_command_says_so_and_who_holds_it_stays_listed() {
    let mut run = running();
    set(&mut run, rcs::Override { buffer: "/counter/command".to_owned(), ..hold(".name", "\"JUMP\"") })
        .unwrap();
    let halt = rcs::Command { serial: 99, name: "HALT".to_owned(), ..Default::default() };
    run.take(ExternalEvent::operator("/counter/command", AnyMessage::new(halt))).unwrap();
    run.run_until(seconds(0.2)).unwrap();
    let status: rcs::Status = newest(&run, "/counter/status");
    assert_eq!((status.state(), status.echo_serial), (rcs::ProcessState::Error, 99), "{}", status.state_text);
    assert!(status.state_text.contains("JUMP"), "{}", status.state_text);
    assert_eq!(listed(&run), [(1, "/counter/command.name".to_owned())]);
}

#[test]
fn recorded_edits_of_every_kind_are_replayed_to_the_same_hash() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("edits.mcap");
    let hashing = || RunOptions { hash: true, ..RunOptions::default() };
    let mut run = stepped(PAIR, hashing());
    let recording = Recording::start(
        &path,
        run.plan(),
        run.buffers(),
        &RecordOptions { lossless: true, ..Default::default() },
    );
    let recording = recording.unwrap();
    run.begin().unwrap();
    run.run_until(seconds(0.1)).unwrap();
    write(&mut run, 500.0);
    let once = rcs::r#override::Mode::Once.into();
    set(&mut run, rcs::Override { mode: once, ..hold(".y", "3") }).unwrap();
    set(&mut run, rcs::Override { owner: "anna".to_owned(), ..hold(".z", "42") }).unwrap();
    run.run_until(seconds(0.3)).unwrap();
    set(&mut run, rcs::Override { owner: "bert".to_owned(), expires_s: 0.2, ..hold(".z", "43") }).unwrap();
    let due = rcs::Override { due_process: "counter".to_owned(), due_cycle: 60, ..hold(".x", "1") };
    set(&mut run, due).unwrap();
    run.run_until(seconds(0.8)).unwrap();
    set(&mut run, rcs::Override { all: true, ..release() }).unwrap();
    run.run_until(seconds(1.0)).unwrap();
    recording.finish_at(run.now()).unwrap();
    let recorded = RecordedRun::read(&Log::open(&path).unwrap(), PLUGINS).unwrap();
    let again = recorded.stepped(&recorded.plan(PLUGINS).unwrap(), None, hashing()).unwrap();
    let mut replay = Replay::new(recorded, again).unwrap();
    replay.run_until(seconds(1.0)).unwrap();
    assert!(replay.first().is_none(), "{:?}", replay.first());
    assert_eq!(replay.run().summary().hash, run.summary().hash);
}
