//! Frames: one moment of a source, as the views see it.

use super::acts::OPERATOR;
use super::compared::Comparison;
use super::entities::{Entities, Entity, entities_of};
use super::events::Events;
use super::fields::FieldSeries;
use super::recording_state::RecordingState;
use super::run_tag::RunTag;
use super::tracks::Track;
use super::transform_clock::TransformClock;
use crate::conversion::{acquisition_time, canonical, publication_time, states_acquisition};
use crate::history::{Moment, RunId, RunSummary};
use crate::role::{ROLE, Role};
use rcs_bus::Sample;
use rcs_formula::FieldRef;
use rcs_geom::TransformTree;
use rcs_log::Gap;
use rcs_msg::classes::{CLASSES, LabelClass, classes_from_json};
use rcs_msg::foxglove::SceneUpdate;
use rcs_msg::{AnyMessage, Payload, Schema, Stamp, rcs};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicU8, Ordering};
use std::sync::{Arc, OnceLock};

/// Kind of a source.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SourceKind {
    /// A recording without a stack.
    #[default]
    Log,
    /// A stack that replays a recording.
    Replay,
    /// A stack without a recording.
    Stack,
}

/// Description of a source.
#[derive(Clone, Debug, Default)]
pub struct SourceInfo {
    /// Its kind.
    pub kind: SourceKind,
    /// Name as shown: that of the file or of the stack.
    pub title: String,
    /// Full path or description, for the tooltip.
    pub detail: String,
    /// Start time.
    pub start: Stamp,
    /// End time; `None` if it has no end.
    pub end: Option<Stamp>,
    /// The time from which a recording that was begun in the middle of its run is complete, if that is after its start:
    /// before it are only the messages that held then.
    pub complete_from: Option<Stamp>,
    /// Problems, one line each: losses, topics that cannot be decoded, what is probably a mistake in the stack.
    pub problems: Vec<String>,
    /// Long periods without messages, ascending; playing jumps over them.
    pub gaps: Vec<Gap>,
    /// Names of the topics of the log, as they are in it; none without a log. In [`Frame::topics`], a topic that feeds a
    /// buffer of a stack has the name of the buffer.
    pub log_topics: Arc<BTreeSet<String>>,
}

/// One topic, as the views see it at one moment.
#[derive(Clone, Debug)]
pub struct Topic {
    /// Name of the buffer: `/wm1/map`.
    pub name: Arc<str>,
    /// Its run.
    pub run: RunTag,
    /// Type of its messages as stored.
    pub schema: Arc<Schema>,
    /// `rcs.role`, `rcs.overlay_of`, `rcs.palette`, ….
    pub metadata: Arc<BTreeMap<String, String>>,
    /// Process that writes it; empty if unknown.
    pub writer: Arc<str>,
    /// Number of messages up to now (stack) or in total (log).
    pub messages: u64,
    /// Messages per second over the last seconds before the newest message, or the mean of the log where these have a
    /// single one or there is no message yet; `None` for fewer than two messages.
    pub hz: Option<f64>,
    /// A lower rate, by which the age is judged ([`Topic::due_hz`]): of a topic of a log that is sent only at times, for
    /// which `hz` is the mean; 0 for one that is sent at the start alone.
    pub seldom_hz: Option<f64>,
    /// Why its messages cannot be read; `None` if they can.
    pub undecodable: Option<Arc<str>>,
    /// Newest message at this moment.
    pub latest: Option<Sample>,
    /// Whether `latest` is outdated: the right message was not kept and is being computed again.
    pub pending: bool,
    pub(crate) derived: Arc<Derived>,
    /// Name of the canonical type, once it has been asked for.
    pub(crate) type_name: Arc<OnceLock<Option<&'static str>>>,
    /// Number of frames for which the newest message is converted before they are shown; the same in all frames.
    pub(crate) read_lately: Arc<AtomicU8>,
}

