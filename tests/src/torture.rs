//! Ten thousand damaged copies (mutants) of real recordings: none ends the program, hangs or takes much memory, and
//! whatever is missing of the content of intact records is reported.
//!
//! The mutations know the structure of a log: they set lengths, sizes, times and opcodes of its records to the most
//! harmful values, and flip, zero, delete and insert bytes anywhere. Seeds are fixed, so that a number identifies a
//! mutant. `just torture` runs all mutants and prints the figures; the tests run some of them.

use bytes::Bytes;
use rcs_log::{CursorOptions, Log, LogMessage, LogWriter, Lost, WriteHeader, WriterOptions};
use rcs_msg::Stamp;
use rcs_testkit::logs::SharedSink;
use std::collections::BTreeSet;
use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Number of mutants of `just torture`, and of a test run.
const ALL: usize = 10_000;
const SOME: usize = 400;
/// Greatest size of a recording; mutants of larger ones would only take longer.
const LARGEST: u64 = 4 << 20;
/// Time limit for opening and reading a mutant (in the dev profile, on a machine with other work).
const MOST_TIME: Duration = Duration::from_secs(10);
/// Memory limit of a process that reads mutants, bytes, including the recordings.
const MOST_BYTES: u64 = 600 << 20;
const HOUR_S: f64 = 3600.0;

/// A recording with its structure.
struct Original {
    name: String,
    bytes: Bytes,
    /// Offsets of the records outside of chunks, with their opcodes.
    records: Vec<(usize, u8)>,
    messages: Vec<Known>,
    /// All messages that it has.
    total: usize,
    duration_s: f64,
    lost: Lost,
    problems: usize,
}

/// A message by its content, and the bytes of the file that it depends on.
struct Known {
    key: u64,
    record: (usize, usize),
}

/// A small pseudo-random generator with a literal seed.
struct Numbers(u64);

impl Numbers {
    fn of(number: usize) -> Self {
        let mut numbers = Self((number as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15));
        for _ in 0..8 {
            numbers.next();
        }
        numbers
    }

    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    fn below(&mut self, limit: usize) -> usize {
        (self.next() % limit.max(1) as u64) as usize
    }
}

fn key(message: &LogMessage) -> u64 {
    let mut hasher = DefaultHasher::new();
    (message.topic.0, message.log_time.0, message.sequence, &message.data).hash(&mut hasher);
    hasher.finish()
}

fn u64_at(bytes: &[u8], at: usize) -> Option<u64> {
    Some(u64::from_le_bytes(bytes.get(at..at.checked_add(8)?)?.try_into().ok()?))
}

/// Offsets of the starts and ends of the records of a sound log.
fn records(bytes: &[u8]) -> Vec<(usize, u8)> {
    let (mut at, mut found) = (8, Vec::new());
    while let (Some(&op), Some(length)) = (bytes.get(at), u64_at(bytes, at.saturating_add(1))) {
        if at + 9 > bytes.len() || op == 0 {
            break;
        }
        found.push((at, op));
        at = at.saturating_add(9).saturating_add(length as usize);
    }
    found
}

const CHUNK: u8 = 0x06;
const MESSAGE: u8 = 0x05;
const STATISTICS: u8 = 0x0b;
const FOOTER: u8 = 0x02;

impl Original {
    fn new(name: String, bytes: Bytes) -> Option<Self> {
        let log = Log::from_bytes(bytes.clone()).ok()?;
        let records = records(&bytes);
        let end = |index: usize| records.get(index + 1).map_or(bytes.len(), |next| next.0);
        let mut messages = Vec::new();
        for (index, &(at, op)) in records.iter().enumerate() {
            if !matches!(op, CHUNK | MESSAGE) {
                continue;
            }
            // The messages of this record, read from a log that contains only this record.
            let alone: Vec<u8> = b"\x89MCAP0\r\n".iter().chain(&bytes[at..end(index)]).copied().collect();
            let Ok(alone) = Log::from_bytes(alone.into()) else { continue };
            let found = alone.cursor(CursorOptions::default()).flatten();
            messages.extend(found.map(|message| Known { key: key(&message), record: (at, end(index)) }));
        }
        let info = log.info();
        let keys: Vec<u64> = log.cursor(CursorOptions::default()).flatten().map(|it| key(&it)).collect();
        let total = keys.len();
        let all: BTreeSet<u64> = keys.into_iter().collect();
        // What a single record does not tell (for example a channel that is defined elsewhere) is taken from the
        // complete log.
        messages.retain(|known| all.contains(&known.key));
        let (duration_s, lost, problems) = (info.duration_s(), info.lost, info.problems.len());
        Some(Self { name, bytes, records, messages, total, duration_s, lost, problems })
    }
}

