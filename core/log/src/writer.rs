//! Writes logs: zstd chunks that are closed by size and by time.

use crate::error::LogError;
use crate::output::Output;
use mcap::McapError;
use mcap::records::MessageHeader;
use rcs_msg::{Schema, Stamp};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Version of our conventions, in the metadata record `ocu` of a log.
pub const FORMAT_VERSION: u32 = 1;

/// A topic of a log that is being written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ChannelId(pub u16);

/// Header of a message to be written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WriteHeader {
    /// Sequence number of the message in its topic.
    pub sequence: u32,
    /// Log time, by which the log is ordered.
    pub log_time: Stamp,
    /// When it was published.
    pub publish_time: Stamp,
}

/// Clock for the chunks' time limit: time since any fixed moment.
pub type Clock = Arc<dyn Fn() -> Duration + Send + Sync>;

/// Options of a log writer.
#[derive(Clone)]
pub struct WriterOptions {
    /// The header's profile.
    pub profile: String,
    /// Build of the writing program: `ocu 0.1.0`; stored in the metadata record `ocu` beside the format version.
    pub build: String,
    /// Further entries of the metadata record `ocu`, such as the stack's hash.
    pub metadata: BTreeMap<String, String>,
    /// Whether chunks are compressed with zstd.
    pub compress: bool,
    /// A chunk is closed when its contents are larger than this.
    pub chunk_bytes: u64,
    /// A chunk is closed when its first message is older than this, which limits the loss when the program is killed.
    pub chunk_age: Duration,
    /// The clock for `chunk_age`; the system's monotonic clock by default.
    pub clock: Clock,
    /// Whether an existing file may be replaced; otherwise it is an error.
    pub replace: bool,
}

impl Default for WriterOptions {
    fn default() -> Self {
        let start = Instant::now();
        Self {
            profile: "ocu".to_owned(),
            build: concat!("ocu ", env!("CARGO_PKG_VERSION")).to_owned(),
            metadata: BTreeMap::new(),
            compress: true,
            chunk_bytes: 1 << 20,
            // Slightly less than a second, because closing and writing a chunk takes time.
            chunk_age: Duration::from_millis(900),
            clock: Arc::new(move || start.elapsed()),
            replace: false,
        }
    }
}

impl std::fmt::Debug for WriterOptions {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("WriterOptions")
            .field("profile", &self.profile)
            .field("build", &self.build)
            .field("compress", &self.compress)
            .field("chunk_bytes", &self.chunk_bytes)
            .field("chunk_age", &self.chunk_age)
            .finish_non_exhaustive()
    }
}

/// Destination of a log's bytes.
pub trait Sink: Write + Send {
    /// Makes the data written so far durable, if possible.
    fn sync(&mut self) -> io::Result<()> {
        self.flush()
    }
}

impl Sink for BufWriter<File> {
    fn sync(&mut self) -> io::Result<()> {
        self.flush()?;
        self.get_ref().sync_all()
    }
}

impl Sink for Vec<u8> {}

/// Counts bytes, so that the format's writer knows its position without a seek.
struct Counted {
    sink: Box<dyn Sink>,
    written: Arc<AtomicU64>,
}

impl Counted {
    fn position(&self) -> u64 {
        self.written.load(Ordering::Relaxed)
    }
}

impl Write for Counted {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let count = self.sink.write(bytes)?;
        self.written.fetch_add(count as u64, Ordering::Relaxed);
        Ok(count)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.sink.flush()
    }
}

impl Seek for Counted {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        match to {
            SeekFrom::Current(0) | SeekFrom::End(0) => Ok(self.position()),
            SeekFrom::Start(at) if at == self.position() => Ok(at),
            _ => Err(io::Error::new(io::ErrorKind::Unsupported, "a log is written from front to back")),
        }
    }
}

/// Writes a log sequentially.
///
/// After an error nothing more is written, and every further call returns an error; what was flushed before can be
/// opened. If a writer is dropped without [`LogWriter::finish`], its summary is written if possible.
pub struct LogWriter {
    writer: mcap::Writer<Counted>,
    path: PathBuf,
    chunk_age: Duration,
    clock: Clock,
    oldest_unflushed: Option<Duration>,
    failed: Option<String>,
    written: Arc<AtomicU64>,
}

impl LogWriter {
    /// Creates the file at `path`. An existing file is replaced only if the options allow it, and is removed when the
    /// new one has begun; a file that another recorder is writing is refused.
    pub fn create(path: impl AsRef<Path>, options: WriterOptions) -> Result<Self, LogError> {
        let path = path.as_ref().to_owned();
        let mut output = Output::create(&path, options.replace)?;
        let failed = |source| LogError::Create { path: path.clone(), source };
        let file = output.take_file().ok_or_else(|| failed(io::Error::other("no file was made")))?;
        let sink = Box::new(BufWriter::with_capacity(1 << 16, file));
        let log = Self::with_sink(sink, path.clone(), options)?;
        output.begun().map_err(failed)?;
        Ok(log)
    }

