//! JSON Schemas of what `--json` prints, made from the types that are printed.

#[cfg(feature = "full")]
use std::io::Write;

#[cfg(feature = "full")]
use schemars::JsonSchema;
#[cfg(feature = "full")]
use schemars::generate::SchemaSettings;

#[cfg(not(feature = "full"))]
use crate::absent::absent;
use crate::exit::Exit;
use crate::fault::Fault;
#[cfg(feature = "full")]
use crate::sink::OutputSink;

/// What has a schema, in a build that makes them.
#[cfg(not(feature = "full"))]
pub(crate) trait JsonSchema {}

#[cfg(not(feature = "full"))]
impl<T> JsonSchema for T {}

/// Whether the schema is wanted instead of anything else.
#[derive(clap::Args)]
pub(crate) struct SchemaOption {
    /// Print the JSON Schema of what --json prints, and do nothing else.
    #[arg(long, exclusive = true)]
    json_schema: bool,
}

impl SchemaOption {
    /// Prints the schema of `T`, if it is wanted.
    ///
    /// # Errors
    /// If standard output cannot be written.
    #[cfg(feature = "full")]
    pub(crate) fn print<T: JsonSchema>(&self) -> Result<Option<Exit>, Fault> {
        if !self.json_schema {
            return Ok(None);
        }
        let settings = SchemaSettings::draft2020_12().for_serialize();
        let schema = settings.into_generator().into_root_schema_for::<T>();
        let mut out = OutputSink::new(anstream::stdout());
        writeln!(out, "{:#}", schema.as_value()).map_err(Fault::Output)?;
        Ok(Some(Exit::Conforms))
    }

    /// # Errors
    /// If the schema is wanted.
    #[cfg(not(feature = "full"))]
    pub(crate) fn print<T: JsonSchema>(&self) -> Result<Option<Exit>, Fault> {
        if self.json_schema { Err(absent("--json-schema")) } else { Ok(None) }
    }
}
