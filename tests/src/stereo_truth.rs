//! Compares stereo and the obstacle detection with the ground truth of the simulation: things on the meadow, labels of
//! pixels, and a ditch that the vehicle drives towards. The parameters are those of the stack `simulation`.

use crate::bundled::Repository;
use rcs_geom::{DVec2, DVec3, PinholeCamera, Pose};
use rcs_metrics::Confusion;
use rcs_msg::foxglove::{CameraCalibration, FrameTransforms, Grid, Odometry, RawImage};
use rcs_msg::rcs::{GroundTruthObject, GroundTruthObjects};
use rcs_msg::{Payload, Stamp};
use rcs_runtime::{Assets, Plan, PlanOptions, RunOptions, StackFile, Stepped};
use rcs_sense::{Localizer, pose_of};
use rcs_world::{GridView, MAX_COST, OBSTACLE_COST};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// Position of the near edge of the ditch of `tests/assets/worlds/ditch.toml`, m; the vehicle drives along y = 30.
const DITCH_EDGE_M: f64 = 19.8;

/// The driver that knows the ground truth, with the cameras, stereo and obstacles of the stack `simulation`.
fn begin(course: &str) -> Stepped {
    let mut stack = Repository.read("stack", "truth_driver", "").unwrap().text;
    stack.push_str("\n[[process]]\nname = \"perception\"\nplugin = \"supervisor\"\nsupervisor = \"robot\"\n");
    stack.push_str("as = \"auxiliary\"\n");
    for side in ["left", "right"] {
        // The costs of each pair go to separate buffers.
        let with = format!("side = \"{side}\", cost = \"/obstacles_{side}/cost\"");
        let include = format!("\n[[include]]\npart = \"stereo_pair\"\nwith = {{ {with} }}\n");
        stack.push_str(&include);
    }
    let file =
        StackFile::compose("stereo_truth", &stack, &Repository).unwrap_or_else(|error| panic!("{error}"));
    let options = PlanOptions { overrides: &[], course: Some(course), assets: &Repository };
    let plan = Plan::with(file, rcs_plugins::all(), &options).unwrap_or_else(|error| panic!("{error}"));
    let mut run = Stepped::new(Arc::new(plan), None, RunOptions::default()).unwrap();
    run.begin().unwrap();
    run
}

fn latest<T: Payload>(run: &Stepped, buffer: &str) -> Option<T> {
    run.bus().get(buffer).unwrap_or_else(|| panic!("no buffer {buffer}")).latest()?.message.to()
}

/// One frame of one camera: the result, and the ground truth.
struct Frame {
    labels: RawImage,
    true_labels: RawImage,
    true_depth: Vec<f32>,
    /// The rectified camera, the raw one, and its pose.
    camera: PinholeCamera,
    raw: PinholeCamera,
    optical_from_global: Pose,
    /// Position of the vehicle, and the middles of obstacle cells by cell, in the frame `global`, m.
    vehicle: DVec2,
    cells: BTreeMap<(usize, usize), DVec2>,
}

const CYCLE_MS: u64 = 50;

/// Runs a course for some seconds and calls `visit` with each frame of both cameras.
fn watch(course: &str, seconds: u64, mut see: impl FnMut(&Frame, &[GroundTruthObject])) {
    let mut run = begin(course);
    let mut mounts = Localizer::default();
    let mut poses: BTreeMap<Stamp, Pose> = BTreeMap::new();
    let mut newest = [0; 2];
    for step in 1..=seconds * 1000 / CYCLE_MS {
        run.run_until(Stamp(step * CYCLE_MS * 1_000_000)).unwrap();
        let Some(odometry) = latest::<Odometry>(&run, "/vehicle/ground_truth_pose") else { continue };
        let global_from_vehicle = pose_of(odometry.pose.as_ref(), "global").unwrap();
        poses.insert(Stamp(step * CYCLE_MS * 1_000_000), global_from_vehicle);
        let Some(local) = latest::<Odometry>(&run, "/localization/local") else { continue };
        let local_from_vehicle = pose_of(local.pose.as_ref(), "local").unwrap();
        let global_from_local = global_from_vehicle * local_from_vehicle.inverse();
        if let Some(transforms) = latest::<FrameTransforms>(&run, "/vehicle/static_transforms") {
            mounts.add_static_transforms(&transforms).unwrap();
        }
        let Some(things) = latest::<GroundTruthObjects>(&run, "/vehicle/ground_truth_objects") else {
            continue;
        };
        for (camera, newest) in ["left", "right"].into_iter().zip(&mut newest) {
            let cost = run.bus().get(&format!("/obstacles_{camera}/cost")).unwrap();
            if cost.newest() == *newest {
                continue;
            }
            *newest = cost.newest();
            let taken = cost.latest().unwrap().header.acq_time;
            let Some(&then) = poses.range(..=taken).next_back().map(|(_, pose)| pose) else { continue };
            if let Some(frame) = frame(&run, camera, &mounts, taken, &then, &global_from_local) {
                see(&frame, &things.things);
            }
        }
    }
}

