//! The journal: everything that enters a stack from outside, in one order.
//!
//! An operator's command, parameters, edit, teleoperation and emergency stop, and a message of a sensor or a link are
//! one [`ExternalEvent`] each. A run depends on these events, its log, its stack, its parameters and its seed, and on
//! nothing else (a live run depends on its schedule, too). The [`Journal`] is needed to repeat a run, and is what
//! distinguishes its branches. Each event is published in `/runtime/journal`, so that recordings contain it.
//!
//! Messages of a log are not journalled: the run's identity names the log by its content, and the order of a log is
//! total.

use crate::error::RunError;
use rcs_bus::WriterId;
use rcs_msg::{AnyMessage, DeferredSource, Stamp, rcs};
use std::sync::Arc;

/// Position of an event in the order of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct EventPlace {
    /// Number of events of a stepped run before it. 0 in a live run, in which no two events have the same time.
    pub events: u64,
    /// Time of the run.
    pub time: Stamp,
}

/// A message from outside a stack.
#[derive(Clone, Debug)]
pub struct ExternalEvent {
    /// Its position in the order; set by the run that accepts it.
    pub place: EventPlace,
    /// The destination buffer.
    pub buffer: Arc<str>,
    /// The writer: [`WriterId::OPERATOR`], or [`WriterId::RUNTIME`] for sensors and links.
    pub writer: WriterId,
    /// Acquisition time; `None` for the time at which the run accepts it.
    pub acq_time: Option<Stamp>,
    /// The message.
    pub message: AnyMessage,
}

impl ExternalEvent {
    /// An event of the operator: a command, a parameter message, an edit, teleoperation, an emergency stop.
    pub fn operator(buffer: impl Into<Arc<str>>, message: AnyMessage) -> Self {
        let buffer = buffer.into();
        Self { place: EventPlace::default(), buffer, writer: WriterId::OPERATOR, acq_time: None, message }
    }

    /// An event of a sensor or a link.
    pub fn sensed(buffer: impl Into<Arc<str>>, acq_time: Stamp, message: AnyMessage) -> Self {
        let (place, buffer) = (EventPlace::default(), buffer.into());
        Self { place, buffer, writer: WriterId::RUNTIME, acq_time: Some(acq_time), message }
    }

    /// The same event at another position.
    #[must_use]
    pub fn at(mut self, place: EventPlace) -> Self {
        self.place = place;
        self
    }

    /// Acquisition time.
    pub fn acq_time(&self) -> Stamp {
        self.acq_time.unwrap_or(self.place.time)
    }

    /// The event of a recorded message; an error if its message does not decode.
    pub fn from_message(event: &rcs::JournalEvent) -> Result<Self, RunError> {
        let unreadable =
            |what: String| RunError::Refused(format!("the journal's event for {} {what}", event.buffer));
        let writer = match event.writer.as_str() {
            "operator" => WriterId::OPERATOR,
            "runtime" => WriterId::RUNTIME,
            other => {
                return Err(unreadable(format!("has the writer {other:?}; expected operator or runtime")));
            }
        };
        let schema = rcs_msg::registry()
            .schema(&event.schema)
            .ok_or_else(|| unreadable(format!("is of type {:?}, which is not known", event.schema)))?;
        let message = rcs_msg::canonical(schema, &event.message)
            .and_then(Result::ok)
            .ok_or_else(|| unreadable(format!("does not decode as {}", event.schema)))?;
        Ok(Self {
            place: EventPlace { events: event.events, time: Stamp(event.time_ns) },
            buffer: event.buffer.as_str().into(),
            writer,
            acq_time: Some(Stamp(event.acq_time_ns)),
            message,
        })
    }
}

impl DeferredSource<rcs::JournalEvent> for ExternalEvent {
    fn to_message(&self) -> rcs::JournalEvent {
        rcs::JournalEvent {
            events: self.place.events,
            time_ns: self.place.time.0,
            acq_time_ns: self.acq_time().0,
            writer: if self.writer == WriterId::OPERATOR { "operator" } else { "runtime" }.to_owned(),
            buffer: self.buffer.to_string(),
            schema: self.message.schema().name().to_owned(),
            message: self.message.bytes(),
        }
    }
}

/// All external events of a run, in order. Cheap to clone.
#[derive(Clone, Debug, Default)]
pub struct Journal {
    events: Arc<Vec<ExternalEvent>>,
}

impl Journal {
    /// The events of a recording, in order.
    pub fn new(events: Vec<ExternalEvent>) -> Self {
        Self { events: Arc::new(events) }
    }

    /// The events, in order.
    pub fn events(&self) -> &[ExternalEvent] {
        &self.events
    }

    /// Number of events.
    pub fn len(&self) -> usize {
        self.events.len()
    }

    /// Whether there are no events.
    pub fn is_empty(&self) -> bool {
        self.events.is_empty()
    }

    /// Appends an event, which must come after all others.
    pub fn push(&mut self, event: ExternalEvent) {
        Arc::make_mut(&mut self.events).push(event);
    }

    /// Truncates the journal to `length` events.
    pub fn truncate(&mut self, length: usize) {
        if length < self.events.len() {
            Arc::make_mut(&mut self.events).truncate(length);
        }
    }

    /// Number of journalled events before the point at which `events` events of a stepped run have been executed.
    pub fn before(&self, events: u64) -> usize {
        self.events.partition_point(|event| event.place.events < events)
    }

    /// Number of journalled events up to and including that point.
    pub fn up_to(&self, events: u64) -> usize {
        self.events.partition_point(|event| event.place.events <= events)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcs_msg::foxglove::Vector3;

    fn event(events: u64, x: f64) -> ExternalEvent {
        let message = AnyMessage::new(Vector3 { x, ..Vector3::default() });
        ExternalEvent::operator("/a", message).at(EventPlace { events, time: Stamp(events * 10) })
    }

    #[test]
    fn an_event_is_the_same_after_it_was_recorded() {
        let recorded = event(3, 1.5).to_message();
        let read = ExternalEvent::from_message(&recorded).unwrap();
        assert_eq!(read.place, EventPlace { events: 3, time: Stamp(30) });
        assert_eq!((&*read.buffer, read.writer, read.acq_time()), ("/a", WriterId::OPERATOR, Stamp(30)));
        assert_eq!(read.message.get::<Vector3>().unwrap().x, 1.5);
        assert_eq!(read.to_message(), recorded);
    }

    #[test]
    fn an_event_that_cannot_be_read_is_refused_by_name() {
        let good = event(3, 1.5).to_message();
        let check = |bad: rcs::JournalEvent, expected: &str| {
            let error = ExternalEvent::from_message(&bad).unwrap_err().to_string();
            assert!(error.contains("/a") && error.contains(expected), "{error}");
        };
        check(rcs::JournalEvent { schema: "no.Such".to_owned(), ..good.clone() }, "no.Such");
        check(rcs::JournalEvent { message: vec![0xff].into(), ..good.clone() }, "does not decode");
        check(rcs::JournalEvent { writer: "nobody".to_owned(), ..good }, "nobody");
    }

    #[test]
    fn places_count_the_events_on_both_sides_of_a_point() {
        let journal = Journal::new(vec![event(1, 0.0), event(3, 0.0), event(3, 1.0), event(7, 0.0)]);
        assert_eq!((journal.before(3), journal.up_to(3), journal.up_to(100)), (1, 3, 4));
    }
}
