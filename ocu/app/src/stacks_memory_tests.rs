//! Runs that begin with what an earlier run remembers.

use super::{open, options, plan, plan_with};
use crate::memory::Memory;
use crate::open::Request;
use rcs_runtime::Stepped;
use rcs_runtime::source::Task;

const ROUTE: &str = r#"{"format": 1, "zone": 18, "points": [
    {"easting_m": 308210.0, "northing_m": 4333645.0}, {"easting_m": 308310.0, "northing_m": 4333645.0}]}"#;

/// What a file says.
fn loaded(text: &str) -> anyhow::Result<Memory> {
    let dir = tempfile::tempdir()?;
    let path = dir.path().join("remembered.json");
    std::fs::write(&path, text)?;
    Memory::load(&path)
}

fn with(route: &str) -> Memory {
    let file = serde_json::json!({ "format": 1, "remembered": { "waypoint_generator.route": route } });
    loaded(&file.to_string()).unwrap()
}

#[test]
fn every_stack_that_drives_by_what_it_senses_can_run_again_with_what_it_remembers_but_for_the_baseline() {
    for stack in ["lagr", "lagr_no_stereo", "lagr_stereo_only"] {
        let plan = plan(stack, Some("hill"), &[]).unwrap();
        let mut run = Stepped::new(plan, None, options()).unwrap();
        run.begin().unwrap();
        let until = run.start().after_ns(1_500_000_000);
        while run.next_time().unwrap().is_some_and(|time| time <= until) {
            run.advance().unwrap();
        }
        let goal = run.buffers().iter().find(|buffer| buffer.name() == "/waypoint_generator/goal").unwrap();
        assert!(goal.newest() > 0, "{stack} has written a goal, which is no memory");
        let memory = Memory::of(&run).unwrap();
        plan_with(stack, Some("hill"), &[], &memory).unwrap_or_else(|error| panic!("{stack}: {error}"));
        let remembers = run.plan().file.remembers();
        assert_eq!((memory.is_empty(), stack != "lagr_stereo_only"), (!remembers, remembers), "{stack}");
        if remembers {
            let request = Request {
                stack: Some(stack.to_owned()),
                course: Some("hill".to_owned()),
                ..Request::default()
            };
            let mut source = open(&request).unwrap();
            source.seek(until, &Task::default()).unwrap();
            while source.idle() {}
            assert_eq!(Memory::of_frame(&source.frame()).unwrap(), memory, "{stack}: what the window shows");
            assert_eq!(loaded(&memory.to_text().unwrap()).unwrap(), memory, "{stack}: the file");
        }
    }
}

#[test]
fn what_a_run_remembers_is_a_parameter_of_the_next_one() {
    let plan = plan_with("lagr", Some("hill"), &[], &with(ROUTE)).unwrap();
    let generator = plan.processes.iter().find(|process| &*process.name == "waypoint_generator").unwrap();
    let text = rcs_msg::to_json(&plan.files.resolve(&generator.params).unwrap()).unwrap();
    assert!(text.contains("308310"), "{text}");
    let wrong = with(&ROUTE.replace("1,", "7,"));
    let refused = plan_with("lagr", Some("hill"), &[], &wrong).unwrap_err();
    assert!(refused.to_string().contains("route of an earlier run:1: format is 7, expected 1"), "{refused}");
    let refused = plan_with("simulation", None, &[], &with(ROUTE)).unwrap_err().to_string();
    assert!(refused.contains("simulation") && refused.contains("waypoint_generator.route"), "{refused}");
}

#[test]
fn a_file_that_is_none_of_what_a_run_remembers_is_refused_with_its_place() {
    let refused = |text: &str| crate::say(&loaded(text).unwrap_err());
    let other = refused(r#"{"format": 2, "remembered": {}}"#);
    assert!(other.contains("format is 2, expected 1") && other.contains("remembered.json"), "{other}");
    assert!(refused(r#"{"format": 1}"#).contains("missing field `remembered`"));
    assert!(refused(r#"{"format": 1, "remembered": {}, "more": 1}"#).contains("unknown field `more`"));
    assert!(refused("[1").contains("line 1"), "{}", refused("[1"));
}
