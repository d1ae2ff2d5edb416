//! Compares the lists of plugins and views with the README.

use rcs_msg::params::{ParamKind, ParamSpec, specs};
use rcs_runtime::{Plan, StackFile};

use super::assert_kept;
use super::tree::read;

/// The rows of the first table below a heading: cells without backticks, without the table's header and rule.
fn table(page: &str, heading: &str) -> Vec<Vec<String>> {
    let section = page.lines().skip_while(|line| line.trim() != heading).skip(1);
    let rows =
        section.skip_while(|line| !line.starts_with('|')).take_while(|line| line.starts_with('|')).skip(2);
    let cells = |row: &str| {
        let inner = row.trim().trim_matches('|');
        inner.split('|').map(|cell| cell.trim().replace('`', "")).collect()
    };
    rows.map(cells).collect()
}

/// Differences between a page's table and a list; both consist of (name, sentence).
fn differences(page: &str, heading: &str, listed: &[(String, String)]) -> Vec<String> {
    let rows = table(page, heading);
    let expected: Vec<Vec<String>> =
        listed.iter().map(|(name, text)| vec![name.clone(), text.clone()]).collect();
    let missing =
        expected.iter().filter(|row| !rows.contains(row)).map(|row| format!("not in the README: {row:?}"));
    let surplus =
        rows.iter().filter(|row| !expected.contains(row)).map(|row| format!("only in the README: {row:?}"));
    let mut breaches: Vec<String> = missing.chain(surplus).collect();
    if breaches.is_empty() && rows != expected {
        breaches.push(format!("the README's order is another than {listed:?}"));
    }
    breaches
}

fn repeated(names: &[&str]) -> Vec<String> {
    let again = names.iter().enumerate().filter(|(at, name)| names[..*at].contains(name));
    again.map(|(_, name)| format!("{name} is listed twice")).collect()
}

/// Options that are missing for a control of the window and for a sentence of `--help`.
fn undeclared(spec: &ParamSpec) -> Vec<&'static str> {
    let is_number = matches!(spec.kind, ParamKind::Number | ParamKind::Integer);
    let ranged = spec.min.zip(spec.max).is_some_and(|(min, max)| min < max);
    let fits = spec.default.as_f64().zip(spec.min.zip(spec.max));
    let fits = fits.is_some_and(|(default, (min, max))| (min..=max).contains(&default));
    let checks = [
        (spec.help.trim().is_empty(), "help"),
        (is_number && spec.unit.is_empty(), "unit"),
        (is_number && !ranged, "range"),
        (is_number && !fits, "default within its range"),
    ];
    checks.into_iter().filter(|(missing, _)| *missing).map(|(_, what)| what).collect()
}

/// [`undeclared`] for parameters and for everything nested in them.
fn undeclared_within(specs: &[ParamSpec], name: &str) -> Vec<String> {
    let of = |spec: &ParamSpec| {
        let name = format!("{name}.{}", spec.name);
        let own = undeclared(spec).into_iter().map(|what| format!("{name} has no {what}"));
        own.chain(undeclared_within(&spec.fields, &name)).collect::<Vec<_>>()
    };
    specs.iter().flat_map(of).collect()
}

#[test]
fn every_parameter_has_unit_range_default_and_help() {
    let mut breaches = Vec::new();
    for plugin in rcs_plugins::all() {
        let schema = plugin.params_schema();
        let descriptor = schema.descriptor().expect("parameters are protobuf");
        let declared = specs(descriptor);
        if declared.len() != descriptor.fields().len() {
            breaches.push(format!("{} has fields that are no parameters", schema.name()));
        }
        breaches.extend(undeclared_within(&declared, schema.name()));
    }
    assert_kept("a parameter says all about itself", &breaches);
}

