//! Whom the server shares itself out between: a client is the name of its token, or else its address.

use std::net::IpAddr;
use std::sync::Arc;

use crate::access::Who;

/// One of those who share the server.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Client(Arc<str>);

impl Client {
    /// Whoever is at an address. Who has one IPv6 address has the 2^64 beside it as well (RFC 6177): they count as one.
    pub fn at(address: IpAddr) -> Client {
        let name = match address.to_canonical() {
            IpAddr::V4(v4) => format!("at {v4}"),
            IpAddr::V6(v6) => {
                let [a, b, c, d, ..] = v6.segments();
                format!("at {a:x}:{b:x}:{c:x}:{d:x}::/64")
            }
        };
        Client(name.into())
    }

    /// Whoever may open a socket of the file system.
    pub fn local() -> Client {
        Client("at the socket".into())
    }

    /// Who asks from a place: by name, if it has one. No token's name has a space.
    pub fn of(who: &Who, place: &Client) -> Client {
        who.owner().map_or_else(|| place.clone(), |name| Client(name.into()))
    }

    /// As text.
    pub fn name(&self) -> &str {
        &self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::access::Scope;

    #[test]
    fn a_client_is_its_token_or_else_its_address() {
        let at = |text: &str| Client::at(text.parse().unwrap());
        assert_eq!(at("10.0.0.1"), at("::ffff:10.0.0.1"));
        assert_ne!(at("10.0.0.1"), at("10.0.0.2"));
        assert_eq!(at("2001:db8:1:2::1"), at("2001:db8:1:2:ffff::9"));
        assert_ne!(at("2001:db8:1:2::1"), at("2001:db8:1:3::1"));
        let ann = Who { name: Some("ann".into()), scope: Scope::Act };
        assert_eq!(Client::of(&ann, &at("10.0.0.1")), Client::of(&ann, &Client::local()));
        assert_eq!(Client::of(&Who::anybody(), &at("10.0.0.1")), at("10.0.0.1"));
    }
}
