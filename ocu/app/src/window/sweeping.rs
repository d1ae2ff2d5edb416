//! The sweep of the window: `ocu sweep` on threads of low priority, for the view that shows it.

use crate::cli::{FaultArgs, SweepArgs, parse_values};
use crate::open::{Request, SweptRun};
use crate::say;
use crate::stacks;
use crate::sweep::{Prepared, Row};
use crate::time::file_name_of;
use ocu_views::{SweepRequest, SweepRow, SweepState};
use rcs_msg::Stamp;
use rcs_msg::guard::guarded;
use rcs_runtime::source::Frame;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::{SystemTime, UNIX_EPOCH};

/// Sweeps whose recordings are kept, and how large those before the newest may be together, bytes.
const KEPT: (usize, u64) = (10, 1 << 30);

/// The sweep that runs, or ran last.
#[derive(Default)]
pub(super) struct Sweeping {
    /// The last open source that a sweep can run.
    base: Option<Request>,
    /// The title of `base`, with its course.
    title: String,
    /// Whether parameters have been sent to its processes, which a sweep does not use.
    is_tuned: bool,
    /// Where recordings of the runs are kept.
    folder: Option<PathBuf>,
    running: Option<Running>,
    /// As it was given to the views last.
    shown: Arc<SweepState>,
}

/// What a sweep runs.
#[derive(Clone, Default)]
struct Swept {
    base: Request,
    /// In words, for the view.
    what: String,
}

struct Running {
    asked: Swept,
    shared: Arc<Mutex<Shared>>,
    cancelled: Arc<AtomicBool>,
}

#[derive(Default)]
struct Shared {
    rows: BTreeMap<usize, Row>,
    total: usize,
    /// What the rows are of.
    of: Swept,
    problem: Option<String>,
    /// Whether it can run; until then, rows, total and what they are of are those of the sweep before.
    is_checked: bool,
    is_over: bool,
}

impl Sweeping {
    pub(super) fn new(data_dir: Option<&Path>) -> Self {
        let folder = data_dir.map(|folder| folder.join("sweeps"));
        Self { folder, ..Self::default() }
    }

    /// Looks whether parameters have been sent in what is open.
    pub(super) fn look(&mut self, current: &Request, frame: Option<&Frame>) {
        if current.stack.is_some() {
            self.is_tuned = frame.is_some_and(is_tuned);
        }
    }

    /// The state for the views. `current` is what is open.
    pub(super) fn state(&mut self, current: &Request) -> Arc<SweepState> {
        if current.stack.is_some() && self.base.as_ref() != Some(current) {
            self.base = Some(current.clone());
            self.title = title_of(current);
        }
        let what = self.what();
        let state = match &self.running {
            None => SweepState { what, ..SweepState::default() },
            Some(running) => {
                let shared = lock(&running.shared);
                let total = if shared.is_checked || shared.is_over { shared.total } else { 0 };
                let ran = if shared.is_over { &shared.of.what } else { &running.asked.what };
                let is_known = self.shown.rows.len() == shared.rows.len()
                    && self.shown.total == total
                    && self.shown.is_running != shared.is_over
                    && self.shown.problem == shared.problem
                    && self.shown.what == what
                    && self.shown.ran == *ran;
                if is_known {
                    return Arc::clone(&self.shown);
                }
                SweepState {
                    what,
                    ran: ran.clone(),
                    rows: shared.rows.values().map(row).collect(),
                    total,
                    is_running: !shared.is_over,
                    problem: shared.problem.clone(),
                }
            }
        };
        if *self.shown != state {
            self.shown = Arc::new(state);
        }
        Arc::clone(&self.shown)
    }

