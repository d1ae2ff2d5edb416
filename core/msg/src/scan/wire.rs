//! Protobuf's wire format: tags, varints, numbers, and skipping of fields.

use prost_reflect::Kind;

/// Groups that are nested deeper than this are refused.
const MAX_GROUPS: usize = 100;

/// Wire encoding of a number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Scalar {
    Bool,
    Int32,
    Uint32,
    Int64,
    Uint64,
    Sint32,
    Sint64,
    Fixed32,
    Sfixed32,
    Float,
    Fixed64,
    Sfixed64,
    Double,
}

/// Why bytes are not a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub(super) enum WireError {
    #[error("got the end of the message, expected more bytes")]
    Truncated,
    #[error("got a varint of more than 10 bytes")]
    Varint,
    #[error("got wire type {wire_type} for field {field}, expected another")]
    WireType { field: u32, wire_type: u8 },
    #[error("got field number 0")]
    FieldZero,
    #[error("got groups nested deeper than {MAX_GROUPS}")]
    Depth,
    #[error("got the end of a group that does not match its start")]
    Group,
}

const VARINT: u8 = 0;
const FIXED64: u8 = 1;
pub(super) const DELIMITED: u8 = 2;
pub(super) const START_GROUP: u8 = 3;
pub(super) const END_GROUP: u8 = 4;
const FIXED32: u8 = 5;

impl Scalar {
    pub(super) fn of(kind: &Kind) -> Option<Self> {
        Some(match kind {
            Kind::Bool => Self::Bool,
            Kind::Int32 | Kind::Enum(_) => Self::Int32,
            Kind::Uint32 => Self::Uint32,
            Kind::Int64 => Self::Int64,
            Kind::Uint64 => Self::Uint64,
            Kind::Sint32 => Self::Sint32,
            Kind::Sint64 => Self::Sint64,
            Kind::Fixed32 => Self::Fixed32,
            Kind::Sfixed32 => Self::Sfixed32,
            Kind::Float => Self::Float,
            Kind::Fixed64 => Self::Fixed64,
            Kind::Sfixed64 => Self::Sfixed64,
            Kind::Double => Self::Double,
            Kind::String | Kind::Bytes | Kind::Message(_) => return None,
        })
    }

    pub(super) fn wire_type(self) -> u8 {
        match self {
            Self::Fixed32 | Self::Sfixed32 | Self::Float => FIXED32,
            Self::Fixed64 | Self::Sfixed64 | Self::Double => FIXED64,
            _ => VARINT,
        }
    }

    pub(super) fn read(self, wire: &mut Wire<'_>) -> Result<f64, WireError> {
        Ok(match self {
            Self::Bool => f64::from(u8::from(wire.varint()? != 0)),
            Self::Int32 => f64::from(wire.varint()? as i32),
            Self::Uint32 => f64::from(wire.varint()? as u32),
            Self::Int64 => wire.varint()? as i64 as f64,
            Self::Uint64 => wire.varint()? as f64,
            Self::Sint32 => {
                let v = wire.varint()? as u32;
                f64::from((v >> 1) as i32 ^ -((v & 1) as i32))
            }
            Self::Sint64 => {
                let v = wire.varint()?;
                ((v >> 1) as i64 ^ -((v & 1) as i64)) as f64
            }
            Self::Fixed32 => f64::from(u32::from_le_bytes(wire.array()?)),
            Self::Sfixed32 => f64::from(i32::from_le_bytes(wire.array()?)),
            Self::Float => f64::from(f32::from_le_bytes(wire.array()?)),
            Self::Fixed64 => u64::from_le_bytes(wire.array()?) as f64,
            Self::Sfixed64 => i64::from_le_bytes(wire.array()?) as f64,
            Self::Double => f64::from_le_bytes(wire.array()?),
        })
    }

