//! The views in the middle of the window, in tiles and tabs that the user arranges.

mod topics;

use super::document::VIEWPORT;
use crate::layout::{Layout, Node, VERSION};
use egui_tiles::{Container, Linear, LinearDir, SimplificationOptions, Tabs, Tile, TileId, Tiles, Tree};
use ocu_ui::{icons, tokens, widgets};
use ocu_views::{FieldKey, RunChoice, SavedState, View, ViewContext, ViewType, view_type};
use rcs_runtime::RunId;
use rcs_runtime::source::Compared;
use std::collections::{BTreeMap, BTreeSet};

/// One view in its tile.
struct Pane {
    /// Identity in this window.
    id: u64,
    view_type: &'static ViewType,
    view: Box<dyn View>,
    /// The run that it shows.
    run: RunChoice,
}

/// The tiles and their views.
pub(super) struct Workspace {
    tree: Tree<Pane>,
    name: String,
    /// The id of the next view.
    next_id: u64,
    /// The view that was used last, beside which new ones open.
    focused: Option<u64>,
}

impl Workspace {
    /// Creates the views of a layout.
    pub(super) fn new(layout: &Layout) -> Self {
        let tree = Tree::empty(id());
        let mut workspace = Self { tree, name: String::new(), next_id: 1, focused: None };
        workspace.apply(layout);
        workspace
    }

    /// Goes to another arrangement. Views that are in both stay as they are, and keep where they look.
    pub(super) fn apply(&mut self, layout: &Layout) {
        let old = std::mem::replace(&mut self.tree, Tree::empty(id()));
        let panes =
            old.tiles.iter().filter_map(|(tile, content)| matches!(content, Tile::Pane(_)).then_some(*tile));
        let panes: Vec<TileId> = panes.collect();
        let mut old_tiles = old.tiles;
        let taken = panes.into_iter().filter_map(|tile| match old_tiles.remove(tile) {
            Some(Tile::Pane(pane)) => Some((pane.id, pane)),
            _ => None,
        });
        let mut maker = Maker { old: taken.collect(), next_id: self.next_id };
        let mut tiles = Tiles::default();
        if let Some(root) = maker.insert(&mut tiles, &layout.root) {
            self.tree = Tree::new(id(), root, tiles);
        }
        self.next_id = maker.next_id;
        self.name.clone_from(&layout.name);
        self.simplify();
    }

    /// Simplifies the tree after a change, as the next pass would do: the change is recorded before that pass, and what
    /// is recorded must stay as it is.
    fn simplify(&mut self) {
        self.tree.simplify(&simplification());
    }

    /// The current arrangement as a layout.
    pub(super) fn layout(&self, buffers: bool) -> Layout {
        let root = self.tree.root().and_then(|root| extract(&self.tree.tiles, root));
        Layout {
            version: VERSION,
            name: self.name.clone(),
            buffers,
            root: root.unwrap_or(Node::Row(Vec::new())),
        }
    }

    /// Name of the layout from which it was made.
    pub(super) fn name(&self) -> &str {
        &self.name
    }

    /// Gives the arrangement another name.
    pub(super) fn rename(&mut self, name: String) {
        self.name = name;
    }

    /// The runs that views show beside the viewed one.
    pub(super) fn runs(&self) -> Vec<RunId> {
        self.union(|pane| pane.run.id().into_iter().chain(pane.view.runs()).collect())
    }

    /// The fields whose values over time views need.
    pub(super) fn fields(&self) -> Vec<rcs_formula::FieldRef> {
        self.union(|pane| pane.view.fields())
    }

    /// What views compare.
    pub(super) fn compares(&self) -> Vec<[Compared; 2]> {
        self.union(|pane| pane.view.compares().into_iter().collect())
    }

    /// Whether a view shows the moment in the other recording of a comparison.
    pub(super) fn shows_other(&self) -> bool {
        self.union(|pane| vec![pane.view.shows_other()]).contains(&true)
    }

    /// What all views need, each once.
    fn union<T: Ord>(&self, of: impl Fn(&Pane) -> Vec<T>) -> Vec<T> {
        let panes = self.tree.tiles.tiles().filter_map(|tile| match tile {
            Tile::Pane(pane) => Some(of(pane)),
            Tile::Container(_) => None,
        });
        panes.flatten().collect::<BTreeSet<T>>().into_iter().collect()
    }

