//! The process `supervisor`: commands its children and watches their status.

use crate::proto::SupervisorParams;
use rcs_msg::Stamp;
use rcs_runtime::{
    Child, ChildReport, ChildState, Children, CommandSet, Cycle, NoCommands, Order, PortBuilder, Process,
    ProcessDef,
};
use serde::{Deserialize, Serialize};

rcs_runtime::commands! {
    /// Commands of [`Supervisor`].
    pub enum SupervisorCommand {
        Save = "SAVE" once: "Write what the next run is to remember to its buffers now, and not only every few seconds.",
        Clear = "CLEAR" once: "Forget the maps and what is remembered. What was learned of the terrain around is stated again.",
    }
}

rcs_runtime::commands! {
    /// Commands of a child that has a map.
    pub enum MapCommand {
        Clear = "CLEAR" once: "Forget the map.",
    }
}

rcs_runtime::commands! {
    /// Commands of a child that keeps something from one run to the next.
    pub enum MemoryCommand {
        Save = "SAVE" once: "Write it to its buffer now.",
        Clear = "CLEAR" once: "Forget what is remembered.",
    }
}

/// State: what has been halted, and why, and whether an `INIT` is yet to be passed on.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Supervisor {
    /// Whether the children have not been sent an `INIT` that this supervisor has received.
    initializes: bool,
    /// Why the vehicle interface is to be halted while this supervisor runs.
    stopped: Option<String>,
    /// When `HALT` was last sent to the vehicle interface.
    halting: Option<Stamp>,
    /// Whether the other children have been sent `HALT`, too.
    all_halted: bool,
}

/// Children of [`Supervisor`].
#[derive(Debug)]
pub struct Ports {
    essential: Children,
    vehicle_interface: Child<NoCommands>,
    auxiliary: Children,
    maps: Children<MapCommand>,
    memory: Children<MemoryCommand>,
}

impl Process for Supervisor {
    type Params = SupervisorParams;
    type Ports = Ports;
    type Command = SupervisorCommand;
    const DEF: ProcessDef = ProcessDef {
        plugin: "supervisor",
        summary: "Starts and halts a group of processes, and stops the vehicle when an essential one fails",
        period_ms: 50.0,
        latency_ms: 0.0,
        reads_ground_truth: false,
    };

    fn ports(b: &mut PortBuilder) -> Ports {
        Ports {
            essential: b.children("essential", "children without which the vehicle must not move"),
            vehicle_interface: b.optional_child(
                "vehicle_interface",
                "what moves the vehicle: halted before all others, and when an essential child fails",
            ),
            auxiliary: b.children("auxiliary", "children whose failure is reported, and no more"),
            maps: b.children("maps", "auxiliary children with a map, which CLEAR clears"),
            memory: b.children(
                "memory",
                "auxiliary children that keep a map or a way from one run to the next: SAVE and CLEAR",
            ),
        }
    }

    fn new(_params: &SupervisorParams) -> Self {
        Self::default()
    }

    fn renew(&self, _params: &SupervisorParams) -> Self {
        Self { initializes: true, ..Self::default() }
    }

    fn init(&mut self, ports: &Ports, _params: &SupervisorParams, cx: &mut Cycle<'_>) {
        self.catch_up(ports, cx);
        order(ports, &Order::Init, false, cx);
        await_all(ports, "initialized", cx);
    }

