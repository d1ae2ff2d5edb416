//! A world file, parsed and checked: the definition of a world before anything is computed.

use rcs_geom::{DVec2, Utm};

use crate::class::{Surface, ThingKind};
use crate::coat::Coats;
use crate::light::{Light, SHADE, Sky};
use crate::read::{SceneError, Table};
use crate::region::Region;
use crate::surface::Material;
use crate::thing::SizeRange;

/// Smooth noise of the base terrain.
pub(crate) struct Undulation {
    pub(crate) wavelength_m: f64,
    pub(crate) amplitude_m: f64,
}

/// A round or elliptic hill, or a hollow if `height_m` is negative.
pub(crate) struct Hill {
    pub(crate) centre: DVec2,
    /// Radii along its own axes, m.
    pub(crate) radius_m: [f64; 2],
    pub(crate) yaw_rad: f64,
    pub(crate) height_m: f64,
}

/// Ground that rises from one position to another; it is level beyond them.
pub(crate) struct Slope {
    pub(crate) from: DVec2,
    pub(crate) to: DVec2,
    pub(crate) rise_m: f64,
}

/// A ditch along a path.
pub(crate) struct Ditch {
    pub(crate) path: Vec<DVec2>,
    pub(crate) half_width_m: f64,
    pub(crate) depth_m: f64,
    /// Width of each bank, within the half width, m.
    pub(crate) bank_m: f64,
}

/// A step along a path: higher on its left side, with a gradual return to the original height.
pub(crate) struct Ledge {
    pub(crate) path: Vec<DVec2>,
    pub(crate) height_m: f64,
    pub(crate) run_m: f64,
    pub(crate) fade_m: f64,
}

pub(crate) struct Paint {
    pub(crate) surface: Surface,
    pub(crate) region: Region,
    /// Irregularity of the border, m.
    pub(crate) edge_m: f64,
}

/// One thing, a line of things, or a seeded list.
pub(crate) struct Placed {
    pub(crate) kind: ThingKind,
    pub(crate) size: SizeRange,
    pub(crate) place: Placement,
}

pub(crate) enum Placement {
    At { at: DVec2, yaw_rad: f64 },
    Along(Vec<DVec2>),
    Scattered { region: Region, count: u32, spacing_m: f64 },
}

pub(crate) struct WorldSpec {
    pub(crate) name: String,
    pub(crate) seed: u32,
    pub(crate) origin: Utm,
    pub(crate) bounds_m: [DVec2; 2],
    pub(crate) base: Surface,
    /// Indexed by the code of the surface less 1.
    pub(crate) materials: Vec<Material>,
    pub(crate) undulations: Vec<Undulation>,
    pub(crate) hills: Vec<Hill>,
    pub(crate) slopes: Vec<Slope>,
    pub(crate) ditches: Vec<Ditch>,
    pub(crate) ledges: Vec<Ledge>,
    pub(crate) paints: Vec<Paint>,
    pub(crate) placed: Vec<Placed>,
    /// Regions in which seeded lists place nothing.
    pub(crate) clear: Vec<Region>,
    pub(crate) light: Light,
    pub(crate) sky: Sky,
    pub(crate) coats: Coats,
    /// Seed of the textures; that of the world without a look.
    pub(crate) texture_seed: u32,
}

/// Greatest side of a world, m, which limits its grids to tens of megabytes.
const MAX_SIDE_M: f64 = 200.0;
const MAX_SCATTERED: u32 = 2000;

