//! Where known obstacles stand.
//!
//! A known obstacle (an a priori model) stands upright on the ground. So in each column of the image its lowest pixel,
//! its foot, says where it is. Two rules find it; the lower foot of both counts.
//!
//! - By height: pixels of the obstacle's colour or of a blend with the ground behind it ([`crate::mesh`]) go on from the
//!   foot to the height of the obstacle, or to the horizon. Ground of a like colour, such as soil, ends below it. Below
//!   the foot there is something else.
//! - By colour: the lowest pixel that has the obstacle's own colour, and pixels of blends below it. Near the vehicle a
//!   pixel shows a string of the mesh or the ground behind it, and the first rule finds too few, or soil.

use crate::image::{HEIGHT, WIDTH};

/// From this likelihood on, 0 to 255, a pixel shows a known obstacle.
pub const KNOWN: u8 = 128;
/// The same for blends: a column of pixels, each of which may be the obstacle, is it where their height is right.
const MAY_BE: u8 = 80;
/// Rows without the obstacle's colour that it may have between others.
const GAP_ROWS: usize = 2;
/// Rows below a foot that show something else, but for a quarter of them.
pub(crate) const BELOW_ROWS: usize = 4;
/// Nearer than this, m, pixels show strings of a mesh or what is behind it, and hardly blends: a foot that they alone have
/// says nothing there, neither that the obstacle stands there nor that the ground is free.
const BLENDS_FROM_M: f64 = 2.5;
/// An obstacle has its colour in each of so many equal parts of its height: with a look at the whole alone, a patch of
/// soil nearby would do.
const PARTS: usize = 3;
/// Least number of rows between foot and top, so that each part has two.
pub(crate) const LEAST_ROWS: usize = 2 * PARTS;

/// What shows a known obstacle, for the pixels of the reduced image in row order.
#[derive(Clone, Copy, Debug)]
pub struct Pixels<'a> {
    /// How likely a pixel has the obstacle's own colour, 0 to 255.
    pub pure: &'a [u8],
    /// How likely it has this colour or a blend of it and the ground, 0 to 255.
    pub blended: &'a [u8],
    /// How likely it has this colour or a blend that posts have, 0 to 255.
    pub posts: &'a [u8],
    /// Tangent of the angle of its ray below the horizontal; negative above, NaN where there is no ray.
    pub slopes: &'a [f64],
}

/// What is known of the shape of the obstacles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shape {
    /// Height, m.
    pub height_m: f64,
    /// Least share of the rows of each part of the height that have the obstacle's colour or a blend.
    pub least_share: f64,
    /// Posts of a fence stand at most this far apart, m; 0 if there are none.
    pub span_m: f64,
}

/// The lowest pixel of a known obstacle in a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Foot {
    /// Its row.
    pub row: usize,
    /// How sure it is that there is a known obstacle, 0 to 255, at least [`KNOWN`]; 0 where its pixels say nothing.
    pub backing: u8,
}

impl Shape {
    /// Height as a part of that of the camera. Seen from a camera of height h, the point z above a foot has the slope
    /// (1 - z / h) times that of the foot.
    pub(crate) fn top(&self, camera_m: f64) -> f64 {
        (self.height_m / camera_m).min(1.0)
    }
}

/// The foot of a known obstacle in each column of the reduced image of a camera `camera_m` (m) above the ground plane.
pub fn feet(pixels: &Pixels<'_>, shape: &Shape, camera_m: f64) -> Vec<Option<Foot>> {
    let top = shape.top(camera_m);
    let foot = |column: usize| {
        let column = Column { pixels, column };
        let by_height = column
            .by_height(top, shape.least_share)
            .map(|foot| foot.doubted_nearby(column.slope(foot.row), camera_m));
        Foot::lower(by_height, column.by_colour())
    };
    (0..WIDTH).map(foot).collect()
}

impl Foot {
    /// A foot above which this share of the pixels is known.
    pub(crate) fn of(row: usize, share: f64) -> Foot {
        Foot { row, backing: ((255.0 * share) as u8).max(KNOWN) }
    }

    /// The same foot, which says nothing where it is too near for blends.
    pub(crate) fn doubted_nearby(self, slope: f64, camera_m: f64) -> Foot {
        if camera_m < BLENDS_FROM_M * slope { Foot { backing: 0, ..self } } else { self }
    }

