//! An array of any size as a picture or a histogram, below the fields.

use super::decoded::Decoded;
use crate::prepare::{Painted, Same, prepared};
use egui::{Color32, ColorImage, DragValue, FontId, Id, Pos2, Rect, Role, Sense, Ui, Vec2, WidgetInfo};
use ocu_ui::{format, icons, palette, tokens, widgets};
use rcs_msg::{FieldPath, Segment, Value};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Height of the panel.
pub(super) const HEIGHT: f32 = 168.0;
/// Number of bars of a histogram.
const BARS: usize = 64;
/// Largest side of a texture on every system; of a larger picture every so many rows and columns are shown.
const MOST_SIDE: usize = 2048;
/// Longest row of a picture.
const MOST_WIDTH: usize = 1 << 20;

/// How an array is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Form {
    Histogram,
    /// Row by row, with so many numbers in a row.
    Picture {
        width: usize,
    },
}

/// The array that is shown.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct ArrayForm {
    /// Path of the array in the message.
    pub(super) path: String,
    pub(super) form: Form,
}

/// The numbers of an array with their least and greatest finite value, and its bars.
struct Numbers {
    values: Vec<f64>,
    range: Option<(f64, f64)>,
    bars: Vec<usize>,
}

/// Whether a value is an array of numbers.
pub(super) fn is_array(value: &Value) -> bool {
    match value {
        Value::Packed(_) | Value::Bytes(_) => value.len().is_some_and(|length| length > 1),
        Value::List(list) => list.len() > 1 && list.iter().all(|item| item.as_f64().is_some()),
        _ => false,
    }
}

/// The width that a picture of an array begins with: what the message says of it, else that of a square.
pub(super) fn usual_width(root: &Value, path: &FieldPath) -> usize {
    let segments = path.segments();
    let parent = segments[..segments.len().saturating_sub(1)].iter().cloned();
    let parent = parent.fold(FieldPath::root(), |path, segment: Segment| path.join(segment));
    let length = root.get(path).ok().and_then(|value| value.len()).unwrap_or(1);
    // In bytes, a row is as long as its stride.
    let is_bytes = root.get(path).is_ok_and(|value| matches!(*value, Value::Bytes(_)));
    let strides = ["row_stride", "step"].into_iter().filter(|_| is_bytes);
    let said = strides.chain(["width", "column_count", "columns", "cols"]).find_map(|name| {
        let value = root.get(&parent.field(name)).ok()?.as_f64()?;
        (value >= 1.0 && value as usize <= length).then_some(value as usize)
    });
    said.unwrap_or_else(|| (length as f64).sqrt().ceil() as usize).clamp(1, MOST_WIDTH)
}

fn numbers(root: &Value, path: &str) -> Option<Numbers> {
    let value = root.get(&path.parse().ok()?).ok()?;
    if !is_array(&value) {
        return None;
    }
    let values: Vec<f64> = match &*value {
        Value::Bytes(bytes) => bytes.iter().map(|&byte| f64::from(byte)).collect(),
        Value::Packed(packed) => packed.iter().map(rcs_msg::Scalar::as_f64).collect(),
        Value::List(list) => list.iter().map(|item| item.as_f64().unwrap_or(f64::NAN)).collect(),
        _ => return None,
    };
    let finite = || values.iter().copied().filter(|value| value.is_finite());
    let range = finite().fold(None, |range: Option<(f64, f64)>, value| {
        Some(range.map_or((value, value), |(min, max)| (min.min(value), max.max(value))))
    });
    let mut bars = vec![0; BARS];
    if let Some((min, max)) = range {
        let step = (max - min) / BARS as f64;
        for value in finite() {
            let bar = if step > 0.0 { ((value - min) / step) as usize } else { 0 };
            bars[bar.min(BARS - 1)] += 1;
        }
    }
    Some(Numbers { values, range, bars })
}

