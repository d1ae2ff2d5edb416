//! The recorder's thread.

use crate::common::{SharedSink, header, read_all, schema};
use bytes::Bytes;
use rcs_log::{Log, LogError, LogWriter, Recorder, RecorderMode, RecorderOptions, Sink, WriterOptions};
use rcs_msg::foxglove::Vector3;
use rcs_msg::{AnyMessage, DeferredSource, Stamp};
use std::collections::BTreeMap;
use std::io::{self, Write};
use std::sync::{Arc, Condvar, Mutex};

fn start(sink: Box<dyn Sink>, mode: RecorderMode, queue_messages: usize) -> Recorder {
    let options = WriterOptions { chunk_bytes: 100, compress: false, ..WriterOptions::default() };
    let writer = LogWriter::with_sink(sink, "recording.mcap".into(), options).unwrap();
    Recorder::start(writer, RecorderOptions { mode, queue_messages, queue_bytes: 1 << 20, on_start: None })
        .unwrap()
}

#[test]
fn a_lossless_recording_holds_every_message_of_every_thread() {
    let sink = SharedSink::default();
    let recorder = start(Box::new(sink.clone()), RecorderMode::Lossless, 3);
    std::thread::scope(|scope| {
        for thread in 0..4u64 {
            let handle = recorder.handle();
            scope.spawn(move || {
                let schema = Arc::new(schema());
                let channel = handle.add_channel(&format!("/{thread}"), &schema, BTreeMap::new()).unwrap();
                for index in 0..250 {
                    assert!(handle.write(
                        channel,
                        header(index, index as u64),
                        Bytes::from(vec![thread as u8; 20])
                    ));
                }
            });
        }
    });
    let handle = recorder.handle();
    handle.attach("stack.toml", "text/plain", Stamp(0), Bytes::from_static(b"text"));
    handle.metadata("note", BTreeMap::new());
    handle.flush();
    assert_eq!(
        Log::from_bytes(sink.snapshot().into()).unwrap().info().messages,
        1000,
        "flushed means readable"
    );
    let status = recorder.finish().unwrap();
    assert_eq!((status.written, status.dropped, status.queued), (1000, 0, 0));
    assert_eq!(status.bytes, sink.snapshot().len() as u64);
    assert!(
        !handle.write(rcs_log::ChannelId(0), header(0, 0), Bytes::new()),
        "an ended recording takes nothing"
    );
    let log = Log::from_bytes(sink.snapshot().into()).unwrap();
    assert!(!log.info().recovered);
    assert_eq!(log.info().topics.len(), 4);
    assert!(log.info().topics.iter().all(|topic| topic.messages == 250));
    for message in read_all(&log) {
        let name = &log.info().topic(message.topic).unwrap().name;
        assert_eq!(*name, format!("/{}", message.data[0]));
    }
    assert_eq!(log.attachment("stack.toml").unwrap().unwrap().data, "text");
}

/// A disk that blocks until it is released.
#[derive(Clone)]
struct Stuck {
    sink: SharedSink,
    gate: Arc<(Mutex<bool>, Condvar)>,
}

