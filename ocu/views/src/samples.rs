//! Small synthetic frames for the tests of the views.

#[path = "samples_camera.rs"]
mod camera;
#[path = "samples_compare.rs"]
mod compare;
#[path = "samples_driving.rs"]
mod driving;
#[path = "samples_plan.rs"]
mod plan;
#[path = "samples_states.rs"]
mod states;

pub(crate) use camera::{CAMERA_M, camera_in_space};
pub(crate) use compare::{SIDES, compared};
pub(crate) use driving::driving;
use rcs_bus::{Header, Sample, WriterId};
use rcs_geom::{DVec2, DVec3, Enu, Geodetic, Pose, TransformTree};
use rcs_msg::classes::{CLASSES, OBSTACLE_CLASSES, classes_to_json};
use rcs_msg::foxglove::packed_element_field::NumericType;
use rcs_msg::foxglove::{
    self, CompressedImage, Grid, PackedElementField, PointCloud, PoseInFrame, PosesInFrame, RawImage,
};
use rcs_msg::rcs::{Command, ProcessInfo, ProcessState, Status};
use rcs_msg::{AnyMessage, MessageEncoding, Payload, Schema, Stamp, schema_of};
use rcs_runtime::source::{Frame, RunTag, SourceInfo, SourceKind, Topic, Track, TrackPoint, WGS84};
use rcs_world::{Map, MapOptions, Source, Sources, VoteRule, Weights};
pub(crate) use states::{commands, forty, states};
use std::sync::Arc;

/// The current time of the samples, 12.5 s after their start.
pub(crate) const NOW: Stamp = Stamp(1_700_000_012_500_000_000);
const START: Stamp = Stamp(1_700_000_000_000_000_000);

/// A frame without content.
pub(crate) fn empty() -> Frame {
    let info = SourceInfo {
        kind: SourceKind::Log,
        title: "sample.mcap".into(),
        detail: "sample.mcap".into(),
        start: START,
        end: Some(NOW.after_ns(60_000_000_000)),
        ..SourceInfo::default()
    };
    Frame::empty(Arc::new(info), NOW)
}

/// A topic with one message of age `age_s`.
pub(crate) fn topic<T: Payload>(name: &str, hz: f64, age_s: f64, message: T) -> Topic {
    let log_time = NOW.before_ns((age_s * 1e9) as u64);
    let header = Header { sequence: 42, log_time, acq_time: log_time, writer: WriterId::RUNTIME };
    let mut topic = Topic::new(name, RunTag::FIRST, Arc::clone(schema_of::<T>()))
        .with_latest(Sample { header, message: AnyMessage::new(message) });
    topic.hz = (hz > 0.0).then_some(hz);
    topic.messages = 1234;
    topic
}

fn with_metadata(mut topic: Topic, writer: &str, metadata: &[(&str, &str)]) -> Topic {
    topic.writer = writer.into();
    topic.metadata = Arc::new(metadata.iter().map(|(k, v)| ((*k).to_owned(), (*v).to_owned())).collect());
    topic
}

