//! Opens sources in the background, and asks the user which one.

use super::complete::{Completion, MOST_LISTED, expanded};
use super::dialog::closing_hint;
use crate::layout::write_whole;
use crate::open::Request;
use crate::say;
use ocu_ui::{icons, tokens, typing, widgets};
use rcs_msg::guard::guarded;
use rcs_runtime::source::Source;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, channel};
use std::thread;
use std::time::{Duration, Instant};

/// Number of recent recordings that are remembered.
const MOST_RECENT: usize = 10;
/// What is between the files of one recording in the list of recent recordings.
const BETWEEN: &str = "\t";
/// A file dialog that closes sooner than this was not shown to the user.
const SEEN: Duration = Duration::from_millis(400);

/// Result sent by the opening thread.
type Opened = anyhow::Result<Box<dyn Source>>;

/// Result of opening.
pub(super) enum Outcome {
    Opened(Request, Box<dyn Source>),
    Failed(String),
}

/// Opens sources in the background, and shows the dialog.
pub(super) struct Opener {
    ctx: egui::Context,
    pending: Option<(Request, Receiver<Opened>)>,
    browsing: Option<Receiver<(Option<PathBuf>, Duration)>>,
    recent: Recent,
    /// The dialog, while it is open.
    dialog: Option<Dialog>,
    /// The path that was last chosen in the dialog, and its text there, until a source opens.
    tried: Option<(PathBuf, String)>,
}

#[derive(Default)]
struct Dialog {
    path: String,
    /// Why the path could not be opened.
    failed: Option<String>,
    hint: Option<&'static str>,
    fresh: bool,
    completion: Completion,
}

impl Opener {
    pub(super) fn new(ctx: &egui::Context, data_dir: Option<&Path>) -> Self {
        let recent = Recent::load(data_dir.map(|dir| dir.join("recent.txt")));
        Self { ctx: ctx.clone(), pending: None, browsing: None, recent, dialog: None, tried: None }
    }

    /// Starts to open a source; a previous request is dropped.
    pub(super) fn open(&mut self, request: Request) {
        self.open_by(request, crate::stacks::open);
    }

    /// Like [`Opener::open`], with the function that opens.
    fn open_by(&mut self, request: Request, open: impl FnOnce(&Request) -> Opened + Send + 'static) {
        let (sender, receiver) = channel();
        let (ctx, what) = (self.ctx.clone(), request.clone());
        let spawned = thread::Builder::new().name("open".to_owned()).spawn(move || {
            let opened = guarded(|| open(&what));
            let opened = opened.unwrap_or_else(|said| Err(anyhow::anyhow!("it cannot be opened: {said}")));
            // Fails if the request has been dropped.
            let _ = sender.send(opened);
            ctx.request_repaint();
        });
        if let Err(error) = spawned {
            tracing::error!("no thread to open {}: {error}", request.title());
        }
        self.pending = Some((request, receiver));
    }

    /// Title of the source being opened.
    pub(super) fn opening(&self) -> Option<String> {
        self.pending.as_ref().map(|(request, _)| request.title())
    }

    /// The result since the last call, if any.
    pub(super) fn poll(&mut self) -> Option<Outcome> {
        let result = self.pending.as_ref()?.1.try_recv();
        if matches!(result, Err(std::sync::mpsc::TryRecvError::Empty)) {
            return None;
        }
        let (request, _) = self.pending.take()?;
        match result {
            Ok(Ok(source)) => {
                self.tried = None;
                self.recent.add(&request);
                Some(Outcome::Opened(request, source))
            }
            Ok(Err(error)) => self.failed(&request, say(&error)),
            Err(_) => self.failed(&request, format!("opening stopped unexpectedly: {}", request.title())),
        }
    }

    /// The outcome of a request that failed; `None` if the dialog says it.
    fn failed(&mut self, request: &Request, reason: String) -> Option<Outcome> {
        let stack = request.stack.as_deref().map(Path::new);
        let mut asked = request.files().map(PathBuf::as_path).chain(stack);
        let tried = self.tried.as_ref().map(|(path, _)| path.clone());
        match tried.filter(|tried| asked.any(|path| path == tried)) {
            Some(path) => self.ask_again(&path, reason).map(Outcome::Failed),
            None => Some(Outcome::Failed(reason)),
        }
    }

