//! What lies in space, projected into an image: horizon, planned paths, cells of the map, training examples, and the
//! place under the pointer.
//!
//! It needs the calibration of the image's camera and a transform from its optical frame to the map or the path.
//! Heights of the ground are those of the map, elsewhere that of the vehicle. Nothing hides what lies behind it.

use super::layer::{self, Layer};
use crate::cached::{Cached, SameMessage};
use crate::canvas::Viewport;
use crate::map::{CellColors, Floor, Ground, OnGround};
use crate::prepare::prepared;
use egui::emath::TSTransform;
use egui::{Color32, Context, Id, Mesh, Painter, Pos2, Rect, Shape, Stroke};
use ocu_ui::Tokens;
use ocu_ui::palette::MapPalette;
use rcs_geom::{DVec2, DVec3, PinholeCamera, Pose};
use rcs_msg::AnyMessage;
use rcs_msg::foxglove::CameraCalibration;
use rcs_runtime::Role;
use rcs_runtime::source::{Frame, Topic, frame_name};
use rcs_world::GridView;

/// Cells and places nearer than this, or farther away, are not drawn, m along the optical axis.
const NEAREST_M: f64 = 0.2;
const FARTHEST_M: f64 = 25.0;
/// Distance of the points of a projected line, m, and the most of them.
const STEP_M: f64 = 0.1;
const MOST_POINTS: usize = 3_000;
/// Least distance of the points of a line in the image, pixels.
const THIN_PX: f64 = 0.5;
/// Distance up to which a ray of the camera is followed to the ground, m.
const MOST_RAY_M: f64 = 200.0;

/// What can be projected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Projected {
    Cells,
    Horizon,
    Paths,
    Example,
}

impl Projected {
    pub(super) const ALL: [Self; 4] = [Self::Cells, Self::Horizon, Self::Paths, Self::Example];

    /// Name on the screen.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Cells => "cells of the map",
            Self::Horizon => "horizon",
            Self::Paths => "planned path",
            Self::Example => "training example",
        }
    }

    /// Name in layouts, which no topic has.
    pub(super) fn key(self) -> &'static str {
        match self {
            Self::Cells => "(cells)",
            Self::Horizon => "(horizon)",
            Self::Paths => "(paths)",
            Self::Example => "(example)",
        }
    }

    /// Whether it is shown until a person switches it off.
    pub(super) fn is_usual(self) -> bool {
        matches!(self, Self::Paths | Self::Example)
    }
}

/// What was computed for one image.
#[derive(Default)]
pub(super) struct Prepared {
    camera: Cached<(SameMessage, [usize; 2]), Result<PinholeCamera, String>>,
}

/// A camera at the time of its image, and what it sees.
pub(super) struct Seen {
    camera: PinholeCamera,
    pub(super) on_ground: OnGround,
}

impl Seen {
    /// What `layer`, an image of `topic`, shows. `None` without a calibration, or if no transform leads to the camera. The
    /// error says why the calibration cannot be used.
    pub(super) fn of(
        ctx: &Context,
        frame: &Frame,
        topic: &Topic,
        layer: &Layer,
        prepared: &mut Prepared,
    ) -> Option<Result<Self, String>> {
        let optical = Some(&*layer.optical_frame).filter(|name| !name.is_empty())?;
        let size = [layer.image.width, layer.image.height];
        let calibration = calibration(frame, topic, optical)?;
        let message = calibration.canonical()?;
        let read = message.get::<CameraCalibration>()?;
        let at = frame.placing_time(layer.taken, layer.log_time);
        let on_ground = OnGround::of(ctx, frame, optical, at)?;
        let key = (SameMessage(message.clone()), size);
        Some(match prepared.camera.get(key, || camera_of(read, size)) {
            Ok(camera) => Ok(Self { camera: camera.clone(), on_ground }),
            Err(error) => Err(format!("{}: {error}", calibration.name)),
        })
    }

    pub(super) fn ground(&self) -> &Ground {
        &self.on_ground.ground
    }

