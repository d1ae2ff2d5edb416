//! The scan on scenes with known ground truth, and against its slow reference.

use crate::columns::Strip;
use crate::cost_map::{Certainty, CostMap};
use crate::negative_tests::{reference_level, reference_slope};
use crate::scan::{ColumnScan, Label, ScanParams, ScanPoint, Start};
use crate::scene::{HEIGHT, Scene, Truth, View, WIDTH};
use glam::{DVec3, Vec3};
use proptest::prelude::*;
use rcs_geom::CellIndex;
use rcs_sense::CELL_SIZE_M;
use rcs_world::{MAX_COST, SIDE, UNKNOWN_COST};
use std::collections::{BTreeMap, BTreeSet};

fn share(pairs: &[(Truth, Label)], of: impl Fn(Truth) -> bool, is: impl Fn(Label) -> bool) -> f64 {
    let chosen: Vec<Label> = pairs.iter().filter(|(truth, _)| of(*truth)).map(|(_, label)| *label).collect();
    assert!(chosen.len() > 20, "only {} pixels show that", chosen.len());
    chosen.iter().filter(|&&label| is(label)).count() as f64 / chosen.len() as f64
}

fn ground_only(pairs: &[(Truth, Label)]) -> f64 {
    share(pairs, |truth| truth == Truth::Ground, |label| matches!(label, Label::Ground | Label::TooFar))
}

#[test]
fn flat_ground_is_ground_as_far_as_ranges_are_believed() {
    let pairs = Scene::flat().look().labels(&ScanParams::default());
    assert_eq!(ground_only(&pairs), 1.0);
    assert!(pairs.iter().any(|pair| pair.1 == Label::TooFar));
    assert_eq!(share(&pairs, |truth| truth == Truth::Sky, |label| label == Label::Invalid), 1.0);
}

#[test]
fn ground_may_slope_ahead_of_a_vehicle_that_stands_on_the_slope() {
    for degrees in [-15.0, 15.0_f64] {
        let pairs = Scene::sloping(degrees.to_radians()).look().labels(&ScanParams::default());
        assert_eq!(ground_only(&pairs), 1.0, "{degrees} degrees");
    }
}

#[test]
fn a_ramp_at_the_wheels_is_ground_in_the_image_of_a_depth_camera_of_many_rows() {
    // A level camera of 1080 rows, 0.5 m above the ground, on which a ramp of 5° begins 0.4 m ahead.
    let slope = libm::tanf(5.0_f32.to_radians());
    let point = |row: u16| {
        let elevation = (f32::from(row) - 539.5) / 1070.0;
        let rho = (0.5 + 0.4 * slope) / (slope - elevation);
        if (0.0..100.0).contains(&rho) { ScanPoint::at(rho, 0.0, rho * elevation) } else { ScanPoint::NONE }
    };
    let points: Vec<ScanPoint> = (0..1080).map(point).collect();
    let (start, params) = (Start { rho: 0.4, z: -0.5, slope: 0.0 }, ScanParams::default());
    let mut labels = vec![Label::Invalid; points.len()];
    ColumnScan::default().scan(&points, start, &params, &mut labels);
    let near = points.iter().zip(&labels).filter(|(point, _)| point.range > 0.0 && point.range < 30.0);
    let near: Vec<Label> = near.map(|(_, label)| *label).collect();
    assert!(near.len() > 600 && near.iter().all(|label| *label == Label::Ground), "{near:?}");
    assert_eq!(labels, reference_scan(&points, start, &params));
}

#[test]
fn a_box_of_thirty_centimetres_is_an_obstacle_and_the_ground_around_it_is_not() {
    for slope_rad in [0.0, 0.26] {
        let scene = Scene::sloping(slope_rad).with_box([6.0, -0.5, 0.0], [6.4, 0.5, 0.3]);
        let pairs = scene.look().labels(&ScanParams::default());
        let upper = |truth| matches!(truth, Truth::Box { height_m, .. } if height_m > 0.06);
        assert_eq!(share(&pairs, upper, |label| label == Label::Obstacle), 1.0, "slope {slope_rad}");
        assert!(ground_only(&pairs) > 0.998, "slope {slope_rad}");
    }
}

