//! Reference implementations of both methods, by definition: slow, pixel by pixel, without running sums. For tests.

use crate::{Method, NO_DISPARITY, STEPS_PER_PIXEL, Settings, block, sgm};

struct Plane {
    width: usize,
    height: usize,
    data: Vec<i32>,
}

impl Plane {
    fn new(width: usize, height: usize, value: impl Fn(isize, isize) -> i32) -> Plane {
        let data = (0..height as isize).flat_map(|y| (0..width as isize).map(move |x| (x, y)));
        Plane { width, height, data: data.map(|(x, y)| value(x, y)).collect() }
    }

    /// The pixel; beyond the image, the outermost one.
    fn at(&self, x: isize, y: isize) -> i32 {
        let (x, y) = (x.clamp(0, self.width as isize - 1), y.clamp(0, self.height as isize - 1));
        self.data[y as usize * self.width + x as usize]
    }
}

/// The clipped Laplacian of Gaussian, and the brightness.
fn filter(image: &[u8], [width, height]: [usize; 2], cap: i32) -> (Plane, Plane) {
    let grey = Plane::new(width, height, |x, y| i32::from(image[y as usize * width + x as usize]));
    let weights = [1, 4, 6, 4, 1];
    let gauss = Plane::new(width, height, |x, y| {
        let tap =
            |i: usize, k: usize| weights[i] * weights[k] * grey.at(x + i as isize - 2, y + k as isize - 2);
        (0..5).flat_map(|i| (0..5).map(move |k| (i, k))).map(|(i, k)| tap(i, k)).sum::<i32>() >> 4
    });
    let laplacian = Plane::new(width, height, |x, y| {
        let around = gauss.at(x - 1, y) + gauss.at(x + 1, y) + gauss.at(x, y - 1) + gauss.at(x, y + 1);
        ((4 * gauss.at(x, y) - around) >> 2).clamp(-cap, cap)
    });
    let brightness = Plane::new(width, height, |x, y| gauss.at(x, y) >> 6);
    (laplacian, brightness)
}

/// Costs of a method, indexed by `[y][x][d]`, for columns from `disparities - 1` on.
type Costs = Vec<Vec<Vec<i32>>>;

fn costs(left: &[u8], right: &[u8], size: [usize; 2], settings: &Settings) -> Costs {
    let [width, height] = size;
    let semi_global = settings.method == Method::SemiGlobal;
    let cap = if semi_global { sgm::CAP } else { block::cap(settings.block) };
    let radius = if semi_global { 1 } else { settings.block as isize / 2 };
    let (left, left_bright) = filter(left, size, i32::from(cap));
    let (right, right_bright) = filter(right, size, i32::from(cap));
    let cost = |x: isize, y: isize, d: isize| {
        let mut sum = 0;
        for dy in -radius..=radius {
            for dx in -radius..=radius {
                let (x, y) = (x + dx, y + dy);
                sum += (left.at(x, y) - right.at(x - d, y)).abs();
                if semi_global {
                    let difference = (left_bright.at(x, y) - right_bright.at(x - d, y)).abs();
                    sum += difference.min(i32::from(sgm::BRIGHTNESS_CAP));
                }
            }
        }
        if semi_global { sum / 2 } else { sum }
    };
    let d = settings.disparities as isize;
    let pixel = |x, y| (0..d).map(|d| cost(x, y, d)).collect();
    (0..height as isize).map(|y| (d - 1..width as isize).map(|x| pixel(x, y)).collect()).collect()
}

/// Sums of the costs along the four paths.
fn aggregate(costs: &Costs) -> Costs {
    let (height, n, disparities) = (costs.len(), costs[0].len(), costs[0][0].len());
    let mut sums = vec![vec![vec![0; disparities]; n]; height];
    for (dx, dy) in [(1_isize, 0_isize), (-1, 0), (0, 1), (0, -1)] {
        let mut path = vec![vec![vec![0; disparities]; n]; height];
        for row in 0..height {
            let y = if dy < 0 { height - 1 - row } else { row };
            for step in 0..n {
                let x = if dx < 0 { n - 1 - step } else { step };
                let (from_x, from_y) = (x as isize - dx, y as isize - dy);
                let inside = (0..n as isize).contains(&from_x) && (0..height as isize).contains(&from_y);
                let before = if inside {
                    path[from_y as usize][from_x as usize].clone()
                } else {
                    vec![0; disparities]
                };
                let least = *before.iter().min().unwrap();
                for d in 0..disparities {
                    let mut way = before[d].min(least + i32::from(sgm::P2));
                    for near in [d.wrapping_sub(1), d + 1] {
                        way = way.min(before.get(near).map_or(i32::MAX, |cost| cost + i32::from(sgm::P1)));
                    }
                    path[y][x][d] = costs[y][x][d] + way - least;
                    sums[y][x][d] += path[y][x][d];
                }
            }
        }
    }
    sums
}

