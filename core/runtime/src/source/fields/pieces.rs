//! Reads numbers from the pieces of a log on several threads, and puts them in order.
//!
//! The points of a series need an order within their topic alone, and most pieces do not overlap in time: then what one
//! piece gives is appended as it is. Points of pieces that overlap wait until no later piece can have an earlier one.

use super::FieldPoint;
use super::extract::{Extractor, Undecoded};
use super::reader::{Reader, Wanted};
use rcs_log::{CursorOptions, Log, LogError, MessagePosition, Piece, TopicId};
use rcs_msg::{AnyMessage, Schema, Stamp};
use std::collections::BTreeMap;
use std::ops::RangeInclusive;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::{self, SyncSender};

/// Most threads that read at the same time.
const MOST_THREADS: usize = 8;
/// Waiting points are put in order when there are this many more of them.
const WAITING: usize = 1 << 16;

/// A point with its place in the order of the log.
type Placed = (MessagePosition, FieldPoint);

/// What a thread found in a piece.
struct Found {
    index: usize,
    /// In the order of the readers.
    points: Result<Vec<Vec<Placed>>, LogError>,
    /// The messages that do not decode, in the order of the readers.
    undecoded: Vec<Undecoded>,
    /// The extractors of a thread that has learned the names of states.
    learned: Option<Vec<Extractor>>,
}

/// What the threads share.
struct Job<'a> {
    log: &'a Log,
    options: CursorOptions,
    pieces: Vec<Piece>,
    /// The topics with their schemas and the numbers of their readers.
    topics: BTreeMap<TopicId, (Arc<Schema>, Vec<usize>)>,
    /// The next piece that nobody reads.
    next: AtomicUsize,
    stop: AtomicBool,
}

impl Job<'_> {
    /// Reads pieces until there is none left, or nobody wants to know.
    fn read(&self, mut extractors: Vec<Extractor>, found: &SyncSender<Found>) {
        let known = |extractors: &[Extractor]| -> Vec<usize> {
            extractors.iter().map(|extractor| extractor.names.len()).collect()
        };
        let mut told = known(&extractors);
        while !self.stop.load(Ordering::Relaxed) {
            let index = self.next.fetch_add(1, Ordering::Relaxed);
            let Some(piece) = self.pieces.get(index) else { return };
            let points = self.read_piece(piece, &mut extractors);
            let undecoded = extractors.iter_mut().map(Extractor::take_undecoded).collect();
            let now = known(&extractors);
            let learned = (now != told).then(|| extractors.clone());
            told = now;
            if found.send(Found { index, points, undecoded, learned }).is_err() {
                return;
            }
        }
    }

    fn read_piece(&self, piece: &Piece, extractors: &mut [Extractor]) -> Result<Vec<Vec<Placed>>, LogError> {
        let mut points: Vec<Vec<Placed>> = vec![Vec::new(); extractors.len()];
        if extractors.iter().all(Extractor::is_time) {
            let is_indexed = self.log.read_times(piece, &self.options, |topic, place| {
                for &reader in self.topics.get(&topic).map_or(&[][..], |(_, readers)| readers) {
                    points[reader].push((place, FieldPoint { stamp: place.time, value: 1.0 }));
                }
            })?;
            if is_indexed {
                return Ok(points);
            }
        }
        self.log.read_piece(piece, &self.options, |message| {
            let Some((schema, readers)) = self.topics.get(&message.topic) else { return };
            for &reader in readers {
                let value = extractors[reader].read_bytes(message.data, || {
                    AnyMessage::encoded(Arc::clone(schema), message.data.to_vec().into())
                });
                points[reader].push((message.place, FieldPoint { stamp: message.log_time, value }));
            }
        })?;
        Ok(points)
    }
}

