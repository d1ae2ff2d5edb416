//! Points in time.

use prost_types::Timestamp;
use serde::{Deserialize, Serialize};

/// A point in time: nanoseconds since the epoch of its clock (Unix for a robot, 0 for a simulation).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct Stamp(pub u64);

impl Stamp {
    /// The greatest time.
    pub const MAX: Stamp = Stamp(u64::MAX);

    /// The time `ns` later; saturates at the greatest time.
    #[must_use]
    pub const fn after_ns(self, ns: u64) -> Stamp {
        Stamp(self.0.saturating_add(ns))
    }

    /// The time `ns` earlier; saturates at 0.
    #[must_use]
    pub const fn before_ns(self, ns: u64) -> Stamp {
        Stamp(self.0.saturating_sub(ns))
    }

    /// Seconds since `other`, negative if it is later.
    pub fn seconds_since(self, other: Stamp) -> f64 {
        if self >= other { (self.0 - other.0) as f64 * 1e-9 } else { -((other.0 - self.0) as f64 * 1e-9) }
    }

    /// The time as a protobuf timestamp.
    pub fn to_proto(self) -> Timestamp {
        Timestamp { seconds: (self.0 / 1_000_000_000) as i64, nanos: (self.0 % 1_000_000_000) as i32 }
    }

    /// The time of a protobuf timestamp; `None` before 1970, or with nanoseconds out of range.
    pub fn from_proto(timestamp: &Timestamp) -> Option<Stamp> {
        let seconds = u64::try_from(timestamp.seconds).ok()?;
        let nanos = u64::try_from(timestamp.nanos).ok().filter(|&n| n < 1_000_000_000)?;
        seconds.checked_mul(1_000_000_000)?.checked_add(nanos).map(Stamp)
    }
}

impl std::fmt::Display for Stamp {
    /// Seconds with three decimals.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}.{:03} s", self.0 / 1_000_000_000, self.0 / 1_000_000 % 1000)
    }
}
