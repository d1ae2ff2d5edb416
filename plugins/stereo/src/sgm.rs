//! Semi-global matching (Hirschmüller 2008): aggregates the costs of each pixel along four paths: from the left, the
//! right, above and below. They are in balance: with more paths from one side than from the other, the range of a
//! surface that is inclined, as the ground is, is wrong towards what lies on that side.
//!
//! On a path a change of the disparity by one costs `P1` and a larger change `P2`, so that surfaces stay connected
//! where the image has little texture. The cost of a pixel is half of a sum over 3×3 pixels: the absolute difference
//! after the Laplacian of Gaussian plus the clipped difference after the Gaussian alone. The first pass goes from the
//! first row to the last and keeps the costs of all pixels and of the path from above; the second goes back up, follows
//! the other paths, and decides.
//!
//! All costs are bytes: a pixel's cost is at most 127, and a path adds at most `P2`. Vectors run along the disparities
//! of one pixel, whose number is a multiple of 16.
//!
//! Cost: about 40 operations per pixel and disparity divided by the vector lanes, and two bytes of memory per pixel and
//! disparity. Rows depend on each other, so an image is processed on one thread.

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

/// Working memory of one image, kept between frames: two bytes for each pixel and disparity.
#[derive(Clone, Debug, Default)]
pub(crate) struct Scratch {
    /// The right row, reversed.
    reversed: Vec<u8>,
    /// Absolute differences of the rows in the window, and their sums over the rows; indexed by column, disparity.
    differences: [Vec<u8>; SIDE],
    columns: Vec<u8>,
    /// Costs of all pixels, indexed by row, column, disparity.
    costs: Vec<u8>,
    /// The path from above at all pixels, by row and column, after a row without costs.
    from_above: Path,
    /// The path from below at the row below and at the current one.
    below: Path,
    from_below: Path,
    /// The paths along the current row, by column and from the right, after a pixel without costs.
    from_left: Path,
    from_right: Path,
    /// Sums over the paths at one pixel, indexed by disparity.
    sums: Vec<u16>,
    disparity: Vec<u16>,
    right_best: Vec<u16>,
    right_disparity: Vec<u16>,
}

/// Costs on one path: a pixel is a guard followed by its disparities; one more guard is at the end.
#[derive(Clone, Debug, Default)]
struct Path {
    costs: Vec<u8>,
    least: Vec<u8>,
}

impl Path {
    /// Sets the size. The first `start` pixels, where the path comes from outside of the image, have no costs.
    fn prepare(&mut self, pixels: usize, start: usize, disparities: usize) {
        let stride = disparities + 1;
        if self.least.len() != pixels || self.costs.len() != pixels * stride + 1 {
            self.least = vec![0; pixels];
            self.costs = vec![0; pixels * stride + 1];
            self.costs.iter_mut().step_by(stride).for_each(|guard| *guard = GUARD);
        }
        self.least[..start].fill(0);
        for pixel in self.costs.chunks_exact_mut(stride).take(start) {
            pixel[1..].fill(0);
        }
    }

    /// The costs of a pixel.
    #[inline(always)]
    fn at(&self, pixel: usize, disparities: usize) -> &[u8] {
        &self.costs[pixel * (disparities + 1) + 1..][..disparities]
    }

    /// One step along the path, to a pixel from an earlier one.
    #[inline(always)]
    fn step<const LANES: usize>(&mut self, cost: &[u8], from: usize, to: usize) {
        let stride = cost.len() + 1;
        let (before, out) = self.costs.split_at_mut(to * stride + 1);
        let before = &before[from * stride..][..cost.len() + 2];
        self.least[to] = follow::<LANES>(cost, before, self.least[from], &mut out[..cost.len()]);
    }

    /// One step along the path, from the pixel of another row.
    #[inline(always)]
    fn step_from<const LANES: usize>(&mut self, cost: &[u8], row: &Path, pixel: usize) {
        let stride = cost.len() + 1;
        let before = &row.costs[pixel * stride..][..cost.len() + 2];
        let out = &mut self.costs[pixel * stride + 1..][..cost.len()];
        self.least[pixel] = follow::<LANES>(cost, before, row.least[pixel], out);
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
        let height = out.len() / width;
        scratch.prepare([n, height], width, disparities);
        for y in 0..height as isize {
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
            scratch.costs_and_path_from_above::<LANES>(y as usize, n, disparities);
        }
        for (y, out) in out.chunks_exact_mut(width).enumerate().rev() {
            scratch.other_paths::<LANES>(y, n, disparities);
            scratch.decide(y, disparities, accept, out);
            std::mem::swap(&mut scratch.below, &mut scratch.from_below);
        }
    }
}

