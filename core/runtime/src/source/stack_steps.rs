//! Steps of a stack: by viewing what was executed already, and by executing beyond its end.

use super::log_source::neighbour;
use super::stack_source::StackSource;
use super::{Source, SourceError, Task};
use crate::history::Point;
use crate::stepped::Happened;
use rcs_log::MessagePosition;

impl StackSource {
    /// Moves the view to a point if one was found; `false` if not.
    fn look(&mut self, found: Option<Point>) -> bool {
        if let Some(point) = found {
            self.session.look(point);
        }
        found.is_some()
    }

    pub(super) fn buffer_of(&self, topic: &str) -> Option<usize> {
        let plan = self.session.run().plan();
        plan.inputs
            .iter()
            .find(|input| input.topic == topic && !input.is_static)
            .map(|input| input.buffer)
            .or_else(|| plan.buffers.iter().position(|buffer| buffer.spec.name == topic))
    }

    pub(super) fn process_named(&self, name: &str) -> Result<usize, SourceError> {
        let processes = &self.session.run().plan().processes;
        processes
            .iter()
            .position(|process| &*process.name == name)
            .ok_or_else(|| SourceError::Unsupported(format!("there is no process {name} in this stack")))
    }

    /// To the next or previous message of the log; without a log, to the end of the next or previous cycle, because there
    /// may never be an input to step to.
    pub(super) fn step_input(&mut self, back: bool, task: &Task) -> Result<bool, SourceError> {
        let is_closed = self.recorded.is_none();
        self.step_event(back, task, |what| {
            what == Happened::Input || (is_closed && matches!(what, Happened::Cycle(_)))
        })
    }

    /// To the next or previous message of a buffer.
    pub(super) fn step_message(
        &mut self,
        buffer: usize,
        back: bool,
        task: &Task,
    ) -> Result<bool, SourceError> {
        if back {
            let before = self.session.message_before(buffer);
            // The moment before the first message is not a step, because it has nothing to show.
            return Ok(self.look(before));
        }
        if let Some(after) = self.session.message_after(buffer) {
            self.look(Some(after));
            self.session.fill(task)?;
            return Ok(true);
        }
        self.session.look_at_end();
        let newest = self.session.messages(buffer);
        self.session.forward_to(self.last(), task, |run, _| run.buffers()[buffer].newest() > newest)
    }

    /// To the next or previous message of a recorded topic that the stack does not read, at the time of that message.
    pub(super) fn step_recorded(
        &mut self,
        topic: &str,
        back: bool,
        task: &Task,
    ) -> Result<bool, SourceError> {
        let Some(view) = &self.recorded else {
            return Err(SourceError::Unsupported(format!("there is no topic {topic}")));
        };
        let ids = view.topic_ids(topic);
        let place = if back { MessagePosition::before(self.now) } else { MessagePosition::after(self.now) };
        let found = neighbour(view.log(), Some(&ids), place, back)?;
        // A recorded run that is computed again may end before the log.
        let Some(message) = found.filter(|message| message.log_time <= self.last()) else { return Ok(false) };
        self.seek(message.log_time, task)?;
        Ok(true)
    }

    /// Goes back to when the message with this sequence was written to a buffer of the stack.
    pub(super) fn step_back_to(&mut self, topic: &str, sequence: u64) -> Result<bool, SourceError> {
        let found = self.buffer_of(topic).and_then(|buffer| self.session.written_at(buffer, sequence));
        let point = found.ok_or_else(|| SourceError::no_message(topic, sequence))?;
        let from = self.session.cursor();
        self.session.look(point);
        Ok(point != from)
    }

    pub(super) fn step_event(
        &mut self,
        back: bool,
        task: &Task,
        is_wanted: impl Fn(Happened) -> bool,
    ) -> Result<bool, SourceError> {
        if back {
            let before = self.session.event_before(is_wanted);
            if let Some(event) = before {
                self.session.look_at_event(event);
            }
            return Ok(before.is_some());
        }
        if let Some(event) = self.session.event_after(&is_wanted) {
            self.session.look_at_event(event);
            self.session.fill(task)?;
            return Ok(true);
        }
        let last = self.last();
        self.session.look_at_end();
        self.session.forward_to(last, task, |_, what| is_wanted(what))
    }
}
