//! Order, resuming, stepping and lookup, compared with simple reference implementations on unsorted logs.

use crate::common::{log_of, read_all};
use proptest::prelude::*;
use rcs_log::{CursorOptions, Log, MessagePosition, Position, TimesOf, TopicId, WriterOptions};
use rcs_msg::Stamp;
use std::collections::BTreeMap;
use std::io::Cursor;
use std::sync::Arc;
use std::time::Duration;

/// Messages of up to four topics, with ties, out of order, over small chunks that overlap in time.
fn messages() -> impl Strategy<Value = Vec<(usize, u64, usize)>> {
    proptest::collection::vec((0..4usize, 0..40u64, 0..60usize), 1..80)
}

fn small_chunks(compress: bool) -> WriterOptions {
    WriterOptions { chunk_bytes: 200, compress, ..WriterOptions::default() }
}

/// Sequence numbers, which are positions in the file, by log time with ties in file order.
fn reference_order(messages: &[(usize, u64, usize)]) -> Vec<u32> {
    let mut order: Vec<usize> = (0..messages.len()).collect();
    order.sort_by_key(|&index| messages[index].1);
    order.into_iter().map(|index| index as u32).collect()
}

fn topic_ids(log: &Log, topics: &[usize]) -> Vec<TopicId> {
    topics
        .iter()
        .flat_map(|topic| log.info().topics_named(&format!("/{topic}")).map(|t| t.id).collect::<Vec<_>>())
        .collect()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn messages_come_by_log_time_and_ties_in_file_order(messages in messages(), compress: bool, by_scan: bool) {
        let bytes = log_of(&messages, small_chunks(compress));
        let log = if by_scan { Log::from_bytes_by_scan(bytes) } else { Log::from_bytes(bytes) }.unwrap();
        let order: Vec<u32> = read_all(&log).iter().map(|message| message.sequence).collect();
        prop_assert_eq!(order, reference_order(&messages));
    }

    #[test]
    fn times_that_are_looked_up_together_are_those_of_each_alone(
        messages in messages(),
        sets in proptest::collection::vec((0..4usize, 0..40u64, 0..45u64), 1..6),
    ) {
        let log = Log::from_bytes(log_of(&messages, small_chunks(true))).unwrap();
        let topics: Vec<Vec<TopicId>> = sets.iter().map(|set| topic_ids(&log, &[set.0])).collect();
        let of = |(&(_, since, before), topics)| TimesOf { topics, since: Stamp(since), before: Stamp(before) };
        let wanted: Vec<TimesOf<'_>> = sets.iter().zip(topics.iter().map(Vec::as_slice)).map(of).collect();
        let (since, times) = (log.times_known_since(&wanted), log.times_before(&wanted).unwrap());
        for (index, &(topic, _, before)) in sets.iter().enumerate() {
            prop_assert_eq!(log.times_known_since(&wanted[index..=index])[0], since[index]);
            let is_meant = |message: &&(usize, u64, usize)| {
                message.0 == topic && (since[index].0..before).contains(&message.1)
            };
            let mut expected: Vec<Stamp> = messages.iter().filter(is_meant).map(|m| Stamp(m.1)).collect();
            expected.sort_unstable_by(|a, b| b.cmp(a));
            prop_assert_eq!(&times[index], &expected);
        }
    }

    #[test]
    fn a_cursor_resumes_from_any_position_with_exactly_the_rest(messages in messages(), start in 0..40u64, end in 0..40u64) {
        let log = Log::from_bytes(log_of(&messages, small_chunks(true))).unwrap();
        let topics = Some(topic_ids(&log, &[0, 2]));
        let mut cursor = log.cursor(CursorOptions { topics, start: Stamp(start), end: Stamp(end) });
        let expected: Vec<u32> = reference_order(&messages)
            .into_iter()
            .filter(|&index| {
                let (topic, time, _) = messages[index as usize];
                (topic == 0 || topic == 2) && (start..=end).contains(&time)
            })
            .collect();
        for given in 0..=expected.len() {
            let text = serde_json::to_string(&cursor.position()).unwrap();
            let position: Position = serde_json::from_str(&text).unwrap();
            for rest in [log.cursor_at(position.clone()), log.cursor_at(position).reading_ahead()] {
                let rest: Vec<u32> = rest.map(|message| message.unwrap().sequence).collect();
                prop_assert_eq!(&rest, &expected[given..]);
            }
            prop_assert_eq!(cursor.next().map(|message| message.unwrap().sequence), expected.get(given).copied());
        }
    }

    #[test]
    fn pieces_hold_the_messages_of_a_cursor_each_in_order(messages in messages(), start in 0..40u64, end in 0..40u64) {
        let log = Log::from_bytes(log_of(&messages, small_chunks(true))).unwrap();
        let topics = Some(topic_ids(&log, &[0, 2]));
        let options = CursorOptions { topics, start: Stamp(start), end: Stamp(end) };
        let mut read = Vec::new();
        for piece in log.pieces(&options) {
            let from = read.len();
            log.read_piece(&piece, &options, |message| {
                read.push((message.place, message.topic, message.log_time, message.data.to_vec()));
            })
            .unwrap();
            let of_piece = &read[from..];
            prop_assert!(of_piece.iter().all(|message| (piece.first..=piece.last).contains(&message.2)));
            prop_assert!(of_piece.windows(2).all(|pair| pair[0].0 < pair[1].0));
        }
        read.sort_by_key(|message| message.0);
        let mut times = Vec::new();
        for piece in log.pieces(&options) {
            prop_assert!(log.read_times(&piece, &options, |topic, place| times.push((place, topic))).unwrap());
        }
        times.sort_unstable();
        prop_assert!(times.into_iter().eq(read.iter().map(|message| (message.0, message.1))));
        let wanted: Vec<_> = log
            .cursor(options)
            .map(Result::unwrap)
            .map(|message| (message.place, message.topic, message.log_time, message.data.to_vec()))
            .collect();
        prop_assert_eq!(read, wanted);
    }

    #[test]
    fn stepping_back_retraces_stepping_forward(messages in messages(), one_topic: bool) {
        let log = Log::from_bytes(log_of(&messages, small_chunks(true))).unwrap();
        let topics = one_topic.then(|| topic_ids(&log, &[1]));
        let topics = topics.as_deref();
        let mut forward = Vec::new();
        let mut place = MessagePosition::before(Stamp(0));
        while let Some(message) = log.next_message(place, topics).unwrap() {
            place = message.place;
            forward.push(message);
        }
        let options = CursorOptions { topics: topics.map(<[_]>::to_vec), ..CursorOptions::default() };
        let read: Vec<_> = log.cursor(options).map(Result::unwrap).collect();
        prop_assert_eq!(&forward, &read);
        let mut backward = Vec::new();
        let mut place = MessagePosition::after(Stamp::MAX);
        while let Some(message) = log.previous_message(place, topics).unwrap() {
            place = message.place;
            backward.push(message);
        }
        backward.reverse();
        prop_assert_eq!(backward, forward);
    }

    #[test]
    fn latest_at_gives_the_last_message_of_each_topic(messages in messages(), at in 0..45u64, by_scan: bool) {
        let bytes = log_of(&messages, small_chunks(true));
        let log = if by_scan { Log::from_bytes_by_scan(bytes) } else { Log::from_bytes(bytes) }.unwrap();
        let order = reference_order(&messages);
        let expected: Vec<Option<u32>> = log
            .info()
            .topics
            .iter()
            .map(|topic| {
                let of_topic = |&&index: &&u32| {
                    let (number, time, _) = messages[index as usize];
                    topic.name == format!("/{number}") && time <= at
                };
                order.iter().rfind(of_topic).copied()
            })
            .collect();
        let found = log.latest_at(Stamp(at), None).unwrap();
        let found: Vec<Option<u32>> = found.into_iter().map(|message| message.map(|m| m.sequence)).collect();
        prop_assert_eq!(found, expected);
    }
}

