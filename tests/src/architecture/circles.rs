//! Dependencies between the files of a crate have no cycles, so that every file can be read without the files that use
//! it.
//!
//! A file depends on another one if a path in it leads there: in a `use`, or in the code (`crate::a::b`, `super::b`, a
//! child module's `b::c`). A path to an imported name leads to the definition of the name, so that `crate::Plan` is the
//! file that defines `Plan`, not the crate's root. A re-export (`pub use entry::Entry`) is not a dependency. Tests are
//! excluded.
//!
//! The rule does not detect:
//!
//! - Method calls, which are not paths. Two files with parts of one type's `impl` may depend on each other undetected.
//! - What a file uses of its parent modules (`super::Session` in `history/fill.rs`), because the file at the head of a
//!   folder contains what the files in it share. A cycle through it and a third file is detected.
//! - Definitions of the crate's root, and imports with `*`.

use super::assert_kept;
use super::code::code_only;
use super::tree::{Source, packages, sources};
use std::collections::{BTreeMap, BTreeSet};

/// A module, as the path from the crate's root.
type Module = Vec<String>;

/// A path in a file: its names and, if it is imported, the local name.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Named {
    path: Vec<String>,
    alias: Option<String>,
    /// A re-export: the file itself does not use the name.
    is_passed_on: bool,
}

/// A file of a crate.
struct File {
    /// Relative to the crate's `src`.
    name: String,
    paths: Vec<Named>,
}

/// Words and punctuation of the code; `::` is one token.
fn tokens(code: &str) -> Vec<&str> {
    let mut tokens = Vec::new();
    let mut rest = code.trim_start();
    while let Some(first) = rest.chars().next() {
        let is_word = |c: char| c.is_alphanumeric() || c == '_';
        let length = if is_word(first) {
            rest.find(|c| !is_word(c)).unwrap_or(rest.len())
        } else if rest.starts_with("::") {
            2
        } else {
            first.len_utf8()
        };
        tokens.push(&rest[..length]);
        rest = rest[length..].trim_start();
    }
    tokens
}

fn is_name(token: &str) -> bool {
    token.starts_with(|c: char| c.is_alphabetic() || c == '_')
}

/// Parses the tree of a `use` that begins at `at`, below `above`; returns its end.
fn use_tree(tokens: &[&str], mut at: usize, above: &[String], found: &mut Vec<Named>) -> usize {
    let mut path = above.to_vec();
    loop {
        match tokens.get(at).copied() {
            Some("::") => at += 1,
            Some("{") => {
                at += 1;
                while tokens.get(at).is_some_and(|&token| token != "}") {
                    at = use_tree(tokens, at, &path, found);
                    at += usize::from(tokens.get(at) == Some(&","));
                }
                return at + 1;
            }
            Some("self") if !path.is_empty() => at += 1,
            Some(name) if is_name(name) && name != "as" => {
                path.push(name.to_owned());
                at += 1;
            }
            _ => break,
        }
    }
    let mut alias = path.last().cloned();
    if tokens.get(at) == Some(&"as") {
        alias = tokens.get(at + 1).map(|&name| name.to_owned());
        at += 2;
    } else if tokens.get(at) == Some(&"*") {
        alias = None;
        at += 1;
    }
    found.push(Named { path, alias, is_passed_on: false });
    at
}

/// Every path of two names or more in the code, and all imports.
fn paths(code: &str) -> Vec<Named> {
    let tokens = tokens(code);
    let mut found = Vec::new();
    let mut at = 0;
    while at < tokens.len() {
        if tokens[at] == "use" && tokens.get(at + 1).is_some_and(|&next| next != "<") {
            let is_public = at > 0 && ["pub", ")"].contains(&tokens[at - 1]);
            let first = found.len();
            at = use_tree(&tokens, at + 1, &[], &mut found);
            for import in &mut found[first..] {
                let uses = tokens.iter().filter(|token| import.alias.as_deref() == Some(token)).count();
                import.is_passed_on = is_public && uses == 1;
            }
        } else if is_name(tokens[at]) && tokens.get(at + 1) == Some(&"::") {
            let mut path = vec![tokens[at].to_owned()];
            while tokens.get(at + 1) == Some(&"::") && tokens.get(at + 2).is_some_and(|name| is_name(name)) {
                path.push(tokens[at + 2].to_owned());
                at += 2;
            }
            found.push(Named { path, alias: None, is_passed_on: false });
            at += 1;
        } else {
            at += 1;
        }
    }
    found
}

