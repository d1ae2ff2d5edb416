//! The thread that prepares and draws the scene. The interface waits for it only where the view is closed or the thread
//! has failed, for a moment. Of several requests only the newest is carried out.

use super::camera::{Camera, corners};
use super::gpu::{Draw, Gpu, Pixels};
use super::shapes::{Shapes, grid_pose};
use crate::cached::SameMessage;
use crate::cloud_look::CloudLook;
use crate::map::CellColors;
use crate::primitives::PlacedEntities;
use egui::ColorImage;
use glam::DMat4;
use ocu_ui::palette::MapPalette;
use rcs_geom::{DVec3, Pose};
use rcs_msg::foxglove::PointCloud;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, TryRecvError, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// What a layer consists of.
pub(super) enum Content {
    Grid(SameMessage),
    Cloud(SameMessage, CloudLook),
    /// In the frame of the scene.
    Entities(PlacedEntities),
    Made(Arc<Shapes>),
}

/// A layer, and the pose of its frame in the scene.
pub(super) struct Layer {
    pub(super) name: String,
    pub(super) content: Content,
    pub(super) pose: Pose,
}

impl Layer {
    /// Whether it has anything to be fitted to.
    pub(super) fn has_content(&self) -> bool {
        match &self.content {
            Content::Grid(_) | Content::Cloud(..) | Content::Entities(_) => true,
            Content::Made(shapes) => shapes.bounds.is_some(),
        }
    }
}

/// A picture that is wanted.
pub(super) struct Request {
    pub(super) number: u64,
    pub(super) layers: Vec<Layer>,
    /// Where to look from; `None` to fit everything.
    pub(super) camera: Option<Camera>,
    pub(super) size: [u32; 2],
    pub(super) per_point: f32,
    pub(super) background: [f64; 3],
    pub(super) palette: MapPalette,
}

/// A picture.
pub(super) struct Picture {
    pub(super) number: u64,
    pub(super) camera: Camera,
    /// The camera that would see everything.
    pub(super) fit: Camera,
    pub(super) image: Arc<ColorImage>,
    /// Depth of each pixel: 0 near to 1 far; 1 where nothing was drawn.
    pub(super) depth: Vec<f32>,
    /// Layers that could not be read, with the reason.
    pub(super) problems: Vec<String>,
}

/// How much farther each grid is drawn than the one after it, in depth, so that of several at one height the last one is
/// seen everywhere: at the middle of the picture 0.0004 of the distance, about ten times what rounding makes. The last
/// one stays in its place, so that it hides nothing that lies on the ground, and the place under the pointer is right.
const FARTHER: f64 = 4e-6;
/// Maximum time for which a view that is closed waits for its thread.
const LAST: Duration = Duration::from_millis(500);
/// What is said where the thread has ended by itself.
const ENDED: &str = "the thread that draws it has ended by a panic, which it printed";

/// The thread, from outside. Dropping it waits until the thread has drawn its current picture and released the device:
/// a program that ends while a thread still uses the graphics driver crashes in it.
pub(super) struct Worker {
    /// `None` only while it is dropped.
    requests: Option<Sender<Request>>,
    /// Set when the view is closed: what was requested and not begun is not drawn any more.
    is_closed: Arc<AtomicBool>,
    /// Closed by the thread once it has released the device.
    pictures: Receiver<Result<Picture, String>>,
    /// `None` only while it is dropped.
    thread: Option<JoinHandle<()>>,
}

/// Wakes the window when the thread ends by a panic, so that the view says so.
struct Wakes(egui::Context);

impl Drop for Wakes {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.0.request_repaint();
        }
    }
}

impl Worker {
    pub(super) fn start(ctx: egui::Context) -> std::io::Result<Self> {
        let (requests, receiver) = channel::<Request>();
        let (sender, pictures) = channel();
        let is_closed = Arc::new(AtomicBool::new(false));
        let ends = Arc::clone(&is_closed);
        let thread = std::thread::Builder::new().name("scene".to_owned()).spawn(move || {
            // Dropped in reverse order: the device, then the channel, whose end the woken window sees.
            let wakes = Wakes(ctx);
            let answers = sender;
            let mut gpu = None;
            let mut prepared = Prepared::default();
            while let Ok(mut request) = receiver.recv() {
                while let Ok(newer) = receiver.try_recv() {
                    request = newer;
                }
                if ends.load(Ordering::Relaxed) {
                    return;
                }
                let drawn = match &mut gpu {
                    None => Gpu::new().and_then(|new| picture(gpu.insert(new), &mut prepared, &request)),
                    Some(gpu) => picture(gpu, &mut prepared, &request),
                };
                if answers.send(drawn).is_err() {
                    return;
                }
                // A repaint without a delay is done twice.
                wakes.0.request_repaint_after(Duration::from_millis(1));
            }
        })?;
        Ok(Self { requests: Some(requests), is_closed, pictures, thread: Some(thread) })
    }

    pub(super) fn ask(&self, request: Request) {
        if let Some(requests) = &self.requests {
            // Where the thread has ended, `take` and `wait` say so.
            let _ = requests.send(request);
        }
    }

