//! The toolbar at the top of a view, and controls used by several of them.

use crate::view::TopicKey;
use egui::{Align, Layout, Ui, Vec2};
use ocu_ui::bar::{self, Bar, Choice, Form};
use ocu_ui::palette::MapPalette;
use ocu_ui::{legend, tokens};
use rcs_runtime::source::{Frame, Topic};

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

/// A drop-down list of topics.
pub(crate) fn topic_choice(
    ui: &mut Ui,
    form: Form,
    frame: &Frame,
    name: &str,
    shown: Option<&Topic>,
    topics: &[&Topic],
) -> Option<TopicKey> {
    let mut chosen = None;
    let text = shown.map_or_else(|| "choose a topic".to_owned(), |topic| topic_label(frame, topic));
    bar::choice(ui, form, Choice::new(name, &text, [80.0, 160.0]), |ui| {
        let mut truth = false;
        for topic in topics {
            if topic.is_ground_truth() && !std::mem::replace(&mut truth, true) {
                ui.separator();
                ui.label(egui::RichText::new("Truth of the simulation").small().color(tokens(ui).weak));
            }
            let on = shown.is_some_and(|shown| TopicKey::of(topic).is(shown));
            if ui.selectable_label(on, topic_label(frame, topic)).clicked() {
                chosen = Some(TopicKey::of(topic));
            }
        }
    });
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