    /// The heights of the ground.
    fn floor(&self) -> Floor<'_> {
        Floor::of(self.ground().map.as_ref(), self.ground().level_m)
    }

    /// What there is to be shown.
    pub(super) fn has(&self, what: Projected) -> bool {
        match what {
            Projected::Cells => self.ground().map.is_some(),
            Projected::Horizon => true,
            Projected::Paths => !self.ground().paths.is_empty(),
            Projected::Example => self.ground().example.is_some(),
        }
    }

    /// Position in the image of a place in the scene, pixels from its left upper corner.
    pub(super) fn pixel(&self, p: DVec3) -> Option<[f64; 2]> {
        pixel(&self.camera, self.on_ground.camera_from_scene * p)
    }

    /// The place in the scene that a pixel shows: `depth_m` along the optical axis where that is known, else on the
    /// ground.
    pub(super) fn place(&self, pixel: [f64; 2], depth_m: Option<f64>) -> Option<DVec3> {
        let ray = self.camera.unproject(DVec2::new(pixel[0] - 0.5, pixel[1] - 0.5))?;
        let scene_from_camera = self.on_ground.camera_from_scene.inverse();
        if let Some(depth_m) = depth_m {
            return Some(scene_from_camera * (ray * depth_m));
        }
        let (from, along) = (scene_from_camera.translation, scene_from_camera.rotate(ray));
        let floor = self.floor();
        let height = floor.reader();
        let mut p = DVec3::new(from.x, from.y, self.ground().level_m);
        for _ in 0..4 {
            let times = (height(p) - from.z) / along.z;
            p = from + along * times;
            if !(times > 0.0 && p.distance(from) < MOST_RAY_M) {
                return None;
            }
        }
        Some(p)
    }

    /// The place of a point that another view names.
    pub(super) fn grounded(&self, p: [f64; 3]) -> DVec3 {
        let p = DVec3::from_array(p);
        if p.z.is_nan() { self.on_floor(DVec3::new(p.x, p.y, 0.0)) } else { p }
    }

    fn on_floor(&self, p: DVec3) -> DVec3 {
        DVec3::new(p.x, p.y, self.floor().reader()(p))
    }

    /// The horizon, as a line through the image.
    fn horizon(&self) -> Vec<Vec<[f64; 2]>> {
        let camera_from_scene = &self.on_ground.camera_from_scene;
        let ahead = camera_from_scene.inverse().rotate(DVec3::Z);
        let middle = ahead.y.atan2(ahead.x);
        let pixels = (-90..=90).map(|degree| {
            let (sin, cos) = (middle + f64::from(degree).to_radians()).sin_cos();
            let pixel = self.camera.project(camera_from_scene.rotate(DVec3::new(cos, sin, 0.0)))?;
            Some([pixel.x + 0.5, pixel.y + 0.5])
        });
        unbroken(pixels)
    }
}

/// What the lines on the ground that a camera sees follow from.
#[derive(Clone, PartialEq)]
struct SeenLines {
    map: Option<SameMessage>,
    camera: PinholeCamera,
    camera_from_scene: Pose,
    /// Height of the vehicle, m.
    level_m: f64,
    lines: Vec<Vec<DVec3>>,
}

impl SeenLines {
    fn of(seen: &Seen, lines: Vec<Vec<DVec3>>) -> Self {
        Self {
            map: seen.ground().map.clone().map(SameMessage),
            camera: seen.camera.clone(),
            camera_from_scene: seen.on_ground.camera_from_scene,
            level_m: seen.ground().level_m,
            lines,
        }
    }

    /// The visible parts of each line, in pixels of the image.
    fn parts(&self) -> Vec<Vec<Vec<[f64; 2]>>> {
        let floor = Floor::of(self.map.as_ref().map(|map| &map.0), self.level_m);
        let height = floor.reader();
        let parts = |points: &Vec<DVec3>| {
            let steps = points.windows(2).flat_map(|ends| {
                let length_m = ends[0].distance(ends[1]);
                let count = (length_m / STEP_M).ceil().clamp(1.0, 200.0) as usize;
                let (from, to) = (ends[0], ends[1]);
                (0..=count).map(move |step| from.lerp(to, step as f64 / count as f64))
            });
            let pixels = steps
                .take(MOST_POINTS)
                .map(|p| pixel(&self.camera, self.camera_from_scene * DVec3::new(p.x, p.y, height(p))));
            unbroken(pixels).into_iter().map(thinned).collect()
        };
        self.lines.iter().map(parts).collect()
    }
}