    /// Opens the dialog.
    pub(super) fn ask(&mut self) {
        self.dialog = Some(Dialog { fresh: true, ..Dialog::default() });
    }

    /// Opens the dialog again, with the path that was chosen in it and the reason why that cannot be opened. Returns the
    /// reason if the path was not chosen there, or if the dialog already asks for another one.
    pub(super) fn ask_again(&mut self, path: &Path, reason: String) -> Option<String> {
        let tried = self.tried.take_if(|(tried, _)| tried.as_path() == path);
        let Some((_, text)) = tried.filter(|_| self.dialog.is_none()) else { return Some(reason) };
        self.dialog = Some(Dialog { path: text, failed: Some(reason), fresh: true, ..Dialog::default() });
        None
    }

    /// Requests for the recently opened recordings, the newest first.
    pub(super) fn recent(&self) -> &[Request] {
        &self.recent.recordings
    }

    /// Paints the dialog while it is open: a path, recent recordings, and a button for the system's file dialog.
    /// Returns what was chosen.
    pub(super) fn ui(&mut self, ui: &egui::Ui) -> Option<Picked> {
        if let Some(chosen) = self.poll_browser() {
            self.dialog = None;
            self.tried = Some((chosen.clone(), chosen.display().to_string()));
            return Some(Picked::Path(chosen));
        }
        let dialog = self.dialog.as_mut()?;
        let (mut typed, mut recording, mut open, mut browse) = (None, None, true, false);
        egui::Window::new("Open a recording, a stack, a layout or what a run remembers")
            .collapsible(false)
            .resizable(false)
            .default_width(520.0)
            .anchor(egui::Align2::CENTER_CENTER, egui::Vec2::ZERO)
            .open(&mut open)
            .show(ui.ctx(), |ui| {
                typed = dialog.path_ui(ui);
                ui.horizontal(|ui| {
                    browse = ui.button(format!("{}  Browse…", icons::ICON_FOLDER_OPEN.codepoint)).clicked();
                    if let Some(hint) = dialog.hint {
                        ui.label(egui::RichText::new(hint).color(tokens(ui).warning));
                    }
                });
                if let Some(offered) = dialog.offers_ui(ui) {
                    typed = Some(offered);
                }
                if !self.recent.recordings.is_empty() {
                    ui.add_space(4.0);
                    ui.label(egui::RichText::new("Recent").small().color(tokens(ui).weak));
                }
                for recent in &self.recent.recordings {
                    let name = ("recent", &recent.log, &recent.parts);
                    if widgets::named(ui, name, |ui| recent_button(ui, recent).clicked()) {
                        recording = Some(recent.clone());
                    }
                }
                closing_hint(ui);
            });
        if browse {
            self.browse();
        }
        let escaped = ui.input(|input| input.key_pressed(egui::Key::Escape));
        let chosen = recording.map(Picked::Recent).or_else(|| typed.map(|text| self.tries(text)));
        if chosen.is_some() || !open || escaped {
            self.dialog = None;
        }
        chosen
    }

    /// A path that was chosen in the dialog, as it is typed there.
    fn tries(&mut self, text: String) -> Picked {
        let path = expanded(&text);
        self.tried = Some((path.clone(), text));
        Picked::Path(path)
    }

    /// Opens the system's file dialog on a thread of its own, because it blocks.
    fn browse(&mut self) {
        let (sender, receiver) = channel();
        let ctx = self.ctx.clone();
        let spawned = thread::Builder::new().name("file dialog".to_owned()).spawn(move || {
            let start = Instant::now();
            let chosen = rfd::FileDialog::new()
                .set_title("Open a recording or a stack")
                .add_filter(
                    "Recordings, stacks, layouts, what runs remember",
                    &["mcap", "toml", "ron", "json"],
                )
                .add_filter("All files", &["*"])
                .pick_file();
            let _ = sender.send((chosen, start.elapsed()));
            ctx.request_repaint();
        });
        if spawned.is_ok() {
            self.browsing = Some(receiver);
        }
    }

