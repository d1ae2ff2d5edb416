//! Truncated logs, and logs with flipped bits.

use crate::common::{Numbers, SharedSink, header, log_of, plain, read_all, writer};
use bytes::Bytes;
use proptest::prelude::*;
use rcs_log::{CursorOptions, Log, LogError, Lost, WriterOptions};
use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;

fn compressed() -> Option<Bytes> {
    let data = rcs_testkit::data_dir()?;
    Some(std::fs::read(data.join("mcap-crate-drive/compressed.mcap")).unwrap().into())
}

/// Offsets of records, with their opcodes.
fn records(log: &[u8]) -> Vec<(usize, u8)> {
    let mut at = 8;
    let mut found = Vec::new();
    while at + 8 < log.len() {
        found.push((at, log[at]));
        at += 9 + u64::from_le_bytes(log[at + 1..at + 9].try_into().unwrap()) as usize;
    }
    found
}

/// Offsets of its message indexes.
fn message_indexes(log: &[u8]) -> Vec<usize> {
    records(log).into_iter().filter(|(_, op)| *op == MESSAGE_INDEX).map(|(at, _)| at).collect()
}

const MESSAGE: u8 = 0x05;
const CHUNK: u8 = 0x06;
const MESSAGE_INDEX: u8 = 0x07;
const DATA_END: u8 = 0x0f;

#[test]
fn a_log_cut_at_any_record_boundary_keeps_every_message_before_the_cut() {
    let Some(whole) = compressed() else { return };
    let expected = read_all(&Log::from_bytes(whole.clone()).unwrap()).len() as u64;
    let mut messages = 0;
    for (at, op) in records(&whole) {
        // After a message index nothing new can be lost, so one in seven of those offsets is tested.
        if op == MESSAGE_INDEX && at % 7 != 0 {
            continue;
        }
        let log = Log::from_bytes(whole.slice(..at)).unwrap();
        let info = log.info();
        assert!(info.recovered);
        assert_eq!(info.lost, Lost::default(), "cut at {at}: {:?}", info.problems);
        assert!(info.messages >= messages, "cut at {at}");
        assert!(info.problems[0].contains("cut"), "{:?}", info.problems);
        messages = info.messages;
        if at % 50 == 0 {
            assert_eq!(read_all(&log).len() as u64, messages, "cut at {at}");
        }
        if op == DATA_END {
            assert_eq!(messages, expected, "the data end behind every message");
        }
    }
}

#[test]
fn a_log_cut_anywhere_opens_says_what_was_lost_and_keeps_what_came_before() {
    let Some(whole) = compressed() else { return };
    let boundaries: BTreeSet<usize> =
        records(&whole).into_iter().map(|(at, _)| at).chain([whole.len()]).collect();
    let mut numbers = Numbers(0x1234_5678_9abc_def1);
    let mut cuts: Vec<usize> = (0..250).map(|_| 8 + numbers.below(whole.len() - 8)).collect();
    cuts.sort_unstable();
    let (mut before, mut lossy) = (0, 0);
    for cut in cuts {
        let log = Log::from_bytes(whole.slice(..cut)).unwrap();
        let info = log.info();
        assert!(info.recovered, "{cut}");
        assert!(info.messages >= before, "a later cut at {cut} keeps fewer messages");
        before = info.messages;
        if boundaries.contains(&cut) {
            assert_eq!(info.lost, Lost::default(), "cut at {cut}: {:?}", info.problems);
        } else {
            // A chunk that only lacks its last bytes may still have every message.
            assert!(info.problems.len() > 1, "cut at {cut}: {:?}", info.problems);
        }
        lossy += usize::from(info.lost.bytes > 0);
        assert_eq!(read_all(&log).len() as u64, info.messages, "{cut}");
    }
    assert!(lossy > 200, "{lossy} of 250 cuts cost bytes");
}

