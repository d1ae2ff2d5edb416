//! What a process made of its inputs since the run began: whether it wrote anything, and whether all that it got from a
//! port was a fault.
//!
//! A summary tells it. It is no part of a snapshot, so it is known of a run that went from its start to its end alone.

/// Counts of one process.
#[derive(Clone, Debug, Default)]
pub(crate) struct Work {
    /// Whether the capture of this cycle brought something, of each input port.
    arrived: Vec<bool>,
    /// Cycles of each input port that brought something, and those of them with a fault.
    fed: Vec<Fed>,
    /// Cycles with a fault.
    faulty: u64,
    /// Messages written to its output ports.
    written: u64,
}

#[derive(Clone, Copy, Debug, Default)]
struct Fed {
    cycles: u64,
    faulty: u64,
}

impl Work {
    /// Of a process with so many input ports.
    pub(crate) fn new(inputs: usize) -> Self {
        Self { arrived: vec![false; inputs], fed: vec![Fed::default(); inputs], faulty: 0, written: 0 }
    }

    /// A capture brought something at an input.
    pub(crate) fn arrived(&mut self, input: usize) {
        if let Some(arrived) = self.arrived.get_mut(input) {
            *arrived = true;
        }
    }

    /// A cycle has ended.
    pub(crate) fn end_cycle(&mut self, faulted: bool, written: usize) {
        self.faulty += u64::from(faulted);
        self.written += written as u64;
        for (arrived, fed) in self.arrived.iter_mut().zip(&mut self.fed) {
            if std::mem::take(arrived) {
                fed.cycles += 1;
                fed.faulty += u64::from(faulted);
            }
        }
    }

    /// Messages written to its output ports.
    pub(crate) fn written(&self) -> u64 {
        self.written
    }

    /// The input port whose messages each came with a fault, where it accounts for every fault: the first of them. One
    /// message is not enough to say so.
    pub(crate) fn refused_input(&self) -> Option<usize> {
        let refused = |fed: &Fed| fed.cycles > 1 && fed.faulty == fed.cycles && fed.faulty == self.faulty;
        self.fed.iter().position(refused)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_input_is_refused_where_each_of_its_messages_and_nothing_else_came_with_a_fault() {
        // Images in every second cycle, poses in every cycle, one calibration.
        let run = |faulted: fn(u32) -> bool| {
            let mut work = Work::new(3);
            for cycle in 0..20 {
                work.arrived(0);
                if cycle == 0 {
                    work.arrived(1);
                }
                if cycle % 2 == 0 {
                    work.arrived(2);
                }
                work.end_cycle(faulted(cycle), 0);
            }
            work.refused_input()
        };
        assert_eq!(run(|cycle| cycle % 2 == 0), Some(2));
        assert_eq!(run(|_| true), Some(0));
        assert_eq!(run(|cycle| cycle == 0), None, "one message is not enough");
        assert_eq!(run(|cycle| cycle % 2 == 0 && cycle > 0), None, "the first image was taken");
        assert_eq!(run(|_| false), None);
    }
}
