//! Transforms between the frames of a running stack, from its buffers, and from the recording on which it runs.

use super::tracks::{frame_name, is_transform_type, pose_stated, time_of, to_pose};
use super::transform_clock::BEGINS_AGAIN_NS;
use crate::conversion::canonical;
use rcs_bus::Sample;
use rcs_geom::{Pose, TransformError, TransformTree};
use rcs_msg::{AnyMessage, Stamp, foxglove};
use std::collections::BTreeSet;
use std::sync::Arc;

/// What is drawn was acquired in the last seconds, so older poses are not needed.
const HISTORY_NS: u64 = 10_000_000_000;
/// After a jump, poses of this time before are used if they are in memory.
pub(crate) const POSES_NS: u64 = 1_000_000_000;

/// Transforms up to the viewed moment.
pub(crate) struct RunTransforms {
    tree: TransformTree,
    /// Frames that have a transform message; odometry of these frames is ignored.
    told: BTreeSet<String>,
    shared: Option<Arc<TransformTree>>,
    joined: Option<Joined>,
    /// The transforms of the message taken last that were refused.
    refused: Vec<Refusal>,
}

/// A transform that was refused.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Refusal {
    pub(crate) parent: String,
    pub(crate) child: String,
    pub(crate) why: String,
}

/// The transforms of a run with those of its recording.
struct Joined {
    own: Arc<TransformTree>,
    recorded: Arc<TransformTree>,
    both: Arc<TransformTree>,
}

impl Default for RunTransforms {
    fn default() -> Self {
        let tree = TransformTree::with_history_ns(HISTORY_NS);
        Self { tree, told: BTreeSet::new(), shared: None, joined: None, refused: Vec::new() }
    }
}

impl RunTransforms {
    /// Whether messages of this type can give the pose of a frame.
    pub(crate) fn takes(type_name: &str) -> bool {
        is_transform_type(type_name) || type_name == "foxglove.Odometry"
    }

    /// Adds messages of buffers, in the order of time. `placing` are the buffers that give poses of frames, and whether
    /// these are static. Returns the transforms that were refused, and their buffers.
    pub(crate) fn take_all(
        &mut self,
        mut samples: Vec<(usize, Sample)>,
        placing: &[(usize, bool)],
    ) -> Vec<(usize, Refusal)> {
        let mut refused = Vec::new();
        samples.sort_by_key(|(_, sample)| sample.header.log_time);
        for (buffer, sample) in samples {
            let is_static = placing.iter().any(|&(other, is_static)| other == buffer && is_static);
            if let Some(message) = canonical(&sample.message) {
                self.take(sample.header.log_time, &message, is_static);
                refused.extend(self.refused.drain(..).map(|refusal| (buffer, refusal)));
            }
        }
        refused
    }

    /// Adds the frames that have no transform here as they were in `older`, which is of the same run.
    pub(crate) fn take_missing(&mut self, older: &Self) {
        self.shared = None;
        let missing = older.told.iter().filter(|frame| self.tree.parent(frame).is_none());
        self.told.extend(missing.cloned());
        self.tree.take_missing(&older.tree);
    }

    /// Adds a canonical message with this log time; `is_static` applies to transform messages only.
    pub(crate) fn take(&mut self, log_time: Stamp, message: &AnyMessage, is_static: bool) {
        self.shared = None;
        if let Some(list) = message.get::<foxglove::FrameTransforms>() {
            list.transforms.iter().for_each(|transform| self.told(transform, log_time, is_static));
        } else if let Some(transform) = message.get::<foxglove::FrameTransform>() {
            self.told(transform, log_time, is_static);
        } else if let Some(odometry) = message.get::<foxglove::Odometry>() {
            let (parent, child) = (frame_name(&odometry.frame_id), frame_name(&odometry.body_frame_id));
            let Some(pose) = odometry.pose.as_ref().and_then(to_pose) else { return };
            if !parent.is_empty() && !child.is_empty() && !self.told.contains(child) {
                let time = time_of(odometry.timestamp.as_ref().and_then(Stamp::from_proto), log_time);
                // Two estimates of one vehicle: the first one gives its pose, the other is a track only.
                let _ = self.insert(parent, child, time, pose);
            }
        }
    }

    fn told(&mut self, transform: &foxglove::FrameTransform, log_time: Stamp, is_static: bool) {
        let parent = frame_name(&transform.parent_frame_id);
        let child = frame_name(&transform.child_frame_id);
        let placed = pose_stated(transform).and_then(|pose| {
            let placed = if is_static {
                self.tree.set_static(parent, child, pose)
            } else {
                let time = time_of(transform.timestamp.as_ref().and_then(Stamp::from_proto), log_time);
                self.insert(parent, child, time, pose)
            };
            placed.map_err(|error| error.to_string())
        });
        match placed {
            // The pose of the frame does not change.
            Err(why) => {
                self.refused.push(Refusal { parent: parent.to_owned(), child: child.to_owned(), why });
            }
            Ok(()) if !self.told.contains(child) => {
                self.told.insert(child.to_owned());
            }
            Ok(()) => {}
        }
    }

