//! The middleware of topics.

use std::fmt;

use crate::settings::reader::ParameterReader;
use crate::settings::{CloudConnection, SettingsError};

/// The middleware that carries a topic's messages.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Middleware {
    /// DDS, as `rmw_fastrtps` and `rmw_cyclonedds` speak it.
    Dds,
    /// Zenoh, as `rmw_zenoh` uses it.
    Zenoh,
}

impl Middleware {
    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::Dds => "dds",
            Self::Zenoh => "zenoh",
        }
    }
}

impl fmt::Display for Middleware {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Reads which one is meant, by default that of the node; one that is not built in is refused.
pub(super) fn read(
    r: &mut ParameterReader,
    name: &str,
    default: Option<Middleware>,
) -> Result<Middleware, SettingsError> {
    let name = r.text(name, default.map(Middleware::name))?;
    Ok(if name == Middleware::Zenoh.name() { Middleware::Zenoh } else { Middleware::Dds })
}

impl super::Settings {
    /// Returns `true` if any of the node's topics is on it.
    #[must_use]
    pub fn needs(&self, middleware: Middleware) -> bool {
        let clouds = self.clouds.iter().filter_map(|cloud| match &cloud.way {
            CloudConnection::Topics { middleware, .. } => Some(*middleware),
            CloudConnection::Grpc(_) => None,
        });
        [self.middleware, self.local.middleware]
            .into_iter()
            .chain(clouds)
            .any(|it| it == middleware)
    }

    /// Returns the middleware of a topic of the node.
    #[must_use]
    pub fn middleware_of(&self, topic: &str) -> Middleware {
        if [&self.local.input, &self.local.output].iter().any(|it| **it == topic) {
            return self.local.middleware;
        }
        let of_cloud = self.clouds.iter().find_map(|cloud| match &cloud.way {
            CloudConnection::Topics { middleware, input, output }
                if input == topic || output == topic =>
            {
                Some(*middleware)
            }
            CloudConnection::Topics { .. } | CloudConnection::Grpc(_) => None,
        });
        of_cloud.unwrap_or(self.middleware)
    }
}
