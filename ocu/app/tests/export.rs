//! What `ocu export`, `ocu graph` and `ocu render` write, and the files that they refuse to write.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

mod common;

use common::{ocu, recording, text};
use rcs_log::{LogWriter, WriteHeader, WriterOptions};
use rcs_msg::{Stamp, foxglove, schema_of};
use std::collections::BTreeMap;
use std::path::Path;

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
        (
            "/localisation/local.pose.position.x",
            "no topic /localisation/local; the nearest names are /localization/local, ",
        ),
        ("1", "got 1, expected a formula with a field"),
        ("/localization/local.pose.altitude", "no field \"altitude\""),
        ("smoth(/localization/local.pose.position.x)", "got \"smoth\", expected one of smooth"),
        ("/localization/local.pose", "got a message, expected a number"),
        ("/localization/local.pose", "; it has the fields position, orientation: "),
        ("/localization/local", "got the topic /localization/local, expected a field of it: "),
        (
            "/vehicle/gps.position_covariance_type == KNWON",
            "no state \"KNWON\", expected one of UNKNOWN, APPROXIMATED, DIAGONAL_KNOWN, KNOWN",
        ),
    ] {
        let (code, _, errors) = ocu(&["export", text(&log), "--fields", field, "-o", text(&csv), "--force"]);
        assert_eq!(code, 2, "{field}");
        assert!(errors.contains(part), "{field}: {errors}");
    }
    let twice = ["export", text(&log), "--fields", X, X, "-o", text(&csv), "--force"];
    let (code, _, errors) = ocu(&twice);
    assert!(code == 2 && errors.contains(&format!("--fields has {X} twice")), "{errors}");
    let (code, _, errors) = ocu(&["export", text(&log), "--fields", X, "-o", text(&csv)]);
    assert_eq!((code, errors.contains("exists already")), (2, true), "{errors}");
    // What is not in a message has an empty cell, and is no value.
    let beyond = "/vehicle/gps.position_covariance[9]";
    let (code, told, errors) = ocu(&["export", text(&log), "--fields", beyond, "-o", text(&csv), "--force"]);
    let none = format!("{beyond}: 0 values; no message has a value at this index\n");
    assert!(code == 0 && told.starts_with(&none), "{code} {told}{errors}");
    // A text that no message has may come later, and so may a state that the enum has.
    let absent =
        ["/localization/local.frame_id == nowhere", "/vehicle/gps.position_covariance_type == UNKNOWN"];
    let fields = [&["export", text(&log), "--fields"], &absent[..]].concat();
    let (code, _, errors) = ocu(&[&fields[..], &["-o", text(&csv), "--force"]].concat());
    assert_eq!(code, 0, "{errors}");
    let late = ["--from", "50", "-o", text(&csv), "--force"];
    let (code, _, errors) = ocu(&[&["export", text(&log), "--fields", X], &late[..]].concat());
    assert!(code == 2 && errors.contains("--from is 50 s; expected at most"), "{errors}");
    assert!(errors.contains(" s, where it ends"), "{errors}");
    let parquet = dir.path().join("x.parquet");
    let (code, _, errors) = ocu(&["export", text(&log), "--fields", X, "-o", text(&parquet)]);
    assert_eq!(code, 0, "{errors}");
    let bytes = std::fs::read(&parquet).unwrap();
    assert!(bytes.starts_with(b"PAR1") && bytes.ends_with(b"PAR1"), "{} bytes", bytes.len());
}

