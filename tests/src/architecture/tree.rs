//! The workspace as files: packages with their declarations, the graph of the lock file, and the sources.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// A `Cargo.toml`, parsed as far as the rules need it.
pub(super) struct Package {
    pub(super) name: String,
    /// The folder, relative to the root, with `/`: `plugins/obstacles`.
    pub(super) dir: String,
    /// Names of `[dependencies]` and `[build-dependencies]`, with the version if the manifest contains one.
    pub(super) dependencies: BTreeMap<String, Declared>,
    /// The same for `[dev-dependencies]`.
    pub(super) dev_dependencies: BTreeMap<String, Declared>,
}

/// Where the version of a dependency is written.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Declared {
    /// `name.workspace = true`.
    InWorkspace,
    /// In the package's own manifest.
    InPackage,
}

impl Package {
    /// Parses a manifest; `dir` is its folder.
    pub(super) fn parse(dir: &str, manifest: &str) -> Self {
        let manifest: toml::Table =
            manifest.parse().unwrap_or_else(|error| panic!("{dir}/Cargo.toml: {error}"));
        let name = manifest["package"]["name"].as_str().expect("a package has a name").to_owned();
        let mut dependencies = declared(&manifest, "dependencies");
        dependencies.extend(declared(&manifest, "build-dependencies"));
        // Declarations for one platform only count, too.
        for platform in manifest.get("target").and_then(toml::Value::as_table).into_iter().flatten() {
            if let Some(table) = platform.1.as_table() {
                dependencies.extend(declared(table, "dependencies"));
            }
        }
        Self {
            name,
            dir: dir.to_owned(),
            dev_dependencies: declared(&manifest, "dev-dependencies"),
            dependencies,
        }
    }

    /// Every declared dependency with its name, including those of tests.
    pub(super) fn all_dependencies(&self) -> impl Iterator<Item = (&str, Declared)> {
        self.dependencies
            .iter()
            .chain(&self.dev_dependencies)
            .map(|(name, declared)| (name.as_str(), *declared))
    }
}

fn declared(manifest: &toml::Table, section: &str) -> BTreeMap<String, Declared> {
    let entry = |(key, value): (&String, &toml::Value)| {
        let renamed = value.get("package").and_then(toml::Value::as_str);
        let inherited = value.get("workspace").and_then(toml::Value::as_bool) == Some(true);
        let declared = if inherited { Declared::InWorkspace } else { Declared::InPackage };
        (renamed.unwrap_or(key).to_owned(), declared)
    };
    manifest.get(section).and_then(toml::Value::as_table).into_iter().flatten().map(entry).collect()
}

/// The folder with the workspace's `Cargo.toml`.
pub(super) fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the package lies in the workspace").to_owned()
}

/// The text of a file of the workspace.
pub(super) fn read(path: &str) -> String {
    std::fs::read_to_string(root().join(path)).unwrap_or_else(|error| panic!("{path}: {error}"))
}

/// The members of the workspace.
pub(super) fn packages() -> Vec<Package> {
    let manifest: toml::Table = read("Cargo.toml").parse().expect("the workspace's manifest is TOML");
    let members = manifest["workspace"]["members"].as_array().expect("members are a list");
    members
        .iter()
        .flat_map(|member| folders(member.as_str().expect("a member is a path")))
        .map(|dir| Package::parse(&dir, &read(&format!("{dir}/Cargo.toml"))))
        .collect()
}

/// The folders that a member names, `core/*` all those in `core`.
fn folders(member: &str) -> Vec<String> {
    let Some(parent) = member.strip_suffix("/*") else { return vec![member.to_owned()] };
    let entries = std::fs::read_dir(root().join(parent)).unwrap_or_else(|error| panic!("{parent}: {error}"));
    let names = entries.map(|entry| entry.expect("a folder's entry can be read").file_name());
    let paths = names.map(|name| format!("{parent}/{}", name.to_string_lossy()));
    let mut packages: Vec<_> = paths.filter(|path| root().join(path).join("Cargo.toml").is_file()).collect();
    packages.sort();
    packages
}

/// A Rust source: path relative to the root, and text.
pub(super) struct Source {
    pub(super) path: String,
    pub(super) text: String,
}

