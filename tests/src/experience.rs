//! What experience teaches the fused map WM1 (Albus 2006a, 3.2; Albus 2006b, 3.4): tall grass that was driven through is
//! free ahead, bushes that stopped the vehicle stay obstacles, a fence that is known beforehand is one before any
//! experience, and nothing of it is lost with the map.

use crate::bundled;
use rcs_geom::{DVec2, DVec3, Pose};
use rcs_msg::foxglove::{Grid, Odometry, PoseInFrame};
use rcs_msg::rcs::{Command, DriveCommand, VehicleStatus};
use rcs_msg::{AnyMessage, Payload, Stamp};
use rcs_runtime::source::Task;
use rcs_runtime::{ExternalEvent, RunOptions, Session, Stepped};
use rcs_scene::Class;
use rcs_sense::pose_of;
use rcs_world::{GridView, MAX_COST, OBSTACLE_COST};

/// A vehicle with all senses and learning that is driven by hand.
struct Drive {
    session: Session,
    /// Tenths of a second.
    now: u64,
}

/// A cell of WM1.
struct Cell {
    /// Its middle in the frame of the vehicle, m.
    at: DVec2,
    /// What is there in truth, and whether it blocks a vehicle there or within 0.6 m.
    class: u8,
    blocked: bool,
    near_blocked: bool,
    /// The fused cost, and that of the colours where a known obstacle backs it; `None` where unknown.
    cost: Option<f64>,
    known_obstacle: Option<f64>,
}

impl Drive {
    fn new(course: &str) -> Drive {
        let plan = bundled::plan("learning", course, &[]);
        let run = Stepped::new(plan, None, RunOptions { seed: 3, ..RunOptions::default() }).unwrap();
        Drive { session: Session::new(run).unwrap(), now: 0 }
    }

    fn latest<T: Payload>(&self, buffer: &str) -> T {
        self.session.run().bus().get(buffer).unwrap().latest().unwrap().message.to().unwrap()
    }

    /// Drives straight on by hand, until this says that it is enough.
    fn straight(&mut self, speed_mps: f64, most_s: u64, is_enough: impl Fn(&Drive) -> bool) {
        for _ in 0..10 * most_s {
            let timestamp = Some(self.session.run().now().to_proto());
            let command = DriveCommand { timestamp, speed_mps, yaw_rate_radps: Some(0.0), heading_rad: 0.0 };
            let event = ExternalEvent::operator("/operator/teleop", AnyMessage::new(command));
            self.session.write(event).unwrap();
            self.now += 1;
            self.session.forward_until(Stamp(self.now * 100_000_000), &Task::default()).unwrap();
            if is_enough(self) {
                return;
            }
        }
    }

    fn true_pose(&self) -> Pose {
        let truth: Odometry = self.latest("/vehicle/ground_truth_pose");
        pose_of(truth.pose.as_ref(), "").unwrap()
    }

    /// The cells of WM1 up to a distance ahead and 4 m to each side of a vehicle that stands.
    fn cells_ahead(&self, ahead_m: f64) -> Vec<Cell> {
        let vehicle: PoseInFrame = self.latest("/wm1/vehicle");
        let vehicle_from_local = pose_of(vehicle.pose.as_ref(), "").unwrap().inverse();
        let true_pose = self.true_pose();
        let (truth, map): (Grid, Grid) = (self.latest("/vehicle/ground_truth_map"), self.latest("/wm1/map"));
        let (truth, map) = (GridView::new(&truth).unwrap(), GridView::new(&map).unwrap());
        let true_at = |name: &str, at: DVec2| {
            let global = (true_pose * at.extend(0.0)).truncate();
            let cell = (global - truth.frame_from_grid().translation.truncate()) / truth.cell_size_m();
            truth.field(name).unwrap().get(cell.x as usize, cell.y as usize).unwrap()
        };
        let known = |name: &str, [column, row]: [usize; 2]| {
            let cost = map.field(name).ok()?.get(column, row)?;
            (cost <= f64::from(MAX_COST)).then_some(cost)
        };
        let mut cells = Vec::new();
        for (row, column) in
            (0..map.rows()).flat_map(|row| (0..map.columns()).map(move |column| (row, column)))
        {
            let middle = DVec2::new(column as f64 + 0.5, row as f64 + 0.5) * map.cell_size_m();
            let local = map.frame_from_grid() * DVec3::new(middle.x, middle.y, 0.0);
            let at = (vehicle_from_local * local).truncate();
            if !(1.0..ahead_m).contains(&at.x) || at.y.abs() > 4.0 {
                continue;
            }
            let around = [
                [0.6, 0.0],
                [-0.6, 0.0],
                [0.0, 0.6],
                [0.0, -0.6],
                [0.4, 0.4],
                [0.4, -0.4],
                [-0.4, 0.4],
                [-0.4, -0.4],
            ];
            let blocked = true_at("blocked", at) > 0.0;
            let beside = |by: [f64; 2]| true_at("blocked", at + DVec2::from_array(by)) > 0.0;
            let backing = map.field("backing.color").ok().and_then(|field| field.get(column, row));
            let backed = backing.is_some_and(|backing| backing >= 127.0);
            cells.push(Cell {
                at,
                class: true_at("class", at) as u8,
                blocked,
                near_blocked: blocked || around.into_iter().any(beside),
                cost: known("cost", [column, row]),
                known_obstacle: known("cost.color", [column, row]).filter(|_| backed),
            });
        }
        cells
    }
}

