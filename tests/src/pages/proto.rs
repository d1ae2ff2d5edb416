//! Messages and enums as their `.proto` files declare and document them.

/// A message or an enum.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Declared {
    /// Name, with those of the messages that it lies in: `Override.Mode`.
    pub(super) name: String,
    pub(super) is_enum: bool,
    pub(super) help: String,
    pub(super) entries: Vec<Entry>,
}

/// A field or a value.
#[derive(Debug, PartialEq)]
pub(super) struct Entry {
    pub(super) name: String,
    pub(super) number: String,
    /// Empty for the values of an enum.
    pub(super) type_name: String,
    pub(super) help: String,
    /// Whether it carries options, as parameters do.
    has_options: bool,
}

impl Declared {
    /// Whether it is a parameter message: the page of the plugins has it.
    pub(super) fn is_parameters(&self) -> bool {
        !self.entries.is_empty() && self.entries.iter().all(|entry| entry.has_options)
    }
}

/// What a file declares, in its order.
pub(super) fn declared(text: &str) -> Vec<Declared> {
    let (mut done, mut open): (Vec<Declared>, Vec<Declared>) = (Vec::new(), Vec::new());
    let (mut help, mut statement) = (Vec::new(), String::new());
    for line in text.lines().map(str::trim) {
        if let Some(comment) = line.strip_prefix("//") {
            help.push(comment.trim().to_owned());
            continue;
        }
        if line.is_empty() && statement.is_empty() {
            help.clear();
            continue;
        }
        statement = format!("{statement} {line}").trim().to_owned();
        if !statement.ends_with(['{', '}', ';']) {
            continue;
        }
        let said = std::mem::take(&mut statement);
        let said_help = std::mem::take(&mut help).join(" ");
        let words: Vec<&str> = said.split_whitespace().collect();
        match words.as_slice() {
            [kind @ ("message" | "enum"), name, ..] => {
                let within = open.last().map_or(String::new(), |outer| format!("{}.", outer.name));
                let name = format!("{within}{}", name.trim_end_matches("{}"));
                open.push(Declared { name, is_enum: *kind == "enum", help: said_help, entries: Vec::new() });
                if said.ends_with("{}") {
                    done.extend(open.pop());
                }
            }
            ["}"] => done.extend(open.pop()),
            ["reserved" | "syntax" | "package" | "import" | "extend" | "option" | "oneof", ..] => {
                // An extension or a choice is no message; what it holds is.
                if said.ends_with('{') {
                    open.push(Declared::default());
                }
            }
            _ => {
                if let (Some(outer), Some(entry)) = (open.last_mut(), entry(&said, said_help)) {
                    outer.entries.push(entry);
                }
            }
        }
    }
    done.retain(|declared| !declared.name.is_empty());
    done
}

fn entry(said: &str, help: String) -> Option<Entry> {
    let (left, right) = said.split_once(" = ")?;
    let number: String = right.chars().take_while(|c| c.is_ascii_digit() || *c == '-').collect();
    let (type_name, name) = left.rsplit_once(' ').unwrap_or(("", left));
    Some(Entry {
        name: name.to_owned(),
        number,
        type_name: type_name.to_owned(),
        help,
        has_options: right.contains('['),
    })
}

#[test]
fn messages_are_read_with_their_comments() {
    let text = "syntax = \"proto3\";\n\n// Lost.\n\n// One\n// thing.\nmessage A {\n  // How far.\n  repeated double far_m = 1;\n  \
                enum Mode {\n    // None.\n    OFF = 0;\n  }\n  Mode mode = 2 [(unit) = \"\",\n    (help) = \"X.\"];\n}\nmessage N {}\n";
    let all = declared(text);
    assert_eq!(all.iter().map(|one| one.name.as_str()).collect::<Vec<_>>(), ["A.Mode", "A", "N"]);
    assert_eq!(
        (all[1].help.as_str(), all[1].entries.len(), all[1].is_parameters()),
        ("One thing.", 2, false)
    );
    let far = &all[1].entries[0];
    assert_eq!(
        (far.type_name.as_str(), far.number.as_str(), far.help.as_str()),
        ("repeated double", "1", "How far.")
    );
    assert!(all[0].is_enum && all[0].entries[0].name == "OFF");
}
