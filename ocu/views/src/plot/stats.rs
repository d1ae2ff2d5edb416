//! Statistics of the visible part of each curve, or of the part between the two cursors.

use super::axis::{among, shortened};
use super::paint::Clock;
use crate::series::Shown;
use egui::{Align, FontId, Rect, Sense, Ui, Vec2, WidgetInfo};
use ocu_ui::{format, tokens, widgets};
use rcs_formula::Moments;
use rcs_msg::Stamp;
use rcs_runtime::source::moments;

const ROW: f32 = 18.0;
const CELL: f32 = 84.0;
/// Number of characters that find room in a cell.
const MOST_CHARACTERS: usize = 11;
const TITLES: [&str; 8] =
    ["points", "least", "greatest", "mean", "deviation", "integral · s", "change", "rate · Hz"];

/// Height of the table.
pub(super) fn height(curves: usize) -> f32 {
    ROW * (curves as f32 + 1.0) + 8.0
}

/// The statistics of the points of a curve from a time to a time.
pub(super) fn of(shown: &Shown, from: Stamp, to: Stamp) -> Option<Moments> {
    let first = shown.points.count_before(from);
    moments(&shown.points, first..shown.points.count_until(to))
}

/// The cells of a row.
fn cells(moments: &Moments) -> [String; 8] {
    let or_dash = |value: Option<f64>, text: &dyn Fn(f64) -> String| {
        value.filter(|value| value.is_finite()).map_or("–".to_owned(), text)
    };
    let number = |value: Option<f64>| or_dash(value, &format::number);
    let spread = moments.max - moments.min;
    let of_curve = |value: Option<f64>| or_dash(value, &|value| among(value, spread));
    let known = |value: f64| (moments.finite > 0).then_some(value);
    let change = moments.last.1 - moments.first.1;
    let rate = (moments.points as f64 - 1.0) / moments.duration_s();
    [
        format::count(moments.points as u64),
        of_curve(known(moments.min)),
        of_curve(known(moments.max)),
        of_curve(moments.mean()),
        number(moments.deviation()),
        number(known(moments.integral)),
        number(Some(change)),
        number(Some(rate).filter(|_| moments.points > 1)),
    ]
}

/// Paints the table.
pub(super) fn table(ui: &mut Ui, clock: Clock, range: (f64, f64), curves: &[(String, egui::Color32, Shown)]) {
    let tokens = tokens(ui);
    let (rect, _) =
        ui.allocate_exact_size(Vec2::new(ui.available_width(), height(curves.len())), Sense::hover());
    ui.painter().hline(rect.x_range(), rect.top() + 0.5, egui::Stroke::new(1.0, tokens.line));
    let fits = (((rect.width() - 140.0) / CELL) as usize).clamp(1, TITLES.len());
    let row_at = |index: usize| {
        let top = rect.top() + 4.0 + ROW * index as f32;
        Rect::from_min_size(egui::Pos2::new(rect.left(), top), Vec2::new(rect.width(), ROW))
    };
    let cell_at = |row: Rect, column: usize| {
        let right = row.right() - 8.0 - CELL * (fits - 1 - column) as f32;
        Rect::from_x_y_ranges(right - CELL + 6.0..=right, row.y_range())
    };
    let small = FontId::proportional(11.0);
    let row = row_at(0);
    let span = format!("{} – {}", format::elapsed(range.0), format::elapsed(range.1));
    let name = |row: Rect| Rect::from_x_y_ranges(row.left() + 8.0..=cell_at(row, 0).left(), row.y_range());
    widgets::cell(ui, name(row), Align::Min, &span, small.clone(), tokens.weak);
    for (column, title) in TITLES.iter().take(fits).enumerate() {
        widgets::cell(ui, cell_at(row, column), Align::Max, title, small.clone(), tokens.weak);
    }
    for (index, (label, color, shown)) in curves.iter().enumerate() {
        let row = row_at(index + 1);
        let found = of(shown, clock.stamp(range.0), clock.stamp(range.1)).filter(|_| !shown.are_states());
        let texts = found.as_ref().map(cells);
        let response = ui.interact(row, ui.scope_id().with(("statistics", index)), Sense::hover());
        let said = texts.as_ref().map(|texts| {
            let said = TITLES.iter().zip(texts).map(|(title, text)| format!("{title} {text}"));
            format!("{label}: {}", said.collect::<Vec<_>>().join(", "))
        });
        response.widget_info(|| {
            WidgetInfo::labeled(egui::Role::Label, true, said.clone().unwrap_or_else(|| label.clone()))
        });
        let is_long = |text: &String| text.chars().count() > MOST_CHARACTERS;
        if let Some(said) = said.filter(|_| texts.iter().flatten().any(is_long)) {
            response.on_hover_text_at_pointer(said);
        }
        let swatch =
            Rect::from_center_size(egui::Pos2::new(row.left() + 12.0, row.center().y), Vec2::new(8.0, 3.0));
        ui.painter().rect_filled(swatch, 1.0, *color);
        let name = name(row);
        widgets::cell(ui, name.with_min_x(name.left() + 16.0), Align::Min, label, small.clone(), tokens.text);
        for (column, text) in texts.iter().flatten().take(fits).enumerate() {
            let text = shortened(text, MOST_CHARACTERS);
            widgets::cell(ui, cell_at(row, column), Align::Max, &text, FontId::monospace(11.0), tokens.text);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcs_runtime::source::FieldPoint;

    #[test]
    fn the_least_and_the_greatest_of_nearly_equal_values_differ() {
        let cells_of = |values: [f64; 3]| {
            let point = |(value, i): (f64, u64)| FieldPoint { stamp: Stamp(i * 1_000_000_000), value };
            let points = values.into_iter().zip(0..).map(point).collect();
            let shown = Shown { points, ..Shown::default() };
            let found = of(&shown, Stamp(0), Stamp(2_000_000_000));
            let [_, least, greatest, mean, ..] = found.map(|found| cells(&found)).unwrap_or_default();
            [least, greatest, mean]
        };
        assert_eq!(
            cells_of([-71.094_121_2, -71.094_571_2, -71.094_421_2]),
            ["-71.094571", "-71.094121", "-71.094371"]
        );
        assert_eq!(
            cells_of([5_300_110.0, 5_300_150.0, 5_300_131.0]),
            ["5300110.0", "5300150.0", "5300130.3"]
        );
        assert_eq!(
            cells_of([2e12, 2e12 + 500.0, 2e12 + 250.0]),
            ["2000000000000", "2000000000500", "2000000000250"]
        );
        assert_eq!(
            cells_of([1.7e18, 1.7e18 + 6e10, 1.7e18 + 3e10]),
            ["1.7000000000e18", "1.7000000600e18", "1.7000000300e18"]
        );
        assert_eq!(cells_of([0.5, 1.25, 1.0 / 3.0]), ["0.33333", "1.25", "0.69444"]);
        assert_eq!(cells_of([42.377_123_4; 3]), ["42.377"; 3]);
    }
}
