//! Small widgets shared by several views. Each has a name for screen readers.

use crate::{Icon, icons, tokens, typing};
use egui::{
    Align2, Button, Color32, FontId, Label, Rect, RectAlign, Response, RichText, Role, Sense, TextEdit,
    TextStyle, Tooltip, Ui, Vec2, WidgetInfo,
};

/// Size of the icon of an empty panel.
const ICON_OF_EMPTY: f32 = 28.0;
/// Distance of help from what it is of, so that it lies beside the scroll bar of a list.
const GAP_OF_HELP: f32 = 12.0;

/// Monospaced text, for numbers and paths.
pub fn mono(text: impl Into<String>) -> RichText {
    RichText::new(text).monospace()
}

/// An icon button; `name` is shown on hover and read by screen readers.
pub fn icon_button(ui: &mut Ui, icon: Icon, name: &str) -> Response {
    icon_button_of(ui, icon, name, false, true)
}

/// An icon button that toggles a value.
pub fn icon_toggle(ui: &mut Ui, icon: Icon, name: &str, on: &mut bool) -> Response {
    let response = icon_button_of(ui, icon, name, *on, true);
    if response.clicked() {
        *on = !*on;
    }
    response
}

/// An icon button with a given state, which can be disabled.
pub fn icon_button_of(ui: &mut Ui, icon: Icon, name: &str, on: bool, enabled: bool) -> Response {
    let text = icon.rich_text().size(16.0);
    let button = Button::selectable(on, text).min_size(Vec2::splat(20.0));
    let response = ui.scope(|ui| {
        ui.spacing_mut().button_padding = Vec2::splat(2.0);
        ui.add_enabled(enabled, button)
    });
    let response = response.inner;
    response.widget_info(|| WidgetInfo::selected(Role::Button, enabled, on, name));
    response.on_hover_text(name).on_disabled_hover_text(name)
}

/// A search field; `name` is its hint and is read by screen readers. Escape and the cross clear it.
pub fn search(ui: &mut Ui, text: &mut String, name: &str) -> Response {
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 4.0;
        let (glass, _) = ui.allocate_exact_size(Vec2::splat(16.0), Sense::hover());
        icon_at(ui.painter(), glass.center(), icons::ICON_SEARCH, 15.0, tokens(ui).weak);
        // The cross comes one pass after the text: the field, which was painted before, leaves room for it.
        let has_cross = !text.is_empty();
        let cross = if has_cross { 24.0 } else { 0.0 };
        let edit = TextEdit::singleline(text).hint_text(name).desired_width(ui.available_width() - cross);
        let response = ui.add(edit);
        typing::note(&response);
        ui.ctx().accesskit_node_builder(response.id, |node| node.set_label(name));
        if response.has_focus() && ui.input(|input| input.key_pressed(egui::Key::Escape)) {
            text.clear();
        }
        if has_cross && icon_button(ui, icons::ICON_CLOSE, "Clear the search").clicked() {
            text.clear();
        }
        response
    })
    .inner
}

/// Text of an empty panel: what it would show, and how to get it. Where there is little height, the icon gives way to the
/// text, and then the hint to the title.
pub fn empty(ui: &mut Ui, icon: Icon, title: &str, hint: &str) {
    let tokens = tokens(ui);
    let room = ui.available_size();
    let gap = ui.spacing().item_spacing.y;
    let height_of = |text: &str, style: TextStyle| {
        let galley = ui.painter().layout(text.to_owned(), style.resolve(ui.style()), tokens.text, room.x);
        galley.size().y + gap
    };
    let title_height = height_of(title, TextStyle::Body);
    let text_height = title_height + height_of(hint, TextStyle::Small);
    let icon_height = ICON_OF_EMPTY * 1.5 + gap;
    let has_icon = icon_height + text_height <= room.y;
    let has_hint = text_height <= room.y;
    let free = match (has_icon, has_hint) {
        (true, _) => room.y - icon_height - text_height,
        (false, true) => room.y - text_height,
        (false, false) => room.y - title_height,
    };
    let above = if has_icon { (room.y / 2.0 - 48.0).max(8.0).min(free) } else { free / 2.0 };
    ui.vertical_centered(|ui| {
        ui.add_space(above.max(0.0));
        if has_icon {
            ui.label(icon.rich_text().size(ICON_OF_EMPTY).color(tokens.unknown));
        }
        let said = ui.add(Label::new(RichText::new(title).color(tokens.text)).wrap());
        if has_hint {
            ui.add(Label::new(RichText::new(hint).small().color(tokens.weak)).wrap());
        } else {
            said.on_hover_text(hint);
        }
    });
}

