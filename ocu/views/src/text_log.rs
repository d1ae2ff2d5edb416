//! Text log: what happened, line by line: log messages, errors, commands, changes of mode, acts of the operator.
//!
//! Lines of the past are bright and those of the future dim; a click goes to the time of a line. The list follows the
//! viewed time until it is scrolled, and again after it was scrolled to its end or back to the viewed time.

use crate::view::{Hover, SavedState, View, ViewContext};
use egui::{Align, FontId, Rect, Role, ScrollArea, Sense, Ui, Vec2, WidgetInfo};
use ocu_ui::bar::{self, Bar, Fit, Form};
use ocu_ui::{Icon, Tokens, format, icons, tokens, widgets};
use rcs_msg::Stamp;
use rcs_runtime::source::{Control, Event, EventKind, EventLevel, Events, Frame};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

const ROW: f32 = 18.0;
/// Widths of the time, of the icon and of the source.
const TIME: f32 = 92.0;
const ICON: f32 = 20.0;
const SOURCE: f32 = 132.0;

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
struct Saved {
    /// What a line must hold to be shown.
    search: String,
    /// Kinds that are hidden, by name.
    hidden: BTreeSet<String>,
    /// Whether only warnings and errors are shown.
    alarms: bool,
}

impl Saved {
    /// Says what none of so many lines is.
    fn nothing_found(&self, lines: usize) -> String {
        let rules = [
            (self.alarms, "is a warning or an error"),
            (!self.hidden.is_empty(), "is of the chosen kinds"),
            (!self.search.trim().is_empty(), "has the searched words"),
        ];
        let rules: Vec<&str> = rules.into_iter().filter(|(holds, _)| *holds).map(|(_, rule)| rule).collect();
        format!("None of {lines} lines {}.", rules.join(" and "))
    }
}

/// The text log.
#[derive(Default)]
pub(crate) struct TextLog {
    saved: Saved,
    /// The lines that are shown, and what they were chosen from and by.
    lines: Vec<u32>,
    read: usize,
    chosen: Option<(Events, Saved)>,
    /// Number of lines of the past when they were shown last.
    last: Option<usize>,
    /// How far the list was scrolled in the last pass, points.
    offset: f32,
    /// Whether it was scrolled away from the viewed time.
    is_left: bool,
}

impl View for TextLog {
    fn title(&self, _frame: &Frame) -> String {
        "Log".to_owned()
    }

    fn save(&self) -> SavedState {
        serde_json::to_value(&self.saved).unwrap_or_default()
    }

    fn load(&mut self, saved: &SavedState) -> Result<(), serde_json::Error> {
        self.saved = serde_json::from_value(saved.clone())?;
        Ok(())
    }

    fn ui(&mut self, ui: &mut Ui, cx: &mut ViewContext<'_>) {
        let Some(events) = cx.frame.events().filter(|events| !events.is_empty()) else {
            let hint = "Log messages, commands, errors and changes of mode would fill it: run a stack, or open a \
                        recording of one.";
            return widgets::empty(ui, icons::ICON_ARTICLE, "Nothing has happened yet", hint);
        };
        self.toolbar(ui, events);
        self.choose(events);
        if self.lines.is_empty() {
            let hint = self.saved.nothing_found(events.len());
            return widgets::empty(ui, icons::ICON_SEARCH_OFF, "Nothing found", &hint);
        }
        let past = self.past(events, cx.frame.now);
        let is_other = self.last.replace(past) != Some(past);
        ui.spacing_mut().item_spacing.y = 0.0;
        // The end of the list is further down than in the last pass where lines were appended: an offset that is set there
        // would spring back.
        ui.spacing_mut().scroll.kinetic.rubber_band = false;
        let mut area = ScrollArea::vertical().auto_shrink(false);
        let height = ui.available_height();
        let end = (self.lines.len() as f32 * ROW - height).max(0.0);
        let place = (past as f32 * ROW - height + 2.0 * ROW).clamp(0.0, end);
        if is_other && !self.is_left {
            area = area.vertical_scroll_offset(place);
            self.offset = place;
        }
        let shown = area.show_rows(ui, ROW, self.lines.len(), |ui, range| {
            for line in range {
                let Some(event) = self.lines.get(line).and_then(|&index| events.get(index as usize)) else {
                    continue;
                };
                row(ui, cx, &event, line < past);
            }
        });
        let most = (shown.content_size.y - shown.inner_rect.height()).max(0.0);
        self.scrolled(place.min(most), most, shown.state.clamped_offset().y);
    }
}

impl TextLog {
    fn toolbar(&mut self, ui: &mut Ui, events: &Events) {
        let counts = events.counts();
        let mut bar: Bar<'_, Saved> = Bar::new("toolbar");
        bar.left("alarms", Fit::Leaves(20), |ui, form, saved| {
            let name = "Warnings and errors only";
            bar::tool_toggle(ui, form, icons::ICON_WARNING, name, &mut saved.alarms);
        });
        bar.left("kinds", Fit::Leaves(10), move |ui, form, saved| {
            let shown = EventKind::ALL.len() - saved.hidden.len();
            let text =
                if saved.hidden.is_empty() { "All kinds".to_owned() } else { format!("{shown} kinds") };
            bar::menu_of(ui, form, icons::ICON_FILTER_LIST, &text, "Kinds", |ui| {
                for kind in EventKind::ALL {
                    let mut on = !saved.hidden.contains(kind.name());
                    let text = format!("{} ({})", kind.name(), format::count(counts[kind as usize] as u64));
                    if ui.checkbox(&mut on, text).changed() && !saved.hidden.remove(kind.name()) {
                        saved.hidden.insert(kind.name().to_owned());
                    }
                }
            });
        });
        bar.left("search", Fit::Stretches(64.0), |ui, _: Form, saved| {
            widgets::search(ui, &mut saved.search, "Search the log");
        });
        crate::toolbar::show(ui, bar, &mut self.saved);
    }