#[test]
fn a_log_without_its_magic_is_refused_by_name() {
    for bytes in [&b""[..], b"\x89MCAP0\r", b"#ROSBAG V2.0\n and more"] {
        let error = Log::from_bytes(Bytes::from_static(bytes)).unwrap_err();
        assert!(matches!(error, LogError::NotALog { .. }), "{error}");
        assert!(error.to_string().contains("; expected a recording in the format mcap"), "{error}");
    }
    for (bytes, expect) in [
        (&b"#ROSBAG V2.0\n"[..], "got a bag of ROS 1, which `mcap convert`"),
        (b"SQLite format 3\0", "got an SQLite database, such as a bag of ROS 2"),
        (b"ULog\x01\x12\x35\x01", "got a ULog of PX4"),
        (b"\x28\xb5\x2f\xfd\x04\x58\xb9\x0c", "got a file compressed as a whole, which `zstd -d` unpacks"),
        (b"\x89PNG\r\n\x1a\n", "got a PNG image;"),
        (b"\xff\xd8\xff\xe0\x00\x10JF", "got a JPEG image;"),
        (b"abc", "got a text that begins with \"abc\";"),
        (b"\x00\x01\x02", "got a file of an unknown format, which begins with the bytes 00 01 02;"),
    ] {
        let error = Log::from_bytes(Bytes::from_static(bytes)).unwrap_err().to_string();
        assert!(error.contains(expect), "{error}");
    }
    let error = Log::open("no/such/log.mcap").unwrap_err();
    assert!(error.to_string().ends_with("no/such/log.mcap"), "{error}");
    assert!(Log::open(std::env::temp_dir()).is_err(), "a folder is no log");
    assert_eq!(Log::from_bytes(Bytes::from_static(b"\x89MCAP0\r\n")).unwrap().info().messages, 0);
}

#[test]
fn a_flipped_bit_is_noticed_and_costs_at_most_its_chunk() {
    let Some(whole) = compressed() else { return };
    let sound = Log::from_bytes(whole.clone()).unwrap();
    let total = sound.info().messages;
    let data_end = records(&whole).iter().find(|(_, op)| *op == DATA_END).unwrap().0;
    let mut numbers = Numbers(0x0dd0_5eed_0000_0001);
    for _ in 0..100 {
        let mut bytes = whole.to_vec();
        let at = 8 + numbers.below(bytes.len() - 8);
        bytes[at] ^= 1 << numbers.below(8);
        let log = Log::from_bytes(bytes.into()).unwrap();
        let info = log.info();
        assert_eq!(read_all(&log).len() as u64, info.messages, "byte {at}");
        assert!(info.messages + 20 >= total, "byte {at}: {} messages, {:?}", info.messages, info.problems);
        if at < data_end {
            assert!(info.recovered && !info.problems.is_empty(), "byte {at}");
            assert_eq!(info.messages + info.lost.messages, total, "byte {at}: {:?}", info.problems);
        } else {
            assert_eq!((info.messages, info.lost.messages), (total, 0), "byte {at}: {:?}", info.problems);
        }
    }
}

#[test]
fn flips_in_many_places_and_a_cut_besides_still_leave_the_sound_chunks() {
    let Some(whole) = compressed() else { return };
    let total = Log::from_bytes(whole.clone()).unwrap().info().messages;
    let mut numbers = Numbers(0x0123_4567_89ab_cdef);
    for round in 0..60 {
        let mut bytes = whole.to_vec();
        let flips = 1 + round / 3;
        for _ in 0..flips {
            let at = 8 + numbers.below(bytes.len() - 8);
            let burst = 1 + numbers.below(30);
            for byte in bytes.iter_mut().skip(at).take(burst) {
                *byte = numbers.next() as u8;
            }
        }
        if round % 2 == 0 {
            bytes.truncate(bytes.len() - bytes.len() / 20);
        }
        let log = Log::from_bytes(bytes.into()).unwrap();
        let info = log.info();
        assert_eq!(read_all(&log).len() as u64, info.messages, "{:?}", info.problems);
        assert!(info.messages + info.lost.messages <= total, "{:?}", info.problems);
        let sound = if round % 2 == 0 { total * 9 / 10 } else { total };
        assert!(
            info.messages + 20 * flips as u64 >= sound,
            "{} of {total}: {:?}",
            info.messages,
            info.problems
        );
    }
}

#[test]
fn an_uncompressed_chunk_with_a_damaged_message_gives_up_that_message_alone() {
    let messages: Vec<(usize, u64, usize)> = (0..50).map(|index| (0, 1000 + index, 40)).collect();
    let bytes = log_of(&messages, WriterOptions { compress: false, ..WriterOptions::default() });
    let body = bytes.windows(40).position(|window| window == [25; 40]).unwrap();
    // The length of message 25 is 30 bytes before its data; the test makes it extend over the following messages.
    for (offset, value) in [(30, 200), (29, 3), (8, 0xff), (31, 0)] {
        let mut damaged = bytes.to_vec();
        damaged[body - offset] = value;
        for log in [
            Log::from_bytes(damaged.clone().into()).unwrap(),
            Log::from_bytes_by_scan(damaged.into()).unwrap(),
        ] {
            let order: Vec<u32> = read_all(&log).iter().map(|message| message.sequence).collect();
            assert!(log.info().recovered);
            assert!(order.len() >= 49, "{order:?}");
            assert!(order.iter().filter(|&&sequence| sequence != 25).count() == 49, "{order:?}");
            assert_eq!(log.info().lost.messages, 50 - order.len() as u64);
        }
    }
}

