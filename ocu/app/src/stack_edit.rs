//! Writes parameters of a process into the text of a stack file, and leaves everything else as it is: comments, order,
//! and other parameters.
//!
//! A process of the file itself gets the changed fields; a process of an include gets a block `[change.<process>]`.
//! [`check_path`] says whether the stack would start from the path to which the text is written.

use crate::assets::ProgramAssets;
use crate::{bundled, usage};
use anyhow::{Context as _, bail};
use rcs_msg::params::{ParamKind, ParamSpec, specs};
use rcs_msg::{AnyMessage, Value};
use rcs_runtime::{Plan, PlanOptions, StackFile};
use std::collections::BTreeSet;
use std::path::Path;
use toml_edit::{Array, DocumentMut, InlineTable, Item, RawString, Table, TableLike, Value as Toml};

/// The text of a stack file in which a process has these parameters. The result is checked: a stack with the text has
/// exactly these parameters. Parameters that hold a file, such as what an earlier run remembers, stay as they are in the
/// stack: their text is not part of it. `file` is its name in errors.
pub fn with_params(
    file: &str,
    text: &str,
    course: Option<&str>,
    process: &str,
    wanted: &AnyMessage,
) -> anyhow::Result<String> {
    let before = params_of(file, text, course, process)?;
    let (old, new) = (before.value()?, wanted.value()?);
    let mut specs = before.schema().descriptor().map(specs).unwrap_or_default();
    specs.retain(|spec| spec.file.is_none());
    let mut document: DocumentMut =
        text.parse().with_context(|| format!("the stack cannot be read: {file}"))?;
    for spec in &specs {
        let (Some(old), Some(new)) = (old.field(&spec.name), new.field(&spec.name)) else { continue };
        if old != new {
            put(&mut document, process, spec, old, new)?;
        }
    }
    let edited = document.to_string();
    let after = params_of(file, &edited, course, process)?;
    let after = after.value()?;
    if specs.iter().any(|spec| after.field(&spec.name) != new.field(&spec.name)) {
        bail!("the parameters of {process} cannot all be written into a stack file: {file}");
    }
    Ok(edited)
}

/// The names of the parameters that hold another file than in the stack, which [`with_params`] does not write.
pub fn unwritten(
    file: &str,
    text: &str,
    course: Option<&str>,
    process: &str,
    wanted: &AnyMessage,
) -> anyhow::Result<Vec<String>> {
    let before = params_of(file, text, course, process)?;
    let (old, new) = (before.value()?, wanted.value()?);
    let mut specs = before.schema().descriptor().map(specs).unwrap_or_default();
    specs.retain(|spec| spec.file.is_some() && old.field(&spec.name) != new.field(&spec.name));
    Ok(specs.into_iter().map(|spec| spec.name).collect())
}

/// Refuses to write the text of the stack `file` to a path from which `ocu --stack` would not start the same stack: the
/// name of a bundled stack, a part of the stack, or a path beside which the files that it names by relative paths are
/// missing or differ.
pub fn check_path(path: &Path, file: &str, text: &str, course: Option<&str>) -> anyhow::Result<()> {
    let name = path.display().to_string();
    if bundled::file("stack", &name).is_some() {
        return Err(usage(format!(
            "a bundled stack has this name, and would start instead; expected another one, such as \
             {name}.toml: {name}"
        )));
    }
    let there = plan_of(&name, text, course).context("the stack would not start from there")?;
    let files: BTreeSet<&str> = there.file.origins().iter().map(|origin| origin.file.as_str()).collect();
    let target = path.canonicalize().ok();
    let is_target = |part: &Path| target.is_some() && part.canonicalize().ok() == target;
    if files.into_iter().any(|part| part != name && is_target(Path::new(part))) {
        return Err(usage(format!(
            "the file is a part of the stack; expected another one to write to: {name}"
        )));
    }
    if there.hash != plan_of(file, text, course)?.hash {
        return Err(usage(format!(
            "the files that the stack names by relative paths differ there; expected a path in the folder of \
             {file}: {name}"
        )));
    }
    Ok(())
}

