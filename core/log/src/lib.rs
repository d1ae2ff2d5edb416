//! Logs: reading, writing and recovering indexed MCAP files, with a cursor in time order.
//!
//! A log of any size is read with positioned reads and bounded caches. Damage is not an error: the readable part is
//! recovered, and losses are counted and reported.
//!
//! This crate knows no processes and runs nothing: `rcs-runtime` replays logs through stacks. Begin with [`Log::open`]
//! to read and [`LogWriter::create`] to write; [`Recorder`] writes on a thread of its own.
//!
//! ```
//! use rcs_log::{CursorOptions, Log, LogWriter, WriteHeader, WriterOptions};
//! use rcs_msg::{Stamp, registry};
//! use std::collections::BTreeMap;
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # let folder = tempfile::tempdir()?;
//! # let path = folder.path().join("drive.mcap");
//! let mut writer = LogWriter::create(&path, WriterOptions::default())?;
//! let schema = registry().schema("foxglove.Pose").ok_or("no such schema")?;
//! let pose = writer.add_channel("/pose", schema, &BTreeMap::new())?;
//! let header = WriteHeader { sequence: 1, log_time: Stamp(10), publish_time: Stamp(10) };
//! writer.write(pose, header, b"")?;
//! writer.finish()?;
//!
//! let log = Log::open(&path)?;
//! assert_eq!(log.info().messages, 1);
//! for message in log.cursor(CursorOptions::default()) {
//!     assert_eq!(message?.log_time, Stamp(10));
//! }
//! # Ok(())
//! # }
//! ```
//!
//! The record types and the writer are those of the crate `mcap`. Its readers are not used, because they stop at the
//! first damaged record, panic on some, copy the complete chunk index for every cursor, and cannot continue at an exact
//! message. The readers here recover, share one cache, and order messages totally.

mod cache;
mod catalog;
mod check;
mod cursor;
mod error;
mod find;
mod gaps;
mod identity;
mod indexed;
mod info;
mod log;
mod output;
mod parse;
mod parts;
mod pieces;
mod rates;
mod reassembly;
mod record;
mod recorder;
mod scan;
mod segment;
mod source;
mod split;
mod summary;
mod times;
mod verify;
mod writer;

pub use cursor::{Cursor, CursorOptions, Position};
pub use error::LogError;
pub use gaps::Gap;
pub use info::{
    Attachment, AttachmentInfo, COMPLETE_FROM, LogInfo, LogMessage, LogTopic, Lost, MessagePosition,
    Metadata, TopicId,
};
pub use log::Log;
pub use pieces::{Piece, PieceMessage};
pub use reassembly::{Reassembled, Reassembly};
pub use recorder::{Recorder, RecorderHandle, RecorderMode, RecorderOptions, RecorderStatus};
pub use times::TimesOf;
pub use verify::Verification;
pub use writer::{ChannelId, Clock, FORMAT_VERSION, LogWriter, Sink, WriteHeader, WriterOptions};
