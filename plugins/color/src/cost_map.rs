//! Cost maps from images (Albus 2006a, 3.1.2): projects the pixels of the reduced image onto the plane under the
//! vehicle.
//!
//! The cost of a cell is the mean over the pixels whose rays meet the plane in that cell. Far from the vehicle a pixel
//! covers several cells but its ray meets only one of them; a cell without a pixel of its own takes the cost of the
//! pixel into which its centre projects. Cells beyond the range stay unknown, because the plane does not hold there.
//!
//! In each column of the image the foot of a known obstacle ([`crate::upright`], [`crate::posts`]) says where it is, and
//! the pixels above say nothing; where something in front of the foot hides it, or something higher stands there
//! ([`crate::hidden`]), there is none. A cell with a foot has the highest cost, and a backing: how sure it is that it is
//! the known obstacle.
//!
//! What is said about a cell is worth less the less sure its place is ([`PlaneNoise`]): a pixel far ahead covers several
//! cells, and the ground there is not quite the plane under the vehicle.

use crate::engine::Known;
use crate::hidden::Screens;
use crate::image::{HEIGHT, WIDTH};
use crate::posts::{View, joined, posts};
use crate::upright::{Foot, Pixels, Shape, feet};
use glam::{DVec2, DVec3};
use rcs_geom::{PinholeCamera, Pose};
use rcs_msg::Stamp;
use rcs_msg::foxglove::Grid;
use rcs_sense::{CostGrid, GridFrame, PlaneNoise, plane_height, worth};
use rcs_world::{MAX_COST, OBSTACLE_COST, SIDE, Source, UNKNOWN_COST};
use std::borrow::Cow;

/// Pose and projection of the camera when the image was taken.
#[derive(Clone, Copy, Debug)]
pub struct CameraPlacement<'a> {
    /// The camera.
    pub camera: &'a PinholeCamera,
    /// Rays of the reduced image: [`crate::region::rays`].
    pub rays: &'a [DVec3],
    /// Extrinsics of the camera.
    pub vehicle_from_camera: &'a Pose,
    /// Pose of the vehicle.
    pub local_from_vehicle: &'a Pose,
    /// Distance of the ground plane below the origin of the vehicle frame, m.
    pub below_m: f64,
    /// Standard deviation of the tilt of the ground ahead against that plane, rad.
    pub tilt_noise_rad: f64,
}

/// 201×201 costs around the vehicle, north-up in the local frame.
#[derive(Clone, Debug, PartialEq)]
pub struct CostMap {
    costs: CostGrid,
    /// How far a priori models back the cost of each cell, 0 to 255.
    backings: Vec<u8>,
    /// The model that has most of the colour of the nearest pixel of each cell, or that of a known obstacle; 0 for none.
    models: Vec<u8>,
    /// How much the cost of each cell counts, 0 to 255; 0 where it is unknown.
    worths: Vec<u8>,
}

/// Known obstacles in the image, and what may hide them.
#[derive(Clone, Copy)]
pub struct Standing<'a> {
    /// Their pixels.
    pub known: &'a Known,
    /// Their shape.
    pub shape: Shape,
    /// Obstacles of the map, in the local frame; `None` without a map.
    pub screens: Option<&'a Screens<'a>>,
}

/// The reduced image projected onto the plane, from which maps of any cell size are made.
#[derive(Clone, Debug)]
pub struct Ground<'a> {
    costs: Cow<'a, [u8]>,
    models: &'a [u8],
    place: CameraPlacement<'a>,
    /// Height of the camera above the plane, m.
    above_m: f64,
    points: Vec<Point>,
}

/// Where the ray of a pixel with a cost meets the plane.
#[derive(Clone, Copy, Debug)]
struct Point {
    /// m in the local frame.
    at: DVec2,
    cost: u8,
    backing: u8,
    model: u8,
}