/// Shows help beside a widget. A tooltip below it would cover the next entry of a list.
pub fn help_beside(response: Response, help: &str) -> Response {
    const INSTEAD: [RectAlign; 3] = [RectAlign::LEFT_START, RectAlign::TOP_START, RectAlign::BOTTOM_START];
    // As a tooltip of `egui` does.
    response.ctx.accesskit_node_builder(response.id, |node| node.set_description(help));
    let mut tooltip = Tooltip::for_enabled(&response).gap(GAP_OF_HELP);
    tooltip.popup = tooltip.popup.align(RectAlign::RIGHT_START).align_alternatives(&INSTEAD);
    tooltip.show(|ui| {
        ui.set_max_width(ui.spacing().tooltip_width);
        ui.label(help);
    });
    response
}

/// A word in a coloured outline, for a state that must not be shown by colour alone.
pub fn tag(ui: &mut Ui, text: &str, color: Color32) -> Response {
    let response = outlined(ui, text, color, Sense::hover());
    response.widget_info(|| WidgetInfo::labeled(Role::Label, true, text));
    response
}

/// The same as a button, which is brighter under the pointer.
pub fn tag_button(ui: &mut Ui, text: &str, color: Color32) -> Response {
    let response = outlined(ui, text, color, Sense::click());
    response.widget_info(|| WidgetInfo::labeled(Role::Button, true, text));
    response.on_hover_cursor(egui::CursorIcon::PointingHand)
}

/// Paints a word in a coloured outline.
fn outlined(ui: &mut Ui, text: &str, color: Color32, sense: Sense) -> Response {
    let galley = ui.painter().layout_no_wrap(text.to_owned(), FontId::proportional(11.0), color);
    let (rect, response) = ui.allocate_exact_size(Vec2::new(galley.size().x + 8.0, 16.0), sense);
    let is_bright = sense.senses_click() && response.hovered();
    let fill = color.gamma_multiply(if is_bright { 0.3 } else { 0.1 });
    let stroke = egui::Stroke::new(1.0, color.gamma_multiply(0.7));
    ui.painter().rect(rect, 3.0, fill, stroke, egui::StrokeKind::Inside);
    ui.painter().galley(rect.center() - galley.size() / 2.0, galley, color);
    response
}

/// A name and a value in two columns; the first is `name_width` wide.
pub fn name_value(ui: &mut Ui, name_width: f32, name: &str, value: RichText) -> Response {
    ui.horizontal(|ui| {
        let (rect, _) = ui.allocate_exact_size(Vec2::new(name_width, 16.0), Sense::hover());
        let weak = tokens(ui).weak;
        ui.painter().text(rect.left_center(), Align2::LEFT_CENTER, name, FontId::proportional(12.0), weak);
        ui.add(Label::new(value).truncate())
    })
    .inner
}

/// Paints widgets whose ids follow from this name, which is unique within the parent, and not from the count of the widgets
/// before them: a press and its release are a click, and a drag goes on, although a widget before them comes or goes.
/// [`RowNames`] paints rows of which several may have the same name.
pub fn named<R>(ui: &mut Ui, name: impl egui::AsIdSalt, add: impl FnOnce(&mut Ui) -> R) -> R {
    let builder = egui::UiBuilder::new().scope_id(ui.scope_id().with(name));
    ui.scope_builder(builder, add).inner
}

