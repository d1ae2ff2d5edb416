//! Transform tree: every coordinate frame below its parent, with its pose there and the age of that transform; then the
//! frames that messages name and no transform does.

use crate::map;
use crate::view::{Hover, HoverPoint, View, ViewContext};
use egui::{Align, FontId, Rect, Role, ScrollArea, Sense, Ui, Vec2, WidgetInfo};
use ocu_ui::{format, icons, tokens, widgets};
use rcs_geom::{Pose, TransformTree};
use rcs_msg::Stamp;
use rcs_runtime::source::Frame;
use std::collections::BTreeMap;

const ROW: f32 = 20.0;
const INDENT: f32 = 16.0;

/// The transform tree. It has no state.
#[derive(Default)]
pub(crate) struct Frames;

/// One frame and its place in the tree.
struct Row<'a> {
    name: &'a str,
    place: Place<'a>,
    depth: usize,
}

/// Where a frame is.
enum Place<'a> {
    /// At the top of a tree.
    Root,
    /// Below this frame.
    Below(&'a str),
    /// It is no frame, but the heading of those that are not connected.
    Heading,
    /// No transform names it, but these topics do.
    Loose(String),
}

impl View for Frames {
    fn title(&self, _frame: &Frame) -> String {
        "Frames".to_owned()
    }

    fn ui(&mut self, ui: &mut Ui, cx: &mut ViewContext<'_>) {
        let frame = cx.frame;
        let mut rows = rows(&frame.transforms);
        rows.extend(loose_rows(frame));
        if rows.is_empty() {
            let hint = "Transforms or odometry would fill it: open a log that has some, or run a stack.";
            return widgets::empty(ui, icons::ICON_3D_ROTATION, "No coordinate frames", hint);
        }
        let wide = ui.available_width() >= 480.0;
        header(ui, wide);
        ui.spacing_mut().item_spacing.y = 0.0;
        ScrollArea::vertical().auto_shrink(false).show_rows(ui, ROW, rows.len(), |ui, range| {
            for line in &rows[range] {
                row(ui, cx, line, wide);
            }
        });
    }
}

/// The frames in the order of the tree, roots first. A frame is visited once, so that a loop ends.
fn rows(tree: &TransformTree) -> Vec<Row<'_>> {
    let mut children: BTreeMap<Option<&str>, Vec<&str>> = BTreeMap::new();
    let frames = tree.frames();
    for &name in &frames {
        let parent = tree.parent(name).filter(|parent| frames.contains(parent));
        children.entry(parent).or_default().push(name);
    }
    let mut rows: Vec<Row<'_>> = Vec::new();
    let roots = children.get(&None).into_iter().flatten();
    let mut open: Vec<Row<'_>> = roots.map(|name| Row { name, place: Place::Root, depth: 0 }).collect();
    open.reverse();
    while let Some(row) = open.pop() {
        if rows.len() > frames.len() {
            break;
        }
        let below = children.get(&Some(row.name)).into_iter().flatten().rev();
        open.extend(below.map(|&name| Row { name, place: Place::Below(row.name), depth: row.depth + 1 }));
        rows.push(row);
    }
    rows
}

/// The frames that messages name and no transform does, below a heading.
fn loose_rows(frame: &Frame) -> Vec<Row<'_>> {
    let loose = map::loose_frames(frame);
    let heading =
        (!loose.is_empty()).then_some(Row { name: "not connected", place: Place::Heading, depth: 0 });
    let rows = loose.into_iter().map(|(name, topics)| Row {
        name,
        place: Place::Loose(topics.join(", ")),
        depth: 1,
    });
    heading.into_iter().chain(rows).collect()
}

/// Widths of the columns: x y z, roll pitch yaw, age.
const COLUMNS: [(&str, f32); 3] = [("x y z, m", 200.0), ("roll pitch yaw, °", 168.0), ("age", 64.0)];

/// The places of the name and of the columns in a row.
fn places(rect: Rect, wide: bool) -> (Rect, [Option<Rect>; 3]) {
    let mut right = rect.right() - 8.0;
    let mut cells = [None; 3];
    for (index, (_, width)) in COLUMNS.iter().enumerate().rev() {
        // In a narrow view there is room for the position alone.
        if wide || index == 0 {
            cells[index] = Some(Rect::from_x_y_ranges(right - width..=right, rect.y_range()));
            right -= width + 8.0;
        }
    }
    (Rect::from_x_y_ranges(rect.left() + 8.0..=right.max(rect.left() + 8.0), rect.y_range()), cells)
}

fn header(ui: &mut Ui, wide: bool) {
    let (rect, _) = ui.allocate_exact_size(Vec2::new(ui.available_width(), ROW), Sense::hover());
    let (name, cells) = places(rect, wide);
    let (font, weak) = (FontId::proportional(11.0), tokens(ui).weak);
    widgets::cell(ui, name, Align::Min, "frame", font.clone(), weak);
    for ((title, _), cell) in COLUMNS.iter().zip(cells) {
        if let Some(cell) = cell {
            widgets::cell(ui, cell, Align::Max, title, font.clone(), weak);
        }
    }
}

