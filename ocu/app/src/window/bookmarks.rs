//! Bookmarks: moments and ranges of time with a text, in a file beside the recording (`drive.mcap.marks.json`); of a
//! simulation they are forgotten when it is left.

use super::scale::Scale;
use crate::layout::write_whole;
use crate::say;
use egui::{Rect, Role, Stroke, Ui, WidgetInfo};
use ocu_ui::bar::{self, Form};
use ocu_ui::{format, icons, tokens, typing, widgets};
use rcs_msg::Stamp;
use rcs_runtime::source::{Control, Frame};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// One bookmark, as it is stored.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Mark {
    /// Log time in nanoseconds.
    time_ns: u64,
    /// End of a range, ns; a moment has none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    end_ns: Option<u64>,
    /// What the user wrote.
    #[serde(default)]
    text: String,
}

/// The bookmarks of a source, in ascending order of time.
#[derive(Debug, Default)]
pub(super) struct Bookmarks {
    /// Where they are kept; `None` without a recording, or where their file cannot be read.
    file: Option<PathBuf>,
    /// Whether their file cannot be read.
    is_unreadable: bool,
    marks: Vec<Mark>,
    /// The range that the timeline shows, which can be kept; and the kept one that it is to show.
    shown: Option<[Stamp; 2]>,
    wanted: Option<[Stamp; 2]>,
    /// Why they could not be read or written, until it is taken.
    failed: Option<String>,
}

impl Bookmarks {
    /// Those of a recording; empty ones without a recording.
    pub(super) fn of(log: Option<&Path>) -> Self {
        let Some(log) = log else { return Self::default() };
        let file = file_of(log);
        let read = match std::fs::read_to_string(&file) {
            Ok(text) => serde_json::from_str::<Vec<Mark>>(&text).map_err(|error| error.to_string()),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(Vec::new()),
            Err(error) => Err(error.to_string()),
        };
        match read {
            Ok(mut marks) => {
                marks.sort_by_key(|mark| mark.time_ns);
                Self { file: Some(file), marks, ..Self::default() }
            }
            // A file that cannot be read is not written over.
            Err(error) => {
                let failed = format!("the bookmarks cannot be read: {error}: {}", file.display());
                Self { is_unreadable: true, failed: Some(failed), ..Self::default() }
            }
        }
    }

    /// Why they could not be read or written; said once.
    pub(super) fn take_failure(&mut self) -> Option<String> {
        self.failed.take()
    }

    /// Sets a bookmark at a time, or removes the one that is there.
    pub(super) fn toggle(&mut self, time: Stamp) {
        let is_here = |mark: &Mark| mark.time_ns == time.0 && mark.end_ns.is_none();
        match self.marks.iter().position(is_here) {
            Some(index) => drop(self.marks.remove(index)),
            None => self.add(Mark { time_ns: time.0, end_ns: None, text: String::new() }),
        }
        self.save();
    }

    /// Keeps a range of time, unless it is kept already.
    fn keep_range(&mut self, [from, to]: [Stamp; 2]) {
        let range = Mark { time_ns: from.0, end_ns: Some(to.0), text: String::new() };
        if !self.marks.iter().any(|mark| (mark.time_ns, mark.end_ns) == (range.time_ns, range.end_ns)) {
            self.add(range);
            self.save();
        }
    }

    fn add(&mut self, mark: Mark) {
        let index = self.marks.partition_point(|other| other.time_ns <= mark.time_ns);
        self.marks.insert(index, mark);
    }

    /// Says which range the timeline shows, `None` for all of it; returns the one that it is to show.
    pub(super) fn turn(&mut self, shown: Option<[Stamp; 2]>) -> Option<[Stamp; 2]> {
        self.shown = shown;
        self.wanted.take()
    }

    fn save(&mut self) {
        let Some(file) = &self.file else { return };
        let text = serde_json::to_string_pretty(&self.marks).unwrap_or_default() + "\n";
        if let Err(error) = write_whole(file, &text) {
            self.failed = Some(format!("the bookmarks cannot be kept: {}", say(&error)));
        }
    }

