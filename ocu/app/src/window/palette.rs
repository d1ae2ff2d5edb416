//! The palette, in which a command, a view, a layout, a stack or a course is found by its name, and a moment by its
//! time; and the list of keys, in which they can be changed.

use super::commands::{COMMANDS, Command, Entry, Group, HELD, Needs};
use super::dialog::closing_hint;
use super::keymap::Keymap;
use super::shortcut::Shortcut;
use super::typed_time;
use crate::open::Request;
use crate::time::date_and_time;
use egui::{Align2, Event, Key, RichText, ScrollArea, TextEdit, Vec2};
use ocu_ui::{tokens, typing, widgets};
use ocu_views::ViewType;
use rcs_msg::Stamp;
use rcs_runtime::source::{SourceInfo, SourceKind};

/// Height of the list of the palette, where there is enough to list.
const PALETTE_HEIGHT: f32 = 320.0;
/// Height that the list of keys leaves to its title, its footer and the rest of the window.
const BESIDE_KEYS: f32 = 136.0;
/// Least size of a key in the list of keys.
const KEY: Vec2 = Vec2::new(96.0, 18.0);

/// What can be chosen in the palette.
#[derive(Clone)]
pub(super) enum Choice {
    Command(Command),
    View(&'static ViewType),
    Layout(String),
    Open(Request),
    Time(Stamp),
}

/// What the palette lists: a name, a text at its right, and what is chosen.
type Line = (String, String, Choice);

/// The palette, while it is open.
#[derive(Debug, Default)]
pub(super) struct Palette {
    open: bool,
    text: String,
    /// Index of the marked line.
    marked: usize,
    fresh: bool,
}

impl Palette {
    pub(super) fn toggle(&mut self) {
        *self = Self { open: !self.open, fresh: true, ..Self::default() };
    }

    pub(super) fn is_open(&self) -> bool {
        self.open
    }

    /// What has the typed name.
    fn named(
        &self,
        keymap: &Keymap,
        layouts: &[String],
        sources: &[(String, Request)],
        can: impl Fn(Needs) -> bool,
    ) -> Vec<Line> {
        let wanted = self.text.to_lowercase();
        let fits = |name: &str| wanted.split_whitespace().all(|word| name.to_lowercase().contains(word));
        let mut lines: Vec<Line> = Vec::new();
        for entry in COMMANDS.iter().filter(|entry| can(entry.needs) && entry.command != Command::Palette) {
            lines.push((entry.name.to_owned(), keymap.text(entry.command), Choice::Command(entry.command)));
        }
        for view_type in ocu_views::all() {
            lines.push((format!("View: {}", view_type.name), String::new(), Choice::View(view_type)));
        }
        for name in layouts {
            lines.push((format!("Layout: {name}"), String::new(), Choice::Layout(name.clone())));
        }
        for (name, request) in sources {
            lines.push((name.clone(), String::new(), Choice::Open(request.clone())));
        }
        lines.retain(|(name, ..)| fits(name));
        lines
    }

