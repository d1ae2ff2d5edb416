//! What views tell each other: what is under the pointer, and which parameters are being edited.

use crate::keys::TopicKey;
use rcs_msg::{AnyMessage, Stamp};
use rcs_runtime::source::RunTag;
use std::sync::{Arc, Weak};

/// A position in a frame.
#[derive(Clone, Debug)]
pub struct HoverPoint {
    /// Coordinate frame of the position.
    pub frame_id: String,
    /// x, y, z, m; z is NaN where unknown.
    pub position_m: [f64; 3],
}

/// Unknown coordinates are equal: a pointer that rests asks for no repaint.
impl PartialEq for HoverPoint {
    fn eq(&self, other: &Self) -> bool {
        let bits = |point: &Self| point.position_m.map(f64::to_bits);
        self.frame_id == other.frame_id && bits(self) == bits(other)
    }
}

/// What is under the pointer, as one view says it; the other views mark what they show of it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Hover {
    /// The topic.
    pub topic: Option<TopicKey>,
    /// The process.
    pub process: Option<Arc<str>>,
    /// Path of a field of the topic.
    pub field: Option<Arc<str>>,
    /// Column and row of a cell of the topic.
    pub cell: Option<[usize; 2]>,
    /// Position in an image of the topic, pixels from its left upper corner.
    pub pixel: Option<[f64; 2]>,
    /// A position in space.
    pub point: Option<HoverPoint>,
    /// A time of the source.
    pub time: Option<Stamp>,
    /// The frame of a map with a mission that is being drawn and has a change to take back or to do again.
    pub mission: Option<Arc<str>>,
}

/// What is hovered, in two phases: all views read what was said in the last pass, and say what holds in this one. So
/// links work between all views, whichever is painted first.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Hovers {
    last: Hover,
    next: Hover,
}

impl Hovers {
    /// What was hovered in the last pass.
    pub fn get(&self) -> &Hover {
        &self.last
    }

    /// Says what is hovered now.
    pub fn set(&mut self, hover: Hover) {
        self.next = hover;
    }

    /// What has been said in this pass.
    pub fn said(&mut self) -> &mut Hover {
        &mut self.next
    }

    /// Ends a pass; returns whether views have to be painted again.
    pub fn turn(&mut self) -> bool {
        let changed = self.next != self.last;
        self.last = std::mem::take(&mut self.next);
        changed
    }
}

/// What became of the parameters of a preview.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PreviewStage {
    /// They are being edited, and were not sent.
    Edited,
    /// They were sent, and are not in force yet.
    OnItsWay,
    /// They are in force, and the newest map was made before.
    InForce,
}

/// Parameters that count in no map yet: they are being edited, or were sent after the newest map was made.
#[derive(Clone, Debug)]
pub struct Preview {
    /// The process to which they belong.
    pub process: Arc<str>,
    /// The run of its parameters; maps of other runs are not previewed.
    pub run: RunTag,
    /// The complete parameters.
    pub params: AnyMessage,
    /// The complete parameters with which the newest map was made.
    pub before: AnyMessage,
    /// What became of them.
    pub stage: PreviewStage,
}

impl PartialEq for Preview {
    fn eq(&self, other: &Self) -> bool {
        (&self.process, self.run, self.stage) == (&other.process, other.run, other.stage)
            && self.params.same(&other.params)
            && self.before.same(&other.before)
    }
}

/// A preview, and the view that stated it.
#[derive(Clone, Debug)]
struct Stated {
    preview: Preview,
    by: Weak<()>,
}

/// What is being edited, in two phases as [`Hovers`]. A preview stays while its view exists, also hidden, until the view
/// ends it or another one states its own. One that is on its way has to be stated in each pass: a hidden view does not
/// notice when it arrives or is lost.
#[derive(Clone, Debug, Default)]
pub struct Previews {
    last: Option<Stated>,
    next: Option<Stated>,
    is_ended: bool,
}

impl PartialEq for Previews {
    fn eq(&self, other: &Self) -> bool {
        self.get() == other.get()
    }
}

impl Previews {
    /// What was being edited in the last pass.
    pub fn get(&self) -> Option<&Preview> {
        self.last.as_ref().map(|stated| &stated.preview)
    }

    /// A view states what is edited in it. `by` belongs to the view alone, and is dropped with it.
    pub fn set(&mut self, by: &Arc<()>, preview: Preview) {
        self.next = Some(Stated { preview, by: Arc::downgrade(by) });
    }

    /// A view states that it edits nothing of a process, or nothing at all. The previews of other views stay.
    pub fn end(&mut self, by: &Arc<()>, process: Option<&str>) {
        let ends = |stated: &Stated| {
            let is_own = stated.by.ptr_eq(&Arc::downgrade(by));
            is_own && process.is_none_or(|process| *stated.preview.process == *process)
        };
        self.is_ended |= self.last.as_ref().is_some_and(ends);
    }

    /// Ends a pass; returns whether views have to be painted again.
    pub fn turn(&mut self) -> bool {
        let is_ended = std::mem::take(&mut self.is_ended);
        let last = self.last.take();
        let stays = |stated: &&Stated| {
            let is_on_its_way = stated.preview.stage == PreviewStage::OnItsWay;
            !is_ended && !is_on_its_way && stated.by.strong_count() > 0
        };
        self.last = self.next.take().or_else(|| last.as_ref().filter(stays).cloned());
        self.get() != last.as_ref().map(|stated| &stated.preview)
    }
}