#[test]
fn messages_that_do_not_decode_are_told_with_the_reason_and_exit_code_3() {
    let dir = tempfile::tempdir().unwrap();
    let (log, csv) = (dir.path().join("broken.mcap"), dir.path().join("x.csv"));
    let mut writer = LogWriter::create(&log, WriterOptions::default()).unwrap();
    let channel = writer.add_channel("/a", schema_of::<foxglove::Vector3>(), &BTreeMap::new()).unwrap();
    for time in 0..60 {
        let header = WriteHeader { sequence: 0, log_time: Stamp(time), publish_time: Stamp(time) };
        writer.write(channel, header, &[0xff]).unwrap();
    }
    writer.finish().unwrap();
    let (code, told, errors) = ocu(&["export", text(&log), "--fields", "/a.x", "-o", text(&csv)]);
    assert_eq!(code, 3, "{told}{errors}");
    let reason = "/a.x: 60 messages do not decode, the first: got the end of the message";
    assert!(told.contains(reason), "{told}");
}

#[test]
fn a_file_that_is_named_like_another_format_is_refused_and_so_are_flags_without_effect() {
    let (dir, log) = recording();
    let file = |name: &str| dir.path().join(name);
    let render = |name: &str, more: &[&str]| {
        let output = file(name);
        let args = ["render", text(&log), "--at", "1", "--size", "64x64", "-o", text(&output)];
        let (code, _, errors) = ocu(&[&args[..], more].concat());
        assert!(!output.exists(), "{name}");
        (code, errors)
    };
    for name in ["r.jpg", "r.gif", "r"] {
        let (code, errors) = render(name, &[]);
        assert!(code == 2 && errors.contains("expected a .png file, or a .gif file with --to"), "{errors}");
    }
    let (_, errors) = render("r.jpg", &["--course", "hill"]);
    assert!(errors.contains("a recording uses nothing of --course; expected --stack with it"), "{errors}");
    for more in [["--every", "1"], ["--speed", "2"]] {
        let (code, errors) = render("r.png", &more);
        assert!(code == 2 && errors.contains("--to"), "{errors}");
    }
    let workbook = file("e.xlsx");
    for output in [text(&workbook), "-"] {
        let (code, _, errors) = ocu(&["export", text(&log), "--fields", X, "-o", output]);
        assert!(code == 2 && errors.contains("expected a .csv or a .parquet file"), "{errors}");
    }
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
    // What is neither a bundled stack nor a .toml file is a recording, whatever its name.
    let (folder, other) = (dir.path().join("split"), dir.path().join("run.bag"));
    std::fs::create_dir(&folder).unwrap();
    for copy in [&folder.join("d_0.mcap"), &folder.join("d_1.mcap"), &other] {
        std::fs::copy(&run, copy).unwrap();
    }
    for log in [&folder, &other] {
        let (code, found, errors) = ocu(&["graph", text(log)]);
        assert_eq!((code, &found), (0, &of_stack), "{errors}");
    }
    let (code, _, errors) = ocu(&["graph", text(&run), "--course", "hill"]);
    assert!(code == 2 && errors.contains("--course is for a stack"), "{errors}");
    let (_, dot, _) = ocu(&["graph", "truth_driver", "--format", "dot"]);
    assert!(dot.starts_with("digraph") && dot.contains("style=dashed"), "{dot}");
    let (code, _, errors) = ocu(&["graph", "absent_stack"]);
    assert_eq!((code, errors.contains("absent_stack")), (2, true), "{errors}");
}

#[test]
fn render_draws_the_same_picture_twice_without_a_display() {
    let (dir, path) = recording();
    let draw = |name: &str| {
        let png = dir.path().join(name);
        let args = [
            "render",
            text(&path),
            "--layout",
            "default",
            "--at",
            "1",
            "--size",
            "640x400",
            "-o",
            text(&png),
        ];
        let (code, _, errors) = ocu(&args);
        assert_eq!(code, 0, "{errors}");
        image::open(png).unwrap().to_rgba8()
    };
    let (a, b) = (draw("a.png"), draw("b.png"));
    assert_eq!(a.dimensions(), (640, 400));
    let mut colours: Vec<[u8; 4]> = a.pixels().map(|pixel| pixel.0).collect();
    colours.sort_unstable();
    colours.dedup();
    assert!(colours.len() > 500, "{} colours: a camera picture has more", colours.len());
    assert!(a == b, "the two pictures differ");
}

