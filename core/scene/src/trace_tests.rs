//! Rays against reference implementations, and images against rays.

use glam::Vec4;
use proptest::prelude::*;
use rcs_geom::{DVec2, DVec3, Distortion, PinholeCamera, Pose};

use crate::class::Class;
use crate::coat::Coat;
use crate::field_ray::FieldRay;
use crate::noise::Dice;
use crate::packet::{LANES, Packet};
use crate::render::{CAMERA_RANGE_M, ViewRows, render_rows};
use crate::shape::{Form, Shape};
use crate::stem::STEM_CLEAR_M;
use crate::terrain::{CELL_M, TILE};
use crate::{CameraRays, Hit, World};

/// A small world with everything that a ray can hit.
const SMALL: &str = r#"
name = "small"
seed = 5
bounds_m = [[100, -20], [130, 6]]
origin = { zone = 18, easting_m = 308000, northing_m = 4333000 }
undulation = [{ wavelength_m = 9, amplitude_m = 0.4 }, { wavelength_m = 2, amplitude_m = 0.03 }]
hill = [{ centre = [118, -8], radius_m = 7, height_m = 2.5 }]
ditch = [{ path = [[108, -15], [108, 0]], width_m = 0.4, depth_m = 0.4 }]
ledge = [{ path = [[112, -4], [118, 0]], height_m = 0.6, fade_m = 4 }]
paint = [
  { surface = "tall_grass", circle = [106, -6, 3] },
  { surface = "tall_weeds", polygon = [[120, -14], [127, -14], [127, -4], [121, -5]] },
  { surface = "mud", path = [[110, -14], [118, -12]], width_m = 2 },
]
thing = [
  { kind = "tree", at = [112, -10] }, { kind = "bush", at = [115, -3] }, { kind = "boulder", at = [109, -9] },
  { kind = "log", at = [113, -14], yaw_deg = 30 }, { kind = "hay_bale", at = [121, -1], yaw_deg = 12 },
  { kind = "post", at = [117, -14] }, { kind = "shed", at = [124, 1], yaw_deg = 70 }, { kind = "person", at = [123, -9] },
]
line = [{ kind = "fence", path = [[104, -14], [106, -11]] }, { kind = "hedge", path = [[104, 1], [110, 3]] }]
"#;

fn small() -> World {
    World::from_toml(SMALL).unwrap()
}

/// Reference: the nearest of the soil (found in steps of a centimetre), every stem of the world, and every shape.
fn reference_cast(world: &World, origin: DVec3, direction: DVec3, max_range_m: f64) -> Option<f64> {
    let mut nearest = max_range_m;
    let above = |t: f64| {
        let at = origin + direction * t;
        at.z - world.height_m(at.truncate())
    };
    let steps = (max_range_m / 0.01) as u32;
    if let Some(step) = (1..=steps).find(|step| above(f64::from(*step) * 0.01) < 0.0) {
        let (mut a, mut b) = (f64::from(step - 1) * 0.01, f64::from(step) * 0.01);
        for _ in 0..30 {
            let middle = 0.5 * (a + b);
            if above(middle) < 0.0 { b = middle } else { a = middle }
        }
        nearest = a;
    }
    let field = &world.inner.field;
    let low = world.bounds_m()[0];
    let run = direction.truncate().length();
    for row in 0..field.lattice.cells[1] {
        for column in 0..field.lattice.cells[0] {
            let tile = row / TILE * field.tiles_across + column / TILE;
            if field.tiles[tile][3] == 0.0 {
                continue;
            }
            let stem = field.stems.of_tile(tile)[row % TILE * TILE + column % TILE];
            let corner = low + DVec2::new(column as f64, row as f64) * CELL_M;
            let middle = low + DVec2::new(f64::from(stem.at[0]), f64::from(stem.at[1])) * CELL_M;
            let to = middle - origin.truncate();
            let (along, aside) =
                (to.dot(direction.truncate()) / run, to.perp_dot(direction.truncate()) / run);
            let radius = f64::from(stem.radius2).sqrt() * CELL_M;
            if aside.abs() >= radius {
                continue;
            }
            let t = (along - (radius * radius - aside * aside).sqrt()) / run;
            let up = origin.z + t * direction.z - world.height_m(corner);
            if t > f64::from(STEM_CLEAR_M) && t < nearest && up < f64::from(stem.height_m) {
                nearest = t;
            }
        }
    }
    let (o, d) = (world.local(origin), direction.to_array().map(|v| v as f32));
    for shape in &world.inner.shapes {
        if let Some(t) = shape.meet(o, d, nearest as f32) {
            nearest = nearest.min(f64::from(t));
        }
    }
    (nearest < max_range_m).then_some(nearest)
}

