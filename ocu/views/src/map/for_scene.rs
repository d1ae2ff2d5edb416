//! The layers of a map for the scene: what lies where in one frame, and the colours of cells.

use super::grid::Cells;
use super::layers::{self, Kind, Layer};
use super::{entities, panel};
use crate::primitives::PlacedEntities;
use egui::{Color32, ColorImage, Context};
use ocu_ui::palette::MapPalette;
use rcs_geom::{DVec3, Pose};
use rcs_msg::{AnyMessage, Stamp};
use rcs_runtime::source::{Frame, Place, WGS84};
use std::collections::BTreeMap;

/// Most points of a track that are drawn.
const MOST_POINTS: usize = 4_000;

/// Content of a layer.
pub(crate) enum Thing<'a> {
    Grid(&'a AnyMessage),
    Cloud(&'a AnyMessage),
    /// Entities in the frame of the scene.
    Entities(PlacedEntities),
    /// Points of a path in the layer's frame.
    Path(Vec<DVec3>),
    /// A set of poses in the layer's frame.
    Poses(Vec<Pose>),
    /// Points of a track up to now, and where it is now: position and heading.
    Track {
        points: Vec<DVec3>,
        here: Option<([f64; 3], f64)>,
    },
    /// None of it can be placed in the scene.
    Nothing,
}

/// Why a layer, or a part of its entities, cannot be placed in the scene.
pub(crate) struct Loose {
    pub(crate) reason: String,
    /// The frame in which it could be drawn.
    pub(crate) frame_id: String,
}

/// A layer in the frame of the scene.
pub(crate) struct Placed<'a> {
    pub(crate) name: String,
    pub(crate) thing: Thing<'a>,
    pub(crate) scene_from_layer: Pose,
    /// Index of its colour.
    pub(crate) series: usize,
    /// Whether it is shown until a person switches it off.
    pub(crate) is_usual: bool,
    pub(crate) is_stale: bool,
    /// Age of its newest message, s; `None` for a track without its topic.
    pub(crate) age_s: Option<f64>,
    pub(crate) loose: Option<Loose>,
}

/// The frame in which most can be drawn, and everything that a scene draws, placed in it where transforms allow it.
/// `chosen` is the frame that a person has chosen.
pub(crate) fn placed<'a>(
    ctx: &Context,
    frame: &'a Frame,
    chosen: Option<&str>,
) -> Option<(String, Vec<Placed<'a>>)> {
    let all = layers::layers(frame);
    let scene = layers::map_frame(frame, &all, chosen)?;
    let has_map = all.iter().any(Layer::is_map);
    let placed = all.iter().enumerate().filter_map(|(index, layer)| {
        let (thing, scene_from_layer, reason) = if let Kind::Entities(_) = layer.kind {
            entities_in(ctx, frame, scene, layer)?
        } else {
            let thing = thing(layer, frame.now)?;
            match layers::map_from_layer(frame, scene, layer) {
                Ok(scene_from_layer) => (thing, scene_from_layer, None),
                Err(reason) => (Thing::Nothing, Pose::IDENTITY, Some(reason)),
            }
        };
        // Few recordings connect latitude and longitude to a frame: that is told in the list of layers alone.
        let is_degrees = layer.frame_id == WGS84 && reason.is_some();
        Some(Placed {
            name: layer.name.clone(),
            thing,
            scene_from_layer,
            series: panel::series(&all, index),
            is_usual: is_usual(layer, has_map) && !is_degrees,
            is_stale: layer.is_stale(frame.now),
            age_s: layer.topic.and_then(|topic| topic.age_s(frame.now)),
            loose: reason.map(|reason| Loose { reason, frame_id: layer.frame_id.to_owned() }),
        })
    });
    Some((scene.to_owned(), placed.collect()))
}

/// Whether a layer is shown until a person switches it off. `has_map` says whether there is a fused map.
pub(super) fn is_usual(layer: &Layer<'_>, has_map: bool) -> bool {
    let is_cloud = matches!(layer.kind, Kind::Cloud);
    let is_part = has_map && layer.is_part_of_a_map() && !is_cloud;
    !layer.is_ground_truth() && !is_part
}

/// All frames in which a scene can be drawn.
pub(crate) fn frames(frame: &Frame) -> Vec<String> {
    layers::frames(frame, &layers::layers(frame)).into_iter().map(str::to_owned).collect()
}

