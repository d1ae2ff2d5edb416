//! Runs that begin with what an earlier run remembers.

use super::{open, options, plan, plan_with};
use crate::open::Request;
use crate::remembered::Remembered;
use rcs_runtime::Stepped;
use rcs_runtime::source::{Frame, Task};

const ROUTE: &str = r#"{"format": 1, "zone": 18, "points": [
    {"easting_m": 308210.0, "northing_m": 4333645.0}, {"easting_m": 308310.0, "northing_m": 4333645.0}]}"#;

/// What a file says.
fn loaded(text: &str) -> anyhow::Result<Remembered> {
    let dir = tempfile::tempdir()?;
    let path = dir.path().join("remembered.json");
    std::fs::write(&path, text)?;
    Remembered::load(&path)
}

fn with(route: &str) -> Remembered {
    let file = serde_json::json!({ "format": 1, "remembered": { "waypoint_generator.route": route } });
    loaded(&file.to_string()).unwrap()
}

/// The bundled stacks that drive by what they sense. One that reads a recording drives nothing.
fn drive_by_what_they_sense() -> Vec<&'static str> {
    let drives = |name: &&str| {
        let plan = plan(name, None, &[]).unwrap();
        let mut plugins = plan.processes.iter().map(|process| process.kind.def().plugin);
        plan.inputs.is_empty() && plugins.any(|plugin| plugin == "waypoint_generator")
    };
    crate::bundled::names("stack").into_iter().filter(drives).collect()
}

#[test]
fn every_stack_that_drives_by_what_it_senses_can_run_again_with_what_it_remembers_but_for_the_baseline() {
    let stacks = drive_by_what_they_sense();
    assert!(stacks.contains(&"lagr") && stacks.contains(&"lagr_stereo_only"), "{stacks:?}");
    for stack in stacks {
        let plan = plan(stack, Some("hill"), &[]).unwrap();
        let mut run = Stepped::new(plan, None, options()).unwrap();
        run.begin().unwrap();
        let until = run.start().after_ns(1_500_000_000);
        while run.next_time().unwrap().is_some_and(|time| time <= until) {
            run.advance().unwrap();
        }
        let goal = run.buffers().iter().find(|buffer| buffer.name() == "/waypoint_generator/goal").unwrap();
        assert!(goal.newest() > 0, "{stack} has written a goal, which is no memory");
        let remembered = Remembered::of(&run).unwrap();
        plan_with(stack, Some("hill"), &[], &remembered).unwrap_or_else(|error| panic!("{stack}: {error}"));
        let remembers = run.plan().file.remembers();
        assert_eq!((remembered.is_empty(), stack != "lagr_stereo_only"), (!remembers, remembers), "{stack}");
        if remembers {
            let request = Request {
                stack: Some(stack.to_owned()),
                course: Some("hill".to_owned()),
                ..Request::default()
            };
            let mut source = open(&request).unwrap();
            source.seek(until, &Task::default()).unwrap();
            while source.idle() {}
            let shown = Remembered::of_frame(&source.frame()).unwrap();
            assert_eq!(shown, remembered, "{stack}: what the window shows");
            let names: Vec<&str> = remembered.names().collect();
            assert_eq!(remembered.in_force(&source.frame()), names, "{stack}: what the window says");
            assert_eq!(loaded(&remembered.to_text().unwrap()).unwrap(), remembered, "{stack}: the file");
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
    let refused = plan_with("lagr_stereo_only", Some("hill"), &[], &with(ROUTE)).unwrap_err().to_string();
    assert_eq!(refused, "the stack lagr_stereo_only remembers nothing from run to run");
}

#[test]
fn a_warning_names_what_a_stack_has_no_parameter_for_and_a_refusal_is_wrong_usage() {
    let texts = serde_json::json!({ "absent.map": ROUTE, "waypoint_generator.route": ROUTE });
    let remembered = loaded(&serde_json::json!({ "format": 1, "remembered": texts }).to_string()).unwrap();
    let warnings = plan_with("lagr", Some("hill"), &[], &remembered).unwrap().warnings.clone();
    assert!(warnings.iter().any(|warning| warning.ends_with("remembers: absent.map")), "{warnings:?}");
    let known = plan_with("lagr", Some("hill"), &[], &with(ROUTE)).unwrap().warnings.clone();
    assert!(!known.iter().any(|warning| warning.contains("an earlier run remembers")), "{known:?}");
    for stack in ["simulation", "lagr_stereo_only"] {
        let refused = plan_with(stack, None, &[], &remembered).unwrap_err();
        assert_eq!(crate::code_of(&refused), crate::USAGE, "{refused}");
    }
}

#[test]
fn a_file_of_what_one_process_remembers_is_refused_with_the_parameter_that_reads_it() {
    let check = |text: &str, expected: &str| {
        let error = crate::say(&loaded(text).unwrap_err());
        assert!(error.contains(expected) && error.contains("remembered.json"), "{error}");
    };
    check(
        r#"{"format": 1, "zone": 18, "eastingM": 5.0, "columns": 3}"#,
        "ocu run --param map_memory.memory=",
    );
    check(r#"{"format": 1, "zone": 18, "places": []}"#, "ocu run --param waypoint_generator.slips=");
    for text in ["{}", "[]", r#"{"format": 1, "nonsense": 2}"#] {
        let error = crate::say(&loaded(text).unwrap_err());
        assert!(!error.contains("--param"), "{error}");
    }
}

/// What the window shows of a stack that has not run yet.
fn first_frame(stack: &str) -> Frame {
    open(&Request { stack: Some(stack.to_owned()), ..Request::default() }).unwrap().frame()
}

#[test]
fn what_is_still_being_computed_is_told_and_not_left_out() {
    let mut frame = first_frame("lagr");
    assert!(Remembered::of_frame(&frame).is_ok());
    let pending = |topic: &rcs_runtime::source::Topic| {
        let mut topic = topic.clone();
        topic.pending = true;
        topic
    };
    frame.topics = frame.topics.iter().map(pending).collect();
    let refused = Remembered::of_frame(&frame).unwrap_err().to_string();
    assert!(refused.ends_with(" of this moment is still being computed; try again"), "{refused}");
}

#[test]
fn of_what_is_remembered_only_the_parameters_that_a_stack_has_are_in_force() {
    let names = ["absent.map", "waypoint_generator.absent", "waypoint_generator.route"];
    let texts: std::collections::BTreeMap<&str, &str> = names.into_iter().map(|name| (name, ROUTE)).collect();
    let file = serde_json::json!({ "format": 1, "remembered": texts });
    let remembered = loaded(&file.to_string()).unwrap();
    assert_eq!(remembered.in_force(&first_frame("lagr")), ["waypoint_generator.route"]);
    assert!(remembered.in_force(&first_frame("simulation")).is_empty());
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
