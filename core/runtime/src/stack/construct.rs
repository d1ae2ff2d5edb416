//! Construction of plans: from a stack file and the list of plugins, or from the identity of a recorded run.

use super::assets::NoAssets;
use super::builder::Builder;
use super::error::StackError;
use super::file::StackFile;
use super::params::{ParamReader, PlanOptions};
use super::plan::{Plan, ProcessPlan};
use crate::process::ProcessType;
use rcs_msg::rcs;

impl Plan {
    /// Checks a stack file against the list of plugins, with overrides of parameters: `(process.field, value)`.
    pub fn new(
        file: StackFile,
        plugins: &[ProcessType],
        overrides: &[(String, String)],
    ) -> Result<Self, StackError> {
        Self::with(file, plugins, &PlanOptions { overrides, course: None, assets: &NoAssets })
    }

    /// Checks a stack file against the list of plugins, with all options.
    pub fn with(
        file: StackFile,
        plugins: &[ProcessType],
        options: &PlanOptions<'_>,
    ) -> Result<Self, StackError> {
        let mut params = ParamReader::new(&file, *options)?;
        plugins.iter().for_each(ProcessType::register);
        let authority_ns = authority_ns(&file)?;
        let (inputs, processes, buffers) = Builder::new(&file).build(plugins, &mut params)?;
        params.read_rest_of_course(plugins)?;
        params.warn_of_unused_course();
        let hash = hash_of(&file, &processes);
        let ParamReader { files, warnings, .. } = params;
        Ok(Self { file, hash, inputs, processes, buffers, files, authority_ns, warnings })
    }

    /// The stack of a recorded run, from the text and the parameters in its identity. Files are read only for overrides
    /// of parameters; a course is one of the parameters.
    pub fn of_run(
        run: &rcs::RunInfo,
        plugins: &[ProcessType],
        options: &PlanOptions<'_>,
    ) -> Result<Self, StackError> {
        let file = StackFile::parse(&format!("{} (recorded)", run.stack), &run.stack_text)?;
        let mut params = ParamReader::given(&file, run, *options);
        plugins.iter().for_each(ProcessType::register);
        let authority_ns = authority_ns(&file)?;
        let (inputs, processes, buffers) = Builder::new(&file).build(plugins, &mut params)?;
        let hash = hash_of(&file, &processes);
        let ParamReader { files, warnings, .. } = params;
        Ok(Self { file, hash, inputs, processes, buffers, files, authority_ns, warnings })
    }
}

/// Hash of the text and of every parameter, whatever its origin.
fn hash_of(file: &StackFile, processes: &[ProcessPlan]) -> String {
    let mut hasher = blake3::Hasher::new();
    let mut part = |bytes: &[u8]| {
        hasher.update(&(bytes.len() as u64).to_le_bytes());
        hasher.update(bytes);
    };
    part(file.text.as_bytes());
    for process in processes {
        part(process.name.as_bytes());
        part(&process.params.bytes());
    }
    hasher.finalize().to_hex()[..16].to_owned()
}

/// The stack's `authority_s`; default 10 s.
fn authority_ns(file: &StackFile) -> Result<u64, StackError> {
    let Some(seconds) = &file.content.authority_s else { return Ok(10_000_000_000) };
    if !(0.1..=3600.0).contains(seconds.get_ref()) {
        let message = format!("{} s is out of range; expected 0.1 to 3600", seconds.get_ref());
        return Err(file.error(&seconds.span(), message));
    }
    Ok((seconds.get_ref() * 1e9).round() as u64)
}
