//! Fields view: any message of any encoding as a tree, with its header.
//!
//! It follows the selected topic until one is pinned or dropped on it. Values have a fixed column, so that the text
//! does not move while values change.

mod array;
mod decoded;
mod flash;
mod rows;

use crate::edit::draft::Draft;
use crate::edit::text::text_of;
use crate::edit::{overrides, refusal};
use crate::origin::Origin;
use crate::prepare::{Same, prepared};
use crate::view::{FieldKey, SavedState, Selection, TopicKey, View, ViewContext, Wish, is_old, run_beside};
use array::{ArrayForm, Form};
use decoded::Decoded;
use egui::text::LayoutJob;
use egui::{
    Align, FontId, FontSelection, Id, Pos2, Rect, RichText, Role, ScrollArea, Sense, Ui, Vec2, WidgetInfo,
};
use flash::Flashes;
use ocu_ui::bar::{self, Bar, Fit};
use ocu_ui::widgets::{self, mono};
use ocu_ui::{format, icons, tokens};
use rcs_msg::AnyMessage;
use rcs_runtime::source::{Frame, Topic};
use rows::{Row, hex};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::sync::Arc;

const ROW: f32 = 20.0;
const INDENT: f32 = 16.0;
/// Larger messages are shown as bytes: decoded fields take at least as much memory again.
pub(crate) const MOST_BYTES: usize = 64 << 20;

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub(crate) struct Saved {
    /// The topic to show; `None` to follow the selection.
    pinned: Option<TopicKey>,
    /// What names of fields must hold to be shown.
    search: String,
    /// Paths of the fields that are unfolded.
    open: BTreeSet<String>,
    /// The array that is shown as a picture or a histogram.
    array: Option<ArrayForm>,
}

/// The fields view.
#[derive(Default)]
pub(crate) struct Fields {
    pub(crate) saved: Saved,
    last: Option<TopicKey>,
    /// Path of the field whose editing began here in the last pass.
    fresh: Option<String>,
    /// Height of what is edited, as it was painted last.
    edit_height: f32,
    origin: Origin,
    flashes: Flashes,
}

impl View for Fields {
    fn title(&self, _frame: &Frame) -> String {
        self.saved.pinned.as_ref().map_or_else(|| "Fields".to_owned(), |key| key.name.clone())
    }

    fn accepts(&self, _topic: &Topic) -> bool {
        true
    }

    fn fields(&self) -> Vec<rcs_formula::FieldRef> {
        self.origin.field().into_iter().collect()
    }

    fn shows_selection(&self) -> bool {
        self.saved.pinned.is_none()
    }

    fn drop_topic(&mut self, topic: &Topic) {
        self.saved.pinned = Some(TopicKey::of(topic));
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
            let hint = "Open a log or a stack, then choose a buffer.";
            return widgets::empty(ui, icons::ICON_DATA_OBJECT, "No messages", hint);
        }
        let topic = self.topic(cx);
        self.toolbar(ui, cx, topic);
        self.message_ui(ui, cx, topic);
    }
}

impl Fields {
    /// Paints header and fields of a topic's newest message.
    pub(crate) fn message_ui(&mut self, ui: &mut Ui, cx: &mut ViewContext<'_>, topic: Option<&Topic>) {
        let Some(topic) = topic else {
            let hint = "Click one in the buffer list, or drag one here.";
            return widgets::empty(ui, icons::ICON_DATA_OBJECT, "No buffer is chosen", hint);
        };
        header(ui, cx.frame, topic);
        let Some(sample) = &topic.latest else {
            let title = format!("No message of {} yet", topic.name);
            return widgets::empty(
                ui,
                icons::ICON_HOURGLASS_EMPTY,
                &title,
                "Play or step on to its first message.",
            );
        };
        if let Some(reason) = &topic.undecodable {
            return undecodable(ui, reason, &sample.message);
        }
        let size = sample.message.size_hint();
        if size > MOST_BYTES {
            let reason = format!("it is larger than {} MiB, so its fields are not shown", MOST_BYTES >> 20);
            return undecodable(ui, &reason, &sample.message);
        }
        match Decoded::of(ui.ctx(), topic) {
            Some(Err(reason)) => undecodable(ui, &reason, &sample.message),
            Some(Ok(decoded)) => self.decoded_ui(ui, cx, topic, &decoded),
            // It is being decoded.
            None => {}
        }
    }

