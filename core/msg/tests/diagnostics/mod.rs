//! Diagnostics of ROS 2.

use super::{HEADER, Writer, convert, schema};
use rcs_msg::rcs::diagnostic::Level;
use rcs_msg::rcs::{Diagnostic, Diagnostics};
use rcs_msg::{canonical_name, header_stamp};

const ARRAY: &str = "diagnostic_msgs/msg/DiagnosticArray";

#[test]
fn each_part_keeps_its_level_its_words_and_its_hardware() {
    let mut writer = Writer::new(false);
    writer.header().u32(2).u8(1).text("disk").text("full").text("sda").u32(1).text("used").text("91 %");
    let bytes = writer.u8(3).text("lidar").text("").text("").u32(0).done();
    let message = convert(ARRAY, &bytes);
    assert_eq!(header_stamp(&message).map(|stamp| stamp.0), Some(5_000_000_007));
    let part = |level: Level, [name, message, hardware_id]: [&str; 3]| Diagnostic {
        level: level.into(),
        name: name.to_owned(),
        message: message.to_owned(),
        hardware_id: hardware_id.to_owned(),
    };
    let expect = [part(Level::Warn, ["disk", "full", "sda"]), part(Level::Stale, ["lidar", "", ""])];
    assert_eq!(message.get::<Diagnostics>().expect("they are diagnostics").parts, expect);
}

#[test]
fn the_definition_of_diagnostics_is_the_one_that_the_conversion_expects() {
    let status = "===\nMSG: diagnostic_msgs/DiagnosticStatus\nbyte OK=0\nbyte level\nstring name\n\
        string message\nstring hardware_id\nKeyValue[] values\n===\nMSG: diagnostic_msgs/KeyValue\n\
        string key\nstring value\n";
    let text = format!("std_msgs/Header header\nDiagnosticStatus[] status{HEADER}{status}");
    assert_eq!(canonical_name(&schema(ARRAY, &text)), Some("rcs.Diagnostics"));
}
