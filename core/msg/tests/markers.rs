//! Markers of RViz, written by hand, become the entities of a scene.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

use bytes::Bytes;
use rcs_msg::{DELETES_NAMESPACE, MessageEncoding, Schema, canonical, canonical_name, foxglove};

const TIME: &str = "builtin_interfaces/Time stamp\nstring frame_id\n===\nMSG: builtin_interfaces/Time\nint32 sec\n\
    uint32 nanosec\n";
/// Up to the colours, the same in all releases of ROS 2.
const FIRST: &str = "int32 ARROW=0\nstd_msgs/Header header\nstring ns\nint32 id\nint32 type\nint32 action\n\
    geometry_msgs/Pose pose\ngeometry_msgs/Vector3 scale\nstd_msgs/ColorRGBA color\n\
    builtin_interfaces/Duration lifetime\nbool frame_locked\ngeometry_msgs/Point[] points\n\
    std_msgs/ColorRGBA[] colors\n";
const HUMBLE: &str = "string texture_resource\nsensor_msgs/CompressedImage texture\nUVCoordinate[] uv_coordinates\n\
    string text\nstring mesh_resource\nMeshFile mesh_file\nbool mesh_use_embedded_materials\n";
const FOXY: &str = "string text\nstring mesh_resource\nbool mesh_use_embedded_materials\n";
const PARTS: &str = "===\nMSG: geometry_msgs/Pose\nPoint position\nQuaternion orientation\n===\n\
    MSG: geometry_msgs/Point\nfloat64 x\nfloat64 y\nfloat64 z\n===\nMSG: geometry_msgs/Quaternion\nfloat64 x\n\
    float64 y\nfloat64 z\nfloat64 w\n===\nMSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n===\n\
    MSG: std_msgs/ColorRGBA\nfloat32 r\nfloat32 g\nfloat32 b\nfloat32 a\n===\n\
    MSG: builtin_interfaces/Duration\nint32 sec\nuint32 nanosec\n===\nMSG: sensor_msgs/CompressedImage\n\
    std_msgs/Header header\nstring format\nuint8[] data\n===\nMSG: visualization_msgs/UVCoordinate\nfloat32 u\n\
    float32 v\n===\nMSG: visualization_msgs/MeshFile\nstring filename\nuint8[] data\n===\nMSG: std_msgs/Header\n";

struct Marker {
    namespace: &'static str,
    id: i32,
    kind: i32,
    action: i32,
    pose: [f64; 7],
    scale: [f64; 3],
    alpha: f32,
    lifetime: (i32, u32),
    points: Vec<[f64; 3]>,
    colors: Vec<[f32; 4]>,
}

impl Marker {
    fn of(kind: i32) -> Self {
        Self {
            namespace: "plan",
            id: 7,
            kind,
            action: 0,
            pose: [1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0],
            scale: [4.0, 5.0, 6.0],
            alpha: 0.5,
            lifetime: (0, 0),
            points: vec![[0.0; 3], [1.0, 0.0, 0.0], [1.0, 0.0, 2.0]],
            colors: Vec::new(),
        }
    }

    /// The same marker without points.
    fn alone(self) -> Self {
        Self { points: Vec::new(), ..self }
    }
}

/// Writes little-endian CDR.
struct Writer(Vec<u8>);

impl Writer {
    fn fixed<const N: usize>(&mut self, bytes: [u8; N]) {
        while !(self.0.len() - 4).is_multiple_of(N) {
            self.0.push(0);
        }
        self.0.extend(bytes);
    }

    fn int(&mut self, v: i32) {
        self.fixed(v.to_le_bytes());
    }

    fn doubles(&mut self, all: &[f64]) {
        for v in all {
            self.fixed(v.to_le_bytes());
        }
    }

    fn floats(&mut self, all: &[f32]) {
        for v in all {
            self.fixed(v.to_le_bytes());
        }
    }

    fn text(&mut self, text: &str) {
        self.int(text.len() as i32 + 1);
        self.0.extend(text.as_bytes());
        self.0.push(0);
    }

    fn data(&mut self, data: &[u8]) {
        self.int(data.len() as i32);
        self.0.extend(data);
    }

