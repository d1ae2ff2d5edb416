//! Parsers for the bodies of small records.
//!
//! The parser of the crate `mcap` reserves as much memory as the length of a string claims, up to 4 GiB in a damaged
//! record. These parsers never reserve more than the record holds.

use crate::record::Fields;
use mcap::records::{Channel, ChunkIndex, Footer, Header, Metadata, SchemaHeader, Statistics};
use std::collections::BTreeMap;

/// Entries up to a given number of bytes.
fn map<K: Ord, V>(
    fields: &mut Fields<'_>,
    entry: fn(&mut Fields<'_>) -> Option<(K, V)>,
) -> Option<BTreeMap<K, V>> {
    let length = fields.u32()? as usize;
    let mut inner = Fields(fields.take(length)?);
    let mut map = BTreeMap::new();
    while !inner.0.is_empty() {
        let (key, value) = entry(&mut inner)?;
        map.insert(key, value);
    }
    Some(map)
}

fn strings(fields: &mut Fields<'_>) -> Option<BTreeMap<String, String>> {
    map(fields, |fields| Some((fields.text()?.to_owned(), fields.text()?.to_owned())))
}

fn by_channel(fields: &mut Fields<'_>) -> Option<BTreeMap<u16, u64>> {
    map(fields, |fields| Some((fields.u16()?, fields.u64()?)))
}

pub(crate) fn header(body: &[u8]) -> Option<Header> {
    let mut fields = Fields(body);
    Some(Header { profile: fields.text()?.to_owned(), library: fields.text()?.to_owned() })
}

pub(crate) fn footer(body: &[u8]) -> Option<Footer> {
    let mut fields = Fields(body);
    Some(Footer {
        summary_start: fields.u64()?,
        summary_offset_start: fields.u64()?,
        summary_crc: fields.u32()?,
    })
}

/// A schema and its data.
pub(crate) fn schema(body: &[u8]) -> Option<(SchemaHeader, &[u8])> {
    let mut fields = Fields(body);
    let header = SchemaHeader {
        id: fields.u16()?,
        name: fields.text()?.to_owned(),
        encoding: fields.text()?.to_owned(),
    };
    let length = fields.u32()? as usize;
    Some((header, fields.take(length)?))
}

pub(crate) fn channel(body: &[u8]) -> Option<Channel> {
    let mut fields = Fields(body);
    Some(Channel {
        id: fields.u16()?,
        schema_id: fields.u16()?,
        topic: fields.text()?.to_owned(),
        message_encoding: fields.text()?.to_owned(),
        metadata: strings(&mut fields)?,
    })
}

pub(crate) fn metadata(body: &[u8]) -> Option<Metadata> {
    let mut fields = Fields(body);
    Some(Metadata { name: fields.text()?.to_owned(), metadata: strings(&mut fields)? })
}

pub(crate) fn statistics(body: &[u8]) -> Option<Statistics> {
    let mut fields = Fields(body);
    Some(Statistics {
        message_count: fields.u64()?,
        schema_count: fields.u16()?,
        channel_count: fields.u32()?,
        attachment_count: fields.u32()?,
        metadata_count: fields.u32()?,
        chunk_count: fields.u32()?,
        message_start_time: fields.u64()?,
        message_end_time: fields.u64()?,
        channel_message_counts: by_channel(&mut fields)?,
    })
}

pub(crate) fn chunk_index(body: &[u8]) -> Option<ChunkIndex> {
    let mut fields = Fields(body);
    Some(ChunkIndex {
        message_start_time: fields.u64()?,
        message_end_time: fields.u64()?,
        chunk_start_offset: fields.u64()?,
        chunk_length: fields.u64()?,
        message_index_offsets: by_channel(&mut fields)?,
        message_index_length: fields.u64()?,
        compression: fields.text()?.to_owned(),
        compressed_size: fields.u64()?,
        uncompressed_size: fields.u64()?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_string_longer_than_its_record_is_refused_without_being_made_room_for() {
        let mut body = vec![1, 0, 1, 0];
        body.extend(u32::MAX.to_le_bytes());
        body.extend(b"/topic");
        assert!(channel(&body).is_none());
    }

    #[test]
    fn records_parse_as_the_format_s_own_crate_parses_them() {
        let mut body = vec![7, 0, 9, 0];
        for text in ["/topic", "cdr"] {
            body.extend((text.len() as u32).to_le_bytes());
            body.extend(text.bytes());
        }
        body.extend(12u32.to_le_bytes());
        for text in ["ke", "va"] {
            body.extend((text.len() as u32).to_le_bytes());
            body.extend(text.bytes());
        }
        let Ok(mcap::records::Record::Channel(theirs)) =
            mcap::parse_record(crate::record::op::CHANNEL, &body)
        else {
            panic!("the crate refuses the channel");
        };
        assert_eq!(channel(&body), Some(theirs));

        let mut body = Vec::new();
        for number in 1..=4u64 {
            body.extend(number.to_le_bytes());
        }
        body.extend(10u32.to_le_bytes());
        body.extend([3, 0]);
        body.extend(77u64.to_le_bytes());
        body.extend(5u64.to_le_bytes());
        body.extend(4u32.to_le_bytes());
        body.extend(b"zstd");
        body.extend(6u64.to_le_bytes());
        body.extend(7u64.to_le_bytes());
        let Ok(mcap::records::Record::ChunkIndex(theirs)) =
            mcap::parse_record(crate::record::op::CHUNK_INDEX, &body)
        else {
            panic!("the crate refuses the chunk index");
        };
        assert_eq!(chunk_index(&body), Some(theirs));
    }
}