    /// The lower of two feet of a column. If they are close together it is as sure as the surer one.
    pub(crate) fn lower(a: Option<Foot>, b: Option<Foot>) -> Option<Foot> {
        let both = |a: Foot, b: Foot| {
            let (lower, upper) = if a.row >= b.row { (a, b) } else { (b, a) };
            let is_other = lower.backing == 0 && lower.row - upper.row > BELOW_ROWS;
            if is_other { lower } else { Foot { backing: lower.backing.max(upper.backing), ..lower } }
        };
        a.into_iter().chain(b).reduce(both)
    }
}

struct Column<'a> {
    pixels: &'a Pixels<'a>,
    column: usize,
}

impl Column<'_> {
    fn pure(&self, row: usize) -> u8 {
        self.pixels.pure[row * WIDTH + self.column]
    }

    fn slope(&self, row: usize) -> f64 {
        self.pixels.slopes[row * WIDTH + self.column]
    }

    fn is_known(&self, row: usize) -> bool {
        self.pure(row) >= KNOWN || self.pixels.blended[row * WIDTH + self.column] >= MAY_BE
    }

    fn by_colour(&self) -> Option<Foot> {
        let lowest = (0..HEIGHT).rev().find(|&row| self.pure(row) >= KNOWN)?;
        let mut foot = lowest;
        while let Some(below) =
            (foot + 1..HEIGHT.min(foot + 2 + GAP_ROWS)).rev().find(|&row| self.is_known(row))
        {
            foot = below;
        }
        Some(Foot { row: foot, backing: self.pure(lowest) })
    }

    /// `top` is the height of the obstacle as a part of that of the camera.
    fn by_height(&self, top: f64, least_share: f64) -> Option<Foot> {
        let mut rows = (LEAST_ROWS..HEIGHT - BELOW_ROWS).rev().filter(|&row| self.is_foot(row));
        rows.find_map(|row| {
            let share = share(row, top, |row| self.slope(row), |row| self.is_known(row))?;
            (share >= least_share).then(|| Foot::of(row, share))
        })
    }

    /// Whether this pixel is known and on the ground, and those below it are something else.
    fn is_foot(&self, row: usize) -> bool {
        let below = (row + 1..=row + BELOW_ROWS).filter(|&row| self.is_known(row)).count();
        self.is_known(row) && self.slope(row) > 0.0 && below <= BELOW_ROWS / 4
    }
}