    /// Number of elements of a packed field.
    pub(super) fn count(self, packed: &[u8]) -> Result<usize, WireError> {
        let size = match self.wire_type() {
            FIXED32 => 4,
            FIXED64 => 8,
            // The last byte of each varint is the one without the high bit.
            _ => return Ok(packed.iter().filter(|byte| **byte < 0x80).count()),
        };
        if packed.len().is_multiple_of(size) { Ok(packed.len() / size) } else { Err(WireError::Truncated) }
    }

    /// The number at an index of a packed field; the caller has checked the index.
    pub(super) fn nth(self, packed: &[u8], index: usize) -> Result<f64, WireError> {
        let mut wire = Wire { bytes: packed };
        match self.wire_type() {
            FIXED32 => wire.take(index * 4).map(|_| ())?,
            FIXED64 => wire.take(index * 8).map(|_| ())?,
            _ => (0..index).try_for_each(|_| wire.varint().map(|_| ()))?,
        }
        self.read(&mut wire)
    }
}

/// The rest of a message.
pub(super) struct Wire<'a> {
    pub(super) bytes: &'a [u8],
}

impl<'a> Wire<'a> {
    #[inline]
    fn varint(&mut self) -> Result<u64, WireError> {
        if let Some((first, rest)) = self.bytes.split_first()
            && *first < 0x80
        {
            self.bytes = rest;
            return Ok(u64::from(*first));
        }
        let mut value = 0;
        for (at, byte) in self.bytes.iter().take(10).enumerate() {
            value |= u64::from(byte & 0x7f) << (7 * at);
            if *byte < 0x80 {
                self.bytes = &self.bytes[at + 1..];
                return Ok(value);
            }
        }
        Err(if self.bytes.len() < 10 { WireError::Truncated } else { WireError::Varint })
    }

    #[inline]
    pub(super) fn tag(&mut self) -> Result<(u32, u8), WireError> {
        let tag = self.varint()?;
        let field = u32::try_from(tag >> 3).unwrap_or(0);
        if field == 0 { Err(WireError::FieldZero) } else { Ok((field, (tag & 7) as u8)) }
    }

    #[inline]
    fn take(&mut self, count: usize) -> Result<&'a [u8], WireError> {
        let (taken, rest) = self.bytes.split_at_checked(count).ok_or(WireError::Truncated)?;
        self.bytes = rest;
        Ok(taken)
    }

    #[inline]
    fn array<const N: usize>(&mut self) -> Result<[u8; N], WireError> {
        let (taken, rest) = self.bytes.split_first_chunk().ok_or(WireError::Truncated)?;
        self.bytes = rest;
        Ok(*taken)
    }

    #[inline]
    pub(super) fn delimited(&mut self) -> Result<&'a [u8], WireError> {
        let length = usize::try_from(self.varint()?).map_err(|_| WireError::Truncated)?;
        self.take(length)
    }

    #[inline]
    pub(super) fn skip(&mut self, field: u32, wire_type: u8) -> Result<(), WireError> {
        match wire_type {
            VARINT => self.varint().map(|_| ()),
            FIXED64 => self.take(8).map(|_| ()),
            DELIMITED => self.delimited().map(|_| ()),
            FIXED32 => self.take(4).map(|_| ()),
            START_GROUP => self.skip_group(field),
            _ => Err(WireError::WireType { field, wire_type }),
        }
    }

    /// Skips to the end of a group whose start tag has been read.
    fn skip_group(&mut self, field: u32) -> Result<(), WireError> {
        let mut open = [0; MAX_GROUPS];
        open[0] = field;
        let mut depth = 1;
        while depth > 0 {
            let (field, wire_type) = self.tag()?;
            match wire_type {
                START_GROUP if depth == MAX_GROUPS => return Err(WireError::Depth),
                START_GROUP => {
                    open[depth] = field;
                    depth += 1;
                }
                END_GROUP if open[depth - 1] != field => return Err(WireError::Group),
                END_GROUP => depth -= 1,
                _ => self.skip(field, wire_type)?,
            }
        }
        Ok(())
    }
}
