//! What everyone needs of every view: widgets that have names and are reached with the keyboard, and text that can be
//! read in both themes.

use super::{Shown, harness};
use crate::samples;
use crate::views::all;
use egui::accesskit::{NodeId, Role};
use egui::epaint::{ClippedShape, TextShape};
use egui::{Color32, Key, Pos2, Rect, Shape, Theme, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT as _, Queryable as _};
use ocu_ui::contrast;
use rcs_runtime::source::Frame;
use std::collections::BTreeMap;

const SIZE: Vec2 = Vec2::new(900.0, 560.0);
/// Least contrast of text, and of icons (WCAG 2, 1.4.3 and 1.4.11).
const TEXT: f32 = 4.5;
const ICON: f32 = 3.0;
/// Opacity of what is disabled.
const DISABLED: u8 = 128;
/// More widgets than any view of the samples has.
const MOST: usize = 400;

fn frames() -> [Frame; 4] {
    [samples::empty(), samples::full(), samples::camera_in_space(), samples::compared()]
}

fn open(kind: &str, frame: &Frame, theme: Theme) -> Harness<'static, Shown> {
    let mut harness = harness(Shown::new(kind, frame.clone()), SIZE, theme);
    harness.state_mut().selection.topic = Some(crate::TopicKey::shown("/wm1/map"));
    harness.state_mut().selection.process = frame.processes.first().map(|info| info.name.as_str().into());
    harness.run();
    harness
}

#[test]
fn every_widget_of_every_view_has_a_name() {
    for view_type in all() {
        for frame in &frames() {
            let harness = open(view_type.kind, frame, Theme::Dark);
            assert_eq!(harness.unnamed_widgets(), Vec::<String>::new(), "{}", view_type.kind);
        }
    }
}

/// What can be clicked or set, and is on the screen, by its name.
fn widgets(harness: &Harness<'_, Shown>) -> BTreeMap<NodeId, String> {
    let wanted =
        [Role::Button, Role::CheckBox, Role::ComboBox, Role::Slider, Role::SpinButton, Role::TextInput];
    let root = harness.root();
    let nodes = root.children_recursive().filter(|node| {
        let access = node.accesskit_node();
        let is_seen = access.bounding_box().is_some_and(|place| {
            place.x0 >= 0.0 && place.y0 >= 0.0 && place.x1 <= SIZE.x.into() && place.y1 <= SIZE.y.into()
        });
        wanted.contains(&access.role()) && !access.is_disabled() && is_seen
    });
    let named = nodes.map(|node| {
        let access = node.accesskit_node();
        (access.locate().0, access.label().unwrap_or_default())
    });
    named.collect()
}

#[test]
fn every_widget_of_every_view_is_reached_with_the_tab_key() {
    for view_type in all() {
        let mut harness = open(view_type.kind, &samples::driving(), Theme::Dark);
        let mut left = widgets(&harness);
        let mut before = None;
        for _ in 0..MOST {
            if left.is_empty() {
                break;
            }
            harness.key_press(Key::Tab);
            harness.step();
            let root = harness.root();
            let focused = root.children_recursive().find(|node| node.accesskit_node().is_focused());
            let focused = focused.map(|node| node.accesskit_node().locate().0);
            assert!(focused != before || focused.is_none(), "{}: Tab stays at {focused:?}", view_type.kind);
            if let Some(id) = &focused {
                left.remove(id);
            }
            before = focused;
        }
        assert!(left.is_empty(), "{}: not reached with Tab: {left:?}", view_type.kind);
    }
}

/// The names of all lists to choose from, and the number of all widgets.
fn lists(harness: &Harness<'_, Shown>) -> (Vec<String>, usize) {
    let root = harness.root();
    let nodes: Vec<_> = root.children_recursive().map(|node| node.accesskit_node()).collect();
    let lists = nodes.iter().filter(|node| node.role() == Role::ComboBox);
    (lists.map(|node| node.label().unwrap_or_default()).collect(), nodes.len())
}

