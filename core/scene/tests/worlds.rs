//! Guarantees of worlds to their users, and that the bundled ones can be driven.

#![expect(clippy::unwrap_used, reason = "helpers of tests")]

use std::collections::VecDeque;

use proptest::prelude::*;
use rcs_geom::{DVec2, PinholeCamera, Pose};
use rcs_scene::{
    CameraRays, Course, Footprint, Look, Surface, TRUTH_CELL_M, ThingKind, ViewRows, World, render_rows,
};

const PLAIN: &str = "name = \"p\"\nbounds_m = [[0, 0], [40, 30]]\norigin = { zone = 18, easting_m = 308000, northing_m = 4333000 }\n";

fn world(more: &str) -> World {
    World::from_toml(&format!("{PLAIN}{more}")).unwrap()
}

#[track_caller]
fn refused(more: &str, line: usize, key: &str, words: &str) {
    let error = World::from_toml(&format!("{PLAIN}{more}")).unwrap_err();
    assert_eq!((error.line, error.key.as_str()), (line, key), "{error}");
    assert!(error.message.contains(words), "{error}");
}

#[test]
fn bad_worlds_are_refused_with_line_and_key() {
    refused("color = 3", 4, "color", "unknown");
    refused(
        "[[thing]]\nkind = \"tree\"\nat = [10, 10]\nradius_m = -1\n",
        7,
        "thing.radius_m",
        "got -1, expected a number from",
    );
    refused("[[thing]]\nkind = \"tree\"\nat = [nan, 10]\n", 6, "thing.at", "NaN");
    refused("[[thing]]\nkind = \"tree\"\nat = [50, 10]\n", 6, "thing.at", "within the bounds");
    refused("[[thing]]\nkind = \"tre\"\nat = [5, 10]\n", 5, "thing.kind", "expected one of tree, bush");
    refused(
        "[[thing]]\nkind = \"post\"\nat = [5, 10]\ncrown_radius_m = 2\n",
        7,
        "thing.crown_radius_m",
        "unknown",
    );
    refused("[[line]]\nkind = \"fence\"\npath = [[1, 1], [41, 1]]\n", 6, "line.path", "within the bounds");
    refused("[[scatter]]\nkind = \"bush\"\ncircle = [9, 9, 3]\n", 4, "scatter.count", "missing");
    refused(
        "[[scatter]]\nkind = \"bush\"\ncount = 2\ncircle = [9, 9, 3]\nheight_m = [2, 1]\n",
        8,
        "scatter.height_m",
        "smaller number first",
    );
    refused("[[paint]]\nsurface = \"mud\"\n", 4, "paint.polygon", "exactly one");
    refused("[[ditch]]\npath = [[1, 1]]\nwidth_m = 1\ndepth_m = 1\n", 5, "ditch.path", "at least 2");
    refused("[surface.mud]\ntraction = \"low\"\n", 5, "surface.mud.traction", "got a string");
    refused("[[hill]]\ncentre = [1, 1]\nradius_m = inf\nheight_m = 1\n", 6, "hill.radius_m", "inf");
    refused("seed = 1.5", 4, "seed", "whole number");
    refused("seed = ", 4, "", "");
    let no_bounds = World::from_toml("name = \"x\"\n").unwrap_err();
    assert_eq!(no_bounds.key, "bounds_m");
    for corners in ["3", "[[0, 0]]", "[[0, 0], [40, 30], [0, 30]]"] {
        let error = World::from_toml(&PLAIN.replace("[[0, 0], [40, 30]]", corners)).unwrap_err();
        assert_eq!(error.message, "expected the two corners [[x, y], [x, y]] in metres", "{corners}");
    }
    for (place, latitude) in [("northing_m = 9400000", "84."), ("north = false, northing_m = 0", "-8")] {
        let error = World::from_toml(&PLAIN.replace("northing_m = 4333000", place)).unwrap_err();
        assert_eq!((error.line, error.key.as_str()), (3, "origin.northing_m"));
        let message = error.message;
        assert!(message.starts_with(&format!("latitude {latitude}")), "{message}");
        assert!(message.ends_with("is outside of UTM, expected -80 to 84"), "{message}");
    }
    let huge = World::from_toml(&PLAIN.replace("40, 30", "4000, 30")).unwrap_err();
    assert_eq!((huge.line, huge.key.as_str()), (2, "bounds_m"));
}

const ROUGH: &str = "undulation = [{ wavelength_m = 8, amplitude_m = 0.5 }, { wavelength_m = 1, amplitude_m = 0.02 }]\nhill = [{ centre = [20, 15], radius_m = 8, height_m = 2 }]\nditch = [{ path = [[5, 5], [5, 20]], width_m = 0.4, depth_m = 0.5 }]\n";

