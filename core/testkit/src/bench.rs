//! A test bench for stacks: a test feeds the buffers of a stack, steps it, and reads what it has written.

use rcs_log::Log;
use rcs_msg::{AnyMessage, Payload, Stamp, rcs};
use rcs_runtime::source::Task;
use rcs_runtime::{
    Assets, ExternalEvent, NoAssets, Plan, PlanOptions, ProcessType, RunOptions, Session, StackError,
    StackFile, Stepped,
};
use std::sync::Arc;

/// [`Bench::advance`] runs to this long after its target time, so that all cycles at that time are done and no later
/// one.
const SETTLE_NS: u64 = 5_000_000;

/// A stack and the options of its run.
#[derive(Clone)]
pub struct Setup<'a> {
    stack: &'a str,
    plugins: &'a [ProcessType],
    params: &'a [(&'a str, &'a str)],
    assets: &'a dyn Assets,
    options: RunOptions,
}

impl<'a> Setup<'a> {
    /// The text of a stack file, and the plugins that it may name.
    pub fn new(stack: &'a str, plugins: &'a [ProcessType]) -> Setup<'a> {
        Setup { stack, plugins, params: &[], assets: &NoAssets, options: RunOptions::default() }
    }

    /// Sets parameters: `(process.field, value)`.
    #[must_use]
    pub fn params(self, params: &'a [(&'a str, &'a str)]) -> Self {
        Self { params, ..self }
    }

    /// Sets the source of the files that the stack names.
    #[must_use]
    pub fn assets(self, assets: &'a dyn Assets) -> Self {
        Self { assets, ..self }
    }

    /// Sets seed, number of threads and other options of the run.
    #[must_use]
    pub fn options(self, options: RunOptions) -> Self {
        Self { options, ..self }
    }

    /// The plan: the stack, checked against the plugins.
    pub fn plan(&self) -> Result<Arc<Plan>, StackError> {
        let overrides: Vec<(String, String)> =
            self.params.iter().map(|&(name, value)| (name.to_owned(), value.to_owned())).collect();
        let file = StackFile::parse("stack.toml", self.stack)?;
        let options = PlanOptions { overrides: &overrides, course: None, assets: self.assets };
        Plan::with(file, self.plugins, &options).map(Arc::new)
    }

    /// A run that has begun, on a log if one is given.
    ///
    /// # Panics
    /// If the stack cannot run.
    pub fn stepped(&self, log: Option<&Log>) -> Stepped {
        let plan = self.plan().unwrap_or_else(|error| panic!("{error}"));
        let run = Stepped::new(plan, log, self.options.clone());
        let mut run = run.unwrap_or_else(|error| panic!("{error}"));
        run.begin().unwrap_or_else(|error| panic!("{error}"));
        run
    }

    /// A session at its start, before the first cycle.
    ///
    /// # Panics
    /// If the stack cannot run.
    pub fn bench(&self) -> Bench {
        let plan = self.plan().unwrap_or_else(|error| panic!("{error}"));
        let run = Stepped::new(plan, None, self.options.clone());
        let session = run.and_then(Session::new).unwrap_or_else(|error| panic!("{error}"));
        Bench { session, now_ms: 0 }
    }
}

/// A session that a test feeds and steps. Its methods panic if a buffer is absent, empty or of another type.
pub struct Bench {
    /// The session.
    pub session: Session,
    /// Time that the test has reached, ms: that of the next cycle after [`Bench::cycles`], or of the last one after
    /// [`Bench::advance`].
    pub now_ms: u64,
}

#[expect(clippy::missing_panics_doc, reason = "said at the type: what does not fit fails the test")]
impl Bench {
    /// Writes a message into a buffer that no process writes.
    pub fn write<T: Payload>(&mut self, buffer: &str, message: T) {
        self.write_any(buffer, AnyMessage::new(message));
    }

    /// Writes a message of any type into a buffer that no process writes.
    pub fn write_any(&mut self, buffer: &str, message: AnyMessage) {
        let event = ExternalEvent::operator(buffer, message);
        self.session.write(event).unwrap_or_else(|error| panic!("{buffer}: {error}"));
    }

    /// Runs this many cycles of a process with the given period, and half a period more, so that a message written
    /// afterwards arrives before the next cycle.
    pub fn cycles(&mut self, period_ms: u64, count: u64) {
        self.now_ms += period_ms * count;
        self.forward_until(Stamp(self.now_ms * 1_000_000 - period_ms * 500_000));
    }

    /// Advances by this many ms, a multiple of 10, including all cycles at the target time.
    pub fn advance(&mut self, ms: u64) {
        self.now_ms += ms;
        self.forward_until(Stamp(self.now_ms * 1_000_000 + SETTLE_NS));
    }

    fn forward_until(&mut self, time: Stamp) {
        self.session.forward_until(time, &Task::default()).unwrap_or_else(|error| panic!("{error}"));
    }

    /// The newest message of a buffer; `None` before the first.
    pub fn newest<T: Payload>(&self, buffer: &str) -> Option<T> {
        newest(self.session.run(), buffer)
    }

    /// The newest message of a buffer.
    pub fn latest<T: Payload>(&self, buffer: &str) -> T {
        self.newest(buffer).unwrap_or_else(|| panic!("nothing in {buffer}"))
    }

    /// Number of messages written to a buffer.
    pub fn sent(&self, buffer: &str) -> u64 {
        sent(self.session.run(), buffer)
    }

    /// Number of faults that a process has reported, and the last one.
    pub fn faults(&self, process: &str) -> (u64, String) {
        faults(self.session.run(), process)
    }
}

/// The newest message of a run's buffer; `None` before the first.
///
/// # Panics
/// If the run has no such buffer, or the buffer holds messages of another type.
pub fn newest<T: Payload>(run: &Stepped, buffer: &str) -> Option<T> {
    let sample = run.bus().get(buffer).unwrap_or_else(|| panic!("there is no buffer {buffer}")).latest()?;
    Some(sample.message.to().unwrap_or_else(|| panic!("{buffer} holds messages of another type")))
}

/// Number of messages written to a run's buffer.
///
/// # Panics
/// If the run has no such buffer.
pub fn sent(run: &Stepped, buffer: &str) -> u64 {
    run.bus().get(buffer).unwrap_or_else(|| panic!("there is no buffer {buffer}")).newest()
}

/// Number of faults that a process of a run has reported, and the last one; none before its first cycle.
///
/// # Panics
/// If the run has no such process.
pub fn faults(run: &Stepped, process: &str) -> (u64, String) {
    let status: Option<rcs::Status> = newest(run, &format!("/{process}/status"));
    status.map_or((0, String::new()), |status| (status.faults, status.last_fault))
}
