//! What both processes know of a camera and its vehicle: frames, mount, calibration, and the checks of its images.

use crate::image_check::{ImageFault, check_exposure, fingerprint};
use glam::DVec3;
use rcs_geom::{CameraError, PinholeCamera, Pose};
use rcs_msg::Stamp;
use rcs_msg::foxglove::{CameraCalibration, RawImage};
use rcs_msg::image::{ImageError, depth_m, raw_to_rgb8};
use rcs_msg::rcs::{ClassifierParams, PoseSource, TerrainLearnerParams};
use rcs_world::{FrameNames, Localizer, LocalizerError};

/// Why an image, or what belongs to it, was skipped.
#[derive(Debug, thiserror::Error)]
pub enum Unusable {
    /// No calibration has come.
    #[error("image without a calibration")]
    NoCalibration,
    /// The calibration is none.
    #[error("calibration: {0}")]
    Calibration(#[from] CameraError),
    /// The image does not read.
    #[error("{what}: {error}")]
    Image {
        /// Which of the images.
        what: &'static str,
        /// Why.
        error: ImageError,
    },
    /// The image is another camera's, or labels or depth are another image's.
    #[error("{what} has {got:?} pixels, {of} is for {expected:?}")]
    Size {
        /// Which of the images.
        what: &'static str,
        /// Width and height.
        got: [usize; 2],
        /// What it must agree with.
        of: &'static str,
        /// Width and height of that.
        expected: [usize; 2],
    },
    /// Labels are one byte a pixel.
    #[error("labels have encoding {got:?}, expected mono8")]
    LabelEncoding {
        /// What they say.
        got: String,
    },
    /// Black, saturated, frozen.
    #[error(transparent)]
    Fault(#[from] ImageFault),
    /// The pose of vehicle or camera is not known.
    #[error(transparent)]
    Pose(#[from] LocalizerError),
    /// What came is for another time than all images that are kept.
    #[error("no {what} of the time of the {of}: nearest is {} s away", shown(*.apart_s))]
    Apart {
        /// What is missing.
        what: &'static str,
        /// What it was wanted for.
        of: &'static str,
        /// Distance to the nearest; `None` where there is none at all.
        apart_s: Option<f64>,
    },
    /// A message is not newer than the one before.
    #[error("{what} of {} s is not newer than the one before, of {} s", .got.seconds_since(Stamp(0)), .newest.seconds_since(Stamp(0)))]
    Late {
        /// Which of the images.
        what: &'static str,
        /// Its time.
        got: Stamp,
        /// The newest before.
        newest: Stamp,
    },
}

fn shown(apart_s: Option<f64>) -> String {
    apart_s.map_or_else(|| "infinite".to_owned(), |apart| format!("{apart:.3}"))
}

/// Where frames and mount come from: the same parameters of both processes.
#[derive(Clone, Copy, Debug)]
pub struct Site<'a> {
    /// Names of the frames.
    pub frames: FrameNames<'a>,
    /// Whether the vehicle stands at the origin.
    pub fixed_pose: bool,
    /// Oldest pose that is used, s.
    pub max_age_s: f64,
    /// Camera on the vehicle, body axes, where it is given by parameters.
    pub vehicle_from_mount: Option<Pose>,
}

/// Makes a [`Site`] of the fields that both parameter messages have.
macro_rules! site {
    ($params:expr) => {{
        let p = $params;
        Site {
            frames: FrameNames { local: &p.local_frame, vehicle: &p.vehicle_frame, pose: &p.pose_frame },
            fixed_pose: p.pose_source() == PoseSource::PoseFixed,
            max_age_s: p.pose_max_age_s,
            vehicle_from_mount: p.mount_fixed.then(|| {
                Pose::from_rpy(
                    DVec3::new(p.mount_x_m, p.mount_y_m, p.mount_height_m),
                    p.mount_roll_deg.to_radians(),
                    p.mount_pitch_deg.to_radians(),
                    p.mount_yaw_deg.to_radians(),
                )
            }),
        }
    }};
}

impl<'a> From<&'a TerrainLearnerParams> for Site<'a> {
    fn from(params: &'a TerrainLearnerParams) -> Self {
        site!(params)
    }
}

impl<'a> From<&'a ClassifierParams> for Site<'a> {
    fn from(params: &'a ClassifierParams) -> Self {
        site!(params)
    }
}

