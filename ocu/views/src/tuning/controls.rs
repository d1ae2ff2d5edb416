//! One row per parameter: its name, a control of its type with unit and range, and a way back to what the stack gave, or
//! to the default.

use super::number::{self, number_control, shortest};
use crate::edit::text::text_of;
use egui::{Align, Color32, Id, Layout, RichText, Role, Ui, Vec2, WidgetInfo};
use ocu_ui::{format, icons, tokens, widgets};
use rcs_msg::params::{ParamKind, ParamSpec};
use rcs_msg::{FieldPath, Value};
use std::collections::BTreeMap;

/// A text longer than this is the content of a file, which is not edited in a row.
const LONG_TEXT: usize = 200;
/// Distance of the names from the left edge, screen points.
const INDENT: f32 = 8.0;
/// In less than this width, a name and a number do not fit side by side.
const NARROW: f32 = 208.0;

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
    /// The parameters that the stack gave, if it is known.
    pub(crate) given: Option<&'a Value>,
    /// What counts instead of a parameter in force, by path.
    pub(crate) counting: Option<&'a BTreeMap<String, f32>>,
    /// Whether the parameters in force are others than in the last pass: what was refused before them is not told.
    pub(crate) is_replaced: bool,
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
        let texts = self.texts(row, value);
        // Ids of its own: a reason that comes or goes below a row takes the focus from none after it.
        widgets::named(ui, row.path.as_str(), |ui| {
            let refusal = ui.scope_id().with("refused");
            if self.is_replaced {
                number::forget_refused(ui, refusal);
            }
            self.cells(ui, row, value, &texts, depth, refusal);
            if let Some(reason) = number::refused(ui, refusal) {
                let color = tokens(ui).error;
                line(ui, depth, &reason, color);
            }
        });
    }

    fn texts(&self, row: &Row<'_>, value: &Value) -> Texts {
        let path = row.path.parse::<FieldPath>().ok();
        let text_in = |params: &Value| {
            let value = path.as_ref().and_then(|path| params.get(path).ok());
            value.and_then(|value| text_of(&value))
        };
        let counting = self.counting.and_then(|counting| counting.get(&row.path));
        Texts {
            value: text_of(value).unwrap_or_default(),
            in_force: text_in(self.now),
            given: self.given.and_then(text_in),
            default: text_of(&row.spec.default).unwrap_or_default(),
            counting: counting.map(|weight| format::number((f64::from(*weight) * 1e3).round() / 1e3)),
        }
    }

    /// Name, control and the way back of a plain parameter. The controls of all rows begin at one line; in a narrow tile,
    /// each is below its name.
    fn cells(&mut self, ui: &mut Ui, row: &Row<'_>, value: &Value, texts: &Texts, depth: usize, refusal: Id) {
        let is_narrow = ui.available_width() < NARROW;
        if is_narrow {
            ui.horizontal(|ui| {
                ui.add_space(indent(depth));
                name_cell(ui, row, texts, ui.available_width());
            });
        }
        ui.horizontal(|ui| {
            let names = INDENT + ((ui.available_width() - INDENT) * 0.42).clamp(72.0, 220.0);
            ui.add_space(indent(depth));
            if !is_narrow {
                name_cell(ui, row, texts, (names - indent(depth)).max(48.0));
            }
            ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
                let (place, _) = ui.allocate_exact_size(Vec2::splat(20.0), egui::Sense::hover());
                // The control comes first, so that the keyboard reaches it before the arrow.
                ui.with_layout(Layout::left_to_right(Align::Center), |ui| {
                    if let Some((new, done)) = control(ui, row, value, refusal) {
                        self.edits.push((row.path.clone(), new));
                        *self.let_go |= done;
                    }
                });
                let mut child = ui.new_child(egui::UiBuilder::new().max_rect(place));
                if row.spec.file.is_none()
                    && let Some(back) = back(&mut child, &row.path, texts)
                {
                    self.edits.push((row.path.clone(), back));
                    *self.let_go = true;
                }
            });
        });
    }
}

/// The texts of a plain parameter.
struct Texts {
    /// Its value in the draft.
    value: String,
    in_force: Option<String>,
    /// What the stack gave it.
    given: Option<String>,
    default: String,
    /// What counts instead of what is in force.
    counting: Option<String>,
}

