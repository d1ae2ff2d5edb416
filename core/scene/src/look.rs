//! Looks: other colours, light and sky for a world whose ground, vegetation and things stay as they are.
//!
//! ```toml
//! format = 1
//! name = "dry_summer"
//! description = "straw-coloured grass in the evening"
//! texture_seed = 7                # other specks and spots of the same colours
//! [sun]
//! azimuth_deg = 300
//! elevation_deg = 25
//! [light]
//! colour = [1.1, 1.0, 0.85]       # multiplies all colours except those of the sky
//! shade = 0.4                     # light in the shade, as a fraction of that in the sun
//! [sky]
//! zenith = [110, 158, 218]
//! horizon = [206, 220, 234]
//! trees = [66, 82, 62]            # the wood on the horizon
//! [surface.short_grass]
//! colour = [150, 138, 80]
//! second_colour = [176, 162, 104]
//! [coat.bush]                     # a material of things
//! colour = [60, 80, 40]
//! ```
//!
//! Every key but `format` and `name` is optional; what is left out stays as in the world. Colours are 0 to 255.
//! Coats are `bark`, `timber`, `crown`, `bush`, `stone`, `straw`, `plastic` (of fences), `planks`, `roof`, `jacket`,
//! `trousers` and `skin`. A look changes nothing that a vehicle touches and no ground truth.

use crate::class::Surface;
use crate::coat::CoatKind;
use crate::light::Sky;
use crate::read::{SceneError, Table};
use crate::shape::Vec3;
use crate::spec::WorldSpec;

/// A parsed look.
#[derive(Clone, Debug, PartialEq)]
pub struct Look {
    name: String,
    texture_seed: Option<u32>,
    /// Azimuth and elevation, rad.
    sun_rad: [Option<f64>; 2],
    light: Option<Vec3>,
    shade: Option<f32>,
    /// Zenith, horizon, trees.
    sky: [Option<Vec3>; 3],
    surfaces: Vec<(Surface, Pair)>,
    coats: Vec<(CoatKind, Pair)>,
}

/// New values of the two colours of a surface or coat.
type Pair = [Option<Vec3>; 2];

impl Look {
    /// Parses a file. Missing, unknown and out-of-range keys are refused with line and key.
    pub fn from_toml(text: &str) -> Result<Look, SceneError> {
        let mut file = Table::open(text)?;
        file.need_format(1.0)?;
        let name = file.need_text("name")?;
        // For human readers; not used.
        file.text("description")?;
        let texture_seed = file.integer("texture_seed", 0..=u32::MAX)?;
        let mut sun_rad = [None; 2];
        if let Some(mut sun) = file.table("sun")? {
            let azimuth = sun.number("azimuth_deg", -360.0..=360.0)?;
            sun_rad = [azimuth, sun.number("elevation_deg", 10.0..=90.0)?];
            sun.finish()?;
        }
        let (mut light, mut shade) = (None, None);
        if let Some(mut table) = file.table("light")? {
            light = table.numbers::<3>("colour", 0.2..=2.0)?.map(single);
            shade = table.number("shade", 0.1..=0.95)?.map(|shade| shade as f32);
            table.finish()?;
        }
        let mut sky = [None; 3];
        if let Some(mut table) = file.table("sky")? {
            for (key, colour) in ["zenith", "horizon", "trees"].into_iter().zip(&mut sky) {
                *colour = table.numbers::<3>(key, 0.0..=255.0)?.map(single);
            }
            table.finish()?;
        }
        let surfaces = pairs(&mut file, "surface", &Surface::ALL, Surface::name)?;
        let coats = pairs(&mut file, "coat", &CoatKind::ALL, CoatKind::name)?;
        file.finish()?;
        Ok(Look {
            name,
            texture_seed,
            sun_rad: sun_rad.map(|angle| angle.map(f64::to_radians)),
            light,
            shade,
            sky,
            surfaces,
            coats,
        })
    }

    /// Name in the file.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Replaces colours and light of a world.
    pub(crate) fn dress(&self, spec: &mut WorldSpec) {
        spec.texture_seed = self.texture_seed.unwrap_or(spec.texture_seed);
        for (angle, new) in spec.light.sun_rad.iter_mut().zip(self.sun_rad) {
            *angle = new.unwrap_or(*angle);
        }
        spec.light.shade = self.shade.unwrap_or(spec.light.shade);
        let Sky { zenith, horizon, trees } = &mut spec.sky;
        for (colour, new) in [zenith, horizon, trees].into_iter().zip(self.sky) {
            *colour = new.unwrap_or(*colour);
        }
        let replace = |colours: &mut [Vec3; 2], pair: &Pair| {
            for (colour, new) in colours.iter_mut().zip(pair) {
                *colour = new.unwrap_or(*colour);
            }
        };
        for (surface, pair) in &self.surfaces {
            replace(&mut spec.materials[*surface as usize - 1].colours, pair);
        }
        for (kind, pair) in &self.coats {
            replace(&mut spec.coats.0[*kind as usize].colours, pair);
        }
        let Some(light) = self.light else { return };
        let materials = spec.materials.iter_mut().map(|material| &mut material.colours);
        let coats = spec.coats.0.iter_mut().map(|coat| &mut coat.colours);
        for colour in materials.chain(coats).flatten().chain([&mut spec.sky.trees]) {
            for (value, factor) in colour.iter_mut().zip(light) {
                *value = (*value * factor).min(255.0);
            }
        }
    }
}

