//! `docs/reference/worlds.md`: every key of course, world, look and vehicle files. Values, ranges and what is required
//! come from the readers, which are asked; names, defaults and meanings are compared with them.

use super::asked::names;
use super::declarations::{Item, snake, variants};
use super::vehicle_keys::{VEHICLE, VEHICLE_SECTIONS};
use super::world_keys::{COURSE, COURSE_SECTIONS, LOOK, LOOK_SECTIONS, SIZES, WORLD, WORLD_SECTIONS};
use super::{check_reference, code, read, table};
use rcs_geom::DVec2;
use rcs_scene::{Surface, ThingKind, World};
use std::collections::BTreeSet;

const CLASSES: &str = "core/scene/src/class.rs";

/// A table of the surfaces with their properties in a world that states none, from a world that has all of them.
fn surfaces() -> String {
    let x_m = |surface: Surface| 5.0 * f64::from(surface as u8);
    let paint = |surface: Surface| {
        format!("[[paint]]\nsurface = \"{}\"\ncircle = [{:?}, 10, 2]\n", surface.name(), x_m(surface))
    };
    let head = "name = \"surfaces\"\nbounds_m = [[0, 0], [60, 20]]\n\
                origin = { zone = 18, easting_m = 308000, northing_m = 4333000 }\n";
    let text = head.to_owned() + &Surface::ALL.map(paint).concat();
    let world = World::from_toml(&text).unwrap_or_else(|error| panic!("{error}"));
    let row = |(surface, item): (Surface, Item)| {
        assert_eq!(item.name, surface.name(), "surfaces are declared in the order of their codes");
        let ground = world.ground(DVec2::new(x_m(surface), 10.0));
        assert_eq!(ground.surface, surface, "it was painted");
        let numbers = [
            ground.traction,
            ground.rolling_resistance,
            ground.slip_at_limit,
            ground.vegetation_height_m,
            ground.vegetation_drag,
        ];
        let mut row = vec![code(surface.name()), item.help];
        row.extend(numbers.map(|number| number.to_string()));
        row.push(ground.passable.to_string());
        row
    };
    let rows: Vec<_> = Surface::ALL.into_iter().zip(variants(CLASSES, "Surface")).map(row).collect();
    let properties = ["traction", "rolling_resistance", "slip_at_limit", "height_m", "drag", "passable"];
    let properties = properties.map(code);
    let headings = ["surface", "what"].into_iter().chain(properties.iter().map(String::as_str));
    table(&headings.collect::<Vec<_>>(), &rows)
}

/// The sizes that a kind of thing may have, with their defaults, as the source of the reader lists them.
fn sizes(kind: ThingKind) -> Vec<(String, f64)> {
    let source = read("core/scene/src/thing.rs");
    let of_kind = |line: &str| {
        let (variant, rest) = line.trim().strip_prefix("ThingKind::")?.split_once(" => ([")?;
        (snake(variant) == kind.name()).then(|| rest.to_owned())
    };
    let line = source.lines().find_map(of_kind);
    let line = line.unwrap_or_else(|| panic!("{} has sizes", kind.name()));
    let (numbers, keys) = line.split_once("], &[").expect("numbers, then keys");
    let numbers: Vec<f64> =
        numbers.split(", ").map(|number| number.parse().expect("it is a number")).collect();
    assert_eq!(numbers.len(), SIZES.len(), "{line}");
    let keys: Vec<&str> = keys.split(", ").map(|key| key.trim_matches(['"', ']', ')', ','])).collect();
    SIZES
        .into_iter()
        .zip(numbers)
        .filter(|(key, _)| keys.contains(key))
        .map(|(key, number)| (key.to_owned(), number))
        .collect()
}

/// A table of the kinds of things with their sizes. Fails where the reader knows other sizes of a kind.
fn things() -> String {
    let row = |(kind, item): (ThingKind, Item)| {
        assert_eq!(item.name, kind.name(), "kinds are declared in the order of the list");
        let at = if matches!(kind, ThingKind::Fence | ThingKind::Hedge) { "line" } else { "thing" };
        let mut known = WORLD.known(at, |table| {
            table.insert("kind".to_owned(), kind.name().into());
        });
        known.retain(|key| SIZES.contains(&key.as_str()));
        let sizes = sizes(kind);
        let stated: BTreeSet<String> = sizes.iter().map(|(key, _)| key.clone()).collect();
        assert_eq!(stated, known, "sizes of {}", kind.name());
        let sizes: Vec<_> = sizes.iter().map(|(key, size)| format!("{} {size}", code(key))).collect();
        vec![code(kind.name()), item.help, sizes.join(", ")]
    };
    let rows: Vec<_> = ThingKind::ALL.into_iter().zip(variants(CLASSES, "ThingKind")).map(row).collect();
    table(&["kind", "what", "sizes and their defaults, m"], &rows)
}