    /// Whether there is no view.
    pub(super) fn is_empty(&self) -> bool {
        !self.tree.tiles.tiles().any(|tile| matches!(tile, Tile::Pane(_)))
    }

    fn pane(&mut self, view_type: &'static ViewType) -> Pane {
        let id = self.next_id;
        self.next_id += 1;
        self.focused = Some(id);
        Pane { id, view_type, view: (view_type.make)(), run: RunChoice::Shown }
    }

    /// The tile of the view that was used last.
    fn focused_tile(&self) -> Option<TileId> {
        let wanted = self.focused?;
        let panes = self.tree.tiles.iter();
        panes
            .filter(|(_, tile)| matches!(tile, Tile::Pane(pane) if pane.id == wanted))
            .map(|(id, _)| *id)
            .find(|&id| self.tree.is_visible(id))
    }

    /// Adds a view beside the one that was used last, along its longer side; without one, at the right of all others.
    pub(super) fn add(&mut self, view_type: &'static ViewType) {
        self.insert(view_type);
        self.simplify();
    }

    fn insert(&mut self, view_type: &'static ViewType) {
        let beside = self.focused_tile().map(|pane| self.tree.tiles.parent_of(pane).unwrap_or(pane));
        let pane = self.pane(view_type);
        let pane = self.tree.tiles.insert_pane(pane);
        let added = self.tree.tiles.insert_tab_tile(vec![pane]);
        let Some(root) = self.tree.root().filter(|_| !self.is_alone(added)) else {
            self.tree = Tree::new(id(), added, std::mem::take(&mut self.tree.tiles));
            return;
        };
        let beside = beside.unwrap_or(root);
        let size = self.tree.tiles.rect(beside).map_or(egui::vec2(2.0, 1.0), |rect| rect.size());
        let dir = if size.x >= size.y { LinearDir::Horizontal } else { LinearDir::Vertical };
        if let Some(parent) = self.tree.tiles.parent_of(beside)
            && let Some(Tile::Container(Container::Linear(linear))) = self.tree.tiles.get_mut(parent)
            && linear.dir == dir
        {
            // Both share the place that the one had.
            let share = linear.shares[beside] / 2.0;
            linear.shares.set_share(beside, share);
            linear.shares.set_share(added, share);
            let index = linear.children.iter().position(|&child| child == beside);
            linear.children.insert(index.map_or(linear.children.len(), |index| index + 1), added);
            return;
        }
        let parent = self.tree.tiles.parent_of(beside);
        let both = self.tree.tiles.insert_container(Linear::new(dir, vec![beside, added]));
        match parent.and_then(|parent| self.tree.tiles.get_mut(parent)) {
            Some(Tile::Container(Container::Linear(linear))) => {
                let share = linear.shares[beside];
                linear.shares.set_share(both, share);
                replace(&mut linear.children, beside, both);
            }
            Some(Tile::Container(Container::Tabs(tabs))) => {
                let was_active = tabs.is_active(beside);
                replace(&mut tabs.children, beside, both);
                if was_active {
                    tabs.set_active(both);
                }
            }
            Some(Tile::Container(Container::Grid(grid))) => {
                let at = grid.children().position(|&child| child == beside).unwrap_or(0);
                let _replaced = grid.replace_at(at, both);
            }
            _ => self.tree.root = Some(both),
        }
    }

    /// Shows a field in the first view that takes fields, or in a new one.
    pub(super) fn plot(&mut self, field: &FieldKey) {
        let takes = |tile: &Tile<Pane>| matches!(tile, Tile::Pane(pane) if pane.view.accepts_fields());
        if !self.tree.tiles.tiles().any(takes) {
            let plots = ocu_views::all().iter().find(|view_type| (view_type.make)().accepts_fields());
            if let Some(view_type) = plots {
                self.add(view_type);
            }
        }
        self.tree.make_active(|_, tile| takes(tile));
        let mut panes = self.tree.tiles.tiles_mut().filter_map(|tile| match tile {
            Tile::Pane(pane) if pane.view.accepts_fields() => Some(pane),
            _ => None,
        });
        if let Some(pane) = panes.next() {
            pane.view.drop_field(field, egui::Pos2::ZERO);
        }
    }

