//! The process `sim_ladar`: point clouds of a simulated scanning ladar.
//!
//! | port | direction | type | what |
//! | --- | --- | --- | --- |
//! | `ground_truth_state` | in | `rcs.GroundTruthState` | true pose of the vehicle in the frame global |
//! | `cloud` | out | `foxglove.PointCloud` | points with remission in the ladar's frame, m |
//! | `ground_truth_class` | out | `foxglove.PointCloud` | the same points with the class of what they hit |
//!
//! Period 50 ms; sweeps at the rate of the vehicle file. A sweep is taken from one pose. Rays that hit nothing within
//! range give no point. A ray may pass between plant stems: see the scene crate. Lines are cast in parallel, with noise
//! from a key per line.

use crate::proto::SimLadarParams;
use crate::scene::{Texts, check_world, read_vehicle, read_world};
use crate::sensors::{is_due, limit, normal};
use crate::spec::LadarSpec;
use rand_core::RngCore;
use rcs_geom::Pose;
use rcs_msg::Stamp;
use rcs_msg::foxglove::packed_element_field::NumericType;
use rcs_msg::foxglove::{PackedElementField, PointCloud};
use rcs_msg::rcs::GroundTruthState;
use rcs_runtime::{Cycle, In, NoCommands, Out, PortBuilder, Process, ProcessDef, Role, Text};
use rcs_scene::{Class, World};
use rcs_sense::{pose_message, pose_of};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// State: the time of the last pose.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct SimLadar {
    last: Option<Stamp>,
    #[serde(skip)]
    scanner: Option<Arc<Scanner>>,
}

/// Ports of [`SimLadar`].
#[derive(Debug)]
pub struct Ports {
    ground_truth_state: In<GroundTruthState>,
    cloud: Out<PointCloud>,
    ground_truth_class: Out<PointCloud>,
}

/// The parsed parameters.
#[derive(Debug)]
struct Scanner {
    texts: Texts,
    name: String,
    spec: LadarSpec,
    /// Rate of the true pose, 1/s.
    poses_hz: f64,
    world: Arc<World>,
}

/// A point of a sweep: position in the ladar's frame, remission, class.
type Point = ([f32; 3], f32, u8);

impl Process for SimLadar {
    type Params = SimLadarParams;
    type Ports = Ports;
    type Command = NoCommands;
    const DEF: ProcessDef = ProcessDef {
        plugin: "sim_ladar",
        summary: "Simulates a scanning ladar of the vehicle",
        period_ms: 50.0,
        latency_ms: 4.0,
        reads_ground_truth: true,
    };

    fn ports(b: &mut PortBuilder) -> Ports {
        Ports {
            ground_truth_state: b.input("ground_truth_state", "true pose of the vehicle in the frame global"),
            cloud: b
                .output("cloud", "points with remission in the ladar's frame, m")
                .role(Role::Cloud)
                .build(),
            ground_truth_class: b
                .output("ground_truth_class", "the same points with the class of what they hit")
                .role(Role::Cloud)
                .palette("surfaces")
                .truth()
                .build(),
        }
    }

    fn check(params: &SimLadarParams) -> Result<(), String> {
        Scanner::ladar(params)?;
        check_world(&params.world).map(|_| ())
    }

    fn new(_params: &SimLadarParams) -> Self {
        Self::default()
    }

    fn cycle(&mut self, ports: &Ports, params: &SimLadarParams, cx: &mut Cycle<'_>) {
        let scanner = match self.scanner(params) {
            Ok(scanner) => scanner,
            Err(error) => {
                cx.error(error);
                return;
            }
        };
        let rate_hz = if params.rate_hz > 0.0 { params.rate_hz } else { scanner.spec.rate_hz };
        let limit = limit(rate_hz, cx.period_s(), scanner.poses_hz);
        let status = |doing: &'static str| match &limit {
            Some(limit) => Text::from(format!("{doing}: {limit}")),
            None => doing.into(),
        };
        let Some(state) = cx.read_newest(&ports.ground_truth_state) else {
            cx.exec(status("waits for the vehicle's pose"));
            return;
        };
        let time = state.acq_time();
        let due = self.last.is_none_or(|last| is_due(last.0, time.0, rate_hz));
        self.last = Some(time);
        cx.exec(status("scans"));
        if !due {
            return;
        }
        match pose_of(state.pose.as_ref(), "vehicle") {
            Ok(pose) => {
                let points = scanner.scan(&pose, params.noise, cx);
                cx.write(&ports.cloud, time, scanner.message(&points, time, false));
                cx.write(&ports.ground_truth_class, time, scanner.message(&points, time, true));
            }
            Err(error) => cx.fault(format!("{error}; sweep skipped")),
        }
    }
}

impl SimLadar {
    fn scanner(&mut self, params: &SimLadarParams) -> Result<Arc<Scanner>, String> {
        if let Some(scanner) = self.scanner.as_ref().filter(|scanner| scanner.is_of(params)) {
            return Ok(Arc::clone(scanner));
        }
        let scanner = Arc::new(Scanner::new(params)?);
        self.scanner = Some(Arc::clone(&scanner));
        Ok(scanner)
    }
}

