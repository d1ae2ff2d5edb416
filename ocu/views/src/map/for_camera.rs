//! What lies on the ground, for a camera that sees it: the map nearest to the vehicle, planned paths, and what the
//! operator has drawn to learn from.

use super::grid::Extent;
use super::layers::{self, Kind, Layer};
use super::{panel, plan};
use crate::prepare::shared;
use egui::{Context, Id};
use rcs_geom::{DVec3, Pose, TransformTree};
use rcs_msg::rcs::{ExampleKind, TrainingExample};
use rcs_msg::{AnyMessage, Stamp};
use rcs_runtime::source::{Frame, Place, Topic, Track};
use rcs_world::{Field, GridView};
use std::sync::Arc;

/// What lies on the ground at one moment, in one coordinate frame whose z axis points up (the scene).
pub(crate) struct Ground {
    /// The coordinate frame.
    pub(crate) scene: String,
    /// The smallest fused map, which lies around the vehicle.
    pub(crate) map: Option<AnyMessage>,
    /// Planned paths, each with the index of its colour.
    pub(crate) paths: Vec<(Vec<DVec3>, usize)>,
    /// Outline of the newest training example, and whether it is ground.
    pub(crate) example: Option<(Vec<DVec3>, bool)>,
    /// Height of the vehicle, m: that of the ground where no map says it.
    pub(crate) level_m: f64,
}

/// What a ground follows from, compared by identity.
struct Moment {
    topics: Arc<[Topic]>,
    tracks: Arc<[Track]>,
    transforms: Arc<TransformTree>,
}

impl PartialEq for Moment {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.topics, &other.topics)
            && Arc::ptr_eq(&self.tracks, &other.tracks)
            && Arc::ptr_eq(&self.transforms, &other.transforms)
    }
}

impl Ground {
    /// What lies on the ground in a frame, for all cameras; `None` if it has neither map nor path nor track.
    fn of(ctx: &Context, frame: &Frame) -> Option<Arc<Self>> {
        let (topics, tracks) = (Arc::clone(&frame.topics), Arc::clone(&frame.tracks));
        let moment = Moment { topics, tracks, transforms: Arc::clone(&frame.transforms) };
        let slot = Id::unique(("ground", frame.runs.current()));
        (*shared(ctx, slot, moment, || Self::new(frame).map(Arc::new))).clone()
    }

    fn new(frame: &Frame) -> Option<Self> {
        let all = layers::layers(frame);
        // What the run says counts before what was recorded.
        let of = |is_recorded: bool| {
            let layers = all.iter().filter(|layer| !layer.is_ground_truth());
            layers.filter(move |layer| layer.is_recorded() == is_recorded)
        };
        let own = || of(false).chain(of(true));
        let smallest = |is_recorded: bool| {
            let maps = of(is_recorded).filter(|layer| layer.is_map()).filter_map(area);
            maps.min_by(|a, b| a.0.total_cmp(&b.0))
        };
        let map = smallest(false).or_else(|| smallest(true));
        let map = map.map(|(_, layer)| layer);
        let is_path = |layer: &&Layer<'_>| matches!(layer.kind, Kind::Path(_) | Kind::Plan(_));
        let is_track = |layer: &&Layer<'_>| matches!(layer.kind, Kind::Track { is_ghost: false, .. });
        let scene = map.or_else(|| own().find(is_path)).or_else(|| own().find(is_track))?.frame_id;
        let path = |(index, layer): (usize, &Layer<'_>)| {
            let points = match layer.kind {
                Kind::Path(path) => super::paint::path_places(path),
                Kind::Plan(plan) => plan::chosen_places(plan),
                _ => return None,
            };
            let scene_from_layer = layers::map_from_layer(frame, scene, layer).ok()?;
            let points = points.into_iter().map(|p| scene_from_layer * p).collect();
            Some((points, panel::series(&all, index)))
        };
        let here = |layer: &Layer<'_>| {
            let Kind::Track { track, is_ghost: false } = layer.kind else { return None };
            let place = Place::of(layer.topic?.canonical()?)?;
            let scene_from_layer = layers::map_from_layer(frame, scene, layer).ok()?;
            let z = (scene_from_layer * track.metres(&place.position, frame.now)).z;
            z.is_finite().then_some(z)
        };
        Some(Self {
            scene: scene.to_owned(),
            map: map
                .and_then(|layer| if let Kind::Grid(grid) = layer.kind { Some(grid.clone()) } else { None }),
            paths: all.iter().enumerate().filter_map(path).collect(),
            example: example(frame, scene),
            level_m: own().find_map(here).unwrap_or(0.0),
        })
    }
}