    /// The newest picture since the last call. An error says why there is none, also where the thread has ended by a
    /// panic.
    pub(super) fn take(&self) -> Option<Result<Picture, String>> {
        let mut newest = None;
        loop {
            match self.pictures.try_recv() {
                Ok(picture) => newest = Some(picture),
                Err(TryRecvError::Empty) => return newest,
                Err(TryRecvError::Disconnected) => return newest.or_else(|| Some(Err(ENDED.to_owned()))),
            }
        }
    }

    /// Like [`Worker::take`], for which it waits a little.
    pub(super) fn wait(&self, time: Duration) -> Option<Result<Picture, String>> {
        match self.pictures.recv_timeout(time) {
            Ok(picture) => Some(picture),
            Err(RecvTimeoutError::Timeout) => None,
            Err(RecvTimeoutError::Disconnected) => Some(Err(ENDED.to_owned())),
        }
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        self.is_closed.store(true, Ordering::Relaxed);
        self.requests = None;
        let until = Instant::now() + LAST;
        let ended = loop {
            match self.pictures.recv_timeout(until.saturating_duration_since(Instant::now())) {
                Ok(_) => {}
                Err(error) => break error == RecvTimeoutError::Disconnected,
            }
        };
        if let Some(thread) = self.thread.take().filter(|_| ended) {
            // What made it panic was printed by it.
            let _ = thread.join();
        }
    }
}

/// Shapes by layer, with what they were made of.
#[derive(Default)]
struct Prepared(BTreeMap<String, (Source, MapPalette, Made)>);

/// What shapes are made of; messages are compared by identity.
#[derive(Clone, PartialEq)]
enum Source {
    Grid(SameMessage),
    Cloud(SameMessage, CloudLook),
    Entities(PlacedEntities),
}

/// Shapes, or why a message has none.
type Made = Result<Arc<Shapes>, String>;

impl Prepared {
    fn shapes(&mut self, layer: &Layer, palette: MapPalette) -> Result<Arc<Shapes>, String> {
        let source = match &layer.content {
            Content::Made(shapes) => return Ok(Arc::clone(shapes)),
            Content::Grid(message) => Source::Grid(message.clone()),
            Content::Cloud(message, look) => Source::Cloud(message.clone(), look.clone()),
            Content::Entities(placed) => Source::Entities(placed.clone()),
        };
        if let Some((known, of, shapes)) = self.0.get(&layer.name)
            && *known == source
            && *of == palette
        {
            return shapes.clone();
        }
        let made = match &source {
            Source::Grid(message) => {
                CellColors::of(&message.0, palette).and_then(|colors| Shapes::grid(&message.0, &colors))
            }
            Source::Cloud(message, look) => {
                let cloud = message.0.get::<PointCloud>().ok_or("it is no point cloud".to_owned());
                cloud.and_then(|cloud| Shapes::cloud(cloud, look))
            }
            Source::Entities(placed) => Ok(Shapes::entities(placed)),
        };
        let made = made.map(Arc::new);
        self.0.insert(layer.name.clone(), (source, palette, made.clone()));
        made
    }
}

fn picture(gpu: &mut Gpu, prepared: &mut Prepared, request: &Request) -> Result<Picture, String> {
    let mut problems = Vec::new();
    let mut shapes: Vec<(Arc<Shapes>, Pose)> = Vec::new();
    // The number of each grid among the grids; `None` for other shapes.
    let mut numbers: Vec<Option<u32>> = Vec::new();
    let mut grids = 0_u32;
    for layer in &request.layers {
        match prepared.shapes(layer, request.palette) {
            Ok(made) => {
                let pose = match &layer.content {
                    Content::Grid(message) => layer.pose * grid_pose(&message.0),
                    Content::Entities(placed) => layer.pose * Pose::from_translation(placed.anchor()),
                    Content::Cloud(..) | Content::Made(_) => layer.pose,
                };
                let is_grid = matches!(layer.content, Content::Grid(_));
                numbers.push(is_grid.then_some(grids));
                grids += u32::from(is_grid);
                shapes.push((made, pose));
            }
            Err(error) => problems.push(format!("{}: {error}", layer.name)),
        }
    }
    prepared.0.retain(|name, _| request.layers.iter().any(|layer| layer.name == *name));
    let [width, height] = request.size.map(|v| f64::from(v.max(1)));
    let aspect = width / height;
    let fit = fitted(&shapes, aspect);
    let camera = request.camera.unwrap_or(fit);
    let clip_from_scene = camera.clip_from_world(aspect);
    let draws: Vec<Draw> = shapes
        .into_iter()
        .zip(numbers)
        .map(|((shapes, pose), number)| {
            let scene_from_shapes = DMat4::from_rotation_translation(pose.rotation, pose.translation);
            let later = number.map_or(0, |number| grids - 1 - number);
            let pushed = DMat4::from_translation(FARTHER * f64::from(later) * DVec3::Z);
            Draw { shapes, clip_from_shapes: pushed * clip_from_scene * scene_from_shapes }
        })
        .collect();
    let Pixels { size, rgba, depth } =
        gpu.draw(&draws, request.size, request.per_point, request.background)?;
    let image = Arc::new(ColorImage::from_rgba_unmultiplied(size, &rgba));
    Ok(Picture { number: request.number, camera, fit, image, depth, problems })
}

