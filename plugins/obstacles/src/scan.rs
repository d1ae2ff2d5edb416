//! The scan of one column of a range image, upward from the known ground under the wheels (Albus 2006a, 3.1.1, figure
//! 6).
//!
//! A column contains the points `(rho, z)` of one vertical half-plane through the sensor, from the lowest ray to the
//! highest: `rho` is the horizontal distance from the sensor and `z` the height above it, m, with gravity along −z. The
//! scan keeps the last point that is ground, and decides for each further point whether it can be ground:
//!
//! - **In contact** (the last ground point is near): yes, if it rises no faster than the slope limit plus the minimum
//!   rise (`d` in the paper).
//! - **After a gap or an obstacle**: yes, if it is near the height expected from the slope so far, and the surface at
//!   the point is itself shallow. So a hedge behind a hollow is not taken for ground because it is far away, and a lawn
//!   behind a wall is ground again.
//!
//! The height of the ground never rises faster than the slope limit, so a wall with a gentle foot does not raise it.
//! Points that are not ground are labelled by their height above the local ground: the ground below them if the column
//! has seen it (for a branch that hangs into the image), otherwise the last ground before them, extended along the
//! surface itself where that continues without a jump (for a steep bank).
//!
//! What the paper leaves open: noise increases `d` in proportion to range. A run of consecutive obstacle points is
//! short only as a whole. What rises above the short height, but no more than noise alone could raise it, is neither
//! ground, nor short, nor an obstacle: such a point, or such a run, is too far to tell, and votes for nothing. A point
//! below the expected ground is ground, because negative obstacles are the task of another module. The exception is a
//! steep face that starts there beyond a gap: its foot is hidden, and the heights of its points are measured from its
//! lowest visible point.

use crate::level::Level;
pub use rcs_sense::ObstacleLabel as Label;

/// Thresholds of the scan: metres, and tangents of angles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScanParams {
    /// Nearer ranges are taken to be the vehicle itself.
    pub min_range_m: f32,
    /// Farther ranges are too uncertain to use.
    pub max_range_m: f32,
    /// Tangent of the steepest slope that counts as ground.
    pub slope_limit: f32,
    /// Tangent by which ground may rise above its expected slope after a gap.
    pub regain_slope: f32,
    /// Minimum rise of an obstacle (`d`).
    pub min_rise_m: f32,
    /// Addition to the minimum rise for range noise, per metre of range.
    pub rise_noise: f32,
    /// Obstacles that rise less than this are short.
    pub short_height_m: f32,
    /// From this height above ground on, points are cover.
    pub clearance_m: f32,
    /// Horizontal distance without ground after which contact is lost.
    pub gap_m: f32,
    /// Length across the ray over which the slope of a surface is measured.
    pub surface_span_m: f32,
    /// Tolerance of the height of the plane under the wheels.
    pub wheels_tolerance_m: f32,
}

impl Default for ScanParams {
    fn default() -> Self {
        Self {
            min_range_m: 0.3,
            max_range_m: 30.0,
            slope_limit: 0.364,
            regain_slope: 0.176,
            min_rise_m: 0.02,
            rise_noise: 0.002,
            short_height_m: 0.05,
            clearance_m: 1.5,
            gap_m: 0.5,
            surface_span_m: 0.15,
            wheels_tolerance_m: 0.1,
        }
    }
}

/// One point of a column, relative to the sensor, axes of the local frame (gravity along −z), m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScanPoint {
    /// Horizontal position.
    pub x: f32,
    /// Horizontal position.
    pub y: f32,
    /// Height.
    pub z: f32,
    /// Horizontal distance.
    pub rho: f32,
    /// Distance; 0 or NaN without a return.
    pub range: f32,
}

impl ScanPoint {
    /// A ray without a return.
    pub const NONE: ScanPoint = ScanPoint { x: 0.0, y: 0.0, z: 0.0, rho: 0.0, range: 0.0 };

    /// The point at a position.
    pub fn at(x: f32, y: f32, z: f32) -> ScanPoint {
        let flat = x * x + y * y;
        ScanPoint { x, y, z, rho: flat.sqrt(), range: (flat + z * z).sqrt() }
    }
}

