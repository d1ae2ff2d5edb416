//! Appearance of a world: light, shadows and colours computed at load, and the colour of each hit.

use crate::class::Surface;
use crate::heightfield::{FieldHit, HeightField};
use crate::light::{Light, SHADE, Sky};
use crate::noise::{add_noise, hash2, unit};
use crate::shape::{Shape, Vec3, between, unit_length};
use crate::spec::WorldSpec;
use crate::surface::Material;
use crate::terrain::{CELL_M, Lattice};
use crate::texture::{ONE, TEXEL_M, Texture, channels, detail, level_of, packed, rough};

/// Increase of the light in the shade when a cloud hides the sun: the cloud scatters part of it.
const CLOUD_SHADE: f32 = 0.25;
/// Spacing of the points of the outline of the distant trees.
const SKYLINE: usize = 2048;
/// Light on a leaf by its direction to the sun, in a world without a look.
const LEAF_DIRECT: f32 = 0.35;
const CELL: f32 = CELL_M as f32;

/// Data that only colours need.
pub(crate) struct Looks {
    /// By sample of the lattice: mean colour with light, and the light alone in the last channel.
    ground: Texture,
    /// By surface code; for the surfaces of the world.
    details: Vec<Option<Texture>>,
    rough: Texture,
    /// By surface code: two colours of stems.
    stems: [[Vec3; 2]; 16],
    sun: Vec3,
    /// Light in the shade as a fraction of that on sunlit level ground.
    shade: f32,
    /// Light on a face toward the sun, in addition to that in the shade.
    direct: f32,
    /// The same on leaves, which let light through.
    leaf_direct: f32,
    sky: Sky,
    plain: Vec3,
    /// Slope of the view to the tops of the distant trees, around the horizon.
    skyline: Vec<f32>,
    seed: u32,
}

/// A point on a ray, and the extent of its pixel there.
pub(crate) struct Seen {
    pub(crate) at: Vec3,
    pub(crate) direction: Vec3,
    /// Width of the pixel, m.
    pub(crate) footprint_m: f32,
    /// Share of the sun's light that the clouds let through: 1 under a clear sky.
    pub(crate) sunlight: f32,
}

impl Looks {
    pub(crate) fn build(spec: &WorldSpec, lattice: &Lattice, shapes: &[Shape]) -> Looks {
        let Light { sun_rad: [azimuth, elevation], shade } = spec.light;
        let seed = spec.texture_seed;
        let flat = libm::cos(elevation);
        let sun =
            [flat * libm::cos(azimuth), flat * libm::sin(azimuth), libm::sin(elevation)].map(|v| v as f32);
        let direct = (1.0 - shade) / sun[2];
        let lit = shadows(lattice, shapes, sun);
        let ground = bake(spec, lattice, &lit, sun, direct);
        let mut present = [false; 16];
        for &code in &lattice.surface {
            present[usize::from(code & 15)] = true;
        }
        let mut details: Vec<Option<Texture>> = (0..16).map(|_| None).collect();
        let mut stems = [[[0.0; 3]; 2]; 16];
        for (surface, material) in Surface::ALL.into_iter().zip(&spec.materials) {
            let code = surface as usize;
            stems[code] = material.colours;
            if present[code] {
                details[code] = Some(detail(material, seed ^ code as u32));
            }
        }
        let mut skyline = vec![0.02_f32; SKYLINE];
        for (wavelength, amplitude) in [(190.0, 0.016), (60.0, 0.010), (14.0, 0.008), (5.0, 0.005)] {
            add_noise(&mut skyline, SKYLINE, wavelength, amplitude, seed ^ 0x51C7);
        }
        let plain = spec.materials[spec.base as usize - 1].mean_colour();
        Looks {
            ground,
            details,
            rough: rough(seed),
            stems,
            sun,
            shade,
            direct,
            leaf_direct: LEAF_DIRECT * ((1.0 - shade) / (1.0 - SHADE)),
            sky: spec.sky,
            plain,
            skyline,
            seed,
        }
    }

    /// Colour of the ground or of a stem, 0 to 255.
    #[inline]
    pub(crate) fn field(&self, field: &HeightField, hit: &FieldHit, seen: &Seen) -> Vec3 {
        if hit.stem >= 0.0 { self.stem(field, hit, seen) } else { self.soil(field, hit, seen) }
    }