#[test]
fn latest_at_keeps_the_order_of_the_topics_asked_for() {
    let log = Log::from_bytes(log_of(&[(0, 1, 1), (1, 2, 1), (2, 3, 1)], WriterOptions::default())).unwrap();
    let mut topics = topic_ids(&log, &[2, 0]);
    topics.push(topics[0]);
    topics.push(TopicId(999));
    let found = log.latest_at(Stamp(5), Some(&topics)).unwrap();
    let found: Vec<Option<u32>> = found.into_iter().map(|message| message.map(|m| m.sequence)).collect();
    assert_eq!(found, [Some(2), Some(0), Some(2), None]);
}

#[test]
fn times_are_read_by_the_indexes_of_all_channels_or_of_none() {
    // The second index is too large to be read, and the third lies behind it.
    let frequent = (1..70_001).map(|time| (1, time, 0));
    let messages: Vec<(usize, u64, usize)> =
        [(0, 0, 0)].into_iter().chain(frequent).chain([(2, 70_001, 0)]).collect();
    let clock: rcs_log::Clock = Arc::new(|| Duration::ZERO);
    let bytes = log_of(&messages, WriterOptions { chunk_bytes: 64 << 20, clock, ..WriterOptions::default() });
    let log = Log::from_bytes(bytes).unwrap();
    let options = CursorOptions::default();
    let pieces = log.pieces(&options);
    assert_eq!(pieces.len(), 1);
    let mut told = 0;
    assert!(!log.read_times(&pieces[0], &options, |_, _| told += 1).unwrap());
    assert_eq!(told, 0);
}

