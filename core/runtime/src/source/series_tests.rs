//! Tests of series.

use super::*;

#[derive(Clone, Copy, Debug, PartialEq)]
struct Number(u64, i64);

impl Record for Number {
    type Summary = (i64, i64);

    fn stamp(&self) -> Stamp {
        Stamp(self.0)
    }

    fn summary(&self) -> (i64, i64) {
        (self.1, self.1)
    }

    fn join(a: (i64, i64), b: (i64, i64)) -> (i64, i64) {
        (a.0.min(b.0), a.1.max(b.1))
    }
}

fn number(i: u64) -> Number {
    Number(i * 10, (i as i64 * 7919) % 1000)
}

fn series(count: u64) -> Series<Number> {
    (0..count).map(number).collect()
}

#[test]
fn a_series_gives_back_its_records_by_index_and_by_time() {
    for count in [0, 1, 7, 8, 9, 64, 65, 4095, 4096, 4097, 10_000] {
        let series = series(count);
        assert_eq!(series.len() as u64, count);
        let mut read = Vec::new();
        series.each(0..usize::MAX, |record| read.push(*record));
        assert!(read.iter().copied().eq((0..count).map(number)), "{count}");
        assert_eq!(series.last(), count.checked_sub(1).map(number));
        assert_eq!(series.count_until(Stamp(0)) as u64, count.min(1));
        assert_eq!(series.count_until(Stamp(45)) as u64, count.min(5));
        assert_eq!(series.count_until(Stamp::MAX) as u64, count);
    }
}

#[test]
fn the_parts_of_a_walk_are_the_range_in_order_and_their_summaries_are_right() {
    for (count, range) in [(1, 0..1), (9, 0..9), (700, 13..699), (10_000, 0..10_000), (10_000, 4090..9000)] {
        let series = series(count);
        // The reference: every record of a part.
        let reference = |part: &Part<Number>| {
            let records = (part.from..part.to).map(|index| series.get(index).unwrap().summary());
            records.reduce(Number::join).unwrap()
        };
        for wide in [0, 50, 900, 2000] {
            let mut next = range.start;
            series.walk(
                range.clone(),
                |part| part.summary.1 - part.summary.0 <= wide,
                |part| {
                    assert_eq!(part.from, next);
                    assert_eq!(part.first, series.get(part.from).unwrap());
                    assert_eq!(part.last, series.get(part.to - 1).unwrap());
                    let (low, high) = reference(&part);
                    assert!(part.summary.0 <= low && part.summary.1 >= high);
                    assert!(part.is_record() || part.summary.1 - part.summary.0 <= wide);
                    let aligned = part.from % FAN == 0 && part.to % FAN == 0;
                    if aligned && part.to - part.from == FAN {
                        assert_eq!(part.summary, (low, high));
                    }
                    next = part.to;
                    ControlFlow::Continue(())
                },
            );
            assert_eq!(next, range.end, "{count} {range:?} {wide}");
        }
    }
}

#[test]
fn stretches_hold_exactly_their_records_whatever_their_lengths() {
    for (count, range) in [(0, 0..0), (1, 0..1), (700, 13..699), (10_000, 0..10_000), (10_000, 4090..9000)] {
        let series = series(count);
        for length in [1, 3, 8, 100, 1000, 20_000] {
            // Stretches of very different lengths: a third of them have one record.
            let key =
                |record: &Number| record.0 / 10 / length + u64::from(!(record.0 / 10).is_multiple_of(length));
            let mut next = range.start;
            series.stretches(
                range.clone(),
                key,
                |sum: &mut Vec<(i64, i64)>, record| sum.push(record.summary()),
                |sum, summary| sum.push(*summary),
                |stretch| {
                    let records: Vec<Number> =
                        (next..next + stretch.count).map(|index| series.get(index).unwrap()).collect();
                    assert!(records.iter().all(|record| key(record) == stretch.key));
                    assert_eq!(records.first(), Some(&stretch.first));
                    assert_eq!(records.last(), Some(&stretch.last));
                    let wanted = records.iter().map(Record::summary).reduce(Number::join);
                    assert_eq!(stretch.sum.iter().copied().reduce(Number::join), wanted);
                    assert!(stretch.sum.len() <= 70, "{} pieces", stretch.sum.len());
                    next += stretch.count;
                    assert!(next >= range.end || key(&series.get(next).unwrap()) != stretch.key);
                },
            );
            assert_eq!(next, range.end, "{count} {range:?} {length}");
        }
    }
}

#[test]
fn pieces_are_the_range_in_order_and_as_large_as_wanted() {
    for (count, range) in [(0, 0..0), (1, 0..1), (700, 13..699), (10_000, 0..10_000), (10_000, 4090..9000)] {
        let series = series(count);
        for wide in [0, 50, 900, 2000] {
            let mut next = range.start;
            series.pieces(
                range.clone(),
                |summary| summary.1 - summary.0 <= wide,
                |piece| match piece {
                    Piece::Record(record) => {
                        assert_eq!(*record, number(next as u64));
                        next += 1;
                    }
                    Piece::Summary(summary, size) => {
                        let records = (next..next + size).map(|index| number(index as u64).summary());
                        assert_eq!(Some(*summary), records.reduce(Number::join));
                        assert!(summary.1 - summary.0 <= wide && next % size == 0);
                        next += size;
                    }
                },
            );
            assert_eq!(next, range.end, "{count} {range:?} {wide}");
        }
    }
}

#[test]
fn parts_are_no_more_than_wanted_however_long_the_series_is() {
    for count in [10, 1000, 100_000] {
        let series = series(count);
        for most in [8, 100, 5000] {
            let parts = series.parts(0..usize::MAX, most, |_| false);
            assert!(parts.len() <= most, "{} of {count}", parts.len());
            assert!(parts.len() * FAN >= most.min(count as usize), "{} of {count}", parts.len());
            assert!(parts.windows(2).all(|pair| pair[0].to == pair[1].from));
            assert_eq!(parts.last().unwrap().to as u64, count);
        }
    }
}

#[test]
fn a_reader_sees_what_was_there_when_it_began_and_a_fork_what_both_share() {
    let writer = SeriesWriter::default();
    (0..5000).map(number).for_each(|record| writer.push(record));
    let before = writer.read();
    let fork = writer.fork(Stamp(number(4200).0));
    (4201..9000).for_each(|i| fork.push(Number(i * 10, -1_000_000)));
    (5000..6000).map(number).for_each(|record| writer.push(record));
    writer.push(Number(3, 0));
    assert_eq!((before.len(), writer.read().len(), fork.read().len()), (5000, 6000, 9000));
    let fork = fork.read();
    assert_eq!((fork.get(4200), fork.get(4201).unwrap().1), (Some(number(4200)), -1_000_000));
    assert_eq!(writer.read().get(4201), Some(number(4201)), "the other run is whole");
    let mut least = 0;
    writer.read().walk(
        0..usize::MAX,
        |_| true,
        |part| {
            least = least.min(part.summary.0);
            ControlFlow::Continue(())
        },
    );
    assert_eq!(least, 0, "and so are its summaries");
    assert!(before.same(&writer.read()) && !before.same(&fork));
}
