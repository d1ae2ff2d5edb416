//! Semi-global matching (Hirschmüller 2008): aggregates the costs of each pixel along five paths: from the left, the
//! right, above and the two upper diagonals.
//!
//! On a path a change of the disparity by one costs `P1` and a larger change `P2`, so that surfaces stay connected
//! where the image has little texture. The cost of a pixel is half of a sum over 3×3 pixels: the absolute difference
//! after the Laplacian of Gaussian plus the clipped difference after the Gaussian alone. One pass goes from the first
//! row to the last; a row needs the costs of the row above on three paths.
//!
//! All costs are bytes: a pixel's cost is at most 127, and a path adds at most `P2`. Vectors run along the disparities
//! of one pixel, whose number is a multiple of 16.
//!
//! Cost: about 40 operations per pixel and disparity divided by the vector lanes. Rows depend on each other, so an
//! image is processed on one thread.

#![allow(clippy::inline_always, reason = "kernels are compiled anew for each width of vectors")]
#![allow(clippy::needless_range_loop, reason = "loops over lanes index several slices alike")]

use crate::checks::{Accept, sub_pixel};
use crate::prefilter::Filtered;
use crate::width::Kernel;

/// Radius of the window over which differences are summed, pixels.
pub(crate) const RADIUS: usize = 1;
/// Rows in the window.
const SIDE: usize = 2 * RADIUS + 1;
/// Largest absolute value of the filtered images, and largest difference of brightness, in steps of 4 grey levels. With
/// these, the sum of nine differences fits in a byte.
pub(crate) const CAP: u8 = 10;
pub(crate) const BRIGHTNESS_CAP: u8 = 8;
/// Penalty of a path for a change of disparity by one pixel, and for a larger change.
pub(crate) const P1: u8 = 20;
pub(crate) const P2: u8 = 80;
/// Greater than every cost: placed before the first and after the last disparity of a pixel.
const GUARD: u8 = u8::MAX;

/// Matches a pair into `out`, 1/16 pixel; columns left of `disparities - 1` have no disparity.
pub(crate) struct Image<'a> {
    pub(crate) left: &'a Filtered,
    pub(crate) right: &'a Filtered,
    pub(crate) width: usize,
    pub(crate) disparities: usize,
    pub(crate) accept: Accept,
    pub(crate) scratch: &'a mut Scratch,
    pub(crate) out: &'a mut [u16],
}

/// Working memory of one image, kept between frames.
#[derive(Clone, Debug, Default)]
pub(crate) struct Scratch {
    /// The right row, reversed.
    reversed: Vec<u8>,
    /// Absolute differences of the rows in the window, and their sums over the rows; indexed by column, disparity.
    differences: [Vec<u8>; SIDE],
    columns: Vec<u8>,
    /// Costs of one row, indexed by column, disparity.
    costs: Vec<u8>,
    /// Costs on the paths from the upper left, above and the upper right, of the row above and of the current one.
    above: [Path; 3],
    here: [Path; 3],
    /// Costs on the path along the row, of the previous pixel and of the current one.
    before: Path,
    now: Path,
    /// Sums over the paths, indexed by column, disparity.
    sums: Vec<u16>,
    disparity: Vec<u16>,
    right_best: Vec<u16>,
    right_disparity: Vec<u16>,
}

/// Costs on one path: a pixel is a guard followed by its disparities; a pixel without costs is placed at both ends.
#[derive(Clone, Debug, Default)]
struct Path {
    costs: Vec<u8>,
    least: Vec<u8>,
}

impl Path {
    fn clear(&mut self, pixels: usize, disparities: usize) {
        self.least.clear();
        self.least.resize(pixels, 0);
        self.costs.clear();
        self.costs.resize(pixels * (disparities + 1) + 1, 0);
        self.costs.iter_mut().step_by(disparities + 1).for_each(|guard| *guard = GUARD);
    }
}

impl Kernel for Image<'_> {
    #[inline(always)]
    fn run(self) {
        // The number of lanes is a constant that divides the disparities, so that no vector loop has a remainder.
        if self.disparities.is_multiple_of(64) {
            self.rows::<64>();
        } else if self.disparities.is_multiple_of(48) {
            self.rows::<48>();
        } else if self.disparities.is_multiple_of(32) {
            self.rows::<32>();
        } else {
            self.rows::<16>();
        }
    }
}

