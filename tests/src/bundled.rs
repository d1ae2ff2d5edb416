//! The bundled stacks, worlds, courses and models, as the tests run them.

use rcs_runtime::{Asset, Assets, Plan, PlanOptions, StackFile};
use std::path::Path;
use std::sync::Arc;

/// The bundled files, read from the repository, and the worlds and courses of the tests alone in `tests/assets`.
pub(crate) struct Repository;

impl Assets for Repository {
    fn read(&self, kind: &str, name: &str, _beside: &str) -> Result<Asset, String> {
        // Courses of the tests name their worlds by path, so that `ocu run` can drive them, too.
        let name = Path::new(name).file_stem().and_then(|stem| stem.to_str()).unwrap_or(name);
        let file = match kind {
            "models" => format!("assets/models/{name}.json"),
            "part" => format!("assets/stacks/parts/{name}.toml"),
            kind => format!("assets/{kind}s/{name}.toml"),
        };
        let tests = Path::new(env!("CARGO_MANIFEST_DIR"));
        let own = tests.join(&file);
        let path = if own.exists() { own } else { tests.join("..").join(&file) };
        let text = std::fs::read_to_string(path).map_err(|error| format!("{error}: {file}"))?;
        Ok(Asset { file, text })
    }
}

/// Names of the bundled courses.
#[allow(dead_code, reason = "an example includes this file, too")]
pub(crate) fn courses() -> Vec<String> {
    courses_in("../assets/courses")
}

/// Names of the courses in a folder, which is given relative to that of the tests.
#[allow(dead_code, reason = "an example includes this file, too")]
pub(crate) fn courses_in(folder: &str) -> Vec<String> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join(folder);
    let files = std::fs::read_dir(folder).unwrap().map(|file| file.unwrap().path());
    let mut names: Vec<String> =
        files.map(|file| file.file_stem().unwrap().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

/// A bundled stack on a bundled course, with parameters `(process.field, value)`.
#[allow(dead_code, reason = "an example includes this file, too")]
pub(crate) fn plan(stack: &str, course: &str, params: &[(&str, &str)]) -> Arc<Plan> {
    let asset = Repository.read("stack", stack, "").unwrap();
    planned(&asset.file, &asset.text, Some(course), params)
}

/// A bundled stack without changes.
#[allow(dead_code, reason = "an example includes this file, too")]
pub(crate) fn plan_of(stack: &str) -> Arc<Plan> {
    let asset = Repository.read("stack", stack, "").unwrap();
    planned(&asset.file, &asset.text, None, &[])
}

/// A stack of a test.
#[allow(dead_code, reason = "an example includes this file, too")]
pub(crate) fn plan_from_text(file: &str, text: &str) -> Arc<Plan> {
    planned(file, text, None, &[])
}

fn planned(file: &str, text: &str, course: Option<&str>, params: &[(&str, &str)]) -> Arc<Plan> {
    let file = StackFile::compose(file, text, &Repository).unwrap_or_else(|error| panic!("{error}"));
    let overrides: Vec<_> = params.iter().map(|&(path, value)| (path.to_owned(), value.to_owned())).collect();
    let options = PlanOptions { overrides: &overrides, course, assets: &Repository };
    Arc::new(Plan::with(file, rcs_plugins::all(), &options).unwrap_or_else(|error| panic!("{error}")))
}
