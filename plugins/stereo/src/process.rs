//! The process `stereo`: reads pairs of images, and sends ranges and points. Its port table is in the crate's
//! documentation.

use crate::image::ColourImage;
use crate::pairing::{Pair, Pairing, Patience, Side};
use crate::proto::{StereoMethod, StereoParams, StereoStats};
use crate::publish::{Heading, depth_of, depths, pixels};
use crate::rig::{Bench, ImageCalibration, Rectified, Rig, Unusable};
use crate::{CalibrationError, Method, NO_DISPARITY, STEPS_PER_PIXEL, Settings};
use rcs_msg::foxglove::{CameraCalibration, PointCloud, RawImage};
use rcs_runtime::{Cycle, In, Msg, NoCommands, Out, PortBuilder, Process, ProcessDef, Role};
use rcs_sense::{ImageCheck, read_calibration};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// State: both calibrations, images that wait for the other camera, and a digest of the newest image of each camera.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Stereo {
    calibrations: [Option<ImageCalibration>; 2],
    /// `None` is an image that was refused on arrival: its counterpart is dropped without another fault.
    waiting: Pairing<Option<Arc<ColourImage>>>,
    checks: [ImageCheck; 2],
    pairs: u64,
    unpaired: u64,
    /// Derived from the calibrations on first use.
    #[serde(skip)]
    rig: Option<Result<Arc<Rig>, CalibrationError>>,
    #[serde(skip)]
    bench: Bench,
}

/// Ports of [`Stereo`].
#[derive(Debug)]
pub struct Ports {
    images: [In<RawImage>; 2],
    calibrations: [In<CameraCalibration>; 2],
    rectified: Out<RawImage>,
    calibration: Out<CameraCalibration>,
    disparity: Out<RawImage>,
    depth: Out<RawImage>,
    points: Out<PointCloud>,
    stats: Out<StereoStats>,
}

impl Process for Stereo {
    type Params = StereoParams;
    type Ports = Ports;
    type Command = NoCommands;
    const DEF: ProcessDef = ProcessDef {
        plugin: "stereo",
        summary: "Rectifies a stereo pair and measures the range of each pixel",
        period_ms: 50.0,
        latency_ms: 10.0,
        reads_ground_truth: false,
    };

    fn ports(b: &mut PortBuilder) -> Ports {
        let images = [
            b.input("left", "raw image of the left camera"),
            b.input("right", "raw image of the right camera"),
        ];
        let calibrations = [
            b.input("left_calibration", "calibration of the left camera: K, D, R and P"),
            b.input("right_calibration", "calibration of the right camera; its P has the baseline"),
        ];
        Ports {
            images,
            calibrations,
            rectified: b.output("rectified", "left image, rectified, rgb8").role(Role::Image).build(),
            calibration: b
                .output("calibration", "calibration of the rectified left image")
                .role(Role::Calibration)
                .build(),
            disparity: b
                .output("disparity", "disparity of each rectified pixel, 32FC1, px; NaN where none")
                .role(Role::Disparity)
                .build(),
            depth: b
                .output("depth", "range along the optical axis, 32FC1, m; NaN where none")
                .role(Role::Depth)
                .build(),
            points: b
                .output("points", "points with colour and pixel, left rectified optical frame, m")
                .role(Role::Cloud)
                .build(),
            stats: b.output("stats", "pixels with a range, ranges in m, pairs").role(Role::Stats).build(),
        }
    }

    fn new(_params: &StereoParams) -> Self {
        Self::default()
    }

    fn check(params: &StereoParams) -> Result<(), String> {
        if params.min_range_m > params.max_range_m {
            let (min, max) = (params.min_range_m, params.max_range_m);
            return Err(format!("min_range_m is {min}, expected at most max_range_m, {max}"));
        }
        settings(params).check_values().map_err(|error| error.to_string())
    }

    fn cycle(&mut self, ports: &Ports, params: &StereoParams, cx: &mut Cycle<'_>) {
        for side in Side::BOTH {
            let port = &ports.calibrations[side as usize];
            let has_camera = self.calibrations[side as usize].is_some();
            if let Some(calibration) = read_calibration(port, has_camera, false, cx) {
                self.read_calibration(side, &calibration, cx);
            }
            while let Some(image) = cx.read(&ports.images[side as usize]) {
                self.read_image(side, &image, params, cx);
            }
        }
        let (pairs, given_up) = self.waiting.pairs(cx.now(), patience(params));
        self.unpaired += given_up.len() as u64;
        for (error, image) in given_up {
            if image.is_some() {
                cx.fault(format!("{error}; image skipped"));
            }
        }
        // Older pairs are skipped, as every reader of the newest message does: the current ranges are wanted.
        let newest = pairs.into_iter().next_back();
        cx.exec(if newest.is_some() { "matches a pair" } else { "waits for a pair" });
        let Some(Pair { taken, images: [Some(left), Some(right)] }) = newest else { return };
        let pair = Pair { taken, images: [&*left, &*right] };
        if let Err(error) = self.match_pair(&pair, ports, params, cx) {
            cx.fault(format!("{error}; pair skipped"));
        }
    }
}

impl Stereo {
    fn read_calibration(&mut self, side: Side, message: &CameraCalibration, cx: &mut Cycle<'_>) {
        let calibration = ImageCalibration::new(message)
            .map_err(|error| cx.fault(format!("calibration of the {} camera: {error}", side.name())))
            .ok();
        let known = &mut self.calibrations[side as usize];
        if *known != calibration {
            *known = calibration;
            self.rig = None;
        }
    }

