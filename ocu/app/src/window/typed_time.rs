//! Times as they are typed or pasted into the palette.

use crate::time::days_since_1970;
use ocu_ui::format;
use rcs_msg::Stamp;
use rcs_runtime::source::SourceInfo;
use std::iter;

const SECOND_NS: u64 = 1_000_000_000;
const MINUTE_NS: u64 = 60 * SECOND_NS;
const DAY_NS: u64 = 86_400 * SECOND_NS;
/// Number of digits of a time in nanoseconds since 1970, from 2001 on.
const DIGITS_OF_NS: usize = 19;

/// The moments of a source until `end` that a text may mean, the likeliest first; none if the time is outside of the
/// source, or in a gap. `None` for a text that is no time.
///
/// A time is a number of seconds, `mm:ss` or `hh:mm:ss` since the start, a time of day (UTC), a date with a time (UTC), or
/// a number of seconds or nanoseconds since 1970.
pub(super) fn moments(text: &str, info: &SourceInfo, end: Stamp) -> Option<Vec<Stamp>> {
    let text = text.trim();
    let start = info.start;
    // What was copied from a clock lacks what is shorter than its last digit, so it may lie just before the start.
    let inside = |at: Stamp| {
        let in_gap = info.gaps.iter().any(|gap| gap.from < at && at < gap.to);
        (at.after_ns(SECOND_NS) > start && at <= end && !in_gap).then(|| at.max(start))
    };
    let mut found: Vec<Stamp> = if let Some(at) = date_and_time(text) {
        inside(at).into_iter().collect()
    } else if let Some((ns, has_hours)) = clock(text) {
        let of_day = if has_hours { times_of_day(ns, info, end) } else { Vec::new() };
        iter::once(start.after_ns(ns)).chain(of_day).filter_map(inside).collect()
    } else {
        let number = text.strip_suffix('s').unwrap_or(text).trim_end();
        if let Some(ns) = whole(number).filter(|_| number.len() == DIGITS_OF_NS) {
            inside(Stamp(ns)).into_iter().collect()
        } else {
            let ns = seconds(number)?;
            [start.after_ns(ns), Stamp(ns)].into_iter().find_map(inside).into_iter().collect()
        }
    };
    found.dedup();
    Some(found)
}

/// Time since the start, without hours where there are none: `03:15.500`.
pub(super) fn since_start(at: Stamp, info: &SourceInfo) -> String {
    let text = format::elapsed(at.seconds_since(info.start));
    text.strip_prefix("00:").map_or_else(|| text.clone(), str::to_owned)
}

/// The moments with this time of day, UTC: the first one of each part of the source between its gaps.
fn times_of_day(ns: u64, info: &SourceInfo, end: Stamp) -> Vec<Stamp> {
    let begins = iter::once(info.start).chain(info.gaps.iter().map(|gap| gap.to));
    let ends = info.gaps.iter().map(|gap| gap.from).chain(iter::once(end));
    let parts = begins.zip(ends).filter_map(|(from, to)| {
        let midnight = Stamp(from.0 - from.0 % DAY_NS);
        let today = midnight.after_ns(ns);
        let at = if today.after_ns(SECOND_NS) > from { today.max(from) } else { today.after_ns(DAY_NS) };
        (ns < DAY_NS && at <= to).then_some(at)
    });
    parts.collect()
}

/// `2022-11-20T19:14:20.5Z`; also with a space, and without `Z` or with `UTC`.
fn date_and_time(text: &str) -> Option<Stamp> {
    let (date, time) = text.split_once(['T', 't', ' '])?;
    let time = time.trim();
    let zone = ["Z", "z", "UTC", "+00:00"].into_iter().find_map(|zone| time.strip_suffix(zone));
    let (ns, has_hours) = clock(zone.unwrap_or(time).trim_end())?;
    let mut numbers = date.split('-').map(whole);
    let (year, month, day) = (numbers.next()??, numbers.next()??, numbers.next()??);
    if numbers.next().is_some() || !has_hours || ns >= DAY_NS {
        return None;
    }
    days_since_1970(year, month, day)?.checked_mul(DAY_NS)?.checked_add(ns).map(Stamp)
}

/// `mm:ss` or `hh:mm:ss`, with decimals, in nanoseconds; and whether there are hours.
fn clock(text: &str) -> Option<(u64, bool)> {
    let (before, seconds_text) = text.rsplit_once(':')?;
    let ns = seconds(seconds_text).filter(|ns| *ns < MINUTE_NS)?;
    let (minutes, has_hours) = match before.split_once(':') {
        Some((hours, minutes)) => {
            let minutes = whole(minutes).filter(|minutes| *minutes < 60)?;
            (whole(hours)?.checked_mul(60)?.checked_add(minutes)?, true)
        }
        None => (whole(before)?, false),
    };
    Some((minutes.checked_mul(MINUTE_NS)?.checked_add(ns)?, has_hours))
}

