//! Scopes of tokens, and the principal of a request.

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::names::names;

/// Scope of a token; each includes those before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Scope {
    /// Read all resources.
    Read,
    /// Create worlds, jobs and policies, and act in them: in one's own and in the default worlds.
    Act,
    /// The same for resources of all owners.
    Admin,
}

// The weakest first.
names!(Scope: Read = "read", Act = "act", Admin = "admin");

impl Scope {
    /// The scope called `name`.
    pub fn from_name(field: &str, name: &str) -> Result<Scope> {
        Scope::named(name).ok_or_else(|| Error::input(field, format!("{name:?}"), "read, act or admin"))
    }
}

/// The authenticated caller.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Principal {
    /// Name of the token; none without authentication.
    pub name: Option<String>,
    pub scope: Scope,
}

impl Principal {
    /// The caller of a server without authentication.
    pub fn anonymous() -> Principal {
        Principal { name: None, scope: Scope::Admin }
    }

    /// Owner whose resources are visible besides the shared ones; `None` if all are.
    pub fn visible_owner(&self) -> Option<&str> {
        match self.scope {
            Scope::Act => Some(self.name.as_deref().unwrap_or_default()),
            Scope::Read | Scope::Admin => None,
        }
    }

    /// Owner of the resources that the caller creates.
    pub fn owner(&self) -> Option<&str> {
        self.name.as_deref()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scope_determines_visible_owner() {
        let who = |scope| Principal { name: Some("ann".into()), scope };
        assert_eq!(who(Scope::Act).visible_owner(), Some("ann"));
        assert_eq!((who(Scope::Read).visible_owner(), who(Scope::Admin).visible_owner()), (None, None));
        assert_eq!(Principal::anonymous().visible_owner(), None);
        assert!(Scope::Read < Scope::Act && Scope::Act < Scope::Admin);
        for scope in Scope::ALL {
            assert_eq!(Scope::from_name("--scope", scope.name()).unwrap(), scope);
        }
        assert!(Scope::from_name("--scope", "root").unwrap_err().to_string().contains("read, act or admin"));
    }
}
