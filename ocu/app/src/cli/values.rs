//! Values of flags: parameters, sizes, times.

use rcs_runtime::RecordWhat;
use std::path::PathBuf;

/// One parameter given on the command line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Param {
    /// Name of the process in the stack.
    pub process: String,
    /// Name of the field.
    pub field: String,
    /// Its value, as text.
    pub value: String,
}

impl Param {
    /// As a plan takes it: `process.field`, and the value.
    pub(crate) fn to_override(&self) -> (String, String) {
        (format!("{}.{}", self.process, self.field), self.value.clone())
    }
}

/// Values of one parameter, for a sweep.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Values {
    /// The parameter, as process.field.
    pub path: String,
    /// Its values, as text.
    pub values: Vec<String>,
}

/// A buffer whose newest message is written to a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Save {
    /// Name of the buffer.
    pub buffer: String,
    /// File to write.
    pub path: PathBuf,
}

/// Size of an image in pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Size {
    /// Width.
    pub width: u32,
    /// Height.
    pub height: u32,
}

pub(super) fn parse_save(text: &str) -> Result<Save, String> {
    match text.split_once('=') {
        Some((buffer, path)) if buffer.starts_with('/') && !path.is_empty() => {
            Ok(Save { buffer: buffer.to_owned(), path: path.into() })
        }
        _ => Err(format!("expected /buffer=file, got {text:?}")),
    }
}

pub(super) fn parse_what(text: &str) -> Result<RecordWhat, String> {
    match text {
        "all" => Ok(RecordWhat::All),
        "journal" => Ok(RecordWhat::Journal),
        list if list.split(',').all(|name| name.starts_with('/') && name.len() > 1) => {
            Ok(RecordWhat::Buffers(list.split(',').map(str::to_owned).collect()))
        }
        _ => Err(format!("expected all, journal, or buffers like /wm1/map,/wm1/status, got {text:?}")),
    }
}

pub(super) fn parse_param(text: &str) -> Result<Param, String> {
    let expected = || format!("expected process.field=value, got {text:?}");
    let (path, value) = text.split_once('=').ok_or_else(expected)?;
    let (process, field) = path.split_once('.').ok_or_else(expected)?;
    if process.is_empty() || field.is_empty() || value.is_empty() {
        return Err(expected());
    }
    Ok(Param { process: process.to_owned(), field: field.to_owned(), value: value.to_owned() })
}

/// Largest number of values of one parameter.
const MOST_VALUES: usize = 10_000;

pub(crate) fn parse_values(text: &str) -> Result<Values, String> {
    let Param { process, field, value } = parse_param(text)?;
    let path = format!("{process}.{field}");
    let expected = || {
        format!(
            "expected {path}=V1,V2,… or {path}=FROM..TO:COUNT with 2 to {MOST_VALUES} values, got {value:?}"
        )
    };
    let number = |text: &str| text.trim().parse::<f64>().ok().filter(|number| number.is_finite());
    // A list may have paths, such as ../a.json: a range begins with a number.
    let Some((from, rest)) = value.split_once("..").filter(|(from, _)| number(from).is_some()) else {
        let values: Vec<String> = value.split(',').map(|value| value.trim().to_owned()).collect();
        return if values.iter().any(String::is_empty) {
            Err(expected())
        } else {
            Ok(Values { path, values })
        };
    };
    let (to, count) = rest.split_once(':').ok_or_else(expected)?;
    let (from, to) = number(from).zip(number(to)).ok_or_else(expected)?;
    let count = count.trim().parse::<usize>().ok().filter(|count| (2..=MOST_VALUES).contains(count));
    let last = (count.ok_or_else(expected)? - 1) as f64;
    // Rounded, so that steps of 0.1 give 0.3 and not 0.30000000000000004.
    let rounded = |value: f64| format!("{value:.9}").trim_end_matches('0').trim_end_matches('.').to_owned();
    let values = (0..=last as usize).map(|i| rounded(from + (to - from) * i as f64 / last));
    Ok(Values { path, values: values.collect() })
}

/// Greatest time from a start, s: a recording may begin at 0 and go on with the time of day, up to the greatest
/// `Stamp`.
const MOST_S: f64 = 1.8e10;

pub(super) fn parse_seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(seconds) if (0.0..=MOST_S).contains(&seconds) => Ok(seconds),
        _ => Err(format!("expected seconds from 0 to {MOST_S:e}, got {text:?}")),
    }
}

/// Parses a seed of random numbers.
pub(super) fn parse_seed(text: &str) -> Result<u64, String> {
    text.parse().map_err(|_| format!("expected a whole number from 0 to {}, got {text:?}", u64::MAX))
}

/// Parses the length of a new recording.
pub(super) fn parse_duration(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(seconds) if (0.0..=86_400.0).contains(&seconds) => Ok(seconds),
        _ => Err(format!("expected seconds from 0 to 86400, got {text:?}")),
    }
}

pub(super) fn parse_size(text: &str) -> Result<Size, String> {
    const RANGE: std::ops::RangeInclusive<u32> = 16..=8192;
    let side = |part: &str| part.parse::<u32>().ok().filter(|side| RANGE.contains(side));
    text.split_once('x')
        .and_then(|(width, height)| Some(Size { width: side(width)?, height: side(height)? }))
        .ok_or_else(|| format!("expected WIDTHxHEIGHT with sides from 16 to 8192 pixels, got {text:?}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_of_a_sweep_are_a_list_or_a_range() {
        let values = |text: &str| parse_values(text).map(|values| values.values.join(" "));
        assert_eq!(values("wm1.w=0.1..0.5:5"), Ok("0.1 0.2 0.3 0.4 0.5".to_owned()));
        assert_eq!(values("wm1.w=1..0:3"), Ok("1 0.5 0".to_owned()));
        assert_eq!(values("wm1.sources[0].w=-1..1:2"), Ok("-1 1".to_owned()));
        assert_eq!(values("wm1.w=a, b"), Ok("a b".to_owned()));
        assert_eq!(values("memory.file=../a.json,../b.json"), Ok("../a.json ../b.json".to_owned()));
        for text in
            ["wm1.w=", "wm1.w=1,", "wm1.w=0..1", "wm1.w=0..1:1", "wm1.w=0..x:3", "wm1.w=0..1:99999", "w=1"]
        {
            assert!(parse_values(text).is_err(), "{text}");
        }
    }

    #[test]
    fn sizes_times_and_parameters_out_of_range_are_refused() {
        assert_eq!(parse_size("1600x900"), Ok(Size { width: 1600, height: 900 }));
        for text in ["", "x", "1600", "15x900", "1600x99999", "1600X900", "-1x5"] {
            assert!(parse_size(text).is_err(), "{text}");
        }
        assert_eq!(parse_seconds("12.5"), Ok(12.5));
        assert_eq!(parse_seconds("1700000005"), Ok(1_700_000_005.0), "of a recording that begins at 0");
        for text in ["", "-1", "NaN", "inf", "1.9e10", "1e300", "3 s"] {
            assert!(parse_seconds(text).is_err(), "{text}");
        }
        let param = Param { process: "wm1".into(), field: "weight_stereo".into(), value: "0.4".into() };
        assert_eq!(parse_param("wm1.weight_stereo=0.4"), Ok(param));
        for text in ["", "wm1", "wm1=1", "wm1.x", "wm1.=1", ".x=1", "wm1.x="] {
            assert!(parse_param(text).is_err(), "{text}");
        }
    }
}
