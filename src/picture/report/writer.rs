//! Writes the body of a report as HTML that is XML too.

use std::fmt::Write;

use super::contents::{Block, HtmlReport, Section, ShareBar, Tone};
use crate::picture::svg::escape;

/// Number of folded sections from which a list of contents is written.
const MIN_LISTED_SECTIONS: usize = 2;

#[derive(Default)]
pub struct HtmlWriter {
    pub out: String,
}

impl HtmlWriter {
    /// Title, first screen, contents and sections.
    pub fn report(&mut self, report: &HtmlReport) {
        self.out.push_str("<header>\n");
        if !report.kicker.is_empty() {
            let _ = writeln!(self.out, "<p class=\"kicker\">{}</p>", escape(&report.kicker));
        }
        let _ = write!(self.out, "<h1>{}</h1>\n<div class=\"lead\">\n", escape(&report.title));
        paragraphs(&mut self.out, &report.lead);
        self.out.push_str("</div>\n</header>\n");
        self.blocks(&report.opening);
        let sections: Vec<&Section> = report.sections.iter().filter(|s| !s.blocks.is_empty()).collect();
        self.contents(&sections);
        sections.iter().for_each(|section| self.section(section));
    }

    fn contents(&mut self, sections: &[&Section]) {
        let folded: Vec<&&Section> = sections.iter().filter(|s| s.folded).collect();
        if folded.len() < MIN_LISTED_SECTIONS {
            return;
        }
        self.out.push_str("<nav class=\"contents\" aria-label=\"Contents\">\n");
        for section in folded {
            let (id, heading) = (anchor(&section.heading), escape(&section.heading));
            let _ = writeln!(self.out, "<a href=\"#{id}\">{heading}</a>");
        }
        self.out.push_str("</nav>\n");
    }

    fn section(&mut self, section: &Section) {
        let (id, heading) = (anchor(&section.heading), escape(&section.heading));
        if section.folded {
            let note = match section.note.is_empty() {
                true => String::new(),
                false => format!(" <span class=\"note\">{}</span>", escape(&section.note)),
            };
            let _ = writeln!(self.out, "<details id=\"{id}\">\n<summary><h2>{heading}</h2>{note}</summary>");
            self.blocks(&section.blocks);
            self.out.push_str("</details>\n");
        } else {
            let _ = writeln!(self.out, "<section id=\"{id}\">\n<h2>{heading}</h2>");
            self.blocks(&section.blocks);
            self.out.push_str("</section>\n");
        }
    }

    fn blocks(&mut self, blocks: &[Block]) {
        for block in blocks {
            match block {
                Block::Text(text) => paragraphs(&mut self.out, text),
                Block::Table { columns, rows, note } => self.table(columns, rows, note),
                Block::Svg { svg, caption } => self.picture(svg, caption),
                Block::KeyValues(pairs) => self.key_values(pairs),
                Block::Details { summary, blocks } => {
                    let _ = writeln!(self.out, "<details>\n<summary>{}</summary>", escape(summary));
                    self.blocks(blocks);
                    self.out.push_str("</details>\n");
                }
                Block::Code(code) => {
                    let _ = writeln!(self.out, "<pre><code>{}</code></pre>", escape(code));
                }
                Block::Law { formula, values } => self.law(formula, values),
                Block::Stat { value, label, judgement, tone } => self.stat(value, label, judgement, *tone),
                Block::Bars(bars) => self.bars(bars),
                Block::List(items) => {
                    let items: String = items.iter().map(|i| format!("<li>{}</li>\n", escape(i))).collect();
                    let _ = writeln!(self.out, "<ul>\n{items}</ul>");
                }
                Block::Caption(text) => {
                    let _ = writeln!(self.out, "<p class=\"caption\">{}</p>", escape(text));
                }
                Block::MotionLegend => self.out.push_str(MOTION_LEGEND),
                Block::Card { heading, blocks } => {
                    let _ = writeln!(self.out, "<div class=\"card\">\n<h3>{}</h3>", escape(heading));
                    self.blocks(blocks);
                    self.out.push_str("</div>\n");
                }
                Block::Columns { main, columns } => {
                    let class = if *main { "columns main-side" } else { "columns" };
                    let _ = writeln!(self.out, "<div class=\"{class}\">");
                    for column in columns {
                        self.out.push_str("<div>\n");
                        self.blocks(column);
                        self.out.push_str("</div>\n");
                    }
                    self.out.push_str("</div>\n");
                }
            }
        }
    }

