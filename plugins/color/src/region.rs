//! Regions of the image in which ground and background are sampled (Albus 2006a, 3.1.2): the trapezoid of a rectangle
//! on the ground ahead of the vehicle, and the part of the image above the horizon or slightly below it. Both use the
//! plane under the vehicle.

use crate::histogram::Span;
use crate::image::{HEIGHT, WIDTH};
use glam::{DVec2, DVec3};
use rcs_geom::{PinholeCamera, Pose};

/// A rectangle on the ground ahead of the vehicle, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rectangle {
    /// Distance of its near edge from the origin of the vehicle frame.
    pub ahead_m: f64,
    /// Extent along x.
    pub length_m: f64,
    /// Extent along y, centred on the x axis.
    pub width_m: f64,
    /// Distance of the ground below the origin of the vehicle frame.
    pub below_m: f64,
}

/// Each edge of the rectangle is divided into this many parts, because a lens bends straight lines.
const EDGE_PARTS: usize = 8;
/// Points nearer to the camera's plane are not projected, m.
const NEAR_M: f64 = 0.05;

impl Rectangle {
    /// Outline of the rectangle in the image, pixels, clipped at the camera's plane but not at the image borders. Empty
    /// where the camera does not see it.
    pub fn outline(&self, camera: &PinholeCamera, vehicle_from_camera: &Pose) -> Vec<DVec2> {
        let (near, far, side) = (self.ahead_m, self.ahead_m + self.length_m, 0.5 * self.width_m);
        let camera_from_vehicle = vehicle_from_camera.inverse();
        let corners = [(near, side), (far, side), (far, -side), (near, -side)]
            .map(|(x, y)| camera_from_vehicle * DVec3::new(x, y, -self.below_m));
        let seen = clip(&corners);
        let edges = seen.iter().zip(seen.iter().cycle().skip(1));
        let points = edges.flat_map(|(&from, &to)| {
            (0..EDGE_PARTS).map(move |i| from.lerp(to, i as f64 / EDGE_PARTS as f64))
        });
        let outline: Vec<DVec2> = points.filter_map(|point| camera.project(point)).collect();
        if outline.len() < 3 { Vec::new() } else { outline }
    }
}

/// The part of a polygon in front of the camera (Sutherland-Hodgman clipping).
fn clip(polygon: &[DVec3]) -> Vec<DVec3> {
    let mut clipped = Vec::with_capacity(polygon.len() + 1);
    for (i, &to) in polygon.iter().enumerate() {
        let from = polygon[(i + polygon.len() - 1) % polygon.len()];
        if (from.z >= NEAR_M) != (to.z >= NEAR_M) {
            clipped.push(from.lerp(to, (NEAR_M - from.z) / (to.z - from.z)));
        }
        if to.z >= NEAR_M {
            clipped.push(to);
        }
    }
    clipped
}

/// Pixels whose centres lie within an outline (pixels, centres at whole numbers), row by row, clipped to the image.
pub fn spans(outline: &[DVec2], [width, height]: [usize; 2]) -> Vec<Span> {
    let mut spans = Vec::new();
    if outline.len() < 3 || !outline.iter().all(|point| point.is_finite()) {
        return spans;
    }
    let (top, bottom) = outline.iter().fold((f64::MAX, f64::MIN), |(a, b), p| (a.min(p.y), b.max(p.y)));
    let rows =
        top.ceil().max(0.0) as usize..(bottom.floor().min(height as f64 - 1.0) + 1.0).max(0.0) as usize;
    let mut crossings = Vec::new();
    for row in rows {
        let y = row as f64;
        crossings.clear();
        for (a, b) in outline.iter().zip(outline.iter().cycle().skip(1)) {
            // Half-open interval, so that a vertex on the row counts once.
            if (a.y <= y) != (b.y <= y) {
                crossings.push(a.x + (y - a.y) / (b.y - a.y) * (b.x - a.x));
            }
        }
        crossings.sort_by(f64::total_cmp);
        for pair in crossings.as_chunks::<2>().0 {
            let start = pair[0].ceil().clamp(0.0, width as f64) as u32;
            let end = (pair[1].floor() + 1.0).clamp(0.0, width as f64) as u32;
            if start < end {
                spans.push(Span { row: row as u32, start, end });
            }
        }
    }
    spans
}