/// A frame with a message of each kind that views show, and processes in each state.
pub(crate) fn full() -> Frame {
    let classes = classes_to_json(&OBSTACLE_CLASSES);
    let labels = [("rcs.role", "labels"), ("rcs.overlay_of", "/camera/image"), (CLASSES, &*classes)];
    let mut flat = Topic::new(
        "/flat/chatter",
        RunTag::Recorded,
        Arc::new(Schema::new(
            "std_msgs/String",
            MessageEncoding::Other("flatbuffer".into()),
            "flatbuffer",
            Vec::new().into(),
        )),
    );
    flat.undecodable = Some("message encoding \"flatbuffer\" has no reader".into());
    let header = Header { sequence: 7, log_time: NOW, acq_time: NOW, writer: WriterId::RUNTIME };
    let bytes = (0..100_u8).collect::<Vec<_>>().into();
    let schema = Arc::clone(&flat.schema);
    let flat = flat.with_latest(Sample { header, message: AnyMessage::encoded(schema, bytes) });
    let mut topics = vec![
        with_metadata(topic("/camera/image", 5.0, 0.1, image(96, 64)), "", &[("rcs.role", "image")]),
        topic("/camera/depth", 5.0, 9.0, depth(96, 64)),
        with_metadata(topic("/obstacles/labels", 5.0, 0.1, label_image(48, 32)), "obstacles", &labels),
        with_metadata(topic("/wm1/map", 5.0, 0.2, world_map()), "wm1", &[("rcs.role", "map")]),
        topic("/lidar/points", 10.0, 0.1, cloud(&ring(500))),
        topic("/pose", 10.0, 0.05, pose_on_track(124)),
        with_metadata(topic("/planner/path", 5.0, 0.3, path()), "planner", &[("rcs.role", "path")]),
        with_metadata(
            topic("/obstacles/status", 5.0, 0.1, status("RUN", ProcessState::Exec)),
            "obstacles",
            &[],
        ),
        with_metadata(topic("/wm1/status", 5.0, 5.0, status("RUN", ProcessState::Exec)), "wm1", &[]),
        with_metadata(
            topic("/planner/status", 5.0, 0.1, status("GOTO", ProcessState::Error)),
            "planner",
            &[],
        ),
        topic("/planner/command", 0.0, 0.1, Command { serial: 4, name: "GOTO".into(), ..Command::default() }),
        topic(
            "/camera/broken",
            1.0,
            0.1,
            CompressedImage { data: vec![1, 2, 3].into(), ..Default::default() },
        ),
        flat,
        Topic::new("/nothing/yet", RunTag::FIRST, Arc::clone(schema_of::<RawImage>())),
    ];
    topics.sort_by(|a, b| a.name.cmp(&b.name));
    let process = |name: &str, supervisor: &str| ProcessInfo {
        name: name.into(),
        supervisor: supervisor.into(),
        summary: format!("does what {name} does"),
        period_ns: 200_000_000,
        status_buffer: format!("/{name}/status"),
        command_buffer: format!("/{name}/command"),
        ..ProcessInfo::default()
    };
    let processes = [
        process("planner", "viewer"),
        process("wm1", "planner"),
        process("obstacles", "planner"),
        process("idle", "planner"),
        process("lost", "nobody"),
    ];
    let tracks = [track("/odometry", "odom", 0.4), degrees("/gps/fix"), track("/pose", "local", 0.0)];
    let mut tree = TransformTree::new();
    tree.set_static("local", "lidar", Pose::from_xy_yaw(1.0, 0.5, 0.3)).unwrap();
    Frame {
        topics: topics.into(),
        processes: processes.into(),
        tracks: tracks.into(),
        events: Arc::new([]),
        transforms: Arc::new(tree),
        ..empty()
    }
}

fn status(command: &str, state: ProcessState) -> Status {
    Status {
        command: command.into(),
        echo_serial: 3,
        state: state.into(),
        state_text: "following the path".into(),
        cycle: 321,
        ..Status::default()
    }
}

fn image(width: u32, height: u32) -> RawImage {
    let pixel = |x: u32, y: u32| {
        if y < height / 2 { [120, 160, 210] } else { [90 + (x % 16) as u8, 100, 60 + (y % 16) as u8] }
    };
    let data: Vec<u8> = (0..width * height).flat_map(|i| pixel(i % width, i / width)).collect();
    RawImage {
        width,
        height,
        encoding: "rgb8".into(),
        step: width * 3,
        data: data.into(),
        ..RawImage::default()
    }
}

fn depth(width: u32, height: u32) -> RawImage {
    let value = |y: u32| if y < height / 4 { 0 } else { (20_000 - y * 250) as u16 };
    let data: Vec<u8> = (0..width * height).flat_map(|i| value(i / width).to_le_bytes()).collect();
    RawImage {
        width,
        height,
        encoding: "16UC1".into(),
        step: width * 2,
        data: data.into(),
        ..RawImage::default()
    }
}

