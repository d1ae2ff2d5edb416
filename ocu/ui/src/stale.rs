//! How an outdated value is marked: desaturated, hatched, and with its age; never by colour alone.

use crate::{format, icons, tokens, widgets};
use egui::{Color32, FontId, Pos2, Rect, Shape, Stroke, Ui, Vec2};

/// The age up to which no value is outdated, whatever its rate, s.
pub const LEAST_S: f64 = 1.2;

/// The age from which a value with this rate is outdated: three periods, and at least [`LEAST_S`]. `None` where the rate is
/// unknown.
pub fn limit_s(hz: f64) -> Option<f64> {
    (hz.is_finite() && hz > 0.0).then(|| (3.0 / hz).max(LEAST_S))
}

/// Whether a value with this age and rate is outdated. A value that was sent only once never is: nothing says when the
/// next one is due.
pub fn is_stale(age_s: f64, hz: f64) -> bool {
    limit_s(hz).is_some_and(|limit| age_s > limit)
}

/// Covers an outdated image: grey, hatched, with its age in the corner.
pub fn cover(ui: &Ui, rect: Rect, age_s: f64) {
    let tokens = tokens(ui);
    let painter = ui.painter_at(rect);
    painter.rect_filled(rect, 0.0, tokens.surface[2].gamma_multiply(0.5));
    hatch(&painter, rect, tokens.stale.gamma_multiply(0.5));
    tag(ui, rect.left_top() + Vec2::splat(8.0), age_s);
}

/// Diagonal lines, 16 points apart.
pub fn hatch(painter: &egui::Painter, rect: Rect, color: Color32) {
    let stroke = Stroke::new(1.0, color);
    let mut x = rect.left() - rect.height();
    let mut lines = Vec::new();
    while x < rect.right() {
        lines.push(Shape::line_segment(
            [Pos2::new(x, rect.bottom()), Pos2::new(x + rect.height(), rect.top())],
            stroke,
        ));
        x += 16.0;
    }
    painter.with_clip_rect(painter.clip_rect().intersect(rect)).extend(lines);
}

/// A tag with the age of an image; its top left corner is at `at`.
pub fn tag(ui: &Ui, at: Pos2, age_s: f64) {
    let tokens = tokens(ui);
    let painter = ui.painter();
    let text = format!("old: {}", format::age(age_s));

    let text = painter.layout_no_wrap(text, FontId::proportional(12.0), tokens.strong);
    let size = Vec2::new(text.size().x + 28.0, 20.0);
    let rect = Rect::from_min_size(at, size);
    painter.rect(rect, 3.0, tokens.surface[3], Stroke::new(1.0, tokens.stale), egui::StrokeKind::Inside);
    let icon_at = Pos2::new(rect.left() + 12.0, rect.center().y);
    widgets::icon_at(painter, icon_at, icons::ICON_HISTORY, 13.0, tokens.stale);
    painter.galley(Pos2::new(rect.left() + 22.0, rect.center().y - text.size().y / 2.0), text, tokens.strong);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_is_old_after_three_of_its_periods_and_never_before_a_second() {
        assert!(!is_stale(1.1, 30.0) && is_stale(1.3, 30.0));
        assert!(!is_stale(29.0, 0.1) && is_stale(31.0, 0.1));
        assert!(!is_stale(1e9, 0.0) && !is_stale(1e9, f64::NAN));
    }
}