impl<'a> Ground<'a> {
    /// Projects the costs of the reduced image, with the model of each pixel, and with known obstacles.
    pub fn new(
        costs: &'a [u8],
        models: &'a [u8],
        known: Option<&Standing<'_>>,
        place: CameraPlacement<'a>,
    ) -> Ground<'a> {
        let local_from_camera = *place.local_from_vehicle * *place.vehicle_from_camera;
        let up = place.local_from_vehicle.rotate(DVec3::Z);
        let camera = local_from_camera.translation;
        let above_m = (camera - place.local_from_vehicle.translation).dot(up) + place.below_m;
        let turn = local_from_camera.rotation_matrix();
        let up_in_camera = turn.transpose() * up;
        let feet = known.filter(|_| above_m > 0.0).map(|&Standing { known, shape, screens }| {
            // Where the lens model has no ray for a pixel, the ray is zero, and its slope NaN.
            let slope =
                |ray: &DVec3| -ray.dot(up_in_camera) / ray.reject_from_normalized(up_in_camera).length();
            let slopes: Vec<f64> = place.rays.iter().map(slope).collect();
            let Known { pure, blended, posts: of_posts, .. } = known;
            let pixels = Pixels { pure, blended, posts: of_posts, slopes: &slopes };
            let view = View { rays: place.rays, up: up_in_camera, above_m };
            let place = |column: usize, foot: &Foot| camera + turn * view.place(foot.row, column);
            let is_hidden = |column: usize, foot: &Foot| {
                let at = place(column, foot);
                screens.is_some_and(|screens| {
                    screens.hides(camera, at)
                        || screens.towers_over(camera, at, shape.height_m)
                        || screens.shows_ground(camera, at, up, above_m, shape.height_m)
                })
            };
            let seen = |feet: Vec<Option<Foot>>| -> Vec<Option<Foot>> {
                let with_column = feet.into_iter().enumerate();
                with_column.map(|(column, foot)| foot.filter(|foot| !is_hidden(column, foot))).collect()
            };
            let mut feet = seen(feet(&pixels, &shape, above_m));
            if shape.span_m > 0.0 {
                let posts = joined(&seen(posts(&pixels, &shape, above_m)), &view, shape.span_m);
                feet = std::iter::zip(feet, posts).map(|(foot, post)| Foot::lower(foot, post)).collect();
            }
            // One above the horizon has no place on the ground: the line of its ray meets the ground behind the camera.
            let says =
                |column: usize, foot: &Foot| foot.backing > 0 && slopes[foot.row * WIDTH + column] > 0.0;
            let placed = |(column, foot): (usize, &Option<Foot>)| {
                foot.as_ref().filter(|foot| says(column, foot)).map(|foot| place(column, foot))
            };
            let placed = feet.iter().enumerate().filter_map(placed);
            if screens.is_some_and(|screens| screens.nothing_stands(camera, placed)) {
                for (column, slot) in feet.iter_mut().enumerate() {
                    *slot = slot
                        .filter(|foot| !says(column, foot) || !Screens::is_near(camera, place(column, foot)));
                }
            }
            feet
        });
        let feet = feet.unwrap_or_default();
        let mut costs = Cow::Borrowed(costs);
        if feet.iter().any(Option::is_some) {
            stand_upright(costs.to_mut(), &feet);
        }
        let mut points = Vec::with_capacity(costs.len());
        for (at, (&cost, &ray)) in costs.iter().zip(place.rays).enumerate() {
            // Where the lens model has no ray for a pixel, the ray is zero, which does not point down either.
            let down = -ray.dot(up_in_camera);
            if cost != UNKNOWN_COST && above_m > 0.0 && down > 0.0 {
                let foot = feet.get(at % WIDTH).copied().flatten().filter(|foot| foot.row == at / WIDTH);
                let backing = foot.map_or(0, |foot| foot.backing);
                let of_known = known.map(|known| known.known.model).filter(|_| backing > 0);
                let model = of_known.unwrap_or_else(|| models.get(at).copied().unwrap_or(0));
                let at = (camera + turn * ray * (above_m / down)).truncate();
                points.push(Point { at, cost, backing, model });
            }
        }
        Ground { costs, models, place, above_m, points }
    }
}

/// In each column of the reduced image: the foot of a known obstacle has the highest cost, or none if it says nothing, and
/// the pixels above it have none.
fn stand_upright(costs: &mut [u8], feet: &[Option<Foot>]) {
    for (column, foot) in feet.iter().enumerate() {
        let Some(foot) = foot else { continue };
        costs[foot.row * WIDTH + column] = if foot.backing > 0 { MAX_COST } else { UNKNOWN_COST };
        (0..foot.row).for_each(|row| costs[row * WIDTH + column] = UNKNOWN_COST);
    }
}