    /// Paints the palette; returns what was chosen. `sources` are stacks and courses by their names; `source` is what is
    /// open and its last moment; `can` says whether what a command needs is there.
    pub(super) fn ui(
        &mut self,
        ctx: &egui::Context,
        keymap: &Keymap,
        layouts: &[String],
        sources: &[(String, Request)],
        source: Option<(&SourceInfo, Stamp)>,
        can: impl Fn(Needs) -> bool,
    ) -> Option<Choice> {
        if !self.open {
            return None;
        }
        let (mut lines, outside) = source.map(|source| timed(&self.text, source)).unwrap_or_default();
        lines.extend(self.named(keymap, layouts, sources, can));
        self.marked = self.marked.min(lines.len().saturating_sub(1));
        let mut chosen = None;
        // The click that opens the palette is beside it.
        let opens = self.fresh;
        let frame = egui::Frame::popup(&ctx.global_style()).inner_margin(egui::Margin::same(8));
        let area = egui::Area::new(egui::Id::unique("palette"))
            .order(egui::Order::Foreground)
            .anchor(Align2::CENTER_TOP, Vec2::new(0.0, 64.0))
            .show(ctx, |ui| {
                frame.show(ui, |ui| {
                    ui.set_width(420.0);
                    let moved = ui.input_mut(|input| {
                        let down = input.consume_key(egui::Modifiers::NONE, Key::ArrowDown);
                        let up = input.consume_key(egui::Modifiers::NONE, Key::ArrowUp);
                        isize::from(down) - isize::from(up)
                    });
                    let last = lines.len().saturating_sub(1);
                    self.marked = self.marked.saturating_add_signed(moved).min(last);
                    let edit = TextEdit::singleline(&mut self.text)
                        .hint_text("Find a command, view, layout, stack or course, or type a time")
                        .desired_width(f32::INFINITY);
                    let response = ui.add(edit);
                    ui.ctx().accesskit_node_builder(response.id, |node| node.set_label("Find a command"));
                    let entered = typing::entered(&response);
                    typing::keep_keyboard(&response, std::mem::take(&mut self.fresh));
                    if response.changed() {
                        self.marked = 0;
                    }
                    ui.add_space(4.0);
                    // The area remembers how small it was after a search: the list grows again.
                    let list = ScrollArea::vertical().max_height(PALETTE_HEIGHT);
                    list.min_scrolled_height(PALETTE_HEIGHT).show(ui, |ui| {
                        for (index, (name, keys, choice)) in lines.iter().enumerate() {
                            let is_marked = index == self.marked;
                            let response = line(ui, name, keys, is_marked);
                            if is_marked && moved != 0 {
                                response.scroll_to_me(None);
                            }
                            if response.clicked() || (entered && is_marked) {
                                chosen = Some(choice.clone());
                            }
                        }
                    });
                    if let Some(outside) = &outside {
                        ui.label(RichText::new(outside).color(tokens(ui).weak));
                    } else if lines.is_empty() {
                        ui.label(RichText::new("Nothing has this name.").color(tokens(ui).weak));
                    }
                    closing_hint(ui);
                });
            });
        let escaped = ctx.input(|input| input.key_pressed(Key::Escape));
        let is_left = !opens && area.response.clicked_elsewhere();
        if chosen.is_some() || escaped || is_left {
            self.open = false;
        }
        chosen
    }
}

/// The moments that a text means, if it is a time; if none is in the source, that is said in the second.
fn timed(text: &str, (info, end): (&SourceInfo, Stamp)) -> (Vec<Line>, Option<String>) {
    let Some(moments) = typed_time::moments(text, info, end) else { return (Vec::new(), None) };
    let name = |at: Stamp| typed_time::since_start(at, info);
    let outside = moments.is_empty().then(|| {
        let source = if info.kind == SourceKind::Log { "recording" } else { "run" };
        let gaps = if info.gaps.is_empty() { "" } else { ", without its gaps" };
        format!("Outside of the {source}: {} to {}{gaps}", name(info.start), name(end))
    });
    // A clock that starts at 0 would say the same again.
    let date = |at: Stamp| if info.start.0 > 0 { date_and_time(at) } else { String::new() };
    let line = |at: Stamp| (format!("Go to {}", name(at)), date(at), Choice::Time(at));
    (moments.into_iter().map(line).collect(), outside)
}

/// A line of the palette: a name, and keys at the right.
fn line(ui: &mut egui::Ui, name: &str, keys: &str, is_marked: bool) -> egui::Response {
    let tokens = tokens(ui);
    let (rect, response) =
        ui.allocate_exact_size(Vec2::new(ui.available_width(), 22.0), egui::Sense::click());
    response.widget_info(|| egui::WidgetInfo::selected(egui::Role::Button, true, is_marked, name));
    if is_marked || response.hovered() {
        let fill = if is_marked { tokens.selected } else { tokens.surface[2] };
        ui.painter().rect_filled(rect, 3.0, fill);
    }
    let inner = rect.shrink2(Vec2::new(8.0, 0.0));
    let font = egui::TextStyle::Body.resolve(ui.style());
    let ink = if is_marked { tokens.strong } else { tokens.text };
    widgets::cell(ui, inner, egui::Align::Min, name, font, ink);
    let small = egui::TextStyle::Monospace.resolve(ui.style());
    let ink = if is_marked { tokens.text } else { tokens.weak };
    widgets::cell(ui, inner, egui::Align::Max, keys, small, ink);
    response
}

/// The list of keys, while it is open.
#[derive(Debug, Default)]
pub(super) struct KeyList {
    open: bool,
    /// The command whose key is being changed.
    changing: Option<&'static str>,
    /// Why the last change was not possible.
    refused: Option<String>,
}

impl KeyList {
    pub(super) fn toggle(&mut self) {
        *self = Self { open: !self.open, ..Self::default() };
    }

    pub(super) fn close(&mut self) {
        *self = Self::default();
    }

    pub(super) fn is_open(&self) -> bool {
        self.open
    }

    /// Takes the next key for the command that is being changed. Called before the keys of commands are.
    pub(super) fn take_key(&mut self, ctx: &egui::Context, keymap: &mut Keymap) {
        let entry = self.changing.and_then(|id| COMMANDS.iter().find(|entry| entry.id == id));
        let Some(entry) = entry else { return };
        let pressed = ctx.input_mut(|input| {
            let press = input.events.iter().position(
                |event| matches!(event, Event::Key { pressed: true, key, .. } if *key != Key::Escape),
            )?;
            match input.events.remove(press) {
                Event::Key { key, modifiers, .. } => Some(Shortcut::of_press(modifiers, key)),
                _ => None,
            }
        });
        if let Some(shortcut) = pressed {
            self.refused = keymap.set(entry, shortcut).err();
            self.changing = None;
        }
    }

