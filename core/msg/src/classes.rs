//! Classes of label images: the names and colours that travel with the channel.

use serde::{Deserialize, Serialize};

/// Key of the channel metadata that holds the classes of a label image as JSON, see [`classes_to_json`].
pub const CLASSES: &str = "rcs.classes";

/// A class of a label image. Values without a class are unknown, and drawn transparent.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct LabelClass {
    /// Value of the pixels of this class.
    pub value: u8,
    /// Name as shown.
    pub name: std::borrow::Cow<'static, str>,
    /// Red, green and blue.
    pub color: [u8; 3],
}

impl LabelClass {
    /// A class with a colour as `0xrrggbb`.
    pub const fn new(value: u8, name: &'static str, rgb: u32) -> LabelClass {
        let color = [(rgb >> 16) as u8, (rgb >> 8) as u8, rgb as u8];
        LabelClass { value, name: std::borrow::Cow::Borrowed(name), color }
    }
}

/// Classes as the text of a channel's metadata: `[{"value": 1, "name": "ground", "color": [47, 179, 68]}, …]`.
pub fn classes_to_json(classes: &[LabelClass]) -> String {
    serde_json::to_string(classes).unwrap_or_default()
}

/// Classes from the text of a channel's metadata; none if the text does not parse.
pub fn classes_from_json(text: &str) -> Vec<LabelClass> {
    serde_json::from_str(text).unwrap_or_default()
}

/// Obstacle labels: green ground, red obstacle, blue too far, the colours of the LAGR papers.
pub const OBSTACLE_CLASSES: [LabelClass; 5] = [
    LabelClass::new(1, "ground", 0x2f_b344),
    LabelClass::new(2, "obstacle", 0xe5_3935),
    LabelClass::new(3, "short obstacle", 0xe8_c51c),
    LabelClass::new(4, "cover", 0x9c_5fd6),
    LabelClass::new(5, "too far", 0x2f_7de0),
];

/// Traversability labels: yellow traversable, magenta not, the colours of the LAGR papers.
pub const TRAVERSABLE_CLASSES: [LabelClass; 2] =
    [LabelClass::new(1, "traversable", 0xf0_d81e), LabelClass::new(2, "not traversable", 0xd6_3ad6)];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn classes_come_back_from_their_text_and_other_texts_name_none() {
        let text = classes_to_json(&OBSTACLE_CLASSES);
        assert_eq!(classes_from_json(&text), OBSTACLE_CLASSES);
        assert!(text.starts_with(r#"[{"value":1,"name":"ground","color":[47,179,68]}"#), "{text}");
        assert!(classes_from_json("surfaces").is_empty());
    }
}