    #[inline]
    fn soil(&self, field: &HeightField, hit: &FieldHit, seen: &Seen) -> Vec3 {
        // A pixel covers a strip of ground that is longer than wide. Its texels have the area of the strip, but at most
        // four times its width: larger ones would blur the detail that stereo needs.
        let longer = (1.0 / seen.direction[2].abs().max(1e-3)).min(16.0);
        let footprint2 = seen.footprint_m * seen.footprint_m * longer;
        let [u, v] = [seen.at[0] * (1.0 / CELL), seen.at[1] * (1.0 / CELL)];
        let [r, g, b, light] = channels(self.ground.clamped(level_of(footprint2, CELL * CELL), u, v));
        let [r, g, b] = if seen.sunlight < 1.0 {
            let dimmed = self.dimmed(light, seen.sunlight) / light.max(1.0);
            [r * dimmed, g * dimmed, b * dimmed]
        } else {
            [r, g, b]
        };
        let level = level_of(footprint2, TEXEL_M * TEXEL_M);
        if level > 3 {
            return [r, g, b];
        }
        let surface =
            self.speckled_surface(&field.lattice, [hit.cell[0] as usize, hit.cell[1] as usize], [u, v]);
        let Some(detail) = &self.details[usize::from(surface & 15)] else { return [r, g, b] };
        let ratio =
            channels(detail.wrapped(level, seen.at[0] * (1.0 / TEXEL_M), seen.at[1] * (1.0 / TEXEL_M)));
        [r * ratio[0] * (1.0 / ONE), g * ratio[1] * (1.0 / ONE), b * ratio[2] * (1.0 / ONE)]
    }

    /// The surface at a position; borders between surfaces are irregular by a few centimetres.
    #[inline]
    fn speckled_surface(&self, lattice: &Lattice, cell: [usize; 2], [u, v]: [f32; 2]) -> u8 {
        let at = cell[1] * lattice.width + cell[0];
        let (low, high) =
            (&lattice.surface[at..at + 2], &lattice.surface[at + lattice.width..at + lattice.width + 2]);
        let four = [low[0], low[1], high[0], high[1]];
        if four == [four[0]; 4] {
            return four[0];
        }
        let h = hash2((u * 4.0) as i32, (v * 4.0) as i32, self.seed);
        let shift = [unit(h) - 0.5, unit(h.wrapping_mul(0x9E37_79B1)) - 0.5];
        let right = usize::from(u - cell[0] as f32 + 0.7 * shift[0] >= 0.5);
        let up = usize::from(v - cell[1] as f32 + 0.7 * shift[1] >= 0.5);
        four[2 * up + right]
    }

    #[inline]
    fn stem(&self, field: &HeightField, hit: &FieldHit, seen: &Seen) -> Vec3 {
        let at = hit.cell[1] as usize * field.lattice.width + hit.cell[0] as usize;
        let [a, b] = &self.stems[usize::from(field.lattice.surface[at] & 15)];
        let light = channels(self.ground.clamped(0, hit.cell[0] as f32, hit.cell[1] as f32))[3];
        let light = if seen.sunlight < 1.0 { self.dimmed(light, seen.sunlight) } else { light } * (1.0 / ONE);
        let h = hash2(hit.cell[0] as i32, hit.cell[1] as i32, self.seed ^ 0x57E3);
        // Leaves along the stem, a few centimetres each.
        let leaf = hash2(h as i32, ((seen.at[2] + 64.0) * 28.0) as i32, self.seed);
        // Stems narrower than a pixel have their mean colour.
        let clear = (0.03 / seen.footprint_m).min(1.0);
        let part = 0.5 + clear * (0.6 * unit(h) + 0.4 * unit(leaf) - 0.5);
        let mut speck = 1.0
            + clear
                * (0.5 * unit(h.wrapping_mul(0x9E37_79B1)) + 0.4 * unit(leaf.wrapping_mul(0x9E37_79B1))
                    - 0.45);
        if seen.footprint_m < 0.006 {
            // At close range, ribs and spots of a few millimetres.
            let side = (seen.at[0] + seen.at[1]) * 500.0 + unit(leaf) * 256.0;
            let rib = channels(self.rough.wrapped(0, side, (seen.at[2] + 64.0) * 160.0))[0];
            speck *= 1.0 + (rib - 128.0) * (0.7 / ONE);
        }
        // Light comes from above, and one side of the stem is brighter than the other.
        let to_stem =
            [seen.at[0] * (1.0 / CELL) - hit.cell[0] as f32, seen.at[1] * (1.0 / CELL) - hit.cell[1] as f32];
        let sunny = self.sun[0] * (to_stem[0] - 0.5) + self.sun[1] * (to_stem[1] - 0.5);
        let brightness = light * (0.55 + 0.55 * hit.stem + 0.3 * sunny) * speck;
        between(a, b, part, brightness)
    }

    /// Light in the shade when the clouds let this share of the sun's light through.
    #[inline]
    fn shaded(&self, sunlight: f32) -> f32 {
        self.shade * (1.0 + CLOUD_SHADE * (1.0 - sunlight))
    }

