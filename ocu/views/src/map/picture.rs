//! Grids and clouds as pictures, which other threads paint. Each has what places it on the map: while a newer one is
//! being painted, it lies where its own message puts it.

use super::cloud::Cloud;
use super::grid::{Cells, Shade};
use super::layers::{self, Layer};
use crate::canvas::Viewport;
use crate::cloud_look::CloudLook;
use crate::prepare::{Painted, Same, prepared};
use egui::{Color32, Context, Id, Pos2, Rect, TextureId, TextureOptions, Vec2};
use ocu_ui::palette::MapPalette;
use rcs_geom::{DVec3, Pose};
use rcs_msg::Stamp;
use rcs_msg::foxglove::PointCloud;
use rcs_runtime::source::Frame;
use rcs_world::Weights;
use std::sync::Arc;

/// How a grid is painted.
pub(super) struct GridLook {
    /// The number by which it is coloured.
    pub(super) shade: Shade,
    pub(super) palette: MapPalette,
    /// Weights with which the fused cost is computed again.
    pub(super) weights: Option<Weights>,
    /// Whether cells without a cost show what is below.
    pub(super) shows_below: bool,
}

/// A painted grid.
pub(super) struct GridPicture {
    painted: Painted,
    /// Its corners in its coordinate frame, counter-clockwise from cell (0, 0) along x.
    corners: [DVec3; 4],
    frame_id: String,
    stamp: Stamp,
    /// The values at the ends of the colour scale; `None` for costs and confidences, whose range is fixed.
    pub(super) range: Option<[f64; 2]>,
}

impl GridPicture {
    /// The picture of a layer's grid; `None` until the first one is painted, or if it is no valid grid.
    pub(super) fn of(ctx: &Context, layer: &Layer<'_>, look: GridLook) -> Option<Arc<Self>> {
        let (topic, message) = (layer.topic?, layer.message()?);
        let GridLook { shade, palette, weights, shows_below } = look;
        let slot = Id::unique(("grid", &*topic.name, topic.run, shade.name(), palette, shows_below));
        let (key, frame_id, stamp) =
            ((message.clone(), weights.clone()), layer.frame_id.to_owned(), layer.stamp);
        let picture = prepared(ctx, slot, key, move || {
            let cells = Cells::new(&message.0).ok()?;
            let range = cells.range(&shade);
            let mut image = cells.paint(&shade, palette, range, weights.as_ref());
            let unknown = image.pixels.iter_mut().filter(|pixel| shows_below && **pixel == palette.unknown());
            unknown.for_each(|pixel| *pixel = Color32::TRANSPARENT);
            let painted = Painted::new(image);
            Some(Arc::new(Self { painted, corners: cells.corners(), frame_id, stamp, range }))
        });
        picture.and_then(|picture| (*picture).clone())
    }

    /// Its corners on the map; `None` where no transform leads there.
    pub(super) fn corners(&self, frame: &Frame, map: &str) -> Option<[DVec3; 4]> {
        let map_from_grid = layers::map_from_frame(frame, map, &self.frame_id, self.stamp).ok()?;
        Some(self.corners.map(|corner| map_from_grid * corner))
    }

    pub(super) fn texture(&self, ctx: &Context) -> TextureId {
        self.painted.texture(ctx, TextureOptions::NEAREST)
    }
}

/// The points of a layer's cloud on the map; `None` until the first ones are read, or if they cannot be read.
pub(super) fn cloud(
    ctx: &Context,
    layer: &Layer<'_>,
    map: &str,
    map_from_frame: Pose,
    look: &CloudLook,
) -> Option<Arc<Cloud>> {
    read_cloud(ctx, layer, map, map_from_frame, look)?.ok()
}

/// The points of a layer's cloud on the map; the error says why they cannot be read. `None` until the first ones are
/// read.
pub(super) fn read_cloud(
    ctx: &Context,
    layer: &Layer<'_>,
    map: &str,
    map_from_frame: Pose,
    look: &CloudLook,
) -> Option<Result<Arc<Cloud>, String>> {
    let (topic, message, by) = (layer.topic?, layer.message()?, look.by.clone());
    let slot = Id::unique(("cloud", &*topic.name, topic.run, map, &by));
    let cloud = prepared(ctx, slot, (message.clone(), map_from_frame), move || {
        let cloud = message.0.get::<PointCloud>().ok_or("it is no point cloud")?;
        Cloud::new(cloud, &map_from_frame, by.as_deref()).map(Arc::new)
    });
    cloud.map(|cloud| (*cloud).clone())
}

