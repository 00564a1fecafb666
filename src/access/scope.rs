//! What a token allows, and whose things its bearer sees.

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};

/// What a token allows; each allows what those before it do.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Scope {
    /// To see, everybody's.
    Read,
    /// To make worlds, jobs and policies and to act in them: in one's own and in the worlds that are there from the start.
    Act,
    /// To do so with everybody's.
    Admin,
}

impl Scope {
    /// Every scope, the weakest first.
    pub const ALL: [Scope; 3] = [Scope::Read, Scope::Act, Scope::Admin];

    /// The name used in files, on the wire and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Scope::Read => "read",
            Scope::Act => "act",
            Scope::Admin => "admin",
        }
    }

    /// The scope called `name`.
    pub fn from_name(field: &str, name: &str) -> Result<Scope> {
        let found = Scope::ALL.into_iter().find(|s| s.name() == name);
        found.ok_or_else(|| Error::input(field, format!("{name:?}"), "read, act or admin"))
    }
}

/// Who asks.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Who {
    /// The name of the token; none where nobody is asked who they are.
    pub name: Option<String>,
    pub scope: Scope,
}

impl Who {
    /// Anybody, where nobody is asked who they are.
    pub fn anybody() -> Who {
        Who { name: None, scope: Scope::Admin }
    }

    /// Whose things are seen besides those that everybody shares; `None` is everybody's.
    pub fn sees(&self) -> Option<&str> {
        match self.scope {
            Scope::Act => Some(self.name.as_deref().unwrap_or_default()),
            Scope::Read | Scope::Admin => None,
        }
    }

    /// Whose the things are that are made.
    pub fn owner(&self) -> Option<&str> {
        self.name.as_deref()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn act_sees_its_own_and_the_others_everything() {
        let who = |scope| Who { name: Some("ann".into()), scope };
        assert_eq!(who(Scope::Act).sees(), Some("ann"));
        assert_eq!((who(Scope::Read).sees(), who(Scope::Admin).sees()), (None, None));
        assert_eq!(Who::anybody().sees(), None);
        assert!(Scope::Read < Scope::Act && Scope::Act < Scope::Admin);
        for scope in Scope::ALL {
            assert_eq!(Scope::from_name("--may", scope.name()).unwrap(), scope);
        }
        assert!(Scope::from_name("--may", "root").unwrap_err().to_string().contains("read, act or admin"));
    }
}
