//! The posts of a fence, and what is between them.
//!
//! Where the ground has a colour like the blends of a mesh and the ground, as dry grass has with a mesh in the shade, the
//! mesh is not recognised ([`crate::upright`]). The posts that carry it are: they are not seen through, and light reaches
//! one side of them. So pixels count that have the obstacle's colour in full light, or a blend in which it covers more
//! than in those of a mesh. They go up from a foot to the height of the obstacle, and may lean, as the lens draws them. What
//! is as wide as a mound of soil is none.
//! Two posts that are close enough carry a mesh, so in the columns between them the foot lies on the line from one to
//! the other.

use crate::image::{HEIGHT, WIDTH};
use crate::upright::{BELOW_ROWS, Foot, KNOWN, LEAST_ROWS, Pixels, Shape, share};
use glam::DVec3;

/// Least share of a pixel that a post covers where it shows. With 0.25, trunks of a thicket are posts.
pub const LEAST_COVER: f64 = 0.35;
/// What is wider than this is no post but ground of a like colour, or the mesh, which has rules of its own, m.
const MOST_WIDE_M: f64 = 0.3;
/// Pixels like the post in the rows below its foot, in its column and those beside it.
const MOST_BELOW: usize = 1;

/// The camera above the ground plane.
#[derive(Clone, Copy, Debug)]
pub struct View<'a> {
    /// Rays of the pixels of the reduced image in row order, in the frame of the camera; zero where there is none.
    pub rays: &'a [DVec3],
    /// Normal of the ground plane in this frame, away from the ground.
    pub up: DVec3,
    /// Height of the camera above the plane, m.
    pub above_m: f64,
}

impl View<'_> {
    /// Place on the ground that a pixel shows, m in the frame of the camera.
    pub(crate) fn place(&self, row: usize, column: usize) -> DVec3 {
        let ray = self.rays[row * WIDTH + column];
        ray * (self.above_m / -ray.dot(self.up))
    }

    /// The first row from below in which a column shows the ground on a line between two places, or beyond it.
    fn row_of_line(&self, ends: [DVec3; 2], column: usize) -> Option<usize> {
        // The line and the camera lie in one plane. What the camera sees vertically below it is on the near side.
        let normal = ends[0].cross(ends[1]);
        let near = -self.up.dot(normal);
        let is_beyond = |row: &usize| {
            let ray = self.rays[row * WIDTH + column];
            ray.dot(self.up) < 0.0 && ray.dot(normal) * near <= 0.0
        };
        (0..HEIGHT).rev().find(is_beyond)
    }
}

/// The feet of posts in the columns of the reduced image.
pub fn posts(pixels: &Pixels<'_>, shape: &Shape, camera_m: f64) -> Vec<Option<Foot>> {
    let top = shape.top(camera_m);
    let is_post = |row: usize, column: usize| {
        pixels.posts[row * WIDTH + column].max(pixels.pure[row * WIDTH + column]) >= KNOWN
    };
    let beside = |column: usize| column.saturating_sub(1)..=(column + 1).min(WIDTH - 1);
    let foot = |column: usize| {
        let slope = |row: usize| pixels.slopes[row * WIDTH + column];
        let ends_at = |row: usize| {
            let below = (row + 1..=row + BELOW_ROWS)
                .flat_map(|row| beside(column).map(move |column| (row, column)))
                .filter(|&(row, column)| is_post(row, column));
            is_post(row, column) && slope(row) > 0.0 && below.count() <= MOST_BELOW
        };
        (LEAST_ROWS..HEIGHT - BELOW_ROWS).rev().filter(|&row| ends_at(row)).find_map(|row| {
            let mut leans = column;
            let share = share(row, top, slope, |row| {
                let next = std::iter::once(leans).chain(beside(leans)).find(|&column| is_post(row, column));
                leans = next.unwrap_or(leans);
                next.is_some()
            })?;
            let foot = || Foot::of(row, share).doubted_nearby(slope(row), camera_m);
            (share >= shape.least_share).then(foot)
        })
    };
    (0..WIDTH).map(foot).collect()
}

