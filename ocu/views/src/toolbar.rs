//! The toolbar at the top of a view, and controls used by several of them.

use crate::view::TopicKey;
use egui::{Align, Layout, PopupCloseBehavior, RichText, ScrollArea, Ui, Vec2};
use ocu_ui::bar::{self, Bar, Choice, Form};
use ocu_ui::palette::MapPalette;
use ocu_ui::{legend, tokens, typing, widgets};
use rcs_runtime::source::{Frame, Topic};

/// A list of more topics than this is searched.
const MOST_TOPICS: usize = 10;
/// Least width of such a list, and most height of what scrolls below its field, points.
const LIST_WIDTH: f32 = 260.0;
const LIST_HEIGHT: f32 = 320.0;

/// A toolbar, 28 points high, with a line below. Its items change `cx`.
pub(crate) fn show<C>(ui: &mut Ui, bar: Bar<'_, C>, cx: &mut C) {
    let (rect, _) = ui.allocate_exact_size(Vec2::new(ui.available_width(), 28.0), egui::Sense::hover());
    let line = egui::Stroke::new(1.0, tokens(ui).line);
    ui.painter().hline(rect.x_range(), rect.bottom() - 0.5, line);
    let builder = egui::UiBuilder::new()
        .max_rect(rect.shrink2(Vec2::new(8.0, 2.0)))
        .layout(Layout::left_to_right(Align::Center));
    let mut child = ui.new_child(builder);
    child.set_clip_rect(rect.intersect(ui.clip_rect()));
    bar.show(&mut child, 24.0, cx);
    ui.add_space(-ui.spacing().item_spacing.y);
}

/// Name of a topic, with its run where the same name exists both recorded and computed, else as in [`with_type`].
pub(crate) fn topic_label(frame: &Frame, topic: &Topic) -> String {
    let is_computed = |other: &Topic| other.name == topic.name && !other.run.is_recorded();
    if topic.run.is_recorded() && frame.topics.iter().any(is_computed) {
        recorded_label(&topic.name)
    } else {
        with_type(frame, topic, &topic.name)
    }
}

/// A name of a topic, with the type of its messages where its run has several topics of that name.
pub(crate) fn with_type(frame: &Frame, topic: &Topic, name: &str) -> String {
    let is_namesake = |other: &&Topic| other.run == topic.run && other.name == topic.name;
    if frame.topics.iter().filter(is_namesake).count() > 1 {
        format!("{name} ({})", topic.schema.name().replace("/msg/", "/"))
    } else {
        name.to_owned()
    }
}

/// Name of a recorded topic beside a computed one of the same name.
pub(crate) fn recorded_label(name: &str) -> String {
    format!("{name} (recorded)")
}

/// A drop-down list of topics, those of the ground truth last. A long one has a field that leaves those with the typed
/// words.
pub(crate) fn topic_choice(
    ui: &mut Ui,
    form: Form,
    frame: &Frame,
    name: &str,
    shown: Option<&Topic>,
    topics: &[&Topic],
) -> Option<TopicKey> {
    let text = shown.map_or_else(|| "choose a topic".to_owned(), |topic| topic_label(frame, topic));
    let choice = Choice::new(name, &text, [80.0, 160.0]);
    if topics.len() <= MOST_TOPICS {
        return bar::choice(ui, form, choice, |ui| listed(ui, frame, shown, topics)).inner.flatten();
    }
    // What is searched for is kept while the list is open.
    let id = ui.scope_id().with((name, "search"));
    let kept: Option<String> = ui.data(|data| data.get_temp(id));
    let is_fresh = kept.is_none();
    let mut search = kept.unwrap_or_default();
    let choice = Choice { closes: PopupCloseBehavior::CloseOnClickOutside, ..choice };
    let list = bar::choice(ui, form, choice, |ui| {
        ui.set_min_width(LIST_WIDTH);
        searched(ui, frame, shown, topics, &mut search, is_fresh)
    });
    ui.data_mut(|data| match &list.inner {
        Some(None) => {
            data.insert_temp(id, search);
        }
        Some(Some(_)) | None => data.remove::<String>(id),
    });
    list.inner.flatten()
}

/// The topics with the words that are typed in a field above them; returns the one that was chosen, which closes the
/// list. `is_fresh` says that the list was opened in this pass.
fn searched(
    ui: &mut Ui,
    frame: &Frame,
    shown: Option<&Topic>,
    topics: &[&Topic],
    search: &mut String,
    is_fresh: bool,
) -> Option<TopicKey> {
    let field = widgets::search(ui, search, "Search this list");
    let entered = typing::entered(&field);
    let wanted = search.trim().to_lowercase();
    let fits = |topic: &&Topic| {
        let label = topic_label(frame, topic).to_lowercase();
        wanted.split_whitespace().all(|word| label.contains(word))
    };
    let found: Vec<&Topic> = topics.iter().copied().filter(fits).collect();
    let is_searched = !wanted.is_empty();
    // While something is searched for, the list keeps its height, so that the field stays where it is.
    let list = ScrollArea::vertical().max_height(LIST_HEIGHT).auto_shrink([true, !is_searched]);
    let clicked = list.show(ui, |ui| listed(ui, frame, shown, &found)).inner;
    // Enter chooses the first one that was found.
    let first = found.iter().min_by_key(|topic| topic.is_ground_truth());
    let first = first.filter(|_| entered && is_searched);
    let chosen = clicked.or_else(|| first.map(|topic| TopicKey::of(topic)));
    if chosen.is_some() {
        ui.close();
    } else if is_fresh {
        field.request_focus();
    }
    chosen
}

/// The entries of a list of topics; returns the one that was clicked.
fn listed(ui: &mut Ui, frame: &Frame, shown: Option<&Topic>, topics: &[&Topic]) -> Option<TopicKey> {
    let mut chosen = None;
    let mut entry = |ui: &mut Ui, topic: &Topic| {
        let on = shown.is_some_and(|shown| TopicKey::of(topic).is(shown));
        if ui.selectable_label(on, topic_label(frame, topic)).clicked() {
            chosen = Some(TopicKey::of(topic));
        }
    };
    let (truth, others): (Vec<&Topic>, Vec<&Topic>) =
        topics.iter().copied().partition(|topic| topic.is_ground_truth());
    for topic in &others {
        entry(ui, topic);
    }
    if !truth.is_empty() {
        if !others.is_empty() {
            ui.separator();
        }
        ui.label(RichText::new("Truth of the simulation").small().color(tokens(ui).weak));
    }
    for topic in &truth {
        entry(ui, topic);
    }
    if topics.is_empty() {
        ui.label(RichText::new("Nothing has this name.").color(tokens(ui).weak));
    }
    chosen
}

/// The legend of cost colours.
pub(crate) fn cost_legend(ui: &mut Ui, palette: MapPalette) {
    // On a narrow map the swatch goes below the band, and the band is shorter.
    let (one_row_px, labels_px) = (228.0, 60.0);
    let add = |ui: &mut Ui| {
        let width = (ui.available_width() - labels_px).clamp(24.0, 100.0);
        legend::band(ui, width, "cost 0", "250", |fraction| palette.cost((fraction * 250.0) as u8));
        legend::swatch(ui, palette.unknown(), "unknown");
    };
    if ui.available_width() < one_row_px {
        ui.vertical(add);
    } else {
        ui.horizontal(add);
    }
}
