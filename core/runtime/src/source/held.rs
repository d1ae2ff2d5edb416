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
    /// A control that is not renewed is no longer written after this time, so that a hung window does not drive the
    /// vehicle.
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
    state: State,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    /// In force: when the next message is due.
    Due(Stamp),
    /// Not renewed in time, or not accepted by the source: nothing is written until it is renewed. When it is let go,
    /// the last message is still to be written.
    Lapsed,
    /// The view went back or to another run: nothing is written any more until the control was let go.
    Ended,
}

impl Entry {
    fn due(&self) -> Option<Stamp> {
        match self.state {
            State::Due(due) => Some(due),
            State::Lapsed | State::Ended => None,
        }
    }
}

impl HeldControls {
    /// Adds or renews a control; if its value has changed or it had lapsed, it is due at once.
    pub(super) fn hold(&mut self, held: HeldControl, clock: Instant, now: Stamp) {
        match self.0.iter_mut().find(|entry| entry.held.buffer == held.buffer) {
            Some(entry) => {
                let is_same = Arc::ptr_eq(&entry.held.make, &held.make);
                entry.state = match entry.state {
                    State::Due(due) if !is_same => State::Due(due.min(now)),
                    State::Lapsed => State::Due(now),
                    state => state,
                };
                (entry.held, entry.renewed) = (held, clock);
            }
            None => self.0.push(Entry { held, renewed: clock, state: State::Due(now) }),
        }
    }

    /// Releases a control. Whether a last message is to be written: always, unless the control had ended.
    pub(super) fn let_go(&mut self, buffer: &str) -> bool {
        let at = self.0.iter().position(|entry| entry.held.buffer == buffer);
        at.is_none_or(|at| self.0.remove(at).state != State::Ended)
    }

    /// Suspends the controls that have not been renewed in time, until they are renewed.
    pub(super) fn suspend_overdue(&mut self, clock: Instant) {
        self.suspend_where(|entry| clock.saturating_duration_since(entry.renewed) > HeldControl::LEASE);
    }

    /// Suspends the control of a buffer that the source did not accept, until it is renewed.
    pub(super) fn suspend(&mut self, buffer: &str) {
        self.suspend_where(|entry| entry.held.buffer == buffer);
    }

    fn suspend_where(&mut self, is: impl Fn(&Entry) -> bool) {
        for entry in self.0.iter_mut().filter(|entry| entry.due().is_some() && is(entry)) {
            entry.state = State::Lapsed;
        }
    }

    /// Where the view goes back or to another run: what is held now would begin another run there, and is not written.
    pub(super) fn end(&mut self) {
        for entry in &mut self.0 {
            entry.state = State::Ended;
        }
    }

    /// When the next message is due.
    pub(super) fn next_due(&self) -> Option<Stamp> {
        self.0.iter().filter_map(Entry::due).min()
    }

    /// The messages that are due at `now`.
    pub(super) fn take_due(&mut self, now: Stamp) -> Vec<(String, AnyMessage)> {
        let due = self.0.iter_mut().filter(|entry| entry.due().is_some_and(|due| due <= now));
        due.map(|entry| {
            entry.state = State::Due(now.after_ns(entry.held.every_ns.max(1_000_000)));
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
            hands.suspend_overdue(clock);
            hands.next_due().is_some()
        };
        hands.hold(hand(), start, START);
        let renewed = start + HeldControl::LEASE;
        assert!(is_held(&mut hands, renewed));
        hands.hold(hand(), renewed, START);
        assert!(is_held(&mut hands, renewed + HeldControl::LEASE));
        assert!(!is_held(&mut hands, renewed + HeldControl::LEASE + Duration::from_millis(1)));
    }

    #[test]
    fn a_control_that_lapsed_is_due_when_it_is_renewed_and_has_a_last_message() {
        let (mut hands, start) = (HeldControls::default(), Instant::now());
        let late = start + 2 * HeldControl::LEASE;
        hands.hold(hand(), start, START);
        hands.suspend_overdue(late);
        hands.hold(hand(), late, at_ms(1200));
        assert_eq!(hands.next_due(), Some(at_ms(1200)));
        hands.suspend("/hand");
        assert_eq!(hands.next_due(), None);
        assert!(hands.let_go("/hand"));
    }

    #[test]
    fn a_control_that_ended_writes_nothing_until_it_was_let_go_however_late_it_is_renewed() {
        let (mut hands, start) = (HeldControls::default(), Instant::now());
        let late = start + 2 * HeldControl::LEASE;
        hands.hold(hand(), start, START);
        hands.suspend("/hand");
        hands.end();
        hands.suspend_overdue(late);
        hands.hold(hand(), late, START);
        assert_eq!(hands.next_due(), None);
        assert!(!hands.let_go("/hand"));
        hands.hold(hand(), late, START);
        assert_eq!(hands.next_due(), Some(START));
    }
}
