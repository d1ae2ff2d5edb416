//! The vehicle whose arcs are judged: what is given of it, else what the vehicle file of the recorded run says.
//!
//! The cameras of a vehicle file are taken as one eye. It is as high as the lowest of them, and its angle of view is the
//! one that their images cover together without a gap, as far to the left of straight ahead as to the right. Their pitch
//! and the distortion of their lenses are ignored, and so are ladars.

use super::{Settings, is_of};
use crate::EvalError;
use rcs_log::{CursorOptions, Log, LogTopic};
use rcs_msg::AnyMessage;
use rcs_msg::rcs::RunInfo;
use rcs_sim::spec::{CameraSpec, VehicleSpec};

/// What is known of a vehicle; `None` where nothing is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Vehicle {
    /// Width, m.
    pub width_m: Option<f64>,
    /// Distance of the front ahead of the origin of the vehicle's frame, m.
    pub front_m: Option<f64>,
    /// Angle of view of all cameras together, half of it to either side of straight ahead, rad.
    pub view_rad: Option<f64>,
    /// Height of the cameras above the ground, m.
    pub eye_height_m: Option<f64>,
}

impl Vehicle {
    /// The vehicle of a recorded run, from the vehicle file in the run's identity. Nothing is known of one without such a
    /// file, or with one that cannot be used, which is a warning.
    pub(super) fn recorded(log: &Log) -> Result<Vehicle, EvalError> {
        let is_run = |topic: &&LogTopic| is_of::<RunInfo>(topic);
        let Some(topic) = log.info().topics.iter().find(is_run) else { return Ok(Vehicle::default()) };
        let options = CursorOptions { topics: Some(vec![topic.id]), ..CursorOptions::default() };
        let Some(first) = log.cursor(options).next().transpose()? else { return Ok(Vehicle::default()) };
        let run = AnyMessage::encoded(topic.schema.clone(), first.data).to::<RunInfo>().unwrap_or_default();
        let Some(file) = run.files.iter().find(|file| file.kind == "vehicle") else {
            return Ok(Vehicle::default());
        };
        Ok(match VehicleSpec::from_toml(&file.text) {
            Ok(spec) => Vehicle::of(&spec),
            Err(error) => {
                tracing::warn!("the vehicle file of the recorded run cannot be used: {error}");
                Vehicle::default()
            }
        })
    }

    fn of(spec: &VehicleSpec) -> Vehicle {
        let spans: Vec<[f64; 2]> = spec.cameras.iter().map(span).collect();
        let mirrored: Vec<[f64; 2]> = spans.iter().map(|&[right, left]| [-left, -right]).collect();
        let half_rad = reach(&spans).min(reach(&mirrored));
        Vehicle {
            width_m: Some(spec.body.width_m),
            front_m: Some(spec.body.front_m),
            view_rad: (half_rad > 0.0).then_some(2.0 * half_rad),
            eye_height_m: spec.cameras.iter().map(|camera| camera.mount.position.z).reduce(f64::min),
        }
    }

    /// This vehicle; what is not known of it is as in another one.
    pub(super) fn or(self, other: Vehicle) -> Vehicle {
        Vehicle {
            width_m: self.width_m.or(other.width_m),
            front_m: self.front_m.or(other.front_m),
            view_rad: self.view_rad.or(other.view_rad),
            eye_height_m: self.eye_height_m.or(other.eye_height_m),
        }
    }

    /// Settings for this vehicle; what is not known of it stays as it is.
    pub(super) fn settings(self, settings: &Settings) -> Settings {
        Settings {
            width_m: self.width_m.unwrap_or(settings.width_m),
            front_m: self.front_m.unwrap_or(settings.front_m),
            view_rad: self.view_rad.unwrap_or(settings.view_rad),
            eye_height_m: self.eye_height_m.unwrap_or(settings.eye_height_m),
            ..settings.clone()
        }
    }
}

