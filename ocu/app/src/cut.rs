//! `ocu cut`: writes a range of a recording to a new one.
//!
//! Messages of the range are copied byte for byte, with their times and sequence numbers. What is needed to understand
//! them is carried from before the range to its start: of a topic with at most two messages a second (transforms,
//! calibrations, parameters) the newest message, every description of a process, and of a map that is stored as key
//! frames and deltas the complete map. Attachments are copied. The metadata says whether the part lacks the beginning of
//! the recording, without which a run in it cannot be repeated.

use crate::cli::CutArgs;
use crate::output::Files;
use crate::{Ended, stacks, usage};
use anyhow::Context as _;
use ocu_ui::format;
use rcs_log::{
    ChannelId, CursorOptions, Log, LogMessage, LogWriter, MessagePosition, Reassembly, TopicId, WriteHeader,
    WriterOptions,
};
use rcs_msg::Stamp;
use std::collections::BTreeMap;
use std::io::Write;

/// The newest message of a topic with a lower rate is carried to the start of the range, Hz.
const SLOW_HZ: f64 = 2.0;
/// Types of which every message is carried: each describes something else, and is written once.
const DESCRIPTIONS: [&str; 2] = ["rcs.ProcessInfo", "rcs.RunInfo"];
/// Static transforms may be spread over the messages of a topic, which are then few.
const TRANSFORMS: &str = "foxglove.FrameTransforms";
const FEW: u64 = 64;

/// What was written.
#[derive(Debug, Default)]
pub(crate) struct Cut {
    pub(crate) copied: u64,
    pub(crate) carried: u64,
}

/// Writes the range named on the command line.
pub fn cut(args: &CutArgs, out: &mut dyn Write) -> anyhow::Result<Ended> {
    let mut files = Files::new(args.force);
    files.reads_log("the recording that is cut", &args.log);
    files.writes("--output", &args.output)?;
    let log = stacks::open_log(&args.log)?;
    let info = log.info();
    let length_s = info.end.seconds_since(info.start);
    let to_s = args.to.unwrap_or(length_s);
    if info.messages == 0 {
        let text = format!("the recording has no message; expected one at least: {}", args.log.display());
        return Err(usage(text));
    }
    if args.from > length_s {
        let text = format!("--from is {} s; expected at most {length_s:.3} s, where it ends", args.from);
        return Err(usage(text));
    }
    if args.to.is_some_and(|to_s| args.from >= to_s) {
        return Err(usage(format!("--from is {} s; expected less than --to, {to_s} s", args.from)));
    }
    let at = |seconds: f64| info.start.after_ns((seconds * 1e9).round() as u64);
    let (from, to) = (at(args.from), at(to_s).min(info.end));
    let options = WriterOptions {
        build: crate::BUILD.to_owned(),
        metadata: rcs_runtime::metadata_of_part(&log, from),
        replace: args.force,
        ..WriterOptions::default()
    };
    let mut writer = LogWriter::create(&args.output, options)?;
    let cut = copy(&log, from, to, &mut writer)?;
    writer.finish().context("the new recording cannot be completed")?;
    writeln!(
        out,
        "{} messages of {}, and {} from before that",
        format::count(cut.copied),
        format::elapsed(to.seconds_since(from)),
        format::count(cut.carried)
    )?;
    let is_whole = log.problems().is_empty();
    for problem in log.problems() {
        writeln!(out, "{problem}")?;
    }
    Ok(if is_whole { Ended::Well } else { Ended::Damaged })
}

/// The topics of the new recording.
struct Channels<'a> {
    log: &'a Log,
    ids: BTreeMap<TopicId, ChannelId>,
}

impl Channels<'_> {
    fn write(
        &mut self,
        writer: &mut LogWriter,
        topic: TopicId,
        message: &LogMessage,
        log_time: Stamp,
        data: &[u8],
    ) -> anyhow::Result<()> {
        let channel = if let Some(&channel) = self.ids.get(&topic) {
            channel
        } else {
            let info = self.log.info().topic(topic).context("a message of a topic that is not listed")?;
            let channel = writer.add_channel(&info.name, &info.schema, &info.metadata)?;
            self.ids.insert(topic, channel);
            channel
        };
        let header = WriteHeader { sequence: message.sequence, log_time, publish_time: message.publish_time };
        Ok(writer.write(channel, header, data)?)
    }
}

