//! Recordings that are split into several files are read as one log: their bytes follow each other, and their channels
//! are joined where topic, type and metadata are equal.

use crate::catalog::{Catalog, SchemaRecord};
use crate::error::LogError;
use crate::gaps::gaps;
use crate::log::{Log, Opened};
use crate::parts::{Part, Parts};
use crate::source::Source;
use std::collections::BTreeMap;
use std::path::Path;

impl Log {
    /// Opens the parts of a recording that was split into several files as one log, each like [`Log::open`].
    pub fn open_parts(paths: &[impl AsRef<Path>]) -> Result<Self, LogError> {
        if let [path] = paths {
            return Self::open(path);
        }
        let mut whole = Opened::default();
        let mut parts = Vec::new();
        let mut sources = Vec::new();
        let mut start = 0;
        for path in paths {
            let source = Source::open(path.as_ref())?;
            let opened = Self::open_source(&source, true)?;
            let file = path.as_ref().file_name().unwrap_or_default().to_string_lossy().into_owned();
            let length = source.length();
            let channels = whole.join(opened, start, &file)?;
            parts.push(Part { start, channels });
            sources.push((start, source));
            start += length;
        }
        let source = Source::parts(sources);
        let gaps = gaps(&source, &whole.contents.segments)?;
        Ok(Self::new(source, whole, gaps, Parts::new(parts)))
    }
}

impl Opened {
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