/// What has been found out about the newest message of a topic; each once, when it is asked for.
#[derive(Debug, Default)]
pub(crate) struct Derived {
    canonical: OnceLock<Option<AnyMessage>>,
    acquired: OnceLock<Stamp>,
    entities: OnceLock<Vec<Arc<Entity>>>,
}

/// A topic that nobody has read in so many frames is not converted before it is shown.
const LATELY: u8 = 8;

/// Most bytes of a message that is decoded completely for its time of acquisition: one of JSON takes several times as
/// much.
const MOST_DECODED_BYTES: usize = 8 << 20;

/// Types of messages that stay in force until the next one. A drive command does not: it is obeyed for a moment only.
const LASTING: [&str; 7] = [
    "rcs.Command",
    "rcs.EmergencyStop",
    "rcs.JournalEvent",
    "rcs.Mission",
    "rcs.OverrideList",
    "rcs.ProcessInfo",
    "rcs.RunInfo",
];

/// Key of the metadata of a recorded topic whose messages are stored whole and by updates: the number of updates, and the
/// topic that has them, which is none of a frame.
pub const UPDATES: &str = "updates";

impl Topic {
    /// A topic of which only name and type are known.
    pub fn new(name: &str, run: RunTag, schema: Arc<Schema>) -> Self {
        Self {
            name: name.into(),
            run,
            schema,
            metadata: Arc::default(),
            writer: "".into(),
            messages: 0,
            hz: None,
            seldom_hz: None,
            undecodable: None,
            latest: None,
            pending: false,
            derived: Arc::default(),
            type_name: Arc::default(),
            read_lately: Arc::default(),
        }
    }

    /// The same topic with another newest message.
    #[must_use]
    pub fn with_latest(mut self, sample: Sample) -> Self {
        self.set_latest(Some(sample));
        self
    }

    /// The rate at which messages are due: by it, the newest one is outdated or not. `None` where the newest one stays in
    /// force, however long ago it was sent: parameters, which the operator alone writes, commands, and what a run says of
    /// itself.
    pub fn due_hz(&self) -> Option<f64> {
        let stays = &*self.writer == OPERATOR || LASTING.contains(&self.schema.name());
        self.seldom_hz.or(self.hz).filter(|_| !stays)
    }

    pub(crate) fn set_latest(&mut self, sample: Option<Sample>) {
        self.latest = sample;
        self.derived = Arc::default();
    }

    /// The newest message converted to the canonical type of its schema (a ROS 2 image to a `foxglove.RawImage`, …);
    /// converted at most once. `None` if there is none.
    pub fn canonical(&self) -> Option<&AnyMessage> {
        self.read_lately.store(LATELY, Ordering::Relaxed);
        self.converted()
    }

    fn converted(&self) -> Option<&AnyMessage> {
        self.derived.canonical.get_or_init(|| canonical(&self.latest.as_ref()?.message)).as_ref()
    }

    /// Converts the newest message, if that of one of the last frames was read: whoever reads it need not wait.
    pub(crate) fn convert_ahead(&self) {
        let left = self.read_lately.load(Ordering::Relaxed);
        if left > 0 {
            self.read_lately.store(left - 1, Ordering::Relaxed);
            self.converted();
        }
    }

    /// Time of acquisition of the newest message: what the message or its writer says ([`crate::acquisition_time`]). A
    /// recorded message is converted for it, at most once; of one that is only decoded and is large, the time of
    /// publication counts. `None` before the first message.
    pub fn acq_time(&self) -> Option<Stamp> {
        let Sample { header, message } = self.latest.as_ref()?;
        if !self.run.is_recorded() || states_acquisition(&self.metadata) {
            return Some(header.acq_time);
        }
        Some(*self.derived.acquired.get_or_init(|| {
            let message = self.converted().unwrap_or(message);
            if !message.is_typed() && message.bytes().len() > MOST_DECODED_BYTES {
                return publication_time(header.acq_time, header.log_time);
            }
            acquisition_time(message, header.acq_time, header.log_time)
        }))
    }

