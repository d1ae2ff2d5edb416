//! One cycle of a process: read, write about 64 bytes, post the status. Ours runs through dynamic dispatch and is wired
//! when the stack file is read; Copper's is wired at compile time. Copper runs complete graphs, so the comparison is a
//! graph of three; `one` is a single process of ours.

mod copper;
mod graph;

use std::time::Duration;

use criterion::{Criterion, criterion_group, criterion_main};

fn cycle(criterion: &mut Criterion) {
    let logs = tempfile::tempdir().expect("a folder for logs");
    let path = |name: &str| logs.path().join(name);

    let mut group = criterion.benchmark_group("runtime/cycle");
    group.bench_function("unlogged/one/ocu", |bench| bench.iter(graph::start(graph::ONE, None, 1)));
    group.bench_function("unlogged/three/ocu", |bench| bench.iter(graph::start(graph::THREE, None, 3)));
    group.bench_function("unlogged/three/cu29", |bench| {
        let mut cycle = copper::unlogged::start(&path("unlogged.copper")).expect("a graph that starts");
        bench.iter(|| cycle().expect("a cycle"));
    });

    // At these rates a log grows by a gigabyte within seconds, so logged cycles are measured for a short time.
    group.warm_up_time(Duration::from_millis(300)).measurement_time(Duration::from_secs(2)).sample_size(20);
    group.bench_function("logged/one/ocu", |bench| {
        bench.iter(graph::start(graph::ONE, Some(&path("one.mcap")), 1));
    });
    group.bench_function("logged/three/ocu", |bench| {
        bench.iter(graph::start(graph::THREE, Some(&path("three.mcap")), 3));
    });
    group.bench_function("logged/three/cu29", |bench| {
        let mut cycle = copper::logged::start(&path("logged.copper")).expect("a graph that starts");
        bench.iter(|| cycle().expect("a cycle"));
    });
    group.finish();
}

criterion_group!(benches, cycle);
criterion_main!(benches);