    fn poll_browser(&mut self) -> Option<PathBuf> {
        let (chosen, took) = self.browsing.as_ref()?.try_recv().ok()?;
        self.browsing = None;
        if let Some(dialog) = &mut self.dialog
            && chosen.is_none()
            && took < SEEN
        {
            dialog.hint = Some("This desktop has no file dialog; type a path.");
        }
        chosen
    }
}

impl Dialog {
    /// Paints the path, the button that opens it, and why that failed. Returns the path that is to be opened.
    fn path_ui(&mut self, ui: &mut egui::Ui) -> Option<String> {
        let mut chosen = None;
        ui.horizontal(|ui| {
            let label = ui.label("Path");
            let id = ui.scope_id().with("path");
            let tab = |input: &mut egui::InputState| input.consume_key(egui::Modifiers::NONE, egui::Key::Tab);
            let completes = ui.memory(|memory| memory.has_focus(id)) && ui.input_mut(tab);
            let common = completes.then(|| self.completion.common()).flatten();
            let longer = common.filter(|common| common.len() > self.path.len());
            let is_longer = longer.is_some();
            self.path = longer.unwrap_or_else(|| std::mem::take(&mut self.path));
            let edit = egui::TextEdit::singleline(&mut self.path).desired_width(380.0);
            // Tab completes the path; it leaves the field for the next widget where nothing completes it.
            let edit = edit.id(id).lock_focus(self.completion.common().is_some());
            let response = ui.add(edit).labelled_by(label.id);
            if is_longer {
                widgets::cursor_to_end(ui.ctx(), id, &self.path);
            }
            if is_longer || response.changed() {
                self.failed = None;
            }
            let entered = typing::entered(&response);
            typing::keep_keyboard(&response, std::mem::take(&mut self.fresh));
            let path = self.path.trim();
            let ready = !path.is_empty();
            if (ui.add_enabled(ready, egui::Button::new("Open")).clicked() || entered) && ready {
                chosen = Some(path.to_owned());
            }
        });
        if let Some(failed) = &self.failed {
            ui.add(egui::Label::new(egui::RichText::new(failed).color(tokens(ui).error)).wrap());
        }
        chosen
    }

    /// Paints what the path can be completed to. Returns the path of a file that was clicked.
    fn offers_ui(&mut self, ui: &mut egui::Ui) -> Option<String> {
        let typed = self.path.clone();
        let offered = self.completion.of(ui.ctx(), &typed);
        if typed.is_empty() {
            return None;
        }
        let mut chosen = None;
        for path in offered.iter().take(MOST_LISTED).filter(|path| **path != typed) {
            let weak = tokens(ui).weak;
            let icon = if path.ends_with('/') { icons::ICON_FOLDER } else { icons::ICON_DRAFT };
            let text = (icon.rich_text().color(weak), egui::RichText::new(path));
            // What is offered changes as the folder is read.
            let button = egui::Button::new(text).truncate().frame(false);
            let button = widgets::named(ui, path, |ui| ui.add(button));
            button.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Button, true, path));
            if button.clicked() {
                if path.ends_with('/') {
                    self.path.clone_from(path);
                    (self.fresh, self.failed) = (true, None);
                } else {
                    chosen = Some(path.clone());
                }
            }
        }
        let more = offered.len().saturating_sub(MOST_LISTED);
        if more > 0 {
            ui.label(egui::RichText::new(format!("and {more} more")).small().color(tokens(ui).weak));
        }
        chosen
    }
}

/// A button for a recent recording, with its name and, less prominent, its folder.
pub(super) fn recent_button(ui: &mut egui::Ui, recent: &Request) -> egui::Response {
    let name = match recent.parts.len() {
        0 => recent.title(),
        more => format!("{} and {more} more", recent.title()),
    };
    let folder = recent.log.as_deref().and_then(Path::parent).map(|folder| folder.display().to_string());
    let folder = folder.unwrap_or_default();
    let weak = tokens(ui).weak;
    let text = egui::RichText::new(&name);
    let button =
        egui::Button::new((text, egui::RichText::new(folder).small().color(weak))).truncate().frame(false);
    let response = ui.add(button);
    response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Button, true, &name));
    let files: Vec<String> = recent.files().map(|path| path.display().to_string()).collect();
    response.on_hover_text(files.join("\n"))
}

/// The list of recent recordings, stored in a file: a line for each, with all files that were named.
#[derive(Debug, Default)]
struct Recent {
    file: Option<PathBuf>,
    recordings: Vec<Request>,
}

