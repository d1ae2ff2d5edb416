//! The context of one cycle of a process.

use crate::children::{Child, ChildLinks, ChildReport, ChildState, Children, Owner, answer};
use crate::command::{CommandSet, Obeys, Order};
use crate::pool::Pool;
use crate::ports::{In, Out};
use crate::register::Register;
use crate::status::{StatusCell, Text};
use rand_chacha::ChaCha8Rng;
use rcs_bus::{Header, Sample};
use rcs_msg::{AnyMessage, DeferredSource, Payload, Stamp, rcs};
use std::collections::VecDeque;
use std::marker::PhantomData;
use std::ops::Deref;
use std::sync::Arc;

/// The context of one cycle: the inputs at its start, and all operations of a process.
///
/// Output becomes visible to other processes when the cycle has ended, or after the declared latency.
pub struct Cycle<'a> {
    pub(crate) now: Stamp,
    pub(crate) period_ns: u64,
    pub(crate) inputs: &'a mut [InputView],
    /// Which inputs the stack connects.
    pub(crate) wired: &'a [bool],
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

/// A message from an input port; dereferences to its value.
#[derive(Clone, Debug)]
pub struct Msg<T> {
    sample: Sample,
    payload: PhantomData<fn() -> T>,
}

impl<T: Payload> Msg<T> {
    /// The sample as a `T`; `None` if it has another type or does not decode.
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

    /// Acquisition time of the message.
    pub fn acq_time(&self) -> Stamp {
        self.sample.header.acq_time
    }

    /// The acquisition time, and at most the time at which the message became visible: by it, a message has an age. A sensor
    /// whose clock is ahead would else look new for as long after it has stopped.
    pub fn acq_time_on_arrival(&self) -> Stamp {
        self.acq_time().min(self.sample.header.log_time)
    }

    /// The message itself. A reader that knows the source type of a deferred message uses [`AnyMessage::source`], which
    /// avoids making the `T`.
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

    /// Period of the process in this stack, s.
    pub fn period_s(&self) -> f64 {
        self.period_ns as f64 * 1e-9
    }

    /// The next unread message of a port; to be called repeatedly. A message that does not decode is a fault and is
    /// skipped.
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

    /// The newest unread message of a port; skips older ones.
    pub fn read_newest<T: Payload>(&mut self, port: &In<T>) -> Option<Msg<T>> {
        let fresh = &mut self.inputs[port.index].fresh;
        fresh.drain(..fresh.len().saturating_sub(1));
        self.read(port)
    }

    /// The newest message of a port, read or unread.
    pub fn latest<T: Payload>(&self, port: &In<T>) -> Option<Msg<T>> {
        Msg::from_sample(self.inputs[port.index].latest.clone()?)
    }

    /// Whether the stack connects a port. One that it connects may still have no message.
    pub fn is_wired<T>(&self, port: &In<T>) -> bool {
        self.wired[port.index]
    }

    /// Number of messages of a port since the last cycle that were dropped before this process could read them.
    pub fn missed<T>(&self, port: &In<T>) -> u64 {
        self.inputs[port.index].missed
    }

    /// Writes a message whose content was acquired at `acq_time`.
    pub fn write<T: Payload>(&mut self, port: &Out<T>, acq_time: Stamp, value: T) {
        self.staged.push(Staged { output: port.index, acq_time, message: AnyMessage::new(value) });
    }

    /// Writes a value that is converted to a message only for readers that do not know its type: see
    /// [`AnyMessage::deferred`].
    pub fn write_deferred<S, T>(&mut self, port: &Out<T>, acq_time: Stamp, source: S)
    where
        S: DeferredSource<T>,
        T: Payload,
    {
        let message = AnyMessage::deferred::<S, T>(source);
        self.staged.push(Staged { output: port.index, acq_time, message });
    }

    /// The next of the process's own commands since its last cycle; to be called repeatedly. Commands that are not read
    /// in this cycle are not returned again, but the last one that is no one-shot stays in force: [`Cycle::command`].
    pub fn next_command<P: Obeys>(&mut self) -> Option<P::Own> {
        self.register.next()?.downcast_ref::<P::Own>().cloned()
    }

    /// The process's own command in force: the last one since `RUN` that is no one-shot.
    pub fn command<P: Obeys>(&self) -> Option<&P::Own> {
        self.register.standing()?.downcast_ref()
    }

    /// Whether any command was accepted since the last cycle.
    pub fn is_new_command(&self) -> bool {
        self.register.is_new()
    }