    fn read_image(&mut self, side: Side, message: &Msg<RawImage>, params: &StereoParams, cx: &mut Cycle<'_>) {
        let taken = message.acq_time();
        let rgb = self.checks[side as usize].check(message, None, params.image_check.as_ref());
        let image = rgb.map(|rgb| Arc::new(ColourImage::new(message, rgb)));
        let image = image
            .map_err(|error| cx.fault(format!("{} image of {taken}: {error}; image skipped", side.name())))
            .ok();
        match self.waiting.push(side, taken, cx.now(), image) {
            Ok(None) => {}
            Ok(Some(dropped)) => {
                self.unpaired += dropped as u64;
                let name = side.name();
                cx.fault(format!(
                    "the clock of the {name} camera has begun again; {dropped} waiting images dropped"
                ));
            }
            Err(error) => {
                self.unpaired += 1;
                cx.fault(format!("{error}; image skipped"));
            }
        }
    }

    fn rig(&mut self) -> Result<Arc<Rig>, Unusable> {
        let [left, right] = &self.calibrations;
        let Some(left) = left else { return Err(Unusable::NoCalibration { camera: "left" }) };
        let Some(right) = right else { return Err(Unusable::NoCalibration { camera: "right" }) };
        let rig = self.rig.get_or_insert_with(|| Rig::new(left, right).map(Arc::new));
        Ok(rig.clone()?)
    }

    fn match_pair(
        &mut self,
        pair: &Pair<&ColourImage>,
        ports: &Ports,
        params: &StereoParams,
        cx: &mut Cycle<'_>,
    ) -> Result<(), Unusable> {
        let rig = self.rig()?;
        let settings = settings(params);
        let rectified = rig.rectify(pair.images, cx.pool())?;
        let mut disparity = rig.disparities(&rectified, settings, &mut self.bench, cx.pool())?;
        let limits = [params.min_range_m, params.max_range_m];
        let depths = depths(&rig.camera, settings.disparities, limits);
        let (mut matched, mut nearest, mut farthest) = (0_u64, f32::INFINITY, 0.0_f32);
        for d in &mut disparity {
            let depth_m = depth_of(&depths, *d);
            if depth_m.is_nan() {
                *d = NO_DISPARITY;
            } else {
                matched += 1;
                nearest = nearest.min(depth_m);
                farthest = farthest.max(depth_m);
            }
        }
        let pixels = disparity.len();
        self.pairs += 1;
        let [width, height] = rig.size();
        let possible = (width + 1 - settings.disparities) * height;
        let [left, right] = pair.taken;
        let stats = StereoStats {
            timestamp: Some(left.to_proto()),
            pixels: pixels as u64,
            matched,
            density_pct: 100.0 * matched as f64 / possible as f64,
            min_range_m: if matched > 0 { f64::from(nearest) } else { 0.0 },
            max_range_m: f64::from(farthest),
            right_after_left_ms: (right.0 as f64 - left.0 as f64) / 1e6,
            pairs: self.pairs,
            unpaired: self.unpaired,
        };
        let named = pair.images[0].frame_id.as_str();
        let frame_id = match &self.calibrations[0] {
            Some(calibration) if named.is_empty() => &calibration.frame_id,
            _ => named,
        };
        let heading = Heading { time: left, frame_id, size: [width, height] };
        send(&heading, &rig, rectified, &disparity, &depths, stats, ports, params, cx);
        if matched == 0 {
            // A bare wall fills the view, or the calibration is another camera's: readers see that the cameras send.
            let [min_m, max_m] = limits;
            cx.fault(format!("none of {pixels} pixels has a range from {min_m} m to {max_m} m"));
        }
        Ok(())
    }
}

#[expect(clippy::too_many_arguments, reason = "everything that was found, once")]
fn send(
    heading: &Heading<'_>,
    rig: &Rig,
    rectified: Rectified,
    disparity: &[u16],
    depths: &[f32],
    stats: StereoStats,
    ports: &Ports,
    params: &StereoParams,
    cx: &mut Cycle<'_>,
) {
    let time = heading.time;
    if params.publish_points {
        let points = rig.camera.points(disparity, &rectified.left_rgb);
        cx.write(&ports.points, time, heading.cloud(points));
    }
    cx.write(&ports.disparity, time, heading.floats(disparity.iter().map(|&d| pixels(d))));
    cx.write(&ports.depth, time, heading.floats(disparity.iter().map(|&d| depth_of(depths, d))));
    cx.write(&ports.calibration, time, heading.calibration(&rig.camera));
    cx.write(&ports.rectified, time, heading.rgb(rectified.left_rgb));
    cx.write(&ports.stats, time, stats);
}

fn settings(params: &StereoParams) -> Settings {
    Settings {
        method: match params.method() {
            StereoMethod::StereoBm => Method::Block,
            StereoMethod::StereoSgm => Method::SemiGlobal,
        },
        disparities: params.disparities as usize,
        block: params.block_px as usize,
        uniqueness_pct: params.uniqueness_pct.min(u16::MAX.into()) as u16,
        left_right_max: params.left_right_max_px.min(u16::MAX.into()) as u16,
        speckle_min_area: params.speckle_min_area_px as usize,
        // The conversion saturates for values out of range.
        speckle_step: (params.speckle_step_px * f64::from(STEPS_PER_PIXEL)).round() as u16,
    }
}

fn patience(params: &StereoParams) -> Patience {
    let nanoseconds = |ms: f64| (ms * 1e6).round() as u64;
    Patience {
        max_difference_ns: nanoseconds(params.max_time_difference_ms),
        max_wait_ns: nanoseconds(params.max_wait_ms),
    }
}
