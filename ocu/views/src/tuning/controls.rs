//! One row per parameter: its name, a control of its type with unit and range, and a way back to the default.

use crate::edit::text::text_of;
use egui::emath::{format_with_decimals_in_range, round_to_decimals};
use egui::{
    Align, DragValue, Layout, Response, RichText, Role, Slider, SliderClamping, Ui, Vec2, WidgetInfo,
};
use ocu_ui::{icons, tokens, widgets};
use rcs_msg::params::{ParamKind, ParamSpec};
use rcs_msg::{FieldPath, Value};
use std::cell::Cell;
use std::ops::RangeInclusive;

/// A text longer than this is the content of a file, which is not edited in a row.
const LONG_TEXT: usize = 200;
/// Most decimals that a slider shows, and to which it rounds what is dragged.
const DECIMALS: usize = 4;

/// A parameter with its value in the draft.
pub(crate) struct Row<'a> {
    pub(crate) spec: &'a ParamSpec,
    pub(crate) path: String,
    pub(crate) value: Option<&'a Value>,
}

/// Paints rows, and collects what is changed.
pub(crate) struct Rows<'a> {
    pub(crate) search: &'a str,
    /// The parameters in force.
    pub(crate) now: &'a Value,
    /// Path and text of each change.
    pub(crate) edits: &'a mut Vec<(String, String)>,
    /// Whether a control was let go after a change.
    pub(crate) let_go: &'a mut bool,
}

/// Whether a parameter, or one within it, is found by a search.
pub(super) fn is_found(spec: &ParamSpec, search: &str) -> bool {
    search.is_empty()
        || spec.name.to_lowercase().contains(search)
        || spec.help.to_lowercase().contains(search)
        || spec.fields.iter().any(|field| is_found(field, search))
}

impl Rows<'_> {
    pub(crate) fn ui(&mut self, ui: &mut Ui, row: &Row<'_>, depth: usize) {
        let spec = row.spec;
        if !is_found(spec, self.search) {
            return;
        }
        match (spec.kind, row.value) {
            (ParamKind::Group, Some(value)) => {
                heading(ui, depth, &spec.name, &spec.help);
                for field in &spec.fields {
                    let path = format!("{}.{}", row.path, field.name);
                    self.ui(ui, &Row { spec: field, path, value: value.field(&field.name) }, depth + 1);
                }
            }
            (ParamKind::List, Some(Value::List(items))) => {
                heading(ui, depth, &spec.name, &spec.help);
                for (index, item) in items.iter().enumerate() {
                    self.element(ui, row, index, item, depth);
                }
                if items.is_empty() {
                    note(ui, depth + 1, "none");
                }
            }
            (ParamKind::List, value) => {
                heading(ui, depth, &spec.name, &spec.help);
                let count = value.and_then(Value::len).unwrap_or(0);
                note(ui, depth + 1, &format!("{count} values"));
            }
            (_, Some(value)) => self.plain(ui, row, value, depth),
            (_, None) => {}
        }
    }

    /// An element of a list: named by its text field, if it has one.
    fn element(&mut self, ui: &mut Ui, row: &Row<'_>, index: usize, item: &Value, depth: usize) {
        let path = format!("{}[{index}]", row.path);
        let fields = &row.spec.fields;
        if let [only] = fields.as_slice()
            && only.name.is_empty()
        {
            return self.plain(ui, &Row { spec: only, path, value: Some(item) }, item, depth + 1);
        }
        let named = fields.iter().find(|field| field.kind == ParamKind::Text);
        let name = named.and_then(|field| item.field(&field.name)?.as_text()).filter(|name| !name.is_empty());
        heading(ui, depth + 1, name.unwrap_or(&format!("[{index}]")), "");
        for field in
            fields.iter().filter(|field| name.is_none() || Some(&field.name) != named.map(|n| &n.name))
        {
            let path = format!("{path}.{}", field.name);
            self.ui(ui, &Row { spec: field, path, value: item.field(&field.name) }, depth + 2);
        }
    }

    fn plain(&mut self, ui: &mut Ui, row: &Row<'_>, value: &Value, depth: usize) {
        let (spec, tokens) = (row.spec, tokens(ui));
        let text = text_of(value).unwrap_or_default();
        let in_force = row
            .path
            .parse::<FieldPath>()
            .ok()
            .and_then(|path| self.now.get(&path).ok().and_then(|v| text_of(&v)));
        let is_changed = in_force.as_deref() != Some(&text);
        let default = text_of(&spec.default).unwrap_or_default();
        let name = if spec.name.is_empty() { row.path.rsplit('.').next().unwrap_or("") } else { &spec.name };
        ui.horizontal(|ui| {
            ui.add_space(8.0 + 12.0 * depth as f32);
            let width = (ui.available_width() * 0.42).clamp(72.0, 220.0);
            let (rect, response) = ui.allocate_exact_size(Vec2::new(width, 20.0), egui::Sense::hover());
            let ink = if is_changed { tokens.strong } else { tokens.text };
            let font = egui::TextStyle::Body.resolve(ui.style());
            widgets::cell(ui, rect, Align::Min, name, font, ink);
            if is_changed {
                // A mark beside the name, so that a change is not told by brightness alone.
                let at = rect.left_center() - Vec2::new(6.0, 0.0);
                ui.painter().circle_filled(at, 2.5, tokens.accent);
            }
            response.on_hover_ui(|ui| help(ui, row, &default, in_force.as_deref()));
            ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
                let (place, _) = ui.allocate_exact_size(Vec2::splat(20.0), egui::Sense::hover());
                // Also where it stays empty: else the control beside it gets another id, and loses the focus, as soon as
                // what is typed in it differs from the default.
                let mut child = ui.new_child(egui::UiBuilder::new().max_rect(place));
                if text != default && spec.file.is_none() {
                    let name = format!("Default of {}: {default}", row.path);
                    if widgets::icon_button(&mut child, icons::ICON_RESTART_ALT, &name).clicked() {
                        self.edits.push((row.path.clone(), default.clone()));
                        *self.let_go = true;
                    }
                }
                ui.with_layout(Layout::left_to_right(Align::Center), |ui| {
                    if let Some((new, done)) = control(ui, row, value) {
                        self.edits.push((row.path.clone(), new));
                        *self.let_go |= done;
                    }
                });
            });
        });
    }
}