/// Known ground from which a column starts: where the front wheels stand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Start {
    /// Horizontal distance from the sensor, m.
    pub rho: f32,
    /// Height relative to the sensor, m.
    pub z: f32,
    /// Slope (tangent) of the plane under the wheels, in the direction of the column.
    pub slope: f32,
}

/// Distance between the points of the ground profile, m.
const PROFILE_STEP_M: f32 = 0.1;
/// Number of points that are examined at most for the slope of a surface; of a column of more than four times as many
/// points, a quarter of the column. A surface at distance `rho` m spans `fy · surface_span_m / rho` rows of a level camera.
pub(crate) const LOOK_AHEAD: usize = 128;

/// Labels columns; keeps its working memory between them.
#[derive(Clone, Debug, Default)]
pub struct ColumnScan {
    /// Ground of this column: `(rho, z)` in ascending order of `rho`.
    profile: Vec<(f32, f32)>,
    /// Line through the last metre of the ground.
    level: Level,
}

/// A run of consecutive points that are not ground.
#[derive(Clone, Copy)]
struct Run {
    first: usize,
    last_rho: f32,
    max_rise: f32,
    first_rho: f32,
    /// Distance that the surface has reached without a jump.
    max_rho: f32,
    /// The run stands on hidden ground that is lower than expected: heights are measured from its own lowest point.
    low: bool,
    base: f32,
    /// Range of the first point.
    range: f32,
}

impl Run {
    fn new(first: usize, point: &ScanPoint, base: f32, low: bool) -> Run {
        let (rho, range) = (point.rho, point.range);
        Run { first, last_rho: rho, max_rise: 0.0, first_rho: rho, max_rho: rho, low, base, range }
    }
}

/// The slope of the surface above a point.
#[derive(Clone, Copy, PartialEq)]
enum Surface {
    Shallow,
    Steep,
    /// No point is seen above it.
    Unknown,
}

impl ColumnScan {
    /// Labels the points of one column, given from the lowest ray to the highest. `labels` has the length of `points`.
    pub fn scan(&mut self, points: &[ScanPoint], start: Start, params: &ScanParams, labels: &mut [Label]) {
        self.profile.clear();
        self.profile.push((start.rho, start.z));
        self.level.clear();
        let mut ground = (start.rho, start.z);
        let mut slope = start.slope.clamp(-params.slope_limit, params.slope_limit);
        let mut lost = true;
        let mut slack = params.wheels_tolerance_m;
        let mut run: Option<Run> = None;

        for (i, point) in points.iter().enumerate() {
            // Negated, so that NaN also counts as no range.
            if !(point.range >= params.min_range_m && point.range.is_finite()) {
                labels[i] = Label::Invalid;
                continue;
            }
            if point.range > params.max_range_m {
                labels[i] = Label::TooFar;
                continue;
            }
            let ahead = point.rho - ground.0;
            let tolerance = params.min_rise_m + params.rise_noise * point.range;
            if ahead >= 0.0 {
                lost |= ahead > params.gap_m;
                let (height, steepest) = if lost {
                    let steepest = (slope + params.regain_slope).clamp(0.0, params.slope_limit);
                    (self.smooth(ground, params), steepest)
                } else {
                    (ground.1, params.slope_limit)
                };
                let expected = height + slack + steepest * ahead;
                let within = point.z <= expected + tolerance;
                if within && (!lost || surface(points, i, params) == Surface::Shallow) {
                    end_run(&mut run, i, params, labels);
                    labels[i] = ground_label(point.z - expected, params);
                    lost = false;
                    let reach = slack + params.slope_limit * ahead;
                    slack = 0.0;
                    ground = (point.rho, point.z.max(ground.1 - reach).min(ground.1 + reach));
                    self.level.add(ground.0, ground.1);
                    slope = self.level.slope(params.slope_limit).unwrap_or(slope);
                    if self.profile.last().is_none_or(|last| ground.0 - last.0 >= PROFILE_STEP_M) {
                        self.profile.push(ground);
                    }
                    continue;
                }
            }
            let mut base = if ahead >= 0.0 {
                self.smooth(ground, params) + slope * ahead.min(params.gap_m)
            } else {
                self.height_at(point.rho)
            };
            if run.is_some_and(|run| (point.rho - run.last_rho).abs() > params.gap_m) {
                end_run(&mut run, i, params, labels);
            }
            if let Some(run) = run.filter(|run| run.low) {
                base = run.base;
            } else if point.z <= base + tolerance {
                // Ground, unless the point is lower than expected beyond a gap and a steep face rises there from hidden
                // ground.
                let low = ahead > params.gap_m && point.z < base - tolerance;
                if !low || surface(points, i, params) != Surface::Steep {
                    labels[i] = ground_label(point.z - base, params);
                    continue;
                }
                end_run(&mut run, i, params, labels);
                base = point.z;
                run = Some(Run::new(i, point, base, true));
            }
            lost = true;
            let run = run.get_or_insert(Run::new(i, point, base, false));
            let rise = point.z - base;
            run.max_rise = run.max_rise.max(rise);
            run.last_rho = point.rho;
            run.max_rho = run.max_rho.max(point.rho);
            let carried = params.slope_limit * (run.max_rho - run.first_rho);
            labels[i] = if rise - carried >= params.clearance_m { Label::Cover } else { Label::Obstacle };
        }
        end_run(&mut run, points.len(), params, labels);
    }

