//! How the maps of two runs differ at one time: the cells that differ, coloured by the side on which they cost more or
//! are known at all, with the tracks and paths of both.
//!
//! The map is the fused one with the same name on both sides, else any grid that both have. Cells are compared where
//! they lie, so that maps that scrolled differently are compared, too. The cost is compared where the grid has one, else
//! its first field.

use crate::cached::SameMessage;
use crate::canvas::Viewport;
use crate::clip;
use crate::map::{Placed, Thing, placed};
use crate::prepare::{Painted, prepared};
use egui::{
    Color32, ColorImage, Id, Mesh, Pos2, Rect, Role, Sense, Shape, Stroke, TextureOptions, Ui, Vec2,
    WidgetInfo,
};
use ocu_ui::legend;
use ocu_ui::tokens;
use rcs_geom::DVec3;
use rcs_msg::AnyMessage;
use rcs_runtime::Role as TopicRole;
use rcs_runtime::source::{Frame, Topic};
use rcs_world::{GridView, NumericType};
use std::sync::Arc;

/// Smallest and largest scale, screen points per m.
const SCALES: [f64; 2] = [0.01, 5000.0];
/// Brightness of what is known on one side only, and of cells that are equal.
const ONLY: f32 = 0.55;
const EQUAL: f32 = 0.35;

/// The difference of two maps, and its picture.
struct Difference {
    painted: Painted,
    /// Corners of the grid in its frame.
    corners: [DVec3; 4],
    /// The coordinate frame of the grid.
    frame_id: String,
    /// Number of cells that differ, and of all.
    counts: [usize; 2],
}

/// The map that both frames have: the fused one, else any grid.
fn common(frames: [&Frame; 2]) -> Option<[&Topic; 2]> {
    let is_grid = |topic: &&Topic| topic.type_name() == "foxglove.Grid" && topic.latest.is_some();
    let grids: Vec<&Topic> =
        frames[0].topics.iter().filter(is_grid).filter(|topic| !topic.is_ground_truth()).collect();
    let of_role = grids.iter().find(|topic| topic.role() == Some(TopicRole::Map));
    let first = *of_role.or(grids.first())?;
    let second = frames[1].topics.iter().filter(is_grid).find(|topic| topic.name == first.name)?;
    Some([first, second])
}

/// Whether both frames have a map.
pub(super) fn is_there(frames: [&Frame; 2]) -> bool {
    common(frames).is_some()
}

/// Paints the difference. `names` are those of both sides; `ended` says when they ended, where that was before the viewed
/// time: the last map of such a side and a later one of the other do not say how the runs differ, so that no cell is
/// coloured.
pub(super) fn ui(
    ui: &mut Ui,
    canvas: Rect,
    frames: [&Frame; 2],
    names: &[String; 2],
    ended: &[Option<String>; 2],
    viewport: &mut Option<Viewport>,
) {
    let response = ui.interact(canvas, ui.scope_id().with("difference"), Sense::click_and_drag());
    ui.painter().rect_filled(canvas, 0.0, tokens(ui).canvas());
    let Some(topics) = common(frames) else { return };
    let colors = [0, 1].map(|side| super::color(ui, side));
    let compared = match ended {
        [None, None] => topics,
        // The map of the side that went on, with itself.
        [Some(_), None] => [topics[1]; 2],
        [_, Some(_)] => [topics[0]; 2],
    };
    let Some(difference) = Difference::of(ui.ctx(), response.id, compared, colors) else { return };
    let [differing, all] = difference.counts;
    let ended: Vec<&str> = ended.iter().flatten().map(String::as_str).collect();
    response.widget_info(|| {
        let text = if ended.is_empty() {
            format!("{differing} of {all} cells differ")
        } else {
            format!("cells are not compared: {}", ended.join(", "))
        };
        WidgetInfo::labeled(Role::Image, true, text)
    });
    let mut look = viewport.filter(Viewport::is_valid).unwrap_or_else(|| {
        let of = |axis: usize| difference.corners.iter().map(move |corner| corner.to_array()[axis]);
        let low = [0, 1].map(|axis| of(axis).fold(f64::INFINITY, f64::min));
        let high = [0, 1].map(|axis| of(axis).fold(f64::NEG_INFINITY, f64::max));
        Viewport::fit(low, high, canvas, 12.0, true)
    });
    if look.interact(ui, &response, SCALES, true) {
        *viewport = Some(look);
    }
    if response.double_clicked() {
        *viewport = None;
    }
    paint_cells(ui, &difference, look, canvas);
    for (side, frame) in frames.into_iter().enumerate() {
        let all = placed(ui.ctx(), frame, Some(&difference.frame_id));
        let all = all.filter(|(name, _)| *name == difference.frame_id);
        for layer in all.map(|(_, layers)| layers).unwrap_or_default() {
            paint_line(ui, &layer, look, canvas, colors[side]);
        }
    }
    legend::scale_bar(ui, canvas.right_top() + Vec2::new(-12.0, 20.0), look.scale);
    if canvas.height() >= 160.0 && canvas.width() >= 260.0 {
        legend::plate(ui, canvas, egui::Align2::LEFT_BOTTOM, |ui| {
            for text in &ended {
                ui.label(egui::RichText::new(*text).small());
            }
            if !ended.is_empty() {
                return;
            }
            let name = &topics[0].name;
            ui.label(egui::RichText::new(format!("{name}: {differing} cells differ")).small());
            for side in 0..2 {
                legend::swatch(ui, colors[side], &format!("more in {}", names[side]));
                let only = colors[side].gamma_multiply(ONLY);
                legend::swatch(ui, only, &format!("known only in {}", names[side]));
            }
        });
    }
}