    fn decoded_ui(&mut self, ui: &mut Ui, cx: &mut ViewContext<'_>, topic: &Topic, decoded: &Arc<Decoded>) {
        let key = TopicKey::of(topic);
        self.origin.ui(ui, cx);
        let edited = (key.clone(), run_beside(cx.frame));
        let mut draft = cx.selection.drafts.fields.remove(&edited).unwrap_or_default();
        let fresh = self.fresh.take();
        // What is found and what is painted belongs to this view and topic.
        let slot = ui.scope_id().with((&*topic.name, topic.run));
        let mut area = ui.available_rect_before_wrap();
        let is_room = area.height() > array::HEIGHT + 4.0 * ROW;
        if let Some(shown) = self.saved.array.as_mut().filter(|_| is_room) {
            let (above, below) = area.split_top_bottom_at_y(area.bottom() - array::HEIGHT);
            let mut child = ui.new_child(egui::UiBuilder::new().max_rect(below).id_salt("array"));
            child.set_clip_rect(below.intersect(ui.clip_rect()));
            if !array::ui(&mut child, slot, decoded, shown) {
                self.saved.array = None;
            }
            area = above;
        }
        if !draft.is_empty() {
            // Below the fields, none of which may move between two clicks.
            let top = (area.bottom() - self.edit_height).max(area.top());
            let (above, below) = area.split_top_bottom_at_y(top);
            let mut child = ui.new_child(egui::UiBuilder::new().max_rect(below).id_salt("edit"));
            draft.ui(&mut child, cx, topic, fresh.as_deref());
            let height = child.min_rect().height();
            if height != self.edit_height {
                self.edit_height = height;
                ui.ctx().request_discard("what is edited has another height");
                ui.ctx().request_repaint();
            }
            area = above;
        }
        let mut child = ui.new_child(egui::UiBuilder::new().max_rect(area).id_salt("tree"));
        child.set_clip_rect(area.intersect(ui.clip_rect()));
        self.flashes.begin(&key.name, decoded.log_time);
        let parts = (&mut draft, &mut self.fresh, &mut self.origin, &mut self.flashes);
        tree(&mut child, cx, &mut self.saved, slot, decoded, topic, &key, parts);
        if !draft.is_empty() {
            cx.selection.drafts.fields.insert(edited, draft);
        }
        ui.advance_cursor_after_rect(area);
    }
}

impl Fields {
    fn topic<'a>(&mut self, cx: &ViewContext<'a>) -> Option<&'a Topic> {
        let chosen = self.saved.pinned.as_ref().or(cx.selection.topic.as_ref()).or(self.last.as_ref());
        let Some(key) = chosen.cloned() else { return usual(cx.frame) };
        let topic = key.find(cx.frame);
        self.last = Some(key);
        topic
    }

    fn toolbar(&mut self, ui: &mut Ui, cx: &mut ViewContext<'_>, topic: Option<&Topic>) {
        let frame = cx.frame;
        let mut topics: Vec<_> = frame.topics.iter().collect();
        topics.sort_by(|a, b| a.name.cmp(&b.name));
        let mut bar: Bar<'_, (&mut Saved, &mut Selection)> = Bar::new("toolbar");
        bar.left("keep", Fit::Leaves(10), |ui, form, (saved, _)| {
            let mut pinned = saved.pinned.is_some();
            let name = if pinned { "Follow the selection again" } else { "Keep this buffer" };
            if bar::tool_toggle(ui, form, icons::ICON_KEEP, name, &mut pinned).clicked() {
                saved.pinned = topic.filter(|_| pinned).map(TopicKey::of);
            }
        });
        bar.left("buffer", Fit::Stays, |ui, form, (saved, selection)| {
            if let Some(key) = crate::toolbar::topic_choice(ui, form, frame, "Buffer", topic, &topics) {
                if saved.pinned.is_some() {
                    saved.pinned = Some(key.clone());
                }
                selection.topic = Some(key);
            }
        });
        bar.left("search", Fit::Stretches(64.0), |ui, _, (saved, _)| {
            widgets::search(ui, &mut saved.search, "Search fields");
        });
        crate::toolbar::show(ui, bar, &mut (&mut self.saved, &mut *cx.selection));
    }
}

