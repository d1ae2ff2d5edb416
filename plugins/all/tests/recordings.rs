//! The stacks in `assets/stacks` on the public datasets: they run, find what is in the scene, and repeat bit for bit.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use rcs_log::Log;
use rcs_msg::foxglove::{Grid, RawImage};
use rcs_msg::{Payload, rcs};
use rcs_plugins::all;
use rcs_runtime::{Plan, RunOptions, Snapshot, StackFile, Stepped};
use rcs_world::{GridView, NumericType};
use std::sync::Arc;

const RANGE_CAMERA: [&str; 2] =
    ["range_camera.toml", include_str!("../../../assets/stacks/range_camera.toml")];
const FOREST_ROBOT: [&str; 2] =
    ["forest_robot.toml", include_str!("../../../assets/stacks/forest_robot.toml")];
const HUSKY: [&str; 2] = ["husky.toml", include_str!("../../../assets/stacks/husky.toml")];

fn stack([name, text]: [&str; 2], params: &[(&str, &str)]) -> Arc<Plan> {
    let params: Vec<(String, String)> =
        params.iter().map(|(name, value)| ((*name).to_owned(), (*value).to_owned())).collect();
    Arc::new(Plan::new(StackFile::parse(name, text).unwrap(), all(), &params).unwrap())
}

/// Starts the stack on the log; `None` where the recordings are absent.
fn begin(plan: Arc<Plan>, log: &str, threads: usize, hash: bool) -> Option<Stepped> {
    let path = rcs_testkit::data_dir()?.join("real-logs").join(log);
    let log = Log::open(&path).unwrap();
    let options = RunOptions { threads, hash, ..RunOptions::default() };
    let mut run = Stepped::new(plan, Some(&log), options).unwrap();
    run.begin().unwrap();
    Some(run)
}

fn finish(run: &mut Stepped) {
    let until = run.horizon().unwrap();
    run.run_until(until).unwrap();
}

fn latest<T: Payload>(run: &Stepped, buffer: &str) -> T {
    let sample = run.bus().get(buffer).unwrap_or_else(|| panic!("no buffer {buffer}")).latest();
    let sample = sample.unwrap_or_else(|| panic!("nothing in {buffer}"));
    sample.message.to().unwrap()
}

fn assert_no_faults(run: &Stepped) {
    for process in &run.plan().processes {
        let status: rcs::Status = latest(run, &format!("/{}/status", process.name));
        assert_eq!(status.faults, 0, "{}: {}", process.name, status.last_fault);
    }
}

/// Share of each label within these columns and rows of a label image.
fn shares(image: &RawImage, columns: std::ops::Range<usize>, rows: std::ops::Range<usize>) -> [f64; 6] {
    let mut counts = [0_u32; 6];
    for row in rows {
        for column in columns.clone() {
            counts[usize::from(image.data[row * image.step as usize + column])] += 1;
        }
    }
    let all = f64::from(counts.iter().sum::<u32>());
    counts.map(|count| f64::from(count) / all)
}

/// Share of obstacle among the known cells of a square of the map, and the number of known cells. Metres, local frame.
fn obstacle_share(map: &Grid, x: [f64; 2], y: [f64; 2]) -> (f64, usize) {
    let view = GridView::new(map).unwrap();
    let labels = view.field_of("label", NumericType::Uint8).unwrap();
    let corner = view.frame_from_grid().translation;
    let (mut known, mut obstacle) = (0, 0);
    for row in 0..view.rows() {
        for column in 0..view.columns() {
            let place_x = corner.x + (column as f64 + 0.5) * view.cell_size_m().x;
            let place_y = corner.y + (row as f64 + 0.5) * view.cell_size_m().y;
            if (x[0]..x[1]).contains(&place_x) && (y[0]..y[1]).contains(&place_y) {
                match labels.get(column, row) {
                    Some(1.0) => known += 1,
                    Some(2.0) => {
                        known += 1;
                        obstacle += 1;
                    }
                    _ => {}
                }
            }
        }
    }
    (f64::from(obstacle) / f64::from(known), known as usize)
}

#[test]
fn on_a_road_the_road_is_ground_and_trees_and_crops_are_obstacles() {
    let Some(mut run) = begin(stack(RANGE_CAMERA, &[]), "orfd_y0613_1242_ros2.mcap", 1, false) else {
        return;
    };
    finish(&mut run);
    assert_no_faults(&run);
    let labels: RawImage = latest(&run, "/obstacles/labels");
    assert_eq!((labels.width, labels.height), (1280, 720));
    let (ground, obstacle, cover) = (1, 2, 4);
    // The road, from the bottom of the image to the end of the ranges; crops on the left; the wood, trunks and crowns
    // on the right.
    assert!(shares(&labels, 300..560, 330..700)[ground] > 0.995);
    assert!(shares(&labels, 20..160, 250..330)[obstacle] > 0.9);
    assert!(shares(&labels, 800..1200, 200..260)[obstacle] > 0.85);
    assert!(shares(&labels, 700..1200, 130..150)[cover] > 0.85);
    let stats: rcs_obstacles::proto::ObstacleStats = latest(&run, "/obstacles/stats");
    assert!((480_000..540_000).contains(&stats.ground), "{stats:?}");
    assert!((95_000..120_000).contains(&stats.obstacle), "{stats:?}");

    // By colour: the road up to its end, then sky, wood and crops. (Pixels of the 128x96 image.)
    let costs: RawImage = latest(&run, "/color/probability");
    let cheap = |columns: std::ops::Range<usize>, rows: std::ops::Range<usize>| {
        let all = columns.len() * rows.len();
        let costs = rows.flat_map(|row| &costs.data[row * 128..][columns.clone()]);
        costs.filter(|&&cost| cost < 125).count() as f64 / all as f64
    };
    assert!(cheap(34..54, 46..92) > 0.99, "{}", cheap(34..54, 46..92));
    assert!(cheap(80..124, 4..40) < 0.02 && cheap(2..14, 30..44) < 0.05 && cheap(40..48, 2..24) < 0.02);

    let map: Grid = latest(&run, "/wm1/map");
    assert!(obstacle_share(&map, [6.0, 25.0], [0.2, 2.2]).0 < 0.01, "the road is free");
    let (wood, cells) = obstacle_share(&map, [18.4, 20.0], [-8.5, -5.5]);
    assert!(wood > 0.8 && cells > 80, "{wood} of {cells}: the wood is not");
    let world: rcs_world_model::proto::WorldModelStats = latest(&run, "/wm1/stats");
    assert!(world.known > 4000 && world.obstacle > 700, "{world:?}");
}

