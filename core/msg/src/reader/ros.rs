//! Messages of ROS: a bounds-checked cursor, and a reader by layout.
//!
//! | | ROS 2: Common Data Representation, plain XCDR version 1 | ROS 1 |
//! | --- | --- | --- |
//! | byte order | stated by 4 bytes before the message | little-endian |
//! | numbers | at multiples of their size, counted from the start of the message | follow each other without padding |
//! | texts | end with a zero, which their length counts | without a zero |

use super::rosmsg::{Count, Element, Field, Layout, Wire};
use crate::packed::{Number, Packed, Scalar};
use crate::value::Value;
use bytes::Bytes;

/// A message with more parts than this is refused: a part takes some hundred bytes of memory for as little as one byte
/// of the message. An array of numbers counts as one part.
const MAX_PARTS: usize = 4_000_000;

/// Most bytes of a CDR message without fields: its header, one byte, and padding up to a multiple of four.
const MAX_EMPTY: usize = 8;

/// Why bytes are not a message of a layout.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum RosError {
    #[error("got encapsulation {got:#06x}, expected 0x0000 or 0x0001, plain CDR")]
    Encapsulation { got: u16 },
    #[error(
        "got a message that rosbag2 has compressed (compression mode `message`), expected plain CDR; \
         `ros2 bag convert` writes a recording without compression"
    )]
    Compressed,
    #[error("got {left} bytes, expected {needed} more at byte {at}")]
    Truncated { at: usize, needed: usize, left: usize },
    #[error("got more than {MAX_PARTS} parts in one message")]
    TooLarge,
    #[error("got {got} bytes, expected at most {MAX_EMPTY}: its definition has no fields")]
    NotEmpty { got: usize },
}

/// Reads values in sequence.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cursor<'a> {
    /// The message behind the encapsulation header of CDR.
    body: &'a [u8],
    at: usize,
    big_endian: bool,
    wire: Wire,
}

/// Size of the encapsulation header of CDR, bytes.
const HEADER: usize = 4;
/// The first bytes of what zstd has compressed.
const ZSTD: [u8; HEADER] = [0x28, 0xb5, 0x2f, 0xfd];

impl<'a> Cursor<'a> {
    /// A cursor at the start of the message.
    pub(crate) fn new(bytes: &'a [u8], wire: Wire) -> Result<Self, RosError> {
        if wire == Wire::Ros1 {
            return Ok(Self { body: bytes, at: 0, big_endian: false, wire });
        }
        let Some((header, body)) = bytes.split_first_chunk::<HEADER>() else {
            return Err(RosError::Truncated { at: 0, needed: HEADER, left: bytes.len() });
        };
        if *header == ZSTD {
            return Err(RosError::Compressed);
        }
        match u16::from_be_bytes([header[0], header[1]]) {
            kind @ (0 | 1) => Ok(Self { body, at: 0, big_endian: kind == 0, wire }),
            got => Err(RosError::Encapsulation { got }),
        }
    }

    /// Byte order of the message.
    pub(crate) fn big_endian(&self) -> bool {
        self.big_endian
    }

    /// How the message is laid out.
    pub(crate) fn wire(&self) -> Wire {
        self.wire
    }

    /// Where the next value is read, or its padding, counted from the start of the whole message.
    pub(crate) fn position(&self) -> usize {
        self.whole(self.at)
    }

    /// A position in the whole message, including the encapsulation header.
    fn whole(&self, at: usize) -> usize {
        match self.wire {
            Wire::Cdr => at + HEADER,
            Wire::Ros1 => at,
        }
    }

