//! The invariants of `ARCHITECTURE.md`, checked on the manifests, the lock file and the sources as they stand.
//!
//! Every rule is a function from what it looks at to a list of breaches, so that each is also shown a breach of its
//! own and must find it: a rule that cannot fail keeps nothing.

mod code;
mod dependencies;
mod lists;
mod port_tables;
mod references;
mod sources;
mod tree;

/// Fails with every breach on a line of its own.
fn assert_kept(rule: &str, breaches: &[String]) {
    assert!(breaches.is_empty(), "{rule}: {} breaches\n{}", breaches.len(), breaches.join("\n"));
}
