//! Requests that the command line, HTTP and MCP share, each declared once: a field is an option of the command line, a property of
//! the OpenAPI document, and an argument in Python. Here they are also read and combined; the work itself is done by the modules
//! below.

mod design;
mod diagnosis;
mod estimation;
mod physics;
mod plan;
mod posterior;
mod surface;
mod training;

pub use design::{DesignRequest, design_experiments};
pub use diagnosis::{DiagnosisRequest, TrialFiles};
pub use estimation::{EstimationRequest, RealChoice, RealIn};
pub use physics::{LatentsIn, effects, engine, parse_effect, parse_latents, parse_number, parse_pairs};
pub use plan::{ParameterSource, PlanRequest, TimeLimit};
pub use posterior::{PosteriorRequest, effect_set, set_calibrate};
pub use surface::SurfaceRequest;
pub use training::{TrainingPreset, TrainingRequest, TrainingWorlds};