/// Number of costs, and the share of them of which this holds.
fn share(costs: impl Iterator<Item = f64>, holds: impl Fn(f64) -> bool) -> (usize, f64) {
    let costs: Vec<f64> = costs.collect();
    (costs.len(), costs.iter().filter(|&&cost| holds(cost)).count() as f64 / costs.len() as f64)
}

#[test]
fn grass_that_was_driven_through_is_free_ahead_and_bushes_that_stopped_the_vehicle_are_not() {
    let mut drive = Drive::new("bushes_in_grass");
    let grass = |drive: &Drive| {
        let cells = drive.cells_ahead(7.0);
        let free = cells.iter().filter(|cell| cell.class == Class::TallGrass.code() && !cell.near_blocked);
        share(free.filter_map(|cell| cell.cost), |cost| cost < 100.0)
    };
    // The grass begins at 26 m.
    drive.straight(1.0, 60, |drive| drive.true_pose().translation.x >= 23.0);
    drive.straight(0.0, 1, |_| false);
    let before = grass(&drive);
    drive.straight(1.0, 60, |drive| drive.true_pose().translation.x >= 37.0);
    drive.straight(0.0, 1, |_| false);
    let after = grass(&drive);
    assert!(before.0 > 300 && before.1 < 0.7, "range calls it an obstacle before: {before:?}");
    assert!(after.0 > 300 && after.1 >= 0.95, "after 10 m in it: {after:?}");
    // Into the bush, whose edge is at 45 m, and back again to see the others.
    let is_pressed = |drive: &Drive| {
        let vehicle: VehicleStatus = drive.latest("/vehicle_interface/vehicle");
        vehicle.bumper_left || vehicle.bumper_right
    };
    drive.straight(0.6, 60, is_pressed);
    assert!(is_pressed(&drive), "it has hit the bush: {:?}", drive.true_pose());
    drive.straight(-0.6, 4, |_| false);
    drive.straight(0.0, 2, |_| false);
    let bushes = near_sides(&drive.cells_ahead(8.0));
    let (count, are_blocked) = share(bushes.iter().copied(), |cost| cost >= f64::from(OBSTACLE_COST));
    let (_, are_dear) = share(bushes.iter().copied(), |cost| cost > 200.0);
    assert!(count > 60 && are_blocked >= 0.9 && are_dear >= 0.7, "{count} cells: {are_blocked}, {are_dear}");
    let (count, are_free) = grass(&drive);
    assert!(count > 300 && are_free >= 0.9, "{count} cells: {are_free}");
}

/// The costs of the cells of bushes on the side of the vehicle: up to 1 m from their borders, seen from it. What lies behind
/// is seen by nothing.
fn near_sides(cells: &[Cell]) -> Vec<f64> {
    let of_bushes: Vec<&Cell> =
        cells.iter().filter(|cell| cell.class == Class::Bush.code() && cell.blocked).collect();
    let is_near_side = |cell: &&&Cell| {
        let beside = of_bushes.iter().filter(|other| (other.at.y - cell.at.y).abs() < 0.1);
        beside.map(|other| other.at.x).fold(f64::INFINITY, f64::min) > cell.at.x - 1.0
    };
    of_bushes.iter().filter(is_near_side).filter_map(|cell| cell.cost).collect()
}

#[test]
fn a_fence_that_is_known_beforehand_is_in_the_map_3_m_ahead() {
    let mut drive = Drive::new("dead_end");
    // The fence is 58 m east of the origin of the world.
    drive.straight(1.3, 60, |drive| drive.true_pose().translation.x >= 54.7);
    drive.straight(0.0, 1, |_| false);
    let cells = drive.cells_ahead(5.0);
    let fence: Vec<&Cell> = cells.iter().filter(|cell| cell.class == Class::Fence.code()).collect();
    let (mut strips, mut known) = (0, 0);
    // The way of the vehicle and a metre beside it, in strips of two cells.
    for strip in -4..4 {
        let side = f64::from(strip) * 0.4..f64::from(strip + 1) * 0.4;
        let of_strip = |cell: &&&Cell| side.contains(&cell.at.y);
        let Some(x) = fence.iter().filter(of_strip).map(|cell| cell.at.x).reduce(f64::min) else { continue };
        let near: Vec<&Cell> =
            cells.iter().filter(|cell| side.contains(&cell.at.y) && (cell.at.x - x).abs() <= 0.5).collect();
        let blocks = |cell: &&Cell| cell.cost.is_some_and(|cost| cost >= f64::from(OBSTACLE_COST));
        assert!(near.iter().any(blocks), "{side:?}: the fence at {x} m is not in the map");
        strips += 1;
        known += usize::from(near.iter().any(|cell| cell.known_obstacle.is_some()));
    }
    assert!(strips >= 7 && 2 * known >= strips, "of {strips} strips colour knows the fence in {known}");
}

#[test]
fn what_terrain_has_learned_is_in_the_map_again_after_it_was_cleared() {
    let mut drive = Drive::new("mulch_path");
    drive.straight(1.0, 8, |_| false);
    let known = |drive: &Drive| {
        let map: Grid = drive.latest("/wm1/map");
        let view = GridView::new(&map).unwrap();
        view.field("conf.terrain")
            .map_or(0, |field| field.values().filter(|&confidence| confidence > 0.0).count())
    };
    let before = known(&drive);
    drive.straight(0.0, 2, |_| false);
    let command = Command { serial: 7, name: "CLEAR".to_owned(), ..Command::default() };
    drive.session.write(ExternalEvent::operator("/wm1/command", AnyMessage::new(command))).unwrap();
    drive.straight(0.0, 1, |_| false);
    let after = known(&drive);
    assert!(before > 1000 && 10 * after >= 9 * before, "{before} cells before, {after} after");
}
