//! Which alarms the user knows, in each run of a source.

use rcs_msg::Stamp;
use rcs_runtime::RunId;
use rcs_runtime::source::Runs;
use std::collections::BTreeMap;

/// Times up to which the user has said that the alarms of a run are known.
#[derive(Debug, Default)]
pub(super) struct KnownAlarms(BTreeMap<RunId, Stamp>);

impl KnownAlarms {
    /// From now on, the alarms of the viewed run up to a time are known, also in the runs that share them.
    pub(super) fn know(&mut self, runs: &Runs, until: Stamp) {
        for (run, shared) in with_ancestors(runs) {
            let known = self.0.entry(run).or_default();
            *known = until.min(shared).max(*known);
        }
    }

    /// Time up to which the alarms of the viewed run are known. Those before it left another run are known as far as they
    /// are in that one.
    pub(super) fn until(&self, runs: &Runs) -> Stamp {
        let known = |(run, shared): (RunId, Stamp)| self.0.get(&run).copied().unwrap_or_default().min(shared);
        with_ancestors(runs).map(known).max().unwrap_or_default()
    }
}

/// The viewed run and its ancestors: the run that it left, the one that this left, and so on; each with the time up to
/// which the viewed run has the same alarms.
fn with_ancestors(runs: &Runs) -> impl Iterator<Item = (RunId, Stamp)> {
    std::iter::successors(Some((runs.current(), Stamp::MAX)), move |(run, shared)| {
        let left = runs.all.get(run.0 as usize)?.branched_from;
        let (from, at) = left.filter(|(from, _)| from.run < *run)?;
        // An alarm in the very instant of the branch may be of one of the two runs only.
        Some((from.run, at.before_ns(1).min(*shared)))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcs_runtime::{Moment, RunSummary};

    /// Three runs, of which one is viewed: run 1 left run 0 at 20 ns, run 2 left run 1 at 30 ns.
    fn runs(viewed: u32) -> Runs {
        let moment = |run| Moment { run: RunId(run), event: 0, write: 0 };
        let left = [None, Some((moment(0), Stamp(20))), Some((moment(1), Stamp(30)))];
        let all = left.into_iter().zip(0..).map(|(branched_from, id)| RunSummary {
            id: RunId(id),
            branched_from,
            end: Stamp(100),
            events: 1,
            writes: 1,
        });
        Runs { all: all.collect(), moment: moment(viewed), ..Runs::default() }
    }

    #[test]
    fn what_a_run_shares_with_the_one_that_it_left_is_known_there_and_what_happens_later_is_not() {
        let mut known = KnownAlarms::default();
        for (run, until, expected) in
            [(0, 10, [10, 10, 10]), (0, 60, [60, 19, 19]), (1, 25, [60, 25, 25]), (1, 40, [60, 40, 29])]
        {
            known.know(&runs(run), Stamp(until));
            assert_eq!([0, 1, 2].map(|viewed| known.until(&runs(viewed)).0), expected);
        }
    }

    #[test]
    fn what_is_known_in_a_run_is_known_in_those_that_it_left_as_far_as_they_share_it() {
        let mut known = KnownAlarms::default();
        for (run, until, expected) in
            [(1, 15, [15, 15, 15]), (2, 25, [19, 25, 25]), (2, 40, [19, 29, 40]), (0, 10, [19, 29, 40])]
        {
            known.know(&runs(run), Stamp(until));
            assert_eq!([0, 1, 2].map(|viewed| known.until(&runs(viewed)).0), expected);
        }
    }
}
