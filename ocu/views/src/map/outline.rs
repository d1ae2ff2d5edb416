//! Polygons that a person outlines on the map, corner by corner. Positions are in the frame of the map, m.

/// Distance within which two places are the same one, m.
pub(super) const SAME_M: f64 = 0.01;

/// Adds a corner to a polygon that is being drawn. Returns the polygon if the corner closes it: if it is the first one
/// again, within a distance.
pub(super) fn corner(corners: &mut Vec<[f64; 2]>, at: [f64; 2], reach_m: f64) -> Option<Vec<[f64; 2]>> {
    let closes = is_first(corners, at, reach_m);
    if !closes {
        corners.push(at);
    }
    (closes && corners.len() >= 3).then(|| std::mem::take(corners))
}

/// Distance between two places, m.
pub(super) fn distance_m(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// Whether two polygons have the same corners in the same order.
pub(super) fn is_same_outline(a: &[[f64; 2]], b: &[[f64; 2]]) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| distance_m(*a, *b) <= SAME_M)
}

/// Whether a place is the first corner of a polygon, within a distance.
pub(super) fn is_first(corners: &[[f64; 2]], at: [f64; 2], reach_m: f64) -> bool {
    corners.first().is_some_and(|first| distance_m(*first, at) <= reach_m)
}

/// Whether a place lies inside of a polygon, or within a distance of its border.
pub(super) fn is_in_or_near(corners: &[[f64; 2]], at: [f64; 2], reach_m: f64) -> bool {
    let [x, y] = at;
    let mut is_inside = false;
    for (a, b) in corners.iter().zip(corners.iter().cycle().skip(1)) {
        if distance_to_edge_m(*a, *b, at) <= reach_m {
            return true;
        }
        // A ray along the x axis crosses the border an odd number of times if it begins inside.
        let crosses = (a[1] > y) != (b[1] > y);
        is_inside ^= crosses && x < a[0] + (b[0] - a[0]) * (y - a[1]) / (b[1] - a[1]);
    }
    is_inside
}

/// Distance of a place from the line between two corners.
fn distance_to_edge_m(a: [f64; 2], b: [f64; 2], at: [f64; 2]) -> f64 {
    let [dx, dy] = [b[0] - a[0], b[1] - a[1]];
    let squared = dx * dx + dy * dy;
    let along = (at[0] - a[0]) * dx + (at[1] - a[1]) * dy;
    let part = if squared > 0.0 { (along / squared).clamp(0.0, 1.0) } else { 0.0 };
    distance_m([a[0] + part * dx, a[1] + part * dy], at)
}