/// The ground, and the pose of its scene in the optical frame of a camera.
pub(crate) struct OnGround {
    pub(crate) ground: Arc<Ground>,
    pub(crate) camera_from_scene: Pose,
}

impl OnGround {
    /// `None` if no transform connects the camera, at the time of its image (by the clock of the transforms), to a map, a
    /// path or a track.
    pub(crate) fn of(ctx: &Context, frame: &Frame, camera: &str, at: Stamp) -> Option<Self> {
        let ground = Ground::of(ctx, frame)?;
        let camera_from_scene = layers::map_from_frame(frame, camera, &ground.scene, at).ok()?;
        Some(Self { ground, camera_from_scene })
    }
}

/// The heights of the ground: those of a map where it states them, else that of the vehicle.
pub(crate) struct Floor<'a> {
    map: Option<GridView<'a>>,
    level_m: f64,
}

impl<'a> Floor<'a> {
    /// The heights of a map; `level_m` is that of the vehicle.
    pub(crate) fn of(map: Option<&'a AnyMessage>, level_m: f64) -> Self {
        Self { map: map.and_then(|map| GridView::of(map).ok()), level_m }
    }

    /// Reads heights from the map's field, which is looked up once.
    pub(crate) fn reader(&self) -> impl Fn(DVec3) -> f64 + '_ {
        let heights = self.map.as_ref().and_then(|map| {
            let field: Field<'_> = map.field("ground.mean").ok()?;
            let scene_from_grid = map.frame_from_grid();
            Some((map.cell_size_m(), scene_from_grid.inverse(), scene_from_grid.translation.z, field))
        });
        move |p| {
            let stated = heights.as_ref().and_then(|(cell_m, grid_from_scene, base_m, field)| {
                let q = *grid_from_scene * p;
                let (column, row) = (q.x / cell_m.x, q.y / cell_m.y);
                let is_inside = column >= 0.0 && row >= 0.0;
                let height_m = is_inside.then(|| field.get(column as usize, row as usize)).flatten()?;
                (height_m.is_finite() && height_m.abs() < 1e4).then_some(base_m + height_m)
            });
            stated.unwrap_or(self.level_m)
        }
    }
}

/// Area of a grid, m².
fn area<'l, 'a>(layer: &'l Layer<'a>) -> Option<(f64, &'l Layer<'a>)> {
    let Kind::Grid(grid) = layer.kind else { return None };
    let [a, b, c, _] = Extent::of(grid)?.corners;
    Some((a.distance(b) * b.distance(c), layer))
}

fn example(frame: &Frame, scene: &str) -> Option<(Vec<DVec3>, bool)> {
    let examples = frame.topics_of_type("rcs.TrainingExample");
    let newest = examples.filter_map(|topic| Some((topic.latest.as_ref()?.header.log_time, topic)));
    let (time, topic) = newest.max_by_key(|(time, topic)| (!topic.run.is_recorded(), *time))?;
    let example = topic.get::<TrainingExample>()?;
    let at = frame.transform_time(time);
    let scene_from_example = layers::map_from_frame(frame, scene, &example.frame_id, at).ok()?;
    let corners = example.outline.iter().flat_map(|outline| &outline.points);
    let corners = corners.map(|p| scene_from_example * DVec3::new(p.x_m, p.y_m, 0.0)).collect();
    Some((corners, example.kind() == ExampleKind::ExampleGround))
}