#[test]
fn render_against_another_recording_draws_the_view_that_compares_and_refuses_a_layout_without_it() {
    let (dir, path) = recording();
    let draw = |name: &str, change: &[&str]| {
        let png = dir.path().join(name);
        let args = ["render", text(&path), "--at", "1", "--size", "640x400", "-o", text(&png)];
        let (code, _, errors) = ocu(&[&args[..], change].concat());
        (code, errors, image::open(&png).ok().map(|picture| picture.to_rgba8()))
    };
    let (code, errors, refused) = draw("a.png", &["--against", text(&path), "--layout", "default"]);
    assert!(code == 2 && errors.contains("--against is for the view Compare"), "{code} {errors}");
    assert!(refused.is_none());
    let (code, errors, compared) = draw("b.png", &["--against", text(&path)]);
    assert!(code == 0 && compared.is_some(), "{code} {errors}");
    assert!(compared != draw("c.png", &[]).2, "the layout that fits has no such view");
}

#[test]
fn render_draws_an_animation_of_a_range() {
    use image::AnimationDecoder as _;
    let (dir, path) = recording();
    let gif = dir.path().join("drive.gif");
    let draw = |output: &Path, change: &[&str]| {
        let args = ["render", text(&path), "--layout", "default", "--at", "0.2", "--size", "320x200", "-o"];
        let args: Vec<&str> = args.into_iter().chain([text(output)]).chain(change.iter().copied()).collect();
        ocu(&args)
    };
    let (code, _, errors) = draw(&gif, &["--to", "1.2", "--every", "0.5", "--speed", "5"]);
    assert_eq!(code, 0, "{errors}");
    let file = std::io::BufReader::new(std::fs::File::open(&gif).unwrap());
    let frames = image::codecs::gif::GifDecoder::new(file).unwrap().into_frames().collect_frames().unwrap();
    assert_eq!(frames.len(), 3);
    for frame in &frames {
        assert_eq!(frame.buffer().dimensions(), (320, 200));
        assert_eq!(std::time::Duration::from(frame.delay()), std::time::Duration::from_millis(100));
    }
    assert!(frames[0].buffer() != frames[2].buffer(), "nothing moves");
    let png = dir.path().join("drive.png");
    for (output, change, expected) in [
        (&png, ["--to", "1", "--every", "0.5"], "expected a .gif file with --to"),
        (&gif, ["--to", "0.1", "--every", "0.5"], "--to is 0.1 s; expected at least --at, 0.2 s"),
        (&gif, ["--to", "1", "--every", "0"], "expected more than 0"),
        (&gif, ["--to", "1", "--every", "0.0001"], "expected at most 1000"),
        (&gif, ["--to", "1", "--every", "1e-20"], "expected at most 1000"),
        (&gif, ["--to", "1", "--speed", "1e-20"], "expected at most 655.35 s"),
    ] {
        let change: Vec<&str> = change.into_iter().chain(["--force"]).collect();
        let (code, _, errors) = draw(output, &change);
        assert!(code == 2 && errors.contains(expected), "{code} {errors}");
    }
}

#[test]
fn a_time_beyond_the_end_is_refused_by_its_option_and_an_animation_ends_with_the_recording() {
    let (dir, path) = recording();
    let gif = dir.path().join("drive.gif");
    let draw = |at: &str| {
        let args = ["render", text(&path), "--layout", "default", "--size", "320x200", "--at", at];
        ocu(&[&args[..], &["--to", "99", "--every", "0.9", "-o", text(&gif)]].concat())
    };
    let (code, _, errors) = draw("50");
    assert!(code == 2 && errors.contains("--at is 50 s; expected at most 2.000 s, where"), "{errors}");
    assert!(!gif.exists());
    let (code, _, errors) = draw("0.2");
    assert!(code == 0 && gif.exists(), "{code} {errors}");
}