/// A line without points that lie too near to the one before: far away, a path has many in each pixel.
fn thinned(part: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    let last = part.len().saturating_sub(1);
    let mut kept: Vec<[f64; 2]> = Vec::new();
    for (index, p) in part.into_iter().enumerate() {
        let is_far = |q: &[f64; 2]| (p[0] - q[0]).hypot(p[1] - q[1]) >= THIN_PX;
        if index == last || kept.last().is_none_or(is_far) {
            kept.push(p);
        }
    }
    kept
}

/// The cells of a map, and the camera that sees them.
struct SeenCells {
    map: AnyMessage,
    camera: PinholeCamera,
    camera_from_scene: Pose,
    /// Height of the vehicle, m.
    level_m: f64,
}

impl SeenCells {
    fn of(seen: &Seen) -> Option<Self> {
        Some(Self {
            map: seen.ground().map.clone()?,
            camera: seen.camera.clone(),
            camera_from_scene: seen.on_ground.camera_from_scene,
            level_m: seen.ground().level_m,
        })
    }

    /// The cells whose cost is known, in pixels of the image.
    fn mesh(&self, palette: MapPalette) -> Mesh {
        let mut mesh = Mesh::default();
        let (Ok(view), Ok(colors)) = (GridView::of(&self.map), CellColors::of(&self.map, palette)) else {
            return mesh;
        };
        let (scene_from_grid, cell_m) = (view.frame_from_grid(), view.cell_size_m());
        let floor = Floor::of(Some(&self.map), self.level_m);
        let height = floor.reader();
        let size = [f64::from(self.camera.width), f64::from(self.camera.height)];
        for row in 0..view.rows() {
            for column in 0..view.columns() {
                let Some(color) = colors.at(column, row) else { continue };
                let corner = |x: f64, y: f64| {
                    scene_from_grid
                        * DVec3::new((column as f64 + x) * cell_m.x, (row as f64 + y) * cell_m.y, 0.0)
                };
                let middle = corner(0.5, 0.5);
                let z = height(middle);
                let seen = self.camera_from_scene * DVec3::new(middle.x, middle.y, z);
                if !(NEAREST_M..FARTHEST_M).contains(&seen.z) {
                    continue;
                }
                let corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)];
                let pixels = corners.map(|(x, y)| {
                    let p = corner(x, y);
                    pixel(&self.camera, self.camera_from_scene * DVec3::new(p.x, p.y, z))
                });
                let [Some(a), Some(b), Some(c), Some(d)] = pixels else { continue };
                let corners = [a, b, c, d];
                let is_out = |side: usize| {
                    corners.iter().all(|p| p[side] < 0.0) || corners.iter().all(|p| p[side] > size[side])
                };
                if is_out(0) || is_out(1) {
                    continue;
                }
                let first = mesh.vertices.len() as u32;
                for [x, y] in corners {
                    mesh.colored_vertex(Pos2::new(x as f32, y as f32), color);
                }
                mesh.add_triangle(first, first + 1, first + 2);
                mesh.add_triangle(first, first + 2, first + 3);
            }
        }
        mesh
    }
}

/// Position in the image of a place in the camera's optical frame, pixels from the left upper corner.
fn pixel(camera: &PinholeCamera, p: DVec3) -> Option<[f64; 2]> {
    if p.z < NEAREST_M {
        return None;
    }
    // The camera counts from the centre of the first pixel.
    camera.project(p).map(|pixel| [pixel.x + 0.5, pixel.y + 0.5])
}

/// Where an image is on the screen.
#[derive(Clone, Copy)]
pub(super) struct Place {
    pub(super) viewport: Viewport,
    pub(super) canvas: Rect,
}

impl Place {
    fn line(self, pixels: &[[f64; 2]]) -> Vec<Pos2> {
        pixels.iter().map(|pixel| self.viewport.to_screen(self.canvas, *pixel)).collect()
    }
}