/// The text before the tests at its end, and those of its modules that are tests in separate files.
fn without_tests(text: &str) -> (&str, Vec<String>) {
    let mut test_files = Vec::new();
    for (start, attribute) in text.match_indices("#[cfg(test)]\n") {
        let rest = &text[start + attribute.len()..];
        let mut lines = rest.lines().map(str::trim).skip_while(|line| line.starts_with("#["));
        let Some((_, name)) = lines.next().and_then(|line| line.split_once("mod ")) else { continue };
        match name.strip_suffix(';') {
            Some(name) => test_files.push(name.to_owned()),
            None if name.ends_with('{') => return (&text[..start], test_files),
            None => {}
        }
    }
    (text, test_files)
}

/// The files of a crate by module; `sources` are the files below its `src`.
fn files(src: &str, sources: &[Source]) -> BTreeMap<Module, File> {
    let mut tests = BTreeSet::new();
    let mut files = BTreeMap::new();
    let is_root = |name: &str| name == "lib.rs" || name == "main.rs";
    for source in sources {
        let Some(name) = source.path.strip_prefix(src).map(|name| name.trim_start_matches('/')) else {
            continue;
        };
        let module = name.trim_end_matches(".rs").trim_end_matches("/mod");
        let module: Module =
            if is_root(name) { Vec::new() } else { module.split('/').map(str::to_owned).collect() };
        let (text, test_files) = without_tests(&source.text);
        tests.extend(test_files.into_iter().map(|test| [module.clone(), vec![test]].concat()));
        // The `main.rs` of a program with a library uses the library's modules through the library's name only.
        if name == "main.rs" && files.contains_key(&Module::new()) {
            continue;
        }
        files.insert(module, File { name: name.to_owned(), paths: paths(&code_only(text)) });
    }
    let is_test = |module: &Module| {
        let marked = (1..=module.len()).any(|length| tests.contains(&module[..length]));
        marked || module.iter().any(|name| name == "tests" || name.ends_with("_tests"))
    };
    files.retain(|module, _| !is_test(module));
    files
}

/// The module to which a path in `from` leads; `seen` are the imports that have been followed already.
fn resolve(
    files: &BTreeMap<Module, File>,
    from: &Module,
    path: &[String],
    seen: &mut BTreeSet<(Module, String)>,
) -> Module {
    let mut module = from.clone();
    for (at, name) in path.iter().enumerate() {
        match name.as_str() {
            "crate" => module.clear(),
            "super" => drop(module.pop()),
            "self" => {}
            name => {
                let child = [module.clone(), vec![name.to_owned()]].concat();
                if files.contains_key(&child) {
                    module = child;
                    continue;
                }
                let imports = files.get(&module).map_or(&[][..], |file| &file.paths);
                let import = imports.iter().find(|import| {
                    import.alias.as_deref() == Some(name) && leads_inside(files, &module, &import.path)
                });
                if let Some(import) = import
                    && seen.insert((module.clone(), name.to_owned()))
                {
                    let path = [&import.path[..], &path[at + 1..]].concat();
                    return resolve(files, &module, &path, seen);
                }
                return module;
            }
        }
    }
    module
}

/// Whether a path in a module begins within the crate.
fn leads_inside(files: &BTreeMap<Module, File>, module: &Module, path: &[String]) -> bool {
    let Some(first) = path.first() else { return false };
    let is_child = || files.contains_key(&[module.clone(), vec![first.clone()]].concat());
    ["crate", "super", "self"].contains(&first.as_str()) || is_child()
}

/// The dependencies of each file of a crate, each with the first path that causes it.
fn dependencies(files: &BTreeMap<Module, File>) -> BTreeMap<&Module, BTreeMap<Module, String>> {
    let of = |(module, file): (&'_ Module, &'_ File)| {
        let mut found = BTreeMap::new();
        let own = file.paths.iter().filter(|named| !named.is_passed_on);
        for Named { path, .. } in own.filter(|named| leads_inside(files, module, &named.path)) {
            let target = resolve(files, module, path, &mut BTreeSet::new());
            if !target.is_empty() && !module.starts_with(&target) {
                found.entry(target).or_insert_with(|| path.join("::"));
            }
        }
        found
    };
    files.iter().map(|entry| (entry.0, of(entry))).collect()
}