fn label_image(width: u32, height: u32) -> RawImage {
    let label = |x: u32, y: u32| match (x * 6 / width, y * 3 / height) {
        (_, 0) => 5,
        (2, 1) => 2,
        (4, 1) => 3,
        (0, _) => 0,
        _ => 1,
    };
    let data: Vec<u8> = (0..width * height).map(|i| label(i % width, i / width)).collect();
    RawImage {
        width,
        height,
        encoding: "mono8".into(),
        step: width,
        data: data.into(),
        ..RawImage::default()
    }
}

/// Cost of a cell of the sample grid.
pub(crate) fn cost(column: usize, row: usize) -> u8 {
    if column == row { 255 } else { (column * 13 + row * 7).min(250) as u8 }
}

/// A grid in frame `local` around the origin, with cost, confidence and sequence of one source.
pub(crate) fn grid(columns: usize, rows: usize) -> Grid {
    let fields = [
        ("cost.stereo", 0, NumericType::Uint8),
        ("conf.stereo", 1, NumericType::Uint8),
        ("seq.stereo", 2, NumericType::Uint32),
    ];
    let fields = fields.map(|(name, offset, kind)| PackedElementField {
        name: name.into(),
        offset,
        r#type: kind.into(),
    });
    let mut data = Vec::new();
    for row in 0..rows {
        for column in 0..columns {
            let cost = cost(column, row);
            data.extend([cost, if cost == 255 { 0 } else { 200 }]);
            data.extend(7_u32.to_le_bytes());
        }
    }
    let corner = DVec3::new(columns as f64, rows as f64, 0.0) * -0.1;
    let position = foxglove::Vector3 { x: corner.x, y: corner.y, z: 0.0 };
    Grid {
        frame_id: "local".into(),
        pose: Some(foxglove::Pose { position: Some(position), orientation: None }),
        column_count: columns as u32,
        cell_size: Some(foxglove::Vector2 { x: 0.2, y: 0.2 }),
        row_stride: columns as u32 * 6,
        cell_stride: 6,
        fields: fields.into(),
        data: data.into(),
        ..Grid::default()
    }
}

/// A costmap in frame `map` with cells of 0.5 m, whose corner lies at (1, 2), from the bytes that Nav2 writes.
pub(crate) fn costmap(columns: usize, cells: &[u8]) -> Grid {
    let schema = Schema::new("nav2_msgs/msg/Costmap", MessageEncoding::Cdr, "ros2idl", Vec::new().into());
    let words =
        |words: &[usize]| -> Vec<u8> { words.iter().flat_map(|word| (*word as u32).to_le_bytes()).collect() };
    let mut bytes: Vec<u8> = vec![0, 1, 0, 0];
    // Time and frame; the times of loading and of the last update, and the layer.
    bytes.extend(words(&[5, 7, 4]));
    bytes.extend(b"map\0");
    bytes.extend(words(&[0, 0, 0, 0, 4]));
    bytes.extend(b"raw\0");
    // Resolution, columns and rows; then padding before the pose.
    bytes.extend(0.5_f32.to_le_bytes());
    bytes.extend(words(&[columns, cells.len() / columns, 0]));
    bytes.extend([1.0_f64, 2.0, 0.0, 0.0, 0.0, 0.0, 1.0].iter().flat_map(|number| number.to_le_bytes()));
    bytes.extend(words(&[cells.len()]));
    bytes.extend(cells);
    let message = rcs_msg::canonical(&schema, &bytes.into()).unwrap().unwrap();
    message.get::<Grid>().unwrap().clone()
}

