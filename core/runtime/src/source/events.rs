//! Events of a run or a recording: commands, changes of mode, errors, acts of the operator, bumper hits, log lines and
//! changes in diagnostics.
//!
//! The source's thread finds them in the messages as they are written (or, for a recording, as it is read in the
//! background), and only appends. A frame refers to the events of each run with a length, so that a longer run makes no
//! frame more expensive.

use super::acts::{self, Described};
use super::known::Known;
use super::per_run::{Gathered, Written};
use super::run_tag::RunTag;
use rcs_msg::rcs::diagnostic::Level;
use rcs_msg::{AnyMessage, Stamp, foxglove, rcs};
use std::collections::BTreeMap;
use std::fmt;
use std::sync::{Arc, PoisonError, RwLock, RwLockReadGuard};

/// Types of messages in which events are found.
const EVENT_TYPES: [&str; 8] = [
    "rcs.Status",
    "rcs.Command",
    "rcs.EmergencyStop",
    "rcs.JournalEvent",
    "rcs.VehicleStatus",
    "rcs.Bumper",
    "foxglove.Log",
    "rcs.Diagnostics",
];
/// A text of a state is an event again after it was not seen for this time.
const QUIET_S: f64 = 10.0;
/// Texts of states that are remembered of a process.
const MOST_TEXTS: usize = 64;
/// Parts whose level is remembered of a topic with diagnostics.
const MOST_PARTS: usize = 10_000;

/// Whether messages of this type may have events, or say what is needed to tell those of others.
pub(crate) fn is_event_type(name: &str) -> bool {
    EVENT_TYPES.contains(&name) || acts::is_describing_type(name)
}

/// What kind of event it is: its lane in the timeline.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum EventKind {
    /// A process failed, refused a command, or could not use an input.
    Error,
    /// The vehicle hit something.
    Bumper,
    /// The operator did something.
    Operator,
    /// A process received a command.
    Command,
    /// A process changed its state.
    Mode,
    /// A line of a log, or another level of a part in the diagnostics.
    Log,
}

impl EventKind {
    /// All kinds, the most important first.
    pub const ALL: [Self; 6] =
        [Self::Error, Self::Bumper, Self::Operator, Self::Command, Self::Mode, Self::Log];

    /// Whether messages of this type may have such an event.
    pub fn is_found_in(self, type_name: &str) -> bool {
        let types: &[&str] = match self {
            Self::Error => &["rcs.Status", "rcs.VehicleStatus"],
            Self::Bumper => &["rcs.VehicleStatus", "rcs.Bumper"],
            Self::Operator => &["rcs.EmergencyStop", "rcs.JournalEvent"],
            Self::Command => &["rcs.Command"],
            Self::Mode => &["rcs.Status"],
            Self::Log => &["foxglove.Log", "rcs.Diagnostics"],
        };
        types.contains(&type_name)
    }

    /// Name in lists.
    pub fn name(self) -> &'static str {
        match self {
            Self::Error => "errors",
            Self::Bumper => "bumper",
            Self::Operator => "operator",
            Self::Command => "commands",
            Self::Mode => "modes",
            Self::Log => "log",
        }
    }
}

/// How serious an event is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum EventLevel {
    /// For information.
    Info,
    /// Something did not go as it should.
    Warning,
    /// Something failed.
    Error,
}

/// One event.
#[derive(Clone, Debug, PartialEq)]
pub struct Event {
    /// Log time of the message in which it was found.
    pub stamp: Stamp,
    /// Its kind.
    pub kind: EventKind,
    /// How serious it is.
    pub level: EventLevel,
    /// Who it is about: a process, a node, or the buffer.
    pub source: Arc<str>,
    /// What happened, in one line.
    pub text: Arc<str>,
}

impl Event {
    /// Whether a process failed. Warnings are of the kind "errors", too.
    fn is_alarm(&self) -> bool {
        self.kind == EventKind::Error && self.level == EventLevel::Error
    }
}

#[derive(Default)]
struct Store {
    all: Vec<Event>,
    /// Indices of the events of each kind, in the order of [`EventKind::ALL`].
    by_kind: [Vec<u32>; EventKind::ALL.len()],
    /// Indices of the alarms.
    alarms: Vec<u32>,
}

