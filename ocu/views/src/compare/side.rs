//! What can be compared: the runs of a stack, the recording, and another recording.

use rcs_msg::Stamp;
use rcs_runtime::source::{Compared, Comparison, Frame, RunTag, Topic};
use std::borrow::Cow;

/// Everything that can be one side.
pub(super) fn choices(frame: &Frame) -> Vec<Compared> {
    let recorded = frame.topics.iter().any(|topic| topic.run.is_recorded()).then_some(Compared::Recorded);
    let runs = frame.runs.all.iter().map(|run| Compared::Run(run.id));
    let other = frame.against.is_some().then_some(Compared::Other);
    recorded.into_iter().chain(runs).chain(other).collect()
}

/// What is compared until a person chooses: another recording if there is one, else a branch with the run that it left,
/// else the run with the recording that has the same buffers.
pub(super) fn usual(frame: &Frame) -> Option<[Compared; 2]> {
    let runs = &frame.runs.all;
    let viewed = runs.iter().find(|run| run.id == frame.runs.current());
    let this = viewed.map_or(Compared::Recorded, |run| Compared::Run(run.id));
    if frame.against.is_some() {
        return Some([this, Compared::Other]);
    }
    let viewed = viewed?;
    let parent = viewed.branched_from.map(|(from, _)| from.run);
    let child = || {
        let of_this =
            |run: &&rcs_runtime::RunSummary| run.branched_from.is_some_and(|(from, _)| from.run == viewed.id);
        runs.iter().rev().find(of_this).map(|run| run.id)
    };
    if let Some(parent) = parent {
        return Some([Compared::Run(parent), this]);
    }
    if let Some(child) = child() {
        return Some([this, Compared::Run(child)]);
    }
    let is_repeated = |topic: &Topic| {
        topic.run.is_recorded() && frame.topic_of(&topic.name, RunTag::Run(viewed.id)).is_some()
    };
    frame.topics.iter().any(is_repeated).then_some([Compared::Recorded, this])
}

/// Name of a side.
pub(super) fn name(frame: &Frame, side: Compared) -> String {
    match side {
        Compared::Recorded => "the recording".to_owned(),
        Compared::Run(run) => run.to_string(),
        Compared::Other => frame.against.as_deref().unwrap_or("another recording").to_owned(),
    }
}

/// The end of the side with this index.
fn end(frame: &Frame, comparison: &Comparison, index: usize) -> Option<Stamp> {
    match comparison.sides[index] {
        Compared::Run(run) => frame.runs.all.iter().find(|known| known.id == run).map(|known| known.end),
        Compared::Recorded | Compared::Other => comparison.recording_ends[index],
    }
}

/// The end of the side with this index, if it is known and was before a time. The viewed run has not ended: it can go on.
pub(super) fn ended(frame: &Frame, comparison: &Comparison, index: usize, before: Stamp) -> Option<Stamp> {
    let is_viewed = comparison.sides[index] == Compared::Run(frame.runs.current());
    end(frame, comparison, index).filter(|end| *end < before && !is_viewed)
}

/// Name and end of the side that ended before the other one went on.
pub(super) fn first_end(frame: &Frame, comparison: &Comparison) -> Option<(String, Stamp)> {
    let last = [0, 1].into_iter().filter_map(|index| end(frame, comparison, index)).max()?;
    [0, 1].into_iter().find_map(|index| {
        let end = ended(frame, comparison, index, last)?;
        Some((name(frame, comparison.sides[index]), end))
    })
}

/// The viewed moment on a side; `None` if it is not in the frame.
pub(super) fn frame(frame: &Frame, side: Compared) -> Option<Cow<'_, Frame>> {
    let (of_run, is_recorded) = match side {
        Compared::Other => return frame.other.as_deref().map(Cow::Borrowed),
        Compared::Recorded => (frame, true),
        Compared::Run(run) => (frame.of_run(Some(run))?, false),
    };
    let mixed = of_run.topics.iter().any(|topic| topic.run.is_recorded() != is_recorded);
    if !mixed {
        return Some(Cow::Borrowed(of_run));
    }
    let topics = of_run.topics.iter().filter(|topic| topic.run.is_recorded() == is_recorded);
    let tracks = of_run.tracks.iter().filter(|track| track.run.is_recorded() == is_recorded);
    let (topics, tracks) = (topics.cloned().collect(), tracks.cloned().collect());
    Some(Cow::Owned(Frame { topics, tracks, ..of_run.clone() }))
}
