//! Records on a separate thread, so that no process waits for a disk unless it is configured to.
//!
//! Callers hand over a reference to a message, and the recorder's thread encodes it. So the number of bytes in the
//! queue is an estimate: the size of a message that has been encoded already, else that of the last message of its
//! channel.

use crate::error::LogError;
use crate::writer::{ChannelId, LogWriter, WriteHeader};
use bytes::Bytes;
use rcs_msg::{AnyMessage, DELTA_OF, DELTA_SUFFIX, DeltaCodec, DeltaEncoder, Schema, Stamp, Stored};
use std::collections::{BTreeMap, VecDeque};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

/// Number of items taken from the queue at a time, so that locking and waking are shared by all of them.
const BATCH: usize = 256;
/// How long the thread lets items accumulate before it takes fewer than that.
const GATHER: Duration = Duration::from_millis(2);
/// Greatest number of written messages that wait to be freed; the recorder's thread frees further ones.
const MOST_WRITTEN: usize = 4 * BATCH;
/// For a message up to this size only the limit on the number of messages applies: a queue that is full of images still
/// accepts the commands, statuses and cycle records without which a run cannot be repeated.
const SMALL: usize = 1024;

/// What happens to a message when the queue is full.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RecorderMode {
    /// The caller waits, and nothing is lost. For stepped runs.
    Lossless,
    /// The message is dropped and counted, and the caller never waits. For live runs.
    Live,
}

/// Limits of a recorder's queue.
#[derive(Clone, Copy, Debug)]
pub struct RecorderOptions {
    /// What happens when the queue is full.
    pub mode: RecorderMode,
    /// Greatest number of messages in the queue.
    pub queue_messages: usize,
    /// Greatest estimated number of bytes in the queue; messages of up to 1 KiB are accepted beyond it.
    pub queue_bytes: usize,
    /// Called first on the recorder's thread, for example to set its priority.
    pub on_start: Option<fn()>,
}

impl Default for RecorderOptions {
    fn default() -> Self {
        Self { mode: RecorderMode::Lossless, queue_messages: 16_384, queue_bytes: 64 << 20, on_start: None }
    }
}

/// State of a recording.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RecorderStatus {
    /// Messages written.
    pub written: u64,
    /// Messages that are not in the log: dropped because the queue was full, or after an error.
    pub dropped: u64,
    /// Messages waiting.
    pub queued: u64,
    /// Size of the log in bytes, including closed chunks only.
    pub bytes: u64,
    /// The error that ended the recording, for example a full disk. Data flushed before remain readable.
    pub error: Option<String>,
    /// The last item that was left out because a log cannot hold it.
    pub refused: Option<String>,
}

enum Item {
    Channel {
        topic: String,
        schema: Arc<Schema>,
        metadata: BTreeMap<String, String>,
        codec: Option<&'static dyn DeltaCodec>,
    },
    Message {
        channel: ChannelId,
        header: WriteHeader,
        data: Data,
        estimate: usize,
    },
    Attachment {
        name: String,
        media_type: String,
        time: Stamp,
        data: Bytes,
    },
    Metadata {
        name: String,
        entries: BTreeMap<String, String>,
    },
    Flush,
}

/// A message in the queue.
enum Data {
    Bytes(Bytes),
    Message(AnyMessage),
}

impl Data {
    /// Its size if that is known without encoding it.
    fn known_len(&self) -> Option<usize> {
        match self {
            Data::Bytes(bytes) => Some(bytes.len()),
            Data::Message(message) => message.encoded_len(),
        }
    }
}

#[derive(Default)]
struct Queue {
    items: VecDeque<Item>,
    messages: usize,
    bytes: usize,
    channels: u32,
    /// For each channel, the size of the message that was encoded last.
    last_sizes: Vec<usize>,
    /// Number of flushes requested and done.
    flushes: (u64, u64),
    closed: bool,
    /// State of the writing thread.
    thread: Thread,
    /// Number of callers that wait for the queue to drain.
    waiting: usize,
    /// Small written messages, to be freed by the threads that write new ones. If one thread allocates memory and
    /// another one frees it, both wait for each other in the allocator.
    written: Vec<AnyMessage>,
    status: RecorderStatus,
}