impl CostMap {
    /// Map with cells of `cell_size_m` (m), known up to `max_range_m` (m) from the vehicle.
    pub fn new(ground: &Ground<'_>, cell_size_m: f64, max_range_m: f64) -> CostMap {
        let vehicle = ground.place.local_from_vehicle.translation.truncate();
        let costs = CostGrid::new(GridFrame::around(vehicle, SIDE, cell_size_m));
        let nothing = || vec![0; SIDE * SIDE];
        let mut map = CostMap { costs, backings: nothing(), models: nothing(), worths: nothing() };
        map.vote(&ground.points, vehicle, max_range_m);
        map.fill(ground, max_range_m);
        map.weigh(ground);
        map
    }

    /// Averages the pixels in each cell; a pixel of a known obstacle decides by itself.
    fn vote(&mut self, points: &[Point], vehicle: DVec2, max_range_m: f64) {
        let mut sums = vec![(0_u32, 0_u32); SIDE * SIDE];
        for &Point { at, cost, backing, model } in points {
            if at.distance_squared(vehicle) > max_range_m * max_range_m {
                continue;
            }
            if let Some(index) = self.costs.slot(at) {
                sums[index].0 += u32::from(cost);
                sums[index].1 += 1;
                // Rows come from the top, so the last pixel is the nearest one.
                if backing >= self.backings[index] {
                    (self.backings[index], self.models[index]) = (backing, model);
                }
            }
        }
        let cells = self.costs.costs_mut().iter_mut().zip(&self.backings);
        for ((cell, &backing), (sum, count)) in cells.zip(sums) {
            if let Some(mean) = (sum + count / 2).checked_div(count) {
                *cell = if backing > 0 { MAX_COST } else { mean as u8 };
            }
        }
    }

    /// Fills cells without a pixel of their own with the cost of the pixel that sees their centre.
    fn fill(&mut self, ground: &Ground<'_>, max_range_m: f64) {
        let place = &ground.place;
        let local_from_camera = *place.local_from_vehicle * *place.vehicle_from_camera;
        let camera_from_local = local_from_camera.inverse();
        let (turn, shift) = (camera_from_local.rotation_matrix(), camera_from_local.translation);
        let plane = plane_height(place.local_from_vehicle, place.below_m);
        let vehicle = place.local_from_vehicle.translation.truncate();
        let frame = *self.costs.frame();
        let reach = (max_range_m / frame.cell_size_m).ceil() as usize + 1;
        let middle = SIDE / 2;
        let side = middle.saturating_sub(reach)..(middle + reach + 1).min(SIDE);
        for row in side.clone() {
            for column in side.clone() {
                let slot = row * SIDE + column;
                let cell = &mut self.costs.costs_mut()[slot];
                let point = frame.middle(column, row);
                if *cell != UNKNOWN_COST || point.distance_squared(vehicle) > max_range_m * max_range_m {
                    continue;
                }
                let Some(z) = plane(point) else { continue };
                let pixel = place.camera.project(turn * point.extend(z) + shift);
                if let Some(pixel) = pixel.filter(|&pixel| place.camera.contains(pixel)) {
                    let of = |v: f64, parts: usize, side: u32| {
                        (((v + 0.5) * parts as f64 / f64::from(side)) as usize).min(parts - 1)
                    };
                    let (u, v) =
                        (of(pixel.x, WIDTH, place.camera.width), of(pixel.y, HEIGHT, place.camera.height));
                    *cell = ground.costs[v * WIDTH + u];
                    self.models[slot] = ground.models.get(v * WIDTH + u).copied().unwrap_or(0);
                }
            }
        }
    }

