//! Checks the invariants of `ARCHITECTURE.md` on the manifests, the lock file and the sources.
//!
//! Every rule is a function from its input to a list of violations. Each rule also has a test with a violation that it
//! must find, because a rule that cannot fail protects nothing.

mod circles;
mod code;
mod dependencies;
mod licences;
mod lists;
mod port_tables;
mod references;
mod sources;
mod tree;

/// Fails with one line per violation.
fn assert_kept(rule: &str, breaches: &[String]) {
    assert!(breaches.is_empty(), "{rule}: {} breaches\n{}", breaches.len(), breaches.join("\n"));
}