    /// Adds a sample. Samples of the frame that are much later are forgotten, because its clock has begun again: by them,
    /// all that come from now on would be too old to keep.
    fn insert(&mut self, parent: &str, child: &str, time: Stamp, pose: Pose) -> Result<(), TransformError> {
        self.tree.insert_as_of(parent, child, time.0, pose, time.after_ns(BEGINS_AGAIN_NS).0)
    }

    /// Starts again, because the run went back.
    pub(crate) fn clear(&mut self) {
        *self = Self::default();
    }

    /// The current transforms.
    pub(crate) fn share(&mut self) -> Arc<TransformTree> {
        Arc::clone(self.shared.get_or_insert_with(|| Arc::new(self.tree.clone())))
    }

    /// The current transforms with those of the recording on which the stack runs ([`join`]). They are joined again only
    /// when one of them has changed.
    pub(crate) fn share_with(&mut self, recorded: &Arc<TransformTree>) -> Arc<TransformTree> {
        let own = self.share();
        if let Some(joined) = &self.joined
            && Arc::ptr_eq(&joined.own, &own)
            && Arc::ptr_eq(&joined.recorded, recorded)
        {
            return Arc::clone(&joined.both);
        }
        let both = if own.is_empty() { Arc::clone(recorded) } else { Arc::new(join(&own, recorded)) };
        self.joined = Some(Joined { own, recorded: Arc::clone(recorded), both: Arc::clone(&both) });
        both
    }
}

/// The transforms of a run, and those of its recording.
///
/// Where both give the pose of a frame in the same parent, that of the run counts, also for recorded topics: the maps that
/// were computed by it, and the recorded sensors from which they were computed, lie on each other. Recorded transforms are
/// used for all other frames.
///
/// Where the two give different parents, and no other transform connects these, both are needed: the run says where the
/// vehicle is in its own map, the recording where it is in the recorded one. A frame has one parent, so the transforms of
/// the run above that frame are inverted.
fn join(own: &TransformTree, recorded: &TransformTree) -> TransformTree {
    let mut both = own.clone();
    both.take_missing(recorded);
    let is_apart = |frame: &str| {
        let parent = recorded.parent(frame);
        parent.is_some_and(|parent| both.newest(parent, frame).is_err())
    };
    let depth = |frame: &str| std::iter::successors(own.parent(frame), |&above| own.parent(above)).count();
    let apart = own.frames().into_iter().filter(|&frame| is_apart(frame)).min_by_key(|&frame| depth(frame));
    if let Some(frame) = apart {
        both = own.clone();
        both.make_root(frame);
        both.take_missing(recorded);
    }
    both
}

#[cfg(test)]
mod tests {
    use super::*;
    use foxglove::{FrameTransform, FrameTransforms, Odometry, Pose, Quaternion, Vector3};
    use rcs_bus::{Header, WriterId};

