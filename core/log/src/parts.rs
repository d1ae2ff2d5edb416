//! The files of a log that is split, and the numbers that their channels have in the whole.

use crate::segment::{MessageRef, Segment};
use std::collections::BTreeMap;

/// The numbers that a part's channels have in the whole log.
#[derive(Debug)]
pub(crate) struct Part {
    /// Position of its first byte.
    pub(crate) start: u64,
    pub(crate) channels: BTreeMap<u16, u16>,
}

/// The parts of a log; none if it is one file.
#[derive(Debug, Default)]
pub(crate) struct Parts(Vec<Part>);

impl Parts {
    /// In the order of their positions.
    pub(crate) fn new(parts: Vec<Part>) -> Self {
        Self(parts)
    }

    /// The channels of the part of a segment; `None` if the log is one file.
    pub(crate) fn channels(&self, segment: &Segment) -> Option<&BTreeMap<u16, u16>> {
        let index = self.0.partition_point(|part| part.start <= segment.start).checked_sub(1)?;
        Some(&self.0[index].channels)
    }

    /// Gives messages of a segment the channels of the whole log; those of unknown channels are left out.
    pub(crate) fn map_channels(&self, segment: &Segment, messages: &mut Vec<MessageRef>) {
        let Some(channels) = self.channels(segment) else { return };
        messages.retain_mut(|message| {
            let channel = channels.get(&message.channel);
            message.channel = channel.copied().unwrap_or_default();
            channel.is_some()
        });
    }
}
