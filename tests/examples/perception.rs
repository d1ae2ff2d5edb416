//! Compares each part of sensory processing with the ground truth on every course: intersection over union of obstacle
//! and open cells within 8 m, over the first minute of a drive.
//!
//! `cargo run -p ocu-tests --example perception [-- COURSE ...]`

#![allow(clippy::print_stdout, clippy::unwrap_used, reason = "its output is what it is for")]
#![allow(unreachable_pub, reason = "shared with the tests")]

#[path = "../src/bundled.rs"]
mod bundled;

use bundled::{Repository, plan};
use rcs_geom::{DVec2, DVec3, Pose};
use rcs_metrics::Confusion;
use rcs_msg::foxglove::{Grid, Odometry};
use rcs_msg::{Payload, Stamp};
use rcs_runtime::{Assets, RunOptions, Stepped};
use rcs_scene::{Course, World};
use rcs_sense::pose_of;
use rcs_world::{GridView, MAX_COST, OBSTACLE_COST};

const COURSES: [&str; 7] =
    ["meadow", "mulch_path", "dead_end", "tall_grass", "hill", "corridor", "transition"];
const PARTS: [(&str, &str); 5] = [
    ("/obstacles/cost", "cost.stereo"),
    ("/color/cost", "cost.color"),
    ("/terrain/cost", "cost.terrain"),
    ("/classifier/cost", "cost.classifier"),
    ("/wm1/map", "cost"),
];

fn main() {
    let asked: Vec<String> = std::env::args().skip(1).collect();
    let courses: Vec<&str> =
        if asked.is_empty() { COURSES.to_vec() } else { asked.iter().map(String::as_str).collect() };
    println!("| course | part | obstacle IoU | ground IoU | cells |\n| --- | --- | --- | --- | --- |");
    for course in courses {
        let mut drive = Drive::start("learning", course, 0, &[]);
        let mut scores = [Confusion::default(); PARTS.len()];
        for second in 1..=60 {
            drive.until(f64::from(second));
            for ((buffer, field), score) in PARTS.iter().zip(&mut scores) {
                drive.score(buffer, field, 8.0, score);
            }
        }
        for ((_, field), score) in PARTS.iter().zip(&scores) {
            let [obstacle, ground] = [OBSTACLE, GROUND].map(|class| score.iou(class).unwrap_or(0.0));
            let part = field.strip_prefix("cost.").unwrap_or("fused (WM1)");
            println!("| {course} | {part} | {obstacle:.2} | {ground:.2} | {} |", score.total());
        }
    }
}

/// A drive in progress, and its world.
struct Drive {
    run: Stepped,
    world: World,
}

impl Drive {
    /// A drive at its start.
    fn start(stack: &str, course: &str, seed: u64, params: &[(&str, &str)]) -> Drive {
        let course_text = Repository.read("course", course, "").unwrap().text;
        let world_name = Course::from_toml(&course_text).unwrap().world;
        let world = World::from_toml(&Repository.read("world", &world_name, "").unwrap().text).unwrap();
        let options = RunOptions { seed, ..RunOptions::default() };
        let mut run = Stepped::new(plan(stack, course, params), None, options).unwrap();
        run.begin().unwrap();
        Drive { run, world }
    }

    /// Continues until this many seconds after the start.
    fn until(&mut self, seconds: f64) {
        self.run.run_until(Stamp((seconds * 1e9).round() as u64)).unwrap();
    }

    /// The newest message of a buffer; `None` before the first.
    fn latest<T: Payload>(&self, buffer: &str) -> Option<T> {
        let buffer = self.run.bus().get(buffer).unwrap_or_else(|| panic!("there is no buffer {buffer}"));
        buffer.latest()?.message.to()
    }

    /// True pose of the vehicle in the frame `global`.
    fn global_from_vehicle(&self) -> Option<Pose> {
        let odometry: Odometry = self.latest("/vehicle/ground_truth_pose")?;
        pose_of(odometry.pose.as_ref(), "global").ok()
    }

    /// True pose of the frame of the local estimate, from the true and the estimated pose of the vehicle.
    fn global_from_local(&self) -> Option<Pose> {
        let local: Odometry = self.latest("/localization/local")?;
        let local_from_vehicle = pose_of(local.pose.as_ref(), "local").ok()?;
        Some(self.global_from_vehicle()? * local_from_vehicle.inverse())
    }

    /// Compares the newest cost map in a buffer with the true world, up to `reach_m` from the vehicle.
    fn score(&self, buffer: &str, field: &str, reach_m: f64, score: &mut Confusion<2>) {
        let (Some(grid), Some(global_from_local), Some(vehicle)) =
            (self.latest::<Grid>(buffer), self.global_from_local(), self.global_from_vehicle())
        else {
            return;
        };
        let view = GridView::new(&grid).unwrap();
        let costs = view.field(field).unwrap();
        let cell = view.cell_size_m();
        for row in 0..view.rows() {
            for column in 0..view.columns() {
                let cost = costs.get(column, row).unwrap_or(255.0);
                if cost > f64::from(MAX_COST) {
                    continue;
                }
                let at = (DVec2::new(column as f64, row as f64) + 0.5) * cell;
                let local = view.frame_from_grid() * DVec3::new(at.x, at.y, 0.0);
                let at = (global_from_local * local).truncate();
                if (at - vehicle.translation.truncate()).length() <= reach_m {
                    count(score, cost >= f64::from(OBSTACLE_COST), &self.world, at);
                }
            }
        }
    }
}

/// Classes of cells.
const GROUND: usize = 0;
const OBSTACLE: usize = 1;

/// Distance between the middles of diagonally adjacent cells, m.
const BORDER_M: f64 = 0.29;

/// Compares a cell that has a cost with the ground truth, with a tolerance of one cell (0.2 m, and its diagonal): an
/// obstacle is correct if something within the tolerance blocks, and an open cell is correct if nothing blocks its own
/// middle.
fn count(score: &mut Confusion<2>, sensed: bool, world: &World, at: DVec2) {
    let blocked = world.blocked(at, if sensed { BORDER_M } else { 0.0 });
    score.add(usize::from(blocked), Some(usize::from(sensed)));
}