/// The shortest number that a 32-bit field stores as this value; other values as they are.
fn shortest(number: f64) -> f64 {
    let narrow = number as f32;
    if f64::from(narrow) == number { narrow.to_string().parse().unwrap_or(number) } else { number }
}

/// A slider of a number with a narrow range, else a number that can be dragged. Neither showing nor leaving it changes
/// the value, which may have more decimals than are shown; what is typed is taken with all decimals.
fn number_control(ui: &mut Ui, row: &Row<'_>, new: &mut f64, unit: String) -> Response {
    let spec = row.spec;
    let before = *new;
    let bounds = spec.min.zip(spec.max).filter(|(min, max)| max - min <= 1e4);
    let id = ui.scope_id().with(("typed", &row.path));
    // The number that was shown when typing began, and the value that it stands for.
    let begun = ui.data(|data| data.get_temp::<[f64; 2]>(id));
    let written = Cell::new(before);
    let write = |value: f64, decimals: RangeInclusive<usize>| {
        let most = if bounds.is_some() { DECIMALS } else { *decimals.end() };
        let text = format_with_decimals_in_range(value, (*decimals.start()).min(most)..=most);
        written.set(text.parse().unwrap_or(value));
        text
    };
    let read = |text: &str| {
        let text: String = text.chars().filter(|c| !c.is_whitespace()).collect();
        let typed: f64 = text.replace('\u{2212}', "-").parse().ok()?;
        let [shown, value] = begun.unwrap_or([written.get(), before]);
        Some(if typed == shown { value } else { typed })
    };
    let response = if let Some((min, max)) = bounds {
        ui.spacing_mut().slider_width = (ui.available_width() - 96.0).max(32.0);
        let wide = min > 0.0 && max / min > 500.0;
        let slider = Slider::new(new, min..=max).suffix(unit).logarithmic(wide);
        let slider = slider.clamping(SliderClamping::Edits);
        ui.add(slider.custom_formatter(write).custom_parser(read))
    } else {
        let range = spec.min.unwrap_or(f64::MIN)..=spec.max.unwrap_or(f64::MAX);
        let speed = (before.abs() * 0.01).max(0.001);
        let drag = DragValue::new(new).range(range).speed(speed).suffix(unit).clamp_existing_to_range(false);
        ui.add(drag.custom_formatter(write).custom_parser(read))
    };
    let is_typed = response.has_focus() || response.lost_focus();
    if response.has_focus() && begun.is_none() {
        ui.data_mut(|data| data.insert_temp(id, [written.get(), before]));
    } else if !response.has_focus() && begun.is_some() {
        ui.data_mut(|data| data.remove::<[f64; 2]>(id));
    }
    if bounds.is_some() && !is_typed && *new != before {
        *new = round_to_decimals(*new, DECIMALS);
    }
    response
}