    /// Begins a sweep of the open stack; one that runs ends. If it is refused, the rows of the one before stay.
    pub(super) fn start(&mut self, ctx: &egui::Context, request: &SweepRequest) {
        let Some(base) = self.base.clone() else { return };
        let table_of = |old: Running| {
            let mut shared = lock(&old.shared);
            (std::mem::take(&mut shared.rows), shared.total, std::mem::take(&mut shared.of))
        };
        let (rows, total, of) = self.running.take().map(table_of).unwrap_or_default();
        let shared = Arc::new(Mutex::new(Shared { rows, total, of, ..Shared::default() }));
        let cancelled: Arc<AtomicBool> = Arc::default();
        let args = args_of(&base, request, self.folder.as_deref().map(new_folder));
        let asked = Swept { base, what: self.what() };
        self.running = Some(Running {
            asked: asked.clone(),
            shared: Arc::clone(&shared),
            cancelled: Arc::clone(&cancelled),
        });
        let (ctx, folder) = (ctx.clone(), self.folder.clone());
        let spawned = thread::Builder::new().name("sweep".to_owned()).spawn({
            let shared = Arc::clone(&shared);
            move || {
                rcs_runtime::lower_priority();
                if let Some(Err(error)) = folder.map(|folder| make_room(&folder, KEPT)) {
                    tracing::warn!("recordings of earlier sweeps cannot be removed: {error}");
                }
                let run = || args.and_then(|args| run(&args, asked, &shared, &cancelled, &ctx));
                let ran = guarded(run).unwrap_or_else(|said| Err(anyhow::anyhow!("a run failed: {said}")));
                let mut shared = lock(&shared);
                shared.is_over = true;
                shared.problem = ran.err().map(|error| reason(&error));
                drop(shared);
                ctx.request_repaint();
            }
        });
        if let Err(error) = spawned {
            let mut shared = lock(&shared);
            shared.is_over = true;
            shared.problem = Some(format!("no thread for the sweep: {error}"));
        }
    }

    /// A run of the sweep, with the log that its stack reads.
    pub(super) fn swept(&self, title: String) -> SweptRun {
        let base = match &self.running {
            Some(running) => lock(&running.shared).of.base.clone(),
            None => self.base.clone().unwrap_or_default(),
        };
        SweptRun { title, log: base.log, parts: base.parts }
    }

    /// What a sweep would run now; empty where nothing can be swept.
    fn what(&self) -> String {
        let Some(base) = &self.base else { return String::new() };
        let mut what = self.title.clone();
        if base.remembered.is_some() {
            what.push_str(", without what earlier runs remember");
        }
        if self.is_tuned {
            what.push_str(", with the parameters of the stack file");
        }
        what
    }

    /// Ends the sweep that runs; the runs that ended stay.
    pub(super) fn cancel(&mut self) {
        if let Some(running) = &self.running {
            running.cancelled.store(true, Ordering::Relaxed);
        }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        self.cancelled.store(true, Ordering::Relaxed);
    }
}

/// The title of a source, with the course of the stack file where none was chosen.
fn title_of(base: &Request) -> String {
    let stack = base.stack.as_deref().filter(|_| base.course.is_none());
    let own = stack.and_then(|stack| stacks::named(stack).ok()?.course().map(str::to_owned));
    Request { course: own.or_else(|| base.course.clone()), ..base.clone() }.title()
}

/// Whether parameters have been sent to a process: a run begins with one message of each.
fn is_tuned(frame: &Frame) -> bool {
    let mut topics = frame.processes.iter().filter_map(|info| frame.topic(&info.params_buffer));
    topics.any(|topic| !topic.run.is_recorded() && topic.messages > 1)
}

/// The arguments of `ocu sweep` for a request.
fn args_of(base: &Request, request: &SweepRequest, record: Option<PathBuf>) -> anyhow::Result<SweepArgs> {
    let params = request.params.iter().map(|text| parse_values(text));
    Ok(SweepArgs {
        stack: base.stack.clone().unwrap_or_default(),
        log: base.log.clone(),
        parts: base.parts.clone(),
        course: base.course.clone(),
        params: params.collect::<Result<_, _>>().map_err(anyhow::Error::msg)?,
        faults: FaultArgs { faults: request.faults.clone() },
        runs: request.runs,
        seed: request.seed,
        until: request.until_s,
        record,
        force: false,
        // The window and the stack that it runs keep a core.
        jobs: None,
        json: false,
    })
}

/// Why a sweep was refused, without the option by which the command line has the parameter.
fn reason(error: &anyhow::Error) -> String {
    let text = say(error);
    text.strip_prefix("--param: ").unwrap_or(&text).to_owned()
}

/// A folder that does not exist yet, named by the time.
fn new_folder(folder: &Path) -> PathBuf {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_nanos() as u64);
    folder.join(file_name_of(Stamp(now)))
}

