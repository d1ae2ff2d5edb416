//! Recordings that are split into several files are read as one log: their bytes follow each other, and their channels
//! are joined where topic, type and metadata are equal.

use crate::catalog::{Catalog, SchemaRecord};
use crate::error::LogError;
use crate::gaps::gaps;
use crate::info::Lost;
use crate::log::{CHECKED_WHOLE, Log, Opened};
use crate::parts::{Part, Parts};
use crate::source::{Pool, Source};
use crate::summary::Contents;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

impl Log {
    /// Opens the parts of a recording that was split into several files as one log, each like [`Log::open`]. A part that
    /// is no log, such as one that was begun when the power failed, is a problem; it is an error if none is a log.
    pub fn open_parts(paths: &[impl AsRef<Path>]) -> Result<Self, LogError> {
        match paths {
            [path] => Self::open(path),
            _ => Self::open_parts_checking(paths, CHECKED_WHOLE),
        }
    }

    /// Refuses what [`Log::open_parts`] refuses by their first bytes, of which it reads eight of each file: a file that
    /// cannot be opened, and files of which none begins like a log.
    pub fn probe_parts(paths: &[impl AsRef<Path>]) -> Result<(), LogError> {
        let (mut has_log, mut refused) = (false, None);
        for path in paths {
            match Self::check_front(&Source::open(path.as_ref())?) {
                Err(LogError::NotALog { got, path }) => {
                    refused = refused.or(Some(LogError::NotALog { got, path }));
                }
                begins => {
                    begins?;
                    has_log = true;
                }
            }
        }
        refused.filter(|_| !has_log).map_or(Ok(()), Err)
    }

    /// Like [`Log::open_parts`], with the limit up to which parts are checked: if their files have at most `most` bytes
    /// together, as many as have at most so many bytes uncompressed.
    fn open_parts_checking(paths: &[impl AsRef<Path>], most: u64) -> Result<Self, LogError> {
        let pool = Arc::new(Pool::default());
        let opened = paths.iter().enumerate().map(|(part, path)| Source::open_in(&pool, part, path.as_ref()));
        let files = opened.collect::<Result<Vec<_>, _>>()?;
        let bytes: u64 = files.iter().map(Source::length).sum();
        let mut left_to_check = if bytes <= most { most } else { 0 };
        let mut whole = Opened::default();
        let mut parts = Vec::new();
        let mut sources = Vec::new();
        let mut start = 0;
        let (mut has_log, mut refused) = (false, None);
        for source in files {
            let opened = match Self::open_source(&source, true, &mut left_to_check) {
                Err(LogError::NotALog { got, path }) => {
                    let unread = Opened::unread(source.length(), &got);
                    refused = refused.or(Some(LogError::NotALog { got, path }));
                    unread
                }
                opened => {
                    has_log = true;
                    opened?
                }
            };
            let file = source.path().file_name().unwrap_or_default().to_string_lossy().into_owned();
            let length = source.length();
            let channels = whole.join(opened, start, &file)?;
            parts.push(Part { start, channels });
            sources.push((start, source));
            start += length;
        }
        if let Some(error) = refused.filter(|_| !has_log) {
            return Err(error);
        }
        let source = Source::parts(sources);
        let gaps = gaps(&source, &whole.contents.segments)?;
        Ok(Self::new(source, whole, gaps, Parts::new(parts)))
    }
}

impl Opened {
    /// A part of so many bytes that is no log; `got` says what it is.
    fn unread(bytes: u64, got: &str) -> Self {
        let mut contents = Contents::default();
        contents.problems.add(format!("expected an mcap log, got {got}"));
        Self { contents, lost: Lost { bytes, messages: 0 }, recovered: true, ..Self::default() }
    }