    fn cycle(&mut self, ports: &Ports, _params: &SupervisorParams, cx: &mut Cycle<'_>) {
        self.catch_up(ports, cx);
        let own: Vec<SupervisorCommand> = std::iter::from_fn(|| cx.next_command::<Self>()).collect();
        let is_run = cx.is_new_run();
        if is_run {
            *self = Self::default();
        }
        let to_vehicle_interface = if self.stopped.is_none() { Order::Run } else { Order::Halt };
        order_child(&ports.vehicle_interface, &to_vehicle_interface, is_run, cx);
        order_others(ports, &Order::Run, is_run, cx);
        for command in own {
            pass_on(ports, &command, cx);
        }
        let failed = |child: &Child<NoCommands>| cx.child(child).and_then(|report| report.failure());
        let vehicle_interface = failed(&ports.vehicle_interface);
        let essential =
            vehicle_interface.or_else(|| cx.members(&ports.essential).find_map(|child| failed(&child)));
        let auxiliary = auxiliary(ports, cx).iter().find_map(failed);
        if let Some(why) = &essential
            && self.stopped.is_none()
            && cx.send(&ports.vehicle_interface, Order::Halt)
        {
            self.stopped = Some(why.clone());
        }
        match (&self.stopped, essential, auxiliary.or_else(|| taken(ports, ChildReport::runs_on, cx))) {
            (Some(why), ..) => {
                let text = stop_text(ports, why, cx);
                cx.error(text);
            }
            (None, Some(why), _) => cx.error(why),
            (None, None, Some(what)) => cx.exec(format!("runs; {what}")),
            (None, None, None) => cx.exec("all children run"),
        }
    }

    fn halt(&mut self, ports: &Ports, params: &SupervisorParams, cx: &mut Cycle<'_>) {
        let (now, is_new) = (cx.now(), cx.is_new_command());
        self.catch_up(ports, cx);
        if is_new {
            *self = Self::default();
        }
        if order_child(&ports.vehicle_interface, &Order::Halt, is_new, cx) {
            self.halting = Some(now);
        }
        let stands = match cx.child_state(&ports.vehicle_interface) {
            None | Some(ChildState::Done | ChildState::Error | ChildState::Silent) => true,
            Some(ChildState::Exec | ChildState::Uninitialized) => {
                self.halting.is_some_and(|since| now.seconds_since(since) >= params.halt_timeout_s)
            }
        };
        if !stands && !self.all_halted {
            let text = "waits for the vehicle to stand";
            return match taken(ports, |_| false, cx) {
                Some(what) => cx.exec(format!("{text}; {what}")),
                None => cx.exec(text),
            };
        }
        order_others(ports, &Order::Halt, !self.all_halted, cx);
        self.all_halted = true;
        await_all(ports, "halted", cx);
    }
}

impl Supervisor {
    /// Sends the children the `INIT` after which another command came within the same period.
    fn catch_up(&mut self, ports: &Ports, cx: &mut Cycle<'_>) {
        if std::mem::take(&mut self.initializes) {
            order(ports, &Order::Init, true, cx);
        }
    }
}

/// Sends an order to all children: see [`order_child`].
fn order(ports: &Ports, order: &Order<NoCommands>, is_new: bool, cx: &mut Cycle<'_>) {
    order_child(&ports.vehicle_interface, order, is_new, cx);
    order_others(ports, order, is_new, cx);
}

/// Sends an order to all children except the vehicle interface.
fn order_others(ports: &Ports, order: &Order<NoCommands>, is_new: bool, cx: &mut Cycle<'_>) {
    for child in others(ports, cx) {
        order_child(&child, order, is_new, cx);
    }
}

/// Sends an order to a child: in the cycle in which the supervisor received it, and later when the operator no longer has
/// a child that does not obey it. `RUN` is not sent again to one that runs by a command of its own: it would end that
/// command, such as a limit of the speed. Returns whether it was sent.
fn order_child(
    child: &Child<NoCommands>,
    order: &Order<NoCommands>,
    is_new: bool,
    cx: &mut Cycle<'_>,
) -> bool {
    let is_halt = matches!(order, Order::Halt);
    let is_run = matches!(order, Order::Run);
    let again =
        |report: ChildReport| report.is_ordered_again(is_halt) && !(is_run && report.own_command.is_some());
    (is_new || cx.child(child).is_some_and(again)) && cx.send(child, order.clone())
}

