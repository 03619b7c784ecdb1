//! Reads clouds from a TOML file with a table `[[cloud]]` for each. The keys are the same as in
//! `--cloud`.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Deserialize;
use thiserror::Error;
use toml::{Spanned, Value};

use crate::fault::one_line;
use crate::files::{self, FileError};
use crate::run::cloud::{CloudError, CloudOptions};

/// The file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ConfigFile {
    cloud: Vec<Spanned<BTreeMap<Spanned<String>, Value>>>,
}

/// The reason why a file gives no clouds.
#[derive(Debug, Error)]
pub(crate) enum CloudFileError {
    #[error(transparent)]
    Read(#[from] FileError),
    #[error("{file}: the file is not UTF-8 text; give a TOML file")]
    Text { file: String },
    #[error("{file}:{line}: {message}; a cloud is a table [[cloud]] with the keys of --cloud")]
    Toml { file: String, line: usize, message: String },
    #[error("{file}:{line}: {source}")]
    Cloud { file: String, line: usize, source: CloudError },
    #[error("{file}:{line}: key {key:?} has a {value} as its value; give text or a number")]
    Type { file: String, line: usize, key: String, value: &'static str },
}

/// Returns the clouds in a file.
///
/// # Errors
/// Returns an error if the file cannot be read, if it is not TOML, or if the command line would
/// refuse one of its clouds.
pub(crate) fn clouds(path: &Path) -> Result<Vec<CloudOptions>, CloudFileError> {
    let file = path.display().to_string();
    let bytes = files::bytes(path)?;
    let text = str::from_utf8(&bytes).map_err(|_| CloudFileError::Text { file: file.clone() })?;
    let line = |at: usize| 1 + text.get(..at).unwrap_or(text).matches('\n').count();
    let config: ConfigFile = toml::from_str(text).map_err(|error| CloudFileError::Toml {
        file: file.clone(),
        line: error.span().map_or(1, |span| line(span.start)),
        message: one_line(error.message()),
    })?;
    let clouds = config.cloud.into_iter().map(|cloud| {
        let begin = line(cloud.span().start);
        let mut lines = BTreeMap::new();
        let mut pairs = Vec::new();
        for (key, value) in cloud.into_inner() {
            let (line, key) = (line(key.span().start), key.into_inner());
            lines.insert(key.clone(), line);
            let value = match value {
                Value::String(text) => text,
                Value::Integer(number) => number.to_string(),
                Value::Float(number) => number.to_string(),
                value => {
                    let (file, value) = (file.clone(), value.type_str());
                    return Err(CloudFileError::Type { file, line, key, value });
                }
            };
            pairs.push(Ok((key, value)));
        }
        let of_pairs = CloudOptions::of_pairs(pairs);
        of_pairs.map_err(|source| {
            let line = source.key().and_then(|key| lines.get(key)).copied().unwrap_or(begin);
            CloudFileError::Cloud { file: file.clone(), line, source }
        })
    });
    clouds.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Vec<CloudOptions>, String> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("fuseline.toml");
        std::fs::write(&path, text).unwrap();
        let prefix = format!("{}:", path.display());
        clouds(&path).map_err(|error| error.to_string().replace(&prefix, ""))
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
    fn a_mistake_is_reported_with_its_line() {
        for (text, expected) in [
            ("cloud = 3", "1: "),
            ("[[cloud]]\nname = \"a\"\n[[cloud]]\nname = \"b\"", "1: priority is missing"),
            ("\n\n[[cloud]]\nnome = \"a\"", "4: there is no key \"nome\""),
            ("[[cloud]]\nname = true", "2: key \"name\" has a boolean as its value"),
            (
                "[[cloud]]\nname = \"a\"\npriority = 1\nmodel = \"m\"\nruntime = 45",
                "5: runtime \"45\" is not valid; it must be more than 0",
            ),
            ("[[cloud]]\nname = \"a\"\npriority = 0", "3: priority \"0\" is not valid"),
            (
                "[[cloud]]\nname=\"a\"\npriority=1\nurl=\"http://h\"\ndrive=\"d\"",
                "5: drive cannot be given with url",
            ),
            ("[[cloud]]\nname = ", "2: "),
            ("[[clouds]]\nname = \"a\"", "1: unknown field `clouds`"),
            ("", "1: missing field `cloud`"),
        ] {
            let fault = read(text).unwrap_err();
            assert!(fault.starts_with(expected), "{text:?}: {fault}");
        }
    }
}