impl WorldSpec {
    pub(crate) fn read(text: &str) -> Result<WorldSpec, SceneError> {
        let mut file = Table::open(text)?;
        let name = file.need_text("name")?;
        let seed = file.integer("seed", 0..=u32::MAX)?.unwrap_or(0);
        let bounds_m = read_bounds(&mut file)?;
        let origin = read_origin(&mut file)?;
        let names = Surface::ALL.map(Surface::name);
        let base = file.choice("base", &names, Surface::from_name)?.unwrap_or(Surface::ShortGrass);
        let materials = read_materials(&mut file)?;
        let sun_rad = match file.table("sun")? {
            Some(mut sun) => {
                let azimuth = sun.number_or("azimuth_deg", 120.0, -360.0..=360.0)?;
                let elevation = sun.number_or("elevation_deg", 50.0, 10.0..=90.0)?;
                sun.finish()?;
                [azimuth, elevation]
            }
            None => [120.0, 50.0],
        }
        .map(f64::to_radians);
        let mut spec = WorldSpec {
            name,
            seed,
            origin,
            bounds_m,
            base,
            materials,
            undulations: Vec::new(),
            hills: Vec::new(),
            slopes: Vec::new(),
            ditches: Vec::new(),
            ledges: Vec::new(),
            paints: Vec::new(),
            placed: Vec::new(),
            clear: Vec::new(),
            light: Light { sun_rad, shade: SHADE },
            sky: Sky::default(),
            coats: Coats::default(),
            texture_seed: seed,
        };
        spec.read_terrain(&mut file)?;
        for mut table in file.tables("paint")? {
            let surface = table.need_choice("surface", &names, Surface::from_name)?;
            let edge_m = table.number_or("edge_m", 0.15, 0.0..=5.0)?;
            let region = Region::read(&mut table)?;
            table.finish()?;
            spec.paints.push(Paint { surface, region, edge_m });
        }
        spec.read_things(&mut file)?;
        file.finish()?;
        Ok(spec)
    }

    fn read_terrain(&mut self, file: &mut Table<'_>) -> Result<(), SceneError> {
        for mut table in file.tables("undulation")? {
            let wavelength_m = table.need_number("wavelength_m", 0.5..=200.0)?;
            let amplitude_m = table.need_number("amplitude_m", 0.0..=5.0)?;
            table.finish()?;
            self.undulations.push(Undulation { wavelength_m, amplitude_m });
        }
        for mut table in file.tables("hill")? {
            let centre = table.need_point("centre")?;
            let radius_m = table.need_number("radius_m", 0.5..=200.0)?;
            let second = table.number_or("second_radius_m", radius_m, 0.5..=200.0)?;
            let yaw_rad = table.number_or("yaw_deg", 0.0, -360.0..=360.0)?.to_radians();
            let height_m = table.need_number("height_m", -10.0..=20.0)?;
            table.finish()?;
            self.hills.push(Hill { centre, radius_m: [radius_m, second], yaw_rad, height_m });
        }
        for mut table in file.tables("slope")? {
            let (from, to) = (table.need_point("from")?, table.need_point("to")?);
            let rise_m = table.need_number("rise_m", -20.0..=20.0)?;
            if from.distance(to) < 1.0 {
                return Err(table.error("to", "expected a place at least 1 m from the other end"));
            }
            table.finish()?;
            self.slopes.push(Slope { from, to, rise_m });
        }
        for mut table in file.tables("ditch")? {
            let path = table.points("path", 2)?.ok_or_else(|| table.error("path", "is missing"))?;
            let half_width_m = 0.5 * table.need_number("width_m", 0.2..=20.0)?;
            let depth_m = table.need_number("depth_m", 0.0..=5.0)?;
            let bank_m = table.number_or("bank_m", 0.1_f64.min(half_width_m), 0.05..=10.0)?;
            table.finish()?;
            self.ditches.push(Ditch { path, half_width_m, depth_m, bank_m });
        }
        for mut table in file.tables("ledge")? {
            let path = table.points("path", 2)?.ok_or_else(|| table.error("path", "is missing"))?;
            let height_m = table.need_number("height_m", 0.0..=5.0)?;
            let run_m = table.number_or("run_m", 0.2, 0.1..=10.0)?;
            let fade_m = table.number_or("fade_m", 10.0, 0.5..=100.0)?;
            table.finish()?;
            self.ledges.push(Ledge { path, height_m, run_m, fade_m });
        }
        Ok(())
    }