/// What is shown until something is chosen: of the topics that can be read, the one with most messages.
fn usual(frame: &Frame) -> Option<&Topic> {
    let is_readable =
        |topic: &&Topic| topic.undecodable.is_none() && topic.messages > 0 && !topic.is_ground_truth();
    let readable = frame.topics.iter().filter(is_readable);
    readable.max_by_key(|topic| (topic.latest.is_some(), topic.messages, std::cmp::Reverse(&topic.name)))
}

/// Sequence number, times, writer and type of the message.
fn header(ui: &mut Ui, frame: &Frame, topic: &Topic) {
    let tokens = tokens(ui);
    let margin = egui::Margin::symmetric(8, 4);
    egui::Frame::new().inner_margin(margin).show(ui, |ui| {
        ui.spacing_mut().item_spacing = Vec2::new(16.0, 0.0);
        let item = |ui: &mut Ui, name: &str, value: RichText| {
            let mut job = LayoutJob::default();
            let (style, font) = (ui.style(), FontSelection::Default);
            let name = RichText::new(format!("{name} ")).small().color(tokens.weak);
            name.append_to(&mut job, style, font.clone(), Align::Center);
            value.size(12.0).append_to(&mut job, style, font, Align::Center);
            ui.add(egui::Label::new(job).extend());
        };
        ui.horizontal_wrapped(|ui| {
            item(ui, "type", RichText::new(topic.schema.name()));
            item(ui, "encoding", RichText::new(topic.schema.message_encoding().name()));
            if !topic.writer.is_empty() {
                item(ui, "writer", RichText::new(&*topic.writer));
            }
            if let Some(sample) = &topic.latest {
                let header = &sample.header;
                let age_s = topic.age_s(frame.now).unwrap_or(0.0);
                let old = is_old(topic, frame.now);
                item(ui, "sequence", mono(header.sequence.to_string()));
                item(ui, "log time", mono(format::clock(header.log_time.0)));
                let acquired = topic.acq_time().unwrap_or(header.acq_time);
                item(ui, "acquired", mono(format::clock(acquired.0)));
                let age = mono(format::age(age_s));
                item(
                    ui,
                    if old { "age (old)" } else { "age" },
                    if old { age.color(tokens.stale) } else { age },
                );
            }
        });
    });
    let rect = ui.min_rect();
    ui.painter().hline(rect.x_range(), rect.bottom(), egui::Stroke::new(1.0, tokens.line));
}

