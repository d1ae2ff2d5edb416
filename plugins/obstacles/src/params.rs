//! Conversion of parameters to the units of the algorithms: tangents, nanoseconds, limits in metres.

use crate::cost_map::Certainty;
use crate::ground_map::BorderRule;
use crate::negative::NegativeParams;
use crate::proto::ObstaclesParams;
use crate::scan::ScanParams;
use rcs_geom::PinholeCamera;
use rcs_sense::Extrinsics;

pub(crate) fn extrinsics(params: &ObstaclesParams) -> Extrinsics<'_> {
    Extrinsics::new(params.pose.as_ref(), params.mount.as_ref())
}

fn tangent(degrees: f64) -> f32 {
    libm::tan(degrees.to_radians()) as f32
}

/// `camera` is that of a depth image; a cloud has none.
pub(crate) fn scan_params(params: &ObstaclesParams, camera: Option<&PinholeCamera>) -> ScanParams {
    ScanParams {
        min_range_m: params.min_range_m as f32,
        max_range_m: max_range_m(params, camera) as f32,
        slope_limit: tangent(params.slope_limit_deg),
        regain_slope: tangent(params.regain_slope_deg),
        min_rise_m: params.min_rise_m as f32,
        rise_noise: params.rise_noise_per_m as f32,
        short_height_m: params.short_height_m as f32,
        clearance_m: params.clearance_m as f32,
        gap_m: params.gap_m as f32,
        surface_span_m: params.surface_span_m as f32,
        wheels_tolerance_m: params.wheels_tolerance_m as f32,
    }
}

/// `camera` is that of a depth image, if one was used.
pub(crate) fn certainty(params: &ObstaclesParams, camera: Option<&PinholeCamera>) -> Certainty {
    let noise_per_m2 = match camera {
        Some(camera) if params.baseline_m > 0.0 => {
            params.disparity_noise_px / (camera.fx * params.baseline_m)
        }
        _ => 0.0,
    };
    Certainty { min_pixels: params.min_pixels, pixels: params.certain_pixels, noise_per_m2 }
}

/// The largest range that is used.
///
/// A range from stereo is z = f·b/d, so disparity noise `s` gives it the uncertainty z²·s/(f·b). It is used up to the
/// range at which this equals the greatest noise allowed. The limit on z is applied to the range along the ray, which
/// is slightly strict in the corners of the image.
fn max_range_m(params: &ObstaclesParams, camera: Option<&PinholeCamera>) -> f64 {
    match camera {
        Some(camera) if params.baseline_m > 0.0 && params.disparity_noise_px > 0.0 => {
            let certain =
                params.max_range_noise_m * camera.fx * params.baseline_m / params.disparity_noise_px;
            params.max_range_m.min(certain.sqrt())
        }
        _ => params.max_range_m,
    }
}

pub(crate) fn negative_params(params: &ObstaclesParams) -> Option<NegativeParams> {
    params.negative_obstacles.then(|| NegativeParams {
        depth_m: params.negative_depth_m as f32,
        depth_noise: params.rise_noise_per_m as f32,
        width_m: params.negative_width_m as f32,
        max_range_m: params.negative_max_range_m as f32,
        slope_limit: tangent(params.slope_limit_deg),
    })
}

pub(crate) fn border_rule(params: &ObstaclesParams) -> BorderRule {
    BorderRule {
        memory_ns: (params.ground_memory_s * 1e9) as u64,
        min_votes: params.negative_votes,
        min_frames: params.negative_frames,
        min_length_m: params.negative_width_m,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcs_geom::Distortion;

    #[test]
    fn a_range_from_stereo_is_believed_until_the_disparitys_noise_makes_it_too_uncertain() {
        let camera = PinholeCamera::new([320, 240], [250.0; 2], [160.0, 120.0], Distortion::None).unwrap();
        let stereo = ObstaclesParams {
            max_range_m: 30.0,
            baseline_m: 0.1,
            disparity_noise_px: 0.25,
            max_range_noise_m: 1.0,
            ..ObstaclesParams::default()
        };
        // At 10 m: 10² · 0.25 px / (250 px · 0.1 m) = 1 m.
        assert!((max_range_m(&stereo, Some(&camera)) - 10.0).abs() < 1e-12);
        let near = ObstaclesParams { max_range_m: 8.0, ..stereo.clone() };
        assert_eq!(max_range_m(&near, Some(&camera)), 8.0);
        assert_eq!(max_range_m(&stereo, None), 30.0);
        assert_eq!(max_range_m(&ObstaclesParams { baseline_m: 0.0, ..stereo }, Some(&camera)), 30.0);
    }
}
