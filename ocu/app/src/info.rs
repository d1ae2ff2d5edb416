//! `ocu info`: what a recording holds, and what of it was lost.

use crate::cli::InfoArgs;
use crate::table::{Align, Table};
use anyhow::Context as _;
use ocu_ui::format;
use rcs_log::{Log, LogInfo};
use serde::Serialize;
use std::io::Write;

/// `ocu info --json`.
#[derive(Debug, Serialize)]
struct Report<'a> {
    messages: u64,
    start_ns: u64,
    end_ns: u64,
    duration_s: f64,
    /// Read without a usable summary.
    recovered: bool,
    lost: Lost,
    topics: Vec<TopicReport<'a>>,
}

#[derive(Debug, Serialize)]
struct Lost {
    bytes: u64,
    messages: u64,
}

#[derive(Debug, Serialize)]
struct TopicReport<'a> {
    name: &'a str,
    schema: &'a str,
    encoding: &'a str,
    messages: u64,
    hz: f64,
    decodable: bool,
}

/// Prints what the recording holds.
pub fn info(args: &InfoArgs, out: &mut dyn Write) -> anyhow::Result<()> {
    let log = Log::open(&args.log)?;
    let info = log.info();
    if args.json {
        serde_json::to_writer_pretty(&mut *out, &report(info)).context("cannot write the report")?;
        writeln!(out)?;
        return Ok(());
    }
    human(info, out)
}

fn report(info: &LogInfo) -> Report<'_> {
    Report {
        messages: info.messages,
        start_ns: info.start.0,
        end_ns: info.end.0,
        duration_s: info.duration_s(),
        recovered: info.recovered,
        lost: Lost { bytes: info.lost.bytes, messages: info.lost.messages },
        topics: info
            .topics
            .iter()
            .map(|topic| TopicReport {
                name: &topic.name,
                schema: topic.schema.name(),
                encoding: topic.schema.message_encoding().name(),
                messages: topic.messages,
                hz: topic.hz,
                decodable: topic.decodable,
            })
            .collect(),
    }
}

fn human(info: &LogInfo, out: &mut dyn Write) -> anyhow::Result<()> {
    let mut facts = vec![
        ("file", format!("{} ({})", info.path.display(), format::bytes(info.bytes))),
        ("written by", info.library.clone()),
        ("profile", info.profile.clone()),
        ("start", crate::time::date_and_time(info.start)),
        ("duration", format::elapsed(info.duration_s())),
        ("messages", info.messages.to_string()),
    ];
    if info.recovered {
        facts.push(("recovered", "read without a usable summary".to_owned()));
    }
    if info.lost.bytes > 0 || info.lost.messages > 0 {
        let lost = format!("{}, {} messages known", format::bytes(info.lost.bytes), info.lost.messages);
        facts.push(("lost", lost));
    }
    for (name, value) in facts.iter().filter(|(_, value)| !value.is_empty()) {
        writeln!(out, "{name:<11} {value}")?;
    }
    for problem in &info.problems {
        writeln!(out, "{:<11} {problem}", "problem")?;
    }
    writeln!(out)?;
    let mut table = Table::new(&[
        ("topic", Align::Left),
        ("schema", Align::Left),
        ("encoding", Align::Left),
        ("messages", Align::Right),
        ("rate", Align::Right),
        ("", Align::Left),
    ]);
    for topic in &info.topics {
        let reason = || topic.undecodable_because.as_deref().unwrap_or("no reader for it");
        table.row([
            topic.name.clone(),
            topic.schema.name().to_owned(),
            topic.schema.message_encoding().name().to_owned(),
            topic.messages.to_string(),
            format::rate(topic.hz),
            if topic.decodable { String::new() } else { format!("cannot be decoded: {}", reason()) },
        ]);
    }
    table.write(out)?;
    Ok(())
}