/// The control of a plain parameter; returns the new text, and whether the control was let go.
fn control(ui: &mut Ui, row: &Row<'_>, value: &Value) -> Option<(String, bool)> {
    let spec = row.spec;
    let unit = match spec.unit.as_str() {
        "" | "1" => String::new(),
        unit => format!(" {unit}"),
    };
    let label = |response: &egui::Response, role: Role| {
        let name = row.path.clone();
        response.widget_info(|| WidgetInfo::labeled(role, true, &name));
    };
    let changed = |response: &egui::Response, text: String| {
        // A number that is being typed changes with each key.
        let done =
            response.drag_stopped() || response.lost_focus() || !(response.dragged() || response.has_focus());
        (response.changed() || response.drag_stopped() || response.lost_focus()).then_some((text, done))
    };
    match value {
        Value::Bool(on) => {
            let mut on = *on;
            let response = ui.checkbox(&mut on, "");
            response.widget_info(|| WidgetInfo::selected(Role::CheckBox, true, on, &row.path));
            response.changed().then(|| (on.to_string(), true))
        }
        Value::Float(number) => {
            let shown = shortest(*number);
            let mut new = shown;
            let response = number_control(ui, row, &mut new, unit);
            label(&response, Role::Slider);
            if new.is_nan() {
                return None;
            }
            let value = if new == shown { *number } else { new };
            changed(&response, value.to_string())
        }
        Value::Int(_) | Value::Uint(_) => {
            let mut new = value.as_i64()?;
            let range =
                spec.min.map_or(i64::MIN, |min| min as i64)..=spec.max.map_or(i64::MAX, |max| max as i64);
            let is_short = spec.min.zip(spec.max).is_some_and(|(min, max)| max - min <= 1e4);
            let response = if is_short {
                ui.spacing_mut().slider_width = (ui.available_width() - 96.0).max(32.0);
                ui.add(Slider::new(&mut new, range).suffix(unit))
            } else {
                ui.add(DragValue::new(&mut new).range(range).suffix(unit))
            };
            label(&response, Role::Slider);
            changed(&response, new.to_string())
        }
        Value::Enum { name, .. } => {
            let mut chosen = None;
            let combo = egui::ComboBox::from_id_salt(&row.path).selected_text(name).width(140.0);
            let combo = combo.show_ui(ui, |ui| {
                for (_, choice) in &spec.choices {
                    if ui.selectable_label(choice == name, choice).clicked() {
                        chosen = Some((choice.clone(), true));
                    }
                }
            });
            label(&combo.response, Role::ComboBox);
            chosen
        }
        Value::Text(text) if spec.file.is_some() || text.len() > LONG_TEXT => {
            let text = format!("a file of {}", ocu_ui::format::bytes(text.len() as u64));
            ui.label(RichText::new(text).color(tokens(ui).weak));
            None
        }
        Value::Text(text) => {
            let mut new = text.clone();
            let response = ui.add(egui::TextEdit::singleline(&mut new).desired_width(ui.available_width()));
            ui.ctx().accesskit_node_builder(response.id, |node| node.set_label(row.path.clone()));
            (response.changed() || response.lost_focus()).then(|| (new, response.lost_focus()))
        }
        _ => None,
    }
}

fn help(ui: &mut Ui, row: &Row<'_>, default: &str, in_force: Option<&str>) {
    let tokens = tokens(ui);
    ui.set_max_width(320.0);
    ui.label(RichText::new(&row.path).monospace().color(tokens.strong));
    ui.label(&row.spec.help);
    let unit = if row.spec.unit == "1" { "" } else { &row.spec.unit };
    let range = match (row.spec.min, row.spec.max) {
        (Some(min), Some(max)) => format!("{min} to {max} {unit}"),
        (Some(min), None) => format!("at least {min} {unit}"),
        (None, Some(max)) => format!("at most {max} {unit}"),
        (None, None) => String::new(),
    };
    for (name, value) in
        [("range", range.as_str()), ("default", default), ("in force", in_force.unwrap_or_default())]
    {
        if !value.is_empty() && value.len() < LONG_TEXT {
            widgets::name_value(ui, 64.0, name, widgets::mono(value));
        }
    }
}

fn heading(ui: &mut Ui, depth: usize, name: &str, help: &str) {
    ui.horizontal(|ui| {
        ui.add_space(8.0 + 12.0 * depth as f32);
        let response = ui.label(RichText::new(name).strong());
        if !help.is_empty() {
            response.on_hover_text(help);
        }
    });
}

fn note(ui: &mut Ui, depth: usize, text: &str) {
    ui.horizontal(|ui| {
        ui.add_space(8.0 + 12.0 * depth as f32);
        ui.label(RichText::new(text).small().color(tokens(ui).weak));
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_of_32_bits_is_shown_as_it_was_written() {
        assert_eq!(shortest(f64::from(0.1_f32)), 0.1);
        assert_eq!((shortest(0.003_906_25), shortest(0.1)), (0.003_906_25, 0.1));
        assert!(shortest(f64::NAN).is_nan());
    }
}
