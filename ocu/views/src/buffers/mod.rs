//! Buffers view: every topic with its rate, age, size and type, as a tree by name or grouped by the process that writes
//! it.
//!
//! A click shows a topic in the fields view, a double click in the view that draws it. A topic can be dragged onto any
//! view that accepts it.

mod rows;

use crate::view::{Hover, SavedState, ShowIn, TopicKey, View, ViewContext, Wish, is_old, rate_hz};
use egui::{Align, FontId, Rect, Role, ScrollArea, Sense, TextStyle, Ui, Vec2, WidgetInfo};
use ocu_ui::bar::{self, Bar, Fit};
use ocu_ui::{format, icons, short_name, stale, tokens, widgets};
use rcs_runtime::source::{Frame, Topic};
use rows::Row;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::sync::Arc;

const ROW: f32 = 20.0;
/// Indentation of a level of the tree.
const INDENT: f32 = 12.0;

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
struct Saved {
    /// What names must hold to be listed.
    search: String,
    /// Collapsed groups, by title.
    folded: BTreeSet<String>,
    /// Whether topics are grouped by the process that writes them; otherwise they form a tree by name.
    by_process: bool,
    /// The column that they are sorted by.
    sort: Column,
    /// Whether they are sorted from the greatest to the least.
    descending: bool,
}

/// The buffer list.
#[derive(Default)]
pub(crate) struct Buffers {
    saved: Saved,
}

/// The visible columns, from the right end of a row.
struct Columns {
    cells: Vec<(Column, f32)>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Column {
    #[default]
    Name,
    Type,
    Role,
    Messages,
    Size,
    Rate,
    Age,
}

impl Column {
    fn title(self) -> &'static str {
        match self {
            Self::Name => "buffer",
            Self::Type => "type",
            Self::Role => "role",
            Self::Messages => "messages",
            Self::Size => "size",
            Self::Rate => "rate",
            Self::Age => "age",
        }
    }

    fn is_number(self) -> bool {
        !matches!(self, Self::Name | Self::Type | Self::Role)
    }

    fn align(self) -> Align {
        if self.is_number() { Align::Max } else { Align::Min }
    }
}

impl Columns {
    /// Age and rate are always visible; the others where there is room besides 180 points for the name.
    fn of(width: f32) -> Self {
        let mut room = width - 180.0;
        let mut cells = Vec::new();
        let by_worth = [
            (Column::Age, 52.0),
            (Column::Rate, 60.0),
            (Column::Type, 176.0),
            (Column::Messages, 72.0),
            (Column::Size, 64.0),
            (Column::Role, 64.0),
        ];
        for (i, (column, width)) in by_worth.into_iter().enumerate() {
            room -= width;
            if i < 2 || room >= 0.0 {
                cells.push((column, width));
            }
        }
        let order = [Column::Type, Column::Role, Column::Messages, Column::Size, Column::Rate, Column::Age];
        cells.sort_by_key(|(column, _)| order.iter().position(|other| other == column));
        Self { cells }
    }

    /// Rectangles of the name and of each column.
    fn layout(&self, row: Rect) -> (Rect, Vec<(Column, Rect)>) {
        let width: f32 = self.cells.iter().map(|(_, width)| width).sum();
        let mut left = row.right() - width;
        let name = Rect::from_min_max(row.min, egui::Pos2::new(left - 8.0, row.bottom()));
        let cells = self.cells.iter().map(|(column, width)| {
            let cell =
                Rect::from_min_size(egui::Pos2::new(left, row.top()), Vec2::new(width - 8.0, row.height()));
            left += width;
            (*column, cell)
        });
        (name, cells.collect())
    }
}

impl View for Buffers {
    fn title(&self, _frame: &Frame) -> String {
        "Buffers".to_owned()
    }

    fn save(&self) -> SavedState {
        serde_json::to_value(&self.saved).unwrap_or_default()
    }

    fn load(&mut self, saved: &SavedState) -> Result<(), serde_json::Error> {
        self.saved = serde_json::from_value(saved.clone())?;
        Ok(())
    }

