//! Escapes control characters in untrusted text before it is printed on a terminal.

/// The text on one line, with control characters, and characters that change the writing direction, as escapes (`\n`,
/// `\u{1b}`).
pub(crate) fn plain(text: &str) -> String {
    let turns =
        |c: char| matches!(c, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}' | '\u{200e}' | '\u{200f}');
    if !text.chars().any(|c| c.is_control() || turns(c)) {
        return text.to_owned();
    }
    let mut shown = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        if c.is_control() || turns(c) {
            shown.extend(c.escape_default());
        } else {
            shown.push(c);
        }
    }
    shown
}

/// Escapes each of several lines.
pub(crate) fn plain_lines(text: &str) -> String {
    text.split('\n').map(plain).collect::<Vec<_>>().join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_characters_are_shown_and_letters_of_any_script_stay() {
        assert_eq!(plain("/gps/fix"), "/gps/fix");
        assert_eq!(plain("/Straße/カメラ"), "/Straße/カメラ");
        assert_eq!(plain("a\x1b[31mb\nc\u{202e}d\u{9b}e"), "a\\u{1b}[31mb\\nc\\u{202e}d\\u{9b}e");
        assert_eq!(plain_lines("a\r\nb"), "a\\r\nb");
    }
}
