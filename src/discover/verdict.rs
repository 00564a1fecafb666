//! What the search's findings amount to: nothing, a name, several that tie, or something unknown.

use super::judge::Fitted;
use super::model;
use super::report::Verdict;
use super::search::{self, Found, Judged, Lack};
use super::window::{self, Window};

/// p below which a lack of fit counts.
const MISFIT: f64 = 0.01;
/// The same where no effect was found: to call physics unknown takes more than one odd trial.
const UNKNOWN: f64 = 0.002;
/// Share of the base's excess that may remain under a named set, and the same where slow residuals are sure of it.
const REMAINS: f64 = 0.05;
const REMAINS_SURELY: f64 = 0.02;
/// p below which slow residuals say that a set leaves something (it is ten times smaller than it says, since the trials
/// that are furthest off are left out of account).
const SLOW: f64 = 0.04;
/// Excess below this share of the noise floor (mean square) is too small to speak of.
pub const SLIGHT: f64 = 0.03;

/// The verdict, and why, for people.
pub fn verdict(found: &Found, judged: &Judged, windows: &[Window]) -> (Verdict, String) {
    let Some(best) = found.champion else {
        return if misfits(found, judged, windows) {
            (
                Verdict::Unknown,
                "there is misfit, and no set in the library explains it on held-out trials".into(),
            )
        } else {
            (Verdict::None, "the base model explains the data to its noise floor".into())
        };
    };
    let model = &found.fits[best];
    let names = model.names().join(" + ");
    if let Some(what) = remains(found, best, judged, windows) {
        return (Verdict::Unknown, format!("the best set in the library, {names}, {what}"));
    }
    if found.rivals.len() < 2 {
        return (Verdict::Named, format!("{names} explains the data to its noise floor"));
    }
    let drags = |i: &usize| found.fits[*i].set.iter().any(|e| e.opposes_motion);
    let against = match found.rivals.iter().all(drags) {
        true => "a force against the velocity, its law not identified: ",
        false => "",
    };
    let count = found.rivals.len();
    let reason = format!("{against}{count} sets explain the data equally well; {names} is the simplest");
    (Verdict::Ambiguous, reason)
}

/// Share of the base's excess over the noise floor that a model leaves; `None` where there is none to speak of.
pub fn unexplained(base: &Fitted, model: &Fitted, judged: &Judged, windows: &[Window]) -> Option<f64> {
    let (excess, _) = judged.expected.misfit_of(base, windows);
    let (left, _) = judged.expected.misfit_of(model, windows);
    (excess > SLIGHT).then(|| (left / excess).clamp(0.0, 1.0))
}

/// Whether the base model leaves anything.
fn misfits(found: &Found, judged: &Judged, windows: &[Window]) -> bool {
    let (base, lack, expected) = (&found.base, &found.base_lack, judged.expected);
    let (excess, _) = expected.misfit_of(base, windows);
    let (_, slow_p) = expected.slow_misfit(base, windows, judged.noise.unit());
    let shots = window::shooting(windows);
    model::astray(windows, &base.pass) >= search::SEVERAL
        || (lack.tested.p < UNKNOWN && (excess > SLIGHT || !window::leaping(windows)))
        || (!shots && search::far(expected.above(base, windows)))
        || lack.is_much(expected.total())
        || (!shots && slow_p < search::PLAIN)
}

/// What the best set does wrong, in words, if it leaves more than a little of what the base leaves: by the noise floor, by
/// what could be added in trial after trial, by windows that it leads astray, or by what is slow.
fn remains(found: &Found, best: usize, judged: &Judged, windows: &[Window]) -> Option<String> {
    let (base, model, expected) = (&found.base, &found.fits[best], judged.expected);
    let lack: &Lack = found.lacks[best].as_ref().unwrap_or(&found.base_lack);
    let shots = window::shooting(windows);
    let (base_excess, _) = expected.misfit_of(base, windows);
    let (excess, p) = expected.misfit_of(model, windows);
    let sure_of_base = found.base_lack.sure().max(base_excess * expected.total());
    let by_floor = if !shots && p < MISFIT && excess > SLIGHT { excess / base_excess.max(1e-9) } else { 0.0 };
    let much = lack.is_much(expected.total());
    let by_signs = if lack.tested.p < MISFIT || much { lack.sure() / sure_of_base.max(1e-9) } else { 0.0 };
    let far = !shots && search::far(expected.above(model, windows));
    let unit = judged.noise.unit();
    let (slow, slow_p) = expected.slow_misfit(model, windows, unit);
    let (base_slow, _) = expected.slow_misfit(base, windows, unit);
    let by_slow = slow / base_slow.max(sure_of_base).max(1e-9);
    let (astray, base_astray) = (model::astray(windows, &model.pass), model::astray(windows, &base.pass));
    let percent = |share: f64| 100.0 * share.min(1.0);
    if (lack.tested.p < MISFIT || far || much) && by_floor.max(by_signs) > REMAINS {
        return Some(match by_floor > by_signs {
            true => format!("leaves {:.0} % of the excess error", percent(by_floor)),
            false => format!("lacks in trial after trial {:.0} % of what was missing", percent(by_signs)),
        });
    }
    if astray >= search::SEVERAL && astray as f64 > REMAINS * base_astray as f64 {
        return Some(format!("leads {astray} stretches of motion astray ({base_astray} without it)"));
    }
    let slow_left =
        (slow_p < SLOW && by_slow > REMAINS) || (slow_p < search::PLAIN && by_slow > REMAINS_SURELY);
    let text = || format!("leaves {:.0} % of the error that changes slowly along trials", percent(by_slow));
    (!shots && slow_left).then(text)
}
