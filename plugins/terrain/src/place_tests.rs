//! Windows on the flat plane.

use super::*;
use crate::classify::Match;
use crate::classify_tests::{classes_of, learned};
use crate::scene::{Scene, camera, vehicle_from_camera};
use proptest::prelude::*;

fn view(camera: &PinholeCamera, local_from_vehicle: Pose) -> View<'_> {
    View { camera, vehicle_from_camera: vehicle_from_camera(), local_from_vehicle, wheels_below_m: 0.0 }
}

fn windows<'a>(grid: &'a WindowGrid, classes: &'a [Class], stereo_end: Option<&'a [usize]>) -> Windows<'a> {
    Windows { grid, classes, stereo_end }
}

/// A window like a model of this cost.
fn like(cost: u8) -> Match {
    Match { cost, model: cost / 2 + 1 }
}

fn cost_at(placed: &Placed, p_local: DVec3) -> Option<u8> {
    let cell = (p_local / CELL_SIZE_M).floor();
    let (x, y) = (cell.x as i64 - placed.south_west.x, cell.y as i64 - placed.south_west.y);
    let side = 0..SIDE as i64;
    (side.contains(&x) && side.contains(&y)).then(|| placed.costs[y as usize * SIDE + x as usize])
}

#[test]
fn ground_lands_on_the_plane_and_a_wall_stands_where_the_ground_ends() {
    let size = [640, 480];
    let camera = camera(size);
    for pose in [Pose::IDENTITY, Pose::from_rpy(DVec3::new(31.7, -12.3, 4.0), 0.05, -0.08, 2.0)] {
        let scene = Scene::new(size, pose, 5.0, 20.0, 7);
        let (grid, classes) = classes_of(&scene, &learned(), 16);
        let placed = place(&view(&camera, pose), &windows(&grid, &classes, None), 20.0);
        let (mut walls, mut grounds) = (0, 0);
        for y in -10..=10 {
            let y = f64::from(y) * 0.1;
            for x in 2..90 {
                let x = f64::from(x) * 0.2;
                let cost = cost_at(&placed, pose * DVec3::new(x, y, 0.0)).unwrap();
                // Windows of 16 pixels are 0.35 m deep on the ground in front of the wall.
                if x < 1.2 {
                    assert_eq!(cost, UNKNOWN_COST, "below the image: {x}, {y}");
                } else if x > 1.7 && x < 4.2 {
                    assert!(cost < 10, "{cost} at {x}, {y}");
                    grounds += 1;
                } else if x > 5.6 {
                    assert_eq!(cost, UNKNOWN_COST, "behind the wall: {x}, {y}");
                } else if x > 4.2 && cost > 240 {
                    walls += 1;
                }
            }
        }
        assert!(grounds > 100 && walls >= 21, "{grounds} ground, {walls} wall");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(20))]
    #[test]
    fn each_cell_has_the_cost_of_the_window_that_shows_its_middle(yaw in -3.0..3.0_f64, x in -30.0..30.0_f64, roll in -0.1..0.1_f64, seed: u64) {
        let camera = camera([64, 48]);
        let pose = Pose::from_rpy(DVec3::new(x, 3.0, 0.5), roll, 0.05, yaw);
        let grid = WindowGrid::new([64, 48], 6);
        // Ground only: obstacles have a rule of their own.
        let classes: Vec<Class> = (0..grid.columns() * grid.rows())
            .map(|i| match crate::scene::noise(i, 0, seed) % 3 { 0 => Class::Unclassified, 1 => Class::Skipped, _ => Class::Traversable(like((i % 100) as u8)) })
            .collect();
        let view = view(&camera, pose);
        let placed = place(&view, &windows(&grid, &classes, None), 15.0);
        for (at, &cost) in placed.costs.iter().enumerate() {
            let index = placed.south_west.offset((at % SIDE) as i64, (at / SIDE) as i64);
            let middle = DVec2::new(index.x as f64 + 0.5, index.y as f64 + 0.5) * CELL_SIZE_M;
            // The point of the vehicle's plane above that position.
            let up = pose.rotate(DVec3::Z);
            let offset = middle - pose.translation.truncate();
            let p_local = middle.extend(pose.translation.z - up.truncate().dot(offset) / up.z);
            prop_assert!((pose.inverse() * p_local).z.abs() < 1e-9);
            let seen = (pose * vehicle_from_camera()).inverse() * p_local;
            let pixel = camera.project(seen).filter(|&pixel| camera.contains(pixel));
            let expected = match pixel {
                Some(pixel) if p_local.distance(pose.translation) <= 15.0 => {
                    let (u, v) = (pixel.x.round() as usize / 6, pixel.y.round() as usize / 6);
                    match classes[v * grid.columns() + u] { Class::Traversable(like) => like.cost, _ => UNKNOWN_COST }
                }
                _ => UNKNOWN_COST,
            };
            prop_assert_eq!(cost, expected, "cell {:?}", index);
        }
    }
}

