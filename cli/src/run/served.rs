//! The model that a cloud serves: the one that this process emulates, the one that the server
//! names, or the one that the user named.

use std::time::Duration;

use fuseline_tokio::grpc::tonic::{Code, Request};
use fuseline_tokio::grpc::{CallError, Connection, Description, InferClient};
use tokio::time::timeout;

use crate::emulation::Emulation;
use fuseline_evaluation::models::Model;

/// The time that a server may take to describe itself.
const PATIENCE: Duration = Duration::from_secs(2);

/// The model that a cloud serves, as far as that is known.
#[derive(Clone, PartialEq, Debug, Default)]
pub(crate) struct Served {
    /// The model's name for people.
    pub(crate) model: Option<String>,
    /// The usual runtime of the model.
    pub(crate) runtime: Option<Duration>,
    /// Its box AP on COCO.
    pub(crate) ap: Option<f64>,
    /// The drive that its network is taken from.
    pub(crate) drive: Option<String>,
    /// `true` if its runtime is emulated.
    pub(crate) emulated: bool,
    /// The reason why its server did not name the model. Then the model is the one that the user
    /// named.
    pub(crate) describe_error: Option<String>,
}

impl Served {
    /// Returns the user's description of another server, before it was queried.
    pub(crate) fn reported(model: Option<&Model>) -> Self {
        let Some(model) = model else { return Self::default() };
        let (name, runtime) = (Some(model.to_string()), Some(model.runtime));
        Self { model: name, runtime, ap: model.ap, ..Self::default() }
    }

    /// Returns the model on board.
    pub(crate) fn local(model: &Model) -> Self {
        Self { emulated: true, ..Self::reported(Some(model)) }
    }

    /// Asks the server what it serves. Returns a warning if the user stated something else.
    pub(crate) async fn describe(&mut self, connection: Connection) -> Option<String> {
        let mut client = InferClient::new(connection);
        let description = match timeout(PATIENCE, client.describe(Request::new(()))).await {
            Ok(Ok(printed)) => printed.into_inner(),
            Ok(Err(status)) if status.code() == Code::Unimplemented => {
                self.describe_error = Some("it does not know this call".to_owned());
                return None;
            }
            Ok(Err(status)) => {
                self.describe_error = Some(CallError::from(status).to_string());
                return None;
            }
            Err(_) => {
                self.describe_error = Some("no answer".to_owned());
                return None;
            }
        };
        let printed = Self::from(description);
        let reported = std::mem::replace(self, printed).model?;
        let is = self.model.as_deref().unwrap_or("a model without a name");
        (is != reported).then(|| {
            format!("its server serves {is}, not {reported}; the tables show what it serves")
        })
    }
}

impl From<&Emulation> for Served {
    fn from(emulation: &Emulation) -> Self {
        let drive = Some(emulation.drive.name().to_owned());
        Self { drive, emulated: true, ..Self::reported(Some(&emulation.model)) }
    }
}

impl From<Description> for Served {
    fn from(printed: Description) -> Self {
        let Description { model, runtime_ms, ap, drive, emulated } = printed;
        let text =
            |text: String| Some(crate::fault::one_line(&text)).filter(|text| !text.is_empty());
        // A text that is not a time gives `None`.
        let runtime = runtime_ms.and_then(|ms| Duration::try_from_secs_f64(ms / 1000.0).ok());
        let ap = ap.filter(|ap| (0.0..=100.0).contains(ap));
        Self { model: text(model), runtime, ap, drive: text(drive), emulated, describe_error: None }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_server_says_is_taken_as_far_as_it_can_be_so() {
        let said = Description {
            model: "my\nmodel".to_owned(),
            runtime_ms: Some(1.5),
            ap: Some(100.0),
            drive: String::new(),
            emulated: true,
        };
        let served = Served::from(said.clone());
        let expected = Served {
            model: Some("my model".to_owned()),
            runtime: Some(Duration::from_micros(1500)),
            ap: Some(100.0),
            emulated: true,
            ..Served::default()
        };
        assert_eq!(served, expected);
        for (ap, is_taken) in [(0.0, true), (-0.1, false), (100.1, false), (f64::NAN, false)] {
            let served = Served::from(Description { ap: Some(ap), ..said.clone() });
            assert_eq!(served.ap, Some(ap).filter(|_| is_taken));
        }
        for runtime in [-1.0, f64::INFINITY, f64::NAN] {
            let said = Description { runtime_ms: Some(runtime), ..said.clone() };
            assert_eq!(Served::from(said).runtime, None);
        }
    }

    #[test]
    fn what_is_computed_here_is_emulated_and_what_is_elsewhere_is_not_known_to_be() {
        let model: Model = "DINO-SWIN-Tiny@orin".parse().unwrap();
        let named = Served::reported(Some(&model));
        assert_eq!(named.model.as_deref(), Some("DINO-SWIN-Tiny on Orin"));
        assert_eq!((named.runtime, named.ap), (Some(model.runtime), model.ap));
        assert_eq!((named.emulated, Served::local(&model).emulated), (false, true));
        assert_eq!(Served { emulated: false, ..Served::local(&model) }, named);
        assert_eq!(Served::reported(None), Served::default());
    }
}
