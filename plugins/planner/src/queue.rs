//! The queue of the search: buckets of cells by estimate.
//!
//! A bucket holds estimates that differ by less than its width; its cells leave it in the reverse order of their
//! arrival. Buckets lie in a ring: all estimates in the queue must span fewer buckets than there are. Entries that left
//! are used again, so that the memory is that of the largest front.

/// Least width of a bucket as a power of two: 0.6 cells of cost 1.
const LEAST_WIDTH_BITS: u32 = 8;
/// Number of buckets.
const BUCKETS: usize = 512;
const WORDS: usize = BUCKETS / 64;
const NONE: u32 = u32::MAX;

/// A cell in the queue.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Entry {
    pub(crate) column: u16,
    pub(crate) row: u16,
    /// Its cost from the start when it was queued; the entry is void if it has been reached more cheaply since.
    pub(crate) reached: u32,
    next: u32,
}

#[derive(Clone, Debug)]
pub(crate) struct Queue {
    entries: Vec<Entry>,
    /// First of the entries that are not in use.
    unused: u32,
    /// First entry of each bucket.
    heads: [u32; BUCKETS],
    /// One bit for each bucket that may have entries.
    filled: [u64; WORDS],
    /// Width of a bucket as a power of two.
    width_bits: u32,
}

impl Default for Queue {
    fn default() -> Self {
        Self { entries: Vec::new(), unused: NONE, heads: [NONE; BUCKETS], filled: [0; WORDS], width_bits: 0 }
    }
}

impl Queue {
    /// Empties the queue; its memory stays. Estimates that will be in it at once differ by at most `span`, for which the
    /// buckets are wide enough. In narrow ones, few cells leave the queue before their cheapest way is known.
    pub(crate) fn clear(&mut self, cells: usize, span: u32) {
        let within = (BUCKETS - 2) as u32;
        self.width_bits = (LEAST_WIDTH_BITS..u32::BITS).find(|bits| span >> bits < within).unwrap_or(0);
        self.entries.clear();
        self.entries.reserve(cells);
        self.unused = NONE;
        self.heads.fill(NONE);
        self.filled.fill(0);
    }

    /// Number of entries for which there is memory.
    #[cfg(test)]
    pub(crate) fn capacity(&self) -> usize {
        self.entries.capacity()
    }

    /// Number of the bucket of an estimate.
    #[inline]
    pub(crate) fn bucket_of(&self, estimate: u32) -> usize {
        (estimate >> self.width_bits) as usize
    }

    #[inline]
    pub(crate) fn push(&mut self, estimate: u32, column: u16, row: u16, reached: u32) {
        let slot = self.bucket_of(estimate) % BUCKETS;
        let entry = Entry { column, row, reached, next: self.heads[slot] };
        let place = self.unused;
        if let Some(unused) = self.entries.get_mut(place as usize) {
            self.unused = unused.next;
            *unused = entry;
            self.heads[slot] = place;
        } else {
            self.heads[slot] = self.entries.len() as u32;
            self.entries.push(entry);
        }
        self.filled[slot / 64] |= 1 << (slot % 64);
    }

    /// The last entry that arrived in a bucket.
    #[inline]
    pub(crate) fn pop(&mut self, bucket: usize) -> Option<Entry> {
        let slot = bucket % BUCKETS;
        let head = self.heads[slot];
        let Some(entry) = self.entries.get_mut(head as usize) else {
            self.filled[slot / 64] &= !(1 << (slot % 64));
            return None;
        };
        let popped = *entry;
        entry.next = self.unused;
        self.unused = head;
        self.heads[slot] = popped.next;
        Some(popped)
    }

    /// The first bucket from this one on that has entries.
    pub(crate) fn next_bucket(&self, bucket: usize) -> Option<usize> {
        let slot = bucket % BUCKETS;
        let mut word = slot / 64;
        let mut bits = self.filled[word] & (!0 << (slot % 64));
        for _ in 0..=WORDS {
            if bits != 0 {
                let found = word * 64 + bits.trailing_zeros() as usize;
                return Some(bucket + (found + BUCKETS - slot) % BUCKETS);
            }
            word = (word + 1) % WORDS;
            bits = self.filled[word];
        }
        None
    }
}
