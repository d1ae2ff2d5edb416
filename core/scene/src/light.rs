//! Light and sky of a world.

/// Light of a world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Light {
    /// Azimuth of the sun counter-clockwise from east, and its elevation, rad.
    pub(crate) sun_rad: [f64; 2],
    /// Light in the shade as a fraction of that on sunlit level ground.
    pub(crate) shade: f32,
}

/// Colours of the sky, 0 to 255.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Sky {
    pub(crate) zenith: [f32; 3],
    pub(crate) horizon: [f32; 3],
    /// The distant trees.
    pub(crate) trees: [f32; 3],
}

/// Light in the shade of a world without a look.
pub(crate) const SHADE: f32 = 0.42;

impl Default for Sky {
    fn default() -> Sky {
        Sky { zenith: [110.0, 158.0, 218.0], horizon: [206.0, 220.0, 234.0], trees: [66.0, 82.0, 62.0] }
    }
}
