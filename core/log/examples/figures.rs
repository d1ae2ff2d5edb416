//! Measures opening, seeking, lookup of the latest messages, recovery and memory of a log.
//!
//! `cargo run --release -p rcs-log --example figures -- /somewhere/big.mcap 2000` writes 2000 MB there first.

#![allow(clippy::print_stdout, reason = "its output is what it is for")]

use rcs_log::{CursorOptions, Log};
use rcs_msg::Stamp;
use std::time::Instant;

type Outcome = Result<(), Box<dyn std::error::Error>>;

fn main() -> Outcome {
    let mut arguments = std::env::args().skip(1);
    let path = arguments.next().ok_or("expected a path")?;
    if let Some(megabytes) = arguments.next() {
        let start = Instant::now();
        let bytes = megabytes.parse::<u64>()? << 20;
        rcs_testkit::logs::write_big(&path, bytes)?;
        println!("write     {:7.0} MB/s", bytes as f64 / 1e6 / start.elapsed().as_secs_f64());
    }
    let size_mb = std::fs::metadata(&path)?.len() as f64 / 1e6;
    println!("size      {size_mb:7.0} MB");
    let start = Instant::now();
    let log = Log::open(&path)?;
    println!("open      {:7.1} ms, recovered: {}", ms(start), log.info().recovered);
    random_places(&log)?;
    let start = Instant::now();
    let mut read = 0;
    for message in log.cursor(CursorOptions::default()) {
        read += message?.data.len();
    }
    println!("read all  {:7.0} MB/s", read as f64 / 1e6 / start.elapsed().as_secs_f64());
    memory("indexed")?;
    drop(log);
    let start = Instant::now();
    let log = Log::open_by_scan(&path)?;
    println!("recover   {:7.0} MB/s, lost: {:?}", size_mb / start.elapsed().as_secs_f64(), log.info().lost);
    memory("recovery")
}

/// Seeks and lookups of the latest messages at a hundred times.
fn random_places(log: &Log) -> Outcome {
    let (mut seeks, mut latest) = (Vec::new(), Vec::new());
    let span = (log.info().end.0 - log.info().start.0).max(1);
    let mut number = 88_172_645_463_325_252_u64;
    for _ in 0..100 {
        number ^= number << 13;
        number ^= number >> 7;
        number ^= number << 17;
        let at = Stamp(log.info().start.0 + number % span);
        let start = Instant::now();
        let mut cursor = log.cursor(CursorOptions { start: at, ..CursorOptions::default() });
        cursor.next().transpose()?;
        seeks.push(ms(start));
        let start = Instant::now();
        log.latest_at(Stamp(log.info().start.0 + number.rotate_left(17) % span), None)?;
        latest.push(ms(start));
    }
    for (name, times) in [("seek", &mut seeks), ("latest", &mut latest)] {
        times.sort_by(f64::total_cmp);
        println!("{name:9} {:7.1} ms median, {:.1} ms worst", times[times.len() / 2], times[times.len() - 1]);
    }
    Ok(())
}

fn ms(start: Instant) -> f64 {
    start.elapsed().as_secs_f64() * 1e3
}

fn memory(when: &str) -> Outcome {
    let status = std::fs::read_to_string("/proc/self/status")?;
    for line in status.lines().filter(|line| line.starts_with("VmHWM") || line.starts_with("VmRSS")) {
        println!("{when}: {line}");
    }
    Ok(())
}
