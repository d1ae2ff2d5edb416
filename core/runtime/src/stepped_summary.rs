//! The summary of a stepped run.

use crate::node::Node;
use crate::stack::ProcessPlan;
use crate::stepped::Stepped;
use crate::summary::{BufferSummary, CycleTimes, ProcessSummary, Said, Summary, summary_of};
use crate::tally::Tallies;
use crate::workers::Slot;
use rcs_msg::Stamp;

impl Stepped {
    /// Keeps what the processes say, if the log ends before this time, which is next.
    pub(crate) fn note_log_end(&mut self, next: Stamp) {
        let Some(end) = self.feed.as_ref().map(|feed| feed.range.1) else { return };
        if self.now <= end && next > end {
            let said =
                |node: &Node, _: &CycleTimes| (node.status().state(), node.status().shown_text().to_owned());
            self.at_log_end = Some(self.machine().nodes.iter().map(|slot| slot.look(said)).collect());
        }
    }

    /// The summary of the run so far. After the end of the log, processes report that nothing comes any more; so their
    /// states are those at its end, but for those of processes that have panicked since.
    pub fn summary(&self) -> Summary {
        let tallies = self.tallies.as_ref().and_then(Tallies::get);
        let of =
            |(index, buffer)| BufferSummary::new(buffer, tallies.as_ref().map(|tallies| &tallies[index]));
        let buffers = self.machine().buffers.iter().enumerate().map(of).collect();
        summary_of(self.now.seconds_since(self.start), self.process_summaries(), buffers)
    }

    fn process_summaries(&self) -> Vec<ProcessSummary> {
        let is_over = self.feed.as_ref().is_some_and(|feed| self.now > feed.range.1);
        let at_log_end = self.at_log_end.as_ref().filter(|_| is_over);
        let processes = self.machine().nodes.iter().zip(&self.plan().processes).enumerate();
        let of = |(index, (slot, process)): (usize, (&Slot, &ProcessPlan))| {
            let look = |node: &Node, times: &CycleTimes| {
                let status = node.status();
                let now = || (status.state(), status.shown_text().to_owned());
                let (state, state_text) = match at_log_end {
                    Some(said) if !node.has_panicked() => said[index].clone(),
                    _ => now(),
                };
                let said = Said {
                    state,
                    state_text,
                    cycles: status.cycle,
                    faults: status.faults(),
                    last_fault: status.last_fault().to_owned(),
                };
                (said, node.work().clone(), *times)
            };
            let (said, work, times) = slot.look(look);
            ProcessSummary::new(process, said, &times, &work)
        };
        processes.map(of).collect()
    }
}
