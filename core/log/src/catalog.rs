//! Definitions of a log: schemas, channels, attachments, metadata, statistics.

use crate::info::{AttachmentInfo, COMPLETE_FROM, Counted, LogTopic, Metadata, TopicId};
use crate::parse;
use crate::record::{Fields, Head, op};
use bytes::Bytes;
use mcap::records::{Channel, Statistics};
use rcs_msg::{MessageEncoding, Schema, Stamp};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Bodies of schemas, channels and metadata larger than this are not read.
pub(crate) const BODY_LIMIT: u64 = 16 << 20;
/// Bytes of an attachment that are read to list it.
pub(crate) const ATTACHMENT_PROBE: usize = 4096;
/// Further problems are counted but not described.
const PROBLEM_LIMIT: usize = 200;

/// Problems in the order in which they were found, limited in number.
#[derive(Clone, Debug, Default)]
pub(crate) struct Problems {
    told: Vec<String>,
    untold: usize,
}

impl Problems {
    pub(crate) fn add(&mut self, problem: String) {
        if self.told.len() < PROBLEM_LIMIT {
            self.told.push(problem);
        } else {
            self.untold += 1;
        }
    }

    pub(crate) fn append(&mut self, others: Self) {
        for problem in others.told {
            self.add(problem);
        }
        self.untold += others.untold;
    }

    pub(crate) fn list(&self) -> Vec<String> {
        let more = (self.untold > 0).then(|| format!("and {} more problems", self.untold));
        self.told.iter().cloned().chain(more).collect()
    }
}

/// A schema record.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct SchemaRecord {
    name: String,
    encoding: String,
    data: Bytes,
}

/// All definitions found so far. Of two records with the same number the first is kept.
#[derive(Clone, Debug, Default)]
pub(crate) struct Catalog {
    pub(crate) schemas: BTreeMap<u16, SchemaRecord>,
    pub(crate) channels: BTreeMap<u16, Channel>,
    pub(crate) attachments: Vec<AttachmentInfo>,
    pub(crate) metadata: Vec<Metadata>,
    pub(crate) statistics: Option<Statistics>,
    pub(crate) profile: String,
    pub(crate) library: String,
}

impl Catalog {
    /// Adds a record that is neither a message nor a chunk. `body` is its start: all of it, except for attachments and
    /// records over [`BODY_LIMIT`]. Returns a problem if the record does not parse or contradicts an earlier one.
    pub(crate) fn take(&mut self, head: Head, offset: u64, body: &Bytes) -> Result<(), String> {
        if head.op == op::ATTACHMENT {
            let info = attachment_info(head, offset, body)
                .ok_or_else(|| format!("the attachment at byte {offset} does not parse"))?;
            self.attachments.push(info);
            return Ok(());
        }
        let wanted = matches!(head.op, op::HEADER | op::SCHEMA | op::CHANNEL | op::METADATA | op::STATISTICS);
        if !wanted {
            return Ok(());
        }
        if body.len() as u64 != head.body {
            return Err(format!(
                "the record at byte {offset} is larger than the limit of {BODY_LIMIT} bytes"
            ));
        }
        let unparsed = || format!("the record of opcode {:#04x} at byte {offset} does not parse", head.op);
        match head.op {
            op::HEADER => {
                let header = parse::header(body).ok_or_else(unparsed)?;
                (self.profile, self.library) = (header.profile, header.library);
            }
            op::SCHEMA => {
                let (header, data) = parse::schema(body).ok_or_else(unparsed)?;
                let data = Bytes::copy_from_slice(data);
                let schema = SchemaRecord { name: header.name, encoding: header.encoding, data };
                let known = self.schemas.entry(header.id).or_insert_with(|| schema.clone());
                if *known != schema {
                    return Err(format!("schema {} at byte {offset} contradicts an earlier one", header.id));
                }
            }
            op::CHANNEL => {
                let channel = parse::channel(body).ok_or_else(unparsed)?;
                let known = self.channels.entry(channel.id).or_insert_with(|| channel.clone());
                if *known != channel {
                    return Err(format!(
                        "channel {} at byte {offset} contradicts an earlier one",
                        channel.id
                    ));
                }
            }
            op::METADATA => {
                let record = parse::metadata(body).ok_or_else(unparsed)?;
                self.metadata.push(Metadata { name: record.name, entries: record.metadata });
            }
            _ => self.statistics = Some(parse::statistics(body).ok_or_else(unparsed)?),
        }
        Ok(())
    }