/// The plan of a stack, on the given course or its own.
fn plan_of(file: &str, text: &str, course: Option<&str>) -> anyhow::Result<Plan> {
    let stack = StackFile::compose(file, text, &ProgramAssets)?;
    let options = PlanOptions { overrides: &[], course, assets: &ProgramAssets };
    Ok(Plan::with(stack, rcs_plugins::all(), &options)?)
}

/// The parameters of a process in a stack.
fn params_of(file: &str, text: &str, course: Option<&str>, process: &str) -> anyhow::Result<AnyMessage> {
    let plan = plan_of(file, text, course)?;
    let found = plan.processes.iter().find(|known| *known.name == *process);
    let found = found.with_context(|| format!("the stack has no process {process:?}: {file}"))?;
    Ok(found.params.clone())
}

/// Writes one parameter.
fn put(
    document: &mut DocumentMut,
    process: &str,
    spec: &ParamSpec,
    old: &Value,
    new: &Value,
) -> anyhow::Result<()> {
    if let Some(own) = own_block(document, process) {
        let params = own.entry("params").or_insert_with(|| Item::Table(Table::new()));
        let Some(params) = params.as_table_like_mut() else { bail!("params of {process} is not a table") };
        if !changed_in_place(params, spec, old, new) {
            insert(params, &spec.name, whole(spec, new));
        }
        return Ok(());
    }
    let change = document.entry("change").or_insert_with(|| implicit(Table::new()));
    let Some(change) = change.as_table_like_mut() else { bail!("`change` is not a table") };
    let of = change.entry(process).or_insert_with(|| implicit(Table::new()));
    let Some(of) = of.as_table_like_mut() else { bail!("`change.{process}` is not a table") };
    let params = of.entry("params").or_insert_with(|| Item::Table(Table::new()));
    let Some(params) = params.as_table_like_mut() else { bail!("params of {process} is not a table") };
    // A change replaces whole parameters.
    insert(params, &spec.name, whole(spec, new));
    Ok(())
}

fn implicit(mut table: Table) -> Item {
    table.set_implicit(true);
    Item::Table(table)
}

/// The block of a process, if it is in the file itself.
fn own_block<'a>(document: &'a mut DocumentMut, process: &str) -> Option<&'a mut Table> {
    let blocks = document.get_mut("process")?.as_array_of_tables_mut()?;
    blocks.iter_mut().find(|block| block.get("name").and_then(Item::as_str) == Some(process))
}

/// Changes only the fields that differ, where the file writes the parameter; `false` if it has to be written whole.
fn changed_in_place(params: &mut dyn TableLike, spec: &ParamSpec, old: &Value, new: &Value) -> bool {
    match (spec.kind, new) {
        (ParamKind::Group, _) => {
            let Some(table) = params.get_mut(&spec.name).and_then(Item::as_table_like_mut) else {
                return false;
            };
            fields_in_place(table, &spec.fields, old, new)
        }
        (ParamKind::List, Value::List(items)) => {
            let Some(array) = params.get_mut(&spec.name).and_then(Item::as_array_mut) else { return false };
            let Value::List(before) = old else { return false };
            if array.len() != items.len() || before.len() != items.len() {
                return false;
            }
            let pairs = before.iter().zip(items).enumerate().filter(|(_, (old, new))| old != new);
            let mut done = true;
            for (index, (old, new)) in pairs {
                let table = array.get_mut(index).and_then(Toml::as_inline_table_mut);
                done &= table.is_some_and(|table| fields_in_place(table, &spec.fields, old, new));
            }
            done
        }
        (ParamKind::List, _) => false,
        _ => {
            set(params, &spec.name, new);
            true
        }
    }
}

fn fields_in_place(table: &mut dyn TableLike, fields: &[ParamSpec], old: &Value, new: &Value) -> bool {
    let mut done = true;
    for field in fields {
        let (before, after) = (old.field(&field.name), new.field(&field.name));
        let (Some(before), Some(after)) = (before, after) else { continue };
        if before != after {
            done &= match field.kind {
                ParamKind::Group | ParamKind::List => changed_in_place(table, field, before, after),
                _ => {
                    set(table, &field.name, after);
                    true
                }
            };
        }
    }
    done
}

