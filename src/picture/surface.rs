//! A performance surface as a picture: mean and standard deviation side by side.

use super::plot::{Heatmap, heatmaps};
use crate::error::Result;
use crate::estimate::PerformanceSurface;
use crate::estimate::surface::grid;
use crate::world::latent::FACTORS;

/// A point to mark.
#[derive(Clone, Debug, PartialEq)]
pub struct Mark {
    /// Shown in the legend.
    pub name: String,
    /// Density (kg/m^2), friction, restitution.
    pub latents: [f64; 3],
}

/// Mean and standard deviation of the surface over its first two factors (a strip for a single one), with its design points. A third
/// factor is held at the surface's base.
pub fn surface_svg(surface: &PerformanceSurface, marks: &[Mark]) -> Result<String> {
    let predictor = surface.predictor()?;
    let axes = &surface.axes[..surface.axes.len().min(2)];
    // With a single factor, the other axis is a factor on which the surface doesn't depend.
    let other = (0..FACTORS.len()).rev().find(|i| *i != axes[0].index()).unwrap_or(0);
    let (first, second) = (axes[0].index(), axes.get(1).map_or(other, |a| a.index()));
    let base = surface.base;
    let values = |k: usize| -> Vec<f64> {
        match axes.get(k) {
            Some(axis) => grid(std::slice::from_ref(axis), base, CELLS_PER_AXIS)
                .iter()
                .map(|l| l[axis.index()])
                .collect(),
            None => vec![base[second]],
        }
    };
    let (x, y) = (values(0), values(1));
    let at = |a: f64, b: f64| {
        let mut latents = base;
        (latents[first], latents[second]) = (a, b);
        predictor.predict(latents)
    };
    let panel = |title: &str, label: &str, of: &dyn Fn(f64, f64) -> f64| Heatmap {
        title: title.into(),
        x_label: label_of(first),
        y_label: label_of(second),
        value_label: label.into(),
        values: y.iter().map(|b| x.iter().map(|a| of(*a, *b)).collect()).collect(),
        x: x.clone(),
        y: y.clone(),
        marks: marks.iter().map(|m| (m.latents[first], m.latents[second], m.name.clone())).collect(),
        dots: surface.points.iter().map(|p| (p.latents[first], p.latents[second])).collect(),
        contours: CONTOURS,
    };
    let title = format!(
        "{}: performance in a related environment over the latents of the simulation ({} route, {} points)",
        surface.family,
        surface.route.name(),
        surface.points.len()
    );
    Ok(heatmaps(
        &title,
        &[
            panel("mean", "AUCCESS, 1", &|a, b| at(a, b).mean.clamp(0.0, 1.0)),
            panel("standard deviation", "AUCCESS, 1", &|a, b| at(a, b).sd),
        ],
    ))
}

/// Cells along each axis: finer than the length scales of the surrogate.
const CELLS_PER_AXIS: usize = 41;
/// Number of contour lines.
const CONTOURS: usize = 7;

fn label_of(factor: usize) -> String {
    let factor = &FACTORS[factor];
    format!("{}, {}", factor.name, factor.unit)
}
