//! Records a run: every buffer that its stack records, with the metadata that readers need.

use crate::error::RunError;
use crate::live::apply_class;
use crate::stack::{BufferPlan, Class, Plan, names};
use rcs_bus::{Buffer, Sample};
use rcs_log::{
    COMPLETE_FROM, Log, LogWriter, Recorder, RecorderHandle, RecorderMode, RecorderOptions, RecorderStatus,
    WriteHeader, WriterOptions,
};
use rcs_msg::Stamp;
use rcs_msg::channel::WRITER;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// Options of a recording.
#[derive(Clone, Debug, Default)]
pub struct RecordOptions {
    /// Whether to wait for the disk (stepped runs), or to drop and count messages (live runs).
    pub lossless: bool,
    /// Program and version.
    pub build: String,
    /// Which buffers are recorded.
    pub what: RecordWhat,
    /// Whether an existing file may be replaced.
    pub replace: bool,
    /// Time from which it is complete, for a recording that does not begin with its run.
    pub from: Option<Stamp>,
}

/// Which buffers are recorded. The run's identity, journal and schedule are always recorded, because they repeat the
/// run.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum RecordWhat {
    /// Every buffer that its stack records.
    #[default]
    All,
    /// None: the rest is computed again when the recording is opened.
    Journal,
    /// These buffers.
    Buffers(Vec<String>),
}

impl RecordWhat {
    fn takes(&self, plan: &BufferPlan) -> bool {
        let own = plan.spec.name.starts_with(names::OWN);
        match self {
            Self::All => plan.record,
            Self::Journal => own,
            Self::Buffers(list) => own || list.contains(&plan.spec.name),
        }
    }
}

impl std::fmt::Display for RecordWhat {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::All => f.write_str("all"),
            Self::Journal => f.write_str("journal"),
            Self::Buffers(list) => f.write_str(&list.join(",")),
        }
    }
}

/// Name of the metadata record at the end of a complete recording: the end of the run (`time_ns`), and the number of
/// missing messages (`dropped`).
pub(crate) const RUN_END: &str = "run_end";
/// Key of the metadata of a part of a recording that lacks what its run did before.
const LACKS_BEGINNING: &str = "lacks_beginning";

/// A recording in progress.
pub struct Recording {
    recorder: Recorder,
}

impl Recording {
    /// Starts recording what is written to the buffers from now on.
    pub fn start(
        path: &Path,
        plan: &Plan,
        buffers: &[Arc<Buffer>],
        options: &RecordOptions,
    ) -> Result<Self, RunError> {
        Self::start_with(path, plan, buffers, options, &[])
    }

    /// Like [`Recording::start`], with messages that are recorded first, each with the index of its buffer.
    pub(crate) fn start_with(
        path: &Path,
        plan: &Plan,
        buffers: &[Arc<Buffer>],
        options: &RecordOptions,
        opening: &[(usize, Sample)],
    ) -> Result<Self, RunError> {
        if let RecordWhat::Buffers(list) = &options.what
            && let Some(name) = list.iter().find(|name| !plan.buffers.iter().any(|b| b.spec.name == **name))
        {
            return Err(RunError::Refused(format!(
                "there is no buffer {name} to record in the stack {}",
                plan.file.name()
            )));
        }
        let about = [
            ("stack", plan.file.name().to_owned()),
            ("stack_hash", plan.hash.clone()),
            ("recorded", options.what.to_string()),
        ];
        let from = options.from.map(|from| (COMPLETE_FROM, from.0.to_string()));
        let writer_options = WriterOptions {
            build: options.build.clone(),
            metadata: about.into_iter().chain(from).map(|(key, value)| (key.to_owned(), value)).collect(),
            replace: options.replace,
            ..WriterOptions::default()
        };
        let mode = if options.lossless { RecorderMode::Lossless } else { RecorderMode::Live };
        let writer = LogWriter::create(path, writer_options)?;
        // Encoding and compressing must not delay processes that are short of time.
        let on_start: Option<fn()> =
            (!options.lossless).then_some(|| apply_class(Class::Normal, "the recorder"));
        let recorder =
            Recorder::start(writer, RecorderOptions { mode, on_start, ..RecorderOptions::default() })
                .map_err(|error| {
                    RunError::Refused(format!("no thread could be started for recording: {error}"))
                })?;
        let handle = recorder.handle();
        handle.attach("stack.toml", "application/toml", Stamp(0), plan.file.text.clone().into());
        let mut taps = Vec::with_capacity(buffers.len());
        for (buffer, planned) in buffers.iter().zip(&plan.buffers) {
            let takes = options.what.takes(planned);
            let writer = || writer_of(plan, buffer.name());
            taps.push(takes.then(|| Self::tap(handle.clone(), buffer, planned, writer())).transpose()?);
        }
        for (index, sample) in opening {
            if let Some(Some(tap)) = taps.get_mut(*index) {
                tap(sample);
            }
        }
        for (buffer, tap) in buffers.iter().zip(taps) {
            if let Some(tap) = tap {
                buffer.tap_once(tap);
            }
        }
        Ok(Self { recorder })
    }