#[test]
fn a_kerb_of_four_centimetres_is_short() {
    let scene = Scene::flat().with_box([2.5, -3.0, 0.0], [2.7, 3.0, 0.04]);
    let pairs = scene.look().labels(&ScanParams::default());
    assert!(pairs.iter().any(|pair| pair.1 == Label::ShortObstacle));
    assert!(pairs.iter().all(|pair| !matches!(pair.1, Label::Obstacle | Label::Cover)));
    let short_on_ground = pairs.iter().filter(|pair| **pair == (Truth::Ground, Label::ShortObstacle)).count();
    assert_eq!(short_on_ground, 0);
}

#[test]
fn what_noise_alone_could_have_raised_is_no_vote() {
    // At 6 m and 13 mm of noise per metre, a box of 15 cm cannot be told from ground; one of 30 cm can.
    let params = ScanParams { rise_noise: 0.013, ..ScanParams::default() };
    for (height_m, expected) in [(0.15, Label::TooFar), (0.3, Label::Obstacle)] {
        let scene = Scene::flat().with_box([6.0, -0.5, 0.0], [6.4, 0.5, height_m]);
        let pairs = scene.look().labels(&params);
        // Points of its flat top can be ground again.
        let top = |truth| matches!(truth, Truth::Box { height_m: at, .. } if at > height_m - 0.02);
        assert!(share(&pairs, top, |label| label == expected) > 0.5, "{height_m} m");
        assert!(pairs.iter().all(|pair| pair.1 != Label::ShortObstacle), "{height_m} m");
    }
}

#[test]
fn a_vote_is_worth_its_pixels_less_the_noise_of_their_range() {
    let check = |certainty: Certainty, x_m: f64, expected: std::ops::RangeInclusive<u8>| {
        let view = Scene::flat().look();
        let strips = view.strips(&ScanParams::default());
        let map = CostMap::new(
            &strips,
            &BTreeSet::new(),
            CellIndex::new(0, 0),
            view.placement.sensor,
            30.0,
            certainty,
        );
        let grid = map.to_grid("local", rcs_msg::Stamp(0));
        let grid = rcs_world::GridView::new(&grid).unwrap();
        let column = ((x_m / CELL_SIZE_M).floor() + 100.0) as usize;
        let worth = grid.field("worth.stereo").unwrap().get(column, 100).unwrap() as u8;
        assert!(expected.contains(&worth), "{worth} at {x_m} m, {certainty:?}");
    };
    let certain = Certainty { min_pixels: 1, pixels: 1, noise_per_m2: 0.0 };
    check(certain, 6.1, 255..=255);
    check(Certainty { pixels: 1_000_000, ..certain }, 6.1, 0..=2);
    // A noise of one cell at 6 m halves the vote.
    check(Certainty { noise_per_m2: 0.2 / 36.0, ..certain }, 6.1, 110..=160);
}

#[test]
fn a_branch_overhead_is_cover_and_the_ground_below_and_behind_it_is_ground() {
    let scene = Scene::flat().with_box([5.0, -1.0, 1.8], [5.4, 1.0, 2.0]);
    let pairs = scene.look().labels(&ScanParams::default());
    let branch = |truth| matches!(truth, Truth::Box { .. });
    assert_eq!(share(&pairs, branch, |label| label == Label::Cover), 1.0);
    assert_eq!(ground_only(&pairs), 1.0);
}

#[test]
fn a_beam_lower_than_the_vehicle_is_an_obstacle() {
    let scene = Scene::flat().with_box([5.0, -1.0, 1.0], [5.4, 1.0, 1.3]);
    let pairs = scene.look().labels(&ScanParams::default());
    let beam = |truth| matches!(truth, Truth::Box { .. });
    assert_eq!(share(&pairs, beam, |label| label == Label::Obstacle), 1.0);
}