    /// Whether `RUN` was accepted since the last cycle, alone or with commands of the process's own after it.
    pub fn is_new_run(&self) -> bool {
        self.register.is_run_new()
    }

    /// Sets the status to executing, with a text.
    #[track_caller]
    pub fn exec(&mut self, text: impl Into<Text>) {
        self.status.set(rcs::ProcessState::Exec, text.into());
    }

    /// Sets the status to done.
    #[track_caller]
    pub fn done(&mut self, text: impl Into<Text>) {
        self.status.set(rcs::ProcessState::Done, text.into());
    }

    /// Sets the status to error.
    #[track_caller]
    pub fn error(&mut self, text: impl Into<Text>) {
        self.status.set(rcs::ProcessState::Error, text.into());
    }

    /// Reports an input that is bad and skipped: it is counted and shown in the status.
    pub fn fault(&mut self, text: impl Into<Text>) {
        self.status.fault(text.into());
    }

    /// Random numbers of this process: the same for the same seed; they start again after `INIT`.
    pub fn rng(&mut self) -> &mut ChaCha8Rng {
        self.rng
    }

    /// Threads for parallel work.
    pub fn pool(&self) -> &Pool {
        self.pool
    }

    /// The children of a handle for a set.
    pub fn members<C>(&self, children: &Children<C>) -> impl Iterator<Item = Child<C>> + use<C> {
        let slot = children.slot;
        let count = self.child_links.links.iter().filter(|link| link.slot == slot).count();
        (0..count).map(move |place| Child::new(slot, place))
    }

    /// Sends a command to a child; `false` if the stack assigns no such child. The command becomes visible with the
    /// other output of the cycle.
    pub fn send<C: CommandSet>(&mut self, child: &Child<C>, order: impl Into<Order<C>>) -> bool {
        let Some(index) = self.child_links.index(child.slot, child.place) else { return false };
        let serial = &mut self.child_links.state.sent[index];
        *serial += 1;
        let message = AnyMessage::new(order.into().message(*serial, self.now));
        let output = self.child_links.links[index].output;
        self.staged.push(Staged { output, acq_time: self.now, message });
        true
    }

    /// State of a child; `None` if the stack assigns no such child.
    pub fn child_state<C>(&self, child: &Child<C>) -> Option<ChildState> {
        let index = self.child_links.index(child.slot, child.place)?;
        Some(self.judge(index, self.status_of(index)))
    }

    /// State of a child with the reason; `None` if the stack assigns no such child.
    pub fn child<C>(&self, child: &Child<C>) -> Option<ChildReport> {
        let index = self.child_links.index(child.slot, child.place)?;
        let (link, sent) = (&self.child_links.links[index], self.child_links.state.sent[index]);
        let status = self.status_of(index);
        let state = self.judge(index, status);
        let refusal = status.and_then(|status| self.child_links.refusal(status, sent));
        let said = status.and_then(|status| answer(status, sent));
        let text = match (state, refusal, said) {
            (ChildState::Silent, ..) => "posts no status".to_owned(),
            (_, Some(refusal), _) => format!("refused {}: {}", refusal.command, refusal.reason),
            (_, None, Some(said)) => said.to_owned(),
            (_, None, None) => format!("{} has not answered yet", link.name),
        };
        Some(ChildReport {
            name: Arc::clone(&link.name),
            state,
            text,
            owner: match status {
                Some(status) if *status.owner == *self.child_links.me => Owner::Us,
                Some(status) if !status.owner.is_empty() => Owner::Another,
                _ => Owner::Nobody,
            },
            obeys_another: status
                .filter(|status| self.child_links.obeys_another(status, sent))
                .map(|status| status.commander.clone()),
            obeys_last: status.is_some_and(|status| self.child_links.obeys_last(status, sent)),
            is_overruled: status.is_some_and(|status| self.child_links.is_overruled(status, sent)),
            own_command: status.and_then(|status| link.own_command(status)),
        })
    }

    fn status_of(&self, index: usize) -> Option<&rcs::Status> {
        self.inputs[self.child_links.links[index].input].latest.as_ref()?.message.get()
    }

    fn judge(&self, index: usize, status: Option<&rcs::Status>) -> ChildState {
        let link = &self.child_links.links[index];
        let heard = self.inputs[link.input].latest.as_ref().map(|sample| sample.header.log_time);
        let heard = heard.or(self.child_links.state.since).unwrap_or(self.now);
        if self.now >= heard.after_ns(link.silent_ns) {
            return ChildState::Silent;
        }
        self.child_links.state_of(index, status)
    }
}
