//! Layouts: arrangements of views, as versioned text files that can be edited by hand, shared, and restored after a
//! crash.
//!
//! ```ron
//! Layout(
//!     version: 1,
//!     name: "two views",
//!     root: Row([
//!         (2.0, View(kind: "camera")),
//!         (1.0, Tabs(active: 0, tiles: [View(kind: "map"), View(kind: "fields")])),
//!     ]),
//! )
//! ```

use crate::assets::{looks_like_path, read_text};
use crate::bundled;
use ocu_views::{RunChoice, SavedState, view_type};
use rcs_formula::FieldRef;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// The version written by this program, and the newest that it reads.
pub const VERSION: u32 = 1;
/// Maximum nesting of tiles.
const MAX_DEPTH: usize = 16;

/// An arrangement of views.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Layout {
    /// Version of the format.
    pub version: u32,
    /// Displayed name.
    pub name: String,
    /// Whether the buffer list on the left is open.
    #[serde(default = "yes")]
    pub buffers: bool,
    /// The tiles; an empty row where all have been closed.
    pub root: Node,
}

fn yes() -> bool {
    true
}

/// A tile.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub enum Node {
    /// Tiles side by side, each with its relative width.
    Row(Vec<(f32, Node)>),
    /// Tiles one above the other, each with its relative height.
    Column(Vec<(f32, Node)>),
    /// Tiles in a grid that chooses its number of columns.
    Grid(Vec<Node>),
    /// Tiles of which one is visible.
    Tabs {
        /// Index of the visible one.
        #[serde(default)]
        active: usize,
        /// The tiles.
        tiles: Vec<Node>,
    },
    /// One view.
    View {
        /// Its kind, as in the list of views.
        kind: String,
        /// Its saved state.
        #[serde(default)]
        state: SavedState,
        /// The run that it shows; the viewed one by default.
        #[serde(default, skip_serializing_if = "is_shown_run")]
        run: RunChoice,
        /// Identity in this window, so that a change of the arrangement keeps the view; 0 for a new one.
        #[serde(skip)]
        id: u64,
    },
}

#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
fn is_shown_run(run: &RunChoice) -> bool {
    *run == RunChoice::Shown
}

/// An error in a layout file: `file:line: what was found and what was expected`.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{file}:{line}: {message}")]
pub struct LayoutError {
    /// Path, or name of the bundled layout.
    pub file: String,
    /// Line, from 1.
    pub line: usize,
    /// What is wrong.
    pub message: String,
}

/// The part of a layout that is parsed first.
#[derive(Deserialize)]
#[serde(rename = "Layout")]
struct Version {
    version: u32,
}

/// The part of a layout that tells it from others.
#[derive(Deserialize)]
#[serde(rename = "Layout")]
struct Named {
    name: String,
}

impl Layout {
    /// Parses a layout; `file` is its name in errors.
    pub fn parse(file: &str, text: &str) -> Result<Self, LayoutError> {
        let error = |line: usize, message: String| LayoutError { file: file.to_owned(), line, message };
        let spanned = |found: &ron::error::SpannedError| error(found.span.start.line, found.code.to_string());
        let Version { version } = ron::from_str(text).map_err(|found| spanned(&found))?;
        if version == 0 || version > VERSION {
            let line = line_of(text, "version");
            return Err(error(line, format!("version {version} is not known; expected {VERSION}")));
        }
        let layout: Self = ron::from_str(text).map_err(|found| spanned(&found))?;
        layout.root.check(0).map_err(|Flaw { near, message }| {
            let line = match near {
                Near::Text(near) => line_of(text, &near),
                Near::Share(share) => line_of_share(text, share),
            };
            error(line, message)
        })?;
        Ok(layout)
    }

    /// The name in the text of a layout, which need not be right otherwise.
    pub(crate) fn name_in(text: &str) -> Option<String> {
        ron::from_str(text).ok().map(|Named { name }| name)
    }

    /// Reads a layout file.
    pub fn load(path: &Path) -> anyhow::Result<Self> {
        let text = read_text(path)
            .map_err(|error| crate::usage(format!("cannot read the layout: {error}: {}", path.display())))?;
        Ok(Self::parse(&path.display().to_string(), &text)?)
    }

