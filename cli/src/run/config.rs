//! Reads clouds from a TOML file with a table `[[cloud]]` for each. The keys are the same as in
//! `--cloud`. Each mistake is reported at its own line and column.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;

use serde::Deserialize;
use thiserror::Error;
use toml::{Spanned, Value};

use crate::fault::one_line;
use crate::files::{self, FileError};
use crate::run::cloud::{CloudError, CloudOptions};

/// The content of a file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ConfigFile {
    cloud: Vec<Spanned<CloudTable>>,
}

type CloudTable = BTreeMap<Spanned<String>, Spanned<Value>>;

/// The clouds of a file, and the places of their keys.
pub(crate) struct CloudFile {
    pub(crate) clouds: Vec<CloudOptions>,
    places: Vec<CloudPlaces>,
}

/// The place of a cloud's table, and of the value of each key, as `FILE:LINE:COLUMN`.
struct CloudPlaces {
    table: String,
    values: BTreeMap<String, String>,
}

/// The reason why a file gives no clouds.
#[derive(Debug, Error)]
pub(crate) enum CloudFileError {
    #[error(transparent)]
    Read(#[from] FileError),
    #[error("{file}: the file is not UTF-8 text; give a TOML file")]
    Text { file: String },
    #[error("{place}: {message}; a cloud is a table [[cloud]] with the keys of --cloud")]
    Toml { place: String, message: String },
    #[error("{place}: {source}")]
    Cloud { place: String, source: CloudError },
    #[error("{place}: key {key:?} has a {value} as its value; give text or a number")]
    Type { place: String, key: String, value: &'static str },
}

impl CloudFile {
    /// Reads the clouds in a file.
    ///
    /// # Errors
    /// Returns an error if the file cannot be read, if it is not TOML, or if the command line would
    /// refuse one of its clouds.
    pub(crate) fn read(path: &Path) -> Result<Self, CloudFileError> {
        let file = path.display().to_string();
        let bytes = files::bytes(path)?;
        let text =
            str::from_utf8(&bytes).map_err(|_| CloudFileError::Text { file: file.clone() })?;
        let place = |span: Range<usize>| {
            let before = text.get(..span.start).unwrap_or(text);
            let (line, begin) = (before.matches('\n').count() + 1, before.rfind('\n'));
            let column = before[begin.map_or(0, |end| end + 1)..].chars().count() + 1;
            format!("{file}:{line}:{column}")
        };
        let config: ConfigFile = toml::from_str(text).map_err(|error| CloudFileError::Toml {
            place: place(error.span().unwrap_or(0..0)),
            message: one_line(error.message()),
        })?;
        let (mut clouds, mut places) = (Vec::new(), Vec::new());
        for table in config.cloud {
            let (cloud, at) = read_table(table, place)?;
            clouds.push(cloud);
            places.push(at);
        }
        Ok(Self { clouds, places })
    }

    /// Returns the place of a key's value, or of its table, in the last cloud with this name.
    pub(crate) fn place(&self, cloud: &str, key: &str) -> Option<&str> {
        let index = self.clouds.iter().rposition(|other| other.name == cloud)?;
        let CloudPlaces { table, values } = self.places.get(index)?;
        Some(values.get(key).unwrap_or(table))
    }
}

/// Returns the cloud of a table, and its places.
fn read_table(
    table: Spanned<CloudTable>,
    place: impl Fn(Range<usize>) -> String,
) -> Result<(CloudOptions, CloudPlaces), CloudFileError> {
    let (table_place, mut pairs) = (place(table.span()), Vec::new());
    let (mut keys, mut values) = (BTreeMap::new(), BTreeMap::new());
    for (key, value) in table.into_inner() {
        let [key_place, value_place] = [key.span(), value.span()].map(&place);
        let key = key.into_inner();
        let text = match value.into_inner() {
            Value::String(text) => text,
            Value::Integer(number) => number.to_string(),
            Value::Float(number) => number.to_string(),
            value => {
                let (place, value) = (value_place, value.type_str());
                return Err(CloudFileError::Type { place, key, value });
            }
        };
        keys.insert(key.clone(), key_place);
        values.insert(key.clone(), value_place);
        pairs.push(Ok((key, text)));
    }
    match CloudOptions::of_pairs(pairs) {
        Ok(cloud) => Ok((cloud, CloudPlaces { table: table_place, values })),
        Err(source) => {
            let places = if source.is_of_value() { &values } else { &keys };
            let place = source.key().and_then(|key| places.get(key)).unwrap_or(&table_place);
            Err(CloudFileError::Cloud { place: place.clone(), source })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Vec<CloudOptions>, String> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("fuseline.toml");
        std::fs::write(&path, text).unwrap();
        let prefix = format!("{}:", path.display());
        let read = CloudFile::read(&path).map(|file| file.clouds);
        read.map_err(|error| error.to_string().replace(&prefix, ""))
    }

    #[test]
    fn a_file_gives_the_clouds_that_the_command_line_gives() {
        let clouds = read(
            "# two\n[[cloud]]\nname = \"west\"\npriority = 1\nmodel = \"own\"\nruntime = \"45.5ms\"\nap = 52\n\
             drive = \"cicv5g/rural_n8_v10\"\nstart = \"62s\"\n\n\
             [[cloud]]\nname = \"east\"\npriority = 2\nurl = \"https://h:1\"\ntoken = \"t\"\n",
        );
        let drive = "drive=cicv5g/rural_n8_v10,start=62s";
        let expected = [
            format!("name=west,priority=1,model=own,runtime=45.5ms,ap=52,{drive}"),
            "name=east,priority=2,url=https://h:1,token=t".to_owned(),
        ];
        assert_eq!(clouds.unwrap(), expected.map(|text| text.parse().unwrap()));
    }

    #[test]
    fn a_mistake_is_reported_at_its_place() {
        for (text, expected) in [
            ("cloud = 3", "1:9: invalid type: integer `3`, expected a sequence"),
            ("[[cloud]]\nname = \"a\"\n[[cloud]]\nname = \"b\"", "1:1: priority is missing"),
            ("\n\n[[cloud]]\nnome = \"a\"", "4:1: there is no key \"nome\""),
            ("[[cloud]]\nname = true", "2:8: key \"name\" has a boolean as its value"),
            (
                "[[cloud]]\nname = \"a\"\npriority = 1\nmodel = \"m\"\nruntime = 45",
                "5:11: runtime \"45\" is not valid; it must be more than 0",
            ),
            ("[[cloud]]\nname = \"ä\"; priority = 0", "2:11: "),
            ("cloud = [{ name = \"ä\", priority = 0 }]", "1:35: priority \"0\" is not valid"),
            (
                "[[cloud]]\nname=\"a\"\npriority=1\nurl=\"http://h\"\n  drive=\"d\"",
                "5:3: drive cannot be given with url",
            ),
            (
                "[[cloud]]\nname=\"a\"\npriority=1\ndrive=\"d\"\nmodel = \"none\"",
                "5:9: there is no model \"none\"",
            ),
            ("[[cloud]]\nname = ", "2:8: "),
            ("[[clouds]]\nname = \"a\"", "1:3: unknown field `clouds`, expected `cloud`"),
            ("", "1:1: missing field `cloud`"),
        ] {
            let fault = read(text).unwrap_err();
            assert!(fault.starts_with(expected), "{text:?}: {fault}");
        }
    }
}
