//! What the waypoint generator supervises: the planners and the follower.

use crate::process::PlannerCommand;
use rcs_runtime::{Child, ChildReport, ChildState, Cycle, NoCommands, Order, PortBuilder};

/// The children of the waypoint generator; each may be absent.
#[derive(Debug)]
pub(crate) struct Children {
    pub(crate) planner: Child<PlannerCommand>,
    pub(crate) far_planner: Child<PlannerCommand>,
    follower: Child<NoCommands>,
}

impl Children {
    pub(crate) fn declare(b: &mut PortBuilder) -> Self {
        Children {
            planner: b.optional_child("planner", "what plans the path"),
            far_planner: b.optional_child("far_planner", "what plans on a larger map than the planner's"),
            follower: b.optional_child("follower", "what drives along the waypoints"),
        }
    }

    /// Sends an order to every child if it is new, and to one that the operator gives back. Returns whether a planner was
    /// sent one: it has forgotten its goal.
    pub(crate) fn pass_on(
        &self,
        to_planners: &Order<PlannerCommand>,
        to_follower: &Order<NoCommands>,
        is_new: bool,
        cx: &mut Cycle<'_>,
    ) -> bool {
        let again = |report: Option<ChildReport>, is_halt: bool| {
            report.is_some_and(|report| report.is_ordered_again(is_halt))
        };
        let mut forgotten = false;
        for planner in [&self.planner, &self.far_planner] {
            if is_new || again(cx.child(planner), matches!(to_planners, Order::Halt)) {
                cx.send(planner, to_planners.clone());
                forgotten = true;
            }
        }
        if is_new || again(cx.child(&self.follower), matches!(to_follower, Order::Halt)) {
            cx.send(&self.follower, to_follower.clone());
        }
        forgotten
    }

    /// Sends an order to the follower.
    pub(crate) fn order_follower(&self, order: Order<NoCommands>, cx: &mut Cycle<'_>) {
        cx.send(&self.follower, order);
    }

    /// Halts the planners.
    pub(crate) fn halt_planners(&self, cx: &mut Cycle<'_>) {
        cx.send(&self.planner, Order::Halt);
        cx.send(&self.far_planner, Order::Halt);
    }

    /// Has the planners run again.
    pub(crate) fn run_planners(&self, cx: &mut Cycle<'_>) {
        cx.send(&self.planner, Order::Run);
        cx.send(&self.far_planner, Order::Run);
    }

    /// Whether the follower drives as this process wants: it has not failed, and does not obey the operator.
    pub(crate) fn may_drive(&self, cx: &Cycle<'_>) -> bool {
        let obeys = |report: ChildReport| report.failure().is_none() && report.obeys_another.is_none();
        cx.child(&self.follower).is_none_or(obeys)
    }

    /// `DONE` when all children are.
    pub(crate) fn await_all(&self, done: &'static str, cx: &mut Cycle<'_>) {
        let reports = [cx.child(&self.planner), cx.child(&self.follower), cx.child(&self.far_planner)];
        let mut reports = reports.iter().flatten().filter(|report| report.obeys_another.is_none());
        if let Some(failed) = reports.clone().find_map(ChildReport::failure) {
            return cx.error(failed);
        }
        match reports.find(|report| report.state != ChildState::Done) {
            Some(waited) => cx.exec(format!("waits for {}", waited.name)),
            None => cx.done(done),
        }
    }

    /// The state of the generator while it runs: that of its children, with a note. Without a path on the far map, the
    /// planner plans to the goal itself; while it `is_led` by that path, it may arrive at a point of it.
    pub(crate) fn tell(&self, is_led: bool, note: &str, cx: &mut Cycle<'_>) {
        let (planner, follower) = (cx.child(&self.planner), cx.child(&self.follower));
        let failed = [&planner, &follower].into_iter().flatten().find_map(ChildReport::failure);
        let far = cx.child(&self.far_planner).and_then(|report| report.failure().or_else(|| taken(&report)));
        let note = far.map_or(note.to_owned(), |why| format!("{note}; {why}"));
        let follower = follower.as_ref().and_then(taken);
        match (failed, planner) {
            (Some(why), _) => cx.error(format!("{why}{note}")),
            (None, None) => cx.error("there is no planner"),
            (None, Some(planner)) => match taken(&planner) {
                None if planner.state == ChildState::Done && !is_led => cx.done("at the goal"),
                planner_taken => {
                    let text = planner_taken.or(follower).unwrap_or(planner.text);
                    cx.exec(format!("{text}{note}"));
                }
            },
        }
    }
}

/// What is told of a child that obeys the operator instead of the generator.
fn taken(report: &ChildReport) -> Option<String> {
    report.obeys_another.as_ref().map(|another| format!("{} obeys {another}", report.name))
}