    /// Light on the ground, where [`ONE`] means 1, when the clouds let this share of the sun's light through.
    #[inline]
    fn dimmed(&self, light: f32, sunlight: f32) -> f32 {
        let shade = light.min(self.shade * ONE);
        shade * (1.0 + CLOUD_SHADE * (1.0 - sunlight)) + (light - shade) * sunlight
    }

    /// Colour of the plain beyond the world.
    pub(crate) fn plain(&self, seen: &Seen) -> Vec3 {
        let coarse = self.rough.wrapped(0, seen.at[0] * 0.5 + 4096.0, seen.at[1] * 0.5 + 4096.0);
        let fine = self.rough.wrapped(0, seen.at[0] * 4.0 + 4096.0, seen.at[1] * 4.0 + 4096.0);
        let brightness = 0.6 + (channels(coarse)[0] + channels(fine)[0]) * (0.2 / ONE);
        let light = self.shaded(seen.sunlight) + (1.0 - self.shade) * seen.sunlight;
        self.plain.map(|v| v * brightness * light)
    }

    /// Colour of a thing.
    #[inline]
    pub(crate) fn shape(&self, shape: &Shape, seen: &Seen) -> Vec3 {
        let normal = shape.normal(seen.at, seen.direction);
        let facing = normal[0] * self.sun[0] + normal[1] * self.sun[1] + normal[2] * self.sun[2];
        let [a, b] = &shape.coat.colours;
        if shape.leaf_m > 0.0 {
            let h = shape.leaf_hash(seen.at);
            let clear = (1.5 * shape.leaf_m / seen.footprint_m).min(1.0);
            let part = 0.5 + clear * (unit(h.wrapping_mul(0x9E37_79B1)) - 0.5);
            let fine = self.grey(shape, normal, seen);
            let brightness = (self.shaded(seen.sunlight) + self.leaf_direct * seen.sunlight * (1.0 + facing))
                * (0.75 + clear * 0.4 * (unit(h.wrapping_mul(0x85EB_CA77)) - 0.5) + 0.35 * fine);
            return between(a, b, part, brightness);
        }
        let grey = self.grey(shape, normal, seen);
        // Faces that point upwards get more light from the sky.
        let light = self.shaded(seen.sunlight) * (0.8 + 0.2 * normal[2])
            + self.direct * seen.sunlight * facing.max(0.0);
        let light = light.min(1.25);
        between(a, b, grey, light)
    }

    /// Grey noise from 0 to 1 on the side of a shape with this normal.
    #[inline]
    fn grey(&self, shape: &Shape, normal: Vec3, seen: &Seen) -> f32 {
        let [x, y, z] = seen.at;
        let [across, up] = shape.coat.grain;
        let side = if normal[0].abs() > normal[1].abs() { y } else { x };
        let [u, v] =
            if normal[2].abs() > 0.8 { [x * across, y * across] } else { [side * across, (z + 64.0) * up] };
        let texel = 1.0 / across.max(up);
        let level = level_of(seen.footprint_m * seen.footprint_m, texel * texel);
        let value = channels(self.rough.wrapped(level, u.max(0.0), v))[0];
        ((value - 48.0) * (1.0 / 160.0)).clamp(0.0, 1.0)
    }

    /// Colour of a ray that leaves the world: distant trees, or the sky above them.
    pub(crate) fn sky(&self, direction: Vec3) -> Vec3 {
        let [x, y, z] = direction;
        // The angle around the horizon as a fraction of a diamond's outline, which needs no arc tangent.
        let share = y / (x.abs() + y.abs()).max(1e-6);
        let corner = if x >= 0.0 { 1.0 + share } else { 3.0 - share };
        let around = corner * (SKYLINE as f32 / 4.0);
        let place = (around as usize).min(SKYLINE - 1);
        if z < self.skyline[place] {
            let h = hash2((around * 0.5) as i32, (z * 300.0 + 600.0) as i32, self.seed);
            let brightness = 0.8 + 0.4 * unit(h);
            return self.sky.trees.map(|v| v * brightness);
        }
        let high = z.clamp(0.0, 1.0);
        let bow = 1.0 - (1.0 - high) * (1.0 - high);
        let plane = 40.0 / (high + 0.12);
        let cloud = channels(self.rough.wrapped(0, x * plane + 512.0, y * plane + 512.0))[0] - 120.0;
        let white = (cloud * (1.0 / 90.0)).clamp(0.0, 0.6) * (high * 4.0).min(1.0);
        let Sky { zenith, horizon, .. } = &self.sky;
        let blue = [0, 1, 2].map(|c| horizon[c] + (zenith[c] - horizon[c]) * bow);
        blue.map(|v| v + (246.0 - v) * white)
    }

    /// Haze: the effect of distance on a colour.
    #[inline]
    pub(crate) fn hazed(colour: Vec3, range_m: f32) -> Vec3 {
        let part = (range_m * (1.0 / 500.0)).min(0.45);
        let far = [170.0, 184.0, 190.0];
        between(&colour, &far, part, 1.0)
    }
}