    /// The layout as text; [`Layout::parse`] reads it back.
    pub fn to_text(&self) -> anyhow::Result<String> {
        let pretty = ron::ser::PrettyConfig::new().struct_names(true).depth_limit(10).compact_arrays(false);
        Ok(ron::ser::to_string_pretty(self, pretty)? + "\n")
    }

    /// Writes a layout file to a temporary file that is then renamed, so that a crash leaves either the old or the new
    /// one.
    pub fn save(&self, path: &Path) -> anyhow::Result<()> {
        write_whole(path, &self.to_text()?)
    }

    /// The bundled layout with this name.
    pub fn bundled(name: &str) -> Option<Result<Self, LayoutError>> {
        let file = bundled::file("layout", name)?;
        Some(Self::parse(&file.path(), file.text))
    }

    /// A bundled layout by its name, or one in a file.
    pub fn named(spec: &str) -> anyhow::Result<Self> {
        if let Some(layout) = Self::bundled(spec) {
            return Ok(layout?);
        }
        if looks_like_path(spec) {
            return Self::load(Path::new(spec));
        }
        Err(crate::usage(format!(
            "no bundled layout is called {spec:?}; expected {} or a .ron file",
            bundled::names("layout").join(", ")
        )))
    }

    /// A layout without views.
    pub fn empty() -> Self {
        Self { version: VERSION, name: "empty".to_owned(), buffers: true, root: Node::Row(Vec::new()) }
    }
}

impl Layout {
    /// The fields whose values over time its views need.
    pub fn fields(&self) -> Vec<FieldRef> {
        let mut fields = Vec::new();
        self.root.add_fields(&mut fields);
        fields.sort_unstable();
        fields.dedup();
        fields
    }

    /// Whether it has a view of this kind.
    pub(crate) fn has_view(&self, kind: &str) -> bool {
        self.root.has_view(kind)
    }
}

/// An error near a piece of the text.
struct Flaw {
    near: Near,
    message: String,
}

enum Near {
    Text(String),
    /// The share of a tile.
    Share(f32),
}

/// Line of the tile with this share, which is the number after a bracket in any notation.
fn line_of_share(text: &str, share: f32) -> usize {
    let is_it = |&(at, _): &(usize, char)| {
        let rest = &text[at + 1..];
        let number = rest.split([',', ')']).next().and_then(|number| number.trim().parse::<f32>().ok());
        number.is_some_and(|number| number.total_cmp(&share).is_eq() || number == share)
    };
    let at = text.char_indices().filter(|(_, c)| *c == '(').find(is_it).map_or(0, |(at, _)| at);
    1 + text[..at].matches('\n').count()
}

impl Node {
    /// Tiles in a grid. Where a grid that is as high as wide would have free places, they are rows, of which the last one
    /// is filled by fewer tiles.
    pub fn grid(tiles: Vec<Self>) -> Self {
        let count = tiles.len();
        let columns = (1..=count).find(|side| side * side >= count).unwrap_or(1);
        if count.is_multiple_of(columns) {
            return Self::Grid(tiles);
        }
        let mut rows: Vec<Vec<Self>> = Vec::new();
        for tile in tiles {
            match rows.last_mut() {
                Some(row) if row.len() < columns => row.push(tile),
                _ => rows.push(vec![tile]),
            }
        }
        Self::Column(rows.into_iter().map(|row| (1.0, Self::row(row))).collect())
    }

    /// Tiles of one width side by side; a single one as it is.
    fn row(mut tiles: Vec<Self>) -> Self {
        if tiles.len() == 1 {
            return tiles.remove(0);
        }
        Self::Row(tiles.into_iter().map(|tile| (1.0, tile)).collect())
    }

    fn add_fields(&self, fields: &mut Vec<FieldRef>) {
        match self {
            Self::Row(tiles) | Self::Column(tiles) => {
                for (_, tile) in tiles {
                    tile.add_fields(fields);
                }
            }
            Self::Grid(tiles) | Self::Tabs { tiles, .. } => {
                for tile in tiles {
                    tile.add_fields(fields);
                }
            }
            Self::View { kind, state, .. } => {
                if let Some(view_type) = view_type(kind) {
                    let mut view = (view_type.make)();
                    // A state that does not fit leaves the view without curves.
                    if view.load(state).is_ok() {
                        fields.extend(view.fields());
                    }
                }
            }
        }
    }

