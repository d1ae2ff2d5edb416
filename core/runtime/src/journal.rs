//! What comes from outside a stack, in one order.
//!
//! An operator's command, parameters, edit, teleoperation and emergency stop, a sensor's message, a link's: each is one
//! [`ExternalEvent`]. A run depends on these, its log, its stack, its parameters and its seed, and on nothing else (a
//! live run also on its schedule). A [`Journal`] is what repeats a run and what branches of a run differ in; each event
//! is published in `/runtime/journal`, so that a recording holds it.
//!
//! A log's messages have no events of their own: the log is named by its content in the run's identity, its order is
//! total, and a copy of it in the journal would say nothing more.

use crate::error::RunError;
use rcs_bus::WriterId;
use rcs_msg::{AnyMessage, DeferredSource, Stamp, rcs};
use std::sync::Arc;

/// Where an event stands in the order of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct EventPlace {
    /// Events of a stepped run that had been done before it. 0 in a live run, where no two events have one time.
    pub events: u64,
    /// Time of the run.
    pub time: Stamp,
}

/// A message from outside a stack.
#[derive(Clone, Debug)]
pub struct ExternalEvent {
    /// Where it stands in the order; set by the run that takes it.
    pub place: EventPlace,
    /// Buffer that it goes to.
    pub buffer: Arc<str>,
    /// Who writes it: [`WriterId::OPERATOR`], or [`WriterId::RUNTIME`] for sensors and links.
    pub writer: WriterId,
    /// When what it tells of was sensed; `None` for the time at which the run takes it.
    pub acq_time: Option<Stamp>,
    /// The message.
    pub message: AnyMessage,
}

impl ExternalEvent {
    /// What an operator writes: a command, a parameter message, an edit, teleoperation, an emergency stop.
    pub fn operator(buffer: impl Into<Arc<str>>, message: AnyMessage) -> Self {
        let buffer = buffer.into();
        Self { place: EventPlace::default(), buffer, writer: WriterId::OPERATOR, acq_time: None, message }
    }

    /// What a sensor or a link writes.
    pub fn sensed(buffer: impl Into<Arc<str>>, acq_time: Stamp, message: AnyMessage) -> Self {
        let (place, buffer) = (EventPlace::default(), buffer.into());
        Self { place, buffer, writer: WriterId::RUNTIME, acq_time: Some(acq_time), message }
    }

    /// The same event in a place of its own.
    #[must_use]
    pub fn at(mut self, place: EventPlace) -> Self {
        self.place = place;
        self
    }

    /// When what it tells of was sensed.
    pub fn acq_time(&self) -> Stamp {
        self.acq_time.unwrap_or(self.place.time)
    }

    /// The event of a recorded message; an error where its message does not decode.
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

/// What came from outside a stack, in the order of the run. Cheap to clone.
#[derive(Clone, Debug, Default)]
pub struct Journal {
    events: Arc<Vec<ExternalEvent>>,
}

impl Journal {
    /// The events of a recording, in their order.
    pub fn new(events: Vec<ExternalEvent>) -> Self {
        Self { events: Arc::new(events) }
    }

    /// The events, in their order.
    pub fn events(&self) -> &[ExternalEvent] {
        &self.events
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.events.len()
    }

    /// Whether nothing came from outside.
    pub fn is_empty(&self) -> bool {
        self.events.is_empty()
    }

    /// Appends an event that stands behind all others.
    pub fn push(&mut self, event: ExternalEvent) {
        Arc::make_mut(&mut self.events).push(event);
    }

    /// Forgets everything from the `length`-th event on.
    pub fn truncate(&mut self, length: usize) {
        if length < self.events.len() {
            Arc::make_mut(&mut self.events).truncate(length);
        }
    }

    /// How many events stand before the point at which `events` events of a stepped run have been done.
    pub fn before(&self, events: u64) -> usize {
        self.events.partition_point(|event| event.place.events < events)
    }

    /// How many events stand up to and with that point.
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