    fn ui(&mut self, ui: &mut Ui, cx: &mut ViewContext<'_>) {
        if cx.frame.topics.is_empty() {
            let hint = "Open a log (drop it on the window) or a stack; its topics are listed here.";
            return widgets::empty(ui, icons::ICON_INBOX, "No buffers", hint);
        }
        let mut bar: Bar<'_, Saved> = Bar::new("toolbar");
        bar.left("search", Fit::Stretches(48.0), |ui, _, saved| {
            widgets::search(ui, &mut saved.search, "Search buffers");
        });
        bar.right("group", Fit::Leaves(10), |ui, form, saved| {
            let name = "Group by the process that writes them";
            bar::tool_toggle(ui, form, icons::ICON_ACCOUNT_TREE, name, &mut saved.by_process);
        });
        crate::toolbar::show(ui, bar, &mut self.saved);
        let rows = rows::rows(&self.saved, cx.frame);
        if rows.is_empty() {
            let hint = format!(
                "None of {} buffers has {:?} in its name or type.",
                cx.frame.topics.len(),
                self.saved.search
            );
            return widgets::empty(ui, icons::ICON_SEARCH_OFF, "Nothing found", &hint);
        }
        let columns = Columns::of(ui.available_width());
        self.header(ui, &columns);
        ui.spacing_mut().item_spacing.y = 0.0;
        ScrollArea::vertical().auto_shrink(false).show_rows(ui, ROW, rows.len(), |ui, range| {
            let rows = &rows[range];
            let label = |row: &Row<'_>| match row {
                Row::Group { title, .. } => title.clone(),
                Row::Topic { topic, name, .. } => crate::toolbar::with_type(cx.frame, topic, name),
            };
            let labels: Vec<String> = rows.iter().map(label).collect();
            let others: Vec<&str> = labels.iter().map(String::as_str).collect();
            let mut names = widgets::RowNames::default();
            for (row, label) in rows.iter().zip(&labels) {
                // A row moves when another topic comes, or when its rate or age changes its place.
                let name = match row {
                    Row::Group { key, .. } => (key.as_str(), None),
                    Row::Topic { topic, .. } => (&*topic.name, Some(topic.run)),
                };
                names.named(ui, name, |ui| match row {
                    Row::Group { key, title, depth, count } => self.group(ui, key, title, *depth, *count),
                    Row::Topic { topic, depth, .. } => {
                        self::row(ui, cx, topic, (label, &others), *depth, &columns);
                    }
                });
            }
        });
    }
}

impl Buffers {
    fn group(&mut self, ui: &mut Ui, key: &str, title: &str, depth: usize, count: usize) {
        let tokens = tokens(ui);
        let (rect, response) = ui.allocate_exact_size(Vec2::new(ui.available_width(), ROW), Sense::click());
        let open = !self.saved.folded.contains(key);
        response.widget_info(|| WidgetInfo::selected(Role::Button, true, open, format!("Group {key}")));
        if depth == 0 {
            ui.painter().rect_filled(rect, 0.0, tokens.surface[2].gamma_multiply(0.6));
        }
        if response.hovered() {
            ui.painter().rect_filled(rect, 0.0, tokens.surface[2]);
        }
        let left = depth as f32 * INDENT;
        let icon = if open { icons::ICON_EXPAND_MORE } else { icons::ICON_CHEVRON_RIGHT };
        let at = rect.left_center() + Vec2::new(left + 13.0, 0.0);
        widgets::icon_at(ui.painter(), at, icon, 14.0, tokens.weak);
        let name =
            Rect::from_min_max(rect.min + Vec2::new(left + 24.0, 0.0), rect.max - Vec2::new(48.0, 0.0));
        widgets::cell(ui, name, Align::Min, title, FontId::proportional(12.0), tokens.text);
        let right = Rect::from_min_max(
            egui::Pos2::new(rect.right() - 48.0, rect.top()),
            rect.max - Vec2::new(8.0, 0.0),
        );
        widgets::cell(ui, right, Align::Max, &count.to_string(), FontId::proportional(11.0), tokens.weak);
        if response.clicked() && !self.saved.folded.remove(key) {
            self.saved.folded.insert(key.to_owned());
        }
    }

