//! The rows of the list: topics in a tree by name, or in groups by process.

use super::{Column, Saved};
use crate::view::rate_hz;
use rcs_runtime::source::{Frame, RunTag, SourceKind, Topic, UPDATES};
use std::cmp::Ordering;
use std::collections::BTreeMap;
use std::sync::Arc;

/// One row.
pub(super) enum Row<'a> {
    /// A group that can be folded.
    Group {
        /// Identity of the group in layouts.
        key: String,
        /// As it is shown.
        title: String,
        /// Level in the tree.
        depth: usize,
        /// Number of topics in it.
        count: usize,
    },
    /// A topic.
    Topic {
        /// The topic.
        topic: &'a Topic,
        /// Its name below its group.
        name: &'a str,
        /// Level in the tree.
        depth: usize,
    },
}

/// All rows that are shown.
pub(super) fn rows<'a>(saved: &Saved, frame: &'a Frame) -> Vec<Row<'a>> {
    let search = saved.search.trim().to_lowercase();
    let found = |topic: &&Topic| {
        search.is_empty()
            || topic.name.to_lowercase().contains(&search)
            || topic.schema.name().to_lowercase().contains(&search)
            || topic.writer.to_lowercase().contains(&search)
            || topic.metadata.get(UPDATES).is_some_and(|updates| updates.to_lowercase().contains(&search))
    };
    let mut topics: Vec<_> = frame.topics.iter().filter(found).collect();
    topics.sort_by(|a, b| {
        let order = compare(a, b, saved.sort, frame);
        let order = if saved.descending { order.reverse() } else { order };
        order.then_with(|| a.name.cmp(&b.name)).then_with(|| a.run.cmp(&b.run))
    });
    let mut rows = Vec::new();
    let is_open = |key: &str| !search.is_empty() || !saved.folded.contains(key);
    if saved.by_process {
        by_process(&topics, frame, &is_open, &mut rows);
    } else if saved.sort != Column::Name {
        // A tree has one order, so topics that are sorted by a number form a list.
        rows.extend(topics.iter().map(|topic| Row::Topic { topic, name: &topic.name, depth: 0 }));
    } else {
        // Recorded topics beside computed ones are a tree of their own.
        let (recorded, computed): (Vec<&Topic>, Vec<&Topic>) =
            topics.iter().partition(|topic| topic.run.is_recorded());
        let has_both = !recorded.is_empty() && !computed.is_empty();
        by_name(&computed, "", 0, 0, &is_open, &mut rows);
        if has_both {
            let key = "recorded".to_owned();
            let open = is_open(&key);
            rows.push(Row::Group { key, title: "Recorded".to_owned(), depth: 0, count: recorded.len() });
            if open {
                by_name(&recorded, "recorded", 0, 1, &is_open, &mut rows);
            }
        } else {
            by_name(&recorded, "", 0, 0, &is_open, &mut rows);
        }
    }
    rows
}

/// Compares two topics by a column; what is unknown comes last.
fn compare(a: &Topic, b: &Topic, column: Column, frame: &Frame) -> Ordering {
    let number = |value: fn(&Topic, &Frame) -> Option<f64>| {
        let of = |topic: &Topic| value(topic, frame).unwrap_or(-1.0);
        of(a).total_cmp(&of(b))
    };
    match column {
        Column::Name => Ordering::Equal,
        Column::Type => a.schema.name().cmp(b.schema.name()),
        Column::Role => a.role_name().cmp(b.role_name()),
        Column::Messages => a.messages.cmp(&b.messages),
        Column::Size => number(|topic, _| {
            let message = &topic.latest.as_ref()?.message;
            (!message.is_typed()).then(|| message.bytes().len() as f64)
        }),
        Column::Rate => number(|topic, _| Some(rate_hz(topic))),
        Column::Age => number(|topic, frame| topic.age_s(frame.now)),
    }
}

/// Adds the topics as a tree. They are sorted by name; the first `skip` bytes of their names are those of the group,
/// whose key is `key`. A group with a single topic is that topic.
fn by_name<'a>(
    topics: &[&'a Topic],
    key: &str,
    skip: usize,
    depth: usize,
    is_open: &dyn Fn(&str) -> bool,
    rows: &mut Vec<Row<'a>>,
) {
    let head = |topic: &Topic| {
        let rest = &topic.name[skip..];
        let start = usize::from(rest.starts_with('/'));
        rest[start..].find('/').map_or(rest.len(), |at| start + at)
    };
    for group in topics.chunk_by(|a, b| a.name[skip..][..head(a)] == b.name[skip..][..head(b)]) {
        let until = common(group, skip + head(group[0]));
        let is_deep = group.iter().any(|topic| topic.name.len() > until);
        if group.len() == 1 || !is_deep {
            let named = |topic: &&'a Topic| {
                // The slash before a name says only that there is a tree.
                let rest = &topic.name[skip..];
                let name = if depth > 0 { rest.trim_start_matches('/') } else { rest };
                Row::Topic { topic, name: if name.is_empty() { &topic.name } else { name }, depth }
            };
            rows.extend(group.iter().map(named));
            continue;
        }
        let title = &group[0].name[skip..until];
        let title = if depth > 0 { title.trim_start_matches('/') } else { title };
        let key = format!("{key}{}", &group[0].name[skip..until]);
        let open = is_open(&key);
        rows.push(Row::Group { key: key.clone(), title: title.to_owned(), depth, count: group.len() });
        if open {
            by_name(group, &key, until, depth + 1, is_open, rows);
        }
    }
}

