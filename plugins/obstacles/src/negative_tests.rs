//! The scan for negative obstacles on scenes with known ground truth, and against its slow reference.

use crate::columns::{KnownGround, Strip, Survey};
use crate::cost_map::{Certainty, CostMap};
use crate::depth_image::label_image;
use crate::ground_map::{BorderRule, GROUND_CELL_M, GroundMap};
use crate::negative::{Hole, HoleScan, NegativeParams};
use crate::scan::{Label, ScanParams, ScanPoint};
use crate::scene::{Scene, View};
use proptest::prelude::*;
use rcs_geom::CellIndex;
use rcs_world::{MAX_COST, SIDE};
use std::collections::BTreeSet;

const PARAMS: NegativeParams =
    NegativeParams { depth_m: 0.08, depth_noise: 0.002, width_m: 0.2, max_range_m: 8.0, slope_limit: 0.364 };
const RULE: BorderRule =
    BorderRule { memory_ns: 5_000_000_000, min_votes: 4, min_frames: 1, min_length_m: 0.2 };

struct Found {
    strips: Vec<Strip>,
    cells: BTreeSet<CellIndex>,
    pixels: u64,
}

/// Processes one frame and adds it to a map.
fn look(view: &View, map: &mut GroundMap, time_ns: u64) -> Found {
    look_by(view, map, time_ns, &RULE)
}

fn look_by(view: &View, map: &mut GroundMap, time_ns: u64, rule: &BorderRule) -> Found {
    let known = Some(KnownGround { map, since_ns: 0, until_ns: u64::MAX });
    let survey = Survey { negative: Some(PARAMS), known, ..view.survey(ScanParams::default()) };
    let mut strips = view.strips_of(&survey, &[]);
    let votes = strips.iter().flat_map(|strip| &strip.ground);
    let cells = map.add(votes, view.placement.sensor.z, time_ns, rule);
    let is_border = |[x, y]: [i32; 2]| cells.contains(&CellIndex::new(x.into(), y.into()));
    let pixels = strips.iter_mut().map(|strip| strip.mark_borders(is_border)).sum();
    Found { strips, cells, pixels }
}

fn look_once(scene: &Scene) -> Found {
    look(&scene.look(), &mut GroundMap::new().unwrap(), 1)
}

/// Smallest and largest x of the cells, m.
fn extent(cells: &BTreeSet<CellIndex>) -> [f64; 2] {
    let x = || cells.iter().map(|cell| cell.x as f64 * GROUND_CELL_M);
    [x().fold(f64::INFINITY, f64::min), x().fold(f64::NEG_INFINITY, f64::max) + GROUND_CELL_M]
}

#[test]
fn both_borders_of_a_ditch_are_found_and_nothing_between_or_beyond_them() {
    for slope_rad in [-0.1, 0.0, 0.1] {
        let scene = Scene::sloping(slope_rad).with_ditch([2.6, -2.0], [3.0, 2.0], 0.6);
        let Found { strips, cells, pixels } = look_once(&scene);
        let [low, high] = extent(&cells);
        assert!(
            (2.39..2.61).contains(&low) && (2.99..3.21).contains(&high),
            "slope {slope_rad}: {low} {high}"
        );
        let is_inside = |cell: &&CellIndex| (2.7..2.85).contains(&((cell.x as f64 + 0.5) * GROUND_CELL_M));
        assert_eq!(cells.iter().find(is_inside), None, "slope {slope_rad}");
        let obstacles: u64 = strips.iter().map(|strip| strip.counts[Label::Obstacle as usize]).sum();
        assert!(pixels > 50 && obstacles >= pixels, "slope {slope_rad}: {pixels} of {obstacles}");
        let labelled = strips.iter().flat_map(|strip| &strip.labels);
        assert_eq!(obstacles, labelled.filter(|&&label| label == Label::Obstacle).count() as u64);
    }
}

#[test]
fn a_camera_upside_down_sees_the_same_ditch_and_the_same_labels() {
    let scene =
        Scene::flat().with_ditch([2.6, -2.0], [3.0, 2.0], 0.6).with_box([5.0, -0.5, 0.0], [5.4, 0.5, 0.4]);
    let (upright, turned) = (scene.look(), scene.look().upside_down());
    let [expected, found] = [&upright, &turned].map(|view| look(view, &mut GroundMap::new().unwrap(), 1));
    assert!(!expected.cells.is_empty());
    assert_eq!((found.cells, found.pixels), (expected.cells, expected.pixels));
    let mut labels = label_image(&found.strips, &turned.image());
    labels.reverse();
    assert!(labels == label_image(&expected.strips, &upright.image()), "labels differ");
}