    /// What records the messages of a buffer.
    fn tap(
        handle: RecorderHandle,
        buffer: &Arc<Buffer>,
        plan: &BufferPlan,
        writer: String,
    ) -> Result<rcs_bus::Tap, RunError> {
        let spec = buffer.spec();
        let mut metadata = spec.metadata.clone();
        metadata.insert(WRITER.to_owned(), writer);
        let channel = handle.add_channel_with(&spec.name, &spec.schema, metadata, plan.codec)?;
        let mut limit = plan.record_hz.map(Limit::new);
        Ok(Box::new(move |sample: &Sample| {
            let header = &sample.header;
            if limit.as_mut().is_some_and(|limit| !limit.takes(header.log_time)) {
                return;
            }
            let header = WriteHeader {
                sequence: header.sequence as u32,
                log_time: header.log_time,
                publish_time: header.acq_time,
            };
            // The recorder's status counts a message that it does not accept.
            handle.write_message(channel, header, sample.message.clone());
        }))
    }

    /// State of the recording: messages, drops, and errors.
    pub fn status(&self) -> RecorderStatus {
        self.recorder.status()
    }

    /// Writes what is queued, the end time of the run, and the summary. A run whose end is known is repeated up to
    /// there.
    pub fn finish_at(self, end: Stamp) -> Result<RecorderStatus, RunError> {
        let handle = self.recorder.handle();
        handle.flush();
        let dropped = handle.status().dropped.to_string();
        let entries = [("time_ns".to_owned(), end.0.to_string()), ("dropped".to_owned(), dropped)];
        handle.metadata(RUN_END, entries.into());
        self.finish()
    }

    /// Writes what is queued, and the summary.
    pub fn finish(self) -> Result<RecorderStatus, RunError> {
        Ok(self.recorder.finish()?)
    }
}

/// Limits how many messages of a buffer are recorded per second, on average.
struct Limit {
    period_ns: u64,
    /// The next message is recorded from this time on; `None` before the first one.
    due: Option<Stamp>,
}

impl Limit {
    fn new(hz: f64) -> Self {
        Self { period_ns: (1e9 / hz) as u64, due: None }
    }

    /// Whether a message with this log time is recorded.
    fn takes(&mut self, time: Stamp) -> bool {
        if self.due.is_some_and(|due| time < due) {
            return false;
        }
        // A message that comes late does not delay the next ones, because with jitter that would halve a rate that equals
        // the limit. One that is later than a period comes after a pause, which is not made up for.
        let next = self.due.map(|due| due.after_ns(self.period_ns)).filter(|next| *next >= time);
        self.due = Some(next.unwrap_or_else(|| time.after_ns(self.period_ns)));
        true
    }
}

