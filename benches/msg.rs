//! Messages: reading one field of many messages, by scanning the wire format and by decoding everything.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use rcs_msg::{AnyMessage, FieldPath, FieldScanner, foxglove, registry};

/// The bar is a million messages per second; a tenth of that is enough to measure.
const MESSAGES: u64 = 100_000;

fn one_field(criterion: &mut Criterion) {
    let schema = registry().schema("foxglove.PoseInFrame").expect("the registry has the schema");
    let path: FieldPath = ".pose.position.x".parse().expect("the path is well formed");
    let message = |x: u64| {
        let position = foxglove::Vector3 { x: x as f64, y: 2.0, z: 3.0 };
        let orientation = foxglove::Quaternion { x: 0.0, y: 0.0, z: 0.6, w: 0.8 };
        let pose = foxglove::Pose { position: Some(position), orientation: Some(orientation) };
        let frame_id = "map".to_owned();
        AnyMessage::new(foxglove::PoseInFrame { frame_id, pose: Some(pose), timestamp: None }).bytes()
    };
    let messages: Vec<_> = (0..MESSAGES).map(message).collect();

    let mut group = criterion.benchmark_group("msg/one_field/100k");
    group.throughput(Throughput::Elements(MESSAGES)).sample_size(20);
    group.bench_function("scanner", |bench| {
        let scanner = FieldScanner::new(schema, &path).expect("the schema has the field");
        bench.iter(|| {
            messages
                .iter()
                .filter_map(|message| scanner.scan(message).expect("a message that decodes"))
                .sum::<f64>()
        });
    });
    group.bench_function("typed", |bench| {
        let x = |bytes: &bytes::Bytes| {
            let message =
                AnyMessage::decode::<foxglove::PoseInFrame>(bytes.clone()).expect("a message that decodes");
            message.get::<foxglove::PoseInFrame>()?.pose.as_ref()?.position.map(|position| position.x)
        };
        bench.iter(|| messages.iter().filter_map(x).sum::<f64>());
    });
    group.bench_function("tree", |bench| {
        let x = |bytes: &bytes::Bytes| schema.value(bytes).ok()?.get(&path).ok()?.as_f64();
        bench.iter(|| messages.iter().filter_map(x).sum::<f64>());
    });
    group.finish();
}

/// Paths to fields at the start and at the end of a message with two covariances of 36 numbers, and to the length of
/// one.
fn fields_of_odometry(criterion: &mut Criterion) {
    let schema = registry().schema("foxglove.Odometry").expect("the registry has the schema");
    let message = |x: u64| {
        let position = foxglove::Vector3 { x: x as f64, y: 2.0, z: 3.0 };
        let orientation = foxglove::Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 };
        AnyMessage::new(foxglove::Odometry {
            frame_id: "local".to_owned(),
            body_frame_id: "vehicle".to_owned(),
            pose: Some(foxglove::Pose { position: Some(position), orientation: Some(orientation) }),
            pose_covariance: vec![0.1; 36],
            velocity_covariance: vec![0.1; 36],
            ..foxglove::Odometry::default()
        })
        .bytes()
    };
    let messages: Vec<_> = (0..MESSAGES).map(message).collect();

    let mut group = criterion.benchmark_group("msg/fields_of_odometry/100k");
    group.throughput(Throughput::Elements(MESSAGES)).sample_size(20);
    for path in [".pose.position.x", ".velocity_covariance[35]", ".pose_covariance.@length"] {
        let scanner = FieldScanner::new(schema, &path.parse().expect("the path is well formed"))
            .expect("the schema has the field");
        group.bench_function(path, |bench| {
            bench.iter(|| {
                messages
                    .iter()
                    .filter_map(|message| scanner.scan(message).expect("a message that decodes"))
                    .sum::<f64>()
            });
        });
    }
    group.finish();
}

criterion_group!(benches, one_field, fields_of_odometry);
criterion_main!(benches);
