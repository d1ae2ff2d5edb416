//! Tests of tracks in the plane of the map.

use super::*;

fn point(ns: u64, [x, y]: [f64; 2]) -> TrackPoint {
    TrackPoint { stamp: Stamp(ns), position_m: [x, y, 0.0], yaw_rad: f64::NAN }
}

fn curve(count: usize, rotation_rad: f64, translation: [f64; 2]) -> Series<TrackPoint> {
    let (sin, cos) = rotation_rad.sin_cos();
    let at = |i: usize| {
        let t = i as f64 * 0.1;
        let (x, y) = (t, 5.0 * (t / 7.0).sin());
        [cos * x - sin * y + translation[0], sin * x + cos * y + translation[1]]
    };
    (0..count).map(|i| point(i as u64 * 100_000_000, at(i))).collect()
}

#[test]
fn an_alignment_undoes_a_turn_and_a_shift() {
    let reference = curve(1000, 0.0, [0.0; 2]);
    let moved = curve(1000, 1.1, [30.0, -4.0]);
    let mut aligned = Aligned::default();
    aligned.update(&moved, &reference);
    let alignment = aligned.alignment.unwrap();
    assert!((alignment.yaw_rad + 1.1).abs() < 1e-9 && alignment.rms_m < 1e-9);
    let plane = Plane::new(alignment.pose());
    for i in 0..1000 {
        let back = plane.point(moved.get(i).unwrap().position_m);
        let there = reference.get(i).unwrap().position_m;
        assert!((back[0] - there[0]).hypot(back[1] - there[1]) < 1e-6, "{i}");
    }
    assert!(aligned.is_final, "40 m of it were driven");
}

#[test]
fn a_track_that_jumps_is_aligned_with_nothing() {
    let driven = curve(200, 0.4, [3.0, 2.0]);
    // A receiver that says 0° north, 0° east before its first fix.
    let steady = curve(200, 0.0, [0.0; 2]);
    let jump = |i: usize| {
        let TrackPoint { stamp, position_m: [x, y, _], .. } = steady.get(i).unwrap();
        point(stamp.0, [if i < 20 { x } else { x + 5.0e6 }, y])
    };
    let jumps: Series<TrackPoint> = (0..200).map(jump).collect();
    for (track, reference) in [(&driven, &jumps), (&jumps, &driven)] {
        let mut aligned = Aligned::default();
        aligned.update(track, reference);
        let alignment = aligned.alignment.unwrap();
        assert!(!alignment.is_plausible(), "{alignment:?}");
    }
    let mut aligned = Aligned::default();
    aligned.update(&driven, &steady);
    assert!(aligned.alignment.unwrap().is_plausible());
}

#[test]
fn an_alignment_of_a_growing_track_is_that_of_the_whole_one() {
    let at = |i: usize, turn: f64| {
        // At rest for a while, as most drives begin.
        let t = (i as f64 - 2000.0).max(0.0) * 0.02;
        let (x, y) = (t, (t / 3.0).sin());
        point(i as u64 * 20_000_000, [turn.cos() * x - turn.sin() * y, turn.sin() * x + turn.cos() * y])
    };
    let series = |count: usize, turn: f64| (0..count).map(|i| at(i, turn)).collect::<Series<_>>();
    let (own, other) = (rcs_runtime::source::SeriesWriter::default(), series(9000, 0.0));
    let mut grown = Aligned::default();
    for i in 0..9000 {
        own.push(at(i, 0.3));
        grown.update(&own.read(), &other);
    }
    let mut whole = Aligned::default();
    whole.update(&series(9000, 0.3), &other);
    let (grown, whole) = (grown.alignment.unwrap(), whole.alignment.unwrap());
    assert!((grown.yaw_rad - whole.yaw_rad).abs() < 1e-3, "{grown:?} {whole:?}");
}

#[test]
fn tracks_that_share_no_time_or_stand_still_are_not_aligned() {
    let reference = curve(1000, 0.0, [0.0; 2]);
    let all = |f: &dyn Fn(TrackPoint) -> TrackPoint| {
        let mut points = Vec::new();
        reference.each(0..1000, |point| points.push(f(*point)));
        points.into_iter().collect::<Series<_>>()
    };
    let later = all(&|point| TrackPoint { stamp: point.stamp.after_ns(1_000_000_000_000), ..point });
    assert_eq!(align(&later, &reference).0, None);
    let standing = all(&|point| TrackPoint { position_m: [1.0, 1.0, 0.0], ..point });
    assert_eq!(align(&reference, &standing).0, None);
    assert_eq!(align(&Series::default(), &reference).0, None);
}

