//! Codes of the pixels of obstacle label images.

use serde::{Deserialize, Serialize};

/// Class of a pixel (Albus 2006a, 3.1.1). The codes are those of label images with the palette `obstacle_labels`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[repr(u8)]
pub enum ObstacleLabel {
    /// No range.
    Invalid = 0,
    /// Ground that the vehicle can stand on.
    Ground = 1,
    /// Rises from the ground by more than a short obstacle, in the vehicle's way.
    Obstacle = 2,
    /// Rises from the ground by less than 5 cm.
    ShortObstacle = 3,
    /// 1.5 m or more above the local ground: the vehicle fits under it.
    Cover = 4,
    /// Too far away for a reliable range, or to tell whether it rises by more than a short obstacle.
    TooFar = 5,
}

impl ObstacleLabel {
    /// All labels, in the order of their codes.
    pub const ALL: [Self; 6] =
        [Self::Invalid, Self::Ground, Self::Obstacle, Self::ShortObstacle, Self::Cover, Self::TooFar];

    /// The code in label images.
    pub const fn code(self) -> u8 {
        self as u8
    }

    /// The label of a code.
    pub fn from_code(code: u8) -> Option<Self> {
        Self::ALL.get(usize::from(code)).copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_label_is_the_one_of_its_code() {
        for label in ObstacleLabel::ALL {
            assert_eq!(ObstacleLabel::from_code(label.code()), Some(label));
        }
        assert_eq!(ObstacleLabel::from_code(6), None);
    }
}
