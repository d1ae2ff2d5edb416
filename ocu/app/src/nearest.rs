//! The known names that are nearest to one that is not known, for errors.

/// Number of names that are told.
const MOST: usize = 5;

/// The names that are nearest to this one, separated by commas.
pub(crate) fn nearest(name: &str, known: &[&str]) -> String {
    similar::get_close_matches(name, known, MOST, 0.0).join(", ")
}