    fn has_view(&self, wanted: &str) -> bool {
        match self {
            Self::Row(tiles) | Self::Column(tiles) => tiles.iter().any(|(_, tile)| tile.has_view(wanted)),
            Self::Grid(tiles) | Self::Tabs { tiles, .. } => tiles.iter().any(|tile| tile.has_view(wanted)),
            Self::View { kind, .. } => kind == wanted,
        }
    }

    fn check(&self, depth: usize) -> Result<(), Flaw> {
        let flaw = |near: &str, message: String| Err(Flaw { near: Near::Text(near.to_owned()), message });
        if depth > MAX_DEPTH {
            return flaw("root", format!("tiles lie deeper than expected: at most {MAX_DEPTH} levels"));
        }
        match self {
            Self::Row(tiles) | Self::Column(tiles) => tiles.iter().try_for_each(|(share, tile)| {
                if !share.is_finite() || *share <= 0.0 {
                    let message = format!("a share is {share}; expected more than 0");
                    return Err(Flaw { near: Near::Share(*share), message });
                }
                tile.check(depth + 1)
            }),
            Self::Grid(tiles) => tiles.iter().try_for_each(|tile| tile.check(depth + 1)),
            Self::Tabs { active, tiles } if *active > 0 && *active >= tiles.len() => {
                flaw("active", format!("tab {active} is active; expected less than {}", tiles.len()))
            }
            Self::Tabs { tiles, .. } => tiles.iter().try_for_each(|tile| tile.check(depth + 1)),
            Self::View { kind, .. } if view_type(kind).is_none() => {
                let known: Vec<&str> = ocu_views::all().iter().map(|view| view.kind).collect();
                flaw(
                    &format!("{kind:?}"),
                    format!("no view is of kind {kind:?}; expected one of {}", known.join(", ")),
                )
            }
            Self::View { kind, state, .. } => {
                let Some(view_type) = view_type(kind) else { return Ok(()) };
                match (view_type.make)().load(state) {
                    Err(error) if !state.is_null() => flaw(
                        &format!("{kind:?}"),
                        format!("the state of the view {kind:?} does not fit: {error}"),
                    ),
                    _ => Ok(()),
                }
            }
        }
    }
}

/// Line of the first occurrence of `near`, from 1.
fn line_of(text: &str, near: &str) -> usize {
    let before = text.find(near).map_or("", |at| &text[..at]);
    1 + before.matches('\n').count()
}

/// Folder of the program's persistent data: `$XDG_DATA_HOME/ocu` or `~/.local/share/ocu`.
pub fn data_dir() -> Option<PathBuf> {
    let absolute = |name: &str| std::env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let base = absolute("XDG_DATA_HOME").or_else(|| Some(absolute("HOME")?.join(".local/share")))?;
    Some(base.join("ocu"))
}

