//! Fields of a log: the whole log is read once for all fields that were named together, on a thread of its own, which ends
//! when none of them is wanted any more.

use super::channels::{Channels, Chosen, alike, choose};
use super::pieces::read_pieces;
use super::reader::{Reader, Told, Wanted, lock};
use super::{FieldPoint, FieldSeries};
use crate::source::run_tag::RunTag;
use crate::source::series::SeriesWriter;
use rcs_formula::FieldRef;
use rcs_log::{CursorOptions, Log, LogError, MessagePosition, Reassembly, TopicId};
use rcs_msg::{AnyMessage, Stamp};
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
    /// Set for each thread when it has ended.
    ended: Vec<Arc<AtomicBool>>,
}

impl LogFields {
    /// Gathers these fields, and no others; `find` gives the channels of a topic, and none if the log does not have it.
    pub(crate) fn gather(&mut self, log: &Log, fields: &[FieldRef], find: impl Fn(&str) -> Vec<Channels>) {
        self.fields.retain(|known| fields.contains(&known.field));
        let mut wanted: BTreeMap<Vec<TopicId>, Wanted> = BTreeMap::new();
        for field in fields {
            if self.fields.iter().any(|known| known.field == *field) {
                continue;
            }
            let groups = find(&field.topic);
            if groups.is_empty() {
                continue;
            }
            let (points, told) = (Arc::new(SeriesWriter::default()), Arc::new(Mutex::new(Told::default())));
            match choose(&field.topic, &groups, &field.path) {
                Ok(Chosen { channels, extractor, problem }) => {
                    let states = Arc::clone(&extractor.states);
                    *lock(&told) = Told { states, reading: Some(0.0), problem, ..Told::default() };
                    let reader = Reader { extractor, points: Arc::clone(&points), told: Arc::clone(&told) };
                    add(&mut wanted, channels, reader);
                }
                Err(problem) => lock(&told).problem = Some(problem.into()),
            }
            self.fields.push(Growing { field: field.clone(), points, told });
        }
        let wanted: Vec<Wanted> = wanted.into_values().collect();
        if wanted.is_empty() {
            return;
        }
        let (log, ended) = (log.clone(), Arc::new(AtomicBool::new(false)));
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
                states: Arc::clone(&told.states),
                reading: told.reading,
                problem: told.problem(),
            }
        })
    }
}

/// Adds what reads one field. Fields of the same channels share their messages.
fn add(wanted: &mut BTreeMap<Vec<TopicId>, Wanted>, channels: Channels, reader: Reader) {
    let Channels { schema, ids, .. } = channels;
    let known = wanted.entry(ids.clone());
    known.or_insert_with(|| Wanted { schema, ids, readers: Vec::new() }).readers.push(reader);
}

/// Reads these topics: numbers on several threads, and texts and what was recorded as deltas in the order of the log. Each
/// part ends when none of its fields is wanted any more. `report` is told up to which time the log has been read.
fn read_topics(
    log: &Log,
    wanted: Vec<Wanted>,
    times: &RangeInclusive<Stamp>,
    mut report: impl FnMut(Stamp, &[&Reader]),
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
    let mut pieces = Ok(());
    if !direct.is_empty() {
        let read = read_pieces(log, &mut direct, times, |time, readers| {
            report(time, readers);
            is_any_wanted(readers)
        });
        match read {
            Some(read) => pieces = read,
            None => in_order.append(&mut direct),
        }
        direct.iter().flat_map(|topic| &topic.readers).for_each(|reader| reader.tell(None));
    }
    if in_order.is_empty() {
        return pieces;
    }
    read_in_order(log, in_order, times, report).and(pieces)
}

fn is_any_wanted(readers: &[&Reader]) -> bool {
    readers.iter().any(|reader| reader.is_wanted())
}

/// Reads these topics in one pass, until none of their fields is wanted any more.
fn read_in_order(
    log: &Log,
    mut wanted: Vec<Wanted>,
    times: &RangeInclusive<Stamp>,
    mut report: impl FnMut(Stamp, &[&Reader]),
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
            report(stored.log_time, &readers);
            if !is_any_wanted(&readers) {
                return failed;
            }
        }
    }
    wanted.iter().flat_map(|topic| &topic.readers).for_each(|reader| reader.tell(None));
    failed
}