    /// The titles of the columns; a click sorts by one, another click in the other direction.
    fn header(&mut self, ui: &mut Ui, columns: &Columns) {
        let tokens = tokens(ui);
        let (rect, _) = ui.allocate_exact_size(Vec2::new(ui.available_width(), ROW), Sense::hover());
        let (name, cells) = columns.layout(rect);
        let name = Rect::from_min_max(name.min + Vec2::new(24.0, 0.0), name.max);
        for (column, cell) in std::iter::once((Column::Name, name)).chain(cells) {
            let response = ui.interact(cell, ui.scope_id().with(column.title()), Sense::click());
            let sorted = self.saved.sort == column;
            let label = format!("Sort by {}", column.title());
            response.widget_info(|| WidgetInfo::selected(Role::Button, true, sorted, &label));
            let color = match (sorted, response.hovered()) {
                (true, _) => tokens.text,
                (false, true) => tokens.strong,
                (false, false) => tokens.weak,
            };
            let mark = match (sorted, self.saved.descending) {
                (false, _) => "",
                (true, false) => icons::ICON_ARROW_UPWARD.codepoint,
                (true, true) => icons::ICON_ARROW_DOWNWARD.codepoint,
            };
            let text = format!("{} {mark}", column.title());
            let text = text.trim_end();
            widgets::cell(ui, cell, column.align(), text, FontId::proportional(11.0), color);
            if response.on_hover_text(label).clicked() {
                self.saved.descending = if sorted { !self.saved.descending } else { column.is_number() };
                self.saved.sort = column;
            }
        }
        ui.add_space(-ui.spacing().item_spacing.y);
    }
}

/// Paints a topic. `label` is its name in the list, and `others` are those of all rows that are seen.
fn row(
    ui: &mut Ui,
    cx: &mut ViewContext<'_>,
    topic: &Topic,
    (label, others): (&str, &[&str]),
    depth: usize,
    columns: &Columns,
) {
    let tokens = tokens(ui);
    let key = TopicKey::of(topic);
    let chosen = cx.selection.topic.as_ref().is_some_and(|selected| selected.is(topic));
    let (rect, response) =
        ui.allocate_exact_size(Vec2::new(ui.available_width(), ROW), Sense::click_and_drag());
    let name = || crate::toolbar::with_type(cx.frame, topic, &topic.name);
    response.widget_info(|| WidgetInfo::selected(Role::Button, true, chosen, name()));
    response.dnd_set_drag_payload(key.clone());
    if chosen {
        ui.painter().rect_filled(rect, 0.0, tokens.selected);
    } else if response.hovered() || is_meant(cx, topic, &key) {
        ui.painter().rect_filled(rect, 0.0, tokens.surface[2]);
    }
    if response.hovered() {
        let writer = Some(Arc::clone(&topic.writer)).filter(|writer| !writer.is_empty());
        cx.selection.hovered.set(Hover { topic: Some(key.clone()), process: writer, ..Hover::default() });
    }
    if response.clicked() {
        cx.selection.topic = Some(key.clone());
        cx.wishes.push(Wish::Show { topic: key.clone(), place: ShowIn::Fields });
    }
    if response.double_clicked() {
        cx.wishes.push(Wish::Show { topic: key.clone(), place: ShowIn::View });
    }
    response.context_menu(|ui| {
        if ui.button(format!("{}  Draw in a new view", icons::ICON_ADD.codepoint)).clicked() {
            cx.wishes.push(Wish::Show { topic: key.clone(), place: ShowIn::NewView });
            ui.close();
        }
        if ui.button(format!("{}  Copy the name", icons::ICON_CONTENT_COPY.codepoint)).clicked() {
            ui.ctx().copy_text(topic.name.to_string());
            ui.close();
        }
    });

    let age_s = topic.age_s(cx.frame.now);
    let old = is_old(topic, cx.frame.now);
    let (mut name, cells) = columns.layout(rect);
    name.min.x += 24.0 + depth as f32 * INDENT;
    if let Some(icon) = topic.undecodable.as_ref().map(|_| icons::ICON_ERROR) {
        widgets::icon_at(ui.painter(), name.left_center() - Vec2::new(11.0, 0.0), icon, 13.0, tokens.warning);
    }
    let color = if topic.latest.is_none() { tokens.weak } else { tokens.text };
    let font = TextStyle::Body.resolve(ui.style());
    short_name::cell(ui.painter(), name, Align::Min, label, others, &font, color);
    let small = FontId::proportional(11.0);
    let mono = FontId::monospace(11.5);
    for (column, cell) in cells {
        let text = match column {
            Column::Name => continue,
            Column::Type => topic.schema.name().replace("/msg/", "/"),
            Column::Role => topic.role_name().to_owned(),
            Column::Messages => format::count(topic.messages),
            Column::Size => topic.latest.as_ref().map_or_else(|| "–".to_owned(), |_| size(topic)),
            // A silent topic may still have an estimated rate; its current rate is 0, also where its value stays in
            // force.
            Column::Rate => {
                let usual_hz = topic.seldom_hz.or(topic.hz).unwrap_or(0.0);
                let is_silent = age_s.is_some_and(|age_s| stale::is_stale(age_s, usual_hz));
                format::rate(if is_silent { 0.0 } else { rate_hz(topic) })
            }
            Column::Age => age_s.map_or_else(|| "–".to_owned(), format::age),
        };
        match column {
            Column::Type => {
                short_name::cell(ui.painter(), cell, Align::Min, &text, &[], &small, tokens.weak);
            }
            Column::Role => widgets::cell(ui, cell, Align::Min, &text, small.clone(), tokens.weak),
            Column::Age if old => {
                stale::hatch(
                    ui.painter(),
                    cell.shrink2(Vec2::new(0.0, 3.0)),
                    tokens.stale.gamma_multiply(0.35),
                );
                widgets::cell(ui, cell, Align::Max, &text, mono.clone(), tokens.stale);
            }
            _ => widgets::cell(ui, cell, Align::Max, &text, mono.clone(), tokens.text),
        }
    }
    response.on_hover_ui(|ui| details(ui, cx.frame, topic, old));
}

