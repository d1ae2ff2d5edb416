//! One cycle of a process: read, write some 64 bytes, post status. Ours through dynamic dispatch, wired when the stack
//! file is read; Copper's wired when it is compiled. Copper runs whole graphs, so the comparison is a graph of three;
//! `one` is a single process of ours.

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

    // Logs grow by a gigabyte within seconds at these rates, so what is logged is measured for a short while.
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
