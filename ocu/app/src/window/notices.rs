//! Messages over the lower right corner of the views: nothing moves when one comes or goes. An error stays until it is
//! dismissed or mended; a piece of news leaves by itself.

use egui::{Align2, Area, Id, Rect, Vec2};
use ocu_ui::{Icon, Tokens, icons, tokens, widgets};
use std::time::{Duration, Instant};

/// Maximum number of messages; older ones are dropped.
const MOST: usize = 4;
/// Greatest width of a message, and distance from the corner.
const WIDTH: f32 = 480.0;
const MARGIN: f32 = 12.0;
/// How long a piece of news is shown.
const NEWS: Duration = Duration::from_secs(12);

/// What a message is about: the next success in the same matter removes it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Matter {
    /// Opening a source.
    Open,
    /// Layouts and keys.
    Layout,
    /// The runs of the source.
    Run,
    /// Recording.
    Recording,
    /// What the operator holds.
    Held,
}

#[derive(Debug)]
struct Notice {
    /// Tells it from the others.
    serial: u64,
    matter: Matter,
    text: String,
    /// When it leaves; `None` for an error.
    until: Option<Instant>,
}

/// The current messages.
#[derive(Debug, Default)]
pub(super) struct Notices {
    shown: Vec<Notice>,
    /// The serial number of the newest message.
    last_serial: u64,
    /// The source's error that was dismissed; it is shown again when it changes.
    dismissed: Option<String>,
}

impl Notices {
    /// Adds an error, unless the same one is already shown.
    pub(super) fn error(&mut self, matter: Matter, text: impl Into<String>) {
        self.add(matter, text.into(), None);
    }

    /// Adds a piece of news, in place of the last one in the same matter.
    pub(super) fn news(&mut self, matter: Matter, text: impl Into<String>) {
        self.shown.retain(|known| known.matter != matter || known.until.is_none());
        self.add(matter, text.into(), Some(Instant::now() + NEWS));
    }

    fn add(&mut self, matter: Matter, text: String, until: Option<Instant>) {
        // One that is said again can still be dismissed by a press from before.
        let known = self.shown.iter().position(|known| known.text == text);
        let serial = known.map_or(self.last_serial + 1, |known| self.shown.remove(known).serial);
        self.last_serial = self.last_serial.max(serial);
        self.shown.push(Notice { serial, matter, text, until });
        let surplus = self.shown.len().saturating_sub(MOST);
        self.shown.drain(..surplus);
    }

    /// Removes what is said in a matter, because it has been mended.
    pub(super) fn mended(&mut self, matter: Matter) {
        self.shown.retain(|known| known.matter != matter);
    }

    /// Paints the messages, and the source's own error, over the lower right corner of a region.
    pub(super) fn ui(&mut self, ui: &egui::Ui, region: Rect, source_error: Option<&str>) {
        if self.is_empty(source_error) {
            return;
        }
        let width = WIDTH.min(region.width() - 2.0 * MARGIN);
        let area = Area::new(Id::unique("notices"))
            .pivot(Align2::RIGHT_BOTTOM)
            .fixed_pos(region.right_bottom() - Vec2::splat(MARGIN))
            .constrain_to(region);
        area.show(ui.ctx(), |ui| {
            let tokens = tokens(ui);
            let frame = egui::Frame::new()
                .fill(tokens.surface[3])
                .stroke(egui::Stroke::new(1.0, tokens.line))
                .corner_radius(3.0)
                .inner_margin(egui::Margin::symmetric(8, 6));
            frame.show(ui, |ui| {
                ui.set_width((width - 16.0).max(64.0));
                self.lines(ui, source_error);
            });
        });
    }

