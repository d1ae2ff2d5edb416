//! Properties of surfaces: appearance, traction and vegetation.

use crate::class::Surface;
use crate::read::{SceneError, Table};

/// Shape of the specks of which the texture of a surface consists.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Specks {
    /// Number per square metre.
    pub(crate) per_m2: f32,
    /// Length along and across, m.
    pub(crate) length_m: [f32; 2],
    pub(crate) width_m: f32,
    /// Spread of brightness about 1.
    pub(crate) contrast: f32,
}

/// One surface of a world.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Material {
    /// The two colours of its specks, 0 to 255.
    pub(crate) colours: [[f32; 3]; 2],
    pub(crate) specks: Specks,
    /// Greatest horizontal force as a fraction of the load.
    pub(crate) traction: f64,
    /// Rolling resistance as a fraction of the load.
    pub(crate) rolling_resistance: f64,
    /// Height of the vegetation, m.
    pub(crate) height_m: f64,
    /// Probability of a hit per metre of a horizontal ray through the vegetation; 0 for a surface without stems.
    pub(crate) density_per_m: f64,
    /// Slip at which the force of a wheel reaches the limit of traction; a larger one of the vehicle counts.
    pub(crate) slip_at_limit: f64,
    /// Force needed to push through, as a fraction of the vehicle's weight.
    pub(crate) drag: f64,
    /// Whether a vehicle can drive into it; otherwise it stops a vehicle at its edge, like a solid thing.
    pub(crate) passable: bool,
}

/// Size of the cells of stems: a decimetre, with at most one stem per cell.
pub(crate) const STEM_PRESENCE: f64 = 0.85;
/// Greatest density; with more, the stems would not fit into their cells.
const MAX_DENSITY_PER_M: f64 = 6.0;

impl Material {
    /// Default properties of a surface.
    pub(crate) fn default_of(surface: Surface) -> Material {
        let specks = |per_m2: f32, shortest: f32, longest: f32, width_m: f32, contrast: f32| Specks {
            per_m2,
            length_m: [shortest, longest],
            width_m,
            contrast,
        };
        let bare = Material {
            colours: [[132.0, 108.0, 80.0], [150.0, 126.0, 98.0]],
            specks: specks(900.0, 0.01, 0.04, 0.02, 0.3),
            traction: 0.7,
            rolling_resistance: 0.05,
            height_m: 0.0,
            density_per_m: 0.0,
            slip_at_limit: 0.0,
            drag: 0.0,
            passable: true,
        };
        match surface {
            Surface::ShortGrass => Material {
                colours: [[84.0, 112.0, 50.0], [122.0, 134.0, 70.0]],
                specks: specks(1600.0, 0.04, 0.10, 0.012, 0.45),
                traction: 0.75,
                rolling_resistance: 0.06,
                height_m: 0.05,
                ..bare
            },
            Surface::TallGrass => Material {
                colours: [[108.0, 124.0, 58.0], [156.0, 146.0, 84.0]],
                specks: specks(1200.0, 0.06, 0.16, 0.012, 0.5),
                traction: 0.65,
                rolling_resistance: 0.10,
                height_m: 0.65,
                density_per_m: 1.8,
                drag: 0.06,
                ..bare
            },
            Surface::TallWeeds => Material {
                colours: [[72.0, 98.0, 46.0], [118.0, 128.0, 62.0]],
                specks: specks(700.0, 0.06, 0.14, 0.03, 0.5),
                traction: 0.6,
                rolling_resistance: 0.12,
                height_m: 1.3,
                density_per_m: 3.5,
                drag: 0.15,
                ..bare
            },
            Surface::Mulch => Material {
                colours: [[96.0, 60.0, 38.0], [140.0, 94.0, 62.0]],
                specks: specks(900.0, 0.03, 0.10, 0.02, 0.55),
                traction: 0.6,
                rolling_resistance: 0.09,
                ..bare
            },
            Surface::WhiteLime => Material {
                colours: [[188.0, 184.0, 172.0], [216.0, 212.0, 202.0]],
                specks: specks(1500.0, 0.01, 0.03, 0.018, 0.22),
                traction: 0.8,
                rolling_resistance: 0.03,
                ..bare
            },
            Surface::Dirt => bare,
            Surface::Mud => Material {
                colours: [[74.0, 58.0, 42.0], [98.0, 80.0, 60.0]],
                specks: specks(300.0, 0.03, 0.12, 0.05, 0.3),
                traction: 0.25,
                rolling_resistance: 0.14,
                ..bare
            },
            Surface::LeafLitter => Material {
                colours: [[112.0, 78.0, 42.0], [166.0, 122.0, 66.0]],
                specks: specks(700.0, 0.04, 0.09, 0.045, 0.5),
                traction: 0.6,
                rolling_resistance: 0.07,
                ..bare
            },
            Surface::Thicket => Material {
                colours: [[52.0, 62.0, 36.0], [96.0, 92.0, 56.0]],
                specks: specks(700.0, 0.05, 0.12, 0.035, 0.5),
                traction: 0.6,
                rolling_resistance: 0.12,
                height_m: 1.1,
                density_per_m: 4.5,
                passable: false,
                ..bare
            },
        }
    }

    /// Properties that a world file can change.
    pub(crate) fn read(&mut self, mut table: Table<'_>) -> Result<(), SceneError> {
        let mut change = |key, value: &mut f64, range| -> Result<(), SceneError> {
            *value = table.number(key, range)?.unwrap_or(*value);
            Ok(())
        };
        change("traction", &mut self.traction, 0.0..=1.5)?;
        change("rolling_resistance", &mut self.rolling_resistance, 0.0..=1.0)?;
        change("slip_at_limit", &mut self.slip_at_limit, 0.0..=0.95)?;
        change("height_m", &mut self.height_m, 0.0..=3.0)?;
        change("density_per_m", &mut self.density_per_m, 0.0..=MAX_DENSITY_PER_M)?;
        change("drag", &mut self.drag, 0.0..=2.0)?;
        if let Some(passable) = table.flag("passable")? {
            self.passable = passable;
        }
        for (key, colour) in ["colour", "second_colour"].into_iter().zip(&mut self.colours) {
            if let Some(rgb) = table.numbers::<3>(key, 0.0..=255.0)? {
                *colour = rgb.map(|v| v as f32);
            }
        }
        if self.density_per_m > 0.0 && self.height_m == 0.0 {
            return Err(table.error("density_per_m", "got a density, expected height_m above 0 with it"));
        }
        table.finish()
    }

    /// Colour from far away, 0 to 255.
    pub(crate) fn mean_colour(&self) -> [f32; 3] {
        let [a, b] = self.colours;
        [0, 1, 2].map(|c| 0.5 * (a[c] + b[c]))
    }

    /// Whether it has stems that rays can hit one by one.
    pub(crate) fn has_stems(&self) -> bool {
        self.density_per_m > 0.0
    }

    /// Radius of its stems, m: `density = stems per m² · diameter`; `cell_m` is the size of a stem's cell.
    pub(crate) fn stem_radius_m(&self, cell_m: f64) -> f64 {
        0.5 * self.density_per_m * cell_m * cell_m / STEM_PRESENCE
    }
}
