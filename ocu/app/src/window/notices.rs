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
}

#[derive(Debug)]
struct Notice {
    matter: Matter,
    text: String,
    /// When it leaves; `None` for an error.
    until: Option<Instant>,
}

/// The current messages.
#[derive(Debug, Default)]
pub(super) struct Notices {
    notices: Vec<Notice>,
    /// The source's error that was dismissed; it is shown again when it changes.
    dismissed: Option<String>,
}

impl Notices {
    /// Adds an error, unless the same one is already shown.
    pub(super) fn error(&mut self, matter: Matter, text: impl Into<String>) {
        self.add(Notice { matter, text: text.into(), until: None });
    }

    /// Adds a piece of news, in place of the last one in the same matter.
    pub(super) fn news(&mut self, matter: Matter, text: impl Into<String>) {
        self.notices.retain(|known| known.matter != matter || known.until.is_none());
        self.add(Notice { matter, text: text.into(), until: Some(Instant::now() + NEWS) });
    }

    fn add(&mut self, notice: Notice) {
        self.notices.retain(|known| known.text != notice.text);
        self.notices.push(notice);
        let surplus = self.notices.len().saturating_sub(MOST);
        self.notices.drain(..surplus);
    }

    /// Removes what is said in a matter, because it has been mended.
    pub(super) fn mended(&mut self, matter: Matter) {
        self.notices.retain(|known| known.matter != matter);
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
        if let Some(next) = self.notices.iter().filter_map(|notice| notice.until).min() {
            ui.ctx().request_repaint_after(next.saturating_duration_since(now));
        }
        let mut closed = None;
        for (index, notice) in self.notices.iter().enumerate() {
            if line(ui, &notice.text, notice.until.is_none()) {
                closed = Some(index);
            }
        }
        if let Some(index) = closed {
            self.notices.remove(index);
        }
        match source_error {
            None => self.dismissed = None,
            Some(text) if self.dismissed.as_deref() == Some(text) => {}
            Some(text) => {
                if line(ui, text, true) {
                    self.dismissed = Some(text.to_owned());
                }
            }
        }
    }

    /// Whether there is anything to show. Old news leave here.
    fn is_empty(&mut self, source_error: Option<&str>) -> bool {
        let now = Instant::now();
        self.notices.retain(|notice| notice.until.is_none_or(|until| until > now));
        self.notices.is_empty() && (source_error.is_none() || self.dismissed.as_deref() == source_error)
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

    #[test]
    fn an_error_stays_until_its_matter_is_mended_and_news_replace_each_other() {
        let mut notices = Notices::default();
        notices.error(Matter::Open, "no such file: a.mcap");
        notices.error(Matter::Open, "no such file: a.mcap");
        notices.news(Matter::Run, "run 1 begins");
        notices.news(Matter::Run, "run 2 begins");
        assert_eq!(notices.notices.len(), 2);
        notices.mended(Matter::Layout);
        assert_eq!(notices.notices.len(), 2);
        notices.mended(Matter::Open);
        assert_eq!(notices.notices[0].text, "run 2 begins");
        notices.notices[0].until = Some(Instant::now());
        assert!(notices.is_empty(None) && !notices.is_empty(Some("the source has ended")));
    }
}