    fn lines(&mut self, ui: &mut egui::Ui, source_error: Option<&str>) {
        let now = Instant::now();
        if let Some(next) = self.shown.iter().filter_map(|notice| notice.until).min() {
            ui.ctx().request_repaint_after(next.saturating_duration_since(now));
        }
        let mut closed = None;
        for (index, notice) in self.shown.iter().enumerate() {
            let line = |ui: &mut egui::Ui| line(ui, &notice.text, notice.until.is_none());
            if widgets::named(ui, notice.serial, line) {
                closed = Some(index);
            }
        }
        if let Some(index) = closed {
            self.shown.remove(index);
        }
        match source_error {
            None => self.dismissed = None,
            Some(text) if self.dismissed.as_deref() == Some(text) => {}
            Some(text) => {
                if widgets::named(ui, ("source", text), |ui| line(ui, text, true)) {
                    self.dismissed = Some(text.to_owned());
                }
            }
        }
    }

    /// Whether there is anything to show. Old news leave here.
    fn is_empty(&mut self, source_error: Option<&str>) -> bool {
        let now = Instant::now();
        self.shown.retain(|notice| notice.until.is_none_or(|until| until > now));
        self.shown.is_empty() && (source_error.is_none() || self.dismissed.as_deref() == source_error)
    }
}

/// One line; returns whether it was dismissed.
fn line(ui: &mut egui::Ui, text: &str, is_error: bool) -> bool {
    let tokens: &Tokens = tokens(ui);
    let (icon, color): (Icon, _) =
        if is_error { (icons::ICON_ERROR, tokens.error) } else { (icons::ICON_INFO, tokens.accent) };
    ui.horizontal(|ui| {
        ui.label(icon.rich_text().size(16.0).color(color));
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            let closed = widgets::icon_button(ui, icons::ICON_CLOSE, "Dismiss").clicked();
            ui.with_layout(egui::Layout::left_to_right(egui::Align::Center), |ui| {
                ui.add(egui::Label::new(text).wrap());
            });
            closed
        })
        .inner
    })
    .inner
}

#[cfg(test)]
mod tests {
    use super::*;
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;
    use std::cell::RefCell;

    /// What is left of two errors after a press on *Dismiss* of the first one, a change, and the release.
    fn left(change: impl FnOnce(&mut Notices)) -> Vec<String> {
        let notices = RefCell::new(Notices::default());
        notices.borrow_mut().error(Matter::Open, "no such file");
        notices.borrow_mut().error(Matter::Recording, "disk full");
        let mut harness = Harness::builder()
            .with_size(Vec2::new(400.0, 200.0))
            .with_context_setup(ocu_ui::install)
            .build_ui(|ui| notices.borrow_mut().lines(ui, None));
        harness.run();
        let buttons = harness.query_all_by_label("Dismiss").map(|button| button.rect().center());
        let at = buttons.min_by(|a, b| a.y.total_cmp(&b.y)).unwrap();
        harness.drag_at(at);
        harness.step();
        change(&mut notices.borrow_mut());
        harness.step();
        harness.drop_at(at);
        harness.step();
        drop(harness);
        notices.into_inner().shown.into_iter().map(|notice| notice.text).collect()
    }

    #[test]
    fn a_press_dismisses_no_other_message_that_takes_the_place_of_the_pressed_one() {
        assert_eq!(left(|notices| notices.mended(Matter::Open)), ["disk full"]);
        assert_eq!(left(|notices| notices.news(Matter::Run, "saved")), ["disk full", "saved"]);
    }

    #[test]
    fn an_error_stays_until_its_matter_is_mended_and_news_replace_each_other() {
        let mut notices = Notices::default();
        notices.error(Matter::Open, "no such file: a.mcap");
        notices.error(Matter::Open, "no such file: a.mcap");
        notices.news(Matter::Run, "run 1 begins");
        notices.news(Matter::Run, "run 2 begins");
        assert_eq!(notices.shown.len(), 2);
        notices.mended(Matter::Layout);
        assert_eq!(notices.shown.len(), 2);
        notices.mended(Matter::Open);
        assert_eq!(notices.shown[0].text, "run 2 begins");
        notices.shown[0].until = Some(Instant::now());
        assert!(notices.is_empty(None) && !notices.is_empty(Some("the source has ended")));
    }
}