/// A painted cloud.
pub(super) struct CloudPicture {
    painted: Painted,
    /// Where the map looked, and the size of its canvas, screen points.
    viewport: Viewport,
    size: Vec2,
    per_point: f32,
}

impl CloudPicture {
    /// The picture of a layer's cloud on the canvas of one view; `None` until the first one is painted. `side` is that of
    /// its points, screen points.
    pub(super) fn of(
        ctx: &Context,
        layer: &Layer<'_>,
        (cloud, side): (Arc<Cloud>, f32),
        canvas: Id,
        viewport: Viewport,
        size: Vec2,
    ) -> Option<Arc<Self>> {
        let topic = layer.topic?;
        let slot = Id::unique(("painted cloud", &*topic.name, topic.run, canvas));
        let per_point = ctx.pixels_per_point();
        let key = (Same(Arc::clone(&cloud)), viewport, size, per_point, side);
        prepared(ctx, slot, key, move || {
            let canvas = Rect::from_min_size(Pos2::ZERO, size);
            let painted = Painted::new(cloud.paint(canvas, viewport, per_point, side));
            Self { painted, viewport, size, per_point }
        })
    }

    /// Where its corners lie on the canvas, from the upper left one clockwise: while the map is moved or turned, where
    /// its points are now.
    pub(super) fn corners(&self, viewport: Viewport, canvas: Rect) -> [Pos2; 4] {
        let [width, height] = self.painted.size().map(|side| side as f32 / self.per_point);
        let corners = [[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]].map(Pos2::from);
        if (self.viewport, self.size) == (viewport, canvas.size()) {
            return corners.map(|corner| canvas.min + corner.to_vec2());
        }
        let painted_on = Rect::from_min_size(Pos2::ZERO, self.size);
        corners.map(|corner| viewport.to_screen(canvas, self.viewport.to_plane(painted_on, corner)))
    }

    pub(super) fn texture(&self, ctx: &Context) -> TextureId {
        self.painted.texture(ctx, TextureOptions::NEAREST)
    }
}

#[cfg(test)]
mod tests {
    use super::super::layers::Kind;
    use super::*;
    use crate::samples;
    use egui::ColorImage;

    #[test]
    fn a_cloud_that_cannot_be_read_says_why() {
        let ctx = Context::default();
        let read = |message: PointCloud| {
            let topic = samples::topic("/points", 1.0, 0.0, message);
            let kind = Kind::Cloud;
            let (name, stamp, topic) = ("/points".into(), Stamp(1), Some(&topic));
            let layer = Layer { name, kind, frame_id: "", stamp, topic, is_twin: false };
            let read = read_cloud(&ctx, &layer, "map", Pose::IDENTITY, &CloudLook::default());
            read.map(|read| read.map(|cloud| cloud.points.len()))
        };
        assert_eq!(read(samples::cloud(&[[1.0, 2.0, 3.0]])), Some(Ok(1)));
        let flat = PointCloud { fields: Vec::new(), ..samples::cloud(&[[1.0, 2.0, 3.0]]) };
        let reason = read(flat);
        assert!(matches!(&reason, Some(Err(reason)) if !reason.is_empty()), "{reason:?}");
    }

    #[test]
    fn a_cloud_painted_for_another_place_lies_where_its_points_are() {
        let (canvas, size) = (Rect::from_min_max(Pos2::new(10.0, 20.0), Pos2::new(110.0, 70.0)), [200, 100]);
        let viewport = Viewport { center: [3.0, 4.0], scale: 5.0, y_up: true, turned_rad: 0.0 };
        let painted = Painted::new(ColorImage::filled(size, Color32::RED));
        let picture = CloudPicture { painted, viewport, size: canvas.size(), per_point: 2.0 };
        assert_eq!(picture.corners(viewport, canvas)[0], canvas.min);
        assert_eq!(picture.corners(viewport, canvas)[2], canvas.max);
        // The map is moved by two metres to the east, enlarged twice, and turned.
        for turned_rad in [0.0, 0.7] {
            let moved = Viewport { center: [5.0, 4.0], scale: 10.0, y_up: true, turned_rad };
            let corners = picture.corners(moved, canvas);
            let (min, max) = viewport.bounds(canvas);
            let places = [[min[0], max[1]], [max[0], max[1]], [max[0], min[1]], [min[0], min[1]]];
            for (corner, place) in corners.into_iter().zip(places) {
                assert!((corner - moved.to_screen(canvas, place)).length() < 1e-3);
            }
        }
    }
}