/// Whether another view points at the topic, or at the process that writes it.
fn is_meant(cx: &ViewContext<'_>, topic: &Topic, key: &TopicKey) -> bool {
    let hover = cx.selection.hovered.get();
    match &hover.topic {
        Some(meant) => meant == key,
        None => hover.process.as_ref().is_some_and(|process| **process == *topic.writer),
    }
}

/// Size of the newest message. A message that is not encoded yet is not encoded just for this.
fn size(topic: &Topic) -> String {
    match &topic.latest {
        Some(sample) if !sample.message.is_typed() || topic.run.is_recorded() => {
            format::bytes(sample.message.bytes().len() as u64)
        }
        _ => "–".to_owned(),
    }
}

/// The rate of a topic, and what of: where it is sent only at times, or nothing was sent yet, that of the whole recording.
fn rate(topic: &Topic) -> String {
    let is_mean = topic.latest.is_none() || topic.seldom_hz.is_some();
    let of = if is_mean { "mean of the recording" } else { "of its last seconds" };
    topic.hz.map_or_else(String::new, |hz| format!("{}, {of}", format::rate(hz)))
}

fn details(ui: &mut Ui, frame: &Frame, topic: &Topic, old: bool) {
    let tokens = tokens(ui);
    ui.label(egui::RichText::new(&*topic.name).color(tokens.strong));
    if let Some(reason) = &topic.undecodable {
        ui.colored_label(tokens.warning, format!("cannot be read: {reason}"));
    }
    let mut line = |name: &str, value: String| {
        if !value.is_empty() {
            widgets::name_value(ui, 72.0, name, egui::RichText::new(value));
        }
    };
    line("type", topic.schema.name().to_owned());
    if topic.type_name() != topic.schema.name() {
        line("shown as", topic.type_name().to_owned());
    }
    line("encoding", topic.schema.message_encoding().name().to_owned());
    line("writer", topic.writer.to_string());
    line("rate", rate(topic));
    line("messages", format::count(topic.messages));
    line("size", size(topic));
    match topic.age_s(frame.now) {
        Some(age_s) => line(
            "age",
            format!("{}{}", format::age(age_s), if old { ", older than its rate allows" } else { "" }),
        ),
        None => line("age", "nothing yet at this time".to_owned()),
    }
    for (key, value) in topic.metadata.iter().filter(|(_, value)| value.len() < 60) {
        line(key.trim_start_matches("rcs."), value.clone());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples;
    use rcs_msg::rcs::Status;

    #[test]
    fn a_rate_says_whether_it_is_that_of_the_last_seconds_or_a_mean() {
        let mut topic = samples::topic("/a/status", 30.0, 0.1, Status::default());
        assert_eq!(rate(&topic), "30 Hz, of its last seconds");
        topic.seldom_hz = Some(0.1);
        assert_eq!(rate(&topic), "30 Hz, mean of the recording");
        topic.hz = None;
        assert_eq!(rate(&topic), "");
    }
}
