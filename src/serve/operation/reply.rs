//! What functions give: a value of the wire, nothing, a status of its own, or bytes of some media type.

use std::io::Write;

use serde::Serialize;
use utoipa::ToSchema;

use super::describe::Described;
use super::events::Events;
use crate::serve::wire::{Array, Bulk, pack};

/// An answer, in no transport's form yet.
pub struct Reply {
    /// HTTP's status.
    pub status: u16,
    /// Where what was made is found.
    pub location: Option<String>,
    /// Whether it was given before, to the same request.
    pub again: bool,
    pub content: Content,
}

/// What an answer holds.
pub enum Content {
    Nothing,
    Value(Box<dyn Whole>),
    /// A value that is JSON already.
    Json(Vec<u8>),
    Media(Media),
    /// From some event on.
    Events(Box<dyn Events>),
}

/// Bytes or text with their media type.
pub struct Media {
    pub kind: &'static str,
    pub bytes: Vec<u8>,
}

/// A value of whatever type.
pub trait Whole: Send {
    /// Takes out its numbers in bulk, by the name of their field.
    fn bulk(&mut self) -> Vec<(&'static str, Array)>;
    /// As JSON.
    fn json(&self) -> serde_json::Result<Vec<u8>>;
    /// As msgpack.
    fn packed(&self) -> Result<Vec<u8>, pack::Unwritable>;
    /// As JSON, bit by bit.
    fn write(&self, out: &mut dyn Write) -> serde_json::Result<()>;
}

impl<T: Bulk + Serialize + Send> Whole for T {
    fn bulk(&mut self) -> Vec<(&'static str, Array)> {
        Bulk::bulk(self)
    }

    fn json(&self) -> serde_json::Result<Vec<u8>> {
        serde_json::to_vec(self)
    }

    fn packed(&self) -> Result<Vec<u8>, pack::Unwritable> {
        pack::packed(self)
    }

    fn write(&self, out: &mut dyn Write) -> serde_json::Result<()> {
        serde_json::to_writer(out, self)
    }
}

/// What a function may give.
pub trait Output {
    /// What the document says of it; nothing for those that the declaration tells.
    fn describe(to: &mut Described);
    /// As an answer.
    fn reply(self) -> Reply;
}

impl Reply {
    /// With the usual status.
    pub fn of(content: Content) -> Reply {
        Reply { status: 200, location: None, again: false, content }
    }
}

/// A value: 200.
impl<T: Bulk + Serialize + ToSchema + Send + 'static> Output for T {
    fn describe(to: &mut Described) {
        to.json::<T>(200, "");
    }

    fn reply(self) -> Reply {
        Reply::of(Content::Value(Box::new(self)))
    }
}

/// Something is gone: 204.
impl Output for () {
    fn describe(to: &mut Described) {
        to.nothing(204, "Gone");
    }

    fn reply(self) -> Reply {
        Reply { status: 204, ..Reply::of(Content::Nothing) }
    }
}

/// A status of its own; the declaration tells which.
impl<T: Bulk + Serialize + Send + 'static> Output for (u16, T) {
    fn describe(_: &mut Described) {}

    fn reply(self) -> Reply {
        Reply { status: self.0, ..Reply::of(Content::Value(Box::new(self.1))) }
    }
}

/// The declaration tells the kinds.
impl Output for Media {
    fn describe(_: &mut Described) {}

    fn reply(self) -> Reply {
        Reply::of(Content::Media(self))
    }
}

/// One of several kinds of answers; the declaration tells which.
impl Output for Reply {
    fn describe(_: &mut Described) {}

    fn reply(self) -> Reply {
        self
    }
}