#[test]
fn a_trunk_is_an_obstacle_below_the_clearance_and_cover_above() {
    let scene = Scene::flat().with_box([6.0, -0.2, 0.0], [6.4, 0.2, 4.0]);
    let pairs = scene.look().labels(&ScanParams::default());
    let low = |truth| matches!(truth, Truth::Box { height_m, .. } if (0.06..1.49).contains(&height_m));
    let high = |truth| matches!(truth, Truth::Box { height_m, .. } if height_m > 1.51);
    assert_eq!(share(&pairs, low, |label| label == Label::Obstacle), 1.0);
    assert_eq!(share(&pairs, high, |label| label == Label::Cover), 1.0);
}

#[test]
fn ground_behind_an_obstacle_is_ground_again_and_a_hedge_far_behind_it_is_not() {
    let scene = Scene::flat()
        .with_box([4.0, -6.0, 0.0], [4.2, 6.0, 0.3])
        .with_box([14.0, -9.0, 0.0], [15.0, 9.0, 1.0]);
    let pairs = scene.look().labels(&ScanParams::default());
    assert!(ground_only(&pairs) > 0.99, "{}", ground_only(&pairs));
    let hedge = |truth| matches!(truth, Truth::Box { number: 1, height_m } if height_m > 0.12);
    assert!(share(&pairs, hedge, |label| label == Label::Obstacle) > 0.99);
}

#[test]
fn missing_pixels_do_not_break_the_scan() {
    let mut view = Scene::flat().with_box([6.0, -0.5, 0.0], [6.4, 0.5, 0.3]).look();
    // Two of three pixels have no range: NaN or 0.
    for (i, pixel) in view.depth.chunks_exact_mut(4).enumerate() {
        match i * 7 % 3 {
            0 => {}
            1 => pixel.copy_from_slice(&f32::NAN.to_le_bytes()),
            _ => pixel.fill(0),
        }
    }
    let pairs = view.labels(&ScanParams::default());
    let upper = |truth| matches!(truth, Truth::Box { height_m, .. } if height_m > 0.06);
    // In some columns a single pixel of the box remains.
    assert!(share(&pairs, upper, |label| matches!(label, Label::Obstacle | Label::Invalid)) > 0.9);
    assert!(share(&pairs, |truth| truth == Truth::Ground, |label| label == Label::Obstacle) < 0.002);
}

#[test]
fn a_cell_costs_its_share_of_obstacle_pixels_and_cover_does_not_count() {
    let scene = Scene::flat().with_box([6.0, -0.4, 0.0], [6.4, 0.4, 4.0]);
    let view = scene.look();
    let map = CostMap::new(
        &view.strips(&ScanParams::default()),
        &BTreeSet::new(),
        CellIndex::new(0, 0),
        view.placement.sensor,
        30.0,
        Certainty { min_pixels: 1, pixels: 1, noise_per_m2: 0.0 },
    );
    let costs: Vec<u8> = map.costs().collect();
    let at = |x_m: f64, y_m: f64| {
        let index = |v: f64| ((v / CELL_SIZE_M).floor() + 100.0) as usize;
        costs[index(y_m) * SIDE + index(x_m)]
    };
    // The front face lies on the border between cells; points that fall behind it are nearly all trunk.
    assert!(at(6.05, 0.1).min(at(5.95, 0.1)) < MAX_COST);
    assert!(at(6.05, 0.1).max(at(5.95, 0.1)) > 200);
    assert_eq!(at(4.1, 0.1), 0);
    assert_eq!(at(-4.1, 0.1), UNKNOWN_COST);
}

// Reference implementation: computes everything anew for each point.

struct Reference<'a> {
    points: &'a [ScanPoint],
    start: Start,
    params: &'a ScanParams,
    /// Ground points found so far: index, and height of the envelope.
    ground: Vec<(f32, f32)>,
}

