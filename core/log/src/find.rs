//! Looks up single messages by time: the latest of each topic, the previous one, the next one; and how much is read from
//! one to another.

use crate::cursor::CursorOptions;
use crate::error::LogError;
use crate::info::{LogMessage, MessagePosition, TopicId};
use crate::log::{Log, message_at, place_of};
use crate::segment::Segment;
use rcs_msg::Stamp;
use std::collections::BTreeMap;

/// Contents of segments, bytes: running sums by the times of their first and of their last messages, ascending.
pub(crate) struct Contents {
    by_first: Vec<(u64, u128)>,
    by_last: Vec<(u64, u128)>,
}

impl Contents {
    /// What a cursor reads from one position to a later one: the contents of the segments with messages in between.
    pub(crate) fn between(&self, from: MessagePosition, to: MessagePosition) -> u64 {
        let sum = |sums: &[(u64, u128)], count: usize| count.checked_sub(1).map_or(0, |last| sums[last].1);
        let begun = self.by_first.partition_point(|&(first, _)| first <= to.time.0);
        let ended = self.by_last.partition_point(|&(last, _)| last < from.time.0);
        let bytes = sum(&self.by_first, begun).saturating_sub(sum(&self.by_last, ended));
        u64::try_from(bytes).unwrap_or(u64::MAX)
    }
}

impl Log {
    /// The last message at or before `time` of each of `topics`, in their order; `None` for all topics of
    /// [`LogInfo::topics`](crate::LogInfo::topics).
    pub fn latest_at(
        &self,
        time: Stamp,
        topics: Option<&[TopicId]>,
    ) -> Result<Vec<Option<LogMessage>>, LogError> {
        let all: Vec<TopicId>;
        let topics = if let Some(topics) = topics {
            topics
        } else {
            all = self.info().topics.iter().map(|topic| topic.id).collect();
            &all
        };
        // A topic that is requested twice is looked up once.
        let mut groups = BTreeMap::new();
        for &topic in topics {
            let group = groups.len();
            groups.entry(topic.0).or_insert(group);
        }
        let found = self.latest_before(MessagePosition::after(time), &groups)?;
        Ok(topics.iter().map(|topic| found[groups[&topic.0]].clone()).collect())
    }

    /// The message before `place`, of any of `topics` or of all topics: for stepping back from a message's position.
    pub fn previous_message(
        &self,
        place: MessagePosition,
        topics: Option<&[TopicId]>,
    ) -> Result<Option<LogMessage>, LogError> {
        let groups = match topics {
            Some(topics) => topics.iter().map(|topic| (topic.0, 0)).collect(),
            None => self.info().topics.iter().map(|topic| (topic.id.0, 0)).collect(),
        };
        Ok(self.latest_before(place, &groups)?.pop().flatten())
    }

    /// The message after `place`, of any of `topics` or of all topics.
    pub fn next_message(
        &self,
        place: MessagePosition,
        topics: Option<&[TopicId]>,
    ) -> Result<Option<LogMessage>, LogError> {
        let options = CursorOptions { topics: topics.map(<[_]>::to_vec), start: place.time, end: Stamp::MAX };
        self.cursor_after(options, place).next().transpose()
    }

    /// The contents of the segments that have messages of these topics. They follow from the index alone, not from what
    /// has been read.
    pub(crate) fn contents_of(&self, topics: &[TopicId]) -> Contents {
        let sums = |order: &[u32], time: fn(&Segment) -> u64| {
            let segments = order.iter().map(|&index| &self.0.segments[index as usize]);
            let segments = segments.filter(|segment| is_indexed_for(segment, topics));
            let mut sum = 0;
            let running = segments.map(|segment| {
                sum += u128::from(segment.contents);
                (time(segment), sum)
            });
            running.collect()
        };
        let by_first = sums(&self.0.by_first, |segment| segment.first);
        Contents { by_first, by_last: sums(&self.0.by_last, |segment| segment.last) }
    }

    /// The last message before `before` of each group of channels. Reads segments from the latest backwards, and only
    /// those that may have a later message than the one found so far.
    fn latest_before(
        &self,
        before: MessagePosition,
        groups: &BTreeMap<u16, usize>,
    ) -> Result<Vec<Option<LogMessage>>, LogError> {
        let count = groups.values().max().map_or(0, |&group| group + 1);
        let mut best: Vec<Option<LogMessage>> = vec![None; count];
        // A channel without messages would cause a search of every segment.
        let mut open: BTreeMap<u16, usize> = groups
            .iter()
            .filter(|&(&channel, _)| {
                self.info().topic(TopicId(channel)).is_some_and(|topic| topic.messages > 0)
            })
            .map(|(&channel, &group)| (channel, group))
            .collect();
        for &index in self.0.by_last.iter().rev() {
            let segment = &self.0.segments[index as usize];
            if segment.first > before.time.0 {
                continue;
            }
            let bound = segment.last.min(before.time.0);
            open.retain(|_, group| best[*group].as_ref().is_none_or(|found| found.place.time.0 <= bound));
            if open.is_empty() {
                break;
            }
            if !open.keys().any(|&channel| segment.may_hold(channel)) {
                continue;
            }
            let loaded = self.load(index)?;
            let mut here = vec![false; count];
            let mut left = open.values().collect::<std::collections::BTreeSet<_>>().len();
            let end = loaded.messages.partition_point(|&message| place_of(index, message) < before);
            for &message in loaded.messages[..end].iter().rev() {
                let Some(&group) = open.get(&message.channel) else { continue };
                if std::mem::replace(&mut here[group], true) {
                    continue;
                }
                let place = place_of(index, message);
                if best[group].as_ref().is_none_or(|found| found.place < place) {
                    best[group] = message_at(index, &loaded, message);
                }
                left -= 1;
                if left == 0 {
                    break;
                }
            }
        }
        Ok(best)
    }
}

/// Whether a segment may have messages of these topics by the index alone, not by what has been read.
pub(crate) fn is_indexed_for(segment: &Segment, topics: &[TopicId]) -> bool {
    let held = segment.channels.as_ref();
    held.is_none_or(|held| topics.iter().any(|id| held.binary_search(&id.0).is_ok()))
}
