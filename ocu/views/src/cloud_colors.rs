//! The colours of the points of a cloud.

use crate::clip::is_place;
use crate::cloud_look::{DISTANCE, HEIGHT, ONE, OWN, field};
use egui::Color32;
use ocu_ui::palette;
use rcs_geom::{DVec3, Pose};
use rcs_msg::foxglove::PointCloud;
use rcs_msg::{Point, points};

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
    /// The numbers of a chosen field, or the distance from the origin of the cloud, m.
    Value([f64; 2]),
    /// One colour.
    Plain,
}

impl CloudColors {
    /// What suits points in the frame in which heights count.
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

    /// The colour of a point, and of its number where numbers are coloured.
    fn at(self, point: &Point, number: Option<f64>) -> Color32 {
        // Numbers that are all equal are in the middle of the scale.
        let part =
            |value: f64, [low, high]: [f64; 2]| if low < high { (value - low) / (high - low) } else { 0.5 };
        let color = match self {
            Self::Own => point.rgb.map(|[r, g, b]| Color32::from_rgb(r, g, b)),
            Self::Height(range) => Some(palette::even(part(point.position.z, range))),
            Self::Intensity(range) => {
                let intensity = point.intensity.filter(|intensity| intensity.is_finite());
                intensity.map(|intensity| intensity_color(part(intensity.into(), range)))
            }
            Self::Value(range) => {
                number.filter(|number| number.is_finite()).map(|number| palette::even(part(number, range)))
            }
            Self::Plain => None,
        };
        // It is seen on light and on dark grounds.
        color.unwrap_or_else(|| palette::even(0.5))
    }
}

/// The plausible points of a cloud with their colours.
pub(crate) struct Colored {
    pub(crate) points: Vec<(DVec3, Color32)>,
    /// By what they are coloured.
    pub(crate) colors: CloudColors,
    /// Number of implausible points, such as missing returns of a scanner.
    pub(crate) far: usize,
}

impl Colored {
    /// Reads a cloud and colours its points by what was chosen ([`crate::cloud_look::choices`]); the error says why it
    /// cannot be read. What suits the cloud counts for `None`, and where the cloud does not have what was chosen.
    pub(crate) fn new(
        cloud: &PointCloud,
        target_from_frame: &Pose,
        by: Option<&str>,
    ) -> Result<Self, String> {
        let target_from_cloud = *target_from_frame * crate::pose::from_message(cloud.pose.as_ref())?;
        let read = points(cloud).map_err(|error| error.to_string())?;
        let numbers: Option<Vec<f64>> = match by {
            Some(DISTANCE) => Some(read.iter().map(|point| point.position.length()).collect()),
            Some(name) => field(cloud, name).and_then(|field| read.values(field)),
            None => None,
        };
        let (mut all, mut kept, mut far) = (Vec::with_capacity(read.len()), Vec::new(), 0);
        for (index, point) in read.iter().enumerate() {
            let position = target_from_cloud * point.position;
            if !position.is_finite() {
                continue;
            }
            if !is_place(&position.to_array()) {
                far += 1;
                continue;
            }
            all.push(Point { position, ..point });
            kept.extend(numbers.as_ref().and_then(|numbers| numbers.get(index).copied()));
        }
        let chosen = match by {
            Some(HEIGHT) => range(&all, |point| Some(point.position.z)).map(CloudColors::Height),
            Some(OWN) => read.has_colours().then_some(CloudColors::Own),
            Some(ONE) => Some(CloudColors::Plain),
            _ => range(&kept, |number| Some(*number)).map(CloudColors::Value),
        };
        let colors = chosen.unwrap_or_else(|| CloudColors::of(&all));
        let colored = all.iter().enumerate();
        let colored =
            colored.map(|(index, point)| (point.position, colors.at(point, kept.get(index).copied())));
        Ok(Self { points: colored.collect(), colors, far })
    }
}

/// The colour of an intensity, 0 to 1: weak returns of a flat scan are its only points there, and must not be dark.
pub(crate) fn intensity_color(part: f64) -> Color32 {
    palette::even(0.35 + 0.65 * part.clamp(0.0, 1.0))
}

/// The 2nd and the 98th percentile of finite values; `None` if there are none.
pub(crate) fn range<T>(items: &[T], value: impl Fn(&T) -> Option<f64>) -> Option<[f64; 2]> {
    let every = (items.len() / MOST).max(1);
    let values = items.iter().step_by(every).filter_map(value);
    let mut values: Vec<f64> = values.filter(|value| value.is_finite()).collect();
    values.sort_by(f64::total_cmp);
    let last = values.len().checked_sub(1)? as f64;
    Some([(0.02 * last).floor(), (0.98 * last).ceil()].map(|index| values[index as usize]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples;
    use rcs_msg::foxglove::PackedElementField;
    use rcs_msg::foxglove::packed_element_field::NumericType;

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
    fn a_cloud_is_coloured_by_what_was_chosen_and_by_what_suits_it_where_it_lacks_that() {
        let mut cloud = samples::cloud(&[[3.0, 4.0, 0.0], [0.0, 0.0, 10.0]]);
        let ring =
            PackedElementField { name: "ring".to_owned(), offset: 12, r#type: NumericType::Uint8.into() };
        cloud.fields.push(ring);
        cloud.point_stride = 13;
        let data: Vec<Vec<u8>> =
            cloud.data.chunks(12).zip([9, 1]).map(|(point, ring)| [point, &[ring]].concat()).collect();
        cloud.data = data.concat().into();
        let colored = |by: Option<&str>| {
            let colored = Colored::new(&cloud, &Pose::from_xy_yaw(50.0, 0.0, 0.0), by).unwrap();
            (colored.colors, colored.points.into_iter().map(|(_, color)| color).collect::<Vec<_>>())
        };
        let [low, high] = [0.0, 1.0].map(palette::even);
        assert_eq!(colored(None), (CloudColors::Height([0.0, 10.0]), vec![low, high]));
        assert_eq!(colored(Some(HEIGHT)), colored(None));
        assert_eq!(colored(Some("ring")), (CloudColors::Value([1.0, 9.0]), vec![high, low]));
        assert_eq!(colored(Some(DISTANCE)), (CloudColors::Value([5.0, 10.0]), vec![low, high]));
        assert_eq!(colored(Some(ONE)).0, CloudColors::Plain);
        for absent in [OWN, "reflectivity"] {
            assert_eq!(colored(Some(absent)), colored(None), "{absent}");
        }
    }

    #[test]
    fn no_point_of_a_flat_scan_is_dark() {
        for all in [points(0.0, None, None), points(0.0, Some(50.0), None), points(0.0, Some(f32::NAN), None)]
        {
            let colors = CloudColors::of(&all);
            let brightest = all.iter().map(|point| {
                let color = colors.at(point, None);
                color.r().max(color.g()).max(color.b())
            });
            assert!(brightest.min().is_some_and(|least| least > 120), "{colors:?}");
        }
    }
}