    /// Says how much each known cost counts.
    fn weigh(&mut self, ground: &Ground<'_>) {
        let place = &ground.place;
        let camera = (*place.local_from_vehicle * place.vehicle_from_camera.translation).truncate();
        let pixel_rad = f64::from(place.camera.height) / HEIGHT as f64 / place.camera.fy;
        let noise = PlaneNoise::new(ground.above_m, pixel_rad, place.tilt_noise_rad);
        let frame = *self.costs.frame();
        for (slot, value) in self.worths.iter_mut().enumerate() {
            if self.costs.costs()[slot] != UNKNOWN_COST {
                let distance_m = frame.middle(slot % SIDE, slot / SIDE).distance(camera);
                *value = worth(1.0, noise.at_m(distance_m), frame.cell_size_m);
            }
        }
    }

    /// Cost of the cell that contains a position of the local frame (m); 255 where unknown or outside of the map.
    pub fn at(&self, place: DVec2) -> u8 {
        self.costs.at(place).unwrap_or(UNKNOWN_COST)
    }

    /// Number of cells with a cost, and number of those that are obstacles.
    pub fn known(&self) -> [u32; 2] {
        [0, OBSTACLE_COST].map(|from| self.costs.count_from(from) as u32)
    }

    /// The message with the fields `cost.color` (u8, 0 to 250, 255 unknown), `worth.color`, `backing.color` and
    /// `model.color` (u8).
    pub fn to_grid(&self, frame_id: &str, time: Stamp) -> Grid {
        let cell = |(slot, &cost)| [cost, self.worths[slot], self.backings[slot], self.models[slot]];
        let data = self.costs.costs().iter().enumerate().flat_map(cell).collect();
        let names = ["cost", "worth", "backing", "model"];
        self.costs.frame().message_of_bytes(Source::COLOR, &names, data, frame_id, time)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::PIXELS;
    use crate::region::rays;
    use rcs_geom::Distortion;
    use rcs_msg::foxglove::packed_element_field::NumericType;

    /// A camera 1 m above the ground, pitched 20 degrees down.
    fn check(local_from_vehicle: Pose, paint: impl Fn(DVec3) -> u8) -> CostMap {
        check_known(local_from_vehicle, paint, |_| 0, None)
    }

    /// The same with known obstacles, by the place where a ray meets the ground, and what hides them.
    fn check_known(
        local_from_vehicle: Pose,
        paint: impl Fn(DVec3) -> u8,
        known: impl Fn(DVec3) -> u8,
        screens: Option<&Screens<'_>>,
    ) -> CostMap {
        check_sky(local_from_vehicle, paint, known, |_| 0, screens)
    }

    /// The same with what has the colour of a known obstacle above the horizon, by the direction of a ray.
    fn check_sky(
        local_from_vehicle: Pose,
        paint: impl Fn(DVec3) -> u8,
        known: impl Fn(DVec3) -> u8,
        sky: impl Fn(DVec3) -> u8,
        screens: Option<&Screens<'_>>,
    ) -> CostMap {
        let camera =
            PinholeCamera::new([320, 240], [200.0, 200.0], [160.0, 120.0], Distortion::None).unwrap();
        let mount = Pose::from_rpy(DVec3::new(0.0, 0.0, 1.0), 0.0, 20_f64.to_radians(), 0.0)
            * Pose::body_from_optical();
        let rays = rays(&camera);
        let costs: Vec<u8> = rays
            .iter()
            .map(|&ray| {
                let direction = mount.rotate(ray);
                if direction.z >= 0.0 {
                    250
                } else {
                    paint(mount.translation + direction * (-1.0 / direction.z))
                }
            })
            .collect();
        assert_eq!(costs.len(), PIXELS);
        let at = |ray: DVec3| {
            let direction = mount.rotate(ray);
            (direction.z < 0.0).then(|| mount.translation + direction * (-1.0 / direction.z))
        };
        let known: Vec<u8> =
            rays.iter().map(|&ray| at(ray).map_or_else(|| sky(mount.rotate(ray)), &known)).collect();
        let place = CameraPlacement {
            camera: &camera,
            rays: &rays,
            vehicle_from_camera: &mount,
            local_from_vehicle: &local_from_vehicle,
            below_m: 0.0,
            tilt_noise_rad: 0.0,
        };
        let known = Known { blended: known.clone(), posts: vec![0; PIXELS], pure: known, model: 9 };
        let shape = Shape { height_m: 0.95, least_share: 0.6, span_m: 2.5 };
        let known = Standing { known: &known, shape, screens };
        let models: Vec<u8> = costs.iter().map(|&cost| if cost < 100 { 1 } else { 2 }).collect();
        CostMap::new(&Ground::new(&costs, &models, Some(&known), place), 0.2, 10.0)
    }

    #[test]
    fn a_stripe_ahead_of_the_vehicle_lands_where_it_is() {
        for pose in [Pose::IDENTITY, Pose::from_xy_yaw(103.3, -57.1, 2.0)] {
            let map = check(pose, |p| if p.y.abs() < 1.0 { 0 } else { 250 });
            let at = |x: f64, y: f64| map.at((pose * DVec3::new(x, y, 0.0)).truncate());
            for x in [1.6, 3.0, 5.0, 8.0, 9.5] {
                assert_eq!((at(x, 0.0), at(x, 0.5), at(x, -0.5)), (0, 0, 0), "on the path at {x}");
            }
            for x in [3.0, 5.0, 8.0, 9.5] {
                assert_eq!((at(x, 1.5), at(x, -1.5)), (250, 250), "beside the path at {x}");
            }
            assert_eq!((at(-2.0, 0.0), at(10.5, 0.0), at(3.0, 6.0)), (255, 255, 255), "not seen or too far");
        }
    }

    #[test]
    fn a_known_obstacle_stands_where_its_lowest_pixel_is_and_hides_what_is_behind() {
        // Its pixels reach from the ground at 4 m up to where rays meet the ground at 7 m.
        let is_fence = |p: DVec3| if (4.0..7.0).contains(&p.x) && p.y.abs() < 1.0 { 200 } else { 0 };
        let map = check_known(Pose::IDENTITY, |_| 40, is_fence, None);
        let at = |x: f64, y: f64| {
            let slot = map.costs.slot(DVec2::new(x, y)).unwrap();
            (map.costs.costs()[slot], map.backings[slot], map.models[slot])
        };
        assert_eq!([at(4.1, 0.1), at(4.1, -0.5)], [(250, 200, 9); 2]);
        assert_eq!([at(3.5, 0.1), at(4.1, 1.7)], [(40, 0, 1); 2]);
        assert_eq!([at(5.3, 0.1), at(8.0, 0.1)].map(|(cost, backing, _)| (cost, backing)), [(255, 0); 2]);
    }

    #[test]
    fn a_foot_that_says_nothing_has_no_cost_and_hides_what_is_behind() {
        let mut costs = vec![40; PIXELS];
        let mut feet = vec![None; WIDTH];
        feet[3] = Some(Foot { row: 50, backing: 0 });
        feet[4] = Some(Foot { row: 50, backing: 200 });
        stand_upright(&mut costs, &feet);
        let column = |column: usize| [30, 50, 51].map(|row| costs[row * WIDTH + column]);
        assert_eq!(column(3), [UNKNOWN_COST, UNKNOWN_COST, 40]);
        assert_eq!([column(4), column(5)], [[UNKNOWN_COST, MAX_COST, 40], [40; 3]]);
    }

    #[test]
    fn what_seems_to_stand_behind_a_wall_is_none() {
        // A patch of the wall at 3 m whose pixels meet the ground from 6 m on.
        let is_fence = |p: DVec3| if (6.0..9.0).contains(&p.x) && p.y.abs() < 1.0 { 200 } else { 0 };
        let wall = crate::hidden::tests::wall(1.5, Source::STEREO);
        let view = rcs_world::GridView::new(&wall).unwrap();
        let screens = Screens::of(&view).unwrap();
        let backed = |screens| {
            let map = check_known(Pose::IDENTITY, |_| 40, is_fence, screens);
            map.backings.iter().filter(|backing| **backing > 0).count()
        };
        assert!(backed(None) >= 4);
        assert_eq!(backed(Some(&screens)), 0);
    }

    #[test]
    fn what_is_near_and_has_no_shape_is_soil() {
        let is_fence = |p: DVec3| if (4.0..7.0).contains(&p.x) && p.y.abs() < 1.0 { 200 } else { 0 };
        let backed = |height_m: Option<f32>| {
            let grid = crate::hidden::tests::ground(height_m);
            let view = rcs_world::GridView::new(&grid).unwrap();
            let map = check_known(Pose::IDENTITY, |_| 40, is_fence, Screens::of(&view).as_ref());
            map.backings.iter().filter(|backing| **backing > 0).count()
        };
        assert!(backed(Some(1.0)) >= 4);
        assert_eq!(backed(None), 0);
    }

    #[test]
    fn what_is_above_the_horizon_is_no_soil_nearby() {
        let is_fence = |p: DVec3| if (4.0..7.0).contains(&p.x) && p.y.abs() < 0.1 { 200 } else { 0 };
        // Behind the camera, the lines of these rays meet the ground within 6.7 m.
        let is_high = |ray: DVec3| if ray.z > 0.15 * ray.truncate().length() { 200 } else { 0 };
        let grid = crate::hidden::tests::ground(Some(1.0));
        let view = rcs_world::GridView::new(&grid).unwrap();
        let screens = Screens::of(&view);
        let backed = |sky: &dyn Fn(DVec3) -> u8| {
            let map = check_sky(Pose::IDENTITY, |_| 40, is_fence, sky, screens.as_ref());
            map.backings.iter().filter(|backing| **backing > 0).count()
        };
        let fence = backed(&|_| 0);
        assert!(fence > 0);
        assert_eq!(backed(&is_high), fence);
    }

    #[test]
    fn every_cell_in_view_has_a_cost_though_pixels_are_sparse_far_away() {
        let map = check(Pose::IDENTITY, |_| 40);
        let cells =
            (8..45).flat_map(|x| (-20..20).map(move |y| (f64::from(x) * 0.2, f64::from(y) * 0.2 + 0.1)));
        for (x, y) in cells.filter(|(x, y)| y.abs() < 0.6 * x && x * x + y * y < 90.0) {
            assert_eq!(map.at(DVec2::new(x, y)), 40, "({x}, {y})");
        }
    }

    #[test]
    fn pixels_without_a_vote_leave_cells_unknown() {
        let map = check(Pose::IDENTITY, |p| if p.x > 4.0 { UNKNOWN_COST } else { 10 });
        assert_eq!((map.at(DVec2::new(3.0, 0.0)), map.at(DVec2::new(6.0, 0.0))), (10, UNKNOWN_COST));
    }

    #[test]
    fn the_plane_tilts_with_the_vehicle() {
        // On a slope of 10 degrees the plane rises ahead of the vehicle, so the same pixels meet it nearer in the map.
        let up = Pose::from_rpy(DVec3::ZERO, 0.0, -10_f64.to_radians(), 0.0);
        let map = check(up, |p| if p.x < 5.0 { 0 } else { 250 });
        let edge = 5.0 * libm::cos(10_f64.to_radians());
        assert_eq!(map.at(DVec2::new(edge - 0.3, 0.1)), 0);
        assert_eq!(map.at(DVec2::new(edge + 0.3, 0.1)), 250);
    }

    #[test]
    fn the_message_is_a_map_that_the_world_model_takes() {
        let map = check(Pose::IDENTITY, |_| 40);
        let known = map.known();
        let grid = map.to_grid("local", Stamp(7));
        let view = rcs_world::GridView::new(&grid).unwrap();
        let costs = view.field_of("cost.color", NumericType::Uint8).unwrap();
        assert_eq!((view.columns(), view.rows()), (SIDE, SIDE));
        assert_eq!(costs.values().filter(|cost| *cost == 40.0).count() as u32, known[0]);
        assert_eq!(known[1], 0);
        // The camera sees the ground ahead, and a pixel covers more of it the farther it is.
        let worths = view.field_of("worth.color", NumericType::Uint8).unwrap();
        let ahead =
            [1.6, 3.0, 5.0, 8.0].map(|x| worths.get(SIDE / 2 + (x / 0.2) as usize, SIDE / 2).unwrap());
        assert!(ahead.is_sorted_by(|near, far| near > far) && ahead[0] > 240.0, "{ahead:?}");
        assert!(
            std::iter::zip(worths.values(), costs.values())
                .all(|(worth, cost)| (worth > 0.0) == (cost <= 250.0))
        );
    }
}
