//! What a camera is expected to see of the world model (Albus 2006a, 4): its obstacles, each from its foot to its top, and
//! a planned path on the ground.

use glam::{DVec2, DVec3};
use rcs_geom::{PinholeCamera, Pose};
use rcs_sense::{Standing, plane_height};
use rcs_world::{GridView, GridViewError, Label, NumericType};

/// Nothing nearer to the camera than this is predicted, m along the optical axis.
const NEAREST_M: f64 = 0.2;
/// Height of an obstacle of which no height is known, m: what is judged by its appearance alone.
const LEAST_HEIGHT_M: f64 = 0.1;
/// Distance between the points of a projected path, m, and the most of them in a part of it.
const STEP_M: f64 = 0.2;
const MOST_STEPS: f64 = 500.0;

/// A camera at the time of its image.
#[derive(Clone, Copy, Debug)]
pub struct Sight<'a> {
    /// The camera.
    pub camera: &'a PinholeCamera,
    /// Extrinsics of the camera.
    pub vehicle_from_camera: &'a Pose,
    /// Pose of the vehicle in the frame of the map and of the path.
    pub local_from_vehicle: &'a Pose,
    /// Distance of the ground plane below the origin of the vehicle frame, m.
    pub below_m: f64,
    /// Nothing farther from the vehicle than this is predicted, m on the ground.
    pub range_m: f64,
}

impl Sight<'_> {
    fn camera_from_local(&self) -> Pose {
        (*self.local_from_vehicle * *self.vehicle_from_camera).inverse()
    }

    fn is_in_range(&self, place: DVec2) -> bool {
        place.distance(self.local_from_vehicle.translation.truncate()) <= self.range_m
    }

    /// Whether a line between two pixels may cross the image.
    fn may_show(&self, ends: [DVec2; 2]) -> bool {
        let size = DVec2::new(f64::from(self.camera.width), f64::from(self.camera.height));
        let [low, high] = [ends[0].min(ends[1]), ends[0].max(ends[1])];
        high.cmpge(DVec2::splat(-0.5)).all() && low.cmplt(size - 0.5).all()
    }
}

/// The obstacles of a map whose field `cost` is the fused cost: for each of its cells that the camera sees, a line from
/// the foot to the top, pixels with the centre of the first one at 0. The map is in the local frame. Nothing hides what
/// lies behind it; a vehicle that lies on its side sees nothing.
pub fn obstacles(map: &GridView<'_>, sight: &Sight<'_>) -> Result<Vec<[DVec2; 2]>, GridViewError> {
    let mut costs = Vec::new();
    map.field_of("cost", NumericType::Uint8)?.bytes_into(&mut costs);
    let standing = Standing::of(map);
    let plane = plane_height(sight.local_from_vehicle, sight.below_m);
    let camera_from_local = sight.camera_from_local();
    let [columns, rows] = standing.around(sight.local_from_vehicle.translation, sight.range_m);
    let cells = rows.flat_map(|row| columns.clone().map(move |column| (column, row)));
    let line = |(column, row): (usize, usize)| {
        if Label::of_cost(costs[row * map.columns() + column]) != Label::Obstacle {
            return None;
        }
        let place = standing.middle(column, row);
        let [foot, top] = standing.ends_m(column, row, plane(place)?);
        let pixel = |z: f64| {
            let seen = camera_from_local * place.extend(z);
            if seen.z < NEAREST_M { None } else { sight.camera.project(seen) }
        };
        let ends = [pixel(foot)?, pixel(top.max(foot + LEAST_HEIGHT_M))?];
        (sight.is_in_range(place) && sight.may_show(ends)).then_some(ends)
    };
    Ok(cells.filter_map(line).collect())
}

/// The parts of a path, m in the local frame, that the camera sees, as lines of pixels. The path lies on the ground of the
/// map, and on the plane under the vehicle where that does not say its height.
pub fn path(places: &[DVec2], map: Option<&GridView<'_>>, sight: &Sight<'_>) -> Vec<Vec<DVec2>> {
    let standing = map.map(Standing::of);
    let plane = plane_height(sight.local_from_vehicle, sight.below_m);
    let camera_from_local = sight.camera_from_local();
    let pixel = |place: DVec2| {
        let level_m = plane(place)?;
        let ground_m = standing.as_ref().and_then(|standing| standing.ground_at_m(place));
        let seen: DVec3 = camera_from_local * place.extend(ground_m.unwrap_or(level_m));
        let is_seen = seen.z >= NEAREST_M && sight.is_in_range(place);
        is_seen.then(|| sight.camera.project(seen)).flatten()
    };
    let steps = places.windows(2).flat_map(|ends| {
        let (from, to) = (ends[0], ends[1]);
        let count = (from.distance(to) / STEP_M).ceil().clamp(1.0, MOST_STEPS) as usize;
        (0..count).map(move |step| from.lerp(to, step as f64 / count as f64))
    });
    let mut parts: Vec<Vec<DVec2>> = vec![Vec::new()];
    for seen in steps.chain(places.last().copied()).map(pixel) {
        match (seen, parts.last_mut()) {
            (Some(pixel), Some(part)) => part.push(pixel),
            (None, Some(part)) if !part.is_empty() => parts.push(Vec::new()),
            _ => {}
        }
    }
    parts.retain(|part| part.windows(2).any(|ends| sight.may_show([ends[0], ends[1]])));
    parts
}
