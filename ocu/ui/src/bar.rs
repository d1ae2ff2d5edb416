//! A bar whose items know how much room there is: where not all of them fit, they take a short form, and then move into
//! a menu at its end, the least important ones first. Nothing overprints and nothing is cut.
//!
//! Items at the left follow each other, items at the right keep their place at the right end. An item says how it gives
//! way ([`Fit`]) and paints itself in the form that it is asked for ([`Form`]). Widths are those of the last time that
//! an item was painted in a form. A form that was never painted is measured first, out of sight; a pass that finds another
//! width than before is painted again. While a list or menu of the bar is open, its items keep their forms: the list
//! would close with the button that opened it.

use crate::{Icon, icons, tokens, widgets};
use egui::containers::menu::{MenuButton, MenuConfig, SubMenuButton};
use egui::{
    Align, Button, ComboBox, Id, InnerResponse, Layout, PopupCloseBehavior, Pos2, Rect, Response, Role,
    ScrollArea, Sense, TextWrapMode, Ui, UiBuilder, Vec2, WidgetInfo,
};
use std::collections::BTreeMap;

/// How an item is painted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Form {
    /// In the bar, with its words.
    Full,
    /// In the bar, as short as it can be: an icon instead of a word.
    Short,
    /// A row of the menu at the end of the bar.
    Listed,
}

/// How an item gives way where there is no room.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fit {
    /// It becomes short before anything else gives way, and stays.
    Shrinks,
    /// It becomes short after everything else has given way, and stays.
    Stays,
    /// It becomes short, and then moves into the menu; items of lower worth go first.
    Leaves(u8),
    /// As [`Fit::Leaves`], but it becomes short before all of those do.
    Shortens(u8),
    /// It takes the room that is left, and disappears below this width. It is the last one at the left.
    Stretches(f32),
}

type Paint<'a, C> = Box<dyn FnMut(&mut Ui, Form, &mut C) + 'a>;

struct Item<'a, C> {
    name: &'static str,
    fit: Fit,
    at_right: bool,
    paint: Paint<'a, C>,
}

impl<C> Item<'_, C> {
    /// Paints it in the bar; returns its width.
    fn paint_in(&mut self, ui: &mut Ui, form: Form, cx: &mut C) -> f32 {
        let stretches = matches!(self.fit, Fit::Stretches(_));
        ui.style_mut().wrap_mode =
            Some(if stretches { TextWrapMode::Truncate } else { TextWrapMode::Extend });
        (self.paint)(ui, form, cx);
        ui.min_rect().width().ceil()
    }
}

/// A bar with its items. `C` is what they change.
pub struct Bar<'a, C> {
    name: &'static str,
    items: Vec<Item<'a, C>>,
}