/// The feet of posts, and between any two that stand at most `span_m` apart the line from one to the other; where
/// several lines cross a column, the nearest. Adjacent columns are one post, unless that is too wide.
pub fn joined(posts: &[Option<Foot>], view: &View<'_>, span_m: f64) -> Vec<Option<Foot>> {
    let posts = narrow(posts, view);
    let mut feet = posts.clone();
    let place = |column: usize, foot: Foot| (column, foot, view.place(foot.row, column));
    let ends = |is_end: &dyn Fn(usize) -> bool| -> Vec<(usize, Foot, DVec3)> {
        let standing = (0..WIDTH).filter_map(|column| posts[column].map(|foot| place(column, foot)));
        standing.filter(|&(column, _, _)| is_end(column)).collect()
    };
    let is_none = |column: usize| posts.get(column).copied().flatten().is_none();
    let rights = ends(&|column| column == 0 || is_none(column - 1));
    for (left, left_foot, left_place) in ends(&|column| is_none(column + 1)) {
        for &(right, right_foot, right_place) in rights.iter().filter(|&&(right, _, _)| right > left) {
            if left_place.distance_squared(right_place) > span_m * span_m {
                continue;
            }
            let backing = left_foot.backing.min(right_foot.backing);
            for (column, between) in feet.iter_mut().enumerate().take(right).skip(left + 1) {
                if let Some(row) = view.row_of_line([left_place, right_place], column) {
                    *between = Foot::lower(*between, Some(Foot { row, backing }));
                }
            }
        }
    }
    feet
}

/// The feet without those of adjacent columns that are together wider than a post.
fn narrow(posts: &[Option<Foot>], view: &View<'_>) -> Vec<Option<Foot>> {
    let mut narrow = posts.to_vec();
    let mut first = 0;
    for run in posts.chunk_by(|a, b| a.is_some() == b.is_some()) {
        let columns = first..first + run.len();
        first = columns.end;
        let [Some(left), .., Some(right)] = *run else { continue };
        let ends = [(columns.start, left), (columns.end - 1, right)];
        let [left, right] = ends.map(|(column, foot)| view.place(foot.row, column));
        if left.distance_squared(right) > MOST_WIDE_M * MOST_WIDE_M {
            narrow[columns].fill(None);
        }
    }
    narrow
}

#[cfg(test)]
mod tests {
    use super::*;

    const SHAPE: Shape = Shape { height_m: 1.0, least_share: 0.6, span_m: 2.5 };
    const ABOVE_M: f64 = 1.0;
    /// Focal length of the reduced image, px, and the row of the horizon.
    const FOCAL_PX: f64 = 90.0;
    const LEVEL: f64 = 26.5;
    const UP: DVec3 = DVec3::NEG_Y;

    fn rays() -> Vec<DVec3> {
        let ray = |at: usize| {
            let (right, down) =
                ((at % WIDTH) as f64 + 0.5 - WIDTH as f64 / 2.0, (at / WIDTH) as f64 + 0.5 - LEVEL);
            DVec3::new(right / FOCAL_PX, down / FOCAL_PX, 1.0).normalize()
        };
        (0..HEIGHT * WIDTH).map(ray).collect()
    }

    /// Row and column of a place on the ground, m to the right and ahead.
    fn pixel([right_m, ahead_m]: [f64; 2]) -> [f64; 2] {
        [LEVEL + FOCAL_PX * ABOVE_M / ahead_m, WIDTH as f64 / 2.0 + FOCAL_PX * right_m / ahead_m]
    }

    /// The feet of posts at these places, and of what is between them.
    fn fence(places: &[[f64; 2]], span_m: f64) -> Vec<Option<Foot>> {
        let rays = rays();
        let mut posts = vec![None; WIDTH];
        for [row, column] in places.iter().map(|&place| pixel(place)) {
            posts[column as usize] = Some(Foot { row: row as usize, backing: 200 });
        }
        joined(&posts, &View { rays: &rays, up: UP, above_m: ABOVE_M }, span_m)
    }

