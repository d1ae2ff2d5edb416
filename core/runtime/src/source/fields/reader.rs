//! What the reading threads of a log's fields have, and what they tell.

use super::FieldPoint;
use super::extract::Extractor;
use crate::source::series::SeriesWriter;
use rcs_formula::{Names, States};
use rcs_log::TopicId;
use rcs_msg::{AnyMessage, Schema, Stamp};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// What the reading thread tells.
#[derive(Default)]
pub(super) struct Told {
    pub(super) names: Names,
    pub(super) states: States,
    pub(super) reading: Option<f64>,
    /// Why there are no values, or those of some messages alone.
    pub(super) problem: Option<Arc<str>>,
    /// What is said of messages without a value, as far as they have been read.
    pub(super) lacking: Option<Arc<str>>,
}

impl Told {
    /// Why there are no values, or not all of them.
    pub(super) fn problem(&self) -> Option<Arc<str>> {
        self.problem.clone().or_else(|| self.lacking.clone())
    }
}

pub(super) fn lock(told: &Mutex<Told>) -> MutexGuard<'_, Told> {
    told.lock().unwrap_or_else(PoisonError::into_inner)
}

/// One field as the reading thread has it.
pub(super) struct Reader {
    pub(super) extractor: Extractor,
    pub(super) points: Arc<SeriesWriter<FieldPoint>>,
    pub(super) told: Arc<Mutex<Told>>,
}

impl Reader {
    /// Whether the points are held by anyone but the reading thread: until the field is removed.
    pub(super) fn is_wanted(&self) -> bool {
        Arc::strong_count(&self.points) > 1
    }

    pub(super) fn take(&mut self, stamp: Stamp, message: &AnyMessage) {
        let value = self.extractor.read(message);
        self.points.append(FieldPoint { stamp, value });
    }

    pub(super) fn tell(&self, reading: Option<f64>) {
        let mut told = lock(&self.told);
        told.reading = reading;
        told.lacking = self.extractor.lacking();
        if !Arc::ptr_eq(&told.names, &self.extractor.names) {
            told.names = Arc::clone(&self.extractor.names);
        }
    }
}

/// A topic of the log with the fields that are read from it.
pub(super) struct Wanted {
    pub(super) schema: Arc<Schema>,
    pub(super) ids: Vec<TopicId>,
    pub(super) readers: Vec<Reader>,
}
