//! Legends and scale bars, drawn on a canvas.

use crate::short_name::with_name;
use crate::{format, short_name, tokens};
use egui::{
    Align, Color32, FontId, Galley, Layout, Pos2, Rect, Response, Sense, Stroke, StrokeKind, Ui, UiBuilder,
    Vec2,
};
use std::sync::Arc;

/// Room of the colour of a swatch.
const SWATCH: f32 = 14.0;

/// A name in small letters, shortened to its room and told from `others`.
fn small_name(ui: &Ui, name: &str, others: &[&str], room: f32) -> Arc<Galley> {
    let font = egui::TextStyle::Small.resolve(ui.style());
    short_name::galley(ui.painter(), name, others, &font, tokens(ui).text, room)
}

/// A name above a scale of a legend, shortened where it is wider than the legend may be.
pub fn title(ui: &mut Ui, name: &str) -> Response {
    let galley = small_name(ui, name, &[], ui.available_width());
    let (rect, response) = ui.allocate_exact_size(galley.size(), Sense::hover());
    ui.painter().galley(rect.min, Arc::clone(&galley), tokens(ui).text);
    with_name(response, name, &galley)
}

/// A colour swatch and its name, as a row of a legend.
pub fn swatch(ui: &mut Ui, color: Color32, name: &str) -> Response {
    swatch_among(ui, color, name, &[])
}

/// Like [`swatch`], in a legend with these names: where a name is shortened, it is still told from the others.
pub fn swatch_among(ui: &mut Ui, color: Color32, name: &str, names: &[&str]) -> Response {
    let tokens = tokens(ui);
    let galley = small_name(ui, name, names, ui.available_width() - SWATCH);
    // One widget, so that a wrapping row keeps colour and name together.
    let size = Vec2::new(SWATCH + galley.size().x, galley.size().y.max(14.0));
    let (rect, response) = ui.allocate_exact_size(size, Sense::hover());
    let square = Rect::from_center_size(rect.left_center() + Vec2::new(5.0, 0.0), Vec2::splat(10.0));
    ui.painter().rect(square, 1.0, color, Stroke::new(1.0, tokens.line), StrokeKind::Inside);
    let at = rect.left_center() + Vec2::new(SWATCH, -galley.size().y / 2.0);
    ui.painter().galley(at, Arc::clone(&galley), tokens.text);
    with_name(response, name, &galley)
}

/// Several swatches in a wrapping row.
pub fn swatches(ui: &mut Ui, entries: impl IntoIterator<Item = (Color32, String)>) {
    ui.horizontal_wrapped(|ui| {
        ui.spacing_mut().item_spacing = Vec2::new(12.0, 2.0);
        for (color, name) in entries {
            swatch(ui, color, &name);
        }
    });
}

/// A colour scale from `low` to `high`, with these labels at its ends.
pub fn band(ui: &mut Ui, width: f32, low: &str, high: &str, color_at: impl Fn(f64) -> Color32) {
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 4.0;
        ui.label(egui::RichText::new(low).small());
        let (rect, _) = ui.allocate_exact_size(Vec2::new(width, 10.0), Sense::hover());
        // One mesh: separate rectangles leave stripes where a point is no whole number of pixels.
        let steps = (width / 2.0).max(1.0) as u32;
        let mut mesh = egui::Mesh::default();
        for i in 0..=steps {
            let part = f64::from(i) / f64::from(steps);
            let x = rect.left() + rect.width() * part as f32;
            mesh.colored_vertex(Pos2::new(x, rect.top()), color_at(part));
            mesh.colored_vertex(Pos2::new(x, rect.bottom()), color_at(part));
            if i > 0 {
                mesh.add_triangle(2 * i - 2, 2 * i - 1, 2 * i);
                mesh.add_triangle(2 * i - 1, 2 * i, 2 * i + 1);
            }
        }
        ui.painter().add(mesh);
        ui.label(egui::RichText::new(high).small());
    });
}

/// The decimals that multiples of a step need.
pub fn decimals(step: f64) -> usize {
    (-step.log10().floor()).clamp(0.0, 17.0) as usize
}

