//! The transforms and tracks of a recording whose clock begins again, as where a simulation was started again while the
//! recorder went on.
//!
//! Transforms are found by their stamps, and two runs of one clock have the same stamps. So a recording is divided into
//! *epochs*: each has transforms, tracks and a [`TransformClock`] of its own, and a moment is shown by those of the epoch
//! in which its log time lies, however it was reached. (tf2 forgets everything where time goes back, which a player that
//! seeks cannot do.)
//!
//! An epoch begins where the stamps of a frame's transforms on one topic go back by more than [`BEGINS_AGAIN_NS`], and that
//! far behind the clock of the present epoch, while the log time goes on; those of odometry count where nothing else moves
//! its frame. Poses do not begin an epoch, but where they (or stamps of 0, from a node that has not heard the new time yet)
//! come shortly before the first new transform, the epoch begins with them. It lasts at least [`BEGINS_AGAIN_NS`]. A frame
//! that comes for the first time in an epoch is not compared with its stamps of before.
//!
//! Stamps that leap ahead, and then go on where they were before, were wrong, or of another clock on that topic: they begin
//! nothing. Stamps that go back, and then on where they were before, begin an epoch once, and nothing from then on.
//!
//! Of frames that an epoch does not move, the transforms that were sent once or are static hold from the nearest epoch
//! before, else from the nearest after, unless an epoch between moves the frame. Others do not: where the vehicle was in
//! another run is unknown here.
//!
//! State: that of the tracks, and about 100 bytes for each frame of a topic.

use super::run_tag::RunTag;
use super::tracks::{Track, Tracks, frame_name, stated};
use super::transform_clock::{BEGINS_AGAIN_NS, TransformClock};
use rcs_geom::TransformTree;
use rcs_msg::{AnyMessage, Stamp, foxglove};
use std::collections::BTreeMap;
use std::iter::once;
use std::sync::Arc;

/// Greatest number of epochs; transforms are mixed in the last one.
const MOST_EPOCHS: usize = 1000;
/// Number of epochs whose beginning is told.
const MOST_TOLD: usize = 8;

/// One run of the clock.
#[derive(Default)]
struct Epoch {
    /// Log time of its beginning; 0 for the first one.
    from: Stamp,
    tracks: Tracks,
    /// The transforms, and their clock, when they were last shared.
    tree: Arc<TransformTree>,
    clock: Arc<TransformClock>,
    is_shared: bool,
}

/// The transforms and tracks of a log, by the runs of its clock.
#[derive(Default)]
pub(crate) struct Epochs {
    /// Start of the log.
    start: Stamp,
    past: Vec<Epoch>,
    current: Epoch,
    /// By topic and child frame; poses that move no frame are under an empty name.
    stamps: BTreeMap<Arc<str>, BTreeMap<String, Stamps>>,
    /// Number of positions and transforms when they were last shared.
    shared_len: usize,
}

impl Epochs {
    /// Those of a log that begins at `start`.
    pub(crate) fn new(start: Stamp) -> Self {
        Self { start, ..Self::default() }
    }

    /// Adds a canonical message with this log time on `topic`; log times ascend.
    pub(crate) fn add(&mut self, topic: &Arc<str>, log_time: Stamp, message: &AnyMessage, is_static: bool) {
        if !is_static {
            self.follow(topic, log_time, message);
        }
        self.current.tracks.add(topic, log_time, message, is_static);
    }

    /// Follows the stamps of a message, and begins another epoch if the clock begins again with it.
    fn follow(&mut self, topic: &Arc<str>, log_time: Stamp, message: &AnyMessage) {
        let Epoch { from, tracks, .. } = &self.current;
        let is_old = self.past.is_empty() || log_time >= from.after_ns(BEGINS_AGAIN_NS);
        let mut begins = None;
        for (frame, kind, stamp) in stamps_of(message) {
            // A name is copied only where it is new.
            let of_topic = match self.stamps.get_mut(topic) {
                Some(of_topic) => of_topic,
                None => self.stamps.entry(Arc::clone(topic)).or_default(),
            };
            let stamps = match of_topic.get_mut(frame) {
                Some(stamps) => stamps,
                None => of_topic.entry(frame.to_owned()).or_default(),
            };
            let stamp = stated(stamp, log_time);
            let is_of_epoch = stamps.last.is_some_and(|(last_time, _)| last_time >= *from);
            let Some(back_ns) = stamps.follow(log_time, stamp) else { continue };
            let moves = match kind {
                Kind::Transform => true,
                Kind::Odometry => !frame.is_empty() && !tracks.has_transform(frame),
                Kind::Pose => false,
            };
            let is_behind = |stamp: Stamp| stamp.after_ns(BEGINS_AGAIN_NS) < tracks.clock().at(log_time);
            let begins_again = is_old && moves && is_of_epoch && !stamps.is_mixed;
            if begins_again && begins.is_none() && stamp.is_some_and(is_behind) {
                begins = Some((frame, back_ns));
            }
        }
        if let Some((frame, back_ns)) = begins.filter(|_| self.past.len() + 1 < MOST_EPOCHS) {
            self.begin(topic, frame, log_time, back_ns);
        }
    }

