//! Values in time.

use rcs_msg::Stamp;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Names of whole numbers: the states of an enum, `false` and `true`, or texts. Empty for quantities.
pub type Names = Arc<BTreeMap<i64, Arc<str>>>;

/// The names of all states of an enum, also of those that no value has had. Empty for everything else.
pub type States = Arc<[String]>;

/// What the times of points mean.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Over {
    /// Times.
    #[default]
    Time,
    /// Frequencies: 1 Hz is a second.
    Frequency,
}

/// Values in ascending order of time. Equal times are allowed. A value that is not finite is a gap.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Points {
    /// When, ascending.
    pub stamps: Arc<[Stamp]>,
    /// The value at each time.
    pub values: Arc<[f64]>,
    /// Names of the values, if they are states or texts.
    pub names: Names,
    /// The names of all states, where the values are those of an enum whose definition is known; otherwise empty.
    pub states: States,
    /// Whether the times are frequencies.
    pub over: Over,
    /// The whole number at each time, where a field has numbers that are too large for `values` to hold exactly (from
    /// 2^53); otherwise empty.
    pub whole: Arc<[Option<i128>]>,
}

impl Points {
    /// Quantities at times.
    pub fn new(stamps: impl Into<Arc<[Stamp]>>, values: impl Into<Arc<[f64]>>) -> Self {
        let (stamps, values) = (stamps.into(), values.into());
        debug_assert_eq!(stamps.len(), values.len());
        Self { stamps, values, ..Self::default() }
    }

    /// Quantities at times in seconds.
    pub fn from_seconds(points: &[(f64, f64)]) -> Self {
        let stamps: Vec<Stamp> = points.iter().map(|(t, _)| Stamp((t * 1e9) as u64)).collect();
        let values: Vec<f64> = points.iter().map(|(_, value)| *value).collect();
        Self::new(stamps, values)
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.stamps.len()
    }

    /// Whether there is no point.
    pub fn is_empty(&self) -> bool {
        self.stamps.is_empty()
    }

    /// Whether the values are states or texts, which hold until the next one.
    pub fn are_states(&self) -> bool {
        !self.names.is_empty()
    }

    /// The name of a value, if it is a state or a text.
    pub fn name(&self, value: f64) -> Option<&Arc<str>> {
        self.names.get(&(value as i64)).filter(|_| value.is_finite())
    }

    /// The exact value at an index, where [`Points::whole`] has it.
    pub fn whole_at(&self, index: usize) -> Option<i128> {
        self.whole.get(index).copied().flatten()
    }

    /// The same times with other values.
    #[must_use]
    pub fn with(&self, values: Vec<f64>) -> Self {
        debug_assert_eq!(self.len(), values.len());
        let stamps = Arc::clone(&self.stamps);
        Self { over: self.over, ..Self::new(stamps, values) }
    }

    /// These values as truth: 0 is `false`, all others `true`.
    #[must_use]
    pub fn as_truth(self) -> Self {
        let names = [(0, "false".into()), (1, "true".into())];
        Self { names: Arc::new(names.into()), states: Arc::default(), whole: Arc::default(), ..self }
    }

    /// The values at other times: interpolated linearly, or for states the last one; NaN outside of the known times.
    /// Of several values at one time the last counts.
    pub fn at(&self, stamps: &Arc<[Stamp]>) -> Arc<[f64]> {
        if Arc::ptr_eq(&self.stamps, stamps) || self.stamps == *stamps {
            return Arc::clone(&self.values);
        }
        let states = self.are_states();
        // The number of points up to the time; both series ascend, so it only grows.
        let mut upto = 0;
        let at = |stamp: &Stamp| {
            while self.stamps.get(upto).is_some_and(|known| known <= stamp) {
                upto += 1;
            }
            let Some(before) = upto.checked_sub(1) else { return f64::NAN };
            let (from, value) = (self.stamps[before], self.values[before]);
            if from == *stamp || states {
                return value;
            }
            let Some(&to) = self.stamps.get(upto) else { return f64::NAN };
            let same_time = self.stamps[upto..].iter().take_while(|stamp| **stamp == to).count();
            let next = self.values[upto + same_time - 1];
            value + (next - value) * (stamp.0 - from.0) as f64 / (to.0 - from.0) as f64
        };
        stamps.iter().map(at).collect()
    }
}
