//! Models: the detectors whose runtimes the paper measured, emulated by waiting for as long.

use std::fmt;
use std::str::FromStr;
use std::sync::LazyLock;
use std::time::Duration;

use serde::Deserialize;
use thiserror::Error;

/// A runtime differs from the paper's by at most one part in this many.
const JITTER: u64 = 20;

static TABLE: LazyLock<ModelTable> = LazyLock::new(|| {
    serde_json::from_str(include_str!("../data/paper.json")).expect("a test reads the same bytes")
});

/// A detector on a device: how long it takes and how good it is.
#[derive(Clone, PartialEq, Debug)]
pub(crate) struct Model {
    /// The model's name in the paper.
    pub(crate) name: &'static str,
    /// What it runs on.
    pub(crate) device: Device,
    /// How long the paper measured it to take there.
    pub(crate) runtime: Duration,
    /// Box AP on COCO val2017 as published by its authors, 0 to 100; `None` where no figure was
    /// found.
    pub(crate) ap: Option<f64>,
}

/// What a model runs on.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Device {
    /// The vehicle's computer.
    Orin,
    /// A cloud's accelerator.
    A100,
}

/// Why there is no such model.
#[derive(Debug, PartialEq, Error)]
pub(crate) enum ModelError {
    #[error("no model {0:?}; there are {names}", names = names())]
    Name(String),
    #[error("no device {0:?}; there are orin and a100")]
    Device(String),
}

#[derive(Deserialize)]
struct ModelTable {
    runtime_ms: Vec<ModelRow>,
}

#[derive(Deserialize)]
struct ModelRow {
    model: String,
    orin: f64,
    a100: f64,
    coco_ap: Option<f64>,
}

impl Model {
    /// The runtime for message `t`: the paper's, up to 5 % shorter or longer, the same for the same
    /// seed.
    pub(crate) fn runtime(&self, seed: u64, t: u64) -> Duration {
        let name = self.name.bytes().fold(0, |hash, byte| mix(hash ^ u64::from(byte)));
        let (least, greatest) = self.runtimes();
        let range = u64::try_from(greatest.abs_diff(least).as_nanos()).unwrap_or(u64::MAX);
        let strayed = mix(mix(seed ^ name) ^ t) % range.saturating_add(1);
        least + Duration::from_nanos(strayed)
    }

    /// The shortest and the longest that it takes.
    pub(crate) fn runtimes(&self) -> (Duration, Duration) {
        let nanos = u64::try_from(self.runtime.as_nanos()).unwrap_or(u64::MAX);
        let most = nanos / JITTER;
        (Duration::from_nanos(nanos - most), Duration::from_nanos(nanos + most))
    }
}

impl FromStr for Model {
    type Err = ModelError;

    /// `DETR-ResNet-101@a100`, in any case; the device is `a100` unless it is named.
    fn from_str(text: &str) -> Result<Self, ModelError> {
        let (name, device) = text.split_once('@').unwrap_or((text, "a100"));
        let device = match device.to_ascii_lowercase().as_str() {
            "orin" => Device::Orin,
            "a100" => Device::A100,
            _ => return Err(ModelError::Device(device.to_owned())),
        };
        let row = TABLE
            .runtime_ms
            .iter()
            .find(|row| row.model.eq_ignore_ascii_case(name))
            .ok_or_else(|| ModelError::Name(name.to_owned()))?;
        let ms = match device {
            Device::Orin => row.orin,
            Device::A100 => row.a100,
        };
        let runtime = Duration::from_secs_f64(ms / 1000.0);
        Ok(Self { name: &row.model, device, runtime, ap: row.coco_ap })
    }
}

impl fmt::Display for Model {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let device = match self.device {
            Device::Orin => "Orin",
            Device::A100 => "A100",
        };
        write!(f, "{} on {device}", self.name)
    }
}

pub(crate) fn names() -> String {
    TABLE.runtime_ms.iter().map(|row| row.model.as_str()).collect::<Vec<_>>().join(", ")
}

/// Spreads neighbouring numbers over all of `u64`: a hash, with the constants of Steele and Vigna's `SplitMix64`.
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