impl Recent {
    fn load(file: Option<PathBuf>) -> Self {
        let text = file.as_deref().and_then(|file| std::fs::read_to_string(file).ok()).unwrap_or_default();
        let recording = |line: &str| {
            let mut files = line.split(BETWEEN).map(PathBuf::from);
            Request { log: files.next(), parts: files.collect(), ..Request::default() }
        };
        let recordings =
            text.lines().filter(|line| !line.is_empty()).map(recording).take(MOST_RECENT).collect();
        Self { file, recordings }
    }

    /// Adds the recording of a request, if it has one.
    fn add(&mut self, request: &Request) {
        let Some(mut recording) = request.recording() else { return };
        for path in recording.log.iter_mut().chain(&mut recording.parts) {
            *path = std::path::absolute(path.as_path()).unwrap_or_else(|_| path.clone());
        }
        self.recordings.retain(|known| *known != recording);
        self.recordings.insert(0, recording);
        self.recordings.truncate(MOST_RECENT);
        let mut text = String::new();
        for recording in &self.recordings {
            let files: Vec<String> = recording.files().map(|path| path.display().to_string()).collect();
            text += &files.join(BETWEEN);
            text.push('\n');
        }
        if let Some(file) = &self.file
            && let Err(error) = write_whole(file, &text)
        {
            tracing::warn!("the list of recent recordings was not kept: {error}");
        }
    }
}

/// Contents of an empty window.
pub(super) fn invitation(ui: &mut egui::Ui, recent: &[Request]) -> Option<Invited> {
    let mut invited = None;
    let tokens = tokens(ui);
    let height = ui.available_height();
    ui.vertical_centered(|ui| {
        ui.add_space((height * 0.3).max(16.0));
        ui.label(icons::ICON_FOLDER_OPEN.rich_text().size(32.0).color(tokens.unknown));
        ui.label(egui::RichText::new("Nothing is open").heading());
        ui.label(
            egui::RichText::new("Drop a recording (.mcap) here, or a stack (.toml).").color(tokens.weak),
        );
        ui.add_space(8.0);
        if ui.button("Open…").clicked() {
            invited = Some(Invited::Ask);
        }
        if ui.button("Start the simulation").clicked() {
            invited = Some(Invited::Open(Request::simulation()));
        }
        if !recent.is_empty() {
            ui.add_space(16.0);
            ui.label(egui::RichText::new("Recent").small().color(tokens.weak));
        }
        for recent in recent {
            if recent_button(ui, recent).clicked() {
                invited = Some(Invited::Open(recent.clone()));
            }
        }
    });
    invited
}

/// What the user chose in the dialog.
pub(super) enum Picked {
    Path(PathBuf),
    /// A recent recording.
    Recent(Request),
}

/// What the user chose in an empty window.
pub(super) enum Invited {
    Ask,
    Open(Request),
}

/// Shown while a source is being opened and none is open.
pub(super) fn waiting(ui: &mut egui::Ui, title: &str) {
    widgets::empty(
        ui,
        icons::ICON_HOURGLASS_TOP,
        &format!("Opening {title}"),
        "Long recordings without an index are read once.",
    );
}

#[cfg(test)]
mod tests {
    use super::*;
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;
    use std::cell::RefCell;

    #[test]
    fn a_press_in_the_dialog_opens_no_other_recording_that_takes_the_place_of_the_pressed_one() {
        let of = |names: [&str; 2]| {
            let recording =
                |name: &str| Request { log: Some(format!("/logs/{name}").into()), ..Request::default() };
            names.map(recording).to_vec()
        };
        let pressed = Some("b.mcap");
        let cases =
            [(["a.mcap", "b.mcap"], pressed), (["b.mcap", "a.mcap"], pressed), (["a.mcap", "c.mcap"], None)];
        for (then, expected) in cases {
            let opener = RefCell::new(Opener::new(&egui::Context::default(), None));
            opener.borrow_mut().recent.recordings = of(["a.mcap", "b.mcap"]);
            opener.borrow_mut().ask();
            let picked = RefCell::new(Vec::new());
            let mut harness = Harness::builder()
                .with_size(egui::Vec2::new(800.0, 400.0))
                .with_context_setup(ocu_ui::install)
                .build_ui(|ui| picked.borrow_mut().extend(opener.borrow_mut().ui(ui)));
            harness.run_steps(3);
            let at = harness.get_by_label("b.mcap").rect().center();
            harness.drag_at(at);
            harness.step();
            opener.borrow_mut().recent.recordings = of(then);
            harness.step();
            harness.drop_at(at);
            harness.step();
            drop(harness);
            let title = picked.into_inner().into_iter().find_map(|picked| match picked {
                Picked::Recent(request) => Some(request.title()),
                Picked::Path(_) => None,
            });
            assert_eq!(title.as_deref(), expected, "{then:?}");
        }
    }

