//! The one list of views. A new view is its own file and one line here.

use crate::view::ViewType;

/// Every view that a person can open, in the order of the menu.
pub fn all() -> &'static [ViewType] {
    &[]
}

/// The view type of that kind.
pub fn view_type(kind: &str) -> Option<&'static ViewType> {
    all().iter().find(|view_type| view_type.kind == kind)
}
