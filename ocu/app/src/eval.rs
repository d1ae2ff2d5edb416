//! `ocu eval`: quality and speed of a method on the user's own data.

use crate::assets::ProgramAssets;
use crate::cli::{
    EvalClassifyArgs, EvalColorArgs, EvalCommand, EvalObstaclesArgs, EvalPlanArgs, EvalStereoArgs, Param,
    StereoMethod,
};
use crate::{Ended, runs, stacks, usage};
use rcs_eval::{ClassReport, EvalError, classify, color, obstacles, plan, stereo};
use rcs_log::Log;
use rcs_runtime::{Plan, RunOptions};
use rcs_stereo::Method;
use serde::Serialize;
use std::fmt::Display;
use std::io::Write;
use std::sync::Arc;

/// Runs the evaluation and prints its results.
pub fn eval(command: &EvalCommand, out: &mut dyn Write) -> anyhow::Result<Ended> {
    match command {
        EvalCommand::Classify(args) => {
            let log = args.log.as_deref().map(stacks::open_full).transpose()?;
            print(&classes(args, log.as_ref())?, args.json, out)?;
            return Ok(Ended::after(log.as_ref()));
        }
        EvalCommand::Obstacles(args) => {
            let log = stacks::open_full(&args.run)?;
            print(&arcs(args, &log)?, args.json, out)?;
            return Ok(Ended::after(Some(&log)));
        }
        EvalCommand::Color(args) => print(&colors(args).map_err(told)?, args.json, out)?,
        EvalCommand::Plan(args) => print_json(&paths(args).map_err(told)?, out)?,
        EvalCommand::Stereo(args) => print(&disparities(args).map_err(told)?, args.json, out)?,
    }
    Ok(Ended::Well)
}

fn print(report: &(impl Display + Serialize), json: bool, out: &mut dyn Write) -> anyhow::Result<()> {
    if json {
        return print_json(report, out);
    }
    Ok(write!(out, "{report}")?)
}

fn print_json(report: &impl Serialize, out: &mut dyn Write) -> anyhow::Result<()> {
    serde_json::to_writer_pretty(&mut *out, report)?;
    Ok(writeln!(out)?)
}

/// Converts an error so that the exit code distinguishes wrong usage.
pub(crate) fn told(error: EvalError) -> anyhow::Error {
    match error {
        EvalError::Refused(text) => usage(text),
        EvalError::Run(error) => error.into(),
        error => error.into(),
    }
}

fn disparities(args: &EvalStereoArgs) -> Result<stereo::Report, EvalError> {
    stereo::measure(&stereo::Job {
        left: &args.left,
        right: &args.right,
        calibration: args.calib.as_deref(),
        truth: args.truth.as_deref(),
        method: match args.method {
            StereoMethod::Bm => Method::Block,
            StereoMethod::Sgm => Method::SemiGlobal,
        },
        disparities: args.disparities,
        threads: usize::from(args.threads),
    })
}

fn paths(args: &EvalPlanArgs) -> Result<plan::Report, EvalError> {
    plan::measure(&plan::Job { map: &args.map, scenarios: &args.scen })
}

fn colors(args: &EvalColorArgs) -> Result<ClassReport, EvalError> {
    color::measure(&color::Job {
        images: &args.image,
        labels: &args.labels,
        ground_ids: &args.ground_ids,
        ignored_ids: &args.ignore_ids,
        apriori: &args.apriori,
        assets: &ProgramAssets,
        horizon_pct: args.horizon,
    })
}

fn classes(args: &EvalClassifyArgs, log: Option<&Log>) -> anyhow::Result<ClassReport> {
    let job = classify::Job {
        truth_topic: &args.truth_topic,
        topic: args.topic.as_deref(),
        tolerance_s: args.tolerance,
    };
    let Some(stack) = &args.stack else {
        let log = log.ok_or_else(|| usage("expected a recording or a stack, got neither"))?;
        return classify::recording(&job, log).map_err(told);
    };
    let plan = plan_of(args, stack, log)?;
    runs::check(&plan, log, args.until, args.course.is_some())?;
    let run = classify::StackRun {
        plan,
        log,
        options: RunOptions { seed: args.seed, ..stacks::options() },
        until_s: args.until,
    };
    classify::stack(&job, run).map_err(told)
}

/// The stack that makes the label images, with the course of the arguments, or that of the recording that it reads.
fn plan_of(args: &EvalClassifyArgs, stack: &str, log: Option<&Log>) -> anyhow::Result<Arc<Plan>> {
    let overrides: Vec<(String, String)> = args.params.iter().map(Param::to_override).collect();
    let course = stacks::course_on(stack, args.course.as_deref(), log);
    stacks::plan(stack, course.as_deref(), &overrides)
}

fn arcs(args: &EvalObstaclesArgs, log: &Log) -> anyhow::Result<obstacles::Report> {
    let job = obstacles::Job {
        map: args.map.clone(),
        true_map: args.truth_map.clone(),
        true_pose: args.truth_pose.clone(),
        pose: args.pose.clone(),
        vehicle: obstacles::Vehicle {
            width_m: args.width,
            front_m: args.front,
            view_rad: args.view.map(f64::to_radians),
            eye_height_m: args.eye_height,
        },
        settings: obstacles::Settings { tolerance_m: args.tolerance, ..obstacles::Settings::default() },
    };
    obstacles::recording(&job, log).map_err(told)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcs_log::{LogWriter, WriteHeader, WriterOptions};
    use rcs_msg::rcs::CourseRun;
    use rcs_msg::{AnyMessage, Stamp, schema_of};
    use std::collections::BTreeMap;

    #[test]
    fn a_stack_on_a_recording_of_a_course_is_evaluated_on_that_course() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("hill.mcap");
        let mut writer = LogWriter::create(&path, WriterOptions::default()).unwrap();
        let channel = writer.add_channel("/course", schema_of::<CourseRun>(), &BTreeMap::new()).unwrap();
        let run = CourseRun { course: "hill".to_owned(), ..CourseRun::default() };
        let header = WriteHeader { sequence: 1, log_time: Stamp(1), publish_time: Stamp(1) };
        writer.write(channel, header, &AnyMessage::new(run).bytes()).unwrap();
        writer.finish().unwrap();
        let log = stacks::open_log(&path).unwrap();
        let goal = |course: Option<&str>| {
            let args = EvalClassifyArgs {
                log: Some(path.clone()),
                truth_topic: "/labels".to_owned(),
                topic: None,
                stack: Some("replay".to_owned()),
                course: course.map(str::to_owned),
                seed: 0,
                params: Vec::new(),
                until: None,
                tolerance: 0.005,
                json: false,
            };
            let plan = plan_of(&args, "replay", Some(&log)).unwrap();
            let mut processes = plan.processes.iter();
            let generator = processes.find(|process| &*process.name == "waypoint_generator").unwrap();
            generator.params.value().unwrap().field("goal").cloned()
        };
        assert!(goal(None).is_some());
        assert_eq!(goal(None), goal(Some("hill")));
        assert_ne!(goal(None), goal(Some("meadow")));
    }
}
