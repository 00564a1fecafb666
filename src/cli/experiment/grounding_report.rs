//! Report of `iplw experiment grounding`: rows, table and HTML page.

use iplw::experiment::estimators::Estimator;
use iplw::experiment::statistics::Summary;
use iplw::picture::plot::{self, Series};
use iplw::picture::{Block, HtmlReport, Section};
use serde::Serialize;

/// Evaluation of plans in the hidden world after a number of interactions.
#[derive(Serialize)]
pub struct GroundingRow {
    pub way: String,
    /// `None` without measurements.
    pub estimator: Option<Estimator>,
    pub seed: u64,
    pub interactions: usize,
    /// Interactions that solved their task.
    pub solved: usize,
    /// Name, mean, and standard deviation if the estimator has one.
    pub numbers: Vec<(String, f64, Option<f64>)>,
    /// Error of the mean, by parameter.
    pub off: Vec<(String, f64)>,
    pub converged: bool,
    /// Information gain over the prior, nats; `None` for point estimates.
    pub information: Option<f64>,
    pub auccess: f64,
    pub first: f64,
    pub seconds: f64,
}

impl GroundingRow {
    /// Label of the acquisition method and estimator.
    pub fn arm(&self) -> String {
        arm(&self.way, self.estimator)
    }
}

/// Label of an acquisition method and estimator.
pub fn arm(way: &str, estimator: Option<Estimator>) -> String {
    match estimator {
        None | Some(Estimator::Posterior) => way.to_string(),
        Some(other) => format!("{way}, {}", other.name()),
    }
}

/// Rows of one method after a number of interactions, over seeds.
struct GroundingGroup<'a> {
    way: String,
    interactions: usize,
    rows: Vec<&'a GroundingRow>,
}

/// Groups in the order of their first row.
fn groups(rows: &[GroundingRow]) -> Vec<GroundingGroup<'_>> {
    let mut groups: Vec<GroundingGroup> = Vec::new();
    for row in rows {
        let (way, interactions) = (row.arm(), row.interactions);
        match groups.iter_mut().find(|g| g.way == way && g.interactions == interactions) {
            Some(group) => group.rows.push(row),
            None => groups.push(GroundingGroup { way, interactions, rows: vec![row] }),
        }
    }
    groups
}

impl GroundingGroup<'_> {
    fn of(&self, f: impl Fn(&GroundingRow) -> f64) -> Summary {
        Summary::of(&self.rows.iter().map(|r| f(r)).collect::<Vec<_>>())
    }

    /// Difference of AUCCESS from another group, paired by seed.
    fn gain_over(&self, other: &GroundingGroup) -> Summary {
        let of = |row: &&GroundingRow| {
            let theirs = other.rows.iter().find(|o| o.seed == row.seed)?;
            Some(row.auccess - theirs.auccess)
        };
        Summary::of(&self.rows.iter().filter_map(of).collect::<Vec<_>>())
    }

    /// Root mean square errors of the parameters.
    fn errors_text(&self) -> String {
        let off = |(name, _): &(String, f64)| {
            let square =
                |r: &GroundingRow| r.off.iter().find(|o| o.0 == *name).map_or(f64::NAN, |o| o.1.powi(2));
            format!("{name} {:.2e}", self.of(square).mean.sqrt())
        };
        let all: Vec<String> = self.rows[0].off.iter().map(off).collect();
        let converged = self.rows.iter().all(|r| r.converged);
        all.join(", ") + if converged { "" } else { " (not converged)" }
    }

    /// Mean information gain, if all rows have one.
    fn information(&self) -> Option<f64> {
        let all: Option<Vec<f64>> = self.rows.iter().map(|r| r.information).collect();
        Some(Summary::of(&all?).mean)
    }

    /// Table cells, with the difference from the prior.
    fn cells(&self, prior: Option<&GroundingGroup>) -> Vec<String> {
        let auccess = self.of(|r| r.auccess);
        let beyond = prior.filter(|p| p.way != self.way).map(|p| self.gain_over(p));
        let half = |s: &Summary| s.half_width.map_or(String::new(), |w| format!(" +- {w:.3}"));
        vec![
            self.way.clone(),
            self.interactions.to_string(),
            auccess.show(3),
            beyond.map_or(String::new(), |s| format!("{:+.3}{}", s.mean, half(&s))),
            format!("{:.0} %", 100.0 * self.of(|r| r.first).mean),
            format!("{:.1}", self.of(|r| r.solved as f64).mean),
            self.information().map_or(String::new(), |i| format!("{i:.1}")),
            self.errors_text(),
        ]
    }
}

const COLUMNS: [&str; 8] = [
    "method",
    "interactions",
    "AUCCESS",
    "gain over the prior (95 %)",
    "first attempt",
    "solved while measuring",
    "information gain, nats",
    "error",
];