/// Removes the oldest recordings, so that there is room for those of another sweep within the limits.
fn make_room(folder: &Path, (most, most_bytes): (usize, u64)) -> std::io::Result<()> {
    let Ok(entries) = std::fs::read_dir(folder) else { return Ok(()) };
    let mut sweeps = Vec::new();
    for entry in entries {
        let entry = entry?;
        // Nothing that a person put there: sweeps are named by their times.
        let name = entry.file_name();
        let name = name.to_string_lossy();
        let is_time = name.len() == 15 && name.chars().all(|c| c.is_ascii_digit() || c == '-');
        if is_time && entry.file_type()?.is_dir() {
            sweeps.push(entry.path());
        }
    }
    sweeps.sort();
    let mut bytes = 0;
    for (place, sweep) in sweeps.iter().rev().enumerate() {
        let files = std::fs::read_dir(sweep)?.filter_map(|file| file.ok()?.metadata().ok());
        bytes += files.map(|metadata| metadata.len()).sum::<u64>();
        if place + 1 >= most || (place > 0 && bytes > most_bytes) {
            std::fs::remove_dir_all(sweep)?;
        }
    }
    Ok(())
}

fn run(
    args: &SweepArgs,
    of: Swept,
    shared: &Mutex<Shared>,
    cancelled: &AtomicBool,
    ctx: &egui::Context,
) -> anyhow::Result<()> {
    let prepared = Prepared::new(args)?;
    let checked = Shared { total: prepared.len(), of, is_checked: true, ..Shared::default() };
    *lock(shared) = checked;
    ctx.request_repaint();
    // The window and the stack that it runs keep a core. The threads inherit the low priority of this one.
    let jobs = thread::available_parallelism().map_or(1, usize::from).saturating_sub(1).max(1);
    prepared.run(jobs, cancelled, &|index, row| {
        lock(shared).rows.insert(index, row);
        ctx.request_repaint();
    });
    Ok(())
}

fn row(row: &Row) -> SweepRow {
    SweepRow {
        params: row.params(),
        seed: row.seed,
        outcome: row.outcome().to_owned(),
        reached: row.course.as_ref().map(|course| course.outcome == "reached"),
        time_s: row.time_s(),
        course: row.course.as_ref().map(|run| (run.remaining_m, run.collisions, run.bumper_hits)),
        errors: row.errors(),
        recording: row.recording.clone(),
    }
}

