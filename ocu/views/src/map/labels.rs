//! Texts beside things on a map, placed so that none lies on another one, on a vehicle or on a panel.

use egui::{Align2, Color32, FontId, Painter, Pos2, Rangef, Rect, Stroke, Vec2};
use ocu_ui::Tokens;

/// Distances of a text from its thing that are tried, nearest first, screen points.
const DISTANCES: [f32; 4] = [8.0, 22.0, 40.0, 64.0];
/// Directions that are tried, in this order: right, left, above, below, and between.
const WAYS: [[f32; 2]; 8] =
    [[1.0, 0.0], [-1.0, 0.0], [0.0, -1.0], [0.0, 1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, -1.0], [-1.0, 1.0]];
/// Room around a text.
const MARGIN: Vec2 = Vec2::new(4.0, 1.0);
/// Distance from the position of a vehicle within which its mark lies, screen points.
const VEHICLE: f32 = 12.0;

struct Label {
    at: Pos2,
    /// The direction that is tried first.
    way: Vec2,
    text: String,
    font: FontId,
    color: Color32,
}

/// The texts of a map, and what they must leave free. The first ones have the choice.
#[derive(Default)]
pub(super) struct Labels {
    taken: Vec<Rect>,
    /// Where vehicles are.
    vehicles: Vec<Pos2>,
    texts: Vec<Label>,
}

impl Labels {
    /// No text lies here.
    pub(super) fn keep_free(&mut self, place: Rect) {
        self.taken.push(place);
    }

    /// No text lies on the mark of a vehicle that is here.
    pub(super) fn keep_free_for_vehicle(&mut self, at: Pos2) {
        self.keep_free(Rect::from_center_size(at, Vec2::splat(2.0 * VEHICLE)));
        self.vehicles.push(at);
    }

    /// Whether the mark of a vehicle can cover a part of a disc.
    pub(super) fn is_covered(&self, center: Pos2, radius: f32) -> bool {
        self.vehicles.iter().any(|at| at.distance(center) < VEHICLE + radius)
    }

    /// A text beside a thing, at its right if there is room.
    pub(super) fn add(&mut self, at: Pos2, text: String, color: Color32) {
        self.add_towards(at, Vec2::RIGHT, text, FontId::proportional(11.0), color);
    }

    /// A text beside a thing, in this direction if there is room.
    pub(super) fn add_towards(&mut self, at: Pos2, way: Vec2, text: String, font: FontId, color: Color32) {
        if at.is_finite() {
            self.texts.push(Label { at, way, text, font, color });
        }
    }

    /// Paints the texts, those that say the same of one place once. One for which there is no room is left out.
    pub(super) fn paint(mut self, painter: &Painter, canvas: Rect, tokens: &Tokens) {
        let mut said: Vec<(Pos2, String)> = Vec::new();
        for label in std::mem::take(&mut self.texts) {
            // Two topics may hold one goal.
            let says =
                |(at, text): &(Pos2, String)| at.distance(label.at) < DISTANCES[3] && *text == label.text;
            if said.iter().any(says) {
                continue;
            }
            said.push((label.at, label.text.clone()));
            let color = tokens.legible(label.color);
            let galley = painter.layout_no_wrap(label.text, label.font, color);
            let Some(place) = self.place(label.at, label.way, galley.size(), canvas) else { continue };
            // Where it is not beside its thing, a line leads there.
            let near = place.clamp(label.at);
            if near.distance(label.at) > DISTANCES[0] + MARGIN.x {
                let ends = [self.leaves(label.at, near), near];
                painter.line_segment(ends, Stroke::new(1.0, label.color.gamma_multiply(0.6)));
            }
            painter.rect_filled(place, 2.0, tokens.surface[3].gamma_multiply(0.92));
            painter.galley(place.min + MARGIN, galley, color);
            self.taken.push(place);
        }
    }

    /// Where a line from a thing to its text leaves what is kept free around the thing, such as the number of a goal.
    fn leaves(&self, at: Pos2, text: Pos2) -> Pos2 {
        let way = text - at;
        let part = |at: f32, way: f32, ends: Rangef| {
            let end = if way < 0.0 { ends.min } else { ends.max };
            if way == 0.0 { f32::INFINITY } else { (end - at) / way }
        };
        let around = self.taken.iter().filter(|taken| taken.contains(at));
        let parts = around.map(|taken| {
            let [x, y] = [part(at.x, way.x, taken.x_range()), part(at.y, way.y, taken.y_range())];
            x.min(y)
        });
        at + way * parts.fold(0.0, f32::max).min(1.0)
    }

    /// A free place for a text of this size.
    fn place(&self, at: Pos2, way: Vec2, size: Vec2, canvas: Rect) -> Option<Rect> {
        let size = size + 2.0 * MARGIN;
        let ways = std::iter::once(way).chain(WAYS.map(Vec2::from));
        let ways: Vec<Vec2> = ways.map(Vec2::normalized).collect();
        let free = |place: &Rect| {
            canvas.contains_rect(*place) && !self.taken.iter().any(|taken| taken.intersects(*place))
        };
        let beside = |distance: f32, way: Vec2| {
            // The nearest point of the text is at that distance.
            let reach = way.x.abs() * size.x / 2.0 + way.y.abs() * size.y / 2.0 + distance;
            Align2::CENTER_CENTER.anchor_size(at + way * reach, size)
        };
        let places = DISTANCES.into_iter().flat_map(|distance| ways.iter().map(move |way| (distance, *way)));
        places.map(|(distance, way)| beside(distance, way)).find(free)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_lie_neither_on_each_other_nor_on_what_is_kept_free_and_stay_inside() {
        let canvas = Rect::from_min_size(Pos2::ZERO, Vec2::new(300.0, 200.0));
        let vehicle = Rect::from_center_size(Pos2::new(150.0, 100.0), Vec2::splat(26.0));
        let mut labels = Labels::default();
        labels.keep_free(vehicle);
        let mut placed = Vec::new();
        for at in [[150.0, 100.0], [152.0, 101.0], [140.0, 96.0], [295.0, 100.0], [150.0, 100.0]] {
            let place = labels.place(at.into(), Vec2::RIGHT, Vec2::new(80.0, 12.0), canvas).unwrap();
            assert!(canvas.contains_rect(place), "{place}");
            assert!(!place.intersects(vehicle), "{place}");
            assert!(placed.iter().all(|other: &Rect| !other.intersects(place)), "{place}");
            labels.keep_free(place);
            placed.push(place);
        }
        assert_eq!(labels.place(Pos2::new(150.0, 100.0), Vec2::RIGHT, Vec2::new(400.0, 12.0), canvas), None);
    }

    #[test]
    fn the_line_to_a_text_begins_where_it_leaves_what_is_kept_free_around_its_thing() {
        let (at, mut labels) = (Pos2::new(50.0, 50.0), Labels::default());
        labels.keep_free(Rect::from_center_size(at, Vec2::splat(18.0)));
        labels.keep_free(Rect::from_center_size(at, Vec2::new(4.0, 30.0)));
        assert_eq!(labels.leaves(at, Pos2::new(86.0, 50.0)), Pos2::new(59.0, 50.0));
        assert_eq!(labels.leaves(at, Pos2::new(50.0, 20.0)), Pos2::new(50.0, 35.0));
        let elsewhere = Pos2::new(10.0, 10.0);
        assert_eq!(labels.leaves(elsewhere, at), elsewhere);
    }
}