impl Image<'_> {
    #[inline(always)]
    fn rows<const LANES: usize>(self) {
        let Image { left, right, width, disparities, accept, scratch, out } = self;
        let first_column = disparities - 1;
        let n = width - first_column;
        scratch.clear(n, width, disparities);
        for (y, out) in (0_isize..).zip(out.chunks_exact_mut(width)) {
            // The first row fills the window; each later one adds one row of differences.
            let new = if y == 0 {
                -(RADIUS as isize)..=RADIUS as isize
            } else {
                y + RADIUS as isize..=y + RADIUS as isize
            };
            for row in new {
                let slot = &mut scratch.differences[(row + RADIUS as isize) as usize % SIDE];
                let columns = first_column..first_column + n + 2 * RADIUS;
                reverse(right.row(row), &mut scratch.reversed);
                differences::<LANES>(&left.row(row)[columns.clone()], &scratch.reversed, disparities, slot);
                reverse(right.brightness_row(row), &mut scratch.reversed);
                add_differences::<LANES>(
                    &left.brightness_row(row)[columns],
                    &scratch.reversed,
                    disparities,
                    slot,
                );
            }
            let [a, b, c] = &scratch.differences;
            sum_rows(a, b, c, &mut scratch.columns);
            sum_columns(&scratch.columns, disparities, &mut scratch.costs);
            scratch.paths_from_left_and_above::<LANES>(n, disparities);
            scratch.path_from_right_and_decide::<LANES>(disparities, accept, out);
            std::mem::swap(&mut scratch.above, &mut scratch.here);
        }
    }
}

impl Scratch {
    fn clear(&mut self, n: usize, width: usize, disparities: usize) {
        for row in &mut self.differences {
            row.resize((n + 2 * RADIUS) * disparities, 0);
        }
        self.columns.resize((n + 2 * RADIUS) * disparities, 0);
        self.costs.resize(n * disparities, 0);
        self.sums.resize(n * disparities, 0);
        for path in self.above.iter_mut().chain(&mut self.here) {
            path.clear(n + 2, disparities);
        }
        self.disparity.resize(n, 0);
        self.right_best.resize(width, 0);
        self.right_disparity.resize(width, 0);
    }

    #[inline(always)]
    fn paths_from_left_and_above<const LANES: usize>(&mut self, n: usize, disparities: usize) {
        self.before.clear(1, disparities);
        self.now.clear(1, disparities);
        let [upper_left, upper, upper_right] = &self.above;
        let [to_lower_right, to_lower, to_lower_left] = &mut self.here;
        for x in 0..n {
            let cost = &self.costs[x * disparities..][..disparities];
            // Pixel x of a row has index x + 1 in its paths.
            step::<LANES>(cost, upper_left, x, to_lower_right, x + 1);
            step::<LANES>(cost, upper, x + 1, to_lower, x + 1);
            step::<LANES>(cost, upper_right, x + 2, to_lower_left, x + 1);
            step::<LANES>(cost, &self.before, 0, &mut self.now, 0);
            let at = (x + 1) * (disparities + 1);
            sum_paths::<LANES>(
                &to_lower_right.costs[at + 1..],
                &to_lower.costs[at + 1..],
                &to_lower_left.costs[at + 1..],
                &self.now.costs[1..],
                &mut self.sums[x * disparities..][..disparities],
            );
            std::mem::swap(&mut self.before, &mut self.now);
        }
    }