    /// The newest message, if it is a `T` or converts to one.
    pub fn get<T: Payload>(&self) -> Option<&T> {
        self.canonical()?.get()
    }

    /// The entities of the newest message, whether their lifetimes have passed or not.
    fn entities(&self) -> &[Arc<Entity>] {
        self.derived.entities.get_or_init(|| {
            let entities =
                |sample: &Sample| Some(entities_of(self.get::<SceneUpdate>()?, sample.header.log_time));
            self.latest.as_ref().and_then(entities).unwrap_or_default()
        })
    }

    /// Role of its messages; `None` if it has none, or one that is not known.
    pub fn role(&self) -> Option<Role> {
        self.role_name().parse().ok()
    }

    /// `rcs.role` as stored, or "".
    pub fn role_name(&self) -> &str {
        self.metadata.get(ROLE).map_or("", String::as_str)
    }

    /// Classes of its label images; empty if it has none.
    pub fn classes(&self) -> Vec<LabelClass> {
        self.metadata.get(CLASSES).map(|text| classes_from_json(text)).unwrap_or_default()
    }

    /// Whether it contains the ground truth of a simulation, which a robot cannot know.
    pub fn is_ground_truth(&self) -> bool {
        self.metadata.contains_key(crate::stack::TRUTH)
    }

    /// Name of the type that views request: the canonical one if there is one, else that of the schema.
    pub fn type_name(&self) -> &str {
        let canonical = self.type_name.get_or_init(|| rcs_msg::canonical_name(&self.schema));
        canonical.unwrap_or_else(|| self.schema.name())
    }

    /// Age of the newest message, in seconds.
    pub fn age_s(&self, now: Stamp) -> Option<f64> {
        Some(now.seconds_since(self.latest.as_ref()?.header.log_time))
    }
}

/// State of playing.
#[derive(Clone, Debug, PartialEq)]
pub struct Playback {
    /// Whether the source plays.
    pub playing: bool,
    /// The viewed time at which playing began, or to which it jumped since: by a seek, by another run, or from the end to
    /// the start. A gap of a recording that is left out is no jump.
    pub from: Stamp,
    /// Requested seconds of the source per second of the clock; infinite for as fast as possible.
    pub speed: f64,
    /// Measured seconds of the source per second over the last half second; `None` until enough time has passed.
    pub achieved: Option<f64>,
    /// Whether to start again at the end.
    pub looping: bool,
    /// Progress of long work, 0 to 1; `None` if there is none.
    pub busy: Option<f64>,
    /// The last request that failed.
    pub error: Option<String>,
    /// Delay relative to the clock since playing started, in seconds of the source. Lost time is not caught up with.
    pub lag_s: f64,
}

impl Default for Playback {
    fn default() -> Self {
        Self {
            playing: false,
            from: Stamp(0),
            speed: 1.0,
            achieved: None,
            looping: false,
            busy: None,
            error: None,
            lag_s: 0.0,
        }
    }
}

/// The runs of a stack, and the viewed moment.
#[derive(Clone, Debug, Default)]
pub struct Runs {
    /// All runs, in the order in which they began. Empty for a recording.
    pub all: Arc<[RunSummary]>,
    /// The viewed moment.
    pub moment: Moment,
    /// Whether the viewed moment is the end of what was executed.
    pub is_at_end: bool,
    /// Progress of recomputing what this moment needs, 0 to 1; `None` if everything was kept.
    pub filling: Option<f64>,
}

impl Runs {
    /// The viewed run.
    pub fn current(&self) -> RunId {
        self.moment.run
    }
}

