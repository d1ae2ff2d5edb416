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
        Save = "SAVE": "Save the map memory now.",
        Clear = "CLEAR": "Forget the maps and the map memory.",
    }
}

rcs_runtime::commands! {
    /// Commands of a child that has a map.
    pub enum MapCommand {
        Clear = "CLEAR": "Forget the map.",
    }
}

rcs_runtime::commands! {
    /// Commands of a child that keeps a map from one run to the next.
    pub enum MemoryCommand {
        Save = "SAVE": "Save the map now.",
        Clear = "CLEAR": "Forget the remembered map.",
    }
}

/// State: whether the children have been told to run, what has been halted, and why.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Supervisor {
    runs: bool,
    /// Why the vehicle interface was halted while this supervisor runs.
    stopped: Option<String>,
    /// When `HALT` was sent to the vehicle interface.
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
                "auxiliary children that keep a map from one run to the next: SAVE and CLEAR",
            ),
        }
    }

    fn new(_params: &SupervisorParams) -> Self {
        Self::default()
    }

    fn init(&mut self, ports: &Ports, _params: &SupervisorParams, cx: &mut Cycle<'_>) {
        if cx.is_new_command() {
            *self = Self::default();
        }
        order(ports, &Order::Init, cx.is_new_command(), cx);
        match await_all(ports, cx) {
            Wait::Done => cx.done("all children are initialized"),
            Wait::For(name) => cx.exec(format!("waits for {name}")),
            Wait::Failed(why) => cx.error(why),
        }
    }

    fn cycle(&mut self, ports: &Ports, _params: &SupervisorParams, cx: &mut Cycle<'_>) {
        let own: Vec<SupervisorCommand> = std::iter::from_fn(|| cx.next_command::<Self>()).collect();
        let is_run = cx.is_new_command() && (own.is_empty() || !self.runs);
        if is_run {
            *self = Self { runs: true, ..Self::default() };
        }
        if self.stopped.is_none() {
            order(ports, &Order::Run, is_run, cx);
        } else {
            order_others(ports, &Order::Run, is_run, cx);
        }
        for command in own {
            pass_on(ports, &command, cx);
        }
        let failed = |child: &Child<NoCommands>| cx.child(child).and_then(|report| failure(&report));
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
        match (&self.stopped, essential, auxiliary.or_else(|| taken(ports, cx))) {
            (Some(why), ..) => cx.error(format!("has stopped the vehicle: {why}")),
            (None, Some(why), _) => cx.error(why),
            (None, None, Some(what)) => cx.exec(format!("runs; {what}")),
            (None, None, None) => cx.exec("all children run"),
        }
    }

    fn halt(&mut self, ports: &Ports, params: &SupervisorParams, cx: &mut Cycle<'_>) {
        let now = cx.now();
        if cx.is_new_command() {
            *self = Self { halting: Some(now), ..Self::default() };
            cx.send(&ports.vehicle_interface, Order::Halt);
        }
        let stands = match cx.child_state(&ports.vehicle_interface) {
            None | Some(ChildState::Done | ChildState::Error | ChildState::Silent) => true,
            Some(ChildState::Exec | ChildState::Uninitialized) => {
                self.halting.is_some_and(|since| now.seconds_since(since) >= params.halt_timeout_s)
            }
        };
        if !stands && !self.all_halted {
            return cx.exec("waits for the vehicle to stand");
        }
        if !self.all_halted {
            self.all_halted = true;
            for child in others(ports, cx) {
                cx.send(&child, Order::Halt);
            }
        }
        match await_all(ports, cx) {
            Wait::Done => cx.done("all children are halted"),
            Wait::For(name) => cx.exec(format!("waits for {name}")),
            Wait::Failed(why) => cx.error(why),
        }
    }
}

/// Sends an order to all children: in the cycle in which the supervisor received it, and later to children that the
/// operator gives back.
fn order(ports: &Ports, order: &Order<NoCommands>, is_new: bool, cx: &mut Cycle<'_>) {
    if wants_order(&ports.vehicle_interface, is_new, cx) {
        cx.send(&ports.vehicle_interface, order.clone());
    }
    order_others(ports, order, is_new, cx);
}

/// Sends an order to all children except the vehicle interface.
fn order_others(ports: &Ports, order: &Order<NoCommands>, is_new: bool, cx: &mut Cycle<'_>) {
    for child in others(ports, cx) {
        if wants_order(&child, is_new, cx) {
            cx.send(&child, order.clone());
        }
    }
}

fn wants_order(child: &Child<NoCommands>, is_new: bool, cx: &Cycle<'_>) -> bool {
    is_new || cx.child(child).is_some_and(|report| report.is_ours && report.obeys_another.is_some())
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

/// Passes a command of its own on to the children with maps.
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

/// Name of a child that is not under this supervisor's authority.
fn taken(ports: &Ports, cx: &Cycle<'_>) -> Option<String> {
    let children = [ports.vehicle_interface].into_iter().chain(others(ports, cx));
    let mut reports = children.filter_map(|child| cx.child(&child));
    reports.find_map(|report| report.obeys_another.map(|who| format!("{} obeys {who}", report.name)))
}

/// Whether all children have completed their order.
enum Wait {
    Done,
    For(String),
    Failed(String),
}

fn await_all(ports: &Ports, cx: &Cycle<'_>) -> Wait {
    let children = [ports.vehicle_interface].into_iter().chain(others(ports, cx));
    let reports: Vec<ChildReport> = children.filter_map(|child| cx.child(&child)).collect();
    if let Some(why) = reports.iter().find_map(failure) {
        return Wait::Failed(why);
    }
    let waits = |report: &&ChildReport| report.state != ChildState::Done && report.obeys_another.is_none();
    match reports.iter().find(waits) {
        Some(report) => Wait::For(report.name.to_string()),
        None => Wait::Done,
    }
}

/// What is wrong with a child: its name and its reason.
fn failure(report: &ChildReport) -> Option<String> {
    let word = match report.state {
        ChildState::Error => "is in ERROR",
        ChildState::Silent => "is silent",
        ChildState::Uninitialized | ChildState::Exec | ChildState::Done => return None,
    };
    Some(format!("{} {word}: {}", report.name, report.text))
}