proptest! {
    #![proptest_config(ProptestConfig::with_cases(20))]
    #[test]
    fn ground_is_continuous_and_its_normal_is_its_slope(x in 0.0..40.0_f64, y in 0.0..30.0_f64, dx in -1.0..1.0_f64, dy in -1.0..1.0_f64) {
        let world = world(ROUGH);
        let (at, step) = (DVec2::new(x, y), DVec2::new(dx, dy) * 1e-4);
        // No face is steeper than the bank of a ditch, 0.5 m over 0.1 m, along each axis.
        prop_assert!((world.height_m(at + step) - world.height_m(at)).abs() < 8.0 * step.length() + 1e-12);
        // Within one cell of the lattice the slope is constant and equals that of the heights.
        let cell = (at / 0.1).floor();
        let inside = (cell + (at / 0.1 - cell).clamp(DVec2::splat(0.01), DVec2::splat(0.99))) * 0.1;
        let slope = |way: DVec2| (world.height_m(inside + way * 1e-5) - world.height_m(inside - way * 1e-5)) / 2e-5;
        let normal = world.ground(inside).normal;
        prop_assert!((-normal.x / normal.z - slope(DVec2::X)).abs() < 1e-4);
        prop_assert!((-normal.y / normal.z - slope(DVec2::Y)).abs() < 1e-4);
    }
}

#[test]
fn places_that_are_no_numbers_are_answered_and_not_a_panic() {
    let world = world("");
    assert!(world.ground(DVec2::NAN).height_m.is_finite());
    assert!(world.blocked(DVec2::NAN, 0.1));
    assert_eq!(world.cast(DVec2::NAN.extend(1.0), DVec2::X.extend(0.0), 9.0), None);
    let body = Footprint { centre: DVec2::NAN, yaw_rad: 0.0, half_length_m: 1.0, half_width_m: 1.0 };
    assert!(world.touching(&body, 0.0..=1.0).is_empty());
}

#[test]
fn a_body_touches_the_solid_part_of_things_and_is_told_the_way_out() {
    let world = world(
        "[[thing]]\nkind = \"post\"\nat = [10, 10]\nradius_m = 0.1\nheight_m = 1\n[[thing]]\nkind = \"hay_bale\"\nat = [20, 10]\nyaw_deg = 90\nlength_m = 2\nwidth_m = 1\n[[thing]]\nkind = \"tree\"\nat = [30, 10]\nradius_m = 0.2\ncrown_radius_m = 3\n",
    );
    let body = |x: f64, y: f64| Footprint {
        centre: DVec2::new(x, y),
        yaw_rad: 0.0,
        half_length_m: 0.5,
        half_width_m: 0.35,
    };
    let touch = |x: f64, y: f64| world.touching(&body(x, y), 0.1..=0.5);

    let [post] = touch(9.45, 10.1)[..] else { panic!("expected one touch") };
    assert_eq!(post.thing, 0);
    assert!((post.depth_m - 0.05).abs() < 1e-9 && post.normal.abs_diff_eq(-DVec2::X, 1e-9), "{post:?}");
    assert!(post.point.abs_diff_eq(DVec2::new(9.95, 10.0).extend(0.3), 1e-9));
    assert!(touch(9.39, 10.0).is_empty());

    // The bale is rotated: it reaches half a metre to either side along x.
    let [bale] = touch(20.9, 10.3)[..] else { panic!("expected one touch") };
    assert!((bale.depth_m - 0.1).abs() < 1e-9 && bale.normal.abs_diff_eq(DVec2::X, 1e-9), "{bale:?}");
    assert!(touch(21.01, 10.0).is_empty());

    // Under the crown, beside the trunk, above the post.
    assert!(touch(31.0, 10.0).is_empty());
    assert_eq!(touch(30.6, 10.0).len(), 1);
    assert!(world.touching(&body(10.0, 10.0), 1.1..=1.5).is_empty());
    for (x, y) in [(10.1, 10.02), (20.2, 9.2), (19.3, 10.9), (29.9, 10.1)] {
        let touched = touch(x, y);
        assert_eq!(touched.len(), 1);
        let out = DVec2::new(x, y) + touched[0].normal * (touched[0].depth_m + 1e-6);
        assert!(touch(out.x, out.y).is_empty(), "{touched:?}");
    }
}

/// The text of a bundled file.
fn asset(folder: &str, name: &str) -> String {
    let path = format!("{}/../../assets/{folder}/{name}.toml", env!("CARGO_MANIFEST_DIR"));
    std::fs::read_to_string(path).unwrap()
}