/// State of the writing thread. It is woken only if it sleeps, because waking is a system call.
#[derive(Clone, Copy, Default, PartialEq, Eq)]
enum Thread {
    /// It will look into the queue by itself.
    #[default]
    Busy,
    /// It sleeps until the queue has an item.
    Asleep,
    /// It sleeps until the queue has many items, or for a short time.
    Gathering,
}

/// Result of a batch.
#[derive(Default)]
struct Done {
    messages: usize,
    bytes: usize,
    written: u64,
    dropped: u64,
    flushes: u64,
    /// Sizes of the encoded messages, in order.
    sizes: Vec<(ChannelId, usize)>,
    refused: Option<String>,
    failed: Option<LogError>,
    /// Small messages that were written.
    small: Vec<AnyMessage>,
}

struct Shared {
    options: RecorderOptions,
    queue: Mutex<Queue>,
    /// An item was added, or the queue was closed.
    filled: Condvar,
    /// Items were taken out or written.
    drained: Condvar,
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, Queue> {
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn put(&self, mut queue: MutexGuard<'_, Queue>, item: Item) {
        let urgent = !matches!(item, Item::Message { .. });
        queue.items.push_back(item);
        let much = urgent || queue.items.len() >= BATCH;
        if queue.thread == Thread::Asleep || (queue.thread == Thread::Gathering && much) {
            queue.thread = Thread::Busy;
            drop(queue);
            self.filled.notify_one();
        }
    }

    /// Waits until something has been written.
    fn wait_for_room<'a>(&self, mut queue: MutexGuard<'a, Queue>) -> MutexGuard<'a, Queue> {
        if queue.thread == Thread::Gathering {
            queue.thread = Thread::Busy;
            self.filled.notify_one();
        }
        queue.waiting += 1;
        queue = self.drained.wait(queue).unwrap_or_else(PoisonError::into_inner);
        queue.waiting -= 1;
        queue
    }
}

/// Adds messages to a recording, from any thread.
#[derive(Clone)]
pub struct RecorderHandle(Arc<Shared>);

impl RecorderHandle {
    /// Adds a topic. The returned number is valid for this recorder.
    pub fn add_channel(
        &self,
        topic: &str,
        schema: &Arc<Schema>,
        metadata: BTreeMap<String, String>,
    ) -> Result<ChannelId, LogError> {
        self.add_channel_with(topic, schema, metadata, None)
    }

    /// Adds a topic. With a codec its messages are stored as key frames and deltas; the deltas go into a second
    /// channel, see [`DeltaCodec`].
    pub fn add_channel_with(
        &self,
        topic: &str,
        schema: &Arc<Schema>,
        metadata: BTreeMap<String, String>,
        codec: Option<&'static dyn DeltaCodec>,
    ) -> Result<ChannelId, LogError> {
        let mut queue = self.0.lock();
        let id = u16::try_from(queue.channels).map_err(|_| LogError::Refused {
            what: "another topic",
            expected: "at most 65536 channels".to_owned(),
            got: "one more".to_owned(),
        })?;
        queue.channels += 1;
        queue.last_sizes.push(0);
        let (topic, schema) = (topic.to_owned(), Arc::clone(schema));
        self.0.put(queue, Item::Channel { topic, schema, metadata, codec });
        Ok(ChannelId(id))
    }

    /// Adds encoded bytes, like [`RecorderHandle::write_message`].
    pub fn write(&self, channel: ChannelId, header: WriteHeader, data: Bytes) -> bool {
        self.put_data(channel, header, Data::Bytes(data))
    }

    /// Adds a message, which the recorder's thread encodes. Returns whether it was accepted: it is not if the queue is
    /// full in [`RecorderMode::Live`], or after an error or the end of the recording.
    pub fn write_message(&self, channel: ChannelId, header: WriteHeader, message: AnyMessage) -> bool {
        self.put_data(channel, header, Data::Message(message))
    }