/// The value that is compared: the cost, the first cost of a source, or the first field.
fn field(grid: &GridView<'_>) -> Option<String> {
    let names: Vec<&str> = grid.names().collect();
    let cost = names.iter().find(|name| **name == "cost");
    let of_source = names.iter().find(|name| name.starts_with("cost."));
    cost.or(of_source).or(names.first()).map(|name| (*name).to_owned())
}

impl Difference {
    /// The difference of the newest maps of two topics, for one canvas; `None` until the first one is computed, or if they
    /// cannot be compared.
    fn of(ctx: &egui::Context, canvas: Id, topics: [&Topic; 2], colors: [Color32; 2]) -> Option<Arc<Self>> {
        let of = topics.map(|topic| (&*topic.name, topic.run));
        let [a, b] = topics.map(|topic| topic.canonical().cloned().map(SameMessage));
        let maps = (a?, b?);
        let key = maps.clone();
        let difference = prepared(ctx, Id::unique(("difference", canvas, of, colors)), key, move || {
            Self::new(&maps.0.0, &maps.1.0, colors).map(Arc::new)
        });
        difference.and_then(|difference| (*difference).clone())
    }

    /// Two maps compared cell by cell, in the grid of the first.
    fn new(a: &AnyMessage, b: &AnyMessage, colors: [Color32; 2]) -> Option<Self> {
        let (first, second) = (GridView::of(a).ok()?, GridView::of(b).ok()?);
        let (pixels, differing) = compared(&first, &second, colors)?;
        let all = pixels.len();
        let (columns, rows, cell_m) = (first.columns(), first.rows(), first.cell_size_m());
        let (x, y) = (columns as f64 * cell_m.x, rows as f64 * cell_m.y);
        let corners = [DVec3::ZERO, DVec3::new(x, 0.0, 0.0), DVec3::new(x, y, 0.0), DVec3::new(0.0, y, 0.0)];
        Some(Self {
            painted: Painted::new(ColorImage::new([columns, rows], pixels)),
            corners: corners.map(|corner| first.frame_from_grid() * corner),
            frame_id: first.frame_id().to_owned(),
            counts: [differing, all],
        })
    }
}

/// A colour for each cell of the first grid, and the number of cells that differ.
fn compared(
    first: &GridView<'_>,
    second: &GridView<'_>,
    colors: [Color32; 2],
) -> Option<(Vec<Color32>, usize)> {
    let name = field(first)?;
    // Costs are bytes; a field of another type with such a name has no unknown value.
    let is_byte = first.field_of(&name, NumericType::Uint8).is_ok();
    let is_cost = is_byte && (name == "cost" || name.starts_with("cost."));
    let known = |value: f64| value.is_finite() && !(is_cost && value > 250.0);
    let ours: Vec<f64> = first.field(&name).ok()?.values().collect();
    let theirs: Vec<f64> = second.field(&name).ok()?.values().collect();
    let second_from_first = second.frame_from_grid().inverse() * first.frame_from_grid();
    let (cell_m, other_m) = (first.cell_size_m(), second.cell_size_m());
    let at = |column: usize, row: usize| {
        let center = DVec3::new((column as f64 + 0.5) * cell_m.x, (row as f64 + 0.5) * cell_m.y, 0.0);
        let p = second_from_first * center;
        let (column, row) = ((p.x / other_m.x).floor(), (p.y / other_m.y).floor());
        let is_inside =
            (0.0..second.columns() as f64).contains(&column) && (0.0..second.rows() as f64).contains(&row);
        let index = || row as usize * second.columns() + column as usize;
        is_inside.then(index).and_then(|index| theirs.get(index)).copied().unwrap_or(f64::NAN)
    };
    let columns = first.columns().max(1);
    let mut differing = 0;
    let pixels = ours.iter().enumerate().map(|(index, &mine)| {
        let other = at(index % columns, index / columns);
        let color = match (known(mine), known(other)) {
            (false, false) => return Color32::TRANSPARENT,
            (true, false) => colors[0].gamma_multiply(ONLY),
            (false, true) => colors[1].gamma_multiply(ONLY),
            (true, true) if mine.to_bits() == other.to_bits() => {
                // Grey, because the colours are those of the sides.
                let shade = if is_cost { 90 + (mine / 2.5) as u8 } else { 140 };
                return Color32::from_gray(shade).gamma_multiply(EQUAL);
            }
            (true, true) => colors[usize::from(other > mine)],
        };
        differing += 1;
        color
    });
    let pixels = pixels.collect();
    Some((pixels, differing))
}

