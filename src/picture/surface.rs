//! A performance surface as a picture: its mean, and how sure it is, side by side.

use super::plot::{Heatmap, heatmaps};
use crate::error::Result;
use crate::estimate::Surface;
use crate::estimate::surface::grid;
use crate::world::latent::FACTORS;

/// A place to mark.
#[derive(Clone, Debug, PartialEq)]
pub struct Mark {
    /// Shown in the legend.
    pub name: String,
    /// Density (kg/m^2), friction, restitution.
    pub latents: [f64; 3],
}

/// Mean and standard deviation of the surface over its first two factors (over its only one, a strip), with the
/// points it was found at. A third factor stays at the surface's base.
pub fn surface_svg(surface: &Surface, marks: &[Mark]) -> Result<String> {
    let predictor = surface.predictor()?;
    let axes = &surface.axes[..surface.axes.len().min(2)];
    // A single factor: the other axis is one of the others, over which nothing changes.
    let other = (0..FACTORS.len()).rev().find(|i| *i != axes[0].index()).unwrap_or(0);
    let (first, second) = (axes[0].index(), axes.get(1).map_or(other, |a| a.index()));
    let base = surface.base;
    let values = |k: usize| -> Vec<f64> {
        match axes.get(k) {
            Some(axis) => {
                grid(std::slice::from_ref(axis), base, CELLS).iter().map(|l| l[axis.index()]).collect()
            }
            None => vec![base[second]],
        }
    };
    let (x, y) = (values(0), values(1));
    let at = |a: f64, b: f64| {
        let mut latents = base;
        (latents[first], latents[second]) = (a, b);
        predictor.at(latents)
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

/// Cells along each axis: finer than any length scale the surrogate may have.
const CELLS: usize = 41;
/// Lines of equal value, where the map is wide enough for them.
const CONTOURS: usize = 7;

fn label_of(factor: usize) -> String {
    let factor = &FACTORS[factor];
    format!("{}, {}", factor.name, factor.unit)
}
