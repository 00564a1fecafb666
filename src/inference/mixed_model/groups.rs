//! Groups of the mixed model: rotates and whitens residuals, so that their covariance is diagonal plus low
//! rank.
//!
//! Residual and Jacobian of a segment are projected on the smoothing polynomials (or, with few observations,
//! kept as they are); noise is whitened, and the covariance of the trial discrepancy diagonalised. These
//! coordinates are the same for every model. The covariance is then diag(1 + discrepancy^2 variance) +
//! group-level effects + segment-level effects, in units of the noise. Nuisances are integrated out
//! (restricted likelihood with a flat prior of the initial state in *observed* coordinates, the same for every
//! candidate).
//!
//! Source: restricted likelihood (Patterson and Thompson, Biometrika 58 (1971) 545; in the form log det V + log det N'V^-1 N:
//! Harville, J. Am. Stat. Assoc. 72 (1977) 320), model discrepancy as a Gaussian process (Kennedy and O'Hagan, J. R. Stat.
//! Soc. B 63 (2001) 425).

use std::borrow::Cow;

use nalgebra::{DMatrix, DVector};

use crate::error::Result;
use crate::inference::dynamics::Impact;
use crate::inference::mixed_model::coordinates::{SegmentCoordinates, WhiteNuisances, orthonormalise};
use crate::inference::mixed_model::random_design::{RandomDesign, RandomEffect};
use crate::inference::model::{Linearization, SegmentData};
use crate::inference::segment::Segment;

/// A group of observations with a common scale: all measured segments of a trial, or one engine-simulated
/// segment.
#[derive(Clone, Debug)]
pub struct Group {
    /// Index of the trial.
    pub trial: usize,
    /// One block per segment; segments are correlated by group-level effects only.
    pub blocks: Vec<SegmentBlock>,
    /// Whether it has random effects: measured segments do.
    pub has_random_effects: bool,
}

/// A segment in a group, in coordinates of white noise and uncorrelated discrepancy. The nuisances are projected out of all
/// columns by least squares.
#[derive(Clone, Debug)]
pub struct SegmentBlock {
    /// Index of the segment.
    pub segment: usize,
    /// Residual.
    pub residual: DVector<f64>,
    /// Variance of the unit trial discrepancy, by coordinate.
    pub gp_variance: DVector<f64>,
    /// Derivatives by parameters, then by perturbations.
    pub jacobian: DMatrix<f64>,
    /// Group-level random-effect columns (accelerations, scales), for one standard deviation.
    pub z_group: DMatrix<f64>,
    pub z_group_effects: Vec<RandomEffect>,
    /// Segment-level random-effect columns, for one standard deviation.
    pub z_segment: DMatrix<f64>,
    pub z_segment_effects: Vec<RandomEffect>,
    /// Orthonormal basis of the responses to nuisances.
    pub nuisances: DMatrix<f64>,
    /// Log determinant of the noise covariance.
    pub log_det_noise: f64,
}

impl SegmentBlock {
    /// Number of coordinates beside those that the nuisances take.
    pub fn count(&self) -> usize {
        self.nuisances.nrows() - self.nuisances.ncols()
    }

    /// Residual after a step of the parameters.
    pub fn residual_at(&self, step: &DVector<f64>) -> DVector<f64> {
        &self.residual - &self.jacobian * step
    }

    /// Variances of noise and trial discrepancy, by coordinate; `discrepancy`: its standard deviation.
    pub fn variances(&self, discrepancy: f64) -> DVector<f64> {
        self.gp_variance.map(|variance| 1.0 + discrepancy * discrepancy * variance)
    }

    /// C'V^-1 C of some columns C under noise and trial discrepancy, with the log determinant of V; nuisances are integrated
    /// out under a flat prior.
    pub fn products(&self, columns: &DMatrix<f64>, discrepancy: f64) -> (DMatrix<f64>, f64) {
        let mut log_det = self.log_det_noise;
        let root = self.variances(discrepancy).map(|variance| {
            log_det += variance.ln();
            variance.sqrt().recip()
        });
        let scaled =
            |of: &DMatrix<f64>| DMatrix::from_fn(of.nrows(), of.ncols(), |i, k| root[i] * of[(i, k)]);
        let (columns, nuisances) = (scaled(columns), scaled(&self.nuisances));
        let mut products = gram(&columns);
        let (basis, log_norms) = orthonormalise(&nuisances);
        let along = basis.tr_mul(&columns);
        products -= along.tr_mul(&along);
        log_det += 2.0 * log_norms;
        (products, log_det)
    }

    /// Columns in orthonormal coordinates of the complement of the nuisances.
    pub fn complement(&self, mut columns: DMatrix<f64>) -> DMatrix<f64> {
        if self.nuisances.ncols() > 0 {
            self.nuisances.clone().qr().q_tr_mul(&mut columns);
        }
        columns.rows(self.nuisances.ncols(), self.count()).into_owned()
    }
}

