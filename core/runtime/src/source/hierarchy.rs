//! The hierarchy of processes, found from who writes whose command and status, and their peers, from who reads whose data
//! (Albus 2006a, 6.2). For any stack, and for a log at any time: of a log that describes no processes the nodes are the
//! writers that its channels name.

use super::frame::Topic;
use rcs_msg::channel::WRITER;
use rcs_msg::rcs::ProcessInfo;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Keys of a channel that name its writer, in logs of other programs.
pub(super) const WRITER_KEYS: [&str; 4] = [WRITER, "callerid", "node", "publisher"];

/// A buffer as the hierarchy needs it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct BufferInfo {
    /// Its name.
    pub name: Arc<str>,
    /// Type of its messages.
    pub type_name: Arc<str>,
    /// The process that writes it, or several, separated by commas; empty if unknown.
    pub writer: Arc<str>,
}

impl BufferInfo {
    /// A topic of a frame.
    pub fn of(topic: &Topic) -> Self {
        Self::new(&topic.name, topic.type_name(), &topic.writer, &topic.metadata)
    }

    /// A channel of a log.
    pub fn new(name: &str, type_name: &str, writer: &str, metadata: &BTreeMap<String, String>) -> Self {
        let said = WRITER_KEYS.iter().find_map(|key| metadata.get(*key)).map_or("", String::as_str);
        let writer = if writer.is_empty() { said } else { writer };
        Self { name: name.into(), type_name: type_name.into(), writer: writer.into() }
    }
}

/// A process, or somebody outside who writes buffers.
#[derive(Clone, Debug, PartialEq)]
pub struct Node {
    /// Its name.
    pub name: Arc<str>,
    /// Index of its supervisor; `None` at the top.
    pub supervisor: Option<usize>,
    /// Its description, as an index into the list of processes; `None` if it has none.
    pub process: Option<usize>,
    /// Nodes between it and the top.
    pub depth: usize,
    /// Buffers of its commands and its status; empty if unknown.
    pub command: Arc<str>,
    /// See `command`.
    pub status: Arc<str>,
    /// Buffers that it reads and nobody writes, although they are required: the configuration does not match.
    pub unwritten: Vec<Arc<str>>,
}

/// A buffer of data from a process to another.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Peer {
    /// Index of the writer.
    pub from: usize,
    /// Index of the reader.
    pub to: usize,
    /// Name of the buffer.
    pub buffer: Arc<str>,
}

/// Processes, who supervises whom, and who reads whose data.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Hierarchy {
    /// Each supervisor before its subordinates, otherwise in the order of the descriptions.
    pub nodes: Vec<Node>,
    /// Between processes of which neither supervises the other by this buffer.
    pub peers: Vec<Peer>,
}

impl Hierarchy {
    /// The hierarchy of these processes and buffers. `are_all` says whether no other buffer exists, as of a stack; a
    /// recording may lack some.
    pub fn new(processes: &[ProcessInfo], buffers: &[BufferInfo], are_all: bool) -> Self {
        let mut found = Self::default();
        for (index, info) in processes.iter().enumerate() {
            found.nodes.push(Node {
                name: info.name.as_str().into(),
                supervisor: None,
                process: Some(index),
                depth: 0,
                command: info.command_buffer.as_str().into(),
                status: info.status_buffer.as_str().into(),
                unwritten: unwritten(info, buffers, are_all),
            });
        }
        for buffer in buffers.iter().filter(|buffer| !buffer.writer.is_empty()) {
            // Otherwise the descriptions name who writes; the runtime and the operator write into a run from outside.
            if processes.is_empty() {
                buffer.writer.split(',').for_each(|writer| found.add_writer(writer.trim(), buffer));
            }
        }
        found.supervise(processes, buffers);
        found.sort();
        found.find_peers(processes);
        found
    }

    /// Index of the node with a name.
    pub fn index_of(&self, name: &str) -> Option<usize> {
        self.nodes.iter().position(|node| *node.name == *name)
    }

    /// Adds one of those who write a buffer.
    fn add_writer(&mut self, writer: &str, buffer: &BufferInfo) {
        let index = self.index_of(writer).unwrap_or_else(|| {
            self.nodes.push(Node {
                name: writer.into(),
                supervisor: None,
                process: None,
                depth: 0,
                command: "".into(),
                status: "".into(),
                unwritten: Vec::new(),
            });
            self.nodes.len() - 1
        });
        if &*buffer.type_name == "rcs.Status" {
            self.nodes[index].status = Arc::clone(&buffer.name);
            // By convention the command is beside the status.
            if let Some(base) = buffer.name.strip_suffix("/status") {
                self.nodes[index].command = format!("{base}/command").into();
            }
        }
    }

