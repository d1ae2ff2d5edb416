//! Named frames and their poses relative to each other over time.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::Pose;

/// Why a transform is not known or was refused. Times are nanoseconds.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TransformError {
    /// No transform mentions this frame.
    #[error("frame \"{frame}\" is unknown")]
    UnknownFrame {
        /// Name of the frame.
        frame: String,
    },
    /// The two frames have different roots.
    #[error(
        "frames \"{target}\" and \"{source_frame}\" are not connected: roots are \"{target_root}\" and \"{source_root}\""
    )]
    NotConnected {
        /// The target frame.
        target: String,
        /// The source frame.
        source_frame: String,
        /// Root of the target.
        target_root: String,
        /// Root of the source.
        source_root: String,
    },
    /// The transform above a frame has samples, but none on both sides of this time. Nothing is extrapolated.
    #[error(
        "no transform from \"{frame}\" to \"{parent}\" at {time_ns} ns: data reach from {first_ns} to {last_ns} ns"
    )]
    OutsideData {
        /// Child frame of the edge.
        frame: String,
        /// Parent frame of the edge.
        parent: String,
        /// The requested time.
        time_ns: u64,
        /// Time of the oldest sample.
        first_ns: u64,
        /// Time of the newest sample.
        last_ns: u64,
    },
    /// The frame already has another parent.
    #[error("frame \"{frame}\" already has parent \"{parent}\", got \"{offered}\"")]
    TwoParents {
        /// Child frame.
        frame: String,
        /// Its parent.
        parent: String,
        /// The parent that was refused.
        offered: String,
    },
    /// The parent is a descendant of the child.
    #[error("frame \"{frame}\" cannot hang under \"{parent}\", which hangs under it")]
    Cycle {
        /// Child frame.
        frame: String,
        /// Parent frame.
        parent: String,
    },
    /// A number of the pose is NaN or infinite.
    #[error("transform from \"{frame}\" to \"{parent}\" is not finite")]
    NotFinite {
        /// Child frame.
        frame: String,
        /// Parent frame.
        parent: String,
    },
}

#[derive(Clone, Debug, Serialize, Deserialize)]
enum Edge {
    /// Valid at all times.
    Static(Pose),
    /// Sorted by time, times distinct, never empty. Copy on write, so that a snapshot is cheap.
    Timed(Arc<VecDeque<(u64, Pose)>>),
}

#[derive(Clone, Debug, Serialize, Deserialize)]
struct Link {
    parent: String,
    edge: Edge,
}

/// A forest of named frames. Each frame except a root has one parent and a transform to it, which is either static
/// (valid at all times) or a series of samples. It interpolates between samples and never extrapolates.
///
/// ```
/// use rcs_geom::{DVec3, Pose, TransformTree};
/// let mut tree = TransformTree::new();
/// tree.set_static("vehicle", "camera", Pose::from_translation(DVec3::Z))?;
/// tree.insert("local", "vehicle", 0, Pose::IDENTITY)?;
/// tree.insert("local", "vehicle", 100, Pose::from_translation(DVec3::X))?;
/// let local_from_camera = tree.lookup("local", "camera", 50)?;
/// assert_eq!(local_from_camera.translation, DVec3::new(0.5, 0.0, 1.0));
/// # Ok::<(), rcs_geom::TransformError>(())
/// ```
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct TransformTree {
    /// By child frame.
    links: BTreeMap<String, Link>,
    /// How long samples are kept, counted back from the newest of the same transform; `None` keeps all.
    history_ns: Option<u64>,
    /// By child frame: the last samples, if they were older than the newest by more than the history, each later than the
    /// one before.
    late: BTreeMap<String, Vec<(u64, Pose)>>,
}

/// As many late samples in a row, each later than the one before, are of a clock that has begun again.
const LATE_IN_A_ROW: usize = 3;

impl TransformTree {
    /// Keeps all samples.
    pub fn new() -> TransformTree {
        TransformTree::default()
    }

    /// Keeps the samples of the last `history_ns` of each transform (and the one before, to interpolate from).
    pub fn with_history_ns(history_ns: u64) -> TransformTree {
        TransformTree { history_ns: Some(history_ns), ..TransformTree::default() }
    }

    /// Sets the pose of `child` in `parent` for all times; replaces earlier values of that pair.
    pub fn set_static(
        &mut self,
        parent: &str,
        child: &str,
        parent_from_child: Pose,
    ) -> Result<(), TransformError> {
        self.check_edge(parent, child, &parent_from_child)?;
        let link = Link { parent: parent.to_owned(), edge: Edge::Static(parent_from_child) };
        self.links.insert(child.to_owned(), link);
        Ok(())
    }

