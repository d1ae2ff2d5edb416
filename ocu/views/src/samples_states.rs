//! A frame in which processes have every colour and every light of the hierarchy, and one that a run of them could not
//! show: forty processes.

use super::{empty, topic};
use rcs_formula::{FieldRef, Points};
use rcs_msg::Stamp;
use rcs_msg::rcs::{Command, CommandInfo, PortInfo, ProcessInfo, ProcessState, Status};
use rcs_runtime::source::{FieldSeries, Frame, RunTag, SourceInfo, SourceKind, Topic, series_of};
use std::sync::Arc;

fn port(buffer: &str, required: bool) -> PortInfo {
    PortInfo { name: "data".into(), buffer: buffer.into(), required, ..PortInfo::default() }
}

fn process(name: &str, supervisor: &str, inputs: &[&str], outputs: &[&str]) -> ProcessInfo {
    ProcessInfo {
        name: name.into(),
        supervisor: supervisor.into(),
        summary: format!("does what {name} does"),
        period_ns: 100_000_000,
        status_buffer: format!("/{name}/status"),
        command_buffer: format!("/{name}/command"),
        inputs: inputs.iter().map(|buffer| port(buffer, true)).collect(),
        outputs: outputs.iter().map(|buffer| port(buffer, false)).collect(),
        commands: ["INIT", "RUN", "HALT"]
            .map(|name| CommandInfo { name: name.into(), ..CommandInfo::default() })
            .into(),
        ..ProcessInfo::default()
    }
}

fn status(name: &str, state: ProcessState, text: &str, age_s: f64) -> Topic {
    let message = Status {
        process: name.into(),
        command: "RUN".into(),
        echo_serial: 3,
        state: state.into(),
        state_text: text.into(),
        cycle: 321,
        ..Status::default()
    };
    topic(&format!("/{name}/status"), 10.0, age_s, message)
}

fn command(name: &str, serial: u64, age_s: f64) -> Topic {
    let message = Command { serial, name: "RUN".into(), ..Command::default() };
    topic(&format!("/{name}/command"), 0.0, age_s, message)
}

/// One process in each colour below a supervisor, with lights of several ages, and data between three of them.
pub(crate) fn states() -> Frame {
    use ProcessState::{Done, Error, Exec, Uninitialized};
    let processes = [
        process("supervisor", "viewer", &[], &[]),
        process("executing", "supervisor", &[], &["/executing/data"]),
        process("done", "supervisor", &["/executing/data"], &["/done/data"]),
        process("failed", "supervisor", &["/done/data"], &[]),
        process("stuck", "supervisor", &[], &[]),
        process("killed", "supervisor", &[], &[]),
        process("never_started", "supervisor", &[], &[]),
        process("uninitialized", "supervisor", &[], &[]),
        process("misconfigured", "supervisor", &["/absent/data"], &[]),
        process("orphan", "nobody", &[], &[]),
    ];
    let data = |name: &str| topic(name, 10.0, 0.1, Status::default());
    let topics = vec![
        data("/done/data"),
        data("/executing/data"),
        command("executing", 4, 0.02),
        command("done", 3, 0.3),
        command("failed", 3, 9.0),
        status("supervisor", Exec, "supervises", 0.05),
        status("executing", Exec, "follows the path", 0.05),
        status("done", Done, "has arrived", 0.05),
        status("failed", Error, "no way leads to the goal", 0.25),
        status("stuck", Exec, "computes", 0.6),
        status("killed", Exec, "computed", 30.0),
        status("uninitialized", Uninitialized, "waits for INIT", 0.05),
        status("misconfigured", Exec, "", 0.05),
        status("orphan", Exec, "", 0.05),
    ];
    let base = empty();
    let info = SourceInfo { kind: SourceKind::Stack, ..(*base.info).clone() };
    Frame { topics: topics.into(), processes: processes.into(), info: Arc::new(info), ..base }
}

/// The frame of [`states`] with the commands that the process `executing` was sent in the last ten seconds: echoed in
/// time, late, replaced, lost, and the last one not yet.
pub(crate) fn commands() -> Frame {
    let frame = states();
    let before = |ms: u64| Stamp(frame.now.0 - ms * 1_000_000);
    let series = |path: &str, points: &[(u64, f64)], names: &[(i64, &str)]| {
        let (stamps, values): (Vec<_>, Vec<_>) =
            points.iter().map(|&(ms, value)| (before(ms), value)).unzip();
        let topic = if path == "echo_serial" { "/executing/status" } else { "/executing/command" };
        FieldSeries {
            field: FieldRef { topic: topic.into(), path: path.parse().unwrap() },
            run: RunTag::FIRST,
            points: series_of(&Points::new(stamps, values)),
            names: Arc::new(names.iter().map(|&(key, name)| (key, name.into())).collect()),
            states: Arc::default(),
            reading: None,
            problem: None,
        }
    };
    let sent = [(7900, 1.0), (5500, 2.0), (3600, 3.0), (2000, 4.0), (1900, 5.0), (50, 6.0)];
    let names = [(7900, 0.0), (5500, 1.0), (3600, 1.0), (2000, 1.0), (1900, 2.0), (50, 1.0)];
    let echo = |ms: u64| match ms {
        7850.. => 0.0,
        4800.. => 1.0,
        1850.. => 2.0,
        _ => 5.0,
    };
    let echoes: Vec<(u64, f64)> = (1..95).rev().map(|i| (i * 100, echo(i * 100))).collect();
    let fields = [
        series("serial", &sent, &[]),
        series("name", &names, &[(0, "RUN"), (1, "PLAN_TO"), (2, "HALT")]),
        series("echo_serial", &echoes, &[]),
    ];
    let info = SourceInfo { end: None, ..(*frame.info).clone() };
    Frame { fields: Arc::new(fields), info: Arc::new(info), ..frame }
}

/// Forty processes of four supervisors.
pub(crate) fn forty() -> Frame {
    let mut processes = vec![process("top", "viewer", &[], &[])];
    let mut topics = vec![status("top", ProcessState::Exec, "supervises", 0.05)];
    for i in 1..40 {
        let supervisor = if i <= 3 { "top".to_owned() } else { format!("p{}", 1 + i % 3) };
        let name = format!("p{i}");
        processes.push(process(&name, &supervisor, &[], &[]));
        topics.push(status(&name, ProcessState::Exec, "works", 0.05 + 0.01 * f64::from(i)));
    }
    Frame { topics: topics.into(), processes: processes.into(), ..empty() }
}