    /// Paints the list.
    pub(super) fn ui(&mut self, ctx: &egui::Context, keymap: &mut Keymap) {
        let mut open = self.open;
        egui::Window::new("Keys")
            .open(&mut open)
            .collapsible(false)
            .resizable(false)
            .anchor(Align2::CENTER_CENTER, Vec2::ZERO)
            .show(ctx, |ui| self.list(ui, keymap));
        self.open = open && !ctx.input(|input| input.key_pressed(Key::Escape));
        if !self.open {
            self.close();
        }
    }

    fn list(&mut self, ui: &mut egui::Ui, keymap: &mut Keymap) {
        let weak = tokens(ui).weak;
        let height = (ui.ctx().content_rect().height() - BESIDE_KEYS).max(64.0);
        // A window begins with a height of its own: the list is as high as its content needs.
        let scroll = ScrollArea::vertical().max_height(height).min_scrolled_height(height);
        scroll.show(ui, |ui| self.rows(ui, keymap));
        ui.add_space(4.0);
        match (&self.refused, self.changing) {
            (Some(refused), _) => ui.colored_label(tokens(ui).warning, refused),
            (None, Some(_)) => ui.label("Press the new key."),
            (None, None) => {
                let closes = match keymap.text(Command::Cancel) {
                    keys if keys.is_empty() => String::new(),
                    keys => format!(" {keys} closes the list."),
                };
                let text = format!("Click a key to change it.{closes}");
                ui.label(RichText::new(text).small().color(weak))
            }
        };
        if keymap.can_be_reset() && ui.small_button("The usual keys").clicked() {
            self.refused = keymap.reset().err();
        }
    }

    /// The commands with their keys, by group.
    fn rows(&mut self, ui: &mut egui::Ui, keymap: &Keymap) {
        let weak = tokens(ui).weak;
        egui::Grid::new("keys").num_columns(2).spacing([16.0, 3.0]).show(ui, |ui| {
            for group in Group::ALL {
                ui.label(RichText::new(group.name()).small().color(weak));
                ui.end_row();
                for entry in COMMANDS.iter().filter(|entry| entry.group == group) {
                    self.row(ui, keymap, entry);
                }
                if group == Group::Safety {
                    for (keys, help) in HELD {
                        ui.add_sized(KEY, egui::Label::new(widgets::mono(*keys)));
                        ui.label(*help);
                        ui.end_row();
                    }
                }
            }
        });
    }

    fn row(&mut self, ui: &mut egui::Ui, keymap: &Keymap, entry: &'static Entry) {
        let is_changing = self.changing == Some(entry.id);
        let text = match keymap.text(entry.command) {
            _ if is_changing => "…".to_owned(),
            keys if keys.is_empty() => "–".to_owned(),
            keys => keys,
        };
        let button = egui::Button::selectable(is_changing, widgets::mono(text.clone())).min_size(KEY);
        let response = ui.add_enabled(entry.command != Command::EmergencyStop, button);
        response.widget_info(|| {
            egui::WidgetInfo::labeled(egui::Role::Button, true, format!("Key of {}: {text}", entry.name))
        });
        if response.clicked() {
            self.changing = if is_changing { None } else { Some(entry.id) };
            self.refused = None;
        }
        ui.label(entry.name);
        ui.end_row();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable;

    #[test]
    fn the_palette_is_as_high_as_before_after_a_search_with_few_hits() {
        let mut harness =
            Harness::builder().with_size([900.0, 600.0]).with_context_setup(ocu_ui::install).build_ui_state(
                |ui, palette: &mut Palette| {
                    palette.ui(ui.ctx(), &Keymap::default(), &[], &[], None, |_| true);
                },
                Palette::default(),
            );
        let height = |harness: &Harness<'_, Palette>| {
            let area = harness.ctx.memory(|memory| memory.area_rect(egui::Id::unique("palette")));
            area.unwrap().height()
        };
        harness.state_mut().toggle();
        harness.run_steps(4);
        let before = height(&harness);
        assert!(before > PALETTE_HEIGHT, "{before}");
        harness.get_by_label("Find a command").type_text("emergency");
        harness.run_steps(4);
        assert!(height(&harness) < 120.0, "{}", height(&harness));
        harness.state_mut().toggle();
        harness.run_steps(4);
        harness.state_mut().toggle();
        harness.run_steps(4);
        assert_eq!(height(&harness), before);
    }