/// Products of all pairs of columns.
fn gram(columns: &DMatrix<f64>) -> DMatrix<f64> {
    let n = columns.ncols();
    let mut out = DMatrix::zeros(n, n);
    for j in 0..n {
        for i in 0..=j {
            let product = columns.column(i).dot(&columns.column(j));
            (out[(i, j)], out[(j, i)]) = (product, product);
        }
    }
    out
}

/// Block of a segment. `more`: columns after those of parameters and perturbations, in its coordinates; `scale`: its residual
/// standard deviation relative to the noise.
fn segment_block(
    (w, segment): (usize, &Segment),
    coordinates: &SegmentCoordinates,
    linearization: &Linearization,
    design: &RandomDesign,
    (more, scale): (Option<&DMatrix<f64>>, f64),
) -> Option<SegmentBlock> {
    let scales = [scale / linearization.irls_scale, 1.0 / linearization.irls_scale];
    let nuisances = coordinates.white_nuisances(&linearization.nuisance_jacobian, scales)?;
    let impact_errors = linearization.impact.map_or(0, |_| 2);
    let beside = DMatrix::from_fn(linearization.residual.len(), impact_errors + 1, |i, k| match k {
        _ if k == impact_errors => linearization.residual[i],
        _ => impact_error_response(segment, linearization, linearization.impact, k, i),
    });
    let project = |columns: DMatrix<f64>| {
        let along = nuisances.basis.tr_mul(&columns);
        columns - &nuisances.basis * along
    };
    let jacobian = project(coordinates.white(&linearization.jacobian, scales));
    let beside = project(coordinates.white(&beside, scales));
    // Further columns have no pseudo-observations.
    let more = more.map(|more| project(more.clone().resize_vertically(jacobian.nrows(), 0.0)));
    let all = jacobian.iter().chain(beside.iter()).chain(more.iter().flat_map(|more| more.iter()));
    if all.into_iter().any(|v| !v.is_finite()) {
        return None;
    }
    let columns = BlockColumns { jacobian, beside, more };
    Some(columns.into_block((w, segment), design, coordinates, nuisances))
}

/// Columns of a block: of a linearization, of impact errors and the residual, and further ones.
struct BlockColumns {
    jacobian: DMatrix<f64>,
    beside: DMatrix<f64>,
    more: Option<DMatrix<f64>>,
}

impl BlockColumns {
    /// Splits the columns into parameters, group-level and segment-level random effects.
    fn into_block(
        self,
        (w, segment): (usize, &Segment),
        design: &RandomDesign,
        coordinates: &SegmentCoordinates,
        nuisances: WhiteNuisances,
    ) -> SegmentBlock {
        let m = self.jacobian.nrows();
        let parameters = design.parameter_count;
        let parameter = |k: usize| self.jacobian.column(k).into_owned();
        let acceleration = |k: usize| parameter(parameters + k);
        let mut own: Vec<(RandomEffect, DVector<f64>)> = Vec::new();
        let mut group_level: Vec<(RandomEffect, DVector<f64>)> = Vec::new();
        let flies = segment.kind.is_airborne();
        for (k, (place, fresh)) in design.accelerations.iter().enumerate() {
            let effect = RandomEffect::Acceleration(*place);
            match fresh {
                true if flies => own.push((effect, acceleration(k))),
                true => (),
                false if flies => group_level.push((effect, acceleration(k))),
                false => group_level.push((effect, DVector::zeros(m))),
            }
        }
        if flies && coordinates.may_be_reset_by_contact(segment) {
            let renewed = design.contact_resets.iter().enumerate();
            own.extend(
                renewed
                    .map(|(k, (c, plausible))| (RandomEffect::ContactReset(k), parameter(*c) * *plausible)),
            );
        }
        let residual = self.beside.ncols() - 1;
        own.extend((0..residual).map(|k| (RandomEffect::ImpactNoise, self.beside.column(k).into_owned())));
        for sizes in &design.amplitude_directions {
            let all = sizes.iter().fold(DVector::zeros(m), |all, (k, size)| all + parameter(*k) * *size);
            group_level.push((RandomEffect::Scale, all));
        }
        let beside = |of: &[(RandomEffect, DVector<f64>)]| DMatrix::from_fn(m, of.len(), |i, k| of[k].1[i]);
        let names = |of: &[(RandomEffect, DVector<f64>)]| of.iter().map(|o| o.0).collect();
        SegmentBlock {
            segment: w,
            residual: self.beside.column(residual).into_owned(),
            z_group: beside(&group_level),
            z_group_effects: names(&group_level),
            z_segment: beside(&own),
            z_segment_effects: names(&own),
            gp_variance: coordinates.gp_variances(m),
            nuisances: nuisances.basis,
            log_det_noise: nuisances.log_det_noise,
            jacobian: self.fixed_effects(design),
        }
    }