    /// Adds the schemas and channels of another catalog that are not known yet.
    pub(crate) fn take_definitions(&mut self, other: &Self) {
        for (&id, schema) in &other.schemas {
            self.schemas.entry(id).or_insert_with(|| schema.clone());
        }
        for (&id, channel) in &other.channels {
            self.channels.entry(id).or_insert_with(|| channel.clone());
        }
    }

    /// The time from which the recording is complete; see [`LogInfo::complete_from`](crate::LogInfo::complete_from).
    pub(crate) fn complete_from(&self) -> Option<Stamp> {
        let mut own = self.metadata.iter().filter(|about| about.name == "ocu");
        own.find_map(|about| about.entries.get(COMPLETE_FROM)?.parse().ok()).map(Stamp)
    }

    /// Creates a channel with this number, which the log does not define.
    pub(crate) fn define(&mut self, id: u16) {
        let topic = format!("undefined channel {id}");
        let message_encoding = String::new();
        self.channels
            .insert(id, Channel { id, schema_id: 0, topic, message_encoding, metadata: BTreeMap::new() });
    }

    /// The topics with their message counts, without rates.
    pub(crate) fn topics(&self, counts: &BTreeMap<u16, u64>) -> Vec<LogTopic> {
        let mut shared: BTreeMap<(u16, &str), Arc<Schema>> = BTreeMap::new();
        let mut topics = Vec::with_capacity(self.channels.len());
        for (&id, channel) in &self.channels {
            let record = self.schemas.get(&channel.schema_id);
            let schema = shared.entry((channel.schema_id, &channel.message_encoding)).or_insert_with(|| {
                let (name, encoding, data) = record.map_or_else(Default::default, |schema| {
                    (schema.name.as_str(), schema.encoding.as_str(), schema.data.clone())
                });
                let message_encoding = MessageEncoding::from_name(&channel.message_encoding);
                Arc::new(Schema::new(name, message_encoding, encoding, data))
            });
            let schema = Arc::clone(schema);
            let messages = counts.get(&id).copied().unwrap_or(0);
            let undecodable_because = if channel.schema_id != 0 && record.is_none() {
                Some(format!("the log has no schema {}", channel.schema_id))
            } else {
                schema.decodable().err().map(|error| error.to_string())
            };
            topics.push(LogTopic {
                id: TopicId(id),
                name: channel.topic.clone(),
                schema,
                metadata: channel.metadata.clone(),
                messages,
                hz: 0.0,
                decodable: undecodable_because.is_none(),
                undecodable_because,
                counted: Counted::NONE,
            });
        }
        topics
    }
}

fn attachment_info(head: Head, offset: u64, front: &[u8]) -> Option<AttachmentInfo> {
    let mut fields = Fields(front);
    let (log_time, create_time) = (fields.u64()?, fields.u64()?);
    let (name, media_type) = (fields.text()?, fields.text()?);
    let size = fields.u64()?;
    let before = (front.len() - fields.0.len()) as u64;
    // A checksum of four bytes follows the data.
    (before.checked_add(size)?.checked_add(4)? <= head.body).then(|| AttachmentInfo {
        name: name.to_owned(),
        media_type: media_type.to_owned(),
        log_time: Stamp(log_time),
        create_time: Stamp(create_time),
        size,
        offset,
        body: head.body,
    })
}
