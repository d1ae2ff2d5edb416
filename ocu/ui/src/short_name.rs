//! Names that are shortened to the room that they have, so that they can still be told from each other.

use egui::text::LayoutJob;
use egui::{
    Align, Align2, Color32, FontId, Galley, Painter, Rect, Response, Role, Sense, TextStyle, Ui, WidgetInfo,
};
use std::sync::Arc;

/// Number of characters after the first one that differs from another name that are shown, where there is room.
const SHOWN: usize = 2;

/// A name in at most `most` characters. It is elided in the middle; where that looks like one of `others`, elsewhere,
/// so that the part that differs stays.
pub fn shortened(name: &str, others: &[&str], most: usize) -> String {
    let letters: Vec<char> = name.chars().collect();
    if letters.len() <= most {
        return name.to_owned();
    }
    let room = most.saturating_sub(1);
    let part = |range: std::ops::Range<usize>| letters[range].iter().collect::<String>();
    let elided = |head: usize| {
        let (start, end) = (part(0..head), part(letters.len() - (room - head)..letters.len()));
        format!("{start}…{end}")
    };
    let middle = room.div_ceil(2);
    let is_alike = |other: &str, head: usize| {
        let tail = (room - head).saturating_sub(SHOWN);
        is_alike(&letters, other, head.saturating_sub(SHOWN), tail, most)
    };
    let is_told = |head: &usize| !others.iter().any(|other| is_alike(other, *head));
    let mut heads: Vec<usize> = (0..=room).collect();
    heads.sort_by_key(|head| head.abs_diff(middle));
    if let Some(head) = heads.into_iter().find(is_told) {
        return elided(head);
    }
    // They differ neither at the beginning nor at the end. The window has dots on both sides.
    let window = room.saturating_sub(1);
    let alike = others.iter().filter(|other| is_alike(other, middle));
    let common = alike.map(|other| letters.iter().zip(other.chars()).take_while(|(a, b)| **a == *b).count());
    let start = common.min().unwrap_or_default().saturating_sub(SHOWN);
    if window <= SHOWN || start == 0 || start + window >= letters.len() {
        return elided(middle);
    }
    format!("…{}…", part(start..start + window))
}

/// Whether another name that is also longer than `most` characters has the same beginning and the same end.
fn is_alike(letters: &[char], other: &str, head: usize, tail: usize, most: usize) -> bool {
    let end = letters[letters.len() - tail..].iter().rev().copied();
    other.chars().take(head).eq(letters[..head].iter().copied())
        && other.chars().rev().take(tail).eq(end)
        && other.chars().nth(most).is_some()
        && !other.chars().eq(letters.iter().copied())
}

/// A name in one line, [`shortened`] where it is wider than `width`.
pub fn galley(
    painter: &Painter,
    name: &str,
    others: &[&str],
    font: &FontId,
    color: Color32,
    width: f32,
) -> Arc<Galley> {
    let in_line = |text: String| painter.layout_job(LayoutJob::simple_singleline(text, font.clone(), color));
    let whole = in_line(name.to_owned());
    if name.is_empty() || whole.size().x <= width {
        return whole;
    }
    // The mean width of a character gives a first estimate.
    let mut most = (name.chars().count() as f32 * width / whole.size().x) as usize;
    loop {
        let shown = in_line(shortened(name, others, most));
        if most <= 1 || shown.size().x <= width {
            return shown;
        }
        most -= 1;
    }
}

/// A label with a name, [`shortened`] to the room that is left in its row. Where it is shortened, the pointer shows it
/// whole.
pub fn label(ui: &mut Ui, name: &str, others: &[&str]) -> Response {
    let font = TextStyle::Body.resolve(ui.style());
    let color = ui.visuals().text_color();
    let galley = galley(ui.painter(), name, others, &font, color, ui.available_width());
    let (rect, response) = ui.allocate_exact_size(galley.size(), Sense::hover());
    ui.painter().galley(rect.min, Arc::clone(&galley), color);
    with_name(response, name, &galley)
}

/// Names a widget for screen readers, and for the pointer where its text does not show the whole name.
pub(crate) fn with_name(response: Response, name: &str, shown: &Galley) -> Response {
    response.widget_info(|| WidgetInfo::labeled(Role::Label, true, name));
    if shown.text() == name { response } else { response.on_hover_text(name) }
}

/// A table cell with a name, [`shortened`] to the width of the cell, painted without a widget of its own.
pub fn cell(
    painter: &Painter,
    rect: Rect,
    align: Align,
    name: &str,
    others: &[&str],
    font: &FontId,
    color: Color32,
) {
    let galley = galley(painter, name, others, font, color, rect.width());
    let anchor = match align {
        Align::Min => Align2::LEFT_CENTER,
        Align::Center => Align2::CENTER_CENTER,
        Align::Max => Align2::RIGHT_CENTER,
    };
    let at = anchor.align_size_within_rect(galley.size(), rect);
    painter.galley(at.min, galley, color);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_elided_in_the_middle() {
        for (most, expected) in [
            (18, "waypoint_generator"),
            (17, "waypoint…enerator"),
            (11, "waypo…rator"),
            (2, "w…"),
            (1, "…"),
            (0, "…"),
        ] {
            assert_eq!(shortened("waypoint_generator", &[], most), expected);
        }
        assert_eq!(shortened("größe_in_metern", &[], 5), "gr…rn");
        assert_eq!(shortened("", &[""], 0), "");
    }

    #[test]
    fn names_with_a_common_beginning_or_end_differ_after_they_are_shortened() {
        let groups: [(usize, &[&str]); 6] = [
            (7, &["waypoint_generator", "waypoint_follower", "obstacles_left", "obstacles_right"]),
            (9, &["classifier_left", "classifier_right", "prediction_left", "prediction_right"]),
            (
                17,
                &[
                    "accel_with_covariance",
                    "accel_with_covariance_stamped",
                    "pose_with_covariance",
                    "pose_with_covariance_stamped",
                    "twist_with_covariance_stamped",
                ],
            ),
            (17, &["/test/geometry_msgs/pose_stamped", "/test/geometry_msgs/pose_with_covariance_stamped"]),
            (12, &["/sensors/lidar/left/points/filtered", "/sensors/lidar/right/points/filtered"]),
            (10, &["/waypoint_generator/arcs", "/waypoint_follower/arcs", "/waypoint_follower/drive"]),
        ];
        for (most, names) in groups {
            let mut shown: Vec<String> = names.iter().map(|name| shortened(name, names, most)).collect();
            assert!(shown.iter().all(|name| name.chars().count() <= most), "{shown:?}");
            shown.sort();
            shown.dedup();
            assert_eq!(shown.len(), names.len(), "{shown:?}");
        }
    }

    #[test]
    fn the_part_that_differs_is_shown_where_it_is_in_between() {
        let names = ["/sensors/lidar/left/points/filtered", "/sensors/lidar/right/points/filtered"];
        let shown = names.map(|name| shortened(name, &names, 12));
        assert_eq!(shown, ["…r/left/poi…", "…r/right/po…"]);
    }
}
