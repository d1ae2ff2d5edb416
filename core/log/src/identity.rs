//! Identity of a log: derived from its content, not from its name or path.
//!
//! Reading all of a large log takes long. A chunk header contains the checksum of its contents, so that the headers of
//! all chunks identify them. For chunks without a checksum, and for messages outside of chunks, the first and last
//! bytes are used instead.

use crate::error::LogError;
use crate::log::Log;
use crate::record::{ChunkHead, HEAD, Head, PROBE};

/// Number of bytes used at each end of data without a checksum.
const ENDS: u64 = 64 << 10;

impl Log {
    /// Identity of the log's content, 16 hexadecimal digits: equal for copies under other names, different if a message
    /// differs.
    pub fn identity(&self) -> Result<String, LogError> {
        let inner = &*self.0;
        let mut hasher = blake3::Hasher::new();
        for topic in &self.info().topics {
            hasher.update(topic.name.as_bytes());
            hasher.update(topic.schema.name().as_bytes());
            hasher.update(&topic.id.0.to_le_bytes());
        }
        for segment in &inner.segments {
            for number in [segment.start, segment.length, segment.first, segment.last, segment.contents] {
                hasher.update(&number.to_le_bytes());
            }
            let front = inner.source.read(segment.start, segment.length.min(PROBE as u64) as usize)?;
            let head = Head::read(&front).filter(|_| segment.chunk);
            let chunk = head.and_then(|_| ChunkHead::read(front.get(HEAD..)?));
            match chunk {
                Some(chunk) if chunk.crc != 0 => {
                    hasher.update(&chunk.crc.to_le_bytes());
                }
                _ => {
                    let first = segment.length.min(ENDS);
                    hasher.update(&inner.source.read(segment.start, first as usize)?);
                    let last = (segment.length - first).min(ENDS);
                    hasher.update(&inner.source.read(segment.end() - last, last as usize)?);
                }
            }
        }
        Ok(hasher.finalize().to_hex()[..16].to_owned())
    }
}