impl Reference<'_> {
    fn has_range(&self, i: usize) -> bool {
        let range = self.points[i].range;
        range.is_finite() && range >= self.params.min_range_m
    }

    fn last(&self) -> (f32, f32) {
        self.ground.last().copied().unwrap_or((self.start.rho, self.start.z))
    }

    /// The line through the last metre of ground, at the last ground point: its height and slope.
    fn smooth(&self) -> (f32, f32) {
        let (limit, last) = (self.params.slope_limit, self.last());
        let start = self.start.slope.clamp(-limit, limit);
        // While there is no line, the slope is that of the last line, or of the start.
        let slope = (1..=self.ground.len()).rev().find_map(|n| reference_slope(&self.ground[..n], limit));
        let height = reference_level(&self.ground, last.0, limit);
        (height.unwrap_or(last.1), slope.unwrap_or(start))
    }

    fn profile(&self, rho: f32) -> f32 {
        let mut kept = vec![(self.start.rho, self.start.z)];
        for &point in &self.ground {
            if point.0 - kept[kept.len() - 1].0 >= 0.1 {
                kept.push(point);
            }
        }
        let Some(before) = kept.iter().rposition(|point| point.0 <= rho) else { return kept[0].1 };
        match kept.get(before + 1) {
            Some(&(r1, z1)) => {
                let (r0, z0) = kept[before];
                z0 + (z1 - z0) * (rho - r0) / (r1 - r0)
            }
            None => kept[before].1,
        }
    }

    /// `Some(true)` shallow, `Some(false)` steep.
    fn shallow(&self, i: usize) -> Option<bool> {
        let point = self.points[i];
        let high_enough = |j: &usize| {
            let next = self.points[*j];
            self.has_range(*j)
                && (next.z / next.rho - point.z / point.rho) * point.rho >= self.params.surface_span_m
        };
        let count = self.points.len();
        let end = count.min(i + 1 + (count / 4).max(128));
        let next = self.points[(i + 1..end).find(high_enough)?];
        let tolerance = self.params.min_rise_m + self.params.rise_noise * point.range;
        Some(next.z - point.z <= tolerance + self.params.slope_limit * (next.rho - point.rho).max(0.0))
    }
}

/// A run of consecutive points that are not ground, with their rise.
struct ReferenceRun {
    points: Vec<(usize, f32)>,
    low: bool,
    base: f32,
}

fn reference_scan(points: &[ScanPoint], start: Start, params: &ScanParams) -> Vec<Label> {
    let mut reference = Reference { points, start, params, ground: Vec::new() };
    let mut labels = vec![Label::Invalid; points.len()];
    let mut runs: Vec<ReferenceRun> = Vec::new();
    let mut open = false;
    let mut lost = true;
    // What only noise lets pass as ground is no ground where it is higher than short.
    let short = params.short_height_m.max(params.min_rise_m);
    let ground = |rise: f32| if rise > short { Label::TooFar } else { Label::Ground };
    for i in 0..points.len() {
        if !reference.has_range(i) {
            continue;
        }
        let point = points[i];
        if point.range > params.max_range_m {
            labels[i] = Label::TooFar;
            continue;
        }
        let tolerance = params.min_rise_m + params.rise_noise * point.range;
        let (last, (smooth, slope)) = (reference.last(), reference.smooth());
        let ahead = point.rho - last.0;
        let slack = if reference.ground.is_empty() { params.wheels_tolerance_m } else { 0.0 };
        if ahead >= 0.0 {
            lost = lost || ahead > params.gap_m;
            let regain = (slope + params.regain_slope).clamp(0.0, params.slope_limit);
            let steepest = if lost { regain } else { params.slope_limit };
            let height = if lost { smooth } else { last.1 };
            let highest = height + slack + steepest * ahead;
            if point.z <= highest + tolerance && (!lost || reference.shallow(i) == Some(true)) {
                let reach = slack + params.slope_limit * ahead;
                reference.ground.push((point.rho, point.z.max(last.1 - reach).min(last.1 + reach)));
                labels[i] = ground(point.z - highest);
                (lost, open) = (false, false);
                continue;
            }
        }
        let expected = if ahead >= 0.0 {
            smooth + slope * ahead.min(params.gap_m)
        } else {
            reference.profile(point.rho)
        };
        if let Some(run) = runs.last()
            && (point.rho - points[run.points[run.points.len() - 1].0].rho).abs() > params.gap_m
        {
            open = false;
        }
        let low_base = runs.last().filter(|run| open && run.low).map(|run| run.base);
        let mut base = low_base.unwrap_or(expected);
        if low_base.is_none() && point.z <= expected + tolerance {
            let low = ahead > params.gap_m && point.z < expected - tolerance;
            if !low || reference.shallow(i) != Some(false) {
                labels[i] = ground(point.z - expected);
                continue;
            }
            base = point.z;
            runs.push(ReferenceRun { points: Vec::new(), low: true, base });
            open = true;
        } else if !open {
            runs.push(ReferenceRun { points: Vec::new(), low: false, base });
            open = true;
        }
        lost = true;
        let last_run = runs.len() - 1;
        runs[last_run].points.push((i, point.z - base));
    }
    for ReferenceRun { points: run, .. } in &runs {
        let highest = run.iter().map(|&(_, rise)| rise).fold(0.0, f32::max);
        let noise = 2.0 * params.rise_noise * points[run[0].0].range;
        let mut farthest = points[run[0].0].rho;
        for &(i, rise) in run {
            farthest = farthest.max(points[i].rho);
            let carried = params.slope_limit * (farthest - points[run[0].0].rho);
            labels[i] = if rise - carried >= params.clearance_m {
                Label::Cover
            } else if highest < params.short_height_m {
                Label::ShortObstacle
            } else if highest < params.short_height_m + noise {
                Label::TooFar
            } else {
                Label::Obstacle
            };
        }
    }
    labels
}

