//! Rules of sources: names that they must not use, and their length.

use super::assert_kept;
use super::code::{code_only, lines_with};
use super::tree::{Source, sources};

/// Prefixes of paths that belong to the window.
const WINDOW_NAMES: [&str; 4] = ["egui", "eframe", "winit", "wgpu"];

/// Names that would make a plugin's output depend on more than its inputs, parameters and seed.
const IMPURE_NAMES: [&str; 22] = [
    "std::fs",
    "fs::File",
    "std::net",
    "std::process",
    "std::env",
    "env::var",
    "Instant::now",
    "SystemTime",
    "std::thread",
    "thread::spawn",
    "thread::sleep",
    "thread::scope",
    "thread_local!",
    "static mut",
    "OnceLock",
    "LazyLock",
    "RandomState",
    "thread_rng",
    "from_entropy",
    "from_os_rng",
    "OsRng",
    "rand::random",
];

/// Types with interior mutability. A process's state must not contain any: a snapshot shares what is behind an `Arc`
/// with the run, and would change with it.
const INTERIOR_MUTABILITY: [&str; 19] = [
    "Cell<",
    "cell::Cell",
    "RefCell",
    "UnsafeCell",
    "OnceCell",
    "LazyCell",
    "Mutex",
    "RwLock",
    "OnceLock",
    "LazyLock",
    "Condvar",
    "AtomicBool",
    "AtomicU8",
    "AtomicU32",
    "AtomicI32",
    "AtomicU64",
    "AtomicI64",
    "AtomicUsize",
    "std::sync::atomic",
];

/// Uses outside of any state: file, name and reason.
const NO_STATE: [(&str, &str, &str); 1] =
    [("plugins/sim/src/spec/reader.rs", "RefCell", "a parser that ends before the state begins")];

/// Functions of `f32` and `f64` whose last bits depend on the system; those of `libm` do not.
const SYSTEM_FUNCTIONS: [&str; 27] = [
    "sin", "cos", "tan", "sin_cos", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh", "asinh",
    "acosh", "atanh", "exp", "exp2", "exp_m1", "ln", "ln_1p", "log2", "log10", "powf", "powi", "cbrt",
    "hypot", "gamma", "ln_gamma",
];

/// A file of this many lines has more than one job.
const LONGEST_FILE: usize = 600;

fn named(sources: &[Source], names: &[&str]) -> Vec<String> {
    let mut breaches = Vec::new();
    for source in sources {
        let code = code_only(&source.text);
        for name in names {
            let lines = lines_with(&code, name);
            breaches.extend(lines.iter().map(|line| format!("{}:{line}: {name}", source.path)));
        }
    }
    breaches
}

/// Interior mutability outside of [`NO_STATE`].
fn interior_mutability(sources: &[Source]) -> Vec<String> {
    let mut breaches = named(sources, &INTERIOR_MUTABILITY);
    let is_exception = |breach: &String| {
        NO_STATE
            .iter()
            .any(|(path, name, _)| breach.starts_with(path) && breach.ends_with(&format!(": {name}")))
    };
    breaches.retain(|breach| !is_exception(breach));
    breaches
}

/// Matches crates written as `egui` and as `egui_tiles`.
fn window_names(sources: &[Source]) -> Vec<String> {
    let mut breaches = Vec::new();
    for source in sources {
        for (at, line) in code_only(&source.text).lines().enumerate() {
            let mut words = line.split(|c: char| !(c.is_alphanumeric() || c == '_'));
            if let Some(word) = words.find(|word| WINDOW_NAMES.iter().any(|name| word.starts_with(name))) {
                breaches.push(format!("{}:{}: {word}", source.path, at + 1));
            }
        }
    }
    breaches
}

/// The source without the tests at its end, which do not affect results.
fn without_tests(source: &Source) -> Source {
    let tests = source.text.find("#[cfg(test)]\nmod ").unwrap_or(source.text.len());
    Source { path: source.path.clone(), text: source.text[..tests].to_owned() }
}

fn system_functions(sources: &[Source]) -> Vec<String> {
    let written = SYSTEM_FUNCTIONS
        .iter()
        .flat_map(|name| [format!(".{name}("), format!("f64::{name}"), format!("f32::{name}")]);
    let written: Vec<String> = written.collect();
    let sources: Vec<Source> = sources.iter().map(without_tests).collect();
    named(&sources, &written.iter().map(String::as_str).collect::<Vec<_>>())
}

fn too_long(sources: &[Source]) -> Vec<String> {
    let long = sources.iter().filter(|source| source.text.lines().count() > LONGEST_FILE);
    long.map(|source| format!("{}: {} lines", source.path, source.text.lines().count())).collect()
}

fn of(dirs: &[&str]) -> Vec<Source> {
    dirs.iter().flat_map(|dir| sources(dir)).collect()
}

#[test]
fn core_and_plugins_name_no_window_crate() {
    assert_kept("core and plugins draw nothing", &window_names(&of(&["core", "plugins"])));
}

#[test]
fn plugins_reach_no_file_socket_clock_thread_global_or_chance() {
    // Tests of a plugin may read recordings and the program's files; the plugin itself may not.
    let made_of = |source: &Source| source.path.contains("/src/") && !source.path.ends_with("_tests.rs");
    let mut sources = of(&["plugins", "core/scene/src"]);
    sources.retain(made_of);
    let sources: Vec<Source> = sources.iter().map(without_tests).collect();
    assert!(sources.len() > 20, "the plugins were found");
    assert_kept("a plugin's outputs follow from its inputs", &named(&sources, &IMPURE_NAMES));
}

