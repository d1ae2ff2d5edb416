//! A log without a stack.

use super::compared::Compared;
use super::comparison::{Comparing, Subject};
use super::frame::{Frame, Playback, Runs, SourceInfo, SourceKind};
use super::log_view::{LogView, opening_time};
use super::{Source, SourceError, Step, Task};
use rcs_log::{Log, LogMessage, MessagePosition};
use rcs_msg::{AnyMessage, Stamp, rcs};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A log without a stack: nothing runs.
pub struct LogSource {
    view: LogView,
    info: Arc<SourceInfo>,
    processes: Arc<[rcs::ProcessInfo]>,
    /// Everything up to and including this time is shown.
    place: MessagePosition,
    generation: u64,
    comparing: Comparing,
}

impl LogSource {
    /// Opens a log; see [`LogSource::new`].
    pub fn open(path: &Path) -> Result<Self, SourceError> {
        Self::new(&Log::open(path)?)
    }

    /// Positioned at the start of a log, or where it is complete if it was recorded from the middle of a run on; in both
    /// cases at the first image if that follows shortly.
    pub fn new(log: &Log) -> Result<Self, SourceError> {
        let mut view = LogView::new(log, &BTreeMap::new());
        let info = Arc::new(info_of(log, SourceKind::Log));
        let processes = view.processes()?;
        let from = log.info().complete_from.unwrap_or_default().clamp(log.info().start, log.info().end);
        let place = MessagePosition::after(opening_time(log, from)?);
        view.go_to(place)?;
        Ok(Self { view, place, info, processes, generation: 0, comparing: Comparing::default() })
    }
}

/// Description of a source on a log.
pub(crate) fn info_of(log: &Log, kind: SourceKind) -> SourceInfo {
    let info = log.info();
    let mut name =
        info.path.file_name().map_or_else(|| "log".to_owned(), |name| name.to_string_lossy().into_owned());
    if info.files.len() > 1 {
        name = format!("{name} and {} more", info.files.len() - 1);
    }
    let mut problems = info.problems.clone();
    problems.extend(info.topics.iter().filter_map(|topic| {
        let reason = topic.undecodable_because.as_ref()?;
        Some(format!("{} cannot be decoded: {reason}", topic.name))
    }));
    SourceInfo {
        kind,
        title: name,
        detail: info.path.display().to_string(),
        start: info.start,
        end: Some(info.end),
        complete_from: info.complete_from.filter(|from| *from > info.start),
        problems,
        gaps: info.gaps.clone(),
        log_topics: Arc::new(info.topics.iter().map(|topic| topic.name.clone()).collect()),
    }
}

impl Source for LogSource {
    fn info(&self) -> Arc<SourceInfo> {
        Arc::clone(&self.info)
    }

    fn now(&self) -> Stamp {
        self.place.time
    }

    fn frame(&mut self) -> Frame {
        self.generation += 1;
        self.tell_problems();
        let mut frame = Frame {
            generation: self.generation,
            info: Arc::clone(&self.info),
            now: self.place.time,
            topics: self.view.topics.clone().into(),
            processes: Arc::clone(&self.processes),
            tracks: self.view.tracks(self.place.time).collect(),
            entities: self.view.entities(self.place.time).collect(),
            events: Arc::new([self.view.events()]),
            fields: self.view.fields().collect(),
            transforms: Arc::clone(self.view.transforms(self.place.time)),
            transform_clock: Arc::clone(self.view.transform_clock(self.place.time)),
            runs: Runs::default(),
            playback: Playback::default(),
            recording: None,
            beside: Arc::new([]),
            is_beside: false,
            comparisons: self.comparing.read(self.info.start, self.info.end.unwrap_or(Stamp::MAX)),
            against: self.comparing.other(),
            other: None,
        };
        frame.other = self.comparing.other_frame(&frame);
        frame
    }

    fn seek(&mut self, to: Stamp, _task: &Task) -> Result<(), SourceError> {
        let to = to.clamp(self.info.start, self.info.end.unwrap_or(Stamp::MAX));
        self.go_to(MessagePosition::after(to))
    }

