//! An example for processes that learn, which a person outlines on the map. Positions are in the frame of the map, m.

use super::outline::corner;
use rcs_geom::{DVec3, Pose};
use rcs_msg::rcs::{ExampleKind, PlanePoint, PlanePolygon, TrainingExample};
use rcs_runtime::source::Frame;

/// An example that has not been sent.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Example {
    /// Whether it is ground; else it is an obstacle.
    pub(super) is_ground: bool,
    /// Corners of the outline while it is open.
    pub(super) corners: Vec<[f64; 2]>,
    /// The closed outline.
    pub(super) outline: Vec<[f64; 2]>,
    /// Examples that were sent since the drawing began.
    pub(super) sent: usize,
}

impl Example {
    /// Adds a corner, or closes the outline if the corner is within `reach_m` of the first one.
    pub(super) fn click(&mut self, at: [f64; 2], reach_m: f64) {
        self.outline.clear();
        if let Some(outline) = corner(&mut self.corners, at, reach_m) {
            self.outline = outline;
        }
    }

    /// Takes the last click back.
    pub(super) fn undo(&mut self) {
        if self.outline.is_empty() {
            self.corners.pop();
        } else {
            self.corners = std::mem::take(&mut self.outline);
        }
    }

    /// The run to which examples were sent has ended. What is drawn stays.
    pub(crate) fn forget_sent(&mut self) {
        self.sent = 0;
    }

    /// The message in the frame `target`.
    pub(super) fn message(&self, frame: &Frame, target: &str, target_from_map: &Pose) -> TrainingExample {
        let point = |at: &[f64; 2]| {
            let p = *target_from_map * DVec3::new(at[0], at[1], 0.0);
            PlanePoint { x_m: p.x, y_m: p.y }
        };
        let kind = if self.is_ground { ExampleKind::ExampleGround } else { ExampleKind::ExampleObstacle };
        TrainingExample {
            timestamp: Some(frame.now.to_proto()),
            frame_id: target.to_owned(),
            kind: kind.into(),
            outline: Some(PlanePolygon { points: self.outline.iter().map(point).collect() }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_corner_closes_the_outline_and_another_click_begins_anew() {
        let mut example = Example::default();
        for at in [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0]] {
            example.click(at, 0.5);
        }
        example.undo();
        example.click([0.1, 0.1], 0.5);
        assert_eq!((example.corners.len(), example.outline.len()), (2, 0), "two corners are no outline");
        example.click([4.0, 3.0], 0.5);
        example.click([0.1, 0.1], 0.5);
        assert_eq!((example.corners.len(), example.outline.len()), (0, 3));
        example.undo();
        assert_eq!((example.corners.len(), example.outline.len()), (3, 0), "the outline is open again");
        example.click([0.1, 0.1], 0.5);
        example.click([9.0, 9.0], 0.5);
        assert_eq!((example.corners.len(), example.outline.len()), (1, 0));
    }
}
