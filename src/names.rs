//! Names of the values of a choice, as in files, on the wire and on the command line.

/// Declares the names of an enum's values: its `ALL`, `name` and `named`.
macro_rules! names {
    ($choice:ident: $($value:ident = $name:literal),+) => {
        impl $choice {
            /// Every value, in the order of the declaration.
            pub const ALL: [$choice; [$($name),+].len()] = [$($choice::$value),+];

            /// Name in files, on the wire and on the command line.
            pub fn name(self) -> &'static str {
                match self {
                    $($choice::$value => $name),+
                }
            }

            /// The value called `name`.
            pub fn named(name: &str) -> Option<$choice> {
                $choice::ALL.into_iter().find(|value| value.name() == name)
            }
        }
    };
}

pub(crate) use names;
