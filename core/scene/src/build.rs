//! Converts the things of a world file to shapes: each kind consists of a few convex shapes.

use rcs_geom::DVec2;

use crate::class::{Class, ThingKind};
use crate::coat::{CoatKind, Coats};
use crate::noise::{Dice, hash2};
use crate::shape::{Form, Shape, Vec3};
use crate::spec::{Placed, Placement, WorldSpec};
use crate::terrain::{CELL_M, Lattice};
use crate::thing::Thing;

/// Fences and hedges are cut into pieces of about this length, m.
const PIECE_M: f64 = 2.0;
/// Attempts to find a free position for one thing of a seeded list.
const TRIES: u32 = 30;

/// All things of a world, standing on its ground.
pub(crate) fn things(spec: &WorldSpec, lattice: &Lattice) -> Vec<Thing> {
    let mut things = Vec::new();
    for (number, placed) in spec.placed.iter().enumerate() {
        let mut dice = Dice::new(hash2(number as i32, 0x7819, spec.seed));
        match &placed.place {
            Placement::At { at, yaw_rad } => {
                let size = placed.size.draw(|| f64::from(dice.unit()));
                things.push(Thing::new(things.len() as u32, placed.kind, *at, *yaw_rad, size));
            }
            Placement::Along(path) => along(placed, path, &mut dice, &mut things),
            Placement::Scattered { region, count, spacing_m } => {
                let [low, high] = region.extent();
                let (low, high) = (low.max(spec.bounds_m[0]), high.min(spec.bounds_m[1]));
                for _ in 0..*count {
                    // A list may ask for more than fit: a full region is not an error.
                    for _ in 0..TRIES {
                        let at = DVec2::new(dice.between([low.x, high.x]), dice.between([low.y, high.y]));
                        let size = placed.size.draw(|| f64::from(dice.unit()));
                        let yaw_rad = dice.between([0.0, std::f64::consts::TAU]);
                        let thing = Thing::new(things.len() as u32, placed.kind, at, yaw_rad, size);
                        let reach = thing.radius_m;
                        let free = region.distance_m(at) < 0.0
                            && spec.clear.iter().all(|clear| clear.distance_m(at) > reach)
                            && things.iter().all(|other| other.outline_distance_m(at) > spacing_m.max(reach));
                        if free {
                            things.push(thing);
                            break;
                        }
                    }
                }
            }
        }
    }
    let low = spec.bounds_m[0];
    for thing in &mut things {
        let at = (thing.position.truncate() - low) / CELL_M;
        thing.position.z = lattice.height(at.x, at.y).0;
    }
    things
}

fn along(placed: &Placed, path: &[DVec2], dice: &mut Dice, things: &mut Vec<Thing>) {
    for leg in path.windows(2) {
        let pieces = (leg[0].distance(leg[1]) / PIECE_M).ceil().max(1.0);
        let piece = (leg[1] - leg[0]) / pieces;
        for at in 0..pieces as u32 {
            let mut size = placed.size.draw(|| f64::from(dice.unit()));
            size.length_m = piece.length();
            let middle = leg[0] + piece * (f64::from(at) + 0.5);
            let yaw_rad = libm::atan2(piece.y, piece.x);
            things.push(Thing::new(things.len() as u32, placed.kind, middle, yaw_rad, size));
        }
    }
}

/// Adds the shapes of one thing.
struct Builder<'t> {
    thing: &'t Thing,
    /// Position of the thing relative to the lattice's first sample, m.
    at: Vec3,
    turn: [f32; 2],
    coats: &'t Coats,
    shapes: &'t mut Vec<Shape>,
}