/// Reads fields of a log between two times at once, with all of their texts. A field that the log does not have has a
/// problem and no points.
pub fn read_fields(log: &Log, fields: &[FieldRef], times: RangeInclusive<Stamp>) -> Vec<FieldSeries> {
    let reassembly = Reassembly::new(log);
    let mut found = Vec::new();
    // One pass for all.
    let mut wanted: BTreeMap<Vec<TopicId>, Wanted> = BTreeMap::new();
    for field in fields {
        let groups = alike(log.info().topics_named(&field.topic), &reassembly);
        let (points, told) = (Arc::new(SeriesWriter::default()), Arc::new(Mutex::new(Told::default())));
        match choose(&field.topic, &groups, &field.path) {
            Ok(Chosen { channels, extractor, problem }) => {
                let states = Arc::clone(&extractor.states);
                *lock(&told) = Told { states, problem, ..Told::default() };
                let extractor = extractor.with_all_texts();
                let reader = Reader { extractor, points: Arc::clone(&points), told: Arc::clone(&told) };
                add(&mut wanted, channels, reader);
            }
            Err(problem) => lock(&told).problem = Some(problem.into()),
        }
        found.push((field.clone(), points, told));
    }
    let read = read_topics(log, wanted.into_values().collect(), &times, |_, _| {});
    let series = found.into_iter().map(|(field, points, told)| {
        let told = lock(&told);
        let problem = told.problem().or_else(|| read.as_ref().err().map(|error| error.to_string().into()));
        FieldSeries {
            field,
            run: RunTag::Recorded,
            points: points.read(),
            names: Arc::clone(&told.names),
            states: Arc::clone(&told.states),
            reading: None,
            problem,
        }
    });
    series.collect()
}

#[cfg(test)]
mod tests {
    use super::super::extract::MOST_TEXTS;
    use super::*;
    use rcs_log::{LogWriter, WriteHeader, WriterOptions};
    use rcs_msg::{rcs, schema_of};

    const COUNT: u64 = 10_000;

    fn log(path: &std::path::Path) -> Log {
        log_of(path, COUNT, 7)
    }

    /// A log with so many messages, which have so many different texts.
    fn log_of(path: &std::path::Path, count: u64, texts: u64) -> Log {
        let options = WriterOptions { chunk_bytes: 2000, ..WriterOptions::default() };
        let mut writer = LogWriter::create(path, options).unwrap();
        let channel = writer.add_channel("/a", schema_of::<rcs::Status>(), &BTreeMap::new()).unwrap();
        for cycle in 0..count {
            let state_text = format!("text {}", cycle % texts);
            let status = rcs::Status { cycle, state_text, ..rcs::Status::default() };
            let time = Stamp(cycle + 1);
            let header = WriteHeader { sequence: cycle as u32, log_time: time, publish_time: time };
            writer.write(channel, header, &AnyMessage::new(status).bytes()).unwrap();
        }
        writer.finish().unwrap();
        Log::open(path).unwrap()
    }

    #[test]
    fn an_export_has_every_text_and_a_plot_says_that_it_has_not() {
        let folder = tempfile::tempdir().unwrap();
        let count = MOST_TEXTS as u64 + 5;
        let log = log_of(&folder.path().join("texts.mcap"), count, count);
        let field = FieldRef { topic: "/a".to_owned(), path: "state_text".parse().unwrap() };
        let all = log.info().start..=log.info().end;
        let series = read_fields(&log, std::slice::from_ref(&field), all).remove(0);
        assert_eq!((series.points.len() as u64, &series.problem), (count, &None));
        let last = series.points.last().unwrap().value as i64;
        assert_eq!(series.names[&last].to_string(), format!("text {}", count - 1));
        let mut fields = LogFields::default();
        fields.gather(&log, &[field], |name| alike(log.info().topics_named(name), &Reassembly::new(&log)));
        while fields.is_reading() {
            std::thread::yield_now();
        }
        let series = fields.read().next().unwrap();
        let problem = series.problem.unwrap();
        assert!(series.points.last().unwrap().value.is_nan() && problem.contains("first 10000"), "{problem}");
    }