/// A message that cannot be decoded: the reason, and its bytes.
fn undecodable(ui: &mut Ui, reason: &str, message: &AnyMessage) {
    let bytes = message.bytes();
    ui.horizontal_wrapped(|ui| {
        ui.add_space(8.0);
        ui.label(icons::ICON_ERROR.rich_text().size(14.0).color(tokens(ui).warning));
        ui.label(format!("Cannot be read: {reason}"));
    });
    ui.horizontal(|ui| {
        ui.add_space(8.0);
        ui.label(RichText::new(format!("{} bytes", format::count(bytes.len() as u64))).small().weak());
    });
    let lines = bytes.len().div_ceil(16);
    ui.spacing_mut().item_spacing.y = 0.0;
    ScrollArea::both().auto_shrink(false).show_rows(ui, 16.0, lines, |ui, range| {
        for line in range {
            let part = &bytes[line * 16..bytes.len().min(line * 16 + 16)];
            let text: String = part
                .iter()
                .map(|&byte| if (0x20..0x7f).contains(&byte) { char::from(byte) } else { '.' })
                .collect();
            let text = mono(format!("  {:06x}  {:<47}  {text}", line * 16, hex(part)));
            ui.add(egui::Label::new(text).extend());
        }
    });
}

#[allow(clippy::too_many_arguments, reason = "what a row shows and what its menu does")]
fn tree(
    ui: &mut Ui,
    cx: &mut ViewContext<'_>,
    saved: &mut Saved,
    slot: Id,
    decoded: &Arc<Decoded>,
    topic: &Topic,
    key: &TopicKey,
    (draft, fresh, origin, flashes): (&mut Draft, &mut Option<String>, &mut Origin, &mut Flashes),
) {
    let value = &decoded.value;
    let search = saved.search.trim().to_lowercase();
    let found = if search.is_empty() {
        Some(Arc::new((rows::rows(value, &saved.open), false)))
    } else {
        let (of, text) = (Arc::clone(decoded), search.clone());
        let key = (Same(Arc::clone(decoded)), search.clone());
        prepared(ui.ctx(), slot.with("found"), key, move || rows::found(&of.value, &text))
    };
    // It is being searched.
    let Some(found) = found else { return };
    let (rows, more) = &*found;
    if rows.is_empty() {
        let (title, hint) = if search.is_empty() {
            ("An empty message", "It has no fields.".to_owned())
        } else {
            ("Nothing found", format!("No field has {search:?} in its path or value."))
        };
        return widgets::empty(ui, icons::ICON_DATA_OBJECT, title, &hint);
    }
    if *more {
        ui.label(RichText::new(format!("  the first {} that were found", rows::MOST_FOUND)).small().weak());
    }
    ui.spacing_mut().item_spacing.y = 0.0;
    let (share, most) = if search.is_empty() { (0.42, 260.0) } else { (0.6, 480.0) };
    let name_width = (ui.available_width() * share).clamp(96.0, most);
    ScrollArea::vertical().auto_shrink(false).show_rows(ui, ROW, rows.len(), |ui, range| {
        for row in &rows[range] {
            let held = overrides(cx.frame).iter().any(|held| {
                *held.buffer == *topic.name && !topic.run.is_recorded() && held.path == row.path.to_string()
            });
            let mark = match (held, draft.has(&row.path.to_string())) {
                (true, _) => Some("held by the operator"),
                (false, true) => Some("edited"),
                (false, false) => None,
            };
            let flash = match row.open {
                Some(true) => 0.0,
                _ => flashes.of(&row.key, &row.text, ui.input(|input| input.time)),
            };
            // Rows move when a list before them becomes longer, and the topic may be another one.
            let response =
                widgets::named(ui, (slot, &row.key), |ui| paint_row(ui, row, name_width, mark, flash));
            if response.clicked() && row.open.is_some() && !saved.open.remove(&row.key) {
                saved.open.insert(row.key.clone());
            }
            response.dnd_set_drag_payload(FieldKey { topic: key.clone(), path: row.path.clone() });
            let leaf =
                value.get(&row.path).ok().filter(|value| row.open.is_none() && text_of(value).is_some());
            if let Some(leaf) = leaf.as_ref().filter(|_| response.double_clicked())
                && refusal(cx.frame, topic).is_none()
            {
                *fresh = draft.begin(&row.path, leaf);
            }
            response.context_menu(|ui| {
                let refused = refusal(cx.frame, topic);
                let edit = ui.add_enabled(leaf.is_some() && refused.is_none(), egui::Button::new("Edit…"));
                if edit.on_disabled_hover_text(refused.unwrap_or("Open it to edit its parts.")).clicked() {
                    if let Some(leaf) = &leaf {
                        *fresh = draft.begin(&row.path, leaf);
                    }
                    ui.close();
                }
                if ui.add_enabled(leaf.is_some(), egui::Button::new("Who wrote this")).clicked() {
                    origin.begin(cx.frame, key, &row.path);
                    ui.close();
                }
                let part = value.get(&row.path).ok();
                if part.as_ref().is_some_and(|part| array::is_array(part)) {
                    let width = array::usual_width(value, &row.path);
                    let forms =
                        [("As a histogram", Form::Histogram), ("As a picture", Form::Picture { width })];
                    for (name, form) in forms {
                        if ui.button(name).clicked() {
                            saved.array = Some(ArrayForm { path: row.path.to_string(), form });
                            ui.close();
                        }
                    }
                }
                if ui.button("Plot").clicked() {
                    cx.wishes.push(Wish::Plot(FieldKey { topic: key.clone(), path: row.path.clone() }));
                    ui.close();
                }
                if ui.button("Copy path").clicked() {
                    ui.ctx().copy_text(row.path.to_string());
                    ui.close();
                }
                if ui.button("Copy value").clicked() {
                    ui.ctx().copy_text(row.text.clone());
                    ui.close();
                }
            });
        }
    });
}

