//! Block matching: for each pixel of the left image, the disparity at which the square of pixels around it differs
//! least from the right image (Albus 2006a, 3.1.1).
//!
//! The cost is the sum of absolute differences of filtered pixels, computed with running sums: moving down a row adds
//! one row of differences, already summed along the row, and subtracts the row that leaves the square. All columns of a
//! row are processed together, one disparity after the other, so that vectors run along the row and no sum crosses
//! their lanes.
//!
//! Both images are searched: the best disparity of each pixel of the right image follows from the same sums.
//!
//! Cost: about 30 operations per pixel and disparity divided by the vector lanes, for any size of the square. Rows are
//! independent once their first sums are computed, so strips of rows may run on several threads with the same result
//! bit for bit.

#![allow(clippy::inline_always, reason = "kernels are compiled anew for each width of vectors")]
#![allow(clippy::needless_range_loop, reason = "loops over lanes index several slices alike")]
#![allow(clippy::too_many_arguments, reason = "slices passed one by one are known not to overlap")]

use crate::NO_DISPARITY;
use crate::checks::Accept;
use crate::prefilter::Filtered;
use crate::width::Kernel;

/// Columns are processed in multiples of this number, so that no vector loop has a remainder.
const LANES: usize = 64;
/// Number of columns behind the padded ones that vectors may read.
pub(crate) const SPARE: usize = 2 * LANES;

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

/// State of each column of one row. Costs are sums over the square.
#[derive(Clone, Debug, Default)]
struct Row {
    best: Vec<u16>,
    disparity: Vec<u16>,
    right_best: Vec<u16>,
    right_disparity: Vec<u16>,
    /// Best cost at a disparity that is not adjacent to the best one.
    rival: Vec<u16>,
    /// Costs at the disparities below and above the best one.
    below: Vec<u16>,
    above: Vec<u16>,
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
                    advance_and_compare::<THREES, ONES>(
                        threes,
                        differences,
                        slot,
                        sums,
                        &mut row.best,
                        &mut row.disparity,
                        d as u16,
                    );
                    compare(
                        &sums[..columns],
                        &mut row.right_best[first_column - d..][..columns],
                        &mut row.right_disparity[first_column - d..][..columns],
                        d as u16,
                    );
                } else {
                    advance::<THREES, ONES>(threes, differences, slot, sums);
                }
            }
            if complete {
                for d in 0..disparities {
                    look_around(
                        &sums[d * n..][..n],
                        &row.disparity,
                        &mut row.rival,
                        &mut row.below,
                        &mut row.above,
                        d as u16,
                    );
                }
                let out = &mut out[(step + 1 - side) * width..][..width];
                let (blind, out) = out.split_at_mut(first_column);
                blind.fill(NO_DISPARITY);
                row.decide(accept, disparities, out);
            }
        }
    }
}

impl Row {
    #[inline(always)]
    fn start(&mut self, n: usize, width: usize) {
        for costs in [&mut self.best, &mut self.rival, &mut self.below, &mut self.above] {
            costs.clear();
            costs.resize(n, u16::MAX);
        }
        self.disparity.resize(n, 0);
        self.right_best.clear();
        self.right_best.resize(width, u16::MAX);
        self.right_disparity.resize(width, 0);
    }

    #[inline(always)]
    fn decide(&self, accept: Accept, disparities: usize, out: &mut [u16]) {
        let n = out.len();
        let first_column = disparities - 1;
        let (best, disparity, rival) = (&self.best[..n], &self.disparity[..n], &self.rival[..n]);
        let (below, above) = (&self.below[..n], &self.above[..n]);
        for i in 0..n {
            out[i] = accept.sub_pixel(disparity[i], disparities, [below[i], best[i], above[i]], rival[i]);
        }
        for i in 0..n {
            let d = disparity[i];
            let back = self.right_disparity[first_column + i - d as usize];
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

/// [`advance`] and [`compare`] in one pass over the sums.
#[inline(always)]
fn advance_and_compare<const THREES: usize, const ONES: usize>(
    threes: &[u8],
    ones: &[u8],
    slot: &mut [u8],
    sums: &mut [u16],
    best: &mut [u16],
    disparity: &mut [u16],
    d: u16,
) {
    for at in stretches(sums.len()) {
        let (threes, ones) = (&threes[at..][..LANES + 3 * THREES], &ones[at..][..LANES + 3 * THREES + ONES]);
        let (slot, sums) = (&mut slot[at..][..LANES], &mut sums[at..][..LANES]);
        let (best, disparity) = (&mut best[at..][..LANES], &mut disparity[at..][..LANES]);
        for i in 0..LANES {
            let new = row_sum::<THREES, ONES>(threes, ones, i);
            let sum = sums[i].wrapping_add(u16::from(new)).wrapping_sub(u16::from(slot[i]));
            slot[i] = new;
            sums[i] = sum;
            disparity[i] = choose(sum < best[i], d, disparity[i]);
            best[i] = sum.min(best[i]);
        }
    }
}

/// Keeps the lower cost and its disparity. Comparing a cost twice changes nothing, so the last lanes may overlap the
/// previous ones.
#[inline(always)]
fn compare(sums: &[u16], best: &mut [u16], disparity: &mut [u16], d: u16) {
    let n = sums.len();
    if n < LANES {
        for i in 0..n {
            disparity[i] = choose(sums[i] < best[i], d, disparity[i]);
            best[i] = sums[i].min(best[i]);
        }
        return;
    }
    for at in stretches(n).chain(std::iter::once(n - LANES)) {
        let sums = &sums[at..][..LANES];
        let (best, disparity) = (&mut best[at..][..LANES], &mut disparity[at..][..LANES]);
        for i in 0..LANES {
            disparity[i] = choose(sums[i] < best[i], d, disparity[i]);
            best[i] = sums[i].min(best[i]);
        }
    }
}

/// Given the best disparity, finds the best cost not adjacent to it, and the costs adjacent to it.
#[inline(always)]
fn look_around(
    sums: &[u16],
    disparity: &[u16],
    rival: &mut [u16],
    below: &mut [u16],
    above: &mut [u16],
    d: u16,
) {
    for at in stretches(sums.len()) {
        let (sums, disparity) = (&sums[at..][..LANES], &disparity[at..][..LANES]);
        let (rival, below) = (&mut rival[at..][..LANES], &mut below[at..][..LANES]);
        let above = &mut above[at..][..LANES];
        for i in 0..LANES {
            // 0 is one below the best disparity, 1 is the best, 2 is one above.
            let place = (d + 1).wrapping_sub(disparity[i]);
            let sum = sums[i];
            rival[i] = rival[i].min(choose(place > 2, sum, u16::MAX));
            below[i] = choose(place == 0, sum, below[i]);
            above[i] = choose(place == 2, sum, above[i]);
        }
    }
}
