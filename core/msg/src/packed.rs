//! Arrays of numbers in the layout of the message: a slice of its bytes instead of a list of values.

use bytes::Bytes;

/// Layout of one number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[expect(missing_docs, reason = "each is the Rust type of its name")]
pub enum Number {
    Bool,
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    U64,
    I64,
    F32,
    F64,
}

impl Number {
    /// Size of one number, bytes.
    pub const fn size(self) -> usize {
        match self {
            Self::Bool | Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
            Self::U64 | Self::I64 | Self::F64 => 8,
        }
    }

    /// Reads a number from exactly [`Self::size`] bytes; `None` for any other length.
    pub fn read(self, bytes: &[u8], big_endian: bool) -> Option<Scalar> {
        macro_rules! read {
            ($type:ty) => {{
                let bytes = bytes.try_into().ok()?;
                if big_endian { <$type>::from_be_bytes(bytes) } else { <$type>::from_le_bytes(bytes) }
            }};
        }
        Some(match self {
            Self::Bool => Scalar::Bool(read!(u8) != 0),
            Self::U8 => Scalar::Uint(read!(u8).into()),
            Self::I8 => Scalar::Int(read!(i8).into()),
            Self::U16 => Scalar::Uint(read!(u16).into()),
            Self::I16 => Scalar::Int(read!(i16).into()),
            Self::U32 => Scalar::Uint(read!(u32).into()),
            Self::I32 => Scalar::Int(read!(i32).into()),
            Self::U64 => Scalar::Uint(read!(u64)),
            Self::I64 => Scalar::Int(read!(i64)),
            Self::F32 => Scalar::Float(read!(f32).into()),
            Self::F64 => Scalar::Float(read!(f64)),
        })
    }

    /// The bytes of a number; `None` if it is of another type or out of range.
    fn write(self, value: Scalar, big_endian: bool) -> Option<Vec<u8>> {
        macro_rules! write {
            ($number:expr) => {{
                let number = $number;
                if big_endian { number.to_be_bytes().to_vec() } else { number.to_le_bytes().to_vec() }
            }};
        }
        let integer = || match value {
            Scalar::Int(v) => Some(i128::from(v)),
            Scalar::Uint(v) => Some(i128::from(v)),
            _ => None,
        };
        Some(match self {
            Self::Bool => match value {
                Scalar::Bool(v) => vec![u8::from(v)],
                _ => return None,
            },
            Self::U8 => write!(u8::try_from(integer()?).ok()?),
            Self::I8 => write!(i8::try_from(integer()?).ok()?),
            Self::U16 => write!(u16::try_from(integer()?).ok()?),
            Self::I16 => write!(i16::try_from(integer()?).ok()?),
            Self::U32 => write!(u32::try_from(integer()?).ok()?),
            Self::I32 => write!(i32::try_from(integer()?).ok()?),
            Self::U64 => write!(u64::try_from(integer()?).ok()?),
            Self::I64 => write!(i64::try_from(integer()?).ok()?),
            Self::F32 => write!(value.as_f64() as f32),
            Self::F64 => write!(value.as_f64()),
        })
    }
}

/// One number of an array; it converts to a [`Value`](crate::Value).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Scalar {
    /// A boolean.
    Bool(bool),
    /// A signed integer of any width.
    Int(i64),
    /// An unsigned integer of any width.
    Uint(u64),
    /// A floating-point number of any width.
    Float(f64),
}

impl Scalar {
    /// The number, rounded if it needs more than 53 bits; a boolean is 0 or 1.
    pub fn as_f64(self) -> f64 {
        match self {
            Self::Bool(v) => f64::from(u8::from(v)),
            Self::Int(v) => v as f64,
            Self::Uint(v) => v as f64,
            Self::Float(v) => v,
        }
    }
}

/// An array of numbers of one type, sharing the bytes of the message that it came from.
#[derive(Clone, Debug, PartialEq)]
pub struct Packed {
    number: Number,
    big_endian: bool,
    data: Bytes,
}

impl Packed {
    /// Contiguous numbers; a remainder shorter than one number is dropped.
    pub fn new(number: Number, big_endian: bool, mut data: Bytes) -> Self {
        data.truncate(data.len() / number.size() * number.size());
        Self { number, big_endian, data }
    }

    /// Layout of each number.
    pub fn number(&self) -> Number {
        self.number
    }

    /// Number of elements.
    pub fn len(&self) -> usize {
        self.data.len() / self.number.size()
    }

    /// Whether the array is empty.
    pub fn is_empty(&self) -> bool {
        self.data.is_empty()
    }

    /// The number at `index`.
    pub fn get(&self, index: usize) -> Option<Scalar> {
        let start = index.checked_mul(self.number.size())?;
        self.number.read(self.data.get(start..start.checked_add(self.number.size())?)?, self.big_endian)
    }

    /// All numbers in order.
    pub fn iter(&self) -> impl Iterator<Item = Scalar> + '_ {
        self.data
            .chunks_exact(self.number.size())
            .filter_map(|bytes| self.number.read(bytes, self.big_endian))
    }

    /// Replaces a number; `false` if `index` is out of range or the number does not fit the type.
    pub(crate) fn set(&mut self, index: usize, value: Scalar) -> bool {
        let Some(bytes) = self.number.write(value, self.big_endian) else { return false };
        if index >= self.len() {
            return false;
        }
        let mut data = self.data.to_vec();
        data[index * bytes.len()..][..bytes.len()].copy_from_slice(&bytes);
        self.data = data.into();
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_read_in_both_byte_orders_and_change_one_at_a_time() {
        for big_endian in [false, true] {
            let bytes: Vec<u8> = [1u16, 0xfffe]
                .iter()
                .flat_map(|n| if big_endian { n.to_be_bytes() } else { n.to_le_bytes() })
                .collect();
            let mut packed = Packed::new(Number::I16, big_endian, bytes.into());
            assert_eq!(packed.iter().collect::<Vec<_>>(), [Scalar::Int(1), Scalar::Int(-2)]);
            assert!(packed.set(1, Scalar::Int(-7)));
            assert!(!packed.set(1, Scalar::Int(40_000)), "40,000 is no 16-bit integer");
            assert!(!packed.set(2, Scalar::Int(1)));
            assert_eq!((packed.get(1), packed.get(2)), (Some(Scalar::Int(-7)), None));
        }
    }
}