    /// Decides whether the list follows the viewed time: not any more once the user has scrolled it, and again at its end
    /// `most`, or where it was scrolled back to the place that it would have. All in points.
    fn scrolled(&mut self, place: f32, most: f32, offset: f32) {
        let before = std::mem::replace(&mut self.offset, offset).min(most);
        if offset >= most - 0.5 {
            self.is_left = false;
        } else if (offset - before).abs() > 0.5 {
            let (now, then) = ((offset - place).abs(), (before - place).abs());
            self.is_left = now >= then || now > ROW;
        }
    }

    /// Adds what has been appended to the lines that are shown; all of them where something else is chosen.
    fn choose(&mut self, events: &Events) {
        let is_same = |(of, by): &(Events, Saved)| of.same(events) && *by == self.saved;
        if !self.chosen.as_ref().is_some_and(is_same) || events.len() < self.read {
            (self.lines, self.read) = (Vec::new(), 0);
            (self.last, self.is_left) = (None, false);
            self.chosen = Some((events.clone(), self.saved.clone()));
        }
        let search = self.saved.search.trim().to_lowercase();
        let hidden: Vec<EventKind> =
            EventKind::ALL.into_iter().filter(|kind| self.saved.hidden.contains(kind.name())).collect();
        let alarms = self.saved.alarms;
        let lines = &mut self.lines;
        events.each_from(self.read, |index, event| {
            let found = search.is_empty()
                || event.text.to_lowercase().contains(&search)
                || event.source.to_lowercase().contains(&search);
            if found && !hidden.contains(&event.kind) && (!alarms || event.level > EventLevel::Info) {
                lines.push(index as u32);
            }
        });
        self.read = events.len();
    }

    /// Number of lines up to a time.
    fn past(&self, events: &Events, now: Stamp) -> usize {
        let until = events.count_until(now) as u32;
        self.lines.partition_point(|&index| index < until)
    }
}

fn row(ui: &mut Ui, cx: &mut ViewContext<'_>, event: &Event, is_past: bool) {
    let tokens = tokens(ui);
    let (rect, response) = ui.allocate_exact_size(Vec2::new(ui.available_width(), ROW), Sense::click());
    let name = format!("{}: {}", event.source, event.text);
    response.widget_info(|| WidgetInfo::labeled(Role::Button, true, &name));
    let is_meant = cx.selection.hovered.get().process.as_deref() == Some(&*event.source);
    if response.hovered() || is_meant {
        ui.painter().rect_filled(rect, 0.0, tokens.surface[2]);
    }
    if response.hovered() {
        let process = Some(event.source.clone());
        cx.selection.hovered.set(Hover { process, time: Some(event.stamp), ..Hover::default() });
    }
    if response.clicked() {
        cx.controls.extend(Control::pause_at(event.stamp));
    }
    let ink = if is_past { tokens.text } else { tokens.weak };
    let (icon, color) = look(event, tokens);
    let color = if is_past { color } else { tokens.weak };
    let wide = rect.width() >= 420.0;
    let mut left = rect.left() + 8.0;
    let mut place = |width: f32| {
        let right = (left + width).min(rect.right() - 8.0).max(left);
        let place = Rect::from_x_y_ranges(left..=right, rect.y_range());
        left += width + 8.0;
        place
    };
    let time = format::elapsed(event.stamp.seconds_since(cx.frame.info.start));
    widgets::cell(ui, place(TIME), Align::Min, &time, FontId::monospace(11.5), tokens.weak);
    widgets::icon_at(ui.painter(), place(ICON).center(), icon, 14.0, color);
    if wide {
        widgets::cell(ui, place(SOURCE), Align::Min, &event.source, FontId::proportional(12.0), tokens.weak);
    }
    // A row is one line; resting on it shows the text as it is.
    let text = if wide { &event.text } else { name.as_str() }.replace(['\n', '\r', '\t'], " ");
    let color = if event.level > EventLevel::Info { color } else { ink };
    let rest = place(rect.width());
    widgets::cell(ui, rest, Align::Min, &text, FontId::proportional(12.0), color);
    widgets::help_beside(response, &name);
}

/// Icon and colour of an event. The icon has the meaning of the colour.
fn look(event: &Event, tokens: &Tokens) -> (Icon, egui::Color32) {
    match (event.level, event.kind) {
        (EventLevel::Error, _) => (icons::ICON_ERROR, tokens.error),
        (EventLevel::Warning, EventKind::Operator) => (icons::ICON_DANGEROUS, tokens.warning),
        (EventLevel::Warning, _) => (icons::ICON_WARNING, tokens.warning),
        (_, EventKind::Command) => (icons::ICON_ARROW_DOWNWARD, tokens.accent),
        (_, EventKind::Operator) => (icons::ICON_PERSON, tokens.accent),
        (_, EventKind::Mode) => (icons::ICON_SYNC_ALT, tokens.ok),
        _ => (icons::ICON_NOTES, tokens.weak),
    }
}