/// Paints an array of a message; `false` to close it. `slot` is that of the view and its topic.
pub(super) fn ui(ui: &mut Ui, slot: Id, decoded: &Arc<Decoded>, shown: &mut ArrayForm) -> bool {
    let (root, slot) = (&decoded.value, slot.with(&shown.path));
    let (of, path) = (Arc::clone(decoded), shown.path.clone());
    let key = Same(Arc::clone(decoded));
    let numbers =
        prepared(ui.ctx(), slot.with("numbers"), key, move || numbers(&of.value, &path).map(Arc::new));
    let numbers = numbers.as_deref();
    let mut stays = true;
    let line = egui::Stroke::new(1.0, tokens(ui).line);
    ui.painter().hline(ui.max_rect().x_range(), ui.max_rect().top(), line);
    ui.add_space(4.0);
    ui.horizontal(|ui| {
        ui.add_space(8.0);
        ui.label(widgets::mono(&shown.path).color(tokens(ui).strong));
        let mut is_picture = matches!(shown.form, Form::Picture { .. });
        if widgets::icon_toggle(ui, icons::ICON_IMAGE, "As a picture", &mut is_picture).changed()
            || is_picture != matches!(shown.form, Form::Picture { .. })
        {
            let path = shown.path.parse().unwrap_or_default();
            let width = usual_width(root, &path);
            shown.form = if is_picture { Form::Picture { width } } else { Form::Histogram };
        }
        if let Form::Picture { width } = &mut shown.form {
            let drag = ui.add(DragValue::new(width).range(1..=MOST_WIDTH).suffix(" in a row"));
            ui.ctx().accesskit_node_builder(drag.id, |node| node.set_label("Width of the picture"));
        }
        if let Some(Some(numbers)) = numbers {
            let range = numbers.range.map_or_else(String::new, |(min, max)| {
                format!("  {} to {}", format::number(min), format::number(max))
            });
            let text = format!("{} numbers{range}", format::count(numbers.values.len() as u64));
            ui.add(egui::Label::new(egui::RichText::new(text).small().color(tokens(ui).weak)).truncate());
        }
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            ui.add_space(8.0);
            stays = !widgets::icon_button(ui, icons::ICON_CLOSE, "Close the array").clicked();
        });
    });
    let rect = ui.available_rect_before_wrap().shrink2(Vec2::new(8.0, 4.0));
    match (numbers, shown.form) {
        // They are being read.
        (None, _) => {}
        (Some(None), _) => {
            let text = "This message has no array of numbers here.";
            let (font, color) = (FontId::proportional(12.0), tokens(ui).weak);
            widgets::cell(ui, rect, egui::Align::Center, text, font, color);
        }
        (Some(Some(numbers)), Form::Histogram) => histogram(ui, rect, numbers),
        (Some(Some(numbers)), Form::Picture { width }) => {
            let (key, of) = ((Same(Arc::clone(numbers)), width), Arc::clone(numbers));
            let make = move || picture(&of, width).map(Painted::new);
            let painted = prepared(ui.ctx(), slot.with("picture"), key, make);
            if let Some(Some(painted)) = painted.as_deref() {
                let size = Vec2::from(painted.size().map(|side| side as f32));
                let scale = (rect.width() / size.x).min(rect.height() / size.y);
                let place = Rect::from_min_size(rect.min, size * scale);
                let uv = Rect::from_min_max(Pos2::ZERO, Pos2::new(1.0, 1.0));
                let texture = painted.texture(ui.ctx(), egui::TextureOptions::NEAREST);
                ui.painter().image(texture, place, uv, Color32::WHITE);
                read(ui, place, numbers, width);
            }
        }
    }
    stays
}

/// Number of rows of a picture, and how many columns and rows each of its points stands for.
fn layout(numbers: &Numbers, width: usize) -> (usize, [usize; 2]) {
    let rows = numbers.values.len().div_ceil(width.max(1)).max(1);
    (rows, [width.div_ceil(MOST_SIDE).max(1), rows.div_ceil(MOST_SIDE)])
}

/// Says what is under the pointer on a picture.
fn read(ui: &Ui, place: Rect, numbers: &Numbers, width: usize) {
    let response = ui.interact(place, ui.scope_id().with("array picture"), Sense::hover());
    response.widget_info(|| WidgetInfo::labeled(Role::Image, true, "Picture of the array"));
    let Some(at) = response.hover_pos() else { return };
    let (rows, [across, down]) = layout(numbers, width);
    let part = (at - place.min) / place.size();
    let of = |part: f32, count: usize, step: usize| (part * count.div_ceil(step) as f32) as usize * step;
    let index = of(part.y, rows, down) * width + of(part.x, width, across);
    if let Some(value) = numbers.values.get(index) {
        response.on_hover_text(format!("[{index}]  {}", format::exact(*value)));
    }
}

/// The numbers row by row, from dark for the least to light for the greatest; what is not finite is transparent.
fn picture(numbers: &Numbers, width: usize) -> Option<ColorImage> {
    let (min, max) = numbers.range?;
    let (rows, [across, down]) = layout(numbers, width);
    let size = [width.div_ceil(across), rows.div_ceil(down)];
    let color = |x: usize, y: usize| {
        let value = numbers.values.get(y * down * width + x * across).filter(|value| value.is_finite());
        value.map_or(Color32::TRANSPARENT, |value| {
            palette::even(if max > min { (value - min) / (max - min) } else { 0.5 })
        })
    };
    let pixels = (0..size[1]).flat_map(|y| (0..size[0]).map(move |x| (x, y)));
    Some(ColorImage::new(size, pixels.map(|(x, y)| color(x, y)).collect()))
}

