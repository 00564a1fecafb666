//! Final estimates of a transfer experiment's arms: as text, as a table of the report, and as CSV.

use iplw::error::Result;
use iplw::experiment::estimate_accuracy::FinalEstimates;
use iplw::experiment::statistics::Summary;
use iplw::experiment::strategies::IDENTIFIABLE_FACTORS;
use iplw::experiment::study::Study;
use iplw::picture::Block;
use iplw::world::latent::FACTORS;

use crate::cli::output;

/// Index of the coefficient of linear drag among the coordinates of an estimate.
const DRAG: usize = 3;

/// Bias and mean absolute error of the identifiable latents, and the mean fitted drag, by arm.
pub fn text(study: &Study, estimates: &[FinalEstimates]) -> String {
    let mut text =
        "\nestimates after the last round: bias with 95 % half-width (mean absolute error)\n".to_string();
    text += &format!(
        "{:<47} {:>12}   {:<32} {:<32} drag, 1/s\n",
        "arm", "interactions", "friction", "restitution"
    );
    for arm in estimates {
        let [friction, restitution] = IDENTIFIABLE_FACTORS.map(|i| factor(study, arm, i));
        let drag = arm.mean(DRAG).show(4);
        text += &format!(
            "{:<47} {:>12.0}   {friction:<32} {restitution:<32} {drag}\n",
            arm.arm, arm.interactions
        );
    }
    text
}

/// The same as a table of the report.
pub fn block(study: &Study, estimates: &[FinalEstimates]) -> Block {
    let row = |arm: &FinalEstimates| {
        let [friction, restitution] = IDENTIFIABLE_FACTORS.map(|i| factor(study, arm, i));
        let interactions = format!("{:.0}", arm.interactions);
        vec![arm.arm.clone(), interactions, friction, restitution, arm.mean(DRAG).show(4)]
    };
    Block::Table {
        columns: ["arm", "real interactions", "friction", "restitution", "drag, 1/s"].map(String::from).to_vec(),
        rows: estimates.iter().map(row).collect(),
        note: "After the last round: bias with the half-width of its 95 % interval over estimates, and the mean absolute \
               error in brackets; mean coefficient of drag, 0 where it is not fitted."
            .into(),
    }
}

/// A row for each arm and seed.
pub fn csv(study: &Study, estimates: &[FinalEstimates]) -> Result<Vec<u8>> {
    let header = ["arm", "seed", FACTORS[0].name, FACTORS[1].name, FACTORS[2].name, "drag"];
    let rows = estimates.iter().flat_map(|arm| {
        study.seeds.iter().zip(&arm.by_seed).map(|(seed, estimate)| {
            let values = estimate.iter().take(header.len() - 2).map(|v| v.to_string());
            [arm.arm.clone(), seed.to_string()].into_iter().chain(values).collect()
        })
    });
    output::csv(&header, rows)
}

/// Bias, the half-width of its interval, and mean absolute error of a factor.
fn factor(study: &Study, arm: &FinalEstimates, i: usize) -> String {
    let truth = &study.hidden.latents;
    let (Some(bias), Some(error)) = (arm.bias(truth, i), arm.error(truth, i)) else { return "-".into() };
    format!("{} ({:.4})", with_half_width(&bias), error.mean)
}

fn with_half_width(bias: &Summary) -> String {
    bias.half_width.map_or(format!("{:+.4}", bias.mean), |w| format!("{:+.4} +- {w:.4}", bias.mean))
}