/// The smallest of …, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, … that is at least `least`; 1 if `least` is not a positive
/// number.
pub fn round_step(least: f64) -> f64 {
    if !(least.is_finite() && least > 0.0) {
        return 1.0;
    }
    let power = 10_f64.powf(least.log10().floor());
    [1.0, 2.0, 5.0]
        .map(|factor| factor * power)
        .into_iter()
        .find(|step| *step >= least * (1.0 - 1e-9))
        .unwrap_or(10.0 * power)
}

/// A scale bar that is laid out.
struct ScaleBar {
    ends: [Pos2; 2],
    text: Arc<Galley>,
    text_at: Pos2,
    ground: Rect,
}

/// Half of the height of the ends of a scale bar.
const SCALE_END: Vec2 = Vec2::new(0.0, 4.0);

impl ScaleBar {
    fn new(ui: &Ui, right_bottom: Pos2, points_per_m: f64) -> Self {
        let length_m = round_step(64.0 / points_per_m);
        let length = (length_m * points_per_m) as f32;
        let y = right_bottom.y - 4.0;
        let (left, right) = (Pos2::new(right_bottom.x - length, y), Pos2::new(right_bottom.x, y));
        let text = if length_m >= 1000.0 {
            format!("{} km", length_m / 1000.0)
        } else {
            format!("{} m", format::number(length_m))
        };
        let text = ui.painter().layout_no_wrap(text, FontId::proportional(11.0), tokens(ui).strong);
        let at = Pos2::new(left.x + length / 2.0, y - 3.0);
        let place = egui::Align2::CENTER_BOTTOM.anchor_size(at, text.size());
        let bar = Rect::from_two_pos(left - SCALE_END, right + SCALE_END);
        let ground = place.union(bar).expand2(Vec2::new(4.0, 1.0));
        Self { ends: [left, right], text, text_at: place.min, ground }
    }
}

/// Where a [`scale_bar`] lies, so that other things leave it free.
pub fn scale_bar_place(ui: &Ui, right_bottom: Pos2, points_per_m: f64) -> Rect {
    ScaleBar::new(ui, right_bottom, points_per_m).ground
}

/// A bar with a length in metres, whose right end is at `right_bottom`, on the ground that texts on a canvas have.
pub fn scale_bar(ui: &Ui, right_bottom: Pos2, points_per_m: f64) {
    let ScaleBar { ends, text, text_at, ground } = ScaleBar::new(ui, right_bottom, points_per_m);
    let (tokens, painter) = (tokens(ui), ui.painter());
    painter.rect_filled(ground, 2.0, tokens.surface[3].gamma_multiply(0.92));
    let stroke = Stroke::new(1.5, tokens.strong);
    painter.line_segment(ends, stroke);
    for end in ends {
        painter.line_segment([end - SCALE_END, end + SCALE_END], stroke);
    }
    painter.galley(text_at, text, tokens.strong);
}

/// A panel on a canvas for a legend or a readout; `corner` is its corner of the canvas. Returns its rectangle.
pub fn plate<R>(
    ui: &mut Ui,
    canvas: Rect,
    corner: egui::Align2,
    add: impl FnOnce(&mut Ui) -> R,
) -> (R, Rect) {
    plate_of(ui, canvas, corner, false, add)
}

/// Like [`plate`], for controls: a click or a drag on it, also on a disabled control, does not reach the canvas. What wraps
/// in it has the width of the canvas.
pub fn solid_plate<R>(
    ui: &mut Ui,
    canvas: Rect,
    corner: egui::Align2,
    add: impl FnOnce(&mut Ui) -> R,
) -> (R, Rect) {
    plate_of(ui, canvas, corner, true, add)
}

