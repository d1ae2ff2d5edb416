//! `docs/reference/modes.md`: every key of a table of modes, from the structures that it is read into.

use super::check_reference;
use super::declarations::{Item, fields, keys, variants, words};
use rcs_planner::modes::Table;

const FILE: &str = "plugins/planner/src/modes.rs";

const EXAMPLE: &str = r#"format = 1

[[mode]]
name = "REVERSE_FROM_BUMPER"
priority = 5
enter = [{ signal = "bumper", at_least = 1.0 }]
exit = [{ signal = "moved_m", at_least = 0.5 }, { signal = "mode_s", at_least = 4.0 }]
action = "REVERSE"
max_speed_mps = 0.25
"#;

/// The variants of an enum as a file writes them.
fn capitals(name: &str) -> Vec<Item> {
    let mut items = variants(FILE, name);
    for item in &mut items {
        item.name = item.name.to_uppercase();
    }
    items
}

#[test]
fn the_reference_of_modes_is_made_from_what_reads_them() {
    let text = [
        "# Tables of modes\n\nTOML; every key of a file of custom behaviors of `waypoint_follower` (its parameter \
         `modes`), made from the structures that it is read into. An unknown key is an error. \
         [assets/modes/lagr.toml](../../assets/modes/lagr.toml) is the table of the stack `lagr`, and \
         [Autonomous driving](../autonomy.md) says what its modes do.\n\n```toml\n",
        EXAMPLE,
        "```\n\nA mode of higher priority interrupts one of lower priority. Without a mode, the vehicle is driven by the \
         parameters of the process.\n\n## At the top\n\n",
        &keys(&fields(FILE, "Table")),
        "## `[[mode]]`\n\n",
        &keys(&fields(FILE, "Mode")),
        &words("`action`", &capitals("Action")),
        &words("`obstacles`", &capitals("Obstacles")),
        &words("`towards`", &capitals("Towards")),
        &words("`bars`", &capitals("Bars")),
        "## Conditions\n\nA condition of `enter` or `exit` has either `at_least` or `at_most`.\n\n",
        &keys(&fields(FILE, "Condition")),
        &words("`signal`", &variants(FILE, "Signal")),
    ]
    .concat();
    check_reference("modes", &format!("{}\n", text.trim_end()));
}

#[test]
fn the_table_on_the_page_is_read_and_ranges_are_those_of_the_reader() {
    let with = |line: &str| Table::parse(&format!("{EXAMPLE}{line}\n").replace("max_speed_mps = 0.25\n", ""));
    for (key, accepted, refused) in [
        ("max_speed_mps", ["0.001", "600.0"], ["0.0", "600.1"]),
        ("min_speed_mps", ["0.001", "600.0"], ["0.0", "600.1"]),
        ("least_free_m", ["0.001", "600.0"], ["0.0", "600.1"]),
        ("pause_s", ["0.0", "600.0"], ["-0.0001", "600.1"]),
        ("bars_m", ["0.0", "600.0"], ["-0.0001", "600.1"]),
        ("yaw_rate_radps", ["-9.0", "9.0"], ["inf", "nan"]),
        ("arcs_per_side", ["1", "50"], ["0", "51"]),
    ] {
        for value in accepted {
            assert!(with(&format!("{key} = {value}")).is_ok(), "{key} = {value}");
        }
        for value in refused {
            assert!(with(&format!("{key} = {value}")).is_err(), "{key} = {value}");
        }
    }
    let with = |condition: &str| Table::parse(&EXAMPLE.replace("at_least = 1.0", condition));
    assert!(with("at_most = 1.0, for_s = 600.0").is_ok() && with("at_most = 1.0, for_s = 600.1").is_err());
    let choices = [
        ("action", capitals("Action")),
        ("obstacles", capitals("Obstacles")),
        ("towards", capitals("Towards")),
        ("bars", capitals("Bars")),
    ];
    for (key, items) in choices {
        for Item { name, .. } in items {
            let text = EXAMPLE.replace("action = \"REVERSE\"\n", "");
            assert!(Table::parse(&format!("{text}{key} = \"{name}\"\n")).is_ok(), "{key} = {name}");
        }
    }
}
