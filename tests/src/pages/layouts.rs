//! `docs/reference/layouts.md`: layouts, their tiles, and what each view keeps.

use super::check_reference;
use super::declarations::{fields, keys, variants, words};

const FILE: &str = "ocu/app/src/layout.rs";

/// Views that keep something, with the file of their `Saved`.
const KEPT: [(&str, &str); 5] = [
    ("camera", "ocu/views/src/camera/mod.rs"),
    ("map", "ocu/views/src/map/saved.rs"),
    ("buffers", "ocu/views/src/buffers/mod.rs"),
    ("fields", "ocu/views/src/fields/mod.rs"),
    ("log", "ocu/views/src/text_log.rs"),
];

/// How a file writes each kind of tile.
const TILES: [(&str, &str); 5] = [
    ("row", "Row([(WIDTH, TILE), …])"),
    ("column", "Column([(HEIGHT, TILE), …])"),
    ("grid", "Grid([TILE, …])"),
    ("tabs", "Tabs(active: N, tiles: [TILE, …])"),
    ("view", "View(kind: \"map\", state: {…})"),
];

#[test]
fn the_reference_of_layouts_is_made_from_what_reads_them() {
    let mut text = "# Layouts\n\nRON files, made from the structures that a file is read into; `layouts/` holds those that \
                    come with the program.\n\n```ron\nLayout(\n    version: 1,\n    name: \"two views\",\n    root: Row([\n        \
                    (2.0, View(kind: \"camera\", state: { \"topic\": { \"name\": \"/camera/image\" } })),\n        \
                    (1.0, Tabs(active: 0, tiles: [View(kind: \"map\"), View(kind: \"fields\")])),\n    ]),\n)\n```\n\n"
        .to_owned();
    text += &keys(&fields(FILE, "Layout"));
    text += "## Tiles\n\nNames are written as in the example above.\n\n";
    let mut tiles = variants(FILE, "Node");
    for tile in &mut tiles {
        let written = TILES.iter().find(|(name, _)| *name == tile.name);
        let (_, written) = written.unwrap_or_else(|| panic!("{}: how is it written?", tile.name));
        (*written).clone_into(&mut tile.name);
    }
    text += &words("tile", &tiles);
    for (kind, file) in KEPT {
        assert!(ocu_views::view_type(kind).is_some(), "there is a view {kind}");
        text += &["## State of `", kind, "`\n\n"].concat();
        text += &keys(&fields(file, "Saved"));
    }
    text += "## State of other views\n\nOther views keep a state, too; arrange one in the window and read the file under \
             `~/.local/share/ocu/layouts`.\n";
    check_reference("layouts", &format!("{}\n", text.trim_end()));
}