/// The disparity image that [`crate::Matcher`] must give.
pub(crate) fn reference(left: &[u8], right: &[u8], size: [usize; 2], settings: &Settings) -> Vec<u16> {
    let [width, height] = size;
    let first_column = settings.disparities - 1;
    let block = settings.method == Method::Block;
    let costs = costs(left, right, size, settings);
    let costs = if block { costs } else { aggregate(&costs) };
    let mut out = vec![NO_DISPARITY; width * height];
    for (y, row) in costs.iter().enumerate() {
        let best: Vec<usize> = row.iter().map(|costs| first_least(costs)).collect();
        for (i, costs) in row.iter().enumerate() {
            let d = best[i];
            let beside = |k: &usize| k.abs_diff(d) > 1;
            let rival = (0..costs.len()).filter(beside).map(|k| costs[k]).min().unwrap();
            let unique = rival * 100 > costs[d] * (100 + i32::from(settings.uniqueness_pct));
            let back = if block { right_least(row, i, d) } else { claimant(row, &best, i) };
            if unique && back.abs_diff(d) <= usize::from(settings.left_right_max) {
                out[y * width + first_column + i] = refine(costs, d);
            }
        }
    }
    take_out_speckles(&mut out, size, settings);
    out
}

fn first_least(costs: &[i32]) -> usize {
    let least = costs.iter().min().unwrap();
    costs.iter().position(|cost| cost == least).unwrap()
}

/// The best disparity, over all left pixels, of the right image's pixel that pixel `i` of the left one matches at `d`.
fn right_least(row: &[Vec<i32>], i: usize, d: usize) -> usize {
    let column = i as isize - d as isize;
    let candidates: Vec<i32> = (0..row[0].len() as isize)
        .map(|k| {
            usize::try_from(column + k).ok().and_then(|x| row.get(x)).map_or(i32::MAX, |c| c[k as usize])
        })
        .collect();
    first_least(&candidates)
}

/// The disparity of the cheapest left pixel that matches the same pixel of the right image; the rightmost of equals.
fn claimant(row: &[Vec<i32>], best: &[usize], i: usize) -> usize {
    let column = |x: usize| x as isize - best[x] as isize;
    let claims = (0..row.len()).rev().filter(|&x| column(x) == column(i));
    best[claims.min_by_key(|&x| row[x][best[x]]).unwrap()]
}

fn refine(costs: &[i32], d: usize) -> u16 {
    let whole = d as u16 * STEPS_PER_PIXEL;
    if d == 0 || d + 1 == costs.len() {
        return whole;
    }
    let (below, best, above) = (costs[d - 1], costs[d], costs[d + 1]);
    let steep = (below.max(above) - best).max(1);
    // Rounded to the nearest, halves up.
    let fraction = (f64::from(below - above) * 8.0 / f64::from(steep) + 0.5).floor();
    (f64::from(whole) + fraction) as u16
}

fn take_out_speckles(disparity: &mut [u16], [width, height]: [usize; 2], settings: &Settings) {
    let mut seen = vec![false; disparity.len()];
    for start in 0..disparity.len() {
        if seen[start] || disparity[start] == NO_DISPARITY {
            continue;
        }
        seen[start] = true;
        let mut patch = vec![start];
        let mut next = 0;
        while next < patch.len() {
            let at = patch[next];
            next += 1;
            let (x, y) = (at % width, at / width);
            let beside = [
                (x > 0).then(|| at - 1),
                (x + 1 < width).then(|| at + 1),
                (y > 0).then(|| at - width),
                (y + 1 < height).then(|| at + width),
            ];
            for to in beside.into_iter().flatten() {
                let close = disparity[to] != NO_DISPARITY
                    && disparity[to].abs_diff(disparity[at]) <= settings.speckle_step;
                if close && !seen[to] {
                    seen[to] = true;
                    patch.push(to);
                }
            }
        }
        if patch.len() < settings.speckle_min_area {
            for at in patch {
                disparity[at] = NO_DISPARITY;
            }
        }
    }
}