/// Widths of the items of a bar, by name and form.
type Widths = BTreeMap<(&'static str, Form), f32>;

/// The forms of the items of a bar by name, and its width, points. They are known while a list of the bar is open.
#[derive(Clone, Default)]
struct Kept {
    width: f32,
    forms: BTreeMap<&'static str, Option<Form>>,
}

/// Where a list that is painted is noted, for the bar that is being painted.
fn open_list() -> Id {
    Id::unique("a list of a bar is open")
}

/// Tells the bar that is being painted that a list of it is open.
fn note_open_list(ui: &Ui) {
    ui.data_mut(|data| data.insert_temp(open_list(), true));
}

/// The forms of the pass before, if a list of the bar was open and the bar is as wide as it was. Forgets them, and that a
/// list is open.
fn kept(bar: &Ui, width: f32) -> Option<Kept> {
    let kept: Option<Kept> = bar.data_mut(|data| {
        data.remove::<bool>(open_list());
        data.remove_temp(bar.scope_id())
    });
    kept.filter(|kept| kept.width == width)
}

/// The width of an item that does not stretch.
fn width_of(widths: &Widths, name: &'static str, form: Form) -> f32 {
    widths.get(&(name, form)).copied().unwrap_or(0.0)
}

/// Width of the button of the menu.
const MORE: f32 = 24.0;
/// An item that is narrower than before by at most this keeps its width, points: some lists are narrower by their padding
/// where they have more room, and the bar would change in each pass.
const HARDLY: f32 = 8.0;

impl<'a, C> Bar<'a, C> {
    /// An empty bar; `name` is unique within its parent.
    pub fn new(name: &'static str) -> Self {
        Self { name, items: Vec::new() }
    }

    /// Adds an item after those at the left; `name` is unique within the bar.
    pub fn left(&mut self, name: &'static str, fit: Fit, paint: impl FnMut(&mut Ui, Form, &mut C) + 'a) {
        self.items.push(Item { name, fit, at_right: false, paint: Box::new(paint) });
    }

    /// Adds an item at the right end, after those that are there.
    pub fn right(&mut self, name: &'static str, fit: Fit, paint: impl FnMut(&mut Ui, Form, &mut C) + 'a) {
        self.items.push(Item { name, fit, at_right: true, paint: Box::new(paint) });
    }

    /// Paints the bar over the available width.
    pub fn show(mut self, ui: &mut Ui, height: f32, cx: &mut C) {
        let (rect, _) = ui.allocate_exact_size(Vec2::new(ui.available_width(), height), Sense::hover());
        let id = ui.scope_id().with(("bar", self.name));
        // Ids of widgets count those before them. Here they follow from names alone: a click counts although another item
        // appears while the button is down.
        let ui = &mut ui.new_child(UiBuilder::new().scope_id(id).max_rect(rect));
        let gap = ui.spacing().item_spacing.x;
        let mut known: Widths = ui.data(|data| data.get_temp(id)).unwrap_or_default();
        let has_measured = self.measure(ui, rect, &mut known, cx);
        let mut widths = known.clone();
        let (kept, fitting) = (kept(ui, rect.width()), forms(&self.shapes(&known), rect.width(), gap));
        let forms = self.forms(kept.as_ref(), &fitting);
        let mut listed: Vec<usize> = Vec::new();
        let (mut left, mut right) = (rect.left(), rect.right());
        // The places of those at the right follow from their last widths.
        let mut places = vec![0.0; self.items.len()];
        for (index, item) in self.items.iter().enumerate().rev().filter(|(_, item)| item.at_right) {
            if let Some(form @ (Form::Full | Form::Short)) = forms[index] {
                let width = width_of(&known, item.name, form);
                right -= width;
                places[index] = right;
                right -= if width > 0.0 { gap } else { 0.0 };
            }
        }
        let has_menu = forms.contains(&Some(Form::Listed));
        if has_menu {
            right -= MORE + gap;
        }
        for index in 0..self.items.len() {
            let item = &mut self.items[index];
            let form = match forms[index] {
                None => continue,
                Some(Form::Listed) => {
                    listed.push(index);
                    continue;
                }
                Some(form) => form,
            };
            let stretches = matches!(item.fit, Fit::Stretches(_));
            let (from, to) = if item.at_right {
                (places[index], places[index] + width_of(&known, item.name, form))
            } else {
                (left, right.max(left))
            };
            let place = Rect::from_min_max(Pos2::new(from, rect.top()), Pos2::new(to, rect.bottom()));
            let builder = UiBuilder::new()
                .scope_id(id.with(item.name))
                .max_rect(place)
                .layout(Layout::left_to_right(Align::Center));
            let mut child = ui.new_child(builder);
            child.set_clip_rect(place.expand2(Vec2::new(2.0, 2.0)).intersect(ui.clip_rect()));
            let painted = item.paint_in(&mut child, form, cx);
            let narrower_by = width_of(&known, item.name, form) - painted;
            if !stretches && !(0.0..=HARDLY).contains(&narrower_by) {
                // It says something else, in the other form, too.
                widths.retain(|(name, _), _| *name != item.name);
                widths.insert((item.name, form), painted);
            }
            // An item with nothing to say takes no gap.
            if !item.at_right && painted > 0.0 {
                left += painted + gap;
            }
        }
        if has_menu {
            let place =
                Rect::from_min_size(Pos2::new(right + gap, rect.top()), Vec2::new(MORE, rect.height()));
            self.menu(ui, place, &listed, cx);
        }
        let is_open = self.keep(ui, rect.width(), &forms);
        if has_measured || widths != known || (!is_open && forms != fitting) {
            ui.data_mut(|data| data.insert_temp(id, widths));
            ui.ctx().request_discard("the items of a bar changed their widths");
            ui.ctx().request_repaint();
        }
    }

    /// The forms of the items: those that are kept, else those that fit.
    fn forms(&self, kept: Option<&Kept>, fitting: &[Option<Form>]) -> Vec<Option<Form>> {
        let kept_form = |item: &Item<'a, C>| kept.and_then(|kept| kept.forms.get(item.name).copied());
        self.items.iter().zip(fitting).map(|(item, fitting)| kept_form(item).unwrap_or(*fitting)).collect()
    }

    /// Keeps the forms if a list of the bar is open now; returns whether one is.
    fn keep(&self, ui: &Ui, width: f32, forms: &[Option<Form>]) -> bool {
        let is_open = ui.data(|data| data.get_temp(open_list())).unwrap_or(false);
        if is_open {
            let forms = self.items.iter().zip(forms).map(|(item, form)| (item.name, *form)).collect();
            ui.data_mut(|data| data.insert_temp(ui.scope_id(), Kept { width, forms }));
        }
        is_open
    }

    /// Learns the unknown widths of the forms in the bar, so that each item has its form at once. Otherwise each item that
    /// becomes short would tell only then how much room it leaves, and the bar would take a pass for each of them. Returns
    /// whether there were any.
    fn measure(&mut self, ui: &mut Ui, rect: Rect, widths: &mut Widths, cx: &mut C) -> bool {
        let count = widths.len();
        for item in self.items.iter_mut().filter(|item| !matches!(item.fit, Fit::Stretches(_))) {
            for form in [Form::Full, Form::Short] {
                widths.entry((item.name, form)).or_insert_with(|| {
                    let builder = UiBuilder::new()
                        .scope_id(ui.scope_id().with(("measure", item.name, form)))
                        .max_rect(rect)
                        .layout(Layout::left_to_right(Align::Center))
                        .invisible();
                    let mut child = ui.new_child(builder);
                    child.set_clip_rect(Rect::NOTHING);
                    item.paint_in(&mut child, form, cx)
                });
            }
        }
        widths.len() > count
    }

    /// The items that found no room.
    fn menu(&mut self, ui: &mut Ui, place: Rect, listed: &[usize], cx: &mut C) {
        let builder = UiBuilder::new()
            .scope_id(ui.scope_id().with("the menu of the bar"))
            .max_rect(place)
            .layout(Layout::left_to_right(Align::Center));
        let mut child = ui.new_child(builder);
        child.spacing_mut().button_padding = Vec2::splat(2.0);
        let config = MenuConfig::new().close_behavior(PopupCloseBehavior::CloseOnClickOutside);
        let text = icons::ICON_MORE_HORIZ.rich_text().size(16.0);
        let (response, inner) = MenuButton::new(text).config(config).ui(&mut child, |ui| {
            ui.set_min_width(160.0);
            for &index in listed {
                let item = &mut self.items[index];
                let builder = UiBuilder::new().scope_id(ui.scope_id().with(item.name));
                ui.scope_builder(builder, |ui| (item.paint)(ui, Form::Listed, cx));
            }
        });
        if inner.is_some() {
            note_open_list(&child);
        }
        let name = "More of this bar";
        response.widget_info(|| WidgetInfo::labeled(Role::Button, true, name));
        response.on_hover_text(name);
    }

    fn shapes(&self, known: &Widths) -> Vec<Shape> {
        let shape = |item: &Item<'a, C>| {
            let full = width_of(known, item.name, Form::Full);
            Shape { fit: item.fit, full, short: width_of(known, item.name, Form::Short).min(full) }
        };
        self.items.iter().map(shape).collect()
    }
}

