//! Tests of entities on the map.

use super::*;
use crate::map::layers;
use crate::samples;
use rcs_geom::TransformTree;
use rcs_msg::foxglove::{
    self, Color, CubePrimitive, LinePrimitive, ModelPrimitive, Point3, SceneEntity, SceneUpdate,
    SpherePrimitive, TextPrimitive, Vector3,
};

const RED: Option<Color> = Some(Color { r: 1.0, g: 0.0, b: 0.0, a: 1.0 });

#[allow(clippy::unnecessary_wraps, reason = "fields of messages are optional")]
fn pose(x: f64, y: f64, z: f64) -> Option<foxglove::Pose> {
    Some(foxglove::Pose { position: Some(Vector3 { x, y, z }), orientation: None })
}

fn cube(x: f64, y: f64, z: f64) -> CubePrimitive {
    CubePrimitive { pose: pose(x, y, z), size: Some(Vector3 { x: 2.0, y: 1.0, z: 1.0 }), color: RED }
}

fn entity(id: &str, frame_id: &str, second: u64, frame_locked: bool) -> SceneEntity {
    SceneEntity {
        id: id.to_owned(),
        frame_id: frame_id.to_owned(),
        timestamp: (second > 0).then(|| Stamp(second * 1_000_000_000).to_proto()),
        frame_locked,
        cubes: vec![cube(0.0, 0.0, 0.0)],
        ..SceneEntity::default()
    }
}

/// A frame at 20 s in which `base` moves along x of `map` by a metre a second, with entities of a message of 15 s.
fn frame(entities: Vec<SceneEntity>) -> Frame {
    let mut tree = TransformTree::new();
    for second in 0..30_u64 {
        let pose = Pose::from_xy_yaw(second as f64, 0.0, 0.0);
        tree.insert("map", "base", second * 1_000_000_000, pose).unwrap();
    }
    let mut topic = samples::topic("/markers", 1.0, 0.0, SceneUpdate { deletions: Vec::new(), entities });
    topic.latest.as_mut().unwrap().header.log_time = Stamp(15_000_000_000);
    let now = Stamp(20_000_000_000);
    Frame { topics: Arc::new([topic]), transforms: Arc::new(tree), now, ..samples::empty() }
}

/// The x of each entity that is placed in `map`, and the number of those that are not.
fn placed(frame: &Frame) -> (Vec<f64>, usize, Option<String>) {
    let layers = layers::layers(frame);
    let Kind::Entities(entities) = layers[0].kind else { panic!("there is a layer of entities") };
    let Placement { placed, loose, reason } = place(frame, "map", entities);
    (placed.0.iter().map(|(_, pose)| pose.translation.x).collect(), loose, reason)
}

#[test]
fn an_entity_lies_where_its_frame_was_or_where_it_is_if_it_is_locked_to_it() {
    let all = vec![
        entity("at its stamp", "/base", 7, false),
        entity("without a stamp", "base", 0, false),
        entity("locked", "base", 7, true),
        entity("at home", "map", 7, false),
        entity("nowhere", "arm", 7, false),
    ];
    let (x, loose, reason) = placed(&frame(all));
    // The samples have no clock of transforms: a stamp is found by itself, or by the log time of its message.
    assert_eq!(x[1..], [15.0, 20.0, 0.0]);
    assert!([7.0, 15.0].contains(&x[0]), "{x:?}");
    assert_eq!((loose, reason.as_deref()), (1, Some("frame \"arm\" is not connected to \"map\"")));
}

#[test]
fn entities_are_placed_once_for_all_views_of_a_run_and_again_in_another_frame() {
    let (ctx, frame) = (Context::default(), frame(vec![entity("locked", "base", 7, true)]));
    let placed = |frame: &Frame| {
        let layers = layers::layers(frame);
        placement(&ctx, frame, "map", &layers[0]).unwrap()
    };
    let first = placed(&frame);
    assert!(Arc::ptr_eq(&first, &placed(&frame)));
    let later = Frame { now: Stamp(21_000_000_000), ..frame.clone() };
    assert_eq!(placed(&later).placed.0[0].1.translation.x, 21.0);
    let mut beside = frame.clone();
    beside.runs.moment.run = rcs_runtime::RunId(1);
    beside.now = Stamp(22_000_000_000);
    let other = placed(&beside);
    assert_eq!(other.placed.0[0].1.translation.x, 22.0);
    placed(&later);
    assert!(Arc::ptr_eq(&other, &placed(&beside)), "runs do not take turns in one slot");
}

#[test]
fn a_layer_of_entities_is_placed_by_its_first_entity_without_reading_its_message() {
    let frame = frame(vec![entity("", "base", 7, true)]);
    assert_eq!(layers::layers(&frame)[0].stamp, frame.transform_time(frame.now));
}

#[test]
fn where_earlier_messages_are_not_known_the_panel_says_so() {
    let notes = |is_complete: bool| {
        let on_map = OnMap { count: 1, loose: 0, reason: None, left_out: 0, is_complete, flat: None };
        on_map.notes()
    };
    assert_eq!(notes(true), [("1 entity".to_owned(), false)]);
    let incomplete = notes(false);
    assert!(incomplete.len() == 2 && incomplete[1].0.contains("newest message alone"));
}

