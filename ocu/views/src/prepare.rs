//! Values made by other threads than the interface's: decoded images, coloured maps, clouds seen from above.
//!
//! A value belongs to a slot, and is made again when its key changes: the message, and all that decides how it looks.
//! Until it is ready, the slot keeps its former value. Views that ask for one slot share its value; a slot that no view
//! asks for in a pass is freed. Of each slot at most one value is made at a time, and the next one is that of the newest
//! key, so a slow one never queues, and every value that is finished is shown.
//!
//! Without [`start`] each value is made in the pass that asks for it: pictures of tests and of `ocu render` do not
//! depend on time.

use egui::cache::CacheTrait;
use egui::{ColorImage, Context, Id, TextureHandle, TextureId, TextureOptions};
use std::collections::HashMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::Duration;

/// The most threads: more would take processors from the stack.
const MOST_THREADS: usize = 4;

type Job = Box<dyn FnOnce() + Send>;

/// The threads of a window.
#[derive(Clone)]
struct Threads {
    jobs: Sender<Job>,
    /// Time after which a finished value is drawn, µs.
    within_us: Arc<AtomicU64>,
}

/// From now on, values for this context are made by threads of their own. Fails if the system gives no thread.
pub fn start(ctx: &Context) -> std::io::Result<()> {
    let (jobs, receiver) = channel::<Job>();
    let receiver = Arc::new(Mutex::new(receiver));
    for _ in 0..count() {
        let receiver = Arc::clone(&receiver);
        thread::Builder::new().name("prepare".to_owned()).spawn(move || {
            while let Some(job) = next(&receiver) {
                job();
            }
        })?;
    }
    ctx.data_mut(|data| data.insert_temp(Id::NULL, Threads { jobs, within_us: Arc::default() }));
    Ok(())
}

/// Sets the time within which a finished value is drawn; values that are finished meanwhile are drawn in the same frame.
pub fn draw_within(ctx: &Context, time: Duration) {
    if let Some(threads) = threads(ctx) {
        threads.within_us.store(time.as_micros() as u64, Ordering::Relaxed);
    }
}

/// Memory of all pictures: each is in a texture and, until another one takes its place, in the memory of the program.
pub fn picture_bytes(ctx: &Context) -> u64 {
    let textures = ctx.tex_manager();
    let textures = textures.read();
    2 * textures.allocated().map(|(_, texture)| texture.bytes_used() as u64).sum::<u64>()
}

/// Whether threads make the values of this context: there is a window, which never waits.
pub(crate) fn has_threads(ctx: &Context) -> bool {
    threads(ctx).is_some()
}

fn threads(ctx: &Context) -> Option<Threads> {
    ctx.data(|data| data.get_temp(Id::NULL))
}

/// Number of threads: half of the processors.
fn count() -> usize {
    thread::available_parallelism().map_or(1, usize::from).div_ceil(2).min(MOST_THREADS)
}

