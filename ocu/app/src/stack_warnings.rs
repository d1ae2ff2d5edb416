//! What is valid in a stack but probably a mistake: a frame that two connected processes call differently, a mount that
//! is not used, and commands for another kind of steering than that of the vehicle. A check of the stack, a run and the
//! window tell it.

use rcs_msg::Value;
use rcs_msg::params::{ParamKind, ParamSpec, specs};
use rcs_msg::rcs::PoseSource;
use rcs_runtime::{Plan, PortDef, ProcessPlan};
use std::collections::BTreeMap;

/// The warnings of a plan, in words.
pub(crate) fn of(plan: &Plan) -> Vec<String> {
    let mut warnings = differing_frames(plan);
    warnings.extend(plan.processes.iter().flat_map(unused_mounts));
    warnings.extend(other_steering(plan));
    warnings
}

/// Processes whose commands are for another kind of steering than that of the simulated vehicle that reads them.
fn other_steering(plan: &Plan) -> Vec<String> {
    let mut warnings = Vec::new();
    for vehicle in &plan.processes {
        let Some((file, expected)) = steering_of_file(plan, vehicle) else { continue };
        for process in &plan.processes {
            let is_read = process.outputs.iter().any(|&buffer| vehicle.inputs.contains(&Some(buffer)));
            let Some(steering) = enum_of(process, "steering").filter(|_| is_read) else { continue };
            if steering.starts_with("STEERING_") && steering != expected {
                warnings.push(format!(
                    "{}: steering is {steering}, expected {expected}, which {file} says",
                    process.name
                ));
            }
        }
    }
    warnings
}

/// The vehicle file of a process, and the kind of steering that it says; `None` for a process without one.
fn steering_of_file<'p>(plan: &'p Plan, process: &ProcessPlan) -> Option<(&'p str, &'static str)> {
    let tree = process.params.value().ok()?;
    let file = plan.files.get(tree.field("vehicle")?.as_text()?).filter(|file| file.kind == "vehicle")?;
    let table: toml::Table = toml::from_str(&file.text).ok()?;
    let is_steered = table.contains_key("steering");
    Some((file.file.as_str(), if is_steered { "STEERING_ACKERMANN" } else { "STEERING_DIFFERENTIAL" }))
}

/// The name of the value of a parameter that is an enum.
fn enum_of(process: &ProcessPlan, parameter: &str) -> Option<String> {
    match process.params.value().ok()?.field(parameter)? {
        Value::Enum { name, .. } => Some(name.clone()),
        _ => None,
    }
}

/// Frame parameters with the same name but different values in two connected processes.
fn differing_frames(plan: &Plan) -> Vec<String> {
    let frames: Vec<BTreeMap<String, String>> = plan.processes.iter().map(frames).collect();
    let mut warnings = Vec::new();
    for (reader, process) in plan.processes.iter().enumerate() {
        for (writer, source) in plan.processes.iter().enumerate() {
            let connected = source.outputs.iter().any(|&buffer| process.inputs.contains(&Some(buffer)));
            if !connected || reader == writer {
                continue;
            }
            for (name, frame) in &frames[reader] {
                let Some(other) = frames[writer].get(name).filter(|other| *other != frame) else { continue };
                warnings.push(format!(
                    "{} is {frame:?} in {} and {other:?} in {}, which it reads",
                    name, process.name, source.name
                ));
            }
        }
    }
    warnings
}

/// Whether a process learns where its vehicle is: from what is wired, or because it is fixed.
fn knows_its_pose(process: &ProcessPlan, tree: &Value, group: &str) -> bool {
    let is_wired = |port: &PortDef, wire: &Option<usize>| {
        wire.is_some() && ["odometry", "pose", "transforms"].contains(&port.name)
    };
    let source = format!(".{group}.source").parse().ok().and_then(|path| tree.get(&path).ok());
    let fixed = PoseSource::PoseFixed as i32;
    let is_fixed = matches!(source.as_deref(), Some(Value::Enum { number, .. }) if *number == fixed);
    is_fixed || process.kind.inputs().iter().zip(&process.inputs).any(|(port, wire)| is_wired(port, wire))
}