    fn key_values(&mut self, pairs: &[(String, String)]) {
        self.out.push_str("<dl>\n");
        for (key, value) in pairs {
            let _ = writeln!(self.out, "<dt>{}</dt><dd>{}</dd>", escape(key), escape(value));
        }
        self.out.push_str("</dl>\n");
    }

    fn law(&mut self, formula: &str, values: &[String]) {
        let _ = write!(self.out, "<p class=\"law\"><code>{}</code>", escape(formula));
        for value in values {
            let _ = write!(self.out, " <span class=\"values\">{}</span>", escape(value));
        }
        self.out.push_str("</p>\n");
    }

    fn stat(&mut self, value: &str, label: &str, judgement: &str, tone: Tone) {
        let _ = write!(
            self.out,
            "<div class=\"stat\">\n<div class=\"value\">{}</div>\n<div class=\"label\">{}</div>\n",
            escape(value),
            escape(label)
        );
        if !judgement.is_empty() {
            let _ =
                writeln!(self.out, "<span class=\"badge {}\">{}</span>", class_of(tone), escape(judgement));
        }
        self.out.push_str("</div>\n");
    }

    fn bars(&mut self, bars: &[ShareBar]) {
        self.out.push_str("<div class=\"bars\">\n");
        for bar in bars {
            let chosen = if bar.chosen { " class=\"chosen\"" } else { "" };
            let _ = writeln!(
                self.out,
                "<span{chosen}>{}</span><svg class=\"track\" viewBox=\"0 0 100 10\" preserveAspectRatio=\"none\" \
                 aria-hidden=\"true\"><rect width=\"{:.1}\" height=\"10\"/></svg><span class=\"share\">{}</span>",
                escape(&bar.name),
                100.0 * bar.share.clamp(0.0, 1.0),
                escape(&bar.text)
            );
        }
        self.out.push_str("</div>\n");
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
        let _ = writeln!(self.out, "<figure>\n<div class=\"picture\" tabindex=\"0\">{}</div>", svg.trim());
        self.caption(caption);
        self.out.push_str("</figure>\n");
    }

    fn caption(&mut self, text: &str) {
        if !text.is_empty() {
            let _ = writeln!(self.out, "<figcaption>{}</figcaption>", escape(text));
        }
    }
}

const MOTION_LEGEND: &str = "<ul class=\"legend\">\n<li class=\"measured\">measured</li>\n\
    <li class=\"simulated\">simulation before</li>\n<li class=\"extended\">extended simulation</li>\n</ul>\n";

fn class_of(tone: Tone) -> &'static str {
    match tone {
        Tone::Plain => "tone-plain",
        Tone::Good => "tone-good",
        Tone::Warn => "tone-warn",
        Tone::Bad => "tone-bad",
    }
}

/// The id of a section with this heading.
fn anchor(heading: &str) -> String {
    let words = heading.split(|c: char| !c.is_ascii_alphanumeric()).filter(|w| !w.is_empty());
    words.map(str::to_ascii_lowercase).collect::<Vec<_>>().join("-")
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn right_aligns_columns_of_numbers() {
        let rows: Vec<Vec<String>> =
            [["a", "0.5 ± 0.1", "-"], ["b", "-3e-9", "yes"]].map(|r| r.map(String::from).to_vec()).to_vec();
        assert_eq!([0, 1, 2].map(|c| is_numeric_column(&rows, c)), [false, true, false]);
    }

    #[test]
    fn anchors_are_words() {
        assert_eq!(anchor("Estimates by trial (m/s)"), "estimates-by-trial-m-s");
    }
}
