//! Formats numbers, times, ages and sizes as text, always with a unit, with significant digits only, and with constant
//! width.

/// Time of day (UTC): `14:03:07.250`. Simulated times, which start at 0, are formatted in the same way.
pub fn clock(ns: u64) -> String {
    let ms = ns / 1_000_000;
    let (hours, minutes, seconds) = (ms / 3_600_000 % 24, ms / 60_000 % 60, ms / 1000 % 60);
    format!("{hours:02}:{minutes:02}:{seconds:02}.{:03}", ms % 1000)
}

/// Seconds since the start as `hh:mm:ss.mmm`, with a minus sign where negative. Like [`clock`], it leaves out what is
/// shorter than a millisecond, so that both show the same moment.
pub fn elapsed(seconds: f64) -> String {
    if !seconds.is_finite() {
        return "--:--:--.---".to_owned();
    }
    // A whole number of milliseconds may be slightly too small in binary.
    let ms = (seconds.abs() * 1e3 + 1e-3).floor() as u64;
    let sign = if seconds < 0.0 && ms > 0 { "-" } else { "" };
    format!("{sign}{:02}:{:02}:{:02}.{:03}", ms / 3_600_000, ms / 60_000 % 60, ms / 1000 % 60, ms % 1000)
}

/// An age: `0.2 s`, `12 s`, `3 min`, `2 h`, `5 d`, `54 y`.
pub fn age(seconds: f64) -> String {
    if !seconds.is_finite() {
        return "–".to_owned();
    }
    let (sign, seconds) = if seconds <= -0.05 { ("in ", -seconds) } else { ("", seconds.abs()) };
    let text = match seconds {
        s if s < 9.95 => format!("{s:.1} s"),
        s if s < 99.5 => format!("{s:.0} s"),
        s if s < 99.5 * 60.0 => format!("{:.0} min", s / 60.0),
        s if s < 48.0 * 3600.0 => format!("{:.0} h", s / 3600.0),
        s if s < 999.5 * 86_400.0 => format!("{:.0} d", s / 86_400.0),
        s => format!("{:.0} y", s / 31_557_600.0),
    };
    format!("{sign}{text}")
}

/// A rate: `30 Hz`, `2.5 Hz`, `0.06 Hz`; a dash where unknown.
pub fn rate(hz: f64) -> String {
    match hz {
        hz if !hz.is_finite() || hz <= 0.0 => "–".to_owned(),
        hz if hz < 0.095 => format!("{hz:.2} Hz"),
        hz if hz < 9.95 => format!("{hz:.1} Hz"),
        hz => format!("{hz:.0} Hz"),
    }
}

/// A size: `64 B`, `2.4 kB`, `18 MB` (powers of 1000).
pub fn bytes(count: u64) -> String {
    let (mut value, mut unit) = (count as f64, "B");
    for next in ["kB", "MB", "GB", "TB"] {
        if value < 999.5 {
            break;
        }
        value /= 1000.0;
        unit = next;
    }
    if unit == "B" || value >= 9.95 { format!("{value:.0} {unit}") } else { format!("{value:.1} {unit}") }
}

/// A count with digits in groups of three, separated by thin spaces: `131 072`.
pub fn count(value: u64) -> String {
    let digits = value.to_string();
    let mut text = String::with_capacity(digits.len() * 4 / 3);
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push('\u{2009}');
        }
        text.push(digit);
    }
    text
}

/// A number with about five significant digits, for display: `0.0125`, `-3.2`, `1.2e-7`.
pub fn number(value: f64) -> String {
    if value.is_nan() {
        return "NaN".to_owned();
    }
    let size = value.abs();
    if size == 0.0 || size.is_infinite() || (size.fract() == 0.0 && size < 1e9) {
        return format!("{value}");
    }
    if !(1e-4..1e9).contains(&size) {
        return format!("{value:.4e}");
    }
    let decimals = (4 - size.log10().floor() as i32).clamp(0, 8) as usize;
    let text = format!("{value:.decimals$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

/// A number with all of its digits: the shortest text of a 32-bit float where it is one, otherwise ten digits.
pub fn exact(value: f64) -> String {
    let size = value.abs();
    if value.is_nan() || size == 0.0 || !(1e-5..1e12).contains(&size) {
        return number(value);
    }
    if f64::from(value as f32) == value {
        return format!("{}", value as f32);
    }
    let decimals = (9 - size.log10().floor() as i32).clamp(0, 14) as usize;
    let text = format!("{value:.decimals$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

/// A length in metres with a fixed number of decimals: `12.40 m`.
pub fn metres(value: f64, decimals: usize) -> String {
    if value.is_finite() { format!("{value:.decimals$} m") } else { "– m".to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_have_constant_width() {
        assert_eq!(clock(1_700_000_000_250_000_000), "22:13:20.250");
        assert_eq!(elapsed(0.0), "00:00:00.000");
        assert_eq!(elapsed(-0.000_1), "00:00:00.000");
        assert_eq!(elapsed(-75.5), "-00:01:15.500");
        assert_eq!(elapsed(f64::NAN), "--:--:--.---");
    }

    #[test]
    fn ages_lose_digits_as_they_lose_meaning() {
        let ages = [0.0, 0.24, 9.94, 9.96, 61.0, 119.0, 7200.0, 400_000.0, 1.7e9, -3.0, f64::NAN].map(age);
        assert_eq!(
            ages,
            ["0.0 s", "0.2 s", "9.9 s", "10 s", "61 s", "2 min", "2 h", "5 d", "54 y", "in 3.0 s", "–"]
        );
    }

    #[test]
    fn rates_and_sizes_carry_their_unit() {
        assert_eq!([0.0, 0.06, 2.5, 30.02].map(rate), ["–", "0.06 Hz", "2.5 Hz", "30 Hz"]);
        assert_eq!([0, 999, 2400, 18_000_000].map(bytes), ["0 B", "999 B", "2.4 kB", "18 MB"]);
        assert_eq!([7, 1000, 131_072].map(count), ["7", "1\u{2009}000", "131\u{2009}072"]);
    }

    #[test]
    fn numbers_keep_five_digits() {
        let numbers = [0.0, 1.0, -3.2, 0.012_5, 123.456_789, 1e-7, 1.5e12, 3.0e5].map(number);
        assert_eq!(numbers, ["0", "1", "-3.2", "0.0125", "123.46", "1.0000e-7", "1.5000e12", "300000"]);
        assert_eq!(number(f64::INFINITY), "inf");
    }

    #[test]
    fn exact_numbers_lose_nothing_that_was_there() {
        let numbers = [f64::from(0.1_f32), 42.377_123_456, -71.25, 1e-9, 0.0, 1_700_000_000.125].map(exact);
        assert_eq!(numbers, ["0.1", "42.37712346", "-71.25", "1.0000e-9", "0", "1700000000"]);
    }
}