/// Reads these topics, whose readers read numbers, until `go_on` refuses. `None` if the system has no threads for it:
/// then nothing was read.
pub(super) fn read_pieces(
    log: &Log,
    wanted: &mut [Wanted],
    times: &RangeInclusive<Stamp>,
    mut go_on: impl FnMut(Stamp, &[&Reader]) -> bool,
) -> Option<Result<(), LogError>> {
    let mut topics = BTreeMap::new();
    let mut readers: Vec<&mut Reader> = Vec::new();
    for topic in wanted {
        let from = readers.len();
        readers.extend(&mut topic.readers);
        let numbers: Vec<usize> = (from..readers.len()).collect();
        topics.extend(topic.ids.iter().map(|&id| (id, (Arc::clone(&topic.schema), numbers.clone()))));
    }
    let options = CursorOptions {
        topics: Some(topics.keys().copied().collect()),
        start: *times.start(),
        end: *times.end(),
    };
    let extractors: Vec<Extractor> = readers.iter().map(|reader| reader.extractor.clone()).collect();
    let (next, stop, pieces) = (AtomicUsize::new(0), AtomicBool::new(false), log.pieces(&options));
    let job = Job { log, options, pieces, topics, next, stop };
    let threads = std::thread::available_parallelism().map_or(1, |count| count.get().min(MOST_THREADS));
    // Threads that are far ahead wait, so that what they found does not fill the memory.
    let (found, founds) = mpsc::sync_channel(2 * threads);
    std::thread::scope(|scope| {
        let spawned = (0..threads).filter(|number| {
            let (extractors, found, job) = (extractors.clone(), found.clone(), &job);
            let thread = std::thread::Builder::new().name(format!("fields {number}"));
            thread.spawn_scoped(scope, move || job.read(extractors, &found)).is_ok()
        });
        if spawned.count() == 0 {
            return None;
        }
        drop(found);
        let mut order = Order::new(&job.pieces, readers);
        for found in founds {
            let time = order.take(found);
            let readers: Vec<&Reader> = order.readers.iter().map(|reader| &**reader).collect();
            if !go_on(time, &readers) {
                job.stop.store(true, Ordering::Relaxed);
                break;
            }
        }
        Some(order.failed)
    })
}

/// Puts what the threads found in order.
struct Order<'a> {
    pieces: &'a [Piece],
    readers: Vec<&'a mut Reader>,
    /// The next piece.
    next: usize,
    /// Pieces that were read before it.
    early: BTreeMap<usize, Found>,
    /// By reader, points that others may precede, and how many of them there were when they were last put in order.
    waiting: Vec<(Vec<Placed>, usize)>,
    failed: Result<(), LogError>,
}

impl<'a> Order<'a> {
    fn new(pieces: &'a [Piece], readers: Vec<&'a mut Reader>) -> Self {
        let waiting = readers.iter().map(|_| (Vec::new(), 0)).collect();
        Self { pieces, readers, next: 0, early: BTreeMap::new(), waiting, failed: Ok(()) }
    }

    /// Takes what was found in a piece, and returns the time up to which the log has been read.
    fn take(&mut self, found: Found) -> Stamp {
        self.early.insert(found.index, found);
        while let Some(found) = self.early.remove(&self.next) {
            self.next += 1;
            for (reader, learned) in self.readers.iter_mut().zip(found.learned.iter().flatten()) {
                reader.extractor.learn_from(learned);
            }
            for (reader, undecoded) in self.readers.iter_mut().zip(found.undecoded) {
                reader.extractor.count_undecoded(undecoded);
            }
            match found.points {
                Ok(points) => {
                    for (reader, points) in points.into_iter().enumerate() {
                        self.place(reader, points);
                    }
                }
                Err(error) => self.failed = Err(error),
            }
        }
        let last = self.pieces.get(self.next.saturating_sub(1));
        last.map_or(Stamp(0), |piece| piece.last)
    }

