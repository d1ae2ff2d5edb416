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

/// A random number for a seed and a counter (`SplitMix64`, Steele et al. 2014).
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
        Value::Message(fields) => fields.iter_mut().map(|(_, field)| fill_nan(field)).sum(),
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
