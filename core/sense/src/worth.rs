//! How much a vote for a cell counts: as much as its pixels, and the noise of its place, let it be.

/// The worth of a vote, 0 to 255: `part` (0 to 1, of its pixels in those that make it certain), divided by
/// 1 + (σ / cell size)², where σ is the standard deviation of its place along the line of sight (`noise_m`, m).
pub fn worth(part: f64, noise_m: f64, cell_size_m: f64) -> u8 {
    let noise_in_cells = noise_m / cell_size_m;
    (255.0 * part / (1.0 + noise_in_cells * noise_in_cells)).round() as u8
}

/// The noise of a place that is known because the ray of a camera meets a plane there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlaneNoise {
    /// Height of the camera above the plane, m.
    pub above_m: f64,
    /// Standard deviation of the angle between the ray and the plane, rad.
    pub angle_rad: f64,
}

impl PlaneNoise {
    /// For pixels that see an angle of `pixel_rad`, each with its value anywhere in it, on a plane whose tilt has the
    /// standard deviation `tilt_rad`.
    pub fn new(above_m: f64, pixel_rad: f64, tilt_rad: f64) -> PlaneNoise {
        PlaneNoise { above_m, angle_rad: (pixel_rad * pixel_rad / 12.0 + tilt_rad * tilt_rad).sqrt() }
    }

    /// Standard deviation along the plane at a distance (m) from below the camera: (d² + h²)/h·σ, m.
    pub fn at_m(&self, distance_m: f64) -> f64 {
        (distance_m * distance_m + self.above_m * self.above_m) / self.above_m * self.angle_rad
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_worth_is_the_part_of_the_pixels_and_half_of_it_where_the_noise_is_a_cell() {
        assert_eq!([worth(1.0, 0.0, 0.2), worth(0.5, 0.0, 0.2), worth(0.0, 0.0, 0.2)], [255, 128, 0]);
        assert_eq!([worth(1.0, 0.2, 0.2), worth(0.5, 0.2, 0.2), worth(1.0, 0.6, 0.2)], [128, 64, 26]);
    }

    #[test]
    fn the_noise_on_a_plane_is_how_far_the_ray_moves_when_it_turns() {
        let (above_m, turn_rad) = (0.9, 1e-6);
        let noise = PlaneNoise::new(above_m, 0.0, turn_rad);
        for distance_m in [0.5, 3.0, 12.0] {
            let down_rad = f64::atan2(above_m, distance_m);
            let moved_m = above_m / f64::tan(down_rad - turn_rad) - distance_m;
            assert!((noise.at_m(distance_m) / moved_m - 1.0).abs() < 1e-3, "{distance_m}");
        }
        let pixels = PlaneNoise::new(above_m, 0.01, 0.0);
        assert!((pixels.angle_rad - 0.002_886_75).abs() < 1e-8, "as of a uniform distribution");
    }
}