/// Everything that is known of a source at one moment.
#[derive(Clone, Debug)]
pub struct Frame {
    /// Unique for each frame.
    pub generation: u64,
    /// Description of the source.
    pub info: Arc<SourceInfo>,
    /// The viewed time.
    pub now: Stamp,
    /// All topics, by name and run.
    pub topics: Arc<[Topic]>,
    /// All processes, in the order of the stack file.
    pub processes: Arc<[rcs::ProcessInfo]>,
    /// Every track known so far, over the whole log and in every run, by run and topic. Of a recording
    /// whose clock begins again, their part in the run of the clock in which this moment lies.
    pub tracks: Arc<[Track]>,
    /// The entities of every topic that has some, in every run; [`Frame::entities()`] finds those of a topic.
    pub entities: Arc<[Entities]>,
    /// The events of every run, over the whole log as far as it has been read.
    pub events: Arc<[Events]>,
    /// The fields that were asked for ([`super::Control::Gather`]), in every run, over the whole log as far as it has
    /// been read.
    pub fields: Arc<[FieldSeries]>,
    /// Transforms: of a recording those of the whole log as far as it has been read (where its clock begins again, of the
    /// run of the clock in which this moment lies), of a run those up to now, of a stack on a recording both, where the
    /// run's replace recorded ones of the same frame.
    pub transforms: Arc<TransformTree>,
    /// The clock of the transforms of a recording.
    pub transform_clock: Arc<TransformClock>,
    /// The runs of the stack.
    pub runs: Runs,
    /// State of playing.
    pub playback: Playback,
    /// The recording of the run; the last one, after it has ended.
    pub recording: Option<RecordingState>,
    /// The same moment in other runs, as far as they were requested ([`super::Control::Watch`]), by run.
    pub beside: Arc<[Arc<Frame>]>,
    /// Whether it is of a run beside the viewed one, to which nothing can be written.
    pub is_beside: bool,
    /// The comparisons that were asked for ([`super::Control::Compare`]), as far as they have come.
    pub comparisons: Arc<[Comparison]>,
    /// Name of the recording that [`super::Compared::Other`] means.
    pub against: Option<Arc<str>>,
    /// The same moment in that recording, while it is compared and shown ([`super::Control::ShowOther`]): tracks,
    /// transforms, and the topics with maps, paths, poses and transforms, without rates.
    pub other: Option<Arc<Frame>>,
}

impl Frame {
    /// A frame of a source in which nothing has been read yet.
    pub fn empty(info: Arc<SourceInfo>, now: Stamp) -> Self {
        Self {
            generation: 0,
            info,
            now,
            topics: Arc::new([]),
            processes: Arc::new([]),
            tracks: Arc::new([]),
            entities: Arc::new([]),
            events: Arc::new([]),
            fields: Arc::new([]),
            transforms: Arc::new(TransformTree::new()),
            transform_clock: Arc::default(),
            runs: Runs::default(),
            playback: Playback::default(),
            recording: None,
            beside: Arc::new([]),
            is_beside: false,
            comparisons: Arc::new([]),
            against: None,
            other: None,
        }
    }

    /// The frame of a run: this one for `None` and for the viewed run. `None` if it is not known.
    pub fn of_run(&self, run: Option<RunId>) -> Option<&Frame> {
        match run {
            Some(run) if run != self.runs.current() => {
                self.beside.iter().find(|frame| frame.runs.current() == run).map(|frame| &**frame)
            }
            _ => Some(self),
        }
    }

    /// The time before which a message may be absent because the recording was begun in the middle of its run. `None`
    /// also for a stack on such a recording, which computes its own messages.
    pub fn recorded_from(&self) -> Option<Stamp> {
        self.info.complete_from.filter(|_| self.info.kind == SourceKind::Log)
    }

    /// Whether a message may be absent at this moment for that reason.
    pub fn is_before_recording(&self) -> bool {
        self.recorded_from().is_some_and(|from| self.now < from)
    }

    /// The time by the clock of the transforms at a log time: what is placed at [`Frame::now`] is looked up at this.
    pub fn transform_time(&self, log_time: Stamp) -> Stamp {
        self.transform_clock.at(log_time)
    }

