//! Models: the detectors whose runtimes the paper measured. Waiting for as long emulates them.

use std::borrow::Cow;
use std::fmt;
use std::str::FromStr;
use std::time::Duration;

use fuseline_traces::nanos;
use thiserror::Error;

use crate::duration::{SHORTEST, duration};
use crate::paper::PAPER;

/// A runtime differs from the paper's by at most one part in this many.
const JITTER: u64 = 20;

/// Bytes of a request in the paper's drive: one compressed camera image.
pub const REQUEST_BYTES: usize = 33_300;
/// Bytes of a reply in the paper's drive.
pub const REPLY_BYTES: usize = 1_000;

/// A detector on a device: how long it takes and how good it is.
#[derive(Clone, PartialEq, Debug)]
pub struct Model {
    /// The model's name in the paper, or the user's.
    pub name: Cow<'static, str>,
    /// The device, if the model is one of the paper's.
    pub device: Option<Device>,
    /// The runtime there, by the paper's measurement or as the user says.
    pub runtime: Duration,
    /// Box AP on COCO val2017 as published by its authors, or as the user says, 0 to 100; `None`
    /// where no figure was found.
    pub ap: Option<f64>,
}

/// The device of a model.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Device {
    /// The vehicle's computer.
    Orin,
    /// A cloud's accelerator.
    A100,
}

/// The reason a model is refused.
#[derive(Debug, PartialEq, Error)]
pub enum ModelError {
    /// The model is unknown and has no runtime.
    #[error(
        "there is no model {0:?}; the models are {names}; another model needs runtime=TIME, and \
         ap=AP if it is known",
        names = names()
    )]
    Name(String),
    /// The paper did not measure this device.
    #[error("there is no device {0:?}; the devices are orin and a100")]
    Device(String),
    /// A figure is not valid.
    #[error("{key} {value:?} is not valid; {wanted}")]
    Figure {
        /// Its name.
        key: &'static str,
        /// The given value.
        value: String,
        /// The allowed values.
        wanted: String,
    },
    /// The key is not a figure of a model.
    #[error("{0:?} is neither runtime=TIME nor ap=AP; write MODEL[,runtime=TIME][,ap=AP]")]
    Key(String),
}

impl Model {
    /// Returns one of the paper's models, such as `DETR-ResNet-101@a100` in any case, on an `a100`
    /// unless the text names the device. Any other model needs a runtime. The figures given here
    /// replace the paper's.
    ///
    /// # Errors
    /// Returns an error if the model is unknown and has no runtime, or if a figure is not valid.
    pub fn with_figures(
        text: &str,
        runtime: Option<&str>,
        ap: Option<&str>,
    ) -> Result<Self, ModelError> {
        let runtime = runtime.map(runtime_of).transpose()?;
        let ap = ap.map(ap_of).transpose()?;
        let model = match (Self::of_paper(text), runtime) {
            (Err(ModelError::Name(name)), Some(runtime)) => {
                Self { name: name.into(), device: None, runtime, ap }
            }
            (known, _) => known?,
        };
        Ok(Self { runtime: runtime.unwrap_or(model.runtime), ap: ap.or(model.ap), ..model })
    }

    fn of_paper(text: &str) -> Result<Self, ModelError> {
        let (name, device) = text.split_once('@').unwrap_or((text, "a100"));
        let row = PAPER.runtime_ms.iter().find(|row| row.model.eq_ignore_ascii_case(name));
        let row = row.ok_or_else(|| ModelError::Name(text.to_owned()))?;
        let (device, ms) = match device.to_ascii_lowercase().as_str() {
            "orin" => (Device::Orin, row.orin),
            "a100" => (Device::A100, row.a100),
            _ => return Err(ModelError::Device(device.to_owned())),
        };
        let runtime = Duration::from_secs_f64(ms / 1000.0);
        let name = Cow::Borrowed(row.model.as_str());
        Ok(Self { name, device: Some(device), runtime, ap: row.coco_ap })
    }

    /// Returns the runtime for message `t`: the paper's, up to 5 % shorter or longer, the same for
    /// the same seed.
    #[must_use]
    pub fn runtime(&self, seed: u64, t: u64) -> Duration {
        let name = self.name.bytes().fold(0, |hash, byte| mix(hash ^ u64::from(byte)));
        let (least, greatest) = self.runtimes();
        let range = nanos(greatest.abs_diff(least));
        let strayed = mix(mix(seed ^ name) ^ t) % range.saturating_add(1);
        least + Duration::from_nanos(strayed)
    }

    /// Returns `true` if it takes as long as the paper measured.
    #[must_use]
    pub fn has_papers_runtime(&self) -> bool {
        let device = match self.device {
            Some(Device::Orin) => "orin",
            Some(Device::A100) => "a100",
            None => return false,
        };
        let paper = Self::of_paper(&format!("{}@{device}", self.name));
        paper.is_ok_and(|paper| paper.runtime == self.runtime)
    }

    /// Returns the shortest and the longest runtime.
    #[must_use]
    pub fn runtimes(&self) -> (Duration, Duration) {
        let runtime = nanos(self.runtime);
        let most = runtime / JITTER;
        (Duration::from_nanos(runtime - most), Duration::from_nanos(runtime + most))
    }
}

impl FromStr for Model {
    type Err = ModelError;

