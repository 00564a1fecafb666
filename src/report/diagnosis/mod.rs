//! The report of a diagnosis: the verdict with its law, an overlay, the error and the next step on the first screen; the evidence in folded
//! sections.

mod document;
mod evidence_figures;
mod figure;
mod next_step;
mod sections;
mod trial_figures;
mod trials;
mod verdict;

pub use document::DiagnosisDocument;
pub use figure::ReportFigure;

use trials::ReportedTrials;

use crate::picture::{Block, HtmlReport};

/// All figures that a diagnosis has data for, in the order of the report.
pub fn figures(document: &DiagnosisDocument) -> Vec<ReportFigure> {
    let trials = ReportedTrials::of(document);
    let all = [
        trial_figures::overlay(document, &trials),
        evidence_figures::residuals(document, &trials),
        evidence_figures::missing_acceleration(document),
        evidence_figures::impacts(document),
        trial_figures::estimates(document, &trials),
        trial_figures::predictive_check(document),
    ];
    all.into_iter().flatten().collect()
}

/// The report, with the document's [`figures`]; `version`: of the program that made the diagnosis.
pub fn report(document: &DiagnosisDocument, figures: &[ReportFigure], version: &str) -> HtmlReport {
    let (diagnosis, trials) = (&document.diagnosis, ReportedTrials::of(document));
    let of = |name: &str| {
        figures.iter().filter(|f| f.name == name).map(ReportFigure::block).collect::<Vec<Block>>()
    };
    let mut picture = of("overlay");
    if !picture.is_empty() {
        picture.insert(0, Block::MotionLegend);
    }
    let facts =
        [verdict::error(diagnosis), verdict::probabilities(diagnosis), Some(next_step::next_step(document))];
    let facts: Vec<Block> = facts.into_iter().flatten().collect();
    let columns = Block::pictures_and_facts(picture, facts);
    let opening = verdict::laws(document).into_iter().chain([columns]).collect();
    HtmlReport {
        title: verdict::title(diagnosis),
        kicker: kicker(document, &trials, version),
        lead: verdict::explanation(diagnosis),
        opening,
        sections: sections::all(document, &trials, &of),
    }
}

/// The scene, the number of trials, and how to reproduce the diagnosis.
fn kicker(document: &DiagnosisDocument, trials: &ReportedTrials, version: &str) -> String {
    let name = document.extended_scene.name.trim();
    let scene = if name.is_empty() { "a scene".to_string() } else { name.to_string() };
    let count = match trials.count() {
        0 => String::new(),
        1 => ", 1 trial".into(),
        n => format!(", {n} trials"),
    };
    format!("Diagnosis of {scene}{count}, seed {}, iplw {version}", document.diagnosis.seed)
}

#[cfg(test)]
mod tests {
    use super::*;
    use document::tests::{document, named};

    fn html(document: &DiagnosisDocument) -> String {
        report(document, &figures(document), "0.1.0").to_html()
    }

    #[test]
    fn first_screen_names_law_size_quality_and_next_step() {
        let html = html(&named());
        let first = &html[..html.find("<nav class=\"contents\"").unwrap()];
        for text in [
            "The simulation gets one thing wrong: quadratic drag (air resistance)",
            "a = \u{2212}k |v| v",
            "k = 0.2 1/m (95 %: 0.19 to 0.21 1/m)",
            "150 mm \u{2192} 1 mm",
            "down to the measurement noise",
            "Median trial: throw seven",
            "Simulate with extended_scene.json",
        ] {
            assert!(first.contains(text), "{text} is missing in {first}");
        }
        assert!(!html.contains("NaN") && !html.contains("0.00e0"));
    }

    #[test]
    fn reports_have_few_figures_and_folded_sections() {
        let document = named();
        assert!(figures(&document).len() <= 6);
        assert!(report(&document, &[], "0.1.0").sections.iter().all(|s| s.folded));
    }

    /// Every verdict has a title, an explanation and a next step.
    #[test]
    fn every_verdict_has_a_report() {
        use crate::inference::report::Verdict;
        for verdict in Verdict::ALL {
            let mut document = document();
            document.diagnosis.verdict = verdict;
            document.diagnosis.rivals = vec![vec!["wind".into()], vec!["linear_drag".into()]];
            let html = html(&document);
            assert!(html.contains("<h3>What to do next</h3>"), "{verdict:?}");
        }
    }
}