    #[test]
    fn a_long_list_of_offers_says_how_many_more_there_are() {
        let dir = tempfile::tempdir().unwrap();
        for index in 0..MOST_LISTED + 12 {
            std::fs::write(dir.path().join(format!("drive_{index:02}.mcap")), "").unwrap();
        }
        let opener = RefCell::new(Opener::new(&egui::Context::default(), None));
        opener.borrow_mut().ask();
        if let Some(dialog) = &mut opener.borrow_mut().dialog {
            dialog.path = format!("{}/dri", dir.path().display());
        }
        let mut harness = Harness::builder()
            .with_size(egui::Vec2::new(800.0, 600.0))
            .with_context_setup(ocu_ui::install)
            .build_ui(|ui| drop(opener.borrow_mut().ui(ui)));
        let began = Instant::now();
        while harness.query_by_label("and 12 more").is_none() {
            assert!(began.elapsed() < Duration::from_mins(1), "nothing is offered");
            harness.step();
            thread::yield_now();
        }
        assert_eq!(harness.query_all_by_label_contains("drive_").count(), MOST_LISTED);
        let common = opener.borrow().dialog.as_ref().and_then(|dialog| dialog.completion.common());
        assert_eq!(common, Some(format!("{}/drive_", dir.path().display())));
    }

    #[test]
    fn a_panic_while_opening_is_a_failure_with_its_words_and_another_source_can_be_opened() {
        let mut opener = Opener::new(&egui::Context::default(), None);
        let request = Request { log: Some("hostile.mcap".into()), ..Request::default() };
        let outcome = |opener: &mut Opener| {
            let began = Instant::now();
            loop {
                match opener.poll() {
                    Some(Outcome::Failed(text)) => return text,
                    Some(Outcome::Opened(..)) => panic!("it opened"),
                    None => assert!(began.elapsed() < Duration::from_mins(1), "no answer"),
                }
                thread::yield_now();
            }
        };
        opener.open_by(request.clone(), |request| panic!("a bad byte in {}", request.title()));
        assert_eq!(opener.opening().as_deref(), Some("hostile.mcap"));
        assert_eq!(
            outcome(&mut opener),
            "it cannot be opened: its reader failed: a bad byte in hostile.mcap"
        );
        assert_eq!(opener.opening(), None);
        opener.open_by(request, |_| Err(anyhow::anyhow!("another reason")));
        assert_eq!(outcome(&mut opener), "another reason");
    }

    #[test]
    fn recent_recordings_are_kept_newest_first_and_once() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("recent.txt");
        let mut recent = Recent::load(Some(file.clone()));
        let recording =
            |index: i32| Request { log: Some(format!("/logs/{index}.mcap").into()), ..Request::default() };
        for index in 0..12 {
            recent.add(&recording(index));
        }
        recent.add(&recording(8));
        let again = Recent::load(Some(file)).recordings;
        assert_eq!(again.len(), MOST_RECENT);
        assert_eq!(again[0], recording(8));
        assert_eq!(again.iter().filter(|known| **known == recording(8)).count(), 1);
    }

    #[test]
    fn a_recent_recording_has_all_files_that_were_named() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("recent.txt");
        let mut recent = Recent::load(Some(file.clone()));
        let named = Request {
            log: Some("/logs/early.mcap".into()),
            parts: vec!["/logs/late.mcap".into(), "/logs/last.mcap".into()],
            ..Request::default()
        };
        recent.add(&Request { seed: Some(3), ..named.clone() });
        assert_eq!(Recent::load(Some(file)).recordings, [named]);
    }
}
