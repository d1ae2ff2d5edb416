//! The viewed moment in the other recording, so that the maps of both sides can be shown.

use crate::source::frame::{Frame, Runs, Topic};
use crate::source::log_view::LogView;
use crate::source::tracks::{is_pose_type, is_transform_type};
use rcs_log::{Log, MessagePosition};
use std::sync::Arc;

/// Types of what is compared on a map, besides tracks.
const MAP_TYPES: [&str; 3] = ["foxglove.Grid", "foxglove.PosesInFrame", "rcs.Plan"];

fn is_map_type(name: &str) -> bool {
    MAP_TYPES.contains(&name) || is_pose_type(name) || is_transform_type(name)
}

/// The other recording, once the thread that compares it has opened it: maps, paths, poses and transforms, no others of its
/// topics.
#[derive(Default)]
pub(super) struct OtherView(Option<LogView>);

impl OtherView {
    /// Shows this recording from now on, or none.
    pub(super) fn set(&mut self, log: Option<Log>) {
        match log {
            None => self.0 = None,
            Some(log) => {
                self.0.get_or_insert_with(|| LogView::of_types(&log, is_map_type));
            }
        }
    }

    /// Reads its tracks and transforms for a few milliseconds; `true` if some are left.
    pub(super) fn idle(&mut self) -> bool {
        self.0.as_mut().is_some_and(LogView::idle)
    }

    /// The moment of `frame` in the recording: if that ended before, its end. `None` while it is not open, and where it
    /// cannot be read, which the comparing thread tells.
    pub(super) fn frame(&mut self, frame: &Frame) -> Option<Arc<Frame>> {
        let view = self.0.as_mut()?;
        let now = frame.now.min(view.log().info().end);
        view.go_to(MessagePosition::after(now)).ok()?;
        let topics: Arc<[Topic]> = view.topics.clone().into();
        topics.iter().for_each(Topic::convert_ahead);
        Some(Arc::new(Frame {
            now,
            topics,
            tracks: view.tracks(now).collect(),
            entities: Arc::new([]),
            transforms: Arc::clone(view.transforms(now)),
            transform_clock: Arc::clone(view.transform_clock(now)),
            runs: Runs::default(),
            is_beside: true,
            ..frame.clone()
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcs_msg::{AnyMessage, Stamp, foxglove, schema_of};

    #[test]
    fn of_the_other_recording_nothing_is_read_that_a_map_does_not_compare() {
        let (pose, scene) = (foxglove::PoseInFrame::default(), foxglove::SceneUpdate::default());
        let schemas = [
            ("/pose", schema_of::<foxglove::PoseInFrame>()),
            ("/scene", schema_of::<foxglove::SceneUpdate>()),
        ];
        let messages = [("/scene", AnyMessage::new(scene)), ("/pose", AnyMessage::new(pose))];
        let messages = || messages.iter().map(|(topic, message)| (Stamp(5), *topic, message));
        let both = rcs_testkit::logs::hand_made(&schemas, messages());
        let scene = rcs_testkit::logs::hand_made(&schemas[1..], messages().take(1));
        let mut other = OtherView::default();
        other.set(Some(scene));
        assert!(!other.idle(), "nothing is read in the background");
        other.set(None);
        other.set(Some(both));
        let frame = other.frame(&Frame::empty(Arc::default(), Stamp(5))).unwrap();
        let topics: Vec<_> =
            frame.topics.iter().map(|topic| (&*topic.name, topic.latest.is_some())).collect();
        assert_eq!(topics, [("/pose", true)]);
    }
}