    /// Prepares a command of a process where commands with parameters can be sent: in the views that are open, one of
    /// which comes to the front, or in a new one.
    pub(super) fn choose_command(&mut self, process: &str, command: &str) {
        let sends = |tile: &Tile<Pane>| matches!(tile, Tile::Pane(pane) if pane.view.sends_commands());
        let active = self.tree.active_tiles();
        let is_seen = active.iter().any(|id| self.tree.tiles.get(*id).is_some_and(sends));
        if !is_seen
            && !self.tree.make_active(|_, tile| sends(tile))
            && let Some(view_type) = ocu_views::all().iter().find(|view| (view.make)().sends_commands())
        {
            self.add(view_type);
        }
        for tile in self.tree.tiles.tiles_mut() {
            if let Tile::Pane(pane) = tile {
                pane.view.choose_command(process, command);
            }
        }
    }

    /// Whether `added` is the only pane.
    fn is_alone(&self, added: TileId) -> bool {
        let panes = self.tree.tiles.tiles().filter(|tile| matches!(tile, Tile::Pane(_))).count();
        panes <= 1 || self.tree.root() == Some(added)
    }

    /// Lets all views look at what is shown, also those that are hidden behind others.
    pub(super) fn watch(&mut self, ctx: &egui::Context, cx: &mut ViewContext<'_>) {
        let shown = cx.frame;
        for tile in self.tree.tiles.tiles_mut() {
            let Tile::Pane(pane) = tile else { continue };
            let Some(frame) = shown.of_run(pane.run.id()) else { continue };
            let ViewContext { controls, selection, wishes, .. } = &mut *cx;
            pane.view.watch(ctx, &mut ViewContext { frame, controls, selection, wishes });
        }
    }

    /// Paints all views.
    pub(super) fn ui(&mut self, ui: &mut egui::Ui, cx: &mut ViewContext<'_>) {
        self.watch(ui.ctx(), cx);
        let mut behavior = Behavior { cx, add: None, focused: self.focused, run: None };
        self.tree.ui(&mut behavior, ui);
        let Behavior { add, focused, run, .. } = behavior;
        self.focused = focused;
        if let Some((tile, run)) = run
            && let Some(Tile::Pane(pane)) = self.tree.tiles.get_mut(tile)
        {
            pane.run = run;
        }
        if let Some((tabs, view_type)) = add {
            let pane = self.pane(view_type);
            let pane = self.tree.tiles.insert_pane(pane);
            if let Some(Tile::Container(Container::Tabs(tabs))) = self.tree.tiles.get_mut(tabs) {
                tabs.add_child(pane);
                tabs.set_active(pane);
            }
        }
        // Views may have been dragged or closed.
        self.simplify();
    }
}

/// How the tree is simplified: every view has a tab.
fn simplification() -> SimplificationOptions {
    SimplificationOptions { all_panes_must_have_tabs: true, ..SimplificationOptions::default() }
}

fn replace(children: &mut [TileId], old: TileId, new: TileId) {
    children.iter_mut().filter(|child| **child == old).for_each(|child| *child = new);
}

/// A menu of all kinds of views; returns the chosen one.
pub(super) fn view_menu(ui: &mut egui::Ui) -> Option<&'static ViewType> {
    let mut chosen = None;
    for view_type in ocu_views::all() {
        let text = format!("{}  {}", view_type.icon.codepoint, view_type.name);
        if ui.button(text).on_hover_text(view_type.summary).clicked() {
            chosen = Some(view_type);
            ui.close();
        }
    }
    chosen
}

struct Behavior<'a, 'b> {
    cx: &'a mut ViewContext<'b>,
    /// A view to add, and the tabs to which it is added.
    add: Option<(TileId, &'static ViewType)>,
    /// The view that was used last.
    focused: Option<u64>,
    /// A view that is to show another run.
    run: Option<(TileId, RunChoice)>,
}

impl egui_tiles::Behavior<Pane> for Behavior<'_, '_> {
    fn pane_ui(&mut self, ui: &mut egui::Ui, id: TileId, pane: &mut Pane) -> egui_tiles::UiResponse {
        let area = ui.available_rect_before_wrap();
        ui.push_id(id, |ui| {
            egui::Frame::new().fill(tokens(ui).panel()).show(ui, |ui| {
                ui.set_min_size(ui.available_size());
                let frame = self.cx.frame;
                let Some(frame) = frame.of_run(pane.run.id()) else {
                    let hint = "Right-click the tab to choose a run of this source.";
                    let title = format!("There is no {}", pane.run.name());
                    return widgets::empty(ui, icons::ICON_CALL_SPLIT, &title, hint);
                };
                let ViewContext { controls, selection, wishes, .. } = &mut *self.cx;
                let mut cx = ViewContext { frame, controls, selection, wishes };
                ocu_views::show(pane.view.as_mut(), ui, &mut cx);
            });
        });
        let is_used = ui.input(|input| input.pointer.any_pressed()) && ui.rect_contains_pointer(area);
        if is_used {
            self.focused = Some(pane.id);
        }
        egui_tiles::UiResponse::None
    }