/// Number of rays compared.
const RAYS: usize = 600;

#[test]
fn rays_meet_what_the_plain_reference_meets() {
    let world = small();
    let mut dice = Dice::new(77);
    let mut missed = Vec::new();
    for _ in 0..RAYS {
        let at = DVec2::new(dice.between([101.0, 129.0]), dice.between([-19.0, 5.0]));
        let origin = at.extend(world.height_m(at) + dice.between([0.05, 3.0]));
        let flat = [-1.0, 1.0];
        let way = DVec3::new(dice.between(flat), dice.between(flat), dice.between([-0.5, 0.15])).normalize();
        // Up to the border, because the reference has no plain.
        let end = |o: f64, d: f64, low: f64, high: f64| ((if d > 0.0 { high } else { low }) - o) / d;
        let range = end(origin.x, way.x, 100.0, 130.0).min(end(origin.y, way.y, -20.0, 6.0)).min(25.0);
        let fast = world.cast(origin, way, range).map(|hit| hit.range_m);
        let slow = reference_cast(&world, origin, way, range);
        let same = match (fast, slow) {
            (Some(fast), Some(slow)) => (fast - slow).abs() < 0.02,
            (fast, slow) => fast == slow,
        };
        if !same {
            missed.push((origin, way, fast, slow));
        }
    }
    // With f32, a ray that grazes a blade or a leaf by micrometres may have another result.
    assert!(missed.len() * 100 <= RAYS, "{} of {RAYS}: {missed:?}", missed.len());
}

#[test]
fn a_packet_has_the_hits_of_its_rays_to_the_last_bit() {
    let world = small();
    let field = &world.inner.field;
    let mut dice = Dice::new(41);
    let (mut hits, mut stems) = (0, 0);
    for _ in 0..4 * RAYS {
        // Some origins are outside of the world.
        let at = DVec2::new(dice.between([97.0, 133.0]), dice.between([-23.0, 9.0]));
        let origin = world.local(at.extend(world.height_m(at) + dice.between([0.05, 3.0])));
        let way = DVec3::new(dice.between([-1.0, 1.0]), dice.between([-1.0, 1.0]), dice.between([-0.8, 0.1]));
        // Neighbours, as of pixels; of some packets rays far apart, of which one points along an axis and one down, and
        // one is not used.
        let spread = if dice.unit() < 0.8 { 0.01 } else { 0.7 };
        let mut directions = [(); LANES].map(|()| {
            let aside =
                DVec3::new(dice.between([-1.0, 1.0]), dice.between([-1.0, 1.0]), dice.between([-1.0, 1.0]));
            (way + aside * spread).normalize().to_array().map(|v| v as f32)
        });
        if spread > 0.5 {
            directions[1..].copy_from_slice(&[[0.0, -0.8, -0.6], [0.0, 0.0, -1.0], [0.0; 3]]);
        }
        let from = dice.between([-3.0, 3.0]).max(0.0) as f32 * if dice.unit() < 0.1 { 30.0 } else { 1.0 };
        let mut to = [(); LANES].map(|()| dice.between([0.0, 60.0]) as f32);
        to[3] *= if spread > 0.5 { 0.0 } else { 1.0 };
        let by_axis = [0, 1, 2].map(|axis| Vec4::from_array(directions.map(|direction| direction[axis])));
        let packet = field.cast_packet(&Packet::new(origin, by_axis), from, to);
        let alone: [_; LANES] =
            std::array::from_fn(|lane| field.cast(&FieldRay::new(origin, directions[lane]), from, to[lane]));
        assert_eq!(packet, alone, "from {origin:?} along {directions:?}, {from} to {to:?} m");
        hits += alone.iter().flatten().count();
        stems += alone.iter().flatten().filter(|hit| hit.stem >= 0.0).count();
    }
    assert!(hits > 4 * RAYS && stems > RAYS / 4, "{hits} hits, {stems} of stems");
}

/// Whether a point is inside of a shape without holes.
fn inside(shape: &Shape, at: [f64; 3]) -> bool {
    let [c, s] = shape.turn.map(f64::from);
    let half = shape.half.map(f64::from);
    let from = [0, 1, 2].map(|axis| at[axis] - f64::from(shape.middle[axis]));
    let own = [c * from[0] + s * from[1], c * from[1] - s * from[0], from[2]];
    let [x, y, z] = [0, 1, 2].map(|axis| (own[axis] / half[axis]).abs());
    match shape.form {
        Form::Ellipsoid => x * x + y * y + z * z < 1.0,
        Form::Column => x * x + y * y < 1.0 && z < 1.0,
        Form::Roll => y * y + z * z < 1.0 && x < 1.0,
        Form::Box | Form::Mesh => x < 1.0 && y < 1.0 && z < 1.0,
    }
}

