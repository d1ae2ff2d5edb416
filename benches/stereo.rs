//! Both stereo methods on a synthetic pair of 640×480 with 64 disparities, one thread. For OpenCV see `stereo_peer.py`.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use rcs_stereo::{Matcher, Method, Settings};

const SIZE: [usize; 2] = [640, 480];

/// Smoothed noise of grey levels, a function of the position alone.
fn texture(x: usize, y: usize) -> u8 {
    let level = |x: usize| {
        let mut h = (x as u32).wrapping_mul(0x9e37_79b1) ^ (y as u32 / 2).wrapping_mul(0x85eb_ca77);
        h = (h ^ (h >> 15)).wrapping_mul(0x2c1b_3c6d);
        h >> 24
    };
    ((level(x) + level(x + 1)) / 2) as u8
}

/// Ground whose range decreases from row to row.
fn shift(y: usize) -> usize {
    4 + y * 50 / SIZE[1]
}

fn stereo(criterion: &mut Criterion) {
    let pixels = || (0..SIZE[0] * SIZE[1]).map(|i| (i % SIZE[0], i / SIZE[0]));
    let left: Vec<u8> = pixels().map(|(x, y)| texture(x, y)).collect();
    let right: Vec<u8> = pixels().map(|(x, y)| texture(x + shift(y), y)).collect();
    for (name, method) in [("bm", Method::Block), ("sgm", Method::SemiGlobal)] {
        let mut matcher = Matcher::new(SIZE, Settings::new(method, 64)).expect("sound settings");
        let mut disparity = Vec::new();
        let mut group = criterion.benchmark_group(format!("stereo/{name}"));
        group.throughput(Throughput::Elements((SIZE[0] * SIZE[1]) as u64));
        group.bench_function("640x480", |bench| {
            bench.iter(|| matcher.compute(&left, &right, &mut disparity));
        });
        group.finish();
    }
}

criterion_group!(benches, stereo);
criterion_main!(benches);
