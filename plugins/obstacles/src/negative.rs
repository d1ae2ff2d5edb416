//! Negative obstacles (ditches, holes and drops) in one column of a range image, of which the borders are reported
//! (Albus 2006a, 3.1.1, Albus 2006b, 3.1).
//!
//! A ray that meets a point below the ground level has crossed that level earlier; there is no ground from that
//! crossing to its end point. A point `δ` below the level at horizontal distance `ρ`, seen from height `h` above the
//! level, therefore proves a hole of width `ρ·δ/(h + δ)` along the column. The scan follows a column outward, keeps the
//! level as a line fitted to the last metre of ground, and groups consecutive points below it. A group is a hole where
//! enough of its points are deep enough and prove enough width, and no slope that counts as ground leads down to them
//! or up from them. Its borders are the last ground before the group and the first point at ground level behind it.
//!
//! What the paper leaves open: "below the ground level and large enough" is the depth and width above. A dip with
//! gentle slopes on both sides is ground, and so is a downward slope that is seen as one. Behind anything that rises
//! above the ground, new ground must be found before a hole can be detected.

use crate::level::{LEVEL_BASE_M, Level};
use crate::scan::{Label, ScanPoint};

/// Criteria for a negative obstacle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NegativeParams {
    /// Minimum depth below the ground level, m.
    pub depth_m: f32,
    /// Addition to the minimum depth for range noise, per metre of range.
    pub depth_noise: f32,
    /// Minimum proven width along the column, m.
    pub width_m: f32,
    /// Points farther than this are ignored, m.
    pub max_range_m: f32,
    /// Tangent of the steepest slope that counts as ground.
    pub slope_limit: f32,
}

/// A hole in a column, by the indices of its border points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Hole {
    /// The last ground before it.
    pub near: usize,
    /// The first point behind it at ground level again, if any.
    pub far: Option<usize>,
}

/// Uncertainty of the level per metre beyond the last ground point.
const LEVEL_DRIFT: f32 = 0.05;
/// Maximum extent of a hole, m.
const REACH_M: f32 = 3.0;
/// Minimum number of points of a hole that are deep and prove its width.
const DEEP_POINTS: u32 = 3;

/// A group of consecutive points below the level.
#[derive(Clone, Copy, Debug)]
struct Below {
    near: usize,
    near_rho: f32,
    /// Number of points that are deep enough and prove enough width, and how many of these cannot be reached by a
    /// ground slope.
    deep: u32,
    steep: u32,
    /// Distance and depth of the deepest point.
    deepest: [f32; 2],
}

/// Finds holes; keeps its working memory between columns.
#[derive(Clone, Debug, Default)]
pub struct HoleScan {
    level: Level,
}

impl HoleScan {
    /// Scans one column, given from the lowest ray to the highest with its labels. `known` is ground in the column's
    /// direction from earlier frames, nearer than its first point: distance and height, m, in ascending order.
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
                    // Points that stay below the old level for that long are on a new level.
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

    /// Adds a ground point to the level; any other point ends the level.
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
        // The sensor is the origin, so its height above the level is `-level`. A sensor below the level proves nothing.
        let height = -level;
        let width = if height > 0.0 { point.rho * depth / (height + depth) } else { 0.0 };
        if depth >= enough && width >= params.width_m {
            self.deep += 1;
            self.steep += u32::from(depth > params.slope_limit * (point.rho - self.near_rho));
        }
    }
}

/// Ends a group of points below the level, at a point that is at the level again (index and distance) or without one,
/// and records it if it is a hole.
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
