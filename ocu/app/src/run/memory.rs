//! The memory of a run, which `ocu run --runs` hands to the next one.
//!
//! What a process remembers is an output that has the name of one of its parameters, where that parameter holds a file:
//! `ocu run --save` writes it, and the parameter reads it. So the next run begins with what the one before has learned.

use crate::assets::ProgramAssets;
use crate::stacks;
use rcs_runtime::{Asset, Assets, Plan, PlanOptions, Stepped};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Kinds of files that processes write: what they learned, the way that they drove, where it was slippery, and the map of
/// it. Files of other kinds are written by people, and an output of the same name (the goal of a course, and the goal in
/// the local frame) is something else.
const REMEMBERED: [&str; 4] = ["models", "route", "slips", "map"];

/// Texts by parameter: `process.field`.
#[derive(Clone, Debug, Default)]
pub(super) struct Memory {
    texts: BTreeMap<String, String>,
}

impl Memory {
    /// What the processes of a run remember at its end; nothing of a stack that does not remember.
    pub(super) fn of(run: &Stepped) -> anyhow::Result<Self> {
        let mut texts = BTreeMap::new();
        if !run.plan().file.remembers() {
            return Ok(Self { texts });
        }
        for process in &run.plan().processes {
            let schema = process.params.schema();
            let Some(descriptor) = schema.descriptor() else { continue };
            let is_remembered = |spec: &rcs_msg::params::ParamSpec| {
                spec.file.as_deref().is_some_and(|kind| REMEMBERED.contains(&kind))
            };
            let fields = rcs_msg::params::specs(descriptor).into_iter().filter(is_remembered);
            let names: Vec<String> = fields.map(|spec| spec.name).collect();
            for (port, &buffer) in process.kind.outputs().iter().zip(&process.outputs) {
                let newest =
                    run.buffers()[buffer].latest().filter(|_| names.iter().any(|name| name == port.name));
                if let Some(sample) = newest {
                    let text = rcs_msg::to_json(&sample.message)?;
                    texts.insert(format!("{}.{}", process.name, port.name), text);
                }
            }
        }
        Ok(Self { texts })
    }

    /// Adds what a later run remembers; what it has forgotten stays.
    pub(super) fn add(&mut self, later: Memory) {
        self.texts.extend(later.texts);
    }

    /// The plan of the next run: that of the first one, with this memory.
    pub(super) fn plan(
        &self,
        stack: &str,
        course: Option<&str>,
        overrides: &[(String, String)],
    ) -> anyhow::Result<Arc<Plan>> {
        let remembered = self.texts.keys().map(|name| (name.clone(), name.clone()));
        let overrides: Vec<(String, String)> = overrides.iter().cloned().chain(remembered).collect();
        let options = PlanOptions { overrides: &overrides, course, assets: self };
        Ok(Arc::new(Plan::with(stacks::named(stack)?, rcs_plugins::all(), &options)?))
    }
}

impl Assets for Memory {
    fn read(&self, kind: &str, name: &str, beside: &str) -> Result<Asset, String> {
        match self.texts.get(name) {
            Some(text) => Ok(Asset { file: format!("{name} of the run before"), text: text.clone() }),
            None => ProgramAssets.read(kind, name, beside),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROUTE: &str = r#"{"format": 1, "zone": 18, "points": [
        {"easting_m": 308210.0, "northing_m": 4333645.0}, {"easting_m": 308310.0, "northing_m": 4333645.0}]}"#;

    fn with(text: &str) -> Memory {
        Memory { texts: [("waypoint_generator.route".to_owned(), text.to_owned())].into() }
    }

    #[test]
    fn every_stack_that_drives_by_what_it_senses_can_run_again_with_what_it_remembers_but_for_the_baseline() {
        for stack in ["lagr", "lagr_no_stereo", "lagr_stereo_only"] {
            let plan = stacks::plan(stack, Some("hill"), &[]).unwrap();
            let mut run = Stepped::new(plan, None, stacks::options()).unwrap();
            run.begin().unwrap();
            let until = run.start().after_ns(1_500_000_000);
            while run.next_time().unwrap().is_some_and(|time| time <= until) {
                run.advance().unwrap();
            }
            let goal =
                run.buffers().iter().find(|buffer| buffer.name() == "/waypoint_generator/goal").unwrap();
            assert!(goal.newest() > 0, "{stack} has written a goal, which is no memory");
            let memory = Memory::of(&run).unwrap();
            memory.plan(stack, Some("hill"), &[]).unwrap_or_else(|error| panic!("{stack}: {error}"));
            let remembers = run.plan().file.remembers();
            assert_eq!(
                (memory.texts.is_empty(), stack != "lagr_stereo_only"),
                (!remembers, remembers),
                "{stack}"
            );
        }
    }

    #[test]
    fn what_a_run_remembers_is_a_parameter_of_the_next_one() {
        let plan = with(ROUTE).plan("lagr", Some("hill"), &[]).unwrap();
        let generator = plan.processes.iter().find(|process| &*process.name == "waypoint_generator").unwrap();
        let text = rcs_msg::to_json(&plan.files.resolve(&generator.params).unwrap()).unwrap();
        assert!(text.contains("308310"), "{text}");
        let refused = with(&ROUTE.replace("1,", "7,")).plan("lagr", Some("hill"), &[]).unwrap_err();
        assert!(refused.to_string().contains("route: format is 7, expected 1"), "{refused}");
    }
}