#[test]
fn ground_has_no_holes_however_it_slopes() {
    for slope_rad in [-0.26, -0.1, 0.0, 0.1, 0.26] {
        assert_eq!(look_once(&Scene::sloping(slope_rad)).cells.len(), 0, "slope {slope_rad}");
    }
    let boxes =
        Scene::flat().with_box([3.0, -0.5, 0.0], [3.3, 0.5, 0.3]).with_box([5.0, -2.0, 0.0], [5.1, 2.0, 1.0]);
    assert_eq!(look_once(&boxes).cells.len(), 0);
}

#[test]
fn a_ditch_too_shallow_or_too_narrow_is_ground() {
    assert_eq!(look_once(&Scene::flat().with_ditch([2.0, -2.0], [2.5, 2.0], 0.07)).cells.len(), 0);
    assert_eq!(look_once(&Scene::flat().with_ditch([2.0, -2.0], [2.15, 2.0], 0.6)).cells.len(), 0);
    // Deep and wide enough, but too short across the view.
    assert_eq!(look_once(&Scene::flat().with_ditch([2.0, 0.01], [2.5, 0.09], 0.6)).cells.len(), 0);
}

#[test]
fn a_drop_is_found_by_its_edge() {
    // The ground ends two metres ahead; what lies below is hidden, except for the far part of the bottom.
    let scene = Scene::flat().with_ditch([2.0, -20.0], [40.0, 20.0], 0.5);
    let [low, high] = extent(&look_once(&scene).cells);
    assert!((1.79..2.01).contains(&low) && high < 2.11, "{low} {high}");
}

const CERTAINTY: Certainty = Certainty { min_pixels: 1, pixels: 1, noise_per_m2: 0.0 };

#[test]
fn a_cell_with_a_border_has_the_highest_cost() {
    let scene = Scene::flat().with_ditch([2.6, -2.0], [3.0, 2.0], 0.6);
    let view = scene.look();
    let Found { strips, cells, .. } = look(&view, &mut GroundMap::new().unwrap(), 1);
    let cells: BTreeSet<CellIndex> =
        cells.iter().map(|cell| CellIndex::new(cell.x.div_euclid(2), cell.y.div_euclid(2))).collect();
    let map = CostMap::new(&strips, &cells, CellIndex::new(0, 0), view.placement.sensor, 30.0, CERTAINTY);
    let costs: Vec<u8> = map.costs().collect();
    for cell in &cells {
        assert_eq!(costs[(cell.y + 100) as usize * SIDE + (cell.x + 100) as usize], MAX_COST);
    }
    // Without the borders the cost is low: much ground is seen there.
    let map =
        CostMap::new(&strips, &BTreeSet::new(), CellIndex::new(0, 0), view.placement.sensor, 30.0, CERTAINTY);
    let costs: Vec<u8> = map.costs().collect();
    let low =
        cells.iter().filter(|cell| costs[(cell.y + 100) as usize * SIDE + (cell.x + 100) as usize] < 125);
    assert!(low.count() > 5);
}

#[test]
fn colours_of_a_cell_are_the_mean_of_its_pixels() {
    let view = Scene::flat().look();
    let size = view.rays.width * view.rays.height;
    let rgb: Vec<u8> = (0..size).flat_map(|i| [10 + (i % 2 * 20) as u8, 40, 200]).collect();
    let strips = view.strips_of(&view.survey(ScanParams::default()), &rgb);
    let map =
        CostMap::new(&strips, &BTreeSet::new(), CellIndex::new(0, 0), view.placement.sensor, 30.0, CERTAINTY);
    let grid = map.to_grid("local", rcs_msg::Stamp(0));
    let grid = rcs_world::GridView::new(&grid).unwrap();
    let field = |name: &str| grid.field(name).unwrap();
    let (column, row) = (115, 100);
    let seen = ["red", "green", "blue", "alpha"].map(|name| field(name).get(column, row).unwrap());
    assert!((15.0..=25.0).contains(&seen[0]), "{seen:?}");
    assert_eq!(seen[1..], [40.0, 200.0, 255.0]);
    assert_eq!(field("cost.stereo").get(column, row), Some(0.0));
    assert_eq!(field("alpha").get(0, 0), Some(0.0));
}