    /// Columns of parameters, perturbations beside the random accelerations, and further ones.
    fn fixed_effects(self, design: &RandomDesign) -> DMatrix<f64> {
        let columns = self.jacobian.remove_columns(design.parameter_count, design.acceleration_count);
        let Some(more) = self.more else { return columns };
        let before = columns.ncols();
        let mut out = columns.resize_horizontally(before + more.ncols(), 0.0);
        out.columns_mut(before, more.ncols()).copy_from(&more);
        out
    }
}

/// Response of row `i` to an impact error along the normal (0) or tangent (1), of the size of the approach
/// speed.
pub fn impact_error_response(
    segment: &Segment,
    linearization: &Linearization,
    impact: Option<Impact>,
    way: usize,
    i: usize,
) -> f64 {
    let Some(met) = impact else { return 0.0 };
    let Some(point) = segment.observations.get(i / 2) else { return 0.0 };
    let [nx, ny] = met.direction;
    let along = [[nx, ny], [-ny, nx]][way][i % 2];
    (point.time - met.time).max(0.0)
        * along
        * met.shares[point.body]
        * met.approach
        * linearization.weights[i / 2]
        * linearization.irls_scale
}

/// Groups of all trials. `linearization`: linearization of a segment with columns for parameters, then
/// [`nuisance_accelerations`](super::random_design::nuisance_accelerations), then perturbations; `more`: further columns of a
/// segment in its coordinates; `scales`: of each segment's residuals, in units of the noise.
pub fn groups<'l>(
    data: &SegmentData,
    coordinates: &[SegmentCoordinates],
    linearizations: &[Linearization],
    more: impl Fn(usize) -> Option<Cow<'l, DMatrix<f64>>>,
    design: &RandomDesign,
    scales: &[f64],
) -> Result<Option<Vec<Group>>> {
    let mut out: Vec<Group> = Vec::new();
    for (w, segment) in data.segments.iter().enumerate().filter(|(w, _)| scales[*w].is_finite()) {
        data.progress.check_stop()?;
        let (linearization, more) = (&linearizations[w], more(w));
        let columns = (more.as_deref(), scales[w]);
        let Some(block) = segment_block((w, segment), &coordinates[w], linearization, design, columns) else {
            if linearization.residual.iter().all(|r| r.is_finite()) {
                continue;
            }
            return Ok(None);
        };
        let differs = !segment.kind.uses_engine();
        match out.last_mut() {
            Some(last) if last.trial == segment.trial && last.has_random_effects && differs => {
                last.blocks.push(block)
            }
            _ => out.push(Group { trial: segment.trial, blocks: vec![block], has_random_effects: differs }),
        }
    }
    Ok(Some(out))
}

/// Derivative of a block's coordinates beside the nuisances by the observed positions of its segment, 1/m (coordinates, two per
/// observation).
pub fn observation_jacobian(
    block: &SegmentBlock,
    (segment, coordinates): (&Segment, &SegmentCoordinates),
    linearization: &Linearization,
    scale: f64,
) -> DMatrix<f64> {
    let (rows, observed) = (linearization.residual.len(), 2 * segment.observations.len());
    let by = DMatrix::from_fn(rows, observed, |i, k| if i == k { linearization.weights[i / 2] } else { 0.0 });
    block.complement(coordinates.white(&by, [scale, 0.0]))
}

impl Group {
    /// Squared residual after a step of the parameters, in units of the noise.
    pub fn square_at(&self, step: &DVector<f64>) -> f64 {
        self.blocks.iter().map(|b| b.residual_at(step).norm_squared()).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Nuisances without prior are the limit of a large prior variance.
    #[test]
    fn nuisances_are_integrated_out() {
        let wave = |k: usize| libm::sin(1.7 * k as f64);
        let nuisances = DMatrix::from_fn(6, 2, |i, k| wave(5 + 11 * k + 3 * i)).qr().q();
        let block = SegmentBlock {
            segment: 0,
            residual: DVector::zeros(6),
            gp_variance: DVector::from_fn(6, |i, _| 1.0 / (1 + i) as f64),
            jacobian: DMatrix::zeros(6, 0),
            z_group: DMatrix::zeros(6, 0),
            z_group_effects: Vec::new(),
            z_segment: DMatrix::zeros(6, 0),
            z_segment_effects: Vec::new(),
            nuisances: nuisances.clone(),
            log_det_noise: 0.3,
        };
        let columns = DMatrix::from_fn(6, 3, |i, k| wave(40 + 7 * i + k));
        let (products, log_det) = block.products(&columns, 1.5);
        let covariance = DMatrix::from_diagonal(&block.variances(1.5));
        let own = [&columns, &covariance].map(|of| block.complement(of.clone()));
        let within = block.complement(own[1].transpose());
        let expected = own[0].tr_mul(&within.clone().cholesky().unwrap().solve(&own[0]));
        assert!((&products - &expected).amax() < 1e-9, "{products} for {expected}");
        assert!((log_det - 0.3 - within.determinant().ln()).abs() < 1e-9);
        let wide = covariance + &nuisances * nuisances.transpose() * 1e9;
        assert!((products - columns.tr_mul(&wide.cholesky().unwrap().solve(&columns))).amax() < 1e-6);
    }
}