/// A rough column: undulating ground, steps, gaps, objects.
fn column() -> impl Strategy<Value = Vec<ScanPoint>> {
    let step = (0.0..0.4_f32, -0.08..0.1_f32, 0..12_u8, 0.0..2.5_f32);
    prop::collection::vec(step, 1..120).prop_map(|steps| {
        let (mut rho, mut z) = (0.5_f32, -1.2_f32);
        let mut points = Vec::new();
        for (forward, up, kind, height) in steps {
            match kind {
                0 => points.push(ScanPoint::NONE),
                1 => points.push(ScanPoint { range: f32::NAN, ..ScanPoint::at(rho, 0.0, z) }),
                2 => z += height * 0.3,
                3 => points.push(ScanPoint::at((rho - height).max(0.1), 0.0, z + height)),
                4 | 5 => points.push(ScanPoint::at(rho, 0.0, z + height)),
                6 => rho += 4.0 * forward,
                _ => {
                    rho += forward;
                    z += up * forward.min(0.2);
                    points.push(ScanPoint::at(rho, 0.0, z));
                }
            }
        }
        points
    })
}

/// Reference result for a depth image, pixel by pixel: labels in row order and counts by cell.
fn reference_image(view: &View, params: &ScanParams) -> (Vec<Label>, BTreeMap<[i32; 2], [u32; 2]>) {
    let turn = view.turn.as_mat3();
    let mut labels = vec![Label::Invalid; WIDTH * HEIGHT];
    let mut cells: BTreeMap<[i32; 2], [u32; 2]> = BTreeMap::new();
    for column in 0..WIDTH {
        let mut points = Vec::new();
        for row in (0..HEIGHT).rev() {
            let at = (row * WIDTH + column) * 4;
            let bytes = &view.depth[at..at + 4];
            let depth = f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
            let ray = view.camera.unproject(glam::DVec2::new(column as f64, row as f64)).unwrap();
            let p = turn * Vec3::new(ray.x as f32 * depth, ray.y as f32 * depth, depth);
            points.push(if depth > 0.0 { ScanPoint::at(p.x, p.y, p.z) } else { ScanPoint::NONE });
        }
        let Some(near) = points.iter().find(|p| p.range >= params.min_range_m && p.rho > 0.0) else {
            continue;
        };
        let (rho, x, y) = (f64::from(near.rho), f64::from(near.x), f64::from(near.y));
        let start = view.ground_plane.start(x / rho, y / rho);
        for (up, (point, label)) in points.iter().zip(reference_scan(&points, start, params)).enumerate() {
            labels[(HEIGHT - 1 - up) * WIDTH + column] = label;
            let place = view.placement.sensor + DVec3::new(f64::from(point.x), f64::from(point.y), 0.0);
            let cell = [(place.x / CELL_SIZE_M).floor() as i32, (place.y / CELL_SIZE_M).floor() as i32];
            match label {
                Label::Ground | Label::ShortObstacle => cells.entry(cell).or_default()[0] += 1,
                Label::Obstacle => cells.entry(cell).or_default()[1] += 1,
                Label::Invalid | Label::Cover | Label::TooFar => {}
            }
        }
    }
    (labels, cells)
}

