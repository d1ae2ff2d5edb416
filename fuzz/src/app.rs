//! Files of an operator: layouts, and the actions of a run without a window.

use super::targets::{edited, split};
use ocu_app::layout::Layout;
use ocu_app::run::acts;
use rcs_runtime::{Plan, StackFile};
use std::sync::LazyLock;

/// A layout is accepted or refused with a line; the actions of a run are accepted or refused.
///
/// # Panics
/// If that does not hold, if an accepted layout cannot be saved and restored, or if actions are not in order.
pub fn app_file(input: &[u8]) {
    let (choice, rest) = split(input);
    let bases = &*BASES;
    let base = &bases[usize::from(choice) % bases.len()];
    let text = if choice >= 128 { rest.to_vec() } else { edited(base.as_bytes(), rest) };
    let text = String::from_utf8_lossy(&text);
    let error = if base.starts_with('[') { actions(&text) } else { layout(&text) };
    let Some(words) = error else { return };
    assert!(!words.is_empty(), "a refusal without words");
    assert!(choice >= 128 || !rest.is_empty(), "a base file has an error: {words}");
}

/// Why a layout is refused.
fn layout(text: &str) -> Option<String> {
    let lines = text.split('\n').count();
    match Layout::parse("layout.ron", text) {
        Ok(layout) => {
            let saved = layout.to_text().expect("a layout has a text");
            let again = Layout::parse("saved.ron", &saved);
            assert_eq!(again.as_ref(), Ok(&layout), "saved as\n{saved}");
            None
        }
        Err(error) => {
            assert!((1..=lines).contains(&error.line), "line {} of {lines}: {error}", error.line);
            Some(error.message)
        }
    }
}

/// Why actions are refused.
fn actions(text: &str) -> Option<String> {
    let acts = acts::parse(text, &PLAN);
    let in_order = acts.as_ref().is_ok_and(|acts| acts.is_sorted_by_key(|act| act.at_ns));
    assert!(acts.is_err() || in_order, "actions are not in order");
    acts.err()
}

/// A stack with a process that the operator can command, drive and change.
static PLAN: LazyLock<Plan> = LazyLock::new(|| {
    let text = "format = 1\nname = \"one\"\n\n[[process]]\nname = \"wm1\"\nplugin = \"world_model\"\n\
                supervisor = \"viewer\"\n";
    let plan = StackFile::parse("stack.toml", text).and_then(|file| Plan::new(file, rcs_plugins::all(), &[]));
    plan.expect("the stack has no error")
});

/// Valid files. One of actions begins with a bracket.
static BASES: LazyLock<Vec<String>> = LazyLock::new(|| {
    let acts = r#"[
  {"at_s": 0.5, "buffer": "/wm1/command", "message": {"serial": 1, "name": "RUN"}},
  {"at_s": 1, "buffer": "/wm1/params", "message": {"publish_hz": 2.5}, "every_s": 0.25, "until_s": 2.0}
]
"#;
    vec![
        acts.to_owned(),
        include_str!("../../layouts/default.ron").to_owned(),
        include_str!("../../layouts/simulation.ron").to_owned(),
        "Layout(version: 1, name: \"tabs\", buffers: false, root: Column([\n  (1.5, Tabs(active: 1, tiles: [View(kind: \
         \"map\"), View(kind: \"fields\")])),\n  (1.0, Grid([View(kind: \"camera\"), Row([])])),\n]))\n"
            .to_owned(),
    ]
});
