//! Checks of a match, and its sub-pixel refinement.

#![allow(clippy::inline_always, reason = "kernels are compiled anew for each width of vectors")]

use crate::NO_DISPARITY;

/// Steps of a disparity per pixel.
pub const STEPS_PER_PIXEL: u16 = 16;

/// Criteria for accepting a match.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Accept {
    /// Minimum excess cost of a rival that is not adjacent to the best match, percent.
    pub(crate) uniqueness_pct: u16,
    /// Maximum difference from the right image's own best disparity, pixels.
    pub(crate) left_right_max: u16,
}

impl Accept {
    /// The greatest cost of a rival that is nearly as good as a match of the cost `best`.
    #[inline(always)]
    pub(crate) fn rival_max(self, best: u16) -> u32 {
        // At most twice the cost. A product that is checked for overflow cannot be computed in vectors.
        u32::from(best).wrapping_mul(100 + u32::from(self.uniqueness_pct)) / 100
    }
}

/// The disparity in 1/16 pixel, or [`NO_DISPARITY`] where a rival is nearly as good. Absolute differences form a V around
/// the minimum: lines of equal slope through the three costs meet at its tip. At either end of the range a neighbour is
/// missing, and the whole pixel is used.
#[inline(always)]
pub(crate) fn sub_pixel(d: u16, disparities: usize, [below, best, above]: [u16; 3], is_unique: bool) -> u16 {
    let inside = d > 0 && usize::from(d) + 1 < disparities;
    let steep = i32::from(below.max(above)) - i32::from(best);
    let lean = (i32::from(below) - i32::from(above)) as f32 * 8.0 / steep.max(1) as f32;
    // Between −8 and 8 steps; the operand is positive, so that the truncation rounds to the nearest.
    let fraction = if inside { ((lean + 8.5) as i32).wrapping_sub(8) } else { 0 };
    let disparity = (i32::from(d) * i32::from(STEPS_PER_PIXEL)).wrapping_add(fraction) as u16;
    if is_unique { disparity } else { NO_DISPARITY }
}

/// Removes small connected patches. Works on runs of a row rather than on pixels, because there are far fewer.
#[derive(Clone, Debug, Default)]
pub(crate) struct SpeckleFilter {
    runs: Vec<Run>,
    /// Union-find over runs: the parent of each, and the area below a root.
    parent: Vec<u32>,
    area: Vec<u32>,
}

/// Adjacent pixels whose disparities differ little from one to the next.
#[derive(Clone, Copy, Debug)]
struct Run {
    /// First column, and one past the last one.
    start: usize,
    end: usize,
}

impl SpeckleFilter {
    /// Removes connected patches of fewer than `min_area` pixels; neighbours are connected if their disparities differ
    /// by at most `step`, 1/16 pixel.
    pub(crate) fn apply(&mut self, disparity: &mut [u16], width: usize, min_area: usize, step: u16) {
        if min_area <= 1 || width == 0 {
            return;
        }
        self.runs.clear();
        self.parent.clear();
        self.area.clear();
        let (mut above, mut runs_above) = (&[][..], 0);
        for here in disparity.chunks_exact(width) {
            let runs_here = self.runs.len();
            self.find_runs(here, step);
            self.connect(above, here, runs_above, runs_here, step);
            (above, runs_above) = (here, runs_here);
        }
        let mut run = 0;
        for here in disparity.chunks_exact_mut(width) {
            let mut end = 0;
            while end < width {
                let root = find(&mut self.parent, run as u32);
                if (self.area[root as usize] as usize) < min_area {
                    here[self.runs[run].start..self.runs[run].end].fill(NO_DISPARITY);
                }
                end = self.runs[run].end;
                run += 1;
            }
        }
    }

    /// Stretches without disparity are runs as well; they never connect, and removing them changes nothing.
    fn find_runs(&mut self, here: &[u16], step: u16) {
        let mut start = 0;
        let mut close = |end: usize| {
            self.parent.push(self.runs.len() as u32);
            self.area.push((end - start) as u32);
            self.runs.push(Run { start, end });
            start = end;
        };
        for (x, pair) in here.windows(2).enumerate() {
            // The marker for no disparity differs from every disparity by more than any step.
            if pair[0].abs_diff(pair[1]) > step {
                close(x + 1);
            }
        }
        close(here.len());
    }

    /// Connects runs of two rows that share a column in which they differ little.
    fn connect(&mut self, above: &[u16], here: &[u16], runs_above: usize, runs_here: usize, step: u16) {
        let (mut a, mut b) = (runs_above, runs_here);
        while a < runs_here && b < self.runs.len() {
            let (upper, lower) = (self.runs[a], self.runs[b]);
            let overlap = upper.start.max(lower.start)..upper.end.min(lower.end);
            let valid = above[upper.start] != NO_DISPARITY && here[lower.start] != NO_DISPARITY;
            let near = |(a, b): (&u16, &u16)| a.abs_diff(*b) <= step;
            if valid && above[overlap.clone()].iter().zip(&here[overlap]).any(near) {
                union(&mut self.parent, &mut self.area, a as u32, b as u32);
            }
            if upper.end <= lower.end {
                a += 1;
            }
            if lower.end <= upper.end {
                b += 1;
            }
        }
    }
}

fn find(parent: &mut [u32], mut run: u32) -> u32 {
    while parent[run as usize] != run {
        let next = parent[parent[run as usize] as usize];
        parent[run as usize] = next;
        run = next;
    }
    run
}

fn union(parent: &mut [u32], area: &mut [u32], a: u32, b: u32) {
    let (a, b) = (find(parent, a), find(parent, b));
    if a != b {
        // The older run is the root, whatever the areas, so that the tree is the same in every run of the program.
        let (root, child) = (a.min(b), a.max(b));
        parent[child as usize] = root;
        area[root as usize] += area[child as usize];
    }
}
