//! Formats absolute times, and converts dates.

use rcs_msg::Stamp;

/// A year in nanoseconds: earlier times belong to a clock that starts at 0, such as that of a simulation.
const YEAR_NS: u64 = 365 * 86_400 * 1_000_000_000;

/// `2026-01-01 00:00:12.345 UTC`; simulated times as `00:00:12.345`.
pub(crate) fn date_and_time(stamp: Stamp) -> String {
    let clock = ocu_ui::format::clock(stamp.0);
    if stamp.0 < YEAR_NS {
        return clock;
    }
    let (year, month, day) = civil(stamp.0 / 86_400_000_000_000);
    format!("{year:04}-{month:02}-{day:02} {clock} UTC")
}

/// `20260101-000012`, for names of files.
pub(crate) fn file_name_of(stamp: Stamp) -> String {
    let (year, month, day) = civil(stamp.0 / 86_400_000_000_000);
    let clock: String = ocu_ui::format::clock(stamp.0).chars().filter(char::is_ascii_digit).take(6).collect();
    format!("{year:04}{month:02}{day:02}-{clock}")
}

/// Year, month and day of a number of days since 1970-01-01 (Howard Hinnant's `civil_from_days`, for non-negative
/// days).
fn civil(days: u64) -> (u64, u64, u64) {
    let days = days + 719_468;
    let era = days / 146_097;
    let day_of_era = days % 146_097;
    let year_of_era = (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month_from_march = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month_from_march + 2) / 5 + 1;
    let month = if month_from_march < 10 { month_from_march + 3 } else { month_from_march - 9 };
    (era * 400 + year_of_era + u64::from(month <= 2), month, day)
}

/// Number of days from 1970-01-01 to a date of the calendar; `None` for a date that is none, or earlier (Howard Hinnant's
/// `days_from_civil`).
pub(crate) fn days_since_1970(year: u64, month: u64, day: u64) -> Option<u64> {
    if !(1970..10_000).contains(&year) || !(1..=12).contains(&month) || !(1..=31).contains(&day) {
        return None;
    }
    let year_from_march = year - u64::from(month <= 2);
    let (era, year_of_era) = (year_from_march / 400, year_from_march % 400);
    let month_from_march = (month + 9) % 12;
    let day_of_year = (153 * month_from_march + 2) / 5 + day - 1;
    let day_of_era = year_of_era * 365 + year_of_era / 4 - year_of_era / 100 + day_of_year;
    let days = (era * 146_097 + day_of_era).checked_sub(719_468)?;
    // A month may have fewer days.
    (civil(days) == (year, month, day)).then_some(days)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_are_those_of_the_calendar() {
        let at = |seconds: u64| date_and_time(Stamp(seconds * 1_000_000_000));
        assert_eq!(at(1_767_225_600), "2026-01-01 00:00:00.000 UTC");
        assert_eq!(at(951_782_400), "2000-02-29 00:00:00.000 UTC");
        assert_eq!(at(1_700_000_000), "2023-11-14 22:13:20.000 UTC");
        assert_eq!(at(12), "00:00:12.000");
        assert_eq!(file_name_of(Stamp(1_700_000_000_000_000_000)), "20231114-221320");
    }

    #[test]
    fn days_are_counted_from_dates_of_the_calendar_alone() {
        for days in [0, 58, 59, 60, 11_016, 11_017, 19_000, 20_454, 100_000] {
            let (year, month, day) = civil(days);
            assert_eq!(days_since_1970(year, month, day), Some(days));
        }
        let wrong = [(2023, 2, 29), (2024, 4, 31), (2024, 13, 1), (2024, 0, 1), (1969, 12, 31)];
        for (year, month, day) in wrong {
            assert_eq!(days_since_1970(year, month, day), None, "{year}-{month}-{day}");
        }
    }
}