/// Every cycle among a crate's files, with the dependencies that form it.
fn circles(src: &str, sources: &[Source]) -> Vec<String> {
    let files = files(src, sources);
    let dependencies = dependencies(&files);
    let reach = |from: &Module| {
        let (mut reached, mut next) = (BTreeSet::new(), vec![from]);
        while let Some(module) = next.pop() {
            let all = dependencies.get(module).into_iter().flat_map(BTreeMap::keys);
            next.extend(all.filter(|target| reached.insert((*target).clone())));
        }
        reached
    };
    let reached: BTreeMap<&Module, BTreeSet<Module>> =
        files.keys().map(|module| (module, reach(module))).collect();
    let mut breaches = Vec::new();
    let mut told: BTreeSet<&Module> = BTreeSet::new();
    for module in files.keys() {
        let is_in = |other: &&Module| reached[module].contains(*other) && reached[*other].contains(module);
        let circle: Vec<&Module> = files.keys().filter(is_in).collect();
        if circle.is_empty() || !told.insert(module) {
            continue;
        }
        told.extend(&circle);
        let mut edges = Vec::new();
        for from in &circle {
            let within = dependencies[from].iter().filter(|(to, _)| circle.contains(to));
            edges.extend(
                within.map(|(to, path)| format!("{} -> {} by {path}", files[*from].name, files[to].name)),
            );
        }
        breaches.push(format!("{src}: {}", edges.join(", ")));
    }
    breaches
}

#[test]
fn no_files_of_a_crate_depend_on_each_other_in_a_circle() {
    let mut breaches = Vec::new();
    for package in packages() {
        let src = format!("{}/src", package.dir);
        breaches.extend(circles(&src, &sources(&src)));
    }
    assert_kept("files of a crate depend on each other in one direction", &breaches);
}

fn example(texts: &[(&str, &str)]) -> Vec<String> {
    let source =
        |(path, text): &(&str, &str)| Source { path: format!("x/src/{path}"), text: (*text).to_owned() };
    circles("x/src", &texts.iter().map(source).collect::<Vec<_>>())
}

#[test]
fn a_circle_of_two_files_is_found_and_told_with_the_paths_that_make_it() {
    let found = example(&[
        ("lib.rs", "mod a;\nmod b;\nmod c;"),
        ("a.rs", "use crate::b::{self, B as Other};\nuse std::fmt;"),
        ("b.rs", "// crate::c::C\nfn f() { super::a::f::<u8>(\"crate::c\") }"),
        ("c.rs", "use crate::{a, b};"),
    ]);
    assert_eq!(found, ["x/src: a.rs -> b.rs by crate::b, b.rs -> a.rs by super::a::f"]);
}

#[test]
fn a_circle_through_an_import_of_another_module_is_found() {
    let found = example(&[
        ("lib.rs", "mod a;\nmod plan;\npub use plan::{Entry, Plan};"),
        ("plan/mod.rs", "mod entry;\npub use entry::Entry;\nuse crate::a::A;\npub struct Plan;"),
        ("plan/entry.rs", "pub struct Entry;"),
        ("a.rs", "use crate::Plan;"),
    ]);
    assert_eq!(found, ["x/src: a.rs -> plan/mod.rs by crate::Plan, plan/mod.rs -> a.rs by crate::a::A"]);
    let none = example(&[
        ("lib.rs", "mod a;\nmod plan;\npub use plan::{Entry, Plan};"),
        ("plan/mod.rs", "mod entry;\npub use entry::Entry;\nuse crate::a::A;\npub struct Plan;"),
        ("plan/entry.rs", "pub struct Entry;"),
        ("a.rs", "use crate::Entry;"),
    ]);
    assert_eq!(none, [""; 0], "the name comes from a file that needs no other");
}

#[test]
fn a_circle_of_three_files_through_the_head_of_a_folder_is_found_and_one_with_it_alone_is_not() {
    let folder = [("lib.rs", "mod a;\nmod b;"), ("a/mod.rs", "mod part;\nfn f() { part::f() }")];
    let alone = [&folder[..], &[("a/part.rs", "use super::A;"), ("b.rs", "use crate::a::A;")]].concat();
    assert_eq!(example(&alone), [""; 0]);
    let three = [&folder[..], &[("a/part.rs", "use crate::b::B;"), ("b.rs", "use crate::a::A;")]].concat();
    assert_eq!(
        example(&three),
        [
            "x/src: a/mod.rs -> a/part.rs by part::f, a/part.rs -> b.rs by crate::b::B, b.rs -> a/mod.rs by crate::a::A"
        ]
    );
}

#[test]
fn tests_may_use_what_they_test() {
    let found = example(&[
        ("lib.rs", "mod a;\nmod b;\n#[cfg(test)]\nmod a_test;"),
        ("a.rs", "use crate::b::B;\n#[cfg(test)]\npub(crate) mod tests {\n}"),
        ("b.rs", "struct B;\n#[cfg(test)]\nmod tests {\nuse crate::a::A;\n}"),
        ("a_test.rs", "use crate::a::A;"),
    ]);
    assert_eq!(found, [""; 0]);
}
