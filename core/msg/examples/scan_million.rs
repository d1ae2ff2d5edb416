//! Time to pull one field out of a million messages:
//! `cargo run --release -p rcs-msg --example scan_million`.
#![expect(clippy::print_stdout, reason = "it reports on the terminal")]

use prost::Message;
use rcs_msg::{FieldScanner, foxglove, registry};
use std::sync::Arc;
use std::time::Instant;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let odometry = |i: usize| foxglove::Odometry {
        timestamp: Some(rcs_msg::Stamp(i as u64 * 10_000_000).to_proto()),
        frame_id: "local".to_owned(),
        body_frame_id: "vehicle".to_owned(),
        pose: Some(foxglove::Pose {
            position: Some(foxglove::Vector3 { x: i as f64, y: 2.0, z: 3.0 }),
            orientation: Some(foxglove::Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 }),
        }),
        pose_covariance: vec![0.1; 36],
        velocity_covariance: vec![0.1; 36],
        ..foxglove::Odometry::default()
    };
    let messages: Vec<Vec<u8>> = (0..1_000_000).map(|i| odometry(i).encode_to_vec()).collect();
    let schema = registry().schema("foxglove.Odometry").ok_or("foxglove.Odometry is in the registry")?;
    for path in [".pose.position.x", ".velocity_covariance[35]", ".pose_covariance.@length"] {
        let scanner = FieldScanner::new(&Arc::clone(schema), &path.parse()?)?;
        let start = Instant::now();
        let mut sum = 0.0;
        for message in &messages {
            sum += scanner.scan(message)?.unwrap_or(0.0);
        }
        println!("{path}: {:.1} ms, sum {sum}", start.elapsed().as_secs_f64() * 1e3);
    }
    Ok(())
}
