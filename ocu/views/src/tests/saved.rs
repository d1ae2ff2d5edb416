//! What layouts store of views.

use crate::view::SavedState;
use crate::views::all;
use serde_json::json;
use std::collections::BTreeSet;

/// A state of a view in which every field differs from its default; null for a view that stores nothing.
fn other_state(kind: &str) -> SavedState {
    let key = |name: &str| json!({ "name": name, "run": "recorded" });
    let viewport = |y_up: bool| json!({ "center": [1.5, -2.0], "scale": 20.0, "y_up": y_up });
    let fields = json!({
        "pinned": key("/wm1/map"),
        "search": "cost",
        "open": [".fields", ".pose"],
        "array": { "path": ".data", "form": { "picture": { "width": 40 } } },
    });
    match kind {
        "camera" => json!({
            "topic": key("/camera/image"),
            "overlays": { "/obstacles/labels": { "shown": false, "opacity": 0.75 } },
            "palette": "even",
            "depth_step_m": 0.25,
            "viewport": viewport(false),
        }),
        "map" => json!({
            "frame": "odom",
            "palette": "even",
            "layers": { "/wm1/map": {
                "shown": false,
                "opacity": 0.5,
                "shade": "ground.mean",
                "cloud": { "by": "intensity", "point_size": 4 },
            } },
            "align": false,
            "panel": false,
            "legend": false,
            "viewport": viewport(true),
            "follows": true,
            "vehicle_up": true,
        }),
        "scene" => json!({
            "frame": "odom",
            "camera": {
                "center": [1.0, 2.0, 0.5],
                "distance_m": 12.0,
                "azimuth_rad": 0.5,
                "elevation_rad": 0.25,
            },
            "follows": true,
            "axes": false,
            "palette": "even",
            "layers": { "/wm1/map": false },
            "clouds": { "/lidar/points": { "by": "intensity", "point_size": 4 } },
        }),
        "buffers" => json!({
            "search": "map",
            "folded": ["wm1"],
            "by_process": true,
            "sort": "rate",
            "descending": true,
        }),
        "fields" => fields,
        "hierarchy" => json!({ "viewport": viewport(false), "peers": false }),
        "ladder" => json!({ "span": "Minute" }),
        "tuning" => json!({ "process": "wm1", "search": "weight", "at_once": true }),
        "log" => json!({ "search": "bumper", "hidden": ["commands", "modes"], "alarms": true }),
        "plan" => json!({ "plan": key("/planner/plan"), "arcs": key("/follower/arcs") }),
        "models" => json!({ "topic": key("/terrain/models") }),
        "details" => json!({
            "commands": { "planner": "GOTO" },
            "on_each_change": true,
            "buffers": { "planner": "/planner/path" },
            "fields": fields,
        }),
        "conditions" => json!({ "conditions": [{ "formula": "/wm1/status.faults > 0", "stops": true }] }),
        "plot" => json!({
            "graphs": [{
                "curves": [{ "formula": "/a.x", "run": { "run": 3 }, "right": true }],
                "against": "/b.y",
                "across": [0.0, 1.5],
                "ranges": [[-1.0, 1.0], null],
            }],
            "span": { "fixed": [1.0, 2.5] },
            "statistics": true,
            "entry": { "text": "smooth(/a.x", "of": [0, 0], "was": "/a.x" },
        }),
        "compare" => json!({
            "sides": ["recorded", { "run": 2 }],
            "map": false,
            "viewport": viewport(true),
        }),
        "sweep" => json!({
            "process": "wm1",
            "field": "publish_hz",
            "values": "1..5:3",
            "fault": "wm1:stopped",
            "seed": 7,
            "runs": 12,
            "until_s": 30.5,
        }),
        _ => SavedState::Null,
    }
}

#[test]
fn every_view_gives_back_a_state_in_which_every_field_differs_from_its_default() {
    for view_type in all() {
        let kind = view_type.kind;
        let mut view = (view_type.make)();
        let (usual, other) = (view.save(), other_state(kind));
        let names = |state: &SavedState| -> BTreeSet<String> {
            state.as_object().into_iter().flatten().map(|(name, _)| name.clone()).collect()
        };
        assert_eq!(names(&usual), names(&other), "{kind}: say here what else a layout may store");
        for name in names(&usual) {
            assert_ne!(usual[&name], other[&name], "{kind}: {name} is the default");
        }
        view.load(&other).unwrap_or_else(|error| panic!("{kind}: {error}"));
        assert_eq!(view.save(), other, "{kind}");
    }
}