proptest! {
    #[test]
    fn shapes_are_met_where_a_walk_along_the_ray_enters_them(
        form in 0_usize..4, yaw in -3.0..3.0_f64, half_cm in prop::array::uniform3(10..150_u8),
        from in prop::array::uniform3(-4.0..4.0_f64), to in prop::array::uniform3(-1.0..1.0_f64),
    ) {
        let form = [Form::Ellipsoid, Form::Column, Form::Roll, Form::Box][form];
        // Whole centimetres: proptest's own sampler of f32 fails its assertions now and then.
        let mut half = half_cm.map(|cm| f32::from(cm) / 100.0);
        if form == Form::Column { half[1] = half[0] }
        if form == Form::Roll { half[2] = half[1] }
        let shape = Shape {
            form, thing: 0, class: Class::Boulder, middle: [20.0, 30.0, 1.0], half,
            turn: [libm::cos(yaw) as f32, libm::sin(yaw) as f32], leaf_m: 0.0,
            coat: Coat { colours: [[0.0; 3]; 2], grain: [1.0; 2] }, ground_m: 0.0, thing_height_m: 1.0,
        };
        let origin = DVec3::new(20.0, 30.0, 1.0) + DVec3::from_array(from);
        prop_assume!(!inside(&shape, origin.to_array()));
        let way = (DVec3::new(20.0, 30.0, 1.0) + DVec3::from_array(to) - origin).normalize();
        let walked = (1..10_000).map(|step| f64::from(step) * 1e-3).find(|t| inside(&shape, (origin + way * *t).to_array()));
        let met = shape.meet(origin.to_array().map(|v| v as f32), way.to_array().map(|v| v as f32), 10.0);
        match (met, walked) {
            (Some(met), Some(walked)) => {
                // A corner that is crossed within a millimetre may be stepped over.
                prop_assert!((f64::from(met) - walked).abs() < 0.05, "{met} {walked}");
                let n = shape.normal((origin + way * f64::from(met)).to_array().map(|v| v as f32), way.to_array().map(|v| v as f32));
                let out = origin + way * f64::from(met) + DVec3::new(n[0].into(), n[1].into(), n[2].into()) * 1e-3;
                prop_assert!(!inside(&shape, out.to_array()) || f64::from(met) > walked - 2e-3);
            }
            (None, None) => {}
            (Some(met), None) => {
                let deep = [2e-3, 5e-3].map(|d| inside(&shape, (origin + way * (f64::from(met) + d)).to_array()));
                prop_assert!(!deep[0] || !deep[1], "missed by the walk at {met}");
            }
            (None, Some(walked)) => {
                let stays = inside(&shape, (origin + way * (walked + 5e-3)).to_array());
                prop_assert!(!stays, "missed at {walked}");
            }
        }
    }
}

struct Image {
    rgb: Vec<u8>,
    depth_m: Vec<f32>,
    class: Vec<u8>,
    label: Vec<u8>,
}

fn draw(world: &World, rays: &CameraRays, pose: &Pose, cuts: &[usize]) -> Image {
    let pixels = rays.width() * rays.height();
    let mut image = Image {
        rgb: vec![0; 3 * pixels],
        depth_m: vec![0.0; pixels],
        class: vec![0; pixels],
        label: vec![0; pixels],
    };
    let width = rays.width();
    for rows in cuts.windows(2) {
        let span = rows[0] * width..rows[1] * width;
        let mut out = ViewRows {
            rgb: &mut image.rgb[3 * span.start..3 * span.end],
            depth_m: &mut image.depth_m[span.clone()],
            class: &mut image.class[span.clone()],
            label: &mut image.label[span],
        };
        render_rows(world, rays, pose, 1.0, rows[0]..rows[1], &mut out);
    }
    image
}

fn camera_pose(world: &World, x: f64, y: f64, yaw_deg: f64) -> Pose {
    let at = DVec2::new(x, y);
    let camera = at.extend(world.height_m(at) + 0.9);
    Pose::from_rpy(camera, 0.05, 0.2, yaw_deg.to_radians()) * Pose::body_from_optical()
}

fn camera_rays() -> CameraRays {
    let lens = Distortion::from_model("plumb_bob", &[-0.25, 0.07, 0.001, -0.001, 0.0]).unwrap();
    CameraRays::new(&PinholeCamera::new([100, 75], [70.0, 70.0], [49.0, 38.0], lens).unwrap())
}

