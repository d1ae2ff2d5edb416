//! One moment of a source, as the views see it.

use crate::history::{Moment, RunId, RunSummary};
use crate::role::{ROLE, Role};
use rcs_bus::Sample;
use rcs_geom::TransformTree;
use rcs_log::Gap;
use rcs_msg::classes::{CLASSES, LabelClass, classes_from_json};
use rcs_msg::{AnyMessage, Payload, Schema, Stamp, rcs};
use std::collections::BTreeMap;
use std::sync::{Arc, OnceLock};

/// Which kind of thing is looked at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SourceKind {
    /// A recording, as it is.
    Log,
    /// A stack, run on a recording.
    Replay,
    /// A stack, run on nothing but itself.
    Stack,
}

/// What a source is.
#[derive(Clone, Debug)]
pub struct SourceInfo {
    /// Which kind of thing.
    pub kind: SourceKind,
    /// Name for a person: the file's or the stack's.
    pub title: String,
    /// Full path or description, for hovering.
    pub detail: String,
    /// First moment.
    pub start: Stamp,
    /// Last moment; `None` where it has no end.
    pub end: Option<Stamp>,
    /// What is wrong with it, a line each: what was lost, which topics cannot be decoded.
    pub problems: Vec<String>,
    /// Where there is nothing for a long time, ascending: playing jumps over it.
    pub gaps: Vec<Gap>,
}

/// The run that a topic is of. Two are shown side by side and never mixed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum RunTag {
    /// Read from the recording.
    Recorded,
    /// Made by the stack that runs now, in that run of it.
    Run(RunId),
}

impl RunTag {
    /// The first run of what runs now.
    pub const FIRST: Self = Self::Run(RunId(0));

    /// Whether it was read from the recording.
    pub fn is_recorded(self) -> bool {
        self == Self::Recorded
    }
}

/// One buffer, as the views see it at one moment.
#[derive(Clone, Debug)]
pub struct Topic {
    /// Name of the buffer: `/wm1/map`.
    pub name: Arc<str>,
    /// The run that it is of.
    pub run: RunTag,
    /// Type of its messages as they are stored.
    pub schema: Arc<Schema>,
    /// `rcs.role`, `rcs.overlay_of`, `rcs.palette`, ….
    pub metadata: Arc<BTreeMap<String, String>>,
    /// Process that writes it; empty where that is not known.
    pub writer: Arc<str>,
    /// Messages up to now (a stack) or in all (a log).
    pub messages: u64,
    /// Messages a second over the last seconds before the newest message; `None` where there are fewer than two.
    pub hz: Option<f64>,
    /// Why its messages cannot be read; `None` where they can.
    pub undecodable: Option<Arc<str>>,
    /// Newest message at this moment.
    pub latest: Option<Sample>,
    /// Whether `latest` is older than that: the right one is being computed again, because it was not kept.
    pub pending: bool,
    pub(crate) canonical: Arc<OnceLock<Option<AnyMessage>>>,
}

impl Topic {
    /// A topic of which nothing is known yet but its name and type.
    pub fn new(name: &str, run: RunTag, schema: Arc<Schema>) -> Self {
        Self {
            name: name.into(),
            run,
            schema,
            metadata: Arc::default(),
            writer: "".into(),
            messages: 0,
            hz: None,
            undecodable: None,
            latest: None,
            pending: false,
            canonical: Arc::default(),
        }
    }

    /// The same topic with another newest message.
    #[must_use]
    pub fn with_latest(mut self, sample: Sample) -> Self {
        self.latest = Some(sample);
        self.canonical = Arc::default();
        self
    }

    /// The newest message as the canonical type that its schema converts to (a ROS 2 image as a
    /// `foxglove.RawImage`, …); converted at most once. `None` where there is none.
    pub fn canonical(&self) -> Option<&AnyMessage> {
        self.canonical.get_or_init(|| canonical(&self.latest.as_ref()?.message)).as_ref()
    }

    /// The newest message, if it is (or converts to) a `T`.
    pub fn get<T: Payload>(&self) -> Option<&T> {
        self.canonical()?.get()
    }

    /// What its messages are for; `None` where that is not said, or by a name that is not known here.
    pub fn role(&self) -> Option<Role> {
        self.role_name().parse().ok()
    }

    /// `rcs.role` as it is written, or "".
    pub fn role_name(&self) -> &str {
        self.metadata.get(ROLE).map_or("", String::as_str)
    }

    /// What the values of its label images mean; none where that is not said.
    pub fn classes(&self) -> Vec<LabelClass> {
        self.metadata.get(CLASSES).map(|text| classes_from_json(text)).unwrap_or_default()
    }