/// The recordings of other programs, and two of ours.
fn originals() -> Option<Vec<Original>> {
    fn logs_under(folder: &std::path::Path, found: &mut Vec<PathBuf>) {
        for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
            let path = entry.path();
            if path.is_dir() {
                logs_under(&path, found);
            } else if path.extension().is_some_and(|it| it == "mcap") {
                found.push(path);
            }
        }
    }
    let data = rcs_testkit::data_dir()?;
    let mut paths = Vec::new();
    for folder in ["real-logs", "mcap-crate-drive", "rosbag2-mcap", "ros2-typed-mcap"] {
        logs_under(&data.join(folder), &mut paths);
    }
    paths.sort();
    let small = paths.into_iter().filter(|path| path.metadata().is_ok_and(|it| it.len() <= LARGEST));
    let read = small.filter_map(|path| {
        Original::new(path.display().to_string(), std::fs::read(&path).expect("it is there").into())
    });
    let mut originals: Vec<Original> = read.filter(|original| !original.messages.is_empty()).collect();
    originals.extend(Original::new("ours, compressed".to_owned(), ours(true)));
    originals.extend(Original::new("ours, as it is".to_owned(), ours(false)));
    assert!(originals.len() > 12, "{} recordings", originals.len());
    Some(originals)
}

/// A recording of three topics, from our own writer.
fn ours(compress: bool) -> Bytes {
    let sink = SharedSink::default();
    let options = WriterOptions { compress, chunk_bytes: 4000, ..WriterOptions::default() };
    let mut writer = LogWriter::with_sink(Box::new(sink.clone()), PathBuf::new(), options).expect("a writer");
    let schema = rcs_msg::registry().schema("foxglove.Pose").expect("a schema");
    let channels: Vec<_> = (0..3)
        .map(|i| {
            writer
                .add_channel(&format!("/{i}"), schema, &std::collections::BTreeMap::default())
                .expect("a channel")
        })
        .collect();
    let mut numbers = Numbers::of(0);
    for index in 0..3000 {
        let time = Stamp(1_700_000_000_000_000_000 + index as u64 * 1_000_000);
        let header = WriteHeader { sequence: index as u32, log_time: time, publish_time: time };
        let data: Vec<u8> = (0..numbers.below(60)).map(|_| numbers.next() as u8 % 16).collect();
        writer.write(channels[index % 3], header, &data).expect("a message");
    }
    writer.finish().expect("a summary");
    sink.snapshot().into()
}

/// A harmful value in place of another number.
fn hurting(numbers: &mut Numbers, was: u64) -> u64 {
    match numbers.below(10) {
        0 => 0,
        1 => u64::MAX,
        2 => was.wrapping_add(1),
        3 => was.wrapping_sub(1),
        4 => was / 2,
        5 => was.wrapping_mul(2),
        6 => was ^ (1 << numbers.below(64)),
        7 => u64::from(u32::MAX),
        8 => i64::MAX as u64,
        _ => numbers.next(),
    }
}

