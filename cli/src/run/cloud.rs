//! The clouds of a run, and the options `--cloud`, `--drive` and `--start`.

use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::time::Duration;

use thiserror::Error;

use crate::duration::{ANY, duration};
use crate::emulation::EmulationError;
use fuseline_evaluation::models::{Model, ModelError};

/// One cloud as the options describe it.
#[derive(Clone, PartialEq, Debug)]
pub(crate) struct CloudOptions {
    pub(crate) name: String,
    pub(crate) priority: u16,
    pub(crate) address: CloudAddress,
}

/// The place of a cloud.
#[derive(Clone, PartialEq, Debug)]
pub(crate) enum CloudAddress {
    /// In this process, behind a recorded network.
    Emulated { model: Model, drive: String, start: Duration },
    /// A server elsewhere. The model is stated only for the report.
    Remote { model: Option<Model>, remote: RemoteServer },
}

/// The address of a server elsewhere, and how to reach it.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub(crate) struct RemoteServer {
    pub(crate) url: String,
    /// The PEM file of the authority that must have signed the server's certificate.
    pub(crate) ca: Option<PathBuf>,
    /// The PEM file of this side's certificate.
    pub(crate) cert: Option<PathBuf>,
    /// The PEM file of this side's private key.
    pub(crate) key: Option<PathBuf>,
    /// A file with the bearer token.
    pub(crate) token: Option<PathBuf>,
}

/// A value for a named cloud, written `west=VALUE`.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) struct NamedValue<T> {
    pub(crate) cloud: String,
    pub(crate) value: T,
}