/// Sets a plain value; spaces and comments around the old one stay.
fn set(table: &mut dyn TableLike, name: &str, value: &Value) {
    let mut new = plain(value);
    match table.get_mut(name).and_then(Item::as_value_mut) {
        Some(old) => {
            *new.decor_mut() = old.decor().clone();
            *old = new;
        }
        None => insert(table, name, new),
    }
}

/// Writes an entry, behind the others if it is new. The space before the brace of an inline table belongs to its last
/// value, and passes to the new one.
fn insert(table: &mut dyn TableLike, name: &str, mut value: Toml) {
    if !table.contains_key(name)
        && let Some(last) = table.iter_mut().last().and_then(|(_, item)| item.as_value_mut())
        && let Some(space) = last.decor().suffix().and_then(RawString::as_str)
        && space.trim_matches(' ').is_empty()
    {
        value.decor_mut().set_suffix(space.to_owned());
        last.decor_mut().set_suffix("");
    }
    table.insert(name, Item::Value(value));
}

/// A whole parameter; fields that have their defaults are left out of tables.
fn whole(spec: &ParamSpec, value: &Value) -> Toml {
    match (spec.kind, value) {
        (ParamKind::Group, _) => Toml::InlineTable(table(&spec.fields, value)),
        (ParamKind::List, Value::List(items)) => {
            let is_plain = matches!(spec.fields.as_slice(), [only] if only.name.is_empty());
            let element = |item: &Value| {
                if is_plain { plain(item) } else { Toml::InlineTable(table(&spec.fields, item)) }
            };
            let mut array: Array = items.iter().map(element).collect();
            if !is_plain {
                // One element per line.
                for element in array.iter_mut() {
                    element.decor_mut().set_prefix("\n    ");
                }
                array.set_trailing_comma(true);
                array.set_trailing("\n");
            }
            Toml::Array(array)
        }
        (ParamKind::List, Value::Packed(numbers)) => {
            Toml::Array(numbers.iter().map(|number| plain(&Value::from(number))).collect())
        }
        _ => plain(value),
    }
}

fn table(fields: &[ParamSpec], value: &Value) -> InlineTable {
    let mut table = InlineTable::new();
    for field in fields {
        if let Some(value) = value.field(&field.name).filter(|value| !is_same(value, &field.default)) {
            table.insert(&field.name, whole(field, value));
        }
    }
    table
}

/// Whether both are the same value, whatever kind of number it is.
fn is_same(a: &Value, b: &Value) -> bool {
    a == b || (a.as_f64().is_some() && a.as_f64() == b.as_f64())
}