    /// Writes into `sink`; errors contain `path`.
    pub fn with_sink(sink: Box<dyn Sink>, path: PathBuf, options: WriterOptions) -> Result<Self, LogError> {
        let WriterOptions {
            profile,
            build,
            mut metadata,
            compress,
            chunk_bytes,
            chunk_age,
            clock,
            replace: _,
        } = options;
        let written = Arc::new(AtomicU64::new(0));
        let counted = Counted { sink, written: Arc::clone(&written) };
        let writer = mcap::WriteOptions::new()
            .profile(profile)
            .library(build.clone())
            .compression(compress.then_some(mcap::Compression::Zstd))
            .compression_threads(0)
            .chunk_size(Some(chunk_bytes))
            .disable_seeking(true)
            .create(counted)
            .map_err(|error| LogError::Write { offset: 0, path: path.clone(), source: into_io(error) })?;
        let mut log = Self { writer, path, chunk_age, clock, oldest_unflushed: None, failed: None, written };
        metadata.insert("format".to_owned(), FORMAT_VERSION.to_string());
        metadata.insert("build".to_owned(), build);
        log.metadata("ocu", metadata)?;
        log.flush()?;
        Ok(log)
    }

    /// Adds a topic. The same topic, schema and metadata give the same number again.
    pub fn add_channel(
        &mut self,
        topic: &str,
        schema: &Schema,
        metadata: &BTreeMap<String, String>,
    ) -> Result<ChannelId, LogError> {
        self.attempt(|writer| {
            let no_schema = schema.name().is_empty() && schema.data().is_empty();
            let id = if no_schema {
                0
            } else {
                writer.add_schema(schema.name(), schema.schema_encoding(), schema.data())?
            };
            writer.add_channel(id, topic, schema.message_encoding().name(), metadata).map(ChannelId)
        })
        .inspect(|_| self.note_unflushed())
    }

    /// Appends a message, and closes the chunk if it is old enough.
    pub fn write(&mut self, channel: ChannelId, header: WriteHeader, data: &[u8]) -> Result<(), LogError> {
        let header = MessageHeader {
            channel_id: channel.0,
            sequence: header.sequence,
            log_time: header.log_time.0,
            publish_time: header.publish_time.0,
        };
        self.attempt(|writer| writer.write_to_known_channel(&header, data))?;
        self.note_unflushed();
        self.flush_if_due().map(|_| ())
    }

    /// Appends an attachment and flushes.
    pub fn attach(&mut self, name: &str, media_type: &str, time: Stamp, data: &[u8]) -> Result<(), LogError> {
        let attachment = mcap::Attachment {
            log_time: time.0,
            create_time: time.0,
            name: name.to_owned(),
            media_type: media_type.to_owned(),
            data: data.into(),
        };
        self.attempt(|writer| writer.attach(&attachment))?;
        self.flush()
    }

    /// Appends a metadata record and flushes.
    pub fn metadata(&mut self, name: &str, entries: BTreeMap<String, String>) -> Result<(), LogError> {
        let record = mcap::records::Metadata { name: name.to_owned(), metadata: entries };
        self.attempt(|writer| writer.write_metadata(&record))?;
        self.flush()
    }

    /// Closes the chunk and hands all data to the system, so that killing the program later does not lose them.
    pub fn flush(&mut self) -> Result<(), LogError> {
        self.attempt(mcap::Writer::flush)?;
        self.oldest_unflushed = None;
        Ok(())
    }

    /// Flushes if the oldest unflushed message has reached the age limit. Returns whether it did.
    pub fn flush_if_due(&mut self) -> Result<bool, LogError> {
        let due = self.time_to_flush().is_some_and(|left| left.is_zero());
        if due {
            self.flush()?;
        }
        Ok(due)
    }

    /// Time until a flush is due; `None` if there is nothing to flush.
    pub fn time_to_flush(&self) -> Option<Duration> {
        self.oldest_unflushed.map(|since| (since + self.chunk_age).saturating_sub((self.clock)()))
    }

    /// Bytes written to the file so far.
    pub fn bytes_written(&self) -> u64 {
        self.written.load(Ordering::Relaxed)
    }

    /// A handle on [`LogWriter::bytes_written`] that stays valid after the writer is finished.
    pub(crate) fn bytes_counter(&self) -> Arc<AtomicU64> {
        Arc::clone(&self.written)
    }

    /// Writes the summary and syncs the file. From then on the log opens by its index.
    pub fn finish(mut self) -> Result<(), LogError> {
        self.attempt(|writer| writer.finish().map(|_| ()))?;
        let Self { writer, path, written, .. } = self;
        let offset = written.load(Ordering::Relaxed);
        writer.into_inner().sink.sync().map_err(|source| LogError::Write { offset, path, source })
    }

    fn note_unflushed(&mut self) {
        if self.oldest_unflushed.is_none() {
            self.oldest_unflushed = Some((self.clock)());
        }
    }

    /// Runs one step of the format's writer; keeps the first failure of the sink, after which nothing more is
    /// attempted.
    fn attempt<T>(
        &mut self,
        step: impl FnOnce(&mut mcap::Writer<Counted>) -> Result<T, McapError>,
    ) -> Result<T, LogError> {
        if let Some(message) = &self.failed {
            let source = io::Error::other(message.clone());
            return Err(LogError::Write { offset: self.bytes_written(), path: self.path.clone(), source });
        }
        step(&mut self.writer).map_err(|error| match error {
            McapError::UnknownChannel(_, channel) => LogError::Refused {
                what: "a message",
                expected: "a channel that was added".to_owned(),
                got: format!("channel {channel}"),
            },
            McapError::TooManyChannels | McapError::TooManySchemas => LogError::Refused {
                what: "another topic",
                expected: "at most 65535 channels and schemas".to_owned(),
                got: "one more".to_owned(),
            },
            other => {
                let source = into_io(other);
                self.failed = Some(source.to_string());
                LogError::Write { offset: self.bytes_written(), path: self.path.clone(), source }
            }
        })
    }
}

fn into_io(error: McapError) -> io::Error {
    match error {
        McapError::Io(source) => source,
        other => io::Error::other(other),
    }
}