#[test]
fn a_damaged_message_index_leaves_the_indexes_after_it_to_their_chunk() {
    let messages: Vec<(usize, u64, usize)> =
        (0..90).map(|index| (index % 3, 1000 + index as u64, 40)).collect();
    let bytes = log_of(&messages, WriterOptions { chunk_bytes: 1000, ..WriterOptions::default() });
    let data_end = records(&bytes).iter().find(|(_, op)| *op == DATA_END).unwrap().0;
    let first = records(&bytes).iter().find(|(_, op)| *op == MESSAGE_INDEX).unwrap().0;
    // Bytes of its length: it ends in the next record, or after the end of the log.
    for byte in [1, 3] {
        let mut damaged = bytes[..data_end].to_vec();
        damaged[first + byte] ^= 1;
        let log = Log::from_bytes(damaged.into()).unwrap();
        let info = log.info();
        assert_eq!((info.messages, info.lost.messages), (90, 0), "{:?}", info.problems);
        assert!(info.lost.bytes > 0, "{:?}", info.problems);
    }
    // Indexes of a chunk that is gone do not belong to the chunk before it.
    let chunks: Vec<usize> =
        records(&bytes).iter().filter(|(_, op)| *op == CHUNK).map(|(at, _)| *at).collect();
    let mut damaged = bytes[..data_end].to_vec();
    damaged[chunks[1]..chunks[1] + 60].fill(0xff);
    let log = Log::from_bytes(damaged.into()).unwrap();
    let info = log.info();
    assert!(info.lost.messages > 0, "{:?}", info.problems);
    assert_eq!(info.messages + info.lost.messages, 90, "{:?}", info.problems);
}

#[test]
fn an_index_of_any_size_after_a_damaged_one_belongs_to_its_chunk() {
    // The second index is larger than what is read of it.
    let frequent = (0..70_000).map(|index| (1, 1001 + index, 0));
    let messages: Vec<(usize, u64, usize)> = [(0, 1000, 0)].into_iter().chain(frequent).collect();
    let clock: rcs_log::Clock = Arc::new(|| Duration::ZERO);
    let bytes = log_of(&messages, WriterOptions { chunk_bytes: 64 << 20, clock, ..WriterOptions::default() });
    let indexes = message_indexes(&bytes);
    assert_eq!(indexes.len(), 2);
    let log = with_opcode(&bytes, indexes[0], 0x47);
    let info = log.info();
    assert_eq!((info.messages, info.lost.messages), (70_001, 0), "{:?}", info.problems);
    assert!(info.lost.bytes > 0, "{:?}", info.problems);
}

#[test]
fn times_are_not_read_by_the_indexes_of_a_chunk_one_of_which_is_damaged() {
    let messages: Vec<(usize, u64, usize)> =
        (0..30).map(|index| (index % 3, 1000 + index as u64, 5)).collect();
    let bytes = log_of(&messages, WriterOptions::default());
    let options = CursorOptions::default();
    // Whether the pieces are read by their indexes, and the number of times that are told.
    let read = |bytes: &[u8]| {
        let log = Log::from_bytes(Bytes::copy_from_slice(bytes)).unwrap();
        let mut told = 0;
        let pieces = log.pieces(&options);
        let by_index = |piece| log.read_times(piece, &options, |_, _| told += 1).unwrap();
        (pieces.iter().map(by_index).collect::<Vec<_>>(), told)
    };
    assert_eq!(read(&bytes), (vec![true], 30));
    let indexes = message_indexes(&bytes);
    assert_eq!(indexes.len(), 3);
    for at in indexes {
        // Each bit of its opcode, and one of its length.
        for (place, bit) in (0..8).map(|bit| (at, bit)).chain([(at + 1, 0)]) {
            let mut damaged = bytes.to_vec();
            damaged[place] ^= 1 << bit;
            let (by_index, told) = read(&damaged);
            assert!(!by_index.contains(&true), "byte {place}, bit {bit}");
            assert_eq!(told, 0, "byte {place}, bit {bit}");
        }
    }
}

