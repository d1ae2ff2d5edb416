//! Buffers view: every topic with its rate, age, size and type, grouped by the process that writes it.
//!
//! A click selects a topic (the fields view follows). A topic can be dragged onto any view that accepts it.

use crate::view::{SavedState, TopicKey, View, ViewContext, rate_hz};
use egui::{Align, FontId, Rect, Role, ScrollArea, Sense, TextStyle, Ui, Vec2, WidgetInfo};
use ocu_ui::{format, icons, stale, tokens, widgets};
use rcs_runtime::source::{Frame, RunTag, SourceKind, Topic};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::sync::Arc;

const ROW: f32 = 20.0;

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
struct Saved {
    /// What names must hold to be listed.
    search: String,
    /// Collapsed groups, by title.
    folded: BTreeSet<String>,
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

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Column {
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
            Self::Type => "type",
            Self::Role => "role",
            Self::Messages => "messages",
            Self::Size => "size",
            Self::Rate => "rate",
            Self::Age => "age",
        }
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

enum Row<'a> {
    Group { title: String, count: usize },
    Topic(&'a Topic),
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
        crate::toolbar::row(ui, |ui| {
            widgets::search(ui, &mut self.saved.search, "Search buffers");
        });
        let rows = self.rows(cx.frame);
        if rows.is_empty() {
            let hint = format!(
                "None of {} buffers has {:?} in its name or type.",
                cx.frame.topics.len(),
                self.saved.search
            );
            return widgets::empty(ui, icons::ICON_SEARCH_OFF, "Nothing found", &hint);
        }
        let columns = Columns::of(ui.available_width());
        header(ui, &columns);
        ui.spacing_mut().item_spacing.y = 0.0;
        ScrollArea::vertical().auto_shrink(false).show_rows(ui, ROW, rows.len(), |ui, range| {
            for row in &rows[range] {
                match row {
                    Row::Group { title, count } => self.group(ui, title, *count),
                    Row::Topic(topic) => self::row(ui, cx, topic, &columns),
                }
            }
        });
    }
}

impl Buffers {
    fn rows<'a>(&self, frame: &'a Frame) -> Vec<Row<'a>> {
        let search = self.saved.search.trim().to_lowercase();
        let found = |topic: &&Topic| {
            search.is_empty()
                || topic.name.to_lowercase().contains(&search)
                || topic.schema.name().to_lowercase().contains(&search)
                || topic.writer.to_lowercase().contains(&search)
        };
        let rank = |writer: &str| {
            // A topic with several writers is listed with the first of them.
            let first = writer.split(", ").next();
            frame.processes.iter().position(|process| Some(process.name.as_str()) == first)
        };
        let mut topics: Vec<_> = frame.topics.iter().filter(found).collect();
        // Processes in the order of the stack, then topics without a writer, then recorded topics.
        topics.sort_by_key(|topic| {
            let recorded = topic.run.is_recorded();
            (
                recorded,
                rank(&topic.writer).unwrap_or(usize::MAX),
                Arc::clone(&topic.writer),
                Arc::clone(&topic.name),
            )
        });
        let mut rows = Vec::new();
        for group in topics.chunk_by(|a, b| group_title(frame, a) == group_title(frame, b)) {
            let title = group_title(frame, group[0]);
            let open = !search.is_empty() || !self.saved.folded.contains(&title);
            rows.push(Row::Group { title, count: group.len() });
            if open {
                rows.extend(group.iter().map(|topic| Row::Topic(topic)));
            }
        }
        rows
    }

    fn group(&mut self, ui: &mut Ui, title: &str, count: usize) {
        let tokens = tokens(ui);
        let (rect, response) = ui.allocate_exact_size(Vec2::new(ui.available_width(), ROW), Sense::click());
        let open = !self.saved.folded.contains(title);
        response.widget_info(|| WidgetInfo::selected(Role::Button, true, open, format!("Group {title}")));
        ui.painter().rect_filled(rect, 0.0, tokens.surface[2].gamma_multiply(0.6));
        let icon = if open { icons::ICON_EXPAND_MORE } else { icons::ICON_CHEVRON_RIGHT };
        widgets::icon_at(ui.painter(), rect.left_center() + Vec2::new(13.0, 0.0), icon, 14.0, tokens.weak);
        let name = Rect::from_min_max(rect.min + Vec2::new(24.0, 0.0), rect.max - Vec2::new(48.0, 0.0));
        widgets::cell(ui, name, Align::Min, title, FontId::proportional(12.0), tokens.text);
        let right = Rect::from_min_max(
            egui::Pos2::new(rect.right() - 48.0, rect.top()),
            rect.max - Vec2::new(8.0, 0.0),
        );
        widgets::cell(ui, right, Align::Max, &count.to_string(), FontId::proportional(11.0), tokens.weak);
        if response.clicked() && !self.saved.folded.remove(title) {
            self.saved.folded.insert(title.to_owned());
        }
    }
}