fn single(numbers: [f64; 3]) -> Vec3 {
    numbers.map(|number| number as f32)
}

/// The colours in the tables of a group, such as `[surface.mud]`.
fn pairs<K: Copy>(
    file: &mut Table<'_>,
    group: &'static str,
    kinds: &[K],
    name: impl Fn(K) -> &'static str,
) -> Result<Vec<(K, Pair)>, SceneError> {
    let mut found = Vec::new();
    let Some(mut table) = file.table(group)? else { return Ok(found) };
    for &kind in kinds {
        let Some(mut entry) = table.table(name(kind))? else { continue };
        let mut pair = [None; 2];
        for (key, colour) in ["colour", "second_colour"].into_iter().zip(&mut pair) {
            *colour = entry.numbers::<3>(key, 0.0..=255.0)?.map(single);
        }
        entry.finish()?;
        found.push((kind, pair));
    }
    table.finish()?;
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    const WORLD: &str = "name = \"p\"\nbounds_m = [[0, 0], [40, 30]]\norigin = { zone = 18, easting_m = 308000, northing_m = 4333000 }\n";
    const SOUND: &str = "format = 1\nname = \"dry\"\ntexture_seed = 9\n[sun]\nazimuth_deg = 90\n[light]\ncolour = [2, 1, 0.5]\nshade = 0.5\n[sky]\ntrees = [10, 20, 30]\n[surface.mud]\ncolour = [10, 20, 200]\n[coat.bush]\nsecond_colour = [1, 2, 3]\n";

    #[test]
    fn a_look_changes_what_it_names_and_the_light_falls_on_all_of_it() {
        let plain = WorldSpec::read(WORLD).unwrap();
        let mut spec = WorldSpec::read(WORLD).unwrap();
        Look::from_toml(SOUND).unwrap().dress(&mut spec);
        assert_eq!((spec.texture_seed, spec.seed), (9, plain.seed));
        assert_eq!(spec.light.sun_rad, [std::f64::consts::FRAC_PI_2, plain.light.sun_rad[1]]);
        assert_eq!(spec.light.shade, 0.5);
        assert_eq!((spec.sky.trees, spec.sky.zenith), ([20.0, 20.0, 15.0], plain.sky.zenith));
        assert_eq!(spec.materials[Surface::Mud as usize - 1].colours[0], [20.0, 20.0, 100.0]);
        assert_eq!(spec.coats.of(CoatKind::Bush).colours[1], [2.0, 2.0, 1.5]);
        let dirt = Surface::Dirt as usize - 1;
        let [r, g, b] = plain.materials[dirt].colours[0];
        assert_eq!(spec.materials[dirt].colours[0], [(2.0 * r).min(255.0), g, 0.5 * b]);
        assert_eq!(spec.materials[dirt].traction, plain.materials[dirt].traction);
    }

    #[test]
    fn mistakes_are_refused_with_their_line_and_key() {
        for (from, to, refusal) in [
            ("format = 1", "format = 2", "line 1, key \"format\": got 2, expected 1"),
            ("name = \"dry\"\n", "", "key \"name\": is missing"),
            ("texture_seed = 9", "texture_seed = 0.5", "line 3, key \"texture_seed\""),
            ("azimuth_deg = 90", "elevation_deg = 5", "line 5, key \"sun.elevation_deg\": got 5"),
            ("colour = [2, 1, 0.5]", "colour = [2, 1]", "line 7, key \"light.colour\": got 2 entries"),
            ("shade = 0.5", "shade = nan", "line 8, key \"light.shade\": got NaN"),
            ("trees", "grass", "line 10, key \"sky.grass\": is unknown"),
            ("[surface.mud]", "[surface.mood]", "key \"surface.mood\": is unknown"),
            ("colour = [10, 20, 200]", "traction = 1", "line 12, key \"surface.mud.traction\": is unknown"),
            ("[1, 2, 3]", "[1, 2, 300]", "line 14, key \"coat.bush.second_colour\": got 300"),
        ] {
            let text = SOUND.replacen(from, to, 1);
            assert_ne!(text, SOUND, "nothing was changed");
            let error = Look::from_toml(&text).unwrap_err().to_string();
            assert!(error.contains(refusal), "got {error:?}, expected {refusal:?}");
        }
    }
}