    /// Appends the points of a piece, which are in order, or lets them wait.
    fn place(&mut self, reader: usize, points: Vec<Placed>) {
        let limit = self.pieces.get(self.next).map(|piece| MessagePosition::before(piece.first));
        let precedes = |placed: &Placed| limit.is_none_or(|limit| placed.0 < limit);
        let (waiting, ordered) = &mut self.waiting[reader];
        let out = &self.readers[reader].points;
        if waiting.is_empty() {
            let ready = points.partition_point(precedes);
            out.append_all(points[..ready].iter().map(|placed| placed.1));
            waiting.extend_from_slice(&points[ready..]);
            *ordered = waiting.len();
        } else {
            waiting.extend(points);
            // Sorting costs little for each point if there are many new ones.
            if limit.is_none() || waiting.len() > 2 * *ordered + WAITING {
                waiting.sort_unstable_by_key(|placed| placed.0);
                let ready = waiting.partition_point(precedes);
                out.append_all(waiting.drain(..ready).map(|placed| placed.1));
                *ordered = waiting.len();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{FieldSeries, read_fields};
    use rcs_formula::FieldRef;
    use rcs_log::{CursorOptions, Log, LogWriter, WriteHeader, WriterOptions};
    use rcs_msg::{AnyMessage, FieldScanner, Stamp, rcs, registry};
    use std::collections::BTreeMap;

    fn field(text: &str) -> FieldRef {
        let (topic, path) = text.split_once('.').unwrap();
        FieldRef { topic: topic.to_owned(), path: path.parse().unwrap() }
    }

    /// Messages of two topics whose times go to and fro, in many small chunks.
    fn log(folder: &std::path::Path, disorder: u64) -> Log {
        let path = folder.join("fields.mcap");
        let options = WriterOptions { chunk_bytes: 2000, ..WriterOptions::default() };
        let mut writer = LogWriter::create(&path, WriterOptions { replace: true, ..options }).unwrap();
        let schema = registry().schema("rcs.Status").unwrap();
        let channels = ["/a", "/b"].map(|topic| writer.add_channel(topic, schema, &BTreeMap::new()).unwrap());
        for i in 0..5000_u64 {
            let mixed = i.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40;
            let time = Stamp((i + mixed % disorder) / 3);
            let status = rcs::Status {
                cycle: i,
                state: (mixed % 4) as i32,
                state_text: format!("text {}", mixed % 7),
                ..rcs::Status::default()
            };
            let header = WriteHeader { sequence: i as u32, log_time: time, publish_time: time };
            writer.write(channels[(mixed % 2) as usize], header, &AnyMessage::new(status).bytes()).unwrap();
        }
        writer.finish().unwrap();
        Log::open(path).unwrap()
    }

    #[test]
    fn values_come_in_the_order_of_the_log_however_its_chunks_overlap() {
        let folder = tempfile::tempdir().unwrap();
        for disorder in [1, 50, 3000, 20_000] {
            let log = log(folder.path(), disorder);
            assert!(log.info().segments > 50);
            let fields: Vec<FieldRef> =
                ["/a.cycle", "/b.cycle", "/b.state", "/a.state_text"].map(field).into();
            let times = Stamp(10)..=Stamp(1500);
            let series = read_fields(&log, &fields, times.clone());
            for FieldSeries { field, points, names, problem, .. } in &series {
                assert_eq!(*problem, None);
                // The reference: each message in order, decoded.
                let topic = log.info().topics_named(&field.topic).next().unwrap();
                let options =
                    CursorOptions { topics: Some(vec![topic.id]), start: *times.start(), end: *times.end() };
                let scanner = FieldScanner::new(&topic.schema, &field.path).ok();
                for (index, message) in log.cursor(options.clone()).map(Result::unwrap).enumerate() {
                    let point = points.get(index).unwrap();
                    assert_eq!(point.stamp, message.log_time);
                    if let Some(scanner) = &scanner {
                        assert_eq!(Some(point.value), scanner.scan(&message.data).unwrap());
                    } else {
                        let value = topic.schema.value(&message.data).unwrap();
                        let text = value.get(&field.path).unwrap().as_text().map(str::to_owned);
                        assert_eq!(names.get(&(point.value as i64)).map(ToString::to_string), text);
                    }
                }
                assert_eq!(log.cursor(options).count(), points.len());
            }
            // Of two states, which are odd as the numbers of the messages of this topic.
            assert_eq!(series[2].names.len(), 2, "{:?}", series[2].names);
        }
    }
}
