//! One camera of the learner: matches its images, labels and depth by time, and converts a frame to points in cells.

use crate::appearance::RatioBins;
use crate::frame::{Gathered, LabelledFrame, Rays, Spot, Window, gather, spots, strips};
use crate::proto::TerrainLearnerParams;
use crate::sync::{Recent, not_ahead};
use crate::texture::PaddedGrey;
use crate::unusable::{Unusable, depths, labels};
use rcs_geom::{PinholeCamera, Pose};
use rcs_msg::Stamp;
use rcs_msg::classes::OBSTACLE_CLASSES;
use rcs_msg::foxglove::{CameraCalibration, RawImage};
use rcs_runtime::{Cycle, In, Out, PortBuilder, Role};
use rcs_sense::{ClockWatch, Extrinsics, ImageCheck, Rgb, SAMPLE_PX, Sample, camera_of, read_calibration};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Ports of one camera.
#[derive(Debug)]
pub(crate) struct CameraPorts {
    image: In<RawImage>,
    labels: In<RawImage>,
    depth: In<RawImage>,
    calibration: In<CameraCalibration>,
}

impl CameraPorts {
    /// Declares the ports of the left camera.
    pub(crate) fn left(b: &mut PortBuilder) -> CameraPorts {
        CameraPorts {
            image: b.optional_input("left_image", "colour image of the left camera"),
            labels: b.optional_input("left_labels", "obstacle labels of its pixels, mono8"),
            depth: b.optional_input("left_depth", "depth of its pixels along the optical axis, m"),
            calibration: b.optional_input("left_calibration", "calibration of the left camera's image"),
        }
    }

    /// Declares the ports of the right camera.
    pub(crate) fn right(b: &mut PortBuilder) -> CameraPorts {
        CameraPorts {
            image: b.optional_input("right_image", "colour image of the right camera"),
            labels: b.optional_input("right_labels", "obstacle labels of its pixels, mono8"),
            depth: b.optional_input("right_depth", "depth of its pixels along the optical axis, m"),
            calibration: b.optional_input("right_calibration", "calibration of the right camera's image"),
        }
    }
}

/// The port of a camera's overlay.
pub(crate) fn learned_port(b: &mut PortBuilder, name: &'static str, image: &str) -> Out<RawImage> {
    b.output(name, "pixels that were learned from, with their label")
        .role(Role::Labels)
        .palette("obstacle_labels")
        .classes(&OBSTACLE_CLASSES)
        .overlay_of(image)
        .build()
}

/// State of one camera.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct LearnerCamera {
    images: Recent,
    depths: Recent,
    camera: Option<PinholeCamera>,
    /// Rays of `camera`, computed on first use.
    #[serde(skip)]
    rays: Option<Arc<Rays>>,
    check: ImageCheck,
    /// Time of the newest labels.
    pub(crate) newest: Option<Stamp>,
    /// The clock of the labels.
    clock: ClockWatch,
    /// Whether it has fallen behind the other camera, which is reported once.
    pub(crate) is_late: bool,
}

/// Labels that have come.
pub(crate) struct NewLabels {
    pub(crate) time: Stamp,
    pub(crate) image: RawImage,
    /// Whether their clock has begun again with them.
    pub(crate) begins_again: bool,
}

/// A frame from which can be learned: all its parts have the same size and time.
pub(crate) struct Frame {
    pub(crate) time: Stamp,
    pub(crate) image: RawImage,
    rgb: Vec<u8>,
    labels: Vec<u8>,
    depth_m: Vec<f32>,
    rays: Arc<Rays>,
}

impl LearnerCamera {
    /// Reads the inputs and returns the newest labels, if they are new. Unusable data are reported under
    /// `name`.
    pub(crate) fn read(
        &mut self,
        ports: &CameraPorts,
        name: &str,
        params: &TerrainLearnerParams,
        cx: &mut Cycle<'_>,
    ) -> Option<NewLabels> {
        if let Some(calibration) =
            read_calibration(&ports.calibration, self.camera.is_some(), params.rectified, cx)
        {
            match camera_of(&calibration, params.rectified) {
                Ok(camera) if self.camera.as_ref() == Some(&camera) => {}
                Ok(camera) => (self.camera, self.rays) = (Some(camera), None),
                Err(error) => {
                    (self.camera, self.rays) = (None, None);
                    cx.fault(format!("{name} camera: {}", Unusable::from(error)));
                }
            }
        }
        for (port, recent, what) in
            [(&ports.image, &mut self.images, "image"), (&ports.depth, &mut self.depths, "depth")]
        {
            recent.miss(cx.missed(port));
            while let Some(message) = cx.read(port) {
                let got = message.acq_time();
                recent.forget_ahead(got, cx.now());
                let newest = recent.newest();
                if recent.begins_again(newest, got) {
                    cx.fault(format!("{name} camera: the clock of the {what}s has begun again"));
                }
                if let Err(newest) = recent.add(got, (*message).clone()) {
                    cx.fault(format!("{name} camera: {}; skipped", Unusable::Late { what, got, newest }));
                }
            }
        }
        let message = cx.read_newest(&ports.labels)?;
        let got = message.acq_time();
        let newest = not_ahead(self.newest, got, cx.now());
        let begins_again = self.clock.begins_again(newest, got);
        if begins_again {
            cx.fault(format!("{name} camera: the clock of the labels has begun again"));
        }
        if let Some(newest) = newest.filter(|&newest| newest >= got && !begins_again) {
            cx.fault(format!(
                "{name} camera: {}; skipped",
                Unusable::Late { what: "label image", got, newest }
            ));
            return None;
        }
        self.newest = Some(got);
        Some(NewLabels { time: got, image: (*message).clone(), begins_again })
    }