    fn read_things(&mut self, file: &mut Table<'_>) -> Result<(), SceneError> {
        let names = ThingKind::ALL.map(ThingKind::name);
        for mut table in file.tables("thing")? {
            let kind = table.need_choice("kind", &names, ThingKind::from_name)?;
            if matches!(kind, ThingKind::Fence | ThingKind::Hedge) {
                return Err(table.error("kind", format!("got {}, expected it as a [[line]]", kind.name())));
            }
            let at = table.need_point("at")?;
            self.within(&table, "at", at)?;
            let yaw_rad = table.number_or("yaw_deg", 0.0, -360.0..=360.0)?.to_radians();
            let size = SizeRange::read(kind, &mut table)?;
            table.finish()?;
            self.placed.push(Placed { kind, size, place: Placement::At { at, yaw_rad } });
        }
        for mut table in file.tables("line")? {
            let only = |name: &str| {
                ThingKind::from_name(name).filter(|kind| matches!(kind, ThingKind::Fence | ThingKind::Hedge))
            };
            let kind = table.need_choice("kind", &["fence", "hedge"], only)?;
            let path = table.points("path", 2)?.ok_or_else(|| table.error("path", "is missing"))?;
            for &point in &path {
                self.within(&table, "path", point)?;
            }
            let size = SizeRange::read(kind, &mut table)?;
            table.finish()?;
            self.placed.push(Placed { kind, size, place: Placement::Along(path) });
        }
        for mut table in file.tables("clear")? {
            self.clear.push(Region::read(&mut table)?);
            table.finish()?;
        }
        for mut table in file.tables("scatter")? {
            let some = |name: &str| {
                ThingKind::from_name(name).filter(|kind| !matches!(kind, ThingKind::Fence | ThingKind::Hedge))
            };
            let kind = table.need_choice("kind", &names, some)?;
            let count = table
                .integer("count", 1..=MAX_SCATTERED)?
                .ok_or_else(|| table.error("count", "is missing, expected a whole number"))?;
            let spacing_m = table.number_or("spacing_m", 1.0, 0.0..=100.0)?;
            let region = Region::read(&mut table)?;
            let size = SizeRange::read(kind, &mut table)?;
            table.finish()?;
            self.placed.push(Placed { kind, size, place: Placement::Scattered { region, count, spacing_m } });
        }
        Ok(())
    }

    fn within(&self, table: &Table<'_>, key: &str, at: DVec2) -> Result<(), SceneError> {
        let [low, high] = self.bounds_m;
        if at.cmpge(low).all() && at.cmple(high).all() {
            return Ok(());
        }
        let message = format!(
            "got [{}, {}], expected a place within the bounds [{}, {}] to [{}, {}]",
            at.x, at.y, low.x, low.y, high.x, high.y
        );
        Err(table.error(key, message))
    }
}

fn read_bounds(file: &mut Table<'_>) -> Result<[DVec2; 2], SceneError> {
    let [low, high] = file.need_two_points("bounds_m")?;
    let size = high - low;
    if size.min_element() < 10.0 || size.max_element() > MAX_SIDE_M {
        let message = format!(
            "got {} m by {} m, expected sides from 10 to {MAX_SIDE_M} m, the lower left corner first",
            size.x, size.y
        );
        return Err(file.error("bounds_m", message));
    }
    Ok([low, high])
}

fn read_origin(file: &mut Table<'_>) -> Result<Utm, SceneError> {
    let Some(mut table) = file.table("origin")? else {
        return Err(
            file.error("origin", "is missing, expected a table with zone, north, easting_m, northing_m")
        );
    };
    let zone = table.integer("zone", 1..=60)?.ok_or_else(|| table.error("zone", "is missing"))?;
    let north = table.flag("north")?.unwrap_or(true);
    let easting_m = table.need_number("easting_m", 1.0e5..=9.0e5)?;
    let northing_m = table.need_number("northing_m", 0.0..=1.0e7)?;
    let origin = Utm::new(zone as u8, north, easting_m, northing_m)
        .and_then(Utm::within_latitudes)
        .map_err(|error| table.error("northing_m", error.to_string()))?;
    table.finish()?;
    Ok(origin)
}

fn read_materials(file: &mut Table<'_>) -> Result<Vec<Material>, SceneError> {
    let mut materials: Vec<Material> = Surface::ALL.into_iter().map(Material::default_of).collect();
    if let Some(mut table) = file.table("surface")? {
        for (surface, material) in Surface::ALL.into_iter().zip(&mut materials) {
            if let Some(changes) = table.table(surface.name())? {
                material.read(changes)?;
            }
        }
        table.finish()?;
    }
    Ok(materials)
}