impl Scanner {
    /// The ladar named by the parameters, and the rate of the true pose, 1/s.
    fn ladar(params: &SimLadarParams) -> Result<(LadarSpec, f64), String> {
        let vehicle = read_vehicle(&params.vehicle)?;
        let spec = vehicle.ladar(&params.ladar).cloned().ok_or_else(|| {
            let names: Vec<&str> = vehicle.ladars.iter().map(|ladar| ladar.name.as_str()).collect();
            format!("ladar is {:?}, expected one of the vehicle: [{}]", params.ladar, names.join(", "))
        })?;
        Ok((spec, vehicle.rates.ground_truth_hz))
    }

    fn new(params: &SimLadarParams) -> Result<Scanner, String> {
        let (spec, poses_hz) = Scanner::ladar(params)?;
        let world = read_world(&params.world, "")?;
        let texts = Texts::of(&[&params.world, &params.vehicle]);
        Ok(Scanner { texts, name: params.ladar.clone(), spec, poses_hz, world })
    }

    fn is_of(&self, params: &SimLadarParams) -> bool {
        self.name == params.ladar && self.texts.are(&[&params.world, &params.vehicle])
    }

    fn scan(&self, global_from_vehicle: &Pose, noise: bool, cx: &mut Cycle<'_>) -> Vec<Point> {
        let spec = &self.spec;
        let global_from_ladar = *global_from_vehicle * spec.mount.vehicle_from_sensor();
        // One key per line, so that the noise of a line does not depend on the hits of other lines.
        let keys: Vec<u64> = (0..spec.lines).map(|_| cx.rng().next_u64()).collect();
        let lines = cx.pool().map(spec.lines as usize, |line| {
            let mut rng = LineNoise(keys[line]);
            let mut points: Vec<Point> = Vec::new();
            for direction in spec.directions(line as u32) {
                let drawn = if noise { spec.noise_m * normal(&mut rng) } else { 0.0 };
                let ray = global_from_ladar.rotate(direction);
                let Some(hit) = self.world.cast(global_from_ladar.translation, ray, spec.max_range_m) else {
                    continue;
                };
                let range_m = (hit.range_m + drawn).max(0.0);
                points.push((
                    (direction * range_m).as_vec3().to_array(),
                    remission(hit.class),
                    hit.class.code(),
                ));
            }
            points
        });
        lines.concat()
    }

    /// The sweep as a message, 16 bytes per point.
    fn message(&self, points: &[Point], time: Stamp, classes: bool) -> PointCloud {
        let mut data = Vec::with_capacity(16 * points.len());
        for (place, remission, class) in points {
            for value in place {
                data.extend_from_slice(&value.to_le_bytes());
            }
            if classes {
                data.extend_from_slice(&[*class, 0, 0, 0]);
            } else {
                data.extend_from_slice(&remission.to_le_bytes());
            }
        }
        let field = |name: &str, offset: u32, kind: NumericType| PackedElementField {
            name: name.to_owned(),
            offset,
            r#type: kind.into(),
        };
        let last = if classes {
            field("label", 12, NumericType::Uint8)
        } else {
            field("intensity", 12, NumericType::Float32)
        };
        PointCloud {
            timestamp: Some(time.to_proto()),
            frame_id: self.spec.name.clone(),
            pose: Some(pose_message(&Pose::IDENTITY)),
            point_stride: 16,
            fields: vec![
                field("x", 0, NumericType::Float32),
                field("y", 4, NumericType::Float32),
                field("z", 8, NumericType::Float32),
                last,
            ],
            data: data.into(),
        }
    }
}

/// Share of the ladar's light that is reflected, 0 to 1: plants reflect near infrared strongly, wet soil weakly.
fn remission(class: Class) -> f32 {
    match class {
        Class::Sky => 0.0,
        Class::ShortGrass
        | Class::TallGrass
        | Class::TallWeeds
        | Class::Thicket
        | Class::Crown
        | Class::Bush => 0.65,
        Class::WhiteLime | Class::HayBale | Class::Shed => 0.75,
        Class::Fence | Class::Person => 0.55,
        Class::Mulch | Class::LeafLitter | Class::Trunk | Class::Log | Class::Post => 0.4,
        Class::Dirt | Class::Boulder => 0.3,
        Class::Mud => 0.15,
    }
}

/// Random number generator for the noise of a line (`SplitMix64`).
struct LineNoise(u64);

impl RngCore for LineNoise {
    fn next_u32(&mut self) -> u32 {
        (self.next_u64() >> 32) as u32
    }

    fn next_u64(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        crate::exposure::scrambled(self.0)
    }

    fn fill_bytes(&mut self, bytes: &mut [u8]) {
        for chunk in bytes.chunks_mut(8) {
            chunk.copy_from_slice(&self.next_u64().to_le_bytes()[..chunk.len()]);
        }
    }
}