#[test]
fn in_a_forest_the_map_has_trunks_where_the_scan_has_them_and_follows_the_robot() {
    // Fewer maps, because only the last one is examined.
    let plan = stack(FOREST_ROBOT, &[("wm1.publish_hz", "0.5")]);
    let Some(mut run) = begin(plan, "monoforce_tradr_ros2.mcap", 1, false) else { return };
    finish(&mut run);
    assert_no_faults(&run);
    let stats: rcs_obstacles::proto::ObstacleStats = latest(&run, "/obstacles/stats");
    let points =
        stats.invalid + stats.ground + stats.obstacle + stats.short_obstacle + stats.cover + stats.too_far;
    assert_eq!(points, 131_072);
    assert!(stats.ground > 30_000 && stats.obstacle > 15_000 && stats.cover > 15_000, "{stats:?}");

    let map: Grid = latest(&run, "/wm1/map");
    // A single trunk stands 7.4 m away, behind and to the right of the robot; two stand 5.4 m to its left, seen by its
    // left camera; the ground beside the robot is free.
    let (trunk, cells) = obstacle_share(&map, [5.2, 5.8], [-4.8, -4.0]);
    assert!(trunk > 0.9 && cells >= 8, "{trunk} of {cells}");
    let (trunks, cells) = obstacle_share(&map, [-4.8, -3.8], [2.2, 3.2]);
    assert!(trunks > 0.8 && cells >= 15, "{trunks} of {cells}");
    let (ground, cells) = obstacle_share(&map, [-1.5, 0.5], [1.2, 2.2]);
    assert!(ground < 0.05 && cells >= 40, "{ground} of {cells}");
    // The map has followed the last pose, which comes from the lidar.
    let corner = GridView::new(&map).unwrap().frame_from_grid().translation;
    assert!((corner.x + 20.1 - 1.9).abs() < 0.5 && (corner.y + 20.1 - 4.6).abs() < 0.7, "{corner}");

    for camera in ["front", "left", "rear"] {
        let labels: RawImage = latest(&run, &format!("/overlay_{camera}/labels"));
        assert_eq!((labels.width, labels.height), (1920, 1200));
        let painted = labels.data.iter().filter(|&&label| label != 0).count();
        assert!(painted > 100_000, "{camera}: {painted}");
    }
}

#[test]
fn a_log_without_range_data_runs_without_processes() {
    let Some(mut run) = begin(stack(HUSKY, &[]), "husky_outdoor_ros2.mcap", 1, false) else { return };
    finish(&mut run);
    let messages: u64 = run
        .summary()
        .buffers
        .iter()
        .filter(|buffer| ["/imu", "/odometry", "/gps"].contains(&buffer.name.as_str()))
        .map(|buffer| buffer.messages)
        .sum();
    assert_eq!(messages, 16_806);
}

#[test]
fn a_run_gives_the_same_bytes_again_with_two_threads_and_from_a_snapshot() {
    // The scan of the second log arrives after 23.6 s.
    for (file, log, until_s, snapshot_at_s) in [
        (RANGE_CAMERA, "orfd_y0613_1242_ros2.mcap", 0.95, 0.4),
        (FOREST_ROBOT, "monoforce_tradr_ros2.mcap", 25.0, 23.7),
    ] {
        let at = |run: &Stepped, seconds: f64| run.start().after_ns((seconds * 1e9) as u64);
        let Some(mut run) = begin(stack(file, &[]), log, 1, true) else { return };
        run.run_until(at(&run, until_s)).unwrap();
        let expected = run.summary().hash;
        assert!(expected.is_some());

        let Some(mut threaded) = begin(stack(file, &[]), log, 2, true) else { return };
        threaded.run_until(at(&threaded, snapshot_at_s)).unwrap();
        let bytes = threaded.snapshot().to_bytes().unwrap();
        threaded.run_until(at(&threaded, until_s)).unwrap();
        assert_eq!(threaded.summary().hash, expected, "{}: two threads", file[0]);

        threaded.restore(&Snapshot::from_bytes(&bytes).unwrap()).unwrap();
        threaded.run_until(at(&threaded, until_s)).unwrap();
        assert_eq!(threaded.summary().hash, expected, "{}: from a snapshot", file[0]);
    }
}