/// Writes a small file atomically: it is either complete or unchanged.
pub(crate) fn write_whole(path: &Path, text: &str) -> anyhow::Result<()> {
    let aside = path.with_extension("new");
    let attempt = || {
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder)?;
        }
        std::fs::write(&aside, text)?;
        std::fs::rename(&aside, path)
    };
    attempt().map_err(|error: std::io::Error| anyhow::anyhow!("cannot write: {error}: {}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_bundled_layout_loads_and_survives_being_written() {
        for name in bundled::names("layout") {
            let layout = Layout::bundled(name).unwrap().unwrap_or_else(|error| panic!("{error}"));
            assert_eq!(layout.name, name);
            let again = Layout::parse("again", &layout.to_text().unwrap()).unwrap();
            assert_eq!(layout, again);
        }
    }

    /// Whether one of the views `kinds` is behind the other, in the tabs of one tile.
    fn is_behind(node: &Node, kinds: [&str; 2]) -> bool {
        match node {
            Node::Row(tiles) | Node::Column(tiles) => tiles.iter().any(|(_, tile)| is_behind(tile, kinds)),
            Node::Grid(tiles) => tiles.iter().any(|tile| is_behind(tile, kinds)),
            Node::Tabs { tiles, .. } => kinds.iter().all(|wanted| {
                tiles.iter().any(|tile| matches!(tile, Node::View { kind, .. } if kind == wanted))
            }),
            Node::View { .. } => false,
        }
    }

    #[test]
    fn the_plan_and_the_map_are_seen_at_once_where_a_layout_has_both() {
        for name in bundled::names("layout") {
            let layout = Layout::bundled(name).unwrap().unwrap();
            assert!(!is_behind(&layout.root, ["plan", "map"]), "{name}");
        }
    }

    #[test]
    fn tracks_of_the_global_position_do_not_lie_over_the_map_that_is_tuned_or_driven_by() {
        for name in ["simulation", "world_model"] {
            let layout = Layout::named(name).unwrap();
            let tiles = serde_json::to_value(&layout.root).unwrap().to_string();
            for topic in ["/vehicle/gps", "/localization/global"] {
                let hidden = format!("{topic:?}:{{\"shown\":false}}");
                assert!(tiles.contains(&hidden), "{name}: {topic}");
            }
        }
    }

    #[test]
    fn the_last_tile_of_a_grid_fills_its_row() {
        let tiles = |count: u64| -> Vec<Node> {
            let view = |id| Node::View {
                kind: "camera".to_owned(),
                state: SavedState::Null,
                run: RunChoice::Shown,
                id,
            };
            (1..=count).map(view).collect()
        };
        for count in [0, 1, 2, 4, 6, 9] {
            assert_eq!(Node::grid(tiles(count)), Node::Grid(tiles(count)), "{count}");
        }
        let [a, b, c] = <[Node; 3]>::try_from(tiles(3)).unwrap();
        let expected = Node::Column(vec![(1.0, Node::Row(vec![(1.0, a), (1.0, b)])), (1.0, c)]);
        assert_eq!(Node::grid(tiles(3)), expected);
        let Node::Column(rows) = Node::grid(tiles(5)) else { panic!("five tiles in rows") };
        let lengths = rows.iter().map(|(_, row)| if let Node::Row(tiles) = row { tiles.len() } else { 1 });
        assert_eq!(lengths.collect::<Vec<_>>(), [3, 2]);
    }

    #[track_caller]
    fn refused(text: &str, line: usize, part: &str) {
        let error = Layout::parse("mine.ron", text).unwrap_err();
        assert_eq!((error.line, error.file.as_str()), (line, "mine.ron"), "{error}");
        assert!(error.message.contains(part), "{error}");
    }

    #[test]
    fn flaws_are_refused_with_file_line_and_expectation() {
        refused("", 1, "Layout");
        refused("Layout(\n  version: 9,\n  name: \"a\",\n  root: Row([]),\n)", 2, "expected 1");
        refused("Layout(\n  version: 1,\n  nome: \"a\",\n  root: Row([]),\n)", 3, "nome");
        refused(
            "Layout(\n version: 1,\n name: \"a\",\n root: Row([\n (1.0, View(kind: \"caméra\"))]))",
            5,
            "camera",
        );
        refused("Layout(\n version: 1,\n name: \"a\",\n root: Row([\n (-2.5, Row([]))]))", 5, "more than 0");
        refused("Layout(version: 1, name: \"a\",\n root: Tabs(active: 3, tiles: []))", 2, "less than 0");
        refused("Layout(version: 1, name: \"a\",\n root: Pile([]))", 2, "Pile");
        assert!(Layout::named("nonsense").unwrap_err().to_string().contains("default"));
        assert!(Layout::named("./absent.ron").is_err());
    }

    #[test]
    fn a_saved_layout_replaces_the_old_one_as_a_whole() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("deep/layout.ron");
        Layout::empty().save(&path).unwrap();
        assert_eq!(Layout::load(&path).unwrap(), Layout::empty());
        assert_eq!(std::fs::read_dir(path.parent().unwrap()).unwrap().count(), 1, "nothing is left aside");
    }
}
