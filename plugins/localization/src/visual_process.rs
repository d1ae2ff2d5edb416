//! The process `visual_motion`: reads images and their depth, and sends how the vehicle has moved between them. Its port
//! table is in the crate's documentation.

use crate::proto::VisualMotionParams;
use crate::visual::{Grey, Mounted, Point, motion, points};
use rcs_geom::{CameraError, PinholeCamera, Pose};
use rcs_msg::Stamp;
use rcs_msg::foxglove::{CameraCalibration, RawImage};
use rcs_msg::image::{ImageError, depth_m, raw_to_rgb8};
use rcs_msg::rcs;
use rcs_runtime::{Cycle, In, Msg, NoCommands, Out, PortBuilder, Process, ProcessDef, Role};
use rcs_sense::{
    Axes, Extrinsics, Localizer, LocalizerError, PosePorts, SensorTime, camera_of, read_calibration,
};
use serde::{Deserialize, Serialize};

/// Images that are farther apart in time show too little of the same, s.
const LONGEST_S: f64 = 0.6;
/// An image and a depth whose times differ by at most this belong together, s.
const SAME_S: f64 = 0.002;
/// When no depth has had its image for this long, that is a fault, s.
const LONGEST_WAIT_S: f64 = 1.0;
/// Motion is searched up to this many times the greatest speed of the vehicle, which is a little faster downhill.
const FASTER: f64 = 1.15;

/// State: the poses of the last seconds, the camera, the points of the image before, and whether a depth waits for its image.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct VisualMotion {
    localizer: Localizer,
    camera: Option<PinholeCamera>,
    before: Option<Before>,
    /// While the newest depth has had no image.
    waiting: Option<Waiting>,
}

/// What the image before showed, and how the vehicle stood.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Before {
    time: Stamp,
    points: Vec<Point>,
    local_from_vehicle: Pose,
}

/// Depths without an image, one or several in a row.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
struct Waiting {
    /// When the first of them was read.
    since: Stamp,
    is_told: bool,
}

/// Ports of [`VisualMotion`].
#[derive(Debug)]
pub struct Ports {
    image: In<RawImage>,
    depth: In<RawImage>,
    calibration: In<CameraCalibration>,
    poses: PosePorts,
    motion: Out<rcs::VisualMotion>,
}

