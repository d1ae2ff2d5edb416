//! Distance of every cell to the nearest blocked cell.
//!
//! The exact Euclidean distance transform of Felzenszwalb and Huttenlocher ("Distance Transforms of Sampled Functions",
//! 2012): one pass along the columns and one along the rows, each the lower envelope of parabolas, linear in the number
//! of cells.

/// Distance between the centre of each cell and that of the nearest blocked one, in cells, in row order. Cells outside
/// of the map count as blocked, so that no path follows the edge of the known area.
pub fn to_blocked(columns: usize, is_blocked: &[bool]) -> Vec<f32> {
    let rows = is_blocked.len() / columns.max(1);
    // Larger than any squared distance, and small enough for exact whole numbers.
    let far = ((columns + rows + 2) * (columns + rows + 2)) as f64;
    let mut squared: Vec<f64> = is_blocked.iter().map(|&blocked| if blocked { 0.0 } else { far }).collect();
    let mut scratch = Scratch::default();
    for column in 0..columns {
        scratch.line.clear();
        scratch.line.extend((0..rows).map(|row| squared[row * columns + column]));
        scratch.transform();
        for (row, &value) in scratch.result.iter().enumerate() {
            squared[row * columns + column] = value;
        }
    }
    for row in squared.chunks_exact_mut(columns.max(1)) {
        scratch.line.clear();
        scratch.line.extend_from_slice(row);
        scratch.transform();
        row.copy_from_slice(&scratch.result);
    }
    let edge = |at: usize| {
        let (column, row) = (at % columns, at / columns);
        (column + 1).min(columns - column).min(row + 1).min(rows - row) as f32
    };
    squared.iter().enumerate().map(|(at, &value)| (value.sqrt() as f32).min(edge(at))).collect()
}

/// One line of the transform: `result[i] = min over j of line[j] + (i − j)²`.
#[derive(Default)]
struct Scratch {
    line: Vec<f64>,
    result: Vec<f64>,
    /// Parabolas of the lower envelope, and where each starts to be the lowest.
    roots: Vec<usize>,
    starts: Vec<f64>,
}

impl Scratch {
    fn transform(&mut self) {
        let line = &self.line;
        self.roots.clear();
        self.starts.clear();
        for at in 0..line.len() {
            let mut start = f64::NEG_INFINITY;
            while let (Some(&root), Some(&from)) = (self.roots.last(), self.starts.last()) {
                start = crossing(line, root, at);
                if start > from {
                    break;
                }
                self.roots.pop();
                self.starts.pop();
                start = f64::NEG_INFINITY;
            }
            self.roots.push(at);
            self.starts.push(start);
        }
        self.result.clear();
        let mut lowest = 0;
        for at in 0..line.len() {
            while self.starts.get(lowest + 1).is_some_and(|&start| start < at as f64) {
                lowest += 1;
            }
            let root = self.roots[lowest];
            let apart = at.abs_diff(root) as f64;
            self.result.push(line[root] + apart * apart);
        }
    }
}

/// Where the parabola of `right` crosses that of `left` and becomes lower.
fn crossing(line: &[f64], left: usize, right: usize) -> f64 {
    let (l, r) = (left as f64, right as f64);
    ((line[right] + r * r) - (line[left] + l * l)) / (2.0 * (r - l))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn reference_to_blocked(columns: usize, is_blocked: &[bool]) -> Vec<f32> {
        let rows = is_blocked.len() / columns;
        let mut distances = Vec::new();
        for row in 0..rows as i64 {
            for column in 0..columns as i64 {
                let mut nearest = f64::INFINITY;
                for r in -1..=rows as i64 {
                    for c in -1..=columns as i64 {
                        let inside = (0..rows as i64).contains(&r) && (0..columns as i64).contains(&c);
                        if !inside || is_blocked[r as usize * columns + c as usize] {
                            let (dr, dc) = ((r - row) as f64, (c - column) as f64);
                            nearest = nearest.min((dr * dr + dc * dc).sqrt());
                        }
                    }
                }
                distances.push(nearest as f32);
            }
        }
        distances
    }

    proptest! {
        #[test]
        fn it_equals_the_plain_search(columns in 1..24_usize, cells in prop::collection::vec(0..9_u8, 1..400)) {
            let rows = cells.len().div_ceil(columns);
            let mut is_blocked: Vec<bool> = cells.iter().map(|&cell| cell == 0).collect();
            is_blocked.resize(rows * columns, false);
            prop_assert_eq!(to_blocked(columns, &is_blocked), reference_to_blocked(columns, &is_blocked));
        }
    }
}
