//! Designs: which experiment would tell the most about a question, under what is believed of the world.
//!
//! Of candidate actions, each is done in simulation in worlds drawn from the belief; what those worlds show tells the answers
//! of a question apart, or does not. The expected information is the mutual information between the answer and what would be
//! seen, in nats: how many, over what is known already, an experiment is expected to bring.
//!
//! Sources: Lindley 1956 (expected information as the worth of an experiment); Chaloner and Verdinelli 1995, section 2; nested
//! Monte Carlo: Ryan 2003, Rainforth et al. 2018; densities of what is seen from draws by shrunk kernels: West 1993.
//!
//! Differences from the source: what two trials of the same action differ by, since a hand trembles, counts as noise as much as the
//! camera's: copies of every action are moved a little, or chaos would look like information. The outer sample is a copy that had
//! no say in the inner densities, and no draw has a say in the density of what it shows. Every set of effects that is asked about has as many inner samples.
//!
//! Range of validity: a density from so many draws cannot tell more than about the logarithm of their number, so an action that tells all
//! there is to tell under a broad belief is not told from one that tells still more; measure it, and ask again.
//!
//! | file | what it does |
//! |---|---|
//! | `config` | what a design is to be |
//! | `costs` | what experiments cost, and what is chosen for it |
//! | `question` | what is asked, and which draws answer it alike |
//! | `worlds` | the draws that stand for a belief |
//! | `shown` | what an action shows in every world, and what a trembling hand makes of it |
//! | `smooth` | what of that follows a world's numbers |
//! | `told` | how likely what one world shows is in another |
//! | `gain` | expected information |
//! | `look` | what candidates tell, and what happens in them |
//! | `narrowed` | how far numbers would be known |
//! | `search` | a design: candidates, a first look, the best looked at closely |
//! | `document` | `iplw.design/1` |

mod config;
mod costs;
mod document;
mod gain;
mod look;
mod narrowed;
mod question;
mod search;
mod shown;
mod smooth;
mod told;
mod worlds;

pub use config::DesignConfig;
pub use costs::{Costs, shown as shown_cost};
pub use document::{DESIGN_FORMAT, DesignDocument, ExperimentRow, document};
pub use gain::{Gain, Labels, gain};
pub use narrowed::Narrowed;
pub use question::Question;
pub use search::{Design, Experiment, design, looks, parts};
