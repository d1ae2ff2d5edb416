//! Compares two recordings: what they say of their runs, the first differences of their messages, and which of them
//! begins later or ends first.
//!
//! Both are read in one pass, time by time, from where both have every message up to the end of the shorter one.
//! Recordings without a common time or buffer are not compared. Measured times are left out. The identity of a run
//! (`/runtime/run`) is compared apart from the messages: it is the first message of every run, and differs where the seed,
//! the build or a parameter does, which says nothing of what came of it.

use crate::compare::{
    Difference, Matcher, Side, differing, differing_each, differing_parts, is_compared, next_time, put_until,
    to_the_nanosecond,
};
use crate::stack::names;
use rcs_log::{CursorOptions, Log, LogError, LogTopic, Reassembly, TopicId};
use rcs_msg::{AnyMessage, Stamp, rcs, registry};
use std::collections::BTreeSet;
use std::sync::Arc;

/// What two recordings say differently of their runs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RunDifference {
    /// The field of `rcs.RunInfo`, such as `seed`; `run` if only one of them is the recording of a run; empty if no field
    /// shows what differs.
    pub field: String,
    /// Both values as text; empty where there is none. Of `params`, one parameter as `process.field = value`; of
    /// `files`, the kinds of those that only this one has, sorted; of `live`, the executor; of long texts, the part
    /// with the first difference.
    pub values: [String; 2],
}

/// Why the messages of two recordings cannot be compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NotCompared {
    /// None of the buffers that are compared is in both.
    NoCommonBuffer,
    /// At no time have both every message.
    NoCommonTime,
}

/// The one of two recordings that begins later, or is complete only from later on, while the other one has messages
/// before.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LaterRecording {
    /// Whether it is the first of the two.
    pub is_first: bool,
    /// The time from which it has every message.
    pub start: Stamp,
    /// The same, in seconds since the start of the first recording, to the nanosecond.
    pub start_s: f64,
}

/// The one of two recordings that ends first, while messages of the other one follow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShorterRecording {
    /// Whether it is the first of the two.
    pub is_first: bool,
    /// Its end.
    pub end: Stamp,
    /// The same, in seconds since the start of the first recording, to the nanosecond.
    pub end_s: f64,
}

/// Why the messages of two recordings cannot be compared; `None` if they can.
pub fn not_compared(a: &Log, b: &Log) -> Option<NotCompared> {
    let names = |log: &Log| compared_topics(log).map(|topic| topic.name.clone()).collect::<BTreeSet<_>>();
    if names(a).is_disjoint(&names(b)) {
        return Some(NotCompared::NoCommonBuffer);
    }
    (!have_common_time(a, b)).then_some(NotCompared::NoCommonTime)
}

/// Whether there is a time at which both recordings have every message.
pub(crate) fn have_common_time(a: &Log, b: &Log) -> bool {
    compared_from(a, b) <= a.info().end.min(b.info().end)
}

/// The first message in which two recordings differ between the later start and the end of the shorter one, except for
/// what they say of their runs; `None` if they agree.
pub fn diff(a: &Log, b: &Log) -> Result<Option<Difference>, LogError> {
    Ok(differences(a, b, 1)?.into_iter().next())
}

/// The first difference of each buffer, in the order of time, except for what the recordings say of their runs. Reads
/// both to the end of the shorter one.
pub fn diff_each(a: &Log, b: &Log) -> Result<Vec<Difference>, LogError> {
    differences(a, b, usize::MAX)
}

/// Which of two recordings begins later; `None` if the other one has no message before that is compared.
pub fn diff_starts(a: &Log, b: &Log) -> Result<Option<LaterRecording>, LogError> {
    let [first, second] = [a, b].map(complete_from);
    if first == second {
        return Ok(None);
    }
    let (is_first, start, earlier) = if first > second { (true, first, b) } else { (false, second, a) };
    let topics: Vec<TopicId> = compared_topics(earlier).map(|topic| topic.id).collect();
    let options = CursorOptions { topics: Some(topics), end: start.before_ns(1), ..CursorOptions::default() };
    let is_before = earlier.cursor(options).next().transpose()?.is_some();
    let start_s = to_the_nanosecond(start.seconds_since(a.info().start));
    Ok(is_before.then_some(LaterRecording { is_first, start, start_s }))
}