    /// Adds a sample of the pose of `child` in `parent`. Samples may arrive in any order; a second sample of the same
    /// time replaces the first. A static transform becomes timed.
    pub fn insert(
        &mut self,
        parent: &str,
        child: &str,
        time_ns: u64,
        parent_from_child: Pose,
    ) -> Result<(), TransformError> {
        self.insert_as_of(parent, child, time_ns, parent_from_child, u64::MAX)
    }

    /// As [`TransformTree::insert`], for a sample that arrives at `now_ns`. If it is not from the future, the samples of the
    /// same transform that are later than `now_ns` are forgotten: a clock was wrong. By them, what arrives until that time
    /// would be too old to keep, and none of it too old to use.
    ///
    /// A sample that is older than the newest by more than the history that is kept is late. Three in a row, each later than
    /// the one before, replace all others: the clock has begun again.
    pub fn insert_as_of(
        &mut self,
        parent: &str,
        child: &str,
        time_ns: u64,
        parent_from_child: Pose,
        now_ns: u64,
    ) -> Result<(), TransformError> {
        self.check_edge(parent, child, &parent_from_child)?;
        let history_ns = self.history_ns;
        if let Some(Link { edge: Edge::Timed(samples), .. }) = self.links.get_mut(child) {
            let samples = Arc::make_mut(samples);
            while time_ns <= now_ns && samples.back().is_some_and(|&(t, _)| t > now_ns) {
                samples.pop_back();
            }
            let newest_ns = samples.back().map_or(0, |&(t, _)| t);
            let is_late = history_ns.is_some_and(|history_ns| time_ns.saturating_add(history_ns) < newest_ns);
            let mut late = self.late.remove(child).unwrap_or_default();
            if is_late {
                if late.last().is_some_and(|&(t, _)| t >= time_ns) {
                    late.clear();
                }
                late.push((time_ns, parent_from_child));
                if late.len() < LATE_IN_A_ROW {
                    self.late.insert(child.to_owned(), late);
                } else {
                    *samples = VecDeque::from(late);
                }
            }
            let at = samples.partition_point(|&(t, _)| t < time_ns);
            match samples.get_mut(at) {
                Some(sample) if sample.0 == time_ns => sample.1 = parent_from_child,
                _ => samples.insert(at, (time_ns, parent_from_child)),
            }
            if let (Some(history_ns), Some(&(newest, _))) = (history_ns, samples.back()) {
                let oldest_kept = newest.saturating_sub(history_ns);
                while samples.get(1).is_some_and(|&(t, _)| t <= oldest_kept) {
                    samples.pop_front();
                }
            }
        } else {
            let edge = Edge::Timed(Arc::new(VecDeque::from([(time_ns, parent_from_child)])));
            self.links.insert(child.to_owned(), Link { parent: parent.to_owned(), edge });
        }
        Ok(())
    }

    /// Takes the transforms of frames that have none here from another tree, but for those that would close a loop. Their
    /// samples are shared.
    pub fn take_missing(&mut self, other: &TransformTree) {
        for (child, link) in &other.links {
            let is_missing = !self.links.contains_key(child);
            if is_missing && self.check_edge(&link.parent, child, &Pose::IDENTITY).is_ok() {
                self.links.insert(child.clone(), link.clone());
            }
        }
    }

    /// The transforms that hold at all times, as static ones: those that are static, and those that were sent once.
    #[must_use]
    pub fn lasting(&self) -> TransformTree {
        let lasting = self.links.iter().filter_map(|(child, link)| {
            let pose = match &link.edge {
                Edge::Static(pose) => *pose,
                Edge::Timed(samples) if samples.len() == 1 => samples.front()?.1,
                Edge::Timed(_) => return None,
            };
            Some((child.clone(), Link { parent: link.parent.clone(), edge: Edge::Static(pose) }))
        });
        TransformTree { links: lasting.collect(), ..TransformTree::default() }
    }

    /// Inverts the transforms above a frame, so that it becomes the root of its tree. Poses at the times of samples stay
    /// the same; between two samples they differ slightly, because the inverse transforms are interpolated. The cost is
    /// one copy of all samples of these transforms.
    pub fn make_root(&mut self, frame: &str) {
        let mut child = frame.to_owned();
        let mut above = self.links.remove(frame);
        while let Some(Link { parent, edge }) = above {
            above = self.links.remove(&parent);
            let inverse = Link { parent: child, edge: edge.inverse() };
            self.links.insert(parent.clone(), inverse);
            child = parent;
        }
    }

