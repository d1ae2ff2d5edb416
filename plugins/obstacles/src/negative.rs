//! Negative obstacles in one column of a range image: ditches, holes and drops, of which only the borders are given
//! (Albus 2006a, 3.1.1, Albus 2006b, 3.1).
//!
//! A ray that meets something below the ground level has crossed that level earlier: there is no ground where it
//! crossed, nor from there to where it ended. So a point that lies `δ` below the level at the horizontal distance `ρ`,
//! seen from a height `h` above the level, proves a hole as wide as `ρ·δ/(h + δ)` along the column. The scan follows a
//! column outward, keeps the level as a straight line through the last metre of ground, and gathers neighbouring points
//! below it. Where enough of them are deep enough and prove enough width, and no slope that counts as ground leads down
//! to them or up from them again, the last ground before them and the first behind them are the borders.
//!
//! Where the paper is silent: "below the ground level and large enough" is the depth and the width above. A dip that is
//! gentle on both sides is ground, and so is a downward slope that is seen as one; behind something that rises above
//! the ground, ground must be found anew before anything can be below it.

use crate::level::{LEVEL_BASE_M, Level};
use crate::scan::{Label, ScanPoint};

/// What counts as a negative obstacle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NegativeParams {
    /// How far below the ground level something must be seen, m.
    pub depth_m: f32,
    /// What range noise adds to it, per metre of range.
    pub depth_noise: f32,
    /// Width along the column that must be proven, m.
    pub width_m: f32,
    /// Farther points are not looked at, m.
    pub max_range_m: f32,
    /// Tangent of the steepest slope that is ground.
    pub slope_limit: f32,
}

/// A hole in a column: numbers of the points at its borders.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Hole {
    /// The last ground before it.
    pub near: usize,
    /// The first point behind it that is at ground level again, where there is one.
    pub far: Option<usize>,
}

/// How much less sure the level is for each metre beyond the last ground.
const LEVEL_DRIFT: f32 = 0.05;
/// Holes are not followed farther than this, m.
const REACH_M: f32 = 3.0;
/// Points of a hole that must be deep and prove its width.
const DEEP_POINTS: u32 = 3;

/// Points below the level that follow each other.
#[derive(Clone, Copy, Debug)]
struct Below {
    near: usize,
    near_rho: f32,
    /// Points that are deep enough and prove enough width, and those of them to which no ground can lead down.
    deep: u32,
    steep: u32,
    /// The deepest: distance and depth.
    deepest: [f32; 2],
}

/// Finds holes; keeps its scratch memory between columns.
#[derive(Clone, Debug, Default)]
pub struct HoleScan {
    level: Level,
}

impl HoleScan {
    /// Looks through one column, given from the lowest ray to the highest with the labels of its scan. `known` is
    /// ground in the column's direction that was seen before and lies nearer than its first point: distance and height,
    /// m, ascending.
    pub fn scan(
        &mut self,
        points: &[ScanPoint],
        labels: &[Label],
        known: impl IntoIterator<Item = (f32, f32)>,
        params: &NegativeParams,
        holes: &mut Vec<Hole>,
    ) {
        self.level.clear();
        known.into_iter().for_each(|(rho, z)| self.level.add(rho, z));
        let mut below: Option<Below> = None;
        let mut last_ground: Option<usize> = None;
        for (i, (point, &label)) in points.iter().zip(labels).enumerate() {
            if matches!(label, Label::Invalid | Label::Cover | Label::TooFar) {
                continue;
            }
            if point.range > params.max_range_m {
                break;
            }
            let is_ground = matches!(label, Label::Ground | Label::ShortObstacle);
            if let Some((near, level)) = last_ground.zip(self.level.at(point.rho, params.slope_limit)) {
                let near_rho = points[near].rho;
                let depth = level - point.z;
                let enough = params.depth_m + params.depth_noise * point.range;
                if depth > 0.5 * enough + LEVEL_DRIFT * (point.rho - near_rho).max(0.0) {
                    let run = below.get_or_insert(Below::after(near, near_rho));
                    run.take(point, depth, level, enough, params);
                    if point.rho - near_rho <= REACH_M {
                        continue;
                    }
                    // What stays that far below is a level of its own.
                    close(&mut below, None, params, holes);
                    self.level.clear();
                } else {
                    close(&mut below, Some((i, point.rho)), params, holes);
                }
            }
            self.keep(is_ground, point);
            if is_ground {
                last_ground = Some(i);
            }
        }
        close(&mut below, None, params, holes);
    }

    /// Takes ground for the level; anything else ends it.
    fn keep(&mut self, is_ground: bool, point: &ScanPoint) {
        if !is_ground || self.level.last().is_some_and(|last| point.rho - last > LEVEL_BASE_M) {
            self.level.clear();
        }
        if is_ground {
            self.level.add(point.rho, point.z);
        }
    }
}

impl Below {
    fn after(near: usize, near_rho: f32) -> Below {
        Below { near, near_rho, deep: 0, steep: 0, deepest: [0.0; 2] }
    }

    fn take(&mut self, point: &ScanPoint, depth: f32, level: f32, enough: f32, params: &NegativeParams) {
        if depth > self.deepest[1] {
            self.deepest = [point.rho, depth];
        }
        // The sensor is the origin, so the level lies `-level` below it. From below the level nothing is proven.
        let height = -level;
        let width = if height > 0.0 { point.rho * depth / (height + depth) } else { 0.0 };
        if depth >= enough && width >= params.width_m {
            self.deep += 1;
            self.steep += u32::from(depth > params.slope_limit * (point.rho - self.near_rho));
        }
    }
}

/// Ends a run of points below the level, at a point that is at it again (number and distance) or at none, and keeps it
/// if it is a hole.
fn close(
    below: &mut Option<Below>,
    far: Option<(usize, f32)>,
    params: &NegativeParams,
    holes: &mut Vec<Hole>,
) {
    let Some(run) = below.take() else { return };
    let [rho, depth] = run.deepest;
    let rises = far.is_some_and(|(_, far_rho)| depth > params.slope_limit * (far_rho - rho).max(0.0));
    if run.deep >= DEEP_POINTS && (rises || run.steep >= DEEP_POINTS) {
        holes.push(Hole { near: run.near, far: far.map(|(i, _)| i) });
    }
}