    /// The text of the list without bookmarks: whether they would be kept.
    fn empty_text(&self) -> &'static str {
        if self.file.is_some() {
            "None. They are kept beside the recording."
        } else if self.is_unreadable {
            "None. They are forgotten when this recording is left: their file cannot be read."
        } else {
            "None. They are forgotten when this run is left: it is no recording."
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
            let keep = egui::Button::new("Keep the range that is shown");
            let keep = ui.add_enabled(self.shown.is_some(), keep);
            let keep = keep.on_disabled_hover_text("Zoom the timeline first: turn the wheel over it.");
            if let (true, Some(range)) = (keep.clicked(), self.shown) {
                self.keep_range(range);
            }
            ui.separator();
            if self.marks.is_empty() {
                ui.label(egui::RichText::new(self.empty_text()).small().color(tokens(ui).weak));
            }
            let (mut changed, mut removed) = (false, None);
            for (index, mark) in self.marks.iter_mut().enumerate() {
                let elapsed = |ns: u64| format::elapsed(Stamp(ns).seconds_since(frame.info.start));
                let at = match mark.end_ns {
                    None => elapsed(mark.time_ns),
                    Some(end_ns) => format!("{} – {}", elapsed(mark.time_ns), elapsed(end_ns)),
                };
                ui.horizontal(|ui| {
                    if ui.button(widgets::mono(&at)).on_hover_text("Go there").clicked() {
                        controls.extend(Control::pause_at(Stamp(mark.time_ns)));
                        self.wanted = mark.end_ns.map(|end_ns| [Stamp(mark.time_ns), Stamp(end_ns)]);
                    }
                    let edit =
                        egui::TextEdit::singleline(&mut mark.text).hint_text("a note").desired_width(160.0);
                    let edit = ui.add(edit);
                    typing::note(&edit);
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
        for mark in &self.marks {
            let Some(end_ns) = mark.end_ns.filter(|end_ns| *end_ns >= from.0 && mark.time_ns <= to.0) else {
                continue;
            };
            let ends = [mark.time_ns.max(from.0), end_ns.min(to.0)].map(|ns| scale.x(Stamp(ns)));
            let band = Rect::from_x_y_ranges(ends[0]..=ends[1], rect.bottom() - 5.0..=rect.bottom() - 2.0);
            painter.rect_filled(band, 0.0, color.gamma_multiply(0.7));
            let font = egui::FontId::proportional(10.0);
            let note = painter.layout_no_wrap(mark.text.clone(), font, color);
            if note.size().x <= band.width() {
                painter.galley(band.left_top() - egui::vec2(-2.0, note.size().y), note, color);
            }
        }
        let moments = self.marks.iter().filter(|mark| mark.end_ns.is_none());
        for mark in moments.filter(|mark| (from.0..=to.0).contains(&mark.time_ns)) {
            let x = scale.x(Stamp(mark.time_ns));
            painter.vline(x, rect.bottom() - 12.0..=rect.bottom(), Stroke::new(1.5, color));
            let flag = [(0.0, -12.0), (7.0, -9.5), (0.0, -7.0)];
            let flag = flag.map(|(dx, dy)| egui::pos2(x + dx, rect.bottom() + dy));
            painter.add(egui::Shape::convex_polygon(flag.to_vec(), color, Stroke::NONE));
        }
    }
}

/// The file beside a recording: of a file or folder, with or without a slash at its end.
fn file_of(log: &Path) -> PathBuf {
    let log = std::path::absolute(log).unwrap_or_else(|_| log.to_owned());
    let mut name = log.file_name().unwrap_or_default().to_owned();
    name.push(".marks.json");
    log.with_file_name(name)
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
        marks.keep_range([Stamp(20), Stamp(25)]);
        marks.keep_range([Stamp(20), Stamp(25)]);
        marks.toggle(Stamp(20));
        let again = Bookmarks::of(Some(&log)).marks;
        let ends: Vec<_> = again.iter().map(|mark| (mark.time_ns, mark.end_ns)).collect();
        assert_eq!(ends, [(20, Some(25)), (30, None)], "a range at the same time stays");
        let file = dir.path().join("drive.mcap.marks.json");
        std::fs::write(&file, "nonsense").unwrap();
        let mut damaged = Bookmarks::of(Some(&log));
        damaged.toggle(Stamp(5));
        assert!(damaged.take_failure().unwrap().contains("drive.mcap.marks.json"));
        assert_eq!(std::fs::read_to_string(&file).unwrap(), "nonsense");
    }

    #[test]
    fn the_empty_list_says_whether_bookmarks_are_kept() {
        let dir = tempfile::tempdir().unwrap();
        let log = dir.path().join("drive.mcap");
        assert!(Bookmarks::of(None).empty_text().contains("when this run is left: it is no recording"));
        assert!(Bookmarks::of(Some(&log)).empty_text().contains("kept beside the recording"));
        std::fs::write(dir.path().join("drive.mcap.marks.json"), "nonsense").unwrap();
        assert!(Bookmarks::of(Some(&log)).empty_text().contains("their file cannot be read"));
    }

    #[test]
    fn the_bookmarks_of_a_folder_are_beside_it_with_and_without_a_slash_at_its_end() {
        let dir = tempfile::tempdir().unwrap();
        Bookmarks::of(Some(&dir.path().join("drive/"))).toggle(Stamp(10));
        assert_eq!(Bookmarks::of(Some(&dir.path().join("drive"))).marks.len(), 1);
        assert!(dir.path().join("drive.marks.json").is_file());
    }
}