/// The number in the source that takes the place of a key of a world, where there is one.
fn default_in_source<'t>(source: &'t str, key: &str) -> Option<&'t str> {
    let (_, rest) = source.split_once(&format!("number_or(\"{key}\", "))?;
    let end = rest.find(|c: char| !(c.is_ascii_digit() || ['-', '.'].contains(&c))).unwrap_or(rest.len());
    Some(&rest[..end])
}

#[test]
fn the_reference_of_worlds_is_made_from_what_reads_them() {
    let coats = LOOK.known("coat", |_| {});
    let text = [
        "# Courses, worlds, looks and vehicles\n\n\
         TOML; every key, with values and ranges from the readers of the files. An unknown key is an error. Units are at \
         the end of the names: m, s, ms, 1/s (`hz`), m/s (`mps`), kg, N, A, pixels (`px`), degrees (`deg`). A key whose \
         default is empty can be left out, too. Coordinates in a world are -10000 to 10000 m from its origin, east and \
         north. \
         [Courses, looks and imperfect cameras](../courses.md) says what the bundled files are for.\n\n\
         ## Courses\n\n\
         `ocu --course NAME` opens a bundled course, or the file of that path; `assets/courses` has examples. Of a \
         goal file, the planning reads `goal`, `area` and `keep_out` alone.\n\n",
        &COURSE.sections(&COURSE_SECTIONS),
        "## Worlds\n\nA course names its world; `assets/worlds` has examples. Angles are degrees counter-clockwise from \
         east, and z is up. A region is one of `polygon`, `path` with `width_m`, and `circle`.\n\n",
        &WORLD.sections(&WORLD_SECTIONS),
        "### Surfaces\n\nDefaults of the properties that influence driving; the limit of slip of the vehicle counts where \
         it is larger.\n\n",
        &surfaces(),
        "### Things\n\nEach size is a ",
        &WORLD.value("thing", "radius_m"),
        ", or a list of least and greatest size, from which each thing draws its own. In a `[[scatter]]` along a `path`, \
         `width_m` is the width of the strip.\n\n",
        &things(),
        "## Looks\n\nOther colours and light for a world, named by a course; `assets/looks` has examples. What is left out \
         stays as in the world. A look changes nothing that a vehicle touches and no ground truth. Coats are ",
        &names(coats.iter().map(String::as_str)),
        ".\n\n",
        &LOOK.sections(&LOOK_SECTIONS),
        "## Vehicles\n\nA course names its vehicle; `assets/vehicles` has examples. The origin of the vehicle frame is on \
         the ground midway between the driven wheels; x is forward, y left, z up. The frame of a sensor has its `name`; \
         that of a camera is `NAME_camera`, and those of a pair are `NAME_left_camera` and `NAME_right_camera`. No two \
         frames of a vehicle may be the same, and `vehicle`, `imu` and `gps` are taken.\n\n",
        &VEHICLE.sections(&VEHICLE_SECTIONS),
    ]
    .concat();
    check_reference("worlds", &format!("{}\n", text.trim_end()));
}

#[test]
fn surfaces_have_the_same_names_in_worlds_and_looks_and_on_the_page() {
    let surfaces = BTreeSet::from(Surface::ALL.map(|surface| surface.name().to_owned()));
    assert_eq!(WORLD.known("surface", |_| {}), surfaces);
    assert_eq!(LOOK.known("surface", |_| {}), surfaces);
}

#[test]
fn a_world_with_another_seed_or_base_reads_differently() {
    let read = |line: &str| (WORLD.read)(&format!("{line}\n{}", WORLD.sample)).unwrap();
    for (key, default, other) in [("seed", "0", "1"), ("base", "\"short_grass\"", "\"mulch\"")] {
        let [default, other] = [default, other].map(|value| read(&format!("{key} = {value}")));
        assert!(default == read("") && other != default, "{key}");
    }
}

#[test]
fn numbers_of_a_world_have_the_defaults_of_its_reader() {
    let source = read("core/scene/src/spec.rs");
    let keys = WORLD_SECTIONS.iter().flat_map(|section| section.keys.iter().copied().flatten());
    let mut compared = 0;
    for (key, default, _) in keys {
        let Some(found) = default_in_source(&source, key).filter(|found| !found.is_empty()) else { continue };
        assert_eq!(default.parse::<f64>().ok(), found.parse::<f64>().ok(), "{key}");
        compared += 1;
    }
    assert!(compared >= 8, "found {compared} defaults");
    assert_eq!(default_in_source("t.number_or(\"a_m\", 0.1_f64.min(b), 0.0..=1.0)", "a_m"), Some("0.1"));
}
