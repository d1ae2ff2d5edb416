//! The buffers of one run.

use crate::buffer::{Buffer, BufferSpec};
use crate::sample::WriterId;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Why a buffer or a writer could not join a bus.
#[derive(Debug, thiserror::Error)]
pub enum BusError {
    /// The name is in use.
    #[error("there is already a buffer named {0}")]
    Duplicate(String),
    /// There are too many writers.
    #[error("a run has at most {} writers", u16::MAX)]
    TooManyWriters,
}

/// The buffers of one run by name, and the names of its writers. It is built once, then shared.
pub struct Bus {
    buffers: BTreeMap<String, Arc<Buffer>>,
    writers: Vec<Arc<str>>,
    /// Whether any buffer may have overrides.
    overridden: Arc<AtomicBool>,
}

impl Default for Bus {
    fn default() -> Self {
        Self {
            buffers: BTreeMap::new(),
            writers: vec!["operator".into(), "runtime".into()],
            overridden: Arc::default(),
        }
    }
}

impl Bus {
    /// Adds a buffer.
    pub fn add(&mut self, spec: BufferSpec) -> Result<Arc<Buffer>, BusError> {
        if self.buffers.contains_key(&spec.name) {
            return Err(BusError::Duplicate(spec.name));
        }
        let name = spec.name.clone();
        let buffer = Buffer::on_bus(spec, Arc::clone(&self.overridden));
        self.buffers.insert(name, Arc::clone(&buffer));
        Ok(buffer)
    }

    /// Whether any buffer may have overrides: set when one is set or restored, cleared by a caller that finds none.
    pub fn overridden(&self) -> &Arc<AtomicBool> {
        &self.overridden
    }

    /// Adds a writer and returns its number.
    pub fn add_writer(&mut self, name: &str) -> Result<WriterId, BusError> {
        let id = u16::try_from(self.writers.len()).map_err(|_| BusError::TooManyWriters)?;
        self.writers.push(name.into());
        Ok(WriterId(id))
    }

    /// The buffer with this name.
    pub fn get(&self, name: &str) -> Option<&Arc<Buffer>> {
        self.buffers.get(name)
    }

    /// All buffers, sorted by name.
    pub fn buffers(&self) -> impl Iterator<Item = &Arc<Buffer>> {
        self.buffers.values()
    }

    /// Name of a writer.
    pub fn writer_name(&self, id: WriterId) -> Arc<str> {
        self.writers.get(usize::from(id.0)).cloned().unwrap_or_else(|| "unknown".into())
    }
}
