//! Appearance of things: the two colours of each material, and its grain.

/// Appearance of a shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Coat {
    /// The two colours of its texture, 0 to 255.
    pub(crate) colours: [[f32; 3]; 2],
    /// Texture cells per metre horizontally and vertically; they differ for wood, which has grain.
    pub(crate) grain: [f32; 2],
}

/// A material of which things are made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub(crate) enum CoatKind {
    Bark,
    Timber,
    Crown,
    Bush,
    Stone,
    Straw,
    Plastic,
    Planks,
    Roof,
    Jacket,
    Trousers,
    Skin,
}

impl CoatKind {
    pub(crate) const ALL: [CoatKind; 12] = [
        CoatKind::Bark,
        CoatKind::Timber,
        CoatKind::Crown,
        CoatKind::Bush,
        CoatKind::Stone,
        CoatKind::Straw,
        CoatKind::Plastic,
        CoatKind::Planks,
        CoatKind::Roof,
        CoatKind::Jacket,
        CoatKind::Trousers,
        CoatKind::Skin,
    ];

    /// The name in files of looks.
    pub(crate) const fn name(self) -> &'static str {
        match self {
            CoatKind::Bark => "bark",
            CoatKind::Timber => "timber",
            CoatKind::Crown => "crown",
            CoatKind::Bush => "bush",
            CoatKind::Stone => "stone",
            CoatKind::Straw => "straw",
            CoatKind::Plastic => "plastic",
            CoatKind::Planks => "planks",
            CoatKind::Roof => "roof",
            CoatKind::Jacket => "jacket",
            CoatKind::Trousers => "trousers",
            CoatKind::Skin => "skin",
        }
    }

    const fn usual(self) -> Coat {
        let (colours, grain) = match self {
            CoatKind::Bark => ([[70.0, 58.0, 48.0], [118.0, 104.0, 90.0]], [60.0, 14.0]),
            CoatKind::Timber => ([[120.0, 96.0, 68.0], [168.0, 140.0, 104.0]], [60.0, 6.0]),
            CoatKind::Crown => ([[40.0, 66.0, 30.0], [98.0, 118.0, 56.0]], [50.0, 50.0]),
            CoatKind::Bush => ([[46.0, 72.0, 36.0], [108.0, 122.0, 62.0]], [50.0, 50.0]),
            CoatKind::Stone => ([[98.0, 96.0, 92.0], [164.0, 160.0, 152.0]], [50.0, 50.0]),
            CoatKind::Straw => ([[164.0, 138.0, 78.0], [212.0, 188.0, 122.0]], [18.0, 90.0]),
            CoatKind::Plastic => ([[236.0, 88.0, 24.0], [250.0, 112.0, 40.0]], [20.0, 20.0]),
            CoatKind::Planks => ([[198.0, 194.0, 184.0], [224.0, 220.0, 210.0]], [40.0, 3.0]),
            CoatKind::Roof => ([[96.0, 74.0, 66.0], [130.0, 104.0, 92.0]], [30.0, 30.0]),
            CoatKind::Jacket => ([[40.0, 52.0, 96.0], [62.0, 76.0, 124.0]], [40.0, 40.0]),
            CoatKind::Trousers => ([[52.0, 50.0, 48.0], [78.0, 74.0, 70.0]], [40.0, 40.0]),
            CoatKind::Skin => ([[172.0, 128.0, 104.0], [204.0, 160.0, 134.0]], [30.0, 30.0]),
        };
        Coat { colours, grain }
    }
}

/// The coats of a world, one of each kind.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Coats(pub(crate) [Coat; CoatKind::ALL.len()]);

impl Default for Coats {
    fn default() -> Coats {
        Coats(CoatKind::ALL.map(CoatKind::usual))
    }
}

impl Coats {
    pub(crate) fn of(&self, kind: CoatKind) -> Coat {
        self.0[kind as usize]
    }
}