    /// Whether it holds the ground truth of a simulation: nothing that a robot could know.
    pub fn is_ground_truth(&self) -> bool {
        self.metadata.contains_key(crate::stack::TRUTH)
    }

    /// Name of the type that views ask for: the canonical one where there is one, else the schema's own.
    pub fn type_name(&self) -> &str {
        rcs_msg::canonical_name(&self.schema).unwrap_or_else(|| self.schema.name())
    }

    /// Age of the newest message, in seconds.
    pub fn age_s(&self, now: Stamp) -> Option<f64> {
        Some(now.seconds_since(self.latest.as_ref()?.header.log_time))
    }
}

/// The message as its canonical type; typed messages are canonical already.
pub(crate) fn canonical(message: &AnyMessage) -> Option<AnyMessage> {
    if message.is_typed() {
        return Some(message.clone());
    }
    rcs_msg::canonical(&message.schema(), &message.bytes())?.ok()
}

/// Where something has been: every position of a pose-like topic, in the topic's own frame.
#[derive(Clone, Debug, Default)]
pub struct Track {
    /// Topic that it was read from.
    pub topic: Arc<str>,
    /// Coordinate frame; `wgs84` where the points are degrees of longitude and latitude, and metres of altitude.
    pub frame_id: String,
    /// Times, ascending.
    pub stamps: Vec<Stamp>,
    /// Position and yaw (x, y, z in m, yaw in rad; yaw NaN where it is not known), one for each time.
    pub points: Vec<[f64; 4]>,
}

/// How a driver plays a source.
#[derive(Clone, Debug, PartialEq)]
pub struct Playback {
    /// Whether time runs.
    pub playing: bool,
    /// Seconds of the source a second that are asked for; infinite is as fast as it goes.
    pub speed: f64,
    /// Seconds of the source a second as measured over the last half second; `None` until there is such a time.
    pub achieved: Option<f64>,
    /// Start again at the end.
    pub looping: bool,
    /// How far long work is, 0 to 1; `None` where there is none.
    pub busy: Option<f64>,
    /// The last thing that could not be done.
    pub error: Option<String>,
    /// How far playing is behind the clock since it was started, in seconds of the source. What a source could not do
    /// in time is not caught up with.
    pub lag_s: f64,
}

impl Default for Playback {
    fn default() -> Self {
        Self {
            playing: false,
            speed: 1.0,
            achieved: None,
            looping: false,
            busy: None,
            error: None,
            lag_s: 0.0,
        }
    }
}

/// The runs of what runs now, and where in them the moment lies.
#[derive(Clone, Debug, Default)]
pub struct Runs {
    /// All runs, in the order in which they began. Empty for a recording.
    pub all: Arc<[RunSummary]>,
    /// The moment that is shown.
    pub moment: Moment,
    /// Whether nothing that was done lies ahead of it.
    pub is_at_end: bool,
    /// How far that is that is computed again for this moment, 0 to 1; `None` where everything was kept.
    pub filling: Option<f64>,
}

impl Runs {
    /// The run that is shown.
    pub fn current(&self) -> RunId {
        self.moment.run
    }
}

/// Everything that can be known of a source at one moment.
#[derive(Clone, Debug)]
pub struct Frame {
    /// Differs from frame to frame.
    pub generation: u64,
    /// What is looked at.
    pub info: Arc<SourceInfo>,
    /// The moment.
    pub now: Stamp,
    /// All topics, by name and run.
    pub topics: Arc<[Topic]>,
    /// All processes, in the order of the stack file.
    pub processes: Arc<[rcs::ProcessInfo]>,
    /// Every track that is known so far, over the whole log, by topic.
    pub tracks: Arc<BTreeMap<Arc<str>, Arc<Track>>>,
    /// Transforms up to now; static ones of the whole log.
    pub transforms: Arc<TransformTree>,
    /// The runs of what runs now.
    pub runs: Runs,
    /// How it is played.
    pub playback: Playback,
}

impl Frame {
    /// The topic of that name; the one that is made now where it was recorded, too.
    pub fn topic(&self, name: &str) -> Option<&Topic> {
        self.topics.iter().filter(|topic| &*topic.name == name).max_by_key(|topic| topic.run)
    }

    /// The topic of that name and run.
    pub fn topic_of(&self, name: &str, run: RunTag) -> Option<&Topic> {
        self.topics.iter().find(|topic| &*topic.name == name && topic.run == run)
    }

    /// All topics whose messages are, or convert to, that type.
    pub fn topics_of_type<'a>(&'a self, type_name: &'a str) -> impl Iterator<Item = &'a Topic> {
        self.topics.iter().filter(move |topic| topic.type_name() == type_name)
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
