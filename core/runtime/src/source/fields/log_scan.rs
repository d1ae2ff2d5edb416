//! Fields of a log: the whole log is read once for all fields that were named together, on a thread of its own.

use super::extract::Extractor;
use super::pieces::read_pieces;
use super::reader::{Reader, Told, Wanted, lock};
use super::{FieldPoint, FieldSeries};
use crate::source::run_tag::RunTag;
use crate::source::series::SeriesWriter;
use rcs_formula::FieldRef;
use rcs_log::{CursorOptions, Log, LogError, MessagePosition, Reassembly, TopicId};
use rcs_msg::{AnyMessage, Schema, Stamp};
use std::collections::BTreeMap;
use std::ops::RangeInclusive;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};

/// Messages between two looks at whether to go on, and reports of the progress.
const PIECE: usize = 2048;

/// One field of a log.
struct Growing {
    field: FieldRef,
    points: Arc<SeriesWriter<FieldPoint>>,
    told: Arc<Mutex<Told>>,
}

/// The fields of a log that were named.
#[derive(Default)]
pub(crate) struct LogFields {
    fields: Vec<Growing>,
    stop: Arc<AtomicBool>,
    /// Set for each thread when it has ended.
    ended: Vec<Arc<AtomicBool>>,
}

impl Drop for LogFields {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
    }
}

/// Where a topic is in a log: its schema and its channels, including its deltas.
pub(crate) type Place = (Arc<Schema>, Vec<TopicId>);

impl LogFields {
    /// Gathers these fields, and no others; `find` gives the place of a topic that the log has.
    pub(crate) fn gather(&mut self, log: &Log, fields: &[FieldRef], find: impl Fn(&str) -> Option<Place>) {
        self.fields.retain(|known| fields.contains(&known.field));
        let mut wanted: BTreeMap<&str, Wanted> = BTreeMap::new();
        for field in fields {
            if self.fields.iter().any(|known| known.field == *field) {
                continue;
            }
            let Some((schema, ids)) = find(&field.topic) else { continue };
            let (points, told) = (Arc::new(SeriesWriter::default()), Arc::new(Mutex::new(Told::default())));
            match Extractor::new(&schema, &field.path) {
                Ok(extractor) => {
                    lock(&told).reading = Some(0.0);
                    let reader = Reader { extractor, points: Arc::clone(&points), told: Arc::clone(&told) };
                    let topic = wanted.entry(&field.topic);
                    topic.or_insert_with(|| Wanted { schema, ids, readers: Vec::new() }).readers.push(reader);
                }
                Err(problem) => lock(&told).problem = Some(problem.into()),
            }
            self.fields.push(Growing { field: field.clone(), points, told });
        }
        let wanted: Vec<Wanted> = wanted.into_values().collect();
        if wanted.is_empty() {
            return;
        }
        let (log, stop, ended) = (log.clone(), Arc::clone(&self.stop), Arc::new(AtomicBool::new(false)));
        let told: Vec<_> =
            wanted.iter().flat_map(|topic| &topic.readers).map(|reader| Arc::clone(&reader.told)).collect();
        self.ended.push(Arc::clone(&ended));
        let read = move || {
            let (start, end) = (log.info().start, log.info().end);
            let span_s = end.seconds_since(start).max(1e-9);
            // The log has reported chunks that cannot be read; the cursor continues after them.
            let _ = read_topics(&log, wanted, &(start..=end), |time, readers| {
                for reader in readers {
                    reader.tell(Some(time.seconds_since(start) / span_s));
                }
                !stop.load(Ordering::Relaxed)
            });
            ended.store(true, Ordering::Relaxed);
        };
        if let Err(error) = std::thread::Builder::new().name("fields".to_owned()).spawn(read) {
            for told in told {
                *lock(&told) = Told {
                    problem: Some(format!("no thread to read the log: {error}").into()),
                    ..Told::default()
                };
            }
            self.ended.pop();
        }
    }

    /// Whether a thread is reading.
    pub(crate) fn is_reading(&mut self) -> bool {
        self.ended.retain(|ended| !ended.load(Ordering::Relaxed));
        !self.ended.is_empty()
    }

    /// The fields, as far as they have been read.
    pub(crate) fn read(&self) -> impl Iterator<Item = FieldSeries> + '_ {
        self.fields.iter().map(|growing| {
            let told = lock(&growing.told);
            FieldSeries {
                field: growing.field.clone(),
                run: RunTag::Recorded,
                points: growing.points.read(),
                names: Arc::clone(&told.names),
                reading: told.reading,
                problem: told.problem.clone(),
            }
        })
    }
}

