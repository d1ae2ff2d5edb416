//! The document of the window: which views are where, with undo and redo.
//!
//! Views have stable ids, so that going to another state keeps those that are in both, with their textures. Where a
//! view looks (its viewport) is stored, but is no step of its own: undo brings back what was arranged, not what was
//! looked at. Nor is each letter of a formula that is being written: undo brings back the line with all of its text.

use crate::layout::{Layout, Node};
use serde_json::{Map, Value};

/// Number of steps that are kept.
const MOST: usize = 100;
/// Field of a view's state that is no step of its own.
pub(super) const VIEWPORT: &str = "viewport";
/// Field of a view's state with the line in which something is being written, and the field of that with its text, which
/// is no step of its own.
const ENTRY: [&str; 2] = ["entry", "text"];

/// The arrangement and its history.
#[derive(Debug, Default)]
pub(super) struct Document {
    now: Option<Layout>,
    past: Vec<Layout>,
    future: Vec<Layout>,
    /// The arrangement that was last adapted to a source: how the user left it, and as adapted.
    adapted: Option<[Layout; 2]>,
}

impl Document {
    /// Records the arrangement after an action; returns whether it differs from the last one.
    pub(super) fn record(&mut self, layout: &Layout) -> bool {
        let Some(now) = &self.now else {
            self.now = Some(layout.clone());
            return false;
        };
        if now == layout {
            return false;
        }
        if steps(now) != steps(layout) {
            let before = now.clone();
            self.add_step(before);
        }
        self.now = Some(layout.clone());
        true
    }

    /// Takes over an arrangement that was adapted to a source from how the user left it. It is a step only from an
    /// arrangement of another name, and not to be kept for the next start as long as the user changes nothing.
    pub(super) fn adapt(&mut self, left: Layout, adapted: Layout) {
        let before = self.now.replace(adapted.clone());
        if let Some(before) = before.filter(|before| before.name != adapted.name) {
            self.add_step(before);
        }
        self.adapted = Some([left, adapted]);
    }

    /// Adds a step that leaves an arrangement. What was undone cannot be redone any more.
    fn add_step(&mut self, before: Layout) {
        self.past.push(before);
        let surplus = self.past.len().saturating_sub(MOST);
        self.past.drain(..surplus);
        self.future.clear();
    }

    /// How the user left this arrangement, before it was adapted to a source: as it is if it was not adapted, or if the
    /// user has changed it since. Where its views look is no change.
    pub(super) fn left_as(&self, layout: Layout) -> Layout {
        match &self.adapted {
            Some([left, adapted]) if without_viewports(adapted) == without_viewports(&layout) => left.clone(),
            _ => layout,
        }
    }

    pub(super) fn can_undo(&self) -> bool {
        !self.past.is_empty()
    }

    pub(super) fn can_redo(&self) -> bool {
        !self.future.is_empty()
    }

    /// Takes over what the window shows after it has gone to a step. That may differ by the rounding of shares, and is
    /// no step of its own.
    pub(super) fn arrive(&mut self, shown: Layout) {
        self.now = Some(shown);
    }

    /// The arrangement before the last step.
    pub(super) fn undo(&mut self) -> Option<Layout> {
        let before = self.past.pop()?;
        self.future.extend(self.now.replace(before.clone()));
        Some(before)
    }

    /// The arrangement after the step that was undone last.
    pub(super) fn redo(&mut self) -> Option<Layout> {
        let after = self.future.pop()?;
        self.past.extend(self.now.replace(after.clone()));
        Some(after)
    }
}

fn without_viewports(layout: &Layout) -> Layout {
    with_states(layout, |fields| drop(fields.remove(VIEWPORT)))
}

/// What a step changes.
fn steps(layout: &Layout) -> Layout {
    let [entry, text] = ENTRY;
    with_states(layout, |fields| {
        fields.remove(VIEWPORT);
        if let Some(entry) = fields.get_mut(entry).and_then(Value::as_object_mut) {
            entry.remove(text);
        }
    })
}