fn paint_cells(ui: &Ui, difference: &Difference, look: Viewport, canvas: Rect) {
    if !difference.corners.iter().all(|corner| clip::is_place(&corner.to_array())) {
        return;
    }
    let mut mesh = Mesh::with_texture(difference.painted.texture(ui.ctx(), TextureOptions::NEAREST));
    let uv = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    for (corner, uv) in difference.corners.iter().zip(uv) {
        let pos = look.to_screen(canvas, [corner.x, corner.y]);
        mesh.vertices.push(egui::epaint::Vertex { pos, uv: Pos2::from(uv), color: Color32::WHITE });
    }
    mesh.indices = vec![0, 1, 2, 0, 2, 3];
    ui.painter_at(canvas).add(Shape::mesh(mesh));
}

/// A track up to now, or a path.
fn paint_line(ui: &Ui, layer: &Placed<'_>, look: Viewport, canvas: Rect, color: Color32) {
    if !layer.is_usual {
        return;
    }
    let painter = ui.painter_at(canvas);
    let place = |p: &DVec3| {
        let p = layer.scene_from_layer * *p;
        [p.x, p.y]
    };
    match &layer.thing {
        Thing::Track { points, here } => {
            let edge = Stroke::new(4.0, tokens(ui).canvas());
            for stroke in [edge, Stroke::new(2.0, color)] {
                for part in clip::line(points.iter().map(place), look, canvas) {
                    painter.add(Shape::line(part, stroke));
                }
            }
            if let Some((position, _)) = here {
                let [x, y] = place(&DVec3::from_array(*position));
                painter.circle(
                    look.to_screen(canvas, [x, y]),
                    4.0,
                    color,
                    Stroke::new(1.5, tokens(ui).canvas()),
                );
            }
        }
        Thing::Path(points) => {
            let parts = clip::line(points.iter().map(place), look, canvas);
            painter.extend(clip::dashed(&parts, Stroke::new(1.5, color), color));
        }
        Thing::Grid(_) | Thing::Cloud(_) | Thing::Entities(_) | Thing::Poses(_) | Thing::Nothing => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples;

    #[test]
    fn cells_are_compared_where_they_lie_and_coloured_by_the_side_that_has_more() {
        let colors = [Color32::RED, Color32::GREEN];
        let one = samples::grid(4, 3);
        let same = AnyMessage::new(one.clone());
        let view = GridView::of(&same).unwrap();
        assert_eq!(compared(&view, &view, colors).unwrap().1, 0);
        // One cell costs more in the second, and one in the first.
        let mut other = one.clone();
        let mut data = other.data.to_vec();
        let stride = other.cell_stride as usize;
        data[stride] = samples::cost(1, 0) + 7;
        data[2 * stride] = samples::cost(2, 0) - 5;
        other.data = data.into();
        let other = AnyMessage::new(other);
        let (pixels, count) = compared(&view, &GridView::of(&other).unwrap(), colors).unwrap();
        assert_eq!((count, pixels[1], pixels[2]), (2, Color32::GREEN, Color32::RED));
        // The same map three cells farther along x.
        let mut moved = one;
        let pose = moved.pose.get_or_insert_default();
        pose.position.get_or_insert_default().x += 3.0 * view.cell_size_m().x;
        let moved = AnyMessage::new(moved);
        let (pixels, _) = compared(&view, &GridView::of(&moved).unwrap(), colors).unwrap();
        assert_eq!(pixels[1], Color32::RED.gamma_multiply(ONLY), "the second does not reach there");
    }
}
