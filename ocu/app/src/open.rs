//! Opens what the user named (a recording, a stack, or a stack on a recording) as a source.

use crate::assets::looks_like_path;
use crate::cli::WindowArgs;
use crate::past_args::PastArgs;
use crate::remembered::Remembered;
use rcs_runtime::source::{SourceInfo, SourceKind};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// What to open.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Request {
    /// The recording.
    pub log: Option<PathBuf>,
    /// Further files of it, if it was split and they are named.
    pub parts: Vec<PathBuf>,
    /// The stack, running on the recording or closed-loop: name of a bundled one, or a file.
    pub stack: Option<String>,
    /// The course of a simulation: name of a bundled one, or a file; `None` for the stack's own.
    pub course: Option<String>,
    /// Seed of the random numbers; `None` for that of the recorded run that the stack reads, else 0.
    pub seed: Option<u64>,
    /// What an earlier run remembers, with which the stack begins.
    pub remembered: Option<Arc<Remembered>>,
    /// Limits of the history kept of a run.
    pub past: PastArgs,
    /// Of a run of a sweep: what tells it from the others, and the log that it read.
    pub run: Option<Box<SweptRun>>,
}

/// A run of a sweep.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SweptRun {
    /// What tells it from the others.
    pub title: String,
    /// The log that it read.
    pub log: Option<PathBuf>,
    /// Further files of it, if it was split and they are named.
    pub parts: Vec<PathBuf>,
}

/// What a file is that a person names, drops or chooses, by the ending of its name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum FileKind {
    /// Any other ending.
    Recording,
    /// `.toml`
    Stack,
    /// `.ron`
    Layout,
    /// What a run remembers: `.json`
    Remembered,
}

impl FileKind {
    pub(crate) fn of(path: &Path) -> Self {
        let is = |ending: &str| path.extension().is_some_and(|known| known.eq_ignore_ascii_case(ending));
        if is("toml") {
            Self::Stack
        } else if is("ron") {
            Self::Layout
        } else if is("json") {
            Self::Remembered
        } else {
            Self::Recording
        }
    }
}

/// What is between the parts of a source's title.
const BETWEEN: &str = " · ";

/// The bundled stack that is opened by default: a simulated robot that drives to the goal of its course.
const SIMULATION: &str = "lagr";

impl Request {
    /// The request of a command line; the simulation if it names neither a recording nor a stack.
    pub fn of(args: &WindowArgs) -> Self {
        let alone = args.log.is_none() && args.stack.is_none();
        Self {
            log: args.log.clone(),
            parts: args.parts.clone(),
            stack: args.stack.clone().or_else(|| alone.then(|| SIMULATION.to_owned())),
            course: args.course.clone(),
            seed: args.seed,
            remembered: args.remembered.clone(),
            past: args.past.clone(),
            run: None,
        }
    }

    /// The simulation, on the course named by its stack.
    pub fn simulation() -> Self {
        Self::of(&WindowArgs::default())
    }

    /// Whether the window shows the robot standing before its course, so that a person sends it.
    pub fn waits(&self) -> bool {
        self.log.is_none() && self.stack.as_deref() == Some(SIMULATION)
    }

    /// The request for a file dropped on the window: a stack runs on the open recording, any other file is opened as a
    /// recording.
    pub fn dropped(path: &Path, current: &Self) -> Self {
        if FileKind::of(path) == FileKind::Stack {
            let past = current.past.clone();
            Self {
                log: current.log.clone(),
                parts: current.parts.clone(),
                stack: Some(path.display().to_string()),
                past,
                ..Self::default()
            }
        } else {
            Self { log: Some(path.to_owned()), past: current.past.clone(), ..Self::default() }
        }
    }

    /// The request for the same stack, which begins with what an earlier run remembers. Another seed makes it another run.
    #[must_use]
    pub fn remembering(&self, remembered: Remembered, seed: Option<u64>) -> Self {
        Self { remembered: Some(Arc::new(remembered)), seed, ..self.clone() }
    }

    /// Whether it runs the same stack on the same recording and course. The seed, and what an earlier run remembers, may
    /// differ.
    pub fn repeats(&self, other: &Self) -> bool {
        *self == Self { seed: self.seed, remembered: self.remembered.clone(), ..other.clone() }
    }

    /// The request for its recording as it is, with all files that are named; `None` without a recording.
    pub fn recording(&self) -> Option<Self> {
        let log = Some(self.log.clone()?);
        Some(Self { log, parts: self.parts.clone(), ..Self::default() })
    }