#[test]
fn every_pixel_is_what_its_ray_meets() {
    let world = small();
    let rays = camera_rays();
    let (mut pixels, mut differ) = (0, 0);
    for (x, y, yaw) in [
        (102.0, -8.0, 0.0),
        (104.0, -17.0, 60.0),
        (128.0, -9.0, 180.0),
        (116.0, 4.0, 260.0),
        (122.0, -10.0, 45.0),
    ] {
        let pose = camera_pose(&world, x, y, yaw);
        let image = draw(&world, &rays, &pose, &[0, rays.height()]);
        for at in 0..rays.width() * rays.height() {
            let ray = rays.ray(at % rays.width(), at / rays.width()).unwrap();
            let way = pose.rotate(DVec3::from_array(ray.map(f64::from)));
            let hit: Option<Hit> = world.cast(pose.translation, way, CAMERA_RANGE_M);
            let class = hit.map_or(Class::Sky, |hit| hit.class);
            let depth = hit.map(|hit| hit.range_m * f64::from(ray[2]));
            let drawn = f64::from(image.depth_m[at]);
            let same = match depth {
                Some(depth) => (depth - drawn).abs() < 1e-3 * (1.0 + depth),
                None => drawn.is_nan(),
            };
            pixels += 1;
            differ += u32::from(!same || class.code() != image.class[at]);
        }
    }
    // Rotating the ray in f32 moves it by micrometres, so that a few rays hit the next leaf or blade.
    assert!(differ * 200 <= pixels, "{differ} of {pixels}");
}

#[test]
fn however_an_image_is_cut_into_strips_its_bits_are_the_same() {
    let world = small();
    let rays = camera_rays();
    let pose = camera_pose(&world, 102.0, -8.0, 0.0);
    let whole = draw(&world, &rays, &pose, &[0, 75]);
    for cuts in [&[0, 1, 2, 7, 8, 40, 75][..], &[0, 37, 75], &[0, 8, 16, 24, 32, 64, 75]] {
        let cut = draw(&world, &rays, &pose, cuts);
        assert!(whole.rgb == cut.rgb && whole.class == cut.class && whole.label == cut.label);
        assert!(whole.depth_m.iter().zip(&cut.depth_m).all(|(a, b)| a.to_bits() == b.to_bits()));
    }
}

#[test]
fn the_same_text_gives_the_same_world_and_another_seed_another() {
    let rays = camera_rays();
    let text = format!("{SMALL}scatter = [{{ kind = \"bush\", count = 9, circle = [115, -8, 9] }}]\n");
    let (a, b) = (World::from_toml(&text).unwrap(), World::from_toml(&text).unwrap());
    let other = World::from_toml(&text.replace("seed = 5", "seed = 6")).unwrap();
    let pose = camera_pose(&a, 102.0, -8.0, 0.0);
    assert_eq!(a.things(), b.things());
    assert_ne!(a.things(), other.things());
    let [a, b, other] = [a, b, other].map(|world| draw(&world, &rays, &pose, &[0, 75]));
    assert!(a.rgb == b.rgb && a.rgb != other.rgb);
}

#[test]
fn a_ray_through_growth_is_stopped_as_often_as_the_density_says() {
    let text = SMALL.replace(
        "circle = [106, -6, 3]",
        "polygon = [[100, -20], [130, -20], [130, 6], [100, 6]], edge_m = 0",
    );
    let text = text.replace(
        "\nundulation",
        "\n[surface.tall_grass]\ndensity_per_m = 2.0\nheight_m = 2.0\n[x]\nundulation",
    );
    let text: String = text.split("[x]").next().unwrap().to_owned()
        + "[[paint]]\nsurface = \"tall_grass\"\npolygon = [[100, -20], [130, -20], [130, 6], [100, 6]]\nedge_m = 0\n";
    let world = World::from_toml(&text).unwrap();
    let mut dice = Dice::new(3);
    let (mut hits, mut metres) = (0.0, 0.0);
    for _ in 0..4000 {
        let origin = DVec3::new(dice.between([110.0, 120.0]), dice.between([-12.0, -2.0]), 0.8);
        let way = DVec3::new(dice.between([-1.0, 1.0]), dice.between([-1.0, 1.0]), 0.0).normalize();
        let range = world.cast(origin, way, 3.0).map_or(3.0, |hit| hit.range_m);
        metres += range - f64::from(STEM_CLEAR_M);
        hits += f64::from(u8::from(range < 3.0));
    }
    let density = hits / metres;
    // Most cells have a stem, so stems are more evenly distributed than at random; the limit is a fifth.
    assert!((1.6..2.4).contains(&density), "{density}");
}