/// What the widget stood for when the press on it began, and before that in the last pass: what the person has read. `now` is
/// what it stands for in this pass. To be called in each pass.
pub fn as_pressed<T: Clone + Send + Sync + 'static>(response: &Response, now: T) -> T {
    let id = response.id.with("as pressed");
    let read = response.ctx.data(|data| data.get_temp(id)).unwrap_or_else(|| now.clone());
    if !response.is_pointer_button_down_on() {
        response.ctx.data_mut(|data| data.insert_temp(id, now));
    }
    read
}

/// The names of the rows of a list, with how many rows in this pass had each of them so far.
#[derive(Debug, Default)]
pub struct RowNames(egui::IdSaltMap<usize>);

impl RowNames {
    /// Paints the next row like [`named`]; rows with the same name are told apart by their order.
    pub fn named<R>(&mut self, ui: &mut Ui, name: impl egui::AsIdSalt, add: impl FnOnce(&mut Ui) -> R) -> R {
        let count = self.0.entry(egui::IdSalt::new(&name)).or_default();
        *count += 1;
        named(ui, (name, *count), add)
    }
}

/// An icon centred at a point. The glyphs of the icon font are slightly too low, which is corrected here.
pub fn icon_at(painter: &egui::Painter, center: egui::Pos2, icon: Icon, size: f32, color: Color32) {
    let at = center - Vec2::new(0.0, (size * 0.12).round());
    painter.text(at, Align2::CENTER_CENTER, icon.codepoint, FontId::new(size, icon.font_family()), color);
}

/// Moves the cursor of a text field behind its text.
pub fn cursor_to_end(ctx: &egui::Context, id: egui::Id, text: &str) {
    if let Some(mut state) = egui::TextEdit::load_state(ctx, id) {
        let end = egui::text::CCursor::new(text.chars().count());
        state.cursor.set_char_range(Some(egui::text::CCursorRange::one(end)));
        state.store(ctx, id);
    }
}

/// A table cell, painted without a widget of its own; text is clipped to the rectangle.
pub fn cell(ui: &Ui, rect: Rect, align: egui::Align, text: &str, font: FontId, color: Color32) {
    cell_by(ui.painter(), rect, align, text, font, color);
}

/// The same with a painter of the caller's; returns the width of the text.
pub fn cell_by(
    painter: &egui::Painter,
    rect: Rect,
    align: egui::Align,
    text: &str,
    font: FontId,
    color: Color32,
) -> f32 {
    let mut job = egui::text::LayoutJob::simple_singleline(text.to_owned(), font, color);
    job.wrap = egui::text::TextWrapping::truncate_at_width(rect.width().max(1.0));
    let galley = painter.layout_job(job);
    let at = match align {
        egui::Align::Min => Align2::LEFT_CENTER,
        egui::Align::Center => Align2::CENTER_CENTER,
        egui::Align::Max => Align2::RIGHT_CENTER,
    }
    .align_size_within_rect(galley.size(), rect);
    painter.galley(at.min, galley, color);
    at.width()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_search_field_keeps_its_width_when_its_cross_comes() {
        let ctx = egui::Context::default();
        crate::install(&ctx);
        let mut text = String::new();
        for events in [Vec::new(), vec![egui::Event::Text("z".to_owned())], Vec::new()] {
            let mut width = 0.0;
            let output = ctx.run_ui(egui::RawInput { events, ..egui::RawInput::default() }, |ui| {
                let field = |ui: &mut Ui| {
                    ui.set_max_width(220.0);
                    search(ui, &mut text, "Search steps").request_focus();
                };
                width = ui.scope(field).response.rect.width();
            });
            output.drop_without_applying_deltas();
            assert!((width - 220.0).abs() < 4.0, "{width} {text:?}");
        }
        assert_eq!(text, "z");
    }
}
