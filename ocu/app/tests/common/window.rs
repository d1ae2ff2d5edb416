//! What the tests of the window share: the complete window without a display, on a recording or on a stack.

use egui::accesskit::Role;
use egui::{Event, Key, Modifiers, ViewportCommand, ViewportEvent, ViewportId};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use ocu_app::layout::Layout;
use ocu_app::open::Request;
use ocu_app::window::{Options, Window};
use rcs_runtime::source::Frame;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Timeout, longer than any step of these tests takes.
pub(crate) const PATIENCE: Duration = Duration::from_mins(1);

/// A stack that expects commands of an operator and needs no other input.
pub(crate) const STACK: &str = r#"
format = 1
name = "hand"
description = "A vehicle interface that waits for an operator."

[[process]]
name = "vehicle_interface"
plugin = "vehicle_interface"
supervisor = "viewer"
inputs = { teleop = "/operator/teleop", emergency_stop = "/operator/emergency_stop" }
"#;

/// The window; it is made in the first pass.
pub(crate) type State = Option<Window>;

/// The window that starts to open what the options say.
pub(crate) fn harness<'a>(options: Options) -> Harness<'a, State> {
    let mut options = Some(options);
    Harness::builder().with_size([1280.0, 800.0]).build_ui_state(
        move |ui, state: &mut State| {
            if let Some(window) = state {
                window.logic(ui.ctx());
                window.ui(ui);
            } else {
                // Fonts are available from the next pass on.
                ocu_ui::install(ui.ctx());
                *state = Some(Window::new(ui.ctx(), options.take().unwrap_or_default()));
                ui.ctx().request_repaint();
            }
        },
        None,
    )
}

/// The window with an open source.
pub(crate) fn open<'a>(options: Options) -> Harness<'a, State> {
    let mut harness = harness(options);
    wait_until(&mut harness, "a frame", |_| true);
    harness
}

/// A recording of about three seconds, written to a folder.
pub(crate) fn sample(dir: &Path) -> Request {
    let path = dir.join("drive.mcap");
    ocu_app::sample::write(&path, 3.0, true).unwrap();
    Request { log: Some(path), ..Request::default() }
}

/// The window on a recording, in a layout.
pub(crate) fn recording<'a>(dir: &Path, layout: Layout) -> Harness<'a, State> {
    open(Options { request: sample(dir), layout: Some(layout), ..Options::default() })
}

/// The request for [`STACK`], written to a folder.
pub(crate) fn stack(dir: &Path) -> Request {
    let stack = dir.join("hand.toml");
    std::fs::write(&stack, STACK).unwrap();
    Request { stack: Some(stack.display().to_string()), ..Request::default() }
}

/// The window on [`STACK`], which runs.
pub(crate) fn running<'a>(dir: &Path) -> Harness<'a, State> {
    let mut harness = open(Options { request: stack(dir), ..Options::default() });
    wait_until(&mut harness, "time to run", |frame| frame.playback.playing && frame.time_s() > 0.2);
    harness
}

pub(crate) fn frame(harness: &Harness<'_, State>) -> Option<Arc<Frame>> {
    harness.state().as_ref()?.frame()
}

/// Runs passes until the frame satisfies a condition, because the source's thread has its own clock. The last pass may
/// have seen an older frame than the one that satisfies it; so one more pass sees that frame, or a newer one.
#[track_caller]
pub(crate) fn wait_until(harness: &mut Harness<'_, State>, what: &str, is: impl Fn(&Frame) -> bool) {
    wait_for(harness, what, |harness| frame(harness).is_some_and(|frame| is(&frame)));
    harness.step();
}

/// Runs passes until the window satisfies a condition.
#[track_caller]
pub(crate) fn wait_for(
    harness: &mut Harness<'_, State>,
    what: &str,
    mut is: impl FnMut(&Harness<'_, State>) -> bool,
) {
    let start = Instant::now();
    loop {
        harness.step();
        if is(harness) {
            return;
        }
        assert!(start.elapsed() < PATIENCE, "waited in vain for {what}");
        std::thread::yield_now();
    }
}

#[derive(Debug)]
struct Dropped(std::path::PathBuf);

impl egui::DroppedFile for Dropped {
    fn path(&self) -> &Path {
        &self.0
    }

    fn bytes(&self) -> Result<Vec<u8>, String> {
        std::fs::read(&self.0).map_err(|error| error.to_string())
    }
}

/// Drops a file on the window.
pub(crate) fn drop_file(harness: &mut Harness<'_, State>, path: &Path) {
    harness.input_mut().dropped_files.push(Arc::new(Dropped(path.to_owned())));
}

/// Does what the desktop does when the user closes the window; returns whether it closes.
pub(crate) fn closes(harness: &mut Harness<'_, State>) -> bool {
    let window = harness.input_mut().viewports.get_mut(&ViewportId::ROOT).unwrap();
    window.events.push(ViewportEvent::Close);
    harness.step();
    !has_told(harness, &ViewportCommand::CancelClose)
}

/// Whether the window has told the desktop this in the last pass.
pub(crate) fn has_told(harness: &Harness<'_, State>, command: &ViewportCommand) -> bool {
    harness.output().viewport_output[&ViewportId::ROOT].commands.contains(command)
}

/// Number of writes into all runs.
pub(crate) fn writes(frame: &Frame) -> usize {
    frame.runs.all.iter().map(|run| run.writes).sum()
}

/// Replaces the text of the field with this label.
pub(crate) fn type_text(harness: &mut Harness<'_, State>, label: &str, text: &str) {
    harness.get_by_label(label).focus();
    harness.run_steps(2);
    harness.key_press_modifiers(Modifiers::COMMAND, Key::A);
    harness.run_steps(2);
    harness.get_by_label(label).type_text(text);
    harness.run_steps(2);
}

/// Types the number of a parameter.
pub(crate) fn type_number(harness: &mut Harness<'_, State>, name: &str, text: &str) {
    harness.get_by_role_and_label(Role::SpinButton, name).click();
    harness.run_steps(2);
    harness.key_press_modifiers(Modifiers::COMMAND, Key::A);
    harness.event(Event::Text(text.to_owned()));
    harness.run_steps(2);
    harness.key_press(Key::Enter);
    harness.run_steps(2);
}