/// What decides about the form of an item.
#[derive(Clone, Copy, Debug)]
struct Shape {
    fit: Fit,
    full: f32,
    short: f32,
}

/// The form of each item of a bar with this width; `None` for an item that is not painted.
fn forms(items: &[Shape], room: f32, gap: f32) -> Vec<Option<Form>> {
    let mut forms = vec![Some(Form::Full); items.len()];
    let needed = |forms: &[Option<Form>]| {
        let mut sum = 0.0;
        for (item, form) in items.iter().zip(forms) {
            let width = match (form, item.fit) {
                (Some(Form::Full | Form::Short), Fit::Stretches(least)) => least,
                (Some(Form::Full), _) => item.full,
                (Some(Form::Short), _) => item.short,
                (Some(Form::Listed) | None, _) => 0.0,
            };
            sum += if width > 0.0 { width + gap } else { 0.0 };
        }
        let menu = if forms.contains(&Some(Form::Listed)) { MORE + gap } else { 0.0 };
        sum - gap + menu
    };
    let worth = |index: &usize| match items[*index].fit {
        Fit::Leaves(worth) | Fit::Shortens(worth) => u16::from(worth),
        Fit::Shrinks | Fit::Stays | Fit::Stretches(_) => u16::MAX,
    };
    let mut order: Vec<usize> = (0..items.len()).collect();
    order.sort_by_key(worth);
    // An item that has nothing to say takes no room, and would leave an empty menu.
    let leaves = |index: &usize| {
        matches!(items[*index].fit, Fit::Leaves(_) | Fit::Shortens(_)) && items[*index].full > 0.0
    };
    let leaving = || order.iter().copied().filter(leaves);
    let is_first = |index: &usize| matches!(items[*index].fit, Fit::Shortens(_));
    let of = |fit: Fit| order.iter().copied().filter(move |&index| items[index].fit == fit);
    let steps = of(Fit::Shrinks)
        .chain(leaving().filter(is_first))
        .chain(leaving())
        .map(|index| (index, Some(Form::Short)))
        .chain(leaving().map(|index| (index, Some(Form::Listed))))
        .chain(of(Fit::Stays).map(|index| (index, Some(Form::Short))));
    for (index, form) in steps {
        if needed(&forms) <= room {
            break;
        }
        forms[index] = form;
    }
    if needed(&forms) > room {
        for (index, item) in items.iter().enumerate() {
            if matches!(item.fit, Fit::Stretches(_)) {
                forms[index] = None;
            }
        }
    }
    forms
}

