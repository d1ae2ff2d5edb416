//! In which view a topic is shown.

use super::{Pane, Workspace};
use egui_tiles::Tile;
use ocu_views::{Draws, RunChoice, ShowIn, TopicKey, ViewType};
use rcs_runtime::source::{Frame, Topic};

impl Workspace {
    /// Shows a topic: drawn in a view, or its fields in one that lists those of what is selected, which comes to the
    /// front, or opens.
    pub(in crate::window) fn show_topic(&mut self, frame: &Frame, key: &TopicKey, place: ShowIn) {
        let topic = key.find(frame).filter(|_| place != ShowIn::Fields);
        let accepting = topic.and_then(|topic| Some((topic, first_accepting(topic)?)));
        if let Some((topic, view_type)) = accepting {
            self.draw(frame, topic, view_type, place);
            return;
        }
        let follows = |tile: &Tile<Pane>| matches!(tile, Tile::Pane(pane) if pane.view.shows_selection());
        if self.tree.active_tiles().iter().any(|id| self.tree.tiles.get(*id).is_some_and(follows)) {
            return;
        }
        if !self.tree.make_active(|_, tile| follows(tile))
            && let Some(view_type) = ocu_views::all().iter().find(|view| (view.make)().shows_selection())
        {
            self.add(view_type);
        }
    }

    /// Draws a topic: in the view that draws it or can, which comes to the front; in a new view of this type if there
    /// is none, or a new one is asked for.
    fn draw(&mut self, frame: &Frame, topic: &Topic, view_type: &'static ViewType, place: ShowIn) {
        let open = if place == ShowIn::View { self.drawing(frame, topic, view_type) } else { None };
        let (draws, id) = open.unwrap_or((Draws::Never, self.next_id));
        if open.is_none() {
            self.add(view_type);
        }
        self.tree.make_active(|_, tile| matches!(tile, Tile::Pane(pane) if pane.id == id));
        self.focused = Some(id);
        for tile in self.tree.tiles.tiles_mut() {
            if let Tile::Pane(pane) = tile
                && pane.id == id
            {
                match draws {
                    Draws::Now => {}
                    Draws::OnceDropped => pane.view.drop_topic(topic),
                    Draws::Never => pane.view.open_for(frame, topic),
                }
            }
        }
    }

    /// The open view of the shown run that draws a topic, or can: first one that draws it, then in the order of the
    /// menu, then one that is seen.
    fn drawing(&self, frame: &Frame, topic: &Topic, first: &ViewType) -> Option<(Draws, u64)> {
        let seen = self.tree.active_tiles();
        let order = |kind: &str| ocu_views::all().iter().position(|view_type| view_type.kind == kind);
        let panes = self.tree.tiles.iter().filter_map(|(tile, content)| {
            let Tile::Pane(pane) = content else { return None };
            let kind = pane.view_type.kind;
            // Every topic can be plotted: a plot takes those that nothing else draws.
            let is_meant = kind == first.kind || !pane.view.accepts_fields();
            if !is_meant || pane.run != RunChoice::Shown {
                return None;
            }
            let draws = pane.view.draws(frame, topic);
            (draws != Draws::Never).then(|| (draws, order(kind), !seen.contains(tile), pane.id))
        });
        panes.min().map(|(draws, .., id)| (draws, id))
    }
}

/// The first type of view in the menu that draws such a topic.
fn first_accepting(topic: &Topic) -> Option<&'static ViewType> {
    ocu_views::all().iter().find(|view_type| {
        let view = (view_type.make)();
        !view.shows_selection() && view.accepts(topic)
    })
}