/// Names of the bundled files in a folder.
fn names(folder: &str) -> Vec<String> {
    let path = format!("{}/../../assets/{folder}", env!("CARGO_MANIFEST_DIR"));
    let files = std::fs::read_dir(path).unwrap().map(|file| file.unwrap().path());
    let mut names: Vec<String> =
        files.map(|file| file.file_stem().unwrap().to_str().unwrap().to_owned()).collect();
    names.sort();
    names
}

fn bundled(name: &str) -> World {
    World::from_toml(&asset("worlds", name)).unwrap()
}

/// A bundled course, its world in its look, and its start and goal.
fn bundled_course(name: &str) -> (Course, World, [DVec2; 2]) {
    let course = Course::from_toml(&asset("courses", name)).unwrap();
    let look = course.look.as_ref().map(|look| Look::from_toml(&asset("looks", look)).unwrap());
    let world = World::with_look(&asset("worlds", &course.world), look.as_ref()).unwrap();
    let ends = [course.start, course.goal].map(|end| end.in_world(&world.origin()).unwrap());
    (course, world, ends)
}

/// Least length of a path with a clearance, over neighbouring cells, m.
fn way_m(world: &World, clearance_m: f64, start: DVec2, goal: DVec2) -> Option<f64> {
    let [columns, rows] = world.truth_size();
    let low = world.bounds_m()[0];
    let cell = |at: DVec2| ((at - low) / TRUTH_CELL_M).as_uvec2().to_array().map(|v| v as usize);
    let place =
        |[column, row]: [usize; 2]| low + (DVec2::new(column as f64, row as f64) + 0.5) * TRUTH_CELL_M;
    let mut steps = vec![u32::MAX; columns * rows];
    let (first, last) = (cell(start), cell(goal));
    let mut queue = VecDeque::from([first]);
    steps[first[1] * columns + first[0]] = 0;
    while let Some([column, row]) = queue.pop_front() {
        if [column, row] == last {
            return Some(f64::from(steps[row * columns + column]) * TRUTH_CELL_M);
        }
        for [c, r] in [
            [column + 1, row],
            [column.wrapping_sub(1), row],
            [column, row + 1],
            [column, row.wrapping_sub(1)],
        ] {
            if c < columns
                && r < rows
                && steps[r * columns + c] == u32::MAX
                && !world.blocked(place([c, r]), clearance_m)
            {
                steps[r * columns + c] = steps[row * columns + column] + 1;
                queue.push_back([c, r]);
            }
        }
    }
    None
}

#[test]
fn each_course_can_be_driven_in_four_minutes() {
    for name in names("courses") {
        let (course, world, [start, goal]) = bundled_course(&name);
        assert_eq!((course.name.as_str(), world.name()), (name.as_str(), course.world.as_str()));
        let place = world.origin().to_geodetic();
        assert!(
            (place.latitude_deg - 39.13).abs() < 0.02 && (place.longitude_deg + 77.22).abs() < 0.02,
            "{place:?}"
        );
        assert!(!world.blocked(start, 1.0) && !world.blocked(goal, 1.0), "{name}");
        // A path of steps along the axes is up to 41 % longer than the straight one.
        let way = way_m(&world, 0.6, start, goal);
        assert!(way.is_some_and(|way| way < 240.0), "{name}: {way:?}");
    }
}

#[test]
fn each_world_has_a_second_look_with_other_colours_light_and_start_and_the_same_truth() {
    for name in names("worlds") {
        let (first, plain, [start, _]) = bundled_course(&name);
        let (second, dressed, [other_start, _]) = bundled_course(&format!("{name}_2"));
        assert_eq!((&first.world, first.look.is_none()), (&second.world, true));
        assert!(second.look.is_some() && start.distance(other_start) > 2.0, "{name}");
        let camera = PinholeCamera::from_horizontal_fov([96, 72], 1.2).unwrap();
        let body = Pose::from_rpy(start.extend(plain.height_m(start) + 0.9), 0.0, 0.2, 0.0);
        let [before, after] = [&plain, &dressed].map(|world| view(world, &camera, &body));
        assert_eq!((before.1, before.2), (after.1, after.2), "{name}: depths and classes");
        // Mean colours of the ground, the lower half of the image.
        let mean = |rgb: &[u8], channel: usize| {
            let values = rgb[rgb.len() / 2..].chunks_exact(3).map(|rgb| f64::from(rgb[channel]));
            values.sum::<f64>() / (rgb.len() / 6) as f64
        };
        let change: f64 =
            (0..3).map(|channel| (mean(&before.0, channel) - mean(&after.0, channel)).abs()).sum();
        assert!(change > 25.0, "{name}: the colours change by {change:.0}");
        let truth = |world: &World| -> Vec<_> {
            let [columns, rows] = world.truth_size();
            (0..rows)
                .step_by(7)
                .flat_map(|row| (0..columns).map(move |c| (c, row)))
                .map(|(c, row)| world.truth_cell(c, row))
                .collect()
        };
        assert_eq!(truth(&plain), truth(&dressed), "{name}");
    }
}