    fn header(&mut self, frame_id: &str) {
        self.int(5);
        self.int(7);
        self.text(frame_id);
    }

    fn marker(&mut self, marker: &Marker, is_foxy: bool) {
        self.header("map");
        self.text(marker.namespace);
        self.int(marker.id);
        self.int(marker.kind);
        self.int(marker.action);
        self.doubles(&marker.pose);
        self.doubles(&marker.scale);
        self.floats(&[1.0, 0.0, 0.25, marker.alpha]);
        self.int(marker.lifetime.0);
        self.fixed(marker.lifetime.1.to_le_bytes());
        self.fixed([1]);
        self.int(marker.points.len() as i32);
        marker.points.iter().for_each(|point| self.doubles(point));
        self.int(marker.colors.len() as i32);
        marker.colors.iter().for_each(|color| self.floats(color));
        if !is_foxy {
            self.text("embedded://bark");
            self.header("");
            self.text("png");
            self.data(&[1, 2, 3]);
            self.int(1);
            self.floats(&[0.5, 0.5]);
        }
        self.text("hello");
        self.text("package://a/b.dae");
        if !is_foxy {
            self.text("b.dae");
            self.data(&[9, 8]);
        }
        self.fixed([1]);
    }
}

fn schema(name: &str, rest: &str) -> Schema {
    let marker = format!("{FIRST}{rest}{PARTS}{TIME}");
    let definition = if name.ends_with("Array") {
        format!("visualization_msgs/Marker[] markers\n===\nMSG: visualization_msgs/Marker\n{marker}")
    } else {
        marker
    };
    Schema::new(name, MessageEncoding::Cdr, "ros2msg", Bytes::from(definition))
}

fn update(schema: &Schema, bytes: &Bytes) -> foxglove::SceneUpdate {
    assert_eq!(canonical_name(schema), Some("foxglove.SceneUpdate"));
    let message = canonical(schema, bytes).unwrap().unwrap();
    message.get::<foxglove::SceneUpdate>().unwrap().clone()
}

fn array(rest: &str, markers: &[Marker]) -> foxglove::SceneUpdate {
    let mut writer = Writer(vec![0, 1, 0, 0]);
    writer.int(markers.len() as i32);
    for marker in markers {
        writer.marker(marker, rest == FOXY);
    }
    update(&schema("visualization_msgs/msg/MarkerArray", rest), &writer.0.into())
}

/// The one entity of one marker.
fn entity(marker: &Marker) -> foxglove::SceneEntity {
    let mut entities = Vec::new();
    for (rest, is_foxy) in [(HUMBLE, false), (FOXY, true)] {
        let mut writer = Writer(vec![0, 1, 0, 0]);
        writer.marker(marker, is_foxy);
        let mut update = update(&schema("visualization_msgs/msg/Marker", rest), &writer.0.into());
        assert!(update.deletions.is_empty() && update.entities.len() == 1);
        let mut entity = update.entities.remove(0);
        entity.models.iter_mut().for_each(|model| model.data = Bytes::new());
        entities.push(entity);
    }
    // Numbers that are none equal nothing, so the texts are compared.
    let [humble, foxy] = [0, 1].map(|at| format!("{:?}", entities[at]));
    assert_eq!(humble, foxy, "both definitions say the same");
    entities.remove(0)
}

fn position(pose: Option<foxglove::Pose>) -> [f64; 3] {
    let p = pose.unwrap().position.unwrap();
    [p.x, p.y, p.z]
}

#[test]
fn an_entity_keeps_name_frame_time_and_lifetime() {
    let cube = entity(&Marker { lifetime: (2, 500_000_000), ..Marker::of(1).alone() });
    assert_eq!((cube.id.as_str(), cube.frame_id.as_str(), cube.frame_locked), ("plan/7", "map", true));
    assert_eq!(cube.timestamp.map(|time| (time.seconds, time.nanos)), Some((5, 7)));
    assert_eq!(cube.lifetime.map(|time| (time.seconds, time.nanos)), Some((2, 500_000_000)));
    let color = cube.cubes[0].color.unwrap();
    assert_eq!([color.r, color.g, color.b, color.a], [1.0, 0.0, 0.25, 0.5]);
}