impl Store {
    fn push(&mut self, mut event: Event) {
        // Events are ordered by time; one that is found late has the time of the last one.
        event.stamp = self.all.last().map_or(event.stamp, |last| last.stamp.max(event.stamp));
        let index = self.all.len() as u32;
        self.by_kind[event.kind as usize].push(index);
        if event.is_alarm() {
            self.alarms.push(index);
        }
        self.all.push(event);
    }
}

/// The events of a run up to a certain one, which do not change while others are appended.
#[derive(Clone)]
pub struct Events {
    /// The run.
    pub run: RunTag,
    store: Arc<RwLock<Store>>,
    len: usize,
}

impl fmt::Debug for Events {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Events({} of {:?})", self.len, self.run)
    }
}

impl Events {
    /// Events for tests.
    pub fn of(run: RunTag, events: impl IntoIterator<Item = Event>) -> Self {
        let mut store = Store::default();
        for event in events {
            store.push(event);
        }
        let len = store.all.len();
        Self { run, store: Arc::new(RwLock::new(store)), len }
    }

    /// The first `len` events at most, for tests: the same events before the others were appended.
    #[must_use]
    pub fn first(&self, len: usize) -> Self {
        Self { len: len.min(self.len), ..self.clone() }
    }

    fn store(&self) -> RwLockReadGuard<'_, Store> {
        self.store.read().unwrap_or_else(PoisonError::into_inner)
    }

    /// Number of events.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Whether both have the same events, apart from what was appended to one of them.
    pub fn same(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.store, &other.store)
    }

    /// An event.
    pub fn get(&self, index: usize) -> Option<Event> {
        self.store().all[..self.len].get(index).cloned()
    }

    /// Calls `take` for the events from an index on, with their indices.
    pub fn each_from(&self, from: usize, mut take: impl FnMut(usize, &Event)) {
        let store = self.store();
        for (index, event) in store.all[..self.len].iter().enumerate().skip(from) {
            take(index, event);
        }
    }

    /// Number of events up to and including a time.
    pub fn count_until(&self, time: Stamp) -> usize {
        self.store().all[..self.len].partition_point(|event| event.stamp <= time)
    }

    /// Number of events of each kind, in the order of [`EventKind::ALL`].
    pub fn counts(&self) -> [usize; EventKind::ALL.len()] {
        let store = self.store();
        std::array::from_fn(|kind| store.by_kind[kind].partition_point(|&index| (index as usize) < self.len))
    }

    /// For each pair of the times, which ascend: the first event of a kind that is later than the one (for the first
    /// pair: not earlier) and not later than the next. The work depends on the number of times, not on that of events.
    pub fn between(&self, kind: EventKind, times: &[Stamp]) -> Vec<Option<Event>> {
        let store = self.store();
        let indices = &store.by_kind[kind as usize];
        let indices = &indices[..indices.partition_point(|&index| (index as usize) < self.len)];
        let event = |at: usize| indices.get(at).map(|&index| &store.all[index as usize]);
        let first = times.first().copied().unwrap_or_default();
        let mut at = indices.partition_point(|&index| store.all[index as usize].stamp < first);
        let found = times.windows(2).enumerate().map(|(number, pair)| {
            let is_before = |&index: &u32| number > 0 && store.all[index as usize].stamp <= pair[0];
            at += indices[at..].partition_point(is_before);
            event(at).filter(|event| event.stamp <= pair[1]).cloned()
        });
        found.collect()
    }

    /// The last alarms (events of the kind and level "error") up to and including a time, the latest first. The work does
    /// not depend on the number of other events.
    pub fn last_alarms(&self, until: Stamp, most: usize) -> Vec<Event> {
        let store = self.store();
        let is_before =
            |&index: &u32| (index as usize) < self.len && store.all[index as usize].stamp <= until;
        let indices = &store.alarms[..store.alarms.partition_point(is_before)];
        indices.iter().rev().take(most).map(|&index| store.all[index as usize].clone()).collect()
    }

    /// The next event after a time, or the last one before it, of one of these kinds.
    pub fn beside(&self, time: Stamp, back: bool, kinds: &[EventKind]) -> Option<Event> {
        let store = self.store();
        let all = &store.all[..self.len];
        let wanted = |event: &&Event| kinds.contains(&event.kind);
        if back {
            all[..all.partition_point(|event| event.stamp < time)].iter().rfind(wanted).cloned()
        } else {
            all[all.partition_point(|event| event.stamp <= time)..].iter().find(wanted).cloned()
        }
    }
}