/// A camera that sees everything in a picture with this ratio of width to height.
fn fitted(shapes: &[(Arc<Shapes>, Pose)], aspect: f64) -> Camera {
    let mut bounds: Option<[DVec3; 2]> = None;
    for (shapes, pose) in shapes {
        let Some([low, high]) = shapes.bounds else { continue };
        for corner in corners(low, high) {
            let p = *pose * corner;
            let [min, max] = bounds.get_or_insert([p, p]);
            (*min, *max) = (min.min(p), max.max(p));
        }
    }
    let [min, max] = bounds.unwrap_or([DVec3::splat(-5.0), DVec3::splat(5.0)]);
    Camera::fit(min, max, aspect)
}

#[cfg(test)]
impl Worker {
    /// A worker without a thread, which gives these pictures.
    pub(super) fn of(pictures: Receiver<Result<Picture, String>>) -> Self {
        Self { requests: None, is_closed: Arc::default(), pictures, thread: None }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples;
    use egui::Color32;
    use rcs_msg::AnyMessage;

    #[test]
    fn a_thread_that_has_ended_is_not_one_that_has_nothing_new() {
        let (sender, pictures) = channel();
        let worker = Worker::of(pictures);
        assert!(worker.take().is_none() && worker.wait(Duration::ZERO).is_none());
        drop(sender);
        assert!(matches!(worker.take(), Some(Err(_))));
        assert!(matches!(worker.wait(Duration::ZERO), Some(Err(_))));
    }

    #[test]
    fn a_view_that_is_closed_leaves_no_thread_that_uses_the_driver() {
        let worker = Worker::start(egui::Context::default()).expect("a thread");
        let ground = Arc::new(Shapes::ground(DVec3::ZERO, 10.0, 1.0, Color32::WHITE));
        for number in 1..=3 {
            let content = Content::Made(Arc::clone(&ground));
            worker.ask(Request {
                number,
                layers: vec![Layer { name: "ground".to_owned(), content, pose: Pose::IDENTITY }],
                camera: None,
                size: [64, 48],
                per_point: 1.0,
                background: [0.0; 3],
                palette: MapPalette::Papers,
            });
        }
        drop(worker);
        assert_eq!(Arc::strong_count(&ground), 1, "the thread holds what it draws as long as it runs");
    }

    #[test]
    fn of_grids_at_one_height_the_last_one_is_seen_in_its_place_and_hides_nothing_above_it() {
        let mut gpu = match Gpu::new() {
            Ok(gpu) => gpu,
            Err(reason) => return println!("skipped: {reason}"),
        };
        let grid = |name: &str, side: usize, cost: u8, z: f64| {
            let message = AnyMessage::new(samples::costmap(side, &vec![cost; side * side]));
            let pose = Pose::from_translation(DVec3::Z * z);
            Layer { name: name.to_owned(), content: Content::Grid(SameMessage(message)), pose }
        };
        // The colour and the depth of the middle.
        let mut middle = |layers: Vec<Layer>, center: [f64; 3], distance_m: f64| {
            let camera = Camera { center, distance_m, azimuth_rad: -2.2, elevation_rad: 0.7 };
            let request = Request {
                number: 1,
                layers,
                camera: Some(camera),
                // The middle of the middle pixel is the middle of the image.
                size: [65, 65],
                per_point: 1.0,
                background: [0.0; 3],
                palette: MapPalette::Papers,
            };
            let picture = picture(&mut gpu, &mut Prepared::default(), &request).expect("a picture");
            (picture.image.pixels[32 * 65 + 32], picture.depth[32 * 65 + 32])
        };
        let near = [1.5, 2.5, 0.0];
        let first = middle(vec![grid("/a", 2, 0, 0.0)], near, 2.0);
        // It lies lower by a tenth of a millimetre: more than rounding does.
        let last = middle(vec![grid("/b", 2, 250, -1e-4)], near, 2.0);
        assert_ne!(first.0, last.0);
        let both = middle(vec![grid("/a", 2, 0, 0.0), grid("/b", 2, 250, -1e-4)], near, 2.0);
        assert_eq!(both, last);

        // A point 5 cm above the ground, from far away.
        let far = [11.0, 12.0, 0.0];
        let cloud = || {
            let message = AnyMessage::new(samples::cloud(&[[11.0, 12.0, 0.05]]));
            let content = Content::Cloud(SameMessage(message), CloudLook::default());
            Layer { name: "/c".to_owned(), content, pose: Pose::IDENTITY }
        };
        let point = middle(vec![cloud()], far, 200.0);
        let grids = || vec![grid("/a", 40, 0, 0.0), grid("/b", 40, 250, 0.0)];
        assert_ne!(middle(grids(), far, 200.0).0, point.0);
        let all: Vec<Layer> = grids().into_iter().chain([cloud()]).collect();
        assert_eq!(middle(all, far, 200.0), point);
    }
}
