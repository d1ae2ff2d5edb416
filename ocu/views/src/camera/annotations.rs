//! Shapes on an image: `foxglove.ImageAnnotations`.

use crate::canvas::Viewport;
use egui::{Align2, Color32, FontId, Painter, Pos2, Rect, Shape, Stroke};
use rcs_msg::foxglove::points_annotation::Type;
use rcs_msg::foxglove::{self, CircleAnnotation, ImageAnnotations, Point2, PointsAnnotation};

/// Maximum number of points drawn for one message, so that a message of millions does not block the window.
const MOST_POINTS: usize = 20_000;

/// Maximum number of letters drawn for one text.
const MOST_LETTERS: usize = 200;
/// Lengths on the screen are clamped to this, because more would not be visible.
const LONGEST: f64 = 1e5;

/// Coordinates and lengths beyond this cannot be those of an image, px.
const FARTHEST_PX: f64 = 1e6;

/// Draws all shapes; their coordinates are pixels of the image, measured from the corner of its first pixel. Returns the
/// number of points and lengths that cannot be, which are left out. A coordinate that is NaN is an absent one.
pub(super) fn paint(
    painter: &Painter,
    shapes: &ImageAnnotations,
    viewport: Viewport,
    canvas: Rect,
    opacity: f32,
) -> usize {
    // Twice the opacity of other overlays, because lines cover little of the image.
    let opacity = (opacity * 2.0).min(1.0);
    let look = Look { viewport, canvas, opacity };
    let mut left = MOST_POINTS;
    for annotation in &shapes.points {
        let count = annotation.points.len().min(left);
        left -= count;
        look.points(painter, annotation, count);
    }
    for circle in shapes.circles.iter().take(left).filter(|circle| !beyond(circle.diameter)) {
        let Some(center) = circle.position.as_ref().and_then(|point| look.at(point)) else { continue };
        let radius = look.length(circle.diameter / 2.0);
        painter.circle(
            center,
            radius,
            look.fill(circle.fill_color),
            look.stroke(circle.thickness, circle.outline_color),
        );
    }
    for text in shapes.texts.iter().take(left) {
        let Some(at) = text.position.as_ref().and_then(|point| look.at(point)) else { continue };
        let size = look.length(text.font_size).clamp(8.0, 48.0);
        let color = look.ink(text.text_color);
        let shown: String = text.text.chars().take(MOST_LETTERS).collect();
        let galley = painter.layout_no_wrap(shown, FontId::proportional(size), color);
        let plate = Align2::LEFT_BOTTOM.anchor_size(at, galley.size());
        painter.rect_filled(plate, 0.0, look.fill(text.background_color));
        painter.galley(plate.min, galley, color);
    }
    implausible(shapes)
}

/// Whether a coordinate or a length is finite or infinite, and cannot be.
fn beyond(pixels: f64) -> bool {
    pixels.abs() > FARTHEST_PX
}

fn implausible(shapes: &ImageAnnotations) -> usize {
    let point = |point: &Point2| beyond(point.x) || beyond(point.y);
    let points = shapes.points.iter().flat_map(|annotation| &annotation.points).take(MOST_POINTS);
    let texts = shapes.texts.iter().take(MOST_POINTS).filter_map(|text| text.position.as_ref());
    let circle =
        |circle: &&CircleAnnotation| beyond(circle.diameter) || circle.position.as_ref().is_some_and(point);
    let circles = shapes.circles.iter().take(MOST_POINTS).filter(circle);
    points.chain(texts).filter(|it| point(it)).count() + circles.count()
}

/// Position on the screen, and opacity.
struct Look {
    viewport: Viewport,
    canvas: Rect,
    opacity: f32,
}

impl Look {
    /// `None` where a coordinate cannot be.
    fn at(&self, point: &Point2) -> Option<Pos2> {
        let is_place = point.x.abs() <= FARTHEST_PX && point.y.abs() <= FARTHEST_PX;
        is_place.then(|| self.viewport.to_screen(self.canvas, [point.x, point.y]))
    }

    fn length(&self, pixels: f64) -> f32 {
        if pixels.is_finite() { (pixels.max(0.0) * self.viewport.scale).min(LONGEST) as f32 } else { 0.0 }
    }

    /// Fill colour; transparent where none is given.
    fn fill(&self, color: Option<foxglove::Color>) -> Color32 {
        color.map_or(Color32::TRANSPARENT, |color| to_color(color).gamma_multiply(self.opacity))
    }

    /// Line colour; where none is given, one that is visible on any image.
    fn ink(&self, color: Option<foxglove::Color>) -> Color32 {
        let color = color.map(to_color).filter(|color| color.a() > 0);
        color.unwrap_or(Color32::from_rgb(0x5a, 0xe0, 0xff)).gamma_multiply(self.opacity)
    }

    fn stroke(&self, thickness: f64, color: Option<foxglove::Color>) -> Stroke {
        Stroke::new(self.length(thickness).clamp(1.0, 8.0), self.ink(color))
    }

    fn points(&self, painter: &Painter, annotation: &PointsAnnotation, count: usize) {
        let points: Vec<Pos2> =
            annotation.points[..count].iter().filter_map(|point| self.at(point)).collect();
        let stroke = self.stroke(annotation.thickness, annotation.outline_color);
        let color = |index: usize| match annotation.outline_colors.get(index) {
            Some(&color) => self.ink(Some(color)),
            None => stroke.color,
        };
        match annotation.r#type() {
            Type::LineLoop => {
                let fill = self.fill(annotation.fill_color);
                if fill.a() > 0 && points.len() >= 3 {
                    painter.add(Shape::Path(egui::epaint::PathShape {
                        points: points.clone(),
                        closed: true,
                        fill,
                        stroke: egui::epaint::PathStroke::NONE,
                    }));
                }
                painter.add(Shape::closed_line(points, stroke));
            }
            Type::LineStrip => {
                painter.add(Shape::line(points, stroke));
            }
            Type::LineList => {
                for (index, ends) in points.as_chunks::<2>().0.iter().enumerate() {
                    painter.line_segment(*ends, Stroke::new(stroke.width, color(index)));
                }
            }
            Type::Points | Type::Unknown => {
                let radius = (self.length(annotation.thickness) / 2.0).max(1.0);
                for (index, point) in points.iter().enumerate() {
                    painter.circle_filled(*point, radius, color(index));
                }
            }
        }
    }
}

fn to_color(color: foxglove::Color) -> Color32 {
    let byte = |part: f64| (part.clamp(0.0, 1.0) * 255.0).round() as u8;
    Color32::from_rgba_unmultiplied(byte(color.r), byte(color.g), byte(color.b), byte(color.a))
}