    fn put_data(&self, channel: ChannelId, header: WriteHeader, data: Data) -> bool {
        let RecorderOptions { mode, queue_messages, queue_bytes, .. } = self.0.options;
        let known = data.known_len();
        let mut queue = self.0.lock();
        let estimate = loop {
            let estimate = known
                .or_else(|| queue.last_sizes.get(usize::from(channel.0)).copied())
                .unwrap_or(0)
                .max(std::mem::size_of::<Item>());
            if queue.closed || queue.status.error.is_some() {
                queue.status.dropped += 1;
                return false;
            }
            // A message larger than the queue's limit is accepted by an empty queue.
            let full = queue.messages >= queue_messages
                || (estimate > SMALL && queue.bytes.saturating_add(estimate) > queue_bytes);
            if !full || queue.messages == 0 {
                break estimate;
            }
            if mode == RecorderMode::Live {
                queue.status.dropped += 1;
                return false;
            }
            queue = self.0.wait_for_room(queue);
        };
        queue.messages += 1;
        queue.bytes += estimate;
        // Two for one, so that the list is emptied.
        let freed = [queue.written.pop(), queue.written.pop()];
        self.0.put(queue, Item::Message { channel, header, data, estimate });
        drop(freed);
        true
    }

    /// Adds an attachment, which is never dropped.
    pub fn attach(&self, name: &str, media_type: &str, time: Stamp, data: Bytes) {
        let item = Item::Attachment { name: name.to_owned(), media_type: media_type.to_owned(), time, data };
        self.0.put(self.0.lock(), item);
    }

    /// Adds a metadata record, which is never dropped.
    pub fn metadata(&self, name: &str, entries: BTreeMap<String, String>) {
        self.0.put(self.0.lock(), Item::Metadata { name: name.to_owned(), entries });
    }

    /// Waits until everything added before is in the file.
    pub fn flush(&self) {
        let mut queue = self.0.lock();
        if queue.closed {
            return;
        }
        queue.flushes.0 += 1;
        let mine = queue.flushes.0;
        self.0.put(queue, Item::Flush);
        let mut queue = self.0.lock();
        while queue.flushes.1 < mine {
            queue = self.0.wait_for_room(queue);
        }
    }

    /// State of the recording.
    pub fn status(&self) -> RecorderStatus {
        let queue = self.0.lock();
        RecorderStatus { queued: queue.messages as u64, ..queue.status.clone() }
    }
}

/// A recording: a [`LogWriter`] behind a bounded queue. Dropping it ends the recording like [`Recorder::finish`].
pub struct Recorder {
    handle: RecorderHandle,
    thread: Option<JoinHandle<Result<(), LogError>>>,
}

impl Recorder {
    /// Starts the thread that writes.
    pub fn start(writer: LogWriter, options: RecorderOptions) -> std::io::Result<Self> {
        let shared = Arc::new(Shared {
            options,
            queue: Mutex::default(),
            filled: Condvar::new(),
            drained: Condvar::new(),
        });
        let theirs = Arc::clone(&shared);
        let thread = std::thread::Builder::new().name("recorder".to_owned()).spawn(move || {
            if let Some(on_start) = theirs.options.on_start {
                on_start();
            }
            // A panic while a message is encoded ends the recording, not the processes that write to it.
            let result = catch_unwind(AssertUnwindSafe(|| write_all(&theirs, writer))).unwrap_or_else(|_| {
                let error = panicked();
                theirs.lock().status.error = Some(error.to_string());
                abandon(&theirs);
                Err(error)
            });
            // Wakes callers that wait for the thread, because it has ended.
            let mut queue = theirs.lock();
            queue.closed = true;
            queue.flushes.1 = queue.flushes.0;
            drop(queue);
            theirs.drained.notify_all();
            result
        })?;
        Ok(Self { handle: RecorderHandle(shared), thread: Some(thread) })
    }

    /// The handle that adds messages.
    pub fn handle(&self) -> RecorderHandle {
        self.handle.clone()
    }

    /// State of the recording.
    pub fn status(&self) -> RecorderStatus {
        self.handle.status()
    }

    /// Writes the queued items and the log's summary. Returns the error that ended the recording, if any.
    pub fn finish(mut self) -> Result<RecorderStatus, LogError> {
        self.end()?;
        Ok(self.status())
    }

