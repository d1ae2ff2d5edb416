//! Outputs of the process.

use crate::cost_map::{CameraPlacement, CostMap, Ground, Standing};
use crate::engine::{Permission, Seen};
use crate::hidden::Screens;
use crate::image::{HEIGHT, WIDTH};
use crate::models::Learned;
use crate::ports::Ports;
use crate::proto::{ColorLearning, ColorModelsParams};
use crate::settings::extrinsics;
use crate::upright::Shape;
use glam::DVec2;
use rcs_msg::Stamp;
use rcs_msg::foxglove::points_annotation::Type;
use rcs_msg::foxglove::{Color, ImageAnnotations, Point2, PointsAnnotation, RawImage};
use rcs_runtime::{Cycle, Msg};
use rcs_sense::CELL_SIZE_M;

/// Sends the overlay and the cost map; obstacles of the world model hide what stands behind them. Returns the number of
/// cells with a cost, and of obstacle cells.
pub(crate) fn send_costs(
    seen: &Seen,
    place: &CameraPlacement<'_>,
    screens: Option<&Screens<'_>>,
    image: &Msg<RawImage>,
    ports: &Ports,
    params: &ColorModelsParams,
    cx: &mut Cycle<'_>,
) -> [u32; 2] {
    let Some(costs) = &seen.costs else { return [0; 2] };
    let time = image.acq_time();
    let shape = Shape {
        height_m: params.known_height_m,
        least_share: params.known_least_share,
        span_m: params.known_span_m,
    };
    let known = seen.known.as_ref().map(|known| Standing { known, shape, screens });
    let ground = Ground::new(costs, &seen.models, known.as_ref(), *place);
    let map = CostMap::new(&ground, CELL_SIZE_M, params.max_range_m);
    let known = map.known();
    cx.write(&ports.cost, time, map.to_grid(extrinsics(params).frames.local, time));
    let overlay = RawImage {
        timestamp: Some(time.to_proto()),
        frame_id: image.frame_id.clone(),
        width: WIDTH as u32,
        height: HEIGHT as u32,
        encoding: "mono8".to_owned(),
        step: WIDTH as u32,
        data: costs.clone().into(),
    };
    cx.write(&ports.probability, time, overlay);
    known
}

/// The outline in the coordinates of the message, whose origin is the corner of the first pixel.
pub(crate) fn annotation(outline: &[DVec2], time: Stamp) -> ImageAnnotations {
    let points = outline.iter().map(|p| Point2 { x: p.x + 0.5, y: p.y + 0.5 }).collect();
    let line = PointsAnnotation {
        timestamp: Some(time.to_proto()),
        r#type: Type::LineLoop.into(),
        points,
        outline_color: Some(Color { r: 1.0, g: 1.0, b: 1.0, a: 1.0 }),
        thickness: 2.0,
        ..PointsAnnotation::default()
    };
    let points = if outline.is_empty() { Vec::new() } else { vec![line] };
    ImageAnnotations { timestamp: Some(time.to_proto()), points, ..ImageAnnotations::default() }
}

pub(crate) fn permission(off: Option<ColorLearning>) -> Permission {
    match off {
        None => Permission::All,
        // A vehicle that has not moved yet learns its first ground model where it stands: without one there would be no
        // cost to drive by.
        Some(ColorLearning::ColorOffStanding | ColorLearning::ColorOffTurning) => Permission::FirstGround,
        Some(ColorLearning::ColorOffCommand) => Permission::Nothing,
        Some(_) => Permission::Background,
    }
}

pub(crate) fn learning(seen: &Seen, off: Option<ColorLearning>, params: &ColorModelsParams) -> ColorLearning {
    match (seen.learned, off) {
        (Some(Learned::Updated(_)), _) => ColorLearning::ColorUpdated,
        (Some(Learned::Watches { .. }), _) => ColorLearning::ColorWatches,
        (Some(Learned::Added), _) => ColorLearning::ColorAdded,
        (Some(Learned::Full), _) => ColorLearning::ColorFull,
        (None, Some(_)) if seen.sample_pixels < params.min_sample_px => ColorLearning::ColorNoSample,
        (None, Some(off)) => off,
        (None, None) => ColorLearning::ColorNoSample,
    }
}

pub(crate) fn text_of(learning: ColorLearning) -> &'static str {
    match learning {
        ColorLearning::ColorNoSample => "classifies; the ground sample is out of view",
        ColorLearning::ColorUpdated => "classifies, and updates a ground model",
        ColorLearning::ColorWatches => "classifies; learning mode watches for a new ground",
        ColorLearning::ColorAdded => "classifies; has a new ground model",
        ColorLearning::ColorFull => "classifies; has as many ground models as it may",
        ColorLearning::ColorOffCommand => "classifies; learns nothing as commanded",
        ColorLearning::ColorOffStanding => "classifies; learns no ground while the vehicle stands",
        ColorLearning::ColorOffTurning => "classifies; learns no ground while the vehicle turns",
        ColorLearning::ColorOffObstacle => "classifies; learns no ground with an obstacle in the sample",
    }
}