#[test]
fn a_parameter_without_help_unit_or_range_is_found() {
    let sound = ParamSpec {
        name: "speed_mps".to_owned(),
        kind: ParamKind::Number,
        unit: "m/s".to_owned(),
        min: Some(0.0),
        max: Some(2.0),
        default: rcs_msg::Value::Float(1.0),
        help: "How fast.".to_owned(),
        file: None,
        role: String::new(),
        choices: Vec::new(),
        fields: Vec::new(),
    };
    assert_eq!(undeclared(&sound), [""; 0]);
    let group =
        |fields| ParamSpec { name: "drive".to_owned(), kind: ParamKind::Group, fields, ..sound.clone() };
    assert_eq!(undeclared_within(&[group(vec![sound.clone()])], "P"), [""; 0]);
    let mute = ParamSpec { help: String::new(), ..sound.clone() };
    assert_eq!(undeclared_within(&[group(vec![mute])], "P"), ["P.drive.speed_mps has no help"]);
    let bare = ParamSpec { unit: String::new(), max: None, help: String::new(), ..sound.clone() };
    assert_eq!(undeclared(&bare), ["help", "unit", "range", "default within its range"]);
    let outside = ParamSpec { default: rcs_msg::Value::Float(3.0), ..sound };
    assert_eq!(undeclared(&outside), ["default within its range"]);
}

#[test]
fn readme_lists_the_plugins() {
    let plugins = rcs_plugins::all();
    let listed: Vec<_> = plugins
        .iter()
        .map(|plugin| (plugin.def().plugin.to_owned(), plugin.def().summary.to_owned()))
        .collect();
    assert_kept("the README lists every plugin", &differences(&read("README.md"), "## Processes", &listed));
    let names: Vec<_> = plugins.iter().map(|plugin| plugin.def().plugin).collect();
    assert_kept("plugins have names of their own", &repeated(&names));
}

/// Plugins that may read the ground truth of a simulation: those of the simulation, and the one that replaces planning.
const READ_GROUND_TRUTH: [&str; 4] = ["sim_cameras", "sim_ladar", "sim_vehicle", "truth_driver"];

#[test]
fn nobody_else_reads_the_truth() {
    let readers =
        rcs_plugins::all().iter().map(rcs_runtime::ProcessType::def).filter(|def| def.reads_ground_truth);
    let others = readers.filter(|def| !READ_GROUND_TRUTH.contains(&def.plugin));
    let breaches: Vec<_> = others.map(|def| format!("{} reads the truth", def.plugin)).collect();
    assert_kept("a process finds the truth out", &breaches);
}

#[test]
fn readme_lists_the_views() {
    let views = ocu_views::all();
    let listed: Vec<_> = views.iter().map(|view| (view.name.to_owned(), view.summary.to_owned())).collect();
    assert_kept("the README lists every view", &differences(&read("README.md"), "## Views", &listed));
    let kinds: Vec<_> = views.iter().map(|view| view.kind).collect();
    assert_kept("views have names of their own in layouts", &repeated(&kinds));
}

/// The first code block of that language on a page.
fn code_block<'a>(page: &'a str, language: &str) -> Option<&'a str> {
    let start = page.find(&format!("```{language}\n"))? + language.len() + 4;
    page[start..].split("```").next()
}

#[test]
fn the_stack_of_the_readme_runs() {
    let page = read("README.md");
    let text = code_block(&page, "toml").expect("the README shows a stack file");
    let plan = StackFile::parse("README.md", text).and_then(|file| Plan::new(file, rcs_plugins::all(), &[]));
    let plan = plan.unwrap_or_else(|error| panic!("{error} of the example"));
    assert_eq!(plan.processes.len(), 2);
    assert_eq!(code_block("a\n```sh\nls\n```\n```toml\nb = 1\n```\n", "toml"), Some("b = 1\n"));
}

#[test]
fn a_row_that_is_missing_changed_or_out_of_order_is_found() {
    let page = "# X\n\n## Other\n\n| a | b |\n| --- | --- |\n| x | y |\n\n## Views\n\nWords.\n\n\
                | view | shows |\n| --- | --- |\n| `camera` | Images. |\n| `map` | Cells. |\n\nMore.\n";
    let list = |rows: &[(&str, &str)]| -> Vec<(String, String)> {
        rows.iter().map(|(name, text)| ((*name).to_owned(), (*text).to_owned())).collect()
    };
    let check = |rows: &[(&str, &str)]| differences(page, "## Views", &list(rows)).len();
    assert_eq!(check(&[("camera", "Images."), ("map", "Cells.")]), 0);
    assert_eq!(check(&[("map", "Cells."), ("camera", "Images.")]), 1);
    assert_eq!(check(&[("camera", "Images.")]), 1);
    assert_eq!(check(&[("camera", "Clouds."), ("map", "Cells.")]), 2);
    assert_eq!(repeated(&["a", "b", "a"]).len(), 1);
}
