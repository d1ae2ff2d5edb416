//! Which channels of a log give the messages of a field. Several channels may have one name, in merged recordings and
//! where several programs write to one topic: those whose messages are read alike are read together.

use super::extract::Extractor;
use rcs_log::{LogTopic, Reassembly, TopicId};
use rcs_msg::{FieldPath, Schema};
use std::sync::Arc;

/// Channels with one name whose messages are read alike.
#[derive(Clone, Debug)]
pub(crate) struct Channels {
    /// Their schema.
    pub(super) schema: Arc<Schema>,
    /// Their numbers, including those of their deltas.
    pub(super) ids: Vec<TopicId>,
    /// Number of their messages.
    messages: u64,
}

/// Groups channels with one name by how their messages are read. Those without messages come last.
pub(crate) fn alike<'a>(
    topics: impl IntoIterator<Item = &'a LogTopic>,
    reassembly: &Reassembly,
) -> Vec<Channels> {
    let mut groups: Vec<Channels> = Vec::new();
    for topic in topics.into_iter().filter(|topic| reassembly.keys_of(topic.id).is_none()) {
        let ids = std::iter::once(topic.id).chain(reassembly.deltas_of(topic.id).iter().copied());
        match groups.iter_mut().find(|group| group.schema.reads_like(&topic.schema)) {
            Some(group) => {
                group.ids.extend(ids);
                group.messages += topic.messages;
            }
            None => groups.push(Channels {
                schema: Arc::clone(&topic.schema),
                ids: ids.collect(),
                messages: topic.messages,
            }),
        }
    }
    groups.sort_by_key(|group| group.messages == 0);
    groups
}

/// The channels that a field is read from.
pub(super) struct Chosen {
    pub(super) channels: Channels,
    pub(super) extractor: Extractor,
    /// Which messages with the topic's name are not read, if there are any.
    pub(super) problem: Option<Arc<str>>,
}

/// The first channels whose messages can have the field; the error says why none can.
pub(super) fn choose(topic: &str, groups: &[Channels], path: &FieldPath) -> Result<Chosen, String> {
    let mut refused = None;
    for (index, channels) in groups.iter().enumerate() {
        match Extractor::new(&channels.schema, path) {
            Ok(extractor) => {
                let problem = not_read(groups, index);
                return Ok(Chosen { channels: channels.clone(), extractor, problem });
            }
            Err(error) => refused = refused.or(Some(error)),
        }
    }
    Err(refused.unwrap_or_else(|| format!("the log has no topic {topic}")))
}

/// What is said of the messages of the other channels.
fn not_read(groups: &[Channels], read: usize) -> Option<Arc<str>> {
    let schema = &groups[read].schema;
    let type_of = |other: &Schema| {
        if other.name() != schema.name() {
            other.name().to_owned()
        } else if other.message_encoding() != schema.message_encoding() {
            format!("{} in {}", other.name(), other.message_encoding().name())
        } else {
            format!("{} with another definition", other.name())
        }
    };
    let others = groups.iter().enumerate().filter(|(index, group)| *index != read && group.messages > 0);
    let others: Vec<String> =
        others.map(|(_, group)| format!("{} of {}", group.messages, type_of(&group.schema))).collect();
    (!others.is_empty()).then(|| {
        format!(
            "messages of type {} are read; the topic has others, which are not: {}",
            schema.name(),
            others.join(", ")
        )
        .into()
    })
}