/// A mistake in the options of a cloud.
#[derive(Debug, Error)]
pub(crate) enum CloudError {
    #[error("{0:?} is not KEY=VALUE")]
    Pair(String),
    #[error(
        "there is no key {0:?}; the keys are name, priority, model, runtime, ap, drive, start, url, ca, cert, key, token"
    )]
    Key(String),
    #[error("key {0:?} is given twice; give it once")]
    Twice(String),
    #[error("{0} is missing")]
    Missing(&'static str),
    #[error("{key} {value:?} is not valid; {wanted}")]
    Value { key: &'static str, value: String, wanted: String },
    #[error("{0} cannot be given with url; give it to fuseline serve there")]
    Remote(&'static str),
    #[error("{0} needs url")]
    Emulated(&'static str),
    #[error(transparent)]
    Model(#[from] ModelError),
}

impl CloudError {
    /// Returns the wrong key, if the mistake is a key.
    pub(crate) fn key(&self) -> Option<&str> {
        match self {
            Self::Key(key) | Self::Twice(key) => Some(key),
            Self::Value { key, .. }
            | Self::Remote(key)
            | Self::Emulated(key)
            | Self::Model(ModelError::Figure { key, .. }) => Some(key),
            Self::Model(ModelError::Name(_) | ModelError::Device(_)) => Some("model"),
            Self::Model(ModelError::Key(_)) | Self::Missing(_) | Self::Pair(_) => None,
        }
    }

    /// Returns `true` if the mistake is the value of the key, and not the key itself.
    pub(crate) const fn is_of_value(&self) -> bool {
        matches!(self, Self::Value { .. } | Self::Model(_))
    }
}

/// A mistake in the clouds together.
#[derive(Debug, Error)]
pub(crate) enum CloudsError {
    #[error("--{option} {cloud:?}: there is no such cloud; there are {clouds}")]
    Unknown { option: &'static str, cloud: String, clouds: String },
    #[error(
        "--{option} {cloud:?}: that cloud runs on its own server; give the drive to that server"
    )]
    Elsewhere { option: &'static str, cloud: String },
    #[error("two clouds are called {0:?}; give each its own name")]
    SameName(String),
    #[error("two clouds with priority {priority}; give each its own")]
    SamePriority { cloud: String, priority: u16 },
    #[error("cloud {cloud:?}: {source}")]
    Emulation { cloud: String, source: EmulationError },
}

impl CloudsError {
    /// Returns the cloud and its key at fault, if the mistake can stand in a file of clouds.
    pub(crate) fn at_fault(&self) -> Option<(&str, &'static str)> {
        match self {
            Self::SameName(cloud) => Some((cloud, "name")),
            Self::SamePriority { cloud, .. } => Some((cloud, "priority")),
            Self::Emulation { cloud, source: EmulationError::Drive(_) } => Some((cloud, "drive")),
            Self::Emulation { cloud, source: EmulationError::Start { .. } } => {
                Some((cloud, "start"))
            }
            Self::Unknown { .. } | Self::Elsewhere { .. } => None,
        }
    }
}

/// The clouds of a run without `--cloud`.
pub(crate) const DEFAULTS: [&str; 2] = [
    "name=west,priority=1,model=DETR-ResNet-101,drive=cicv5g/rural_n8_v10,start=62s",
    "name=east,priority=2,model=DINO-SWIN-Tiny,drive=vnperf/highway:sprint,start=150s",
];

impl CloudOptions {
    /// Returns the cloud with these keys.
    ///
    /// # Errors
    /// Returns the first reason to refuse a single key or all keys together.
    pub(crate) fn of_pairs(
        pairs: impl IntoIterator<Item = Result<(String, String), CloudError>>,
    ) -> Result<Self, CloudError> {
        let mut keys = CloudKeys::default();
        for pair in pairs {
            let (key, value) = pair?;
            let field = keys.field(&key).ok_or_else(|| CloudError::Key(key.clone()))?;
            if field.replace(value).is_some() {
                return Err(CloudError::Twice(key));
            }
        }
        keys.wanted()
    }

    /// Returns the files that its keys name, if they are given.
    pub(crate) fn files(&self) -> Vec<&Path> {
        match &self.address {
            CloudAddress::Emulated { drive, .. } => {
                let file = drive.rsplit_once(':').map_or(&**drive, |(file, _)| file);
                vec![Path::new(drive), Path::new(file)]
            }
            CloudAddress::Remote { remote: RemoteServer { ca, cert, key, token, .. }, .. } => {
                [ca, cert, key, token].into_iter().flatten().map(PathBuf::as_path).collect()
            }
        }
    }
}

/// Changes the drives and starts of the clouds that the options name. A changed drive begins at 0
/// unless a start is given.
///
/// # Errors
/// Returns an error if there is no such cloud, if it is a server elsewhere, or if two clouds have
/// the same name or priority.
pub(crate) fn adjust(
    clouds: &mut [CloudOptions],
    drives: &[NamedValue<String>],
    starts: &[NamedValue<Duration>],
) -> Result<(), CloudsError> {
    for (i, cloud) in clouds.iter().enumerate() {
        if clouds[..i].iter().any(|other| other.name == cloud.name) {
            return Err(CloudsError::SameName(cloud.name.clone()));
        }
        if clouds[..i].iter().any(|other| other.priority == cloud.priority) {
            let CloudOptions { name: cloud, priority, .. } = cloud.clone();
            return Err(CloudsError::SamePriority { cloud, priority });
        }
    }
    for NamedValue { cloud, value } in drives {
        let (drive, start) = find("drive", clouds, cloud)?;
        (*drive, *start) = (value.clone(), Duration::ZERO);
    }
    for NamedValue { cloud, value } in starts {
        *find("start", clouds, cloud)?.1 = *value;
    }
    Ok(())
}

/// Finds the drive and start of the cloud with this name, to change them.
fn find<'a>(
    option: &'static str,
    clouds: &'a mut [CloudOptions],
    cloud: &str,
) -> Result<(&'a mut String, &'a mut Duration), CloudsError> {
    let names: Vec<&str> = clouds.iter().map(|cloud| cloud.name.as_str()).collect();
    let clouds_text = names.join(", ");
    match clouds.iter_mut().find(|wanted| wanted.name == cloud).map(|wanted| &mut wanted.address) {
        Some(CloudAddress::Emulated { drive, start, .. }) => Ok((drive, start)),
        Some(CloudAddress::Remote { .. }) => {
            Err(CloudsError::Elsewhere { option, cloud: cloud.to_owned() })
        }
        None => Err(CloudsError::Unknown { option, cloud: cloud.to_owned(), clouds: clouds_text }),
    }
}

impl FromStr for CloudOptions {
    type Err = CloudError;

    /// Reads `name=west,priority=1,model=DETR-ResNet-101,drive=vnperf/highway:sprint,start=150s`,
    /// or with `url=…` instead of a drive. Values cannot contain commas.
    fn from_str(text: &str) -> Result<Self, CloudError> {
        let pairs = text.split(',').map(|pair| {
            let (key, value) =
                pair.split_once('=').ok_or_else(|| CloudError::Pair(pair.to_owned()))?;
            Ok((key.to_owned(), value.to_owned()))
        });
        Self::of_pairs(pairs)
    }
}

#[derive(Default)]
struct CloudKeys {
    name: Option<String>,
    priority: Option<String>,
    model: Option<String>,
    runtime: Option<String>,
    ap: Option<String>,
    drive: Option<String>,
    start: Option<String>,
    url: Option<String>,
    ca: Option<String>,
    cert: Option<String>,
    key: Option<String>,
    token: Option<String>,
}

impl CloudKeys {
    fn field(&mut self, key: &str) -> Option<&mut Option<String>> {
        Some(match key {
            "name" => &mut self.name,
            "priority" => &mut self.priority,
            "model" => &mut self.model,
            "runtime" => &mut self.runtime,
            "ap" => &mut self.ap,
            "drive" => &mut self.drive,
            "start" => &mut self.start,
            "url" => &mut self.url,
            "ca" => &mut self.ca,
            "cert" => &mut self.cert,
            "key" => &mut self.key,
            "token" => &mut self.token,
            _ => return None,
        })
    }

    fn wanted(self) -> Result<CloudOptions, CloudError> {
        let name = self.name.ok_or(CloudError::Missing("name"))?;
        if name.is_empty() || name == "local" {
            let wanted = "it must be a name other than local".to_owned();
            return Err(CloudError::Value { key: "name", value: name, wanted });
        }
        let priority = self.priority.ok_or(CloudError::Missing("priority"))?;
        let priority = match priority.parse() {
            Ok(number) if number > 0 => number,
            _ => {
                let wanted = "it must be from 1 to 65535".to_owned();
                return Err(CloudError::Value { key: "priority", value: priority, wanted });
            }
        };
        let (runtime, ap) = (self.runtime.as_deref(), self.ap.as_deref());
        if self.model.is_none() && (runtime.is_some() || ap.is_some()) {
            return Err(CloudError::Missing("model"));
        }
        let model = self.model.map(|model| Model::with_figures(&model, runtime, ap)).transpose()?;
        let address = if let Some(url) = self.url {
            if self.drive.is_some() || self.start.is_some() {
                let key = if self.drive.is_some() { "drive" } else { "start" };
                return Err(CloudError::Remote(key));
            }
            let path = |value: Option<String>| value.map(PathBuf::from);
            let [ca, cert, key, token] = [self.ca, self.cert, self.key, self.token].map(path);
            CloudAddress::Remote { model, remote: RemoteServer { url, ca, cert, key, token } }
        } else {
            let remote =
                [("ca", self.ca), ("cert", self.cert), ("key", self.key), ("token", self.token)];
            if let Some((key, _)) = remote.into_iter().find(|(_, value)| value.is_some()) {
                return Err(CloudError::Emulated(key));
            }
            let model = model.ok_or(CloudError::Missing("model or url"))?;
            let drive = self.drive.ok_or(CloudError::Missing("drive or url"))?;
            let start = start(self.start.as_deref().unwrap_or("0s"))?;
            CloudAddress::Emulated { model, drive, start }
        };
        Ok(CloudOptions { name, priority, address })
    }
}

impl<T> NamedValue<T> {
    /// Reads `west=VALUE`.
    fn parse(
        text: &str,
        value: impl FnOnce(&str) -> Result<T, CloudError>,
    ) -> Result<Self, CloudError> {
        let (cloud, text) =
            text.split_once('=').ok_or_else(|| CloudError::Pair(text.to_owned()))?;
        Ok(Self { cloud: cloud.to_owned(), value: value(text)? })
    }
}

impl FromStr for NamedValue<String> {
    type Err = CloudError;

    fn from_str(text: &str) -> Result<Self, CloudError> {
        Self::parse(text, |value| Ok(value.to_owned()))
    }
}

impl FromStr for NamedValue<Duration> {
    type Err = CloudError;

    fn from_str(text: &str) -> Result<Self, CloudError> {
        Self::parse(text, start)
    }
}

fn start(text: &str) -> Result<Duration, CloudError> {
    let read = duration(text, "62s", &ANY);
    read.map_err(|wanted| CloudError::Value { key: "start", value: text.to_owned(), wanted })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fault(text: &str) -> String {
        text.parse::<CloudOptions>().unwrap_err().to_string()
    }

    fn emulated(model: &str, drive: &str, start: Duration) -> CloudAddress {
        CloudAddress::Emulated { model: model.parse().unwrap(), drive: drive.into(), start }
    }

    fn defaults() -> Vec<CloudOptions> {
        DEFAULTS.iter().map(|text| text.parse().unwrap()).collect()
    }

    fn named<T: FromStr<Err = CloudError>>(text: &str) -> T {
        text.parse().unwrap()
    }

    #[test]
    fn an_emulated_cloud_has_a_model_and_a_drive() {
        let text = "name=a,priority=7,model=DINO-SWIN-Tiny,drive=vnperf/highway:sprint,start=1.5s";
        let cloud: CloudOptions = text.parse().unwrap();
        assert_eq!((cloud.name.as_str(), cloud.priority), ("a", 7));
        let start = Duration::from_millis(1500);
        assert_eq!(cloud.address, emulated("DINO-SWIN-Tiny", "vnperf/highway:sprint", start));
    }

    #[test]
    fn a_remote_cloud_has_a_url() {
        let cloud: CloudOptions =
            "name=a,priority=1,url=https://h:1,ca=ca.pem,token=t".parse().unwrap();
        let remote = RemoteServer {
            url: "https://h:1".into(),
            ca: Some("ca.pem".into()),
            token: Some("t".into()),
            ..RemoteServer::default()
        };
        assert_eq!(cloud.address, CloudAddress::Remote { model: None, remote });
    }

    #[test]
    fn a_mistaken_cloud_is_refused_with_the_key() {
        for (text, expected) in [
            ("name", "\"name\" is not KEY=VALUE"),
            ("nome=a", "there is no key \"nome\""),
            ("name=a,name=b", "key \"name\" is given twice"),
            ("name=a", "priority is missing"),
            ("priority=1", "name is missing"),
            ("name=local,priority=1", "name \"local\""),
            ("name=a,priority=0", "priority \"0\""),
            ("name=a,priority=65536", "from 1 to 65535"),
            ("name=a,priority=1", "model or url is missing"),
            ("name=a,priority=1,model=yolo", "no model \"yolo\""),
            ("name=a,priority=1,url=http://h,ap=50", "model is missing"),
            ("name=a,priority=1,model=yolo,runtime=0ms,url=http://h", "runtime \"0ms\""),
            ("name=a,priority=1,model=DETR-ResNet-50", "drive or url is missing"),
            ("name=a,priority=1,model=DETR-ResNet-50,drive=x,start=-1", "start \"-1\""),
            ("name=a,priority=1,model=DETR-ResNet-50,drive=x,ca=y", "ca needs url"),
            ("name=a,priority=1,url=http://h,drive=x", "drive cannot be given with url"),
        ] {
            assert!(fault(text).contains(expected), "{text}: {}", fault(text));
        }
    }

    #[test]
    fn another_drive_begins_at_its_start_and_another_start_keeps_the_drive() {
        let mut clouds = defaults();
        let (drive, start) = (named("west=vnperf/downtown:verizon"), named("east=7s"));
        adjust(&mut clouds, &[drive], &[start]).unwrap();
        let (west, east) = ("vnperf/downtown:verizon", "vnperf/highway:sprint");
        assert_eq!(clouds[0].address, emulated("DETR-ResNet-101", west, Duration::ZERO));
        assert_eq!(clouds[1].address, emulated("DINO-SWIN-Tiny", east, Duration::from_secs(7)));
    }

    #[test]
    fn a_drive_for_no_cloud_is_refused_with_those_there_are() {
        let fault = adjust(&mut defaults(), &[named("north=x")], &[]).unwrap_err().to_string();
        assert!(fault.contains("there are west, east"), "{fault}");
        let mut elsewhere = vec!["name=a,priority=1,url=http://h".parse().unwrap()];
        let fault = adjust(&mut elsewhere, &[], &[named("a=1s")]).unwrap_err().to_string();
        assert!(fault.contains("on its own server"), "{fault}");
    }

    #[test]
    fn two_clouds_of_one_name_are_refused() {
        let mut clouds = vec![defaults().remove(0), defaults().remove(0)];
        assert!(matches!(adjust(&mut clouds, &[], &[]), Err(CloudsError::SameName(_))));
    }
}