    /// The files or the folder of its recording, as they are named.
    pub fn files(&self) -> impl Iterator<Item = &PathBuf> {
        self.log.iter().chain(&self.parts)
    }

    /// The first of the files that it names that is not there; `None` if all are. A bundled stack or course is no file.
    pub fn missing(&self) -> Option<&Path> {
        let named = self.stack.iter().chain(&self.course).map(String::as_str);
        let named = named.filter(|name| looks_like_path(name)).map(Path::new);
        self.files().map(PathBuf::as_path).chain(named).find(|path| !path.exists())
    }

    /// Title of the open source. A stack from a file is called by its file, because copies of a stack, such as one that
    /// parameters were saved to, all have the name that is written in them.
    pub fn shown_title(&self, info: &SourceInfo) -> String {
        let file = self.stack.as_deref().filter(|stack| looks_like_path(stack)).map(Path::new);
        let Some(file) = file.and_then(Path::file_name) else { return info.title.clone() };
        let mut parts: Vec<&str> = info.title.split(BETWEEN).collect();
        let name = file.to_string_lossy();
        // The recording comes before the stack that runs on it.
        if let Some(stack) = parts.get_mut(usize::from(info.kind == SourceKind::Replay)) {
            *stack = &name;
        }
        parts.join(BETWEEN)
    }

    /// Title of what is being opened.
    pub fn title(&self) -> String {
        let file = |path: &Path| path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
        match (&self.log, &self.stack) {
            (Some(log), Some(stack)) => format!("{} through {}", file(log), file(Path::new(stack))),
            (Some(log), None) => file(log),
            (None, Some(stack)) => match &self.course {
                Some(course) => format!("{} on {}", file(Path::new(stack)), file(Path::new(course))),
                None => file(Path::new(stack)),
            },
            (None, None) => String::new(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_argument_opens_the_simulation_and_a_course_alone_opens_it_there() {
        assert_eq!(Request::simulation().title(), "lagr");
        let hill = Request::of(&WindowArgs { course: Some("hill".into()), ..WindowArgs::default() });
        assert_eq!(hill.title(), "lagr on hill");
        assert!(hill.waits() && !Request { stack: Some("simulation".into()), ..hill }.waits());
        let log = Request::of(&WindowArgs { log: Some("a.mcap".into()), ..WindowArgs::default() });
        assert_eq!((log.log, log.stack), (Some("a.mcap".into()), None));
    }

    #[test]
    fn the_next_run_and_another_seed_repeat_a_request_and_another_course_does_not() {
        let current = Request { course: Some("hill".into()), ..Request::simulation() };
        assert!(current.remembering(Remembered::default(), Some(1)).repeats(&current));
        assert!(Request { seed: Some(2), ..current.clone() }.repeats(&current));
        assert!(!Request { course: Some("meadow".into()), ..current.clone() }.repeats(&current));
        assert!(!Request { stack: Some("husky".into()), ..current.clone() }.repeats(&current));
        assert!(!Request { log: Some("a.mcap".into()), ..current.clone() }.repeats(&current));
    }

    #[test]
    fn a_stack_from_a_file_is_called_by_its_file() {
        let title = |stack: &str, kind, title: &str| {
            let info = SourceInfo { kind, title: title.to_owned(), ..SourceInfo::default() };
            Request { stack: Some(stack.to_owned()), ..Request::default() }.shown_title(&info)
        };
        assert_eq!(title("lagr", SourceKind::Stack, "lagr"), "lagr");
        assert_eq!(title("/tmp/mine.toml", SourceKind::Stack, "lagr · seed 3"), "mine.toml · seed 3");
        assert_eq!(title("./mine.toml", SourceKind::Replay, "a.mcap · lagr"), "a.mcap · mine.toml");
    }

    #[test]
    fn a_dropped_stack_runs_on_the_open_recording_and_a_dropped_recording_replaces_it() {
        let current =
            Request { log: Some("a.mcap".into()), stack: Some("sample".into()), ..Request::default() };
        let stack = Request::dropped(Path::new("/x/Mine.TOML"), &current);
        assert_eq!(stack, Request { stack: Some("/x/Mine.TOML".into()), ..current.clone() });
        assert_eq!(stack.title(), "a.mcap through Mine.TOML");
        let log = Request::dropped(Path::new("/x/b.mcap"), &current);
        assert_eq!(log, Request { log: Some("/x/b.mcap".into()), ..Request::default() });
        assert_eq!(log.title(), "b.mcap");
    }
}
