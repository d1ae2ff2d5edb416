//! Example of a plugin outside of the repository: adds up the distance driven by the vehicle.
//!
//! It shows ports, parameters and state of a process, not a good odometer: every jump of the pose counts as driven.
//! Begin with [`Odometer`], whose `step` is the whole computation; `proto/odometer.proto` declares its parameters.
//!
//! | port | direction | type | what |
//! | --- | --- | --- | --- |
//! | `odometry` | in | `foxglove.Odometry` | pose of the vehicle |
//! | `distance` | out | `acme.Distance` | how far it has driven, m |

rcs_msg::messages!(
    /// Messages of this plugin, from `proto/`.
    pub mod proto
);

use crate::proto::{Distance, OdometerParams};
use rcs_msg::Stamp;
use rcs_msg::foxglove::{self, Vector3};
use rcs_runtime::{Cycle, In, Out, PortBuilder, Process, ProcessDef};
use serde::{Deserialize, Serialize};

/// State: the position at the end of the last step, and the distance so far.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Odometer {
    last_m: Option<[f64; 2]>,
    driven_m: f64,
    sent: Option<Stamp>,
}

/// Ports of [`Odometer`].
#[derive(Debug)]
pub struct Ports {
    odometry: In<foxglove::Odometry>,
    distance: Out<Distance>,
}

impl Process for Odometer {
    type Params = OdometerParams;
    type Ports = Ports;
    type Command = rcs_runtime::NoCommands;
    const DEF: ProcessDef = ProcessDef {
        plugin: "acme_odometer",
        summary: "Adds up how far the vehicle has driven",
        period_ms: 50.0,
        latency_ms: 0.0,
        reads_ground_truth: false,
    };

    fn ports(b: &mut PortBuilder) -> Ports {
        Ports {
            odometry: b.input("odometry", "pose of the vehicle"),
            distance: b.output("distance", "how far it has driven, m").build(),
        }
    }

    fn new(_params: &OdometerParams) -> Self {
        Self::default()
    }

    fn cycle(&mut self, ports: &Ports, params: &OdometerParams, cx: &mut Cycle<'_>) {
        while let Some(odometry) = cx.read(&ports.odometry) {
            let position = odometry.pose.as_ref().and_then(|pose| pose.position.as_ref());
            match position {
                Some(&Vector3 { x, y, .. }) if x.is_finite() && y.is_finite() => {
                    self.step([x, y], params.min_step_m);
                }
                _ => cx.fault("odometry without a position; skipped"),
            }
        }
        let (now, period_s) = (cx.now(), params.report.as_ref().map_or(1.0, |report| report.period_s));
        if self.sent.is_none_or(|sent| now.seconds_since(sent) >= period_s) {
            self.sent = Some(now);
            let distance = Distance { timestamp: Some(now.to_proto()), driven_m: self.driven_m };
            cx.write(&ports.distance, now, distance);
        }
        cx.exec("adds up");
    }
}

impl Odometer {
    fn step(&mut self, [x, y]: [f64; 2], min_step_m: f64) {
        let [last_x, last_y] = *self.last_m.get_or_insert([x, y]);
        let step_m = ((x - last_x).powi(2) + (y - last_y).powi(2)).sqrt();
        if step_m >= min_step_m {
            self.driven_m += step_m;
            self.last_m = Some([x, y]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_not_driven_and_ways_are() {
        let mut odometer = Odometer::default();
        for x in [0.0, 0.04, 0.0, 0.04, 1.0, 2.0] {
            odometer.step([x, 0.0], 0.05);
        }
        assert_eq!(odometer.driven_m, 2.0);
    }
}
