//! The text of a value that is above its limit, for reasons such as "imu silent for 0.52 s, expected at most 0.5 s".

/// Text of a value that is above a limit: with one decimal, or with as many more as show that it is above.
pub fn text_above(value: f64, limit: f64) -> String {
    let rounded = |decimals: usize| format!("{value:.decimals$}");
    let is_above = |text: &String| text.parse::<f64>().is_ok_and(|shown| shown > limit);
    (1..=6).map(rounded).find(is_above).unwrap_or_else(|| value.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_that_is_hardly_above_its_limit_has_more_decimals() {
        for (value, limit, text) in [
            (0.9, 0.5, "0.9"),
            (1.0, 0.5, "1.0"),
            (0.52, 0.5, "0.52"),
            (0.5004, 0.5, "0.5004"),
            (0.56, 0.5, "0.6"),
            (0.500_000_000_1, 0.5, "0.5000000001"),
            (f64::INFINITY, 0.5, "inf"),
        ] {
            assert_eq!(text_above(value, limit), text);
        }
    }
}
