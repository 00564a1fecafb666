//! The report of a performance surface: which latent matters, and the surface as a picture.

use serde::Deserialize;

use crate::error::Result;
use crate::estimate::PerformanceSurface;
use crate::number::significant;
use crate::picture::HtmlReport;
use crate::picture::report::{Block, Section, ShareBar};
use crate::picture::surface::surface_svg;

/// How much a latent matters.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct Sensitivity {
    pub factor: String,
    /// Mean magnitude of the partial derivative, AUCCESS per unit.
    pub slope: f64,
    /// The slope times the prior's standard deviation, AUCCESS.
    pub stake: f64,
}

/// The report.
pub fn report(surface: &PerformanceSurface, sensitivities: &[Sensitivity]) -> Result<HtmlReport> {
    let mut order: Vec<&Sensitivity> = sensitivities.iter().collect();
    order.sort_by(|a, b| b.stake.total_cmp(&a.stake));
    let largest = order.first().map_or(1.0, |s| s.stake.max(f64::MIN_POSITIVE));
    let bar = |(i, s): (usize, &&Sensitivity)| ShareBar {
        name: s.factor.clone(),
        share: s.stake / largest,
        text: significant(s.stake, 2),
        chosen: i == 0,
    };
    let bars = vec![
        Block::Bars(order.iter().enumerate().map(bar).collect()),
        Block::Text("AUCCESS lost or won by one standard deviation of the prior.".into()),
    ];
    let next = "Measure the first latent best: an estimation with informative actions that is given this surface chooses actions by what they \
                contribute to performance.";
    let facts = vec![
        Block::card("How much each latent matters", bars),
        Block::card("What to do next", vec![Block::Text(next.into())]),
    ];
    let picture = Block::Svg {
        svg: surface_svg(surface, &[])?,
        caption: "Performance over the latents of the simulation (left) and its standard deviation (right); dots are the points that were \
                  computed."
            .into(),
    };
    let row = |s: &&Sensitivity| vec![s.factor.clone(), significant(s.slope, 3), significant(s.stake, 3)];
    let table = Block::Table {
        columns: ["latent", "AUCCESS per unit", "AUCCESS per standard deviation of the prior"]
            .map(String::from)
            .to_vec(),
        rows: order.iter().map(row).collect(),
        note: String::new(),
    };
    Ok(HtmlReport {
        title: title(surface, &order),
        kicker: format!("Performance surface of {}", surface.family),
        lead: format!(
            "Performance of a simulation with these latents in a related environment with known physics, from {} points on {} tasks.",
            surface.points.len(),
            surface.tasks
        ),
        opening: vec![
            picture,
            Block::Columns { main: false, columns: facts.into_iter().map(|f| vec![f]).collect() },
        ],
        sections: vec![Section::folded("Sensitivities", "as numbers", vec![table])],
    })
}

fn title(surface: &PerformanceSurface, order: &[&Sensitivity]) -> String {
    match order {
        [first, second, ..] if first.stake > 0.0 => {
            let ratio = significant(first.stake / second.stake.max(f64::MIN_POSITIVE), 2);
            format!(
                "For {}, {} matters {ratio} times as much as {}",
                surface.family, first.factor, second.factor
            )
        }
        [only] if only.stake > 0.0 => format!("For {}, {} matters", surface.family, only.factor),
        _ => format!("For {}, no latent matters", surface.family),
    }
}