#[test]
fn a_log_whose_first_chunk_with_the_definitions_is_gone_takes_them_from_the_summary() {
    let messages: Vec<(usize, u64, usize)> = (0..400).map(|index| (0, index, 40)).collect();
    let bytes = log_of(&messages, WriterOptions { chunk_bytes: 1000, ..WriterOptions::default() });
    let first = records(&bytes).iter().find(|(_, op)| *op == CHUNK).unwrap().0;
    let mut damaged = bytes.to_vec();
    damaged[first + 60..first + 90].fill(0xee);
    let log = Log::from_bytes(damaged.clone().into()).unwrap();
    assert!(log.info().messages >= 350, "{:?}", log.info().problems);
    assert_eq!(log.info().messages + log.info().lost.messages, 400);
    assert_eq!(log.info().topics.len(), 1);
    // Without a summary the topic of the messages is unknown, so they are counted as lost.
    let data_end = records(&bytes).iter().find(|(_, op)| *op == DATA_END).unwrap().0;
    damaged.truncate(data_end);
    let log = Log::from_bytes(damaged.into()).unwrap();
    assert_eq!(log.info().messages + log.info().lost.messages, 400, "{:?}", log.info().problems);
    assert!(log.info().problems.iter().any(|problem| problem.contains("does not define")));
}

#[test]
fn damage_in_a_large_indexed_log_is_told_when_it_is_met() {
    let sink = SharedSink::default();
    let (mut writer, channels) =
        writer(&sink, WriterOptions { chunk_bytes: 1 << 20, ..WriterOptions::default() }, 1);
    for index in 0..50 {
        writer.write(channels[0], header(index, index as u64), &vec![index as u8; 1 << 20]).unwrap();
    }
    writer.finish().unwrap();
    let mut bytes = sink.snapshot();
    let chunks: Vec<usize> =
        records(&bytes).iter().filter(|(_, op)| *op == CHUNK).map(|(at, _)| *at).collect();
    let middle = chunks[chunks.len() / 2];
    // Checksum of the contents.
    bytes[middle + 9 + 24] ^= 1;
    // The start of the compressed data of another chunk.
    let other = chunks[3] + 9 + 44;
    bytes[other..other + 20].fill(0xff);
    let log = Log::from_bytes(bytes.into()).unwrap();
    assert!(!log.info().recovered, "more contents than are checked at once: {:?}", log.info().problems);
    assert_eq!((log.info().messages, log.info().lost), (50, Lost::default()));
    let read = log.cursor(CursorOptions::default()).map(Result::unwrap).count() as u64;
    let lost = log.lost();
    assert_eq!(read + lost.messages, 50);
    assert!(log.problems().iter().any(|problem| problem.contains("checksum")), "{:?}", log.problems());
    let again = log.cursor(CursorOptions::default()).map(Result::unwrap).count() as u64;
    assert_eq!((again, log.lost()), (read, lost), "the same at every reading, and counted once");
}

#[test]
fn an_index_that_points_beyond_the_file_or_is_damaged_is_not_believed() {
    let messages: Vec<(usize, u64, usize)> = (0..400).map(|index| (0, index, 40)).collect();
    let bytes = log_of(&messages, WriterOptions { chunk_bytes: 1000, ..WriterOptions::default() });
    let expected = plain(read_all(&Log::from_bytes(bytes.clone()).unwrap()));
    let footer = bytes.len() - 8 - 29;
    let check = |damaged: Vec<u8>, why: &str| {
        let log = Log::from_bytes(damaged.into()).unwrap();
        assert!(log.info().recovered, "{why}");
        assert!(log.info().problems[0].contains(why), "{why}: {:?}", log.info().problems);
        assert_eq!(log.info().lost.messages, 0, "{why}");
        assert_eq!(plain(read_all(&log)), expected, "{why}");
    };
    // Changes the offset of a chunk index and removes the checksum of the summary.
    let index = records(&bytes).iter().find(|(_, op)| *op == 0x08).unwrap().0;
    let mut damaged = bytes.to_vec();
    damaged[index + 9 + 16 + 5] = 0x7f;
    damaged[footer + 9 + 16..footer + 9 + 20].fill(0);
    check(damaged, "the index leaves out messages");
    let mut damaged = bytes.to_vec();
    damaged[index + 9 + 16] ^= 1;
    check(damaged, "checksum");
    let mut damaged = bytes.to_vec();
    damaged[footer + 9 + 6] = 0xff;
    check(damaged, "the footer puts the summary");
    // Removes one chunk index and the statistics from the summary.
    let mut damaged = bytes.to_vec();
    damaged[index] = 0x90;
    damaged[footer + 9 + 16..footer + 9 + 20].fill(0);
    check(damaged, "the index leaves out messages");
}