/// A layout with a change of the fields of each view's state.
fn with_states(layout: &Layout, change: impl Fn(&mut Map<String, Value>)) -> Layout {
    fn walk(node: &mut Node, change: &impl Fn(&mut Map<String, Value>)) {
        match node {
            Node::Row(parts) | Node::Column(parts) => {
                for (_, node) in parts {
                    walk(node, change);
                }
            }
            Node::Grid(nodes) | Node::Tabs { tiles: nodes, .. } => {
                for node in nodes {
                    walk(node, change);
                }
            }
            Node::View { state, .. } => {
                if let Some(fields) = state.as_object_mut() {
                    change(fields);
                }
            }
        }
    }
    let mut layout = layout.clone();
    walk(&mut layout.root, &change);
    layout
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn layout(buffers: bool, state: serde_json::Value) -> Layout {
        let view = Node::View { kind: "map".into(), state, run: ocu_views::RunChoice::Shown, id: 1 };
        Layout { buffers, root: view, ..Layout::empty() }
    }

    #[test]
    fn steps_are_undone_and_redone_and_a_new_one_forgets_what_was_undone() {
        let states: Vec<Layout> = (0..4).map(|i| layout(i % 2 == 0, json!({ "n": i }))).collect();
        let mut document = Document::default();
        assert!(!document.record(&states[0]), "the first is no step");
        assert!(document.record(&states[1]) && document.record(&states[2]));
        assert!(!document.record(&states[2]));
        assert!(document.can_undo() && !document.can_redo());
        assert_eq!(document.undo().as_ref(), Some(&states[1]));
        assert_eq!(document.undo().as_ref(), Some(&states[0]));
        assert_eq!(document.undo(), None);
        assert!(!document.can_undo() && document.can_redo());
        assert_eq!(document.redo().as_ref(), Some(&states[1]));
        assert!(document.record(&states[3]));
        assert_eq!(document.redo(), None);
        assert_eq!(document.undo().as_ref(), Some(&states[1]));
    }

    #[test]
    fn an_arrangement_that_was_adapted_is_no_step_and_leads_back_until_the_user_changes_it() {
        let [left, adapted, changed] = [0, 1, 2].map(|n| layout(true, json!({ "n": n, "viewport": n })));
        let mut document = Document::default();
        document.record(&left);
        assert_eq!(document.left_as(left.clone()), left);
        document.adapt(left.clone(), adapted.clone());
        assert!(!document.record(&adapted));
        assert_eq!(document.left_as(adapted), left);
        let moved = layout(true, json!({ "n": 1, "viewport": 3 }));
        assert!(document.record(&moved), "it is kept");
        assert_eq!(document.left_as(moved), left);
        assert!(document.record(&changed));
        assert_eq!(document.left_as(changed.clone()), changed);
    }

    #[test]
    fn undo_leads_back_from_an_arrangement_of_another_name_that_was_adapted() {
        let named = |name: &str, n: u32| Layout { name: name.into(), ..layout(true, json!({ "n": n })) };
        let [first, second, left, adapted] = [named("a", 0), named("a", 1), named("b", 2), named("b", 3)];
        let mut document = Document::default();
        document.record(&first);
        document.record(&second);
        document.adapt(left, adapted.clone());
        assert_eq!(document.undo().as_ref(), Some(&second));
        assert_eq!(document.undo(), Some(first));
        assert_eq!(document.redo(), Some(second));
        assert_eq!(document.redo(), Some(adapted));
    }

    #[test]
    fn a_formula_that_is_being_written_is_stored_and_comes_back_by_undo_with_all_of_its_text() {
        let written = |text: &str| layout(true, json!({ "n": 0, "entry": { "text": text } }));
        let [without, with] = [0, 1].map(|n| layout(true, json!({ "n": n, "entry": null })));
        let mut document = Document::default();
        document.record(&without);
        for text in ["", "a", "ab"] {
            assert!(document.record(&written(text)), "{text:?} is stored");
        }
        document.record(&with);
        assert_eq!(document.undo(), Some(written("ab")));
        assert_eq!(document.undo(), Some(without));
        assert_eq!([document.redo(), document.redo()], [Some(written("ab")), Some(with)]);
        // What was written since an arrangement was adapted to a source is a change of the user's.
        document.adapt(written("a"), written("a"));
        assert_eq!(document.left_as(written("ab")), written("ab"));
    }

    #[test]
    fn where_a_view_looks_is_stored_and_is_no_step() {
        let mut document = Document::default();
        document.record(&layout(true, json!({ "n": 0, "viewport": 1 })));
        assert!(document.record(&layout(true, json!({ "n": 0, "viewport": 2 }))));
        assert_eq!(document.undo(), None);
        document.record(&layout(true, json!({ "n": 1, "viewport": 3 })));
        assert_eq!(document.undo(), Some(layout(true, json!({ "n": 0, "viewport": 2 }))));
    }
}
