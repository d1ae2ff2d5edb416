//! Helpers of the tests.

use bytes::Bytes;
use rcs_log::{ChannelId, CursorOptions, Log, LogMessage, LogWriter, WriteHeader, WriterOptions};
use rcs_msg::{MessageEncoding, Schema, Stamp};
pub(crate) use rcs_testkit::logs::SharedSink;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Every message, in the cursor's order; a failed read fails the test.
pub(crate) fn read_all(log: &Log) -> Vec<LogMessage> {
    log.cursor(CursorOptions::default()).map(Result::unwrap).collect()
}

/// A message without its position, which depends on how the log was opened.
pub(crate) type Plain = (u16, u32, u64, u64, Bytes);

pub(crate) fn plain(messages: Vec<LogMessage>) -> Vec<Plain> {
    messages.into_iter().map(|m| (m.topic.0, m.sequence, m.log_time.0, m.publish_time.0, m.data)).collect()
}

/// Every log below a folder, sorted by path.
pub(crate) fn logs_under(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(logs_under(&path));
        } else if path.extension().is_some_and(|extension| extension == "mcap") {
            found.push(path);
        }
    }
    found.sort();
    found
}

/// A small pseudo-random generator with a literal seed.
pub(crate) struct Numbers(pub(crate) u64);

impl Numbers {
    pub(crate) fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    pub(crate) fn below(&mut self, limit: usize) -> usize {
        (self.next() % limit as u64) as usize
    }
}

pub(crate) fn schema() -> Schema {
    Schema::new(
        "test.Text",
        MessageEncoding::Json,
        "jsonschema",
        Bytes::from_static(b"{\"type\":\"string\"}"),
    )
}

/// A writer into `sink` with `topics` topics `/0`, `/1`, ….
pub(crate) fn writer(
    sink: &SharedSink,
    options: WriterOptions,
    topics: usize,
) -> (LogWriter, Vec<ChannelId>) {
    let mut writer = LogWriter::with_sink(Box::new(sink.clone()), PathBuf::from("memory"), options).unwrap();
    let channels = (0..topics)
        .map(|topic| writer.add_channel(&format!("/{topic}"), &schema(), &BTreeMap::new()).unwrap())
        .collect();
    (writer, channels)
}

pub(crate) fn header(sequence: usize, time: u64) -> WriteHeader {
    WriteHeader { sequence: sequence as u32, log_time: Stamp(time), publish_time: Stamp(time) }
}

/// A log in memory with the given messages: topic, log time, size. Message `i` has sequence `i`.
pub(crate) fn log_of(messages: &[(usize, u64, usize)], options: WriterOptions) -> Bytes {
    let sink = SharedSink::default();
    let topics = messages.iter().map(|m| m.0 + 1).max().unwrap_or(0);
    let (mut writer, channels) = writer(&sink, options, topics);
    for (index, &(topic, time, size)) in messages.iter().enumerate() {
        writer.write(channels[topic], header(index, time), &vec![index as u8; size]).unwrap();
    }
    writer.finish().unwrap();
    sink.snapshot().into()
}