/// A damaged copy, and which bytes of the original it does not contain unchanged.
fn mutant(original: &Original, numbers: &mut Numbers) -> (Vec<u8>, Vec<(usize, usize)>) {
    let mut bytes = original.bytes.to_vec();
    let mut touched = Vec::new();
    let length = bytes.len();
    let (record, op) = original.records[numbers.below(original.records.len())];
    let put = |bytes: &mut Vec<u8>, touched: &mut Vec<_>, at: usize, value: &[u8]| {
        let end = (at + value.len()).min(bytes.len());
        if at < end {
            bytes[at..end].copy_from_slice(&value[..end - at]);
            touched.push((at, end));
        }
    };
    // Whether the summary is removed, as after a kill, so that the log must be scanned.
    if numbers.below(3) == 0
        && let Some((footer, _)) = original.records.iter().find(|(_, op)| *op == 0x0f)
    {
        touched.push((*footer, length));
        bytes.truncate(*footer);
    }
    match numbers.below(14) {
        0 | 1 => {
            let at = numbers.below(bytes.len());
            bytes[at] ^= 1 << numbers.below(8);
            touched.push((at, at + 1));
        }
        2 => {
            let at = numbers.below(bytes.len());
            let filler = [0, 0xff, numbers.next() as u8][numbers.below(3)];
            let count = 1 + numbers.below(2000);
            put(&mut bytes, &mut touched, at, &vec![filler; count]);
        }
        3 => {
            let at = numbers.below(bytes.len());
            let noise: Vec<u8> = (0..=numbers.below(2000)).map(|_| numbers.next() as u8).collect();
            put(&mut bytes, &mut touched, at, &noise);
        }
        4 | 5 => {
            let at = 8 + numbers.below(bytes.len() - 8);
            let end = (at + 1 + numbers.below(3000)).min(bytes.len());
            bytes.drain(at..end);
            touched.push((at, end));
        }
        6 => {
            let at = 8 + numbers.below(bytes.len() - 8);
            let noise: Vec<u8> = (0..=numbers.below(3000)).map(|_| numbers.next() as u8).collect();
            bytes.splice(at..at, noise);
            touched.push((at.saturating_sub(1), at + 1));
        }
        7 => {
            let at = 8 + numbers.below(bytes.len() - 8);
            bytes.truncate(at);
            touched.push((at, length));
        }
        8 | 9 => {
            let value = hurting(numbers, u64_at(&original.bytes, record + 1).unwrap_or(0));
            put(&mut bytes, &mut touched, record + 1, &value.to_le_bytes());
        }
        10 => put(&mut bytes, &mut touched, record, &[numbers.next() as u8 % 20]),
        _ => {
            // A field of a chunk, of the statistics or of the footer.
            let wanted = [CHUNK, CHUNK, CHUNK, STATISTICS, FOOTER][numbers.below(5)];
            let of_kind: Vec<usize> =
                original.records.iter().filter(|(_, op)| *op == wanted).map(|(at, _)| *at).collect();
            let Some(&at) = of_kind.get(numbers.below(of_kind.len())) else {
                put(&mut bytes, &mut touched, record, &[op.wrapping_add(1)]);
                return (bytes, touched);
            };
            let field = match wanted {
                CHUNK => [9, 17, 25, 33, 37, 41, 45][numbers.below(7)],
                STATISTICS => [9, 17, 19, 23, 31, 35, 43, 55, 57][numbers.below(9)],
                _ => [9, 17, 25][numbers.below(3)],
            };
            let value = hurting(numbers, u64_at(&original.bytes, at + field).unwrap_or(0));
            let width = if field == 33 || field == 37 { 4 } else { 8 };
            put(&mut bytes, &mut touched, at + field, &value.to_le_bytes()[..width]);
        }
    }
    (bytes, touched)
}

/// Result of reading the mutants.
#[derive(Default)]
struct Figures {
    said: usize,
    silent: Vec<String>,
    /// Number of messages of intact records that were not found, and of mutants concerned.
    missed: usize,
    missed_in: usize,
    /// Number of messages of the originals, and of those that were read from their mutants.
    whole: usize,
    found: usize,
    slowest: Duration,
    failures: Vec<String>,
}

