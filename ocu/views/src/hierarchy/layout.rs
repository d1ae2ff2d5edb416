//! Places the boxes: a tidy tree that depends on the hierarchy alone, so that it stays still.
//!
//! A supervisor stands above the middle of its subordinates. Subordinates without subordinates of their own form a block
//! of several rows if there are many, so that a wide tree stays readable; how many is chosen so that the boxes are large.

use egui::{Pos2, Rect, Vec2};
use rcs_runtime::source::Node;

pub(super) const BOX: Vec2 = Vec2::new(200.0, 92.0);
pub(super) const GAP: Vec2 = Vec2::new(24.0, 44.0);
/// Room between the rows of a block.
const ROW_GAP: f32 = 16.0;
/// Numbers of subordinates of one row that are tried, in the order of preference; more of them form a block.
const ONE_ROW: [usize; 5] = [5, 8, 3, 2, 1];
/// How much larger the boxes must become for another number.
const WORTH: f32 = 1.15;

/// Places of the boxes, and whether a box is in a block of several rows.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Places {
    pub(super) boxes: Vec<Rect>,
    pub(super) in_block: Vec<bool>,
    pub(super) size: Vec2,
}

/// A part of the tree with its own origin.
struct Part {
    size: Vec2,
    /// Left upper corner of each box.
    at: Vec<(usize, Pos2)>,
    /// Middle of its top box.
    middle: f32,
}

/// Places the nodes; `shape` is the width of the room over its height.
pub(super) fn place(nodes: &[Node], shape: f32) -> Places {
    // The scale at which a tree fits into a room of height 1.
    let scale = |places: &Places| (shape / places.size.x.max(1.0)).min(1.0 / places.size.y.max(1.0));
    let tried = ONE_ROW.map(|one_row| place_in_rows(nodes, shape, one_row));
    let best = tried.into_iter().reduce(
        |best, other| {
            if scale(&other) > WORTH * scale(&best) { other } else { best }
        },
    );
    best.unwrap_or_default()
}

fn place_in_rows(nodes: &[Node], shape: f32, one_row: usize) -> Places {
    let below = |of: Option<usize>| -> Vec<usize> {
        (0..nodes.len()).filter(|&index| nodes[index].supervisor == of).collect()
    };
    let mut places =
        Places { boxes: vec![Rect::ZERO; nodes.len()], in_block: vec![false; nodes.len()], size: Vec2::ZERO };
    let roots = below(None);
    // Without any supervisor all boxes are one block; otherwise trees stand beside each other.
    let has_leaves_only = roots.iter().all(|&root| below(Some(root)).is_empty());
    let parts = if has_leaves_only {
        vec![block(&roots, columns(roots.len(), shape), &mut Vec::new())]
    } else {
        roots.iter().map(|&root| tree(root, &below, one_row, &mut places.in_block)).collect()
    };
    let mut left = 0.0;
    for part in parts {
        for (index, at) in part.at {
            places.boxes[index] = Rect::from_min_size(at + Vec2::new(left, 0.0), BOX);
        }
        places.size = places.size.max(Vec2::new(left + part.size.x, part.size.y));
        left += part.size.x + GAP.x;
    }
    places
}

/// Number of columns with which a block of boxes has about the shape of the room.
fn columns(count: usize, shape: f32) -> usize {
    let best = (count as f32 * shape.clamp(0.3, 6.0) * BOX.y / BOX.x).sqrt().round();
    (best as usize).clamp(1, count.max(1))
}

/// A block of boxes without subordinates.
fn block(leaves: &[usize], columns: usize, in_block: &mut Vec<usize>) -> Part {
    let rows = leaves.len().div_ceil(columns.max(1));
    let step = BOX + Vec2::new(GAP.x, ROW_GAP);
    let at = leaves.iter().enumerate().map(|(place, &index)| {
        (index, (Vec2::new((place % columns) as f32, (place / columns) as f32) * step).to_pos2())
    });
    if rows > 1 {
        in_block.extend(leaves);
    }
    let size = Vec2::new(columns as f32, rows as f32) * step - Vec2::new(GAP.x, ROW_GAP);
    Part { size, at: at.collect(), middle: size.x / 2.0 }
}

