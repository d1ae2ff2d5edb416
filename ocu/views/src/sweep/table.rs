//! The table of the runs of a sweep.

use super::state::{SweepRow, SweepState};
use crate::view::{ViewContext, Wish};
use egui::{Align, FontId, Rect, Role, ScrollArea, Sense, Ui, Vec2, WidgetInfo};
use ocu_ui::{format, short_name, tokens, widgets};

const ROW: f32 = 20.0;
const GAP: f32 = 8.0;

/// Columns with the least width of the table in which each is shown, its width (0 for a share of the rest), and where
/// its text is.
const COLUMNS: [(&str, f32, f32, Align); 8] = [
    ("parameters", 0.0, 0.0, Align::Min),
    ("seed", 0.0, 40.0, Align::Max),
    ("outcome", 0.0, 76.0, Align::Min),
    ("time s", 300.0, 56.0, Align::Max),
    ("remaining m", 460.0, 76.0, Align::Max),
    ("collisions", 560.0, 64.0, Align::Max),
    ("bumper", 620.0, 52.0, Align::Max),
    ("errors", 720.0, 0.0, Align::Min),
];

/// Paints the table.
pub(super) fn ui(ui: &mut Ui, cx: &mut ViewContext<'_>, state: &SweepState) {
    if state.rows.is_empty() {
        return;
    }
    let (rect, _) = ui.allocate_exact_size(Vec2::new(ui.available_width(), ROW), Sense::hover());
    let line = egui::Stroke::new(1.0, tokens(ui).line);
    ui.painter().hline(rect.x_range(), rect.bottom() - 0.5, line);
    let (weak, font) = (tokens(ui).weak, FontId::proportional(11.0));
    for ((name, _, _, align), place) in COLUMNS.iter().zip(places(rect)) {
        if let Some(place) = place {
            widgets::cell(ui, place, *align, name, font.clone(), weak);
        }
    }
    ui.spacing_mut().item_spacing.y = 0.0;
    ScrollArea::vertical().auto_shrink(false).show_rows(ui, ROW, state.rows.len(), |ui, range| {
        let rows = state.rows.get(range).unwrap_or_default();
        let params: Vec<&str> = rows.iter().map(|row| row.params.as_str()).collect();
        for row in rows {
            row_ui(ui, cx, row, &params);
        }
    });
}

/// The places of the columns; a column for which there is no room has none.
fn places(rect: Rect) -> [Option<Rect>; 8] {
    let inner = rect.shrink2(Vec2::new(8.0, 0.0));
    let shown = COLUMNS.map(|(_, least, width, _)| (rect.width() >= least).then_some(width));
    let fixed: f32 = shown.iter().flatten().map(|width| width + GAP).sum();
    let shares = shown.iter().flatten().filter(|width| **width == 0.0).count().max(1) as f32;
    let rest = ((inner.width() - fixed + GAP) / shares).max(24.0);
    let mut left = inner.left();
    shown.map(|width| {
        width.map(|width| {
            let width = if width == 0.0 { rest } else { width };
            let place = Rect::from_x_y_ranges(left..=left + width, rect.y_range());
            left += width + GAP;
            place
        })
    })
}

/// Paints a run; `params` are the parameters of all rows that are seen.
fn row_ui(ui: &mut Ui, cx: &mut ViewContext<'_>, row: &SweepRow, params: &[&str]) {
    let tokens = tokens(ui);
    let size = Vec2::new(ui.available_width(), ROW);
    let (rect, response) = match &row.recording {
        // Another sweep may take the place of this one while the mouse is pressed.
        Some(path) => widgets::named(ui, path, |ui| ui.allocate_exact_size(size, Sense::click())),
        None => ui.allocate_exact_size(size, Sense::hover()),
    };
    if response.hovered() && row.recording.is_some() {
        ui.painter().rect_filled(rect, 0.0, tokens.surface[3]);
    }
    let ink = match row.reached {
        Some(true) => tokens.ok,
        Some(false) => tokens.error,
        None if row.outcome == "failed" => tokens.error,
        None => tokens.text,
    };
    let of = |text: &dyn Fn((f64, u32, u32)) -> String| row.course.map(text).unwrap_or_default();
    let texts = [
        row.params.clone(),
        row.seed.to_string(),
        row.outcome.clone(),
        format::number((row.time_s * 100.0).round() * 0.01),
        of(&|(remaining_m, ..)| format!("{remaining_m:.2}")),
        of(&|(_, collisions, _)| collisions.to_string()),
        of(&|(.., bumper_hits)| bumper_hits.to_string()),
        row.errors.clone(),
    ];
    let font = FontId::monospace(11.5);
    for (index, ((text, place), (.., align))) in texts.iter().zip(places(rect)).zip(COLUMNS).enumerate() {
        let color = match index {
            2 => ink,
            7 => tokens.warning,
            _ => tokens.text,
        };
        match place {
            Some(place) if index == 0 => {
                short_name::cell(ui.painter(), place, align, text, params, &font, color);
            }
            Some(place) => widgets::cell(ui, place, align, text, font.clone(), color),
            None => {}
        }
    }
    let with = if row.params.is_empty() { String::new() } else { format!(" {}", row.params) };
    let name = format!("Run with seed {}{with}: {}", row.seed, row.outcome);
    response.widget_info(|| WidgetInfo::labeled(Role::Button, true, &name));
    if let Some(path) = row.recording.as_ref().filter(|_| response.clicked()) {
        let params = if row.params.is_empty() { String::new() } else { format!("{}, ", row.params) };
        let title = format!("{params}seed {}", row.seed);
        cx.wishes.push(Wish::OpenRun { path: path.clone(), title });
    }
    response.on_hover_ui(|ui| {
        ui.label(&name);
        if !row.errors.is_empty() {
            ui.label(&row.errors);
        }
        if row.recording.is_some() {
            ui.label("Click to open this run: it is computed again, with the same result.");
        }
    });
}