/// Votes for borders in the cells before the vehicle.
fn votes_for_borders(map: &GroundMap) -> u32 {
    let cells = (-200..200).flat_map(|y| (0..100).map(move |x| CellIndex::new(x, y)));
    cells.filter_map(|cell| map.get(cell)).map(|cell| u32::from(cell.borders)).sum()
}

#[test]
fn borders_are_gathered_over_frames_forgotten_with_time_and_taken_back_by_ground() {
    let ditch = Scene::flat().with_ditch([2.6, -2.0], [3.0, 2.0], 0.6).look();
    let flat = Scene::flat().look();
    let second = 1_000_000_000;
    let mut map = GroundMap::new().unwrap();
    let first = look(&ditch, &mut map, second).cells.len();
    let once = votes_for_borders(&map);
    // Cells with too few columns in one frame have enough after the next one.
    assert!(look(&ditch, &mut map, 2 * second).cells.len() >= first);
    let twice = votes_for_borders(&map);
    assert!(twice > once);
    assert_eq!(look(&flat, &mut map, 3 * second).cells.len(), 0, "only what this frame sees is reported");
    assert!(votes_for_borders(&map) < twice);
    look(&flat, &mut map, 60 * second);
    assert_eq!(votes_for_borders(&map), 0);
}

#[test]
fn what_was_seen_by_a_clock_before_it_began_again_is_forgotten() {
    let ditch = Scene::flat().with_ditch([2.6, -2.0], [3.0, 2.0], 0.6).look();
    let second = 1_000_000_000;
    let mut map = GroundMap::new().unwrap();
    for time_s in [100, 101] {
        look(&ditch, &mut map, time_s * second);
    }
    assert!(votes_for_borders(&map) > 0);
    look(&Scene::flat().look(), &mut map, second);
    assert_eq!(votes_for_borders(&map), 0);
    // By the new clock it is forgotten with time, too.
    look(&ditch, &mut map, 2 * second);
    assert!(votes_for_borders(&map) > 0);
    look(&Scene::flat().look(), &mut map, 20 * second);
    assert_eq!(votes_for_borders(&map), 0);
}

#[test]
fn one_frame_alone_reports_no_border_where_votes_must_come_from_two() {
    let ditch = Scene::flat().with_ditch([2.6, -2.0], [3.0, 2.0], 0.6).look();
    let rule = BorderRule { min_frames: 2, ..RULE };
    let mut map = GroundMap::new().unwrap();
    let second = 1_000_000_000;
    assert_eq!(look_by(&ditch, &mut map, second, &rule).cells.len(), 0);
    let twice = look_by(&ditch, &mut map, 2 * second, &rule).cells.len();
    assert!(twice >= look(&ditch, &mut GroundMap::new().unwrap(), second).cells.len());
}

fn mm(metres: f32) -> i64 {
    (metres * 1000.0).round().clamp(-1e7, 1e7) as i64
}

/// The last metre of ground, in whole millimetres.
fn reference_base(ground: &[(f32, f32)]) -> Vec<[i64; 2]> {
    let newest = ground.last().map_or(0, |point| mm(point.0));
    let first = ground.iter().rposition(|point| newest - mm(point.0) > 1000).map_or(0, |i| i + 1);
    ground[first..].iter().map(|&(r, z)| [mm(r), mm(z)]).collect()
}

/// Slope of the least-squares line; `None` with fewer than 6 points or less than 0.3 m.
pub(crate) fn reference_slope(ground: &[(f32, f32)], limit: f32) -> Option<f32> {
    let base = reference_base(ground);
    if base.len() < 6 || base[base.len() - 1][0] - base[0][0] < 300 {
        return None;
    }
    let sum = |value: fn(&[i64; 2]) -> i64| base.iter().map(value).sum::<i64>();
    let (n, r, z) = (base.len() as i64, sum(|p| p[0]), sum(|p| p[1]));
    let (rr, rz) = (sum(|p| p[0] * p[0]), sum(|p| p[0] * p[1]));
    let [n, r, z, rr, rz] = [n, r, z, rr, rz].map(i128::from);
    let slope = (n * rz - r * z) as f64 / (n * rr - r * r).max(1) as f64;
    Some((slope as f32).clamp(-limit, limit))
}

/// Height of that line, m.
pub(crate) fn reference_level(ground: &[(f32, f32)], rho: f32, limit: f32) -> Option<f32> {
    let slope = f64::from(reference_slope(ground, limit)?);
    let base = reference_base(ground);
    let (n, r) = (base.len() as f64, base.iter().map(|p| p[0]).sum::<i64>() as f64);
    let z = base.iter().map(|p| p[1]).sum::<i64>() as f64;
    Some(((z + slope * (f64::from(rho) * 1000.0 * n - r)) / n / 1000.0) as f32)
}

