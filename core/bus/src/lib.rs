//! Buffers: NML's named mailboxes, each with one message type.
//!
//! - [`Buffer`]: holds the newest message only, or a queue of N messages with an [`Overflow`] rule; it can have several
//!   readers and writers.
//! - [`Reader`], [`Writer`]: neither of them ever waits.
//! - Taps see every message in order; nothing is encoded unless a tap asks for bytes.
//! - Overrides replace a field or a complete message when it is published. An override that does not fit is dropped,
//!   and the message passes unchanged.
//! - [`Bus`]: the buffers of one run.
//!
//! Each buffer is guarded by one mutex; correctness never depends on atomic memory ordering.
//!
//! This crate does not schedule, record or transmit: `rcs-runtime` runs the processes that use the buffers, and
//! `rcs-log` records them. Begin with [`Buffer::new`]:
//!
//! ```
//! use rcs_bus::{Buffer, BufferSpec, Draft, Mode, WriterId};
//! use rcs_msg::{AnyMessage, Stamp, foxglove::Vector2, schema_of};
//! use std::sync::Arc;
//! let schema = Arc::clone(schema_of::<Vector2>());
//! let spec = BufferSpec { name: "/goal".to_owned(), schema, mode: Mode::Latest, metadata: Default::default() };
//! let buffer = Buffer::new(spec);
//! let (mut reader, writer) = (buffer.reader(), buffer.writer(WriterId::OPERATOR));
//! let message = AnyMessage::new(Vector2 { x: 1.0, y: 2.0 });
//! writer.write(Draft { log_time: Stamp(10), acq_time: Stamp(8), message })?;
//! let sample = reader.read().expect("one message");
//! assert_eq!(sample.header.sequence, 1);
//! assert_eq!(sample.message.get::<Vector2>().map(|goal| goal.x), Some(1.0));
//! # Ok::<(), rcs_bus::WriteError>(())
//! ```

mod buffer;
mod bus;
mod faults;
mod overrides;
mod sample;
mod tree;

pub use buffer::{Buffer, BufferSpec, BufferState, Mode, Overflow, Reader, Tap, WriteError, Writer};
pub use bus::{Bus, BusError};
pub use faults::{Fault, FaultKind, Loss};
pub use overrides::{Due, Override, OverrideChanges, OverrideMode, OverrideValue, Release, Scalar};
pub use sample::{Draft, Header, Sample, WriterId};