fn group_title(frame: &Frame, topic: &Topic) -> String {
    match (topic.run, &*topic.writer) {
        (RunTag::Recorded, "") => "Recording".to_owned(),
        (RunTag::Recorded, writer) => format!("{writer} (recorded)"),
        (RunTag::Run(_), "") if frame.info.kind == SourceKind::Log => "Recording".to_owned(),
        (RunTag::Run(_), "") => "Runtime and operator".to_owned(),
        (RunTag::Run(_), writer) => writer.to_owned(),
    }
}

fn header(ui: &mut Ui, columns: &Columns) {
    let tokens = tokens(ui);
    let (rect, _) = ui.allocate_exact_size(Vec2::new(ui.available_width(), ROW), Sense::hover());
    let (name, cells) = columns.layout(rect);
    let font = FontId::proportional(11.0);
    let name = Rect::from_min_max(name.min + Vec2::new(24.0, 0.0), name.max);
    widgets::cell(ui, name, Align::Min, "buffer", font.clone(), tokens.weak);
    for (column, cell) in cells {
        let align = if matches!(column, Column::Type | Column::Role) { Align::Min } else { Align::Max };
        widgets::cell(ui, cell, align, column.title(), font.clone(), tokens.weak);
    }
    ui.add_space(-ui.spacing().item_spacing.y);
}

fn row(ui: &mut Ui, cx: &mut ViewContext<'_>, topic: &Topic, columns: &Columns) {
    let tokens = tokens(ui);
    let key = TopicKey::of(topic);
    let chosen = cx.selection.topic.as_ref().is_some_and(|selected| selected.is(topic));
    let (rect, response) =
        ui.allocate_exact_size(Vec2::new(ui.available_width(), ROW), Sense::click_and_drag());
    response.widget_info(|| WidgetInfo::selected(Role::Button, true, chosen, &*topic.name));
    response.dnd_set_drag_payload(key.clone());
    if chosen {
        ui.painter().rect_filled(rect, 0.0, tokens.selected);
    } else if response.hovered() {
        ui.painter().rect_filled(rect, 0.0, tokens.surface[2]);
    }
    if response.clicked() {
        cx.selection.topic = Some(key);
    }

    let age_s = topic.age_s(cx.frame.now);
    let old = age_s.is_some_and(|age_s| stale::is_stale(age_s, rate_hz(topic)));
    let (mut name, cells) = columns.layout(rect);
    name.min.x += 24.0;
    if let Some(icon) = topic.undecodable.as_ref().map(|_| icons::ICON_ERROR) {
        widgets::icon_at(ui.painter(), name.left_center() - Vec2::new(11.0, 0.0), icon, 13.0, tokens.warning);
    }
    let color = if topic.latest.is_none() { tokens.unknown } else { tokens.text };
    let font = TextStyle::Body.resolve(ui.style());
    widgets::cell_keep_end(ui, name, &topic.name, font, color);
    let small = FontId::proportional(11.0);
    let mono = FontId::monospace(11.5);
    for (column, cell) in cells {
        let text = match column {
            Column::Type => topic.schema.name().replace("/msg/", "/"),
            Column::Role => topic.role_name().to_owned(),
            Column::Messages => format::count(topic.messages),
            Column::Size => topic.latest.as_ref().map_or_else(|| "–".to_owned(), |_| size(topic)),
            // A silent topic may still have an estimated rate; its current rate is 0.
            Column::Rate => format::rate(if old { 0.0 } else { rate_hz(topic) }),
            Column::Age => age_s.map_or_else(|| "–".to_owned(), format::age),
        };
        match column {
            Column::Type => widgets::cell_keep_end(ui, cell, &text, small.clone(), tokens.weak),
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

/// Size of the newest message. A message that is not encoded yet is not encoded just for this.
fn size(topic: &Topic) -> String {
    match &topic.latest {
        Some(sample) if !sample.message.is_typed() || topic.run.is_recorded() => {
            format::bytes(sample.message.bytes().len() as u64)
        }
        _ => "–".to_owned(),
    }
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
    line("rate", format::rate(rate_hz(topic)));
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