/// Paints one of the projections; `slot` is that of the image.
pub(super) fn paint(
    painter: &Painter,
    what: Projected,
    seen: &Seen,
    slot: Id,
    place: Place,
    (opacity, palette): (f32, MapPalette),
    tokens: &Tokens,
) {
    // Twice the opacity of other overlays, because lines cover little of the image.
    let strong = (opacity * 2.0).min(1.0);
    let lines = |parts: &[Vec<[f64; 2]>], color: Color32, width: f32| {
        let halo = Stroke::new(width + 2.0, Color32::BLACK.gamma_multiply(0.6 * strong));
        for part in parts {
            let points = place.line(part);
            painter.add(Shape::line(points.clone(), halo));
            painter.add(Shape::line(points, Stroke::new(width, color.gamma_multiply(strong))));
        }
    };
    // The parts of lines on the ground, which another thread projects.
    let projected = |of: Vec<Vec<DVec3>>| {
        let seen = SeenLines::of(seen, of);
        prepared(painter.ctx(), slot.with(what.key()), seen.clone(), move || seen.parts())
    };
    match what {
        Projected::Cells => {
            let Some(cells) = SeenCells::of(seen) else { return };
            let key = (SameMessage(cells.map.clone()), cells.camera.clone(), cells.camera_from_scene);
            let mesh = prepared(painter.ctx(), slot.with(what.key()), key, move || cells.mesh(palette));
            let Some(mut mesh) = mesh.map(|mesh| (*mesh).clone()) else { return };
            let origin = place.viewport.to_screen(place.canvas, [0.0, 0.0]);
            mesh.transform(TSTransform::new(origin.to_vec2(), place.viewport.scale as f32));
            for vertex in &mut mesh.vertices {
                vertex.color = vertex.color.gamma_multiply(opacity);
            }
            painter.add(mesh);
        }
        Projected::Horizon => lines(&seen.horizon(), tokens.series(0), 1.0),
        Projected::Paths => {
            let paths = &seen.ground().paths;
            let parts = projected(paths.iter().map(|(points, _)| points.clone()).collect());
            for (parts, (_, series)) in parts.iter().flat_map(|parts| parts.iter()).zip(paths) {
                lines(parts, tokens.series(*series), 2.0);
            }
        }
        Projected::Example => {
            let Some((corners, is_ground)) = &seen.ground().example else { return };
            let parts = projected(vec![corners.iter().chain(corners.first()).copied().collect()]);
            for parts in parts.iter().flat_map(|parts| parts.iter()) {
                lines(parts, if *is_ground { tokens.ok } else { tokens.warning }, 2.0);
            }
        }
    }
}

/// The parts of a line in which every point is seen.
fn unbroken(pixels: impl Iterator<Item = Option<[f64; 2]>>) -> Vec<Vec<[f64; 2]>> {
    let mut parts = vec![Vec::new()];
    for pixel in pixels {
        match (pixel, parts.last_mut()) {
            (Some(pixel), Some(part)) => part.push(pixel),
            (None, Some(part)) if !part.is_empty() => parts.push(Vec::new()),
            _ => {}
        }
    }
    parts.retain(|part| part.len() > 1);
    parts
}

/// What can be shown of what a camera sees.
pub(super) fn offered(seen: Option<&Seen>) -> Vec<Projected> {
    let has = |what: &Projected| seen.is_some_and(|seen| seen.has(*what));
    Projected::ALL.into_iter().filter(has).collect()
}

/// The image of ranges that was taken with `layer`, an image of `topic`: of the same camera, acquired at the same time, and
/// of the same source where it is both recorded and computed.
pub(super) fn ranges<'a>(frame: &'a Frame, topic: &Topic, layer: &Layer) -> Option<&'a Topic> {
    let is_it = |ranges: &&Topic| {
        ranges.role() == Some(Role::Depth)
            && ranges.acq_time() == Some(layer.taken)
            && layer::optical_frame(ranges) == Some(&*layer.optical_frame)
    };
    let is_of_other =
        |ranges: &&Topic| ranges.run.is_recorded() != layer::takes_recorded(frame, topic, &ranges.name);
    let taken = frame.topics.iter().filter(|ranges| !ranges.is_ground_truth()).filter(is_it);
    // The first one of the same source, else the first one.
    taken.min_by_key(is_of_other)
}