fn tree(
    node: usize,
    below: &dyn Fn(Option<usize>) -> Vec<usize>,
    one_row: usize,
    in_block: &mut [bool],
) -> Part {
    let subordinates = below(Some(node));
    if subordinates.is_empty() {
        return Part { size: BOX, at: vec![(node, Pos2::ZERO)], middle: BOX.x / 2.0 };
    }
    let (leaves, inner): (Vec<usize>, Vec<usize>) =
        subordinates.iter().partition(|&&index| below(Some(index)).is_empty());
    let mut parts: Vec<Part> = inner.iter().map(|&index| tree(index, below, one_row, in_block)).collect();
    if leaves.len() > one_row {
        let mut wrapped = Vec::new();
        parts.push(block(&leaves, one_row, &mut wrapped));
        for index in wrapped {
            in_block[index] = true;
        }
    } else {
        parts.extend(leaves.iter().map(|&index| tree(index, below, one_row, in_block)));
    }
    let (mut at, mut left, mut height) = (Vec::new(), 0.0_f32, 0.0_f32);
    let mut middles = Vec::new();
    for part in parts {
        let offset = Vec2::new(left, BOX.y + GAP.y);
        at.extend(part.at.into_iter().map(|(index, place)| (index, place + offset)));
        middles.push(left + part.middle);
        left += part.size.x + GAP.x;
        height = height.max(part.size.y);
    }
    let width = left - GAP.x;
    let (first, last) = (middles.first().copied().unwrap_or(0.0), middles.last().copied().unwrap_or(0.0));
    let middle = f32::midpoint(first, last);
    at.push((node, Pos2::new((middle - BOX.x / 2.0).max(0.0), 0.0)));
    Part { size: Vec2::new(width.max(BOX.x), BOX.y + GAP.y + height), at, middle }
}

/// The line from a supervisor to a subordinate, as corners. Boxes of a block are reached from the gap at their left.
pub(super) fn line(above: Rect, below: Rect, in_block: bool) -> Vec<Pos2> {
    let top = above.center_bottom();
    let level = top.y + GAP.y / 2.0;
    if in_block {
        let x = below.left() - GAP.x / 2.0;
        let y = below.top() + 12.0;
        return vec![
            top,
            Pos2::new(top.x, level),
            Pos2::new(x, level),
            Pos2::new(x, y),
            Pos2::new(below.left(), y),
        ];
    }
    let bottom = below.center_top();
    vec![top, Pos2::new(top.x, level), Pos2::new(bottom.x, level), bottom]
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcs_msg::rcs::ProcessInfo;
    use rcs_runtime::source::Hierarchy;

    fn nodes(pairs: &[(&str, &str)]) -> Vec<Node> {
        let process = |(name, supervisor): &(&str, &str)| ProcessInfo {
            name: (*name).into(),
            supervisor: (*supervisor).into(),
            ..ProcessInfo::default()
        };
        Hierarchy::new(&pairs.iter().map(process).collect::<Vec<_>>(), &[], false).nodes
    }

    fn check(nodes: &[Node], shape: f32) -> Places {
        let places = place(nodes, shape);
        for (i, a) in places.boxes.iter().enumerate() {
            assert!(a.min.x >= 0.0 && a.right() <= places.size.x && a.bottom() <= places.size.y, "{a:?}");
            for b in &places.boxes[i + 1..] {
                assert!(!a.shrink(0.5).intersects(*b), "{a:?} {b:?}");
            }
            if let Some(above) = nodes[i].supervisor {
                assert!(places.boxes[above].bottom() < a.top());
            }
        }
        assert_eq!(places, place(nodes, shape), "it stays still");
        places
    }

    #[test]
    fn a_supervisor_stands_over_the_middle_of_its_subordinates() {
        let nodes = nodes(&[("a", "top"), ("top", ""), ("b", "top"), ("alone", "nobody")]);
        let places = check(&nodes, 1.5);
        let of = |name: &str| places.boxes[nodes.iter().position(|node| &*node.name == name).unwrap()];
        assert_eq!(of("top").center().x, f32::midpoint(of("a").center().x, of("b").center().x));
        assert!(of("alone").left() > of("b").right());
    }

    #[test]
    fn forty_processes_have_room_without_overlap() {
        let names: Vec<String> = (0..40).map(|i| format!("p{i}")).collect();
        for supervisor_of in [|_: usize| 0_usize, |i: usize| (i - 1) / 3, |i: usize| (i - 1) % 4] {
            let pairs: Vec<(&str, &str)> = (0..40)
                .map(|i| (names[i].as_str(), if i == 0 { "" } else { names[supervisor_of(i)].as_str() }))
                .collect();
            let places = check(&nodes(&pairs), 1.6);
            assert!(places.size.x < 40.0 * 0.75 * (BOX.x + GAP.x), "{:?}", places.size);
        }
        let flat: Vec<(&str, &str)> = names.iter().map(|name| (name.as_str(), "viewer")).collect();
        let size = check(&nodes(&flat), 1.6).size;
        assert!((1.0..2.5).contains(&(size.x / size.y)), "{size:?}");
    }
}