#[test]
fn a_file_that_shrinks_while_it_is_open_gives_errors_and_no_panic() {
    let messages: Vec<(usize, u64, usize)> = (0..400).map(|index| (0, index, 40)).collect();
    let bytes =
        log_of(&messages, WriterOptions { chunk_bytes: 1000, compress: false, ..WriterOptions::default() });
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("shrinks.mcap");
    std::fs::write(&path, &bytes).unwrap();
    let log = Log::open(&path).unwrap();
    std::fs::OpenOptions::new().write(true).open(&path).unwrap().set_len(bytes.len() as u64 / 2).unwrap();
    let results: Vec<_> = log.cursor(CursorOptions::default()).collect();
    let read = results.iter().filter(|result| result.is_ok()).count();
    assert!(read > 50 && read < 400, "{read}");
    let error = results.into_iter().find_map(Result::err).unwrap();
    assert!(matches!(error, LogError::Read { .. }), "{error}");
    assert!(error.to_string().contains("shrinks.mcap"), "{error}");
    let problems = log.problems();
    let is_told = |problem: &String| problem.contains("the file has changed since it was opened: it has");
    assert!(matches!(&problems[..], [problem] if is_told(problem)), "{problems:?}");
    assert!(error.to_string().contains("the file has changed since it was opened: it has"), "{error}");
}

#[test]
fn a_file_that_is_replaced_while_it_is_open_is_one_problem_and_one_that_grows_is_none() {
    let log_with = |size: usize| {
        let messages: Vec<(usize, u64, usize)> = (0..400).map(|index| (0, index, size)).collect();
        log_of(&messages, WriterOptions { chunk_bytes: 1000, compress: false, ..WriterOptions::default() })
    };
    let (short, long) = (log_with(37), log_with(40));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("drive.mcap");
    let open = |content: &[u8]| {
        std::fs::write(&path, content).unwrap();
        Log::open(&path).unwrap()
    };
    let check_told = |log: &Log| {
        let problems = log.problems();
        let is_told = |problem: &String| {
            problem.contains("the file has changed since it was opened") && problem.contains("drive.mcap")
        };
        assert!(matches!(&problems[..], [problem] if is_told(problem)), "{problems:?}");
    };
    for (first, then) in [(&long, &short), (&short, &long)] {
        let log = open(first);
        std::fs::write(&path, then).unwrap();
        let results: Vec<_> = log.cursor(CursorOptions::default()).collect();
        assert!(results.iter().any(Result::is_err), "what does not fit is refused");
        log.look_for_changes();
        check_told(&log);
    }
    // Another file at its path: the one that was opened can still be read.
    let log = open(&long);
    let other = folder.path().join("other.mcap");
    std::fs::write(&other, &short).unwrap();
    std::fs::rename(&other, &path).unwrap();
    log.look_for_changes();
    check_told(&log);
    assert_eq!(read_all(&log).len(), 400);
    // A file without an index may still be written.
    let log = open(&long[..long.len() / 2]);
    std::fs::write(&path, &long).unwrap();
    log.look_for_changes();
    assert!(read_all(&log).len() > 50);
    assert_eq!(log.problems(), log.info().problems);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 256, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn no_bytes_make_the_reader_panic(
        noise in proptest::collection::vec(any::<u8>(), 0..600),
        edits in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..12),
        compress: bool,
    ) {
        let mut random = b"\x89MCAP0\r\n".to_vec();
        random.extend(&noise);
        let messages: Vec<(usize, u64, usize)> = (0..30).map(|index| (index % 3, index as u64 / 2, index)).collect();
        let options = WriterOptions { chunk_bytes: 150, compress, ..WriterOptions::default() };
        let mut edited = log_of(&messages, options).to_vec();
        for (index, value) in edits {
            let length = edited.len() - 8;
            edited[8 + index.index(length)] = value;
        }
        for bytes in [random, edited] {
            for log in [Log::from_bytes(bytes.clone().into()).unwrap(), Log::from_bytes_by_scan(bytes.into()).unwrap()] {
                let read = log.cursor(CursorOptions::default()).flatten().count() as u64;
                if log.info().recovered {
                    prop_assert_eq!(read, log.info().messages);
                }
                let _ = log.latest_at(log.info().end, None);
                for info in log.attachments() {
                    let _ = log.read_attachment(info);
                }
            }
        }
    }
}

