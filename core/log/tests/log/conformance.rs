//! MCAP's conformance vectors. The tests compare header, schemas, channels, messages and statistics (counts and times),
//! and check that nothing is lost. They do not compare chunk indexes, summary offsets, data end and footer.

use crate::common::{logs_under, plain, read_all};
use bytes::Bytes;
use rcs_log::{Log, Lost};
use serde_json::Value;
use std::collections::BTreeMap;

/// The fields of a record by name.
fn fields(record: &Value) -> BTreeMap<&str, &Value> {
    let pairs = record["fields"].as_array().unwrap();
    pairs.iter().map(|pair| (pair[0].as_str().unwrap(), &pair[1])).collect()
}

fn number(value: &Value) -> u64 {
    value.as_str().unwrap().parse().unwrap()
}

fn bytes(value: &Value) -> Bytes {
    value.as_array().unwrap().iter().map(|byte| number(byte) as u8).collect()
}

fn check(log: &Log, records: &[Value], name: &str) {
    let info = log.info();
    let mut messages = Vec::new();
    let mut channels = BTreeMap::new();
    let mut schemas = BTreeMap::new();
    for record in records {
        let fields = fields(record);
        match record["type"].as_str().unwrap() {
            "Header" => {
                assert_eq!(info.profile, fields["profile"].as_str().unwrap(), "{name}");
                assert_eq!(info.library, fields["library"].as_str().unwrap(), "{name}");
            }
            "Schema" => {
                schemas.insert(number(fields["id"]), fields);
            }
            "Channel" => {
                channels.insert(number(fields["id"]), fields);
            }
            "Message" => messages.push((
                number(fields["channel_id"]) as u16,
                number(fields["sequence"]) as u32,
                number(fields["log_time"]),
                number(fields["publish_time"]),
                bytes(fields["data"]),
            )),
            "Statistics" => {
                assert_eq!(info.messages, number(fields["message_count"]), "{name}");
                assert_eq!(info.start.0, number(fields["message_start_time"]), "{name}");
                assert_eq!(info.end.0, number(fields["message_end_time"]), "{name}");
                assert_eq!(info.topics.len() as u64, number(fields["channel_count"]), "{name}");
                assert_eq!(log.attachments().len() as u64, number(fields["attachment_count"]), "{name}");
                assert_eq!(log.metadata().len() as u64, number(fields["metadata_count"]), "{name}");
                for (id, count) in fields["channel_message_counts"].as_object().unwrap() {
                    let topic = info.topics.iter().find(|topic| topic.id.0.to_string() == *id).unwrap();
                    assert_eq!(topic.messages, number(count), "{name}");
                }
            }
            _ => {}
        }
    }
    assert_eq!(info.topics.len(), channels.len(), "{name}");
    for topic in &info.topics {
        let channel = &channels[&u64::from(topic.id.0)];
        let schema = &schemas[&number(channel["schema_id"])];
        assert_eq!(topic.name, channel["topic"].as_str().unwrap(), "{name}");
        assert_eq!(
            topic.schema.message_encoding().name(),
            channel["message_encoding"].as_str().unwrap(),
            "{name}"
        );
        let metadata: BTreeMap<String, String> = serde_json::from_value(channel["metadata"].clone()).unwrap();
        assert_eq!(topic.metadata, metadata, "{name}");
        assert_eq!(topic.schema.name(), schema["name"].as_str().unwrap(), "{name}");
        assert_eq!(topic.schema.schema_encoding(), schema["encoding"].as_str().unwrap(), "{name}");
        assert_eq!(*topic.schema.data(), bytes(schema["data"]), "{name}");
        assert!(!topic.decodable, "{name}: the vectors' encoding is none that there is");
    }
    assert_eq!(info.messages, messages.len() as u64, "{name}");
    assert_eq!(plain(read_all(log)), messages, "{name}");
    assert_eq!(info.lost, Lost::default(), "{name}: {:?}", info.problems);
}

#[test]
fn every_conformance_vector_reads_as_its_json_says() {
    let Some(data) = rcs_testkit::data_dir() else { return };
    let paths = logs_under(&data.join("mcap-conformance"));
    assert_eq!(paths.len(), 160);
    for path in paths {
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        let text = std::fs::read_to_string(path.with_extension("json")).unwrap();
        let vector: Value = serde_json::from_str(&text).unwrap();
        let records = vector["records"].as_array().unwrap();
        let log = Log::open(&path).unwrap();
        check(&log, records, &name);
        check(&Log::open_by_scan(&path).unwrap(), records, &name);
        // Without an index a log cannot be opened by index; an index that repeats the channels is sufficient.
        let has = |feature: &str| name.split('-').any(|part| part == feature);
        let by_index = has("chx") && has("rch") && has("rsh") && (has("st") || has("mx"));
        if by_index {
            assert!(!log.info().recovered, "{name}: {:?}", log.info().problems);
        }
        if !has("chx") && has("OneMessage") {
            assert!(log.info().recovered, "{name}");
        }
    }
}
