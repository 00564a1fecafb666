//! A candidate model, and how the windows' residuals depend on it, by simulation only.
//!
//! `layout`: latents to calibrate and effect terms with their parameters, laid out as one vector. `data`: what is fixed during
//! a diagnosis; `state`: where a fit stands. `moved`: what windows show, and by how much more when a number moves; `engine`: the same of those that a
//! world's engine simulates. `look`: residuals and derivatives in units of the noise, starts projected out; `loss`: how much
//! what went astray counts. `least_squares`: fits. `along`: what happens along fitted paths; `shown`: what
//! windows show, without derivatives.

mod along;
mod data;
mod engine;
mod layout;
mod least_squares;
mod look;
mod loss;
mod moved;
mod shown;
mod state;

pub use along::{impact, paths, pushes};
pub use data::{Data, Frozen};
pub use engine::{freeze, placed, predicted};
pub use layout::{Layout, Slot, Term, What};
pub use least_squares::{Pass, Sums, fit, summed, total};
pub use look::{Look, looks};
pub use loss::losses;
pub use shown::{seen, shown};
pub use state::{Extra, Mode, State};
