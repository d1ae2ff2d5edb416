//! Rules of dependencies: between our crates, and on crates of others.

use super::assert_kept;
use super::tree::{Declared, Lock, Package, packages, read};

/// Names, or prefixes that end in `-` or `_`, of crates for drawing. Crates below the window must not use them.
const WINDOW_CRATES: [&str; 7] = ["egui", "egui_", "egui-", "eframe", "winit", "wgpu", "wgpu-"];

/// Crates of others that a plugin may use: mathematics, and those for messages, states and errors.
const CRATES_FOR_PLUGINS: [&str; 13] = [
    "bytes",
    "glam",
    "libm",
    "nalgebra",
    "prost",
    "prost-types",
    "rand_chacha",
    "rand_core",
    "rayon",
    "serde",
    "thiserror",
    "toml",
    "image",
];

/// Async runtimes; only `core/link` may bring one in.
const ASYNC_RUNTIMES: [&str; 3] = ["tokio", "async-std", "smol"];

/// Crates of which a second version would bring a second set of incompatible types.
const ONE_IN_THE_TREE: [&str; 4] = ["egui", "wgpu", "prost", "mcap"];

fn is_window_crate(name: &str) -> bool {
    WINDOW_CRATES
        .iter()
        .any(|window| name == *window || (window.ends_with(['-', '_']) && name.starts_with(window)))
}

fn is_plugin(dir: &str) -> bool {
    dir.starts_with("plugins/") && dir != "plugins/all"
}

/// The folders that a package may depend on, as `folder` or `folder/*`; `None` if the package is in no layer.
///
/// The layers: geom ← msg ← {formula, world, scene, bus, log} ← runtime ← sense ← plugins ← all ← {app, tests}; and beside them
/// {msg, formula, world, runtime, ui} ← views ← app, and plugins ← eval ← app. A layer may also use everything below the layers
/// that it depends on.
fn allowed_below(dir: &str) -> Option<&'static [&'static str]> {
    Some(match dir {
        // tools/metrics only computes figures, so that the tests of every layer may use it.
        "core/geom" | "core/msg-build" | "ocu/ui" | "tools/metrics" => &[],
        "core/msg" => &["core/geom", "core/msg-build"],
        "core/scene" => &["core/geom"],
        "core/formula" => &["core/msg"],
        "core/world" | "core/bus" | "core/log" => &["core/geom", "core/msg"],
        // The testkit makes logs and runs stacks; crates below it use it in their tests only.
        "core/testkit" => &["core/msg", "core/msg-build", "core/log", "core/runtime"],
        // The runtime knows no map and no perception.
        "core/runtime" | "core/link" => &["core/geom", "core/msg", "core/formula", "core/bus", "core/log"],
        "core/sense" => &["core/geom", "core/msg", "core/world", "core/bus", "core/runtime"],
        "plugins/all" => &["core/runtime", "plugins/*"],
        "ocu/views" => &["core/geom", "core/msg", "core/formula", "core/world", "core/runtime", "ocu/ui"],
        "tools/eval" => &["core/*", "plugins/*", "tools/metrics"],
        "ocu/app" | "tests" => &["core/*", "plugins/*", "ocu/*", "tools/*"],
        dir if is_plugin(dir) => &[
            "core/geom",
            "core/msg",
            "core/msg-build",
            "core/world",
            "core/scene",
            "core/bus",
            "core/runtime",
            "core/sense",
        ],
        _ => return None,
    })
}

