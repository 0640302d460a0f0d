//! The parts of which a page is made: frame, headings, contents, notes, figures and tables.

use maud::{DOCTYPE, Markup, PreEscaped, html};

use crate::figures::Figure;

const STYLE: &str = include_str!("../page.css");

/// Returns a self-contained page with a title and a content.
pub(crate) fn document(title: &str, content: &Markup) -> String {
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { (title) }
                style { (PreEscaped(STYLE)) }
            }
            body { main { h1 { (title) } (contents(&content.0)) (content) } }
        }
    }
    .into_string()
}

/// Beginning and end of a heading's id, and end of the heading.
pub(crate) const HEADING: [&str; 3] = ["<h2 id=\"", "\">", "</h2>"];

/// A heading that the contents of the page lead to.
pub(crate) fn heading(title: &str) -> Markup {
    let letter = |c: char| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '-' };
    let id: String = title.chars().map(letter).collect();
    html! { h2 id=(id.trim_matches('-')) { (title) } }
}

/// Links to the headings of a page.
fn contents(page: &str) -> Markup {
    let headings = page.split(HEADING[0]).skip(1).filter_map(|rest| {
        let (id, rest) = rest.split_once(HEADING[1])?;
        Some((id, rest.split_once(HEADING[2])?.0))
    });
    html! {
        nav aria-label="Contents" {
            @for (i, (id, title)) in headings.enumerate() {
                @if i > 0 { " \u{b7} " }
                a href={ "#" (id) } { (PreEscaped(title)) }
            }
        }
    }
}

pub(crate) fn notes(notes: &[String]) -> Markup {
    html! {
        @if !notes.is_empty() {
            div.notes { ul { @for note in notes { li { (note) } } } }
        }
    }
}

pub(crate) fn drawing(figure: &Figure) -> Markup {
    // The XML declaration before the first tag is left out, because the page declares its own encoding.
    let svg = figure.svg.find("<svg").map_or("", |start| &figure.svg[start..]);
    html! {
        figure {
            div role="img" aria-label=(figure.title) { (PreEscaped(svg)) }
            figcaption { (figure.caption) " " a href={ "figures/" (figure.name) ".csv" } { "Its numbers as CSV" } "." }
        }
    }
}

/// A table with a caption, which says what its cells are.
pub(crate) fn table(title: &str, header: &[String], rows: &[Vec<String>]) -> Markup {
    html! {
        div.scroll {
            table {
                caption { (title) }
                thead { tr { @for cell in header { th scope="col" { (cell) } } } }
                tbody {
                    @for row in rows {
                        tr {
                            @for (i, cell) in row.iter().enumerate() {
                                @if i == 0 { th scope="row" { (cell) } } @else { td { (cell) } }
                            }
                        }
                    }
                }
            }
        }
    }
}

pub(crate) fn words(cells: &[&str]) -> Vec<String> {
    cells.iter().map(|cell| (*cell).to_owned()).collect()
}