fn frame(
    run: &Stepped,
    side: &str,
    mounts: &Localizer,
    taken: Stamp,
    global_from_vehicle: &Pose,
    global_from_local: &Pose,
) -> Option<Frame> {
    let calibration: CameraCalibration = latest(run, &format!("/stereo_{side}/calibration"))?;
    let raw: CameraCalibration = latest(run, &format!("/front_{side}/left_calibration"))?;
    let camera = |c: &CameraCalibration| {
        PinholeCamera::from_calibration([c.width, c.height], &c.k, &c.distortion_model, &c.d).unwrap()
    };
    let vehicle_from_optical = mounts.lookup("vehicle", &calibration.frame_id, taken, f64::INFINITY).unwrap();
    let true_depth: RawImage = latest(run, &format!("/front_{side}/ground_truth_depth"))?;
    let cost: Grid = latest(run, &format!("/obstacles_{side}/cost"))?;
    let view = GridView::new(&cost).unwrap();
    let costs = view.field("cost.stereo").unwrap();
    let places = (0..view.rows()).flat_map(|row| (0..view.columns()).map(move |column| (column, row)));
    let obstacles = places.filter(|&(column, row)| {
        let is_obstacle = f64::from(OBSTACLE_COST)..=f64::from(MAX_COST);
        costs.get(column, row).is_some_and(|cost| is_obstacle.contains(&cost))
    });
    let middle = |column: usize, row: usize| {
        let at = (DVec2::new(column as f64, row as f64) + 0.5) * view.cell_size_m();
        (*global_from_local * (view.frame_from_grid() * at.extend(0.0))).truncate()
    };
    let frame = Frame {
        labels: latest(run, &format!("/obstacles_{side}/labels"))?,
        true_labels: latest(run, &format!("/front_{side}/ground_truth_labels"))?,
        true_depth: rcs_msg::image::depth_m(&true_depth, 1.0).unwrap(),
        camera: camera(&calibration),
        raw: camera(&raw),
        optical_from_global: (*global_from_vehicle * vehicle_from_optical).inverse(),
        vehicle: global_from_vehicle.translation.truncate(),
        cells: obstacles.map(|(column, row)| ((column, row), middle(column, row))).collect(),
    };
    // Ground truth of another frame must not be compared.
    (frame.labels.timestamp == frame.true_labels.timestamp).then_some(frame)
}

fn place(thing: &GroundTruthObject) -> DVec3 {
    let p = thing.position.unwrap();
    DVec3::new(p.x, p.y, p.z)
}

/// Columns at the left that the right camera does not see; and a margin of 4 pixels at every edge.
const BLIND_PX: f64 = 48.0;
const EDGE_PX: f64 = 4.0;

impl Frame {
    /// Whether both cameras see a thing unoccluded at its foot, its middle and near its top (or the clearance).
    fn shows(&self, thing: &GroundTruthObject) -> bool {
        let height_m = thing.height_m.min(1.2);
        [0.1, 0.5, 0.8].into_iter().all(|share| {
            let p = self.optical_from_global * (place(thing) + DVec3::Z * height_m * share);
            let in_both = self.camera.project(p).is_some_and(|pixel| {
                pixel.x >= BLIND_PX + EDGE_PX
                    && pixel.y >= EDGE_PX
                    && pixel.x < f64::from(self.camera.width) - EDGE_PX
                    && pixel.y < f64::from(self.camera.height) - EDGE_PX
            });
            let unhidden = self.raw.project(p).map(DVec2::round).filter(|&pixel| self.raw.contains(pixel));
            in_both
                && unhidden.is_some_and(|pixel| {
                    let depth =
                        self.true_depth[pixel.y as usize * self.raw.width as usize + pixel.x as usize];
                    (f64::from(depth) - p.z).abs() < thing.radius_m + 0.25
                })
        })
    }

    /// Connected groups of obstacle cells that begin within 8 m.
    fn patches(&self) -> Vec<Vec<DVec2>> {
        let mut left: BTreeSet<(usize, usize)> = self.cells.keys().copied().collect();
        let mut patches = Vec::new();
        while let Some(first) = left.pop_first() {
            let mut patch = vec![first];
            let mut next = 0;
            while let Some(&(column, row)) = patch.get(next) {
                next += 1;
                for (c, r) in (0..3).flat_map(|dr| (0..3).map(move |dc| (column + dc, row + dr))) {
                    // Indices are offset by one, so that none is negative.
                    let neighbour = (c.wrapping_sub(1), r.wrapping_sub(1));
                    if left.remove(&neighbour) {
                        patch.push(neighbour);
                    }
                }
            }
            let patch: Vec<DVec2> = patch.into_iter().map(|cell| self.cells[&cell]).collect();
            if patch.iter().any(|&at| at.distance(self.vehicle) <= 8.0) {
                patches.push(patch);
            }
        }
        patches
    }
}