#[test]
fn every_list_that_moved_into_the_menu_of_its_bar_opens_there() {
    let mut opened = Vec::new();
    for view_type in all() {
        let mut harness =
            harness(Shown::new(view_type.kind, samples::full()), Vec2::new(150.0, 700.0), Theme::Dark);
        harness.run();
        let (in_bar, _) = lists(&harness);
        let Some(more) = harness.query_by_label("More of this bar") else { continue };
        more.click();
        harness.run();
        let (with_menu, widgets) = lists(&harness);
        for name in with_menu.iter().filter(|name| !in_bar.contains(name)) {
            harness.get_by_label(name).click();
            harness.run();
            let (after, more_widgets) = lists(&harness);
            assert!(after.contains(name), "{}: {name} closes the menu", view_type.kind);
            assert!(more_widgets > widgets, "{}: {name} shows nothing", view_type.kind);
            opened.push(name.clone());
        }
    }
    assert!(opened.iter().any(|name| name == "Frame of the map"), "{opened:?}");
}

/// What is behind a text: a colour, or a picture of any colours.
#[derive(Clone, Copy)]
enum Behind {
    Color(Color32),
    Picture,
}

/// What has been painted so far, and texts that contrast too little with it.
#[derive(Default)]
struct Painted {
    areas: Vec<(Rect, Behind)>,
    faint: Vec<String>,
    texts: usize,
}

impl Painted {
    fn add(&mut self, clip: Rect, shape: &Shape) {
        let mut area = |rect: Rect, behind| self.areas.push((rect.intersect(clip), behind));
        match shape {
            Shape::Vec(shapes) => shapes.iter().for_each(|shape| self.add(clip, shape)),
            Shape::Rect(rect) if rect.brush.is_some() => area(rect.rect, Behind::Picture),
            Shape::Rect(rect) if rect.fill.a() > 0 => area(rect.rect, Behind::Color(rect.fill)),
            Shape::Mesh(_) | Shape::Path(_) | Shape::Circle(_) | Shape::Callback(_) => {
                area(shape.visual_bounding_rect(), Behind::Picture);
            }
            Shape::Text(text) => self.text(clip, text),
            _ => {}
        }
    }

    fn behind(&self, at: Pos2) -> Option<Color32> {
        let mut color = Color32::BLACK;
        for (_, behind) in self.areas.iter().filter(|(rect, _)| rect.contains(at)) {
            match behind {
                Behind::Color(over) => color = color.blend(*over),
                Behind::Picture => return None,
            }
        }
        Some(color)
    }

    fn text(&mut self, clip: Rect, text: &TextShape) {
        for row in &text.galley.rows {
            for glyph in row.glyphs.iter().filter(|glyph| !glyph.chr.is_whitespace()) {
                let at = text.pos + row.pos.to_vec2() + glyph.logical_rect().center().to_vec2();
                let Some(behind) = self.behind(at).filter(|_| clip.contains(at)) else { continue };
                let own =
                    row.visuals.mesh.vertices.get(glyph.first_vertex as usize).map(|vertex| vertex.color);
                let own = own.filter(|color| *color != Color32::PLACEHOLDER);
                let color = text.override_text_color.or(own).unwrap_or(text.fallback_color);
                // Of what cannot be used, which is half transparent, nothing is demanded (WCAG 2, 1.4.3).
                if color.a().abs_diff(DISABLED) < 8 {
                    continue;
                }
                let seen = contrast(behind.blend(color), behind);
                self.texts += 1;
                let is_icon = matches!(glyph.chr, '\u{e000}'..='\u{f8ff}' | '\u{f0000}'..='\u{ffffd}');
                if seen < if is_icon { ICON } else { TEXT } {
                    let line = text.galley.text();
                    self.faint
                        .push(format!("{seen:.2}: {:?} of {line:?}, {color:?} on {behind:?}", glyph.chr));
                    break;
                }
            }
        }
    }
}

#[test]
fn every_text_of_every_view_can_be_read_in_both_themes() {
    let mut faint = Vec::new();
    for view_type in all() {
        let mut texts = 0;
        for frame in &frames() {
            for theme in [Theme::Dark, Theme::Light] {
                let harness = open(view_type.kind, frame, theme);
                let mut painted = Painted::default();
                for ClippedShape { clip_rect, shape, .. } in &harness.output().shapes {
                    painted.add(*clip_rect, shape);
                }
                texts += painted.texts;
                let told =
                    painted.faint.into_iter().map(|line| format!("{} {theme:?} {line}", view_type.kind));
                faint.extend(told);
            }
        }
        assert!(texts > 20, "{}: {texts} letters", view_type.kind);
    }
    faint.dedup();
    assert!(faint.is_empty(), "{} texts:\n{}", faint.len(), faint.join("\n"));
}