fn paint_row(ui: &mut Ui, row: &Row, name_width: f32, mark: Option<&str>, flash: f32) -> egui::Response {
    let tokens = tokens(ui);
    let (rect, response) =
        ui.allocate_exact_size(Vec2::new(ui.available_width(), ROW), Sense::click_and_drag());
    let name = format!("{} {}", row.name, row.text);
    match row.open {
        Some(open) => {
            response.widget_info(|| WidgetInfo::selected(Role::Button, true, open, name.trim_end()));
        }
        None => response.widget_info(|| WidgetInfo::labeled(Role::Label, true, name.trim_end())),
    }
    if response.hovered() {
        ui.painter().rect_filled(rect, 0.0, tokens.surface[2]);
    }
    let left = rect.left() + 8.0 + INDENT * row.depth as f32;
    if let Some(open) = row.open {
        let icon = if open { icons::ICON_EXPAND_MORE } else { icons::ICON_CHEVRON_RIGHT };
        widgets::icon_at(ui.painter(), Pos2::new(left + 5.0, rect.center().y), icon, 14.0, tokens.weak);
    }
    let middle = (rect.left() + name_width).max(left + 64.0);
    let name =
        Rect::from_min_max(Pos2::new(left + INDENT, rect.top()), Pos2::new(middle - 8.0, rect.bottom()));
    let value =
        Rect::from_min_max(Pos2::new(middle, rect.top()), Pos2::new(rect.right() - 8.0, rect.bottom()));
    if flash > 0.0 {
        ui.painter().rect_filled(value, 2.0, tokens.accent.gamma_multiply(0.35 * flash));
        ui.ctx().request_repaint_after(std::time::Duration::from_millis(50));
    }
    let weak = row.name.starts_with('[');
    let color = if weak { tokens.weak } else { tokens.text };
    widgets::cell(ui, name, Align::Min, &row.name, FontId::proportional(13.0), color);
    let color = if row.open.is_some() { tokens.weak } else { tokens.strong };
    // Signs and quotes have a column of their own, so that digits do not move when the sign changes.
    let hanging = row.text.starts_with(['-', '"']);
    let text = if hanging { row.text.clone() } else { format!(" {}", row.text) };
    widgets::cell(ui, value, Align::Min, &text, FontId::monospace(12.0), color);
    if let Some(mark) = mark {
        widgets::cell(ui, value, Align::Max, mark, FontId::proportional(11.0), tokens.warning);
    }
    response
}
