//! The views in the middle of the window, in tiles and tabs that the user arranges.

use crate::layout::{Layout, Node, VERSION};
use egui_tiles::{Container, Linear, LinearDir, Tabs, Tile, TileId, Tiles, Tree};
use ocu_ui::{icons, tokens};
use ocu_views::{View, ViewContext, ViewType, view_type};

/// One view in its tile.
struct Pane {
    view_type: &'static ViewType,
    view: Box<dyn View>,
}

/// The tiles and their views.
pub(super) struct Workspace {
    tree: Tree<Pane>,
    name: String,
}

impl Workspace {
    /// Creates the views of a layout.
    pub(super) fn new(layout: &Layout) -> Self {
        let mut tiles = Tiles::default();
        let root = insert(&mut tiles, &layout.root);
        let tree = match root {
            Some(root) => Tree::new(id(), root, tiles),
            None => Tree::empty(id()),
        };
        Self { tree, name: layout.name.clone() }
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

    /// Whether there is no view.
    pub(super) fn is_empty(&self) -> bool {
        !self.tree.tiles.tiles().any(|tile| matches!(tile, Tile::Pane(_)))
    }

    /// Adds a view at the right of all others.
    pub(super) fn add(&mut self, view_type: &'static ViewType) {
        let pane = self.tree.tiles.insert_pane(Pane { view_type, view: (view_type.make)() });
        let added = self.tree.tiles.insert_tab_tile(vec![pane]);
        let Some(root) = self.tree.root().filter(|_| !self.is_alone(added)) else {
            self.tree = Tree::new(id(), added, std::mem::take(&mut self.tree.tiles));
            return;
        };
        let row = match self.tree.tiles.get(root) {
            Some(Tile::Container(Container::Linear(linear))) if linear.dir == LinearDir::Horizontal => root,
            _ => {
                let row = self.tree.tiles.insert_horizontal_tile(vec![root]);
                self.tree.root = Some(row);
                row
            }
        };
        self.tree.move_tile_to_container(added, row, usize::MAX, false);
    }

    /// Whether `added` is the only pane.
    fn is_alone(&self, added: TileId) -> bool {
        let panes = self.tree.tiles.tiles().filter(|tile| matches!(tile, Tile::Pane(_))).count();
        panes <= 1 || self.tree.root() == Some(added)
    }

    /// Paints all views.
    pub(super) fn ui(&mut self, ui: &mut egui::Ui, cx: &mut ViewContext<'_>) {
        let mut behavior = Behavior { cx, add: None };
        self.tree.ui(&mut behavior, ui);
        if let Some((tabs, view_type)) = behavior.add {
            let pane = self.tree.tiles.insert_pane(Pane { view_type, view: (view_type.make)() });
            if let Some(Tile::Container(Container::Tabs(tabs))) = self.tree.tiles.get_mut(tabs) {
                tabs.add_child(pane);
                tabs.set_active(pane);
            }
        }
    }
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
}

impl egui_tiles::Behavior<Pane> for Behavior<'_, '_> {
    fn pane_ui(&mut self, ui: &mut egui::Ui, id: TileId, pane: &mut Pane) -> egui_tiles::UiResponse {
        ui.push_id(id, |ui| {
            egui::Frame::new().fill(tokens(ui).panel()).show(ui, |ui| {
                ui.set_min_size(ui.available_size());
                ocu_views::show(pane.view.as_mut(), ui, self.cx);
            });
        });
        egui_tiles::UiResponse::None
    }

    fn tab_title_for_pane(&mut self, pane: &Pane) -> egui::WidgetText {
        pane.view.title(self.cx.frame).into()
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

    fn simplification_options(&self) -> egui_tiles::SimplificationOptions {
        egui_tiles::SimplificationOptions { all_panes_must_have_tabs: true, ..Default::default() }
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

/// Adds the views of a node as tiles; `None` for a container without views.
fn insert(tiles: &mut Tiles<Pane>, node: &Node) -> Option<TileId> {
    let linear = |tiles: &mut Tiles<Pane>, dir: LinearDir, parts: &[(f32, Node)]| {
        let parts: Vec<(f32, TileId)> =
            parts.iter().filter_map(|(share, node)| Some((*share, insert(tiles, node)?))).collect();
        let mut linear = Linear::new(dir, parts.iter().map(|&(_, id)| id).collect());
        for &(share, id) in &parts {
            linear.shares.set_share(id, share);
        }
        (!parts.is_empty()).then(|| tiles.insert_container(linear))
    };
    match node {
        Node::Row(parts) => linear(tiles, LinearDir::Horizontal, parts),
        Node::Column(parts) => linear(tiles, LinearDir::Vertical, parts),
        Node::Grid(nodes) => {
            let ids: Vec<TileId> = nodes.iter().filter_map(|node| insert(tiles, node)).collect();
            (!ids.is_empty()).then(|| tiles.insert_grid_tile(ids))
        }
        Node::Tabs { active, tiles: nodes } => {
            let ids: Vec<Option<TileId>> = nodes.iter().map(|node| insert(tiles, node)).collect();
            let seen = ids.get(*active).copied().flatten();
            let mut tabs = Tabs::new(ids.into_iter().flatten().collect());
            if let Some(seen) = seen {
                tabs.set_active(seen);
            }
            (!tabs.children.is_empty()).then(|| tiles.insert_container(tabs))
        }
        Node::View { kind, state } => {
            // The layout has been checked before, so the kind is known and the state is valid.
            let view_type = view_type(kind)?;
            let mut view = (view_type.make)();
            if let Err(error) = view.load(state)
                && !state.is_null()
            {
                tracing::warn!("the saved state of a view does not fit, so it starts anew: {error}: {kind}");
            }
            let pane = tiles.insert_pane(Pane { view_type, view });
            Some(tiles.insert_tab_tile(vec![pane]))
        }
    }
}

/// The layout node of a tile; `None` for a container without views.
fn extract(tiles: &Tiles<Pane>, id: TileId) -> Option<Node> {
    let container = match tiles.get(id)? {
        Tile::Pane(pane) => {
            return Some(Node::View { kind: pane.view_type.kind.to_owned(), state: pane.view.save() });
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
mod tests {
    use super::*;
    use crate::bundled;

    #[test]
    fn a_layout_survives_being_opened_and_kept() {
        for name in bundled::names("layout") {
            let layout = Layout::bundled(name).unwrap().unwrap();
            let kept = Workspace::new(&layout).layout(layout.buffers);
            let again = Workspace::new(&kept).layout(kept.buffers);
            assert_eq!(kept, again, "{name}");
        }
    }

    #[test]
    fn views_can_be_added_to_an_empty_workspace_and_beside_others() {
        let mut workspace = Workspace::new(&Layout::empty());
        assert!(workspace.is_empty());
        let view_type = &ocu_views::all()[0];
        workspace.add(view_type);
        assert!(!workspace.is_empty());
        workspace.add(view_type);
        let Node::Row(parts) = workspace.layout(true).root else { panic!("expected a row") };
        assert_eq!(parts.len(), 2);
    }
}