fn row(ui: &mut Ui, cx: &mut ViewContext<'_>, row: &Row<'_>, wide: bool) {
    let tokens = tokens(ui);
    let frame = cx.frame;
    let (rect, response) = ui.allocate_exact_size(Vec2::new(ui.available_width(), ROW), Sense::hover());
    let (mut name, cells) = places(rect, wide);
    let pose = if let Place::Below(parent) = row.place { pose(frame, parent, row.name) } else { None };
    let text = match (&row.place, &pose) {
        (_, Some((pose, _))) => position(pose),
        (Place::Root, _) => "a root: nothing lies above it".to_owned(),
        (Place::Below(_), _) => "no transform at this time".to_owned(),
        (Place::Heading, _) => "no transform names these frames".to_owned(),
        (Place::Loose(topics), _) => format!("named by {topics}"),
    };
    response.widget_info(|| WidgetInfo::labeled(Role::Label, true, format!("{}: {text}", row.name)));
    if response.hovered() && !matches!(row.place, Place::Heading) {
        ui.painter().rect_filled(rect, 0.0, tokens.surface[2]);
        let point = Some(HoverPoint { frame_id: row.name.to_owned(), position_m: [0.0; 3] });
        cx.selection.hovered.set(Hover { point, ..Hover::default() });
    }
    name.min.x += row.depth as f32 * INDENT;
    if row.depth > 0 {
        let at = name.left_center() - Vec2::new(8.0, 1.0);
        widgets::icon_at(ui.painter(), at, icons::ICON_SUBDIRECTORY_ARROW_RIGHT, 12.0, tokens.weak);
        name.min.x += 2.0;
    }
    widgets::cell(ui, name, Align::Min, row.name, FontId::proportional(13.0), tokens.text);
    let mono = FontId::monospace(11.5);
    if let Some(cell) = cells[0] {
        let color = if pose.is_some() { tokens.text } else { tokens.weak };
        widgets::cell(ui, cell, Align::Max, &text, mono.clone(), color);
    }
    if let Place::Loose(_) = row.place {
        response.on_hover_text(text);
    }
    let Some((pose, time)) = pose else { return };
    if let Some(cell) = cells[1] {
        widgets::cell(ui, cell, Align::Max, &attitude(&pose), mono.clone(), tokens.text);
    }
    if let Some(cell) = cells[2] {
        let age = match time {
            None => "static".to_owned(),
            Some(time) => format::age(frame.transform_time(frame.now).seconds_since(time).max(0.0)),
        };
        widgets::cell(ui, cell, Align::Max, &age, mono, tokens.text);
    }
}

/// The newest pose of a frame in its parent until the viewed time; and its time by the clock of the transforms, `None` for a
/// static one. `None` before the first transform: this view shows no pose that is not known yet. The transforms of a
/// recording are also those that come later, so nothing is interpolated.
fn pose(frame: &Frame, parent: &str, child: &str) -> Option<(Pose, Option<Stamp>)> {
    let (tree, now) = (&frame.transforms, frame.transform_time(frame.now));
    let newest = tree.newest_until(parent, child, now.0).ok()?;
    let pose = tree.lookup(parent, child, newest.unwrap_or(now.0)).ok()?;
    Some((pose, newest.map(Stamp)))
}

fn position(pose: &Pose) -> String {
    let p = pose.translation;
    format!("{:8.2} {:8.2} {:7.2}", zero(p.x, 100.0), zero(p.y, 100.0), zero(p.z, 100.0))
}

fn attitude(pose: &Pose) -> String {
    let [roll, pitch, yaw] = pose.rpy();
    let degrees = |rad: f64| zero(rad.to_degrees(), 10.0);
    format!("{:6.1} {:6.1} {:6.1}", degrees(roll), degrees(pitch), degrees(yaw))
}

/// A number rounded to what is shown, so that a small negative one is not shown as "-0".
fn zero(value: f64, digits: f64) -> f64 {
    (value * digits).round() / digits + 0.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples;
    use std::sync::Arc;

    #[test]
    fn frames_that_no_transform_names_are_listed_with_the_topics_that_name_them() {
        let frame = samples::full();
        let rows = loose_rows(&frame);
        assert!(matches!(rows[0].place, Place::Heading));
        let loose: Vec<(&str, &str)> = rows[1..]
            .iter()
            .filter_map(|row| match &row.place {
                Place::Loose(topics) => Some((row.name, topics.as_str())),
                _ => None,
            })
            .collect();
        assert_eq!(loose, [("odom", "/odometry")]);
        assert!(loose_rows(&samples::empty()).is_empty());
    }

    #[test]
    fn the_age_of_a_transform_that_is_silent_grows_although_the_recording_has_later_ones() {
        let mut tree = TransformTree::new();
        for (time_ns, x) in [(10, 1.0), (20, 2.0), (100, 10.0)] {
            tree.insert("odom", "base", time_ns, Pose::from_xy_yaw(x, 0.0, 0.0)).unwrap();
        }
        tree.set_static("base", "camera", Pose::from_xy_yaw(3.0, 0.0, 0.0)).unwrap();
        let transforms = Arc::new(tree);
        let shown = |parent: &str, child: &str, now: u64| {
            let frame = Frame { transforms: Arc::clone(&transforms), now: Stamp(now), ..samples::empty() };
            pose(&frame, parent, child).map(|(pose, time)| (pose.translation.x, time))
        };
        assert_eq!(shown("odom", "base", 9), None);
        assert_eq!(shown("odom", "base", 20), Some((2.0, Some(Stamp(20)))));
        assert_eq!(shown("odom", "base", 99), Some((2.0, Some(Stamp(20)))));
        assert_eq!(shown("odom", "base", 200), Some((10.0, Some(Stamp(100)))));
        assert_eq!(shown("base", "camera", 0), Some((3.0, None)));
    }
}