/// Colours, bits of the depths, and classes of a view.
fn view(world: &World, camera: &PinholeCamera, global_from_body: &Pose) -> (Vec<u8>, Vec<u32>, Vec<u8>) {
    let pixels = (camera.width * camera.height) as usize;
    let (mut rgb, mut depth_m) = (vec![0; 3 * pixels], vec![0.0; pixels]);
    let (mut class, mut label) = (vec![0; pixels], vec![0; pixels]);
    let mut out = ViewRows { rgb: &mut rgb, depth_m: &mut depth_m, class: &mut class, label: &mut label };
    let pose = *global_from_body * Pose::body_from_optical();
    render_rows(world, &CameraRays::new(camera), &pose, 1.0, 0..camera.height as usize, &mut out);
    (rgb, depth_m.into_iter().map(f32::to_bits).collect(), class)
}

#[test]
fn worlds_that_reward_learning_ask_what_they_should() {
    let (start, goal) = (DVec2::new(10.0, 45.0), DVec2::new(110.0, 45.0));
    // Beside the path of the soft ground there is mud, then growth; on the path there is neither.
    let soft = bundled("soft_ground");
    let straight: Vec<Surface> =
        (10..110).map(|x| soft.ground(DVec2::new(f64::from(x), 45.0)).surface).collect();
    let metres = |surface: Surface| straight.iter().filter(|&&at| at == surface).count();
    assert!(metres(Surface::Mud) > 15 && metres(Surface::TallWeeds) > 15, "{straight:?}");
    assert!(metres(Surface::Thicket) > 5);
    // Around the field of thickets the way is longer by half; through the grass it is not.
    let field = bundled("thickets");
    let through = way_m(&field, 0.6, start, goal).unwrap();
    assert!(through < 145.0, "{through}");
    let grass = field.ground(DVec2::new(53.0, 45.0));
    assert!(grass.surface == Surface::TallGrass && grass.passable);
    let thicket = field.ground(DVec2::new(43.0, 45.0));
    assert!(thicket.surface == Surface::Thicket && !thicket.passable);
    // No way leads out of the ends of the wrong branches, except back.
    let forks = bundled("wrong_branches");
    for (end, beyond) in
        [([45.0, 62.0], [58.0, 62.0]), ([44.0, 45.0], [58.0, 45.0]), ([82.0, 45.0], [93.0, 45.0])]
    {
        let (end, beyond) = (DVec2::from_array(end), DVec2::from_array(beyond));
        let way = way_m(&forks, 0.5, end, beyond).unwrap();
        assert!(way > 3.0 * end.distance(beyond), "{end}: {way}");
    }
}

#[test]
fn our_worlds_are_hard_where_they_should_be() {
    let (start, goal) = (DVec2::new(10.0, 45.0), DVec2::new(110.0, 45.0));
    // Only the corridor leads through, and it is narrow.
    // The clearance is measured between cells from the middle of the path: 0.1 m more than half of the width.
    let corridor = bundled("corridor");
    assert!(way_m(&corridor, 0.8, start, goal).is_some());
    assert_eq!(way_m(&corridor, 1.0, start, goal), None);
    // The trap: from its end a vehicle has to go back.
    let trap = bundled("dead_end");
    let back = way_m(&trap, 0.5, DVec2::new(56.0, 45.0), DVec2::new(61.0, 45.0)).unwrap();
    assert!(back > 40.0, "{back}");
    // A tractor gets through the transition, into weeds that give way.
    let transition = bundled("transition");
    assert!(way_m(&transition, 2.0, start, goal).is_some());
    let weeds = transition.ground(DVec2::new(60.0, 46.0));
    assert!(weeds.surface == Surface::TallWeeds && weeds.passable && weeds.vegetation_height_m > 1.0);
    assert!(transition.things().iter().any(|thing| thing.kind == ThingKind::Person));
    // A ditch that can only be passed around its ends.
    let meadow = bundled("meadow");
    assert!(meadow.height_m(DVec2::new(42.0, 63.0)) < meadow.height_m(DVec2::new(42.0, 63.6)) - 0.25);
    assert!(way_m(&meadow, 0.3, DVec2::new(44.0, 61.0), DVec2::new(44.0, 64.5)).unwrap() > 10.0);
    // The mud on the face of the hill has too little traction for its slope.
    let hill = bundled("hill");
    let face = (44..56).map(|x| hill.ground(DVec2::new(f64::from(x), 47.0)));
    let slips = face.filter(|ground| -ground.normal.x / ground.normal.z > ground.traction).count();
    assert!(slips >= 3, "{slips}");
}
