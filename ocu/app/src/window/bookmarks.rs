//! Bookmarks: moments with a text, in a file beside the recording (`drive.mcap.marks.json`); of a simulation they are
//! forgotten when it is left.

use super::scale::Scale;
use crate::layout::write_whole;
use crate::say;
use egui::{Rect, Role, Stroke, Ui, WidgetInfo};
use ocu_ui::bar::{self, Form};
use ocu_ui::{format, icons, tokens, widgets};
use rcs_msg::Stamp;
use rcs_runtime::source::{Control, Frame};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// One bookmark, as it is stored.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Mark {
    /// Log time in nanoseconds.
    time_ns: u64,
    /// What the user wrote.
    #[serde(default)]
    text: String,
}

/// The bookmarks of a source, in ascending order of time.
#[derive(Debug, Default)]
pub(super) struct Bookmarks {
    file: Option<PathBuf>,
    marks: Vec<Mark>,
    /// Why they could not be read or written, until it is taken.
    failed: Option<String>,
}

impl Bookmarks {
    /// Those of a recording; empty ones without a recording.
    pub(super) fn of(log: Option<&Path>) -> Self {
        let Some(log) = log else { return Self::default() };
        let mut name = log.as_os_str().to_owned();
        name.push(".marks.json");
        let file = PathBuf::from(name);
        let read = match std::fs::read_to_string(&file) {
            Ok(text) => serde_json::from_str::<Vec<Mark>>(&text).map_err(|error| error.to_string()),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(Vec::new()),
            Err(error) => Err(error.to_string()),
        };
        match read {
            Ok(mut marks) => {
                marks.sort_by_key(|mark| mark.time_ns);
                Self { file: Some(file), marks, failed: None }
            }
            // A file that cannot be read is not written over.
            Err(error) => {
                let failed = format!("the bookmarks cannot be read: {error}: {}", file.display());
                Self { file: None, marks: Vec::new(), failed: Some(failed) }
            }
        }
    }

    /// Why they could not be read or written; said once.
    pub(super) fn take_failure(&mut self) -> Option<String> {
        self.failed.take()
    }

    /// Sets a bookmark at a time, or removes the one that is there.
    pub(super) fn toggle(&mut self, time: Stamp) {
        match self.marks.binary_search_by_key(&time.0, |mark| mark.time_ns) {
            Ok(index) => drop(self.marks.remove(index)),
            Err(index) => self.marks.insert(index, Mark { time_ns: time.0, text: String::new() }),
        }
        self.save();
    }

    fn save(&mut self) {
        let Some(file) = &self.file else { return };
        let text = serde_json::to_string_pretty(&self.marks).unwrap_or_default() + "\n";
        if let Err(error) = write_whole(file, &text) {
            self.failed = Some(format!("the bookmarks cannot be kept: {}", say(&error)));
        }
    }

    /// The list of bookmarks, as a menu of the bar of time.
    pub(super) fn menu(&mut self, ui: &mut Ui, form: Form, frame: &Frame, controls: &mut Vec<Control>) {
        let text = if form == Form::Listed { "Bookmarks".to_owned() } else { self.marks.len().to_string() };
        let form = if self.marks.is_empty() && form == Form::Full { Form::Short } else { form };
        let response = bar::menu_of(ui, form, icons::ICON_BOOKMARK, &text, "Bookmarks", |ui| {
            ui.set_min_width(280.0);
            if ui.button("Set or remove one here (M)").clicked() {
                self.toggle(frame.now);
            }
            ui.separator();
            if self.marks.is_empty() {
                let text = "None. They are kept beside the recording.";
                ui.label(egui::RichText::new(text).small().color(tokens(ui).weak));
            }
            let (mut changed, mut removed) = (false, None);
            for (index, mark) in self.marks.iter_mut().enumerate() {
                let at = format::elapsed(Stamp(mark.time_ns).seconds_since(frame.info.start));
                ui.horizontal(|ui| {
                    if ui.button(widgets::mono(&at)).on_hover_text("Go there").clicked() {
                        controls.push(Control::Seek(Stamp(mark.time_ns)));
                    }
                    let edit =
                        egui::TextEdit::singleline(&mut mark.text).hint_text("a note").desired_width(160.0);
                    let edit = ui.add(edit);
                    edit.widget_info(|| WidgetInfo::labeled(Role::TextInput, true, format!("Note at {at}")));
                    changed |= edit.lost_focus();
                    let name = format!("Remove the bookmark at {at}");
                    if widgets::icon_button(ui, icons::ICON_CLOSE, &name).clicked() {
                        removed = Some(index);
                    }
                });
            }
            if let Some(index) = removed {
                self.marks.remove(index);
            }
            if changed || removed.is_some() {
                self.save();
            }
        });
        response.on_hover_text("Bookmarks");
    }

    /// Paints the bookmarks as flags at the lower edge of the timeline.
    pub(super) fn paint(&self, ui: &Ui, rect: Rect, scale: &Scale) {
        let color = tokens(ui).series[4];
        let painter = ui.painter_at(rect);
        let [from, to] = scale.range();
        for mark in self.marks.iter().filter(|mark| (from.0..=to.0).contains(&mark.time_ns)) {
            let x = scale.x(Stamp(mark.time_ns));
            painter.vline(x, rect.bottom() - 12.0..=rect.bottom(), Stroke::new(1.5, color));
            let flag = [(0.0, -12.0), (7.0, -9.5), (0.0, -7.0)];
            let flag = flag.map(|(dx, dy)| egui::pos2(x + dx, rect.bottom() + dy));
            painter.add(egui::Shape::convex_polygon(flag.to_vec(), color, Stroke::NONE));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bookmarks_are_kept_beside_the_recording_and_a_damaged_file_is_not_written_over() {
        let dir = tempfile::tempdir().unwrap();
        let log = dir.path().join("drive.mcap");
        let mut marks = Bookmarks::of(Some(&log));
        for time in [30, 10, 20, 10] {
            marks.toggle(Stamp(time));
        }
        let again = Bookmarks::of(Some(&log));
        assert_eq!(again.marks.iter().map(|mark| mark.time_ns).collect::<Vec<_>>(), [20, 30]);
        let file = dir.path().join("drive.mcap.marks.json");
        std::fs::write(&file, "nonsense").unwrap();
        let mut damaged = Bookmarks::of(Some(&log));
        damaged.toggle(Stamp(5));
        assert!(damaged.take_failure().unwrap().contains("drive.mcap.marks.json"));
        assert_eq!(std::fs::read_to_string(&file).unwrap(), "nonsense");
    }
}