/// Why an image was skipped.
#[derive(Debug, thiserror::Error)]
enum Unusable {
    #[error("no image has come")]
    NoImage,
    #[error("the newest image and depth are {apart_s:.3} s apart, expected at most {SAME_S} s")]
    Apart { apart_s: f64 },
    #[error("no calibration")]
    NoCalibration,
    #[error("calibration: {0}")]
    Calibration(#[from] CameraError),
    #[error(
        "the calibration has a distortion, expected a rectified image; if it is, set the parameter `rectified`"
    )]
    Distorted,
    #[error(transparent)]
    Image(#[from] ImageError),
    #[error("{what} has {got:?} pixels, expected {expected:?} as the calibration")]
    Size { what: &'static str, got: [u32; 2], expected: [u32; 2] },
    #[error(transparent)]
    Pose(#[from] LocalizerError),
}

impl Process for VisualMotion {
    type Params = VisualMotionParams;
    type Ports = Ports;
    type Command = NoCommands;
    const DEF: ProcessDef = ProcessDef {
        plugin: "visual_motion",
        summary: "Tells from the images of a camera with depth how far the vehicle has moved",
        period_ms: 50.0,
        latency_ms: 4.0,
        reads_ground_truth: false,
    };

    fn ports(b: &mut PortBuilder) -> Ports {
        Ports {
            image: b.input("image", "rectified image of the camera, pixel for pixel that of the depth"),
            depth: b.input("depth", "depth image along the optical axis: 16UC1, mono16 or 32FC1"),
            calibration: b.input("calibration", "calibration of the depth image"),
            poses: PosePorts::declare(b),
            motion: b
                .output("motion", "motion of the vehicle from one image to the next one")
                .role(Role::Stats)
                .build(),
        }
    }

    fn new(_params: &VisualMotionParams) -> Self {
        Self::default()
    }

    fn cycle(&mut self, ports: &Ports, params: &VisualMotionParams, cx: &mut Cycle<'_>) {
        let extrinsics = Extrinsics::new(params.pose.as_ref(), params.mount.as_ref());
        ports.poses.read(&mut self.localizer, extrinsics.frames, cx);
        if let Some(calibration) =
            read_calibration(&ports.calibration, self.camera.is_some(), params.rectified, cx)
        {
            self.camera = match camera_of(&calibration, params.rectified) {
                Ok(camera) => Some(camera),
                Err(error) => {
                    cx.fault(Unusable::from(error).to_string());
                    None
                }
            };
        }
        // An image may come later than its depth: while it waits, the depth that was read is looked at again.
        let is_new = cx.read_newest(&ports.depth).is_some();
        let depth = cx.latest(&ports.depth).filter(|_| is_new || self.waiting.is_some());
        let Some(depth) = depth else {
            return cx.exec("waits for depth");
        };
        let image = match image_of(cx.latest(&ports.image), &depth) {
            Ok(image) => image,
            Err(error) => return self.wait(&error, cx),
        };
        self.waiting = None;
        match self.see(&image, &depth, params, extrinsics) {
            Ok(Some(motion)) => {
                cx.write(&ports.motion, depth.acq_time(), motion);
                cx.exec("tells the motion");
            }
            Ok(None) => cx.exec("images that do not tell the motion"),
            Err(error) => {
                self.before = None;
                cx.fault(format!("{error}; image skipped"));
            }
        }
    }
}

/// Motion ahead by up to this speed is searched, m/s.
fn searched_mps(params: &VisualMotionParams) -> f64 {
    params.max_speed_mps.max(FASTER * params.vehicle_speed_mps)
}

/// The newest image, if it belongs to a depth.
fn image_of(newest: Option<Msg<RawImage>>, depth: &Msg<RawImage>) -> Result<Msg<RawImage>, Unusable> {
    let image = newest.ok_or(Unusable::NoImage)?;
    let apart_s = image.acq_time().0.abs_diff(depth.acq_time().0) as f64 * 1e-9;
    if apart_s <= SAME_S { Ok(image) } else { Err(Unusable::Apart { apart_s }) }
}

impl VisualMotion {
    /// Waits for the image of the newest depth, and reports once why there is none.
    fn wait(&mut self, error: &Unusable, cx: &mut Cycle<'_>) {
        let now = cx.now();
        let waiting = self.waiting.get_or_insert(Waiting { since: now, is_told: false });
        if !waiting.is_told && now.seconds_since(waiting.since) > LONGEST_WAIT_S {
            waiting.is_told = true;
            cx.fault(format!("{error}; depths of {LONGEST_WAIT_S} s skipped"));
        }
        cx.exec("waits for the image of the depth");
    }

    /// The motion since the image before, if both tell it.
    fn see(
        &mut self,
        image: &Msg<RawImage>,
        depth: &Msg<RawImage>,
        params: &VisualMotionParams,
        extrinsics: Extrinsics<'_>,
    ) -> Result<Option<rcs::VisualMotion>, Unusable> {
        let camera = self.camera.as_ref().ok_or(Unusable::NoCalibration)?;
        let expected = [camera.width, camera.height];
        for (what, image) in [("image", image), ("depth", depth)] {
            let got = [image.width, image.height];
            if got != expected {
                return Err(Unusable::Size { what, got, expected });
            }
        }
        let rgb = raw_to_rgb8(image)?;
        let depth_m = depth_m(depth, params.depth_scale_m as f32)?;
        let time = depth.acq_time();
        let taken = SensorTime::of(depth);
        let local_from_vehicle = extrinsics.local_from_vehicle(&self.localizer, taken)?;
        let vehicle_from_camera =
            extrinsics.vehicle_from_sensor(&self.localizer, &depth.frame_id, Axes::Optical, taken)?;
        let camera = Mounted::new(camera, vehicle_from_camera).ok_or(Unusable::Distorted)?;
        let grey = Grey::of(&rgb.data, rgb.width as usize, rgb.height as usize);
        let points = points(&grey, &depth_m, &camera, params.max_range_m);
        let before = self.before.replace(Before { time, points, local_from_vehicle });
        let Some(before) =
            before.filter(|before| (0.0..LONGEST_S).contains(&time.seconds_since(before.time)))
        else {
            return Ok(None);
        };
        let turn =
            local_from_vehicle.rotation_matrix().transpose() * before.local_from_vehicle.rotation_matrix();
        let most_m = searched_mps(params) * time.seconds_since(before.time);
        let found = motion(&before.points, &grey, &camera, turn, [-0.5 * most_m, most_m]);
        Ok(found.filter(|found| found.likeness >= params.least_likeness).map(|found| rcs::VisualMotion {
            timestamp: Some(time.to_proto()),
            since: Some(before.time.to_proto()),
            forward_m: found.forward_m,
            left_m: found.left_m,
            likeness: found.likeness,
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn motion_is_searched_as_fast_as_the_vehicle_drives_and_no_less_far_for_a_slow_one() {
        let searched = |vehicle_speed_mps: f64| {
            searched_mps(&VisualMotionParams {
                max_speed_mps: 1.5,
                vehicle_speed_mps,
                ..VisualMotionParams::default()
            })
        };
        assert!(searched(5.0) > 5.0);
        // Not stated, a slow vehicle, and that of the courses.
        assert_eq!([0.0, 0.5, 1.3].map(searched), [1.5; 3]);
    }
}