    /// The time by the clock of the transforms at which a message is placed: its time of acquisition, or where that is of
    /// another clock (of a sensor, of the log, or of before the clock began again), the time of its log time.
    pub fn placing_time(&self, acquired: Stamp, log_time: Stamp) -> Stamp {
        if self.transform_clock.covers(acquired, log_time) { acquired } else { self.transform_time(log_time) }
    }

    /// The topic with this name; the computed one if it exists in both.
    pub fn topic(&self, name: &str) -> Option<&Topic> {
        self.topics.iter().filter(|topic| &*topic.name == name).max_by_key(|topic| topic.run)
    }

    /// The topic with this name and run.
    pub fn topic_of(&self, name: &str, run: RunTag) -> Option<&Topic> {
        self.topics.iter().find(|topic| &*topic.name == name && topic.run == run)
    }

    /// All topics whose messages have this type or convert to it: those of the run, then those of the recording.
    pub fn topics_of_type<'a>(&'a self, type_name: &'a str) -> impl Iterator<Item = &'a Topic> {
        let of = move |is_recorded: bool| {
            let topics = self.topics.iter().filter(move |topic| topic.run.is_recorded() == is_recorded);
            topics.filter(move |topic| topic.type_name() == type_name)
        };
        of(false).chain(of(true))
    }

    /// What a run says of itself, or the recorded run; `None` if it has said nothing.
    pub fn run_info(&self, run: RunTag) -> Option<&rcs::RunInfo> {
        self.topics_of_type("rcs.RunInfo").find(|topic| topic.run == run)?.get()
    }

    /// The track of this topic in this run.
    pub fn track(&self, topic: &str, run: RunTag) -> Option<&Track> {
        self.tracks.iter().find(|track| &*track.topic == topic && track.run == run)
    }

    /// The entities of a topic that exist at this moment; those of its newest message alone where not all messages before
    /// it are known. They include entities whose lifetime has passed: see [`Entity::is_alive`].
    pub fn entities<'a>(&'a self, topic: &'a Topic) -> &'a [Arc<Entity>] {
        if topic.latest.is_none() {
            return &[];
        }
        let found = self.gathered(topic).and_then(|gathered| self.found(topic, gathered));
        found.unwrap_or_else(|| topic.entities())
    }

    /// Whether [`Frame::entities()`] are all that exist at this moment, so that the newest message is not read for them;
    /// if not, they are those of the newest message alone. `None` for a topic whose entities are not gathered.
    pub fn has_all_entities(&self, topic: &Topic) -> Option<bool> {
        Some(self.found(topic, self.gathered(topic)?).is_some())
    }