fn histogram(ui: &Ui, rect: Rect, numbers: &Numbers) {
    let Some((min, max)) = numbers.range else { return };
    let tokens = tokens(ui);
    let bars = rect.with_max_y(rect.bottom() - 16.0);
    let most = numbers.bars.iter().copied().max().unwrap_or(1).max(1) as f32;
    let width = bars.width() / BARS as f32;
    for (index, &count) in numbers.bars.iter().enumerate().filter(|(_, count)| **count > 0) {
        let left = bars.left() + width * index as f32;
        // A single number is still seen.
        let height = (bars.height() * count as f32 / most).max(1.0);
        let bar = Rect::from_x_y_ranges(
            left..=left + (width - 1.0).max(1.0),
            bars.bottom() - height..=bars.bottom(),
        );
        ui.painter().rect_filled(bar, 0.0, tokens.accent);
    }
    ui.painter().hline(bars.x_range(), bars.bottom(), egui::Stroke::new(1.0, tokens.line));
    let below = rect.with_min_y(bars.bottom() + 2.0);
    let font = FontId::monospace(11.0);
    widgets::cell(ui, below, egui::Align::Min, &format::number(min), font.clone(), tokens.weak);
    widgets::cell(ui, below, egui::Align::Max, &format::number(max), font.clone(), tokens.weak);
    let response = ui.interact(bars, ui.scope_id().with("array histogram"), Sense::hover());
    response.widget_info(|| WidgetInfo::labeled(Role::Image, true, "Histogram of the array"));
    if let Some(at) = response.hover_pos() {
        let bar = (((at.x - bars.left()) / width) as usize).min(BARS - 1);
        let step = (max - min) / BARS as f64;
        let from = min + step * bar as f64;
        let (from, to) = (format::number(from), format::number(from + step));
        response.on_hover_text(format!("{from} to {to}: {}", format::count(numbers.bars[bar] as u64)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn root(values: Vec<f64>) -> Value {
        let list = Value::List(values.into_iter().map(Value::Float).collect());
        Value::Message(vec![("width".to_owned(), Value::Uint(3)), ("data".to_owned(), list)])
    }

    #[test]
    fn every_finite_number_is_in_one_bar_and_gaps_are_in_none() {
        let found = numbers(&root(vec![0.0, 1.0, 63.0, 64.0, f64::NAN, f64::INFINITY]), ".data").unwrap();
        assert_eq!(found.range, Some((0.0, 64.0)));
        assert_eq!((found.bars[0], found.bars[1], found.bars[63]), (1, 1, 2));
        assert_eq!(found.bars.iter().sum::<usize>(), 4);
        let equal = numbers(&root(vec![7.0; 5]), ".data").unwrap();
        assert_eq!(equal.bars[0], 5);
    }

    #[test]
    fn a_picture_has_the_width_that_the_message_says_and_gaps_are_transparent() {
        let root = root(vec![0.0, 1.0, 2.0, 3.0, f64::NAN, 5.0, 6.0]);
        assert_eq!(usual_width(&root, &".data".parse().unwrap()), 3);
        let image = picture(&numbers(&root, ".data").unwrap(), 3).unwrap();
        assert_eq!(image.size, [3, 3]);
        assert_eq!(image.pixels[4], Color32::TRANSPARENT);
        assert_ne!(image.pixels[0], image.pixels[6]);
        assert!(numbers(&root, ".width").is_none());
    }

    #[test]
    fn a_picture_of_any_size_fits_a_texture() {
        let many = numbers(&root(vec![1.0; 30_000]), ".data").unwrap();
        for width in [1, 3, 5000, MOST_WIDTH] {
            let image = picture(&many, width).unwrap();
            assert!(image.size.iter().all(|&side| side <= MOST_SIDE), "{width}: {:?}", image.size);
        }
    }

    #[test]
    fn bytes_are_numbers_and_texts_are_none() {
        assert!(is_array(&Value::Bytes(vec![1, 2, 3].into())));
        assert!(!is_array(&Value::Text("abc".to_owned())));
        assert!(!is_array(&Value::List(vec![Value::Text("a".to_owned()), Value::Text("b".to_owned())])));
    }
}