/// Mounts of which something is set and that are not used, since transforms give the sensor's pose.
fn unused_mounts(process: &ProcessPlan) -> Vec<String> {
    let Some(descriptor) = process.params.schema().descriptor().cloned() else { return Vec::new() };
    let Ok(tree) = process.params.value() else { return Vec::new() };
    let mut warnings = Vec::new();
    for group in specs(&descriptor).iter().filter(|spec| spec.kind == ParamKind::Group) {
        let is_mount = ["fixed", "height_m"].map(|name| group.fields.iter().any(|field| field.name == name));
        if is_mount != [true, true] {
            continue;
        }
        let value = |field: &ParamSpec| {
            let path = format!(".{}.{}", group.name, field.name).parse().ok()?;
            tree.get(&path).ok().map(std::borrow::Cow::into_owned)
        };
        let is_fixed = |field: &&ParamSpec| field.name == "fixed" && value(field) == Some(Value::Bool(true));
        let is_set = |field: &&ParamSpec| value(field).is_some_and(|value| value != field.default);
        if let Some(set) = group.fields.iter().find(is_set)
            && !group.fields.iter().any(|field| is_fixed(&field))
        {
            let (name, mount) = (&process.name, &group.name);
            warnings.push(format!(
                "{name}: {mount}.{} is set, but {mount}.fixed is not: transforms give the sensor's pose",
                set.name
            ));
        }
    }
    warnings
}

/// The parameters of a process that name coordinate frames, by name.
fn frames(process: &ProcessPlan) -> BTreeMap<String, String> {
    let mut frames = BTreeMap::new();
    let Some(descriptor) = process.params.schema().descriptor().cloned() else { return frames };
    let Ok(tree) = process.params.value() else { return frames };
    let mut take = |path: &str, name: &str| {
        let Ok(path) = path.parse() else { return };
        if let Ok(value) = tree.get(&path)
            && let Value::Text(frame) = &*value
        {
            frames.insert(name.to_owned(), frame.clone());
        }
    };
    for spec in specs(&descriptor) {
        if spec.kind == ParamKind::Text && spec.name.ends_with("_frame") {
            take(&format!(".{}", spec.name), &spec.name);
        }
        // Where nothing tells the vehicle's pose, the names of its frames are not used.
        let is_pose = spec.fields.iter().any(|field| field.name == "stream_frame");
        if is_pose && !knows_its_pose(process, &tree, &spec.name) {
            continue;
        }
        for inner in spec.fields.iter().filter(|_| spec.kind == ParamKind::Group) {
            if inner.kind == ParamKind::Text && inner.name.ends_with("_frame") {
                take(&format!(".{}.{}", spec.name, inner.name), &inner.name);
            }
        }
    }
    frames
}

#[cfg(test)]
mod tests {
    use crate::stacks;

    /// The warnings about steering of the stack `truth_driver` with a vehicle and a kind of steering.
    fn told(vehicle: &str, steering: &str) -> Vec<String> {
        let overrides = [("vehicle.vehicle", vehicle), ("vehicle_interface.steering", steering)];
        let overrides = overrides.map(|(path, text)| (path.to_owned(), text.to_owned()));
        let plan = stacks::plan("truth_driver", None, &overrides).unwrap();
        plan.warnings.iter().filter(|warning| warning.contains("steering is")).cloned().collect()
    }

    #[test]
    fn commands_for_another_kind_of_steering_than_that_of_the_vehicle_are_told() {
        for (vehicle, own, other) in [
            ("tractor", "STEERING_ACKERMANN", "STEERING_DIFFERENTIAL"),
            ("lagr", "STEERING_DIFFERENTIAL", "STEERING_ACKERMANN"),
        ] {
            assert_eq!(told(vehicle, own), [""; 0], "{vehicle}");
            let told = told(vehicle, other);
            let expected = format!("vehicle_interface: steering is {other}, expected {own}, which ");
            assert!(told.len() == 1 && told[0].starts_with(&expected), "{told:?}");
            assert!(told[0].contains(&format!("{vehicle}.toml says")), "{told:?}");
        }
    }
}
