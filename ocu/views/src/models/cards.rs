//! One card per model: its name, its histograms, its numbers, and a button that deletes it.

use super::patch::{Atlas, Patch};
use super::read::{Histogram, Model, Models, Number};
use egui::{Align, Color32, FontId, Layout, Mesh, Pos2, Rect, RichText, Role, Sense, Ui, Vec2, WidgetInfo};
use ocu_ui::palette::{self, MapPalette};
use ocu_ui::{format, icons, tokens, widgets};
use rcs_msg::Stamp;

/// Width of a card with its margins.
const CARD: f32 = 232.0;
const MARGIN: f32 = 8.0;
/// Sides of a histogram with two axes, and height of one with bars.
const SQUARE: f32 = 120.0;
const BARS: f32 = 40.0;
/// Side of a picture.
const PATCH: f32 = 48.0;

/// What all cards share.
pub(super) struct Shown<'a> {
    pub(super) now: Stamp,
    pub(super) models: &'a Models,
    /// The pictures of the models.
    pub(super) pictures: Option<&'a Atlas>,
    /// Why none can be deleted.
    pub(super) refused: Option<&'a str>,
    /// The model whose deletion has been sent.
    pub(super) leaving: Option<usize>,
}

/// Paints all cards; returns the model to delete.
pub(super) fn show(ui: &mut Ui, shown: &Shown<'_>) -> Option<usize> {
    let models = shown.models;
    let mut deleted = None;
    ui.spacing_mut().item_spacing = Vec2::splat(8.0);
    egui::Frame::new().inner_margin(egui::Margin::same(8)).show(ui, |ui| {
        let columns = (((ui.available_width() + 8.0) / (CARD + 8.0)) as usize).max(1);
        let mut names = widgets::RowNames::default();
        for (row, line) in models.models.chunks(columns).enumerate() {
            ui.horizontal_top(|ui| {
                for (column, model) in line.iter().enumerate() {
                    let index = row * columns + column;
                    // One without a name is known by its number, as long as none comes or goes.
                    let count = (!model.is_named).then_some(models.models.len());
                    if names.named(ui, (&model.name, count), |ui| card(ui, shown, index, model)) {
                        deleted = Some(index);
                    }
                }
            });
        }
    });
    deleted
}

/// Paints a card; returns whether it is to be deleted.
fn card(ui: &mut Ui, shown: &Shown<'_>, index: usize, model: &Model) -> bool {
    let (now, refused) = (shown.now, shown.refused);
    let tokens = tokens(ui);
    let mut deleted = false;
    let frame = egui::Frame::new().fill(tokens.surface[3]).corner_radius(3.0).inner_margin(MARGIN);
    frame.show(ui, |ui| {
        ui.set_width(CARD - 2.0 * MARGIN);
        ui.with_layout(Layout::top_down(Align::Min), |ui| {
            ui.spacing_mut().item_spacing.y = 4.0;
            ui.horizontal(|ui| {
                ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
                    let name = format!("Delete {}", model.name);
                    let button =
                        widgets::icon_button_of(ui, icons::ICON_DELETE, &name, false, refused.is_none());
                    deleted = button.on_disabled_hover_text(refused.unwrap_or_default()).clicked();
                    ui.with_layout(Layout::left_to_right(Align::Center), |ui| {
                        let number = RichText::new(format!("{}", index + 1)).small().color(tokens.weak);
                        ui.label(number)
                            .on_hover_text("Its number, by which cells of a map name their model");
                        let name = RichText::new(&model.name).color(tokens.strong);
                        ui.add(egui::Label::new(name).truncate());
                        if !model.kind.is_empty() && !model.name.contains(&model.kind) {
                            widgets::tag(ui, &model.kind, tokens.text);
                        }
                        if shown.leaving == Some(index) {
                            widgets::tag(ui, "deleted next", tokens.warning)
                                .on_hover_text("The process deletes it in its next cycle");
                        }
                    });
                });
            });
            if let (Some(patch), Some(pictures)) = (&model.patch, shown.pictures) {
                picture(ui, now, pictures.of(ui.ctx(), index, patch), patch);
            }
            for histogram in &model.histograms {
                match histogram.axes {
                    Some(_) => plane(ui, histogram),
                    None => bars(ui, histogram),
                }
            }
            for (name, number) in &model.numbers {
                row(ui, name, *number, now);
            }
        });
    });
    deleted
}