fn lock(shared: &Mutex<Shared>) -> std::sync::MutexGuard<'_, Shared> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::{Duration, Instant};

    fn base() -> Request {
        let (stack, course) = (Some("truth_driver".to_owned()), Some("meadow".to_owned()));
        Request { stack, course, ..Request::default() }
    }

    fn wait(sweeping: &mut Sweeping, is_done: impl Fn(&SweepState) -> bool) -> Arc<SweepState> {
        let began = Instant::now();
        loop {
            let state = sweeping.state(&base());
            if is_done(&state) {
                return state;
            }
            assert!(began.elapsed() < Duration::from_mins(2), "{state:?}");
            thread::yield_now();
        }
    }

    #[test]
    fn a_sweep_runs_in_the_background_and_each_run_can_be_opened() {
        let folder = tempfile::tempdir().unwrap();
        let mut sweeping = Sweeping::new(Some(folder.path()));
        assert!(sweeping.state(&base()).rows.is_empty());
        let params = vec!["truth_driver.vehicle_width_m=0.6,0.8".to_owned()];
        let request = SweepRequest { params, runs: 2, until_s: Some(0.5), ..SweepRequest::default() };
        sweeping.start(&egui::Context::default(), &request);
        let state = wait(&mut sweeping, |state| !state.is_running && state.total > 0);
        assert_eq!((state.rows.len(), state.total, &state.problem), (4, 4, &None));
        assert_eq!(state.rows[3].params, "truth_driver.vehicle_width_m=0.8");
        assert_eq!((state.rows[3].seed, state.rows[3].outcome.as_str()), (1, "unfinished"));
        let log = state.rows[3].recording.clone();
        let mut opened = crate::stacks::open(&Request { log, ..Request::default() }).unwrap();
        let frame = opened.frame();
        assert!(frame.topics.iter().any(|topic| topic.name.starts_with("/truth_driver")));
        let told = frame.topics_of_type("rcs.RunInfo").find_map(|topic| topic.get::<rcs_msg::rcs::RunInfo>());
        assert_eq!(told.map(|run| (run.stack.as_str(), run.seed)), Some(("truth_driver", 1)));
    }

    #[test]
    fn a_sweep_reads_a_split_recording_whole_and_its_runs_open_with_all_of_it() {
        let folder = tempfile::tempdir().unwrap();
        let split = folder.path().join("split");
        std::fs::create_dir(&split).unwrap();
        let whole = folder.path().join("whole.mcap");
        crate::sample::write(&whole, 1.0, false).unwrap();
        let parts = ["drive_0.mcap", "drive_1.mcap"].map(|name| split.join(name));
        for (output, from, to) in [(&parts[0], 0.0, Some(0.4)), (&parts[1], 0.4, None)] {
            let output = output.clone();
            let cut = crate::cli::CutArgs { log: whole.clone(), from, to, output, force: false };
            crate::cut::cut(&cut, &mut Vec::<u8>::new()).unwrap();
        }
        let named = ["early.mcap", "late.mcap"].map(|name| folder.path().join(name));
        for (part, named) in parts.iter().zip(&named) {
            std::fs::copy(part, named).unwrap();
        }
        let [early, late] = named;
        let mut recording: Option<PathBuf> = None;
        // Its files by name, and the folder of them.
        for (log, parts) in [(early, vec![late]), (split.clone(), Vec::new())] {
            let name = if parts.is_empty() { "runs of the folder" } else { "runs" };
            let base =
                Request { log: Some(log), parts, stack: Some("sample".to_owned()), ..Request::default() };
            let request = SweepRequest { runs: 1, until_s: Some(0.7), ..SweepRequest::default() };
            let mut sweeping = Sweeping::new(None);
            sweeping.state(&base);
            let args = args_of(&base, &request, Some(folder.path().join(name))).unwrap();
            let rows: Mutex<Vec<Row>> = Mutex::default();
            let prepared = Prepared::new(&args).unwrap();
            prepared.run(1, &AtomicBool::new(false), &|_, row| rows.lock().unwrap().push(row));
            let rows = rows.into_inner().unwrap();
            assert!(rows[0].time_s() > 0.6, "the first part ends at 0.4 s: {rows:?}");
            recording.clone_from(&rows[0].recording);
            let run = Some(Box::new(sweeping.swept("seed 0".to_owned())));
            let request = Request { log: recording.clone(), run, ..Request::default() };
            let opened = crate::stacks::open(&request).map_err(|error| say(&error));
            assert_eq!(opened.err(), None, "{name}");
        }
        // Without what the sweep knows, the log is found beside the recording of the run.
        let moved = split.join("run.mcap");
        std::fs::copy(recording.unwrap(), &moved).unwrap();
        let opened = crate::stacks::open(&Request { log: Some(moved), ..Request::default() });
        assert_eq!(opened.map_err(|error| say(&error)).err(), None);
    }

    #[test]
    fn a_sweep_of_a_run_that_began_with_what_an_earlier_one_remembers_says_that_it_does_not() {
        let mut sweeping = Sweeping::new(None);
        assert_eq!(sweeping.state(&base()).what, "truth_driver on meadow");
        let next = base().remembering(crate::remembered::Remembered::default(), Some(1));
        let what = "truth_driver on meadow, without what earlier runs remember";
        assert_eq!(sweeping.state(&next).what, what);
    }

    #[test]
    fn the_runs_of_a_sweep_are_of_the_course_that_was_open_when_it_began() {
        let mut sweeping = Sweeping::new(None);
        sweeping.state(&base());
        let request = SweepRequest { runs: 1, until_s: Some(0.2), ..SweepRequest::default() };
        sweeping.start(&egui::Context::default(), &request);
        let other = Request { course: Some("hill".to_owned()), ..base() };
        for is_running in [true, false] {
            if !is_running {
                wait(&mut sweeping, |state| !state.is_running);
            }
            let state = sweeping.state(&other);
            let told = (state.what.as_str(), state.ran.as_str());
            assert_eq!(told, ("truth_driver on hill", "truth_driver on meadow"));
        }
        assert_eq!(sweeping.state(&Request { course: None, ..base() }).what, "truth_driver on meadow");
    }

    #[test]
    fn a_sweep_says_that_it_does_not_use_parameters_that_were_sent() {
        use rcs_msg::rcs::{ProcessInfo, SpeedLimit};
        use rcs_runtime::source::{RunTag, SourceInfo, SourceKind, Topic};
        let info = SourceInfo { kind: SourceKind::Stack, ..SourceInfo::default() };
        let frame = |messages: u64| {
            let schema = Arc::clone(rcs_msg::schema_of::<SpeedLimit>());
            let mut params = Topic::new("/a/params", RunTag::FIRST, schema);
            params.messages = messages;
            let process =
                ProcessInfo { name: "a".into(), params_buffer: "/a/params".into(), ..ProcessInfo::default() };
            let empty = Frame::empty(Arc::new(info.clone()), Stamp(0));
            Frame { topics: Arc::new([params]), processes: Arc::new([process]), ..empty }
        };
        let mut sweeping = Sweeping::new(None);
        sweeping.look(&base(), Some(&frame(1)));
        assert_eq!(sweeping.state(&base()).what, "truth_driver on meadow");
        sweeping.look(&base(), Some(&frame(2)));
        let what = "truth_driver on meadow, with the parameters of the stack file";
        assert_eq!(sweeping.state(&base()).what, what);
        // The recording of one of its runs is open.
        let run = Request { log: Some("run-0001.mcap".into()), ..Request::default() };
        sweeping.look(&run, Some(&frame(1)));
        assert_eq!(sweeping.state(&run).what, what);
    }

    #[test]
    fn recordings_of_earlier_sweeps_are_removed_by_number_and_size_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let names = || {
            let entries = std::fs::read_dir(folder.path()).unwrap();
            let mut names: Vec<_> =
                entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
            names.sort();
            names
        };
        for day in 1..6 {
            let sweep = folder.path().join(format!("2026010{day}-000012"));
            std::fs::create_dir(&sweep).unwrap();
            std::fs::write(sweep.join("run.mcap"), [0; 100]).unwrap();
        }
        std::fs::create_dir(folder.path().join("mine")).unwrap();
        make_room(folder.path(), (4, 1000)).unwrap();
        assert_eq!(names(), ["20260103-000012", "20260104-000012", "20260105-000012", "mine"]);
        make_room(folder.path(), (4, 250)).unwrap();
        assert_eq!(names(), ["20260104-000012", "20260105-000012", "mine"]);
        make_room(folder.path(), (4, 50)).unwrap();
        assert_eq!(names(), ["20260105-000012", "mine"], "the newest is kept whatever its size");
        make_room(&folder.path().join("absent"), (4, 50)).unwrap();
    }

    #[test]
    fn a_sweep_that_is_refused_says_why_and_leaves_the_rows_of_the_one_before() {
        let mut sweeping = Sweeping::new(None);
        sweeping.state(&base());
        let mut swept = |values: &str| {
            let params = vec![format!("truth_driver.vehicle_width_m={values}")];
            let request = SweepRequest { params, runs: 1, until_s: Some(0.2), ..SweepRequest::default() };
            sweeping.start(&egui::Context::default(), &request);
            wait(&mut sweeping, |state| !state.is_running)
        };
        let first = swept("0.6,0.8");
        assert_eq!((first.rows.len(), first.total, &first.problem), (2, 2, &None));
        // No list of values, and a value out of range.
        for (values, problem) in
            [("0.6..1.2:100000", "expected "), ("9", "truth_driver.vehicle_width_m: got 9")]
        {
            let refused = swept(values);
            assert_eq!((&refused.rows, refused.total), (&first.rows, 2), "{values}");
            assert!(refused.problem.as_ref().is_some_and(|text| text.starts_with(problem)), "{refused:?}");
        }
        let next = swept("0.7");
        assert_eq!((next.rows.len(), next.total, &next.problem), (1, 1, &None));
    }

    #[test]
    fn a_sweep_that_makes_no_sense_is_refused_and_one_that_is_cancelled_keeps_its_runs() {
        let mut sweeping = Sweeping::new(None);
        sweeping.state(&base());
        for (param, part) in
            [("truth_driver.absent=1,2", "absent"), ("truth_driver.vehicle_width_m=", "expected")]
        {
            let request = SweepRequest { params: vec![param.to_owned()], runs: 1, ..SweepRequest::default() };
            sweeping.start(&egui::Context::default(), &request);
            let state = wait(&mut sweeping, |state| !state.is_running && state.problem.is_some());
            assert!(state.problem.as_ref().unwrap().contains(part), "{state:?}");
        }
        let request = SweepRequest { runs: 1000, until_s: Some(0.2), ..SweepRequest::default() };
        sweeping.start(&egui::Context::default(), &request);
        wait(&mut sweeping, |state| state.rows.len() > 1);
        sweeping.cancel();
        let state = wait(&mut sweeping, |state| !state.is_running);
        assert!(state.rows.len() < 1000 && state.problem.is_none(), "{}", state.rows.len());
    }
}
