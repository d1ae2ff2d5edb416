//! The tables of the README that list plugins and views.

use super::{check, code, read, table};

/// The page with another first table under a heading.
fn with_table(page: &str, heading: &str, table: &str) -> String {
    let start = page.find(&format!("{heading}\n")).unwrap_or_else(|| panic!("there is a heading {heading}"));
    let start = start + page[start..].find("\n|").expect("a table follows it") + 1;
    let end = page[start..].find("\n\n").map_or(page.len(), |end| start + end + 2);
    format!("{}{table}{}", &page[..start], &page[end..])
}

#[test]
fn the_readme_lists_plugins_and_views_as_they_are_defined() {
    let plugin =
        |kind: &rcs_runtime::ProcessType| vec![code(kind.def().plugin), kind.def().summary.to_owned()];
    let view = |view: &ocu_views::ViewType| vec![view.name.to_owned(), view.summary.to_owned()];
    let plugins: Vec<_> = rcs_plugins::all().iter().map(plugin).collect();
    let views: Vec<_> = ocu_views::all().iter().map(view).collect();
    let page = with_table(&read("README.md"), "## Processes", &table(&["plugin", "does"], &plugins));
    check("README.md", &with_table(&page, "## Views", &table(&["view", "shows"], &views)));
}

#[test]
fn a_table_is_replaced_and_the_rest_of_the_page_stays() {
    let page = "# X\n\n## A\n\nText.\n\n| a |\n| --- |\n| 1 |\n\nMore.\n";
    assert_eq!(with_table(page, "## A", "| b |\n\n"), "# X\n\n## A\n\nText.\n\n| b |\n\nMore.\n");
}
