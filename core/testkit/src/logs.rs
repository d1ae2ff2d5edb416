//! Logs that tests write for themselves.

use rcs_log::{CursorOptions, Log, LogError, LogWriter, Sink, WriteHeader, WriterOptions};
use rcs_msg::{AnyMessage, Schema, Stamp, foxglove, registry};
use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

/// A destination in memory: its bytes remain when the writer is dropped, and it is full at a given size.
#[derive(Clone, Debug, Default)]
pub struct SharedSink {
    bytes: Arc<Mutex<Vec<u8>>>,
    room: Option<usize>,
}

impl SharedSink {
    /// A sink that takes `room` bytes, and then refuses writes like a full disk.
    pub fn with_room(room: usize) -> Self {
        Self { bytes: Arc::default(), room: Some(room) }
    }

    /// The bytes written so far.
    pub fn snapshot(&self) -> Vec<u8> {
        self.bytes.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

impl Write for SharedSink {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut held = self.bytes.lock().unwrap_or_else(PoisonError::into_inner);
        let room = self.room.map_or(usize::MAX, |room| room.saturating_sub(held.len()));
        if room == 0 {
            return Err(io::ErrorKind::StorageFull.into());
        }
        let count = bytes.len().min(room);
        held.extend_from_slice(&bytes[..count]);
        Ok(count)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Sink for SharedSink {}

/// A log in memory with these topics and messages: time, topic, message. The acquisition time of a message is also its
/// log time.
///
/// # Panics
/// If the log cannot be written, or the topic of a message is not in the log.
pub fn hand_made<'a>(
    topics: &[(&str, &Arc<Schema>)],
    messages: impl IntoIterator<Item = (Stamp, &'a str, &'a AnyMessage)>,
) -> Log {
    let folder = tempfile::tempdir().unwrap_or_else(|error| panic!("no folder for a log: {error}"));
    let path = folder.path().join("hand_made.mcap");
    let write = || -> Result<(), LogError> {
        let mut writer = LogWriter::create(&path, WriterOptions::default())?;
        let mut channels = BTreeMap::new();
        for (topic, schema) in topics {
            channels.insert(*topic, writer.add_channel(topic, schema, &BTreeMap::new())?);
        }
        for (sequence, (time, topic, message)) in (0..).zip(messages) {
            let channel = channels.get(topic).unwrap_or_else(|| panic!("the log has no topic {topic}"));
            let header = WriteHeader { sequence, log_time: time, publish_time: time };
            writer.write(*channel, header, &message.bytes())?;
        }
        writer.finish()
    };
    write().unwrap_or_else(|error| panic!("{error}"));
    let bytes = std::fs::read(&path).unwrap_or_else(|error| panic!("{error}"));
    Log::from_bytes(bytes.into()).unwrap_or_else(|error| panic!("{error}"))
}

/// Poses per image in [`write_big`].
pub const POSES_PER_IMAGE: u64 = 10;
/// Time between images of [`write_big`].
pub const IMAGE_PERIOD_NS: u64 = 50_000_000;

/// Writes an indexed log of about `bytes` bytes: `/camera` with images of 1024×1024 grey pixels of noise, which do not
/// compress, at 20 Hz, and `/pose` at 200 Hz. Returns the number of messages.
pub fn write_big(path: impl AsRef<Path>, bytes: u64) -> Result<u64, LogError> {
    const SIDE: u32 = 1024;
    const PIXELS: usize = (SIDE * SIDE) as usize;
    let mut writer =
        LogWriter::create(path, WriterOptions { chunk_bytes: 4 << 20, ..WriterOptions::default() })?;
    let mut channel = |topic: &str, name: &'static str| {
        let schema = registry().schema(name).ok_or_else(|| LogError::Refused {
            what: "a topic",
            expected: "a schema of the registry".to_owned(),
            got: name.to_owned(),
        })?;
        writer.add_channel(topic, schema, &BTreeMap::new())
    };
    let camera = channel("/camera", "foxglove.RawImage")?;
    let pose = channel("/pose", "foxglove.PoseInFrame")?;

    let mut number = 0x2545_f491_4f6c_dd1d_u64;
    let mut noise = || {
        number ^= number << 13;
        number ^= number >> 7;
        number ^= number << 17;
        number.to_le_bytes()
    };

    let images = bytes.div_ceil(PIXELS as u64);
    let mut messages = 0;
    for image in 0..images {
        let time = image * IMAGE_PERIOD_NS;
        for step in 0..POSES_PER_IMAGE {
            let at = Stamp(time + step * IMAGE_PERIOD_NS / POSES_PER_IMAGE);
            let position = foxglove::Vector3 { x: at.0 as f64 * 1e-9, y: 1.0, z: 0.0 };
            let message = foxglove::PoseInFrame {
                timestamp: Some(at.to_proto()),
                frame_id: "local".to_owned(),
                pose: Some(foxglove::Pose { position: Some(position), orientation: None }),
            };
            let sequence = (image * POSES_PER_IMAGE + step) as u32;
            let header = WriteHeader { sequence, log_time: at, publish_time: at };
            writer.write(pose, header, &AnyMessage::new(message).bytes())?;
            messages += 1;
        }
        // New noise for each image, because repetitions within a chunk would compress.
        let pixels: Vec<u8> = std::iter::repeat_with(&mut noise).take(PIXELS / 8).flatten().collect();
        let message = foxglove::RawImage {
            timestamp: Some(Stamp(time).to_proto()),
            frame_id: "camera".to_owned(),
            width: SIDE,
            height: SIDE,
            encoding: "mono8".to_owned(),
            step: SIDE,
            data: pixels.into(),
        };
        let at = Stamp(time + 7);
        let header = WriteHeader { sequence: image as u32, log_time: at, publish_time: Stamp(time) };
        writer.write(camera, header, &AnyMessage::new(message).bytes())?;
        messages += 1;
    }
    writer.finish()?;
    Ok(messages)
}

/// Copies a log and changes some messages: `change` gets the topic, sequence and bytes of each.
pub fn copy_changed(
    from: &Log,
    to: impl AsRef<Path>,
    change: impl FnMut(&str, u32, &mut Vec<u8>),
) -> Result<(), LogError> {
    copy(from, to, |_| true, change)
}

/// Copies a log into two files: what was logged before a time, and the rest.
pub fn split(from: &Log, at: Stamp, parts: [&Path; 2]) -> Result<(), LogError> {
    for (index, part) in parts.into_iter().enumerate() {
        copy(from, part, |time| (time >= at) == (index == 1), |_, _, _| {})?;
    }
    Ok(())
}

fn copy(
    from: &Log,
    to: impl AsRef<Path>,
    wanted: impl Fn(Stamp) -> bool,
    mut change: impl FnMut(&str, u32, &mut Vec<u8>),
) -> Result<(), LogError> {
    let about = from.metadata().iter().find(|metadata| metadata.name == "ocu");
    let metadata = about.map(|about| about.entries.clone()).unwrap_or_default();
    let mut writer = LogWriter::create(to, WriterOptions { metadata, ..WriterOptions::default() })?;
    // A topic without messages is in the copy, too.
    let mut channels = BTreeMap::new();
    for topic in &from.info().topics {
        channels.insert(topic.id, writer.add_channel(&topic.name, &topic.schema, &topic.metadata)?);
    }
    for message in from.cursor(CursorOptions::default()) {
        let message = message?;
        let topic = from.info().topic(message.topic).filter(|_| wanted(message.log_time));
        let Some((topic, &channel)) = topic.zip(channels.get(&message.topic)) else { continue };
        let mut data = message.data.to_vec();
        change(&topic.name, message.sequence, &mut data);
        let header = WriteHeader {
            sequence: message.sequence,
            log_time: message.log_time,
            publish_time: message.publish_time,
        };
        writer.write(channel, header, &data)?;
    }
    for metadata in from.metadata().iter().filter(|metadata| metadata.name != "ocu") {
        writer.metadata(&metadata.name, metadata.entries.clone())?;
    }
    writer.finish()
}