    #[test]
    fn messages_that_do_not_decode_are_counted_and_the_first_says_why() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("broken.mcap");
        let options = WriterOptions { chunk_bytes: 200, ..WriterOptions::default() };
        let mut writer = LogWriter::create(&path, options).unwrap();
        let channel = writer.add_channel("/a", schema_of::<rcs::Status>(), &BTreeMap::new()).unwrap();
        for number in 1..=100 {
            // An empty message has the default values.
            let data: &[u8] = if number % 2 == 0 { &[0xff] } else { &[] };
            let time = Stamp(number);
            let header = WriteHeader { sequence: number as u32, log_time: time, publish_time: time };
            writer.write(channel, header, data).unwrap();
        }
        writer.finish().unwrap();
        let log = Log::open(&path).unwrap();
        let field = |path: &str| FieldRef { topic: "/a".to_owned(), path: path.parse().unwrap() };
        let fields = ["cycle", "state_text"].map(field);
        let exported = read_fields(&log, &fields, log.info().start..=log.info().end);
        let mut plotted = LogFields::default();
        plotted.gather(&log, &fields, |name| alike(log.info().topics_named(name), &Reassembly::new(&log)));
        while plotted.is_reading() {
            std::thread::yield_now();
        }
        for series in exported.into_iter().chain(plotted.read()) {
            assert_eq!(series.points.len(), 100);
            let problem = series.problem.unwrap();
            assert!(problem.starts_with("50 messages do not decode, the first: "), "{problem}");
        }
    }

    #[test]
    fn all_states_of_an_enum_are_known_although_the_log_has_only_one_of_them() {
        let folder = tempfile::tempdir().unwrap();
        let log = log_of(&folder.path().join("states.mcap"), 10, 1);
        let field = FieldRef { topic: "/a".to_owned(), path: "state".parse().unwrap() };
        let field = std::slice::from_ref(&field);
        let mut fields = LogFields::default();
        fields.gather(&log, field, |name| alike(log.info().topics_named(name), &Reassembly::new(&log)));
        let plotted = fields.read().next().unwrap();
        let exported = read_fields(&log, field, log.info().start..=log.info().end).remove(0);
        for series in [plotted, exported] {
            assert_eq!(series.states[..], ["UNINITIALIZED", "EXEC", "DONE", "ERROR"]);
        }
    }

    #[test]
    fn reading_ends_when_none_of_its_fields_is_wanted_any_more() {
        let folder = tempfile::tempdir().unwrap();
        let log = log(&folder.path().join("fields.mcap"));
        // How often the progress is reported, and how many points of a number and of a text are read.
        let read = |is_held: [bool; 2]| {
            let (mut wanted, mut held) = (BTreeMap::new(), Vec::new());
            for (path, is_held) in ["cycle", "state_text"].into_iter().zip(is_held) {
                let groups = alike(log.info().topics_named("/a"), &Reassembly::new(&log));
                let chosen = choose("/a", &groups, &path.parse().unwrap()).unwrap();
                let points = Arc::new(SeriesWriter::default());
                let reader =
                    Reader { extractor: chosen.extractor, points: Arc::clone(&points), told: Arc::default() };
                add(&mut wanted, chosen.channels, reader);
                held.extend(is_held.then_some(points));
            }
            let mut reports = 0_usize;
            let times = log.info().start..=log.info().end;
            read_topics(&log, wanted.into_values().collect(), &times, |_, _| reports += 1).unwrap();
            let counts: Vec<usize> = held.iter().map(|points| points.read().len()).collect();
            (reports, counts)
        };
        let all = COUNT as usize;
        let (reports, counts) = read([true, true]);
        assert!(reports > 20 && counts == [all, all], "{reports} {counts:?}");
        assert_eq!(read([false, false]), (2, Vec::new()), "each part ends where it first looks");
        let in_order = COUNT.div_ceil(PIECE as u64) as usize;
        assert_eq!(read([false, true]), (1 + in_order, vec![all]), "the other part is read whole");
    }
}
