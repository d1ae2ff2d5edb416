//! Writes the recordings with which plots and comparisons are measured (benches/README.md).
//!
//! `recordings points FILE [TOPICS]`: four series of a million numbers at 1 kHz: the fields of one topic, or of as many
//! topics as given. `recordings hour FILE [VALUE]`: an hour of a robot, about 1 GB; VALUE is the speed that the last
//! process has 20 s before the end.

#![allow(clippy::print_stdout, reason = "its output is what it is for")]

use rcs_log::{ChannelId, LogError, LogWriter, WriteHeader, WriterOptions};
use rcs_msg::{AnyMessage, Stamp, foxglove, rcs, registry};
use std::collections::BTreeMap;
use std::path::Path;

type Outcome = Result<(), Box<dyn std::error::Error>>;

/// Numbers of a series.
const POINTS: u64 = 1_000_000;
/// Processes of the robot; each writes its status and a pose at 50 Hz.
const PROCESSES: u32 = 15;
const SECONDS: u64 = 3600;
/// Bytes of an image, two of which are written in a second.
const IMAGE: usize = 100_000;

fn main() -> Outcome {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match arguments.iter().map(String::as_str).collect::<Vec<_>>().as_slice() {
        ["points", file] => points(file.as_ref(), 1)?,
        ["points", file, topics] => points(file.as_ref(), topics.parse()?)?,
        ["hour", file] => hour(file.as_ref(), 1.0)?,
        ["hour", file, value] => hour(file.as_ref(), value.parse()?)?,
        _ => return Err("expected: points FILE [TOPICS], or hour FILE [VALUE]".into()),
    }
    println!("{:.0} MB", std::fs::metadata(&arguments[1])?.len() as f64 / 1e6);
    Ok(())
}

fn channel(writer: &mut LogWriter, topic: &str, schema: &'static str) -> Result<ChannelId, LogError> {
    let schema = registry().schema(schema).ok_or_else(|| LogError::Refused {
        what: "a topic",
        expected: "a schema of the registry".to_owned(),
        got: schema.to_owned(),
    })?;
    writer.add_channel(topic, schema, &BTreeMap::new())
}

fn header(sequence: u64, time: u64) -> WriteHeader {
    WriteHeader { sequence: sequence as u32, log_time: Stamp(time), publish_time: Stamp(time) }
}

/// Noise that does not compress.
fn noise(number: &mut u64) -> u64 {
    *number ^= *number << 13;
    *number ^= *number >> 7;
    *number ^= *number << 17;
    *number
}

/// Four series: waves of different length with noise.
fn points(file: &Path, topics: usize) -> Outcome {
    let mut writer = LogWriter::create(file, WriterOptions { replace: true, ..WriterOptions::default() })?;
    let names: Vec<String> = (0..topics).map(|topic| format!("/series{topic}")).collect();
    let channels: Result<Vec<ChannelId>, LogError> =
        names.iter().map(|name| channel(&mut writer, name, "foxglove.Quaternion")).collect();
    let (channels, mut number) = (channels?, 0x2545_f491_4f6c_dd1d);
    for i in 0..POINTS {
        let wave = |k: f64, noise: u64| (i as f64 * 1e-5 * k).sin() + (noise % 1000) as f64 * 1e-4;
        for (topic, channel) in channels.iter().enumerate() {
            let [x, y, z, w] =
                [1.0, 3.0, 7.0, 19.0].map(|k| wave(k * (1.0 + topic as f64), noise(&mut number)));
            let message = AnyMessage::new(foxglove::Quaternion { x, y, z, w });
            writer.write(*channel, header(i, i * 1_000_000), &message.bytes())?;
        }
    }
    Ok(writer.finish()?)
}

/// An hour of a robot: the statuses and poses of its processes, and images.
fn hour(file: &Path, speed: f64) -> Outcome {
    let mut writer = LogWriter::create(file, WriterOptions { replace: true, ..WriterOptions::default() })?;
    let camera = channel(&mut writer, "/camera/image", "foxglove.CompressedImage")?;
    let mut processes = Vec::new();
    for process in 0..PROCESSES {
        let status = channel(&mut writer, &format!("/p{process}/status"), "rcs.Status")?;
        let pose = channel(&mut writer, &format!("/p{process}/pose"), "foxglove.PoseInFrame")?;
        processes.push((status, pose));
    }
    let mut number = 0x2545_f491_4f6c_dd1d;
    for cycle in 0..SECONDS * 50 {
        let time = cycle * 20_000_000;
        for (index, (status, pose)) in processes.iter().enumerate() {
            let at = time + index as u64 * 1_000_000;
            let message = rcs::Status {
                command: "RUN".to_owned(),
                echo_serial: 1,
                cycle,
                state_text: "works".to_owned(),
                ..rcs::Status::default()
            };
            writer.write(*status, header(cycle, at), &AnyMessage::new(message).bytes())?;
            let is_late = cycle == (SECONDS - 20) * 50 && index + 1 == processes.len();
            let z = if is_late { speed } else { 1.0 };
            let noisy = |value: f64, noise: u64| value + (noise % 1000) as f64 * 1e-4;
            let position = foxglove::Vector3 {
                x: noisy(cycle as f64 * 0.02, noise(&mut number)),
                y: noisy(index as f64, noise(&mut number)),
                z,
            };
            let message = foxglove::PoseInFrame {
                timestamp: Some(Stamp(at).to_proto()),
                frame_id: "local".to_owned(),
                pose: Some(foxglove::Pose { position: Some(position), orientation: None }),
            };
            writer.write(*pose, header(cycle, at), &AnyMessage::new(message).bytes())?;
        }
        if cycle % 25 == 0 {
            let data: Vec<u8> = (0..IMAGE / 8).flat_map(|_| noise(&mut number).to_le_bytes()).collect();
            let message = foxglove::CompressedImage {
                timestamp: Some(Stamp(time).to_proto()),
                frame_id: "camera".to_owned(),
                data: data.into(),
                format: "jpeg".to_owned(),
            };
            writer.write(camera, header(cycle / 25, time + 17_000_000), &AnyMessage::new(message).bytes())?;
        }
    }
    Ok(writer.finish()?)
}
