//! Trials of a diagnosis as the report shows them: under their own names, with the trajectories of the first body.

use super::document::DiagnosisDocument;
use crate::inference::report::TrialResiduals;
use crate::inference::report::plot_tables::column;

/// Trials with trajectories, and their names.
pub struct ReportedTrials<'a> {
    document: &'a DiagnosisDocument,
    /// Trials with rows, from the largest error of the base model to the smallest.
    order: Vec<&'a TrialResiduals>,
}

/// A trajectory: of the observations and by both models.
pub struct TrialTrajectory {
    /// s
    pub times: Vec<f64>,
    /// m
    pub measured: Vec<[f64; 2]>,
    /// Measured minus simulated, m: by the base and the extended model.
    pub residuals: [Vec<[f64; 2]>; 2],
    /// Predictive standard deviations of both, m; NaN if unknown.
    pub sds: [Vec<[f64; 2]>; 2],
    /// Index at which each piece begins.
    starts: Vec<usize>,
}

impl<'a> ReportedTrials<'a> {
    pub fn of(document: &'a DiagnosisDocument) -> ReportedTrials<'a> {
        let diagnosis = &document.diagnosis;
        let order = diagnosis.paths.launches.iter().filter(|l| !l.rows.is_empty());
        let error = |l: &TrialResiduals| {
            let of = |name: &str| column(&diagnosis.paths.columns, &l.rows, name);
            let residuals = [of("before_x"), of("before_y")].concat();
            let squares: Vec<f64> = residuals.iter().filter(|v| v.is_finite()).map(|v| v * v).collect();
            squares.iter().sum::<f64>() / squares.len().max(1) as f64
        };
        let mut order: Vec<(f64, &TrialResiduals)> = order.map(|l| (error(l), l)).collect();
        order.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.trial.cmp(&b.1.trial)));
        let order = order.into_iter().map(|(_, l)| l).collect();
        ReportedTrials { document, order }
    }

    /// Number of trials that the diagnosis used.
    pub fn count(&self) -> usize {
        self.document.diagnosis.paths.launches.len()
    }

    /// The trial with the median error and, if another, the one with the largest; with their roles.
    pub fn examples(&self) -> Vec<(&'static str, &'a TrialResiduals)> {
        let Some(worst) = self.order.first() else { return Vec::new() };
        let median = self.order[self.order.len() / 2];
        let both = [("Median trial", median), ("Largest error", *worst)];
        both.into_iter().take(if self.order.len() > 1 { 2 } else { 1 }).collect()
    }

    /// The user's name of a trial, as in "trial 7" or "throw seven".
    pub fn name(&self, trial: usize) -> String {
        let diagnosis = &self.document.diagnosis;
        let used = diagnosis.launches.iter().find(|l| l.trial == trial).map(|l| l.name.as_str());
        let odd = diagnosis.odd_trials.iter().find(|o| o.trial == trial).map(|o| o.name.as_str());
        match used.or(odd).filter(|n| !n.is_empty()) {
            Some(name) if name.parse::<f64>().is_ok() => format!("trial {name}"),
            Some(name) => name.to_string(),
            None => format!("trial {} of the recording", trial + 1),
        }
    }

    /// The trajectory of the first body of a trial.
    pub fn trajectory(&self, trial: &TrialResiduals) -> TrialTrajectory {
        let columns = &self.document.diagnosis.paths.columns;
        let body = columns.iter().position(|c| c == "body");
        let is_first = |row: &&Vec<Option<f64>>| body.is_none_or(|b| row.get(b) == trial.rows[0].get(b));
        let rows: Vec<Vec<Option<f64>>> = trial.rows.iter().filter(is_first).cloned().collect();
        let of = |name: &str| column(columns, &rows, name);
        let pairs = |x: &str, y: &str| of(x).into_iter().zip(of(y)).map(|(x, y)| [x, y]).collect::<Vec<_>>();
        let pieces = of("stretch");
        let starts = (0..pieces.len()).filter(|i| *i == 0 || pieces[*i] != pieces[i - 1]);
        TrialTrajectory {
            times: of("t"),
            measured: pairs("x", "y"),
            residuals: [pairs("before_x", "before_y"), pairs("after_x", "after_y")],
            sds: [pairs("sd_before_x", "sd_before_y"), pairs("sd_after_x", "sd_after_y")],
            starts: starts.collect(),
        }
    }
}

impl TrialTrajectory {
    /// Positions by the base (0) or extended (1) model, in pieces that begin anew.
    pub fn simulated(&self, model: usize) -> Vec<Vec<[f64; 2]>> {
        let at = |i: usize| [0, 1].map(|k| self.measured[i][k] - self.residuals[model][i][k]);
        let ends = self.starts.iter().skip(1).copied().chain([self.measured.len()]);
        self.starts.iter().zip(ends).map(|(from, to)| (*from..to).map(at).collect()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::diagnosis::document::tests::named;

    #[test]
    fn trials_have_the_names_of_the_recording() {
        let document = named();
        let trials = ReportedTrials::of(&document);
        assert_eq!(
            [0, 1, 2, 5].map(|t| trials.name(t)),
            ["throw one", "throw seven", "trial 9", "trial 6 of the recording"]
        );
        let examples: Vec<usize> = trials.examples().iter().map(|(_, t)| t.trial).collect();
        assert_eq!(examples, [1, 2]);
    }

    #[test]
    fn simulated_positions_begin_anew_with_each_piece() {
        let mut document = named();
        document.diagnosis.paths.launches[0].rows[3][2] = Some(1.0);
        let trials = ReportedTrials::of(&document);
        let trajectory = trials.trajectory(&document.diagnosis.paths.launches[0]);
        let pieces: Vec<usize> = trajectory.simulated(0).iter().map(Vec::len).collect();
        assert_eq!(pieces, [3, 1, 2]);
        assert!((trajectory.simulated(0)[0][1][1] - (0.01 - 0.03)).abs() < 1e-12);
    }
}