/// The log with the opcode at `at` changed, without its index.
fn with_opcode(log: &[u8], at: usize, opcode: u8) -> Log {
    let mut damaged = log.to_vec();
    damaged[at] = opcode;
    let data_end = records(log).iter().find(|(_, op)| *op == DATA_END).unwrap().0;
    damaged.truncate(data_end);
    Log::from_bytes(damaged.into()).unwrap()
}

#[test]
fn a_chunk_with_the_opcode_of_another_record_is_read_as_a_chunk_and_reported() {
    let messages: Vec<(usize, u64, usize)> = (0..100).map(|index| (0, 1000 + index, 40)).collect();
    for compress in [false, true] {
        let options = WriterOptions { compress, chunk_bytes: 1000, ..WriterOptions::default() };
        let bytes = log_of(&messages, options);
        let expected = plain(read_all(&Log::from_bytes(bytes.clone()).unwrap()));
        let chunks = records(&bytes).into_iter().filter(|(_, op)| *op == CHUNK);
        let (first, middle) = (chunks.clone().next().unwrap().0, chunks.clone().nth(2).unwrap().0);
        for at in [first, middle] {
            for opcode in (1..=0x0f).chain([0x80, 0xff]).filter(|opcode| *opcode != CHUNK) {
                let log = with_opcode(&bytes, at, opcode);
                let problems = &log.info().problems;
                let text = format!("got {opcode:#04x}");
                assert!(
                    problems.iter().any(|problem| problem.contains(&text)),
                    "{opcode:#04x}: {problems:?}"
                );
                assert_eq!(plain(read_all(&log)), expected, "{opcode:#04x}: {problems:?}");
                let mut damaged = bytes.to_vec();
                damaged[at] = opcode;
                let indexed = Log::from_bytes(damaged.into()).unwrap();
                assert_eq!(plain(read_all(&indexed)), expected, "{opcode:#04x}, with its index");
                assert!(!indexed.info().problems.is_empty(), "{opcode:#04x}, with its index");
            }
        }
    }
}

#[test]
fn a_record_in_the_wrong_section_is_reported() {
    let messages: Vec<(usize, u64, usize)> = (0..20).map(|index| (0, 1000 + index, 80)).collect();
    // Without chunks: the records of the only chunk, as the records of the file.
    let bytes = log_of(&messages, WriterOptions { compress: false, ..WriterOptions::default() });
    let chunk = records(&bytes).iter().find(|(_, op)| *op == CHUNK).unwrap().0;
    let contents = u64::from_le_bytes(bytes[chunk + 25..chunk + 33].try_into().unwrap()) as usize;
    let data = chunk + 9 + 40;
    let loose: Vec<u8> = bytes[..chunk].iter().chain(&bytes[data..data + contents]).copied().collect();
    let sound = Log::from_bytes(loose.clone().into()).unwrap();
    assert_eq!((sound.info().messages, sound.info().problems.len()), (20, 1), "{:?}", sound.info().problems);
    let places = records(&loose);
    let places = places.iter().filter(|(_, op)| *op == MESSAGE).map(|(at, _)| *at);
    // Kinds whose bodies a message can be: header, footer, and records of the summary.
    for (at, opcode) in places.flat_map(|at| [0x02, 0x08, 0x0a, 0x0b, 0x0d, 0x0e].map(|opcode| (at, opcode)))
    {
        let mut damaged = loose.clone();
        damaged[at] = opcode;
        let log = Log::from_bytes(damaged.into()).unwrap();
        let problems = &log.info().problems;
        assert_eq!(log.info().messages, 19, "{opcode:#04x} at {at}: {problems:?}");
        assert!(problems.len() > 1, "{opcode:#04x} at {at}: {problems:?}");
    }
    // After the end of the data there are no messages.
    let first = records(&loose).iter().find(|(_, op)| *op == MESSAGE).unwrap().0;
    let mut early = loose[..first].to_vec();
    early.extend([DATA_END, 4, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
    early.extend(&loose[first..]);
    let log = Log::from_bytes(early.into()).unwrap();
    assert_eq!(log.info().messages, 20);
    assert!(
        log.info().problems.iter().any(|problem| problem.starts_with("20 records")),
        "{:?}",
        log.info().problems
    );
}
