//! A control that is held: a message that is written again and again while someone holds a key, a button or a stick.

use rcs_msg::{AnyMessage, Stamp};
use std::fmt;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// What is held.
#[derive(Clone)]
pub struct HeldControl {
    /// Name of the buffer.
    pub buffer: String,
    /// Time of the source from one message to the next, in nanoseconds; at least a millisecond.
    pub every_ns: u64,
    /// Makes the message for a time of the source.
    pub make: Arc<dyn Fn(Stamp) -> AnyMessage + Send + Sync>,
}

impl HeldControl {
    /// Without a word from whoever holds it, it is let go after this long: a window that hangs drives nothing.
    pub const LEASE: Duration = Duration::from_millis(600);
}

impl fmt::Debug for HeldControl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "HeldControl({} every {} ns)", self.buffer, self.every_ns)
    }
}

/// All that is held now, a buffer once.
#[derive(Debug, Default)]
pub(super) struct HeldControls(Vec<Entry>);

#[derive(Debug)]
struct Entry {
    held: HeldControl,
    /// When someone last said that it is held.
    renewed: Instant,
    /// When the next message is due.
    due: Stamp,
}

impl HeldControls {
    /// Takes hold, or holds on; another value than before is due at once.
    pub(super) fn hold(&mut self, held: HeldControl, clock: Instant, now: Stamp) {
        match self.0.iter_mut().find(|entry| entry.held.buffer == held.buffer) {
            Some(entry) => {
                if !Arc::ptr_eq(&entry.held.make, &held.make) {
                    entry.due = entry.due.min(now);
                }
                (entry.held, entry.renewed) = (held, clock);
            }
            None => self.0.push(Entry { held, renewed: clock, due: now }),
        }
    }

    /// Lets go.
    pub(super) fn let_go(&mut self, buffer: &str) {
        self.0.retain(|entry| entry.held.buffer != buffer);
    }

    /// Lets go of what nobody has spoken for.
    pub(super) fn drop_lapsed(&mut self, clock: Instant) {
        self.0.retain(|entry| clock.saturating_duration_since(entry.renewed) <= HeldControl::LEASE);
    }

    /// The source went to another time: what is due is due from there.
    pub(super) fn moved(&mut self, now: Stamp) {
        for entry in &mut self.0 {
            entry.due = now;
        }
    }

    /// When the next message is due.
    pub(super) fn next_due(&self) -> Option<Stamp> {
        self.0.iter().map(|entry| entry.due).min()
    }

    /// The messages that are due at `now`.
    pub(super) fn take_due(&mut self, now: Stamp) -> Vec<(String, AnyMessage)> {
        let due = self.0.iter_mut().filter(|entry| entry.due <= now);
        due.map(|entry| {
            entry.due = now.after_ns(entry.held.every_ns.max(1_000_000));
            (entry.held.buffer.clone(), (entry.held.make)(now))
        })
        .collect()
    }
}