fn against_direction(packages: &[Package]) -> Vec<String> {
    let mut breaches = Vec::new();
    for package in packages {
        let Some(allowed) = allowed_below(&package.dir) else {
            breaches.push(format!("{} is in no layer: give it one in this test", package.dir));
            continue;
        };
        for name in package.dependencies.keys() {
            let Some(target) = packages.iter().find(|other| other.name == *name) else { continue };
            // The testkit is for tests, so it may only be a dev-dependency, except of the package of the tests.
            let fits = allowed.iter().any(|layer| match layer.strip_suffix('*') {
                Some(folder) => target.dir.starts_with(folder) && target.dir != "core/testkit",
                None => target.dir == *layer,
            });
            if !fits {
                breaches.push(format!("{} depends on {}; allowed: {allowed:?}", package.dir, target.dir));
            }
        }
        // Tests of a lower layer may use the testkit, and nothing else from above.
        for name in package.dev_dependencies.keys() {
            let Some(target) = packages.iter().find(|other| other.name == *name) else { continue };
            let in_core = target.dir.starts_with("core/") || target.dir == "tools/metrics";
            let from_above = (package.dir.starts_with("core/") || is_plugin(&package.dir)) && !in_core
                || package.dir == "ocu/views" && target.dir.starts_with("plugins/");
            if from_above {
                breaches.push(format!("tests of {} depend on {}", package.dir, target.dir));
            }
        }
    }
    breaches
}

fn foreign_crates_in_plugins(packages: &[Package]) -> Vec<String> {
    let own = |name: &str| packages.iter().any(|package| package.name == name);
    let mut breaches = Vec::new();
    for plugin in packages.iter().filter(|package| is_plugin(&package.dir)) {
        for name in plugin.dependencies.keys() {
            if !own(name) && !CRATES_FOR_PLUGINS.contains(&name.as_str()) {
                breaches.push(format!("{} depends on {name}; allowed: {CRATES_FOR_PLUGINS:?}", plugin.dir));
            }
        }
    }
    breaches
}

fn windows_below(packages: &[Package], lock: &Lock) -> Vec<String> {
    let below = |dir: &str| dir.starts_with("core/") || dir.starts_with("plugins/");
    let mut breaches = Vec::new();
    for package in packages.iter().filter(|package| below(&package.dir)) {
        let declared = package.all_dependencies().map(|(name, _)| name.to_owned());
        for name in declared.chain(lock.closure(&package.name)).filter(|name| is_window_crate(name)) {
            breaches.push(format!("{} brings in {name}", package.dir));
        }
    }
    breaches
}

fn async_outside_link(packages: &[Package], lock: &Lock) -> Vec<String> {
    let libraries = packages.iter().filter(|package| {
        package.dir != "core/link"
            && (package.dir.starts_with("core/") || package.dir.starts_with("plugins/"))
    });
    let brings = |package: &Package| {
        let closure = lock.closure(&package.name);
        ASYNC_RUNTIMES
            .iter()
            .filter(|name| closure.contains(**name))
            .map(|name| (package.dir.clone(), *name))
            .collect()
    };
    let breaches: Vec<(String, &str)> = libraries.flat_map(|package| -> Vec<_> { brings(package) }).collect();
    breaches.iter().map(|(dir, name)| format!("{dir} brings in {name}")).collect()
}

fn versions_outside_the_workspace(packages: &[Package]) -> Vec<String> {
    let mut breaches = Vec::new();
    for package in packages {
        for (name, declared) in package.all_dependencies() {
            if declared == Declared::InPackage {
                breaches
                    .push(format!("{} declares {name} itself; write {name}.workspace = true", package.dir));
            }
        }
    }
    breaches
}

fn locked_twice(names: &[&str], lock: &Lock) -> Vec<String> {
    let mut breaches = Vec::new();
    for name in names {
        let versions = lock.versions(name);
        if versions.len() > 1 {
            breaches.push(format!("{name} is locked in versions {versions:?}"));
        }
    }
    breaches
}

fn lock() -> Lock {
    Lock::parse(&read("Cargo.lock"))
}

#[test]
fn packages_depend_downwards_only() {
    assert_kept("a package depends on lower layers only", &against_direction(&packages()));
}

#[test]
fn plugins_depend_on_core_and_mathematics_only() {
    assert_kept("a plugin uses core and mathematics", &foreign_crates_in_plugins(&packages()));
}

#[test]
fn no_window_crate_is_reached_from_core_or_plugins() {
    assert_kept("core and plugins draw nothing", &windows_below(&packages(), &lock()));
}

#[test]
fn no_async_runtime_is_reached_from_core_or_plugins_but_link() {
    assert_kept("only core/link has an async runtime", &async_outside_link(&packages(), &lock()));
}

#[test]
fn versions_are_written_in_the_workspace_only() {
    assert_kept("one place for versions", &versions_outside_the_workspace(&packages()));
}

