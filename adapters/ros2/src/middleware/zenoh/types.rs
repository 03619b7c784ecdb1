//! Hashes of types. The node knows those of its own topics and services; all others it learns from
//! its peers' tokens.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard};
use std::thread;

use fuseline_engine::lock;
use tracing::info;
use zenoh::pubsub::Subscriber;
use zenoh::sample::SampleKind;
use zenoh::{Session, Wait};

use super::wire::{TokenOwner, type_of};

/// The action once a hash is known, on a thread of its own.
type HashCallback = Box<dyn FnOnce(&str) + Send>;

/// Hashes by the types' names in DDS.
#[derive(Clone, Default)]
pub(super) struct Types(Arc<Mutex<BTreeMap<String, TypeState>>>);

enum TypeState {
    Known(String),
    /// Nobody has said it yet; it is listened for.
    Awaited {
        acts: Vec<HashCallback>,
        tokens: Option<Subscriber<()>>,
    },
}

impl Types {
    /// Returns the hash of a type, if it is known by now.
    pub(super) fn known(&self, type_name: &str) -> Option<String> {
        if let Some(hash) = own(type_name) {
            return Some(hash.to_owned());
        }
        match self.locked().get(type_name)? {
            TypeState::Known(hash) => Some(hash.clone()),
            TypeState::Awaited { .. } => None,
        }
    }

    /// Does something with the hash of a type, now or when it is known.
    pub(super) fn when_known(
        &self,
        session: &Session,
        owner: &TokenOwner,
        type_name: &str,
        act: HashCallback,
    ) -> zenoh::Result<()> {
        if let Some(hash) = self.known(type_name) {
            act(&hash);
            return Ok(());
        }
        let is_first = {
            let mut types = self.locked();
            let awaited = || TypeState::Awaited { acts: Vec::new(), tokens: None };
            let state = types.entry(type_name.to_owned()).or_insert_with(awaited);
            match state {
                // It came just now.
                TypeState::Known(hash) => {
                    let hash = hash.clone();
                    drop(types);
                    act(&hash);
                    return Ok(());
                }
                TypeState::Awaited { acts, tokens } => {
                    acts.push(act);
                    acts.len() == 1 && tokens.is_none()
                }
            }
        };
        if is_first {
            info!(type_name, "the type's hash is taken from the first peer that has the type");
            let (types, known) = (self.clone(), type_name.to_owned());
            let tokens = session
                .liveliness()
                .declare_subscriber(owner.tokens_of_type(type_name))
                .history(true)
                .callback(move |token| {
                    if let (SampleKind::Put, Some((_, hash))) =
                        (token.kind(), type_of(token.key_expr()))
                    {
                        types.learn(&known, hash);
                    }
                })
                .wait()?;
            if let Some(TypeState::Awaited { tokens: stored, .. }) =
                self.locked().get_mut(type_name)
            {
                *stored = Some(tokens);
            }
        }
        Ok(())
    }

    /// Learns from a peer that this type has this hash. The first one counts.
    pub(super) fn learn(&self, type_name: &str, hash: &str) {
        let mut types = self.locked();
        let Some(state @ TypeState::Awaited { .. }) = types.get_mut(type_name) else { return };
        info!(type_name, hash, "the type's hash is known");
        let was = std::mem::replace(state, TypeState::Known(hash.to_owned()));
        drop(types);
        let hash = hash.to_owned();
        // Zenoh's own threads are not to be held up by what is declared now, or ended.
        thread::spawn(move || {
            if let TypeState::Awaited { acts, tokens } = was {
                drop(tokens);
                for act in acts {
                    act(&hash);
                }
            }
        });
    }

    /// Locks the types. A change is made whole, so even a poisoned lock holds a sound state.
    fn locked(&self) -> MutexGuard<'_, BTreeMap<String, TypeState>> {
        lock(&self.0)
    }
}

/// The types of the node's own topics and services, by their names in DDS, from Iron on. Hashes are
/// what `tests/peers/definitions.py` prints for the types' definitions.
const OWN: [(&str, &str); 16] = [
    (
        "diagnostic_msgs::msg::dds_::DiagnosticArray_",
        "RIHS01_5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e",
    ),
    (
        "diagnostic_msgs::msg::dds_::DiagnosticStatus_",
        "RIHS01_b0e3e692ea2d54a8af2f4ef1930e81556a2db55216b771f8a7d2724ed47bf0e4",
    ),
    (
        "lifecycle_msgs::msg::dds_::TransitionEvent_",
        "RIHS01_d5f8873a2f0146498f812d7885c7327ce27e463d36811d8792f35ee38c0d6c38",
    ),
    (
        "lifecycle_msgs::srv::dds_::ChangeState_",
        "RIHS01_356fe34f0475a43acf54542013af4167b0e729f77ea22ffb045c6ad8e20668e5",
    ),
    (
        "lifecycle_msgs::srv::dds_::GetAvailableStates_",
        "RIHS01_00a07d79d2207d71e81a8cbc1880e5d924cc16d4688ea8e8e06e443dc8f8aa1d",
    ),
    (
        "lifecycle_msgs::srv::dds_::GetAvailableTransitions_",
        "RIHS01_59b7ecefce0982a8a844b9f2c4f14764c1c4543cc55e72924e2aa4adad83e9bc",
    ),
    (
        "lifecycle_msgs::srv::dds_::GetState_",
        "RIHS01_800a0a5aae599782b02932de0caf563f6dc4e7e94b794eadde075ba2cbef9795",
    ),
    (
        "rcl_interfaces::msg::dds_::Log_",
        "RIHS01_e28ce254ca8abc06abf92773b74602cdbf116ed34fbaf294fb9f81da9f318eac",
    ),
    (
        "rcl_interfaces::msg::dds_::ParameterEvent_",
        "RIHS01_043e627780fcad87a22d225bc2a037361dba713fca6a6b9f4b869a5aa0393204",
    ),
    (
        "rcl_interfaces::srv::dds_::DescribeParameters_",
        "RIHS01_845b484d71eb0673dae682f2e3ba3c4851a65a3dcfb97bddd82c5b57e91e4cff",
    ),
    (
        "rcl_interfaces::srv::dds_::GetParameterTypes_",
        "RIHS01_da199c878688b3e530bdfe3ca8f74cb9fa0c303101e980a9e8f260e25e1c80ca",
    ),
    (
        "rcl_interfaces::srv::dds_::GetParameters_",
        "RIHS01_bf9803d5c74cf989a5de3e0c2e99444599a627c7ff75f97b8c05b01003675cbc",
    ),
    (
        "rcl_interfaces::srv::dds_::ListParameters_",
        "RIHS01_3e6062bfbb27bfb8730d4cef2558221f51a11646d78e7bb30a1e83afac3aad9d",
    ),
    (
        "rcl_interfaces::srv::dds_::SetParameters_",
        "RIHS01_56eed9a67e169f9cb6c1f987bc88f868c14a8fc9f743a263bc734c154015d7e0",
    ),
    (
        "rcl_interfaces::srv::dds_::SetParametersAtomically_",
        "RIHS01_0e192ef259c07fc3c07a13191d27002222e65e00ccec653ca05e856f79285fcd",
    ),
    (
        "rosgraph_msgs::msg::dds_::Clock_",
        "RIHS01_692f7a66e93a3c83e71765d033b60349ba68023a8c689a79e48078bcb5c58564",
    ),
];

/// Returns the hash of a type of the node's own topics and services.
fn own(type_name: &str) -> Option<&'static str> {
    OWN.iter().find(|(name, _)| *name == type_name).map(|(_, hash)| *hash)
}