#[test]
fn each_kind_of_marker_becomes_its_primitive() {
    let size = Some(foxglove::Vector3 { x: 4.0, y: 5.0, z: 6.0 });
    let arrow = entity(&Marker::of(0).alone()).arrows[0];
    assert_eq!(
        (position(arrow.pose), arrow.shaft_diameter, arrow.head_diameter),
        ([1.0, 2.0, 3.0], 5.0, 10.0)
    );
    assert!((arrow.shaft_length + arrow.head_length - 4.0).abs() < 1e-9);
    assert_eq!(entity(&Marker::of(1)).cubes[0].size, size);
    assert_eq!(entity(&Marker::of(2)).spheres[0].size, size);
    let cylinder = entity(&Marker::of(3)).cylinders[0];
    assert_eq!((cylinder.size, cylinder.bottom_scale, cylinder.top_scale), (size, 1.0, 1.0));
    for (kind, expect) in
        [(4, foxglove::line_primitive::Type::LineStrip), (5, foxglove::line_primitive::Type::LineList)]
    {
        let line = entity(&Marker::of(kind)).lines.remove(0);
        assert_eq!((line.r#type(), line.thickness, line.points.len()), (expect, 4.0, 3));
        assert_eq!(position(line.pose), [1.0, 2.0, 3.0]);
    }
    let cubes = entity(&Marker::of(6)).cubes;
    assert_eq!(cubes.iter().map(|cube| position(cube.pose)[2]).collect::<Vec<_>>(), [3.0, 3.0, 5.0]);
    assert_eq!(entity(&Marker::of(7)).spheres.len(), 3);
    let points = entity(&Marker::of(8)).cubes;
    assert_eq!(points[0].size, Some(foxglove::Vector3 { x: 4.0, y: 5.0, z: 4.0 }));
    let text = entity(&Marker::of(9)).texts.remove(0);
    assert_eq!((text.text.as_str(), text.font_size, text.billboard), ("hello", 6.0, true));
    let model = entity(&Marker::of(10)).models.remove(0);
    assert_eq!((model.url.as_str(), model.override_color, model.scale), ("package://a/b.dae", false, size));
    let triangles = entity(&Marker::of(11)).triangles.remove(0);
    assert_eq!(triangles.points[2], foxglove::Point3 { x: 4.0, y: 0.0, z: 12.0 });
    let unknown = entity(&Marker::of(12));
    assert!(unknown.cubes.is_empty() && unknown.lines.is_empty());
}

#[test]
fn an_arrow_points_from_its_first_point_to_its_second() {
    let points = vec![[1.0, 0.0, 0.0], [1.0, 2.0, 0.0]];
    let marker = Marker { scale: [0.1, 0.2, 0.5], points, ..Marker::of(0) };
    let arrow = entity(&marker).arrows[0];
    assert_eq!((arrow.shaft_diameter, arrow.head_diameter, arrow.head_length), (0.1, 0.2, 0.5));
    assert!((arrow.shaft_length - 1.5).abs() < 1e-9);
    assert_eq!(position(arrow.pose), [2.0, 2.0, 3.0]);
    let q = arrow.pose.unwrap().orientation.unwrap();
    let half = std::f64::consts::FRAC_1_SQRT_2;
    assert!((q.z - half).abs() < 1e-6 && (q.w - half).abs() < 1e-6, "it points along y: {q:?}");
    let nowhere = Marker { points: vec![[1.0; 3]; 2], ..Marker::of(0) };
    assert!(entity(&nowhere).arrows.is_empty());
}

#[test]
fn a_marker_turns_its_points_and_an_orientation_that_was_never_set_does_not() {
    // A quarter turn to the left, twice too long.
    let turned = [0.0, 0.0, 0.0, 0.0, 0.0, 2.0_f64.sqrt(), 2.0_f64.sqrt()];
    let cubes = entity(&Marker { pose: turned, ..Marker::of(6) }).cubes;
    let [x, y, _] = position(cubes[1].pose);
    assert!(x.abs() < 1e-9 && (y - 1.0).abs() < 1e-9, "{x} {y}");
    let cubes = entity(&Marker { pose: [0.0; 7], ..Marker::of(6) }).cubes;
    assert_eq!(position(cubes[1].pose), [1.0, 0.0, 0.0]);
    assert_eq!(cubes[1].pose.unwrap().orientation.map(|q| q.w), Some(1.0));
    let nan = entity(&Marker { pose: [f64::NAN; 7], ..Marker::of(6) });
    assert_eq!(nan.cubes.len(), 3, "the views leave out what cannot be");
}

#[test]
fn colours_of_points_count_where_there_is_one_for_each() {
    let red = [1.0, 0.0, 0.0, 0.0];
    let alphas = |colors: Vec<[f32; 4]>, kind: i32| {
        let entity = entity(&Marker { colors, ..Marker::of(kind) });
        let colors = entity.triangles.iter().flat_map(|triangles| triangles.colors.clone());
        let cubes = entity.cubes.iter().filter_map(|cube| cube.color);
        colors.chain(cubes).map(|color| (color.r, color.b, color.a)).collect::<Vec<_>>()
    };
    assert_eq!(alphas(vec![red; 3], 6), [(1.0, 0.0, 0.5); 3], "the opacity of the marker");
    assert_eq!(alphas(vec![[1.0, 0.0, 0.0, 0.75]; 3], 6), [(1.0, 0.0, 0.75); 3]);
    assert_eq!(alphas(vec![red; 2], 6), [(1.0, 0.25, 0.5); 3], "the colour of the marker");
    assert_eq!(alphas(vec![red], 11), [(1.0, 0.0, 0.5); 3], "of a triangle");
}

#[test]
fn markers_of_an_array_count_one_after_the_other() {
    let marker = |id: i32, action: i32| Marker { id, action, ..Marker::of(1).alone() };
    let ids = |update: &foxglove::SceneUpdate| {
        update.entities.iter().map(|entity| entity.id.clone()).collect::<Vec<_>>()
    };
    let markers = [marker(1, 0), marker(2, 0), marker(1, 2), marker(3, 0), marker(2, 0), marker(9, 5)];
    let update = array(HUMBLE, &markers);
    assert_eq!(ids(&update), ["plan/3", "plan/2"]);
    assert_eq!((update.deletions.len(), update.deletions[0].id.as_str()), (1, "plan/1"));
}

#[test]
fn all_markers_are_deleted_or_from_humble_on_those_of_a_namespace() {
    let add = |namespace: &'static str, id: i32| Marker { namespace, id, ..Marker::of(1).alone() };
    let delete_all = |namespace: &'static str| Marker { action: 3, ..add(namespace, 0) };
    let check = |rest: &str, namespace: &'static str, expect: &[&str], kind: i32, of: &str| {
        let first = [add("plan", 1), add("plan", -1), add("plan/near", 2), add("goal", 3)];
        let markers: Vec<Marker> = first.into_iter().chain([delete_all(namespace), add("plan", 4)]).collect();
        let update = array(rest, &markers);
        let ids: Vec<&str> = update.entities.iter().map(|entity| entity.id.as_str()).collect();
        assert_eq!(ids, expect, "{namespace:?}");
        let deletions: Vec<_> =
            update.deletions.iter().map(|deletion| (deletion.r#type, deletion.id.as_str())).collect();
        assert_eq!(deletions, [(kind, of)]);
    };
    let all = foxglove::scene_entity_deletion::Type::All.into();
    check(HUMBLE, "", &["plan/4"], all, "");
    check(HUMBLE, "plan", &["plan/near/2", "goal/3", "plan/4"], DELETES_NAMESPACE, "plan");
    check(FOXY, "plan", &["plan/4"], all, "");
}

#[test]
fn a_damaged_array_is_refused_and_another_definition_is_named() {
    let schema = schema("visualization_msgs/msg/MarkerArray", HUMBLE);
    let many = Bytes::from(vec![0, 1, 0, 0, 0xff, 0xff, 0xff, 0x7f, 0, 0]);
    canonical(&schema, &many).unwrap().expect_err("more markers than bytes");
    let other = Schema::new(
        "visualization_msgs/msg/Marker",
        MessageEncoding::Cdr,
        "ros2msg",
        Bytes::from_static(b"int32 id\n"),
    );
    let error = canonical(&other, &many).unwrap().expect_err("another definition").to_string();
    assert!(error.contains("is laid out as i, expected iIss"), "{error}");
}