#[test]
fn the_region_ends_a_little_above_the_horizon_and_begins_where_stereo_ends() {
    let camera = camera([640, 480]);
    let view = view(&camera, Pose::IDENTITY);
    let grid = WindowGrid::new([640, 480], 16);
    let limit = libm::sin(5.0_f64.to_radians());
    let all = region(&view, &grid, limit, None);
    let column = |wanted: &[bool], column: usize| -> Vec<usize> {
        (0..grid.rows()).filter(|&row| wanted[row * grid.columns() + column]).collect()
    };
    // The camera is pitched 12° down: 5° above the horizon is 17° above the image centre.
    let top = 239.5 - camera.fy * libm::tan(17.0_f64.to_radians());
    let rows = column(&all, 20);
    assert_eq!(rows.last(), Some(&29));
    assert!((rows[0] as f64 * 16.0 - top).abs() <= 16.0, "first row {}, horizon's limit {top}", rows[0]);
    let end: Vec<usize> = (0..grid.columns()).map(|column| 20 + column % 3).collect();
    let beyond = region(&view, &grid, limit, Some(&end));
    for (i, &end) in end.iter().enumerate() {
        assert_eq!(
            column(&beyond, i),
            column(&all, i).into_iter().filter(|&row| row < end).collect::<Vec<_>>()
        );
    }
}

#[test]
fn obstacles_beyond_stereo_stand_at_its_end_unless_ground_comes_between() {
    let camera = camera([640, 480]);
    let view = view(&camera, Pose::IDENTITY);
    let grid = WindowGrid::new([640, 480], 16);
    let mut classes = vec![Class::Skipped; grid.columns() * grid.rows()];
    // In column 20 an obstacle directly above the rows of stereo, in column 25 one above two windows of ground.
    let end = vec![18; grid.columns()];
    for row in 13..18 {
        classes[row * grid.columns() + 20] = Class::NotTraversable(like(240));
        let ground = row >= 16;
        classes[row * grid.columns() + 25] =
            if ground { Class::Traversable(like(5)) } else { Class::NotTraversable(like(230)) };
    }
    let placed = place(&view, &windows(&grid, &classes, Some(&end)), 20.0);
    let foot = |column: usize, row: usize| {
        view.on_plane(DVec2::new(column as f64 * 16.0 + 7.5, row as f64 * 16.0 - 0.5)).unwrap()
    };
    assert_eq!(cost_at(&placed, foot(20, 18)), Some(240));
    assert_eq!(cost_at(&placed, foot(25, 16)), Some(230));
    for (&cost, &model) in placed.costs.iter().zip(&placed.models) {
        assert_eq!(model, if cost == UNKNOWN_COST { 0 } else { like(cost).model });
    }
    // The window is 0.1 m wide there, so it covers two cells at most.
    let cells: usize = placed.costs.iter().map(|&cost| usize::from(cost == 240)).sum();
    assert!(
        (1..=2).contains(&cells),
        "an obstacle of five windows, one above the other, takes {cells} cells"
    );
    assert_eq!(view.on_plane(DVec2::new(320.0, 0.0)), None, "no ground above the horizon");
}

#[test]
fn windows_are_placed_alike_whatever_the_height_of_the_vehicle_frame() {
    let camera = camera([640, 480]);
    let grid = WindowGrid::new([640, 480], 16);
    let mut classes = vec![Class::Traversable(like(5)); grid.columns() * grid.rows()];
    for row in 10..16 {
        classes[row * grid.columns() + 20] = Class::NotTraversable(like(240));
    }
    let windows = windows(&grid, &classes, None);
    let level = view(&camera, Pose::IDENTITY);
    let raised = |origin_m: f64, wheels_below_m: f64| {
        let lift = Pose::from_translation(DVec3::new(0.0, 0.0, origin_m));
        let vehicle_from_camera = lift.inverse() * level.vehicle_from_camera;
        View { vehicle_from_camera, local_from_vehicle: lift, wheels_below_m, ..level.clone() }
    };
    let expected = place(&level, &windows, 15.0);
    let foot = |view: &View<'_>| {
        view.local_from_vehicle * view.on_plane(DVec2::new(20.0 * 16.0 + 7.5, 16.0 * 16.0 - 0.5)).unwrap()
    };
    assert_eq!(cost_at(&expected, foot(&level)), Some(240));
    let view = raised(0.3, 0.3);
    assert!(foot(&view).abs_diff_eq(foot(&level), 1e-9));
    assert_eq!(cost_at(&place(&view, &windows, 15.0), foot(&level)), Some(240));
    let differing = |placed: &Placed| {
        placed.costs.iter().zip(&expected.costs).filter(|(cost, expected)| cost != expected).count()
    };
    // The distance from the origin of the frame, up to which there are cells, is a little longer.
    let few = expected.cells() / 50;
    assert!((differing(&place(&view, &windows, 15.0)) as u64) < few, "{few}");
    assert_eq!(place(&raised(1.5, 0.3), &windows, 15.0).cells(), 0, "the camera is below the plane");
}
