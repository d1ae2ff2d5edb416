//! `ocu eval`: quality and speed of a method on the user's own data.

use crate::assets::ProgramAssets;
use crate::cli::{
    EvalClassifyArgs, EvalColorArgs, EvalCommand, EvalObstaclesArgs, EvalPlanArgs, EvalStereoArgs, Param,
    StereoMethod,
};
use crate::{Ended, runs, stacks, usage};
use rcs_eval::{ClassReport, EvalError, classify, color, obstacles, plan, stereo};
use rcs_log::Log;
use rcs_runtime::RunOptions;
use rcs_stereo::Method;
use serde::Serialize;
use std::fmt::Display;
use std::io::Write;

/// Runs the evaluation and prints its results.
pub fn eval(command: &EvalCommand, out: &mut dyn Write) -> anyhow::Result<Ended> {
    match command {
        EvalCommand::Classify(args) => {
            let log = args.log.as_ref().map(stacks::open_log).transpose()?;
            print(&classes(args, log.as_ref())?, args.json, out)?;
            return Ok(Ended::after(log.as_ref()));
        }
        EvalCommand::Obstacles(args) => {
            let log = stacks::open_log(&args.run)?;
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
    let overrides: Vec<(String, String)> = args.params.iter().map(Param::to_override).collect();
    let plan = stacks::plan(stack, args.course.as_deref(), &overrides)?;
    runs::check(&plan, log, args.until, args.course.is_some())?;
    let run = classify::StackRun {
        plan,
        log,
        options: RunOptions { seed: args.seed, ..stacks::options() },
        until_s: args.until,
    };
    classify::stack(&job, run).map_err(told)
}

fn arcs(args: &EvalObstaclesArgs, log: &Log) -> anyhow::Result<obstacles::Report> {
    let job = obstacles::Job {
        map: args.map.clone(),
        true_map: args.truth_map.clone(),
        true_pose: args.truth_pose.clone(),
        pose: args.pose.clone(),
        settings: obstacles::Settings {
            width_m: args.width,
            front_m: args.front,
            tolerance_m: args.tolerance,
            ..obstacles::Settings::default()
        },
    };
    obstacles::recording(&job, log).map_err(told)
}
