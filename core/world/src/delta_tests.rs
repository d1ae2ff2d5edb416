use proptest::prelude::*;

use super::*;
use crate::delta_drive::Drive;
use crate::{SIDE, VoteRule};

/// The content of a channel and its delta channel: sequence, log time, and the bytes of one of the two.
struct Entry {
    sequence: u32,
    stored: Stored,
    whole: MapMessage,
}

fn recorded(seed: u64, count: usize) -> Vec<Entry> {
    let (mut drive, mut encoder) = (Drive::new(seed), MAP_CODEC.encoder());
    let entries = (0..count).map(|_| {
        let whole = drive.next();
        let stored = encoder.encode(drive.sequence, whole.time(), &whole.clone().into_message());
        Entry { sequence: drive.sequence, stored, whole }
    });
    entries.collect()
}

/// The message as a reader of a log gets a key frame: bytes.
fn key_frame(message: &MapMessage) -> AnyMessage {
    AnyMessage::encoded(Arc::clone(schema_of::<Grid>()), message.clone().into_message().bytes())
}

proptest! {
    #[test]
    fn rounded_statistics_are_near_and_come_back_from_their_integers(
        heights in prop::collection::vec(prop_oneof![-30.0..30.0_f32, -1e-3..1e-3_f32, -1e5..1e5_f32, any::<f32>()], 1..20)
    ) {
        let mut stats = HeightStats::default();
        for height in heights {
            stats.add(height);
        }
        let rounded = stats.rounded();
        prop_assert_eq!(rounded.rounded(), rounded);
        for (exact, rounded) in [(stats.mean, rounded.mean), (stats.min, rounded.min), (stats.max, rounded.max)] {
            prop_assert!((exact - rounded).abs() <= 0.5 / HEIGHTS_PER_M, "{} {}", exact, rounded);
        }
        prop_assert!(rounded.variance <= stats.variance && rounded.variance >= stats.variance * (255.0 / 256.0) - f32::MIN_POSITIVE);
        let mut back = HeightStats::default();
        (0..HEIGHT_PARTS.len()).for_each(|part| set_height(&mut back, part, height(&stats, part)));
        // A message has the bits of the numbers, so a zero must have the same sign.
        let bits = |s: HeightStats| [s.mean, s.variance, s.min, s.max].map(f32::to_bits);
        prop_assert_eq!((back.count, bits(back)), (rounded.count, bits(rounded)));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(6))]
    #[test]
    fn every_map_of_a_drive_comes_back_from_key_frames_and_deltas(seed: u64) {
        let mut decoder = MAP_CODEC.decoder();
        let entries = recorded(seed, 60);
        prop_assert!(entries.iter().filter(|entry| entry.stored == Stored::Whole).count() < 10);
        for entry in entries {
            match &entry.stored {
                Stored::Whole => decoder.take_whole(entry.sequence, &key_frame(&entry.whole)),
                Stored::Delta(delta) => {
                    decoder.take_delta(entry.sequence, delta).unwrap();
                    let message = decoder.message().unwrap();
                    prop_assert!(message.source::<MapMessage>().is_some());
                    prop_assert_eq!(message.bytes(), entry.whole.into_message().bytes());
                }
            }
        }
    }

    #[test]
    fn where_messages_are_missing_no_map_is_made_until_the_next_key_frame(seed: u64, lost in prop::collection::vec(any::<bool>(), 60)) {
        let mut decoder = MAP_CODEC.decoder();
        let mut in_step = false;
        for (entry, lost) in recorded(seed, 60).into_iter().zip(lost) {
            match &entry.stored {
                _ if lost && entry.sequence % 3 == 0 => in_step = false,
                Stored::Whole => {
                    decoder.take_whole(entry.sequence, &key_frame(&entry.whole));
                    in_step = true;
                }
                Stored::Delta(delta) => match decoder.take_delta(entry.sequence, delta) {
                    Ok(()) => {
                        prop_assert!(in_step);
                        let message = decoder.message().unwrap();
                        prop_assert_eq!(message.bytes(), entry.whole.into_message().bytes());
                    }
                    Err(_) => prop_assert!(!in_step),
                },
            }
        }
    }

    #[test]
    fn damaged_deltas_are_refused_or_the_same(seed: u64, at: prop::sample::Index, value: u8) {
        let entries = recorded(seed, 4);
        let mut decoder = MAP_CODEC.decoder();
        decoder.take_whole(entries[0].sequence, &key_frame(&entries[0].whole));
        if let Stored::Delta(delta) = &entries[1].stored {
            let mut damaged = delta.to_vec();
            let at = at.index(damaged.len());
            damaged[at] = value;
            // A changed number cannot be detected here, as in any message (chunks have checksums), but nothing panics.
            let _ = decoder.take_delta(entries[1].sequence, &damaged);
            let _ = decoder.take_delta(entries[1].sequence, &damaged[..at]);
        }
    }
}

