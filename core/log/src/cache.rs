//! A cache of decoded segments with a fixed budget in bytes.

use crate::segment::MessageRef;
use bytes::Bytes;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

/// A decoded segment: messages of known channels, ordered by time, ties in file order.
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

/// Least recently used segments are dropped first. A segment that is larger than the budget is kept alone.
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

    /// Frees the memory that a segment of that size needs.
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
}

#[cfg(test)]
mod tests {
    use super::*;

    fn loaded(bytes: usize) -> Arc<Loaded> {
        Arc::new(Loaded { contents: vec![0; bytes].into(), messages: Arc::new([]) })
    }

    fn held(cache: &Cache) -> (usize, Vec<u32>) {
        cache.with(|held| (held.weight, held.segments.keys().copied().collect()))
    }

    #[test]
    fn what_is_held_stays_within_the_budget_and_the_least_recently_used_goes_first() {
        let cache = Cache::new(100);
        for segment in 0..3 {
            cache.insert(segment, &loaded(30));
        }
        assert!(cache.get(0).is_some());
        cache.insert(3, &loaded(30));
        assert_eq!(held(&cache), (90, vec![0, 2, 3]));
        cache.insert(3, &loaded(40));
        assert_eq!(held(&cache), (100, vec![0, 2, 3]));
        cache.make_room(60);
        assert_eq!(held(&cache), (40, vec![3]));
    }

    #[test]
    fn a_segment_larger_than_the_budget_is_held_alone() {
        let cache = Cache::new(100);
        cache.insert(0, &loaded(30));
        cache.insert(1, &loaded(500));
        assert_eq!(held(&cache), (500, vec![1]));
        cache.insert(2, &loaded(30));
        assert_eq!(held(&cache), (30, vec![2]));
    }
}