/// Reference implementation: the line is fitted again for each point.
fn reference_holes(points: &[ScanPoint], labels: &[Label], params: &NegativeParams) -> Vec<Hole> {
    let mut holes = Vec::new();
    let mut ground: Vec<(f32, f32)> = Vec::new();
    let mut last_ground = None;
    let mut run: Vec<(usize, f32, f32)> = Vec::new();
    let mut near = 0;
    let is_hole = |run: &[(usize, f32, f32)], near: usize, far: Option<usize>| {
        let near_rho = points[near].rho;
        let proofs = run.iter().filter(|&&(i, depth, level)| {
            let (rho, range) = (points[i].rho, points[i].range);
            let width = if level < 0.0 { rho * depth / (depth - level) } else { 0.0 };
            depth >= params.depth_m + params.depth_noise * range && width >= params.width_m
        });
        let deep: Vec<_> = proofs.collect();
        let steep =
            |&&&(i, depth, _): &&&(usize, f32, f32)| depth > params.slope_limit * (points[i].rho - near_rho);
        let mut deepest = (0.0, 0.0);
        for &(i, depth, _) in run {
            if depth > deepest.1 {
                deepest = (points[i].rho, depth);
            }
        }
        let rises =
            far.is_some_and(|far| deepest.1 > params.slope_limit * (points[far].rho - deepest.0).max(0.0));
        deep.len() >= 3 && (rises || deep.iter().filter(steep).count() >= 3)
    };
    for (i, point) in points.iter().enumerate() {
        if matches!(labels[i], Label::Invalid | Label::Cover | Label::TooFar) {
            continue;
        }
        if point.range > params.max_range_m {
            break;
        }
        let is_ground = matches!(labels[i], Label::Ground | Label::ShortObstacle);
        if let (Some(last), Some(level)) =
            (last_ground, reference_level(&ground, point.rho, params.slope_limit))
        {
            let last: usize = last;
            let depth = level - point.z;
            let enough = params.depth_m + params.depth_noise * point.range;
            let ahead = point.rho - points[last].rho;
            if depth > 0.5 * enough + 0.05 * ahead.max(0.0) {
                if run.is_empty() {
                    near = last;
                }
                run.push((i, depth, level));
                if ahead <= 3.0 {
                    continue;
                }
                if is_hole(&run, near, None) {
                    holes.push(Hole { near, far: None });
                }
                ground.clear();
            } else if !run.is_empty() && is_hole(&run, near, Some(i)) {
                holes.push(Hole { near, far: Some(i) });
            }
            run.clear();
        }
        let far_away =
            ground.last().is_some_and(|&(rho, _)| point.rho - (rho * 1000.0).round() / 1000.0 > 1.0);
        if !is_ground || far_away {
            ground.clear();
        }
        if is_ground {
            ground.push((point.rho, point.z));
            last_ground = Some(i);
        }
    }
    if !run.is_empty() && is_hole(&run, near, None) {
        holes.push(Hole { near, far: None });
    }
    holes
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]
    #[test]
    fn the_scan_equals_the_plain_rule(
        steps in prop::collection::vec((0.01..0.12_f32, -0.02..0.02_f32, 0..40_u8), 20..120),
        holes in prop::collection::vec((1.0..6.0_f32, 0.1..1.0_f32, 0.05..0.6_f32), 0..4),
        slope in -0.3..0.3_f32,
    ) {
        let (mut rho, mut points, mut labels) = (0.8_f32, Vec::new(), Vec::new());
        for (step, noise, kind) in steps {
            rho += step;
            let depth = holes.iter().filter(|(from, wide, _)| rho > *from && rho < from + wide).map(|hole| hole.2);
            let z = -1.0 + slope * rho + noise - depth.fold(0.0, f32::max);
            points.push(ScanPoint::at(rho, 0.0, z));
            labels.push(match kind {
                0 => Label::Invalid,
                1 => Label::Obstacle,
                2 => Label::Cover,
                3 => Label::ShortObstacle,
                _ => Label::Ground,
            });
        }
        let mut found = Vec::new();
        HoleScan::default().scan(&points, &labels, [], &PARAMS, &mut found);
        prop_assert_eq!(found, reference_holes(&points, &labels, &PARAMS));
    }
}
