//! Processes, parameters, stacks, the two executors, snapshots and the source interface.
