//! Clients: the unit of fair sharing. A client is its token's name, or its address without a token.

use std::net::IpAddr;
use std::sync::Arc;

use crate::access::Principal;

/// A client of the server.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Client(Arc<str>);

impl Client {
    /// The client at an address. An IPv6 host usually has a whole /64 (RFC 6177), which counts as one client.
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

    /// The client on a Unix socket.
    pub fn local() -> Client {
        Client("at the socket".into())
    }

    /// The client of an authenticated request: the token's name (which has no space), else the peer.
    pub fn identify(who: &Principal, place: &Client) -> Client {
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
    fn identifies_client_by_token_or_address() {
        let at = |text: &str| Client::at(text.parse().unwrap());
        assert_eq!(at("10.0.0.1"), at("::ffff:10.0.0.1"));
        assert_ne!(at("10.0.0.1"), at("10.0.0.2"));
        assert_eq!(at("2001:db8:1:2::1"), at("2001:db8:1:2:ffff::9"));
        assert_ne!(at("2001:db8:1:2::1"), at("2001:db8:1:3::1"));
        let ann = Principal { name: Some("ann".into()), scope: Scope::Act };
        assert_eq!(Client::identify(&ann, &at("10.0.0.1")), Client::identify(&ann, &Client::local()));
        assert_eq!(Client::identify(&Principal::anonymous(), &at("10.0.0.1")), at("10.0.0.1"));
    }
}