    fn end(&mut self) -> Result<(), LogError> {
        let Some(thread) = self.thread.take() else { return Ok(()) };
        self.handle.0.lock().closed = true;
        self.handle.0.filled.notify_all();
        self.handle.0.drained.notify_all();
        thread.join().unwrap_or_else(|_| Err(panicked()))
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        if let Err(error) = self.end() {
            tracing::error!(%error, "the recording could not be finished");
        }
    }
}

fn panicked() -> LogError {
    LogError::Refused {
        what: "the recording",
        expected: "a thread that writes".to_owned(),
        got: "a panic of it".to_owned(),
    }
}

fn write_all(shared: &Shared, mut writer: LogWriter) -> Result<(), LogError> {
    let mut channels: Vec<Option<Channel>> = Vec::new();
    let mut batch = Vec::with_capacity(BATCH);
    while take_batch(shared, &writer, &mut batch) {
        let mut done = write_batch(&mut writer, &mut channels, &mut batch);
        let mut queue = shared.lock();
        queue.messages -= done.messages;
        queue.bytes -= done.bytes;
        for (channel, size) in done.sizes {
            if let Some(last) = queue.last_sizes.get_mut(usize::from(channel.0)) {
                *last = size;
            }
        }
        queue.flushes.1 += done.flushes;
        queue.status.bytes = writer.bytes_written();
        queue.status.written += done.written;
        queue.status.dropped += done.dropped;
        let room = MOST_WRITTEN.saturating_sub(queue.written.len());
        done.small.truncate(room);
        queue.written.append(&mut done.small);
        if done.refused.is_some() {
            queue.status.refused = done.refused;
        }
        if let Some(error) = done.failed {
            queue.status.error = Some(error.to_string());
            drop(queue);
            abandon(shared);
            return Err(error);
        }
        let waited_for = queue.waiting > 0;
        drop(queue);
        if waited_for {
            shared.drained.notify_all();
        }
    }
    let written = writer.bytes_counter();
    writer.finish().inspect_err(|error| shared.lock().status.error = Some(error.to_string()))?;
    shared.lock().status.bytes = written.load(std::sync::atomic::Ordering::Relaxed);
    Ok(())
}

/// Processes the next batch, which is empty if only a flush is due. Returns whether the recording continues.
fn take_batch(shared: &Shared, writer: &LogWriter, batch: &mut Vec<Item>) -> bool {
    let mut queue = shared.lock();
    while queue.items.is_empty() && !queue.closed {
        queue.thread = Thread::Asleep;
        let Some(wait) = writer.time_to_flush() else {
            queue = shared.filled.wait(queue).unwrap_or_else(PoisonError::into_inner);
            continue;
        };
        if wait.is_zero() {
            break;
        }
        queue = shared.filled.wait_timeout(queue, wait).unwrap_or_else(PoisonError::into_inner).0;
    }
    if (1..BATCH).contains(&queue.items.len()) && !queue.closed && queue.waiting == 0 {
        queue.thread = Thread::Gathering;
        let wait = writer.time_to_flush().unwrap_or(GATHER).min(GATHER);
        queue = shared.filled.wait_timeout(queue, wait).unwrap_or_else(PoisonError::into_inner).0;
    }
    queue.thread = Thread::Busy;
    let count = queue.items.len().min(BATCH);
    batch.extend(queue.items.drain(..count));
    !(batch.is_empty() && queue.closed)
}

fn write_batch(writer: &mut LogWriter, channels: &mut Vec<Option<Channel>>, batch: &mut Vec<Item>) -> Done {
    let mut done = Done::default();
    if batch.is_empty() {
        done.take(writer.flush_if_due().map(|_| ()));
    }
    for item in batch.drain(..) {
        let estimate = if let Item::Message { estimate, .. } = &item { Some(*estimate) } else { None };
        done.messages += usize::from(estimate.is_some());
        done.bytes += estimate.unwrap_or(0);
        done.flushes += u64::from(matches!(item, Item::Flush));
        // After an error that ends the recording, the rest of the batch is lost, too.
        let is_written = done.failed.is_none() && {
            let stepped = step(writer, channels, item, &mut done.sizes, &mut done.small);
            done.take(stepped)
        };
        if estimate.is_some() {
            done.written += u64::from(is_written);
            done.dropped += u64::from(!is_written);
        }
    }
    done
}

