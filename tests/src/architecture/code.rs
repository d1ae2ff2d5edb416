//! Rust source with comments and literals blanked, and a search for whole words in it.

/// The source with every comment, string and character literal replaced by spaces; line numbers stay the same.
///
/// It handles raw strings, nested block comments and lifetimes; it does not expand macros.
pub(super) fn code_only(source: &str) -> String {
    let chars: Vec<char> = source.chars().collect();
    let mut code = String::with_capacity(source.len());
    let mut at = 0;
    while at < chars.len() {
        let end = skipped(&chars, at);
        if end == at {
            code.push(chars[at]);
            at += 1;
        } else {
            code.extend(chars[at..end].iter().map(|&c| if c == '\n' { '\n' } else { ' ' }));
            at = end;
        }
    }
    code
}

/// End of the comment or literal that begins at `at`; `at` itself if none begins there.
fn skipped(chars: &[char], at: usize) -> usize {
    let peek = |ahead: usize| chars.get(at + ahead).copied().unwrap_or('\0');
    let joined = at > 0 && is_word(chars[at - 1]);
    match chars[at] {
        '/' if peek(1) == '/' => find(chars, at, |rest| rest[0] == '\n').unwrap_or(chars.len()),
        '/' if peek(1) == '*' => block_comment_end(chars, at),
        '"' => string_end(chars, at + 1),
        'r' if !joined && (peek(1) == '"' || peek(1) == '#') => raw_string_end(chars, at + 1).unwrap_or(at),
        'b' if !joined && peek(1) == 'r' => raw_string_end(chars, at + 2).unwrap_or(at),
        // 'a' and '\n' are literals, 'a alone is a lifetime.
        '\'' if peek(1) == '\\' => {
            find(chars, at + 3, |rest| rest[0] == '\'').map_or(chars.len(), |end| end + 1)
        }
        '\'' if peek(2) == '\'' => at + 3,
        _ => at,
    }
}

fn find(chars: &[char], from: usize, is_end: impl Fn(&[char]) -> bool) -> Option<usize> {
    (from..chars.len()).find(|&at| is_end(&chars[at..]))
}

fn block_comment_end(chars: &[char], start: usize) -> usize {
    let mut depth = 0;
    let mut at = start;
    while at < chars.len() {
        match (chars[at], chars.get(at + 1)) {
            ('/', Some('*')) => (depth, at) = (depth + 1, at + 2),
            ('*', Some('/')) => (depth, at) = (depth - 1, at + 2),
            _ => at += 1,
        }
        if depth == 0 {
            break;
        }
    }
    at.min(chars.len())
}

fn string_end(chars: &[char], mut at: usize) -> usize {
    while at < chars.len() && chars[at] != '"' {
        at += if chars[at] == '\\' { 2 } else { 1 };
    }
    (at + 1).min(chars.len())
}

/// End of a raw string whose hashes or quote begin at `at`; `None` for a raw identifier such as `r#type`.
fn raw_string_end(chars: &[char], at: usize) -> Option<usize> {
    let hashes = chars[at..].iter().take_while(|&&c| c == '#').count();
    if chars.get(at + hashes) != Some(&'"') {
        return None;
    }
    let closes = |rest: &[char]| {
        rest[0] == '"' && rest[1..].iter().take(hashes).filter(|&&c| c == '#').count() == hashes
    };
    Some(find(chars, at + hashes + 1, closes).map_or(chars.len(), |end| end + 1 + hashes))
}

fn is_word(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// Numbers, from 1, of the lines that contain `words` as whole words (no letter, digit or underscore on either side).
pub(super) fn lines_with(code: &str, words: &str) -> Vec<usize> {
    let holds = |line: &str| {
        line.match_indices(words).any(|(start, _)| {
            let before = line[..start].chars().next_back();
            let after = line[start + words.len()..].chars().next();
            let opens_inside_word = words.starts_with(is_word) && before.is_some_and(is_word);
            let ends_inside_word = words.ends_with(is_word) && after.is_some_and(is_word);
            !opens_inside_word && !ends_inside_word
        })
    };
    code.lines().enumerate().filter(|(_, line)| holds(line)).map(|(at, _)| at + 1).collect()
}

#[test]
fn comments_strings_and_characters_are_blanked_and_lines_stay() {
    let source = "a(); // egui\nb(\"egui \\\" egui\");\n/* egui /* egui */\n egui */ c('\"', '\\'', r#\"egui \" \"#);\nd::<'x>(r#type);";
    let code = code_only(source);
    assert_eq!(lines_with(&code, "egui"), Vec::<usize>::new(), "{code}");
    assert_eq!(lines_with(&code, "c("), [4], "{code}");
    assert_eq!(lines_with(&code, "type"), [5], "{code}");
    assert_eq!(code.lines().count(), source.lines().count());
}

#[test]
fn words_are_found_whole_only() {
    assert_eq!(
        lines_with("use egui::Ui;\nuse egui_tiles as t;\nlet legui = 1;\nx.sin()\nx.sinh()", "egui"),
        [1]
    );
    assert_eq!(lines_with("x.sin();\nx.sinh();\ny . sin ()", ".sin("), [1]);
}
