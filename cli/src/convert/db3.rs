//! [`Db3Messages`]: the messages of some topics of a rosbag2 database.

use std::collections::{BTreeMap, VecDeque};
use std::path::Path;
use std::rc::Rc;

use fuseline_traces::packed::{PayloadFormat, PayloadSchema, RECORD, RawMessage};
use rusqlite::{Connection, OpenFlags, OptionalExtension};

use crate::convert::topics::Recording;

/// The number of messages that one statement reads, since preparing it takes longer than reading
/// one.
const AHEAD: usize = 256;
/// The length above which a message is read by itself, so that few bytes are held.
const SHORT: usize = 64 << 10;

/// A database that is being read, in the order in which messages were written.
pub(super) struct Db3Messages {
    connection: Connection,
    /// By their numbers in the database.
    topics: BTreeMap<i64, (usize, Rc<PayloadFormat>)>,
    /// The statement for the messages behind a number.
    next: String,
    /// The messages that were read and not yet handed over.
    ahead: VecDeque<StoredMessage>,
    last: i64,
    /// All topics of the database.
    all: Vec<String>,
}

/// A row of the table of messages.
struct StoredMessage {
    id: i64,
    topic: i64,
    at: i64,
    /// The content, or `None` if it is longer than [`SHORT`].
    data: Option<Vec<u8>>,
}

impl Db3Messages {
    /// Opens a database and finds these topics.
    pub(super) fn open(path: &Path, names: &[&str]) -> Result<Self, String> {
        let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX;
        let connection =
            Connection::open_with_flags(path, flags).map_err(|error| error.to_string())?;
        for table in ["topics", "messages"] {
            if !has_table(&connection, table).map_err(|error| error.to_string())? {
                return Err(format!(
                    "not a ROS 2 recording: the database has no table {table}; give a .db3 file of \
                     ros2 bag record"
                ));
            }
        }
        Self::of_topics(connection, names).map_err(|error| error.to_string())
    }

    fn of_topics(connection: Connection, names: &[&str]) -> Result<Self, rusqlite::Error> {
        // ROS 2 has definitions in its databases since Iron.
        let definitions = if has_table(&connection, "message_definitions")? {
            "LEFT JOIN message_definitions ON topic_type = type GROUP BY topics.id"
        } else {
            "LEFT JOIN (SELECT NULL AS encoding, NULL AS encoded_message_definition)"
        };
        let query = format!(
            "SELECT topics.id, name, type, serialization_format, encoding, encoded_message_definition FROM topics {definitions}"
        );
        let (mut topics, mut all) = (BTreeMap::new(), Vec::new());
        let mut found = connection.prepare(&query)?;
        let mut rows = found.query([])?;
        while let Some(row) = rows.next()? {
            let name: String = row.get(1)?;
            if let Some(topic) = names.iter().position(|known| *known == name) {
                let (of, data): (String, Option<String>) = (row.get(2)?, row.get(5)?);
                let stored: Option<String> = row.get(4)?;
                // The file stores no definition of a service's events, but the fields at their
                // beginning are known.
                let event = of.ends_with("_Event").then(|| "ros2msg".to_owned());
                let schema = stored.or(event).map(|encoding| {
                    let data = data.unwrap_or_default().into_bytes();
                    Rc::new(PayloadSchema { name: of, encoding, data })
                });
                let format = PayloadFormat { encoding: row.get(3)?, schema };
                topics.insert(row.get(0)?, (topic, Rc::new(format)));
            }
            all.push(name);
        }
        drop(rows);
        drop(found);
        let ids: Vec<String> = topics.keys().map(i64::to_string).collect();
        let next = format!(
            "SELECT id, topic_id, timestamp, CASE WHEN length(data) <= {SHORT} THEN data END AS data \
             FROM messages WHERE id > ?1 AND topic_id IN ({}) ORDER BY id LIMIT {AHEAD}",
            ids.join(", ")
        );
        Ok(Self { connection, topics, next, ahead: VecDeque::new(), last: i64::MIN, all })
    }

    fn next(&mut self) -> Result<Option<RawMessage>, String> {
        if self.ahead.is_empty() {
            let read = self.read_ahead();
            // The next statement fails at the same row, after the messages before it are handed
            // over.
            read.or_else(
                |error| if self.ahead.is_empty() { Err(error.to_string()) } else { Ok(()) },
            )?;
        }
        let Some(StoredMessage { id, topic, at, data }) = self.ahead.pop_front() else {
            return Ok(None);
        };
        let data = match data {
            None => self.long(id).map_err(|error| error.to_string())?,
            data => data,
        };
        let (Ok(log_time), Some(data)) = (u64::try_from(at), data) else {
            return Err(format!(
                "message {id}: its time is before 1970, or it is longer than 40 MiB"
            ));
        };
        let Some((topic, format)) = self.topics.get(&topic) else { return Ok(None) };
        Ok(Some(RawMessage { topic: *topic, log_time, format: Rc::clone(format), data }))
    }

    fn read_ahead(&mut self) -> Result<(), rusqlite::Error> {
        let mut statement = self.connection.prepare(&self.next)?;
        let mut rows = statement.query([self.last])?;
        while let Some(row) = rows.next()? {
            let (id, topic, at) = (row.get(0)?, row.get(1)?, row.get(2)?);
            self.ahead.push_back(StoredMessage { id, topic, at, data: row.get(3)? });
            self.last = id;
        }
        Ok(())
    }

    /// Returns what a message holds, or `None` if it holds nothing or is longer than a record may
    /// be.
    fn long(&self, id: i64) -> Result<Option<Vec<u8>>, rusqlite::Error> {
        let data = format!(
            "SELECT CASE WHEN length(data) <= {RECORD} THEN data END AS data FROM messages WHERE id = ?1"
        );
        self.connection.query_row(&data, [id], |row| row.get(0))
    }
}

impl Recording for Db3Messages {
    fn message(&mut self) -> Result<Option<RawMessage>, (String, bool)> {
        self.next().map_err(|error| (error, false))
    }

    fn topics(&self) -> Vec<String> {
        self.all.clone()
    }
}

/// Returns whether the name is that of an ordinary table. A view or a virtual table does not count,
/// because it could compute without end.
fn has_table(connection: &Connection, name: &str) -> Result<bool, rusqlite::Error> {
    let stored = "SELECT 1 FROM sqlite_master \
                  WHERE type = 'table' AND name = ?1 AND sql LIKE 'CREATE TABLE %'";
    connection.query_row(stored, [name], |_| Ok(())).optional().map(|found| found.is_some())
}