    /// Finds the supervisor of each node: who writes its command, else who its description names.
    fn supervise(&mut self, processes: &[ProcessInfo], buffers: &[BufferInfo]) {
        for index in 0..self.nodes.len() {
            let node = &self.nodes[index];
            let by_port = processes.iter().position(|other| {
                !node.command.is_empty() && other.outputs.iter().any(|port| port.buffer == *node.command)
            });
            let written = || {
                let command =
                    buffers.iter().find(|buffer| !node.command.is_empty() && buffer.name == node.command)?;
                self.index_of(&command.writer)
            };
            let named = || self.index_of(&processes[node.process?].supervisor);
            let supervisor =
                by_port.or_else(written).or_else(named).filter(|&supervisor| supervisor != index);
            self.nodes[index].supervisor = supervisor;
        }
        // Processes that supervise each other in a circle have none.
        for index in 0..self.nodes.len() {
            let mut above = self.nodes[index].supervisor;
            for _ in 0..self.nodes.len() {
                above = above.and_then(|above| self.nodes[above].supervisor);
            }
            if above.is_some() {
                self.nodes[index].supervisor = None;
            }
        }
    }

    /// Puts each supervisor before its subordinates.
    fn sort(&mut self) {
        let mut order = Vec::with_capacity(self.nodes.len());
        let mut open: Vec<(usize, usize)> = Vec::new();
        let below = |nodes: &[Node], of: Option<usize>| -> Vec<usize> {
            (0..nodes.len()).filter(|&index| nodes[index].supervisor == of).collect()
        };
        open.extend(below(&self.nodes, None).into_iter().rev().map(|index| (index, 0)));
        while let Some((index, depth)) = open.pop() {
            self.nodes[index].depth = depth;
            order.push(index);
            open.extend(below(&self.nodes, Some(index)).into_iter().rev().map(|below| (below, depth + 1)));
        }
        let mut place = vec![0; order.len()];
        order.iter().enumerate().for_each(|(new, &old)| place[old] = new);
        let nodes = order.iter().map(|&old| {
            let node = self.nodes[old].clone();
            Node { supervisor: node.supervisor.map(|supervisor| place[supervisor]), ..node }
        });
        self.nodes = nodes.collect();
    }

    fn find_peers(&mut self, processes: &[ProcessInfo]) {
        let mut peers = Vec::new();
        for (to, reader) in self.nodes.iter().enumerate() {
            let Some(reader_info) = reader.process.map(|index| &processes[index]) else { continue };
            for port in &reader_info.inputs {
                for (from, writer) in self.nodes.iter().enumerate() {
                    let Some(info) = writer.process.map(|index| &processes[index]) else { continue };
                    let writes = info.outputs.iter().any(|output| output.buffer == port.buffer);
                    let is_command = *reader.command == *port.buffer || *writer.status == *port.buffer;
                    if from != to && writes && !is_command {
                        peers.push(Peer { from, to, buffer: port.buffer.as_str().into() });
                    }
                }
            }
        }
        peers.sort();
        peers.dedup();
        self.peers = peers;
    }

    /// As an indented text: each process below its supervisor, then the buffers between peers.
    pub fn to_text(&self) -> String {
        use std::fmt::Write as _;
        let mut text = String::new();
        for (index, node) in self.nodes.iter().enumerate() {
            let _ = writeln!(text, "{}{}", self.branches(index), node.name);
            for buffer in &node.unwritten {
                let _ =
                    writeln!(text, "{}  nobody writes its required input {buffer}", "   ".repeat(node.depth));
            }
        }
        if !self.peers.is_empty() {
            text.push_str("\npeers\n");
        }
        let name = |index: usize| &self.nodes[index].name;
        let width = self.peers.iter().map(|peer| name(peer.from).chars().count()).max().unwrap_or(0);
        for peer in &self.peers {
            let _ = writeln!(text, "{:<width$} → {}  {}", name(peer.from), name(peer.to), peer.buffer);
        }
        text
    }

    /// The lines in front of a node in the text.
    fn branches(&self, index: usize) -> String {
        let is_last = |index: usize| {
            let supervisor = self.nodes[index].supervisor;
            !self.nodes[index + 1..].iter().any(|node| node.supervisor == supervisor)
        };
        let mut text = String::new();
        let mut at = index;
        while let Some(above) = self.nodes[at].supervisor {
            let part = match (at == index, is_last(at)) {
                (true, true) => "└─ ",
                (true, false) => "├─ ",
                (false, true) => "   ",
                (false, false) => "│  ",
            };
            text.insert_str(0, part);
            at = above;
        }
        text
    }

