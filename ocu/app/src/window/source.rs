//! The source that the window shows: how another one takes its place, and how a recording that grows is followed.

use super::body::{Shown, Window};
use super::bookmarks::Bookmarks;
use super::follow::Follow;
use super::known_alarms::KnownAlarms;
use super::leaving::Leaving;
use super::memory;
use super::notices::Matter;
use super::save_params::SavedStack;
use super::tree::Workspace;
use crate::open::Request;
use ocu_views::{Drafts, Selection};
use rcs_runtime::source::{Control, Driver, Source, SourceKind};
use std::time::Duration;

/// Time of a run at which a robot that stands before its course is shown, ns.
const STANDS_NS: u64 = 600_000_000;

impl Window {
    /// Shows an open source in place of the previous one.
    pub(super) fn show_source(&mut self, request: Request, source: Box<dyn Source>) {
        let Some(driver) = self.drive(&request, source) else { return };
        self.follow = Follow::of(&request, &driver.frame(), &self.ctx);
        let (is_same, repeats) = (request == self.current, request.repeats(&self.current));
        if let Some(workspace) = self.workspace.as_mut().filter(|_| !is_same) {
            // What the views have found and keep is of the source before.
            *workspace = Workspace::new(&workspace.layout(self.buffers_open));
        }
        if (&request.log, &request.stack) != (&self.current.log, &self.current.stack) {
            self.clear_search();
        }
        self.arrange_for(&driver.frame());
        if request.waits() {
            // By then its cameras have seen the course, and it has hardly moved.
            driver.send(Control::Seek(driver.frame().info.start.after_ns(STANDS_NS)));
            let text = "the robot stands before its course: Play (space) sends it to the goal";
            self.notices.news(Matter::Open, text);
        } else if driver.frame().info.kind == SourceKind::Stack {
            // A stack has nothing to show until it runs.
            driver.send(Control::Play);
        }
        if let Some(remembered) = request.remembered.as_deref().filter(|_| request.stack.is_some()) {
            let names = remembered.in_force(&driver.frame()).join(", ");
            let text = format!("this run is given what an earlier run remembers: {names}");
            self.notices.news(Matter::Run, text);
        }
        if let Shown::Live(old) = std::mem::replace(&mut self.shown, Shown::Live(driver)) {
            memory::close(old);
        }
        self.watched.clear();
        self.gathered.clear();
        self.compared.clear();
        self.shows_other = true;
        (self.known_runs, self.known_alarms) = (0, KnownAlarms::default());
        self.leaving = Leaving::default();
        self.marks = Bookmarks::of(request.log.as_deref());
        self.current = request;
        self.dialogs.other.clear();
        self.dialogs.saved = SavedStack::default();
        self.timeline.forget();
        self.operating.forget();
        self.alarm_sound.forget();
        // The speeds of manual driving are kept, and where the same stack begins again, what was not sent.
        let old = std::mem::take(&mut self.selection);
        let drafts = if repeats { old.drafts.after_restart() } else { Drafts::default() };
        self.selection = Selection { drive: old.drive, drafts, ..Selection::default() };
    }

    /// Clears the search in the list of buffers: it was for the buffers of another source.
    fn clear_search(&mut self) {
        let Some(buffers) = &mut self.buffers else { return };
        let mut saved = buffers.save();
        if let Some(fields) = saved.as_object_mut() {
            fields.remove("search");
        }
        if let Err(error) = buffers.load(&saved) {
            tracing::warn!("the search in the list of buffers stays: {error}");
        }
    }

    /// A thread that plays a source.
    fn drive(&mut self, request: &Request, source: Box<dyn Source>) -> Option<Driver> {
        let ctx = self.ctx.clone();
        // A repaint without a delay is done twice; a frame needs one.
        let wake = move || ctx.request_repaint_after(Duration::from_millis(1));
        let driver = Driver::spawn(source, wake).map_err(|error| {
            let text = format!("no thread to play {}: {error}", request.title());
            self.notices.error(Matter::Open, text);
        });
        driver.ok()
    }

    /// Shows more of a recording that is still being written, in place of what was known of it.
    pub(super) fn follow(&mut self) {
        let Some(old) = self.frame() else { return };
        let Some(source) = self.follow.as_ref().and_then(|follow| follow.poll(old.now)) else { return };
        let request = self.current.clone();
        let Some(driver) = self.drive(&request, source) else { return };
        let (playback, new) = (&old.playback, driver.frame());
        driver.send(Control::Speed(playback.speed));
        driver.send(Control::Loop(playback.looping));
        driver.send(Control::Watch(self.watched.clone()));
        driver.send(Control::Gather(self.gathered.clone()));
        driver.send(Control::Against(self.dialogs.other.clone()));
        driver.send(Control::Compare(self.compared.clone()));
        driver.send(Control::ShowOther(self.shows_other));
        match new.info.end {
            // Whoever looks at the end goes on looking at it.
            Some(end) if old.info.end.is_some_and(|end| old.now >= end) => driver.send(Control::Seek(end)),
            _ if new.now != old.now => driver.send(Control::Seek(old.now)),
            _ => {}
        }
        if playback.playing {
            driver.send(Control::Play);
        }
        if let Shown::Live(old) = std::mem::replace(&mut self.shown, Shown::Live(driver)) {
            memory::close(old);
        }
    }
}