/// The events of one run, as they are found.
#[derive(Default)]
pub(crate) struct EventWatch {
    store: Arc<RwLock<Store>>,
    known: BTreeMap<Arc<str>, Known>,
    described: Described,
    /// For each event, the number of messages of the run up to the one in which it was found. Empty for a recording, from
    /// which no run branches.
    found_at: Vec<u64>,
    /// Number of messages of the run up to the one that was taken last; 0 for a recording.
    messages: u64,
}

impl Gathered for EventWatch {
    fn takes(type_name: &str) -> bool {
        is_event_type(type_name)
    }

    fn take(&mut self, topic: &Arc<str>, at: Written, message: &AnyMessage) {
        self.messages = at.messages;
        self.look(topic, at.time, message);
        let events = self.store.read().unwrap_or_else(PoisonError::into_inner).all.len();
        self.found_at.resize(events, at.messages);
    }

    fn fork(&self, at: Written) -> Self {
        let shared = self.found_at.partition_point(|&messages| messages <= at.messages);
        let store = self.store.read().unwrap_or_else(PoisonError::into_inner);
        let events = Events::of(RunTag::FIRST, store.all.iter().take(shared).cloned());
        let known = self.known.iter().map(|(topic, known)| (Arc::clone(topic), known.fork(at)));
        Self {
            store: events.store,
            known: known.collect(),
            described: self.described.clone(),
            found_at: self.found_at[..shared].to_vec(),
            messages: at.messages,
        }
    }
}

impl EventWatch {
    /// The events up to now.
    pub(crate) fn read(&self, run: RunTag) -> Events {
        let len = self.store.read().unwrap_or_else(PoisonError::into_inner).all.len();
        Events { run, store: Arc::clone(&self.store), len }
    }

    /// Looks for events in a canonical message on `topic`.
    pub(crate) fn look(&mut self, topic: &Arc<str>, stamp: Stamp, message: &AnyMessage) {
        let at = Written { time: stamp, messages: self.messages };
        let known = self.known.entry(Arc::clone(topic)).or_default();
        let mut found = Vec::new();
        let mut add = |kind, level, source: &str, text: String| {
            found.push(Event { stamp, kind, level, source: source.into(), text: text.into() });
        };
        if let Some(status) = message.get::<rcs::Status>() {
            status_events(known, at, status, &mut add);
        } else if let Some(command) = message.get::<rcs::Command>() {
            if known.serial.set(at, command.serial) {
                let text = format!("{} ({})", command.name, command.serial);
                add(EventKind::Command, EventLevel::Info, topic, text);
            }
        } else if let Some(stop) = message.get::<rcs::EmergencyStop>() {
            if known.is_stopped.set(at, stop.active) {
                let text = if stop.active { "emergency stop" } else { "the emergency stop is released" };
                add(EventKind::Operator, EventLevel::Warning, topic, text.to_owned());
            }
        } else if let Some(event) = message.get::<rcs::JournalEvent>() {
            if let Some(text) = acts::told(known, &self.described, at, event) {
                add(EventKind::Operator, EventLevel::Info, &event.buffer, text);
            }
        } else if let Some(process) = message.get::<rcs::ProcessInfo>() {
            self.described.take_process(process);
        } else if let Some(run) = message.get::<rcs::RunInfo>() {
            self.described.take_run(run);
        } else if let Some(status) = message.get::<rcs::VehicleStatus>() {
            if status.refused > known.refusals.get().copied().unwrap_or(0) {
                add(
                    EventKind::Error,
                    EventLevel::Warning,
                    topic,
                    format!("refused: {}", status.last_refusal),
                );
            }
            known.refusals.set(at, status.refused);
            bumper_events(known, at, [status.bumper_left, status.bumper_right], topic, &mut add);
        } else if let Some(bumper) = message.get::<rcs::Bumper>() {
            bumper_events(known, at, [bumper.left, bumper.right], topic, &mut add);
        } else if let Some(log) = message.get::<foxglove::Log>() {
            let level = match log.level() {
                foxglove::log::Level::Error | foxglove::log::Level::Fatal => EventLevel::Error,
                foxglove::log::Level::Warning => EventLevel::Warning,
                _ => EventLevel::Info,
            };
            let source = if log.name.is_empty() { &**topic } else { &log.name };
            add(EventKind::Log, level, source, log.message.clone());
        } else if let Some(diagnostics) = message.get::<rcs::Diagnostics>() {
            diagnostic_events(known, at, diagnostics, &mut add);
        }
        if !found.is_empty() {
            let mut store = self.store.write().unwrap_or_else(PoisonError::into_inner);
            for event in found {
                store.push(event);
            }
        }
    }
}

