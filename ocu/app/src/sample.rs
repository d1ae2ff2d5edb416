//! `ocu sample`: writes a small recording, for a first look at the program.
//!
//! A simulated robot drives across a meadow. The recording contains what a real robot would record: its stereo pair as
//! JPEG, wheel encoders, inertial sensor, GPS, and its estimated pose, but no ground truth. It is identical on every
//! run, byte for byte.

use crate::assets::ProgramAssets;
use crate::cli::SampleArgs;
use crate::output::Files;
use anyhow::Context as _;
use image::ExtendedColorType;
use image::codecs::jpeg::JpegEncoder;
use rcs_bus::{Buffer, Sample};
use rcs_log::{ChannelId, LogWriter, WriteHeader, WriterOptions};
use rcs_msg::foxglove::{CompressedImage, RawImage};
use rcs_msg::image::raw_to_rgb8;
use rcs_msg::{AnyMessage, schema_of};
use rcs_runtime::{Plan, PlanOptions, RunOptions, StackFile, Stepped};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// The stack that is recorded.
const DRIVE: &str = include_str!("sample_drive.toml");
/// The recorded buffers.
const RECORDED: [&str; 9] = [
    "/vehicle/static_transforms",
    "/camera/left_calibration",
    "/camera/right_calibration",
    "/camera/left",
    "/camera/right",
    "/vehicle/encoders",
    "/vehicle/imu",
    "/vehicle/gps",
    "/localization/local",
];
const JPEG_QUALITY: u8 = 92;

/// Writes the recording named on the command line.
pub fn sample(args: &SampleArgs) -> anyhow::Result<()> {
    Files::new(args.force).writes("the recording", &args.path)?;
    write(&args.path, args.duration, args.force)
}

/// Writes the first `duration_s` of the drive to `path`. An existing file is replaced only with `force`.
pub fn write(path: &Path, duration_s: f64, force: bool) -> anyhow::Result<()> {
    let options = PlanOptions { overrides: &[], course: None, assets: &ProgramAssets };
    let file = StackFile::parse("sample_drive.toml", DRIVE)?;
    let plan = Arc::new(Plan::with(file, rcs_plugins::all(), &options)?);
    let mut run = Stepped::new(plan, None, RunOptions::default()).context("the drive cannot run")?;
    // Chunks are limited by size alone; with a time limit the bytes would depend on the speed of the machine.
    let options = WriterOptions {
        build: crate::BUILD.to_owned(),
        clock: Arc::new(|| Duration::ZERO),
        replace: force,
        ..WriterOptions::default()
    };
    let mut writer = LogWriter::create(path, options)?;
    let written: Arc<Mutex<Vec<(ChannelId, Sample)>>> = Arc::default();
    for name in RECORDED {
        let buffer = run.bus().get(name).with_context(|| format!("the drive has no buffer {name}"))?;
        let channel = add_channel(&mut writer, buffer)?;
        let written = Arc::clone(&written);
        buffer.tap(Box::new(move |sample: &Sample| {
            written.lock().unwrap_or_else(PoisonError::into_inner).push((channel, sample.clone()));
        }));
    }
    run.begin()?;
    let end = run.start().after_ns((duration_s * 1e9).round() as u64);
    while run.next_time()?.is_some_and(|time| time <= end) {
        run.advance()?;
        let written = std::mem::take(&mut *written.lock().unwrap_or_else(PoisonError::into_inner));
        for (channel, sample) in written {
            let header = WriteHeader {
                sequence: sample.header.sequence as u32,
                log_time: sample.header.log_time,
                publish_time: sample.header.acq_time,
            };
            writer.write(channel, header, &compressed(sample.message)?.bytes())?;
        }
    }
    writer.finish().context("cannot finish the recording")
}

fn add_channel(writer: &mut LogWriter, buffer: &Buffer) -> anyhow::Result<ChannelId> {
    let spec = buffer.spec();
    let is_image = spec.schema.name() == schema_of::<RawImage>().name();
    let schema = if is_image { schema_of::<CompressedImage>() } else { &spec.schema };
    Ok(writer.add_channel(&spec.name, schema, &spec.metadata)?)
}

/// Compresses an image as JPEG; other messages are unchanged.
fn compressed(message: AnyMessage) -> anyhow::Result<AnyMessage> {
    let Some(image) = message.get::<RawImage>() else { return Ok(message) };
    let rgb = raw_to_rgb8(image)?;
    let mut jpeg = Vec::new();
    JpegEncoder::new_with_quality(&mut jpeg, JPEG_QUALITY)
        .encode(&rgb.data, image.width, image.height, ExtendedColorType::Rgb8)
        .context("cannot compress an image")?;
    Ok(AnyMessage::new(CompressedImage {
        timestamp: image.timestamp,
        frame_id: image.frame_id.clone(),
        data: jpeg.into(),
        format: "jpeg".to_owned(),
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recording_is_small_and_the_same_on_every_run() {
        let dir = tempfile::tempdir().unwrap();
        let (a, b) = (dir.path().join("a.mcap"), dir.path().join("b.mcap"));
        write(&a, 2.0, false).unwrap();
        write(&b, 2.0, false).unwrap();
        let bytes = std::fs::read(&a).unwrap();
        assert!(bytes.len() < 1_000_000, "{} bytes for 2 s", bytes.len());
        assert!(bytes == std::fs::read(&b).unwrap(), "the two recordings differ");
    }
}