    #[inline(always)]
    fn path_from_right_and_decide<const LANES: usize>(
        &mut self,
        disparities: usize,
        accept: Accept,
        out: &mut [u16],
    ) {
        let first_column = disparities - 1;
        let (blind, out) = out.split_at_mut(first_column);
        blind.fill(crate::NO_DISPARITY);
        self.before.clear(1, disparities);
        self.now.clear(1, disparities);
        self.right_best.fill(u16::MAX);
        self.right_disparity.fill(0);
        for x in (0..out.len()).rev() {
            let cost = &self.costs[x * disparities..][..disparities];
            step::<LANES>(cost, &self.before, 0, &mut self.now, 0);
            let sums = &mut self.sums[x * disparities..][..disparities];
            let best = add_path(&self.now.costs[1..=disparities], sums);
            let d = place_of(sums, best);
            let rival = rival_of(sums, d);
            let at = usize::from(d);
            let below = sums[at.saturating_sub(1)];
            let above = sums[(at + 1).min(disparities - 1)];
            let is_unique = u32::from(rival) > accept.rival_max(best);
            out[x] = sub_pixel(d, disparities, [below, best, above], is_unique);
            self.disparity[x] = d;
            let right = first_column + x - at;
            if best < self.right_best[right] {
                self.right_best[right] = best;
                self.right_disparity[right] = d;
            }
            std::mem::swap(&mut self.before, &mut self.now);
        }
        // A pixel of the right image is assigned to the best of the left image's pixels that match it.
        for (x, (out, &d)) in out.iter_mut().zip(&self.disparity).enumerate() {
            let back = self.right_disparity[first_column + x - usize::from(d)];
            if d.abs_diff(back) > accept.left_right_max {
                *out = crate::NO_DISPARITY;
            }
        }
    }
}

/// `left` and `reversed` are padded by `RADIUS` columns; disparity d of a column is d further in the reversed row.
#[inline(always)]
fn differences<const LANES: usize>(left: &[u8], reversed: &[u8], disparities: usize, out: &mut [u8]) {
    // Column 0 of `left` is column `disparities - 1` of the image.
    let last = reversed.len() - disparities;
    for (x, (&left, out)) in left.iter().zip(out.chunks_exact_mut(disparities)).enumerate() {
        let right = &reversed[last - x..][..disparities];
        for (out, right) in out.chunks_exact_mut(LANES).zip(right.chunks_exact(LANES)) {
            for i in 0..LANES {
                out[i] = left.abs_diff(right[i]);
            }
        }
    }
}

/// Adds the clipped difference of brightness. It connects surfaces without texture, and because it is clipped, a
/// difference in exposure between the two cameras has a limited effect.
#[inline(always)]
fn add_differences<const LANES: usize>(left: &[u8], reversed: &[u8], disparities: usize, out: &mut [u8]) {
    let last = reversed.len() - disparities;
    for (x, (&left, out)) in left.iter().zip(out.chunks_exact_mut(disparities)).enumerate() {
        let right = &reversed[last - x..][..disparities];
        for (out, right) in out.chunks_exact_mut(LANES).zip(right.chunks_exact(LANES)) {
            for i in 0..LANES {
                out[i] = out[i].wrapping_add(left.abs_diff(right[i]).min(BRIGHTNESS_CAP));
            }
        }
    }
}

#[inline(always)]
fn reverse(row: &[u8], out: &mut Vec<u8>) {
    out.clear();
    out.extend(row.iter().rev());
}

#[inline(always)]
fn sum_rows(a: &[u8], b: &[u8], c: &[u8], out: &mut [u8]) {
    let n = out.len();
    let (a, b, c) = (&a[..n], &b[..n], &c[..n]);
    for i in 0..n {
        out[i] = a[i].wrapping_add(b[i]).wrapping_add(c[i]);
    }
}

/// Half of the sum of three columns; the prefilter's cap keeps the sum within a byte.
#[inline(always)]
fn sum_columns(columns: &[u8], disparities: usize, out: &mut [u8]) {
    let n = out.len();
    let (a, b, c) = (&columns[..n], &columns[disparities..][..n], &columns[2 * disparities..][..n]);
    for i in 0..n {
        out[i] = a[i].wrapping_add(b[i]).wrapping_add(c[i]) >> 1;
    }
}

/// One step along a path, from one pixel to the next.
#[inline(always)]
fn step<const LANES: usize>(cost: &[u8], from: &Path, from_pixel: usize, to: &mut Path, to_pixel: usize) {
    let stride = cost.len() + 1;
    let before = &from.costs[from_pixel * stride..][..cost.len() + 2];
    let out = &mut to.costs[to_pixel * stride + 1..][..cost.len()];
    to.least[to_pixel] = follow::<LANES>(cost, before, from.least[from_pixel], out);
}

