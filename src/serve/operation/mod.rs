//! How something a client can ask for is declared: once, beside its function, for every transport.
//!
//! | file | what it is |
//! |---|---|
//! | `declare` | the declaration: name, method, path, what is taken and answered, the function |
//! | `describe` | what the declaration says in the OpenAPI document |
//! | `asked` | what came in, over whatever transport |
//! | `input` | what functions take: an id, a body, a page, bytes |
//! | `reply` | what functions give |
//! | `once` | requests that may be repeated |
//! | `events` | answers that come by and by |
//! | `page` | parts of lists |

mod asked;
mod declare;
mod describe;
mod events;
mod input;
mod once;
mod page;
mod reply;

pub use asked::{Asked, Sent};
pub use declare::{ACT, ADMIN, OPEN, Operation, READ, at, delete, get, post, put};
pub use describe::{Described, Lead, TOKEN};
pub use events::{Events, Next, Told};
pub use input::{Body, Bytes, Id, Input, Kept, LastEvent, Raw};
pub use once::{Keep, Once};
pub use page::Page;
pub use reply::{Content, Media, Output, Reply, Whole};