    /// Begins an epoch, because the stamps of a frame went back at this log time.
    fn begin(&mut self, topic: &str, frame: &str, log_time: Stamp, back_ns: u64) {
        let earliest = log_time.before_ns(BEGINS_AGAIN_NS).max(self.current.from);
        let all = self.stamps.values().flat_map(BTreeMap::values).filter(|stamps| !stamps.is_mixed);
        let new_since = all.filter_map(|stamps| stamps.new_since).filter(|&since| since > earliest);
        let from = new_since.min().unwrap_or(log_time);
        let (back_s, at_s) = (back_ns as f64 * 1e-9, from.seconds_since(self.start));
        let doubt = match self.past.len() {
            MOST_TOLD => Some(format!(
                "the clock of the transforms goes back again at {at_s:.1} s, and later at times not listed"
            )),
            past if past < MOST_TOLD => Some(format!(
                "the clock of the transforms goes back by {back_s:.1} s at {at_s:.1} s ({frame} on {topic}): \
                 transforms and tracks before and after it are kept apart"
            )),
            past => (past + 2 == MOST_EPOCHS)
                .then(|| format!("transforms and tracks from {at_s:.1} s on are not kept apart any more")),
        };
        let tracks = self.current.tracks.begin_again(from, doubt);
        let begun = Epoch { from, tracks, ..Epoch::default() };
        self.past.push(std::mem::replace(&mut self.current, begun));
    }

    fn all(&self) -> impl DoubleEndedIterator<Item = &Epoch> {
        self.past.iter().chain(once(&self.current))
    }

    /// The epoch of a log time.
    fn at(&self, log_time: Stamp) -> &Epoch {
        self.all().rev().find(|epoch| epoch.from <= log_time).unwrap_or(&self.current)
    }

    /// Number of positions and transforms.
    fn len(&self) -> usize {
        self.all().map(|epoch| epoch.tracks.len()).sum()
    }

    /// Whether it is time to share the transforms again: there are half as many more, or those of another epoch.
    pub(crate) fn is_outgrown(&self) -> bool {
        let is_new = !self.current.is_shared && self.current.tracks.len() > 64;
        is_new || self.len() > self.shared_len + self.shared_len / 2 + 64
    }

    /// Shares the transforms up to now, which copies them.
    pub(crate) fn share(&mut self) {
        self.shared_len = self.len();
        let mut trees: Vec<TransformTree> = self.all().map(|epoch| epoch.tracks.tree()).collect();
        take_lasting(trees.iter_mut());
        take_lasting(trees.iter_mut().rev());
        for (epoch, tree) in self.past.iter_mut().chain(once(&mut self.current)).zip(trees) {
            epoch.tree = Arc::new(tree);
            epoch.clock = Arc::new(epoch.tracks.clock().clone());
            epoch.is_shared = true;
        }
    }

    /// The transforms by which a log time is shown, as far as they were shared.
    pub(crate) fn tree(&self, log_time: Stamp) -> &Arc<TransformTree> {
        &self.at(log_time).tree
    }

    /// The clock of [`Epochs::tree`].
    pub(crate) fn clock(&self, log_time: Stamp) -> &Arc<TransformClock> {
        &self.at(log_time).clock
    }

    /// The tracks of the epoch of a log time up to now, as those of a run.
    pub(crate) fn tracks(&self, run: RunTag, log_time: Stamp) -> impl Iterator<Item = Track> + '_ {
        self.at(log_time).tracks.read(run).filter(|track| !track.points.is_empty())
    }

    /// What is doubtful about the transforms, one line each; it only grows.
    pub(crate) fn doubts(&self) -> &[String] {
        self.current.tracks.doubts()
    }
}