#[test]
fn an_entity_whose_lifetime_has_passed_is_no_layer() {
    let short = |seconds: i64| {
        let lifetime = Some(rcs_msg::prost_types::Duration { seconds, nanos: 0 });
        let frame = frame(vec![SceneEntity { lifetime, ..entity("short", "map", 7, false) }]);
        layers::layers(&frame).len()
    };
    assert_eq!([4, 5, 6, 0].map(short), [0, 0, 1, 1], "5 s have passed");
}

/// The entities of one entity in the frame of the map, from above.
fn flat(entity: SceneEntity) -> Flat {
    let entity = Arc::new(Entity::new(entity, Stamp(0)));
    Flat::of(&PlacedEntities(vec![(entity, Pose::IDENTITY)].into()))
}

#[test]
fn solids_are_their_outlines_from_above_the_higher_ones_later() {
    let sphere = SpherePrimitive {
        pose: pose(5.0, 0.0, 0.0),
        size: Some(Vector3 { x: 2.0, y: 4.0, z: 1.0 }),
        color: RED,
    };
    let all = flat(SceneEntity {
        cubes: vec![cube(0.0, 0.0, 3.0), cube(1.0, 0.0, -1.0)],
        spheres: vec![sphere],
        models: vec![ModelPrimitive::default(); 2],
        ..SceneEntity::default()
    });
    let round = |p: &[f64; 2]| p.map(|v| (v * 1e6).round() / 1e6);
    let outlines: Vec<Vec<[f64; 2]>> =
        all.solids.iter().map(|(outline, _)| outline.iter().map(round).collect()).collect();
    assert_eq!(outlines[0].len(), 4);
    assert!(outlines[0].contains(&[2.0, 0.5]) && outlines[0].contains(&[0.0, -0.5]), "{outlines:?}");
    assert!(outlines[2].contains(&[-1.0, -0.5]), "the highest one is the last");
    let area = |outline: &[[f64; 2]]| {
        let next = outline.iter().cycle().skip(1);
        outline.iter().zip(next).map(|(a, b)| a[0] * b[1] - a[1] * b[0]).sum::<f64>() / 2.0
    };
    assert!((area(&outlines[2]) - 2.0).abs() < 1e-6, "counter-clockwise");
    let ellipse = std::f64::consts::PI * 1.0 * 2.0;
    assert!((area(&outlines[1]) - ellipse).abs() < 0.05 * ellipse);
    assert_eq!(all.bounds.map(|(min, max)| [round(&min), round(&max)]), Some([[-1.0, -2.0], [6.0, 2.0]]));
    assert_eq!(all.models, 2);
}

#[test]
fn lines_and_texts_keep_their_places_and_numbers_that_cannot_be_are_counted() {
    let points = [0.0, 1.0, f64::NAN, 2.0, 3.0].map(|x| Point3 { x, y: 1.0, z: 2.0 });
    let text = TextPrimitive { pose: pose(4.0, 5.0, 6.0), text: "gate".into(), ..TextPrimitive::default() };
    let all = flat(SceneEntity {
        cubes: vec![cube(f64::INFINITY, 0.0, 0.0), cube(1e9, 0.0, 0.0)],
        lines: vec![LinePrimitive { points: points.to_vec(), color: RED, ..LinePrimitive::default() }],
        texts: vec![text],
        ..SceneEntity::default()
    });
    let (line, color, _) = &all.lines[0];
    assert_eq!((line[0], line[1], line[4], *color), ([0.0, 1.0], [1.0, 1.0], [3.0, 1.0], Color32::RED));
    assert!(line[2][0].is_nan(), "it is interrupted");
    assert_eq!((all.texts[0].at.truncate().to_array(), all.texts[0].text.as_str()), ([4.0, 5.0], "gate"));
    assert_eq!(all.far, 4, "two cubes, and the parts of the line before and after the third point");
    assert_eq!(all.bounds, Some(([0.0, 1.0], [4.0, 5.0])));
}

#[test]
fn what_is_painted_is_bounded_whatever_the_numbers_are() {
    let canvas = Rect::from_min_size(Pos2::ZERO, egui::Vec2::new(400.0, 300.0));
    let viewport = Viewport { center: [0.0, 0.0], scale: 10.0, y_up: true, turned_rad: 0.3 };
    for count in [1, 20_000] {
        let cubes = (0..count).map(|i| cube(f64::from(i % 40) - 5.0, f64::from(i / 40) - 5.0, 0.0)).collect();
        let all = flat(SceneEntity { cubes, ..SceneEntity::default() });
        let ctx = Context::default();
        let mut output = ctx.run_ui(egui::RawInput::default(), |ui| {
            all.paint(&ui.painter_at(canvas), viewport, canvas, &mut Labels::default());
        });
        output.textures_delta.clear();
        let shapes = output.shapes.len();
        assert!((1..10).contains(&shapes), "{count} cubes are {shapes} shapes");
    }
}