#[test]
fn deltas_follow_a_whole_map_that_was_stored_in_place_of_their_base() {
    let entries = recorded(17, 60);
    let is_delta = |entry: &Entry| entry.stored != Stored::Whole;
    let first = entries.windows(2).position(|pair| pair.iter().all(is_delta)).unwrap();
    let mut decoder = MAP_CODEC.decoder();
    decoder.take_whole(entries[first].sequence, &key_frame(&entries[first].whole));
    for entry in &entries[first + 1..] {
        match &entry.stored {
            Stored::Whole => decoder.take_whole(entry.sequence, &key_frame(&entry.whole)),
            Stored::Delta(delta) => {
                decoder.take_delta(entry.sequence, delta).unwrap();
                let message = decoder.message().unwrap();
                assert_eq!(message.bytes(), entry.whole.clone().into_message().bytes());
            }
        }
    }
    // A whole map with another sequence number is not the base.
    decoder.take_whole(entries[first + 1].sequence, &key_frame(&entries[first].whole));
    let Stored::Delta(delta) = &entries[first + 1].stored else { panic!("expected a delta") };
    assert!(decoder.take_delta(entries[first + 1].sequence, delta).is_err());
}

#[test]
fn a_delta_holds_only_what_changed() {
    let mut drive = Drive::new(3);
    let first = drive.next();
    let mut encoder = MAP_CODEC.encoder();
    assert_eq!(encoder.encode(1, first.time(), &first.clone().into_message()), Stored::Whole);
    let mut map = first.map().clone();
    let cell = map.grid().centre();
    let rule = VoteRule::default();
    assert!(map.vote(cell, Source::STEREO, 250, 7, first.time(), rule));
    let second = MapMessage::new(map, "local", first.time(), first.options().clone());
    let Stored::Delta(bytes) = encoder.encode(2, first.time().after_ns(1), &second.into_message()) else {
        panic!("expected a delta");
    };
    let delta = AnyMessage::decode::<MapDelta>(bytes.clone()).unwrap().to::<MapDelta>().unwrap();
    assert_eq!((delta.tiles.len(), delta.cells[0].count_ones()), (1, 1));
    // Most of them are names of columns and sources.
    assert!(bytes.len() < 320, "{}", bytes.len());
}

#[test]
fn key_frames_come_every_ten_seconds_and_after_what_was_lost_or_does_not_follow() {
    let mut drive = Drive::new(5);
    let first = drive.next();
    let mut encoder = MAP_CODEC.encoder();
    let mut is_whole = |message: &MapMessage, time: u64| {
        encoder.encode(1, Stamp(time), &message.clone().into_message()) == Stored::Whole
    };
    assert!(is_whole(&first, 0));
    assert!(!is_whole(&first, KEY_FRAME_NS - 1));
    assert!(is_whole(&first, KEY_FRAME_NS));
    let plain = first.clone().with_options(MapOptions { heights: false, ..first.options().clone() });
    assert!(is_whole(&plain, KEY_FRAME_NS + 1));
    let other = MapMessage::new(Map::new(0.6).unwrap(), "local", plain.time(), plain.options().clone());
    assert!(is_whole(&other, KEY_FRAME_NS + 2));
    assert!(!is_whole(&other, KEY_FRAME_NS + 3));
    encoder.lost();
    let mut is_whole = |message: &AnyMessage| encoder.encode(9, Stamp(1), message) == Stored::Whole;
    assert!(is_whole(&other.clone().into_message()));
    // A grid that an operator edited is not one of our maps, and no delta applies to it.
    assert!(is_whole(&key_frame(&first)));
    assert!(is_whole(&other.into_message()));
}

#[test]
fn reading_by_field_is_the_same_from_the_map_and_from_its_message() {
    let mut drive = Drive::new(11);
    (0..5).for_each(|_| drop(drive.next()));
    let message = drive.next();
    let grid = Grid::from(message.clone());
    let (typed, bytes) = (crate::GridView::of_map(&message), crate::GridView::new(&grid).unwrap());
    assert_eq!(typed.names().collect::<Vec<_>>(), bytes.names().collect::<Vec<_>>());
    assert_eq!(typed.frame_from_grid(), bytes.frame_from_grid());
    assert_eq!((typed.columns(), typed.rows(), typed.frame_id()), (SIDE, SIDE, "local"));
    for name in bytes.names() {
        let numbers = |view: &crate::GridView<'_>| {
            let field = view.field(name).unwrap();
            assert_eq!(
                field.get(100, 100).map(f64::to_bits),
                field.values().nth(100 * SIDE + 100).map(f64::to_bits)
            );
            let mut bytes = Vec::new();
            field.bytes_into(&mut bytes);
            let is_byte = field.kind() == crate::NumericType::Uint8;
            let plainly = field.values().filter(|_| is_byte).map(|value| value as u8);
            assert!(plainly.eq(bytes.iter().copied()), "{name}");
            (field.kind(), field.values().map(f64::to_bits).collect::<Vec<_>>())
        };
        assert!(numbers(&typed) == numbers(&bytes), "{name}");
    }
    let fused = |view: &crate::GridView<'_>| {
        let mut costs = Vec::new();
        crate::fuse_grid(view, &Weights::default().with(Source::STEREO, 0.3), &mut costs).unwrap();
        costs
    };
    assert_eq!(fused(&typed), fused(&bytes));
}
