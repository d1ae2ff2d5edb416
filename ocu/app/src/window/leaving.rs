//! Asks before a source is left that would be lost: one with commands, parameters or driving of the user, or one that is
//! being recorded. It is left for another source, or because the window closes.

use super::recording;
use crate::open::Request;
use egui::Align2;
use rcs_runtime::source::{Frame, SourceKind};
use std::path::PathBuf;

/// What leaving a source ends.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Lost {
    /// Whether there are writes into its runs.
    has_acts: bool,
    /// The file of the recording that ends.
    recording: Option<PathBuf>,
}

impl Lost {
    /// What leaving this source ends; `None` if nothing would be lost.
    pub(super) fn with(frame: &Frame) -> Option<Self> {
        let has_acts = frame.info.kind != SourceKind::Log && frame.runs.all.iter().any(|run| run.writes > 0);
        let recording = recording::running(frame).map(|recording| recording.path.clone());
        (has_acts || recording.is_some()).then_some(Self { has_acts, recording })
    }

    fn text(&self) -> String {
        let ends = |path: &PathBuf| format!("The recording ends here: {}", path.display());
        match (self.has_acts, &self.recording) {
            (true, Some(path)) => format!(
                "Acts of before the recording began, and of other runs, cannot be shown again. {}",
                ends(path)
            ),
            (false, Some(path)) => ends(path),
            (true, None) => {
                "Acts of yours are in it, and it is not recorded: it cannot be shown again.".to_owned()
            }
            (false, None) => String::new(),
        }
    }
}

/// How a source comes after this one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Opened {
    /// It is another one.
    Other,
    /// It is this one again.
    Again,
    /// It is this one with what a run remembers.
    NextRun,
}

/// What comes after the source.
#[derive(Debug)]
pub(super) enum Next {
    /// Another source, or this one again.
    Open(Request, Opened),
    /// The window closes.
    Close,
}

impl Next {
    /// A source in place of the current one.
    pub(super) fn open(request: Request, current: &Request) -> Self {
        let opened = if request == *current {
            Opened::Again
        } else if request.repeats(current) && request.remembered.is_some() {
            Opened::NextRun
        } else {
            Opened::Other
        };
        Self::Open(request, opened)
    }

    /// What the button that leaves is called.
    fn name(&self) -> String {
        match self {
            Self::Open(request, Opened::Other) => format!("Leave it, open {}", request.title()),
            Self::Open(_, Opened::Again) => "Leave it, start again".to_owned(),
            Self::Open(_, Opened::NextRun) => "Leave it, begin the next run".to_owned(),
            Self::Close => "Leave it, close the window".to_owned(),
        }
    }
}

/// The question, while it is open, and whether the window may close.
#[derive(Debug, Default)]
pub(super) struct Leaving {
    question: Option<(Next, Lost)>,
    may_close: bool,
}

/// The answer.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Answer {
    Open,
    Stay,
    Leave,
}

impl Leaving {
    /// Opens the question.
    pub(super) fn ask(&mut self, next: Next, lost: Lost) {
        self.question = Some((next, lost));
    }

    /// Whether the window stays open although it is to close, until the question is answered.
    pub(super) fn keeps_open(&mut self, lost: Option<Lost>) -> bool {
        let Some(lost) = lost.filter(|_| !self.may_close) else { return false };
        self.ask(Next::Close, lost);
        true
    }

    /// Paints the question while it is open; returns what comes next, once the user agrees.
    pub(super) fn ui(&mut self, ctx: &egui::Context) -> Option<Next> {
        let (next, lost) = self.question.as_ref()?;
        match question_ui(ctx, &lost.text(), &next.name()) {
            Answer::Open => None,
            Answer::Stay => {
                self.question = None;
                None
            }
            Answer::Leave => {
                let (next, _) = self.question.take()?;
                self.may_close = matches!(next, Next::Close);
                Some(next)
            }
        }
    }
}

/// Paints the question, with the name of the button that leaves.
fn question_ui(ctx: &egui::Context, text: &str, leave: &str) -> Answer {
    let mut answer = Answer::Open;
    let mut open = true;
    egui::Window::new("Leave this run?")
        .collapsible(false)
        .resizable(false)
        .anchor(Align2::CENTER_CENTER, egui::Vec2::ZERO)
        .open(&mut open)
        .show(ctx, |ui| {
            ui.set_max_width(360.0);
            ui.add(egui::Label::new(text).wrap());
            ui.add_space(8.0);
            ui.horizontal(|ui| {
                let stay = ui.button("Stay");
                if ui.memory(|memory| memory.focused().is_none()) {
                    stay.request_focus();
                }
                if stay.clicked() {
                    answer = Answer::Stay;
                }
                if ui.button(leave).clicked() {
                    answer = Answer::Leave;
                }
            });
        });
    let escaped = ctx.input(|input| input.key_pressed(egui::Key::Escape));
    match answer {
        Answer::Open if !open || escaped => Answer::Stay,
        answer => answer,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::remembered::Remembered;

    #[test]
    fn the_window_stays_open_until_the_user_agrees_to_what_is_lost() {
        let lost = || Some(Lost { has_acts: true, recording: None });
        let mut leaving = Leaving::default();
        assert!(!leaving.keeps_open(None) && leaving.question.is_none());
        assert!(leaving.keeps_open(lost()));
        assert!(matches!(leaving.question, Some((Next::Close, _))));
        assert!(leaving.keeps_open(lost()), "a second attempt asks again");
        leaving.may_close = true;
        assert!(!leaving.keeps_open(lost()));
    }

    #[test]
    fn the_button_that_leaves_says_what_comes_next() {
        let current = Request { stack: Some("lagr".to_owned()), ..Request::default() };
        let name = |request: Request, current: &Request| Next::open(request, current).name();
        let next = current.remembering(Remembered::default(), Some(1));
        assert_eq!(name(next.clone(), &current), "Leave it, begin the next run");
        assert_eq!(
            name(next.remembering(Remembered::default(), Some(2)), &next),
            "Leave it, begin the next run"
        );
        assert_eq!(name(next.clone(), &next), "Leave it, start again");
        assert_eq!(name(current.clone(), &next), "Leave it, open lagr");
        let log = Request { log: Some("drive.mcap".into()), ..Request::default() };
        assert_eq!(name(log, &current), "Leave it, open drive.mcap");
    }

    #[test]
    fn the_question_says_what_is_lost() {
        let text = |has_acts, recording: Option<&str>| {
            Lost { has_acts, recording: recording.map(PathBuf::from) }.text()
        };
        assert_eq!(
            text(true, None),
            "Acts of yours are in it, and it is not recorded: it cannot be shown again."
        );
        let ends = "The recording ends here: a.mcap";
        assert_eq!(text(false, Some("a.mcap")), ends);
        let acts = "Acts of before the recording began, and of other runs, cannot be shown again.";
        assert_eq!(text(true, Some("a.mcap")), format!("{acts} {ends}"));
    }
}
