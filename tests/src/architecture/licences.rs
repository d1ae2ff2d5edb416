//! Licences of everything that the program is built from, against `deny.toml`: what `cargo deny` checks where it is
//! installed, for machines where it is not.

use super::assert_kept;
use super::tree::{read, root};
use std::process::Command;

/// Licences that `deny.toml` allows.
fn allowed() -> Vec<String> {
    let manifest: toml::Table = read("deny.toml").parse().expect("deny.toml is TOML");
    let list = manifest["licenses"]["allow"].as_array().expect("a list of licences");
    list.iter().map(|name| name.as_str().expect("a licence is a text").to_owned()).collect()
}

/// Licences that `deny.toml` allows for one package alone, by its name.
fn exceptions() -> Vec<(String, Vec<String>)> {
    let manifest: toml::Table = read("deny.toml").parse().expect("deny.toml is TOML");
    let list = manifest["licenses"]["exceptions"].as_array().expect("a list of exceptions");
    let text = |value: &toml::Value| value.as_str().expect("a text").to_owned();
    let entry = |entry: &toml::Value| {
        let licences = entry["allow"].as_array().expect("a list of licences");
        (text(&entry["name"]), licences.iter().map(text).collect())
    };
    list.iter().map(entry).collect()
}

/// Whether an expression of SPDX is satisfied by the licences that are allowed.
fn is_allowed(expression: &str, allowed: &[String]) -> bool {
    // Older packages write `MIT/Apache-2.0`.
    let spaced = expression.replace('(', " ( ").replace(')', " ) ").replace('/', " OR ");
    let tokens: Vec<&str> = spaced.split_whitespace().collect();
    let (value, rest) = any_of(&tokens, allowed);
    value && rest.is_empty()
}

fn any_of<'t>(tokens: &'t [&'t str], allowed: &[String]) -> (bool, &'t [&'t str]) {
    let (mut value, mut rest) = all_of(tokens, allowed);
    while let ["OR", more @ ..] = rest {
        let (other, after) = all_of(more, allowed);
        (value, rest) = (value | other, after);
    }
    (value, rest)
}

fn all_of<'t>(tokens: &'t [&'t str], allowed: &[String]) -> (bool, &'t [&'t str]) {
    let (mut value, mut rest) = one(tokens, allowed);
    while let ["AND", more @ ..] = rest {
        let (other, after) = one(more, allowed);
        (value, rest) = (value & other, after);
    }
    (value, rest)
}

fn one<'t>(tokens: &'t [&'t str], allowed: &[String]) -> (bool, &'t [&'t str]) {
    let is_allowed = |name: &str| allowed.iter().any(|known| known == name);
    match tokens {
        ["(", inner @ ..] => match any_of(inner, allowed) {
            (value, [")", rest @ ..]) => (value, rest),
            (_, rest) => (false, rest),
        },
        [name, "WITH", exception, rest @ ..] => {
            // With an exception there are more rights, not fewer.
            (is_allowed(&format!("{name} WITH {exception}")) || is_allowed(name), rest)
        }
        [name, rest @ ..] => (is_allowed(name), rest),
        [] => (false, tokens),
    }
}

#[test]
fn every_crate_has_a_licence_that_is_allowed() {
    let arguments = [
        "metadata",
        "--format-version",
        "1",
        "--offline",
        "--locked",
        "--filter-platform",
        "x86_64-unknown-linux-gnu",
    ];
    let output =
        Command::new(env!("CARGO")).args(arguments).current_dir(root()).output().expect("cargo runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let metadata: serde_json::Value = serde_json::from_slice(&output.stdout).expect("metadata is JSON");
    let packages = metadata["packages"].as_array().expect("there are packages");
    assert!(packages.len() > 200, "{}", packages.len());
    let (allowed, exceptions) = (allowed(), exceptions());
    let refused = packages.iter().filter_map(|package| {
        let licence = package["license"].as_str().unwrap_or_default();
        let excepted = exceptions.iter().find(|(name, _)| *name == package["name"]);
        let also = excepted.map_or(&[][..], |(_, also)| also);
        (!is_allowed(licence, &[&allowed[..], also].concat()))
            .then(|| format!("{} is under {licence:?}", package["name"]))
    });
    assert_kept("licences are those of deny.toml", &refused.collect::<Vec<_>>());
}

#[test]
fn expressions_are_judged_as_they_read() {
    let allowed = ["MIT", "Apache-2.0", "Unicode-3.0"].map(str::to_owned);
    for good in [
        "MIT",
        "MIT OR GPL-3.0",
        "GPL-3.0/MIT",
        "(MIT OR X) AND Unicode-3.0",
        "Apache-2.0 WITH LLVM-exception",
    ] {
        assert!(is_allowed(good, &allowed), "{good}");
    }
    for bad in ["", "GPL-3.0", "MIT AND GPL-3.0", "(MIT OR X) AND GPL-3.0", "(MIT"] {
        assert!(!is_allowed(bad, &allowed), "{bad}");
    }
}
