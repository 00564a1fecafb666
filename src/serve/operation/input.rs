//! What functions take. Several things are a tuple of them, in the order in which the document lists them.

use serde::de::DeserializeOwned;
use serde_json::Value;
use utoipa::ToSchema;

use super::asked::Asked;
use super::describe::Described;
use super::page::Page;
use crate::serve::problem::Answer;

/// What a function takes of a request.
pub trait Input: Sized + Send + 'static {
    /// What the document says of it.
    fn describe(to: &mut Described);
    /// Takes it.
    fn read(from: &mut Asked) -> Answer<Self>;
}

/// The `{id}` of the path.
pub struct Id(pub String);

/// A JSON object as the body.
pub struct Body<T>(pub T);

/// The same, with what was sent, to be kept and shown.
pub struct Kept<T>(pub T, pub Value);

/// The body, whatever it is: weights.
pub struct Bytes(pub Vec<u8>);

/// The number of the last event seen, 0 if none was.
pub struct LastEvent(pub u64);

/// Whether arrays are wanted apart from the rest.
pub struct Raw(pub bool);

impl Input for Id {
    fn describe(to: &mut Described) {
        to.path("id", None);
    }

    fn read(from: &mut Asked) -> Answer<Id> {
        from.part("id").map(Id)
    }
}

impl<T: DeserializeOwned + ToSchema + Send + 'static> Input for Body<T> {
    fn describe(to: &mut Described) {
        to.body::<T>();
    }

    fn read(from: &mut Asked) -> Answer<Body<T>> {
        from.body().map(Body)
    }
}

impl<T: DeserializeOwned + ToSchema + Send + 'static> Input for Kept<T> {
    fn describe(to: &mut Described) {
        to.body::<T>();
    }

    fn read(from: &mut Asked) -> Answer<Kept<T>> {
        let sent = from.whole()?;
        Ok(Kept(from.body()?, sent))
    }
}

impl Input for Bytes {
    fn describe(to: &mut Described) {
        to.body_of_media("application/octet-stream");
    }

    fn read(from: &mut Asked) -> Answer<Bytes> {
        from.bytes("the weights as safetensors").map(Bytes)
    }
}

impl Input for LastEvent {
    fn describe(to: &mut Described) {
        to.header::<u64>("Last-Event-ID", "Number of the last event seen");
    }

    fn read(from: &mut Asked) -> Answer<LastEvent> {
        from.last_event().map(LastEvent)
    }
}

impl Input for Raw {
    fn describe(_: &mut Described) {}

    fn read(from: &mut Asked) -> Answer<Raw> {
        Ok(Raw(from.raw))
    }
}

impl Input for Page {
    fn describe(to: &mut Described) {
        to.query::<u32>("limit", "Most items, 1 to 1000; default 100");
        to.query::<String>("cursor", "`next` of the page before");
        to.problem(422, "");
    }

    fn read(from: &mut Asked) -> Answer<Page> {
        Ok(Page::from_query(&from.query()?)?)
    }
}

impl Input for () {
    fn describe(_: &mut Described) {}

    fn read(_: &mut Asked) -> Answer<()> {
        Ok(())
    }
}

impl<A: Input, B: Input> Input for (A, B) {
    fn describe(to: &mut Described) {
        A::describe(to);
        B::describe(to);
    }

    fn read(from: &mut Asked) -> Answer<(A, B)> {
        Ok((A::read(from)?, B::read(from)?))
    }
}

impl<A: Input, B: Input, C: Input> Input for (A, B, C) {
    fn describe(to: &mut Described) {
        A::describe(to);
        B::describe(to);
        C::describe(to);
    }

    fn read(from: &mut Asked) -> Answer<(A, B, C)> {
        Ok((A::read(from)?, B::read(from)?, C::read(from)?))
    }
}
