//! Draws a world: what a camera sees, and the world from above.
//!
//! ```text
//! draw WORLD.toml[,LOOK.toml] OUT_PREFIX [x y yaw_deg [height_m pitch_deg [horizontal_fov_deg]]]
//! ```
//!
//! Writes `OUT_PREFIX_camera.png`, `_depth.png`, `_class.png` and `_above.png`.

use std::error::Error;

use rcs_geom::{DVec2, DVec3, PinholeCamera, Pose};
use rcs_scene::{CameraRays, Look, ViewRows, World, render_rows};

struct Image {
    width: u32,
    height: u32,
    rgb: Vec<u8>,
    depth_m: Vec<f32>,
    class: Vec<u8>,
}

fn draw(world: &World, camera: &PinholeCamera, pose: &Pose) -> Image {
    let (width, height) = (camera.width, camera.height);
    let pixels = (width * height) as usize;
    let mut image =
        Image { width, height, rgb: vec![0; 3 * pixels], depth_m: vec![0.0; pixels], class: vec![0; pixels] };
    let mut label = vec![0; pixels];
    let mut out = ViewRows {
        rgb: &mut image.rgb,
        depth_m: &mut image.depth_m,
        class: &mut image.class,
        label: &mut label,
    };
    render_rows(world, &CameraRays::new(camera), pose, 1.0, 0..height as usize, &mut out);
    image
}

/// A colour for a code; codes that are close get colours that differ.
fn code_colour(code: u8) -> [u8; 3] {
    let mixed = u32::from(code).wrapping_mul(0x9E37_79B1);
    [(mixed >> 24) as u8, (mixed >> 16) as u8, (mixed >> 8) as u8]
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [world, prefix, numbers @ ..] = arguments.as_slice() else {
        return Err(
            "usage: draw WORLD.toml[,LOOK.toml] OUT_PREFIX [x y yaw_deg [height_m pitch_deg [fov_deg]]]"
                .into(),
        );
    };
    let numbers: Vec<f64> = numbers.iter().map(|text| text.parse()).collect::<Result<_, _>>()?;
    let number = |at: usize, default: f64| numbers.get(at).copied().unwrap_or(default);
    let (world, look) = world.split_once(',').unwrap_or((world, ""));
    let look = match look {
        "" => None,
        look => Some(Look::from_toml(&std::fs::read_to_string(look)?)?),
    };
    let world = World::with_look(&std::fs::read_to_string(world)?, look.as_ref())?;

    let at = DVec2::new(number(0, 10.0), number(1, 45.0));
    let camera = at.extend(world.height_m(at) + number(3, 0.9));
    let body = Pose::from_rpy(camera, 0.0, number(4, 10.0).to_radians(), number(2, 0.0).to_radians());
    let camera = PinholeCamera::from_horizontal_fov([640, 480], number(5, 70.0).to_radians())?;
    let view = draw(&world, &camera, &(body * Pose::body_from_optical()));
    save(&format!("{prefix}_camera.png"), view.width, view.height, &view.rgb)?;
    let grey =
        |depth: &f32| [if depth.is_finite() { (255.0 - depth * 6.0).clamp(0.0, 255.0) as u8 } else { 0 }; 3];
    let depth: Vec<u8> = view.depth_m.iter().flat_map(grey).collect();
    save(&format!("{prefix}_depth.png"), view.width, view.height, &depth)?;
    let classes: Vec<u8> = view.class.iter().flat_map(|&code| code_colour(code)).collect();
    save(&format!("{prefix}_class.png"), view.width, view.height, &classes)?;

    let [low, high] = world.bounds_m();
    let middle = 0.5 * (low + high);
    let up = 1.1 * (high.x - low.x);
    let above =
        Pose::from_rpy(DVec3::new(middle.x, middle.y, up), 0.0, 90_f64.to_radians(), 90_f64.to_radians());
    let lens = PinholeCamera::from_horizontal_fov([1200, 840], 2.0 * libm::atan(0.5 / 1.08))?;
    let view = draw(&world, &lens, &(above * Pose::body_from_optical()));
    save(&format!("{prefix}_above.png"), view.width, view.height, &view.rgb)
}

fn save(path: &str, width: u32, height: u32, rgb: &[u8]) -> Result<(), Box<dyn Error>> {
    Ok(image::save_buffer(path, rgb, width, height, image::ExtendedColorType::Rgb8)?)
}
