//! Recordings that are split into several files, compared with the same messages in one file.

use crate::common::{Numbers, header, read_all, schema};
use rcs_log::{Log, LogError, LogWriter, Lost, WriterOptions};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Topic, time and size of each message; topics appear in another order in each part.
fn messages(numbers: &mut Numbers) -> Vec<Vec<(usize, u64, usize)>> {
    let mut part = |from: u64, topics: &[usize]| {
        (0..60).map(|i| (topics[numbers.below(topics.len())], from + i, numbers.below(40))).collect()
    };
    // The second begins before the first has ended.
    vec![part(0, &[2, 0]), part(50, &[0, 1, 3]), part(200, &[3, 2])]
}

fn written(folder: &std::path::Path, parts: &[Vec<(usize, u64, usize)>]) -> Vec<PathBuf> {
    let write = |(index, part): (usize, &Vec<(usize, u64, usize)>)| {
        let options = WriterOptions { chunk_bytes: 300, compress: index == 1, ..WriterOptions::default() };
        let path = folder.join(format!("drive_{index}.mcap"));
        let mut writer = LogWriter::create(&path, options).unwrap();
        // Channels are numbered in the order in which their topics appear.
        let mut channels = BTreeMap::new();
        for (sequence, &(topic, time, size)) in part.iter().enumerate() {
            let channel = *channels.entry(topic).or_insert_with(|| {
                writer.add_channel(&format!("/{topic}"), &schema(), &BTreeMap::new()).unwrap()
            });
            let text = format!("\"{sequence} {}\"", "x".repeat(size));
            writer.write(channel, header(sequence, time), text.as_bytes()).unwrap();
        }
        writer.finish().unwrap();
        path
    };
    parts.iter().enumerate().map(write).collect()
}

/// Name of its topic, time and content of each message of a log, in order.
fn told(log: &Log) -> Vec<(String, u64, Vec<u8>)> {
    let name = |id| log.info().topic(id).unwrap().name.clone();
    let messages = read_all(log).into_iter();
    messages.map(|message| (name(message.topic), message.log_time.0, message.data.to_vec())).collect()
}

#[test]
fn parts_are_read_as_one_log_whose_topics_are_joined() {
    let folder = tempfile::tempdir().unwrap();
    let parts = messages(&mut Numbers(7));
    let paths = written(folder.path(), &parts);
    let log = Log::open_parts(&paths).unwrap();
    // The reference: each part by itself, put in order.
    let mut wanted: Vec<_> = paths.iter().flat_map(|path| told(&Log::open(path).unwrap())).collect();
    wanted.sort_by_key(|message| message.1);
    assert_eq!(told(&log), wanted);
    let info = log.info();
    assert_eq!((info.messages, info.topics.len(), info.files.clone()), (180, 4, paths.clone()));
    assert_eq!(info.bytes, paths.iter().map(|path| path.metadata().unwrap().len()).sum::<u64>());
    for topic in &info.topics {
        assert_eq!(topic.messages, wanted.iter().filter(|message| message.0 == topic.name).count() as u64);
    }
    let found = log.verify(&mut |_, _| {}).unwrap();
    assert_eq!((found.messages, &found.problems), (180, &Vec::new()));
    assert_eq!(log.identity().unwrap(), Log::open_parts(&paths).unwrap().identity().unwrap());
    assert_ne!(log.identity().unwrap(), Log::open_parts(&paths[..2]).unwrap().identity().unwrap());
}

#[test]
fn a_damaged_part_costs_only_its_own_messages_and_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let parts = messages(&mut Numbers(8));
    let paths = written(folder.path(), &parts);
    let bytes = std::fs::read(&paths[1]).unwrap();
    std::fs::write(&paths[1], &bytes[..bytes.len() / 4]).unwrap();
    let log = Log::open_parts(&paths).unwrap();
    assert!(log.info().recovered);
    assert!(log.info().problems.iter().any(|problem| problem.starts_with("drive_1.mcap: ")));
    let alone: usize = paths.iter().map(|path| read_all(&Log::open(path).unwrap()).len()).sum();
    assert_eq!(read_all(&log).len(), alone);
    assert!((121..180).contains(&alone), "{alone}");
    assert!(Log::open_parts(&[paths[0].clone(), folder.path().join("absent_1.mcap")]).is_err());
}

#[test]
fn a_part_that_is_no_log_is_named_and_the_others_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let paths = written(folder.path(), &messages(&mut Numbers(9)));
    let alone = told(&Log::open(&paths[2]).unwrap());
    let mut wanted: Vec<_> = paths[..2].iter().flat_map(|path| told(&Log::open(path).unwrap())).collect();
    wanted.sort_by_key(|message| message.1);
    let last = std::fs::read(&paths[2]).unwrap();
    std::fs::write(&paths[2], "").unwrap();
    let log = Log::open_parts(&paths).unwrap();
    assert_eq!(told(&log), wanted);
    assert!(log.info().recovered);
    assert_eq!(log.info().problems, ["drive_2.mcap: expected an mcap log, got nothing"]);
    // Parts before a log.
    std::fs::write(&paths[0], "").unwrap();
    std::fs::write(&paths[1], "text").unwrap();
    std::fs::write(&paths[2], last).unwrap();
    let log = Log::open_parts(&paths).unwrap();
    assert_eq!((told(&log), log.info().lost), (alone, Lost { bytes: 4, messages: 0 }));
    Log::probe_parts(&paths).unwrap();
    let error = Log::open_parts(&paths[..2]).unwrap_err();
    assert!(matches!(error, LogError::NotALog { .. }), "{error}");
    assert_eq!(Log::probe_parts(&paths[..2]).unwrap_err().to_string(), error.to_string());
}
