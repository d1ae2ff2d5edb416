//! What maps and images say of what is under the pointer, in views of any size.

use super::{Shown, harness};
use crate::samples;
use egui::{Rect, Theme, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use rcs_msg::foxglove::packed_element_field::NumericType;
use rcs_msg::foxglove::{Grid, PackedElementField, RawImage};
use rcs_msg::{MessageEncoding, Schema};
use rcs_runtime::source::{Frame, RunTag, Topic};
use std::collections::BTreeMap;
use std::sync::Arc;

const LARGE: Vec2 = Vec2::new(900.0, 560.0);
/// A place beside the middle of the map of which a source knows the cost, and one of which none does.
const KNOWN: Vec2 = Vec2::new(9.0, 3.0);
const UNKNOWN: Vec2 = Vec2::new(-150.0, 0.0);

/// A map with the pointer beside its middle, and the canvas of the map.
fn map(frame: Frame, size: Vec2, beside: Vec2) -> (Harness<'static, Shown>, Rect) {
    let mut harness = harness(Shown::new("map", frame), size, Theme::Dark);
    harness.run();
    let canvas = harness.get_by_label("Map").rect();
    harness.hover_at(canvas.center() + beside);
    harness.run();
    (harness, canvas)
}

fn count(harness: &Harness<'_, Shown>, text: &str) -> usize {
    harness.query_all_by_label_contains(text).count()
}

/// A grid with a second source, which knows no cell.
fn grid_of_two_sources() -> Grid {
    let mut grid = samples::grid(40, 40);
    let cells = grid.data.chunks(6).flat_map(|cell| cell.iter().copied().chain([255, 0]));
    let data: Vec<u8> = cells.collect();
    grid.data = data.into();
    (grid.cell_stride, grid.row_stride) = (8, 40 * 8);
    for (name, offset) in [("cost.color", 6), ("conf.color", 7)] {
        let field = PackedElementField { name: name.into(), offset, r#type: NumericType::Uint8.into() };
        grid.fields.push(field);
    }
    grid
}

#[test]
fn a_cell_that_no_source_knows_is_said_in_one_line() {
    let (known, _) = map(samples::full(), LARGE, KNOWN);
    let (unknown, _) = map(samples::full(), LARGE, UNKNOWN);
    assert_eq!(count(&unknown, "/wm1/map  cell"), 1);
    let named = |harness: &Harness<'_, Shown>| harness.query_all_by_label("unknown").count();
    assert_eq!(named(&unknown), named(&known) + 1, "one is in the legend");
    for text in ["stereo", "changed", "fused"] {
        assert!(count(&known, text) > 0, "{text}");
        assert_eq!(count(&unknown, text), 0, "{text}");
    }
    assert_eq!(count(&unknown, "in a larger map"), 0);
}

#[test]
fn a_source_that_knows_nothing_of_a_cell_is_left_out() {
    let mut frame = samples::empty();
    frame.topics = vec![samples::topic("/wm1/map", 5.0, 0.2, grid_of_two_sources())].into();
    let (harness, _) = map(frame, LARGE, KNOWN);
    assert_eq!(count(&harness, "/wm1/map  cell"), 1);
    assert_eq!((count(&harness, "stereo"), count(&harness, "color")), (1, 0));
}

#[test]
fn a_cell_of_a_costmap_is_read_with_its_own_value() {
    for (value, cost) in [(254, "cost 250"), (0, "cost   0"), (255, "unknown")] {
        let mut frame = samples::empty();
        let grid = samples::costmap(40, &[value; 1600]);
        frame.topics = vec![samples::topic("/costmap", 1.0, 0.2, grid)].into();
        let (harness, _) = map(frame, LARGE, KNOWN);
        assert_eq!(count(&harness, "/costmap  cell"), 1, "{value}");
        assert!(count(&harness, cost) > 0, "{value}");
        assert_eq!(count(&harness, &format!("costmap    {value}")), 1, "{value}");
    }
}

#[test]
fn a_read_out_lies_inside_of_the_map_and_beside_the_pointer() {
    for size in [[240.0, 320.0], [320.0, 240.0], [520.0, 200.0], [900.0, 560.0]] {
        for beside in [KNOWN, Vec2::new(9.0, -3.0)] {
            let (harness, canvas) = map(samples::full(), Vec2::from(size), beside);
            assert_eq!(count(&harness, "/wm1/map  cell"), 1, "{size:?}");
            for text in ["/wm1/map  cell", "fused", "stereo", "      7", "changed", "larger map"] {
                for node in harness.query_all_by_label_contains(text) {
                    let rect = node.rect();
                    assert!(canvas.contains_rect(rect), "{size:?}, {text}: {rect} in {canvas}");
                    let covers = rect.contains(canvas.center() + beside);
                    assert!(!covers || size[1] < LARGE.y, "{text}: {rect}");
                }
            }
        }
    }
}

#[test]
fn disparities_are_read_in_pixels_and_so_is_their_scale() {
    let mut values = [46.0_f32; 64];
    values[..8].fill(3.0);
    let data: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
    let image = RawImage {
        width: 8,
        height: 8,
        encoding: "32FC1".into(),
        step: 32,
        data: data.into(),
        ..RawImage::default()
    };
    let mut by_role = samples::topic("/stereo/disparity", 5.0, 0.1, image);
    let name = "stereo_msgs/msg/DisparityImage";
    let ros = Schema::new(name, MessageEncoding::Cdr, "ros2idl", Vec::new().into());
    let by_type = Topic::new("/stereo/disparity", RunTag::Recorded, Arc::new(ros));
    let by_type = by_type.with_latest(by_role.latest.clone().unwrap());
    by_role.metadata = Arc::new(BTreeMap::from([("rcs.role".to_owned(), "disparity".to_owned())]));
    for topic in [by_role, by_type] {
        let frame = Frame { topics: Arc::new([topic]), ..samples::empty() };
        let mut harness = harness(Shown::new("camera", frame), LARGE, Theme::Dark);
        harness.run();
        let canvas = harness.get_by_label("Image of /stereo/disparity").rect();
        harness.hover_at(canvas.center());
        harness.run();
        assert_eq!(count(&harness, "46.000 px"), 1);
        assert_eq!(count(&harness, "50.0 px"), 1, "the end of the scale");
    }
}

#[test]
fn the_size_of_an_image_is_not_said_where_it_would_hide_much_of_it() {
    let says = |size: Vec2| {
        let mut harness = harness(Shown::new("camera", samples::full()), size, Theme::Dark);
        harness.run();
        count(&harness, "96 × 64") > 0
    };
    assert!(says(LARGE));
    assert!(!says(Vec2::new(200.0, 200.0)));
}

#[test]
fn a_small_camera_without_an_image_says_so_inside_of_its_tile() {
    let mut shown = Shown::new("camera", samples::full());
    let topic = shown.frame.topic("/nothing/yet").unwrap().clone();
    shown.view.drop_topic(&topic);
    let mut harness = harness(shown, Vec2::new(150.0, 130.0), Theme::Dark);
    harness.run();
    let canvas = harness.get_by_label("Image of /nothing/yet").rect();
    let text = harness.get_by_label("No image yet").rect();
    assert!(canvas.contains_rect(text), "{text} in {canvas}");
}

#[test]
fn a_camera_whose_topic_is_no_image_or_does_not_exist_says_so_and_shows_no_other_one() {
    let names = [
        ("/rear/image", "No topic /rear/image here"),
        ("/lidar/points", "/lidar/points is no image"),
        ("/camera/depth", "Image of /camera/depth"),
    ];
    for (name, said) in names {
        let mut shown = Shown::new("camera", samples::full());
        shown.view.load(&serde_json::json!({ "topic": { "name": name } })).unwrap();
        assert_eq!(shown.view.title(&shown.frame), name);
        let mut harness = harness(shown, LARGE, Theme::Dark);
        harness.run();
        assert_eq!((count(&harness, said), count(&harness, "Image of /camera/image")), (1, 0), "{name}");
    }
}