/// The least share of known pixels in a part of the height of an obstacle that stands in this row, where `top` is its
/// height as a part of that of the camera; `None` where it has too few rows, or a gap. `slope` and `is_known` are asked
/// for one row after the other, from the foot up.
pub(crate) fn share(
    foot: usize,
    top: f64,
    slope: impl Fn(usize) -> f64,
    mut is_known: impl FnMut(usize) -> bool,
) -> Option<f64> {
    let (mut least, mut row, mut gap) = (1.0_f64, foot, 0);
    for part in 1..=PARTS {
        let end = slope(foot) * (1.0 - top * part as f64 / PARTS as f64);
        let (mut rows, mut known) = (0, 0);
        while row > 0 && slope(row) >= end {
            let is_known = is_known(row);
            gap = if is_known { 0 } else { gap + 1 };
            if gap > GAP_ROWS {
                return None;
            }
            rows += 1;
            known += u32::from(is_known);
            row -= 1;
        }
        if rows > 0 {
            least = least.min(f64::from(known) / f64::from(rows));
        }
    }
    (foot - row >= LEAST_ROWS).then_some(least)
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAMERA_M: f64 = 1.0;
    const SHAPE: Shape = Shape { height_m: 1.0, least_share: 0.6, span_m: 0.0 };
    /// The horizon.
    const LEVEL: usize = 26;

    fn slope(row: usize) -> f64 {
        (row as f64 - LEVEL as f64) / 100.0
    }

    /// The foot in each column, where both kinds of pixels are painted by row and column.
    fn painted(
        shape: &Shape,
        is_pure: impl Fn(usize, usize) -> bool,
        is_blend: impl Fn(usize, usize) -> bool,
    ) -> Vec<Option<Foot>> {
        let of = |is: &dyn Fn(usize, usize) -> bool| -> Vec<u8> {
            (0..HEIGHT * WIDTH).map(|at| if is(at / WIDTH, at % WIDTH) { 200 } else { 0 }).collect()
        };
        let slopes: Vec<f64> = (0..HEIGHT * WIDTH).map(|at| slope(at / WIDTH)).collect();
        let (pure, blended) = (of(&is_pure), of(&is_blend));
        feet(&Pixels { pure: &pure, blended: &blended, posts: &[], slopes: &slopes }, shape, CAMERA_M)
    }

    fn none(_: usize, _: usize) -> bool {
        false
    }

    #[test]
    fn blends_from_the_ground_up_to_the_horizon_stand_where_they_begin() {
        let feet = painted(&SHAPE, none, |row, column| column < 40 && (LEVEL..60).contains(&row));
        let expected = |column| (column < 40).then_some(Foot { row: 59, backing: 255 });
        assert!((0..WIDTH).all(|column| feet[column] == expected(column)), "{feet:?}");
    }

    #[test]
    fn a_patch_that_ends_below_the_horizon_is_ground() {
        for top in [LEVEL + 6, 40, 50] {
            let feet = painted(&SHAPE, none, |row, _| (top..60).contains(&row));
            assert!(feet.iter().all(Option::is_none), "from row {top}");
        }
        // A lower obstacle reaches as high as it is: half of the camera's height is half of the way to the horizon.
        let low = Shape { height_m: 0.5, ..SHAPE };
        let feet = painted(&low, none, |row, _| (43..60).contains(&row));
        assert!(feet.iter().all(|foot| foot.is_some_and(|foot| foot.row == 59)));
    }

    #[test]
    fn nearby_blends_alone_say_nothing() {
        // Row 66 shows the ground at 2.5 m.
        let blend = |row: usize, _: usize| (LEVEL..70).contains(&row);
        let foot = |backing| Some(Foot { row: 69, backing });
        assert!(painted(&SHAPE, none, blend).iter().all(|at| *at == foot(0)));
        let feet = painted(&SHAPE, |row, _| row == 60, blend);
        assert!(feet.iter().all(|at| *at == foot(200)), "a string has the own colour: {:?}", feet[0]);
        // What stands higher up in the column does not make it surer.
        let other = Foot { row: 40, backing: 230 };
        assert_eq!(Foot::lower(foot(0), Some(other)), foot(0));
        assert_eq!(Foot::lower(Some(other), foot(180)), foot(230));
    }

    #[test]
    fn without_ground_below_it_nothing_stands() {
        let feet = painted(&SHAPE, none, |row, _| row >= LEVEL);
        assert!(feet.iter().all(Option::is_none));
    }

    #[test]
    fn a_mesh_has_gaps_but_no_wide_ones() {
        let rows = |row: usize| (LEVEL..60).contains(&row);
        let meshed = painted(&SHAPE, none, |row, _| rows(row) && row % 3 != 0);
        assert!(meshed.iter().all(|foot| foot.is_some_and(|foot| foot.row == 59 && foot.backing >= 153)));
        let parted = painted(&SHAPE, none, |row, _| rows(row) && !(45..48).contains(&row));
        assert!(parted.iter().all(|foot| foot.is_some_and(|foot| foot.row == 44)), "it stands above the gap");
        let sparse = painted(&SHAPE, none, |row, _| rows(row) && row % 2 == 0);
        assert!(sparse.iter().all(Option::is_none), "half of the rows are too few");
    }

    #[test]
    fn a_string_of_the_own_colour_is_enough_and_blends_below_it_are_its_foot() {
        let string = |row: usize, _: usize| row == 50;
        let expected = |row| Some(Foot { row, backing: 200 });
        assert!(painted(&SHAPE, string, none).iter().all(|foot| *foot == expected(50)));
        let feet = painted(&SHAPE, string, |row, column| row == 53 || (column < 9 && row == 57));
        assert!(feet.iter().all(|foot| *foot == expected(53)), "{feet:?}");
    }

    #[test]
    fn pixels_without_a_ray_are_no_foot() {
        let slopes = vec![f64::NAN; HEIGHT * WIDTH];
        let blended = vec![200; HEIGHT * WIDTH];
        let pure = vec![0; HEIGHT * WIDTH];
        let pixels = Pixels { pure: &pure, blended: &blended, posts: &[], slopes: &slopes };
        assert!(feet(&pixels, &SHAPE, CAMERA_M).iter().all(Option::is_none));
    }
}