    /// The next `count` numbers in wire layout; skips padding before them. There is padding only if a number follows.
    pub(crate) fn numbers(&mut self, number: Number, count: usize) -> Result<&'a [u8], RosError> {
        if count == 0 {
            return Ok(&[]);
        }
        let start = match self.wire {
            Wire::Cdr => self.at.next_multiple_of(number.size()),
            Wire::Ros1 => self.at,
        };
        let left = self.body.len().saturating_sub(start);
        let needed = count.saturating_mul(number.size());
        if needed > left {
            return Err(RosError::Truncated { at: self.whole(start), needed, left });
        }
        self.at = start + needed;
        Ok(&self.body[start..self.at])
    }

    fn fixed<const N: usize>(&mut self, number: Number) -> Result<[u8; N], RosError> {
        let at = self.whole(self.at);
        let bytes = self.numbers(number, 1)?;
        let mut out: [u8; N] =
            bytes.try_into().map_err(|_| RosError::Truncated { at, needed: N, left: bytes.len() })?;
        if self.big_endian {
            out.reverse();
        }
        Ok(out)
    }

    pub(crate) fn u8(&mut self) -> Result<u8, RosError> {
        self.fixed(Number::U8).map(u8::from_le_bytes)
    }

    pub(crate) fn i8(&mut self) -> Result<i8, RosError> {
        self.fixed(Number::I8).map(i8::from_le_bytes)
    }

    pub(crate) fn u16(&mut self) -> Result<u16, RosError> {
        self.fixed(Number::U16).map(u16::from_le_bytes)
    }

    pub(crate) fn i32(&mut self) -> Result<i32, RosError> {
        self.fixed(Number::I32).map(i32::from_le_bytes)
    }

    pub(crate) fn u32(&mut self) -> Result<u32, RosError> {
        self.fixed(Number::U32).map(u32::from_le_bytes)
    }

    pub(crate) fn f32(&mut self) -> Result<f32, RosError> {
        self.fixed(Number::F32).map(f32::from_le_bytes)
    }

    pub(crate) fn f64(&mut self) -> Result<f64, RosError> {
        self.fixed(Number::F64).map(f64::from_le_bytes)
    }

    /// Reads the length of a sequence whose elements take at least `size` bytes each; refuses lengths beyond the
    /// message.
    pub(crate) fn length(&mut self, size: usize) -> Result<usize, RosError> {
        let length = self.u32()? as usize;
        let (needed, left) = (length.saturating_mul(size), self.body.len() - self.at);
        if needed > left {
            Err(RosError::Truncated { at: self.whole(self.at), needed, left })
        } else {
            Ok(length)
        }
    }

    /// The bytes of a text, without the terminating zero of CDR.
    pub(crate) fn text(&mut self) -> Result<&'a [u8], RosError> {
        let length = self.length(1)?;
        let bytes = self.numbers(Number::U8, length)?;
        Ok(match self.wire {
            Wire::Cdr => bytes.strip_suffix(&[0]).unwrap_or(bytes),
            Wire::Ros1 => bytes,
        })
    }

    /// A text in which invalid UTF-8 is replaced.
    pub(crate) fn string(&mut self) -> Result<String, RosError> {
        self.text().map(|bytes| String::from_utf8_lossy(bytes).into_owned())
    }

    /// The characters of a wide text, 4 bytes each as ROS 2's Fast CDR writes them.
    pub(crate) fn wide_text(&mut self) -> Result<&'a [u8], RosError> {
        let length = self.length(4)?;
        self.numbers(Number::U32, length)
    }

    /// A sequence of bytes.
    pub(crate) fn bytes(&mut self) -> Result<&'a [u8], RosError> {
        let length = self.length(1)?;
        self.numbers(Number::U8, length)
    }

    /// Skips a field with everything nested in it.
    pub(crate) fn skip(&mut self, layout: &Layout, field: &Field) -> Result<(), RosError> {
        let count = self.count(field)?;
        match field.element {
            Element::Number(number) => self.numbers(number, count).map(|_| ()),
            element => (0..count).try_for_each(|_| self.skip_element(layout, element)),
        }
    }

    /// Skips one element of a field.
    pub(crate) fn skip_element(&mut self, layout: &Layout, element: Element) -> Result<(), RosError> {
        match element {
            Element::Number(number) => self.numbers(number, 1).map(|_| ()),
            Element::Text => self.text().map(|_| ()),
            Element::WideText => self.wide_text().map(|_| ()),
            Element::Message(index) => {
                layout.message(index).iter().try_for_each(|field| self.skip(layout, field))
            }
        }
    }

    /// Number of elements of a field that follow; reads and checks the length if it is on the wire.
    pub(crate) fn count(&mut self, field: &Field) -> Result<usize, RosError> {
        match field.count {
            Count::One => Ok(1),
            Count::Fixed(length) => Ok(length),
            Count::Sequence => self.length(match field.element {
                Element::Number(number) => number.size(),
                Element::Text | Element::WideText => 4,
                Element::Message(_) => 1,
            }),
        }
    }
}

/// Reads a message by its layout; arrays of numbers share `bytes`.
pub(super) fn decode(layout: &Layout, bytes: &Bytes) -> Result<Value, RosError> {
    let mut decoder = Decoder { layout, bytes, cursor: Cursor::new(bytes, layout.wire())?, parts: 0 };
    // A definition that was not recorded looks like that of an empty message.
    if layout.is_empty_cdr() && bytes.len() > MAX_EMPTY {
        return Err(RosError::NotEmpty { got: bytes.len() });
    }
    decoder.message(layout.root())
}

struct Decoder<'a> {
    layout: &'a Layout,
    bytes: &'a Bytes,
    cursor: Cursor<'a>,
    parts: usize,
}

impl Decoder<'_> {
    fn message(&mut self, fields: &[Field]) -> Result<Value, RosError> {
        let mut out = Vec::with_capacity(fields.len());
        for field in fields {
            out.push((field.name.clone(), self.field(field)?));
        }
        Ok(Value::Message(out))
    }

    fn field(&mut self, field: &Field) -> Result<Value, RosError> {
        if field.count == Count::One {
            return self.element(field.element);
        }
        let count = self.cursor.count(field)?;
        if let Element::Number(number) = field.element {
            self.count_part()?;
            let data = self.bytes.slice_ref(self.cursor.numbers(number, count)?);
            return Ok(match number {
                Number::U8 => Value::Bytes(data),
                number => Value::Packed(Packed::new(number, self.cursor.big_endian(), data)),
            });
        }
        let mut list = Vec::new();
        for _ in 0..count {
            list.push(self.element(field.element)?);
        }
        Ok(Value::List(list))
    }

    fn element(&mut self, element: Element) -> Result<Value, RosError> {
        self.count_part()?;
        Ok(match element {
            Element::Number(number) => {
                let bytes = self.cursor.numbers(number, 1)?;
                number.read(bytes, self.cursor.big_endian()).map_or(Value::Null, Value::from)
            }
            Element::Text => Value::Text(self.cursor.string()?),
            Element::WideText => {
                let characters = Packed::new(
                    Number::U32,
                    self.cursor.big_endian(),
                    Bytes::copy_from_slice(self.cursor.wide_text()?),
                );
                let unit = |unit| if let Scalar::Uint(unit) = unit { unit as u16 } else { 0 };
                let units: Vec<u16> = characters.iter().map(unit).collect();
                Value::Text(String::from_utf16_lossy(&units))
            }
            Element::Message(index) => self.message(self.layout.message(index))?,
        })
    }

    fn count_part(&mut self) -> Result<(), RosError> {
        self.parts += 1;
        if self.parts > MAX_PARTS { Err(RosError::TooLarge) } else { Ok(()) }
    }
}