fn votes_by_cell(strips: &[Strip]) -> BTreeMap<[i32; 2], [u32; 2]> {
    let mut cells: BTreeMap<[i32; 2], [u32; 2]> = BTreeMap::new();
    for vote in strips.iter().flat_map(|strip| &strip.votes) {
        let counts = cells.entry(vote.cell).or_default();
        counts[0] += vote.ground.count;
        counts[1] += vote.obstacle.count;
    }
    cells
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(512))]
    #[test]
    fn the_scan_equals_the_plain_rule(points in column(), slope in -0.3..0.3_f32, gap_m in 0.1..2.0_f32) {
        let params = ScanParams { gap_m, ..ScanParams::default() };
        let start = Start { rho: 0.4, z: -1.2, slope };
        let mut labels = vec![Label::Invalid; points.len()];
        let mut scan = ColumnScan::default();
        // The previous column must have no influence.
        scan.scan(&points, Start { z: 0.0, ..start }, &params, &mut labels);
        scan.scan(&points, start, &params, &mut labels);
        prop_assert_eq!(labels, reference_scan(&points, start, &params));
    }

    #[test]
    fn any_numbers_at_all_give_labels(values in prop::collection::vec(any::<[f32; 5]>(), 0..50), start in any::<[f32; 3]>()) {
        let points: Vec<ScanPoint> =
            values.into_iter().map(|[x, y, z, rho, range]| ScanPoint { x, y, z, rho, range }).collect();
        let mut labels = vec![Label::Invalid; points.len()];
        let start = Start { rho: start[0], z: start[1], slope: start[2] };
        ColumnScan::default().scan(&points, start, &ScanParams::default(), &mut labels);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]
    #[test]
    fn the_pipeline_equals_the_plain_rule_pixel_by_pixel(
        slope_rad in -0.2..0.2, boxes in prop::collection::vec((3.0..12.0, -3.0..3.0, 0.02..2.5), 0..5), holes in any::<u64>(),
    ) {
        let scene = boxes.iter().fold(Scene::sloping(slope_rad), |scene, &(x, y, height)| {
            scene.with_box([x, y, 0.0], [x + 0.4, y + 0.6, height])
        });
        let mut view = scene.look();
        for (i, pixel) in view.depth.chunks_exact_mut(4).enumerate() {
            if (i as u64).wrapping_mul(holes | 1).is_multiple_of(5) {
                pixel.fill(0);
            }
        }
        let params = ScanParams::default();
        let (labels, cells) = reference_image(&view, &params);
        let found: Vec<Label> = view.labels(&params).into_iter().map(|pair| pair.1).collect();
        prop_assert!(found == labels);
        let votes = votes_by_cell(&view.strips(&params));
        // A point on the border of two cells may fall on either side.
        let total = |cells: &BTreeMap<[i32; 2], [u32; 2]>| cells.values().map(|c| u64::from(c[0] + c[1])).sum::<u64>();
        prop_assert_eq!(total(&votes), total(&cells));
        let moved: u64 = cells
            .iter()
            .map(|(cell, counts)| {
                let other = votes.get(cell).copied().unwrap_or_default();
                u64::from(counts[0].abs_diff(other[0]) + counts[1].abs_diff(other[1]))
            })
            .sum();
        prop_assert!(moved <= 4, "{moved} of {} pixels in another cell", total(&cells));
    }
}
