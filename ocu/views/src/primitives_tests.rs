//! Tests of the primitives of entities, and the samples of other tests of them.

use super::*;
use rcs_msg::foxglove::{Color, CubePrimitive, CylinderPrimitive, ModelPrimitive, SpherePrimitive, Vector3};

const RED: Option<Color> = Some(Color { r: 1.0, g: 0.0, b: 0.0, a: 1.0 });

#[allow(clippy::unnecessary_wraps, reason = "fields of messages are optional")]
fn at(x: f64, y: f64, z: f64) -> Option<foxglove::Pose> {
    Some(foxglove::Pose { position: Some(Vector3 { x, y, z }), orientation: None })
}

#[allow(clippy::unnecessary_wraps, reason = "fields of messages are optional")]
fn size(x: f64, y: f64, z: f64) -> Option<Vector3> {
    Some(Vector3 { x, y, z })
}

fn points(all: &[[f64; 3]]) -> Vec<Point3> {
    all.iter().map(|[x, y, z]| Point3 { x: *x, y: *y, z: *z }).collect()
}

/// An entity with each primitive around (10, 20, 0).
fn sample() -> SceneEntity {
    let (pose, color) = (at(10.0, 20.0, 0.0), RED);
    let corners = points(&[[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]);
    SceneEntity {
        arrows: vec![ArrowPrimitive {
            pose,
            shaft_length: 2.0,
            shaft_diameter: 0.2,
            head_length: 1.0,
            head_diameter: 0.4,
            color,
        }],
        cubes: vec![CubePrimitive { pose, size: size(2.0, 4.0, 6.0), color }],
        spheres: vec![SpherePrimitive { pose, size: size(2.0, 2.0, 2.0), color }],
        cylinders: vec![CylinderPrimitive {
            pose,
            size: size(2.0, 2.0, 1.0),
            bottom_scale: 1.0,
            top_scale: 0.5,
            color,
        }],
        lines: vec![LinePrimitive { pose, points: corners.clone(), color, ..LinePrimitive::default() }],
        triangles: vec![TriangleListPrimitive {
            pose,
            points: corners,
            color,
            indices: vec![0, 1, 2, 0, 2, 3],
            ..TriangleListPrimitive::default()
        }],
        texts: vec![TextPrimitive { pose, text: "gate".to_owned(), color, ..TextPrimitive::default() }],
        models: vec![ModelPrimitive::default()],
        ..SceneEntity::default()
    }
}

fn placed(entity: SceneEntity) -> PlacedEntities {
    let entity = Arc::new(Entity::new(entity, rcs_msg::Stamp(0)));
    PlacedEntities(vec![(entity, Pose::from_translation(DVec3::Z))].into())
}

fn line(kind: LineType, change: impl FnOnce(&mut LinePrimitive)) -> Primitives {
    let all = points(&[[0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [3.0, 0.0, 0.0]]);
    let mut line = LinePrimitive { r#type: kind.into(), points: all, color: RED, ..LinePrimitive::default() };
    change(&mut line);
    Primitives::of(&placed(SceneEntity { lines: vec![line], ..SceneEntity::default() }), DVec3::Z)
}

/// The x coordinates of each line; `None` where it is interrupted.
fn along(primitives: &Primitives) -> Vec<Vec<Option<f64>>> {
    let x = |p: &DVec3| p.is_finite().then_some(p.x);
    primitives.lines.iter().map(|line| line.points.iter().map(x).collect()).collect()
}

#[test]
fn every_primitive_is_placed_by_its_pose_and_that_of_its_frame() {
    let placed = placed(sample());
    assert_eq!(placed.anchor(), DVec3::new(10.0, 20.0, 1.0));
    for origin in [DVec3::ZERO, placed.anchor()] {
        let all = Primitives::of(&placed, origin);
        assert_eq!((all.solids.len(), all.triangles.len(), all.lines.len()), (5, 2, 1));
        assert_eq!((all.models, all.far, all.left_out), (1, 0, 0));
        let cube = all.solids[2];
        assert_eq!(cube.pose.translation, DVec3::new(10.0, 20.0, 1.0) - origin);
        assert_eq!(cube.reach(), DVec3::new(1.0, 2.0, 3.0));
    }
    let text = PlacedText { at: DVec3::new(10.0, 20.0, 1.0), text: "gate".to_owned(), color: Color32::RED };
    assert_eq!(placed.texts(), [text]);
}

#[test]
fn an_arrow_goes_along_x_from_its_tail() {
    let all = Primitives::of(&placed(sample()), DVec3::new(10.0, 20.0, 1.0));
    let ends = [0, 1].map(|part: usize| {
        let corners = all.solids[part].faces(16).corners;
        let along = |pick: fn(f64, f64) -> f64| corners.iter().map(|p| p.x).reduce(pick).unwrap();
        let round = |v: f64| (v * 1e6).round() / 1e6;
        [round(along(f64::min)), round(along(f64::max))]
    });
    assert_eq!(ends, [[0.0, 2.0], [2.0, 3.0]]);
    let head = all.solids[1].faces(16).corners;
    let tip = head.iter().filter(|p| p.x > 2.9);
    assert!(tip.into_iter().all(|p| p.y.abs() < 1e-9 && p.z.abs() < 1e-9), "the head is pointed");
}

#[test]
fn faces_are_outside_and_close_the_solid() {
    let forms = [Form::Cube, Form::Sphere, Form::Cylinder { bottom: 1.0, top: 0.5 }];
    for (form, volume) in forms.into_iter().zip([1.0, PI / 6.0, 7.0 * PI / 48.0]) {
        let solid = Solid { form, pose: Pose::IDENTITY, size: DVec3::ONE, color: Color32::RED };
        let Faces { corners, faces } = solid.faces(64);
        let of_face = |face: &[usize; 3]| {
            let [a, b, c] = face.map(|index| corners[index]);
            a.dot(b.cross(c)) / 6.0
        };
        let got: f64 = faces.iter().map(of_face).sum();
        assert!((got - volume).abs() < 0.02 * volume, "{form:?}: {got}, expected {volume}");
        assert!(corners.iter().all(|p| p.abs().max_element() <= 0.5 + 1e-9));
    }
}

#[test]
fn lines_are_strips_loops_or_pairs_and_change_where_their_colour_does() {
    let [a, b, c, d] = [0.0, 1.0, 2.0, 3.0].map(Some);
    assert_eq!(along(&line(LineType::LineStrip, |_| {})), [vec![a, b, c, d]]);
    assert_eq!(along(&line(LineType::LineLoop, |_| {})), [vec![a, b, c, d, a]]);
    assert_eq!(along(&line(LineType::LineList, |_| {})), [vec![a, b, None, c, d]]);
    let indexed = line(LineType::LineStrip, |line| line.indices = vec![3, 0, 9, 1, 2]);
    assert_eq!(along(&indexed), [vec![d, a, None, b, c]]);
    assert_eq!(indexed.far, 2, "there is no tenth point");
    let green = Color { g: 1.0, r: 0.0, ..RED.unwrap() };
    let colored =
        line(LineType::LineStrip, |line| line.colors = vec![RED.unwrap(), green, green, RED.unwrap()]);
    assert_eq!(along(&colored), [vec![a, b], vec![b, c, d]]);
    assert_eq!(colored.lines[1].color, Color32::GREEN);
    for kind in [LineType::LineStrip, LineType::LineLoop, LineType::LineList] {
        assert!(along(&line(kind, |line| line.points.truncate(1))).is_empty());
        assert!(along(&line(kind, |line| line.points.clear())).is_empty());
    }
}

#[test]
fn what_cannot_be_is_counted_and_what_is_transparent_is_not_drawn() {
    for number in [f64::NAN, f64::INFINITY, -1e30, f64::MAX] {
        let mut entity = sample();
        entity.cubes[0].size = size(1.0, number, 1.0);
        entity.spheres[0].pose = at(number, 0.0, 0.0);
        entity.arrows[0].shaft_length = number;
        entity.triangles[0].points[2].y = number;
        entity.texts[0].pose = at(0.0, 0.0, number);
        let placed = placed(entity);
        let all = Primitives::of(&placed, placed.anchor());
        assert!(all.solids.iter().all(|solid| solid.reach().is_finite()), "{number}");
        assert!(
            all.far >= 4 && all.triangles.is_empty() && placed.texts().is_empty(),
            "{number}: {}",
            all.far
        );
        assert!(placed.anchor().is_finite());
    }
    let mut entity = sample();
    let clear = Some(Color { a: 0.0, ..RED.unwrap() });
    (entity.cubes[0].color, entity.spheres[0].color, entity.cylinders[0].color) = (clear, clear, clear);
    assert_eq!(Primitives::of(&placed(entity), DVec3::ZERO).solids.len(), 2, "the arrow");
    assert_eq!(color_of(Some(&Color { r: f64::NAN, g: 7.0, b: -1.0, a: 1.0 })), Color32::GREEN);
}

#[test]
fn more_than_can_be_drawn_is_left_out_and_counted() {
    let cube = CubePrimitive { pose: at(0.0, 0.0, 0.0), size: size(1.0, 1.0, 1.0), color: RED };
    let many = vec![Point3::default(); 3 * MOST_TRIANGLES + 30];
    let entity = SceneEntity {
        cubes: vec![cube; MOST_SOLIDS + 5],
        lines: vec![LinePrimitive { points: many.clone(), color: RED, ..LinePrimitive::default() }],
        triangles: vec![TriangleListPrimitive {
            points: many,
            color: RED,
            ..TriangleListPrimitive::default()
        }],
        ..SceneEntity::default()
    };
    let all = Primitives::of(&placed(entity), DVec3::ZERO);
    assert_eq!((all.solids.len(), all.triangles.len()), (MOST_SOLIDS, MOST_TRIANGLES));
    let segments = 3 * MOST_TRIANGLES + 30 - 1;
    assert_eq!(all.left_out, 5 + 10 + segments - MOST_ENDS / 2);
}
