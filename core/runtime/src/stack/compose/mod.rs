//! Composition of stacks: `[[include]]` inserts another stack file, and `[change.<process>]` changes a process of an
//! include.
//!
//! Composition works on text. Its result is the text of one stack file without includes, which is checked, hashed and
//! recorded, and for each of its lines the file and line of origin.
//!
//! ```toml
//! [[include]]
//! part = "stereo_pair"           # a bundled part by name, or a file by path
//! with = { side = "left" }       # values of the part's arguments
//!
//! [change.obstacles_left]        # keys of a process; tables are merged key by key
//! params = { max_range_m = 16.0 }
//! ```
//!
//! A part declares its arguments, and uses them in any text: `name = "stereo_${side}"`. A text that is only an argument
//! takes the type of the argument: `max_range_m = "${range_m}"`.
//!
//! ```toml
//! [arguments]
//! side = { help = "left or right" }
//! range_m = { help = "farthest point that is used, m", default = 10.0 }
//! ```
//!
//! What a part says of the whole stack (`course`, `remembers`, `authority_s`) counts where the including file does not
//! say it.

mod arguments;
mod blocks;
mod change;
mod head;

use super::assets::Assets;
use super::error::{StackError, one_of};
use arguments::Arguments;
use blocks::{Block, split};
pub(crate) use head::FORMAT;
use head::Inherited;
use serde::Deserialize;
use std::collections::BTreeMap;
use toml::Spanned;

/// Greatest depth of nested includes.
const DEPTH: usize = 8;

/// Origin of a line of a composed stack.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Origin {
    /// Name of the file in errors.
    pub file: String,
    /// Line in it, from 1.
    pub line: usize,
}

/// A composed stack file.
#[derive(Clone, Debug)]
pub(crate) struct Composed {
    pub(crate) text: String,
    /// Origins, one per line of the text.
    pub(crate) origins: Vec<Origin>,
}

/// A block `[[include]]`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Include {
    /// Name of a bundled part, or path of a file.
    part: Spanned<String>,
    /// Values of its arguments.
    #[serde(default)]
    with: BTreeMap<String, toml::Value>,
}

/// Composes a stack file. A file without includes and changes is not modified.
pub(crate) fn compose(file: &str, text: &str, assets: &dyn Assets) -> Result<Composed, StackError> {
    let mut blocks = expand(file, text, &Arguments::default(), assets, &mut vec![file.to_owned()])?;
    change::apply(&mut blocks)?;
    let lines = keep_last_of_each_buffer(blocks).into_iter().flat_map(|block| block.lines);
    let mut composed = Composed { text: String::new(), origins: Vec::new() };
    for line in lines {
        composed.text.push_str(&line.text);
        composed.text.push('\n');
        composed.origins.push(line.origin);
    }
    if !text.ends_with('\n') {
        composed.text.pop();
    }
    Ok(composed)
}

/// The blocks of a file, the first of which is its head, with each include replaced by the blocks of its part. `above`
/// are the files that include it.
fn expand(
    file: &str,
    text: &str,
    arguments: &Arguments,
    assets: &dyn Assets,
    above: &mut Vec<String>,
) -> Result<Vec<Block>, StackError> {
    // The text must be valid before arguments are substituted, because they are inside of texts.
    toml::from_str::<toml::Table>(text).map_err(|error| {
        StackError::at(file, text, &error.span().unwrap_or(0..0), error.message().trim().to_owned())
    })?;
    let mut blocks = Vec::new();
    let mut of_parts = Vec::new();
    for mut block in split(file, text) {
        if block.is("arguments") {
            continue;
        }
        arguments.fill(&mut block)?;
        if !block.is_head() {
            block.read_header();
        }
        if block.is("include") {
            let (part, inherited) = included(&block, assets, above)?;
            blocks.extend(part);
            of_parts.extend(inherited);
        } else {
            blocks.push(block);
        }
    }
    head::inherit(&mut blocks[0], of_parts)?;
    Ok(blocks)
}

/// The blocks of a part without its head, and the keys of its head that hold for the whole stack.
fn included(
    block: &Block,
    assets: &dyn Assets,
    above: &mut Vec<String>,
) -> Result<(Vec<Block>, Vec<Inherited>), StackError> {
    let include: Include = block.parse("include")?;
    let error = |message: String| block.error(include.part.span().start, message);
    let part = include.part.get_ref();
    let asset = assets.read("part", part, &block.origin().file).map_err(error)?;
    if above.contains(&asset.file) {
        return Err(error(format!("{} includes itself: {}", asset.file, above.join(" includes "))));
    }
    if above.len() >= DEPTH {
        return Err(error(format!(
            "more than {DEPTH} files include each other: {}",
            above.join(" includes ")
        )));
    }
    let arguments =
        Arguments::of(&asset.file, &asset.text, include.with).map_err(|problem| match problem {
            arguments::Problem::InPart(error) => error,
            arguments::Problem::InInclude(message) => error(message),
        })?;
    above.push(asset.file.clone());
    let mut blocks = expand(&asset.file, &asset.text, &arguments, assets, above)?;
    above.pop();
    let head = blocks.remove(0);
    let inherited = head::inherited(&head)?;
    Ok((blocks, inherited))
}

/// Of several blocks for one buffer the last counts, because a file comes after the parts that it includes.
fn keep_last_of_each_buffer(blocks: Vec<Block>) -> Vec<Block> {
    let mut last: BTreeMap<String, usize> = BTreeMap::new();
    for (index, block) in blocks.iter().enumerate() {
        if block.is("buffers") {
            last.insert(block.header.clone(), index);
        }
    }
    let keep = |(index, block): &(usize, Block)| {
        last.get(&block.header).is_none_or(|last| !block.is("buffers") || last == index)
    };
    blocks.into_iter().enumerate().filter(keep).map(|(_, block)| block).collect()
}
