//! Recording of the run that is shown: start and stop in the bar at the top, and what is told about it.

use super::notices::{Matter, Notices};
use super::top_state::{Actions, State, TopBarAction};
use crate::time::file_name_of;
use egui::{Role, Sense, Vec2, WidgetInfo};
use ocu_ui::bar::{self, Form};
use ocu_ui::{format, icons, tokens, typing, widgets};
use rcs_msg::Stamp;
use rcs_runtime::source::{Control, Frame, RecordingEnd, RecordingState};
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

/// The recording that is being written.
pub(super) fn running(frame: &Frame) -> Option<&RecordingState> {
    frame.recording.as_ref().filter(|recording| recording.ended.is_none())
}

/// Name of the next recording, in the folder in which the program was started: the source, date and time.
pub(super) fn default_path(frame: &Frame) -> PathBuf {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_nanos() as u64);
    let is_plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_');
    let title: String = frame.info.title.chars().map(|c| if is_plain(c) { c } else { '-' }).collect();
    format!("{}-{}.mcap", title.trim_matches('-'), file_name_of(Stamp(now))).into()
}

/// The request that begins a recording.
pub(super) fn start(path: PathBuf) -> Control {
    Control::Record { path, build: crate::BUILD.to_owned() }
}

/// The item of the bar: a menu that begins a recording, or the one that runs with its time and size.
pub(super) fn ui(ui: &mut egui::Ui, form: Form, state: &State<'_>, frame: &Frame, actions: &mut Actions) {
    if let Some(recording) = running(frame) {
        if running_ui(ui, form, recording).clicked() {
            actions.push(TopBarAction::StopRecording);
        }
        return;
    }
    let button = bar::menu(ui, form, icons::ICON_FIBER_MANUAL_RECORD, "Record", |ui| {
        ui.set_min_width(360.0);
        let id = ui.scope_id().with("record to");
        let kept: Option<String> = ui.data(|data| data.get_temp(id));
        let is_fresh = kept.is_none();
        let mut path = kept.unwrap_or_else(|| default_path(frame).display().to_string());
        let mut begin = false;
        ui.horizontal(|ui| {
            let label = ui.label("File");
            let edit = egui::TextEdit::singleline(&mut path).desired_width(248.0);
            let edit = ui.add(edit).labelled_by(label.id);
            if is_fresh {
                edit.request_focus();
            }
            begin = typing::entered(&edit);
            let ready = !path.trim().is_empty();
            begin |= ui.add_enabled(ready, egui::Button::new("Start")).clicked();
            begin &= ready;
        });
        let (text, color) = if Path::new(path.trim()).is_file() {
            ("There is a file of this name, which is not overwritten: type another name.", tokens(ui).warning)
        } else {
            ("From now on, with what holds at this moment. No file is overwritten.", tokens(ui).weak)
        };
        ui.label(egui::RichText::new(text).small().color(color));
        if begin {
            actions.push(TopBarAction::Record(PathBuf::from(path.trim())));
            ui.data_mut(|data| data.remove::<String>(id));
            ui.close();
        } else {
            ui.data_mut(|data| data.insert_temp(id, path));
        }
    });
    let key = state.keymap.text(super::commands::Command::Record);
    button.on_hover_text(format!("Record this run to a file ({key} begins at once)"));
}

/// A red dot with the time and the size of the recording; a click ends it.
fn running_ui(ui: &mut egui::Ui, form: Form, recording: &RecordingState) -> egui::Response {
    let tokens = tokens(ui);
    let took = format::elapsed(recording.to.seconds_since(recording.from));
    // Without the milliseconds.
    let took = took.split('.').next().unwrap_or_default().to_owned();
    let size = format::bytes(recording.bytes);
    let text = if form == Form::Short { took.clone() } else { format!("{took}  {size:>7}") };
    let galley = ui.painter().layout_no_wrap(text, egui::FontId::monospace(12.0), tokens.strong);
    let (rect, response) = ui.allocate_exact_size(Vec2::new(galley.size().x + 30.0, 20.0), Sense::click());
    response.widget_info(|| WidgetInfo::labeled(Role::Button, true, "End the recording"));
    let fill = if response.hovered() { tokens.surface[2] } else { tokens.surface[0] };
    let edge = egui::Stroke::new(1.0, tokens.error);
    ui.painter().rect(rect, 3.0, fill, edge, egui::StrokeKind::Inside);
    let icon = if response.hovered() { icons::ICON_STOP } else { icons::ICON_FIBER_MANUAL_RECORD };
    widgets::icon_at(ui.painter(), rect.left_center() + Vec2::new(12.0, 1.0), icon, 14.0, tokens.error);
    let at = rect.left_center() + Vec2::new(23.0, -galley.size().y / 2.0);
    ui.painter().galley(at, galley, tokens.strong);
    let lost = match recording.dropped {
        0 => String::new(),
        count => format!("\n{count} messages are missing"),
    };
    response.on_hover_text(format!("End the recording to {}{lost}", recording.path.display()))
}

/// Says how a recording ended.
#[derive(Debug, Default)]
pub(super) struct Told {
    /// The recording that was seen last: its beginning, and whether it had ended.
    known: Option<(PathBuf, Stamp, bool)>,
}

impl Told {
    pub(super) fn tell(&mut self, frame: &Frame, notices: &mut Notices) {
        let Some(recording) = &frame.recording else {
            self.known = None;
            return;
        };
        let now = (recording.path.clone(), recording.from, recording.ended.is_some());
        if self.known.as_ref() == Some(&now) {
            return;
        }
        self.known = Some(now);
        let path = recording.path.display();
        let Some(why) = &recording.ended else {
            notices.mended(Matter::Recording);
            return;
        };
        let took = format::elapsed(recording.to.seconds_since(recording.from));
        let what = format!("{took}, {}", format::bytes(recording.bytes));
        match why {
            RecordingEnd::Stopped => notices.news(Matter::Recording, format!("Recorded {what}: {path}")),
            RecordingEnd::OtherRun => {
                let text = format!("The recording ended, because another run is shown now: {what}: {path}");
                notices.news(Matter::Recording, text);
            }
            RecordingEnd::Failed(error) => {
                let text = format!("the recording ended after {what}: {error}: {path}");
                notices.error(Matter::Recording, text);
            }
        }
        if recording.dropped > 0 {
            let text = format!("{} messages are missing in the recording: {path}", recording.dropped);
            notices.error(Matter::Recording, text);
        }
    }
}
