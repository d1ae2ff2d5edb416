//! The course of a run, and the files that come with it.

use super::assets::{Asset, Assets};
use super::error::StackError;
use super::file::StackFile;

/// The course of a run: a file that can name other files by their kind, such as `world = "meadow"`.
#[derive(Clone, Debug)]
pub(super) struct Course {
    asset: Asset,
    table: toml::Table,
}

impl Course {
    /// The course with the name from the command line, else that of the stack.
    pub(super) fn read(
        file: &StackFile,
        name: Option<&str>,
        assets: &dyn Assets,
    ) -> Result<Option<Self>, StackError> {
        let own = file.content.course.as_ref();
        let asset = match (name, own) {
            (Some(name), _) => assets.read("course", name, "").map_err(|message| StackError {
                file: "--course".to_owned(),
                line: 0,
                message,
            })?,
            (None, Some(own)) => assets
                .read("course", own.get_ref(), &file.file)
                .map_err(|message| file.error(&own.span(), message))?,
            (None, None) => return Ok(None),
        };
        let table = toml::from_str(&asset.text).map_err(|error: toml::de::Error| {
            StackError::at(&asset.file, &asset.text, &error.span().unwrap_or(0..0), error.message().trim())
        })?;
        Ok(Some(Self { asset, table }))
    }

    /// Name of its file.
    pub(super) fn file(&self) -> &str {
        &self.asset.file
    }

    /// The file of a kind that belongs to the course: the course itself, or one that it names.
    pub(super) fn asset(&self, kind: &str, assets: &dyn Assets) -> Result<Option<Asset>, StackError> {
        if kind == "course" {
            return Ok(Some(self.asset.clone()));
        }
        let Some(value) = self.table.get(kind) else { return Ok(None) };
        let error = |message: String| {
            let line = self.asset.text.lines().position(|line| line.trim_start().starts_with(kind));
            StackError { file: self.asset.file.clone(), line: line.map_or(1, |line| line + 1), message }
        };
        let Some(name) = value.as_str() else {
            return Err(error(format!("{kind} is {value}; expected the name of a file in quotes")));
        };
        assets.read(kind, name, &self.asset.file).map(Some).map_err(error)
    }
}