fn plain(value: &Value) -> Toml {
    match value {
        Value::Bool(on) => (*on).into(),
        Value::Float(number) => (*number).into(),
        Value::Enum { name, .. } => name.as_str().into(),
        Value::Text(text) => text.as_str().into(),
        other => other.as_i64().unwrap_or_default().into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcs_msg::params;
    use rcs_runtime::ProcessPlan;

    fn text(stack: &str) -> &'static str {
        bundled::file("stack", stack).unwrap().text
    }

    #[track_caller]
    fn edited(stack: &str, process: &str, changes: &[(&str, &str)]) -> String {
        let before = params_of(stack, text(stack), None, process).unwrap();
        let wanted = params::with_params(&before, changes.iter().copied()).unwrap();
        with_params(stack, text(stack), None, process, &wanted).unwrap()
    }

    /// The lines that were removed and added.
    fn difference(old: &str, new: &str) -> Vec<String> {
        let diff = similar::TextDiff::from_lines(old, new);
        let changes = diff.iter_all_changes().filter(|change| change.tag() != similar::ChangeTag::Equal);
        changes.map(|change| format!("{}{}", change.tag(), change.value().trim_end())).collect()
    }

    #[test]
    fn a_weight_is_changed_in_its_own_line_and_nothing_else_is() {
        let new = edited("simulation", "wm1", &[("sources[2].weight", "0.7")]);
        let lines = difference(text("simulation"), &new);
        assert_eq!(
            lines,
            ["-    { name = \"infrared\", weight = 0.3 },", "+    { name = \"infrared\", weight = 0.7 },",]
        );
    }

    #[test]
    fn a_field_that_its_line_does_not_have_yet_is_added_behind_a_comma() {
        let new = edited("simulation", "wm1", &[("sources[0].weight", "0.4")]);
        let lines = difference(text("simulation"), &new);
        assert_eq!(lines, ["-    { name = \"stereo\" },", "+    { name = \"stereo\", weight = 0.4 },"]);
    }

    #[test]
    fn what_the_file_does_not_say_yet_is_added_to_its_process() {
        let new = edited("simulation", "wm1", &[("publish_hz", "2.5"), ("sources[0].weight", "0.5")]);
        let lines = difference(text("simulation"), &new);
        assert!(lines.contains(&"+publish_hz = 2.5".to_owned()), "{lines:?}");
        assert!(lines.iter().any(|line| line.contains("stereo") && line.contains("0.5")), "{lines:?}");
        assert!(lines.iter().all(|line| !line.contains("infrared")), "{lines:?}");
    }

    #[test]
    fn a_value_that_is_the_default_elsewhere_but_not_in_this_group_is_written() {
        // 0.5 s is the default of a pose's age, but a world model has another one.
        let lines =
            difference(text("simulation"), &edited("simulation", "wm1", &[("pose.max_age_s", "0.5")]));
        assert!(lines.iter().any(|line| line.contains("max_age_s = 0.5")), "{lines:?}");
    }

    #[test]
    fn a_file_in_force_is_not_written_and_hinders_nothing() {
        let changes = [("route", "blake3:0123"), ("jump_m", "7.5")];
        let lines = difference(text("lagr"), &edited("lagr", "waypoint_generator", &changes));
        assert!(lines.iter().any(|line| line.contains("jump_m = 7.5")), "{lines:?}");
        assert!(lines.iter().all(|line| !line.contains("blake3")), "{lines:?}");
        let before = params_of("lagr", text("lagr"), None, "waypoint_generator").unwrap();
        let unwritten = |wanted| unwritten("lagr", text("lagr"), None, "waypoint_generator", wanted).unwrap();
        let wanted = params::with_params(&before, changes.iter().copied()).unwrap();
        assert_eq!(unwritten(&wanted), ["route"]);
        assert!(unwritten(&before).is_empty());
    }

    #[test]
    fn every_process_of_every_bundled_stack_takes_a_changed_number() {
        for name in bundled::names("stack") {
            let stack = StackFile::compose(name, text(name), &ProgramAssets).unwrap();
            let options = PlanOptions { overrides: &[], course: None, assets: &ProgramAssets };
            let plan = Plan::with(stack, rcs_plugins::all(), &options).unwrap();
            for process in &plan.processes {
                let schema = process.params.schema();
                let mut numbers = specs(schema.descriptor().unwrap());
                numbers.retain(|spec| spec.kind == ParamKind::Number);
                let value = process.params.value().unwrap();
                let mut refused = Vec::new();
                let taken = numbers.iter().any(|spec| {
                    let Some(now) = value.field(&spec.name).and_then(Value::as_f64) else { return false };
                    let mut others = [spec.min, spec.max].into_iter().flatten().filter(|limit| *limit != now);
                    others.any(|other| is_taken(name, process, spec, other, &mut refused))
                });
                assert!(taken || numbers.is_empty(), "{name} {} takes no number: {refused:?}", process.name);
            }
        }
    }

    /// Whether a bundled stack can be written with another number of a process. A limit may contradict another
    /// parameter, which the process refuses.
    fn is_taken(
        stack: &str,
        process: &ProcessPlan,
        spec: &ParamSpec,
        number: f64,
        refused: &mut Vec<String>,
    ) -> bool {
        let number = number.to_string();
        let changes = [(spec.name.as_str(), number.as_str())];
        let wanted = params::with_params(&process.params, changes).unwrap();
        match with_params(stack, text(stack), None, &process.name, &wanted) {
            Ok(new) => {
                let lines = difference(text(stack), &new);
                assert!(lines.iter().any(|line| line.contains(spec.name.as_str())), "{stack}: {lines:?}");
                true
            }
            Err(error) if error.is::<rcs_runtime::StackError>() => {
                refused.push(format!("{error:#}"));
                false
            }
            Err(error) => panic!("{stack} {}: {error:#}", process.name),
        }
    }
}
