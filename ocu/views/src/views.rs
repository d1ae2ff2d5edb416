//! The list of views. A new view is a file of its own, its `mod` line in `lib.rs`, and one entry here.

use crate::view::{View, ViewType};
use ocu_ui::icons;

const VIEWS: &[ViewType] = &[
    entry::<crate::camera::Camera>(
        "camera",
        "Camera",
        icons::ICON_PHOTO_CAMERA,
        "An image with overlays of what the processes found in it.",
    ),
    entry::<crate::map::Map>(
        "map",
        "Map",
        icons::ICON_MAP,
        "Maps, clouds, paths and tracks from above: north up, or turned with the vehicle.",
    ),
    entry::<crate::scene::Scene>(
        "scene",
        "Scene",
        icons::ICON_VIEW_IN_AR,
        "Clouds, maps with heights, paths, frames and the vehicle in three dimensions.",
    ),
    entry::<crate::buffers::Buffers>(
        "buffers",
        "Buffers",
        icons::ICON_LIST,
        "Every buffer with its rate, age, size and type.",
    ),
    entry::<crate::fields::Fields>(
        "fields",
        "Fields",
        icons::ICON_DATA_OBJECT,
        "Any message of any encoding as a tree.",
    ),
    entry::<crate::hierarchy::Hierarchy>(
        "hierarchy",
        "Hierarchy",
        icons::ICON_ACCOUNT_TREE,
        "Processes below their supervisors, with states, links and peers.",
    ),
    entry::<crate::ladder::Ladder>(
        "ladder",
        "Commands",
        icons::ICON_SWAP_VERT,
        "The commands of a process and their echoes over time, with latencies.",
    ),
    entry::<crate::drive::Drive>(
        "drive",
        "Drive",
        icons::ICON_SPORTS_ESPORTS,
        "Manual driving, and the progress of the course.",
    ),
    entry::<crate::tuning::Tuning>(
        "tuning",
        "Tuning",
        icons::ICON_TUNE,
        "The parameters of a process: change, preview, send, compare, save.",
    ),
    entry::<crate::text_log::TextLog>(
        "log",
        "Log",
        icons::ICON_ARTICLE,
        "What happened: messages, errors, commands, changes of mode, acts of the operator.",
    ),
    entry::<crate::plan::Plan>(
        "plan",
        "Plan",
        icons::ICON_ALT_ROUTE,
        "Why this path: its cost and that of the rejected one, term by term, and the scores of the arcs.",
    ),
    entry::<crate::models::Models>(
        "models",
        "Models",
        icons::ICON_MODEL_TRAINING,
        "What was learned: histograms and numbers of every model; save, load, delete.",
    ),
    entry::<crate::timing::Timing>(
        "timing",
        "Timing",
        icons::ICON_TIMER,
        "The cycles of every process against its period.",
    ),
    entry::<crate::details::Details>(
        "details",
        "Details",
        icons::ICON_LIST_ALT,
        "A process in full: its commands with parameters, the last one sent, its buffers.",
    ),
    entry::<crate::conditions::Conditions>(
        "conditions",
        "Conditions",
        icons::ICON_RULE,
        "Stop where a formula over fields begins to hold, forward or back.",
    ),
    entry::<crate::plot::Plot>(
        "plot",
        "Plot",
        icons::ICON_SHOW_CHART,
        "Fields and formulas over time: aligned graphs, statistics, derived curves.",
    ),
    entry::<crate::compare::Compare>(
        "compare",
        "Compare",
        icons::ICON_COMPARE,
        "Two runs, or a run and a recording: since when they differ, and how it spreads.",
    ),
    entry::<crate::sweep::Sweep>(
        "sweep",
        "Sweep",
        icons::ICON_GRID_ON,
        "The open stack run for values of a parameter and for several seeds, in the background.",
    ),
    entry::<crate::frames::Frames>(
        "frames",
        "Frames",
        icons::ICON_3D_ROTATION,
        "The tree of coordinate frames with their poses.",
    ),
];

/// All views that can be opened, in the order of the menu.
pub fn all() -> &'static [ViewType] {
    VIEWS
}

/// The view type with this kind.
pub fn view_type(kind: &str) -> Option<&'static ViewType> {
    all().iter().find(|view_type| view_type.kind == kind)
}

const fn entry<V: View + Default + 'static>(
    kind: &'static str,
    name: &'static str,
    icon: ocu_ui::Icon,
    summary: &'static str,
) -> ViewType {
    ViewType { kind, name, icon, summary, make: make::<V> }
}

fn make<V: View + Default + 'static>() -> Box<dyn View> {
    Box::new(V::default())
}
