//! The peer: a graph of three tasks under Copper, wired at compile time.
//!
//! A cycle of Copper runs the complete graph: a sensor provides input for the planner, and a vehicle consumes its
//! output. The message has 64 bytes, like ours. Copper keeps time, status and provenance beside each message, in place
//! of our status buffer.
//! stands where our status buffer stands.

use cu29::bincode::{Decode, Encode};
use cu29::prelude::*;
use serde::{Deserialize, Serialize};

/// A message of 64 bytes.
#[derive(Clone, Copy, Debug, Default, Encode, Decode, Serialize, Deserialize, Reflect)]
pub(crate) struct Reading {
    values: [f64; 8],
}

/// Writes a reading that changes in every cycle.
#[derive(Reflect)]
pub(crate) struct Sensor {
    cycle: f64,
}

impl Freezable for Sensor {}

impl CuSrcTask for Sensor {
    type Resources<'r> = ();
    type Output<'m> = output_msg!(Reading);

    fn new(_config: Option<&ComponentConfig>, _resources: Self::Resources<'_>) -> CuResult<Self> {
        Ok(Self { cycle: 0.0 })
    }

    fn process(&mut self, _ctx: &CuContext, output: &mut Self::Output<'_>) -> CuResult<()> {
        self.cycle += 1.0;
        output.set_payload(Reading { values: [self.cycle; 8] });
        Ok(())
    }
}

/// One read, one write: the task that is compared with ours.
#[derive(Reflect)]
pub(crate) struct Planner;

impl Freezable for Planner {}

impl CuTask for Planner {
    type Resources<'r> = ();
    type Input<'m> = input_msg!(Reading);
    type Output<'m> = output_msg!(Reading);

    fn new(_config: Option<&ComponentConfig>, _resources: Self::Resources<'_>) -> CuResult<Self> {
        Ok(Self)
    }

    fn process(
        &mut self,
        _ctx: &CuContext,
        input: &Self::Input<'_>,
        output: &mut Self::Output<'_>,
    ) -> CuResult<()> {
        let mut reading = input.payload().copied().unwrap_or_default();
        reading.values[0] += 1.0;
        output.set_payload(reading);
        output.metadata.set_status(0);
        Ok(())
    }
}

/// Reads the planner's output.
#[derive(Reflect)]
pub(crate) struct Vehicle;

impl Freezable for Vehicle {}

impl CuSinkTask for Vehicle {
    type Resources<'r> = ();
    type Input<'m> = input_msg!(Reading);

    fn new(_config: Option<&ComponentConfig>, _resources: Self::Resources<'_>) -> CuResult<Self> {
        Ok(Self)
    }

    fn process(&mut self, _ctx: &CuContext, input: &Self::Input<'_>) -> CuResult<()> {
        std::hint::black_box(input.payload());
        Ok(())
    }
}

/// Keeps messages in memory only.
pub(crate) mod unlogged {
    use cu29::prelude::*;
    use std::path::Path;

    #[copper_runtime(config = "copper_unlogged.ron")]
    struct Graph {}

    /// Starts the graph; each call of the returned function runs one cycle.
    pub(crate) fn start(log: &Path) -> CuResult<impl FnMut() -> CuResult<()> + use<>> {
        let mut running = Graph::builder().with_log_path(log, Some(64 << 20))?.build()?.start()?;
        Ok(move || running.run_one_iteration())
    }
}

/// Writes every message to Copper's log.
pub(crate) mod logged {
    use cu29::prelude::*;
    use std::path::Path;

    #[copper_runtime(config = "copper_logged.ron")]
    struct Graph {}

    /// Starts the graph; each call of the returned function runs one cycle.
    pub(crate) fn start(log: &Path) -> CuResult<impl FnMut() -> CuResult<()> + use<>> {
        let mut running = Graph::builder().with_log_path(log, Some(256 << 20))?.build()?.start()?;
        Ok(move || running.run_one_iteration())
    }
}