    /// `target_from_source` at a time: takes points of `source` into `target`.
    pub fn lookup(&self, target: &str, source: &str, time_ns: u64) -> Result<Pose, TransformError> {
        self.compose(target, source, |frame, link| link.at(frame, time_ns))
    }

    /// The newest time for which [`TransformTree::lookup`] of these frames succeeds; `None` if the path between them is
    /// static and every time succeeds.
    pub fn newest(&self, target: &str, source: &str) -> Result<Option<u64>, TransformError> {
        let (target_chain, source_chain) = self.chains(target, source)?;
        let newest = |(_, link): &(&str, &Link)| link.span().map(|(_, last)| last);
        Ok(target_chain.iter().chain(&source_chain).filter_map(newest).min())
    }

    /// As [`TransformTree::newest`], of the samples that are not later than `time_ns` alone: what was known at that time. The
    /// error says if a transform on the path has no such sample.
    pub fn newest_until(
        &self,
        target: &str,
        source: &str,
        time_ns: u64,
    ) -> Result<Option<u64>, TransformError> {
        let (target_chain, source_chain) = self.chains(target, source)?;
        let mut newest: Option<u64> = None;
        for (frame, link) in target_chain.iter().chain(&source_chain) {
            if let Some(last) = link.last_until(frame, time_ns)? {
                newest = Some(newest.map_or(last, |newest| newest.min(last)));
            }
        }
        Ok(newest)
    }

    /// As [`TransformTree::lookup`]; each transform on the path that has no data at that time counts with its oldest or
    /// newest sample, whichever is nearer. So a transform that is rarely sent does not hold back the others. It fails only
    /// if the frames are not connected; [`TransformTree::newest`] tells how old the path is.
    pub fn lookup_nearest(&self, target: &str, source: &str, time_ns: u64) -> Result<Pose, TransformError> {
        self.compose(target, source, |frame, link| {
            let time_ns = link.span().map_or(time_ns, |(first, last)| time_ns.clamp(first, last));
            link.at(frame, time_ns)
        })
    }

    /// Whether it has no transform.
    pub fn is_empty(&self) -> bool {
        self.links.is_empty()
    }

    /// Names of all frames, sorted.
    pub fn frames(&self) -> Vec<&str> {
        let mut frames: Vec<&str> =
            self.links.iter().flat_map(|(child, link)| [child.as_str(), link.parent.as_str()]).collect();
        frames.sort_unstable();
        frames.dedup();
        frames
    }

    /// The parent of a frame, or `None` for a root or an unknown frame.
    pub fn parent(&self, frame: &str) -> Option<&str> {
        self.links.get(frame).map(|link| link.parent.as_str())
    }

    /// Whether any transform names this frame.
    pub fn contains(&self, frame: &str) -> bool {
        self.links.contains_key(frame) || self.links.values().any(|link| link.parent == frame)
    }

    /// `target_from_source` by what `parent_from` says of each transform on the path.
    fn compose(
        &self,
        target: &str,
        source: &str,
        parent_from: impl Fn(&str, &Link) -> Result<Pose, TransformError>,
    ) -> Result<Pose, TransformError> {
        let (target_chain, source_chain) = self.chains(target, source)?;
        let ancestor_from = |chain: &[(&str, &Link)]| -> Result<Pose, TransformError> {
            chain.iter().try_fold(Pose::IDENTITY, |frame_from_start, &(frame, link)| {
                Ok(parent_from(frame, link)? * frame_from_start)
            })
        };
        let ancestor_from_target = ancestor_from(&target_chain)?;
        let ancestor_from_source = ancestor_from(&source_chain)?;
        Ok(ancestor_from_target.inverse() * ancestor_from_source)
    }

