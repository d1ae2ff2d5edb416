//! The first difference of each buffer, by time: how a difference spreads.

use super::{font, side};
use crate::view::{FieldKey, Hover, RunChoice, TopicKey, ViewContext, Wish};
use egui::{Align, FontId, Rect, Role, ScrollArea, Sense, Ui, Vec2, WidgetInfo};
use ocu_ui::{format, icons, short_name, tokens, widgets};
use rcs_runtime::Difference;
use rcs_runtime::source::{Compared, Comparison, Control, Frame};

const ROW: f32 = 20.0;
const GAP: f32 = 8.0;
/// Width of the column with the time.
const TIME: f32 = 96.0;
/// Number of characters before the first difference of two values that are shown where these are cut at their beginning.
const BEFORE: usize = 3;

/// Columns after the time, with the least width of the table in which each is shown, and its share of the room.
const COLUMNS: [(&str, f32, f32); 5] = [
    ("buffer", 0.0, 3.0),
    ("written by", 560.0, 1.6),
    ("field", 320.0, 2.0),
    ("", 240.0, 1.8),
    ("", 240.0, 1.8),
];

/// Paints the table. `names` are those of both sides.
pub(super) fn ui(ui: &mut Ui, cx: &mut ViewContext<'_>, comparison: &Comparison, names: &[String; 2]) {
    let differences = &comparison.differences;
    if differences.is_empty() {
        let (equal, compared) = no_difference(cx.frame, comparison);
        let (title, hint) = match (comparison.progress, comparison.until) {
            (Some(_), _) => ("Comparing…", "Nothing differs so far."),
            (None, None) if comparison.problem.is_some() => {
                ("Nothing was compared", "The line above says why.")
            }
            (None, None) => ("Nothing was compared", "Both sides need a common time."),
            (None, Some(_)) => (&*equal, compared),
        };
        return widgets::empty(ui, icons::ICON_COMPARE, title, hint);
    }
    header(ui, names);
    let buffers: Vec<&str> = differences.iter().map(|difference| difference.buffer.as_str()).collect();
    ui.spacing_mut().item_spacing.y = 0.0;
    ScrollArea::vertical().auto_shrink(false).show_rows(ui, ROW, differences.len(), |ui, range| {
        for index in range {
            let Some(difference) = differences.get(index) else { continue };
            row(ui, cx, comparison, difference, &buffers);
        }
    });
}

/// Up to when nothing differs, and what was compared. One side may have ended before the other, and not all may have been
/// compared up to there.
fn no_difference(frame: &Frame, comparison: &Comparison) -> (String, &'static str) {
    let first_end = side::first_end(frame, comparison);
    let end = first_end.as_ref().map(|(_, end)| *end);
    let has_all = comparison.problem.is_none() && comparison.gaps.is_empty() && comparison.until >= end;
    if !has_all {
        return ("No difference in what was compared".to_owned(), "The line above says what that was.");
    }
    let title = match first_end {
        None => "No difference".to_owned(),
        Some((name, end)) => {
            let end_s = end.seconds_since(frame.info.start);
            format!("No difference up to {end_s:.2} s, where {name} ends")
        }
    };
    (title, "Every message of every common buffer has the same bytes.")
}

/// The places of the time and of the other columns; a column for which there is no room has none.
fn places(rect: Rect) -> (Rect, [Option<Rect>; 5]) {
    let inner = rect.shrink2(Vec2::new(8.0, 0.0));
    let time = Rect::from_x_y_ranges(inner.left()..=(inner.left() + TIME).min(inner.right()), rect.y_range());
    let shown = COLUMNS.map(|(_, least, share)| if rect.width() >= least { share } else { 0.0 });
    let shares: f32 = shown.iter().sum();
    let count = shown.iter().filter(|share| **share > 0.0).count() as f32;
    let room = (inner.right() - time.right() - count * GAP).max(1.0);
    let mut left = time.right() + GAP;
    let places = shown.map(|share| {
        (share > 0.0).then(|| {
            let width = room * share / shares;
            let place = Rect::from_x_y_ranges(left..=left + width, rect.y_range());
            left += width + GAP;
            place
        })
    });
    (time, places)
}

fn header(ui: &mut Ui, names: &[String; 2]) {
    let (rect, _) = ui.allocate_exact_size(Vec2::new(ui.available_width(), ROW), Sense::hover());
    let (time, columns) = places(rect);
    let (weak, font) = (tokens(ui).weak, FontId::proportional(11.0));
    widgets::cell(ui, time, Align::Min, "first differs at", font.clone(), weak);
    for (index, ((name, ..), place)) in COLUMNS.iter().zip(columns).enumerate() {
        let Some(place) = place else { continue };
        match index.checked_sub(3) {
            Some(side) => {
                let ink = super::color(ui, side);
                widgets::cell(ui, place, Align::Min, &format!("in {}", names[side]), font.clone(), ink);
            }
            None => widgets::cell(ui, place, Align::Min, name, font.clone(), weak),
        }
    }
}

