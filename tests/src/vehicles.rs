//! The bundled stacks with other vehicles than that of the bundled courses: what they take from the vehicle file.

use crate::bundled::Repository;
use rcs_runtime::{Asset, Assets, Plan, PlanOptions, StackFile};

/// The bundled files, with a vehicle of a test.
struct WithVehicle(String);

impl Assets for WithVehicle {
    fn read(&self, kind: &str, name: &str, beside: &str) -> Result<Asset, String> {
        let asset = Repository.read(kind, name, beside)?;
        Ok(if kind == "vehicle" { Asset { text: self.0.clone(), ..asset } } else { asset })
    }
}

/// The vehicle `lagr` with other greatest speeds of vehicle and wheels, m/s.
fn vehicle(max_speed_mps: f64, max_wheel_speed_mps: f64) -> WithVehicle {
    changed(&[
        ("\nmax_speed_mps = 1.3\n", format!("\nmax_speed_mps = {max_speed_mps:?}\n")),
        ("\nmax_wheel_speed_mps = 1.8\n", format!("\nmax_wheel_speed_mps = {max_wheel_speed_mps:?}\n")),
    ])
}

/// The vehicle `lagr` with other texts in place of its own.
fn changed(texts: &[(&str, String)]) -> WithVehicle {
    let mut text = Repository.read("vehicle", "lagr", "").unwrap().text;
    for (before, after) in texts {
        assert!(text.contains(*before), "{before}");
        text = text.replace(*before, after);
    }
    WithVehicle(text)
}

fn planned(stack: &str, vehicle: &WithVehicle) -> Plan {
    let asset = Repository.read("stack", stack, "").unwrap();
    let file = StackFile::compose(&asset.file, &asset.text, vehicle).unwrap();
    let options = PlanOptions { overrides: &[], course: Some("meadow"), assets: vehicle };
    Plan::with(file, rcs_plugins::all(), &options).unwrap_or_else(|error| panic!("{error}"))
}

/// The number that a process has for a parameter.
fn param(plan: &Plan, process: &str, name: &str) -> f64 {
    let process = plan.processes.iter().find(|planned| &*planned.name == process).expect(process);
    process.params.value().unwrap().field(name).and_then(rcs_msg::Value::as_f64).expect(name)
}

#[test]
fn who_drives_the_vehicle_interface_and_the_motion_by_images_have_the_greatest_speeds_of_the_vehicle() {
    for (speed_mps, wheel_mps) in [(2.0, 2.5), (0.8, 0.9)] {
        let vehicle = vehicle(speed_mps, wheel_mps);
        let plan = planned("lagr", &vehicle);
        assert_eq!(param(&plan, "vehicle_interface", "max_speed_mps"), speed_mps);
        assert_eq!(param(&plan, "vehicle_interface", "max_wheel_speed_mps"), wheel_mps);
        assert_eq!(param(&plan, "waypoint_follower", "max_speed_mps"), speed_mps);
        assert_eq!(param(&plan, "visual_motion", "vehicle_speed_mps"), speed_mps);
        let plan = planned("truth_driver", &vehicle);
        assert_eq!(param(&plan, "vehicle_interface", "max_speed_mps"), speed_mps);
        assert_eq!(param(&plan, "truth_driver", "vehicle_speed_mps"), speed_mps);
    }
}

#[test]
fn localization_has_the_place_of_the_antenna() {
    for place_m in [[0.0, 0.0, 1.0], [-2.5, 0.25, 1.5]] {
        let [x_m, y_m, z_m] = place_m;
        let gps = format!("[gps]\nrate_hz = 4.0\nx_m = {x_m:?}\ny_m = {y_m:?}\nz_m = {z_m:?}\n");
        let vehicle = changed(&[("[gps]\nrate_hz = 4.0\nx_m = 0.0\ny_m = 0.0\nz_m = 1.0\n", gps)]);
        for stack in ["lagr", "truth_driver", "replay"] {
            let plan = planned(stack, &vehicle);
            let names = ["antenna_x_m", "antenna_y_m", "antenna_z_m"];
            assert_eq!(names.map(|name| param(&plan, "localization", name)), place_m, "{stack}");
        }
    }
}

#[test]
fn what_touches_the_ground_and_things_has_the_lengths_of_the_body() {
    let body = "front_m = 0.24\nrear_m = 0.72\nwidth_m = 0.66\nheight_m = 1.0\n";
    for lengths_m in [[0.24, 0.72, 0.66, 1.0], [3.1, 0.9, 2.0, 2.6], [0.2, 0.25, 0.35, 0.4]] {
        let [front_m, rear_m, width_m, height_m] = lengths_m;
        let own = format!(
            "front_m = {front_m:?}\nrear_m = {rear_m:?}\nwidth_m = {width_m:?}\nheight_m = {height_m:?}\n"
        );
        let vehicle = changed(&[(body, own)]);
        for stack in ["lagr", "replay"] {
            let plan = planned(stack, &vehicle);
            let of = |process: &str, names: [&str; 3]| names.map(|name| param(&plan, process, name));
            let extent_m = [front_m, rear_m, width_m];
            assert_eq!(of("proximity", ["bumper_x_m", "rear_m", "vehicle_width_m"]), extent_m, "{stack}");
            assert_eq!(of("terrain", ["front_m", "rear_m", "width_m"]), extent_m, "{stack}");
            assert_eq!(param(&plan, "terrain", "height_m"), height_m, "{stack}");
            assert_eq!(param(&plan, "waypoint_follower", "front_m"), front_m, "{stack}");
            assert_eq!(param(&plan, "waypoint_follower", "rear_m"), rear_m, "{stack}");
            assert_eq!(param(&plan, "waypoint_generator", "front_m"), front_m, "{stack}");
        }
    }
}
