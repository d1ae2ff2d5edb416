//! The outer form of MCAP records (opcode, length, body), and plausibility checks of bodies.

/// Opcodes of the MCAP specification.
pub(crate) mod op {
    pub(crate) const HEADER: u8 = 0x01;
    pub(crate) const FOOTER: u8 = 0x02;
    pub(crate) const SCHEMA: u8 = 0x03;
    pub(crate) const CHANNEL: u8 = 0x04;
    pub(crate) const MESSAGE: u8 = 0x05;
    pub(crate) const CHUNK: u8 = 0x06;
    pub(crate) const MESSAGE_INDEX: u8 = 0x07;
    pub(crate) const CHUNK_INDEX: u8 = 0x08;
    pub(crate) const ATTACHMENT: u8 = 0x09;
    pub(crate) const ATTACHMENT_INDEX: u8 = 0x0a;
    pub(crate) const STATISTICS: u8 = 0x0b;
    pub(crate) const METADATA: u8 = 0x0c;
    pub(crate) const METADATA_INDEX: u8 = 0x0d;
    pub(crate) const SUMMARY_OFFSET: u8 = 0x0e;
    pub(crate) const DATA_END: u8 = 0x0f;
    /// Opcodes from here on are for private use.
    pub(crate) const PRIVATE: u8 = 0x80;
}

/// Magic bytes at the start and end of a log.
pub(crate) const MAGIC: &[u8; 8] = b"\x89MCAP0\r\n";
/// Size of opcode and length.
pub(crate) const HEAD: usize = 9;
/// Size of channel, sequence and two times before a message's data.
pub(crate) const MESSAGE_HEAD: usize = 22;
/// Size of a chunk's body before the name of its compression.
const CHUNK_HEAD: usize = 32;
/// Greatest length of the name of a compression; a longer one is damage.
const COMPRESSION_LIMIT: usize = 64;
/// Number of bytes of a body that [`Head::plausible`] may need.
pub(crate) const PROBE: usize = HEAD + CHUNK_HEAD + COMPRESSION_LIMIT + 8;

/// Reads little-endian fields in sequence; `None` past the end.
pub(crate) struct Fields<'a>(pub(crate) &'a [u8]);

impl<'a> Fields<'a> {
    pub(crate) fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let (head, rest) = self.0.split_at_checked(count)?;
        self.0 = rest;
        Some(head)
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.take(N)?.try_into().ok()
    }

    pub(crate) fn u16(&mut self) -> Option<u16> {
        self.array().map(u16::from_le_bytes)
    }

    pub(crate) fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }

    pub(crate) fn u64(&mut self) -> Option<u64> {
        self.array().map(u64::from_le_bytes)
    }

    pub(crate) fn text(&mut self) -> Option<&'a str> {
        let length = self.u32()? as usize;
        std::str::from_utf8(self.take(length)?).ok()
    }
}

/// Opcode and body length of a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Head {
    pub(crate) op: u8,
    pub(crate) body: u64,
}

impl Head {
    /// The head at the start of `bytes`; `None` if there are too few bytes or it cannot be a record.
    pub(crate) fn read(bytes: &[u8]) -> Option<Self> {
        let (&op, rest) = bytes.split_first()?;
        let body = Fields(rest).u64()?;
        let known = (op::HEADER..=op::DATA_END).contains(&op) || op >= op::PRIVATE;
        known.then_some(Self { op, body })
    }

    /// Length of head and body.
    pub(crate) fn length(self) -> u64 {
        self.body.saturating_add(HEAD as u64)
    }

    /// Whether the body can belong to the opcode. `front` holds the first bytes of the body: at least [`PROBE`] less
    /// [`HEAD`] of them, or all that exist.
    pub(crate) fn plausible(self, front: &[u8]) -> bool {
        let mut fields = Fields(front);
        // A body may be longer than its fields, because the format allows padding.
        let at_least = |count: u64| self.body >= count;
        let text_fits = |fields: &mut Fields<'_>, before: u64| {
            fields.u32().map(|length| before + 4 + u64::from(length)).filter(|&end| self.body >= end)
        };
        match self.op {
            op::HEADER | op::METADATA => at_least(8) && text_fits(&mut fields, 0).is_some(),
            op::FOOTER | op::METADATA_INDEX => at_least(20),
            op::SCHEMA => {
                at_least(14) && fields.u16().is_some_and(|id| id != 0) && text_fits(&mut fields, 2).is_some()
            }
            op::CHANNEL => at_least(16) && fields.u32().is_some() && text_fits(&mut fields, 4).is_some(),
            op::MESSAGE => at_least(MESSAGE_HEAD as u64),
            op::CHUNK => ChunkHead::read(front).is_some_and(|chunk| chunk.fits(self.body)),
            op::MESSAGE_INDEX => {
                let _channel = fields.u16();
                fields.u32().is_some_and(|bytes| bytes % 16 == 0 && at_least(6 + u64::from(bytes)))
            }
            op::CHUNK_INDEX => at_least(60),
            op::ATTACHMENT => {
                at_least(36) && fields.take(16).is_some() && text_fits(&mut fields, 16).is_some()
            }
            op::ATTACHMENT_INDEX => at_least(48),
            op::STATISTICS => at_least(46),
            op::SUMMARY_OFFSET => at_least(17),
            op::DATA_END => at_least(4),
            _ => true,
        }
    }
}

