//! The events of a ROS 2 service, which its client and its server have.

use std::collections::HashSet;

use crate::convert::log::Log;
use crate::convert::mapping::Mapping;
use crate::convert::row::{Place, Row};

/// Where a service's event was: its kinds are 0, a request sent, 1, it received, 2, a response sent, and 3, it received.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Side {
    Client,
    Server,
}

/// The rows of a recording that a service's server had; they are read if its client's were not recorded.
#[derive(Default)]
pub(super) struct ServiceRows {
    has_client: bool,
    rows: HashSet<u64>,
    first: Option<Place>,
}

impl ServiceRows {
    pub(super) fn take(&mut self, side: Side, row: &Row, number: u64) {
        if side == Side::Server {
            self.rows.insert(number);
            self.first.get_or_insert_with(|| row.place.clone());
        } else if matches!(row.cell("info.event_type"), Some("0" | "3")) {
            self.has_client = true;
        }
    }

    pub(super) fn finish(self, mapping: &mut Mapping<'_>, log: &mut Log) {
        let Some(first) = self.first else { return };
        let kind = if self.has_client {
            log.entries.retain(|entry| !self.rows.contains(&entry.row));
            "events that a service's server had, left out, since its client's are there"
        } else {
            "events that a service's server had, read for its client's, which were not recorded"
        };
        for _ in &self.rows {
            mapping.notes.add(kind, &first, String::new);
        }
    }
}
