//! How the points of a cloud are drawn in the map and in the scene, as a person has chosen.

use egui::{Role, Slider, Ui, WidgetInfo};
use rcs_msg::foxglove::packed_element_field::NumericType;
use rcs_msg::foxglove::{PackedElementField, PointCloud};
use rcs_msg::points;
use serde::{Deserialize, Serialize};

/// What suits the cloud.
const AUTOMATIC: &str = "automatic";
/// By z in the frame in which heights count.
pub(crate) const HEIGHT: &str = "height";
/// By the distance from the origin of the cloud.
pub(crate) const DISTANCE: &str = "distance";
/// By the colours of the cloud.
pub(crate) const OWN: &str = "own colours";
/// All points alike.
pub(crate) const ONE: &str = "one colour";
/// Before the name of a field that is equal to one of these.
const FIELD: &str = "field ";
/// Greatest side of a point, screen points.
const MOST: u8 = 16;

/// How a cloud is drawn.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub(crate) struct CloudLook {
    /// By what its points are coloured, one of [`choices`]; `None` for what suits the cloud.
    pub(crate) by: Option<String>,
    /// Side of a point, screen points; [`CloudLook::side`] bounds it.
    point_size: u8,
}

impl Default for CloudLook {
    fn default() -> Self {
        Self { by: None, point_size: 2 }
    }
}

impl CloudLook {
    /// Side of a point, screen points.
    pub(crate) fn side(&self) -> f32 {
        f32::from(self.point_size.clamp(1, MOST))
    }

    /// The controls of a layer with this name.
    pub(crate) fn ui(&mut self, ui: &mut Ui, name: &str, cloud: &PointCloud, indent: f32) {
        ui.horizontal(|ui| {
            ui.add_space(indent);
            let shown = self.by.clone().unwrap_or_else(|| AUTOMATIC.to_owned());
            let menu = ui.menu_button(format!("Colour by {shown}"), |ui| {
                if ui.selectable_label(self.by.is_none(), AUTOMATIC).clicked() {
                    self.by = None;
                }
                for choice in choices(cloud) {
                    if ui.selectable_label(self.by.as_ref() == Some(&choice), &choice).clicked() {
                        self.by = Some(choice);
                    }
                }
            });
            let label = format!("Colour {name} by {shown}");
            menu.response.widget_info(|| WidgetInfo::labeled(Role::Button, true, &label));
        });
        ui.horizontal(|ui| {
            ui.add_space(indent);
            ui.spacing_mut().slider_width = 96.0;
            let response = ui.add(Slider::new(&mut self.point_size, 1..=MOST).prefix("size ").suffix(" px"));
            let label = format!("Point size of {name}");
            response.widget_info(|| WidgetInfo::labeled(Role::Slider, true, &label));
            response.on_hover_text(label);
        });
    }
}

/// By what the points of a cloud can be coloured.
fn choices(cloud: &PointCloud) -> Vec<String> {
    let is_number = |field: &&PackedElementField| {
        field.r#type() != NumericType::Unknown && !matches!(&*field.name, "rgb" | "rgba")
    };
    let named = |field: &PackedElementField| match &*field.name {
        name @ (HEIGHT | DISTANCE | OWN | ONE) => format!("{FIELD}{name}"),
        name => name.to_owned(),
    };
    let own = points(cloud).is_ok_and(|points| points.has_colours()).then(|| OWN.to_owned());
    let mut choices = vec![HEIGHT.to_owned(), DISTANCE.to_owned()];
    choices.extend(cloud.fields.iter().filter(is_number).map(named));
    choices.extend(own);
    choices.push(ONE.to_owned());
    choices
}

/// The field of a cloud that a choice means; `None` if it means something else, or if the cloud has no such field.
pub(crate) fn field<'a>(cloud: &'a PointCloud, choice: &str) -> Option<&'a PackedElementField> {
    if matches!(choice, HEIGHT | DISTANCE | OWN | ONE) {
        return None;
    }
    let named = |name: &str| cloud.fields.iter().find(|field| field.name == name);
    named(choice).or_else(|| named(choice.strip_prefix(FIELD)?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples;

    #[test]
    fn every_field_with_numbers_is_offered_and_found_by_its_choice() {
        let mut cloud = samples::cloud(&[]);
        cloud.point_stride = 24;
        for (name, offset, kind) in [
            ("rgb", 12, NumericType::Float32),
            ("height", 16, NumericType::Uint16),
            ("unknown", 18, NumericType::Unknown),
        ] {
            cloud.fields.push(PackedElementField { name: name.to_owned(), offset, r#type: kind.into() });
        }
        let choices = choices(&cloud);
        assert_eq!(choices, [HEIGHT, DISTANCE, "x", "y", "z", "field height", OWN, ONE]);
        let found = choices.iter().filter_map(|choice| field(&cloud, choice));
        let found: Vec<&str> = found.map(|field| field.name.as_str()).collect();
        assert_eq!(found, ["x", "y", "z", "height"]);
    }
}
