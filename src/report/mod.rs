//! Reports of results as HTML pages. Each is a function of the result as JSON, so that the command line, HTTP and the page show the same.
//!
//! | file | contents |
//! |---|---|
//! | `joint_diagnosis` | the same of a mechanism: verdict, laws, joint positions, probabilities |
//! | `diagnosis` | verdict, law, overlay, error and next step, then the evidence |
//! | `estimation`, `posterior`, `plan`, `design`, `surface` | the results of these kinds of jobs |
//! | `learning` | trainings and evaluations |
//! | `general` | any other result as a table |
//! | `words` | names and sentences for readers |

pub mod design;
pub mod diagnosis;
pub mod estimation;
mod general;
pub mod joint_diagnosis;
mod learning;
pub mod plan;
pub mod posterior;
pub mod surface;
pub mod words;

use serde::de::DeserializeOwned;
use serde_json::Value;

use crate::error::{Error, Result};
use crate::estimate::PerformanceSurface;
use crate::inference::mechanism::JOINT_DIAGNOSIS_FORMAT;
use crate::picture::HtmlReport;
use crate::task::Task;
use diagnosis::DiagnosisDocument;

/// A job's result and all that its report needs.
pub struct JobResult<'a> {
    pub kind: &'a str,
    /// The result in a phrase, if there is one.
    pub summary: Option<&'a str>,
    /// The request without large data.
    pub config: &'a Value,
    pub result: &'a Value,
    /// Version of the program that made it.
    pub version: &'a str,
    /// The task of a plan.
    pub task: Option<&'a Task>,
    /// The surface of a surface's job.
    pub surface: Option<&'a PerformanceSurface>,
}

/// The report of a job's result. Fails if an earlier version wrote the result in another form.
pub fn job_report(job: &JobResult) -> Result<HtmlReport> {
    let mut report = match (job.kind, job.surface) {
        ("diagnose", _) if job.result["format"] == JOINT_DIAGNOSIS_FORMAT => {
            joint_diagnosis::report(&parsed(job.result)?)
        }
        ("diagnose", _) => {
            let document: DiagnosisDocument = parsed(job.result)?;
            diagnosis::report(&document, &diagnosis::figures(&document), job.version)
        }
        ("posterior", _) => posterior::report(&parsed(job.result)?),
        ("plan", _) => plan::report(&parsed(job.result)?, job.task),
        ("design", _) => design::report(&parsed(job.result)?),
        ("surface", Some(surface)) => {
            surface::report(surface, &parsed::<Vec<_>>(&job.result["sensitivities"])?)?
        }
        ("iplw", _) => estimation::report(&parsed(job.result)?),
        ("train" | "learn", _) => learning::training(job.summary, job.result),
        ("evaluate", _) => learning::evaluation(job.summary, job.result),
        (kind, _) => general::report(kind, job.summary, job.result),
    };
    report.sections.push(general::settings(job.config));
    Ok(report)
}

fn parsed<T: DeserializeOwned>(result: &Value) -> Result<T> {
    T::deserialize(result).map_err(|e| Error::Refused {
        reason: format!("this result has the form of another version ({e}): repeat the job"),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    /// Results that this version cannot read are refused with the reason; kinds without a report of their own have a general one.
    #[test]
    fn results_of_other_versions_are_refused() {
        let report = |kind, result: &Value| {
            let config = json!({"task": "bowling"});
            let (summary, task, surface) = (None, None, None);
            job_report(&JobResult { kind, summary, config: &config, result, version: "0.1.0", task, surface })
        };
        for kind in ["diagnose", "posterior", "plan", "design", "iplw"] {
            let error = report(kind, &json!({"verdict": "named"})).unwrap_err();
            assert!(
                matches!(error, Error::Refused { .. }) && error.to_string().contains("repeat the job"),
                "{error}"
            );
        }
        let html = report("likelihood", &json!({"parameters": 1})).unwrap().to_html();
        assert!(html.contains("Result: likelihood") && html.contains("<dd>bowling</dd>"));
    }
}