fn next(jobs: &Mutex<Receiver<Job>>) -> Option<Job> {
    lock(jobs).recv().ok()
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The value of a slot for `key`; until it is made, the former one, and `None` before the first. `slot` must contain
/// all of the appearance in which two views of one topic may differ, so that they do not take turns.
pub(crate) fn prepared<K, V>(
    ctx: &Context,
    slot: Id,
    key: K,
    make: impl FnOnce() -> V + Send + 'static,
) -> Option<Arc<V>>
where
    K: PartialEq + Send + Sync + 'static,
    V: Send + Sync + 'static,
{
    prepared_after(ctx, slot, key, |_| make())
}

/// As [`prepared`], of a value that also depends on the last one of the slot, if there is one.
pub(crate) fn prepared_after<K, V>(
    ctx: &Context,
    slot: Id,
    key: K,
    make: impl FnOnce(Option<Arc<V>>) -> V + Send + 'static,
) -> Option<Arc<V>>
where
    K: PartialEq + Send + Sync + 'static,
    V: Send + Sync + 'static,
{
    let Some(threads) = threads(ctx) else {
        let last = with(ctx, slot, |slot: &mut Slot<K, V>| slot.value());
        return Some(shared(ctx, slot, key, || make(last)));
    };
    let (value, former, work) = with(ctx, slot, |slot: &mut Slot<K, V>| {
        let former = slot.take_finished(&key);
        let value = slot.value();
        let last = value.clone();
        let work = slot.ask(key, Box::new(move || make(last)));
        (value, former, work)
    });
    // Freeing an image takes as long as painting a button.
    if let Some(former) = former {
        let _ = threads.jobs.send(Box::new(move || drop(former)));
    }
    if let Some(work) = work {
        let (ctx, within_us) = (ctx.clone(), threads.within_us);
        let job = move || {
            // Where the slot has been freed meanwhile, nobody waits for the value.
            if Arc::strong_count(&work) > 1 {
                carry_out(&work);
                ctx.request_repaint_after(Duration::from_micros(within_us.load(Ordering::Relaxed)));
            }
        };
        // The threads last as long as the context, which holds the other end.
        let _ = threads.jobs.send(Box::new(job));
    }
    value
}

/// The value of a slot for `key`, made in this pass if it is another key than before. Views share it.
pub(crate) fn shared<K, V>(ctx: &Context, slot: Id, key: K, make: impl FnOnce() -> V) -> Arc<V>
where
    K: PartialEq + Send + Sync + 'static,
    V: Send + Sync + 'static,
{
    if let Some(value) = with(ctx, slot, |slot| slot.value_for(&key)) {
        return value;
    }
    let value = Arc::new(make());
    with(ctx, slot, |slot| slot.ready = Some((key, Some(Arc::clone(&value)))));
    value
}

/// Looks into a slot. The memory of the context is locked meanwhile.
fn with<K, V, R>(ctx: &Context, slot: Id, look: impl FnOnce(&mut Slot<K, V>) -> R) -> R
where
    K: Send + Sync + 'static,
    V: Send + Sync + 'static,
{
    ctx.memory_mut(|memory| {
        let slot = memory.caches.cache::<Slots<K, V>>().0.entry(slot).or_default();
        slot.is_used = true;
        look(slot)
    })
}

/// A value compared by identity: equal only to itself.
pub(crate) struct Same<T>(pub(crate) Arc<T>);

impl<T> PartialEq for Same<T> {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}

type Make<V> = Box<dyn FnOnce() -> V + Send>;

/// A value on its way.
enum Work<V> {
    Waits(Make<V>),
    Begun,
    /// `None` if making it panicked.
    Done(Option<Arc<V>>),
}

fn carry_out<V>(work: &Mutex<Work<V>>) {
    let before = std::mem::replace(&mut *lock(work), Work::Begun);
    if let Work::Waits(make) = before {
        let value = catch_unwind(AssertUnwindSafe(make)).ok().map(Arc::new);
        *lock(work) = Work::Done(value);
    }
}

struct Slot<K, V> {
    /// The finished value, and its key; no value if making it panicked.
    ready: Option<(K, Option<Arc<V>>)>,
    making: Option<(K, Arc<Mutex<Work<V>>>)>,
    /// Whether a view has asked for it since the last pass.
    is_used: bool,
}

impl<K, V> Default for Slot<K, V> {
    fn default() -> Self {
        Self { ready: None, making: None, is_used: true }
    }
}

impl<K: PartialEq, V> Slot<K, V> {
    fn is_ready(&self, key: &K) -> bool {
        self.ready.as_ref().is_some_and(|(ready, _)| ready == key)
    }

    /// The finished value, of whichever key.
    fn value(&self) -> Option<Arc<V>> {
        self.ready.as_ref()?.1.clone()
    }

    fn value_for(&self, key: &K) -> Option<Arc<V>> {
        self.ready.as_ref().filter(|(ready, _)| ready == key)?.1.clone()
    }

    /// Takes the value that has been made, unless that of `key` is already here; returns what is to be freed.
    fn take_finished(&mut self, key: &K) -> Option<(K, Option<Arc<V>>)> {
        let (of, work) = self.making.take()?;
        let is_ready = self.is_ready(key);
        let mut state = lock(&work);
        match &mut *state {
            Work::Done(value) => {
                let made = (of, value.take());
                return if is_ready { Some(made) } else { self.ready.replace(made) };
            }
            // It is not needed any more.
            Work::Waits(_) if is_ready => return None,
            Work::Waits(_) | Work::Begun => {}
        }
        drop(state);
        self.making = Some((of, work));
        None
    }

    /// Asks for the value of a key; returns the work, if it has to be given to a thread.
    fn ask(&mut self, key: K, make: Make<V>) -> Option<Arc<Mutex<Work<V>>>> {
        if self.is_ready(&key) {
            return None;
        }
        if let Some((of, work)) = &mut self.making {
            // What has not begun is replaced by what is newer.
            if *of != key
                && let Work::Waits(waiting) = &mut *lock(work)
            {
                (*of, *waiting) = (key, make);
            }
            return None;
        }
        let work = Arc::new(Mutex::new(Work::Waits(make)));
        self.making = Some((key, Arc::clone(&work)));
        Some(work)
    }
}

/// All slots of one type.
struct Slots<K, V>(HashMap<Id, Slot<K, V>>);

impl<K, V> Default for Slots<K, V> {
    fn default() -> Self {
        Self(HashMap::new())
    }
}

impl<K: Send + Sync + 'static, V: Send + Sync + 'static> CacheTrait for Slots<K, V> {
    fn update(&mut self) {
        self.0.retain(|_, slot| std::mem::take(&mut slot.is_used));
    }

    fn len(&self) -> usize {
        self.0.len()
    }
}

/// An image, and its textures, which exist from the first time that it is drawn.
pub(crate) struct Painted {
    image: Arc<ColorImage>,
    textures: Mutex<Vec<(TextureOptions, TextureHandle)>>,
}

impl Painted {
    pub(crate) fn new(image: ColorImage) -> Self {
        Self { image: Arc::new(image), textures: Mutex::default() }
    }

    /// Width and height, pixels.
    pub(crate) fn size(&self) -> [usize; 2] {
        self.image.size
    }

    /// The texture, which all views share.
    pub(crate) fn texture(&self, ctx: &Context, options: TextureOptions) -> TextureId {
        let mut textures = lock(&self.textures);
        if let Some((_, texture)) = textures.iter().find(|(known, _)| *known == options) {
            return texture.id();
        }
        let texture = ctx.load_texture("view", Arc::clone(&self.image), options);
        let id = texture.id();
        textures.push((options, texture));
        id
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Barrier;
    use std::time::Instant;

    const SLOT: &str = "slot";

    fn ask(ctx: &Context, key: u32, make: impl FnOnce() -> u32 + Send + 'static) -> Option<u32> {
        prepared(ctx, Id::unique(SLOT), key, make).map(|value| *value)
    }

    /// A value that is made when `gate` opens.
    fn behind(gate: &Arc<Barrier>, value: u32) -> impl FnOnce() -> u32 + Send + 'static {
        let gate = Arc::clone(gate);
        move || {
            gate.wait();
            value
        }
    }

    fn started() -> Context {
        let ctx = Context::default();
        start(&ctx).unwrap();
        ctx
    }

    /// One pass of a window in which nothing is painted.
    fn pass(ctx: &Context) {
        ctx.run_ui(egui::RawInput::default(), |_| {}).textures_delta.clear();
    }

    fn until(mut is_so: impl FnMut() -> bool) {
        let start = Instant::now();
        while !is_so() {
            assert!(start.elapsed() < Duration::from_secs(20), "it never came");
            thread::yield_now();
        }
    }

    #[test]
    fn without_threads_a_value_is_there_at_once_and_made_once() {
        let ctx = Context::default();
        assert_eq!(ask(&ctx, 1, || 10), Some(10));
        assert_eq!(ask(&ctx, 1, || unreachable!()), Some(10));
        assert_eq!(ask(&ctx, 2, || 20), Some(20));
    }

    #[test]
    fn a_pass_waits_for_nothing_and_shows_the_former_value_meanwhile() {
        let ctx = started();
        assert_eq!(ask(&ctx, 1, || 10), None);
        until(|| ask(&ctx, 1, || unreachable!()) == Some(10));
        let gate = Arc::new(Barrier::new(2));
        assert_eq!(ask(&ctx, 2, behind(&gate, 20)), Some(10));
        assert_eq!(ask(&ctx, 2, || unreachable!("it is already being made")), Some(10));
        gate.wait();
        until(|| ask(&ctx, 2, || unreachable!()) == Some(20));
    }

    #[test]
    fn a_key_that_changes_in_every_pass_shows_every_value_that_is_finished() {
        let ctx = started();
        let (mut key, mut last) = (0, 0);
        until(|| {
            key += 1;
            let made = key;
            let shown = ask(&ctx, key, move || made).unwrap_or_default();
            assert!((last..=key).contains(&shown), "{last} to {key}: {shown}");
            last = shown;
            last > 20
        });
    }

    #[test]
    fn a_value_may_depend_on_the_last_one() {
        let one_more = |last: Option<Arc<u32>>| last.map_or(1, |last| *last + 1);
        for ctx in [Context::default(), started()] {
            for key in 1..=3 {
                let ask = || prepared_after(&ctx, Id::unique(SLOT), key, one_more).map(|value| *value);
                until(|| ask() == Some(key));
                assert_eq!(ask(), Some(key), "it is made once");
            }
        }
    }

    #[test]
    fn of_values_that_wait_only_the_newest_is_made() {
        let ctx = started();
        let gate = Arc::new(Barrier::new(count() + 1));
        // All threads are busy.
        for index in 0..count() {
            assert!(prepared(&ctx, Id::unique(("busy", index)), 1, behind(&gate, 0)).is_none());
        }
        assert_eq!(ask(&ctx, 1, || unreachable!("there is a newer one")), None);
        assert_eq!(ask(&ctx, 2, || 20), None);
        gate.wait();
        until(|| ask(&ctx, 2, || unreachable!()) == Some(20));
    }

    #[test]
    fn a_value_that_is_late_does_not_replace_the_one_that_is_wanted_again() {
        let ctx = started();
        ask(&ctx, 1, || 10);
        until(|| ask(&ctx, 1, || unreachable!()) == Some(10));
        let gate = Arc::new(Barrier::new(2));
        assert_eq!(ask(&ctx, 2, behind(&gate, 20)), Some(10));
        gate.wait();
        let is_idle = || {
            assert_eq!(ask(&ctx, 1, || unreachable!()), Some(10));
            with(&ctx, Id::unique(SLOT), |slot: &mut Slot<u32, u32>| slot.making.is_none())
        };
        until(is_idle);
    }

    #[test]
    fn a_value_that_no_view_asks_for_is_freed() {
        let ctx = Context::default();
        pass(&ctx);
        let value = prepared(&ctx, Id::unique(SLOT), 1_u32, || vec![1_u8; 8]).unwrap();
        let weak = Arc::downgrade(&value);
        drop(value);
        pass(&ctx);
        pass(&ctx);
        assert!(weak.upgrade().is_none());
    }

    #[test]
    fn a_value_that_cannot_be_made_is_not_asked_for_again_and_hides_the_former_one() {
        let ctx = started();
        ask(&ctx, 1, || 10);
        until(|| ask(&ctx, 1, || unreachable!()) == Some(10));
        assert_eq!(ask(&ctx, 2, || panic!("as a test")), Some(10));
        until(|| ask(&ctx, 2, || unreachable!()).is_none());
        ask(&ctx, 3, || 30);
        until(|| ask(&ctx, 3, || unreachable!()) == Some(30));
    }

    #[test]
    fn a_texture_is_made_once_for_all_views() {
        let ctx = Context::default();
        let painted = Painted::new(ColorImage::filled([2, 3], egui::Color32::RED));
        let id = painted.texture(&ctx, TextureOptions::NEAREST);
        assert_eq!(painted.texture(&ctx, TextureOptions::NEAREST), id);
        assert_ne!(painted.texture(&ctx, TextureOptions::LINEAR), id);
        assert_eq!(painted.size(), [2, 3]);
    }
}