    #[test]
    fn the_palette_says_which_key_closes_it_and_a_click_beside_it_closes_it() {
        let mut harness =
            Harness::builder().with_size([900.0, 600.0]).with_context_setup(ocu_ui::install).build_ui_state(
                |ui, palette: &mut Palette| {
                    super::super::dialog::note_closing_key(ui.ctx(), "F4".to_owned());
                    palette.ui(ui.ctx(), &Keymap::default(), &[], &[], None, |_| true);
                },
                Palette::default(),
            );
        harness.state_mut().toggle();
        harness.run_steps(4);
        assert!(harness.query_by_label("F4 closes").is_some());
        let field = harness.get_by_label("Find a command").rect().center();
        for (at, is_open) in [(field, true), (egui::Pos2::new(20.0, 580.0), false)] {
            harness.drag_at(at);
            harness.step();
            harness.drop_at(at);
            harness.step();
            assert_eq!(harness.state().is_open(), is_open, "{at}");
        }
    }

    #[test]
    fn a_typed_time_comes_first_and_one_outside_of_the_source_is_told() {
        let start = Stamp(1_668_971_465_000_000_000);
        let info = SourceInfo { start, ..SourceInfo::default() };
        let source = || Some((&info, start.after_ns(391_250_000_000)));
        let chosen = std::cell::Cell::new(None);
        let mut harness =
            Harness::builder().with_size([900.0, 600.0]).with_context_setup(ocu_ui::install).build_ui_state(
                |ui, palette: &mut Palette| {
                    if let Some(Choice::Time(at)) =
                        palette.ui(ui.ctx(), &Keymap::default(), &[], &[], source(), |_| true)
                    {
                        chosen.set(Some(at));
                    }
                },
                Palette::default(),
            );
        harness.state_mut().toggle();
        harness.run_steps(4);
        harness.get_by_label("Find a command").type_text("999.5");
        harness.run_steps(4);
        assert!(harness.query_by_label("Outside of the recording: 00:00.000 to 06:31.250").is_some());
        harness.state_mut().toggle();
        harness.run_steps(4);
        harness.state_mut().toggle();
        harness.run_steps(4);
        harness.get_by_label("Find a command").type_text("195.5");
        harness.run_steps(4);
        assert!(harness.query_by_label("Go to 03:15.500").is_some());
        harness.key_press(Key::Enter);
        harness.run_steps(2);
        assert_eq!(chosen.get(), Some(start.after_ns(195_500_000_000)));
    }

    #[test]
    fn a_stack_and_a_course_are_found_by_their_names() {
        let of_stack = |stack: &str| Request { stack: Some(stack.to_owned()), ..Request::default() };
        let sources = ["Stack: truth_driver", "Course: hill"].map(|name| (name.to_owned(), of_stack(name)));
        let chosen = std::cell::RefCell::new(None);
        let mut harness =
            Harness::builder().with_size([900.0, 600.0]).with_context_setup(ocu_ui::install).build_ui_state(
                |ui, palette: &mut Palette| {
                    let keymap = Keymap::default();
                    if let Some(Choice::Open(request)) =
                        palette.ui(ui.ctx(), &keymap, &[], &sources, None, |_| true)
                    {
                        *chosen.borrow_mut() = Some(request);
                    }
                },
                Palette::default(),
            );
        for (typed, name) in [("truth", "Stack: truth_driver"), ("course", "Course: hill")] {
            harness.state_mut().toggle();
            harness.run_steps(4);
            harness.get_by_label("Find a command").type_text(typed);
            harness.run_steps(4);
            harness.get_by_label(name).click();
            harness.run_steps(4);
            assert_eq!(chosen.borrow_mut().take(), Some(of_stack(name)));
        }
    }

    #[test]
    fn the_list_of_keys_fits_into_a_small_window_and_says_how_it_is_closed() {
        let mut harness =
            Harness::builder().with_size([900.0, 600.0]).with_context_setup(ocu_ui::install).build_ui_state(
                |ui, (list, keymap): &mut (KeyList, Keymap)| list.ui(ui.ctx(), keymap),
                (KeyList::default(), Keymap::default()),
            );
        harness.state_mut().0.toggle();
        harness.run_steps(4);
        let screen = egui::Rect::from_min_size(egui::Pos2::ZERO, Vec2::new(900.0, 600.0));
        let footer = harness.get_by_label("Click a key to change it. ctrl . closes the list.").rect();
        assert!(screen.contains_rect(footer), "{footer}");
        let first = harness.get_by_label(Group::ALL[0].name()).rect();
        assert!(screen.contains_rect(first), "{first}");
        let key = harness.get_by_label_contains("Key of Silence the alarms").rect().center().x;
        for (held, _) in HELD {
            let middle = harness.get_by_label(held).rect().center().x;
            assert!((middle - key).abs() < 1.0, "{held}: {middle} {key}");
        }
    }
}