/// Which of two recordings ends first; `None` if no message that is compared follows in the other one.
pub fn diff_lengths(a: &Log, b: &Log) -> Result<Option<ShorterRecording>, LogError> {
    let [first, second] = [a, b].map(|log| log.info().end);
    let (is_first, end, longer) = if first < second { (true, first, b) } else { (false, second, a) };
    let topics: Vec<TopicId> = compared_topics(longer).map(|topic| topic.id).collect();
    let options = CursorOptions { topics: Some(topics), start: end.after_ns(1), ..CursorOptions::default() };
    let goes_on = longer.cursor(options).next().transpose()?.is_some();
    let end_s = to_the_nanosecond(end.seconds_since(a.info().start));
    Ok(goes_on.then_some(ShorterRecording { is_first, end, end_s }))
}

/// What two recordings say differently of the runs that they begin with; nothing if neither is the recording of a run.
pub fn diff_runs(a: &Log, b: &Log) -> Result<Vec<RunDifference>, LogError> {
    let [one, other] = match [run_of(a)?, run_of(b)?] {
        [Some(one), Some(other)] => [one, other],
        [None, None] => return Ok(Vec::new()),
        [one, other] => {
            let values = [one, other].map(|run| run.map_or_else(String::new, |_| "a run".to_owned()));
            return Ok(vec![RunDifference { field: "run".to_owned(), values }]);
        }
    };
    if one.bytes() == other.bytes() {
        return Ok(Vec::new());
    }
    let found = match [one.to::<rcs::RunInfo>(), other.to::<rcs::RunInfo>()] {
        [Some(a), Some(b)] => of_infos(&a, &b),
        _ => Vec::new(),
    };
    if !found.is_empty() {
        return Ok(found);
    }
    let (field, values) = differing(&one, &other);
    Ok(vec![RunDifference { field: field.trim_start_matches('.').to_owned(), values }])
}

/// The topics of a recording whose messages are compared.
fn compared_topics(log: &Log) -> impl Iterator<Item = &LogTopic> {
    log.info().topics.iter().filter(|topic| is_compared(&topic.name))
}

/// The time from which a recording has every message. The messages with which a part of a run opens have this time or
/// earlier ones.
fn complete_from(log: &Log) -> Stamp {
    log.info().complete_from.unwrap_or_default().max(log.info().start)
}

/// The first time that is compared. Where only one recording is a part of a run, that is after the messages with which the
/// part opens, because they repeat earlier ones of the other.
pub(crate) fn compared_from(a: &Log, b: &Log) -> Stamp {
    let [one, other] = [a, b].map(|log| (log.info().start, log.info().complete_from));
    if one == other {
        return a.info().start;
    }
    after_opening(a).max(after_opening(b))
}

/// The first time after the messages with which a part of a run opens; the start of a recording that is no such part.
pub(crate) fn after_opening(log: &Log) -> Stamp {
    match log.info().complete_from {
        Some(from) if from >= log.info().start => from.after_ns(1),
        _ => log.info().start,
    }
}

/// Differences until this many buffers have one.
fn differences(a: &Log, b: &Log, most: usize) -> Result<Vec<Difference>, LogError> {
    let cursor = |log: &Log| log.cursor(CursorOptions::default()).peekable();
    let (mut ones, mut others) = (cursor(a), cursor(b));
    let mut reassembly = [a, b].map(Reassembly::new);
    let mut matcher = Matcher::new(a.info().start);
    let (from, end) = (compared_from(a, b), a.info().end.min(b.info().end));
    let mut found = Vec::new();
    while found.len() < most {
        let next = [next_time(&mut ones)?, next_time(&mut others)?];
        let Some(time) = next.into_iter().flatten().min().filter(|time| *time <= end) else { break };
        put_until(&mut matcher, Side::First, a, &mut reassembly[0], &mut ones, time, is_compared)?;
        put_until(&mut matcher, Side::Second, b, &mut reassembly[1], &mut others, time, is_compared)?;
        if time < from {
            matcher.forget();
        } else {
            found.extend(matcher.settle_each());
        }
    }
    Ok(found)
}

/// The identity of the run with which a recording begins; `None` if it is not the recording of a run.
fn run_of(log: &Log) -> Result<Option<AnyMessage>, LogError> {
    let topics: Vec<TopicId> = log.info().topics_named(names::RUN).map(|topic| topic.id).collect();
    if topics.is_empty() {
        return Ok(None);
    }
    let options = CursorOptions { topics: Some(topics), ..CursorOptions::default() };
    let Some(first) = log.cursor(options).next().transpose()? else { return Ok(None) };
    let topic = log.info().topic(first.topic);
    Ok(topic.map(|topic| AnyMessage::encoded(Arc::clone(&topic.schema), first.data)))
}