/// A number of seconds, with decimals, in nanoseconds.
fn seconds(text: &str) -> Option<u64> {
    let (before, decimals) = text.split_once('.').unwrap_or((text, "0"));
    whole(decimals.get(..9).unwrap_or(decimals))?;
    let nanos = format!("{:0<9}", decimals.get(..9).unwrap_or(decimals));
    whole(before)?.checked_mul(SECOND_NS)?.checked_add(whole(&nanos)?)
}

/// A number of digits alone.
fn whole(text: &str) -> Option<u64> {
    text.bytes().all(|byte| byte.is_ascii_digit()).then(|| text.parse().ok()).flatten()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcs_log::Gap;

    /// 2022-11-20 19:11:05.025 UTC.
    const START: Stamp = Stamp(1_668_971_465_025_000_000);

    /// What a text means in a recording of 391.25 s, in milliseconds since its start.
    fn meant_ms(text: &str) -> Option<Vec<u64>> {
        let info = SourceInfo { start: START, ..SourceInfo::default() };
        let found = moments(text, &info, START.after_ns(391_250_000_000))?;
        Some(found.into_iter().map(|at| (at.0 - START.0) / 1_000_000).collect())
    }

    #[test]
    fn a_time_is_typed_in_seconds_as_a_clock_or_as_utc() {
        for (text, ms) in [
            ("195.5", 195_500),
            (" 195.5 s ", 195_500),
            ("0", 0),
            ("03:15.5", 195_500),
            ("3:15", 195_000),
            ("00:03:15.500", 195_500),
            ("19:14:20.525", 195_500),
            ("2022-11-20T19:14:20.525Z", 195_500),
            ("2022-11-20T19:14:20.525+00:00", 195_500),
            ("2022-11-20 19:14:20.525", 195_500),
            ("2022-11-20 19:14:20.525 UTC", 195_500),
            ("1668971660525000000", 195_500),
            ("1668971660.525", 195_500),
            // The start, as a clock shows it.
            ("2022-11-20 19:11:05", 0),
            ("19:11:05", 0),
        ] {
            assert_eq!(meant_ms(text), Some(vec![ms]), "{text:?}");
        }
    }

    #[test]
    fn a_time_outside_of_the_recording_is_told_from_a_text_that_is_none() {
        for text in ["391.5", "06:32", "18:00:00", "2022-11-21T19:14:20Z", "1668971460000000000"] {
            assert_eq!(meant_ms(text), Some(Vec::new()), "{text:?}");
        }
        for text in ["", "s", ".", "1.", "-5", "+5", "1e3", "1,5", "3:60", "1:60:00", "1:2:3:4", "map"] {
            assert_eq!(meant_ms(text), None, "{text:?}");
        }
        for text in ["2022-11-20", "2022-02-30T00:00:00Z", "2022-11-20T24:00:00Z", "ü:ü", "0.ü"] {
            assert_eq!(meant_ms(text), None, "{text:?}");
        }
    }

    #[test]
    fn a_time_of_day_is_found_after_a_gap_and_after_midnight() {
        let second = |s: u64| Stamp(s * SECOND_NS);
        // Until 23:00:10 of the first day, then from 23:59:50 of the tenth day until 20 s after.
        let day = DAY_NS / SECOND_NS;
        let gap = Gap { from: second(day - 3590), to: second(10 * day - 10) };
        let info = SourceInfo { start: second(day - 3600), gaps: vec![gap], ..SourceInfo::default() };
        let found = |text: &str| moments(text, &info, second(10 * day + 10)).unwrap();
        assert_eq!(found("23:00:05"), [second(day - 3595)]);
        assert_eq!(found("23:59:55"), [second(10 * day - 5)]);
        // Five seconds since the start, and five seconds after midnight.
        assert_eq!(found("00:00:05"), [second(day - 3595), second(10 * day + 5)]);
    }

    #[test]
    fn what_is_shown_has_no_hours_where_there_are_none() {
        let info = SourceInfo { start: START, ..SourceInfo::default() };
        assert_eq!(since_start(START.after_ns(195_500_000_000), &info), "03:15.500");
        assert_eq!(since_start(START.after_ns(3_795_500_000_000), &info), "01:03:15.500");
    }
}