/// Every `.rs` file below a folder of the workspace, sorted by path.
pub(super) fn sources(dir: &str) -> Vec<Source> {
    let root = root();
    let mut folders = vec![root.join(dir)];
    let mut paths = BTreeSet::new();
    while let Some(folder) = folders.pop() {
        let entries =
            std::fs::read_dir(&folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
        for entry in entries {
            let path = entry.expect("a folder's entry can be read").path();
            if path.is_dir() {
                let built = path.file_name().is_some_and(|name| name == "target");
                folders.extend((!built).then_some(path));
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                paths.insert(path);
            }
        }
    }
    let source = |path: PathBuf| {
        let relative = path.strip_prefix(&root).expect("the file lies in the workspace");
        let path = relative.to_string_lossy().replace('\\', "/");
        Source { text: read(&path), path }
    };
    paths.into_iter().map(source).collect()
}

/// The lock file: each locked package as `name version`, with its dependencies.
pub(super) struct Lock {
    packages: BTreeMap<(String, String), Vec<String>>,
}

impl Lock {
    /// Parses a `Cargo.lock`.
    pub(super) fn parse(text: &str) -> Self {
        let lock: toml::Table = text.parse().expect("the lock file is TOML");
        let text_of = |value: &toml::Value| value.as_str().expect("names and versions are text").to_owned();
        let package = |package: &toml::Value| {
            let depends = package.get("dependencies").and_then(toml::Value::as_array);
            let depends = depends.into_iter().flatten().map(text_of).collect();
            ((text_of(&package["name"]), text_of(&package["version"])), depends)
        };
        let packages = lock["package"].as_array().expect("packages are a list").iter().map(package).collect();
        Self { packages }
    }

    /// The locked versions of a package.
    pub(super) fn versions(&self, name: &str) -> Vec<&str> {
        self.packages
            .keys()
            .filter(|(locked, _)| locked == name)
            .map(|(_, version)| version.as_str())
            .collect()
    }

    /// Names of all direct and indirect dependencies of a package, including those of its tests.
    pub(super) fn closure(&self, name: &str) -> BTreeSet<String> {
        let mut seen = BTreeSet::new();
        let mut open = vec![name.to_owned()];
        while let Some(next) = open.pop() {
            // An entry is `name`, or `name version` where several versions are locked.
            let mut words = next.split(' ');
            let (name, version) = (words.next().unwrap_or_default(), words.next());
            let of_it = self
                .packages
                .iter()
                .filter(|((locked, at), _)| locked == name && version.is_none_or(|version| version == at));
            for (_, depends) in of_it {
                open.extend(depends.iter().filter(|entry| seen.insert((*entry).clone())).cloned());
            }
        }
        seen.iter().map(|entry| entry.split(' ').next().unwrap_or_default().to_owned()).collect()
    }
}

#[test]
fn manifest_tells_inherited_versions_from_own_ones() {
    let package = Package::parse(
        "core/x",
        "[package]\nname = \"x\"\n[dependencies]\na.workspace = true\nb = \"1\"\nc = { package = \"d\", version = \"1\" }\n\
         [dev-dependencies]\ne = { workspace = true, features = [\"f\"] }\n",
    );
    let all: Vec<_> = package.all_dependencies().collect();
    let expected = [
        ("a", Declared::InWorkspace),
        ("b", Declared::InPackage),
        ("d", Declared::InPackage),
        ("e", Declared::InWorkspace),
    ];
    assert_eq!(all, expected);
}

#[test]
fn closure_follows_the_version_that_is_named() {
    let lock = Lock::parse(
        "[[package]]\nname = \"a\"\nversion = \"1.0.0\"\ndependencies = [\"b 2.0.0\"]\n\
         [[package]]\nname = \"b\"\nversion = \"1.0.0\"\ndependencies = [\"c\"]\n\
         [[package]]\nname = \"b\"\nversion = \"2.0.0\"\ndependencies = [\"d\"]\n\
         [[package]]\nname = \"c\"\nversion = \"1.0.0\"\n[[package]]\nname = \"d\"\nversion = \"1.0.0\"\n",
    );
    assert_eq!(lock.closure("a").into_iter().collect::<Vec<_>>(), ["b", "d"]);
    assert_eq!(lock.versions("b"), ["1.0.0", "2.0.0"]);
}
