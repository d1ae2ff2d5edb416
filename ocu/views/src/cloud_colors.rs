//! The colours of the points of a cloud.

use egui::Color32;
use ocu_ui::palette;
use rcs_msg::Point;

/// Heights that differ by less are one, as those of a scanner that turns in a plane, m.
const FLAT_M: f64 = 0.02;
/// Most points from which a range is computed.
const MOST: usize = 20_000;

/// By what the points of a cloud are coloured; ranges are from the 2nd to the 98th percentile.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum CloudColors {
    /// Their own colours.
    Own,
    /// Height, m.
    Height([f64; 2]),
    /// Strength of the return, in the scale of the sensor.
    Intensity([f64; 2]),
    /// One colour.
    Plain,
}

impl CloudColors {
    /// Of points in the frame in which heights count.
    pub(crate) fn of(points: &[Point]) -> Self {
        if points.iter().any(|point| point.rgb.is_some()) {
            return Self::Own;
        }
        if let Some([low, high]) = range(points, |point| Some(point.position.z))
            && high - low >= FLAT_M
        {
            return Self::Height([low, high]);
        }
        match range(points, |point| point.intensity.map(f64::from)) {
            Some([low, high]) if low < high => Self::Intensity([low, high]),
            _ => Self::Plain,
        }
    }

    /// The colour of a point.
    pub(crate) fn at(self, point: &Point) -> Color32 {
        let part = |value: f64, [low, high]: [f64; 2]| (value - low) / (high - low);
        let color = match self {
            Self::Own => point.rgb.map(|[r, g, b]| Color32::from_rgb(r, g, b)),
            Self::Height(range) => Some(palette::even(part(point.position.z, range))),
            Self::Intensity(range) => {
                let intensity = point.intensity.filter(|intensity| intensity.is_finite());
                intensity.map(|intensity| intensity_color(part(intensity.into(), range)))
            }
            Self::Plain => None,
        };
        // It is seen on light and on dark grounds.
        color.unwrap_or_else(|| palette::even(0.5))
    }
}

/// The colour of an intensity, 0 to 1: weak returns of a flat scan are its only points there, and must not be dark.
pub(crate) fn intensity_color(part: f64) -> Color32 {
    palette::even(0.35 + 0.65 * part.clamp(0.0, 1.0))
}

/// The 2nd and the 98th percentile of finite values; `None` if there are none.
pub(crate) fn range(points: &[Point], value: impl Fn(&Point) -> Option<f64>) -> Option<[f64; 2]> {
    let every = (points.len() / MOST).max(1);
    let values = points.iter().step_by(every).filter_map(value);
    let mut values: Vec<f64> = values.filter(|value| value.is_finite()).collect();
    values.sort_by(f64::total_cmp);
    let last = values.len().checked_sub(1)? as f64;
    Some([(0.02 * last).floor(), (0.98 * last).ceil()].map(|index| values[index as usize]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcs_geom::DVec3;

    fn points(height_m: f64, intensity: Option<f32>, rgb: Option<[u8; 3]>) -> Vec<Point> {
        let point = |index: i32| {
            let part = f64::from(index) / 100.0;
            let intensity = intensity.map(|greatest| greatest * part as f32);
            Point { position: DVec3::new(part, 0.0, height_m * part), rgb, intensity }
        };
        (0..=100).map(point).collect()
    }

    #[test]
    fn a_cloud_has_its_own_colours_else_those_of_height_and_a_flat_one_those_of_intensity() {
        let colors = |points: &[Point]| CloudColors::of(points);
        assert_eq!(colors(&points(3.0, Some(9.0), Some([1, 2, 3]))), CloudColors::Own);
        assert_eq!(colors(&points(3.0, Some(9.0), None)), CloudColors::Height([0.06, 2.94]));
        assert!(matches!(colors(&points(0.001, Some(9.0), None)), CloudColors::Intensity(_)));
        assert_eq!(colors(&points(0.001, Some(0.0), None)), CloudColors::Plain);
        assert_eq!(colors(&points(0.0, None, None)), CloudColors::Plain);
        assert_eq!(colors(&[]), CloudColors::Plain);
    }

    #[test]
    fn no_point_of_a_flat_scan_is_dark() {
        for all in [points(0.0, None, None), points(0.0, Some(50.0), None), points(0.0, Some(f32::NAN), None)]
        {
            let colors = CloudColors::of(&all);
            let brightest = all.iter().map(|point| {
                let color = colors.at(point);
                color.r().max(color.g()).max(color.b())
            });
            assert!(brightest.min().is_some_and(|least| least > 120), "{colors:?}");
        }
    }
}
