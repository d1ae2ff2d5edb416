//! Block matching: for each pixel of the left image, the disparity at which the square of pixels around it differs
//! least from the right image (Albus 2006a, 3.1.1).
//!
//! The cost is the sum of absolute differences of filtered pixels, computed with running sums: moving down a row adds
//! one row of differences, already summed along the row, and subtracts the row that leaves the square. All columns of a
//! row are processed together, one disparity after the other, so that vectors run along the row and no sum crosses
//! their lanes.
//!
//! Both images are searched: the best disparity of each pixel of the right image follows from the same sums. Costs fit in
//! 12 bits, so the cost and the disparity within a group of 16 are one number of 16 bits, and one minimum finds both. A
//! second pass over the sums counts the disparities whose cost is about as low as the best one.
//!
//! Cost: about 25 operations per pixel and disparity divided by the vector lanes, for any size of the square. Rows are
//! independent once their first sums are computed, so strips of rows may run on several threads with the same result
//! bit for bit.

#![allow(clippy::inline_always, reason = "kernels are compiled anew for each width of vectors")]
#![allow(clippy::needless_range_loop, reason = "loops over lanes index several slices alike")]
#![allow(clippy::too_many_arguments, reason = "slices passed one by one are known not to overlap")]

use crate::NO_DISPARITY;
use crate::checks::{Accept, sub_pixel};
use crate::prefilter::Filtered;
use crate::width::Kernel;

/// Columns are processed in multiples of this number, so that no vector loop has a remainder.
const LANES: usize = 64;
/// Number of columns behind the padded ones that vectors may read.
pub(crate) const SPARE: usize = 2 * LANES;

/// Number of disparities that are compared by one number of 16 bits: cost, and place in the group. The number of
/// disparities is a multiple of it.
const GROUP: usize = 1 << PLACE_BITS;
const PLACE_BITS: u32 = 4;
/// No cost is greater.
const COST_MAX: u16 = u16::MAX >> PLACE_BITS;
/// Number of disparities that are counted in one pass over a row.
const COUNTED: usize = 4;

/// The prefilter's cap, small enough that the differences along one row of a block fit in a byte.
pub(crate) fn cap(block: usize) -> u8 {
    (usize::from(u8::MAX) / (2 * block)) as u8
}

/// Matches rows `first_row ..` of a pair into `out`, 1/16 pixel; columns left of `disparities - 1` have no disparity.
pub(crate) struct Rows<'a> {
    pub(crate) left: &'a Filtered,
    pub(crate) right: &'a Filtered,
    pub(crate) width: usize,
    pub(crate) disparities: usize,
    /// Half of the square's side, rounded down; the images are padded by this much.
    pub(crate) radius: usize,
    pub(crate) accept: Accept,
    pub(crate) first_row: usize,
    pub(crate) scratch: &'a mut Scratch,
    pub(crate) out: &'a mut [u16],
}

/// Working memory of one strip, kept between frames.
#[derive(Clone, Debug, Default)]
pub(crate) struct Scratch {
    /// Absolute differences of one row at one disparity, and sums of three of them.
    differences: Vec<u8>,
    threes: Vec<u8>,
    /// Row sums of the rows in the square, indexed by slot, disparity, column.
    ring: Vec<u8>,
    /// Sum over the square, indexed by disparity, column.
    sums: Vec<u16>,
    row: Row,
}

/// State of each column of one row.
#[derive(Clone, Debug, Default)]
struct Row {
    left: Side,
    right: Side,
    /// Number of disparities whose cost is at most `limit`, which includes the best one.
    count: Vec<u16>,
    limit: Vec<u16>,
    /// Costs at the disparities below and above the best one.
    below: Vec<u16>,
    above: Vec<u16>,
}

/// The best disparity of each column of one image. Costs are sums over the square.
#[derive(Clone, Debug, Default)]
struct Side {
    best: Vec<u16>,
    disparity: Vec<u16>,
    /// The lowest cost of the present group of disparities, times [`GROUP`], plus its place in the group.
    group: Vec<u16>,
}

