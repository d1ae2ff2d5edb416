//! Large messages: a grid of a million cells, an image of 1920×1200 pixels, and a cloud of a million points, each new
//! once a second.

use super::pass::{pass, summary};
use super::plots::{moved, zoomed};
use ocu_app::open::Request;
use rcs_log::{LogWriter, WriteHeader, WriterOptions};
use rcs_msg::foxglove::packed_element_field::NumericType;
use rcs_msg::foxglove::{Grid, PackedElementField, PointCloud, Pose, RawImage, Vector2, Vector3};
use rcs_msg::{AnyMessage, Stamp};
use std::collections::BTreeMap;
use std::path::Path;
use std::time::{Duration, Instant};

const SIDE: u32 = 1000;
const SECONDS: u64 = 8;

/// Makes the message of a second.
type Made = fn(u64) -> AnyMessage;

pub(crate) fn measure() -> anyhow::Result<()> {
    let folder = std::env::temp_dir().join(format!("ocu-interface-{}", std::process::id()));
    std::fs::create_dir_all(&folder)?;
    let made: [(&str, &str, Made); 3] = [
        ("a grid of 1000x1000 cells", r#"View(kind: "map")"#, |second| AnyMessage::new(grid(second))),
        ("an image of 1920x1200 pixels", r#"View(kind: "camera")"#, |second| AnyMessage::new(image(second))),
        ("a cloud of 1,000,000 points", r#"View(kind: "map")"#, |second| AnyMessage::new(cloud(second))),
    ];
    for (what, view, message) in made {
        let log = folder.join("large.mcap");
        write(&log, message)?;
        shown(what, view, &log)?;
        std::fs::remove_file(&log)?;
    }
    std::fs::remove_dir(&folder)?;
    Ok(())
}

fn write(path: &Path, message: Made) -> anyhow::Result<()> {
    let mut writer = LogWriter::create(path, WriterOptions::default())?;
    let channel = writer.add_channel("/large", &message(0).schema(), &BTreeMap::new())?;
    for second in 0..SECONDS {
        let time = Stamp(second * 1_000_000_000);
        let header = WriteHeader { sequence: second as u32 + 1, log_time: time, publish_time: time };
        writer.write(channel, header, &message(second).bytes())?;
    }
    writer.finish()?;
    Ok(())
}

fn shown(what: &str, view: &str, log: &Path) -> anyhow::Result<()> {
    let context = egui::Context::default();
    let request = Request { log: Some(log.to_owned()), ..Request::default() };
    let layout =
        format!("Layout(version: 1, name: \"measured\", buffers: false, root: Row([(1.0, {view})]))");
    let opened = Instant::now();
    let mut window = super::window(&context, request, &layout)?;
    // The picture is the first large texture; those of fonts are known after the first frames.
    let mut seen = None;
    while seen.is_none() && opened.elapsed() < Duration::from_secs(20) {
        let times = pass(&context, &mut window, Vec::new());
        if window.frame().is_some_and(|frame| frame.topic("/large").is_some()) && times.pixels > 100_000 {
            seen = Some(opened.elapsed());
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    std::thread::sleep(Duration::from_secs(1));
    let (mut interface, mut triangles) = moved(&context, &mut window);
    let mut zoomed = zoomed(&context, &mut window);
    pass(&context, &mut window, super::press(egui::Key::Space));
    let mut played = Vec::new();
    let began = Instant::now();
    while began.elapsed() < Duration::from_secs(SECONDS - 2) {
        played.push(pass(&context, &mut window, Vec::new()).interface.as_secs_f64() * 1e3);
        std::thread::sleep(super::EVERY);
    }
    println!(
        "{what}: shown {:.0} ms after opening; moved: interface {}; triangles {}; zoomed: {}; played: {}",
        seen.map_or(f64::NAN, |seen| seen.as_secs_f64() * 1e3),
        summary(&mut interface),
        summary(&mut triangles),
        summary(&mut zoomed),
        summary(&mut played),
    );
    Ok(())
}

fn field(name: &str, offset: u32, kind: NumericType) -> PackedElementField {
    PackedElementField { name: name.into(), offset, r#type: kind.into() }
}

fn grid(second: u64) -> Grid {
    let cost = |cell: u32| ((u64::from(cell % SIDE * 3 + cell / SIDE) + 20 * second) % 251) as u8;
    let corner = Vector3 { x: -100.0, y: -100.0, z: 0.0 };
    Grid {
        frame_id: "map".into(),
        pose: Some(Pose { position: Some(corner), orientation: None }),
        column_count: SIDE,
        cell_size: Some(Vector2 { x: 0.2, y: 0.2 }),
        row_stride: SIDE,
        cell_stride: 1,
        fields: vec![field("cost", 0, NumericType::Uint8)],
        data: (0..SIDE * SIDE).map(cost).collect::<Vec<u8>>().into(),
        ..Grid::default()
    }
}

fn image(second: u64) -> RawImage {
    let (width, height) = (1920, 1200);
    let value = |byte: u32| ((u64::from(byte / 3 % width + byte / 3 / width) + 20 * second) % 256) as u8;
    RawImage {
        frame_id: "camera".into(),
        width,
        height,
        encoding: "rgb8".into(),
        step: 3 * width,
        data: (0..3 * width * height).map(value).collect::<Vec<u8>>().into(),
        ..RawImage::default()
    }
}

fn cloud(second: u64) -> PointCloud {
    let point = |i: u32| {
        let (angle, radius) = ((i + 1000 * second as u32) as f32 * 0.01, (i as f32).sqrt() * 0.03);
        [radius * angle.cos(), radius * angle.sin(), (radius * 0.7).sin()]
    };
    PointCloud {
        frame_id: "map".into(),
        point_stride: 12,
        fields: ["x", "y", "z"]
            .into_iter()
            .zip(0..)
            .map(|(n, i)| field(n, 4 * i, NumericType::Float32))
            .collect(),
        data: (0..SIDE * SIDE).flat_map(point).flat_map(f32::to_le_bytes).collect::<Vec<u8>>().into(),
        ..PointCloud::default()
    }
}
