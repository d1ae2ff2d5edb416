//! Codes of what a ray can hit, and the obstacle label that the ground truth assigns to it.

use serde::{Deserialize, Serialize};

/// The surface of the ground.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[repr(u8)]
pub enum Surface {
    /// A mown meadow.
    ShortGrass = 1,
    /// Hip-high grass that a vehicle can push aside.
    TallGrass = 2,
    /// Dense weeds that hide objects in them.
    TallWeeds = 3,
    /// Bark mulch of a path.
    Mulch = 4,
    /// Crushed white lime of a path.
    WhiteLime = 5,
    /// Bare soil.
    Dirt = 6,
    /// Wet soil with little traction.
    Mud = 7,
    /// Fallen leaves under trees.
    LeafLitter = 8,
    /// Brambles and saplings: woody growth that stops a vehicle.
    Thicket = 9,
}

impl Surface {
    /// All surfaces, in the order of their codes.
    pub const ALL: [Surface; 9] = [
        Surface::ShortGrass,
        Surface::TallGrass,
        Surface::TallWeeds,
        Surface::Mulch,
        Surface::WhiteLime,
        Surface::Dirt,
        Surface::Mud,
        Surface::LeafLitter,
        Surface::Thicket,
    ];

    /// The name in world files.
    pub const fn name(self) -> &'static str {
        match self {
            Surface::ShortGrass => "short_grass",
            Surface::TallGrass => "tall_grass",
            Surface::TallWeeds => "tall_weeds",
            Surface::Mulch => "mulch",
            Surface::WhiteLime => "white_lime",
            Surface::Dirt => "dirt",
            Surface::Mud => "mud",
            Surface::LeafLitter => "leaf_litter",
            Surface::Thicket => "thicket",
        }
    }

    /// The surface with this name.
    pub fn from_name(name: &str) -> Option<Surface> {
        Surface::ALL.into_iter().find(|surface| surface.name() == name)
    }

    /// The surface with this code; short grass for unknown codes.
    pub(crate) const fn from_code(code: u8) -> Surface {
        match code {
            2 => Surface::TallGrass,
            3 => Surface::TallWeeds,
            4 => Surface::Mulch,
            5 => Surface::WhiteLime,
            6 => Surface::Dirt,
            7 => Surface::Mud,
            8 => Surface::LeafLitter,
            9 => Surface::Thicket,
            _ => Surface::ShortGrass,
        }
    }

    /// The class of a hit on this surface, or on vegetation that grows on it.
    pub const fn class(self) -> Class {
        match self {
            Surface::ShortGrass => Class::ShortGrass,
            Surface::TallGrass => Class::TallGrass,
            Surface::TallWeeds => Class::TallWeeds,
            Surface::Mulch => Class::Mulch,
            Surface::WhiteLime => Class::WhiteLime,
            Surface::Dirt => Class::Dirt,
            Surface::Mud => Class::Mud,
            Surface::LeafLitter => Class::LeafLitter,
            Surface::Thicket => Class::Thicket,
        }
    }
}

/// A kind of thing, which is an object that stands on the ground.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[repr(u8)]
pub enum ThingKind {
    /// A trunk with a crown; the trunk alone is solid.
    Tree,
    /// Foliage down to the ground around a solid woody core.
    Bush,
    /// A row of bushes.
    Hedge,
    /// A stone: the upper half of an ellipsoid.
    Boulder,
    /// A trunk that lies on the ground.
    Log,
    /// A square bale.
    HayBale,
    /// An upright post.
    Post,
    /// Orange plastic mesh that sensors see through and vehicles cannot pass.
    Fence,
    /// A hut with a roof.
    Shed,
    /// A standing person.
    Person,
}

impl ThingKind {
    /// All kinds.
    pub const ALL: [ThingKind; 10] = [
        ThingKind::Tree,
        ThingKind::Bush,
        ThingKind::Hedge,
        ThingKind::Boulder,
        ThingKind::Log,
        ThingKind::HayBale,
        ThingKind::Post,
        ThingKind::Fence,
        ThingKind::Shed,
        ThingKind::Person,
    ];

    /// The name in world files and ground truth messages.
    pub const fn name(self) -> &'static str {
        match self {
            ThingKind::Tree => "tree",
            ThingKind::Bush => "bush",
            ThingKind::Hedge => "hedge",
            ThingKind::Boulder => "boulder",
            ThingKind::Log => "log",
            ThingKind::HayBale => "hay_bale",
            ThingKind::Post => "post",
            ThingKind::Fence => "fence",
            ThingKind::Shed => "shed",
            ThingKind::Person => "person",
        }
    }

    /// The class of a hit on it; for a tree, of its trunk.
    pub const fn class(self) -> Class {
        match self {
            ThingKind::Tree => Class::Trunk,
            ThingKind::Bush | ThingKind::Hedge => Class::Bush,
            ThingKind::Boulder => Class::Boulder,
            ThingKind::Log => Class::Log,
            ThingKind::HayBale => Class::HayBale,
            ThingKind::Post => Class::Post,
            ThingKind::Fence => Class::Fence,
            ThingKind::Shed => Class::Shed,
            ThingKind::Person => Class::Person,
        }
    }

    /// The kind with this name.
    pub fn from_name(name: &str) -> Option<ThingKind> {
        ThingKind::ALL.into_iter().find(|kind| kind.name() == name)
    }
}