impl Builder<'_> {
    /// A shape in the axes of the thing, its middle above the ground, m.
    fn add(
        &mut self,
        form: Form,
        class: Class,
        coat: CoatKind,
        middle: [f64; 3],
        half: [f64; 3],
        leaf_m: f32,
    ) {
        let [c, s] = self.turn;
        let [x, y, z] = middle.map(|v| v as f32);
        self.shapes.push(Shape {
            form,
            thing: self.thing.number,
            class,
            middle: [self.at[0] + c * x - s * y, self.at[1] + s * x + c * y, self.at[2] + z],
            half: half.map(|v| v as f32),
            turn: self.turn,
            leaf_m,
            coat: self.coats.of(coat),
            ground_m: self.at[2],
            thing_height_m: self.thing.height_m as f32,
        });
    }

    fn solid(&mut self, form: Form, class: Class, coat: CoatKind, middle: [f64; 3], half: [f64; 3]) {
        self.add(form, class, coat, middle, half, 0.0);
    }

    /// A vertical column between two heights.
    fn column(&mut self, class: Class, coat: CoatKind, [x, y]: [f64; 2], radius: f64, [from, to]: [f64; 2]) {
        let half = [radius, radius, 0.5 * (to - from)];
        self.solid(Form::Column, class, coat, [x, y, 0.5 * (from + to)], half);
    }
}

/// How far shapes extend into the ground, so that there is no gap on slopes, m.
const ROOT_M: f64 = 0.15;

/// The shapes of all things; `low` is the lower left corner of the world's bounds.
pub(crate) fn shapes(things: &[Thing], coats: &Coats, low: DVec2) -> Vec<Shape> {
    let mut shapes = Vec::new();
    for thing in things {
        let at = thing.position - low.extend(0.0);
        let turn = [libm::cos(thing.yaw_rad) as f32, libm::sin(thing.yaw_rad) as f32];
        let at = [at.x as f32, at.y as f32, at.z as f32];
        build(&mut Builder { thing, at, turn, coats, shapes: &mut shapes });
    }
    shapes
}

fn build(b: &mut Builder<'_>) {
    let size = b.thing.size;
    let (r, h, l, w) = (size.radius_m, size.height_m, 0.5 * size.length_m, 0.5 * size.width_m);
    let mut dice = Dice::new(b.thing.number ^ 0x51AB);
    match b.thing.kind {
        ThingKind::Tree => tree(b, &mut dice),
        ThingKind::Bush => bush(b, &mut dice),
        ThingKind::Hedge => hedge(b, &mut dice),
        ThingKind::Boulder => {
            // Half of the ellipsoid is in the ground, so that it is steepest and widest at the ground.
            b.solid(
                Form::Ellipsoid,
                Class::Boulder,
                CoatKind::Stone,
                [0.0; 3],
                [r, dice.between([0.7, 1.0]) * r, h],
            );
        }
        ThingKind::Log => b.solid(Form::Roll, Class::Log, CoatKind::Bark, [0.0, 0.0, r], [l, r, r]),
        ThingKind::HayBale => {
            b.solid(
                Form::Box,
                Class::HayBale,
                CoatKind::Straw,
                [0.0, 0.0, 0.5 * (h - ROOT_M)],
                [l, w, 0.5 * (h + ROOT_M)],
            );
        }
        ThingKind::Post => b.column(Class::Post, CoatKind::Timber, [0.0, 0.0], r, [-ROOT_M, h]),
        ThingKind::Fence => {
            b.solid(Form::Mesh, Class::Fence, CoatKind::Plastic, [0.0, 0.0, 0.5 * h], [l, 0.01, 0.5 * h]);
            b.column(Class::Fence, CoatKind::Plastic, [-l, 0.0], 0.02, [-ROOT_M, h]);
            b.column(Class::Fence, CoatKind::Plastic, [l, 0.0], 0.02, [-ROOT_M, h]);
        }
        ThingKind::Shed => {
            let wall = 0.86 * h;
            b.solid(
                Form::Box,
                Class::Shed,
                CoatKind::Planks,
                [0.0, 0.0, 0.5 * (wall - ROOT_M)],
                [l, w, 0.5 * (wall + ROOT_M)],
            );
            b.solid(
                Form::Box,
                Class::Shed,
                CoatKind::Roof,
                [0.0, 0.0, 0.93 * h],
                [l + 0.2, w + 0.2, 0.07 * h],
            );
            b.solid(Form::Box, Class::Shed, CoatKind::Timber, [-l, 0.0, 0.4 * h], [0.02, 0.45, 0.4 * h]);
        }
        ThingKind::Person => person(b),
    }
}

