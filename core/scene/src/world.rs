//! A world: read from its file, computed once, shared by all readers.

use std::sync::Arc;

use rcs_geom::{DVec2, DVec3, Utm};

use crate::build;
use crate::class::Surface;
use crate::drive::DriveMap;
use crate::heightfield::HeightField;
use crate::look::Look;
use crate::looks::Looks;
use crate::read::SceneError;
use crate::shape::Shape;
use crate::shape_grid::ShapeGrid;
use crate::spec::WorldSpec;
use crate::surface::Material;
use crate::terrain::{CELL_M, Lattice};
use crate::thing::Thing;

/// A simulated world. Immutable; a clone shares everything.
#[derive(Clone)]
pub struct World {
    pub(crate) inner: Arc<Inner>,
}

pub(crate) struct Inner {
    name: String,
    origin: Utm,
    bounds_m: [DVec2; 2],
    materials: Vec<Material>,
    pub(crate) field: HeightField,
    pub(crate) things: Vec<Thing>,
    pub(crate) shapes: Vec<Shape>,
    pub(crate) grid: ShapeGrid,
    pub(crate) looks: Looks,
    pub(crate) drive: DriveMap,
    /// Whether some vegetation does not give way.
    pub(crate) has_thickets: bool,
}

/// Properties of the ground at a position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ground {
    /// Height of the soil, m.
    pub height_m: f64,
    /// Upward direction of the soil, length 1.
    pub normal: DVec3,
    /// Its surface.
    pub surface: Surface,
    /// Greatest horizontal force as a fraction of the load.
    pub traction: f64,
    /// Rolling resistance as a fraction of the load.
    pub rolling_resistance: f64,
    /// Slip at which the force of a wheel reaches the limit of traction, at least.
    pub slip_at_limit: f64,
    /// Height of the vegetation, m.
    pub vegetation_height_m: f64,
    /// Force needed to push through the vegetation, as a fraction of the vehicle's weight.
    pub vegetation_drag: f64,
    /// Whether a vehicle can drive into the vegetation.
    pub passable: bool,
}

impl World {
    /// Parses a world file and computes the world; `docs/reference/worlds.md` lists the keys.
    pub fn from_toml(text: &str) -> Result<World, SceneError> {
        World::with_look(text, None)
    }

    /// Like [`World::from_toml`], with other colours and light.
    pub fn with_look(text: &str, look: Option<&Look>) -> Result<World, SceneError> {
        let mut spec = WorldSpec::read(text)?;
        if let Some(look) = look {
            look.dress(&mut spec);
        }
        let lattice = Lattice::build(&spec);
        let things = build::things(&spec, &lattice);
        let low = spec.bounds_m[0];
        let shapes = build::shapes(&things, &spec.coats, low);
        let looks = Looks::build(&spec, &lattice, &shapes);
        let grid = ShapeGrid::new(&shapes, &lattice);
        let drive = DriveMap::build(&spec, &lattice, &things);
        let has_thickets =
            lattice.surface.iter().any(|&code| !spec.materials[usize::from(code).max(1) - 1].passable);
        let field = HeightField::new(lattice, &spec.materials, spec.seed ^ 0x57E3);
        let WorldSpec { name, origin, bounds_m, materials, .. } = spec;
        let inner = Inner {
            name,
            origin,
            bounds_m,
            materials,
            field,
            things,
            shapes,
            grid,
            looks,
            drive,
            has_thickets,
        };
        Ok(World { inner: Arc::new(inner) })
    }

    /// Parses a world file like [`World::from_toml`] without computing the world: returns its origin and the corners of
    /// its bounds.
    pub fn check(text: &str) -> Result<(Utm, [DVec2; 2]), SceneError> {
        let spec = WorldSpec::read(text)?;
        Ok((spec.origin, spec.bounds_m))
    }

    /// Name in the file.
    pub fn name(&self) -> &str {
        &self.inner.name
    }

    /// UTM coordinates of the global frame's origin (0, 0); its x axis is easting, its y axis northing.
    pub fn origin(&self) -> Utm {
        self.inner.origin
    }

    /// The lower left and the upper right corner, m. Outside is a plain of height 0.
    pub fn bounds_m(&self) -> [DVec2; 2] {
        self.inner.bounds_m
    }

    /// The things of the world; the number of a thing is its index here.
    pub fn things(&self) -> &[Thing] {
        &self.inner.things
    }

    /// Height of the soil, m. Continuous; outside of the bounds it is that of the plain.
    pub fn height_m(&self, xy: DVec2) -> f64 {
        let at = self.in_cells(xy);
        self.inner.field.lattice.height(at.x, at.y).0
    }

    /// Properties of the ground at a position, m. A position that is not finite is replaced by the nearest corner.
    pub fn ground(&self, xy: DVec2) -> Ground {
        let at = self.in_cells(xy);
        let lattice = &self.inner.field.lattice;
        let (height_m, slope) = lattice.height(at.x, at.y);
        let surface = lattice.surface(at.x, at.y);
        let material = &self.inner.materials[surface as usize - 1];
        Ground {
            height_m,
            normal: DVec3::new(-slope[0], -slope[1], 1.0).normalize(),
            surface,
            traction: material.traction,
            rolling_resistance: material.rolling_resistance,
            slip_at_limit: material.slip_at_limit,
            vegetation_height_m: material.height_m,
            vegetation_drag: material.drag,
            passable: material.passable,
        }
    }

    pub(crate) fn material(&self, surface: Surface) -> &Material {
        &self.inner.materials[surface as usize - 1]
    }

    /// Converts a position to cells from the lattice's first sample.
    pub(crate) fn in_cells(&self, xy: DVec2) -> DVec2 {
        let at = (xy - self.inner.bounds_m[0]) / CELL_M;
        if at.is_finite() { at } else { DVec2::ZERO }
    }

    /// A position relative to the lattice's first sample, m.
    pub(crate) fn local(&self, at: DVec3) -> [f32; 3] {
        let low = self.inner.bounds_m[0];
        [(at.x - low.x) as f32, (at.y - low.y) as f32, at.z as f32]
    }
}

impl std::fmt::Debug for World {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Inner { name, bounds_m, things, .. } = &*self.inner;
        f.debug_struct("World")
            .field("name", name)
            .field("bounds_m", bounds_m)
            .field("things", &things.len())
            .finish()
    }
}