/// A button of a bar: an icon with a name, which is written beside it in the menu.
pub fn tool(ui: &mut Ui, form: Form, icon: Icon, name: &str) -> Response {
    tool_of(ui, form, icon, name, false, true)
}

/// Like [`tool`], with a state, and perhaps disabled.
pub fn tool_of(ui: &mut Ui, form: Form, icon: Icon, name: &str, on: bool, enabled: bool) -> Response {
    if form != Form::Listed {
        return widgets::icon_button_of(ui, icon, name, on, enabled);
    }
    let button = Button::selectable(on, format!("{}  {name}", icon.codepoint));
    let response = ui.add_enabled(enabled, button);
    response.widget_info(|| WidgetInfo::selected(Role::Button, enabled, on, name));
    if response.clicked() {
        ui.close();
    }
    response
}

/// Like [`tool`], which toggles a value.
pub fn tool_toggle(ui: &mut Ui, form: Form, icon: Icon, name: &str, on: &mut bool) -> Response {
    let response = tool_of(ui, form, icon, name, *on, true);
    if response.clicked() {
        *on = !*on;
    }
    response
}

/// A menu of a bar: an icon and a word; the icon alone where it is short.
pub fn menu(ui: &mut Ui, form: Form, icon: Icon, name: &str, add: impl FnOnce(&mut Ui)) -> Response {
    menu_of(ui, form, icon, name, name, add)
}

/// Like [`menu`], with a text that differs from its name.
pub fn menu_of(
    ui: &mut Ui,
    form: Form,
    icon: Icon,
    text: &str,
    name: &str,
    add: impl FnOnce(&mut Ui),
) -> Response {
    let config = MenuConfig::new().close_behavior(PopupCloseBehavior::CloseOnClickOutside);
    let shown = match form {
        Form::Short => icon.codepoint.to_owned(),
        Form::Full | Form::Listed => format!("{}  {text}", icon.codepoint),
    };
    let (response, inner) = if form == Form::Listed {
        SubMenuButton::new(shown).config(config).ui(ui, add)
    } else {
        MenuButton::new(shown).config(config).ui(ui, add)
    };
    if inner.is_some() {
        note_open_list(ui);
    }
    response.widget_info(|| WidgetInfo::labeled(Role::Button, true, name));
    response
}

/// A list of a bar from which something is chosen.
#[derive(Clone, Copy, Debug)]
pub struct Choice<'a> {
    /// What is chosen.
    pub name: &'a str,
    /// The entry that is chosen now.
    pub text: &'a str,
    /// Width of its button in the bar, short and in full, points.
    pub widths: [f32; 2],
    /// What closes the list.
    pub closes: PopupCloseBehavior,
}

impl<'a> Choice<'a> {
    /// A list that a click on an entry closes.
    pub fn new(name: &'a str, text: &'a str, widths: [f32; 2]) -> Self {
        Self { name, text, widths, closes: PopupCloseBehavior::CloseOnClick }
    }
}

/// Most height of a list, points.
const LIST: f32 = 400.0;

/// A list whose entries `add` paints. In the menu it is a submenu: a list would close the menu and itself. Returns its
/// button, and what `add` returned while the list is open.
pub fn choice<R>(
    ui: &mut Ui,
    form: Form,
    choice: Choice<'_>,
    add: impl FnOnce(&mut Ui) -> R,
) -> InnerResponse<Option<R>> {
    let Choice { name, text, widths: [short, full], closes } = choice;
    let list = if form == Form::Listed {
        let config = MenuConfig::new().close_behavior(closes);
        let button = SubMenuButton::new(format!("{name}: {text}")).config(config);
        let (response, inner) =
            button.ui(ui, |ui| ScrollArea::vertical().max_height(LIST).show(ui, add).inner);
        InnerResponse::new(inner.map(|inner| inner.inner), response)
    } else {
        let width = if form == Form::Short { short } else { full };
        let combo = ComboBox::from_id_salt(name).selected_text(text).width(width).truncate();
        combo.height(LIST).close_behavior(closes).show_ui(ui, add)
    };
    if list.inner.is_some() {
        note_open_list(ui);
    }
    list.response.widget_info(|| WidgetInfo::labeled(Role::ComboBox, true, name));
    list
}

/// A thin line between groups of a bar; nothing in the menu.
pub fn divider(ui: &mut Ui, form: Form) {
    if form != Form::Listed {
        let (rect, _) = ui.allocate_exact_size(Vec2::new(1.0, 16.0), Sense::hover());
        ui.painter().rect_filled(rect, 0.0, tokens(ui).line);
    }
}

#[cfg(test)]
#[path = "bar_tests.rs"]
mod tests;
