//! A report as one HTML file without scripts or external resources, for screens of any size, print and dark mode.
//!
//! All text is escaped. Pictures are inline SVG by this crate's own functions, in the tokens' colours, so that they follow the theme.

mod contents;
mod writer;

pub use contents::{Block, HtmlReport, Section, ShareBar, Tone};

use super::svg::escape;
use super::theme::{TOKENS_CSS, picture_css};
use writer::HtmlWriter;

impl HtmlReport {
    /// The whole page.
    pub fn to_html(&self) -> String {
        let mut page = HtmlWriter::default();
        page.report(self);
        format!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
             <meta http-equiv=\"Content-Security-Policy\" content=\"{CONTENT_SECURITY_POLICY}\">\n\
             <meta name=\"color-scheme\" content=\"light dark\">\n<title>{title}</title>\n\
             <style>\n{TOKENS_CSS}{STYLE}{pictures}</style>\n</head>\n<body>\n<main class=\"report\">\n{body}</main>\n</body>\n</html>\n",
            title = escape(&self.title),
            pictures = picture_css(),
            body = page.out,
        )
    }
}

/// Content security policy: nothing is loaded and no script runs.
const CONTENT_SECURITY_POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'";

/// Style of a report; all rules are below `.report`, so that the page can embed it.
const STYLE: &str = include_str!("report/style.css");

#[cfg(test)]
mod tests {
    use resvg::usvg::roxmltree::Document;

    use super::*;

    fn of(blocks: Vec<Block>) -> String {
        let sections = vec![Section::new("h", blocks)];
        HtmlReport { title: "t".into(), lead: "l".into(), sections, ..HtmlReport::default() }.to_html()
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
        let bar = ShareBar { name: bad(), share: 0.4, text: bad(), chosen: true };
        let blocks = vec![
            Block::Text(bad()),
            Block::Code(bad()),
            Block::KeyValues(vec![(bad(), bad())]),
            Block::Table { columns: vec![bad()], rows: vec![vec![bad()]], note: bad() },
            Block::Details { summary: bad(), blocks: vec![Block::Text(bad())] },
            Block::Law { formula: bad(), values: vec![bad()] },
            Block::Stat { value: bad(), label: bad(), judgement: bad(), tone: Tone::Good },
            Block::Bars(vec![bar]),
            Block::List(vec![bad()]),
            Block::Caption(bad()),
            Block::MotionLegend,
            Block::Card { heading: bad(), blocks: vec![] },
            Block::Columns { main: true, columns: vec![vec![Block::Text(bad())], vec![]] },
        ];
        let html = HtmlReport {
            title: bad(),
            kicker: bad(),
            lead: bad(),
            opening: blocks.clone(),
            sections: vec![Section::folded(&bad(), &bad(), blocks)],
        }
        .to_html();
        assert!(!html.contains("<script") && !html.contains("<img src=x"), "{html}");
        assert_eq!(html.matches("&lt;script&gt;alert(1)").count(), 6 + 2 * 20);
        body(&html);
    }

    /// Pictures are inline, follow the theme, and names in them are escaped.
    #[test]
    fn pictures_are_inline_in_the_colours_of_the_theme() {
        use crate::picture::{Style, scene_svg};
        let mut scene = crate::picture::scene::tests::hall();
        scene.bodies[0].name = "</title><script>alert(1)</script>".into();
        let svg = scene_svg(&scene, &Style::default());
        let html = of(vec![Block::Svg { svg, caption: "the hall".into() }]);
        assert!(!html.contains("<script") && html.contains("<svg"));
        for link in ["http://www.w3.org/1999", "https://", "@import", "<link", "<?xml"] {
            assert!(!html.contains(link), "{link}");
        }
        assert!(html.contains("[fill=\"#fefefe\" i] { fill: var(--scene); }"));
        body(&html);
    }

    /// Folded sections have a list of contents whose links lead to them.
    #[test]
    fn folded_sections_are_listed() {
        let sections = ["One & two", "Three"].map(|h| Section::folded(h, "", vec![Block::Text("x".into())]));
        let html = HtmlReport { sections: sections.to_vec(), ..HtmlReport::default() }.to_html();
        for id in ["one-two", "three"] {
            assert!(
                html.contains(&format!("href=\"#{id}\"")) && html.contains(&format!("<details id=\"{id}\""))
            );
        }
    }
}