fn indent(depth: usize) -> f32 {
    INDENT + 12.0 * depth as f32
}

/// The name of a parameter, with what counts instead of it, and a mark where it was changed.
fn name_cell(ui: &mut Ui, row: &Row<'_>, texts: &Texts, width: f32) {
    let tokens = tokens(ui);
    let spec = row.spec;
    let name = if spec.name.is_empty() { row.path.rsplit('.').next().unwrap_or("") } else { &spec.name };
    let is_changed = texts.in_force.as_ref() != Some(&texts.value);
    let (rect, response) = ui.allocate_exact_size(Vec2::new(width, 20.0), egui::Sense::hover());
    let ink = if is_changed { tokens.strong } else { tokens.text };
    let font = egui::TextStyle::Body.resolve(ui.style());
    if let Some(counting) = &texts.counting {
        let text = format!("{name} (in force: {counting})");
        widgets::cell(ui, rect, Align::Min, &text, font, ink);
        response.widget_info(|| WidgetInfo::labeled(Role::Label, true, &text));
    } else {
        widgets::cell(ui, rect, Align::Min, name, font, ink);
    }
    if is_changed {
        // A mark beside the name, so that a change is not told by brightness alone.
        let at = rect.left_center() - Vec2::new(6.0, 0.0);
        ui.painter().circle_filled(at, 2.5, tokens.accent);
    }
    response.on_hover_ui(|ui| help(ui, row, texts));
}

/// The button that goes back to what the stack gave, or to the default where it gave nothing; returns that when it is
/// clicked.
fn back(ui: &mut Ui, path: &str, texts: &Texts) -> Option<String> {
    let (to, of) = match &texts.given {
        Some(given) => (given, "Value of the stack for"),
        None => (&texts.default, "Default of"),
    };
    if texts.value == *to {
        return None;
    }
    let button = widgets::icon_button(ui, icons::ICON_RESTART_ALT, &format!("{of} {path}: {to}"));
    button.clicked().then(|| to.clone())
}