/// Whether the vehicle interface obeys the `HALT` that is sent to it for this reason.
fn stop_text(ports: &Ports, why: &str, cx: &Cycle<'_>) -> String {
    match cx.child(&ports.vehicle_interface) {
        Some(report) if report.obeys_last => format!("has stopped the vehicle: {why}"),
        Some(report) if report.is_overruled => {
            format!("cannot stop the vehicle, because the operator has taken {}: {why}", report.name)
        }
        _ => format!("stops the vehicle: {why}"),
    }
}

/// All children except the vehicle interface.
fn others(ports: &Ports, cx: &Cycle<'_>) -> Vec<Child<NoCommands>> {
    cx.members(&ports.essential).chain(auxiliary(ports, cx)).collect()
}

/// The children whose failure is reported, and no more.
fn auxiliary(ports: &Ports, cx: &Cycle<'_>) -> Vec<Child<NoCommands>> {
    let maps = cx.members(&ports.maps).map(|child| child.plain());
    let memory = cx.members(&ports.memory).map(|child| child.plain());
    cx.members(&ports.auxiliary).chain(maps).chain(memory).collect()
}

/// Passes a command of its own on to the children that remember, and to those with maps.
fn pass_on(ports: &Ports, command: &SupervisorCommand, cx: &mut Cycle<'_>) {
    let reached = match command {
        SupervisorCommand::Save => tell(&ports.memory, &MemoryCommand::Save, cx),
        SupervisorCommand::Clear => {
            let memory = tell(&ports.memory, &MemoryCommand::Clear, cx);
            tell(&ports.maps, &MapCommand::Clear, cx) || memory
        }
    };
    if !reached {
        cx.fault(format!("{}: no child has a map", command.encode().name));
    }
}

/// Tells all children of a set. Whether there is one.
fn tell<C: CommandSet + Clone>(children: &Children<C>, command: &C, cx: &mut Cycle<'_>) -> bool {
    let mut is_any = false;
    for child in cx.members(children) {
        is_any |= cx.send(&child, command.clone());
    }
    is_any
}

/// All children as this supervisor sees them.
fn reports(ports: &Ports, cx: &Cycle<'_>) -> Vec<ChildReport> {
    let children = [ports.vehicle_interface].into_iter().chain(others(ports, cx));
    children.filter_map(|child| cx.child(&child)).collect()
}

/// The children that obey the operator, or do not obey their order because the operator has taken them. Those that do
/// `as_ordered` all the same are left out.
fn taken(ports: &Ports, as_ordered: impl Fn(&ChildReport) -> bool, cx: &Cycle<'_>) -> Option<String> {
    let what = |report: &ChildReport| match &report.obeys_another {
        _ if as_ordered(report) => None,
        Some(who) => Some(format!("{} obeys {who}", report.name)),
        None => report.is_overruled.then(|| format!("the operator has taken {}", report.name)),
    };
    let taken: Vec<String> = reports(ports, cx).iter().filter_map(what).collect();
    (!taken.is_empty()).then(|| taken.join(", "))
}

/// `DONE` when all children that obey this supervisor have completed their order; the text names the others.
fn await_all(ports: &Ports, done: &str, cx: &mut Cycle<'_>) {
    let reports = reports(ports, cx);
    if let Some(why) = reports.iter().find_map(ChildReport::failure) {
        return cx.error(why);
    }
    let waits = |report: &&ChildReport| report.state != ChildState::Done && report.obeys_another.is_none();
    match (reports.iter().find(waits), taken(ports, |_| false, cx)) {
        (Some(report), Some(what)) => cx.exec(format!("waits for {}; {what}", report.name)),
        (Some(report), None) => cx.exec(format!("waits for {}", report.name)),
        (None, Some(what)) => cx.done(format!("all other children are {done}; {what}")),
        (None, None) => cx.done(format!("all children are {done}")),
    }
}