#[test]
fn crates_whose_types_cross_packages_are_locked_once() {
    assert_kept("one version in the tree", &locked_twice(&ONE_IN_THE_TREE, &lock()));
}

/// A workspace of manifests `(dir, name, dependencies, dev-dependencies)`.
fn example(manifests: &[(&str, &str, &[&str], &[&str])]) -> Vec<Package> {
    let entry = |name: &&str| format!("{name}.workspace = true");
    let section = |names: &[&str]| names.iter().map(entry).collect::<Vec<_>>().join("\n");
    let package = |(dir, name, dependencies, dev): &(&str, &str, &[&str], &[&str])| {
        let manifest = format!(
            "[package]\nname = \"{name}\"\n[dependencies]\n{}\n[dev-dependencies]\n{}",
            section(dependencies),
            section(dev)
        );
        Package::parse(dir, &manifest)
    };
    manifests.iter().map(package).collect()
}

#[test]
fn a_dependency_upwards_sideways_or_on_the_testkit_is_found() {
    let packages = example(&[
        ("core/geom", "geom", &["msg"], &["obstacles"]),
        ("core/msg", "msg", &["geom", "testkit"], &["testkit"]),
        ("core/runtime", "runtime", &["msg"], &[]),
        ("core/testkit", "testkit", &[], &[]),
        ("core/stray", "stray", &[], &[]),
        ("plugins/obstacles", "obstacles", &["runtime", "world-model"], &[]),
        ("plugins/world_model", "world-model", &["runtime"], &["obstacles"]),
        ("ocu/views", "views", &["runtime", "obstacles"], &[]),
    ]);
    let breaches = against_direction(&packages);
    let found = |text: &str| breaches.iter().filter(|breach| breach.starts_with(text)).count();
    assert_eq!(found("core/geom depends on core/msg"), 1);
    assert_eq!(found("core/msg depends on core/testkit"), 1);
    assert_eq!(found("core/stray is in no layer"), 1);
    assert_eq!(found("plugins/obstacles depends on plugins/world_model"), 1);
    assert_eq!(found("tests of plugins/world_model depend on plugins/obstacles"), 1);
    assert_eq!(found("tests of core/geom depend on plugins/obstacles"), 1);
    assert_eq!(found("ocu/views depends on plugins/obstacles"), 1);
    assert_eq!(breaches.len(), 7, "{breaches:#?}");
}

#[test]
fn a_plugin_with_a_crate_for_files_is_found() {
    let packages = example(&[("plugins/x", "x", &["glam", "tempfile"], &["proptest"])]);
    assert_eq!(foreign_crates_in_plugins(&packages).len(), 1);
}

#[test]
fn a_window_crate_is_found_at_any_distance() {
    let packages = example(&[("core/x", "x", &["a"], &[]), ("core/y", "y", &[], &["egui_kittest"])]);
    let lock = Lock::parse(
        "[[package]]\nname = \"x\"\nversion = \"1.0.0\"\ndependencies = [\"a\"]\n\
         [[package]]\nname = \"a\"\nversion = \"1.0.0\"\ndependencies = [\"wgpu-core\", \"tokio\"]\n\
         [[package]]\nname = \"y\"\nversion = \"1.0.0\"\n",
    );
    assert_eq!(
        windows_below(&packages, &lock),
        ["core/x brings in wgpu-core", "core/y brings in egui_kittest"]
    );
    assert_eq!(async_outside_link(&packages, &lock), ["core/x brings in tokio"]);
}

#[test]
fn an_own_version_and_a_second_one_are_found() {
    let package =
        Package::parse("core/x", "[package]\nname = \"x\"\n[dependencies]\na = \"1\"\nb.workspace = true\n");
    assert_eq!(versions_outside_the_workspace(&[package]).len(), 1);
    let lock = Lock::parse(
        "[[package]]\nname = \"wgpu\"\nversion = \"30.0.0\"\n[[package]]\nname = \"wgpu\"\nversion = \"29.0.0\"\n",
    );
    assert_eq!(locked_twice(&["wgpu", "egui"], &lock).len(), 1);
}