    fn tab_title_for_pane(&mut self, pane: &Pane) -> egui::WidgetText {
        let frame = self.cx.frame.of_run(pane.run.id()).unwrap_or(self.cx.frame);
        let title = pane.view.title(frame);
        match pane.run {
            RunChoice::Shown => title.into(),
            run => format!("{title} · {}", run.name()).into(),
        }
    }

    fn on_tab_button(
        &mut self,
        tiles: &mut Tiles<Pane>,
        tile: TileId,
        button: egui::Response,
    ) -> egui::Response {
        let Some(Tile::Pane(pane)) = tiles.get(tile) else { return button };
        let runs = &self.cx.frame.runs.all;
        if runs.len() > 1 || pane.run != RunChoice::Shown {
            button.context_menu(|ui| {
                ui.label(egui::RichText::new("Run that it shows").small().color(tokens(ui).weak));
                let shown = std::iter::once(RunChoice::Shown);
                for run in shown.chain(runs.iter().map(|run| RunChoice::Run(run.id.0))) {
                    if ui.selectable_label(pane.run == run, run.name()).clicked() {
                        self.run = Some((tile, run));
                        ui.close();
                    }
                }
            });
        }
        button
    }

    fn tab_text_color(
        &self,
        visuals: &egui::Visuals,
        tiles: &Tiles<Pane>,
        tile: TileId,
        state: &egui_tiles::TabState,
    ) -> egui::Color32 {
        let is_focused = matches!(tiles.get(tile), Some(Tile::Pane(pane)) if Some(pane.id) == self.focused);
        match (state.active, is_focused) {
            (true, true) => visuals.strong_text_color(),
            (true, false) => visuals.text_color(),
            _ => visuals.weak_text_color(),
        }
    }

    fn is_tab_closable(&self, _tiles: &Tiles<Pane>, _id: TileId) -> bool {
        true
    }

    fn top_bar_right_ui(
        &mut self,
        _tiles: &Tiles<Pane>,
        ui: &mut egui::Ui,
        id: TileId,
        _tabs: &Tabs,
        _scroll_offset: &mut f32,
    ) {
        let button = ui.menu_button(icons::ICON_ADD.rich_text(), |ui| {
            if let Some(view_type) = view_menu(ui) {
                self.add = Some((id, view_type));
            }
        });
        let response = button.response;
        response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Button, true, "Add a view here"));
        response.on_hover_text("Add a view here");
    }

    fn simplification_options(&self) -> SimplificationOptions {
        simplification()
    }

    fn drag_preview_color(&self, visuals: &egui::Visuals) -> egui::Color32 {
        visuals.selection.bg_fill.gamma_multiply(0.5)
    }

    fn drag_preview_stroke(&self, visuals: &egui::Visuals) -> egui::Stroke {
        egui::Stroke::new(1.0, visuals.hyperlink_color)
    }

    fn gap_width(&self, _style: &egui::Style) -> f32 {
        2.0
    }

    fn tab_bar_color(&self, visuals: &egui::Visuals) -> egui::Color32 {
        visuals.extreme_bg_color
    }

    fn tab_bar_height(&self, _style: &egui::Style) -> f32 {
        24.0
    }
}

/// Identity of the tiles; there is one workspace per window.
fn id() -> egui::Id {
    egui::Id::unique("workspace")
}

/// Makes tiles from the nodes of a layout.
struct Maker {
    /// Views of the previous arrangement, by id.
    old: BTreeMap<u64, Pane>,
    next_id: u64,
}

