//! `ocu export` and `ocu graph`.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

mod common;

use common::{ocu, recording, text};

const X: &str = "/localization/local.pose.position.x";

#[test]
fn fields_and_formulas_are_columns() {
    let (dir, log) = recording();
    let csv = dir.path().join("x.csv");
    let double = format!("2 * {X}");
    let fields = [X, &double, "/localization/local.frame_id"];
    let (code, out, errors) =
        ocu(&[&["export", text(&log), "--fields"], &fields[..], &["-o", text(&csv)]].concat());
    assert_eq!(code, 0, "{errors}");
    assert!(out.starts_with(&format!("{X}: ")), "{out}");
    let table = std::fs::read_to_string(&csv).unwrap();
    let mut lines = table.lines();
    assert_eq!(lines.next().unwrap(), format!("time_s,time_ns,{}", fields.join(",")));
    let rows: Vec<Vec<&str>> = lines.map(|line| line.split(',').collect()).collect();
    assert!(rows.len() > 20, "{} rows", rows.len());
    for row in rows {
        let x: f64 = row[2].parse().unwrap();
        assert_eq!(row[3].parse::<f64>().unwrap(), 2.0 * x);
        assert!(!row[4].is_empty());
    }
}

#[test]
fn a_range_is_cut_and_what_cannot_be_read_is_refused() {
    let (dir, log) = recording();
    let csv = dir.path().join("x.csv");
    let (code, _, errors) =
        ocu(&["export", text(&log), "--fields", X, "--from", "0.5", "--to", "0.75", "-o", text(&csv)]);
    assert_eq!(code, 0, "{errors}");
    let table = std::fs::read_to_string(&csv).unwrap();
    for line in table.lines().skip(1) {
        let time: f64 = line.split(',').next().unwrap().parse().unwrap();
        assert!((0.5..=0.75).contains(&time), "{line}");
    }
    for (field, part) in [
        ("/absent.x", "the log has no topic /absent"),
        ("/localization/local.pose.altitude", "no field \"altitude\""),
        ("smoth(/localization/local.pose.position.x)", "got \"smoth\", expected one of smooth"),
        ("/localization/local.pose", "got a message, expected a number"),
    ] {
        let (code, _, errors) = ocu(&["export", text(&log), "--fields", field, "-o", text(&csv), "--force"]);
        assert_eq!(code, 2, "{field}");
        assert!(errors.contains(part), "{field}: {errors}");
    }
    let (code, _, errors) = ocu(&["export", text(&log), "--fields", X, "-o", text(&csv)]);
    assert_eq!((code, errors.contains("exists already")), (2, true), "{errors}");
    let parquet = dir.path().join("x.parquet");
    let (code, _, errors) = ocu(&["export", text(&log), "--fields", X, "-o", text(&parquet)]);
    assert_eq!(code, 0, "{errors}");
    let bytes = std::fs::read(&parquet).unwrap();
    assert!(bytes.starts_with(b"PAR1") && bytes.ends_with(b"PAR1"), "{} bytes", bytes.len());
}

#[test]
fn what_is_computed_has_the_same_values_in_a_range_as_in_the_whole_recording() {
    let (dir, log) = recording();
    let formulas = [format!("integral({X})"), format!("smooth({X}, 0.4)"), format!("difference({X})")];
    let [integral, smooth, difference] = formulas.each_ref().map(String::as_str);
    let export = |name: &str, range: &[&str]| {
        let csv = dir.path().join(name);
        let fields = ["export", text(&log), "--fields", X, integral, smooth, difference];
        let (code, out, errors) = ocu(&[&fields[..], range, &["-o", text(&csv)]].concat());
        assert_eq!(code, 0, "{errors}");
        (std::fs::read_to_string(&csv).unwrap(), out)
    };
    let (whole, _) = export("whole.csv", &[]);
    let (part, told) = export("part.csv", &["--from", "0.5", "--to", "1.25"]);
    let time = |line: &str| line.split(',').next().unwrap().parse::<f64>().unwrap();
    let wanted: Vec<&str> = whole.lines().skip(1).filter(|line| (0.5..=1.25).contains(&time(line))).collect();
    let got: Vec<&str> = part.lines().skip(1).collect();
    assert!(wanted.len() > 5, "{whole}");
    assert_eq!(got, wanted);
    assert!(told.contains(&format!("{integral}: {} values", wanted.len())), "{told}");
}

#[test]
fn the_hierarchy_of_a_stack_and_of_its_recording_are_the_same() {
    let dir = tempfile::tempdir().unwrap();
    let run = dir.path().join("run.mcap");
    let (code, _, errors) =
        ocu(&["run", "--stack", "truth_driver", "--until", "0.5", "--record", text(&run)]);
    assert_eq!(code, 0, "{errors}");
    let (code, of_stack, errors) = ocu(&["graph", "truth_driver"]);
    assert_eq!(code, 0, "{errors}");
    let (_, of_log, _) = ocu(&["graph", text(&run)]);
    assert_eq!(of_stack, of_log);
    assert!(of_stack.contains("peers"), "{of_stack}");
    let (_, dot, _) = ocu(&["graph", "truth_driver", "--format", "dot"]);
    assert!(dot.starts_with("digraph") && dot.contains("style=dashed"), "{dot}");
    let (code, _, errors) = ocu(&["graph", "absent_stack"]);
    assert_eq!((code, errors.contains("absent_stack")), (2, true), "{errors}");
}
