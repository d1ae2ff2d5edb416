//! Logs that we write can be read; truncated ones stay readable.

use crate::common::{SharedSink, header, plain, read_all, schema, writer};
use bytes::Bytes;
use rcs_log::{COMPLETE_FROM, FORMAT_VERSION, Log, LogError, LogWriter, WriterOptions};
use rcs_msg::{MessageEncoding, Schema, Stamp};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

#[test]
fn a_log_reads_as_it_was_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let options = WriterOptions {
        metadata: BTreeMap::from([("stack".to_owned(), "abc".to_owned())]),
        chunk_bytes: 4096,
        ..WriterOptions::default()
    };
    let build = options.build.clone();
    let mut writer = LogWriter::create(&path, options).unwrap();
    let role = BTreeMap::from([("rcs.role".to_owned(), "map".to_owned())]);
    let map = writer.add_channel("/map", &schema(), &role).unwrap();
    let bare = Schema::new("", MessageEncoding::Other("private".to_owned()), "", Bytes::new());
    let blob = writer.add_channel("/blob", &bare, &BTreeMap::new()).unwrap();
    assert_eq!(writer.add_channel("/map", &schema(), &role).unwrap(), map);
    writer.attach("stack.toml", "text/plain", Stamp(3), b"first").unwrap();
    let mut expected = Vec::new();
    for index in 0..500 {
        let channel = if index % 3 == 0 { blob } else { map };
        let data = vec![index as u8; index % 100];
        writer.write(channel, header(index, 1_000_000 * index as u64), &data).unwrap();
        let time = 1_000_000 * index as u64;
        expected.push((channel.0, index as u32, time, time, Bytes::from(data)));
    }
    writer.attach("stack.toml", "text/plain", Stamp(4), b"second").unwrap();
    writer.metadata("scene", BTreeMap::from([("weather".to_owned(), "rain".to_owned())])).unwrap();
    writer.finish().unwrap();

    let log = Log::open(&path).unwrap();
    let info = log.info();
    assert!(!info.recovered, "{:?}", info.problems);
    assert!(info.problems.is_empty(), "{:?}", info.problems);
    assert!(info.segments > 3);
    assert_eq!((info.messages, info.start, info.end), (500, Stamp(0), Stamp(499_000_000)));
    assert_eq!((info.profile.as_str(), info.library.as_str()), ("ocu", build.as_str()));
    let topic = info.topics_named("/map").next().unwrap();
    assert_eq!((topic.schema.name(), &topic.metadata), ("test.Text", &role));
    assert!(topic.decodable);
    // From the message at 1 ms to the one at 499 ms.
    assert!((topic.hz - (topic.messages - 1) as f64 / 0.498).abs() < 1e-9);
    assert!(!info.topics_named("/blob").next().unwrap().decodable);
    assert_eq!(plain(read_all(&log)), expected);

    let ocu = &log.metadata()[0];
    assert_eq!(ocu.name, "ocu");
    assert_eq!(ocu.entries["format"], FORMAT_VERSION.to_string());
    assert_eq!(ocu.entries["build"], build);
    assert_eq!(ocu.entries["stack"], "abc");
    assert_eq!(log.metadata()[1].entries["weather"], "rain");
    assert_eq!(log.attachments().len(), 2);
    assert_eq!(log.attachment("stack.toml").unwrap().unwrap().data, "second");
    assert_eq!(log.read_attachment(&log.attachments()[0]).unwrap().data, "first");
    assert!(log.attachment("other").unwrap().is_none());
}

#[test]
fn the_rates_of_a_recording_that_begins_in_the_middle_of_a_run_are_those_from_there_on() {
    let sink = SharedSink::default();
    let from = (COMPLETE_FROM.to_owned(), 10_000_000_000_u64.to_string());
    let options = WriterOptions { metadata: BTreeMap::from([from]), ..WriterOptions::default() };
    let (mut writer, channels) = writer(&sink, options, 3);
    // What it opens with: one of these was written at the start of the run, others just before.
    for (channel, times_ms) in [(0, vec![0]), (1, vec![9_990, 10_000]), (2, vec![0, 1, 2, 3])] {
        for (index, time_ms) in times_ms.into_iter().enumerate() {
            writer.write(channels[channel], header(index, time_ms * 1_000_000), b"x").unwrap();
        }
    }
    for index in 1..=100 {
        writer.write(channels[1], header(index, (10_000 + 10 * index as u64) * 1_000_000), b"x").unwrap();
    }
    writer.finish().unwrap();
    for log in [Log::from_bytes(sink.snapshot().into()), Log::from_bytes_by_scan(sink.snapshot().into())] {
        let log = log.unwrap();
        let info = log.info();
        assert_eq!((info.start, info.complete_from), (Stamp(0), Some(Stamp(10_000_000_000))));
        let rates: Vec<f64> = info.topics.iter().map(|topic| topic.hz).collect();
        assert!(rates[0] == 0.0 && rates[2] == 0.0, "{rates:?}");
        assert!((95.0..=105.0).contains(&rates[1]), "{rates:?}");
    }
}