    fn step(&mut self, step: &Step, task: &Task) -> Result<bool, SourceError> {
        let (ids, back) = match step {
            Step::Message { topic, back } => (topic.as_ref().map(|name| self.view.topic_ids(name)), *back),
            Step::Cycle { process, back } => {
                // In a recording a cycle ends when its status was written.
                let named = |info: &&rcs::ProcessInfo| process.as_ref().is_none_or(|name| *name == info.name);
                let infos = self.processes.iter().filter(named);
                let ids: Vec<_> = infos.flat_map(|info| self.view.topic_ids(&info.status_buffer)).collect();
                if ids.is_empty() {
                    return Err(SourceError::Unsupported(
                        "this log holds no processes; step by message, or run a stack on it".to_owned(),
                    ));
                }
                (Some(ids), *back)
            }
            Step::BackTo { topic, sequence } => {
                let place = self.message_before(topic, *sequence)?;
                self.go_to(place.ok_or_else(|| SourceError::no_message(topic, *sequence))?)?;
                return Ok(true);
            }
            Step::Time { ns } => {
                let now = self.place.time;
                let to = if *ns >= 0 { now.after_ns(*ns as u64) } else { now.before_ns(ns.unsigned_abs()) };
                self.seek(to, task)?;
                return Ok(self.place.time != now);
            }
        };
        match neighbour(self.view.log(), ids.as_deref(), self.place, back)? {
            Some(message) => {
                self.go_to(message.place)?;
                Ok(true)
            }
            None => Ok(false),
        }
    }

    fn write(&mut self, _buffer: &str, _message: AnyMessage) -> Result<(), SourceError> {
        Err(SourceError::Unsupported("a recording cannot be written to; run a stack on it".to_owned()))
    }

    fn gather(&mut self, fields: &[rcs_formula::FieldRef], _is_interrupted: &dyn Fn() -> bool) -> bool {
        self.view.gather(fields, |_| true);
        true
    }

    fn compare(&mut self, pairs: &[[Compared; 2]]) {
        let subject = Subject { session: None, log: Some(self.view.log()), start: self.info.start };
        self.comparing.compare(pairs, &subject);
    }

    fn against(&mut self, files: &[PathBuf]) {
        let subject = Subject { session: None, log: Some(self.view.log()), start: self.info.start };
        self.comparing.against(files, &subject);
    }

    fn show_other(&mut self, is_shown: bool) {
        self.comparing.show_other(is_shown);
    }

    fn idle(&mut self) -> bool {
        let reads = self.view.idle();
        self.comparing.idle(None) || reads
    }
}

impl LogSource {
    /// Adds the problems and doubts that were found since the log was opened.
    fn tell_problems(&mut self) {
        let found = self.view.take_problems();
        if !found.is_empty() {
            Arc::make_mut(&mut self.info).problems.extend(found);
        }
    }

    /// Where the message with this sequence is, before the current place. Sequences rise with time.
    fn message_before(&self, topic: &str, sequence: u64) -> Result<Option<MessagePosition>, SourceError> {
        let ids = self.view.topic_ids(topic);
        let log = self.view.log();
        let last = |place| Ok::<_, SourceError>(log.previous_message(place, Some(&ids))?);
        let is_reached = |message: &Option<LogMessage>| {
            message.as_ref().is_some_and(|m| u64::from(m.sequence) >= sequence)
        };
        // The first time at which the message is there, by bisection.
        let (mut from, mut to) = (self.info.start.0, self.place.time.0);
        while from < to {
            let middle = u64::midpoint(from, to);
            match last(MessagePosition::after(Stamp(middle)))? {
                found if !is_reached(&found) => from = middle + 1,
                found => to = found.map_or(middle, |message| message.log_time.0.min(middle)),
            }
        }
        let mut found = last(MessagePosition::after(Stamp(to)))?;
        // Messages with the same time follow each other.
        while let Some(message) = found.as_ref().filter(|message| u64::from(message.sequence) > sequence) {
            found = last(message.place)?;
        }
        Ok(found.filter(|message| u64::from(message.sequence) == sequence).map(|message| message.place))
    }

    fn go_to(&mut self, place: MessagePosition) -> Result<(), SourceError> {
        self.view.go_to(place)?;
        self.place = place;
        Ok(())
    }
}

