//! A hand on a control: a message that is written again and again while someone holds a key, a button or a stick.

use rcs_msg::{AnyMessage, Stamp};
use std::fmt;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// What is held.
#[derive(Clone)]
pub struct Held {
    /// Name of the buffer.
    pub buffer: String,
    /// Time of the source from one message to the next, in nanoseconds; at least a millisecond.
    pub every_ns: u64,
    /// Makes the message for a time of the source.
    pub make: Arc<dyn Fn(Stamp) -> AnyMessage + Send + Sync>,
}

impl Held {
    /// Without a word from whoever holds it, a hand lets go after this long: a window that hangs drives nothing.
    pub const LEASE: Duration = Duration::from_millis(600);
}

impl fmt::Debug for Held {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Held({} every {} ns)", self.buffer, self.every_ns)
    }
}

/// All that is held now, a buffer once.
#[derive(Debug, Default)]
pub(super) struct Hands(Vec<Hand>);

#[derive(Debug)]
struct Hand {
    held: Held,
    /// When someone last said that it is held.
    renewed: Instant,
    /// When the next message is due.
    due: Stamp,
}

impl Hands {
    /// Takes hold, or holds on; another value than before is due at once.
    pub(super) fn hold(&mut self, held: Held, clock: Instant, now: Stamp) {
        match self.0.iter_mut().find(|hand| hand.held.buffer == held.buffer) {
            Some(hand) => {
                if !Arc::ptr_eq(&hand.held.make, &held.make) {
                    hand.due = hand.due.min(now);
                }
                (hand.held, hand.renewed) = (held, clock);
            }
            None => self.0.push(Hand { held, renewed: clock, due: now }),
        }
    }

    /// Lets go.
    pub(super) fn let_go(&mut self, buffer: &str) {
        self.0.retain(|hand| hand.held.buffer != buffer);
    }

    /// Lets go of what nobody has spoken for.
    pub(super) fn drop_lapsed(&mut self, clock: Instant) {
        self.0.retain(|hand| clock.saturating_duration_since(hand.renewed) <= Held::LEASE);
    }

    /// The source went to another time: what is due is due from there.
    pub(super) fn moved(&mut self, now: Stamp) {
        for hand in &mut self.0 {
            hand.due = now;
        }
    }

    /// When the next message is due.
    pub(super) fn next_due(&self) -> Option<Stamp> {
        self.0.iter().map(|hand| hand.due).min()
    }

    /// The messages that are due at `now`.
    pub(super) fn take_due(&mut self, now: Stamp) -> Vec<(String, AnyMessage)> {
        let due = self.0.iter_mut().filter(|hand| hand.due <= now);
        due.map(|hand| {
            hand.due = now.after_ns(hand.held.every_ns.max(1_000_000));
            (hand.held.buffer.clone(), (hand.held.make)(now))
        })
        .collect()
    }
}
