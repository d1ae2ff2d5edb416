//! Held controls: messages that are written repeatedly while the user holds a key, a button or a stick.

use rcs_msg::{AnyMessage, Stamp};
use std::fmt;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A held control.
#[derive(Clone)]
pub struct HeldControl {
    /// Name of the buffer.
    pub buffer: String,
    /// Time of the source between messages, in nanoseconds; at least a millisecond.
    pub every_ns: u64,
    /// Creates the message for a time of the source.
    pub make: Arc<dyn Fn(Stamp) -> AnyMessage + Send + Sync>,
}

impl HeldControl {
    /// A control that is not renewed is released after this time, so that a hung window does not drive the vehicle.
    pub const LEASE: Duration = Duration::from_millis(600);
}

impl fmt::Debug for HeldControl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "HeldControl({} every {} ns)", self.buffer, self.every_ns)
    }
}

/// All held controls, at most one per buffer.
#[derive(Debug, Default)]
pub(super) struct HeldControls(Vec<Entry>);

#[derive(Debug)]
struct Entry {
    held: HeldControl,
    /// Time of the last renewal.
    renewed: Instant,
    /// When the next message is due; `None` after the view went back or to another run: from then on nothing is written
    /// until the control is let go.
    due: Option<Stamp>,
}

impl HeldControls {
    /// Adds or renews a control; if its value has changed, it is due at once.
    pub(super) fn hold(&mut self, held: HeldControl, clock: Instant, now: Stamp) {
        match self.0.iter_mut().find(|entry| entry.held.buffer == held.buffer) {
            Some(entry) => {
                if !Arc::ptr_eq(&entry.held.make, &held.make) {
                    entry.due = entry.due.map(|due| due.min(now));
                }
                (entry.held, entry.renewed) = (held, clock);
            }
            None => self.0.push(Entry { held, renewed: clock, due: Some(now) }),
        }
    }

    /// Releases a control. Whether it was in force until now, so that a last message is to be written.
    pub(super) fn let_go(&mut self, buffer: &str) -> bool {
        let is_it = |entry: &Entry| entry.held.buffer == buffer;
        let was_in_force = self.0.iter().any(|entry| is_it(entry) && entry.due.is_some());
        self.0.retain(|entry| !is_it(entry));
        was_in_force
    }

    /// Releases the controls that have not been renewed in time.
    pub(super) fn drop_lapsed(&mut self, clock: Instant) {
        self.0.retain(|entry| clock.saturating_duration_since(entry.renewed) <= HeldControl::LEASE);
    }

    /// Where the view goes back or to another run: what is held now would begin another run there, and is not written.
    pub(super) fn end(&mut self) {
        for entry in &mut self.0 {
            entry.due = None;
        }
    }

    /// When the next message is due.
    pub(super) fn next_due(&self) -> Option<Stamp> {
        self.0.iter().filter_map(|entry| entry.due).min()
    }

    /// The messages that are due at `now`.
    pub(super) fn take_due(&mut self, now: Stamp) -> Vec<(String, AnyMessage)> {
        let due = self.0.iter_mut().filter(|entry| entry.due.is_some_and(|due| due <= now));
        due.map(|entry| {
            entry.due = Some(now.after_ns(entry.held.every_ns.max(1_000_000)));
            (entry.held.buffer.clone(), (entry.held.make)(now))
        })
        .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcs_msg::foxglove::Vector3;

    const START: Stamp = Stamp(0);

    /// Holds `/hand`, with 50 ms of the source between messages.
    fn hand() -> HeldControl {
        HeldControl {
            buffer: "/hand".to_owned(),
            every_ns: 50_000_000,
            make: Arc::new(|_| AnyMessage::new(Vector3::default())),
        }
    }

    fn at_ms(ms: u64) -> Stamp {
        START.after_ns(ms * 1_000_000)
    }

    /// The times at which a source writes that stops where something is due, ms.
    fn written_ms(hands: &mut HeldControls, until: Stamp) -> Vec<u64> {
        let mut times = Vec::new();
        while let Some(due) = hands.next_due().filter(|due| *due <= until) {
            times.extend(hands.take_due(due).iter().map(|_| due.0 / 1_000_000));
        }
        times
    }

    #[test]
    fn what_is_held_is_due_at_its_rate_until_let_go() {
        let (mut hands, clock, held) = (HeldControls::default(), Instant::now(), hand());
        hands.hold(held.clone(), clock, START);
        assert_eq!(written_ms(&mut hands, at_ms(120)), [0, 50, 100]);
        hands.hold(held, clock, at_ms(130));
        assert_eq!(written_ms(&mut hands, at_ms(200)), [150, 200], "renewed with the same value");
        hands.hold(hand(), clock, at_ms(210));
        assert_eq!(written_ms(&mut hands, at_ms(270)), [210, 260], "another value is due at once");
        hands.let_go("/other");
        assert_eq!(hands.next_due(), Some(at_ms(310)));
        hands.let_go("/hand");
        assert_eq!(hands.next_due(), None);
    }

    #[test]
    fn a_control_lapses_that_is_not_renewed_within_its_lease() {
        let (mut hands, start) = (HeldControls::default(), Instant::now());
        let is_held = |hands: &mut HeldControls, clock: Instant| {
            hands.drop_lapsed(clock);
            hands.next_due().is_some()
        };
        hands.hold(hand(), start, START);
        let renewed = start + HeldControl::LEASE;
        assert!(is_held(&mut hands, renewed));
        hands.hold(hand(), renewed, START);
        assert!(is_held(&mut hands, renewed + HeldControl::LEASE));
        assert!(!is_held(&mut hands, renewed + HeldControl::LEASE + Duration::from_millis(1)));
    }
}
