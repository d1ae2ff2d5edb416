//! The badge for implausible values, which are left out of a view's extents.

use egui::{FontId, Rect, Ui, Vec2};
use ocu_ui::{icons, tokens};

/// Distance of the badge from the upper edge of the canvas, unless something else is there, screen points.
pub(crate) const DOWN: f32 = 44.0;
/// Topics that are named; the others are counted.
const MOST_NAMED: usize = 3;

/// Shows how many implausible values each topic has, `down` points below the edge of the canvas; nothing if none has any.
/// `what` names the values: `places`.
pub(crate) fn implausible<'a>(
    ui: &Ui,
    canvas: Rect,
    down: f32,
    what: &str,
    counts: impl IntoIterator<Item = (usize, &'a str)>,
) {
    let texts: Vec<String> = counts
        .into_iter()
        .filter(|(count, _)| *count > 0)
        .map(|(count, topic)| format!("{count} of {topic}"))
        .collect();
    if texts.is_empty() {
        return;
    }
    let more = texts.len().saturating_sub(MOST_NAMED);
    let named = texts[..texts.len() - more].join(", ");
    let more = if more > 0 { format!(", and {more} more layers") } else { String::new() };
    let text = format!("{}  {what} that cannot be: {named}{more}", icons::ICON_WARNING.codepoint);
    let painter = ui.painter_at(canvas);
    let galley = painter.layout_no_wrap(text, FontId::proportional(12.0), tokens(ui).warning);
    let at = canvas.center_top() + Vec2::new(-galley.size().x / 2.0, down);
    let plate = Rect::from_min_size(at, galley.size()).expand2(Vec2::new(6.0, 2.0));
    painter.rect_filled(plate, 2.0, tokens(ui).surface[3].gamma_multiply(0.92));
    painter.galley(at, galley, tokens(ui).warning);
}
