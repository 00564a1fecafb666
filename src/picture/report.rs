//! A report as one HTML file: no script, no outside resource, readable on a phone, on paper and in the dark.
//!
//! All text is escaped. A picture is set into the page as it is if it is well-formed SVG without scripts or
//! links, with its ids made unique; else as an image, in which a browser runs and loads nothing.

use std::fmt::Write;

use base64::Engine;
use resvg::usvg::roxmltree::{Document, Node};

use super::svg::escape;

/// What a report says.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Report {
    /// Title of the page.
    pub title: String,
    /// The answer in a sentence or a few; blank lines part paragraphs.
    pub lead: String,
    /// In order.
    pub sections: Vec<Section>,
}

/// A heading and what stands under it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Section {
    pub heading: String,
    pub blocks: Vec<Block>,
}

/// One piece of a section.
#[derive(Clone, Debug, PartialEq)]
pub enum Block {
    /// Plain text; blank lines part paragraphs.
    Text(String),
    /// Rows of cells; cells that read as numbers are set right. The note stands under it if not empty.
    Table { columns: Vec<String>, rows: Vec<Vec<String>>, note: String },
    /// A picture as an SVG document; the caption stands under it if not empty.
    Svg { svg: String, caption: String },
    /// Names and their values.
    KeyValues(Vec<(String, String)>),
    /// Folded away until asked for; printed unfolded where the browser can.
    Details { summary: String, blocks: Vec<Block> },
    /// Set in a fixed width as it is.
    Code(String),
}

impl Report {
    /// The whole page.
    pub fn to_html(&self) -> String {
        let mut page = Page::default();
        for section in &self.sections {
            let _ = write!(page.out, "<section>\n<h2>{}</h2>\n", escape(&section.heading));
            page.blocks(&section.blocks);
            page.out.push_str("</section>\n");
        }
        let mut lead = String::new();
        paragraphs(&mut lead, &self.lead);
        format!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
             <meta http-equiv=\"Content-Security-Policy\" content=\"{POLICY}\">\n\
             <meta name=\"color-scheme\" content=\"light dark\">\n<title>{title}</title>\n\
             <style>\n{CSS}</style>\n</head>\n<body>\n<main>\n<header>\n<h1>{title}</h1>\n<div class=\"lead\">\n{lead}</div>\n</header>\n\
             {}</main>\n</body>\n</html>\n",
            page.out,
            title = escape(&self.title),
        )
    }
}

/// Nothing is loaded and nothing runs, whatever a picture might hold.
const POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'; img-src data:";

#[derive(Default)]
struct Page {
    out: String,
    /// Number of pictures so far; keeps their ids apart.
    pictures: usize,
}

impl Page {
    fn blocks(&mut self, blocks: &[Block]) {
        for block in blocks {
            match block {
                Block::Text(text) => paragraphs(&mut self.out, text),
                Block::Table { columns, rows, note } => self.table(columns, rows, note),
                Block::Svg { svg, caption } => self.picture(svg, caption),
                Block::KeyValues(pairs) => {
                    self.out.push_str("<dl>\n");
                    for (key, value) in pairs {
                        let _ = writeln!(self.out, "<dt>{}</dt><dd>{}</dd>", escape(key), escape(value));
                    }
                    self.out.push_str("</dl>\n");
                }
                Block::Details { summary, blocks } => {
                    let _ = write!(self.out, "<details>\n<summary>{}</summary>\n", escape(summary));
                    self.blocks(blocks);
                    self.out.push_str("</details>\n");
                }
                Block::Code(code) => {
                    let _ = writeln!(self.out, "<pre><code>{}</code></pre>", escape(code));
                }
            }
        }
    }

    fn table(&mut self, columns: &[String], rows: &[Vec<String>], note: &str) {
        let right: Vec<bool> = (0..columns.len()).map(|c| is_numeric_column(rows, c)).collect();
        let class = |c: usize| if right.get(c) == Some(&true) { " class=\"n\"" } else { "" };
        self.out.push_str("<figure>\n<div class=\"wide\"><table>\n<thead><tr>");
        for (c, name) in columns.iter().enumerate() {
            let _ = write!(self.out, "<th scope=\"col\"{}>{}</th>", class(c), escape(name));
        }
        self.out.push_str("</tr></thead>\n<tbody>\n");
        for row in rows {
            self.out.push_str("<tr>");
            for (c, cell) in row.iter().enumerate() {
                let _ = write!(self.out, "<td{}>{}</td>", class(c), escape(cell));
            }
            self.out.push_str("</tr>\n");
        }
        self.out.push_str("</tbody>\n</table></div>\n");
        self.caption(note);
        self.out.push_str("</figure>\n");
    }