impl Maker {
    /// Adds the views of a node as tiles; `None` for a container without views.
    fn insert(&mut self, tiles: &mut Tiles<Pane>, node: &Node) -> Option<TileId> {
        match node {
            Node::Row(parts) => self.linear(tiles, LinearDir::Horizontal, parts),
            Node::Column(parts) => self.linear(tiles, LinearDir::Vertical, parts),
            Node::Grid(nodes) => {
                let ids: Vec<TileId> = nodes.iter().filter_map(|node| self.insert(tiles, node)).collect();
                (!ids.is_empty()).then(|| tiles.insert_grid_tile(ids))
            }
            Node::Tabs { active, tiles: nodes } => {
                let ids: Vec<Option<TileId>> = nodes.iter().map(|node| self.insert(tiles, node)).collect();
                let seen = ids.get(*active).copied().flatten();
                let mut tabs = Tabs::new(ids.into_iter().flatten().collect());
                if let Some(seen) = seen {
                    tabs.set_active(seen);
                }
                (!tabs.children.is_empty()).then(|| tiles.insert_container(tabs))
            }
            Node::View { kind, state, run, id } => {
                let pane = self.pane(kind, state, *run, *id)?;
                let pane = tiles.insert_pane(pane);
                Some(tiles.insert_tab_tile(vec![pane]))
            }
        }
    }

    fn linear(&mut self, tiles: &mut Tiles<Pane>, dir: LinearDir, parts: &[(f32, Node)]) -> Option<TileId> {
        let parts = parts.iter().filter_map(|(share, node)| Some((*share, self.insert(tiles, node)?)));
        let parts: Vec<(f32, TileId)> = parts.collect();
        let mut linear = Linear::new(dir, parts.iter().map(|&(_, id)| id).collect());
        for &(share, id) in &parts {
            linear.shares.set_share(id, share);
        }
        (!parts.is_empty()).then(|| tiles.insert_container(linear))
    }

    /// A view of the previous arrangement, or a new one.
    fn pane(&mut self, kind: &str, state: &SavedState, run: RunChoice, id: u64) -> Option<Pane> {
        // The layout has been checked before, so the kind is known and the state is valid.
        let view_type = view_type(kind)?;
        let kept = self.old.remove(&id).filter(|pane| pane.view_type.kind == kind);
        let is_kept = kept.is_some();
        let mut pane = kept.unwrap_or_else(|| {
            // A view that comes back, by undo, has its old id.
            let id = if id == 0 { self.next_id } else { id };
            self.next_id = self.next_id.max(id + 1);
            Pane { id, view_type, view: (view_type.make)(), run }
        });
        pane.run = run;
        let now = pane.view.save();
        let mut state = state.clone();
        if is_kept && let (Some(fields), Some(looks_at)) = (state.as_object_mut(), now.get(VIEWPORT)) {
            fields.insert(VIEWPORT.to_owned(), looks_at.clone());
        }
        if now != state
            && let Err(error) = pane.view.load(&state)
            && !state.is_null()
        {
            tracing::warn!("the saved state of a view does not fit, so it starts anew: {error}: {kind}");
        }
        Some(pane)
    }
}

/// The layout node of a tile; `None` for a container without views.
fn extract(tiles: &Tiles<Pane>, id: TileId) -> Option<Node> {
    let container = match tiles.get(id)? {
        Tile::Pane(pane) => {
            return Some(Node::View {
                kind: pane.view_type.kind.to_owned(),
                state: pane.view.save(),
                run: pane.run,
                id: pane.id,
            });
        }
        Tile::Container(container) => container,
    };
    let children = || container.children().filter_map(|&child| extract(tiles, child));
    match container {
        Container::Linear(linear) => {
            let total: f32 = linear.children.iter().map(|&child| linear.shares[child]).sum();
            let share =
                |id: TileId| (linear.shares[id] / total.max(f32::MIN_POSITIVE) * 100.0).round().max(1.0);
            let parts: Vec<(f32, Node)> = linear
                .children
                .iter()
                .filter_map(|&child| Some((share(child), extract(tiles, child)?)))
                .collect();
            let node = if linear.dir == LinearDir::Horizontal { Node::Row } else { Node::Column };
            (!parts.is_empty()).then(|| node(parts))
        }
        Container::Grid(_) => {
            Some(children().collect::<Vec<_>>()).filter(|nodes| !nodes.is_empty()).map(Node::Grid)
        }
        Container::Tabs(tabs) => {
            let mut nodes: Vec<Node> = children().collect();
            if nodes.len() == 1 {
                return nodes.pop();
            }
            let active = tabs.children.iter().position(|&child| tabs.is_active(child)).unwrap_or(0);
            (!nodes.is_empty()).then(|| Node::Tabs { active: active.min(nodes.len() - 1), tiles: nodes })
        }
    }
}

#[cfg(test)]
#[path = "tree_tests.rs"]
mod tests;