/// Labels of obstacle images: 0 is none, above 4 is too far or invalid.
const LABELS: std::ops::RangeInclusive<u8> = 1..=4;

/// Counts the pixels within 8 m that have a label and a true label.
fn count_labels(frame: &Frame, confusion: &mut Confusion<5>) {
    let (width, height) = (frame.camera.width as usize, frame.camera.height as usize);
    for (i, &label) in frame.labels.data.iter().enumerate().take(width * height) {
        let ray = frame.camera.unproject(DVec2::new((i % width) as f64, (i / width) as f64));
        let pixel = ray.and_then(|ray| frame.raw.project(ray)).map(DVec2::round);
        let Some(pixel) = pixel.filter(|&pixel| frame.raw.contains(pixel)) else { continue };
        let at = pixel.y as usize * frame.raw.width as usize + pixel.x as usize;
        let truth = frame.true_labels.data[at].min(*LABELS.end());
        if frame.true_depth[at] < 8.0 && LABELS.contains(&truth) && LABELS.contains(&label) {
            confusion.add(usize::from(truth), Some(usize::from(label)));
        }
    }
}

#[test]
fn things_in_the_meadow_are_found_and_little_else_is() {
    // By band (15 cm within 4 m, 30 cm within 8 m) and thing: number of frames that show it, and that find it. A thing
    // is found if at least half of the frames that show it find it.
    let mut seen: BTreeMap<(usize, u32), [u32; 2]> = BTreeMap::new();
    let (mut patches, mut right) = (0, 0);
    let mut confusion = Confusion::<5>::default();
    watch("meadow", 60, |frame, things| {
        count_labels(frame, &mut confusion);
        for thing in things.iter().filter(|thing| thing.kind != "ditch") {
            let at = place(thing).truncate();
            let distance_m = at.distance(frame.vehicle) - thing.radius_m;
            for (band, (height_m, reach_m)) in [(0.15, 4.0), (0.30, 8.0)].into_iter().enumerate() {
                if thing.height_m >= height_m && distance_m <= reach_m && frame.shows(thing) {
                    let counts = seen.entry((band, thing.number)).or_default();
                    let near = |cell: &DVec2| cell.distance(at) < thing.radius_m + 0.3;
                    counts[0] += 1;
                    counts[1] += u32::from(frame.cells.values().any(near));
                }
            }
        }
        for patch in frame.patches() {
            let belongs = |thing: &GroundTruthObject| {
                patch.iter().any(|cell| cell.distance(place(thing).truncate()) < thing.radius_m + 0.4)
            };
            patches += 1;
            right += u32::from(things.iter().any(belongs));
        }
    });
    let precision = f64::from(right) / f64::from(patches);
    let mut total = [0; 2];
    for (band, what) in ["15 cm within 4 m", "30 cm within 8 m"].into_iter().enumerate() {
        let of_band = || seen.iter().filter(|((b, _), _)| *b == band).map(|(_, counts)| counts);
        let [shown, found] = of_band().fold([0; 2], |sum, counts| [sum[0] + counts[0], sum[1] + counts[1]]);
        let things = of_band().count();
        let found_things = of_band().filter(|[shown, found]| 2 * found >= *shown).count();
        println!("{what}: {found_things} of {things} things, in {found} of {shown} frames that show one");
        assert!(things > 0, "nothing is shown {what}");
        total = [total[0] + things, total[1] + found_things];
    }
    let recall = total[1] as f64 / total[0] as f64;
    println!("{right} of {patches} patches of obstacle cells within 8 m belong to a thing: {precision:.3}");
    let [ground, obstacle] = [1, 2].map(|label| confusion.iou(label).unwrap_or(0.0));
    println!("labels within 8 m: IoU ground {ground:.3}, obstacle {obstacle:.3}");
    println!("recall over both: {recall:.3}");
    assert!(recall >= 0.95 && precision >= 0.9, "recall {recall:.3}, precision {precision:.3}");
}

#[test]
fn a_ditch_is_reported_before_the_vehicle_is_two_metres_from_it() {
    let mut first_m: Option<f64> = None;
    let mut least_m = f64::INFINITY;
    watch("ditch", 12, |frame, _| {
        let to_edge_m = DITCH_EDGE_M - frame.vehicle.x;
        least_m = least_m.min(to_edge_m);
        let is_at_edge =
            |cell: &&DVec2| (cell.x - DITCH_EDGE_M).abs() < 0.3 && (cell.y - frame.vehicle.y).abs() < 1.0;
        if frame.cells.values().filter(is_at_edge).count() >= 2 {
            first_m = first_m.or(Some(to_edge_m));
        }
    });
    assert!(least_m < 2.0, "the vehicle has come near it: {least_m:.2} m");
    println!("reported at {first_m:.2?} m");
    assert!(first_m.is_some_and(|first_m| first_m > 2.0), "reported at {first_m:.2?} m");
}