impl Site<'_> {
    /// The vehicle in the local frame at a time.
    pub fn local_from_vehicle(&self, localizer: &Localizer, time: Stamp) -> Result<Pose, LocalizerError> {
        if self.fixed_pose {
            return Ok(Pose::IDENTITY);
        }
        localizer.local_from_vehicle(self.frames, time, self.max_age_s)
    }

    /// The camera's optical frame on the vehicle. A mount of the parameters is taken where `is_mounted`.
    pub fn vehicle_from_camera(
        &self,
        localizer: &Localizer,
        frame_id: &str,
        time: Stamp,
        is_mounted: bool,
    ) -> Result<Pose, LocalizerError> {
        match self.vehicle_from_mount.filter(|_| is_mounted) {
            Some(mount) => Ok(mount * Pose::body_from_optical()),
            None => localizer.lookup(self.frames.vehicle, frame_id, time, self.max_age_s),
        }
    }

    /// Speed (m/s) and turn rate (rad/s) over the `window_s` before a time; `None` while poses do not reach back so far.
    pub fn motion(&self, localizer: &Localizer, time: Stamp, window_s: f64) -> Option<[f64; 2]> {
        let before = Stamp(time.0.checked_sub((window_s * 1e9) as u64)?);
        let now = self.local_from_vehicle(localizer, time).ok()?;
        let then = self.local_from_vehicle(localizer, before).ok()?;
        let moved = now.translation.distance(then.translation);
        let turned = rcs_geom::wrap_angle(now.yaw() - then.yaw()).abs();
        Some([moved / window_s, turned / window_s])
    }
}

/// The camera of a calibration message.
pub fn camera_of(calibration: &CameraCalibration) -> Result<PinholeCamera, CameraError> {
    PinholeCamera::from_calibration(
        [calibration.width, calibration.height],
        &calibration.k,
        &calibration.distortion_model,
        &calibration.d,
    )
}

/// Width and height of an image, pixels.
pub fn size_of(image: &RawImage) -> [usize; 2] {
    [image.width as usize, image.height as usize]
}

/// Colours of an image that is `size` large and exposed, three bytes a pixel.
pub fn colours(image: &RawImage, size: [usize; 2], max_unexposed_pct: f64) -> Result<Vec<u8>, Unusable> {
    check_size("image", image, "its calibration", size)?;
    let rgb = raw_to_rgb8(image).map_err(|error| Unusable::Image { what: "image", error })?.data;
    check_exposure(&rgb, max_unexposed_pct)?;
    Ok(rgb)
}

/// Depths of an image that belongs to one of `size`, m, NaN where there is none.
pub fn depths(image: &RawImage, size: [usize; 2], scale_m: f64) -> Result<Vec<f32>, Unusable> {
    check_size("depth", image, "its image", size)?;
    depth_m(image, scale_m as f32).map_err(|error| Unusable::Image { what: "depth", error })
}

/// Labels of an image that belongs to one of `size`.
pub fn labels(image: &RawImage, size: [usize; 2]) -> Result<Vec<u8>, Unusable> {
    check_size("label image", image, "its image", size)?;
    if !matches!(image.encoding.as_str(), "mono8" | "8UC1") {
        return Err(Unusable::LabelEncoding { got: image.encoding.clone() });
    }
    let rgb = raw_to_rgb8(image).map_err(|error| Unusable::Image { what: "label image", error })?.data;
    Ok(rgb.as_chunks::<3>().0.iter().map(|pixel| pixel[0]).collect())
}

fn check_size(
    what: &'static str,
    image: &RawImage,
    of: &'static str,
    expected: [usize; 2],
) -> Result<(), Unusable> {
    let got = size_of(image);
    if got == expected { Ok(()) } else { Err(Unusable::Size { what, got, of, expected }) }
}

/// Whether an image equals the one before it; keeps its fingerprint for the next.
pub fn check_frozen(image: &RawImage, last: &mut Option<u64>) -> Result<(), ImageFault> {
    let print = fingerprint(&image.data);
    let is_frozen = last.replace(print) == Some(print);
    if is_frozen { Err(ImageFault::Frozen) } else { Ok(()) }
}