#[test]
fn between_two_points_a_track_is_on_the_line_and_looks_where_it_goes() {
    let track: Series<_> = (0..3).map(|i| point(i * 10, [0.0, 2.0 * i as f64])).collect();
    assert_eq!(at(&track, Stamp(5)), Some([0.0, 1.0]));
    assert_eq!(at(&track, Stamp(99)), Some([0.0, 4.0]));
    assert_eq!(at(&Series::default(), Stamp(5)), None);
    for index in 0..3 {
        assert!((course(&track, index) - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
    }
    assert!(course(&track, 3).is_nan());
}

const VIEWPORT: Viewport = Viewport { center: [0.0, 0.0], scale: 10.0, y_up: true, turned_rad: 0.0 };

fn canvas() -> Rect {
    Rect::from_min_size(egui::Pos2::ZERO, egui::Vec2::new(400.0, 300.0))
}

/// A drive around a block, with a random walk on top.
fn rounds(count: usize) -> Series<TrackPoint> {
    let mut noise = 0.0;
    (0..count)
        .map(|i| {
            noise += f64::from((i as u32).wrapping_mul(2_654_435_761) >> 16) / 65_536.0 * 0.01 - 0.005;
            let angle = i as f64 * 2e-3;
            point(i as u64 * 20_000_000, [12.0 * angle.cos() + noise, 9.0 * angle.sin() - noise])
        })
        .collect()
}

#[test]
fn the_line_of_a_long_track_has_no_more_points_than_that_of_a_short_one() {
    let plane = Plane::new(Pose::from_xy_yaw(1.0, 2.0, 0.4));
    for count in [1000, 20_000, 360_000] {
        let track = rounds(count);
        let points = line(&track, 0..count, &plane, VIEWPORT, canvas());
        assert!(points.len() <= 2 * MOST_PARTS, "{} of {count}", points.len());
        let last = plane.point(track.last().unwrap().position_m);
        assert_eq!(points.last(), Some(&last));
    }
}

#[test]
fn the_line_of_a_track_is_where_its_points_are() {
    let plane = Plane::new(Pose::from_xy_yaw(1.0, 2.0, 0.4));
    let track = rounds(6000);
    let points = line(&track, 0..6000, &plane, VIEWPORT, canvas());
    track.each(0..6000, |point| {
        let p = plane.point(point.position_m);
        let at = VIEWPORT.to_screen(canvas(), p);
        if canvas().contains(at) {
            // The reference: the distance to every piece of the line.
            let distance =
                points.windows(2).map(|ends| to_piece(p, ends[0], ends[1])).fold(f64::MAX, f64::min);
            assert!(distance * VIEWPORT.scale <= 2.0, "{distance} m");
        }
    });
}

fn to_piece(p: [f64; 2], a: [f64; 2], b: [f64; 2]) -> f64 {
    let [p, a, b] = [p, a, b].map(DVec2::from_array);
    let along = if a == b { 0.0 } else { ((p - a).dot(b - a) / (b - a).length_squared()).clamp(0.0, 1.0) };
    (p - a - (b - a) * along).length()
}

#[test]
fn implausible_positions_are_counted_as_the_track_grows_and_do_not_widen_it() {
    let writer = rcs_runtime::source::SeriesWriter::default();
    let mut judged = Judged::default();
    let plane = Plane::new(Pose::IDENTITY);
    for i in 0..5000_u64 {
        let x = if i % 100 == 99 { [1e30, f64::INFINITY][i as usize / 100 % 2] } else { i as f64 * 0.01 };
        writer.push(point(i, [x, 1.0]));
        if i % 37 == 0 || i == 4999 {
            judged.update(&writer.read());
            assert_eq!(judged.far as u64, (i + 1) / 100);
        }
    }
    let (min, max) = judged.extent(&plane).unwrap();
    assert!(min[0] >= 0.0 && max[0] <= 50.0 && min[1] == 1.0, "{min:?} {max:?}");
}

#[test]
fn outliers_of_a_track_that_is_aligned_widen_the_extent_by_its_size_at_most() {
    let driven = ([0.0, 0.0], [40.0, 10.0]);
    let noisy = ([-2.0, -1.0], [41.0, 12.0]);
    assert_eq!(widened(driven, &[noisy], 2.0), ([-2.0, -1.0], [41.0, 12.0]));
    let outlier = ([-2.0, -900.0], [41.0, 12.0]);
    assert_eq!(widened(driven, &[outlier], 2.0), ([-2.0, -40.0], [41.0, 12.0]));
    let stands = ([0.0; 2], [0.0; 2]);
    assert_eq!(widened(stands, &[outlier], 10.0), ([-2.0, -10.0], [10.0, 10.0]));
}