/// Rows as text: means over seeds with standard errors.
pub fn table(rows: &[GroundingRow]) -> String {
    let all = cells(rows);
    let header = COLUMNS.map(String::from).to_vec();
    let wide = |c: usize| all.iter().chain([&header]).map(|row| row[c].len()).max().unwrap_or(0);
    let line = |row: &Vec<String>| {
        let padded = row.iter().enumerate().map(|(c, cell)| format!("{cell:<width$}", width = wide(c)));
        padded.collect::<Vec<_>>().join("  ").trim_end().to_string() + "\n"
    };
    std::iter::once(&header).chain(&all).map(line).collect()
}

fn cells(rows: &[GroundingRow]) -> Vec<Vec<String>> {
    let groups = groups(rows);
    let prior = groups.iter().find(|g| g.way == "prior");
    groups.iter().map(|group| group.cells(prior)).collect()
}

/// The HTML page.
pub fn page(family: &str, set: &[String], rows: &[GroundingRow]) -> String {
    let groups = groups(rows);
    let mut ways: Vec<&str> = Vec::new();
    for group in groups.iter().filter(|g| g.interactions > 0) {
        if !ways.contains(&group.way.as_str()) {
            ways.push(&group.way);
        }
    }
    // Every method starts at the prior.
    let through = |start: Option<f64>, of: &dyn Fn(&GroundingGroup) -> Option<f64>| -> Vec<Series> {
        let series = |way: &&str| {
            let own = groups.iter().filter(|g| g.way == **way);
            let points = own.filter_map(|g| Some((g.interactions as f64, of(g)?)));
            let points = start.map(|y| (0.0, y)).into_iter().chain(points);
            Series { name: way.to_string(), points: points.collect(), ..Series::default() }
        };
        ways.iter().map(series).collect()
    };
    let mean = |g: &GroundingGroup| g.of(|r| r.auccess).mean;
    let at = |way: &str| groups.iter().find(|g| g.way == way).map(mean);
    let mut solved = through(at("prior"), &|g| Some(mean(g)));
    let most = groups.iter().map(|g| g.interactions).max().unwrap_or(0) as f64;
    let flat =
        |y: f64| Series { name: "truth".into(), points: vec![(0.0, y), (most, y)], ..Series::default() };
    solved.extend(at("truth").map(flat));
    let told = through(Some(0.0), &|g| g.information());
    let interactions = "real interactions";
    let svg = |title: &str, unit: &str, series: &[Series], caption: &str| Block::Svg {
        svg: plot::lines(title, interactions, unit, series),
        caption: caption.into(),
    };
    let set = if set.is_empty() { "no effect".to_string() } else { set.join(" + ") };
    let note = "Means over seeds with standard errors; gains over the prior are paired by seed, with 95 % intervals by Student's t.";
    let report = HtmlReport {
        title: format!("Grounding on {family}"),
        lead: format!(
            "Information about latents and {set} from a few real interactions, by acquisition method, and the performance of the resulting \
             plans on unseen tasks of the hidden world."
        ),
        sections: vec![
            Section {
                heading: "Performance of plans".into(),
                blocks: vec![
                    svg("AUCCESS on test tasks", "AUCCESS", &solved, ""),
                    Block::Table {
                        columns: COLUMNS.map(String::from).to_vec(),
                        rows: cells(rows),
                        note: note.into(),
                    },
                ],
                ..Section::default()
            },
            Section {
                heading: "Information gain".into(),
                blocks: vec![svg(
                    "Information gained over the prior",
                    "nats",
                    &told,
                    "For all parameters jointly, from the covariance of samples; not available for point estimates.",
                )],
                ..Section::default()
            },
        ],
        ..HtmlReport::default()
    };
    report.to_html()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(way: &str, seed: u64, interactions: usize, auccess: f64) -> GroundingRow {
        GroundingRow {
            way: way.into(),
            estimator: None,
            seed,
            interactions,
            solved: 1,
            numbers: Vec::new(),
            off: vec![("friction".into(), 0.1)],
            converged: true,
            information: (interactions > 0).then_some(3.25),
            auccess,
            first: 0.5,
            seconds: 0.0,
        }
    }

    #[test]
    fn pairs_differences_by_seed() {
        let rows = [
            row("prior", 1, 0, 0.5),
            row("random", 1, 5, 0.7),
            row("prior", 2, 0, 0.6),
            row("random", 2, 5, 0.9),
        ];
        let text = table(&rows);
        let line = text.lines().find(|l| l.starts_with("random")).unwrap();
        // 0.2 and 0.3: 0.25, and t(1) = 12.706 times its standard error, 0.05.
        for wanted in ["0.800 +- 0.100", "+0.250 +- 0.635", "3.2", "friction 1.00e-1"] {
            assert!(line.contains(wanted), "{wanted}: {line}");
        }
        let page = page("bowling", &[], &rows);
        assert!(
            page.contains("+0.250") && page.matches("<div class=\"picture\"").count() == 2,
            "{}",
            page.len()
        );
    }
}
