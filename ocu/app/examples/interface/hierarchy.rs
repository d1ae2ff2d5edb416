//! The view Hierarchy with 40 processes at 50 Hz.

use super::pass::pass;
use ocu_app::open::Request;
use std::fmt::Write as _;
use std::time::Duration;

/// A vehicle that drives, and its pose as many times as there is room.
const STACK: &str = r#"
format = 1
name = "forty"
course = "meadow"
[[process]]
name = "vehicle"
plugin = "sim_vehicle"
supervisor = "viewer"
period_ms = 20
inputs = { wheels = "/vehicle_interface/wheels" }
[[process]]
name = "vehicle_interface"
plugin = "vehicle_interface"
supervisor = "viewer"
period_ms = 20
inputs = { drive = "/truth_driver/drive", above = "/truth_driver/status", local = "/p0/local", imu = "/vehicle/imu", encoders = "/vehicle/encoders", motors = "/vehicle/motors", bumper = "/vehicle/bumper" }
params = { track_m = 0.58 }
[[process]]
name = "truth_driver"
plugin = "truth_driver"
supervisor = "viewer"
period_ms = 20
inputs = { ground_truth_pose = "/vehicle/ground_truth_pose", ground_truth_map = "/vehicle/ground_truth_map", goal = "/vehicle/goal" }
[buffers."/vehicle/imu"]
queue = 16
[buffers."/vehicle/encoders"]
queue = 8
"#;

/// Measures for the seconds of the argument, in turn, the view and an empty one.
pub(crate) fn measure(arguments: &[String]) -> anyhow::Result<()> {
    let seconds: f64 = arguments.first().map(|text| text.parse()).transpose()?.unwrap_or(15.0);
    let mut stack = STACK.to_owned();
    for process in 0..37 {
        write!(
            stack,
            "[[process]]\nname = \"p{process}\"\nplugin = \"localization\"\nsupervisor = \"viewer\"\nperiod_ms = 20\n\
             inputs = {{ encoders = \"/vehicle/encoders\", imu = \"/vehicle/imu\", gps = \"/vehicle/gps\" }}\n\
             params = {{ track_m = 0.58 }}\n"
        )?;
    }
    let folder = tempfile::tempdir()?;
    let file = folder.path().join("forty.toml");
    std::fs::write(&file, stack)?;
    for kind in ["hierarchy", "plot"] {
        let context = egui::Context::default();
        let request = Request { stack: Some(file.display().to_string()), ..Request::default() };
        let layout =
            format!("Layout(version: 1, name: \"measured\", buffers: false, root: View(kind: \"{kind}\"))");
        let mut window = super::window(&context, request, &layout)?;
        while window.frame().is_none_or(|frame| frame.time_s() < 1.0) {
            pass(&context, &mut window, Vec::new());
            std::thread::sleep(Duration::from_millis(5));
        }
        let processes = window.frame().map_or(0, |frame| frame.processes.len());
        let what = if kind == "plot" { "an empty view" } else { kind };
        super::measure(&format!("{what}, {processes} processes"), &context, &mut window, seconds);
    }
    Ok(())
}