#[test]
fn a_damaged_attachment_is_refused_by_its_checksum() {
    let sink = SharedSink::default();
    let (mut writer, _) = writer(&sink, WriterOptions::default(), 0);
    writer.attach("stack.toml", "text/plain", Stamp(3), b"the text of the stack").unwrap();
    writer.finish().unwrap();
    let mut bytes = sink.snapshot();
    let at = bytes.windows(8).position(|window| window == b"the text").unwrap();
    bytes[at] ^= 1;
    let log = Log::from_bytes(bytes.into()).unwrap();
    let error = log.attachment("stack.toml").unwrap_err();
    assert!(matches!(error, LogError::Damaged { .. }), "{error}");
    assert!(error.to_string().contains("checksum"), "{error}");
}

/// A clock that a test sets.
fn hand_clock() -> (Arc<AtomicU64>, WriterOptions) {
    let now_ms = Arc::new(AtomicU64::new(0));
    let theirs = Arc::clone(&now_ms);
    let clock: rcs_log::Clock = Arc::new(move || Duration::from_millis(theirs.load(Ordering::Relaxed)));
    (now_ms, WriterOptions { clock, chunk_bytes: 1 << 30, ..WriterOptions::default() })
}

#[test]
fn a_kill_at_any_moment_loses_at_most_the_last_second() {
    let (now_ms, options) = hand_clock();
    let sink = SharedSink::default();
    let (mut writer, channels) = writer(&sink, options, 1);
    let mut written_ms = Vec::new();
    for index in 0..200 {
        // Occasional bursts, with pauses of up to 70 ms; the owner checks for flushes every 10 ms.
        let pause_ms = if index % 5 == 0 { 70 } else { 3 };
        for _ in 0..pause_ms / 10 {
            now_ms.fetch_add(10, Ordering::Relaxed);
            writer.flush_if_due().unwrap();
        }
        now_ms.fetch_add(pause_ms % 10, Ordering::Relaxed);
        let now = now_ms.load(Ordering::Relaxed);
        writer.write(channels[0], header(index, now * 1_000_000), b"x").unwrap();
        written_ms.push(now);
        let log = Log::from_bytes(sink.snapshot().into()).unwrap();
        let old = written_ms.iter().filter(|&&at| at + 1000 <= now).count() as u64;
        assert!(log.info().messages >= old, "{} of {old} messages at {now} ms", log.info().messages);
        assert_eq!(log.info().lost.bytes, 0, "a flushed log ends at a record");
    }
    // After the last messages nothing arrives, and they are flushed all the same.
    let wait = writer.time_to_flush().unwrap();
    assert!(wait <= Duration::from_secs(1));
    now_ms.fetch_add(wait.as_millis() as u64, Ordering::Relaxed);
    assert!(writer.flush_if_due().unwrap());
    assert_eq!(Log::from_bytes(sink.snapshot().into()).unwrap().info().messages, 200);
}

#[test]
fn a_full_disk_is_reported_and_what_was_written_stays_readable() {
    let mut recovered_before = 0;
    for room in (120..20_000).step_by(331) {
        let sink = SharedSink::with_room(room);
        let options = WriterOptions { chunk_bytes: 1000, compress: false, ..WriterOptions::default() };
        let started = LogWriter::with_sink(Box::new(sink.clone()), "full.mcap".into(), options);
        let Ok(mut writer) = started else {
            assert!(room < 500, "{room}");
            continue;
        };
        let outcome = (|| {
            let channel = writer.add_channel("/0", &schema(), &BTreeMap::new())?;
            for index in 0..1000 {
                writer.write(channel, header(index, index as u64), &[7; 50])?;
            }
            Ok(())
        })();
        let error: LogError = outcome.unwrap_err();
        assert!(matches!(error, LogError::Write { .. }), "{error}");
        assert!(error.to_string().contains("full.mcap"), "{error}");
        assert!(writer.flush().is_err(), "after an error nothing more is written");
        assert!(writer.finish().is_err());
        let log = Log::from_bytes(sink.snapshot().into()).unwrap();
        let order: Vec<u32> = read_all(&log).iter().map(|message| message.sequence).collect();
        assert!(order.iter().copied().eq(0..order.len() as u32));
        assert!(order.len() >= recovered_before, "more room, fewer messages: {room}");
        recovered_before = order.len();
    }
    assert!(recovered_before > 150, "{recovered_before}");
}

#[test]
fn a_message_of_an_unknown_channel_is_refused_and_the_log_goes_on() {
    let sink = SharedSink::default();
    let (mut writer, channels) = writer(&sink, WriterOptions::default(), 1);
    let error = writer.write(rcs_log::ChannelId(77), header(0, 0), b"x").unwrap_err();
    assert!(matches!(error, LogError::Refused { .. }), "{error}");
    writer.write(channels[0], header(1, 0), b"x").unwrap();
    writer.finish().unwrap();
    assert_eq!(Log::from_bytes(sink.snapshot().into()).unwrap().info().messages, 1);
}
