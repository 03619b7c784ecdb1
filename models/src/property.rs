//! Tables of properties, and sets of properties.

use stateright::Model;

/// A model that can say whether a property of this kind holds in a state.
pub(crate) trait Holds<Kind>: Model {
    /// Returns `true` if the property holds in this state.
    fn holds(&self, state: &Self::State, one: Kind) -> bool;
}

/// Defines an enum of properties, each `$Name = "its name"`, and the type of their sets.
///
/// Stateright wants a function pointer for each property, which cannot capture the property. So
/// each property needs a closure of its own. The table keeps the enum, the names and the closures
/// together.
macro_rules! properties {
    (
        $(#[$doc:meta])* $Kind:ident, $(#[$set_doc:meta])* $Set:ident, $expectation:ident;
        $($Name:ident = $text:literal,)*
    ) => {
        $(#[$doc])*
        #[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
        pub enum $Kind {
            $(#[doc = $text] $Name,)*
        }

        $(#[$set_doc])*
        #[derive(Clone, Copy, PartialEq, Eq, Hash, Default, Debug)]
        pub struct $Set(u128);

        impl $Kind {
            /// All properties in their order.
            pub const ALL: &[Self] = &[$(Self::$Name,)*];

            /// Returns the property's name.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$Name => $text,)*
                }
            }

            /// Returns the property in the form of Stateright.
            pub(crate) fn property<M>(self) -> stateright::Property<M>
            where
                M: crate::property::Holds<Self>,
            {
                let name = self.name();
                match self {
                    $(Self::$Name => stateright::Property::$expectation(
                        name,
                        |model: &M, state| model.holds(state, Self::$Name),
                    ),)*
                }
            }
        }

        impl $Set {
            /// Returns `true` if `one` is a member.
            #[must_use]
            pub const fn contains(self, one: $Kind) -> bool {
                self.0 >> one as u32 & 1 == 1
            }

            /// Returns `true` if the set is empty.
            #[must_use]
            pub const fn is_empty(self) -> bool {
                self.0 == 0
            }

            /// Returns the members in their order.
            pub fn iter(self) -> impl Iterator<Item = $Kind> {
                $Kind::ALL.iter().copied().filter(move |one| self.contains(*one))
            }

            pub(crate) fn insert(&mut self, one: $Kind) {
                self.0 |= 1 << one as u32;
            }

            /// Adds `one` if `holds` is `true`.
            pub(crate) fn insert_if(&mut self, one: $Kind, holds: bool) {
                if holds {
                    self.insert(one);
                }
            }
        }

        impl Extend<$Kind> for $Set {
            fn extend<I: IntoIterator<Item = $Kind>>(&mut self, more: I) {
                for one in more {
                    self.insert(one);
                }
            }
        }
    };
}

pub(crate) use properties;
