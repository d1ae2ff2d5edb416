//! Example of a program outside of the repository: runs its own plugin and the bundled ones in one stack, without a
//! window.
//!
//! `cargo run -- [SECONDS] [NAME=VALUE ...]`, like `cargo run -- 10 odometer.report.period_s=2`.

use acme_odometer::Odometer;
use acme_odometer::proto::Distance;
use rcs_msg::Stamp;
use rcs_runtime::{Asset, Assets, Plan, PlanOptions, ProcessType, RunOptions, StackFile, Stepped};
use std::error::Error;
use std::path::Path;
use std::sync::Arc;

/// Files named by stacks: here those of the repository.
struct Folder;

impl Assets for Folder {
    fn read(&self, kind: &str, name: &str, _beside: &str) -> Result<Asset, String> {
        let root = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../assets");
        let file = format!("{kind}s/{name}.toml");
        let text = std::fs::read_to_string(Path::new(root).join(&file));
        text.map(|text| Asset { text, file: file.clone() }).map_err(|error| format!("{file}: {error}"))
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let seconds: f64 = arguments.next().map_or(Ok(5.0), |text| text.parse())?;
    let overrides: Vec<(String, String)> = arguments
        .filter_map(|argument| argument.split_once('=').map(|(name, value)| (name.into(), value.into())))
        .collect();

    let mut plugins: Vec<ProcessType> = rcs_plugins::all().to_vec();
    plugins.push(ProcessType::of::<Odometer>());

    let stack = StackFile::parse("robot.toml", include_str!("../../robot.toml"))?;
    let options = PlanOptions { overrides: &overrides, course: None, assets: &Folder };
    let plan = Plan::with(stack, &plugins, &options)?;
    let mut run = Stepped::new(Arc::new(plan), None, RunOptions::default())?;
    run.begin()?;
    run.run_until(Stamp(run.start().0 + (seconds * 1e9) as u64))?;

    for process in run.summary().processes {
        println!("{:14} {:?} {} cycles", process.name, process.state, process.cycles);
    }
    let buffer = run.bus().get("/odometer/distance").ok_or("the odometer has no buffer")?;
    let distance = buffer.latest().and_then(|sample| sample.message.to::<Distance>());
    let distance = distance.ok_or("the odometer has sent nothing")?;
    println!("driven: {:.2} m", distance.driven_m);
    Ok(())
}