/// Metadata of the part of a recording that begins at `from`, for [`WriterOptions::metadata`]: from when on the part is
/// complete, and whether it lacks the beginning of the recording, so that its run cannot be repeated.
pub fn metadata_of_part(recording: &Log, from: Stamp) -> BTreeMap<String, String> {
    let is_later = from > recording.info().start;
    let complete = recording.info().complete_from.max(is_later.then_some(from));
    let complete = complete.map(|from| (COMPLETE_FROM, from.0.to_string()));
    let lacks = (is_later || lacks_beginning(recording)).then(|| (LACKS_BEGINNING, "true".to_owned()));
    complete.into_iter().chain(lacks).map(|(key, value)| (key.to_owned(), value)).collect()
}

/// Whether a recording is a part that lacks what its run did before, from which the run cannot be repeated.
pub(crate) fn lacks_beginning(recording: &Log) -> bool {
    recording.metadata().iter().any(|about| about.entries.contains_key(LACKS_BEGINNING))
}

/// Writers of a buffer according to the wiring: processes in the order of the stack file, separated by commas, or the
/// runtime for messages from a log.
pub(crate) fn writer_of(plan: &Plan, buffer: &str) -> String {
    if buffer == names::OVERRIDE {
        return "operator".to_owned();
    }
    if [
        names::RUN,
        names::PROCESSES,
        names::TIMING,
        names::LOG,
        names::SCHEDULE,
        names::JOURNAL,
        names::OVERRIDES,
    ]
    .contains(&buffer)
    {
        return "runtime".to_owned();
    }
    let is = |index: usize| plan.buffers[index].spec.name == buffer;
    for process in &plan.processes {
        if is(process.status_buffer) {
            return process.name.to_string();
        }
        if is(process.command_buffer) {
            return process
                .supervisor
                .map_or_else(|| "operator".to_owned(), |parent| plan.processes[parent].name.to_string());
        }
        if is(process.params_buffer) {
            return "operator".to_owned();
        }
    }
    let log = plan.inputs.iter().any(|input| is(input.buffer)).then_some("log");
    let processes = plan.processes.iter().filter(|process| process.outputs.iter().any(|&index| is(index)));
    let writers: Vec<_> = log.into_iter().chain(processes.map(|process| &*process.name)).collect();
    writers.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Which of these times, ms, are recorded.
    fn recorded(hz: f64, times_ms: impl IntoIterator<Item = f64>) -> Vec<f64> {
        let mut limit = Limit::new(hz);
        times_ms.into_iter().filter(|time_ms| limit.takes(Stamp((time_ms * 1e6) as u64))).collect()
    }

    #[test]
    fn a_buffer_whose_rate_is_the_limit_is_recorded_although_its_times_jitter() {
        let jittered = [0.0, 100.0, 199.9, 300.0, 399.9];
        assert_eq!(recorded(10.0, jittered), [0.0, 100.0, 300.0, 399.9]);
        // Early by 0 to 5 ms; the first one by 0 ms.
        let early_ms = |i: u32| f64::from(i * 7919 % 5000) / 1000.0;
        let minute = recorded(10.0, (0..600).map(|i| f64::from(i) * 100.0 + 5.0 - early_ms(i)));
        assert_eq!(minute.len(), 599);
    }

    #[test]
    fn no_more_than_the_limit_is_recorded_also_after_a_pause() {
        let exact = (0..20).map(|i| f64::from(i) * 50.0);
        assert_eq!(recorded(10.0, exact), (0..10).map(|i| f64::from(i) * 100.0).collect::<Vec<_>>());
        // Ten seconds at 25 Hz.
        assert_eq!(recorded(10.0, (0..250).map(|i| f64::from(i) * 40.0)).len(), 100);
        assert_eq!(recorded(10.0, [0.0, 10_000.0, 10_050.0, 10_100.0, 10_150.0]), [0.0, 10_000.0, 10_100.0]);
    }
}