/// The control of a plain parameter; returns the new text, and whether the control was let go. Why a number was refused is
/// kept at `refusal`.
fn control(ui: &mut Ui, row: &Row<'_>, value: &Value, refusal: Id) -> Option<(String, bool)> {
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
            let response = number_control(ui, spec, refusal, &mut new, unit);
            label(&response, Role::Slider);
            if new.is_nan() {
                return None;
            }
            let value = if new == shown { *number } else { new };
            changed(&response, value.to_string())
        }
        Value::Int(_) | Value::Uint(_) => {
            let number = value.as_i64()?;
            let shown = number as f64;
            let mut new = shown;
            let response = number_control(ui, spec, refusal, &mut new, unit);
            label(&response, Role::Slider);
            let value = if new == shown { number } else { new as i64 };
            changed(&response, value.to_string())
        }
        Value::Enum { name, .. } => {
            let mut chosen = None;
            // A wider one would widen the rows below, whose controls would begin elsewhere.
            let width = ui.available_width().min(140.0);
            let combo = egui::ComboBox::from_id_salt(&row.path).selected_text(name).width(width).truncate();
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

fn help(ui: &mut Ui, row: &Row<'_>, texts: &Texts) {
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
    for (name, value) in [
        ("value", texts.value.as_str()),
        ("range", range.as_str()),
        ("default", texts.default.as_str()),
        ("stack", texts.given.as_deref().unwrap_or_default()),
        ("in force", texts.in_force.as_deref().unwrap_or_default()),
        ("counts", texts.counting.as_deref().unwrap_or_default()),
    ] {
        if !value.is_empty() && value.len() < LONG_TEXT {
            widgets::name_value(ui, 64.0, name, widgets::mono(value));
        }
    }
    if texts.counting.is_some() {
        ui.label("The newest map was fused with what counts: a learned weight, or the one from before.");
    }
}

fn heading(ui: &mut Ui, depth: usize, name: &str, help: &str) {
    ui.horizontal(|ui| {
        ui.add_space(indent(depth));
        let response = ui.label(RichText::new(name).strong());
        if !help.is_empty() {
            response.on_hover_text(help);
        }
    });
}

fn note(ui: &mut Ui, depth: usize, text: &str) {
    let color = tokens(ui).weak;
    line(ui, depth, text, color);
}

fn line(ui: &mut Ui, depth: usize, text: &str, color: Color32) {
    ui.horizontal(|ui| {
        ui.add_space(indent(depth));
        ui.add(egui::Label::new(RichText::new(text).small().color(color)).wrap());
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable;

    /// A parameter of this name and kind, from 0 to 1.
    fn spec(name: &str, kind: ParamKind, fields: Vec<ParamSpec>) -> ParamSpec {
        ParamSpec {
            name: name.to_owned(),
            kind,
            unit: "1".to_owned(),
            min: Some(0.0),
            max: Some(1.0),
            default: Value::Float(0.5),
            help: String::new(),
            file: None,
            role: String::new(),
            choices: Vec::new(),
            fields,
        }
    }

    /// A row of a number, and one of a number within a group; of the second another weight counts.
    fn rows() -> Harness<'static> {
        let weight = spec("weight", ParamKind::Number, Vec::new());
        let group = spec("group", ParamKind::Group, vec![weight.clone()]);
        let within = Value::Message(vec![("weight".to_owned(), Value::Float(0.5))]);
        let params =
            Value::Message(vec![("weight".to_owned(), Value::Float(0.5)), ("group".to_owned(), within)]);
        let counting = BTreeMap::from([("group.weight".to_owned(), 0.25_f32)]);
        let mut harness = Harness::builder()
            .with_size(Vec2::new(500.0, 200.0))
            .with_context_setup(ocu_ui::install)
            .build_ui(move |ui| {
                let (mut edits, mut let_go) = (Vec::new(), false);
                let mut rows = Rows {
                    search: "",
                    now: &params,
                    given: None,
                    counting: Some(&counting),
                    is_replaced: false,
                    edits: &mut edits,
                    let_go: &mut let_go,
                };
                for spec in [&weight, &group] {
                    let value = params.field(&spec.name);
                    rows.ui(ui, &Row { spec, path: spec.name.clone(), value }, 0);
                }
            });
        harness.run();
        harness
    }

    #[test]
    fn the_controls_of_rows_within_groups_begin_where_those_of_others_do() {
        let harness = rows();
        let left = |path: &str| harness.get_by_role_and_label(Role::Slider, path).rect().left();
        assert_eq!(left("weight"), left("group.weight"));
    }

    #[test]
    fn a_choice_with_a_long_name_moves_no_control_below_it() {
        let spec = |name: &str, kind: ParamKind| spec(name, kind, Vec::new());
        let specs = [
            spec("above", ParamKind::Number),
            spec("kind", ParamKind::Choice),
            spec("below", ParamKind::Number),
        ];
        let choice = Value::Enum { number: 1, name: "SOURCE_RANGE".to_owned() };
        let values = [Value::Float(0.5), choice, Value::Float(0.5)];
        let mut harness = Harness::builder()
            .with_size(Vec2::new(500.0, 200.0))
            .with_context_setup(ocu_ui::install)
            .build_ui(move |ui| {
                ui.set_max_width(NARROW + 8.0);
                let now = Value::Message(Vec::new());
                let (mut edits, mut let_go) = (Vec::new(), false);
                let mut rows = Rows {
                    search: "",
                    now: &now,
                    given: None,
                    counting: None,
                    is_replaced: false,
                    edits: &mut edits,
                    let_go: &mut let_go,
                };
                for (spec, value) in specs.iter().zip(&values) {
                    rows.ui(ui, &Row { spec, path: spec.name.clone(), value: Some(value) }, 0);
                }
            });
        harness.run();
        let left = |path: &str| harness.get_by_label(path).rect().left();
        assert_eq!(left("above"), left("below"));
    }

    #[test]
    fn a_weight_that_counts_instead_of_that_of_the_parameters_is_shown_beside_its_name() {
        let harness = rows();
        let told: Vec<_> = harness.query_all_by_label_contains("in force:").collect();
        assert_eq!(told.len(), 1);
        assert!(harness.query_by_label("weight (in force: 0.25)").is_some());
    }
}
