//! What a process sees during one cycle.

use crate::children::ChildLinks;
use crate::pool::Pool;
use crate::process::{In, Out, Process};
use crate::register::Register;
use crate::status::{StatusCell, Text};
use rand_chacha::ChaCha8Rng;
use rcs_bus::{Header, Sample};
use rcs_msg::{AnyMessage, DeferredSource, Payload, Stamp, rcs};
use std::collections::VecDeque;
use std::marker::PhantomData;
use std::ops::Deref;

/// The context of one cycle: inputs as they were when it started, and everything that a process may do.
///
/// What is written becomes visible to others when the cycle has ended, or later where the stack declares a latency.
pub struct Cycle<'a> {
    pub(crate) now: Stamp,
    pub(crate) inputs: &'a mut [InputView],
    pub(crate) staged: &'a mut Vec<Staged>,
    pub(crate) status: &'a mut StatusCell,
    pub(crate) register: &'a mut Register,
    pub(crate) child_links: &'a mut ChildLinks,
    pub(crate) rng: &'a mut ChaCha8Rng,
    pub(crate) pool: &'a Pool,
}

/// An input port during a cycle.
#[derive(Clone, Debug, Default)]
pub(crate) struct InputView {
    pub(crate) fresh: VecDeque<Sample>,
    pub(crate) latest: Option<Sample>,
    pub(crate) missed: u64,
}

/// A message that a cycle wrote and that is not visible yet.
#[derive(Clone, Debug)]
pub(crate) struct Staged {
    pub(crate) output: usize,
    pub(crate) acq_time: Stamp,
    pub(crate) message: AnyMessage,
}

impl Staged {
    /// Encodes the message now, on this thread, for those who will ask for its bytes.
    pub(crate) fn encode(&self) {
        self.message.bytes();
    }
}

/// A message from an input port: derefs to its value.
#[derive(Clone, Debug)]
pub struct Msg<T> {
    sample: Sample,
    payload: PhantomData<fn() -> T>,
}

impl<T: Payload> Msg<T> {
    /// The sample as a `T`; `None` where it is none, or does not decode.
    pub fn from_sample(sample: Sample) -> Option<Self> {
        let message = if sample.message.holds::<T>() {
            sample.message
        } else {
            AnyMessage::new(sample.message.to::<T>()?)
        };
        Some(Self { sample: Sample { message, ..sample }, payload: PhantomData })
    }

    /// Sequence, times and writer.
    pub fn header(&self) -> &Header {
        &self.sample.header
    }

    /// When what it tells of was sensed.
    pub fn acq_time(&self) -> Stamp {
        self.sample.header.acq_time
    }

    /// The message itself: a reader that knows what it is made from takes [`AnyMessage::source`] of it, and the `T` is
    /// never made.
    pub fn message(&self) -> &AnyMessage {
        &self.sample.message
    }
}

impl<T: Payload> Deref for Msg<T> {
    type Target = T;

    #[expect(clippy::expect_used, reason = "the constructor has looked")]
    fn deref(&self) -> &T {
        self.sample.message.get().expect("a Msg holds a value of its type")
    }
}

impl Cycle<'_> {
    /// Simulated time at which the cycle started.
    pub fn now(&self) -> Stamp {
        self.now
    }

    /// The next unread message of a port; call again for more. One that does not decode is a fault and is skipped.
    pub fn read<T: Payload>(&mut self, port: &In<T>) -> Option<Msg<T>> {
        while let Some(sample) = self.inputs[port.index].fresh.pop_front() {
            let sequence = sample.header.sequence;
            match Msg::from_sample(sample) {
                Some(message) => return Some(message),
                None => self.fault(format!("message {sequence} is not a {}", T::full_name())),
            }
        }
        None
    }

    /// The newest unread message of a port; older unread ones are skipped.
    pub fn read_newest<T: Payload>(&mut self, port: &In<T>) -> Option<Msg<T>> {
        let fresh = &mut self.inputs[port.index].fresh;
        fresh.drain(..fresh.len().saturating_sub(1));
        self.read(port)
    }

    /// The newest message of a port, read or not.
    pub fn latest<T: Payload>(&self, port: &In<T>) -> Option<Msg<T>> {
        Msg::from_sample(self.inputs[port.index].latest.clone()?)
    }

    /// How many messages of a port were dropped before this process could read them, since its last cycle.
    pub fn missed<T>(&self, port: &In<T>) -> u64 {
        self.inputs[port.index].missed
    }

    /// Writes a message that tells of what was sensed at `acq_time`.
    pub fn write<T: Payload>(&mut self, port: &Out<T>, acq_time: Stamp, value: T) {
        self.staged.push(Staged { output: port.index, acq_time, message: AnyMessage::new(value) });
    }

    /// Writes a value that becomes a message for those who do not know it: see [`AnyMessage::deferred`].
    pub fn write_deferred<S, T>(&mut self, port: &Out<T>, acq_time: Stamp, source: S)
    where
        S: DeferredSource<T>,
        T: Payload,
    {
        let message = AnyMessage::deferred::<S, T>(source);
        self.staged.push(Staged { output: port.index, acq_time, message });
    }

    /// The next of the process's own commands that came since its last cycle; call again for more. What is not asked
    /// for in this cycle does not come again, but the last one stands: [`Cycle::command`].
    pub fn next_command<P: Process>(&mut self) -> Option<P::Command> {
        self.register.next()?.downcast_ref::<P::Command>().cloned()
    }

    /// The process's own command that is being obeyed: the last one since `RUN`.
    pub fn command<P: Process>(&self) -> Option<&P::Command> {
        self.register.standing()?.downcast_ref()
    }

    /// Whether a command, own or not, was accepted since the last cycle.
    pub fn is_new_command(&self) -> bool {
        self.register.is_new()
    }

    /// Says that the process is at work, and at what.
    #[track_caller]
    pub fn exec(&mut self, text: impl Into<Text>) {
        self.status.set(rcs::ProcessState::Exec, text.into());
    }

    /// Says that the command has been carried out.
    #[track_caller]
    pub fn done(&mut self, text: impl Into<Text>) {
        self.status.set(rcs::ProcessState::Done, text.into());
    }

    /// Says that the process cannot go on.
    #[track_caller]
    pub fn error(&mut self, text: impl Into<Text>) {
        self.status.set(rcs::ProcessState::Error, text.into());
    }

    /// Reports bad input, which is then skipped: counted, and shown with the status.
    pub fn fault(&mut self, text: impl Into<Text>) {
        self.status.fault(text.into());
    }

    /// Random numbers of this process: the same for the same seed, and from the first on again after `INIT`.
    pub fn rng(&mut self) -> &mut ChaCha8Rng {
        self.rng
    }

    /// Threads to compute on.
    pub fn pool(&self) -> &Pool {
        self.pool
    }
}