impl Kernel for Rows<'_> {
    #[inline(always)]
    fn run(self) {
        match self.radius {
            2 => self.rows::<1, 2>(),
            3 => self.rows::<2, 1>(),
            4 => self.rows::<3, 0>(),
            5 => self.rows::<3, 2>(),
            6 => self.rows::<4, 1>(),
            _ => self.rows::<5, 0>(),
        }
    }
}

impl Rows<'_> {
    /// The side of the square is `3 * THREES + ONES`.
    #[inline(always)]
    fn rows<const THREES: usize, const ONES: usize>(self) {
        let Rows { left, right, width, disparities, radius, accept, first_row, scratch, out } = self;
        let side = 3 * THREES + ONES;
        let first_column = disparities - 1;
        let columns = width - first_column;
        let n = columns.next_multiple_of(LANES);
        let whole = columns / LANES * LANES;
        let Scratch { differences, threes, ring, sums, row } = scratch;
        // One more multiple of the lanes, for the columns of the square beyond the last one.
        differences.resize(n + 2 * LANES, 0);
        threes.resize(n + LANES, 0);
        ring.clear();
        ring.resize(side * disparities * n, 0);
        sums.clear();
        sums.resize(disparities * n, 0);

        let top = first_row as isize - radius as isize;
        let rows = out.len() / width;
        for step in 0..side - 1 + rows {
            let y = top + step as isize;
            let (left, right) = (left.row(y), right.row(y));
            let slot = &mut ring[step % side * disparities * n..][..disparities * n];
            // The first rows of a strip fill the square; costs are valid from then on.
            let complete = step + 1 >= side;
            if complete {
                row.start(n, width);
            }
            for d in 0..disparities {
                absolute_differences(
                    &left[first_column..][..n + LANES],
                    &right[first_column - d..][..n + LANES],
                    differences,
                );
                sum_threes(differences, threes);
                let (slot, sums) = (&mut slot[d * n..][..n], &mut sums[d * n..][..n]);
                if complete {
                    let place = (d % GROUP) as u16;
                    let of_left = &mut row.left.group[..n];
                    let of_right = &mut row.right.group[first_column - d..][..columns];
                    advance_and_compare::<THREES, ONES>(
                        threes,
                        differences,
                        &mut slot[..whole],
                        &mut sums[..whole],
                        of_left,
                        of_right,
                        place,
                    );
                    // The last stretch has columns that do not exist, which must not count in the right image.
                    let (threes, differences) = (&threes[whole..], &differences[whole..]);
                    advance::<THREES, ONES>(threes, differences, &mut slot[whole..], &mut sums[whole..]);
                    compare(&sums[whole..], &mut of_left[whole..], place);
                    compare(&sums[whole..columns], &mut of_right[whole..], place);
                    if (d + 1) % GROUP == 0 {
                        row.left.take_group((d + 1 - GROUP) as u16);
                        row.right.take_group((d + 1 - GROUP) as u16);
                    }
                } else {
                    advance::<THREES, ONES>(threes, differences, slot, sums);
                }
            }
            if complete {
                row.look_around(sums, accept, disparities, columns);
                let out = &mut out[(step + 1 - side) * width..][..width];
                let (blind, out) = out.split_at_mut(first_column);
                blind.fill(NO_DISPARITY);
                row.decide(accept, disparities, out);
            }
        }
    }
}

impl Side {
    #[inline(always)]
    fn start(&mut self, n: usize) {
        for costs in [&mut self.best, &mut self.group] {
            costs.clear();
            costs.resize(n, u16::MAX);
        }
        self.disparity.resize(n, 0);
    }