    const UPRIGHT: Quaternion = Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 };

    fn at(x: f64) -> Vector3 {
        Vector3 { x, y: 0.0, z: 0.0 }
    }

    fn odometry(parent: &str, child: &str, ns: u64, x: f64) -> AnyMessage {
        AnyMessage::new(Odometry {
            timestamp: Some(Stamp(ns).to_proto()),
            frame_id: parent.into(),
            body_frame_id: child.into(),
            pose: Some(Pose { position: Some(at(x)), orientation: Some(UPRIGHT) }),
            ..Odometry::default()
        })
    }

    fn transform(parent: &str, child: &str, ns: u64, x: f64) -> AnyMessage {
        let transform = FrameTransform {
            timestamp: Some(Stamp(ns).to_proto()),
            parent_frame_id: parent.into(),
            child_frame_id: child.into(),
            translation: Some(at(x)),
            rotation: Some(UPRIGHT),
        };
        AnyMessage::new(FrameTransforms { transforms: vec![transform] })
    }

    #[test]
    fn transforms_and_odometry_make_one_tree_in_which_static_ones_hold_at_all_times() {
        let mut run = RunTransforms::default();
        run.take(Stamp(0), &odometry("local", "vehicle", 0, 1.0), false);
        run.take(Stamp(0), &odometry("global", "vehicle", 0, 7.0), false);
        run.take(Stamp(100), &odometry("local", "vehicle", 100, 3.0), false);
        run.take(Stamp(0), &transform("vehicle", "camera", 0, 0.5), true);
        run.take(Stamp(0), &transform("global", "local", 0, 10.0), false);
        run.take(Stamp(100), &transform("global", "local", 100, 20.0), false);
        let tree = run.share();
        assert_eq!(tree.lookup("local", "camera", 50).unwrap().translation.x, 2.5);
        assert_eq!(tree.lookup("global", "vehicle", 50).unwrap().translation.x, 17.0);
        assert!(Arc::ptr_eq(&tree, &run.share()), "nothing is copied while nothing changes");
    }

    fn x(tree: &TransformTree, target: &str, source: &str, ns: u64) -> f64 {
        tree.lookup_nearest(target, source, ns).unwrap().translation.x
    }

    fn at_x(x: f64) -> rcs_geom::Pose {
        rcs_geom::Pose::from_xy_yaw(x, 0.0, 0.0)
    }

    #[test]
    fn the_recording_places_the_frames_that_the_run_does_not() {
        let mut run = RunTransforms::default();
        let mut recorded = TransformTree::new();
        recorded.set_static("vehicle", "lidar", at_x(0.5)).unwrap();
        recorded.insert("local", "vehicle", 100, at_x(50.0)).unwrap();
        let recorded = Arc::new(recorded);
        assert!(Arc::ptr_eq(&run.share_with(&recorded), &recorded), "the run has not said anything");
        run.take(Stamp(100), &odometry("local", "vehicle", 100, 3.0), false);
        run.take(Stamp(100), &transform("global", "local", 100, 20.0), false);
        let both = run.share_with(&recorded);
        assert_eq!([x(&both, "local", "lidar", 100), x(&both, "global", "lidar", 100)], [3.5, 23.5]);
        assert!(
            Arc::ptr_eq(&both, &run.share_with(&recorded)),
            "nothing is joined again while nothing changes"
        );
        run.take(Stamp(200), &odometry("local", "vehicle", 200, 4.0), false);
        assert_eq!(x(&run.share_with(&recorded), "local", "lidar", 200), 4.5);
    }

    #[test]
    fn a_vehicle_in_a_recorded_and_in_a_computed_frame_connects_both() {
        let mut run = RunTransforms::default();
        run.take(Stamp(100), &odometry("local", "vehicle", 100, 3.0), false);
        run.take(Stamp(100), &transform("global", "local", 100, 20.0), false);
        let mut recorded = TransformTree::new();
        recorded.insert("map", "odom", 100, at_x(100.0)).unwrap();
        recorded.insert("odom", "vehicle", 100, at_x(10.0)).unwrap();
        recorded.set_static("vehicle", "lidar", at_x(0.5)).unwrap();
        let both = run.share_with(&Arc::new(recorded));
        let of = |target| x(&both, target, "lidar", 100);
        assert_eq!(["local", "global", "odom", "map"].map(of), [3.5, 23.5, 10.5, 110.5]);
        assert_eq!(x(&both, "odom", "local", 100), 7.0);
    }

    #[test]
    fn a_frame_whose_clock_begins_again_moves_on_and_a_late_transform_forgets_nothing() {
        const S: u64 = 1_000_000_000;
        let mut run = RunTransforms::default();
        let mut newest = |log_s: u64, stamp_s: u64| {
            let message = transform("local", "vehicle", stamp_s * S, log_s as f64);
            run.take(Stamp(log_s * S), &message, false);
            run.share().newest("local", "vehicle").unwrap()
        };
        assert_eq!([newest(100, 60), newest(101, 57), newest(102, 0)], [60, 60, 102].map(|s| Some(s * S)));
        assert_eq!([newest(103, 1), newest(104, 2)], [1, 2].map(|s| Some(s * S)));
        assert_eq!(x(&run.share(), "local", "vehicle", 2 * S), 104.0);
    }

    #[test]
    fn a_transform_that_is_refused_is_handed_back_with_its_buffer_and_the_reason() {
        let sample = |ns: u64, message: AnyMessage| {
            let at = Stamp(ns);
            let header = Header { sequence: 1, log_time: at, acq_time: at, writer: WriterId::RUNTIME };
            Sample { header, message }
        };
        let unset = FrameTransform {
            parent_frame_id: "vehicle".into(),
            child_frame_id: "lidar".into(),
            translation: Some(at(1.0)),
            ..FrameTransform::default()
        };
        let samples = vec![
            (3, sample(1, transform("local", "vehicle", 1, 1.0))),
            (5, sample(2, transform("map", "vehicle", 2, 1.0))),
            (5, sample(3, transform("vehicle", "local", 3, 1.0))),
            (3, sample(4, AnyMessage::new(unset))),
            (4, sample(5, odometry("global", "vehicle", 5, 1.0))),
        ];
        let mut run = RunTransforms::default();
        let refused = run.take_all(samples, &[(3, false), (4, false), (5, false)]);
        let told: Vec<(usize, &str)> =
            refused.iter().map(|(buffer, refusal)| (*buffer, refusal.why.as_str())).collect();
        let expected = [
            (5, "frame \"vehicle\" already has parent \"local\", got \"map\""),
            (5, "frame \"local\" cannot hang under \"vehicle\", which hangs under it"),
            (3, "transform from \"lidar\" to \"vehicle\" lacks translation or rotation"),
        ];
        assert_eq!(told, expected, "a second odometry of a frame is a track only");
        assert_eq!((refused[0].1.parent.as_str(), refused[0].1.child.as_str()), ("map", "vehicle"));
        assert_eq!(run.share().parent("vehicle"), Some("local"));
    }

    #[test]
    fn after_going_back_nothing_of_the_future_is_left() {
        let mut run = RunTransforms::default();
        run.take(Stamp(100), &odometry("local", "vehicle", 100, 3.0), false);
        run.clear();
        run.take(Stamp(50), &odometry("local", "vehicle", 50, 1.0), false);
        assert_eq!(run.share().newest("local", "vehicle").unwrap(), Some(50));
    }
}