/// Paints a difference; `buffers` are those of all differences.
fn row(
    ui: &mut Ui,
    cx: &mut ViewContext<'_>,
    comparison: &Comparison,
    difference: &Difference,
    buffers: &[&str],
) {
    let tokens = tokens(ui);
    let frame = cx.frame;
    // Rows are sorted by time, and others come while the sides are compared.
    let size = Vec2::new(ui.available_width(), ROW);
    let (rect, response) =
        widgets::named(ui, &difference.buffer, |ui| ui.allocate_exact_size(size, Sense::click()));
    let (time, columns) = places(rect);
    let key = TopicKey::shown(difference.buffer.clone());
    let is_selected = cx.selection.topic.as_ref() == Some(&key);
    if is_selected {
        ui.painter().rect_filled(rect, 0.0, tokens.selected);
    } else if response.hovered() {
        ui.painter().rect_filled(rect, 0.0, tokens.surface[2]);
    }
    if response.hovered() {
        cx.selection.hovered.set(Hover {
            topic: Some(key.clone()),
            time: Some(difference.time),
            ..Hover::default()
        });
    }
    let at = format::elapsed(difference.time.seconds_since(frame.info.start));
    let writer = writer(frame, difference);
    let [first, second] = &difference.values;
    response.widget_info(|| {
        let text = format!("{at} {} {}: {}", difference.buffer, difference.field, difference.detail);
        WidgetInfo::labeled(Role::Button, true, text)
    });
    if response.clicked() {
        cx.controls.extend(Control::pause_at(difference.time));
        cx.selection.topic = Some(key);
        if frame.processes.iter().any(|info| info.name == *writer) {
            cx.selection.process = Some(writer.into());
        }
    }
    // What has not happened yet at the viewed time is weaker.
    let ink = if difference.time > frame.now { tokens.weak } else { tokens.text };
    widgets::cell(ui, time, Align::Min, &at, font(), ink);
    let field = difference.field.trim_start_matches('.');
    let room = columns[3].map_or(0.0, |place| place.width());
    let digit = ui.painter().layout_no_wrap("0".to_owned(), font(), ink).size().x;
    let [first, second] = &told_apart([first, second], (room / digit) as usize);
    let value = |text: &str| if text.is_empty() { "–".to_owned() } else { text.to_owned() };
    let cells = [difference.buffer.clone(), writer.to_owned(), field.to_owned(), value(first), value(second)];
    for (index, (text, place)) in cells.iter().zip(columns).enumerate() {
        let Some(place) = place else { continue };
        match index {
            0 => short_name::cell(ui.painter(), place, Align::Min, text, buffers, &font(), ink),
            2 => short_name::cell(ui.painter(), place, Align::Min, text, &[], &font(), ink),
            1 => widgets::cell(ui, place, Align::Min, text, FontId::proportional(12.5), ink),
            _ => widgets::cell(ui, place, Align::Min, text, font(), ink),
        }
    }
    let response = response.on_hover_text(format!("{} {}", difference.field, difference.detail));
    let keys = comparison.sides.map(|side| field_key(side, difference));
    if keys.iter().any(Option::is_some) {
        response.context_menu(|ui| {
            if ui.button("Plot the field in both").clicked() {
                cx.wishes.extend(keys.into_iter().flatten().map(Wish::Plot));
                ui.close();
            }
        });
    }
}

/// The process that wrote the message; "" if it is not known. The parameters with which a run begins are nobody's act.
fn writer<'a>(frame: &'a Frame, difference: &Difference) -> &'a str {
    let is_initial = difference.time <= frame.info.start
        && frame.processes.iter().any(|info| info.params_buffer == difference.buffer);
    if is_initial {
        return "initial value";
    }
    frame.topic(&difference.buffer).map_or("", |topic| &*topic.writer)
}

/// A differing field on one side, for a plot; `None` for a message as a whole, and for another recording.
fn field_key(side: Compared, difference: &Difference) -> Option<FieldKey> {
    let run = match side {
        Compared::Recorded => RunChoice::Recorded,
        Compared::Run(run) => RunChoice::Run(run.0),
        Compared::Other => return None,
    };
    let path = difference.field.strip_prefix('.')?.parse().ok()?;
    Some(FieldKey { topic: TopicKey { name: difference.buffer.clone(), run }, path })
}

/// Both values as they are shown where `most` characters of each have room. Where the first difference would be cut off,
/// they are cut at their beginning, which is the same.
fn told_apart(values: [&str; 2], most: usize) -> [String; 2] {
    let [one, other] = values;
    let alike = one.chars().zip(other.chars()).take_while(|(a, b)| a == b).count();
    let is_cut = values.iter().any(|value| value.chars().count() > most);
    // A text that is cut ends with dots, which take the place of a character.
    let skipped = if is_cut && alike + 1 >= most { alike.saturating_sub(BEFORE) } else { 0 };
    let dots = if skipped > 0 { "…" } else { "" };
    values.map(|value| dots.chars().chain(value.chars().skip(skipped)).collect())
}

#[cfg(test)]
mod tests {
    use super::told_apart;

    #[test]
    fn two_values_show_the_digit_by_which_they_differ_however_little_room_they_have() {
        let values = ["8.123456789012345", "8.123456789012347"];
        assert_eq!(told_apart(values, 17), values);
        assert_eq!(told_apart(values, 16), ["…2345", "…2347"]);
        let values = ["8.123456789", "8.25"];
        assert_eq!(told_apart(values, 6), values, "the digit is seen without their ends");
        assert_eq!(told_apart(["", "8.25"], 3), ["", "8.25"]);
    }
}
