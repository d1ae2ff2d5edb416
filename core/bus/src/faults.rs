//! Faults on demand: what a test makes go wrong with a process or a buffer, on purpose.
//!
//! A fault is an override ([`crate::OverrideValue::Fault`]), so that it is set, listed, released, saved and repeated like
//! one. Faults of messages (frozen, NaN, dropped) take effect where a buffer is published; messages of the operator pass.
//! Those of time (stopped, slowed, late) take effect in the executor, which reads them with [`crate::Buffer::faults`].

use crate::tree::{BoxError, from_tree};
use rcs_msg::{AnyMessage, FieldPath, Number, Packed, Value};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// What goes wrong.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Fault {
    /// Its kind.
    pub kind: FaultKind,
    /// The process that it was requested for; empty if it was requested for one buffer.
    pub process: Arc<str>,
}

/// The kinds of faults.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum FaultKind {
    /// The cycles of a process do not run. Held by its status buffer.
    Stopped,
    /// Each cycle of a process takes that much longer. Held by its status buffer.
    Slowed {
        /// In nanoseconds.
        delay_ns: u64,
    },
    /// Each message is replaced by the newest message before the fault; without one, nothing is published.
    Frozen,
    /// The floating-point numbers of a field become NaN; of the root, those of the complete message.
    Nan {
        /// The field.
        path: String,
    },
    /// Messages are not published.
    Dropped {
        /// Which ones.
        loss: Loss,
        /// Messages since the fault was set.
        seen: u64,
    },
    /// Messages become visible that much later.
    Late {
        /// In nanoseconds.
        delay_ns: u64,
    },
}

/// Which messages are dropped.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Loss {
    /// Every message whose number is a multiple of this; 1 for all.
    Every(u32),
    /// Each one with a probability. The choice depends on the seed and the number of the message alone.
    Random {
        /// From 0 to 1.
        probability: f64,
        /// The seed.
        seed: u64,
    },
}

impl Loss {
    /// Whether the message with this number, which counts from 1, is dropped.
    fn drops(self, number: u64) -> bool {
        match self {
            Loss::Every(every) => number.is_multiple_of(u64::from(every.max(1))),
            Loss::Random { probability, seed } => {
                (mixed(seed, number) >> 11) as f64 / ((1_u64 << 53) as f64) < probability
            }
        }
    }
}