    /// Reads `MODEL[,runtime=TIME][,ap=AP]`.
    fn from_str(text: &str) -> Result<Self, ModelError> {
        let (name, figures) = text.split_once(',').unwrap_or((text, ""));
        let [mut runtime, mut ap] = [None; 2];
        for figure in figures.split(',').filter(|figure| !figure.is_empty()) {
            match figure.split_once('=') {
                Some(("runtime", value)) if runtime.is_none() => runtime = Some(value),
                Some(("ap", value)) if ap.is_none() => ap = Some(value),
                _ => return Err(ModelError::Key(figure.to_owned())),
            }
        }
        Self::with_figures(name, runtime, ap)
    }
}

fn runtime_of(text: &str) -> Result<Duration, ModelError> {
    let read = duration(text, "45ms", &(SHORTEST..=Duration::from_secs(60)));
    read.map_err(|wanted| ModelError::Figure { key: "runtime", value: text.to_owned(), wanted })
}

fn ap_of(text: &str) -> Result<f64, ModelError> {
    let ap: Option<f64> = text.parse().ok().filter(|ap| (0.0..=100.0).contains(ap));
    let wrong = |wanted| ModelError::Figure { key: "ap", value: text.to_owned(), wanted };
    match ap {
        Some(ap) if ap > 0.0 && ap < 1.0 => Err(wrong(format!(
            "it must be points of AP, from 0 to 100: write {} if {text} is a fraction",
            (ap * 1e4).round() / 1e2
        ))),
        Some(ap) => Ok(ap),
        None => Err(wrong("it must be points of AP, from 0 to 100".to_owned())),
    }
}

impl fmt::Display for Model {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.device {
            Some(Device::Orin) => write!(f, "{} on Orin", self.name),
            Some(Device::A100) => write!(f, "{} on A100", self.name),
            None => f.write_str(&self.name),
        }
    }
}

/// Lists the paper's models, with commas.
#[must_use]
pub fn names() -> String {
    PAPER.runtime_ms.iter().map(|row| row.model.as_str()).collect::<Vec<_>>().join(", ")
}

/// Spreads neighbouring numbers over all of `u64`: a hash, with the constants of Steele and Vigna's
/// `SplitMix64`.
const fn mix(number: u64) -> u64 {
    let z = number.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn model(text: &str) -> Model {
        text.parse().unwrap()
    }

    #[test]
    fn a_model_has_the_papers_figures() {
        let local = model("detr-resnet-50@ORIN");
        assert_eq!(local.runtime, Duration::from_micros(301_700));
        assert_eq!(local.ap, Some(42.0));
        assert_eq!(local.to_string(), "DETR-ResNet-50 on Orin");
        assert_eq!(model("DINO-SWIN-Tiny").runtime, Duration::from_micros(90_100));
        assert_eq!(model("DINO-SWIN-Large").ap, None);
    }

    #[test]
    fn an_unknown_model_or_device_is_refused_with_those_there_are() {
        let name = "yolo".parse::<Model>().unwrap_err();
        assert!(name.to_string().contains("DETR-ResNet-50, DETR-ResNet-101"), "{name}");
        let device = "DETR-ResNet-50@tpu".parse::<Model>().unwrap_err();
        assert_eq!(device, ModelError::Device("tpu".to_owned()));
    }

    #[test]
    fn a_model_of_ones_own_has_the_figures_that_are_given() {
        let own = model("YOLO-NAS@thor,runtime=45.5ms,ap=52.2");
        assert_eq!((own.runtime, own.ap), (Duration::from_micros(45_500), Some(52.2)));
        assert_eq!(own.to_string(), "YOLO-NAS@thor");
        // Half of the paper's models have no AP.
        let paper = model("DINO-SWIN-Large,ap=58");
        assert_eq!((paper.ap, paper.runtime), (Some(58.0), model("DINO-SWIN-Large").runtime));
        for (text, expected) in [
            ("yolo,ap=50", "another model needs runtime=TIME"),
            ("yolo,runtime=0ms", "runtime \"0ms\" is not valid"),
            ("yolo,runtime=45", "such as 45ms: write 45ms"),
            ("yolo,runtime=nan", "runtime \"nan\" is not valid"),
            ("yolo,runtime=45ms,ap=101", "ap \"101\" is not valid"),
            ("yolo,runtime=45ms,ap=50,ap=51", "\"ap=51\" is neither"),
            ("yolo,runtime=45ms,ap=0.52", "write 52 if 0.52 is a fraction"),
            ("yolo,speed=45", "\"speed=45\" is neither"),
        ] {
            let fault = text.parse::<Model>().unwrap_err().to_string();
            assert!(fault.contains(expected), "{text}: {fault}");
        }
    }

    #[test]
    fn a_runtime_strays_by_up_to_five_percent_as_the_seed_says() {
        let model = model("DETR-ResNet-101");
        let runtimes: Vec<Duration> = (0..1000).map(|t| model.runtime(1, t)).collect();
        let within = model.runtime.mul_f64(0.95)..=model.runtime.mul_f64(1.05);
        assert!(runtimes.iter().all(|runtime| within.contains(runtime)));
        let (shortest, longest) = model.runtimes();
        assert!(runtimes.iter().all(|runtime| (shortest..=longest).contains(runtime)));
        let (least, most) = (runtimes.iter().min().unwrap(), runtimes.iter().max().unwrap());
        assert!(most.abs_diff(*least) > model.runtime.mul_f64(0.09), "{least:?} to {most:?}");
        assert_eq!(model.runtime(1, 7), runtimes[7]);
        assert_ne!(model.runtime(2, 7), runtimes[7]);
    }
}