/// The coordinate frames that layers name and no transform does, with the names of these layers.
pub(crate) fn loose_frames(frame: &Frame) -> BTreeMap<&str, Vec<String>> {
    let mut loose: BTreeMap<&str, Vec<String>> = BTreeMap::new();
    for layer in layers::layers(frame) {
        if layer.frame_id != WGS84 && !frame.transforms.contains(layer.frame_id) {
            loose.entry(layers::frame_label(layer.frame_id)).or_default().push(layer.name);
        }
    }
    loose
}

/// The entities of a layer in the frame of the scene, and why some of them are not placed.
fn entities_in<'a>(
    ctx: &Context,
    frame: &Frame,
    scene: &str,
    layer: &Layer<'a>,
) -> Option<(Thing<'a>, Pose, Option<String>)> {
    let placement = entities::placement(ctx, frame, scene, layer)?;
    let (placed, count) = (placement.placed.clone(), placement.placed.0.len());
    let reason = placement.reason.clone();
    if count == 0 {
        return Some((Thing::Nothing, Pose::IDENTITY, Some(reason?)));
    }
    let reason = reason.map(|reason| format!("{} of {}: {reason}", placement.loose, placement.loose + count));
    Some((Thing::Entities(placed), Pose::IDENTITY, reason))
}

fn thing<'a>(layer: &Layer<'a>, now: Stamp) -> Option<Thing<'a>> {
    Some(match layer.kind {
        Kind::Grid(grid) => Thing::Grid(grid),
        Kind::Cloud => Thing::Cloud(layer.topic?.canonical()?),
        Kind::Path(path) => Thing::Path(super::paint::path_places(path)),
        Kind::Poses(set) => Thing::Poses(crate::pose::drawn(set).collect()),
        Kind::Plan(plan) => Thing::Path(super::plan::chosen_places(plan)),
        Kind::Track { track, is_ghost: false } => {
            let count = track.points.count_until(now);
            let every = (count / MOST_POINTS).max(1);
            let at = |index: usize| Some(DVec3::from_array(track.points.get(index)?.position_m));
            let place = layer.topic.and_then(|topic| Place::of(topic.canonical()?));
            let here = place.map(|place| (track.metres(&place.position, now).to_array(), place.yaw_rad));
            Thing::Track { points: (0..count).step_by(every).filter_map(at).collect(), here }
        }
        Kind::Entities(_) | Kind::Goal(_) | Kind::Arcs(_) | Kind::Mission(_) | Kind::Track { .. } => {
            return None;
        }
    })
}

/// The colours of a grid's cells.
pub(crate) struct CellColors {
    image: ColorImage,
    unknown: Option<Color32>,
}

impl CellColors {
    /// The colours of the fused cost, or of the first field.
    pub(crate) fn of(grid: &AnyMessage, palette: MapPalette) -> Result<Self, String> {
        let cells = Cells::new(grid)?;
        let shade = cells.shade(None).ok_or("the grid has no fields")?;
        let image = cells.paint(&shade, palette, cells.range(&shade), None);
        Ok(Self { image, unknown: cells.is_cost(&shade).then(|| palette.unknown()) })
    }

    /// The colour of a cell; `None` where nothing is known.
    pub(crate) fn at(&self, column: usize, row: usize) -> Option<Color32> {
        let color = *self.image.pixels.get(row * self.image.size[0] + column)?;
        (Some(color) != self.unknown && color != Color32::TRANSPARENT).then_some(color)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples;
    use rcs_msg::foxglove::packed_element_field::NumericType;
    use rcs_msg::foxglove::{Grid, PackedElementField};

    #[test]
    fn cells_of_which_nothing_is_known_have_no_colour() {
        let costs = AnyMessage::new(samples::costmap(3, &[0, 254, 255]));
        let name = "elevation".to_owned();
        let fields = vec![PackedElementField { name, offset: 0, r#type: NumericType::Float32.into() }];
        let numbers = [0.5_f32, 1.5, f32::NAN];
        let data = numbers.iter().flat_map(|number| number.to_le_bytes()).collect::<Vec<u8>>().into();
        let (column_count, row_stride, cell_stride) = (3, 12, 4);
        let heights = Grid { fields, data, column_count, row_stride, cell_stride, ..samples::grid(1, 1) };
        for grid in [costs, AnyMessage::new(heights)] {
            let colors = CellColors::of(&grid, MapPalette::Papers).unwrap();
            let is_known = [0, 1, 2].map(|column| colors.at(column, 0).is_some());
            assert_eq!(is_known, [true, true, false]);
        }
    }
}