/// Whether a pixel is in one of the spans, which are sorted by row.
pub fn contains(spans: &[Span], pixel: DVec2) -> bool {
    if !pixel.is_finite() || pixel.x < -0.5 || pixel.y < -0.5 {
        return false;
    }
    let (column, row) = ((pixel.x + 0.5) as u32, (pixel.y + 0.5) as u32);
    let first = spans.partition_point(|span| span.row < row);
    spans[first..]
        .iter()
        .take_while(|span| span.row == row)
        .any(|span| (span.start..span.end).contains(&column))
}

/// Rays of the pixels of the reduced image in the optical frame of the camera, in row order; zero where the lens model
/// has no ray.
pub fn rays(camera: &PinholeCamera) -> Vec<DVec3> {
    let scale = DVec2::new(f64::from(camera.width) / WIDTH as f64, f64::from(camera.height) / HEIGHT as f64);
    let centre = |x: usize, y: usize| (DVec2::new(x as f64, y as f64) + 0.5) * scale - 0.5;
    let pixels = (0..HEIGHT).flat_map(|y| (0..WIDTH).map(move |x| (x, y)));
    pixels.map(|(x, y)| camera.unproject(centre(x, y)).unwrap_or(DVec3::ZERO)).collect()
}

/// For each column of the reduced image, the number of rows from the top of the full image (`height` rows) from which
/// the first background is sampled: the rows above the horizon, and `below_px` rows below it. The horizon is that of
/// the ground plane: the lowest pixel of the column whose ray does not descend to the plane.
pub fn first_background(
    rays: &[DVec3],
    vehicle_from_camera: &Pose,
    height: usize,
    below_px: u32,
) -> Vec<u32> {
    // Height of a direction above the plane, without rotating the whole vector.
    let up = vehicle_from_camera.inverse().rotate(DVec3::Z);
    (0..WIDTH)
        .map(|column| {
            let above = |row: &usize| {
                let ray = rays[row * WIDTH + column];
                ray != DVec3::ZERO && ray.dot(up) >= 0.0
            };
            match (0..HEIGHT).rev().find(above) {
                Some(row) => {
                    (((row + 1) * height / HEIGHT) as u32).saturating_add(below_px).min(height as u32)
                }
                None => 0,
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use rcs_geom::Distortion;

    fn camera(distortion: Distortion) -> PinholeCamera {
        PinholeCamera::new([320, 240], [200.0, 200.0], [160.0, 120.0], distortion).unwrap()
    }

    fn mount(height_m: f64, pitch_deg: f64, yaw_deg: f64) -> Pose {
        let position = DVec3::new(0.2, 0.0, height_m);
        Pose::from_rpy(position, 0.0, pitch_deg.to_radians(), yaw_deg.to_radians())
            * Pose::body_from_optical()
    }

    const RECTANGLE: Rectangle = Rectangle { ahead_m: 0.6, length_m: 2.0, width_m: 1.0, below_m: 0.0 };

    /// Reference implementation: intersects the ray of every pixel with the plane.
    fn reference_count(camera: &PinholeCamera, vehicle_from_camera: &Pose, rectangle: &Rectangle) -> u32 {
        let mut count = 0;
        for v in 0..camera.height {
            for u in 0..camera.width {
                let Some(ray) = camera.unproject(DVec2::new(f64::from(u), f64::from(v))) else { continue };
                let direction = vehicle_from_camera.rotate(ray);
                let origin = vehicle_from_camera.translation;
                let t = (-rectangle.below_m - origin.z) / direction.z;
                let p = origin + direction * t;
                let ahead = p.x - rectangle.ahead_m;
                if t > 0.0
                    && (0.0..=rectangle.length_m).contains(&ahead)
                    && p.y.abs() <= 0.5 * rectangle.width_m
                {
                    count += 1;
                }
            }
        }
        count
    }

    #[test]
    fn the_trapezoid_holds_the_pixels_whose_rays_meet_the_rectangle() {
        let barrel = Distortion::from_model("plumb_bob", &[-0.2, 0.03, 0.0, 0.0, 0.0]).unwrap();
        for lens in [Distortion::None, barrel] {
            for (height, pitch, yaw) in
                [(1.0, 20.0, 0.0), (1.0, 35.0, 15.0), (0.6, 10.0, -20.0), (1.5, 60.0, 0.0)]
            {
                let (camera, mount) = (camera(lens), mount(height, pitch, yaw));
                let spans = spans(&RECTANGLE.outline(&camera, &mount), [320, 240]);
                let got: u32 = spans.iter().map(Span::pixels).sum();
                let expected = reference_count(&camera, &mount, &RECTANGLE);
                // Pixels on the outline may fall on either side, and the lens bends straight edges.
                let tolerance = 0.02 * f64::from(expected) + 8.0;
                assert!(
                    (f64::from(got) - f64::from(expected)).abs() <= tolerance,
                    "{got} {expected} at pitch {pitch}, yaw {yaw}"
                );
            }
        }
    }

    #[test]
    fn a_rectangle_that_is_not_seen_has_no_outline() {
        let backwards = mount(1.0, 0.0, 180.0);
        assert!(RECTANGLE.outline(&camera(Distortion::None), &backwards).is_empty());
        let up = spans(&RECTANGLE.outline(&camera(Distortion::None), &mount(1.0, -50.0, 0.0)), [320, 240]);
        assert!(up.is_empty(), "{up:?}");
    }

    proptest! {
        #[test]
        fn spans_hold_the_pixels_within_any_polygon(
            points in prop::collection::vec((-20.0..60.0_f64, -20.0..50.0_f64), 3..9),
        ) {
            let outline: Vec<DVec2> = points.iter().map(|&(x, y)| DVec2::new(x, y)).collect();
            let spans = spans(&outline, [40, 30]);
            for v in 0..30 {
                for u in 0..40 {
                    let pixel = DVec2::new(f64::from(u), f64::from(v));
                    // Even-odd rule with a ray to the left.
                    let mut crossings: Vec<f64> = Vec::new();
                    for (i, a) in outline.iter().enumerate() {
                        let b = outline[(i + 1) % outline.len()];
                        if (a.y <= pixel.y) != (b.y <= pixel.y) {
                            crossings.push(a.x + (pixel.y - a.y) / (b.y - a.y) * (b.x - a.x));
                        }
                    }
                    // Pixels on the border may count either way.
                    if crossings.iter().all(|x| (x - pixel.x).abs() > 1e-9) {
                        let inside = crossings.iter().filter(|x| **x < pixel.x).count() % 2 == 1;
                        prop_assert_eq!(contains(&spans, pixel), inside, "{} in {:?}", pixel, outline);
                    }
                }
            }
        }
    }

    #[test]
    fn first_background_reaches_to_50_px_below_the_horizon() {
        let camera = camera(Distortion::None);
        let limits = |pitch: f64, below: u32| {
            let rows = first_background(&rays(&camera), &mount(1.0, pitch, 0.0), 240, below);
            assert!(rows.iter().all(|&row| row == rows[0]), "a level camera has a level horizon");
            rows[0]
        };
        // Level: the horizon is row 120, and the reduced row 47 (pixels 117.5 to 120) ends there.
        assert_eq!((limits(0.0, 0), limits(0.0, 50)), (120, 170));
        // 20 degrees down: 200·tan 20° = 72.8 px above the middle, rounded to 2.5 px.
        let row = f64::from(limits(20.0, 0));
        assert!((row - (120.0 - 72.8)).abs() <= 2.5, "{row}");
        assert_eq!(limits(60.0, 50), 0, "looking down there is no horizon");
        assert_eq!(limits(-60.0, 50), 240);
    }
}
