//! Statistics of a window that moves along points.
//!
//! A queue of two stacks keeps the statistics of its content by joining parts only: nothing is subtracted, so a large
//! offset of the values costs no precision, and the work per point is constant on average.

use crate::moments::Moments;
use crate::points::Points;
use rcs_msg::Stamp;

/// A queue that knows the statistics of its content.
#[derive(Default)]
struct Queue {
    /// The older part, newest first; each with the statistics of itself and all newer ones of this part.
    out: Vec<Moments>,
    /// The newer part, oldest first.
    fresh: Vec<Moments>,
    /// The statistics of the newer part.
    all_fresh: Option<Moments>,
}

impl Queue {
    fn push(&mut self, point: Moments) {
        self.fresh.push(point);
        self.all_fresh = Some(self.all_fresh.map_or(point, |all| all.join(point)));
    }

    /// Removes the oldest point.
    fn pop(&mut self) {
        if self.out.is_empty() {
            self.all_fresh = None;
            for point in self.fresh.drain(..).rev() {
                let all = self.out.last().map_or(point, |newer| point.join(*newer));
                self.out.push(all);
            }
        }
        self.out.pop();
    }

    fn all(&self) -> Option<Moments> {
        match (self.out.last(), self.all_fresh) {
            (Some(old), Some(new)) => Some(old.join(new)),
            (old, new) => old.copied().or(new),
        }
    }
}

/// For each point, `read` of the statistics of the points at most half of `width_s` away; NaN where the value itself is
/// not finite.
pub(crate) fn moving(points: &Points, width_s: f64, read: impl Fn(&Moments) -> Option<f64>) -> Vec<f64> {
    let half_ns = (width_s * 0.5e9).round().clamp(0.0, 1e18) as u64;
    let mut queue = Queue::default();
    let (mut from, mut to) = (0, 0);
    let mut result = Vec::with_capacity(points.len());
    for (&Stamp(stamp), value) in points.stamps.iter().zip(points.values.iter()) {
        while points.stamps.get(to).is_some_and(|other| other.0 <= stamp.saturating_add(half_ns)) {
            queue.push(Moments::of(points.stamps[to], points.values[to]));
            to += 1;
        }
        while points.stamps[from].0 < stamp.saturating_sub(half_ns) {
            queue.pop();
            from += 1;
        }
        let of = queue.all().filter(|_| value.is_finite());
        result.push(of.and_then(|moments| read(&moments)).unwrap_or(f64::NAN));
    }
    result
}