/// Gives each tree, of frames that have no transform in it, the lasting transforms of the trees before it, up to a tree that
/// moves the frame.
fn take_lasting<'a>(trees: impl Iterator<Item = &'a mut TransformTree>) {
    let mut known = TransformTree::new();
    for tree in trees {
        tree.take_missing(&known);
        known = tree.lasting();
    }
}

/// What states the pose of a frame.
enum Kind {
    Transform,
    Odometry,
    /// It moves no frame.
    Pose,
}

/// The frames of a message with transforms or a pose, with their stamps.
fn stamps_of(message: &AnyMessage) -> impl Iterator<Item = (&str, Kind, Option<Stamp>)> {
    let list = message.get::<foxglove::FrameTransforms>().map(|list| list.transforms.as_slice());
    let transforms = list.or_else(|| message.get::<foxglove::FrameTransform>().map(std::slice::from_ref));
    let pose = if transforms.is_none() { pose_stamp_of(message) } else { None };
    transforms.unwrap_or_default().iter().map(stamp_of).chain(pose)
}

/// The frame that a message with a pose moves (empty if it moves none), with its stamp.
fn pose_stamp_of(message: &AnyMessage) -> Option<(&str, Kind, Option<Stamp>)> {
    let (frame, kind, stamp) = if let Some(odometry) = message.get::<foxglove::Odometry>() {
        (frame_name(&odometry.body_frame_id), Kind::Odometry, &odometry.timestamp)
    } else if let Some(pose) = message.get::<foxglove::PoseInFrame>() {
        ("", Kind::Pose, &pose.timestamp)
    } else {
        ("", Kind::Pose, &message.get::<foxglove::LocationFix>()?.timestamp)
    };
    Some((frame, kind, stamp.as_ref().and_then(Stamp::from_proto)))
}

fn stamp_of(transform: &foxglove::FrameTransform) -> (&str, Kind, Option<Stamp>) {
    let stamp = transform.timestamp.as_ref().and_then(Stamp::from_proto);
    (frame_name(&transform.child_frame_id), Kind::Transform, stamp)
}

/// The stamps of what one topic says of one frame.
#[derive(Default)]
struct Stamps {
    /// Log time and stamp of the last message that states a stamp.
    last: Option<(Stamp, Stamp)>,
    /// The newest stamp since they last went back.
    newest: Stamp,
    /// The newest stamp before they last went back.
    before: Option<Stamp>,
    /// Log time and stamp of the last message before they last leapt ahead, until they go back.
    leapt_from: Option<(Stamp, Stamp)>,
    /// Log time since which they are not those of before: when they last went back, or were first 0 before that.
    new_since: Option<Stamp>,
    /// Whether the last message states no stamp, after others that did.
    is_unstated: bool,
    /// Whether they are those of two clocks.
    is_mixed: bool,
}

impl Stamps {
    /// Follows a message. If its stamp goes back: by how much, ns.
    fn follow(&mut self, log_time: Stamp, stamp: Option<Stamp>) -> Option<u64> {
        let Some(stamp) = stamp else {
            if self.last.is_some() && !std::mem::replace(&mut self.is_unstated, true) {
                self.new_since = Some(log_time);
            }
            return None;
        };
        let was_unstated = std::mem::take(&mut self.is_unstated);
        let Some(last) = self.last.replace((log_time, stamp)) else {
            self.newest = stamp;
            return None;
        };
        let expected = |(time, stamp): (Stamp, Stamp)| stamp.after_ns(log_time.0.saturating_sub(time.0));
        if stamp > expected(last).after_ns(BEGINS_AGAIN_NS) {
            self.leapt_from = Some(last);
            self.is_mixed |= self.before.is_some_and(|before| stamp >= before);
        }
        if stamp.after_ns(BEGINS_AGAIN_NS) >= self.newest {
            self.newest = self.newest.max(stamp);
            return None;
        }
        let newest = std::mem::replace(&mut self.newest, stamp);
        let goes_on = |from| expected(from).0.abs_diff(stamp.0) <= BEGINS_AGAIN_NS;
        if self.leapt_from.take().is_some_and(goes_on) {
            // Those since the leap were wrong, or of another clock.
            return None;
        }
        self.before = Some(newest);
        if !was_unstated {
            self.new_since = Some(log_time);
        }
        Some(newest.0 - stamp.0)
    }
}

#[cfg(test)]
#[path = "epochs_tests.rs"]
mod tests;