/// The picture of a model, and beside it where it comes from.
fn picture(ui: &mut Ui, now: Stamp, (texture, part): (egui::TextureId, Rect), patch: &Patch) {
    let weak = tokens(ui).weak;
    let lines = match &patch.taken {
        None => ["colours of the histogram;".to_owned(), "blue is not known".to_owned()],
        Some((time, camera)) => {
            let ago = |time: &Stamp| format!("seen {} ago", format::age(now.seconds_since(*time).max(0.0)));
            [time.as_ref().map(ago).unwrap_or_default(), camera.clone()]
        }
    };
    ui.horizontal(|ui| {
        let (rect, response) = ui.allocate_exact_size(Vec2::splat(PATCH), Sense::hover());
        let name = if patch.taken.is_some() { "Picture of the model" } else { "Colours of the model" };
        response.widget_info(|| WidgetInfo::labeled(Role::Image, true, name));
        ui.painter().image(texture, rect, part, Color32::WHITE);
        ui.vertical(|ui| {
            ui.spacing_mut().item_spacing.y = 0.0;
            for line in lines.iter().filter(|line| !line.is_empty()) {
                ui.add(egui::Label::new(RichText::new(line).small().color(weak)).truncate());
            }
        });
    });
}

fn row(ui: &mut Ui, name: &str, number: Number, now: Stamp) {
    let tokens = tokens(ui);
    let (rect, response) = ui.allocate_exact_size(Vec2::new(ui.available_width(), 16.0), Sense::hover());
    let text = number.text(now);
    response.widget_info(|| WidgetInfo::labeled(Role::Label, true, format!("{name} {text}")));
    let (left, right) = rect.split_left_right_at_fraction(0.52);
    widgets::cell(ui, left, Align::Min, name, FontId::proportional(12.0), tokens.weak);
    widgets::cell(ui, right, Align::Max, &text, FontId::monospace(11.5), tokens.text);
    if let Number::Fraction(part) = number {
        let bar = Rect::from_min_max(right.left_top(), right.right_bottom() - Vec2::new(48.0, 0.0));
        let bar = bar.shrink2(Vec2::new(0.0, 4.0));
        ui.painter().rect_filled(bar, 1.0, tokens.surface[0]);
        let filled = Rect::from_min_size(bar.min, Vec2::new(bar.width() * part as f32, bar.height()));
        ui.painter().rect_filled(filled, 1.0, MapPalette::Papers.cost((part * 250.0) as u8));
    }
}

/// The name of a histogram, and the place for it.
fn place(ui: &mut Ui, histogram: &Histogram, size: Vec2) -> Rect {
    let caption = match &histogram.axes {
        Some([outer, inner]) => format!("{}: {inner} by {outer}", histogram.name),
        None => histogram.name.clone(),
    };
    ui.label(RichText::new(&caption).small().color(tokens(ui).weak));
    let (rect, response) = ui.allocate_exact_size(size, Sense::hover());
    response.widget_info(|| WidgetInfo::labeled(Role::Image, true, format!("Histogram of {caption}")));
    ui.painter().rect_filled(rect, 0.0, tokens(ui).canvas());
    rect
}

/// A histogram with two axes: the inner one to the right, the outer one upward. Colours follow the square root, so that
/// rare values can be seen beside frequent ones.
fn plane(ui: &mut Ui, histogram: &Histogram) {
    let rect = place(ui, histogram, Vec2::splat(SQUARE));
    let rows = histogram.counts.len() / histogram.columns.max(1);
    let cell = Vec2::new(rect.width() / histogram.columns as f32, rect.height() / rows as f32);
    let most = histogram.most();
    let mut mesh = Mesh::default();
    for (index, count) in histogram.counts.iter().enumerate().filter(|(_, count)| **count > 0.0) {
        let (row, column) = (index / histogram.columns, index % histogram.columns);
        let corner = rect.left_bottom() + Vec2::new(column as f32 * cell.x, -((row + 1) as f32) * cell.y);
        let color = palette::even(f64::from((count / most).sqrt()).clamp(0.0, 1.0));
        mesh.add_colored_rect(Rect::from_min_size(corner, cell), color);
    }
    ui.painter().add(mesh);
}

/// A histogram with one axis.
fn bars(ui: &mut Ui, histogram: &Histogram) {
    let rect = place(ui, histogram, Vec2::new(ui.available_width(), BARS));
    let color: Color32 = tokens(ui).series(0);
    let width = rect.width() / histogram.counts.len() as f32;
    let most = histogram.most();
    let mut mesh = Mesh::default();
    for (index, count) in histogram.counts.iter().enumerate().filter(|(_, count)| **count > 0.0) {
        let left = rect.left() + index as f32 * width;
        let top = rect.bottom() - rect.height() * (count / most).min(1.0);
        let gap = if width > 3.0 { 1.0 } else { 0.0 };
        let bar = Rect::from_min_max(Pos2::new(left, top), Pos2::new(left + width - gap, rect.bottom()));
        mesh.add_colored_rect(bar, color);
    }
    ui.painter().add(mesh);
}