/// The calibration of an image: of those of its coordinate frame the one whose name is most like its own.
fn calibration<'a>(frame: &'a Frame, image: &Topic, optical: &str) -> Option<&'a Topic> {
    let fits = |topic: &&Topic| {
        topic
            .get::<CameraCalibration>()
            .is_some_and(|calibration| frame_name(&calibration.frame_id) == optical)
    };
    // Of several equal ones that of the run: `max_by_key` returns the last one.
    let common = |topic: &&Topic| (likeness(&topic.name, &image.name), !topic.run.is_recorded());
    frame.topics_of_type("foxglove.CameraCalibration").filter(fits).max_by_key(common)
}

/// The camera of a calibration for images of this size, pixels: that of the calibration, or one with the same aspect ratio.
fn camera_of(calibration: &CameraCalibration, size: [usize; 2]) -> Result<PinholeCamera, String> {
    let of = [calibration.width, calibration.height];
    let size = size.map(|side| side as u32);
    let (model, d) = (&calibration.distortion_model, &calibration.d);
    let camera =
        PinholeCamera::from_calibration(of, &calibration.k, model, d).map_err(|error| error.to_string())?;
    if size == of {
        return Ok(camera);
    }
    if !has_ratio_of(size, of) {
        let ([width, height], [of_width, of_height]) = (size, of);
        return Err(format!(
            "image has {width}×{height} pixels, expected the aspect ratio of {of_width}×{of_height}"
        ));
    }
    camera.resized(size).map_err(|error| error.to_string())
}

/// Whether two sizes have the same aspect ratio, apart from one pixel by which a side of the smaller one was rounded.
fn has_ratio_of(a: [u32; 2], b: [u32; 2]) -> bool {
    let [[a_width, a_height], [b_width, b_height]] = [a, b].map(|size| size.map(u64::from));
    let longest = a_width.max(a_height).max(b_width).max(b_height);
    (a_width * b_height).abs_diff(b_width * a_height) <= longest
}

/// How much alike two names are: the number of bytes in which they agree from their start, after a slash.
fn likeness(a: &str, b: &str) -> usize {
    let [a, b] = [a, b].map(|name| name.trim_start_matches('/').bytes());
    a.zip(b).take_while(|(a, b)| a == b).count()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples;
    use rcs_msg::foxglove::RawImage;
    use rcs_runtime::source::RunTag;
    use std::sync::Arc;

    #[test]
    fn a_side_that_was_rounded_keeps_the_aspect_ratio_and_a_part_of_an_image_does_not() {
        for (a, b, expected) in [
            ([320, 240], [640, 480], true),
            ([320, 240], [641, 481], true),
            ([160, 120], [641, 482], true),
            ([640, 360], [640, 480], false),
            ([200, 160], [320, 240], false),
        ] {
            assert_eq!([has_ratio_of(a, b), has_ratio_of(b, a)], [expected; 2], "{a:?} {b:?}");
        }
    }

    #[test]
    fn the_ranges_of_an_image_are_recorded_or_computed_as_the_image_is() {
        let raw = RawImage {
            frame_id: "camera".to_owned(),
            width: 2,
            height: 1,
            encoding: "mono8".to_owned(),
            step: 2,
            data: vec![1, 2].into(),
            ..RawImage::default()
        };
        let of_run = samples::topic("/camera/image", 5.0, 0.1, raw.clone());
        let mut depth = samples::topic("/camera/depth", 5.0, 0.1, raw);
        depth.metadata = Arc::new([("rcs.role".to_owned(), "depth".to_owned())].into());
        let [recorded, recorded_depth] = [&of_run, &depth].map(|topic| {
            let mut topic = topic.clone();
            topic.run = RunTag::Recorded;
            topic
        });
        let topics = [recorded.clone(), of_run.clone(), recorded_depth, depth];
        let frame = Frame { topics: Arc::new(topics), ..samples::empty() };
        for image in [recorded, of_run] {
            let layer = layer::layer(&Context::default(), &image, MapPalette::default(), 0.001);
            let found = ranges(&frame, &image, &layer.unwrap().unwrap());
            assert_eq!(found.map(|topic| topic.run), Some(image.run));
        }
    }
}