    /// Takes over the best disparity of the group that begins at `first`.
    #[inline(always)]
    fn take_group(&mut self, first: u16) {
        let n = self.best.len();
        let (best, disparity) = (&mut self.best[..n], &mut self.disparity[..n]);
        let group = &mut self.group[..n];
        for i in 0..n {
            let cost = group[i] >> PLACE_BITS;
            let place = group[i] % GROUP as u16;
            disparity[i] = choose(cost < best[i], first.wrapping_add(place), disparity[i]);
            best[i] = cost.min(best[i]);
            group[i] = u16::MAX;
        }
    }
}

impl Row {
    #[inline(always)]
    fn start(&mut self, n: usize, width: usize) {
        self.left.start(n);
        self.right.start(width);
        self.count.clear();
        for values in [&mut self.count, &mut self.limit, &mut self.below, &mut self.above] {
            values.resize(n, 0);
        }
    }

    /// Given the best disparities, counts those that are about as good, and finds the costs next to them.
    #[inline(always)]
    fn look_around(&mut self, sums: &[u16], accept: Accept, disparities: usize, columns: usize) {
        let n = self.limit.len();
        let (best, limit) = (&self.left.best[..n], &mut self.limit[..n]);
        for i in 0..n {
            limit[i] = accept.rival_max(best[i]).min(u32::from(COST_MAX)) as u16;
        }
        for sums in sums.chunks_exact(COUNTED * n) {
            count(sums, &self.limit, &mut self.count);
        }
        let disparity = &self.left.disparity[..columns];
        let (below, above) = (&mut self.below[..columns], &mut self.above[..columns]);
        for i in 0..columns {
            let d = usize::from(disparity[i]);
            below[i] = if d > 0 { sums[(d - 1) * n + i] } else { u16::MAX };
            above[i] = if d + 1 < disparities { sums[(d + 1) * n + i] } else { u16::MAX };
        }
    }

    #[inline(always)]
    fn decide(&self, accept: Accept, disparities: usize, out: &mut [u16]) {
        let n = out.len();
        let first_column = disparities - 1;
        let (best, disparity) = (&self.left.best[..n], &self.left.disparity[..n]);
        let (count, limit) = (&self.count[..n], &self.limit[..n]);
        let (below, above) = (&self.below[..n], &self.above[..n]);
        for i in 0..n {
            // The best one and those next to it are no rivals.
            let adjacent = 1 + u16::from(below[i] <= limit[i]) + u16::from(above[i] <= limit[i]);
            let costs = [below[i], best[i], above[i]];
            out[i] = sub_pixel(disparity[i], disparities, costs, count[i] == adjacent);
        }
        for i in 0..n {
            let d = disparity[i];
            let back = self.right.disparity[first_column + i - d as usize];
            if d.abs_diff(back) > accept.left_right_max {
                out[i] = NO_DISPARITY;
            }
        }
    }
}

/// Selects `new` where `better` holds. Uses a mask, because a conditional store prevents vectorization.
#[inline(always)]
fn choose(better: bool, new: u16, old: u16) -> u16 {
    let mask = u16::from(better).wrapping_neg();
    (new & mask) | (old & !mask)
}

/// Splits columns into stretches of [`LANES`], a constant, so that no vector loop has a remainder.
#[inline(always)]
fn stretches(n: usize) -> impl Iterator<Item = usize> {
    (0..n / LANES).map(|k| k * LANES)
}

#[inline(always)]
fn absolute_differences(left: &[u8], right: &[u8], out: &mut [u8]) {
    for at in stretches(left.len()) {
        let (left, right, out) = (&left[at..][..LANES], &right[at..][..LANES], &mut out[at..][..LANES]);
        for i in 0..LANES {
            out[i] = left[i].abs_diff(right[i]);
        }
    }
}

#[inline(always)]
fn sum_threes(ones: &[u8], out: &mut [u8]) {
    for at in stretches(out.len()) {
        let (ones, out) = (&ones[at..][..LANES + 2], &mut out[at..][..LANES]);
        for i in 0..LANES {
            out[i] = ones[i].wrapping_add(ones[i + 1]).wrapping_add(ones[i + 2]);
        }
    }
}

