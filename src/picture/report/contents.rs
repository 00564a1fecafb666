//! Contents of a report: sections of blocks.

/// Contents of a report.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct HtmlReport {
    /// Title of the page.
    pub title: String,
    /// One small line above the title: of what, from which data.
    pub kicker: String,
    /// Summary in a few sentences; blank lines separate paragraphs.
    pub lead: String,
    /// The first screen, below the summary.
    pub opening: Vec<Block>,
    /// Sections in order, with a list of contents where several are folded; those without blocks are left out.
    pub sections: Vec<Section>,
}

/// A heading with its blocks.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Section {
    pub heading: String,
    /// Shown beside the heading of a folded section.
    pub note: String,
    pub blocks: Vec<Block>,
    /// Whether it is folded until opened; printed expanded.
    pub folded: bool,
}

impl Section {
    /// An unfolded section.
    pub fn new(heading: &str, blocks: Vec<Block>) -> Section {
        Section { heading: heading.into(), blocks, ..Section::default() }
    }

    /// A folded section.
    pub fn folded(heading: &str, note: &str, blocks: Vec<Block>) -> Section {
        Section { note: note.into(), folded: true, ..Section::new(heading, blocks) }
    }
}

/// A judgement, as a colour.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Tone {
    #[default]
    Plain,
    Good,
    Warn,
    Bad,
}

/// One piece of a section.
#[derive(Clone, Debug, PartialEq)]
pub enum Block {
    /// Plain text; blank lines separate paragraphs.
    Text(String),
    /// Rows of cells; columns of numbers are right-aligned. The note is shown below unless empty.
    Table { columns: Vec<String>, rows: Vec<Vec<String>>, note: String },
    /// A picture as an SVG document by this crate; the caption is shown below unless empty.
    Svg { svg: String, caption: String },
    /// Names and their values.
    KeyValues(Vec<(String, String)>),
    /// Collapsed until opened; printed expanded where the browser supports it.
    Details { summary: String, blocks: Vec<Block> },
    /// Preformatted text in a monospace font.
    Code(String),
    /// A formula, and the values of its parameters.
    Law { formula: String, values: Vec<String> },
    /// A number in large type with its explanation, and a judgement unless empty.
    Stat { value: String, label: String, judgement: String, tone: Tone },
    /// Shares from 0 to 1 as bars.
    Bars(Vec<ShareBar>),
    /// Small text of an explanation.
    Caption(String),
    /// Items of a list.
    List(Vec<String>),
    /// The legend of measured, simulated and extended motion.
    MotionLegend,
    /// Blocks with a heading on a card.
    Card { heading: String, blocks: Vec<Block> },
    /// Columns side by side, one below the other on a narrow screen; the first of two is wider if `main` is set.
    Columns { main: bool, columns: Vec<Vec<Block>> },
}

impl Block {
    /// A table with these column heads.
    pub fn table(columns: &[&str], rows: Vec<Vec<String>>, note: &str) -> Block {
        Block::Table { columns: columns.iter().map(|c| c.to_string()).collect(), rows, note: note.into() }
    }

    /// A card.
    pub fn card(heading: &str, blocks: Vec<Block>) -> Block {
        Block::Card { heading: heading.into(), blocks }
    }

    /// Facts beside pictures; side by side where there are no pictures.
    pub fn pictures_and_facts(pictures: Vec<Block>, facts: Vec<Block>) -> Block {
        match pictures.is_empty() {
            true => Block::Columns { main: false, columns: facts.into_iter().map(|f| vec![f]).collect() },
            false => Block::Columns { main: true, columns: vec![pictures, facts] },
        }
    }
}

/// A share as a bar.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ShareBar {
    pub name: String,
    /// From 0 to 1.
    pub share: f64,
    /// The share as text.
    pub text: String,
    /// Whether it is highlighted.
    pub chosen: bool,
}