/// The next (or previous) message of any of `topics`, or of all topics.
pub(crate) fn neighbour(
    log: &Log,
    topics: Option<&[rcs_log::TopicId]>,
    place: MessagePosition,
    back: bool,
) -> Result<Option<LogMessage>, SourceError> {
    Ok(if back { log.previous_message(place, topics)? } else { log.next_message(place, topics)? })
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcs_log::{LogWriter, WriteHeader, WriterOptions};
    use rcs_msg::{foxglove, schema_of};

    /// Time between two messages.
    const EVERY_NS: u64 = 100_000_000;

    /// A log of 40 s in many chunks: `/once` at the start, then ten numbered messages a second on `/a`.
    fn write_log(path: &Path) {
        let options = WriterOptions { chunk_bytes: 1000, compress: false, ..WriterOptions::default() };
        let mut writer = LogWriter::create(path, options).unwrap();
        let [once, a] = ["/once", "/a"].map(|topic| {
            writer.add_channel(topic, schema_of::<foxglove::Vector3>(), &BTreeMap::new()).unwrap()
        });
        for index in 0..400_u32 {
            let log_time = Stamp(u64::from(index) * EVERY_NS);
            let header = WriteHeader { sequence: index, log_time, publish_time: log_time };
            let message = AnyMessage::new(foxglove::Vector3 { x: f64::from(index), y: 0.0, z: 0.0 });
            writer.write(if index == 0 { once } else { a }, header, &message.bytes()).unwrap();
        }
        writer.finish().unwrap();
    }

    /// The time, and what is shown of both topics.
    fn shown(source: &mut LogSource) -> (Stamp, [Option<f64>; 2]) {
        let frame = source.frame();
        let x_of = |name: &str| frame.topic(name)?.get::<foxglove::Vector3>().map(|vector| vector.x);
        (frame.now, ["/once", "/a"].map(x_of))
    }

    #[test]
    fn what_is_shown_stays_where_the_file_was_cut_and_a_problem_says_so() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log.mcap");
        write_log(&path);
        let (mut source, task) = (LogSource::open(&path).unwrap(), Task::default());
        source.seek(Stamp(30 * EVERY_NS), &task).unwrap();
        assert_eq!(shown(&mut source), (Stamp(30 * EVERY_NS), [Some(0.0), Some(30.0)]));
        assert_eq!(source.info().problems, Vec::<String>::new());
        let file = std::fs::File::options().write(true).open(&path).unwrap();
        file.set_len(file.metadata().unwrap().len() / 2).unwrap();
        let error = source.seek(Stamp(300 * EVERY_NS), &task).unwrap_err().to_string();
        assert!(error.contains("the file has changed since it was opened"), "{error}");
        assert_eq!(shown(&mut source), (Stamp(30 * EVERY_NS), [Some(0.0), Some(30.0)]));
        assert!(source.step(&Step::Message { topic: None, back: false }, &task).unwrap());
        assert_eq!(shown(&mut source), (Stamp(31 * EVERY_NS), [Some(0.0), Some(31.0)]));
        // Where it reads on from what is shown, too.
        let step = Step::Time { ns: 1_500_000_000 };
        while matches!(source.step(&step, &task), Ok(true)) {}
        let (now, topics) = shown(&mut source);
        assert!(now > Stamp(31 * EVERY_NS) && now < Stamp(300 * EVERY_NS), "{now}");
        assert_eq!(topics, [Some(0.0), Some(now.0 as f64 / EVERY_NS as f64)]);
        let problems = &source.info.problems;
        assert!(matches!(&problems[..], [problem] if problem.contains("has changed")), "{problems:?}");
    }

    #[test]
    fn a_file_that_is_replaced_is_a_problem_before_more_of_it_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log.mcap");
        write_log(&path);
        let mut source = LogSource::open(&path).unwrap();
        source.seek(Stamp::MAX, &Task::default()).unwrap();
        std::fs::write(&path, b"another file").unwrap();
        let problems = source.frame().info.problems.clone();
        assert!(matches!(&problems[..], [problem] if problem.contains("has changed")), "{problems:?}");
    }
}
