//! The messages of a recording, those that were recorded as key frames and deltas put together again.

use crate::EvalError;
use rcs_log::{CursorOptions, Log, Reassembly, TopicId};
use rcs_msg::{AnyMessage, Stamp};

/// Calls a function with each message of some topics, in the order of the recording, and its publish time.
pub(crate) fn each_whole(
    log: &Log,
    topics: &[TopicId],
    mut take: impl FnMut(TopicId, &AnyMessage, Stamp) -> Result<(), EvalError>,
) -> Result<(), EvalError> {
    let mut reassembly = Reassembly::new(log);
    let deltas = topics.iter().flat_map(|&topic| reassembly.deltas_of(topic));
    let wanted = topics.iter().chain(deltas).copied().collect();
    for stored in log.cursor(CursorOptions { topics: Some(wanted), ..CursorOptions::default() }) {
        let stored = stored?;
        let (topic, message) = if reassembly.takes(stored.topic) {
            match reassembly.take(&stored) {
                Some(whole) => (whole.topic, whole.message),
                None => continue,
            }
        } else {
            let Some(topic) = log.info().topic(stored.topic) else { continue };
            (stored.topic, AnyMessage::encoded(topic.schema.clone(), stored.data.clone()))
        };
        take(topic, &message, stored.publish_time)?;
    }
    Ok(())
}
