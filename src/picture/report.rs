//! A report as one HTML file without scripts or external resources, for screens of any size, print and dark mode.
//!
//! All text is escaped. Pictures are embedded as data URLs, so browsers run and load nothing in them, and their ids can't clash.

use std::fmt::Write;

use base64::Engine;

use super::svg::escape;

/// Contents of a report.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct HtmlReport {
    /// Title of the page.
    pub title: String,
    /// Summary in a few sentences; blank lines separate paragraphs.
    pub lead: String,
    /// Sections in order.
    pub sections: Vec<Section>,
}

/// A heading with its blocks.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Section {
    pub heading: String,
    pub blocks: Vec<Block>,
}

/// One piece of a section.
#[derive(Clone, Debug, PartialEq)]
pub enum Block {
    /// Plain text; blank lines separate paragraphs.
    Text(String),
    /// Rows of cells; columns of numbers are right-aligned. The note is shown below unless empty.
    Table { columns: Vec<String>, rows: Vec<Vec<String>>, note: String },
    /// A picture as an SVG document; the caption is shown below unless empty.
    Svg { svg: String, caption: String },
    /// Names and their values.
    KeyValues(Vec<(String, String)>),
    /// Collapsed until opened; printed expanded where the browser supports it.
    Details { summary: String, blocks: Vec<Block> },
    /// Preformatted text in a monospace font.
    Code(String),
}

impl HtmlReport {
    /// The whole page.
    pub fn to_html(&self) -> String {
        let mut page = HtmlWriter::default();
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
             <meta http-equiv=\"Content-Security-Policy\" content=\"{CONTENT_SECURITY_POLICY}\">\n\
             <meta name=\"color-scheme\" content=\"light dark\">\n<title>{title}</title>\n\
             <style>\n{CSS}</style>\n</head>\n<body>\n<main>\n<header>\n<h1>{title}</h1>\n<div class=\"lead\">\n{lead}</div>\n</header>\n\
             {}</main>\n</body>\n</html>\n",
            page.out,
            title = escape(&self.title),
        )
    }
}

/// Content security policy: nothing is loaded and no script runs.
const CONTENT_SECURITY_POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'; img-src data:";

#[derive(Default)]
struct HtmlWriter {
    out: String,
}

impl HtmlWriter {
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
        let _ = writeln!(
            self.out,
            "<figure>\n<div class=\"wide picture\"><img alt=\"{}\" src=\"data:image/svg+xml;base64,{}\"/></div>",
            escape(caption),
            base64::engine::general_purpose::STANDARD.encode(svg)
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

/// Whether all cells of a column are numbers, intervals or blanks, and it should be right-aligned.
fn is_numeric_column(rows: &[Vec<String>], column: usize) -> bool {
    let cells: Vec<&str> = rows.iter().filter_map(|r| r.get(column)).map(|c| c.trim()).collect();
    let numeric = |c: &&str| {
        c.chars().any(|d| d.is_ascii_digit())
            && c.chars().all(|d| d.is_ascii_digit() || " .,+-−–±×%[]()eE/∞".contains(d))
    };
    let blank = |c: &&str| matches!(*c, "" | "-" | "–" | "—" | "∞");
    cells.iter().any(numeric) && cells.iter().all(|c| numeric(c) || blank(c))
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
.picture > img { max-width: 100%; height: auto; display: block; margin: 0 auto; }
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
    use resvg::usvg::roxmltree::Document;

    use super::*;

    fn of(blocks: Vec<Block>) -> String {
        let sections = vec![Section { heading: "h".into(), blocks }];
        HtmlReport { title: "t".into(), lead: "l".into(), sections }.to_html()
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
    fn escapes_all_text() {
        let bad = || "</title></td><script>alert(1)</script><img src=x onerror=y> & \"'".to_string();
        let html = HtmlReport {
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

    /// Scripts, links and ids in a picture have no effect on the page.
    #[test]
    fn embeds_pictures_as_data_urls() {
        use crate::picture::{Style, scene_svg};
        let ours = scene_svg(&crate::picture::scene::tests::hall(), &Style::default());
        for picture in [ours.as_str(), "<svg><script>alert(1)</script></svg>", "<g"] {
            let html = of(vec![svg(picture), svg(picture)]);
            let data: Vec<&str> = html.split("src=\"data:image/svg+xml;base64,").skip(1).collect();
            assert_eq!(data.len(), 2);
            for one in data {
                let bytes = base64::engine::general_purpose::STANDARD.decode(&one[..one.find('"').unwrap()]);
                assert_eq!(bytes.unwrap(), picture.as_bytes());
            }
            assert!(!html.contains("<svg") && !html.contains("<script"));
            for link in ["http://", "https://", "@import", "<link"] {
                assert!(!html.contains(link), "{link}");
            }
            body(&html);
        }
    }

    #[test]
    fn right_aligns_columns_of_numbers() {
        let rows: Vec<Vec<String>> =
            [["a", "0.5 ± 0.1", "-"], ["b", "-3e-9", "yes"]].map(|r| r.map(String::from).to_vec()).to_vec();
        assert_eq!([0, 1, 2].map(|c| is_numeric_column(&rows, c)), [false, true, false]);
    }
}
