//! Things: the objects that stand on the ground, their sizes and their solid parts.

use rcs_geom::{DVec2, DVec3};

use crate::class::ThingKind;
use crate::read::{SceneError, Table};

/// The solid part of a thing: a prism over this outline, from the ground to the thing's solid height.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Outline {
    /// Centred on the thing's position.
    Circle {
        /// m.
        radius_m: f64,
    },
    /// Centred on the thing's position, rotated by its yaw.
    Rectangle {
        /// Half size along the thing's x axis, m.
        half_length_m: f64,
        /// Half size along its y axis, m.
        half_width_m: f64,
    },
}

/// One thing of a world.
#[derive(Clone, Debug, PartialEq)]
pub struct Thing {
    /// Its index among the world's things.
    pub number: u32,
    /// Its kind.
    pub kind: ThingKind,
    /// Position of its middle on the ground, m.
    pub position: DVec3,
    /// Angle of its x axis from east, counter-clockwise, rad.
    pub yaw_rad: f64,
    /// Radius of the circle around it, including its crown, m.
    pub radius_m: f64,
    /// Height above the ground, m.
    pub height_m: f64,
    /// Outline of its solid part.
    pub solid: Outline,
    /// Height up to which it is solid, m.
    pub solid_height_m: f64,
    /// Sizes as given in the file.
    pub(crate) size: Size,
}

/// Sizes of a thing; each kind uses some of them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[expect(clippy::struct_field_names, reason = "units stay in names")]
pub(crate) struct Size {
    /// Radius of the trunk, foliage, stone, log or post, m.
    pub(crate) radius_m: f64,
    pub(crate) height_m: f64,
    /// Radius of a tree's crown, m.
    pub(crate) crown_radius_m: f64,
    pub(crate) length_m: f64,
    pub(crate) width_m: f64,
}

/// Ranges of sizes, from which each thing of a list draws its own.
#[derive(Clone, Copy, Debug, PartialEq)]
#[expect(clippy::struct_field_names, reason = "units stay in names")]
pub(crate) struct SizeRange {
    pub(crate) radius_m: [f64; 2],
    pub(crate) height_m: [f64; 2],
    pub(crate) crown_radius_m: [f64; 2],
    pub(crate) length_m: [f64; 2],
    pub(crate) width_m: [f64; 2],
}

/// The foliage of a bush gives way, its core does not.
const CORE: f64 = 0.7;

impl SizeRange {
    /// Default sizes of a kind, and which of them a file may give.
    fn usual(kind: ThingKind) -> ([f64; 5], &'static [&'static str]) {
        // Radius, height, crown radius, length, width.
        match kind {
            ThingKind::Tree => ([0.15, 6.0, 1.8, 0.0, 0.0], &["radius_m", "height_m", "crown_radius_m"]),
            ThingKind::Bush => ([0.7, 1.1, 0.0, 0.0, 0.0], &["radius_m", "height_m"]),
            ThingKind::Boulder => ([0.4, 0.35, 0.0, 0.0, 0.0], &["radius_m", "height_m"]),
            ThingKind::Post => ([0.06, 1.2, 0.0, 0.0, 0.0], &["radius_m", "height_m"]),
            ThingKind::Person => ([0.26, 1.75, 0.0, 0.0, 0.0], &["height_m"]),
            ThingKind::Log => ([0.16, 0.32, 0.0, 2.4, 0.0], &["radius_m", "length_m"]),
            ThingKind::HayBale => ([0.0, 0.55, 0.0, 1.1, 0.6], &["height_m", "length_m", "width_m"]),
            ThingKind::Shed => ([0.0, 2.4, 0.0, 4.0, 3.0], &["height_m", "length_m", "width_m"]),
            ThingKind::Fence => ([0.0, 1.1, 0.0, 2.0, 0.04], &["height_m"]),
            ThingKind::Hedge => ([0.0, 1.4, 0.0, 3.0, 0.9], &["height_m", "width_m"]),
        }
    }

    /// Reads the sizes of a kind.
    pub(crate) fn read(kind: ThingKind, table: &mut Table<'_>) -> Result<SizeRange, SceneError> {
        let (usual, keys) = SizeRange::usual(kind);
        let mut span = |key: &'static str, usual: f64| -> Result<[f64; 2], SceneError> {
            let given = if keys.contains(&key) { table.span(key, 0.02..=20.0)? } else { None };
            Ok(given.unwrap_or([usual, usual]))
        };
        let mut size = SizeRange {
            radius_m: span("radius_m", usual[0])?,
            height_m: span("height_m", usual[1])?,
            crown_radius_m: span("crown_radius_m", usual[2])?,
            length_m: span("length_m", usual[3])?,
            width_m: span("width_m", usual[4])?,
        };
        if kind == ThingKind::Log {
            size.height_m = size.radius_m.map(|radius| 2.0 * radius);
        }
        Ok(size)
    }

    /// Draws sizes from the ranges; `fraction` returns numbers in [0, 1).
    pub(crate) fn draw(&self, mut fraction: impl FnMut() -> f64) -> Size {
        let mut between = |[least, largest]: [f64; 2]| least + (largest - least) * fraction();
        let size = between(self.radius_m);
        Size {
            radius_m: size,
            height_m: between(self.height_m),
            crown_radius_m: between(self.crown_radius_m),
            length_m: between(self.length_m),
            width_m: between(self.width_m),
        }
    }
}

