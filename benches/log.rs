//! Logs: opening a large one by its index, finding a time in it, and recovering one without an index.
//!
//! The first run writes the log into the system's folder for temporary files; later runs use it again.
//! `OCU_BENCH_LOG_MB` sets its size in megabytes, by default 2000.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Duration;

use bytes::Bytes;
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use rcs_log::{CursorOptions, Log, LogWriter, WriteHeader, WriterOptions};
use rcs_msg::{MessageEncoding, Schema, Stamp};

/// Size of one message's data: half a compressed image.
const MESSAGE_BYTES: usize = 100_000;
/// Messages per second of log time.
const HZ: u64 = 100;

fn megabytes() -> u64 {
    std::env::var("OCU_BENCH_LOG_MB").ok().and_then(|text| text.parse().ok()).unwrap_or(2000)
}

/// An indexed log of images that do not compress, with small messages between them.
fn indexed() -> PathBuf {
    let path = std::env::temp_dir().join(format!("ocu-bench-{}mb.mcap", megabytes()));
    if !path.exists() {
        let partial = path.with_extension("partial");
        write_log(&partial).expect("the log can be written");
        std::fs::rename(&partial, &path).expect("the log can be named");
    }
    path
}

fn write_log(path: &Path) -> Result<(), rcs_log::LogError> {
    let mut writer = LogWriter::create(path, WriterOptions::default())?;
    let schema =
        |name: &str| Schema::new(name, MessageEncoding::Json, "jsonschema", Bytes::from_static(b"{}"));
    let images = writer.add_channel("/camera", &schema("image"), &BTreeMap::new())?;
    let poses = writer.add_channel("/pose", &schema("pose"), &BTreeMap::new())?;
    let count = megabytes() * 1_000_000 / MESSAGE_BYTES as u64;
    let mut noise = 0x9e37_79b9_7f4a_7c15_u64;
    let mut data = vec![0; MESSAGE_BYTES];
    for sequence in 0..count {
        for word in data.chunks_exact_mut(8) {
            // Xorshift: bytes that do not compress.
            noise ^= noise << 13;
            noise ^= noise >> 7;
            noise ^= noise << 17;
            word.copy_from_slice(&noise.to_le_bytes());
        }
        let time = Stamp(sequence * 1_000_000_000 / HZ);
        let header = WriteHeader { sequence: sequence as u32, log_time: time, publish_time: time };
        writer.write(images, header, &data)?;
        writer.write(poses, header, br#"{"x": 1.0, "y": 2.0}"#)?;
    }
    writer.finish()
}

/// The same log, truncated: no summary, no index.
fn unindexed(indexed: &Path) -> PathBuf {
    let path = indexed.with_extension("cut.mcap");
    if !path.exists() {
        let mut from = std::fs::File::open(indexed).expect("the log opens");
        let mut to = std::fs::File::create(&path).expect("a file can be written");
        // A quarter is enough to measure a rate; it ends in the middle of a record.
        let quarter = from.metadata().expect("the log has a size").len() / 4 + 1;
        std::io::copy(&mut std::io::Read::take(&mut from, quarter), &mut to).expect("the log can be copied");
        to.flush().expect("the log can be copied");
    }
    path
}

fn reading(criterion: &mut Criterion) {
    let path = indexed();
    let size = format!("{}MB", megabytes());
    let mut group = criterion.benchmark_group("log");
    group.sample_size(10).measurement_time(Duration::from_secs(5));

    group.bench_function(format!("open/{size}/ocu"), |bench| {
        bench.iter(|| Log::open(&path).expect("the log opens").info().messages);
    });
    group.bench_function(format!("open/{size}/mcap"), |bench| {
        bench.iter(|| {
            // The peer reads the same part of the file: its summary corresponds to our open log.
            let file = std::fs::File::open(&path).expect("the log opens");
            peer_summary(file).expect("the log has a summary").chunk_indexes.len()
        });
    });

    let log = Log::open(&path).expect("the log opens");
    let end = log.info().end.0;
    let mut at = 0;
    group.bench_function(format!("seek/{size}/ocu"), |bench| {
        bench.iter(|| {
            // A stride that does not divide the length, so that every seek goes to another chunk.
            at = (at + end / 7 * 3 + 12_345_678) % end;
            let options = CursorOptions { start: Stamp(at), ..CursorOptions::default() };
            log.cursor(options).next().expect("a message").expect("a message that can be read").log_time
        });
    });
    group.bench_function(format!("latest_at/{size}/ocu"), |bench| {
        bench.iter(|| {
            at = (at + end / 7 * 3 + 12_345_678) % end;
            log.latest_at(Stamp(at), None).expect("the log can be read").len()
        });
    });

    let cut = unindexed(&path);
    group.throughput(Throughput::Bytes(std::fs::metadata(&cut).expect("the log has a size").len()));
    group.bench_function("recover/ocu", |bench| {
        bench.iter(|| Log::open(&cut).expect("the log opens").info().messages);
    });
    group.finish();
}

fn peer_summary(mut file: std::fs::File) -> Option<mcap::Summary> {
    use std::io::{Read, Seek};
    let mut reader = mcap::sans_io::SummaryReader::new();
    while let Some(event) = reader.next_event() {
        match event.ok()? {
            mcap::sans_io::SummaryReadEvent::ReadRequest(wanted) => {
                let read = file.read(reader.insert(wanted)).ok()?;
                reader.notify_read(read);
            }
            mcap::sans_io::SummaryReadEvent::SeekRequest(to) => {
                let at = file.seek(to).ok()?;
                reader.notify_seeked(at);
            }
        }
    }
    reader.finish()
}

criterion_group!(benches, reading);
criterion_main!(benches);