fn plate_of<R>(
    ui: &mut Ui,
    canvas: Rect,
    corner: egui::Align2,
    is_solid: bool,
    add: impl FnOnce(&mut Ui) -> R,
) -> (R, Rect) {
    let tokens = tokens(ui);
    let inner = canvas.shrink(8.0);
    let id = ui.scope_id().with(("plate", format!("{corner:?}")));
    // The size in the previous pass determines its position at the right and at the bottom.
    let size = ui.data(|data| data.get_temp::<Vec2>(id)).unwrap_or(Vec2::new(160.0, 40.0));
    let at = corner.align_size_within_rect(size.min(inner.size()), inner);
    if is_solid {
        // Before the contents, which lie above it. It is not reached with the keyboard.
        let place = Rect::from_min_size(at.min, size);
        ui.interact(place, id.with("behind"), Sense::CLICK | Sense::DRAG);
    }
    let builder = UiBuilder::new()
        .max_rect(Rect::from_min_max(
            at.min,
            if corner.x() == Align::RIGHT { at.max.max(inner.max) } else { inner.max },
        ))
        .layout(Layout::top_down(Align::LEFT));
    let response = ui.scope_builder(builder, |ui| {
        egui::Frame::new()
            .fill(tokens.surface[3].gamma_multiply(0.92))
            .stroke(Stroke::new(1.0, tokens.line))
            .corner_radius(3.0)
            .inner_margin(egui::Margin::symmetric(8, 4))
            .show(ui, |ui| {
                ui.spacing_mut().item_spacing.y = 2.0;
                ui.spacing_mut().interact_size.y = 14.0;
                ui.style_mut().wrap_mode = Some(egui::TextWrapMode::Extend);
                if is_solid {
                    // Less the margins and the border of the plate.
                    ui.set_max_width((inner.width() - 18.0).max(48.0));
                }
                add(ui)
            })
    });
    let frame = response.inner;
    let drawn = frame.response.rect;
    if (drawn.size() - size).abs().max_elem() > 0.5 {
        ui.data_mut(|data| data.insert_temp(id, drawn.size()));
        ui.ctx().request_discard("a plate on a canvas changed its size");
    }
    (frame.inner, drawn)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_one_two_or_five() {
        let steps = [0.003, 0.2, 0.21, 1.0, 3.0, 7.0, 12.0, 4999.0].map(round_step);
        for (step, expected) in steps.into_iter().zip([0.005, 0.2, 0.5, 1.0, 5.0, 10.0, 20.0, 5000.0]) {
            assert!((step / expected - 1.0).abs() < 1e-9, "{step} {expected}");
        }
        assert_eq!(round_step(f64::NAN), 1.0);
        assert_eq!(round_step(0.0), 1.0);
    }

    #[test]
    fn the_name_of_a_swatch_ends_within_the_legend_and_is_told_from_the_others() {
        let names = ["/test/geometry_msgs/pose_stamped", "/test/geometry_msgs/pose_with_covariance_stamped"];
        let mut right = 0.0;
        let output = egui::Context::default().run_ui(egui::RawInput::default(), |ui| {
            ui.set_max_width(112.0);
            right = ui.max_rect().right();
            for name in names {
                swatch_among(ui, Color32::RED, name, &names);
            }
        });
        let mut texts = Vec::new();
        for clipped in &output.shapes {
            let egui::Shape::Text(text) = &clipped.shape else { continue };
            assert!(text.pos.x + text.galley.size().x <= right + 0.5, "{}", text.galley.text());
            texts.push(text.galley.text().to_owned());
        }
        assert!(matches!(texts.as_slice(), [one, other] if one != other), "{texts:?}");
        output.drop_without_applying_deltas();
    }

    #[test]
    fn the_text_of_a_scale_bar_lies_on_the_ground_that_texts_on_a_canvas_have() {
        let mut fill = Color32::TRANSPARENT;
        let output = egui::Context::default().run_ui(egui::RawInput::default(), |ui| {
            fill = tokens(ui).surface[3].gamma_multiply(0.92);
            scale_bar(ui, Pos2::new(300.0, 100.0), 20.0);
        });
        let shapes = || output.shapes.iter().map(|clipped| &clipped.shape);
        let text = shapes().find(|shape| matches!(shape, egui::Shape::Text(_))).unwrap();
        let middle = text.visual_bounding_rect().center();
        let is_ground = |shape: &egui::Shape| matches!(shape, egui::Shape::Rect(ground) if ground.fill == fill && ground.rect.contains(middle));
        assert!(shapes().any(is_ground));
        output.drop_without_applying_deltas();
    }
}