impl Thing {
    /// A thing with these sizes at a position whose ground height is set later.
    pub(crate) fn new(number: u32, kind: ThingKind, at: DVec2, yaw_rad: f64, size: Size) -> Thing {
        let circle = |radius_m: f64| Outline::Circle { radius_m };
        let rectangle = |length_m: f64, width_m: f64| Outline::Rectangle {
            half_length_m: 0.5 * length_m,
            half_width_m: 0.5 * width_m,
        };
        let diagonal = 0.5 * DVec2::new(size.length_m, size.width_m).length();
        let (solid, radius_m) = match kind {
            ThingKind::Tree => (circle(size.radius_m), size.crown_radius_m.max(size.radius_m)),
            ThingKind::Bush => (circle(CORE * size.radius_m), size.radius_m),
            ThingKind::Boulder | ThingKind::Post | ThingKind::Person => {
                (circle(size.radius_m), size.radius_m)
            }
            ThingKind::Log => {
                let radius = DVec2::new(0.5 * size.length_m, size.radius_m).length();
                (rectangle(size.length_m, 2.0 * size.radius_m), radius)
            }
            ThingKind::HayBale | ThingKind::Shed | ThingKind::Fence => {
                (rectangle(size.length_m, size.width_m), diagonal)
            }
            ThingKind::Hedge => (rectangle(size.length_m, CORE * size.width_m), diagonal),
        };
        let solid_height_m = match kind {
            ThingKind::Bush | ThingKind::Hedge => CORE * size.height_m,
            _ => size.height_m,
        };
        let position = at.extend(0.0);
        Thing {
            number,
            kind,
            position,
            yaw_rad,
            radius_m,
            height_m: size.height_m,
            solid,
            solid_height_m,
            size,
        }
    }

    /// Distance of a position from the thing's outline (including foliage, excluding crowns), m; 0 or less inside.
    pub(crate) fn outline_distance_m(&self, at: DVec2) -> f64 {
        let offset = at - self.position.truncate();
        let outline = match (self.kind, self.solid) {
            (ThingKind::Bush, _) => Outline::Circle { radius_m: self.size.radius_m },
            (ThingKind::Hedge, Outline::Rectangle { half_length_m, .. }) => {
                Outline::Rectangle { half_length_m, half_width_m: 0.5 * self.size.width_m }
            }
            (_, solid) => solid,
        };
        match outline {
            Outline::Circle { radius_m } => offset.length() - radius_m,
            Outline::Rectangle { half_length_m, half_width_m } => {
                let axis = DVec2::new(libm::cos(self.yaw_rad), libm::sin(self.yaw_rad));
                let over = DVec2::new(
                    axis.dot(offset).abs() - half_length_m,
                    axis.perp_dot(offset).abs() - half_width_m,
                );
                over.max(DVec2::ZERO).length() + over.max_element().min(0.0)
            }
        }
    }
}