/// Reads these topics until `go_on` refuses: numbers on several threads, and texts and what was recorded as deltas in the
/// order of the log.
fn read_topics(
    log: &Log,
    wanted: Vec<Wanted>,
    times: &RangeInclusive<Stamp>,
    mut go_on: impl FnMut(Stamp, &[&Reader]) -> bool,
) -> Result<(), LogError> {
    let reassembly = Reassembly::new(log);
    let (mut direct, mut in_order) = (Vec::new(), Vec::new());
    for Wanted { schema, ids, readers } in wanted {
        let is_whole = !ids.iter().any(|id| reassembly.takes(*id));
        let (numbers, others): (Vec<_>, Vec<_>) =
            readers.into_iter().partition(|reader| is_whole && reader.extractor.is_direct());
        let topic = |readers| Wanted { schema: Arc::clone(&schema), ids: ids.clone(), readers };
        direct.extend((!numbers.is_empty()).then(|| topic(numbers)));
        in_order.extend((!others.is_empty()).then(|| topic(others)));
    }
    let mut is_stopped = false;
    let mut pieces = Ok(());
    if !direct.is_empty() {
        let read = read_pieces(log, &mut direct, times, |time, readers| {
            is_stopped |= !go_on(time, readers);
            !is_stopped
        });
        match read {
            Some(read) => pieces = read,
            None => in_order.append(&mut direct),
        }
        if !is_stopped {
            direct.iter().flat_map(|topic| &topic.readers).for_each(|reader| reader.tell(None));
        }
    }
    if is_stopped || in_order.is_empty() {
        return pieces;
    }
    read_in_order(log, in_order, times, go_on).and(pieces)
}

/// Reads these topics in one pass, until `go_on` refuses.
fn read_in_order(
    log: &Log,
    mut wanted: Vec<Wanted>,
    times: &RangeInclusive<Stamp>,
    mut go_on: impl FnMut(Stamp, &[&Reader]) -> bool,
) -> Result<(), LogError> {
    let mut reassembly = Reassembly::new(log);
    let mut by_id: BTreeMap<TopicId, usize> = BTreeMap::new();
    for (index, topic) in wanted.iter().enumerate() {
        by_id.extend(topic.ids.iter().map(|&id| (id, index)));
    }
    let options = CursorOptions {
        topics: Some(by_id.keys().copied().collect()),
        start: *times.start(),
        end: *times.end(),
    };
    let mut failed = Ok(());
    // Messages that were recorded as deltas need the key frame before, also where it is before the range.
    if *times.start() > log.info().start && by_id.keys().any(|&id| reassembly.takes(id)) {
        failed = reassembly.seek(MessagePosition::before(*times.start())).map(drop);
    }
    for (count, stored) in log.cursor(options).enumerate() {
        let stored = match stored {
            Ok(stored) => stored,
            Err(error) => {
                failed = Err(error);
                continue;
            }
        };
        if let Some(topic) = by_id.get(&stored.topic).map(|&index| &mut wanted[index]) {
            if !reassembly.takes(stored.topic) {
                let message = AnyMessage::encoded(Arc::clone(&topic.schema), stored.data.clone());
                topic.readers.iter_mut().for_each(|reader| reader.take(stored.log_time, &message));
            } else if let Some(whole) = reassembly.take(&stored) {
                topic.readers.iter_mut().for_each(|reader| reader.take(stored.log_time, &whole.message));
            }
        }
        if count % PIECE == 0 {
            let readers: Vec<&Reader> = wanted.iter().flat_map(|topic| &topic.readers).collect();
            if !go_on(stored.log_time, &readers) {
                return failed;
            }
        }
    }
    wanted.iter().flat_map(|topic| &topic.readers).for_each(|reader| reader.tell(None));
    failed
}

/// Reads fields of a log between two times at once. A field that the log does not have has a problem and no points.
pub fn read_fields(log: &Log, fields: &[FieldRef], times: RangeInclusive<Stamp>) -> Vec<FieldSeries> {
    let reassembly = Reassembly::new(log);
    let mut found = Vec::new();
    for field in fields {
        let mut topics =
            log.info().topics_named(&field.topic).filter(|topic| reassembly.keys_of(topic.id).is_none());
        let made = topics.next().ok_or_else(|| format!("the log has no topic {}", field.topic));
        let made = made.and_then(|topic| Ok((topic, Extractor::new(&topic.schema, &field.path)?)));
        let (points, told) = (Arc::new(SeriesWriter::default()), Arc::new(Mutex::new(Told::default())));
        match made {
            Ok((topic, extractor)) => {
                let ids = [Some(topic.id), reassembly.deltas_of(topic.id)].into_iter().flatten().collect();
                let reader = Reader { extractor, points: Arc::clone(&points), told: Arc::clone(&told) };
                let wanted = Wanted { schema: Arc::clone(&topic.schema), ids, readers: vec![reader] };
                found.push((field.clone(), points, told, Some((topic.id, wanted))));
            }
            Err(problem) => {
                lock(&told).problem = Some(problem.into());
                found.push((field.clone(), points, told, None));
            }
        }
    }
    // One pass for all; fields of one topic share its messages.
    let mut wanted: BTreeMap<TopicId, Wanted> = BTreeMap::new();
    for (id, mut topic) in found.iter_mut().filter_map(|(.., topic)| topic.take()) {
        match wanted.get_mut(&id) {
            Some(known) => known.readers.append(&mut topic.readers),
            None => drop(wanted.insert(id, topic)),
        }
    }
    let read = read_topics(log, wanted.into_values().collect(), &times, |_, _| true);
    let series = found.into_iter().map(|(field, points, told, _)| {
        let told = lock(&told);
        let problem =
            told.problem.clone().or_else(|| read.as_ref().err().map(|error| error.to_string().into()));
        FieldSeries {
            field,
            run: RunTag::Recorded,
            points: points.read(),
            names: Arc::clone(&told.names),
            reading: None,
            problem,
        }
    });
    series.collect()
}
