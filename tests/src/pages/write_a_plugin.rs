//! `docs/write-a-plugin.md`: the stack that it builds is accepted.

use super::read;
use crate::bundled::Repository;
use rcs_msg::foxglove::{Grid, Odometry};
use rcs_runtime::{
    Assets, Cycle, In, NoCommands, Out, Plan, PlanOptions, PortBuilder, Process, ProcessDef, ProcessType,
    Role, StackFile,
};
use rcs_testkit::proto::SlopeCostParams;
use serde::{Deserialize, Serialize};
use toml::Table;

/// The plugin of the page, which computes nothing here.
#[derive(Clone, Serialize, Deserialize)]
struct SlopeCost;

impl Process for SlopeCost {
    type Params = SlopeCostParams;
    type Ports = (In<Odometry>, Out<Grid>);
    type Command = NoCommands;
    const DEF: ProcessDef = ProcessDef {
        plugin: "slope_cost",
        summary: "Is declared.",
        period_ms: 100.0,
        latency_ms: 0.0,
        reads_ground_truth: false,
    };

    fn ports(b: &mut PortBuilder) -> Self::Ports {
        let odometry = b.input("odometry", "motion of the vehicle, m/s");
        (odometry, b.output("cost", "cost of the ground around the vehicle").role(Role::Cost).build())
    }

    fn new(_params: &Self::Params) -> Self {
        Self
    }

    fn cycle(&mut self, _ports: &Self::Ports, _params: &Self::Params, _cx: &mut Cycle<'_>) {}
}

/// The blocks of TOML in a page, in their order.
fn toml_blocks(page: &str) -> Vec<Table> {
    let fenced = page.split("```toml\n").skip(1).filter_map(|rest| rest.split("```").next());
    fenced.map(|block| toml::from_str(block).unwrap_or_else(|error| panic!("{error}: {block}"))).collect()
}

#[test]
fn the_stack_of_the_page_is_accepted_and_the_world_model_reads_its_costs() {
    let blocks = toml_blocks(&read("docs/write-a-plugin.md"));
    let [process, world_model] = blocks.as_slice() else { panic!("{} blocks of TOML", blocks.len()) };

    let simulation = Repository.read("stack", "simulation", "").unwrap();
    let file = StackFile::compose(&simulation.file, &simulation.text, &Repository).unwrap();
    let mut mine: Table = toml::from_str(&file.text).unwrap();
    let processes = mine["process"].as_array_mut().unwrap();
    let wm1 = processes.iter_mut().find(|process| process["name"].as_str() == Some("wm1")).unwrap();
    let inputs = world_model["process"]["inputs"].as_table().unwrap().clone();
    wm1["inputs"].as_table_mut().unwrap().extend(inputs);
    let sources = world_model["process"]["params"]["sources"].as_array().unwrap().iter().cloned();
    wm1["params"]["sources"].as_array_mut().unwrap().extend(sources);
    processes.extend(process["process"].as_array().unwrap().iter().cloned());

    let plugins = [rcs_plugins::all(), &[ProcessType::of::<SlopeCost>()]].concat();
    let options = PlanOptions { overrides: &[], course: None, assets: &Repository };
    let file = StackFile::parse("mine.toml", &mine.to_string()).unwrap();
    let plan = Plan::with(file, &plugins, &options).unwrap_or_else(|error| panic!("{error}"));
    let wm1 = plan.processes.iter().find(|process| &*process.name == "wm1").unwrap();
    let costs = wm1.kind.inputs().iter().position(|port| port.name == "costs").unwrap();
    assert_eq!(plan.buffers[wm1.inputs[costs].unwrap()].spec.name, "/slope_cost/cost");
}