/// Right and left edge of the image of a camera, or of the middle one of a pair: angles to the left of straight ahead, rad.
fn span(camera: &CameraSpec) -> [f64; 2] {
    let half_rad = libm::atan(0.5 * f64::from(camera.lens.width) / camera.lens.fx);
    [camera.mount.yaw_rad - half_rad, camera.mount.yaw_rad + half_rad]
}

/// How far to the left of straight ahead spans cover every direction, rad; 0 where they do not cover straight ahead.
fn reach(spans: &[[f64; 2]]) -> f64 {
    let mut reach_rad = 0.0;
    loop {
        let adjoining = spans.iter().filter(|[right, _]| *right <= reach_rad);
        let farther_rad = adjoining.map(|&[_, left]| left).fold(reach_rad, f64::max);
        if farther_rad <= reach_rad {
            return reach_rad;
        }
        reach_rad = farther_rad;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcs_log::{LogWriter, WriteHeader, WriterOptions};
    use rcs_msg::rcs::RunFile;
    use rcs_msg::{Stamp, schema_of};
    use std::collections::BTreeMap;

    /// The vehicle of a recorded run with this text of a vehicle file.
    fn recorded(text: &str) -> Vehicle {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.mcap");
        let mut writer = LogWriter::create(&path, WriterOptions::default()).unwrap();
        let channel = writer.add_channel("/runtime/run", schema_of::<RunInfo>(), &BTreeMap::new()).unwrap();
        let file = |kind: &str, text: &str| RunFile { kind: kind.to_owned(), text: text.to_owned() };
        let files = vec![file("world", "format = 1"), file("vehicle", text)];
        let run = AnyMessage::new(RunInfo { files, ..RunInfo::default() });
        let header = WriteHeader { sequence: 1, log_time: Stamp(1), publish_time: Stamp(1) };
        writer.write(channel, header, &run.bytes()).unwrap();
        writer.finish().unwrap();
        Vehicle::recorded(&Log::open(&path).unwrap()).unwrap()
    }

    fn bundled(name: &str) -> String {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/vehicles");
        std::fs::read_to_string(format!("{folder}/{name}.toml")).unwrap()
    }

    #[test]
    fn arcs_and_eye_are_those_of_the_recorded_vehicle_unless_others_are_given() {
        let settings = |vehicle: Vehicle| {
            let Settings { width_m, front_m, view_rad, eye_height_m, .. } =
                vehicle.settings(&Settings::default());
            [width_m, front_m, view_rad.to_degrees(), eye_height_m].map(|value| (1e6 * value).round() / 1e6)
        };
        let lagr = recorded(&bundled("lagr"));
        assert_eq!(settings(lagr), [0.66, 0.24, 118.0, 0.95]);
        let tractor = recorded(&bundled("tractor"));
        assert_eq!(settings(tractor), [2.0, 3.1, 60.0, 2.7]);
        let given = Vehicle { view_rad: Some(1.0_f64.to_radians()), ..Vehicle::default() };
        assert_eq!(settings(given.or(tractor)), [2.0, 3.1, 1.0, 2.7]);
        // Nothing is known of it.
        let unknown = recorded("format = 1");
        assert_eq!(unknown, Vehicle::default());
        assert_eq!(settings(unknown), [0.7, 0.24, 100.0, 0.95]);
    }

    #[test]
    fn the_view_ends_at_a_gap_between_cameras_and_is_the_same_to_both_sides() {
        let check = |spans: &[[f64; 2]], expected: f64| assert_eq!(reach(spans), expected, "{spans:?}");
        check(&[], 0.0);
        check(&[[-0.3, 0.5]], 0.5);
        check(&[[0.4, 1.0], [-0.3, 0.5]], 1.0);
        check(&[[0.6, 1.0], [-0.3, 0.5]], 0.5);
        check(&[[0.1, 1.0]], 0.0);
        check(&[[-1.0, -0.1]], 0.0);
    }
}
