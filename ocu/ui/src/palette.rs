//! Colours of labels, costs, heights and ranges.
//!
//! Costs range from 0 to 250; 255 is unknown. The map colours of the papers are red, yellow, blue, light blue and green
//! from high to low cost, and black for unknown; the even palette is suitable for colour-blind people.

use egui::Color32;
use std::sync::{Arc, LazyLock};

const fn rgb(hex: u32) -> Color32 {
    Color32::from_rgb((hex >> 16) as u8, (hex >> 8) as u8, hex as u8)
}

/// One class of a label image.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Label {
    /// Pixel value.
    pub value: u8,
    /// Displayed name.
    pub name: String,
    /// Its colour.
    pub color: Color32,
}

/// The classes of a label image, from the metadata of its channel. Without metadata, values from 1 on are distinguished
/// by colour only.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Classes(Arc<[Label]>);

impl FromIterator<Label> for Classes {
    fn from_iter<I: IntoIterator<Item = Label>>(labels: I) -> Classes {
        Classes(labels.into_iter().collect())
    }
}

impl Classes {
    /// Colour of a class; transparent where unknown.
    pub fn color(&self, value: u8) -> Color32 {
        if !self.0.is_empty() {
            return self.label(value).map_or(Color32::TRANSPARENT, |label| label.color);
        }
        match value {
            0 => Color32::TRANSPARENT,
            value => NUMBERED[usize::from(value - 1) % NUMBERED.len()],
        }
    }

    /// Name of a class.
    pub fn name(&self, value: u8) -> String {
        match self.label(value) {
            Some(label) => label.name.clone(),
            None if !self.0.is_empty() => "not known".to_owned(),
            None => format!("class {value}"),
        }
    }

    fn label(&self, value: u8) -> Option<&Label> {
        self.0.iter().find(|label| label.value == value)
    }

    /// The classes for a legend; empty where they have no names.
    pub fn legend(&self) -> &[Label] {
        &self.0
    }
}

/// Twelve distinguishable colours for classes without names.
const NUMBERED: [Color32; 12] = [
    rgb(0x4c_a64c),
    rgb(0xe6_9f00),
    rgb(0x56_b4e9),
    rgb(0xd5_5e5e),
    rgb(0xf0_e442),
    rgb(0x9c_5fd6),
    rgb(0x2f_c7b0),
    rgb(0xe4_87bd),
    rgb(0x3f_6fd8),
    rgb(0xa8_7848),
    rgb(0xb8_c4ca),
    rgb(0x7a_8a2a),
];

/// How maps are coloured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MapPalette {
    /// The five colours of the papers, 50 costs each.
    #[default]
    Papers,
    /// Perceptually even, from dark blue to yellow; suitable for colour-blind people.
    Even,
}

/// The five colours of the papers from low to high cost, and the highest cost of each.
pub const PAPERS_COST: [(u8, Color32); 5] = [
    (50, rgb(0x1f_a83c)),
    (100, rgb(0x7c_c8f2)),
    (150, rgb(0x1f_52c9)),
    (200, rgb(0xf2_d21b)),
    (250, rgb(0xd9_2a21)),
];

/// Cost of an unknown cell.
pub const UNKNOWN_COST: u8 = 255;

impl MapPalette {
    /// Colour of a cost; 251 to 255 are unknown.
    pub fn cost(self, cost: u8) -> Color32 {
        match self {
            _ if cost > 250 => self.unknown(),
            Self::Papers => PAPERS_COST[usize::from(cost.saturating_sub(1) / 50)].1,
            Self::Even => CIVIDIS[usize::from(cost) * 255 / 250],
        }
    }

    /// Colour of an unknown cell.
    pub fn unknown(self) -> Color32 {
        Color32::BLACK
    }

    /// Displayed name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Papers => "papers' colours",
            Self::Even => "even colours",
        }
    }
}

/// Viridis, a perceptually even scale, for `fraction` from 0 to 1 (clamped; NaN is transparent).
pub fn even(fraction: f64) -> Color32 {
    if fraction.is_nan() {
        return Color32::TRANSPARENT;
    }
    VIRIDIS[(fraction.clamp(0.0, 1.0) * 255.0).round() as usize]
}

/// Colour of a range: the even scale from yellow (near) to dark blue (far), so that near objects stand out.
pub fn range(fraction: f64) -> Color32 {
    even(1.0 - fraction)
}

static VIRIDIS: LazyLock<[Color32; 256]> = LazyLock::new(|| {
    ramp(&[0x44_0154, 0x47_2d7b, 0x3b_528b, 0x2c_728e, 0x21_918c, 0x28_ae80, 0x5e_c962, 0xad_dc30, 0xfd_e725])
});

static CIVIDIS: LazyLock<[Color32; 256]> = LazyLock::new(|| {
    ramp(&[
        0x00_224e, 0x12_3570, 0x3b_496c, 0x57_5d6d, 0x70_7173, 0x8a_8678, 0xa5_9c74, 0xc3_b369, 0xe1_cc55,
        0xfe_e838,
    ])
});

/// 256 colours interpolated between equidistant anchors.
fn ramp(anchors: &[u32]) -> [Color32; 256] {
    std::array::from_fn(|i| {
        let position = i as f32 / 255.0 * (anchors.len() - 1) as f32;
        let below = (position as usize).min(anchors.len() - 2);
        rgb(anchors[below]).lerp_to_gamma(rgb(anchors[below + 1]), position - below as f32)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lightness(color: Color32) -> f32 {
        let [r, g, b, _] = egui::Rgba::from(color).to_array();
        (0.2126 * r + 0.7152 * g + 0.0722 * b).cbrt()
    }

    #[test]
    fn the_papers_colours_run_from_green_to_red_and_unknown_is_black() {
        let palette = MapPalette::Papers;
        assert_eq!([0, 50, 51, 101, 151, 201, 250].map(|cost| palette.cost(cost)), {
            let [green, light_blue, blue, yellow, red] = PAPERS_COST.map(|(_, color)| color);
            [green, green, light_blue, blue, yellow, red, red]
        });
        assert_eq!(palette.cost(255), Color32::BLACK);
    }

    #[test]
    fn even_palettes_grow_lighter_all_the_way() {
        for costs in (0..=250_u8).collect::<Vec<_>>().windows(2) {
            assert!(
                lightness(MapPalette::Even.cost(costs[1]))
                    >= lightness(MapPalette::Even.cost(costs[0])) - 1e-3
            );
        }
        assert!((0..255).all(|i| lightness(VIRIDIS[i + 1]) >= lightness(VIRIDIS[i]) - 1e-3));
        assert_eq!(even(f64::NAN), Color32::TRANSPARENT);
        assert_eq!((even(-1.0), even(2.0)), (VIRIDIS[0], VIRIDIS[255]));
    }

    #[test]
    fn classes_without_names_are_numbered_and_nothing_is_transparent() {
        let classes = Classes::default();
        assert_eq!((classes.color(0), classes.name(7)), (Color32::TRANSPARENT, "class 7".to_owned()));
        assert!((1..=255).all(|value| classes.color(value).a() == 255));
    }

    #[test]
    fn what_has_no_class_among_those_of_its_channel_is_transparent() {
        let label = Label { value: 2, name: "water".to_owned(), color: Color32::BLUE };
        let classes: Classes = [label.clone()].into_iter().collect();
        assert_eq!((classes.color(2), classes.name(2)), (Color32::BLUE, "water".to_owned()));
        assert_eq!((classes.color(1), classes.name(1)), (Color32::TRANSPARENT, "not known".to_owned()));
        assert_eq!(classes.legend(), [label]);
    }
}