    fn found<'a>(&self, topic: &Topic, gathered: &'a Entities) -> Option<&'a [Arc<Entity>]> {
        let newest = topic.latest.as_ref().filter(|_| gathered.now == self.now)?;
        gathered.found(newest.header.log_time)
    }

    /// Number of entities of a topic that are nowhere shown, because too many others existed.
    pub fn entities_left_out(&self, topic: &Topic) -> usize {
        self.gathered(topic).map_or(0, Entities::left_out)
    }

    /// Of a topic that a recording feeds, the entities are gathered from the recording.
    fn gathered(&self, topic: &Topic) -> Option<&Entities> {
        let of = |run| self.entities.iter().find(move |of| of.topic == topic.name && of.run == run);
        of(topic.run).or_else(|| of(RunTag::Recorded))
    }

    /// The values of a field in this run, or else in the recording.
    pub fn field(&self, field: &FieldRef, run: RunTag) -> Option<&FieldSeries> {
        let of = |run| self.fields.iter().find(move |series| series.run == run && series.field == *field);
        of(run).or_else(|| of(RunTag::Recorded))
    }

    /// The comparison of these two.
    pub fn comparison(&self, sides: [super::Compared; 2]) -> Option<&Comparison> {
        self.comparisons.iter().find(|comparison| comparison.sides == sides)
    }

    /// The events of the viewed run; those of the recording where nothing runs.
    pub fn events(&self) -> Option<&Events> {
        let current = RunTag::Run(self.runs.current());
        let of = |run: RunTag| self.events.iter().find(|events| events.run == run);
        of(current).filter(|events| !events.is_empty()).or_else(|| of(RunTag::Recorded))
    }

    /// Seconds since the start of the source.
    pub fn time_s(&self) -> f64 {
        self.now.seconds_since(self.info.start)
    }

    /// The newest status of a process.
    pub fn status(&self, process: &rcs::ProcessInfo) -> Option<&rcs::Status> {
        self.topic(&process.status_buffer)?.get()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcs_bus::{Header, WriterId};
    use rcs_msg::foxglove::{PointCloud, Vector2};
    use rcs_msg::schema_of;

    #[test]
    fn a_topic_that_was_read_is_converted_ahead_until_it_is_not_read_any_more() {
        let header =
            Header { sequence: 1, log_time: Stamp(1), acq_time: Stamp(1), writer: WriterId::RUNTIME };
        let mut topic = Topic::new("/a", RunTag::Recorded, Arc::clone(schema_of::<Vector2>()));
        let mut is_converted = |reads: bool| {
            let message = AnyMessage::new(Vector2 { x: 1.0, y: 2.0 });
            topic = topic.clone().with_latest(Sample { header, message });
            topic.convert_ahead();
            let is_converted = topic.derived.canonical.get().is_some();
            assert!(!reads || topic.canonical().is_some());
            is_converted
        };
        assert!(!is_converted(true), "nobody had read it");
        for _ in 0..LATELY {
            assert!(is_converted(false));
        }
        assert!(!is_converted(false));
    }

    #[test]
    fn a_recorded_message_was_acquired_at_its_own_stamp_but_for_those_that_state_it_beside() {
        let message = PointCloud { timestamp: Some(Stamp(3).to_proto()), ..PointCloud::default() };
        let stored = AnyMessage::new(message);
        let stored = AnyMessage::encoded(stored.schema(), stored.bytes());
        let header =
            Header { sequence: 1, log_time: Stamp(9), acq_time: Stamp(7), writer: WriterId::RUNTIME };
        let topic = |run: RunTag| {
            let topic = Topic::new("/a", run, stored.schema());
            topic.with_latest(Sample { header, message: stored.clone() })
        };
        let mut recorded = topic(RunTag::Recorded);
        assert!(recorded.derived.canonical.get().is_none(), "nothing is decoded before it is asked for");
        assert_eq!(recorded.acq_time(), Some(Stamp(3)));
        recorded.metadata = Arc::new([("rcs.writer".to_owned(), "lidar".to_owned())].into());
        assert_eq!(recorded.acq_time(), Some(Stamp(7)));
        assert_eq!(topic(RunTag::FIRST).acq_time(), Some(Stamp(7)));
    }

    #[test]
    fn topics_of_the_run_come_before_those_of_the_recording() {
        let schema = schema_of::<Vector2>();
        let topic = |name: &str, run: RunTag| Topic::new(name, run, Arc::clone(schema));
        let info = SourceInfo { kind: SourceKind::Replay, ..SourceInfo::default() };
        let topics =
            [topic("/a", RunTag::Recorded), topic("/b", RunTag::FIRST), topic("/c", RunTag::Recorded)];
        let frame = Frame {
            topics: topics.into_iter().chain([topic("/d", RunTag::FIRST)]).collect(),
            ..Frame::empty(Arc::new(info), Stamp(0))
        };
        let names: Vec<_> =
            frame.topics_of_type("foxglove.Vector2").map(|topic| topic.name.to_string()).collect();
        assert_eq!(names, ["/b", "/d", "/a", "/c"]);
    }
}