    /// The image and the depth for labels, checked.
    pub(crate) fn frame(
        &mut self,
        time: Stamp,
        label_image: &RawImage,
        params: &TerrainLearnerParams,
    ) -> Result<Frame, Unusable> {
        let apart = |recent: &Recent, what: &'static str| {
            let nearest = recent.times().map(|other| other.0.abs_diff(time.0)).min();
            let apart_s = nearest.map(|ns| ns as f64 * 1e-9);
            Unusable::Apart { what, of: "labels", apart_s, missed: recent.missed() }
        };
        let tolerance = params.sync_tolerance_s;
        let (_, image) = self.images.at(time, tolerance).ok_or_else(|| apart(&self.images, "image"))?;
        let (_, depth) = self.depths.at(time, tolerance).ok_or_else(|| apart(&self.depths, "depth"))?;
        let (image, depth) = (image.clone(), depth.clone());
        let camera = self.camera.as_ref().ok_or(Unusable::NoCalibration)?;
        let size = [camera.width, camera.height];
        let rgb = self.check.check(&image, Some(size), params.image_check.as_ref())?;
        let labels = labels(label_image, size)?;
        let depth_m = depths(&depth, size, params.depth_scale_m)?;
        // Rays take memory by the size of the calibration, which is now that of the images.
        let rays = self.rays.get_or_insert_with(|| Arc::new(Rays::new(camera))).clone();
        self.images.forget_before(time);
        self.depths.forget_before(time);
        Ok(Frame { time, image, rgb, labels, depth_m, rays })
    }
}

impl Frame {
    /// Sorts its points into the cells of a window, strip by strip.
    pub(crate) fn gather(
        &self,
        local_from_camera: Pose,
        window: &Window,
        max_range_m: f32,
        ratios: &RatioBins,
        cx: &Cycle<'_>,
    ) -> Vec<Gathered> {
        let [width, height] = self.rays.size();
        let grey = PaddedGrey::from_rgb(&self.rgb, width, height);
        let frame = LabelledFrame {
            rgb: &self.rgb,
            grey: &grey,
            labels: &self.labels,
            depth_m: &self.depth_m,
            rays: &self.rays,
            local_from_camera,
        };
        cx.pool().map(strips(height), |strip| gather(&frame, strip, window, max_range_m, ratios))
    }

    /// Pictures of cells, which are given by their indices in the window; `None` for a cell without points in the frame.
    pub(crate) fn samples(
        &self,
        strips: &[Gathered],
        local_from_camera: &Pose,
        window: &Window,
        cells: &[u32],
    ) -> Vec<Option<Sample>> {
        let size = self.rays.size();
        let (frame_id, time) = (&self.image.frame_id, self.time);
        let image = Rgb { data: &self.rgb, step: 3 * size[0], size, frame_id, time };
        let picture =
            |spot: Spot| Sample::around(&image, spot.middle, spot.side.clamp(SAMPLE_PX / 2, SAMPLE_PX));
        let spots = spots(&self.rays, &self.depth_m, local_from_camera, window, strips, cells);
        spots.into_iter().map(|spot| spot.and_then(picture)).collect()
    }

    /// The pixels that were used, as a label image.
    pub(crate) fn used(&self, strips: &[Gathered]) -> RawImage {
        let data: Vec<u8> = strips.iter().flat_map(|strip| strip.used.iter().copied()).collect();
        RawImage {
            timestamp: Some(self.time.to_proto()),
            frame_id: self.image.frame_id.clone(),
            width: self.image.width,
            height: self.image.height,
            encoding: "mono8".to_owned(),
            step: self.image.width,
            data: data.into(),
        }
    }
}

/// How the poses of vehicle and cameras are found.
pub(crate) fn extrinsics(params: &TerrainLearnerParams) -> Extrinsics<'_> {
    Extrinsics::new(params.pose.as_ref(), params.mount.as_ref())
}