/// The sum along the row from column `i`. It fits in a byte because of the prefilter's cap.
#[inline(always)]
fn row_sum<const THREES: usize, const ONES: usize>(threes: &[u8], ones: &[u8], i: usize) -> u8 {
    let mut sum = 0_u8;
    for k in 0..THREES {
        sum = sum.wrapping_add(threes[i + 3 * k]);
    }
    for k in 0..ONES {
        sum = sum.wrapping_add(ones[i + 3 * THREES + k]);
    }
    sum
}

#[inline(always)]
fn advance<const THREES: usize, const ONES: usize>(
    threes: &[u8],
    ones: &[u8],
    slot: &mut [u8],
    sums: &mut [u16],
) {
    for at in stretches(sums.len()) {
        let (threes, ones) = (&threes[at..][..LANES + 3 * THREES], &ones[at..][..LANES + 3 * THREES + ONES]);
        let (slot, sums) = (&mut slot[at..][..LANES], &mut sums[at..][..LANES]);
        for i in 0..LANES {
            let new = row_sum::<THREES, ONES>(threes, ones, i);
            sums[i] = sums[i].wrapping_add(u16::from(new)).wrapping_sub(u16::from(slot[i]));
            slot[i] = new;
        }
    }
}

/// [`advance`] and [`compare`], for both images, in one pass over the sums.
#[inline(always)]
fn advance_and_compare<const THREES: usize, const ONES: usize>(
    threes: &[u8],
    ones: &[u8],
    slot: &mut [u8],
    sums: &mut [u16],
    left: &mut [u16],
    right: &mut [u16],
    place: u16,
) {
    for at in stretches(sums.len()) {
        let (threes, ones) = (&threes[at..][..LANES + 3 * THREES], &ones[at..][..LANES + 3 * THREES + ONES]);
        let (slot, sums) = (&mut slot[at..][..LANES], &mut sums[at..][..LANES]);
        let (left, right) = (&mut left[at..][..LANES], &mut right[at..][..LANES]);
        for i in 0..LANES {
            let new = row_sum::<THREES, ONES>(threes, ones, i);
            let sum = sums[i].wrapping_add(u16::from(new)).wrapping_sub(u16::from(slot[i]));
            slot[i] = new;
            sums[i] = sum;
            let cost_and_place = (sum << PLACE_BITS) | place;
            left[i] = left[i].min(cost_and_place);
            right[i] = right[i].min(cost_and_place);
        }
    }
}

/// Keeps the lower cost and its place in the group.
#[inline(always)]
fn compare(sums: &[u16], best: &mut [u16], place: u16) {
    for (best, sum) in best.iter_mut().zip(sums) {
        *best = (*best).min((sum << PLACE_BITS) | place);
    }
}

/// Counts the costs of [`COUNTED`] disparities, one after the other in `sums`, that are at most `limit`.
#[inline(always)]
fn count(sums: &[u16], limit: &[u16], count: &mut [u16]) {
    let n = limit.len();
    let (a, sums) = sums.split_at(n);
    let (b, sums) = sums.split_at(n);
    let (c, d) = sums.split_at(n);
    for at in stretches(n) {
        let (a, b, c, d) = (&a[at..][..LANES], &b[at..][..LANES], &c[at..][..LANES], &d[at..][..LANES]);
        let (limit, count) = (&limit[at..][..LANES], &mut count[at..][..LANES]);
        for i in 0..LANES {
            // Costs fit in 12 bits, and signed numbers are compared by one instruction.
            let is_low = |sum: u16| u16::from(sum as i16 <= limit[i] as i16);
            let low = [a[i], b[i], c[i], d[i]].map(is_low);
            count[i] = low.into_iter().fold(count[i], u16::wrapping_add);
        }
    }
}
