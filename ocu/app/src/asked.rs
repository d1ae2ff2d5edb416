//! What the command line of the window asks for: told apart by the endings of files, and refused before a window opens.
//!
//! Only what costs little is checked: that files are there, the first bytes of a recording, and the text of a stack. The
//! rest is found when the source is opened, which the window waits for.

use crate::assets::{ProgramAssets, looks_like_path};
use crate::cli::{Cli, WindowArgs};
use crate::open::{FileKind, Request};
use crate::remembered::parse_remembered;
use crate::{parts, stacks, usage};
use clap::CommandFactory as _;
use clap::error::{ContextKind, ContextValue};
use rcs_log::Log;
use rcs_runtime::Assets as _;
use std::path::{Path, PathBuf};

/// The same arguments, with stacks, layouts and what a run remembers in their places where they are named like
/// recordings, as files that are dropped on the window are told apart.
pub(crate) fn sorted(args: &WindowArgs) -> anyhow::Result<WindowArgs> {
    let mut sorted = WindowArgs { log: None, parts: Vec::new(), ..args.clone() };
    for path in args.log.iter().chain(&args.parts) {
        let name = path.display().to_string();
        let is_second = match FileKind::of(path) {
            FileKind::Recording if sorted.log.is_none() => {
                sorted.log = Some(path.clone());
                false
            }
            FileKind::Recording => {
                sorted.parts.push(path.clone());
                false
            }
            FileKind::Stack => sorted.stack.replace(name).is_some(),
            FileKind::Layout => sorted.layout.replace(name).is_some(),
            FileKind::Remembered => {
                let remembered = parse_remembered(&name).map_err(usage)?;
                sorted.remembered.replace(remembered).is_some()
            }
        };
        if is_second {
            return Err(usage(format!(
                "expected one stack, one layout and one file of what a run remembers, got a second one: {}",
                path.display()
            )));
        }
    }
    Ok(sorted)
}

/// Refuses a request whose recording, stack or course is not there, or is something else.
pub(crate) fn check(request: &Request) -> anyhow::Result<()> {
    if let Some(log) = &request.log {
        check_log(log, &request.parts)?;
    }
    if let Some(stack) = &request.stack {
        stacks::named(stack)?;
    }
    if let Some(course) = &request.course {
        ProgramAssets.read("course", course, "").map_err(|error| usage(format!("--course: {error}")))?;
    }
    Ok(())
}

fn check_log(path: &Path, further: &[PathBuf]) -> anyhow::Result<()> {
    if let Some(word) = path.to_str().filter(|word| !looks_like_path(word)) {
        return Err(no_command(word));
    }
    let files = if further.is_empty() {
        parts::of(path)?
    } else {
        std::iter::once(path.to_owned()).chain(further.iter().cloned()).collect()
    };
    Log::probe_parts(&files).map_err(|error| usage(error.to_string()))
}

/// The error for a word that is neither a command nor a file.
fn no_command(word: &str) -> anyhow::Error {
    let meant = match close_to(word).last() {
        Some(command) => format!("did you mean `ocu {command}`? "),
        None => String::new(),
    };
    usage(format!("no command or file is called {word:?}; {meant}see `ocu --help`"))
}

/// The commands whose names are close to a word, the closest one last, as the command line finds them where it expects a
/// command.
fn close_to(word: &str) -> Vec<String> {
    let commands: Vec<clap::Command> = Cli::command().get_subcommands().cloned().collect();
    let refused = clap::Command::new("ocu").subcommands(commands).try_get_matches_from(["ocu", word]).err();
    match refused.as_ref().and_then(|error| error.get(ContextKind::SuggestedSubcommand)) {
        Some(ContextValue::Strings(names)) => names.clone(),
        Some(ContextValue::String(name)) => vec![name.clone()],
        _ => Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(files: &[&str]) -> anyhow::Result<WindowArgs> {
        let mut files = files.iter().map(PathBuf::from);
        sorted(&WindowArgs { log: files.next(), parts: files.collect(), ..WindowArgs::default() })
    }

    #[test]
    fn a_stack_or_a_layout_that_is_named_like_a_recording_is_taken_for_what_it_is() {
        let args = of(&["my/stack.TOML"]).unwrap();
        assert_eq!((args.log.as_ref(), args.stack.as_deref()), (None, Some("my/stack.TOML")));
        let args = of(&["a_0.mcap", "a_1.mcap", "stack.toml", "mine.ron"]).unwrap();
        assert_eq!((args.log, args.parts), (Some("a_0.mcap".into()), vec!["a_1.mcap".into()]));
        assert_eq!((args.stack.as_deref(), args.layout.as_deref()), (Some("stack.toml"), Some("mine.ron")));
        let refused = of(&["one.toml", "other.toml"]).unwrap_err();
        assert!(refused.is::<crate::Usage>() && refused.to_string().ends_with(": other.toml"), "{refused}");
        let refused = of(&["absent.json"]).unwrap_err();
        assert!(refused.is::<crate::Usage>() && refused.to_string().contains("absent.json"), "{refused}");
    }

    #[test]
    fn what_cannot_be_opened_is_refused_with_the_reason() {
        let dir = tempfile::tempdir().unwrap();
        let file = |name: &str, bytes: &[u8]| {
            let path = dir.path().join(name);
            std::fs::write(&path, bytes).unwrap();
            path
        };
        let check = |request: Request| check(&request);
        let log = |path: &Path| Request { log: Some(path.to_owned()), ..Request::default() };
        let refused = |request: Request, parts: &[&str]| {
            let error = crate::say(&check(request).unwrap_err());
            assert!(parts.iter().all(|part| error.contains(part)), "{error}");
        };
        assert!(check(Request::simulation()).is_ok());
        // Whatever follows its first bytes is found when it is opened.
        let damaged = file("damaged.mcap", b"\x89MCAP0\r\nnonsense");
        assert!(check(log(&damaged)).is_ok());
        refused(log(&file("text.mcap", b"hello")), &["not an mcap log", "text.mcap"]);
        refused(log(&dir.path().join("absent.mcap")), &["cannot open the log", "absent.mcap"]);
        refused(log(dir.path().join("none").as_path()), &["cannot open the log"]);
        let stack = file("bad.toml", b"format = 1\nname = 3\n").display().to_string();
        refused(Request { stack: Some(stack), ..log(&damaged) }, &["bad.toml"]);
        let course = Some("nowhere".to_owned());
        refused(Request { course, ..Request::simulation() }, &["--course", "nowhere", "hill"]);
        // A recording of several files opens if one of them is a log, as long as all are there.
        let parts = vec![damaged.clone()];
        assert!(check(Request { parts, ..log(&dir.path().join("text.mcap")) }).is_ok());
    }

    #[test]
    fn a_word_that_is_no_file_is_taken_for_a_command_and_the_closest_one_is_named() {
        let refused = |word: &str| {
            let request = Request { log: Some(word.into()), ..Request::default() };
            check(&request).unwrap_err().to_string()
        };
        assert_eq!(refused("replay"), "no command or file is called \"replay\"; see `ocu --help`");
        let near = "no command or file is called \"inof\"; did you mean `ocu info`? see `ocu --help`";
        assert_eq!(refused("inof"), near);
        assert!(refused("rendr").contains("`ocu render`"), "{}", refused("rendr"));
    }
}
