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
//! | `page` | parts of lists |

mod asked;
mod declare;
mod describe;
mod input;
mod once;
mod page;
mod reply;

pub use asked::{Asked, Sent};
pub use declare::{ACT, ADMIN, OPEN, Operation, READ, Weight, at, delete, get, post, put};
pub use describe::{Described, Lead, TOKEN};
pub use input::{Body, Bytes, Id, Input, Kept, Raw};
pub use once::{Keep, Once};
pub use page::Page;
pub use reply::{Content, Media, Output, Reply, Whole};