impl Scratch {
    fn prepare(&mut self, [n, height]: [usize; 2], width: usize, disparities: usize) {
        for row in &mut self.differences {
            row.resize((n + 2 * RADIUS) * disparities, 0);
        }
        self.columns.resize((n + 2 * RADIUS) * disparities, 0);
        self.costs.resize(n * height * disparities, 0);
        self.from_above.prepare(n * (height + 1), n, disparities);
        self.below.prepare(n, n, disparities);
        self.from_below.prepare(n, 0, disparities);
        self.from_left.prepare(n + 1, 1, disparities);
        self.from_right.prepare(n + 1, 1, disparities);
        self.sums.resize(disparities, 0);
        self.disparity.resize(n, 0);
        self.right_best.resize(width, 0);
        self.right_disparity.resize(width, 0);
    }

    #[inline(always)]
    fn costs_and_path_from_above<const LANES: usize>(&mut self, y: usize, n: usize, disparities: usize) {
        let costs = &mut self.costs[y * n * disparities..][..n * disparities];
        let [a, b, c] = &self.differences;
        sum_rows(a, b, c, &mut self.columns);
        sum_columns(&self.columns, disparities, costs);
        for (x, cost) in costs.chunks_exact(disparities).enumerate() {
            self.from_above.step::<LANES>(cost, y * n + x, (y + 1) * n + x);
        }
    }

    /// The three are independent of each other, so that a processor can work on one while another waits for its
    /// previous pixel.
    #[inline(always)]
    fn other_paths<const LANES: usize>(&mut self, y: usize, n: usize, disparities: usize) {
        let costs = &self.costs[y * n * disparities..][..n * disparities];
        let backwards = costs.chunks_exact(disparities).rev();
        for (i, (cost, backwards)) in costs.chunks_exact(disparities).zip(backwards).enumerate() {
            self.from_below.step_from::<LANES>(cost, &self.below, i);
            self.from_left.step::<LANES>(cost, i, i + 1);
            self.from_right.step::<LANES>(backwards, i, i + 1);
        }
    }

    #[inline(always)]
    fn decide(&mut self, y: usize, disparities: usize, accept: Accept, out: &mut [u16]) {
        let first_column = disparities - 1;
        let (blind, out) = out.split_at_mut(first_column);
        let n = out.len();
        blind.fill(crate::NO_DISPARITY);
        self.right_best.fill(u16::MAX);
        self.right_disparity.fill(0);
        let sums = &mut self.sums[..disparities];
        for x in (0..n).rev() {
            let best = sum_paths(
                self.from_above.at((y + 1) * n + x, disparities),
                self.from_below.at(x, disparities),
                self.from_left.at(x + 1, disparities),
                self.from_right.at(n - x, disparities),
                sums,
            );
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
                out[i] = abs_diff(left, right[i]);
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
                out[i] = out[i].wrapping_add(abs_diff(left, right[i]).min(BRIGHTNESS_CAP));
            }
        }
    }
}

/// `u8::abs_diff`, for which the compiler makes vectors of four bytes per number.
#[inline(always)]
fn abs_diff(a: u8, b: u8) -> u8 {
    a.max(b).wrapping_sub(a.min(b))
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

/// Lanes of a vector of sums; they divide the number of disparities.
const SUMS: usize = 16;

/// Sums of four paths; returns the least.
#[inline(always)]
fn sum_paths(a: &[u8], b: &[u8], c: &[u8], d: &[u8], sums: &mut [u16]) -> u16 {
    let mut least = [u16::MAX; SUMS];
    for (k, sums) in sums.chunks_exact_mut(SUMS).enumerate() {
        // In an array of its own, because the compiler makes no vectors of sums that it would write one by one.
        let mut four = [0; SUMS];
        for path in [a, b, c, d] {
            let path = &path[k * SUMS..][..SUMS];
            for i in 0..SUMS {
                four[i] += u16::from(path[i]);
            }
        }
        for i in 0..SUMS {
            least[i] = least[i].min(four[i]);
        }
        sums.copy_from_slice(&four);
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