/// Fraction of the sun's light that passes the things and reaches each sample, 0 to 1, blurred by a decimetre.
fn shadows(lattice: &Lattice, shapes: &[Shape], sun: Vec3) -> Vec<f32> {
    let mut lit = vec![1.0_f32; lattice.z.len()];
    for shape in shapes {
        let [x, y, z] = shape.middle;
        let reach = shape.half_extent();
        let heights = [z - shape.half[2] - shape.ground_m, z + shape.half[2] - shape.ground_m + 0.5];
        let shift = heights.map(|height| [sun[0], sun[1]].map(|s| height.max(-0.5) * s / sun[2]));
        let index = |value: f32, most: usize| ((value / CELL).max(0.0) as usize).min(most);
        let span = |axis: usize, middle: f32| {
            let ends = [middle - shift[0][axis], middle - shift[1][axis]];
            let (low, high) = (ends[0].min(ends[1]) - reach[axis], ends[0].max(ends[1]) + reach[axis]);
            index(low, lattice.cells[axis])..=index(high + CELL, lattice.cells[axis])
        };
        let columns = span(0, x);
        for row in span(1, y) {
            for column in columns.clone() {
                let at = row * lattice.width + column;
                let from = [column as f32 * CELL, row as f32 * CELL, lattice.z[at] + 0.02];
                if lit[at] > 0.0 && shape.meet(from, sun, 200.0).is_some() {
                    lit[at] = 0.0;
                }
            }
        }
    }
    soften(&mut lit, lattice.width);
    lit
}

fn soften(values: &mut [f32], width: usize) {
    let mut before = vec![0.0; width];
    for row in values.chunks_exact_mut(width) {
        before.copy_from_slice(row);
        for (at, triple) in before.windows(3).enumerate() {
            row[at + 1] = (triple[0] + triple[1] + triple[2]) * (1.0 / 3.0);
        }
    }
    // By columns; the previous two rows are kept, so that nothing is read after it has changed.
    let rows = values.len() / width;
    let mut last = values[..width].to_vec();
    for row in 1..rows.saturating_sub(1) {
        for (column, before) in last.iter_mut().enumerate() {
            let at = row * width + column;
            let here = values[at];
            values[at] = (*before + here + values[at + width]) * (1.0 / 3.0);
            *before = here;
        }
    }
}

/// Mean colour with light of every sample.
fn bake(spec: &WorldSpec, lattice: &Lattice, lit: &[f32], sun: Vec3, direct: f32) -> Texture {
    let (width, shade) = (lattice.width, spec.light.shade);
    let mut tint = vec![1.0_f32; lattice.z.len()];
    // Metres; all scales down to that of the samples, so that distant ground still has texture.
    for (wavelength, amplitude) in [(11.0, 0.10), (3.7, 0.09), (1.3, 0.08), (0.5, 0.08), (0.22, 0.07)] {
        let seed = hash2((wavelength * 10.0) as i32, 0x71, spec.texture_seed);
        add_noise(&mut tint, width, wavelength / CELL, amplitude, seed);
    }
    let mut hue = vec![0.0_f32; lattice.z.len()];
    add_noise(&mut hue, width, 5.0 / CELL, 0.05, spec.texture_seed ^ 0x40E);
    add_noise(&mut hue, width, 0.8 / CELL, 0.03, spec.texture_seed ^ 0x40F);
    let colours: Vec<Vec3> = spec.materials.iter().map(Material::mean_colour).collect();
    let rows = lattice.z.len() / width;
    let mut texels = Vec::with_capacity(lattice.z.len());
    for row in 0..rows {
        let (below, above) = (row.saturating_sub(1) * width, (row + 1).min(rows - 1) * width);
        for column in 0..width {
            let at = row * width + column;
            let (left, right) = (column.saturating_sub(1), (column + 1).min(width - 1));
            let slope = [
                lattice.z[row * width + right] - lattice.z[row * width + left],
                lattice.z[above + column] - lattice.z[below + column],
            ];
            let normal = unit_length([-slope[0], -slope[1], 2.0 * CELL]);
            let facing = normal[0] * sun[0] + normal[1] * sun[1] + normal[2] * sun[2];
            let light = shade * (0.4 + 0.6 * normal[2]) + direct * facing.max(0.0) * lit[at];
            let [r, g, b] = colours[usize::from(lattice.surface[at]).clamp(1, Surface::ALL.len()) - 1];
            let (bright, hue) = (light * tint[at], hue[at]);
            texels.push(packed([
                r * bright * (1.0 + hue),
                g * bright,
                b * bright * (1.0 - hue),
                light * ONE,
            ]));
        }
    }
    Texture::new(width, texels)
}