/// Computes the costs after one step; returns the least of them. `before` has a guard at both ends.
#[inline(always)]
fn follow<const LANES: usize>(cost: &[u8], before: &[u8], least: u8, out: &mut [u8]) -> u8 {
    let jump = least.saturating_add(P2);
    let mut new_least = [u8::MAX; LANES];
    for (k, (out, cost)) in out.chunks_exact_mut(LANES).zip(cost.chunks_exact(LANES)).enumerate() {
        let before = &before[k * LANES..][..LANES + 2];
        for i in 0..LANES {
            let beside = before[i].min(before[i + 2]).saturating_add(P1);
            let way = before[i + 1].min(beside).min(jump);
            // No option costs less than the previous least cost, and none more than that plus P2.
            let sum = cost[i].wrapping_add(way.wrapping_sub(least));
            out[i] = sum;
            new_least[i] = new_least[i].min(sum);
        }
    }
    least_of(&new_least)
}

#[inline(always)]
fn sum_paths<const LANES: usize>(a: &[u8], b: &[u8], c: &[u8], d: &[u8], out: &mut [u16]) {
    for (k, out) in out.chunks_exact_mut(LANES).enumerate() {
        let at = k * LANES;
        let (a, b) = (&a[at..][..LANES], &b[at..][..LANES]);
        let (c, d) = (&c[at..][..LANES], &d[at..][..LANES]);
        for i in 0..LANES {
            out[i] = u16::from(a[i]) + u16::from(b[i]) + u16::from(c[i]) + u16::from(d[i]);
        }
    }
}

/// Lanes of a vector of sums; they divide the number of disparities.
const SUMS: usize = 16;

/// Adds the last path; returns the least sum.
#[inline(always)]
fn add_path(path: &[u8], sums: &mut [u16]) -> u16 {
    let mut least = [u16::MAX; SUMS];
    for (sums, path) in sums.chunks_exact_mut(SUMS).zip(path.chunks_exact(SUMS)) {
        // Apart, because for all that the compiler knows, `sums` and `path` overlap.
        let mut total = [0; SUMS];
        for i in 0..SUMS {
            total[i] = sums[i].wrapping_add(u16::from(path[i]));
        }
        for i in 0..SUMS {
            least[i] = least[i].min(total[i]);
        }
        sums.copy_from_slice(&total);
    }
    least_sum(&least)
}

/// The first disparity with this sum.
#[inline(always)]
fn place_of(sums: &[u16], sum: u16) -> u16 {
    let mut least = [u16::MAX; SUMS];
    let mut places = counted_from(0);
    for sums in sums.chunks_exact(SUMS) {
        for i in 0..SUMS {
            least[i] = least[i].min(places[i] | u16::from(sums[i] != sum).wrapping_neg());
            places[i] = places[i].wrapping_add(SUMS as u16);
        }
    }
    least_sum(&least)
}

/// The least sum that is not adjacent to a disparity.
#[inline(always)]
fn rival_of(sums: &[u16], place: u16) -> u16 {
    let mut least = [u16::MAX; SUMS];
    // 0 to 2 for the disparities that are adjacent.
    let mut from = counted_from(1_u16.wrapping_sub(place));
    for sums in sums.chunks_exact(SUMS) {
        for i in 0..SUMS {
            least[i] = least[i].min(sums[i] | u16::from(from[i] <= 2).wrapping_neg());
            from[i] = from[i].wrapping_add(SUMS as u16);
        }
    }
    least_sum(&least)
}

#[inline(always)]
fn counted_from(first: u16) -> [u16; SUMS] {
    let mut lanes = [0; SUMS];
    for i in 0..SUMS {
        lanes[i] = first.wrapping_add(i as u16);
    }
    lanes
}

/// In parts of eight, for which processors have an instruction; of more lanes the compiler makes scalar comparisons.
#[inline(always)]
fn least_sum(lanes: &[u16; SUMS]) -> u16 {
    let mut eight = [u16::MAX; 8];
    for part in lanes.chunks_exact(8) {
        for i in 0..8 {
            eight[i] = eight[i].min(part[i]);
        }
    }
    let mut least = u16::MAX;
    for &lane in &eight {
        least = least.min(lane);
    }
    least
}

#[inline(always)]
fn least_of<const LANES: usize>(lanes: &[u8; LANES]) -> u8 {
    let mut least = lanes[0];
    for &lane in lanes {
        least = least.min(lane);
    }
    least
}