    /// The feet of posts where these pixels are like them, by row and column, and whether they say anything.
    fn painted(is_post: impl Fn(usize, usize) -> bool) -> Vec<(usize, usize, bool)> {
        let rays = rays();
        let slopes: Vec<f64> =
            rays.iter().map(|ray| ray.y / ray.reject_from_normalized(UP).length()).collect();
        let like: Vec<u8> =
            (0..rays.len()).map(|at| if is_post(at / WIDTH, at % WIDTH) { 200 } else { 0 }).collect();
        let none = vec![0; rays.len()];
        let pixels = Pixels { pure: &none, blended: &none, posts: &like, slopes: &slopes };
        let feet = posts(&pixels, &SHAPE, ABOVE_M);
        let place =
            |(column, foot): (usize, &Option<Foot>)| foot.map(|foot| (foot.row, column, foot.backing > 0));
        feet.iter().enumerate().filter_map(place).collect()
    }

    #[test]
    fn between_two_posts_the_foot_lies_on_the_line_from_one_to_the_other() {
        let ends = [[-1.0, 4.0], [1.0, 5.0]];
        let feet = fence(&ends, 2.5);
        let [left, right] = ends.map(|end| pixel(end)[1] as usize);
        for (column, foot) in feet.iter().enumerate() {
            assert_eq!(foot.is_some(), (left..=right).contains(&column), "column {column}");
            let Some(foot) = foot else { continue };
            // Where the column crosses the line: right = bearing · ahead, and both are linear along it.
            let bearing = (column as f64 + 0.5 - WIDTH as f64 / 2.0) / FOCAL_PX;
            let along = (bearing * 4.0 + 1.0) / (2.0 - bearing);
            let [row, _] = pixel([-1.0 + 2.0 * along, 4.0 + along]);
            assert!(
                (foot.row as f64 + 0.5 - row).abs() <= 1.0,
                "column {column}: row {} instead of {row}",
                foot.row
            );
        }
        assert_eq!(fence(&ends, 2.0).iter().flatten().count(), 2, "too far apart");
    }

    #[test]
    fn of_two_fences_the_nearer_counts() {
        let feet = fence(&[[-1.2, 4.0], [-1.0, 8.0], [0.0, 8.0], [1.0, 4.0]], 2.5);
        let near = pixel([0.0, 4.0])[0] as usize;
        let [left, right] = [[-1.2, 4.0], [1.0, 4.0]].map(|end| pixel(end)[1] as usize);
        assert!(
            feet[left..=right].iter().all(|foot| foot.is_some_and(|foot| foot.row.abs_diff(near) <= 1)),
            "{feet:?}"
        );
    }

    #[test]
    fn what_is_wider_than_a_post_is_none() {
        let rays = rays();
        let view = View { rays: &rays, up: UP, above_m: ABOVE_M };
        // In row 50 the ground is 3.75 m away, and a column 0.042 m wide.
        for (columns, is_post) in [(1, true), (7, true), (10, false), (40, false)] {
            let mut posts = vec![None; WIDTH];
            posts[40..40 + columns].fill(Some(Foot { row: 50, backing: 200 }));
            let expected = if is_post { posts.clone() } else { vec![None; WIDTH] };
            assert_eq!(joined(&posts, &view, 2.5), expected, "{columns} columns");
        }
    }

    #[test]
    fn a_post_that_leans_has_one_foot() {
        assert_eq!(
            painted(|row, column| (24..60).contains(&row) && column == 60 + row / 12),
            [(59, 64, true)]
        );
    }

    #[test]
    fn a_post_nearby_says_nothing() {
        // At 2.1 m, and at 2.6 m.
        for (end, says) in [(70, false), (61, true)] {
            let feet = painted(|row, column| (24..end).contains(&row) && column == 60);
            assert_eq!(feet, [(end - 1, 60, says)]);
        }
    }

    #[test]
    fn what_ends_below_the_height_of_a_fence_is_no_post() {
        assert_eq!(painted(|row, column| (40..60).contains(&row) && column == 60), []);
    }
}