/// What differs between two runs. The hash of the stack is left out, because it is that of its text and parameters.
fn of_infos(a: &rcs::RunInfo, b: &rcs::RunInfo) -> Vec<RunDifference> {
    let executor = |run: &rcs::RunInfo| String::from(if run.live { "live" } else { "stepped" });
    let mut pairs = vec![
        ("stack", [a.stack.clone(), b.stack.clone()]),
        ("seed", [a.seed.to_string(), b.seed.to_string()]),
        ("build", [a.build.clone(), b.build.clone()]),
        ("log", [a.log.clone(), b.log.clone()]),
        ("live", [executor(a), executor(b)]),
    ];
    if a.stack == b.stack && a.stack_text != b.stack_text {
        pairs.push(("stack_text", differing_parts([&a.stack_text, &b.stack_text])));
    }
    pairs.extend(a.params.iter().flat_map(|params| parameters(params, b)).map(|values| ("params", values)));
    pairs.push(("files", [files(a, b), files(b, a)]));
    let is_other = |(field, values): &(&str, [String; 2])| match *field {
        // Two files of one kind can differ.
        "files" => values.iter().any(|kinds| !kinds.is_empty()),
        _ => values[0] != values[1],
    };
    let of = |(field, values): (&str, [String; 2])| RunDifference { field: field.to_owned(), values };
    pairs.into_iter().filter(is_other).map(of).collect()
}

/// The parameters in which a process of one run differs from that of another run; none if they agree, or cannot be
/// compared.
fn parameters(params: &rcs::InitialParams, other: &rcs::RunInfo) -> Vec<[String; 2]> {
    let is_other = |theirs: &&rcs::InitialParams| {
        theirs.process == params.process && theirs.schema == params.schema && theirs.params != params.params
    };
    let Some(theirs) = other.params.iter().find(is_other) else { return Vec::new() };
    let Some(schema) = registry().schema(&params.schema) else { return Vec::new() };
    let [Ok(one), Ok(other)] = [params, theirs].map(|params| schema.value(&params.params)) else {
        return Vec::new();
    };
    let of = |field: &str, value: String| {
        if value.is_empty() { value } else { format!("{}{field} = {value}", params.process) }
    };
    differing_each(&one, &other)
        .into_iter()
        .map(|(field, values)| values.map(|value| of(&field, value)))
        .collect()
}

/// The kinds of the files that only the first run has, sorted.
fn files(run: &rcs::RunInfo, other: &rcs::RunInfo) -> String {
    let own = run.files.iter().filter(|file| !other.files.contains(file));
    let kinds: BTreeSet<&str> = own.map(|file| file.kind.as_str()).collect();
    kinds.into_iter().collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcs_msg::foxglove::Vector3;

    #[test]
    fn every_parameter_that_differs_is_told_by_process() {
        let run = |[x, y, z]: [f64; 3]| {
            let message = AnyMessage::new(Vector3 { x, y, z });
            let schema = message.schema().name().to_owned();
            let params = rcs::InitialParams { process: "p".to_owned(), schema, params: message.bytes() };
            rcs::RunInfo { params: vec![params], ..Default::default() }
        };
        let told = of_infos(&run([1.0, 2.0, 3.0]), &run([1.0, 5.0, 6.0]));
        let values: Vec<_> = told.iter().map(|run| (run.field.as_str(), run.values.clone())).collect();
        let expected = [["p.y = 2", "p.y = 5"], ["p.z = 3", "p.z = 6"]];
        assert_eq!(values, expected.map(|values| ("params", values.map(str::to_owned))));
    }

    #[test]
    fn the_kinds_of_different_files_are_sorted_and_each_is_told_once() {
        let run = |files: &[[&str; 2]]| {
            let file = |[kind, text]: &[&str; 2]| rcs::RunFile {
                kind: (*kind).to_owned(),
                text: (*text).to_owned(),
            };
            rcs::RunInfo { files: files.iter().map(file).collect(), ..Default::default() }
        };
        let one = run(&[["world", "1"], ["course", "1"], ["vehicle", "1"], ["look", "0"]]);
        let other = run(&[["vehicle", "2"], ["look", "0"], ["world", "2"], ["course", "2"], ["world", "3"]]);
        let told = of_infos(&one, &other);
        let values = [1, 2].map(|_| "course, vehicle, world".to_owned());
        assert_eq!(told, [RunDifference { field: "files".to_owned(), values }]);
    }
}
