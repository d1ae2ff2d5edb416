//! Composition of stacks from parts.

use rcs_runtime::{Asset, Assets, StackFile};

struct Parts(&'static [(&'static str, &'static str)]);

impl Assets for Parts {
    fn read(&self, _kind: &str, name: &str, _beside: &str) -> Result<Asset, String> {
        let part = self.0.iter().find(|(known, _)| *known == name);
        let (name, text) = part.ok_or_else(|| format!("no part {name:?}"))?;
        Ok(Asset { file: format!("{name}.toml"), text: (*text).to_owned() })
    }
}

const PAIR: &str = r#"format = 1
name = "pair"
description = "Two cameras."

[arguments]
side = { help = "left or right" }
range_m = { help = "farthest point, m", default = 10.0 }

# Both cameras of a pair.
[[process]]
name = "stereo_${side}"
plugin = "stereo"
supervisor = "viewer"

[process.inputs]
left = "/${side}/left"

[process.params]
# A comment with ${nothing} stays.
max_range_m = "${range_m}"
side = "${side}"

[buffers."/costs"]
queue = 4
"#;

fn compose(text: &str) -> Result<StackFile, String> {
    const PARTS: &[(&str, &str)] = &[
        ("pair", PAIR),
        ("loop", "format = 1\nname = \"loop\"\n\n[[include]]\npart = \"loop\"\n"),
        ("broken", "format = 1\n[[process]\n"),
        (
            "slow",
            "format = 1\nname = \"slow\"\nauthority_s = 2.5\n\n[[process]]\nname = \"slow\"\nplugin = \"x\"\n",
        ),
        ("around", "format = 1\nname = \"around\"\n\n[[include]]\npart = \"slow\"\n"),
        ("quick", "format = 1\n\nauthority_s = 1.0\n"),
        ("typo", "format = 1\nname = \"typo\"\nautority_s = 2.5\n"),
        ("newer", "name = \"newer\"\nformat = 2\n"),
        ("inline", "format = 1\ninput = [{ buffer = \"/a\", topic = \"/a\" }]\n"),
    ];
    StackFile::compose("main.toml", text, &Parts(PARTS)).map_err(|error| error.to_string())
}

const MAIN: &str = r#"format = 1
name = "main"

[[process]]
name = "first"
plugin = "x"
supervisor = "viewer"

[[include]]
part = "pair"
with = { side = "left" }

[[include]]
part = "pair"
with = { side = "right", range_m = 16 }

[change.stereo_right]
latency_ms = 20.0
params = { side = "other" }

[buffers."/costs"]
queue = 8
"#;

#[test]
fn a_part_stands_where_it_is_included_and_each_line_knows_its_file() {
    let stack = compose(MAIN).unwrap();
    let table: toml::Table = toml::from_str(&stack.text).unwrap();
    let processes = table["process"].as_array().unwrap();
    let names: Vec<_> = processes.iter().map(|process| process["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["first", "stereo_left", "stereo_right"]);
    assert_eq!(processes[1]["params"]["max_range_m"].as_float(), Some(10.0));
    assert_eq!(processes[1]["inputs"]["left"].as_str(), Some("/left/left"));
    assert_eq!(processes[2]["params"]["max_range_m"].as_integer(), Some(16), "an argument keeps its type");
    assert_eq!(processes[2]["params"]["side"].as_str(), Some("other"), "a change counts more than the part");
    assert_eq!(processes[2]["latency_ms"].as_float(), Some(20.0));
    assert_eq!(table["buffers"]["/costs"]["queue"].as_integer(), Some(8), "the including file comes last");
    assert_eq!(stack.text.lines().count(), stack.origins().len());
    let origin = |part: &str| {
        let line = stack.text.lines().position(|line| line.contains(part)).unwrap();
        let origin = &stack.origins()[line];
        format!("{}:{}", origin.file, origin.line)
    };
    assert_eq!(origin("name = \"first\""), "main.toml:5");
    assert_eq!(origin("name = \"stereo_left\""), "pair.toml:11");
    assert_eq!(origin("latency_ms"), "main.toml:18");
    assert_eq!(origin("side = \"other\""), "main.toml:19");
    assert_eq!(origin("max_range_m = 16"), "pair.toml:20");
}

#[test]
fn a_stack_without_parts_stays_as_it_is_written() {
    let text = "format = 1\nname = \"plain\"\n# A list\ncourse = \"\"\"\n[not a header]\n\"\"\"\n";
    let stack = compose(text).unwrap();
    assert_eq!(stack.text, text);
    assert_eq!(stack.origins().len(), 6);
}

#[test]
fn an_argument_in_a_comment_after_a_value_is_not_substituted() {
    let text = "format = 1\nname = \"plain # 1\" # ${side}\n";
    assert_eq!(compose(text).unwrap().text, text);
}

#[test]
fn what_is_wrong_with_an_include_is_said_with_its_file_and_line() {
    let refused = |text: &str, expected: &str| {
        let error = compose(&format!("format = 1\nname = \"main\"\n{text}")).unwrap_err();
        assert!(error.contains(expected), "{error:?} lacks {expected:?}");
    };
    refused("[[include]]\npart = \"nothing\"\n", "main.toml:4: no part \"nothing\"");
    refused("[[include]]\npart = \"pair\"\n", "main.toml:4: pair.toml needs the argument side");
    refused(
        "[[include]]\npart = \"pair\"\nwith = { side = \"left\", colour = 1 }\n",
        "main.toml:4: pair.toml has no argument \"colour\"; expected range_m or side",
    );
    refused("[[include]]\npart = \"loop\"\n", "loop.toml:5: loop.toml includes itself");
    refused("[[include]]\npart = \"broken\"\n", "broken.toml:2:");
    refused("[change.nobody]\nlatency_ms = 1.0\n", "main.toml:3: there is no process \"nobody\" to change");
    refused(
        "[[process]]\nname = \"p_${side}\"\n",
        "main.toml:4: there is no argument \"side\"; this file declares no arguments",
    );
    refused("[x]\na = \"# ${side}\"\n", "main.toml:4: there is no argument \"side\"");
    refused("[x]\na = \"\"\"\n# ${side}\n\"\"\"\n", "main.toml:5: there is no argument \"side\"");
    refused("[[process]]\nname = \"p_${side\"\n", "main.toml:4: ${ is not closed");
    refused("[[include]]\npart = \"pair\"\nwidth = 2\n", "main.toml:5: unknown field");
}

#[test]
fn what_a_part_says_of_the_whole_stack_counts_where_the_stack_does_not_say_it() {
    let with = |head: &str, parts: &[&str]| {
        let include = |part: &&str| format!("[[include]]\npart = \"{part}\"\n\n");
        let includes: Vec<_> = parts.iter().map(include).collect();
        compose(&format!("format = 1\nname = \"main\"\n{head}\n{}", includes.concat()))
    };
    let authority_s = |stack: &StackFile| {
        let table: toml::Table = toml::from_str(&stack.text).unwrap();
        table.get("authority_s").and_then(toml::Value::as_float)
    };
    let stack = with("", &["around", "slow"]).unwrap();
    assert_eq!((authority_s(&stack), stack.name()), (Some(2.5), "main"));
    let line = stack.text.lines().position(|line| line == "authority_s = 2.5").unwrap();
    let origin = &stack.origins()[line];
    assert_eq!((origin.file.as_str(), origin.line), ("slow.toml", 3));
    assert_eq!(stack.text.lines().count(), stack.origins().len());
    assert_eq!(authority_s(&with("authority_s = 7.0\n", &["slow", "quick"]).unwrap()), Some(7.0));
    assert_eq!(authority_s(&with("", &[]).unwrap()), None);

    let refused = |parts: &[&str], expected: &str| {
        let error = with("", parts).unwrap_err();
        assert!(error.contains(expected), "{error:?} lacks {expected:?}");
    };
    refused(
        &["slow", "quick"],
        "quick.toml:3: authority_s is 1.0 here and 2.5 in slow.toml:3; expected the same",
    );
    refused(&["typo"], "typo.toml:3: unknown field `autority_s` of a part; expected format, name");
    refused(&["newer"], "newer.toml:2: format 2 is not known; expected 1");
    refused(&["inline"], "inline.toml:2: input is not taken from the head of a part; expected [[input]]");
}