/// A map of the world model in frame `local`: a road along the track, grass beside it, and trees.
fn world_map() -> Grid {
    let mut map = Map::new(0.2).unwrap();
    let (sources, time) = (Sources::from_iter([Source::STEREO]), NOW.before_ns(400_000_000));
    let surely = VoteRule { rise: 255, max: 255, ground_max: 255, ..VoteRule::default() };
    for (row, column) in (0..201).flat_map(|row| (0..201).map(move |column| (row, column))) {
        let (x, y) = ((f64::from(column) - 100.0) * 0.2 + 0.1, (f64::from(row) - 100.0) * 0.2 + 0.1);
        // Seen area: a fan ahead of the vehicle, and the driven track.
        let road = y - 4.0 * (x / 5.0).sin();
        let tree = (x * 0.9).sin() * (y * 1.1).cos() > 0.93;
        let cost = match road.abs() {
            _ if tree => 250,
            d if d < 1.5 => 10,
            d if d < 3.0 => 75,
            d if d < 4.0 => 130,
            _ => 180,
        };
        if x > -3.0 && x.hypot(y) < 17.0 && road.abs() < 9.0 {
            let index = map.grid().cell_at(DVec2::new(x, y)).unwrap();
            map.vote(index, Source::STEREO, cost, 7, time, surely);
        }
    }
    map.to_grid("local", time, &MapOptions { sources, heights: false, weights: Weights::default() })
}

/// A cloud in frame `lidar`.
pub(crate) fn cloud(points: &[[f32; 3]]) -> PointCloud {
    let field = |(i, name): (usize, &str)| PackedElementField {
        name: name.into(),
        offset: i as u32 * 4,
        r#type: NumericType::Float32.into(),
    };
    PointCloud {
        frame_id: "lidar".into(),
        point_stride: 12,
        fields: ["x", "y", "z"].into_iter().enumerate().map(field).collect(),
        data: points.iter().flatten().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>().into(),
        ..PointCloud::default()
    }
}

fn ring(count: usize) -> Vec<[f32; 3]> {
    let point = |i: usize| {
        let angle = i as f32 * 0.1;
        let radius = 2.0 + i as f32 / count as f32 * 4.0;
        [radius * angle.cos(), radius * angle.sin(), i as f32 / count as f32]
    };
    (0..count).map(point).collect()
}

fn path() -> PosesInFrame {
    let pose = |i: usize| {
        let position = foxglove::Vector3 { x: i as f64 * 0.5, y: (i as f64 * 0.3).sin() * 2.0, z: 0.0 };
        foxglove::Pose { position: Some(position), orientation: None }
    };
    PosesInFrame { frame_id: "local".into(), poses: (0..12).map(pose).collect(), ..PosesInFrame::default() }
}

fn curve(i: usize) -> [f64; 2] {
    let t = i as f64 * 0.1;
    [t, 4.0 * (t / 5.0).sin()]
}

fn track(topic: &str, frame_id: &str, turn_rad: f64) -> Track {
    let (sin, cos) = turn_rad.sin_cos();
    let place = |i: usize| {
        let [x, y] = curve(i);
        [cos * x - sin * y, sin * x + cos * y, 0.0]
    };
    Track {
        topic: topic.into(),
        run: RunTag::FIRST,
        frame_id: frame_id.into(),
        origin: None,
        points: (0..200).map(|i| point(i, place(i))).collect(),
    }
}

fn degrees(topic: &str) -> Track {
    let origin = Enu::new(Geodetic::new(48.0, 8.0, 120.0).unwrap());
    let place = |i: usize| {
        let [east, north] = curve(i);
        let fix = Geodetic::new(48.0 + north / 111_200.0, 8.0 + east / 74_600.0, 120.0).unwrap();
        origin.enu_from_geodetic(&fix).to_array()
    };
    Track {
        topic: topic.into(),
        run: RunTag::FIRST,
        frame_id: WGS84.into(),
        origin: Some(origin),
        points: (0..200).map(|i| point(i, place(i))).collect(),
    }
}

fn point(i: usize, position_m: [f64; 3]) -> TrackPoint {
    TrackPoint { stamp: START.after_ns(i as u64 * 100_000_000), position_m, yaw_rad: f64::NAN }
}

/// The message of a pose on a track: an arrow of the vehicle.
fn pose_on_track(i: usize) -> PoseInFrame {
    let [x, y] = curve(i);
    let position = Some(foxglove::Vector3 { x, y, z: 0.0 });
    let pose = Some(foxglove::Pose { position, orientation: None });
    PoseInFrame { frame_id: "local".into(), pose, ..PoseInFrame::default() }
}