fn status_events(
    known: &mut Known,
    at: Written,
    status: &rcs::Status,
    add: &mut impl FnMut(EventKind, EventLevel, &str, String),
) {
    let text = without_numbers(&status.state_text);
    let same = known
        .state
        .get()
        .is_some_and(|(state, command)| *state == status.state && *command == status.command);
    // A process that goes to and fro between two texts says nothing new.
    if !known.texts.contains_key(&text) && known.texts.len() >= MOST_TEXTS {
        known.texts.clear();
    }
    let is_said = known.texts.entry(text).or_default().goes_on(at, QUIET_S);
    if !same || !is_said {
        known.state.set(at, (status.state, status.command.clone()));
        let word = status.state().as_str_name();
        let is_error = status.state() == rcs::ProcessState::Error;
        let line = [word, &status.command, &status.state_text].into_iter().filter(|part| !part.is_empty());
        let line = line.collect::<Vec<_>>().join(" · ");
        if is_error {
            add(EventKind::Error, EventLevel::Error, &status.process, line);
        } else {
            add(EventKind::Mode, EventLevel::Info, &status.process, line);
        }
    }
    let told = known.faults.get().copied().unwrap_or(0);
    if told == 0 && status.faults > 0 || status.faults >= told.saturating_mul(2).max(1) {
        // The first fault, and then each time that there are twice as many: a sensor may fail every cycle.
        if status.faults > 0 {
            let noun = if status.faults == 1 { "input" } else { "inputs" };
            let text = format!("{} {noun} not used: {}", status.faults, status.last_fault);
            add(EventKind::Error, EventLevel::Warning, &status.process, text);
        }
        known.faults.set(at, status.faults);
    }
    if let Some(refused) = status.refused.as_ref().filter(|refused| !refused.no_authority) {
        let this = (refused.writer.clone(), refused.serial, refused.command.clone());
        if known.refused.set(at, this) {
            let text = format!("refused {} of {}: {}", refused.command, refused.writer, refused.reason);
            add(EventKind::Error, EventLevel::Warning, &status.process, text);
        }
    }
}

fn bumper_events(
    known: &mut Known,
    at: Written,
    now: [bool; 2],
    topic: &str,
    add: &mut impl FnMut(EventKind, EventLevel, &str, String),
) {
    let before = known.bumper.get().copied().unwrap_or_default();
    for (side, name) in ["left", "right"].into_iter().enumerate() {
        if now[side] && !before[side] {
            add(EventKind::Bumper, EventLevel::Warning, topic, format!("bumper hit, {name}"));
        }
    }
    known.bumper.set(at, now);
}

/// A part is told when its level changes, and first when it is not OK: diagnostics repeat every second.
fn diagnostic_events(
    known: &mut Known,
    at: Written,
    diagnostics: &rcs::Diagnostics,
    add: &mut impl FnMut(EventKind, EventLevel, &str, String),
) {
    for part in &diagnostics.parts {
        let id = (part.name.clone(), part.hardware_id.clone());
        if !known.parts.contains_key(&id) && known.parts.len() >= MOST_PARTS {
            known.parts.clear();
        }
        let told = known.parts.entry(id).or_default();
        let before = told.get().copied().unwrap_or(Level::Ok.into());
        told.set(at, part.level);
        if part.level != before {
            let level = match part.level() {
                Level::Ok => EventLevel::Info,
                Level::Warn | Level::Stale => EventLevel::Warning,
                Level::Error => EventLevel::Error,
            };
            let text = [part.level().as_str_name(), &part.message, &part.hardware_id];
            let text = text.into_iter().filter(|text| !text.is_empty()).collect::<Vec<_>>().join(" · ");
            add(EventKind::Log, level, &part.name, text);
        }
    }
}

/// The text of a state without its numbers, which change while the state does not.
fn without_numbers(text: &str) -> String {
    text.chars().filter(|c| !c.is_ascii_digit() && !matches!(c, '.' | '-' | '−')).collect()
}

#[cfg(test)]
#[path = "events_tests.rs"]
mod tests;
