//! Recorded runs: the identity, the journal and the schedule in a recording that somebody else made or changed.

use super::{STACK, edited, split};
use rcs_log::{Log, LogWriter, WriteHeader, WriterOptions};
use rcs_msg::{AnyMessage, Stamp, rcs, schema_of};
use rcs_runtime::{Plan, RecordedRun, RunOptions, StackFile};
use rcs_testkit::logs::SharedSink;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Arc, LazyLock};

/// A recorded run is read or refused with an error text, and so are its stack and its repetition.
///
/// # Panics
/// If that does not hold, or more events are read than were recorded.
pub fn journal(input: &[u8]) {
    let (choice, rest) = split(input);
    let mut parts = PARTS.clone();
    let part = usize::from(choice) % parts.len();
    let edits = edited(&parts[part], rest);
    parts[part] = if choice < 128 { edits } else { rest.to_vec() };
    let log = recording(&parts);
    let plugins = rcs_plugins::all();
    let words =
        |error: rcs_runtime::RunError| assert!(!error.to_string().is_empty(), "a refusal without words");
    let run = match RecordedRun::read(&log, plugins) {
        Ok(run) => run,
        Err(error) => return words(error),
    };
    assert!(run.journal().len() <= 1, "{} events of one", run.journal().len());
    assert!(run.problems().iter().all(|problem| !problem.is_empty()), "a problem without words");
    let plan = match run.plan_with(plugins, &[], &rcs_runtime::NoAssets) {
        Ok(plan) => plan,
        Err(error) => return words(error),
    };
    assert!(
        !rest.is_empty() || choice >= 128 || run.check(&plan, None).is_ok(),
        "the recorded run is not its own"
    );
    run.check(&plan, None).map_or_else(words, drop);
    let options = RunOptions { threads: 1, ..RunOptions::default() };
    run.stepped(&plan, None, options).map_or_else(words, drop);
}

/// Encoded identity, event and cycle of a run of a stack.
static PARTS: LazyLock<[Vec<u8>; 3]> = LazyLock::new(|| {
    // Without the inputs: the recording that they come from is not there.
    let text: String = STACK.split("[[input]]").take(1).chain(STACK.split("static = true").skip(1)).collect();
    let text = text.replace("inputs = { depth = \"/camera/depth\" }\n", "");
    let plan =
        StackFile::parse("stack.toml", &text).and_then(|file| Plan::new(file, rcs_plugins::all(), &[]));
    let plan = plan.expect("the stack has no error");
    let params = plan.processes.iter().map(|process| rcs::InitialParams {
        process: process.name.to_string(),
        schema: process.params.schema().name().to_owned(),
        params: process.params.bytes(),
    });
    let run = rcs::RunInfo {
        stack: plan.file.name().to_owned(),
        stack_text: plan.file.text.clone(),
        stack_hash: plan.hash.clone(),
        seed: 7,
        build: "ocu".to_owned(),
        params: params.collect(),
        ..rcs::RunInfo::default()
    };
    let event = rcs::JournalEvent {
        events: 3,
        time_ns: 40,
        buffer: "/operator/teleop".to_owned(),
        writer: "operator".to_owned(),
        acq_time_ns: 39,
        schema: "rcs.DriveCommand".to_owned(),
        message: AnyMessage::new(rcs::DriveCommand { speed_mps: 0.5, ..Default::default() }).bytes(),
    };
    let cycle = rcs::CycleRecord {
        process: "obstacles".to_owned(),
        cycle: 1,
        start_ns: 20,
        end_ns: 30,
        input_sequence: vec![0, 1],
    };
    [AnyMessage::new(run), AnyMessage::new(event), AnyMessage::new(cycle)]
        .map(|message| message.bytes().to_vec())
});

/// A recording with these messages.
fn recording(parts: &[Vec<u8>; 3]) -> Log {
    let sink = SharedSink::default();
    let write = || -> Result<(), rcs_log::LogError> {
        let options =
            WriterOptions { compress: false, clock: Arc::new(Default::default), ..WriterOptions::default() };
        let mut writer = LogWriter::with_sink(Box::new(sink.clone()), PathBuf::new(), options)?;
        let topics = [
            ("/runtime/run", schema_of::<rcs::RunInfo>()),
            ("/runtime/journal", schema_of::<rcs::JournalEvent>()),
            ("/runtime/schedule", schema_of::<rcs::CycleRecord>()),
        ];
        for (time, ((topic, schema), part)) in (10..).step_by(10).zip(topics.into_iter().zip(parts)) {
            let channel = writer.add_channel(topic, schema, &BTreeMap::new())?;
            let header = WriteHeader { sequence: 1, log_time: Stamp(time), publish_time: Stamp(time) };
            writer.write(channel, header, part)?;
        }
        writer.finish()
    };
    write().expect("memory takes every write");
    Log::from_bytes(sink.snapshot().into()).expect("a complete log")
}