/// Where in a log records of this opcode may be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Section {
    /// At its start.
    Start,
    /// Before the end of the data.
    Data,
    /// In the data, and again in the summary.
    Both,
    /// After the data.
    Summary,
}

impl Section {
    /// The section of an opcode, by the table of records in the MCAP specification.
    pub(crate) fn of(opcode: u8) -> Self {
        match opcode {
            op::HEADER => Self::Start,
            op::MESSAGE | op::CHUNK | op::MESSAGE_INDEX | op::ATTACHMENT | op::METADATA | op::DATA_END => {
                Self::Data
            }
            op::CHUNK_INDEX
            | op::ATTACHMENT_INDEX
            | op::STATISTICS
            | op::METADATA_INDEX
            | op::SUMMARY_OFFSET
            | op::FOOTER => Self::Summary,
            _ => Self::Both,
        }
    }
}

/// Number of messages in a message index, from the start of its body.
pub(crate) fn indexed_messages(front: &[u8]) -> Option<(u16, u64)> {
    let mut fields = Fields(front);
    Some((fields.u16()?, u64::from(fields.u32()?) / 16))
}

/// The entries of a message index, from its body: time and offset in the chunk's contents for each message.
pub(crate) fn index_entries(body: &[u8]) -> impl Iterator<Item = (u64, u64)> {
    let mut fields = Fields(body);
    let entries = fields.u16().and(fields.u32()).and_then(|bytes| fields.take(bytes as usize));
    entries_of(entries.unwrap_or_default())
}

/// Like [`index_entries`], of the entries that the front of a body holds.
pub(crate) fn first_index_entries(front: &[u8]) -> impl Iterator<Item = (u64, u64)> {
    let mut fields = Fields(front);
    let bytes = fields.u16().and(fields.u32()).unwrap_or_default() as usize;
    let rest = fields.0;
    entries_of(&rest[..bytes.min(rest.len())])
}

fn entries_of(entries: &[u8]) -> impl Iterator<Item = (u64, u64)> {
    entries.chunks_exact(16).filter_map(|entry| {
        let mut fields = Fields(entry);
        Some((fields.u64()?, fields.u64()?))
    })
}

/// Whether a body of this length has the form of a message index, whatever the opcode of its record: its entries fill it.
/// `front` is its start.
pub(crate) fn is_filled_by_index(front: &[u8], body: u64) -> bool {
    indexed_messages(front).is_some_and(|(_, count)| body == 6 + 16 * count)
}

/// The start of a chunk's body.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct ChunkHead {
    pub(crate) first: u64,
    pub(crate) last: u64,
    pub(crate) uncompressed: u64,
    pub(crate) crc: u32,
    pub(crate) compression: String,
    pub(crate) compressed: u64,
    /// Size of the body before the compressed data.
    pub(crate) front: usize,
}

impl ChunkHead {
    pub(crate) fn read(body: &[u8]) -> Option<Self> {
        let mut fields = Fields(body);
        let (first, last, uncompressed, crc) = (fields.u64()?, fields.u64()?, fields.u64()?, fields.u32()?);
        let name = fields.text().filter(|name| name.len() <= COMPRESSION_LIMIT)?;
        let compressed = fields.u64()?;
        let front = CHUNK_HEAD + name.len() + 8;
        Some(Self { first, last, uncompressed, crc, compression: name.to_owned(), compressed, front })
    }

    /// Whether the compressed data end within a body of this length.
    pub(crate) fn fits(&self, body: u64) -> bool {
        (self.front as u64).checked_add(self.compressed).is_some_and(|end| end <= body)
    }

    /// Whether the header has the form that writers produce.
    pub(crate) fn is_known(&self) -> bool {
        let is_compression = match self.compression.as_str() {
            "" => self.compressed == self.uncompressed && self.compressed > 0,
            name => matches!(name, "zstd" | "lz4"),
        };
        is_compression && self.first <= self.last
    }

    /// Whether a body of this length is a chunk, whatever the opcode of its record: the sizes in a known header fill
    /// the body exactly. Bodies of other records do not.
    pub(crate) fn fills(&self, body: u64) -> bool {
        self.is_known() && (self.front as u64).checked_add(self.compressed) == Some(body)
    }

    /// The stated times, unless they are those of a chunk that was never closed: all ones, or zero.
    pub(crate) fn times(&self) -> Option<(u64, u64)> {
        (self.first <= self.last && self.last != 0 && self.first != u64::MAX)
            .then_some((self.first, self.last))
    }
}

/// The start of a message's body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct MessageHead {
    pub(crate) channel: u16,
    pub(crate) sequence: u32,
    pub(crate) log_time: u64,
    pub(crate) publish_time: u64,
}

impl MessageHead {
    pub(crate) fn read(body: &[u8]) -> Option<Self> {
        let mut fields = Fields(body);
        Some(Self {
            channel: fields.u16()?,
            sequence: fields.u32()?,
            log_time: fields.u64()?,
            publish_time: fields.u64()?,
        })
    }
}
