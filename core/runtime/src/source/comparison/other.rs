//! The viewed moment in the other recording, so that the maps of both sides can be shown.

use crate::source::entities::is_scene_type;
use crate::source::frame::{Frame, Runs, Topic};
use crate::source::log_view::LogView;
use rcs_log::{Log, MessagePosition};
use std::collections::BTreeMap;
use std::sync::Arc;

/// The other recording, once the thread that compares it has opened it.
#[derive(Default)]
pub(super) struct OtherView(Option<LogView>);

impl OtherView {
    /// Shows this recording from now on, or none.
    pub(super) fn set(&mut self, log: Option<Log>) {
        match log {
            None => self.0 = None,
            Some(log) => {
                self.0.get_or_insert_with(|| LogView::new(&log, &BTreeMap::new()));
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
        // Entities of a scene are not compared.
        let topics = view.topics.iter().filter(|topic| !is_scene_type(topic.type_name()));
        let topics: Arc<[Topic]> = topics.cloned().collect();
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