    /// Height of the last ground point, smoothed by the line.
    fn smooth(&self, ground: (f32, f32), params: &ScanParams) -> f32 {
        self.level.at(ground.0, params.slope_limit).unwrap_or(ground.1)
    }

    /// Height of this column's ground at a distance that the scan has passed.
    fn height_at(&self, rho: f32) -> f32 {
        let after = self.profile.partition_point(|&(r, _)| r <= rho);
        match (after.checked_sub(1).map(|before| self.profile[before]), self.profile.get(after)) {
            (Some((r0, z0)), Some(&(r1, z1))) => z0 + (z1 - z0) * (rho - r0) / (r1 - r0),
            (Some((_, z)), None) | (None, Some(&(_, z))) => z,
            (None, None) => 0.0,
        }
    }
}

/// Label of a point that rises no more above the highest expected ground than noise can: too far to tell where the rise
/// is more than short.
fn ground_label(rise_m: f32, params: &ScanParams) -> Label {
    if rise_m > params.short_height_m.max(params.min_rise_m) { Label::TooFar } else { Label::Ground }
}

/// Ends a run before point `end`. If none of it rises higher than the short height, the whole run is short. If it rises
/// higher, but by no more than the noise of its top and of the ground below it could add, the sensor cannot tell what it
/// is at that range, and the whole run is too far.
fn end_run(run: &mut Option<Run>, end: usize, params: &ScanParams, labels: &mut [Label]) {
    if let Some(run) = run.take()
        && run.max_rise < params.short_height_m + 2.0 * params.rise_noise * run.range
    {
        let is_short = run.max_rise < params.short_height_m;
        let label_of_run = if is_short { Label::ShortObstacle } else { Label::TooFar };
        for label in &mut labels[run.first..end] {
            if *label == Label::Obstacle {
                *label = label_of_run;
            }
        }
    }
}

/// The slope of the surface at point `i`, measured to the next point that is far enough above it in the image.
fn surface(points: &[ScanPoint], i: usize, params: &ScanParams) -> Surface {
    let point = points[i];
    let elevation = point.z / point.rho;
    for next in points.iter().skip(i + 1).take(LOOK_AHEAD.max(points.len() / 4)) {
        let has_range = next.range >= params.min_range_m && next.range.is_finite();
        if has_range && (next.z / next.rho - elevation) * point.rho >= params.surface_span_m {
            let tolerance = params.min_rise_m + params.rise_noise * point.range;
            let limit = tolerance + params.slope_limit * (next.rho - point.rho).max(0.0);
            return if next.z - point.z <= limit { Surface::Shallow } else { Surface::Steep };
        }
    }
    Surface::Unknown
}