/// Copies the messages of a range, after what must be known at its start.
pub(crate) fn copy(log: &Log, from: Stamp, to: Stamp, writer: &mut LogWriter) -> anyhow::Result<Cut> {
    let info = log.info();
    let mut cut = Cut::default();
    let mut channels = Channels { log, ids: BTreeMap::new() };
    for entry in log.attachments() {
        let attachment = log.read_attachment(entry)?;
        writer.attach(&entry.name, &entry.media_type, entry.log_time, &attachment.data)?;
    }
    let mut reassembly = Reassembly::new(log);
    let is_carried = |schema: &str, hz: f64, messages: u64| {
        messages == 1 || hz < SLOW_HZ || DESCRIPTIONS.contains(&schema)
    };
    let slow: Vec<TopicId> = info
        .topics
        .iter()
        .filter(|topic| {
            let hz = info.density_hz(&[topic.id]).unwrap_or(0.0);
            !reassembly.takes(topic.id) && is_carried(topic.schema.name(), hz, topic.messages)
        })
        .map(|topic| topic.id)
        .collect();
    if from > info.start && !slow.is_empty() {
        let before = Stamp(from.0 - 1);
        let options = CursorOptions { topics: Some(slow), start: info.start, end: before };
        // Of descriptions all, of other topics the newest; in the order of the recording.
        let mut kept: BTreeMap<(TopicId, u64), LogMessage> = BTreeMap::new();
        for (count, message) in (0_u64..).zip(log.cursor(options)) {
            let message = message?;
            let is_kept = info.topic(message.topic).is_some_and(|topic| {
                let name = rcs_msg::canonical_name(&topic.schema).unwrap_or_else(|| topic.schema.name());
                DESCRIPTIONS.contains(&name) || (name == TRANSFORMS && topic.messages <= FEW)
            });
            let number = if is_kept { count } else { 0 };
            kept.insert((message.topic, number), message);
        }
        let mut kept: Vec<_> = kept.into_values().collect();
        kept.sort_by_key(|message| message.place);
        for message in kept {
            channels.write(writer, message.topic, &message, from, &message.data)?;
            cut.carried += 1;
        }
    }
    // A delta applies to the message before it, so each map begins complete.
    let start = MessagePosition::before(from);
    for map in reassembly.seek(start)? {
        // Those of the range would apply to it as if none before them were missing.
        if reassembly.is_out_of_reach(map.topic, start) {
            continue;
        }
        channels.write(writer, map.topic, &map.stored, from, &map.message.bytes())?;
        cut.carried += 1;
    }
    for message in log.cursor(CursorOptions { topics: None, start: from, end: to }) {
        let message = message?;
        channels.write(writer, message.topic, &message, message.log_time, &message.data)?;
        cut.copied += 1;
    }
    Ok(cut)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn cut_of(path: &Path, from_s: f64, to_s: f64, output: &Path) -> Log {
        let args = CutArgs {
            log: path.to_owned(),
            from: from_s,
            to: Some(to_s),
            output: output.to_owned(),
            force: false,
        };
        let mut out = Vec::new();
        assert_eq!(cut(&args, &mut out).unwrap(), Ended::Well, "{}", String::from_utf8_lossy(&out));
        stacks::open_log(output).unwrap()
    }

    #[test]
    fn a_range_has_the_messages_of_the_whole_and_what_was_said_once_before() {
        let dir = tempfile::tempdir().unwrap();
        let (path, output) = (dir.path().join("drive.mcap"), dir.path().join("part.mcap"));
        crate::sample::write(&path, 4.0, false).unwrap();
        let whole = stacks::open_log(&path).unwrap();
        let part = cut_of(&path, 1.5, 3.0, &output);
        let start = whole.info().start;
        let (from, to) = (start.after_ns(1_500_000_000), start.after_ns(3_000_000_000));
        let in_range = |message: &LogMessage| (from..=to).contains(&message.log_time);
        let name = |log: &Log, id: TopicId| log.info().topic(id).unwrap().name.clone();
        let messages = |log: &Log| -> Vec<_> {
            log.cursor(CursorOptions::default())
                .map(Result::unwrap)
                .filter(in_range)
                .map(|message| (name(log, message.topic), message.log_time, message.sequence, message.data))
                .collect()
        };
        let (whole_messages, part_messages) = (messages(&whole), messages(&part));
        assert!(!whole_messages.is_empty());
        for message in &whole_messages {
            assert!(part_messages.contains(message), "{} at {:?}", message.0, message.1);
        }
        let transforms = part.info().topics_named("/vehicle/static_transforms").next();
        let before_end = whole.cursor(CursorOptions { end: to, ..CursorOptions::default() });
        let transforms_before = before_end
            .map(Result::unwrap)
            .filter(|message| name(&whole, message.topic) == "/vehicle/static_transforms")
            .count() as u64;
        let transforms = transforms.map(|topic| topic.messages);
        assert_eq!(transforms, Some(transforms_before), "all of them, also from before the range");
        let surplus = part_messages.len() - whole_messages.len();
        assert!((1..=6).contains(&surplus), "{surplus} carried");
    }

    #[test]
    fn a_recording_of_one_instant_is_cut_as_a_whole_and_an_empty_one_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        let [path, output] = ["instant.mcap", "part.mcap"].map(|name| dir.path().join(name));
        let write = |messages: u32| {
            let options = WriterOptions { replace: true, ..WriterOptions::default() };
            let mut writer = LogWriter::create(&path, options).unwrap();
            let schema = rcs_msg::schema_of::<rcs_msg::rcs::Status>();
            let channel = writer.add_channel("/status", schema, &BTreeMap::new()).unwrap();
            for sequence in 0..messages {
                let header = WriteHeader { sequence, log_time: Stamp(7), publish_time: Stamp(7) };
                writer.write(channel, header, &[]).unwrap();
            }
            writer.finish().unwrap();
        };
        let args = CutArgs { log: path.clone(), from: 0.0, to: None, output: output.clone(), force: false };
        write(0);
        let error = cut(&args, &mut Vec::new()).unwrap_err().to_string();
        assert!(error.contains("has no message"), "{error}");
        write(2);
        assert_eq!(cut(&args, &mut Vec::new()).unwrap(), Ended::Well);
        assert_eq!(stacks::open_log(&output).unwrap().info().messages, 2);
    }

    #[test]
    fn a_range_of_nothing_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("drive.mcap");
        crate::sample::write(&path, 1.0, false).unwrap();
        for (from, to) in [(0.5, Some(0.5)), (0.8, Some(0.2)), (9.0, None)] {
            let output = dir.path().join("part.mcap");
            let args = CutArgs { log: path.clone(), from, to, output: output.clone(), force: false };
            let error = cut(&args, &mut Vec::new()).unwrap_err();
            assert!(error.to_string().contains("--from"), "{error}");
            assert!(!output.exists());
        }
    }
}