fn judge(original: &Original, number: usize, figures: &Mutex<Figures>) {
    let mut numbers = Numbers::of(number);
    let (bytes, touched) = mutant(original, &mut numbers);
    let name = format!("mutant {number} of {}", original.name);
    let began = Instant::now();
    let read = rcs_msg::guard::guarded(|| {
        let log = Log::from_bytes(bytes.into()).ok()?;
        let found: Vec<u64> = log.cursor(CursorOptions::default()).flatten().map(|it| key(&it)).collect();
        let _ = log.latest_at(log.info().end, None);
        for attachment in log.attachments() {
            let _ = log.read_attachment(attachment);
        }
        Some((log, found))
    });
    let took = began.elapsed();
    let mut figures = figures.lock().unwrap_or_else(PoisonError::into_inner);
    figures.whole += original.total;
    figures.slowest = figures.slowest.max(took);
    let (log, found) = match read {
        Ok(Some(read)) => read,
        // Without its first bytes a file is not a log, and the error says so.
        Ok(None) => {
            figures.said += 1;
            return;
        }
        Err(panic) => return figures.failures.push(format!("{name}: {panic}")),
    };
    if took > MOST_TIME {
        figures.failures.push(format!("{name}: {took:?}"));
    }
    let said = log.lost() != original.lost || log.problems().len() > original.problems;
    figures.said += usize::from(said);
    figures.found += found.len();
    let fewer = original.total.saturating_sub(found.len());
    let found: BTreeSet<u64> = found.into_iter().collect();
    let is_intact = |known: &Known| {
        let (from, to) = known.record;
        !touched.iter().any(|&(a, b)| a < to && b > from)
    };
    let missed =
        original.messages.iter().filter(|known| is_intact(known) && !found.contains(&known.key)).count();
    figures.missed += missed;
    figures.missed_in += usize::from(missed > 0);
    let longer = log.info().duration_s() > original.duration_s + HOUR_S;
    // A byte of a message's own data that changed without a checksum cannot be noticed: the message is there, and
    // differs.
    if !said && (missed > 0 || fewer > 0 || longer) {
        figures.silent.push(format!(
            "{name}: {missed} intact and {fewer} in all missing, duration {} s",
            log.info().duration_s()
        ));
    }
}

fn torture(count: usize) {
    let Some(originals) = originals() else { return };
    let figures = Mutex::new(Figures::default());
    let next = AtomicUsize::new(0);
    let work = || {
        while let Some(number) = Some(next.fetch_add(1, Ordering::Relaxed)).filter(|number| *number < count) {
            judge(&originals[number % originals.len()], number, &figures);
        }
    };
    std::thread::scope(|scope| {
        for _ in 1..std::thread::available_parallelism().map_or(1, usize::from) {
            scope.spawn(work);
        }
        work();
    });
    let figures = figures.into_inner().unwrap_or_else(PoisonError::into_inner);
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).unwrap_or_default();
    let peak = peak.split_whitespace().next().and_then(|kb| kb.parse::<u64>().ok()).unwrap_or(0) * 1024;
    let Figures { said, silent, missed, missed_in, whole, found, slowest, failures } = figures;
    eprintln!(
        "{count} mutants of {} recordings: damage said of {said}, {} panics or hangs, {} silent losses, {missed} messages of \
         intact records not found in {missed_in} mutants (said), {found} of {whole} messages read, \
         slowest {slowest:.2?}, {} MB at most",
        originals.len(),
        failures.len(),
        silent.len(),
        peak >> 20,
    );
    let list = |lines: &[String]| lines.iter().take(20).cloned().collect::<Vec<_>>().join("\n");
    assert!(failures.is_empty(), "{}", list(&failures));
    assert!(silent.is_empty(), "{}", list(&silent));
    assert!(missed_in * 100 <= count, "messages of intact records are not found in {missed_in} of {count}");
    // A mutant is damaged in one place, and most messages are in recordings of at least eight chunks.
    assert!(found * 4 >= whole * 3, "{found} of {whole} messages read");
    assert!(peak < MOST_BYTES, "{peak} bytes");
}

#[test]
fn some_damaged_recordings_are_read_as_far_as_they_are_sound_and_say_so() {
    torture(SOME);
}

#[test]
#[ignore = "takes minutes: just torture"]
fn ten_thousand_damaged_recordings_are_read_as_far_as_they_are_sound_and_say_so() {
    torture(ALL);
}