    fn picture(&mut self, svg: &str, caption: &str) {
        self.pictures += 1;
        let _ = writeln!(
            self.out,
            "<figure>\n<div class=\"wide picture\">{}</div>",
            match inlined(svg, &format!("p{}-", self.pictures)) {
                Some(inline) => inline,
                None => format!(
                    "<img alt=\"{}\" src=\"data:image/svg+xml;base64,{}\"/>",
                    escape(caption),
                    base64::engine::general_purpose::STANDARD.encode(svg)
                ),
            }
        );
        self.caption(caption);
        self.out.push_str("</figure>\n");
    }

    fn caption(&mut self, text: &str) {
        if !text.is_empty() {
            let _ = writeln!(self.out, "<figcaption>{}</figcaption>", escape(text));
        }
    }
}

fn paragraphs(out: &mut String, text: &str) {
    let text = text.replace("\r\n", "\n");
    for paragraph in text.split("\n\n").map(str::trim).filter(|p| !p.is_empty()) {
        let _ = writeln!(out, "<p>{}</p>", escape(paragraph));
    }
}

/// Whether a column's cells are numbers, intervals or blanks: something to set right.
fn is_numeric_column(rows: &[Vec<String>], column: usize) -> bool {
    let cells: Vec<&str> = rows.iter().filter_map(|r| r.get(column)).map(|c| c.trim()).collect();
    let numeric = |c: &&str| {
        c.chars().any(|d| d.is_ascii_digit())
            && c.chars().all(|d| d.is_ascii_digit() || " .,+-−–±×%[]()eE/∞".contains(d))
    };
    let blank = |c: &&str| matches!(*c, "" | "-" | "–" | "—" | "∞");
    cells.iter().any(numeric) && cells.iter().all(|c| numeric(c) || blank(c))
}

/// The picture as an element of the page, its ids prefixed; `None` if it must not be one.
fn inlined(svg: &str, prefix: &str) -> Option<String> {
    let document = Document::parse(svg).ok()?;
    let root = document.root_element();
    // HTML reads comments, CDATA and instructions differently from XML: what is checked must be what is read.
    if svg[root.range()].contains("<!") || svg[root.range()].contains("<?") {
        return None;
    }
    if root.tag_name().name() != "svg" || !root.descendants().all(|n| is_harmless(&n)) {
        return None;
    }
    let source = &svg[root.range()];
    let offset = root.range().start;
    // Every place where an id stands: found by the parser, changed in the source.
    let mut changes: Vec<(std::ops::Range<usize>, String)> = Vec::new();
    for attribute in root.descendants().flat_map(|n| n.attributes().collect::<Vec<_>>()) {
        let range = attribute.range_value();
        let raw = svg.get(range.clone())?;
        let value = match attribute.name() {
            "id" => format!("{prefix}{raw}"),
            "href" => raw.strip_prefix('#').map(|id| format!("#{prefix}{id}"))?,
            "aria-labelledby" | "aria-describedby" => {
                raw.split_whitespace().map(|id| format!("{prefix}{id}")).collect::<Vec<_>>().join(" ")
            }
            _ if raw.contains("url(") => raw.replace("url(#", &format!("url(#{prefix}")),
            _ => continue,
        };
        changes.push((range.start - offset..range.end - offset, value));
    }
    changes.sort_by_key(|(range, _)| range.start);
    let mut out = String::with_capacity(source.len());
    let mut done = 0;
    for (range, value) in changes {
        out.push_str(source.get(done..range.start)?);
        out.push_str(&value);
        done = range.end;
    }
    out.push_str(source.get(done..)?);
    Some(out)
}

/// Whether an element may stand in the page itself: known drawing elements of the SVG namespace only, no event
/// handlers, no styles, links only to ids of the same picture.
fn is_harmless(node: &Node) -> bool {
    if !node.is_element() {
        return node.is_text();
    }
    const KNOWN: [&str; 20] = [
        "svg",
        "g",
        "title",
        "desc",
        "defs",
        "rect",
        "circle",
        "ellipse",
        "line",
        "polyline",
        "polygon",
        "path",
        "text",
        "tspan",
        "clipPath",
        "linearGradient",
        "radialGradient",
        "stop",
        "use",
        "animateTransform",
    ];
    let name = node.tag_name();
    name.namespace() == Some("http://www.w3.org/2000/svg")
        && KNOWN.contains(&name.name())
        && node.attributes().all(|a| {
            let value = a.value();
            let outside = value.replace("url(#", "").contains("url(")
                || (a.name() == "href" && !value.starts_with('#'))
                || (a.name() == "attributeName" && value != "transform");
            !a.name().to_lowercase().starts_with("on") && !matches!(a.name(), "style" | "class") && !outside
        })
}

