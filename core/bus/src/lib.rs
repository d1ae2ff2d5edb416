//! Buffers: NML's named mailboxes of one message type each.
//!
//! - [`Buffer`]: latest-only or a queue of N with a stated [`Overflow`] rule; many readers, many writers.
//! - [`Reader`], [`Writer`]: neither ever waits.
//! - Taps see every message in order; nothing is encoded unless a tap asks for bytes.
//! - Overrides replace a field or a whole message at the moment of publishing; one that does not fit is dropped, and
//!   the message passes.
//! - [`Bus`]: the buffers of one run.
//!
//! Everything is behind one lock a buffer.

mod buffer;
mod bus;
mod overrides;
mod sample;

pub use buffer::{Buffer, BufferSpec, BufferState, Mode, Overflow, Reader, Tap, WriteError, Writer};
pub use bus::{Bus, BusError};
pub use overrides::{Due, Override, OverrideChanges, OverrideMode, OverrideValue, Release, Scalar};
pub use sample::{Draft, Header, Sample, WriterId};