#[test]
fn without_message_indexes_a_rare_topic_is_searched_for_once() {
    let options = mcap::WriteOptions::new().compression(None).chunk_size(Some(200));
    let mut writer = options.emit_message_indexes(false).create(Cursor::new(Vec::<u8>::new())).unwrap();
    for time in 0..40 {
        let topic = if time == 0 { "/0" } else { "/1" };
        let channel_id = writer.add_channel(0, topic, "json", &BTreeMap::new()).unwrap();
        let (sequence, log_time, publish_time) = (0, time, time);
        let header = mcap::records::MessageHeader { channel_id, sequence, log_time, publish_time };
        writer.write_to_known_channel(&header, &[b' '; 100]).unwrap();
    }
    writer.finish().unwrap();
    let log = Log::from_bytes(writer.into_inner().into_inner().into()).unwrap();
    let rare = topic_ids(&log, &[0]);
    // The pieces in which it would be searched for.
    let options = CursorOptions { topics: Some(rare.clone()), ..CursorOptions::default() };
    let candidates = || log.pieces(&options).len();
    assert_eq!(candidates() as u64, log.info().segments);
    assert!(!log.info().recovered && log.info().segments > 5);
    for _ in 0..2 {
        let found = log.latest_at(Stamp(100), Some(&rare)).unwrap();
        assert_eq!(found[0].as_ref().unwrap().log_time, Stamp(0));
        assert_eq!(candidates(), 1);
    }
}

#[test]
fn the_times_before_a_moment_are_read_from_a_few_chunks_that_have_the_topic() {
    let rare = (0..10).map(|i| (0, i * 100, 10));
    let messages: Vec<(usize, u64, usize)> = rare.chain((0..1000).map(|i| (1, 1000 + i, 150))).collect();
    let log = Log::from_bytes(log_of(&messages, small_chunks(false))).unwrap();
    let topics = topic_ids(&log, &[0, 1]);
    let [rare, often] = [&topics[..1], &topics[1..]];
    let of = |topics, since, before| TimesOf { topics, since: Stamp(since), before: Stamp(before) };
    let wanted = [of(rare, 0, 5000), of(rare, 300, 500), of(often, 0, 5000)];
    let since = log.times_known_since(&wanted);
    assert_eq!(since[..2], [Stamp(0), Stamp(300)]);
    assert!(since[2] > Stamp(1800), "not all of its chunks are read: {}", since[2]);
    let times = log.times_before(&wanted).unwrap();
    let expected: Vec<Stamp> = (0..10).rev().map(|i| Stamp(i * 100)).collect();
    assert_eq!(times[0], expected);
    assert_eq!(times[1], [Stamp(400), Stamp(300)]);
    let expected: Vec<Stamp> = (since[2].0..2000).rev().map(Stamp).collect();
    assert_eq!(times[2], expected);
}

#[test]
fn the_rate_of_a_topic_is_that_of_the_time_without_gaps() {
    let set = 1_700_000_000_000_000_000;
    let messages = (0..101).map(|i| (1, set + i * 100_000_000, 10));
    let messages: Vec<(usize, u64, usize)> = std::iter::once((0, 0, 10)).chain(messages).collect();
    let log = Log::from_bytes(log_of(&messages, WriterOptions::default())).unwrap();
    let hz = log.info().topics_named("/1").next().unwrap().hz;
    assert!((hz - 10.0).abs() < 1e-6, "{hz}");
    assert_eq!(log.info().topics_named("/0").next().unwrap().hz, 0.0);
}

#[test]
fn the_rate_of_a_topic_is_that_from_its_first_to_its_last_message_whatever_the_chunks() {
    // The second topic is sent in the middle of the log, at uneven times.
    let uneven = [4000, 4100, 4200, 4300, 4600, 4895];
    let mut messages: Vec<(usize, u64, usize)> = (0..100).map(|i| (0, i * 100, 150)).collect();
    messages.extend(uneven.map(|ms| (1, ms, 150)));
    messages.sort_by_key(|message| message.1);
    for message in &mut messages {
        message.1 *= 1_000_000;
    }
    for options in [WriterOptions::default(), small_chunks(false)] {
        let bytes = log_of(&messages, options);
        for log in [Log::from_bytes(bytes.clone()), Log::from_bytes_by_scan(bytes)] {
            let log = log.unwrap();
            let info = log.info();
            let topics = topic_ids(&log, &[0, 1]);
            for (topic, expected) in topics.iter().zip([10.0, 5.0 / 0.895]) {
                let hz = info.topic(*topic).unwrap().hz;
                assert!((hz - expected).abs() < 1e-9, "{hz}, expected {expected}");
            }
            let both = info.mean_hz(&topics).unwrap();
            assert!((both - 105.0 / 9.9).abs() < 1e-9, "{both}");
            let density = info.density_hz(&topics[1..]).unwrap();
            assert!((density - 6.0 / 9.9).abs() < 1e-9, "{density}");
        }
    }
}
