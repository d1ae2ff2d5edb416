//! Checks a complete log: every checksum, count, index entry, attachment and message.

use crate::error::LogError;
use crate::info::{Lost, TopicId};
use crate::log::Log;
use crate::record::{HEAD, Head, MESSAGE_HEAD, PROBE, index_entries, op};
use crate::segment::{Decoded, Segment, decode};
use crate::summary;
use std::collections::{BTreeMap, BTreeSet};

/// Greatest number of problems of one kind that are described.
const MOST_TOLD: usize = 20;
/// Greatest size of messages that are decoded: as a tree a message can take many times its size.
const LARGEST_DECODED: usize = 32 << 20;
/// Greatest size of message indexes that are read.
const INDEX_LIMIT: u64 = 64 << 20;

/// Result of checking a complete log.
#[derive(Clone, Debug, Default)]
pub struct Verification {
    /// Segments that were read: chunks, and runs of messages outside of chunks.
    pub segments: u64,
    /// Messages found in them.
    pub messages: u64,
    /// What could not be read.
    pub lost: Lost,
    /// Problems of the log, one sentence each; empty for a sound log.
    pub problems: Vec<String>,
    /// By topic: the number of messages that do not decode, and the error of the first of them.
    pub undecodable: BTreeMap<TopicId, (u64, String)>,
}

impl Log {
    /// Reads all of the log and checks everything that it states about itself. `progress` gets bytes done and total
    /// bytes.
    pub fn verify(&self, progress: &mut dyn FnMut(u64, u64)) -> Result<Verification, LogError> {
        let inner = &*self.0;
        let mut found = Verification::default();
        let mut counts: BTreeMap<TopicId, u64> = BTreeMap::new();
        let total = inner.source.length();
        for (index, segment) in inner.segments.iter().enumerate() {
            progress(segment.start, total);
            let mut decoded = decode(&inner.source, segment)?;
            if let Some(damage) = &decoded.damage {
                self.report(index as u32, damage, decoded.messages.len() as u64)?;
            }
            found.segments += 1;
            if segment.chunk && decoded.damage.is_none() {
                self.check_index(segment, &decoded, &mut found)?;
            }
            inner.parts.map_channels(segment, &mut decoded.messages);
            for message in &decoded.messages {
                *counts.entry(TopicId(message.channel)).or_insert(0) += 1;
            }
            self.check_messages(&decoded, &mut found);
        }
        found.messages = counts.values().sum();
        if !self.info().recovered {
            for topic in &self.info().topics {
                let got = counts.get(&topic.id).copied().unwrap_or(0);
                if got != topic.messages && self.lost() == Lost::default() {
                    let (name, stated) = (&topic.name, topic.messages);
                    found
                        .problems
                        .push(format!("{name}: expected {stated} messages by the index, got {got}"));
                }
            }
            for file in inner.source.files() {
                if let Ok(summary) = summary::read(file)? {
                    found.problems.extend(summary::check_data(file, &summary)?);
                }
            }
        }
        for attachment in self.attachments() {
            match self.read_attachment(attachment) {
                Err(error @ LogError::Damaged { .. }) => found.problems.push(error.to_string()),
                other => drop(other?),
            }
        }
        let undecodable = self.info().topics.iter().filter_map(|topic| {
            let (count, reason) = found.undecodable.get(&topic.id)?;
            Some(format!("{}: {count} messages do not decode, the first because {reason}", topic.name))
        });
        let undecodable: Vec<String> = undecodable.collect();
        found.problems.extend(undecodable);
        // Problems found by opening and reading come first.
        let mut problems = self.problems();
        problems.append(&mut found.problems);
        found.problems = problems;
        found.lost = self.lost();
        progress(total, total);
        Ok(found)
    }

    /// Compares the message indexes after a chunk with its messages.
    fn check_index(
        &self,
        segment: &Segment,
        decoded: &Decoded,
        found: &mut Verification,
    ) -> Result<(), LogError> {
        let source = &self.0.source;
        let messages: BTreeSet<(u16, u64, u64)> = decoded
            .messages
            .iter()
            .map(|message| (message.channel, message.time, u64::from(message.offset)))
            .collect();
        let (mut at, mut indexed, mut wrong) = (segment.end(), 0, 0u64);
        loop {
            let left = source.length().saturating_sub(at);
            let front = source.read(at, left.min(PROBE as u64) as usize)?;
            let head =
                Head::read(&front).filter(|head| head.op == op::MESSAGE_INDEX && head.length() <= left);
            let Some(head) = head.filter(|head| head.body <= INDEX_LIMIT) else { break };
            let body = source.read(at + HEAD as u64, head.body as usize)?;
            let channel = body.get(..2).map_or(0, |id| u16::from_le_bytes([id[0], id[1]]));
            for (time, offset) in index_entries(&body) {
                indexed += 1;
                wrong += u64::from(!messages.contains(&(channel, time, offset)));
            }
            at += head.length();
        }
        let (start, count) = (segment.start, messages.len());
        if found.problems.len() >= MOST_TOLD {
            return Ok(());
        }
        if wrong > 0 {
            found.problems.push(format!("the index of the chunk at byte {start} has {wrong} entries wrong"));
        } else if indexed > 0 && indexed != count {
            found.problems.push(format!(
                "the index of the chunk at byte {start} has {indexed} entries, expected {count}"
            ));
        }
        Ok(())
    }

    /// Decodes every message whose schema has a reader.
    fn check_messages(&self, decoded: &Decoded, found: &mut Verification) {
        for message in &decoded.messages {
            let id = TopicId(message.channel);
            let Some(topic) = self.info().topic(id).filter(|topic| topic.decodable) else { continue };
            let Some((_, body)) = decoded.record(message.offset) else { continue };
            if body.len() > LARGEST_DECODED {
                continue;
            }
            if let Err(error) = topic.schema.value(&body.slice(MESSAGE_HEAD.min(body.len())..)) {
                found.undecodable.entry(id).or_insert_with(|| (0, error.to_string())).0 += 1;
            }
        }
    }
}
