//! [`Db3Messages`]: the messages of some topics of a rosbag2 database.

use std::collections::BTreeMap;
use std::path::Path;
use std::rc::Rc;

use fuseline_traces::packed::{PayloadFormat, PayloadSchema, RECORD, RawMessage};
use rusqlite::{Connection, OpenFlags, OptionalExtension, params};
use thiserror::Error;

/// A database that is being read, in the order in which messages were written.
pub(super) struct Db3Messages {
    connection: Connection,
    /// By their numbers in the database.
    topics: BTreeMap<i64, (usize, Rc<PayloadFormat>)>,
    /// The statement for the message behind a number.
    next: String,
    last: i64,
    others: Vec<String>,
}

/// Why a database gives no more messages.
#[derive(Debug, Error)]
pub(super) enum Db3Error {
    #[error("{}", .0.to_string().replace(char::is_control, "\u{fffd}"))]
    Database(#[from] rusqlite::Error),
    #[error("no recording of ROS 2: it has no table {0}")]
    Table(&'static str),
    #[error("message {0}: it has a time before 1970, or more than 40 MiB")]
    Message(i64),
}

impl Db3Messages {
    /// Opens a database and finds these topics.
    ///
    /// # Errors
    /// If it is none of rosbag2.
    pub(super) fn open(path: &Path, names: &[&str]) -> Result<Self, Db3Error> {
        let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX;
        let connection = Connection::open_with_flags(path, flags)?;
        for table in ["topics", "messages"] {
            if !has_table(&connection, table)? {
                return Err(Db3Error::Table(table));
            }
        }
        let schemas = schemas(&connection)?;
        let (mut topics, mut others) = (BTreeMap::new(), Vec::new());
        let mut found =
            connection.prepare("SELECT id, name, type, serialization_format FROM topics")?;
        let mut rows = found.query([])?;
        while let Some(row) = rows.next()? {
            let name: String = row.get(1)?;
            if let Some(topic) = names.iter().position(|known| *known == name) {
                let of: String = row.get(2)?;
                // Of a service's events no definition is stored; what they begin with is known.
                let event = of.ends_with("_Event").then(|| {
                    let (encoding, data) = ("ros2msg".to_owned(), Vec::new());
                    Rc::new(PayloadSchema { name: of.clone(), encoding, data })
                });
                let (encoding, schema) = (row.get(3)?, schemas.get(&of).cloned().or(event));
                let format = PayloadFormat { encoding, schema };
                topics.insert(row.get(0)?, (topic, Rc::new(format)));
            } else {
                others.push(name);
            }
        }
        drop(rows);
        drop(found);
        let ids: Vec<String> = topics.keys().map(i64::to_string).collect();
        let next = format!(
            "SELECT id, topic_id, timestamp, CASE WHEN length(data) <= {RECORD} THEN data END \
             FROM messages WHERE id > ?1 AND topic_id IN ({}) ORDER BY id LIMIT 1",
            ids.join(", ")
        );
        Ok(Self { connection, topics, next, last: i64::MIN, others })
    }

    /// The topics that were not asked for.
    pub(super) fn others(&self) -> impl Iterator<Item = &str> {
        self.others.iter().map(|topic| &**topic)
    }

    /// The next message of the topics; none at the end.
    ///
    /// # Errors
    /// If the database cannot be read.
    pub(super) fn message(&mut self) -> Result<Option<RawMessage>, Db3Error> {
        let mut statement = self.connection.prepare(&self.next)?;
        let row = statement
            .query_row(params![self.last], |row| {
                let id: (i64, i64) = (row.get(0)?, row.get(1)?);
                Ok((id, row.get::<_, i64>(2)?, row.get::<_, Option<Vec<u8>>>(3)?))
            })
            .optional()?;
        let Some(((id, topic), at, data)) = row else { return Ok(None) };
        self.last = id;
        let (Ok(log_time), Some(data)) = (u64::try_from(at), data) else {
            return Err(Db3Error::Message(id));
        };
        let Some((topic, format)) = self.topics.get(&topic) else { return Ok(None) };
        Ok(Some(RawMessage { topic: *topic, log_time, format: Rc::clone(format), data }))
    }
}

/// Whether it is a table of its own, and no view or virtual one, which could compute without end.
fn has_table(connection: &Connection, name: &str) -> Result<bool, rusqlite::Error> {
    let stored = "SELECT 1 FROM sqlite_master \
                  WHERE type = 'table' AND name = ?1 AND sql LIKE 'CREATE TABLE %'";
    connection.query_row(stored, [name], |_| Ok(())).optional().map(|found| found.is_some())
}

/// The definitions by their types; ROS 2 has them in its databases since Iron.
fn schemas(
    connection: &Connection,
) -> Result<BTreeMap<String, Rc<PayloadSchema>>, rusqlite::Error> {
    if !has_table(connection, "message_definitions")? {
        return Ok(BTreeMap::new());
    }
    let mut found = connection.prepare(
        "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions",
    )?;
    let schemas = found.query_map([], |row| {
        let (name, encoding, text) = (row.get(0)?, row.get(1)?, row.get::<_, String>(2)?);
        let schema = PayloadSchema { name, encoding, data: text.into_bytes() };
        Ok((schema.name.clone(), Rc::new(schema)))
    })?;
    schemas.collect()
}
