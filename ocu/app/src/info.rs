//! `ocu info`: describes the contents of a recording, and what of it was lost.

use crate::Ended;
use crate::check::Lost;
use crate::cli::InfoArgs;
use crate::plain::plain;
use crate::table::{Align, Table};
use anyhow::Context as _;
use ocu_ui::format;
use rcs_log::{Log, LogInfo, Reassembly};
use serde::Serialize;
use std::io::Write;

/// `ocu info --json`.
#[derive(Debug, Serialize)]
struct Report<'a> {
    messages: u64,
    start_ns: u64,
    end_ns: u64,
    duration_s: f64,
    /// The time from which it is complete, if it was recorded from the middle of a run on or is a part of a recording.
    #[serde(skip_serializing_if = "Option::is_none")]
    complete_from_ns: Option<u64>,
    /// Whether it was read without a usable summary.
    recovered: bool,
    lost: Lost,
    /// Number of chunks and message sequences, and how many of them have been read and checked.
    segments: u64,
    verified: u64,
    problems: &'a [String],
    gaps: Vec<GapReport>,
    topics: Vec<TopicReport<'a>>,
}

/// A period without messages.
#[derive(Debug, Serialize)]
struct GapReport {
    from_ns: u64,
    to_ns: u64,
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

/// Prints the description of a recording.
pub fn info(args: &InfoArgs, out: &mut dyn Write) -> anyhow::Result<Ended> {
    let log = Log::open_parts(&crate::parts::of(&args.log)?)?;
    let info = log.info();
    if args.json {
        serde_json::to_writer_pretty(&mut *out, &report(info)).context("cannot write the report")?;
        writeln!(out)?;
    } else {
        human(&log, out)?;
    }
    Ok(Ended::after(Some(&log)))
}

fn report(info: &LogInfo) -> Report<'_> {
    Report {
        messages: info.messages,
        start_ns: info.start.0,
        end_ns: info.end.0,
        duration_s: info.duration_s(),
        complete_from_ns: info.complete_from.map(|from| from.0),
        recovered: info.recovered,
        lost: info.lost.into(),
        segments: info.segments,
        verified: info.verified,
        problems: &info.problems,
        gaps: info.gaps.iter().map(|gap| GapReport { from_ns: gap.from.0, to_ns: gap.to.0 }).collect(),
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

/// What has been checked and what has not.
fn verified(info: &LogInfo) -> String {
    if info.verified == info.segments {
        return "all of it, but for the messages' contents".to_owned();
    }
    let rest = info.segments - info.verified;
    format!("the index alone; {rest} chunks are believed until they are read (ocu check reads them)")
}

fn human(log: &Log, out: &mut dyn Write) -> anyhow::Result<()> {
    let (info, reassembly) = (log.info(), Reassembly::new(log));
    let parts = match info.files.len() {
        0 | 1 => String::new(),
        count => format!(" and {} more", count - 1),
    };
    let mut facts = vec![
        ("file", format!("{}{parts} ({})", info.path.display(), format::bytes(info.bytes))),
        ("written by", info.library.clone()),
        ("profile", info.profile.clone()),
        ("start", crate::time::date_and_time(info.start)),
        ("duration", format::elapsed(info.duration_s())),
        ("messages", info.messages.to_string()),
    ];
    facts.extend(info.complete_from.filter(|from| *from > info.start).map(|from| {
        let after = format::elapsed(from.seconds_since(info.start));
        ("complete", format!("from {after} on, with what held then before it"))
    }));
    facts.extend(info.gaps.iter().map(|gap| {
        let length = format::elapsed(gap.duration_s());
        ("gap", format!("{length} without a message, after {}", crate::time::date_and_time(gap.from)))
    }));
    facts.push(("verified", verified(info)));
    if info.recovered {
        facts.push(("recovered", "read without a usable summary".to_owned()));
    }
    if info.lost.bytes > 0 || info.lost.messages > 0 {
        let lost = format!("{}, {} messages known", format::bytes(info.lost.bytes), info.lost.messages);
        facts.push(("lost", lost));
    }
    for (name, value) in facts.iter().filter(|(_, value)| !value.is_empty()) {
        writeln!(out, "{name:<11} {}", plain(value))?;
    }
    for problem in &info.problems {
        writeln!(out, "{:<11} {}", "problem", plain(problem))?;
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
        let note = match topic.metadata.get(rcs_msg::DELTA_OF) {
            _ if !topic.decodable => format!("cannot be decoded: {}", reason()),
            Some(keys) => format!("changes between the key frames of {keys}"),
            // Of ROS.
            None => reassembly
                .keys_of(topic.id)
                .and_then(|grids| info.topic(grids))
                .map_or_else(String::new, |grids| format!("updates of the grids of {}", grids.name)),
        };
        table.row([
            topic.name.clone(),
            topic.schema.name().to_owned(),
            topic.schema.message_encoding().name().to_owned(),
            topic.messages.to_string(),
            format::rate(topic.hz),
            note,
        ]);
    }
    table.write(out)?;
    Ok(())
}