#[test]
fn no_state_of_a_process_changes_behind_a_shared_reference() {
    // Plugins, and the crates whose types their states are made of.
    let states = of(&["plugins", "core/geom/src", "core/scene/src", "core/world/src"]);
    let sources: Vec<Source> =
        states.iter().filter(|source| source.path.contains("/src/")).map(without_tests).collect();
    assert_kept("a state is a value", &interior_mutability(&sources));
}

#[test]
fn views_name_no_plugin_and_reach_no_file() {
    let names = ["rcs_plugins", "rcs_obstacles", "rcs_world_model", "std::fs", "std::net", "std::process"];
    let mut views = of(&["ocu/views"]);
    views.retain(|source| !source.path.contains("/tests/"));
    assert_kept("a view reads a source and nothing else", &named(&views, &names));
}

/// Variables whose names a view must not compare with a text: roles and types say what they are for.
const NAMED_THINGS: [&str; 7] = ["topic", "input", "output", "port", "process", "info", "buffer"];

/// Comparisons of the name of a topic, port, process or plugin with a text, and lookups of roles and palettes as texts.
fn matched_names(sources: &[Source]) -> Vec<String> {
    let mut patterns: Vec<String> =
        ["\"rcs.role\"", "\"rcs.palette\"", ".plugin == \"", "role() == \"", "role_name() == \""]
            .map(str::to_owned)
            .into();
    for thing in NAMED_THINGS {
        for operation in [" == \"", " != \"", ".contains(\"", ".starts_with(\"", ".ends_with(\""] {
            patterns.push(format!("{thing}.name{operation}"));
            patterns.push(format!("*{thing}.name{operation}"));
            patterns.push(format!("{thing}.name.as_str(){operation}"));
        }
    }
    let mut breaches = Vec::new();
    for source in sources.iter().map(without_tests) {
        for (at, line) in source.text.lines().enumerate() {
            let is_comment = line.trim_start().starts_with("//");
            if let Some(pattern) = patterns.iter().find(|pattern| !is_comment && line.contains(*pattern)) {
                breaches.push(format!("{}:{}: {pattern}", source.path, at + 1));
            }
        }
    }
    breaches
}

#[test]
fn no_view_matches_on_a_name() {
    let mut views = of(&["ocu/views/src", "ocu/ui/src"]);
    // Samples are frames for tests.
    views.retain(|source| !source.path.contains("/samples") && !source.path.contains("/tests/"));
    assert!(views.len() > 20, "the views were found");
    assert_kept("a view goes by type and role", &matched_names(&views));
}

#[test]
fn a_name_that_a_view_matches_on_is_found() {
    let source = example(
        "// topic.name.contains(\"depth\")\nif topic.name.contains(\"depth\") {}\ninput.name == \"teleop\"\n\
         topic.metadata.get(\"rcs.palette\")\nif name == \"cost\" {}\ntopic.name == other.name\n",
    );
    let found = matched_names(&source);
    let expected = ["x.rs:2: topic.name.contains(\"", "x.rs:3: input.name == \"", "x.rs:4: \"rcs.palette\""];
    assert_eq!(found, expected);
}

#[test]
fn what_plugins_compute_with_calls_libm() {
    // The fusion rule and the geometry run inside of plugins' cycles, so they must be as deterministic as the plugins.
    let computing = of(&["plugins", "core/geom/src", "core/scene/src", "core/world/src"]);
    assert_kept("transcendental functions come from libm", &system_functions(&computing));
}

#[test]
fn files_have_one_job() {
    assert_kept(
        "a file has at most 600 lines",
        &too_long(&of(&["core", "plugins", "ocu", "tests", "tools"])),
    );
}

fn example(text: &str) -> [Source; 1] {
    [Source { path: "x.rs".to_owned(), text: text.to_owned() }]
}

#[test]
fn a_window_crate_in_code_is_found_and_one_in_a_comment_is_not() {
    let source = example("// egui\nuse egui_tiles::Tree;\nlet begui = \"egui\";\nwgpu::Device\n");
    assert_eq!(window_names(&source), ["x.rs:2: egui_tiles", "x.rs:4: wgpu"]);
}

#[test]
fn a_clock_a_file_and_chance_are_found() {
    let source =
        example("let t = std::time::Instant::now();\nuse std::fs;\nlet x: f64 = rand::random();\nfs::read\n");
    assert_eq!(
        named(&source, &IMPURE_NAMES),
        ["x.rs:2: std::fs", "x.rs:1: Instant::now", "x.rs:3: rand::random"]
    );
}

#[test]
fn a_lock_a_cell_and_an_atomic_in_a_state_are_found() {
    let source = example(
        "// Mutex\nstruct State {\n    bench: Arc<Mutex<u8>>,\n    seen: Cell<u8>,\n    n: AtomicU64,\n    cell: CellIndex,\n}\n",
    );
    assert_eq!(interior_mutability(&source), ["x.rs:4: Cell<", "x.rs:3: Mutex", "x.rs:5: AtomicU64"]);
}

#[test]
fn a_function_of_the_system_is_found_and_one_of_libm_is_not() {
    let source = example(
        "let a = x.sin();\nlet b = libm::sin(x);\nlet c = xs.map(f64::exp);\nlet d = x.sqrt();\n#[cfg(test)]\nmod tests {\nx.cos();\n}\n",
    );
    assert_eq!(system_functions(&source), ["x.rs:1: .sin(", "x.rs:3: f64::exp"]);
}

#[test]
fn a_file_of_too_many_lines_is_found() {
    assert_eq!(too_long(&example(&"\n".repeat(LONGEST_FILE))).len(), 0);
    assert_eq!(too_long(&example(&"\n".repeat(LONGEST_FILE + 1))).len(), 1);
}