/// The class of a ray's hit. The codes are those of class images and of the class field of ground truth maps.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[repr(u8)]
pub enum Class {
    /// No hit within range.
    Sky = 0,
    /// [`Surface::ShortGrass`].
    ShortGrass = 1,
    /// [`Surface::TallGrass`]: the ground or a stem.
    TallGrass = 2,
    /// [`Surface::TallWeeds`]: the ground or a stem.
    TallWeeds = 3,
    /// [`Surface::Mulch`].
    Mulch = 4,
    /// [`Surface::WhiteLime`].
    WhiteLime = 5,
    /// [`Surface::Dirt`].
    Dirt = 6,
    /// [`Surface::Mud`].
    Mud = 7,
    /// [`Surface::LeafLitter`].
    LeafLitter = 8,
    /// [`Surface::Thicket`]: the ground or a stem.
    Thicket = 9,
    /// The trunk of a tree.
    Trunk = 16,
    /// The crown of a tree.
    Crown = 17,
    /// A bush or a hedge.
    Bush = 18,
    /// A boulder.
    Boulder = 19,
    /// A log.
    Log = 20,
    /// A hay bale.
    HayBale = 21,
    /// A post.
    Post = 22,
    /// The orange fence.
    Fence = 23,
    /// A shed.
    Shed = 24,
    /// A person.
    Person = 25,
}

impl Class {
    /// All classes, in the order of their codes.
    pub const ALL: [Class; 20] = [
        Class::Sky,
        Class::ShortGrass,
        Class::TallGrass,
        Class::TallWeeds,
        Class::Mulch,
        Class::WhiteLime,
        Class::Dirt,
        Class::Mud,
        Class::LeafLitter,
        Class::Thicket,
        Class::Trunk,
        Class::Crown,
        Class::Bush,
        Class::Boulder,
        Class::Log,
        Class::HayBale,
        Class::Post,
        Class::Fence,
        Class::Shed,
        Class::Person,
    ];

    /// The name in words, for legends.
    pub const fn name(self) -> &'static str {
        match self {
            Class::Sky => "sky",
            Class::ShortGrass => "short_grass",
            Class::TallGrass => "tall_grass",
            Class::TallWeeds => "tall_weeds",
            Class::Mulch => "mulch",
            Class::WhiteLime => "white_lime",
            Class::Dirt => "dirt",
            Class::Mud => "mud",
            Class::LeafLitter => "leaf_litter",
            Class::Thicket => "thicket",
            Class::Trunk => "trunk",
            Class::Crown => "crown",
            Class::Bush => "bush",
            Class::Boulder => "boulder",
            Class::Log => "log",
            Class::HayBale => "hay_bale",
            Class::Post => "post",
            Class::Fence => "fence",
            Class::Shed => "shed",
            Class::Person => "person",
        }
    }

    /// The class with this code.
    pub fn from_code(code: u8) -> Option<Class> {
        Class::ALL.into_iter().find(|class| class.code() == code)
    }

    /// The code in images and maps.
    pub const fn code(self) -> u8 {
        self as u8
    }

    /// Whether it is a surface or vegetation on one.
    pub const fn is_surface(self) -> bool {
        let code = self as u8;
        code >= 1 && code <= Surface::ALL.len() as u8
    }
}

/// Obstacle labels with the codes of the palette `obstacle_labels` (Albus 2006a, 3.1.1).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[repr(u8)]
pub enum Label {
    /// The sky, which has no range.
    Invalid = 0,
    /// Drivable, including vegetation that gives way.
    Ground = 1,
    /// Stops a vehicle: things, vegetation that does not give way, and slopes steeper than 45°.
    Obstacle = 2,
    /// A thing that is less than [`SHORT_M`] high.
    Short = 3,
    /// At least [`COVER_M`] above the ground below: a vehicle can pass under it.
    Cover = 4,
}

impl Label {
    /// The code in label images.
    pub const fn code(self) -> u8 {
        self as u8
    }
}

/// Things lower than this are [`Label::Short`], m (Albus 2006a, 3.1.1).
pub const SHORT_M: f64 = 0.05;
/// From this height above the ground on, a hit is [`Label::Cover`], m (Albus 2006a, 3.1.1).
pub const COVER_M: f64 = 1.5;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_and_names_are_each_ones_own() {
        for (at, class) in Class::ALL.into_iter().enumerate() {
            assert_eq!(Class::from_code(class.code()), Some(class));
            assert!(Class::ALL[at + 1..].iter().all(|other| other.name() != class.name()));
        }
        for surface in Surface::ALL {
            assert_eq!(Surface::from_name(surface.name()), Some(surface));
            assert_eq!(surface.class().code(), surface as u8);
            assert_eq!(Surface::from_code(surface as u8), surface);
        }
        for kind in ThingKind::ALL {
            assert_eq!(ThingKind::from_name(kind.name()), Some(kind));
        }
    }
}