const CSS: &str = "\
:root { --paper: #ffffff; --ink: #1f2328; --soft: #59636e; --line: #d5dae0; --tint: #f5f7f9; --accent: #0b62a8; }
@media (prefers-color-scheme: dark) {
  :root { --paper: #15181c; --ink: #e6e9ed; --soft: #9aa4af; --line: #343a42; --tint: #1e2329; --accent: #6cb6ff; }
}
* { box-sizing: border-box; }
body { margin: 0; background: var(--paper); color: var(--ink);
  font: 16px/1.55 system-ui, -apple-system, 'Segoe UI', Roboto, sans-serif; overflow-wrap: break-word; }
main { max-width: 60rem; margin: 0 auto; padding: 1.5rem 1rem 4rem; }
h1 { font-size: 1.75rem; line-height: 1.2; margin: 0.5rem 0 0.75rem; }
h2 { font-size: 1.25rem; margin: 2.25rem 0 0.5rem; padding-top: 1rem; border-top: 1px solid var(--line); }
p { margin: 0.5rem 0; max-width: 46rem; white-space: pre-line; }
.lead { font-size: 1.1rem; border-left: 4px solid var(--accent); padding-left: 0.9rem; }
.lead:not(:has(p)) { display: none; }
figure { margin: 1rem 0; }
figcaption { color: var(--soft); font-size: 0.875rem; margin-top: 0.35rem; max-width: 46rem; }
.wide { overflow-x: auto; }
.picture { background: #ffffff; border: 1px solid var(--line); border-radius: 6px; padding: 0.5rem;
  text-align: center; }
.picture > svg, .picture > img { max-width: 100%; height: auto; display: block; margin: 0 auto; }
table { border-collapse: collapse; font-size: 0.925rem; font-variant-numeric: tabular-nums; }
th, td { text-align: left; padding: 0.3rem 0.8rem; border-bottom: 1px solid var(--line); vertical-align: top; }
th { border-bottom: 2px solid var(--line); white-space: nowrap; }
tbody tr:nth-child(even) { background: var(--tint); }
.n { text-align: right; white-space: nowrap; }
dl { display: grid; grid-template-columns: minmax(7rem, max-content) 1fr; gap: 0.2rem 1.2rem; margin: 0.75rem 0; }
dt { color: var(--soft); }
dd { margin: 0; font-variant-numeric: tabular-nums; min-width: 0; }
details { margin: 0.75rem 0; border: 1px solid var(--line); border-radius: 6px; padding: 0.4rem 0.9rem; }
summary { cursor: pointer; color: var(--accent); }
pre { background: var(--tint); border: 1px solid var(--line); border-radius: 6px; padding: 0.75rem;
  overflow-x: auto; font-size: 0.85rem; line-height: 1.4; }
code { font-family: ui-monospace, SFMono-Regular, Menlo, Consolas, monospace; }
@media (max-width: 34rem) { dl { grid-template-columns: 1fr; } dt { margin-top: 0.4rem; } }
@media print {
  :root { --paper: #ffffff; --ink: #000000; --soft: #444444; --line: #bbbbbb; --tint: #f5f5f5; --accent: #000000; }
  main { max-width: none; padding: 0; }
  figure, tr, pre { break-inside: avoid; }
  h2 { break-after: avoid; }
  details::details-content { content-visibility: visible; block-size: auto; }
  .wide, pre { overflow: visible; }
  pre { white-space: pre-wrap; }
}
";

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;

    const CLIPPED: &str = r##"<?xml version="1.0"?><svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"
        width="10" height="10" aria-labelledby="a b"><title id="a">x</title><desc id="b">y</desc>
        <defs><clipPath id="c"><rect width="5" height="5"/></clipPath><linearGradient id='g'/></defs>
        <g clip-path="url(#c)"><use href="#d"/><use xlink:href="#d"/><rect id="d" fill="url(#g)" width="9" height="9"/></g></svg>"##;

    fn of(blocks: Vec<Block>) -> String {
        let sections = vec![Section { heading: "h".into(), blocks }];
        Report { title: "t".into(), lead: "l".into(), sections }.to_html()
    }
    fn svg(text: &str) -> Block {
        Block::Svg { svg: text.into(), caption: String::new() }
    }
    /// The body is written so that it is XML too; returns it for counting.
    fn body(html: &str) -> &str {
        let body = &html[html.find("<body>").unwrap()..html.find("</html>").unwrap()];
        Document::parse(body).unwrap_or_else(|e| panic!("{e}\n{body}"));
        body
    }

    #[test]
    fn everything_is_escaped() {
        let bad = || "</title></td><script>alert(1)</script><img src=x onerror=y> & \"'".to_string();
        let html = Report {
            title: bad(),
            lead: bad(),
            sections: vec![Section {
                heading: bad(),
                blocks: vec![
                    Block::Text(bad()),
                    Block::Code(bad()),
                    Block::KeyValues(vec![(bad(), bad())]),
                    Block::Table { columns: vec![bad()], rows: vec![vec![bad()]], note: bad() },
                    Block::Details { summary: bad(), blocks: vec![Block::Text(bad())] },
                    Block::Svg { svg: bad(), caption: bad() },
                ],
            }],
        }
        .to_html();
        assert!(!html.contains("<script") && !html.contains("<img src=x"), "{html}");
        assert_eq!(html.matches("&lt;script&gt;alert(1)").count(), 15);
        body(&html);
    }

    #[test]
    fn ids_of_several_pictures_do_not_clash() {
        let html = of(vec![svg(CLIPPED), Block::Details { summary: "s".into(), blocks: vec![svg(CLIPPED)] }]);
        let document = Document::parse(body(&html)).unwrap();
        let ids: Vec<&str> = document.descendants().filter_map(|n| n.attribute("id")).collect();
        let known: HashSet<&str> = ids.iter().copied().collect();
        assert_eq!((ids.len(), known.len()), (10, 10), "{ids:?}");
        let mut used = 0;
        for a in document.descendants().flat_map(|n| n.attributes().collect::<Vec<_>>()) {
            let one = match (a.name(), a.value()) {
                ("href", v) => vec![&v[1..]],
                ("aria-labelledby", v) => v.split(' ').collect(),
                (_, v) if v.starts_with("url(#") => vec![&v[5..v.len() - 1]],
                _ => continue,
            };
            used += one.len();
            assert!(one.iter().all(|id| known.contains(id)), "{one:?} among {known:?}");
        }
        assert_eq!(used, 12);
    }

    #[test]
    fn pictures_that_could_act_become_images() {
        let wrap = |inner: &str| {
            format!("<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"9\" height=\"9\">{inner}</svg>")
        };
        let acting = [
            "<script>alert(1)</script>",
            "<rect onclick=\"alert(1)\"/>",
            "<foreignObject><p/></foreignObject>",
            "<style>body { display: none }</style>",
            "<image href=\"http://example.org/x.png\"/>",
            "<use href=\"http://example.org/x.svg#a\"/>",
            "<rect fill=\"url(http://example.org/a)\"/>",
            "<rect style=\"fill: url(http://example.org/a)\"/>",
            "<a href=\"javascript:alert(1)\"><rect/></a>",
            "<!--><script>alert(1)</script>-->",
            "<title><![CDATA[><script>alert(1)</script>]]></title>",
            "<g",
        ];
        for inner in acting {
            let html = of(vec![svg(&wrap(inner))]);
            assert!(html.contains("<img alt=\"\" src=\"data:image/svg+xml;base64,"), "{inner}");
            assert!(!html.contains(inner), "{inner}");
            body(&html);
        }
        assert!(of(vec![svg(&wrap("<rect width=\"9\" height=\"9\"/>"))]).contains("<rect width"));
    }

    #[test]
    fn our_own_pictures_stand_in_the_page_and_nothing_is_loaded() {
        use crate::picture::{Style, animation_svg, plot, scene_svg};
        let scene = crate::picture::scene::tests::hall();
        let track = crate::trajectory::Track {
            name: "red".into(),
            x: vec![1.0, 2.0],
            y: vec![1.0, 2.0],
            ..Default::default()
        };
        let film = crate::trajectory::Trajectory {
            times: vec![0.0, 1.0],
            bodies: vec![track],
            ..Default::default()
        };
        let line = plot::Series { name: "a".into(), points: vec![(0.0, 1.0), (1.0, 2.0)], band: None };
        let html = of(vec![
            svg(&scene_svg(&scene, &Style::default())),
            svg(&animation_svg(&scene, &film, &Style::default())),
            svg(&plot::lines("t", "x", "y", &[line])),
        ]);
        assert_eq!(html.matches("<svg ").count(), 3);
        assert!(!html.contains("<img"));
        let without_names = html.replace("http://www.w3.org/", "");
        for link in ["http://", "https://", "@import", "<link", "<script", "src="] {
            assert!(!without_names.contains(link), "{link}");
        }
        body(&html);
    }

    #[test]
    fn numbers_are_set_right_and_words_left() {
        let rows: Vec<Vec<String>> =
            [["a", "0.5 ± 0.1", "-"], ["b", "-3e-9", "yes"]].map(|r| r.map(String::from).to_vec()).to_vec();
        assert_eq!([0, 1, 2].map(|c| is_numeric_column(&rows, c)), [false, true, false]);
    }
}