/// A trunk and a crown of lumps.
fn tree(b: &mut Builder<'_>, dice: &mut Dice) {
    let size = b.thing.size;
    let (r, h) = (size.radius_m, size.height_m);
    b.column(Class::Trunk, CoatKind::Bark, [0.0, 0.0], r, [-ROOT_M, 0.7 * h]);
    let crown = size.crown_radius_m;
    b.add(
        Form::Ellipsoid,
        Class::Crown,
        CoatKind::Crown,
        [0.0, 0.0, 0.68 * h],
        [0.8 * crown, 0.8 * crown, 0.32 * h],
        0.09,
    );
    for lump in 0..4 {
        let side = [[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]][lump].map(|v: f64| v * 0.5 * crown);
        let up = h * dice.between([0.52, 0.78]);
        let half = [0.5 * crown, 0.5 * crown, dice.between([0.12, 0.17]) * h];
        b.add(Form::Ellipsoid, Class::Crown, CoatKind::Crown, [side[0], side[1], up], half, 0.09);
    }
}

/// Lumps on the ground.
fn bush(b: &mut Builder<'_>, dice: &mut Dice) {
    let size = b.thing.size;
    let (r, h) = (size.radius_m, size.height_m);
    b.add(
        Form::Ellipsoid,
        Class::Bush,
        CoatKind::Bush,
        [0.0, 0.0, 0.45 * h],
        [0.85 * r, 0.85 * r, 0.55 * h],
        0.045,
    );
    for side in [[1.0, 0.3], [-0.6, 0.8], [-0.3, -0.9]] {
        let shift = side.map(|v: f64| v * 0.45 * r);
        let up = dice.between([0.3, 0.5]) * h;
        b.add(
            Form::Ellipsoid,
            Class::Bush,
            CoatKind::Bush,
            [shift[0], shift[1], up],
            [0.52 * r, 0.52 * r, 0.42 * h],
            0.045,
        );
    }
}

/// A box of leaves with lumps on it.
fn hedge(b: &mut Builder<'_>, dice: &mut Dice) {
    let size = b.thing.size;
    let (h, l, w) = (size.height_m, 0.5 * size.length_m, 0.5 * size.width_m);
    b.add(Form::Box, Class::Bush, CoatKind::Bush, [0.0, 0.0, 0.5 * h - 0.1], [l, 0.85 * w, 0.5 * h], 0.045);
    for part in [-0.66, 0.0, 0.66] {
        let middle = [part * l, dice.between([-0.1, 0.1]) * w, dice.between([0.62, 0.72]) * h];
        b.add(Form::Ellipsoid, Class::Bush, CoatKind::Bush, middle, [0.45 * l, w, 0.36 * h], 0.045);
    }
}

/// Legs, arms, a trunk and a head.
fn person(b: &mut Builder<'_>) {
    let size = b.thing.size;
    let h = size.height_m;
    let s = h / 1.75;
    for side in [-0.1, 0.1] {
        b.column(Class::Person, CoatKind::Trousers, [0.0, side * s], 0.075 * s, [-0.05, 0.85 * s]);
        b.column(Class::Person, CoatKind::Jacket, [0.0, 2.5 * side * s], 0.05 * s, [0.8 * s, 1.42 * s]);
    }
    b.solid(
        Form::Ellipsoid,
        Class::Person,
        CoatKind::Jacket,
        [0.0, 0.0, 1.14 * s],
        [0.13 * s, 0.22 * s, 0.36 * s],
    );
    b.solid(
        Form::Ellipsoid,
        Class::Person,
        CoatKind::Skin,
        [0.0, 0.0, 1.61 * s],
        [0.1 * s, 0.085 * s, 0.14 * s],
    );
}