/// A random number for a seed and a counter (`SplitMix64`, Steele 2014).
fn mixed(seed: u64, counter: u64) -> u64 {
    let mut z = seed.wrapping_add(counter.wrapping_mul(0x9e37_79b9_7f4a_7c15));
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

impl Fault {
    /// Whether it is of the same kind and for the same target, so that a new one replaces it.
    pub fn is_like(&self, other: &Self) -> bool {
        let same_field = match (&self.kind, &other.kind) {
            (FaultKind::Nan { path: a }, FaultKind::Nan { path: b }) => a == b,
            (a, b) => std::mem::discriminant(a) == std::mem::discriminant(b),
        };
        same_field && self.process == other.process
    }

    /// What becomes of a message that is published after `newest`; `None` if nothing is published.
    pub(crate) fn apply(
        &mut self,
        message: AnyMessage,
        newest: Option<&AnyMessage>,
    ) -> Result<Option<AnyMessage>, BoxError> {
        match &mut self.kind {
            FaultKind::Frozen => Ok(newest.cloned()),
            FaultKind::Dropped { loss, seen } => {
                *seen += 1;
                Ok((!loss.drops(*seen)).then_some(message))
            }
            FaultKind::Nan { path } => {
                let path: FieldPath = path.parse()?;
                let mut tree = message.value()?;
                let count = put_nan(&mut tree, &path)?;
                match (count, self.process.is_empty()) {
                    (0, true) => Err(format!("nothing in {path} can be NaN").into()),
                    (0, false) if holds_whole_numbers(&tree) => {
                        Err("its cells are whole numbers, which cannot be NaN; nothing was changed".into())
                    }
                    // Of a process, the outputs that have no such number pass.
                    (0, false) => Ok(Some(message)),
                    _ => from_tree(&message.schema(), &tree).map(Some),
                }
            }
            // They take effect in the executor.
            FaultKind::Stopped | FaultKind::Slowed { .. } | FaultKind::Late { .. } => Ok(Some(message)),
        }
    }
}

/// Sets the floating-point numbers at a path to NaN, and returns their number.
fn put_nan(tree: &mut Value, path: &FieldPath) -> Result<usize, BoxError> {
    if path.segments().is_empty() {
        return Ok(fill_nan(tree));
    }
    let mut part = tree.get(path)?.into_owned();
    let count = fill_nan(&mut part);
    if count > 0 {
        tree.set(path, part)?;
    }
    Ok(count)
}

fn fill_nan(value: &mut Value) -> usize {
    match value {
        Value::Float(number) => {
            *number = f64::NAN;
            1
        }
        Value::List(list) => list.iter_mut().map(fill_nan).sum(),
        Value::Message(fields) => {
            let in_bytes = fill_bytes(fields);
            in_bytes + fields.iter_mut().map(|(_, field)| fill_nan(field)).sum::<usize>()
        }
        Value::Packed(packed) => {
            let data: Vec<u8> = match packed.number() {
                Number::F32 => f32::NAN.to_le_bytes().repeat(packed.len()),
                Number::F64 => f64::NAN.to_le_bytes().repeat(packed.len()),
                _ => return 0,
            };
            let count = packed.len();
            *packed = Packed::new(packed.number(), false, data.into());
            count
        }
        _ => 0,
    }
}

/// A number within bytes: its offset, and whether it has 64 bits.
type Place = (usize, bool);

/// The floating-point numbers that a message says to hold as bytes in its field `data`: those of a cell or point, and
/// the distance between cells; `None` if it holds none in this way. Grids and clouds name their fields with offset and
/// type, images have an encoding.
fn places(fields: &[(String, Value)]) -> Option<(Vec<Place>, usize)> {
    let field = |name: &str| fields.iter().rev().find(|(known, _)| known == name).map(|(_, value)| value);
    let number = |value: &Value| value.as_f64().map(|number| number as usize);
    match field("encoding").and_then(Value::as_text) {
        Some("32FC1") => return Some((vec![(0, false)], 4)),
        Some("64FC1") => return Some((vec![(0, true)], 8)),
        _ => {}
    }
    let stride = field("cell_stride").or_else(|| field("point_stride")).and_then(number)?;
    let Some(Value::List(list)) = field("fields") else { return None };
    let place = |packed: &Value| {
        let (offset, kind) = (number(packed.field("offset")?)?, number(packed.field("type")?)?);
        // `foxglove.PackedElementField.NumericType`: FLOAT32 and FLOAT64.
        let is_wide = match kind {
            7 => false,
            8 => true,
            _ => return None,
        };
        (offset + if is_wide { 8 } else { 4 } <= stride).then_some((offset, is_wide))
    };
    let places: Vec<Place> = list.iter().filter_map(place).collect();
    (!places.is_empty()).then_some((places, stride))
}

/// Sets the floating-point numbers in the bytes of a message to NaN, and returns their number.
fn fill_bytes(fields: &mut [(String, Value)]) -> usize {
    let Some((places, stride)) = places(fields) else { return 0 };
    let Some((_, Value::Bytes(data))) = fields.iter_mut().rev().find(|(name, _)| name == "data") else {
        return 0;
    };
    let mut bytes = data.to_vec();
    let mut count = 0;
    for cell in bytes.chunks_exact_mut(stride) {
        for &(offset, is_wide) in &places {
            if is_wide {
                cell[offset..offset + 8].copy_from_slice(&f64::NAN.to_le_bytes());
            } else {
                cell[offset..offset + 4].copy_from_slice(&f32::NAN.to_le_bytes());
            }
            count += 1;
        }
    }
    *data = bytes.into();
    count
}

/// Whether a message has cells, points or pixels without any floating-point number.
fn holds_whole_numbers(value: &Value) -> bool {
    let Value::Message(fields) = value else { return false };
    let has = |name: &str| fields.iter().any(|(known, _)| known == name);
    has("data") && (has("encoding") || has("fields")) && places(fields).is_none()
        || fields.iter().any(|(_, field)| holds_whole_numbers(field))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcs_msg::foxglove::{Grid, PackedElementField, RawImage};

    fn nan(message: &AnyMessage, path: &str) -> Result<Option<AnyMessage>, BoxError> {
        let kind = FaultKind::Nan { path: path.to_owned() };
        Fault { kind, process: "wm1".into() }.apply(message.clone(), None)
    }

    fn grid(kind: i32) -> AnyMessage {
        let field = |name: &str, offset, kind| PackedElementField { name: name.into(), offset, r#type: kind };
        let data: Vec<u8> = (0..3_u8).flat_map(|cell| [cell, 0, 0, 0, 0]).collect();
        AnyMessage::new(Grid {
            column_count: 3,
            cell_stride: 5,
            row_stride: 15,
            fields: vec![field("cost", 0, 1), field("height", 1, kind)],
            data: data.into(),
            ..Grid::default()
        })
    }

    #[test]
    fn floating_point_numbers_in_the_bytes_of_cells_become_nan_and_others_stay() {
        let changed = nan(&grid(7), "").unwrap().unwrap().to::<Grid>().unwrap();
        for (index, cell) in changed.data.chunks_exact(5).enumerate() {
            assert_eq!(cell[0], index as u8, "the cost is a whole number");
            assert!(f32::from_le_bytes(cell[1..].try_into().unwrap()).is_nan());
        }
        // A type of 64 bits does not fit into the cell, and whole numbers cannot be NaN: neither is changed.
        for kind in [8, 5] {
            let refused = nan(&grid(kind), "").unwrap_err().to_string();
            assert!(refused.contains("whole numbers"), "{refused}");
        }
    }

    #[test]
    fn depths_become_nan_and_the_bytes_of_a_colour_image_are_refused() {
        let image = |encoding: &str| {
            let data = [1.5_f32, 2.5].iter().flat_map(|depth| depth.to_le_bytes()).collect::<Vec<u8>>();
            let (width, height, step) = (2, 1, 8);
            let data = data.into();
            AnyMessage::new(RawImage {
                width,
                height,
                step,
                data,
                encoding: encoding.into(),
                ..RawImage::default()
            })
        };
        let changed = nan(&image("32FC1"), "").unwrap().unwrap().to::<RawImage>().unwrap();
        assert!(
            changed
                .data
                .chunks_exact(4)
                .all(|depth| { f32::from_le_bytes(depth.try_into().unwrap()).is_nan() })
        );
        assert!(nan(&image("rgb8"), "").is_err());
    }
}