    /// The transforms from each of the two frames up to their nearest common ancestor.
    #[allow(clippy::type_complexity, reason = "two chains of named edges, used only here")]
    fn chains<'a>(
        &'a self,
        target: &'a str,
        source: &'a str,
    ) -> Result<(Vec<(&'a str, &'a Link)>, Vec<(&'a str, &'a Link)>), TransformError> {
        for frame in [target, source] {
            if !self.contains(frame) {
                return Err(TransformError::UnknownFrame { frame: frame.to_owned() });
            }
        }
        let mut target_chain = self.chain(target);
        let mut source_chain = self.chain(source);
        let root = |start: &str, chain: &[(&str, &Link)]| {
            chain.last().map_or_else(|| start.to_owned(), |(_, link)| link.parent.clone())
        };
        let (target_root, source_root) = (root(target, &target_chain), root(source, &source_chain));
        if target_root != source_root {
            return Err(TransformError::NotConnected {
                target: target.to_owned(),
                source_frame: source.to_owned(),
                target_root,
                source_root,
            });
        }
        // Transforms above the common ancestor cancel out, and need no data at the requested time.
        while let (Some(a), Some(b)) = (target_chain.last(), source_chain.last())
            && a.0 == b.0
        {
            target_chain.pop();
            source_chain.pop();
        }
        Ok((target_chain, source_chain))
    }

    /// Transforms from a frame up to its root.
    fn chain<'a>(&'a self, start: &'a str) -> Vec<(&'a str, &'a Link)> {
        let mut chain = Vec::new();
        let mut frame = start;
        while let Some(link) = self.links.get(frame) {
            chain.push((frame, link));
            frame = &link.parent;
        }
        chain
    }

    fn check_edge(&self, parent: &str, child: &str, pose: &Pose) -> Result<(), TransformError> {
        let frame = || child.to_owned();
        if !pose.is_finite() {
            return Err(TransformError::NotFinite { frame: frame(), parent: parent.to_owned() });
        }
        match self.links.get(child) {
            Some(link) if link.parent == parent => Ok(()),
            Some(link) => Err(TransformError::TwoParents {
                frame: frame(),
                parent: link.parent.clone(),
                offered: parent.to_owned(),
            }),
            None if parent == child || self.chain(parent).iter().any(|(_, link)| link.parent == child) => {
                Err(TransformError::Cycle { frame: frame(), parent: parent.to_owned() })
            }
            None => Ok(()),
        }
    }
}

impl Edge {
    /// The transform in the other direction.
    fn inverse(&self) -> Edge {
        match self {
            Edge::Static(pose) => Edge::Static(pose.inverse()),
            Edge::Timed(samples) => {
                let inverse = samples.iter().map(|&(time_ns, pose)| (time_ns, pose.inverse()));
                Edge::Timed(Arc::new(inverse.collect()))
            }
        }
    }
}

impl Link {
    /// Times of the oldest and newest sample; `None` for a static transform.
    fn span(&self) -> Option<(u64, u64)> {
        match &self.edge {
            Edge::Static(_) => None,
            Edge::Timed(samples) => Some((samples.front()?.0, samples.back()?.0)),
        }
    }

    /// Time of the newest sample that is not later than `time_ns`; `None` for a static transform.
    fn last_until(&self, frame: &str, time_ns: u64) -> Result<Option<u64>, TransformError> {
        let Edge::Timed(samples) = &self.edge else { return Ok(None) };
        let count = samples.partition_point(|&(t, _)| t <= time_ns);
        let last = count.checked_sub(1).and_then(|last| samples.get(last));
        last.map(|&(t, _)| Some(t)).ok_or_else(|| self.outside(frame, time_ns))
    }

    /// The error that there are no data at a time.
    fn outside(&self, frame: &str, time_ns: u64) -> TransformError {
        let (first_ns, last_ns) = self.span().unwrap_or_default();
        let (frame, parent) = (frame.to_owned(), self.parent.clone());
        TransformError::OutsideData { frame, parent, time_ns, first_ns, last_ns }
    }

    /// `parent_from_frame` at a time.
    fn at(&self, frame: &str, time_ns: u64) -> Result<Pose, TransformError> {
        let samples = match &self.edge {
            Edge::Static(pose) => return Ok(*pose),
            Edge::Timed(samples) => samples,
        };
        let after = samples.partition_point(|&(t, _)| t < time_ns);
        let sample = |i: usize| samples.get(i).copied();
        match (after.checked_sub(1).and_then(sample), sample(after)) {
            (_, Some((t, pose))) if t == time_ns => Ok(pose),
            (Some((t0, before)), Some((t1, after))) => {
                Ok(before.interpolate(&after, (time_ns - t0) as f64 / (t1 - t0) as f64))
            }
            _ => Err(self.outside(frame, time_ns)),
        }
    }
}

#[cfg(test)]
#[path = "transform_tree_tests.rs"]
mod tests;
