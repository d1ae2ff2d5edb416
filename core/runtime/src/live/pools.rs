//! Named pools of threads for parallel work: processes of different pools do not wait for each other.

use super::class;
use crate::pool::Pool;
use crate::stack::{Class, Plan, ProcessPlan};
use std::collections::BTreeMap;
use std::sync::Arc;

/// The pools of a plan. A process without a named pool shares one with the others of its class. A real-time process
/// without one computes on its own thread, because a pool may be busy with other processes.
pub(super) struct Pools {
    own_thread: Arc<Pool>,
    pools: BTreeMap<(Class, String), Arc<Pool>>,
}

impl Pools {
    pub(super) fn new(plan: &Plan, threads: usize) -> Self {
        let mut pools = BTreeMap::new();
        for process in &plan.processes {
            if let Some(key) = key(process) {
                pools.entry(key).or_insert_with_key(|(class, name)| {
                    let (class, name) = (*class, format!("pool {name}"));
                    Arc::new(Pool::starting_with(threads, move || class::apply(class, &name)))
                });
            }
        }
        Self { own_thread: Arc::new(Pool::new(1)), pools }
    }

    pub(super) fn of(&self, process: &ProcessPlan) -> Arc<Pool> {
        let pool = key(process).and_then(|key| self.pools.get(&key));
        Arc::clone(pool.unwrap_or(&self.own_thread))
    }
}

fn key(process: &ProcessPlan) -> Option<(Class, String)> {
    match (&process.pool, process.class) {
        (Some(name), class) => Some((class, name.clone())),
        (None, Class::Realtime) => None,
        (None, class) => Some((class, class.name().to_owned())),
    }
}