    /// Adds a part whose first byte is at `start`; returns the numbers of its channels in the whole.
    fn join(&mut self, part: Self, start: u64, file: &str) -> Result<BTreeMap<u16, u16>, LogError> {
        let first = self.contents.segments.len() as u32;
        let whole = &mut self.contents;
        let channels = whole.catalog.join(part.contents.catalog, start)?;
        for mut segment in part.contents.segments {
            segment.start += start;
            segment.channels = segment.channels.map(|known| {
                let mut known: Vec<u16> = known.iter().filter_map(|id| channels.get(id).copied()).collect();
                known.sort_unstable();
                known.into()
            });
            whole.segments.push(segment);
        }
        for (id, count) in part.contents.counts {
            if let Some(id) = channels.get(&id) {
                *whole.counts.entry(*id).or_insert(0) += count;
            }
        }
        for problem in part.contents.problems.list() {
            whole.problems.add(format!("{file}: {problem}"));
        }
        self.scanned.extend(part.scanned.into_iter().map(|segment| segment + first));
        self.lost += part.lost;
        self.recovered |= part.recovered;
        self.verified += part.verified;
        Ok(channels)
    }
}

impl Catalog {
    /// Adds the definitions of a part; returns the numbers that its channels have here.
    fn join(&mut self, part: Self, start: u64) -> Result<BTreeMap<u16, u16>, LogError> {
        if self.profile.is_empty() && self.library.is_empty() {
            (self.profile, self.library) = (part.profile, part.library);
        }
        for record in part.metadata {
            if !self.metadata.contains(&record) {
                self.metadata.push(record);
            }
        }
        for mut attachment in part.attachments {
            attachment.offset += start;
            self.attachments.push(attachment);
        }
        let mut schemas = BTreeMap::from([(0, 0)]);
        for (id, schema) in part.schemas {
            let equal = |known: &SchemaRecord| *known == schema;
            let here = number(&self.schemas, id, equal)?;
            self.schemas.insert(here, schema);
            schemas.insert(id, here);
        }
        let mut channels = BTreeMap::new();
        for (id, mut channel) in part.channels {
            channel.schema_id = schemas.get(&channel.schema_id).copied().unwrap_or_default();
            let equal = |known: &mcap::records::Channel| {
                mcap::records::Channel { id: known.id, ..channel.clone() } == *known
            };
            let here = number(&self.channels, id, equal)?;
            channel.id = here;
            self.channels.insert(here, channel);
            channels.insert(id, here);
        }
        Ok(channels)
    }
}

/// The number of an equal entry, else its own if that is free, else another one.
fn number<T>(known: &BTreeMap<u16, T>, own: u16, is_equal: impl Fn(&T) -> bool) -> Result<u16, LogError> {
    if let Some((id, _)) = known.iter().find(|(_, other)| is_equal(other)) {
        return Ok(*id);
    }
    let free = std::iter::once(own).chain(1..=u16::MAX).find(|id| *id != 0 && !known.contains_key(id));
    free.or_else(|| (own == 0 && !known.contains_key(&0)).then_some(0)).ok_or_else(|| LogError::Refused {
        what: "a recording of several files",
        expected: "at most 65,535 channels and schemas".to_owned(),
        got: "more".to_owned(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::writer::{LogWriter, WriteHeader, WriterOptions};
    use rcs_msg::{MessageEncoding, Schema};

    #[test]
    fn parts_are_checked_as_far_as_they_are_within_the_limit_together() {
        let folder = tempfile::tempdir().unwrap();
        let paths = [0, 1, 2].map(|part| {
            let path = folder.path().join(format!("drive_{part}.mcap"));
            let mut writer = LogWriter::create(&path, WriterOptions::default()).unwrap();
            let data = b"{}".as_slice().into();
            let schema = Schema::new("test.Text", MessageEncoding::Json, "jsonschema", data);
            let channel = writer.add_channel("/text", &schema, &BTreeMap::new()).unwrap();
            writer.write(channel, WriteHeader::default(), &[b' '; 10_000]).unwrap();
            writer.finish().unwrap();
            path
        });
        let bytes: u64 = paths.iter().map(|path| path.metadata().unwrap().len()).sum();
        assert!(bytes < 10_000, "they are compressed");
        let verified = |most: u64| Log::open_parts_checking(&paths, most).unwrap().info().verified;
        assert_eq!([40_000, 25_000, bytes, bytes - 1].map(verified), [3, 2, 0, 0]);
    }
}
