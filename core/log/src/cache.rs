//! Decoded segments, kept up to a fixed number of bytes.

use crate::segment::MessageRef;
use bytes::Bytes;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

/// A decoded segment as readers use it: messages of known channels, by time, ties in file order.
#[derive(Debug)]
pub(crate) struct Loaded {
    pub(crate) contents: Bytes,
    pub(crate) messages: Arc<[MessageRef]>,
}

impl Loaded {
    fn weight(&self) -> usize {
        self.contents.len() + std::mem::size_of_val::<[MessageRef]>(&self.messages)
    }
}

/// Least recently used goes first. One segment larger than the budget is kept alone.
#[derive(Debug)]
pub(crate) struct Cache {
    budget: usize,
    held: Mutex<Held>,
}

#[derive(Debug, Default)]
struct Held {
    weight: usize,
    clock: u64,
    segments: BTreeMap<u32, (u64, Arc<Loaded>)>,
}

impl Held {
    fn make_room(&mut self, weight: usize, budget: usize) {
        while self.weight + weight > budget {
            let oldest = self.segments.iter().min_by_key(|(_, (used, _))| *used).map(|(&key, _)| key);
            let Some((_, loaded)) = oldest.and_then(|key| self.segments.remove(&key)) else { return };
            self.weight -= loaded.weight();
        }
    }
}

impl Cache {
    pub(crate) fn new(budget: usize) -> Self {
        Self { budget, held: Mutex::default() }
    }

    fn with<T>(&self, f: impl FnOnce(&mut Held) -> T) -> T {
        f(&mut self.held.lock().unwrap_or_else(PoisonError::into_inner))
    }

    pub(crate) fn get(&self, segment: u32) -> Option<Arc<Loaded>> {
        self.with(|held| {
            held.clock += 1;
            let clock = held.clock;
            let (used, loaded) = held.segments.get_mut(&segment)?;
            *used = clock;
            Some(Arc::clone(loaded))
        })
    }

    /// Frees what a segment of that weight is about to need.
    pub(crate) fn make_room(&self, weight: usize) {
        self.with(|held| held.make_room(weight, self.budget));
    }

    pub(crate) fn insert(&self, segment: u32, loaded: &Arc<Loaded>) {
        self.with(|held| {
            if let Some((_, old)) = held.segments.remove(&segment) {
                held.weight -= old.weight();
            }
            held.make_room(loaded.weight(), self.budget);
            held.clock += 1;
            held.weight += loaded.weight();
            held.segments.insert(segment, (held.clock, Arc::clone(loaded)));
        });
    }

    /// Bytes held now.
    #[cfg(test)]
    pub(crate) fn weight(&self) -> usize {
        self.with(|held| held.weight)
    }
}