impl Write for Stuck {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let (open, opened) = &*self.gate;
        drop(opened.wait_while(open.lock().unwrap(), |open| !*open).unwrap());
        self.sink.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Sink for Stuck {}

#[test]
fn a_live_recording_on_a_stuck_disk_drops_counts_and_never_waits() {
    let gate = Arc::new((Mutex::new(true), Condvar::new()));
    let stuck = Stuck { sink: SharedSink::default(), gate: Arc::clone(&gate) };
    let sink = stuck.sink.clone();
    let recorder = start(Box::new(stuck), RecorderMode::Live, 8);
    *gate.0.lock().unwrap() = false;
    let handle = recorder.handle();
    let channel = handle.add_channel("/0", &Arc::new(schema()), BTreeMap::new()).unwrap();
    let taken = (0..500)
        .filter(|&index| handle.write(channel, header(index, index as u64), Bytes::from(vec![0; 60])))
        .count();
    assert!(taken < 500);
    let status = handle.status();
    assert_eq!(status.dropped, 500 - taken as u64);
    assert!(status.error.is_none());
    *gate.0.lock().unwrap() = true;
    gate.1.notify_all();
    let status = recorder.finish().unwrap();
    assert_eq!((status.written, status.dropped), (taken as u64, 500 - taken as u64));
    assert_eq!(Log::from_bytes(sink.snapshot().into()).unwrap().info().messages, taken as u64);
}

#[test]
fn a_full_disk_shows_in_the_status_and_a_lossless_recording_does_not_hang() {
    let sink = SharedSink::with_room(3000);
    let recorder = start(Box::new(sink.clone()), RecorderMode::Lossless, 2);
    let handle = recorder.handle();
    let channel = handle.add_channel("/0", &Arc::new(schema()), BTreeMap::new()).unwrap();
    let taken = (0..500)
        .filter(|&index| handle.write(channel, header(index, index as u64), Bytes::from(vec![0; 60])))
        .count();
    assert!(taken < 500);
    handle.flush();
    let status = handle.status();
    assert!(status.error.as_ref().unwrap().contains("recording.mcap"), "{status:?}");
    assert_eq!(status.written + status.dropped, 500, "{status:?}");
    let error = recorder.finish().unwrap_err();
    assert!(matches!(error, LogError::Write { .. }), "{error}");
    let log = Log::from_bytes(sink.snapshot().into()).unwrap();
    let order: Vec<u32> = read_all(&log).iter().map(|message| message.sequence).collect();
    assert!(order.len() > 5, "{}", order.len());
    assert!(order.iter().copied().eq(0..order.len() as u32));
}

/// A message that reports the thread on which it was encoded.
#[derive(Clone)]
struct Told(Arc<Mutex<Vec<Option<String>>>>);

impl DeferredSource<Vector3> for Told {
    fn to_message(&self) -> Vector3 {
        self.0.lock().unwrap().push(std::thread::current().name().map(str::to_owned));
        Vector3::default()
    }
}

#[test]
fn a_message_is_encoded_on_the_recorders_thread() {
    let recorder = start(Box::new(SharedSink::default()), RecorderMode::Live, 8);
    let handle = recorder.handle();
    let channel = handle.add_channel("/0", &Arc::new(schema()), BTreeMap::new()).unwrap();
    let told = Told(Arc::default());
    let message = AnyMessage::deferred::<Told, Vector3>(told.clone());
    assert!(handle.write_message(channel, header(0, 0), message));
    assert_eq!(recorder.finish().unwrap().written, 1);
    assert_eq!(*told.0.lock().unwrap(), [Some("recorder".to_owned())]);
}

/// A message that cannot be encoded.
#[derive(Clone)]
struct Broken;

impl DeferredSource<Vector3> for Broken {
    fn to_message(&self) -> Vector3 {
        std::panic::panic_any("cannot be encoded")
    }
}

#[test]
fn a_message_that_panics_while_it_is_encoded_ends_the_recording_and_nothing_else() {
    let recorder = start(Box::new(SharedSink::default()), RecorderMode::Lossless, 2);
    let handle = recorder.handle();
    let channel = handle.add_channel("/0", &Arc::new(schema()), BTreeMap::new()).unwrap();
    let broken = AnyMessage::deferred::<Broken, Vector3>(Broken);
    let taken = (0..50)
        .filter(|&index| match index {
            3 => handle.write_message(channel, header(index, 0), broken.clone()),
            _ => handle.write(channel, header(index, 0), Bytes::from(vec![0; 60])),
        })
        .count();
    handle.flush();
    assert!((4..50).contains(&taken), "{taken}");
    assert!(handle.status().error.is_some_and(|error| error.contains("panic")));
    assert!(recorder.finish().is_err());
}

#[test]
fn a_queue_that_is_full_of_images_still_takes_small_messages() {
    let gate = Arc::new((Mutex::new(true), Condvar::new()));
    let stuck = Stuck { sink: SharedSink::default(), gate: Arc::clone(&gate) };
    let recorder = start(Box::new(stuck), RecorderMode::Live, 1000);
    *gate.0.lock().unwrap() = false;
    let handle = recorder.handle();
    let channel = handle.add_channel("/0", &Arc::new(schema()), BTreeMap::new()).unwrap();
    let image = Bytes::from(vec![0; 400_000]);
    let images = (0..20).filter(|&index| handle.write(channel, header(index, 0), image.clone())).count();
    assert!((1..20).contains(&images), "{images} images fit into a mebibyte");
    for index in 0..100 {
        assert!(handle.write(channel, header(20 + index, 0), Bytes::from(vec![0; 60])));
    }
    *gate.0.lock().unwrap() = true;
    gate.1.notify_all();
    assert_eq!(recorder.finish().unwrap().written, images as u64 + 100);
}