/// The end of the part of their names that all topics share, from `until` on, in whole segments; each goes on after it.
fn common(topics: &[&Topic], mut until: usize) -> usize {
    let name = &topics[0].name;
    loop {
        let Some(step) = name[until..].strip_prefix('/').map(|rest| rest.find('/').unwrap_or(rest.len()))
        else {
            return until;
        };
        let longer = until + 1 + step;
        let goes_on = |topic: &&Topic| {
            topic.name.get(..longer) == name.get(..longer) && topic.name.as_bytes().get(longer) == Some(&b'/')
        };
        if !topics.iter().all(goes_on) {
            return until;
        }
        until = longer;
    }
}

/// Adds the topics in groups: processes in the order of the stack, then topics without a writer, then recorded topics.
fn by_process<'a>(
    topics: &[&'a Topic],
    frame: &Frame,
    is_open: &dyn Fn(&str) -> bool,
    rows: &mut Vec<Row<'a>>,
) {
    let rank = |writer: &str| {
        // A topic with several writers is listed with the first of them.
        let first = writer.split(", ").next();
        frame.processes.iter().position(|process| Some(process.name.as_str()) == first)
    };
    let mut groups: BTreeMap<(bool, usize, Arc<str>), Vec<&'a Topic>> = BTreeMap::new();
    for topic in topics {
        let place = rank(&topic.writer).unwrap_or(usize::MAX);
        groups.entry((topic.run.is_recorded(), place, Arc::clone(&topic.writer))).or_default().push(topic);
    }
    for group in groups.values() {
        let title = group_title(frame, group[0]);
        let open = is_open(&title);
        rows.push(Row::Group { key: title.clone(), title, depth: 0, count: group.len() });
        if open {
            rows.extend(group.iter().map(|topic| Row::Topic { topic, name: &topic.name, depth: 0 }));
        }
    }
}

fn group_title(frame: &Frame, topic: &Topic) -> String {
    match (topic.run, &*topic.writer) {
        (RunTag::Recorded, "") => "Recording".to_owned(),
        (RunTag::Recorded, writer) => format!("{writer} (recorded)"),
        (RunTag::Run(_), "") if frame.info.kind == SourceKind::Log => "Recording".to_owned(),
        (RunTag::Run(_), "") => "Runtime and operator".to_owned(),
        (RunTag::Run(_), writer) => writer.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcs_msg::schema_of;

    fn lines(saved: &Saved, names: &[&str]) -> Vec<String> {
        let mut frame = crate::samples::empty();
        let schema = schema_of::<rcs_msg::rcs::Status>();
        frame.topics = names.iter().map(|name| Topic::new(name, RunTag::FIRST, Arc::clone(schema))).collect();
        let line = |row: &Row<'_>| match row {
            Row::Group { key, title, depth, count } => format!("{depth} [{title}] {key} {count}"),
            Row::Topic { name, depth, topic } => format!("{depth} {name} {}", topic.name),
        };
        rows(saved, &frame).iter().map(line).collect()
    }

    #[test]
    fn names_form_a_tree_whose_groups_have_several_topics() {
        let names = ["/b/x", "/a/y/2", "/a/y/1", "/a/x", "/a", "odom", "/c/d/e"];
        let expected = [
            "0 [/a] /a 4",
            "1 /a /a",
            "1 x /a/x",
            "1 [y] /a/y 2",
            "2 1 /a/y/1",
            "2 2 /a/y/2",
            "0 /b/x /b/x",
            "0 /c/d/e /c/d/e",
            "0 odom odom",
        ];
        assert_eq!(lines(&Saved::default(), &names), expected);
        let folded = Saved { folded: ["/a".to_owned()].into(), ..Saved::default() };
        assert_eq!(lines(&folded, &names).len(), 4);
        let searched = Saved { search: "Y".into(), ..folded };
        assert_eq!(lines(&searched, &names).len(), 3, "a search opens the groups");
    }

    #[test]
    fn a_search_for_the_updates_of_a_topic_finds_the_topic() {
        let mut frame = crate::samples::empty();
        let schema = schema_of::<rcs_msg::foxglove::Grid>();
        let mut grid = Topic::new("/costmap", RunTag::Recorded, Arc::clone(schema));
        grid.metadata = Arc::new([(UPDATES.to_owned(), "3 on /costmap_updates".to_owned())].into());
        let other = Topic::new("/other", RunTag::Recorded, Arc::clone(schema));
        frame.topics = Arc::new([grid, other]);
        let saved = Saved { search: "costmap_Updates".into(), ..Saved::default() };
        let rows = rows(&saved, &frame);
        assert!(matches!(rows.as_slice(), [Row::Topic { topic, .. }] if &*topic.name == "/costmap"));
    }

    #[test]
    fn topics_are_sorted_by_any_column_both_ways() {
        for sort in [Column::Type, Column::Rate, Column::Age, Column::Size, Column::Messages, Column::Role] {
            for descending in [false, true] {
                let saved = Saved { sort, descending, ..Saved::default() };
                assert_eq!(lines(&saved, &["/b/2", "/b/1"]), ["0 /b/1 /b/1", "0 /b/2 /b/2"]);
            }
        }
    }
}