    /// As a graph in the language DOT: solid lines of command and status, dashed ones of data between peers.
    pub fn to_dot(&self) -> String {
        use std::fmt::Write as _;
        let quoted = |text: &str| format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\""));
        let mut text = String::from("digraph hierarchy {\n  node [shape=box];\n");
        for node in &self.nodes {
            let _ = writeln!(text, "  {};", quoted(&node.name));
        }
        for node in &self.nodes {
            if let Some(supervisor) = node.supervisor {
                let (above, below) = (quoted(&self.nodes[supervisor].name), quoted(&node.name));
                let _ = writeln!(text, "  {above} -> {below} [dir=both];");
            }
        }
        for peer in &self.peers {
            let (from, to) = (quoted(&self.nodes[peer.from].name), quoted(&self.nodes[peer.to].name));
            let label = quoted(&peer.buffer);
            let _ = writeln!(text, "  {from} -> {to} [style=dashed, constraint=false, label={label}];");
        }
        text.push_str("}\n");
        text
    }
}

/// The required inputs of a process that nobody writes.
fn unwritten(info: &ProcessInfo, buffers: &[BufferInfo], are_all: bool) -> Vec<Arc<str>> {
    let required = info.inputs.iter().filter(|port| port.required && port.role.is_empty());
    let absent = required.filter(|port| {
        port.buffer.is_empty() || (are_all && !buffers.iter().any(|buffer| *buffer.name == *port.buffer))
    });
    absent
        .map(|port| if port.buffer.is_empty() { port.name.as_str() } else { port.buffer.as_str() }.into())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcs_msg::rcs::PortInfo;

    fn port(buffer: &str) -> PortInfo {
        PortInfo { name: buffer.into(), buffer: buffer.into(), ..PortInfo::default() }
    }

    fn process(name: &str, supervisor: &str, inputs: &[&str], outputs: &[&str]) -> ProcessInfo {
        ProcessInfo {
            name: name.into(),
            supervisor: supervisor.into(),
            command_buffer: format!("/{name}/command"),
            status_buffer: format!("/{name}/status"),
            inputs: inputs.iter().map(|buffer| port(buffer)).collect(),
            outputs: outputs.iter().map(|buffer| port(buffer)).collect(),
            ..ProcessInfo::default()
        }
    }

    #[test]
    fn supervisors_are_found_by_who_writes_the_command_and_peers_by_data() {
        let processes = [
            process("stereo", "viewer", &[], &["/stereo/depth"]),
            process("wm1", "stereo", &["/stereo/depth"], &["/wm1/map"]),
            process("top", "", &["/stereo/status", "/wm1/map"], &["/stereo/command", "/wm1/command"]),
        ];
        let found = Hierarchy::new(&processes, &[], false);
        assert_eq!(
            found.to_text(),
            "top\n├─ stereo\n└─ wm1\n\npeers\nstereo → wm1  /stereo/depth\nwm1    → top  /wm1/map\n"
        );
        let dot = found.to_dot();
        assert!(dot.contains("\"top\" -> \"wm1\" [dir=both];"), "{dot}");
        assert!(
            dot.contains("\"stereo\" -> \"wm1\" [style=dashed, constraint=false, label=\"/stereo/depth\"];")
        );
    }

    #[test]
    fn a_log_without_descriptions_shows_the_writers_that_it_names() {
        let says = |name: &str, type_name: &str, key: &str, writer: &str| {
            BufferInfo::new(name, type_name, "", &[(key.to_owned(), writer.to_owned())].into())
        };
        let buffers = [
            says("/scan", "sensor_msgs/msg/LaserScan", "callerid", "/lidar"),
            says("/cmd_vel", "geometry_msgs/msg/Twist", "callerid", "/planner"),
            says("/tf", "tf2_msgs/msg/TFMessage", "callerid", "/lidar, /slam"),
            says("/arm/status", "rcs.Status", "rcs.writer", "arm"),
            says("/arm/command", "rcs.Command", "rcs.writer", "/planner"),
        ];
        assert_eq!(Hierarchy::new(&[], &buffers, false).to_text(), "/lidar\n/planner\n└─ arm\n/slam\n");
    }

    #[test]
    fn processes_that_supervise_each_other_are_listed_once() {
        let processes =
            [process("a", "b", &[], &[]), process("b", "a", &[], &[]), process("self", "self", &[], &[])];
        assert_eq!(Hierarchy::new(&processes, &[], false).nodes.len(), 3);
    }

    #[test]
    fn a_required_input_that_nobody_writes_is_told() {
        let mut reader = process("reader", "", &["/absent", "/there"], &[]);
        reader.inputs.iter_mut().for_each(|port| port.required = true);
        let there = BufferInfo { name: "/there".into(), ..BufferInfo::default() };
        let found = Hierarchy::new(&[reader], &[there], true);
        assert_eq!(found.nodes[0].unwritten, [Arc::from("/absent")]);
    }
}
