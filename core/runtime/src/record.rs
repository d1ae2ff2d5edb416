//! Recording a run: every buffer that its stack records, with what a reader needs to make sense of them.

use crate::error::RunError;
use crate::stack::{BufferPlan, Plan, names};
use rcs_bus::{Buffer, Sample};
use rcs_log::{
    LogWriter, Recorder, RecorderHandle, RecorderMode, RecorderOptions, RecorderStatus, WriteHeader,
    WriterOptions,
};
use rcs_msg::Stamp;
use std::path::Path;
use std::sync::Arc;

/// How a run is recorded.
#[derive(Clone, Debug)]
pub struct RecordOptions {
    /// Wait for the disk (a stepped run), or drop and count (a live one).
    pub lossless: bool,
    /// Program and version.
    pub build: String,
}

/// A recording that goes on.
pub struct Recording {
    recorder: Recorder,
}

impl Recording {
    /// Begins to record what is written to the buffers from now on.
    pub fn start(
        path: &Path,
        plan: &Plan,
        buffers: &[Arc<Buffer>],
        options: &RecordOptions,
    ) -> Result<Self, RunError> {
        let about = [("stack", plan.file.name().to_owned()), ("stack_hash", plan.hash.clone())];
        let writer_options = WriterOptions {
            build: options.build.clone(),
            metadata: about.into_iter().map(|(key, value)| (key.to_owned(), value)).collect(),
            ..WriterOptions::default()
        };
        let mode = if options.lossless { RecorderMode::Lossless } else { RecorderMode::Live };
        let writer = LogWriter::create(path, writer_options)?;
        let recorder = Recorder::start(writer, RecorderOptions { mode, ..RecorderOptions::default() })
            .map_err(|error| {
                RunError::Refused(format!("no thread could be started for recording: {error}"))
            })?;
        let handle = recorder.handle();
        handle.attach("stack.toml", "application/toml", Stamp(0), plan.file.text.clone().into());
        for (buffer, planned) in buffers.iter().zip(&plan.buffers) {
            if planned.record {
                Self::record(handle.clone(), buffer, planned, writer_of(plan, buffer.name()))?;
            }
        }
        Ok(Self { recorder })
    }

    fn record(
        handle: RecorderHandle,
        buffer: &Arc<Buffer>,
        plan: &BufferPlan,
        writer: String,
    ) -> Result<(), RunError> {
        let spec = buffer.spec();
        let mut metadata = spec.metadata.clone();
        metadata.insert("rcs.writer".to_owned(), writer);
        let channel = handle.add_channel(&spec.name, &spec.schema, metadata)?;
        let least_ns = plan.record_hz.map(|hz| (1e9 / hz) as u64);
        let mut due = Stamp(0);
        buffer.tap(Box::new(move |sample: &Sample| {
            let header = &sample.header;
            if let Some(least_ns) = least_ns {
                if header.log_time < due {
                    return;
                }
                due = header.log_time.after_ns(least_ns);
            }
            let header = WriteHeader {
                sequence: header.sequence as u32,
                log_time: header.log_time,
                publish_time: header.acq_time,
            };
            // A message that is not taken is counted in the status.
            handle.write(channel, header, sample.message.bytes());
        }));
        Ok(())
    }

    /// How the recording goes: messages, drops, and what went wrong.
    pub fn status(&self) -> RecorderStatus {
        self.recorder.status()
    }

    /// Writes what is waiting, and the summary.
    pub fn finish(self) -> Result<RecorderStatus, RunError> {
        Ok(self.recorder.finish()?)
    }
}

/// Who writes a buffer, by the wiring: one process, or the runtime for what it reads from a log.
pub(crate) fn writer_of(plan: &Plan, buffer: &str) -> String {
    if buffer == names::OVERRIDE {
        return "operator".to_owned();
    }
    if [names::RUN, names::PROCESSES, names::TIMING, names::LOG, names::SCHEDULE].contains(&buffer) {
        return "runtime".to_owned();
    }
    let is = |index: usize| plan.buffers[index].spec.name == buffer;
    for process in &plan.processes {
        if process.outputs.iter().any(|&index| is(index)) || is(process.status_buffer) {
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
    if plan.inputs.iter().any(|input| is(input.buffer)) { "log".to_owned() } else { String::new() }
}
