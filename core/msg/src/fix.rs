//! Whether a position fix holds a position.

use crate::foxglove::LocationFix;

impl LocationFix {
    /// Whether the receiver says that it has no position: its `status`, as of `sensor_msgs/NavSatStatus`, is negative (-1 no
    /// fix, -2 unknown). A fix without a status has a position.
    pub fn is_without_position(&self) -> bool {
        let is_negative = |status: &str| status.parse::<i32>().is_ok_and(|status| status < 0);
        self.metadata.iter().any(|pair| pair.key == "status" && is_negative(&pair.value))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::foxglove::KeyValuePair;

    #[test]
    fn a_negative_status_says_that_there_is_no_position() {
        let fix = |key: &str, value: &str| LocationFix {
            metadata: vec![KeyValuePair { key: key.to_owned(), value: value.to_owned() }],
            ..LocationFix::default()
        };
        assert!(fix("status", "-1").is_without_position() && fix("status", "-2").is_without_position());
        let with = [fix("status", "0"), fix("status", "2"), fix("status", "good"), fix("service", "-1")];
        assert!(!with.iter().any(LocationFix::is_without_position));
        assert!(!LocationFix::default().is_without_position());
    }
}