impl Done {
    /// Records the result of one item, and returns whether it succeeded.
    fn take(&mut self, result: Result<(), LogError>) -> bool {
        match result {
            Ok(()) => return true,
            Err(error @ LogError::Refused { .. }) => self.refused = Some(error.to_string()),
            Err(error) => self.failed = Some(error),
        }
        false
    }
}

/// After an error: counts the queued items as dropped.
fn abandon(shared: &Shared) {
    let mut queue = shared.lock();
    queue.status.dropped += queue.messages as u64;
    (queue.messages, queue.bytes) = (0, 0);
    queue.items.clear();
    drop(queue);
    shared.drained.notify_all();
}

/// A channel of the file.
struct Channel {
    id: ChannelId,
    /// Size of the message that was written last; large for a new channel.
    last_size: usize,
    /// The channel of its deltas, and their encoder.
    deltas: Option<(ChannelId, Box<dyn DeltaEncoder>)>,
}

impl Channel {
    fn add(
        writer: &mut LogWriter,
        topic: &str,
        schema: &Schema,
        mut metadata: BTreeMap<String, String>,
        codec: Option<&'static dyn DeltaCodec>,
    ) -> Result<Self, LogError> {
        let id = writer.add_channel(topic, schema, &metadata)?;
        let last_size = usize::MAX;
        let Some(codec) = codec else { return Ok(Self { id, last_size, deltas: None }) };
        metadata.insert(DELTA_OF.to_owned(), topic.to_owned());
        let deltas =
            writer.add_channel(&format!("{topic}{DELTA_SUFFIX}"), &codec.delta_schema(), &metadata)?;
        Ok(Self { id, last_size, deltas: Some((deltas, codec.encoder())) })
    }

    /// Writes a message in the form that its encoder chooses; returns the result and its size.
    fn write(
        &mut self,
        writer: &mut LogWriter,
        header: WriteHeader,
        data: &Data,
    ) -> (Result<(), LogError>, usize) {
        let (mut id, mut bytes) = (self.id, None);
        if let (Some((deltas, encoder)), Data::Message(message)) = (&mut self.deltas, data)
            && let Stored::Delta(delta) = encoder.encode(header.sequence, header.log_time, message)
        {
            (id, bytes) = (*deltas, Some(delta));
        }
        let bytes = bytes.unwrap_or_else(|| match data {
            Data::Bytes(bytes) => bytes.clone(),
            // What is small is encoded again where someone else wants its bytes, rather than kept with the message.
            Data::Message(message) if self.last_size <= SMALL => message.encode(),
            Data::Message(message) => message.bytes(),
        });
        self.last_size = bytes.len();
        let written = writer.write(id, header, &bytes);
        if let (Err(_), Some((_, encoder))) = (&written, &mut self.deltas) {
            encoder.lost();
        }
        (written, bytes.len())
    }
}

fn step(
    writer: &mut LogWriter,
    channels: &mut Vec<Option<Channel>>,
    item: Item,
    sizes: &mut Vec<(ChannelId, usize)>,
    small: &mut Vec<AnyMessage>,
) -> Result<(), LogError> {
    match item {
        Item::Channel { topic, schema, metadata, codec } => {
            let (channel, result) = match Channel::add(writer, &topic, &schema, metadata, codec) {
                Ok(channel) => (Some(channel), Ok(())),
                Err(error) => (None, Err(error)),
            };
            channels.push(channel);
            result
        }
        Item::Message { channel, header, data, .. } => {
            let known = channels.get_mut(usize::from(channel.0)).and_then(Option::as_mut);
            let known = known.ok_or_else(|| LogError::Refused {
                what: "a message",
                expected: "a channel of this recorder".to_owned(),
                got: format!("channel {}", channel.0),
            })?;
            let (written, size) = known.write(writer, header, &data);
            sizes.push((channel, size));
            if let Data::Message(message) = data
                && size <= SMALL
            {
                small.push(message);
            }
            written
        }
        Item::Attachment { name, media_type, time, data } => writer.attach(&name, &media_type, time, &data),
        Item::Metadata { name, entries } => writer.metadata(&name, entries),
        Item::Flush => writer.flush(),
    }
}
